//! Whether a perceiver ever leaves a point of the arm itself: pictures of arms that move, by cameras that stand 5 mm beside where they
//! are said to stand and whose clocks are 20 ms off, by a ray caster of this file. Every point that is left is a fault.
//!
//! `cargo bench --bench self_filter -- [PICTURES] [THREADS] [DEGREES] [NOISE] [TIMES]`: cameras are also turned by so many degrees, and
//! depths have so much noise at 1 m \[mm\], with a margin of 3 cm then, as the bundled scene has. TIMES makes place and clock so many
//! times as wrong, of which the perceiver is not told.

use std::env;
use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use std::thread;
use std::time::Instant;
use vff_core::geometry::{Shape, faces_of_hull};
use vff_core::math::{UnitQuaternion, Vector};
use vff_core::perception::{Depth, DepthCamera, Perceiver, PerceiverSettings};
use vff_core::robot::description::LinkShape;
use vff_core::robot::{Model, Robot, SpatialArm, models};

type V = Vector<3>;

const ARMS: [&str; 7] = ["panda", "fr3", "iiwa14", "ur5e", "ur10e", "gen3", "xarm7"];
const SIZE: [usize; 2] = [64, 48];
const PERIOD: f64 = 1.0 / 30.0;
/// Pictures of one recording, and states in a second.
const LENGTH: usize = 25;
const STATES: f64 = 250.0;
const CLOCK: f64 = 0.02;
const OFF: f64 = 0.005;

/// Numbers that look random, the same ones for the same seed (Steele et al., SplitMix64).
struct Draws(u64);

impl Draws {
    fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.share()
    }

    fn direction(&mut self) -> V {
        let [z, around] = [self.between(-1.0, 1.0), self.between(0.0, TAU)];
        let side = (1.0 - z * z).sqrt();
        V::new(side * around.cos(), side * around.sin(), z)
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.share()).ln()).sqrt() * (TAU * self.share()).cos()
    }
}

/// What a ray can meet.
enum Solid {
    /// A ball that runs from one end to the other.
    Capsule([V; 2], f64),
    /// Triangles, and a ball around them.
    Triangles(Vec<[V; 3]>, V, f64),
}

/// How far along a unit vector a ball begins.
fn ball_ahead(origin: &V, along: &V, centre: &V, radius: f64) -> Option<f64> {
    let off = origin - centre;
    let (b, c) = (off.dot(along), off.norm_squared() - radius * radius);
    let root = b * b - c;
    (root >= 0.0 && -b - root.sqrt() > 0.0).then(|| -b - root.sqrt())
}

/// How far along it meets a triangle (Möller and Trumbore).
fn triangle_ahead(origin: &V, along: &V, [a, b, c]: &[V; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let across = along.cross(&ac);
    let volume = ab.dot(&across);
    let off = origin - a;
    let u = off.dot(&across) / volume;
    let turned = off.cross(&ab);
    let v = along.dot(&turned) / volume;
    let s = ac.dot(&turned) / volume;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && s > 0.0).then_some(s)
}

impl Solid {
    fn ahead(&self, origin: &V, along: &V) -> Option<f64> {
        match self {
            Self::Capsule([a, b], radius) => {
                let ends = [a, b].into_iter().filter_map(|p| ball_ahead(origin, along, p, *radius));
                let way = b - a;
                let length = way.norm();
                let side = (length > 1e-9).then(|| {
                    // In the plane across the axis it is a disc.
                    let axis = way / length;
                    let across = |v: &V| v - axis * axis.dot(v);
                    let (off, dir) = (across(&(origin - a)), across(along));
                    let (k, l) = (dir.norm_squared(), off.dot(&dir));
                    let root = l * l - k * (off.norm_squared() - radius * radius);
                    let s = (-l - root.max(0.0).sqrt()) / k;
                    let at = axis.dot(&(origin + along * s - a));
                    (k > 1e-12 && root >= 0.0 && s > 0.0 && (0.0..=length).contains(&at))
                        .then_some(s)
                });
                ends.chain(side.flatten()).reduce(f64::min)
            }
            Self::Triangles(all, centre, radius) => {
                ball_ahead(origin, along, centre, *radius)?;
                all.iter().filter_map(|each| triangle_ahead(origin, along, each)).reduce(f64::min)
            }
        }
    }

