"""The compiled core: the arm, the law, the loop, and the only place where documents are validated."""

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Literal, Protocol, TypedDict, final, type_check_only

import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "ARMS",
    "ENERGIES",
    "METRICS",
    "OBJECTIVES",
    "PORTS",
    "Arm",
    "Controller",
    "Distances",
    "DriveLoop",
    "Episodes",
    "ExtendedJacobian",
    "ExternalRun",
    "Live",
    "Perceiver",
    "SimulatedRobot",
    "Simulation",
    "State",
    "Terms",
    "VirtualArm",
    "__version__",
    "arm_model",
    "arm_text",
    "check",
    "check_arm",
    "distances",
    "feasibility",
    "format_toml",
    "hull",
    "joints_at",
    "overlapping_links",
    "parse_toml",
    "parts_of_task",
    "plan",
    "plant",
    "read_urdf",
    "real_time",
    "reduce_tree",
    "matrices",
    "motion_bounds",
    "quaternions",
    "rotations",
    "run",
    "run_many",
    "schema",
    "schema_json",
    "surface_distances",
    "wrenches",
]

class _HasDocument(Protocol):
    def to_dict(self) -> dict[str, Any]: ...

_Document = Mapping[str, Any] | _HasDocument
_Scenario = _Document | str | os.PathLike[str]
_Array = NDArray[np.float64]
_Course = Literal["following", "rejoining", "waiting", "stopping", "finished"]
_Phase = Literal["starting", "running", "holding", "damping", "released", "lost", "stopping", "finished"]

__version__: str
METRICS: dict[str, tuple[str, str]]
"""Unit and one-line description of every metric, in the order in which they are shown."""
ENERGIES: tuple[str, ...]
"""The energies that are recorded: kinetic, of gravity, and what the null space stores."""
OBJECTIVES: tuple[str, ...]
"""What limits take from, first to last, and at the end the reference's speed."""
ARMS: tuple[str, ...]
"""Names of the bundled spatial arms."""
PORTS: tuple[str, ...]
"""The powers that are recorded: of the motors, then of all that feeds or drains the null space."""

@final
class Arm:
    """An arm of n links in a chain, in the plane or in space. It cannot be changed.

    The constructor makes an arm in the plane: its joints turn, joint angles are relative, joint 1 sits at
    the origin, and link 1 lies along +x at q = 0. `named`, `from_urdf` and `from_mjcf` make arms in space,
    whose joints turn [rad] or slide [m]; orientations are unit quaternions [w, x, y, z] with w ≥ 0.

    Parameters
    ----------
    lengths : (n,) array_like
        Lengths of the links [m], positive.
    masses : float or (n,) array_like
        Masses [kg], positive.
    com : (n,) or (n, 2) array_like, optional
        Centre of mass of each link in its frame [m], x along the link; the middle of the link by default.
    inertias : float or (n,) array_like, optional
        Moments of inertia about the centre of mass [kg·m²]; a uniform rod's by default.
    radius : float or (n,) array_like, optional
        Radius of the links [m] when the distance to obstacles is measured; 0 by default.
    gravity : float or (2,) array_like, optional
        Gravity [m/s²]; a single number g acts along −y, as (0, −g). 0, a horizontal plane, by default.
    joint_limits : (n, 2) array_like, optional
        Lowest and highest joint angles [rad].
    torque_limits : float or (n,) array_like, optional
        Largest joint torques [N·m].
    velocity_limits : float or (n,) array_like, optional
        Largest joint speeds [rad/s].

    Raises
    ------
    vffnull.errors.InputError
        If a parameter has the wrong length, is not finite, or makes no physical sense.
    vffnull.errors.InputTypeError
        If a parameter is not a number or an array of numbers.

    Examples
    --------
    >>> arm = Arm.uniform(6)
    >>> arm.forward_kinematics([0.0] * 6)[-1]
    array([6., 0.])
    """

    def __new__(
        cls,
        lengths: ArrayLike,
        masses: ArrayLike,
        com: ArrayLike | None = None,
        inertias: ArrayLike | None = None,
        radius: ArrayLike | None = None,
        gravity: ArrayLike | None = None,
        joint_limits: ArrayLike | None = None,
        torque_limits: ArrayLike | None = None,
        velocity_limits: ArrayLike | None = None,
    ) -> Arm: ...
    def with_load(
        self,
        mass: float,
        com: ArrayLike | None = None,
        inertia: ArrayLike | None = None,
        shapes: Sequence[Mapping[str, object]] | None = None,
    ) -> Arm:
        """The same arm with something at its tip, as part of the last link.

        Parameters
        ----------
        mass : float
            Its mass [kg], 0 or more.
        com : (3,) array_like, optional
            Its centre of mass in the frame of the tool [m]; at the tip by default, and always in the plane.
        inertia : (6,) array_like, optional
            Its moments of inertia xx, yy, zz, xy, xz, yz about that [kg·m²]; a point's by default.
        shapes : sequence of dict, optional
            What of it can touch something, each a ``shape`` as in ``[[arm.collision]]`` but in the frame of
            the tool. They say `com` and `inertia` by default, as of one material. In space alone.

        Raises
        ------
        vffnull.errors.InputError
            If it is no body.

        Examples
        --------
        >>> carries = Arm.named("panda").with_load(1.5, shapes=[{"kind": "sphere", "radius": 0.05}])
        >>> carries.collision[-1][0]
        'panda_link7'
        """

    def with_tool(self, position: ArrayLike, orientation: ArrayLike | None = None) -> Arm:
        """The same arm in space with its tip elsewhere. What a tool weighs is a load (`with_load`).

        Parameters
        ----------
        position : (3,) array_like
            Of the tip in the frame of the last link [m].
        orientation : (4,) array_like, optional
            A unit quaternion (w, x, y, z); none by default.

        Raises
        ------
        vffnull.errors.InputError
            If it is no frame, or the arm moves in the plane.
        """

    @staticmethod
    def named(name: str) -> Arm:
        """An arm in space that is bundled.

        Parameters
        ----------
        name : str
            ``"panda"``, ``"fr3"``, ``"ur5e"``, ``"ur10e"``, ``"iiwa14"``, ``"gen3"``, or ``"xarm7"``.

        Raises
        ------
        vffnull.errors.InputError
            If there is no such arm; the message lists those that there are.

        Examples
        --------
        >>> Arm.named("panda").n
        7
        """

    @staticmethod
    def from_urdf(
        path_or_text: str | os.PathLike[str],
        tip: str | None = None,
        base: str | None = None,
        locked: Mapping[str, float] | None = None,
        tool: object = None,
        mount: object = None,
        gravity: ArrayLike | None = (0.0, 0.0, -9.81),
        collision: Literal["fit", "file", "none"] = "fit",
        srdf: str | os.PathLike[str] | None = None,
        packages: (
            str
            | os.PathLike[str]
            | Sequence[str | os.PathLike[str]]
            | Mapping[str, str | os.PathLike[str]]
            | None
        ) = None,
        armature: ArrayLike | None = None,
        fix_inertia: bool = False,
        pieces: int | Mapping[str, int] = 1,
    ) -> Arm:
        """An arm in space from a URDF.

        Parameters
        ----------
        path_or_text : str or path
            A file, or the text itself.
        tip : str, optional
            The link where the chain ends; the only link without children by default.
        base : str, optional
            The link where it begins; the root by default.
        locked : dict, optional
            Joints that do not move and where they stand [rad or m]. Joints off the chain are locked
            anyway, at 0 unless they are named here.
        tool : (3,) array_like, (position, quaternion), or dict, optional
            A frame in that of the link `tip`, where the end effector is [m]; quaternions are [w, x, y, z].
        mount : the same, optional
            Where the base stands in the world.
        gravity : (3,) array_like, optional
            In the world [m/s²].
        collision : {"fit", "file", "none"}, optional
            Capsules around the links, which are measured fastest; boxes, balls and hulls as in the file; or
            nothing.
        srdf : str or path, optional
            A file, or the text: pairs of links that it switches off are not measured against each other, and
            no others. Without it, those whose shapes overlap nearly always are not, with a warning.
        packages : path, list of paths, or dict, optional
            Folders in which meshes are searched, or the folder of each package by its name.
        armature : float or (n,) array_like, optional
            Inertia of the rotors as seen by the joints [kg·m²]; URDF has none.
        fix_inertia : bool, optional
            Replace impossible inertia tensors by the nearest possible ones, with a warning.
        pieces : int or dict, optional
            With ``collision="file"``: the most hulls that a mesh may become, of each link or of those named.

        Raises
        ------
        vffnull.errors.InputError
            If the text is no URDF, or what is asked for is no arm; the message says which link or joint.
        ImportError
            If meshes have to be read and the extra ``meshes`` is not installed.

        See Also
        --------
        vffnull.arms.read_urdf : the same, and what is odd, how tight the shapes are.
        """

    @staticmethod
    def from_mjcf(
        path_or_model: Any,
        tip: str | None = None,
        base: str | None = None,
        locked: Mapping[str, float] | None = None,
        tool: object = None,
        mount: object = None,
        gravity: ArrayLike | None = None,
        collision: Literal["fit", "file", "none"] = "fit",
        srdf: str | os.PathLike[str] | None = None,
        armature: ArrayLike | None = None,
        fix_inertia: bool = False,
        pieces: int | Mapping[str, int] = 1,
    ) -> Arm:
        """An arm in space from an MJCF or a ``mujoco.MjModel``.

        Armature, joint damping and dry friction are taken over. Bodies become links, hinges revolute (or
        continuous, where they have no range) and slides prismatic joints.

        Parameters
        ----------
        path_or_model : str, path or mujoco.MjModel
            A file, the text itself, or a model.
        tip : str, optional
            The body or site where the chain ends; the only body without children by default.
        base : str, optional
            The body where it begins; ``world`` by default.
        locked : dict, optional
            Joints that do not move and where they stand [rad or m]. Joints off the chain are locked
            anyway, at 0 unless they are named here.
        tool : (3,) array_like, (position, quaternion), or dict, optional
            A frame in that of `tip`, where the end effector is [m]; quaternions are [w, x, y, z].
        mount : the same, optional
            Where the base stands in the world.
        gravity : (3,) array_like, optional
            In the world [m/s²]; the model's by default.
        collision : {"fit", "file", "none"}, optional
            As in `from_urdf`.
        srdf : str or path, optional
            As in `from_urdf`.
        armature : float or (n,) array_like, optional
            Inertia of the rotors as seen by the joints [kg·m²]; the model's by default.
        fix_inertia : bool, optional
            Replace impossible inertia tensors by the nearest possible ones, with a warning.
        pieces : int or dict, optional
            As in `from_urdf`.

        Raises
        ------
        vffnull.errors.InputError
            If MuJoCo cannot compile the model, or what is asked for is no arm.
        ImportError
            If MuJoCo is not installed.

        See Also
        --------
        vffnull.arms.read_mjcf : the same, and what is odd, how tight the shapes are.
        """

    @staticmethod
    def uniform(
        n: int, length: float = 1.0, mass: float = 1.0, radius: float = 0.0, gravity: float = 0.0
    ) -> Arm:
        """An arm of n equal uniform rods.

        Parameters
        ----------
        n : int
            Number of links, at least 1.
        length : float, optional
            Length of each link [m].
        mass : float, optional
            Mass of each link [kg].
        radius : float, optional
            Radius of each link [m].
        gravity : float, optional
            Gravity along −y [m/s²].
        """

    @property
    def n(self) -> int:
        """Number of joints."""
    @property
    def lengths(self) -> _Array:
        """Lengths of the links, (n,) [m]; of an arm in the plane alone."""
    @property
    def masses(self) -> _Array:
        """Masses of the links, (n,) [kg]."""
    @property
    def com(self) -> _Array:
        """Centres of mass in the links' frames, (n, 2) or (n, 3) [m]."""
    @property
    def inertias(self) -> _Array:
        """Inertia about the centres of mass, (n,), or in space (n, 3, 3) in the links' axes [kg·m²]."""
    @property
    def radius(self) -> _Array:
        """Radii of the links, (n,) [m]; of an arm in the plane alone."""
    @property
    def gravity(self) -> _Array:
        """Acceleration of free fall in the world, (2,) or (3,) [m/s²]."""

    @property
    def dimension(self) -> int:
        """Number of dimensions of the space that the arm moves in, 2 or 3."""
    @property
    def joint_names(self) -> list[str]:
        """Names of the joints, from the base."""
    @property
    def link_names(self) -> list[str]:
        """Names of the links that the joints move, from the base."""
    @property
    def joint_limits(self) -> _Array | None:
        """Lowest and highest joint positions, (n, 2) [rad or m]; None without limits."""
    @property
    def velocity_limits(self) -> _Array | None:
        """Largest joint speeds, (n,) [rad/s or m/s]; None without limits."""
    @property
    def torque_limits(self) -> _Array | None:
        """Largest joint torques or forces, (n,) [N·m or N]; None without limits."""
    @property
    def collision(self) -> list[tuple[str, dict[str, Any]]]:
        """What is measured against obstacles and other links: names of links and shapes in their frames."""

    def pose(self, q: ArrayLike) -> tuple[_Array, _Array]:
        """Position and orientation of the tip.

        Parameters
        ----------
        q : (n,) array_like
            Joint positions [rad or m].

        Returns
        -------
        position : (2,) or (3,) ndarray
            In the world [m].
        orientation : (4,) or () ndarray
            A unit quaternion [w, x, y, z] with w ≥ 0; in the plane the angle to the x axis [rad].
        """

    def link_poses(self, q: ArrayLike) -> _Array: ...
    def tip_poses(self, q: ArrayLike) -> _Array: ...
    def forward_kinematics(self, q: ArrayLike) -> _Array:
        """Positions of the joints; the last row is the tip.

        Parameters
        ----------
        q : (n,) or (T, n) array_like
            Joint positions [rad or m].

        Returns
        -------
        (n+1, 2) or (n+1, 3) ndarray, (T, n+1, 2) or (T, n+1, 3) for T configurations
            Positions [m].
        """

    def jacobian(self, q: ArrayLike) -> _Array:
        """Jacobian J of the tip, (2, n): ẋ = J q̇ (eq. 2 of the paper).

        In space it is (6, n): the velocity of the tip, then its angular velocity, both in world axes.
        """

    def jacobian_dot(self, q: ArrayLike, dq: ArrayLike) -> _Array:
        """Time derivative of the Jacobian, (2, n) or (6, n)."""

    def mass_matrix(self, q: ArrayLike) -> _Array:
        """Mass matrix M, (n, n) [kg·m²], with the armature of the joints; symmetric and positive definite."""

    def coriolis_matrix(self, q: ArrayLike, dq: ArrayLike) -> _Array:
        """Coriolis matrix C by Christoffel symbols, (n, n) [N·m·s]: Ṁ = C + Cᵀ."""

    def gravity_torque(self, q: ArrayLike) -> _Array:
        """Torque g that holds the arm against gravity, (n,) [N·m]."""

    def inverse_dynamics(self, q: ArrayLike, dq: ArrayLike, ddq: ArrayLike) -> _Array:
        """Torque of a motion, M q̈ + C q̇ + g, (n,) [N·m].

        Parameters
        ----------
        q, dq, ddq : (n,) array_like
            Joint positions [rad or m], velocities, accelerations.
        """

    def forward_dynamics(self, q: ArrayLike, dq: ArrayLike, tau: ArrayLike) -> _Array:
        """Acceleration under a torque, M⁻¹(τ − C q̇ − g), (n,) [rad/s²], in O(n).

        Parameters
        ----------
        q, dq, tau : (n,) array_like
            Joint positions [rad or m], velocities, torques [N·m] or forces [N].
        """

    def kinetic_energy(self, q: ArrayLike, dq: ArrayLike) -> float:
        """Kinetic energy ½ q̇ᵀM q̇ [J]."""

    def potential_energy(self, q: ArrayLike) -> float:
        """Potential energy in gravity [J]; 0 with every centre of mass at the height of the origin."""

    def extended_jacobian(self, q: ArrayLike, dq: ArrayLike) -> ExtendedJacobian:
        """The split into task and null space at a state, with every matrix (eq. 6–15, corrected).

        The task is that of `jacobian`: the position of the tip in the plane, its pose in space.

        Parameters
        ----------
        q, dq : (n,) array_like
            Joint positions [rad or m] and velocities.
        """

    def to_mjcf(self, name: str | None = None) -> str:
        """The arm as MJCF, for MuJoCo; see `vffnull.engines.export.to_mjcf`."""

    def to_urdf(self, name: str | None = None) -> str:
        """The arm as URDF; see `vffnull.engines.export.to_urdf`."""

    def to_dict(self) -> dict[str, Any]:
        """The arm as a part of a scenario document; no other file is needed to make it again."""

    def _repr_html_(self) -> str | None: ...

