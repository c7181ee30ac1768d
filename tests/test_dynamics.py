"""The arm's dynamics: docs/theory.md, sections 1 and 6, on the public operators and the simulated plant."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import oracle
import vffnull as vff
from strategies import Case, Scene, between, cases, scenes, vectors


def rate(f: Any, q: np.ndarray, dq: np.ndarray, h: float = 1e-3) -> Any:
    """d/dt f(q + t dq) at t = 0 by differences of fourth order."""
    step = h * dq
    return (8 * (f(q + step) - f(q - step)) - (f(q + 2 * step) - f(q - 2 * step))) / (12 * h)


@given(case=cases(1, 12))
def test_operators_agree_with_the_prototype(case: Case) -> None:
    """Everything the arm computes in O(n) against dense matrices from Jacobians of the centres of mass."""
    arm, q, dq = case.arm, case.q, case.dq
    s = oracle.posture(case.model, q, dq)
    pairs = [
        (arm.forward_kinematics(q), s.p),
        (arm.jacobian(q), s.J),
        (arm.jacobian_dot(q, dq), s.J_dot),
        (arm.mass_matrix(q), s.M),
        (arm.coriolis_matrix(q, dq), s.C),
        (arm.gravity_torque(q), s.g),
        (arm.kinetic_energy(q, dq), s.kinetic),
        (arm.potential_energy(q), s.potential),
    ]
    for found, expected in pairs:
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * (1 + np.abs(expected).max()))


@given(case=cases(1, 12))
def test_mass_matrix_is_symmetric_positive_definite(case: Case) -> None:
    """Fact 1."""
    M = case.arm.mass_matrix(case.q)
    np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-14 * np.linalg.norm(M))
    assert np.linalg.eigvalsh(M)[0] > 0


@given(case=cases(1, 10))
def test_coriolis_matrix_is_christoffel(case: Case) -> None:
    """Fact 1: Ṁ = C + Cᵀ, hence Ṁ − 2C is skew. Ṁ by finite differences."""
    M_dot = rate(case.arm.mass_matrix, case.q, case.dq)
    C = case.arm.coriolis_matrix(case.q, case.dq)
    scale = np.linalg.norm(case.arm.mass_matrix(case.q)) * (1 + np.linalg.norm(case.dq))
    np.testing.assert_allclose(M_dot, C + C.T, rtol=0, atol=1e-7 * scale)
    skew = M_dot - 2 * C
    np.testing.assert_allclose(skew, -skew.T, rtol=0, atol=2e-7 * scale)


@given(case=cases(1, 10))
def test_gravity_torque_is_the_gradient_of_the_energy(case: Case) -> None:
    """Fact 1: g = ∇V."""
    gradient = [rate(case.arm.potential_energy, case.q, unit) for unit in np.eye(case.n)]
    g = case.arm.gravity_torque(case.q)
    scale = 1 + np.abs(case.arm.gravity).max() * case.arm.masses.sum() * case.arm.lengths.sum()
    np.testing.assert_allclose(g, gradient, rtol=0, atol=1e-9 * scale)


@given(case=cases(1, 10))
def test_jacobian_and_its_rate(case: Case) -> None:
    """Fact 1: J = ∂x/∂q and J̇ = dJ/dt by finite differences."""
    columns = [rate(lambda q: case.arm.forward_kinematics(q)[-1], case.q, unit) for unit in np.eye(case.n)]
    reach = case.arm.lengths.sum()
    np.testing.assert_allclose(case.arm.jacobian(case.q), np.transpose(columns), rtol=0, atol=1e-9 * reach)
    J_dot = rate(case.arm.jacobian, case.q, case.dq)
    scale = reach * (1 + np.linalg.norm(case.dq))
    np.testing.assert_allclose(case.arm.jacobian_dot(case.q, case.dq), J_dot, rtol=0, atol=1e-7 * scale)


@given(case=cases(1, 12), data=st.data())
def test_forward_and_inverse_dynamics(case: Case, data: st.DataObject) -> None:
    """Inverse dynamics is M q̈ + C q̇ + g; forward dynamics undoes it."""
    arm, q, dq = case.arm, case.q, case.dq
    ddq = data.draw(vectors(case.n, -5.0, 5.0))
    tau = arm.inverse_dynamics(q, dq, ddq)
    expected = arm.mass_matrix(q) @ ddq + arm.coriolis_matrix(q, dq) @ dq + arm.gravity_torque(q)
    np.testing.assert_allclose(tau, expected, rtol=0, atol=1e-12 * (1 + np.linalg.norm(expected)))
    condition = np.linalg.cond(arm.mass_matrix(q))
    back = arm.forward_dynamics(q, dq, tau)
    np.testing.assert_allclose(back, ddq, rtol=0, atol=1e-14 * condition * (1 + np.linalg.norm(ddq)))


@given(
    lengths=vectors(2, 0.3, 2.0),
    masses=vectors(2, 0.3, 4.0),
    com=vectors(2, 0.1, 1.5),
    inertias=vectors(2, 0.01, 1.0),
    q=vectors(2, -3.0, 3.0),
    dq=vectors(2, -3.0, 3.0),
)
def test_two_link_textbook(
    lengths: np.ndarray,
    masses: np.ndarray,
    com: np.ndarray,
    inertias: np.ndarray,
    q: np.ndarray,
    dq: np.ndarray,
) -> None:
    """Fact 2: M and C of Murray, Li, Sastry."""
    arm = vff.Arm(lengths, masses, com=com, inertias=inertias)
    alpha = inertias.sum() + masses @ com**2 + masses[1] * lengths[0] ** 2
    beta, delta = masses[1] * lengths[0] * com[1], inertias[1] + masses[1] * com[1] ** 2
    c, s = math.cos(q[1]), math.sin(q[1])
    M = [[alpha + 2 * beta * c, delta + beta * c], [delta + beta * c, delta]]
    C = [[-beta * s * dq[1], -beta * s * (dq[0] + dq[1])], [beta * s * dq[0], 0.0]]
    np.testing.assert_allclose(arm.mass_matrix(q), M, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(arm.coriolis_matrix(q, dq), C, rtol=1e-12, atol=1e-12)


# ------------------------------------------------------------------------------------- the plant, torque-free


def plant(arm: vff.Arm, q: Any, dq: Any, duration: float, dt: float) -> vff.Simulation:
    """A plant to be moved by our own torque. The reference only has to be reachable."""
    scenario = vff.Scenario(
        arm=arm,
        q0=q,
        dq0=dq,
        duration=duration,
        reference={"kind": "setpoint", "point": arm.forward_kinematics(q)[-1]},
        simulation={"dt": dt, "control": "hold"},
    )
    return vff.Simulation(scenario)


def energy(arm: vff.Arm, state: vff.State) -> float:
    return arm.kinetic_energy(state.q, state.dq) + arm.potential_energy(state.q)


def energy_drift(arm: vff.Arm, q: Any, dq: Any, duration: float, dt: float) -> float:
    simulation = plant(arm, q, dq, duration, dt)
    before, still = energy(arm, simulation.state), np.zeros(arm.n)
    while not simulation.done:
        simulation.step(still)
    assert simulation.status == "completed"
    return abs(energy(arm, simulation.state) - before)


@settings(max_examples=10)
@given(case=cases(2, 5, speed=1.0))
def test_energy_is_constant_without_torque(case: Case) -> None:
    """Fact 3: τ = 0 keeps the energy, up to the integrator's error of O(dt⁴) and below."""
    scale = 1 + abs(energy(case.arm, plant(case.arm, case.q, case.dq, 1.0, 1e-3).state))
    assert energy_drift(case.arm, case.q, case.dq, 0.2, 2.5e-4) < 1e-6 * scale


