"""Possible futures: obstacles that look-ahead alone sees, and how many of them it leaves out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import vffnull as vff
from vffnull.engines.export import to_mjcf
from vffnull.errors import InputError, ScenarioError
from vffnull.robots.simulated import SimulatedRobot
from waiting import HANG

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
BEGIN = [0.1, -0.75, 0.75]
COMES = [BEGIN, BEGIN, [0.05, 0.0, 0.62], [0.0, 0.75, 0.5]]
GOES = [BEGIN, BEGIN, [0.6, -0.9, 0.4], [1.0, -1.2, 0.2]]
TIMES = [0.0, 1.0, 1.5, 2.5]
LAW = {
    "task": "pose",
    "avoidance": "cbf",
    "posture": READY,
    "posture_stiffness": 10.0,
    "yielding": {"preview": {"self_motion": {}}},
    "deadline": "unlimited",
}


def ball(points: Sequence[Sequence[float]]) -> vff.Obstacle:
    return vff.Obstacle.sphere(points[0], 0.08, motion=vff.Motion.waypoints(TIMES, points))


def scene(*obstacles: vff.Obstacle, **changes: Any) -> vff.Scenario:
    """A Panda that holds a pose, beside a ball that rests for a second and then comes through its elbow."""
    made = vff.Scenario.from_dict(
        {
            "duration": 3.0,
            "q0": READY,
            "arm": {"model": "panda"},
            "reference": {"kind": "setpoint"},
            "obstacles": [each.to_dict() for each in (ball(COMES), *obstacles)],
            "controller": LAW,
        }
    )
    return made.replace(**changes) if changes else made


def worst(result: vff.Result) -> float:
    return float(np.abs(result.error).max())


def test_what_may_come_is_avoided_in_time() -> None:
    """Who learns of a fast ball when it comes lets go of the hand, who knows that it may come holds it."""
    surprised, warned = (
        vff.simulate(scene(*futures))
        for futures in ((), (ball(COMES).with_likelihood(0.3), ball(GOES).with_likelihood(0.7)))
    )
    for result in (surprised, warned):
        assert result.status == "completed" and result.clearance.min() > 0.015
    assert worst(surprised) > 0.2 and worst(warned) < 0.03


@pytest.mark.parametrize(
    ("comes", "goes", "seen"),
    [(0.3, None, False), (0.31, None, True), (0.3, 0.7, False), (0.3, 0.1, True), (0.1, 0.3, False)],
)
def test_the_least_likely_are_left_out_up_to_a_chance(comes: float, goes: float | None, seen: bool) -> None:
    """With a chance of 0.3, of which less likely ones have their part.

    What is left out is as if it were not said at all, to the last bit.
    """
    others = [] if goes is None else [ball(GOES).with_likelihood(goes)]
    chance = {"controller.yielding.preview.chance": 0.3}
    found = vff.simulate(scene(*others, ball(COMES).with_likelihood(comes), **chance))
    without = vff.simulate(scene(*others, **chance))
    assert (found.q == without.q).all() != seen
    assert (worst(found) < 0.03) == seen


def test_parts_of_a_future_come_together() -> None:
    """Two of 0.2 each are left out with a chance of 0.3 if they are one future, not if they are two."""
    chance = {"controller.yielding.preview.chance": 0.3}
    alone = vff.simulate(scene(**chance))
    for future, seen in (("both", False), (None, True)):
        parts = [ball(points).with_likelihood(0.2, future) for points in (GOES, COMES)]
        found = vff.simulate(scene(*parts, **chance))
        assert (found.q == alone.q).all() != seen
        assert (worst(found) < 0.03) == seen


def test_nobody_else_sees_it(tmp_path: Path) -> None:
    """Neither distances nor the field nor plans, though it is where the arm is. A report says so."""
    inside = vff.Obstacle.sphere([0.3, 0.0, 0.6], 0.2).with_likelihood(0.5)
    quiet = {"controller.yielding.preview.chance": 0.9}
    runs = [vff.simulate(scene(*futures, **quiet)) for futures in ((), (inside,))]
    assert (runs[0].q == runs[1].q).all() and (runs[0].clearance == runs[1].clearance).all()
    goal = [0.6, *READY[1:]]
    plans = [vff.plan(scene(*futures), goal, horizon=0.0) for futures in ((), (inside,))]
    assert plans[0].status == "found" and (plans[0].q == plans[1].q).all()
    runs[1].report(tmp_path / "run.html")
    told = (tmp_path / "run.html").read_text(encoding="utf-8")
    assert "Obstacle 2 is a possible future with a likelihood of 0.5: seen by look-ahead alone" in told


def test_nothing_is_let_go_for_what_may_come() -> None:
    """Three ways of a ball that stays where it is: one through the hand, where no self-motion gives way."""
    rests = vff.Obstacle.sphere(BEGIN, 0.08)
    hits = [BEGIN, BEGIN, [0.3, -0.05, 0.6], [0.5, 0.7, 0.5]]
    ways = [ball(way).with_likelihood(0.3) for way in (COMES, GOES, hits)]
    found = vff.simulate(scene().replace(obstacles=[rests.to_dict(), *(way.to_dict() for way in ways)]))
    assert found.status == "completed" and worst(found) < 0.01


def test_another_engine_touches_no_future() -> None:
    """MuJoCo moves the arm as it does without it, and the model has it as a body that nothing touches."""
    pytest.importorskip("mujoco")
    inside = vff.Obstacle.sphere([0.3, 0.0, 0.6], 0.2).with_likelihood(0.5)
    quiet = {"controller.yielding.preview.chance": 0.9, "duration": 0.3}
    runs = [vff.simulate(scene(*futures, **quiet), plant="mujoco") for futures in ((), (inside,))]
    assert (runs[0].q == runs[1].q).all() and worst(runs[1]) < 1e-3
    disc = vff.Obstacle.circle([0.5, 0.0], 0.2)
    planar = vff.Arm.uniform(3)
    for arm, seen in ((planar, disc), (scene().arm, inside.with_likelihood(None))):
        models = [to_mjcf(arm, obstacles=[each]) for each in (seen, seen.with_likelihood(0.5))]
        touched = [ElementTree.fromstring(model).find(".//geom[@name='obstacle_1']") for model in models]
        assert [each is not None and each.get("conaffinity") for each in touched] == ["1", "0"]


def test_a_loop_of_ones_own_is_told_of_futures() -> None:
    """With every call, and all at once."""
    panda = vff.Arm.named("panda")
    ahead, blind = (
        vff.Controller(panda, {"avoidance": "cbf", "yielding": given}) for given in ({"preview": {}}, {})
    )
    future, position = ball(GOES).with_likelihood(0.7), panda.forward_kinematics(READY)[-1]
    given = {"q": READY, "dq": [0.0] * 7, "x_ref": position, "obstacles": [ball(COMES), future]}
    assert np.isfinite(ahead.torque(**given)).all() and (ahead.terms(**given).clearance > 0.1).all()
    with pytest.raises(ScenarioError, match=r"obstacles\[1\]\.likelihood: look-ahead alone sees"):
        blind.torque(**given)
    with vff.drive(SimulatedRobot(scene()), scene(), seconds=0.5) as drive:
        drive.set_obstacles([ball(COMES), future])
        with pytest.raises(
            InputError, match=r"controller: obstacles\[1\]\.likelihood: look-ahead alone sees"
        ):
            drive.set_controller(vff.Controller(panda, {"task": "pose", "avoidance": "cbf"}))
        drive.set_controller(vff.Controller(panda, scene().to_dict()["controller"]))
        assert drive.wait(HANG)
    assert drive.report.status == "completed", drive.report.reason


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (
            {"obstacles.1.likelihood": None, "obstacles.1.future": "any"},
            r"obstacles\[1\]\.future: how likely",
        ),
        (
            {"obstacles.1.likelihood": 0.0},
            r"obstacles\[1\]\.likelihood: must be greater than 0 and at most 1",
        ),
        (
            {"obstacles.1.likelihood": 1.5},
            r"obstacles\[1\]\.likelihood: must be greater than 0 and at most 1",
        ),
        ({"controller.yielding.preview.chance": 1.0}, r"preview\.chance: must be in \[0, 1\)"),
        ({"controller.yielding.preview": None}, 'needs `controller.yielding.preview` and "cbf"'),
        (
            {"controller.avoidance": "null_space"},
            "obstacles.1..likelihood: look-ahead alone sees a possible future",
        ),
        ({"obstacles.1.contact": {}}, "a possible future has no `contact`"),
        (
            {
                "perception": {
                    "kind": "camera",
                    "cameras": [{"position": [2.0, 0.0, 1.0], "orientation": [1.0, 0.0, 0.0, 0.0]}],
                }
            },
            "without `perception`",
        ),
    ],
)
def test_what_makes_no_sense_is_said(changes: dict[str, Any], says: str) -> None:
    with pytest.raises(ScenarioError, match=says):
        scene(ball(GOES).with_likelihood(0.7)).replace(**changes)


def test_it_is_told_of_as_what_it_is() -> None:
    likely = ball(GOES).with_likelihood(0.7)
    assert "likelihood=0.7" in repr(likely) and likely.with_likelihood(None) == ball(GOES)
