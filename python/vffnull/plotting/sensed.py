"""What the range sensors along the links have seen of the obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from vffnull.plotting import geometry, strobe, style

if TYPE_CHECKING:
    from vffnull.result import Result

_COUNT = 5


def sensed(result: Result) -> Figure:
    """The points that the controller knew at several instants, over the arm and the true obstacles then.

    Each instant has its colour; a point off its obstacle is noise, delay or motion since the scan.
    """
    height = strobe.natural_height(result, style.COLUMN)
    fig = style.figure(height)
    ax = fig.subplots()
    when = geometry.instants(result, _COUNT)
    colours = strobe.shades(len(when))
    joints, radii = geometry.joints(result), geometry.link_radii(result)
    outlines = geometry.obstacle_outlines(result)
    points = np.empty((0, 0, 2)) if result.sensed is None else result.sensed
    for row, colour in zip(when, colours, strict=True):
        order = 3 + row / len(result.t)
        pale = (*colour[:3], 0.45)
        strobe.draw_arm(ax, joints[row], radii, pale, zorder=order)
        for index, outline in enumerate(outlines):
            strobe.solid(ax, outline + result.obstacles[row, index], pale, zorder=order - 2)
        ax.plot(
            *points[row].T,
            linestyle="none",
            marker=".",
            markersize=6,
            markeredgewidth=0,
            color=colour,
            zorder=6,
        )
    strobe.stage(ax, result, height)
    ax.plot([], [], linestyle="none", marker=".", color=style.INK, label="point that the controller knows")
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.1), borderaxespad=0)
    strobe.time_scale(ax, result.t[when], colours)
    return fig
