use super::*;
use crate::testing::{assert_close, case, lagrangian_gradient};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

fn apply(n: usize, operator: impl Fn(&mut [f64])) -> Vec<f64> {
    let mut out = vec![f64::NAN; n];
    operator(&mut out);
    out
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Every operator against the dense textbook matrices, which share no code with it.
    #[test]
    fn operators_agree_with_matrices(c in case(1usize..13)) {
        let (n, state) = (c.q.len(), c.state());
        let dense = state.matrices::<3>();
        let (u, v) = (DVector::from_column_slice(&c.u), DVector::from_column_slice(&c.v));
        let f = SVector::<f64, 3>::new(0.3, -1.2, 0.7);
        let j = &dense.jacobian;
        let check = |a: &[f64], b: &[f64]| assert_close(a, b, 1e-11);
        check(&apply(n, |out| state.mass_mul(&c.v, out)), (&dense.mass * &v).as_slice());
        check(&apply(n, |out| state.coriolis_mul(&c.v, out)), (&dense.coriolis * &v).as_slice());
        check(
            &apply(n, |out| state.coriolis_tr_mul(&c.u, out)),
            (dense.coriolis.transpose() * &u).as_slice(),
        );
        check(&apply(n, |out| state.gravity_torque(out)), dense.gravity.as_slice());
        check(state.jacobian_mul::<3>(&c.v).as_slice(), (j * &v).as_slice());
        check(&apply(n, |out| state.jacobian_tr_mul(&f, out)), (j.transpose() * f).as_slice());
        check(state.jacobian_dot_mul::<3>(&c.v).as_slice(), (&dense.jacobian_dot * &v).as_slice());
        let dq = DVector::from_column_slice(&c.dq);
        let (mut momentum, mut coriolis) = (vec![f64::NAN; n], vec![f64::NAN; n]);
        state.momentum_and_coriolis(&f, &mut momentum, &mut coriolis);
        check(&momentum, (&dense.mass * &dq - j.transpose() * f).as_slice());
        check(&coriolis, (&dense.coriolis * &dq).as_slice());
        let (mut momentum, mut drift) = (vec![f64::NAN; n], vec![f64::NAN; n]);
        state.momentum_and_drift(&mut momentum, &mut drift);
        check(&momentum, (&dense.mass * &dq).as_slice());
        check(&drift, (dense.coriolis.transpose() * &dq - &dense.gravity).as_slice());
        check(
            &apply(n, |out| state.coupling_torque(&f, &c.u, out)),
            (dense.jacobian_dot.transpose() * f - dense.coriolis.transpose() * &u).as_slice(),
        );
        let bias = &dense.coriolis * &dq + &dense.gravity;
        check(&apply(n, |out| state.bias_torque(out)), bias.as_slice());
        check(state.task_velocity::<3>().as_slice(), (j * &dq).as_slice());
        check(state.task_bias_acceleration::<3>().as_slice(), (&dense.jacobian_dot * &dq).as_slice());
        check(
            &apply(n, |out| state.jacobian_dot_tr_mul(&f, out)),
            (dense.jacobian_dot.transpose() * f).as_slice(),
        );
    }

    /// M⁻¹ undoes M, and the half-solve form of Y and Λ⁻¹ is M⁻¹Jᵀ and J M⁻¹Jᵀ.
    #[test]
    fn inverse_and_task_response(c in case(1usize..13)) {
        let (n, state) = (c.q.len(), c.state());
        let b = apply(n, |out| state.mass_mul(&c.v, out));
        assert_close(&apply(n, |out| state.mass_solve(&b, out)), &c.v, 1e-8);
        let mut y = vec![SVector::<f64, 3>::zeros(); n];
        let lambda_inv = state.task_response(&mut y);
        let dense = state.matrices::<3>();
        let back = &dense.mass * DMatrix::from_fn(n, 3, |i, k| y[i][k]);
        assert_close(back.as_slice(), dense.jacobian.transpose().as_slice(), 1e-9);
        let mut product = SMatrix::<f64, 3, 3>::zeros();
        for k in 0..3 {
            let column: Vec<_> = y.iter().map(|row| row[k]).collect();
            product.set_column(k, &state.jacobian_mul(&column));
        }
        assert_close(lambda_inv.as_slice(), product.as_slice(), 1e-9);
    }

    /// M is symmetric positive definite and Ṁ = C + Cᵀ (T2): Christoffel.
    #[test]
    fn mass_rate_is_christoffel(c in case(1usize..9)) {
        let h = 1e-5;
        let (before, after) = (c.later(-h).matrices::<2>(), c.later(h).matrices::<2>());
        let rate = (after.mass - before.mass) / (2.0 * h);
        let now = c.state().matrices::<2>();
        assert_close((&now.coriolis + now.coriolis.transpose()).as_slice(), rate.as_slice(), 1e-6);
        prop_assert!((&now.mass - now.mass.transpose()).norm() < 1e-12 * now.mass.norm());
        prop_assert!(now.mass.cholesky().is_some());
    }

    /// What changes the momentum beside the torque is ∂L/∂q (T186).
    #[test]
    fn drift_is_the_gradient_of_the_lagrangian(c in case(1usize..9)) {
        let (mut state, [mut momentum, mut drift]) = (c.state(), [(); 2].map(|()| vec![f64::NAN; c.q.len()]));
        state.momentum_and_drift(&mut momentum, &mut drift);
        assert_close(&drift, &lagrangian_gradient(&mut state, |_| false), 1e-11);
    }

    /// J = ∂x/∂q, J̇ = dJ/dt and g = ∂V/∂q by central differences.
    #[test]
    fn derivatives_by_finite_differences(c in case(1usize..9)) {
        let (n, h, state) = (c.q.len(), 1e-5, c.state());
        let now = state.matrices::<3>();
        let pose = |state: PlanarState| Manipulator::<2, 3>::pose(&state).0;
        for k in 0..n {
            let at = |step: f64| {
                let mut q = c.q.clone();
                q[k] += step;
                let mut state = c.arm.state();
                state.update(&q, &c.dq);
                state
            };
            let column = (pose(at(h)) - pose(at(-h))) / (2.0 * h);
            assert_close(now.jacobian.column(k).as_slice(), column.as_slice(), 1e-7);
            let slope = (at(h).potential_energy() - at(-h).potential_energy()) / (2.0 * h);
            assert_close(&[now.gravity[k]], &[slope], 1e-6);
        }
        let rate = (c.later(h).matrices::<3>().jacobian - c.later(-h).matrices::<3>().jacobian) / (2.0 * h);
        assert_close(now.jacobian_dot.as_slice(), rate.as_slice(), 1e-6);
    }

    /// Velocity, force, bias acceleration and mobility of a point on a link are consistent with
    /// each other and with M⁻¹.
    #[test]
    fn point_operators(c in case(1usize..9), along in 0.0..1.0, angle in -3.0..3.0) {
        let (n, state) = (c.q.len(), c.state());
        let i = n / 2;
        let normal = Vector::<2>::new(f64::cos(angle), f64::sin(angle));
        let on = |state: &PlanarState| {
            let link = state.link(i);
            link.start + link.direction * (link.length * along)
        };
        let point = on(&state);
        let column = apply(n, |out| state.point_jacobian_tr_mul(i, &point, &normal, out));
        let dot = |a: &[f64], b: &[f64]| -> f64 { a.iter().zip(b).map(|(a, b)| a * b).sum() };
        let velocity = state.point_velocity(i, &point);
        assert_close(&[normal.dot(&velocity)], &[dot(&column, &c.dq)], 1e-12);
        let (mut scout, v) = (state.clone(), c.dq.iter().map(|v| 0.5 - v).collect::<Vec<_>>());
        scout.update_positions(&c.q);
        scout.update_velocities(&v);
        assert_close(&[normal.dot(&scout.point_velocity(i, &point))], &[dot(&column, &v)], 1e-12);
        let h = 1e-4;
        let (before, after) = (on(&c.later(-h)), on(&c.later(h)));
        assert_close(((after - before) / (2.0 * h)).as_slice(), velocity.as_slice(), 1e-5);
        let curve = (after - 2.0 * point + before) / (h * h);
        assert_close(state.point_bias_acceleration(i, &point).as_slice(), curve.as_slice(), 1e-4);
        let solved = apply(n, |out| state.mass_solve(&column, out));
        assert_close(&[state.point_mobility(i, &point, &normal)], &[dot(&column, &solved)], 1e-9);
        let mut wrenches = vec![PlanarWrench::default(); n];
        state.add_force(&mut wrenches, i, &point, &normal);
        assert_close(&apply(n, |out| state.wrenches_tr_mul(&wrenches, out)), &column, 1e-12);
    }
}

