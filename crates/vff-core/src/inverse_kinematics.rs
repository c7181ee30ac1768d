//! Whether an arm can take a pose, and follow a reference: damped least squares on the operators of a robot (T106).
//!
//! What is found is a configuration within the joint limits; "not found" is no proof that there is none, but a search
//! from many configurations has then come no nearer.

use crate::interrupt;
use crate::math::{Noise, Pose, Vector};
use crate::robot::{Limits, Manipulator};
use crate::trajectory::{Guided, Trajectory};
use nalgebra::SMatrix;

/// How near counts as reached, in position \[m\] and in angle \[rad\]: also beyond the end of the reach.
pub const TOLERANCE: f64 = 1e-6;
/// How near the search goes where it can \[m, rad\].
const PRECISION: f64 = 1e-9;
/// Steps of one search.
const STEPS: usize = 100;
/// Steps in a row without progress that end a search.
const STALLED: usize = 6;
/// Searches from other configurations where that from the present one fails.
const RESTARTS: usize = 16;
/// Searches from configurations around one that came so near \[m\], and how far away these are at most: at first \[rad\], and by
/// which factor less after one that brought nothing.
const NEARBY: usize = 32;
const NEAR: f64 = 1e-3;
const SPREAD: [f64; 2] = [0.3, 0.95];
/// Halvings of the interval in which a reference gets out of reach.
const HALVINGS: usize = 40;
/// The damping per squared error, at first and at most \[1/rad²\].
const DAMPING: [f64; 2] = [1e-3, 1e12];
/// Where the random numbers of restarts come from.
const STREAM: u64 = 6;

/// How far an arm stays away from a pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Distance \[m\].
    pub position: f64,
    /// Angle \[rad\]; of a direction, if the task is one of pointing.
    pub angle: f64,
}

impl Residual {
    /// Of an error of a task in space of dimension `D`.
    pub(crate) fn of<const D: usize, const M: usize>(error: &Vector<M>) -> Self {
        let square =
            |range: std::ops::Range<usize>| range.map(|i| error[i] * error[i]).sum::<f64>();
        let angle = square(D..M).sqrt();
        // In space an error is the chord of its angle.
        let angle = if D == 3 { 2.0 * (0.5 * angle).min(1.0).asin() } else { angle };
        Self { position: square(0..D).sqrt(), angle }
    }

    /// Whether the pose counts as reached.
    pub fn is_reached(&self) -> bool {
        self.within(TOLERANCE)
    }

    /// The distance \[m\] where an angle is an arc at `length`.
    pub(crate) fn size(&self, length: f64) -> f64 {
        self.position.hypot(length * self.angle)
    }

    fn within(&self, bound: f64) -> bool {
        self.position <= bound && self.angle <= bound
    }
}

/// From when on an arm cannot follow a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unreachable {
    /// The instant \[s\].
    pub time: f64,
    /// How far the arm stays away from the rest of the reference, where it is farthest.
    pub error: Residual,
}

/// A search with its workspace, for robots of `n` joints.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::inverse_kinematics::{Residual, Solver, Unreachable};
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, planar::Link};
/// use vff_core::trajectory::{Trajectory, plane::Reference};
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::zeros()));
/// let mut solver = Solver::<2>::new(3, 1.0);
/// let mut q = [0.4, 0.3, 0.2];
/// let found: Residual = solver.solve(&mut arm.state(), &mut q, &Vector::<2>::new(0.8, 0.6));
/// assert!(found.is_reached());
/// // A line to where the arm does not reach: up to when it can follow.
/// let line = Reference::Line { start: None, end: vec![3.0, 0.0], duration: 1.0 };
/// let trajectory = Trajectory::new(&line, &Vector::<2>::new(0.8, 0.6)).unwrap();
/// let Unreachable { time, .. } =
///     solver.follow(&mut arm.state(), &trajectory, &q, 1.0, 100).unwrap_err();
/// assert!(0.0 < time && time < 1.0);
/// ```
#[derive(Debug, Clone)]
pub struct Solver<const M: usize> {
    /// What an angle of 1 rad counts for \[m\].
    length: f64,
    columns: Vec<Vector<M>>,
    /// Whether a joint may move in the present step.
    free: Vec<bool>,
    step: Vec<f64>,
    trial: Vec<f64>,
    best: Vec<f64>,
    noise: Noise,
}

