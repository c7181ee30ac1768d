//! How the distance of two bodies of the arm itself changes.

use super::DistanceRate;
use crate::interrupt;
use crate::math::{Body, Capsule, Nearest, Vector, nearest};
use crate::robot::Robot;

/// Two bodies of a robot, or parts of them, where they come nearest.
#[derive(Debug, Clone, Copy)]
pub struct OwnPair<const D: usize> {
    /// The links that carry them; None is the base, which does not move.
    pub links: [Option<usize>; 2],
    /// Their shapes.
    pub shapes: [Capsule<D>; 2],
    /// Where they come nearest.
    pub nearest: Nearest<D>,
}

impl<const D: usize> OwnPair<D> {
    /// Of two bodies.
    pub fn new(links: [Option<usize>; 2], shapes: [Capsule<D>; 2]) -> Self {
        Self { links, shapes, nearest: nearest(&shapes[0], &shapes[1]) }
    }

    /// The most features of a pair.
    pub const FEATURES: usize = 5;

    /// Visits the pairs of bodies of `robot` that must not touch and are nearer than `limit` \[m\], and perhaps some that are
    /// farther apart; `visit` returns the limit from then on. `bodies` is a workspace.
    pub fn for_each_within<R: Robot<D>>(
        robot: &R,
        bodies: &mut Vec<Body<D>>,
        mut limit: f64,
        mut visit: impl FnMut(&Self) -> f64,
    ) {
        bodies.clear();
        bodies.extend(robot.bodies());
        let still = robot.still_bodies();
        let shape = |i: usize| bodies.get(i).map_or_else(|| still[i - bodies.len()], |b| b.shape);
        let link = |i: usize| bodies.get(i).map(|body| body.link);
        let middle = |shape: &Capsule<D>| shape.start + shape.direction * (0.5 * shape.length);
        for pair in robot.body_pairs() {
            interrupt::spend(8);
            let [a, b] = pair.map(shape);
            let size = 0.5 * (a.length + b.length) + a.radius + b.radius;
            // False where something is undefined.
            if (middle(&a) - middle(&b)).norm() - size > limit {
                continue;
            }
            limit = visit(&Self::new(pair.map(link), [a, b]));
        }
    }

    /// ḋ \[m/s\].
    #[inline]
    pub fn rate<R: Robot<D>>(&self, robot: &R) -> f64 {
        self.nearest.normal.dot(&(self.velocity(robot, 0) - self.velocity(robot, 1)))
    }

    /// `out` ← (J_a − J_b)ᵀn̂, with the Jacobians of the two points.
    #[inline]
    pub fn gradient<R: Robot<D>>(&self, robot: &R, out: &mut [f64], scratch: &mut [f64]) {
        let Nearest { points, normal, .. } = &self.nearest;
        let column = |k: usize, out: &mut [f64]| match self.links[k] {
            Some(link) => robot.point_jacobian_tr_mul(link, &points[k], normal, out),
            None => out.fill(0.0),
        };
        column(1, scratch);
        column(0, out);
        out.iter_mut().zip(scratch).for_each(|(a, b)| *a -= *b);
    }

    /// ḋ, and the bias of d̈ = gradient · q̈ + bias.
    pub fn motion<R: Robot<D>>(&self, robot: &R) -> DistanceRate {
        let Self { links, shapes, nearest } = self;
        let Nearest { points, normal, .. } = nearest;
        let bias = |k: usize| {
            let of = |link| robot.point_bias_acceleration(link, &points[k]);
            links[k].map_or_else(Vector::zeros, of)
        };
        let turning = [0, 1].map(|k| {
            let ahead = points[k] + shapes[k].direction;
            let of = |link| robot.point_velocity(link, &ahead) - self.velocity(robot, k);
            links[k].map_or_else(Vector::zeros, of)
        });
        let velocity = self.velocity(robot, 0) - self.velocity(robot, 1);
        let sliding = nearest.sliding([&shapes[0], &shapes[1]], &velocity, turning);
        DistanceRate {
            rate: normal.dot(&velocity),
            bias: normal.dot(&(bias(0) - bias(1))) + sliding,
        }
    }

    /// The distances of all features that may be the least when features change hands: of the ends of each from the other,
    /// and of the insides where these are nearest. Parallel axes are held at both ends that way (T98).
    pub fn for_each_feature(&self, mut visit: impl FnMut(&Self)) {
        if self.nearest.slides == [true; 2] {
            visit(self);
        }
        for k in 0..2 {
            let shape = &self.shapes[k];
            let ends = [shape.start, shape.end()];
            // A ball is one end.
            for end in &ends[..if shape.length > 0.0 { 2 } else { 1 }] {
                let mut shapes = self.shapes;
                shapes[k] = Capsule { start: *end, length: 0.0, ..*shape };
                visit(&Self::new(self.links, shapes));
            }
        }
    }

