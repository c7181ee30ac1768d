//! `cbf`: of all accelerations that keep every distance and every limit, the nearest to that of the
//! null-space law (T67–T70).
//!
//! ```text
//! min ½(ẍ − ẍ₀)ᵀW_x(ẍ − ẍ₀) + ½(ν̇ − ν̇₀)ᵀΛ_n(ν̇ − ν̇₀) + ½ρ‖δ‖²
//! so that d̈ + 2kḋ + k²(d − margin) ≥ −δ for every pair, and the same for angles and speeds of the joints,
//!         −τ_max ≤ Mq̈ + Cq̇ + g ≤ τ_max
//! ```
//!
//! Behind a limit of the torque rate the last constraint says what may be sent next, and the others what must be begun now
//! (T130–T132). The same keeps the limits of the other ways of giving way: with the pairs of `priority`, which limits spare, and
//! without pairs for those that have none. How fast the tip moves and turns is
//! kept like the speed of a joint (T114).

#[cfg(test)]
mod by_clarabel;
mod tip;

use super::joint_bounds::{Acting, JointBounds};
use super::margins::Margins;
use super::order::Order;
use crate::control::deadline::LeftOut;
use crate::control::distance::{DistanceRate, OwnPair};
use crate::control::quadratic_program::{Outcome, Problem, QuadraticProgram};
use crate::control::settings::Yielding;
use crate::control::{
    CommandSettings, Gains, Gravity, MotionLimits, OperationalSpace, TaskMetric, Torque,
    TorqueRange,
};
use crate::interrupt;
use crate::math::{Vector, dot};
use crate::robot::Robot;
use crate::world::{Contact, Outlook, Rates};
use nalgebra::SMatrix;
use std::cell::Cell;
use tip::{CUTS, Plane, Toward};

/// k where it is not given \[1/s\].
pub const RATE: f64 = 40.0;

/// k \[1/s\].
pub fn rate(settings: &Yielding) -> f64 {
    settings.rate.unwrap_or(RATE)
}

/// Bodies of the arm that are farther apart \[m\] cannot touch within a few 1/k.
pub const OWN_REACH: f64 = 0.3;

/// What holds where nothing is given.
struct Usual {
    /// W_x \[kg\].
    task_weight: f64,
    /// ρ: a constraint that costs as much as the task is violated by a 2000th.
    slack_weight: f64,
    /// \[m\].
    activation: f64,
}

/// In a space of dimension `D`: arms in space are heavier and smaller, and leave less of a null space.
fn usual<const D: usize>() -> Usual {
    if D > 2 {
        Usual { task_weight: 300.0, slack_weight: 6e5, activation: 0.4 }
    } else {
        Usual { task_weight: 20.0, slack_weight: 4e4, activation: 1.2 }
    }
}

/// How much more a joint's angle and speed weigh than a distance where there is no room for all: a robot ends a motion
/// beyond them.
const JOINTS: f64 = 100.0;

/// How far the motion keeps from its limits.
#[derive(Debug, Clone, Copy)]
struct Reserve {
    /// Of a joint from its stops \[rad, m\].
    angle: f64,
    /// Shares of the largest speeds of a joint and of the tip that are kept.
    joint: f64,
    tip: f64,
}

impl Reserve {
    /// A joint that meets its stop throws all others.
    const USUAL: Self = Self { angle: 0.002, joint: 1.0, tip: 1.0 };
    /// The torque rate couples the braking of a joint to that of others.
    const BEHIND_A_RATE: Self = Self { angle: 0.01, joint: 0.98, tip: 0.98 };
    /// A robot ends a motion that comes to a limit: what it measures is noisy.
    const BEFORE_A_ROBOT: Self = Self { angle: 0.01, joint: 0.95, tip: 0.85 };
    /// What the arm carries is not known, so that an acceleration is off by what the observer does not know yet.
    const WITH_A_LOAD: Self = Self { angle: 0.03, joint: 0.9, tip: 0.8 };

    fn of(command: &CommandSettings, is_observed: bool) -> Self {
        match (command.gravity, &command.torque_rate) {
            (Gravity::Controller, None) => Self::USUAL,
            _ if is_observed => Self::WITH_A_LOAD,
            (Gravity::Robot, _) => Self::BEFORE_A_ROBOT,
            (Gravity::Controller, Some(_)) => Self::BEHIND_A_RATE,
        }
    }
}

/// Shares of the largest speeds of joints and of the tip that a law keeps, so that a plan asks for no more.
pub fn speed_shares(command: &CommandSettings, is_observed: bool) -> [f64; 2] {
    let Reserve { joint, tip, .. } = Reserve::of(command, is_observed);
    [joint, tip]
}

