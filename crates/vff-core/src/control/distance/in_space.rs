//! ḋ and d̈ against obstacles in space: against differences, through changes of features, near parallel axes.

use super::tests::{Differences, differences};
use super::{DistanceRate, FADE};
use crate::geometry::Body;
use crate::math::{UnitQuaternion, Vector};
use crate::robot::Robot;
use crate::robot::description::{ArmDescription, Joint, LinkShape, PlacedShape};
use crate::robot::spatial::SpatialState;
use crate::robot::spatial::cases::{Case, case, link};
use crate::world::space::{Obstacle, Points, Shape, World, check_hull};
use crate::world::{CollisionQuery, Contact, Feature, Interpolation, Motion};
use proptest::prelude::*;
use std::cell::RefCell;
use std::collections::HashMap;
use std::mem::{Discriminant, discriminant};
use std::sync::Arc;

type Kind = Discriminant<Feature<3>>;

fn three(range: f64) -> impl Strategy<Value = [f64; 3]> {
    [-range..range, -range..range, -range..range]
}

/// What a link carries: a capsule, a ball, a box or a hull.
fn form() -> impl Strategy<Value = PlacedShape> {
    let size = [0.1..0.8, 0.1..0.8, 0.1..0.8];
    prop_oneof![
        5 => (three(0.3), three(1.0), 0.02..0.1)
            .prop_map(|(a, b, radius)| Shape::Capsule { a, b, radius }.into()),
        1 => (three(0.3), 0.02..0.1).prop_map(|(center, radius)| PlacedShape {
            center: Some(center),
            ..Shape::Sphere { radius }.into()
        }),
        3 => (three(0.3), size, three(2.0)).prop_map(|(center, size, turn)| {
            let orientation = UnitQuaternion::exp(&turn.into()).to_array();
            PlacedShape {
                shape: Shape::Box { size },
                center: Some(center),
                orientation: Some(orientation),
            }
        }),
        3 => prop::collection::vec(three(0.6), 4..12)
            .prop_filter("flat", |vertices| check_hull(vertices).is_ok())
            .prop_map(|vertices| Shape::Convex { vertices }.into()),
    ]
}

/// A random arm whose last link carries something.
fn armed() -> impl Strategy<Value = Case> {
    (case(1usize..5), form()).prop_map(|(c, shape)| {
        let mut description = c.arm.description().clone();
        let link = description.joints[description.dof() - 1].link.clone();
        description.collision = vec![LinkShape::of(link, shape)];
        Case { arm: Arc::new(description.build().unwrap()), ..c }
    })
}

fn shape() -> impl Strategy<Value = (usize, Shape)> {
    prop_oneof![
        (0.05..0.5).prop_map(|radius| (0, Shape::Sphere { radius })),
        (three(1.0), three(1.0), 0.0..0.3)
            .prop_map(|(a, b, radius)| (1, Shape::Capsule { a, b, radius })),
        [0.1..1.5, 0.1..1.5, 0.1..1.5].prop_map(|size| (2, Shape::Box { size })),
        Just((3, Shape::HalfSpace { normal: [0.0, 0.6, 0.8] })),
        prop::collection::vec(three(1.0), 4..12)
            .prop_filter("flat", |vertices| check_hull(vertices).is_ok())
            .prop_map(|vertices| (4, Shape::Convex { vertices })),
        (prop::collection::vec(three(1.0), 1..4), 0.0..0.3)
            .prop_map(|(points, radius)| (5, Shape::Points { points, radius })),
    ]
}

/// Near the link of `c`, so that penetration occurs, too.
fn placed(c: &Case, shape: Shape, offset: [f64; 3], turn: [f64; 3], moving: Moving) -> World {
    let body = body_of(&c.state()).shape;
    let middle = body.start + body.direction * (0.5 * body.length);
    let position = middle + Vector::from(offset);
    let orientation = UnitQuaternion::exp(&turn.into()).to_array();
    let Moving { motion, angular_velocity, own } = moving;
    let motion = motion.shifted(&position);
    let position = position.into();
    let seen = match &shape {
        Shape::Points { points, .. } => Some(points.clone()),
        _ => None,
    };
    let mut world = World::new(vec![Obstacle {
        position,
        orientation,
        angular_velocity,
        motion,
        ..Obstacle::of(shape)
    }]);
    if let Some(points) = seen {
        let velocities: Vec<_> = own.iter().copied().cycle().take(points.len()).collect();
        let mut points = Points::moving(points, &velocities, Some(-0.2), orientation);
        assert!(world.swap_points(0, &mut points));
    }
    world
}

