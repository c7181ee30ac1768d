//! How long a torque may be held: the sampled bounds of the null space (T31, T34).

use super::push_of_many::{ratios, to_the_seventh};
use super::{Gains, OperationalSpace, Settings};
use crate::field::{Field, Response};
use crate::geometry::Body;
use crate::interrupt;
use crate::math::{ScalarOrVec, Vector, dot};
use crate::robot::Robot;
use crate::world::CollisionQuery;
use nalgebra::{DMatrix, DVector, Dyn, SymmetricEigen};

/// The largest control period at which the null space is stable, and what sets it.
///
/// # Example
/// ```
/// use std::sync::Arc;
/// use vff_core::control::{Controller, Gains, Settings, StablePeriod};
/// use vff_core::math::Vector;
/// use vff_core::robot::{Model, PlanarArm, planar::Link};
/// use vff_core::world::plane::World;
///
/// let arm = Arc::new(PlanarArm::new(vec![Link::rod(0.5, 1.0); 3], Vector::<2>::zeros()));
/// let mut controller = Controller::<_, 2, 2>::new(arm.state(), Gains::new(&Settings::default()));
/// let mut world = World::new(vec![]);
/// controller.observe(&[0.4, 0.5, -0.6], &[0.0; 3], &mut world);
/// let StablePeriod { period, .. } = controller.stable_period(&mut world);
/// assert!(period > 0.001);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StablePeriod {
    /// The period \[s\]; infinite without damping or stiffness to hold.
    pub period: f64,
    /// Stiffness U'' \[N/m\] of the contact that sets it; 0 if the null damping does.
    pub stiffness: f64,
    /// Clearance \[m\] of that contact; infinite if there is none.
    pub clearance: f64,
}

/// \[1/s\].
const SLOW: f64 = 0.5;

/// A gain that a torque held over the control period makes unstable (T31, T32).
///
/// # Example
/// ```
/// use vff_core::control::{Settings, Unstable};
///
/// let settings = Settings::default();
/// assert!(Unstable::all(&settings, 1e-3).is_empty());
/// let all = Unstable::all(&settings, 1.0);
/// assert!(all[0].to_string().starts_with("null_damping: "));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Unstable {
    /// A damping that is too strong.
    #[error(
        "{key}: {rate} 1/s is unstable at a control period of {period} s; below {} 1/s it is not",
        2.0 / period
    )]
    Damping {
        /// The key below `controller`.
        key: &'static str,
        /// \[1/s\].
        rate: f64,
        /// \[s\].
        period: f64,
    },
    /// A damping of the task that is too weak for its stiffness.
    #[error(
        "damping: {damping} 1/s is too little for a stiffness of {stiffness} 1/s² at a control period of {period} s; above {} 1/s it is enough",
        0.5 * period * stiffness
    )]
    Stiffness {
        /// \[1/s\].
        damping: f64,
        /// \[1/s²\].
        stiffness: f64,
        /// \[s\].
        period: f64,
    },
}

/// How fast what a task with this stiffness and damping swings by grows at a control period \[1/s\].
fn growth((k, d): (f64, f64), period: f64) -> f64 {
    0.5 * (0.5 * period * k - d)
}

impl Unstable {
    /// Whether it grows by less than a half in a second, as of a task without damping at a kilohertz.
    pub fn is_slow(&self) -> bool {
        match self {
            Self::Damping { .. } => false,
            Self::Stiffness { damping, stiffness, period } => {
                growth((*stiffness, *damping), *period) < SLOW
            }
        }
    }

