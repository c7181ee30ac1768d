//! Round bodies: followed by their middles, whatever hides a part of them, and known all around.

use super::*;

/// That reckons with what is up to so wide \[m\].
fn perceiver(eye: &DepthCamera, hidden: f64) -> Perceiver {
    let settings = PerceiverSettings { stride: 1, hidden, ..PerceiverSettings::default() };
    Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap()
}

/// All around.
fn deep_perceiver(eye: &DepthCamera) -> Perceiver {
    perceiver(eye, 0.3)
}

/// With one side alone, as it is seen.
fn flat_perceiver(eye: &DepthCamera) -> Perceiver {
    perceiver(eye, 0.0)
}

/// Directions all around.
fn all_around() -> impl Iterator<Item = V> {
    (0..200_i32).map(|k| {
        let spread = |step: f64| (step * f64::from(k)).fract() - 0.5;
        V::new(spread(0.618), spread(0.7549), spread(0.5698)).normalize()
    })
}

/// How far balls at the points near a ball go beyond its surface, at least and at most, of all directions.
fn beyond(perceiver: &Perceiver, thing: &Capsule) -> [f64; 2] {
    let points: Vec<V> = perceiver.points().map(|(point, _)| point - thing.a).collect();
    let near: Vec<V> = points.into_iter().filter(|p| p.norm() < thing.radius + 0.1).collect();
    let radius = perceiver.radius();
    // The farthest end of a line through the middle that is within a ball.
    let end = |away: V| {
        let of_ball = |p: &V| {
            let along = away.dot(p);
            let root = radius * radius - (p.norm_squared() - along * along);
            if root >= 0.0 { along + root.sqrt() } else { f64::NEG_INFINITY }
        };
        near.iter().map(of_ball).fold(f64::NEG_INFINITY, f64::max) - thing.radius
    };
    let ends: Vec<f64> = all_around().map(end).collect();
    [ends.iter().copied().fold(f64::INFINITY, f64::min), ends.into_iter().fold(-1.0, f64::max)]
}

/// A ball that passes below a bar, which hides up to half of it: its velocity stays what it is, where that of the mean of what is
/// seen does not, and it is known all around to a few millimetres.
#[test]
fn a_ball_below_a_bar_is_known_all_around() {
    let eye = camera(2);
    let velocity = V::new(0.05, 0.4, -0.1);
    let at = |t: f64| V::new(0.4, -0.25, 0.5) + velocity * t;
    let bar = Capsule { a: V::new(-0.1, 0.02, 0.9), b: V::new(0.9, 0.02, 0.9), radius: 0.02 };
    let (mut deep, mut flat) = (deep_perceiver(&eye), flat_perceiver(&eye));
    let mut worst = [0.0_f64; 2];
    for k in 0..36 {
        let t = PERIOD * f64::from(k);
        let thing = ball(at(t).into(), 0.07);
        for (perceiver, worst) in [&mut deep, &mut flat].into_iter().zip(&mut worst) {
            show(perceiver, &eye, t, &[thing, bar]);
            if k >= 8 {
                let near = perceiver.points().filter(|(point, _)| (point - at(t)).norm() < 0.08);
                let off: Vec<f64> = near.map(|(_, moving)| (moving - velocity).norm()).collect();
                *worst = worst.max(off.iter().sum::<f64>() / off.len() as f64);
            }
        }
        if k >= 8 {
            let [least, most] = beyond(&deep, &thing);
            assert!(least > -0.008 && most < 0.015, "{k}: {least} to {most}");
        }
    }
    assert!(worst[0] < 0.05 && worst[1] > 0.1, "{worst:?}");
}

/// Two balls that touch for a while are two, each with its velocity.
#[test]
fn balls_that_meet_are_two() {
    let eye = camera(2);
    let speed = 0.3;
    let at = |t: f64| [[0.35, -0.2 + speed * t, 0.4], [0.51, 0.2 - speed * t, 0.4]];
    let mut perceiver = deep_perceiver(&eye);
    for k in 0..40 {
        let t = PERIOD * f64::from(k);
        let things = at(t).map(|place| ball(place, 0.075));
        show(&mut perceiver, &eye, t, &things);
        if k < 9 {
            continue;
        }
        for (thing, velocity) in things.iter().zip([speed, -speed]) {
            let own = perceiver.points().filter(|(point, _)| (point - thing.a).norm() < 0.07);
            let off = own.map(|(_, moving)| (moving - V::y() * velocity).norm());
            let off: Vec<f64> = off.collect();
            assert!(off.len() > 50 && off.iter().all(|off| *off < 0.06), "{k}: {off:?}");
            let [least, _] = beyond(&perceiver, thing);
            assert!(least > -0.01, "{k}: {least}");
        }
    }
}

