"""An arm of Universal Robots (e-Series) as ur_rtde shows it, for joint torques, and the rules behind it.

`Robot` stands for both ``RTDEControlInterface`` and ``RTDEReceiveInterface``. Time is the robot's: one step
of 2 ms passes when a torque is sent.

Rules and their sources:

- Script manual, ``direct_torque`` (universal-robots.com/manuals/EN/HTML/SW5_25_1, *all_scripts*): torques at
  500 Hz, without gravity, which the robot adds; friction is compensated by scales; a step without a torque
  is one of position control; whoever sends torques keeps the robot within its safety limits, and a limit
  that is broken is a violation.
- Universal_Robots_Client_Library, *Direct torque control mode* (doc/architecture/reverse_interface.rst): a
  fault where joints or the tool are faster than the safety settings allow.
- Ranges, speeds and largest torques of the joints: ``config/*/joint_limits.yaml`` of
  Universal_Robots_ROS2_Description, which the bundled arms have.
- ur_rtde 1.6.5, ``setWatchdog``: its program on the robot ends where no command has come for
  1 / ``min_frequency``.

Ours are: the limit of the tool's speed, which is a matter of the safety configuration; that a torque beyond
the largest one is a stop, of which nothing is said; how firmly a step of position control holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from vffnull._support.arguments import positive, within
from vffnull._support.errors import InputError
from vffnull.model.arm import frame
from vffnull.model.scenario import ScenarioLike, prepare
from vffnull.robots.emulated.body import Body, Disturbances, Physics
from vffnull.robots.emulated.reflex import Margin, Monitor, Reflex, Rule

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["Robot"]

RATE = 500.0
"""Steps per second [Hz]."""

_JOINTS = 6
_NAMES = (
    *(f"{joint}_joint" for joint in ("shoulder_pan", "shoulder_lift", "elbow")),
    *(f"wrist_{k}_joint" for k in (1, 2, 3)),
)
_VISCOUS, _COULOMB = (0.9, 0.9, 0.8, 0.9, 0.9, 0.9), (0.8, 0.8, 0.7, 0.8, 0.8, 0.8)
_NORMAL, _VIOLATION, _STOPPED = 1 << 0, 1 << 8, 1 << 10  # bits of the safety status

_LIMITS = "https://github.com/UniversalRobots/Universal_Robots_ROS2_Description, config/*/joint_limits.yaml"
_CLIENT = "https://github.com/UniversalRobots/Universal_Robots_Client_Library, reverse_interface.rst"
_RTDE = "https://sdurobotics.gitlab.io/ur_rtde/, setWatchdog"

# Where the values of a step stand that rules are about, in the order of `_rules`.
_TORQUES, _SPEEDS, _PLACES, _TOOL, _SILENT = slice(0, 6), slice(6, 12), slice(12, 18), 18, 19


class Robot:
    """An emulated arm of Universal Robots, with the methods of ur_rtde that torques need.

    Parameters
    ----------
    scenario : Scenario, dict, str or path
        The arm, which must be ``ur5e`` or ``ur10e``, its start, and the obstacles around it.
    disturbances : Disturbances, optional
        What is not as the model says; a packet that is lost is a step without a torque.
    physics : {"own", "mujoco"}, optional
        Whose dynamics move the arm.
    tool_speed : float, optional
        The limit of the tool's speed in the safety configuration [m/s].

    Attributes
    ----------
    body : Body
        The arm itself, with its true state.
    reflex : Reflex or None
        The rule that has ended the program, if one has.
    left : int
        Steps of position control, because no torque came.
    before_state : callable, optional
        Gets this robot before every state, in the thread of the loop.

    Raises
    ------
    vffnull.errors.InputError
        If the arm is another one, or a number makes no sense.

    Examples
    --------
    >>> from vffnull.robots.emulated.ur import Robot
    >>> robot = Robot("ur5e-sweep")
    >>> robot.directTorque([0.0] * 6)
    True
    >>> robot.directTorque([0.0, 500.0, 0.0, 0.0, 0.0, 0.0])
    False
    >>> robot.reflex.rule.name
    'joint_torque'
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        disturbances: Disturbances | None = None,
        physics: Physics = "own",
        tool_speed: float = 1.5,
    ) -> None:
        given = prepare(scenario)
        arm = given.arm
        limits = arm.torque_limits, arm.velocity_limits, arm.joint_limits
        if tuple(arm.joint_names) != _NAMES or any(limit is None for limit in limits):
            raise InputError(
                "scenario: its arm must be the bundled ur5e or ur10e, whose interface is emulated"
            )
        self.body = body = Body(given, RATE, disturbances or Disturbances(), physics)
        torques, speeds, ranges = (np.asarray(limit) for limit in limits)
        self._middle = ranges.mean(axis=1)
        self._values, self._limits = np.zeros((2, _SILENT + 1))
        self._limits[_TORQUES], self._limits[_SPEEDS] = torques, speeds
        self._limits[_PLACES] = 0.5 * (ranges[:, 1] - ranges[:, 0])
        self._limits[_TOOL] = positive("tool_speed", tool_speed)
        self._limits[_SILENT] = np.inf
        self._monitor = Monitor(_rules(body.names))
        self.reflex: Reflex | None = None
        self.left = 0
        self.before_state: Callable[[Robot], object] | None = None
        self._silent = 0
        self._runs = True
        self._payload: tuple[float, list[float]] = (0.0, [0.0, 0.0, 0.0])
        self._moment = np.zeros(_JOINTS)

    def margins(self) -> tuple[Margin, ...]:
        """The nearest that each limit came."""
        return self._monitor.margins()

    # RTDEControlInterface

    def directTorque(
        self,
        torque: Sequence[float],
        viscous_scale: Sequence[float] = _VISCOUS,
        coulomb_scale: Sequence[float] = _COULOMB,
    ) -> bool:
        """Joint torques for one step (6,) [N·m], without gravity; whether the program runs."""
        if not self._runs:
            return False
        body = self.body
        if body.is_lost():
            self._silent += 1
            self.left += 1
            body.hold()
        else:
            self._silent = 0
            self._moment = np.array(torque) + self.body.known.gravity_torque(body.q)
            body.move(self._moment + body.friction(np.array(viscous_scale), np.array(coulomb_scale)))
        self._judge()
        return self._runs

    def setWatchdog(self, min_frequency: float = 10.0) -> bool:
        """End the program where no command comes for longer than 1 / `min_frequency` [Hz]."""
        self._limits[_SILENT] = 1.0 / positive("min_frequency", min_frequency)
        return True

    def setPayload(self, arg0: float, arg1: Sequence[float]) -> bool:
        """Tell the robot of a payload: its mass [kg], and its centre from the tool flange (3,) [m]."""
        mass, com = within("mass", arg0, 0.0, 100.0), [float(x) for x in arg1]
        self._payload = (mass, com)
        tool = frame(self.body.model.to_dict()["tool"])  # from the flange, the frame of the last link
        self.body.known = self.body.model.with_load(mass, tool[:3, :3].T @ (np.array(com) - tool[:3, 3]))
        return True

    def getMassMatrix(
        self, q: Sequence[float] | None = None, include_rotors_inertia: bool = False
    ) -> list[float]:
        """The robot's own mass matrix (36,) [kg·m²]."""
        return self.body.known.mass_matrix(q or self.body.q).ravel().tolist()

    def isProgramRunning(self) -> bool:
        """Whether the program on the robot runs, which takes commands."""
        return self._runs

    def reuploadScript(self) -> bool:
        """Start the program anew; a violation is over then, as if it had been cleared at the pendant."""
        self._runs, self.reflex, self._silent = True, None, 0
        return True

    def reconnect(self) -> bool:
        """The connection is never lost."""
        return True

    def stopScript(self) -> None:
        """End the program: the robot holds where it is."""
        self._runs = False
        self.body.brake()

    # RTDEReceiveInterface

    def isConnected(self) -> bool:
        """The connection is never lost."""
        return True

    def getTimestamp(self) -> float:
        """Time of the robot [s]."""
        if self.before_state is not None and self._runs:
            self.before_state(self)
        return self.body.t

    def getActualQ(self) -> list[float]:
        """Positions (6,) [rad]."""
        return self.body.measure()[0].tolist()  # type: ignore[no-any-return]

    def getActualQd(self) -> list[float]:
        """Velocities (6,) [rad/s]."""
        return self.body.measure()[1].tolist()  # type: ignore[no-any-return]

    def getSafetyStatusBits(self) -> int:
        """1 if it is normal, 256 after a violation; the other bits are not emulated."""
        return _NORMAL if self.reflex is None else _VIOLATION | _STOPPED

    def getTargetMoment(self) -> list[float]:
        """Torques that the robot exerts, with gravity (6,) [N·m]."""
        return self._moment.tolist()

    def getPayload(self) -> float:
        """Mass of the payload that was set [kg]."""
        return self._payload[0]

    def getPayloadCog(self) -> list[float]:
        """Its centre (3,) [m]."""
        return self._payload[1]

    # Inside

    def _judge(self) -> None:
        body, values = self.body, self._values
        values[_TORQUES], values[_SPEEDS] = self._moment, body.dq
        values[_PLACES] = body.q - self._middle
        values[_TOOL] = math.hypot(*(body.model.jacobian(body.q)[:3] @ body.dq))
        values[_SILENT] = self._silent * body.period
        reflex = self._monitor.check(values, self._limits, body.cycle, body.t)
        if reflex is not None:
            self.reflex, self._runs = reflex, False
            body.brake()


def _rules(joints: tuple[str, ...]) -> tuple[Rule, ...]:
    return (
        Rule("joint_torque", "the torque", "N·m", joints, _LIMITS),
        Rule("joint_speed", "the speed", "rad/s", joints, _CLIENT),
        Rule("joint_position", "the angle from mid-range", "rad", joints, _LIMITS),
        Rule("tool_speed", "the speed of the tool", "m/s", ("",), _CLIENT),
        Rule("watchdog", "the time without a command", "s", ("",), _RTDE),
    )
