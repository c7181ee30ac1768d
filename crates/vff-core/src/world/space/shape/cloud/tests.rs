use super::*;
use crate::geometry::Body;
use crate::math::Capsule;
use crate::world::broad_phase::LEAST;
use crate::world::broad_phase::tests::{motion, point, reach};
use crate::world::space::oracle::*;
use crate::world::space::{Obstacle, Points, Shape, SpatialGeometry, World};
use crate::world::{CollisionQuery, Motion, ObstacleGeometry};
use proptest::prelude::*;

fn cloud(points: Vec<[f64; 3]>, radius: f64) -> Obstacle {
    fixed(Shape::Points { points, radius }, [0.0; 3])
}

/// Anywhere, on a lattice where many are equally near and some coincide, or all in one place.
pub fn any_points() -> impl Strategy<Value = Vec<[f64; 3]>> {
    let lattice = [-2i8..3, -2i8..3, -2i8..3].prop_map(|p| p.map(|x| 0.5 * f64::from(x)));
    prop_oneof![
        3 => prop::collection::vec(point(2.0), 0..40),
        2 => prop::collection::vec(lattice, 1..600),
        1 => (point(1.0), 1usize..20).prop_map(|(point, count)| vec![point; count]),
    ]
}

/// Everything that the world tells of these links, the obstacle's number left out.
fn told(world: &mut World, links: &[Capsule<3>], reach: f64, after: f64) -> Vec<String> {
    let bodies = || links.iter().enumerate().map(|(link, shape)| Body::new(link, *shape));
    let text = |contact: &Contact<3>| format!("{:?}", Contact { obstacle: 0, ..*contact });
    let (mut found, mut rows, mut later) = (vec![], vec![], vec![]);
    let distances = |link: usize, d: f64| rows.push(format!("{link} {}", d.to_bits()));
    world.for_each_contact(bodies(), reach, distances, |contact| found.push(text(contact)));
    world.for_each_barrier(bodies(), reach, |barrier| rows.push(text(barrier)));
    for (i, body) in bodies().enumerate() {
        let mut least = f64::INFINITY;
        for j in 0..world.len() {
            let visit = |contact: &Contact<3>| later.push(text(contact));
            let nearest =
                world.for_each_contact_after(i, &body, j, after, reach, visit, |nearest| *nearest);
            least = least.min(nearest.distance);
        }
        later.push(format!("{}", least.to_bits()));
    }
    [found, rows, later].concat()
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// A cloud is the balls at its points, to the last bit: contacts in their order, distances, barriers, and what is
    /// predicted, but for the rounding of where a cloud on its way will be. In a world of its own, where the balls are a
    /// crowd or not, and beside others.
    #[test]
    fn a_cloud_is_the_balls_at_its_points(
        points in any_points(),
        radius in prop_oneof![Just(0.0), 0.0..0.3],
        links in prop::collection::vec(any_link(), 1..4),
        (position, orientation, spin) in (point(2.0), any_orientation(), three(3.0)),
        motion in motion(),
        (kind, others) in (0..3, 0..25usize),
        (reach, after, t) in (reach(), -0.5..0.5, -1.0..2.0),
    ) {
        // A world without any obstacle tells no distance, one with an empty cloud ∞.
        prop_assume!(!points.is_empty() || others > 0);
        let own = matches!(motion, Motion::Waypoints { .. } | Motion::Dragged(_));
        let place = |shape, position| fixed(shape, position);
        let whole = Shape::Points { points: points.clone(), radius };
        let (cloud, balls): (_, Vec<_>) = match kind {
            // Where it stands.
            0 => (place(whole, position), points.iter().map(|point| {
                let there = Vector::from(position) + Vector::from(*point);
                place(Shape::Sphere { radius }, there.into())
            }).collect()),
            // On its way.
            1 if !own => {
                let moving = |obstacle| Obstacle { motion: motion.clone(), ..obstacle };
                let balls = points.iter().map(|point| moving(place(Shape::Sphere { radius }, *point)));
                (moving(place(whole, [0.0; 3])), balls.collect())
            }
            // Turned and turning: a capsule without length is a ball beside its position.
            _ => {
                let angular_velocity = spin.into();
                let turning = |shape| Obstacle {
                    orientation, angular_velocity, motion: motion.clone(), ..place(shape, position)
                };
                let ball = |point: &[f64; 3]| turning(Shape::Capsule { a: *point, b: *point, radius });
                (turning(whole), points.iter().map(ball).collect())
            }
        };
        let rest: Vec<_> = (0..others).map(|k| {
            let far = [0.3 * k as f64 - 2.0, 1.5, -0.5];
            place(Shape::Sphere { radius: 0.1 }, far)
        }).collect();
        let after = if kind == 1 { 0.0 } else { after };
        let mut one = World::new([vec![cloud], rest.clone()].concat());
        let mut many = World::new([balls, rest].concat());
        for t in [0.0, t, t + 0.01] {
            one.update(t);
            many.update(t);
            prop_assert_eq!(told(&mut one, &links, reach, after), told(&mut many, &links, reach, after));
        }
        prop_assert_eq!(one.barrier_count(), many.barrier_count());
        // An obstacle counts as one contact, even one of no points.
        prop_assert_eq!(one.contact_count(), many.contact_count() + usize::from(points.is_empty()));
    }

    /// The nearest contact is that of the nearest ball.
    #[test]
    fn the_nearest_is_that_of_the_nearest_ball(points in any_points(), link in any_link()) {
        prop_assume!(!points.is_empty());
        let body = Body::new(0, link);
        let found = World::new(vec![cloud(points.clone(), 0.1)]).contact(0, &body, 0);
        let ball = |p: &[f64; 3]| contact(&link, &fixed(Shape::Sphere { radius: 0.1 }, *p));
        let balls: Vec<_> = points.iter().map(ball).collect();
        let least = balls.iter().map(|ball| ball.distance).fold(f64::INFINITY, f64::min);
        prop_assert_eq!(found.distance.to_bits(), least.to_bits());
        prop_assert!(balls.contains(&found));
    }

    /// With other points in place of its own a world is one that was made with them; the old ones come back.
    #[test]
    fn swapped_points_are_those_of_a_new_world(
        [old, new] in [any_points(), any_points()],
        link in any_link(),
        (orientation, spin, motion) in (any_orientation(), three(2.0), motion()),
        crowd in any::<bool>(),
        (reach, t) in (reach(), -1.0..2.0),
    ) {
        let turning = |points: &Vec<[f64; 3]>| Obstacle {
            orientation,
            angular_velocity: spin.into(),
            motion: motion.clone(),
            ..cloud(points.clone(), 0.05)
        };
        let others = if crowd { LEAST } else { 1 };
        let world = |points| {
            let far = |k: usize| fixed(Shape::Sphere { radius: 0.1 }, [4.0 + k as f64, 0.0, 0.0]);
            World::new((0..others).map(far).chain([turning(points)]).collect())
        };
        let mut swapped = world(&old);
        swapped.update(t);
        let mut points = Points::new(new.clone(), orientation);
        prop_assert!(swapped.swap_points(others, &mut points));
        prop_assert!(!swapped.swap_points(0, &mut points), "a sphere has no points");
        prop_assert_eq!(&points.given, &old);
        let mut made = world(&new);
        prop_assert_eq!(swapped.obstacle(others), made.obstacle(others));
        prop_assert_eq!(swapped.barrier_count(), made.barrier_count());
        for t in [t, t + 0.3] {
            swapped.update(t);
            made.update(t);
            prop_assert_eq!(told(&mut swapped, &[link], reach, 0.1), told(&mut made, &[link], reach, 0.1));
        }
    }

    /// Points that go on at velocities of their own are balls that do, to the last bit: from when they were seen on, before it,
    /// and after others have taken their place. In a crowd or not, and however many go which way.
    #[test]
    fn moving_points_are_balls_that_move(
        points in any_points(),
        velocities in prop::collection::vec(three(1.5), 1..9),
        rest in 0..3usize,
        links in prop::collection::vec(any_link(), 1..4),
        others in 0..25usize,
        (reach, since, t) in (reach(), -0.5..0.5, -1.0..2.0),
        (origin, along) in (three(3.0), direction()),
    ) {
        prop_assume!(!points.is_empty());
        let velocity = |i: usize| match i % (velocities.len() + rest) {
            k if k < velocities.len() => velocities[k].into(),
            _ => [0.0; 3],
        };
        let rates: Vec<[f64; 3]> = (0..points.len()).map(velocity).collect();
        let ball = |(point, velocity): (&[f64; 3], &[f64; 3])| Obstacle {
            motion: Motion::Linear { velocity: *velocity },
            ..fixed(Shape::Sphere { radius: 0.05 }, *point)
        };
        let balls: Vec<_> = points.iter().zip(&rates).map(ball).collect();
        let far: Vec<_> = (0..others)
            .map(|k| fixed(Shape::Sphere { radius: 0.1 }, [0.3 * k as f64 - 2.0, 1.5, -0.5]))
            .collect();
        let mut one = World::new([vec![cloud(vec![[9.0; 3]], 0.05)], far.clone()].concat());
        one.update(t + since);
        let mut seen = Points::moving(points.clone(), &rates, Some(since), [1.0, 0.0, 0.0, 0.0]);
        prop_assert!(one.swap_points(0, &mut seen));
        prop_assert_eq!(one.stands_still(0), rates.iter().flatten().all(|v| *v == 0.0));
        let mut many = World::new([balls, far].concat());
        for t in [t, 0.0, t + 0.01] {
            // The same span of time to the last bit.
            let elapsed = (t + since) - since;
            one.update(t + since);
            many.update(elapsed);
            prop_assert_eq!(told(&mut one, &links, reach, 0.0), told(&mut many, &links, reach, 0.0));
            let [found, expected] = [&one, &many].map(|world| world.cast(origin, along, 9.0));
            prop_assert_eq!(found.is_some(), expected.is_some());
            prop_assert!((found.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-12);
            let body = Body::new(0, links[0]);
            let later = one.contact_after(0, &body, 0, 0.3).distance;
            let mut then = one.clone();
            then.update(t + since + 0.3);
            prop_assert!((later - then.contact(0, &body, 0).distance).abs() < 1e-12);
        }
        prop_assert!(one.swap_points(0, &mut seen));
        let before = World::new(vec![cloud(vec![[9.0; 3]], 0.05)]);
        prop_assert_eq!(
            one.contact(0, &Body::new(0, links[0]), 0), before.contact(0, &Body::new(0, links[0]), 0)
        );
        prop_assert!(one.stands_still(0));
    }

    /// A ray ends at the first ball.
    #[test]
    fn a_ray_ends_at_the_first_ball(
        points in any_points(), origin in three(3.0), along in direction(), range in 0.1..8.0,
    ) {
        let found = World::new(vec![cloud(points.clone(), 0.2)]).cast(origin, along, range);
        let balls = points.iter().map(|point| fixed(Shape::Sphere { radius: 0.2 }, *point));
        let expected = World::new(balls.collect()).cast(origin, along, range);
        prop_assert_eq!(found.is_some(), expected.is_some());
        prop_assert!((found.unwrap_or(0.0) - expected.unwrap_or(0.0)).abs() < 1e-13);
    }

    #[test]
    fn the_extent_holds_the_balls(points in any_points(), turn in any_orientation()) {
        prop_assume!(!points.is_empty());
        let shape = Shape::Points { points: points.clone(), radius: 0.3 };
        let geometry = SpatialGeometry::new(&Obstacle { orientation: turn, ..fixed(shape, [0.0; 3]) });
        let ([low, high], turn) = (geometry.extent(), UnitQuaternion::new(turn).unwrap());
        for point in points.iter().map(|point| turn.rotate(&Vector::from(*point))) {
            let [rear, front] = [-0.3, 0.3].map(|radius| point.add_scalar(radius));
            prop_assert!(low.inf(&rear) == low && high.sup(&front) == high);
            prop_assert!(point.norm() + 0.3 <= geometry.reach());
        }
    }
}

/// From cell to cell of a cube it goes through one face: along the curve, neighbours are neighbours.
#[test]
fn the_curve_leads_from_neighbour_to_neighbour() {
    let (low, high) = (Vec3::zeros(), Vec3::repeat(1023.0));
    let side = 0..16u32;
    let cells =
        side.clone().flat_map(|i| (0..16).flat_map(move |j| (0..16).map(move |k| [i, j, k])));
    let mut along: Vec<_> = cells
        .map(|cell| {
            let place = along_the_curve(&Vec3::from(cell.map(|x| f64::from(x) + 0.5)), &low, &high);
            (place, cell)
        })
        .collect();
    along.sort_unstable();
    assert_eq!(along.last().unwrap().0, 16 * 16 * 16 - 1);
    for pair in along.windows(2) {
        let ([(a, from), (b, to)], mut steps) = ([pair[0], pair[1]], 0);
        (0..3).for_each(|k| steps += from[k].abs_diff(to[k]));
        assert_eq!((b - a, steps), (1, 1), "{from:?} to {to:?}");
    }
}

/// What many points near a link cost grows with how many there are, and no faster; they come in their order.
#[test]
fn four_times_as_many_points_are_four_times_the_work() {
    let work = |count: u32| {
        // Denser towards one place, in no order.
        let point = |k: u32| {
            let turned = k.wrapping_mul(2_654_435_761);
            [0, 10, 20].map(|shift| 1e-5 * f64::from(turned >> shift & 1023))
        };
        let points: Vec<_> = (0..count).map(point).collect();
        let mut world = World::new(vec![cloud(points.clone(), 0.01)]);
        let body = Body::new(0, capsule([0.1, 0.0, -0.5], [0.1, 0.0, 0.5], 0.05));
        let (mut next, before) = (0, interrupt::spent());
        world.for_each_contact(
            [body],
            0.5,
            |_, _| {},
            |found| {
                let centre = found.witness - found.normal * 0.01;
                assert!((centre - Vec3::from(points[next])).norm() < 1e-12, "{next}");
                next += 1;
            },
        );
        assert_eq!(next, points.len());
        interrupt::spent().wrapping_sub(before)
    };
    let [few, many] = [4000, 16_000].map(work);
    assert!((3 * few..5 * few).contains(&many), "{few} {many}");
}

/// What a depth camera sees where there is nothing: infinitely far, and nothing undefined but for that.
#[test]
fn an_empty_cloud_is_nowhere() {
    let mut world = World::new(vec![cloud(vec![], 0.1)]);
    let link = capsule([0.0; 3], [1.0, 0.0, 0.0], 0.1);
    let body = Body::new(0, link);
    let found = world.contact(0, &body, 0);
    assert!(found.distance.is_infinite() && found.distance > 0.0);
    assert!(!format!("{found:?}").contains("NaN"));
    assert!((found.normal.norm() - 1.0).abs() < 1e-14);
    let (mut count, mut least) = (0, 0.0);
    world.for_each_contact([body], f64::INFINITY, |_, d| least = d, |_| count += 1);
    assert!(count == 0 && least.is_infinite() && least > 0.0);
    assert_eq!(world.cast(Vec3::zeros(), Vec3::x(), 9.0), None);
    assert_eq!((world.contact_count(), world.barrier_count()), (1, 0));
}

#[test]
fn unusable_values_do_not_panic() {
    for value in [0.0, 1e-300, 1e150, f64::MAX, f64::INFINITY, f64::NAN] {
        for count in [1, 9, 300] {
            let points: Vec<_> = (0..count).map(|k| [value * f64::from(k), value, 0.1]).collect();
            let mut world = World::new(vec![cloud(points.clone(), value)]);
            for link in
                [capsule([0.0; 3], [1.0; 3], 0.1), capsule([value; 3], [0.0, 1.0, value], 0.1)]
            {
                told(&mut world, &[link], f64::INFINITY, 0.0);
                world.cast(link.start, link.direction, value);
            }
        }
    }
}

/// How soon a cloud may come is not said by its nearest point, which rests, where others move by themselves: look-ahead asks again in time.
#[test]
fn points_that_rest_hide_none_that_come() {
    let of = |velocities: &[[f64; 3]]| {
        let cloud = Obstacle::of(Shape::Points { points: vec![], radius: 0.1 });
        let mut world = World::new(vec![cloud]);
        let given = vec![[0.0, 1.0, 0.0], [0.0, 3.0, 0.0]];
        world.swap_points(0, &mut Points::moving(given, velocities, None, [1.0, 0.0, 0.0, 0.0]));
        world
    };
    assert_eq!(of(&[]).speed_bound(0), None);
    assert_eq!(of(&[[0.0; 3], [0.0, -2.0, 0.0]]).speed_bound(0), Some(2.0));
}
