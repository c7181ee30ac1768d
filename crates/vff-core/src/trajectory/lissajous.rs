//! What the axes of a Lissajous figure do.

use crate::math::sin_cos;

/// `amplitude` · sin(`omega` t + `phase`) and its first and second derivative.
#[inline]
pub(super) fn oscillation(amplitude: f64, omega: f64, phase: f64, t: f64) -> [f64; 3] {
    let (sin, cos) = sin_cos(omega * t + phase);
    let (sin, cos) = (amplitude * sin, amplitude * cos);
    [sin, omega * cos, -omega * omega * sin]
}
