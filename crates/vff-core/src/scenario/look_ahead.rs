//! Checks of the look-ahead: its tables, and whether what it has to do is bounded.

use super::error::{Problem, ScenarioError};
use super::numbers::{number, table};
use super::validate::Validated;
use crate::control::avoidance::barrier;
use crate::control::avoidance::preview::fastest_rate;
use crate::control::{Part, PreviewSettings, SelfMotionSettings, Settings, TaskKind};
use crate::settings::SHARE;
use crate::world::Description;

/// `[controller.yielding.preview]`.
pub fn table_of(settings: &PreviewSettings) -> Validated {
    table(settings, |_| None)?;
    let PreviewSettings { horizon, trigger, .. } = settings;
    if trigger > horizon {
        let requirement = format!("at most horizon = {horizon}");
        return Err(ScenarioError::out_of_range("trigger", &requirement, *trigger));
    }
    let given = settings.self_motion.as_ref();
    given
        .map_or(Ok(()), |given| table(given, |_| None).map_err(|error| error.inside("self_motion")))
}

/// The likelihood of an obstacle that is a possible future, or a part of one.
pub fn likelihood<const D: usize>(obstacle: &impl Description<D>) -> Validated {
    match obstacle.likelihood() {
        Some(given) => number("likelihood", given, &SHARE),
        None if obstacle.future().is_some() => {
            let problem = "how likely is it? It needs a `likelihood`";
            Err(ScenarioError::new("future", Problem::Other(problem.into())))
        }
        None => Ok(()),
    }
}

/// Whether it is seen what an obstacle is, if it is a possible future, by a law that looks ahead or not.
///
/// # Errors
/// If nobody does: nobody would see it.
pub fn is_seen_ahead<const D: usize>(
    obstacle: &impl Description<D>,
    looks_ahead: bool,
) -> Validated {
    if obstacle.likelihood().is_none() || looks_ahead {
        return Ok(());
    }
    let problem =
        "look-ahead alone sees a possible future: needs `controller.yielding.preview` and \"cbf\"";
    Err(ScenarioError::new("likelihood", Problem::Other(problem.into())))
}

/// In which order a task gives way, of an arm in `dimension` dimensions where that is known.
pub fn order(parts: &[Part], task: TaskKind, dimension: Option<usize>) -> Validated {
    for (i, part) in parts.iter().enumerate() {
        let problem = match part {
            _ if parts[..i].contains(part) => "has a part twice",
            Part::Turn | Part::Orientation if task == TaskKind::Position => {
                "names what needs a task with an orientation: a position has none to give way"
            }
            Part::Turn if task == TaskKind::Pointing => {
                "has `turn`, which is free already: a pointing task does not keep the turn about the tool's axis"
            }
            Part::Turn if dimension == Some(2) => {
                "has `turn`, which needs an arm in space: in the plane there is `orientation`"
            }
            _ => continue,
        };
        return Err(ScenarioError::new("yielding.order", Problem::Other(problem.into())));
    }
    Ok(())
}

/// Whether a search of the self-motion has a curve to search, and room for it.
pub fn self_motion(settings: &Settings, arm: Option<(usize, usize)>) -> Validated {
    const MAX_NODES: f64 = 1e5;
    let preview = settings.yielding.preview.as_ref();
    let Some(given) = preview.and_then(|preview| preview.self_motion.as_ref()) else {
        return Ok(());
    };
    let inside = |error: ScenarioError| error.inside("yielding.preview.self_motion");
    let SelfMotionSettings { range, spacing, steps, .. } = given;
    #[expect(clippy::cast_precision_loss, reason = "at most 10000")]
    let most = MAX_NODES / (*steps + 1) as f64;
    if 2.0 * (range / spacing).ceil() + 1.0 > most {
        let requirement = format!("at least {:.2e} with {steps} steps", 2.0 * range / most);
        return Err(inside(ScenarioError::out_of_range("spacing", &requirement, *spacing)));
    }
    let Some((n, dimension)) = arm else { return Ok(()) };
    let m = settings.task.dimension(dimension).unwrap_or(0);
    if n != m + 1 {
        let left = n.saturating_sub(m);
        let problem = format!(
            "needs a task that leaves one degree of freedom: this one leaves {left} of {n}"
        );
        return Err(inside(ScenarioError::new("", Problem::Other(problem))));
    }
    Ok(())
}

/// What look-ahead has to do in one control step: bounded, because its closed loop takes steps as short as the fastest
/// rate of the law demands.
pub fn work(settings: &Settings) -> Validated {
    const MAX_STEPS_AHEAD: usize = 100_000;
    let Some(preview) = &settings.yielding.preview else { return Ok(()) };
    let inside = |error: ScenarioError| error.inside("yielding.preview");
    if preview.steps * preview.candidates > MAX_STEPS_AHEAD {
        let requirement =
            format!("at most {} with {} steps", MAX_STEPS_AHEAD / preview.steps, preview.steps);
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
