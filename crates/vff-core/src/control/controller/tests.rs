//! The law, its projections and its formulations on random arms.

use super::Controller;
use crate::control::{Formulation, Gains, Projection, Settings};
use crate::field::{Field, FieldKind};
use crate::math::{ScalarOrVec, Vector};
use crate::robot::{Manipulator, Model, PlanarState, Robot};
use crate::testing::{Case, assert_close, case};
use crate::trajectory::Sample;
use crate::world::Motion;
use crate::world::plane::{Obstacle, Shape, World};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

const FORMULATIONS: [Formulation; 2] = [Formulation::Recursive, Formulation::ExtendedJacobian];

fn settings(formulation: Formulation, projection: Projection) -> Settings {
    let field = Field {
        kind: FieldKind::Khatib,
        gain: 0.8,
        influence: 2.0,
        floor: None,
        approach_damping: 0.5,
        sliding: 20.0,
    };
    Settings { field, formulation, projection, ..Settings::default() }
}

/// Two discs near the arm, one of them moving, and what the arm makes of them.
fn sensed<const M: usize>(c: &Case, settings: &Settings) -> Controller<PlanarState, 2, M>
where
    PlanarState: Manipulator<2, M>,
{
    let mut controller = Controller::<_, 2, M>::new(c.arm.state(), Gains::new(settings));
    let middle = c.state().link(c.q.len() / 2);
    let near = middle.start + middle.direction * (0.3 * middle.length);
    let disc = |x: f64, y: f64, velocity| Obstacle {
        position: [near.x + x, near.y + y],
        motion: Motion::Linear { velocity },
        ..Obstacle::of(Shape::Circle { radius: 0.2 })
    };
    let mut world = World::new(vec![disc(0.5, 0.6, [-1.0, -0.4]), disc(-0.7, 0.2, [0.0, 0.0])]);
    controller.observe(&c.q, &c.dq, &mut world);
    controller
}

fn reference<P: From<Vector<M>>, const M: usize>() -> Sample<P, M> {
    let fill = |a: f64, b: f64| Vector::<M>::from_fn(|i, _| a + b * i as f64);
    Sample { x: fill(1.0, -0.3).into(), dx: fill(0.2, 0.5), ddx: fill(-0.7, 0.4) }
}

