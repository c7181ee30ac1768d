"""Emulated robots: every rule trips where its maker says so and not before; adapters run against them as
against robots; and what a user is shown.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError
from vffnull.robots import checks, emulated
from vffnull.robots.emulated import Disturbances, franka, ur
from vffnull.robots.franka import FrankaRobot
from vffnull.robots.ur import URRobot
from vffnull.run import emulate as emulation
from waiting import HANG

SCENE = vff.Scenario.load("panda-sweep")
PANDA = SCENE.arm
FR3 = SCENE.replace(arm={"model": "fr3"}, q0=[0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854])
UR_SCENE = vff.Scenario.load("ur5e-crossed")
OF_FRANKA = SCENE["controller"] | {"command": "of the robot"}
OF_UR = {
    "task": "position",
    "stiffness": 100.0,
    "damping": 20.0,
    "null_damping": 8.0,
    "command": "of the robot",
}
LOAD = {"mass": 2.0, "com": [0.0, 0.0, 0.05]}
BALL = vff.Obstacle.sphere([-0.05, -0.3, 0.62], 0.08, vff.Motion.linear([0.0, 0.4, 0.0]))


def drive(robot: Any, arm: vff.Arm, settings: Any, **more: Any) -> vff.DriveReport:
    with vff.drive(robot, vff.Controller(arm, settings), **more) as driven:
        assert driven.wait(HANG)
    return driven.report


def push(robot: franka.Robot, torques: Any) -> None:
    """Send torques (k, 7), one a cycle, until the robot has enough."""
    control = robot.start_torque_control()
    for torque in torques:
        control.readOnce()
        control.writeOnce(franka.Torques(list(torque)))
        if robot.reflex is not None:
            return


def towards(joint: int, sign: float, cycles: int, most: float = 80.0) -> Any:
    """A torque on one joint that grows as fast as it may."""
    found = np.zeros((cycles, 7))
    found[:, joint] = sign * np.minimum(np.arange(cycles), most)
    return found


# The rules of Franka's interface


def test_the_rate_counts_from_the_torque_that_was_used() -> None:
    """1000 N·m/s are allowed, against what was used last: after a lost command another one than was sent."""
    robot = franka.Robot(SCENE)
    push(robot, [[0.0] * 7, [1.0] * 7, [0.0] * 7])
    assert robot.reflex is None
    push(robot := franka.Robot(SCENE), [[0.0] * 7, [0.0, 0.0, 1.001, 0.0, 0.0, 0.0, 0.0]])
    reflex = robot.reflex
    assert reflex is not None and reflex.rule.name == "controller_torque_discontinuity"
    assert (reflex.place, reflex.cycle) == ("panda_joint3", 2)
    assert reflex.value == pytest.approx(1001.0) and reflex.limit == pytest.approx(1000.0)
    robot = franka.Robot(SCENE)
    control = robot.start_torque_control()
    for k in range(3):  # the second is never sent
        control.readOnce()
        if k != 1:
            control.writeOnce(franka.Torques([0.6 * k] * 7))
    assert robot.reflex is not None and robot.reflex.value == pytest.approx(1200.0)


@pytest.mark.parametrize(
    ("scene", "joint", "sign", "name"),
    [
        (SCENE, 0, 1.0, "joint_velocity_violation"),
        (SCENE, 0, -1.0, "joint_velocity_violation"),
        (SCENE, 5, 1.0, "tau_j_range_violation"),
        (SCENE, 6, 1.0, "joint_velocity_violation"),
        (FR3, 0, 1.0, "joint_velocity_violation"),
    ],
)
def test_a_joint_that_is_pushed_trips(scene: vff.Scenario, joint: int, sign: float, name: str) -> None:
    """It trips in the first cycle in which the arm is beyond the limit, and the robot brakes."""
    robot = franka.Robot(scene)
    seen: list[tuple[float, float]] = []
    robot.before_state = lambda there: seen.append((there.body.dq[joint], abs(there.tau_J[joint])))
    push(robot, towards(joint, sign, 2000, most=86.9))
    reflex = robot.reflex
    assert reflex is not None and reflex.rule.name == name and reflex.place.endswith(f"joint{joint + 1}")
    arm = scene.arm
    assert arm.velocity_limits is not None and arm.torque_limits is not None
    speeds, torques = np.abs(seen).T
    assert speeds.max() <= arm.velocity_limits[joint] and torques.max() <= arm.torque_limits[joint]
    assert abs(reflex.value) > reflex.limit and np.abs(robot.body.dq).max() < 2e-3
    assert reflex.rule.source.startswith("https://frankarobotics.github.io/docs/")


def test_fr3_is_slower_near_the_ends() -> None:
    """The limit falls towards an end, as libfranka computes it, and is none on the way back."""
    upper, lower = 2.7437, -2.7437
    at = [2.6, -0.5, 0.0, -2.0, 0.0, 2.0, 0.0]
    most = franka._fr3_speeds(np.array(at), np.ones(7))
    back = franka._fr3_speeds(np.array(at), -np.ones(7))
    assert most[0] == pytest.approx(-0.30 + np.sqrt(12.0 * (2.75010 - 2.6))) and back[0] == 2.62
    assert most[1:].tolist() == [2.62, 2.62, 2.62, 5.26, 4.18, 5.26]
    for end in (upper, lower):
        q = np.array([end, *at[1:]])
        assert franka._fr3_speeds(q, np.sign(end) * np.ones(7))[0] < 0.01
    robot = franka.Robot(FR3.replace(q0=[2.5, *at[1:]], obstacles=[]))
    push(robot, towards(0, 1.0, 4000, most=10.0))
    reflex = robot.reflex
    assert reflex is not None and reflex.rule.name == "joint_velocity_violation"
    assert reflex.limit < 1.4 and robot.body.q[0] < upper


@pytest.mark.parametrize(("avoidance", "sign"), [("cbf", 1.0), ("null_space", -1.0)])
def test_fr3_comes_slowly_to_its_stops(avoidance: str, sign: float) -> None:
    """Its base turns to 2.7 of 2.74 rad, with the speed that its maker allows where it is and not more."""
    start, goal = (np.array([sign * q, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]) for q in (2.0, 2.7))
    point, orientation = FR3.arm.pose(goal)
    spring = {"posture": goal.tolist(), "posture_stiffness": 60.0, "null_damping": 14.0}
    scene = FR3.replace(
        duration=1.5,
        q0=start.tolist(),
        obstacles=[],
        reference={"kind": "setpoint", "point": point.tolist(), "orientation": orientation.tolist()},
        controller=OF_FRANKA | spring | {"avoidance": avoidance},
    )
    outcome = emulation.emulate(scene)
    assert outcome.reflex is None
    shares = {each.rule.what: each.share for each in outcome.margins}
    assert 0.85 < shares["the speed"] < 0.91 and shares["the angle from mid-range"] > 0.98


def test_a_joint_leaves_its_range() -> None:
    """Slowly out of it: the position is what trips."""
    robot = franka.Robot(SCENE.replace(q0=[2.89, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854], obstacles=[]))
    push(robot, towards(0, 1.0, 4000, most=1.0))
    reflex = robot.reflex
    assert reflex is not None and reflex.rule.name == "joint_position_limits_violation"
    assert reflex.value == pytest.approx(2.8973, abs=1e-3) and reflex.place == "panda_joint1"


def test_twenty_lost_packets_in_a_row_are_the_end() -> None:
    """19 are not; meanwhile the last torque acts on."""
    for unanswered, over in ((19, False), (20, True)):
        robot = franka.Robot(SCENE)
        control = robot.start_torque_control()
        control.readOnce()
        control.writeOnce(franka.Torques([0.5] * 7))
        ended = False
        try:
            for _ in range(unanswered + 1):
                state, _ = control.readOnce()
                np.testing.assert_array_equal(state.tau_J_d, 0.5)
        except franka.ControlException as error:
            ended = True
            assert "communication_constraints_violation" in str(error) and error.reflex is robot.reflex
        assert ended is over


def test_a_program_that_is_late_is_not_heard() -> None:
    robot = franka.Robot(SCENE, deadline=0.5)
    control = robot.start_torque_control()
    for k in range(4):
        control.readOnce()
        time.sleep(0.7 if k == 2 else 0.0)
        control.writeOnce(franka.Torques([0.1 * (k + 1)] * 7))
    assert list(robot.taken)[2] is False and robot.tau_J_d[0] == pytest.approx(0.4)


def test_a_load_is_a_collision_unless_it_is_told() -> None:
    """3 kg are a force at the hand; the robot that knows of them feels nothing, and carries them."""
    load = {"mass": 3.0, "com": [0.0, 0.0, 0.0]}
    robot = franka.Robot(SCENE, Disturbances(load=load))
    robot.set_collision_behavior([40.0] * 7, [40.0] * 7, [5.0] * 6, [5.0] * 6)
    push(robot, np.zeros((500, 7)))
    reflex = robot.reflex
    assert reflex is not None and reflex.rule.name == "cartesian_reflex" and reflex.place == "z"
    assert 5.0 < abs(reflex.value) < 3.0 * 9.81 + 1e-9
    # Told of it, the next motion has nothing of the last one's force, whatever cycle it begins in.
    FrankaRobot(robot).recover()
    FrankaRobot(robot).set_load(3.0, [0.0, 0.0, 0.2104 - 0.107])
    push(robot, np.zeros((20, 7)))
    assert robot.reflex is None
    there = franka.Robot(SCENE, Disturbances(load=load))
    flange = 0.2104 - 0.107  # the tool, from the flange along the axis of the last joint
    adapter = FrankaRobot(there)
    adapter.set_load(3.0, [0.0, 0.0, flange])
    start = adapter.positions()
    model = checks.gravity(PANDA, [start], [adapter.gravity_torque()])
    assert model.worst > 10.0  # the load is in the robot's model
    push(there, np.zeros((500, 7)))
    assert there.reflex is None and np.abs(there.body.q - start).max() < 1e-6
    assert np.abs(there.external).max() < 1e-3


def test_a_robot_says_nothing_of_forces_near_a_singularity() -> None:
    """The joints feel the load there, too; of the force at the hand the robot knows nothing, so that a torque
    of some N·m is no collision of 100 N.
    """
    scene = SCENE.replace(obstacles=[])
    for elbow, known in ((-0.5, False), (-2.3562, True)):  # stretched, and bent
        q = np.array([0.0, -0.7854, 0.0, elbow, 0.0, 1.5708, 0.7854])
        smallest = np.linalg.svd(PANDA.jacobian(q), compute_uv=False)[-1]
        assert bool(smallest > 0.08) is known
        robot = franka.Robot(scene.replace(q0=q.tolist()), Disturbances(load={"mass": 1.0}))
        push(robot, np.zeros((20, 7)))
        assert np.abs(robot.external).max() > 1.0
        assert bool(np.abs(robot.wrench).max() > 5.0) is known
        assert robot.reflex is None
        if known:  # one that explains what the joints feel as well as any
            left = robot.external - PANDA.jacobian(robot.body.q).T @ robot.wrench
            assert np.abs(PANDA.jacobian(robot.body.q) @ left).max() < 1e-2


def test_a_reflex_has_to_be_recovered() -> None:
    """After one no motion begins; recovery clears it, and then only."""
    robot = franka.Robot(SCENE)
    for torque in (9.0, 7.0, 5.0, 3.0):  # each too much, and less than the one before
        push(robot, [[0.0] * 7, [torque] * 7])
        assert robot.reflex is not None and robot.reflex.rule.name == "controller_torque_discontinuity"
        robot.automatic_error_recovery()
    with pytest.raises(franka.CommandException, match="AutomaticErrorRecovery command rejected"):
        robot.automatic_error_recovery()
    push(robot, [[0.0] * 7, [5.0] * 7])
    with pytest.raises(
        franka.ControlException, match=r'aborted by reflex! \["controller_torque_discontinuity"\]'
    ):
        robot.readOnce()
    state = robot.read_once()
    assert state.robot_mode is franka.RobotMode.Reflex and state.current_errors
    assert state.current_errors.controller_torque_discontinuity and not state.current_errors.joint_reflex
    with pytest.raises(franka.CommandException, match="not possible in the current mode"):
        robot.start_torque_control()
    adapter = FrankaRobot(robot)
    adapter.recover()
    assert drive(adapter, PANDA, OF_FRANKA, seconds=0.2).status == "completed"


def test_margins_say_how_near_it_came() -> None:
    robot = franka.Robot(SCENE)
    push(robot, [[0.0] * 7, [0.0, 0.25, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0] * 7])
    rate = robot.margins()[0]
    assert (rate.place, rate.cycle) == ("panda_joint2", 2) and rate.share == pytest.approx(0.25)
    assert {each.rule.name for each in robot.margins()} >= {"joint_velocity_violation", "joint_reflex"}


# The adapter of Franka's arms


def test_franka_is_driven() -> None:
    """The elbow gives way, the hand stays, and no rule is broken."""
    there = franka.Robot(SCENE)
    robot = FrankaRobot(there)
    start = robot.positions()
    assert checks.gravity(PANDA, [start], [robot.gravity_torque()]).worst < 1e-12
    assert checks.mass_matrix(PANDA, [start], [robot.mass_matrix()]).worst < 1e-12
    report = drive(robot, PANDA, OF_FRANKA, obstacles=[BALL], seconds=1.5)
    assert (report.status, len(report.latency), report.notes) == ("completed", 0, ())
    assert there.reflex is None and there.mode is franka.RobotMode.Idle
    q, dq = there.body.q, there.body.dq
    assert abs(q - start).max() > 0.02 and abs(dq).max() < 0.02
    assert np.linalg.norm(PANDA.pose(q)[0] - PANDA.pose(start)[0]) < 2e-3
    with pytest.raises(InputError, match="torque_rate is none"):
        vff.drive(robot, vff.Controller(PANDA, SCENE["controller"] | {"command": {"gravity": "robot"}}))
    for needs_it in (robot.read, lambda: robot.write(np.zeros(7))):
        with pytest.raises(InputError, match="begin"):
            needs_it()


@pytest.mark.parametrize("load", [{}, {"mass": 1.0, "com": [0.0, 0.05, 0.0]}], ids=["", "1 kg"])
def test_a_hand_that_is_free_to_turn_ends_no_motion(load: dict[str, Any]) -> None:
    """`relaxed` gives up its orientation between boards, past a singularity, with a weight beside its axis
    that nobody knows of.
    """
    relaxed = {"controller.avoidance": "relaxed", "controller.yielding": None, "controller.governor": None}
    disturbances = replace(emulated.usual("emulated-franka", seed=500), load=load)
    outcome = emulation.emulate(
        "panda-shelf", disturbances=disturbances, overrides=relaxed, collision_force=40.0
    )
    assert outcome.reflex is None and outcome.report.status == "completed"
    turning = next(each for each in outcome.margins if each.rule.what == "the turning of the hand")
    assert 0.75 < turning.share < 0.95


def test_lost_commands_do_not_break_the_rate() -> None:
    """With a tenth of the packets lost, each torque is within the rate of the one that the robot has used."""
    there = franka.Robot(SCENE, Disturbances(loss=0.1, velocity_noise=0.01, delay=1, seed=2))
    report = drive(FrankaRobot(there), PANDA, OF_FRANKA, obstacles=[BALL], seconds=1.5)
    assert report.status == "completed" and there.reflex is None
    assert report.periods < 3000, "it stands, whatever the noise of its velocities"
    rate, lost = there.margins()[0], there.margins()[-1]
    assert 0.9 < rate.share <= 1.0 and lost.value >= 2.0


def test_franka_has_a_reflex() -> None:
    """What the robot raises is the reason, and the motion is over; no setting is taken meanwhile."""
    there = franka.Robot(SCENE)
    robot = FrankaRobot(there)
    robot.set_collision_behavior(40.0, 20.0)
    refused: list[str] = []

    def bump(present: franka.Robot) -> None:
        if present.body.cycle == 700:
            try:
                robot.set_load(1.0)
            except InputError as error:
                refused.append(str(error))
            present.body.dq = present.body.dq + 1e3  # what no arm does, and its robot takes for a collision

    there.before_state = bump
    with pytest.warns(RuntimeWarning, match="aborted by reflex"):
        report = drive(robot, PANDA, OF_FRANKA)
    assert report.status == "fault" and "motion aborted by reflex" in report.reason
    assert refused == ["robot: is being driven"] and isinstance(report.cause, franka.ControlException)
    assert np.abs(robot.external_torque()).shape == (7,)


def test_thresholds_are_the_robot_s() -> None:
    there = franka.Robot(SCENE, Disturbances(load={"mass": 1.0}))
    robot = FrankaRobot(there)
    robot.set_collision_behavior([30.0] * 7, 5.0, contact_torque=2.0, contact_force=1.0)
    push(there, np.zeros((200, 7)))
    assert there.reflex is not None and there.reflex.limit == 5.0
    state = there.read_once()
    assert state.cartesian_contact[2] == 1.0 and state.joint_collision.max() == 0.0
    for wrong in (-1.0, [1.0] * 5, np.nan):
        with pytest.raises(InputError, match="torque"):
            FrankaRobot(franka.Robot(SCENE)).set_collision_behavior(wrong, 10.0)


# Universal Robots


def test_ur_is_driven() -> None:
    """To a place some centimetres away, on the robot's own time; with a load that it is told of."""
    there = ur.Robot(UR_SCENE, Disturbances(load=LOAD))
    robot = URRobot(there, viscous_scale=0.5, watchdog=50.0)
    robot.paces = True  # type: ignore[attr-defined]
    robot.set_load(2.0, [0.0, 0.0, 0.05])
    arm, start = UR_SCENE.arm, robot.positions()
    loaded = vff.Scenario(
        arm=arm,
        q0=start,
        duration=1.0,
        reference={"kind": "setpoint"},
        plant={"payload": dict(there.body._noise.load)},
    ).plant
    assert checks.mass_matrix(loaded, [start], [robot.mass_matrix()]).worst < 1e-12
    goal = arm.pose(start)[0] + [0.0, 0.03, 0.02]
    settings = OF_UR | {"command": {"gravity": "robot"}}
    report = drive(robot, loaded, settings, rate=500.0, x_ref=goal, seconds=3.0)
    assert (report.status, report.reason, there.reflex) == ("completed", "", None)
    assert np.linalg.norm(arm.pose(there.body.q)[0] - goal) < 2e-3
    assert not there.isProgramRunning()


