"""MuJoCo as the plant; `vffnull.mujoco_plant` is where users find it."""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _core
from vffnull._core import Arm, Controller, Terms
from vffnull._document import Document
from vffnull._record import QUANTITIES
from vffnull.engines.export import to_mjcf
from vffnull.errors import InputError, ScenarioError
from vffnull.result import Metrics, Result, Status
from vffnull.scenario import Scenario, ScenarioLike, prepare
from vffnull.world import Motion, Obstacle

__all__ = ["MuJoCoPlant", "run"]

Array = NDArray[np.float64]
Sample = tuple[Array, Array, Array]
Law = Callable[[float, Array, Array], Array]

_MAX_SPEED = 1e4  # rad/s; the core's bound, beyond which a run has diverged
_PATIENCE = 0.1  # s between two reports of progress


class MuJoCoPlant:
    """The arm of a scenario and its obstacles in MuJoCo, one step of `simulation.dt` at a time.

    Links touch obstacles, without friction, and never each other. Obstacles are moved before a step to where
    they are at its start, and are infinitely heavy. Contacts are MuJoCo's default, soft ones: against a link
    that is held, a disc at 0.35 m/s sinks in by 14 mm. So are joint stops and dry friction: a joint goes a
    little beyond a stop, and creeps where it should stick. Torque limits do not act.

    While a step is taken, MuJoCo's global callbacks for control and warnings are in use: take steps from one
    thread only.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        The scenario, as in `vffnull.simulate`.

    Attributes
    ----------
    model : mujoco.MjModel
        The model, made by `vffnull.export.to_mjcf`.
    data : mujoco.MjData
        The state.
    contacts : int
        How many contacts of a link with an obstacle MuJoCo saw when it last looked, in the last step.

    Raises
    ------
    vffnull.errors.ScenarioError
        If MuJoCo cannot simulate the arm, a link without inertia of its own for instance, or if the scenario
        has a table ``[measurement]`` or ``[actuator]``, or range sensors in ``[perception]``.
    ImportError
        Without the extra ``vffnull[mujoco]``.
    """

    def __init__(self, scenario: ScenarioLike) -> None:
        scenario = prepare(scenario)
        self._mujoco = mujoco = _import()
        document = scenario.to_dict()
        for table in ("measurement", "perception", "actuator"):
            if table in document and document[table].get("kind") != "ideal":
                raise ScenarioError(
                    f"{table}: MuJoCo as the plant has none; remove the table, or simulate with the core",
                    table,
                )
        self._obstacles = document.get("obstacles", [])
        physics = document.get("plant", {})
        numerics = document.get("simulation", {})
        try:
            with _alone(mujoco):
                self.model = mujoco.MjModel.from_xml_string(
                    to_mjcf(scenario.plant, obstacles=self._obstacles)
                )
        except ValueError as error:
            raise ScenarioError(f"not for MuJoCo: {error}") from None
        options, disable, integrator = self.model.opt, mujoco.mjtDisableBit, mujoco.mjtIntegrator
        options.timestep = numerics.get("dt", 1e-3)
        # MuJoCo's Euler is semi-implicit; `eulerdamp` would integrate joint damping implicitly as well.
        rk4 = numerics.get("integrator", "rk4") == "rk4"
        options.integrator = integrator.mjINT_RK4 if rk4 else integrator.mjINT_EULER
        options.disableflags |= disable.mjDSBL_EULERDAMP | disable.mjDSBL_AUTORESET
        if not physics.get("joint_stops", True):
            options.disableflags |= disable.mjDSBL_LIMIT
        self.model.jnt_solref[:] = 2 * options.timestep, 1.0  # as hard as MuJoCo's joint stops can be
        self.model.jnt_solimp[:, :2] = 0.9999, 0.9999
        self.model.dof_solref[:] = 2 * options.timestep, 1.0  # and its dry friction
        self.model.dof_solimp[:, :2] = 0.9999, 0.9999
        self.model.dof_damping[:] = physics.get("viscous_friction", 0.0)
        self.model.dof_frictionloss[:] = physics.get("coulomb_friction", 0.0)
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = document["q0"]
        self.data.qvel[:] = document.get("dq0", 0.0)
        self.contacts = 0

    def step(self, t: float, torque: Array | Law) -> bool:
        """Advance by one step.

        Parameters
        ----------
        t : float
            Time at the start of the step [s].
        torque : (n,) ndarray or callable
            Joint torque [N·m], held over the step, or a law (t, q, q̇) ↦ torque that every stage of the
            integrator asks.

        Returns
        -------
        bool
            Whether the new state is finite and slower than 10⁴ rad/s in every joint.
        """
        data = self.data
        data.time = t
        for place, obstacle in zip(data.mocap_pos, self._obstacles, strict=True):
            place[:2] = _position(obstacle, t)
        law = None
        if callable(torque):
            law = _callback(torque)
        else:
            data.qfrc_applied[:] = torque  # past the actuators and their limits
        try:
            with _alone(self._mujoco, law):
                self._mujoco.mj_step(self.model, data)
        except InputError:  # the integrator asked for the torque at a state that is not finite
            return False
        self.contacts = data.ncon
        return bool(np.isfinite(data.qpos).all() and (np.abs(data.qvel) < _MAX_SPEED).all())


