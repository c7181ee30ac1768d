"""Bodies in space as a picture: rays along the view, and what they meet first.

Balls, rods with round ends, boxes, convex hulls and pieces of planes are met exactly, so that everything
covers what is behind it and nothing is made of facets. There is no perspective: parallel stays parallel, and
a metre is as long at the back as in front. A dot has one ray, and
three more where an edge may run through it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull.draw import geometry
from vffnull.model.hull import hull

Array = NDArray[np.float64]
Shades = NDArray[np.float32]
Where = tuple[slice, slice] | NDArray[np.intp]  # of rays: rows and columns, or numbers
Surface = tuple[Array, Array, float]  # what its normals are told by, see `_shaded`

_LIGHT = np.array([-0.45, 0.62, 0.64])  # towards it: right, up, to the viewer
_FINE = 2
"""Rays along either side of a dot."""
_SOFT = 0.02
"""How much a shadow's opacity may change from dot to dot where one ray is enough."""
_RIM = 0.42
"""Up to which part of the normal that looks to the viewer a body is darker."""
_DULL = 0.8
"""Below which part of it that looks to the light nothing of the gleam is seen: a thousandth."""
_GRAZING = 0.05
"""Sine of the angle above a floor from which on it is seen."""


@dataclass(frozen=True, eq=False)
class Solid:
    """All points within `radius` of a core with `corners` as of `geometry.core_in_space` [m], in a colour."""

    corners: Array
    radius: float
    colour: Array
    """Red, green, blue from 0 to 1."""


@dataclass(frozen=True, eq=False)
class Balls:
    """Balls of a `radius` around as many points (k, 3) as one likes [m], in a colour."""

    points: Array
    radius: float
    colour: Array
    """Red, green, blue from 0 to 1."""

    @property
    def corners(self) -> Array:
        """The points: what a picture that shows everything has to show."""
        return self.points


@dataclass(frozen=True, eq=False)
class Layer:
    """Solids that are drawn together; what is behind them shines through unless `opacity` is 1."""

    solids: Sequence[Solid | Balls]
    opacity: float = 1.0
    floor: float | None = None
    """The height of a floor [m] on which the solids cast a shadow and which hides what is below, if any."""
    ghost: bool = False
    """Whether what it has in front of others is fainter still, so that these are seen well."""
    box: tuple[Array, Array] | None = None
    """Opposite corners (3,) [m] of a box at which the solids are cut off, if they are."""


