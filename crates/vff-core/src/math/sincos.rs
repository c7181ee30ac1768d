//! Sine and cosine together, without a branch.
//!
//! The C library's takes a tenth of a whole closed-loop step at n = 6. This one reduces the angle
//! by Cody and Waite's method (π/2 split in three parts, the first two of 33 bits) and evaluates
//! both minimax polynomials of Sun's fdlibm on \[−π/4, π/4\]; its error stays below one unit in the
//! last place of the larger result.

use std::f64::consts::FRAC_2_PI;
use wide::bytemuck::cast;
use wide::{f64x2, u64x2};

/// Beyond this the reduction would lose digits.
const LIMIT: f64 = 1e5;
/// 1.5·2⁵²: adding it rounds to an integer, which then stands in the lowest bits.
const ROUND: f64 = 6_755_399_441_055_744.0;
const PI_2: [f64; 3] =
    [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];
const SIN: [f64; 6] = [
    -1.666_666_666_666_663_2e-1,
    8.333_333_333_322_49e-3,
    -1.984_126_982_985_795e-4,
    2.755_731_370_707_006_8e-6,
    -2.505_076_025_340_686_3e-8,
    1.589_690_995_211_55e-10,
];
const COS: [f64; 6] = [
    4.166_666_666_666_66e-2,
    -1.388_888_888_887_411e-3,
    2.480_158_728_947_673e-5,
    -2.755_731_435_139_066_3e-7,
    2.087_572_321_298_175e-9,
    -1.135_964_755_778_819_5e-11,
];

/// `(sin x, cos x)`.
#[inline]
pub fn sin_cos(x: f64) -> (f64, f64) {
    if x.abs() <= LIMIT {
        let (sin, cos) = reduced(f64x2::splat(x));
        (sin.to_array()[0], cos.to_array()[0])
    } else {
        x.sin_cos()
    }
}

/// `[cos x, sin x]` of two angles, bit for bit as [`sin_cos`] of each, for the price of one.
#[inline]
pub fn unit_vectors(x: f64, y: f64) -> [[f64; 2]; 2] {
    if (x.abs() <= LIMIT) & (y.abs() <= LIMIT) {
        let (sin, cos) = reduced(f64x2::new([x, y]));
        f64x2::transpose([cos, sin]).map(f64x2::to_array)
    } else {
        large(x, y)
    }
}

#[cold]
#[inline(never)]
fn large(x: f64, y: f64) -> [[f64; 2]; 2] {
    [x, y].map(sin_cos).map(|(sin, cos)| [cos, sin])
}

#[inline(always)]
fn reduced(x: f64x2) -> (f64x2, f64x2) {
    let rounded = x * FRAC_2_PI + ROUND;
    let quadrant: u64x2 = cast(rounded);
    let k = rounded - ROUND;
    let r = ((x - k * PI_2[0]) - k * PI_2[1]) - k * PI_2[2];

    let z = r * r;
    let z2 = z * z;
    let odd = (z * SIN[1] + SIN[0]) + z2 * ((z * SIN[3] + SIN[2]) + z2 * (z * SIN[5] + SIN[4]));
    let even = (z * COS[1] + COS[0]) + z2 * ((z * COS[3] + COS[2]) + z2 * (z * COS[5] + COS[4]));
    let sin = r + r * z * odd;
    let half = z * 0.5;
    let cos = f64x2::splat(1.0) - half;
    let cos = cos + ((f64x2::splat(1.0) - cos - half) + z2 * even);

    // Odd quadrants swap the two; the signs follow from the quadrant's second bit.
    let one = u64x2::splat(1);
    let swap = u64x2::splat(0) - (quadrant & one);
    let (s, c): (u64x2, u64x2) = (cast(sin), cast(cos));
    let exchange = (s ^ c) & swap;
    let sign = |q: u64x2| (q & u64x2::splat(2)) << 62;
    (cast(s ^ exchange ^ sign(quadrant)), cast(c ^ exchange ^ sign(quadrant + one)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(x: f64) -> Result<(), TestCaseError> {
        let ((s, c), (sin, cos)) = (sin_cos(x), x.sin_cos());
        prop_assert!((s - sin).abs() <= 1.2e-16 && (c - cos).abs() <= 1.2e-16, "{x}: {s} {c}");
        // Small results keep their relative accuracy, too.
        prop_assert!((s - sin).abs() <= 3e-16 * sin.abs().max(1e-20), "{x}: {s} {sin}");
        prop_assert!((c - cos).abs() <= 3e-16 * cos.abs().max(1e-20), "{x}: {c} {cos}");
        Ok(())
    }

    properties! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        /// Against the C library, within one unit in the last place.
        #[test]
        fn agrees_with_the_c_library(x in prop_oneof![-7.0..7.0, -300.0..300.0, -2e5..2e5, -1e-3..1e-3]) {
            check(x)?;
        }
    }

    /// As one by one, also beside an angle that is too large.
    #[test]
    fn two_at_once() {
        for k in 0..9 {
            for other in [0.3, -7.0, 2e5, f64::INFINITY, f64::NAN] {
                let x = 1.7 * f64::from(k) - 3.0;
                for [x, y] in [[x, other], [other, x]] {
                    let alone = [x, y].map(sin_cos).map(|(sin, cos)| [cos, sin]);
                    let bits = |pair: [[f64; 2]; 2]| pair.map(|x| x.map(f64::to_bits));
                    assert_eq!(bits(unit_vectors(x, y)), bits(alone), "{x} {y}");
                }
            }
        }
    }

    /// The quadrant boundaries and their neighbours, zero, and what is not a number.
    #[test]
    fn special_angles() {
        for k in -200..200 {
            let x = f64::from(k) * std::f64::consts::FRAC_PI_4;
            for x in [x, x.next_up(), x.next_down()] {
                let ((s, c), (sin, cos)) = (sin_cos(x), x.sin_cos());
                assert!((s - sin).abs() <= 1.2e-16 && (c - cos).abs() <= 1.2e-16, "{x}");
            }
        }
        assert_eq!(sin_cos(0.0), (0.0, 1.0));
        assert!(sin_cos(f64::NAN).0.is_nan() && sin_cos(f64::INFINITY).1.is_nan());
    }
}
