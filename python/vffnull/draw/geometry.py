"""Shapes and distances that drawing needs, in any number of dimensions; outlines are of the plane.

A body is all that lies within a radius of the convex hull of some corners: a disc or ball has one corner, a
capsule two. Seen from afar such a body is again one of the kind: its corners are seen where they are, and the
radius stays. `outline` draws it so.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import vffnull._core as _core
from vffnull._core import matrices
from vffnull.model.hull import hull, turn
from vffnull.model.shape import block

Array = NDArray[np.float64]

STEP = 0.09
"""Between two points of a round outline [rad], at most."""
_ON = 1e-6
"""How far beyond a surface a point may be that counts as on it [m]."""


def points_in_space(shape: Mapping[str, Any], orientation: ArrayLike | None = None) -> Array | None:
    """The points (k, 3) of a cloud in an obstacle's frame turned by a quaternion; None of another shape."""
    if shape["kind"] != "points":
        return None
    turned = np.eye(3) if orientation is None else matrices(orientation)
    return np.asarray(np.reshape(np.asarray(shape["points"], dtype=float), (-1, 3)) @ turned.T)


def core(shape: Mapping[str, Any], angle: float = 0.0) -> tuple[Array, float]:
    """Corners (·, 2) of a shape's core in an obstacle's frame turned by `angle`, and the radius around it."""
    match shape["kind"]:
        case "circle":
            corners = np.zeros((1, 2))
        case "capsule":
            corners = np.array([shape["a"], shape["b"]], dtype=float)
        case "box":
            w, h = np.asarray(shape["size"], dtype=float) / 2
            corners = np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
        case _:
            corners = np.asarray(shape["vertices"], dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    return corners @ np.array([[c, s], [-s, c]]), float(shape.get("radius", 0.0))


def view_of(dimension: int) -> Array:
    """How a scene of so many dimensions is seen in a picture: the picture's axes as rows (2, dimension).

    The plane is seen as it is; space from the front right and a little from above, without perspective.
    """
    if dimension == 2:
        return np.eye(2)
    return looking(-60.0, 25.0)


def looking(azimuth: float, elevation: float) -> Array:
    """The axes (2, 3), right and up, of a picture taken from there [°]."""
    azimuth, elevation = np.radians(azimuth), np.radians(elevation)
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    ahead = -np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    )
    return np.stack([right, np.cross(right, ahead)])


def seen(points: Array, view: Array | None = None) -> Array:
    """Where points (…, D) are in a picture (…, 2); by default in `view_of` their dimension."""
    if view is None and points.shape[-1] == 2:
        return points
    axes = view_of(points.shape[-1]) if view is None else view
    return np.asarray(points @ axes.T)


def in_space(points: Array) -> Array:
    """Points (…, D) in space (…, 3): those of the plane at z = 0."""
    missing = 3 - points.shape[-1]
    return np.concatenate([points, np.zeros((*points.shape[:-1], missing))], axis=-1)


def outline(corners: Array, radius: float, view: Array | None = None) -> Array:
    """The outline (·, 2) in a picture of all points within `radius` of the convex hull of corners (·, D)."""
    flat = seen(corners, view)
    if len(flat) > 2 and corners.shape[1] > 2:
        flat = hull(flat)
    return rounded(flat, radius)


def _area(corners: Array) -> float:
    """Twice the area of a polygon, positive where it is anticlockwise."""
    x, y = corners.T
    return float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def rounded(corners: Array, radius: float) -> Array:
    """The outline of all points within `radius` of a convex polygon (or a segment, or a point)."""
    if radius == 0.0:
        return corners
    edges = np.roll(corners, -1, axis=0) - corners
    if len(corners) > 2 and _area(corners) < 0.0:
        return rounded(corners[::-1], radius)
    if not edges.any():
        ring: Array = corners[0] + radius * arc(0.0, 2 * np.pi)
        return ring
    normals = np.arctan2(-edges[:, 0], edges[:, 1])
    turns = (normals - np.roll(normals, 1)) % (2 * np.pi)
    arcs = zip(corners, normals - turns, turns, strict=True)
    return np.vstack([corner + radius * arc(start, turn) for corner, start, turn in arcs])


def arc(start: float, turn: float) -> Array:
    """Points on the unit circle (·, 2)."""
    angles = start + np.linspace(0.0, turn, 2 + int(turn / STEP))
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def capsule(a: ArrayLike, b: ArrayLike, radius: float) -> Array:
    """The outline of all points within `radius` of a segment of the plane."""
    return rounded(np.array([a, b], dtype=float), radius)


def edges_of(corners: Array) -> list[tuple[Array, Array]]:
    """Ends of the edges of a core (…, k, D): of a point the point itself, of a segment that one, else all
    around.
    """
    count = corners.shape[-2]
    last = count if count > 2 else 1
    return [(corners[..., i, :], corners[..., (i + 1) % count, :]) for i in range(last)]