@final
class ExtendedJacobian:
    """Task and null space of an arm at one state; m rows of `jacobian`, r = n − m.

    The extended velocity (ẋ, ν) = J_e q̇ is made of the tip's velocity and r coordinates of the motion that
    the tip does not see.
    """

    @property
    def Z(self) -> _Array:
        """Orthonormal basis of the null space, (n, r): J Z = 0."""
    @property
    def N_M(self) -> _Array:
        """Null-space velocity map (ZᵀMZ)⁻¹ZᵀM, (r, n): ν = N_M q̇ (eq. 7, 8)."""
    @property
    def J_e(self) -> _Array:
        """Extended Jacobian [J; N_M], (n, n) (eq. 9)."""
    @property
    def J_e_inv(self) -> _Array:
        """Its inverse [J#, Z], (n, n)."""
    @property
    def E_e(self) -> _Array:
        """Extended inertia J_e⁻ᵀ M J_e⁻¹, (n, n); block diagonal (eq. 13)."""
    @property
    def mu(self) -> _Array:
        """Extended Coriolis matrix J_e⁻ᵀ(C − M J_e⁻¹ J̇_e)J_e⁻¹, (n, n) (eq. 13)."""
    @property
    def Lambda_x(self) -> _Array:
        """Inertia that the tip shows, (m, m) [kg, and kg·m² of its turns]."""
    @property
    def Lambda_n(self) -> _Array:
        """Inertia in the null space, (r, r) [kg·m²]."""
    @property
    def N(self) -> _Array:
        """Dynamically consistent null-space projector I − J#J, (n, n)."""

