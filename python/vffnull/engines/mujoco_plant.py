"""MuJoCo as the plant: our controller, their physics, contacts included.

Everything but the plant is the core's: reference, governor, law, sensors, drives, record and metrics. The
arm moves by MuJoCo's dynamics and integrator, and an obstacle that reaches a link pushes it. The arm is the
one of the table ``[plant]``, friction and joint stops included, and the wrenches of ``[[wrenches]]`` push it.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._core import matrices, quaternions
from vffnull._support.errors import InputError, ScenarioError
from vffnull.engines.export import to_mjcf
from vffnull.model.scenario import Scenario, ScenarioLike, prepare
from vffnull.model.settings import default, setting

__all__ = ["MuJoCoPlant"]

Array = NDArray[np.float64]
Law = Callable[[float, Array, Array], Array]

_MAX_SPEED = 1e4  # rad/s; the core's bound, beyond which a run has diverged
_HARD = 0.9999  # the largest impedance that MuJoCo has
_HIT = 0.1  # m/s
_PATIENCE = 0.1  # s between two reports of progress


class MuJoCoPlant:
    """The arm of a scenario and its obstacles in MuJoCo, one step of `simulation.dt` at a time.

    In the plane and in space. Links touch obstacles with the shapes that are measured against them, without
    friction but that of an obstacle's ``contact``, and never each other. Obstacles are moved before a step to
    where they are at its start, and are infinitely heavy. Contacts are MuJoCo's default, soft ones: against a
    link that is held, a disc at 0.35 m/s sinks in by 14 mm. An obstacle that has a ``contact`` has its
    stiffness and friction, and loses as much energy as ours in a hit at 0.1 m/s; what acted in a step is
    recorded where it ends.
    Soft are joint stops and dry friction: a joint goes a little beyond a stop, and creeps where it should
    stick. Torque limits do not act.

    While a step is taken, MuJoCo's global callbacks for control and warnings are in use: take steps from one
    thread only.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        The scenario, as in `vffnull.simulate`.

    Attributes
    ----------
    model : mujoco.MjModel
        The model, made by `vffnull.engines.export.to_mjcf`.
    data : mujoco.MjData
        The state.
    contacts : int
        How many contacts of a link with an obstacle MuJoCo saw when it last looked, in the last step.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run, or MuJoCo cannot simulate the arm, a link without inertia of its own
        for instance.
    ImportError
        Without the extra ``vffnull[mujoco]``.
    """

    def __init__(self, scenario: ScenarioLike) -> None:
        scenario = prepare(scenario)
        self._mujoco = mujoco = _import()
        document = scenario.to_dict()
        self._loop = _core.ExternalRun(document)
        physics = document.get("plant", {})
        try:
            with _alone(mujoco):
                self.model = mujoco.MjModel.from_xml_string(
                    to_mjcf(scenario.plant, obstacles=document.get("obstacles", []))
                )
        except ValueError as error:
            raise ScenarioError(f"not for MuJoCo: {error}") from None
        options, disable, integrator = self.model.opt, mujoco.mjtDisableBit, mujoco.mjtIntegrator
        options.timestep = setting(document, "simulation.dt")
        # MuJoCo's Euler is semi-implicit; `eulerdamp` would integrate joint damping implicitly as well.
        rk4 = setting(document, "simulation.integrator") == "rk4"
        options.integrator = integrator.mjINT_RK4 if rk4 else integrator.mjINT_EULER
        options.disableflags |= disable.mjDSBL_EULERDAMP | disable.mjDSBL_AUTORESET
        if not physics.get("joint_stops", True):
            options.disableflags |= disable.mjDSBL_LIMIT
        self.model.jnt_solref[:] = 2 * options.timestep, 1.0  # as hard as MuJoCo's joint stops can be
        self.model.jnt_solimp[:, :2] = 0.9999, 0.9999
        self.model.dof_solref[:] = 2 * options.timestep, 1.0  # and its dry friction
        self.model.dof_solimp[:, :2] = 0.9999, 0.9999
        # What is not given is that of the arm, which the model has.
        for friction, given in (
            ("dof_damping", "viscous_friction"),
            ("dof_frictionloss", "coulomb_friction"),
        ):
            if given in physics:
                getattr(self.model, friction)[:] = physics[given]
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:] = document["q0"]
        self.data.qvel[:] = document.get("dq0", 0.0)
        obstacles = document.get("obstacles", [])
        self._bodies = [int(body) for body in self.model.jnt_bodyid]  # that each joint moves
        dimension = self._loop.obstacles(0.0).shape[1]
        self._links = {body: link for link, body in enumerate(self._bodies)}
        self._felt = any("contact" in each for each in obstacles)
        if self._felt:
            options.cone = (
                mujoco.mjtCone.mjCONE_ELLIPTIC
            )  # a pyramid's edges have a regularisation of their own
        for k, obstacle in enumerate(obstacles, start=1):
            if "contact" in obstacle:
                self._stiffen(k, obstacle["contact"])
        turning = [_core.rotations(each, dimension, [0.0]) is not None for each in obstacles]
        self._turning = {k: each for k, each in enumerate(obstacles) if turning[k]}
        self._upright = matrices(self.data.mocap_quat)
        self.contacts = 0
        self._pushed = bool(document.get("wrenches"))

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
            Whether the new state is finite and slower than 10⁴ rad/s or m/s in every joint.
        """
        data = self.data
        data.time = t
        places = self._loop.obstacles(t)
        data.mocap_pos[:, : places.shape[1]] = places
        for k, obstacle in self._turning.items():
            turn = np.eye(3)
            size = places.shape[1]
            turn[:size, :size] = _core.rotations(obstacle, size, [t])
            data.mocap_quat[k] = quaternions(turn @ self._upright[k])
        if self._pushed:
            self._push(t)
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

    def touches(self) -> tuple[list[int], list[int], list[Array], list[Array]]:
        """What touched what in the last step.

        Returns
        -------
        obstacles, links : list of int
            The obstacle and the link of each contact.
        points, forces : list of (3,) ndarray
            Where they touched [m], and the force on the link [N], in the world.
        """
        model, data = self.model, self.data
        obstacles: list[int] = []
        links: list[int] = []
        points: list[Array] = []
        forces: list[Array] = []
        force = np.zeros(6)
        for k, contact in enumerate(data.contact[: data.ncon]):
            one, other = (int(model.geom_bodyid[geom]) for geom in (contact.geom1, contact.geom2))
            # MuJoCo's force is on the second geom, its frame's rows are the normal and two tangents.
            for body, obstacle, sign in ((other, one, 1.0), (one, other, -1.0)):
                link = self._links.get(int(model.body_weldid[body]))
                place = int(model.body_mocapid[obstacle])
                if link is not None and place >= 0:
                    self._mujoco.mj_contactForce(model, data, k, force)
                    obstacles.append(place)
                    links.append(link)
                    points.append(contact.pos.copy())
                    forces.append(sign * contact.frame.reshape(3, 3).T @ force[:3])
        return obstacles, links, points, forces

    def _stiffen(self, k: int, contact: Mapping[str, Any]) -> None:
        """Let an obstacle resist as its ``contact`` says.

        MuJoCo's contacts are springs R⁻¹(k r + b ṙ) with a regularisation R = (1 − d)/d · w. Its stiffest
        spring within a step, k = 1/(2 dt)², with d next to 1, and a weight w of the obstacle that makes R = k
        over the stiffness, is one of that stiffness; what links weigh is next to nothing then. A hit at
        0.1 m/s loses as much as in ours.
        """
        stiffness, damping, friction = (
            contact.get(key, default(f"obstacles.contact.{key}"))
            for key in ("stiffness", "damping", "friction")
        )
        model, name = self.model, f"obstacle_{k}"
        spring = (0.5 / model.opt.timestep) ** 2
        regular = spring / stiffness
        ratio = 2.0 / 3.0 * damping * _HIT / np.pi  # of the damping to the critical one
        mobility = model.body_invweight0[self._bodies[-1], 0]
        damper = 2.0 * ratio * np.sqrt(stiffness / mobility) * regular
        model.body_invweight0[model.body(name).id, 0] = regular * _HARD / (1.0 - _HARD)
        for geom in range(model.ngeom):
            called = model.geom(geom).name
            if called == name or called.startswith(f"{name}_"):
                model.geom_priority[geom], model.geom_condim[geom] = 1, 3
                model.geom_friction[geom, 0] = max(friction, 1e-5)  # MuJoCo's least
                model.geom_solref[geom] = -spring * _HARD, -damper * _HARD
                model.geom_solimp[geom, :2] = _HARD, _HARD

    def _push(self, t: float) -> None:
        """Let the scenario's wrenches act over the step that begins at a time [s], as they are then."""
        data = self.data
        if not np.isfinite(data.qpos).all():
            return
        self._mujoco.mj_kinematics(self.model, data)
        self._mujoco.mj_comPos(self.model, data)
        data.xfrc_applied[:] = 0.0
        for link, point, force, torque in zip(*self._loop.wrenches(t, data.qpos), strict=True):
            body = self._bodies[link]  # MuJoCo takes forces at its centre of mass
            data.xfrc_applied[body, :3] += force
            data.xfrc_applied[body, 3:] += torque + np.cross(point - data.xipos[body], force)


