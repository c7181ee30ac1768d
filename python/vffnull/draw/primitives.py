"""What is drawn of a scene at an instant: one list of primitives for all painters.

A painter (figures, films, reports, notebooks, the live page, Rerun) gets the list from `Scene.at` and knows
no arm: it draws a `Body`, a `Curve`, an `Arrow` or `Marks` in the look of its role. Places have as many
coordinates as the scene; a painter of pictures asks `geometry.seen` and `geometry.outline` where they are on
paper. Links, joints and obstacles are numbered from 0, as the arrays of a result are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vffnull.draw import geometry

Array = NDArray[np.float64]
Rows = NDArray[np.intp]

Role = Literal[
    "influence",
    "obstacle",
    "base",
    "reference",
    "plan",
    "link",
    "joint",
    "trail",
    "tool",
    "force",
    "wrench",
    "sensed",
    "target",
]
"""What a primitive stands for; painted in this order."""

ROLES: tuple[Role, ...] = (
    "influence", "obstacle", "base", "reference", "plan", "link", "joint", "trail", "tool", "force",
    "wrench", "sensed", "target",
)  # fmt: skip

COLOURS: dict[Role, str] = {
    "influence": "#D55E00",
    "obstacle": "#D55E00",
    "base": "#222222",
    "reference": "#777777",
    "plan": "#009E73",
    "link": "#0072B2",
    "joint": "#0072B2",
    "trail": "#009E73",
    "tool": "#222222",
    "force": "#B2182B",
    "wrench": "#CC79A7",
    "sensed": "#222222",
    "target": "#222222",
}
"""The same in every medium; from Okabe and Ito's palette, which everybody can tell apart."""

UNSEEN = "#8C92AC"
"""The colour of an obstacle that the controller does not know of."""


@dataclass(frozen=True, eq=False)
class Body:
    """All points within `radius` [m] of the convex hull of `corners` (k, D) [m]; a line if that is 0.

    `seen` is false of an obstacle that the controller does not know of.
    """

    role: Role
    index: int
    corners: Array
    radius: float
    seen: bool = True

    @property
    def colour(self) -> str:
        """That of its role, or of what is not seen."""
        return COLOURS[self.role] if self.seen else UNSEEN

    def outline(self, view: Array | None = None) -> Array:
        """Its outline in a picture (·, 2)."""
        return geometry.outline(self.corners, self.radius, view)


@dataclass(frozen=True, eq=False)
class Cloud:
    """Balls of a `radius` [m] around `points` (k, 3) [m]."""

    role: Role
    index: int
    points: Array
    radius: float


@dataclass(frozen=True, eq=False)
class Curve:
    """A line through `points` (·, D) [m]."""

    role: Role
    points: Array


@dataclass(frozen=True, eq=False)
class Arrow:
    """A force `vector` (D,) [N] at a `place` (D,) [m]."""

    role: Role
    index: int
    place: Array
    vector: Array

    def drawn(self, scale: float) -> tuple[Array, Array]:
        """Where it begins, and how it goes from there [m], with so many metres for a newton.

        The repulsion of a field begins at its place; what pushes from outside ends there.
        """
        shaft = self.vector * scale
        return self.place - shaft if self.role == "wrench" else self.place, shaft


@dataclass(frozen=True, eq=False)
class Marks:
    """Signs at `points` (·, D) [m]."""

    role: Role
    points: Array


@dataclass(frozen=True, eq=False)
class Axes:
    """A frame of reference: its origin (3,) and its three axes as columns (3, 3), of a `length` [m]."""

    role: Role
    origin: Array
    axes: Array
    length: float


Primitive = Body | Cloud | Curve | Arrow | Marks | Axes
