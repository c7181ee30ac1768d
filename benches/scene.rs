//! The scenes that are timed.

use std::fmt::Write as _;
use vff_core::control::Avoidance;
use vff_core::control::PreviewSettings;
use vff_core::{runtime::AnyRun, scenario::Scenario};

/// Plant steps of one run; a longer measurement begins another run, outside the measured time.
pub const STEPS: u64 = 2000;

pub const EULER: &str = "integrator = 'semi_implicit_euler', control = 'hold'";

/// A scene of the same size whatever the number of joints: 6 m and 6 kg of arm, its tip on a
/// circle, `obstacles` discs that swing beside the links.
pub fn scene(n: usize, obstacles: usize, simulation: &str) -> Scenario {
    let places = |joints: &[[f64; 2]]| beside(joints).into_iter().take(obstacles).collect();
    furnished(n, places, true, simulation)
}

/// The same with discs at the places that are chosen beside the joints.
pub fn furnished(
    n: usize,
    places: impl Fn(&[[f64; 2]]) -> Vec<[f64; 2]>,
    moving: bool,
    simulation: &str,
) -> Scenario {
    let length = 6.0 / n as f64;
    let angle = |i: usize| if i == 0 { 1.2 } else { -2.0 / (n - 1) as f64 };
    let (mut theta, mut joints) = (0.0, vec![[0.0, 0.0]]);
    for i in 0..n {
        theta += angle(i);
        let [x, y] = joints[i];
        joints.push([x + length * f64::cos(theta), y + length * f64::sin(theta)]);
    }
    let [x, y] = joints[n];
    let q0: Vec<f64> = (0..n).map(angle).collect();
    let mut text = format!(
        "duration = {duration}\n\
         q0 = {q0:?}\n\
         arm = {{ lengths = {lengths:?}, masses = {length} }}\n\
         reference = {{ kind = 'circle', center = [{center}, {y}], radius = 0.2, \
                        angular_velocity = 1.0 }}\n\
         controller = {{ stiffness = 100, damping = 20, null_damping = 6, \
                         field = {{ kind = 'khatib', gain = 0.2, influence = 0.6 }} }}\n\
         simulation = {{ dt = 1e-3, {simulation} }}\n",
        duration = STEPS as f64 * 1e-3,
        lengths = vec![length; n],
        center = x - 0.2,
    );
    for (j, [x, y]) in places(&joints).into_iter().enumerate() {
        let _ = write!(
            text,
            "[[obstacles]]\n\
             shape = {{ kind = 'circle', radius = 0.1 }}\n\
             position = [{x}, {y}]\n"
        );
        if moving {
            let _ = writeln!(
                text,
                "motion = {{ kind = 'sinusoid', amplitude = [0.03, 0.05], \
                             angular_frequency = 2.0, phase = {j} }}"
            );
        }
    }
    Scenario::from_toml(&text).expect("a scene that can be run")
}

/// Distance from a place to the axis of the arm.
fn distance(joints: &[[f64; 2]], [x, y]: [f64; 2]) -> f64 {
    let to_link = |pair: &[[f64; 2]]| {
        let ([ax, ay], [bx, by]) = (pair[0], pair[1]);
        let (dx, dy) = (bx - ax, by - ay);
        let s = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy);
        let s = s.clamp(0.0, 1.0);
        f64::hypot(x - ax - s * dx, y - ay - s * dy)
    };
    joints.windows(2).map(to_link).fold(f64::INFINITY, f64::min)
}

/// The places of a grid of `side` × `side` that keep `gap` from the axis of the arm, the nearest
/// first.
pub fn grid(joints: &[[f64; 2]], side: u32, gap: f64, corner: [f64; 2]) -> Vec<[f64; 2]> {
    let at = |i: u32, k: u32| [corner[0] + 0.3 * f64::from(i), corner[1] + 0.3 * f64::from(k)];
    let all = (0..side).flat_map(|i| (0..side).map(move |k| at(i, k)));
    let mut places: Vec<_> = all.filter(|place| distance(joints, *place) > gap).collect();
    places.sort_by(|a, b| distance(joints, *a).total_cmp(&distance(joints, *b)));
    places
}

/// The places nearest to the arm.
pub fn beside(joints: &[[f64; 2]]) -> Vec<[f64; 2]> {
    grid(joints, 40, 0.4, [0.0, -5.0])
}

/// The scene with discs for `cbf`: every pair is a row, and the margin is so wide that some rows always act.
pub fn barriers(n: usize, discs: usize) -> Scenario {
    let mut scenario = scene(n, discs, EULER);
    scenario.controller.avoidance = Avoidance::Cbf;
    scenario.controller.yielding.activation = Some(100.0);
    scenario.controller.yielding.margin = 0.45;
    scenario
}

/// The same for `cbf` that looks ahead.
pub fn preview(n: usize, discs: usize) -> Scenario {
    looking(scene(n, discs, EULER))
}

/// And searching all the time: one of the discs is at the base, where no candidate avoids it.
pub fn searching(n: usize, discs: usize) -> Scenario {
    let places = |joints: &[[f64; 2]]| {
        let beside = beside(joints).into_iter();
        std::iter::once([-0.05, 0.0]).chain(beside).take(discs).collect()
    };
    looking(furnished(n, places, true, EULER))
}

/// Under `cbf` that looks ahead.
pub fn looking(mut scenario: Scenario) -> Scenario {
    scenario.controller.avoidance = Avoidance::Cbf;
    scenario.controller.yielding.preview = Some(PreviewSettings::default());
    scenario
}

/// Ready to be run.
pub fn prepare(scenario: &Scenario) -> AnyRun {
    scenario.prepare().expect("a scene that can be run").run
}
