//! What a run is validated by, accumulated at every plant step whatever is recorded.

use super::{ReplanCounts, Snapshot};
use crate::robot::Limits;

/// The value of a metric.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Value {
    /// A number in the unit of the metric.
    Number(f64),
    /// A count or an index.
    Count(usize),
    /// Not applicable, or it never happened.
    None,
}

/// Name, unit and meaning of a metric.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Metric {
    /// The name, the same in every layer.
    pub name: &'static str,
    /// The unit, empty for counts.
    pub unit: &'static str,
    /// One line.
    pub meaning: &'static str,
}

const fn metric(name: &'static str, unit: &'static str, meaning: &'static str) -> Metric {
    Metric { name, unit, meaning }
}

/// An end effector that is no farther from its reference has reached it \[m\]; headlines have the same bound.
const REACHED: f64 = 0.01;

/// Every metric, in the order of [`Metrics::values`].
pub const METRICS: &[Metric] = &[
    metric("min_clearance", "m", "smallest surface distance between a link and an obstacle"),
    metric("min_clearance_time", "s", "when it occurred"),
    metric("min_clearance_link", "", "at which link, counted from 0 at the base"),
    metric("collision_time", "s", "first contact of a link with an obstacle"),
    metric("intrusion_time", "s", "total time with a link inside an obstacle"),
    metric("intrusion_depth", "m", "deepest penetration of a link into an obstacle"),
    metric("intrusion_link", "", "of which link, counted from 0 at the base"),
    metric("tail_start", "s", "end of the transient: 80 % of the run"),
    metric(
        "rms_error_transient",
        "m",
        "RMS distance to the reference in the first 80 % of the run",
    ),
    metric(
        "max_error_transient",
        "m",
        "largest distance to the reference in the first 80 % of the run",
    ),
    metric("rms_error_tail", "m", "RMS distance to the reference in the last 20 % of the run"),
    metric("max_error_tail", "m", "largest distance to the reference in the last 20 % of the run"),
    metric("max_orientation_error_tail", "rad", "the same for the orientation of a pose task"),
    metric("end_error", "m", "distance to the reference at the end"),
    metric("end_orientation_error", "rad", "the same for the orientation of a pose task"),
    metric("end_time_left", "s", "for how long the reference still moves then, by its own clock"),
    metric("end_delay", "s", "how late it is then, with a governor only"),
    metric("settling_time", "s", "from then on within 2 % of the first error, or 1 mm if larger"),
    metric(
        "max_error_lost",
        "m",
        "largest distance to the reference after it had been within 1 cm of it",
    ),
    metric("max_repulsion", "N", "largest repulsive force on a link"),
    metric("max_repulsion_time", "s", "when it occurred"),
    metric("peak_torque", "N·m", "largest joint torque; of a joint that slides, force in N"),
    metric("peak_speed", "rad/s", "largest joint speed; in m/s of a joint that slides"),
    metric("effort", "N²·m²·s", "integral of the squared torques; in N²·s of joints that slide"),
    metric("energy", "J", "integral of the absolute mechanical power of the joints"),
    metric(
        "rms_jerk",
        "rad/s³",
        "RMS of the third derivative of the joint positions; in m/s³ where they slide",
    ),
    metric("max_null_acceleration", "m/s²", "largest ‖J M⁻¹ τ_null‖: what leaks into the task"),
    metric("passivity_residual", "J", "largest defect of the null-space energy balance"),
    metric("max_slack", "m/s²", "largest violation of a barrier, of cbf only"),
    metric("slack_steps", "", "steps with a barrier violated by more than 0.1 m/s², of cbf only"),
    metric("singular_steps", "", "steps with a damped task force near a singularity"),
    metric("min_manipulability", "m²", "smallest √det(J Jᵀ), in space in m³; 0 in a singularity"),
    metric("min_self_clearance", "m", "smallest distance of two links that share no joint"),
    metric("min_self_clearance_time", "s", "when it occurred"),
    metric("min_self_clearance_link", "", "at which link, counted from 0; none for the base"),
    metric("min_self_clearance_other", "", "and at which other one"),
    metric("self_collision_time", "s", "first contact of two such links"),
    metric("self_intrusion_time", "s", "total time with two such links inside each other"),
    metric("limited_steps", "", "steps in which limits took something from an objective"),
    metric(
        "joint_limit_violation",
        "rad",
        "largest excess over the arm's joint limits; in m of a joint that slides",
    ),
    metric("joint_limit_time", "s", "when a joint first stood at its limits or beyond"),
    metric("joint_limit_joint", "", "which joint went furthest, counted from 0"),
    metric("velocity_limit_ratio", "", "largest joint speed relative to the arm's velocity limits"),
    metric("velocity_limit_joint", "", "of which joint, counted from 0"),
    metric("torque_limit_ratio", "", "largest torque relative to the arm's torque limits"),
    metric("torque_limit_joint", "", "of which joint, counted from 0"),
    metric(
        "tip_speed_ratio",
        "",
        "largest speed of the end effector relative to command.tip_speed",
    ),
    metric("tip_angular_speed_ratio", "", "the same of how fast it turns"),
    metric("steps", "", "steps of the plant, the start among them"),
    metric("replans", "", "plans that were taken over on the way, with replan only"),
    metric(
        "times_stuck",
        "",
        "how often the arm came no nearer to the end of its plan, with replan only",
    ),
    metric("touched_time", "s", "when a contact was first felt, with detection only"),
    metric("touched_link", "", "on which link, counted from 0, or one beyond it"),
    metric("max_yielded", "m", "furthest that the end effector gave way to a push"),
    metric("stopped_time", "s", "total time for which a push stopped the task"),
    metric("released_time", "s", "total time for which look-ahead let go parts of the task"),
    metric("late_cycles", "", "control cycles that took longer than the deadline"),
    metric("cut_cycles", "", "control cycles in which look-ahead stopped for lack of time"),
    metric("rollouts_left_out", "", "roll-outs of look-ahead that were not made because of that"),
    metric(
        "points_left_out",
        "",
        "points of clouds, counted once a cycle, beyond the 64 that cbf keeps of a link",
    ),
    metric("programs_cut", "", "programs that ended with constraints left"),
];

