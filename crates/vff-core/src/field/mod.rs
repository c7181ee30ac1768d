//! Distance → force: the virtual force fields.
//!
//! A field maps the signed surface distance d between a link and an obstacle to a repulsion F(d)
//! along the contact normal. It is the negative slope of a potential U(d) and vanishes at the
//! influence distance. The forces of all link–obstacle pairs add up.

use crate::math::Vector;
use serde::{Deserialize, Serialize};

/// Sine of the angle to the normal at which a link slides with 1/√2 of the full force.
const HEAD_ON: f64 = 0.1;

/// The shape of a field (T27). η is the gain, d_s the influence distance.
///
/// # Example
/// ```
/// use vff_core::field::{Field, FieldKind, Response};
///
/// let at_rim = |kind| Field { kind, gain: 1.0, influence: 0.5, ..Field::OFF }.at(0.5);
/// for kind in [FieldKind::Khatib, FieldKind::Cubic, FieldKind::Bounded] {
///     let Response { potential, force, .. } = at_rim(kind);
///     assert_eq!((potential, force), (0.0, 0.0));
/// }
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum FieldKind {
    /// Khatib's potential U = ½ η (1/d − 1/d_s)², the paper's with its missing square; η \[N·m³\].
    /// C¹ in the force except for its slope at d_s.
    Khatib,
    /// U = ⅓ η (1/d − 1/d_s)³, whose force also starts with slope zero at d_s; η \[N·m⁴\].
    Cubic,
    /// F = η (1 − d/d_s)², never more than η \[N\].
    Bounded,
}

/// A virtual force field.
///
/// ```
/// use vff_core::field::{Field, FieldKind};
///
/// let field = Field { kind: FieldKind::Bounded, gain: 10.0, influence: 0.5, ..Field::OFF };
/// assert_eq!(field.at(0.5).force, 0.0);
/// assert_eq!(field.at(0.0).force, 10.0);
/// assert!((field.at(0.25).force - 2.5).abs() < 1e-12);
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Field {
    /// The shape of the field.
    pub kind: FieldKind,
    /// Gain η, in the unit of the kind; 0 switches the field off.
    pub gain: f64,
    /// Influence distance d_s \[m\], > 0: beyond it there is no force.
    pub influence: f64,
    /// Distance \[m\] below which the force grows linearly, keeping its slope, instead of like 1/d³;
    /// in (0, influence). Default: a tenth of the influence distance. Not for `bounded`.
    #[serde(default)]
    pub floor: Option<f64>,
    /// Damping ratio ζ ≥ 0 of the approach against the obstacle (T30), 0 by default.
    #[serde(default)]
    pub approach_damping: f64,
    /// κ₀ ≥ 0 \[N·s/m\], how strongly links are turned past an obstacle that comes at them (T82), 0 by
    /// default.
    #[serde(default)]
    pub sliding: f64,
}

/// A field at one distance.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Response {
    /// Potential U \[J\].
    pub potential: f64,
    /// Repulsion F = −dU/dd \[N\], ≥ 0.
    pub force: f64,
    /// Stiffness −dF/dd \[N/m\], ≥ 0.
    pub stiffness: f64,
}

impl Field {
    /// A field that is off.
    pub const OFF: Self = Self {
        kind: FieldKind::Khatib,
        gain: 0.0,
        influence: 1.0,
        floor: None,
        approach_damping: 0.0,
        sliding: 0.0,
    };

    /// The distance below which the force is continued linearly \[m\].
    pub fn floor(&self) -> f64 {
        self.floor.unwrap_or(0.1 * self.influence)
    }

    /// The field at the signed surface distance `d` \[m\]; finite for every finite `d`.
    #[inline]
    pub fn at(&self, d: f64) -> Response {
        if d >= self.influence {
            return Response::default();
        }
        match self.kind {
            FieldKind::Khatib => self.continued(d, |d| {
                let near = 1.0 / d;
                let u = near - 1.0 / self.influence;
                Response {
                    potential: 0.5 * u * u,
                    force: u * near * near,
                    stiffness: (near + 2.0 * u) * near * near * near,
                }
            }),
            FieldKind::Cubic => self.continued(d, |d| {
                let near = 1.0 / d;
                let u = near - 1.0 / self.influence;
                Response {
                    potential: u * u * u / 3.0,
                    force: u * u * near * near,
                    stiffness: 2.0 * u * (near + u) * near * near * near,
                }
            }),
            FieldKind::Bounded => self.bounded(d),
        }
    }

