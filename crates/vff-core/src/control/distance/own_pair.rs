//! How the distance of two bodies of the arm itself changes.

use super::{DistanceRate, FADE};
use crate::geometry::{Body, ContactFeature, MAX_FEATURES};
use crate::interrupt;
use crate::math::{Capsule, Nearest, RELIEF, Vector, nearest, nearest_of_lines, smoothstep};
use crate::robot::{Robot, form_of};

/// Two bodies of a robot, or parts of them, where they come nearest.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::distance::{DistanceRate, OwnPair};
/// use vff_core::robot::{Robot, models};
///
/// let mut arm = Arc::new(models::named("panda").unwrap().build().unwrap()).state();
/// arm.update(&[0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], &[0.1; 7]);
/// let mut nearest: Option<OwnPair<3>> = None;
/// OwnPair::for_each_within(&arm, &mut vec![], f64::INFINITY, |pair| {
///     nearest = Some(pair.clone());
///     pair.nearest.distance // only nearer ones from here on
/// });
/// let pair = nearest.unwrap();
/// let DistanceRate { rate, .. } = pair.motion(&arm);
/// assert!(pair.nearest.distance > 0.0 && (rate - pair.rate(&arm)).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy)]
pub struct OwnPair<const D: usize> {
    /// The links that carry them; None is the base, which does not move.
    pub links: [Option<usize>; 2],
    /// Their shapes.
    pub shapes: [Capsule<D>; 2],
    /// Where they come nearest.
    pub nearest: Nearest<D>,
    /// The numbers of the bodies, of which one or both are hulls; none for two capsules.
    hulls: Option<[usize; 2]>,
}

impl<const D: usize> OwnPair<D> {
    /// The most features of two capsules.
    pub const FEATURES: usize = 5;

    /// Of two capsules.
    pub fn new(links: [Option<usize>; 2], shapes: [Capsule<D>; 2]) -> Self {
        Self { links, shapes, nearest: nearest(&shapes[0], &shapes[1]), hulls: None }
    }

    /// The most features of all pairs of bodies of `robot` that must not touch.
    pub fn most_features<R: Robot<D>>(robot: &R) -> usize {
        let most = |pair: [usize; 2]| {
            let is_hull = |i: &usize| form_of(robot, *i).1.is_some();
            if pair.iter().any(is_hull) { MAX_FEATURES } else { Self::FEATURES }
        };
        robot.body_pairs().map(most).sum()
    }

    /// Visits the pairs of bodies of `robot` that must not touch and are nearer than `limit` \[m\], and perhaps some that are
    /// farther apart; `visit` returns the limit from then on. `bodies` is a workspace.
    pub fn for_each_within<R: Robot<D>>(
        robot: &R,
        bodies: &mut Vec<Body<'static, D>>,
        mut limit: f64,
        mut visit: impl FnMut(&Self) -> f64,
    ) {
        bodies.clear();
        let mut any = robot.still_bodies().iter().any(|still| still.hull.is_some());
        bodies.extend(robot.bodies().map(|body| {
            any |= body.hull.is_some();
            body.enclosing()
        }));
        let still = robot.still_bodies();
        let shape =
            |i: usize| bodies.get(i).map_or_else(|| still[i - bodies.len()].shape, |b| b.shape);
        let link = |i: usize| bodies.get(i).map(|body| body.link);
        let middle = |shape: &Capsule<D>| shape.start + shape.direction * (0.5 * shape.length);
        for pair in robot.body_pairs() {
            interrupt::checkpoint(8);
            let [a, b] = pair.map(shape);
            let size = 0.5 * (a.length + b.length) + a.radius + b.radius;
            // False where something is undefined.
            if (middle(&a) - middle(&b)).norm() - size > limit {
                continue;
            }
            let mut found = Self::new(pair.map(link), [a, b]);
            // Of hulls these are the capsules around them: what is too far apart for those is for them.
            let is_far = found.nearest.distance > limit;
            if any && !is_far {
                found.enter(robot, pair);
            }
            limit = visit(&found);
        }
    }

    /// Takes what is nearest of two bodies in place of the capsules around them, where one is a hull.
    #[inline(never)]
    fn enter<R: Robot<D>>(&mut self, robot: &R, pair: [usize; 2]) {
        robot.for_each_encounter(pair, None, &mut |ContactFeature { shapes, nearest }| {
            interrupt::checkpoint(1024);
            *self =
                Self { shapes: *shapes, nearest: *nearest, hulls: Some(pair), links: self.links };
        });
    }