    fn velocity<R: Robot<D>>(&self, robot: &R, k: usize) -> Vector<D> {
        let of = |link| robot.point_velocity(link, &self.nearest.points[k]);
        self.links[k].map_or_else(Vector::zeros, of)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{Differences, differences};
    use super::*;
    use crate::robot::models;
    use crate::robot::{Model, PlanarArm, SpatialArm, SpatialState, planar::Link};
    use proptest::prelude::*;
    use std::sync::Arc;

    proptest! {
        /// Two links of a planar arm that share no joint: ḋ and the bias are those of the distance along the
        /// motion with q̈ = 0.
        #[test]
        fn between_links_of_the_plane(
            q in prop::collection::vec(-2.0..2.0, 5), dq in prop::collection::vec(-2.0..2.0, 5),
            pair in prop::sample::select(vec![[0, 2], [0, 3], [1, 4], [0, 4], [2, 4]]),
        ) {
            let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.7, 1.0); 5], Vector::<2>::zeros()));
            let at = |t: f64| {
                let mut state = arm.state();
                let q: Vec<f64> = q.iter().zip(&dq).map(|(q, dq)| q + t * dq).collect();
                state.update(&q, &dq);
                state
            };
            let h = 1e-4;
            let found = |t: f64| {
                let state = at(t);
                nearest(&state.body(pair[0]).shape, &state.body(pair[1]).shape)
            };
            let [before, now, after] = [found(-h), found(0.0), found(h)];
            prop_assume!(before.slides == now.slides && after.slides == now.slides);
            prop_assume!((before.points[0] - after.points[0]).norm() < 1e-2);
            prop_assume!(now.distance > 0.05);
            let state = at(0.0);
            let shapes = pair.map(|i| state.body(i).shape);
            let motion = OwnPair::new(pair.map(Some), shapes).motion(&state);
            let slope = (after.distance - before.distance) / (2.0 * h);
            let curvature = (after.distance - 2.0 * now.distance + before.distance) / (h * h);
            prop_assert!((motion.rate - slope).abs() < 1e-4 * (1.0 + slope.abs()));
            prop_assert!((motion.bias - curvature).abs() < 1e-3 * (1.0 + curvature.abs()),
                "{motion:?} {curvature} {:?}", now.slides);
        }
    }

    /// All pairs of a Panda that must not touch, its base among them.
    fn pairs(state: &SpatialState) -> Vec<OwnPair<3>> {
        let mut found = vec![];
        OwnPair::for_each_within(state, &mut vec![], f64::INFINITY, |pair| {
            found.push(*pair);
            f64::INFINITY
        });
        found
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Links of an arm in space, from each other and from the base: the gradient and the bias are those of the distance
        /// along a motion, for every feature; the least of the features is the distance.
        #[test]
        fn between_links_in_space(
            q in prop::collection::vec(-1.5..1.5, 7), dq in prop::collection::vec(-2.0..2.0, 7),
            ddq in prop::collection::vec(-2.0..2.0, 7),
        ) {
            let arm: Arc<SpatialArm> = Arc::new(models::named("panda").unwrap().build().unwrap());
            let at = |t: f64| {
                let mut state = arm.state();
                let parts = q.iter().zip(&dq).zip(&ddq);
                let q: Vec<f64> = parts.map(|((q, dq), a)| q + t * (dq + 0.5 * t * a)).collect();
                let dq: Vec<f64> = dq.iter().zip(&ddq).map(|(dq, a)| dq + t * a).collect();
                state.update(&q, &dq);
                state
            };
            let h = 2e-4;
            let states = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| at(k * h));
            let features = |pair: &OwnPair<3>| {
                let mut found = vec![];
                pair.for_each_feature(|feature| found.push(*feature));
                found
            };
            let found = states.each_ref().map(pairs);
            prop_assert!(found[2].iter().any(|pair| pair.links[1].is_none()));
            for (k, pair) in found[2].iter().enumerate() {
                let own = found.each_ref().map(|pairs| features(&pairs[k]));
                prop_assert!(own[2].len() <= OwnPair::<3>::FEATURES);
                let least = own[2].iter().map(|f| f.nearest.distance).fold(f64::INFINITY, f64::min);
                prop_assert!((least - pair.nearest.distance).abs() < 1e-12, "{pair:?}");
                for (i, feature) in own[2].iter().enumerate() {
                    let count = own[2].len();
                    let same = |own: &Vec<OwnPair<3>>| {
                        own.len() == count && own[i].nearest.slides == feature.nearest.slides
                    };
                    let same = own.iter().all(same);
                    let axes = feature.nearest.distance + feature.shapes[0].radius + feature.shapes[1].radius;
                    if !same || axes < 0.05 {
                        continue;
                    }
                    let d: Vec<f64> = own.iter().map(|own| own[i].nearest.distance).collect();
                    let Differences { rate, second, curved, .. } = differences(&d, h);
                    let motion = feature.motion(&states[2]);
                    let (mut gradient, mut scratch) = (vec![0.0; 7], vec![0.0; 7]);
                    feature.gradient(&states[2], &mut gradient, &mut scratch);
                    let along: f64 = gradient.iter().zip(&ddq).map(|(g, a)| g * a).sum();
                    prop_assert!((motion.rate - rate).abs() < 1e-6 * (1.0 + rate.abs()) + h * curved);
                    prop_assert!((motion.rate - feature.rate(&states[2])).abs() < 1e-14);
                    let error = (along + motion.bias - second).abs();
                    prop_assert!(error < 1e-4 * (1.0 + second.abs()) + 0.5 * curved, "{error} {feature:?}");
                }
            }
        }
    }
}