@dataclass(frozen=True, eq=False)
class Canvas:
    """A picture's place: `view` has its axes as rows (2, 3), right and up, orthonormal.

    Attributes
    ----------
    view : (2, 3) ndarray
        The picture's axes.
    low : (2,) ndarray
        The lower left corner in these axes [m].
    dot : float
        The side of a dot [m].
    shape : tuple
        Rows and columns of dots.
    """

    view: Array
    low: Array
    dot: float
    shape: tuple[int, int]

    @classmethod
    def around(cls, layers: Iterable[Layer], view: Array, dot: float) -> Canvas:
        """The smallest one that shows everything, shadows included."""
        lows, highs = [], []
        from_above = float(np.cross(view[0], view[1])[2]) > _GRAZING
        for layer in layers:
            for solid in layer.solids:
                casts = layer.floor is not None and from_above
                copies = [solid.corners, *([_dropped(solid.corners, layer.floor)] if casts else [])]
                for corners in copies:
                    if not len(corners):
                        continue
                    flat = corners @ view.T
                    lows.append(flat.min(axis=0) - 1.2 * solid.radius)
                    highs.append(flat.max(axis=0) + 1.2 * solid.radius)
        low = np.min(lows, axis=0) - dot if lows else np.zeros(2)
        high = np.max(highs, axis=0) + dot if highs else np.ones(2) * dot
        wide, tall = np.ceil((high - low) / dot).astype(int)
        return cls(view, low, dot, (int(tall), int(wide)))

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, bottom, top [m]."""
        (left, bottom), (tall, wide) = self.low, self.shape
        return float(left), float(left + wide * self.dot), float(bottom), float(bottom + tall * self.dot)

    def draw(self, layers: Iterable[Layer]) -> NDArray[np.uint8]:
        """The picture (rows, columns, 4): red, green, blue, opacity; the first row is the lowest."""
        layers = list(layers)
        fine = self.dot / _FINE
        tall, wide = self.shape[0] * _FINE, self.shape[1] * _FINE
        xs = self.low[0] + fine * (np.arange(wide) + 0.5)
        ys = self.low[1] + fine * (np.arange(tall) + 0.5)
        axes = np.vstack([self.view, np.cross(self.view[0], self.view[1])])
        if any(isinstance(solid, Balls) for layer in layers for solid in layer.solids):
            picture, _ = _seen(layers, axes, Grid(xs, ys))  # a cloud is edges everywhere
            blocks = picture.reshape(self.shape[0], _FINE, self.shape[1], _FINE, 4)
            picture = np.asarray(blocks.mean(axis=(1, 3)))
        else:
            picture, edges = _seen(layers, axes, Grid(xs[::_FINE], ys[::_FINE]))
            rows, columns = (_FINE * each for each in np.nonzero(edges))
            up, across = np.divmod(np.arange(1, _FINE**2), _FINE)  # the other rays of a dot
            others, _ = _seen(layers, axes, Places(xs[columns[:, None] + across], ys[rows[:, None] + up]))
            picture[edges] = (picture[edges] + others.sum(axis=1)) / np.float32(_FINE**2)
        dots = np.full((*self.shape, 4), (255, 255, 255, 0), dtype=np.uint8)
        seen = picture[..., 3] > 0.0
        found = picture[seen]
        found[:, :3] /= found[:, 3:]
        dots[seen] = np.clip(255.0 * found + 0.5, 0, 255)
        return dots


class Grid:
    """Rays through a grid: `x` (1, columns) and `y` (rows, 1) [m], ascending."""

    def __init__(self, xs: Array, ys: Array) -> None:
        self.x, self.y = xs[None, :], ys[:, None]
        self.shape: tuple[int, ...] = len(ys), len(xs)
        self.step = float(xs[1] - xs[0]) if len(xs) > 1 else 0.0

    def near(self, low: Array, high: Array) -> list[Where]:
        """Those between two corners (k, 2), for each pair."""
        left, right = (np.searchsorted(self.x[0], each[:, 0]).tolist() for each in (low, high))
        first, last = (np.searchsorted(self.y[:, 0], each[:, 1]).tolist() for each in (low, high))
        rows, columns = map(slice, first, last), map(slice, left, right)
        return list(zip(rows, columns, strict=True))

    def at(self, where: Any) -> Grid:
        """Some of them."""
        return Grid(self.x[0, where[1]], self.y[where[0], 0])


class Places:
    """Rays in bundles: `x` and `y` (k, rays of each) [m], the lowest bundle first."""

    def __init__(self, x: Array, y: Array) -> None:
        self.x, self.y = x, y
        self.shape: tuple[int, ...] = x.shape
        self.step = 0.0

    @cached_property
    def _sides(self) -> tuple[Array, Array]:
        return self.x.min(axis=1), self.x.max(axis=1)

    def near(self, low: Array, high: Array) -> list[Where]:
        """The bundles with one between two corners (k, 2), and some beside, for each pair."""
        left, right = self._sides
        first = np.searchsorted(self.y[:, -1], low[:, 1]).tolist()
        last = np.searchsorted(self.y[:, 0], high[:, 1]).tolist()
        return [
            i + np.flatnonzero((right[i:j] >= west) & (left[i:j] <= east))
            for i, j, west, east in zip(first, last, low[:, 0], high[:, 0], strict=True)
        ]

    def at(self, where: Any) -> Places:
        """Some of them."""
        return Places(self.x[where], self.y[where])


Rays = Grid | Places


@dataclass(frozen=True, eq=False)
class Sheet:
    """What of a layer is seen by rays: colours (…, 3), depths [m] and opacities."""

    where: Where
    colours: Shades
    depths: Array
    opacity: Array


def _seen(layers: Iterable[Layer], axes: Array, rays: Rays) -> tuple[Shades, NDArray[np.bool_]]:
    """Colours times opacity, and opacity (…, 4), and where another ray of the dot may see something else."""
    sheets: list[Sheet] = []
    ghosts: list[Sheet] = []
    covered = np.zeros(rays.shape, dtype=bool)
    edges = np.zeros(rays.shape, dtype=bool)
    for layer in layers:
        if layer.floor is not None and axes[2, 2] > _GRAZING:
            dropped = [_dropped(solid.corners, layer.floor) for solid in layer.solids]
            where = _around(layer.solids, dropped, axes, rays)
            sheets.append(Sheet(where, *_shadow(layer.solids, layer.floor, axes, rays.at(where))))
            if isinstance(rays, Grid):
                edges[where] |= _steps(sheets[-1].opacity, _SOFT)
        where = _around(layer.solids, [s.corners for s in layer.solids], axes, rays)
        near = rays.at(where)
        colours, depths, surface = _traced(layer.solids, axes, near)
        if layer.floor is not None:
            height = near.x * axes[0, 2] + near.y * axes[1, 2]
            with np.errstate(invalid="ignore"):
                height = height + (depths * axes[2, 2] if abs(axes[2, 2]) > 1e-9 else 0.0)
            depths = np.where(height < layer.floor, -np.inf, depths)
        if layer.box is not None:
            depths = _within(*layer.box, depths, axes, near)
        there = np.isfinite(depths)
        if isinstance(near, Grid):
            edges[where] |= _steps(np.where(there, surface, -1), 0) | _slender(layer.solids, axes, near)
        sheet = Sheet(where, colours, depths, np.where(there, layer.opacity, 0.0))
        (ghosts if layer.ghost else sheets).append(sheet)
        if not layer.ghost and layer.opacity == 1.0:
            covered[where] |= there
    for sheet in ghosts:
        opacity = np.where(covered[sheet.where], 0.3 * sheet.opacity, sheet.opacity)
        sheets.append(Sheet(sheet.where, sheet.colours, sheet.depths, opacity))
    return _laid(sheets, rays.shape), edges


def _steps(values: NDArray[Any], most: float) -> NDArray[np.bool_]:
    """Where values (rows, columns) differ from the next ones, above, to the right, or both."""
    found = np.zeros(values.shape, dtype=bool)
    up = np.abs(values[1:] - values[:-1]) > most
    across = np.abs(values[:, 1:] - values[:, :-1]) > most
    found[:-1] |= up
    found[:, :-1] |= across
    found[:-1, :-1] |= up[:, 1:] | across[1:]
    return found


def _slender(solids: Iterable[Solid | Balls], axes: Array, rays: Grid) -> NDArray[np.bool_]:
    """Where a rod may be seen that is so thin that it may pass between rays."""
    found = np.zeros(rays.shape, dtype=bool)
    thin = [solid for solid in solids if len(solid.corners) <= 2 and solid.radius < rays.step]
    seen = [solid.corners @ axes.T for solid in thin]
    margins = [solid.radius + rays.step for solid in thin]
    for corners, margin, where in zip(seen, margins, _windows(seen, margins, rays), strict=True):
        near = rays.at(where)
        found[where] |= np.isfinite(_rod(corners, margin, near.x, near.y))
    return found


def _windows(seen: Sequence[Array], margins: Sequence[float], rays: Rays) -> list[Where]:
    """Which rays are within a margin of the box around corners (·, 2 or 3), for each of them."""
    if not seen:
        return []
    starts = np.cumsum([0, *map(len, seen[:-1])])
    flat = np.concatenate(seen)[:, :2]
    margin = np.array(margins)[:, None]
    low, high = np.minimum.reduceat(flat, starts) - margin, np.maximum.reduceat(flat, starts) + margin
    return rays.near(low, high)


def rods(points: Array, radius: float, colour: Array, *, dashed: bool = False, most: int = 80) -> list[Solid]:
    """A line through points (·, 3) as rods of equal length, every other one left out if it is dashed."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    if along[-1] < 2.0 * radius:
        return []
    count = int(np.clip(along[-1] / (4.0 * radius), 2, most))
    places = np.linspace(0.0, along[-1], count + 1)
    fine = np.stack([np.interp(places, along, points[:, i]) for i in range(3)], axis=1)
    shown = range(0, count, 2 if dashed else 1)
    return [Solid(fine[i : i + 2], radius, colour) for i in shown]


