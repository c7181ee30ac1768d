//! The corner of a hull that is farthest along a direction: what a search for a plane between two hulls asks most.
//!
//! Directions fall into the cells of a cube around the origin. In each of them few corners can be the farthest, and these are known
//! beforehand: the others are behind one of them along every direction of the cell, as they are along its four edges. Cells are halved
//! again and again, and of each half only those are looked at that are left in the whole.

use super::{Corner, Hull};
use crate::math::Vector;
use std::sync::Arc;

/// Cells along an edge of the cube, a power of two.
const CELLS: usize = 4;
/// How far a cell reaches into the next ones, for what rounding makes of a direction.
const BEYOND: f64 = 1e-6;
/// What rounding may make of how far ahead a corner is, in parts of the largest coordinate.
const ROUNDING: f64 = 1e-13;

/// Which corners may be the farthest.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Farthest {
    /// Where the corners are: close together, as they are asked for all the time.
    points: Arc<[Vector<3>]>,
    cells: Cells,
}

/// The numbers of those that may be the farthest, by cell.
#[derive(Debug, Clone, PartialEq)]
struct Cells {
    /// Where those of each cell begin, one cell after the other, and where the last ends.
    begins: Arc<[u16]>,
    /// Ascending in each cell.
    corners: Arc<[u8]>,
}

impl Cells {
    fn of(&self, cell: usize) -> &[u8] {
        let [from, to] = [cell, cell + 1].map(|k| usize::from(self.begins[k]));
        &self.corners[from..to]
    }

    /// Those of a cube with `along` cells along an edge, of which a whole of two by two had these.
    fn halved(&self, along: usize, points: &[Vector<3>], slack: f64) -> Self {
        let (mut begins, mut corners) = (vec![0], vec![]);
        let mut ahead: Vec<[f64; 4]> = vec![];
        for cell in 0..6 * along * along {
            let (edges, whole) = (edges_of(cell, along), self.of(whole_of(cell, along)));
            ahead.clear();
            for k in whole {
                let point = &points[usize::from(*k)];
                let [a, b, c, d] = &edges;
                ahead.push([a.dot(point), b.dot(point), c.dot(point), d.dot(point)]);
            }
            let leaders: [Option<&[f64; 4]>; 4] = std::array::from_fn(|k| {
                ahead.iter().reduce(|a: &[f64; 4], b| if b[k] > a[k] { b } else { a })
            });
            let is_behind = |own: &[f64; 4]| {
                let is_before =
                    |leader: &[f64; 4]| leader.iter().zip(own).all(|(far, own)| *far > own + slack);
                leaders.into_iter().flatten().any(is_before)
            };
            corners.extend(
                whole.iter().zip(&ahead).filter(|(_, own)| !is_behind(own)).map(|(k, _)| *k),
            );
            begins.push(u16::try_from(corners.len()).expect("6144 at most"));
        }
        Self { begins: begins.into(), corners: corners.into() }
    }
}

impl Farthest {
    /// Of `corners`, at most as many as a hull may have.
    pub fn of(corners: &[Corner<3>]) -> Self {
        let points: Arc<[Vector<3>]> = corners.iter().map(|corner| corner.point).collect();
        let slack = ROUNDING * points.iter().fold(0.0, |most: f64, point| most.max(point.amax()));
        let all: Vec<u8> = (0u8..).zip(points.iter()).map(|(k, _)| k).collect();
        let count = u16::try_from(all.len()).expect("64 at most");
        let mut cells = Cells { begins: [0, count].into(), corners: all.into() };
        let mut along = 1;
        while along <= CELLS {
            cells = cells.halved(along, &points, slack);
            along *= 2;
        }
        Self { points, cells }
    }
}

/// Side of the cube and place on it of a cell, of `along` along an edge.
fn place_of(cell: usize, along: usize) -> [usize; 3] {
    let place = cell % (along * along);
    [cell / (along * along), place / along, place % along]
}

