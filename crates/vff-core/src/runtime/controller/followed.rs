//! The reference of a scenario as a loop follows it: by a clock that waits where the settings have a governor, and of a plan with its
//! posture, its margins, and another plan where it leads nowhere any more.

use crate::control::{Controller, Gains, MotionLimits};
use crate::math::Pose;
use crate::planned_reference::follow_plan;
use crate::robot::{Manipulator, Robot};
use crate::simulation::{Moment, Replan, Replanned, System};
use crate::trajectory::{
    Governor, GovernorSettings, Guided, JointSpline, Pace, Sample, Trajectory,
};
use crate::world::World;
use std::sync::Arc;

/// How far a joint may be from where a plan begins \[rad, m\].
const NEAR: f64 = 0.1;
/// How much farther an end effector may be from where another reference begins than in the scenario \[m, rad\].
const NEARLY_THERE: [f64; 2] = [0.1, 0.2];

/// Why a loop does not begin where a robot is: far from the beginning of the reference of its scenario, or beyond its stops. It would
/// be thrown.
///
/// # Example
/// ```
/// use vff_core::runtime::{AnyController, CycleError, ErasedController, MissedStart, Reading};
/// use vff_core::scenario::Scenario;
///
/// # fn main() -> Result<(), Box<dyn std::error::Error>> {
/// let scenario = Scenario::from_toml(
///     r#"
///     duration = 1.0
///     q0 = [0.4, 0.5, -0.6]
///     arm = { lengths = [0.5, 0.5, 0.5], masses = 2.0 }
///     reference = { kind = "setpoint", point = [1.2, 0.5] }
///     "#,
/// )?;
/// let mut controller = AnyController::from_scenario(&scenario)?;
/// controller.begin(0.001, None)?;
/// let elsewhere = Reading { t: 0.0, q: &[-1.0, 0.5, -0.6], dq: &[0.0; 3] };
/// let refused = controller.cycle(Some(elsewhere), None).unwrap_err();
/// assert!(matches!(refused, CycleError::Elsewhere(MissedStart::EndEffector { off, .. }) if off[0] > 1.0));
/// # Ok(())
/// # }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum MissedStart {
    /// A joint, from where it can be: it is given in another order, or with another sign, zero or unit.
    #[error(
        "joint {joint} is at {q:.3}, far beyond its stop at {stop:.3}: {}",
        if *in_degrees { "all joints would fit in degrees, give radians" } else { "give joints in the order, with the signs and the zeros of the arm" }
    )]
    Stop {
        /// Which, counted from 0.
        joint: usize,
        /// Where it is \[rad, m\].
        q: f64,
        /// The nearest it can be \[rad, m\].
        stop: f64,
        /// Whether all would be between their stops were they degrees.
        in_degrees: bool,
    },
    /// A joint, from that of a plan.
    #[error("the plan begins elsewhere: joint {joint} is at {q:.3}, the plan has it at {first:.3}")]
    Joint {
        /// Which, counted from 0.
        joint: usize,
        /// Where it is \[rad, m\].
        q: f64,
        /// Where it should be \[rad, m\].
        first: f64,
    },
    /// The end effector, from any other reference.
    #[error(
        "the reference begins elsewhere: the end effector is {:.3} m and {:.2} rad from there, and {:.3} m and {:.2} rad at the scenario's q0",
        off[0], off[1], usual[0], usual[1]
    )]
    EndEffector {
        /// How far it is off in position and in orientation \[m, rad\].
        off: [f64; 2],
        /// How far that of the scenario is at its `q0` \[m, rad\].
        usual: [f64; 2],
    },
}

