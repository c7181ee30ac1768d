"""What a plan may use of the limits, what it says where that is too little, and who follows it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from test_drive import Still
from vffnull.errors import InputTypeError, ScenarioError
from waiting import HANG

SHARE = 0.8  # of the limits, for what is planned
PANDA = vff.Arm.named("panda")


def swing(start: float, limit: float) -> dict[str, Any]:
    """One heavy link under gravity, with a light one."""
    return {
        "duration": 1.0,
        "q0": [start, 0.0],
        "arm": {"lengths": [1.0, 0.2], "masses": 1.0, "gravity": 9.81, "torque_limits": [limit, 50.0]},
        "reference": {"kind": "setpoint", "point": [1.0, 0.0]},
    }


@pytest.mark.parametrize("seed", range(60))
def test_what_can_be_held_is_found_and_what_cannot_is_too_heavy(seed: int) -> None:
    """Around 80 % of the limit, where nothing stands in the way; and what is found keeps it."""
    draw = np.random.default_rng(seed).uniform
    start, goal = draw(-3.0, 3.0, 2)
    arm = vff.Scenario.from_dict(swing(start, 1.0)).arm
    held = max(abs(arm.gravity_torque([q, 0.0])[0]) for q in np.linspace(start, goal, 500))
    share = draw(0.85, 1.15)
    limit = held / (SHARE * share)
    plan = vff.plan(swing(start, limit), [goal, 0.0])
    if share > 1.0:
        assert plan.status == "too heavy"
        return
    assert plan.status == "found", plan.message
    arm = vff.Scenario.from_dict(swing(start, limit)).arm
    times = np.linspace(0.0, plan.duration, 1000)
    torques = [arm.inverse_dynamics(*(each[0] for each in plan.at([t]))) for t in times]
    assert np.abs(torques)[:, 0].max() < 1.003 * SHARE * limit


def test_a_load_that_is_just_too_heavy_is_said_to_be() -> None:
    start, goal = [0.0, -0.9, 0.6, -1.2, -1.57, 0.0], [1.2, 0.3, -0.2, -1.2, -1.57, 0.0]
    for mass, status in ((6.9, "found"), (7.0, "too heavy"), (7.2, "too heavy")):
        arm = {"model": "ur5e", "load": {"mass": mass, "com": [0.0, 0.0, 0.05]}}
        scene = {"duration": 1.0, "q0": start, "arm": arm, "reference": {"kind": "setpoint"}}
        plan = vff.plan(scene, goal)
        assert plan.status == status, plan.message
        assert (status == "found") or "`shoulder_lift_joint` would have to hold 120" in plan.message


@pytest.mark.parametrize("part", range(5))
def test_the_limit_that_makes_it_longer_than_an_hour_is_named(part: int) -> None:
    scene = {
        "duration": 1.0,
        "q0": [0.0, 0.0, 0.0],
        "arm": {"lengths": [0.5] * 3, "masses": 1.0},
        "reference": {"kind": "setpoint", "point": [1.0, 0.5]},
    }
    named = set()
    for acceleration in np.geomspace(1.85e-7, 2.0e-7, 40)[part::5]:
        try:
            vff.plan(scene, [0.3, 0.2, -0.1], acceleration=acceleration)
        except ScenarioError as error:
            named.add(str(error).split(":")[0])
            assert "4e3" not in str(error)
    assert named == {"acceleration"}


def test_samples_are_those_that_were_drawn() -> None:
    """Where trials with other margins have failed as well."""
    walls = [([0.02, 3.0], [-0.06, 0.0]), ([3.0, 0.02], [0.0, -0.1])]
    scene = {
        "duration": 1.0,
        "q0": [0.3, 0.2, 0.1],
        "arm": {"lengths": [0.5] * 3, "masses": 1.0, "radius": 0.02},
        "reference": {"kind": "setpoint", "point": [1.0, 0.0]},
        "obstacles": [
            {"shape": {"kind": "circle", "radius": 0.1}, "position": [0.6, 0.42]},
            *({"shape": {"kind": "box", "size": size}, "position": place} for size, place in walls),
        ],
    }
    plan = vff.plan(scene, [1.4, 0.2, 0.1], samples=2000, margin=0.1)
    assert plan.status == "not found"
    assert f"after {plan.samples} samples" in plan.message
    assert plan.samples == 2000


def between(seed: int, shares: tuple[float, float], **law: Any) -> tuple[dict[str, Any], list[float]]:
    """A Panda at one random posture, and another one."""
    low, high = PANDA.joint_limits.T
    start, goal = low + (high - low) * np.random.default_rng(seed).uniform(*shares, (2, 7))
    scene = {
        "duration": 1.0,
        "arm": {"model": "panda"},
        "q0": start.tolist(),
        "reference": {"kind": "setpoint"},
        "controller": {"task": "pose", "null_damping": 10.0, "posture": start.tolist(), **law},
    }
    return scene, goal.tolist()


@pytest.mark.parametrize("avoidance", ["null_space", "priority", "cbf"])
@pytest.mark.parametrize("seed", [0, 1, 5, 8, 13])
def test_a_fast_plan_is_followed(seed: int, avoidance: str) -> None:
    """The brake near a joint's limit of speed is one relative to the plan, which keeps that limit."""
    law = {"stiffness": 100.0, "damping": 20.0, "posture_stiffness": 20.0, "avoidance": avoidance}
    scene, goal = between(seed, (0.2, 0.8), **law)
    plan = vff.plan(scene, goal, speed=0.97)
    assert plan.status == "found"
    assert (np.abs(plan.dq).max(axis=0) / PANDA.velocity_limits).max() > 0.9
    run = vff.simulate({**scene, "reference": plan.reference, "duration": np.ceil(plan.duration) + 1.0})
    assert np.linalg.norm(run.error[:, :3], axis=1).max() < 1e-3
    assert (np.abs(run.dq).max(axis=0) <= 1.01 * np.array(PANDA.velocity_limits)).all()