@final
class Controller:
    """The torque law alone, for a loop of your own. Threads that share one take turns.

    Parameters
    ----------
    arm : Arm
        The arm's model.
    settings : ControlSettings or dict, optional
        Gains, field, and variant of the law; the defaults of a scenario if not given.
    period : float, optional
        Control period [s] of your loop: gains that a torque held so long makes unstable are warned of.

    strict : bool, optional
        Whether `torque` and `terms` raise where the torque is not finite, which states and references beyond
        all reason (1e154 rad/s) lead to; by default it is returned, and `Terms.finite` is False.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the settings do not suit the arm.

    Notes
    -----
    A call that is interrupted, and one whose torque is not finite, leaves the controller as new: an energy
    tank is as full as at the start.

    Examples
    --------
    >>> controller = Controller(Arm.uniform(6), {"stiffness": 16.0, "damping": 8.0})
    >>> controller.torque([0.1] * 6, [0.0] * 6, x_ref=[4.0, 2.0]).shape
    (6,)
    """

    def __new__(
        cls,
        arm: Arm,
        settings: _Document | None = None,
        period: float | None = None,
        strict: bool = False,
    ) -> Controller: ...
    def torque(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        x_ref: ArrayLike | tuple[ArrayLike, ArrayLike],
        dx_ref: ArrayLike | None = None,
        ddx_ref: ArrayLike | None = None,
        obstacles: Sequence[_Document] = (),
        t: float = 0.0,
    ) -> _Array:
        """Joint torque at a state.

        Parameters
        ----------
        q, dq : (n,) array_like
            Joint angles [rad] and velocities [rad/s].
        x_ref : (m,) array_like, or a pair of them
            Reference of the end effector. A position [m]; for the task ``"pose"`` in the plane with an angle
            [rad] after it. For ``"pose"`` and ``"pointing"`` in space (7,), the position and a unit
            quaternion (w, x, y, z), or the pair of both. It is taken as it is: the settings' `governor` acts
            in simulations alone.
        dx_ref, ddx_ref : (m,) array_like, optional
            Its velocity [m/s] and acceleration [m/s²]; 0 if not given. With an orientation, angular ones
            [rad/s, rad/s²] follow; in space these are (6,), in world axes.
        obstacles : sequence of Obstacle or dict, optional
            What to keep away from; nothing by default.
        t : float, optional
            Time [s] at which the obstacles' motions are taken, and by which `observer` and `tank` go on: in a
            loop with these it has to be given.

        Returns
        -------
        (n,) ndarray
            Joint torque [N·m], as the settings' `command` wants it: without gravity for a robot that adds it
            itself, and so on. Its rate is limited by `cycle` alone, which knows the period.

        Raises
        ------
        vffnull.errors.InputError
            If an array has the wrong shape or is not finite.
        """

    def terms(
        self,
        q: ArrayLike,
        dq: ArrayLike,
        x_ref: ArrayLike | tuple[ArrayLike, ArrayLike],
        dx_ref: ArrayLike | None = None,
        ddx_ref: ArrayLike | None = None,
        obstacles: Sequence[_Document] = (),
        t: float = 0.0,
    ) -> Terms:
        """The torque of the law with its parts, whatever `command` makes of it; parameters as in `torque`."""

    def reset(self) -> None:
        """Forget the past, so that the next state may be at any time.

        An energy tank is as full as at the start, an observer knows nothing, a look-ahead follows no
        candidate. A loop that is over is left by it, and set points that have finished.

        Examples
        --------
        A second run whose time begins at 0 again begins with it.

        >>> controller = Controller(Arm.uniform(6), {"tank": {"capacity": 0.1, "initial": 0.02}})
        >>> first = controller.torque([0.1] * 6, [0.5] * 6, x_ref=[4.0, 2.0], t=0.0)
        >>> controller.reset()
        >>> (first == controller.torque([0.1] * 6, [0.5] * 6, x_ref=[4.0, 2.0], t=0.0)).all()
        np.True_
        """

    def update_points(
        self, cloud: ArrayLike, obstacle: int = 0, velocities: ArrayLike | None = None, t: float | None = None
    ) -> None:
        """Put other points in place of those of a cloud, one of the obstacles of the last call.

        They stay as long as calls are given the very same obstacles. The cloud keeps its place, its motion
        and its radius. Its boxes are built beside the controller, with the GIL released, and swapped in at
        once, so that a loop in another thread goes on meanwhile.

        Parameters
        ----------
        cloud : (k, 3) array_like
            The points [m], relative to the obstacle's position: at most 50 000, maybe none.
        obstacle : int, optional
            Which of the obstacles it is; the first by default.
        velocities : (k, 3) array_like, optional
            At which velocities the points go on by themselves [m/s], in the same frame, until others take
            their place (docs/theory-spatial.md, T180). Without, they rest.
        t : float, optional
            When they were there [s], on the clock of the calls: that of the image. Without, the last call's.

        Raises
        ------
        vffnull.errors.InputError
            If they are not points in space, not finite or too many, if there is not one velocity to each, or
            if the obstacle is no cloud. The points are those of before then.

        Examples
        --------
        >>> from vffnull import Arm, Controller, Obstacle
        >>> controller, cloud = Controller(Arm.named("panda")), Obstacle.points([[0.4, 0.0, 0.3]], 0.02)
        >>> rest, there = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.5, 0.0, 0.5]
        >>> far = controller.torque(rest, [0.0] * 7, there, obstacles=[cloud])
        >>> controller.update_points([[0.45, 0.0, 0.45], [0.45, 0.1, 0.45]])
        >>> near = controller.torque(rest, [0.0] * 7, there, obstacles=[cloud])
        """

    def begin(self, period: float, tau: ArrayLike | None = None) -> None:
        """Begin a loop that is watched over: from now on `cycle` says what is to be sent to the robot.

        The torque is blended in over the time `blend_time` of the settings' `command`, so that nothing jumps.
        Set points of a `VirtualArm` with this controller are over then.

        Parameters
        ----------
        period : float
            Control period [s] of your loop.
        tau : (n,) array_like, optional
            The measured torque [N·m] to blend from; with the gravity torque only if the robot does not add
            that itself. It is not believed where it is not finite, beyond the arm's torque limits, or farther
            than half of them from what holds the arm still by the model, which is also what is taken if none
            is given. Until the first state it is sent, or nothing if it is not known.

        Raises
        ------
        vffnull.errors.InputError
            If the period is not positive, or too long for the settings' gains or their `stop_damping`.
        """
    def cycle(
        self,
        t: float | None = None,
        q: ArrayLike | None = None,
        dq: ArrayLike | None = None,
        x_ref: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
        dx_ref: ArrayLike | None = None,
        ddx_ref: ArrayLike | None = None,
        obstacles: Sequence[_Document] = (),
    ) -> tuple[_Array, _Phase]:
        """One cycle of a loop that has begun: what is to be sent to the robot, and what state the loop is in.

        What is sent is finite, within the arm's torque limits, and changes by no more than `torque_rate`.
        A state that is missing (None), no newer than the last, not finite, or not to be reached from the last
        counts as missing, and is no error: after fewer than `missed_cycles` such
        cycles what was sent last is held, then the arm is damped as if it came to rest from its last
        velocity, then only gravity is held, if that is ours, and in the end the loop is lost;
        docs/tutorials/own-loop.md has the times.

        Parameters
        ----------
        t : float, optional
            When the state was measured [s]; also the time at which the obstacles' motions are taken.
        q, dq : (n,) array_like, optional
            Joint angles [rad] and velocities [rad/s].
        x_ref, dx_ref, ddx_ref : array_like, optional
            Reference of the end effector, as in `torque`. Without `x_ref` its motion is damped wherever it
            is.
        obstacles : sequence of Obstacle or dict, optional
            What to keep away from; nothing by default.

        Returns
        -------
        tau : (n,) ndarray
            What is to be sent in this cycle [N·m], whatever the phase is.
        phase : str
            ``"starting"``, ``"running"``; ``"holding"``, ``"damping"``, ``"released"`` and in the end
            ``"lost"`` where the state is missing; ``"damping"``, too, where a joint is faster than twice its
            limit; ``"stopping"`` and in the end ``"finished"`` after `stop`.

        Raises
        ------
        vffnull.errors.InputError
            If no loop has begun, an array has the wrong shape, or a reference is not finite.

        Examples
        --------
        >>> settings = {"command": {"gravity": "robot", "torque_rate": 1000.0}}
        >>> controller = Controller(Arm.named("panda"), settings)
        >>> controller.begin(0.001)
        >>> q, dq = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7
        >>> tau, phase = controller.cycle(0.0, q, dq, x_ref=[0.5, 0.0, 0.5])
        >>> phase
        'starting'
        """
    def sense(self, tau_ext: ArrayLike) -> None:
        """Let the law know what the robot measures of the torque from outside, for the states that come.

        It counts with ``observer = {"source": "measured"}`` in the settings, until the next time; `drive`
        does this with a robot's ``external_torque``.

        Parameters
        ----------
        tau_ext : (n,) array_like
            The measured torque [N·m] that the surroundings exert on the joints. A Franka's
            ``tau_ext_hat_filtered`` counts what the robot exerts: its negative belongs here. One that is not
            finite changes nothing.

        Raises
        ------
        vffnull.errors.InputError
            If it has the wrong shape.

        Examples
        --------
        >>> arm = Arm.named("panda")
        >>> controller = Controller(arm, {"observer": {"source": "measured"}})
        >>> controller.sense([0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        >>> rest = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
        >>> tau = controller.torque(rest, [0.0] * 7, arm.pose(rest)[0])
        >>> controller.tau_ext_estimate
        array([0., 5., 0., 0., 0., 0., 0.])
        """

    @property
    def touched_link(self) -> int | None:
        """The link on which a contact is felt at the last state, or one beyond it, counted from 0; None while
        none is felt, and without ``observer.detection``.
        """
    @property
    def tau_ext_estimate(self) -> _Array | None:
        """The torque from outside at the last state, as estimated, (n,) [N·m]; None without an observer."""
    @property
    def wrench_estimate(self) -> _Array | None:
        """The wrench at the end effector that this is, (m,) [N, N·m]; None without an observer."""
    @property
    def left_out(self) -> dict[str, int]:
        """What was left out since the loop began: ``late``, cycles that took longer than the
        deadline; ``cut``, cycles in which the look-ahead stopped for lack of time; ``rollouts`` that it did
        not make because of that; ``points`` of clouds beyond the 64 that ``cbf`` keeps of a link, counted
        once a cycle; ``programs`` that ended with constraints left.
        """
    def stop(self) -> None:
        """End the loop safely: from the next cycle on the arm is damped until it stands, and the loop is
        finished.
        """
    @property
    def phase(self) -> _Phase | None:
        """What the last cycle came to, as `cycle` names it; None if no loop has begun."""
    def stable_period(
        self, q: ArrayLike, obstacles: Sequence[_Document] = (), t: float = 0.0
    ) -> tuple[float, float, float]:
        """The longest time that the torque may be held at a configuration before the null space oscillates.

        Parameters
        ----------
        q : (n,) array_like
            Joint angles [rad].
        obstacles : sequence of Obstacle or dict, optional
            What is near.
        t : float, optional
            Time [s] at which the obstacles' motions are taken.

        Returns
        -------
        period : float
            The largest stable control period [s] (docs/theory.md, T34).
        stiffness : float
            Stiffness of the field [N/m] at the contact that sets it; 0 if the null damping does.
        clearance : float
            Clearance of that contact [m]; infinite without one.

        Raises
        ------
        vffnull.errors.InputError
            If an array has the wrong shape or is not finite.
        """

@final
class Terms:
    """The parts of the torque at one state."""

    @property
    def tau(self) -> _Array:
        """Joint torque, (n,) [N·m]."""
    @property
    def tau_task(self) -> _Array:
        """What serves the task, and what makes it give way, (n,) [N·m]."""
    @property
    def tau_null(self) -> _Array:
        """What acts in the null space, (n,) [N·m]."""
    @property
    def tau_vff(self) -> _Array:
        """Repulsion Σ JᵢᵀFᵢ before its projection, (n,) [N·m]."""
    @property
    def force(self) -> _Array:
        """Magnitude of the repulsion on each link, (n,) [N]."""
    @property
    def clearance(self) -> _Array:
        """Signed distance of each link's surface to the nearest obstacle's, (n,) [m]."""
    @property
    def slack(self) -> float | None:
        """By how much barriers are violated at most [m/s²]; None without ``avoidance="cbf"``."""
    @property
    def N(self) -> _Array:
        """Null-space projector, (n, n)."""
    @property
    def energy(self) -> _Array:
        """Energies as named in `ENERGIES`, (3,) [J]."""
    @property
    def power(self) -> _Array:
        """Powers as named in `PORTS`, (6,) [W]."""
    @property
    def objective_scale(self) -> _Array:
        """What the limits let through of each of `OBJECTIVES`, (6,), from 0 to 1."""
    @property
    def tank(self) -> float | None:
        """Energy in the tank [J]; None without one."""
    @property
    def self_clearance(self) -> float:
        """Signed distance of the nearest two links that share no joint [m]; infinite if not measured."""
    @property
    def manipulability(self) -> float:
        """√det(J Jᵀ), 0 in a singularity [m², for a task in space m³]."""
    @property
    def singular(self) -> bool:
        """Whether the task force is damped because of a singularity."""
    @property
    def null_acceleration(self) -> float:
        """‖J M⁻¹ τ_null‖ [m/s²]: what leaks into the task."""
    @property
    def finite(self) -> bool:
        """Whether the torque is finite: it is not at states and references beyond what numbers can hold."""

