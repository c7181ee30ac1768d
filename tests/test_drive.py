"""`vff.drive`: a controller in the loop of a robot, what others tell it meanwhile, and how it ends, whatever
the robot does.

The robots are simulated, and their time goes on by one period per command: what they do does not depend on
the clock.
"""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, InputTypeError, ScenarioError
from vffnull.robots import Robot
from vffnull.robots.simulated import SimulatedRobot
from vffnull.run import drive as _drive
from waiting import HANG, wait_for

SCENE = vff.Scenario.load("panda-sweep")
ARM = SCENE.arm
LIMITS = {"acceleration": 10.0, "jerk": 500.0, "speed": 1.0}
BALL = vff.Obstacle.sphere([-0.05, -0.3, 0.62], 0.08, vff.Motion.linear([0.0, 0.4, 0.0]))


def controller(**command: Any) -> vff.Controller:
    settings = dict(SCENE["controller"])
    return vff.Controller(ARM, settings | ({"command": command} if command else {}))


class InPython:
    """The simulated robot behind a class of Python, with mishaps: `mishap` gets the number of the period and
    the state.
    """

    def __init__(self, mishap: Callable[[int, Any], Any] | None = None, write: Any = None) -> None:
        self.plant = SimulatedRobot(SCENE)
        self.mishap, self.refuse = mishap, write
        self.periods = 0
        self.told: list[Any] = []
        self.calls: list[str] = []
        self.threads: set[int] = set()

    def begin(self) -> None:
        self.calls.append("begin")

    def read(self) -> Any:
        self.threads.add(threading.get_ident())
        self.periods += 1
        state = self.plant.read()
        return state if self.mishap is None else self.mishap(self.periods, state)

    def write(self, command: Any, /) -> None:
        assert isinstance(command, np.ndarray) and command.shape == (7,)
        self.told.append(command.copy())
        if self.refuse is not None:
            self.refuse(self.periods)
        self.plant.write(command)

    def end(self) -> None:
        self.calls.append("end")


def finished(drive: vff.Drive) -> vff.DriveReport:
    assert drive.wait(HANG)
    return drive.report


def recorded(robot: Any, path: Path, torque_rate: float | None = None, **more: Any) -> Any:
    """The table of a drive among a ball that comes, a row per period."""
    given = {"obstacles": [BALL], "seconds": 1.5, "record_to": path, "record_every": 1} | more
    law = controller() if torque_rate is None else controller(torque_rate=torque_rate)
    with vff.drive(robot, law, **given) as drive:
        assert finished(drive).status == "completed"
    return vff.StreamRecorder.read(path).to_pandas()


def test_it_drives(tmp_path: Path) -> None:
    """A ball sweeps through the elbow: the hand stays, the links give way. The robot in Python does, bit for
    bit, what the one without Python does, and so does a loop by hand.
    """
    rows = recorded(SimulatedRobot(SCENE), tmp_path / "core.arrows")
    clearance = rows.filter(like="clearance").to_numpy()
    assert 0.0 < clearance[:1500].min() < 0.2
    off = rows[[f"{name}_{axis}" for axis in "xyz" for name in ("x", "x_ref")]].to_numpy()
    off = np.abs(off[:1500, ::2] - off[:1500, 1::2]).max(axis=1)
    assert off.max() < 1e-3 and off[600:].max() < 5e-5  # before, it is being blended in
    assert abs(rows.filter(regex="^q_").to_numpy()[1499] - SCENE["q0"]).max() > 0.02, "nothing gave way"

    robot = InPython()
    again = recorded(robot, tmp_path / "python.arrows")
    assert rows.equals(again)
    assert robot.calls == ["begin", "end"] and len(robot.threads) == 1
    assert robot.threads.isdisjoint({threading.get_ident()})
    assert len(robot.told) == len(rows) >= 1500

    law, plant = controller(), SimulatedRobot(SCENE)
    law.begin(1e-3)
    reference = ARM.pose(plant.read()[1])
    applied = rows.filter(like="tau_applied").to_numpy()
    for k in range(1000):
        t, q, dq = plant.read()
        tau, phase = law.cycle(t, q, dq, reference, obstacles=[BALL])
        np.testing.assert_allclose(tau, applied[k], rtol=0, atol=1e-9)
        plant.write(tau)
    assert phase == "running"


def test_what_is_shown() -> None:
    """State and report have what they say; while it runs there is no report."""
    release = threading.Event()

    def mishap(period: int, state: Any) -> Any:
        if period == 700:
            assert release.wait(HANG)
        return state

    with vff.drive(InPython(mishap), controller(), obstacles=[BALL]) as drive:
        wait_for(lambda: drive.state.periods >= 690)
        state = drive.state
        with pytest.raises(InputError, match="not over"):
            drive.report  # noqa: B018
        release.set()
        wait_for(lambda: drive.state.t > 0.8)
        assert drive.running and drive.state.phase == "running" and repr(drive).startswith("<Drive: running")
    assert 0.6 < state.t <= 0.7 and state.q.shape == state.tau.shape == state.force.shape == (7,)
    assert state.x.shape == state.x_ref.shape == (7,)
    np.testing.assert_allclose(state.tau_task + state.tau_null, state.tau, atol=1e-9)
    assert "clearance" in repr(state)
    report = drive.report
    assert (report.status, report.reason, report.cause, report.lost) == ("stopped", "", None, 0)
    assert len(report.step) == len(report.latency) == report.periods
    assert drive.state.phase == "over" and not drive.running
    shown = json.loads(json.dumps(report.to_dict()))
    assert list(shown["left_out"]) == ["late", "cut", "rollouts", "points", "programs"]
    assert (
        shown["periods"] == report.periods and shown["verdict"] in str(report) and "stopped" in repr(report)
    )