fn norm(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum::<f64>().sqrt()
}

/// The larger of two numbers: one instruction, where `f64::max` also asks which one is NaN.
#[inline]
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// Sums and maxima over joints.
#[derive(Debug, Clone, Copy, Default)]
struct Effort {
    squares: f64,
    power: f64,
    jerk: f64,
    torque: f64,
    speed: f64,
}

impl Effort {
    #[inline(always)]
    fn take_in(&mut self, tau: f64, dq: f64, before: &mut f64, last: &mut f64) {
        self.torque = larger(self.torque, tau.abs());
        self.speed = larger(self.speed, dq.abs());
        self.squares += tau * tau;
        self.power += (tau * dq).abs();
        let curve = dq - 2.0 * *last + *before;
        self.jerk += curve * curve;
        (*before, *last) = (*last, dq);
    }
}

/// The largest value relative to its limit, and the joint that it belongs to.
#[derive(Debug, Clone, Copy, Default)]
struct Ratio {
    most: f64,
    joint: usize,
}

impl Ratio {
    #[inline(always)]
    fn take_in(&mut self, values: &[f64], limits: &[f64]) {
        for (joint, (value, limit)) in values.iter().zip(limits).enumerate() {
            let ratio = value.abs() / limit;
            if ratio > self.most {
                *self = Self { most: ratio, joint };
            }
        }
    }
}