@final
class Distances:
    """What `distances` returns; P pairs, one per link and obstacle, link by link.

    In space a link has one pair for each of its shapes.

    For a batch of states every array but `link` and `obstacle` has the batch as its first dimension.
    """

    @property
    def link(self) -> NDArray[np.int64]:
        """Link of each pair, from 0 at the base, (P,)."""
    @property
    def obstacle(self) -> NDArray[np.int64]:
        """Obstacle of each pair, in the order given, (P,)."""
    @property
    def distance(self) -> _Array:
        """Signed distance d of the two surfaces, (P,) [m]; negative in penetration."""
    @property
    def gradient(self) -> _Array:
        """Derivative of d by the joint positions, n̂ᵀJ_c, (P, n) [m/rad or m/m]."""
    @property
    def rate(self) -> _Array:
        """Rate ḋ, the motion of the obstacle included, (P,) [m/s]."""
    @property
    def bias(self) -> _Array:
        """Acceleration d̈ while the joints do not accelerate, (P,) [m/s²]: d̈ = gradient @ ddq + bias."""
    @property
    def normal(self) -> _Array:
        """Unit vector n̂ from the obstacle towards the link, (P, 2) or (P, 3)."""
    @property
    def point(self) -> _Array:
        """Nearest point on the axis of the link, of a box or hull on its surface, (P, 2) or (P, 3) [m]."""
    @property
    def witness(self) -> _Array:
        """Nearest point on the surface of the obstacle, (P, 2) or (P, 3) [m]."""

@final
class State:
    """A simulation at one instant; m is 2 for a position and 3 for a pose."""

    @property
    def t(self) -> float:
        """Time [s]."""
    @property
    def q(self) -> _Array:
        """Joint angles, (n,) [rad]."""
    @property
    def dq(self) -> _Array:
        """Joint velocities, (n,) [rad/s]."""
    @property
    def x(self) -> _Array:
        """End effector, (m,) [m]; in space its position, (3,)."""
    @property
    def dx(self) -> _Array:
        """Its velocity, (m,) [m/s]."""
    @property
    def x_ref(self) -> _Array:
        """Its reference, (m,) [m]."""
    @property
    def clearance(self) -> _Array:
        """Signed distance of each link to the nearest obstacle, (n,) [m]."""
    @property
    def tau(self) -> _Array:
        """Joint torque, (n,) [N·m]."""
    @property
    def obstacles(self) -> _Array:
        """Positions of the obstacles, (k, 2) or (k, 3) [m]."""
    @property
    def q_measured(self) -> _Array | None:
        """Joint angles as measured, for a controller of your own, (n,) [rad]; None without sensors."""
    @property
    def dq_measured(self) -> _Array | None:
        """Joint velocities as measured, (n,) [rad/s]; None without sensors."""
    @property
    def tau_ext(self) -> _Array | None:
        """Torque of wrenches and contacts that push the arm from now on, (n,) [N·m]; None without any."""
    @property
    def contact_force(self) -> _Array | None:
        """Force of each obstacle on the arm, (k, D) [N]; None where none has a `contact`."""

    @property
    def touched_link(self) -> int | None:
        """Link on which a contact is felt, or one beyond it, counted from 0; None while none is felt."""
    @property
    def yielded(self) -> float | None:
        """How far the end effector gives way to a push [m]; None where it never does."""
    @property
    def released(self) -> float | None:
        """How many parts of its task the look-ahead lets go, in their `order`; None without both."""
    @property
    def tau_ext_estimate(self) -> _Array | None:
        """Torque that the model does not know, as estimated, (n,) [N·m]; None without an observer."""
    @property
    def wrench_estimate(self) -> _Array | None:
        """The wrench at the end effector that this is, (m,) [N, N·m]; None without an observer."""
    @property
    def sensed(self) -> _Array | None:
        """Points that the range sensors have met, (rays, 2) [m], NaN for none; None without sensors."""

    @property
    def tau_applied(self) -> _Array | None:
        """Torque at the joints, (n,) [N·m], with what a robot adds itself; None where it is `tau`."""

@type_check_only
class SelfMotionMap(TypedDict):
    """What a search of the self-motion has found; see `Simulation.self_motion_map`."""

    distances: _Array
    """(places, instants) [m]."""
    path: NDArray[np.int64]
    """(instants,), or empty."""
    spacing: float
    """[rad]."""
    step: float
    """[s]."""
    elapsed: float
    """[s]."""
    margin: float
    """[m]."""
    clearance: float
    """[m]."""

@type_check_only
class LiveState(TypedDict):
    """A live loop at one instant, in SI units; n joints, k obstacles, a task of dimension m."""

    status: Literal["running", "paused", "diverged", "failed"]
    message: str
    rate: float
    """Periods per second of late [Hz]."""
    periods: int
    missed: int
    """Periods that were not over when the next one should have begun."""
    worst: float
    """The longest computation of a period so far [s]."""
    min_clearance: float
    """Since the start or the last reset [m], without what a tip presses on; inf without obstacles."""
    metrics: dict[str, float | int | None]
    """What `METRICS` names, since the start or the last reset; there is no tail."""
    recording: bool
    t: float
    q: _Array
    dq: _Array
    x: _Array
    x_ref: _Array
    error: _Array
    clearance: _Array
    """Of every link [m], that of a tip that presses on something from all else."""
    released: list[str | None] | None
    """The parts of the task that the look-ahead lets go, None for the rest; None without an order."""
    pressed: float | None
    """What obstacles that are felt press the arm with, all of them [N]; None where none is felt."""
    tau: _Array
    tau_vff: _Array
    power: _Array
    """Through the ports that `PORTS` names [W]."""
    obstacles: _Array
    """Positions, (k, D) [m]."""
    sensed: _Array
    """What sensors have measured of them, (s, D) [m]."""
    turns: _Array
    """How the obstacles are turned since the start, (k, D, D)."""
    points: _Array
    """Where the repulsion acts on each link, (n, D) [m]."""
    forces: _Array
    """The repulsion, (n, D) [N]."""
    wrench_points: _Array
    """Where the scenario's wrenches push, (w, D) [m]."""
    wrench_forces: _Array
    """Their forces, (w, D) [N]."""
    pull_point: _Array
    """Where a link is held, (1, D) [m], or (0, D)."""
    pull_force: _Array
    """The force that it is pulled with, (1, D) [N], or (0, D)."""
    pull_anchor: _Array
    """Where it is pulled to, (1, D) [m], or (0, D)."""
    q_plan: _Array | None
    """Where the plan has the joints; None if the reference is none."""
    replans: int
    """Plans that were taken over so far, and how often the arm got stuck: with ``[replan]``."""
    times_stuck: int
    search: str | None
    """What came of the last search for a plan, "searching" before its end; None if there was none."""
    has_plans: bool
    """Whether there is a plan, or may be one later, so that a recording has room for it."""

@final
class Live:
    """A scenario that runs at 1 kHz against the wall clock, on a thread of its own, while people interfere.

    Parameters
    ----------
    scenario : Scenario, dict, str or path
        What to run; its duration is of no meaning.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run.
    """

    def __new__(cls, scenario: _Scenario) -> Live: ...
    def start(self) -> None:
        """Begin, or go on after a pause."""
    def pause(self) -> None:
        """Stand still until `start`."""
    def reset(self) -> None:
        """Go back to t = 0 of the scenario, with the present settings of the controller; a pause goes on."""
    def stop(self) -> None:
        """End the thread. In a fork of the process there is none."""
    def configure(self, controller: _Document) -> None:
        """Take over other settings of the controller: all of them, as in `[controller]` of a scenario."""
    def carry(self, obstacle: int, place: ArrayLike) -> None:
        """Take an obstacle to a place (D,) [m], smoothly and not faster than half the reach per second."""
    def aim(self, place: ArrayLike) -> None:
        """Take the reference to a place (D,) [m] or as near to it as the arm can reach, smoothly and not
        faster than a quarter of the reach per second.
        """
    def plan(self) -> None:
        """Plan a motion to where the reference comes to rest, such as where the target is, in a thread of its
        own, and follow it when it is found; `search` of a snapshot says what has come of it. Without
        `[replan]` others follow only where that is blocked, and a recording ends that has no plans.
        """

    def grab(self, link: str, point: ArrayLike) -> None:
        """Take hold of a link at a point (D,) of its frame [m], with a spring that `pull_by` lets pull."""

    def pull_by(self, offset: ArrayLike) -> None:
        """Pull the link towards the place that is so far (D,) [m] from where it was taken hold of."""

    def let_go(self) -> None:
        """Let go of the link."""

    def turn(self, obstacle: int, orientation: ArrayLike) -> None:
        """Turn an obstacle in space to an orientation (4,) on the short way, at 4 rad/s."""
    def turn_target(self, orientation: ArrayLike) -> None:
        """Turn the reference to an orientation (4,) on the short way, smoothly, at 1 rad/s at most."""
    def update_points(
        self, cloud: ArrayLike, obstacle: int = 0, velocities: ArrayLike | None = None, t: float | None = None
    ) -> None:
        """Replace the points (k, 3) of a cloud [m]. They are made ready beside the loop, and taken in between
        two of its steps; with `velocities` (k, 3) [m/s] they go on from where they were at time `t` [s].
        """
    def add(self, obstacle: _Document) -> None:
        """Add an obstacle, the last one from now on. Ends a recording."""
    def remove(self, obstacle: int) -> None:
        """Take an obstacle away; those behind it move up. Ends a recording."""
    def record(self, on: bool) -> None:
        """Begin to record a row every 10 ms, or end it."""
    def take(self) -> tuple[dict[str, Any] | None, int]:
        """The rows recorded since the last call, as arrays; None if nothing is recorded. And how many were
        lost since the recording began, because nobody took them within ten seconds.
        """
    def pictures(self) -> list[NDArray[np.float32]]:
        """The pictures of depth cameras that arrived last, (rows, columns) [m] each, 0 where nothing was
        measured; none without such cameras.
        """
    def self_motion_map(self) -> SelfMotionMap | None:
        """What the search of the self-motion has found last; see `Simulation.self_motion_map`."""
    def snapshot(self) -> LiveState:
        """The present instant."""
    @property
    def notes(self) -> list[str]:
        """What was changed for the clock or is odd, in sentences."""

