"""What giving way, looking ahead, learning and the clock do with an arm in space."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff

MARGIN = 0.02  # m, the default

# A ball through the hand, where no null space helps.
AT_THE_HAND: dict[str, Any] = {
    "obstacles.0.position": [0.26, -0.5, 0.54],
    "obstacles.0.motion.velocity": [0.0, 0.4, 0.0],
    "duration": 5.0,
}


def ball(radius: float, position: list[float], velocity: list[float]) -> dict[str, Any]:
    return {
        "shape": {"kind": "sphere", "radius": radius},
        "position": position,
        "motion": {"kind": "linear", "velocity": velocity},
    }


# Three balls that close round the elbow; who waits until they are near is caught.
CLOSING: dict[str, Any] = {
    "obstacles": [
        ball(0.09, [-0.88, -0.66, 0.69], [0.34, 0.28, -0.05]),
        ball(0.08, [-0.21, 0.87, 0.86], [0.16, -0.35, -0.06]),
        ball(0.10, [-0.70, -1.09, 0.90], [0.48, 0.50, -0.08]),
    ],
    "controller.task": "position",
    "controller.avoidance": "cbf",
    "duration": 4.0,
}


@pytest.mark.parametrize("task", ["position", "pointing", "pose"])
def test_a_hand_in_the_way_gives_way_and_comes_back(task: str) -> None:
    """`cbf` keeps the margin to a millimetre without violating a row, within the limits of the arm."""
    changes = AT_THE_HAND | {"controller.task": task}
    hit = vff.simulate("panda-sweep", changes)
    assert hit.metrics.min_clearance < -0.03 and hit.slack is None
    result = vff.simulate("panda-sweep", changes | {"controller.avoidance": "cbf"})
    assert result.status == "completed" and result.slack is not None
    assert result.metrics.min_clearance > MARGIN - 1e-3
    assert result.metrics.slack_steps == 0
    assert 0.01 < np.abs(result.error).max() < 0.2
    assert np.abs(result.error[-1]).max() < 1e-4
    assert result.metrics.joint_limit_violation == 0.0
    assert result.metrics.torque_limit_ratio <= 1.0
    # One that acts is kept as far as the acceleration stays the same while a torque is held.
    assert result.metrics.velocity_limit_ratio <= 1.0 + 1e-4


def test_where_the_null_space_suffices_the_hand_does_not_notice() -> None:
    result = vff.simulate("panda-sweep", {"controller.avoidance": "cbf"})
    assert result.metrics.min_clearance > 0.1 and result.metrics.max_slack == 0.0
    assert np.abs(result.error).max() < 2e-5


def test_a_look_ahead_finds_the_way_out() -> None:
    late = vff.simulate("panda-sweep", CLOSING)
    assert late.status == "collided" and late.metrics.max_slack > 10
    ahead = vff.simulate("panda-sweep", CLOSING | {"controller.yielding": {"preview": {}}})
    assert ahead.status == "completed"
    assert ahead.metrics.min_clearance > MARGIN - 1e-3 and ahead.metrics.slack_steps == 0
    assert np.abs(ahead.error).max() < 0.01 < np.abs(late.error).max()


def test_a_reference_waits_for_the_hand() -> None:
    line = {"kind": "line", "end": [0.0, 0.2, 0.0], "duration": 3.0, "relative": True}
    changes = AT_THE_HAND | {"reference": line, "controller.avoidance": "cbf"}
    result = vff.simulate("panda-sweep", changes | {"controller.governor": {}})
    assert result.path_time is not None
    assert result.t[-1] - result.path_time[-1] > 0.05
    assert result.metrics.min_clearance > MARGIN - 1e-3
    assert np.abs(result.error[-1]).max() < 1e-3


def test_many_are_the_same_as_one() -> None:
    gains = [{"controller.field.gain": gain, "duration": 4.0} for gain in (0.0, 80.0)]
    many = vff.simulate_many("panda-sweep", gains)
    table = vff.metrics_table(many, ["controller.field.gain"])
    for changes, result, clearance in zip(gains, many, table["min_clearance"], strict=True):
        one = vff.simulate("panda-sweep", changes)
        assert result.q.tobytes() == one.q.tobytes() and clearance == one.metrics.min_clearance
    assert table["status"].tolist() == ["collided", "completed"]


@pytest.mark.parametrize("scenario", ["panda-sweep", "panda-pointing", "ur5e-sweep"])
def test_an_action_in_the_null_space_leaves_the_task_alone(scenario: str) -> None:
    """Whatever an agent tries; through the joints it moves the tip."""
    gymnasium = pytest.importorskip("gymnasium")
    moved = {}
    for action in ("null_space", "torque"):
        env = gymnasium.make("vffnull.engines.gym:vffnull/Reach-v0", scenario=scenario, action=action)
        observation, _ = env.reset(seed=1)
        env.action_space.seed(1)
        errors = []
        for _ in range(20):
            observation, reward, terminated, _, _ = env.step(env.action_space.sample())
            assert env.observation_space.contains(observation) and np.isfinite(reward)
            errors.append(np.abs(observation[env.unwrapped.layout["error"]]).max())
            if terminated:
                break
        moved[action] = max(errors)
    assert moved["null_space"] < 1e-3 and moved["torque"] > 10 * moved["null_space"]


def test_environments_side_by_side() -> None:
    gymnasium = pytest.importorskip("gymnasium")
    name = "vffnull.engines.gym:vffnull/Reach-v0"
    single = gymnasium.make(name, scenario="panda-sweep")
    together = gymnasium.make_vec(name, num_envs=3, scenario="panda-sweep")
    seen, _ = together.reset(seed=5)
    actions = np.random.default_rng(0).uniform(-1, 1, (3, 7))
    after = together.step(actions)[0]
    for i in range(3):
        np.testing.assert_array_equal(single.reset(seed=5 + i)[0], seen[i])
        np.testing.assert_array_equal(single.step(actions[i])[0], after[i])


def test_against_the_clock() -> None:
    timing = vff.realtime("panda-sweep", seconds=0.1)
    assert timing.periods == 100 and timing.min_clearance > 0.1


@pytest.mark.parametrize("end", [[0.0, 0.4, 0.0], [0.1, 0.2, -0.35]])
def test_a_posture_spring_does_not_slow_the_hand_down(end: list[float]) -> None:
    """Held joints go nowhere near their speed limits: the hand keeps to its path as if there were none.

    While the speeds of task and null motion were added without their signs, it fell 9 cm behind.
    """
    ready = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
    result = vff.simulate(
        {
            "duration": 2.0,
            "q0": ready,
            "arm": {"model": "panda"},
            "controller": {
                "stiffness": 400.0,
                "damping": 40.0,
                "null_damping": 6.0,
                "posture": ready,
                "posture_stiffness": 20.0,
            },
            "reference": {"kind": "line", "end": end, "duration": 1.5, "relative": True},
            "simulation": {"integrator": "semi_implicit_euler"},
        }
    )
    assert result.metrics.velocity_limit_ratio < 0.8  # type: ignore[operator]
    assert np.linalg.norm(result.error, axis=1).max() < 5e-4


def test_the_shell_knows_arms_in_space(tmp_path: Path) -> None:
    """A scenario shown, checked, changed, run and timed; pictures have tests of their own."""

    def shell(*words: str) -> str:
        command = [sys.executable, "-c", "from vffnull.cli import main; main()", *words]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        return done.stdout

    (tmp_path / "mine.toml").write_text(shell("show", "panda-sweep"), encoding="utf-8")
    assert "mine.toml: valid" in shell("validate", "mine.toml")
    short = ("--set", "duration=0.2")
    run = json.loads(shell("run", "mine.toml", *short, "--save", "run.npz", "--json"))
    assert run["status"] == "completed" and run["metrics"]["min_clearance"] > 0.1
    assert vff.Result.load(tmp_path / "run.npz").x.shape[1] == 3
    assert "wake-up" in shell("realtime", "mine.toml", "--seconds", "0.1")
