"""A controller in the loop of a robot: a thread with a deadline in the core, targets from anywhere."""

from __future__ import annotations

import os
import warnings
import weakref
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from math import isfinite
from types import TracebackType
from typing import TYPE_CHECKING, Any, Literal, get_args

import vffnull._core as _core
from vffnull._support.arguments import number, positive, whole
from vffnull._support.errors import InputError, InputTypeError
from vffnull.logs.drive import DriveLog
from vffnull.logs.stream import StreamRecorder
from vffnull.model.outcome import Replan
from vffnull.model.robot import CommandKind
from vffnull.model.scenario import Scenario, ScenarioLike, prepare
from vffnull.model.timing import Clock, Histogram

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from vffnull.model.obstacle import Obstacle
    from vffnull.model.robot import Robot

    Array = NDArray[np.float64]

__all__ = ["Drive", "DriveReport", "DriveState", "drive"]

_LIKE = (str, os.PathLike, Scenario)
_PATIENCE = 10.0  # s after which a robot that does not answer is left alone


@dataclass(frozen=True, eq=False)
class DriveState:
    """What a drive did in its last period. Arrays are copies; NaN before the first.

    Attributes
    ----------
    t : float
        Time of the robot since its first state [s].
    q, dq : (n,) ndarray
        Joint positions [rad] and velocities [rad/s], as the robot said.
    tau, tau_task, tau_null, tau_vff : (n,) ndarray
        Torque of the law and its parts, as in `Terms` [N·m].
    command : (n,) ndarray
        What was sent: torques [N·m], positions [rad] or velocities [rad/s].
    x, x_ref : (m,) ndarray
        Pose of the end effector and its reference, as `Controller.torque` takes it.
    force, clearance : (n,) ndarray
        Repulsion on each link [N], and its distance to the nearest obstacle [m].
    tau_ext_estimate : (n,) ndarray or None
        Torque that the model does not know, as an observer estimates it [N·m]; None without one.
    path_time : float or None
        Where the clock of the scenario's reference is [s], which waits with a `governor`; None without one.
    q_plan : (n,) ndarray or None
        Where the plan that is followed has the joints [rad]; None as long as there is none.
    phase : str
        ``"starting"``, ``"running"``, ``"holding"``, ``"damping"``, ``"released"``, ``"lost"``,
        ``"stopping"``, ``"finished"``: what the output stage does; ``"over"`` when the thread has ended.
    periods : int
        Periods so far.
    left_out : dict
        What was left out so far, as `Controller.left_out` counts it.
    """

    t: float
    q: Array
    dq: Array
    tau: Array
    tau_task: Array
    tau_null: Array
    tau_vff: Array
    command: Array
    x: Array
    x_ref: Array
    force: Array
    clearance: Array
    phase: str
    periods: int
    left_out: dict[str, int]
    tau_ext_estimate: Array | None = None
    path_time: float | None = None
    q_plan: Array | None = None

    def __repr__(self) -> str:
        return f"<DriveState: {self.phase}, t = {self.t:.3f} s, clearance {self.clearance.min():.3f} m>"