    /// The distance \[m\] at which the potential has taken up `energy` \[J\]: how near something comes that
    /// arrives with that much (T29). 0 if it comes to contact.
    pub fn closest_approach(&self, energy: f64) -> f64 {
        let (mut near, mut far) = (0.0, self.influence);
        if self.at(near).potential <= energy {
            return 0.0;
        }
        for _ in 0..60 {
            let middle = 0.5 * (near + far);
            if self.at(middle).potential > energy { near = middle } else { far = middle }
        }
        far
    }

    /// How strongly approach is damped at distance `d`: rises smoothly from 0 at the influence
    /// distance to 1 at the floor.
    #[inline]
    pub fn approach_window(&self, d: f64) -> f64 {
        let s = ((self.influence - d) / (self.influence - self.floor())).clamp(0.0, 1.0);
        s * s * (3.0 - 2.0 * s)
    }

    /// Whether it depends on velocities, too.
    #[inline]
    pub fn feels_motion(&self) -> bool {
        self.approach_damping > 0.0 || self.sliding > 0.0
    }

    /// The force that turns a link past an obstacle at the distance `d`, whose surface it has the
    /// velocity `u` against (T82). It is orthogonal to `u` and thus does no work on the relative motion; 0
    /// while the distance grows.
    pub fn slide<const D: usize>(&self, d: f64, normal: &Vector<D>, u: &Vector<D>) -> Vector<D> {
        let closing = -normal.dot(u);
        if closing <= 0.0 {
            return Vector::zeros();
        }
        let across = u + normal * closing;
        let (speed, lateral) = (u.norm(), across.norm_squared());
        let near = 1.0 - d.max(0.0) / self.influence;
        let strength = self.sliding * near * near * closing / speed;
        let turn = across * closing + normal * lateral;
        turn * (strength / (lateral + (HEAD_ON * speed).powi(2)).sqrt())
    }

    /// `unit`, the field of gain 1, down to the floor; below it, the C¹ continuation (T28) with constant
    /// stiffness, defined for penetration too.
    #[inline]
    fn continued(&self, d: f64, unit: impl Fn(f64) -> Response) -> Response {
        let floor = self.floor();
        let at = unit(d.max(floor));
        let depth = (floor - d).max(0.0);
        Response {
            potential: self.gain * (at.potential + depth * (at.force + 0.5 * depth * at.stiffness)),
            force: self.gain * (at.force + depth * at.stiffness),
            stiffness: self.gain * at.stiffness,
        }
    }

