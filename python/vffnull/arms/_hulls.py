"""Convex hulls of points, with as few corners as the core measures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vffnull._support.extras import extra

__all__ = ["CORNERS", "Hull", "halves", "simplified"]

Array = NDArray[np.float64]

CORNERS = 64
"""The most that a hull may have."""
PLANES = CORNERS // 2 + 2
"""Where three meet in a corner, so many make as many corners as there may be."""
WIDER = 1e-7
"""What a hull with fewer corners is larger than it must be, as a share of its diagonal: above rounding."""


class Hull:
    """The convex hull of points (·, 3) [m]: its corners, edges and planes.

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
        # Ends of edges (·, 2, 3), each twice.
        self.edges: Array = points[made.simplices[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)]
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


def halves(hull: Hull, overlap: float) -> tuple[Hull, Hull] | None:
    """A hull cut in the middle of where it is longest, across: two that overlap by a length [m].

    Nothing of one that is not twice as long as that.
    """
    mean = hull.corners.mean(axis=0)
    along = np.linalg.svd(hull.corners - mean, full_matrices=False)[2][0]
    heights = (hull.corners - mean) @ along
    middle = (heights.min() + heights.max()) / 2.0
    if np.ptp(heights) <= 2.0 * overlap:
        return None
    middle += float(mean @ along)
    upper = _beneath(hull, -along, overlap / 2.0 - middle)
    return _beneath(hull, along, middle + overlap / 2.0), upper


def _beneath(hull: Hull, normal: Array, height: float) -> Hull:
    """What of a hull is not above a plane that crosses it."""
    ends = hull.edges @ normal - height
    crossing = (ends.min(axis=1) < 0.0) & (ends.max(axis=1) > 0.0)
    share = (ends[crossing, 0] / (ends[crossing, 0] - ends[crossing, 1]))[:, None]
    across = (1.0 - share) * hull.edges[crossing, 0] + share * hull.edges[crossing, 1]
    return Hull(np.vstack([hull.corners[hull.corners @ normal <= height], across]))