@pytest.mark.parametrize(
    ("torque", "steps", "name"),
    [
        ([0.0, 400.0, 0.0, 0.0, 0.0, 0.0], 1, "joint_torque"),
        ([30.0, 0.0, 0.0, 0.0, 0.0, 0.0], 500, "joint_speed"),
        ([2.0, 0.0, 0.0, 0.0, 0.0, 0.0], 500, "tool_speed"),
    ],
)
def test_ur_stops_by_itself(torque: list[float], steps: int, name: str) -> None:
    """Beyond a limit of safety it takes no torque any more, until its program is put back."""
    there = ur.Robot(UR_SCENE, tool_speed=0.1 if name == "tool_speed" else 10.0)
    robot = URRobot(there)
    done = [there.directTorque(torque) for _ in range(steps)]
    assert done[-1] is False and there.reflex is not None and there.reflex.rule.name == name
    assert abs(there.reflex.value) > there.reflex.limit and np.abs(there.body.dq).max() < 2e-3
    with pytest.raises(RuntimeError, match="has violated a safety limit"):
        robot.read()
    robot.recover()
    assert there.directTorque([0.0] * 6) and robot.read()[0] == there.body.t


def test_ur_holds_where_no_torque_comes() -> None:
    """A step without a torque is one of position control; too many end the program that has a watchdog."""
    there = ur.Robot(UR_SCENE, Disturbances(loss=0.2, seed=1))
    robot = URRobot(there, watchdog=200.0)
    robot.begin()
    for _ in range(2000):
        if not there.directTorque([0.0] * 6):
            break
    assert there.left > 10 and there.reflex is not None and there.reflex.rule.name == "watchdog"
    assert there.reflex.value > 0.005
    for wrong in (
        {"watchdog": 0.0},
        {"viscous_scale": 1.1},
        {"coulomb_scale": [0.5] * 5},
        {"command": "position"},
    ):
        with pytest.raises(InputError):
            URRobot(there, **wrong)


