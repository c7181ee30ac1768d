"""Where the drawn things are: joints, outlines of links and obstacles, and the instants of a strobe."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vffnull._record import recorded
from vffnull.errors import InputError

if TYPE_CHECKING:
    from vffnull.result import Result

Array = NDArray[np.float64]


def drawable(result: Result) -> Result:
    """The result up to where its numbers end: a diverged run may leave NaN in its last rows.

    Raises
    ------
    vffnull.errors.InputError
        If nothing is left to draw.
    """
    sound = np.all(np.isfinite(result.q) & np.isfinite(result.dq), axis=1)
    if sound.size and sound.all():
        return result
    rows = int(np.argmin(sound)) if sound.size else 0
    if not rows:
        raise InputError("result: there is no recorded instant to draw")
    cut = {name: values[:rows] for name, values in recorded(result).items()}
    return dataclasses.replace(result, t=result.t[:rows], **cut)  # type: ignore[arg-type]


def joints(result: Result) -> Array:
    """Positions of the joints, the tip last, (T, n+1, 2) [m]."""
    return np.asarray(result.scenario.arm.forward_kinematics(result.q))


def link_radii(result: Result) -> Array:
    """Radius of every link, (n,) [m]."""
    return np.asarray(result.scenario.arm.radius)


def cores(result: Result) -> list[tuple[Array, float]]:
    """Every obstacle as the corners of its convex core, (·, 2) [m] relative to its position, and the radius
    [m] of what surrounds the core.
    """
    document = result.scenario.to_dict()
    return [core(each["shape"], each.get("angle", 0.0)) for each in document.get("obstacles", [])]


def obstacle_outlines(result: Result, margin: float = 0.0) -> list[Array]:
    """Outlines (·, 2) [m] of all points nearer than `margin` to an obstacle, relative to their positions."""
    return [rounded(corners, radius + margin) for corners, radius in cores(result)]


def core(shape: Mapping[str, Any], angle: float = 0.0) -> tuple[Array, float]:
    """Corners of a shape's core in an obstacle's frame turned by `angle`, and the radius around it."""
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


def rounded(corners: Array, radius: float) -> Array:
    """The outline of all points nearer than `radius` to a convex polygon (or a segment, or a point)."""
    if radius == 0.0:
        return corners
    edges = np.roll(corners, -1, axis=0) - corners
    from_first = corners - corners[0]
    if from_first[:, 0] @ edges[:, 1] < from_first[:, 1] @ edges[:, 0] and len(corners) > 2:  # clockwise
        return rounded(corners[::-1], radius)
    if not edges.any():
        ring: Array = corners[0] + radius * _circle(0.0, 2 * np.pi)
        return ring
    normals = np.arctan2(-edges[:, 0], edges[:, 1])
    turns = (normals - np.roll(normals, 1)) % (2 * np.pi)
    arcs = zip(corners, normals - turns, turns, strict=True)
    return np.vstack([corner + radius * _circle(start, turn) for corner, start, turn in arcs])


def _circle(start: float, turn: float) -> Array:
    """Points on the unit circle, every 5° or so."""
    angles = start + np.linspace(0.0, turn, 2 + int(turn / 0.09))
    return np.stack([np.cos(angles), np.sin(angles)], axis=1)


def capsule(a: ArrayLike, b: ArrayLike, radius: float) -> Array:
    """The outline of all points nearer than `radius` to a segment."""
    return rounded(np.array([a, b], dtype=float), radius)


def instants(result: Result, count: int) -> NDArray[np.intp]:
    """Indices of instants that show the run best: as much motion between one and the next everywhere.

    Half of the measure is time, so that a long rest is not skipped altogether.
    """
    places = np.concatenate([joints(result), result.obstacles], axis=1)
    path = np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=1)
    measure = np.concatenate([[0.0], np.cumsum(path)])
    measure /= measure[-1] or 1.0
    measure += (result.t - result.t[0]) / ((result.t[-1] - result.t[0]) or 1.0)
    chosen = np.searchsorted(measure, np.linspace(0.0, measure[-1], count))
    return np.unique(np.minimum(chosen, len(result.t) - 1))


def frame(result: Result, margin: float = 0.12) -> tuple[float, float, float, float]:
    """Limits (left, right, bottom, top) [m] around the arm at all times and what it meets.

    Obstacles count where they come near the arm; one that passes far away does not shrink the picture.
    """
    arm = joints(result)
    low, high = arm.min(axis=(0, 1)), arm.max(axis=(0, 1))
    wide = np.vstack([result.x_ref[:, :2], low[None], high[None]])
    low, high = wide.min(axis=0), wide.max(axis=0)
    reach = 0.35 * float((high - low).max())
    for index, points in enumerate(obstacle_outlines(result)):
        place = result.obstacles[:, index]
        near = np.all((place > low - reach) & (place < high + reach), axis=1)
        if near.any():
            low = np.minimum(low, np.maximum((place[near] + points.min(axis=0)).min(axis=0), low - reach))
            high = np.maximum(high, np.minimum((place[near] + points.max(axis=0)).max(axis=0), high + reach))
    pad = margin * float((high - low).max()) / 2 + float(link_radii(result).max())
    return float(low[0] - pad), float(high[0] + pad), float(low[1] - pad), float(high[1] + pad)


def pushes(result: Result, rows: NDArray[np.intp]) -> tuple[Array, Array]:
    """Where the repulsion acts on every link, and in which direction with which strength.

    The record holds the force's magnitude; it is drawn at the point of the link nearest to an obstacle, away
    from that obstacle. With several obstacles near one link this is the direction away from the nearest.

    Returns
    -------
    points : (len(rows), n, 2) ndarray
        Nearest points on the links' axes [m].
    forces : (len(rows), n, 2) ndarray
        Forces [N]; zero where nothing acts.
    """
    arm = joints(result)[rows]
    a, b = arm[:, :-1], arm[:, 1:]
    points, directions = a.copy(), np.zeros_like(a)
    nearest = np.full(a.shape[:2], np.inf)
    for index, (corners, radius) in enumerate(cores(result)):
        ends = corners + result.obstacles[rows, index][:, None]
        for c, d in zip(*_edges(ends), strict=True):
            on_link, on_obstacle = _nearest(a, b, c[:, None], d[:, None])
            away = on_link - on_obstacle
            distance = np.linalg.norm(away, axis=-1)
            closer = distance - radius < nearest
            nearest = np.where(closer, distance - radius, nearest)
            points = np.where(closer[..., None], on_link, points)
            unit = away / np.maximum(distance, 1e-300)[..., None]
            directions = np.where(closer[..., None], unit, directions)
    return points, directions * result.force[rows][..., None]


def _edges(corners: Array) -> tuple[list[Array], list[Array]]:
    """Ends of the edges of a core: of a point the point itself, of a segment that one, else all around."""
    count = corners.shape[1]
    last = count if count > 2 else 1
    starts = [corners[:, i] for i in range(last)]
    return starts, [corners[:, (i + 1) % count] for i in range(last)]


def _nearest(a: Array, b: Array, c: Array, d: Array) -> tuple[Array, Array]:
    """The points of segments ab and cd that are nearest to each other, elementwise.

    Two segments that do not cross are nearest at an end of one of them; those that cross are given the
    crossing's nearest end, which is good enough for a picture.
    """
    candidates = [(p, _project(p, c, d)) for p in (a, b)] + [(_project(p, a, b), p) for p in (c, d)]
    first = np.stack([np.broadcast_to(on_ab, a.shape) for on_ab, _ in candidates])
    second = np.stack([np.broadcast_to(on_cd, a.shape) for _, on_cd in candidates])
    best = np.argmin(np.linalg.norm(first - second, axis=-1), axis=0)[None, ..., None]
    return np.take_along_axis(first, best, 0)[0], np.take_along_axis(second, best, 0)[0]


def _project(p: Array, a: Array, b: Array) -> Array:
    """The point of segment ab nearest to p."""
    along = b - a
    square = np.maximum((along**2).sum(-1), 1e-300)
    share = np.clip(((p - a) * along).sum(-1) / square, 0.0, 1.0)
    place: Array = a + share[..., None] * along
    return place
