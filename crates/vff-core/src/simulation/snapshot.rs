//! Everything worth knowing of the closed loop at one instant.

use crate::math::Vector;

/// State, torques and what the field does, at one instant. n joints, task dimension m.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Time [s].
    pub t: f64,
    /// Configuration q [rad], (n).
    pub q: Vec<f64>,
    /// Joint velocity q̇ [rad/s], (n).
    pub dq: Vec<f64>,
    /// Torque that acts from now on [N·m], (n).
    pub tau: Vec<f64>,
    /// Its task part, gravity included [N·m], (n).
    pub tau_task: Vec<f64>,
    /// Its null-space part [N·m], (n).
    pub tau_null: Vec<f64>,
    /// Σ JᵀF of the virtual forces, unprojected [N·m], (n).
    pub tau_vff: Vec<f64>,
    /// Pose of the end effector [m, rad], (m).
    pub x: Vec<f64>,
    /// Its rate [m/s, rad/s], (m).
    pub dx: Vec<f64>,
    /// Reference [m, rad], (m).
    pub x_ref: Vec<f64>,
    /// x − x_ref, (m).
    pub error: Vec<f64>,
    /// Magnitude of the repulsion on each link [N], (n).
    pub force: Vec<f64>,
    /// Signed surface distance from each link to the nearest obstacle [m], (n).
    pub clearance: Vec<f64>,
    /// Positions of the obstacles [m].
    pub obstacles: Vec<Vector<2>>,
    /// Largest acceleration of the end effector by the null-space torque, ‖J M⁻¹ τ_null‖.
    pub null_acceleration: f64,
    /// V_n + U + posture energy [J]: the storage function of the null space (THEORY §2).
    pub null_storage: f64,
    /// What flows into it through damping, task coupling and moving obstacles [W].
    pub null_supply: f64,
    /// Whether the task force was damped because of a singularity.
    pub singular: bool,
}

impl Snapshot {
    /// For n joints, task dimension m and a number of obstacles.
    pub fn new(n: usize, m: usize, obstacles: usize) -> Self {
        let joints = || vec![0.0; n];
        let task = || vec![0.0; m];
        Self {
            t: 0.0,
            q: joints(),
            dq: joints(),
            tau: joints(),
            tau_task: joints(),
            tau_null: joints(),
            tau_vff: joints(),
            x: task(),
            dx: task(),
            x_ref: task(),
            error: task(),
            force: joints(),
            clearance: joints(),
            obstacles: vec![Vector::<2>::zeros(); obstacles],
            null_acceleration: 0.0,
            null_storage: 0.0,
            null_supply: 0.0,
            singular: false,
        }
    }
}
