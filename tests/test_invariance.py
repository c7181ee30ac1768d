"""The central promise: nothing that acts in the null space accelerates the end effector (T4, T14)."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import oracle
import vffnull as vff
from strategies import TWO_FORMULATIONS, Case, Scene, assert_passive, between, cases, scenes, vectors

positions_and_poses = st.integers(2, 3).flatmap(
    lambda m: st.tuples(st.just(m), scenes(m, least=m + 1))  # type: ignore[arg-type]
)


def acceleration(case: Case, tau: np.ndarray, m: int = 2) -> tuple[np.ndarray, float]:
    """ẍ = J q̈ + J̇ q̇ under a torque, and the size of what is added up in J M⁻¹(τ − C q̇ − g) + J̇ q̇."""
    arm, q, dq = case.arm, case.q, case.dq
    J, bias = case.jacobian(m), case.jacobian_dot(m) @ dq
    parts = (tau, arm.coriolis_matrix(q, dq) @ dq, arm.gravity_torque(q))
    JM = np.linalg.solve(arm.mass_matrix(q), J.T).T
    size = np.linalg.norm(JM) * sum(np.linalg.norm(part) for part in parts) + np.linalg.norm(bias)
    return J @ arm.forward_dynamics(q, dq, tau) + bias, float(size)


@pytest.mark.parametrize("formulation", TWO_FORMULATIONS)
@given(drawn=positions_and_poses)
def test_null_torque_does_not_move_the_tip(formulation: str, drawn: tuple[int, Scene]) -> None:
    """J M⁻¹ τ_null = 0 (§2: J M⁻¹ Nᵀ = 0), to 1e-9 of |J M⁻¹| |τ_null|.

    Discarded are cases in which the projector takes away all but a hundred-thousandth of the repulsion: what
    is left of it there is rounding, and has no direction.
    """
    m, scene = drawn
    terms = scene.terms(formulation=formulation)
    case = scene.case
    assume(np.linalg.norm(terms.tau_null) >= 1e-5 * np.linalg.norm(terms.tau_vff))
    JM = np.linalg.solve(case.arm.mass_matrix(case.q), case.jacobian(m).T).T
    assert np.linalg.norm(JM @ terms.tau_null) <= 1e-9 * np.linalg.norm(JM) * np.linalg.norm(terms.tau_null)


@pytest.mark.parametrize("formulation", TWO_FORMULATIONS)
@given(drawn=positions_and_poses)
def test_closed_loop_of_the_task_is_exact(formulation: str, drawn: tuple[int, Scene]) -> None:
    """ẍ = ẍ_r − D ė − K e whatever the links, the obstacles and the null motion do (§2)."""
    m, scene = drawn
    case = scene.case
    found, scale = acceleration(case, scene.terms(formulation=formulation).tau, m)
    x_ref, dx_ref, ddx_ref = scene.reference
    e, de = case.pose(m) - x_ref, case.jacobian(m) @ case.dq - dx_ref
    expected = ddx_ref - np.array(scene.gains["damping"]) * de - np.array(scene.gains["stiffness"]) * e
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * (scale + np.linalg.norm(expected)))


@given(drawn=positions_and_poses)
def test_both_formulations_give_the_same_torque(drawn: tuple[int, Scene]) -> None:
    """Recursion and extended Jacobian are each other's oracle: 1e-9 relative (§2)."""
    _, scene = drawn
    a, b = (scene.terms(formulation=formulation) for formulation in TWO_FORMULATIONS)
    scale = np.linalg.norm(a.tau_task) + np.linalg.norm(a.tau_null) + np.linalg.norm(a.tau_vff)
    for name in ("tau", "tau_task", "tau_null", "tau_vff", "force"):
        difference = np.linalg.norm(getattr(a, name) - getattr(b, name))
        assert difference <= 1e-9 * scale, f"{name} differs by {difference}"
    np.testing.assert_array_equal(a.clearance, b.clearance)


