"""Capsules of least volume around what a model collides with."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._support.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Fit", "Solid", "fit_solids", "least_capsule", "protrusion", "volume"]

Array = NDArray[np.float64]

SAVING = 1 / 3
"""Share of the volume that more capsules must save before there are more."""
JOINING = 0.1
"""Share of a link's volume that fewer capsules may cost: the boxes of a finger make one."""
PROTRUSION = 1e-3
"""How far a vertex may stick out of its capsule [m] before the fit is refused."""
WAY = 3
"""Which way of fitting this is; another one does not take the fits of this one for its own."""
LOOSE = 2.0
"""How many times the volume of the hulls inside a capsule may have, if it wastes more than `SLIGHT`."""
SLIGHT = 1e-3
"""What a capsule may waste however loose it is [m³]."""
_DOTS = np.array([d for d in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
_DOTS /= np.linalg.norm(_DOTS, axis=1)[:, None]
"""Directions all around a ball."""
_SIDES = 48
"""Of the prism that stands around a cylinder."""


@dataclass(frozen=True)
class Solid:
    """Something that collides: the convex hull of balls, or the surface that triangles make.

    Attributes
    ----------
    name : str
        What it is called in messages.
    points : (k, 3) array
        Centres of the balls, or vertices [m].
    radii : (k,) array
        Of the balls [m]; 0 for vertices.
    triangles : (t, 3) array
        Indices into `points`; none for a hull.
    """

    name: str
    points: Array
    radii: Array
    triangles: NDArray[np.int64] = field(default_factory=lambda: np.zeros((0, 3), np.int64))
    hull: float | None = None
    """Volume of the convex hull where it is known exactly [m³]."""

    @classmethod
    def mesh(cls, name: str, points: Array, triangles: NDArray[np.int64]) -> Solid:
        """A surface."""
        return cls(name, points, np.zeros(len(points)), triangles)

    @classmethod
    def box(cls, name: str, size: Sequence[float]) -> Solid:
        """A box about the origin."""
        corners = np.array(np.meshgrid(*([-s / 2, s / 2] for s in size))).reshape(3, -1).T
        return cls(name, corners, np.zeros(8), hull=math.prod(size))

    @classmethod
    def cylinder(cls, name: str, radius: float, length: float, sides: int = _SIDES) -> Solid:
        """A cylinder about the origin, along z, as the prism around it."""
        angles = np.arange(sides) * (2 * math.pi / sides)
        outside = radius / math.cos(math.pi / sides)
        rim = np.column_stack([outside * np.cos(angles), outside * np.sin(angles), np.zeros(sides)])
        half = np.array([0.0, 0.0, length / 2])
        points = np.vstack([rim - half, rim + half])
        return cls(name, points, np.zeros(len(points)), hull=math.pi * radius**2 * length)

    @classmethod
    def capsule(cls, name: str, radius: float, length: float) -> Solid:
        """A capsule about the origin, along z; a ball if its length is 0."""
        points = np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]])
        exact = math.pi * radius**2 * (length + 4 / 3 * radius)
        return cls(name, points, np.full(2, radius), hull=exact)

    def moved(self, rotation: Array, position: Array) -> Solid:
        """The same elsewhere."""
        points = self.points @ rotation.T + position
        return Solid(self.name, points, self.radii, self.triangles, self.hull)


@dataclass(frozen=True)
class Fit:
    """A shape of a link, and how well it fits.

    Attributes
    ----------
    link : str
        The link of the arm.
    parts : tuple of str
        What it contains.
    shape : dict
        ``{"kind": "capsule", "a": …, "b": …, "radius": …}`` in the frame of the link, or a sphere; of shapes
        as in the file also a box or a convex hull.
    volume : float
        Of the shape [m³].
    hull_volume : float
        Of the convex hulls of what it contains [m³].
    protrusion : float
        How far a vertex sticks out of it [m]; 0 or less where all are inside.
    vertices : int
        How many were asked.
    own_volume : float or None
        Of shapes as in the file the volume of what it contains, hollows left out [m³]; None if that is a
        mesh whose surface is open, so that it has none. A mesh in several pieces has one volume, and so has
        its hull: each piece counts with its share of them.
    """

    link: str
    parts: tuple[str, ...]
    shape: dict[str, Any]
    volume: float
    hull_volume: float
    protrusion: float
    vertices: int
    own_volume: float | None = None

    @property
    def tightness(self) -> float:
        """Volume of the shape over that of the hulls inside: 1 is perfect."""
        return self.volume / self.hull_volume if self.hull_volume > 0 else math.inf


