//! The perceiver before pictures that a ray caster of this file takes, which shares no code with the core: what is followed, what
//! of an arm is left, what is remembered, and what is refused.

mod hard_scenes;
mod round;

use std::sync::Arc;
use vff_core::geometry::Shape;
use vff_core::math::Vector;
use vff_core::perception::{
    Counts, Depth, DepthCamera, Perceiver, PerceiverSettings, PerceptionError, Track,
};
use vff_core::robot::{Model, Robot, SpatialArm, models};
use vff_core::world::Motion;
use vff_core::world::space::Obstacle;

type V = Vector<3>;

/// A ball that runs from a to b.
#[derive(Debug, Clone, Copy)]
struct Capsule {
    a: V,
    b: V,
    radius: f64,
}

fn ball(at: [f64; 3], radius: f64) -> Capsule {
    Capsule { a: V::from(at), b: V::from(at), radius }
}

/// How far along a unit vector the first of it is.
fn ball_ahead(origin: &V, along: &V, centre: &V, radius: f64) -> Option<f64> {
    let off = origin - centre;
    let (b, c) = (off.dot(along), off.norm_squared() - radius * radius);
    let root = b * b - c;
    (root >= 0.0 && -b - root.sqrt() > 0.0).then(|| -b - root.sqrt())
}

impl Capsule {
    /// Of a point from its surface.
    fn distance(&self, point: &V) -> f64 {
        let way = self.b - self.a;
        let share = (point - self.a).dot(&way) / way.norm_squared().max(1e-12);
        (point - self.a - way * share.clamp(0.0, 1.0)).norm() - self.radius
    }

    fn ahead(&self, origin: &V, along: &V) -> Option<f64> {
        let ends = [self.a, self.b]
            .iter()
            .filter_map(|p| ball_ahead(origin, along, p, self.radius))
            .reduce(f64::min);
        let way = self.b - self.a;
        let length = way.norm();
        if length < 1e-9 {
            return ends;
        }
        // In the plane across the axis it is a disc.
        let axis = way / length;
        let across = |v: &V| v - axis * axis.dot(v);
        let (off, dir) = (across(&(origin - self.a)), across(along));
        let (a, b, c) =
            (dir.norm_squared(), off.dot(&dir), off.norm_squared() - self.radius * self.radius);
        let root = b * b - a * c;
        let side = (a > 1e-12 && root >= 0.0).then(|| (-b - root.sqrt()) / a).filter(|s| {
            let at = axis.dot(&(origin + along * *s - self.a));
            *s > 0.0 && (0.0..=length).contains(&at)
        });
        [ends, side].into_iter().flatten().reduce(f64::min)
    }
}

/// What a camera without distortion that looks straight down from a point sees above a table at z = 0: whole millimetres.
fn looking_down(camera: &DepthCamera, from: [f64; 3], things: &[Capsule]) -> Vec<u16> {
    let origin = V::from(from);
    let mut picture = Vec::with_capacity(camera.rows * camera.columns);
    for row in 0..camera.rows {
        for column in 0..camera.columns {
            let x = (column as f64 - camera.centre[0]) / camera.focal[0];
            let y = (row as f64 - camera.centre[1]) / camera.focal[1];
            // Turned about x by half a turn: y and z of the camera point the other way.
            let ray = V::new(x, -y, -1.0);
            let along = ray.normalize();
            let table = origin.z;
            let depth = things
                .iter()
                .filter_map(|thing| thing.ahead(&origin, &along))
                .map(|s| s / ray.norm())
                .fold(table, f64::min);
            picture.push((1000.0 * depth).round() as u16);
        }
    }
    picture
}

fn camera(scale: usize) -> DepthCamera {
    let [columns, rows] = [640 / scale, 480 / scale];
    let focal = 550.0 / scale as f64;
    DepthCamera {
        columns,
        rows,
        focal: [focal; 2],
        centre: [0.5 * (columns - 1) as f64, 0.5 * (rows - 1) as f64],
        distortion: [0.0; 5],
        position: [0.4, 0.0, 1.6],
        orientation: [0.0, 1.0, 0.0, 0.0],
    }
}

fn panda() -> Arc<SpatialArm> {
    Arc::new(models::named("panda").unwrap().build().unwrap())
}

fn table() -> Vec<Obstacle> {
    vec![Obstacle::of(Shape::HalfSpace { normal: [0.0, 0.0, 1.0] })]
}

