//! What is allowed but probably not meant.

use super::Scenario;
use super::scene::{FromDocument, ObstacleOf, Scene};
use crate::control::{Avoidance, Settings, Unstable};
use crate::math::Vector;
use crate::robot::Model;
use crate::settings::readable;
use crate::simulation::{
    ClosedLoop, Control, MeasurementSettings, PerceptionKind, Snapshot, System, Wrench,
};
use crate::world::{Description, World, top_speed};

impl Scenario {
    /// All of it, of the loop at t = 0 and the stops of the plant \[rad\].
    pub(super) fn warnings<S: FromDocument<D> + System<D, M>, const D: usize, const M: usize>(
        &self,
        scene: &Scene<S, D>,
        closed_loop: &ClosedLoop<S, D, M>,
        stops: &[[f64; 2]],
    ) -> Vec<String> {
        let mut warnings = self.oddities(&closed_loop.snapshot(), stops);
        warnings.extend(late_wrenches(&scene.wrenches, self.duration));
        warnings.extend(misread_scene(scene, closed_loop.arm().reach()));
        if self.simulation.control != Control::Continuous {
            let period = self.simulation.control_period();
            warnings.extend(
                sampling_bounds(&self.controller, period)
                    .into_iter()
                    .map(|warning| format!("controller.{warning}")),
            );
            warnings.extend(self.field_bound(&scene.obstacles, closed_loop));
            warnings.extend(self.stiff_posture::<_, D, M>(closed_loop.arm()));
        }
        warnings.iter().map(|warning| readable(warning)).collect()
    }

    /// What is allowed but probably not meant.
    fn oddities(&self, start: &Snapshot<'_>, stops: &[[f64; 2]]) -> Vec<String> {
        let mut warnings = vec![];
        for (link, clearance) in start.clearance.iter().enumerate() {
            if *clearance < 0.0 {
                warnings.push(format!(
                    "obstacles: link {link} is {:.4} m inside an obstacle at t = 0",
                    -clearance
                ));
            }
        }
        for (i, (q, [lower, upper])) in start.q.iter().zip(stops).enumerate() {
            if q < lower || upper < q {
                warnings.push(format!(
                    "q0[{i}]: {q} rad is beyond the stops of the joint at {lower} and {upper}; the first \
                     step puts it there (plant.joint_stops = false takes them away)"
                ));
            }
        }
        let steps = self.simulation.steps(self.duration);
        let end = self.simulation.time(steps);
        if (end - self.duration).abs() > 1e-6 * self.simulation.dt {
            warnings.push(format!(
                "duration: {} s is no multiple of simulation.dt = {} s; the run ends at {end} s",
                self.duration, self.simulation.dt
            ));
        }
        let margin = self.controller.yielding.margin;
        let keeps = matches!(self.controller.avoidance, Avoidance::Priority | Avoidance::Cbf);
        if let Some(given) = self.perception.as_ref().filter(|it| it.kind == PerceptionKind::Depth)
            && keeps
            && margin < given.perceiver.margin
        {
            warnings.push(format!(
                "controller.yielding.margin: {margin} m is less than perception.perceiver.margin = {} m, by which \
                 the arm is cut away: what comes nearer than that is not seen, and counts as far enough away",
                given.perceiver.margin
            ));
        }
        let delays = self.measurement.iter().flat_map(|given| given.delay.values());
        let dt = self.simulation.dt;
        for delay in delays {
            let late = MeasurementSettings::steps(*delay, dt) * dt;
            if (late - delay).abs() > 1e-6 * dt {
                warnings.push(format!(
                    "measurement.delay: {delay} s is no multiple of simulation.dt = {dt} s; readings are \
                     {late} s old"
                ));
            }
        }
        warnings
    }