    /// Constant at its bound once the surfaces touch.
    fn bounded(&self, d: f64) -> Response {
        let s = 1.0 - d.max(0.0) / self.influence;
        let third = self.gain * self.influence / 3.0;
        Response {
            potential: third * s * s * s + self.gain * (-d).max(0.0),
            force: self.gain * s * s,
            stiffness: if d > 0.0 { 2.0 * self.gain * s / self.influence } else { 0.0 },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn field(kind: FieldKind) -> Field {
        Field { kind, gain: 2.5, influence: 0.8, ..Field::OFF }
    }

    const KINDS: [FieldKind; 3] = [FieldKind::Khatib, FieldKind::Cubic, FieldKind::Bounded];

    /// F = −dU/dd and k = −dF/dd by central differences, penetration included.
    #[test]
    fn force_and_stiffness_are_derivatives() {
        for kind in KINDS {
            let field = field(kind);
            for k in 0..200 {
                let d = -0.2 + 0.005 * f64::from(k) + 1e-3;
                let h = 1e-6;
                let (low, mid, high) = (field.at(d - h), field.at(d), field.at(d + h));
                let force = (low.potential - high.potential) / (2.0 * h);
                let stiffness = (low.force - high.force) / (2.0 * h);
                assert!((force - mid.force).abs() <= 1e-5 * (1.0 + mid.force), "{kind:?} {d}");
                assert!(
                    (stiffness - mid.stiffness).abs() <= 1e-4 * (1.0 + mid.stiffness),
                    "{kind:?} {d}: {stiffness} {}",
                    mid.stiffness
                );
            }
        }
    }

    /// Khatib's rule 1/d = 1/d_s + v √(m/η), and contact where the field is too weak (T29).
    #[test]
    fn closest_approach_takes_up_the_energy() {
        let khatib = field(FieldKind::Khatib);
        for (m, v) in [(1.0, 0.3), (4.0, 0.1), (0.5, 2.0)] {
            let rule = 1.0 / (1.0 / 0.8 + v * f64::sqrt(m / 2.5));
            assert!((khatib.closest_approach(0.5 * m * v * v) - rule).abs() < 1e-12);
        }
        for kind in KINDS {
            assert_eq!(field(kind).closest_approach(1e9).to_bits(), 0);
        }
    }

    /// Zero at and beyond d_s; d³F/η → 1 as d → 0 for Khatib's.
    #[test]
    fn limits_of_the_distance() {
        for kind in KINDS {
            assert_eq!(field(kind).at(0.8), Response::default());
            assert_eq!(field(kind).at(5.0), Response::default());
            assert!(field(kind).at(0.8 - 1e-9).force < 1e-7);
        }
        let near = Field { floor: Some(1e-9), ..field(FieldKind::Khatib) };
        let d = 1e-6;
        assert!((d * d * d * near.at(d).force / near.gain - 1.0).abs() < 1e-5);
    }

    /// The bounded field never exceeds its gain, the others grow without a jump at the floor.
    #[test]
    fn bounded_is_bounded_and_floor_is_smooth() {
        for k in -100..80 {
            assert!(field(FieldKind::Bounded).at(0.01 * f64::from(k)).force <= 2.5);
        }
        for kind in [FieldKind::Khatib, FieldKind::Cubic] {
            let (below, above) = (field(kind).at(0.08 - 1e-12), field(kind).at(0.08 + 1e-12));
            assert!((below.force / above.force - 1.0).abs() < 1e-9);
            assert!((below.stiffness / above.stiffness - 1.0).abs() < 1e-9);
        }
    }

    /// Of the sliding force (T82): it is orthogonal to the velocity, vanishes at d_s, head on and while the
    /// distance grows, pushes the way the link passes, and never repels less for it.
    #[test]
    fn sliding_turns_the_velocity_and_does_no_work() {
        let field = Field { sliding: 30.0, ..field(FieldKind::Khatib) };
        let rest = Vector::<2>::zeros();
        let normal = Vector::<2>::new(0.6, 0.8);
        let aside = Vector::<2>::new(-0.8, 0.6);
        for k in 0..200 {
            let angle = 0.0314 * f64::from(k) + 0.01;
            let u = (normal * -angle.cos() + aside * angle.sin()) * 0.7;
            let force = field.slide(0.3, &normal, &u);
            assert!(force.dot(&u).abs() <= 1e-14 * force.norm());
            assert!(force.norm() <= 30.0 * (0.5_f64 / 0.8).powi(2) * u.norm());
            assert_eq!(field.slide(0.8, &normal, &u), rest);
            if angle.cos() < 0.0 {
                assert_eq!(force, rest);
            } else {
                assert!(force.dot(&aside) * u.dot(&aside) > 0.0 && force.dot(&normal) > 0.0);
            }
        }
        assert!(field.slide(0.3, &normal, &(normal * -0.5)).norm() < 1e-12);
        assert_eq!(field.slide(0.3, &normal, &rest), rest);
    }

    /// The paper prints U without the square; then F would not be −dU/dd (docs/theory.md, section 10).
    #[test]
    fn the_printed_potential_does_not_give_the_printed_force() {
        let f = field(FieldKind::Khatib);
        let printed = |d: f64| 0.5 * f.gain * (1.0 / d - 1.0 / f.influence);
        let slope = -(printed(0.4 + 1e-6) - printed(0.4 - 1e-6)) / 2e-6;
        assert!((slope - f.at(0.4).force).abs() > 0.1);
    }
}