@pytest.mark.parametrize("n", [1, 2, 3])
def test_energy_drift_falls_sixteenfold_per_halving(n: int) -> None:
    """Fact 3: 16 times and more: RK4's error falls by 2⁴, in the energy often by 2⁵."""
    arm = vff.Arm.uniform(n, gravity=9.81)
    q = [0.3, 0.8, -0.6][:n]
    drifts = [energy_drift(arm, q, np.zeros(n), 1.0, dt) for dt in (4e-3, 2e-3, 1e-3)]
    for coarse, fine in itertools.pairwise(drifts):
        assert fine > 1e-13  # an error, not rounding
        assert coarse / fine > 15.5, drifts


@given(scene=scenes(most=8))
def test_angular_momentum_obeys_the_first_torque(scene: Scene) -> None:
    """Fact 4: without gravity, d/dt (M q̇)₁ = τ₁ for any torque; in particular it is conserved iff τ₁ = 0."""
    document = scene.case.document | {"gravity": 0.0}
    arm, q, dq = vff.Arm(**document), scene.case.q, scene.case.dq
    tau = scene.terms().tau
    ddq = arm.forward_dynamics(q, dq, tau)
    M = arm.mass_matrix(q)
    C = arm.coriolis_matrix(q, dq)
    momentum_rate = M @ ddq + (C + C.T) @ dq  # d/dt(M q̇) with Ṁ = C + Cᵀ
    scale = (
        np.linalg.norm(M) * np.linalg.norm(ddq) + np.linalg.norm(C) * np.linalg.norm(dq) + np.linalg.norm(tau)
    )
    assert momentum_rate[0] == pytest.approx(tau[0], abs=1e-10 * (1 + scale))


def test_angular_momentum_is_conserved_by_a_free_plant() -> None:
    """Fact 4, along a run of the plant with torques everywhere but at the first joint."""
    arm = vff.Arm.uniform(4)
    simulation = plant(arm, [0.4, -0.7, 0.9, 0.3], [0.5, -1.0, 0.7, 0.2], 2.0, 1e-3)

    def momentum() -> float:
        return float((arm.mass_matrix(simulation.state.q) @ simulation.state.dq)[0])

    before = momentum()
    while not simulation.done:
        simulation.step([0.0, math.sin(simulation.state.t), 0.5, -0.3])
    assert momentum() == pytest.approx(before, rel=1e-9)
    assert np.abs(simulation.state.dq - [0.5, -1.0, 0.7, 0.2]).max() > 0.1  # it did move


