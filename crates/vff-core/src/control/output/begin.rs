//! Whether a loop can begin: what its period asks of settings.

use crate::control::{Settings, Unstable};

/// Why a loop cannot begin.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum BeginError {
    /// The period is no duration.
    #[error("period must be finite and greater than 0, got {0}")]
    Period(f64),
    /// Damping held over the period would accelerate the arm.
    #[error(
        "command.stop_damping: {damping} 1/s is unstable at a control period of {period} s; below {} 1/s it is not",
        2.0 / period
    )]
    Damping {
        /// d \[1/s\].
        damping: f64,
        /// \[s\].
        period: f64,
    },
    /// A gain of the law would throw the arm.
    #[error(transparent)]
    Gain(#[from] Unstable),
    /// A force behind this rate would hit stiff surfaces again and again (T159).
    #[error(
        "{key}: must be at most half per control period, {} 1/s, with touch.force, got {rate}",
        0.5 / period
    )]
    Force {
        /// The key of the rate below `controller`.
        key: &'static str,
        /// \[1/s\].
        rate: f64,
        /// \[s\].
        period: f64,
    },
}

impl BeginError {
    /// Whether a law of these settings is for a loop of `period` \[s\].
    ///
    /// # Errors
    /// If the period is none, or too long.
    pub fn check(settings: &Settings, period: f64) -> Result<(), Self> {
        if !(period.is_finite() && period > 0.0) {
            return Err(Self::Period(period));
        }
        let damping = settings.command.stop_damping;
        if damping * period >= 2.0 {
            return Err(Self::Damping { damping, period });
        }
        let gains = Unstable::all(settings, period);
        if let Some(unstable) = gains.into_iter().find(|unstable| !unstable.is_slow()) {
            return Err(unstable.into());
        }
        let Settings { observer, touch, .. } = settings;
        let (Some(observer), Some(force)) = (observer, &touch.force) else { return Ok(()) };
        match force.too_fast(observer.bandwidth, period) {
            Some((key, rate)) => Err(Self::Force { key, rate, period }),
            None => Ok(()),
        }
    }
}