def test_targets_and_obstacles_from_other_threads() -> None:
    """A target that moves is followed, one that is not renewed comes to rest, obstacles are where they are
    said to be.
    """
    robot = SimulatedRobot(SCENE)
    start, orientation = ARM.pose(SCENE["q0"])
    cloud = vff.Obstacle.points([[0.0, 0.0, 0.0]], 0.05, position=[0.3, 0.6, 0.5])
    with vff.drive(robot, controller()) as drive:
        wait_for(lambda: drive.state.t > 0.6)
        nothing = drive.state.clearance.min()
        drive.set_target((start + np.array([0.0, 0.03, 0.0]), orientation))
        wait_for(lambda: drive.state.x[1] - start[1] > 0.0299)
        np.testing.assert_array_equal(drive.state.x_ref[:3], start + np.array([0.0, 0.03, 0.0]))
        drive.set_target((start, orientation), [0.0, 0.05, 0.0, 0.0, 0.0, 0.0])  # and nothing more
        wait_for(lambda: abs(drive.state.x_ref[1] - start[1] - 0.05 * 0.15) < 1e-12)

        drive.set_obstacles([vff.Obstacle.sphere([0.0, 3.0, 0.5], 0.1), cloud])
        wait_for(lambda: drive.state.clearance.min() < 1.0)
        far = drive.state.clearance.min()
        drive.update_points([[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]], obstacle=1)
        wait_for(lambda: drive.state.clearance.min() < far - 0.05)
        drive.move_obstacle(1, [5.0, 5.0, 5.0])
        wait_for(lambda: drive.state.clearance.min() > 2.0)
        drive.move_obstacle(0, [0.0, 0.9, 0.5])
        wait_for(lambda: drive.state.clearance.min() < 0.8)
        drive.set_obstacles([])
        wait_for(lambda: drive.state.clearance.min() == np.inf)
        for call in (
            lambda: drive.set_target([0.1, 0.2]),
            lambda: drive.set_target((start, [2.0, 0.0, 0.0, 0.0])),
            lambda: drive.set_target((start, [np.nan, 0.0, 0.0, 0.0])),
            lambda: drive.move_obstacle(0, [0.0, 0.9, 0.5]),
            lambda: drive.update_points([[0.0, 0.0, 0.0]]),
            lambda: drive.set_obstacles([cloud], t=np.inf),
        ):
            with pytest.raises(InputError):
                call()
        with pytest.raises(ScenarioError):
            drive.set_obstacles([{"shape": {"kind": "circle", "radius": 0.1}, "position": [0.0, 0.0]}])
    assert np.isinf(nothing) and drive.report.status == "stopped"


def raises(error: BaseException) -> Callable[[int, Any], Any]:
    def mishap(period: int, state: Any) -> Any:
        if period >= 800:
            raise error
        return state

    return mishap


def late(change: Callable[[Any], Any]) -> Callable[[int, Any], Any]:
    return lambda period, state: change(state) if period >= 800 else state


FAULTS: dict[str, tuple[Callable[[int, Any], Any], str]] = {
    "an exception": (raises(RuntimeError("unplugged")), "was not read: RuntimeError: unplugged"),
    "one without a text": (raises(KeyError()), "was not read: KeyError"),
    "an exit": (raises(SystemExit(3)), "was not read: SystemExit: 3"),
    "nothing": (late(lambda _: None), "expected a tuple of time, q and dq"),
    "two": (late(lambda state: state[:2]), "expected a tuple of time, q and dq"),
    "a short array": (late(lambda state: (state[0], state[1][:6], state[2])), r"q: expected shape \(7,\)"),
    "text": (late(lambda state: ("now", state[1], state[2])), "t: expected a number"),
    "no number": (late(lambda state: (state[0], state[1], state[2] * np.nan)), "robot's dq is not finite"),
    "no time": (late(lambda state: (np.inf, state[1], state[2])), "robot's time is not finite"),
    "a time that stands": (
        late(lambda state: (0.7, state[1], state[2])),
        r"time stood at \d\.\d+ s for \d+ periods",  # on a busy machine the last one before is later
    ),
    "a jump": (late(lambda state: (state[0], state[1] + 1.0, state[2])), "state discontinuity"),
}


@pytest.mark.parametrize("name", FAULTS)
def test_faults_of_a_robot_end_the_drive(name: str) -> None:
    """As a value that says why, with commands that damp until the last; the program goes on."""
    mishap, reason = FAULTS[name]
    robot = InPython(mishap)
    with pytest.warns(RuntimeWarning, match=f"drive: .*{reason}"), vff.drive(robot, controller()) as drive:
        report = finished(drive)
    assert report.status == "fault"
    assert re.search(reason, report.reason), report.reason
    assert (report.cause is not None) == ("read" in report.reason)
    assert robot.calls == ["begin", "end"]
    assert np.isfinite(robot.told).all() and len(robot.told) > 800
    assert abs(robot.told[-1] - ARM.gravity_torque(SCENE["q0"])).max() < 0.5, "no damped stop"


def test_a_robot_that_refuses() -> None:
    """A command that is not taken begins the end; three of them are the end."""

    def once(period: int) -> None:
        if period == 800:
            raise ValueError("busy")

    def always(period: int) -> None:
        if period >= 800:
            raise ValueError("busy")

    for refuse, periods in ((once, range(808, 1100)), (always, range(801, 802))):
        robot = InPython(write=refuse)
        drive = vff.drive(robot, controller())
        report = finished(drive)
        assert (report.status, report.reason) == (
            "fault",
            "the robot did not take a command: ValueError: busy",
        )
        assert (
            isinstance(report.cause, ValueError) and len(robot.told) in periods and robot.calls[-1] == "end"
        )


def test_one_that_does_not_begin_or_take_leave() -> None:
    class Unwilling(InPython):
        def begin(self) -> None:
            raise ConnectionError("no route")

    robot = Unwilling()
    report = finished(vff.drive(robot, controller()))
    assert report.reason == "the robot failed to start: ConnectionError: no route" and robot.told == []
    assert report.periods == 0 and robot.calls == ["end"]

    class Clinging(InPython):
        def end(self) -> None:
            raise ConnectionError("no goodbye")

    report = finished(vff.drive(Clinging(), controller(), seconds=0.1))
    assert report.status == "completed" and report.notes == (
        "the robot did not take leave: ConnectionError: no goodbye",
    )


