"""Plans for what is nearly nothing and what is nearly endless: rests, horizons, crowds and ranges."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError

READY = np.array([0.3, -0.785, 0.2, -2.356, 0.1, 1.571, 0.785])
PANDA = {"duration": 1.0, "q0": READY.tolist(), "arm": {"model": "panda"}, "reference": {"kind": "setpoint"}}
THREE: dict[str, Any] = {
    "duration": 1.0,
    "q0": [0.3, 0.4, 0.5],
    "arm": {"lengths": [1.0, 1.0, 1.0], "masses": 1.0, "radius": 0.05},
    "reference": {"kind": "setpoint", "point": [1.0, 1.0]},
}


def disc(place: Any, velocity: Any, radius: float = 0.1) -> dict[str, Any]:
    motion = {"kind": "linear", "velocity": list(velocity)}
    return {"shape": {"kind": "circle", "radius": radius}, "position": list(place), "motion": motion}


@pytest.mark.parametrize("seed", range(4))
def test_the_rest_before_a_straight_way_is_one_to_the_last_bit(seed: int) -> None:
    """Also where a joint is so near to 0 there that a cubic ends elsewhere by rounding."""
    draw = np.random.default_rng(seed)
    goal = READY + draw.uniform(-0.35, 0.35, 7)
    joint = int(draw.choice([0, 2, 4]))
    rests = 0
    for _ in range(8):
        plan = vff.plan(PANDA, goal, approach=[0.0, 0.0, -0.06], paths=1)
        if plan.status != "found":
            break
        steps = np.abs(np.diff(plan.q, axis=0)).max(axis=1)
        (meet,) = np.flatnonzero(steps < 1e-12)
        np.testing.assert_array_equal(plan.q[meet], plan.q[meet + 1])
        _, speeds, _ = plan.at(np.linspace(plan.t[meet], plan.t[meet + 1], 9))
        assert np.abs(speeds).max() < 1e-15
        goal[joint] -= plan.q[meet][joint] - draw.uniform(-1.0, 1.0) * 1e-5
        rests += 1
    assert rests > 0


@pytest.mark.parametrize("key", ["margin", "time", "horizon"])
def test_settings_are_bounded_as_numbers_of_a_scenario_are(key: str) -> None:
    for large in (1.1e100, 1e300):
        given: dict[str, Any] = {key: large}
        with pytest.raises(ScenarioError, match=f"{key}: must be at most 1e100"):
            vff.plan(THREE, [-0.5, 0.2, 0.1], **given)
    endless: dict[str, Any] = {key: np.inf}
    with pytest.raises(InputError, match=key):
        vff.plan(THREE, [-0.5, 0.2, 0.1], **endless)


@pytest.mark.parametrize("speed", [1e-3, 1.0, 1e60, 1e100])
@pytest.mark.parametrize("horizon", [1e8, 1e16, 1e20, 1e60, 1e100])
def test_what_comes_by_within_any_horizon_is_in_the_way(speed: float, horizon: float) -> None:
    """A disc through which the arm would have to go does not vanish where it ends far away."""
    arm = vff.Scenario.from_dict(THREE).arm
    place = arm.forward_kinematics([-0.1, 0.3, 0.3])[-1]
    scene = {**THREE, "obstacles": [disc(place, [speed, 0.0])]}
    plan = vff.plan(scene, [-0.5, 0.2, 0.1], horizon=horizon)
    assert "blocked" in plan.status and plan.clearance < 0.0, plan.message
    assert len(plan.message) < 300 and " inf " not in plan.message


def test_what_goes_beyond_all_bounds_is_said_to_be_in_the_way() -> None:
    scene = {**THREE, "obstacles": [disc([9.0, 9.0], [1e90, 0.0])]}
    plan = vff.plan(scene, [-0.5, 0.2, 0.1], horizon=1e20)
    assert plan.status == "start blocked"
    said = "obstacle 0 goes farther within the horizon of 1e20 s than it can be looked for"
    assert plan.message.startswith(said)
    assert vff.plan(scene, [-0.5, 0.2, 0.1], horizon=0.0).status == "found"


def crowd(count: int, slowest: float = 3.0) -> dict[str, Any]:
    """Of discs that fly past, each at a speed of its own."""
    discs = [disc([20.0 + 1e-3 * i, 20.0], [0.0, slowest + 1e-4 * i], 0.01) for i in range(count)]
    return {**THREE, "obstacles": discs}


def test_a_crowd_that_is_fast_is_looked_for_together() -> None:
    """Which takes no longer than for one that is slower; and one of them that comes by is in the way."""
    times = []
    for slowest in (2.0, 3.0):
        scene = vff.Scenario.from_dict(crowd(2000, slowest))
        began = time.process_time()
        assert vff.plan(scene, [0.5, 0.2, 0.1]).status == "found"
        times.append(time.process_time() - began)
    assert times[1] < 2.0 * times[0]
    tip = vff.Scenario.from_dict(THREE).arm.forward_kinematics(THREE["q0"])[-1]
    through = disc([tip[0], tip[1] - 1.0], [0.0, 4.0])
    discs = crowd(100)["obstacles"]
    for k in (0, 50, 100):
        plan = vff.plan({**THREE, "obstacles": [*discs[:k], through, *discs[k:]]}, [0.5, 0.2, 0.1])
        assert plan.status == "start blocked"
        assert f"obstacle {k} passes within the horizon" in plan.message


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
def test_ctrl_c_is_heard_while_a_crowd_is_looked_for() -> None:
    scene = vff.Scenario.from_dict(crowd(20_000))
    sent: list[float] = []

    def interrupt(delay: float) -> None:
        time.sleep(delay)
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    for delay in (0.2, 0.4, 0.6, 0.8):
        thread = threading.Thread(target=interrupt, args=[delay])
        thread.start()
        with pytest.raises(KeyboardInterrupt):
            while True:
                vff.plan(scene, [0.5, 0.2, 0.1])
        assert time.perf_counter() - sent[-1] < 2.0
        thread.join()


@pytest.mark.parametrize("task", ["position", "pose"])
def test_a_plan_is_a_reference_that_is_judged(task: str) -> None:
    """A search for motions holds the tip where the joints of a plan put it."""
    scene = vff.Scenario.load("narrow-gap")
    plan = vff.plan(scene)
    assert plan.status == "found"
    more = {"controller.task": task, "duration": 1.0}
    assert vff.feasibility(scene.replace(reference=plan.reference, **more)) == "with tip"
    short = {**plan.reference, "points": [point[:-1] for point in plan.reference["points"]]}
    with pytest.raises(ScenarioError, match=r"reference\.points\[0\]"):
        vff.feasibility(scene.replace(reference=short, **more))


@pytest.mark.parametrize("width", [1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_a_joint_with_next_to_no_range_stays_in_it(width: float, share: float) -> None:
    """What keeps the knots off the ends of a range takes no more than half of it."""
    limits = [[0.3, 0.3 + width], [-3.0, 3.0], [-3.0, 3.0]]
    scene = {**THREE, "arm": {**THREE["arm"], "joint_limits": limits}}
    for seed in range(3):
        plan = vff.plan(scene, [0.3 + share * width, -0.5, 1.0], seed=seed, margin=0.0)
        assert plan.status == "found", plan.message
        q, _, _ = plan.at(np.linspace(0.0, plan.duration, 1000))
        assert (q[:, 0] >= 0.3 - 1e-12).all() and (q[:, 0] <= 0.3 + width + 1e-12).all()


def test_what_would_let_the_end_effector_off_is_said_to_help() -> None:
    """Where no smooth motion keeps it pointing where it has to, as where the search finds none."""
    arm = vff.Scenario.from_dict(THREE).arm
    before, tip = arm.forward_kinematics(THREE["q0"])[-2:]
    seen = tip + 20.0 * (tip - before)
    goal = np.array([0.35, 0.3, 0.5])
    for _ in range(20):
        before, tip = arm.forward_kinematics(goal)[-2:]
        is_seen, should = tip - before, seen - tip
        goal[2] += np.arctan2(is_seen[0] * should[1] - is_seen[1] * should[0], is_seen @ should)
    looks = {"view": seen.tolist(), "view_angle": 1e-6}
    for given, there, more in (
        ({"tilt": 1e-6}, [-0.5, 0.6, 1.1], "a greater tilt"),
        (looks, goal.tolist(), "a greater angle of view"),
    ):
        plan = vff.plan(THREE, there, **given)
        assert plan.status == "not found" and "no smooth motion" in plan.message
        assert plan.message.endswith(f"another seed, {more} or another margin may help")