/// What is not round is not taken for a ball: every point of it is in the cloud as it is seen.
#[test]
fn what_is_not_round_is_seen_as_it_is() {
    let eye = camera(2);
    for turn in [0.0_f64, 0.6] {
        let (mut deep, mut flat) = (deep_perceiver(&eye), flat_perceiver(&eye));
        let along = V::new(turn.cos(), 0.3, turn.sin()).normalize() * 0.05;
        for k in 0..20 {
            let t = PERIOD * f64::from(k);
            let middle = V::new(0.3 + 0.2 * t, 0.1 * t, 0.45);
            let thing = Capsule { a: middle - along, b: middle + along, radius: 0.05 };
            show(&mut deep, &eye, t, &[thing]);
            show(&mut flat, &eye, t, &[thing]);
            let known: Vec<V> = deep.points().map(|(point, _)| point).collect();
            assert!(flat.points().count() > 50);
            assert!(flat.points().all(|(point, _)| known.contains(&point)), "{turn}, {k}");
        }
    }
}

/// A ball that is taken away is gone with the next pictures, one that is covered is remembered as a whole, and together they are never
/// more points than there is room for.
#[test]
fn a_ball_is_forgotten_and_takes_no_more_room_than_there_is() {
    let eye = camera(2);
    let thing = ball([0.4, 0.0, 0.4], 0.1);
    let mut perceiver = deep_perceiver(&eye);
    for k in 0..10 {
        show(&mut perceiver, &eye, PERIOD * f64::from(k), &[thing]);
    }
    let cover = ball([0.4, 0.0, 1.25], 0.2);
    for k in 10..30 {
        show(&mut perceiver, &eye, PERIOD * f64::from(k), &[thing, cover]);
        let [least, _] = beyond(&perceiver, &thing);
        assert!(least > -0.01, "{k}: {least}");
    }
    for k in 30..33 {
        show(&mut perceiver, &eye, PERIOD * f64::from(k), &[]);
    }
    assert_eq!(near(&perceiver, [0.4, 0.0, 0.4], 0.2), 0);

    let settings = PerceiverSettings {
        stride: 1,
        hidden: 0.3,
        most_voxels: 300,
        ..PerceiverSettings::default()
    };
    let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap();
    let places = [[0.2, -0.2], [0.5, -0.2], [0.2, 0.2], [0.5, 0.2]];
    for k in 0..10 {
        let balls = places.map(|[x, y]| ball([x, y, 0.4], 0.1));
        show(&mut perceiver, &eye, PERIOD * f64::from(k), &balls);
        assert!((100..=600).contains(&perceiver.points().count()));
    }
}

/// A ball that is put onto a table which nobody has told of, and taken away, is gone: where it touched the table, that goes on being
/// seen where the ball was.
#[test]
fn a_ball_that_is_taken_off_a_table_is_gone() {
    let eye = camera(2);
    for radius in [0.04, 0.08, 0.12, 0.145] {
        let settings = PerceiverSettings { stride: 1, hidden: 0.3, ..PerceiverSettings::default() };
        let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, vec![]).unwrap();
        let above = |perceiver: &Perceiver| {
            perceiver.points().filter(|(point, _)| point.z > 0.03 && point.x > 0.2).count()
        };
        for k in 0..130 {
            let t = PERIOD * f64::from(k);
            let height = (0.5 - 0.5 * (t - 1.5)).max(radius);
            let things = [ball([0.4, 0.1, height], radius)];
            let shown = usize::from((45..110).contains(&k));
            show(&mut perceiver, &eye, t, &things[..shown]);
            match k {
                50..110 => assert!(above(&perceiver) > 5, "{radius}, {k}"),
                112.. => assert_eq!(above(&perceiver), 0, "{radius}, {k}"),
                _ => {}
            }
        }
    }
}

/// Two cameras that look down, side by side, of which the second looks past what the first one has before it.
fn two_cameras() -> [DepthCamera; 2] {
    let eye = camera(2);
    let beside = DepthCamera { position: [-0.1, 0.0, 1.6], ..eye.clone() };
    [eye, beside]
}