/// ẍ = ẍ_c exactly and J M⁻¹ τ_null = 0 (T14, T4), and both formulations give one torque.
fn check_law<const M: usize>(c: &Case, projection: Projection) -> Result<(), TestCaseError>
where
    PlanarState: Manipulator<2, M>,
    <PlanarState as Manipulator<2, M>>::Pose: From<Vector<M>>,
{
    let n = c.q.len();
    let mut totals = vec![];
    for formulation in FORMULATIONS {
        let mut controller = sensed::<M>(c, &settings(formulation, projection));
        prop_assume!(controller.space().conditioning() > 1e-4 && !controller.space().singular);
        let sample = reference();
        let torque = controller.command(&sample).clone();
        let e = *controller.error();
        let robot = c.state();
        let (mut scratch, mut ddq) = (vec![0.0; n], vec![0.0; n]);
        robot.forward_dynamics(&torque.total, &mut scratch, &mut ddq);
        let ddx = robot.jacobian_mul::<M>(&ddq) + robot.jacobian_dot_mul::<M>(&c.dq);
        let de = robot.jacobian_mul::<M>(&c.dq) - sample.dx;
        let expected = sample.ddx - de * 8.0 - e * 16.0;
        robot.mass_solve(&torque.null, &mut ddq);
        let leak = robot.jacobian_mul::<M>(&ddq).norm();
        let scale = 1.0 + DVector::from_column_slice(&ddq).norm();
        if projection == Projection::Dynamic {
            // What the field would do to the hand is taken away by Λ, which is known to ε times its condition.
            robot.mass_solve(controller.forces.torque(), &mut ddq);
            let taken = robot.jacobian_mul::<M>(&ddq).norm();
            let rounding = controller.space().rounding_of(taken);
            prop_assert!(
                leak <= 1e-9 * scale + rounding,
                "{formulation:?} leaks {leak} of {scale}, {rounding} by rounding"
            );
            let size = 1.0 + expected.norm();
            prop_assert!((ddx - expected).norm() <= 1e-7 * size, "{ddx} {expected}");
        }
        totals.push(torque.total);
    }
    assert_close(&totals[0], &totals[1], 1e-8);
    Ok(())
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn law_in_both_formulations(c in case(3usize..13)) {
        check_law::<2>(&c, Projection::Dynamic)?;
    }

    #[test]
    fn law_for_a_pose(c in case(4usize..13)) {
        check_law::<3>(&c, Projection::Dynamic)?;
    }

    #[test]
    fn comparison_projections_in_both_formulations(c in case(3usize..9)) {
        check_law::<2>(&c, Projection::Kinematic)?;
        check_law::<2>(&c, Projection::None)?;
    }

    /// Per-joint damping D_q = √d M √d is symmetric and takes power in every state.
    #[test]
    fn null_damping_dissipates(c in case(3usize..9)) {
        let each = (0..c.q.len()).map(|i| 0.5 + i as f64).collect();
        for formulation in FORMULATIONS {
            let base = settings(formulation, Projection::Dynamic);
            let settings = Settings { null_damping: ScalarOrVec::Each(Clone::clone(&each)), ..base };
            let mut controller = sensed::<2>(&c, &settings);
            controller.command(&reference());
            prop_assert!(controller.law.damping_power >= 0.0);
        }
    }

    /// The sliding force (T82) is orthogonal to the relative velocity of link and obstacle: all its power
    /// comes from obstacles that move.
    #[test]
    fn sliding_does_no_work_of_its_own(c in case(3usize..9)) {
        let slid = settings(Formulation::Recursive, Projection::Dynamic);
        let mut plain = slid.clone();
        plain.field.sliding = 0.0;
        let (slid, plain) = (sensed::<2>(&c, &slid), sensed::<2>(&c, &plain));
        let power = slid.forces.power(&c.dq) - plain.forces.power(&c.dq);
        let moved = slid.forces.obstacle_power() - plain.forces.obstacle_power();
        let scale = slid.forces.power(&c.dq).abs() + slid.forces.obstacle_power().abs() + 1.0;
        prop_assert!((power - moved).abs() <= 1e-10 * scale, "{power} {moved}");
    }

    /// Basis independence: the extended Jacobian in a turned basis ZR has
    /// the same projector, block-diagonal E_e, J_e J_e⁻¹ = I and Ė − 2μ skew by its
    /// symmetric part μ + μᵀ = Ė.
    #[test]
    fn extended_jacobian_identities(c in case(4usize..9), angle in 0.1..3.0) {
        use crate::control::extended_jacobian::ExtendedJacobian;
        let state = c.state();
        let m = state.matrices::<2>();
        let Some(extended) = ExtendedJacobian::new(&m) else { return Err(TestCaseError::reject("singular")) };
        prop_assume!(extended.lambda_x.norm() * extended.lambda_x.clone().try_inverse().unwrap().norm() < 1e4);
        let n = c.q.len();
        let identity = DMatrix::<f64>::identity(n, n);
        prop_assert!((&extended.j_e * &extended.j_e_inv - &identity).norm() < 1e-9);
        let e = extended.j_e_inv.transpose() * &m.mass * &extended.j_e_inv;
        prop_assert!((e - &extended.e_e).norm() < 1e-9 * extended.e_e.norm());
        let mut turn = DMatrix::<f64>::identity(n - 2, n - 2);
        let (sin, cos) = f64::sin_cos(angle);
        turn[(0, 0)] = cos;
        turn[(0, 1)] = -sin;
        turn[(1, 0)] = sin;
        turn[(1, 1)] = cos;
        let turned = ExtendedJacobian::with_basis(&m, &extended.z * turn).unwrap();
        prop_assert!((turned.null_projector() - extended.null_projector()).norm() < 1e-9);
    }
}

/// Stretched, folded and short arms: finite torque, a damped task force, and whatever acts in
/// the null space still does not move the end effector where it can move at all.
#[test]
fn singular_configurations_stay_finite() {
    use crate::robot::{PlanarArm, planar::Link};
    for (n, q) in [
        (1, vec![0.3]),
        (2, vec![0.3, 0.0]),
        (6, vec![0.0; 6]),
        (3, vec![0.2, std::f64::consts::PI, 0.0]),
    ] {
        let arm = PlanarArm::new(vec![Link::rod(1.0, 1.0); n], Vector::<2>::new(0.0, -9.81));
        let zero = vec![0.0; n];
        let c = Case { arm: arm.into(), q, dq: vec![0.1; n], u: zero.clone(), v: zero };
        for formulation in FORMULATIONS {
            let mut controller = sensed::<2>(&c, &settings(formulation, Projection::Dynamic));
            assert!(controller.space().singular);
            let torque = controller.command(&reference()).clone();
            assert!(torque.total.iter().all(|t| t.is_finite()), "{n}: {torque:?}");
            let leak = controller.space().response(&torque.null).norm();
            assert!(leak < 1e-9, "{n}: {leak}");
        }
    }
}