@final
class Perceiver:
    """From pictures of depth cameras to a cloud of points that move: what is there that nobody has said.

    One call for each picture, beside the control cycle, in a thread of its own. What a picture shows of the
    arm is cut away, what is left is remembered in cells of a grid until it is seen through or its time is
    up, and cells that hang together are followed, so that each point has a velocity
    (docs/theory-spatial.md, T181 to T184, T197).

    Parameters
    ----------
    arm : Arm
        An arm in space, with its tool and what it carries among its ``collision`` shapes.
    cameras : sequence of dict
        ``columns``, ``rows``, ``focal`` and ``centre`` (2,) [pixels], ``distortion`` k1, k2, p1, p2, k3 in
        the order of OpenCV, none by default, ``position`` (3,) [m] and ``orientation`` (4,): a quaternion
        [w, x, y, z] of its frame in the world, z forward, x to the right of the picture, y down.
    settings : dict, optional
        ``room``: opposite corners of what is looked at, in the world (2, 3) [m], from (-1, -1, -0.2) to (1,
        1, 1.4); ``voxel``: the side of a cell, 0.02 m; ``most_voxels``: 25000 of them are remembered at most;
        ``stride``: every 2nd row and column is looked at; ``range``: up to 3 m deep; ``least_points``: 2 in a
        cell or more count, or half of the pixels that look at one that is far away; ``memory``: for 2 s what
        is hidden is remembered; ``margin``: 0.02 m around the arm are cut away, and as much more as it moves
        in ``time_error``, 0.02 s; ``time_offset``: 0 s are added to times of pictures; ``latest_state``: one
        of the arm is known within 0.05 s; ``depth_error``: 0.005 m at 1 m; ``hidden``, 0 m: bodies up to this
        wide are taken for as deep as they are wide, and have points on the side that is not seen, round ones
        all around;
        ``known_margin``: 0.02 m around what is known are left out; ``settling``: what is in its place for 1 s
        counts as standing; ``acceleration``, 3 m/s^2, ``speed``, 1 m/s, and ``track_error``, 0.002 m:
        standard deviations of bodies that are followed. The numbers are the defaults.
    known : sequence of Obstacle or dict, optional
        What stands around and the controller knows of: it is not seen again. What moves is refused.

    Raises
    ------
    vffnull.errors.InputError
        If a camera or a setting is of no use, the arm is in the plane or does not reach into the room, or
        something that is known moves.

    Examples
    --------
    >>> import numpy as np
    >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
    ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
    >>> perceiver = Perceiver(Arm.named("panda"), [camera], {"stride": 1})
    >>> perceiver.observe(0.0, [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7)
    >>> counts = perceiver.see(np.full((60, 80), 1000, dtype=np.uint16), t=0.0)  # a board at 0.5 m
    >>> counts["measured"], counts["own"] > 0, float(perceiver.points[:, 2].min())
    (4800, True, 0.5)
    """

    def __new__(
        cls,
        arm: Arm,
        cameras: Iterable[_Document],
        settings: _Document | None = None,
        known: Iterable[_Document] = (),
    ) -> Perceiver: ...
    def observe(self, t: float, q: ArrayLike, dq: ArrayLike) -> None:
        """Take in a state of the arm. The last 512 are kept; a picture needs one near its time.

        Waits while a picture is taken in: call it in the thread of the pictures, with the states that a loop
        hands over.

        Parameters
        ----------
        t : float
            When it was measured [s], later than the last. One more than a second later has leapt: up to
            sixteen of them are dropped by one that goes on where they leapt from, within a second of it.
        q, dq : (n,) array_like
            Joint angles [rad] and velocities [rad/s].

        Raises
        ------
        vffnull.errors.InputError
            If the time is not later than the last, or an array has the wrong shape or is not finite.
        """
    def set_arm(self, arm: Arm) -> None:
        """Go on around another arm: the same one with the load that it has taken up, or with another tool.

        What is seen of it is cut away from the next picture on, and what was seen before where arm and load
        are now is forgotten. What else there is of states and cloud stays as it is.

        Parameters
        ----------
        arm : Arm
            An arm in space with as many joints.

        Raises
        ------
        vffnull.errors.InputError
            If it is in the plane, or has another number of joints.

        Examples
        --------
        >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
        ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
        >>> panda = Arm.named("panda")
        >>> perceiver = Perceiver(panda, [camera])
        >>> perceiver.set_arm(panda.with_load(0.7, com=[0.0, 0.0, 0.05]))
        """
    def forget(self) -> None:
        """Begin anew, without a state, a picture or a point, as where a clock begins anew.

        Examples
        --------
        >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
        ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
        >>> perceiver = Perceiver(Arm.named("panda"), [camera])
        >>> perceiver.observe(5.0, [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7)
        >>> perceiver.forget()
        >>> perceiver.observe(0.0, [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8], [0.0] * 7)
        """
    def see(self, depth: ArrayLike, t: float, camera: int = 0) -> dict[str, int]:
        """Take in a picture, with the GIL released.

        Parameters
        ----------
        depth : (rows, columns) array_like
            Depths along the optical axis: uint16 are millimetres, in either byte order, and floats metres.
            What is 0 or no positive number was not measured.
        t : float
            When it was taken [s]; with ``time_offset`` added, on the clock of the states.
        camera : int, optional
            Which camera took it; the first by default.

        Returns
        -------
        dict
            Counts of pixels that were looked at and have a depth, ``measured``; of those of the arm, ``own``;
            of those that there was no room for, ``left_out``; and of cells that are ``remembered``, not seen.

        Raises
        ------
        vffnull.errors.InputError
            If there is no such camera, the picture has another shape or is not later than its last one, or no
            state of the arm is near its time. Nothing has changed then.
        vffnull.errors.InputTypeError
            If it has whole numbers that are not uint16, whose unit nobody knows, or is masked.
        """
    def deproject(self, depth: ArrayLike, camera: int = 0) -> _Array:
        """The points of a picture in the frame of its camera, of the pixels that `see` looks at.

        Parameters
        ----------
        depth : (rows, columns) array_like
            Depths, as of `see`.
        camera : int, optional
            Which camera took it; the first by default.

        Returns
        -------
        (k, 3) ndarray
            Points [m]: z forward, x to the right, y down.

        Raises
        ------
        vffnull.errors.InputError
            If there is no such camera, or the picture has another shape.
        """
    def see_points(self, cloud: ArrayLike, t: float, camera: int = 0) -> dict[str, int]:
        """Take in a cloud of points that a camera saw, as far as they are in its picture.

        As dense as it was measured: of a cloud that was thinned, hardly a cell has ``least_points``.

        Parameters
        ----------
        cloud : (k, 3) array_like
            Points in the frame of the camera [m]: z forward, x to the right, y down.
        t : float
            When they were seen [s]; with ``time_offset`` added, on the clock of the states.
        camera : int, optional
            Which camera saw them; the first by default.

        Returns
        -------
        dict
            Counts, as of `see`.

        Raises
        ------
        vffnull.errors.InputError
            As of `see`; if they are not points in space, or not finite.
        """
    @property
    def points(self) -> _Array:
        """What is there, (k, 3) [m], at time `t`: the cloud for `Controller.update_points`."""
    @property
    def velocities(self) -> _Array:
        """At which velocities the points go on, (k, 3) [m/s]."""
    @property
    def cloud(self) -> tuple[_Array, _Array, float | None]:
        """All of this at once for `Controller.update_points`: points (k, 3) [m], velocities (k, 3) [m/s] and
        the time [s] at which they were there, None before the first picture.

        Read one by one, `points`, `velocities` and `t` may be of different pictures where another thread
        takes them in.

        Examples
        --------
        >>> camera = {"columns": 80, "rows": 60, "focal": [75, 75], "centre": [39.5, 29.5],
        ...           "position": [0.6, 0.0, 1.5], "orientation": [0, 1, 0, 0]}
        >>> perceiver = Perceiver(Arm.named("panda"), [camera])
        >>> points, velocities, t = perceiver.cloud
        >>> points.shape, velocities.shape, t
        ((0, 3), (0, 3), None)
        """
    @property
    def t(self) -> float | None:
        """When the last picture was taken [s], on the clock of the states; None before the first."""
    @property
    def radius(self) -> float:
        """A radius with which balls at the points cover what is seen [m], and to a tenth of it what is round:
        half a cell's diagonal.
        """
    @property
    def tracks(self) -> list[dict[str, Any]]:
        """The bodies that are followed, each a dict: its ``number``, the ``camera`` that follows it,
        ``position`` [m] and ``velocity`` [m/s] at time ``t`` [s], ``covariance`` of place and velocity
        (2, 2), the same for each coordinate, ``angular_velocity`` [rad/s] of what is long and turns for
        certain, in how many pictures it was ``seen``, whether it ``moves`` for certain, and whether it goes
        on where the picture or the room ends, ``cut``: its velocity is then that of its sides.
        """

