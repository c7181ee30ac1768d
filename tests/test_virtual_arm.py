"""Set points for robots that take positions or velocities (docs/theory.md, T116), with servos in MuJoCo."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError

READY = np.array([0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854])
PERIOD = 1e-3
ACCELERATION, JERK, SPEED = 5.0, 500.0, 1.0
SCRIPT = Path(__file__).parents[1] / "docs" / "make_set_points.py"


def virtual(**more: Any) -> vff.VirtualArm:
    settings = vff.ControlSettings(stiffness=100.0, damping=20.0, null_damping=8.0)
    limits = {"acceleration": ACCELERATION, "jerk": JERK, "speed": SPEED, **more}
    return vff.VirtualArm(vff.Controller(vff.Arm.named("panda"), settings), READY, PERIOD, **limits)


def away() -> Any:
    return vff.Arm.named("panda").forward_kinematics(READY)[-1] + [0.0, 0.3, 0.1]


def test_limits_are_kept() -> None:
    """To a set point that jumps, within all limits, as a robot would see it: by differences."""
    arm = virtual()
    points = [arm.step(PERIOD * k, away()) for k in range(4000)]
    assert {point[3] for point in points} == {"following"}
    q = np.array([READY] * 3 + [point[0] for point in points])
    speed, acceleration, jerk = (np.abs(np.diff(q, n, axis=0)).max() / PERIOD**n for n in (1, 2, 3))
    assert 0.3 < speed <= SPEED + JERK * PERIOD**2 / 8
    assert 0.9 * ACCELERATION < acceleration <= ACCELERATION * (1 + 1e-6)
    assert 0.9 * JERK < jerk <= JERK * (1 + 1e-3)
    assert np.linalg.norm(vff.Arm.named("panda").forward_kinematics(q[-1])[-1] - away()) < 1e-3
    # What is handed out belongs together.
    dq, ddq = (np.array([point[i] for point in points]) for i in (1, 2))
    change = q[4:] - q[3:-1] - PERIOD * (dq[:-1] + PERIOD * (2 * ddq[:-1] + ddq[1:]) / 6)
    assert np.abs(change).max() < 1e-12
    assert np.abs(np.diff(dq, axis=0) - 0.5 * PERIOD * (ddq[1:] + ddq[:-1])).max() < 1e-12


def test_it_is_the_closed_loop() -> None:
    """Where the limits do not matter: the motion of a simulation, to the order of the period."""
    arm, target = virtual(acceleration=1e4, jerk=1e9, speed=100.0), away()
    for k in range(2000):
        q, *_ = arm.step(PERIOD * k, target)
    result = vff.simulate(
        {
            "duration": 2.0,
            "q0": list(READY),
            "arm": {"model": "panda"},
            "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 8.0, "enforce_limits": True},
            "reference": {"kind": "setpoint", "point": list(target)},
        }
    )
    assert np.abs(result.q[-1] - READY).max() > 0.3
    assert np.abs(q - result.q[-1]).max() < 5e-3


@pytest.mark.parametrize("avoidance", ["cbf", "null_space"])
@pytest.mark.parametrize("task", ["pose", "position"])
@pytest.mark.parametrize("stiffness", [10.0, 100.0])
def test_no_posture_lets_an_arm_swing(avoidance: str, task: str, stiffness: float) -> None:
    """However stiff its spring is (T202), the arm comes to rest, and the hand stays where it is."""
    panda = vff.Arm.named("panda")
    posture = READY + np.array([0.8, -0.4, 0.6, 0.3, -0.7, 0.5, -0.6])
    settings = vff.ControlSettings(
        task=task, stiffness=900.0, damping=60.0, null_damping=6.0, posture=list(posture),
        posture_stiffness=stiffness, avoidance=avoidance, deadline="unlimited",
    )  # fmt: skip
    arm = vff.VirtualArm(vff.Controller(panda, settings), READY, PERIOD, acceleration=4.0, jerk=200.0)
    place, turn = panda.pose(READY)
    target = np.r_[place, turn] if task == "pose" else place
    points = [arm.step(PERIOD * k, target) for k in range(8000)]
    hand = [panda.pose(q)[0] for q, *_ in points[::20]]
    assert np.linalg.norm(np.array(hand) - place, axis=1).max() < 3e-3
    assert np.ptp([q for q, *_ in points[-1000:]], axis=0).max() < 2e-3
    assert np.abs(points[-1][0] - READY).max() > 0.1  # it has gone somewhere


@pytest.mark.parametrize(
    "settings", [{"command": "of the robot"}, {"observer": {"detection": {}}, "touch": {"reaction": {}}}]
)
def test_nobody_pushes_a_model(settings: dict[str, Any]) -> None:
    """What limits take of a law's torque is no push: a hand whose target jumps arrives."""
    panda = vff.Arm.named("panda")
    law = {"task": "pose", "stiffness": 400.0, "damping": 40.0, "null_damping": 10.0} | settings
    controller = vff.Controller(panda, vff.ControlSettings(**law))
    arm = vff.VirtualArm(controller, READY, PERIOD, acceleration=7.5, jerk=750.0)
    place, turn = panda.pose(READY)
    goal = place + np.array([0.0, 0.15, -0.05])
    points = [arm.step(PERIOD * k, np.r_[goal, turn]) for k in range(3000)]
    assert np.linalg.norm(panda.pose(points[-1][0])[0] - goal) < 1e-4
    assert controller.tau_ext_estimate is not None and not np.any(controller.tau_ext_estimate)
    assert controller.touched_link is None


