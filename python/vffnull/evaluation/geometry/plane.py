"""Links and obstacles in the plane, and how far they are from each other."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull.evaluation.geometry.arm import cos_sin, product
from vffnull.evaluation.geometry.motion import Array, Motion

__all__ = ["Kinematics", "World"]


class Kinematics:
    """A planar arm as far as a planner sees it.

    Parameters
    ----------
    lengths : (n,) ndarray
        Lengths of the links [m].
    radius : float
        Half the thickness of the thickest link [m].
    """

    def __init__(self, lengths: Array, radius: float) -> None:
        self.lengths, self.radius, self.n = lengths, radius, len(lengths)

    @classmethod
    def of(cls, arm: Mapping[str, Any]) -> Kinematics:
        """Of the arm's table in a scenario."""
        return cls(np.asarray(arm["lengths"], dtype=float), float(np.max(arm.get("radius", 0.0))))

    def joints(self, q: Array) -> Array:
        """Positions of all joints and the tip, (…, n + 1, 2) [m]."""
        angle = np.cumsum(q, axis=-1)
        links = self.lengths[:, None] * np.stack(cos_sin(angle), axis=-1)
        start = np.zeros((*q.shape[:-1], 1, 2))
        return np.concatenate([start, np.cumsum(links, axis=-2)], axis=-2)


class World:
    """Obstacles as rounded edges: a disc is a point with a radius, a box four segments without.

    What lies inside a box or a polygon has a positive distance here; a link gets there over an edge only.

    Parameters
    ----------
    obstacles : sequence of Mapping
        The scene's obstacles.
    """

    def __init__(self, obstacles: Sequence[Mapping[str, Any]]) -> None:
        self._motions = [Motion(each) for each in obstacles]
        self.middle = np.zeros((len(obstacles), 2))
        """Middle of every obstacle, from its position [m]."""
        self.reach = np.zeros(len(obstacles))
        """Radius about it that holds the whole obstacle [m]."""
        edges: list[tuple[Array, Array, float, int]] = []
        for i, each in enumerate(obstacles):
            corners, radius = _corners(each)
            self.middle[i] = corners.mean(axis=0)
            self.reach[i] = radius + np.linalg.norm(corners - self.middle[i], axis=1).max()
            ends = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            edges += [(a, b, radius, i) for a, b in list(ends)[: 1 if len(corners) == 2 else None]]
        discs = [edge for edge in edges if np.array_equal(edge[0], edge[1])]
        sides = [edge for edge in edges if not np.array_equal(edge[0], edge[1])]
        self._discs, self._sides = _Edges(discs), _Edges(sides)

    def positions(self, times: Array) -> Array:
        """Of all obstacles, (k, obstacles, 2) [m]."""
        if not self._motions:
            return np.zeros((len(times), 0, 2))
        return np.stack([motion(times) for motion in self._motions], axis=1)

    def clearance(self, joints: Array, radius: float, t: float | Array) -> Array:
        """Smallest distance of every link to any obstacle.

        Parameters
        ----------
        joints : (k, n + 1, 2) ndarray
            Positions of the joints [m].
        radius : float
            Half the thickness of the links [m].
        t : float or (k,) ndarray
            When [s].

        Returns
        -------
        (k, n) ndarray
            Distances [m]; not positive in contact, infinite without obstacles.
        """
        at = self.positions(np.atleast_1d(np.asarray(t, dtype=float)))
        a, b = joints[:, :-1, None], joints[:, 1:, None]
        nearest = np.full((len(joints), joints.shape[1] - 1), np.inf)
        for edges, both in ((self._discs, False), (self._sides, True)):
            if len(edges.radius) == 0:
                continue
            c, d = (at[:, edges.of] + end for end in (edges.a, edges.b))
            c, d = c[:, None], d[:, None]
            distance = _to_segment(c, a, b)
            if both:
                for point, e, f in ((d, a, b), (a, c, d), (b, c, d)):
                    np.minimum(distance, _to_segment(point, e, f), out=distance)
                distance[_cross(a, b, c, d)] = 0.0
            np.minimum(nearest, (distance - edges.radius).min(axis=2), out=nearest)
        return nearest - radius


class _Edges:
    def __init__(self, edges: Sequence[tuple[Array, Array, float, int]]) -> None:
        self.a = np.array([edge[0] for edge in edges]).reshape(-1, 2)
        self.b = np.array([edge[1] for edge in edges]).reshape(-1, 2)
        self.radius = np.array([edge[2] for edge in edges])
        self.of = np.array([edge[3] for edge in edges], dtype=int)


def _corners(obstacle: Mapping[str, Any]) -> tuple[Array, float]:
    """Corners about the obstacle's position, and the radius round them."""
    shape, angle = obstacle["shape"], obstacle.get("angle", 0.0)
    if shape["kind"] == "circle":
        corners = [[0.0, 0.0]]
    elif shape["kind"] == "capsule":
        corners = [shape["a"], shape["b"]]
    elif shape["kind"] == "box":
        x, y = 0.5 * np.asarray(shape["size"], dtype=float)
        corners = [[-x, -y], [x, -y], [x, y], [-x, y]]
    else:
        corners = shape["vertices"]
    c, s = math.cos(angle), math.sin(angle)
    turned = product(np.asarray(corners, dtype=float), np.array([[c, s], [-s, c]]))
    return turned, float(shape.get("radius", 0.0))


def _share(point: Array, a: Array, b: Array) -> Array:
    """Where on the segment from a to b the nearest point is, from 0 to 1."""
    along = b - a
    length = (along * along).sum(axis=-1)
    share: Array = np.clip(((point - a) * along).sum(axis=-1) / length, 0.0, 1.0)
    return share


def _to_segment(point: Array, a: Array, b: Array) -> Array:
    away = point - a - _share(point, a, b)[..., None] * (b - a)
    distance: Array = np.sqrt((away * away).sum(axis=-1))
    return distance


def _cross(a: Array, b: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    """Whether the segments ab and cd cross."""

    def side(p: Array, q: Array, r: Array) -> Array:
        turn: Array = (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
        return turn - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    crossing: NDArray[np.bool_] = (side(a, b, c) * side(a, b, d) < 0.0) & (
        side(c, d, a) * side(c, d, b) < 0.0
    )
    return crossing
