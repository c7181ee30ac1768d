//! Whether the parts of a scenario make sense, one function a part.
//!
//! Types, unknown and missing keys have been validated by [`super::document`]; here are the values.

use super::error::{Problem, ScenarioError};
use super::numbers::{each, length, not_negative, number, positive};
use crate::control::avoidance::barrier;
use crate::control::avoidance::preview::PreviewSettings;
use crate::control::avoidance::preview::closed_loop_rollout::fastest_rate;
use crate::control::distance::OwnPair;
use crate::control::tank::TankSettings;
use crate::control::{
    Avoidance, CommandSettings, Formulation, SelfCollision, Settings, TaskKind, Yielding,
    extended_jacobian,
};
use crate::field::{Field, FieldKind};
use crate::interrupt;
use crate::math::{ScalarOrVec, UnitQuaternion, memory};
use crate::robot::{Limits, Model};
use crate::simulation::{
    ActuatorSettings, Camera, Control, MAX_READINGS, MAX_STEPS, Measurement, MeasurementSettings,
    Options, PerceptionKind, PerceptionSettings, ReplanSettings,
};
use crate::trajectory::GovernorSettings;
use crate::world::Motion;
use std::f64::consts::PI;
use std::fmt::Debug;
use toml::{Table, Value};

type Validated = Result<(), ScenarioError>;

/// Every number of the document is finite.
pub fn finite(document: &Table) -> Validated {
    document.iter().try_for_each(|(key, value)| {
        // A joint without an end has infinite limits.
        let judged = if key == "joint_limits" { comparable(value) } else { finite_value(value) };
        judged.map_err(|error| error.inside(key))
    })
}

fn finite_value(value: &Value) -> Validated {
    match value {
        Value::Float(x) if !x.is_finite() => {
            Err(ScenarioError::out_of_range("", "a finite number", x))
        }
        Value::Float(x) if x.abs() > 1e100 => {
            Err(ScenarioError::out_of_range("", "at most 1e100", x))
        }
        Value::Array(values) => values.iter().enumerate().try_for_each(|(i, value)| {
            interrupt::spend(64);
            finite_value(value).map_err(|error| error.inside(&format!("[{i}]")))
        }),
        Value::Table(table) => finite(table),
        _ => Ok(()),
    }
}

/// Every number of the document is one.
fn comparable(value: &Value) -> Validated {
    match value {
        Value::Float(x) if x.is_nan() => Err(ScenarioError::out_of_range("", "a number", x)),
        Value::Array(values) => values.iter().enumerate().try_for_each(|(i, value)| {
            comparable(value).map_err(|error| error.inside(&format!("[{i}]")))
        }),
        _ => Ok(()),
    }
}

/// `[simulation]`.
pub fn simulation(options: &Options) -> Validated {
    number("dt", options.dt, positive)?;
    for (path, value) in
        [("control_every", options.control_every), ("record_every", options.record_every)]
    {
        if value == 0 {
            return Err(ScenarioError::out_of_range(path, "1 or more", value));
        }
    }
    if options.control == Control::Continuous && options.control_every != 1 {
        let given = options.control_every;
        return Err(ScenarioError::out_of_range(
            "control_every",
            "1 with continuous control",
            given,
        ));
    }
    Ok(())
}

/// `[measurement]` of n joints, with plant steps of `dt` \[s\]; `sampled` unless control is continuous.
pub fn measurement(settings: &MeasurementSettings, n: usize, dt: f64, sampled: bool) -> Validated {
    needs_sampling(sampled, "sees every instant")?;
    let MeasurementSettings { position_noise, velocity_noise, .. } = settings;
    each("position_noise", position_noise, n, not_negative)?;
    each("velocity_noise", velocity_noise, n, not_negative)?;
    each("position_resolution", &settings.position_resolution, n, not_negative)?;
    each("velocity_resolution", &settings.velocity_resolution, n, not_negative)?;
    each("delay", &settings.delay, n, not_negative)?;
    let longest = settings.delay.values().iter().copied().fold(0.0, f64::max);
    if MeasurementSettings::steps(longest, dt) > Measurement::MAX_DELAY {
        let requirement = format!("at most {:e} steps of {dt} s", Measurement::MAX_DELAY);
        return Err(ScenarioError::out_of_range("delay", &requirement, longest));
    }
    Ok(())
}

