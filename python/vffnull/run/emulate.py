"""A scenario against an emulated robot, from its start to its end, as fast as it goes."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

import vffnull._core as _core
from vffnull._core import Controller
from vffnull._support.arguments import positive
from vffnull._support.errors import InputError
from vffnull.model.scenario import Scenario, ScenarioLike, prepare
from vffnull.robots.emulated import ROBOTS, Disturbances, franka, ur
from vffnull.robots.emulated.body import Physics
from vffnull.robots.franka import FrankaRobot
from vffnull.robots.ur import URRobot
from vffnull.run.drive import Drive, DriveReport, drive
from vffnull.run.simulate import simulate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vffnull.robots.emulated.reflex import Margin, Reflex

    Array = NDArray[np.float64]

__all__ = ["Emulation", "emulate"]

_EVERY = 5  # cycles between two references, which are carried on in between
_MOVES = 0.05  # rad/s
_COLLISION_TORQUE = 40.0  # N·m: what the emulated robot has by itself
_START = 0.5  # s: the default of `command.start`


@dataclass(frozen=True)
class Emulation:
    """How a scenario went against an emulated robot.

    Attributes
    ----------
    scenario : str
        Its name.
    robot : str
        One of `vffnull.robots.emulated.ROBOTS`.
    rate : float
        Cycles of the robot per second [Hz].
    cycles : int
        How many there were, until the drive was over.
    reflex : Reflex or None
        The rule that ended it, if one did.
    margins : tuple of Margin
        The nearest that each limit came, the robot's own braking not included.
    report : DriveReport
        How the drive went.
    clearance : float or None
        Least distance to an obstacle [m]; None without one.
    released : int
        Cycles in which the arm was left to gravity alone while it moved.
    left : int
        Steps in which a UR held its position, because no torque came.
    seconds : float
        How long it took here [s].
    """

    scenario: str
    robot: str
    rate: float
    cycles: int
    reflex: Reflex | None
    margins: tuple[Margin, ...]
    report: DriveReport
    clearance: float | None
    released: int
    left: int
    seconds: float

    @property
    def fine(self) -> bool:
        """Whether there was neither a reflex nor a fault of the drive."""
        return self.reflex is None and self.report.status != "fault"

    def to_dict(self) -> dict[str, Any]:
        """It as plain values, for JSON."""
        reflex = self.reflex
        return {
            "scenario": self.scenario,
            "robot": self.robot,
            "rate": self.rate,
            "cycles": self.cycles,
            "reflex": None
            if reflex is None
            else {
                "rule": reflex.rule.name,
                "source": reflex.rule.source,
                "place": reflex.place,
                "value": reflex.value,
                "limit": reflex.limit,
                "unit": reflex.rule.unit,
                "cycle": reflex.cycle,
                "t": reflex.t,
            },
            "margins": [
                {
                    "rule": each.rule.name,
                    "place": each.place,
                    "share": each.share,
                    "value": each.value,
                    "limit": each.limit if np.isfinite(each.limit) else None,
                    "unit": each.rule.unit,
                    "t": each.cycle / self.rate,
                }
                for each in self.margins
            ],
            "status": self.report.status,
            "reason": self.report.reason,
            "notes": list(self.report.notes),
            "clearance": self.clearance,
            "released": self.released,
            "left": self.left,
            "seconds": self.seconds,
        }

    def __str__(self) -> str:
        names = [" of ".join(filter(None, (each.rule.what, each.place))) for each in self.margins]
        wide = max(map(len, names))
        lines = [f"{'nearest to a limit':{wide}}   share       value       limit   at [s]"]
        for name, each in zip(names, self.margins, strict=True):
            limit = f"{each.limit:11.4g}" if np.isfinite(each.limit) else f"{'none':>11}"
            lines.append(
                f"{name:{wide}}  {each.share:6.1%} {each.value:11.4g} {limit} "
                f"{each.cycle / self.rate:8.3f}   {each.rule.unit}".rstrip()
            )
        return "\n".join(lines)


def emulate(
    scenario: ScenarioLike,
    robot: str = "emulated-franka",
    disturbances: Disturbances | None = None,
    *,
    overrides: Mapping[str, Any] | None = None,
    physics: Physics = "own",
    seconds: float | None = None,
    collision_force: float | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Emulation:
    """Run a scenario as `vffnull.drive` would on a robot: the same adapter and the same loop, an emulated
    robot.

    The controller is the scenario's, with ``command = "of the robot"`` unless it has a table of its own; it
    does not know of the disturbances. A governor does not act, as in any drive, nor does the spring to the
    posture of a plan.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        What to run.
    robot : {"emulated-franka", "emulated-ur"}, optional
        Which robot.
    disturbances : Disturbances, optional
        What is not as the model says; nothing by default. `vffnull.robots.emulated.usual` has what is to be
        expected.
    overrides : Mapping, optional
        Keys of the scenario that differ.
    physics : {"own", "mujoco"}, optional
        Whose dynamics move the arm.
    seconds : float, optional
        How long, by the robot's clock [s]; by default the scenario's duration after the start.
    collision_force : float, optional
        From which external force and torque at the hand on a Franka takes it for a collision [N, N·m]; by
        default 20. A kilogram that it does not know weighs 10 N, and more where the hand accelerates.
    progress : callable, optional
        Gets the time of the robot and the duration [s] every 100 ms.

    Returns
    -------
    Emulation
        How it went. Ctrl-C ends it as it ends a drive, by a damped stop.

    Raises
    ------
    vffnull.errors.InputError
        If the robot is none of these, or the scenario's arm is another one.
    vffnull.errors.ScenarioError
        If the scenario cannot be run.

    Examples
    --------
    >>> from vffnull.run.emulate import emulate
    >>> outcome = emulate("panda-sweep", seconds=0.2)
    >>> outcome.fine, outcome.reflex
    (True, None)
    """
    if robot not in ROBOTS:
        raise InputError(f"robot: must be one of {', '.join(ROBOTS)}, got {robot!r}")
    ready = prepare(scenario, overrides)
    there: franka.Robot | ur.Robot
    if robot == "emulated-franka":
        there = franka.Robot(ready, disturbances, physics)
        adapter: Any = FrankaRobot(there)
        rate = franka.RATE
        if collision_force is not None:
            adapter.set_collision_behavior(_COLLISION_TORQUE, positive("collision_force", collision_force))
    else:
        there, rate = ur.Robot(ready, disturbances, physics), ur.RATE
        adapter = URRobot(there)
        adapter.paces = True  # its time goes on with the commands
    settings = _settings(ready)
    start = settings["command"].get("start", _START) if isinstance(settings["command"], dict) else _START
    duration = ready.duration + start if seconds is None else positive("seconds", seconds)
    reference = _Reference(ready, rate, start)
    watch = _Watch(there, reference)
    there.before_state = watch
    obstacles = ready.to_dict().get("obstacles", [])
    began = perf_counter()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "drive: ", RuntimeWarning)  # it is in the report
        with drive(
            adapter,
            Controller(ready.arm, settings),
            rate=rate,
            x_ref=reference.at(0)[0],
            obstacles=obstacles,
            seconds=duration,
        ) as driven:
            watch.drive = driven
            watch.ready.set()
            while not driven.wait(0.1):
                if progress is not None:
                    progress(min(there.body.t, duration), duration)
    return Emulation(
        scenario=ready.name or "scenario",
        robot=robot,
        rate=rate,
        cycles=there.reflex.cycle if there.reflex is not None else there.body.cycle,
        reflex=there.reflex,
        margins=there.margins(),
        report=driven.report,
        clearance=watch.clearance if obstacles else None,
        released=watch.released,
        left=getattr(there, "left", 0),
        seconds=perf_counter() - began,
    )


class _Watch:
    """Called before every state, in the thread of the loop: gives the reference, and counts."""

    def __init__(self, robot: franka.Robot | ur.Robot, reference: _Reference) -> None:
        self.body, self.reference = robot.body, reference
        self.ready = threading.Event()
        self.drive: Drive | None = None
        self.clearance = robot.body.clearance
        self.released = 0
        self._until = 0

    def __call__(self, _robot: object) -> None:
        if self.drive is None:
            self.ready.wait()
        body, driven = self.body, self.drive
        assert driven is not None
        self.clearance = min(self.clearance, body.clearance)
        if driven._loop.phase == "released" and np.abs(body.dq).max() > _MOVES:
            self.released += 1
        if self.reference.moves and body.cycle >= self._until:
            self._until = body.cycle + _EVERY
            driven.set_target(*self.reference.at(body.cycle))


class _Reference:
    """The reference of a scenario in every cycle, with velocity and acceleration, from `start` [s] on."""

    def __init__(self, scenario: Scenario, rate: float, start: float) -> None:
        period, self._begins = 1.0 / rate, round(start * rate)
        steps = max(1, round(period / 1e-3))
        numerics = {"dt": period / steps, "control_every": steps, "record_every": steps}
        plain: dict[str, Any] = {
            "obstacles": [],
            "controller": {"task": scenario["controller"].get("task", "position")},
            "simulation": {**numerics, "integrator": "semi_implicit_euler"},
            **dict.fromkeys(("perception", "measurement", "actuator", "plant", "replan")),
        }
        if scenario["reference"]["kind"] == "setpoint":
            plain["duration"] = 2.0 * period
        seen = simulate(scenario.replace(**plain), progress=False)
        place, turn = np.array(seen.x_ref), seen.orientation_ref
        self.place = place if turn is None else np.concatenate([place, turn], axis=1)
        velocity = np.gradient(place, period, axis=0)
        if turn is not None:
            velocity = np.concatenate([velocity, _angular(np.array(turn), period)], axis=1)
        self.velocity = velocity
        self.acceleration = np.gradient(velocity, period, axis=0)
        self.moves = bool(np.ptp(self.place, axis=0).max() > 1e-12)

    def at(self, cycle: int) -> tuple[Array, Array, Array]:
        """Pose, velocity and acceleration in a cycle; at rest before the first, and after the last."""
        wanted = cycle - self._begins
        k = max(0, min(wanted, len(self.place) - 1))
        if k != wanted:
            rest = np.zeros_like(self.velocity[k])
            return self.place[k], rest, rest
        return self.place[k], self.velocity[k], self.acceleration[k]


def _angular(turn: Array, period: float) -> Array:
    """Angular velocities (T, 3) [rad/s] of unit quaternions (T, 4), by central differences."""
    turns = _core.matrices(turn)
    between = _core.quaternions(np.einsum("kij,klj->kil", turns[2:], turns[:-2]))
    sine = np.linalg.norm(between[:, 1:], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, between[:, :1])
    inner = between[:, 1:] * np.where(sine > 1e-15, angle / np.maximum(sine, 1e-15), 2.0) / (2.0 * period)
    return np.concatenate([inner[:1], inner, inner[-1:]])


def _settings(scenario: Scenario) -> dict[str, Any]:
    """The controller's settings as a drive takes them."""
    settings = dict(scenario["controller"])
    settings.pop("governor", None)
    if "posture" not in settings:
        settings.pop("posture_stiffness", None)
    settings.setdefault("command", "of the robot")
    return settings