def arrow(tail: Array, vector: Array, radius: float, colour: Array) -> list[Solid]:
    """A shaft with a head from a tail (3,) along a vector (3,) [m]."""
    length = float(np.linalg.norm(vector))
    head = min(0.5 * length, 6.0 * radius)
    neck = tail + vector * (1.0 - head / length)
    steps = np.linspace(0.0, 1.0, 9)
    places = neck + steps[:, None] * (tail + vector - neck)
    cone = [
        Solid(place[None], (1.0 - 0.9 * s) * 2.6 * radius, colour)
        for place, s in zip(places, steps, strict=True)
    ]
    return [Solid(np.stack([tail, neck]), radius, colour), *cone]


def trace(solids: Iterable[Solid | Balls], axes: Array, xs: Array, ys: Array) -> tuple[Shades, Array]:
    """Colours (h, w, 3) and depths to the viewer (h, w) [m] of what is met; −∞ where there is nothing."""
    colours, depths, _ = _traced(list(solids), axes, Grid(xs, ys))
    return colours, depths


def _traced(
    solids: Sequence[Solid | Balls], axes: Array, rays: Rays
) -> tuple[Shades, Array, NDArray[np.int32]]:
    """The same of any rays, and the number of the surface that each of them meets; −1 where there is none."""
    depths: Array = np.full(rays.shape, -np.inf)
    number = np.full(rays.shape, -1, dtype=np.int32)
    surfaces: list[Surface] = []
    paints: list[Array] = []
    bodies = [solid for solid in solids if isinstance(solid, Solid)]
    views = [solid.corners @ axes.T for solid in bodies]
    windows = _windows(views, [solid.radius for solid in bodies], rays)
    for solid, corners, where in zip(bodies, views, windows, strict=True):
        near = rays.at(where)
        if 0 in near.shape:
            continue
        before, seen = depths[where], number[where]
        for depth, surface in _surfaces(corners, solid.radius, near.x, near.y):
            in_front = depth > before
            np.copyto(before, depth, where=in_front)
            np.copyto(seen, len(surfaces), where=in_front)
            surfaces.append(surface)
            paints.append(solid.colour)
        depths[where], number[where] = before, seen
    colours = np.ones((*rays.shape, 3), dtype=np.float32)
    met = number >= 0
    if met.any():
        x, y = (np.broadcast_to(each, rays.shape)[met] for each in (rays.x, rays.y))
        colours[met] = _shaded(surfaces, np.array(paints), number[met], np.stack([x, y, depths[met]], axis=1))
    for cloud in solids:
        if isinstance(cloud, Balls):
            assert isinstance(rays, Grid)
            _dab(cloud, axes, rays.x[0], rays.y[:, 0], colours, depths)
    return colours, depths, number


