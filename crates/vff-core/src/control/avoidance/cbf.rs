//! `cbf`: which pairs the program of [`Barrier`] is to keep apart.

use super::barrier::{self, Barrier, Kept, TaskWeight};
use super::{Situation, Way};
use crate::control::deadline::LeftOut;
use crate::control::distance::OwnPair;
use crate::control::force::is_pressed;
use crate::control::settings::SelfCollision;
use crate::control::{Gains, Torque};
use crate::geometry::Body;
use crate::math::Vector;
use crate::robot::Robot;
use crate::trajectory::{JointSpline, Pace};
use crate::world::{CollisionQuery, Contact, PairMargin};
use std::cell::Cell;

/// The pairs near the arm, and the program.
#[derive(Debug, Clone)]
pub struct Cbf<const D: usize, const M: usize> {
    /// W_x (T69).
    weight: TaskWeight<M>,
    /// How near a pair matters \[m\].
    activation: f64,
    pairs: Vec<Contact<D>>,
    /// Those of the arm's own bodies, and the most there may be: none, if they may touch each other.
    own: Vec<OwnPair<D>>,
    most_own: usize,
    /// The bodies, or capsules around them, gathered where they are measured against each other.
    bodies: Vec<Body<'static, D>>,
    most_bodies: usize,
    barrier: Barrier,
    slack: f64,
}

impl<const D: usize, const M: usize> Cbf<D, M> {
    /// For the joints of `robot`.
    pub fn new<R: Robot<D>>(gains: &Gains<M>, robot: &R) -> Self {
        let settings = &gains.yielding;
        let keeps_apart = gains.self_collision == SelfCollision::Avoid;
        Self {
            weight: TaskWeight::new::<D>(settings, &gains.metric::<D>()),
            activation: barrier::activation::<D>(settings),
            pairs: vec![],
            own: vec![],
            most_own: if keeps_apart { OwnPair::most_features(robot) } else { 0 },
            bodies: vec![],
            most_bodies: if keeps_apart { robot.body_count() } else { 0 },
            barrier: Barrier::new(robot, gains).moved_as(gains),
            slack: 0.0,
        }
    }

    /// Changes a torque so that limits are kept, and distances where it `spares_distances`; by how much these are violated.
    fn solve<R: Robot<D>>(
        &mut self,
        situation: &Situation<'_, R, D, M>,
        spares_distances: bool,
        torque: &mut Torque,
    ) -> f64 {
        let Situation { robot, space, bias, range, ends, .. } = *situation;
        let Self { weight, pairs, own, barrier, .. } = self;
        let kept = if spares_distances {
            Kept { pairs, own, range, ends }
        } else {
            Kept { pairs: &[], own: &[], range, ends }
        };
        barrier.act(robot, space, &weight.at(robot), kept, bias, torque)
    }

    /// Takes in the pairs of the arm's own bodies that are near each other.
    fn measure_bodies<R: Robot<D>>(&mut self, robot: &R) {
        let Self { activation, own, bodies, .. } = self;
        let reach = activation.min(barrier::OWN_REACH);
        OwnPair::for_each_within(robot, bodies, reach, |pair| {
            pair.for_each_feature(robot, reach, |feature| {
                if feature.nearest.distance < reach {
                    own.push(*feature);
                }
            });
            reach
        });
    }
}

impl<const D: usize, const M: usize> Way<D, M> for Cbf<D, M> {
    fn reserve(&mut self, pairs: usize) {
        self.pairs.clear();
        self.pairs.reserve(pairs);
        self.own.clear();
        self.own.reserve(self.most_own);
        self.bodies.clear();
        self.bodies.reserve(self.most_bodies);
        self.barrier.reserve(pairs + self.most_own);
    }

    fn observe<R: Robot<D>>(
        &mut self,
        robot: &R,
        surroundings: &mut impl CollisionQuery<D>,
        pressed: Option<&Vector<D>>,
    ) {
        let bodies = robot.bodies();
        let hulls = robot.bodies().filter(|body| body.hull.is_some()).count();
        let of_hulls = if hulls > 0 { hulls * surroundings.hull_barrier_count() } else { 0 };
        self.reserve((robot.body_count() - hulls) * surroundings.barrier_count() + of_hulls);
        if self.most_own > 0 {
            self.measure_bodies(robot);
        }
        let Self { activation, pairs, barrier, .. } = self;
        let reach =
            *activation + PairMargin::farther(surroundings.most_margin(), barrier.margins.usual());
        let velocity = |link: usize, point: &Vector<D>| robot.point_velocity(link, point);
        let coarsened = Cell::new(0);
        let outlook = barrier.outlook(&velocity, &coarsened);
        surroundings.for_each_needed(bodies, reach, &outlook, |pair| {
            if !is_pressed(robot, pressed, pair) {
                pairs.push(*pair);
            }
        });
        barrier.left_out.points += coarsened.get();
    }

    fn keep(&mut self, plan: Option<(&JointSpline, &Pace)>) {
        self.barrier.margins.go_to(plan);
    }

    fn act<R: Robot<D>>(&mut self, situation: &Situation<'_, R, D, M>, torque: &mut Torque) {
        self.slack = self.solve(situation, true, torque);
    }

    fn confine<R: Robot<D>>(
        &mut self,
        situation: &Situation<'_, R, D, M>,
        spares_distances: bool,
        torque: &mut Torque,
    ) {
        self.solve(situation, spares_distances, torque);
    }

    fn slack(&self) -> Option<f64> {
        Some(self.slack)
    }

    fn program(&self) -> Option<&Barrier> {
        Some(&self.barrier)
    }

    fn forget(&mut self) {
        self.barrier.left_out = LeftOut::default();
    }
}