@final
class Simulation:
    """A scenario, one step at a time, with its own controller or somebody else's.

    Parameters
    ----------
    scenario : Scenario, dict, str or path
        What to simulate; a bundled scenario's name or a file.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run.

    Examples
    --------
    >>> simulation = Simulation(Scenario.load("sweep-through"))  # doctest: +SKIP
    >>> while not simulation.done:  # doctest: +SKIP
    ...     state = simulation.step(my_controller(simulation.state))
    """

    def __new__(cls, scenario: _Scenario) -> Simulation: ...
    def step(self, tau: ArrayLike | None = None) -> State:
        """Advance by one control period.

        Parameters
        ----------
        tau : (n,) array_like, optional
            What is sent to the robot [N·m] during the period, without gravity where that adds it, as
            `Controller.torque` has it; the scenario's own law by default.

        Returns
        -------
        State
            The state after the period.
        """

    def update_points(
        self, cloud: ArrayLike, obstacle: int = 0, velocities: ArrayLike | None = None, t: float | None = None
    ) -> State:
        """Put other points in place of those of a cloud, from now on.

        It keeps its place, its motion and its radius; `reset` gives it back the points of the scenario.

        Parameters
        ----------
        cloud : (k, 3) array_like
            The points [m], relative to the obstacle's position: at most 50 000, maybe none.
        obstacle : int, optional
            Which of the scenario's obstacles it is; the first by default.
        velocities : (k, 3) array_like, optional
            At which velocities the points go on by themselves [m/s], in the same frame, until others take
            their place (docs/theory-spatial.md, T180). Without, they rest.
        t : float, optional
            When they were there [s], on the clock of the simulation: that of the image. Without, now.

        Returns
        -------
        State
            The state among them.

        Raises
        ------
        vffnull.errors.InputError
            If they are not points in space, not finite or too many, if there is not one velocity to each, or
            if the obstacle is no cloud. The points are those of before then.
        """

    def push(self, wrench: _Document) -> State:
        """Push the arm, from now on, until the wrench is over.

        Parameters
        ----------
        wrench : Wrench or dict
            Where and how; its `start` counts from now. `reset` takes it away.

        Returns
        -------
        State
            The state with it.

        Raises
        ------
        vffnull.errors.ScenarioError
            If the arm has no such link, a number makes no sense, or 1000 push already.

        Examples
        --------
        >>> simulation = Simulation(Scenario.load("panda-sweep"))  # doctest: +SKIP
        >>> push = Wrench("panda_link4", force=[0, 20, 0], duration=0.5)  # doctest: +SKIP
        >>> simulation.push(push).tau_ext.shape  # doctest: +SKIP
        (7,)
        """

    def pull(
        self,
        link: str | None = None,
        *,
        point: ArrayLike | None = None,
        anchor: ArrayLike | None = None,
        stiffness: float | None = None,
        damping: float | None = None,
    ) -> State:
        """Pull at a point of a link towards a place with a spring and a damper, from now on, or let go.

        A hand that holds the link: K (anchor − p) − D ṗ acts at the point p, evaluated with the dynamics. A
        step of the plant is taken in parts where the spring is stiff for it (docs/theory.md, T146, T147). It
        is part of `tau_ext`.

        Parameters
        ----------
        link : str, optional
            The name of the link, or ``"tip"``; by default whoever pulls lets go.
        point : (D,) array_like, optional
            The point, in the link's frame [m]; its origin by default.
        anchor : (D,) array_like, optional
            The place in the world that it is pulled towards [m]; by default where the point is now.
        stiffness : float, optional
            K [N/m]; by default 100 1/s² times the mean mass with which the point resists now, so that the
            link swings at 10 rad/s.
        damping : float, optional
            D [N·s/m]; critical by default.

        Returns
        -------
        State
            The state with it.

        Raises
        ------
        vffnull.errors.ScenarioError
            If the arm has no such link, or a number makes no sense. Whoever pulled goes on then.

        Examples
        --------
        >>> simulation = Simulation(Scenario.load("panda-sweep"))  # doctest: +SKIP
        >>> simulation.pull("panda_link4", anchor=[0.2, 0.3, 0.7], stiffness=300.0)  # doctest: +SKIP
        <State: t = 0 s>
        >>> simulation.pull(None)  # doctest: +SKIP
        <State: t = 0 s>
        """

    def reset(self) -> State:
        """Go back to the start."""

    @property
    def pictures(self) -> list[NDArray[np.float32]]:
        """The pictures of depth cameras that arrived last, (rows, columns) [m] each, 0 where nothing was
        measured; none without such cameras.
        """

    @property
    def self_motion_map(self) -> SelfMotionMap | None:
        """What the search of the self-motion has found last (`yielding.preview.self_motion`); None without
        one, and while nothing comes near.

        ``distances`` (places, instants) [m]: the smallest distance of every posture along the self-motion,
        that at which the search began in the middle, at every instant from then on; infinite beyond
        ``clearance`` [m], NaN where there is no posture or nobody can be that early. ``path``
        (instants,): the places along the path that is followed, which keeps ``margin`` [m]; empty where
        there is none. ``spacing`` from place to place [rad], ``step`` from instant to instant [s],
        ``elapsed`` since the search began [s].
        """
    @property
    def state(self) -> State:
        """The present state."""
    @property
    def done(self) -> bool:
        """Whether the scenario's duration is over or the run has failed."""
    @property
    def status(self) -> str:
        """How the run stands: ``"completed"``, ``"collided"`` or ``"diverged"`` up to now."""

@final
class ExternalRun:
    """A run whose plant is elsewhere: the controller with its reference, sensors and drives, the obstacles,
    the record and the metrics, but not what moves the arm.

    In every plant step the plant asks for the torque, by `drive` or, if control is continuous, by `torque`,
    and hands its new state to `arrive`.

    Parameters
    ----------
    document : Mapping or object with to_dict()
        The scenario.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run.

    Examples
    --------
    >>> run = ExternalRun(document)  # doctest: +SKIP
    >>> while not run.done:  # doctest: +SKIP
    ...     run.arrive(*my_plant.step(run.drive()))
    >>> run.outcome()["status"]  # doctest: +SKIP
    """

    def __new__(cls, document: _Document) -> ExternalRun: ...
    @property
    def state(self) -> State:
        """The present instant."""
    @property
    def t(self) -> float:
        """Time [s]."""
    @property
    def done(self) -> bool:
        """Whether no step is left to take: the duration is over, or the run has diverged."""
    def obstacles(self, t: float) -> _Array:
        """Positions of the obstacles at a time.

        Parameters
        ----------
        t : float
            Time [s].

        Returns
        -------
        (k, 2) or (k, 3) ndarray
            A row per obstacle [m].
        """

    def wrenches(self, t: float, q: ArrayLike) -> tuple[list[int], _Array, _Array, _Array]:
        """What pushes the arm over the plant step from a time on.

        Parameters
        ----------
        t : float
            Time [s].
        q : (n,) array_like
            Joint angles then [rad].

        Returns
        -------
        links : list of int
            Index of the link that each wrench acts on.
        points, forces, torques : (k, 3) ndarray
            Where the force acts [m], the force [N], and the torque beside its own [N·m], in the world;
            in the plane with a third coordinate.
        """

    def drive(self) -> _Array:
        """The torque to hold over the next plant step, after the drives; the same until `arrive`.

        Returns
        -------
        (n,) ndarray
            Joint torque [N·m].
        """

    def torque(self, t: float, q: ArrayLike, dq: ArrayLike) -> _Array:
        """The law at an instant of the next plant step, for continuous control.

        Parameters
        ----------
        t : float
            Time [s].
        q, dq : (n,) array_like
            Joint angles [rad] and velocities [rad/s].

        Returns
        -------
        (n,) ndarray
            Joint torque [N·m], not finite if the state is not.

        Raises
        ------
        vffnull.errors.InputError
            If control is not continuous.
        """

    def tell(
        self,
        obstacles: Sequence[int],
        links: Sequence[int],
        points: Sequence[ArrayLike],
        forces: Sequence[ArrayLike],
    ) -> None:
        """Tell what touches what over the plant step that is about to end; without contacts, too.

        Parameters
        ----------
        obstacles, links : (k,) list of int
            The obstacle and the link of each contact.
        points, forces : (k, 3) list
            Where they touch [m], and the force on the link [N], in the world; in the plane the third
            coordinate does not count.

        Raises
        ------
        vffnull.errors.InputError
            If the lists are not of one length, or an obstacle or a link does not exist.
        """

    def arrive(self, q: ArrayLike, dq: ArrayLike) -> bool:
        """Take over the state to which the plant has come within one plant step.

        Parameters
        ----------
        q, dq : (n,) array_like
            Joint angles [rad] and velocities [rad/s]. If they are not finite, or too fast, the run has
            diverged and ends before them.

        Returns
        -------
        bool
            Whether the run has come there: False if it diverged, or was over before.
        """

    def outcome(self) -> dict[str, Any]:
        """How the run ended, once: the record is handed over.

        Returns
        -------
        dict
            As `run` returns it; ``"interrupted"`` if the run is not over.
        """

@final
class SimulatedRobot:
    """The plant of a scenario as a robot: `vffnull.robots.simulated` is where users find it.

    It has its friction, joint stops, sensors and drives, but not its controller. It goes on by one period
    whenever it gets a torque, so that its time does not depend on the clock. `vffnull.drive` drives it
    without Python in the loop; called as any other robot, it is one in Python.

    Parameters
    ----------
    scenario : Scenario, dict, str or path
        Arm, plant, start, obstacles, sensors.
    rate : float, optional
        Torques per second [Hz]: that of the drive.
    arm : Arm, optional
        If given, the robot adds the torque against gravity of this arm by itself, as many robots do.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run at this rate.
    """

    def __new__(cls, scenario: _Scenario, rate: float = 1000.0, arm: Arm | None = None) -> SimulatedRobot: ...
    @property
    def gravity(self) -> str:
        """Who adds the torque against gravity: ``"robot"`` with an `arm`, or where the scenario's ``command``
        says so, else ``"controller"``.
        """
    def read(self) -> tuple[float, _Array, _Array]:
        """Time, and joint positions and velocities as they are measured.

        Returns
        -------
        tuple
            Time [s], positions (n,) [rad], velocities (n,) [rad/s].
        """
    def external_torque(self) -> _Array:
        """The torque of the scenario's wrenches, as a sensor measures it, (n,) [N·m]."""

    def write(self, command: ArrayLike) -> None:
        """Hold a torque for a period.

        Parameters
        ----------
        command : (n,) array_like
            Joint torque [N·m].

        Raises
        ------
        vffnull.errors.InputError
            If it has the wrong shape or is not finite, or the next state would not be finite.
        """

@final
class DriveLoop:
    """A controller that drives a robot, on a thread of its own. `vffnull.drive` makes it.

    Parameters
    ----------
    robot : SimulatedRobot or any object
        The robot: see `vffnull.robots.Robot`.
    controller : Controller or Mapping
        The controller, which is copied, or a scenario, whose controller, obstacles and reference it is.
    options : Mapping
        ``rate`` [Hz], ``seconds`` [s] or None, ``patience`` [s], ``record_every``, ``command``, ``paces``,
        ``priority``, ``core``, ``limits``.
    """

    def __new__(
        cls, robot: object, controller: Controller | _Document, options: dict[str, Any]
    ) -> DriveLoop: ...
    def start(self) -> None:
        """Begin to drive."""
    def set_target(
        self,
        x_ref: ArrayLike | Sequence[ArrayLike],
        dx_ref: ArrayLike | None = None,
        ddx_ref: ArrayLike | None = None,
    ) -> None:
        """The reference from now on; as `Controller.torque` takes it."""
    def set_obstacles(self, obstacles: Sequence[_Document], t: float | None = None) -> None:
        """Other obstacles from now on, whose motions begin at time `t` of the drive, or now."""
    def set_controller(self, controller: Controller | _Scenario, blend: float) -> None:
        """Another controller, or that of a scenario, takes over within `blend` [s]; obstacles stay."""
    def move_obstacle(self, obstacle: int, position: ArrayLike, velocity: ArrayLike | None = None) -> None:
        """Obstacle `obstacle` is at a position (D,) [m] now and goes on at a velocity (D,) [m/s]."""
    def update_points(
        self, cloud: ArrayLike, obstacle: int = 0, velocities: ArrayLike | None = None, t: float | None = None
    ) -> None:
        """Other points in place of those of a cloud, which go on at velocities (k, 3) from time `t`."""
    def stop(self) -> None:
        """Ask it to end, by a damped stop. In a fork there is nothing to end."""
    def wait(self, seconds: float | None, attentive: bool) -> bool:
        """Wait until it is over.

        Parameters
        ----------
        seconds : float or None
            How long at most [s].
        attentive : bool
            Whether what a signal handler raises ends the drive, by a damped stop, and is raised here.

        Returns
        -------
        bool
            Whether it is over.
        """
    @property
    def dimension(self) -> Literal[2, 3]:
        """Dimension of the space that the arm moves in."""
    @property
    def gravity(self) -> str:
        """Who adds the torque against gravity: ``"controller"`` or ``"robot"``."""
    @property
    def torque_rate(self) -> float | None:
        """How fast the torque of some joint may change [N·m/s]; None without a limit."""
    @property
    def phase(self) -> str:
        """What it is doing: a phase of the output stage, or ``"over"``."""
    @property
    def periods(self) -> int:
        """Periods so far."""
    @property
    def left_out(self) -> dict[str, int]:
        """What was left out so far: name and count of each."""
    def latest(self) -> dict[str, Any]:
        """The last period as arrays; NaN before the first."""
    def rows(self) -> tuple[dict[str, Any], int]:
        """The rows that are to be recorded since the last call, as arrays, and how many were lost."""
    def report(self) -> dict[str, Any] | None:
        """How it went: ``status``, ``reason``, ``periods``, ``replans``, ``left_out``, ``clearance``,
        ``missed``, ``skipped``, ``notes``, histograms. None while it runs.
        """