def _dab(balls: Balls, axes: Array, xs: Array, ys: Array, colours: Shades, depths: Array) -> None:
    """Put balls into a picture: at every offset from the middle all of them at once."""
    step = float(xs[1] - xs[0]) if len(xs) > 1 else balls.radius
    middle = balls.points @ axes.T
    column, row = (np.rint((middle[:, i] - at[0]) / step).astype(int) for i, at in enumerate((xs, ys)))
    colour = balls.colour.astype(np.float32)
    front, painted = depths.reshape(-1), colours.reshape(-1, 3)
    reach = int(balls.radius / step)
    for across in range(-reach, reach + 1):
        for up in range(-reach, reach + 1):
            normal = np.array([across * step, up * step, 0.0]) / balls.radius
            if (over := 1.0 - float(normal @ normal)) < 0.0:
                continue
            normal[2] = np.sqrt(over)
            x, y = column + across, row + up
            seen = (x >= 0) & (x < len(xs)) & (y >= 0) & (y < len(ys))
            place, depth = y[seen] * len(xs) + x[seen], middle[seen, 2] + balls.radius * normal[2]
            np.maximum.at(front, place, depth)
            painted[place[front[place] == depth]] = _shade(normal[None].astype(np.float32), colour, True)


def _surfaces(corners: Array, radius: float, x: Array, y: Array) -> Iterator[tuple[Array, Surface]]:
    """The depth of every surface of a body, and what its normals are told by."""
    if len(corners) <= 2:
        yield _rod(corners, radius, x, y), (corners[0], corners[-1] - corners[0], radius)
        return
    if not geometry.is_block(corners):
        yield from _hull(corners, x, y)
        return
    start, edges = geometry.edges_in_space(corners)
    pairs = [(0, 1)] if len(edges) == 2 else [(0, 1), (1, 2), (0, 2)]
    for i, j in pairs:
        out = np.cross(edges[i], edges[j])
        if abs(out[2]) < 1e-12:
            continue  # seen from its edge
        out = out / np.linalg.norm(out) * np.sign(out[2])
        for base in [start, *(start + edges[k] for k in range(len(edges)) if k not in (i, j))]:
            yield _face(base, edges[i], edges[j], x, y), (out, np.zeros(3), 0.0)