def test_one_that_hangs_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing can be sent to it, but the program goes on, and says so."""
    monkeypatch.setattr(_drive, "_PATIENCE", 0.3)
    release = threading.Event()

    def mishap(period: int, state: Any) -> Any:
        if period == 50:
            release.wait(HANG)
        return state

    with pytest.warns(RuntimeWarning, match="has not answered for 0.3 s"):
        with vff.drive(InPython(mishap), controller()) as drive:
            wait_for(lambda: drive.state.periods >= 48)
    assert drive.running
    release.set()
    assert finished(drive).status == "stopped"
    release.clear()
    drive = vff.drive(InPython(mishap), controller())
    wait_for(lambda: drive.state.periods >= 48)
    threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
    with pytest.warns(RuntimeWarning, match="has not answered for 0.3 s"):
        assert not drive.wait()  # Ctrl-C does not make it over
    release.set()
    assert finished(drive).status == "interrupted"


class Paced:
    """A Panda that paces the loop; `act` is told of every state of it, from when the drive is known on."""

    paces = True

    def __init__(self, act: Callable[[int, Paced], None]) -> None:
        self._act, self._k, self._t = act, 0, 0.0
        self.q, self.dq = np.array(SCENE["q0"], dtype=float), np.zeros(7)
        self.drive: vff.Drive | None = None

    def read(self) -> Any:
        if self.drive is not None:
            self._k += 1
            self._act(self._k, self)
            if self._k == 1600:
                self.drive.stop()
        return self._t, self.q, self.dq

    def write(self, command: Any, /) -> None:
        self._t += 1e-3
        self.dq = self.dq + 1e-3 * ARM.forward_dynamics(self.q, self.dq, command)
        self.q = self.q + 1e-3 * self.dq

    def driven(self, law: vff.Controller, **more: Any) -> vff.DriveReport:
        with vff.drive(self, law, **more) as drive:
            self.drive = drive
            return finished(drive)


@pytest.mark.parametrize("at", [853, 854])
def test_points_stay_while_a_law_waits_for_its_turn(at: int) -> None:
    """Those that were replaced came back in every other period, and might stay."""
    here = ARM.forward_kinematics(SCENE["q0"])[-1]
    near = vff.Obstacle.points([here + np.array([0.0, 0.0, 0.3])], 0.05)
    seen = []

    def act(k: int, robot: Paced) -> None:
        assert robot.drive is not None
        if k in (800, 810):
            robot.drive.set_controller(controller(), blend=0.2)  # the second waits for the first
        if k == at:
            robot.drive.update_points([here + np.array([0.0, 0.0, 0.3])], obstacle=0)
        if at + 2 < k < 1600:
            truth = vff.distances(ARM, robot.q, np.zeros(7), [near]).distance.min()
            seen.append(abs(robot.drive.state.clearance.min() - truth))

    far = vff.Obstacle.points([here + np.array([0.0, 0.0, 0.6])], 0.05)
    assert Paced(act).driven(controller(), obstacles=[far]).status == "stopped"
    assert len(seen) > 500 and max(seen) < 1e-3  # it moves a little from period to period


@pytest.mark.parametrize("waits", [0, 1, 2])
def test_a_target_for_another_tip_waits_for_the_law_that_leads_it(waits: int) -> None:
    """It is where that tip is: nothing moves. The old tip went there as long as the new law waited."""
    settings = {"task": "position", "stiffness": 400.0, "damping": 40.0, "null_damping": 10.0}
    longer = ARM.with_tool([0.0, 0.0, 0.3])
    moved = []

    def act(k: int, robot: Paced) -> None:
        assert robot.drive is not None
        if k == 800 and waits:
            robot.drive.set_controller(vff.Controller(ARM, settings | {"null_damping": 12.0}))
        if k == 810:
            for _ in range(max(1, waits)):  # one after the other, in the place of the one that waits
                robot.drive.set_controller(vff.Controller(longer, settings))
            robot.drive.set_target(longer.pose(robot.q)[0])
        moved.append(abs(robot.q - SCENE["q0"]).max())

    assert Paced(act).driven(vff.Controller(ARM, settings)).status == "stopped"
    assert max(moved) < 1e-6


@pytest.mark.parametrize("command", ["position", "velocity"])
@pytest.mark.parametrize("what", ["nothing", "twice", "wild"])
def test_a_robot_that_is_held_may_hiccup(what: str, command: str) -> None:
    """One state that comes twice, or is elsewhere, while its set point comes back to it. Then it stands."""
    told: list[Any] = []

    class Stuck:
        paces = True
        t, k = 0.0, 0

        def read(self) -> Any:
            self.k += 1
            q = np.array(SCENE["q0"], dtype=float)
            q[0] += 3.0 * (what == "wild" and self.k == 701)
            return self.t, q, np.zeros(7)

        def write(self, sent: Any, /) -> None:
            told.append(sent.copy())
            self.t += 0.0 if what == "twice" and self.k == 700 else 2e-3

    robot: Any = Stuck()
    robot.command = command
    away = ARM.forward_kinematics(SCENE["q0"])[-1] + [0.0, 0.3, 0.0]
    law = vff.Controller(ARM, {"stiffness": 100.0, "damping": 20.0})
    limits = {"acceleration": 5.0, "jerk": 500.0, "threshold": 0.1}
    with vff.drive(robot, law, 500.0, x_ref=away, seconds=2.0, limits=limits) as drive:
        assert finished(drive).status == "completed", drive.report
    assert np.abs(np.diff(np.array(told), axis=0)).max() > 0.0
    if command == "velocity":
        assert not told[-1].any()


@pytest.mark.parametrize("way", ["moved", "points"])
def test_a_camera_that_dies_ends_it(way: str) -> None:
    """By a damped stop, and the report says what was not seen; one that goes on does not, nor what nobody
    has seen yet.
    """
    cloud = vff.Obstacle.points([[0.0, 0.9, 0.5]], 0.05)

    def see(drive: vff.Drive) -> None:
        if way == "moved":
            drive.move_obstacle(1, [0.0, 2.0, 0.5])
        else:
            drive.update_points([[0.0, 2.0, 0.5]], obstacle=1)

    # Ten times slower than the clock on a busy machine is soon enough.
    with vff.drive(SimulatedRobot(SCENE), controller(), obstacles=[BALL, cloud], sight_patience=5.0) as drive:
        wait_for(lambda: drive.state.t > 0.2)
        for _ in range(20):
            see(drive)
            time.sleep(0.02)
        assert drive.running and drive.state.phase in ("starting", "running")
    assert drive.report.status == "stopped"
    drive = vff.drive(SimulatedRobot(SCENE), controller(), obstacles=[BALL, cloud], sight_patience=0.05)
    wait_for(lambda: drive.state.t > 0.2)
    see(drive)
    report = finished(drive)
    assert report.status == "fault" and "obstacles[1] was last seen at t = 0." in report.reason
    assert "sight_patience" in report.reason and np.abs(drive.state.dq).max() < 0.05
    with pytest.raises(InputError, match="sight_patience: must be finite and greater than 0"):
        vff.drive(SimulatedRobot(SCENE), controller(), sight_patience=0.0)


def test_a_short_silence_is_bridged() -> None:
    """States that come twice, fewer than `missed_cycles` times, change nothing: the drive goes on."""
    held: list[Any] = []

    def mishap(period: int, state: Any) -> Any:
        held[:] = [state] if period % 10 not in (3, 4, 5) or not held else held
        return held[0]

    report = finished(vff.drive(InPython(mishap), controller(), seconds=1.0))
    assert report.status == "completed"


def test_it_blends_in_from_what_is_measured() -> None:
    """The first torque is the one that the robot says it has; one that cannot be is not believed."""
    weight = ARM.gravity_torque(SCENE["q0"])

    class Measured(InPython):
        offset: Any = 0.0

        def torque(self) -> Any:
            return weight + self.offset

    for offset, first in ((2.0, weight + 2.0), (np.nan, weight), (1e4, weight)):
        robot = Measured()
        robot.offset = offset
        finished(vff.drive(robot, controller(), seconds=0.1))
        np.testing.assert_allclose(robot.told[0], first, atol=1e-6)


@pytest.mark.parametrize(("acceleration", "jerk"), [(0.2, 2.0), (8.0, 200.0)])
def test_the_last_velocity_is_within_the_limits(acceleration: float, jerk: float) -> None:
    """A robot of velocities that is told to stand has come to rest by what its limits allow."""

    class Servo:
        command, t = "velocity", 0.0

        def __init__(self) -> None:
            self.q, self.told = np.array(SCENE["q0"]), [np.zeros(7)]

        def read(self) -> Any:
            return self.t, self.q, self.told[-1]

        def write(self, command: Any, /) -> None:
            self.told.append(command.copy())
            self.q, self.t = self.q + 2e-3 * command, self.t + 2e-3

    robot, limits = Servo(), {"acceleration": acceleration, "jerk": jerk, "speed": 0.5}
    with vff.drive(robot, controller(), seconds=0.5, rate=500.0, limits=limits, obstacles=[BALL]) as drive:
        place, orientation = ARM.pose(SCENE["q0"])
        drive.set_target((np.add(place, [0.0, 0.2, 0.0]), orientation))
        finished(drive)
    changes = np.diff(robot.told, axis=0) / 2e-3
    assert np.abs(robot.told).max() > 1e-2 and np.abs(robot.told[-1]).max() == 0.0
    assert np.abs(changes).max() < 1.02 * acceleration
    assert np.abs(np.diff(changes, axis=0) / 2e-3).max() < 1.02 * jerk


def test_a_simulated_robot_has_one_drive() -> None:
    robot = SimulatedRobot(SCENE)
    with vff.drive(robot, controller(), seconds=0.5) as drive:
        wait_for(lambda: drive.state.t > 0.01)
        with (
            pytest.warns(RuntimeWarning, match="another drive has this robot"),
            vff.drive(robot, controller(), seconds=0.1) as other,
        ):
            assert finished(other).status == "fault"
        assert finished(drive).status == "completed"
    vff.drive(robot, controller(), seconds=0.1)  # never begun
    with vff.drive(robot, controller(), seconds=0.05) as drive:
        assert finished(drive).status == "completed"


def test_robots_of_positions_and_velocities() -> None:
    """They get the state of the model within its limits: the elbow gives way, the hand stays."""

    class Servo:
        def __init__(self, command: str) -> None:
            self.command, self.t = command, 5.0
            self.q, self.dq = np.array(SCENE["q0"]), np.zeros(7)
            self.most = 0.0

        def read(self) -> Any:
            return self.t, self.q, self.dq

        def write(self, command: Any, /) -> None:
            before = self.q
            self.q = command.copy() if self.command == "position" else before + 1e-3 * command
            self.dq, self.t = (self.q - before) / 1e-3, self.t + 1e-3
            self.most = max(self.most, abs(self.dq).max())

    start, barred = ARM.pose(SCENE["q0"])[0], vff.Controller(ARM, {**SCENE["controller"], "avoidance": "cbf"})
    for command in ("position", "velocity"):
        robot = Servo(command)
        with vff.drive(robot, barred, obstacles=[BALL], seconds=2.0, limits=LIMITS) as drive:
            report = finished(drive)
        assert (report.status, report.notes) == ("completed", ()) and report.clearance > 0.01
        assert 0.02 < robot.most <= 1.0 + 1e-3  # between two set points a joint may be a little faster
        assert abs(robot.q - SCENE["q0"]).max() > 0.02
        assert abs(ARM.pose(robot.q)[0] - start).max() < 2e-3
        for wrong in (None, {}, {"acceleration": 1.0}, LIMITS | {"speed": -1.0}, LIMITS | {"force": 1.0}):
            with pytest.raises(InputError, match="limits: "):
                vff.drive(robot, controller(), limits=wrong)
    # One with a reference of its own follows that, and is not driven from elsewhere.
    line = {"kind": "line", "end": [0.0, 0.1, 0.1], "duration": 1.0, "relative": True}
    scene = SCENE.replace(reference=line, duration=2.0, obstacles=[])
    robot = Servo("position")
    with vff.drive(robot, scene, seconds=2.0, limits=LIMITS) as drive:
        report = finished(drive)
    assert (report.status, report.notes) == ("completed", ())
    assert abs(ARM.pose(robot.q)[0] - start - [0.0, 0.1, 0.1]).max() < 1e-4
    robot = Servo("position")
    robot.q = np.add(SCENE["q0"], [0.5, 0, 0, 0, 0, 0, 0])
    with (
        pytest.warns(RuntimeWarning, match="the reference begins elsewhere"),
        vff.drive(robot, scene, seconds=2.0, limits=LIMITS) as drive,
    ):
        finished(drive)
    assert robot.most == 0.0


class Still:
    """A robot of positions that goes where it is told, in its own time."""

    command, paces = "position", True

    def __init__(self, q: Any, dq: float = 0.0) -> None:
        self.t, self.q, self.dq = 5.0, np.array(q), np.full(len(q), dq)
        self.told = 0

    def read(self) -> Any:
        return self.t, self.q, self.dq

    def write(self, command: Any, /) -> None:
        self.q, self.dq = command.copy(), (command - self.q) / 1e-3
        self.t, self.told = self.t + 1e-3, self.told + 1


class Turned:
    """A Panda that paces the loop, and whose base turns whatever it is told."""

    paces = True

    def __init__(self) -> None:
        self.t, self.q, self.dq = 0.0, np.array(SCENE["q0"], dtype=float), np.array([0.03] + 6 * [0.0])

    def read(self) -> Any:
        return self.t, self.q, self.dq

    def write(self, command: Any, /) -> None:
        self.t, self.q = self.t + 1e-3, self.q + 1e-3 * self.dq


def test_an_arm_that_does_not_come_to_rest_is_a_fault() -> None:
    with (
        pytest.warns(RuntimeWarning, match="the arm still moved"),
        vff.drive(Turned(), controller(), seconds=0.1) as drive,
    ):
        report = finished(drive)
    assert report.status == "fault" and report.reason == "the arm still moved 5 s after it was to stop"
    assert 5.0 < report.periods * 1e-3 < 5.2


@pytest.mark.parametrize(("acceleration", "jerk"), [(10.0, 1000.0), (5.0, 500.0)])
def test_barriers_know_what_set_points_can(acceleration: float, jerk: float) -> None:
    """Where a law that knows nothing of the limits leads 4 and 31 mm farther in."""
    scene = vff.Scenario.load("ur5e-crossed")
    most = {"acceleration": acceleration, "jerk": jerk}
    with vff.drive(Still(scene["q0"]), scene, seconds=4.0, limits=most) as drive:
        report = finished(drive)
    assert report.status == "completed" and report.notes == ()
    assert 0.015 < report.clearance < 0.05


def test_contacts_are_named() -> None:
    """Whatever the law, by torques and set points; how near it came otherwise."""
    scene = vff.Scenario.load("ur5e-crossed").replace(**{"controller.avoidance": "null_space"})
    limits = {"acceleration": 20.0, "jerk": 2000.0}
    for robot, more in ((SimulatedRobot(scene), {}), (Still(scene["q0"]), {"limits": limits})):
        with vff.drive(robot, scene, seconds=3.0, **more) as drive:
            report = finished(drive)
        assert report.status == "completed" and report.clearance < 0.0
        depth = f" was {-1e3 * report.clearance:.1f} mm inside an obstacle at t = "
        assert any(note.startswith("link ") and depth in note for note in report.notes), report.notes
        assert "In contact, by" in repr(report)
        assert report.to_dict()["clearance"] == report.clearance
    alone = scene.replace(obstacles=[])
    with vff.drive(SimulatedRobot(alone), alone, seconds=0.1) as drive:
        report = finished(drive)
    assert report.clearance == np.inf and report.to_dict()["clearance"] is None


def test_gains_that_throw_an_arm_are_refused() -> None:
    """At the rate of the drive, by a successor, and by hand."""
    for gains, says in (
        ({"damping": 60.0, "stiffness": 100.0}, "damping: 60 1/s is unstable at a control period of 0.05 s"),
        ({"null_damping": 50.0, "damping": 10.0, "stiffness": 25.0}, "null_damping: 50 1/s is unstable"),
        ({"damping": 5.0, "stiffness": 400.0}, "too little for a stiffness of 400"),
    ):
        law = vff.Controller(ARM, gains)
        with pytest.raises(InputError, match=says):
            vff.drive(SimulatedRobot(SCENE), law, rate=20.0)
        with pytest.raises(InputError, match=says):
            law.begin(0.05)
        with pytest.raises(InputError, match=says):
            vff.VirtualArm(law, SCENE["q0"], period=0.05, acceleration=10.0, jerk=500.0)
        calm = vff.Controller(ARM, {"damping": 10.0, "stiffness": 25.0, "null_damping": 5.0})
        with vff.drive(SimulatedRobot(SCENE, rate=20.0), calm, rate=20.0, seconds=0.5) as drive:
            with pytest.raises(InputError, match=says):
                drive.set_controller(law)
            finished(drive)


def test_turns_of_endless_joints_are_counted() -> None:
    """A reading within half a turn is that of the same joint: torques and set points are as if it went on."""
    gen3 = vff.Arm.named("gen3")
    q0 = np.array([3.0, 0.3, 0.0, 1.8, 0.0, 0.9, 0.0])
    there = [*(q0[:1] + 0.8), *q0[1:]]
    law = {
        "stiffness": 0.001,
        "damping": 1.0,
        "null_damping": 5.0,
        "posture": there,
        "posture_stiffness": 40.0,
    }
    scene = vff.Scenario(arm=gen3, q0=list(q0), duration=5.0, reference={"kind": "setpoint"}, controller=law)

    class Wrapped:
        def __init__(self, robot: Any) -> None:
            self.robot, self.paces = robot, True
            self.command = getattr(robot, "command", "torque")
            self.seen: list[Any] = []

        def read(self) -> Any:
            t, q, dq = self.robot.read()
            self.seen.append(np.array(q))
            turned = np.array(q)
            turned[0] = (turned[0] + np.pi) % (2 * np.pi) - np.pi
            return t, turned, dq

        def write(self, command: Any, /) -> None:
            self.robot.write(command)

    limits = {"acceleration": 4.0, "jerk": 100.0}
    for robot, more in ((SimulatedRobot(scene), {}), (Still(q0), {"limits": limits})):
        wrapped = Wrapped(robot)
        with vff.drive(wrapped, vff.Controller(gen3, law), seconds=3.0, **more) as drive:
            report = finished(drive)
        assert (report.status, report.reason) == ("completed", "")
        assert wrapped.seen[-1][0] > np.pi + 0.05
        assert abs(np.diff(np.array(wrapped.seen), axis=0)).max() < 0.01


def test_a_reading_of_another_turn_is_the_same_place() -> None:
    """An arm that stands in its posture, or where its plan begins, stays, whatever turn its encoder is in."""
    gen3 = vff.Arm.named("gen3")
    ready = np.array([0.0, 0.4, 3.1, -1.9, 0.0, 0.95, 1.5])
    law = {"stiffness": 100.0, "damping": 20.0, "null_damping": 4.0, "posture_stiffness": 5.0}
    scene = vff.Scenario(
        arm=gen3,
        q0=list(ready),
        duration=2.0,
        controller={**law, "posture": list(ready)},
        reference={"kind": "setpoint"},
    )
    plan = vff.plan(scene, [0.0, 0.6, *ready[2:]])

    class Elsewhere:
        paces, turn = True, np.array([0.0, 0.0, -2 * np.pi, 0.0, 0.0, 0.0, 0.0])

        def __init__(self) -> None:
            self.robot = SimulatedRobot(scene)

        def read(self) -> Any:
            t, q, dq = self.robot.read()
            self.q = np.array(q)
            return t, self.q + self.turn, dq

        def write(self, torque: Any, /) -> None:
            self.robot.write(torque)

    for given, end in (
        (vff.Controller(gen3, {**law, "posture": list(ready)}), ready),
        (scene.replace(reference=plan.reference), plan.q[-1]),
    ):
        robot = Elsewhere()
        with vff.drive(robot, given, seconds=plan.duration + 1.0) as drive:
            report = finished(drive)
        assert (report.status, report.reason, report.notes) == ("completed", "", ())
        assert abs(robot.q - end).max() < 0.01
        if drive.state.q_plan is not None:
            assert abs(drive.state.q_plan - drive.state.q).max() < 0.01
    c = vff.Controller(gen3, {**law, "posture": list(ready)})
    x = gen3.pose(ready)[0]
    sides = [c.torque([*ready[:2], side, *ready[3:]], [0.0] * 7, x) for side in (np.pi, -np.pi)]
    np.testing.assert_allclose(*sides, atol=1e-9)


def test_the_search_of_the_self_motion_knows_no_turns() -> None:
    """A ball comes at the elbow; read a turn on, another way cost less, into it."""
    ready = [0.2, 0.4, 0.1, 1.5, 0.0, 1.0, 0.3]
    law = {
        "task": "pose",
        "stiffness": 200.0,
        "damping": 30.0,
        "null_damping": 8.0,
        "avoidance": "cbf",
        "posture": ready,
        "posture_stiffness": 10.0,
        "deadline": "unlimited",
        "yielding": {"preview": {"self_motion": {}}},
    }
    ball = vff.Obstacle.sphere([0.2, 0.6, 0.5], 0.08, vff.Motion.linear([0.0, -0.25, 0.0]))
    runs = [
        vff.simulate(
            vff.Scenario(
                arm=vff.Arm.named("gen3"),
                q0=[*ready[:6], ready[6] + turn],
                duration=2.0,
                controller=law,
                reference={"kind": "setpoint"},
                obstacles=[ball],
            )
        )
        for turn in (0.0, 2 * np.pi)
    ]
    assert abs(runs[0].q - ready).max() > 0.5
    np.testing.assert_allclose(runs[1].q - 2 * np.pi * np.eye(7)[6], runs[0].q, atol=1e-6)


def test_a_target_takes_the_place_of_a_plan() -> None:
    """Then no plan has the joints anywhere."""
    alone = SCENE.replace(obstacles=[])
    scene = alone.replace(reference=vff.plan(alone, list(np.array(SCENE["q0"]) + 0.2)).reference)
    seen = []
    with vff.drive(SimulatedRobot(scene), scene, seconds=1.5) as drive:
        wait_for(lambda: drive.state.t > 0.2)
        seen.append(drive.state.q_plan)
        drive.set_target(drive.state.x)
        wait_for(lambda: drive.state.t > 0.6)
        seen.append(drive.state.q_plan)
    assert seen[0] is not None and seen[1] is None


def test_set_points_begin_at_rest() -> None:
    robot = Still(SCENE["q0"], dq=0.3)
    with (
        pytest.warns(RuntimeWarning, match="joint 0 moves at 0.300 where set points begin"),
        vff.drive(robot, controller(), seconds=1.0, limits=LIMITS) as drive,
    ):
        finished(drive)
    assert robot.told == 0
    noisy = Still(SCENE["q0"], dq=0.01)
    with vff.drive(noisy, controller(), seconds=0.1, limits=LIMITS) as drive:
        assert finished(drive).status == "completed"


def test_references_that_no_number_holds_are_refused() -> None:
    """Where they are given, so that the loop goes on."""
    with vff.drive(SimulatedRobot(SCENE), controller(), seconds=0.3) as drive:
        pose = np.concatenate(ARM.pose(SCENE["q0"]))
        for wrong in (([1e300, *pose[1:]],), (pose, [1e300] * 6), (pose, [0.0] * 6, [-1e10] * 6)):
            with pytest.raises(InputError, match="x_ref: must be within 1e9"):
                drive.set_target(*wrong)
        assert finished(drive).status == "completed"


def test_a_torque_that_cannot_be_asked_for_ends_it() -> None:
    """Nothing begins from a guess where the robot was to say what acts."""

    class Broken(InPython):
        def torque(self) -> Any:
            raise ValueError("sensor broken")

    robot = Broken()
    with (
        pytest.warns(RuntimeWarning, match="ValueError: sensor broken"),
        vff.drive(robot, controller(), seconds=0.1) as drive,
    ):
        report = finished(drive)
    assert report.status == "fault" and isinstance(report.cause, ValueError) and not robot.told


def test_what_does_not_fit_is_refused() -> None:
    """Before anything moves."""
    robot, law = SimulatedRobot(SCENE), controller()
    light = SimulatedRobot(SCENE, arm=ARM)
    assert isinstance(robot, Robot) and isinstance(InPython(), Robot) and not isinstance(3, Robot)
    for wrong in (
        lambda: vff.drive(object(), law),  # type: ignore[arg-type]
        lambda: vff.drive(robot, {"stiffness": 1.0}),  # type: ignore[arg-type]
        lambda: vff.drive(robot, law, rate="fast"),  # type: ignore[arg-type]
    ):
        with pytest.raises(InputTypeError):
            wrong()
    for what, wrong in {
        "rate: ": lambda: vff.drive(robot, law, rate=1.0),
        "seconds: ": lambda: vff.drive(robot, law, seconds=-1.0),
        "patience: ": lambda: vff.drive(robot, law, patience=np.inf),
        "priority: ": lambda: vff.drive(robot, law, priority=100),
        "core: ": lambda: vff.drive(robot, law, core=1000),
        "x_ref": lambda: vff.drive(robot, law, x_ref=[0.1]),
        "robot: has 7 joints": lambda: vff.drive(robot, vff.Controller(vff.Arm.named("ur5e"))),
        "stop_damping": lambda: vff.drive(robot, controller(stop_damping=300.0), rate=100.0),
        "gravity is 'controller', the robot's is 'robot'": lambda: vff.drive(light, law),
        "gravity is 'robot', the robot's is 'controller'": lambda: vff.drive(
            robot, controller(gravity="robot")
        ),
    }.items():
        with pytest.raises(InputError, match=what):
            wrong()
    slow = InPython()
    slow.torque_rate = 1000.0  # type: ignore[attr-defined]
    for rate in ({}, {"torque_rate": 2000.0}):
        with pytest.raises(InputError, match="the robot allows 1000 N·m/s"):
            vff.drive(slow, controller(**rate))
    odd = InPython()
    odd.command = "force"  # type: ignore[attr-defined]
    with pytest.raises(InputError, match="must be one of torque, position, velocity"):
        vff.drive(odd, law)
    assert slow.told == odd.told == [] and robot.read()[0] == 0.0


def test_a_robot_that_carries_its_weight(tmp_path: Path) -> None:
    """What is sent goes without gravity, and changes no faster than allowed; the motion is the same where no
    speed is near its limit, of which a robot gets less.
    """
    robot = SimulatedRobot(SCENE, arm=ARM)
    path = tmp_path / "light.arrows"
    law = controller(gravity="robot", torque_rate=1000.0)
    ball = vff.Obstacle.sphere([-0.05, -0.4, 0.62], 0.08, vff.Motion.linear([0.0, 0.1, 0.0]))
    with vff.drive(robot, law, obstacles=[ball], seconds=1.5, record_to=path, record_every=1) as drive:
        finished(drive)
    light = vff.StreamRecorder.read(path).to_pandas()
    heavy = recorded(SimulatedRobot(SCENE), tmp_path / "heavy.arrows", torque_rate=1000.0, obstacles=[ball])
    speed = heavy.filter(regex="^dq_").to_numpy()[:1500]
    assert (np.abs(speed) < 0.9 * ARM.velocity_limits).all()
    assert np.ptp(heavy.filter(regex="^q_").to_numpy()[:1500], axis=0).max() > 0.05
    sent = light.filter(like="tau_applied").to_numpy()
    assert abs(sent[0]).max() < 1e-9 and abs(np.diff(sent, axis=0)).max() <= 1.0 + 1e-9
    q = [rows.filter(regex="^q_").to_numpy()[1499] for rows in (light, heavy)]
    np.testing.assert_allclose(*q, atol=1e-3)


def test_it_ends_when_nobody_wants_it() -> None:
    robot = InPython()
    drives = [vff.drive(robot, controller())]
    wait_for(lambda: drives[0].state.periods > 10)
    drives.clear()
    wait_for(lambda: robot.calls == ["begin", "end"])


PROGRAM = """
import linecache, sys, threading, time
import vffnull as vff
sys.path.insert(0, {tests!r})
from test_drive import BALL, InPython, SimulatedRobot, SCENE, controller
robot = {robot}
with vff.drive(robot, controller(), obstacles=[BALL], record_to={path!r}) as drive:
    while drive.state.phase != "running":
        time.sleep(0.01)
    def announce():  # once the program waits
        line = ""
        while "_loop.wait(" not in line:
            frame = sys._current_frames()[threading.main_thread().ident]
            line = linecache.getline(frame.f_code.co_filename, frame.f_lineno)
            time.sleep(0.01)
        print("ready", flush=True)
    {body}
