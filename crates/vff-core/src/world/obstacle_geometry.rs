//! What a space has to offer so that obstacles can live in it.
//!
//! The loop over bodies and obstacles ([`World`](super::World)) is one for all spaces. It knows nothing
//! of shapes: a space brings a description of its obstacles, an [`ObstacleGeometry`] made of it, and a
//! [`Hierarchy`] of boxes for the broad phase.

use super::{Ahead, Contact, Motion, MotionState, Pair, PairMargin, Turn, Turning};
use crate::geometry::PlacedHull;
use crate::math::rotation::NotARotation;
use crate::math::{Capsule, Vector};
use std::collections::BTreeMap;
use std::fmt::Debug;

/// What is said of an obstacle: a shape, where it starts and how it moves.
pub trait Description<const D: usize>: Clone + Debug + Send {
    /// Initial position \[m\].
    fn position(&self) -> Vector<D>;
    /// Puts it elsewhere \[m\].
    fn set_position(&mut self, position: Vector<D>);
    /// Motion from the initial position.
    fn motion(&self) -> &Motion<D>;
    /// How it turns from the orientation that is described; none if it does not.
    fn turning(&self) -> Option<Turning<D>>;
    /// How it is turned, compared with how it is described, where its orientation and its rate are these: an angle \[rad\] and its
    /// rate in the plane, a quaternion `[w, x, y, z]` and an angular velocity in world axes \[rad/s\] in space.
    ///
    /// # Errors
    /// If the quaternion is none.
    ///
    /// # Panics
    /// If there are not as many numbers.
    fn turned(&self, orientation: &[f64], rate: &[f64]) -> Result<Turn<D>, NotARotation>;
    /// Lets it move otherwise.
    fn set_motion(&mut self, motion: Motion<D>);
    /// The links that are not measured against it, by name, and [`LOAD`](super::LOAD) for what the arm carries.
    fn ignored(&self) -> &[String];
    /// What every link keeps from it \[m\], if that is not the usual margin.
    fn margin(&self) -> Option<f64>;
    /// What links keep from it \[m\], by name, and [`LOAD`](super::LOAD), where that is another.
    fn margins(&self) -> &BTreeMap<String, f64>;
    /// How likely it is that something will be there, if it is a possible future; none if it is there.
    fn likelihood(&self) -> Option<f64>;
    /// What that future is called, if it may have several parts.
    fn future(&self) -> Option<&str>;
    /// The key that says something of links, if one does: which may touch it, or what they keep from it.
    fn key_of_links(&self) -> Option<&'static str> {
        if !self.ignored().is_empty() {
            Some("ignore")
        } else if !self.margins().is_empty() {
            Some("margins")
        } else {
            self.margin().map(|_| "margin")
        }
    }
    /// What the link of this name, or [`LOAD`](super::LOAD), keeps from it.
    fn margin_of(&self, link: &str) -> PairMargin {
        let own = self.margins().get(link).copied().or(self.margin());
        own.map_or(PairMargin::USUAL, PairMargin::own)
    }
}

