"""Bodies in space as a picture: rays along the view, and what they meet first.

Balls, rods with round ends, boxes, convex hulls and pieces of planes are met exactly, so that everything
covers what is behind it and nothing is made of facets. There is no perspective: parallel stays parallel, and
a metre is as long at the back as in front. A dot has one ray, and
three more where an edge may run through it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull.draw.figures.rays import Grid, Places, Rays, Solid, nearest, pieces
from vffnull.model.hull import hull

Array = NDArray[np.float64]
Shades = NDArray[np.float32]
Index = NDArray[np.intp]

_LIGHT = np.array([-0.45, 0.62, 0.64]) / np.linalg.norm([-0.45, 0.62, 0.64])
"""Towards it: right, up, to the viewer."""
_BRIGHT = _LIGHT.astype(np.float32)
_NOTHING = np.array([255, 255, 255, 0], dtype=np.uint8).view(np.uint32)[0]
"""A dot that is seen through."""
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
            edge = np.flatnonzero(edges)
            rows, columns = (_FINE * each for each in np.divmod(edge, self.shape[1]))
            up, across = np.divmod(np.arange(1, _FINE**2), _FINE)  # the other rays of a dot
            others, _ = _seen(layers, axes, Places(xs[columns[:, None] + across], ys[rows[:, None] + up]))
            picture = picture.reshape(-1, 4)
            picture[edge] = (picture[edge] + others.sum(axis=1)) / np.float32(_FINE**2)
        picture = picture.reshape(-1, 4)
        dots = np.full(self.shape, _NOTHING).view(np.uint8).reshape(*self.shape, 4)
        seen = np.flatnonzero(picture[:, 3] > 0.0)
        found = picture[seen]
        found[:, :3] *= 255.0 / found[:, 3:]
        found[:, 3] *= 255.0
        found += 0.5
        dots.reshape(-1, 4)[seen] = np.minimum(found, 255.0, out=found)
        return dots


@dataclass(frozen=True, eq=False)
class Sheet:
    """What of a layer is seen by some rays, given by their numbers: colours (k, 3), depths [m], opacities."""

    rays: Index
    colours: Shades
    depths: Array
    opacity: Shades


def _seen(layers: Iterable[Layer], axes: Array, rays: Rays) -> tuple[Shades, NDArray[np.bool_]]:
    """Colours times opacity, and opacity (…, 4), and where another ray of the dot may see something else."""
    sheets: list[Sheet] = []
    ghosts: list[Sheet] = []
    covered = np.zeros(rays.size, dtype=bool)
    edges = np.zeros(rays.shape, dtype=bool)
    for layer in layers:
        if layer.floor is not None and axes[2, 2] > _GRAZING:
            sheets.append(_shadow(layer.solids, layer.floor, axes, rays, edges))
        sheet = _traced(layer, axes, rays, edges)
        (ghosts if layer.ghost else sheets).append(sheet)
        if not layer.ghost and layer.opacity == 1.0:
            covered[sheet.rays] = True
    for sheet in ghosts:
        opacity = np.where(covered[sheet.rays], np.float32(0.3), np.float32(1.0)) * sheet.opacity
        sheets.append(Sheet(sheet.rays, sheet.colours, sheet.depths, opacity))
    return _laid(sheets, rays.size).reshape(*rays.shape, 4), edges


def _steps(values: NDArray[Any], most: float, found: NDArray[np.bool_]) -> None:
    """Mark where values (rows, columns) differ from the next ones, above, to the right, or both."""
    up = np.abs(values[1:] - values[:-1]) > most if most else values[1:] != values[:-1]
    across = np.abs(values[:, 1:] - values[:, :-1]) > most if most else values[:, 1:] != values[:, :-1]
    found[:-1] |= up
    found[:, :-1] |= across
    found[:-1, :-1] |= up[:, 1:]
    found[:-1, :-1] |= across[1:]


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
    rays = Grid(xs, ys)
    sheet = _traced(Layer(list(solids)), axes, rays, np.zeros(rays.shape, dtype=bool))
    colours = np.ones((rays.size, 3), dtype=np.float32)
    depths = np.full(rays.size, -np.inf)
    colours[sheet.rays], depths[sheet.rays] = sheet.colours, sheet.depths
    return colours.reshape(*rays.shape, 3), depths.reshape(rays.shape)


def _traced(layer: Layer, axes: Array, rays: Rays, edges: NDArray[np.bool_]) -> Sheet:
    """The bodies of a layer as rays see them; of a grid it is marked where another surface begins."""
    bodies = [solid for solid in layer.solids if isinstance(solid, Solid)]
    clouds = [solid for solid in layer.solids if isinstance(solid, Balls)]
    found = pieces(bodies, axes)
    near, where = rays, None
    if isinstance(rays, Grid) and not clouds:
        low, high = found.box
        (where,) = rays.windows(low[None] - rays.step, high[None] + rays.step)  # with what is beside them
        near = rays.at(where)
    depths, numbers = nearest(found, near)
    painted = None
    if clouds:
        assert isinstance(near, Grid)
        painted = np.ones((near.size, 3), dtype=np.float32)
        for cloud in clouds:
            _dab(cloud, axes, near, painted, depths, numbers)
    met = np.flatnonzero(depths > -np.inf)
    depth = depths[met]
    x, y = near.places(met)
    points = x, y, depth
    kept = np.ones(len(met), dtype=bool)
    if layer.floor is not None:
        kept &= _along(axes[:, 2], points) >= layer.floor
    if layer.box is not None:
        for axis, low, high in zip(axes.T, *layer.box, strict=True):
            height = _along(axis, points)
            kept &= (height >= low) & (height <= high)
    numbers[met[~kept]] = -1
    if isinstance(near, Grid):
        at = edges if where is None else edges[where]
        _steps(numbers.reshape(near.shape), 0.0, at)
        slender = [s for s in bodies if len(s.corners) <= 2 and s.radius < near.step]
        if slender:  # may pass between rays
            _, beside = nearest(pieces(slender, axes, near.step), near)
            at |= (beside >= 0).reshape(near.shape)
    met, depth = met[kept], depth[kept]
    number = numbers[met]
    paints = np.array([solid.colour for solid in bodies], dtype=np.float32).reshape(-1, 3)[found.body]
    if painted is None:
        colours = _shaded(found.surfaces, paints, number, (x[kept], y[kept], depth))
    else:
        own = number >= 0
        colours = painted[met]
        colours[own] = _shaded(found.surfaces, paints, number[own], (x[kept][own], y[kept][own], depth[own]))
    if where is not None:
        assert isinstance(rays, Grid)
        met = rays.numbers(where, met)
    return Sheet(met, colours, depth, np.full(len(met), layer.opacity, dtype=np.float32))


def _along(axis: Array, points: tuple[Array, Array, Array]) -> Array:
    """The coordinate of points along an axis of the world, which has these components in the picture's."""
    return np.asarray(points[0] * axis[0] + points[1] * axis[1] + points[2] * axis[2])