/// A ball that one camera has lost is gone as soon as another one looks through it, whatever of the table under it is seen.
#[test]
fn a_ball_that_another_camera_looks_through_is_gone() {
    let eyes = two_cameras();
    let settings = PerceiverSettings { stride: 1, hidden: 0.3, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), eyes.to_vec(), settings, vec![]).unwrap();
    let cover = ball([0.4, 0.0, 1.3], 0.15);
    let above = |perceiver: &Perceiver| {
        perceiver.points().filter(|(p, _)| (0.03..0.5).contains(&p.z) && p.x > 0.2).count()
    };
    for k in 0..130 {
        let t = PERIOD * f64::from(k);
        let thing = ball([0.4, 0.1, (0.5 - 0.5 * (t - 1.5)).max(0.08)], 0.08);
        let shown: &[Capsule] = match k {
            45..75 => &[thing],
            75..95 => &[thing, cover],
            95.. => &[cover],
            _ => &[],
        };
        perceiver.observe(t, &AWAY, &STILL).unwrap();
        for (camera, eye) in eyes.iter().enumerate() {
            let picture = looking_down(eye, eye.position, shown);
            perceiver.see(camera, t, Depth::Millimetres(&picture)).unwrap();
        }
        match k {
            50..95 => assert!(above(&perceiver) > 5, "{k}"),
            98.. => assert_eq!(above(&perceiver), 0, "{k}"),
            _ => {}
        }
    }
}

/// A ball that stops below a board does not lend its velocity to what stands farther on, and is remembered where it may be.
#[test]
fn what_stands_is_no_ball_that_went_on_out_of_sight() {
    let eye = camera(2);
    for speed in [0.6, 1.0, 1.5] {
        let mut perceiver = deep_perceiver(&eye);
        let bar = |y: f64, z: f64, radius: f64| Capsule {
            a: V::new(0.2, y, z),
            b: V::new(0.6, y, z),
            radius,
        };
        let board: Vec<Capsule> =
            (0..7).map(|k| bar(-0.02 + 0.04 * f64::from(k), 0.8, 0.03)).collect();
        let wall: Vec<Capsule> =
            (0..8).map(|k| bar(0.45, 0.3 + 0.04 * f64::from(k), 0.03)).collect();
        for k in 0..105 {
            let t = PERIOD * f64::from(k);
            let y = (-0.35 + speed * (t - 1.2)).min(0.1);
            let mut things = [&board[..], &wall].concat();
            if t > 1.2 {
                things.push(ball([0.4, y, 0.45], 0.07));
            }
            show(&mut perceiver, &eye, t, &things);
            let stands = perceiver.points().filter(|(p, _)| (p.y - 0.45).abs() < 0.05 && p.z < 0.7);
            let fastest = stands.map(|(_, velocity)| velocity.norm()).fold(0.0, f64::max);
            assert!(k < 60 || fastest < 0.05, "{speed}, {k}: {fastest} m/s");
            let hidden = t - (1.2 + 0.45 / speed);
            // What is faster would have come out again on the other side before it counts as standing.
            if speed < 1.2 && (0.1..1.0).contains(&hidden) {
                assert!(
                    near(&perceiver, [0.4, y, 0.45], 0.25) > 5,
                    "{speed}, {k}: it is forgotten"
                );
            }
        }
    }
}

/// A picture that comes late, of another camera, ends no track.
#[test]
fn a_late_camera_ends_no_track() {
    let eyes = two_cameras();
    let settings = PerceiverSettings { stride: 1, memory: 0.0, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), eyes.to_vec(), settings, table()).unwrap();
    let shown = |eye: &DepthCamera, t: f64| {
        looking_down(eye, eye.position, &[ball([0.3, 0.5 * t, 0.5], 0.06)])
    };
    for k in 0..28 {
        let t = PERIOD * f64::from(k);
        perceiver.observe(t, &AWAY, &STILL).unwrap();
        perceiver.see(0, t, Depth::Millimetres(&shown(&eyes[0], t))).unwrap();
        if k >= 15 {
            let seen = perceiver.tracks().into_iter().find(|track| track.camera == 0).unwrap();
            assert!(seen.is_moving() && seen.seen as i32 == k + 1, "{k}: {seen:?}");
        }
        let late = t - 0.35;
        if late > 0.0 {
            perceiver.see(1, late, Depth::Millimetres(&shown(&eyes[1], late))).unwrap();
        }
    }
}