@dataclass(frozen=True, eq=False, repr=False)
class DriveReport(Clock):
    """How a drive went.

    Attributes
    ----------
    status : str
        ``"completed"``, ``"stopped"`` if it was asked to end, ``"interrupted"`` by Ctrl-C, or ``"fault"``.
    reason : str
        What went wrong, in a sentence; empty if nothing did.
    cause : BaseException or None
        The exception that the robot has raised, if it has.
    rate : float
        Periods per second [Hz].
    periods : int
        How many there were.
    missed : int
        Those whose work did not end before the next should begin.
    skipped : int
        Periods of the clock that were left out because the one before took too long.
    latency : Histogram
        From the instant at which a period was due to its start; empty if the robot paces the loop.
    step : Histogram
        How long reading, law and writing took; if the robot paces the loop, without waiting for its state.
    response : Histogram
        From when a period was due, or the state of a robot that paces came, to the end of its step.
    jitter : Histogram
        Deviation of the interval between two starts from the period.
    lost : int
        Rows of the recording that were lost because its thread came too late.
    clearance : float
        The least distance of a link from what the law knew [m], at the set points if there are any: negative
        in contact, which the notes name, infinite without obstacles.
    replans : tuple of Replan
        Every search for a plan.
    left_out : dict
        What was left out for lack of time, or for a bound, as `Controller.left_out` counts it.
    notes : tuple of str
        What the system refused, and what else is to be known.
    """

    status: Literal["completed", "stopped", "interrupted", "fault"]
    reason: str
    cause: BaseException | None
    skipped: int
    lost: int
    clearance: float
    replans: tuple[Replan, ...] = ()
    left_out: dict[str, int] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The report as plain values, for JSON: times in seconds, histograms by their quantiles."""
        return {
            "status": self.status,
            "reason": self.reason,
            "verdict": self.verdict,
            "held": self.held,
            "rate": self.rate,
            "periods": self.periods,
            "missed": self.missed,
            "skipped": self.skipped,
            "lost": self.lost,
            "clearance": self.clearance if isfinite(self.clearance) else None,
            "replans": [asdict(each) for each in self.replans],
            "left_out": dict(self.left_out),
            "notes": list(self.notes),
            **self._summaries(),
        }

    def __repr__(self) -> str:
        why = f" ({self.reason})" if self.reason else ""
        contact = f" In contact, by {-1e3 * self.clearance:.1f} mm." if self.clearance < 0.0 else ""
        return f"<DriveReport: {self.status}{why}.{contact} {self.verdict}>"


class Drive:
    """A drive under way: made by `drive`. Any thread may call its methods.

    Used in a ``with`` block it ends with the block, by a damped stop, whatever ends that.

    Attributes
    ----------
    robot : Robot
        What is driven.
    rate : float
        Periods per second [Hz].
    """

    def __init__(
        self, robot: Any, loop: _core.DriveLoop, rate: float, recorder: StreamRecorder | None
    ) -> None:
        self.robot, self.rate = robot, rate
        self._loop = loop
        self._interrupted = False
        self._log = DriveLog(loop, recorder) if recorder is not None else None
        # Also when Python ends: the thread may need it for the last commands.
        self._leave = weakref.finalize(self, _leave, loop, self._log)
        loop.start()

    def set_target(
        self,
        x_ref: ArrayLike | Sequence[ArrayLike],
        dx_ref: ArrayLike | None = None,
        ddx_ref: ArrayLike | None = None,
    ) -> None:
        """Give the reference of the end effector, from now on.

        Until the next call it is carried on with its velocity and acceleration, for `patience` seconds; then
        it comes to rest on its path within as long again. A reference that jumps makes a torque that jumps,
        as far as the controller's `command` allows: give one that begins where the end effector is.

        Parameters
        ----------
        x_ref, dx_ref, ddx_ref : array_like
            Pose, velocity and acceleration, as `Controller.torque` takes them.

        Raises
        ------
        vffnull.errors.InputError
            If they are no reference.
        """
        self._loop.set_target(x_ref, dx_ref, ddx_ref)

    def set_obstacles(
        self, obstacles: Iterable[Obstacle | Mapping[str, Any]], t: float | None = None
    ) -> None:
        """Put other obstacles in place of those that there are, all at once.

        They are made ready in this thread; in the loop they are exchanged.

        Parameters
        ----------
        obstacles : iterable of Obstacle or Mapping
            What to keep away from.
        t : float, optional
            The time of the drive [s] at which their motions begin; by default now, so that positions are
            where they are.

        Raises
        ------
        vffnull.errors.ScenarioError
            If one of them is none; then nothing has changed.
        """
        self._loop.set_obstacles(tuple(obstacles), t)

    def move_obstacle(self, obstacle: int, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Say where an obstacle is now: cheaper than `set_obstacles`, for a tracker.

        Parameters
        ----------
        obstacle : int
            Which of them, counted from 0.
        position, velocity : (D,) array_like
            Where it is [m], and how it goes on [m/s]; at rest by default.

        Raises
        ------
        vffnull.errors.InputError
            If there is none of that number, or the numbers make no sense.
        """
        self._loop.move_obstacle(obstacle, position, velocity)

    def set_controller(self, controller: _core.Controller | Scenario, blend: float = 0.5) -> None:
        """Let another controller take over, with other gains, another posture, load or tool.

        The torque goes over from one law to the other without a step; while it does, it is a mean of both, so
        that limits and distances that both keep are kept. Obstacles, reference and loop stay as they are, and
        so does what an observer and a tank know; a look-ahead begins anew. It waits for the last one, and a
        target that is set for another tip of it waits with it.

        A load that the arm takes up is a controller for ``arm.with_load(mass)``. A robot that adds the torque
        against gravity itself has to be told of it as well, at the same time. With another tool
        (``arm.with_tool(position)``) a target that was set before means the new tip: set another one; where
        none was set the new tip stays where it is, and along a plan it goes where the joints put it.

        Parameters
        ----------
        controller : Controller or Scenario
            The new law, or a scenario that has it: with the same joints, for the same task, with the same
            `command`. Its own obstacles and reference do not count. The drive works on a copy.
        blend : float, optional
            How long the transition takes [s].

        Raises
        ------
        vffnull.errors.InputError
            If it does not suit the loop; then nothing has changed.

        Examples
        --------
        >>> from vffnull.robots.simulated import SimulatedRobot
        >>> panda, settings = Arm.named("panda"), {"task": "pose"}
        >>> with drive(SimulatedRobot("panda-sweep"), Controller(panda, settings), seconds=1.0) as driven:
        ...     driven.set_controller(Controller(panda.with_load(0.5), settings))
        ...     driven.wait()
        True
        """
        if not isinstance(controller, _core.Controller | Scenario):
            raise InputTypeError(f"controller: expected a Controller, not a {type(controller).__name__}")
        self._loop.set_controller(controller, positive("blend", blend))

    def update_points(
        self, cloud: ArrayLike, obstacle: int = 0, velocities: ArrayLike | None = None, t: float | None = None
    ) -> None:
        """Put other points in place of those of a cloud; as `Controller.update_points`."""
        self._loop.update_points(cloud, obstacle, velocities, t)

    @property
    def state(self) -> DriveState:
        """What it did in its last period; does not wait for the loop."""
        loop = self._loop
        return DriveState(**loop.latest(), phase=loop.phase, periods=loop.periods, left_out=loop.left_out)

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self._loop.phase != "over"

    def stop(self) -> None:
        """Ask it to end, by a damped stop, and return at once."""
        self._loop.stop()

    def wait(self, seconds: float | None = None) -> bool:
        """Wait for its end. Ctrl-C ends it, by a damped stop.

        Parameters
        ----------
        seconds : float, optional
            How long at most [s]; for ever by default.

        Returns
        -------
        bool
            Whether it is over.
        """
        try:
            over = self._loop.wait(None if seconds is None else number("seconds", seconds), True)
        except KeyboardInterrupt:
            self._interrupted = True
            self._finish()
            return not self.running
        if over:
            self._finish()
        return over

    @property
    def report(self) -> DriveReport:
        """How it went, once it is over.

        Raises
        ------
        vffnull.errors.InputError
            If it is not.
        """
        found = self._loop.report()
        if found is None:
            raise InputError("report: the drive is not over; stop() and wait() for it")
        for name in ("latency", "step", "response", "jitter"):
            found[name] = Histogram(*found[name])
        found["notes"] = tuple(found["notes"])
        found["replans"] = tuple(Replan(**each) for each in found["replans"])
        if self._interrupted and found["status"] == "stopped":
            found["status"] = "interrupted"
        return DriveReport(rate=self.rate, lost=self._log.lost if self._log else 0, **found)

    def __enter__(self) -> Drive:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._interrupted |= kind is not None and issubclass(kind, KeyboardInterrupt)
        self._finish()
        if not self.running and (reason := self.report.reason):
            warnings.warn(f"drive: {reason}", RuntimeWarning, stacklevel=2)

    def _finish(self) -> None:
        """Bring it to its end, and close its recording."""
        self._leave()

    def __repr__(self) -> str:
        return f"<Drive: {self._loop.phase}, {self._loop.periods} periods at {self.rate:g} Hz>"


