"""The look of every figure: sizes for one printed column, colours that everybody can tell apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from io import BytesIO
from typing import Any

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vffnull.draw.colours import CONTACT as CONTACT
from vffnull.draw.colours import FREE as FREE
from vffnull.draw.colours import NEAR as NEAR

COLUMN = 3.5
"""Width of a printed column [in]."""
PAGE = 7.2
"""Width of a printed page [in]."""

INK = "#222222"
MUTED = "#777777"
ALARM = "#B2182B"

ROUNDING = 1e-12
"""Where rounding begins: a distance [m] below it says nothing of arm and law."""

# Okabe and Ito's palette, its yellow darkened so that a thin line of it shows on white.
_DISTINCT = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#222222", "#A89B00")

_LOOK: dict[str, Any] = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 8,
    "axes.xmargin": 0.0,
    "figure.constrained_layout.h_pad": 0.05,
    "figure.constrained_layout.w_pad": 0.03,
    "figure.dpi": 200,
    "font.size": 8,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.5,
    "legend.borderaxespad": 0.2,
    "legend.columnspacing": 1.2,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "legend.handlelength": 1.5,
    "legend.handletextpad": 0.4,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "pdf.fonttype": 42,  # text stays text
    "savefig.dpi": 200,
    "svg.fonttype": "none",
    "text.color": INK,
    "xtick.color": INK,
    "xtick.labelsize": 7.5,
    "xtick.major.size": 2.5,
    "xtick.major.width": 0.6,
    "ytick.color": INK,
    "ytick.labelsize": 7.5,
    "ytick.major.size": 2.5,
    "ytick.major.width": 0.6,
    "ytick.minor.size": 1.5,
    "ytick.minor.width": 0.4,
}


@contextmanager
def look() -> Iterator[None]:
    """Draw and save inside this; the caller's own settings are untouched."""
    with matplotlib.style.context(["default", _LOOK]):
        yield


class Drawing(Figure):
    """A figure that notebooks show whether or not pyplot is in use."""

    def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
        """PNG, and how wide to show it [pixels]."""
        with look(), BytesIO() as target:
            self.savefig(target, format="png")
            return target.getvalue(), {"width": round(110 * self.get_figwidth())}


def figure(height: float, width: float = COLUMN) -> Figure:
    """An empty figure [in] outside pyplot's list, so that nothing has to be closed."""
    made = Drawing(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(made)
    return made


def stacked(fig: FigureBase, count: int) -> list[Axes]:
    """Panels one above the other over a common time axis, with round numbers at every axis."""
    axes = list(fig.subplots(count, 1, sharex=True, squeeze=False)[:, 0])
    for ax in axes:
        ax.yaxis.set_major_locator(MaxNLocator(nbins=5, steps=[1, 2, 2.5, 5, 10], min_n_ticks=3))
    axes[-1].xaxis.set_major_locator(MaxNLocator(nbins=7, steps=[1, 2, 5, 10]))
    axes[-1].set_xlabel("time [s]")
    return axes


def panels(count: int, height: float, width: float = COLUMN) -> tuple[Figure, list[Axes]]:
    """A figure with panels one above the other over a common time axis."""
    made = figure(height, width)
    return made, stacked(made, count)


def joint_colours(n: int) -> list[Any]:
    """One colour for each of n joints or links, the same in every figure."""
    if n <= len(_DISTINCT):
        return list(_DISTINCT[:n])
    return list(matplotlib.colormaps["viridis"](np.linspace(0.0, 0.92, n)))


def joint_lines(ax: Axes, t: NDArray[np.float64], values: NDArray[np.float64], **how: Any) -> None:
    """One line for each joint or link, in its colour."""
    for index, colour in enumerate(joint_colours(values.shape[1])):
        ax.plot(t, values[:, index], color=colour, label=f"_{index}", **how)


def joint_key(fig: FigureBase, axes: Sequence[Axes], n: int, what: str, more: Sequence[Line2D] = ()) -> None:
    """Say which colour is which joint or link, counted from 0 at the base, outside the data.

    Lines that lie outside of all panels are left out: nobody would find them. What there is `more` stands
    below.
    """
    if more:
        fig.legend(handles=list(more), loc="outside lower center", ncols=len(more))
    colours = joint_colours(n)
    if n > len(_DISTINCT):
        edges = np.arange(n + 1) - 0.5
        key = matplotlib.cm.ScalarMappable(BoundaryNorm(edges, n), ListedColormap(colours))
        bar = fig.colorbar(key, ax=list(axes), label=what, pad=0.02, aspect=30)
        bar.ax.yaxis.set_major_locator(MaxNLocator(nbins=10, integer=True))
        bar.ax.minorticks_off()
        return
    found = sorted(_visible(axes)) or list(range(n))
    labels = [f"{what} {found[0]}", *map(str, found[1:])]
    handles = [Line2D([], [], color=colours[index]) for index in found]
    # Eight entries have to fit above half a page.
    fig.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=len(found),
        handlelength=1.2,
        handletextpad=0.4,
        columnspacing=1.0,
    )


def _visible(axes: Sequence[Axes]) -> set[int]:
    """The joints or links with a line that passes through a panel."""
    found = set()
    for ax in axes:
        low, high = ax.get_ylim()
        for line in ax.get_lines():
            values = np.asarray(line.get_ydata(), dtype=float)
            if str(line.get_label())[1:].isdigit() and np.any((values >= low) & (values <= high)):
                found.add(int(str(line.get_label())[1:]))
    return found


def by_clearance(share: float) -> NDArray[np.float64]:
    """Red, green, blue (3,) from 0 to 1 of a link in space, by its clearance in shares of the influence
    distance.
    """
    nodes = np.array([CONTACT, NEAR, FREE]) / 255.0
    part = 2.0 * float(np.clip(share, 0.0, 1.0)) if np.isfinite(share) else 2.0
    return np.array([np.interp(part, [0.0, 1.0, 2.0], nodes[:, i]) for i in range(3)])


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """A factor and a unit in which a magnitude reads well: 2·10⁻⁶ m are 2 µm."""
    if np.isfinite(largest) and largest > 0:
        for power, prefix in ((0, ""), (3, "m"), (6, "µ"), (9, "n"), (12, "p")):
            if largest * 10.0**power >= 1.0:
                return 10.0**power, f"{prefix}{unit}"
    return 1.0, unit


def level(ax: Axes, value: float, text: str, *, colour: str = MUTED) -> None:
    """A dashed level across the panel, named at its right end, outside the data."""
    ax.axhline(value, color=colour, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1.5)
    ax.annotate(
        text,
        (1.0, value),
        xycoords=("axes fraction", "data"),
        xytext=(3, 0),
        textcoords="offset points",
        color=colour,
        fontsize=7,
        va="center",
    )


def fit(text: Text, most: float) -> None:
    """Shorten what is written in one line until it is no wider than this [dots]."""
    whole = text.get_text()
    while whole and text.get_window_extent().width > most:
        whole = whole[: -max(1, len(whole) // 16)]
        text.set_text(whole.rstrip() + "…")


def note(ax: Axes, text: str) -> None:
    """A few words above the right end of a panel, outside the data."""
    ax.annotate(
        text,
        (1.0, 1.0),
        xycoords="axes fraction",
        xytext=(0, 2),
        textcoords="offset points",
        color=MUTED,
        fontsize=6.5,
        ha="right",
        va="bottom",
    )
