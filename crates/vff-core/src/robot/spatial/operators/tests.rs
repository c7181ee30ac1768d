use super::*;
use crate::robot::description::Frame;
use crate::robot::spatial::cases::{Case, case, planar_twin};
use crate::robot::spatial::{Mobility, SpatialArm};
use crate::testing::{assert_close, lagrangian_gradient};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;
use std::sync::Arc;

fn apply(n: usize, operator: impl FnOnce(&mut [f64])) -> Vec<f64> {
    let mut out = vec![f64::NAN; n];
    operator(&mut out);
    out
}

/// What the recursions give is the matrix product, relative to the size of its terms. Products
/// that are 0 in exact arithmetic are measured against the size of a small link's, 1e-3.
#[track_caller]
fn check(a: &[f64], matrix: &DMatrix<f64>, vector: &DVector<f64>) {
    let scale = (matrix.abs() * vector.abs()).max().max(1e-3);
    let b = matrix * vector;
    for (i, (a, b)) in a.iter().zip(&b).enumerate() {
        assert!((a - b).abs() <= 1e-11 * scale, "[{i}]: {a} against {b} (scale {scale})");
    }
}

fn dynamic<const M: usize>(m: &crate::robot::dense::TaskMatrix<M>) -> DMatrix<f64> {
    DMatrix::from_fn(M, m.ncols(), |i, j| m[(i, j)])
}

/// The operators of a task of dimension M against the matrices.
fn check_task<const M: usize>(c: &Case) {
    let (n, state) = (c.q.len(), c.state());
    let dense = state.matrices::<M>();
    let (j, j_dot) = (dynamic(&dense.jacobian), dynamic(&dense.jacobian_dot));
    let (u, v) = (DVector::from_column_slice(&c.u), DVector::from_column_slice(&c.v));
    let f = SVector::<f64, M>::from_fn(|i, _| f64::sin(1.0 + 2.1 * i as f64));
    let force = DVector::from_column_slice(f.as_slice());
    check(state.jacobian_mul::<M>(&c.v).as_slice(), &j, &v);
    check(&apply(n, |out| state.jacobian_tr_mul(&f, out)), &j.transpose(), &force);
    check(state.jacobian_dot_mul::<M>(&c.v).as_slice(), &j_dot, &v);
    check(&apply(n, |out| state.jacobian_dot_tr_mul(&f, out)), &j_dot.transpose(), &force);
    check(state.task_velocity::<M>().as_slice(), &j, &dense.velocity);
    check(state.task_bias_acceleration::<M>().as_slice(), &j_dot, &dense.velocity);
    for i in 0..n {
        let unit = DVector::from_fn(n, |k, _| if k == i { 1.0 } else { 0.0 });
        check(state.jacobian_column::<M>(i).as_slice(), &j, &unit);
        check(state.jacobian_dot_column::<M>(i).as_slice(), &j_dot, &unit);
    }
    // [M, −Jᵀ] [q̇; f] and [J̇ᵀ, −Cᵀ] [f; u], as products of one matrix each.
    let beside = |a: &DMatrix<f64>, b: &DMatrix<f64>| {
        DMatrix::from_fn(n, a.ncols() + b.ncols(), |i, k| {
            if k < a.ncols() { a[(i, k)] } else { -b[(i, k - a.ncols())] }
        })
    };
    let stack = |a: &DVector<f64>, b: &DVector<f64>| {
        DVector::from_iterator(a.len() + b.len(), a.iter().chain(b).copied())
    };
    let (mut momentum, mut coriolis) = (vec![f64::NAN; n], vec![f64::NAN; n]);
    state.momentum_and_coriolis(&f, &mut momentum, &mut coriolis);
    check(&momentum, &beside(&dense.mass, &j.transpose()), &stack(&dense.velocity, &force));
    check(&coriolis, &dense.coriolis, &dense.velocity);
    let coupling = apply(n, |out| state.coupling_torque(&f, &c.u, out));
    let transposed = beside(&j_dot.transpose(), &dense.coriolis.transpose());
    check(&coupling, &transposed, &stack(&force, &u));
}