def run(scenario: ScenarioLike, progress: Callable[[float, float], None] | None = None) -> Result:
    """Run a scenario with MuJoCo as the plant.

    Every step is measured, whatever is recorded. ``"collided"`` and the metrics of clearance count the
    distances that the controller measures.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        What to run, as in `vffnull.simulate`. Its reference has to be a set point, a polynomial or a line.
    progress : callable, optional
        Gets the simulated time and the duration [s] about every 100 ms.

    Returns
    -------
    Result
        As from the core.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the reference is of another kind, if MuJoCo cannot simulate the arm, or if the scenario has
        sensors, drives or a governor, which it has not.
    ImportError
        Without the extra ``vffnull[mujoco]``.
    """
    started = looked = time.perf_counter()
    scenario = prepare(scenario)
    document = scenario.to_dict()
    warnings = _core.check("scenario", document)
    duration, numerics = scenario.duration, document.get("simulation", {})
    dt, period = float(numerics.get("dt", 1e-3)), int(numerics.get("control_every", 1))
    mode = numerics.get("control", "hold")
    steps = int(duration / dt + 0.5)
    plant, brain = MuJoCoPlant(scenario), _Brain(scenario)
    q, dq = plant.data.qpos, plant.data.qvel

    absent = _absent(document)
    rows: dict[str, list[Any]] = {name: [] for name in _ROWS}
    status = Status.COMPLETED
    held: Terms | None = None
    k = 0
    try:
        while True:
            now = brain.terms(k * dt, q, dq)
            if held is None or k % period == 0:
                held = brain.ahead(k * dt, q, dq, now, period * dt) if mode == "predictor" else now
            torques = held.tau, held.tau_task, held.tau_null
            power = now.power
            power[0] = dq @ held.tau  # what the motors do, not what the law would have them do now
            values = (
                *(q.copy(), dq.copy(), *torques, now.tau_vff, now.force, now.clearance),
                *(
                    now.energy,
                    power,
                    now.manipulability,
                    held.objective_scale,
                    now.self_clearance,
                    now.tank,
                    now.slack,
                ),
                *(held.null_acceleration, now.singular),
            )
            for name, value in zip(_ROWS, values, strict=True):
                rows[name].append(value)
            if k == steps:
                break
            if not plant.step(k * dt, brain.torque if mode == "continuous" else held.tau):
                status = Status.DIVERGED
                break
            k += 1
            if progress is not None and time.perf_counter() - looked > _PATIENCE:
                looked = time.perf_counter()
                progress(k * dt, duration)
    except KeyboardInterrupt:
        if not rows[_ROWS[-1]]:
            raise
        status = Status.INTERRUPTED
    count = min(map(len, rows.values()))  # an interrupt may come between two of them
    times = _floats(np.arange(count) * dt)
    record = {name: np.array(values[:count]) for name, values in rows.items() if name not in absent}
    record |= _kinematics(scenario.arm, brain, times, record["q"], record["dq"])
    record["obstacles"] = np.array(
        [[_position(o, t) for o in document.get("obstacles", [])] for t in times]
    ).reshape(count, -1, 2)
    metrics = _metrics(times, record, dt, document)
    if status is Status.COMPLETED and metrics["collision_time"] is not None:
        status = Status.COLLIDED
    end_time = float(times[-1])
    every = int(numerics.get("record_every", 1))
    return Result(
        scenario=scenario,
        status=status,
        message=_message(status, end_time, metrics),
        end_time=end_time,
        wall_time=time.perf_counter() - started,
        warnings=tuple(warnings),
        metrics=Metrics(metrics),
        version=_core.__version__,
        plant="mujoco",
        t=times[::every],
        **{name: np.ascontiguousarray(record[name][::every]) for name in QUANTITIES if name in record},
    )


