//! What solids of 1 kg/m³ weigh, and how that is distributed.

use super::inertia::Body;
use crate::math::{Capsule, Vector};
use nalgebra::Matrix3;
use std::f64::consts::PI;

/// Of a capsule: a cylinder between two halves of a ball, each of which is as heavy as a ball's half 3/8 of the radius away from
/// where it is cut.
pub(super) fn capsule(&Capsule { start, direction, length, radius: r }: &Capsule<3>) -> Body {
    let (cylinder, ball) = (PI * r * r * length, 4.0 / 3.0 * PI * r * r * r);
    let along = 0.5 * cylinder * r * r + 0.4 * ball * r * r;
    let across = cylinder * (r * r / 4.0 + length * length / 12.0)
        + ball * (0.4 * r * r + 0.375 * length * r + 0.25 * length * length);
    let axis = direction * direction.transpose();
    Body {
        mass: cylinder + ball,
        com: start + direction * (0.5 * length),
        inertia: axis * along + (Matrix3::identity() - axis) * across,
    }
}

/// Of a polyhedron with these faces, the numbers of their corners counter-clockwise from outside: of the tetrahedra between its
/// first corner and its triangles, whose second moments are V/20 (Σ p pᵀ + Σ p Σ pᵀ).
pub(super) fn polyhedron(corners: &[[f64; 3]], faces: &[Vec<usize>]) -> Body {
    let apex = corners.first().map_or_else(Vector::zeros, |p| Vector::from(*p));
    let from_apex = |corner: usize| Vector::<3>::from(corners[corner]) - apex;
    let (mut mass, mut first, mut second) = (0.0, Vector::<3>::zeros(), Matrix3::zeros());
    for ring in faces {
        for i in 2..ring.len() {
            let points = [ring[0], ring[i - 1], ring[i]].map(from_apex);
            let [a, b, c] = &points;
            let volume = a.dot(&b.cross(c)) / 6.0;
            let sum = a + b + c;
            mass += volume;
            first += sum * (volume / 4.0);
            let products = points.iter().map(|p| p * p.transpose()).sum::<Matrix3<f64>>();
            second += (products + sum * sum.transpose()) * (volume / 20.0);
        }
    }
    let com = first / mass;
    second -= com * com.transpose() * mass;
    Body { mass, com: com + apex, inertia: Matrix3::identity() * second.trace() - second }
}
