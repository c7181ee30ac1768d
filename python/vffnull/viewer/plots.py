"""Three curves over the last seconds: clearance, tracking error, repulsive torque."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import viser
from viser import uplot

WINDOW = 12.0
"""What is shown [s]."""
INTERVAL = 0.1
"""Between two points [s]."""

CURVES = (
    ("Smallest clearance [mm]", "#0072B2"),
    ("Tracking error [mm]", "#D55E00"),
    ("Repulsive torque [N·m]", "#009E73"),
)


class Plots:
    """The plots, in the present container of the page."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._rows: deque[tuple[float, ...]] = deque(maxlen=int(WINDOW / INTERVAL))
        self._due = 0.0
        self._handles = [self._add(server, *curve) for curve in CURVES]

    def clear(self) -> None:
        """Begin anew."""
        self._rows.clear()
        self._due = 0.0

    def add(self, state: Mapping[str, Any]) -> None:
        """Take a state in, and show it when it is time to."""
        if state["t"] < self._due:
            return
        self._due = state["t"] + INTERVAL
        self._rows.append((state["t"], *measures(state)))
        columns = tuple(np.array(column) for column in zip(*self._rows, strict=True))
        for handle, values in zip(self._handles, columns[1:], strict=True):
            handle.data = (columns[0], values)

    @staticmethod
    def _add(server: viser.ViserServer, title: str, colour: str) -> viser.GuiUplotHandle:
        return server.gui.add_uplot(
            (np.array([0.0, 1.0]), np.array([np.nan, np.nan])),
            (
                uplot.Series(label="t [s]"),
                uplot.Series(label=title, stroke=colour, width=2, points={"show": False}),
            ),
            title=title,
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True)},
            axes=(uplot.Axis(size=28, grid={"show": False}), uplot.Axis(size=48)),
            legend=uplot.Legend(show=False),
            height=170,
        )


def measures(state: Mapping[str, Any]) -> tuple[float, float, float]:
    """Smallest clearance [mm], NaN without obstacles, distance of the tip from its reference [mm], and norm of
    the repulsive torque before projection [N·m].
    """
    nearest = float(np.min(state["clearance"]))
    error = float(np.linalg.norm(state["error"][:2]))
    return 1e3 * nearest if np.isfinite(nearest) else np.nan, 1e3 * error, float(np.linalg.norm(state["tau_vff"]))