def test_a_posture_that_gives_way_to_a_push_comes_back() -> None:
    """What a reaction lets go of is let go of any spring (T202): 1 N·m for a second moves little."""
    panda = vff.Arm.named("panda")
    posture = READY + 0.8 * np.eye(7)[0]
    settings = vff.ControlSettings(
        task="pose", stiffness=400.0, damping=40.0, null_damping=10.0,
        posture=list(posture), posture_stiffness=300.0,
        observer={"source": "measured", "detection": {}}, touch={"reaction": {}},
    )  # fmt: skip
    controller = vff.Controller(panda, settings)
    arm = vff.VirtualArm(controller, READY, PERIOD, acceleration=7.5, jerk=750.0)
    target, points = np.concatenate(panda.pose(READY)), []
    for k in range(5000):
        controller.sense([0.0, 0.0, 1.0 if 2000 <= k < 3000 else 0.0, 0.0, 0.0, 0.0, 0.0])
        points.append(arm.step(PERIOD * k, target)[0])
    off = np.abs(np.array(points[2000:]) - points[1999]).max(axis=1)
    assert 0.01 < off.max() < 0.1 and off[-1] < 0.02
    assert np.linalg.norm(panda.pose(points[-1])[0] - target[:3]) < 1e-3


@pytest.mark.parametrize("step", [[0.0, 0.0, -0.3], [-0.15, 0.25, 0.1], [0.1, -0.3, -0.2]])
@pytest.mark.parametrize("avoidance", ["null_space", "priority"])
@pytest.mark.parametrize("task", ["position", "pose"])
def test_the_tip_is_no_faster_than_it_may_be(task: str, avoidance: str, step: list[float]) -> None:
    """With the low limits of its maker, which an xArm7 cannot brake within as fast as a torque could."""
    arm, start = vff.Arm.named("xarm7"), [0.0, 0.3, 0.0, 1.2, 0.0, 0.9, 0.0]
    law = {"task": task, "stiffness": 100.0, "damping": 20.0, "null_damping": 12.0, "avoidance": avoidance}
    controller = vff.Controller(arm, law | {"command": {"tip_speed": 0.3}})
    period = 4e-3
    virtual = vff.VirtualArm(controller, start, period, acceleration=20.0, jerk=20.0)
    place, orientation = arm.pose(start)
    target: Any = np.array(place) + step
    if task == "pose":
        target = (target, orientation)
    q = [start, *(virtual.step(period * k, x_ref=target)[0] for k in range(1000))]
    tips = arm.forward_kinematics(np.array(q))[:, -1]
    assert np.linalg.norm(np.diff(tips, axis=0), axis=1).max() / period < 1.02 * 0.3
    assert np.linalg.norm(tips[-1] - (place + np.array(step))) < 2e-2


@pytest.mark.parametrize("avoidance", ["null_space", "priority", "cbf"])
def test_the_law_knows_how_fast_the_joints_may_be(avoidance: str) -> None:
    """As if it were the arm's own: clipped joint by joint, the hand turned at 1.5 to 2 times its limit."""
    law = {"task": "pose", "stiffness": 400.0, "damping": 40.0, "null_damping": 10.0}
    law |= {"avoidance": avoidance, "command": {"tip_angular_speed": 0.5}}
    ready = {"duration": 1.0, "q0": list(READY), "reference": {"kind": "setpoint"}}
    slow = vff.Scenario.from_dict({**ready, "arm": {"model": "panda", "velocity_limits": [1.0] * 7}}).arm
    place, turn = slow.pose(READY)
    ways = []
    for arm, more in ((vff.Arm.named("panda"), {"speed": 1.0}), (slow, {})):
        virtual = vff.VirtualArm(
            vff.Controller(arm, law), READY, PERIOD, acceleration=30.0, jerk=1000.0, **more
        )
        target = (place + np.array([0.25, 0.25, -0.2]), turn)
        steps = [virtual.step(PERIOD * k, target) for k in range(2000)]
        turning = [np.linalg.norm((arm.jacobian(q) @ dq)[3:]) for q, dq, *_ in steps]
        assert max(turning) < 1.01 * 0.5
        ways.append(np.array([q for q, *_ in steps]))
    np.testing.assert_allclose(*ways, atol=1e-9)


