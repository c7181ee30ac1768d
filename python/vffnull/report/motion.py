"""Everything that the page's script moves, as plain JSON with packed arrays."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _record
from vffnull.plotting import geometry
from vffnull.report import figures
from vffnull.result import Result


def pack(result: Result, colours: list[str]) -> dict[str, Any]:
    """A run at the chosen instants, its links in these colours."""
    rows = figures.chosen(result)
    points, forces = geometry.pushes(result, rows)
    longest = figures.longest_arrow(result)
    return {
        "t": _packed(result.t[rows]),
        "joints": _packed(geometry.joints(result)[rows]),
        "colours": colours,
        "radii": geometry.link_radii(result).tolist(),
        "tip": _packed(result.x[rows, :2]),
        "target": _packed(result.x_ref[rows, :2]),
        "obstacles": _packed(result.obstacles[rows]),
        "outlines": [_packed(points) for points in geometry.obstacle_outlines(result)],
        "halos": [_packed(points) for points in figures.halos(result)],
        "points": _packed(points),
        "forces": _packed(forces),
        "longest": longest,
        "scale": longest / (float(np.nanmax(result.force, initial=0.0)) or 1.0),
        "now": {
            "error": _packed(figures.error_magnitude(result)[rows]),
            "clearance": _packed(result.clearance[rows].min(axis=1)),
            "repulsion": _packed(result.force[rows].max(axis=1)),
            "torque": _packed(np.abs(result.tau[rows]).max(axis=1)),
        },
        "quantities": [_quantity(name, values[rows]) for name, values in _record.recorded(result).items()],
    }


def _quantity(name: str, values: NDArray[Any]) -> dict[str, Any]:
    """A recorded quantity for the panel in which the reader chooses; one row for each column."""
    about = _record.QUANTITIES[name]
    flat = _record.flat(values).T
    return {
        "name": name,
        "label": f"{about.meaning} [{about.unit}]",
        "count": len(flat),
        "values": _packed(flat),
        "columns": [column.name for column in _record.columns(name, values.shape[1:])],
    }


def _packed(values: NDArray[Any]) -> str:
    """Single precision is finer than any screen; NaN stands for what cannot be drawn."""
    drawable = np.where(np.isfinite(values), values, np.nan)
    return base64.b64encode(np.ascontiguousarray(drawable, dtype="<f4").tobytes()).decode()
