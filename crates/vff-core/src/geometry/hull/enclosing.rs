//! A capsule that holds a hull, and a box that holds points: what is far from these needs no closer look.

use super::Hull;
use crate::geometry::perpendicular;
use crate::math::{Capsule, Vector};
use nalgebra::{Matrix3, SymmetricEigen};

/// What rounding may let stick out, relative to the size.
const ROUNDING: f64 = 1e-12;

impl Hull {
    /// A slim capsule around the corners: along one of the axes of their distribution, along the longest way between two, or a
    /// ball.
    pub fn enclosing(&self) -> Capsule<3> {
        let points: Vec<Vector<3>> = self.corners.iter().map(|corner| corner.point).collect();
        let (mean, axes) = distribution(&points);
        let ways =
            points.iter().enumerate().flat_map(|(i, a)| points[..i].iter().map(move |b| a - b));
        let longest = ways.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
        let directions = axes.column_iter().map(|axis| axis.into_owned());
        let directions = directions.chain(longest.map(|way| way.normalize()));
        let (start, radius) = ball(&points, mean);
        let ball = Capsule { start, direction: Vector::<3>::z(), length: 0.0, radius };
        let volume = |c: &Capsule<3>| c.radius * c.radius * (c.length + 4.0 / 3.0 * c.radius);
        let capsules = directions.map(|direction| along(&points, &mean, direction));
        let slim = capsules.fold(ball, |a, b| if volume(&b) < volume(&a) { b } else { a });
        let size = points.iter().map(|p| p.amax()).fold(0.0, f64::max);
        Capsule { radius: slim.radius + ROUNDING * size, ..slim }
    }
}

/// Opposite corners of a box around points along the axes of their frame, the lower ones first \[m\]; around none from ∞ to −∞.
pub(crate) fn extent(points: &[Vector<3>]) -> [Vector<3>; 2] {
    let none = [Vector::repeat(f64::INFINITY), Vector::repeat(f64::NEG_INFINITY)];
    points.iter().fold(none, |[low, high], point| [low.inf(point), high.sup(point)])
}

/// The mean of points, and the axes of their distribution, one per column.
pub(super) fn distribution(points: &[Vector<3>]) -> (Vector<3>, Matrix3<f64>) {
    #[expect(clippy::cast_precision_loss, reason = "at most 10 000")]
    let mean = points.iter().sum::<Vector<3>>() / points.len() as f64;
    let spread = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
    (mean, SymmetricEigen::<f64, nalgebra::Const<3>>::new(spread).eigenvectors)
}

/// The corners of a small box around points: along the axes of their frame, or along those of their distribution.
pub(crate) fn box_around(points: &[Vector<3>]) -> [[f64; 3]; 8] {
    let along = |axes: Matrix3<f64>| {
        let seen: Vec<Vector<3>> = points.iter().map(|p| axes.tr_mul(p)).collect();
        (axes, extent(&seen))
    };
    let (_, axes) = distribution(points);
    let boxes = [Matrix3::identity(), axes].map(along);
    let volume = |(_, [low, high]): &(Matrix3<f64>, [Vector<3>; 2])| (high - low).product();
    let (axes, [low, high]) =
        if volume(&boxes[1]) < volume(&boxes[0]) { boxes[1] } else { boxes[0] };
    let more = Vector::<3>::repeat(ROUNDING * low.amax().max(high.amax()));
    let ends = [low - more, high + more];
    std::array::from_fn(|k| {
        let corner = Vector::<3>::new(ends[k & 1].x, ends[k >> 1 & 1].y, ends[k >> 2].z);
        (axes * corner).into()
    })
}

/// A small ball around points: from their mean towards the farthest, by less and less (Bădoiu and Clarkson, 2003).
fn ball<const D: usize>(points: &[Vector<D>], mut centre: Vector<D>) -> (Vector<D>, f64) {
    for k in 1..=200 {
        let mut farthest = (0.0, centre);
        for p in points {
            let square = (p - centre).norm_squared();
            if square >= farthest.0 {
                farthest = (square, *p);
            }
        }
        centre += (farthest.1 - centre) / f64::from(k + 1);
    }
    let radius = points.iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
    (centre, radius)
}

/// A slim capsule around points, along this direction: around the circle that holds what is seen along it.
fn along(points: &[Vector<3>], mean: &Vector<3>, direction: Vector<3>) -> Capsule<3> {
    let side = perpendicular(&direction);
    let across = direction.cross(&side);
    let seen: Vec<(f64, Vector<2>)> = (points.iter())
        .map(|p| {
            let offset = p - mean;
            let beside = Vector::<2>::new(side.dot(&offset), across.dot(&offset));
            (direction.dot(&offset), beside)
        })
        .collect();
    let beside: Vec<Vector<2>> = seen.iter().map(|p| p.1).collect();
    let (centre, radius) = ball(&beside, Vector::zeros());
    let room = |p: &Vector<2>| (radius * radius - (p - centre).norm_squared()).max(0.0).sqrt();
    let low = seen.iter().map(|(at, p)| at + room(p)).fold(f64::INFINITY, f64::min);
    let high = seen.iter().map(|(at, p)| at - room(p)).fold(f64::NEG_INFINITY, f64::max);
    // Where a ball is enough, its centre is anywhere between.
    let (low, length) = if high > low { (low, high - low) } else { (0.5 * (low + high), 0.0) };
    let start = mean + direction * low + side * centre.x + across * centre.y;
    Capsule { start, direction, length, radius }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::cases::{any_vertices, corners_of};
    use proptest::prelude::*;

    /// Of a rod it is the rod with its ends, of a cube nearly the ball through its corners; of both it is known how small the
    /// smallest is.
    #[test]
    fn it_is_slim() {
        let around = |size| Hull::new(&corners_of(size)).unwrap().enclosing();
        let rod = around([0.1, 1.0, 0.1]);
        assert!((rod.radius - 0.05 * 2f64.sqrt()).abs() < 1e-3, "{rod:?}");
        assert!((rod.length - 1.0).abs() < 1e-2 && rod.direction.y.abs() > 0.999, "{rod:?}");
        let ball = around([0.1; 3]);
        assert!((ball.radius - 0.05 * 3f64.sqrt()).abs() < 1e-9 && ball.length == 0.0, "{ball:?}");
    }

    properties! {
        /// All points are in the box, and none of its sides can be moved in.
        #[test]
        fn the_box_holds_all_and_no_more(
            points in prop::collection::vec([-0.5..0.5, -0.1..0.1, -0.2..0.4], 6..40),
            away in [-2.0..2.0, -2.0..2.0, -2.0..2.0],
        ) {
            let points: Vec<Vector<3>> =
                points.iter().map(|p| Vector::from(*p) + Vector::from(away)).collect();
            let hull = Hull::new(&box_around(&points)).unwrap();
            prop_assert_eq!(hull.faces.len(), 6);
            for face in hull.faces.iter() {
                let out = |p: &Vector<3>| face.normal.dot(p) - face.offset;
                let most = points.iter().map(out).fold(f64::NEG_INFINITY, f64::max);
                prop_assert!((-1e-10..=0.0).contains(&most), "{}", most);
            }
        }

        /// Nothing sticks out, not even by rounding.
        #[test]
        fn it_holds_the_corners(vertices in any_vertices()) {
            let capsule = Hull::new(&vertices).unwrap().enclosing();
            for p in vertices {
                let p = Vector::from(p);
                prop_assert!((capsule.clamp(&p) - p).norm() <= capsule.radius);
            }
        }
    }
}
