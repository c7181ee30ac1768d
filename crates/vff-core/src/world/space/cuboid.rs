//! An axis and a box.

use super::axis::{Nearest, PARALLEL, Probe, across, across_normal, within};
use crate::math::Vector;
use crate::world::{Feature, TOUCHING};
use nalgebra::Matrix3;

/// A box around the obstacle's position.
#[derive(Debug, Clone)]
pub(super) struct Cuboid {
    /// Its axes as columns.
    pub(super) axes: Matrix3<f64>,
    /// Half the lengths of its edges \[m\].
    pub(super) half: Vector<3>,
}

/// The nearest point of an axis, in the frame of the box.
struct Found {
    distance: f64,
    /// Where on the axis \[m\].
    along: f64,
    /// What of the box, and a vector from there to the axis or a normal.
    part: Part,
}

/// What is nearest of the box.
enum Part {
    /// A side. With its normal.
    Side(Vector<3>),
    /// An edge along the axis with this number.
    Edge(usize, Vector<3>),
    Corner(Vector<3>),
    /// The edges along the axis with this number, for one that overlaps the box. With a unit vector across both.
    Across(usize, Vector<3>),
}

/// d × e_k.
#[inline(always)]
fn cross(d: &Vector<3>, k: usize) -> Vector<3> {
    match k {
        0 => Vector::<3>::new(0.0, d.z, -d.y),
        1 => Vector::<3>::new(-d.z, 0.0, d.x),
        _ => Vector::<3>::new(d.y, -d.x, 0.0),
    }
}

impl Cuboid {
    /// A link as the box sees it.
    #[inline(always)]
    pub(super) fn turned(&self, axis: &Probe) -> Probe {
        let turn = |v: &Vector<3>| self.axes.tr_mul(v);
        Probe { start: turn(&axis.start), direction: turn(&axis.direction), ..*axis }
    }

    /// The box's axis number `k` in the world.
    pub(super) fn axis(&self, k: usize) -> Vector<3> {
        self.axes.column(k).into_owned()
    }

    /// How far `point` lies beyond the sides, along each axis of the box.
    #[inline(always)]
    pub(super) fn excess(&self, point: &Vector<3>) -> Vector<3> {
        point.zip_map(&self.half, |x, half| x - x.max(-half).min(half))
    }

    /// Signed distance of an axis.
    #[inline(never)]
    pub(super) fn nearest(&self, axis: &Probe) -> Nearest {
        let local = self.turned(axis);
        let Found { distance, along, part } = self.find(&local);
        let inside = 0.0 < along && along < axis.length;
        let (normal, feature) = match part {
            Part::Side(normal) => (normal, Feature::Face),
            Part::Edge(k, between) => {
                let (edge, cross) = (self.axis(k), cross(&local.direction, k));
                if !inside {
                    (between / between.norm(), Feature::Edge { edge, distance })
                } else if cross.norm() > PARALLEL {
                    let normal = across_normal(&cross, &between);
                    (normal, Feature::Crossing { edge, distance })
                } else {
                    (across_normal(&cross, &between), Feature::Side { distance })
                }
            }
            Part::Across(k, normal) if cross(&local.direction, k).norm() > PARALLEL => {
                (normal, Feature::Crossing { edge: self.axis(k), distance })
            }
            Part::Across(_, normal) => (normal, Feature::Face),
            Part::Corner(between) => {
                let feature =
                    if inside { Feature::Side { distance } } else { Feature::End { distance } };
                (between / between.norm(), feature)
            }
        };
        let point = axis.start + axis.direction * along;
        Nearest { distance, normal: self.axes * normal, point, feature }
    }

    /// The distance of [`nearest`](Self::nearest), bit for bit.
    #[inline(never)]
    pub(super) fn distance(&self, axis: &Probe) -> f64 {
        self.find(&self.turned(axis)).distance
    }

    /// Along the axis the squared distance is convex, once differentiable and quadratic between the places where the axis
    /// passes through the plane of a side: its slope, at these, says between which of them it is least (T94).
    #[inline(always)]
    fn find(&self, axis: &Probe) -> Found {
        let Probe { start: p, direction: d, length, .. } = *axis;
        let (mut low, mut high) = (0.0, length);
        for k in 0..3 {
            for side in [-self.half[k], self.half[k]] {
                let s = (side - p[k]) / d[k];
                // False for sides that the axis is parallel to.
                if low < s && s < high {
                    if d.dot(&self.excess(&(p + d * s))) < 0.0 {
                        low = s;
                    } else {
                        high = s;
                    }
                }
            }
        }
        // Between those, the same sides are passed everywhere.
        let middle = self.excess(&(p + d * (0.5 * (low + high))));
        let beyond = middle.map(|x| f64::from(u8::from(x != 0.0)));
        let side = self.half.zip_map(&middle, f64::copysign);
        let offset = (p - side).component_mul(&beyond);
        let towards = d.component_mul(&beyond);
        let curvature = towards.norm_squared();
        let least = -towards.dot(&offset) / curvature;
        let along = if curvature > 0.0 { least.max(low).min(high) } else { low };
        let between = offset + towards * along;
        let sides = beyond.sum();
        let gap = between.norm();
        if gap <= TOUCHING {
            return self.way_out(axis);
        }
        if sides > 2.0 {
            return Found { distance: gap, along, part: Part::Corner(between) };
        }
        if sides < 2.0 {
            return Found { distance: gap, along, part: Part::Side(between / gap) };
        }
        let k = beyond.imin();
        let inside = 0.0 < along && along < length;
        let distance = if inside { across(&cross(&d, k), &between) } else { gap };
        Found { distance, along, part: Part::Edge(k, between) }
    }

    /// The shortest way out for an axis that overlaps the box: through the side or across the edges, of all that the sum
    /// of both bodies has, along whose normal the least is to go (T95).
    #[inline(never)]
    fn way_out(&self, axis: &Probe) -> Found {
        let Probe { start: p, direction: d, length, .. } = *axis;
        let end = p + d * length;
        let mut best = Found { distance: f64::NEG_INFINITY, along: 0.0, part: Part::Side(p) };
        for k in 0..3 {
            for sign in [1.0, -1.0] {
                let (at_start, at_end) = (sign * p[k], sign * end[k]);
                let (lower, along) =
                    if at_end < at_start { (at_end, length) } else { (at_start, 0.0) };
                let distance = lower - self.half[k];
                if distance > best.distance {
                    let mut normal = Vector::zeros();
                    normal[k] = sign;
                    best = Found { distance, along, part: Part::Side(normal) };
                }
            }
        }
        for k in 0..3 {
            let cross = cross(&d, k);
            let sin = cross.norm();
            // A link of length 0 has no direction. An axis along an edge crosses none.
            if sin <= f64::MIN_POSITIVE || length <= 0.0 {
                continue;
            }
            let height = cross.dot(&p) / sin;
            let normal = cross * (1f64.copysign(height) / sin);
            let distance = height.abs() - normal.abs().dot(&self.half);
            if distance > best.distance {
                // The foot of the edge that is supporting along the normal.
                let mut offset = self.half.zip_map(&normal, f64::copysign) - p;
                offset[k] = 0.0;
                let along = within(d.dot(&offset) / (sin * sin), length);
                best = Found { distance, along, part: Part::Across(k, normal) };
            }
        }
        best
    }
}
