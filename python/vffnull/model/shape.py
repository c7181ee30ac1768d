"""The corners of a shape in space, for whoever draws or exports it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import vffnull._core as _core
from vffnull._core import matrices

__all__ = ["block", "core_in_space"]

Array = NDArray[np.float64]


def core_in_space(
    shape: Mapping[str, Any],
    orientation: ArrayLike | None = None,
    middle: ArrayLike = (0.0, 0.0, 0.0),
    reach: float = 1.0,
) -> tuple[Array, float]:
    """Corners (·, 3) of a shape's core in an obstacle's frame turned by a quaternion, and its radius.

    A core is a block or the hull of its corners. A block has d edges that are orthogonal to one another: none
    in a ball, one in a capsule, three in a box; of a half-space two, which span as much of its surface as
    lies within `reach` of the foot of `middle`, relative to the obstacle's position. It has 2ᵈ corners, of
    which number i has the edges of the bits of i. A cloud of points is drawn by its points
    (`points_in_space`); its core is the block around them.
    """
    turned = np.eye(3) if orientation is None else matrices(orientation)
    match shape["kind"]:
        case "capsule":
            ends = np.array([shape["a"], shape["b"]], dtype=float)
            start, edges = ends[0], ends[1:] - ends[0]
        case "box":
            size = np.asarray(shape["size"], dtype=float)
            start, edges = -size / 2, np.diag(size)
        case "half_space":
            normal = np.asarray(shape["normal"], dtype=float)
            place = turned.T @ np.asarray(middle, dtype=float)
            sides = np.linalg.svd(normal[None])[2][1:]
            foot = place - (place @ normal) * normal
            start, edges = foot - reach * sides.sum(axis=0), 2.0 * reach * sides
        case "convex":
            vertices = np.asarray(shape["vertices"], dtype=float)
            return vertices[sorted({i for face in _core.hull(vertices) for i in face})] @ turned.T, 0.0
        case "points" if not shape["points"]:
            return np.zeros((1, 3)), 0.0
        case "points":
            points = np.asarray(shape["points"], dtype=float)
            start, edges = points.min(axis=0), np.diag(np.ptp(points, axis=0))
        case _:
            start, edges = np.zeros(3), np.zeros((0, 3))
    return block(start, edges) @ turned.T, float(shape.get("radius", 0.0))


def block(start: Array, edges: Array) -> Array:
    """Corners (2ᵈ, 3) of the block with edges (d, 3) from a corner (3,)."""
    bits = np.arange(2 ** len(edges))[:, None] >> np.arange(len(edges)) & 1
    return np.asarray(start + bits @ edges)