/// Running sums of a run.
///
/// # Example
/// ```
/// use vff_core::robot::Limits;
/// use vff_core::simulation::{METRICS, Metric, Metrics, Value};
///
/// let metrics = Metrics::new(3, 1.0, 0.001, Limits::default());
/// assert_eq!(metrics.collision_time(), None);
/// let named: Vec<(&Metric, Value)> = metrics.values([None; 5], [None; 2]);
/// assert!(named.len() <= METRICS.len() && !named[0].0.meaning.is_empty());
/// ```
#[derive(Debug, Clone)]
pub struct Metrics {
    dt: f64,
    tail_start: f64,
    limits: Limits,
    samples: usize,
    tail_samples: usize,
    min_clearance: f64,
    min_clearance_time: f64,
    min_clearance_link: usize,
    /// The same without what a tip presses on \[m\].
    min_room: f64,
    collision_time: Option<f64>,
    intrusion_samples: usize,
    /// The largest depth of a link in what it is not to touch \[m\], and which link that was.
    deepest: (f64, Option<usize>),
    sum_error: [f64; 2],
    max_error: [f64; 2],
    max_orientation_error: Option<f64>,
    end_error: [Option<f64>; 2],
    /// Since the end effector was on its reference \[m\].
    max_error_lost: Option<f64>,
    settling_bound: f64,
    last_outside: Option<f64>,
    settled: bool,
    max_repulsion: f64,
    max_repulsion_time: Option<f64>,
    peak_torque: f64,
    peak_speed: f64,
    effort: f64,
    energy: f64,
    dq: [Vec<f64>; 2],
    sum_jerk: f64,
    max_null_acceleration: f64,
    storage_start: f64,
    supplied: f64,
    last_supply: f64,
    passivity_residual: f64,
    max_slack: Option<f64>,
    slack_steps: usize,
    yields: bool,
    singular_steps: usize,
    min_manipulability: f64,
    min_self_clearance: Option<f64>,
    min_self_clearance_time: f64,
    nearest_pair: [Option<usize>; 2],
    self_collision_time: Option<f64>,
    self_intrusion_samples: usize,
    limited_steps: Option<usize>,
    joint_limit_violation: f64,
    /// When a joint first stood at its limits or beyond \[s\], and the one that went furthest.
    stopped: Option<(f64, usize)>,
    velocity_limit_ratio: Ratio,
    torque_limit_ratio: Ratio,
    tip_shares: [Option<f64>; 2],
    replans: Option<ReplanCounts>,
    /// When a contact was first felt \[s\], and on which link.
    touched: Option<(f64, usize)>,
    max_yielded: Option<f64>,
    stopped_samples: Option<usize>,
    released_samples: Option<usize>,
}

impl Metrics {
    /// For a run of `n` joints over `duration` \[s\] in steps of `dt` \[s\].
    pub fn new(n: usize, duration: f64, dt: f64, limits: Limits) -> Self {
        Self {
            dt,
            tail_start: 0.8 * duration,
            limits,
            samples: 0,
            tail_samples: 0,
            min_clearance: f64::INFINITY,
            min_clearance_time: 0.0,
            min_clearance_link: 0,
            min_room: f64::INFINITY,
            collision_time: None,
            intrusion_samples: 0,
            deepest: (0.0, None),
            sum_error: [0.0; 2],
            max_error: [0.0; 2],
            max_orientation_error: None,
            end_error: [None; 2],
            max_error_lost: None,
            settling_bound: 0.0,
            last_outside: None,
            settled: false,
            max_repulsion: 0.0,
            max_repulsion_time: None,
            peak_torque: 0.0,
            peak_speed: 0.0,
            effort: 0.0,
            energy: 0.0,
            dq: [vec![0.0; n], vec![0.0; n]],
            sum_jerk: 0.0,
            max_null_acceleration: 0.0,
            storage_start: 0.0,
            supplied: 0.0,
            last_supply: 0.0,
            passivity_residual: 0.0,
            max_slack: None,
            slack_steps: 0,
            yields: false,
            singular_steps: 0,
            min_manipulability: f64::INFINITY,
            min_self_clearance: None,
            min_self_clearance_time: 0.0,
            nearest_pair: [None; 2],
            self_collision_time: None,
            self_intrusion_samples: 0,
            limited_steps: None,
            joint_limit_violation: 0.0,
            stopped: None,
            velocity_limit_ratio: Ratio::default(),
            torque_limit_ratio: Ratio::default(),
            tip_shares: [None; 2],
            replans: None,
            touched: None,
            max_yielded: None,
            stopped_samples: None,
            released_samples: None,
        }
    }

