"""The controller's settings: how hard it pulls, how it repels, and which variant of the law it uses."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Literal

import vffnull._core as _core
from vffnull._support.arguments import documented, suggesting
from vffnull.model.document import Document, frozen, plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["ControlSettings", "Field"]


@suggesting
@documented
@dataclass(frozen=True, repr=False)
class Field:
    """A virtual force field round every obstacle; made by `khatib`, `cubic` or `bounded`.

    The force depends on the signed distance d between the surfaces of a link and of an obstacle, vanishes
    from the influence distance d_s on, and pushes the link along the line of shortest distance.

    Attributes
    ----------
    kind : str
        ``"khatib"``, ``"cubic"`` or ``"bounded"``.
    gain : float
        Gain; its unit depends on the kind. 0 switches the field off.
    influence : float
        Influence distance d_s [m].
    floor : float or None
        Distance [m] below which the force grows along its tangent instead of to infinity, so that it stays
        defined in contact and beyond. None leaves the choice to the core. Not for ``"bounded"``.
    approach_damping : float
        Damping ratio against an approaching obstacle [1]; 0 switches it off. It does not act on a link that
        moves away.
    sliding : float
        How strongly links are deflected sideways past an approaching obstacle [N·s/m]; 0 switches it off. The
        force is orthogonal to the relative velocity of link and obstacle.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a number makes no sense.
    """

    kind: Literal["khatib", "cubic", "bounded"]
    gain: float
    influence: float
    floor: float | None = None
    approach_damping: float = 0.0
    sliding: float = 0.0

    def __post_init__(self) -> None:
        _core.check("field", self.to_dict())
        _freeze(self)

    @staticmethod
    def khatib(
        gain: float,
        influence: float,
        floor: float | None = None,
        approach_damping: float = 0.0,
        sliding: float = 0.0,
    ) -> Field:
        """Khatib's field, U = ½ η (1/d − 1/d_s)², the one of the paper.

        Parameters
        ----------
        gain : float
            η [N·m³].
        influence : float
            d_s [m].
        floor, approach_damping, sliding : float, optional
            As in the class.
        """
        return Field("khatib", gain, influence, floor, approach_damping, sliding)

    @staticmethod
    def cubic(
        gain: float,
        influence: float,
        floor: float | None = None,
        approach_damping: float = 0.0,
        sliding: float = 0.0,
    ) -> Field:
        """A field that sets in more softly, U = ⅓ η (1/d − 1/d_s)³: its stiffness has no step at d_s.

        Parameters
        ----------
        gain : float
            η [N·m⁴].
        influence : float
            d_s [m].
        floor, approach_damping, sliding : float, optional
            As in the class.
        """
        return Field("cubic", gain, influence, floor, approach_damping, sliding)

    @staticmethod
    def bounded(
        gain: float, influence: float, *, approach_damping: float = 0.0, sliding: float = 0.0
    ) -> Field:
        """A field of limited force, F = F_max (1 − d/d_s)².

        Parameters
        ----------
        gain : float
            F_max [N], the force at contact.
        influence : float
            d_s [m].
        approach_damping, sliding : float, optional
            As in the class.
        """
        return Field("bounded", gain, influence, None, approach_damping, sliding)

    def to_dict(self) -> Document:
        """The field as a part of a scenario document."""
        document = _given(self)
        for key in ("approach_damping", "sliding"):
            if not getattr(self, key):
                del document[key]
        return document

    def __repr__(self) -> str:
        rest = ", ".join(f"{key}={value!r}" for key, value in self.to_dict().items() if key != "kind")
        return f"Field.{self.kind}({rest})"


@suggesting
@documented
@dataclass(frozen=True, kw_only=True, repr=False)
class ControlSettings:
    """Settings of the control law. What is left None is up to the core: see ``vffnull schema``.

    Parameters
    ----------
    task : {"position", "pose", "pointing"}, optional
        What the end effector has to follow: a point, or a point and an orientation. Pointing, in space only,
        leaves the turn about the tool's z axis free.
    stiffness : float or (m,) array_like, optional
        K [1/s²], shapes the end effector's acceleration; m is 2 for a position and 3 for a pose, in space 3
        for a position, 5 for pointing (linear, then two angles about the tool's own x and y) and 6 for a pose
        (linear, then angular, about the world's axes).
    damping : float or (m,) array_like, optional
        D [1/s].
    null_damping : float or (n,) array_like, optional
        d [1/s], damps the motion that the end effector does not see, in proportion to the mass matrix.
    posture : (n,) array_like, optional
        Joint angles [rad] that the arm prefers where the task leaves it free.
    posture_stiffness : float or (n,) array_like, optional
        Stiffness of the pull towards `posture` [N·m/rad].
    field : Field or dict, optional
        The repulsion; none by default.
    self_collision : {"ignore", "report", "avoid"}, optional
        Whether links that share no joint are measured against each other, and whether `field` pushes them
        apart too.
    joint_limit_field : Field or dict, optional
        Repulsion from the arm's joint limits: a field over the angle that is left, in rad and N·m.
    enforce_limits : bool, optional
        Whether the arm's limits of torque, speed and angle hold for the controller; they do by default.
        See ``vffnull schema`` for what is given up first.
    observer : dict, optional
        Estimates the torque that the model does not know: ``{"bandwidth": 1/s, "threshold": N·m}``; what is
        below the threshold is taken for friction and not answered. With ``"source": "measured"`` it is what
        the robot measures, see `Controller.sense`.
    touch : dict, optional
        What is done about that: ``{"task": "comply" | "reject", "null_space": "comply" | "reject"}``; with
        ``"force": {"direction": [x, y, z], "target": N}`` the tip presses in that direction with that force
        and moves along the surface, see ``vffnull schema``.
    tank : dict, optional
        An energy tank that bounds what avoidance injects: ``{"capacity": J, "initial": J, "floor": share}``.
    formulation : {"recursive", "extended_jacobian"}, optional
        How the torque is computed. The two agree to rounding; the second is the paper's, with every matrix.
    projection : {"dynamic", "kinematic", "none"}, optional
        What keeps the repulsion away from the end effector. All but ``"dynamic"`` are for comparison.
    avoidance : {"null_space", "relaxed", "priority", "cbf"}, optional
        What has priority where an obstacle blocks the end effector itself: ``"null_space"`` keeps the task;
        the others let the end effector deviate, ``"cbf"`` by no more than distances and limits require.
    yielding : dict, optional
        How the end effector deviates: see ``vffnull schema`` for the keys of ``[controller.yielding]``.
        ``{"preview": {}}`` lets ``"cbf"`` look ahead.
    governor : dict, optional
        Lets the reference wait while the end effector is off it: see ``vffnull schema`` for the keys of
        ``[controller.governor]``; ``{}`` takes every default. It acts in simulations; a `Controller` is given
        its reference and leaves it as it is.
    command : dict or "of the robot", optional
        What stands between the torque and a robot: who adds gravity, how fast the torque may change,
        friction compensation, how fast the tip may move and turn, and when a loop gives up; see ``vffnull
        schema`` for the keys of ``[controller.command]``. ``"of the robot"`` takes gravity, rate and speeds
        of the tip as the interface of a bundled arm does, and where it limits the rate, an observer for
        what nobody knows of, if none is given.
    deadline : float or "unlimited", optional
        How long a cycle may take [µs], look-ahead included: that stops when the time is over, and keeps the
        best motion so far. In loops the clock counts; three tenths of the period if it is not said. In
        simulations, which have none if it is not said, the work counts, so that runs repeat.
    characteristic_length : float, optional
        Radius [m] at which an angle of the task counts as its arc, where metres and radians are put together.
    singularity : float, optional
        How early the task gives way near a singular posture: below this fraction of the mobility that one
        particle of the arm's mass would have.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a value makes no sense.

    Examples
    --------
    >>> settings = ControlSettings(stiffness=16.0, damping=8.0, field=Field.khatib(5.0, 1.2))
    """

    task: Literal["position", "pose", "pointing"] | None = None
    stiffness: ArrayLike | None = None
    damping: ArrayLike | None = None
    null_damping: ArrayLike | None = None
    posture: ArrayLike | None = None
    posture_stiffness: ArrayLike | None = None
    field: Field | Document | None = None
    self_collision: Literal["ignore", "report", "avoid"] | None = None
    joint_limit_field: Field | Document | None = None
    enforce_limits: bool | None = None
    tank: Document | None = None
    observer: Document | None = None
    touch: Document | None = None
    formulation: Literal["recursive", "extended_jacobian"] | None = None
    projection: Literal["dynamic", "kinematic", "none"] | None = None
    avoidance: Literal["null_space", "relaxed", "priority", "cbf"] | None = None
    yielding: Document | None = None
    governor: Document | None = None
    command: Document | Literal["of the robot"] | None = None
    deadline: float | Literal["unlimited"] | None = None
    characteristic_length: float | None = None
    singularity: float | None = None

    def __post_init__(self) -> None:
        _core.check("controller", self.to_dict())
        for name in ("field", "joint_limit_field"):
            given = getattr(self, name)
            if isinstance(given, dict):
                object.__setattr__(self, name, Field(**given))
        _freeze(self)

    def to_dict(self) -> Document:
        """The settings that were given, as a part of a scenario document."""
        return _given(self)

    def __repr__(self) -> str:
        given = ((f.name, getattr(self, f.name)) for f in fields(self))
        inside = ", ".join(f"{name}={value!r}" for name, value in given if value is not None)
        return f"ControlSettings({inside})"


def _freeze(settings: Field | ControlSettings) -> None:
    """Make every value of a frozen dataclass comparable and hashable."""
    for f in fields(settings):
        object.__setattr__(settings, f.name, frozen(getattr(settings, f.name)))


def _given(settings: Field | ControlSettings) -> Document:
    document: Document = plain({f.name: getattr(settings, f.name) for f in fields(settings)})
    return document