# A scenario


def test_runs_are_the_same_every_time() -> None:
    """Time is the robot's, and every random number has its seed."""
    first, second = (
        emulation.emulate("panda-cup", disturbances=emulated.usual("emulated-franka", 3), seconds=1.0)
        for _ in "ab"
    )
    assert first.margins == second.margins and first.cycles == second.cycles
    other = emulation.emulate("panda-cup", disturbances=emulated.usual("emulated-franka", 4), seconds=1.0)
    assert other.margins != first.margins


@pytest.mark.parametrize("robot", ["panda-pointing", "panda-shelf", "ur5e-crossed"])
def test_references_are_followed(robot: str) -> None:
    """A circle, a plan and a line: the hand is where the simulation has it that knows of no interface."""
    scene = vff.Scenario.load(robot).replace(obstacles=[], **{"controller.governor": None})
    kind = "emulated-ur" if robot.startswith("ur") else "emulated-franka"
    rate = {"emulated-ur": 500.0}.get(kind, 1000.0)
    step = round(1000.0 / rate)
    simulation = {"dt": 1e-3, "control_every": step, "record_every": step}
    reference = vff.simulate(scene.replace(simulation=simulation, duration=min(scene.duration, 2.5))).x_ref
    seen: list[float] = []

    class Watched(emulation._Watch):
        def __call__(self, there: Any) -> None:
            super().__call__(there)
            place = scene.arm.pose(there.body.q)[0]
            if there.body.t > 2.5:
                return  # it stops
            k = min(max(0, there.body.cycle - round(0.5 * rate)), len(reference) - 1)
            seen.append(float(np.linalg.norm(place - reference[k])))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(emulation, "_Watch", Watched)
        outcome = emulation.emulate(scene, kind, seconds=2.5)
    assert outcome.fine and len(seen) > 1000 and max(seen) < 0.002