@given(drawn=positions_and_poses)
def test_torque_is_the_sum_of_its_parts(drawn: tuple[int, Scene]) -> None:
    terms = drawn[1].terms()
    np.testing.assert_array_equal(terms.tau, terms.tau_task + terms.tau_null)


@given(drawn=positions_and_poses)
def test_projector(drawn: tuple[int, Scene]) -> None:
    """N² = N, trace N = n − m, J N = 0, J M⁻¹ Nᵀ = 0, and M-self-adjoint: M N = Nᵀ M (§5, fact 7)."""
    m, scene = drawn
    case, N = scene.case, scene.terms().N
    J, M = case.jacobian(m), case.arm.mass_matrix(case.q)
    size = np.linalg.norm(N)
    assert np.linalg.norm(N @ N - N) <= 1e-9 * size**2
    assert np.trace(N) == pytest.approx(case.n - m, abs=1e-9 * size)
    assert np.linalg.norm(J @ N) <= 1e-9 * np.linalg.norm(J) * size
    JM = np.linalg.solve(M, J.T).T
    assert np.linalg.norm(JM @ N.T) <= 1e-9 * np.linalg.norm(JM) * size
    np.testing.assert_allclose(M @ N, N.T @ M, rtol=0, atol=1e-9 * np.linalg.norm(M) * size)


@given(scene=scenes(2, least=2, most=2))
def test_no_null_space_without_redundancy(scene: Scene) -> None:
    """n = m: N = 0, and the null-space torque with it (§5, fact 7)."""
    for formulation in TWO_FORMULATIONS:
        terms = scene.terms(formulation=formulation)
        scale = np.linalg.norm(terms.tau_task) + np.linalg.norm(terms.tau_vff)
        assert np.linalg.norm(terms.N) <= 1e-9
        assert np.linalg.norm(terms.tau_null) <= 1e-9 * scale


def test_other_projections_leak() -> None:
    """W = I and no projection at all do accelerate the tip (§5, fact 11): the paper's typos must fail."""
    rng = np.random.default_rng(2)
    leaks: dict[str, list[float]] = {"dynamic": [], "kinematic": [], "none": []}
    for _ in range(100):
        n = int(rng.integers(4, 10))
        arm = vff.Arm(rng.uniform(0.3, 1.5, n), rng.uniform(0.3, 4.0, n))
        q = rng.uniform(0.2, 1.0, n)
        JM = np.linalg.solve(arm.mass_matrix(q), arm.jacobian(q).T).T
        middle = arm.forward_kinematics(q)[n // 2]
        disc = vff.Obstacle.circle(middle + np.array([0.3, 0.3]), 0.1)
        for projection, found in leaks.items():
            settings = {"projection": projection, "field": vff.Field.khatib(1.0, 1.0)}
            tau = vff.Controller(arm, settings).terms(q, np.zeros(n), [1.0, 1.0], obstacles=[disc]).tau_null
            found.append(float(np.linalg.norm(JM @ tau) / (np.linalg.norm(JM) * np.linalg.norm(tau))))
    assert max(leaks["dynamic"]) < 1e-12
    for projection in ("kinematic", "none"):
        assert np.median(leaks[projection]) > 1e-3, projection
        assert min(leaks[projection]) > 1e-6, projection  # every one, and a million times the rounding above


@given(scene=scenes(kinds=("circle",), approach=False), data=st.data())
def test_torque_does_not_depend_on_the_basis(scene: Scene, data: st.DataObject) -> None:
    """Z → Z R gives the same torque (§5, fact 8): the oracle in a random basis, against the library."""
    case = scene.case
    s = oracle.posture(case.model, case.q, case.dq)
    Z = oracle.extended(s).Z
    r = Z.shape[1]
    entries = data.draw(vectors(r * r, -1.0, 1.0))
    turn = np.linalg.qr(entries.reshape(r, r) + 3 * np.eye(r))[0]
    document = scene.field.to_dict()
    document.pop("approach_damping", None)
    gains = {key: scene.gains[key] for key in ("stiffness", "damping", "null_damping")}
    settings = oracle.Settings(field=oracle.Field(**document), **gains)
    solids = [o.to_dict() for o in scene.obstacles]
    centers, radii = (
        oracle.obstacle_centers(solids, scene.t),
        np.array([o["shape"]["radius"] for o in solids]),
    )
    expected = oracle.law(case.model, settings, case.q, case.dq, scene.reference, centers, radii, Z @ turn)
    found = scene.terms()
    scale = np.linalg.norm(found.tau_task) + np.linalg.norm(found.tau_null) + np.linalg.norm(found.tau_vff)
    for name in ("tau", "tau_null", "tau_vff"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), rtol=0, atol=1e-9 * scale)
    # The library counts gravity to the task's part, the prototype to neither.
    np.testing.assert_allclose(found.tau_task, expected.tau_task + s.g, rtol=0, atol=1e-9 * scale)


