"""What becomes of plans, postures and clouds in a drive while other things change."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.robots.simulated import SimulatedRobot
from waiting import HANG

Q0 = [0.2, 0.3, 0.3, 0.3, 0.2]
END = [1.2, -0.6, 0.9, 0.9, 0.3]
PLANNED: dict[str, Any] = {
    "duration": 8.0,
    "q0": Q0,
    "arm": {"lengths": [0.5] * 5, "masses": 1.0, "radius": 0.05},
    "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0, "posture_stiffness": 60.0},
    "reference": {"kind": "plan", "times": [0.0, 2.0], "points": [Q0, END]},
    "obstacles": [{"shape": {"kind": "circle", "radius": 0.1}, "position": [-3.0, -3.0]}],
}


class Told:
    """A simulated robot that lets something be done at some of its periods, and keeps what it was sent."""

    def __init__(self, scene: Any, **acts: Callable[[vff.Drive], Any]) -> None:
        self.robot, self.period = SimulatedRobot(scene), 0
        self.drive: vff.Drive | None = None
        self.acts = {int(name[1:]): act for name, act in acts.items()}
        self.sent: list[list[float]] = []

    def read(self) -> Any:
        self.period += 1
        if self.drive is not None and (act := self.acts.get(self.period)):
            act(self.drive)
        return self.robot.read()

    def write(self, tau: Any) -> None:
        self.sent.append(list(tau))
        self.robot.write(tau)


def driven(
    scene: Any, law: Any, seconds: float, obstacles: Any = None, **acts: Any
) -> tuple[Told, vff.Drive]:
    """The robot and the drive after so many seconds of it."""
    robot = Told(scene, **acts)
    more = {} if obstacles is None else {"obstacles": obstacles}
    with vff.drive(robot, law, seconds=seconds, **more) as drive:
        robot.drive = drive
        drive.wait(HANG)
    return robot, drive


SCENE = vff.Scenario.from_dict(PLANNED)


@pytest.mark.parametrize(
    "act",
    [
        lambda drive: drive.set_obstacles(SCENE["obstacles"]),
        lambda drive: drive.set_controller(SCENE),
        lambda drive: drive.set_controller(SCENE.replace(**{"controller.posture": END})),
    ],
    ids=["obstacles", "law", "posture"],
)
def test_a_plan_that_was_left_is_not_gone_back_to(act: Any) -> None:
    """A posture that has come to rest stays, whatever room is made for."""
    there: list[Any] = []
    robot, drive = driven(
        SCENE,
        SCENE,
        5.0,
        p2500=lambda drive: drive.set_target(list(drive.state.x)),
        p3990=lambda drive: there.append(np.array(drive.state.q)),
        p4000=act,
    )
    assert drive.report is not None and drive.report.status == "completed"
    steps = np.abs(np.diff(np.array(robot.sent[3900:]), axis=0))
    assert steps.max() < 0.05
    np.testing.assert_allclose(drive.state.q, there[0], atol=0.02)
    np.testing.assert_allclose(drive.state.q, END, atol=0.03)


PANDA = vff.Arm.named("panda")
LAW = {"task": "pose", "stiffness": 400.0, "damping": 40.0, "null_damping": 10.0}


@pytest.mark.parametrize("period", ["p1000", "p1001"])
@pytest.mark.parametrize("t", [None, 0.0])
def test_points_come_with_their_surroundings(t: float | None, period: str) -> None:
    """Points that move are where they were seen, whenever the motions of obstacles are said to begin."""
    cloud = vff.Obstacle.points([[3.0, 3.0, 3.0]], radius=0.02)
    near: list[float] = []

    def see(drive: vff.Drive) -> None:
        drive.update_points([[0.55, 0.0, 1.2]], 0, velocities=[[0.0, 0.5, 0.0]])

    def surround(drive: vff.Drive) -> None:
        drive.set_obstacles([cloud], t=t)
        if period == "p1000":
            see(drive)

    driven(
        "panda-sweep",
        vff.Controller(PANDA, {**LAW, "field": vff.Field.bounded(80, 0.3)}),
        1.2,
        [cloud],
        p1000=surround,
        p1001=see if period == "p1001" else lambda drive: None,
        p1010=lambda drive: near.append(float(drive.state.clearance.min())),
    )
    assert near[0] == pytest.approx(0.456, abs=0.01)


def test_obstacles_that_come_later_move_too() -> None:
    """A way that is free but for what passes by is found, whoever has told of it."""
    passing = {
        "shape": {"kind": "circle", "radius": 0.1},
        "position": [-0.4, 0.8],
        "motion": {"kind": "sinusoid", "amplitude": [0.65, 0.0], "angular_frequency": 6.3},
    }
    around = [{"shape": {"kind": "circle", "radius": 0.3}, "position": p} for p in ([1.2, 1.1], [1.5, 0.6])]
    gains = {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0, "posture_stiffness": 20.0}
    scene = vff.Scenario.from_dict(
        {
            "duration": 12.0,
            "q0": [0.9, 0.5, 0.4, 0.3],
            "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
            "controller": {**gains, "avoidance": "cbf"},
            "reference": {"kind": "line", "end": [2.2, -0.4], "duration": 2.0},
            "obstacles": [*around, passing],
            "replan": {},
        }
    )
    _, drive = driven(scene, scene.replace(obstacles=[]), 6.0, [*around, passing])
    assert drive.report is not None
    assert "found" in [replan.status for replan in drive.report.replans]


LEFT, RIGHT = [-1.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785], [1.0, -0.3, 0.0, -2.0, 0.0, 1.8, 0.785]


def led(speed: float, **more: Any) -> vff.Scenario:
    """A Panda whose plan turns it about its base."""
    scene = vff.Scenario(
        arm=PANDA,
        q0=LEFT,
        duration=12.0,
        controller={**LAW, "avoidance": "cbf"},
        reference={"kind": "setpoint"},
        obstacles=[vff.Obstacle.sphere([0.55, 0.0, 3.0], 0.06)],
    )
    plan = vff.plan(scene, RIGHT, speed=speed)
    return scene.replace(reference=plan.reference, **{"controller.posture_stiffness": 50.0}, **more)


def test_a_plan_with_another_tool_leads_where_the_joints_were_to_be() -> None:
    """A tool on the way, then another plan: the hand ends where it would have without."""
    scene = led(0.5, replan={"latency": 0.3})
    tool = scene.replace(arm=PANDA.with_tool([0.0, 0.0, 0.12]))
    _, drive = driven(
        scene,
        scene,
        9.0,
        p500=lambda drive: drive.set_controller(tool),
        p1100=lambda drive: drive.set_obstacles([vff.Obstacle.sphere([0.48, 0.0, 0.5], 0.08)]),
    )
    assert drive.report is not None
    assert [replan for replan in drive.report.replans if replan.taken is not None]
    np.testing.assert_allclose(PANDA.pose(drive.state.q)[0], PANDA.pose(RIGHT)[0], atol=0.01)


def test_another_plan_is_within_its_limits_and_begins_before_what_is_in_the_way() -> None:
    """A search that is quick is not taken before the time it begins at, nor from beyond a post."""
    planned: list[Any] = []
    scene = led(0.5, replan={"latency": 1.5})
    acts = {f"p{k}": lambda drive: planned.append(np.array(drive.state.q_plan)) for k in range(901, 4000)}
    post = vff.Obstacle.capsule([0.42, 0.1, -0.1], [0.42, 0.1, 0.85], 0.04)
    robot, drive = driven(scene, scene, 4.0, p900=lambda drive: drive.set_obstacles([post]), **acts)
    assert drive.report is not None and drive.report.status == "completed"
    assert any(replan.taken is not None for replan in drive.report.replans)
    first = next(replan for replan in drive.report.replans if replan.reason == "blocked")
    speed = np.abs(np.diff(np.array(planned), axis=0)) / 1e-3 / np.asarray(PANDA.velocity_limits)
    until = 1000 if first.taken is None else int(1e3 * (first.taken - 0.9)) + 600
    assert np.percentile(speed[:until].max(axis=1), 99) < 1.2  # a period that is read twice counts double
    assert len(robot.sent) > 3900


def test_the_simulated_robot_plans_nothing() -> None:
    """A search of its own would keep the loop waiting."""
    scene = led(0.5, replan={"latency": 0.2})
    blocked = scene.replace(obstacles=[vff.Obstacle.capsule([0.42, 0.1, -0.1], [0.42, 0.1, 0.85], 0.04)])
    robot, longest = SimulatedRobot(blocked), 0.0
    hold = PANDA.gravity_torque(LEFT)
    for _ in range(300):
        begun = time.thread_time()
        robot.write(hold)
        longest = max(longest, time.thread_time() - begun)
    assert longest < 0.02