    /// What of these settings is unstable at a control period \[s\].
    pub fn all(settings: &Settings, period: f64) -> Vec<Self> {
        let Settings { stiffness, damping, null_damping, .. } = settings;
        let strong = |key, rates: &ScalarOrVec| {
            let rate = rates.values().iter().copied().fold(0.0, f64::max);
            (rate * period >= 2.0).then_some(Self::Damping { key, rate, period })
        };
        let axes = 0..stiffness.values().len().max(damping.values().len());
        let weak = axes.map(|i| (stiffness.get(i), damping.get(i)));
        let weak = weak.filter(|(k, d)| *k > 0.0 && 0.5 * period * k >= *d);
        let weak = weak.max_by(|a, b| growth(*a, period).total_cmp(&growth(*b, period)));
        let weak = weak.map(|(stiffness, damping)| Self::Stiffness { damping, stiffness, period });
        [strong("null_damping", null_damping), weak, strong("damping", damping)]
            .into_iter()
            .flatten()
            .collect()
    }
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
    // Beyond so many numbers every contact counts alone: [largest mode, its stiffness, its clearance].
    let mut alone = [0.0, 0.0, f64::INFINITY];
    let mut add = |column: Vec<f64>, stiffness: f64, clearance: f64| {
        if stiffness > 0.0 {
            interrupt::checkpoint(64 * n);
            let compliance = null_compliance(robot, space, &column);
            let mode = stiffness * dot(&column, &compliance);
            if springs.len() * n >= MAX_NUMBERS {
                if mode > alone[0] {
                    alone = [mode, stiffness, clearance];
                }
                return;
            }
            springs.push(Spring { column, compliance, stiffness, clearance });
        }
    };
    let mut pair = None;
    let mut of_a_pair = vec![];
    surroundings.for_each_contact(
        robot.bodies(),
        gains.field.influence,
        |_, _| {},
        |contact| {
            if pair.replace(contact.pair()) != Some(contact.pair()) {
                add_springs(&gains.field, std::mem::take(&mut of_a_pair), &mut add);
            }
            let mut row = vec![0.0; n];
            robot.point_jacobian_tr_mul(contact.link, &contact.point, &contact.normal, &mut row);
            of_a_pair.push((row, contact.distance));
        },
    );
    add_springs(&gains.field, of_a_pair, &mut add);
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
    let [mode, stiffness, clearance] = alone;
    let (together, spring) = stiffest_mode(&springs, n);
    if mode > together {
        return bound(n, gains, mode, stiffness, clearance);
    }
    let Spring { stiffness, clearance, .. } = springs[spring];
    bound(n, gains, together, stiffness, clearance)
}

/// The springs that a field is between a body and an obstacle, of whose contacts these are the rows J_cᵀn̂ and the distances \[m\]: one
/// for one contact. That of many is the second derivative of their potential U (T192), with u = U_k / U: springs of u⁷ U_k'' along
/// each row, and of 7 u⁶ F_k² / U along that less its part in the joint push.
fn add_springs(
    field: &Field,
    of_a_pair: Vec<(Vec<f64>, f64)>,
    add: &mut impl FnMut(Vec<f64>, f64, f64),
) {
    if of_a_pair.len() < 2 {
        let one = of_a_pair.into_iter();
        return one.for_each(|(row, d)| add(row, field.at(d).stiffness, d));
    }
    let responses: Vec<Response> = of_a_pair.iter().map(|(_, d)| field.at(*d)).collect();
    let potentials: Vec<f64> = responses.iter().map(|response| response.potential).collect();
    let (norm, ratios) = ratios(&potentials);
    let mut push = vec![0.0; of_a_pair[0].0.len()];
    for (((row, _), response), u) in of_a_pair.iter().zip(&responses).zip(&ratios) {
        let weight = to_the_seventh(*u) * response.force;
        push.iter_mut().zip(row).for_each(|(push, row)| *push += weight * row);
    }
    for (((row, d), response), u) in of_a_pair.into_iter().zip(responses).zip(ratios) {
        let Response { force, stiffness, .. } = response;
        if force > 0.0 {
            let beside = row.iter().zip(&push).map(|(row, push)| row - u / force * push).collect();
            add(beside, 7.0 * u.powi(6) * force * force / norm, d);
        }
        add(row, to_the_seventh(u) * stiffness, d);
    }
}

/// Numbers that the springs may be made of: a matrix of as many is soon decomposed.
const MAX_NUMBERS: usize = 1 << 20;