def _rod(corners: Array, radius: float, x: Array, y: Array) -> Array:
    """The depth of a ball, or of a rod with round ends; −∞ beside it."""
    a = corners[0]
    d = corners[-1] - a
    mx, my = x - a[0], y - a[1]
    depth = np.full(np.broadcast_shapes(x.shape, y.shape), -np.inf)
    square, flat = float(d @ d), float(d[:2] @ d[:2])
    with np.errstate(invalid="ignore"):
        for end in (np.zeros(3), d) if square > 0.0 else (d,):
            over = radius**2 - (mx - end[0]) ** 2 - (my - end[1]) ** 2
            depth = np.fmax(depth, end[2] + np.sqrt(over))
        if flat > 1e-12 * max(square, radius**2):
            s = mx * d[0] + my * d[1]
            rest = (mx**2 + my**2 - radius**2) * square - s**2
            side = (d[2] * s + np.sqrt(d[2] ** 2 * s**2 - flat * rest)) / flat
            share = (s + side * d[2]) / square
            depth = np.fmax(depth, np.where((share >= 0.0) & (share <= 1.0), side, -np.inf))
    return np.asarray(depth + a[2])


def _face(base: Array, e: Array, f: Array, x: Array, y: Array) -> Array:
    """The depth of a parallelogram; −∞ beside it."""
    across = e[0] * f[1] - e[1] * f[0]
    dx, dy = x - base[0], y - base[1]
    u, v = (dx * f[1] - dy * f[0]) / across, (e[0] * dy - e[1] * dx) / across
    inside = (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (v <= 1.0)
    return np.where(inside, base[2] + u * e[2] + v * f[2], -np.inf)


def _hull(corners: Array, x: Array, y: Array) -> Iterator[tuple[Array, Surface]]:
    """The depth of every face of a hull that is seen, −∞ beside it, and its normal."""
    for ring in _core.hull(corners):
        around = corners[ring]
        sides = np.roll(around, -1, axis=0) - around
        out = np.cross(sides[0], sides[1])
        out /= np.linalg.norm(out)
        if out[2] < 1e-12:
            continue  # seen from behind, or from its edge
        depth = around[0, 2] - (out[0] * (x - around[0, 0]) + out[1] * (y - around[0, 1])) / out[2]
        for corner, side in zip(around, sides, strict=True):
            left = side[0] * (y - corner[1]) - side[1] * (x - corner[0])
            depth = np.where(left >= 0.0, depth, -np.inf)
        yield depth, (out, np.zeros(3), 0.0)


def _shaded(surfaces: Sequence[Surface], paints: Array, number: NDArray[np.int32], points: Array) -> Shades:
    """Colours (k, 3) of points (k, 3) of numbered surfaces.

    A flat one is told by its normal; one that is round, by where its axis begins, the axis, and the radius.
    """
    first: Shades = np.array([each[0] for each in surfaces], dtype=np.float32)
    axis: Shades = np.array([each[1] for each in surfaces], dtype=np.float32)
    radius: Shades = np.array([each[2] for each in surfaces], dtype=np.float32)
    along = axis / np.maximum((axis**2).sum(axis=1), np.float32(1e-30))[:, None]
    places, colours = points.astype(np.float32), paints.astype(np.float32)
    found = np.empty(points.shape, dtype=np.float32)
    for is_round in (True, False):
        which = np.flatnonzero((radius > 0.0)[number] == is_round)
        of = number[which]
        normal = first[of]
        if is_round:
            normal = places[which] - normal
            share = np.clip(np.einsum("ij,ij->i", normal, along[of]), 0.0, 1.0)
            normal -= share[:, None] * axis[of]
            normal /= radius[of, None]
        found[which] = _shade(normal, colours[of], is_round)
    return found


def _shade(normal: Shades, colour: Shades, is_round: bool) -> Shades:
    """Light from above and the left, a soft gleam, and a dark rim that parts a body from those behind."""
    facing = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)).astype(np.float32), 0.0, 1.0)
    strength = 0.5 + 0.5 * facing
    if not is_round:
        return np.asarray(strength[:, None] * colour)
    rim = np.flatnonzero(normal[:, 2] < _RIM)
    strength[rim] *= 0.5 + 0.5 * (np.maximum(normal[rim, 2], 0.0) / _RIM) ** 0.7
    lit = strength[:, None] * colour
    gleam = np.flatnonzero(facing > _DULL)
    lit[gleam] += 0.22 * facing[gleam, None] ** 24
    return np.asarray(np.minimum(lit, 1.0))


