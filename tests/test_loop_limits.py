"""Limits in every phase of a loop: while a torque is blended in, and until an arm has stopped (T115)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull.robots.simulated import SimulatedRobot

READY = {
    "panda": [0, -0.785, 0, -2.356, 0, 1.571, 0.785],
    "fr3": [0, -0.785, 0, -2.356, 0, 1.571, 0.785],
    "iiwa14": [0, 0.6, 0, -1.4, 0, 1.1, 0],
    "gen3": [0, 0.5, 0, 1.8, 0, 0.8, 0],
    "xarm7": [0, 0.3, 0, 1.2, 0, 0.9, 0],
    "ur5e": [0, -1.2, 1.6, -1.9, -1.57, 0],
}
Vector = NDArray[np.float64]


class Loop:
    """A law in a loop with the arm that it knows, by a plant that is not the core's integrator."""

    def __init__(self, arm: vff.Arm, q: Vector, rate: float, settings: dict[str, Any]) -> None:
        self.arm, self.q, self.dq, self.period = arm, q.copy(), np.zeros(arm.n), 1.0 / rate
        self.law = vff.Controller(arm, settings, period=self.period)
        self.law.begin(self.period)
        self.carries_itself = settings["command"].get("gravity") == "robot"
        self.t, self.phase = 0.0, "starting"
        self.torques: list[Vector] = []

    def step(self, *target: Any) -> None:
        tau, self.phase = self.law.cycle(self.t, self.q, self.dq, *target)
        self.torques.append(tau)
        by_robot = self.arm.gravity_torque(self.q) if self.carries_itself else 0.0
        self.dq = self.dq + self.period * self.arm.forward_dynamics(self.q, self.dq, tau + by_robot)
        self.q = self.q + self.period * self.dq
        self.t += self.period

    @property
    def speed(self) -> float:
        """The fastest joint, in parts of its largest speed."""
        return float((abs(self.dq) / self.arm.velocity_limits).max())

    @property
    def room(self) -> float:
        """What is left to the nearest stop [rad]."""
        low, high = np.array(self.arm.joint_limits, dtype=float).T
        return float(np.nanmin([self.q - low, high - self.q]))


STOPS = [
    ("iiwa14", 1000.0, 1000.0, 935, "controller", "null_space", "position"),
    ("iiwa14", 1000.0, 500.0, 338, "robot", "cbf", "position"),
    ("gen3", 1000.0, 500.0, 418, "controller", "cbf", "pose"),
    ("gen3", 1000.0, 1000.0, 826, "robot", "null_space", "position"),
    ("gen3", 300.0, 500.0, 557, "controller", "cbf", "position"),
    ("ur5e", 300.0, 1000.0, 232, "robot", "null_space", "position"),
    ("panda", 1000.0, 500.0, 934, "controller", "relaxed", "position"),
    ("iiwa14", None, 1000.0, 935, "controller", "priority", "position"),
]


@pytest.mark.parametrize(("name", "torque_rate", "rate", "seed", "gravity", "way", "task"), STOPS)
def test_a_stop_throws_no_joint(
    name: str, torque_rate: float | None, rate: float, seed: int, gravity: str, way: str, task: str
) -> None:
    """From a fast motion: torques that change at their own paces would accelerate what they are to damp."""
    draw = np.random.default_rng(seed)
    arm = vff.Arm.named(name)
    q = np.array(READY[name]) + draw.uniform(-0.3, 0.3, arm.n)
    command: dict[str, Any] = {"gravity": gravity}
    if torque_rate:
        command["torque_rate"] = torque_rate
    settings = {"task": task, "stiffness": 400, "damping": 40.0, "null_damping": 12.0, "avoidance": way}
    loop = Loop(arm, q, rate, settings | {"command": command})
    place, orientation = arm.pose(q)
    way_ = draw.normal(size=3)
    way_ /= np.linalg.norm(way_)
    pace, stops = draw.uniform(0.5, 1.5), draw.uniform(0.8, 1.3)

    def step() -> None:
        angle = 2 * np.pi * pace * loop.t
        x = place + 0.3 * np.sin(angle) ** 2 * way_
        dx = 0.3 * 2 * np.pi * pace * np.sin(2 * angle) * way_
        loop.step(*((x, dx) if task == "position" else ((x, orientation), np.r_[dx, 0, 0, 0])))

    before, after = 0.0, 0.0
    while loop.t < stops:
        step()
        before = max(before, loop.speed)
    loop.law.stop()
    while loop.phase != "finished" and loop.t < stops + 3.0:
        step()
        after = max(after, loop.speed)
    assert before < 1.001 and after < 1.001, (before, after)
    assert loop.phase == "finished" and loop.speed < 0.02
    changes = abs(np.diff(loop.torques, axis=0)).max()
    assert torque_rate is None or changes <= torque_rate / rate * (1 + 1e-9)


STARTS = [
    ("fr3", 6, 0, [0.14, 0.02, 0.09], "null_space"),
    ("xarm7", 6, 1, [-0.08, -0.1, -0.08], "cbf"),
    ("gen3", 1, 1, [0.18, 0.02, -0.19], "null_space"),
    ("gen3", 3, 0, [-0.04, 0.13, -0.02], "cbf"),
]


def beside_a_stop(name: str, joint: int, side: int) -> tuple[vff.Arm, Vector]:
    """An arm with a joint 0.01 rad before a stop, and its angles."""
    arm, q = vff.Arm.named(name), np.array(READY[name], dtype=float)
    q[joint] = arm.joint_limits[joint][side] + (0.01 if side == 0 else -0.01)
    return arm, q


