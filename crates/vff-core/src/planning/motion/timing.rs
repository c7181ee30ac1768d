//! How long a motion along a path takes: as fast as the joints may, and what follows it can (T120).

use super::planner::{Certified, Planner, ranges_of};
use super::why::Heavy;
use super::*;

/// By how much knots may keep from joint limits so that what is between them does \[rad or m\].
const INSETS: [f64; 6] = [0.0, 1e-6, 1e-5, 5e-5, 2e-4, 1e-3];
/// Share of the torque limits that a plan uses: the rest is for reacting.
pub(super) const TORQUE: f64 = 0.8;
/// Halvings in the search for how much slower.
const HALVINGS: usize = 40;
/// Time between two configurations of a plan \[s\], and how often it is halved.
pub(in crate::planning) const STEP: f64 = 0.04;
const REFINEMENTS: u32 = 3;
/// Instants per knot at which torques are checked.
pub(super) const CHECKS: u32 = 4;

/// How many times as long a motion has to take so that a torque with these changes, of motion and of gravity, keeps a limit of how fast it
/// changes, `least` or more: in s times the time the one is 1/s³, the other 1/s \[N·m/s\].
fn slower([motion, gravity]: [f64; 2], limit: f64, least: f64) -> f64 {
    let change = |s: f64| motion / (s * s * s) + gravity / s;
    if change(least) <= limit {
        return least;
    }
    let (mut low, mut high) = (least, (motion + gravity) / limit);
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if change(middle) <= limit { high = middle } else { low = middle }
    }
    high
}

/// The square of how much longer a motion has to take to keep the limits of jerk.
fn over_jerk(peaks: &Peaks, bounds: &Bounds) -> f64 {
    let jerks = peaks.jerks.iter().zip(&bounds.jerk);
    jerks.map(|(jerk, most)| (jerk / most).powf(2.0 / 3.0)).fold(0.0, f64::max)
}

/// A time for people.
fn seconds(duration: f64) -> String {
    if duration < 1e5 { format!("{duration:.0} s") } else { format!("{duration:.0e} s") }
}

/// Which number makes a motion along `path` take this long \[s\], of these limits of the arm, and of acceleration if one is given.
fn too_slow(
    path: &[Vec<f64>],
    duration: f64,
    (velocity, accelerates): (&[f64], bool),
    bounds: &Bounds,
) -> ScenarioError {
    let travel =
        |i: usize| path.windows(2).map(|pair| (pair[1][i] - pair[0][i]).abs()).sum::<f64>();
    let most = format!("motions are planned that take up to {LONGEST} s");
    let [goes, turns] = bounds.tip;
    let tip = goes.is_finite() || turns.is_finite();
    let slowest = (0..bounds.speed.len())
        .map(|i| (i, travel(i), bounds.speed[i]))
        .max_by(|a, b| (a.1 / a.2).total_cmp(&(b.1 / b.2)))
        .filter(|(_, way, speed)| {
            way / speed > 0.5 * LONGEST || (bounds.torque.is_empty() && !tip)
        });
    // From rest to rest, half of the way faster and faster.
    let lasts = |i: usize| 2.0 * (travel(i) / bounds.acceleration[i]).sqrt();
    let sluggish = (0..bounds.speed.len())
        .map(|i| (i, lasts(i)))
        .filter(|(_, time)| accelerates && *time > 0.5 * LONGEST)
        .max_by(|a, b| a.1.total_cmp(&b.1));
    if let Some((i, time)) = sluggish {
        let problem =
            format!("too little for joint {i}, which alone takes {}: {most}", seconds(time));
        return ScenarioError::new("acceleration", Problem::Other(problem));
    }
    let (at, problem) = match slowest {
        Some((i, way, speed)) => {
            let limit = velocity.get(i).filter(|limit| way / **limit > 0.5 * LONGEST);
            let at = limit.map_or("speed".into(), |_| format!("arm.velocity_limits[{i}]"));
            let problem = format!(
                "joint {i} has {way:.3} to go at up to {speed:e} a second, which makes it {}: {most}",
                seconds(duration)
            );
            (at, problem)
        }
        None => {
            let problem = if duration.is_finite() {
                format!("too little to get anywhere in less than {}: {most}", seconds(duration))
            } else {
                format!("too little to get anywhere: {most}")
            };
            let key = match (tip, goes <= turns) {
                (false, _) => "arm.torque_limits",
                (true, true) => "controller.command.tip_speed",
                (true, false) => "controller.command.tip_angular_speed",
            };
            (key.into(), problem)
        }
    };
    ScenarioError::new(at, Problem::Other(problem))
}

