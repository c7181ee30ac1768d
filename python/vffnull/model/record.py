"""The quantities of a record: what each one means, in which unit, and along which dimensions it runs.

Most hold for every arm. What depends on where a run takes place, in the plane or in space, is said by its
`Layout`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

import vffnull._core as _core
from vffnull.model.arm import is_spatial

if TYPE_CHECKING:
    from numpy.typing import NDArray

Dimension = Literal[
    "joint", "link", "task", "obstacle", "plane", "space", "quaternion", "store", "port", "objective", "ray"
]


@dataclass(frozen=True)
class Quantity:
    """One recorded quantity; its first dimension is always time."""

    unit: str
    meaning: str
    over: tuple[Dimension, ...]
    optional: bool = False
    """None where a run does not have it."""


QUANTITIES: dict[str, Quantity] = {
    "q": Quantity("rad", "joint angle", ("joint",)),
    "dq": Quantity("rad/s", "joint velocity", ("joint",)),
    "tau": Quantity("N·m", "joint torque", ("joint",)),
    "tau_task": Quantity("N·m", "task part of the joint torque", ("joint",)),
    "tau_null": Quantity("N·m", "null-space part of the joint torque", ("joint",)),
    "tau_vff": Quantity("N·m", "repulsive torque before projection", ("joint",)),
    "x": Quantity("m", "end effector", ("task",)),
    "orientation": Quantity("", "orientation of the end effector", ("quaternion",), optional=True),
    "dx": Quantity("m/s", "end-effector velocity", ("task",)),
    "x_ref": Quantity("m", "reference", ("task",)),
    "orientation_ref": Quantity("", "orientation of the reference", ("quaternion",), optional=True),
    "error": Quantity("m", "tracking error", ("task",)),
    "force": Quantity("N", "repulsion on the link", ("link",)),
    "clearance": Quantity("m", "distance to the nearest obstacle", ("link",)),
    "obstacles": Quantity("m", "obstacle position", ("obstacle", "plane")),
    "energy": Quantity("J", "energy of the arm", ("store",)),
    "power": Quantity("W", "power of the motors and into the null space", ("port",)),
    "manipulability": Quantity("m²", "manipulability", ()),
    "objective_scale": Quantity("", "share that the limits let through", ("objective",), optional=True),
    "self_clearance": Quantity("m", "distance of the nearest two links", (), optional=True),
    "tank": Quantity("J", "energy in the tank", (), optional=True),
    "tau_ext": Quantity("N·m", "torque from outside", ("joint",), optional=True),
    "contact_force": Quantity("N", "force of the obstacle on the arm", ("obstacle", "plane"), optional=True),
    "tau_ext_estimate": Quantity(
        "N·m", "torque that the model does not know, as estimated", ("joint",), optional=True
    ),
    "wrench_estimate": Quantity("N", "estimated wrench at the end effector", ("task",), optional=True),
    "touched_link": Quantity("", "link on which a contact is felt", (), optional=True),
    "contact_deviation": Quantity(
        "N·m", "what the estimate has changed by of late", ("joint",), optional=True
    ),
    "contact_threshold": Quantity(
        "N·m", "what the estimate has to change by to be felt", ("joint",), optional=True
    ),
    "yielded": Quantity("m", "how far the end effector gives way to a push", (), optional=True),
    "released": Quantity("", "how many parts of its task the look-ahead lets go", (), optional=True),
    "slack": Quantity("m/s²", "breach of the barriers", (), optional=True),
    "path_time": Quantity("s", "path time of the reference", (), optional=True),
    "q_plan": Quantity("rad", "joint angle of the plan", ("joint",), optional=True),
    "q_measured": Quantity("rad", "measured joint angle", ("joint",), optional=True),
    "dq_measured": Quantity("rad/s", "measured joint velocity", ("joint",), optional=True),
    "tau_applied": Quantity("N·m", "torque at the joint", ("joint",), optional=True),
    "sensed": Quantity("m", "point seen by the range sensor", ("ray", "plane"), optional=True),
}

IN_SPACE: dict[str, Quantity] = {
    "x": Quantity("m", "end effector", ("space",)),
    "x_ref": Quantity("m", "reference", ("space",)),
    "obstacles": Quantity("m", "obstacle position", ("obstacle", "space")),
    "contact_force": Quantity("N", "force of the obstacle on the arm", ("obstacle", "space"), optional=True),
    "sensed": Quantity("m", "point seen by the range sensor", ("ray", "space"), optional=True),
    "manipulability": Quantity("m³", "manipulability", ()),
}
"""Those that are different of an arm in space."""

THE_REST = "the rest"
"""What of a task `controller.yielding.order` does not name."""

AXES = ("x", "y", "phi")
"""Names of the task's axes in the plane; a position has the first two, a pose all three."""