    /// A field too stiff for the control period: where the obstacles stand at the start, or at the
    /// clearance that the fastest of them is to be expected to come to (T29, T34).
    fn field_bound<S: System<D, M>, const D: usize, const M: usize>(
        &self,
        obstacles: &[ObstacleOf<S, D>],
        closed_loop: &ClosedLoop<S, D, M>,
    ) -> Option<String> {
        if self.controller.field.gain == 0.0 {
            return None;
        }
        let controller = closed_loop.controller();
        let h = self.simulation.control_period();
        let speed = obstacles.iter().map(top_speed::<S::Geometry, D>).fold(0.0, f64::max);
        let mut world = World::<S::Geometry, D>::new(obstacles.to_vec());
        world.know_links(&closed_loop.arm().link_names());
        let now = controller.stable_period(&mut world);
        let (worst, when) = match controller.stable_period_against(speed) {
            coming if speed > 0.0 && coming.period < now.period => {
                (coming, "which is to be expected")
            }
            _ => (now, "as at the start"),
        };
        // One that stands inside the arm has its own warning.
        (worst.stiffness > 0.0 && worst.clearance >= 0.0 && h >= worst.period).then(|| {
            format!(
                "controller.field: at a clearance of {:.3} m, {when}, its stiffness is {:.3} N/m, for \
                 which the null space is stable up to a control period of {:.6} s; it is {h} s. More \
                 null_damping, a lower gain or a shorter period helps",
                worst.clearance, worst.stiffness, worst.period
            )
        })
    }
}

/// What was probably meant in other units, or in another order, of all that a controller is made of; its arm reaches `reach` \[m\].
pub(crate) fn misread_scene<S: FromDocument<D>, const D: usize>(
    scene: &Scene<S, D>,
    reach: f64,
) -> Vec<String> {
    let far = |(j, obstacle)| {
        far_away::<S, D>(obstacle, reach).map(|warning| format!("obstacles[{j}].{warning}"))
    };
    let far = scene.obstacles.iter().enumerate().filter_map(far);
    let turned = S::orientations(scene);
    far.chain(turned.iter().filter_map(|(path, given)| misread(path, given))).collect()
}

/// The same of one obstacle.
pub(crate) fn misread_obstacle<S: FromDocument<D>, const D: usize>(
    obstacle: &ObstacleOf<S, D>,
    reach: f64,
) -> Vec<String> {
    let turned = S::orientation_of(obstacle).and_then(|given| misread("orientation", &given));
    far_away::<S, D>(obstacle, reach).into_iter().chain(turned).collect()
}

/// An obstacle so far from the arm that only millimetres could mean it.
fn far_away<S: FromDocument<D>, const D: usize>(
    obstacle: &ObstacleOf<S, D>,
    reach: f64,
) -> Option<String> {
    const FAR: f64 = 50.0;
    let away = Vector::from(obstacle.position()).norm();
    (away > FAR * reach).then(|| {
        format!(
            "position: {away:.4} m away, where the arm reaches {reach:.3} m: are these millimetres?"
        )
    })
}

/// Wrenches that do not begin before the run is over.
fn late_wrenches<const D: usize>(wrenches: &[Wrench<D>], end: f64) -> Vec<String> {
    let late = |(i, wrench): (usize, &Wrench<D>)| {
        (wrench.start >= end).then(|| {
            format!(
                "wrenches[{i}].start: {} s, when the run is over: it ends at {end} s",
                wrench.start
            )
        })
    };
    wrenches.iter().enumerate().filter_map(late).collect()
}

/// A quaternion that is half a turn about z, as the identity is written where w comes last.
#[expect(clippy::float_cmp, reason = "as it was written")]
fn misread(path: &str, quaternion: &[f64; 4]) -> Option<String> {
    (*quaternion == [0.0, 0.0, 0.0, 1.0]).then(|| {
        format!(
            "{path}: [0, 0, 0, 1] is half a turn about z; quaternions are [w, x, y, z], and no rotation is \
             [1, 0, 0, 0]"
        )
    })
}

/// What of these settings a torque held over the control period `h` \[s\] makes unstable, in sentences.
pub fn sampling_bounds(settings: &Settings, h: f64) -> Vec<String> {
    Unstable::all(settings, h).iter().map(ToString::to_string).collect()
}
