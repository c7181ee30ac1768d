"""What the page's script moves, as plain JSON with packed arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull.draw import geometry
from vffnull.draw.primitives import COLOURS
from vffnull.draw.report import space
from vffnull.draw.report.arrows import all_arrows
from vffnull.draw.report.figures import Run
from vffnull.draw.report.packed import packed
from vffnull.draw.scene import Scene
from vffnull.model import record as _record
from vffnull.model.record import Layout


def pack(run: Run, colours: list[str]) -> dict[str, Any]:
    """A run at the chosen instants, its links in these colours."""
    result, rows = run.result, run.rows
    return {
        "t": packed(run.t),
        "colours": colours,
        **({"space": space.pack(run)} if run.scene.dimension == 3 else _plane(run)),
        "taken": [search.taken for search in result.replans if search.taken is not None],
        "now": {
            "error": packed(run.error),
            "clearance": packed(result.clearance[rows].min(axis=1)),
            "repulsion": packed(result.force[rows].max(axis=1)),
            "torque": packed(np.abs(result.tau[rows]).max(axis=1)),
        },
        "quantities": [
            _quantity(name, values[rows], result.layout)
            for name, values in _record.recorded(result).items()
            if name != "sensed"  # thousands of points at every instant: most of a page, and no curve to read
        ],
    }


def _plane(run: Run) -> dict[str, Any]:
    """What is drawn of a run in the plane."""
    scene, longest = run.scene.pick(run.rows), run.longest_arrow
    scale = longest / (float(np.nanmax(run.scene.strengths, initial=0.0)) or 1.0)
    points, forces, roles = all_arrows(scene, scale)
    return {
        "joints": packed(scene.joints),
        "radii": scene.radii.tolist(),
        "tip": packed(scene.tip),
        "target": packed(scene.reference),
        "obstacles": packed(scene.obstacles),
        "outlines": [_outline(scene, i) for i in range(len(scene.cores))],
        "halos": [
            _outline(scene, i, 0.0 if i in scene.unseen else scene.influence)
            for i in range(len(scene.cores))
            if scene.influence > 0.0
        ],
        "points": packed(points),
        "forces": packed(forces),
        "arrows": [COLOURS[role] for role in roles],
        "longest": longest,
        **({"plan": packed(np.stack([part.corners for part in scene.plan], axis=1))} if scene.plan else {}),
    }


def _outline(scene: Scene, index: int, around: float = 0.0) -> str | list[str]:
    """What is so near an obstacle [m], relative to its position; of one that turns, one at every instant."""
    radius = scene.cores[index][1] + around
    found = [packed(geometry.outline(corners, radius)) for corners in scene.corners(index)]
    return found if len(found) > 1 else found[0]


def _quantity(name: str, values: NDArray[Any], layout: Layout) -> dict[str, Any]:
    """A recorded quantity for the panel in which the reader chooses; one row for each column."""
    flat, units = _record.flat(values).T, layout.units(name, values.shape[1:])
    return {
        "name": name,
        "label": f"{layout.quantities[name].meaning} [{units}]" if units else layout.quantities[name].meaning,
        "count": len(flat),
        "values": packed(flat),
        "columns": [column.name for column in layout.columns(name, values.shape[1:])],
    }
