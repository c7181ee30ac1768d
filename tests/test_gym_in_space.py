"""The Gymnasium environments of arms in space: what an agent sees and does, and that many are as one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vffnull as vff
from vffnull.engines.gym import ReachEnv, ReachVectorEnv

EXACT: dict[str, Any] = {"start_noise": 0.0, "obstacle_noise": 0.0}
WIDTHS = {"position": 3, "pointing": 5, "pose": 6}


@pytest.mark.parametrize("task", WIDTHS)
def test_no_action_is_the_run_of_the_scenario(task: str) -> None:
    """To the last bit; and every part of the observation is what the record has."""
    scenario = vff.Scenario.load("panda-sweep").replace(
        **{"controller.task": task, "simulation.record_every": 1, "duration": 1.5}
    )
    result = vff.simulate(scenario)
    env = ReachEnv(scenario, **EXACT)
    env.reset()
    rows = round(env.period / scenario["simulation"]["dt"])
    for k in range(1, 151):
        observation, _, _, truncated, info = env.step(np.zeros(7))
        part = {name: observation[where] for name, where in env.layout.items()}
        row = rows * k
        np.testing.assert_array_equal(part["dq"], result.dq[row])
        np.testing.assert_array_equal(part["tip"], result.x[row])
        np.testing.assert_array_equal(part["reference"], result.x_ref[row])
        assert part["error"].shape == (WIDTHS[task],)
        np.testing.assert_array_equal(part["error"], result.error[row])
        np.testing.assert_array_equal(part["clearance"], result.clearance[row])
        np.testing.assert_array_equal(part["obstacles"], result.obstacles[row].ravel())
        np.testing.assert_array_equal(part["obstacle_velocities"], [0.0, 0.2, 0.0])
        np.testing.assert_allclose(np.arctan2(part["sin_q"], part["cos_q"]), result.q[row], atol=1e-14)
        if task == "position":
            assert "tip_axes" not in part
        else:
            columns = [0, 1] if task == "pose" else [2]
            for name, wxyz in (("tip", result.orientation), ("reference", result.orientation_ref)):
                axes = Rotation.from_quat(wxyz[row], scalar_first=True).as_matrix().T[columns]
                np.testing.assert_allclose(part[f"{name}_axes"].reshape(-1, 3), axes, atol=1e-12)
            assert part["reference_angular_velocity"].shape == (WIDTHS[task] - 3,)
        assert info["clearance"] == result.clearance[row - rows + 1 : row + 1].min()
    assert truncated


def test_pressing_is_no_end_and_the_estimate_is_seen() -> None:
    """Where the tip presses on a table as it is asked to, the episode goes on; the estimate is observed."""
    env = ReachEnv("panda-wipe", **EXACT)
    _, info = env.reset()
    assert info["clearance"] > 0.0
    result = vff.simulate("panda-wipe", {"simulation.record_every": 1, "duration": 2.0})
    assert result.tau_ext_estimate is not None and result.clearance.min() < 0.0
    rows = round(env.period / env.scenario["simulation"]["dt"])
    for k in range(1, 150):
        observation, _, terminated, _, info = env.step(np.zeros(7))
        assert not terminated and info["clearance"] > 0.0
        seen = observation[env.layout["tau_ext_estimate"]]
        np.testing.assert_array_equal(seen, result.tau_ext_estimate[rows * k])
    blind = {"controller.field.gain": 0.0, "obstacles.1.position": [-0.05, -0.4, 0.62]}
    hit = ReachEnv("panda-wipe", blind, **EXACT)
    hit.reset()
    assert any(hit.step(np.zeros(7))[2] for _ in range(300))


def test_what_is_not_seen_is_not_observed() -> None:
    """Of a scene with an obstacle that the controller does not see there are the clearances to the others."""
    env = ReachEnv("panda-bump", **EXACT)
    observation, _ = env.reset()
    assert env.observation_space.contains(observation)
    assert "clearance" in env.layout and "obstacles" not in env.layout
    alone = ReachEnv("panda-bump", {"obstacles": env.scenario["obstacles"][1:]}, **EXACT)
    expected, _ = alone.reset()
    np.testing.assert_array_equal(observation[env.layout["clearance"]], expected[alone.layout["clearance"]])


def test_the_reference_turns_as_it_is_seen_to() -> None:
    """iiwa-line turns its hand: the observed rate is that of the axes, ω × a, by central differences."""
    env = ReachEnv("iiwa-line", {"obstacles": []}, **EXACT)
    env.reset()
    seen = [env.step(np.zeros(7))[0] for _ in range(100)]
    axes = np.array([each[env.layout["reference_axes"]].reshape(2, 3) for each in seen])
    omega = np.array([each[env.layout["reference_angular_velocity"]] for each in seen])
    assert np.linalg.norm(omega, axis=1).max() > 0.05
    change = (axes[2:] - axes[:-2]) / (2 * env.period)
    np.testing.assert_allclose(change, np.cross(omega[1:-1, None], axes[1:-1]), atol=2e-4)


def test_a_joint_that_slides_is_seen_in_metres() -> None:
    """It has no angle: its position stands in `slide`, those of the others in cosine and sine."""
    body = {"mass": 1.0, "com": [0.0, 0.0, 0.1], "inertia": [0.02, 0.02, 0.02, 0.0, 0.0, 0.0]}
    kinds = ("revolute", "revolute", "prismatic", "revolute")
    joints = [
        {"name": f"joint {k}", "kind": kind, "position": [0, 0, 0.3], "axis": [0, k % 2, 1 - k % 2], **body}
        for k, kind in enumerate(kinds)
    ]
    document = {
        "arm": {"joints": joints, "tool": {"position": [0, 0, 0.2]}},
        "q0": [0.1, 0.8, 0.15, 0.5],
        "duration": 0.5,
        "controller": {"task": "position", "stiffness": 50.0, "damping": 14.0},
        "reference": {"kind": "setpoint"},
    }
    env = ReachEnv(vff.Scenario.from_dict(document), **EXACT)
    observation, _ = env.reset()
    part = {name: observation[where] for name, where in env.layout.items()}
    np.testing.assert_allclose(np.arctan2(part["sin_q"], part["cos_q"]), [0.1, 0.8, 0.5], atol=1e-15)
    np.testing.assert_array_equal(part["slide"], [0.15])
    assert part["dq"].shape == (4,)


def test_the_way_to_the_nearest_obstacle_is_the_distance_s() -> None:
    """From the axis of a link to the ball's surface, as `distances` measures it."""
    env = ReachEnv("panda-sweep", **EXACT)
    env.reset()
    for _ in range(100):
        observation, *_ = env.step(np.zeros(7))
    way = observation[env.layout["nearest"]].reshape(7, 3)
    q = np.arctan2(observation[env.layout["sin_q"]], observation[env.layout["cos_q"]])
    ball = vff.Obstacle.sphere(observation[env.layout["obstacles"]], 0.08)
    found = vff.distances(env.scenario.arm, q, [0.0] * 7, [ball])
    for link in range(7):
        mine = found.link == link
        each = int(np.flatnonzero(mine)[found.distance[mine].argmin()])
        clearance = observation[env.layout["clearance"]][link]
        assert clearance == pytest.approx(found.distance[each], abs=1e-12)
        direction = way[link] / np.linalg.norm(way[link])
        np.testing.assert_allclose(direction, -found.normal[each], atol=1e-9)


