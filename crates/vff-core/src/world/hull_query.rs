//! The nearest points of a body that is a hull to every obstacle.

use super::{Carrier, Named, ObstacleGeometry, Pair, Placed, Turn};
use crate::geometry::{Body, PlacedHull};
use crate::math::keep_least;

/// What is done with an obstacle that a body may be near to.
pub(super) type Meet<'a, S, const D: usize> = dyn FnMut(Pair, &Placed<S, D>, Option<&Turn<D>>) + 'a;

/// The distance between the surface of a hull, which the capsule of `around` holds, and the nearest obstacle \[m\], where it is
/// below `limit`. If it is below `reach`, `meet` is called with those that may be, in their order.
///
/// The capsule is never farther from anything than the hull: most obstacles are asked no more. Compiled once a space, whatever `meet`
/// does: what a hull takes is far more than a call.
#[inline(never)]
pub(super) fn near_hull<S: ObstacleGeometry<D>, const D: usize>(
    obstacles: &mut [Placed<S, D>],
    named: &mut Named<S, D>,
    time: f64,
    (index, body, hull): (usize, &Body<'_, D>, &PlacedHull<'_, D>),
    around: &S::Probe,
    [reach, limit]: [f64; 2],
    meet: &mut Meet<'_, S, D>,
) -> f64 {
    let carrier = Carrier::of(body);
    let has_broad_phase = matches!(named, Named::BroadPhase(_));
    let mut within = reach;
    loop {
        let near = match named {
            Named::All => None,
            Named::Each(all) => Some(&all[..]),
            Named::BroadPhase(broad_phase) => {
                Some(broad_phase.near(obstacles, time, carrier, around, within))
            }
        };
        let count = near.map_or(obstacles.len(), <[usize]>::len);
        let all = || (0..count).map(|k| near.map_or(k, |near| near[k]));
        let asked = || all().filter(|&j| !obstacles[j].is_ignored_by(carrier));
        let mut least = f64::INFINITY;
        for j in asked() {
            let (obstacle, bound) = (&obstacles[j], least.min(limit));
            // False where it is undefined.
            let is_farther = obstacle.distance_below(around, bound) >= bound;
            if !is_farther {
                let (state, pair) = (&obstacle.state, obstacle.pair(index, carrier, j));
                let found = obstacle.hull_contact(pair, hull, around, state, obstacle.turn());
                keep_least(&mut least, found.distance);
            }
        }
        // Of a crowd those nearer to the capsule than `within`, or the nearest one: that of the hull is no farther than this.
        if has_broad_phase && least > within && within < limit {
            within = least.min(limit);
            continue;
        }
        if least < reach {
            for j in asked() {
                let obstacle = &obstacles[j];
                let is_far = obstacle.distance_below(around, reach) >= reach;
                if !is_far {
                    meet(obstacle.pair(index, carrier, j), obstacle, obstacle.turn());
                }
            }
        }
        return least + 0.0;
    }
}
