"""How well the clock was kept: histograms of a real-time run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator, NullFormatter

from vffnull._support.figures import checked_file
from vffnull._support.files import replacing
from vffnull.draw import style

if TYPE_CHECKING:
    from vffnull.model.timing import Histogram, Timing

__all__ = ["draw", "save"]

PER_DECADE = 20
"""Bars per decade of time."""

SHORTEST = 1e-8
"""Shorter times [s] are no longer than reading the clock; they count as this."""


def draw(report: Timing) -> Figure:
    """Wake-up, step and response, each over the same logarithmic time."""
    with style.look():
        return _figure(report)


def save(report: Timing, path: Path) -> Path:
    """Draw it into a file."""
    checked_file(path)
    with style.look(), replacing(path) as draft:
        _figure(report).savefig(draft)
    return path


def _figure(report: Timing) -> Figure:
    parts = {
        "wake-up, late by": report.latency,
        "step, takes": report.step,
        "step, ends after it was due to begin": report.response,
    }
    figure = style.figure(4.2)
    axes = list(figure.subplots(len(parts), 1, sharex=True, squeeze=False)[:, 0])
    period = 1.0 / report.rate
    seen = np.concatenate([[period], *(part.values for part in parts.values())])
    edges = _edges(max(float(seen.min()), SHORTEST), float(seen.max()))
    colours = style.joint_colours(len(parts))
    for ax, (title, histogram), colour in zip(axes, parts.items(), colours, strict=True):
        _bars(ax, histogram, edges, colour)
        ax.axvline(period, color=style.ALARM, linewidth=0.8)
        ax.set_title(title, loc="left")
        ax.set_ylabel("periods")
    axes[-1].annotate(
        "period",
        (period, 0.95),
        xycoords=("data", "axes fraction"),
        xytext=(-3, 0),
        textcoords="offset points",
        ha="right",
        va="top",
        color=style.ALARM,
        fontsize=7.5,
    )
    axes[-1].set_xlabel("time")
    axes[-1].xaxis.set_major_locator(LogLocator(numticks=12))
    axes[-1].xaxis.set_major_formatter(EngFormatter("s", sep=" "))
    axes[-1].xaxis.set_minor_formatter(NullFormatter())
    return figure


def _edges(least: float, most: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Edges of the bars over whole decades."""
    first, last = int(np.floor(np.log10(least))), int(np.ceil(np.log10(1.01 * most)))
    edges: np.ndarray[tuple[int], np.dtype[np.float64]]
    edges = np.logspace(first, last, PER_DECADE * (last - first) + 1)
    return edges


def _bars(
    ax: Axes, histogram: Histogram, edges: np.ndarray[tuple[int], np.dtype[np.float64]], colour: str
) -> None:
    """Counts per bar, over logarithmic axes; one occurrence is still to be seen."""
    counts, _ = np.histogram(
        np.maximum(histogram.values, edges[0]), bins=edges, weights=histogram.counts.astype(float)
    )
    ax.stairs(counts, edges, fill=True, color=colour)
    ax.set_xscale("log")
    ax.set_yscale("log")
    ax.set_xlim(edges[0], edges[-1])
    ax.set_ylim(0.7, 2.0 * max(counts.max(), 1.0))
