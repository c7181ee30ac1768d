use super::plane::{Obstacle, Shape, World};
use super::{CollisionQuery, Contact, LOAD, Motion, PairMargin};
use crate::geometry::Body;
use crate::math::{Capsule, Vector};
use proptest::prelude::*;
use std::cell::RefCell;

fn disc(position: [f64; 2], motion: Motion<2>) -> Obstacle {
    Obstacle { position, motion, ..Obstacle::of(Shape::Circle { radius: 0.5 }) }
}

#[test]
fn update_moves_what_moves() {
    let velocity = [1.0, -2.0];
    let mut world = World::new(vec![
        disc([1.0, 1.0], Motion::default()),
        disc([0.0, 3.0], Motion::Linear { velocity }),
    ]);
    assert_eq!(world.len(), 2);
    assert!(!world.is_empty());
    assert_eq!(world.position(1), Vector::<2>::new(0.0, 3.0));
    assert_eq!(world.velocity(1), Vector::from(velocity));
    world.update(2.0);
    assert_eq!(world.time().to_bits(), 2f64.to_bits());
    assert_eq!(world.position(0), Vector::<2>::new(1.0, 1.0));
    assert_eq!(world.velocity(0), Vector::<2>::zeros());
    assert_eq!(world.position(1), Vector::<2>::new(2.0, -1.0));
    assert_eq!(world.acceleration(1), Vector::<2>::zeros());
    assert_eq!(world.obstacle(1).shape, Shape::Circle { radius: 0.5 });
    world.update(0.0);
    assert_eq!(world.position(1), Vector::<2>::new(0.0, 3.0));
}

/// A disc on its way is carried elsewhere: nothing jumps, it arrives, and others are left alone.
#[test]
fn obstacles_are_carried() {
    let still = disc([1.0, 1.0], Motion::default());
    let mut world =
        World::new(vec![still.clone(), disc([0.0, 3.0], Motion::Linear { velocity: [1.0, -2.0] })]);
    world.update(1.0);
    let goal = Vector::<2>::new(5.0, 5.0);
    for j in 0..2 {
        let before = (world.position(j), world.velocity(j), world.acceleration(j));
        world.carry(j, goal, 10.0);
        let after = (world.position(j), world.velocity(j), world.acceleration(j));
        assert!((before.0 - after.0).norm() + (before.1 - after.1).norm() < 1e-13);
        assert!((before.2 - after.2).norm() < 1e-11);
    }
    world.update(6.0);
    assert!((world.position(0) - goal).norm() + (world.position(1) - goal).norm() < 1e-12);
    world.remove(0);
    world.add(still);
    assert_eq!(world.len(), 2);
    assert!((world.position(0) - goal).norm() < 1e-12);
    assert_eq!(world.position(1), Vector::<2>::new(1.0, 1.0));
}

/// The hierarchy of a crowd is given up, and the distances are those of a few obstacles.
#[test]
fn obstacles_of_a_crowd_are_carried() {
    let discs = |count: u32| (0..count).map(|k| disc([f64::from(k), 3.0], Motion::default()));
    let mut world = World::new(discs(30).collect());
    let along = Vector::<2>::new(2.0, 0.0);
    let link = || [Body::new(0, Capsule::new(Vector::<2>::zeros(), along, 0.1))];
    let distance = |world: &mut World| {
        let mut found = 0.0;
        world.for_each_contact(link(), f64::INFINITY, |_, d| found = d, |_| {});
        found
    };
    assert!((distance(&mut world) - 2.4).abs() < 1e-12);
    world.carry(29, Vector::<2>::new(1.0, 1.0), 10.0);
    world.update(10.0);
    assert!((distance(&mut world) - 0.4).abs() < 1e-12);
}