/// The cell of a cube with half as many cells along an edge in which one lies; the only one of the whole cube.
fn whole_of(cell: usize, along: usize) -> usize {
    let ([side, u, v], half) = (place_of(cell, along), along / 2);
    if along == 1 { 0 } else { (side * half + u / 2) * half + v / 2 }
}

/// Directions along the edges of a cell: all others in it are sums of them.
#[expect(clippy::cast_precision_loss, reason = "small numbers")]
fn edges_of(cell: usize, along: usize) -> [Vector<3>; 4] {
    let [side, u, v] = place_of(cell, along);
    let axis = side / 2;
    let at = |k: usize| 2.0 * k as f64 / along as f64 - 1.0;
    let ends = |k: usize| [at(k) - BEYOND, at(k + 1) + BEYOND];
    let [us, vs] = [u, v].map(ends);
    [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(i, j)| {
        let mut edge = Vector::zeros();
        edge[axis] = if side.is_multiple_of(2) { 1.0 } else { -1.0 };
        edge[(axis + 1) % 3] = us[i];
        edge[(axis + 2) % 3] = vs[j];
        edge
    })
}

/// The cell of a direction; any where it has none.
#[inline]
fn cell_of(direction: &Vector<3>) -> usize {
    let axis = direction.iamax();
    let along = direction[axis];
    let scale = 0.5 * CELLS as f64 / along.abs();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the cube")]
    let place = |k: usize| {
        let at = direction[(axis + k) % 3] * scale + 0.5 * CELLS as f64;
        (at as usize).min(CELLS - 1)
    };
    let side = 2 * axis + usize::from(along < 0.0);
    (side * CELLS + place(1)) * CELLS + place(2)
}

impl Hull {
    /// The number of its corner that is farthest along a direction, the first of several.
    #[inline]
    pub(crate) fn farthest_corner(&self, direction: &Vector<3>) -> usize {
        let Farthest { points, cells } = &self.farthest;
        let (mut most, mut best) = (f64::NEG_INFINITY, 0);
        for number in cells.of(cell_of(direction)) {
            let ahead = direction.dot(&points[usize::from(*number)]);
            if ahead > most {
                (most, best) = (ahead, usize::from(*number));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cases::{any_vertices, directions};
    use proptest::prelude::*;

    fn is_the_first(hull: &Hull, along: &Vector<3>) -> bool {
        let ahead: Vec<f64> = hull.corners.iter().map(|c| along.dot(&c.point)).collect();
        let most = ahead.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        ahead.iter().position(|ahead| *ahead >= most) == Some(hull.farthest_corner(along))
    }

    properties! {
        /// None is farther, and of the ones as far it is the first: along any direction, those between two cells, and those
        /// along which a face lies.
        #[test]
        fn none_is_farther(
            vertices in any_vertices(), away in [-9.0..9.0, -9.0..9.0, -9.0..9.0],
            along in [-1.0..1.0, -1.0..1.0, -1.0..1.0], lattice in [-4i8..5, -4i8..5, -4i8..5],
        ) {
            for by in [Vector::zeros(), Vector::from(away)] {
                let moved: Vec<[f64; 3]> =
                    vertices.iter().map(|p| (Vector::from(*p) + by).into()).collect();
                let Ok(hull) = Hull::new(&moved) else { continue };
                let between = Vector::from(lattice.map(f64::from));
                let faces = hull.faces.iter().flat_map(|face| [face.normal, -face.normal]);
                for along in faces.chain([along.into(), Vector::<3>::z(), between]) {
                    prop_assert!(along.norm() == 0.0 || is_the_first(&hull, &along), "{along}");
                }
            }
        }
    }

    /// Of the most corners that there may be, few are asked.
    #[test]
    fn few_may_be_the_farthest() {
        let ball: Vec<[f64; 3]> = directions(64).map(Into::into).collect();
        let hull = Hull::new(&ball).unwrap();
        assert!(directions(5000).all(|along| is_the_first(&hull, &along)));
        let Cells { begins, corners } = &hull.farthest.cells;
        assert!(corners.len() < 8 * (begins.len() - 1), "{}", corners.len());
    }
}
