//! What a program that keeps distances reckons with, from which follows which of many distances it needs (T157).

use super::{MotionState, Pair, Turn};
use crate::math::{Capsule, Vector};
use std::cell::Cell;

/// Up to this acceleration of the ends of a link, seen from the obstacle, the distances that are kept imply the others \[m/s²\].
const IMPLIED_UP_TO: f64 = 16.0;

/// A distance is left out altogether that no smaller acceleration than this violates \[m/s²\].
const UNHARMED_UP_TO: f64 = 160.0;

/// Of barriers of the rate k: d + 2ḋ/k + d̈/k² is not to be less than what is kept.
///
/// # Example
/// ```
/// use std::cell::Cell;
/// use vff_core::math::Vector;
/// use vff_core::world::{Ahead, Outlook};
///
/// let coarsened = Cell::new(0);
/// let still = |_: usize, _: &Vector<3>| Vector::<3>::zeros();
/// let outlook = Outlook { rate: 10.0, kept: [0.02, 1.0], velocity: &still, coarsened: &coarsened };
/// let ahead = Ahead::<3> {
///     kept: outlook.kept[0],
///     horizon: 2.0 / outlook.rate,
///     shift: [Vector::<3>::zeros(); 2],
///     implied: 0.3,
///     unharmed: 3.0,
///     coarsened: outlook.coarsened,
/// };
/// assert_eq!(ahead.kept, 0.02);
/// ```
#[derive(Clone, Copy)]
pub struct Outlook<'a, const D: usize> {
    /// k \[1/s\].
    pub rate: f64,
    /// What is kept of a distance at most \[m\], and of a margin of a pair's own at most.
    pub kept: [f64; 2],
    /// The velocity of a point that is fixed to a link \[m/s\].
    pub velocity: &'a dyn Fn(usize, &Vector<D>) -> Vector<D>,
    /// Points that were taken for implied by others only because there is no room for more.
    pub coarsened: &'a Cell<u64>,
}

/// The same for one link, as an obstacle sees it.
#[derive(Debug, Clone, Copy)]
pub struct Ahead<'a, const D: usize> {
    /// What is kept of a distance at most \[m\].
    pub kept: f64,
    /// 2/k \[s\].
    pub horizon: f64,
    /// 2u/k of both ends of the axis: by how much they go on \[m\].
    pub shift: [Vector<D>; 2],
    /// How far off that the ends may come so that what is left out is implied \[m\].
    pub implied: f64,
    /// How far off that the ends may come so that what is higher than this is not violated \[m\].
    pub unharmed: f64,
    /// See [`Outlook`].
    pub coarsened: &'a Cell<u64>,
}

impl<const D: usize> Outlook<'_, D> {
    /// For a pair, the link of which has this axis, and an obstacle in this state, turned so.
    pub(super) fn ahead(
        &self,
        pair: &Pair,
        axis: &Capsule<D>,
        state: &MotionState<D>,
        turn: Option<&Turn<D>>,
    ) -> Ahead<'_, D> {
        let Self { rate, kept: [usual, share], velocity, coarsened } = *self;
        let kept = pair.margin.of_its_own().map_or(usual, |own| share * own);
        let shift = [axis.start, axis.end()].map(|end| {
            let seen = velocity(pair.link, &end) - state.velocity;
            let Some(turn) = turn else { return seen * (2.0 / rate) };
            let carried = turn.spin.rate_of(&(end - state.position));
            turn.rotation.tr_mul(&(seen - carried)) * (2.0 / rate)
        });
        let [implied, unharmed] = [IMPLIED_UP_TO, UNHARMED_UP_TO].map(|most| most / (rate * rate));
        Ahead { kept, horizon: 2.0 / rate, shift, implied, unharmed, coarsened }
    }
}

impl<const D: usize> Ahead<'_, D> {
    /// How far a point of the axis goes on at most \[m\].
    pub(super) fn farthest(&self) -> f64 {
        self.shift.iter().map(Vector::norm).fold(0.0, f64::max)
    }
}