def run(scenario: Scenario, progress: Callable[[float, float], None] | None = None) -> dict[str, Any]:
    """Run a scenario with MuJoCo as the plant; `vffnull.simulate` makes a result of what this returns.

    Reference, governor, sensors, drives, record and metrics are the core's; MuJoCo moves the arm, and its
    state is what the sensors read. Every step is measured, whatever is recorded. ``"collided"`` and the
    metrics of clearance count the core's distances, not MuJoCo's contacts.

    Parameters
    ----------
    scenario : Scenario
        What to run.
    progress : callable, optional
        Gets the simulated time and the duration [s] about every 100 ms.

    Returns
    -------
    dict
        What the core tells of the run, as of one of its own; after Ctrl-C of what was computed until then.

    Raises
    ------
    vffnull.errors.ScenarioError
        If MuJoCo cannot simulate the arm.
    ImportError
        Without the extra ``vffnull[mujoco]``.
    """
    plant = MuJoCoPlant(scenario)
    loop, data, told = plant._loop, plant.data, time.perf_counter()
    continuous = scenario.to_dict().get("simulation", {}).get("control") == "continuous"
    try:
        while not loop.done:
            plant.step(loop.t, loop.torque if continuous else loop.drive())
            if plant._felt:
                loop.tell(*plant.touches())
            loop.arrive(data.qpos, data.qvel)
            if progress is not None and time.perf_counter() - told > _PATIENCE:
                told = time.perf_counter()
                progress(loop.t, scenario.duration)
    except KeyboardInterrupt:
        if loop.done:  # nothing else would tell of it
            raise
    outcome = loop.outcome()
    outcome["message"] = f"in MuJoCo: {outcome['message']}"
    return outcome


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
    try:  # Ctrl-C may come after any line
        mujoco.set_mjcb_control(control)
        mujoco.set_mju_user_warning(lambda _message: None)
        yield
    finally:
        try:
            mujoco.set_mjcb_control(before[0])
        finally:
            mujoco.set_mju_user_warning(before[1])
