//! What a robot's joints can do.

/// Limits of the joints, each empty where there is none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Limits {
    /// (lower, upper) per joint \[rad, m of one that slides\].
    pub joint: Vec<[f64; 2]>,
    /// Largest speed per joint \[rad/s, m/s\], > 0.
    pub velocity: Vec<f64>,
    /// Largest torque or force per joint \[N·m, N\], > 0.
    pub torque: Vec<f64>,
}
