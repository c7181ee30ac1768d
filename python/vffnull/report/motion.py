"""What the page's script moves, as plain JSON with packed arrays, places as the picture has them."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _record
from vffnull._record import Layout
from vffnull.plotting import geometry
from vffnull.report.figures import Run


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
        "tip": _place(scene.tip),
        "target": _place(scene.reference),
        "obstacles": _place(scene.obstacles),
        "outlines": [_packed(geometry.outline(*core)) for core in scene.cores],
        "halos": [
            _packed(geometry.outline(corners, radius + scene.influence))
            for corners, radius in scene.cores
            if scene.influence > 0.0
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
