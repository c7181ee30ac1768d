"""Where the look-ahead lets go parts of the task: shaded in panels over time, as dark as much is let go."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.patches import Patch

import vffnull._core as _core
from vffnull.draw.primitives import COLOURS
from vffnull.model.record import THE_REST

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vffnull.model.outcome import Outcome

__all__ = ["mark"]

_SHARE = 0.28


def _parts(result: Outcome) -> list[str]:
    """The parts of the task in the order in which they give way."""
    parts = _core.parts_of_task(result.scenario["controller"], result.scenario.arm.dimension)
    return [part or THE_REST for part in parts]


def mark(axes: Iterable[Axes], result: Outcome) -> list[Patch]:
    """Shade the times at which parts are let go. Returns what belongs into a legend."""
    if result.released is None or not result.released.any():
        return []
    names, released = _parts(result), result.released.astype(int)
    edges = [0, *(np.flatnonzero(np.diff(released)) + 1).tolist(), len(released)]
    panels = list(axes)
    for begin, end in pairwise(edges):
        if released[begin]:
            alpha = _SHARE * released[begin] / len(names)
            span = result.t[begin], result.t[min(end, len(released) - 1)]
            for ax in panels:
                ax.axvspan(*span, color=COLOURS["influence"], alpha=alpha, linewidth=0.0, zorder=1.3)
    shades = np.unique(released[released > 0])
    return [
        Patch(color=COLOURS["influence"], alpha=_SHARE * k / len(names), label=f"lets go {_named(names, k)}")
        for k in shades
    ]


def _named(names: list[str], count: int) -> str:
    return "all of the task" if count == len(names) else ", ".join(names[:count])