_ROWS = (
    *("q", "dq", "tau", "tau_task", "tau_null", "tau_vff", "force", "clearance"),
    *("energy", "power", "manipulability", "objective_scale", "self_clearance", "tank", "slack"),
    *("null_acceleration", "singular"),
)


def _absent(document: Document) -> set[str]:
    """The recorded quantities that the scenario does not have."""
    controller, arm = document.get("controller", {}), document["arm"]
    limited = controller.get("enforce_limits", True) and ("torque_limits" in arm or "velocity_limits" in arm)
    return {
        *(() if limited else ("objective_scale",)),
        *(() if controller.get("self_collision", "ignore") != "ignore" else ("self_clearance",)),
        *(() if "tank" in controller else ("tank",)),
        *(() if controller.get("avoidance") == "cbf" else ("slack",)),
    }


class _Brain:
    """The scenario's law with its reference and its obstacles: a closed loop without its plant."""

    def __init__(self, scenario: Scenario) -> None:
        document = scenario.to_dict()
        settings = document.get("controller", {})
        if "governor" in settings:
            raise ScenarioError(
                "controller.governor: with MuJoCo as the plant there is none; remove the table, or simulate "
                "with the core",
                "controller.governor",
            )
        self.pose = settings.get("task", "position") == "pose"
        self._arm = scenario.arm
        self._controller = Controller(self._arm, settings)
        self._obstacles = [_obstacle(each) for each in document.get("obstacles", [])]
        q0 = _floats(document["q0"])
        tip = self._arm.forward_kinematics(q0)[-1]
        self.reference = _reference(document["reference"], np.append(tip, q0.sum()) if self.pose else tip)

    def terms(self, t: float, q: Array, dq: Array) -> Terms:
        """The law at an instant, with its parts."""
        return self._controller.terms(q, dq, *self.reference(t), self._obstacles, t)

    def torque(self, t: float, q: Array, dq: Array) -> Array:
        """The law at an instant."""
        return self._controller.torque(q, dq, *self.reference(t), self._obstacles, t)

    def ahead(self, t: float, q: Array, dq: Array, now: Terms, period: float) -> Terms:
        """The law at the state predicted for the middle of a control period (T33)."""
        half = period / 2
        ddq = self._arm.forward_dynamics(q, dq, now.tau)
        return self.terms(t + half, q + half * (dq + half / 2 * ddq), dq + half * ddq)


def _import() -> Any:
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise ImportError('mujoco is missing: pip install "vffnull[mujoco]"') from error


def _callback(law: Law) -> Callable[[Any, Any], None]:
    """The law as MuJoCo asks for it."""

    def ask(_model: Any, data: Any) -> None:
        data.qfrc_applied[:] = law(data.time, data.qpos, data.qvel)

    return ask


@contextmanager
def _alone(mujoco: Any, control: Callable[[Any, Any], None] | None = None) -> Iterator[None]:
    """Set MuJoCo's global callbacks for a while.

    Warnings of a state that is not finite are neither printed nor written to a file: `step` tells of it.
    """
    before = mujoco.get_mjcb_control(), mujoco.get_mju_user_warning()
    mujoco.set_mjcb_control(control)
    mujoco.set_mju_user_warning(lambda _message: None)
    try:
        yield
    finally:
        mujoco.set_mjcb_control(before[0])
        mujoco.set_mju_user_warning(before[1])


def _floats(value: Any) -> Array:
    return np.asarray(value, dtype=np.float64)