    fn moved(&self, to: impl Fn(&V) -> V) -> Self {
        match self {
            Self::Capsule(ends, radius) => Self::Capsule([to(&ends[0]), to(&ends[1])], *radius),
            Self::Triangles(all, centre, radius) => {
                let moved =
                    all.iter().map(|corners| [to(&corners[0]), to(&corners[1]), to(&corners[2])]);
                Self::Triangles(moved.collect(), to(centre), *radius)
            }
        }
    }
}

/// An arm, and what its links look like: the number of a moving link, none for the base, and a solid in its frame.
struct Case {
    arm: Arc<SpatialArm>,
    looks: Vec<(Option<usize>, Solid)>,
}

impl Case {
    /// A bundled arm; with `corners` its capsules are hulls of as many points on them.
    fn new(name: &str, corners: Option<usize>) -> Self {
        let mut description = models::named(name).unwrap();
        let mut draws = Draws(7);
        if let Some(corners) = corners {
            for LinkShape { shape, .. } in &mut description.collision {
                let ([a, b], radius) = match &shape.shape {
                    Shape::Capsule { a, b, radius } => ([V::from(*a), V::from(*b)], *radius),
                    Shape::Sphere { radius } => {
                        ([V::from(shape.center.unwrap_or_default()); 2], *radius)
                    }
                    _ => continue,
                };
                let vertices = (0..corners).map(|k| {
                    let end = if k % 2 == 0 { a } else { b };
                    (end + draws.direction() * radius).into()
                });
                *shape = Shape::Convex { vertices: vertices.collect() }.into();
            }
        }
        let arm = Arc::new(description.build().unwrap());
        let described = arm.description();
        let looks = described.collision.iter().map(|LinkShape { link, shape, .. }| {
            let link = described.joints.iter().position(|joint| joint.link == *link);
            let solid = match &shape.shape {
                Shape::Capsule { a, b, radius } => {
                    Solid::Capsule([V::from(*a), V::from(*b)], *radius)
                }
                Shape::Sphere { radius } => {
                    Solid::Capsule([V::from(shape.center.unwrap_or_default()); 2], *radius)
                }
                Shape::Convex { vertices } => {
                    let points: Vec<V> = vertices.iter().map(|p| V::from(*p)).collect();
                    let centre = points.iter().sum::<V>() / points.len() as f64;
                    let radius = points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
                    let mut all = vec![];
                    for face in faces_of_hull(vertices).unwrap() {
                        all.extend(
                            face[1..]
                                .windows(2)
                                .map(|two| [face[0], two[0], two[1]].map(|k| points[k])),
                        );
                    }
                    Solid::Triangles(all, centre, radius)
                }
                other => panic!("no caster for {other:?}"),
            };
            (link, solid)
        });
        let looks = looks.collect();
        Self { arm, looks }
    }
}

/// What was counted.
#[derive(Default)]
struct Tally {
    pictures: usize,
    own: usize,
    survivors: usize,
    recordings: Vec<u64>,
    fastest: f64,
    aside: f64,
}

/// How cameras are wrong, beside place and clock: a turn \[°\], noise at 1 m \[m\], and how many times as wrong those two are.
struct Wrong {
    degrees: f64,
    noise: f64,
    times: f64,
}

