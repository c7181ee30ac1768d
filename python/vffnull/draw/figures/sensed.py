"""What the range sensors along the links have seen of the obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from vffnull.draw import style
from vffnull.draw.figures import canvas, strobe
from vffnull.draw.scene import AROUND, Scene

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

_COUNT = 5
_AROUND = 1.0
"""How much of what comes near an arm in space is seen [sizes of the arm]: it is told by its whole shape."""


def sensed(result: Outcome) -> Figure:
    """The points that the controller knew at several instants, over the arm and the true obstacles then.

    Each instant has its colour; a point off its obstacle is noise, delay or motion since the scan.
    """
    scene = Scene.of_result(result)
    around = AROUND if scene.dimension == 2 else _AROUND
    height = strobe.natural_height(scene, style.COLUMN, around=around)
    fig = style.figure(height)
    ax = fig.subplots()
    when = scene.instants(_COUNT)
    colours = strobe.shades(len(when))
    for row, colour in zip(when, colours, strict=True):
        order = 3 + row / len(result.t)
        pale = (*colour[:3], 0.45)
        canvas.paint(ax, scene.at(row, ["obstacle"]), colour=pale, zorder=order - 2)
        canvas.paint(ax, scene.at(row, ["link", "joint"]), colour=pale, zorder=order)
        canvas.paint(ax, scene.at(row, ["sensed"]), colour=colour, zorder=6)
    strobe.stage(ax, scene, height, around=around)
    ax.plot([], [], linestyle="none", marker=".", color=style.INK, label="point that the controller knows")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.1), borderaxespad=0)
    strobe.time_scale(ax, result.t[when], colours)
    return fig
