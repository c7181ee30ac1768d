//! A picture of 640 × 480 pixels, of a Panda that swings, a wall, a table with boxes and a hand that moves, taken in by the
//! perceiver.
//!
//! `cargo bench --bench perceiver`

use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::sync::Arc;
use vff_core::geometry::Body;
use vff_core::math::Vector;
use vff_core::perception::{Depth, DepthCamera, Perceiver, PerceiverSettings};
use vff_core::robot::{Model, Robot, SpatialState, models};
use vff_core::world::space::cast_at_body;

const PERIOD: f64 = 1.0 / 30.0;
const FROM: [f64; 3] = [0.4, 0.0, 1.6];

fn joints(t: f64) -> [[f64; 7]; 2] {
    let mean = [0.0, -0.3, 0.0, -1.9, 0.0, 1.6, 0.8];
    [mean.map(|q| q + 0.3 * (2.0 * t).sin()), [0.6 * (2.0 * t).cos(); 7]]
}

/// Depths of a table at z = 0 with boxes on it, a wall, the arm, and a ball that goes to and fro.
fn picture(state: &SpatialState, t: f64) -> Vec<f32> {
    let origin = Vector::from(FROM);
    let ball = Vector::<3>::new(0.3 + 0.3 * t.sin(), 0.25, 0.4);
    let bodies: Vec<_> = state.bodies().map(|body| body.shape).collect();
    let mut depths = Vec::with_capacity(640 * 480);
    for row in 0..480 {
        for column in 0..640 {
            let ray = Vector::<3>::new(
                (f64::from(column) - 319.5) / 550.0,
                -(f64::from(row) - 239.5) / 550.0,
                -1.0,
            );
            let length = ray.norm();
            let along = ray / length;
            let mut end = FROM[2] * length;
            let floor = origin + along * end;
            if (4.0 * floor.x).fract().abs() < 0.3 && (5.0 * floor.y).fract().abs() < 0.3 {
                end *= 1.0 - 0.2 / FROM[2]; // the lid of a box
            }
            if floor.y > 0.6 {
                end = end.min(0.6 / along.y);
            }
            let off = origin - ball;
            let (b, c) = (off.dot(&along), off.norm_squared() - 0.0025);
            if b * b > c {
                end = end.min(-b - (b * b - c).sqrt());
            }
            for body in &bodies {
                if let Some(s) = cast_at_body(body, None, &origin, &along) {
                    end = end.min(s);
                }
            }
            #[expect(clippy::cast_possible_truncation, reason = "a depth")]
            depths.push((end / length) as f32);
        }
    }
    depths
}

fn perceiver(c: &mut Criterion) {
    let panda = Arc::new(models::named("panda").unwrap().build().unwrap());
    let mut state = Model::state(&panda);
    let camera = DepthCamera {
        columns: 640,
        rows: 480,
        focal: [550.0; 2],
        centre: [319.5, 239.5],
        distortion: [0.0; 5],
        position: FROM,
        orientation: [0.0, 1.0, 0.0, 0.0],
    };
    let pictures: Vec<Vec<f32>> = (0..30)
        .map(|k| {
            let [q, dq] = joints(PERIOD * f64::from(k));
            state.update(&q, &dq);
            debug_assert!(state.bodies().all(|Body { hull, .. }| hull.is_none()));
            picture(&state, PERIOD * f64::from(k))
        })
        .collect();
    for stride in [1, 2] {
        let settings = PerceiverSettings { stride, ..PerceiverSettings::default() };
        let mut perceiver = Perceiver::new(&panda, vec![camera.clone()], settings, vec![]).unwrap();
        let mut k = 0;
        let mut see = || {
            let t = PERIOD * f64::from(k);
            // There and back, so that nothing jumps.
            let place = (k % 58).min(58 - k % 58);
            let [q, dq] = joints(PERIOD * f64::from(place));
            perceiver.observe(t, &q, &dq).unwrap();
            k += 1;
            let depth = Depth::Metres(&pictures[place as usize]);
            perceiver.see(0, t, black_box(depth)).unwrap()
        };
        for _ in 0..60 {
            see();
        }
        c.bench_function(&format!("picture, stride {stride}"), |b| b.iter(&mut see));
        println!("{} points", perceiver.points().count());
    }
}

criterion_group!(benches, perceiver);
criterion_main!(benches);
