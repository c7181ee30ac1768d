//! Energy of the arm, and the power through every port of the null space (T16, T17, T39).

/// The recorded energies.
pub const ENERGIES: [&str; 3] = ["kinetic", "gravitational", "null_storage"];

/// The recorded ports. `actuators` feeds the whole arm; the others feed `null_storage`, with a
/// positive sign where energy flows in.
pub const PORTS: [&str; 6] = ["actuators", "damping", "task", "obstacles", "approach", "scaling"];

/// Energies of the arm \[J\].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Energy {
    /// T = ½ q̇ᵀM q̇ = ½ ẋᵀΛẋ + ½ νᵀΛ_nν.
    pub kinetic: f64,
    /// The potential energy of gravity.
    pub gravitational: f64,
    /// ½ νᵀΛ_nν + U of the field, of posture and of joint limits: the storage of (T17).
    pub null_storage: f64,
}

impl Energy {
    /// In the order of [`ENERGIES`].
    pub fn values(&self) -> [f64; ENERGIES.len()] {
        [self.kinetic, self.gravitational, self.null_storage]
    }
}

/// Powers through the ports \[W\].
///
/// # Example
/// ```
/// use vff_core::control::{Energy, Power};
///
/// let power = Power { actuators: 2.0, damping: -0.5, ..Power::default() };
/// assert_eq!(power.values()[0], 2.0);
/// assert_eq!(Energy { kinetic: 1.5, ..Energy::default() }.values()[0], 1.5);
/// ```
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Power {
    /// q̇ᵀτ of the motors.
    pub actuators: f64,
    /// −νᵀD_nν ≤ 0.
    pub damping: f64,
    /// −ẋᵀJ#ᵀτ_sec: the motion of the task carries the links through the field.
    pub task: f64,
    /// Σ F·v_obstacle: moving obstacles push.
    pub obstacles: f64,
    /// Σ F_d ḋ ≤ 0: damping of the approach.
    pub approach: f64,
    /// What the energy tank, the torque limits and a posture that yields to a push change.
    pub scaling: f64,
}

impl Power {
    /// In the order of [`PORTS`].
    pub fn values(&self) -> [f64; PORTS.len()] {
        [self.actuators, self.damping, self.task, self.obstacles, self.approach, self.scaling]
    }

    /// What flows into the storage of the null space \[W\].
    pub fn into_null_space(&self) -> f64 {
        self.damping + self.task + self.obstacles + self.approach + self.scaling
    }
}
