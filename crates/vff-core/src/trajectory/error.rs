//! What can be wrong with a reference.

use thiserror::Error;

/// Why a [`Reference`](super::Reference) or a [`SpatialReference`](super::SpatialReference) cannot be prepared.
///
/// The message says what was expected and what was given. It does not name the field, so
/// that a caller can put the whole dotted path, ending in [`TrajectoryError::field`], before
/// it.
///
/// # Example
/// ```
/// use vff_core::math::Vector;
/// use vff_core::trajectory::{Trajectory, TrajectoryError, plane::Reference};
///
/// let reference = Reference::Setpoint { point: vec![1.0, 2.0, 3.0] };
/// let error = Trajectory::<Vector<2>, 2>::new(&reference, &Vector::<2>::zeros()).unwrap_err();
/// assert!(matches!(error, TrajectoryError::Dimension { expected: 2, given: 3, .. }));
/// ```
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TrajectoryError {
    /// A list that needs one entry per task axis has another length.
    #[error("expected {expected} entries, one per task axis, given {given}")]
    Dimension {
        /// Name of the list, such as `points[3]`.
        field: String,
        /// The task dimension.
        expected: usize,
        /// Length of the list.
        given: usize,
    },
    /// Not as many rows of what is kept as instants.
    #[error("expected {expected} rows, one per instant, given {given}")]
    RowCount {
        /// Name of the list: `margins` or `shares`.
        field: &'static str,
        /// The number of instants.
        expected: usize,
        /// The number of rows.
        given: usize,
    },
    /// A configuration that has not a number for each joint.
    #[error("expected {expected} entries, one per joint, given {given}")]
    Joints {
        /// Name of the configuration, such as `points[3]`.
        field: String,
        /// The number of joints.
        expected: usize,
        /// Length of the configuration.
        given: usize,
    },
    /// A plan, which leads the joints, where no arm is known.
    #[error("a plan needs the arm that follows it")]
    WithoutArm,
    /// Not as many points as times.
    #[error("expected {times} points, one per entry of `times`, given {points}")]
    PointCount {
        /// Number of times.
        times: usize,
        /// Number of points.
        points: usize,
    },
    /// Fewer than two times.
    #[error("expected at least 2 times, given {given}")]
    TooFewTimes {
        /// Number of times.
        given: usize,
    },
    /// A time that does not lie after the one before it.
    #[error("expected times that increase, given {given} s after {previous} s")]
    TimesNotIncreasing {
        /// Index of the time.
        index: usize,
        /// The time before it \[s\].
        previous: f64,
        /// The time \[s\].
        given: f64,
    },
    /// The task controls the orientation and the reference does not say which.
    #[error("expected an angle in radians because the task controls the orientation, given none")]
    MissingOrientation,
    /// An orientation for a task that does not control it.
    #[error("expected no angle because the task controls the position only, given {given} rad")]
    UnexpectedOrientation {
        /// The orientation \[rad\].
        given: f64,
    },
    /// Not as many orientations as times.
    #[error("expected {times} orientations, one per entry of `times`, given {given}")]
    OrientationCount {
        /// Number of times.
        times: usize,
        /// Number of orientations.
        given: usize,
    },
    /// A quaternion whose norm is not 1.
    #[error("expected a unit quaternion [w, x, y, z], given one of norm {norm}")]
    Orientation {
        /// Name of the quaternion, such as `orientations[3]`.
        field: String,
        /// Its norm.
        norm: f64,
    },
    /// Orientations so far apart that a smooth curve through them would spin round.
    #[error(
        "expected smaller turns from one orientation to the next, given one with no smooth way to it: \
         put orientations in between"
    )]
    OrientationsApart {
        /// Index of the orientation that the curve comes to.
        index: usize,
    },
    /// A field that says something of the orientation, for a task that does not control it.
    #[error("expected no `{field}` because the task controls the position only")]
    UselessOrientation {
        /// Name of the field.
        field: &'static str,
    },
    /// The normal of a circle that has no direction.
    #[error("expected a direction [x, y, z], given {given:?}")]
    Normal {
        /// What was given.
        given: [f64; 3],
    },
    /// A duration that is not positive.
    #[error("expected a positive duration, given {given} s")]
    Duration {
        /// The duration \[s\].
        given: f64,
    },
}

impl TrajectoryError {
    /// The field of the reference that is wrong, such as `duration`, `times[2]`, `points[3]`.
    pub fn field(&self) -> String {
        match self {
            Self::Dimension { field, .. }
            | Self::Joints { field, .. }
            | Self::Orientation { field, .. } => field.clone(),
            Self::UselessOrientation { field } => (*field).into(),
            Self::OrientationCount { .. } => "orientations".into(),
            Self::OrientationsApart { index } => format!("orientations[{index}]"),
            Self::RowCount { field, .. } => (*field).into(),
            Self::Normal { .. } => "normal".into(),
            Self::PointCount { .. } | Self::WithoutArm => "points".into(),
            Self::TooFewTimes { .. } => "times".into(),
            Self::TimesNotIncreasing { index, .. } => format!("times[{index}]"),
            Self::MissingOrientation | Self::UnexpectedOrientation { .. } => "orientation".into(),
            Self::Duration { .. } => "duration".into(),
        }
    }
}
