"""The quantities of a record: what each one means, in which unit, and along which dimensions it runs."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from vffnull import _core

if TYPE_CHECKING:
    from numpy.typing import NDArray

Dimension = Literal["joint", "link", "task", "obstacle", "plane", "store", "port", "objective", "ray"]


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
    "dx": Quantity("m/s", "end-effector velocity", ("task",)),
    "x_ref": Quantity("m", "reference", ("task",)),
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
    "slack": Quantity("m/s²", "breach of the barriers", (), optional=True),
    "path_time": Quantity("s", "path time of the reference", (), optional=True),
    "q_measured": Quantity("rad", "measured joint angle", ("joint",), optional=True),
    "dq_measured": Quantity("rad/s", "measured joint velocity", ("joint",), optional=True),
    "tau_applied": Quantity("N·m", "torque of the drive", ("joint",), optional=True),
    "sensed": Quantity("m", "point seen by the range sensor", ("ray", "plane"), optional=True),
}

AXES = ("x", "y", "phi")
"""Names of the task's axes; a position has the first two, a pose all three."""

NAMES: dict[Dimension, tuple[str, ...]] = {
    "task": AXES,
    "plane": AXES[:2],
    "store": _core.ENERGIES,
    "port": _core.PORTS,
    "objective": _core.OBJECTIVES,
}
"""What the places along a dimension are called; elsewhere they count from 0, as arrays do."""


def unit(name: str, axis: str) -> str:
    """The unit of a quantity along one axis: the orientation of a pose counts in radians."""
    return QUANTITIES[name].unit.replace("m", "rad") if axis == "phi" else QUANTITIES[name].unit


def label(over: Dimension, index: int) -> str:
    """What an entry along a dimension is called: its name if it has one, otherwise its index, from 0."""
    return NAMES[over][index] if over in NAMES else str(index)


def labels(over: Dimension, size: int) -> list[str] | list[int]:
    """What the entries along a dimension of this size are called in a table of their own."""
    return list(NAMES[over][:size]) if over in NAMES else list(range(size))


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


def columns(name: str, shape: tuple[int, ...]) -> list[Column]:
    """The columns of a quantity whose values at one instant have this shape, in row-major order.

    They are called ``q_0``, ``x_x``, ``obstacles_0_x``, and like the quantity itself if it is one number.
    """
    quantity = QUANTITIES[name]
    found = []
    for index in itertools.product(*map(range, shape)):
        labels = [label(over, i) for over, i in zip(quantity.over, index, strict=True)]
        axis = labels[-1] if labels else ""
        meaning = " ".join([quantity.meaning, *labels])
        found.append(Column("_".join([name, *labels]), unit(name, axis), meaning))
    return found