/// How an obstacle moves and turns.
#[derive(Debug, Clone)]
struct Moving {
    motion: Motion<3>,
    angular_velocity: [f64; 3],
    /// At which velocities points of a cloud go on by themselves, one after the other.
    own: [[f64; 3]; 2],
}

fn moving() -> impl Strategy<Value = Moving> {
    let motion = prop_oneof![
        Just(Motion::default()),
        three(1.0).prop_map(|velocity| Motion::Linear { velocity }),
        (three(1.0), 0.2..2.0, -1.0..1.0).prop_map(|(amplitude, angular_frequency, phase)| {
            Motion::Sinusoid { amplitude, angular_frequency, phase, foreseen: false }
        }),
        // About where it is: the position is that of the obstacle wherever the points are.
        (three(1.0), three(2.0), any::<bool>()).prop_map(|(way, turn, is_smooth)| {
            let turned = UnitQuaternion::exp(&turn.into()).to_array();
            let orientations = vec![[1.0, 0.0, 0.0, 0.0], turned];
            // Not in the middle of a smooth way, where nothing is accelerated.
            let (interpolation, start) = match is_smooth {
                true => (Interpolation::Smooth, -0.6),
                false => (Interpolation::Linear, -1.0),
            };
            let (times, points) = (vec![start, 1.0], vec![way.map(|x| -x), way]);
            Motion::Waypoints {
                times,
                points,
                interpolation,
                angles: vec![],
                orientations,
                foreseen: false,
            }
        }),
    ];
    let angular_velocity = prop_oneof![1 => Just([0.0; 3]), 2 => three(2.0)];
    let own = prop_oneof![1 => Just([[0.0; 3]; 2]), 2 => [three(1.0), three(1.0)]];
    (motion, angular_velocity, own).prop_map(|(motion, angular_velocity, own)| Moving {
        motion,
        angular_velocity,
        own,
    })
}

/// The arm at time t of the motion q + q̇t + ½q̈t² (`u` is q̈).
fn at(c: &Case, t: f64) -> SpatialState {
    let q: Vec<_> = (0..c.q.len()).map(|i| c.q[i] + t * (c.dq[i] + 0.5 * t * c.u[i])).collect();
    let dq: Vec<_> = (0..c.q.len()).map(|i| c.dq[i] + t * c.u[i]).collect();
    c.at(&q, &dq)
}

fn body_of(state: &SpatialState) -> Body<'_, 3> {
    Robot::body(state, 0)
}

fn contact_at(c: &Case, world: &mut World, t: f64) -> (SpatialState, Contact<3>) {
    world.update(t);
    let state = at(c, t);
    let contact = world.contact(0, &body_of(&state), 0);
    (state, contact)
}

/// ḋ and d̈ along the motion, as they are stated.
fn stated(c: &Case, state: &SpatialState, contact: &Contact<3>) -> [f64; 2] {
    let motion = DistanceRate::new(state, contact);
    let mut gradient = vec![0.0; c.q.len()];
    state.point_jacobian_tr_mul(contact.link, &contact.point, &contact.normal, &mut gradient);
    let along: f64 = gradient.iter().zip(&c.u).map(|(g, u)| g * u).sum();
    [motion.rate, along + motion.bias]
}

fn features() -> [Kind; 6] {
    let edge = Vector::zeros();
    [
        Feature::Side { distance: 1.0 },
        Feature::End { distance: 1.0 },
        Feature::Face,
        Feature::Edge { edge, distance: 1.0 },
        Feature::Crossing { edge, distance: 1.0 },
        Feature::LinkFace { distance: 1.0 },
    ]
    .map(|feature| discriminant(&feature))
}

/// By how much the edges of two contacts differ, which are no other ones if that is little.
fn turned(a: &Contact<3>, b: &Contact<3>) -> f64 {
    let edge = |contact: &Contact<3>| match contact.feature {
        Feature::Edge { edge, .. } | Feature::Crossing { edge, .. } => edge,
        _ => Vector::zeros(),
    };
    (a.axis - b.axis).norm().max((edge(a) - edge(b)).norm())
}