    /// The links of the pairs of bodies that overlap, but must not touch, in order and each once.
    pub fn overlapping_links<R: Robot<D>>(robot: &R) -> Vec<[Option<usize>; 2]> {
        let mut found = vec![];
        Self::for_each_within(robot, &mut vec![], 0.0, |pair| {
            if pair.nearest.distance < 0.0 {
                let [a, b] = pair.links; // the base, None, is before all links
                found.push([a.min(b), a.max(b)]);
            }
            0.0
        });
        found.sort_unstable();
        found.dedup();
        found
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
        let Self { links, shapes, nearest, .. } = self;
        let Nearest { points, normal, .. } = nearest;
        let bias = |k: usize| {
            let of = |link| robot.point_bias_acceleration(link, &points[k]);
            links[k].map_or_else(Vector::zeros, of)
        };
        let turning = [0, 1].map(|k| self.turning(robot, k));
        let velocity = self.velocity(robot, 0) - self.velocity(robot, 1);
        if let Some(flat) = nearest.flat.iter().position(|flat| *flat) {
            return self.beside_face(robot, flat);
        }
        let sliding = nearest.sliding([&shapes[0], &shapes[1]], &velocity, turning);
        DistanceRate {
            rate: normal.dot(&velocity),
            bias: normal.dot(&(bias(0) - bias(1))) + sliding,
        }
    }

    /// The same for a row of a barrier: where axes or edges are nearly parallel, whose nearest points would run from end to end
    /// at once, the first of them counts as held (T97); the ends and corners are what has to be kept there. Where a nearest
    /// point arrives at an end of its axis, the term with which it slid fades out beyond that (T66).
    pub fn cautious<R: Robot<D>>(&self, robot: &R) -> DistanceRate {
        let exact = self.motion(robot);
        let Nearest { normal, distance, slides, flat, .. } = &self.nearest;
        let [a, b] = &self.shapes;
        if *slides == [false; 2] && *flat == [false; 2] && self.hulls.is_none() {
            let apart = distance + a.radius + b.radius;
            let velocity = self.velocity(robot, 0) - self.velocity(robot, 1);
            let slid = |k: usize| {
                let (t, length) = (&self.shapes[k].direction, self.shapes[k].length);
                let fade = 1.0 - smoothstep(normal.dot(t).abs() / FADE);
                if length <= 0.0 || apart <= 0.0 || fade <= 0.0 {
                    return 0.0;
                }
                let along = t.dot(&velocity) + apart * normal.dot(&self.turning(robot, k));
                fade * along * along / apart
            };
            return DistanceRate { bias: exact.bias - slid(0) - slid(1), ..exact };
        }
        if *slides != [true; 2] {
            return exact;
        }
        let cos = a.direction.dot(&b.direction);
        let sin = (a.direction - b.direction * cos).norm();
        let oblique = smoothstep(sin / FADE).powi(2);
        if oblique >= 1.0 {
            return exact;
        }
        let held = Nearest { slides: [false, true], ..self.nearest };
        let held = Self { nearest: held, ..*self }.motion(robot);
        DistanceRate { bias: oblique * exact.bias + (1.0 - oblique) * held.bias, ..exact }
    }

    /// The same beside a face of body `flat`, whose normal turns with its link: for the place of the other's corner, which the
    /// link of the face sees move (T123).
    fn beside_face<R: Robot<D>>(&self, robot: &R, flat: usize) -> DistanceRate {
        let Nearest { points, normal, .. } = &self.nearest;
        let corner = points[1 - flat];
        let velocity = |k: usize, point: &Vector<D>| {
            self.links[k].map_or_else(Vector::zeros, |link| robot.point_velocity(link, point))
        };
        let bias = |k: usize| {
            let of = |link| robot.point_bias_acceleration(link, &corner);
            self.links[k].map_or_else(Vector::zeros, of)
        };
        let seen = velocity(0, &corner) - velocity(1, &corner);
        let turning = velocity(flat, &(corner + normal)) - velocity(flat, &corner);
        DistanceRate {
            rate: normal.dot(&seen),
            bias: normal.dot(&(bias(0) - bias(1))) + 2.0 * turning.dot(&seen),
        }
    }