/// The two-link arm of Murray, Li and Sastry (*A Mathematical Introduction to Robotic Manipulation*, 1994).
#[test]
fn two_link_textbook() {
    let links = [(0.7, 1.3, 0.3, 0.05), (0.9, 0.8, 0.5, 0.02)].map(|(length, mass, c, inertia)| {
        Link { length, mass, com: Vector::<2>::new(c, 0.0), inertia, radius: 0.0 }
    });
    let (l1, [a, b]) = (0.7, links);
    let (c1, c2) = (a.com.x, b.com.x);
    let alpha = a.inertia + b.inertia + a.mass * c1 * c1 + b.mass * (l1 * l1 + c2 * c2);
    let (beta, delta) = (b.mass * l1 * c2, b.inertia + b.mass * c2 * c2);
    let mut state = Arc::new(PlanarArm::new(links.to_vec(), Vector::<2>::zeros())).state();
    let (q, dq) = ([0.4, -1.1], [0.9, 2.3]);
    state.update(&q, &dq);
    let (cos, sin) = (f64::cos(q[1]), f64::sin(q[1]));
    let [m11, m12, m22] = [alpha + 2.0 * beta * cos, delta + beta * cos, delta];
    let coriolis =
        [[-beta * sin * dq[1], -beta * sin * (dq[0] + dq[1])], [beta * sin * dq[0], 0.0]];
    let v = [0.31, -0.77];
    assert_close(
        &apply(2, |out| state.mass_mul(&v, out)),
        &[m11 * v[0] + m12 * v[1], m12 * v[0] + m22 * v[1]],
        1e-14,
    );
    let expected = coriolis.map(|row| row[0] * v[0] + row[1] * v[1]);
    assert_close(&apply(2, |out| state.coriolis_mul(&v, out)), &expected, 1e-14);
}

/// The recursions stay accurate where the mass matrix is ill-conditioned in joint angles
/// (4·10⁸ at n = 100): M M⁻¹ b = b.
#[test]
fn hundred_links() {
    let n = 100;
    let arm = Arc::new(PlanarArm::new(vec![Link::rod(1.0, 1.0); n], Vector::<2>::zeros()));
    let mut state = arm.state();
    let wave = |k: usize, f: f64| f64::sin(f * k as f64 + 0.3);
    let q: Vec<_> = (0..n).map(|k| 0.4 * wave(k, 0.7)).collect();
    let b: Vec<_> = (0..n).map(|k| wave(k, 1.9)).collect();
    state.update(&q, &vec![0.0; n]);
    let x = apply(n, |out| state.mass_solve(&b, out));
    assert_close(&apply(n, |out| state.mass_mul(&x, out)), &b, 1e-9);
}
