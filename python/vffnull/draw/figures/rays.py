"""Rays along the view, and what of balls, rods with round ends and flat faces each of them meets first.

Bodies are cut into pieces of three kinds, a table with a row of numbers for each. A piece that may be met by
many rays is met by all of them at once; the small ones, of which there are many, all together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull.draw import geometry

Array = NDArray[np.float64]
Index = NDArray[np.intp]
Where = tuple[slice, slice]
"""Rows and columns of a grid."""
Met = tuple[Index, Array]
"""Which of some rays meet a piece, and the depths [m] to the viewer where they do."""

_LARGE = 600
"""From so many rays on a piece is met on its own."""
_SIDES = {
    4: [[0, 1, 3, 2]],
    8: [
        [base, base | 1 << i, base | 1 << i | 1 << j, base | 1 << j]
        for i, j, k in ((0, 1, 2), (1, 2, 0), (0, 2, 1))
        for base in (0, 1 << k)
    ],
}
"""The sides of a block by the number of its corners, each as corners in order around it."""


@dataclass(frozen=True, eq=False)
class Solid:
    """All points within `radius` of a core with `corners` as of `core_in_space` [m], in a colour."""

    corners: Array
    radius: float
    colour: Array
    """Red, green, blue from 0 to 1."""


class Grid:
    """Rays through a grid: `x` (1, columns) and `y` (rows, 1) [m], ascending; numbered row by row."""

    def __init__(self, xs: Array, ys: Array) -> None:
        self.x, self.y = xs[None, :], ys[:, None]
        self.shape = len(ys), len(xs)
        self.step = float(xs[1] - xs[0]) if len(xs) > 1 else 0.0

    @property
    def size(self) -> int:
        """How many there are."""
        return self.shape[0] * self.shape[1]

    def near(self, low: Array, high: Array) -> NDArray[np.intp]:
        """First and last row and column between two corners (k, 2), for each pair: (4, k)."""
        columns = (np.searchsorted(self.x[0], each[:, 0]) for each in (low, high))
        rows = (np.searchsorted(self.y[:, 0], each[:, 1]) for each in (low, high))
        return np.array([*rows, *columns])

    def at(self, where: Where) -> Grid:
        """Some of them."""
        return Grid(self.x[0, where[1]], self.y[where[0], 0])

    def numbers(self, where: Where, local: Index) -> Index:
        """The numbers of rays that have others in a part of the grid."""
        row, column = np.divmod(local, where[1].stop - where[1].start)
        return np.asarray((row + where[0].start) * self.shape[1] + (column + where[1].start))

    def windows(self, low: Array, high: Array) -> list[Where]:
        """The rows and columns between two corners (k, 2), for each pair."""
        return [(slice(a, b), slice(c, d)) for a, b, c, d in self.near(low, high).T.tolist()]

    def part(self, where: Where) -> tuple[Array, Array]:
        """Where some of them are: in columns, and in rows."""
        return self.x[:, where[1]], self.y[where[0]]

    def places(self, number: Index) -> tuple[Array, Array]:
        """Where some of them are."""
        row, column = np.divmod(number, self.shape[1])
        return self.x[0, column], self.y[row, 0]

    def pairs(self, near: NDArray[np.intp]) -> tuple[Index, Index]:
        """Everything that is near with each of its rays: which, and the number of the ray."""
        first, last, left, right = near
        wide = right - left
        which, place = _spread((last - first) * wide)
        row, column = np.divmod(place, wide[which])
        return which, (first[which] + row) * self.shape[1] + left[which] + column


class Places:
    """Rays in bundles: `x` and `y` (k, rays of each) [m], the lowest bundle first; numbered one bundle after
    the other.
    """

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y
        self.shape = x.shape
        self.step = 0.0

    @property
    def size(self) -> int:
        """How many there are."""
        return self.x.size

    @cached_property
    def _sides(self) -> tuple[Array, Array]:
        return self.x.min(axis=1), self.x.max(axis=1)

    def _bundles(self, low: Array, high: Array) -> tuple[Index, Index]:
        """Which of several pairs of corners (k, 2) have rays between them, and the bundles of these."""
        first = np.searchsorted(self.y[:, -1], low[:, 1])
        last = np.searchsorted(self.y[:, 0], high[:, 1])
        which, place = _spread(np.maximum(last - first, 0))
        bundle = first[which] + place
        left, right = self._sides
        kept = (right[bundle] >= low[which, 0]) & (left[bundle] <= high[which, 0])
        return which[kept], bundle[kept]

    def windows(self, low: Array, high: Array) -> list[Index]:
        """The bundles with a ray between two corners (k, 2), for each pair."""
        which, bundle = self._bundles(low, high)
        return np.split(bundle, np.searchsorted(which, np.arange(1, len(low)))) if len(low) else []

    def pairs(self, low: Array, high: Array) -> tuple[Index, Index]:
        """What several pairs of corners (k, 2) have between them: which pair, and the number of a ray; of a
        bundle all rays.
        """
        which, bundle = self._bundles(low, high)
        each = self.shape[1]
        return np.repeat(which, each), (bundle[:, None] * each + np.arange(each)).ravel()

    def part(self, where: Index) -> tuple[Array, Array]:
        """Where some bundles are."""
        return self.x[where], self.y[where]

    def places(self, number: Index) -> tuple[Array, Array]:
        """Where some of them are."""
        return self.x.ravel()[number], self.y.ravel()[number]


Rays = Grid | Places


def _spread(counts: Index) -> tuple[Index, Index]:
    """Of things that there are so many times each: which one, and the how manieth of it."""
    which = np.repeat(np.arange(len(counts)), counts)
    return which, np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)


@dataclass(frozen=True, eq=False)
class Kind:
    """Pieces that are met in the same way."""

    table: Array
    """What they are told by (·, k)."""
    low: Array
    """Corners of boxes (k, 2) in which they are seen [m]."""
    high: Array
    surface: Index
    """The number of the surface (k,) that each is a part of."""
    meet: Callable[[Array, Array, Array], Met]
    """Which rays at `x` and `y` meet a piece, told by (·,), or one each of as many pieces (·, rays)."""


@dataclass(frozen=True, eq=False)
class Pieces:
    """What bodies are cut into, as seen along the view."""

    kinds: Sequence[Kind]
    surfaces: Array
    """What the normals of every surface are told by (s, 7): of a flat one the normal, then zeros; of a round
    one where its axis begins, the axis, and the radius.
    """
    body: Index
    """The number of the body (s,) that each is a part of."""

    @property
    def box(self) -> tuple[Array, Array]:
        """Corners (2,) around all of them, [m]."""
        low = [each.low for each in self.kinds]
        high = [each.high for each in self.kinds]
        return np.vstack(low).min(axis=0, initial=np.inf), np.vstack(high).max(axis=0, initial=-np.inf)


def pieces(solids: Sequence[Solid], axes: Array, more: float = 0.0) -> Pieces:
    """Bodies as seen along the third of the axes, as rows (3, 3); round ones by so much [m] thicker."""
    round_ones = [i for i, solid in enumerate(solids) if len(solid.corners) <= 2]
    ends = np.array([solids[i].corners[[0, -1]] for i in round_ones]).reshape(-1, 2, 3) @ axes.T
    radius = np.array([solids[i].radius + more for i in round_ones]).reshape(-1)
    start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
    square, flat = (along**2).sum(axis=1), (along[:, :2] ** 2).sum(axis=1)
    low = ends[..., :2].min(axis=1) - radius[:, None]
    high = ends[..., :2].max(axis=1) + radius[:, None]
    is_ball = flat <= 1e-12 * np.maximum(square, radius**2)
    top = np.where(along[:, 2] > 0.0, ends[:, 1, 2], start[:, 2])
    kinds = []
    for which, rows, meet in (
        (is_ball, [start[:, 0], start[:, 1], top, radius**2], _ball),
        (~is_ball, [*start.T, *along.T, radius**2, flat, square], _rod),
    ):
        kinds.append(Kind(np.array(rows)[:, which], low[which], high[which], np.flatnonzero(which), meet))
    surfaces = np.hstack([start, along, radius[:, None]])
    rings, bodies = _faces_of(solids, axes)
    if not bodies:
        return Pieces(kinds, surfaces, np.array(round_ones, dtype=np.intp))
    normals = np.zeros((len(bodies), 7))
    triangles = []
    numbers = []
    for k, (around, out) in enumerate(rings):
        normals[k, :3] = out
        triangles += [around[[0, i, i + 1]] for i in range(1, len(around) - 1)]
        numbers += [len(surfaces) + k] * (len(around) - 2)
    kinds.append(_flat(np.array(triangles), np.array(numbers, dtype=np.intp)))
    return Pieces(kinds, np.vstack([surfaces, normals]), np.array([*round_ones, *bodies], dtype=np.intp))


def _faces_of(solids: Sequence[Solid], axes: Array) -> tuple[list[tuple[Array, Array]], list[int]]:
    """The faces of bodies that are seen: their corners (·, 3), anticlockwise, and normals; and the numbers of
    the bodies.
    """
    found: list[tuple[Array, Array]] = []
    bodies: list[int] = []
    for i, solid in enumerate(solids):
        if len(solid.corners) <= 2:
            continue
        corners = solid.corners @ axes.T
        block = geometry.is_block(corners)
        if block:
            around = corners[_SIDES[len(corners)]]
            out = _cross(around[:, 1] - around[:, 0], around[:, 2] - around[:, 1])
            outside = ((around[:, 0] - corners.mean(axis=0)) * out).sum(axis=1)
            turned = (outside if len(corners) == 8 else out[:, 2]) < 0.0  # a piece of a plane has two sides
            rings = [ring[::-1] if back else ring for ring, back in zip(around, turned, strict=True)]
            out[turned] *= -1.0
        else:
            rings = [corners[ring] for ring in _core.hull(corners)]
            three = np.array([ring[:3] for ring in rings])
            out = _cross(three[:, 1] - three[:, 0], three[:, 2] - three[:, 1])
        out /= np.maximum(np.sqrt((out**2).sum(axis=1)), 1e-300)[:, None]
        for k in np.flatnonzero(out[:, 2] >= 1e-12):  # not from behind, nor from the edge
            found.append((rings[k], out[k]))
            bodies.append(i)
    return found, bodies


def _cross(a: Array, b: Array) -> Array:
    """Cross products (k, 3); NumPy's takes several times as long for a few."""
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)


