"""Curves over the last seconds: clearance, tracking error, repulsive torque, and the error of orientation
where the task has one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray
from viser import uplot

from vffnull._core import matrices
from vffnull.live.pictures import Pictures
from vffnull.live.self_motion import SelfMotionPicture

WINDOW = 12.0
"""What is shown [s]."""
INTERVAL = 0.15
"""Between two points [s]."""

EXACT: Any = {"min": {"pad": 0, "mode": 0}, "max": {"pad": 0, "mode": 0}}
"""An axis that ends where what is drawn ends."""

CURVES = (
    ("Smallest clearance [m]", "#0072B2", 0.1),
    ("Tracking error [mm]", "#D55E00", 1.0),
    ("Repulsive torque [N·m]", "#009E73", 1.0),
    ("Orientation error [°]", "#CC79A7", 0.1),
)
"""Title, colour, and how far the axis goes at least: what is too small to matter shall look small."""


class Plots:
    """The plots, in the present container of the page, below the pictures of cameras and of what a search of
    the self-motion has found, where there are some.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self._rows: deque[tuple[float, ...]] = deque(maxlen=int(WINDOW / INTERVAL))
        self._due = 0.0
        self.pictures = Pictures(server)
        self.self_motion = SelfMotionPicture(server)
        self._handles = [self._add(server, *curve) for curve in CURVES]

    def clear(self, turns: bool) -> None:
        """Begin anew; the last curve is shown where the task has an orientation."""
        self._handles[-1].visible = turns
        for handle in self._handles:
            handle.height = 155 if turns else 205
        self._rows.clear()
        self._due = 0.0
        self.pictures.clear()
        self.self_motion.clear()

    def add(self, state: Mapping[str, Any]) -> None:
        """Take a state in, and show it when it is time to."""
        if state["t"] < self._due:
            return
        self._due = state["t"] + INTERVAL
        self._rows.append((state["t"], *measures(state)))
        if len(self._rows) < 2:  # no axis yet
            return
        columns = tuple(np.array(column) for column in zip(*self._rows, strict=True))
        for handle, values, (_, _, least) in zip(self._handles, columns[1:], CURVES, strict=True):
            handle.data = (columns[0], values, span(values, least))

    @staticmethod
    def _add(server: viser.ViserServer, title: str, colour: str, least: float) -> viser.GuiUplotHandle:
        return server.gui.add_uplot(
            (np.array([0.0, 1.0]), np.array([np.nan, np.nan]), np.array([0.0, least])),
            (
                uplot.Series(label="t [s]"),
                uplot.Series(label=title, stroke=colour, width=2, points={"show": False}),
                uplot.Series(label="", stroke="transparent", width=0, points={"show": False}),
            ),
            title=title,
            scales={"x": uplot.Scale(time=False, auto=True), "y": uplot.Scale(auto=True, range=EXACT)},
            axes=(
                uplot.Axis(size=30, grid={"show": False}, label="simulated time [s]", labelSize=18),
                uplot.Axis(size=66),  # for six digits and a comma
            ),
            legend=uplot.Legend(show=False),
            height=205,
            padding=(10, 20, 0, 0),
        )


def span(values: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """An invisible curve that goes from where the axis shall begin to where it shall end: round numbers that
    are not too far away.

    The axis follows what is drawn. Were it given as a setting, every change would make the browser build
    the plot anew, and a slow one would show an empty plot meanwhile.
    """
    known = values[np.isfinite(values)]
    low, high = (float(known.min()), float(known.max())) if known.size else (0.0, 0.0)
    ends = np.full(len(values), np.nan)
    ends[0], ends[-1] = -rounded_up(-low) if low < 0.0 else 0.0, max(least, rounded_up(high))
    return ends


def rounded_up(value: float) -> float:
    """The next round number, 0 for what is not positive."""
    if value <= 0.0:
        return 0.0
    power = 10.0 ** np.floor(np.log10(value))
    return float(
        power * next(step for step in (1, 1.5, 2, 3, 4, 5, 6, 8, 10) if value <= step * power * (1 + 1e-9))
    )


def measures(state: Mapping[str, Any]) -> tuple[float, float, float, float]:
    """Smallest clearance [m], NaN without obstacles, distance of the tip from its reference [mm], norm of the
    repulsive torque before projection [N·m], and angle between the tip's orientation and its reference [°],
    NaN for a task without one.
    """
    nearest = float(np.min(state["clearance"]))
    size = state["obstacles"].shape[1]
    error = float(np.linalg.norm(state["error"][:size]))
    torque = float(np.linalg.norm(state["tau_vff"]))
    return nearest if np.isfinite(nearest) else np.nan, 1e3 * error, torque, np.degrees(turned_off(state))


def turned_off(state: Mapping[str, Any]) -> float:
    """Angle between the tip's orientation and its reference [rad], of a pointing task between the tool's
    axes; NaN for a task without one.
    """
    size = state["obstacles"].shape[1]
    error, x, x_ref = state["error"][size:], state["x"][size:], state["x_ref"][size:]
    if not len(error):
        return float("nan")
    if size == 2:
        return float(abs(error[0]))
    if len(error) == 3:
        w, own, wanted = float(x @ x_ref), x[1:], x_ref[1:]
        away = np.linalg.norm(x_ref[0] * own - x[0] * wanted - np.cross(own, wanted))
        return float(2.0 * np.arctan2(away, abs(w)))
    axis, aim = matrices(x)[:, 2], matrices(x_ref)[:, 2]
    return float(np.arctan2(np.linalg.norm(np.cross(axis, aim)), axis @ aim))
