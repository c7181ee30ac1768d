//! What depends on (q, q̇) at one joint and at the tool.

use super::algebra::{Inertia, Spatial};
use crate::math::Vector;
use nalgebra::Matrix3;

/// What depends on (q, q̇) at one joint and its link, in world axes about the base.
#[derive(Debug, Clone, Copy)]
pub(super) struct Joint {
    /// cos and sin of the joint's angle.
    pub turn: [f64; 2],
    /// Axes of the link's aligned frame, and its origin.
    pub rotation: Matrix3<f64>,
    pub position: Vector<3>,
    /// The joint's unit twist s and its rate ṡ = V × s.
    pub s: Spatial,
    pub s_rate: Spatial,
    /// Twist of the link, and its rate while q̈ = 0.
    pub velocity: Spatial,
    pub acceleration: Spatial,
    pub inertia: Inertia,
    /// Factorisation of M: U/D and 1/D (T88).
    pub u: Spatial,
    pub d_inv: f64,
}

impl Joint {
    pub const ZERO: Self = Self {
        turn: [1.0, 0.0],
        rotation: Matrix3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
        position: Vector::<3>::new(0.0, 0.0, 0.0),
        s: Spatial::ZERO,
        s_rate: Spatial::ZERO,
        velocity: Spatial::ZERO,
        acceleration: Spatial::ZERO,
        inertia: Inertia::ZERO,
        u: Spatial::ZERO,
        d_inv: 0.0,
    };
}

/// Where the tool is and how it moves, about the base.
#[derive(Debug, Clone, Copy)]
pub(super) struct Tool {
    /// Its axes in the world.
    pub rotation: Matrix3<f64>,
    pub position: Vector<3>,
    /// Velocity of its origin.
    pub velocity: Vector<3>,
}
