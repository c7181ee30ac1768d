//! The reference that a governor makes wait, as the closed loop drags it to the law.

use vff_core::math::Vector;
use vff_core::simulation::{Plane, Run};
use vff_core::trajectory::{GovernorSettings, Sample};
use vff_core::{runtime::AnyRun, scenario::Scenario};

/// One reference per plant step of `on-path`, where the tip has to go around a disc.
fn references(control: &str, control_every: usize) -> Vec<Sample<Vector<2>, 2>> {
    let text = include_str!("scenarios/on-path.toml")
        .replace("control = \"continuous\"", &format!("control = \"{control}\""));
    let mut scenario = Scenario::from_toml(&text).unwrap();
    scenario.controller.avoidance = vff_core::control::Avoidance::Cbf;
    scenario.controller.governor = Some(GovernorSettings::default());
    scenario.simulation.control_every = control_every;
    let reference = |run: &AnyRun| {
        let run: &Run<Plane, 2, 2> = run.downcast_ref().unwrap();
        *run.closed_loop().controller().reference()
    };
    let mut run = scenario.prepare().unwrap().run;
    let mut samples = vec![reference(&run)];
    while run.step() {
        samples.push(reference(&run));
    }
    samples
}

/// ẋ_r and ẍ_r are the derivatives of x_r, within and across control periods: central differences over 1 ms
/// steps are off by h²/6 times the third derivative of x_r, some 100 m/s³. That of ẋ_r jumps from period to period
/// by what the clock hears, by ω² ẋ times the change of σ̇ that is wanted.
#[test]
fn velocity_and_acceleration_are_derivatives() {
    const H: f64 = 1e-3;
    for (control, every) in [("hold", 1), ("hold", 3), ("predictor", 2)] {
        let samples = references(control, every);
        let (mut slowest, mut off) = (f64::INFINITY, [0.0_f64; 2]);
        for window in samples.windows(3) {
            let [before, now, after] = window else { unreachable!() };
            off[0] = off[0].max(((after.x - before.x) / (2.0 * H) - now.dx).norm());
            off[1] = off[1].max(((after.dx - before.dx) / (2.0 * H) - now.ddx).norm());
            slowest = slowest.min(now.ddx[1]);
        }
        // Without a governor the line of 3 m in 5 s never brakes harder than by 0.7 m/s².
        assert!(slowest < -3.0, "{control}: it did not wait, {slowest}");
        assert!(off[0] < 3e-5 && off[1] < 0.01, "{control}, {every}: {off:?}");
    }
}
