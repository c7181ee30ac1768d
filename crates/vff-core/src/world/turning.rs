//! How an obstacle turns about its position: at a constant angular velocity, or at one after the other.

use super::curve::{Curve, block};
use super::{Contact, Feature, MotionState};
use crate::math::rotation::UnitQuaternion;
use crate::math::{Capsule, Vector, sin_cos};
use nalgebra::SMatrix;

/// A rotation in `D` dimensions.
pub type Rotation<const D: usize> = SMatrix<f64, D, D>;

/// The rate of a rotation in `D` dimensions: a skew-symmetric matrix Ω \[rad/s\], so that Ωr is the velocity of a point at r
/// from the centre. In space this is ω × r.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spin<const D: usize>(SMatrix<f64, D, D>);

impl<const D: usize> Default for Spin<D> {
    fn default() -> Self {
        Self::NONE
    }
}

impl Spin<2> {
    /// Anticlockwise, in the plane \[rad/s\].
    pub fn planar(rate: f64) -> Self {
        Self(SMatrix::<f64, 2, 2>::new(0.0, -rate, rate, 0.0))
    }
}

impl Spin<3> {
    /// At an angular velocity, world axes \[rad/s\].
    pub fn spatial(omega: &Vector<3>) -> Self {
        Self(crate::math::rotation::skew(omega))
    }

    /// Its part in the first `D` dimensions.
    pub(super) fn block<const D: usize>(&self) -> Spin<D> {
        Spin(block(&self.0))
    }
}

impl<const D: usize> Spin<D> {
    /// At rest.
    pub const NONE: Self = Self(SMatrix::from_array_storage(nalgebra::ArrayStorage([[0.0; D]; D])));

    /// Whether nothing turns.
    #[inline]
    pub fn is_none(&self) -> bool {
        self.0 == Self::NONE.0
    }

    /// How `r` changes while it turns: its velocity, if it is a point \[m/s\]; its rate, if it is a direction \[1/s\].
    #[inline]
    pub fn rate_of(&self, r: &Vector<D>) -> Vector<D> {
        self.0 * r
    }

    /// Its magnitude \[rad/s\].
    pub fn magnitude(&self) -> f64 {
        self.0.norm() * std::f64::consts::FRAC_1_SQRT_2
    }

    /// The rotation after a time \[s\] (Rodrigues' formula, which in the plane is the one of sine and cosine).
    fn after(&self, time: f64) -> Rotation<D> {
        let rate = self.magnitude();
        if rate * time == 0.0 {
            return Rotation::identity();
        }
        let (axis, angle) = (self.0 / rate, rate * time);
        let (half, _) = sin_cos(0.5 * angle);
        let (sin, _) = sin_cos(angle);
        Rotation::identity() + axis * sin + axis * axis * (2.0 * half * half)
    }
}

/// How an obstacle is turned at one instant, compared with its description, and how fast it goes on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn<const D: usize> {
    /// From the directions of the description to those of now.
    pub rotation: Rotation<D>,
    /// Its rate.
    pub spin: Spin<D>,
    /// How that changes \[rad/s²\].
    pub spin_rate: Spin<D>,
}

impl<const D: usize> Turn<D> {
    /// The same `after` a time \[s\] at the present rate.
    #[must_use]
    pub fn after(&self, after: f64) -> Self {
        Self { rotation: self.spin.after(after) * self.rotation, ..*self }
    }

    /// A body as an obstacle at `position` sees it that is at the origin and not turned.
    #[inline]
    pub(super) fn see(&self, body: &Capsule<D>, position: &Vector<D>) -> Capsule<D> {
        Capsule {
            start: self.rotation.tr_mul(&(body.start - position)),
            direction: self.rotation.tr_mul(&body.direction),
            ..*body
        }
    }