@pytest.mark.parametrize("scene", ["panda-sweep", "panda-cup", "panda-pointing", "panda-shelf"])
@pytest.mark.parametrize("avoidance", ["null_space", "cbf"])
def test_nothing_trips_without_disturbances(scene: str, avoidance: str) -> None:
    changes: dict[str, Any] = {"controller.avoidance": avoidance}
    if avoidance == "null_space":
        changes |= {"controller.yielding": None, "controller.governor": None}
    outcome = emulation.emulate(scene, overrides=changes)
    assert outcome.reflex is None and outcome.released == 0, outcome.reflex


def test_the_hand_does_not_turn_too_fast() -> None:
    """`relaxed` would turn the hand beyond 2.5 rad/s as it backs out of the shelf."""
    changes: dict[str, Any] = {"controller.avoidance": "relaxed"}
    changes |= {"controller.yielding": None, "controller.governor": None}
    outcome = emulation.emulate("panda-shelf", overrides=changes, seconds=1.0)
    assert outcome.reflex is None


def test_a_stop_holds_a_load() -> None:
    """A kilogram that nobody knows of moves an arm that is to stand by millimetres; observed, by less."""

    def sunk(**more: object) -> float:
        there = franka.Robot(SCENE, Disturbances(load={"mass": 1.0}))
        seen: list[float] = []
        there.before_state = lambda robot: seen.append(float(PANDA.pose(robot.body.q)[0][2]))
        settings = OF_FRANKA | {"field": vff.Field.khatib(0.0, 0.3)} | more
        drive(FrankaRobot(there), PANDA, settings, seconds=1.5)
        return seen[1500] - min(seen[1500:])

    touch = {"task": "reject", "null_space": "reject"}
    assert sunk() < 0.02
    assert sunk(observer={}, touch=touch) < 0.002


