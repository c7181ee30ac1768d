"""How well the end effector follows its reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from vffnull._record import AXES, unit
from vffnull.plotting import style

if TYPE_CHECKING:
    from vffnull.result import Result

_SYMBOLS = ("x", "y", r"\varphi")
_ACTUAL = "#0072B2"
_AXIS_COLOURS = ("#0072B2", "#D55E00", "#009E73")
_AXIS_DASHES = ("-", "--", "-.")  # two axes often run on top of each other


def tracking(result: Result) -> Figure:
    """Every axis of the task: reference and actual (Figs. 5, 6, 10, 11 of the paper)."""
    count = result.x.shape[1]
    fig, axes = style.panels(count, 1.0 + 1.1 * count)
    for i, ax in enumerate(axes):
        ax.plot(result.t, result.x[:, i], color=_ACTUAL, linewidth=1.6, label="actual")
        ax.plot(
            result.t, result.x_ref[:, i], color=style.INK, linestyle="--", linewidth=0.9, label="reference"
        )
        ax.set_ylabel(f"${_SYMBOLS[i]}$ [{unit('x', AXES[i])}]")
        ax.margins(y=0.08)
        _open_if_flat(ax, result.x[:, i])
    fig.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    fig.align_ylabels(axes)
    return fig


def tracking_error(result: Result) -> Figure:
    """The error by axis, and its magnitude on a logarithmic scale (Figs. 7, 12)."""
    fig, (top, bottom) = style.panels(2, 3.1)
    lengths = _lengths(result)
    factor, units = style.prefixed(float(np.nanmax(np.abs(result.error[:, lengths]))), "m")
    for i in range(result.error.shape[1]):
        scale, axis_unit = (factor, units) if i in lengths else (1.0, unit("error", AXES[i]))
        label = f"$e_{_SYMBOLS[i]}$ [{axis_unit}]"
        top.plot(
            result.t,
            scale * result.error[:, i],
            color=_AXIS_COLOURS[i],
            linestyle=_AXIS_DASHES[i],
            label=label,
        )
    top.set_ylabel(f"error [{units}]")
    top.margins(y=0.08)
    error_magnitude(bottom, result)
    fig.legend(*top.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    fig.align_ylabels([top, bottom])
    return fig


def error_magnitude(ax: Axes, result: Result) -> None:
    """The distance between end effector and reference on a logarithmic scale."""
    size = distance(result)
    ax.semilogy(result.t, np.maximum(size, style.ROUNDING), color=style.INK)
    ax.set_ylabel("$|e|$ [m]")
    low, high = decades(size)
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(LogLocator(numticks=6))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if low <= style.ROUNDING:
        ax.text(
            0.99, 0.03, "below: rounding", transform=ax.transAxes, ha="right", va="bottom", fontsize=6.5,
            color=style.MUTED,
        )  # fmt: skip


def distance(result: Result) -> NDArray[np.float64]:
    """How far the end effector is from its reference (T,) [m], whatever its orientation."""
    return np.asarray(np.linalg.norm(result.error[:, _lengths(result)], axis=1))


def _lengths(result: Result) -> list[int]:
    """Which axes of the task are lengths; the others are angles."""
    return [i for i in range(result.error.shape[1]) if unit("error", AXES[i]) == "m"]


def decades(sizes: NDArray[np.float64]) -> tuple[float, float]:
    """The limits of a logarithmic axis for distances [m]: whole decades, none below that of rounding."""
    known = sizes[np.isfinite(sizes)]
    low = max(float(np.percentile(known, 1)), style.ROUNDING) if known.size else style.ROUNDING
    high = max(float(known.max(initial=0.0)), 10.0 * low)
    return float(10.0 ** np.floor(np.log10(low) + 1e-9)), float(10.0 ** np.ceil(np.log10(high) + 0.05))


def _open_if_flat(ax: Axes, values: NDArray[np.float64]) -> None:
    """Keep a panel from blowing up rounding errors to its full height."""
    middle, least = float(np.mean(values)), 0.05
    if float(np.ptp(values)) < least:
        ax.set_ylim(middle - least, middle + least)
        ax.ticklabel_format(axis="y", useOffset=False)
