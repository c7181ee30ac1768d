//! How fast a curve can be followed: the largest speed along it with which every joint keeps its limits of speed,
//! acceleration and torque, by reachability from the end and then greedily from the start (TOPP-RA, Pham and Pham,
//! 2018); made smooth in time (T120).
//!
//! Along a curve q(u), q̇ = q′u̇ and q̈ = q′ü + q″u̇², so that every limit is linear in ü and x = u̇².

use super::curve::Curve;
use super::why::Heavy;
use crate::interrupt;
use crate::math::memory;
use crate::robot::Robot;

/// Points of the grid per span of the curve, and the fewest.
const GRID: f64 = 6.0;
const FEWEST: f64 = 120.0;
/// Halvings in the search for the largest speed.
const HALVINGS: usize = 48;
/// The largest squared speed along the curve that is looked for in so many halvings \[1/s²\].
const MOST: f64 = 1e6;
/// Width of the two means that make the time law smooth, and the most for the sake of jerks \[s\].
const SMOOTH: [f64; 2] = [0.06, 0.5];
/// How fine the time law is \[s\].
const TICK: f64 = 2e-3;
/// The longest motion \[s\]: ticks, knots and checks are as many as it is long.
pub const LONGEST: f64 = 3600.0;

/// What the joints may do.
#[derive(Debug, Clone, PartialEq)]
pub struct Bounds {
    /// Speeds \[rad/s, m/s\].
    pub speed: Vec<f64>,
    /// Accelerations \[rad/s², m/s²\].
    pub acceleration: Vec<f64>,
    /// How fast these change \[rad/s³, m/s³\]: as far as a longer time to smooth them does it, and then the curve is followed more slowly
    /// throughout. Empty for any.
    pub jerk: Vec<f64>,
    /// Torques and forces, gravity included \[N·m, N\]; empty for any.
    pub torque: Vec<f64>,
    /// How fast these change \[N·m/s, N/s\], as far as they are sent: the curve is followed more slowly throughout. Empty for any.
    pub rate: Vec<f64>,
    /// How fast the end effector goes \[m/s\], and turns \[rad/s\].
    pub tip: [f64; 2],
}

impl Bounds {
    /// Over what time speeds are made smooth \[s\]: an acceleration that turns round at once does so in that time.
    fn smooth(&self) -> f64 {
        let turns = self.acceleration.iter().zip(&self.jerk).map(|(a, jerk)| 2.0 * a / jerk);
        turns.fold(SMOOTH[0], f64::max).min(SMOOTH[1])
    }
}

/// Why a curve cannot be followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stop {
    /// The arm cannot hold itself somewhere on it, by this joint.
    Heavy(Heavy),
    /// It takes so long \[s\], more than [`LONGEST`].
    Slow(f64),
    /// It is too long and winding to be looked at as finely as it has to be.
    Winding,
}

/// A limit |along ü + bend x + rest| ≤ most.
#[derive(Debug, Clone, Copy)]
struct Row {
    along: f64,
    bend: f64,
    rest: f64,
    most: f64,
}

/// Which ü are possible with `x`, by all rows.
fn range(rows: &[Row], x: f64) -> [f64; 2] {
    let mut range = [f64::NEG_INFINITY, f64::INFINITY];
    for Row { along, bend, rest, most } in rows {
        let offset = bend * x + rest;
        if along.abs() < 1e-12 {
            if offset.abs() > *most {
                return [f64::INFINITY, f64::NEG_INFINITY];
            }
            continue;
        }
        let ends = [(-most - offset) / along, (most - offset) / along];
        range = [range[0].max(ends[0].min(ends[1])), range[1].min(ends[0].max(ends[1]))];
    }
    range
}

/// The limits at one point of the curve, and the largest x by the speeds.
fn rows<R: Robot<D>, const D: usize>(
    robot: &mut R,
    bounds: &Bounds,
    [q, first, second]: &[Vec<f64>; 3],
) -> (Vec<Row>, f64) {
    let n = q.len();
    interrupt::checkpoint(64 * n);
    let mut rows = Vec::with_capacity(2 * n);
    let mut most = f64::INFINITY;
    for i in 0..n {
        let (along, bend) = (first[i], second[i]);
        rows.push(Row { along, bend, rest: 0.0, most: bounds.acceleration[i] });
        if along != 0.0 {
            most = most.min((bounds.speed[i] / along).powi(2));
        }
    }
    let has_tip = bounds.tip.iter().any(|limit| limit.is_finite());
    if has_tip || !bounds.torque.is_empty() {
        robot.update(q, first);
    }
    if has_tip {
        let goes = [robot.task_velocity::<D>().norm(), robot.turning()[0].norm()];
        for (goes, limit) in goes.into_iter().zip(bounds.tip).filter(|(goes, _)| *goes > 0.0) {
            most = most.min((limit / goes).powi(2));
        }
    }
    if !bounds.torque.is_empty() {
        let mut parts = [0; 4].map(|_| vec![0.0; n]);
        let [along, bend, turning, rest] = &mut parts;
        robot.mass_mul(first, along);
        robot.mass_mul(second, bend);
        robot.coriolis_mul(first, turning);
        robot.gravity_torque(rest);
        for (i, most) in bounds.torque.iter().enumerate() {
            let [along, bend, rest] = [along[i], bend[i] + turning[i], rest[i]];
            rows.push(Row { along, bend, rest, most: *most });
        }
    }
    (rows, most)
}