/// The reference of a scenario, and what becomes of it.
#[derive(Debug, Clone)]
pub(super) struct Followed<S: System<D, M>, const D: usize, const M: usize> {
    trajectory: Trajectory<S::Pose, M>,
    /// What makes it wait.
    governor: Option<Governor>,
    /// Makes other plans.
    replanning: Option<Box<dyn Replan<S, D, M>>>,
    /// The time of the loop at which it begins \[s\]; None in a loop that is watched over or sets points, until there is a state.
    begins: Option<f64>,
    /// Where the end effector of its scenario is then.
    start: S::Pose,
}

impl<S: System<D, M>, const D: usize, const M: usize> Followed<S, D, M> {
    /// From time 0 on, when the end effector of the scenario is at `start`.
    pub(super) fn new(trajectory: Trajectory<S::Pose, M>, start: S::Pose) -> Self {
        Self { trajectory, governor: None, replanning: None, begins: Some(0.0), start }
    }

    /// From now on `replanning` watches over it, in a thread of its own.
    pub(super) fn watch(&mut self, mut replanning: Box<dyn Replan<S, D, M>>) {
        replanning.plan_beside();
        self.replanning = Some(replanning);
    }

    /// From now on no other plan asks for more than this, if anything.
    pub(super) fn limit(&mut self, limits: Option<&MotionLimits>) {
        self.replanning.iter_mut().for_each(|replanning| replanning.limit(limits));
    }

    /// From now on it waits as these settings say.
    pub(super) fn wait(&mut self, settings: Option<GovernorSettings>, t: f64) {
        let since = t - self.begins.unwrap_or(t);
        if let Some(governor) = &mut self.governor {
            governor.configure(settings, since);
        }
    }

    /// From now on the end effector of a plan is that of `robot`. Allocates.
    pub(super) fn lead(&mut self, robot: &S::State)
    where
        S::Pose: Guided<M>,
        S::State: Manipulator<D, M, Pose = S::Pose> + 'static,
    {
        if let Some(joints) = self.trajectory.joints() {
            let led = follow_plan::<S::State, D, M>(robot.clone(), joints.clone());
            self.trajectory = led.displaced_like(&self.trajectory);
        }
    }

    /// What is followed.
    pub(super) fn trajectory(&self) -> &Trajectory<S::Pose, M> {
        &self.trajectory
    }

    /// The plan, if it is one.
    pub(super) fn joints(&self) -> Option<&JointSpline> {
        self.trajectory.joints()
    }

    /// Whether it is a plan, or may become one.
    pub(super) fn has_plans(&self) -> bool {
        self.joints().is_some() || self.replanning.is_some()
    }

    /// The searches for another plan so far.
    pub(super) fn searches(&self) -> &[Replanned] {
        self.replanning.as_ref().map_or(&[], |replanning| replanning.searches())
    }

    /// Begins anew: at time 0, or, in a loop that is watched over or sets points, with its first state.
    pub(super) fn restart(&mut self, waits: bool) {
        self.governor = None;
        self.begins = (!waits).then_some(0.0);
        if let Some(replanning) = &mut self.replanning {
            self.trajectory = replanning.restart();
        }
    }

    /// Makes what it needs of `controller`, so that no cycle allocates.
    pub(super) fn reserve(&self, controller: &mut Controller<S::State, D, M>) {
        if let Some(joints) = self.joints() {
            controller.reserve_plan(joints);
        }
    }

    /// Whether it has begun.
    pub(super) fn has_begun(&self) -> bool {
        self.begins.is_some()
    }

    /// Why a robot with these joints and this end effector is too far from its beginning.
    pub(super) fn missed_start(
        &self,
        q: &[f64],
        pose: &S::Pose,
        gains: &Gains<M>,
    ) -> Option<MissedStart> {
        if let Some(joints) = self.joints() {
            let pairs = q.iter().zip(joints.first()).enumerate();
            let mut far = pairs.filter(|(i, (q, first))| gains.way(*i, **q, **first).abs() > NEAR);
            return far.next().map(|(joint, (q, first))| MissedStart::Joint {
                joint,
                q: *q,
                first: *first,
            });
        }
        let begins = self.trajectory.at(0.0).x;
        let [off, usual] = [pose, &self.start].map(|pose| {
            let error = pose.error(&begins);
            [error.rows(0, D).norm(), error.rows(D, M - D).norm()]
        });
        let is_far = |i: usize| off[i] > usual[i] + NEARLY_THERE[i];
        (is_far(0) || is_far(1)).then_some(MissedStart::EndEffector { off, usual })
    }