def test_a_stop_ends_a_motion_of_the_null_space_as_one() -> None:
    """All joints alike: the hand goes on no faster than it may, but for how the arm has moved meanwhile."""
    arm = vff.Arm.named("panda")
    law = {
        "task": "pose",
        "stiffness": 400.0,
        "damping": 40.0,
        "null_damping": 10.0,
        "posture": list(READY + np.array([1.5, 0.0, -1.5, 0.0, 0.0, 0.0, 0.0])),
        "posture_stiffness": 60.0,
        "command": {"tip_speed": 0.05},
    }
    virtual = vff.VirtualArm(vff.Controller(arm, law), READY, PERIOD, acceleration=10.0, jerk=1000.0)
    target = arm.pose(READY)
    swings = max(abs(virtual.step(PERIOD * k, target)[1]).max() for k in range(300))
    virtual.stop()
    tips = []
    while virtual.course != "finished":
        q, dq, *_ = virtual.step(0.3, target)
        tips.append(np.linalg.norm((arm.jacobian(q) @ dq)[:3]))
    assert swings > 0.8 and max(tips) < 1.1 * 0.05 and len(tips) < 1000


@pytest.mark.parametrize("beyond", [0.02, 0.15])
def test_a_joint_beyond_its_stop_comes_back_slowly(beyond: float) -> None:
    """At the largest acceleration, the tip went at 8 times its limit."""
    arm = vff.Arm.named("panda")
    start = READY.copy()
    start[3] = arm.joint_limits[3][1] + beyond
    law = {"stiffness": 100.0, "damping": 20.0, "null_damping": 8.0, "command": {"tip_speed": 0.05}}
    virtual = vff.VirtualArm(vff.Controller(arm, law), start, PERIOD, acceleration=10.0, jerk=1000.0)
    target, tips = arm.forward_kinematics(start)[-1], []
    for k in range(6000):
        q, dq, *_ = virtual.step(PERIOD * k, target)
        tips.append(np.linalg.norm((arm.jacobian(q) @ dq)[:3]))
    assert max(tips) < 1.1 * 0.05 and q[3] <= arm.joint_limits[3][1] + 1e-9


def test_a_robot_that_is_held() -> None:
    """It parts from its set point, which comes back to it within the limits; let go, it goes on."""
    arm, target, points = virtual(), away(), []
    robot = READY.copy()
    for k in range(6000):
        q, _, _, course = arm.step(PERIOD * k, target, q=robot, dq=np.zeros(7))
        points.append((q, course))
        if 400 <= k < 3000:
            assert np.abs(q - robot).max() < 0.1 + SPEED**2 / (2 * 0.8 * ACCELERATION)
        else:
            robot = robot + np.clip(0.05 * (q - robot), -0.01, 0.01)
    courses = [course for _, course in points]
    assert courses[0] == "following" and "rejoining" in courses[400:3000]
    assert not {"waiting", "stopping"} & set(courses)
    assert courses[-1] == "following"
    assert np.linalg.norm(vff.Arm.named("panda").forward_kinematics(robot)[-1] - target) < 5e-3
    q = np.array([q for q, _ in points])
    assert np.abs(np.diff(q, 3, axis=0)).max() / PERIOD**3 <= JERK * (1 + 1e-3)


def test_a_robot_that_falls_silent() -> None:
    """The set point stops, until the robot is heard of again; one that never was is not missed."""
    arm, target = virtual(), away()
    course = ""
    for k in range(300):
        q, dq, _, course = arm.step(PERIOD * k, target)
    assert course == "following" and np.abs(dq).max() > 0.05
    arm.step(0.3, target, q=q, dq=dq)
    courses = [arm.step(0.3, target, q=[np.nan] * 7, dq=dq)[3] for _ in range(3000)]
    assert courses[:19] == ["following"] * 19 and set(courses[19:]) == {"waiting"}
    q, dq, *_ = arm.step(0.3, target)
    assert np.abs(dq).max() < 1e-3
    assert arm.step(0.3, target, q=q, dq=dq)[3] == "following"


