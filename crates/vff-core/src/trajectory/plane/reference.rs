//! A reference, as it is described in a scenario.

use crate::trajectory::Knots;
use serde::Deserialize;

/// The path and timing of the end effector.
///
/// Points have one entry per task axis: x, y \[m\] and, when the task controls it, the
/// orientation φ \[rad\].
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Reference {
    /// A fixed point.
    Setpoint {
        /// The point.
        point: Vec<f64>,
    },
    /// A polynomial in t for each axis, for all t.
    Polynomial {
        /// One list per axis: factors of 1, t, t², … \[m, m/s, m/s², …\].
        coefficients: Vec<Vec<f64>>,
    },
    /// A straight line from rest at t = 0 to rest at `duration`, then a hold. The travelled
    /// fraction is 10s³ − 15s⁴ + 6s⁵ with s = t / `duration` (least jerk).
    Line {
        /// First point. Default: the pose of the end effector at t = 0.
        #[serde(default)]
        start: Option<Vec<f64>>,
        /// Last point.
        end: Vec<f64>,
        /// Time from the first to the last point \[s\], positive.
        duration: f64,
    },
    /// A circle at constant speed, for all t.
    Circle {
        /// Centre \[m\].
        center: [f64; 2],
        /// Radius \[m\].
        radius: f64,
        /// Angular velocity \[rad/s\], counter-clockwise when positive.
        angular_velocity: f64,
        /// Angle from the x axis at t = 0 \[rad\]. Default 0.
        #[serde(default)]
        phase: f64,
        /// Constant orientation \[rad\]: given if and only if the task controls it.
        #[serde(default)]
        orientation: Option<f64>,
    },
    /// `center` + `amplitude` · sin(`angular_frequency` · t + `phase`) on each axis, for all t.
    Lissajous {
        /// Centre \[m\].
        center: [f64; 2],
        /// Amplitude of each axis \[m\].
        amplitude: [f64; 2],
        /// Angular frequency of each axis \[rad/s\].
        angular_frequency: [f64; 2],
        /// Phase of each axis at t = 0 \[rad\]. Default 0.
        #[serde(default)]
        phase: [f64; 2],
        /// Constant orientation \[rad\]: given if and only if the task controls it.
        #[serde(default)]
        orientation: Option<f64>,
    },
    /// A smooth path (C²) through a few points, from rest at the first to rest at the last;
    /// holds before and after. Quintic between the points. At an interior point velocity and
    /// acceleration are those of the parabola through the point and its two neighbours.
    Waypoints {
        /// Instants \[s\], strictly increasing, at least two.
        times: Vec<f64>,
        /// The point at each instant.
        points: Vec<Vec<f64>>,
    },
    /// A smooth path (C²) through dense samples: the natural cubic spline. Holds the position
    /// before and after, so the velocity jumps there unless the samples begin and end at rest.
    Table {
        /// Instants \[s\], strictly increasing, at least two.
        times: Vec<f64>,
        /// The point at each instant.
        points: Vec<Vec<f64>>,
    },
    /// Joints that go from rest at the first configuration to rest at the last: the clamped cubic spline (C²), held
    /// before and after; between two in a row that are the same they rest. The end effector has to be where they put it, and the
    /// null space is drawn to the rest.
    Plan {
        /// Instants \[s\], strictly increasing, at least two.
        times: Vec<f64>,
        /// The configuration at each instant, one number per joint \[rad, of a sliding joint m\].
        points: Vec<Vec<f64>>,
        /// What is kept from obstacles at each instant, one number per link \[m\], ≥ 0: between two of them the smaller
        /// is known to be there, and barriers keep no more. Default: they keep `yielding.margin`.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        margins: Option<Vec<Vec<f64>>>,
        /// Which share of obstacles' own margins is kept there, one number per link, in \[0, 1\]. Default: all.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        shares: Option<Vec<Vec<f64>>>,
    },
}

impl Reference {
    /// The knots of the plan that it is, if it is one.
    pub(crate) fn plan(&self) -> Option<Knots<'_>> {
        match self {
            Self::Plan { times, points, margins, shares } => {
                let [margins, shares] = [margins, shares].map(Option::as_deref);
                Some(Knots { times, points, margins, shares })
            }
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optional_fields_have_defaults() {
        #[derive(Deserialize)]
        struct Document {
            reference: Vec<Reference>,
        }
        let document: Document = toml::from_str(
            "reference = [\n\
             { line = { end = [2.8, 1.6], duration = 5 } },\n\
             { circle = { center = [2, 1], radius = 1, angular_velocity = 0.5 } },\n\
             { lissajous = { center = [2, 1], amplitude = [1, 1], angular_frequency = [1, 2] } },\n\
             ]",
        )
        .unwrap();
        assert_eq!(
            document.reference,
            [
                Reference::Line { start: None, end: vec![2.8, 1.6], duration: 5.0 },
                Reference::Circle {
                    center: [2.0, 1.0],
                    radius: 1.0,
                    angular_velocity: 0.5,
                    phase: 0.0,
                    orientation: None
                },
                Reference::Lissajous {
                    center: [2.0, 1.0],
                    amplitude: [1.0, 1.0],
                    angular_frequency: [1.0, 2.0],
                    phase: [0.0, 0.0],
                    orientation: None
                },
            ]
        );
    }

    #[test]
    fn unknown_names_are_refused() {
        for text in
            ["setpoint = { point = [1.0, 2.0], speed = 1.0 }", "spiral = { point = [1.0, 2.0] }"]
        {
            let error = toml::from_str::<Reference>(text).unwrap_err().to_string();
            assert!(error.contains("expected"), "{error}");
        }
    }
}