def _obstacle(document: Mapping[str, Any]) -> Obstacle:
    """An obstacle of a document, as an object: the controller reads it once, and a dict at every call."""
    shape, motion = dict(document["shape"]), dict(document.get("motion", {"kind": "static"}))
    return Obstacle(
        shape.pop("kind"),
        tuple(shape.items()),
        tuple(document.get("position", (0.0, 0.0))),
        document.get("angle", 0.0),
        Motion(motion.pop("kind"), tuple(motion.items())),
    )


def _position(obstacle: Mapping[str, Any], t: float) -> Array:
    """Where an obstacle of a document is at a time."""
    start = _floats(obstacle.get("position", (0.0, 0.0)))
    motion = obstacle.get("motion", {"kind": "static"})
    match motion["kind"]:
        case "static":
            return start
        case "linear":
            return start + t * _floats(motion["velocity"])
        case "sinusoid":
            angle = float(motion["angular_frequency"] * t + motion.get("phase", 0.0))
            return start + float(np.sin(angle)) * _floats(motion["amplitude"])
        case _:
            points = _floats(motion["points"])
            return np.array([np.interp(t, motion["times"], axis) for axis in points.T])


def _reference(document: Mapping[str, Any], start: Array) -> Callable[[float], Sample]:
    """x_r, ẋ_r, ẍ_r as a function of time; `start` is where a line begins if the document does not say."""
    kind, end = document["kind"], np.inf
    if kind == "setpoint":
        coefficients = [[x] for x in document["point"]]
    elif kind == "polynomial":
        coefficients = document["coefficients"]
    elif kind == "line":
        start = _floats(document.get("start", start))
        way, end = _floats(document["end"]) - start, float(document["duration"])
        rise = np.array([0.0, 0.0, 0.0, 10.0 / end**3, -15.0 / end**4, 6.0 / end**5])
        coefficients = [[x, *(span * rise)[1:]] for x, span in zip(start, way, strict=True)]
    else:
        raise ScenarioError(
            f"reference.kind: {kind!r} cannot be simulated in MuJoCo; setpoint, polynomial and line can",
            "reference.kind",
        )
    axes = [np.polynomial.Polynomial(axis or [0.0]) for axis in coefficients]
    orders = [[axis.deriv(order) for axis in axes] for order in range(3)]

    def at(t: float) -> Sample:
        x, dx, ddx = (np.array([axis(min(t, end)) for axis in order]) for order in orders)
        return x, dx, ddx

    return at


def _kinematics(arm: Arm, brain: _Brain, times: Array, q: Array, dq: Array) -> dict[str, Array]:
    """The end effector and its reference along a motion."""
    joints = arm.forward_kinematics(q)
    x = joints[:, -1]
    lever = x[:, None] - joints[:, :-1]
    dx = np.stack([-np.sum(lever[..., 1] * dq, axis=1), np.sum(lever[..., 0] * dq, axis=1)], axis=1)
    if brain.pose:
        x = np.column_stack([x, q.sum(axis=1)])
        dx = np.column_stack([dx, dq.sum(axis=1)])
    x_ref = np.array([brain.reference(t)[0] for t in times])
    error = x - x_ref
    error[:, 2:] -= 2 * np.pi * np.ceil(error[:, 2:] / (2 * np.pi) - 0.5)  # into (−π, π]
    return {"x": x, "dx": dx, "x_ref": x_ref, "error": error}