/// The joint that holds the largest share of what it may; of the accelerations, which come first, there is nothing to hold.
fn weakest(rows: &[Row]) -> Heavy {
    let share = |row: &Row| row.rest.abs() / row.most;
    let joint = |i: usize| i - rows.len() / 2;
    (rows.len() / 2..rows.len())
        .max_by(|a, b| share(&rows[*a]).total_cmp(&share(&rows[*b])))
        .map_or(Heavy { joint: 0, torque: [0.0; 2] }, |i| Heavy {
            joint: joint(i),
            torque: [rows[i].rest.abs(), rows[i].most],
        })
}

/// When the curve is where.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeLaw {
    /// The parameter of the curve, [`TICK`] apart, from rest to rest.
    along: Vec<f64>,
}

impl TimeLaw {
    /// The fastest along `curve`.
    ///
    /// # Errors
    /// If there is none, with the joint that is the weakest, or none that ends in time.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "few points"
    )]
    pub fn fastest<R: Robot<D>, const D: usize>(
        robot: &mut R,
        curve: &Curve,
        bounds: &Bounds,
    ) -> Result<Self, Stop> {
        let n = robot.dof();
        let count = (GRID * curve.end()).max(FEWEST) as usize;
        let numbers = size_of::<Row>() / size_of::<f64>() * 2 * n;
        memory::fits(count.saturating_mul(numbers)).map_err(|_| Stop::Winding)?;
        let step = curve.end() / count as f64;
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let limits: Vec<_> = (0..=count)
            .map(|k| {
                curve.at(step * k as f64, &mut state);
                rows(robot, bounds, &state)
            })
            .collect();
        // What the arm can only pass by falling it does not pass.
        let is_held = |rows: &[Row]| rows.iter().all(|row| row.rest.abs() <= row.most);
        if let Some((rows, _)) = limits.iter().find(|(rows, _)| !is_held(rows)) {
            return Err(Stop::Heavy(weakest(rows)));
        }
        // From the end: the largest x from which the rest can be done.
        let mut most = vec![0.0; count + 1];
        let in_a_tick = (curve.end() / TICK).powi(2); // all of the curve: nothing has to be faster
        for k in (0..count).rev() {
            let (rows, fast) = &limits[k];
            let next = most[k + 1];
            let is_possible = |x: f64| {
                let [lower, upper] = range(rows, x);
                lower.max(-x / (2.0 * step)) <= upper.min((next - x) / (2.0 * step))
            };
            // What stands still at the end comes from x > 0, and no joint may move where q′ = 0.
            let any = if fast.is_finite() { in_a_tick.max(MOST) } else { MOST };
            let (mut low, mut high) = (0.0, fast.min(any));
            if is_possible(high) {
                low = high;
            } else {
                let halvings = HALVINGS + (high / MOST).log2().max(0.0) as usize;
                for _ in 0..halvings {
                    let middle = 0.5 * (low + high);
                    if is_possible(middle) { low = middle } else { high = middle }
                }
            }
            most[k] = low;
        }
        most[0] = 0.0;
        // From the start: as fast as that allows.
        let mut x = vec![0.0; count + 1];
        for k in 0..count {
            let [_, upper] = range(&limits[k].0, x[k]);
            x[k + 1] = (x[k] + 2.0 * step * upper).clamp(0.0, most[k + 1]);
        }
        let mut times = vec![0.0; count + 1];
        for k in 0..count {
            let speeds = x[k].sqrt() + x[k + 1].sqrt();
            if speeds.is_nan() {
                return Err(Stop::Heavy(weakest(&limits[k].0)));
            }
            times[k + 1] = times[k] + 2.0 * step / speeds;
        }
        match times[count] {
            duration if duration <= LONGEST => Ok(Self::smooth(&times, &x, step, bounds.smooth())),
            duration => Err(Stop::Slow(duration)),
        }
    }

    /// The time law with these instants and squared speeds at grid points `step` apart, made smooth by two running means of this
    /// `width` \[s\].
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "few instants"
    )]
    fn smooth(times: &[f64], x: &[f64], step: f64, width: f64) -> Self {
        let duration = times[times.len() - 1];
        let width = (width / TICK) as usize;
        let count = (duration / TICK).ceil() as usize + 2 * width + 1;
        let end = step * (times.len() - 1) as f64;
        // Where it is `width` ticks before, at rest outside.
        let raw = (0..=count + 2 * width).map(|k| {
            let t = TICK * (k as f64 - 2.0 * width as f64);
            if t <= 0.0 {
                return 0.0;
            }
            if t >= duration {
                return end;
            }
            let i = times[1..times.len() - 1].partition_point(|time| *time <= t);
            let since = t - times[i];
            let pull = (x[i + 1] - x[i]) / (2.0 * step);
            step * i as f64 + x[i].sqrt() * since + 0.5 * pull * since * since
        });
        let mean = |values: Vec<f64>| -> Vec<f64> {
            let windows = values.windows(width + 1);
            windows.map(|window| window.iter().sum::<f64>() / (width + 1) as f64).collect()
        };
        let mut along = mean(mean(raw.collect()));
        along.iter_mut().for_each(|u| *u = u.clamp(0.0, end));
        Self { along }
    }

    /// How long it takes \[s\].
    #[expect(clippy::cast_precision_loss, reason = "few instants")]
    pub fn duration(&self) -> f64 {
        TICK * (self.along.len() - 1) as f64
    }

    /// The parameter of the curve at time `t` \[s\].
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        clippy::cast_precision_loss,
        reason = "clamped to few instants"
    )]
    pub fn at(&self, t: f64) -> f64 {
        let ticks = (t / TICK).clamp(0.0, (self.along.len() - 1) as f64);
        let i = (ticks as usize).min(self.along.len() - 2);
        let share = ticks - i as f64;
        self.along[i] + share * (self.along[i + 1] - self.along[i])
    }
}