/// `[perception]` of an arm with so many bodies in a space of this dimension, with plant steps of `dt` \[s\]; `sampled`
/// unless control is continuous.
#[expect(clippy::cast_precision_loss, reason = "a size to compare")]
pub fn perception(
    settings: &PerceptionSettings,
    bodies: usize,
    dimension: usize,
    dt: f64,
    sampled: bool,
) -> Validated {
    needs_sampling(sampled, "sees every instant")?;
    if dimension == 2 {
        in_the_plane(settings)?;
    }
    let around = settings.sides(dimension);
    for (path, count) in
        [("sensors", settings.sensors), ("rays", settings.rays), ("around", around)]
    {
        at_least_one(path, count)?;
    }
    let PerceptionSettings { field_of_view, range, drop_outs, .. } = *settings;
    if !(0.0..PI).contains(&field_of_view) {
        return Err(ScenarioError::out_of_range("field_of_view", "in [0, π)", field_of_view));
    }
    for (index, each) in settings.cameras.iter().enumerate() {
        camera(each).map_err(|error| error.inside(&format!("cameras[{index}]")))?;
    }
    if settings.kind == PerceptionKind::Camera && settings.cameras.is_empty() {
        return Err(ScenarioError::new("cameras", Problem::Other("expected at least one".into())));
    }
    number("range", range, positive)?;
    number("noise", settings.noise, not_negative)?;
    number("resolution", settings.resolution, not_negative)?;
    number("latency", settings.latency, not_negative)?;
    if !(0.0..=1.0).contains(&drop_outs) {
        return Err(ScenarioError::out_of_range("drop_outs", "in [0, 1]", drop_outs));
    }
    if let Some(rate) = settings.rate {
        number("rate", rate, positive)?;
        if settings.steps_per_scan(dt) > MAX_STEPS {
            let requirement = format!("at least one scan in {MAX_STEPS:e} steps of {dt} s");
            return Err(ScenarioError::out_of_range("rate", &requirement, rate));
        }
    }
    if settings.steps_late(dt) > MAX_STEPS {
        let requirement = format!("at most {MAX_STEPS:e} steps of {dt} s");
        return Err(ScenarioError::out_of_range("latency", &requirement, settings.latency));
    }
    let scans = settings.steps_late(dt) / settings.steps_per_scan(dt) + 3.0;
    let rays = settings.rays_of(bodies, dimension);
    if rays as f64 * scans > MAX_READINGS {
        let path = if settings.kind == PerceptionKind::Camera { "cameras" } else { "sensors" };
        let requirement = format!("so few that at most {MAX_READINGS:e} readings are under way");
        return Err(ScenarioError::out_of_range(path, &requirement, format!("{rays} rays")));
    }
    Ok(())
}

/// What of `[perception]` means nothing in the plane.
fn in_the_plane(settings: &PerceptionSettings) -> Validated {
    let stray = [
        ("kind", settings.kind == PerceptionKind::Camera),
        ("around", settings.around.is_some()),
        ("cameras", !settings.cameras.is_empty()),
    ];
    let Some((path, _)) = stray.into_iter().find(|(_, given)| *given) else { return Ok(()) };
    let problem = match path {
        "around" => "belongs to arms in space: in the plane, a link has two sides",
        _ => "depth cameras belong to arms in space",
    };
    Err(ScenarioError::new(path, Problem::Other(problem.into())))
}

fn at_least_one(path: &str, count: usize) -> Validated {
    if count == 0 {
        return Err(ScenarioError::out_of_range(path, "1 or more", count));
    }
    Ok(())
}

fn camera(camera: &Camera) -> Validated {
    orientation("orientation", &camera.orientation)?;
    at_least_one("columns", camera.columns)?;
    at_least_one("rows", camera.rows)?;
    let angle = camera.field_of_view;
    if !(angle > 0.0 && angle < PI) {
        return Err(ScenarioError::out_of_range("field_of_view", "in (0, π)", angle));
    }
    Ok(())
}