@pytest.mark.parametrize(("avoidance", "seed"), [("cbf", 3), ("priority", 4)])
def test_a_load_beside_a_joint_s_axis_trips_nothing(avoidance: str, seed: int) -> None:
    """With its centre 5 cm off, a kilogram is half of what a wrist's joint moves, and what it and friction
    exert changes while the joint brakes: an observer of 20 1/s came too late by more than the reserve.
    """
    usual = emulated.usual("emulated-franka", seed)
    aside = np.random.default_rng(seed).uniform(-0.05, 0.05, 3).tolist()
    changes: dict[str, Any] = {"controller.governor": None}
    if avoidance == "priority":
        changes["controller.yielding"] = None
    changes |= {"controller.observer": {"threshold": np.asarray(usual.coulomb_friction).tolist()}}
    changes |= {"controller.touch": {"task": "reject", "null_space": "reject"}}
    disturbances = replace(usual, load={"mass": 1.0, "com": aside})
    outcome = emulation.emulate(
        "panda-shelf",
        disturbances=disturbances,
        overrides=changes | {"controller.avoidance": avoidance},
        collision_force=40.0,
    )
    assert outcome.reflex is None and outcome.clearance is not None and outcome.clearance > 0.0
    shares = {each.rule.what: each.share for each in outcome.margins}
    assert shares["the speed"] < 0.97 and shares["the angle from mid-range"] < 0.995