    /// Whether a link has touched an obstacle so far.
    pub fn collision_time(&self) -> Option<f64> {
        self.collision_time
    }

    /// Smallest clearance so far \[m\], and the link it belongs to.
    pub fn min_clearance(&self) -> (f64, usize) {
        (self.min_clearance, self.min_clearance_link)
    }

    /// Smallest clearance so far without what a tip presses on \[m\].
    pub fn min_room(&self) -> f64 {
        self.min_room
    }

    /// Takes in the instant of one plant step.
    pub fn update(&mut self, s: &Snapshot<'_>) {
        self.clearance(s);
        self.tracking(s);
        self.effort(s);
        self.null_space(s);
        self.replans = s.replans;
        for (most, share) in self.tip_shares.iter_mut().zip(s.tip_shares) {
            if let Some(share) = share {
                *most = Some(larger(most.unwrap_or(0.0), share));
            }
        }
        if let Some(link) = s.touched_link.filter(|link| *link < s.q.len()) {
            self.touched.get_or_insert((s.t, link));
        }
        if let Some(yielded) = s.yielded {
            self.max_yielded = Some(larger(self.max_yielded.unwrap_or(0.0), yielded));
        }
        if let Some(released) = s.released {
            *self.released_samples.get_or_insert(0) += usize::from(released > 0);
        }
        if let Some(is_stopped) = s.is_stopped {
            *self.stopped_samples.get_or_insert(0) += usize::from(is_stopped);
        }
        self.samples += 1;
    }

    fn clearance(&mut self, s: &Snapshot<'_>) {
        let nearer = |least: f64, d: &f64| if *d < least { *d } else { least };
        let least = s.clearance.iter().fold(f64::INFINITY, nearer);
        if least < self.min_clearance {
            let link = s.clearance.iter().position(|distance| *distance <= least);
            self.min_clearance = least;
            self.min_clearance_time = s.t;
            self.min_clearance_link = link.unwrap_or(0);
        }
        if s.unpressed.is_some() {
            self.min_room = s.room().fold(self.min_room, |least, d| nearer(least, &d));
        } else {
            self.min_room = nearer(self.min_room, &least);
        }
        if least < 0.0 && s.collides() {
            self.collision_time.get_or_insert(s.t);
            self.intrusion_samples += 1;
            for (link, room) in s.room().enumerate() {
                if -room > self.deepest.0 {
                    self.deepest = (-room, Some(link));
                }
            }
        }
        if let Some(distance) = s.self_clearance {
            let least = self.min_self_clearance.get_or_insert(f64::INFINITY);
            if distance < *least {
                *least = distance;
                (self.min_self_clearance_time, self.nearest_pair) = (s.t, s.nearest_pair);
            }
            if distance <= 0.0 {
                self.self_collision_time.get_or_insert(s.t);
                self.self_intrusion_samples += 1;
            }
        }
        let force = s.force.iter().fold(0.0, |most, force| larger(most, *force));
        if force > self.max_repulsion {
            self.max_repulsion = force;
            self.max_repulsion_time = Some(s.t);
        }
    }

    fn tracking(&mut self, s: &Snapshot<'_>) {
        let (position, orientation) = s.error.split_at(s.dimension);
        let error = norm(position);
        let tail = usize::from(s.t >= self.tail_start);
        self.tail_samples += tail;
        self.sum_error[tail] += error * error;
        self.max_error[tail] = larger(self.max_error[tail], error);
        if !orientation.is_empty() && tail == 1 {
            let worst = self.max_orientation_error.get_or_insert(0.0);
            *worst = worst.max(norm(orientation));
        }
        self.end_error = [Some(error), (!orientation.is_empty()).then(|| norm(orientation))];
        if self.samples == 0 {
            self.settling_bound = (0.02 * error).max(1e-3);
        }
        if error <= REACHED || self.max_error_lost.is_some() {
            let worst = self.max_error_lost.get_or_insert(0.0);
            *worst = larger(*worst, error);
        }
        self.settled = error <= self.settling_bound;
        if !self.settled {
            self.last_outside = Some(s.t);
        }
    }