/// Folded to the other side of the base.
const AWAY: [f64; 7] = [0.0, -1.5, 0.0, -2.8, 0.0, 1.6, 0.8];
const STILL: [f64; 7] = [0.0; 7];
const PERIOD: f64 = 1.0 / 30.0;

/// Before a picture that shows these things at time t, with the arm away.
fn show(perceiver: &mut Perceiver, eye: &DepthCamera, t: f64, things: &[Capsule]) -> Counts {
    perceiver.observe(t, &AWAY, &STILL).unwrap();
    let picture = looking_down(eye, eye.position, things);
    perceiver.see(0, t, Depth::Millimetres(&picture)).unwrap()
}

/// How many points are near a place.
fn near(perceiver: &Perceiver, place: [f64; 3], radius: f64) -> usize {
    perceiver.points().filter(|(point, _)| (point - V::from(place)).norm() < radius).count()
}

/// A ball of 8 cm at 0.5 m/s, in pictures of whole millimetres: its velocity is known to a tenth after four, the points of it
/// have that velocity, and the trail behind it is free.
#[test]
fn the_velocity_of_a_ball_is_known_after_four_pictures() {
    let eye = camera(1);
    for (number, way) in [[0.5, 0.0, 0.0], [0.3, -0.4, 0.0], [0.0, 0.3, 0.4], [-0.2, 0.4, -0.2]]
        .into_iter()
        .enumerate()
    {
        let velocity = V::from(way);
        let mut perceiver =
            Perceiver::new(&panda(), vec![eye.clone()], PerceiverSettings::default(), table())
                .unwrap();
        let at = |t: f64| V::new(0.4, 0.0, 0.5) + velocity * t;
        for k in 0..4 {
            let t = PERIOD * f64::from(k);
            show(&mut perceiver, &eye, t, &[ball(at(t).into(), 0.04)]);
        }
        let moving: Vec<Track> = perceiver.tracks().into_iter().filter(Track::is_moving).collect();
        assert_eq!(moving.len(), 1, "{number}: {:?}", perceiver.tracks());
        let off = (moving[0].velocity - velocity).norm();
        println!("way {number}: off by {off:.4} m/s");
        assert!(
            off < 0.1 * velocity.norm(),
            "{number}: {} instead of {velocity}",
            moving[0].velocity
        );
        let own: Vec<V> =
            perceiver.points().map(|(_, velocity)| velocity).filter(|v| v.norm() > 0.0).collect();
        assert!(own.len() > 5 && own.iter().all(|v| *v == moving[0].velocity));
        for k in 4..20 {
            let t = PERIOD * f64::from(k);
            show(&mut perceiver, &eye, t, &[ball(at(t).into(), 0.04)]);
        }
        let there = at(19.0 * PERIOD);
        let behind = perceiver.points().filter(|(point, _)| {
            let off = point - there;
            off.norm() > 0.1
        });
        assert_eq!(behind.count(), 0, "{number}: a trail is left");
    }
}

/// A forearm that reaches into the picture grows as it comes: it moves with its hand, not with its middle, which is half as fast.
#[test]
fn what_comes_into_the_picture_is_as_fast_as_its_tip() {
    let eye = camera(2);
    let mut perceiver =
        Perceiver::new(&panda(), vec![eye.clone()], PerceiverSettings::default(), table()).unwrap();
    let velocity = V::new(0.0, -0.8, 0.0);
    for k in 0..16 {
        let t = PERIOD * f64::from(k);
        let hand = V::new(0.4, 0.55, 0.5) + velocity * t;
        let arm = Capsule { a: hand, b: hand + V::new(0.05, 0.4, 0.1), radius: 0.05 };
        show(&mut perceiver, &eye, t, &[arm]);
        if k >= 5 {
            let tracks = perceiver.tracks();
            let best = tracks.iter().max_by_key(|track| track.points).unwrap();
            println!(
                "{k} {} {:?} {:?}",
                best.is_cut,
                best.velocity.as_slice(),
                best.position.as_slice()
            );
            assert!((best.velocity.y + 0.8).abs() < 0.16, "{k}: {best:?}");
        }
    }
}

