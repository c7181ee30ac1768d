//! What to do where the null space is not enough: three strategies that let the end effector give way.
//!
//! [`relaxed`] releases the task while an obstacle is near, [`priority`] overrules it along the shortest way out,
//! [`barrier`] finds the nearest acceleration that keeps every distance, and [`preview`] looks ahead on top of that.
//! All three start from the torque of the null-space law.

pub mod barrier;
pub mod preview;
pub mod priority;
pub mod relaxed;

use super::distance::OwnPair;
use super::settings::SelfCollision;
use super::{
    Avoidance, Gains, OperationalSpace, TaskMetric, Torque, TorqueRange, VirtualForces, limits,
};
use crate::geometry::Body;
use crate::math::Vector;
use crate::robot::Robot;
use crate::world::{CollisionQuery, Contact};
use barrier::{Barrier, Kept};
use nalgebra::SMatrix;
use preview::PreviewSettings;
use priority::Priority;
use serde::Deserialize;

/// How the end effector yields: the `[controller.yielding]` table of a scenario.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Yielding {
    /// δ \[m\] > 0, the distance that `priority` and `cbf` keep.
    pub margin: f64,
    /// k \[1/s\] > 0, how fast a distance may fall to the margin (T65): by default [`priority::RATE`] or
    /// [`barrier::RATE`].
    pub rate: Option<f64>,
    /// d₁ \[m\] ≥ 0: below this distance the task gives way altogether, in `relaxed` and `priority`.
    pub inner: f64,
    /// d₂ \[m\] > d₁: from this distance on it does not give way.
    pub outer: f64,
    /// e_max \[m\] > 0: a larger error pulls no harder than this one, in `relaxed`.
    pub saturation: f64,
    /// Pairs nearer than this \[m\], > 0, are rows of the quadratic program (QP) of `cbf`. This and the next two have other
    /// defaults in the plane than in space.
    pub activation: Option<f64>,
    /// W_x > 0 \[kg\], the weight of the end effector's acceleration in `cbf`.
    pub task_weight: Option<f64>,
    /// What of a pose gives way last in `cbf`; by default position and orientation alike.
    pub keep: Option<Keep>,
    /// ρ > 0, the weight of a violated row.
    pub slack_price: Option<f64>,
    /// Largest joint speed \[rad/s\], > 0, in `cbf`, where the arm has no velocity limits of its own.
    pub speed: f64,
    /// Look-ahead on top of `cbf`; none by default.
    pub preview: Option<PreviewSettings>,
}

/// What of the pose of the end effector gives way last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Keep {
    /// The orientation gives way first.
    Position,
    /// The position gives way first.
    Orientation,
}

impl Default for Yielding {
    fn default() -> Self {
        Self {
            margin: 0.02,
            rate: None,
            inner: 0.05,
            outer: 0.3,
            saturation: 0.5,
            activation: None,
            task_weight: None,
            keep: None,
            slack_price: None,
            speed: 6.0,
            preview: None,
        }
    }
}

impl Yielding {
    /// Largest speed of every joint \[rad/s\]: that of the arm, or else `speed`.
    fn joint_speeds<R: Robot<D>, const D: usize>(&self, robot: &R) -> Vec<f64> {
        let limits = &robot.limits().velocity;
        if limits.is_empty() { vec![self.speed; robot.dof()] } else { limits.clone() }
    }
}

/// What changes the torque of the null-space law: one of the three strategies, or limits of what can be sent, with its workspace.
#[derive(Debug, Clone)]
pub struct Avoider<const D: usize, const M: usize> {
    settings: Yielding,
    metric: TaskMetric<M>,
    /// W_x (T69).
    weight: SMatrix<f64, M, M>,
    /// How near a pair matters \[m\].
    reach: f64,
    /// The pairs that matter at the observed state; of `cbf` the barriers.
    pairs: Vec<Contact<D>>,
    /// Those of the arm's own bodies, of `cbf`, and the most there may be: none, if they may touch each other.
    own: Vec<OwnPair<D>>,
    most_own: usize,
    /// The bodies, or capsules around them, gathered where they are measured against each other.
    bodies: Vec<Body<'static, D>>,
    strategy: Strategy,
    /// The QP: of `cbf`, and for the limits that the others do not know.
    barrier: Option<Barrier>,
    slack: f64,
}

#[derive(Debug, Clone)]
enum Strategy {
    /// The task always wins, as far as the drives let it.
    Task,
    Relaxed,
    Priority(Priority),
    Barrier,
}