    /// A contact with that obstacle as it is in the world, where the obstacle is in this state.
    #[inline]
    pub(super) fn place(&self, seen: &Contact<D>, state: &MotionState<D>) -> Contact<D> {
        let MotionState { position, velocity, acceleration, .. } = state;
        let turned = |v: &Vector<D>| self.rotation * v;
        let arm = turned(&seen.witness);
        let moving = self.spin.rate_of(&arm);
        // What goes on within the frame that turns, by itself (T180).
        let own = turned(&seen.velocity);
        let mut acceleration =
            acceleration + self.spin.rate_of(&moving) + self.spin.rate_of(&own) * 2.0;
        if !self.spin_rate.is_none() {
            acceleration += self.spin_rate.rate_of(&arm);
        }
        Contact {
            normal: turned(&seen.normal),
            point: position + turned(&seen.point),
            axis: turned(&seen.axis),
            witness: position + arm,
            velocity: velocity + moving + own,
            acceleration,
            spin: self.spin,
            feature: match seen.feature {
                Feature::Edge { edge, distance } => Feature::Edge { edge: turned(&edge), distance },
                Feature::Crossing { edge, distance } => {
                    Feature::Crossing { edge: turned(&edge), distance }
                }
                same => same,
            },
            ..*seen
        }
    }
}

/// How an obstacle turns. (Its motion says where it is.)
///
/// # Example
/// ```
/// use std::f64::consts::FRAC_PI_2;
/// use vff_core::math::Vector;
/// use vff_core::world::{Rotation, Spin, Turn, Turning};
///
/// let turning = Turning::steady(Spin::planar(FRAC_PI_2)).unwrap(); // a quarter turn a second
/// let Turn { rotation, spin, .. } = turning.at(1.0);
/// let quarter = Rotation::<2>::new(0.0, -1.0, 1.0, 0.0);
/// assert!((rotation - quarter).norm() < 1e-15);
/// assert_eq!(spin.rate_of(&Vector::<2>::new(1.0, 0.0)), Vector::<2>::new(0.0, FRAC_PI_2));
/// assert!(Turning::steady(Spin::planar(0.0)).is_none());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Turning<const D: usize> {
    /// One after the other in time; never empty.
    legs: Vec<Leg<D>>,
}

/// A rotation at a constant rate, or along a curve.
#[derive(Debug, Clone, PartialEq)]
struct Leg<const D: usize> {
    /// When it begins \[s\].
    from: f64,
    /// The instant \[s\] of the rotation.
    at: f64,
    rotation: Rotation<D>,
    spin: Spin<D>,
    /// Where there is one, it takes the place of the rotation and its rate.
    curve: Option<Curve>,
}

impl<const D: usize> Leg<D> {
    /// At a constant rate.
    fn steady(from: f64, at: f64, rotation: Rotation<D>, spin: Spin<D>) -> Self {
        Self { from, at, rotation, spin, curve: None }
    }
}

impl<const D: usize> Turning<D> {
    /// At a constant rate, as described at t = 0; none at rest.
    pub fn steady(spin: Spin<D>) -> Option<Self> {
        let (from, rotation) = (f64::NEG_INFINITY, Rotation::identity());
        (!spin.is_none()).then(|| Self { legs: vec![Leg::steady(from, 0.0, rotation, spin)] })
    }

    /// From rotation to rotation at constant rates, the first one as described; at rest before and after.
    ///
    /// # Arguments
    /// * `times`: instants \[s\], increasing.
    /// * `steps`: the rotation vectors, as rates over 1 s, that lead from one to the next: one less than instants.
    pub fn through(times: &[f64], steps: impl IntoIterator<Item = Spin<D>>) -> Self {
        let mut rotation = Rotation::identity();
        let still = |from, rotation| Leg::steady(from, 0.0, rotation, Spin::NONE);
        let mut legs = vec![still(f64::NEG_INFINITY, rotation)];
        for (leg, step) in times.windows(2).zip(steps) {
            let spin = Spin(step.0 / (leg[1] - leg[0]));
            legs.push(Leg::steady(leg[0], leg[0], rotation, spin));
            rotation = step.after(1.0) * rotation;
        }
        legs.extend(times.last().map(|last| still(*last, rotation)));
        Self { legs }
    }

    /// Along curves, each from an instant \[s\] to the next, the first one as described; at rest before and after.
    pub(super) fn smooth(times: &[f64], curves: Vec<Curve>) -> Self {
        let still = |from, rotation| Leg::steady(from, 0.0, rotation, Spin::NONE);
        let mut legs = vec![still(f64::NEG_INFINITY, Rotation::identity())];
        let mut rotation = Rotation::identity();
        for (leg, curve) in times.windows(2).zip(curves) {
            let next = curve.at(leg[1] - leg[0]).rotation;
            let steady = Leg::steady(leg[0], leg[0], rotation, Spin::NONE);
            legs.push(Leg { curve: Some(curve), ..steady });
            rotation = next;
        }
        legs.extend(times.last().map(|last| still(*last, rotation)));
        Self { legs }
    }