/// A ball that comes into the room shows more and more of itself: that it grows to both sides is no motion to one of them.
#[test]
fn what_grows_to_both_sides_does_not_move_aside() {
    let eye = camera(2);
    let room = [[-1.0, -1.0, -0.2], [1.0, 0.2, 1.4]];
    let settings = PerceiverSettings { room, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap();
    let velocity = V::new(0.0, -0.5, 0.0);
    let mut cut = 0;
    for k in 0..16 {
        let t = PERIOD * f64::from(k);
        let centre = V::new(0.4, 0.31, 0.5) + velocity * t;
        show(&mut perceiver, &eye, t, &[ball(centre.into(), 0.1)]);
        for track in perceiver.tracks().iter().filter(|track| track.is_cut && track.is_moving()) {
            assert!(track.velocity.x.abs() < 0.2, "{k}: {track:?}");
            cut += 1;
        }
    }
    assert!(cut > 3, "{cut}");
}

/// One ball circles while others come and go near by: it stays the same body, since one that was not seen for long, and may be
/// anywhere by now, is hardly just there; and after `memory` nobody looks for that any more.
#[test]
fn a_body_is_not_taken_for_one_that_went() {
    let eye = camera(2);
    let settings = PerceiverSettings { memory: 1.0, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap();
    let circling = |t: f64| ball([0.4 + 0.15 * (3.0 * t).cos(), 0.15 * (3.0 * t).sin(), 0.5], 0.05);
    let mut number = None;
    for k in 0..300 {
        let t = PERIOD * f64::from(k);
        let mut things = vec![circling(t)];
        // Every second another one passes for a fifth of it.
        let after = t.fract();
        if after < 0.2 {
            things.push(ball([0.1, 0.3 - after, 0.6], 0.06));
        }
        show(&mut perceiver, &eye, t, &things);
        let tracks = perceiver.tracks();
        assert!(tracks.iter().all(|track| t - track.time <= 1.0), "{k}: {tracks:?}");
        assert!(tracks.len() < 5, "{k}: {tracks:?}");
        if k >= 5 {
            let there = circling(t).a;
            let seen = |track: &&Track| track.time >= t && (track.position - there).norm() < 0.1;
            let found = tracks.iter().find(seen).expect("it is followed").number;
            assert_eq!(*number.get_or_insert(found), found, "{k}: {tracks:?}");
        }
    }
}

/// Two cameras take turns: each follows the ball by itself, and at the time of the last picture the points of both are on it.
#[test]
fn two_cameras_see_one_ball() {
    let eyes = [camera(1), DepthCamera { position: [0.3, 0.3, 1.8], ..camera(1) }];
    let mut perceiver =
        Perceiver::new(&panda(), eyes.to_vec(), PerceiverSettings::default(), table()).unwrap();
    let velocity = V::new(0.3, 0.4, 0.0);
    let at = |t: f64| V::new(0.45, -0.1, 0.5) + velocity * t;
    for k in 0..10 {
        let (t, turn) = (0.5 * PERIOD * f64::from(k), k as usize % 2);
        perceiver.observe(t, &AWAY, &STILL).unwrap();
        let picture = looking_down(&eyes[turn], eyes[turn].position, &[ball(at(t).into(), 0.05)]);
        perceiver.see(turn, t, Depth::Millimetres(&picture)).unwrap();
    }
    let tracks = perceiver.tracks();
    assert_eq!(tracks.iter().map(|track| track.camera).collect::<Vec<_>>(), [0, 1]);
    for track in &tracks {
        assert!(track.seen == 5 && (track.velocity - velocity).norm() < 0.05, "{track:?}");
    }
    let there = at(perceiver.last().unwrap());
    let moving: Vec<V> =
        perceiver.points().filter(|(_, v)| v.norm() > 0.0).map(|(point, _)| point).collect();
    assert!(moving.len() > 10);
    for point in moving {
        assert!(((point - there).norm() - 0.05).abs() < 0.012, "{point} {there}");
    }
}

/// What stands is seen where it is, at rest; the table, which is known, is not.
#[test]
fn what_stands_rests() {
    let eye = camera(2);
    let mut perceiver =
        Perceiver::new(&panda(), vec![eye.clone()], PerceiverSettings::default(), table()).unwrap();
    let thing = Capsule { a: V::new(0.3, -0.2, 0.2), b: V::new(0.6, 0.2, 0.3), radius: 0.05 };
    for k in 0..60 {
        show(&mut perceiver, &eye, PERIOD * f64::from(k), &[thing]);
    }
    assert!(perceiver.points().count() > 100);
    for (point, velocity) in perceiver.points() {
        let off = thing.distance(&point);
        assert!(off.abs() < 0.015, "{point} is {off} off");
        assert_eq!(velocity, V::zeros());
    }
}

/// A Panda swings as fast as a metre and a half a second, the clock of the camera is off by 20 ms either way and its place by 5 mm:
/// not a point of it is left. A ball 5 cm beside a link that stands is seen.
#[test]
fn nothing_of_the_arm_is_left() {
    let (arm, eye) = (panda(), camera(2));
    let mut fastest = 0.0_f64;
    for (late, off) in
        [(0.02, [0.005, 0.0, 0.0]), (-0.02, [0.0, -0.003, 0.004]), (0.0, [0.0, 0.0, -0.005])]
    {
        let mut perceiver =
            Perceiver::new(&arm, vec![eye.clone()], PerceiverSettings::default(), table()).unwrap();
        let mut state = Model::state(&arm);
        let mean = [0.0, -0.3, 0.0, -1.9, 0.0, 1.6, 0.8];
        let swing = [0.9, 0.4, 0.3, 0.4, 0.5, 0.3, 0.6];
        let rate = [2.0, 1.7, 2.3, 2.6, 3.0, 2.1, 2.7];
        let q = |t: f64| -> Vec<f64> {
            (0..7).map(|i| mean[i] + swing[i] * (rate[i] * t).sin()).collect()
        };
        let dq = |t: f64| -> Vec<f64> {
            (0..7).map(|i| swing[i] * rate[i] * (rate[i] * t).cos()).collect()
        };
        let mut own = 0;
        for k in 0..400 {
            let t = 0.01 * f64::from(k);
            perceiver.observe(t, &q(t), &dq(t)).unwrap();
            if k % 3 != 2 {
                continue;
            }
            let taken = t - 0.005; // between two states
            let really = taken + late;
            state.update(&q(really), &dq(really));
            let mut things: Vec<Capsule> = vec![];
            for body in state.bodies() {
                fastest = fastest.max(state.point_velocity(body.link, &body.shape.end()).norm());
                assert!(body.hull.is_none(), "the bodies of a Panda are capsules");
                things.push(Capsule {
                    a: body.shape.start,
                    b: body.shape.end(),
                    radius: body.shape.radius,
                });
            }
            things.extend(state.still_bodies().iter().map(|still| Capsule {
                a: still.shape.start,
                b: still.shape.end(),
                radius: still.shape.radius,
            }));
            let from = [0, 1, 2].map(|k| eye.position[k] + off[k]);
            let picture = looking_down(&eye, from, &things);
            let counts = perceiver.see(0, taken, Depth::Millimetres(&picture)).unwrap();
            own += counts.own;
            let left: Vec<V> = perceiver.points().map(|(point, _)| point).collect();
            assert!(left.is_empty(), "late by {late}, at {t}: {left:?}");
        }
        assert!(own > 100_000, "the arm was in view");
    }
    assert!(fastest > 1.2, "{fastest}");

    let mut state = Model::state(&arm);
    let q = [0.0, -0.3, 0.0, -1.9, 0.0, 1.6, 0.8];
    state.update(&q, &STILL);
    let things: Vec<Capsule> = state
        .bodies()
        .map(|body| Capsule { a: body.shape.start, b: body.shape.end(), radius: body.shape.radius })
        .collect();
    let gap =
        |place: &V| things.iter().map(|thing| thing.distance(place)).fold(f64::INFINITY, f64::min);
    let origin = V::from(eye.position);
    let mut seen = 0;
    for thing in &things {
        for aside in [V::y(), -V::y(), V::x()] {
            // The surface of the ball is 5 cm from that of the arm, and in view.
            let beside = thing.b + aside * (thing.radius + 0.05 + 0.02);
            let way = beside - origin;
            let along = way.normalize();
            let is_hidden = things.iter().any(|each| {
                let tight = Capsule { radius: each.radius + 0.03, ..*each };
                tight.ahead(&origin, &along).is_some_and(|s| s < way.norm())
            });
            if is_hidden || gap(&beside) < 0.069 || beside.z > 1.0 {
                continue;
            }
            let mut perceiver =
                Perceiver::new(&arm, vec![eye.clone()], PerceiverSettings::default(), table())
                    .unwrap();
            perceiver.observe(0.0, &q, &STILL).unwrap();
            let shown = [&things[..], &[ball(beside.into(), 0.02)]].concat();
            let picture = looking_down(&eye, eye.position, &shown);
            perceiver.see(0, 0.0, Depth::Millimetres(&picture)).unwrap();
            assert!(near(&perceiver, beside.into(), 0.03) > 0, "{beside}");
            seen += 1;
        }
    }
    assert!(seen > 4, "{seen} places are in view");
}

/// What is hidden stays remembered for as long as is said, and what is seen through is free at once or nearly.
#[test]
fn what_is_hidden_is_remembered() {
    let eye = camera(2);
    let settings = PerceiverSettings { memory: 0.5, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap();
    let place = [0.4, 0.1, 0.2];
    let (thing, cover) = (ball(place, 0.05), ball([0.4, 0.07, 0.8], 0.2));
    let mut t = 0.0;
    let mut look = |perceiver: &mut Perceiver, things: &[Capsule]| {
        t += PERIOD;
        show(perceiver, &eye, t, things)
    };
    for _ in 0..5 {
        look(&mut perceiver, &[thing]);
    }
    let seen = near(&perceiver, place, 0.06);
    assert!(seen > 10);
    // Hidden: it may be there still, whether it is or not.
    for _ in 0..14 {
        let counts = look(&mut perceiver, &[cover]);
        assert!(counts.remembered >= seen);
        assert_eq!(near(&perceiver, place, 0.06), seen);
    }
    for _ in 0..3 {
        look(&mut perceiver, &[cover]);
    }
    assert_eq!(near(&perceiver, place, 0.06), 0, "after half a second it is forgotten");
    for _ in 0..3 {
        look(&mut perceiver, &[thing]);
    }
    assert!(near(&perceiver, place, 0.06) > 10);
    for _ in 0..3 {
        look(&mut perceiver, &[]);
    }
    assert_eq!(perceiver.points().count(), 0, "the table is seen through all of it");
}

/// A cloud in the frame of the camera says what the picture says that it makes.
#[test]
fn clouds_are_pictures() {
    let mut eye = camera(4);
    eye.position[2] = 1.6003; // so that no whole millimetre is a border of cells
    let (thing, settings) = (
        ball([0.4, 0.1, 0.5], 0.1),
        PerceiverSettings { stride: 1, ..PerceiverSettings::default() },
    );
    let mut pair = [0, 1].map(|_| {
        let mut perceiver =
            Perceiver::new(&panda(), vec![eye.clone()], settings.clone(), table()).unwrap();
        perceiver.observe(0.0, &AWAY, &STILL).unwrap();
        perceiver
    });
    let picture = looking_down(&eye, eye.position, &[thing]);
    let cloud: Vec<[f64; 3]> = (0..picture.len())
        .map(|k| {
            let depth = 1e-3 * f64::from(picture[k]);
            let x = ((k % eye.columns) as f64 - eye.centre[0]) / eye.focal[0];
            let y = ((k / eye.columns) as f64 - eye.centre[1]) / eye.focal[1];
            [x * depth, y * depth, depth]
        })
        .collect();
    pair[0].see(0, 0.0, Depth::Millimetres(&picture)).unwrap();
    pair[1].see_points(0, 0.0, &cloud).unwrap();
    let [found, expected] =
        pair.map(|perceiver| perceiver.points().map(|(point, _)| point).collect::<Vec<V>>());
    assert!(!found.is_empty() && found.len() == expected.len());
    assert!(found.iter().zip(&expected).all(|(a, b)| (a - b).norm() < 1e-6));
}

/// Whatever is shown, no more cells are remembered than there is room for; the rest is counted.
#[test]
fn memory_is_bounded() {
    let eye = camera(4);
    let settings = PerceiverSettings { most_voxels: 40, stride: 1, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, vec![]).unwrap();
    for k in 0..5 {
        let counts = show(&mut perceiver, &eye, PERIOD * f64::from(k), &[]);
        assert!(counts.left_out > 1000);
        assert_eq!(perceiver.points().count(), 40);
    }
}

#[test]
fn what_is_of_no_use_is_refused() {
    let eye = camera(4);
    let refused = |change: fn(&mut PerceiverSettings)| {
        let mut settings = PerceiverSettings::default();
        change(&mut settings);
        Perceiver::new(&panda(), vec![camera(4)], settings, vec![]).unwrap_err().to_string()
    };
    for (fault, expected) in [
        (refused(|it| it.voxel = 0.0), "settings.voxel: must be greater than 0, got 0"),
        (refused(|it| it.voxel = 1e-4), "settings.room: has 20000 × 20000 × 16000 cells"),
        (refused(|it| it.room[0][2] = 9.0), "settings.room: must have lower corners"),
        (refused(|it| it.most_voxels = 50_001), "settings.most_voxels: must be at most 50000"),
        (refused(|it| it.time_offset = f64::NAN), "settings.time_offset: must be finite"),
    ] {
        assert!(fault.contains(expected), "{fault}");
    }
    let mut perceiver =
        Perceiver::new(&panda(), vec![eye.clone()], PerceiverSettings::default(), vec![]).unwrap();
    let picture = vec![0_u16; eye.rows * eye.columns];
    let depth = Depth::Millimetres(&picture);
    assert!(matches!(perceiver.see(0, 0.0, depth), Err(PerceptionError::NoState { .. })));
    perceiver.observe(0.0, &AWAY, &STILL).unwrap();
    assert!(matches!(perceiver.see(0, 0.2, depth), Err(PerceptionError::NoState { .. })));
    assert!(matches!(
        perceiver.see(1, 0.0, depth),
        Err(PerceptionError::NotThere { given: 1, count: 1 })
    ));
    assert!(matches!(
        perceiver.see(0, 0.0, Depth::Metres(&[1.0])),
        Err(PerceptionError::Size { .. })
    ));
    assert!(matches!(perceiver.observe(0.0, &AWAY, &STILL), Err(PerceptionError::NotLater { .. })));
    assert!(matches!(
        perceiver.observe(1.0, &AWAY[..6], &STILL),
        Err(PerceptionError::State { name: "q", .. })
    ));
    assert!(matches!(
        perceiver.observe(1.0, &AWAY, &[f64::NAN; 7]),
        Err(PerceptionError::State { name: "dq", .. })
    ));
    perceiver.see(0, 0.0, depth).unwrap();
    assert!(matches!(perceiver.see(0, 0.0, depth), Err(PerceptionError::NotLater { .. })));
    assert_eq!(perceiver.points().count(), 0);
}

/// A ball over which something is held while it moves goes on as it was seen to move, for three tenths of a second, and then stands.
#[test]
fn what_is_hidden_goes_on_for_a_while() {
    let eye = camera(2);
    let settings = PerceiverSettings { stride: 1, ..PerceiverSettings::default() };
    let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap();
    let at = |t: f64| [0.4, -0.15 + 0.5 * t, 0.4];
    let cover = ball([0.4, 0.0, 1.25], 0.2);
    let low = |perceiver: &Perceiver| -> Vec<(V, V)> {
        perceiver.points().filter(|(point, _)| point.z < 0.7).collect()
    };
    for k in 0..8 {
        let t = PERIOD * f64::from(k);
        show(&mut perceiver, &eye, t, &[ball(at(t), 0.06)]);
    }
    for k in 8..14 {
        let t = PERIOD * f64::from(k);
        show(&mut perceiver, &eye, t, &[ball(at(t), 0.06), cover]);
        let points = low(&perceiver);
        assert!(points.len() > 10);
        let mean = points.iter().map(|(point, _)| point.y).sum::<f64>() / points.len() as f64;
        assert!((mean - at(t)[1]).abs() < 0.03, "{mean} at {t}");
    }
    show(&mut perceiver, &eye, PERIOD * 18.0, &[cover]);
    let stopped = low(&perceiver);
    show(&mut perceiver, &eye, PERIOD * 24.0, &[cover]);
    assert!(stopped.len() > 10 && stopped.iter().all(|(_, velocity)| *velocity == V::zeros()));
    assert_eq!(stopped, low(&perceiver));
    show(&mut perceiver, &eye, PERIOD * 100.0, &[cover]);
    assert!(low(&perceiver).is_empty());
}

/// Of a ball that is seen from above there is a lower side as well, where that is asked for and the ball is not too wide for it.
#[test]
fn a_ball_has_another_side() {
    let lowest = |hidden: f64, radius: f64| {
        let eye = camera(2);
        let settings = PerceiverSettings { stride: 1, hidden, ..PerceiverSettings::default() };
        let mut perceiver = Perceiver::new(&panda(), vec![eye.clone()], settings, table()).unwrap();
        let thing = ball([0.4, 0.1, 0.5], radius);
        show(&mut perceiver, &eye, 0.0, &[thing]);
        for (point, _) in perceiver.points() {
            assert!(thing.distance(&point).abs() < 0.2 * radius + 0.02, "{point}");
        }
        perceiver.points().map(|(point, _)| point.z).fold(f64::INFINITY, f64::min)
    };
    assert!(lowest(0.0, 0.08) > 0.48);
    assert!((lowest(0.3, 0.08) - 0.42).abs() < 0.03);
    assert!(lowest(0.1, 0.08) > 0.48);
}