@pytest.mark.parametrize("task", WIDTHS)
def test_a_null_space_action_leaves_the_task_alone(task: str) -> None:
    """J M⁻¹ Nᵀ = 0: the hand stays, whatever the agent does to the elbow; unprojected it does not."""
    quiet = {"duration": 1.0, "obstacles": [], "controller.task": task, "simulation.dt": 2e-4}
    errors = {}
    for kind in ("dynamic", "none"):
        env = ReachEnv("panda-sweep", quiet | {"controller.projection": kind}, **EXACT, torque=1.5)
        first, info = env.reset()
        for _ in range(100):
            observation, _, _, _, info = env.step(np.array([1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0]))
        moved = np.abs(observation - first)[env.layout["sin_q"]].max()
        errors[kind] = info["tracking_error"]
        assert moved > 0.01, kind
    assert errors["dynamic"] < 1e-4 < 2e-4 < errors["none"]


def test_a_torque_action_is_the_torque() -> None:
    """As `Simulation.step` with the same torque, to the last bit; beyond ±1 it stays at ±1."""
    torque = [20.0, 20.0, 15.0, 15.0, 3.0, 3.0, 2.0]
    env = ReachEnv("panda-sweep", action="torque", period=1e-3, torque=torque, **EXACT)
    env.reset()
    plant = vff.Simulation(vff.Scenario.load("panda-sweep"))
    action = np.array([0.1, -2.0, 1.0, 0.0, -0.25, 3.0, 0.5])
    for _ in range(100):
        observation, *_ = env.step(action)
        state = plant.step(np.clip(action, -1.0, 1.0) * env.torque)
        np.testing.assert_array_equal(observation[env.layout["dq"]], state.dq)