def _shadow(
    solids: Iterable[Solid | Balls], floor: float, axes: Array, rays: Rays
) -> tuple[Shades, Array, Array]:
    """What the solids shade of a level floor below them, the light straight above: colour, depth, opacity."""
    right, up, ahead = axes
    x, y = rays.x, rays.y
    depth = (floor - x * right[2] - y * up[2]) / ahead[2]
    place = [x * right[i] + y * up[i] + depth * ahead[i] for i in range(2)]
    dark = np.zeros(depth.shape)
    casting = [
        solid for solid in solids if isinstance(solid, Solid) and (len(solid.corners) > 2 or solid.radius > 0)
    ]
    views = [_dropped(solid.corners, floor) @ axes[:2].T for solid in casting]
    windows = _windows(views, [1.2 * solid.radius for solid in casting], rays)
    for solid, window in zip(casting, windows, strict=True):
        if len(solid.corners) > 2:
            inside = _inside(hull(solid.corners[:, :2]), place[0][window], place[1][window])
            dark[window] = np.maximum(dark[window], np.clip((inside + 0.15) / 0.5, 0.0, 1.0))
            continue
        a, b = solid.corners[0, :2], solid.corners[-1, :2]
        along = b - a
        off = [place[i][window] - a[i] for i in range(2)]
        share = np.clip((off[0] * along[0] + off[1] * along[1]) / max(along @ along, 1e-300), 0.0, 1.0)
        away = np.hypot(off[0] - share * along[0], off[1] - share * along[1])
        dark[window] = np.maximum(dark[window], np.clip((1.15 - away / solid.radius) / 0.5, 0.0, 1.0))
    return np.full((*depth.shape, 3), 0.25, dtype=np.float32), depth, 0.2 * dark


