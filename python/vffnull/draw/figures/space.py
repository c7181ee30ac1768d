"""Pictures of scenes in space: the arm as smooth bodies among the obstacles, with earlier postures faint.

`layers_at` says which bodies there are at an instant and `render` draws them; here they are put into
Matplotlib's axes, in three dimensions with panes and ticks, or flat as seen along an axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import matplotlib
import numpy as np
from matplotlib.axes import Axes as FlatAxes
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import FigureBase
from matplotlib.image import AxesImage
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator, MaxNLocator
from numpy.typing import NDArray

from vffnull.draw import geometry
from vffnull.draw.figures.rays import Solid
from vffnull.draw.figures.render import Balls, Canvas, Layer, rods
from vffnull.draw.primitives import COLOURS, UNSEEN, Axes, Body, Cloud, Curve, Role
from vffnull.draw.scene import Scene, travels

if TYPE_CHECKING:
    from vffnull.draw.primitives import Rows

Array = NDArray[np.float64]

VIEWS: dict[str, Array] = {
    "xz": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "yz": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    "xy": np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
}
"""Flat pictures along an axis, called after what is to the right and what is up."""

_AXES = (np.array(to_rgb("#D62728")), np.array(to_rgb("#2CA02C")), np.array(to_rgb("#1F77B4")))
ELEVATION, AZIMUTH = 20.0, -52.0
"""Where from a scene is seen [°], or from the next corner."""
DARK = np.array([60, 64, 72]) / 255.0
"""The colour of obstacles among links that are coloured by clearance."""
_SHARP = 1.0  # dots of a drawn body per dot of the figure, for prints
TABLE = np.array([222, 214, 202]) / 255.0
"""The same of planes."""
_ZOOM = 0.97  # of a box in three dimensions
_FAR = 1.5  # of the arm's reach, beyond the arm's own box
_ROD = 0.005  # of the arm's reach, the radius of lines
_SPECK = 0.002  # of the picture's box, the radius of a point
_GHOST = 0.45  # opacity of the arm where the plan has it
_BOUNDS: WeakKeyDictionary[Scene, tuple[Array, Array]] = WeakKeyDictionary()
"""Of scenes that are still drawn: a film asks for them in every frame."""
SLIM = 0.8
"""How thick that arm is, compared with its own: it is not seen where the arm is."""


def layers_at(
    scene: Scene,
    row: int,
    *,
    colour: Any = None,
    tool: bool = True,
    shades: Sequence[Array] | None = None,
) -> list[Layer]:
    """What there is of bodies at an instant, in the colours of their roles, or the arm in another one.

    With `shades` of the links, red, green, blue (3,) from 0 to 1, obstacles are dark, and are cut off only
    where they are far away.
    """
    solid = _tint(COLOURS["obstacle"], 0.15) if shades is None else DARK
    flat = np.array(to_rgb(COLOURS["obstacle"])) if shades is None else TABLE
    solids: list[Solid | Balls] = []
    surfaces, around = [], padded(scene)
    box = around if shades is None else (around[0] - _FAR * scene.reach, around[1] + _FAR * scene.reach)
    thin = _ROD * scene.reach
    roles: tuple[Role, ...] = ("obstacle", "base", "link", "tool")
    for each in scene.at(row, roles if tool else roles[:-1]):
        match each:
            case Body(role="obstacle", corners=corners, radius=radius) if geometry.is_surface(corners):
                surfaces.append(Solid(corners, radius, flat))
            case Body(role="obstacle", corners=corners, radius=radius):
                found = _cut(corners, radius, box)
                paint = solid if each.seen else _tint(UNSEEN, 0.15)
                solids += [] if found is None else [Solid(found, radius, paint)]
            case Cloud(points=points, radius=radius):
                solids.append(balls(points, radius, box, solid))
            case Body(role="base", corners=corners, radius=radius):
                solids.append(Solid(corners, radius, np.array([0.55, 0.56, 0.58])))
            case Body(index=index, corners=corners, radius=radius) if shades is not None:
                solids.append(Solid(corners, radius, shades[index] * (0.9 if index % 2 else 1.0)))
            case Body(index=index, corners=corners, radius=radius):
                shade = _tint(COLOURS["link"] if colour is None else colour, 0.18 if index % 2 else 0.5)
                solids.append(Solid(corners, radius, shade))
            case Axes(origin=origin, axes=axes, length=length):
                for i, paint in enumerate(_AXES):
                    tip = origin + length * axes[:, i]
                    solids.append(Solid(np.stack([origin, tip]), 1.4 * thin, paint))
    made = [Layer(solids, floor=floor_of(scene))]
    opacity = 0.25 if shades is None else 0.5
    return [*made, Layer(surfaces, opacity, box=around)] if surfaces else made


def passing_layers(scene: Scene, rows: Rows, colours: Sequence[Any]) -> list[Layer]:
    """The scene at some instants, the last as it is, the others faint, with the paths of what moves.

    A plan is seen best where the arm is farthest from it.
    """
    thin = _ROD * scene.reach
    found: list[Layer] = []
    last, box = len(rows) - 1, padded(scene)
    farthest = int(scene.plan_deviation.argmax()) if scene.plan else None
    for order, (row, colour) in enumerate(zip(rows, colours, strict=True)):
        if order == last:
            found += [*layers_at(scene, int(row), colour=colour), *plan_layer(scene, int(row))]
            continue
        solids: list[Solid | Balls] = []
        if row == farthest:
            found.append(Layer(plan_solids(scene, int(row)), _GHOST))
        else:  # in the layer of the arm the plan is seen only where it is not within the arm
            solids += plan_solids(scene, int(row))
        for each in scene.at(int(row), ["obstacle", "link"]):
            if isinstance(each, Cloud):
                if scene.is_moving(each.index):
                    solids.append(balls(each.points, each.radius, box, _tint(COLOURS["obstacle"], 0.3)))
                continue
            assert isinstance(each, Body)
            if each.role == "link":
                solids.append(Solid(each.corners, each.radius, _tint(colour, 0.25)))
            elif scene.is_moving(each.index):
                part = _cut(each.corners, each.radius, box)
                solids += [] if part is None else [Solid(part, each.radius, _tint(each.colour, 0.3))]
        found.append(Layer(solids, 0.2 + 0.15 * order / max(last, 1), ghost=True))
    return [*found, *path_layers(scene, len(scene.t) - 1, thin)]


def plan_solids(scene: Scene, row: int) -> list[Solid]:
    """The arm where the plan has it at an instant; nothing without a plan."""
    shade = _tint(COLOURS["plan"], 0.1)
    bodies = (each for each in scene.at(row, ["plan"]) if isinstance(each, Body))
    return [Solid(*geometry.slimmer(each.corners, each.radius, SLIM), shade) for each in bodies]


def plan_layer(scene: Scene, row: int) -> list[Layer]:
    """The same as a ghost."""
    solids = plan_solids(scene, row)
    return [Layer(solids, _GHOST, ghost=True)] if solids else []


def balls(points: Array, radius: float, box: tuple[Array, Array], colour: Array) -> Balls:
    """What of a cloud is within a box; a point without a radius is drawn with a small one."""
    low, high = box
    inside = points[np.all((points > low - radius) & (points < high + radius), axis=1)]
    return Balls(inside, radius or _SPECK * float((high - low).max()), colour)


def path_layers(scene: Scene, row: int, thin: float) -> list[Layer]:
    """The paths of the obstacles, the reference's, and the end effector's until an instant."""
    lines: list[Solid] = []
    for index in range(scene.obstacles.shape[1]):
        places = scene.obstacles[:, index]
        if travels(places):
            lines += rods(places, 0.6 * thin, _tint(COLOURS["obstacle"], 0.0), dashed=True)
    for each in scene.at(row, ["reference", "trail"]):
        assert isinstance(each, Curve)
        dashed = each.role == "reference"
        lines += rods(each.points, (0.8 if dashed else 1.0) * thin, _tint(COLOURS[each.role], 0.0),
                      dashed=dashed)  # fmt: skip
    return [Layer(lines, box=padded(scene))] if lines else []


def bounds(scene: Scene) -> tuple[Array, Array]:
    """Opposite corners (3,) of a box around the arm at all times and what comes near it [m]."""
    found = _BOUNDS.get(scene)
    if found is None:
        found = _BOUNDS[scene] = _bounds(scene)
    return found


def _bounds(scene: Scene) -> tuple[Array, Array]:
    parts = (*scene.parts, *scene.plan)
    lows = [part.corners.reshape(-1, 3).min(axis=0) - part.radius for part in parts]
    highs = [part.corners.reshape(-1, 3).max(axis=0) + part.radius for part in parts]
    low, high = (
        np.min([*lows, scene.reference.min(axis=0)], axis=0),
        np.max([*highs, scene.reference.max(axis=0)], axis=0),
    )
    inner, reach = (low.copy(), high.copy()), 0.3 * float((high - low).max())
    for index, (corners, radius) in enumerate(scene.cores):
        if geometry.is_surface(corners):
            continue  # a surface has no end
        places = scene.solid(index)
        starts, ends = places.min(axis=1) - radius, places.max(axis=1) + radius
        near = np.all((ends > inner[0] - 0.5 * reach) & (starts < inner[1] + 0.5 * reach), axis=1)
        if near.any():
            low = np.minimum(low, np.maximum(starts[near].min(axis=0), inner[0] - 1.5 * reach))
            high = np.maximum(high, np.minimum(ends[near].max(axis=0), inner[1] + 1.5 * reach))
    floor = floor_of(scene)
    if floor is not None:
        low[2] = floor
        below = [
            float(corners[:, 2].mean() + scene.obstacles[0, index, 2])
            for index, (corners, _) in enumerate(scene.cores)
            if geometry.is_surface(corners)
        ]
        low[2] = min([floor, *(z for z in below if floor - 0.15 * scene.reach < z)])
    return low, high


def padded(scene: Scene) -> tuple[Array, Array]:
    """The same with a margin, but none below the floor: the limits of the axes, where bodies are cut off."""
    low, high = bounds(scene)
    pad = 0.03 * float((high - low).max())
    below = 0.0 if floor_of(scene) is not None else pad
    return low - [pad, pad, below + 1e-9], high + pad


def floor_of(scene: Scene) -> float | None:
    """The height of the floor that the arm stands on [m]; None if its links go below its base."""
    base = float(scene.joints[0, 0, 2] if scene.base is None else scene.base[2])
    if scene.foot < base:
        return scene.foot
    moving = [float(part.corners[..., 2].min()) - part.radius for part in scene.parts if part.index >= 0]
    return base if min(moving, default=base) > base - 0.1 * scene.reach else None


def stage(fig: FigureBase, scene: Scene, rect: tuple[float, float, float, float]) -> Any:
    """Axes in three dimensions with equal scales and light panes, in a part of the figure."""
    low, high = padded(scene)
    ax: Any = fig.add_axes(rect, projection="3d")
    ax.set_proj_type("ortho")
    ax.view_init(elev=ELEVATION, azim=AZIMUTH + scene.next_corner)
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    ax.set_box_aspect(high - low, zoom=_ZOOM)
    ax.patch.set_alpha(0.0)
    named = ((ax.xaxis, "$x$ [m]", -2.5), (ax.yaxis, "$y$ [m]", -2.5), (ax.zaxis, "$z$ [m]", -7.0))
    for axis, name, away in named:
        axis.set_pane_color((0.965, 0.968, 0.975, 1.0))
        axis.pane.set_edgecolor("#D0D0D0")
        axis.line.set_color("#A0A0A0")
        axis._axinfo["grid"].update(color="#E2E2E2", linewidth=0.5)
        axis._axinfo["tick"].update(inward_factor=0.0, outward_factor=0.15)
        axis.set_major_locator(FixedLocator(_inside(*axis.get_view_interval()).tolist()))
        axis.set_tick_params(labelsize=6.5, pad=-3.0)
        axis.set_label_text(name)
        axis.labelpad = away
    _shrink(ax, fig)
    return ax


def _shrink(ax: Any, fig: Any) -> None:
    """Make a box smaller whose labels an edge of the figure would cut off, as below one that is tall."""
    renderer = ax.get_figure(root=True).canvas.get_renderer()
    ax.draw(renderer)  # only now the labels have places
    seen, middle = fig.bbox, ax.bbox.corners().mean(axis=0)
    room = np.array([seen.x0, seen.y0, -seen.x1, -seen.y1]) - [*middle, *-middle]
    boxes = [axis.label.get_window_extent(renderer) for axis in (ax.xaxis, ax.yaxis, ax.zaxis)]
    needed = np.array([[box.x0, box.y0, -box.x1, -box.y1] for box in boxes]) - [*middle, *-middle]
    edge = 0.03 * renderer.dpi
    share = float(((room + edge) / np.minimum(needed, room + edge)).min())
    if share < 1.0:
        low, high = np.transpose([axis.get_view_interval() for axis in (ax.xaxis, ax.yaxis, ax.zaxis)])
        ax.set_box_aspect(high - low, zoom=_ZOOM * share)


def _inside(low: float, high: float) -> Array:
    """Round numbers that keep away from the ends of an axis, where two axes meet."""
    ticks = np.asarray(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]).tick_values(low, high))
    room = 0.05 * (high - low)
    inner = ticks[(ticks >= low + room) & (ticks <= high - room)]
    return np.append(ticks[np.isclose(ticks, low)], inner) if low == 0.0 else inner


def view_of(ax: Any) -> tuple[Array, float, Array]:
    """The picture's axes (2, 3) of axes in three dimensions, its units per metre, and where the origin is."""
    matrix = np.asarray(ax.get_proj())
    places = np.vstack([np.zeros(3), np.eye(3)])
    flat = np.column_stack([places, np.ones(4)]) @ matrix.T
    flat = flat[:, :2] / flat[:, 3:]
    rows = (flat[1:] - flat[0]).T
    scale = float(np.linalg.norm(rows[0]))
    return rows / np.linalg.norm(rows, axis=1, keepdims=True), scale, flat[0]