    /// The distances of all features that may be the least when features change hands, of hulls those nearer than `reach` \[m\]: of the ends of each from the other,
    /// and of the insides where these are nearest. Parallel axes are held at both ends that way (T98). Of a hull those of
    /// corners, and of edges where they cross.
    pub fn for_each_feature<R: Robot<D>>(
        &self,
        robot: &R,
        reach: f64,
        mut visit: impl FnMut(&Self),
    ) {
        if let Some(pair) = self.hulls {
            interrupt::checkpoint(1024);
            let visit = &mut |ContactFeature { shapes, nearest }: &ContactFeature<D>| {
                visit(&Self { shapes: *shapes, nearest: *nearest, ..*self });
            };
            return robot.for_each_encounter(pair, Some(reach), visit);
        }
        let [a, b] = &self.shapes;
        if let Some((nearest, beyond)) = nearest_of_lines(a, b) {
            // The second counts as thinner by what lies beyond its place (T98).
            let relief = RELIEF * beyond;
            let nearest = Nearest { distance: nearest.distance + relief, ..nearest };
            if nearest.distance < reach {
                let shapes = [*a, Capsule { radius: b.radius - relief, ..*b }];
                visit(&Self { shapes, nearest, ..*self });
            }
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

    /// How the axis of body `k` turns \[1/s\].
    fn turning<R: Robot<D>>(&self, robot: &R, k: usize) -> Vector<D> {
        let ahead = self.nearest.points[k] + self.shapes[k].direction;
        let of = |link| robot.point_velocity(link, &ahead) - self.velocity(robot, k);
        self.links[k].map_or_else(Vector::zeros, of)
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
    use crate::geometry::{PlacedHull, Shape, perpendicular};
    use crate::robot::description::{ArmDescription, Joint, LinkShape, PlacedShape};
    use crate::robot::spatial::cases::link;
    use crate::robot::{Model, PlanarArm, SpatialArm, SpatialState, models, planar::Link};
    use crate::world::space::{Obstacle, Shape as ObstacleShape, World};
    use proptest::prelude::*;
    use std::cell::RefCell;
    use std::collections::HashMap;
    use std::sync::Arc;

    properties! {
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

    /// The arm at time t of the motion q + q̇t + ½q̈t².
    fn moved(arm: &Arc<SpatialArm>, [q, dq, ddq]: [&Vec<f64>; 3], t: f64) -> SpatialState {
        let mut state = arm.state();
        let parts = q.iter().zip(dq).zip(ddq);
        let q: Vec<f64> = parts.map(|((q, dq), a)| q + t * (dq + 0.5 * t * a)).collect();
        let dq: Vec<f64> = dq.iter().zip(ddq).map(|(dq, a)| dq + t * a).collect();
        state.update(&q, &dq);
        state
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

    properties! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// Links of an arm in space, from each other and from the base: the gradient and the bias are those of the distance
        /// along a motion, for every feature; the least of the features is the distance.
        #[test]
        fn between_links_in_space(
            q in prop::collection::vec(-1.5..1.5, 7), dq in prop::collection::vec(-2.0..2.0, 7),
            ddq in prop::collection::vec(-2.0..2.0, 7),
        ) {
            let arm: Arc<SpatialArm> = Arc::new(models::named("panda").unwrap().build().unwrap());
            let h = 2e-4;
            let states = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| moved(&arm, [&q, &dq, &ddq], k * h));
            let features = |state: &SpatialState, pair: &OwnPair<3>| {
                let mut found = vec![];
                pair.for_each_feature(state, f64::INFINITY, |feature| found.push(*feature));
                found
            };
            let found = states.each_ref().map(pairs);
            prop_assert!(found[2].iter().any(|pair| pair.links[1].is_none()));
            for (k, pair) in found[2].iter().enumerate() {
                let own = [0, 1, 2, 3, 4].map(|i| features(&states[i], &found[i][k]));
                prop_assert!(own[2].len() <= OwnPair::<3>::FEATURES);
                let least = own[2].iter().map(|f| f.nearest.distance).fold(f64::INFINITY, f64::min);
                prop_assert!((least - pair.nearest.distance).abs() < 1e-12, "{pair:?}");
                for (i, feature) in own[2].iter().enumerate() {
                    let count = own[2].len();
                    let same = |own: &Vec<OwnPair<3>>| {
                        own.len() == count && own[i].nearest.slides == feature.nearest.slides
                    };
                    // What lies beyond its place only releases a row.
                    let radius = pair.shapes[1].radius;
                    let released = |own: &Vec<OwnPair<3>>| own[i].shapes[1].radius < radius;
                    let same = own.iter().all(same) && !own.iter().any(released);
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

    /// A Panda of boxes, hulls and capsules in turn.
    fn of_hulls() -> Arc<SpatialArm> {
        let mut description = models::named("panda").unwrap();
        let mut turn = 0;
        for part in &mut description.collision {
            let Shape::Capsule { a, b, radius } = part.shape.shape else { continue };
            turn += 1;
            let [a, b] = [a, b].map(Vector::<3>::from);
            let (middle, along) = ((a + b) * 0.5, Capsule::new(a, b, radius).direction);
            let side = perpendicular(&along);
            let across = along.cross(&side);
            let reach = 0.5 * (b - a).norm() + 0.7 * radius;
            let at = |x: f64, y: f64, z: f64| -> [f64; 3] {
                (middle + side * (x * radius) + across * (y * radius) + along * (z * reach)).into()
            };
            part.shape.shape = match turn % 3 {
                0 => continue,
                1 => Shape::Convex {
                    vertices: [-1.0, 1.0]
                        .into_iter()
                        .flat_map(|z| {
                            [at(0.7, 0.7, z), at(0.7, -0.7, z), at(-0.7, 0.7, z), at(-0.7, -0.7, z)]
                        })
                        .collect(),
                },
                // Pointed at one end, flat at the other.
                _ => Shape::Convex {
                    vertices: vec![
                        at(0.0, 0.1, 1.0),
                        at(1.0, 0.0, -0.9),
                        at(-0.5, 0.9, -1.0),
                        at(-0.6, -0.8, -0.8),
                        at(-0.7, 0.1, 0.3),
                    ],
                },
            };
        }
        Arc::new(description.build().unwrap())
    }

    /// Where the second body of a pair is an obstacle and the first stays a link, the world says the same.
    fn as_obstacle(state: &SpatialState, [i, j]: [usize; 2]) -> f64 {
        let ((shape, hull), (other, other_hull)) = (form_of(state, i), form_of(state, j));
        let corners = |hull: PlacedHull<'_, 3>| hull.corners().map(Into::into).collect();
        let shape_of = |shape: &Capsule<3>, hull: Option<PlacedHull<'_, 3>>| match hull {
            Some(hull) => ObstacleShape::Convex { vertices: corners(hull) },
            None => {
                let [a, b] = [shape.start, shape.end()].map(Into::into);
                ObstacleShape::Capsule { a, b, radius: shape.radius }
            }
        };
        let obstacle = Obstacle::of(shape_of(&other, other_hull));
        World::new(vec![obstacle]).contact(0, &Body { hull, ..Body::new(0, shape) }, 0).distance
    }

    /// Boxes and hulls of an arm, from each other, from its capsules and from its base: distances are those of the same
    /// bodies as obstacles, the gradient and the bias those of the distance along a motion, whatever is nearest; the least of
    /// the features is the distance, and there are no more than announced.
    #[test]
    fn between_hulls_in_space() {
        let arm = of_hulls();
        let met = RefCell::new(HashMap::<_, usize>::new());
        let seven = || prop::collection::vec(-2.0..2.0, 7);
        proptest!(ProptestConfig::with_cases(600), |(q in seven(), dq in seven(), ddq in seven())| {
            let h = 2e-4;
            let states = [-2.0, -1.0, 0.0, 1.0, 2.0].map(|k| moved(&arm, [&q, &dq, &ddq], k * h));
            let found = states.each_ref().map(pairs);
            for (k, (pair, indices)) in found[2].iter().zip(states[2].body_pairs()).enumerate() {
                let distance = pair.nearest.distance;
                let told = as_obstacle(&states[2], indices);
                prop_assert!((distance - told).abs() < 1e-11, "{distance} is not {told}");
                let own = found.each_ref().map(|pairs| pairs[k]);
                let kind = |pair: &OwnPair<3>| (pair.nearest.slides, pair.nearest.flat);
                if pair.hulls.is_none() {
                    continue;
                }
                let mut rows = vec![];
                pair.for_each_feature(&states[2], f64::INFINITY, |row| rows.push(row.nearest.distance));
                prop_assert!(rows.len() <= MAX_FEATURES);
                let least = rows.iter().copied().fold(f64::INFINITY, f64::min);
                prop_assert!((least - distance).abs() < 1e-11);
                let cores = distance + pair.shapes[0].radius + pair.shapes[1].radius;
                if cores.abs() < 0.02 || own.iter().any(|other| kind(other) != kind(pair)) {
                    continue;
                }
                let d = own.map(|own| own.nearest.distance);
                let Differences { rate, second, curved, uneven } = differences(&d, h);
                let scale = 1.0 + second.abs();
                // Not across a change to another corner or face, where the rate jumps.
                if curved.max(uneven) > 1e-2 * scale {
                    continue;
                }
                let motion = pair.motion(&states[2]);
                let (mut gradient, mut scratch) = (vec![0.0; 7], vec![0.0; 7]);
                pair.gradient(&states[2], &mut gradient, &mut scratch);
                let along: f64 = gradient.iter().zip(&ddq).map(|(g, a)| g * a).sum();
                prop_assert!((motion.rate - rate).abs() < 1e-6 * (1.0 + rate.abs()) + h * curved);
                prop_assert!((motion.rate - pair.rate(&states[2])).abs() < 1e-13 * scale);
                let error = (along + motion.bias - second).abs();
                prop_assert!(error < 2e-4 * scale + 0.5 * curved, "{error} {pair:?}");
                *met.borrow_mut().entry((kind(pair), distance < 0.0)).or_default() += 1;
            }
        });
        let met = met.into_inner();
        let count = |slides, flat| met.get(&((slides, flat), false)).copied().unwrap_or(0);
        let (none, both) = ([false; 2], [true; 2]);
        // Edges that cross, an edge and a corner, two corners, a corner and a face; the last three from either side.
        for (slides, flat) in [
            (both, none),
            ([true, false], none),
            ([false, true], none),
            (none, [true, false]),
            (none, [false, true]),
        ] {
            assert!(count(slides, flat) > 10, "{slides:?} {flat:?} {met:?}");
        }
        assert!(met.iter().filter(|((_, inside), _)| *inside).count() > 1, "{met:?}");
    }

    /// Two square bars, one above the other and askew by 0.02. Where the upper one rocks through the parallel, the nearest points of
    /// two of their edges run from end to end, and for that moment the exact d̈ is as large as the angle is small. What `cbf` is
    /// given has no such peak, and the least of it is the distance throughout.
    #[test]
    fn nearly_parallel_edges_have_no_peak() {
        let bar = |name: &str, z: f64, askew: f64| {
            let shape = PlacedShape {
                shape: Shape::Box { size: [1.0, 0.1, 0.1] },
                center: Some([0.0, 0.0, z]),
                orientation: Some([(0.5 * askew).cos(), 0.0, 0.0, (0.5 * askew).sin()]),
            };
            LinkShape::of(name, shape)
        };
        let rocks = Joint { axis: [0.0, 1.0, 0.0], ..link("upper", 1.0) };
        let description = ArmDescription {
            joints: vec![link("lower", 1.0), link("between", 1.0), rocks],
            collision: vec![bar("lower", 0.0, 0.0), bar("upper", 0.25, 0.02)],
            ..ArmDescription::default()
        };
        let arm = Arc::new(description.build().unwrap());
        let (mut peak, mut most): (f64, f64) = (0.0, 0.0);
        for k in -2000..=2000 {
            let mut state = arm.state();
            state.update(&[0.0, 0.0, 1e-4 * f64::from(k)], &[0.0, 0.0, 1.0]);
            let pair = pairs(&state)[0];
            let mut least = f64::INFINITY;
            pair.for_each_feature(&state, 0.3, |row| {
                least = least.min(row.nearest.distance);
                peak = peak.max(row.motion(&state).bias.abs());
                most = most.max(row.cautious(&state).bias.abs());
            });
            assert!((least - pair.nearest.distance).abs() < 1e-11, "{k}");
        }
        assert!(peak > 200.0 && most < 10.0, "{peak} {most}");
    }
}
