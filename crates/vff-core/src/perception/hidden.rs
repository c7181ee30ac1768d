//! What may be behind the side of a body that is seen (T191): bodies that are not wide are taken for as deep as they are wide.

use super::voxels::VoxelMap;
use crate::math::Vector;
use crate::world::space::perpendicular;

/// A body has so many cells at least.
const LEAST: usize = 3;

/// What is seen of a body, from where a camera stands.
#[derive(Debug, Clone)]
struct Side {
    cells: usize,
    mean: Vector<3>,
    /// Away from the camera, and two axes across.
    axes: [Vector<3>; 3],
    /// Sums of squares and of the product of what is across \[m²\].
    across: [f64; 3],
    /// How far the nearest of it is \[m\].
    near: f64,
}

impl Side {
    /// Half of how wide it is \[m\]: twice the smaller standard deviation of what is seen, as of a disc.
    #[expect(clippy::cast_precision_loss, reason = "a count of cells")]
    fn radius(&self) -> f64 {
        let [a, ab, b] = self.across.map(|sum| sum / self.cells as f64);
        let smaller = 0.5 * (a + b) - (0.5 * (a - b)).hypot(ab);
        2.0 * smaller.max(0.0).sqrt()
    }
}

/// Tells the cells that the present picture has hit how far behind them the body may end, of which there are `count`, seen from `origin`
/// \[m\]: those up to `widest` \[m\]. Not where the arm is.
#[expect(clippy::cast_precision_loss, reason = "a count of cells")]
pub(super) fn bound(
    map: &mut VoxelMap,
    count: usize,
    origin: &Vector<3>,
    widest: f64,
    is_arm: impl Fn(&Vector<3>) -> bool,
) {
    let nothing = Side {
        cells: 0,
        mean: Vector::zeros(),
        axes: [Vector::zeros(); 3],
        across: [0.0; 3],
        near: f64::INFINITY,
    };
    let mut sides = vec![nothing; count];
    let hit = map.voxels().iter().filter(|voxel| voxel.hits > 0);
    let of_bodies = hit.map(|voxel| (voxel.cluster as usize, voxel.point));
    let points: Vec<_> = of_bodies.filter(|(k, _)| *k < count).collect();
    for (k, point) in &points {
        sides[*k].cells += 1;
        sides[*k].mean += point;
    }
    for side in sides.iter_mut().filter(|side| side.cells > 0) {
        side.mean /= side.cells as f64;
        let away = (side.mean - origin).normalize();
        let first = perpendicular(&away);
        side.axes = [away, first, away.cross(&first)];
    }
    for (k, point) in &points {
        let side = &mut sides[*k];
        let [away, first, second] = side.axes;
        let off = point - side.mean;
        let [a, b] = [first.dot(&off), second.dot(&off)];
        let [aa, ab, bb] = side.across;
        side.across = [aa + a * a, ab + a * b, bb + b * b];
        side.near = side.near.min(away.dot(&(point - origin)));
    }
    for voxel in map.voxels_mut().iter_mut().filter(|voxel| voxel.hits > 0) {
        voxel.behind = Vector::zeros();
        let Some(side) = sides.get(voxel.cluster as usize) else { continue };
        let radius = side.radius();
        if side.cells < LEAST || 2.0 * radius > widest {
            continue;
        }
        let away = side.axes[0];
        let behind = 2.0 * (side.near + radius - away.dot(&(voxel.point - origin)));
        let end = voxel.point + away * behind;
        if behind > 0.0 && !is_arm(&end) {
            voxel.behind = end - voxel.point;
        }
    }
}