/// The range of joint `i`, infinite where it has no limits.
fn range(limits: &Limits, i: usize) -> [f64; 2] {
    limits.joint.get(i).copied().unwrap_or([f64::NEG_INFINITY, f64::INFINITY])
}

impl<const M: usize> Solver<M> {
    /// For robots with `n` joints, with the characteristic length `length` \[m\] > 0 at which an angle is an arc.
    pub fn new(n: usize, length: f64) -> Self {
        Self {
            length,
            columns: vec![Vector::zeros(); n],
            free: vec![true; n],
            step: vec![0.0; n],
            trial: vec![0.0; n],
            best: vec![0.0; n],
            noise: Noise::new(0, STREAM),
        }
    }

    /// Moves `q` to where `robot` is as near to `pose` as a search from there finds, within the joint limits.
    /// Does not allocate.
    pub fn solve<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &mut R,
        q: &mut [f64],
        pose: &R::Pose,
    ) -> Residual {
        let n = q.len();
        for (i, q) in q.iter_mut().enumerate() {
            let [lower, upper] = range(robot.limits(), i);
            *q = q.clamp(lower, upper);
        }
        robot.update_positions(q);
        let mut error = robot.pose().error(pose);
        let (mut damping, mut stalled) = (DAMPING[0], 0);
        for _ in 0..STEPS {
            let scaled = self.scaled::<D>(&error);
            let cost = scaled.norm_squared();
            if Residual::of::<D, M>(&error).within(PRECISION) || stalled == STALLED {
                break;
            }
            interrupt::checkpoint(n * (64 + M * M));
            for i in 0..n {
                self.columns[i] = self.scaled::<D>(&robot.jacobian_column(i));
            }
            // The present step may be refused several times.
            let better = loop {
                self.find_step(robot.limits(), q, &scaled, damping * cost);
                for (i, trial) in self.trial.iter_mut().enumerate() {
                    let [lower, upper] = range(robot.limits(), i);
                    *trial = (q[i] + self.step[i]).clamp(lower, upper);
                }
                robot.update_positions(&self.trial);
                let there = robot.pose().error(pose);
                let left = self.scaled::<D>(&there).norm_squared();
                if left < cost {
                    damping = (0.2 * damping).max(1e-9);
                    break Some((there, left));
                }
                damping *= 8.0;
                if damping > DAMPING[1] {
                    break None;
                }
            };
            let Some((there, left)) = better else { break };
            q.copy_from_slice(&self.trial);
            error = there;
            stalled = if left > 0.99 * cost { stalled + 1 } else { 0 };
        }
        Residual::of::<D, M>(&error)
    }

    /// The damped step, without the joints that it would push beyond a limit at which they are.
    fn find_step(&mut self, limits: &Limits, q: &[f64], error: &Vector<M>, damping: f64) {
        let Self { columns, free, step, .. } = self;
        free.fill(true);
        loop {
            let mut gram = SMatrix::<f64, M, M>::identity() * damping;
            for (column, _) in columns.iter().zip(&*free).filter(|(_, free)| **free) {
                gram += column * column.transpose();
            }
            let pull = gram.cholesky().map_or_else(Vector::zeros, |gram| gram.solve(error));
            let mut blocked = false;
            for (i, step) in step.iter_mut().enumerate() {
                let [lower, upper] = range(limits, i);
                *step = if free[i] { -columns[i].dot(&pull) } else { 0.0 };
                if (*step < 0.0 && q[i] <= lower) || (*step > 0.0 && q[i] >= upper) {
                    (free[i], blocked) = (false, true);
                }
            }
            if !blocked {
                return;
            }
        }
    }

    /// The same from other configurations, too, if need be: the nearest of all that is found.
    pub fn solve_from_anywhere<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &mut R,
        q: &mut [f64],
        pose: &R::Pose,
    ) -> Residual {
        let mut residual = self.solve(robot, q, pose);
        if residual.is_reached() {
            return residual;
        }
        let mut best = std::mem::take(&mut self.best);
        best.copy_from_slice(q);
        for _ in 0..RESTARTS {
            for (i, q) in q.iter_mut().enumerate() {
                let turn = std::f64::consts::PI;
                let [lower, upper] = match range(robot.limits(), i) {
                    [lower, upper] if (upper - lower).is_finite() => [lower, upper],
                    [lower, upper] => [lower.max(best[i] - turn), upper.min(best[i] + turn)],
                };
                *q = lower + (upper - lower) * self.noise.share();
            }
            let found = self.solve(robot, q, pose);
            if found.is_reached() || found.size(self.length) < residual.size(self.length) {
                residual = found;
                best.copy_from_slice(q);
            }
            if residual.is_reached() {
                break;
            }
        }
        q.copy_from_slice(&best);
        self.best = best;
        self.solve_nearby(robot, q, pose, residual)
    }

    /// The same from configurations around `q`, if that came near and stays away by `residual`. At the very end of its reach an arm
    /// gets nearer only with the square of how far it turns about itself, ever more slowly along a bent valley: a search from beside
    /// that is there sooner.
    pub(crate) fn solve_nearby<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &mut R,
        q: &mut [f64],
        pose: &R::Pose,
        mut residual: Residual,
    ) -> Residual {
        if residual.size(self.length) > NEAR {
            return residual;
        }
        let mut best = std::mem::take(&mut self.best);
        best.copy_from_slice(q);
        let [mut spread, shrink] = SPREAD;
        for _ in 0..NEARBY {
            if residual.is_reached() {
                break;
            }
            for (q, best) in q.iter_mut().zip(&best) {
                *q = best + spread * (2.0 * self.noise.share() - 1.0);
            }
            let found = self.solve(robot, q, pose);
            if found.is_reached() || found.size(self.length) < residual.size(self.length) {
                residual = found;
                best.copy_from_slice(q);
            } else {
                spread *= shrink;
            }
        }
        q.copy_from_slice(&best);
        self.best = best;
        residual
    }

    /// Follows `trajectory` from `q0` for `duration` \[s\] in `samples` steps, each from the configuration before; from
    /// others where that leads nowhere.
    ///
    /// # Errors
    /// With the first instant at which no configuration is found that reaches the reference.
    #[expect(clippy::cast_precision_loss, reason = "counts of samples")]
    pub fn follow<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &mut R,
        trajectory: &Trajectory<R::Pose, M>,
        q0: &[f64],
        duration: f64,
        samples: usize,
    ) -> Result<(), Unreachable>
    where
        R::Pose: Guided<M>,
    {
        let time = |k: usize| duration * (k as f64 / samples.max(1) as f64);
        let (mut q, mut good) = (q0.to_vec(), q0.to_vec());
        for k in 0..=samples {
            q.copy_from_slice(&good);
            let error = self.solve_from_anywhere(robot, &mut q, &trajectory.at(time(k)).x);
            if error.is_reached() {
                good.copy_from_slice(&q);
                continue;
            }
            let (mut before, mut after) = (time(k.saturating_sub(1)), time(k));
            for _ in 0..HALVINGS {
                let middle = 0.5 * (before + after);
                q.copy_from_slice(&good);
                let error = self.solve_from_anywhere(robot, &mut q, &trajectory.at(middle).x);
                if error.is_reached() {
                    before = middle;
                    good.copy_from_slice(&q);
                } else {
                    after = middle;
                }
            }
            let error = self.farthest(robot, trajectory, &mut q, [after, duration]);
            return Err(Unreachable { time: after, error });
        }
        Ok(())
    }

    /// The largest error on the way of `trajectory` from one time \[s\] to another, each found from the
    /// configuration before.
    fn farthest<R: Manipulator<D, M>, const D: usize>(
        &mut self,
        robot: &mut R,
        trajectory: &Trajectory<R::Pose, M>,
        q: &mut [f64],
        [from, to]: [f64; 2],
    ) -> Residual
    where
        R::Pose: Guided<M>,
    {
        const SAMPLES: u32 = 32;
        let length = self.length;
        let errors = (0..=SAMPLES).map(|k| {
            let t = from + (to - from) * f64::from(k) / f64::from(SAMPLES);
            self.solve_from_anywhere(robot, q, &trajectory.at(t).x)
        });
        errors
            .max_by(|a, b| a.size(length).total_cmp(&b.size(length)))
            .unwrap_or(Residual { position: 0.0, angle: 0.0 })
    }

    /// `error` with its angles as arcs.
    fn scaled<const D: usize>(&self, error: &Vector<M>) -> Vector<M> {
        Vector::from_fn(|i, _| if i < D { error[i] } else { error[i] * self.length })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::{PlanarPose, Pointing, SpatialPose};
    use crate::robot::planar::Link;
    use crate::robot::spatial::cases::panda_like;
    use crate::robot::{Model, PlanarArm, Robot, SpatialState};
    use crate::trajectory::{Reference, SpatialReference};
    use std::f64::consts::{FRAC_PI_2, PI};
    use std::sync::Arc;

    fn planar(lengths: &[f64], limits: Vec<[f64; 2]>) -> Arc<PlanarArm> {
        let links = lengths.iter().map(|length| Link::rod(*length, 1.0)).collect();
        let limits = Limits { joint: limits, ..Limits::default() };
        Arc::new(PlanarArm::new(links, Vector::zeros()).with_limits(limits))
    }

    fn line(start: &[f64], end: &[f64]) -> Reference {
        Reference::Line { start: Some(start.to_vec()), end: end.to_vec(), duration: 2.0 }
    }

    /// The instant at which the time law of a line of 2 s has gone the share `s` of its way.
    fn instant(s: f64) -> f64 {
        let (mut low, mut high) = (0.0_f64, 1.0_f64);
        for _ in 0..60 {
            let x = 0.5 * (low + high);
            if x * x * x * (10.0 + x * (-15.0 + x * 6.0)) < s { low = x } else { high = x }
        }
        2.0 * low
    }

    /// A line leaves the annulus of two links outwards and inwards at instants known in closed form.
    #[test]
    fn a_line_leaves_the_reach() {
        let arm = planar(&[1.0, 0.6], vec![]);
        for (end, share) in [([2.1, 0.0], 0.6), ([0.1, 0.0], 0.6 / 0.9)] {
            // From 1 m to 1.6 m, and to 0.4 m.
            let reference = line(&[1.0, 0.0], &end);
            let share = if end[0] > 1.0 { 0.6 / 1.1 } else { share };
            let trajectory = Trajectory::<Vector<2>, 2>::new(&reference, &Vector::zeros()).unwrap();
            let mut solver = Solver::<2>::new(2, 1.0);
            let found = solver.follow::<_, 2>(&mut arm.state(), &trajectory, &[0.3, 0.5], 2.0, 200);
            let Unreachable { time, error } = found.unwrap_err();
            // The tolerance of 1e-6 m is passed after about a microsecond.
            let expected = instant(share);
            assert!(expected <= time && time < expected + 1e-5, "{time} is not {expected}");
            assert!(error.position > TOLERANCE && error.angle == 0.0, "{error:?}");
        }
        let inside = line(&[1.0, 0.0], &[1.6, 0.0]);
        let trajectory = Trajectory::<Vector<2>, 2>::new(&inside, &Vector::zeros()).unwrap();
        let mut solver = Solver::<2>::new(2, 1.0);
        let found = solver.follow::<_, 2>(&mut arm.state(), &trajectory, &[0.3, 0.5], 3.0, 200);
        assert_eq!(found, Ok(()), "stretched out it is still reached");
    }

    /// With its elbow limited, the arm reaches less: the law of cosines says when.
    #[test]
    fn joint_limits_end_the_reach() {
        let arm = planar(&[1.0, 1.0], vec![[-3.0, 3.0], [FRAC_PI_2, 2.5]]);
        let reference = line(&[1.0, 0.0], &[2.0, 0.0]);
        let trajectory = Trajectory::<Vector<2>, 2>::new(&reference, &Vector::zeros()).unwrap();
        let mut solver = Solver::<2>::new(2, 1.0);
        let found = solver.follow::<_, 2>(&mut arm.state(), &trajectory, &[0.0, 2.0], 2.0, 100);
        let (time, expected) = (found.unwrap_err().time, instant(2f64.sqrt() - 1.0));
        assert!(expected <= time && time < expected + 1e-5, "{time} is not {expected}");
    }

    /// A planar pose is out of reach in its angle alone.
    #[test]
    fn an_angle_is_out_of_reach() {
        let arm = planar(&[1.0, 1.0, 0.2], vec![[-0.4, 0.4]; 3]);
        let pose = PlanarPose(Vector::<3>::new(2.1, 0.0, 3.0));
        let mut q = vec![0.1; 3];
        let residual =
            Solver::<3>::new(3, 0.5).solve_from_anywhere::<_, 2>(&mut arm.state(), &mut q, &pose);
        assert!(!residual.is_reached() && residual.angle > 1.0, "{residual:?}");
        assert!(q.iter().all(|q| q.abs() <= 0.4));
    }

    /// References made of a smooth joint motion within the limits are reached, for every task, also at the limits.
    #[test]
    fn what_joints_do_is_reachable() {
        let mut noise = Noise::new(7, 1);
        let arm = panda_like();
        let limits = arm.limits().joint.clone();
        for case in 0..100 {
            let mut draw = |k: usize| {
                let [lower, upper] = limits[k];
                lower + (upper - lower) * noise.share()
            };
            let ends: Vec<[f64; 2]> = (0..7).map(|k| [draw(k), draw(k)]).collect();
            let q = |s: f64| -> Vec<f64> {
                let turn = 0.5 - 0.5 * (PI * s).cos();
                // Not more than a third of the way, so that samples of it can be splined.
                ends.iter().map(|[a, b]| a + (b - a) * turn / 3.0).collect()
            };
            let mut state = arm.state();
            let poses: Vec<SpatialPose> = (0..=200)
                .map(|k| {
                    state.update_positions(&q(f64::from(k) / 200.0));
                    Manipulator::<3, 6>::pose(&state)
                })
                .collect();
            let reference = SpatialReference::Table {
                times: (0..=200).map(|k| f64::from(k) / 200.0).collect(),
                points: poses.iter().map(|pose| pose.position().into()).collect(),
                orientations: Some(
                    poses.iter().map(|pose| pose.orientation().to_array()).collect(),
                ),
                relative: false,
            };
            let trajectory = Trajectory::<SpatialPose, 6>::new(&reference, &poses[0]).unwrap();
            let found =
                Solver::<6>::new(7, 0.2).follow::<_, 3>(&mut state, &trajectory, &q(0.0), 1.0, 200);
            assert_eq!(found, Ok(()), "pose, case {case}");
            let trajectory =
                Trajectory::<Pointing, 5>::new(&reference, &Pointing(poses[0])).unwrap();
            let found =
                Solver::<5>::new(7, 0.2).follow::<_, 3>(&mut state, &trajectory, &q(0.0), 1.0, 50);
            assert_eq!(found, Ok(()), "pointing, case {case}");
            let SpatialReference::Table { times, points, .. } = reference else { unreachable!() };
            let position =
                SpatialReference::Table { times, points, orientations: None, relative: false };
            let trajectory =
                Trajectory::<Vector<3>, 3>::new(&position, &poses[0].position()).unwrap();
            let found =
                Solver::<3>::new(7, 0.2).follow::<_, 3>(&mut state, &trajectory, &q(0.0), 1.0, 50);
            assert_eq!(found, Ok(()), "position, case {case}");
        }
    }

    /// In space, too, a line ends where the arm does; and it is the joint limits that forbid a pose.
    #[test]
    fn limits_in_space() {
        let arm = panda_like();
        let mut state: SpatialState = arm.state();
        let q0 = [0.1, -0.5, 0.2, -2.0, 0.3, 1.6, 0.4];
        state.update_positions(&q0);
        let start = Manipulator::<3, 6>::pose(&state);
        let away = SpatialReference::Line {
            start: None,
            end: [2.0, 0.0, 0.0],
            duration: 2.0,
            start_orientation: None,
            orientation: None,
            relative: true,
        };
        let trajectory = Trajectory::<SpatialPose, 6>::new(&away, &start).unwrap();
        let mut solver = Solver::<6>::new(7, 0.2);
        let Unreachable { time, .. } =
            solver.follow::<_, 3>(&mut state, &trajectory, &q0, 2.0, 100).unwrap_err();
        assert!(0.3 < time && time < 1.5, "{time}");
        // Never farther than all links in one line, and before that instant it is reached from elsewhere as well.
        assert!(trajectory.at(time).x.position().norm() < arm.reach_bound() + TOLERANCE);
        let mut q = [0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0];
        let pose = trajectory.at(0.9 * time).x;
        assert!(solver.solve_from_anywhere::<_, 3>(&mut state, &mut q, &pose).is_reached());
        for (q, [lower, upper]) in q.iter().zip(&arm.limits().joint) {
            assert!(lower <= q && q <= upper);
        }
    }
}