@given(case=cases(3, 12))
def test_kinetic_energy_splits(case: Case) -> None:
    """T = ½ẋᵀΛẋ + ½νᵀΛ_nν (§5, fact 7)."""
    case.away_from_singularities()
    e = case.arm.extended_jacobian(case.q, case.dq)
    dx, nu = case.jacobian() @ case.dq, e.N_M @ case.dq
    split = (dx @ e.Lambda_x @ dx + nu @ e.Lambda_n @ nu) / 2
    whole = case.dq @ case.arm.mass_matrix(case.q) @ case.dq / 2
    assert split == pytest.approx(whole, rel=1e-9)
    assert case.arm.kinetic_energy(case.q, case.dq) == pytest.approx(whole, rel=1e-12)


@given(case=cases(3, 12))
def test_extended_jacobian(case: Case) -> None:
    """The matrices of eq. 6–13, corrected (§1): sizes, inverse, block-diagonal inertia, orthonormal Z."""
    case.away_from_singularities()
    e = case.arm.extended_jacobian(case.q, case.dq)
    n, r = case.n, case.n - 2
    M, J = case.arm.mass_matrix(case.q), case.jacobian()
    assert e.Z.shape == (n, r) and e.N_M.shape == (r, n)
    assert e.J_e.shape == e.J_e_inv.shape == e.E_e.shape == e.mu.shape == e.N.shape == (n, n)
    assert e.Lambda_x.shape == (2, 2) and e.Lambda_n.shape == (r, r)
    np.testing.assert_allclose(e.Z.T @ e.Z, np.eye(r), atol=1e-12)
    np.testing.assert_allclose(J @ e.Z, 0, atol=1e-12 * np.linalg.norm(J))
    # J of the explicit form comes from textbook matrices, that of the arm from its operators.
    rounding = 4 * np.finfo(float).eps * np.linalg.norm(J)
    np.testing.assert_allclose(e.J_e[:2], J, rtol=0, atol=rounding)
    np.testing.assert_array_equal(e.J_e[2:], e.N_M)
    scale = np.linalg.norm(e.J_e) * np.linalg.norm(e.J_e_inv)
    np.testing.assert_allclose(e.J_e @ e.J_e_inv, np.eye(n), atol=1e-12 * scale)
    E = e.J_e_inv.T @ M @ e.J_e_inv
    np.testing.assert_allclose(e.E_e, E, rtol=0, atol=1e-11 * scale * np.linalg.norm(E))
    np.testing.assert_array_equal(e.E_e[:2, 2:], 0)
    np.testing.assert_array_equal(e.E_e[2:, :2], 0)
    np.testing.assert_allclose(e.N, e.Z @ e.N_M, atol=1e-10 * np.linalg.norm(e.N))


