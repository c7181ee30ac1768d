//! The law over spatial arms: what `control/` promises of every [`Robot`] holds for this one.

use crate::control::{Controller, Formulation, Gains, Settings};
use crate::geometry::Body;
use crate::math::{Pose, ScalarOrVec, Vector};
use crate::robot::SpatialState;
use crate::robot::spatial::cases::{Case, case, planar_twin};
use crate::robot::{Manipulator, Model, Robot};
use crate::testing::assert_close;
use crate::trajectory::Sample;
use crate::world::plane::World;
use crate::world::{CollisionQuery, Contact};
use nalgebra::{DVector, SVector};
use proptest::prelude::*;

/// Nothing around the arm.
#[derive(Debug, Clone, Copy)]
pub struct Nothing;

impl CollisionQuery<3> for Nothing {
    fn obstacle_count(&self) -> usize {
        0
    }

    fn for_each_contact<'a>(
        &mut self,
        _bodies: impl IntoIterator<Item = Body<'a, 3>>,
        _reach: f64,
        _distance: impl FnMut(usize, f64),
        _visit: impl FnMut(&Contact<3>),
    ) {
    }

    fn contact_after(
        &self,
        _index: usize,
        _body: &Body<'_, 3>,
        _obstacle: usize,
        _after: f64,
    ) -> Contact<3> {
        unreachable!("there is nothing to touch")
    }
}

/// A posture spring and damping act in the null space.
fn settings(n: usize, formulation: Formulation) -> Settings {
    Settings {
        formulation,
        posture: Some((0..n).map(|i| 0.3 * i as f64 - 0.5).collect()),
        posture_stiffness: ScalarOrVec::Uniform(7.0),
        ..Settings::default()
    }
}

/// ẍ = ẍ_c exactly and J M⁻¹ τ_null = 0 (T14, T4), and both formulations give one torque.
fn check_law<const M: usize>(c: &Case) -> Result<(), TestCaseError>
where
    SpatialState: Manipulator<3, M>,
{
    let (n, robot) = (c.q.len(), c.state());
    let fill = |a: f64, b: f64| SVector::<f64, M>::from_fn(|i, _| a + b * i as f64);
    let offset = fill(0.2, -0.1);
    let x = Manipulator::<3, M>::pose(&robot);
    let sample = Sample { x: x.moved(&-offset), dx: fill(0.2, 0.5), ddx: fill(-0.7, 0.4) };
    let error = x.error(&sample.x);
    let mut totals = vec![];
    for formulation in [Formulation::Recursive, Formulation::ExtendedJacobian] {
        let gains = Gains::new(&settings(n, formulation));
        let mut controller = Controller::<_, 3, M>::new(c.arm.state(), gains);
        controller.observe(&c.q, &c.dq, &mut Nothing);
        prop_assume!(!controller.space().singular && controller.space().conditioning() > 1e-4);
        let torque = controller.command(&sample).clone();
        let (mut scratch, mut ddq) = (vec![0.0; n], vec![0.0; n]);
        robot.forward_dynamics(&torque.total, &mut scratch, &mut ddq);
        let ddx = robot.jacobian_mul::<M>(&ddq) + robot.jacobian_dot_mul::<M>(&c.dq);
        let [dx_r, ddx_r] = robot.resolve(&sample.x, &sample.dx, &sample.ddx);
        let de = robot.jacobian_mul::<M>(&c.dq) - dx_r;
        let expected = ddx_r - de * 8.0 - error * 16.0;
        let size = 1.0 + expected.norm() + DVector::from_column_slice(&ddq).norm();
        prop_assert!((ddx - expected).norm() <= 1e-8 * size, "{ddx} {expected}");
        robot.mass_solve(&torque.null, &mut ddq);
        let leak = robot.jacobian_mul::<M>(&ddq).norm();
        let scale = 1.0 + DVector::from_column_slice(&ddq).norm();
        // What spring and damping would do to the hand is taken away by Λ, which is known to ε times its condition.
        let gains = controller.gains();
        let posture = gains.posture.iter().zip(&c.q);
        let pull: Vec<f64> = posture.map(|((there, k), q)| k * (there - q)).collect();
        robot.mass_solve(&pull, &mut ddq);
        let (spring, hand) = (robot.jacobian_mul::<M>(&ddq), robot.jacobian_mul::<M>(&c.dq));
        let taken = spring.norm() + gains.null_damping.get(0) * hand.norm();
        let rounding = controller.space().rounding_of(taken);
        prop_assert!(
            leak <= 1e-9 * scale + rounding,
            "{formulation:?} leaks {leak} of {scale}, {rounding} by rounding"
        );
        let acts = DVector::from_column_slice(&torque.null).norm();
        prop_assert!(n == M || acts > 1e-6, "nothing acts in the null space");
        totals.push(torque.total);
    }
    assert_close(&totals[0], &totals[1], 1e-8);
    Ok(())
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn law_for_a_position(c in case(4usize..13)) {
        check_law::<3>(&c)?;
    }

    #[test]
    fn law_for_pointing(c in case(6usize..13)) {
        check_law::<5>(&c)?;
    }

    #[test]
    fn law_for_a_pose(c in case(6usize..13)) {
        check_law::<6>(&c)?;
    }

    /// The torque of a planar arm is that of the same arm in space: lifted along z for a position,
    /// so that all three rows mean something.
    #[test]
    fn planar_law_in_space(c in crate::testing::case(4usize..9)) {
        let n = c.q.len();
        let command = |dx: f64, ddx: f64| {
            let (x, dx, ddx) = (Vector::<2>::zeros(), Vector::<2>::new(dx, 0.3), Vector::<2>::new(0.4, ddx));
            Sample { x, dx, ddx }
        };
        let mut planar = Controller::<_, 2, 2>::new(c.arm.state(), Gains::new(&settings(n, Formulation::Recursive)));
        planar.observe(&c.q, &c.dq, &mut World::new(vec![]));
        prop_assume!(!planar.space().singular && planar.space().conditioning() > 1e-3);
        let mut sample = command(-0.2, 0.7);
        sample.x = planar.pose() - Vector::<2>::new(0.1, 0.2);
        let expected = planar.command(&sample).total.clone();

        let lifted = planar_twin(&c.arm, true);
        let before = |x: f64, rest: &[f64]| [&[x], rest].concat();
        let mut lifted_settings = settings(n, Formulation::Recursive);
        lifted_settings.posture = lifted_settings.posture.map(|posture| before(0.0, &posture));
        let mut spatial = Controller::<SpatialState, 3, 3>::new(lifted.state(), Gains::new(&lifted_settings));
        spatial.observe(&before(0.1, &c.q), &before(-0.3, &c.dq), &mut Nothing);
        let raise = |x: Vector<2>, z: f64| Vector::<3>::new(x.x, x.y, z);
        let torque = spatial.command(&Sample {
            x: raise(sample.x, 0.3),
            dx: raise(sample.dx, 0.1),
            ddx: raise(sample.ddx, -0.5),
        });
        assert_close(&torque.total[1..], &expected, 1e-12);
    }
}