def _flat(corners: Array, surface: Index) -> Kind:
    """Triangles (k, 3, 3), anticlockwise: three lines with what is inside on their left, and a plane."""
    rows = []
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        # so that the neighbour on the other side has exactly the opposite, and no ray passes between them
        rows += [a[:, 1] - b[:, 1], b[:, 0] - a[:, 0], a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]]
    out = _cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    out /= np.where(out[:, 2:] > 0.0, out[:, 2:], np.inf)
    rows += [(corners[:, 0] * out).sum(axis=1), out[:, 0], out[:, 1]]
    low, high = corners[..., :2].min(axis=1), corners[..., :2].max(axis=1)
    return Kind(np.array(rows), low, high, surface, _triangle)


def nearest(found: Pieces, rays: Rays) -> tuple[Array, NDArray[np.int32]]:
    """The depth (rays,) [m] at which each ray meets something first, and the number of the surface; −∞ and −1
    where there is nothing.
    """
    depths = np.full(rays.size, -np.inf)
    numbers = np.full(rays.size, -1, dtype=np.int32)
    with np.errstate(invalid="ignore"):
        for kind in found.kinds:
            if isinstance(rays, Grid):
                near = rays.near(kind.low, kind.high)
                first, last, left, right = near
                large = (last - first) * (right - left) > _LARGE
                for i in np.flatnonzero(large):
                    where = slice(*near[:2, i].tolist()), slice(*near[2:, i].tolist())
                    hit, depth = kind.meet(kind.table[:, i], *rays.part(where))
                    ray = rays.numbers(where, hit)
                    front = depth > depths[ray]
                    ray = ray[front]
                    depths[ray], numbers[ray] = depth[front], kind.surface[i]
                small = np.flatnonzero(~large)
                which, ray = rays.pairs(near[:, small])
                which = small[which]
            else:
                which, ray = rays.pairs(kind.low, kind.high)
            hit, depth = kind.meet(kind.table[:, which], *rays.places(ray))
            ray = ray[hit]
            front = depth > depths[ray]
            ray, depth, which = ray[front], depth[front], which[hit[front]]
            np.maximum.at(depths, ray, depth)
            most = np.flatnonzero(depth == depths[ray])[::-1]  # of equal ones the first
            numbers[ray[most]] = kind.surface[which[most]]
    return depths, numbers