def _dab(
    balls: Balls, axes: Array, rays: Grid, colours: Shades, depths: Array, numbers: NDArray[np.int32]
) -> None:
    """Put balls into a picture: at every offset from the middle all of them at once."""
    step = rays.step or balls.radius
    tall, wide = rays.shape
    middle = balls.points @ axes.T
    column, row = (
        np.rint((middle[:, i] - at) / step).astype(int) for i, at in enumerate((rays.x[0, 0], rays.y[0, 0]))
    )
    colour = balls.colour.astype(np.float32)
    reach = int(balls.radius / step)
    for across in range(-reach, reach + 1):
        for up in range(-reach, reach + 1):
            normal = np.array([across * step, up * step, 0.0]) / balls.radius
            if (over := 1.0 - float(normal @ normal)) < 0.0:
                continue
            normal[2] = np.sqrt(over)
            x, y = column + across, row + up
            seen = (x >= 0) & (x < wide) & (y >= 0) & (y < tall)
            place, depth = y[seen] * wide + x[seen], middle[seen, 2] + balls.radius * normal[2]
            np.maximum.at(depths, place, depth)
            front = place[depths[place] == depth]
            facing, ahead = np.float32(normal @ _LIGHT), np.float32(normal[2])
            colours[front] = _shade(np.array([facing]), np.array([ahead]), colour)
            numbers[front] = -1