@np.errstate(over="ignore")  # the effort of a run that diverges may be infinite, as in the core
def _metrics(
    times: Array, record: Mapping[str, Array], dt: float, document: Document
) -> dict[str, float | int | None]:
    """The core's metrics, from a record of every step."""
    clearance, nearest = record["clearance"], record["clearance"].min(axis=1)
    row, link = np.unravel_index(np.argmin(clearance), clearance.shape)
    inside = nearest < 0
    found: dict[str, float | int | None] = {
        "intrusion_time": float(np.count_nonzero(inside) * dt),
        "intrusion_depth": max(0.0, -float(nearest.min())),
    }
    if np.isfinite(nearest).any():
        found |= {
            "min_clearance": float(nearest.min()),
            "min_clearance_time": float(times[row]),
            "min_clearance_link": int(link),
        }
    if inside.any():
        found["collision_time"] = float(times[np.argmax(inside)])

    error = np.linalg.norm(record["error"][:, :2], axis=1)
    found["tail_start"] = tail_start = 0.8 * float(document["duration"])
    tail = times >= tail_start
    for name, part in (("transient", error[~tail]), ("tail", error[tail])):
        if part.size:
            found[f"rms_error_{name}"] = float(np.sqrt(np.mean(part**2)))
            found[f"max_error_{name}"] = float(part.max())
    if tail.any() and record["error"].shape[1] > 2:
        found["max_orientation_error_tail"] = float(np.abs(record["error"][tail, 2]).max())
    outside = np.flatnonzero(error > max(0.02 * error[0], 1e-3))
    if not outside.size:
        found["settling_time"] = 0.0
    elif outside[-1] < len(times) - 1:
        found["settling_time"] = float(times[outside[-1]] + dt)

    force, tau, dq = record["force"].max(axis=1), record["tau"], record["dq"]
    found["max_repulsion"] = float(force.max())
    if force.any():
        found["max_repulsion_time"] = float(times[np.argmax(force)])
    found |= {
        "peak_torque": float(np.abs(tau).max()),
        "peak_speed": float(np.abs(dq).max()),
        "effort": float(np.sum(tau**2) * dt),
        "energy": float(np.sum(np.abs(tau * dq)) * dt),
    }
    if len(times) > 2:
        found["rms_jerk"] = float(np.sqrt(np.mean(np.diff(dq, n=2, axis=0) ** 2)) / dt**2)
    found["max_null_acceleration"] = float(record["null_acceleration"].max())
    storage, supply = record["energy"][:, 2], record["power"][:, 1:].sum(axis=1)
    supplied = np.concatenate([[0.0], np.cumsum(dt * (supply[1:] + supply[:-1]) / 2)])
    found["passivity_residual"] = float(np.abs(storage - storage[0] - supplied).max())
    found["singular_steps"] = int(record["singular"].sum())
    found["min_manipulability"] = float(record["manipulability"].min())
    if "self_clearance" in record:
        distance = record["self_clearance"]
        if np.isfinite(distance).any():
            found["min_self_clearance"] = float(distance.min())
        if (distance <= 0).any():
            found["self_collision_time"] = float(times[np.argmax(distance <= 0)])
    if "objective_scale" in record:
        found["limited_steps"] = int((record["objective_scale"] < 1).any(axis=1).sum())
    if document.get("controller", {}).get("avoidance", "null_space") != "null_space":
        found["passivity_residual"] = None  # the balance is that of the null-space law
    if "slack" in record:
        found["max_slack"] = float(record["slack"].max())
        found["slack_steps"] = int(np.sum(record["slack"] > 0.1))
    arm = document["arm"]
    if "joint_limits" in arm:
        lower, upper = np.moveaxis(_floats(arm["joint_limits"]), -1, 0)
        excess = np.maximum(lower - record["q"], record["q"] - upper)
        found["joint_limit_violation"] = max(0.0, float(excess.max()))
    if "velocity_limits" in arm:
        found["velocity_limit_ratio"] = float(np.max(np.abs(dq) / arm["velocity_limits"]))
    if "torque_limits" in arm:
        found["torque_limit_ratio"] = float(np.max(np.abs(tau) / arm["torque_limits"]))
    return {name: found.get(name) for name in _core.METRICS}


def _message(status: Status, end_time: float, metrics: Mapping[str, float | int | None]) -> str:
    """One sentence that says how a run ended."""
    match status:
        case Status.COMPLETED:
            return f"reached its end in MuJoCo at t = {end_time} s without contact"
        case Status.COLLIDED:
            return (
                f"link {metrics['min_clearance_link']} was up to {metrics['intrusion_depth']:.4f} m inside "
                f"an obstacle in MuJoCo; first contact at t = {metrics['collision_time']} s"
            )
        case Status.DIVERGED:
            return (
                f"the state left the finite range in MuJoCo after t = {end_time} s: the torque is too stiff "
                "for the step, or the scenario is unstable"
            )
        case _:
            return f"interrupted at t = {end_time} s"