@pytest.mark.parametrize("more", [{}, {"torque_rate": 1000.0}])
@pytest.mark.parametrize("seed", [0, 1, 5])
def test_no_more_of_a_speed_is_planned_than_the_law_keeps(seed: int, more: dict[str, Any]) -> None:
    """A robot ends a motion that comes to a limit, so the law keeps 85 % of the speed of the tip."""
    law = {"stiffness": 100.0, "damping": 20.0, "posture_stiffness": 20.0}
    command = {"gravity": "robot", "tip_speed": 0.8, **more}
    scene, goal = between(seed, (0.2, 0.8), command=command, **law)
    plan = vff.plan(scene, goal, speed=0.97)
    assert plan.status == "found"
    run = vff.simulate({**scene, "reference": plan.reference, "duration": np.ceil(plan.duration) + 1.0})
    assert 0.83 < run.metrics.tip_speed_ratio < 0.87
    assert np.linalg.norm(run.error[:, :3], axis=1).max() < 2e-3


class Ideal(Still):
    """Keeps what it was sent."""

    def __init__(self, q: Any) -> None:
        super().__init__(q)
        self.sent: list[Any] = []

    def write(self, command: Any, /) -> None:
        self.sent.append(command.copy())
        super().write(command)


@pytest.mark.parametrize(
    ("seed", "speed", "law"),
    [
        (8, 0.5, {"stiffness": 900.0, "damping": 60.0, "avoidance": "cbf"}),
        (31, 0.9, {"stiffness": 100.0, "damping": 20.0}),
        (5, 0.99, {"stiffness": 100.0, "damping": 20.0}),
    ],
)
def test_set_points_follow_a_plan_that_keeps_their_limits(
    seed: int, speed: float, law: dict[str, Any]
) -> None:
    """Whatever share of the limits it takes: what is behind their limit of jerk is what the law adds."""
    scene, goal = between(seed, (0.25, 0.75), posture_stiffness=100.0, **law)
    limits = {"acceleration": 6.0, "jerk": 60.0}
    plan = vff.plan(scene, goal, speed=speed, **limits)
    assert plan.status == "found"
    robot = Ideal(scene["q0"])
    with vff.drive(
        robot,
        {**scene, "reference": plan.reference, "duration": plan.duration + 1.0},
        seconds=plan.duration + 1.5,
        limits=limits,
    ) as drive:
        drive.wait(HANG)
    sent = np.array(robot.sent)
    begins = int(np.argmax(np.abs(sent - scene["q0"]).max(axis=1) > 1e-6))
    places = plan.at(1e-3 * np.arange(len(sent)))[0]
    off = [np.abs(sent[i:] - places[: len(sent) - i]).max() for i in range(max(begins - 80, 0), begins)]
    assert min(off) < 0.01
    for order, most in ((2, 6.0), (3, 60.0)):
        assert np.abs(np.diff(sent, order, axis=0)).max() < most * 1e-3**order * 1.01 + 1e-12