    /// Comes to time `t` \[s\] of the loop. It begins `blend` \[s\] after the first state of a loop that is watched over, and rests at
    /// its start until then.
    pub(super) fn go_to(
        &mut self,
        t: f64,
        blend: f64,
        controller: &mut Controller<S::State, D, M>,
    ) {
        let since = t - *self.begins.get_or_insert(t + blend);
        let settings = controller.gains().governor;
        match &mut self.governor {
            Some(governor) => governor.begin(since),
            none => *none = settings.map(|given| Governor::new(given, since.max(0.0))),
        }
        self.move_posture(t, controller);
    }

    /// Moves the posture of `controller` to where the plan has it at time `t` \[s\] of the loop.
    pub(super) fn move_posture(&self, t: f64, controller: &mut Controller<S::State, D, M>) {
        match self.trajectory.joints() {
            Some(joints) => controller.move_posture(joints, &self.pace(self.since(t))),
            None => controller.leave_plan(),
        }
    }

    /// For how long it has been followed at time `t` \[s\] of the loop; less than 0 as long as it has not begun.
    fn since(&self, t: f64) -> f64 {
        self.begins.map_or(f64::NEG_INFINITY, |begins| t - begins)
    }

    /// Its clock at `t` \[s\] after its beginning, were the error to stay.
    fn pace(&self, t: f64) -> Pace {
        match &self.governor {
            _ if t < 0.0 => Pace { time: 0.0, speed: 0.0, change: 0.0 },
            Some(governor) => governor.pace(t),
            None => Pace::of_time(t),
        }
    }

    /// Where it is in its own time \[s\] at time `t` \[s\] of the loop.
    pub(super) fn path_time(&self, t: f64) -> f64 {
        self.pace(self.since(t)).time
    }

    /// Where it puts the end effector at time `t` \[s\] of the loop.
    pub(super) fn at(&self, t: f64) -> Sample<S::Pose, M> {
        let t = self.since(t);
        match &self.governor {
            _ if t < 0.0 => Sample::at_rest(self.trajectory.at(0.0).x),
            Some(governor) => governor.sample(&self.trajectory, t),
            None => self.trajectory.at(t),
        }
    }

    /// From now on the arm is `arm`, in the state of `robot`, which becomes the one before: other plans are for it.
    pub(super) fn exchange_arm(&mut self, arm: &Arc<S::Arm>, robot: &mut S::State) {
        if let Some(replanning) = &mut self.replanning {
            replanning.exchange_arm(arm, robot);
        }
    }

    /// Looks at what `controller` has made of it at time `t` \[s\] of the loop, and `since` \[s\] after the obstacles in `world` have
    /// begun to move: whether it has to wait, and whether another plan is needed.
    pub(super) fn look(
        &mut self,
        [t, since]: [f64; 2],
        controller: &Controller<S::State, D, M>,
        world: &World<S::Geometry, D>,
    ) {
        let pace = self.pace(self.since(t));
        let error = &controller.followed_error();
        if let Some(governor) = &mut self.governor {
            governor.hear(self.trajectory.way_off::<D>(error, pace.time));
        }
        let Self { trajectory, replanning: Some(replanning), .. } = self else { return };
        let q = controller.robot().configuration();
        let (law, reference) = (controller.gains(), &*trajectory);
        let posture = &law.posture;
        let moment = Moment { t, since, pace, q, posture, error, reference, world, law };
        if let Some(found) = replanning.look(&moment) {
            *trajectory = found;
        }
    }
}
