"""Franka's arms (Panda, FR3) by pylibfranka, with joint torques.

**This has not been run on hardware.** It is type-checked against the stubs of pylibfranka 0.21, and exercised
against a stand-in with the same methods. Before the first motion, with a hand on the stop button:

1. Read states without a drive: `FrankaRobot.positions` must be where the arm is.
2. Compare the model with the robot's: `vffnull.robots.checks` with `gravity_torque` and `mass_matrix` of
   this class, which are Franka's own. The arm, its hand and its load must be the same in all of them:
   ``set_load``, Desk, your URDF.
3. Set thresholds of collision, ``set_collision_behavior`` of your connection: low ones at first.
4. Drive with ``field=vff.Field.khatib(0.0, 0.3)``, no obstacle and no target: the arm has to stay where it
   is.
5. End that drive, and look at `vffnull.DriveReport`: missed periods, and why it ended.

What is known of the interface: a torque that is sent goes without gravity and friction, which the robot
adds; it may change by 1000 N·m/s; a new one has to come within a millisecond of each state, and when many do
not, the robot stops. ``readOnce`` of pylibfranka waits with Python's lock held: other threads of Python run
between two periods only, and one of them that computes delays the loop. ``sys.setswitchinterval(1e-4)``
makes such delays shorter; a program in C++ (docs/c.md) does not have them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from vffnull._extras import extra
from vffnull.errors import InputError

if TYPE_CHECKING:
    import pylibfranka
    from numpy.typing import NDArray

    from vffnull.robots.protocol import CommandKind, State

    Array = NDArray[np.float64]

__all__ = ["FrankaRobot"]

_JOINTS = 7


class FrankaRobot:
    """A Franka arm that takes joint torques.

    Parameters
    ----------
    robot : str or pylibfranka.Robot
        Its address, or a connection of yours, with the thresholds, frames and loads that you have set.

    Raises
    ------
    ImportError
        Without pylibfranka, which has wheels for Linux and Python up to 3.12: ``vffnull[franka]``.
    RuntimeError
        If there is no connection: an exception of pylibfranka.

    Notes
    -----
    Not run on hardware; the module says what to check first.

    Examples
    --------
    >>> robot = FrankaRobot("172.16.0.2")  # doctest: +SKIP
    >>> command = {"gravity": "robot", "torque_rate": 1000.0}
    >>> controller = vff.Controller(arm, {"task": "pose", "command": command})  # doctest: +SKIP
    >>> with vff.drive(robot, controller) as drive:  # doctest: +SKIP
    ...     drive.wait(10.0)
    """

    command: CommandKind = "torque"
    paces = True
    gravity = "robot"
    torque_rate = 1000.0

    def __init__(self, robot: str | pylibfranka.Robot) -> None:
        self._library = extra("pylibfranka", "franka")
        self._robot: pylibfranka.Robot = self._library.Robot(robot) if isinstance(robot, str) else robot
        self._control: pylibfranka.ActiveControlBase | None = None
        self._state: pylibfranka.RobotState | None = None

    def begin(self) -> None:
        """Begin to control torques."""
        self._control = self._robot.start_torque_control()

    def read(self) -> State:
        """Wait for the next state: time, positions, velocities."""
        state, _ = self._controlled().readOnce()
        self._state = state
        return state.time.to_sec(), state.q, state.dq

    def torque(self) -> Array:
        """The torque that was commanded last, without gravity (7,) [N·m]."""
        if self._state is None:
            raise InputError("torque: read a state first")
        return np.asarray(self._state.tau_J_d, dtype=np.float64)

    def write(self, command: Array, /) -> None:
        """Send a torque (7,) [N·m], without gravity."""
        self._controlled().writeOnce(self._library.Torques(command.tolist()))

    def end(self) -> None:
        """End the motion. The robot brakes, and holds its position."""
        control, self._control = self._control, None
        if control is None:
            return
        finish = self._library.Torques([0.0] * _JOINTS)
        finish.motion_finished = True
        try:
            control.readOnce()  # there is one command for each state
            control.writeOnce(finish)
        except Exception:
            self._robot.stop()
            raise

    def positions(self) -> Array:
        """Where its joints are (7,) [rad], while nothing drives it."""
        return np.asarray(self._idle().q, dtype=np.float64)

    def gravity_torque(self) -> Array:
        """The torque against gravity (7,) [N·m], by Franka's model, where the arm is; while nothing drives
        it.
        """
        state = self._idle()
        return np.asarray(self._robot.load_model().gravity(state), dtype=np.float64)

    def mass_matrix(self) -> Array:
        """The mass matrix (7, 7) [kg·m²], by Franka's model, where the arm is; while nothing drives it."""
        state = self._idle()
        values = np.asarray(self._robot.load_model().mass(state), dtype=np.float64)
        return values.reshape(_JOINTS, _JOINTS)  # symmetric: the same by rows and by columns

    def _controlled(self) -> pylibfranka.ActiveControlBase:
        if self._control is None:
            raise InputError("robot: begin() has to come first; `vffnull.drive` calls it")
        return self._control

    def _idle(self) -> pylibfranka.RobotState:
        if self._control is not None:
            raise InputError("robot: is being driven")
        return self._robot.read_once()
