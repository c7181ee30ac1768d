"""The arm behind an emulated interface: its physics, and what is not as the model says."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vffnull import _core
from vffnull._support.arguments import positive, whole, within
from vffnull._support.errors import InputError
from vffnull.model.scenario import Scenario

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Array = NDArray[np.float64]

__all__ = ["ROBOTS", "Body", "Disturbances", "Physics", "usual"]

ROBOTS = ("emulated-franka", "emulated-ur")
"""Names of what is emulated."""

Physics = Literal["own", "mujoco"]
"""Whose dynamics move the arm: the core's, or MuJoCo's, which share no code with the controller and where
what is touched pushes back (``vffnull[mujoco]``).
"""

_LONGEST_DELAY = 1000  # cycles
_SLOW = 0.05  # rad/s: below it dry friction is compensated in part, so that nothing chatters at rest
_BRAKES = 20.0  # 1/s: d of the damping −d M q̇ by which the robot stops the arm itself


@dataclass(frozen=True)
class Disturbances:
    """What a robot has that its model does not; nothing by default.

    Parameters
    ----------
    position_noise, velocity_noise : float, optional
        Standard deviation of what is measured [rad, rad/s].
    torque_noise : float, optional
        Standard deviation of the measured torque [N·m].
    delay : int, optional
        Cycles by which a state is old when it is sent.
    loss : float, optional
        Share of the packets that are lost, of states and of commands each, in [0, 1).
    viscous_friction, coulomb_friction : float or (n,) array_like, optional
        Friction of the joints [N·m·s/rad, N·m], before what the robot compensates of it.
    load : Mapping, optional
        What the tool carries and nobody knows of: ``mass`` [kg], ``com`` [m] and ``inertia`` [kg·m²] in the
        frame of the tool, as ``plant.payload`` of a scenario.
    seed : int, optional
        Of the random numbers.

    Raises
    ------
    vffnull.errors.InputError
        If a number makes no sense.
    """

    position_noise: float = 0.0
    velocity_noise: float = 0.0
    torque_noise: float = 0.0
    delay: int = 0
    loss: float = 0.0
    viscous_friction: float | ArrayLike = 0.0
    coulomb_friction: float | ArrayLike = 0.0
    load: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("position_noise", "velocity_noise", "torque_noise"):
            within(name, getattr(self, name), 0.0, 1e3)
        whole("delay", self.delay, 0, _LONGEST_DELAY)
        within("loss", self.loss, 0.0, 0.999)
        whole("seed", self.seed, 0, 2**63)


def usual(robot: str, seed: int = 0) -> Disturbances:
    """What is to be expected of a real robot, and a kilogram that nobody has told it of.

    Parameters
    ----------
    robot : str
        One of `ROBOTS`.
    seed : int, optional
        Of the random numbers.

    Returns
    -------
    Disturbances
        Noise of 10 µrad and 0.01 rad/s, states that are one cycle old, 1 % of the packets lost, 1 kg at the
        tool, and dry and viscous friction of 1 % of each joint's largest torque, which robots compensate in
        part.
    """
    joints = {"emulated-franka": [0.87] * 4 + [0.12] * 3, "emulated-ur": [1.5] * 3 + [0.28] * 3}
    if robot not in joints:
        raise InputError(f"robot: must be one of {', '.join(ROBOTS)}, got {robot!r}")
    return Disturbances(
        position_noise=1e-5,
        velocity_noise=0.01,
        torque_noise=0.05,
        delay=1,
        loss=0.01,
        viscous_friction=joints[robot],
        coulomb_friction=joints[robot],
        load={"mass": 1.0},
        seed=seed,
    )


class Body:
    """The arm of a scenario, moved by the torques that its drives exert, one cycle at a time.

    Parameters
    ----------
    scenario : Scenario
        Arm, start and obstacles; what its ``[plant]``, ``[measurement]`` and ``[actuator]`` say acts, too.
    rate : float
        Cycles per second [Hz].
    disturbances : Disturbances
        What is not as the model says.
    physics : {"own", "mujoco"}, optional
        Whose dynamics.

    Attributes
    ----------
    model : Arm
        The arm as its maker describes it: without the `load` of a scenario, which a robot has to be told.
    loaded : Arm
        The arm with that.
    known : Arm
        The arm as the robot has been told of it: `model`, until it knows what is carried.
    names : tuple of str
        Of its joints.
    q, dq, ddq : (n,) ndarray
        Where the arm is [rad], how fast [rad/s], and its mean acceleration in the last cycle [rad/s²].
    t : float
        Time of the robot [s].
    cycle : int
        Cycles since the start.
    clearance : float
        Distance to the nearest obstacle [m]; infinite without one. By MuJoCo it is −1 where it touches one
        and 1 elsewhere.
    """

    def __init__(
        self,
        scenario: Scenario,
        rate: float,
        disturbances: Disturbances,
        physics: Physics = "own",
    ) -> None:
        self.model = self.loaded = scenario.arm
        if "load" in scenario["arm"]:
            self.model = scenario.replace(**{"arm.load": None}).arm
        self.known = self.model
        self.names = tuple(scenario.arm.joint_names)
        self.period = 1.0 / positive("rate", rate)
        self._noise = disturbances
        self._random = np.random.default_rng(disturbances.seed)
        n = self.model.n
        self._viscous, self._dry = (
            np.broadcast_to(np.asarray(given, dtype=float), (n,))
            for given in (disturbances.viscous_friction, disturbances.coulomb_friction)
        )
        self._rubs = bool(self._viscous.any() or self._dry.any())
        document = _plant(scenario, self.period, disturbances, self.model.n)
        self._plant = Scenario.from_dict(document).plant
        if physics == "own":
            self._own: _core.Simulation | None = _core.Simulation(Scenario.from_dict(document))
            state = self._own.state
            self.q, self.dq = state.q, state.dq
            self.clearance = float(state.clearance.min())
        elif physics == "mujoco":
            from vffnull.engines.mujoco_plant import MuJoCoPlant

            if document.get("measurement") or document.get("actuator"):
                raise InputError("physics: [measurement] and [actuator] of a scenario need our own")
            self._own, self._theirs = None, MuJoCoPlant(document)
            data = self._theirs.data
            self.q, self.dq, self.clearance = data.qpos.copy(), data.qvel.copy(), 1.0
        else:
            raise InputError(f"physics: must be own or mujoco, got {physics!r}")
        self._steps = document["simulation"]["control_every"]
        self._step = document["simulation"]["dt"]
        self.ddq = np.zeros(self.model.n)
        self.cycle = 0
        self._states: deque[tuple[Array, Array]] = deque(maxlen=disturbances.delay + 1)
        self._states.append((self.q, self.dq))

    @property
    def t(self) -> float:
        """Time of the robot [s]."""
        return self.cycle * self.period

    def move(self, torque: Array) -> None:
        """Let a torque act for one cycle (n,) [N·m], as the drives exert it."""
        before = self.dq
        if self._own is not None:
            state = self._own.step(torque)
            self.q, self.dq, self.clearance = state.q, state.dq, float(state.clearance.min())
            seen, speed = state.q_measured, state.dq_measured
        else:
            plant = self._theirs
            touched = False
            for k in range(self._steps):
                plant.step(self.t + k * self._step, torque)
                touched |= plant.contacts > 0
            self.q, self.dq = plant.data.qpos.copy(), plant.data.qvel.copy()
            self.clearance, seen, speed = -1.0 if touched else 1.0, None, None
        self.ddq = (self.dq - before) / self.period
        self.cycle += 1
        self._states.append((self.q if seen is None else seen, self.dq if speed is None else speed))

    def measure(self) -> tuple[Array, Array]:
        """What the sensors say of positions and velocities, as old as the delay (n,), (n,)."""
        q, dq = self._states[0]
        noise = self._noise
        if noise.position_noise > 0.0:
            q = q + noise.position_noise * self._random.standard_normal(len(q))
        if noise.velocity_noise > 0.0:
            dq = dq + noise.velocity_noise * self._random.standard_normal(len(q))
        return q, dq

    def measured_torque(self, torque: Array) -> Array:
        """What the sensors say of a torque (n,) [N·m]."""
        noise = self._noise.torque_noise
        return torque + noise * self._random.standard_normal(len(torque)) if noise > 0.0 else torque

    def is_lost(self) -> bool:
        """Whether the next packet is lost."""
        return self._noise.loss > 0.0 and self._random.random() < self._noise.loss

    def friction(self, viscous: Array | float = 1.0, dry: Array | float = 1.0) -> Array:
        """Shares of the friction at the present speed (n,) [N·m], as a robot would compensate it."""
        if not self._rubs:
            return np.zeros(len(self.dq))
        return viscous * self._viscous * self.dq + dry * self._dry * np.tanh(self.dq / _SLOW)

    def weight(self) -> Array:
        """The torque that holds the arm with all that it carries (n,) [N·m]."""
        return self._plant.gravity_torque(self.q)

    def hold(self) -> None:
        """Let the robot hold the arm for one cycle, as its own controllers and brakes do."""
        self.move(self.weight() - _BRAKES * (self._plant.mass_matrix(self.q) @ self.dq))

    def brake(self, seconds: float = 1.0) -> None:
        """Let the robot stop the arm, for as long as it moves."""
        for _ in range(round(seconds / self.period)):
            if np.abs(self.dq).max() < 1e-3:
                break
            self.hold()


def _plant(given: Scenario, period: float, disturbances: Disturbances, n: int) -> dict[str, Any]:
    """The scenario without its controller, in steps of a millisecond or less."""
    document = given.to_dict()
    for name in ("controller", "perception", "replan"):
        document.pop(name, None)
    steps = max(1, int(np.ceil(period / 1e-3 - 1e-9)))
    document["reference"] = {"kind": "setpoint"}
    document["simulation"] = {
        "dt": period / steps,
        "control": "hold",
        "control_every": steps,
        "integrator": "semi_implicit_euler",
    }
    plant = dict(document.get("plant", {})) | {"joint_stops": False}  # what is beyond is to be seen
    for name in ("viscous_friction", "coulomb_friction"):
        added = np.asarray(getattr(disturbances, name), dtype=float)
        if added.any():
            plant[name] = (np.broadcast_to(plant.get(name, 0.0), (n,)) + added).tolist()
    if disturbances.load:
        plant["payload"] = dict(disturbances.load)
    document["plant"] = plant
    return document
