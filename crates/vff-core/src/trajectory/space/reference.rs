//! A reference in space, as it is described in a scenario.

use crate::trajectory::Knots;
use serde::Deserialize;

/// The path and timing of an end effector in space, for tasks of position, pointing and pose.
///
/// Positions are `[x, y, z]` \[m\] in world axes. Orientations are unit quaternions `[w, x, y, z]`, for tasks that
/// control them; where none is given, that of the end effector at t = 0 is kept.
///
/// With `relative = true`, positions are displacements from the end effector at t = 0, in world axes, and
/// orientations turn the one it has there: R_r = R(given) R(start).
///
/// # Example
/// ```
/// use vff_core::trajectory::SpatialReference;
///
/// let reference: SpatialReference = toml::from_str("setpoint = { point = [0.5, 0.0, 0.4] }").unwrap();
/// assert!(matches!(reference, SpatialReference::Setpoint { relative: false, .. }));
/// ```
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SpatialReference {
    /// A fixed pose.
    Setpoint {
        /// The point \[m\]. Default: that of the end effector at t = 0.
        #[serde(default)]
        point: Option<[f64; 3]>,
        /// Orientation. Default: that of the end effector at t = 0.
        #[serde(default)]
        orientation: Option<[f64; 4]>,
        /// Whether all of it is relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
    },
    /// A polynomial in t for each coordinate, for all t.
    Polynomial {
        /// One list per coordinate: factors of 1, t, t², … \[m, m/s, m/s², …\].
        coefficients: [Vec<f64>; 3],
        /// Constant orientation. Default: that of the end effector at t = 0.
        #[serde(default)]
        orientation: Option<[f64; 4]>,
        /// Whether all of it is relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
    },
    /// A straight line from rest at t = 0 to rest at `duration`, then a hold, while the orientation turns about one
    /// axis the shorter way (a half turn: either). The travelled fraction of both is 10s³ − 15s⁴ + 6s⁵ with
    /// s = t / `duration` (least jerk).
    Line {
        /// First point \[m\]. Default: that of the end effector at t = 0.
        #[serde(default)]
        start: Option<[f64; 3]>,
        /// Last point \[m\].
        end: [f64; 3],
        /// Time from the first to the last point \[s\], positive.
        duration: f64,
        /// First orientation. Default: that of the end effector at t = 0.
        #[serde(default)]
        start_orientation: Option<[f64; 4]>,
        /// Last orientation. Default: the first.
        #[serde(default)]
        orientation: Option<[f64; 4]>,
        /// Whether all of it is relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
    },
    /// A circle at constant speed, for all t.
    Circle {
        /// Centre \[m\].
        center: [f64; 3],
        /// Radius \[m\].
        radius: f64,
        /// Angular velocity \[rad/s\], counter-clockwise seen against the normal when positive.
        angular_velocity: f64,
        /// Angle at t = 0 \[rad\], from the axis that the least rotation of z to the normal makes of x (for −z: x
        /// itself). Default 0.
        #[serde(default)]
        phase: f64,
        /// Normal of the circle's plane, of any length but 0. Default z.
        #[serde(default = "upwards")]
        normal: [f64; 3],
        /// Constant orientation, that at t = 0 if it is `turning`. Default: that of the end effector at t = 0.
        #[serde(default)]
        orientation: Option<[f64; 4]>,
        /// Whether the tool turns with the circle about its normal. Default false.
        #[serde(default)]
        turning: bool,
        /// Whether centre and orientation are relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
    },
    /// `center` + `amplitude` · sin(`angular_frequency` · t + `phase`) on each axis, for all t.
    Lissajous {
        /// Centre \[m\].
        center: [f64; 3],
        /// Amplitude of each axis \[m\].
        amplitude: [f64; 3],
        /// Angular frequency of each axis \[rad/s\].
        angular_frequency: [f64; 3],
        /// Phase of each axis at t = 0 \[rad\]. Default 0.
        #[serde(default)]
        phase: [f64; 3],
        /// Constant orientation. Default: that of the end effector at t = 0.
        #[serde(default)]
        orientation: Option<[f64; 4]>,
        /// Whether centre and orientation are relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
    },
    /// A smooth path (C²) through a few poses, from rest at the first to rest at the last; holds before and after.
    /// Quintic between the points. At an interior point velocity and acceleration are those of the parabola through
    /// the point and its two neighbours. Orientations are quintics of their quaternions, normalised.
    Waypoints {
        /// Instants \[s\], strictly increasing, at least two.
        times: Vec<f64>,
        /// The point at each instant \[m\].
        points: Vec<[f64; 3]>,
        /// The orientation at each instant. Default: that of the end effector at t = 0 is kept.
        #[serde(default)]
        orientations: Option<Vec<[f64; 4]>>,
        /// Whether all of it is relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
    },
    /// A smooth path (C²) through dense samples: the natural cubic spline, of orientations that of their quaternions,
    /// normalised. Holds the pose before and after, so the velocity jumps there unless the samples begin and end at
    /// rest.
    Table {
        /// Instants \[s\], strictly increasing, at least two.
        times: Vec<f64>,
        /// The point at each instant \[m\].
        points: Vec<[f64; 3]>,
        /// The orientation at each instant. Default: that of the end effector at t = 0 is kept.
        #[serde(default)]
        orientations: Option<Vec<[f64; 4]>>,
        /// Whether all of it is relative to the end effector at t = 0. Default false.
        #[serde(default)]
        relative: bool,
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

impl SpatialReference {
    /// The orientation that it is given, where that is one.
    #[cfg(feature = "scenario")]
    pub(crate) fn orientation(&self) -> Option<[f64; 4]> {
        match self {
            Self::Setpoint { orientation, .. }
            | Self::Polynomial { orientation, .. }
            | Self::Line { orientation, .. }
            | Self::Circle { orientation, .. }
            | Self::Lissajous { orientation, .. } => *orientation,
            Self::Waypoints { orientations, .. } | Self::Table { orientations, .. } => {
                orientations.as_ref()?.first().copied()
            }
            Self::Plan { .. } => None,
        }
    }

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

/// The default normal of a circle.
fn upwards() -> [f64; 3] {
    [0.0, 0.0, 1.0]
}