/// `[actuator]` of n joints; `sampled` unless control is continuous.
pub fn actuator(settings: &ActuatorSettings, n: usize, sampled: bool) -> Validated {
    needs_sampling(sampled, "acts at every instant")?;
    each("time_constant", &settings.time_constant, n, not_negative)
}

fn needs_sampling(sampled: bool, otherwise: &str) -> Validated {
    if sampled {
        return Ok(());
    }
    let problem = Problem::Other(format!(
        "needs a sampled controller, simulation.control = \"hold\" or \"predictor\": with \
         \"continuous\" it {otherwise}"
    ));
    Err(ScenarioError::new("", problem))
}

/// `[controller]` on its own, for the arm of n joints in `dimension` dimensions where that is known.
pub fn controller(settings: &Settings, arm: Option<(usize, usize)>) -> Validated {
    let n = arm.map(|(n, _)| n);
    let dimensions = arm.map_or(vec![2, 3], |(_, dimension)| vec![dimension]);
    task(settings, &dimensions)?;
    let joints = |given: &ScalarOrVec| n.unwrap_or(given.values().len());
    each("null_damping", &settings.null_damping, joints(&settings.null_damping), not_negative)?;
    let stiffness = &settings.posture_stiffness;
    each("posture_stiffness", stiffness, joints(stiffness), not_negative)?;
    if let Some(posture) = &settings.posture {
        length("posture", posture.len(), n.unwrap_or(posture.len()))?;
    }
    if let Some(length) = settings.characteristic_length {
        number("characteristic_length", length, positive)?;
    }
    number("singularity", settings.singularity, positive)?;
    yielding(&settings.yielding).map_err(|error| error.inside("yielding"))?;
    if settings.yielding.keep.is_some() && settings.task == TaskKind::Position {
        let problem = "needs a task with an orientation: a position has nothing else to give way";
        return Err(ScenarioError::new("yielding.keep", Problem::Other(problem.into())));
    }
    if settings.avoidance == Avoidance::Cbf {
        look_ahead(settings)?;
    }
    if let Some(limits) = &settings.joint_limit_field {
        field(limits).map_err(|error| error.inside("joint_limit_field"))?;
    }
    if let Some(tank) = &settings.tank {
        self::tank(tank).map_err(|error| error.inside("tank"))?;
    }
    if let Some(governor) = &settings.governor {
        self::governor(governor).map_err(|error| error.inside("governor"))?;
    }
    command(&settings.command, n).map_err(|error| error.inside("command"))?;
    field(&settings.field).map_err(|error| error.inside("field"))
}

/// Whether there is a posture for its spring, where the reference does not bring one.
pub fn posture(settings: &Settings) -> Validated {
    let pulls = settings.posture_stiffness.values().iter().any(|k| *k > 0.0);
    if pulls && settings.posture.is_none() {
        let problem =
            "needs `posture`, the angles that the spring pulls to, or a plan as the reference";
        return Err(ScenarioError::new("posture_stiffness", Problem::Other(problem.into())));
    }
    Ok(())
}

/// `[controller.command]`, for an arm of n joints where that is known.
fn command(settings: &CommandSettings, n: Option<usize>) -> Validated {
    let CommandSettings { torque_rate, friction_speed, start, .. } = settings;
    let CommandSettings { tip_speed, obstacle_speed, .. } = *settings;
    let joints = |given: &ScalarOrVec| n.unwrap_or(given.values().len());
    if let Some(rate) = torque_rate {
        each("torque_rate", rate, joints(rate), positive)?;
    }
    for (path, given) in [
        ("viscous_friction", &settings.viscous_friction),
        ("coulomb_friction", &settings.coulomb_friction),
    ] {
        each(path, given, joints(given), not_negative)?;
    }
    each("friction_speed", friction_speed, joints(friction_speed), positive)?;
    for (path, speed) in [("tip_speed", tip_speed), ("obstacle_speed", obstacle_speed)] {
        speed.map_or(Ok(()), |speed| number(path, speed, positive))?;
    }
    number("start", *start, not_negative)?;
    if settings.patience == 0 {
        return Err(ScenarioError::out_of_range("patience", "1 or more", settings.patience));
    }
    number("stop_damping", settings.stop_damping, positive)
}

