//! The spring to a posture, which asks joints that are moved within limits for no more speed than they can brake from (T202).

use super::moving_posture::MovingPosture;
use super::reaction::Reaction;
use super::{Gains, MotionLimits};
use crate::interrupt;
use crate::math::symmetric::inverse;
use crate::robot::Robot;
use nalgebra::{SMatrix, SVector};

/// The speed that the spring asks for is this share of √(ā δ); from √2 of that a joint can brake within δ.
const SPEED: f64 = 0.5;

/// Joints that are free count as held by this share of the stiffest spring, where the way to the posture is shared out.
const FREE: f64 = 1e-6;

/// The spring, and what changes it.
#[derive(Debug, Clone, Copy)]
pub struct Spring<'a> {
    /// What moves its posture, if anything does: along a plan, what moves the joints keeps an arm from swinging anyway.
    pub moving: Option<&'a MovingPosture>,
    /// What gives way to a push, if anything does.
    pub reaction: Option<&'a Reaction>,
}

/// What is asked of an arm, so that this is compiled once for each kind of task.
struct Arm<'a, const M: usize> {
    /// Its configuration \[rad, m\].
    q: &'a [f64],
    /// A column of the Jacobian.
    column: &'a dyn Fn(usize) -> SVector<f64, M>,
    /// M⁻¹ of a torque \[rad/s², m/s²\].
    accelerate: &'a dyn Fn(&[f64], &mut [f64]),
}

impl Spring<'_> {
    /// `out += K_v (q_d + η − q)` (T10, T168), or what is left of that where the joints are moved within limits: `κ δ` (T202), with δ
    /// \[rad, m\] the way to the posture nearest to q_d + η that does not move the task. Nothing without a posture. The workspaces have
    /// a number for each joint.
    #[inline(always)]
    pub fn add_torque<R: Robot<D>, const D: usize, const M: usize>(
        self,
        robot: &R,
        gains: &Gains<M>,
        [unit, response]: [&mut [f64]; 2],
        out: &mut [f64],
    ) {
        match &gains.moved {
            Some(moved) if !self.moving.is_some_and(MovingPosture::is_along) => {
                let arm = Arm {
                    q: robot.configuration(),
                    column: &|i| robot.jacobian_column(i),
                    accelerate: &|torque, out| robot.mass_solve(torque, out),
                };
                self.add_soft_torque(&arm, gains, moved, [unit, response], out);
            }
            _ => {
                gains.add_posture_torque(robot.configuration(), out);
                if let Some(reaction) = self.reaction {
                    out.iter_mut().zip(reaction.torque()).for_each(|(tau, given)| *tau += given);
                }
            }
        }
    }

    #[cold]
    #[inline(never)]
    fn add_soft_torque<const M: usize>(
        self,
        arm: &Arm<'_, M>,
        gains: &Gains<M>,
        moved: &MotionLimits,
        [unit, response]: [&mut [f64]; 2],
        out: &mut [f64],
    ) {
        let (Arm { q, column, accelerate }, posture) = (arm, &gains.posture);
        let stiffest = posture.iter().map(|(_, stiffness)| *stiffness).fold(0.0, f64::max);
        if stiffest == 0.0 {
            return;
        }
        let error = |i: usize| {
            let let_go = self.reaction.map_or(0.0, |reaction| reaction.posture()[i]);
            gains.way(i, q[i], posture[i].0) + let_go
        };
        let held = |i: usize| posture[i].1.max(FREE * stiffest);
        // (J K⁻¹ Jᵀ)⁻¹ J e, the force at the task that takes out of the springs what moves it.
        let (mut yields, mut off) = (SMatrix::<f64, M, M>::zeros(), SVector::<f64, M>::zeros());
        for i in 0..q.len() {
            let column = column(i);
            yields += column * column.transpose() / held(i);
            off += column * error(i);
        }
        // Without a direction in which J has lost its rank.
        for row in 0..M {
            yields[(row, row)] *= 1.0 + 1e-9;
        }
        let task = inverse(&yields).map_or(SVector::zeros(), |inverse| inverse * off);
        unit.fill(0.0);
        for (i, (_, stiffness)) in posture.iter().enumerate() {
            interrupt::checkpoint(16 * q.len());
            let way = error(i) - column(i).dot(&task) / held(i);
            unit[i] = 1.0;
            accelerate(unit, response);
            unit[i] = 0.0;
            let damping = gains.null_damping.get(i) / response[i];
            let softest = SPEED * damping * (moved.acceleration[i] / way.abs()).sqrt();
            out[i] += stiffness.min(softest) * way;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::{Law, OperationalSpace, Projection, Settings};
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
        let spring = Spring { moving: None, reaction: None };
        spring.add_torque(&robot, &gains, [&mut unit, &mut response], &mut torque);
        Law::new(n).project(&robot, &space, Projection::Dynamic, &mut torque);
        torque
    }

    properties! {
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
