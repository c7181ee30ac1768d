//! Obstacles that are put elsewhere while a loop runs are those that a document would describe so.

use vff_core::geometry::Body;
use vff_core::math::{Capsule, Vector};
use vff_core::world::plane::{Obstacle, Shape, World};
use vff_core::world::{CollisionQuery, Motion};

fn obstacle(j: usize) -> Obstacle {
    Obstacle {
        position: [j as f64 % 5.0, j as f64 / 5.0],
        angle: 0.3,
        angular_velocity: if j.is_multiple_of(3) { 0.7 } else { 0.0 },
        motion: match j % 4 {
            0 => Motion::waypoints(vec![0.0, 1.0], vec![[0.0, 0.0], [3.0, 1.0]]),
            1 => Motion::Sinusoid {
                amplitude: [0.1, 0.4],
                angular_frequency: 2.0,
                phase: 0.1,
                foreseen: false,
            },
            _ => Motion::default(),
        },
        ..Obstacle::of(if j.is_multiple_of(2) {
            Shape::Circle { radius: 0.2 }
        } else {
            Shape::Box { size: [0.3, 0.1] }
        })
    }
}

/// Everything that the world tells of two links, to the last bit (the text of a number is unique).
fn told(world: &mut World) -> Vec<String> {
    let mut told = vec![];
    let link = |start: [f64; 2]| Capsule {
        start: start.into(),
        direction: Vector::<2>::new(0.6, 0.8),
        length: 1.5,
        radius: 0.05,
    };
    let bodies = [[0.5, 0.5], [2.0, 1.0]].map(link);
    let bodies = bodies.into_iter().enumerate().map(|(i, shape)| Body::new(i, shape));
    world.for_each_contact(bodies, 1.0, |_, _| {}, |contact| told.push(format!("{contact:?}")));
    told.extend((0..world.len()).map(|j| {
        let turn = world.turn_at(j, world.time());
        format!("{} {} {} {turn:?}", world.position(j), world.velocity(j), world.acceleration(j))
    }));
    told
}

/// One alone, some, and a crowd: static ones, moving ones and turning ones, at the present instant and later.
#[test]
fn a_placed_obstacle_is_one_that_moves_so() {
    for count in [1, 7, 40] {
        let mut world = World::new((0..count).map(obstacle).collect());
        let mut expected: Vec<_> = (0..count).map(obstacle).collect();
        world.update(0.3);
        for j in (0..count).rev().step_by(3) {
            let (velocity, at) = ([0.25, -0.5], [1.0 + 0.125 * j as f64, 1.5]);
            world.place(j, 0.5, at.into(), velocity.into());
            expected[j].position = [at[0] - 0.125, at[1] + 0.25];
            expected[j].motion = Motion::Linear { velocity };
            // Again, and back: what counts is the last place.
            world.place(j, 0.5, [9.0, 9.0].into(), [0.0, 0.0].into());
            world.place(j, 0.5, at.into(), velocity.into());
        }
        let mut described = World::new(expected);
        described.update(0.3);
        for t in [0.3, 0.3, 0.5, 1.7, 0.1] {
            world.update(t);
            described.update(t);
            assert_eq!(told(&mut world), told(&mut described), "{count} at {t}");
        }
    }
}

/// Room counts as long as there is more of it than contacts.
#[test]
fn room_is_counted() {
    let mut world = World::new((0..3).map(obstacle).collect());
    let (contacts, barriers) = (world.contact_count(), world.barrier_count());
    world.make_room(1, 50);
    assert_eq!(world.room(1), 50);
    assert_eq!(world.contact_count(), contacts + 50 - 1);
    assert!((barriers + 40..barriers + 50).contains(&world.barrier_count()));
    world.make_room(1, 20);
    assert_eq!(world.room(1), 50, "others may have been promised more");
    world.remove(1);
    assert!(world.contact_count() < contacts + 1);
}
