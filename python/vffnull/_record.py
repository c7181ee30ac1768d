"""The quantities of a record: what each one means, in which unit, and along which dimensions it runs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Dimension = Literal["joint", "link", "task", "obstacle", "plane"]


@dataclass(frozen=True)
class Quantity:
    """One recorded quantity; its first dimension is always time."""

    unit: str
    meaning: str
    over: tuple[Dimension, ...]


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
    "slack": Quantity("m/s²", "breach of the barriers", ()),
}

AXES = ("x", "y", "phi")
"""Names of the task's axes; a position has the first two, a pose all three."""


def unit(name: str, axis: str) -> str:
    """The unit of a quantity along one axis: the orientation of a pose counts in radians."""
    return QUANTITIES[name].unit.replace("m", "rad") if axis == "phi" else QUANTITIES[name].unit