    fn effort(&mut self, s: &Snapshot<'_>) {
        // Sums of Σ τ², Σ |τ q̇| and Σ (dt² jerk)², scaled once a step and once a run; two joints side
        // by side.
        let [before, last] = &mut self.dq;
        let (tau, dq) = (s.torque.total.as_chunks::<2>(), s.dq.as_chunks::<2>());
        let (before, last) = (before.as_chunks_mut::<2>(), last.as_chunks_mut::<2>());
        let mut sums = [Effort::default(); 2];
        let speeds = dq.0.iter().zip(before.0.iter_mut().zip(last.0));
        for (tau, (dq, (before, last))) in tau.0.iter().zip(speeds) {
            for k in 0..2 {
                sums[k].take_in(tau[k], dq[k], &mut before[k], &mut last[k]);
            }
        }
        let speeds = dq.1.iter().zip(before.1.iter_mut().zip(last.1));
        for (tau, (dq, (before, last))) in tau.1.iter().zip(speeds) {
            sums[0].take_in(*tau, *dq, before, last);
        }
        let [a, b] = sums;
        let (squares, power, jerk) = (a.squares + b.squares, a.power + b.power, a.jerk + b.jerk);
        self.peak_torque = larger(self.peak_torque, larger(a.torque, b.torque));
        self.peak_speed = larger(self.peak_speed, larger(a.speed, b.speed));
        self.effort += squares * self.dt;
        self.energy += power * self.dt;
        if self.samples >= 2 {
            self.sum_jerk += jerk;
        }
        for (i, (q, [lower, upper])) in s.q.iter().zip(&self.limits.joint).enumerate() {
            let excess = larger(lower - q, q - upper);
            if excess >= 0.0 {
                let (_, furthest) = self.stopped.get_or_insert((s.t, i));
                if excess > self.joint_limit_violation {
                    (self.joint_limit_violation, *furthest) = (excess, i);
                }
            }
        }
        self.velocity_limit_ratio.take_in(s.dq, &self.limits.velocity);
        self.torque_limit_ratio.take_in(&s.torque.total, &self.limits.torque);
    }

    /// The balance of T17.
    fn null_space(&mut self, s: &Snapshot<'_>) {
        self.max_null_acceleration = larger(self.max_null_acceleration, s.null_acceleration);
        self.singular_steps += usize::from(s.singular);
        self.min_manipulability = self.min_manipulability.min(s.manipulability);
        if let Some(slack) = s.slack {
            self.max_slack = Some(self.max_slack.unwrap_or(0.0).max(slack));
            self.slack_steps += usize::from(slack > 0.1);
        }
        self.yields = s.yields;
        if let Some(objective_scale) = s.objective_scale {
            let limited = objective_scale.iter().any(|share| *share < 1.0);
            *self.limited_steps.get_or_insert(0) += usize::from(limited);
        }
        let (storage, supply) = (s.energy.null_storage, s.power.into_null_space());
        if self.samples == 0 {
            self.storage_start = storage;
        } else {
            self.supplied += 0.5 * self.dt * (self.last_supply + supply);
        }
        self.last_supply = supply;
        let defect = (storage - self.storage_start - self.supplied).abs();
        self.passivity_residual = larger(self.passivity_residual, defect);
    }