    /// Turned as `now` at time `t` \[s\], at that rate before and after.
    pub fn from(t: f64, now: &Turn<D>) -> Self {
        let mut this = Self { legs: vec![] };
        this.go_on(t, now);
        this
    }

    /// From now on it is turned as `now` at time `t` \[s\], and goes on at that rate.
    pub fn go_on(&mut self, t: f64, now: &Turn<D>) {
        self.legs.clear();
        let Turn { rotation, spin, .. } = *now;
        self.legs.push(Leg::steady(f64::NEG_INFINITY, t, rotation, spin));
    }

    /// How it is turned at time `t` \[s\]; the rate from the right where it jumps.
    pub fn at(&self, t: f64) -> Turn<D> {
        let passed = self.legs.partition_point(|leg| leg.from <= t);
        let Leg { at, rotation, spin, curve, .. } = &self.legs[passed.saturating_sub(1)];
        match curve {
            Some(curve) => curve.at(t - at),
            None => {
                let spin_rate = Spin::NONE;
                Turn { rotation: *rotation, spin: *spin, spin_rate }.after(t - at)
            }
        }
    }

    /// A rate that it never exceeds \[rad/s\].
    pub fn top_rate(&self) -> f64 {
        self.top_rate_within([f64::NEG_INFINITY, f64::INFINITY])
    }

    /// The same from one time to another \[s\].
    pub(super) fn top_rate_within(&self, [from, to]: [f64; 2]) -> f64 {
        let top = |leg: &Leg<D>| {
            leg.curve.as_ref().map_or_else(|| leg.spin.magnitude(), |curve| curve.top_rate)
        };
        // Each lasts until the next begins; before the first one it is as that one has it.
        let ends = self.legs.iter().skip(1).map(|leg| leg.from).chain([f64::INFINITY]);
        let within = self.legs.iter().zip(ends).enumerate();
        within
            .filter(|(i, (leg, end))| (*i == 0 || leg.from <= to) && from <= *end)
            .map(|(_, (leg, _))| top(leg))
            .fold(0.0, f64::max)
    }
}