#[test]
fn all_pairs_are_visited_in_order() {
    let mut world = World::new(vec![
        disc([0.0, 2.0], Motion::Linear { velocity: [0.0, 1.0] }),
        disc([2.0, -1.0], Motion::default()),
    ]);
    world.update(1.0);
    let joints = [[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]].map(Vector::<2>::from);
    let capsules = joints.windows(2).map(|pair| Capsule::new(pair[0], pair[1], 0.1));
    // PlacedHull by links that have other numbers than they.
    let links = capsules.zip([4, 2]).map(|(shape, link)| Body::new(link, shape));
    let (mut found, mut distances) = (Vec::new(), Vec::new());
    world.for_each_contact(
        links.clone(),
        f64::INFINITY,
        |link, distance| distances.push((link, distance)),
        |contact| found.push(*contact),
    );
    let pairs: Vec<_> = found.iter().map(|c| (c.body, c.obstacle)).collect();
    let carriers: Vec<_> = found.iter().map(|c| c.link).collect();
    assert_eq!(carriers, [4, 4, 2, 2]);
    assert_eq!(pairs, [(0, 0), (0, 1), (1, 0), (1, 1)]);
    assert_eq!(distances, [(4, found[1].distance), (2, found[3].distance)]);
    for contact in &found {
        let body = links.clone().nth(contact.body).unwrap();
        assert_eq!(*contact, world.contact(contact.body, &body, contact.obstacle));
    }
    assert!((found[0].distance - 2.4).abs() < 1e-15);
    assert_eq!(found[0].velocity, Vector::<2>::new(0.0, 1.0));
    assert!((found[3].distance - 0.4).abs() < 1e-15);
    assert_eq!(found[3].normal, Vector::<2>::new(0.0, 1.0));
}

/// What is foreseen is found where and how it will be, also how it is turned; everything else goes on as it does now, and so does what was
/// foreseen once it is placed elsewhere.
#[test]
fn what_is_foreseen_is_found_where_it_will_be() {
    let bar = |foreseen: bool| {
        let motion = format!(
            "waypoints = {{ times = [0, 1, 3], points = [[0, 2], [1, 3], [0, 2]], angles = [0, 1, -1], \
             interpolation = \"smooth\", foreseen = {foreseen} }}"
        );
        Obstacle {
            shape: Shape::Box { size: [1.0, 0.2] },
            motion: toml::from_str(&motion).unwrap(),
            ..disc([0.0, 2.0], Motion::default())
        }
    };
    let link = Body::new(
        0,
        Capsule { start: Vector::zeros(), direction: Vector::<2>::x(), length: 2.0, radius: 0.1 },
    );
    for now in [0.0, 0.4, 0.9] {
        let [foreseen, mut other] = [true, false].map(|foreseen| {
            let mut world = World::new(vec![bar(foreseen)]);
            world.update(now);
            world
        });
        let present = other.contact(0, &link, 0);
        // √2 m in a second and at most 3 rad/s, both along quintics: 15/8 of the mean.
        let most = foreseen.speed_bound(0).unwrap();
        assert!(most > 2.0_f64.sqrt() && most < 6.0, "{most}");
        assert!(other.speed_bound(0).is_none());
        assert_eq!(foreseen.contact(0, &link, 0), present);
        for after in [-0.3, 0.2, 1.0, 5.0] {
            let found = foreseen.contact_after(0, &link, 0, after);
            let steady = other.contact_after(0, &link, 0, after);
            other.update(now + after);
            assert_eq!(found, other.contact(0, &link, 0), "{now} s, {after} s later");
            other.update(now);
            let is_moving = after > 0.0 || now > 0.0; // it rests before
            assert!(
                !is_moving || (found.distance - steady.distance).abs() > 1e-4,
                "{now} s, {after} s later"
            );
        }
        let mut turned = foreseen.clone();
        turned.turn(0, now, &other.turn_at(0, now).unwrap());
        assert_eq!(turned.speed_bound(0), Some(f64::INFINITY));
        let mut placed = foreseen;
        placed.place(0, now, Vector::<2>::new(0.0, 2.0), Vector::<2>::new(0.0, -1.0));
        assert!(placed.speed_bound(0).is_none());
    }
}