/// One recording: an arm that swings about a posture, and a camera that looks at it from somewhere.
fn recording(cases: &[Case], seed: u64, wrong: &Wrong, tally: &mut Tally) {
    let Wrong { degrees, noise, times } = *wrong;
    let draws = &mut Draws(seed.wrapping_mul(0x2545_f491_4f6c_dd1d));
    let Case { arm, looks } = &cases[seed as usize % cases.len()];
    let limits = arm.limits();
    let n = arm.dof();
    let hurry = draws.between(0.1, 1.0);
    let swings: Vec<[f64; 4]> = (0..n)
        .map(|i| {
            let [low, high] =
                limits.joint.get(i).map_or([-PI, PI], |it| it.map(|x| x.clamp(-PI, PI)));
            let fastest = limits.velocity.get(i).copied().filter(|v| v.is_finite()).unwrap_or(2.0);
            let rate = draws.between(0.5, 4.0);
            let size = (hurry * fastest / rate).min(0.5 * (high - low));
            [draws.between(low + size, high - size), size, rate, draws.between(0.0, TAU)]
        })
        .collect();
    let at = |t: f64| -> [Vec<f64>; 2] {
        let angle = |[mean, size, rate, phase]: &[f64; 4]| mean + size * (rate * t + phase).sin();
        let speed = |[_, size, rate, phase]: &[f64; 4]| size * rate * (rate * t + phase).cos();
        [swings.iter().map(angle).collect(), swings.iter().map(speed).collect()]
    };
    // It looks at a place of the arm, upright or not.
    let middle = V::new(0.0, 0.0, 0.4);
    let position = middle + draws.direction() * draws.between(0.9, 1.8);
    let forward = (middle + draws.direction() * 0.3 - position).normalize();
    let right = forward.cross(&draws.direction()).normalize();
    let axes = nalgebra::Matrix3::from_columns(&[right, forward.cross(&right), forward]);
    let said = UnitQuaternion::from_matrix(&axes);
    let focal = 0.5 * SIZE[0] as f64 / draws.between(0.45, 0.8).tan();
    let camera = DepthCamera {
        columns: SIZE[0],
        rows: SIZE[1],
        focal: [focal; 2],
        centre: SIZE.map(|count| 0.5 * count as f64 - 0.5),
        distortion: [0.0; 5],
        position: position.into(),
        orientation: said.to_array(),
    };
    let origin = position + draws.direction() * OFF * times;
    let turn =
        UnitQuaternion::exp(&(draws.direction() * degrees.to_radians())).matrix() * said.matrix();
    let settings = PerceiverSettings {
        stride: 1,
        least_points: 1,
        room: [[-1.6, -1.6, -1.2], [1.6, 1.6, 2.0]],
        margin: if degrees > 0.0 { 0.03 } else { 0.02 },
        ..PerceiverSettings::default()
    };
    let mut perceiver = Perceiver::new(arm, vec![camera], settings, vec![]).unwrap();
    let ahead = times * if draws.share() < 0.5 { CLOCK } else { -CLOCK };
    // Half of the recordings are taken in when all states are known, the others while they happen.
    let later = if draws.share() < 0.5 { 2.0 * times * CLOCK } else { 0.0 };
    let mut state = Model::state(arm);
    let mut told = -0.1;
    for k in 0..LENGTH {
        let t = PERIOD * k as f64;
        while told <= t + later {
            let [q, dq] = at(told);
            perceiver.observe(told, &q, &dq).unwrap();
            told += 1.0 / STATES;
        }
        let [q, dq] = at(t);
        state.update(&q, &dq);
        let solids: Vec<Solid> = (looks.iter())
            .map(|(link, solid)| match link {
                Some(link) => {
                    let (place, axes) = state.link_frame(*link);
                    solid.moved(|p| place + axes * p)
                }
                None => {
                    let mount = &arm.description().mount;
                    let axes = UnitQuaternion::new(mount.orientation).unwrap().matrix();
                    solid.moved(|p| V::from(mount.position) + axes * p)
                }
            })
            .collect();
        for body in state.bodies() {
            let speed = state.point_velocity(body.link, &body.shape.end()).norm();
            tally.fastest = tally.fastest.max(speed);
        }
        let mut picture = Vec::with_capacity(SIZE[0] * SIZE[1]);
        for row in 0..SIZE[1] {
            for column in 0..SIZE[0] {
                let [x, y] = [column as f64 - 31.5, row as f64 - 23.5].map(|at| at / focal);
                let ray = turn * V::new(x, y, 1.0);
                let (length, along) = (ray.norm(), ray.normalize());
                let first = solids.iter().filter_map(|solid| solid.ahead(&origin, &along));
                let depth = first.fold(f64::INFINITY, f64::min) / length;
                let depth = depth + noise * depth * depth * draws.normal();
                picture.push(if depth.is_finite() { (1000.0 * depth).round() as u16 } else { 0 });
            }
        }
        let counts = perceiver.see(0, t + ahead, Depth::Millimetres(&picture)).unwrap();
        tally.pictures += 1;
        tally.own += counts.own;
        let left = perceiver.points().count() + counts.left_out;
        if left > 0 {
            tally.survivors += left;
            tally.recordings.push(seed);
            for (point, _) in perceiver.points() {
                // As far as the nearest ray of the camera sees it from the arm.
                let gap = solids
                    .iter()
                    .map(|solid| distance(solid, &point))
                    .fold(f64::INFINITY, f64::min);
                tally.aside = tally.aside.max(gap);
            }
        }
    }
}

