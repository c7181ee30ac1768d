"""An arm in MuJoCo as a robot: to try a drive before it meets hardware.

The simulation takes the steps of one period whenever it gets a command, so that its time is that of the loop,
whatever the clock does.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._support.arguments import array, number
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.engines.export import to_mjcf

if TYPE_CHECKING:
    import mujoco
    from numpy.typing import ArrayLike, NDArray

    from vffnull._core import Arm
    from vffnull.model.obstacle import Obstacle
    from vffnull.model.robot import CommandKind, State

    Array = NDArray[np.float64]

__all__ = ["MuJoCoRobot"]


class MuJoCoRobot:
    """Some joints of a MuJoCo model, with an actuator each.

    Parameters
    ----------
    model : mujoco.MjModel
        The model.
    data : mujoco.MjData, optional
        Its state; a new one by default.
    joints : sequence of str, optional
        The joints in the order of the arm; by default all of them, which must be hinges or slides.
    actuators : sequence of str, optional
        The actuator of each; by default the one that acts on it.
    command : {"torque", "position", "velocity"}, optional
        What the actuators take. MuJoCo's ``motor`` takes torques, ``position`` positions and ``velocity``
        velocities; the model decides, this only says so.
    period : float, optional
        How long a command is held [s]: a whole number of the model's steps, one by default.

    Attributes
    ----------
    model, data
        MuJoCo's own. Whoever moves obstacles by hand changes `data` between periods: from `before_step`.
    before_step : callable, optional
        Gets this robot before every command is carried out, in the thread of the loop.

    Raises
    ------
    vffnull.errors.InputError
        If the model does not have such joints and actuators, or the period is no multiple of its step.
    ImportError
        Without the extra ``vffnull[mujoco]``.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData | None = None,
        *,
        joints: Sequence[str] | None = None,
        actuators: Sequence[str] | None = None,
        command: CommandKind = "torque",
        period: float | None = None,
    ) -> None:
        self._mujoco = library = extra("mujoco", "mujoco")
        self.model, self.data = model, library.MjData(model) if data is None else data
        self.command: CommandKind = command
        self.before_step: Any = None
        step = float(model.opt.timestep)
        period = step if period is None else number("period", period)
        self._steps = round(period / step) if np.isfinite(period) else 0
        if self._steps < 1 or abs(self._steps * step - period) > 1e-9 * step:
            raise InputError(f"period: must be a multiple of the model's step of {step} s, got {period}")
        ids = range(model.njnt) if joints is None else [self._id("joint", name) for name in joints]
        kinds = {int(library.mjtJoint.mjJNT_HINGE), int(library.mjtJoint.mjJNT_SLIDE)}
        if not ids or any(int(model.jnt_type[i]) not in kinds for i in ids):
            raise InputError("joints: expected hinges and slides, and at least one of them")
        self._positions = np.array([model.jnt_qposadr[i] for i in ids])
        self._velocities = np.array([model.jnt_dofadr[i] for i in ids])
        if actuators is None:
            self._controls = np.array([self._actuator_of(i) for i in ids])
        else:
            self._controls = np.array([self._id("actuator", name) for name in actuators])
        if len(self._controls) != len(self._positions):
            raise InputError(f"actuators: expected {len(self._positions)}, got {len(self._controls)}")

    @classmethod
    def from_arm(
        cls,
        arm: Arm,
        q: ArrayLike,
        *,
        obstacles: Iterable[Obstacle | Mapping[str, Any]] | None = None,
        step: float = 1e-3,
        period: float | None = None,
    ) -> MuJoCoRobot:
        """The arm with a motor per joint, as `vffnull.engines.export.to_mjcf` describes it.

        Parameters
        ----------
        arm : Arm
            The arm.
        q : (n,) array_like
            Where it is at first [rad].
        obstacles : iterable of Obstacle or Mapping, optional
            What may be touched, where it is at t = 0: bodies ``obstacle_1`` … to be moved by hand.
        step : float, optional
            MuJoCo's step [s].
        period : float, optional
            How long a command is held [s].

        Raises
        ------
        vffnull.errors.InputError
            If `q` has the wrong shape, or the period is no multiple of the step.
        ImportError
            Without the extra ``vffnull[mujoco]``.
        """
        library = extra("mujoco", "mujoco")
        model = library.MjModel.from_xml_string(to_mjcf(arm, obstacles=obstacles))
        model.opt.timestep = number("step", step)
        robot = cls(model, period=period)
        robot.data.qpos[robot._positions] = array("q", q, (arm.n,))
        return robot

    def read(self) -> State:
        """Time, positions and velocities of the joints."""
        data = self.data
        return data.time, data.qpos[self._positions], data.qvel[self._velocities]

    def write(self, command: Array, /) -> None:
        """Hold a command for a period."""
        self.data.ctrl[self._controls] = command
        if self.before_step is not None:
            self.before_step(self)
        self._mujoco.mj_step(self.model, self.data, self._steps)

    def _id(self, kind: str, name: str) -> int:
        found = self._mujoco.mj_name2id(
            self.model, getattr(self._mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), name
        )
        if found < 0:
            raise InputError(f"{kind}s: the model has no {kind} {name!r}")
        return int(found)

    def _actuator_of(self, joint: int) -> int:
        """The one actuator that acts on a joint."""
        model = self.model
        acts = model.actuator_trntype == int(self._mujoco.mjtTrn.mjTRN_JOINT)
        found = np.flatnonzero(acts & (model.actuator_trnid[:, 0] == joint))
        if len(found) != 1:
            name = model.joint(joint).name
            raise InputError(f"actuators: joint {name!r} has {len(found)}; name the one that is meant")
        return int(found[0])
