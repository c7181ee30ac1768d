//! A capsule that holds a hull: what is far from that needs no closer look.

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
        #[expect(clippy::cast_precision_loss, reason = "at most 64")]
        let mean = points.iter().sum::<Vector<3>>() / points.len() as f64;
        let spread: Matrix3<f64> = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum();
        let axes = SymmetricEigen::<f64, nalgebra::Const<3>>::new(spread).eigenvectors;
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