SPACE_AXES = ("x", "y", "z", "rx", "ry", "rz")
"""The same in space: a position has three, pointing five (the last two are the tool's own), a pose six."""

NAMES: dict[Dimension, tuple[str, ...]] = {
    "task": AXES,
    "plane": AXES[:2],
    "space": SPACE_AXES[:3],
    "quaternion": ("w", "x", "y", "z"),
    "store": _core.ENERGIES,
    "port": _core.PORTS,
    "objective": _core.OBJECTIVES,
}
"""What the places along a dimension are called; elsewhere they count from 0, as arrays do."""

_TASK_WIDTHS = {
    2: {"position": 2, "pose": 3},
    3: {"position": 3, "pointing": 5, "pose": 6},
}
_ANGLES = ("phi", "rx", "ry", "rz")
_OF_JOINTS = (
    "q",
    "dq",
    "tau",
    "tau_task",
    "tau_null",
    "tau_vff",
    "q_plan",
    "q_measured",
    "dq_measured",
    "tau_applied",
    "tau_ext",
    "tau_ext_estimate",
    "contact_deviation",
    "contact_threshold",
)


_WHICH_LINK = ("min_clearance_link", "min_self_clearance_link", "min_self_clearance_other", "touched_link")


@dataclass(frozen=True)
class Layout:
    """Where a run takes place, as far as names and units depend on it."""

    dimension: Literal[2, 3] = 2
    """Of the space that the arm moves in."""
    slides: frozenset[int] = frozenset()
    """Which joints slide instead of turning, counted from 0."""
    links: tuple[str, ...] = field(default=(), compare=False, repr=False)
    """What the links are called, as in `ignore` of an obstacle."""

    @classmethod
    def of(cls, document: Mapping[str, Any]) -> Layout:
        """That of a scenario's document."""
        arm = document.get("arm", {})
        if not is_spatial(arm):
            return cls(links=tuple(f"link_{i + 1}" for i in range(len(document.get("q0", ())))))
        joints = arm.get("joints") or ()
        links = tuple(_moved_by(joint) for joint in joints) or _links_of(str(arm.get("model")))
        slides = frozenset(i for i, joint in enumerate(joints) if joint.get("kind") == "prismatic")
        return cls(3, slides, links)

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Every quantity by name."""
        return QUANTITIES if self.dimension == 2 else QUANTITIES | IN_SPACE

    def metric(self, name: str) -> tuple[str, str]:
        """Unit and one-line description of a metric; both empty if nothing is known of it."""
        unit, meaning = _core.METRICS.get(name, ("", ""))
        if self.dimension == 3 and name == "min_manipulability":
            unit = self.unit("manipulability")
        return unit, meaning

    def told(self, name: str, value: object) -> str:
        """The description of a metric of this value: with the name of the link, where it says which."""
        meaning = self.metric(name)[1]
        if name not in _WHICH_LINK or not isinstance(value, int) or not 0 <= value < len(self.links):
            return meaning
        return f"{meaning}: {self.links[value]}"

    def names(self, over: Dimension) -> tuple[str, ...] | None:
        """What the places along a dimension are called, or None where they count from 0."""
        return SPACE_AXES if over == "task" and self.dimension == 3 else NAMES.get(over)

    def label(self, over: Dimension, index: int) -> str:
        """What an entry along a dimension is called: its name if it has one, otherwise its index, from 0."""
        names = self.names(over)
        return str(index) if names is None else names[index]

    def labels(self, over: Dimension, size: int) -> list[str] | list[int]:
        """What the entries along a dimension of this size are called in a table of their own."""
        names = self.names(over)
        return list(range(size)) if names is None else list(names[:size])

    def unit(self, name: str, axis: str = "") -> str:
        """The unit of a quantity along one axis: angles count in radians, joints that slide in metres."""
        unit = self.quantities[name].unit
        if name == "wrench_estimate" and axis in _ANGLES:
            return "N·m"
        if axis in _ANGLES:
            return unit.replace("m", "rad")
        if name in _OF_JOINTS and axis.isdecimal() and int(axis) in self.slides:
            return unit.replace("rad", "m").replace("N·m", "N")
        return unit

    def units(self, name: str, shape: tuple[int, ...]) -> str:
        """All units of a quantity of this shape at one instant, as in ``m, rad``."""
        found = dict.fromkeys(column.unit for column in self.columns(name, shape))
        return ", ".join(found) or self.unit(name)

    def columns(self, name: str, shape: tuple[int, ...]) -> list[Column]:
        """The columns of a quantity whose values at one instant have this shape, in row-major order.

        They are called ``q_0``, ``x_x``, ``obstacles_0_x``, and like the quantity itself if it is one number.
        """
        quantity = self.quantities[name]
        found = []
        for index in itertools.product(*map(range, shape)):
            labels = [self.label(over, i) for over, i in zip(quantity.over, index, strict=True)]
            axis = labels[-1] if labels and quantity.over[-1] in ("task", "joint") else ""
            meaning = " ".join([quantity.meaning, *labels])
            found.append(Column("_".join([name, *labels]), self.unit(name, axis), meaning))
        return found

    def lines(self, source: object) -> Iterator[tuple[Column, NDArray[Any]]]:
        """Every column of a record beside time, with its values over time (T,)."""
        for name, values in recorded(source).items():
            yield from zip(self.columns(name, values.shape[1:]), flat(values).T, strict=True)

    def sizes(self, document: Mapping[str, Any]) -> dict[Dimension, int]:
        """How many entries a record of a scenario has along each dimension, as far as the scenario says."""
        joints = len(document["q0"])
        from vffnull.model.settings import setting  # `import vffnull` is light

        task = setting(document, "controller.task")
        named: dict[Dimension, int] = {over: len(names) for over, names in NAMES.items()}
        return named | {
            "joint": joints,
            "link": joints,
            "task": _TASK_WIDTHS[self.dimension][task],
            "obstacle": len(document.get("obstacles", ())),
        }


def _moved_by(joint: Mapping[str, Any]) -> str:
    """The name of the link that a joint moves: its own, where the link has none."""
    return str(joint.get("link", joint.get("name", "")))


@cache
def _links_of(model: str) -> tuple[str, ...]:
    """The names of a bundled arm's links; of what has no joints here, none."""
    if model not in _core.ARMS:
        return ()
    return tuple(_moved_by(joint) for joint in _core.arm_model(model)["joints"])


def recorded(source: object) -> dict[str, NDArray[Any]]:
    """The quantities that a result or a state has; one that does not apply is None and left out."""
    import numpy as np

    found = {name: getattr(source, name, None) for name in QUANTITIES}
    return {name: np.asarray(values) for name, values in found.items() if values is not None}


def flat(values: NDArray[Any]) -> NDArray[Any]:
    """The values of a quantity with one row per instant, also of nothing."""
    return values.reshape(len(values), math.prod(values.shape[1:]))


@dataclass(frozen=True)
class Column:
    """One number per instant: an entry of a quantity, as a table shows it."""

    name: str
    unit: str
    meaning: str