@pytest.mark.parametrize("model", ["panda", "gen3"])
@pytest.mark.parametrize("far", [0.5, 3.5, 1e6])
def test_one_wild_reading_is_none_of_the_robot(model: str, far: float) -> None:
    """The set points are as if it had not come, also where a joint turns without an end (gen3), which was led
    round once; what is said twice is believed.
    """
    controller = vff.Controller(vff.Arm.named(model), {"stiffness": 100.0, "damping": 20.0})
    points: list[Any] = []
    for wild in (0.0, far):
        arm = vff.VirtualArm(controller, READY, PERIOD, acceleration=ACCELERATION, jerk=JERK)
        q, target = READY, vff.Arm.named(model).forward_kinematics(READY)[-1] + [0.0, 0.2, 0.1]
        for k in range(600):
            said = q + wild * np.eye(7)[0] * (k == 300)
            q, _, _, course = arm.step(PERIOD * k, target, q=said, dq=np.zeros(7))
            assert course == "following"
            points.append(q)
    np.testing.assert_array_equal(points[:600], points[600:])
    said = q + 0.5
    assert [arm.step(0.6, target, q=said, dq=np.zeros(7))[3] for _ in range(2)] == ["following", "rejoining"]


def test_a_loop_of_torques_before_changes_nothing() -> None:
    """Barriers know what set points can: a ball in the way is kept from as by a controller that is new."""
    settings = {"stiffness": 400.0, "damping": 40.0, "avoidance": "cbf", "command": {"gravity": "robot"}}
    ball, target = vff.Obstacle.sphere([0.6, 0.0, 0.45], 0.1), [0.6, 0.0, 0.45]
    ways = []
    for is_new in (True, False):
        controller = vff.Controller(vff.Arm.named("panda"), settings)
        if not is_new:
            controller.begin(PERIOD)
            controller.cycle(0.0, READY, np.zeros(7))
        arm = vff.VirtualArm(controller, READY, PERIOD, acceleration=2.0, jerk=40.0)
        way = [arm.step(PERIOD * k, x_ref=target, obstacles=[ball])[0] for k in range(1500)]
        ways.append(np.array(way))
    np.testing.assert_array_equal(*ways)
    assert vff.distances(vff.Arm.named("panda"), ways[0], np.zeros((1500, 7)), [ball]).distance.min() > 0.01


def test_a_stop() -> None:
    arm, target = virtual(), away()
    for k in range(300):
        arm.step(PERIOD * k, target)
    arm.stop()
    courses = [arm.step(0.3, target)[3] for _ in range(3000)]
    assert courses[0] == "stopping" and courses[-1] == arm.course == "finished"
    arm.begin(READY)
    assert arm.step(0.0, target)[3] == "following"


@pytest.mark.parametrize(
    ("more", "says"),
    [
        ({"acceleration": 0.0}, "acceleration must be finite and greater than 0, got 0"),
        ({"jerk": [1.0] * 6}, r"jerk"),
        ({"jerk": np.nan}, "jerk"),
        ({"speed": [1.0] * 6 + [-1.0]}, "speed must be finite and greater than 0, got -1"),
        ({"threshold": 0.0}, "threshold"),
    ],
)
def test_bad_limits(more: dict[str, Any], says: str) -> None:
    with pytest.raises(InputError, match=says):
        virtual(**more)


def test_a_speed_is_needed() -> None:
    """An arm without velocity limits has none."""
    controller = vff.Controller(vff.Arm.uniform(3))
    with pytest.raises(InputError, match="speed"):
        vff.VirtualArm(controller, [0.1] * 3, PERIOD, 1.0, 1.0)
    arm = vff.VirtualArm(controller, [0.1] * 3, PERIOD, 1.0, 1.0, speed=1.0)
    assert repr(arm) == "<VirtualArm: 3 joints>"
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError):
            arm.begin([0.1, bad, 0.1])
        with pytest.raises(InputError):
            arm.step(bad)


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    """The script that draws the figure: a Panda in MuJoCo under position servos."""
    pytest.importorskip("mujoco")
    spec = importlib.util.spec_from_file_location("make_set_points", SCRIPT)
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # where dataclasses look for their types
    spec.loader.exec_module(module)
    return module


def test_position_servos(bench: ModuleType) -> None:
    """What the documentation says of tracking and clearance: at once, 8 ms late, and that much ahead."""
    torque, servos, late, ahead = (
        bench.run(*given, duration=4.5) for given in ((None,), (0.0,), (0.008,), (0.008, 0.008))
    )
    for outcome in (servos, late, ahead):
        assert set(outcome.courses) == {"following"}
        jerk = np.abs(np.diff(outcome.set_points[:, 0], 3, axis=0)) / bench.PERIOD**3
        assert (jerk.max(axis=0) <= np.array(bench.JERK) * (1 + 1e-3)).all()
        assert outcome.clearance.min() > torque.clearance.min() - 1e-3
    errors = [1e3 * outcome.error.max() for outcome in (torque, servos, late, ahead)]
    assert errors[0] < 0.1 and errors[1] < 0.5 and 1.0 < errors[2] < 2.0 and errors[3] < 0.5, errors
    assert torque.clearance.min() > 0.09
