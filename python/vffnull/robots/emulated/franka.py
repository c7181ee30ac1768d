"""A Franka arm as its interface shows it (FCI): what `pylibfranka` offers for torques, and the rules behind
it.

`Robot` stands where ``pylibfranka.Robot`` would, `Torques` and the exceptions where its own would; a
program for one runs with the other. Time is the robot's: ``readOnce`` does not wait, and a cycle passes
when a torque is sent or a state is asked for anew.

Rules and their sources (libfranka is github.com/frankarobotics/libfranka, at 0.21):

- FCI documentation, *Robot and interface specifications*
  (https://frankarobotics.github.io/docs/control_parameters.html): torque rate, necessary; torques; joint
  ranges and speeds, of FR3 depending on the position, in the words of ``include/franka/rate_limiting.h``;
  speeds of the hand.
- *Minimum system and network requirements* (https://frankarobotics.github.io/docs/requirements.html): less
  than 1 ms for round trip, control and processing; a command that is late is dropped, the torques of the
  last one are used again, and 20 in a row are the end.
- *libfranka*, under the hood and errors (https://frankarobotics.github.io/docs/libfranka.html): the robot
  adds gravity and motor friction; the rate is that against the torque it has used last (``tau_J_d``);
  thresholds of ``setCollisionBehavior`` on the estimated external torque and force end a motion; so do
  speeds and the range of the torque sensors.
- ``include/franka/robot_state.h``: the estimated force at the hand, ``O_F_ext_hat_K``, is 0 near a
  singularity. What is near it leaves open; two Pandas were seen to report 0 where the smallest singular value
  of the Jacobian is below 0.08 (libfranka, issue 76).

What the maker does not publish is not here: the power limit, the instability monitor, the check of
self-collisions, the filters of ``dq``. Ours are: 30 Hz for the filter of the external torque, the torque
range for that of the sensors, the limits of commanded poses for the measured speed of the hand, and the
thresholds of a robot for which none were set, which are those of pylibfranka's examples.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._support.arguments import array, positive, within
from vffnull._support.errors import InputError
from vffnull.model.arm import frame
from vffnull.model.scenario import ScenarioLike, prepare
from vffnull.robots.emulated.body import Body, Disturbances, Physics
from vffnull.robots.emulated.reflex import Margin, Monitor, Reflex, Rule

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from vffnull._core import Arm

    Array = NDArray[np.float64]

__all__ = [
    "CommandException",
    "ControlException",
    "Duration",
    "Errors",
    "RealtimeConfig",
    "Robot",
    "RobotMode",
    "RobotState",
    "Torques",
]

RATE = 1000.0
"""Cycles per second [Hz]."""

_JOINTS = 7
_AXES = ("x", "y", "z")
_TORQUE_RATE = 1000.0  # N·m/s
_MAX_LOST = 20  # packets in a row
_SHARE = 1.0 - np.exp(-2.0 * np.pi * 30.0 / RATE)  # of what is new in the external torque; 30 Hz is ours
_EVERY = 5  # cycles between two looks at the hand: ours
_SINGULAR = 0.08  # the smallest singular value of the Jacobian from which on a force is estimated: issue 76
_FLANGE = 0.107  # m: from the last joint, control_parameters.html
_COMPENSATED = 0.8  # share of the friction: ours
_HAND = {"panda": (1.7, 2.5), "fr3": (3.0, 2.5)}  # m/s, rad/s
_THRESHOLDS = ([20.0] * 7, [40.0] * 7, [10.0] * 6, [20.0] * 6)  # N·m, N·m, N, N

# The speed of FR3 where a joint is: most, offset and factor, then the ends of the range that they count from.
_FR3_SPEED = np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26])
_FR3_OFFSET = np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35])
_FR3_FACTOR = np.array([12.0, 5.17, 7.0, 8.0, 34.0, 11.0, 34.0])
_FR3_UPPER = np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196])
_FR3_LOWER = np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196])

_SPECIFICATIONS = "https://frankarobotics.github.io/docs/control_parameters.html"
_REQUIREMENTS = "https://frankarobotics.github.io/docs/requirements.html"
_ERRORS = "https://frankarobotics.github.io/docs/libfranka.html#errors"


# Where the values of a cycle stand that rules are about, in the order of `_rules`.
_RATES, _TORQUES, _SPEEDS, _PLACES = (slice(k, k + _JOINTS) for k in range(0, 4 * _JOINTS, _JOINTS))
_HANDS, _EXTERNALS, _WRENCH, _LOST = slice(28, 30), slice(30, 37), slice(37, 43), 43


class FrankaException(RuntimeError):  # noqa: N818 (pylibfranka's name)
    """As pylibfranka's."""


