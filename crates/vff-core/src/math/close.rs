//! For tests: numbers that are equal but for rounding.

/// `|a − b| ≤ tolerance · max(1, |b|)` in the maximum norm.
#[track_caller]
pub fn assert_close(a: &[f64], b: &[f64], tolerance: f64) {
    assert_eq!(a.len(), b.len());
    let scale = b.iter().fold(1.0, |m: f64, b| m.max(b.abs()));
    for (i, (x, y)) in a.iter().zip(b).enumerate() {
        assert!((x - y).abs() <= tolerance * scale, "[{i}]: {x} against {y} (scale {scale})");
    }
}