def _leave(loop: _core.DriveLoop, log: DriveLog | None) -> None:
    loop.stop()
    over = loop.wait(_PATIENCE, False)
    if log is not None:
        log.close()
    if not over:
        sentence = f"drive: the robot has not answered for {_PATIENCE:g} s; its thread is left alone"
        warnings.warn(sentence, RuntimeWarning, stacklevel=3)


def drive(
    robot: Robot,
    controller: _core.Controller | ScenarioLike,
    rate: float = 1000.0,
    *,
    x_ref: ArrayLike | Sequence[ArrayLike] | None = None,
    obstacles: Iterable[Obstacle | Mapping[str, Any]] | None = None,
    seconds: float | None = None,
    patience: float = 0.1,
    sight_patience: float | None = None,
    limits: Mapping[str, Any] | None = None,
    record_to: str | os.PathLike[str] | None = None,
    record_every: int = 10,
    priority: int | None = None,
    core: int | None = None,
) -> Drive:
    """Drive a robot by a controller, on a thread of the core with a deadline per period.

    In every period the state is read, the torque computed, and what the output stage makes of it written; a
    period that comes too late is left out. The output stage is set by the controller's `command`
    (`ControlSettings`): it blends in over half a second, watches for states that do not come, keeps torques
    from changing too fast, and ends by damping the arm until it stands. Whatever goes wrong in the robot's
    methods (an exception, an array of the wrong shape, numbers that are not finite, a time that stands
    still) ends the drive in the same way, and the report says what it was. Nothing of it replaces the
    robot's own safety functions and its stop button.

    A robot in Python needs Python's lock (the GIL) in every period: any other thread of Python that computes
    delays it, by up to ``sys.getswitchinterval()`` (5 ms), and more where a library holds the lock for
    longer; docs/on-your-robot.md has a table. A `SimulatedRobot`, and drivers in Rust
    (``vff_core::runtime::drive``), take 0.01 ms and do not need the lock.

    Parameters
    ----------
    robot : Robot
        An object with `read` and `write`: see `vffnull.robots.Robot`, and the adapters beside it.
    controller : Controller, or str, path, Mapping or Scenario
        The law with its settings; the drive works on a copy. Of a scenario its controller, obstacles and
        reference: that begins when the torque has been blended in, and waits where the controller has a
        `governor`. A plan is followed with its posture and its margins, and the robot has to be where it
        begins, within 0.1 rad; with a table `replan` a plan is searched, in a thread of its own, where the
        reference leads nowhere. Without `command`, what a robot with ``gravity`` or ``torque_rate`` takes
        is that `of the robot`.
    rate : float, optional
        Periods per second [Hz], 10 to 20 000. A robot that paces the loop has its own, which this should say.
    x_ref : array_like, optional
        Reference of the end effector, as `Controller.torque` takes it; by default that of the scenario, or it
        stays where it is.
    obstacles : iterable of Obstacle or Mapping, optional
        What to keep away from, where it is at the first state; by default that of the scenario, or nothing.
    seconds : float, optional
        How long, by the robot's clock [s]; until it is stopped by default.
    patience : float, optional
        How long a reference is carried on without a new one [s]; then it comes to rest.
    sight_patience : float, optional
        How long an obstacle may go unseen for which `update_points` or `move_obstacle` has come [s]: then
        the drive ends, by a damped stop, as of a camera that has died. By default what was seen last counts
        for ever; points that come with a time `t` are as old as that.
    limits : Mapping, optional
        Needed for a robot that takes positions or velocities: ``acceleration`` [rad/s²] and ``jerk``
        [rad/s³] of its set points, and if you like ``speed`` and ``threshold``; see `VirtualArm`, whose set
        points it gets. ``cbf`` keeps distances within these limits; a plan that needs more is refused.
    record_to : str or path, optional
        A file ``.arrows`` that is written while the robot is driven: see `StreamRecorder`, which reads it.
        It holds what was written half a second before a process was killed. Needs ``vffnull[io]``.
    record_every : int, optional
        Periods per recorded row.
    priority : int, optional
        Run under SCHED_FIFO with this priority, 1 to 99, which few users are allowed.
    core : int, optional
        Stay on this core.

    Returns
    -------
    Drive
        The drive, under way: use it in a ``with`` block.

    Raises
    ------
    vffnull.errors.InputError
        If an argument makes no sense, the controller's `command` does not suit the robot, or its damping is
        unstable at this rate.
    vffnull.errors.InputTypeError
        If an argument is of a type that cannot be used.
    vffnull.errors.ScenarioError
        If the scenario cannot be run, or its ``replan`` cannot plan for the arm.

    Warns
    -----
    RuntimeWarning
        At the end of a ``with`` block, if something went wrong: the report's `reason`.

    Examples
    --------
    >>> from vffnull.robots.simulated import SimulatedRobot
    >>> robot = SimulatedRobot("panda-sweep")
    >>> controller = Controller(Arm.named("panda"), {"task": "pose", "stiffness": 900.0, "damping": 60.0})
    >>> ball = Obstacle.sphere([-0.05, -0.6, 0.62], 0.08, Motion.linear([0.0, 0.2, 0.0]))
    >>> with drive(robot, controller, obstacles=[ball], seconds=1.0) as panda:
    ...     panda.wait()
    True
    >>> panda.report.status
    'completed'

    From one compartment of a shelf to the next:

    >>> with drive(SimulatedRobot("panda-shelf"), "panda-shelf", seconds=0.7) as panda:
    ...     panda.wait()
    True
    >>> round(panda.state.path_time, 1)
    0.2
    """
    command = _kind(robot)
    law = controller if isinstance(controller, _core.Controller) else _scenario(robot, controller)
    if limits is not None and not isinstance(limits, Mapping):
        raise InputTypeError(f"limits: expected a mapping, not a {type(limits).__name__}")
    options = {
        "rate": number("rate", rate),
        "seconds": None if seconds is None else positive("seconds", seconds),
        "patience": positive("patience", patience),
        "sight_patience": None if sight_patience is None else positive("sight_patience", sight_patience),
        "record_every": 0 if record_to is None else whole("record_every", record_every, 1, 1_000_000),
        "command": command,
        "paces": bool(getattr(robot, "paces", False)),
        "priority": None if priority is None else whole("priority", priority, 1, 99),
        "core": None if core is None else whole("core", core, 0, 1 << 20),
        "limits": None if limits is None else dict(limits),
    }
    loop = _core.DriveLoop(robot, law, options)
    if command == "torque":
        _suits(robot, loop)
    if obstacles is not None:
        loop.set_obstacles(tuple(obstacles), 0.0)
    if x_ref is not None:
        loop.set_target(x_ref)
    recorder = None if record_to is None else StreamRecorder(record_to, dimension=loop.dimension)
    return Drive(robot, loop, options["rate"], recorder)  # type: ignore[arg-type]