class CommandException(FrankaException):
    """As pylibfranka's: a command is not possible in the present mode."""


class ControlException(FrankaException):
    """As pylibfranka's: the motion was ended.

    Attributes
    ----------
    reflex : Reflex or None
        Why; pylibfranka's has the names of the errors in its text alone.
    """

    def __init__(self, text: str, reflex: Reflex | None = None) -> None:
        super().__init__(text)
        self.reflex = reflex


class RobotMode(Enum):
    """What the robot does, as pylibfranka's."""

    Other = 0
    Idle = 1
    Move = 2
    Guiding = 3
    Reflex = 4
    UserStopped = 5
    AutomaticErrorRecovery = 6


class RealtimeConfig(Enum):
    """As pylibfranka's; without a meaning here."""

    kEnforce = 0
    kIgnore = 1


class Duration:
    """A time, as pylibfranka's."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def to_sec(self) -> float:
        """It in seconds."""
        return self._seconds


@dataclass(frozen=True)
class Errors:
    """Which errors there are: those of pylibfranka's that are emulated, by their names."""

    names: frozenset[str] = frozenset()

    def __getattr__(self, name: str) -> bool:
        if name.startswith("_"):
            raise AttributeError(name)
        return name in self.names

    def __bool__(self) -> bool:
        return bool(self.names)

    def __str__(self) -> str:
        return "[" + ", ".join(f'"{name}"' for name in sorted(self.names)) + "]"


class Torques:
    """A command, as pylibfranka's.

    Parameters
    ----------
    tau_J : (7,) sequence of float
        Joint torques without gravity and friction [N·m].
    """

    def __init__(self, tau_J: Sequence[float]) -> None:
        self.tau_J = list(tau_J)
        self.motion_finished = False


class RobotState:
    """What the robot says of itself, as far as it is emulated; names and units are pylibfranka's."""

    def __init__(self, robot: Robot, q: Array, dq: Array) -> None:
        self._robot = robot
        self.time = Duration(robot.body.t)
        self.q, self.dq = q, dq
        self.tau_J_d = robot.tau_J_d
        self.tau_ext_hat_filtered = robot.external
        self.O_F_ext_hat_K = robot.wrench
        self.robot_mode = robot.mode
        self.current_errors, self.last_motion_errors = robot.errors, robot.last_errors
        self._tau_J = robot.tau_J

    @property
    def tau_J(self) -> Array:
        """Measured torque of the joints, gravity included (7,) [N·m]."""
        return self._robot.body.measured_torque(self._tau_J)

    @property
    def O_T_EE(self) -> Array:
        """Pose of the end effector, by columns (16,)."""
        position, orientation = self._robot.body.model.pose(self.q)
        return frame({"position": position, "orientation": orientation}).T.ravel()

    @property
    def control_command_success_rate(self) -> float:
        """Share of the last 100 commands that the robot has received."""
        taken = self._robot.taken
        return sum(taken) / len(taken) if taken else 0.0

    @property
    def joint_contact(self) -> Array:
        """1 where the lower threshold of a joint is passed (7,)."""
        return (np.abs(self.tau_ext_hat_filtered) > self._robot.thresholds[0]).astype(float)

    @property
    def joint_collision(self) -> Array:
        """1 where the upper threshold of a joint is passed (7,)."""
        return (np.abs(self.tau_ext_hat_filtered) > self._robot.thresholds[1]).astype(float)

    @property
    def cartesian_contact(self) -> Array:
        """1 where the lower threshold of an axis is passed (6,)."""
        return (np.abs(self.O_F_ext_hat_K) > self._robot.thresholds[2]).astype(float)

    @property
    def cartesian_collision(self) -> Array:
        """1 where the upper threshold of an axis is passed (6,)."""
        return (np.abs(self.O_F_ext_hat_K) > self._robot.thresholds[3]).astype(float)

    @property
    def m_load(self) -> float:
        """Mass of the load that was set [kg]."""
        return self._robot.load[0]

    @property
    def F_x_Cload(self) -> Array:
        """Its centre in the frame of the flange (3,) [m]."""
        return self._robot.load[1]

    @property
    def I_load(self) -> Array:
        """Its inertia, by columns (9,) [kg·m²]."""
        return self._robot.load[2]