/// The shape of an obstacle made ready for queries, relative to its position and in the orientation that is described. It
/// never changes: where an obstacle turns, it is the body that is turned for the query ([`Turn`](super::Turn)). How long parts
/// that move by themselves have done so, the state of the obstacle says.
///
/// # Example
/// What is said of obstacles, and what is made of them to be asked, for any space:
/// ```
/// use vff_core::geometry::Body;
/// use vff_core::math::Capsule;
/// use vff_core::world::plane::PlanarGeometry;
/// use vff_core::world::space::SpatialGeometry;
/// use vff_core::world::{Asked, CollisionQuery, Description, Hierarchy, ObstacleGeometry, World};
///
/// fn clearance<S: ObstacleGeometry<D>, const D: usize>(obstacles: Vec<S::Obstacle>, link: Capsule<D>) -> f64 {
///     let moving = obstacles.iter().any(|obstacle| !obstacle.motion().is_static());
///     let mut world = World::<S, D>::new(obstacles);
///     if moving {
///         world.update(1.0);
///     }
///     let mut least = f64::INFINITY;
///     world.for_each_pair([Body::new(0, link)], |contact| least = least.min(contact.distance));
///     least
/// }
///
/// let in_the_plane: fn(_, _) -> f64 = clearance::<PlanarGeometry, 2>;
/// let in_space: fn(_, _) -> f64 = clearance::<SpatialGeometry, 3>;
///
/// // What finds those that are near among many, and what may be asked of each.
/// fn boxes<S: ObstacleGeometry<D, Hierarchy = H>, H: Hierarchy<S::Probe, D>, const D: usize>() {}
/// boxes::<SpatialGeometry, vff_core::world::space::Boxes, 3>();
/// boxes::<PlanarGeometry, vff_core::world::plane::Boxes, 2>();
/// assert!(matches!(Asked::Contacts(0.1), Asked::Contacts(reach) if reach == 0.1));
/// ```
pub trait ObstacleGeometry<const D: usize>: Clone + Debug + Send + 'static {
    /// What it is made of.
    type Obstacle: Description<D>;
    /// A body of the robot, made ready once for the questions of all obstacles.
    type Probe: Copy;
    /// What finds those that are near among many.
    type Hierarchy: Hierarchy<Self::Probe, D>;

    /// Values must have been validated; unusable ones do not panic, but distances mean nothing.
    fn new(obstacle: &Self::Obstacle) -> Self;

    /// Makes a body ready.
    fn probe(body: &Capsule<D>) -> Self::Probe;

    /// The body that was made ready.
    fn body(probe: &Self::Probe) -> Capsule<D>;

    /// The signed distance between the surfaces of an obstacle in this state and a body \[m\], bit for bit
    /// that of their [`contact`](Self::contact).
    fn distance(&self, body: &Self::Probe, state: &MotionState<D>) -> f64;

    /// The same where it is less than `limit` \[m\]; otherwise anything that is not.
    #[inline(always)]
    fn distance_below(&self, body: &Self::Probe, state: &MotionState<D>, limit: f64) -> f64 {
        let _ = limit;
        self.distance(body, state)
    }

    /// Where this geometry, which is that of `pair.obstacle`, and the body `pair.body` come nearest.
    fn contact(&self, pair: Pair, body: &Self::Probe, state: &MotionState<D>) -> Contact<D>;

    /// The most contacts that one body can have, 1 or more.
    fn contacts(&self) -> usize {
        1
    }

    /// All contacts with the body nearer than `reach` \[m\]: of a convex geometry the [`contact`](Self::contact), of one that is made
    /// of several that of each, in a fixed order.
    #[inline(always)]
    fn for_each_contact(
        &self,
        pair: Pair,
        body: &Self::Probe,
        state: &MotionState<D>,
        reach: f64,
        mut visit: impl FnMut(&Contact<D>),
    ) {
        let contact = self.contact(pair, body, state);
        if contact.distance < reach {
            visit(&contact);
        }
    }

    /// The most barriers that one body can have.
    fn barriers(&self) -> usize;

    /// All distances that must be kept so that `contact` is, which is one of this pair.
    fn for_each_barrier(
        &self,
        contact: &Contact<D>,
        body: &Self::Probe,
        state: &MotionState<D>,
        visit: impl FnMut(&Contact<D>),
    );

    /// Those of all contacts nearer than `reach` \[m\] that imply the others `ahead` (T157): of a convex geometry the one.
    fn for_each_needed(
        &self,
        pair: Pair,
        body: &Self::Probe,
        state: &MotionState<D>,
        reach: f64,
        ahead: &Ahead<'_, D>,
        visit: impl FnMut(&Contact<D>),
    ) {
        let _ = ahead;
        self.for_each_contact(pair, body, state, reach, visit);
    }

    /// Calls `visit` with what is `asked` of a hull that a body is, `around` which is the capsule that was made ready. Where
    /// links carry no hulls, it is that capsule.
    fn meet_hull(
        &self,
        pair: Pair,
        hull: &PlacedHull<'_, D>,
        around: &Self::Probe,
        state: &MotionState<D>,
        asked: Asked,
        visit: &mut dyn FnMut(&Contact<D>),
    ) {
        let _ = hull;
        match asked {
            Asked::Nearest => visit(&self.contact(pair, around, state)),
            Asked::Contacts(reach) => self.for_each_contact(pair, around, state, reach, visit),
            Asked::Barriers(reach) => {
                self.for_each_contact(pair, around, state, reach, |contact| {
                    self.for_each_barrier(contact, around, state, &mut *visit);
                });
            }
        }
    }

    /// How far a body is at least \[m\], the capsule that was made ready or the hull that it is `around`: never more than their
    /// distance, and less by rounding alone (T194). From `limit` on, anything that is not below; where they overlap, anything that
    /// is negative and not less deep. `plane` is the normal, as the obstacle sees it and towards it, of the plane that told them apart
    /// last, and is asked first; 0 where none is known. What is told is so along the normal that is left there, if one is.
    fn at_least(
        &self,
        hull: Option<&PlacedHull<'_, D>>,
        around: &Self::Probe,
        state: &MotionState<D>,
        limit: f64,
        plane: &mut Vector<D>,
    ) -> f64 {
        let _ = hull;
        self.capsule_at_least(around, state, limit, plane)
    }

    /// The same of a capsule, by its contact where it is near.
    #[doc(hidden)]
    fn capsule_at_least(
        &self,
        around: &Self::Probe,
        state: &MotionState<D>,
        limit: f64,
        plane: &mut Vector<D>,
    ) -> f64 {
        if plane.norm_squared() == 0.0 {
            let distance = self.distance_below(around, state, limit);
            if distance >= limit || self.contacts() != 1 {
                return distance;
            }
        }
        let contact = self.contact(Pair::default(), around, state);
        *plane = -contact.normal;
        contact.distance
    }

    /// The most barriers that one hull can have.
    fn hull_barriers(&self) -> usize {
        self.barriers()
    }

    /// Opposite corners of a box around it, the lower ones first \[m\].
    fn extent(&self) -> [Vector<D>; 2];

    /// How far its surface reaches from its position \[m\].
    fn reach(&self) -> f64;

    /// A speed that none of its parts exceeds by itself, as seen from it \[m/s\]: 0, but of clouds whose points move.
    fn speed(&self) -> f64 {
        0.0
    }

    /// The distance \[m\] from `origin` along the unit vector `direction` to its surface, if that is within
    /// `range`; 0 inside. Parts that move have gone on for `elapsed` \[s\].
    fn cast(
        &self,
        origin: &Vector<D>,
        direction: &Vector<D>,
        range: f64,
        elapsed: f64,
    ) -> Option<f64>;
}