/// The task and what has a value per axis of it, in one of these `dimensions`.
fn task(settings: &Settings, dimensions: &[usize]) -> Validated {
    let Settings { task, stiffness, damping, .. } = settings;
    let axes: Vec<usize> = dimensions.iter().filter_map(|d| task.dimension(*d)).collect();
    let Some(first) = axes.first() else {
        let problem = "needs an arm in space: in the plane a pose has one angle, take \"pose\"";
        return Err(ScenarioError::new("task", Problem::Other(problem.into())));
    };
    for (path, given) in [("stiffness", stiffness), ("damping", damping)] {
        let fitting = axes.iter().find(|m| **m == given.values().len());
        each(path, given, *fitting.unwrap_or(first), not_negative)?;
    }
    Ok(())
}

/// `[controller.yielding]`.
fn yielding(yielding: &Yielding) -> Validated {
    let Yielding { margin, rate, inner, outer, saturation, activation, .. } = yielding;
    let Yielding { task_weight, slack_price, speed, .. } = yielding;
    number("inner", *inner, not_negative)?;
    for (path, value) in [
        ("rate", rate),
        ("activation", activation),
        ("task_weight", task_weight),
        ("slack_price", slack_price),
    ] {
        value.map_or(Ok(()), |value| number(path, value, positive))?;
    }
    for (path, value) in [("margin", margin), ("saturation", saturation), ("speed", speed)] {
        number(path, *value, positive)?;
    }
    if outer <= inner {
        let requirement = format!("greater than inner = {inner}");
        return Err(ScenarioError::out_of_range("outer", &requirement, *outer));
    }
    yielding
        .preview
        .as_ref()
        .map_or(Ok(()), |given| preview(given).map_err(|error| error.inside("preview")))
}

/// `[controller.yielding.preview]`.
fn preview(settings: &PreviewSettings) -> Validated {
    let PreviewSettings { period, horizon, trigger, clearance, speed, error, .. } = settings;
    for (path, value) in [
        ("period", period),
        ("horizon", horizon),
        ("trigger", trigger),
        ("clearance", clearance),
        ("speed", speed),
    ] {
        number(path, *value, positive)?;
    }
    if let Some(error) = error {
        number("error", *error, positive)?;
    }
    if trigger > horizon {
        let requirement = format!("at most horizon = {horizon}");
        return Err(ScenarioError::out_of_range("trigger", &requirement, *trigger));
    }
    for (path, value) in [("steps", settings.steps), ("candidates", settings.candidates)] {
        if !(1..=10_000).contains(&value) {
            return Err(ScenarioError::out_of_range(path, "from 1 to 10000", value));
        }
    }
    Ok(())
}

/// What look-ahead has to do in one control step: bounded, because its closed loop takes steps as short as the fastest
/// rate of the law demands.
fn look_ahead(settings: &Settings) -> Validated {
    const MOST: usize = 100_000;
    let Some(preview) = &settings.yielding.preview else { return Ok(()) };
    let inside = |error: ScenarioError| error.inside("yielding.preview");
    if preview.steps * preview.candidates > MOST {
        let requirement = format!("at most {} with {} steps", MOST / preview.steps, preview.steps);
        let given = preview.candidates;
        return Err(inside(ScenarioError::out_of_range("candidates", &requirement, given)));
    }
    let Some(fastest) = fastest_rate(preview.trigger) else {
        let requirement = "short enough for 4096 steps of 10 ms";
        return Err(inside(ScenarioError::out_of_range("trigger", requirement, preview.trigger)));
    };
    let largest = |values: &[f64]| values.iter().copied().fold(0.0, f64::max);
    for (path, rate) in [
        ("yielding.rate", barrier::rate(&settings.yielding)),
        ("damping", largest(settings.damping.values())),
        ("null_damping", largest(settings.null_damping.values())),
    ] {
        if rate > fastest {
            let trigger = preview.trigger;
            let requirement = format!(
                "at most {:.0} 1/s with a look-ahead of trigger = {trigger} s",
                fastest.floor()
            );
            return Err(ScenarioError::out_of_range(path, &requirement, rate));
        }
    }
    Ok(())
}