def _around(solids: Sequence[Solid | Balls], corners: Sequence[Array], axes: Array, rays: Rays) -> Where:
    """Which rays may meet solids whose corners are there."""
    flat = np.concatenate([np.empty((0, 3)), *corners]) @ axes[:2].T
    margin = np.repeat([1.2 * solid.radius for solid in solids], [len(each) for each in corners])[:, None]
    low = (flat - margin).min(axis=0, initial=np.inf) - rays.step
    high = (flat + margin).max(axis=0, initial=-np.inf) + rays.step
    return rays.near(low[None], high[None])[0]


def _inside(outline: Array, x: Array, y: Array) -> Array:
    """How far places are within an anticlockwise outline (·, 2), as a share of half of its least width."""
    least, width = np.full(x.shape, np.inf), np.inf
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        inward = np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.linalg.norm(b - a)), 1e-300)
        least = np.minimum(least, inward[0] * (x - a[0]) + inward[1] * (y - a[1]))
        width = min(width, float(((outline - a) @ inward).max()))
    return np.asarray(least / max(width / 2.0, 1e-300))


def _within(low: Array, high: Array, depths: Array, axes: Array, rays: Rays) -> Array:
    """The depths, −∞ where a ray meets nothing within a box."""
    there = np.isfinite(depths)
    x, y = (np.broadcast_to(each, depths.shape)[there] for each in (rays.x, rays.y))
    points = np.stack([x, y, depths[there]], axis=1) @ axes
    kept = depths.copy()
    kept[there] = np.where(((points < low) | (points > high)).any(axis=1), -np.inf, depths[there])
    return kept


def _dropped(corners: Array, floor: float | None) -> Array:
    """Corners (·, 3) straight below on a floor."""
    below = corners.copy()
    below[:, 2] = floor
    return below


def _laid(sheets: Sequence[Sheet], shape: tuple[int, ...]) -> Shades:
    """Sheets over each other, in the order of their depths: colours times opacity, and opacity."""
    picture = np.zeros((*shape, 4), dtype=np.float32)
    count: NDArray[np.int8] = np.zeros(shape, dtype=np.int8)
    for sheet in sheets:
        count[sheet.where] += sheet.opacity > 0.0
    for sheet in sheets:  # most rays meet one sheet alone
        alone = ((count[sheet.where] == 1) & (sheet.opacity > 0.0))[..., None]
        share = sheet.opacity[..., None].astype(np.float32)
        part = picture[sheet.where]
        np.copyto(part[..., :3], sheet.colours * share, where=alone)
        np.copyto(part[..., 3:], share, where=alone)
        picture[sheet.where] = part
    several = count > 1
    place = np.cumsum(several).reshape(shape) - 1
    many = int(place.size and place.flat[-1]) + 1
    depths = np.full((many, len(sheets)), -np.inf, dtype=np.float32)
    seen = np.zeros((many, len(sheets), 4), dtype=np.float32)
    for k, sheet in enumerate(sheets):
        here = several[sheet.where] & (sheet.opacity > 0.0)
        to = place[sheet.where][here]
        share = sheet.opacity[here].astype(np.float32)
        depths[to, k] = sheet.depths[here]
        seen[to, k, :3] = sheet.colours[here] * share[:, None]
        seen[to, k, 3] = share
    over = np.zeros((many, 4), dtype=np.float32)
    each = np.arange(many)
    for at in np.argsort(depths, axis=1).T[-int(count.max(initial=1)) :]:  # from behind
        top = seen[each, at]
        over = top + over * (1.0 - top[:, 3:])
    picture[several] = over[: several.sum()]
    return picture
