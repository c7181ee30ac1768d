//! The parts of a robot that must not touch anything.

use super::{Form, Hull};
use crate::math::{Capsule, Vector};
use nalgebra::SMatrix;

/// One of them: a capsule or a hull in the world that a link carries. A link may carry any number.
///
/// # Example
/// ```
/// use nalgebra::Matrix3;
/// use vff_core::geometry::{Body, PlacedHull, Hull};
/// use vff_core::math::Vector;
///
/// let hull = Hull::new(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]).unwrap();
/// let rotation = Matrix3::identity();
/// let carried = PlacedHull { hull: &hull, rotation: &rotation, position: Vector::<3>::zeros() };
/// let body = Body { hull: Some(carried), ..Body::new(2, hull.enclosing()) };
/// assert_eq!(body.reach_from(&Vector::<3>::zeros()), 1.0);
/// ```
///
/// # See also
/// [`StillBody`], which the base carries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body<'a, const D: usize> {
    /// Index of the link that carries it, from 0 at the base.
    pub link: usize,
    /// Its shape, from the end nearer to the base to the one farther away; of a hull a capsule that holds it. A ball has the
    /// length 0 and any unit vector as its direction.
    pub shape: Capsule<D>,
    /// The hull, if it is one.
    pub hull: Option<PlacedHull<'a, D>>,
    /// Whether it is of something that the link carries, not of the link itself.
    pub is_load: bool,
}

impl<'a, const D: usize> Body<'a, D> {
    /// A capsule that is carried by `link`.
    #[inline]
    pub fn new(link: usize, shape: Capsule<D>) -> Self {
        Self { link, shape, hull: None, is_load: false }
    }

    /// The capsule that holds it, which is never farther from anything than the body itself.
    #[inline]
    pub fn enclosing(&self) -> Body<'static, D> {
        Body { link: self.link, shape: self.shape, hull: None, is_load: self.is_load }
    }

    /// What is measured of it.
    #[inline]
    pub(crate) fn form(self) -> Form<'a, D> {
        (self.shape, self.hull)
    }

    /// How far it reaches from `point`, as far as turning about that moves it: of a capsule its axis \[m\].
    pub fn reach_from(&self, point: &Vector<D>) -> f64 {
        let farthest = |most: f64, corner: Vector<D>| most.max((corner - point).norm_squared());
        let squared = match &self.hull {
            None => [self.shape.start, self.shape.end()].into_iter().fold(0.0, farthest),
            Some(hull) => hull.corners().fold(0.0, farthest),
        };
        squared.sqrt()
    }
}

/// A body of the base, which does not move.
///
/// # Example
/// ```
/// use vff_core::geometry::StillBody;
/// use vff_core::math::{Capsule, Vector};
///
/// let pedestal = Capsule::new(Vector::<3>::zeros(), Vector::<3>::new(0.0, 0.0, 0.3), 0.1);
/// assert!(StillBody { shape: pedestal, hull: None }.placed_hull().is_none());
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct StillBody<const D: usize> {
    /// As of a [`Body`], in the world.
    pub shape: Capsule<D>,
    /// The hull, if it is one, and how it is placed in the world.
    pub hull: Option<(Hull<D>, SMatrix<f64, D, D>, Vector<D>)>,
}

impl<const D: usize> StillBody<D> {
    /// The hull where it is.
    #[inline]
    pub fn placed_hull(&self) -> Option<PlacedHull<'_, D>> {
        let (hull, rotation, position) = self.hull.as_ref()?;
        Some(PlacedHull { hull, rotation, position: *position })
    }
}

/// A hull where it is now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlacedHull<'a, const D: usize> {
    /// In its own frame.
    pub hull: &'a Hull<D>,
    /// The axes of that frame, one per column.
    pub rotation: &'a SMatrix<f64, D, D>,
    /// Its origin \[m\].
    pub position: Vector<D>,
}

impl<const D: usize> PlacedHull<'_, D> {
    /// Where a point of its frame is \[m\].
    #[inline]
    pub(crate) fn placed(&self, point: &Vector<D>) -> Vector<D> {
        self.position + self.rotation * point
    }

    /// A point as the hull sees it \[m\].
    #[inline]
    pub(crate) fn seen(&self, point: &Vector<D>) -> Vector<D> {
        self.rotation.tr_mul(&(point - self.position))
    }

    /// Its corners, where they are \[m\].
    pub(crate) fn corners(&self) -> impl Iterator<Item = Vector<D>> {
        self.hull.corners.iter().map(|corner| self.placed(&corner.point))
    }

    /// An edge, where it is: an axis without a radius.
    #[inline]
    pub(crate) fn edge(&self, line: &Capsule<D>) -> Capsule<D> {
        Capsule {
            start: self.placed(&line.start),
            direction: self.rotation * line.direction,
            ..*line
        }
    }
}
