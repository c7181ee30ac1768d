//! What a robot's joints can do.

/// Limits of the joints, each empty where there is none.
///
/// # Example
/// ```
/// use vff_core::robot::Limits;
///
/// let limits = Limits { joint: vec![[-1.0, 1.0]], velocity: vec![2.0], torque: vec![] };
/// assert_eq!(limits.kept_angles(0, 0.01), Some([-0.99, 0.99]));
/// ```
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Limits {
    /// (lower, upper) per joint \[rad, m of one that slides\].
    pub joint: Vec<[f64; 2]>,
    /// Largest speed per joint \[rad/s, m/s\], > 0.
    pub velocity: Vec<f64>,
    /// Largest torque or force per joint \[N·m, N\], > 0.
    pub torque: Vec<f64>,
}

impl Limits {
    /// Where joint `i` is kept \[rad, m\]: so far from its stops, or a hundredth of its range where that is less. None without
    /// stops.
    pub fn kept_angles(&self, i: usize, reserve: f64) -> Option<[f64; 2]> {
        let [low, high] = *self.joint.get(i)?;
        let kept = reserve.min(0.01 * (high - low));
        Some([low + kept, high - kept])
    }
}
