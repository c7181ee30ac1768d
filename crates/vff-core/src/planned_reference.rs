//! Planned reference: where the joints of a plan put the end effector, and how it moves there (T117).

use crate::robot::Manipulator;
use crate::trajectory::{Guided, JointSpline, PlannedReference, Sample, Trajectory};
use std::cell::RefCell;
use std::fmt::Debug;
use std::sync::Arc;

/// An arm in `D` dimensions that follows a plan exactly, for another one to follow.
#[derive(Debug, Clone)]
struct PlannedRobot<R, const D: usize> {
    joints: Arc<JointSpline>,
    /// The arm, and q, q̇ and q̈ of its joints.
    arm: RefCell<(R, [Vec<f64>; 3])>,
}

impl<R, const D: usize, const M: usize> PlannedReference<R::Pose, M> for PlannedRobot<R, D>
where
    R: Manipulator<D, M, Pose: Guided<M>> + Clone + Debug + Send + 'static,
{
    fn at(&self, t: f64) -> Sample<R::Pose, M> {
        let (robot, state) = &mut *self.arm.borrow_mut();
        self.joints.at(t, state.each_mut().map(Vec::as_mut_slice));
        let [q, dq, ddq] = state;
        robot.update(q, dq);
        let [dx, ddx] = robot.motion(ddq);
        Sample { x: robot.pose(), dx, ddx }
    }

    fn joints(&self) -> &JointSpline {
        &self.joints
    }

    fn copy(&self) -> Box<dyn PlannedReference<R::Pose, M>> {
        Box::new(self.clone())
    }
}

/// The reference of an end effector that goes where `robot` would have it along `joints`, which are as many as it has.
pub fn follow_plan<R, const D: usize, const M: usize>(
    robot: R,
    joints: JointSpline,
) -> Trajectory<R::Pose, M>
where
    R: Manipulator<D, M, Pose: Guided<M>> + Clone + Debug + Send + 'static,
{
    let state = [0; 3].map(|_| vec![0.0; joints.dof()]);
    let arm = RefCell::new((robot, state));
    Trajectory::of_plan(Box::new(PlannedRobot::<R, D> { joints: Arc::new(joints), arm }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vector;
    use crate::math::{Noise, Pose};
    use crate::robot::Model;
    use crate::robot::PlanarArm;
    use crate::robot::planar::Link;
    use crate::robot::spatial::cases::panda_like;
    use std::sync::Arc;

    /// Knots of a random plan for so many joints.
    fn plan(n: usize, seed: u64) -> JointSpline {
        let mut noise = Noise::new(seed, 0);
        let times: Vec<f64> = (0..6).map(|k| 0.5 * f64::from(k)).collect();
        let points = times.iter().map(|_| (0..n).map(|_| 0.7 * noise.draw()).collect());
        JointSpline::new(&times, &points.collect::<Vec<_>>()).unwrap()
    }

    /// Where the joints put it, and ẋ and ẍ are what x changes by.
    fn check<R, const D: usize, const M: usize>(robot: &R, seed: u64)
    where
        R: Manipulator<D, M, Pose: Guided<M>> + Clone + Debug + Send + 'static,
    {
        let joints = plan(robot.dof(), seed);
        let trajectory = follow_plan::<R, D, M>(robot.clone(), joints.clone());
        let mut state = [0; 3].map(|_| vec![0.0; robot.dof()]);
        for k in 0..24 {
            let t = 0.05 + 0.1 * f64::from(k);
            joints.at(t, state.each_mut().map(Vec::as_mut_slice));
            let mut there = robot.clone();
            there.update_positions(&state[0]);
            let at = trajectory.at(t);
            assert!(there.pose().error(&at.x).norm() < 1e-12);
            let h = 1e-4;
            let [before, after] = [t - h, t + h].map(|t| trajectory.at(t));
            // What a reference is to a robot that stands where it does, at rest.
            let [dx, _] = there.resolve(&at.x, &at.dx, &at.ddx);
            let moved = after.x.error(&before.x) / (2.0 * h);
            assert!((moved - dx).norm() < 1e-5 * (1.0 + dx.norm()), "{moved} {dx}");
            if M != 5 {
                let change = (after.dx - before.dx) / (2.0 * h);
                assert!((change - at.ddx).norm() < 1e-5 * (1.0 + at.ddx.norm()), "{change}");
            }
        }
    }

    #[test]
    fn the_end_effector_goes_where_the_joints_put_it() {
        let planar = Arc::new(PlanarArm::new(vec![Link::rod(0.7, 1.0); 4], Vector::<2>::zeros()));
        let spatial = panda_like();
        for seed in 0..4 {
            check::<_, 2, 2>(&planar.state(), seed);
            check::<_, 2, 3>(&planar.state(), seed);
            check::<_, 3, 3>(&spatial.state(), seed);
            check::<_, 3, 6>(&spatial.state(), seed);
        }
    }

    /// Pointing: an arm with the same joints follows it without an error, under the law of the error (T9).
    #[test]
    fn pointing_is_that_of_the_pose() {
        use crate::math::Pointing;
        let arm = panda_like();
        let joints = plan(7, 5);
        let pose = follow_plan::<_, 3, 6>(arm.state(), joints.clone());
        let pointing = follow_plan::<_, 3, 5>(arm.state(), joints);
        for k in 0..20 {
            let t = 0.02 + 0.12 * f64::from(k);
            let at = pose.at(t);
            let expected = Sample::<Pointing, 5>::in_world_axes(at.x, &at.dx, &at.ddx);
            let given = pointing.at(t);
            assert!(given.x.error(&expected.x).norm() < 1e-12);
            assert!((given.dx - expected.dx).norm() < 1e-12);
            assert!((given.ddx - expected.ddx).norm() < 1e-11);
        }
    }
}
