"""The convex hull of points of the plane."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[Any]


def hull(points: Array) -> Array:
    """Corners of the convex hull of points (k, 2), anticlockwise."""
    import numpy as np

    order = points[np.lexsort(points.T[::-1])]

    def chain(along: Array) -> list[Array]:
        found: list[Array] = []
        for p in along:
            while len(found) > 1 and turn(found[-2], found[-1], p) <= 0.0:
                found.pop()
            found.append(p)
        return found[:-1]

    corners = [*chain(order), *chain(order[::-1])]
    return np.array(corners) if corners else points[:1]


def turn(a: Array, b: Array, c: Array) -> float:
    """Twice the area of a triangle, positive where it is anticlockwise."""
    (ux, uy), (vx, vy) = b - a, c - a
    return float(ux * vy - uy * vx)
