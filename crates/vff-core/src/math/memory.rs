//! How much memory may be asked for at once.
//!
//! Systems promise more memory than they have, and end the process when it is used: whatever grows as a product of
//! sizes that a caller gives is compared with a limit before it is allocated.

/// The most that a record, a batch of them, or a set of matrices may take \[bytes\].
pub const MAX_BYTES: usize = 8_000_000_000;

/// More than that was asked for.
///
/// # Example
/// ```
/// use vff_core::math::memory::{TooLarge, fits};
///
/// assert_eq!(fits(1000), Ok(()));
/// let TooLarge { bytes } = fits(usize::MAX / 16).unwrap_err();
/// assert!(bytes > 1e18);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[error("{:.1} GB, more than the {:.0} GB allowed", 1e-9 * .bytes, 1e-9 * MAX_BYTES as f64)]
pub struct TooLarge {
    /// What was asked for.
    pub bytes: f64,
}

/// Whether so many numbers may be allocated.
///
/// # Errors
/// If they take more than [`MAX_BYTES`].
#[expect(clippy::cast_precision_loss, reason = "a message")]
pub fn fits(numbers: usize) -> Result<(), TooLarge> {
    match numbers.checked_mul(size_of::<f64>()) {
        Some(bytes) if bytes <= MAX_BYTES => Ok(()),
        _ => Err(TooLarge { bytes: numbers as f64 * 8.0 }),
    }
}