@dataclass(frozen=True, eq=False)
class _Piece:
    """Points that one capsule contains."""

    parts: tuple[str, ...]
    origin: frozenset[int]
    points: Array
    radii: Array
    hull: float
    capsule: tuple[Array, Array, float]

    @property
    def volume(self) -> float:
        return volume(*self.capsule)

    @property
    def loose(self) -> bool:
        return _is_loose(self.volume, self.hull)


def _is_loose(capsules: float, hull: float) -> bool:
    return capsules > LOOSE * hull and capsules - hull > SLIGHT


def volume(a: Array, b: Array, radius: float) -> float:
    """Volume of a capsule [m³]."""
    return math.pi * radius**2 * (float(np.linalg.norm(b - a)) + 4 / 3 * radius)


def _distances(points: Array, a: Array, b: Array) -> tuple[Array, Array, Array]:
    """Distance to a segment, where on it from 0 to 1, and the unit vector away from it."""
    along = b - a
    square = float(along @ along)
    share = np.clip((points - a) @ along / square, 0.0, 1.0) if square > 0 else np.zeros(len(points))
    away = points - a - share[:, None] * along
    distance = np.linalg.norm(away, axis=1)
    return distance, share, away / np.maximum(distance, 1e-300)[:, None]


def protrusion(points: Array, radii: Array, a: Array, b: Array, radius: float) -> float:
    """How far the farthest of the balls sticks out of a capsule [m]; negative where all are inside."""
    return float(np.max(_distances(points, a, b)[0] + radii)) - radius


