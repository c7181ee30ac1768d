"""Links and obstacles in space, and how far they are from each other.

Links are capsules (a sphere has both ends in one place), as those of all bundled arms, obstacles are spheres,
capsules and boxes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vffnull.evaluation.geometry.arm import SpatialArm, product
from vffnull.evaluation.geometry.motion import Array, Motion, Turning

__all__ = ["Bodies", "Obstacles", "box_to_segments", "segment_to_segments"]

_INVERSE_GOLDEN = 0.5 * (5.0**0.5 - 1.0)
_HALVINGS = 40  # of the golden section: 1e-8 of a segment


class Bodies:
    """The capsules of an arm.

    Parameters
    ----------
    document : Mapping
        The arm's explicit description.

    Attributes
    ----------
    arm : SpatialArm
        Its kinematics.
    reach : float
        As the arm's maker gives it [m].
    link : (b,) ndarray of int
        The link of every body; -1 is the base, which does not move.
    radius : (b,) ndarray
        Their radii [m].
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        self.arm = SpatialArm(document)
        self.reach = float(document["reach"])
        names = {name: i for i, name in enumerate(self.arm.link_names)}
        self.link = np.array([names.get(each["link"], -1) for each in document["collision"]], dtype=int)
        shapes = [each["shape"] for each in document["collision"]]
        self.radius = np.array([shape["radius"] for shape in shapes], dtype=float)
        ends = [
            [shape.get("a", shape.get("center")), shape.get("b", shape.get("center"))] for shape in shapes
        ]
        self._ends = np.array(ends, dtype=float).reshape(-1, 2, 3)
        ignored = {frozenset(pair) for pair in document.get("ignore", ())}
        of = [each["link"] for each in document["collision"]]
        pairs = [
            (i, j)
            for i in range(len(of))
            for j in range(i)
            if abs(self.link[i] - self.link[j]) > 2 and frozenset((of[i], of[j])) not in ignored
        ]
        self._pairs = np.array(pairs, dtype=int).reshape(-1, 2)

    def ends(self, q: Array) -> Array:
        """Ends of all axes at joint positions (k, n): (k, b, 2, 3) [m]."""
        base = np.broadcast_to(self.arm.mount, (len(q), 1, 4, 4))
        poses = np.concatenate([self.arm.link_poses(q), base], axis=1)[:, self.link]  # -1 is the last
        turned = product(self._ends, np.swapaxes(poses[..., :3, :3], -1, -2))
        found: Array = turned + poses[..., None, :3, 3]
        return found

    def clearance_of_itself(self, q: Array) -> Array:
        """Smallest distance of links with two or more between them, (k,) [m]; infinite if there are none."""
        if not len(self._pairs):
            return np.full(len(q), np.inf)
        ends = self.ends(q)
        i, j = self._pairs.T
        apart = segment_to_segments(ends[:, i], ends[:, j]) - self.radius[i] - self.radius[j]
        nearest: Array = apart.min(axis=1)
        return nearest


class Obstacles:
    """Obstacles in space.

    Parameters
    ----------
    obstacles : sequence of Mapping
        Spheres, capsules and boxes of a scene.
    """

    def __init__(self, obstacles: Sequence[Mapping[str, Any]]) -> None:
        self._motions = [Motion(each, 3) for each in obstacles]
        self._turnings = [Turning(each) for each in obstacles]
        self._shapes = [each["shape"] for each in obstacles]

    def distances(self, ends: Array, radius: Array, times: Array) -> Array:
        """Signed distances of every obstacle from every capsule.

        Parameters
        ----------
        ends : (k, b, 2, 3) ndarray
            Ends of the capsules at every instant [m].
        radius : (b,) ndarray
            Their radii [m].
        times : (k,) ndarray
            The instants [s].

        Returns
        -------
        (k, b, obstacles) ndarray
            Distances [m].
        """
        found = np.empty((len(times), len(radius), len(self._shapes)))
        for i, (motion, turning, shape) in enumerate(
            zip(self._motions, self._turnings, self._shapes, strict=True)
        ):
            turns = turning(times)
            # In the obstacle's frame.
            local = product(ends - motion(times)[:, None, None], turns[:, None])
            if shape["kind"] == "box":
                found[..., i] = box_to_segments(0.5 * np.asarray(shape["size"], dtype=float), local)
            else:
                centre = (0.0, 0.0, 0.0)
                axis = np.array([shape.get("a", centre), shape.get("b", centre)], dtype=float)
                found[..., i] = segment_to_segments(local, axis) - shape["radius"]
        return found - radius[:, None]


def segment_to_segments(one: Array, other: Array) -> Array:
    """Distances (…) [m] of segments (…, 2, 3) from each other.

    The distance is convex in the two shares, so its minimum over the square of both is the free one where
    that lies inside, and else the least of the four edges: an end of one against the other.
    """
    one, other = np.broadcast_arrays(one, other)
    a, b, c, d = one[..., 0, :], one[..., 1, :], other[..., 0, :], other[..., 1, :]
    u, v, w = b - a, d - c, a - c
    least = np.minimum.reduce(
        [_to_segment(a, c, d), _to_segment(b, c, d), _to_segment(c, a, b), _to_segment(d, a, b)]
    )
    uu, uv, vv, uw, vw = _dot(u, u), _dot(u, v), _dot(v, v), _dot(u, w), _dot(v, w)
    det = uu * vv - uv * uv
    free = det > 1e-12 * uu * vv  # parallel segments are nearest at an end
    scale = np.where(free, det, 1.0)
    s, t = (uv * vw - vv * uw) / scale, (uu * vw - uv * uw) / scale
    inside = free & (s > 0.0) & (s < 1.0) & (t > 0.0) & (t < 1.0)
    crossing = np.linalg.norm(w + s[..., None] * u - t[..., None] * v, axis=-1)
    distance: Array = np.where(inside, np.minimum(least, crossing), least)
    return distance


def box_to_segments(half: Array, segments: Array) -> Array:
    """Signed distances (…) [m] of segments (…, 2, 3) from a box of half the edges `half` about the origin.

    The signed distance from a convex body is a convex function of the place: golden section along the
    segment.
    """
    a, along = segments[..., 0, :], segments[..., 1, :] - segments[..., 0, :]

    def at(share: Array) -> Array:
        beyond = np.abs(a + share[..., None] * along) - half
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
        found: Array = outside + np.minimum(beyond.max(axis=-1), 0.0)
        return found

    low, high = np.zeros(a.shape[:-1]), np.ones(a.shape[:-1])
    least = np.minimum(at(low), at(high))
    for _ in range(_HALVINGS):
        step = _INVERSE_GOLDEN * (high - low)
        left, right = high - step, low + step
        at_left, at_right = at(left), at(right)
        np.minimum(least, np.minimum(at_left, at_right), out=least)
        lower = at_left < at_right
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    return least


def _to_segment(point: Array, a: Array, b: Array) -> Array:
    along = b - a
    length = _dot(along, along)
    share = np.clip(_dot(point - a, along) / np.where(length > 0.0, length, 1.0), 0.0, 1.0)
    distance: Array = np.linalg.norm(point - a - share[..., None] * along, axis=-1)
    return distance


def _dot(a: Array, b: Array) -> Array:
    product: Array = (a * b).sum(axis=-1)
    return product