/// M Y = Jᵀ and Λ⁻¹ = J Y, relative to the terms, by either way.
fn check_response<const M: usize>(c: &Case) {
    let (n, mut state) = (c.q.len(), c.state());
    let dense = state.matrices::<M>();
    let mut y = vec![SVector::<f64, M>::zeros(); n];
    let lambda_inv = state.task_response(&mut y);
    let matrix = DMatrix::from_fn(n, M, |i, k| y[i][k]);
    let jacobian = dynamic(&dense.jacobian);
    let scale = (dense.mass.abs() * matrix.abs()).max();
    let gap = (&dense.mass * &matrix - jacobian.transpose()).abs().max();
    assert!(gap <= 1e-11 * scale, "{gap} of {scale}");
    let product = &jacobian * &matrix;
    let scale = (jacobian.abs() * matrix.abs()).max();
    for (a, b) in lambda_inv.iter().zip(&product) {
        assert!((a - b).abs() <= 1e-11 * scale, "{a} against {b} (scale {scale})");
    }
    let mut fused = vec![SVector::<f64, M>::zeros(); n];
    let (q, dq) = (c.q.clone(), c.dq.clone());
    assert_eq!(state.update_with_response(&q, &dq, &mut fused), lambda_inv);
    assert_eq!(fused, y);
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Every operator against the dense textbook matrices, which share no code with it.
    #[test]
    fn operators_agree_with_matrices(c in case(1usize..21)) {
        let (n, state) = (c.q.len(), c.state());
        let dense = state.matrices::<3>();
        let (u, v) = (DVector::from_column_slice(&c.u), DVector::from_column_slice(&c.v));
        check(&apply(n, |out| state.mass_mul(&c.v, out)), &dense.mass, &v);
        check(&apply(n, |out| state.coriolis_mul(&c.v, out)), &dense.coriolis, &v);
        check(&apply(n, |out| state.coriolis_tr_mul(&c.u, out)), &dense.coriolis.transpose(), &u);
        let gravity = apply(n, |out| state.gravity_torque(out));
        assert_close(&gravity, dense.gravity.as_slice(), 1e-12);
        let bias = apply(n, |out| state.bias_torque(out));
        let mut rest = bias.clone();
        rest.iter_mut().zip(&gravity).for_each(|(rest, gravity)| *rest -= gravity);
        let scale = (dense.coriolis.abs() * dense.velocity.abs()).max() + dense.gravity.abs().max();
        for (rest, expected) in rest.iter().zip(&(&dense.coriolis * &dense.velocity)) {
            prop_assert!((rest - expected).abs() <= 1e-11 * scale);
        }
        let (mut momentum, mut drift) = (vec![f64::NAN; n], vec![f64::NAN; n]);
        state.momentum_and_drift(&mut momentum, &mut drift);
        check(&momentum, &dense.mass, &dense.velocity);
        let expected = dense.coriolis.tr_mul(&dense.velocity) - &dense.gravity;
        let scale = (dense.coriolis.transpose().abs() * dense.velocity.abs()).max() + dense.gravity.abs().max();
        for (drift, expected) in drift.iter().zip(&expected) {
            prop_assert!((drift - expected).abs() <= 1e-11 * scale, "{drift} against {expected} of {scale}");
        }
        check_task::<3>(&c);
        check_task::<5>(&c);
        check_task::<6>(&c);
    }

    /// M⁻¹ undoes M, and so do the half solves of every task and the articulated-body algorithm.
    #[test]
    fn inverse_and_task_response(c in case(1usize..21)) {
        let (n, state) = (c.q.len(), c.state());
        let dense = state.matrices::<3>();
        let solved = apply(n, |out| state.mass_solve(&c.v, out));
        let x = DVector::from_column_slice(&solved);
        let scale = (dense.mass.abs() * x.abs()).max();
        let back = &dense.mass * &x;
        for (a, b) in back.iter().zip(&c.v) {
            prop_assert!((a - b).abs() <= 1e-11 * scale, "{a} against {b}");
        }
        check_response::<3>(&c);
        check_response::<5>(&c);
        check_response::<6>(&c);
        let bias = apply(n, |out| state.bias_torque(out));
        let rest: Vec<_> = c.u.iter().zip(&bias).map(|(tau, bias)| tau - bias).collect();
        let expected = apply(n, |out| state.mass_solve(&rest, out));
        let mut moved = c.arm.state();
        let mut scratch = vec![0.0; n];
        let ddq = apply(n, |out| moved.update_with_dynamics(&c.q, &c.dq, &c.u, &mut scratch, out));
        let size = DVector::from_column_slice(&bias).abs().max() + 3.0;
        let inverse = dense.mass.clone().try_inverse().unwrap().abs().max() * n as f64;
        for (a, b) in ddq.iter().zip(&expected) {
            prop_assert!((a - b).abs() <= 1e-11 * size * inverse, "{a} against {b}");
        }
    }

    /// C is Christoffel's: Ṁ = C + Cᵀ, v ᵀ(Ṁ − 2C) v = 0, C v = ¼\[h(q̇ + v) − h(q̇ − v)\] and
    /// Cᵀv = Ṁ v − C v, where h = C q̇ comes from the bias, which knows nothing of C.
    #[test]
    fn coriolis_is_christoffel(c in case(1usize..13)) {
        let n = c.q.len();
        let bias_at = |sign: f64| {
            let dq: Vec<_> = c.dq.iter().zip(&c.v).map(|(dq, v)| dq + sign * v).collect();
            apply(n, |out| c.at(&c.q, &dq).bias_torque(out))
        };
        let (plus, minus, state) = (bias_at(1.0), bias_at(-1.0), c.state());
        let product = apply(n, |out| state.coriolis_mul(&c.v, out));
        let polar: Vec<_> = plus.iter().zip(&minus).map(|(a, b)| 0.25 * (a - b)).collect();
        let size = plus.iter().chain(&minus).fold(1.0_f64, |m, x| m.max(x.abs()));
        for (a, b) in product.iter().zip(&polar) {
            prop_assert!((a - b).abs() <= 1e-12 * size, "{a} against {b} (scale {size})");
        }
        // Ṁ v by differences in time, fourth order.
        let mass_at = |t: f64| DVector::from_vec(apply(n, |out| c.later(t).mass_mul(&c.v, out)));
        let h = 1e-3;
        let rate = (mass_at(-2.0 * h) - mass_at(2.0 * h) + (mass_at(h) - mass_at(-h)) * 8.0) / (12.0 * h);
        let transposed = apply(n, |out| state.coriolis_tr_mul(&c.v, out));
        let sum: Vec<_> = product.iter().zip(&transposed).map(|(a, b)| a + b).collect();
        assert_close(&sum, rate.as_slice(), 1e-6);
        let quadratic: f64 = c.v.iter().zip(&sum).map(|(v, s)| v * s).sum();
        let twice: f64 = c.v.iter().zip(&product).map(|(v, s)| 2.0 * v * s).sum();
        let terms: f64 = c.v.iter().zip(&product).map(|(v, s)| (v * s).abs()).sum();
        prop_assert!((quadratic - twice).abs() <= 1e-11 * (1.0 + terms));
    }

    /// What changes the momentum beside the torque is ∂L/∂q (T186).
    #[test]
    fn drift_is_the_gradient_of_the_lagrangian(c in case(1usize..9)) {
        let (mut state, [mut momentum, mut drift]) = (c.state(), [(); 2].map(|()| vec![f64::NAN; c.q.len()]));
        state.momentum_and_drift(&mut momentum, &mut drift);
        let gradient = lagrangian_gradient(&mut state, |i| c.arm.slides(i));
        assert_close(&drift, &gradient, 1e-11);
    }

    /// J = ∂x/∂q, J̇ = dJ/dt and g = ∂V/∂q by central differences; the power of the bias is the
    /// rate of the energy.
    #[test]
    fn derivatives_by_finite_differences(c in case(1usize..9)) {
        let (n, h, state) = (c.q.len(), 1e-5, c.state());
        let j = state.jacobian();
        let gravity = apply(n, |out| state.gravity_torque(out));
        for k in 0..n {
            let at = |step: f64| {
                let mut q = c.q.clone();
                q[k] += step;
                c.at(&q, &c.dq)
            };
            let (before, after) = (at(-h), at(h));
            let linear = (after.position() - before.position()) / (2.0 * h);
            let turn = (after.orientation() * before.orientation().inverse()).log() / (2.0 * h);
            let column: Vec<_> = linear.iter().chain(&turn).copied().collect();
            assert_close(j.column(k).as_slice(), &column, 1e-7);
            let slope = (after.potential_energy() - before.potential_energy()) / (2.0 * h);
            assert_close(&[gravity[k]], &[slope], 1e-6);
        }
        for_task::<3>(&c, h);
        for_task::<5>(&c, h);
        for_task::<6>(&c, h);
        // d/dt (½ q̇ᵀM q̇ + V) at constant q̇ is q̇ᵀ(½ Ṁ q̇ + g) = q̇ᵀ(C q̇ + g).
        let energy = |t: f64| {
            let state = c.later(t);
            let momentum = apply(n, |out| state.mass_mul(&c.dq, out));
            0.5 * dot(&momentum, &c.dq) + state.potential_energy()
        };
        let rate = (energy(h) - energy(-h)) / (2.0 * h);
        let power = dot(&apply(n, |out| state.bias_torque(out)), &c.dq);
        assert_close(&[power], &[rate], 1e-6);
    }

    /// Velocity, force, bias acceleration and mobility of a point on a link are consistent with
    /// each other, with differences and with M⁻¹.
    #[test]
    fn point_operators(c in case(1usize..9), own in prop::array::uniform3(-0.5..0.5), n in prop::array::uniform3(-1.0..1.0)) {
        let (count, state) = (c.q.len(), c.state());
        let (i, normal) = (count / 2, Vector::from(n));
        let on = |state: &SpatialState| state.joint_position(i) + state.link_axes(i) * Vector::from(own);
        let point = on(&state);
        let column = apply(count, |out| state.point_jacobian_tr_mul(i, &point, &normal, out));
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
        let solved = apply(count, |out| state.mass_solve(&column, out));
        let mobility = state.point_mobility(i, &point, &normal);
        assert_close(&[mobility], &[dot(&column, &solved)], 1e-10);
        let mut all = vec![Mobility::default(); count];
        state.mobilities(&mut all);
        assert_close(&[all[i].along(&point, &normal)], &[mobility], 1e-10);
        let mut wrenches = vec![Spatial::default(); count];
        state.add_force(&mut wrenches, i, &point, &normal);
        assert_close(&apply(count, |out| state.wrenches_tr_mul(&wrenches, out)), &column, 1e-12);
    }

    /// Turning mount and gravity together, and moving the mount, changes no joint torque.
    #[test]
    fn the_world_may_turn(c in case(1usize..9), turn in prop::array::uniform3(-3.0..3.0), far in prop::array::uniform3(-1e3..1e3)) {
        let turn = crate::math::UnitQuaternion::exp(&Vector::from(turn));
        let mut description = c.arm.description().clone();
        let mount = crate::math::UnitQuaternion::new(description.mount.orientation).unwrap();
        description.mount = Frame { position: far, orientation: (turn * mount).to_array() };
        description.gravity = turn.rotate(&description.gravity.into()).into();
        let turned = Case { arm: Arc::new(SpatialArm::new(description).unwrap()), ..c.clone() };
        let (a, b, n) = (c.state(), turned.state(), c.q.len());
        for operator in [SpatialState::mass_mul, SpatialState::coriolis_mul, SpatialState::coriolis_tr_mul] {
            let expected = apply(n, |out| operator(&a, &c.v, out));
            assert_close(&apply(n, |out| operator(&b, &c.v, out)), &expected, 1e-12);
        }
        let expected = apply(n, |out| a.bias_torque(out));
        assert_close(&apply(n, |out| b.bias_torque(out)), &expected, 1e-12);
        // And the tool goes along.
        let relative = |state: &SpatialState| state.position() - state.arm.base();
        assert_close(relative(&b).as_slice(), turn.rotate(&relative(&a)).as_slice(), 1e-12);
        let axes = turn.matrix() * a.tool_axes();
        assert_close(b.tool_axes().as_slice(), axes.as_slice(), 1e-13);
    }

    /// `update_positions` gives positions and columns of J bit for bit as `update`.
    #[test]
    fn placed_is_where_updated_is(c in case(1usize..9)) {
        let mut placed = c.arm.state();
        placed.update_positions(&c.q);
        let state = c.state();
        prop_assert_eq!(placed.position(), state.position());
        prop_assert_eq!(placed.jacobian(), state.jacobian());
        prop_assert_eq!(placed.orientation(), state.orientation());
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn for_task<const M: usize>(c: &Case, h: f64) {
    let (before, after) = (c.later(-h).matrices::<M>(), c.later(h).matrices::<M>());
    let rate = (after.jacobian - before.jacobian) / (2.0 * h);
    let state = c.state();
    for i in 0..c.q.len() {
        let column = state.jacobian_dot_column::<M>(i);
        assert_close(column.as_slice(), rate.column(i).as_slice(), 1e-6);
    }
}

properties! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// A planar arm written as a spatial one has the operators of the planar code.
    #[test]
    fn planar_arms_are_spatial_ones(c in crate::testing::case(1usize..13)) {
        let (n, planar) = (c.q.len(), c.state());
        let mut spatial = planar_twin(&c.arm, false).state();
        spatial.update(&c.q, &c.dq);
        let both = |a: &dyn Fn(&mut [f64]), b: &dyn Fn(&mut [f64])| {
            assert_close(&apply(n, b), &apply(n, a), 1e-12);
        };
        both(&|out| planar.mass_mul(&c.v, out), &|out| spatial.mass_mul(&c.v, out));
        both(&|out| planar.coriolis_mul(&c.v, out), &|out| spatial.coriolis_mul(&c.v, out));
        both(&|out| planar.coriolis_tr_mul(&c.u, out), &|out| spatial.coriolis_tr_mul(&c.u, out));
        both(&|out| planar.gravity_torque(out), &|out| spatial.gravity_torque(out));
        both(&|out| planar.bias_torque(out), &|out| spatial.bias_torque(out));
        for i in 0..n {
            for (a, b) in [
                (planar.jacobian_column::<3>(i), spatial.jacobian_column::<6>(i)),
                (planar.jacobian_dot_column::<3>(i), spatial.jacobian_dot_column::<6>(i)),
            ] {
                assert_close(b.as_slice(), &[a[0], a[1], 0.0, 0.0, 0.0, a[2]], 1e-12);
            }
        }
    }
}
