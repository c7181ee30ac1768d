"""Where the drawn things are: joints, outlines of links and obstacles, and the instants of a strobe."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from vffnull.result import Result

Array = NDArray[np.float64]


def drawable(result: Result) -> Result:
    """The result up to where its numbers end: a diverged run may leave NaN in its last rows."""
    sound = np.all(np.isfinite(result.q) & np.isfinite(result.dq), axis=1)
    if sound.all():
        return result
    rows = int(np.argmin(sound))
    cut: dict[str, Any] = {name: values[:rows] for name, _, values in result.recorded()}
    return dataclasses.replace(result, t=result.t[:rows], **cut)


def joints(result: Result) -> Array:
    """Positions of the joints, the tip last, (T, n+1, 2) [m]."""
    return np.asarray(result.scenario.arm.forward_kinematics(result.q))


def link_radii(result: Result) -> Array:
    """Radius of every link, (n,) [m]."""
    return np.asarray(result.scenario.arm.radius)


def obstacle_outlines(result: Result) -> list[Array]:
    """The obstacles' outlines, (·, 2) [m] each, relative to their positions."""
    document = result.scenario.to_dict()
    return [outline(each["shape"], each.get("angle", 0.0)) for each in document.get("obstacles", [])]


def outline(shape: Mapping[str, Any], angle: float = 0.0) -> Array:
    """A shape's outline in an obstacle's frame that is turned by `angle`."""
    match shape["kind"]:
        case "circle":
            points = capsule([0, 0], [0, 0], shape["radius"])
        case "capsule":
            points = capsule(shape["a"], shape["b"], shape["radius"])
        case "box":
            w, h = np.asarray(shape["size"], dtype=float) / 2
            points = np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
        case _:
            points = np.asarray(shape["vertices"], dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    turned: Array = points @ np.array([[c, s], [-s, c]])
    return turned


def capsule(a: ArrayLike, b: ArrayLike, radius: float) -> Array:
    """The outline of all points nearer than `radius` to a segment."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    heading = np.arctan2(*(b - a)[::-1])
    half = np.linspace(-np.pi / 2, np.pi / 2, 37)
    cap = radius * np.stack([np.cos(heading + half), np.sin(heading + half)], axis=1)
    return np.vstack([b + cap, a - cap])


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