/// They are the derivatives of the distance along a motion, for every shape and motion of obstacles and every pair of
/// features, in penetration too; and all of these were met.
#[test]
fn rates_are_derivatives_of_the_distance() {
    let met = RefCell::new(HashMap::<_, usize>::new());
    let config =
        ProptestConfig { max_global_rejects: 200_000, ..ProptestConfig::with_cases(10_000) };
    proptest!(config, |(c in armed(), (kind, shape) in shape(), offset in three(1.0), turn in three(2.0), moving in moving())| {
        let mut world = placed(&c, shape, offset, turn, moving);
        let h = 4e-4;
        let samples: Vec<_> =
            (-2..=2).map(|k| contact_at(&c, &mut world, h * f64::from(k)).1).collect();
        let kinds = |contact: &Contact<3>| discriminant(&contact.feature);
        prop_assume!(samples.iter().all(|s| kinds(s) == kinds(&samples[0])));
        prop_assume!(samples.iter().all(|s| turned(s, &samples[0]) < 0.1));
        let d: Vec<f64> = samples.iter().map(|s| s.distance).collect();
        let Differences { rate, second, curved, uneven } = differences(&d, h);
        let scale = 1.0 + second.abs();
        // Not across a change to another corner or face, where the rate jumps.
        prop_assume!(curved.max(uneven) < 1e-2 * scale);

        let (state, contact) = contact_at(&c, &mut world, 0.0);
        let [found_rate, found] = stated(&c, &state, &contact);
        let open = 1e-6 * (1.0 + rate.abs()) + h * curved;
        prop_assert!((found_rate - rate).abs() < open, "{found_rate} {rate}");
        prop_assert!((found - second).abs() < 2e-4 * scale + 0.1 * curved, "{found} is not {second}: {contact:?}");
        let inside = contact.distance + 0.3 < 0.0 || matches!(contact.feature, Feature::Crossing { distance, .. } if distance < 0.0);
        let hull = usize::from(body_of(&state).hull.is_some()) * 100;
        let inside = inside || (hull > 0 && contact.distance < 0.0);
        for kind in [Some(kind), inside.then_some(kind + 10)].into_iter().flatten() {
            *met.borrow_mut().entry((kind + hull, kinds(&contact))).or_default() += 1;
        }
    });
    let met = met.into_inner();
    let count = |kind, feature| met.get(&(kind, feature)).copied().unwrap_or(0);
    let [side, end, face, edge, crossing, below] = features();
    for (kind, expected) in [
        (0, vec![side, end]),
        (1, vec![side, end, edge, crossing]),
        (2, vec![side, end, face, edge, crossing]),
        (3, vec![face]),
        (4, vec![side, end, face, edge, crossing]),
        (5, vec![side, end]),
    ] {
        for feature in features() {
            assert_eq!(count(kind, feature) > 10, expected.contains(&feature), "{kind} {met:?}");
        }
    }
    // Of a hull its edges, its corners, which are ends of edges, and its faces. Two corners are nearest but rarely.
    for (kind, expected) in [
        (100, vec![side, end, below]),
        (101, vec![side, end, edge, crossing, below]),
        (102, vec![side, end, face, edge, crossing, below]),
        (103, vec![face]),
        (104, vec![side, end, face, edge, crossing, below]),
        (105, vec![side, end, below]),
    ] {
        for feature in features() {
            let met = count(kind, feature) > 0;
            assert!(!met || expected.contains(&feature), "{kind} {feature:?}");
        }
    }
    for feature in features() {
        assert!((100..106).map(|kind| count(kind, feature)).sum::<usize>() > 10, "{met:?}");
    }
    // Axes inside a box or a hull that leave it across an edge, and through a face.
    for kind in [112, 114] {
        for feature in [crossing, face, below] {
            assert!(count(kind, feature) > 3, "{kind} {met:?}");
        }
    }
    for kind in [12, 14] {
        assert!(count(kind, crossing) > 0 && count(kind, face) > 0, "{met:?}"); // some ten of 5000, by chance
    }
}

