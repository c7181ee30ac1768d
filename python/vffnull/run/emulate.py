"""A scenario against an emulated robot, from its start to its end, as fast as it goes."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._support.arguments import positive
from vffnull._support.errors import InputError
from vffnull.model.scenario import ScenarioLike, prepare
from vffnull.robots.emulated import ROBOTS, Disturbances, franka, ur
from vffnull.robots.emulated.body import Physics
from vffnull.robots.franka import FrankaRobot
from vffnull.robots.ur import URRobot
from vffnull.run.drive import Drive, DriveReport, drive

if TYPE_CHECKING:
    from vffnull.robots.emulated.reflex import Margin, Reflex

__all__ = ["Emulation", "emulate"]

_MOVES = 0.05  # rad/s
_COLLISION_TORQUE = 40.0  # N·m: what the emulated robot has by itself
_BLEND_TIME = 0.5  # s: the default of `command.blend_time`


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
    does not know of the disturbances.

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
        Keys of the scenario that differ. Without a ``controller.deadline`` there is none.
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
    there.body.known = there.body.loaded  # as a program has to tell
    given = ready["controller"].get("command")
    blend_time = given.get("blend_time", _BLEND_TIME) if isinstance(given, Mapping) else _BLEND_TIME
    # Its time goes on with the cycles, however long they take: a clock says nothing of it.
    is_timed = ready["controller"].get("deadline") is not None
    driving = ready if is_timed else ready.replace(**{"controller.deadline": "unlimited"})
    duration = ready.duration + blend_time if seconds is None else positive("seconds", seconds)
    watch = _Watch(there)
    there.before_state = watch
    began = perf_counter()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "drive: ", RuntimeWarning)  # it is in the report
        with drive(adapter, driving, rate=rate, seconds=duration) as driven:
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
        clearance=watch.clearance if ready.to_dict().get("obstacles") else None,
        released=watch.released,
        left=getattr(there, "left", 0),
        seconds=perf_counter() - began,
    )


class _Watch:
    """Called before every state, in the thread of the loop: counts."""

    def __init__(self, robot: franka.Robot | ur.Robot) -> None:
        self.body = robot.body
        self.ready = threading.Event()
        self.drive: Drive | None = None
        self.clearance = robot.body.clearance
        self.released = 0

    def __call__(self, _robot: object) -> None:
        if self.drive is None:
            self.ready.wait()
        body, driven = self.body, self.drive
        assert driven is not None
        self.clearance = min(self.clearance, body.clearance)
        if driven._loop.phase == "released" and np.abs(body.dq).max() > _MOVES:
            self.released += 1