/// How far a point is from a solid; of triangles, from their corners.
fn distance(solid: &Solid, point: &V) -> f64 {
    match solid {
        Solid::Capsule([a, b], radius) => {
            let way = b - a;
            let share = (point - a).dot(&way) / way.norm_squared().max(1e-12);
            (point - a - way * share.clamp(0.0, 1.0)).norm() - radius
        }
        Solid::Triangles(all, ..) => {
            all.iter().flatten().map(|p| (p - point).norm()).fold(f64::INFINITY, f64::min)
        }
    }
}

fn main() {
    let given: Vec<f64> = env::args().skip(1).filter_map(|word| word.parse().ok()).collect();
    let pictures = given.first().map_or(2000, |count| *count as usize);
    let threads = given.get(1).map_or(1, |count| *count as usize);
    let other = |place: usize, usual: f64| given.get(place).copied().unwrap_or(usual);
    let wrong = Wrong { degrees: other(2, 0.0), noise: 1e-3 * other(3, 0.0), times: other(4, 1.0) };
    let bundled = ARMS.iter().map(|name| Case::new(name, None));
    let hulls =
        [("panda", 24), ("iiwa14", 40)].map(|(name, corners)| Case::new(name, Some(corners)));
    let cases: Vec<Case> = bundled.chain(hulls).collect();
    let recordings = pictures.div_ceil(LENGTH);
    let begun = Instant::now();
    let mut all = Tally::default();
    thread::scope(|scope| {
        let workers: Vec<_> = (0..threads)
            .map(|worker| {
                let (cases, wrong) = (&cases, &wrong);
                scope.spawn(move || {
                    let mut tally = Tally::default();
                    for k in (worker..recordings).step_by(threads) {
                        recording(cases, k as u64 + 1, wrong, &mut tally);
                    }
                    tally
                })
            })
            .collect();
        for worker in workers {
            let part = worker.join().unwrap();
            all.pictures += part.pictures;
            all.own += part.own;
            all.survivors += part.survivors;
            all.recordings.extend(part.recordings);
            all.fastest = all.fastest.max(part.fastest);
            all.aside = all.aside.max(part.aside);
        }
    });
    all.recordings.dedup();
    println!(
        "{} pictures in {:.0} s, {} arms, up to {:.1} m/s: {} points of the arm cut away, {} left in {} recordings{}",
        all.pictures,
        begun.elapsed().as_secs_f64(),
        cases.len(),
        all.fastest,
        all.own,
        all.survivors,
        all.recordings.len(),
        all.recordings.first().map_or(String::new(), |seed| format!(
            ", the first is {seed}, {:.1} cm aside at most",
            100.0 * all.aside
        ))
    );
    if wrong.degrees == 0.0 && wrong.noise == 0.0 && wrong.times <= 1.0 {
        assert_eq!(
            all.survivors,
            0,
            "recordings {:?}",
            &all.recordings[..all.recordings.len().min(20)]
        );
    }
}
