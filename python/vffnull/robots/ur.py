"""Universal Robots' arms (e-Series) by ur_rtde, with torques, positions or velocities.

**This has not been run on hardware, nor on URSim.** It is type-checked against stubs made of ur_rtde 1.6.5,
and runs against an emulator of the interface with its rules, `vffnull.robots.emulated`. Before the first
motion, with a hand on the stop button:

1. Read states without a drive: `URRobot.positions` must be where the arm is.
2. Compare the model with the robot's: `vffnull.robots.checks` with `mass_matrix` of this class, which is the
   robot's own. Payload, centre of gravity (`URRobot.set_load`) and mounting in the installation must be
   those of your model.
3. Drive with ``field=vff.Field.khatib(0.0, 0.3)``, no obstacle and no target: the arm has to stay where it
   is. Begin with ``command="velocity"`` at low limits; the robot keeps its own limits of safety in every
   mode.
4. End that drive, and look at `vffnull.DriveReport`: missed periods, and why it ended.

What is known of the interface: states and commands go at 500 Hz, so drive at ``rate=500``. ``directTorque``
needs PolyScope 5.23 or later, and 5.26 by the program that ur_rtde 1.6.5 puts on the robot; the robot
always adds gravity, and returns to holding its position in a step in which no torque comes. It compensates
friction by two scales for every joint; that program reads those that are sent, but passes on variables of
other names, which are 0: measure whether your version compensates anything. ``servoJ`` follows positions
with a gain and a look-ahead of its own, ``speedJ`` velocities with an acceleration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, cast

import numpy as np

from vffnull._support.arguments import array, positive, within
from vffnull._support.errors import InputError
from vffnull._support.extras import extra

if TYPE_CHECKING:
    import rtde_control
    import rtde_receive
    from numpy.typing import ArrayLike, NDArray

    from vffnull.model.robot import CommandKind, State
    from vffnull.robots.emulated import ur as emulated

    Array = NDArray[np.float64]

__all__ = ["URRobot"]

_JOINTS = 6
_TRIES = 5  # at a state of one instant

# Bits of the safety status in which a robot takes no commands, as ur_rtde's documentation names them.
_STOPS = (
    (1 << 2, "has a protective stop"),
    (1 << 4, "has a safeguard stop"),
    (1 << 5 | 1 << 6 | 1 << 7, "has an emergency stop"),
    (1 << 8, "has violated a safety limit"),
    (1 << 9, "has a fault"),
    (1 << 10, "is stopped due to safety"),
)


class URRobot:
    """An arm of Universal Robots.

    Parameters
    ----------
    robot : str, pair of interfaces, or vffnull.robots.emulated.ur.Robot
        Its address, or your own ``RTDEControlInterface`` and ``RTDEReceiveInterface``; or an emulated one.
    command : {"torque", "position", "velocity"}, optional
        By ``directTorque``, ``servoJ`` or ``speedJ``.
    frequency : float, optional
        States and commands per second [Hz]: the `rate` of the drive.
    lookahead, gain : float, optional
        Of ``servoJ``: 0.03 to 0.2 s, 100 to 2000.
    acceleration : float, optional
        Of ``speedJ`` [rad/s²].
    viscous_scale, coulomb_scale : float or (6,) array_like, optional
        Shares of the friction that the robot compensates under ``directTorque``, in [0, 1].
    watchdog : float, optional
        Let the robot's program end where no command comes for longer than 1 / `watchdog` [Hz]. Every command
        counts: nothing else has to kick it.

    Raises
    ------
    vffnull.errors.InputError
        If a number is out of these ranges.
    ImportError
        Without ur_rtde: ``vffnull[ur]``.
    RuntimeError
        If there is no connection: an exception of ur_rtde.

    Notes
    -----
    Not run on hardware; the module says what to check first.

    Examples
    --------
    >>> robot = URRobot("192.168.1.2", command="torque")  # doctest: +SKIP
    >>> controller = vff.Controller(arm, {"command": {"gravity": "robot"}})  # doctest: +SKIP
    >>> with vff.drive(robot, controller, rate=500.0) as drive:  # doctest: +SKIP
    ...     drive.wait(10.0)
    """

    gravity = "robot"

    def __init__(
        self,
        robot: str
        | tuple[rtde_control.RTDEControlInterface, rtde_receive.RTDEReceiveInterface]
        | emulated.Robot,
        *,
        command: CommandKind = "torque",
        frequency: float = 500.0,
        lookahead: float = 0.1,
        gain: float = 300.0,
        acceleration: float = 5.0,
        viscous_scale: ArrayLike = (0.9, 0.9, 0.8, 0.9, 0.9, 0.9),
        coulomb_scale: ArrayLike = (0.8, 0.8, 0.7, 0.8, 0.8, 0.8),
        watchdog: float | None = None,
    ) -> None:
        writers: dict[str, Callable[[list[float]], bool]] = {
            "torque": self._torques,
            "position": self._positions,
            "velocity": self._velocities,
        }
        if command not in writers:
            raise InputError(f"command: must be one of {', '.join(writers)}, got {command!r}")
        if command != "torque" and not isinstance(robot, str | tuple):
            raise InputError(f"command: an emulated robot takes torques alone, got {command!r}")
        self.command: CommandKind = command
        self._writer = writers[command]
        self._period = 1.0 / within("frequency", frequency, 1.0, 500.0)
        self._lookahead = within("lookahead", lookahead, 0.03, 0.2)
        self._gain = within("gain", gain, 100.0, 2000.0)
        self._acceleration = within("acceleration", acceleration, 0.0, 40.0)
        self._viscous = _shares("viscous_scale", viscous_scale)
        self._coulomb = _shares("coulomb_scale", coulomb_scale)
        self._watchdog = None if watchdog is None else positive("watchdog", watchdog)
        if isinstance(robot, str):
            control, receive = extra("rtde_control", "ur"), extra("rtde_receive", "ur")
            self._control: rtde_control.RTDEControlInterface = control.RTDEControlInterface(robot, frequency)
            self._receive: rtde_receive.RTDEReceiveInterface = receive.RTDEReceiveInterface(robot, frequency)
        elif isinstance(robot, tuple):
            self._control, self._receive = robot
        else:
            self._control = cast("rtde_control.RTDEControlInterface", robot)
            self._receive = cast("rtde_receive.RTDEReceiveInterface", robot)

    def begin(self) -> None:
        """Set the watchdog."""
        if self._watchdog is not None and not self._control.setWatchdog(self._watchdog):
            raise RuntimeError("the robot did not take the watchdog")

    def read(self) -> State:
        """Time since the robot's start, positions, velocities, of one instant; its own stop is an error."""
        receive = self._receive
        if not receive.isConnected():
            raise RuntimeError("the connection is lost")
        status = receive.getSafetyStatusBits()
        for bits, what in _STOPS:
            if status & bits:
                raise RuntimeError(f"the robot {what}")
        before = receive.getTimestamp()
        for _ in range(_TRIES):  # another state may arrive in between
            q, dq, after = receive.getActualQ(), receive.getActualQd(), receive.getTimestamp()
            if after == before:
                break
            before = after
        return before, q, dq

    def write(self, command: Array, /) -> None:
        """Send a command (6,), of the kind that `command` says."""
        if not self._writer(command.tolist()):
            raise RuntimeError(f"the robot did not take a {self.command}; is its program running?")

    def end(self) -> None:
        """End the mode of control. The robot brakes, and holds its position."""
        control = self._control
        try:
            if self.command == "position":
                control.servoStop()
            elif self.command == "velocity":
                control.speedStop()
        finally:
            control.stopScript()

    def set_load(self, mass: float, com: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Tell the robot what it carries, which it then holds against gravity.

        The controller's arm must carry it, too.

        Parameters
        ----------
        mass : float
            Its mass [kg].
        com : (3,) array_like, optional
            Its centre in the frame of the tool flange [m].

        Raises
        ------
        vffnull.errors.InputError
            If a number makes no sense.
        """
        place = array("com", com, (3,)).tolist()
        if not self._control.setPayload(within("mass", mass, 0.0, 100.0), place):
            raise RuntimeError("the robot did not take the load")

    def recover(self) -> None:
        """Put the program back onto the robot, after its stop was looked into and unlocked at the pendant."""
        if not (self._receive.isConnected() or self._control.reconnect()):
            raise RuntimeError("the connection is lost")
        if not (self._control.isProgramRunning() or self._control.reuploadScript()):
            raise RuntimeError("the robot did not take the program; is its stop unlocked?")

    def positions(self) -> Array:
        """Where its joints are (6,) [rad]."""
        return np.asarray(self._receive.getActualQ(), dtype=np.float64)

    def mass_matrix(self) -> Array:
        """The mass matrix (6, 6) [kg·m²], by the robot's own model, where the arm is; takes some
        milliseconds.
        """
        values = np.asarray(self._control.getMassMatrix(), dtype=np.float64)
        return values.reshape(_JOINTS, _JOINTS)

    def _torques(self, command: list[float]) -> bool:
        return self._control.directTorque(command, self._viscous, self._coulomb)

    def _positions(self, command: list[float]) -> bool:
        # The second and the third number are not used, says ur_rtde.
        return self._control.servoJ(command, 0.0, 0.0, self._period, self._lookahead, self._gain)

    def _velocities(self, command: list[float]) -> bool:
        return self._control.speedJ(command, self._acceleration, self._period)


def _shares(name: str, given: ArrayLike) -> list[float]:
    """One share for each joint."""
    found = array(name, np.broadcast_to(given, (_JOINTS,)) if np.ndim(given) == 0 else given, (_JOINTS,))
    if not ((found >= 0.0) & (found <= 1.0)).all():
        raise InputError(f"{name}: must be from 0 to 1")
    return found.tolist()  # type: ignore[no-any-return]