impl<S: SpaceTypes<D>, const D: usize> Planner<'_, S, D>
where
    S::State: Jointed<D>,
{
    /// The motion along `path`, or why there is none.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "few knots")]
    pub(super) fn timed(
        &mut self,
        path: &[Vec<f64>],
        limits: &Limits,
    ) -> Result<Result<Certified, (PlanStatus, String)>, ScenarioError> {
        let n = self.start.len();
        let Some(curve) = Curve::round(&mut self.space, path) else {
            return Ok(Err(self.too_tight()));
        };
        let share = self.settings.speed;
        let [of_joints, of_tip] = self.kept.map(|kept| share.min(kept));
        let shares = |of: &dyn Fn(usize) -> f64| (0..n).map(|i| share * of(i)).collect();
        let any = |given: &Option<ScalarOrVec>| {
            given.as_ref().map_or(vec![], |given| shares(&|i| given.get(i)))
        };
        let usual = ScalarOrVec::Uniform(MAX_ACCELERATION[D - 2]);
        let acceleration = self.settings.acceleration.as_ref().unwrap_or(&usual);
        let bounds = Bounds {
            speed: (0..n)
                .map(|i| limits.velocity.get(i).map_or(share * MAX_SPEED, |most| of_joints * most))
                .collect(),
            acceleration: shares(&|i| acceleration.get(i)),
            jerk: any(&self.settings.jerk),
            torque: limits.torque.iter().map(|most| TORQUE * most).collect(),
            rate: any(&self.command.torque_rate),
            tip: [self.command.tip_speed, self.command.tip_angular_speed]
                .map(|most| most.map_or(f64::INFINITY, |most| of_tip * most)),
        };
        let accelerates = self.settings.acceleration.is_some();
        let too_slow =
            |duration| too_slow(path, duration, (&limits.velocity, accelerates), &bounds);
        let law = match TimeLaw::fastest(self.space.robot(), &curve, &bounds) {
            Ok(law) => law,
            Err(Stop::Heavy(heavy)) => return Ok(Err(self.too_heavy(heavy))),
            Err(Stop::Winding) => return Ok(Err(too_winding())),
            Err(Stop::Slow(duration)) => return Err(too_slow(duration)),
        };
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        // With as few knots as it needs first, then with all of them, then with more.
        for (refinement, is_sparse) in
            std::iter::once((0, true)).chain((0..=REFINEMENTS).map(|finer| (finer, false)))
        {
            let step = STEP / f64::from(1 << refinement);
            let count = (law.duration() / step).ceil().max(2.0) as u32;
            let mut instants: Vec<f64> =
                (0..=count).map(|k| f64::from(k) / f64::from(count)).collect();
            let mut points: Vec<Vec<f64>> = vec![];
            for share in &instants {
                curve.at(law.at(law.duration() * share), &mut state);
                points.push(state[0].clone());
            }
            if is_sparse {
                let step = law.duration() / f64::from(count);
                let needed = knots::needed(&points, step, &bounds.speed);
                if needed.len() == points.len() {
                    continue;
                }
                points = needed.iter().map(|k| std::mem::take(&mut points[*k])).collect();
                instants = needed.iter().map(|k| instants[*k]).collect();
            }
            // To the last bit, of a motion that leads nowhere everywhere.
            let last = points.len() - 1;
            if path.iter().all(|corner| *corner == path[0]) {
                points.fill(path[0].clone());
            }
            points[0].clone_from(&path[0]);
            points[last].clone_from(&path[path.len() - 1]);
            // Knots follow the law within the limits, not the spline between them: stretched until that keeps its limits, too,
            // and moved where it leaves those of positions.
            let (mut stretch, mut inset) = (1.0, 0);
            for _ in 0..8 {
                let duration = stretch * law.duration();
                let times: Vec<f64> = instants.iter().map(|share| duration * share).collect();
                let Ok(spline) = JointSpline::new(&times, &points) else {
                    return Ok(Err(self.too_tight()));
                };
                let peaks = spline.peaks();
                let jerked = over_jerk(&peaks, &bounds);
                let [over, rushed] = match self.excess(&spline, &peaks, &bounds) {
                    Ok(over) => over,
                    Err(heavy) => return Ok(Err(self.too_heavy(heavy))),
                };
                let over = over.max(rushed).max(jerked);
                let leaves = |(i, [low, high]): (usize, &[f64; 2])| {
                    let [lower, upper] = ranges_of(limits, i);
                    *low < lower || *high > upper
                };
                if over > 1.0 {
                    stretch *= over.sqrt().max(1.002);
                    let duration = stretch * law.duration();
                    if duration > LONGEST {
                        let key = match (jerked < over, rushed < over) {
                            (false, _) => "jerk",
                            (true, false) => "controller.command.torque_rate",
                            (true, true) => return Err(too_slow(duration)),
                        };
                        let problem = format!(
                            "too little to get anywhere in less than {duration:.0} s: motions are planned that take up to {LONGEST} s"
                        );
                        return Err(ScenarioError::new(key, Problem::Other(problem)));
                    }
                } else if peaks.positions.iter().enumerate().any(leaves) {
                    inset += 1;
                    let Some(inset) = INSETS.get(inset) else { break };
                    for point in &mut points[1..last] {
                        for (i, q) in point.iter_mut().enumerate() {
                            let [lower, upper] = ranges_of(limits, i);
                            // No more than there is, of a joint that is locked by a range of next to nothing.
                            let inset = inset.min(0.5 * (upper - lower));
                            *q = q.max(lower + inset).min(upper - inset);
                        }
                    }
                } else if let Some(kept) = self.kept_along(&spline, false) {
                    return Ok(Ok((spline, kept)));
                } else {
                    break;
                }
            }
        }
        Ok(Err(self.too_tight()))
    }

    /// Why a path is of no use that cannot be rounded, or not followed smoothly.
    fn too_tight(&self) -> (PlanStatus, String) {
        let more: String = self.space.pointings.iter().map(Pointing::more).collect();
        let another = if more.is_empty() { "" } else { " another" };
        let why = format!(
            "there is a path, and no smooth motion near it keeps half of the margin; another seed{more} or{another} margin may help"
        );
        (PlanStatus::NotFound, why)
    }

    /// What is said of a path on which a joint cannot hold the arm.
    fn too_heavy(&mut self, heavy: Heavy) -> (PlanStatus, String) {
        let (robot, joint) = (self.space.robot(), heavy.joint);
        let why = heavy.sentence(&robot.joint_name(joint), robot.slides(joint), TORQUE);
        (PlanStatus::TooHeavy, why)
    }

    /// The square of how much longer a motion has to take to keep the limits of speed, acceleration and torque, torques and the tip's
    /// speeds at samples, the others anywhere; and that to keep the limits of how fast torques change, between samples as well.
    ///
    /// # Errors
    /// If a joint cannot hold the arm on it.
    fn excess(
        &mut self,
        spline: &JointSpline,
        peaks: &Peaks,
        bounds: &Bounds,
    ) -> Result<[f64; 2], Heavy> {
        let n = self.start.len();
        let mut state = [0; 3].map(|_| vec![0.0; n]);
        let (mut scratch, mut torque) = (vec![0.0; n], vec![0.0; n]);
        let speeds = peaks.speeds.iter().zip(&bounds.speed).map(|(v, most)| (v / most).powi(2));
        let pulls = peaks.accelerations.iter().zip(&bounds.acceleration).map(|(a, most)| a / most);
        let mut most = speeds.chain(pulls).fold(0.0, f64::max);
        let has_tip = bounds.tip.iter().any(|limit| limit.is_finite());
        let is_checked = has_tip || !bounds.torque.is_empty() || !bounds.rate.is_empty();
        if !is_checked {
            return Ok([most, 1.0]);
        }
        let adds_gravity = self.command.gravity == Gravity::Controller;
        let times = spline.times().windows(2).flat_map(|pair| {
            let [from, step] = [pair[0], (pair[1] - pair[0]) / f64::from(CHECKS)];
            (1..=CHECKS).map(move |k| (from + step * f64::from(k), step))
        });
        let times = std::iter::once((spline.times()[0], 1.0)).chain(times).enumerate();
        let (mut gravity, mut before, mut longer) = (vec![0.0; n], vec![[0.0; 2]; n], 1.0_f64);
        let mut rates = vec![[[0.0; 2]; CHECKS as usize]; n];
        let (mut tip, mut steps) = ([[0.0; 3]; 2], [1.0; 2]);
        for (k, (t, step)) in times {
            interrupt::checkpoint(64 * n);
            steps = [steps[1], step];
            spline.at(t, state.each_mut().map(Vec::as_mut_slice));
            let [q, dq, ddq] = &state;
            let robot = self.space.robot();
            robot.update(q, dq);
            robot.inverse_dynamics(ddq, &mut scratch, &mut torque);
            robot.gravity_torque(&mut gravity);
            // In s times the time what moves takes 1/s² of the torque, and what is held all of it.
            for (joint, limit) in bounds.torque.iter().enumerate() {
                let (tau, side) = (torque[joint], torque[joint].signum());
                let left = limit - side * gravity[joint];
                if tau.abs() > *limit {
                    if left <= 0.0 {
                        return Err(Heavy { joint, torque: [gravity[joint].abs(), *limit] });
                    }
                    most = most.max(side * (tau - gravity[joint]) / left);
                }
            }
            if has_tip {
                let goes = [robot.task_velocity::<D>().norm(), robot.turning()[0].norm()];
                for (part, limit) in bounds.tip.iter().enumerate() {
                    let last = &mut tip[part];
                    last.rotate_left(1);
                    last[2] = goes[part] / limit;
                    most = most.max(between(last, steps).powi(2));
                }
            }
            for (i, limit) in bounds.rate.iter().enumerate() {
                let now = [torque[i] - gravity[i], if adds_gravity { gravity[i] } else { 0.0 }];
                rates[i].rotate_left(1);
                rates[i][CHECKS as usize - 1] =
                    [0, 1].map(|part| (now[part] - before[i][part]) / step);
                before[i] = now;
                if k > 0 && k % CHECKS as usize == 0 {
                    for change in throughout(&rates[i]) {
                        longer = longer.max(slower(change, *limit, longer));
                    }
                }
            }
        }
        Ok([most, longer * longer])
    }
}