class Model:
    """The robot's own model, as pylibfranka's: of the arm, its hand and the load that was set."""

    def __init__(self, arm: Arm) -> None:
        self._arm = arm

    def gravity(self, state: RobotState) -> list[float]:
        """Torque against gravity (7,) [N·m]."""
        return self._arm.gravity_torque(state.q).tolist()  # type: ignore[no-any-return]

    def coriolis(self, state: RobotState) -> list[float]:
        """Torque of Coriolis and centrifugal forces (7,) [N·m]."""
        torque = self._arm.coriolis_matrix(state.q, state.dq) @ np.asarray(state.dq)
        return torque.tolist()  # type: ignore[no-any-return]

    def mass(self, state: RobotState) -> list[float]:
        """Mass matrix, by columns (49,) [kg·m²]."""
        return self._arm.mass_matrix(state.q).T.ravel().tolist()


class Robot:
    """An emulated Franka arm, with the methods of ``pylibfranka.Robot`` that torques need.

    Parameters
    ----------
    scenario : Scenario, dict, str or path
        The arm, which must be ``panda`` or ``fr3``, its start, and the obstacles around it.
    disturbances : Disturbances, optional
        What is not as the model says; nothing by default.
    physics : {"own", "mujoco"}, optional
        Whose dynamics move the arm.
    deadline : float, optional
        How long a program may take from a state to its torque [s], by the clock of this machine; what comes
        later is dropped as FCI does. By default time does not count.

    Attributes
    ----------
    body : Body
        The arm itself, with its true state.
    reflex : Reflex or None
        The rule that has ended the last motion, if one has.
    before_state : callable, optional
        Gets this robot before every state, in the thread of the loop.

    Raises
    ------
    vffnull.errors.InputError
        If the arm is another one, or a number makes no sense.

    Examples
    --------
    >>> from vffnull.robots.emulated.franka import Robot, Torques
    >>> robot = Robot("panda-sweep")
    >>> control = robot.start_torque_control()
    >>> for _ in range(3):
    ...     state, _ = control.readOnce()
    ...     control.writeOnce(Torques([0.0] * 7))
    >>> _ = control.readOnce()
    >>> control.writeOnce(Torques([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    >>> robot.reflex.rule.name
    'controller_torque_discontinuity'
    """

    def __init__(
        self,
        scenario: ScenarioLike,
        disturbances: Disturbances | None = None,
        physics: Physics = "own",
        deadline: float | None = None,
    ) -> None:
        given = prepare(scenario)
        self._name = _named(tuple(given.arm.joint_names))
        self.body = body = Body(given, RATE, disturbances or Disturbances(), physics)
        self._deadline = None if deadline is None else positive("deadline", deadline)
        limits = body.model.torque_limits, body.model.velocity_limits, body.model.joint_limits
        assert all(limit is not None for limit in limits), "of a bundled arm"
        torques, speeds, ranges = (np.asarray(limit) for limit in limits)
        self._middle, self._hand = ranges.mean(axis=1), (0.0, 0.0)
        self.mode = RobotMode.Idle
        self._values, self._limits = np.zeros((2, _LOST + 1))
        self._limits[_RATES] = _TORQUE_RATE * (1.0 + 1e-9)
        self._limits[_TORQUES], self._limits[_SPEEDS] = torques, speeds
        self._limits[_PLACES] = 0.5 * (ranges[:, 1] - ranges[:, 0])
        self._limits[_HANDS] = _HAND[self._name]
        self._limits[_LOST] = _MAX_LOST - 0.5
        self.set_collision_behavior(*_THRESHOLDS)
        self.load: tuple[float, Array, Array] = (0.0, np.zeros(3), np.zeros(9))
        self._monitor = Monitor(_rules(body.names))
        self.errors = self.last_errors = Errors()
        self.reflex: Reflex | None = None
        self.before_state: Callable[[Robot], object] | None = None
        self.taken: deque[bool] = deque(maxlen=100)
        self.tau_J: Array = np.zeros(_JOINTS)
        self.tau_J_d: Array = np.zeros(_JOINTS)
        self.external: Array = np.zeros(_JOINTS)
        self.wrench: Array = np.zeros(6)
        self._lost = 0
        self._answered = True
        self._since = 0.0

    def margins(self) -> tuple[Margin, ...]:
        """The nearest that each limit came."""
        return self._monitor.margins()

    # Commands

    def set_collision_behavior(
        self,
        lower_torque_thresholds: ArrayLike,
        upper_torque_thresholds: ArrayLike,
        lower_force_thresholds: ArrayLike,
        upper_force_thresholds: ArrayLike,
    ) -> None:
        """Set what is a contact and what a collision, for joints (7,) [N·m] and hand (6,) [N, N·m]."""
        self._idle("SetCollisionBehavior")
        self.thresholds = (
            array("lower_torque_thresholds", lower_torque_thresholds, (_JOINTS,)),
            array("upper_torque_thresholds", upper_torque_thresholds, (_JOINTS,)),
            array("lower_force_thresholds", lower_force_thresholds, (6,)),
            array("upper_force_thresholds", upper_force_thresholds, (6,)),
        )
        self._limits[_EXTERNALS], self._limits[_WRENCH] = self.thresholds[1], self.thresholds[3]

    def set_load(self, arg0: float, arg1: ArrayLike, arg2: ArrayLike) -> None:
        """Tell the robot of a load: mass [kg], centre from the flange (3,) [m], inertia (9,) [kg·m²]."""
        self._idle("SetLoad")
        mass = within("load_mass", arg0, 0.0, 100.0)
        com, inertia = array("F_x_Cload", arg1, (3,)), array("load_inertia", arg2, (9,))
        tool = frame(self.body.model.to_dict()["tool"])
        turn = tool[:3, :3]
        there = turn.T @ (com + np.array([0.0, 0.0, _FLANGE]) - tool[:3, 3])
        turned = turn.T @ inertia.reshape(3, 3) @ turn
        parts = turned[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        self.body.known = self.body.model.with_load(mass, there, parts if mass > 0.0 else None)
        self.load = (mass, com, inertia)

    def automatic_error_recovery(self) -> None:
        """Clear a reflex."""
        if self.mode is not RobotMode.Reflex:
            raise CommandException(f"libfranka: AutomaticErrorRecovery {self._impossible()}")
        self.errors, self.mode = Errors(), RobotMode.Idle

    def load_model(self) -> Model:
        """The robot's model of the arm."""
        return Model(self.body.known)

    def read_once(self) -> RobotState:
        """The next state, while nothing drives it."""
        if self.mode is RobotMode.Move:
            raise FrankaException(
                "libfranka: Cannot perform this operation while another control is running."
            )
        self.body.hold()
        return self._state()

    def start_torque_control(self) -> Robot:
        """Begin a motion by torques."""
        self._idle("Move")
        self.mode, self.reflex, self.last_errors = RobotMode.Move, None, Errors()
        self.tau_J_d = np.zeros(_JOINTS)
        self.external = self.body.weight() - self.body.known.gravity_torque(self.body.q)  # it has stood here
        self._look_at_hand()
        self._answered, self._lost = True, 0
        self.taken.clear()
        return self

    def stop(self) -> None:
        """End a motion: the robot brakes."""
        self.body.brake()
        if self.mode is RobotMode.Move:
            self.mode = RobotMode.Idle

    # The motion under way: pylibfranka's ActiveControlBase

    def readOnce(self) -> tuple[RobotState, Duration]:
        """The next state, and how long after the last it comes; raises `ControlException` after a reflex."""
        before = self.body.t
        if self.before_state is not None and self.mode is RobotMode.Move:
            self.before_state(self)
        if not self._answered:
            self._cycle(None)
        while self.mode is RobotMode.Move and self.body.is_lost():
            self._cycle(None)
        self._raise()
        self._answered = False
        self._since = perf_counter()
        return self._state(), Duration(self.body.t - before + self.body.period)

    def writeOnce(self, arg0: Any) -> None:
        """Send a command `Torques`, once for every state."""
        self._raise()
        if self._answered:
            raise FrankaException("emulated: two commands for one state")
        torque = np.array(arg0.tau_J)
        late = self._deadline is not None and perf_counter() - self._since > self._deadline
        self._answered = True
        self._cycle(None if late or self.body.is_lost() else torque)
        if arg0.motion_finished and self.mode is RobotMode.Move:
            self.stop()

    # Inside

    def _cycle(self, received: Array | None) -> None:
        """One cycle with a new torque, or with the last once more."""
        body = self.body
        self._lost = 0 if received is not None else self._lost + 1
        self.taken.append(received is not None)
        before = self.tau_J_d
        self.tau_J_d = before if received is None else received
        weight = self.body.known.gravity_torque(body.q)
        self.tau_J = self.tau_J_d + weight
        body.move(self.tau_J + body.friction(_COMPENSATED, _COMPENSATED))
        self._estimate()
        values, limits = self._values, self._limits
        values[_RATES] = (self.tau_J_d - before) / body.period
        values[_TORQUES] = self.tau_J
        values[_SPEEDS] = body.dq
        if self._name == "fr3":
            limits[_SPEEDS] = _fr3_speeds(body.q, body.dq)
        values[_PLACES] = body.q - self._middle
        values[_HANDS] = self._hand
        values[_EXTERNALS], values[_WRENCH] = self.external, self.wrench
        values[_LOST] = self._lost
        reflex = self._monitor.check(values, limits, body.cycle, body.t)
        if reflex is not None:
            self.reflex, self.mode = reflex, RobotMode.Reflex
            self.errors = self.last_errors = Errors(frozenset([reflex.rule.name]))
            body.brake()

    def _estimate(self) -> None:
        """The external torque as the robot sees it: what it exerts, without what its model needs; and, less
        often, the force that this is at the hand, none near a singularity, and the hand's speed.
        """
        body = self.body
        seen = self.tau_J - self.body.known.inverse_dynamics(body.q, body.dq, body.ddq)
        self.external = self.external + _SHARE * (seen - self.external)
        if body.cycle % _EVERY == 0:
            self._look_at_hand()

    def _look_at_hand(self) -> None:
        body = self.body
        jacobian = body.known.jacobian(body.q)
        turn = jacobian @ body.dq
        self._hand = (math.hypot(*turn[:3]), math.hypot(*turn[3:]))
        u, gains, v = np.linalg.svd(jacobian, full_matrices=False)
        is_known = gains[-1] >= _SINGULAR
        self.wrench = u @ ((v @ self.external) / gains) if is_known else np.zeros(6)

    def _state(self) -> RobotState:
        q, dq = self.body.measure()
        return RobotState(self, q, dq)

    def _raise(self) -> None:
        if self.mode is RobotMode.Reflex:
            rate = sum(self.taken) / max(1, len(self.taken))
            raise ControlException(
                f"libfranka: Move command aborted: motion aborted by reflex! {self.last_errors}\n"
                f"control_command_success_rate: {rate:g}",
                self.reflex,
            )
        if self.mode is not RobotMode.Move:
            raise FrankaException("emulated: no motion is under way")

    def _idle(self, command: str) -> None:
        if self.mode is not RobotMode.Idle:
            raise CommandException(f"libfranka: {command} {self._impossible()}")

    def _impossible(self) -> str:
        return f'command rejected: command not possible in the current mode ("{self.mode.name}")!'


def _fr3_speeds(q: Array, dq: Array) -> Array:
    """How fast each joint of FR3 may be where it is, in the direction in which it moves (7,) [rad/s]."""
    way = np.where(dq < 0.0, q - _FR3_LOWER, _FR3_UPPER - q)
    most: Array = np.clip(np.sqrt(np.maximum(0.0, _FR3_FACTOR * way)) - _FR3_OFFSET, 0.0, _FR3_SPEED)
    return most


def _named(joints: tuple[str, ...]) -> str:
    """Which of Franka's arms it is, by the names of its joints."""
    for name in _HAND:
        if joints == tuple(f"{name}_joint{i + 1}" for i in range(_JOINTS)):
            return name
    raise InputError("scenario: its arm must be the bundled panda or fr3, whose interface is emulated")


def _rules(joints: tuple[str, ...]) -> tuple[Rule, ...]:
    return (
        Rule("controller_torque_discontinuity", "the torque rate", "N·m/s", joints, _SPECIFICATIONS),
        Rule("tau_j_range_violation", "the torque", "N·m", joints, _SPECIFICATIONS),
        Rule("joint_velocity_violation", "the speed", "rad/s", joints, _SPECIFICATIONS),
        Rule("joint_position_limits_violation", "the angle from mid-range", "rad", joints, _SPECIFICATIONS),
        Rule("cartesian_velocity_violation", "the speed of the hand", "m/s", ("",), _SPECIFICATIONS),
        Rule("cartesian_velocity_violation", "the turning of the hand", "rad/s", ("",), _SPECIFICATIONS),
        Rule("joint_reflex", "the external torque", "N·m", joints, _ERRORS),
        Rule("cartesian_reflex", "the external force", "N", _AXES, _ERRORS),
        Rule("cartesian_reflex", "the external torque at the hand", "N·m", _AXES, _ERRORS),
        Rule("communication_constraints_violation", "lost packets in a row", "", ("",), _REQUIREMENTS),
    )
