//! A spatial arm as matrices: the oracle of the recursions.
//!
//! Textbook formulas over the Jacobians of the centres of mass (Murray, Li and Sastry, 1994, ch. 4),
//! straight from the description: M = Σ m J_vᵀJ_v + J_ωᵀ I J_ω, its analytical derivatives by every
//! joint, and from them the Christoffel symbols. Nothing here shares code with the recursions.
//! Cost O(n⁴), allocates.

use super::SpatialArm;
use crate::math::Vector;
use crate::robot::Matrices;
use crate::robot::dense::TaskMatrix;
use crate::robot::description::{Frame, JointKind};
use crate::robot::inertia::tensor;
use nalgebra::{DMatrix, DVector, Isometry3, Translation3, Unit, UnitQuaternion};

/// Where a joint is, what it does to points, and where its link is.
pub(super) struct Placed {
    axis: Vector<3>,
    origin: Vector<3>,
    turns: bool,
    pub link: Isometry3<f64>,
}

impl Placed {
    /// How a point beyond this joint moves per unit of its velocity.
    fn moves(&self, point: &Vector<3>) -> Vector<3> {
        if self.turns { self.axis.cross(&(point - self.origin)) } else { self.axis }
    }

    /// How everything beyond this joint turns per unit of its velocity.
    fn spin(&self) -> Vector<3> {
        if self.turns { self.axis } else { Vector::zeros() }
    }
}

/// The columns of a point's Jacobian, linear and angular, and their derivatives by every joint.
struct PointJacobian {
    linear: Vec<Vector<3>>,
    angular: Vec<Vector<3>>,
    /// `[k][j]`: column j by joint k.
    linear_by: Vec<Vec<Vector<3>>>,
    angular_by: Vec<Vec<Vector<3>>>,
}

impl PointJacobian {
    /// Of a `point` on the last of the joints `chain`.
    fn new(chain: &[Placed], point: &Vector<3>) -> Self {
        let derivative = |k: usize, j: usize| {
            let (by, of) = (&chain[k], &chain[j]);
            // Only what lies beyond joint k moves with it: the axis and the origin of j if j is.
            let (axis, origin) = if k < j {
                (by.spin().cross(&of.axis), by.moves(&of.origin))
            } else {
                (Vector::zeros(), Vector::zeros())
            };
            if of.turns {
                let lever = point - of.origin;
                (axis.cross(&lever) + of.axis.cross(&(by.moves(point) - origin)), axis)
            } else {
                (axis, Vector::zeros())
            }
        };
        let n = chain.len();
        let table = |pick: &dyn Fn(usize, usize) -> Vector<3>| -> Vec<Vec<Vector<3>>> {
            (0..n).map(|k| (0..n).map(|j| pick(k, j)).collect()).collect()
        };
        Self {
            linear: chain.iter().map(|joint| joint.moves(point)).collect(),
            angular: chain.iter().map(Placed::spin).collect(),
            linear_by: table(&|k, j| derivative(k, j).0),
            angular_by: table(&|k, j| derivative(k, j).1),
        }
    }
}

fn isometry(frame: Frame) -> Isometry3<f64> {
    frame.into()
}

pub(super) fn chain(arm: &SpatialArm, q: &[f64]) -> Vec<Placed> {
    let mut frame = isometry(arm.description().mount);
    arm.description()
        .joints
        .iter()
        .zip(q)
        .map(|(joint, q)| {
            frame *= isometry(joint.origin());
            let own = Vector::from(joint.axis);
            let axis = frame.rotation * own;
            let origin = frame.translation.vector;
            let turns = joint.kind != JointKind::Prismatic;
            frame *= if turns {
                let turn = UnitQuaternion::from_axis_angle(&Unit::new_normalize(own), *q);
                Isometry3::from_parts(Translation3::identity(), turn)
            } else {
                Isometry3::from_parts((own * *q).into(), UnitQuaternion::identity())
            };
            Placed { axis, origin, turns, link: frame }
        })
        .collect()
}

