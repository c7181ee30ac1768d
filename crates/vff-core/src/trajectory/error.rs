//! What can be wrong with a reference.

use thiserror::Error;

/// Why a [`Reference`](super::Reference) cannot be prepared.
///
/// The message says what was expected and what was given. It does not name the field, so
/// that a caller can put the whole dotted path, ending in [`TrajectoryError::field`], before
/// it.
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
            Self::Dimension { field, .. } => field.clone(),
            Self::PointCount { .. } => "points".into(),
            Self::TooFewTimes { .. } => "times".into(),
            Self::TimesNotIncreasing { index, .. } => format!("times[{index}]"),
            Self::MissingOrientation | Self::UnexpectedOrientation { .. } => "orientation".into(),
            Self::Duration { .. } => "duration".into(),
        }
    }
}
