"""Obstacles that are felt: closed forms, energy, friction, and MuJoCo (docs/theory.md, T147, T148)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError

Array = np.ndarray[Any, np.dtype[np.float64]]

G = 9.81
FLOOR = -0.3  # the top of the box that the pendulum falls on [m]


def pendulum(contact: dict[str, float], **changes: Any) -> vff.Scenario:
    """A rod of 1 m and 1 kg, 0.1 m thick, above a floor; nothing drives it."""
    document: dict[str, Any] = {
        "duration": 100.0,
        "q0": [0.0],
        "arm": {"lengths": [1.0], "masses": [1.0], "radius": 0.05, "gravity": G},
        "controller": {"stiffness": 1.0, "damping": 1.0},
        "reference": {"kind": "setpoint", "point": [1.0, 0.0], "unreachable": "warn"},
        "obstacles": [
            {
                "shape": {"kind": "box", "size": [10.0, 1.0]},
                "position": [0.0, FLOOR - 0.5],
                "contact": contact,
            }
        ],
        "simulation": {"dt": 1e-3, "control": "hold", "integrator": "rk4"},
    }
    return vff.Scenario.from_dict(document | changes)


def energy(state: Any, stiffness: float) -> float:
    """Of the rod and of the floor that its end presses in [J]."""
    (q,), (dq,) = state.q, state.dq
    depth = max(0.0, FLOOR + 0.05 - np.sin(q))
    return float(0.5 * dq * dq / 3 + G * 0.5 * np.sin(q) + 0.5 * stiffness * depth * depth)


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7])
def test_what_leans_is_in_balance(stiffness: float) -> None:
    """The floor carries half of the weight, and gives way by force over stiffness."""
    simulation = vff.Simulation(pendulum({"stiffness": stiffness, "damping": 20.0, "friction": 0.0}))
    for _ in range(6000):
        state = simulation.step(np.zeros(1))
    assert abs(state.dq[0]) < 1e-3
    force = 0.5 * G
    np.testing.assert_allclose(state.contact_force, [[0.0, force]], atol=2e-2)
    assert -state.clearance[0] == pytest.approx(force / stiffness, rel=5e-3)
    np.testing.assert_allclose(state.tau_ext, [state.contact_force[0, 1] * np.cos(state.q[0])], rtol=1e-2)


@pytest.mark.parametrize("stiffness", [1e3, 1e5, 1e7])
def test_nothing_is_lost_where_nothing_damps(stiffness: float) -> None:
    """Over several bounces, potential energy of the floor included, within 2 % of the 1.2 J of the first."""
    simulation = vff.Simulation(pendulum({"stiffness": stiffness, "damping": 0.0, "friction": 0.0}))
    start, bounces, pressed = energy(simulation.state, stiffness), 0, False
    for _ in range(2000):
        state = simulation.step(np.zeros(1))
        touches = bool(state.contact_force[0, 1] > 0.0)
        bounces += touches and not pressed
        pressed = touches
        assert energy(state, stiffness) == pytest.approx(start, abs=0.024)
    assert bounces >= 2


def test_what_is_lost_is_what_the_damping_takes() -> None:
    """By one bounce: ∫ K δ a δ'² dt, with steps so small that their sum is this integral; and the speed after
    it is about 1 − ⅔ a v of that before.
    """
    stiffness, damping = 1e4, 0.1
    contact = {"stiffness": stiffness, "damping": damping, "friction": 0.0}
    scenario = pendulum(contact, simulation={"dt": 1e-5, "control": "hold", "integrator": "rk4"})
    simulation = vff.Simulation(scenario.replace(q0=[-0.15]))
    start, taken, before, state = energy(simulation.state, stiffness), 0.0, 0.0, simulation.state
    for _ in range(60_000):
        state = simulation.step(np.zeros(1))
        sinks = -state.dq[0] * np.cos(state.q[0])
        depth = max(0.0, FLOOR + 0.05 - np.sin(state.q[0]))
        taken += 1e-5 * stiffness * depth * damping * sinks * sinks
        if depth == 0.0 and sinks > 0.0:
            before = sinks
        if depth == 0.0 and before > 0.0 and sinks < 0.0:
            break
    assert taken > 0.02 * before**2
    assert start - energy(state, stiffness) == pytest.approx(taken, rel=1e-3)
    assert -sinks / before == pytest.approx(1.0 - 2.0 / 3.0 * damping * before, abs=0.02)


def test_a_link_that_lies_on_a_face_has_two_feet() -> None:
    """Turned a little to either side, both ends press, and nothing jumps where the nearest point does."""
    level = pendulum({"stiffness": 1e5, "damping": 0.0}).to_dict()
    level["obstacles"][0]["position"] = [0.0, -0.5 - 0.05 + 1e-3]  # 1 mm into the rod
    felt = []
    for angle in (-1e-9, 1e-9):
        state = vff.Simulation(level | {"q0": [angle]}).state
        np.testing.assert_allclose(state.contact_force, [[0.0, 200.0]], rtol=1e-4)
        felt.append(state.tau_ext[0])
    np.testing.assert_allclose(felt, 100.0, rtol=1e-4)


def test_friction_holds_back_along_the_surface() -> None:
    """Coulomb's at speed, a fluid's below a millimetre per second."""
    for speed, share in ((0.5, 1.0), (1e-4, 0.0995)):
        moving = {"kind": "linear", "velocity": [speed, 0.0]}
        document = pendulum({"stiffness": 1e4, "friction": 0.4, "damping": 0.0}).to_dict()
        document["obstacles"][0] |= {"motion": moving, "position": [0.0, -0.5 - 0.05 + 1e-3]}
        state = vff.Simulation(document | {"q0": [-1e-6]}).state
        normal, along = state.contact_force[0, 1], state.contact_force[0, 0]
        assert along == pytest.approx(0.4 * share * normal, rel=1e-3)


def test_an_obstacle_pushes_the_arm_along() -> None:
    """One that comes at 0.2 m/s takes the end of the rod with it, as deep as the force needs."""
    moving = {"kind": "linear", "velocity": [0.0, 0.2]}
    document = pendulum({"friction": 0.0, "damping": 20.0}).to_dict()
    document["obstacles"][0]["motion"] = moving
    document["q0"] = [-0.25]
    simulation = vff.Simulation(document)
    for _ in range(900):
        state = simulation.step(np.zeros(1))
    assert np.sin(state.q[0]) == pytest.approx(FLOOR + 0.05 + 0.18, abs=2e-3)
    assert state.contact_force[0, 1] == pytest.approx(0.5 * G, rel=0.2)


TABLE = {
    "shape": {"kind": "half_space", "normal": [0.0, 0.0, 1.0]},
    "position": [0.0, 0.0, 0.0],
    "contact": {"stiffness": 1e5, "damping": 5.0, "friction": 0.0},
}


def leaning(stiffness: float = 1e5) -> vff.Scenario:
    """A Panda whose hand is to be 3 cm further than a wall in front of it lets it."""
    scenario = vff.Scenario.load("panda-sweep")
    document = scenario.to_dict()
    capsules = vff.distances(scenario.arm, document["q0"], np.zeros(7), [wall(2.0)])
    ahead = 2.0 - float(capsules.distance.min())  # how far the arm reaches forward
    x = scenario.arm.forward_kinematics(document["q0"])[-1]
    goal = {"kind": "line", "end": [float(x[0]) + 0.03, float(x[1]), float(x[2])], "duration": 1.0}
    return scenario.replace(
        obstacles=[wall(ahead, stiffness)], reference=goal, duration=4.0, **{"controller.field.gain": 0.0}
    )


def wall(x: float, stiffness: float = 1e5) -> dict[str, Any]:
    return {
        "shape": {"kind": "half_space", "normal": [-1.0, 0.0, 0.0]},
        "position": [x, 0.0, 0.0],
        "contact": {"stiffness": stiffness, "damping": 5.0, "friction": 0.0},
    }


@pytest.mark.parametrize("stiffness", [1e5, 1e6])
def test_a_hand_leans_on_a_wall_as_stiffly_as_its_task_is(stiffness: float) -> None:
    """F = K δ, and what the hand lacks is what this force displaces it by (T144). MuJoCo's contact, of
    the same stiffness, answers with the same force.
    """
    scenario = leaning(stiffness)
    result = vff.simulate(scenario)
    assert result.contact_force is not None and result.tau_ext is not None
    assert np.abs(result.dq[-1]).max() < 1e-3
    force, depth = result.contact_force[-1, 0], -float(result.clearance[-1].min())
    assert force[0] < -50.0 and np.abs(force[1:]).max() < 1e-6
    assert 1.0 - 1e-9 < -force[0] / stiffness / depth < 1.05  # both ends of the hand press
    arm, q = scenario.arm, result.q[-1]
    J = arm.jacobian(q)
    felt = J @ np.linalg.solve(arm.mass_matrix(q), result.tau_ext[-1])
    np.testing.assert_allclose(result.error[-1], felt / 900.0, atol=2e-5)
    pytest.importorskip("mujoco")
    theirs = vff.simulate(scenario, plant="mujoco")
    assert theirs.contact_force is not None and theirs.tau_ext is not None
    assert np.linalg.norm(theirs.contact_force[-1, 0] - force) < 0.01 * abs(force[0])
    felt = theirs.scenario.arm.jacobian(theirs.q[-1]) @ np.linalg.solve(
        arm.mass_matrix(theirs.q[-1]), theirs.tau_ext[-1]
    )
    np.testing.assert_allclose(theirs.error[-1], felt / 900.0, atol=1e-4)
    assert np.linalg.norm(theirs.error[-1][:3] - result.error[-1][:3]) < 0.1 * depth + 1e-5


def test_obstacles_that_come_and_go_are_felt(tmp_path: Any) -> None:
    """On the live loop: one that is felt is put over the hand and taken away again."""
    live = vff._core.Live(leaning().replace(obstacles=None))
    live.add(wall(0.0))  # the arm is inside
    live.remove(0)
    live.add({key: value for key, value in wall(5.0).items() if key != "contact"})
    assert live.snapshot()["status"] in ("running", "paused")


def test_python_says_the_same() -> None:
    table = vff.Obstacle.half_space([0.0, 0.0, 0.0], [0.0, 0.0, 1.0]).with_contact(
        stiffness=1e5, damping=5.0, friction=0.0
    )
    assert table.to_dict() == TABLE
    assert "contact" in repr(table) and vff.Obstacle.circle([0, 1], 0.2).contact is None
    assert vff.Obstacle.circle([0, 1], 0.2).with_contact().to_dict()["contact"] == {}


@pytest.mark.parametrize(
    ("contact", "path"),
    [
        ({"stiffness": 0.0}, "stiffness"),
        ({"damping": -1.0}, "damping"),
        ({"friction": -0.1}, "friction"),
        ({"friction": float("nan")}, "friction"),
        ({"softness": 1.0}, "softness"),
        ("hard", ""),
    ],
)
def test_what_makes_no_sense_is_refused(contact: Any, path: str) -> None:
    document = pendulum({}).to_dict()
    document["obstacles"][0]["contact"] = contact
    with pytest.raises(ScenarioError, match=rf"obstacles\[0\]\.contact.*{path}"):
        vff.Scenario.from_dict(document)
    with pytest.raises(ScenarioError, match=rf"contact.*{path}"):
        vff._core.check("obstacle", document["obstacles"][0], 2)
