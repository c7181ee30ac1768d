//! THE LAW: recursive, basis-free, on operators (THEORY §2–3; docs/theory.md).
//!
//! ```text
//! τ = g + Jᵀ(Λ ẍ_c + S q̇)  −  Nᵀ Sᵀ ẋ  +  Nᵀ(τ_sec − D_q N q̇),      S = J#ᵀC − Λ J̇
//! ```
//!
//! The end effector then obeys ẍ = ẍ_c + J M⁻¹ τ_ext exactly, and the null space is a passive
//! impedance, Λ_n ν̇ + (μ_nn + D_n) ν = Zᵀ(τ_sec + τ_ext).

use super::{Gains, OperationalSpace, Projection, dot};
use crate::robot::Robot;
use nalgebra::{SMatrix, SVector};

/// Joint torques of one evaluation [N·m].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Torque {
    /// What the motors get: `task + null`.
    pub total: Vec<f64>,
    /// `g + Jᵀf`: gravity and the task force.
    pub task: Vec<f64>,
    /// `Nᵀy`: what acts in the null space.
    pub null: Vec<f64>,
}

impl Torque {
    /// Zero torque for `n` joints.
    pub fn zeros(n: usize) -> Self {
        Self { total: vec![0.0; n], task: vec![0.0; n], null: vec![0.0; n] }
    }

    /// Takes over the values of another torque without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        self.total.copy_from_slice(&other.total);
        self.task.copy_from_slice(&other.task);
        self.null.copy_from_slice(&other.null);
    }
}

/// The law with its workspace.
#[derive(Debug, Clone)]
pub struct Law {
    /// The result of the last evaluation.
    pub torque: Torque,
    /// (N q̇)ᵀ D_q N q̇ [W].
    pub damping_power: f64,
    v: Vec<f64>,
    w: Vec<f64>,
}

impl Law {
    /// For `n` joints.
    pub fn new(n: usize) -> Self {
        Self { torque: Torque::zeros(n), damping_power: 0.0, v: vec![0.0; n], w: vec![0.0; n] }
    }

    /// The torque that gives the task the acceleration `ddx_c` and the null space `tau_sec`.
    pub fn evaluate<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        gains: &Gains<M>,
        ddx_c: &SVector<f64, M>,
        tau_sec: &[f64],
    ) {
        let Self { torque, damping_power, v, w } = self;
        let (dq, y) = (robot.velocity(), &mut torque.null);
        let momentum = space.lambda * space.dx; // Λ ẋ

        // Task force  f = Λ (ẍ_c + J M⁻¹ C q̇ − J̇ q̇)                                   (eq. 16–20)
        robot.coriolis_mul(dq, v);
        let f = space.lambda_damped * (ddx_c + space.response(v) - robot.jacobian_dot_mul(dq));
        robot.jacobian_tr_mul(&f, v);
        robot.gravity_torque(&mut torque.task);
        add(&mut torque.task, v); // τ_task = g + Jᵀ f

        // Coupling  y = −Sᵀẋ = J̇ᵀ Λẋ − Cᵀ J#ẋ                                         (μ_nx)
        space.pinv_mul(&space.dx, v); // J#ẋ
        robot.coriolis_tr_mul(v, w);
        robot.jacobian_dot_tr_mul(&momentum, y);
        sub(y, w);

        // Null-space impedance  y += τ_sec − D_q N q̇,  D_q = √d M √d                   (eq. 22–23)
        let root_d = &gains.sqrt_null_damping;
        for ((v, dq), d) in v.iter_mut().zip(dq).zip(root_d) {
            *v = d * (dq - *v); // √d N q̇
        }
        robot.mass_mul(v, w);
        *damping_power = dot(v, w);
        for (((y, sec), w), d) in y.iter_mut().zip(tau_sec).zip(&*w).zip(root_d) {
            *y += sec - d * w;
        }

        // Projection  τ_null = Nᵀ y                                                      (eq. 6)
        let leak = match gains.projection {
            Projection::Dynamic => space.pinv_tr_mul(y), // Λ J M⁻¹ y
            Projection::Kinematic => kinematic_pinv_tr_mul(robot, y, v),
            Projection::None => SVector::zeros(),
        };
        robot.jacobian_tr_mul(&leak, v);
        sub(y, v);

        torque.total.copy_from_slice(&torque.task);
        add(&mut torque.total, y);
    }
}

/// `(J Jᵀ)⁻¹ J y`, the transpose of the Moore–Penrose inverse: the projector of W = I, which leaks.
fn kinematic_pinv_tr_mul<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    y: &[f64],
    scratch: &mut [f64],
) -> SVector<f64, M> {
    let mut jjt = SMatrix::<f64, M, M>::zeros();
    for k in 0..M {
        let unit = SVector::from_fn(|row, _| if row == k { 1.0 } else { 0.0 });
        robot.jacobian_tr_mul::<M>(&unit, scratch);
        jjt.set_column(k, &robot.jacobian_mul(scratch));
    }
    let jy = robot.jacobian_mul(y);
    jjt.try_inverse().map_or(SVector::zeros(), |inverse| inverse * jy)
}

fn add(a: &mut [f64], b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
}

fn sub(a: &mut [f64], b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a -= b);
}