def _hull(points: Array, radii: Array) -> tuple[Array, Array, float]:
    """The points that span the convex hull, and its volume: that of the centres where they have a radius."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return points, radii, 0.0  # flat, or fewer than four
    if np.any(radii):
        return points, radii, float(hull.volume)
    return points[hull.vertices], radii[hull.vertices], float(hull.volume)


def _axes(points: Array) -> Array:
    """Directions to begin with: the principal ones, as rows."""
    centred = points - points.mean(axis=0)
    return np.asarray(np.linalg.svd(centred, full_matrices=False)[2])


def _start(points: Array, radii: Array, axis: Array) -> Array:
    """A capsule along an axis, as a, b and radius."""
    t = points @ axis
    across = points - t[:, None] * axis
    centre = (across.min(axis=0) + across.max(axis=0)) / 2
    centre -= axis * (centre @ axis)
    radius = float(np.max(np.linalg.norm(across - centre, axis=1) + radii))
    low, high = float(np.min(t - radii)) + radius, float(np.max(t + radii)) - radius
    if low > high:
        low = high = (low + high) / 2
    # Apart by a little: where both ends meet, the volume has no gradient.
    apart = max((high - low) / 2, 1e-3 * radius)
    middle = centre + axis * ((low + high) / 2)
    return np.concatenate([middle - apart * axis, middle + apart * axis, [radius]])


def _polish(points: Array, radii: Array, start: Array) -> Array:
    """The least capsule near a first one: a smooth problem over the few points that matter."""
    from scipy.optimize import minimize

    scale = max(start[6], 1e-9)

    def objective(x: Array) -> tuple[float, Array]:
        along = x[3:6] - x[:3]
        length = math.sqrt(along @ along + 1e-18)
        r = x[6]
        tangent = math.pi * r * r * along / length
        value = math.pi * r * r * (length + 4 / 3 * r)
        return value, np.concatenate([-tangent, tangent, [2 * math.pi * r * length + 4 * math.pi * r * r]])

    def room(chosen: Array) -> tuple[Callable[[Array], Array], Callable[[Array], Array]]:
        inside, thick = (points[chosen] - points.mean(axis=0)) / scale, radii[chosen] / scale

        def value(x: Array) -> Array:
            return np.asarray(x[6] - thick - _distances(inside, x[:3], x[3:6])[0])

        def gradient(x: Array) -> Array:
            _, share, away = _distances(inside, x[:3], x[3:6])
            share = share[:, None]
            return np.hstack([(1 - share) * away, share * away, np.ones_like(share)])

        return value, gradient

    middle = np.tile(points.mean(axis=0), 2)
    x = start.copy()
    best, least = start, math.inf
    chosen = np.zeros(len(points), bool)
    for _ in range(12):
        gap = x[6] - radii - _distances(points, x[:3], x[3:6])[0]
        worst = np.argsort(gap)[:24]
        if chosen.any() and np.min(gap) > -1e-9 * scale:
            break
        chosen[worst] = True
        value, gradient = room(chosen)
        scaled = np.concatenate([(x[:6] - middle) / scale, [x[6] / scale]])
        found = minimize(
            objective,
            scaled,
            jac=True,
            method="SLSQP",
            constraints={"type": "ineq", "fun": value, "jac": gradient},
            options={"maxiter": 100, "ftol": 1e-10},
        ).x
        if not np.all(np.isfinite(found)):
            break
        x = np.concatenate([found[:6] * scale + middle, [found[6] * scale]])
        closed = _closed(points, radii, x)
        size = volume(closed[:3], closed[3:6], closed[6])
        if size < least:
            best, least = closed, size
    return _closed(points, radii, best)


def _closed(points: Array, radii: Array, x: Array) -> Array:
    """The same axis with the radius that contains every point."""
    radius = float(np.max(_distances(points, x[:3], x[3:6])[0] + radii))
    return np.concatenate([x[:6], [math.nextafter(radius, math.inf)]])


def least_capsule(points: Array, radii: Array | None = None, starts: int = 3) -> tuple[Array, Array, float]:
    """The capsule of least volume around points or balls.

    Parameters
    ----------
    points : (k, 3) array
        Points [m].
    radii : (k,) array, optional
        Radii of balls around them [m].
    starts : int, optional
        How many of the principal axes to begin with. The problem is not convex: the least is found near
        one of them, or not at all.

    Returns
    -------
    a, b : (3,) array
        Ends of the axis [m].
    radius : float
        [m]. Every point is inside, to the last bit of the radius.
    """
    points = np.asarray(points, float)
    radii = np.zeros(len(points)) if radii is None else np.asarray(radii, float)
    points, radii, _ = _hull(points, radii)
    if len(points) == 1:
        return points[0], points[0], float(radii[0])
    first = [_start(points, radii, axis) for axis in _axes(points)]
    first.sort(key=lambda x: volume(x[:3], x[3:6], x[6]))
    found = [_polish(points, radii, x) for x in first[:starts]] + [_closed(points, radii, first[0])]
    x = min(found, key=lambda x: volume(x[:3], x[3:6], x[6]))
    a, b, radius = x[:3], x[3:6], float(x[6])
    if np.linalg.norm(b - a) < 1e-6 * radius:
        middle = (a + b) / 2
        reach = np.max(np.linalg.norm(points - middle, axis=1) + radii)
        return middle, middle, math.nextafter(float(reach), math.inf)
    return a, b, radius


def _piece(part: str, origin: int, points: Array, radii: Array, hull: float | None, starts: int) -> _Piece:
    spanning, thick, size = _hull(points, radii)
    capsule = least_capsule(spanning, thick, starts)
    return _Piece((part,), frozenset([origin]), spanning, thick, size if hull is None else hull, capsule)


def _cut(points: Array, triangles: NDArray[np.int64], normal: Array, at: float) -> tuple[Array, Array]:
    """Vertices on both sides of a plane; where an edge crosses it, the crossing belongs to both.

    What is solid on one side then lies in the hull of that side's points, for the rim of its cut is
    among them.
    """
    height = points @ normal - at
    # Inner edges come twice, which costs less than finding out.
    edges = np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    first, second = height[edges[:, 0]], height[edges[:, 1]]
    crossing = first * second < 0
    share = (first / np.where(crossing, first - second, 1.0))[crossing, None]
    start, end = points[edges[crossing, 0]], points[edges[crossing, 1]]
    rim = start + share * (end - start)
    return np.vstack([points[height <= 0], rim]), np.vstack([points[height >= 0], rim])


def _halves(piece: _Piece, points: Array, triangles: NDArray[np.int64]) -> list[_Piece] | None:
    """The best two capsules in place of one, if they save enough."""
    a, b, _ = piece.capsule
    axes = list(_axes(piece.points))
    if np.linalg.norm(b - a) > 0:
        axes.append((b - a) / np.linalg.norm(b - a))
    best: tuple[float, Array, Array] | None = None
    for axis in axes:
        height = piece.points @ axis
        low, high = float(height.min()), float(height.max())
        for share in (0.3, 0.5, 0.7):
            sides = _cut(points, triangles, axis, low + share * (high - low))
            if min(len(side) for side in sides) < 4:
                continue
            quick = sum(_quick(side) for side in sides)
            if best is None or quick < best[0]:
                best = (quick, *sides)
    # The quick estimate is an upper bound: what misses by little may still do when it is polished.
    if best is None or best[0] > 1.3 * (1 - SAVING) * piece.volume:
        return None
    (origin,) = piece.origin
    halves = [_piece(piece.parts[0], origin, side, np.zeros(len(side)), None, 3) for side in best[1:]]
    return halves if sum(half.volume for half in halves) <= (1 - SAVING) * piece.volume else None


def _quick(points: Array) -> float:
    """Volume of a capsule along the best principal axis."""
    spanning, radii, _ = _hull(points, np.zeros(len(points)))
    starts = (_start(spanning, radii, axis) for axis in _axes(spanning))
    closed = (_closed(spanning, radii, x) for x in starts)
    return min(volume(x[:3], x[3:6], x[6]) for x in closed)


def _split(solid: Solid, origin: int) -> list[_Piece]:
    """One, two or three capsules for one solid; one that is loose where more are, too."""
    whole = _piece(solid.name, origin, solid.points, solid.radii, solid.hull, 3)
    if np.any(solid.radii):
        return [whole]
    pieces = _parts(whole, solid)
    together = sum(piece.volume for piece in pieces)
    return [whole] if _is_loose(together, whole.hull) else pieces


def _parts(whole: _Piece, solid: Solid) -> list[_Piece]:
    """One, two or three capsules for one solid."""
    triangles = solid.triangles if len(solid.triangles) else _hull_triangles(solid.points)
    halves = _halves(whole, solid.points, triangles) if len(triangles) else None
    if halves is None:
        return [whole]
    larger, smaller = sorted(halves, key=lambda half: -half.volume)
    # A third capsule has to save a third of all that there is.
    again = _halves(larger, larger.points, _hull_triangles(larger.points))
    total = larger.volume + smaller.volume
    if again and sum(piece.volume for piece in again) + smaller.volume <= (1 - SAVING) * total:
        return [*again, smaller]
    return halves


def _hull_triangles(points: Array) -> NDArray[np.int64]:
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(ConvexHull(points).simplices, np.int64)
    except (QhullError, ValueError):
        return np.zeros((0, 3), np.int64)


def _merge(pieces: list[_Piece]) -> list[_Piece]:
    """Join capsules of one link, those first that cost least, while all together stay within `JOINING`.

    None is joined with another that makes it loose, and one that is, is left alone. How small a capsule for
    both can be at all takes no search: pairs come in the order of what they cost at least.
    """
    alone = [piece for piece in pieces if piece.loose]
    pieces = [piece for piece in pieces if not piece.loose]
    limit = (1 + JOINING) * sum(piece.volume for piece in pieces)
    pairs = {pair: _Pair(*pair) for pair in itertools.combinations(pieces, 2) if _may_join(*pair)}
    while True:
        room = limit - sum(piece.volume for piece in pieces)
        best: tuple[float, _Pair] | None = None
        for pair in sorted(pairs.values(), key=lambda pair: pair.least):
            if pair.least > (room if best is None else min(room, best[0])):
                break
            cost = pair.cost
            if cost is not None and cost <= room and (best is None or cost < best[0]):
                best = (cost, pair)
        if best is None:
            return [*alone, *pieces]
        both, gone = best[1].both, {best[1].first, best[1].second}
        pieces = [each for each in pieces if each not in gone]
        pairs = {pair: each for pair, each in pairs.items() if not gone.intersection(pair)}
        pairs |= {(each, both): _Pair(each, both) for each in pieces if _may_join(each, both)}
        pieces.append(both)


def _may_join(first: _Piece, second: _Piece) -> bool:
    """Halves of one solid are not put together again."""
    return not first.origin & second.origin


def _at_least(points: Array) -> float:
    """What no capsule around points falls short of [m³].

    It is as long as the points are apart, and its radius is half of the least altitude of a triangle of them:
    in the direction across its axis, in the plane of the triangle, that is at least as wide.
    """
    far = points[int(np.argmax(np.linalg.norm(points - points[0], axis=1)))]
    end = points[int(np.argmax(np.linalg.norm(points - far, axis=1)))]
    length = float(np.linalg.norm(end - far))
    doubled = np.linalg.norm(np.cross(points - far, end - far), axis=1)  # areas of the triangles, twice
    third = points[int(np.argmax(doubled))]
    longest = max(length, float(np.linalg.norm(third - far)), float(np.linalg.norm(third - end)))
    radius = float(doubled.max()) / max(longest, 1e-300) / 2
    return math.pi * radius**2 * (max(length, 2 * radius) - 2 / 3 * radius)


def _dotted(points: Array, radii: Array) -> Array:
    """Points on the surfaces of balls."""
    on: Array = points[:, None] + radii[:, None, None] * _DOTS
    return on.reshape(-1, 3)


class _Pair:
    """Two pieces that may become one."""

    def __init__(self, first: _Piece, second: _Piece) -> None:
        self.first, self.second = first, second
        points, radii = np.vstack([first.points, second.points]), np.append(first.radii, second.radii)
        self._points, self._radii, hull = _hull(points, radii)
        surface = self._points
        if np.any(radii):
            surface, _, hull = _hull(_dotted(points, radii), np.zeros(_DOTS.shape[0] * len(points)))
        self.apart = first.volume + second.volume
        self.least = max(hull, _at_least(surface)) - self.apart
        """What one capsule costs at least [m³]."""

    @functools.cached_property
    def both(self) -> _Piece:
        """What they become."""
        parts, origin = self.first.parts + self.second.parts, self.first.origin | self.second.origin
        hull, capsule = self.first.hull + self.second.hull, least_capsule(self._points, self._radii)
        return _Piece(parts, origin, self._points, self._radii, hull, capsule)

    @property
    def cost(self) -> float | None:
        """What that costs [m³]; None if it is loose for it."""
        cost = self.both.volume - self.apart
        return None if self.both.loose and cost > 0 else cost


def _as_hull(link: str, piece: _Piece) -> Fit | None:
    """The hull of what a capsule fits badly, if that is smaller and the core takes it; balls have none."""
    if np.any(piece.radii) or piece.hull <= 0.0:
        return None
    from vffnull.arms._hulls import Hull, simplified

    hull = simplified(Hull(piece.points))
    if hull.volume > piece.volume / LOOSE:
        return None
    try:
        _core.hull(hull.corners)
    except InputError:  # corners so near to each other that it cannot tell which of them are corners
        return None
    shape = {"kind": "convex", "vertices": hull.corners.tolist()}
    out = float(hull.outside(piece.points).max())
    return Fit(link, piece.parts, shape, hull.volume, piece.hull, out, len(piece.points))


def fit_solids(link: str, solids: Iterable[Solid]) -> list[Fit]:
    """The capsules of one link.

    Parameters
    ----------
    link : str
        Its name.
    solids : iterable of Solid
        What it consists of, in its frame.

    Returns
    -------
    list of Fit
        One capsule for each solid, two or three where that saves a third of the volume; and one for
        several solids while that makes the link no more than a tenth larger. A convex hull where a capsule
        has more than twice the volume of what is in it, as around a plate, and wastes more than a litre,
        unless its corners are so near to each other that the core cannot tell which of them are corners.

    Raises
    ------
    vffnull.errors.InputError
        If a vertex sticks out by more than 1 mm, or a number is not finite.
    """
    solids = list(solids)
    for solid in solids:
        if not (np.all(np.isfinite(solid.points)) and np.all(np.isfinite(solid.radii))):
            raise InputError(f"{link}: {solid.name} has vertices that are not finite")
    pieces = _merge([piece for i, solid in enumerate(solids) for piece in _split(solid, i)])
    fits = []
    for piece in pieces:
        if piece.loose and (tight := _as_hull(link, piece)) is not None:
            fits.append(tight)
            continue
        a, b, radius = piece.capsule
        out = protrusion(piece.points, piece.radii, a, b, radius)
        if out > PROTRUSION:
            raise InputError(
                f"{link}: {', '.join(piece.parts)} sticks out of its capsule by {out * 1e3:.3g} mm"
            )
        shape: dict[str, Any] = {"kind": "capsule", "a": a.tolist(), "b": b.tolist(), "radius": radius}
        if np.array_equal(a, b):
            shape = {"kind": "sphere", "center": a.tolist(), "radius": radius}
        fits.append(Fit(link, piece.parts, shape, piece.volume, piece.hull, out, len(piece.points)))
    return fits
