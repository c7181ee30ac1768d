//! What is known of torques from outside, and what is done about them: `[controller.observer]`, `[controller.touch]`.

use super::error::{Problem, ScenarioError};
use super::numbers::{length, table};
use super::validate::Validated;
use crate::control::Settings;
use crate::control::force::ForceSettings;
use crate::control::observer::{ObserverSettings, Touch};

/// `[controller.observer]` and `[controller.touch]`, for the arm of n joints in `dimension` dimensions where that is known.
pub fn touch(settings: &Settings, arm: Option<(usize, usize)>) -> Validated {
    let Settings { observer, touch, yielding, .. } = settings;
    let Some(observer) = observer else {
        if *touch == Touch::default() {
            return Ok(());
        }
        return refused(
            "touch",
            "needs [controller.observer]: what acts is to be known before it is answered",
        );
    };
    let joints = |_: &str| arm.map(|(n, _)| n);
    table(observer, joints).map_err(|error| error.inside("observer"))?;
    if let Some(detection) = &observer.detection {
        table(detection, joints).map_err(|error| error.inside("observer.detection"))?;
    }
    if let Some(reaction) = &touch.reaction {
        table(reaction, joints).map_err(|error| error.inside("touch.reaction"))?;
        if let Some(stop) = reaction.stop.filter(|stop| *stop < reaction.force) {
            let requirement = format!("at least `force`, {} N", reaction.force);
            return Err(ScenarioError::out_of_range("touch.reaction.stop", &requirement, stop));
        }
        if observer.detection.is_none() {
            return refused(
                "touch.reaction",
                "needs [controller.observer.detection]: what is to be answered has to be told from the rest",
            );
        }
        if touch.force.is_some() {
            return refused(
                "touch.reaction",
                "is not for a tip that presses on something: it would give way to that",
            );
        }
    }
    let Some(force) = &touch.force else { return Ok(()) };
    self::force(force, observer, arm.map(|(_, dimension)| dimension))
        .map_err(|error| error.inside("touch.force"))?;
    if yielding.preview.is_some() {
        return refused(
            "touch.force",
            "has no look-ahead: that takes the surface that the tip is to press on for a collision",
        );
    }
    Ok(())
}

/// `[controller.touch.force]` at a control period \[s\]: what T159 asks for.
pub fn sampled(settings: &Settings, period: f64) -> Validated {
    let Settings { observer: Some(observer), touch: Touch { force: Some(force), .. }, .. } =
        settings
    else {
        return Ok(());
    };
    if let Some((key, rate)) = force.too_fast(observer.bandwidth, period) {
        let most = 0.5 / period;
        let requirement =
            format!("at most half per control period, {most} 1/s, with [controller.touch.force]");
        return Err(ScenarioError::out_of_range(format!("controller.{key}"), &requirement, rate));
    }
    Ok(())
}

fn refused(key: &str, problem: &str) -> Validated {
    Err(ScenarioError::new(key, Problem::Other(problem.into())))
}

/// `[controller.touch.force]`: a direction, and gains that are stable on every surface (T159).
fn force(
    settings: &ForceSettings,
    observer: &ObserverSettings,
    dimension: Option<usize>,
) -> Validated {
    table(settings, |_| None)?;
    let direction = settings.direction.as_deref().unwrap_or_default();
    length("direction", direction.len(), dimension.unwrap_or(direction.len().clamp(2, 3)))?;
    let size = direction.iter().map(|x| x * x).sum::<f64>().sqrt();
    if !(size > 0.0 && size.is_finite()) {
        let requirement = "finite, and longer than 0";
        return Err(ScenarioError::out_of_range("direction", requirement, direction));
    }
    for (key, value, most, formula) in [
        (
            "gain",
            settings.gain,
            settings.largest_gain(observer.bandwidth),
            "0.8 damping / observer.bandwidth",
        ),
        (
            "integral",
            settings.integral,
            settings.largest_integral(observer.bandwidth),
            "0.5 (1 + gain) / (1 / damping + 1 / observer.bandwidth)",
        ),
    ] {
        if value > most {
            let requirement =
                format!("at most {formula} = {most}: stiff surfaces are hit again and again");
            return Err(ScenarioError::out_of_range(key, &requirement, value));
        }
    }
    Ok(())
}
