"""What the page's script moves, as plain JSON with packed arrays, places as the picture has them."""

from __future__ import annotations

import base64
import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _record
from vffnull._record import Layout
from vffnull.plotting import geometry
from vffnull.plotting.primitives import Scene
from vffnull.report.figures import Run

_STILL = "#8A8D92"
"""The colour of the base."""
_OBSTACLE = "#F4B183"
"""Lighter than in figures, where no link has such a colour."""
_SPECKS = 200
"""Points of a cloud that are drawn, at most: a page holds each at every instant."""


def pack(run: Run, colours: list[str]) -> dict[str, Any]:
    """A run at the chosen instants, its links in these colours."""
    result, rows, scene = run.result, run.rows, run.scene.pick(run.rows)
    points, forces = scene.pushes
    longest = run.longest_arrow
    return {
        "t": _packed(run.t),
        "joints": _place(scene.joints),
        "colours": colours,
        "radii": scene.radii.tolist(),
        "parts": list(_parts(scene, colours)),
        "tip": _place(scene.tip),
        "target": _place(scene.reference),
        "obstacles": _place(scene.obstacles),
        "outlines": [
            _packed(np.zeros((0, 2))) if _is_part(scene, i) else _outline(scene, i)
            for i in range(len(scene.cores))
        ],
        "halos": [
            _outline(scene, i, scene.influence) for i in range(len(scene.cores)) if scene.influence > 0.0
        ],
        "points": _place(points),
        "forces": _place(forces),
        "longest": longest,
        "scale": longest / (float(np.nanmax(result.force, initial=0.0)) or 1.0),
        "now": {
            "error": _packed(run.error),
            "clearance": _packed(result.clearance[rows].min(axis=1)),
            "repulsion": _packed(result.force[rows].max(axis=1)),
            "torque": _packed(np.abs(result.tau[rows]).max(axis=1)),
        },
        "quantities": [
            _quantity(name, values[rows], result.layout) for name, values in _record.recorded(result).items()
        ],
    }


def _outline(scene: Scene, index: int, around: float = 0.0) -> str | list[str]:
    """What is so near an obstacle [m], relative to its position; of one that turns, one at every instant."""
    radius = scene.cores[index][1] + around
    found = [_packed(geometry.outline(corners, radius)) for corners in scene.corners(index)]
    return found if len(found) > 1 else found[0]


def _parts(scene: Scene, colours: list[str]) -> Iterator[dict[str, Any]]:
    """Balls and rods in space, of the arm and of the obstacles: the nearest has to be drawn last."""
    if scene.dimension == 2:
        return
    for part in scene.parts:
        colour = colours[part.index] if part.index >= 0 else _STILL
        yield _rod(part.corners, part.radius, colour)
    for index, (_, radius) in enumerate(scene.cores):
        points = scene.clouds[index]
        if points is not None:
            some = dataclasses.replace(scene, clouds=(points[:: 1 + len(points) // _SPECKS],) * (index + 1))
            places = np.array([some.cloud(index, row) for row in range(len(scene.t))])
            for k in range(places.shape[1]):
                yield _rod(places[:, k : k + 1], radius, _OBSTACLE)
        elif _is_part(scene, index):
            yield _rod(scene.solid(index), radius, _OBSTACLE)


def _is_part(scene: Scene, index: int) -> bool:
    """Whether an obstacle is drawn among the parts of the arm."""
    return scene.dimension == 3 and (scene.clouds[index] is not None or len(scene.cores[index][0]) <= 2)


def _rod(corners: NDArray[Any], radius: float, colour: str) -> dict[str, Any]:
    """A ball or rod at every instant; a larger depth is nearer to the viewer."""
    view = geometry.view_of(3)
    ends = corners[:, [0, -1]]
    return {
        "ends": _place(ends),
        "depth": _packed(ends.mean(axis=1) @ np.cross(*view)),
        "radius": radius,
        "colour": colour,
    }


def _quantity(name: str, values: NDArray[Any], layout: Layout) -> dict[str, Any]:
    """A recorded quantity for the panel in which the reader chooses; one row for each column."""
    flat, units = _record.flat(values).T, layout.units(name, values.shape[1:])
    return {
        "name": name,
        "label": f"{layout.quantities[name].meaning} [{units}]" if units else layout.quantities[name].meaning,
        "count": len(flat),
        "values": _packed(flat),
        "columns": [column.name for column in layout.columns(name, values.shape[1:])],
    }


def _place(points: NDArray[Any]) -> str:
    """Places (…, D) where the picture has them."""
    return _packed(geometry.seen(points))


def _packed(values: NDArray[Any]) -> str:
    """Single precision is finer than any screen; NaN stands for what cannot be drawn."""
    drawable = np.where(np.isfinite(values), values, np.nan)
    return base64.b64encode(np.ascontiguousarray(drawable, dtype="<f4").tobytes()).decode()
