//! `priority`: along the shortest way out of an obstacle the distance comes first (T65, T66).
//!
//! What it adds for one distance after the other is desired. Where limits of the drives or of joints leave no room for all of it,
//! the program that keeps them has the same distances as constraints.

use super::margins::Margins;
use super::{Situation, Way};
use crate::control::distance::DistanceRate;
use crate::control::force::is_pressed;
use crate::control::{Gains, Torque, Yielding};
use crate::interrupt;
use crate::math::{Vector, dot, smoothstep};
use crate::robot::Robot;
use crate::trajectory::{JointSpline, Pace};
use crate::world::{CollisionQuery, Contact, PairMargin};

/// k where it is not given \[1/s\]: the torque changes with k², and no QP limits it.
pub const RATE: f64 = 20.0;

/// The pairs near the arm, and a workspace.
#[derive(Debug, Clone)]
pub(crate) struct Priority<const D: usize> {
    settings: Yielding,
    /// k \[1/s\].
    rate: f64,
    margins: Margins,
    pairs: Vec<Contact<D>>,
    gradient: Vec<f64>,
    response: Vec<f64>,
    acceleration: Vec<f64>,
    /// q̈ at present, behind a limit of the torque rate.
    present: Vec<f64>,
    scratch: Vec<f64>,
    /// Mobility along n̂ \[1/kg\] below which a point counts as hardly movable.
    threshold: f64,
}

impl<const D: usize> Priority<D> {
    /// For the joints of `robot`.
    pub fn new<R: Robot<D>, const M: usize>(gains: &Gains<M>, robot: &R) -> Self {
        let zeros = || vec![0.0; robot.dof()];
        Self {
            margins: Margins::new(robot.dof(), &gains.yielding),
            settings: gains.yielding.clone(),
            rate: gains.yielding.rate.unwrap_or(RATE),
            pairs: vec![],
            gradient: zeros(),
            response: zeros(),
            acceleration: zeros(),
            present: zeros(),
            scratch: zeros(),
            threshold: gains.singularity / robot.total_mass(),
        }
    }
}

impl<const D: usize, const M: usize> Way<D, M> for Priority<D> {
    fn reserve(&mut self, pairs: usize) {
        self.pairs.clear();
        self.pairs.reserve(pairs);
    }

    fn observe<R: Robot<D>>(
        &mut self,
        robot: &R,
        surroundings: &mut impl CollisionQuery<D>,
        pressed: Option<&Vector<D>>,
    ) {
        Way::<D, M>::reserve(self, robot.body_count() * surroundings.contact_count());
        let Self { settings, margins, pairs, .. } = self;
        let reach =
            settings.outer + PairMargin::farther(surroundings.most_margin(), margins.usual());
        let visit = |pair: &Contact<D>| {
            if !is_pressed(robot, pressed, pair) {
                pairs.push(*pair);
            }
        };
        surroundings.for_each_contact(robot.bodies(), reach, |_, _| {}, visit);
    }

    fn keep(&mut self, plan: Option<(&JointSpline, &Pace)>) {
        self.margins.go_to(plan);
    }

    fn distances(&self) -> Option<&[Contact<D>]> {
        Some(&self.pairs)
    }

    fn rate(&self) -> Option<f64> {
        Some(self.rate)
    }

    /// Pair by pair, from the base outwards: what d̈ is short of is added along n̂, with everything across it
    /// left as it was. The order is fixed, so that nothing jumps when another pair becomes nearest.
    fn act<R: Robot<D>>(&mut self, situation: &Situation<'_, R, D, M>, torque: &mut Torque) {
        let Situation { robot, bias, range, .. } = *situation;
        let k = self.rate;
        let Self {
            settings,
            margins,
            pairs,
            gradient,
            response,
            acceleration,
            present,
            scratch,
            threshold,
            ..
        } = self;
        if pairs.is_empty() {
            return;
        }
        robot.accelerate(&torque.total, bias, scratch, acceleration);
        if let Some(range) = range {
            robot.accelerate(&range.present, bias, scratch, present);
        }
        for pair in &*pairs {
            interrupt::checkpoint(64 + 16 * gradient.len());
            let distance = pair.margin.as_usual(pair.distance, margins.usual());
            let share = smoothstep((settings.outer - distance) / (settings.outer - settings.inner));
            let motion = DistanceRate::cautious(robot, pair);
            let (height, motion) = margins.above(pair, motion);
            robot.point_jacobian_tr_mul(pair.link, &pair.point, &pair.normal, gradient);
            let wanted = match range {
                None => -2.0 * k * motion.rate - k * k * height,
                Some(range) => {
                    let now = [height, motion.rate, dot(gradient, present) + motion.bias];
                    range.least_distance_acceleration(robot, now, gradient, response, k)[0]
                }
            };
            let missing = wanted - motion.bias - dot(gradient, acceleration);
            if missing <= 0.0 {
                continue;
            }
            robot.mass_solve(gradient, response);
            let force = share * missing / (dot(gradient, response) + *threshold);
            torque.add_to_task(|i| gradient[i] * force);
            acceleration.iter_mut().zip(response.iter()).for_each(|(a, y)| *a += y * force);
        }
    }
}