def surface_distances(arm: Arm, q: ArrayLike, points: ArrayLike) -> tuple[_Array, NDArray[np.int64]]:
    """How far points are from the surface of an arm, and on which link that is nearest.

    Parameters
    ----------
    arm : Arm
        An arm in space.
    q : (n,) array_like
        Joint positions [rad or m].
    points : (k, 3) array_like
        Points in the world [m].

    Returns
    -------
    distances : (k,) ndarray
        To the nearest of the shapes `Arm.collision` [m], negative within it; infinite where there is none.
    links : (k,) ndarray of int
        Which of `Arm.link_names` has it; -1 is the base.

    Raises
    ------
    vffnull.errors.InputError
        If the arm is in the plane, or an array has the wrong shape or is not finite.

    Examples
    --------
    >>> arm = Arm.named("panda")
    >>> distances, links = surface_distances(arm, [0, -0.8, 0, -2.4, 0, 1.6, 0.8], [[0.0, 0.0, -1.0]])
    >>> float(distances[0].round(2)), links.tolist()
    (0.93, [-1])
    """

def distances(
    arm: Arm, q: ArrayLike, dq: ArrayLike, obstacles: Sequence[_Document], t: ArrayLike = 0.0
) -> Distances:
    """The signed distance of every link from every obstacle, and exactly how it changes.

    What a barrier or a filter at torque level needs: d̈ = gradient @ ddq + bias holds as long as the same
    features (end, side, corner, face) remain nearest; where they change, d̈ jumps (docs/theory.md, T60–T62).

    Parameters
    ----------
    arm : Arm
        The arm's model.
    q, dq : (n,) or (batch, n) array_like
        Joint positions [rad or m] and velocities.
    obstacles : sequence of Obstacle or dict
        The obstacles with their motions.
    t : float or (batch,) array_like, optional
        Time [s] at which the motions are taken.

    Returns
    -------
    Distances
        One row per pair of link and obstacle; with a batch, one such table per state.

    Raises
    ------
    vffnull.errors.InputError
        If an array has the wrong shape or is not finite.

    Examples
    --------
    >>> arm = Arm.uniform(2)
    >>> disc = {"shape": {"kind": "circle", "radius": 0.5}, "position": [1.5, 1.0]}
    >>> distances(arm, [0.0, 0.0], [0.0, 0.0], [disc]).distance.round(3).tolist()
    [0.618, 0.5]
    """

def run(
    document: Mapping[str, Any], progress: Callable[[float, float], None] | None = None
) -> dict[str, Any]:
    """Run a scenario document from start to end, with the GIL released.

    Parameters
    ----------
    document : Mapping
        The scenario.
    progress : callable, optional
        Gets the simulated time and the duration [s] about every 100 ms.

    Returns
    -------
    dict
        ``status``, ``message``, ``end_time`` [s], ``wall_time`` [s], ``warnings``, ``metrics``, ``replans``,
        ``record``.
        After Ctrl-C the status is ``"interrupted"`` and the record holds what was computed until then.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run.
    """

def plant(document: Mapping[str, Any]) -> Arm:
    """The physical arm of a scenario document, payload included.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be used.
    """

def run_many(
    documents: Iterable[_Document],
    name: str = "scenarios",
    threads: int | None = None,
    record: bool = True,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, Any]]:
    """Run many scenario documents on several threads, with the GIL released.

    Parameters
    ----------
    documents : iterable of Mapping
        The scenarios.
    name : str
        What error messages call the list.
    threads : int, optional
        How many threads; as many as there are cores by default.
    record : bool
        Whether to record, or to keep nothing but the metrics.
    progress : callable, optional
        Gets the number of finished scenarios and the number of all about every 100 ms.

    Returns
    -------
    list of dict
        What `run` returns, in the order of the documents.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a scenario cannot be run; nothing has been computed then.
    vffnull.errors.InputError
        If all records together are too large, or the threads cannot be started.
    """

def plan(
    document: Mapping[str, Any],
    start: Sequence[float] | None,
    goal: Sequence[float] | None,
    time: float,
    margin: float,
    horizon: float | None,
    tilt: float | None,
    upright: Sequence[float] | None,
    view: tuple[Sequence[float], float] | None,
    approach: Sequence[float] | None,
    retreat: Sequence[float] | None,
    acceleration: Sequence[float] | None,
    jerk: Sequence[float] | None,
    speed: float,
    samples: int,
    paths: int,
    seed: int,
) -> dict[str, Any]:
    """Plan a motion of a scenario's arm among its obstacles, with the GIL released.

    Parameters
    ----------
    document : Mapping
        The scenario. Without `goal`, the end effector goes to where its reference is at the end of its
        duration.
    start, goal : list of float or None
        Configurations [rad]; the start is the scenario's ``q0`` by default.
    time : float
        When the motion starts [s].
    margin : float
        What every link keeps from obstacles [m].
    horizon : float or None
        For how long the places that obstacles will pass are kept free [s]; None leaves out what moves.
    tilt : float or None
        How far the end effector may tilt from how it stands at `upright` [rad]; None: that does not matter.
    upright : list of float or None
        The configuration in which it stands upright [rad]; the start by default.
    view : tuple of list of float and float, or None
        A point that the end effector keeps in view [m], and how far off its axis that may be [rad].
    approach, retreat : list of float or None
        How far the end effector comes straight to the goal and leaves the start [m], as one number, or the
        vectors along which it does; None: that does not matter.
    acceleration, jerk : list of float or None
        What the joints may do [rad/s², m/s²; rad/s³, m/s³]; by default 30 in the plane, 10 in space, and any.
    speed : float
        Share of the limits of speed, acceleration and jerk, in (0, 1].
    samples : int
        How many random configurations are tried.
    paths : int
        How many paths are searched, of which the shortest is taken.
    seed : int
        Where the random numbers come from.

    Returns
    -------
    dict
        ``status``, ``message``, ``t``, ``q``, ``dq``, ``ddq``, ``tip``, ``clearance``, ``margin``,
        ``margins``, ``shares``, ``begins``, ``tilt``, ``view``, ``gap``, ``samples``, ``nodes``.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be read, or a setting is of no use.
    """

def joints_at(times: ArrayLike, points: ArrayLike, t: ArrayLike) -> tuple[_Array, _Array, _Array]:
    """Positions, velocities and accelerations of joints along a plan, as a scenario that follows it has them.

    Parameters
    ----------
    times : (k,) array_like
        The instants of the plan [s].
    points : (k, n) array_like
        Its configurations [rad].
    t : (m,) array_like
        Instants [s].

    Returns
    -------
    tuple of (m, n) ndarray
        q, dq and ddq.

    Raises
    ------
    vffnull.errors.InputError
        If the arrays do not fit each other, or the times do not increase.
    """

def feasibility(document: Mapping[str, Any]) -> tuple[str, _Array | None]:
    """Find by a planner whether a collision-free motion exists, with the GIL released.

    Parameters
    ----------
    document : Mapping
        The scenario, in the plane or in space.

    Returns
    -------
    str
        ``"with tip"``, ``"without tip"`` or ``"none found"``.
    (k, n) ndarray or None
        The motion that was found: joint angles every 50 ms [rad].

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be read, or its reference does not fit its task.
    """