/// What a controller of n joints that knows `barriers` distances per link keeps in memory, and `copies` of it.
pub fn size(settings: &Settings, n: usize, barriers: usize, copies: usize) -> Validated {
    let per_pair = n.saturating_mul(barriers);
    let square = n.saturating_mul(n);
    let keeps_apart = settings.self_collision == SelfCollision::Avoid;
    let own = if keeps_apart { square.saturating_mul(OwnPair::<3>::FEATURES) / 2 } else { 0 };
    let (path, numbers) = match (settings.avoidance, settings.formulation) {
        (Avoidance::Cbf, _) => {
            let rows = per_pair.saturating_add(own).saturating_add(4 * n);
            let rows = rows.saturating_mul(n.saturating_add(20));
            let ahead = if settings.yielding.preview.is_some() { 2 } else { 1 };
            let numbers = rows.saturating_add(square.saturating_mul(5));
            ("avoidance", numbers.saturating_mul(ahead))
        }
        (_, Formulation::ExtendedJacobian) => {
            ("formulation", square.saturating_mul(extended_jacobian::MATRICES))
        }
        _ => ("avoidance", per_pair.saturating_mul(20)),
    };
    memory::fits(numbers.saturating_mul(copies)).map_err(|error| {
        let problem =
            format!("takes {error}, for {n} joints and {barriers} distances of each link");
        ScenarioError::new(path, Problem::Other(problem))
    })
}

/// `[controller.tank]`.
fn tank(tank: &TankSettings) -> Validated {
    number("capacity", tank.capacity, positive)?;
    if let Some(initial) = tank.initial
        && !(0.0..=tank.capacity).contains(&initial)
    {
        let requirement = format!("between 0 and the capacity {}", tank.capacity);
        return Err(ScenarioError::out_of_range("initial", &requirement, initial));
    }
    number("floor", tank.floor, ("greater than 0 and at most 1", |x| 0.0 < x && x <= 1.0))
}

/// `[controller.governor]`.
fn governor(governor: &GovernorSettings) -> Validated {
    let GovernorSettings { inner, outer, rate, floor } = *governor;
    number("inner", inner, not_negative)?;
    if outer <= inner {
        let requirement = format!("greater than inner = {inner}");
        return Err(ScenarioError::out_of_range("outer", &requirement, outer));
    }
    number("rate", rate, positive)?;
    number("floor", floor, ("in [0, 1)", |x| (0.0..1.0).contains(&x)))
}

/// `[replan]`.
pub fn replan(settings: &ReplanSettings) -> Validated {
    let ReplanSettings { latency, every, patience, stray, tolerance, blend, .. } = *settings;
    number("latency", latency, not_negative)?;
    for (key, value) in [("every", every), ("patience", patience), ("stray", stray)] {
        number(key, value, positive)?;
    }
    number("tolerance", tolerance, not_negative)?;
    number("blend", blend, positive)?;
    number("margin", settings.margin, positive)?;
    number("horizon", settings.horizon, not_negative)?;
    number("speed", settings.speed, ("greater than 0 and at most 1", |x| 0.0 < x && x <= 1.0))
}

/// Angles that only degrees could mean: beyond the limits of a joint by far, and within them if they were degrees.
pub fn angles<const D: usize>(q0: &[f64], arm: &impl Model<D>) -> Validated {
    for (i, (q, [lower, upper])) in q0.iter().zip(&arm.limits().joint).enumerate() {
        let meant = q.to_radians();
        if !arm.slides(i) && q.abs() > 2.0 * PI && (q < lower || upper < q) {
            let problem = format!(
                "{q} rad is beyond the limits of the joint, {lower} to {upper}: are these degrees? In radians \
                 it is {meant:.4}"
            );
            return Err(ScenarioError::new(format!("q0[{i}]"), Problem::Other(problem)));
        }
    }
    Ok(())
}

/// What a controller needs of the limits of its arm.
pub fn controller_of(settings: &Settings, limits: &Limits) -> Validated {
    if settings.joint_limit_field.is_some() && limits.joint.is_empty() {
        let problem = Problem::Other("needs `arm.joint_limits`, the angles it keeps to".into());
        return Err(ScenarioError::new("joint_limit_field", problem));
    }
    let damped = settings.damping.values().iter().all(|d| *d > 0.0);
    if settings.enforce_limits && !limits.velocity.is_empty() && !damped {
        let requirement = "greater than 0 with `arm.velocity_limits`";
        return Err(ScenarioError::out_of_range("damping", requirement, settings.damping.values()));
    }
    Ok(())
}