/// The largest mode of the springs together \[1/s²\], and the spring that has the largest part in it.
fn stiffest_mode(springs: &[Spring], n: usize) -> (f64, usize) {
    if springs.len() > n {
        return stiffest_mode_in_joints(springs, n);
    }
    // The stiffest mode of K_n relative to Λ_n: the largest eigenvalue of √K (J_c N M⁻¹ J_cᵀ) √K.
    let coupled = DMatrix::from_fn(springs.len(), springs.len(), |a, b| {
        let root = (springs[a].stiffness * springs[b].stiffness).sqrt();
        0.5 * root
            * (dot(&springs[a].column, &springs[b].compliance)
                + dot(&springs[b].column, &springs[a].compliance))
    });
    let Some(eigen) = eigen(coupled) else { return (f64::INFINITY, 0) };
    let mode = eigen.eigenvalues.imax();
    (eigen.eigenvalues[mode], eigen.eigenvectors.column(mode).iamax())
}

/// The eigenvalues of a symmetric matrix; none if it is not finite, of which the iteration would find no end.
fn eigen(matrix: DMatrix<f64>) -> Option<SymmetricEigen<f64, Dyn>> {
    let finite = matrix.iter().all(|value| value.is_finite());
    let limit = 1000 + 100 * matrix.nrows();
    finite.then(|| SymmetricEigen::try_new(matrix, f64::EPSILON, limit)).flatten()
}

/// The same where there are more springs than joints. With A = √K J_c and P = N M⁻¹ the mode is the largest eigenvalue
/// of A P Aᵀ and so that of R P R, R = √(AᵀA), which has a row per joint.
fn stiffest_mode_in_joints(springs: &[Spring], n: usize) -> (f64, usize) {
    let mut stiffness = DMatrix::<f64>::zeros(n, n);
    let mut yielding = DMatrix::<f64>::zeros(n, n); // P AᵀA
    for Spring { column, compliance, stiffness: k, .. } in springs {
        interrupt::checkpoint(2 * n * n);
        let column = DVector::from_column_slice(column);
        stiffness.ger(*k, &column, &column, 1.0);
        yielding.ger(*k, &DVector::from_column_slice(compliance), &column, 1.0);
    }
    let Some(eigen) = eigen(stiffness) else { return (f64::INFINITY, 0) };
    let largest = eigen.eigenvalues.max();
    let roots = eigen.eigenvalues.map(|k| k.max(0.0).sqrt());
    // R P R = R (P AᵀA) R⁺: where R vanishes, so does P AᵀA.
    let inverse = roots.map(|root| if root * root > 1e-13 * largest { 1.0 / root } else { 0.0 });
    let in_modes = eigen.eigenvectors.tr_mul(&yielding) * &eigen.eigenvectors;
    let product = DMatrix::from_diagonal(&roots) * in_modes * DMatrix::from_diagonal(&inverse);
    let Some(whole) = self::eigen((&product + product.transpose()) * 0.5) else {
        return (f64::INFINITY, 0);
    };
    let mode = whole.eigenvalues.imax();
    // A P R u is the mode among the springs; P R u = P AᵀA R⁺ u.
    let back =
        eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * whole.eigenvectors.column(mode);
    let motion = yielding * back;
    let part =
        |spring: &Spring| (spring.stiffness.sqrt() * dot(&spring.column, motion.as_slice())).abs();
    let parts = springs.iter().map(part).enumerate();
    let most = parts.fold((0, 0.0), |most, next| if next.1 > most.1 { next } else { most });
    (whole.eigenvalues[mode], most.0)
}