/// The matrices of a spatial arm at (q, q̇), the task at its tool: position (`M` = 3), pose (6) or
/// pointing (5).
pub fn matrices<const M: usize>(arm: &SpatialArm, q: &[f64], dq: &[f64]) -> Matrices<M> {
    let n = arm.dof();
    let chain = chain(arm, q);
    let description = arm.description();
    let mut mass = DMatrix::zeros(n, n);
    // `[k]`: ∂M/∂q_k.
    let mut mass_by = vec![DMatrix::<f64>::zeros(n, n); n];
    let mut gravity = DVector::zeros(n);
    for (b, joint) in description.joints.iter().enumerate() {
        let link = &chain[b].link;
        let com = (link * nalgebra::Point3::from(Vector::from(joint.com))).coords;
        let jacobian = PointJacobian::new(&chain[..=b], &com);
        let r = link.rotation.to_rotation_matrix().into_inner();
        let turned = r * tensor(&joint.inertia) * r.transpose();
        let PointJacobian { linear, angular, linear_by, angular_by } = &jacobian;
        for i in 0..=b {
            gravity[i] -= joint.mass * linear[i].dot(&arm.gravity());
            for j in 0..=b {
                mass[(i, j)] +=
                    joint.mass * linear[i].dot(&linear[j]) + angular[i].dot(&(turned * angular[j]));
            }
        }
        for k in 0..=b {
            let spin = chain[k].spin().cross_matrix();
            let turned_by = spin * turned - turned * spin;
            for i in 0..=b {
                for j in 0..=b {
                    let linear_part =
                        linear_by[k][i].dot(&linear[j]) + linear[i].dot(&linear_by[k][j]);
                    mass_by[k][(i, j)] += joint.mass * linear_part
                        + angular_by[k][i].dot(&(turned * angular[j]))
                        + angular[i].dot(&(turned * angular_by[k][j]))
                        + angular[i].dot(&(turned_by * angular[j]));
                }
            }
        }
        mass[(b, b)] += joint.armature;
    }
    let coriolis = DMatrix::from_fn(n, n, |i, j| {
        let symbol =
            |k: usize| 0.5 * (mass_by[k][(i, j)] + mass_by[j][(i, k)] - mass_by[i][(j, k)]);
        (0..n).map(|k| symbol(k) * dq[k]).sum()
    });
    let (jacobian, jacobian_dot) = task(arm, &chain, dq);
    Matrices {
        mass,
        coriolis,
        gravity,
        jacobian,
        jacobian_dot,
        velocity: DVector::from_column_slice(dq),
    }
}

fn task<const M: usize>(
    arm: &SpatialArm,
    chain: &[Placed],
    dq: &[f64],
) -> (TaskMatrix<M>, TaskMatrix<M>) {
    let n = chain.len();
    let tool = chain[n - 1].link * isometry(arm.description().tool);
    let columns = PointJacobian::new(chain, &tool.translation.vector);
    let rate = |by: &Vec<Vec<Vector<3>>>, j: usize| -> Vector<3> {
        (0..n).map(|k| by[k][j] * dq[k]).sum()
    };
    let omega: Vector<3> = (0..n).map(|k| columns.angular[k] * dq[k]).sum();
    // The direction of an angular row, and its rate.
    let row = |row: usize| -> (Vector<3>, Vector<3>) {
        let mut unit = Vector::<3>::zeros();
        unit[row - 3] = 1.0;
        if M == 5 {
            let axis = tool.rotation * unit;
            (axis, omega.cross(&axis))
        } else {
            (unit, Vector::zeros())
        }
    };
    let jacobian = TaskMatrix::<M>::from_fn(n, |i, j| {
        if i < 3 { columns.linear[j][i] } else { row(i).0.dot(&columns.angular[j]) }
    });
    let jacobian_dot = TaskMatrix::<M>::from_fn(n, |i, j| {
        if i < 3 {
            rate(&columns.linear_by, j)[i]
        } else {
            let (axis, axis_rate) = row(i);
            axis.dot(&rate(&columns.angular_by, j)) + axis_rate.dot(&columns.angular[j])
        }
    });
    (jacobian, jacobian_dot)
}