@pytest.mark.parametrize("source", ["momentum", "measured"])
def test_a_load_is_held_from_the_first_cycle_on(source: str) -> None:
    """The robot feels a kilogram that it was not told of, with the sign that libfranka gives it. Nobody waits
    until it has sunk.
    """
    there = franka.Robot(SCENE, Disturbances(load={"mass": 1.0}))
    adapter = FrankaRobot(there)
    seen: list[float] = []
    there.before_state = lambda robot: seen.append(float(PANDA.pose(robot.body.q)[0][2]))
    touch = {"task": "reject", "null_space": "reject"}
    settings = OF_FRANKA | {
        "field": vff.Field.khatib(0.0, 0.3),
        "observer": {"source": source},
        "touch": touch,
    }
    drive(adapter, PANDA, settings, seconds=1.0)
    assert seen[0] - min(seen) < 1e-3
    held = PANDA.jacobian(there.body.q)[:3].T @ [0.0, 0.0, -9.81]
    np.testing.assert_allclose(adapter.external_torque(), held, atol=0.05)


def test_mujoco_is_another_physics() -> None:
    """The same scene moved by MuJoCo: no reflex, and nearly the same margins."""
    pytest.importorskip("mujoco")
    own, theirs = (
        emulation.emulate("panda-sweep", seconds=2.0, physics=which) for which in ("own", "mujoco")
    )
    assert theirs.fine and own.fine
    for ours, other in zip(own.margins[1:4], theirs.margins[1:4], strict=True):
        assert ours.place == other.place and ours.share == pytest.approx(other.share, rel=0.05)
    hit = emulation.emulate("panda-sweep", overrides={"controller.field.gain": 0.0}, physics="mujoco")
    assert hit.reflex is not None and hit.reflex.rule.name in ("joint_reflex", "cartesian_reflex")


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: franka.Robot("ur5e-sweep"),
        lambda: franka.Robot("sweep-through"),
        lambda: ur.Robot("panda-sweep"),
        lambda: ur.Robot("paper-1"),
        lambda: ur.Robot(UR_SCENE, tool_speed=0.0),
        lambda: franka.Robot(SCENE, deadline=-1.0),
        lambda: franka.Robot(SCENE, physics="none"),  # type: ignore[arg-type]
        lambda: franka.Robot(SCENE.replace(measurement={"delay": 0.01}), physics="mujoco"),
        lambda: Disturbances(loss=1.0),
        lambda: Disturbances(delay=-1),
        lambda: Disturbances(velocity_noise=float("nan")),
        lambda: emulation.emulate("panda-sweep", "a robot"),
        lambda: emulated.usual("a robot"),
    ],
)
def test_what_makes_no_sense_is_refused(wrong: Any) -> None:
    with pytest.raises(InputError):
        wrong()