/// The bound for an obstacle that arrives with `speed` \[m/s\] at the far end of a body, wherever and from
/// wherever the null space yields most: there it comes nearest, and the field becomes stiffest
/// (T29). Allocates.
pub fn stable_period_against<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    space: &OperationalSpace<M>,
    gains: &Gains<M>,
    speed: f64,
) -> StablePeriod {
    let n = robot.dof();
    let at_body = |body: Body<'_, D>| {
        interrupt::checkpoint(128 * n);
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
        let mobility = eigen(mobility).map_or(f64::INFINITY, |eigen| eigen.eigenvalues.max());
        let mobility = mobility.max(f64::MIN_POSITIVE);
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

/// h < 2 d/κ and h < 2/d for a mode of stiffness κ = u ᵀK_n u / uᵀΛ_n u \[1/s²\].
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::FieldKind;
    use crate::math::Noise;

    /// The springs of many points are the second derivatives of their potential, but for what turning normals add.
    #[test]
    fn springs_of_many_contacts() {
        let field = Field { kind: FieldKind::Bounded, gain: 40.0, influence: 0.3, ..Field::OFF };
        let mut noise = Noise::new(9, 0);
        for count in [1, 2, 7, 30] {
            let points: Vec<Vector<3>> = (0..count)
                .map(|_| {
                    Vector::<3>::from_fn(|i, _| {
                        f64::from(u8::from(i == 0)) * 0.3 + 0.1 * noise.draw()
                    })
                })
                .collect();
            let reach = |x: &Vector<3>, p: &Vector<3>| ((x - p).normalize(), (x - p).norm() - 0.05);
            let potential = |x: Vector<3>| {
                let each: Vec<f64> =
                    points.iter().map(|p| field.at(reach(&x, p).1).potential).collect();
                ratios(&each).0
            };
            let here = Vector::<3>::zeros();
            let rows = points.iter().map(|p| {
                let (normal, d) = reach(&here, p);
                (normal.as_slice().to_vec(), d)
            });
            let mut found = DMatrix::<f64>::zeros(3, 3);
            add_springs(&field, rows.collect(), &mut |row, stiffness, _| {
                assert!(stiffness >= 0.0);
                let row = DVector::from_vec(row);
                found.ger(stiffness, &row, &row, 1.0);
            });
            let each: Vec<f64> =
                points.iter().map(|p| field.at(reach(&here, p).1).potential).collect();
            for (p, u) in points.iter().zip(ratios(&each).1) {
                let (normal, d) = reach(&here, p);
                let across =
                    DMatrix::identity(3, 3) - DMatrix::from_fn(3, 3, |a, b| normal[a] * normal[b]);
                found -= across * (to_the_seventh(u) * field.at(d).force / (d + 0.05));
            }
            let h = 1e-4;
            let at = |a: usize, b: usize, s: [f64; 2]| {
                let mut x = here;
                x[a] += h * s[0];
                x[b] += h * s[1];
                potential(x)
            };
            for (a, b) in (0..9).map(|k| (k / 3, k % 3)) {
                let corners = at(a, b, [1.0, 1.0]) - at(a, b, [1.0, -1.0]) - at(a, b, [-1.0, 1.0])
                    + at(a, b, [-1.0, -1.0]);
                let second = corners / (4.0 * h * h);
                assert!(
                    (second - found[(a, b)]).abs() < 1e-3 * (1.0 + found.norm()),
                    "{count}: {second} {found}"
                );
            }
        }
    }

    /// Springs in joint space have the mode that they have among themselves, and the same one has the largest part.
    #[test]
    fn more_springs_than_joints() {
        let mut noise = Noise::new(3, 0);
        for (n, count) in [(3, 4), (4, 9), (6, 40)] {
            let root = DMatrix::from_fn(n, n - 2, |_, _| noise.draw());
            let mobility = &root * root.transpose(); // of rank n − 2, as that of a null space is
            let springs: Vec<Spring> = (0..count)
                .map(|_| {
                    let column = DVector::from_fn(n, |_, _| noise.draw());
                    let compliance = (&mobility * &column).as_slice().to_vec();
                    let stiffness = 1.0 + 50.0 * noise.share();
                    let column = column.as_slice().to_vec();
                    Spring { column, compliance, stiffness, clearance: 0.0 }
                })
                .collect();
            let (expected, spring) = stiffest_mode(&springs, usize::MAX);
            let (found, same) = stiffest_mode_in_joints(&springs, n);
            assert!((found - expected).abs() < 1e-9 * expected, "{found} {expected}");
            assert_eq!(same, spring);
        }
    }
}