impl Turning<3> {
    /// Turned as `now` until time `t` \[s\], then on to `goal` the short way at `rate` \[rad/s\], where it rests.
    pub fn toward(t: f64, now: &Rotation<3>, goal: &UnitQuaternion, rate: f64) -> Self {
        let way = (*goal * UnitQuaternion::from_matrix(now).inverse()).log();
        let duration = way.norm() / rate;
        let mut legs = vec![Leg::steady(f64::NEG_INFINITY, 0.0, *now, Spin::NONE)];
        if duration > 0.0 {
            legs.push(Leg::steady(t, t, *now, Spin::spatial(&(way / duration))));
        }
        legs.push(Leg::steady(t + duration, 0.0, goal.matrix(), Spin::NONE));
        Self { legs }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Body;
    use crate::world::{
        CollisionQuery, Description, Motion, ObstacleGeometry, World, plane, space,
    };
    use proptest::prelude::*;

    fn three(range: f64) -> impl Strategy<Value = Vector<3>> {
        [-range..range, -range..range, -range..range].prop_map(Vector::from)
    }

    properties! {
        /// In space the rotation is that of the rotation vector, in the plane that of the angle.
        #[test]
        fn rotations_are_those_of_other_forms(omega in three(3.0), rate in -9.0..9.0, t in -5.0..5.0) {
            let space = Turning::steady(Spin::spatial(&omega)).unwrap().at(t);
            let expected = UnitQuaternion::exp(&(omega * t)).matrix();
            prop_assert!((space.rotation - expected).norm() < 1e-13);
            prop_assert!((space.spin.magnitude() - omega.norm()).abs() < 1e-14);
            let plane = Turning::steady(Spin::planar(rate)).unwrap().at(t);
            let (sin, cos) = f64::sin_cos(rate * t);
            prop_assert!((plane.rotation - Rotation::<2>::new(cos, -sin, sin, cos)).norm() < 1e-13);
            prop_assert!((plane.spin.magnitude() - rate.abs()).abs() < 1e-14);
        }

        /// From where it is the short way to where it is wanted, at the given rate, and there it stays.
        #[test]
        fn it_turns_to_a_goal(now in three(3.0), goal in three(3.0), rate in 0.1..9.0, share in 0.01..0.99) {
            let [now, goal] = [now, goal].map(|phi| UnitQuaternion::exp(&phi));
            let turning = Turning::toward(2.0, &now.matrix(), &goal, rate);
            let angle = (goal * now.inverse()).log().norm();
            let between = turning.at(2.0 + share * angle / rate);
            prop_assert!((turning.at(1.0).rotation - now.matrix()).norm() < 1e-13 && turning.at(1.0).spin.is_none());
            prop_assert!((turning.at(2.0 + angle / rate).rotation - goal.matrix()).norm() < 1e-12);
            prop_assert!((between.spin.magnitude() - rate).abs() < 1e-9 * rate);
            let left = (goal * UnitQuaternion::from_matrix(&between.rotation).inverse()).log().norm();
            prop_assert!(f64::abs(left - (1.0 - share) * angle) < 1e-9);
            prop_assert!(turning.top_rate() <= rate * (1.0 + 1e-9));
        }

        /// The rate is that of the rotation, between the points and within a leg predicted by it.
        #[test]
        fn rates_are_exact(
            steps in prop::collection::vec(three(1.5), 3), leg in 0usize..3, share in 0.01..0.99, r in three(1.0),
        ) {
            let times = [-1.0, 0.5, 1.0, 4.0];
            let turning = Turning::through(&times, steps.iter().map(Spin::spatial));
            let t = times[leg] + share * (times[leg + 1] - times[leg]);
            let h = 1e-5 * (times[leg + 1] - times[leg]);
            let at = |t: f64| turning.at(t).rotation * r;
            let found = turning.at(t).spin.rate_of(&at(t));
            prop_assert!((found - (at(t + h) - at(t - h)) / (2.0 * h)).norm() < 1e-7);
            let second = turning.at(t).spin.rate_of(&found);
            prop_assert!((second - (at(t + h) - at(t) * 2.0 + at(t - h)) / (h * h)).norm() < 1e-3);
            let later = turning.at(t).after(h);
            prop_assert!((later.rotation - turning.at(t + h).rotation).norm() < 1e-13);
            prop_assert!(turning.top_rate() * r.norm() >= found.norm() - 1e-12);
            // From one rotation to the next, at rest before and after.
            let mut expected = UnitQuaternion::IDENTITY;
            for (k, time) in times.iter().enumerate() {
                prop_assert!((turning.at(*time).rotation - expected.matrix()).norm() < 1e-13);
                expected = steps.get(k).map_or(expected, |step| UnitQuaternion::exp(step) * expected);
            }
            prop_assert!(turning.at(-9.0).spin.is_none() && turning.at(4.0).spin.is_none());
            prop_assert_eq!(turning.at(9.0), turning.at(4.0));
            prop_assert_eq!(turning.at(-9.0).rotation, Rotation::<3>::identity());
        }
    }

    /// What is told to turn otherwise is from then on where it has turned to, moving or not.
    #[test]
    fn an_obstacle_is_turned_while_it_moves() {
        let turn = UnitQuaternion::exp(&Vector::<3>::new(0.4, -0.2, 0.9));
        let direction = Vector::<3>::new(0.0, 0.6, 0.8);
        let link = Capsule {
            start: Vector::<3>::new(0.1, 0.3, 0.2),
            direction,
            length: 0.5,
            radius: 0.05,
        };
        for velocity in [[0.0; 3], [0.1, 0.0, 0.0]] {
            let plate = |position, orientation: UnitQuaternion, motion| space::Obstacle {
                position,
                orientation: orientation.to_array(),
                motion,
                ..space::Obstacle::of(space::Shape::Box { size: [0.4, 0.2, 0.1] })
            };
            let motion = Motion::Linear { velocity };
            let mut world =
                space::World::new(vec![plate([0.0; 3], UnitQuaternion::IDENTITY, motion)]);
            world.update(1.0);
            let now = Rotation::identity();
            world.set_turning(0, Turning::toward(1.0, &now, &turn, 2.0));
            for (t, share) in [(1.0, 0.0), (1.2, 0.4 / turn.log().norm()), (3.0, 1.0)] {
                world.update(t);
                let there = velocity.map(|v| v * t);
                let stands =
                    plate(there, UnitQuaternion::exp(&(turn.log() * share)), Motion::default());
                let expected = rows(&mut space::World::new(vec![stands]), link);
                assert!((rows(&mut world, link)[0] - expected[0]).abs() < 1e-12, "at {t} s");
            }
        }
    }

    /// A description of what stands there as the other one does at time `t`.
    fn halted_in_space(obstacle: &space::Obstacle, t: f64) -> space::Obstacle {
        let turn = obstacle.turning().unwrap().at(t).rotation;
        let orientation = UnitQuaternion::new(obstacle.orientation).unwrap();
        let orientation = UnitQuaternion::from_matrix(&turn) * orientation;
        space::Obstacle {
            position: obstacle.motion.at(t, obstacle.position()).position.into(),
            orientation: orientation.to_array(),
            angular_velocity: [0.0; 3],
            motion: Motion::default(),
            ..obstacle.clone()
        }
    }

    fn halted_in_the_plane(obstacle: &plane::Obstacle, t: f64) -> plane::Obstacle {
        let turn = obstacle.turning().unwrap().at(t).rotation;
        plane::Obstacle {
            position: obstacle.motion.at(t, obstacle.position()).position.into(),
            angle: obstacle.angle + turn[(1, 0)].atan2(turn[(0, 0)]),
            angular_velocity: 0.0,
            motion: Motion::default(),
            ..obstacle.clone()
        }
    }

    fn rows<S: ObstacleGeometry<D>, const D: usize>(
        world: &mut World<S, D>,
        link: Capsule<D>,
    ) -> Vec<f64> {
        let mut found = vec![];
        let body = Body::new(0, link);
        world.for_each_barrier([body], f64::INFINITY, |row| found.push(row.distance));
        found.sort_by(f64::total_cmp);
        found
    }

    /// At time `t` all is as with an obstacle that has been described so; the velocity of its surface is that of the point of
    /// it; what is predicted is what comes.
    fn check<S: ObstacleGeometry<D>, const D: usize>(
        obstacle: &S::Obstacle,
        halted: impl Fn(f64) -> S::Obstacle,
        link: Capsule<D>,
        t: f64,
    ) -> Result<(), TestCaseError> {
        let mut world = World::<S, D>::new(vec![obstacle.clone()]);
        let mut still = World::<S, D>::new(vec![halted(t)]);
        let body = Body::new(0, link);
        world.update(t);
        let (found, expected) = (world.contact(0, &body, 0), still.contact(0, &body, 0));
        prop_assert!((found.distance - expected.distance).abs() < 1e-12, "{found:?} {expected:?}");
        let mut visited = vec![];
        world.for_each_contact([body], f64::INFINITY, |_, d| visited.push(d), |_| {});
        prop_assert_eq!(visited[0].to_bits(), (found.distance + 0.0).to_bits());
        // Where several pairs are as near, or the axis has got in, another one may be taken.
        let same = (found.point - expected.point).norm() < 1e-9;
        if same && (found.normal - expected.normal).norm() < 1e-9 {
            prop_assert!((found.witness - expected.witness).norm() < 1e-9);
            prop_assert_eq!(
                std::mem::discriminant(&found.feature),
                std::mem::discriminant(&expected.feature)
            );
            if let (
                Feature::Edge { edge, .. } | Feature::Crossing { edge, .. },
                Feature::Edge { edge: other, .. } | Feature::Crossing { edge: other, .. },
            ) = (found.feature, expected.feature)
            {
                prop_assert!((edge - other).norm() < 1e-9);
            }
        }
        if found.distance > 1e-6 - link.radius {
            let (found, expected) = (rows(&mut world, link), rows(&mut still, link));
            prop_assert_eq!(found.len(), expected.len());
            prop_assert!((found[0] - expected[0]).abs() < 1e-12);
        }
        let end = link.end() + link.direction * 2.0;
        let cast = |world: &World<S, D>| world.cast(end, -link.direction, 9.0);
        match (cast(&world), cast(&still)) {
            (Some(a), Some(b)) => prop_assert!((a - b).abs() < 1e-9, "{a} {b}"),
            (a, b) => prop_assert!(a.is_none() && b.is_none(), "{a:?} {b:?}"),
        }
        // The witness as a point of the body.
        let turning = obstacle.turning().unwrap();
        let place = |t: f64| obstacle.motion().at(t, obstacle.position()).position;
        let own = turning.at(t).rotation.tr_mul(&(found.witness - place(t)));
        let (h, at) = (1e-4, |t: f64| place(t) + turning.at(t).rotation * own);
        prop_assert!((found.velocity - (at(t + h) - at(t - h)) / (2.0 * h)).norm() < 1e-5);
        let second = (at(t + h) - at(t) * 2.0 + at(t - h)) / (h * h);
        prop_assert!((found.acceleration - second).norm() < 1e-4);
        let predicted = world.contact_after(0, &body, 0, 0.3);
        let state = MotionState {
            position: place(t) + obstacle.motion().at(t, obstacle.position()).velocity * 0.3,
            ..obstacle.motion().at(t, obstacle.position())
        };
        world.update(t + 0.3);
        let there = Capsule { start: link.start + place(t + 0.3) - state.position, ..link };
        let come = world.contact(0, &Body::new(0, there), 0);
        prop_assert!((predicted.distance - come.distance).abs() < 1e-11);
        Ok(())
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(1000))]