/// How near pairs are constraints of the QP \[m\] in a space of dimension `D`.
pub fn activation<const D: usize>(settings: &Yielding) -> f64 {
    settings.activation.unwrap_or(usual::<D>().activation)
}

/// ρ in a space of dimension `D`.
pub fn slack_weight<const D: usize>(settings: &Yielding) -> f64 {
    settings.slack_weight.unwrap_or(usual::<D>().slack_weight)
}

/// w_x \[kg\] in a space of dimension `D`.
pub fn task_weight<const D: usize>(settings: &Yielding) -> f64 {
    settings.task_weight.unwrap_or(usual::<D>().task_weight)
}

/// W_x = `task_weight` S², in the order in which the task gives way (T69, T193).
#[derive(Debug, Clone)]
pub(super) struct TaskWeight<const M: usize> {
    plain: SMatrix<f64, M, M>,
    order: Order,
}

impl<const M: usize> TaskWeight<M> {
    /// In a space of dimension `D`.
    pub fn new<const D: usize>(settings: &Yielding, metric: &TaskMetric<M>) -> Self {
        let plain = metric.weight() * task_weight::<D>(settings);
        Self { plain, order: Order::of::<D, M>(settings) }
    }

    /// Where the tool is.
    pub fn at<R: Robot<D>, const D: usize>(&self, robot: &R) -> SMatrix<f64, M, M> {
        if self.order.count() > 1 { self.order.weigh(robot, &self.plain) } else { self.plain }
    }
}

/// Distances that the QP has room for where they are violated at one instant: the most violated ones. Joints and tip have their own.
const MAX_VIOLATED: usize = 48;

/// Workspace of the law. The unknown is y = q̈ − q̈₀, so that a constraint is violated at y = 0 only if its bound is
/// positive, and most instants need no QP at all.
#[derive(Debug, Clone)]
pub(crate) struct Barrier {
    program: QuadraticProgram,
    nominal: Vec<f64>,
    /// q̈ at present, behind a limit of the torque rate.
    present: Vec<f64>,
    /// M, row by row.
    mass: Vec<f64>,
    hessian: Vec<f64>,
    gradient: Vec<f64>,
    scratch: Vec<f64>,
    normals: Vec<f64>,
    bounds: Vec<f64>,
    /// What each distance asks for in parts of what (T67) would, behind a limit of the torque rate (T161).
    shares: Vec<f64>,
    softness: Vec<f64>,
    /// What every joint can be sent \[N·m, N\]; empty if anything.
    ends: Vec<[f64; 2]>,
    joints: JointBounds,
    /// Largest speed of the tip \[m/s\], and how fast it may turn \[rad/s\]; infinite where nothing is said.
    tip: [f64; 2],
    /// The share of that which is kept.
    tip_share: f64,
    /// What keeps the tip.
    planes: Vec<Plane>,
    /// w_ω of (T198) at present \[kg·m²\].
    turning_weight: f64,
    /// See [`Yielding`].
    rate: f64,
    /// Whether distances ask for no more than the torque gives them already.
    defers: bool,
    /// The most that joints can keep that are moved by other means than a torque, before what moves and, without a plan, all else (T201).
    most_rate: f64,
    /// What moves the joints, where that is no torque.
    moved: Option<MotionLimits>,
    slack_weight: f64,
    /// What is kept of distances.
    pub(super) margins: Margins,
    /// Points of clouds, and programs that ended with constraints left.
    pub(super) left_out: LeftOut,
}

/// What is to be kept.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kept<'a, const D: usize> {
    /// The distances from obstacles.
    pub pairs: &'a [Contact<D>],
    /// The distances of the bodies from each other.
    pub own: &'a [OwnPair<D>],
    /// What the drives accept next, behind a limit of the torque rate.
    pub range: Option<&'a TorqueRange>,
    /// Between which the torque of the law may be without one \[N·m, N\].
    pub ends: &'a [[f64; 2]],
}