def _shaded(
    surfaces: Array, paints: Shades, number: NDArray[np.int32], points: tuple[Array, Array, Array]
) -> Shades:
    """Colours (k, 3) of points of numbered surfaces, told as in `Pieces`.

    Only two things of a normal matter: how much it looks to the light, and how much to the viewer.
    """
    first, axis, radius = surfaces[:, :3], surfaces[:, 3:6], surfaces[:, 6]
    is_round = radius > 0.0
    per_radius = 1.0 / np.where(is_round, radius, 1.0)
    along = axis / np.maximum((axis**2).sum(axis=1), 1e-30)[:, None]
    lit = first @ _LIGHT
    told = np.column_stack(
        [along, (along * first).sum(axis=1), lit, axis @ _LIGHT, first[:, 2], axis[:, 2], per_radius]
    ).astype(np.float32)
    found = np.empty((len(number), 3), dtype=np.float32)
    flat = np.flatnonzero(~is_round[number]) if not is_round.all() else np.empty(0, dtype=np.intp)
    if len(flat):
        strength = (0.5 + 0.5 * np.clip(lit, 0.0, 1.0)).astype(np.float32)
        found[flat] = (strength[:, None] * paints)[number[flat]]
        if len(flat) == len(number):
            return found
    which = np.flatnonzero(is_round[number]) if len(flat) else slice(None)
    of = number[which]
    x, y, z = (each[which].astype(np.float32) for each in points)
    ax, ay, az, start, lit_start, lit_axis, z_start, z_axis, per = (column[of] for column in told.T.copy())
    share = np.clip(x * ax + y * ay + z * az - start, 0.0, 1.0)
    to_light = x * _BRIGHT[0] + y * _BRIGHT[1] + z * _BRIGHT[2]
    facing = (to_light - lit_start - share * lit_axis) * per
    ahead = (z - z_start - share * z_axis) * per
    found[which] = _shade(facing, ahead, paints[of])
    return found


def _shade(facing: Shades, ahead: Shades, colour: Shades) -> Shades:
    """Light from above and the left, a soft gleam, and a dark rim that parts a body from those behind, by how
    much normals (k,) look to the light and to the viewer.
    """
    facing = np.clip(facing, 0.0, 1.0)
    strength = 0.5 + 0.5 * facing
    rim = np.flatnonzero(ahead < _RIM)
    strength[rim] *= 0.5 + 0.5 * (np.maximum(ahead[rim], 0.0) / _RIM) ** 0.7
    lit = strength[:, None] * colour
    gleam = np.flatnonzero(facing > _DULL)
    if len(gleam):
        lit[gleam] += 0.22 * facing[gleam, None] ** 24
        np.minimum(lit, 1.0, out=lit)
    return np.asarray(lit)


def _shadow(
    solids: Iterable[Solid | Balls], floor: float, axes: Array, rays: Rays, edges: NDArray[np.bool_]
) -> Sheet:
    """What the solids shade of a level floor below them, the light straight above; of a grid it is marked
    where a shadow changes so much that one ray per dot is too few.
    """
    right, up, ahead = axes
    casting = [
        solid for solid in solids if isinstance(solid, Solid) and (len(solid.corners) > 2 or solid.radius > 0)
    ]
    dark = np.zeros(rays.shape, dtype=np.float32)
    views = [_dropped(solid.corners, floor) @ axes[:2].T for solid in casting]
    margins = np.array([1.2 * solid.radius for solid in casting])[:, None]
    low = np.array([each.min(axis=0) for each in views]).reshape(-1, 2) - margins
    high = np.array([each.max(axis=0) for each in views]).reshape(-1, 2) + margins
    # where a ray ends on the floor is linear in where it is
    slopes = np.array([right[:2] - right[2] / ahead[2] * ahead[:2], up[:2] - up[2] / ahead[2] * ahead[:2]])
    start = floor / ahead[2] * ahead[:2]
    windows: Sequence[Any] = rays.windows(low, high)
    for solid, window in zip(casting, windows, strict=True):
        x, y = rays.part(window)
        place = [x * slopes[0, i] + (y * slopes[1, i] + start[i]) for i in range(2)]
        dark[window] = np.maximum(dark[window], _shade_of(solid, *place))
    if isinstance(rays, Grid):
        _steps(0.2 * dark, _SOFT, edges)
    met = np.flatnonzero(dark)
    x, y = rays.places(met)
    depth = (floor - x * right[2] - y * up[2]) / ahead[2]
    return Sheet(met, np.full((len(met), 3), 0.25, dtype=np.float32), depth, 0.2 * dark.ravel()[met])


