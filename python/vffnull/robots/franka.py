"""Franka's arms (Panda, FR3) by pylibfranka, with joint torques.

**This has not been run on hardware.** It is type-checked against the stubs of pylibfranka 0.21, and runs
against an emulator of the interface with its rules, `vffnull.robots.emulated`. Before the first motion,
with a hand on the stop button:

1. Read states without a drive: `FrankaRobot.positions` must be where the arm is.
2. Compare the model with the robot's: `vffnull.robots.checks` with `gravity_torque` and `mass_matrix` of
   this class, which are Franka's own. The arm, its hand and its load must be the same in all of them:
   `FrankaRobot.set_load`, Desk, your URDF.
3. Set thresholds of collision, `FrankaRobot.set_collision_behavior`: low ones at first.
4. Drive with ``field=vff.Field.khatib(0.0, 0.3)``, no obstacle and no target: the arm has to stay where it
   is.
5. End that drive, and look at `vffnull.DriveReport`: missed periods, and why it ended.

What is known of the interface: a torque that is sent goes without gravity and friction, which the robot
adds; it may change by 1000 N·m/s against the torque that the robot has used last, which is not the one that
was sent last where a packet was lost: `FrankaRobot.write` keeps to that as libfranka's own ``limitRate``
does. A new torque has to come within a millisecond of each state, and when 20 in a row do not, the robot
stops. After a reflex the robot takes no motion until `FrankaRobot.recover`. ``readOnce`` of pylibfranka
waits with Python's lock held: other threads of Python run between two periods only, and one of them that
computes delays the loop. ``sys.setswitchinterval(1e-4)`` makes such delays shorter; a program in C++
(docs/c.md) does not have them.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from vffnull._support.arguments import array, within
from vffnull._support.errors import InputError
from vffnull._support.extras import extra

if TYPE_CHECKING:
    import pylibfranka
    from numpy.typing import ArrayLike, NDArray

    from vffnull.model.robot import CommandKind, State
    from vffnull.robots.emulated import franka as emulated

    Array = NDArray[np.float64]

__all__ = ["FrankaRobot"]

_JOINTS = 7
_PERIOD = 1e-3  # s
_RATE = 1000.0 - 1e-3  # N·m/s: kMaxTorqueRate of libfranka's rate_limiting.h


class FrankaRobot:
    """A Franka arm that takes joint torques.

    Parameters
    ----------
    robot : str, pylibfranka.Robot, or vffnull.robots.emulated.franka.Robot
        Its address, or a connection of yours, with the thresholds, frames and loads that you have set; or
        an emulated one.
    enforce : bool, optional
        Whether a connection to an address needs a real-time kernel and priority (``RealtimeConfig``).

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
    >>> settings = {"task": "pose", "stiffness": 400.0, "damping": 40.0, "command": "of the robot"}
    >>> controller = vff.Controller(vff.Arm.named("fr3"), settings)  # doctest: +SKIP
    >>> with vff.drive(robot, controller) as drive:  # doctest: +SKIP
    ...     drive.wait(10.0)
    """

    command: CommandKind = "torque"
    paces = True
    gravity = "robot"
    torque_rate = 1000.0

    def __init__(self, robot: str | pylibfranka.Robot | emulated.Robot, *, enforce: bool = True) -> None:
        if isinstance(robot, str):
            library = extra("pylibfranka", "franka")
            config = library.RealtimeConfig
            self._robot: pylibfranka.Robot = library.Robot(
                robot, config.kEnforce if enforce else config.kIgnore
            )
        else:
            self._robot = cast("pylibfranka.Robot", robot)
        self._library: Any = sys.modules[type(self._robot).__module__]  # pylibfranka, or what stands for it
        self._control: pylibfranka.ActiveControlBase | None = None
        self._state: pylibfranka.RobotState | None = None

    def begin(self) -> None:
        """Begin to control torques."""
        self._control, self._state = self._robot.start_torque_control(), None

    def read(self) -> State:
        """Wait for the next state: time, positions, velocities."""
        state, _ = self._controlled().readOnce()
        self._state = state
        return state.time.to_sec(), state.q, state.dq

    def torque(self) -> Array:
        """The torque that was commanded last, without gravity (7,) [N·m]."""
        return np.asarray(self._last().tau_J_d, dtype=np.float64)

    def write(self, command: Array, /) -> None:
        """Send a torque (7,) [N·m], without gravity, as near as the rate allows from what was used last."""
        control, most = self._controlled(), _RATE * _PERIOD
        used = [0.0] * _JOINTS if self._state is None else self._state.tau_J_d
        pairs = zip(command.tolist(), used, strict=True)
        near = [min(max(tau, last - most), last + most) for tau, last in pairs]
        control.writeOnce(self._library.Torques(near))

    def end(self) -> None:
        """End the motion. The robot brakes, and holds its position."""
        control, self._control = self._control, None
        if control is None:
            return
        try:
            state, _ = control.readOnce()  # there is one command for each state
            finish = self._library.Torques(list(state.tau_J_d))
            finish.motion_finished = True
            control.writeOnce(finish)
        except Exception:
            self._robot.stop()
            raise

    def external_torque(self) -> Array:
        """The torque that acts on the arm from outside, as the robot estimates and filters it, at the last
        state (7,) [N·m].

        It is the opposite of ``tau_ext_hat_filtered``, which is what the robot exerts beyond its model: what
        it exerts on the world is positive there (libfranka, ``robot_state.h``).
        """
        return -np.asarray(self._last().tau_ext_hat_filtered, dtype=np.float64)

    def set_collision_behavior(
        self,
        torque: ArrayLike,
        force: ArrayLike,
        contact_torque: ArrayLike | None = None,
        contact_force: ArrayLike | None = None,
    ) -> None:
        """Set what ends a motion as a collision, and what is shown as a contact; while nothing drives it.

        Parameters
        ----------
        torque : float or (7,) array_like
            External torque of the joints that is a collision [N·m].
        force : float or (6,) array_like
            External force and torque at the hand that is one [N, N·m].
        contact_torque, contact_force : float or array_like, optional
            What is a contact; by default the same.

        Raises
        ------
        vffnull.errors.InputError
            If a number is not positive, or it is being driven.
        """
        self._rests()
        upper = _thresholds("torque", torque, _JOINTS), _thresholds("force", force, 6)
        lower = (
            upper[0] if contact_torque is None else _thresholds("contact_torque", contact_torque, _JOINTS),
            upper[1] if contact_force is None else _thresholds("contact_force", contact_force, 6),
        )
        self._robot.set_collision_behavior(lower[0], upper[0], lower[1], upper[1])

    def set_load(
        self, mass: float, com: ArrayLike = (0.0, 0.0, 0.0), inertia: ArrayLike | None = None
    ) -> None:
        """Tell the robot what it carries beyond its hand; while nothing drives it.

        The robot then carries its weight. The controller's arm must carry it, too.

        Parameters
        ----------
        mass : float
            Its mass [kg].
        com : (3,) array_like, optional
            Its centre in the frame of the flange [m].
        inertia : (3, 3) array_like, optional
            Its inertia about that [kg·m²]; none by default.

        Raises
        ------
        vffnull.errors.InputError
            If a number makes no sense, or it is being driven.
        """
        self._rests()
        about = np.zeros((3, 3)) if inertia is None else array("inertia", inertia, (3, 3))
        column = about.T.ravel().tolist()
        self._robot.set_load(within("mass", mass, 0.0, 100.0), array("com", com, (3,)).tolist(), column)

    def recover(self) -> None:
        """Clear a reflex, after which the robot takes no motion; look for its reason first."""
        self._rests()
        self._robot.automatic_error_recovery()

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

    def _last(self) -> pylibfranka.RobotState:
        if self._state is None:
            raise InputError("robot: read a state first")
        return self._state

    def _idle(self) -> pylibfranka.RobotState:
        self._rests()
        return self._robot.read_once()

    def _rests(self) -> None:
        if self._control is not None:
            raise InputError("robot: is being driven")


def _thresholds(name: str, given: ArrayLike, count: int) -> list[float]:
    """One number for each, all positive."""
    found = array(name, np.broadcast_to(given, (count,)) if np.ndim(given) == 0 else given, (count,))
    if not (found > 0.0).all():
        raise InputError(f"{name}: must be greater than 0")
    return found.tolist()  # type: ignore[no-any-return]