def _kind(robot: object) -> CommandKind:
    """What it takes; first of all whether it is a robot."""
    for name in ("read", "write"):
        if not callable(getattr(robot, name, None)):
            given_type = type(robot).__name__
            raise InputTypeError(f"robot: expected an object with read() and write(), not a {given_type}")
    given = getattr(robot, "command", "torque")
    kinds: tuple[CommandKind, ...] = get_args(CommandKind)
    for kind in kinds:
        if given == kind:
            return kind
    raise InputError(f"robot.command: must be one of {', '.join(kinds)}, got {given!r}")


def _scenario(robot: object, given: object) -> Scenario:
    """The scenario, with what the robot takes where it does not say."""
    if (isinstance(given, Mapping) and "arm" not in given) or not isinstance(given, (*_LIKE, Mapping)):
        raise InputTypeError(f"controller: expected a Controller or a scenario, not a {type(given).__name__}")
    scenario = prepare(given)
    takes = getattr(robot, "gravity", "controller") == "robot" or hasattr(robot, "torque_rate")
    if takes and "command" not in scenario.to_dict().get("controller", {}):
        scenario = prepare(scenario, {"controller.command": "of the robot"})
    return scenario


def _suits(robot: object, loop: _core.DriveLoop) -> None:
    """Refuse a controller that would add a weight twice, or change torques too fast."""
    theirs = getattr(robot, "gravity", "controller")
    if loop.gravity != theirs:
        raise InputError(
            f"controller: its command.gravity is {loop.gravity!r}, the robot's is {theirs!r}: one of them, "
            f'and only one, adds the torque against gravity; give it command={{"gravity": "{theirs}"}}'
        )
    most, rate = getattr(robot, "torque_rate", None), loop.torque_rate
    if most is not None and (rate is None or rate > most):
        given = "none" if rate is None else f"{rate:g} N·m/s"
        raise InputError(
            f"controller: its command.torque_rate is {given}, the robot allows {most:g} N·m/s; "
            f'give the controller command={{"torque_rate": {most:g}}}'
        )
