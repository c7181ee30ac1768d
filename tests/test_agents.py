"""What an agent sends beside the law, or in its place: limits hold as without it, the observer is told."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff

pytest.importorskip("gymnasium")

from vffnull.engines.gym import ReachEnv

EXACT: dict[str, Any] = {"start_noise": 0.0, "obstacle_noise": 0.0}
LIMITS = np.array([130.0, 90.0, 60.0, 30.0, 15.0])


def angles(env: ReachEnv, observation: np.ndarray) -> np.ndarray:
    return np.arctan2(observation[env.layout["sin_q"]], observation[env.layout["cos_q"]])


def planar(**controller: Any) -> vff.Scenario:
    q0 = [0.9, -0.5, -0.5, -0.4, 0.6]
    along = np.cumsum(q0)
    tip = [0.6 * float(np.cos(along).sum()), 0.6 * float(np.sin(along).sum())]
    return vff.Scenario(
        arm={
            "lengths": [0.6] * 5,
            "masses": 1.5,
            "radius": 0.03,
            "gravity": 9.81,
            "torque_limits": list(LIMITS),
        },
        q0=q0,
        duration=2.0,
        controller={"stiffness": 100.0, "damping": 20.0} | controller,
        reference={"kind": "setpoint", "point": tip},
        simulation={"dt": 1e-3, "control": "hold", "integrator": "semi_implicit_euler"},
    )


def test_torque_limits_hold_with_an_agent() -> None:
    """The torque at the joints, by hand, from rest: M q̈ + g. What the agent wants is cut as a whole."""
    scenario = planar()
    env = ReachEnv(scenario, period=1e-3, **EXACT)
    random = np.random.default_rng(0)
    law = vff.simulate(scenario).tau[0]
    arm, largest = env.scenario.arm, 0.0
    gravity = np.asarray(arm.gravity_torque(scenario["q0"]))
    for _ in range(60):
        first, _ = env.reset(seed=0)
        then, *_ = env.step(random.choice([-1.0, 1.0], 5))
        q = angles(env, first)
        tau = arm.mass_matrix(q) @ (then[env.layout["dq"]] / 1e-3) + gravity
        assert np.all(np.abs(tau) <= LIMITS * (1.0 + 1e-9))
        # The rest is in the null space: nothing of it moves the end effector.
        task = arm.jacobian(q) @ np.linalg.solve(arm.mass_matrix(q), tau - law)
        np.testing.assert_allclose(task, 0.0, atol=1e-7)
        largest = max(largest, np.abs(tau - law).max())
    assert largest > 1.0


def test_a_torque_rate_holds_with_an_agent() -> None:
    """1000 N·m/s of a Panda: what the agent wants comes and goes, and nothing changes faster."""
    env = ReachEnv("panda-sweep", {"controller.command": "of the robot"}, period=1e-3, **EXACT)
    observation, _ = env.reset(seed=0)
    arm, dq = env.scenario.arm, env.layout["dq"]
    taus, wanted = [], np.array([1.0, -1.0, 1.0, -1.0, 1.0, 1.0, 1.0])
    for k in range(80):
        q, before = angles(env, observation), observation[dq].copy()
        observation, *_ = env.step(np.zeros(7) if k // 20 % 2 else wanted)
        taus.append(arm.mass_matrix(q) @ ((observation[dq] - before) / 1e-3))
    rates = np.abs(np.diff(taus, axis=0)) / 1e-3
    assert 900.0 < rates.max() < 1050.0  # Coriolis terms are not part of what is reckoned here
    assert np.abs(taus[19] - taus[39]).max() > 3.0


def test_a_larger_torque_than_the_limit_is_refused() -> None:
    """Where the action is the torque; not where limits are not enforced, or where it is cut."""
    with pytest.raises(vff.errors.ScenarioError, match=r"torque: must be within the limit 15 of joint 4"):
        ReachEnv(planar(), action="torque", torque=20.0)
    with pytest.raises(vff.errors.ScenarioError, match=r"torque\[1\]"):
        ReachEnv(planar(), action="torque", torque=[1.0, 100.0, 1.0, 1.0, 1.0])
    ReachEnv(planar(), torque=20.0)
    ReachEnv(planar(enforce_limits=False), action="torque", torque=20.0)


@pytest.mark.parametrize("command", [{}, {"controller.command": "of the robot"}])
@pytest.mark.parametrize("action", ["null_space", "torque"])
def test_the_observer_knows_what_the_agent_sends(action: Any, command: dict[str, Any]) -> None:
    """Nobody pushes, and the model is exact: the estimate is near nothing, far below what is sent."""
    env = ReachEnv("panda-sweep", {"controller.observer": {}} | command, action=action, **EXACT)
    env.reset(seed=0)
    wanted = np.array([0.0, 0.0, 0.3, 0.0, 0.3, 0.0, 0.5])
    if action == "torque" and not command:  # nobody else carries the arm
        wanted += env.scenario.arm.gravity_torque(env.scenario["q0"]) / env.torque
    for _ in range(20):
        observation, *_ = env.step(wanted)
    estimate = np.abs(observation[env.layout["tau_ext_estimate"]])
    assert estimate.max() < 0.02 * (0.3 * env.torque).max()


def test_an_agent_is_not_felt_as_a_contact() -> None:
    """The hand of panda-bump gives way to pushes; where there is nothing it stays, whatever an agent does."""
    env = ReachEnv("panda-bump", {"obstacles": []}, **EXACT)
    env.reset(seed=0)
    random = np.random.default_rng(0)
    for _ in range(200):
        observation, _, terminated, truncated, info = env.step(random.choice([-1.0, 1.0], 7))
        assert info["tracking_error"] < 0.01
        if terminated or truncated:
            break
    assert np.abs(observation[env.layout["tau_ext_estimate"]]).max() < 1.0


def test_the_observer_knows_an_own_controller() -> None:
    """In a simulation stepped under torques of one's own, also where they differ within a control period."""
    for every in (1, 4):
        document = vff.Scenario.load("panda-sweep").to_dict()
        document["controller"]["observer"] = {}
        document["simulation"]["control_every"] = every
        simulation = vff.Simulation(document)
        gravity = np.asarray(vff.Arm.named("panda").gravity_torque(document["q0"]))
        for k in range(100):
            own = gravity + np.eye(7)[2] * (2 + k % 2)
            state = simulation.step(own)
        assert np.abs(state.tau_ext_estimate).max() < 0.2
        for _ in range(20):
            state = simulation.step()
        assert np.abs(state.tau_ext_estimate).max() < 0.2
