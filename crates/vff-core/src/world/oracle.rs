//! For the tests of every space.

/// The least value of a convex function on [0, 1], by search.
pub fn least(at: impl Fn(f64) -> f64) -> f64 {
    let (mut low, mut high) = (0.0, 1.0);
    for _ in 0..120 {
        let (a, b) = ((2.0 * low + high) / 3.0, (low + 2.0 * high) / 3.0);
        if at(a) <= at(b) {
            high = b;
        } else {
            low = a;
        }
    }
    at(low).min(at(high)).min(at(0.0)).min(at(1.0))
}