def nearest(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """The points of segments ab and cd (…, 2) that are nearest to each other, elementwise.

    Segments that do not cross are nearest at an end of one of them; those that cross are given the
    crossing's nearest end, so that there is a direction between the two points.
    """
    candidates = [(p, _onto(p, c, d)) for p in (a, b)] + [(_onto(p, a, b), p) for p in (c, d)]
    shape = np.broadcast_shapes(a.shape, c.shape)
    first = np.stack([np.broadcast_to(on_ab, shape) for on_ab, _ in candidates])
    second = np.stack([np.broadcast_to(on_cd, shape) for _, on_cd in candidates])
    best = np.argmin(np.linalg.norm(first - second, axis=-1), axis=0)[None, ..., None]
    return np.take_along_axis(first, best, 0)[0], np.take_along_axis(second, best, 0)[0]


def is_block(corners: Array) -> bool:
    """Whether the core in space with these corners (·, 3) is a block, not only a hull."""
    if len(corners) not in (1, 2, 4, 8):
        return False
    start, edges = edges_in_space(corners)
    size = float(np.abs(edges).max(initial=0.0))
    across = edges @ edges.T
    right = np.abs(across - np.diag(np.diag(across))).max(initial=0.0) <= 1e-9 * size**2
    return bool(right and np.abs(block(start, edges) - corners).max() <= 1e-9 * size)


def is_surface(corners: Array) -> bool:
    """Whether these are the corners of a piece of a plane."""
    return len(corners) == 4 and is_block(corners)


def edges_in_space(corners: Array) -> tuple[Array, Array]:
    """Start (…, 3) and edges (…, d, 3) of a block, of its corners (…, 2ᵈ, 3)."""
    count = corners.shape[-2].bit_length() - 1
    start = corners[..., 0, :]
    edges = [corners[..., 1 << i, :] - start for i in range(count)]
    return start, np.stack(edges, axis=-2) if edges else np.zeros((*start.shape[:-1], 0, 3))


def triangles(corners: Array) -> NDArray[np.intp]:
    """The surface of a hull with corners (·, 3), or of a piece of a plane, as triangles (·, 3) of them.

    They are anticlockwise seen from outside.
    """
    if is_surface(corners):
        return np.array([[0, 1, 3], [0, 3, 2]])
    rings = _core.hull(corners)
    return np.array([[ring[0], a, b] for ring in rings for a, b in pairwise(ring[1:])])


def slimmer(corners: Array, radius: float, share: float) -> tuple[Array, float]:
    """A body in space with a share of its radius; or, if it has none, as much smaller where it is thin."""
    if corners.shape[-2] <= 2:
        return corners, share * radius
    middle = corners.mean(axis=-2, keepdims=True)
    extents = np.linalg.svd(corners - middle, compute_uv=False)
    less = (1.0 - share) * extents[..., -1] / extents[..., 0]
    return middle + (1.0 - less[..., None, None]) * (corners - middle), share * radius


def way_out(corners: Array, radius: float, start: Array, along: Array) -> Array:
    """How far it is from places (T, 3) along unit vectors (T, 3) to where these leave a body in space [m].

    The body is all points within a radius of the hull of corners (T, ·, 3), with one of both. Where a place
    is not in the body, −∞.
    """
    if corners.shape[1] <= 2:
        return _out_of_a_rod(corners, radius, start, along)
    far = np.full(len(start), np.inf)
    near = -far
    for ring in _faces(corners[0].tobytes()):
        edges = corners[:, ring[1:]] - corners[:, ring[:1]]
        out = np.cross(edges[:, :-1], edges[:, 1:]).sum(axis=1)
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        depth = ((corners[:, ring[0]] - start) * out).sum(axis=1)
        slope = (along * out).sum(axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            far = np.where(slope > 0.0, np.minimum(far, depth / slope), far)
        near = np.maximum(near, -depth)
    return np.where(near <= _ON, np.maximum(far, 0.0), -np.inf)


@lru_cache(maxsize=256)
def _faces(corners: bytes) -> list[list[int]]:
    """The faces of a hull with corners (·, 3): links keep theirs."""
    return _core.hull(np.frombuffer(corners).reshape(-1, 3))


def _out_of_a_rod(corners: Array, radius: float, start: Array, along: Array) -> Array:
    """The same of a rod with round ends: where the last of its two balls and its side is left."""
    a, b = corners[:, 0], corners[:, -1]
    found = np.full(len(start), -np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for ball in (a, b):
            off = ball - start
            ahead = (off * along).sum(axis=1)
            over = radius**2 - (off**2).sum(axis=1) + ahead**2
            found = np.fmax(found, ahead + np.sqrt(over))
        length = np.linalg.norm(b - a, axis=1, keepdims=True)
        axis = (b - a) / length
        off, aside = start - a, along - (along * axis).sum(axis=1, keepdims=True) * axis
        off = off - (off * axis).sum(axis=1, keepdims=True) * axis
        square, half = (aside**2).sum(axis=1), (aside * off).sum(axis=1)
        side = (np.sqrt(half**2 - square * ((off**2).sum(axis=1) - radius**2)) - half) / square
        height = ((start + side[:, None] * along - a) * axis).sum(axis=1)
        found = np.fmax(found, np.where((height >= 0.0) & (height <= length[:, 0]), side, -np.inf))
    away = np.linalg.norm(start - _onto(start, a, b), axis=1) - radius
    return np.where(away <= _ON, np.maximum(found, 0.0), -np.inf)


def distance(place: Array, corners: Array, radius: float) -> float:
    """How far a place (2,) is from a body of the plane; negative inside."""
    away = min(float(np.linalg.norm(place - _onto(place, a, b))) for a, b in edges_of(corners))
    sides = [turn(a, b, place) for a, b in edges_of(corners)] if len(corners) > 2 else [-1.0, 1.0]
    within = all(side >= 0.0 for side in sides) or all(side <= 0.0 for side in sides)
    return (-away if within else away) - radius


def _onto(p: Array, a: Array, b: Array) -> Array:
    """The point of segment ab nearest to p."""
    along = b - a
    square = np.maximum((along**2).sum(-1), 1e-300)
    share = np.clip(((p - a) * along).sum(-1) / square, 0.0, 1.0)
    place: Array = a + share[..., None] * along
    return place
