"""The arm passing the obstacles, several instants in one picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from vffnull.draw import style
from vffnull.draw.figures import canvas, space
from vffnull.draw.primitives import Marks
from vffnull.draw.scene import AROUND, Scene

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

Array = NDArray[np.float64]

_COUNT = 7
_TALLEST = 4.4  # in
_LABELS = (0.5, 0.75)  # width and height [in] that ticks, labels and the time scale take


def strobe(result: Outcome) -> Figure:
    """The arm and the obstacles at several instants, from early (light) to late (dark)."""
    scene = Scene.of_result(result)
    if scene.dimension == 3:
        return _in_space(scene)
    height = natural_height(scene, style.COLUMN)
    fig = style.figure(height)
    passing(fig.subplots(), result, height=height)
    return fig


def _in_space(scene: Scene) -> Figure:
    """The view in three dimensions, and beside it the three along the axes, aligned and to one scale."""
    low, high = space.padded(scene)
    x, y, z = high - low
    across, upwards = np.array([x, y]), np.array([z, y])  # the columns and the rows of the flat views [m]
    room = np.array([0.52 * style.PAGE - 1.3, _TALLEST - 1.1])  # what their labels leave
    scale = float((room / [across.sum(), upwards.sum()]).min())
    block, tall = scale * across.sum() + 1.3, max(scale * upwards.sum() + 1.1, 0.85 * _TALLEST)
    fig = style.figure(tall, style.PAGE)
    fig.set_layout_engine("none")
    when, colours = space.moments(scene)
    layers = space.passing_layers(scene, when, colours)
    space.put(space.stage(fig, scene, (0.0, 0.0, 1.0 - block / style.PAGE, 1.0)), layers)
    lefts = style.PAGE - block + np.array([0.6, 1.1 + scale * x])
    floor = (tall - 1.0 - scale * upwards.sum()) / 2.0
    bottoms = floor + np.array([0.9 + scale * y, 0.42])
    flat = []
    for name, column, row in (("xz", 0, 0), ("yz", 1, 0), ("xy", 0, 1)):
        corner = lefts[column] / style.PAGE, bottoms[row] / tall
        ax = fig.add_axes((*corner, scale * across[column] / style.PAGE, scale * upwards[row] / tall))
        space.flat(ax, scene, layers, name, 1.6 * 200 / scene.reach)
        flat.append(ax)
    fig.align_ylabels([flat[0], flat[2]])
    times = zip(time_labels(scene.t[when]), colours, strict=True)
    key = [Patch(facecolor=colour, label=label) for label, colour in times]
    where = lefts[1] / style.PAGE, (bottoms[1] + scale * y) / tall
    fig.legend(handles=[*key, *space.key(scene)], loc="upper left", bbox_to_anchor=where)
    return fig


def in_depth(fig: Any, scene: Scene, rect: tuple[float, float, float, float]) -> None:
    """The picture in three dimensions with its time scale and key, in a part of the figure."""
    left, bottom, wide, tall = rect
    when, colours = space.moments(scene)
    ax = space.stage(fig, scene, (left, bottom, wide, 0.92 * tall))
    space.put(ax, space.passing_layers(scene, when, colours))
    strip = fig.add_axes((left + 0.1 * wide, bottom + 0.91 * tall, 0.8 * wide, 0.018 * tall))
    scale_into(strip, scene.t[when], colours)
    if lines := space.key(scene):
        ax.legend(handles=lines, loc="upper left", bbox_to_anchor=(0.02, 0.985))


def natural_height(scene: Scene, width: float, *, field: bool = False, around: float = AROUND) -> float:
    """Height [in] at which a strobe picture of a given width has no empty margins, within reason."""
    low, high = scene.frame(field=field, around=around)
    wide, tall = high - low
    return _LABELS[1] + (width - _LABELS[0]) * float(np.clip(tall / wide, 0.4, 1.3))


def passing(ax: Axes, result: Outcome, height: float, width: float = style.COLUMN) -> None:
    """Draw the strobe picture and its time scale into a space of `width` by `height` [in]."""
    scene = Scene.of_result(result)
    when = scene.instants(_COUNT)
    colours = shades(len(when))
    draw(ax, scene, list(when), colours)
    moves = scene.moves
    canvas.paint(ax, scene.at(-1, ["reference"]), colour=style.INK, zorder=6)
    canvas.paint(ax, scene.at(len(scene.t) - 1, ["trail"]), colour=style.ALARM, zorder=5, label="tip")
    ax.plot([], [], color=style.INK, linewidth=0.9, linestyle=(0, (4, 2)) if moves else "none", marker="x",
            markersize=5, label="reference")  # fmt: skip
    canvas.paint(ax, [Marks("target", scene.reference[-1:])], colour=style.INK, zorder=6)
    if scene.plan:
        look = canvas.LOOKS["plan"]
        ax.plot([], [], color=style.INK, linewidth=look.width, linestyle=look.dash, label="plan")
    stage(ax, scene, height, width)
    ax.legend(loc="upper left", bbox_to_anchor=(0.0, -0.2 / (height - _LABELS[1])), ncols=3, borderaxespad=0)
    time_scale(ax, result.t[when], colours)


def draw(ax: Axes, scene: Scene, rows: list[Any], colours: list[Any]) -> None:
    """The arm and the obstacles at some instants, each in its colour; what never moves is drawn once."""
    for index, body in enumerate(scene.at(0, ["obstacle"])):
        places = scene.obstacles[:, index]
        if scene.is_moving(index):
            canvas.path(ax, places)
            for row, colour in zip(rows, colours, strict=True):
                there = scene.at(row, ["obstacle"])[index]
                canvas.paint(ax, [there], colour=colour, zorder=1.5 + row / len(scene.t))
        else:
            canvas.paint(ax, [body], colour=style.MUTED, zorder=1.5)
    for order, (row, colour) in enumerate(zip(rows, colours, strict=True)):
        canvas.paint(ax, scene.at(row, ["plan"]), colour=colour, zorder=2.9)
        canvas.paint(ax, scene.at(row, ["link", "joint"]), colour=colour, zorder=3 + order / len(rows))


def stage(
    ax: Axes,
    scene: Scene,
    height: float,
    width: float = style.COLUMN,
    *,
    field: bool = False,
    around: float = AROUND,
) -> None:
    """The arm's base and the axes, with limits that fill a space of `width` by `height` [in].

    The picture of a scene in space has no axes: nothing can be read from them.
    """
    canvas.paint(ax, scene.at(0, ["base"]), zorder=2.5)
    low, high = scene.frame(field=field, around=around)
    room = np.array([width - _LABELS[0], height - _LABELS[1]])
    scale = float(((high - low) / room).max())  # m per inch
    spare = (scale * room - (high - low)) / 2
    (left, bottom), (right, top) = low - spare, high + spare
    ax.set_xlim(left, right)
    ax.set_ylim(bottom, top)
    ax.set_aspect("equal")
    if scene.dimension == 2:
        ax.set_xlabel("$x$ [m]", loc="right")
        ax.set_ylabel("$y$ [m]")
    else:
        ax.set_axis_off()


def shades(count: int) -> list[Any]:
    """Colours from early to late, light to dark, also in grey."""
    return list(matplotlib.colormaps["viridis_r"](np.linspace(0.12, 1.0, count)))


def time_scale(ax: Axes, times: Array, colours: list[Any]) -> None:
    """Which colour is which instant: a narrow strip over the picture."""
    scale_into(ax.inset_axes((0.0, 1.03, 1.0, 0.02)), times, colours)


def scale_into(strip: Axes, times: Array, colours: list[Any]) -> None:
    """The time scale on axes of its own."""
    strip.imshow([colours], aspect="auto")
    strip.set_axis_off()
    for i, label in enumerate(time_labels(times)):
        strip.annotate(label, (i, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2),
                       textcoords="offset points", ha="center", va="bottom", fontsize=7.5)  # fmt: skip


def time_labels(times: Array) -> list[str]:
    """Times [s] with as many digits as tell them apart; the first says what they are, the last the unit."""
    digits = 1 if times[-1] >= 2.0 else 2
    found = [f"{t:.{digits}f}" for t in times]
    found[0] = f"$t$ = {found[0]}"
    found[-1] += " s"
    return found
