"""Convex hulls of points, with as few corners as the core measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vffnull._support.extras import extra

__all__ = ["CORNERS", "Hull", "simplified"]

Array = NDArray[np.float64]

CORNERS = 64
"""The most that a hull may have."""
PLANES = CORNERS // 2 + 2
"""Where three meet in a corner, so many make as many corners as there may be."""
WIDER = 1e-7
"""What a hull with fewer corners is larger than it must be, as a share of its diagonal: above rounding."""


class Hull:
    """The convex hull of points (·, 3) [m]: its corners and planes.

    Raises
    ------
    scipy.spatial.QhullError
        If the points are flat.
    ImportError
        Without SciPy.
    """

    def __init__(self, points: Array) -> None:
        made = extra("scipy.spatial", "meshes").ConvexHull(points)
        self.corners: Array = points[made.vertices]
        self.planes: Array = made.equations  # normal·x + offset ≤ 0 within
        self.volume = float(made.volume)

    def outside(self, points: Array) -> Array:
        """How far points are beyond the plane that they are farthest beyond [m], negative within."""
        found: Array = (points @ self.planes[:, :3].T + self.planes[:, 3]).max(axis=1)
        return found


def simplified(hull: Hull) -> Hull:
    """The hull, or one that encloses it where it has too many corners.

    Beginning with a box, the plane that cuts off the farthest corner is added until there are as many as
    there may be.
    """
    if len(hull.corners) <= CORNERS:
        return hull
    scipy = extra("scipy.spatial", "meshes")
    middle = hull.corners.mean(axis=0)
    low, high = hull.corners.min(axis=0), hull.corners.max(axis=0)
    wider = WIDER * float(np.linalg.norm(high - low))
    planes = hull.planes - [0.0, 0.0, 0.0, wider]
    chosen = np.block([[np.eye(3), -high[:, None] - wider], [-np.eye(3), low[:, None] - wider]])
    while True:
        corners: Array = scipy.HalfspaceIntersection(chosen, middle).intersections
        if len(chosen) == PLANES:
            return Hull(corners)
        farthest = corners[np.argmax(hull.outside(corners))]
        beyond = planes[:, :3] @ farthest + planes[:, 3]
        chosen = np.vstack([chosen, planes[np.argmax(beyond)]])