properties! {
    #![proptest_config(ProptestConfig { max_global_rejects: 20_000, ..ProptestConfig::with_cases(60) })]

    /// Over a way on which features change, ḋ is the integral of the d̈ that is stated: nothing is missing where
    /// one pair of features hands over to the next.
    #[test]
    fn rates_are_integrals_through_feature_changes(
        c in armed(), (_, shape) in shape(), offset in three(1.5), turn in three(2.0), moving in moving(),
    ) {
        // Where points pass each other, the nearest is another one at a jump of the rate.
        let moving = Moving { own: [moving.own[0]; 2], ..moving };
        let mut world = placed(&c, shape, offset, turn, moving);
        let steps = 1500;
        let h = 0.3 / f64::from(steps);
        let (mut integral, mut bound, mut farthest, mut changes) = (0.0, 0.0, 0.0_f64, 0);
        let (state, mut last) = contact_at(&c, &mut world, 0.0);
        let [first, mut second] = stated(&c, &state, &last);
        let mut rate = first;
        for k in 1..=steps {
            let (state, now) = contact_at(&c, &mut world, h * f64::from(k));
            // Only apart, where the nearest points do not jump from one place to another.
            let moved = (now.point - last.point).norm();
            prop_assume!(now.distance > 0.02 && moved < 10.0 * h);
            prop_assume!((now.normal - last.normal).norm() < 0.05);
            farthest = farthest.max(moved);
            let [next_rate, next] = stated(&c, &state, &now);
            changes += u32::from(discriminant(&now.feature) != discriminant(&last.feature));
            integral += 0.5 * h * (second + next);
            bound += 0.5 * h * (next - second).abs();
            (last, rate, second) = (now, next_rate, next);
        }
        prop_assume!(changes > 0);
        // Within a step d̈ lies between its values at both ends, jumps included; but for a peak where axes
        // pass through the parallel within the step, which turns the velocity by the way of the nearest point.
        let spin: f64 = c.dq.iter().zip(&c.u).map(|(dq, u)| dq.abs() + 0.3 * u.abs()).sum();
        bound += spin * farthest + 1e-6;
        prop_assert!((rate - first - integral).abs() < bound,
            "{} is not {integral} to {bound}", rate - first);
    }

    /// `cautious` is `new` for balls, for faces and away from the ends of the link; beyond an end beside an edge it is
    /// never more.
    #[test]
    fn cautious_is_exact_away_from_ends(
        c in armed(), (_, shape) in shape(), offset in three(1.5), turn in three(2.0), moving in moving(),
    ) {
        let mut world = placed(&c, shape, offset, turn, moving);
        let (state, contact) = contact_at(&c, &mut world, 0.0);
        let axis = contact.axis;
        let [exact, cautious] =
            [DistanceRate::new(&state, &contact), DistanceRate::cautious(&state, &contact)];
        prop_assert!((exact.rate - cautious.rate).abs() <= 1e-14 * (1.0 + exact.rate.abs()));
        let close = (exact.bias - cautious.bias).abs() <= 1e-9 * (1.0 + exact.bias.abs());
        let beyond = contact.normal.dot(&axis).abs() > FADE;
        match contact.feature {
            _ if axis.norm() == 0.0 => prop_assert!(close),
            Feature::Side { .. } | Feature::Face | Feature::LinkFace { .. } => prop_assert!(close),
            Feature::Crossing { edge, .. } => {
                let sin = axis.cross(&edge).norm();
                prop_assert!(close || sin < FADE);
            }
            Feature::End { .. } | Feature::Edge { .. } => {
                prop_assert!(cautious.bias <= exact.bias + 1e-9 && (close || !beyond));
            }
        }
    }
}

/// Where a link turns through the parallel of a bar above it, its nearest point runs from one end to the other, and
/// for that moment the exact d̈ is as large as the angle between the two is small. What the barriers of `cbf` are given
/// has no such peak, and the least of them is the distance throughout.
#[test]
fn barriers_have_no_peak_at_parallel_axes() {
    let [a, b] = [-0.5, 0.5].map(|x| [x, 0.0, 0.0]);
    let joints = vec![Joint { axis: [0.0, 1.0, 0.0], ..link("rod", 1.0) }];
    let bodies = vec![LinkShape::of("rod", Shape::Capsule { a, b, radius: 0.05 })];
    let description = ArmDescription { joints, collision: bodies, ..ArmDescription::default() };
    let arm = Arc::new(description.build().unwrap());
    let bar = Shape::Capsule { a: [-1.0, -0.02, 0.3], b: [1.0, 0.02, 0.3], radius: 0.05 };
    let mut world = World::new(vec![Obstacle::of(bar)]);
    let (mut peak, mut most): (f64, f64) = (0.0, 0.0);
    for k in -2000..=2000 {
        let mut state = arm.state();
        state.update(&[1e-4 * f64::from(k)], &[1.0]);
        let contact = world.contact(0, &body_of(&state), 0);
        peak = peak.max(DistanceRate::new(&state, &contact).bias.abs());
        let mut least = f64::INFINITY;
        world.for_each_barrier([body_of(&state)], 0.3, |barrier| {
            least = least.min(barrier.distance);
            most = most.max(DistanceRate::cautious(&state, barrier).bias.abs());
        });
        assert!((least - contact.distance).abs() < 1e-12);
    }
    // ρ q̇² / sin² of the angle, 0.02; and at most 1.3 times that at the angle 0.2.
    assert!(peak > 700.0 && most < 10.0, "{peak} {most}");
}