def _shade_of(solid: Solid, x: Array, y: Array) -> Array:
    """How dark it is below a body, from 0 to 1, at places of the floor."""
    if len(solid.corners) > 2:
        return np.clip((_inside(hull(solid.corners[:, :2]), x, y) + 0.15) / 0.5, 0.0, 1.0)
    a, b = solid.corners[0, :2], solid.corners[-1, :2]
    along, square = b - a, float((b - a) @ (b - a))
    x, y = x - a[0], y - a[1]
    if square > 0.0:
        share = np.clip(x * (along[0] / square) + y * (along[1] / square), 0.0, 1.0)
        x, y = x - share * along[0], y - share * along[1]
    return np.clip((1.15 - np.sqrt(x * x + y * y) / solid.radius) / 0.5, 0.0, 1.0)


def _inside(outline: Array, x: Array, y: Array) -> Array:
    """How far places are within an anticlockwise outline (·, 2), as a share of half of its least width."""
    least, width = np.full(x.shape, np.inf), np.inf
    for a, b in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        inward = np.array([a[1] - b[1], b[0] - a[0]]) / max(float(np.linalg.norm(b - a)), 1e-300)
        least = np.minimum(least, inward[0] * (x - a[0]) + inward[1] * (y - a[1]))
        width = min(width, float(((outline - a) @ inward).max()))
    return np.asarray(least / max(width / 2.0, 1e-300))


def _dropped(corners: Array, floor: float | None) -> Array:
    """Corners (·, 3) straight below on a floor."""
    below = corners.copy()
    below[:, 2] = floor
    return below


def _laid(sheets: Sequence[Sheet], size: int) -> Shades:
    """Sheets over each other, in the order of their depths: colours times opacity, and opacity (rays, 4)."""
    picture = np.zeros((size, 4), dtype=np.float32)
    count: NDArray[np.int8] = np.zeros(size, dtype=np.int8)
    for sheet in sheets:
        count[sheet.rays] += 1
    several = np.flatnonzero(count > 1)
    place = np.empty(size, dtype=np.intp)
    place[several] = np.arange(len(several))
    most = int(count.max(initial=1))
    depths = np.full((len(several), most), -np.inf, dtype=np.float32)
    seen = np.zeros((most, len(several), 4), dtype=np.float32)
    level: NDArray[np.int8] = np.zeros(len(several), dtype=np.int8)
    for sheet in sheets:
        paint = np.empty((len(sheet.rays), 4), dtype=np.float32)
        np.multiply(sheet.colours, sheet.opacity[:, None], out=paint[:, :3])
        paint[:, 3] = sheet.opacity
        picture[sheet.rays] = paint  # which is all where there is one sheet alone, as with most rays
        here = np.flatnonzero(count[sheet.rays] > 1)
        to = place[sheet.rays[here]]
        on = level[to]
        depths[to, on] = sheet.depths[here]
        seen[on, to] = paint[here]
        level[to] += 1
    over = np.zeros((len(several), 4), dtype=np.float32)
    each = np.arange(len(several))
    for at in np.argsort(depths, axis=1).T:  # from behind
        top = seen[at, each]
        over *= 1.0 - top[:, 3:]
        over += top
    picture[several] = over
    return picture
