//! THE LAW: recursive, basis-free, on operators (docs/theory.md, T11 and T12).
//!
//! ```text
//! τ = g + Jᵀ(Λ ẍ_c + S q̇)  −  Nᵀ Sᵀ ẋ  +  Nᵀ(τ_sec − D_q N q̇),      S = J#ᵀC − Λ J̇
//! ```
//!
//! The end effector then obeys ẍ = ẍ_c + J M⁻¹ τ_ext exactly (T14), and the null space is a passive
//! impedance, Λ_n ν̇ + (μ_nn + D_n) ν = Zᵀ(τ_sec + τ_ext) (T15).

use super::{Gains, OperationalSpace, Projection};
use crate::math::dot;
use crate::robot::Robot;
use nalgebra::{SMatrix, SVector};

/// Joint torques of one evaluation \[N·m\].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Torque {
    /// What the motors get: `task + null`.
    pub total: Vec<f64>,
    /// `g + Jᵀf`: gravity and the task force, and what makes the end effector give way.
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

    /// Is `total` \[N·m, N\], all of it of the task.
    pub fn set(&mut self, total: &[f64]) {
        self.total.copy_from_slice(total);
        self.task.copy_from_slice(total);
        self.null.fill(0.0);
    }

    /// Brings every joint's torque between its `ends` \[N·m, N\], at the cost of the task. What is not a number stays so.
    pub fn cut_to(&mut self, ends: &[[f64; 2]]) {
        for (i, [lower, upper]) in ends.iter().enumerate() {
            let total = self.total[i];
            let least = if total < *lower { *lower } else { total };
            let within = if least > *upper { *upper } else { least };
            self.task[i] += within - total;
            self.total[i] = within;
        }
    }

    /// Keeps a `share` of itself; the rest is of `other`, with `more` \[N·m, N\] added to its task.
    pub fn blend(&mut self, other: &Self, more: &[f64], share: f64) {
        let mean = |own: &mut f64, other: f64| *own = share * *own + (1.0 - share) * other;
        for (i, more) in more.iter().enumerate() {
            mean(&mut self.total[i], other.total[i] + more);
            mean(&mut self.task[i], other.task[i] + more);
            mean(&mut self.null[i], other.null[i]);
        }
    }

    /// Adds to the part of the task.
    pub fn add_to_task(&mut self, more: impl Fn(usize) -> f64) {
        for (i, (total, task)) in self.total.iter_mut().zip(&mut self.task).enumerate() {
            let more = more(i);
            *total += more;
            *task += more;
        }
    }
}

/// The law with its workspace.
///
/// # Example
/// [`Controller`](super::Controller) strings it together with what it needs; alone:
/// ```
/// use std::sync::Arc;
/// use vff_core::control::{Gains, Law, OperationalSpace, Settings, Torque};
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, planar::Link};
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::new(0.0, -9.81)));
/// let (mut robot, settings) = (arm.state(), Settings::default());
/// let gains = Gains::<2>::new(&settings).of_arm(&settings, &*arm);
/// let mut space = OperationalSpace::new(3, 1e-3, gains.metric::<2>());
/// space.update(&mut robot, &[0.4, 0.5, -0.6], &[0.0; 3]);
/// let mut law = Law::new(3);
/// let wanted = Vector::<2>::new(0.5, 0.0); // acceleration of the end effector
/// law.evaluate(&robot, &space, &gains, &wanted, &[1.0, 0.0, 0.0]);
/// let Torque { total, task, null } = &law.torque;
/// assert!(total.iter().zip(task).zip(null).all(|((t, x), n)| (t - x - n).abs() < 1e-12));
/// // The null-space torque does not accelerate the end effector.
/// assert!(space.response(null).norm() < 1e-12);
/// ```
#[derive(Debug, Clone)]
pub struct Law {
    /// The result of the last evaluation.
    pub torque: Torque,
    /// C q̇ + g at the state of the last evaluation, less the external torque that an observer knows \[N·m\].
    pub bias: Vec<f64>,
    /// ½ (N q̇)ᵀ M N q̇ \[J\].
    pub null_energy: f64,
    /// (N q̇)ᵀ D_q N q̇ \[W\], `brake` included.
    pub damping_power: f64,
    /// Additional damping of the null space \[1/s\], 0 unless a joint is near its speed limit (T37).
    pub brake: f64,
    v: Vec<f64>,
    w: Vec<f64>,
}