# The command line


def shell(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vffnull", "realtime", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG)


def test_the_command_shows_what_would_have_tripped() -> None:
    done = shell("panda-sweep", "--robot", "emulated-franka", "--seconds", "0.5")
    assert done.returncode == 0 and "nothing would have stopped the robot" in done.stdout
    assert re.search(r"the torque rate of panda_joint\d +\d+\.\d% ", done.stdout), done.stdout
    over = shell("ur5e-crossed", "--robot", "emulated-ur", "--json", "--set", "plant.payload.mass=20")
    told = json.loads(over.stdout)
    assert over.returncode == 3 and told["reflex"]["rule"] and told["reflex"]["t"] > 0.0
    for wrong in (
        ("panda-sweep", "--robot", "emulated-ur"),
        ("panda-sweep", "--robot", "emulated-franka", "--rate", "500"),
        ("panda-sweep", "--disturbed"),
    ):
        refused = shell(*wrong)
        assert refused.returncode == 2 and refused.stderr.startswith("error: "), refused.stderr


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_ends_it() -> None:
    """By a damped stop, within a fraction of a second, with what was seen until then."""
    long = ["--set", "duration=3000", "--robot", "emulated-franka", "--json"]
    command = [sys.executable, "-m", "vffnull", "realtime", "panda-sweep", *long]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as running:
        time.sleep(8.0)
        running.send_signal(signal.SIGINT)
        out, _ = running.communicate(timeout=HANG)
    assert running.returncode == 130 and json.loads(out)["status"] == "interrupted"


# The study


def test_the_study_goes_on_where_it_was(tmp_path: Path) -> None:
    """Some runs of every kind of law, a page of them, and nothing anew the second time."""
    study = [sys.executable, str(Path(__file__).parents[1] / "docs" / "emulate.py"), str(tmp_path), "8000"]
    command = [*study, "--jobs", "1", "--page", str(tmp_path / "page.md")]
    subprocess.run(command, check=True, timeout=HANG, env=os.environ | {"PYTHONWARNINGS": "ignore"})
    runs = (tmp_path / "runs.jsonl").read_text()
    rows = [json.loads(line) for line in runs.splitlines()]
    assert {row["way"] for row in rows} >= {"null-space field", "Khatib's field"}
    clean = [row for row in rows if row["load"] == "none"]
    assert clean and all(row["reflex"] is None and row["released"] == 0 and not row["hit"] for row in clean)
    page = (tmp_path / "page.md").read_text(encoding="utf-8")
    assert "| panda-sweep | null-space field | none |" in page
    subprocess.run(command, check=True, timeout=HANG, env=os.environ | {"PYTHONWARNINGS": "ignore"})
    assert (tmp_path / "runs.jsonl").read_text() == runs