impl Barrier {
    /// For the joints of `robot`.
    pub fn new<R: Robot<D>, const D: usize, const M: usize>(robot: &R, gains: &Gains<M>) -> Self {
        let settings = &gains.yielding;
        let CommandSettings { tip_speed, tip_angular_speed, .. } = gains.command;
        let n = robot.dof();
        let reserve = Reserve::of(&gains.command, gains.observer.is_some());
        let zeros = |count: usize| vec![0.0; count];
        let mut this = Self {
            program: QuadraticProgram::sparing(
                n,
                0,
                [MAX_VIOLATED + 2 * n + 2 * (1 + CUTS), MAX_VIOLATED],
            ),
            nominal: zeros(n),
            present: zeros(n),
            mass: zeros(n * n),
            hessian: zeros(n * n),
            gradient: zeros(n),
            scratch: zeros(n),
            normals: vec![],
            bounds: vec![],
            shares: vec![],
            softness: vec![],
            ends: Vec::with_capacity(n),
            joints: JointBounds::new(robot, gains, [reserve.angle, reserve.joint]),
            tip: [tip_speed, tip_angular_speed].map(|most| most.unwrap_or(f64::INFINITY)),
            tip_share: reserve.tip,
            planes: vec![],
            turning_weight: 0.0,
            rate: rate(settings),
            defers: false,
            // No faster than joints can that are moved within limits of their own (T201).
            most_rate: gains.moved.as_ref().map_or(f64::INFINITY, MotionLimits::barrier_rate),
            moved: None,
            margins: Margins::new(n, settings),
            slack_weight: slack_weight::<D>(settings),
            left_out: LeftOut::default(),
        };
        this.reserve(0);
        this
    }

    /// Lets distances ask for no more than the torque gives them already, so that nothing jumps where this begins to act.
    pub fn deferring(self) -> Self {
        Self { defers: true, ..self }
    }

    /// Leaves the speeds of an arm without velocity limits alone.
    pub fn without_speeds(mut self) -> Self {
        self.joints.leave_speeds();
        self
    }

    /// Keeps distances as a way does that reacts with `rate` \[1/s\].
    pub fn reacting_with(mut self, rate: f64) -> Self {
        self.rate = rate;
        self
    }

    /// For joints that are moved within limits of their own, if these are, whatever the torque (T201).
    pub fn moved_as<const M: usize>(mut self, gains: &Gains<M>) -> Self {
        self.moved.clone_from(&gains.moved);
        if let Some(moved) = &self.moved {
            self.joints.move_within(moved);
        }
        self
    }

    /// Of the joints keeps what would be too fast or come to a stop.
    pub fn guarding(mut self) -> Self {
        self.joints.guard();
        self
    }