/// The most that a quantity comes to about three samples of it, so far apart, by the parabola through them where the one in the middle is
/// the largest.
fn between([a, b, c]: &[f64; 3], [first, second]: [f64; 2]) -> f64 {
    let [rise, fall] = [(b - a) / first, (c - b) / second];
    let bend = (rise - fall) / (first + second);
    let slope = (rise * second + fall * first) / (first + second);
    let top = if b >= a && b >= c && bend > 0.0 { b + 0.25 * slope * slope / bend } else { *b };
    top.max(*c)
}

/// How fast two quantities change at most, of which each is smooth between two knots and has these rates on average in the parts between: there,
/// and at the knots, where rates jump.
fn throughout(rates: &[[f64; 2]; CHECKS as usize]) -> [[f64; 2]; CHECKS as usize + 2] {
    let beyond =
        |end: [f64; 2], next: [f64; 2]| [0, 1].map(|part| 1.5 * end[part] - 0.5 * next[part]);
    let last = rates.len() - 1;
    let mut all = [[0.0; 2]; CHECKS as usize + 2];
    all[0] = beyond(rates[0], rates[1]);
    all[1..=last + 1].copy_from_slice(rates);
    all[last + 2] = beyond(rates[last], rates[last - 1]);
    all.map(|rate| rate.map(f64::abs))
}

/// What is said of a way of so many steps that there is no room for their speeds.
fn too_winding() -> (PlanStatus, String) {
    let why = "there is a path, of more steps than there is room for; shorter straight ways, or a shorter path, may help";
    (PlanStatus::NotFound, why.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// In so many times the time a torque changes as fast as it may, and not before; what is kept already costs nothing.
        #[test]
        fn it_takes_as_long_as_it_has_to(
            motion in 0.0..1e4, gravity in 0.0..1e4, limit in 1.0..1e3, least in 1.0..3.0,
        ) {
            let change = |s: f64| motion / (s * s * s) + gravity / s;
            let found = slower([motion, gravity], limit, least);
            prop_assert!(found >= least && change(found) <= limit * (1.0 + 1e-12));
            prop_assert!(found <= least || change(found) >= limit * (1.0 - 1e-6), "{found}");
        }
    }
}