    /// The values, in the order of [`METRICS`], with what was [left out](super::ClosedLoop::left_out), and what is left of the
    /// [reference](super::ClosedLoop::left_of_reference).
    pub fn values(
        &self,
        left_out: [Option<u64>; 5],
        end_times: [Option<f64>; 2],
    ) -> Vec<(&'static Metric, Value)> {
        // What has left the range of numbers is none: a run may end while its sums overflow.
        let number =
            |value: f64| if value.is_finite() { Value::Number(value) } else { Value::None };
        #[expect(clippy::cast_precision_loss, reason = "counts of steps")]
        let rms = |sum: f64, count: usize| match count {
            0 => Value::None,
            count => number((sum / count as f64).sqrt()),
        };
        let optional = |value: Option<f64>| value.map_or(Value::None, number);
        let given = |applies: bool, value| if applies { number(value) } else { Value::None };
        let [transient, tail] = [self.samples - self.tail_samples, self.tail_samples];
        let seen = self.min_clearance < f64::INFINITY;
        let when_seen = |value| if seen { value } else { Value::None };
        #[expect(clippy::cast_precision_loss, reason = "counts of steps")]
        let time = |samples: usize| number(samples as f64 * self.dt);
        let count = |value: Option<usize>| value.map_or(Value::None, Value::Count);
        let own = self.min_self_clearance.filter(|d| *d < f64::INFINITY);
        let settling = match (self.settled, self.last_outside) {
            (false, _) => Value::None,
            (true, None) => number(0.0),
            (true, Some(t)) => number(t + self.dt),
        };
        let jerks = self.samples.saturating_sub(2) * self.dq[0].len();
        let values = [
            when_seen(number(self.min_clearance)),
            when_seen(number(self.min_clearance_time)),
            when_seen(Value::Count(self.min_clearance_link)),
            optional(self.collision_time),
            time(self.intrusion_samples),
            number(self.deepest.0),
            count(self.deepest.1),
            number(self.tail_start),
            rms(self.sum_error[0], transient),
            given(transient > 0, self.max_error[0]),
            rms(self.sum_error[1], tail),
            given(tail > 0, self.max_error[1]),
            optional(self.max_orientation_error),
            optional(self.end_error[0]),
            optional(self.end_error[1]),
            optional(end_times[0]),
            optional(end_times[1]),
            settling,
            optional(self.max_error_lost),
            number(self.max_repulsion),
            optional(self.max_repulsion_time),
            number(self.peak_torque),
            number(self.peak_speed),
            number(self.effort),
            number(self.energy),
            rms(self.sum_jerk / self.dt.powi(4), jerks),
            number(self.max_null_acceleration),
            // The balance is that of the null-space law.
            given(!self.yields, self.passivity_residual),
            optional(self.max_slack),
            count(self.max_slack.map(|_| self.slack_steps)),
            Value::Count(self.singular_steps),
            number(self.min_manipulability),
            optional(own),
            own.map_or(Value::None, |_| number(self.min_self_clearance_time)),
            count(self.nearest_pair[0]),
            count(self.nearest_pair[1]),
            optional(self.self_collision_time),
            own.map_or(Value::None, |_| time(self.self_intrusion_samples)),
            count(self.limited_steps),
            given(!self.limits.joint.is_empty(), self.joint_limit_violation),
            optional(self.stopped.map(|(t, _)| t)),
            count(self.stopped.map(|(_, joint)| joint)),
            given(!self.limits.velocity.is_empty(), self.velocity_limit_ratio.most),
            count((!self.limits.velocity.is_empty()).then_some(self.velocity_limit_ratio.joint)),
            given(!self.limits.torque.is_empty(), self.torque_limit_ratio.most),
            count((!self.limits.torque.is_empty()).then_some(self.torque_limit_ratio.joint)),
            optional(self.tip_shares[0]),
            optional(self.tip_shares[1]),
            Value::Count(self.samples),
            count(self.replans.map(|counts| counts.taken)),
            count(self.replans.map(|counts| counts.stuck)),
            optional(self.touched.map(|(t, _)| t)),
            count(self.touched.map(|(_, link)| link)),
            optional(self.max_yielded),
            self.stopped_samples.map_or(Value::None, time),
            self.released_samples.map_or(Value::None, time),
        ];
        let whole = |count: u64| usize::try_from(count).unwrap_or(usize::MAX);
        let left_out = left_out.map(|counted| count(counted.map(whole)));
        debug_assert_eq!(values.len() + left_out.len(), METRICS.len());
        METRICS.iter().zip(values.into_iter().chain(left_out)).collect()
    }
}