        #[test]
        fn as_if_described_so_in_space(
            link in space::oracle::any_link(), obstacle in space::oracle::any_obstacle(), omega in three(2.0),
            amplitude in three(1.0), t in -3.0..3.0,
        ) {
            let motion = Motion::Sinusoid { amplitude: amplitude.into(), angular_frequency: 1.3, phase: 0.2, foreseen: false };
            let obstacle = space::Obstacle { angular_velocity: omega.into(), motion, ..obstacle };
            check::<space::SpatialGeometry, 3>(&obstacle, |t| halted_in_space(&obstacle, t), link, t)?;
        }

        #[test]
        fn as_if_described_so_in_the_plane(
            link in plane::oracle::any_link(), obstacle in plane::oracle::any_obstacle(), rate in -2.0..2.0,
            velocity in [-1.0..1.0, -1.0..1.0], t in -3.0..3.0,
        ) {
            prop_assume!(rate != 0.0);
            let motion = Motion::Linear { velocity };
            let obstacle = plane::Obstacle { angular_velocity: rate, motion, ..obstacle };
            check::<plane::PlanarGeometry, 2>(&obstacle, |t| halted_in_the_plane(&obstacle, t), link, t)?;
        }
    }

    /// A bar that spins is carried away: it turns on as it did, and others beside it are none the worse.
    #[test]
    fn what_is_carried_turns_on() {
        let bar = |angular_velocity, position| plane::Obstacle {
            position,
            angular_velocity,
            ..plane::Obstacle::of(plane::Shape::Box { size: [2.0, 0.1] })
        };
        let mut world = plane::World::new(vec![bar(0.0, [9.0, 0.0]), bar(1.0, [0.0, 0.0])]);
        let probe = |x: f64, y: f64| {
            let (a, b) = (Vector::<2>::new(x, y), Vector::<2>::new(x, y + 0.1));
            Body::new(0, Capsule::new(a, b, 0.0))
        };
        world.update(1.0);
        let before = world.contact(0, &probe(0.0, 2.0), 1).distance;
        world.carry(1, Vector::<2>::new(3.0, 0.0), 40.0);
        assert!((world.contact(0, &probe(0.0, 2.0), 1).distance - before).abs() < 1e-12);
        let upright = std::f64::consts::FRAC_PI_2;
        world.update(upright);
        assert!((world.contact(0, &probe(3.0, 2.0), 1).distance - 1.0).abs() < 1e-6);
        assert_eq!(world.turn_at(0, 1.0), None);
        assert!((world.turn_at(1, 1.0).unwrap().rotation[(1, 0)] - 1f64.sin()).abs() < 1e-14);
        world.carry(0, Vector::<2>::new(9.0, 1.0), 40.0);
        world.remove(1);
        assert_eq!(world.turn_at(0, 1.0), None);
    }

    #[test]
    fn unusable_times_do_not_panic() {
        assert_eq!(Turning::<2>::steady(Spin::planar(0.0)), None);
        for times in [&[][..], &[1.0], &[f64::NAN, 1.0], &[1.0, 1.0]] {
            let turning = Turning::through(times, [Spin::planar(1.0)]);
            for t in [0.0, 1.0, f64::NAN, f64::INFINITY] {
                turning.at(t);
            }
        }
    }
}