print(drive.report.status, flush=True)
"""


def started(body: str, path: Path, robot: str = "InPython()") -> subprocess.Popen[str]:
    tests = str(Path(__file__).parent)
    text = textwrap.dedent(PROGRAM).format(body=body, path=str(path), tests=tests, robot=robot)
    process = subprocess.Popen(
        [sys.executable, "-c", text], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stdout is not None and process.stdout.readline() == "ready\n", process.communicate()
    return process


@pytest.mark.skipif(os.name == "nt", reason="signals as POSIX has them")
@pytest.mark.parametrize("robot", ["InPython()", "SimulatedRobot(SCENE)"])
def test_ctrl_c_ends_it_by_a_damped_stop(tmp_path: Path, robot: str) -> None:
    """While the program waits for it: the drive ends, and the program goes on. The recording shows the
    stop.
    """
    process = started(
        "threading.Thread(target=announce).start(); drive.wait()", tmp_path / "run.arrows", robot
    )
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=HANG)
    assert (process.returncode, out, err) == (0, "interrupted\n", "")
    rows = vff.StreamRecorder.read(tmp_path / "run.arrows").to_pandas()
    assert abs(rows.filter(like="dq_").to_numpy()[-1]).max() < 0.05


@pytest.mark.skipif(os.name == "nt", reason="signals as POSIX has them")
def test_ctrl_c_in_the_block(tmp_path: Path) -> None:
    """Elsewhere in the block it is raised, after the damped stop."""
    process = started("print('ready', flush=True); time.sleep(1e5)", tmp_path / "run.arrows")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=HANG)
    assert process.returncode != 0 and out == "" and "KeyboardInterrupt" in err and "panicked" not in err


@pytest.mark.skipif(os.name == "nt", reason="signals as POSIX has them")
def test_a_recording_survives_a_kill(tmp_path: Path) -> None:
    path = tmp_path / "run.arrows"
    process = started("print('ready', flush=True); time.sleep(1e5)", path)

    def rows() -> int:
        try:
            return len(vff.StreamRecorder.read(path))
        except (InputError, FileNotFoundError):
            return 0

    wait_for(lambda: rows() > 100)
    process.kill()
    process.communicate(timeout=HANG)
    table = vff.StreamRecorder.read(path).to_pandas()
    times = table["t"].to_numpy()
    np.testing.assert_allclose(np.diff(times), 0.01, atol=1e-9)
    assert len(table) > 100 and table.filter(like="tau_applied").shape[1] == 7


def test_a_program_that_ends_without_stopping(tmp_path: Path) -> None:
    """Python ends: the drive is stopped before."""
    text = textwrap.dedent(
        f"""
        import sys
        sys.path.insert(0, {str(Path(__file__).parent)!r})
        from test_drive import InPython, controller, vff
        class Told(InPython):
            def end(self):
                print("end", abs(self.told[-1] - self.told[-2]).max() < 1.0, flush=True)
        drive = vff.drive(Told(), controller())
        while drive.state.phase != "running":
            pass
        """
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=HANG)
    assert (done.returncode, done.stdout, done.stderr) == (0, "end True\n", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_has_no_drive() -> None:
    with vff.drive(SimulatedRobot(SCENE), controller()) as drive:
        read, write = os.pipe()
        child = os.fork()
        if child == 0:
            try:
                drive.set_obstacles([])
            except InputError as error:
                os.write(write, str(error).encode())
            finally:
                os._exit(0)
        os.close(write)
        os.waitpid(child, 0)
        with os.fdopen(read, "rb") as pipe:
            assert b"of which this one is a fork" in pipe.read()
        assert drive.running


def test_a_disk_that_is_full_does_not_end_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError("No space left on device")

    monkeypatch.setattr(vff.StreamRecorder, "write", full)
    with pytest.warns(RuntimeWarning, match="the recording has ended: No space left"):
        with vff.drive(
            SimulatedRobot(SCENE), controller(), seconds=0.5, record_to=tmp_path / "a.arrows"
        ) as drive:
            assert finished(drive).status == "completed"


def test_a_stream_may_say_where_it_is(tmp_path: Path) -> None:
    """Rows without obstacles or orientations are of an arm in space if that is said."""

    class Row:
        t, q, x = 0.0, [0.1], [0.1, 0.2, 0.3]

    for dimension, names in ((3, ["x_x", "x_y", "x_z"]), (2, ["x_x", "x_y", "x_phi"])):
        with vff.StreamRecorder(tmp_path / "a.arrows", dimension=dimension) as recorder:
            recorder.write(Row())
        assert [
            name for name in vff.StreamRecorder.read(recorder.path).column_names if name[0] == "x"
        ] == names
    for wrong in (1, 4):
        with pytest.raises(InputError):
            vff.StreamRecorder(tmp_path / "b.arrows", dimension=wrong)  # type: ignore[arg-type]


def test_many_threads_at_once() -> None:
    """Setters and readers from several threads while it runs: nothing is torn, nobody waits for ever."""
    start, orientation = ARM.pose(SCENE["q0"])
    over, failures = threading.Event(), []

    def work(seed: int) -> None:
        rng = np.random.default_rng(seed)
        try:
            while not over.is_set():
                drive.set_target((start + rng.uniform(-0.01, 0.01, 3), orientation))
                drive.set_obstacles([vff.Obstacle.sphere([0.0, 2.0, 0.5], 0.1)] * int(rng.integers(1, 4)))
                drive.move_obstacle(0, [0.0, 2.0 + rng.uniform(0.0, 0.5), 0.5])
                state = drive.state
                assert (
                    np.isfinite(state.tau).all()
                    and abs(state.tau_task + state.tau_null - state.tau).max() < 1e-9
                )
        except BaseException as error:
            failures.append(error)

    with vff.drive(SimulatedRobot(SCENE), controller()) as drive:
        wait_for(lambda: drive.state.t > 0.01)
        threads = [threading.Thread(target=work, args=(seed,)) for seed in range(3)]
        for thread in threads:
            thread.start()
        wait_for(lambda: drive.state.t > 1.5)
        over.set()
        for thread in threads:
            thread.join(HANG)
    assert failures == [] and drive.report.status == "stopped"


def test_waiting_has_an_end() -> None:
    with vff.drive(SimulatedRobot(SCENE), controller()) as drive:
        begun = time.monotonic()
        assert not drive.wait(0.05)
        assert time.monotonic() - begun >= 0.05


@pytest.mark.parametrize(("deadline", "cut"), [(1e-3, True), (1e9, False), ("unlimited", False)])
def test_a_deadline_by_the_clock_is_kept_and_counted(deadline: Any, cut: bool) -> None:
    """In a crowd, which asks for look-ahead always: without time for any, every cycle is late and cut, and
    the arm is within its limits all the same; with all the time there is, nothing is left out.
    """
    scene = vff.Scenario.load("iiwa-crowd").replace(**{"controller.deadline": deadline})
    robot = SimulatedRobot(scene)
    with vff.drive(robot, scene, seconds=0.6) as drive:
        assert drive.wait(HANG)
        state, report = drive.state, drive.report
    assert report.status == "completed" and np.isfinite(state.q).all() and np.isfinite(state.command).all()
    most = scene.arm.torque_limits
    assert most is not None and (np.abs(state.tau) <= most * (1 + 1e-9)).all()
    left_out = report.left_out
    assert state.left_out == left_out and report.to_dict()["left_out"] == left_out
    if cut:
        assert left_out["late"] > 550 and left_out["cut"] > 550
    else:
        assert left_out["late"] == left_out["cut"] == left_out["rollouts"] == 0


def test_a_loop_has_a_deadline_of_three_tenths_of_its_period() -> None:
    """Of 1 ns where the period is 3 ns: no cycle is so short. Without a loop there is none."""
    settings = dict(SCENE["controller"]) | {"avoidance": "cbf", "yielding": {"preview": {}}}
    law, q, dq = vff.Controller(ARM, settings), np.array(SCENE["q0"]), np.zeros(7)
    for k in range(10):
        law.torque(q, dq, ARM.pose(q), t=1e-3 * k)
    assert set(law.left_out.values()) == {0}
    law.begin(3e-9)
    for k in range(10):
        law.cycle(3e-9 * (k + 1), q, dq)
    assert law.left_out["late"] == law.left_out["cut"] == 10
    law.begin(1e-3)
    assert set(law.left_out.values()) == {0}