def put(ax: Any, layers: list[Layer], *, sharp: float = _SHARP, canvas: Canvas | None = None) -> AxesImage:
    """Draw bodies into axes in three dimensions, where these are to be seen."""
    view, scale, origin = view_of(ax)
    if canvas is None:
        canvas = Canvas.around(layers, view, dot_of(ax, scale, sharp))
    left, right, bottom, top = canvas.extent
    across, upwards = origin[0] + scale * np.array([left, right]), origin[1] + scale * np.array([bottom, top])
    image = AxesImage(ax, extent=(*across, *upwards), origin="lower", interpolation="antialiased")
    image.set_data(canvas.draw(layers))
    image.set_zorder(5)
    image.set_clip_on(False)
    ax.add_artist(image)
    return image


def dot_of(ax: Any, scale: float, sharp: float = 1.0) -> float:
    """The side of a dot [m], of so many per dot of the figure."""
    ax.apply_aspect()
    (x0, _), (x1, _) = ax.transData.transform([(0.0, 0.0), (scale, 0.0)])
    return float(1.0 / (sharp * abs(x1 - x0)))


def flat(ax: FlatAxes, scene: Scene, layers: list[Layer], name: str, dots: float) -> None:
    """The same as seen along an axis, in metres; `dots` per metre."""
    canvas = Canvas.around(layers, VIEWS[name], 1.0 / dots)
    ax.imshow(
        canvas.draw(layers), extent=canvas.extent, origin="lower", interpolation="antialiased", zorder=3
    )
    (left, bottom), (right, top) = (VIEWS[name] @ corner for corner in padded(scene))
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    ax.set_xlabel(f"${name[0]}$ [m]", labelpad=1.0)
    ax.set_ylabel(f"${name[1]}$ [m]", labelpad=2.5)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_locator(MaxNLocator(nbins=4, steps=[1, 2, 2.5, 5, 10]))