def real_time(
    document: Mapping[str, Any],
    rate: float,
    seconds: float,
    priority: int | None = None,
    core: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Run a scenario document against the wall clock on a thread of its own, with the GIL released.

    Parameters
    ----------
    document : Mapping
        The scenario.
    rate : float
        Control periods per second [Hz].
    seconds : float
        How long [s].
    priority : int, optional
        Priority of SCHED_FIFO, 1 to 99.
    core : int, optional
        The core to stay on.
    progress : callable, optional
        Gets the number of periods done and the number of all about every 100 ms.

    Returns
    -------
    dict
        ``status``, ``rate`` [Hz], ``dt`` [s], ``periods``, ``missed``, ``restarts``, ``min_clearance`` [m],
        ``notes``; ``latency``, ``step``, ``response``, ``jitter``: times [s] and how often each.
    """

def check(
    kind: Literal[
        "scenario", "arm", "controller", "field", "obstacle", "motion", "reference", "simulation", "wrench"
    ],
    document: Mapping[str, Any],
    dimension: int | None = None,
    recorded: bool = False,
) -> list[str]:
    """Validate a scenario document, or a part of one, and return warnings.

    Parameters
    ----------
    kind : str
        Which part: ``"scenario"``, ``"arm"``, ``"obstacle"``, …
    document : dict
        The part.
    dimension : int, optional
        Of the space, 2 or 3; by default the part itself says which, as far as it does.
    recorded : bool, optional
        Whether the record of a whole scenario has to fit into memory.

    Raises
    ------
    vffnull.errors.ScenarioError
        If it cannot be used; the message names the key, what was given, and what is allowed.
    """

def motion_bounds(document: Mapping[str, Any]) -> tuple[float, float]:
    """A speed [m/s] and an acceleration [m/s²] that a motion of an obstacle never exceeds.

    Parameters
    ----------
    document : dict
        The motion.

    Raises
    ------
    vffnull.errors.ScenarioError
        If it is none.
    """

@final
class Episodes:
    """Episodes of one scenario side by side: what the environments of `vffnull.engines.gym` are made of.

    Parameters
    ----------
    scenario : Scenario, dict, str or path
        What happens in an episode.
    settings : Mapping
        ``action``, ``period``, ``torque``, ``start_noise``, ``obstacle_noise``, ``margin``, ``weights``; see
        `vffnull.engines.gym.ReachEnv`.
    count : int
        How many episodes.
    threads : int
        How many threads step them.
    seed : int
        Episode i has the seed ``seed + i``.
    autoreset : {"next_step", "same_step", "disabled"}, optional
        When an episode that has ended begins anew.
    """

    INFO: list[str]
    """What the columns of the information are."""

    def __new__(
        cls,
        scenario: _Scenario,
        settings: _Document,
        count: int,
        threads: int,
        seed: int,
        autoreset: str = "next_step",
    ) -> Episodes: ...
    def reset(self, seeds: Sequence[int | None], mask: Sequence[bool] | None = None) -> tuple[_Array, _Array]:
        """Begin those in the mask anew, each with its seed if there is one.

        Returns
        -------
        (count, width) ndarray, (count, len(INFO)) ndarray
            Observations and information.
        """

    def step(self, actions: ArrayLike) -> tuple[_Array, _Array, NDArray[np.bool_], NDArray[np.bool_], _Array]:
        """Step all of them, the GIL released.

        Parameters
        ----------
        actions : (count, n) array_like
            From −1 to 1.

        Returns
        -------
        tuple of ndarray
            Observations (count, width), rewards, terminations and truncations (count,), information.
        """

    def ended(self) -> tuple[NDArray[np.bool_], _Array, _Array]:
        """Which ones ended and began anew within the last step, their last observation and information."""

    @property
    def layout(self) -> list[tuple[str, int, int, float]]:
        """Name, rows, columns and bound of each part of an observation."""

    @property
    def torque(self) -> _Array:
        """The torque of an action of 1 [N·m], (n,)."""

    @property
    def period(self) -> float:
        """How long an action lasts [s]."""

    def __len__(self) -> int: ...

def hull(points: ArrayLike) -> list[list[int]]:
    """The faces of the convex hull of points in space.

    Parameters
    ----------
    points : (k, 3) array_like
        The points [m].

    Returns
    -------
    list of list of int
        Of each face the indices of its corners, counter-clockwise from outside. What lies in one plane is
        one face.

    Raises
    ------
    vffnull.errors.InputError
        If they have no hull that an obstacle can be made of.
    """

def rotations(obstacle: _Document, dimension: int, times: ArrayLike) -> _Array | None:
    """How an obstacle is turned over time, compared with its position at rest.

    Parameters
    ----------
    obstacle : dict
        The obstacle as in a scenario.
    dimension : int
        Of the space that it is in, 2 or 3.
    times : (T,) array_like
        Instants [s].

    Returns
    -------
    (T, dimension, dimension) ndarray or None
        A rotation matrix per instant; None if the obstacle does not turn.

    Raises
    ------
    vffnull.errors.ScenarioError
        If it is no obstacle there.
    """

def matrices(quaternions: ArrayLike) -> _Array: ...
def quaternions(matrices: ArrayLike) -> _Array: ...
def parts_of_task(document: Mapping[str, Any], dimension: int) -> list[str | None]:
    """The parts of a task, what gives way first before what gives way last (T193).

    Parameters
    ----------
    document : Mapping
        The `[controller]` of a scenario.
    dimension : int
        Of the space, 2 or 3.

    Returns
    -------
    list of str or None
        None is what `yielding.order` does not name.

    Raises
    ------
    vffnull.errors.ScenarioError
        If there is no such part or task.
    """

def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Read TOML.

    Parameters
    ----------
    text : str
        The text.
    name : str
        What the error message calls it.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the text is not TOML; the message shows the line.
    """

def format_toml(document: Mapping[str, Any]) -> str:
    """Write a document as TOML."""

def schema() -> str:
    """Every key of a scenario with its unit, default and meaning, as text."""

def schema_json() -> str:
    """The same as a JSON Schema."""

def read_urdf(text: str, options: _Document) -> dict[str, Any]:
    """Read the text of a URDF.

    Parameters
    ----------
    text : str
        The URDF.
    options : dict
        ``tip``, ``base``, ``locked``, ``tool``, ``mount``, ``gravity``, ``armature``, ``fix_inertia`` and
        ``srdf`` (text), each with its default.

    Returns
    -------
    dict
        ``arm``, the explicit description without ``collision``; ``geometry``, what collides on which link;
        ``locked``, ``merged``, ``warnings``.

    Raises
    ------
    vffnull.errors.InputError
        If the text is no URDF, or what is asked for is no arm.
    """

def reduce_tree(tree: _Document, options: _Document) -> dict[str, Any]:
    """The same as `read_urdf` for links and joints that another reader found.

    Parameters
    ----------
    tree : dict
        ``name``, ``links``, ``joints``, ``warnings``.
    options : dict
        As in `read_urdf`.
    """

def check_arm(arm: _Document) -> dict[str, Any]:
    """Validate the explicit description of a spatial arm.

    Parameters
    ----------
    arm : dict
        The description.

    Returns
    -------
    dict
        The same with every key that has a default, axes and quaternions of length 1.

    Raises
    ------
    vffnull.errors.InputError
        With the path of the first value that is wrong.
    """

def overlapping_links(arm: _Document, postures: Sequence[Sequence[float]]) -> list[list[tuple[str, str]]]:
    """Which links of an arm overlap that must not touch: no neighbours, and none of those to be ignored.

    Parameters
    ----------
    arm : dict
        The description.
    postures : sequence of sequence of float
        Joint positions.

    Returns
    -------
    list of list of (str, str)
        The names of their links at every posture, from the base.

    Raises
    ------
    vffnull.errors.InputError
        With the path of the first value that is wrong, or if a posture has another length than the arm
        has joints.
    """

def arm_model(name: str) -> dict[str, Any]:
    """The explicit description of a bundled arm.

    Parameters
    ----------
    name : str
        One of `ARMS`.
    """

def arm_text(name: str) -> str:
    """The document of a bundled arm, with the sources of its numbers.

    Parameters
    ----------
    name : str
        One of `ARMS`.
    """

@final
class VirtualArm:
    """The closed loop run on the model, whose state is the set point of a robot that takes positions.

    Once per cycle, `step` moves the model by one period under the torque of the controller, within limits of
    speed, acceleration and jerk, and within the arm's joint limits. The law sees what these limits make of
    its torque, and the barriers of ``cbf`` act as early as they need. Where a joint of the robot and its set
    point part by more than `threshold`, the model comes to the robot, within the same limits, until they are
    within a quarter of that.

    From now on the controller is that of set points: a loop of torques that it has begun is over, as are
    these once it begins another one, or forgets them by `Controller.reset` after they have finished.

    Parameters
    ----------
    controller : Controller
        The law, with its arm and settings. `gravity`, `torque_rate` and friction of `command` mean nothing
        here.
    q : (n,) array_like
        Joint angles [rad] of the robot, which is at rest.
    period : float
        Control period [s].
    acceleration, jerk : float or (n,) array_like
        Largest acceleration [rad/s²] and jerk [rad/s³] of the joints.
    speed : float or (n,) array_like, optional
        Largest speed [rad/s]; the arm's velocity limits by default.
    threshold : float, optional
        How far a joint may be from its set point [rad]. A robot lags behind by its delay times its speed:
        allow more than that.

    Raises
    ------
    vffnull.errors.InputError
        If a number is not positive, an array has the wrong length, no speed is known, a gain is unstable at
        this period, or a joint is more than 0.2 rad (0.05 m) beyond its stop.

    Examples
    --------
    >>> arm = Arm.named("panda")
    >>> ready = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
    >>> virtual = VirtualArm(Controller(arm), ready, period=0.001, acceleration=7.5, jerk=3750.0)
    >>> q, dq, ddq, course = virtual.step(0.0, x_ref=[0.5, 0.0, 0.5], q=ready, dq=[0.0] * 7)
    >>> course
    'following'
    """

    def __new__(
        cls,
        controller: Controller,
        q: ArrayLike,
        period: float,
        acceleration: ArrayLike,
        jerk: ArrayLike,
        speed: ArrayLike | None = None,
        threshold: float = 0.1,
    ) -> VirtualArm: ...
    def step(
        self,
        t: float,
        x_ref: ArrayLike | tuple[ArrayLike, ArrayLike] | None = None,
        dx_ref: ArrayLike | None = None,
        ddx_ref: ArrayLike | None = None,
        obstacles: Sequence[_Document] = (),
        q: ArrayLike | None = None,
        dq: ArrayLike | None = None,
    ) -> tuple[_Array, _Array, _Array, _Course]:
        """One cycle: the set point for the next instant, from that for the time `t`.

        Parameters
        ----------
        t : float
            Time [s] at which the obstacles' motions are taken.
        x_ref, dx_ref, ddx_ref : array_like, optional
            Reference of the end effector, as in `Controller.torque`. Without `x_ref` its motion is damped.
        obstacles : sequence of Obstacle or dict, optional
            What to keep away from; nothing by default.
        q, dq : (n,) array_like, optional
            Measured joint angles [rad] and velocities [rad/s]. Without them, or where one is not finite, the
            robot has not been heard of; for 20 cycles in a row, once it has been, and the model stops.

        Returns
        -------
        q, dq, ddq : (n,) ndarray
            Joint angles [rad], velocities [rad/s] and accelerations [rad/s²] of the set point.
        course : str
            ``"following"`` the law, ``"rejoining"`` the robot, ``"waiting"`` for it, or, after `stop`,
            ``"stopping"`` and in the end ``"finished"``.

        Raises
        ------
        vffnull.errors.InputError
            If an array has the wrong shape, or time or reference are not finite.
        """
    def begin(self, q: ArrayLike) -> None:
        """Begin anew at rest at `q` [rad], where the robot is. The controller forgets the past.

        Raises
        ------
        vffnull.errors.InputError
            If it has the wrong shape, is not finite, or is more than 0.2 rad (0.05 m) beyond a stop.
        """
    def stop(self) -> None:
        """Stop the model from the next cycle on, within its limits."""
    @property
    def course(self) -> _Course:
        """What the last set point comes from, as `step` names it."""

def wrenches(document: _Document, t: Sequence[float], q: Sequence[Sequence[float]]) -> list[_Array]:
    """What pushes the arm of a scenario at instants of a run.

    Parameters
    ----------
    document : Mapping
        The scenario.
    t : (T,) array_like
        Times [s].
    q : (T, n) array_like
        Joint angles then [rad].

    Returns
    -------
    points, forces : (T, k, 3) ndarray
        Where the force of every wrench acts [m], and the force [N], in the world; in the plane with a third
        coordinate.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run.
    """