/// What is asked of a hull.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Asked {
    /// The contact that is nearest.
    Nearest,
    /// All contacts nearer than this \[m\].
    Contacts(f64),
    /// All distances that must be kept so that these are, of those nearer than this \[m\].
    Barriers(f64),
}

/// A speed that no point of the surface exceeds \[m/s\]; that of its position, if the surface has no end.
pub fn top_speed<S: ObstacleGeometry<D>, const D: usize>(obstacle: &S::Obstacle) -> f64 {
    let speed = obstacle.motion().top_speed();
    let Some(turning) = obstacle.turning() else { return speed };
    let reach = S::new(obstacle).reach();
    if reach.is_finite() { speed + turning.top_rate() * reach } else { speed }
}

/// Boxes around obstacles, numbered from 0, that are found by where they are. `P` is a body of the robot.
pub trait Hierarchy<P, const D: usize>: Clone + Debug + Send {
    /// Where a body is, made ready for the questions of many boxes.
    type Region;

    /// A box is given by its lower and its upper corner \[m\], each within ±[`HORIZON`](super::HORIZON).
    fn new(boxes: &[[Vector<D>; 2]]) -> Self;

    /// Puts other boxes in place of the present ones; those that are neighbours now are grouped anew if
    /// `regroup`. Does not allocate.
    fn renew(&mut self, boxes: impl Iterator<Item = [Vector<D>; 2]>, regroup: bool);

    /// None for a body that is nowhere, or beyond the horizon.
    fn region(body: &P) -> Option<Self::Region>;

    /// Calls `measure` with every box that comes within `limit` \[m\] of the body's surface, rounding allowed
    /// for; it returns the limit from then on. Returns how many there were.
    fn for_each_within(
        &self,
        region: &Self::Region,
        limit: f64,
        measure: impl FnMut(usize) -> f64,
    ) -> usize;
}