@pytest.mark.parametrize("blend", [0.5, 2.0])
@pytest.mark.parametrize(("name", "joint", "side", "way", "avoidance"), STARTS)
def test_a_start_keeps_joints_from_their_stops(
    name: str, joint: int, side: int, way: list[float], avoidance: str, blend: float
) -> None:
    """A share of a torque that keeps a limit does not keep it."""
    arm, q = beside_a_stop(name, joint, side)
    settings = {"task": "position", "stiffness": 400, "damping": 40.0, "null_damping": 12.0}
    settings |= {"avoidance": avoidance, "command": {"blend_time": blend}}
    loop = Loop(arm, q, 1000.0, settings)
    target = arm.pose(q)[0] + np.array(way)
    while loop.t < blend + 0.5:
        loop.step(target)
        assert loop.room > 0.0015 and loop.speed < 1.001, (loop.t, loop.room, loop.speed)
    assert loop.phase == "running"


def test_a_start_keeps_its_distances() -> None:
    """With a ball that comes while the torque is blended in, for longer than that is wise."""
    arm, q = vff.Arm.named("panda"), np.array(READY["panda"])
    settings = {
        "task": "position",
        "stiffness": 400,
        "damping": 40.0,
        "null_damping": 12.0,
        "avoidance": "cbf",
    }
    law = vff.Controller(arm, settings | {"command": {"blend_time": 2.0}}, period=1e-3)
    law.begin(1e-3)
    ball = vff.Obstacle.sphere([0.1, -0.6, 0.55], radius=0.08, motion=vff.Motion.linear([0.0, 0.3, 0.0]))
    dq, place, nearest = np.zeros(7), arm.pose(q)[0], np.inf
    for k in range(2000):
        tau, _ = law.cycle(1e-3 * k, q, dq, place, obstacles=[ball])
        nearest = min(nearest, law.terms(q, dq, place, obstacles=[ball], t=1e-3 * k).clearance.min())
        dq = dq + 1e-3 * arm.forward_dynamics(q, dq, tau)
        q = q + 1e-3 * dq
    assert nearest > 0.015, nearest


class Turned:
    """A simulated robot that says something else than what is."""

    def __init__(self, change: Callable[[float, Vector, Vector], Any]) -> None:
        self.plant, self.change = SimulatedRobot("panda-sweep"), change

    def read(self) -> Any:
        return self.change(*self.plant.read())

    def write(self, tau: Vector) -> None:
        self.plant.write(tau)


def driven(change: Callable[[float, Vector, Vector], Any], seconds: float = 1.0) -> vff.DriveReport:
    arm = vff.Arm.named("panda")
    law = vff.Controller(arm, {"stiffness": 400, "damping": 40, "null_damping": 12})
    with vff.drive(Turned(change), law, seconds=seconds) as drive:
        drive.set_target(arm.pose(SimulatedRobot("panda-sweep").read()[1])[0] + np.array([0.0, 0.1, 0.1]))
        drive.wait(20.0)
    assert drive.report is not None
    return drive.report


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda t, q, dq: (1000 * t, q, dq), "has to count in seconds"),
        (lambda t, q, dq: (t, q, -dq), "its sign or unit is another one"),
        (lambda t, q, dq: (t, q, 0.0 * dq), "its sign or unit is another one"),
        (lambda t, q, dq: (t, q, dq / 2 / np.pi), "its sign or unit is another one"),
        (lambda t, q, dq: (t, q, np.degrees(dq)), "its sign or unit is another one|twice its speed limit"),
    ],
)
def test_a_robot_that_speaks_another_language_is_not_driven(change: Any, reason: str) -> None:
    with pytest.warns(RuntimeWarning, match=reason):
        report = driven(change)
    assert report.status == "fault" and report.periods < 400


def test_what_goes_wrong_during_the_stop_is_told() -> None:
    """A drive whose robot is lost while it stops did not complete."""

    def lost(t: float, q: Vector, dq: Vector) -> Any:
        if t > 0.21:
            raise OSError("cable out")
        return t, q, dq

    with pytest.warns(RuntimeWarning, match="cable out"):
        report = driven(lost, seconds=0.2)
    assert report.status == "fault" and "cable out" in report.reason


@pytest.mark.parametrize(
    ("name", "task", "most"),
    [("panda", "position", 0.303), ("xarm7", "position", 0.303), ("iiwa14", "position", 0.303)],
)
def test_a_tip_that_is_free_to_turn_turns_no_faster_than_it_may(name: str, task: str, most: float) -> None:
    """Nor does its torque change its mind in every period (T198)."""
    arm = vff.Arm.named(name)
    scene = vff.Scenario(
        arm=arm,
        q0=READY[name],
        duration=1.2,
        reference={"kind": "line", "end": [0.15, 0.3, 0.1], "duration": 0.8, "relative": True},
        controller={
            "task": task,
            "stiffness": 400,
            "damping": 40.0,
            "null_damping": 12.0,
            "avoidance": "cbf",
            "command": {"tip_angular_speed": 0.3},
        },
        simulation={
            "dt": 1e-3,
            "control": "hold",
            "integrator": "semi_implicit_euler",
            "record_every": 1,
        },
    )
    result = vff.simulate(scene)
    turning = [np.linalg.norm((arm.jacobian(q) @ dq)[3:]) for q, dq in zip(result.q, result.dq, strict=True)]
    assert max(turning) < most, max(turning)
    change = np.diff(result.tau, axis=0) / arm.torque_limits
    turned_back = (change[1:] * change[:-1] < 0) & (abs(change[1:]) > 0.05) & (abs(change[:-1]) > 0.05)
    assert turned_back.any(axis=1).sum() < 5