@pytest.mark.parametrize(
    ("amplitude", "period"), [(0.01, 1.637956823), (1.0, 1.746598537), (2.5, 2.691117410)]
)
def test_pendulum_period(amplitude: float, period: float) -> None:
    """A rod of 1 m has the period T = 4√(2l/3g) K(sin²(θ₀/2)), K the complete elliptic integral."""
    arm = vff.Arm.uniform(1, gravity=9.81)
    dt = 1e-3
    simulation = plant(arm, [amplitude - math.pi / 2], [0.0], 3.0, dt)
    crossings: list[float] = []
    before = simulation.state
    while not simulation.done and len(crossings) < 2:
        after = simulation.step([0.0])
        if (before.q[0] + math.pi / 2) * (after.q[0] + math.pi / 2) < 0:
            crossings.append(_crossing(before, after, dt))
        before = after
    assert 2 * (crossings[1] - crossings[0]) == pytest.approx(period, abs=2e-9)


def _crossing(a: vff.State, b: vff.State, dt: float) -> float:
    """When the pendulum hangs straight down between two states: root of the cubic through both ends."""
    y0, y1 = a.q[0] + math.pi / 2, b.q[0] + math.pi / 2
    v0, v1 = a.dq[0] * dt, b.dq[0] * dt
    cubic = np.polynomial.Polynomial([y0, v0, 3 * (y1 - y0) - 2 * v0 - v1, 2 * (y0 - y1) + v0 + v1])
    s = y0 / (y0 - y1)
    for _ in range(5):
        s -= cubic(s) / cubic.deriv()(s)
    return float(a.t + s * dt)


# ------------------------------------------------------------------------------------------------- symmetries


@given(case=cases(3, 8, gravity=False), phi=between(-3.0, 3.0))
def test_rotation(case: Case, phi: float) -> None:
    """Fact 6: turning the first joint turns x, J and Λ, and leaves M, C and N."""
    case.away_from_singularities()
    arm, q, dq = case.arm, case.q, case.dq
    turned = q + phi * np.eye(case.n)[0]
    R = np.array([[math.cos(phi), -math.sin(phi)], [math.sin(phi), math.cos(phi)]])
    here, there = arm.extended_jacobian(q, dq), arm.extended_jacobian(turned, dq)
    pairs = [
        (arm.forward_kinematics(turned), arm.forward_kinematics(q) @ R.T),
        (arm.jacobian(turned), R @ arm.jacobian(q)),
        (there.Lambda_x, R @ here.Lambda_x @ R.T),
        (arm.mass_matrix(turned), arm.mass_matrix(q)),
        (arm.coriolis_matrix(turned, dq), arm.coriolis_matrix(q, dq)),
        (there.N, here.N),
    ]
    for found, expected in pairs:
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * (1 + np.linalg.norm(expected)))


@given(case=cases(2, 8, gravity=False))
def test_mirror(case: Case) -> None:
    """Fact 6: for an arm that is its own mirror image, M(−q) = M(q) and C(−q, −q̇) = C(q, q̇)."""
    along = np.array(case.document["com"])[:, 0]
    arm, q, dq = vff.Arm(**(case.document | {"com": along.tolist()})), case.q, case.dq
    np.testing.assert_array_equal(arm.mass_matrix(-q), arm.mass_matrix(q))
    np.testing.assert_array_equal(arm.coriolis_matrix(-q, -dq), arm.coriolis_matrix(q, dq))
    np.testing.assert_array_equal(arm.forward_kinematics(-q), arm.forward_kinematics(q) * [1, -1])


@given(scene=scenes(kinds=("circle",), most=8))
def test_the_law_is_mirror_symmetric(scene: Scene) -> None:
    """A mirrored world gives the mirrored torque: field, law and reference have no handedness."""
    case, flip = scene.case, np.array([1.0, -1.0])
    along = np.array(case.document["com"])[:, 0].tolist()
    gravity = np.array(case.document["gravity"])
    settings, t = scene.settings(), scene.t
    x, dx, ddx = scene.reference

    def mirrored(o: vff.Obstacle) -> dict[str, Any]:
        document = o.to_dict()
        document["position"] = (document["position"] * flip).tolist()
        for name in {"velocity", "amplitude"} & set(document.get("motion", ())):
            document["motion"][name] = (document["motion"][name] * flip).tolist()
        return document

    def torque(
        q: np.ndarray, dq: np.ndarray, down: np.ndarray, around: list[Any], sign: np.ndarray
    ) -> np.ndarray:
        arm = vff.Arm(**(case.document | {"com": along, "gravity": down.tolist()}))
        return vff.Controller(arm, settings).torque(q, dq, x * sign, dx * sign, ddx * sign, around, t)

    here = torque(case.q, case.dq, gravity, scene.obstacles, np.ones(2))
    there = torque(-case.q, -case.dq, gravity * flip, [mirrored(o) for o in scene.obstacles], flip)
    np.testing.assert_allclose(there, -here, rtol=0, atol=1e-9 * (1 + np.linalg.norm(here)))