@pytest.mark.parametrize(
    "limits", [{"acceleration": 10.0, "jerk": 1000.0}, {"acceleration": 4.0, "jerk": 200.0}]
)
@pytest.mark.parametrize("seed", [0, 4, 12, 16])
def test_set_points_leave_a_plan_in_time(seed: int, limits: dict[str, float]) -> None:
    """Before a ball that comes through the planned place of the forearm, of which the plan knew nothing."""
    scene, goal = between(
        seed, (0.3, 0.7), stiffness=900.0, damping=60.0, posture_stiffness=20.0, avoidance="cbf"
    )
    plan = vff.plan(scene, goal, speed=0.6, **{key: 0.6 * value for key, value in limits.items()})
    assert plan.status == "found"
    meets = 0.5 * plan.duration
    place = PANDA.forward_kinematics(plan.at(meets)[0])[5]
    beside = np.array([-place[1], place[0], 0.0]) / np.linalg.norm(place[:2])  # past the base
    ball = vff.Obstacle.sphere(place + 0.3 * meets * beside, 0.07, motion=vff.Motion.linear(-0.3 * beside))
    robot = Ideal(scene["q0"])
    with vff.drive(
        robot,
        {**scene, "reference": plan.reference, "duration": plan.duration, "obstacles": [ball]},
        seconds=plan.duration + 0.5,
        limits=limits,
    ) as drive:
        drive.wait(HANG)
    assert drive.report.clearance > 0.003, drive.report.notes


@pytest.mark.parametrize("limits", ["a", [[0, 1, 2]], 3.0])
def test_limits_of_set_points_are_a_mapping(limits: Any) -> None:
    scene, _ = between(0, (0.25, 0.75))
    with pytest.raises(InputTypeError, match="limits: expected a mapping"):
        vff.drive(Ideal(scene["q0"]), scene, limits=limits)


def test_what_moves_two_bodies_alike_asks_for_no_more_room_between_them() -> None:
    """A last link that is folded back on another one, 0.5 mm beside it, is carried to where it stays so."""
    folded = [0.0, 0.5 * np.pi, 0.5 * np.pi]
    scene = {
        "duration": 1.0,
        "q0": [0.0, 0.5, *folded],
        "arm": {"lengths": [0.5, 0.4, 0.3, 0.0605, 0.25], "masses": 1.0, "radius": 0.03},
        "reference": {"kind": "setpoint", "point": [1.0, 0.3]},
        "controller": {"self_collision": "avoid"},
    }
    plan = vff.plan(scene, [1.0, -0.5, *folded], samples=0)
    assert plan.status == "found", plan.message
    said = "keep 0.45 mm at the start, 0.45 mm at the goal from each other, up to 2 mm elsewhere"
    assert f"bodies of the arm {said}" in plan.message
    q, _, _ = plan.at(np.linspace(0.0, plan.duration, 200))
    assert np.abs(q[:, 3:] - folded[1:]).max() < 1e-9, "it stays so"
    apart = vff.plan(scene, [1.0, -0.5, 0.0, 0.3, 0.5])
    said = "bodies of the arm keep 0.45 mm from each other all the way"
    assert apart.status == "found" and said in apart.message, "no motion takes the one away from the other"
