//! What a program that keeps distances reckons with, from which follows which of many distances it needs (T157).

use super::{MotionState, Pair, Turn};
use crate::math::{Capsule, Vector};
use std::cell::Cell;

/// Up to this acceleration of the ends of a link, seen from the obstacle, the distances that are kept imply the others \[m/s²\].
const IMPLIED_UP_TO: f64 = 16.0;

/// A distance is left out altogether that no smaller acceleration than this violates \[m/s²\].
const UNHARMED_UP_TO: f64 = 160.0;

/// A point is taken for one that moves from this speed on \[m/s\]; below it the less, the slower it is.
const MOVES: f64 = 0.05;

/// The rates k of barriers \[1/s\], which differ along a plan: it is known to stop in time before what rests, and not before what
/// comes (T201).
///
/// # Example
/// ```
/// use vff_core::world::Rates;
///
/// let rates = Rates { resting: 40.0, moving: 4.0 };
/// assert_eq!([0.0, 1.0].map(|speed| rates.beside(speed)), [40.0, 4.0]);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Of what rests.
    pub resting: f64,
    /// Of what moves.
    pub moving: f64,
}

impl Rates {
    /// The same for all.
    pub fn all(rate: f64) -> Self {
        Self { resting: rate, moving: rate }
    }

    /// Of what has this speed \[m/s\].
    #[inline]
    pub fn beside(&self, speed: f64) -> f64 {
        self.resting + (speed / MOVES).min(1.0) * (self.moving - self.resting)
    }
}

/// Of barriers of the rate k: d + 2ḋ/k + d̈/k² is not to be less than what is kept.
///
/// # Example
/// ```
/// use std::cell::Cell;
/// use vff_core::math::Vector;
/// use vff_core::world::{Ahead, Outlook, Rates};
///
/// let coarsened = Cell::new(0);
/// let still = |_: usize, _: &Vector<3>| Vector::<3>::zeros();
/// let outlook =
///     Outlook { rates: Rates::all(10.0), kept: [0.02, 1.0], velocity: &still, coarsened: &coarsened };
/// let ahead = Ahead::<3> {
///     kept: outlook.kept[0],
///     horizon: 2.0 / outlook.rates.resting,
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
    pub rates: Rates,
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
    /// For a pair, the link of which has this axis, and an obstacle in this state, turned so, no point of which is faster than `speed`
    /// \[m/s\].
    pub(super) fn ahead(
        &self,
        pair: &Pair,
        axis: &Capsule<D>,
        (state, turn): (&MotionState<D>, Option<&Turn<D>>),
        speed: f64,
    ) -> Ahead<'_, D> {
        let Self { rates, kept: [usual, share], velocity, coarsened } = *self;
        let rate = rates.beside(speed);
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
