"""Primitives on Matplotlib's axes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Polygon

from vffnull.draw import geometry, style
from vffnull.draw.primitives import COLOURS, Arrow, Body, Cloud, Curve, Marks, Primitive, Role


@dataclass(frozen=True)
class Look:
    """How what has a role is drawn; widths and sizes in points."""

    width: float = 1.0
    fill: float = 0.0
    """Share of the colour in what is filled."""
    dash: Any = "-"
    marker: str = "o"
    size: float = 3.0
    hollow: bool = False


LOOKS: dict[Role, Look] = {
    "influence": Look(0.7, dash=(0, (1, 2.5))),
    "obstacle": Look(1.0, fill=0.12),
    "base": Look(marker="s", size=6.0),
    "reference": Look(0.9, dash=(0, (4, 2))),
    "plan": Look(0.7, dash=(0, (3, 2))),
    "link": Look(1.8, fill=0.3),
    "joint": Look(0.9, size=3.0, hollow=True),
    "trail": Look(0.9),
    "sensed": Look(0.0, marker=".", size=6.0),
    "target": Look(1.0, marker="x", size=5.0),
}
UNSEEN_DASH = (0, (3, 2))
"""Of the outline of what the controller does not know of."""
THICK = 0.8
"""Width of the outline of a link that has a body [points]."""


def paint(
    ax: Axes, primitives: Iterable[Primitive], *, colour: Any = None, zorder: float, label: str | None = None
) -> None:
    """Draw primitives, in one colour or in that of their roles; arrows have no scale of their own here."""
    for each in primitives:
        look = LOOKS.get(each.role, Look())
        usual = each.colour if isinstance(each, Body) else COLOURS[each.role]
        shade = usual if colour is None else colour
        match each:
            case Body(radius=0.0, corners=corners) if len(corners) == 2:
                ax.plot(*geometry.seen(corners).T, color=shade, linewidth=look.width, linestyle=look.dash,
                        solid_capstyle="round", zorder=zorder)  # fmt: skip
            case Body(role=role):
                ax.add_patch(
                    Polygon(
                        each.outline(),
                        facecolor=to_rgba(shade, look.fill if each.seen else 0.0),
                        edgecolor=shade,
                        linewidth=THICK if role == "link" else look.width,
                        linestyle=look.dash if each.seen else UNSEEN_DASH,
                        zorder=zorder,
                    )
                )
            case Cloud(points=points):
                x, y = geometry.seen(points).T
                ax.scatter(x, y, s=1.0, color=shade, linewidths=0.0, zorder=zorder)
            case Curve(points=points):
                ax.plot(*geometry.seen(points).T, color=shade, linewidth=look.width, linestyle=look.dash,
                        zorder=zorder, label=label)  # fmt: skip
            case Marks(points=points):
                ax.plot(
                    *geometry.seen(points).T,
                    linestyle="none",
                    marker=look.marker,
                    markersize=look.size,
                    markerfacecolor="white" if look.hollow else shade,
                    markeredgecolor=shade,
                    markeredgewidth=0.0 if look.marker == "." else 0.9,
                    zorder=zorder,
                    label=label,
                )
            case Arrow():
                raise ValueError("an arrow needs a scale: the film has one")


def path(ax: Axes, places: Any) -> None:
    """The dotted path of an obstacle (T, D)."""
    ax.plot(*geometry.seen(places).T, color=style.MUTED, linewidth=0.6, linestyle=(0, (1, 2)), zorder=1)