/// `[controller.field]`.
pub fn field(field: &Field) -> Validated {
    number("gain", field.gain, not_negative)?;
    number("influence", field.influence, positive)?;
    number("approach_damping", field.approach_damping, not_negative)?;
    number("sliding", field.sliding, not_negative)?;
    match field.floor {
        Some(floor) if field.kind == FieldKind::Bounded => {
            Err(ScenarioError::out_of_range("floor", "absent: a bounded field has none", floor))
        }
        Some(floor) if !(0.0 < floor && floor < field.influence) => {
            let requirement = format!("between 0 and the influence distance {}", field.influence);
            Err(ScenarioError::out_of_range("floor", &requirement, floor))
        }
        _ => Ok(()),
    }
}

/// The motion of an obstacle whose initial position is `position` \[m\].
pub fn motion_from<const D: usize>(motion: &Motion<D>, position: [f64; D]) -> Validated {
    self::motion(motion).map_err(|error| error.inside("motion"))?;
    match motion {
        Motion::Waypoints { points, .. } if !same(&points[0], &position) => {
            let requirement = format!("the obstacle's position {position:?}");
            Err(ScenarioError::out_of_range("motion.points[0]", &requirement, points[0]))
        }
        _ => Ok(()),
    }
}

/// What turns an obstacle that stands like `first` at the start: its angular velocity, or rotations at way points, of which
/// it has those of the space that it is in.
pub fn turning<R: PartialEq + Debug>(
    spins: bool,
    path: &str,
    rotations: &[R],
    first: &R,
) -> Validated {
    match rotations.first() {
        Some(_) if spins => {
            let problem = format!("absent beside `motion.{path}`, which say how it turns");
            Err(ScenarioError::new(
                "angular_velocity",
                Problem::Other(format!("must be {problem}")),
            ))
        }
        Some(given) if given != first => {
            let requirement = format!("that of the obstacle, {first:?}");
            Err(ScenarioError::out_of_range(format!("motion.{path}[0]"), &requirement, given))
        }
        _ => Ok(()),
    }
}

/// The motion of an obstacle.
pub fn motion<const D: usize>(motion: &Motion<D>) -> Validated {
    let Motion::Waypoints { times, points, angles, orientations } = motion else { return Ok(()) };
    if times.is_empty() {
        return Err(ScenarioError::out_of_range("times", "at least one instant", times));
    }
    length("points", points.len(), times.len())?;
    for (path, count, dimension, other) in [
        ("angles", angles.len(), 2, "the plane; in space they are `orientations`"),
        ("orientations", orientations.len(), 3, "space; in the plane they are `angles`"),
    ] {
        if count > 0 && dimension != D {
            return Err(ScenarioError::new(path, Problem::Other(format!("belong to {other}"))));
        }
        if count > 0 {
            length(path, count, times.len())?;
        }
    }
    for (i, orientation) in orientations.iter().enumerate() {
        self::orientation(&format!("orientations[{i}]"), orientation)?;
    }
    let speed =
        |i: usize, axis: usize| (points[i][axis] - points[i - 1][axis]) / (times[i] - times[i - 1]);
    for i in 1..times.len() {
        let total = (0..D).map(|axis| speed(i, axis)).sum::<f64>();
        if times[i] <= times[i - 1] || !total.is_finite() {
            let requirement = format!("later than {}", times[i - 1]);
            return Err(ScenarioError::out_of_range(format!("times[{i}]"), &requirement, times[i]));
        }
    }
    Ok(())
}

/// A rotation in space.
pub fn orientation(path: &str, quaternion: &[f64; 4]) -> Validated {
    UnitQuaternion::new(*quaternion)
        .map(drop)
        .map_err(|error| ScenarioError::new(path, Problem::Other(error.to_string())))
}

/// Whether two points are the same to the last digit, as copied numbers are.
#[expect(clippy::float_cmp, reason = "copies, not results")]
pub fn same<const D: usize>(a: &[f64; D], b: &[f64; D]) -> bool {
    a == b
}
