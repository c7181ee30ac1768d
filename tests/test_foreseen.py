"""What look-ahead knows of later: a foreseen motion is believed, everything else goes on as it does."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError

LOOKS = {"controller.avoidance": "cbf", "controller.yielding.preview": {}}


CUP = vff.Scenario.load("panda-cup").replace(obstacles=[])
HAND, TURN = CUP.arm.pose(CUP.to_dict()["q0"])


def passed(place: Any, motion: vff.Motion, duration: float, **changes: Any) -> vff.Result:
    """A Panda that takes a cup along a line, and a ball that moves from a place on."""
    ball = vff.Obstacle.sphere(place, 0.08, motion=motion)
    return vff.simulate(CUP.replace(obstacles=[ball], duration=duration, **(LOOKS | changes)))


def around_a_cup(way: Any, times: Any, foreseen: bool, **changes: Any) -> vff.Result:
    """The same, with a ball that goes this way, seen from the hand at the start."""
    points = HAND + np.array(way)
    motion = vff.Motion.waypoints(times, points, interpolation="smooth", foreseen=foreseen)
    return passed(points[0], motion, times[-1], **changes)


STOPS = ([[1.35, 0.0, 0.0], [0.35, 0.0, 0.0], [1.35, 0.0, 0.0]], [0.0, 1.25, 2.5])
TURNS = ([[0.7, -1.2, 0.0], [0.7, 0.0, 0.0], [-0.2, 0.0, 0.0]], [0.0, 1.2, 2.1])


def off(result: vff.Result) -> float:
    return float(np.linalg.norm(result.error[:, :3], axis=1).max())


def test_a_body_that_will_stop_is_not_run_from() -> None:
    """By its speed it would hit the hand, which is let go; who knows that it stops keeps to the line."""
    surprised, informed = (around_a_cup(*STOPS, foreseen) for foreseen in (False, True))
    assert off(surprised) > 0.005
    assert off(informed) < 1e-4
    assert min(informed.metrics.min_clearance, surprised.metrics.min_clearance) > 0.15


def test_a_body_that_will_turn_towards_the_hand_is_expected() -> None:
    """It passes at a distance and turns round into the hand: who knows of it has to make less room."""
    surprised, informed = (around_a_cup(*TURNS, foreseen) for foreseen in (False, True))
    assert off(informed) < off(surprised) - 0.005
    assert min(informed.metrics.min_clearance, surprised.metrics.min_clearance) > 0.015


def test_nothing_but_look_ahead_depends_on_it() -> None:
    """Bit for bit."""
    for avoidance in ("cbf", "priority"):
        changes = {"controller.yielding.preview": None, "controller.avoidance": avoidance}
        one, other = (around_a_cup(*TURNS, foreseen, **changes) for foreseen in (False, True))
        assert np.array_equal(one.tau, other.tau)


def test_a_swing_can_be_foreseen() -> None:
    """It goes back before it comes near."""
    lost = []
    for foreseen in (False, True):
        motion = vff.Motion.sinusoid([0.5, 0.0, 0.0], 2.5, foreseen=foreseen)
        lost.append(off(passed(HAND + np.array([0.85, 0.0, 0.0]), motion, 3.0)))
    assert lost[0] > 0.005
    assert lost[1] < 1e-4


def test_a_body_with_joints_can_be_foreseen() -> None:
    """An arm that reaches for the cup and is drawn back: every bone is known of, or none."""
    person = vff.Body.reaching([0.9, 0.4, 0.8], [0.45, 0.0, 0.7], speed=0.8, seed=1)
    for foreseen in (False, True):
        motions = [each.to_dict()["motion"] for each in person.obstacles(foreseen=foreseen)]
        assert len(motions) == 3
        assert all(motion.get("foreseen", False) is foreseen for motion in motions)


def test_it_is_written_and_read_again() -> None:
    motion = vff.Motion.sinusoid([0.0, 0.1], 2.0, foreseen=True)
    assert motion.to_dict()["foreseen"] is True
    assert "foreseen" not in vff.Motion.sinusoid([0.0, 0.1], 2.0).to_dict()
    with pytest.raises(ScenarioError, match="foreseen"):
        vff.Motion("waypoints", (("times", (0.0,)), ("points", ((0.0, 0.0),)), ("foreseen", "perhaps")))


def test_a_controller_is_given_one_forecast_after_the_other() -> None:
    """What is around is said with every call: a later forecast takes the place of the one before."""
    settings = dict(CUP.replace(**LOOKS)["controller"])
    start, rest, reference = np.array(CUP.to_dict()["q0"]), np.zeros(7), (HAND, TURN)
    away = HAND + np.array([1.3, 0.0, 0.0])
    alone = vff.Controller(CUP.arm, settings).torque(start, rest, reference)
    controller = vff.Controller(CUP.arm, settings)
    for begin, end, runs_away in ((0.0, HAND + np.array([0.6, 0.0, 0.0]), False), (0.2, HAND, True)):
        motion = vff.Motion.waypoints([begin, begin + 0.5], [away, end], foreseen=True)
        ball = vff.Obstacle.sphere(away, 0.15, motion=motion)
        for step in range(200):
            t = begin + 0.001 * step
            tau = controller.torque(start, rest, reference, obstacles=[ball], t=t)
        assert (np.abs(tau - alone).max() > 1.0) == runs_away