properties! {
    /// Whatever futures there are: those that are left out come true with the given probability at most, and one more would exceed it; nobody
    /// finds them but who looks for what may be near, and what is there is found as if they were not said.
    #[test]
    fn futures_are_for_look_ahead_alone(
        given in proptest::collection::vec(proptest::option::of(1u8..=4), 1..8), chance in 0.0..1.0,
    ) {
        let of = |k: usize| {
            let likelihood = given[k].map(|k| f64::from(k) / 8.0);
            Obstacle { likelihood, ..disc([0.3 * k as f64, 0.4], Motion::default()) }
        };
        let mut world = World::new((0..given.len()).map(of).collect());
        let there: Vec<usize> = (0..given.len()).filter(|k| given[*k].is_none()).collect();
        let mut plain = World::new(there.iter().map(|k| of(*k)).collect());
        let kept = |k: usize| world.likelihood_up_to(k) > chance;
        let likelihood = |k: usize| given[k].map_or(0.0, |k| f64::from(k) / 8.0);
        let left_out = (0..given.len()).filter(|k| !kept(*k)).map(likelihood).sum::<f64>();
        prop_assert!(left_out <= chance && there.iter().all(|k| kept(*k)));
        let next = (0..given.len()).filter(|k| kept(*k)).filter_map(|k| given[k]).min();
        prop_assert!(next.is_none_or(|next| left_out + f64::from(next) / 8.0 > chance));
        let link = Body::new(
            0,
            Capsule { start: Vector::zeros(), direction: Vector::<2>::x(), length: 2.0, radius: 0.1 },
        );
        let found = |world: &mut World| {
            let (mut all, mut least) = (vec![], f64::INFINITY);
            let contacts = |contact: &Contact<2>| all.push((contact.distance, contact.point));
            world.for_each_contact([link], 9.0, |_, distance| least = distance, contacts);
            (all, least)
        };
        prop_assert_eq!(found(&mut world), found(&mut plain));
        let mut near = vec![];
        world.for_each_obstacle_near([link], 9.0, |j| near.push(j));
        near.sort_unstable();
        prop_assert!(near.iter().copied().eq(0..given.len()), "{near:?}");
    }
}

/// Whatever is asked: links that obstacles are to ignore find what they would find without these, among few and in a crowd.
#[test]
fn links_do_not_find_what_ignores_them() {
    let links = ["link_1", "link_2", "link_3"].map(String::from);
    for count in [6, 40] {
        let x = |k: usize| f64::from(u32::try_from(k).unwrap());
        let kept = |k: usize| Obstacle {
            ignore: links.iter().take(k % 4).cloned().collect(),
            ..disc(
                [0.1 * x(k), 0.3 + 0.05 * x(k)],
                Motion::Linear { velocity: [0.1, -0.02 * x(k)] },
            )
        };
        let mut world = World::new((0..count).map(kept).collect());
        let body = |link: usize| {
            let start = Vector::<2>::new(x(link), 0.0);
            Body::new(link, Capsule::new(start, start + Vector::<2>::new(1.0, 0.0), 0.05))
        };
        let all = world.clone();
        world.know_links(&links);
        for (link, t) in [(0, 0.0), (1, 0.3), (2, 0.7), (0, 1.1)] {
            let asked: Vec<usize> = (0..count).filter(|k| k % 4 <= link).collect();
            let mut expected = all.only(asked.iter().copied());
            expected.update(t);
            world.update(t);
            let told = |world: &mut World, numbers: &dyn Fn(usize) -> usize| {
                let (mut found, mut least) = (vec![], vec![]);
                let visit = |contact: &Contact<2>| {
                    found.push((numbers(contact.obstacle), contact.distance.to_bits()));
                };
                world.for_each_contact([body(link)], 2.0, |_, d| least.push(d.to_bits()), visit);
                let mut pairs = vec![];
                world.for_each_pair([body(link)], |contact| pairs.push(numbers(contact.obstacle)));
                let boxes = world.boxes();
                let within = world.distance_within(&boxes, &body(link), 2.0).to_bits();
                (found, least, pairs, within)
            };
            let of_all = told(&mut world, &|j| j);
            assert_eq!(of_all, told(&mut expected, &|j| asked[j]), "{count} obstacles at {t} s");
            assert!(!of_all.0.is_empty() && of_all.2.len() < count);
            for j in 0..count {
                let after = world.contact_after(0, &body(link), j, 0.1).distance;
                assert_eq!(after == f64::INFINITY, !asked.contains(&j));
            }
        }
        // Nobody is meant by a name that no link has; what is carried has a name of its own.
        world.know_links(&["other".to_string()]);
        let mut pairs = 0;
        world.for_each_pair([body(0)], |_| pairs += 1);
        assert_eq!(pairs, count);
    }
    let mut world = World::new(vec![Obstacle {
        ignore: vec![LOAD.into()],
        ..disc([0.0, 1.0], Motion::default())
    }]);
    world.know_links(&links);
    let link = Body::new(2, Capsule::new(Vector::<2>::zeros(), Vector::<2>::new(1.0, 0.0), 0.1));
    for is_load in [false, true] {
        let mut pairs = 0;
        world.for_each_pair([Body { is_load, ..link }], |_| pairs += 1);
        assert_eq!(pairs, usize::from(!is_load));
    }
}

