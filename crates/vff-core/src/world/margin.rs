//! What a pair of a link and an obstacle keeps.

/// The margin of a pair: one of its own \[m\], > 0, that takes the place of the usual one, of the law or of a plan; or none.
///
/// Everything that keeps a margin asks here which one that is: barriers by [`of_its_own`](Self::of_its_own), of which a plan keeps
/// a share, planners by [`share`](Self::share), as near an end all margins are lowered alike, and look-ahead by
/// [`as_usual`](Self::as_usual).
///
/// # Example
/// ```
/// use vff_core::world::PairMargin;
///
/// let (hand, others) = (PairMargin::own(0.005), PairMargin::USUAL);
/// assert_eq!([hand, others].map(|margin| margin.or(0.02)), [0.005, 0.02]);
/// assert_eq!(hand.share(0.02), 0.25);
/// // As far above its margin as 0.03 m are above the usual one, and all of its margin.
/// assert!((hand.as_usual(0.015, 0.02) - 0.03).abs() < 1e-15);
/// assert_eq!(hand.as_usual(0.005, 0.02), 0.02);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PairMargin(f64); // 0 for the usual one: contacts are copied often

impl PairMargin {
    /// The usual one.
    pub const USUAL: Self = Self(0.0);

    /// One of its own \[m\], > 0.
    pub fn own(margin: f64) -> Self {
        Self(margin)
    }

    /// Whether it is one of its own.
    pub fn is_own(self) -> bool {
        self.0 > 0.0
    }

    /// The one of its own \[m\].
    #[inline]
    pub fn of_its_own(self) -> Option<f64> {
        self.is_own().then_some(self.0)
    }

    /// What is kept where others keep `usual` \[m\].
    #[inline]
    pub fn or(self, usual: f64) -> f64 {
        if self.is_own() { self.0 } else { usual }
    }

    /// How much farther than others pairs are looked for where the largest margin of their own is `most`, and others keep `usual`
    /// \[m\].
    pub fn farther(most: f64, usual: f64) -> f64 {
        (most - usual).max(0.0)
    }

    /// How many times what others keep, who usually keep `usual` \[m\].
    #[inline]
    pub fn share(self, usual: f64) -> f64 {
        if self.is_own() { self.0 / usual } else { 1.0 }
    }

    /// The distance at which a pair that keeps `usual` is as well off as this one at `distance`, in parts of its margin below that,
    /// in metres above \[m\].
    #[inline]
    pub fn as_usual(self, distance: f64, usual: f64) -> f64 {
        let Self(own) = self;
        match self.is_own() {
            false => distance,
            true if distance > own => usual + (distance - own),
            true => distance * (usual / own),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    properties! {
        /// Contact is contact, the margin is the margin, farther is farther, and beyond the margin a metre is a metre.
        #[test]
        fn what_is_kept_decides_how_well_off_a_pair_is(
            own in 1e-3..0.3f64, usual in 1e-3..0.3f64, distance in -0.5..1.0f64, farther in 1e-6..1.0f64,
        ) {
            let margin = PairMargin::own(own);
            let seen = |distance: f64| -> f64 { margin.as_usual(distance, usual) };
            prop_assert!(seen(0.0) == 0.0 && (seen(own) - usual).abs() < 1e-12);
            prop_assert!(seen(distance + farther) > seen(distance));
            prop_assert_eq!(seen(distance) < usual, distance < own);
            prop_assert!((seen(own + farther) - usual - farther).abs() < 1e-12);
            let others = PairMargin::USUAL.as_usual(distance, usual);
            prop_assert_eq!(others.to_bits(), distance.to_bits());
        }
    }
}