@pytest.mark.parametrize("action", ["null_space", "torque"])
@pytest.mark.parametrize("threads", [1, 3])
def test_many_are_as_one(action: Any, threads: int) -> None:
    """Environment i of the core's vector is `ReachEnv` with the seed 5 + i, to the last bit."""
    settings: dict[str, Any] = {"action": action, "torque": 2.0, "overrides": {"duration": 0.3}}
    many = ReachVectorEnv(4, "panda-pointing", threads=threads, **settings)
    ones = [ReachEnv("panda-pointing", **settings) for _ in range(4)]
    observations, _ = many.reset(seed=5)
    for i, env in enumerate(ones):
        np.testing.assert_array_equal(observations[i], env.reset(seed=5 + i)[0])
    generator = np.random.default_rng(2)
    for _ in range(30):
        actions = generator.uniform(-1.0, 1.0, (4, 7))
        observations, rewards, terminated, truncated, infos = many.step(actions)
        for i, env in enumerate(ones):
            one, reward, over, cut, info = env.step(actions[i])
            np.testing.assert_array_equal(observations[i], one)
            assert (rewards[i], terminated[i], truncated[i]) == (reward, over, cut)
            assert infos["tracking_error"][i] == info["tracking_error"]
    assert truncated.all() and not terminated.any()


@pytest.mark.parametrize("name", sorted(vff._core.ARMS))
def test_an_action_of_one_is_a_torque_that_the_arm_is_made_for(name: str) -> None:
    """By default every joint is carried against gravity and accelerated a little, within its limit, so that
    whatever an untrained agent does for half a second is no explosion."""
    arm = vff.Arm.named(name)
    q0 = [0.3, -0.5, 0.2, -1.4, 0.1, 0.9, 0.2][: arm.n]
    scenario = {
        "arm": {"model": name},
        "q0": q0,
        "duration": 1.0,
        "controller": {"task": "position", "stiffness": 50.0, "damping": 14.0},
        "reference": {"kind": "setpoint"},
    }
    env = ReachEnv(scenario, action="torque", **EXACT)
    limits = np.asarray(arm.torque_limits)
    assert np.all(env.torque <= limits) and np.all(env.torque > 0.0)
    weight = np.max([np.abs(arm.gravity_torque(q)) for q in (np.asarray(q0), 0.5 * np.asarray(q0))], axis=0)
    assert np.all(env.torque > np.minimum(0.9 * weight, 0.99 * limits))
    generator = np.random.default_rng(1)
    env.reset(seed=1)
    for _ in range(50):
        _, _, terminated, _, info = env.step(generator.choice([-1.0, 1.0], arm.n))
        assert not terminated and not info["diverged"]


def test_full_torque_limits_throw_a_wrist_about() -> None:
    """Why they are not the default: the wrist of a UR5e is too fast after a few hundredths of a second."""
    arm = vff.Arm.named("ur5e")
    env = ReachEnv("ur5e-sweep", action="torque", torque=arm.torque_limits, **EXACT)
    env.reset()
    assert any(env.step(np.ones(6))[4]["diverged"] for _ in range(10))
