//! What a robot's joints can do.

/// Limits of the joints, each empty where there is none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Limits {
    /// (lower, upper) \[rad\] per joint.
    pub joint: Vec<[f64; 2]>,
    /// Largest speed \[rad/s\] per joint, > 0.
    pub velocity: Vec<f64>,
    /// Largest torque \[N·m\] per joint, > 0.
    pub torque: Vec<f64>,
}
