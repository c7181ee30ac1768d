"""What an observer knows while a loop runs: late states, other laws on the way, and calls in between."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError
from vffnull.robots.simulated import SimulatedRobot
from waiting import HANG

SWEEP = vff.Scenario.load("panda-sweep").replace(obstacles=[])
PANDA = SWEEP.arm
LAW: dict[str, Any] = {"task": "pose", "stiffness": 400.0, "damping": 40.0, "null_damping": 12.0}
REJECTS: dict[str, Any] = {"task": "reject", "null_space": "reject"}


def law(**more: Any) -> vff.Controller:
    return vff.Controller(PANDA, LAW | more)


class Robot:
    """It paces the loop, and calls functions in certain periods, whatever the clock says."""

    paces = True

    def __init__(
        self,
        scene: vff.Scenario,
        at: dict[int, Callable[[vff.Drive], None]],
        every: int = 1,
        measures: bool = True,
    ) -> None:
        self.plant, self.at, self.every = SimulatedRobot(scene), at, every
        self.drive: vff.Drive | None = None
        self.ready = threading.Event()
        self.last, self.sent, self.q, self.faults = self.plant.read(), [], [], []
        if measures:
            self.external_torque = self.plant.external_torque

    def read(self) -> Any:
        self.ready.wait(HANG)
        if len(self.sent) % self.every == 0:
            self.last = self.plant.read()
        return self.last

    def write(self, torque: Any) -> None:
        self.sent.append(np.array(torque))
        self.q.append(self.plant.read()[1])
        if (act := self.at.get(len(self.sent))) is not None:
            try:
                act(self.drive)
            except InputError as error:
                self.faults.append(str(error))
        self.plant.write(torque)

    def hands(self) -> np.ndarray:
        return np.array([PANDA.pose(q)[0] for q in self.q])


def driven(robot: Robot, first: Any, seconds: float) -> vff.Drive:
    with vff.drive(robot, first, seconds=seconds) as drive:
        robot.drive = drive
        robot.ready.set()
        assert drive.wait(HANG)
    return drive


def test_an_observer_comes_and_goes() -> None:
    """The drive goes on, and its state says what there is."""
    states: list[Any] = []
    look = {k: lambda drive: states.append(drive.state) for k in (300, 700, 1300)}
    robot = Robot(
        SWEEP,
        look
        | {
            400: lambda drive: drive.set_controller(law(observer={}, touch=REJECTS), blend=0.1),
            900: lambda drive: drive.set_controller(law(), blend=0.1),
        },
    )
    drive = driven(robot, law(), 1.5)
    assert drive.report.status == "completed" and len(robot.sent) > 1500, drive.report.reason
    before, during, after = (state.tau_ext_estimate for state in states)
    assert before is None and after is None and during.shape == (7,) and np.isfinite(during).all()
    assert np.abs(np.diff(robot.sent, axis=0)).max() < 0.05


@pytest.mark.parametrize("blend", [0.5, 0.005])
def test_the_estimate_goes_on_with_another_law(blend: float) -> None:
    """Also where its arm is another object that is the same."""
    heavy = SWEEP.replace(**{"plant.payload": {"mass": 1.0}})
    told = {"observer": {"detection": {}}, "touch": REJECTS | {"reaction": {"stop": 25.0}}}
    for arm in (PANDA, vff.Arm.named("panda")):
        other = vff.Controller(arm, LAW | told | {"null_damping": 11.0})
        robot = Robot(heavy, {1500: lambda drive, other=other: drive.set_controller(other, blend=blend)})
        drive = driven(robot, law(**told), 2.5)
        assert np.abs(np.diff(robot.sent[1490:2400], axis=0)).max() < 1e-3
        hands = robot.hands()
        assert np.linalg.norm(hands[1490:2400] - hands[1490], axis=1).max() < 1e-4
        assert drive.state.tau_ext_estimate[1] == pytest.approx(3.0, abs=0.1)


def test_a_load_that_the_next_law_knows_is_carried_once() -> None:
    """By the law, and by the stop at the end."""
    heavy = SWEEP.replace(**{"plant.payload": {"mass": 3.0}})
    for more in ({}, {"observer": {}, "touch": REJECTS}):
        known = vff.Controller(PANDA.with_load(3.0), LAW | more)
        robot = Robot(heavy, {1500: lambda drive, known=known: drive.set_controller(known, blend=0.3)})
        assert driven(robot, law(observer={}, touch=REJECTS), 2.5).report.status == "completed"
        assert len(robot.sent) > 2500  # the stop
        hands = robot.hands()
        assert np.linalg.norm(hands[1490:] - hands[1490], axis=1).max() < 1e-3
        assert np.abs(np.diff(robot.sent[1490:], axis=0)).max() < 0.1


def test_a_stopped_task_stays_stopped() -> None:
    """While somebody pushes, and the law changes."""
    push = {"link": "tip", "force": [0.0, 40.0, 0.0], "start": 1.0, "duration": 1.5}
    told = {"observer": {"source": "measured", "detection": {}}, "touch": {"reaction": {"stop": 25.0}}}
    other = law(**told, null_damping=11.0)
    ways = []
    for at in ({}, {1500: lambda drive: drive.set_controller(other)}):
        robot = Robot(SWEEP.replace(wrenches=[push]), at)
        driven(robot, law(**told), 3.5)
        ways.append(robot.hands()[:3500])
    assert np.abs(ways[0] - ways[0][0]).max() > 0.1
    np.testing.assert_allclose(ways[1], ways[0], atol=2e-3)


def test_what_the_robot_measures_is_asked_for_anew() -> None:
    """And a law that wants to know it is refused where the robot does not measure it."""
    pushed = SWEEP.replace(wrenches=[{"link": "tip", "force": [0.0, 0.0, -10.0], "start": 0.2}])
    follows = law(observer={"source": "measured"}, touch=REJECTS)
    for measures in (True, False):
        robot = Robot(pushed, {800: lambda drive: drive.set_controller(follows)}, measures=measures)
        drive = driven(robot, law(observer={}, touch=REJECTS), 2.0)
        hands = robot.hands()
        assert np.linalg.norm(hands[1900] - hands[0]) < 1e-4
        refused = "measures no torque from outside" in "".join(robot.faults)
        assert drive.report.status == "completed" and refused is not measures


@pytest.mark.parametrize("every", [2, 3])
def test_states_come_more_seldom_than_cycles(every: int) -> None:
    """The robot holds what was sent: the observer learns as much; a stop ends after 200 states at rest."""
    robot = Robot(SWEEP.replace(**{"plant.payload": {"mass": 1.0}}), {}, every)
    drive = driven(robot, law(observer={}, touch=REJECTS), 2.0)
    assert drive.report.status == "completed" and len(robot.sent) < 2050 + 200 * every
    assert drive.state.tau_ext_estimate[1] == pytest.approx(3.01, abs=0.02)


@pytest.mark.parametrize(("late", "every"), [(1, 10), (5, 100), (5, 1)])
def test_late_periods_are_no_pushes(late: int, every: int) -> None:
    """Nobody touches the arm, the model is exact, and the torque is held for longer now and then."""
    robot = SimulatedRobot(SWEEP)
    watched = law(observer={"detection": {}}, touch=REJECTS | {"reaction": {"stop": 25.0}})
    watched.begin(0.001)
    t, q, dq = robot.read()
    place, turn = PANDA.pose(q)
    worst, felt, k = 0.0, 0, 0
    while t < 2.5:
        s, w = max(t - 1.0, 0.0), 2.0 * np.pi
        way = np.array([0.0, 0.1, 0.0])
        velocity = [*(way * w * np.sin(w * s)), 0.0, 0.0, 0.0]
        torque, _ = watched.cycle(t, q, dq, [*(place + way * (1 - np.cos(w * s))), *turn], velocity)
        worst = max(worst, np.abs(watched.tau_ext_estimate).max())
        felt += watched.touched_link is not None
        k += 1
        for _ in range(1 + late * (k % every == 0)):
            robot.write(torque)
        t, q, dq = robot.read()
    assert worst < 0.05 and felt == 0


@pytest.mark.parametrize(
    "more",
    [
        {"avoidance": "cbf", "yielding": {"preview": {"self_motion": {}}}, "deadline": "unlimited"},
        {"tank": {"capacity": 0.5, "initial": 0.1}},
        {"observer": {}, "touch": REJECTS},
    ],
    ids=["self-motion", "tank", "observer"],
)
def test_calls_between_cycles_change_nothing(more: dict[str, Any]) -> None:
    """Whatever is asked of a law at whatever state, what is sent next does not depend on it."""
    scene = SWEEP.replace(**{"plant.payload": {"mass": 1.0}})
    motion = vff.Motion.linear([0.0, 0.2, 0.0])
    ball = vff.Obstacle.sphere([-0.05, -0.45, 0.62], 0.08, motion=motion)
    field = {"kind": "bounded", "gain": 80.0, "influence": 0.25}

    def run(between: Callable[[vff.Controller, float, Any, Any, Any], object] | None) -> np.ndarray:
        robot, watched, sent = SimulatedRobot(scene), law(field=field, **more), []
        watched.begin(0.001)
        t, q, dq = robot.read()
        goal = np.concatenate(PANDA.pose(q))
        for k in range(500):
            torque, _ = watched.cycle(t, q, dq, goal, obstacles=[ball])
            sent.append(torque)
            robot.write(torque)
            if between is not None and k % 50 == 49:
                between(watched, t, q, dq, goal)
            t, q, dq = robot.read()
        return np.array(sent)

    alone = run(None)
    for between in (
        lambda law, t, q, dq, goal: law.torque(q + 0.05, dq - 0.1, goal, obstacles=[ball], t=t + 5.0),
        lambda law, t, q, dq, goal: law.terms(q + 0.05, dq, goal, obstacles=[ball], t=t),
        lambda law, t, q, dq, goal: law.torque(q, dq + 1e200, goal, obstacles=[ball], t=t),
    ):
        np.testing.assert_array_equal(run(between), alone)


def test_what_is_sensed_between_cycles_counts() -> None:
    """Also where something else was asked first."""
    watched = law(observer={"source": "measured"}, touch=REJECTS)
    watched.begin(0.001)
    q, rest = np.array(SWEEP["q0"]), np.zeros(7)
    goal = np.concatenate(PANDA.pose(q))
    push = np.array([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    for k in range(300):
        watched.cycle(1e-3 * k, q, rest, goal)
        if k >= 10:
            watched.torque(q, rest, goal, t=1e-3 * k)
            watched.sense(push)
    assert watched.tau_ext_estimate[1] == pytest.approx(5.0, rel=1e-6)


def test_a_stop_in_a_slow_loop_comes_to_rest() -> None:
    """Before a joint's stop, damping that is held over a long period turns nothing round."""
    start = [PANDA.joint_limits[0][1] - 0.04, *SWEEP["q0"][1:]]
    scene = SWEEP.replace(q0=start, dq0=[1.5] + [0.0] * 6)
    for rate in (10.0, 15.0, 50.0):
        robot = SimulatedRobot(scene, rate=rate)
        watched = vff.Controller(PANDA, {"task": "position"})
        watched.begin(1.0 / rate)
        watched.stop()
        phase, fastest = "", 0.0
        for _ in range(int(5.0 * rate)):
            t, q, dq = robot.read()
            torque, phase = watched.cycle(t, q, dq)
            fastest = max(fastest, np.abs(dq).max())
            if phase == "finished":
                break
            robot.write(torque)
        assert phase == "finished" and fastest <= 1.5 + 1e-9 and q[0] < PANDA.joint_limits[0][1]


def test_gravity_is_compensated_once() -> None:
    """By a simulated robot whose scenario leaves it to the robot, with and without an arm of its own."""
    for gravity in ("robot", "controller"):
        scene = SWEEP.replace(**{"controller.command": {"gravity": gravity}})
        for arm in (None, PANDA):
            robot = SimulatedRobot(scene, arm=arm)
            q = robot.read()[1]
            for _ in range(200):
                robot.write(np.zeros(7))
            is_weightless = arm is not None or gravity == "robot"
            assert robot.gravity == ("robot" if is_weightless else "controller")
            assert (np.abs(robot.read()[1] - q).max() < 1e-6) == is_weightless


def test_time_has_to_go_on() -> None:
    """A law that remembers says so where its loop never gives the time."""
    q, rest = SWEEP["q0"], [0.0] * 7
    goal = PANDA.pose(q)[0]
    for more, is_told in (({"observer": {}}, True), ({}, False)):
        asked = vff.Controller(PANDA, more)
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            asked.torque(q, rest, goal)
            assert not told
            asked.torque(q, rest, goal)
        assert [("stands still" in str(each.message)) for each in told] == [True] * is_told
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            asked.torque(q, rest, goal, t=0.001)
            asked.torque(q, rest, goal, t=0.002)