/// Whatever is asked: contacts say what the pair keeps, among few and in a crowd.
#[test]
fn contacts_say_what_is_kept() {
    let links = ["link_1", "link_2", "link_3"].map(String::from);
    for count in [6, 40] {
        let x = |k: usize| f64::from(u32::try_from(k).unwrap());
        let kept = |k: usize| Obstacle {
            ignore: if k == 5 { vec![links[0].clone()] } else { vec![] },
            margin: (!k.is_multiple_of(3)).then_some(0.01 * x(k % 3)),
            margins: (1..=k % 2).map(|_| (links[1].clone(), 0.1)).collect(),
            ..disc([0.1 * x(k), 0.3 + 0.05 * x(k)], Motion::default())
        };
        let expected = |k: usize, link: usize, is_load: bool| match (k % 2, k % 3) {
            (1, _) if link == 1 && !is_load => PairMargin::own(0.1),
            (_, 0) => PairMargin::USUAL,
            (_, thirds) => PairMargin::own(0.01 * x(thirds)),
        };
        let mut world = World::new((0..count).map(kept).collect());
        assert!(world.most_margin() <= 0.0, "nobody knows the links yet");
        world.know_links(&links);
        assert!((world.most_margin() - 0.1).abs() < 1e-15);
        assert!((world.only([0, 2]).most_margin() - 0.02).abs() < 1e-15);
        for (link, is_load) in [(0, false), (1, false), (2, false), (1, true)] {
            let start = Vector::<2>::new(x(link), 0.0);
            let capsule = Capsule::new(start, start + Vector::<2>::new(1.0, 0.0), 0.05);
            let body = Body { is_load, ..Body::new(link, capsule) };
            let told = RefCell::new(0);
            let check = |contact: &Contact<2>| {
                *told.borrow_mut() += 1;
                let Contact { obstacle, margin, .. } = *contact;
                assert_eq!(margin, expected(obstacle, link, is_load), "{obstacle}, {link}");
                assert_eq!(contact.pair().margin, margin);
            };
            world.for_each_contact([body], 3.0, |_, _| {}, check);
            world.for_each_barrier([body], 3.0, check);
            world.for_each_pair([body], check);
            assert!(*told.borrow() > 5);
            let (mut own, mut least) = (vec![], f64::INFINITY);
            world.for_each_own_margin(&body, |margin, distance| own.push((margin, distance)));
            world.for_each_pair([body], |contact| {
                if contact.margin == PairMargin::USUAL {
                    least = least.min(contact.distance);
                } else {
                    assert!(own.contains(&(contact.margin, contact.distance)));
                }
            });
            let boxes = world.boxes();
            let usual = world.usual_distance_within(&boxes, &body, f64::INFINITY);
            assert_eq!(usual.to_bits(), least.to_bits());
            for j in 0..count {
                check(&world.contact_after(0, &body, j, 0.1));
                assert_eq!(world.margin_of(j, &body), expected(j, link, is_load));
            }
        }
    }
}