impl Law {
    /// For `n` joints.
    pub fn new(n: usize) -> Self {
        let zeros = || vec![0.0; n];
        Self {
            torque: Torque::zeros(n),
            bias: zeros(),
            null_energy: 0.0,
            damping_power: 0.0,
            brake: 0.0,
            v: zeros(),
            w: zeros(),
        }
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
        let n = tau_sec.len();
        // All of one length: spares the loops their bounds checks.
        let Torque { total, task, null } = &mut self.torque;
        let (total, task, y) = (&mut total[..n], &mut task[..n], &mut null[..n]);
        let (bias, v, w) = (&mut self.bias[..n], &mut self.v[..n], &mut self.w[..n]);
        let dq = &robot.velocity()[..n];
        // Λ ẋ, and without the damping of a singularity, where the projector stays exact
        let (damped, momentum) = (space.lambda_damped * space.dx, space.lambda * space.dx);

        // Task force  f = Λ (ẍ_c + J M⁻¹ C q̇ − J̇ q̇); M N q̇ = M q̇ − JᵀΛẋ on the way          (T12)
        robot.momentum_and_coriolis(&momentum, w, bias);
        let c_dq = space.response(bias);
        let f = space.lambda_damped * (ddx_c + c_dq - robot.task_bias_acceleration());

        // Coupling J̇ᵀ Λẋ − Cᵀ J#ẋ
        space.response_mul(&damped, v);
        robot.coupling_torque(&damped, v, y);
        if space.singular {
            space.response_mul(&momentum, v);
        }

        // Null motion N q̇ = q̇ − J#ẋ and its damping D_q N q̇
        subtract_from(v, dq);
        self.null_energy = 0.5 * dot(v, w);
        gains.null_damping.scale_momentum(robot, self.brake, v, w, total);
        self.damping_power = dot(v, w);

        // Null-space torque before projection  y = J̇ᵀ Λẋ − Cᵀ J#ẋ + τ_sec − D_q N q̇         (T12)
        add_difference(y, tau_sec, w);

        // Projection  Nᵀ y = y − Jᵀ(Λ J M⁻¹ y)                                               (T4)
        let leak = leak(robot, space, gains.projection, y, v);

        // τ = g + Jᵀ f + Nᵀ y                                                               (T11)
        robot.gravity_torque(task);
        for i in 0..n {
            let column = robot.jacobian_column::<M>(i);
            bias[i] += task[i];
            task[i] += column.dot(&f);
            y[i] -= column.dot(&leak);
            total[i] = task[i] + y[i];
        }
    }

    /// `y ← Nᵀ y` (T4).
    pub fn project<R: Robot<D>, const D: usize, const M: usize>(
        &mut self,
        robot: &R,
        space: &OperationalSpace<M>,
        projection: Projection,
        y: &mut [f64],
    ) {
        let leak = leak(robot, space, projection, y, &mut self.v);
        for (i, y) in y.iter_mut().enumerate() {
            *y -= robot.jacobian_column::<M>(i).dot(&leak);
        }
    }
}

/// `a ← b − a`.
fn subtract_from(a: &mut [f64], b: &[f64]) {
    a.iter_mut().zip(b).for_each(|(a, b)| *a = b - *a);
}

/// `a ← a + b − c`.
fn add_difference(a: &mut [f64], b: &[f64], c: &[f64]) {
    a.iter_mut().zip(b).zip(c).for_each(|((a, b), c)| *a += b - c);
}

/// The task force in a joint torque `y`, which the projector takes out.
fn leak<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    projection: Projection,
    y: &[f64],
    scratch: &mut [f64],
) -> SVector<f64, M> {
    match projection {
        Projection::Dynamic => space.pinv_tr_mul(y),
        Projection::Kinematic => kinematic_pinv_tr_mul(robot, y, scratch),
        Projection::None => SVector::zeros(),
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
