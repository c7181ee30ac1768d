"""The arm passing the obstacles, several instants in one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from numpy.typing import NDArray

from vffnull.plotting import geometry, style

if TYPE_CHECKING:
    from vffnull.result import Result

Array = NDArray[np.float64]

_COUNT = 7
_LABELS = (0.5, 0.75)  # width and height [in] that ticks, labels and the time scale take


def strobe(result: Result) -> Figure:
    """The arm and the obstacles at several instants, from early (light) to late (dark)."""
    height = natural_height(result, style.COLUMN)
    fig = style.figure(height)
    passing(fig.subplots(), result, height=height)
    return fig


def natural_height(result: Result, width: float) -> float:
    """Height [in] at which a strobe picture of a given width has no empty margins, within reason."""
    left, right, bottom, top = geometry.frame(result)
    return _LABELS[1] + (width - _LABELS[0]) * float(np.clip((top - bottom) / (right - left), 0.4, 1.3))


def passing(ax: Axes, result: Result, height: float, width: float = style.COLUMN) -> None:
    """Draw the strobe picture and its time scale into a space of `width` by `height` [in]."""
    when = geometry.instants(result, _COUNT)
    colours = shades(len(when))
    joints, radii = geometry.joints(result)[when], geometry.link_radii(result)
    outlines = geometry.obstacle_outlines(result)

    for index, points in enumerate(outlines):
        path = result.obstacles[:, index]
        if np.ptp(path, axis=0).max() > 0.0:
            ax.plot(*path.T, color=style.MUTED, linewidth=0.6, linestyle=(0, (1, 2)), zorder=1)
            for row, colour in zip(when, colours, strict=True):
                solid(ax, points + path[row], colour, zorder=1.5 + row / len(result.t))
        else:
            solid(ax, points + path[0], style.MUTED, zorder=1.5)
    for order, (place, colour) in enumerate(zip(joints, colours, strict=True)):
        draw_arm(ax, place, radii, colour, zorder=3 + order / len(when))
    ax.plot(*result.x[:, :2].T, color=style.ALARM, linewidth=0.9, zorder=5, label="tip")
    follow = result.x_ref[:, :2]
    moves = np.ptp(follow, axis=0).max() > 0.0
    ax.plot(
        *(follow if moves else follow[-1:]).T,
        color=style.INK,
        linewidth=0.9,
        linestyle=(0, (4, 2)) if moves else "none",
        marker="x",
        markevery=[-1],
        markersize=5,
        zorder=6,
        label="reference",
    )
    stage(ax, result, height, width)
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2 / (height - _LABELS[1])), ncols=2, borderaxespad=0)
    time_scale(ax, result.t[when], colours)


def stage(ax: Axes, result: Result, height: float, width: float = style.COLUMN) -> None:
    """The arm's base and the axes, with limits that fill a space of `width` by `height` [in]."""
    ax.plot(0.0, 0.0, marker="s", markersize=6, color=style.INK, zorder=2.5)
    left, right, bottom, top = geometry.frame(result)
    scale = max((right - left) / (width - _LABELS[0]), (top - bottom) / (height - _LABELS[1]))  # m per inch
    across = (scale * (width - _LABELS[0]) - (right - left)) / 2
    along = (scale * (height - _LABELS[1]) - (top - bottom)) / 2
    left, right, bottom, top = left - across, right + across, bottom - along, top + along
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    ax.set_aspect("equal")
    ax.set_xlabel("$x$ [m]", loc="right")
    ax.set_ylabel("$y$ [m]")


def shades(count: int) -> list[Any]:
    """Colours from early to late, light to dark, also in grey."""
    return list(matplotlib.colormaps["viridis_r"](np.linspace(0.12, 1.0, count)))


def draw_arm(ax: Axes, joints: Array, radii: Array, colour: Any, zorder: float) -> None:
    """Links as lines, or as capsules if they are thick, and joints as dots."""
    if radii.max() > 0.0:
        bodies = [geometry.capsule(a, b, r) for a, b, r in zip(joints[:-1], joints[1:], radii, strict=True)]
        ax.add_collection(
            PolyCollection(
                bodies, facecolors=[to_rgba(colour, 0.3)], edgecolors=[colour], linewidths=0.8, zorder=zorder
            )
        )
    else:
        ax.add_collection(
            LineCollection([joints], colors=[colour], linewidths=1.8, joinstyle="round", zorder=zorder)
        )
    ax.plot(
        *joints.T,
        linestyle="none",
        marker="o",
        markersize=3.0,
        markerfacecolor="white",
        markeredgecolor=colour,
        markeredgewidth=0.9,
        zorder=zorder,
    )


def solid(ax: Axes, points: Array, colour: Any, zorder: float) -> Polygon:
    """An obstacle: its outline over a light tint."""
    patch = Polygon(points, facecolor=to_rgba(colour, 0.12), edgecolor=colour, linewidth=1.0, zorder=zorder)
    ax.add_patch(patch)
    return patch


def time_scale(ax: Axes, times: Array, colours: list[Any]) -> None:
    """Which colour is which instant: a narrow strip over the picture."""
    strip = ax.inset_axes((0.0, 1.03, 1.0, 0.02))
    strip.imshow([colours], aspect="auto")
    strip.set_axis_off()
    digits = 1 if times[-1] >= 2.0 else 2
    for i, t in enumerate(times):
        label = f"{t:.{digits}f}" + (" s" if i == len(times) - 1 else "")
        label = f"$t$ = {label}" if i == 0 else label
        strip.annotate(label, (i, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2),
                       textcoords="offset points", ha="center", va="bottom", fontsize=7.5)  # fmt: skip
