//! The spring to a posture, which asks joints that are moved within limits for no more speed than they can brake from (T202).

use super::Gains;
use crate::robot::Robot;
use nalgebra::{SMatrix, SVector};

/// The speed that the spring asks for is this share of √(ā δ); from √2 of that a joint can brake within δ.
const SPEED: f64 = 0.5;

/// Joints that are free count as held by this share of the stiffest spring, where the way to the posture is shared out.
const FREE: f64 = 1e-6;

/// `out += K_v (q_d − q)` (T10), or what is left of that where the joints are moved within limits: `κ δ` (T202), with δ \[rad, m\] the way to
/// the posture nearest to q_d that does not move the task. Where the posture is `on_plan`, the spring holds what moves that way anyway.
/// Nothing without a posture. The workspaces have a number for each joint.
pub fn add_torque<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    gains: &Gains<M>,
    on_plan: bool,
    [unit, response]: [&mut [f64]; 2],
    out: &mut [f64],
) {
    let (q, posture) = (robot.configuration(), &gains.posture);
    let Some(moved) = gains.moved.as_ref().filter(|_| !on_plan) else {
        return gains.add_posture_torque(q, out);
    };
    let stiffest = posture.iter().map(|(_, stiffness)| *stiffness).fold(0.0, f64::max);
    if stiffest == 0.0 {
        return;
    }
    let held = |stiffness: f64| stiffness.max(FREE * stiffest);
    let task = in_task::<R, D, M>(robot, posture, &held);
    unit.fill(0.0);
    for (i, (rest, stiffness)) in posture.iter().enumerate() {
        let column = robot.jacobian_column::<M>(i);
        let way = rest - q[i] - column.dot(&task) / held(*stiffness);
        unit[i] = 1.0;
        robot.mass_solve(unit, response);
        unit[i] = 0.0;
        let damping = gains.null_damping.get(i) / response[i];
        let softest = SPEED * damping * (moved.acceleration[i] / way.abs()).sqrt();
        out[i] += stiffness.min(softest) * way;
    }
}

/// (J K⁻¹ Jᵀ)⁻¹ J e, the force at the task that takes out of the springs, `held` so stiffly, what moves it. Without a direction in which
/// J has lost its rank.
fn in_task<R: Robot<D>, const D: usize, const M: usize>(
    robot: &R,
    posture: &[(f64, f64)],
    held: &impl Fn(f64) -> f64,
) -> SVector<f64, M> {
    let (mut yields, mut error) = (SMatrix::<f64, M, M>::zeros(), SVector::<f64, M>::zeros());
    for (i, ((rest, stiffness), q)) in posture.iter().zip(robot.configuration()).enumerate() {
        let column = robot.jacobian_column::<M>(i);
        yields += column * column.transpose() / held(*stiffness);
        error += column * (rest - q);
    }
    for row in 0..M {
        yields[(row, row)] *= 1.0 + 1e-9;
    }
    yields.cholesky().map_or(SVector::zeros(), |factor| factor.solve(&error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Law, MotionLimits, OperationalSpace, Projection, Settings};
    use crate::math::ScalarOrVec;
    use crate::robot::Model;
    use crate::testing::{Case, case};
    use proptest::prelude::*;

    /// Nᵀ of the spring, for joints that are moved within limits of this acceleration.
    fn in_null_space(case: &Case, posture: &[f64], acceleration: Option<f64>) -> Vec<f64> {
        let n = case.q.len();
        let settings = Settings {
            posture: Some(posture.to_vec()),
            posture_stiffness: ScalarOrVec::Each((0..n).map(|i| 1.0 + i as f64).collect()),
            ..Settings::default()
        };
        let limits = |a: f64| MotionLimits {
            speed: vec![1.0; n],
            acceleration: vec![a; n],
            jerk: vec![1.0; n],
        };
        let gains = Gains::<2>::new(&settings).moved_within(acceleration.map(limits));
        let mut robot = case.arm.state();
        let mut space = OperationalSpace::new(n, 0.0, gains.metric::<2>());
        space.update(&mut robot, &case.q, &case.dq);
        let (mut unit, mut response, mut torque) = (vec![0.0; n], vec![0.0; n], vec![0.0; n]);
        add_torque(&robot, &gains, false, [&mut unit, &mut response], &mut torque);
        Law::new(n).project(&robot, &space, Projection::Dynamic, &mut torque);
        torque
    }

    proptest! {
        /// Joints that can brake as they like feel in their null space the spring of the posture.
        #[test]
        fn it_is_the_spring_where_that_is_slow(c in case(3..7_usize)) {
            let posture: Vec<f64> = c.q.iter().zip(&c.dq).map(|(q, dq)| q + 0.1 * dq).collect();
            let spring = in_null_space(&c, &posture, None);
            let strong = in_null_space(&c, &posture, Some(1e12));
            let size = spring.iter().fold(1e-3, |size: f64, x| size.max(x.abs()));
            for (a, b) in spring.iter().zip(&strong) {
                prop_assert!((a - b).abs() < 1e-5 * size, "{a} {b}");
            }
        }

        /// However little they can brake, they rest where the spring rests.
        #[test]
        fn it_rests_where_the_spring_rests(c in case(3..7_usize), pull in prop::array::uniform2(-1.0..1.0)) {
            // K e = Jᵀf: the spring pulls at the task alone.
            let robot = c.state();
            let mut posture = vec![0.0; c.q.len()];
            robot.jacobian_tr_mul(&SVector::<f64, 2>::from(pull), &mut posture);
            for (i, (rest, q)) in posture.iter_mut().zip(&c.q).enumerate() {
                *rest = q + *rest / (1.0 + i as f64);
            }
            let weak = in_null_space(&c, &posture, Some(1e-3));
            prop_assert!(weak.iter().all(|torque| torque.abs() < 1e-6), "{weak:?}");
        }
    }
}