impl<const D: usize, const M: usize> Avoider<D, M> {
    /// What `gains` ask for on `robot`; nothing if the task always wins and the torque may change as fast as it likes.
    pub fn new<R: Robot<D>>(gains: &Gains<M>, robot: &R) -> Option<Box<Self>> {
        let Gains { yielding: settings, singularity, .. } = gains;
        let metric = gains.metric::<D>();
        let is_limited = gains.enforce_limits && !robot.limits().torque.is_empty();
        let has_rate = gains.command.torque_rate.is_some();
        let strategy = match gains.avoidance {
            Avoidance::NullSpace if !has_rate => return None,
            Avoidance::NullSpace => Strategy::Task,
            Avoidance::Relaxed => Strategy::Relaxed,
            Avoidance::Priority => {
                Strategy::Priority(Priority::new(robot.dof(), singularity / robot.total_mass()))
            }
            Avoidance::Cbf => Strategy::Barrier,
        };
        let has_barrier = matches!(strategy, Strategy::Barrier) || is_limited || has_rate;
        let keeps_apart =
            gains.self_collision == SelfCollision::Avoid && gains.avoidance == Avoidance::Cbf;
        let most_own = if keeps_apart { OwnPair::most_features(robot) } else { 0 };
        Some(Box::new(Self {
            settings: settings.clone(),
            weight: barrier::weight::<D, M>(settings, &metric),
            metric,
            reach: match gains.avoidance {
                Avoidance::Cbf => barrier::activation::<D>(settings),
                _ => settings.outer,
            },
            pairs: vec![],
            own: vec![],
            most_own,
            bodies: Vec::with_capacity(if keeps_apart { robot.body_count() } else { 0 }),
            strategy,
            barrier: has_barrier.then(|| match gains.avoidance {
                Avoidance::Cbf => Barrier::new(robot, settings),
                _ => Barrier::new(robot, settings).without_speeds(robot),
            }),
            slack: 0.0,
        }))
    }

    /// By how much the last command violates the barriers at most \[m/s²\]; None if there are none.
    pub fn slack(&self) -> Option<f64> {
        matches!(self.strategy, Strategy::Barrier).then_some(self.slack)
    }

    /// Whether the end effector may give way.
    pub fn yields(&self) -> bool {
        !matches!(self.strategy, Strategy::Task)
    }

    /// Forgets the pairs and makes room for so many: all may come near later, and nothing must allocate then.
    pub fn reserve(&mut self, count: usize) {
        let Self { pairs, own, most_own, strategy, barrier, .. } = self;
        pairs.clear();
        let mut rows = 0;
        match strategy {
            Strategy::Task | Strategy::Relaxed => {}
            Strategy::Priority(_) => pairs.reserve(count),
            Strategy::Barrier => {
                pairs.reserve(count);
                own.clear();
                own.reserve(*most_own);
                rows = count + *most_own;
            }
        }
        if let Some(barrier) = barrier {
            barrier.reserve(rows);
        }
    }

    /// Takes in the pairs near `robot`.
    pub fn observe<R: Robot<D>>(&mut self, robot: &R, surroundings: &mut impl CollisionQuery<D>) {
        let bodies = robot.bodies();
        let most = match self.strategy {
            Strategy::Barrier => surroundings.barrier_count(),
            _ => surroundings.contact_count(),
        };
        let hulls = robot.bodies().filter(|body| body.hull.is_some()).count();
        let rows = match self.strategy {
            Strategy::Barrier if hulls > 0 => {
                (robot.body_count() - hulls) * most + hulls * surroundings.hull_barrier_count()
            }
            _ => robot.body_count() * most,
        };
        self.reserve(rows);
        if self.most_own > 0 {
            self.measure_bodies(robot);
        }
        let Self { reach, pairs, strategy, .. } = self;
        let visit = |pair: &Contact<D>| pairs.push(*pair);
        match strategy {
            Strategy::Task | Strategy::Relaxed => {}
            Strategy::Priority(_) => {
                surroundings.for_each_contact(bodies, *reach, |_, _| {}, visit);
            }
            Strategy::Barrier => surroundings.for_each_barrier(bodies, *reach, visit),
        }
    }

    /// Takes in the pairs of the arm's own bodies that are near each other.
    fn measure_bodies<R: Robot<D>>(&mut self, robot: &R) {
        let Self { reach, own, bodies, .. } = self;
        let reach = reach.min(barrier::OWN_REACH);
        OwnPair::for_each_within(robot, bodies, reach, |pair| {
            pair.for_each_feature(robot, reach, |feature| {
                if feature.nearest.distance < reach {
                    own.push(*feature);
                }
            });
            reach
        });
    }

    /// The error that the stiffness of the task is to act on, at these distances of the links \[m\].
    pub fn pull(&self, clearance: &[f64], e: Vector<M>) -> Vector<M> {
        match self.strategy {
            Strategy::Relaxed => {
                let lambda = relaxed::activation(&self.settings, clearance);
                relaxed::pull(&self.settings, &self.metric, e, lambda)
            }
            _ => e,
        }
    }

    /// Changes the torque of the null-space law into one that gives way, and that can be sent: in `range` behind a limit of the
    /// torque rate, within the torque limits otherwise.
    pub fn act<R: Robot<D>>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        forces: &VirtualForces<R::Wrench, D>,
        bias: &[f64],
        range: Option<&TorqueRange>,
        torque: &mut Torque,
    ) {
        let Self { settings, weight, pairs, own, strategy, barrier, slack, .. } = self;
        match strategy {
            Strategy::Task | Strategy::Barrier => {}
            Strategy::Relaxed => relaxed::act(settings, robot, space, forces, torque),
            Strategy::Priority(priority) => {
                priority.act(settings, robot, pairs, bias, range, torque);
            }
        }
        let Some(barrier) = barrier else { return };
        if matches!(strategy, Strategy::Barrier) {
            let kept = Kept { pairs, own, range };
            *slack = barrier.act(robot, space, weight, kept, bias, torque);
        } else if range.is_some() || !limits::within(&torque.total, &robot.limits().torque) {
            let kept = Kept { pairs: &[], own: &[], range };
            barrier.act(robot, space, weight, kept, bias, torque);
        }
    }
}