@given(case=cases(3, 9, speed=1.0))
def test_extended_inertia_rate_minus_twice_mu_is_skew(case: Case) -> None:
    """Ė_e = μ + μᵀ (§1, eq. 13), Ė_e by central differences with Z carried along as P(t) Z₀.

    P = I − J⁺J: because J⁺ᵀZ = 0, d/dt(P Z₀) is the Ż = −J⁺J̇Z that μ is defined with.
    """
    case.away_from_singularities()
    e = case.arm.extended_jacobian(case.q, case.dq)

    def inertia(h: float) -> np.ndarray:
        q = case.q + h * case.dq
        J, M = case.arm.jacobian(q), case.arm.mass_matrix(q)
        Z = e.Z - np.linalg.pinv(J) @ (J @ e.Z)
        E = np.zeros((case.n, case.n))
        E[:2, :2] = np.linalg.inv(J @ np.linalg.solve(M, J.T))
        E[2:, 2:] = Z.T @ M @ Z
        return E

    h = 1e-4
    # Fourth-order differences: their truncation error stays far below the tolerance near singularities too.
    E_dot = (8 * (inertia(h) - inertia(-h)) - (inertia(2 * h) - inertia(-2 * h))) / (12 * h)
    scale = np.linalg.norm(e.mu) + np.linalg.norm(e.E_e)
    np.testing.assert_allclose(E_dot, e.mu + e.mu.T, rtol=0, atol=1e-6 * scale)


@given(scene=scenes(least=3, most=9), data=st.data())
def test_null_space_is_passive(scene: Scene, data: st.DataObject) -> None:
    """d/dt(½νᵀΛ_nν) = −νᵀD_nν + νᵀZᵀ(τ_ext + τ_vff) (§2), by differences along the closed loop."""
    tau_ext = data.draw(vectors(scene.case.n, -5.0, 5.0))
    assert_passive(scene, tau_ext, lambda q, _: scene.case.arm.jacobian(q))


@settings(max_examples=50)
@given(case=cases(3, 8), d=between(0.1, 10.0))
def test_uniform_null_damping_is_mass_proportional(case: Case, d: float) -> None:
    """A scalar d means D_q = d·M (README): τ_null falls by Nᵀ d M N q̇ = d (M q̇ − JᵀΛẋ)."""
    case.away_from_singularities()
    x = case.pose()
    undamped, damped = (
        vff.Controller(case.arm, {"null_damping": value}).terms(case.q, case.dq, x).tau_null
        for value in (0.0, d)
    )
    M, J = case.arm.mass_matrix(case.q), case.jacobian()
    momentum = M @ case.dq - J.T @ np.linalg.solve(J @ np.linalg.solve(M, J.T), J @ case.dq)
    scale = np.linalg.norm(undamped) + d * np.linalg.norm(M @ case.dq)
    np.testing.assert_allclose(undamped - damped, d * momentum, rtol=0, atol=1e-9 * scale + 1e-12)


@settings(max_examples=50)
@given(scene=scenes(most=8), data=st.data())
def test_posture_spring_acts_in_the_null_space(scene: Scene, data: st.DataObject) -> None:
    """τ_sec contains K_v (q_d − q) (T10), the short way: the torque changes by Nᵀ of exactly that."""
    case = scene.case
    rest, stiffness = data.draw(vectors(case.n, -2.0, 2.0)), data.draw(vectors(case.n, 0.1, 5.0))
    without = scene.terms()
    pulled = scene.terms(posture=rest, posture_stiffness=stiffness)
    assert "joint_limits" not in case.document  # whole turns are nothing to joints that turn without an end
    way = rest - case.q
    way -= 2.0 * np.pi * np.round(way / (2.0 * np.pi))
    expected = without.N.T @ (stiffness * way)
    scale = np.linalg.norm(without.tau_null) + np.linalg.norm(without.N) * np.linalg.norm(stiffness * way)
    np.testing.assert_allclose(pulled.tau_null - without.tau_null, expected, rtol=0, atol=1e-9 * scale)
    np.testing.assert_array_equal(pulled.tau_vff, without.tau_vff)
