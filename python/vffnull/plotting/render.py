"""Bodies in space as a picture: one ray per dot along the view, and what it meets first.

Balls, rods with round ends, boxes, convex hulls and pieces of planes are met exactly, so that everything
covers what is behind it and nothing is made of facets. There is no perspective: parallel stays parallel, and
a metre is as long at the back as in front.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from vffnull import _core
from vffnull._hull import hull
from vffnull.plotting import geometry

Array = NDArray[np.float64]
Shades = NDArray[np.float32]
Normals = Callable[[Array, Array, Array], Array]
Window = tuple[slice, slice]
Sheet = tuple[Window, Shades, Array, Array]  # where it is, rows and columns; colours, depths, opacities there

_LIGHT = np.array([-0.45, 0.62, 0.64])  # towards it: right, up, to the viewer
_FINE = 2
"""Rays along either side of a dot."""
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
        fine = self.dot / _FINE
        tall, wide = self.shape[0] * _FINE, self.shape[1] * _FINE
        xs = self.low[0] + fine * (np.arange(wide) + 0.5)
        ys = self.low[1] + fine * (np.arange(tall) + 0.5)
        axes = np.vstack([self.view, np.cross(self.view[0], self.view[1])])
        sheets: list[Sheet] = []
        ghosts: list[Sheet] = []
        covered = np.zeros((tall, wide), dtype=bool)
        for layer in layers:
            if layer.floor is not None and axes[2, 2] > _GRAZING:
                dropped = [_dropped(solid.corners, layer.floor) for solid in layer.solids]
                rows, columns = window = _around(layer.solids, dropped, axes, xs, ys)
                sheets.append((window, *_shadow(layer.solids, layer.floor, axes, xs[columns], ys[rows])))
            rows, columns = window = _around(layer.solids, [s.corners for s in layer.solids], axes, xs, ys)
            x, y = xs[columns], ys[rows]
            colours, depths = trace(layer.solids, axes, x, y)
            if layer.floor is not None:
                height = x[None, :] * axes[0, 2] + y[:, None] * axes[1, 2]
                with np.errstate(invalid="ignore"):
                    height = height + (depths * axes[2, 2] if abs(axes[2, 2]) > 1e-9 else 0.0)
                depths = np.where(height < layer.floor, -np.inf, depths)
            if layer.box is not None:
                depths = _within(*layer.box, depths, axes, x, y)
            there = np.isfinite(depths)
            sheet = (window, colours, depths, np.where(there, layer.opacity, 0.0))
            (ghosts if layer.ghost else sheets).append(sheet)
            if not layer.ghost and layer.opacity == 1.0:
                covered[window] |= there
        for window, colours, depths, opacity in ghosts:
            sheets.append((window, colours, depths, np.where(covered[window], 0.3 * opacity, opacity)))
        picture = _laid(sheets, (tall, wide))
        rays = [picture[i::_FINE, j::_FINE] for i in range(_FINE) for j in range(_FINE)]
        picture = np.asarray(np.sum(rays, axis=0) / np.float32(_FINE**2))
        cover = picture[..., 3:]
        picture[..., :3] = np.where(cover > 0.0, picture[..., :3] / np.maximum(cover, 1e-6), 1.0)
        return np.asarray(np.clip(255.0 * picture + 0.5, 0, 255), dtype=np.uint8)


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
    colours = np.ones((len(ys), len(xs), 3), dtype=np.float32)
    depths: Array = np.full((len(ys), len(xs)), -np.inf)
    for solid in solids:
        if isinstance(solid, Balls):
            _dab(solid, axes, xs, ys, colours, depths)
            continue
        corners = solid.corners @ axes.T
        rows, columns = _window(corners[:, :2], solid.radius, xs, ys)
        if columns.start == columns.stop or rows.start == rows.stop:
            continue
        x, y = xs[columns], ys[rows]
        before = depths[rows, columns]
        for depth, normal_at in _surfaces(corners, solid.radius, x[None, :], y[:, None]):
            up, across = np.nonzero(depth > before)
            before[up, across] = depth[up, across]
            normal = normal_at(x[across], y[up], depth[up, across])
            colours[rows, columns][up, across] = _shade(normal, solid.colour, len(corners) <= 2)
    return colours, depths


def _dab(balls: Balls, axes: Array, xs: Array, ys: Array, colours: Shades, depths: Array) -> None:
    """Put balls into a picture: at every offset from the middle all of them at once."""
    step = float(xs[1] - xs[0]) if len(xs) > 1 else balls.radius
    middle = balls.points @ axes.T
    column, row = (np.rint((middle[:, i] - at[0]) / step).astype(int) for i, at in enumerate((xs, ys)))
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
            painted[place[front[place] == depth]] = _shade(normal[None], balls.colour, True)


def _surfaces(corners: Array, radius: float, x: Array, y: Array) -> Iterator[tuple[Array, Normals]]:
    """The depth of every surface of a body, and what gives the normals at points of it."""
    if len(corners) <= 2:
        yield _rod(corners, radius, x, y), partial(_off_the_axis, corners, radius)
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
            yield _face(base, edges[i], edges[j], x, y), partial(_everywhere, out)


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


def _off_the_axis(corners: Array, radius: float, x: Array, y: Array, depth: Array) -> Array:
    """Normals (·, 3) of a rod at points of its surface."""
    d = corners[-1] - corners[0]
    off = np.stack([x, y, depth], axis=-1) - corners[0]
    share = np.clip(off @ d / max(float(d @ d), 1e-300), 0.0, 1.0)
    return np.asarray((off - share[:, None] * d) / radius)


def _face(base: Array, e: Array, f: Array, x: Array, y: Array) -> Array:
    """The depth of a parallelogram; −∞ beside it."""
    across = e[0] * f[1] - e[1] * f[0]
    dx, dy = x - base[0], y - base[1]
    u, v = (dx * f[1] - dy * f[0]) / across, (e[0] * dy - e[1] * dx) / across
    inside = (u >= 0.0) & (u <= 1.0) & (v >= 0.0) & (v <= 1.0)
    return np.where(inside, base[2] + u * e[2] + v * f[2], -np.inf)


def _hull(corners: Array, x: Array, y: Array) -> Iterator[tuple[Array, Normals]]:
    """The depth of every face of a hull that is seen, −∞ beside it, and its normals."""
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
        yield depth, partial(_everywhere, out)


def _everywhere(normal: Array, x: Array, _y: Array, _depth: Array) -> Array:
    """The same normal at every point."""
    return np.broadcast_to(normal, (len(x), 3))


def _shade(normal: Array, colour: Array, is_round: bool) -> Array:
    """Light from above and the left, a soft gleam, and a dark rim that parts a body from those behind."""
    facing = np.clip(normal @ (_LIGHT / np.linalg.norm(_LIGHT)), 0.0, 1.0)
    strength = 0.5 + 0.5 * facing
    if not is_round:
        return np.asarray(strength[:, None] * colour)
    front = np.clip(normal[:, 2] / 0.42, 0.0, 1.0)
    strength *= 0.5 + 0.5 * front**0.7
    return np.asarray(np.clip(strength[:, None] * colour + 0.22 * facing[:, None] ** 24, 0.0, 1.0))


def _shadow(
    solids: Iterable[Solid | Balls], floor: float, axes: Array, xs: Array, ys: Array
) -> tuple[Shades, Array, Array]:
    """What the solids shade of a level floor below them, the light straight above: colour, depth, opacity."""
    right, up, ahead = axes
    x, y = xs[None, :], ys[:, None]
    depth = (floor - x * right[2] - y * up[2]) / ahead[2]
    place = [x * right[i] + y * up[i] + depth * ahead[i] for i in range(2)]
    dark = np.zeros(depth.shape)
    for solid in solids:
        if isinstance(solid, Balls) or (len(solid.corners) <= 2 and solid.radius <= 0.0):
            continue
        window = _window(_dropped(solid.corners, floor) @ axes[:2].T, 1.2 * solid.radius, xs, ys)
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


def _around(
    solids: Sequence[Solid | Balls], corners: Sequence[Array], axes: Array, xs: Array, ys: Array
) -> Window:
    """Rows and columns of the dots that solids may cover whose corners are there."""
    places = [
        (flat.min(axis=0) - 1.2 * solid.radius, flat.max(axis=0) + 1.2 * solid.radius)
        for solid, flat in zip(solids, (each @ axes[:2].T for each in corners), strict=True)
        if len(flat)
    ]
    if not places:
        return slice(0, 0), slice(0, 0)
    step = float(xs[1] - xs[0]) if len(xs) > 1 else 0.0
    return _window(np.concatenate(places).reshape(-1, 2), step, xs, ys)


def _inside(outline: Array, x: Array, y: Array) -> Array:
    """How far places are within an anticlockwise outline (·, 2), as a share of half of its least width."""
    least, width = np.full(x.shape, np.inf), np.inf
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        inward = np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.linalg.norm(b - a)), 1e-300)
        least = np.minimum(least, inward[0] * (x - a[0]) + inward[1] * (y - a[1]))
        width = min(width, float(((outline - a) @ inward).max()))
    return np.asarray(least / max(width / 2.0, 1e-300))


def _window(flat: Array, radius: float, xs: Array, ys: Array) -> tuple[slice, slice]:
    """Rows and columns of the dots within a radius of the box around places (·, 2)."""
    low, high = flat.min(axis=0) - radius, flat.max(axis=0) + radius
    return slice(*np.searchsorted(ys, [low[1], high[1]])), slice(*np.searchsorted(xs, [low[0], high[0]]))


def _within(low: Array, high: Array, depths: Array, axes: Array, xs: Array, ys: Array) -> Array:
    """The depths, −∞ where a ray meets nothing within a box."""
    rows, columns = np.nonzero(np.isfinite(depths))
    points = np.stack([xs[columns], ys[rows], depths[rows, columns]], axis=1) @ axes
    outside = ((points < low) | (points > high)).any(axis=1)
    kept = depths.copy()
    kept[rows[outside], columns[outside]] = -np.inf
    return kept


def _dropped(corners: Array, floor: float | None) -> Array:
    """Corners (·, 3) straight below on a floor."""
    below = corners.copy()
    below[:, 2] = floor
    return below


def _laid(sheets: list[Sheet], shape: tuple[int, int]) -> Shades:
    """Sheets of colours, depths and opacities over each other, at every dot in the order of their depths."""
    picture = np.zeros((*shape, 4), dtype=np.float32)
    if not sheets:
        return picture
    count: NDArray[np.int8] = np.zeros(shape, dtype=np.int8)
    for window, _, _, opacity in sheets:
        count[window] += opacity > 0.0
    for window, colour, _, opacity in sheets:  # most dots see one sheet alone
        alone = (count[window] == 1) & (opacity > 0.0)
        share = opacity[alone].astype(np.float32)
        part = picture[window]
        part[alone, :3], part[alone, 3] = colour[alone] * share[:, None], share
    several = np.flatnonzero(count > 1)
    for here in np.array_split(several, len(several) // 100_000 + 1):
        rows, columns = np.divmod(here, shape[1])
        depths = np.full((len(sheets), len(here)), -np.inf)
        colours = np.zeros((len(sheets), len(here), 3), dtype=np.float32)
        shares = np.zeros((len(sheets), len(here)), dtype=np.float32)
        for k, ((down, across), colour, depth, opacity) in enumerate(sheets):
            inside = (down.start <= rows) & (rows < down.stop)
            inside &= (across.start <= columns) & (columns < across.stop)
            place = rows[inside] - down.start, columns[inside] - across.start
            depths[k, inside], shares[k, inside] = depth[place], opacity[place]
            colours[k, inside] = colour[place]
        over = np.zeros((len(here), 4), dtype=np.float32)
        each = np.arange(len(here))
        for at in np.argsort(depths, axis=0):
            share, colour = shares[at, each][:, None], colours[at, each]
            over[:, :3] = colour * share + over[:, :3] * (1.0 - share)
            over[:, 3:] = share + over[:, 3:] * (1.0 - share)
        picture[rows, columns] = over
    return picture