def _ball(told: Array, x: Array, y: Array) -> Met:
    """A ball, or a rod that is seen from its end."""
    over = (told[3] - (x - told[0]) ** 2) - (y - told[1]) ** 2
    hit = np.flatnonzero(over >= 0.0)
    told = _of(told, hit)
    return hit, told[2] + np.sqrt(over.ravel()[hit])


def _rod(told: Array, x: Array, y: Array) -> Met:
    """A rod: where its side is met beyond an end, the ball there may be."""
    x, y = x - told[0], y - told[1]
    aside = x * told[4] - y * told[3]
    over = told[6] * told[7] - aside * aside
    hit = np.flatnonzero(over >= 0.0)
    along = (x * told[3] + y * told[4]).ravel()[hit]
    _, _, up, dx, dy, dz, square_radius, flat, square = told = _of(told, hit)
    depth = (dz * along + np.sqrt(square * over.ravel()[hit])) / flat
    share = (along + depth * dz) / square
    ends = np.flatnonzero((share < 0.0) | (share > 1.0))
    end = (share[ends] > 1.0).astype(float)
    where = np.unravel_index(hit[ends], over.shape)
    x, y = (np.broadcast_to(each, over.shape)[where] for each in (x, y))
    dx, dy, dz, square_radius = _of(told, ends)[3:7]
    depth[ends] = end * dz + np.sqrt(square_radius - (x - end * dx) ** 2 - (y - end * dy) ** 2)
    return hit, up + depth


def _triangle(told: Array, x: Array, y: Array) -> Met:
    """A triangle."""
    inside = told[0] * x + told[1] * y + told[2] >= 0.0
    for i in (3, 6):
        inside &= told[i] * x + told[i + 1] * y + told[i + 2] >= 0.0
    hit = np.flatnonzero(inside)
    where = np.unravel_index(hit, inside.shape)
    x, y = (np.broadcast_to(each, inside.shape)[where] for each in (x, y))
    told = _of(told, hit)
    return hit, told[9] - told[10] * x - told[11] * y


def _of(told: Array, hit: Index) -> Any:
    """What is told of the pieces that are hit; of a single piece the same for all rays."""
    return told if told.ndim == 1 else told[:, hit]
