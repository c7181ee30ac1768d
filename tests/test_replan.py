"""Plans that take the place of what is followed: results, files, errors, live page, Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError
from waiting import HANG, wait_for

BLOCKED: dict[str, Any] = {
    "name": "blocked",
    "duration": 3.0,
    "q0": [0.2, 0.3, 0.3, 0.3],
    "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
    "controller": {
        "stiffness": 100.0,
        "damping": 20.0,
        "null_damping": 10.0,
        "posture_stiffness": 200.0,
        "avoidance": "cbf",
    },
    "reference": {
        "kind": "plan",
        "times": [0.0, 4.0],
        "points": [[0.2, 0.3, 0.3, 0.3], [1.8, 0.3, 0.3, 0.3]],
    },
    "obstacles": [{"shape": {"kind": "circle", "radius": 0.2}, "position": [0.5, 2.9]}],
    "replan": {"latency": 0.25},
}


@pytest.fixture(scope="module")
def result() -> vff.Result:
    return vff.simulate(BLOCKED)


@pytest.mark.parametrize("every", [1e-6, 1e-300])
def test_a_plan_is_looked_through_once_in_a_period_at_most(every: float) -> None:
    """The work of a cycle is bounded, however soon all of it is to be looked through."""
    found = [vff.simulate({**BLOCKED, "replan": {"latency": 0.25, "every": each}}) for each in (1e-3, every)]
    np.testing.assert_array_equal(found[1].q, found[0].q)
    assert found[1].replans == found[0].replans


def test_a_result_tells_of_its_plans(result: vff.Result) -> None:
    """Why another plan was searched, what came of it and when; where the plans had the joints."""
    first = result.replans[0]
    assert isinstance(first, vff.Replan)
    assert (first.reason, first.status) == ("blocked", "found") and first.status == vff.PlanStatus.FOUND
    assert first.taken is not None and first.taken - first.asked == pytest.approx(0.25, abs=2e-3)
    assert result.metrics.replans == sum(search.taken is not None for search in result.replans)
    assert result.metrics.times_stuck == 0
    assert result.q_plan is not None and result.q_plan.shape == result.q.shape
    early = result.t < first.taken - 1e-9
    alone = vff.simulate({key: value for key, value in BLOCKED.items() if key != "replan"})
    assert alone.replans == () and alone.metrics.replans is None and alone.q_plan is not None
    np.testing.assert_array_equal(result.q_plan[early], alone.q_plan[early])
    # The reference of the end effector is where the plan puts it, also while one plan fades into another.
    arm = result.scenario.arm
    tips = np.array([arm.forward_kinematics(q)[-1] for q in result.q_plan[::50]])
    np.testing.assert_allclose(tips, result.x_ref[::50], atol=1e-12)
    assert result.obstacles.shape[1] == 1 and result.metrics.min_clearance > 0.0  # type: ignore[operator]


def test_a_new_plan_that_is_longer_than_the_run_is_told_of(result: vff.Result) -> None:
    """The hand is metres from its goal, and nothing else went wrong."""
    short = vff.simulate({**BLOCKED, "replan": {"latency": 0.25, "speed": 0.05}})
    goal = short.scenario.arm.forward_kinematics(BLOCKED["reference"]["points"][-1])[-1]
    assert np.linalg.norm(short.x[-1] - goal) > 0.5 and short.metrics["end_error"] < 0.01
    assert short.metrics["end_time_left"] > 1.0
    assert (short.headline.verdict, short.headline.severity) == ("not at its end", "odd")
    assert f"the new plan had {short.metrics['end_time_left']:.3g} s to go" in short.headline.lines[0]


def test_a_joint_may_begin_in_another_turn_than_its_plan() -> None:
    """Where the arm strays, another plan begins where it is, in the turn of its plan: not a turn away."""
    ball = {
        "shape": {"kind": "circle", "radius": 0.4},
        "position": [2.6, 3.6],
        "motion": {"kind": "linear", "velocity": [0.0, -0.8]},
    }
    replan = {"latency": 0.1, "horizon": 0.0, "patience": 0.3, "stray": 0.1}
    scene = {**BLOCKED, "duration": 9.0, "obstacles": [ball], "replan": replan}
    here, there = (vff.simulate({**scene, "q0": [0.2 + turn, 0.3, 0.3, 0.3]}) for turn in (0.0, -2 * np.pi))
    taken = [search for search in here.replans if search.taken is not None]
    assert taken[0].reason != "blocked" and there.replans[: len(taken)][0].reason == here.replans[0].reason
    # What is rounded elsewhere grows later on.
    soon = here.t < taken[0].taken + 0.2
    assert abs(np.diff(here.q[soon], axis=0)).max() > 1e-3
    np.testing.assert_allclose(there.q[soon] + np.array([2 * np.pi, 0.0, 0.0, 0.0]), here.q[soon], atol=1e-4)


def test_runs_repeat_in_any_number_of_threads(result: vff.Result) -> None:
    for other in vff.simulate_many([BLOCKED, BLOCKED], threads=2):
        np.testing.assert_array_equal(other.q, result.q)
        assert other.replans == result.replans


@pytest.mark.parametrize("ending", ["npz", "csv", "parquet"])
def test_files_keep_the_searches(result: vff.Result, tmp_path: Path, ending: str) -> None:
    loaded = vff.Result.load(result.save(tmp_path / f"run.{ending}"))
    assert loaded.replans == result.replans
    np.testing.assert_array_equal(loaded.q_plan, result.q_plan)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ({}, "expected a list of tables"),
        ([{}], "expected a list of tables"),
        ([{"asked": "x", "reason": "stuck", "status": None, "taken": None}], r"replans\[0\]\.asked"),
        ([{"asked": 0.0, "reason": 1, "status": None, "taken": None}], r"replans\[0\]\.reason"),
    ],
)
def test_damaged_searches_are_refused(result: vff.Result, tmp_path: Path, value: Any, problem: str) -> None:
    path = result.save(tmp_path / "run.npz")
    with np.load(path) as file:
        arrays = dict(file)
    (name,) = (name for name, array in arrays.items() if array.dtype.kind in "US")
    header = json.loads(str(arrays[name]))
    arrays[name] = np.array(json.dumps(header | {"replans": value}))
    np.savez(path, **arrays)
    with pytest.raises(InputError, match=problem):
        vff.Result.load(path)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        (
            {"reference": {"kind": "circle", "center": [1.0, 2.0], "radius": 0.1, "angular_velocity": 1.0}},
            "replan: needs a reference that comes to rest",
        ),
        ({"perception": {"kind": "range"}}, "replan: needs obstacles that are known"),
        ({"replan": {"latency": -1.0}}, r"replan\.latency"),
        ({"replan": {"every": 0.0}}, r"replan\.every"),
        ({"replan": {"speed": 1.5}}, r"replan\.speed"),
        ({"replan": {"blend": 0.0}}, r"replan\.blend"),
        ({"replan": {"latencyy": 1.0}}, "latency"),
    ],
)
def test_what_makes_no_sense_is_refused(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ScenarioError, match=problem):
        vff.simulate({**BLOCKED, **changes})


def test_in_space_too() -> None:
    """A Panda with a ball in the way of its plan."""
    scene = vff.Scenario.load("panda-sweep").replace(obstacles=[], duration=1.0)
    plan = vff.plan(scene, {"position": [0.3, 0.5, 0.5], "orientation": [0.0, 1.0, 0.0, 0.0]})
    ball = vff.Obstacle.sphere(plan.tip[len(plan.t) // 2], 0.05)
    changes = {"reference": plan.reference, "controller.posture_stiffness": 40.0, "replan": {}}
    result = vff.simulate(scene.replace(obstacles=[ball], **changes))
    assert result.replans and result.replans[0].reason == "blocked"
    assert result.q_plan is not None and result.q_plan.shape == result.q.shape


def test_an_arm_that_stands_at_a_joint_limit_is_asked_for() -> None:
    """Elbow up, a joint at its limit, and the plan over: elbow down there is a straight motion to its end."""
    goal = [0.2565, 1.287, 0.0]
    scene = {
        "duration": 8.0,
        "q0": [1.0, -1.287, 0.3],
        "arm": {
            "lengths": [1.0, 1.0, 0.1],
            "masses": 1.0,
            "radius": 0.05,
            "joint_limits": [[-0.5, 1.25], [-2.5, 2.5], [-2.5, 2.5]],
        },
        "controller": {"stiffness": 100.0, "damping": 20.0, "posture_stiffness": 2.0, "avoidance": "cbf"},
        "reference": {"kind": "plan", "times": [0.0, 1.0], "points": [goal, goal]},
    }
    alone = vff.simulate(scene)
    assert np.linalg.norm(alone.error[-1]) > 0.1, "it stands off by itself"
    watched = vff.simulate({**scene, "replan": {}})
    assert watched.metrics.replans >= 1
    assert np.linalg.norm(watched.error[-1]) < 1e-3
    assert alone.q[-1, 0] > 1.24 and watched.q[-1, 0] < 1.0


def test_an_arm_that_is_held_is_let_go() -> None:
    """At rest far from its plan, the arm goes where another one begins: nothing races back to it."""
    scene = {
        "duration": 6.0,
        "q0": [-0.485, 0.817, -0.586],
        "arm": {"lengths": [0.585, 0.561, 0.312], "masses": 1.0, "radius": 0.03, "joint_limits": [-2.8, 2.8]},
        "reference": {"kind": "setpoint", "point": [0.5, 0.3]},
        "simulation": {"control": "hold", "record_every": 1},
    }
    plan = vff.plan(scene, [-0.6786, -1.2597, 0.9713], speed=1.0)
    scene |= {
        "reference": plan.reference,
        "controller": {
            "stiffness": 100.0,
            "damping": 20.0,
            "null_damping": 20.0,
            "posture_stiffness": 20.0,
            "avoidance": "cbf",
        },
        "obstacles": [{"shape": {"kind": "circle", "radius": 0.15}, "position": [0.72, -0.73]}],
        "replan": {"latency": 1.0, "margin": 0.1},
    }
    result = vff.simulate(scene)
    (taken,) = (each.taken for each in result.replans if each.reason == "stuck")
    assert taken is not None
    i = round(taken / 1e-3)
    assert np.abs(result.dq[i - 200 : i]).max() < 1e-3, "it is at rest"
    assert np.abs(result.q[i] - plan.q[-1]).max() > 1.0, "and elsewhere"
    plan_q = result.q_plan[i + 1 :]
    rates = np.gradient(plan_q, 1e-3, axis=0)
    pulls, arm = np.gradient(rates, 1e-3, axis=0), vff.Scenario.from_dict(scene).arm
    needed = [arm.inverse_dynamics(*state) for state in zip(plan_q, rates, pulls, strict=True)]
    assert np.abs(result.tau[i : i + 600]).max() < 1.5 * np.abs(needed).max(), "no more than the plan needs"
    assert np.abs(result.q[i + 600 :] - result.q_plan[i + 600 :]).max() < 0.2
    assert np.linalg.norm(result.error[-1]) < 1e-3
    assert len(result.replans) == 2


WALL = [
    {"shape": {"kind": "circle", "radius": 0.3}, "position": [1.2, 1.1]},
    {"shape": {"kind": "circle", "radius": 0.3}, "position": [1.5, 0.6]},
]
STRAIGHT: dict[str, Any] = {
    **BLOCKED,
    "duration": 8.0,
    "q0": [0.9, 0.5, 0.4, 0.3],
    "controller": {**BLOCKED["controller"], "posture": [0.5] * 4, "posture_stiffness": 20.0},
    "reference": {"kind": "line", "end": [2.2, -0.4], "duration": 2.0},
    "obstacles": WALL,
    "replan": {},
}


@pytest.fixture(scope="module")
def planned() -> vff.Result:
    return vff.simulate(STRAIGHT)


def test_a_hand_that_nothing_lets_past_asks_for_a_plan(planned: vff.Result, tmp_path: Path) -> None:
    """A line leads through a wall: whoever only reacts stands in front of it, a plan leads around."""
    alone = vff.simulate({**STRAIGHT, "replan": None})
    assert np.linalg.norm(alone.error[-1]) > 0.3 and alone.q_plan is None
    assert np.linalg.norm(planned.error[-1]) < 1e-3 and planned.metrics.min_clearance > 0.01
    (search,) = planned.replans
    assert (search.reason, search.status) == ("stuck", "found") and search.taken is not None
    assert planned.q_plan is not None
    np.testing.assert_array_equal(np.isnan(planned.q_plan).any(axis=1), planned.t <= search.taken)
    loaded = vff.Result.load(planned.save(tmp_path / "run.npz"))
    np.testing.assert_array_equal(loaded.q_plan, planned.q_plan)
    assert loaded.replans == planned.replans


def test_a_panda_goes_round_a_board_as_well() -> None:
    """In space, with look-ahead and a governor: a hand that goes straight stands in front of a board."""
    posture = [0.6, 0.3, 0.0, -1.9, 0.0, 2.2, 1.6]
    scene = {
        "duration": 9.0,
        "q0": posture,
        "arm": {"model": "panda"},
        "controller": {
            "task": "position",
            "stiffness": 200.0,
            "damping": 28.0,
            "null_damping": 10.0,
            "posture": posture,
            "posture_stiffness": 20.0,
            "avoidance": "cbf",
            "yielding": {"preview": {}},
            "governor": {},
        },
        "reference": {"kind": "line", "end": [0.45, -0.3, 0.45], "duration": 3.0},
        "obstacles": [{"shape": {"kind": "box", "size": [0.5, 0.02, 0.3]}, "position": [0.5, 0.0, 0.45]}],
    }
    alone, watched = (vff.simulate({**scene, **more}) for more in ({}, {"replan": {}}))
    assert np.linalg.norm(alone.error[-1]) > 0.2
    assert watched.metrics.replans == 1 and np.linalg.norm(watched.error[-1]) < 2e-3
    assert watched.metrics.min_clearance > 0.005


def test_ctrl_c_ends_a_search() -> None:
    """A search without end is answered like everything else: what was computed until then is the result."""
    walls = [
        {
            "shape": {"kind": "box", "size": [4.0, 0.1]},
            "position": [2.3 * np.cos(angle), 2.3 * np.sin(angle)],
            "angle": angle,
        }
        for angle in (1.2, -1.5)
    ]
    endless = {**BLOCKED, "obstacles": walls, "replan": {"samples": 10**9}}
    timer = threading.Timer(1.0, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    begin = time.monotonic()
    result = vff.simulate(endless)
    assert timer.finished.is_set() and time.monotonic() - begin < HANG
    assert result.status == "interrupted" and result.end_time < 1.0


def test_the_live_page_plans_beside_its_loop() -> None:
    """The loop goes on while a thread of its own searches; then it follows the new plan."""
    from vffnull._core import Live

    live = Live(vff.Scenario.from_dict(BLOCKED))
    live.start()
    try:
        wait_for(lambda: live.snapshot()["replans"] > 0)
        before = live.snapshot()["periods"]
        wait_for(lambda: live.snapshot()["periods"] > before)
        shown = live.snapshot()
        assert shown["q_plan"] is not None and shown["q_plan"].shape == (4,)
        assert shown["times_stuck"] == 0
    finally:
        live.stop()


def test_a_goal_that_is_dragged_behind_a_wall_is_planned_for() -> None:
    """Nobody has asked for a plan at first; the hand gets to where it is dragged, around the wall."""
    from vffnull._core import Live

    start = [float(x) for x in vff.Scenario.from_dict(STRAIGHT).arm.forward_kinematics(STRAIGHT["q0"])[-1]]
    live = Live(vff.Scenario.from_dict({**STRAIGHT, "reference": {"kind": "setpoint", "point": start}}))
    live.start()
    try:
        wait_for(lambda: live.snapshot()["periods"] > 0)
        assert live.snapshot()["q_plan"] is None
        goal = STRAIGHT["reference"]["end"]
        live.aim(goal)
        wait_for(lambda: np.linalg.norm(live.snapshot()["x"] - goal) < 1e-2)
        assert live.snapshot()["replans"] > 0 and live.snapshot()["q_plan"] is not None
    finally:
        live.stop()


def test_what_has_come_to_rest_on_the_goal_blocks_it() -> None:
    """No plan leads into what moved and rests now, however its motion was given."""
    scene = vff.Scenario.from_dict(
        {
            "duration": 8.0,
            "q0": [0.9, 0.5, 0.4, 0.3],
            "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
            "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0, "avoidance": "cbf"},
            "reference": {"kind": "line", "end": [2.2, -0.4], "duration": 2.0},
            "replan": {"patience": 0.3, "latency": 0.1, "horizon": 0},
            "obstacles": [
                {
                    "shape": {"kind": "circle", "radius": 0.3},
                    "position": [4.2, -2.4],
                    "motion": {
                        "kind": "waypoints",
                        "times": [0.0, 3.0],
                        "points": [[4.2, -2.4], [2.2, -0.4]],
                    },
                }
            ],
        }
    )
    result = vff.simulate(scene)
    later = [search for search in result.replans if search.asked > 3.0]
    assert later and all(search.status == "goal blocked" for search in later)
    assert result.metrics["min_clearance"] > 0.015


@pytest.mark.parametrize("governor", [{}, {"governor": {}}])
@pytest.mark.parametrize("avoidance", ["null_space", "cbf"])
def test_an_arm_that_is_pushed_off_its_plan_is_let_go(avoidance: str, governor: dict[str, Any]) -> None:
    """The plan that takes over begins where the arm is, with a governor as well; the posture goes on as it
    moved, and the torque makes no step.
    """
    law = {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0, "posture_stiffness": 200.0}
    points = [
        [0.2, 0.3, 0.3, 0.3],
        [0.5, 0.2, 0.6, 0.2],
        [0.9, 0.1, 1.0, 0.1],
        [1.3, 0.3, 1.2, -0.2],
        [1.6, 0.5, 1.0, -0.4],
        [1.8, 0.3, 0.3, 0.3],
    ]
    result = vff.simulate(
        {
            "duration": 1.2,
            "q0": points[0],
            "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
            "controller": law | {"avoidance": avoidance} | governor,
            "reference": {"kind": "plan", "times": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0], "points": points},
            "wrenches": [{"link": "tip", "force": [0.0, -150.0], "start": 0.5, "duration": 5.0}],
            "replan": {"patience": 0.3, "stray": 0.15, "latency": 0.1},
        }
    )
    (change,) = (search for search in result.replans if search.taken)
    assert change.reason == "strayed"
    k = round(change.taken / 1e-3)
    assert np.abs(result.q_plan[k - 1] - result.q[k - 1]).max() > 0.15
    then = result.q[round(change.asked / 1e-3)]  # when the search began
    assert np.abs(result.q_plan[k + 1] - then).max() < 0.02
    for torque in (result.tau, result.tau_null):
        steps = np.abs(np.diff(torque, axis=0)).max(axis=1)
        assert steps[k - 1 : k + 2].max() < steps[k - 100 : k - 1].max() + 2.0
