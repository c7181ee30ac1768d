//! How long a torque may be held: the sampled bounds of the null space (T31, T34).

use super::{Gains, OperationalSpace};
use crate::math::{Body, Vector, dot};
use crate::robot::Robot;
use crate::world::CollisionQuery;
use nalgebra::DMatrix;

/// The largest control period at which the null space is stable, and what sets it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StablePeriod {
    /// The period [s]; infinite without damping or stiffness to hold.
    pub period: f64,
    /// Stiffness U'' [N/m] of the contact that sets it; 0 if the null damping does.
    pub stiffness: f64,
    /// Clearance [m] of that contact; infinite if there is none.
    pub clearance: f64,
}

/// The bound at the present state: (h/2) K_n ≺ D_n ≺ (2/h) Λ_n, with K_n = Zᵀ Σ J_cᵀn̂ U'' n̂ᵀJ_c Z of all
/// contacts within the field and of the joint limits. Allocates.
pub fn stable_period<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    gains: &Gains<M>,
    surroundings: &mut impl CollisionQuery<D>,
) -> StablePeriod {
    let n = robot.dof();
    let mut springs: Vec<Spring> = vec![];
    let mut add = |column: Vec<f64>, stiffness: f64, clearance: f64| {
        if stiffness > 0.0 {
            let compliance = null_compliance(robot, space, &column);
            springs.push(Spring { column, compliance, stiffness, clearance });
        }
    };
    surroundings.for_each_contact(
        robot.bodies(),
        gains.field.influence,
        |_, _| {},
        |contact| {
            let mut column = vec![0.0; n];
            robot.point_jacobian_tr_mul(contact.link, &contact.point, &contact.normal, &mut column);
            add(column, gains.field.at(contact.distance).stiffness, contact.distance);
        },
    );
    if let Some(field) = &gains.joint_limit_field {
        for (i, [lower, upper]) in robot.limits().joint.iter().enumerate() {
            let q = robot.configuration()[i];
            let left = (q - lower).min(upper - q);
            let column = (0..n).map(|k| f64::from(u8::from(k == i))).collect();
            add(column, field.at(left).stiffness, left);
        }
    }
    if springs.is_empty() {
        return by_damping(n, gains);
    }
    // The stiffest mode of K_n relative to Λ_n: the largest eigenvalue of √K (J_c N M⁻¹ J_cᵀ) √K.
    let coupled = DMatrix::from_fn(springs.len(), springs.len(), |a, b| {
        let root = (springs[a].stiffness * springs[b].stiffness).sqrt();
        0.5 * root
            * (dot(&springs[a].column, &springs[b].compliance)
                + dot(&springs[b].column, &springs[a].compliance))
    });
    let eigen = coupled.symmetric_eigen();
    let mode = eigen.eigenvalues.imax();
    let Spring { stiffness, clearance, .. } = springs[eigen.eigenvectors.column(mode).iamax()];
    bound(n, gains, eigen.eigenvalues[mode], stiffness, clearance)
}

/// The bound for an obstacle that arrives with `speed` [m/s] at the far end of a body, wherever and from
/// wherever the null space yields most: there it comes nearest, and the field becomes stiffest
/// (T29). Allocates.
pub fn stable_period_against<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    gains: &Gains<M>,
    speed: f64,
) -> StablePeriod {
    let n = robot.dof();
    let at_body = |body: Body<D>| {
        let end = body.shape.end();
        let columns: Vec<Vec<f64>> = (0..D)
            .map(|k| {
                let axis = Vector::<D>::from_fn(|row, _| f64::from(u8::from(row == k)));
                let mut column = vec![0.0; n];
                robot.point_jacobian_tr_mul(body.link, &end, &axis, &mut column);
                column
            })
            .collect();
        let yielding: Vec<_> =
            columns.iter().map(|column| null_compliance(robot, space, column)).collect();
        let mobility = DMatrix::from_fn(D, D, |a, b| {
            0.5 * (dot(&columns[a], &yielding[b]) + dot(&columns[b], &yielding[a]))
        });
        let mobility = mobility.symmetric_eigenvalues().max().max(f64::MIN_POSITIVE);
        let clearance = gains.field.closest_approach(0.5 * speed * speed / mobility);
        let stiffness = gains.field.at(clearance).stiffness;
        bound(n, gains, stiffness * mobility, stiffness, clearance)
    };
    let nothing = by_damping(n, gains);
    robot
        .bodies()
        .map(at_body)
        .fold(nothing, |worst, next| if next.period < worst.period { next } else { worst })
}

/// N M⁻¹ τ: how the null space yields to a joint torque.
fn null_compliance<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    tau: &[f64],
) -> Vec<f64> {
    let mut out = vec![0.0; tau.len()];
    robot.mass_solve(tau, &mut out);
    let force = space.lambda * space.response(tau);
    out.iter_mut().zip(&space.y).for_each(|(out, y)| *out -= y.dot(&force));
    out
}

/// h < 2 d/κ and h < 2/d for a mode of stiffness κ = u ᵀK_n u / uᵀΛ_n u [1/s²].
fn bound<const M: usize>(
    n: usize,
    gains: &Gains<M>,
    mode: f64,
    stiffness: f64,
    clearance: f64,
) -> StablePeriod {
    let least = (0..n).map(|i| gains.null_damping.get(i)).fold(f64::INFINITY, f64::min);
    let period = 2.0 * least / mode.max(f64::MIN_POSITIVE);
    let free = by_damping(n, gains);
    if period < free.period { StablePeriod { period, stiffness, clearance } } else { free }
}

fn by_damping<const M: usize>(n: usize, gains: &Gains<M>) -> StablePeriod {
    let most = (0..n).map(|i| gains.null_damping.get(i)).fold(0.0, f64::max);
    StablePeriod { period: 2.0 / most, stiffness: 0.0, clearance: f64::INFINITY }
}

/// A stiffness along one direction of the joints.
struct Spring {
    column: Vec<f64>,
    compliance: Vec<f64>,
    stiffness: f64,
    clearance: f64,
}
