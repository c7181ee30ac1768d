"""A hand that holds a link: a spring and a damper, whatever their stiffness (docs/theory.md, T146, T147)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError

Array = np.ndarray[Any, np.dtype[np.float64]]

PANDA = vff.Scenario.load("panda-sweep").replace(obstacles=None)
PLANE: dict[str, Any] = {
    "duration": 100.0,
    "q0": [0.3, 0.9, -0.6],
    "arm": {"lengths": [1.0, 0.8, 0.6], "masses": [2.0, 1.5, 1.0]},
    "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 4.0},
    "reference": {"kind": "setpoint", "point": [1.5, 1.7]},
    "simulation": {"dt": 1e-3, "control": "hold", "integrator": "rk4"},
}
POINT = np.array([0.4, 0.1])
"""Of the second link, in its frame [m]."""


def held_point(arm: vff.Arm, q: Array) -> tuple[Array, Array]:
    """Where `POINT` of the second link of an arm in the plane is (2,) [m], and its Jacobian (2, 3)."""
    angle = q[0] + q[1]
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    joints = arm.forward_kinematics(q)
    place = joints[1] + R @ POINT
    away = place - joints[:2]
    J = np.zeros((2, 3))
    J[:, :2] = np.stack([-away[:, 1], away[:, 0]])
    return place, J


def test_it_is_a_spring_and_a_damper() -> None:
    """τ_ext = Jᵀ (K (a − c) − D ċ), by hand."""
    rng = np.random.default_rng(3)
    for _ in range(5):
        q, dq, anchor = rng.standard_normal(3), rng.standard_normal(3), rng.standard_normal(2)
        simulation = vff.Simulation(vff.Scenario.from_dict(PLANE | {"q0": q.tolist(), "dq0": dq.tolist()}))
        assert simulation.state.tau_ext is None
        state = simulation.pull("link_2", point=POINT, anchor=anchor, stiffness=30.0, damping=7.0)
        place, J = held_point(vff.Scenario.from_dict(PLANE).arm, q)
        expected = J.T @ (30.0 * (anchor - place) - 7.0 * J @ dq)
        np.testing.assert_allclose(state.tau_ext, expected, atol=1e-12)
        np.testing.assert_array_equal(simulation.pull(None).tau_ext, np.zeros(3))


@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
@pytest.mark.parametrize("stiffness", [50.0, 1e5, 1e8])
def test_no_spring_is_too_stiff(stiffness: float, integrator: str) -> None:
    """Without motors and damping, kinetic energy and that of the spring stay what they were: to the ninth
    digit by RK4 where the step resolves the spring; after 10⁴ vibrations most is left, and none is gained.
    """
    scenario = vff.Scenario.from_dict(PLANE).replace(**{"simulation.integrator": integrator})
    arm, simulation = scenario.arm, vff.Simulation(scenario)
    anchor = held_point(arm, simulation.state.q)[0] + np.sqrt(2.0 / stiffness) * np.array([0.6, -0.8])
    simulation.pull("link_2", point=POINT, anchor=anchor, stiffness=stiffness, damping=0.0)

    def energy(state: Any) -> float:
        away = anchor - held_point(arm, state.q)[0]
        kinetic = 0.5 * state.dq @ arm.mass_matrix(state.q) @ state.dq
        return float(kinetic + 0.5 * stiffness * away @ away)

    found = np.array([energy(simulation.step(np.zeros(3))) for _ in range(1000)])
    assert found.min() > 0.5 and np.ptp(arm.mass_matrix(simulation.state.q)) > 0.0
    if integrator == "rk4":
        assert np.diff(found).max() < 1e-9
    bound = {("rk4", 50.0): 1e-9, ("rk4", 1e5): 1e-3}.get((integrator, stiffness), 0.2)
    np.testing.assert_allclose(found, 1.0, rtol=bound)


def test_its_damping_takes_energy_out() -> None:
    """With K = 10⁶ N/m and overdamped, the point is where it is pulled within a second, and at rest."""
    scenario = vff.Scenario.from_dict(PLANE)
    simulation = vff.Simulation(scenario)
    anchor = held_point(scenario.arm, simulation.state.q)[0] + np.array([0.02, -0.03])
    simulation.pull("link_2", point=POINT, anchor=anchor, stiffness=1e6, damping=2e4)
    for _ in range(1000):
        state = simulation.step(np.zeros(3))
    place, J = held_point(scenario.arm, state.q)
    np.testing.assert_allclose(place, anchor, atol=1e-5)
    assert np.abs(J @ state.dq).max() < 1e-3


def test_a_hand_that_pulls_the_elbow_feels_what_holds_the_arm() -> None:
    """At rest, error = K⁻¹ J M⁻¹ τ_ext (T144), with the torque of the spring as it is stretched then."""
    simulation = vff.Simulation(PANDA)
    start = PANDA.arm.link_poses(simulation.state.q)[3, :3, 3]
    anchor = start + np.array([0.0, 0.12, 0.0])
    simulation.pull("panda_link4", anchor=anchor, stiffness=150.0, damping=30.0)
    for _ in range(6000):
        state = simulation.step()
    arm, q = PANDA.arm, state.q
    place = arm.link_poses(q)[3, :3, 3]
    assert 0.005 < np.linalg.norm(place - start) and np.linalg.norm(anchor - place) > 0.005
    h, J = 1e-6, np.zeros((3, 7))
    for i in range(7):
        d = h * np.eye(7)[i]
        J[:, i] = (arm.link_poses(q + d)[3, :3, 3] - arm.link_poses(q - d)[3, :3, 3]) / (2 * h)
    np.testing.assert_allclose(state.tau_ext, J.T @ (150.0 * (anchor - place)), atol=1e-3)
    felt = arm.jacobian(q) @ np.linalg.solve(arm.mass_matrix(q), state.tau_ext)
    np.testing.assert_allclose((state.x - state.x_ref)[:3], (felt / 900.0)[:3], atol=1e-5)


def origin(arm: vff.Arm, link: int, q: Array) -> Array:
    """Where a link begins (D,) [m]."""
    return np.asarray(
        arm.forward_kinematics(q)[link] if arm.dimension == 2 else arm.link_poses(q)[link, :3, 3]
    )


@pytest.mark.parametrize("name", ["panda-sweep", "swing"])
def test_what_nobody_says_suits_the_arm(name: str) -> None:
    """K = 100 1/s² times the mean mass that the point resists with, so that every arm is pulled alike."""
    scenario = vff.Scenario.load(name)
    simulation, arm, h = vff.Simulation(scenario), scenario.arm, 1e-6
    q, size = simulation.state.q, arm.dimension
    link = arm.link_names[3] if size == 3 else "link_4"
    assert np.all(simulation.pull(link).tau_ext == 0.0), "it pulls already"
    ways = h * np.eye(arm.n)
    J = np.stack([(origin(arm, 3, q + d) - origin(arm, 3, q - d)) / (2 * h) for d in ways], axis=1)
    K = 100.0 * size / np.trace(J @ np.linalg.solve(arm.mass_matrix(q), J.T))
    offset = 0.1 * np.arange(1.0, size + 1.0)
    state = simulation.pull(link, anchor=origin(arm, 3, q) + offset)
    np.testing.assert_allclose(state.tau_ext, J.T @ (K * offset), atol=1e-6 * K)


def test_what_makes_no_sense_is_refused_and_the_hand_goes_on() -> None:
    simulation = vff.Simulation(PANDA)
    place = PANDA.arm.link_poses(simulation.state.q)[3, :3, 3]
    held = simulation.pull("panda_link4", anchor=place + np.array([0.0, 0.1, 0.0])).tau_ext
    with pytest.raises(ScenarioError, match=r"pull\.link.*panda_link4"):
        simulation.pull("elbow")
    with pytest.raises(ScenarioError, match=r"pull\.stiffness"):
        simulation.pull("tip", stiffness=-1.0)
    with pytest.raises(ScenarioError, match=r"pull\.damping"):
        simulation.pull("tip", damping=-1.0)
    with pytest.raises(ScenarioError, match=r"pull\.anchor"):
        simulation.pull("tip", anchor=[0.0, 1.0])
    np.testing.assert_array_equal(simulation.state.tau_ext, held)
    assert simulation.reset().tau_ext is None