    /// Whether no joint is guarded at this torque \[N·m, N\].
    pub fn is_calm<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        torque: &[f64],
        bias: &[f64],
    ) -> bool {
        let Self { joints, nominal, scratch, hessian, .. } = self;
        robot.accelerate(torque, bias, scratch, nominal);
        joints.is_calm(robot, nominal, bias, [&mut hessian[..nominal.len()], scratch])
    }

    /// Room for this many pairs.
    pub fn reserve(&mut self, pairs: usize) {
        let n = self.nominal.len();
        let constraints = pairs + 4 * n + 2 * (1 + CUTS);
        self.normals.clear();
        self.bounds.clear();
        self.shares.clear();
        self.softness.clear();
        self.shares.reserve(pairs);
        self.normals.reserve(constraints * n);
        self.bounds.reserve(constraints);
        self.softness.reserve(constraints);
        self.program.reserve(constraints);
        self.ends.clear();
        self.ends.reserve(n);
        self.planes.clear();
        self.planes.reserve(2 * (1 + CUTS));
    }

    /// The rates k with which distances are kept \[1/s\].
    fn rates(&self) -> Rates {
        let moving = self.rate.min(self.most_rate);
        Rates { resting: moving + self.margins.by_plan() * (self.rate - moving), moving }
    }

    /// What it reckons with where points of links move at this velocity, and where points that are left out are counted.
    pub fn outlook<'a, const D: usize>(
        &self,
        velocity: &'a dyn Fn(usize, &Vector<D>) -> Vector<D>,
        coarsened: &'a Cell<u64>,
    ) -> Outlook<'a, D> {
        let rates = self.rates();
        Outlook { rates, kept: self.margins.most(rates.moving), velocity, coarsened }
    }

    /// Adds M y to the torque and returns the largest δ of a pair \[m/s²\].
    pub fn act<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        weight: &SMatrix<f64, M, M>,
        kept: Kept<'_, D>,
        bias: &[f64],
        torque: &mut Torque,
    ) -> f64 {
        robot.accelerate(&torque.total, bias, &mut self.scratch, &mut self.nominal);
        self.damp_what_is_missing(robot, torque);
        self.normals.clear();
        self.bounds.clear();
        self.shares.clear();
        self.softness.clear();
        if let Some(range) = kept.range {
            robot.accelerate(&range.present, bias, &mut self.scratch, &mut self.present);
            self.find_masses(robot);
        }
        self.keep_distances(robot, kept);
        self.keep_joints(robot, bias, kept.range);
        self.planes.clear();
        self.keep_tip(robot, Toward::Desired(kept.range));
        self.soften();
        self.ends.clear();
        match kept.range {
            None => self.ends.extend_from_slice(kept.ends),
            Some(TorqueRange { lower, upper, .. }) => {
                self.ends.extend(lower.iter().zip(upper).map(|(lower, upper)| [*lower, *upper]));
            }
        }
        let inside = |(tau, [lower, upper]): (&f64, &[f64; 2])| (*lower..=*upper).contains(tau);
        if torque.total.iter().zip(&self.ends).all(inside)
            && self.bounds.iter().all(|bound| *bound <= 0.0)
        {
            return 0.0;
        }
        if kept.range.is_none() {
            self.find_masses(robot);
        }
        // Damped, or the smallest of motions would cost next to nothing close to a singularity, and rounding decide (T25).
        let difference = weight - space.lambda_damped;
        self.weigh(&difference, robot);
        self.gradient.fill(0.0);
        self.keep_torques(&torque.total);
        let mut outcome = self.solve();
        for _ in 0..CUTS {
            if self.planes.is_empty() || !matches!(outcome, Outcome::Solved | Outcome::Crowded) {
                break;
            }
            self.weigh(&difference, robot);
            self.gradient.fill(0.0);
            if !self.keep_tip(robot, Toward::Found(kept.range)) {
                break;
            }
            outcome = self.solve();
        }
        self.left_out.programs +=
            u64::from(matches!(outcome, Outcome::Unfinished | Outcome::Crowded));
        let y = self.program.x();
        let n = y.len();
        if outcome != Outcome::NotConvex {
            torque.add_to_task(|i| dot(&self.mass[i * n..(i + 1) * n], y));
        }
        if outcome != Outcome::Solved {
            torque.cut_to(&self.ends);
        }
        if outcome == Outcome::NotConvex {
            return 0.0; // The state is not finite: the run ends here.
        }
        let missing = |((a, bound), share): ((&[f64], &f64), &f64)| (bound - dot(a, y)) / share;
        let constraints = self.normals.chunks_exact(n).zip(&self.bounds).zip(&self.shares);
        constraints.map(missing).fold(0.0, f64::max)
    }

    /// What joints cannot do of what the law wants is made up for by damping, where they are moved by other means than a torque: a law that
    /// does not get what it wants would swing. Along a plan, which is a way of the joints, all of it becomes less alike; else what the
    /// program leaves of it is that of the task.
    fn damp_what_is_missing<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        torque: &mut Torque,
    ) {
        let Self { moved: Some(moved), nominal, scratch, gradient, margins, .. } = self else {
            return;
        };
        let [share, brake] = moved.share(nominal, robot.velocity());
        let left_out = margins.by_plan() * (1.0 - share);
        if brake > 0.0 {
            for ((ddq, dq), less) in nominal.iter_mut().zip(robot.velocity()).zip(&mut *scratch) {
                *less = -left_out * *ddq - brake * dq;
                *ddq += *less;
            }
            robot.mass_mul(scratch, gradient);
            torque.add_to_task(|i| gradient[i]);
        }
    }

    fn solve(&mut self) -> Outcome {
        self.program.solve(&Problem {
            hessian: &self.hessian,
            gradient: &self.gradient,
            normals: &self.normals,
            bounds: &self.bounds,
            softness: &self.softness,
            spared: self.shares.len(),
        })
    }

    /// How soft each constraint is: 1/ρ for a distance, and for joints and the tip a hundredth of what all distances that pull have
    /// together; less behind a limit of the torque rate (T161).
    fn soften(&mut self) {
        let Self { softness, shares, bounds, slack_weight, .. } = self;
        let least = shares.iter().fold(1.0, |least: f64, share| least.min(*share));
        softness.extend(shares.iter().map(|share| share.sqrt() / *slack_weight));
        // How many distances pull, all of one body alike or one alone.
        let asked = bounds[..shares.len()].iter().map(|bound| bound.max(0.0));
        let most = asked.clone().fold(0.0, f64::max);
        let crowd = if most > 0.0 { asked.sum::<f64>() / most } else { 1.0 };
        softness.resize(bounds.len(), least / *slack_weight / (JOINTS * crowd));
    }

    /// Every distance, with the exact d̈ (T60).
    fn keep_distances<R: Robot<D>, const D: usize>(&mut self, robot: &R, kept: Kept<'_, D>) {
        let rates = self.rates();
        for pair in kept.pairs {
            let motion = DistanceRate::cautious(robot, pair);
            let (height, motion) = self.margins.above(pair, motion);
            let k = rates.beside(pair.velocity.norm());
            self.keep_distance(robot, k, height, motion, kept.range, |normal, _| {
                robot.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, normal);
            });
        }
        for pair in kept.own {
            let height = pair.nearest.distance - self.margins.own();
            let motion = pair.cautious(robot);
            let k = rates.resting;
            self.keep_distance(robot, k, height, motion, kept.range, |normal, scratch| {
                pair.gradient(robot, normal, scratch);
            });
        }
    }

    /// The constraint of a distance that is so much above what is to be kept \[m\]: d̈ + 2kḋ + k²(d − margin) ≥ −δ (T67), or behind a
    /// limit of the torque rate what must be begun now (T131).
    #[inline]
    fn keep_distance<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        k: f64,
        height: f64,
        motion: DistanceRate,
        range: Option<&TorqueRange>,
        gradient: impl FnOnce(&mut [f64], &mut [f64]),
    ) {
        let Self { nominal, present, normals, bounds, shares, scratch, defers, .. } = self;
        interrupt::checkpoint(64 + nominal.len());
        let start = normals.len();
        normals.resize(start + nominal.len(), 0.0);
        let normal = &mut normals[start..];
        gradient(normal, scratch);
        let asked = dot(normal, nominal) + motion.bias;
        let [bound, share] = match range {
            None => [-(asked + 2.0 * k * motion.rate + k * k * height), 1.0],
            Some(range) => {
                interrupt::checkpoint(7 * nominal.len());
                let now = [height, motion.rate, dot(normal, present) + motion.bias];
                let [least, share] =
                    range.least_distance_acceleration(robot, now, normal, scratch, k);
                [least - asked, share]
            }
        };
        bounds.push(if *defers { bound.min(0.0) } else { bound });
        shares.push(share);
    }

    /// The angles and the speeds of all joints: a constraint for each side of each.
    fn keep_joints<R: Robot<D>, const D: usize>(
        &mut self,
        robot: &R,
        bias: &[f64],
        range: Option<&TorqueRange>,
    ) {
        let Self { joints, nominal, present, normals, bounds, scratch, hessian, mass, .. } = self;
        let n = nominal.len();
        if let Some(range) = range {
            joints.brake_together(range, mass);
        }
        let acting = Acting { bias, range: range.map(|range| (range, present.as_slice())) };
        for i in 0..n {
            interrupt::checkpoint(2 * n);
            let work = [&mut hessian[..n], &mut scratch[..]];
            let [lower, upper] = joints.accelerations(robot, i, &acting, work);
            for (sign, bound) in [(1.0, lower - nominal[i]), (-1.0, nominal[i] - upper)] {
                let start = normals.len();
                normals.resize(start + n, 0.0);
                normals[start + i] = sign;
                bounds.push(bound);
            }
        }
    }

    /// M, row by row.
    fn find_masses<R: Robot<D>, const D: usize>(&mut self, robot: &R) {
        let n = self.nominal.len();
        self.scratch.fill(0.0);
        for i in 0..n {
            interrupt::checkpoint(8 * n);
            self.scratch[i] = 1.0;
            robot.mass_mul(&self.scratch, &mut self.mass[i * n..(i + 1) * n]);
            self.scratch[i] = 0.0;
        }
    }

    /// H = JᵀW_xJ + NᵀMN = M + Jᵀ(W_x − Λ)J (T69); `difference` is W_x − Λ, close to a singularity with the damped Λ.
    fn weigh<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        difference: &SMatrix<f64, M, M>,
        robot: &R,
    ) {
        let n = self.nominal.len();
        for i in 0..n {
            interrupt::checkpoint(8 * n);
            let row = i * n..(i + 1) * n;
            let weighted = difference * robot.jacobian_column::<M>(i);
            let (hessian, mass) = (&mut self.hessian[row.clone()], &self.mass[row]);
            for k in 0..=i {
                hessian[k] = mass[k] + robot.jacobian_column::<M>(k).dot(&weighted);
            }
        }
        if D == 3 && M < 6 && self.turning_weight > 0.0 {
            self.weigh_turning(robot);
        }
    }

    /// lower ≤ τ₀ + M y ≤ upper (T70): hard constraints, which never contradict each other because M is regular.
    fn keep_torques(&mut self, nominal: &[f64]) {
        let n = self.nominal.len();
        for (i, ([lower, upper], tau)) in self.ends.iter().zip(nominal).enumerate() {
            let row = &self.mass[i * n..(i + 1) * n];
            self.normals.extend_from_slice(row);
            self.normals.extend(row.iter().map(|m| -m));
            self.bounds.extend([lower - tau, tau - upper]);
            self.softness.extend([0.0, 0.0]);
        }
    }
}
