//! Whether the parts of a scenario make sense, one function a part.
//!
//! Types, unknown and missing keys have been validated by [`super::document`]; here are the values.

use super::error::{Problem, ScenarioError};
use super::look_ahead;
use super::numbers::{bounded, length, number, table};
use super::touch::touch;
use crate::control::distance::OwnPair;
use crate::control::tank::TankSettings;
use crate::control::{
    Avoidance, Formulation, SelfCollision, Settings, Yielding, extended_jacobian,
};
use crate::field::{Field, FieldKind};
use crate::interrupt;
use crate::math::{ScalarOrVec, UnitQuaternion, memory};
use crate::perception::PerceiverSettings;
use crate::robot::{Limits, Model};
use crate::settings::{NOT_NEGATIVE, POSITIVE, SHARE};
use crate::simulation::{
    ActuatorSettings, Camera, ContactSettings, Control, MAX_READINGS, MAX_STEPS, MAX_WRENCHES,
    Measurement, MeasurementSettings, Options, PerceptionKind, PerceptionSettings, Profile, Pull,
    ReplanSettings, Wrench,
};
use crate::trajectory::GovernorSettings;
use crate::world::{Interpolation, Motion};
use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt::Debug;
use toml::{Table, Value};

pub(super) type Validated = Result<(), ScenarioError>;

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
        Value::Float(x) => bounded("", *x),
        Value::Array(values) => values.iter().enumerate().try_for_each(|(i, value)| {
            interrupt::checkpoint(64);
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
    table(options, |_| None)?;
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

/// One of `[[wrenches]]`, of which only its arm knows whether it has the link.
pub fn wrench<const D: usize>(wrench: &Wrench<D>) -> Validated {
    number("start", wrench.start, &NOT_NEGATIVE)?;
    if let Some(duration) = wrench.duration {
        number("duration", duration, &POSITIVE)?;
    }
    match &wrench.profile {
        Profile::Constant {} | Profile::Sinusoid { .. } => Ok(()),
        Profile::Ramp { rise, fall } => {
            number("profile.rise", *rise, &NOT_NEGATIVE)?;
            number("profile.fall", *fall, &NOT_NEGATIVE)?;
            if *fall > 0.0 && wrench.duration.is_none() {
                let problem = "needs `duration`: what has no end does not fall before it";
                return Err(ScenarioError::new("profile.fall", Problem::Other(problem.into())));
            }
            if rise + fall > wrench.length() {
                let requirement = "at least as long as rise and fall of its profile together";
                return Err(ScenarioError::out_of_range("duration", requirement, wrench.length()));
            }
            Ok(())
        }
        Profile::Table { times, factors } => {
            if times.is_empty() {
                return Err(ScenarioError::out_of_range(
                    "profile.times",
                    "at least one time",
                    [0.0; 0],
                ));
            }
            length("profile.factors", factors.len(), times.len())?;
            number("profile.times[0]", times[0], &NOT_NEGATIVE)?;
            match (1..times.len()).find(|&k| times[k] <= times[k - 1]) {
                Some(k) => {
                    let path = format!("profile.times[{k}]");
                    Err(ScenarioError::out_of_range(path, "after the one before", times[k]))
                }
                None => Ok(()),
            }
        }
    }
}

/// How a link is pulled, of which only its arm knows whether it has it.
pub fn pull<const D: usize>(pull: &Pull<D>) -> Validated {
    if let Some(stiffness) = pull.stiffness {
        number("stiffness", stiffness, &POSITIVE)?;
    }
    pull.damping.map_or(Ok(()), |damping| number("damping", damping, &NOT_NEGATIVE))
}

/// `contact` of an obstacle.
pub fn contact(settings: &ContactSettings) -> Validated {
    table(settings, |_| None)
}

/// `[[wrenches]]`, of which only their arm knows whether it has the links.
pub fn wrenches<const D: usize>(given: &[Wrench<D>]) -> Validated {
    if given.len() > MAX_WRENCHES {
        let requirement = format!("at most {MAX_WRENCHES} of them");
        return Err(ScenarioError::out_of_range("wrenches", &requirement, given.len()));
    }
    given.iter().enumerate().try_for_each(|(i, each)| {
        wrench(each).map_err(|error| error.inside(&format!("wrenches[{i}]")))
    })
}

/// What is said of a link that an arm does not have.
pub fn no_such_link(given: &str, allowed: Vec<String>) -> ScenarioError {
    ScenarioError::new("link", Problem::UnknownChoice { given: given.into(), allowed })
}

/// `[measurement]` of n joints, with plant steps of `dt` \[s\]; `sampled` unless control is continuous.
pub fn measurement(settings: &MeasurementSettings, n: usize, dt: f64, sampled: bool) -> Validated {
    needs_sampling(sampled, "sees every instant")?;
    table(settings, |_| Some(n))?;
    let longest = settings.delay.values().iter().copied().fold(0.0, f64::max);
    if MeasurementSettings::steps(longest, dt) > Measurement::MAX_DELAY {
        let requirement = format!("at most {:e} steps of {dt} s", Measurement::MAX_DELAY);
        return Err(ScenarioError::out_of_range("delay", &requirement, longest));
    }
    Ok(())
}

/// `[perception]` of an arm with so many bodies in a space of this dimension, with plant steps of `dt` \[s\]; `sampled`
/// unless control is continuous.
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
    let has_cameras = settings.kind.has_cameras();
    if has_cameras && settings.cameras.is_empty() {
        return Err(ScenarioError::new("cameras", Problem::Other("expected at least one".into())));
    }
    number("range", range, &POSITIVE)?;
    number("noise", settings.noise, &NOT_NEGATIVE)?;
    number("resolution", settings.resolution, &NOT_NEGATIVE)?;
    number("latency", settings.latency, &NOT_NEGATIVE)?;
    if !(0.0..=1.0).contains(&drop_outs) {
        return Err(ScenarioError::out_of_range("drop_outs", "in [0, 1]", drop_outs));
    }
    depths(settings)?;
    if let Some(rate) = settings.rate {
        number("rate", rate, &POSITIVE)?;
        if settings.steps_per_scan(dt) > MAX_STEPS {
            let requirement = format!("at least one scan in {MAX_STEPS:e} steps of {dt} s");
            return Err(ScenarioError::out_of_range("rate", &requirement, rate));
        }
    }
    if settings.steps_late(dt) > MAX_STEPS {
        let requirement = format!("at most {MAX_STEPS:e} steps of {dt} s");
        return Err(ScenarioError::out_of_range("latency", &requirement, settings.latency));
    }
    if settings.readings_under_way(bodies, dimension, dt) > MAX_READINGS {
        let rays = settings.rays_of(bodies, dimension);
        let path = if has_cameras { "cameras" } else { "sensors" };
        let requirement = format!("so few that at most {MAX_READINGS:e} readings are under way");
        return Err(ScenarioError::out_of_range(path, &requirement, format!("{rays} rays")));
    }
    Ok(())
}

/// What of `[perception]` is of pictures alone.
fn depths(settings: &PerceptionSettings) -> Validated {
    let PerceptionSettings { grazing, position_error, orientation_error, clock_error, .. } =
        *settings;
    for (path, given) in [("position_error", position_error), ("clock_error", clock_error)] {
        number(path, given, &NOT_NEGATIVE)?;
    }
    if !(0.0..FRAC_PI_2).contains(&grazing) {
        return Err(ScenarioError::out_of_range("grazing", "in [0, π/2)", grazing));
    }
    if !(0.0..=PI).contains(&orientation_error) {
        let (path, requirement) = ("orientation_error", "in [0, π]");
        return Err(ScenarioError::out_of_range(path, requirement, orientation_error));
    }
    if settings.kind != PerceptionKind::Depth {
        let keys = ["grazing", "position_error", "orientation_error", "clock_error"];
        let given = [grazing, position_error, orientation_error, clock_error];
        let stray = keys.into_iter().zip(given.map(|given| given != 0.0));
        let perceiver = settings.perceiver != PerceiverSettings::default();
        let mut stray = stray.chain([("perceiver", perceiver)]);
        if let Some((path, _)) = stray.find(|(_, is_given)| *is_given) {
            let problem = "is for pictures: it needs kind = \"depth\"";
            return Err(ScenarioError::new(path, Problem::Other(problem.into())));
        }
        return Ok(());
    }
    // Otherwise no picture could be put to a state of the arm.
    let PerceiverSettings { latest_state, time_offset, .. } = settings.perceiver;
    let latest = settings.latency + latest_state - clock_error;
    if latest < 0.0 {
        let requirement = "at most latency + perceiver.latest_state";
        return Err(ScenarioError::out_of_range("clock_error", requirement, clock_error));
    }
    if !(-10.0..=latest).contains(&time_offset) {
        let requirement = "in [-10, latency + perceiver.latest_state − clock_error]";
        return Err(ScenarioError::out_of_range("perceiver.time_offset", requirement, time_offset));
    }
    Ok(())
}

/// What of `[perception]` means nothing in the plane.
fn in_the_plane(settings: &PerceptionSettings) -> Validated {
    let stray = [
        ("kind", settings.kind.has_cameras()),
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
    table(settings, |_| Some(n))
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
    let axes: Vec<usize> = dimensions.iter().filter_map(|d| settings.task.dimension(*d)).collect();
    let first = *axes.first().ok_or_else(not_in_the_plane)?;
    let fitting = |given: &ScalarOrVec| {
        let count = given.values().len();
        Some(if axes.contains(&count) { count } else { first })
    };
    table(settings, |key| match key {
        "stiffness" => fitting(&settings.stiffness),
        "damping" => fitting(&settings.damping),
        _ => n,
    })?;
    if let Some(posture) = &settings.posture {
        length("posture", posture.len(), n.unwrap_or(posture.len()))?;
    }
    yielding(&settings.yielding).map_err(|error| error.inside("yielding"))?;
    if let Some(parts) = &settings.yielding.order {
        look_ahead::order(parts, settings.task, arm.map(|(_, dimension)| dimension))?;
    }
    if settings.avoidance == Avoidance::Cbf {
        look_ahead::work(settings)?;
        look_ahead::self_motion(settings, arm)?;
    }
    if let Some(limits) = &settings.joint_limit_field {
        field(limits).map_err(|error| error.inside("joint_limit_field"))?;
    }
    if let Some(tank) = &settings.tank {
        self::tank(tank).map_err(|error| error.inside("tank"))?;
    }
    touch(settings, arm)?;
    if let Some(governor) = &settings.governor {
        self::governor(governor).map_err(|error| error.inside("governor"))?;
    }
    table(&settings.command, |_| n).map_err(|error| error.inside("command"))?;
    field(&settings.field).map_err(|error| error.inside("field"))
}

/// Whether there is a posture for its spring, where the reference does not bring one.
pub fn posture(settings: &Settings) -> Validated {
    let pulls = settings.posture_stiffness.values().iter().any(|k| *k > 0.0);
    if pulls && settings.posture.is_none() {
        let problem = "needs `posture`, the angles that the spring pulls to, or a plan: as the reference, or by `replan`";
        return Err(ScenarioError::new("posture_stiffness", Problem::Other(problem.into())));
    }
    Ok(())
}

/// What is wrong with a task that the plane does not have.
pub fn not_in_the_plane() -> ScenarioError {
    let problem = "needs an arm in space: in the plane a pose has one angle, take \"pose\"";
    ScenarioError::new("task", Problem::Other(problem.into()))
}

/// `[controller.yielding]`.
fn yielding(yielding: &Yielding) -> Validated {
    table(yielding, |_| None)?;
    let Yielding { inner, outer, .. } = yielding;
    if outer <= inner {
        let requirement = format!("greater than inner = {inner}");
        return Err(ScenarioError::out_of_range("outer", &requirement, *outer));
    }
    yielding.preview.as_ref().map_or(Ok(()), |given| {
        look_ahead::table_of(given).map_err(|error| error.inside("preview"))
    })
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
    number("capacity", tank.capacity, &POSITIVE)?;
    if let Some(initial) = tank.initial
        && !(0.0..=tank.capacity).contains(&initial)
    {
        let requirement = format!("between 0 and the capacity {}", tank.capacity);
        return Err(ScenarioError::out_of_range("initial", &requirement, initial));
    }
    number("floor", tank.floor, &SHARE)
}

/// `[controller.governor]`.
fn governor(governor: &GovernorSettings) -> Validated {
    table(governor, |_| None)?;
    let GovernorSettings { inner, outer, .. } = *governor;
    if outer <= inner {
        let requirement = format!("greater than inner = {inner}");
        return Err(ScenarioError::out_of_range("outer", &requirement, outer));
    }
    Ok(())
}

/// `[replan]`.
pub fn replan(settings: &ReplanSettings, n: usize, dimension: usize) -> Validated {
    table(settings, |_| Some(n))?;
    let view = settings.view.as_ref();
    view.map_or(Ok(()), |point| length("view", point.len(), dimension))
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
    number("gain", field.gain, &NOT_NEGATIVE)?;
    number("influence", field.influence, &POSITIVE)?;
    number("approach_damping", field.approach_damping, &NOT_NEGATIVE)?;
    number("sliding", field.sliding, &NOT_NEGATIVE)?;
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
    let Motion::Waypoints { times, points, angles, orientations, interpolation, .. } = motion
    else {
        return Ok(());
    };
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
    let tops = [motion.top_speed(), motion.top_acceleration()];
    if *interpolation == Interpolation::Smooth && !tops.iter().all(|top| top.is_finite()) {
        let problem = "are too far apart for `times`: no speed between them is finite".into();
        return Err(ScenarioError::new("points", Problem::Other(problem)));
    }
    if let Some(i) = motion.orientation_apart() {
        let problem = "cannot be turned to smoothly from the one before at such a rate: give one between them";
        return Err(ScenarioError::new(
            format!("orientations[{i}]"),
            Problem::Other(problem.into()),
        ));
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
fn same<const D: usize>(a: &[f64; D], b: &[f64; D]) -> bool {
    a == b
}