def _cut(corners: Array, radius: float, box: tuple[Array, Array]) -> Array | None:
    """What of an obstacle's core lies within a box, if anything: shorter rods, and boxes that stand straight.

    One that is turned is left as it is.
    """
    low, high = box
    if np.any(corners.max(axis=0) + radius < low) or np.any(corners.min(axis=0) - radius > high):
        return None
    if len(corners) == 2:
        a, along = corners[0], corners[1] - corners[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.stack([(low - a) / along, (high - a) / along])
        ends = np.where(np.isnan(ends), [[-np.inf], [np.inf]], ends)
        first, last = max(0.0, float(ends.min(axis=0).max())), min(1.0, float(ends.max(axis=0).min()))
        return a + np.array([[first], [last]]) * along if first < last else corners
    if len(corners) != 8 or not geometry.is_block(corners):
        return corners
    _, edges = geometry.edges_in_space(corners)
    straight = (np.abs(edges) > 1e-9).sum(axis=1) <= 1
    return np.clip(corners, low, high) if straight.all() else corners


def key(scene: Scene) -> list[Line2D]:
    """What the lines of a picture are."""
    found = []
    if any(travels(scene.obstacles[:, i]) for i in range(scene.obstacles.shape[1])):
        found.append(
            Line2D([], [], color=COLOURS["obstacle"], linewidth=0.9, linestyle=(0, (2, 2)), label="obstacle")
        )
    if scene.moves:
        found.append(
            Line2D([], [], color=COLOURS["reference"], linewidth=0.9, linestyle="--", label="reference")
        )
        found.append(Line2D([], [], color=COLOURS["trail"], linewidth=1.2, label="tip"))
    if scene.plan:
        ghost = to_rgba(COLOURS["plan"], _GHOST)
        found.append(Line2D([], [], color=ghost, linewidth=4.0, solid_capstyle="butt", label="plan"))
    return found


def _tint(colour: Any, white: float) -> Array:
    """A colour with a share of white."""
    return np.asarray(to_rgb(colour)) * (1.0 - white) + white


def moments(scene: Scene, count: int = 5) -> tuple[Rows, list[Any]]:
    """Instants for one picture, where more than a few would hide each other, and a colour for each."""
    when = scene.instants(count)
    return when, list(matplotlib.colormaps["Blues"](np.linspace(0.3, 0.85, len(when))))
