"""Universal Robots' arms (e-Series) by ur_rtde, with torques, positions or velocities.

**This has not been run on hardware, nor on URSim.** It is type-checked against stubs made of ur_rtde 1.6.5,
and exercised against a stand-in with the same methods. Before the first motion, with a hand on the stop
button:

1. Read states without a drive: `URRobot.positions` must be where the arm is.
2. Compare the model with the robot's: `vffnull.robots.checks` with `mass_matrix` of this class, which is the
   robot's own. Payload, centre of gravity and mounting in the installation must be those of your model.
3. Drive with ``field=vff.Field.khatib(0.0, 0.3)``, no obstacle and no target: the arm has to stay where it
   is. Begin with ``command="velocity"`` at low limits; the robot keeps its own limits of safety in every
   mode.
4. End that drive, and look at `vffnull.DriveReport`: missed periods, and why it ended.

What is known of the interface: states and commands go at 500 Hz, so drive at ``rate=500``. ``directTorque``
needs PolyScope 5.23 or later, and some features of it 5.26; the robot always adds gravity, and returns to
holding its position when a torque does not come in time. ``servoJ`` follows positions with a gain and a
look-ahead of its own, ``speedJ`` velocities with an acceleration.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from vffnull._arguments import within
from vffnull._extras import extra
from vffnull.errors import InputError

if TYPE_CHECKING:
    import rtde_control
    import rtde_receive
    from numpy.typing import NDArray

    from vffnull.robots.protocol import CommandKind, State

    Array = NDArray[np.float64]

__all__ = ["URRobot"]

_JOINTS = 6


class URRobot:
    """An arm of Universal Robots.

    Parameters
    ----------
    robot : str or pair of interfaces
        Its address, or your own ``RTDEControlInterface`` and ``RTDEReceiveInterface``.
    command : {"torque", "position", "velocity"}, optional
        By ``directTorque``, ``servoJ`` or ``speedJ``.
    frequency : float, optional
        States and commands per second [Hz]: the `rate` of the drive.
    lookahead, gain : float, optional
        Of ``servoJ``: 0.03 to 0.2 s, 100 to 2000.
    acceleration : float, optional
        Of ``speedJ`` [rad/s²].

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
        robot: str | tuple[rtde_control.RTDEControlInterface, rtde_receive.RTDEReceiveInterface],
        *,
        command: CommandKind = "torque",
        frequency: float = 500.0,
        lookahead: float = 0.1,
        gain: float = 300.0,
        acceleration: float = 5.0,
    ) -> None:
        writers: dict[str, Callable[[list[float]], bool]] = {
            "torque": self._torques,
            "position": self._positions,
            "velocity": self._velocities,
        }
        if command not in writers:
            raise InputError(f"command: must be one of {', '.join(writers)}, got {command!r}")
        self.command: CommandKind = command
        self._writer = writers[command]
        self._period = 1.0 / within("frequency", frequency, 1.0, 500.0)
        self._lookahead = within("lookahead", lookahead, 0.03, 0.2)
        self._gain = within("gain", gain, 100.0, 2000.0)
        self._acceleration = within("acceleration", acceleration, 0.0, 40.0)
        if isinstance(robot, str):
            control, receive = extra("rtde_control", "ur"), extra("rtde_receive", "ur")
            self._control: rtde_control.RTDEControlInterface = control.RTDEControlInterface(robot, frequency)
            self._receive: rtde_receive.RTDEReceiveInterface = receive.RTDEReceiveInterface(robot, frequency)
        else:
            self._control, self._receive = robot

    def read(self) -> State:
        """Time since the robot's start, positions, velocities; a stop of its own is an error."""
        receive = self._receive
        if not receive.isConnected():
            raise RuntimeError("the connection is lost")
        if receive.isEmergencyStopped():
            raise RuntimeError("the robot has an emergency stop")
        if receive.isProtectiveStopped():
            raise RuntimeError("the robot has a protective stop")
        return receive.getTimestamp(), receive.getActualQ(), receive.getActualQd()

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
        return self._control.directTorque(command)

    def _positions(self, command: list[float]) -> bool:
        # The second and the third number are not used, says ur_rtde.
        return self._control.servoJ(command, 0.0, 0.0, self._period, self._lookahead, self._gain)

    def _velocities(self, command: list[float]) -> bool:
        return self._control.speedJ(command, self._acceleration, self._period)
