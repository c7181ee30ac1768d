"""Controllers side by side: rates with their intervals, clearances, errors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vffnull._support.errors import InputError
from vffnull._support.files import replacing
from vffnull.draw import style

if TYPE_CHECKING:
    from vffnull.evaluation.table import Table

__all__ = ["save"]


def save(evaluation: Table, directory: Path, ending: str = ".png") -> list[Path]:
    """Draw the figures into a directory, which is made if need be; there has to be a row."""
    if not evaluation.families:
        raise InputError("evaluation: there are no rows to draw")
    directory.mkdir(parents=True, exist_ok=True)
    files = []
    with style.look():
        for name, draw in (("rates", rates), ("clearance", clearance), ("error", error)):
            files.append(directory / f"{name}{ending}")
            with replacing(files[-1]) as draft:
                draw(evaluation).savefig(draft)
    return files


def rates(evaluation: Table) -> Figure:
    """Collisions in scenes with an escape, and success in scenes with an escape that holds the tip."""
    names = evaluation.controllers
    fig = style.figure(0.9 + 0.2 * len(names) * 2, style.PAGE)
    axes = fig.subplots(2, len(evaluation.families), sharex=True, sharey=True, squeeze=False)
    colours = style.joint_colours(len(names))
    for column, family in enumerate(evaluation.families):
        rows = evaluation.where(family=family)
        of_tip = rows.with_tip
        for ax, (what, scenes) in zip(
            axes[:, column], (("collided", rows.feasible), ("success", of_tip)), strict=True
        ):
            for place, (name, colour) in enumerate(zip(names, colours, strict=True)):
                rate = scenes.where(controller=name).rate(what)
                if rate.total:
                    ax.plot([100 * rate.low, 100 * rate.high], [place, place], color=colour, linewidth=1.6)
                    ax.plot(100 * rate.value, place, "o", color=colour, markersize=4, clip_on=False)
            total = len(scenes.verdicts)
            ax.set_title(f"{family}\n{total} scenes" if ax is axes[0, column] else f"{total} scenes")
            if not total:
                ax.text(
                    50, (len(names) - 1) / 2, "no such scene", ha="center", va="center", color=style.MUTED
                )
            ax.set_yticks(range(len(names)), names)
            ax.grid(axis="y", visible=False)
            ax.tick_params(axis="y", length=0)
    axes[0, 0].set_ylim(len(names) - 0.5, -0.5)
    axes[0, 0].set_xlim(-3, 103)
    axes[0, 0].set_xticks([0, 25, 50, 75, 100])
    axes[0, 0].set_ylabel("collisions [%]\nwhere an escape exists")
    axes[1, 0].set_ylabel("success [%]\nwhere the tip can be held")
    return fig


def clearance(evaluation: Table) -> Figure:
    """How large a share of the runs came nearer than this."""
    fig, axes = _row(evaluation)
    for ax, family in zip(axes, evaluation.families, strict=True):
        rows = evaluation.where(family=family).feasible
        _steps(ax, evaluation.controllers, rows, "min_clearance", 1e2)
        ax.axvline(0.0, color=style.INK, linewidth=0.6)
        ax.set_title(family)
        ax.set_xlim(*((-20, 30) if "arm" in evaluation.columns else (-40, 60)))
    axes[0].set_ylabel("share of runs below")
    fig.supxlabel("smallest clearance [cm], where an escape exists", fontsize=8)
    _key(fig, axes[0])
    return fig


def error(evaluation: Table) -> Figure:
    """How large a share of the runs had a smaller error during the encounter, and after it."""
    fig, axes = _row(evaluation, 2)
    for what, line in zip(("rms_error_during", "rms_error_after"), axes, strict=True):
        for ax, family in zip(line, evaluation.families, strict=True):
            rows = evaluation.where(family=family, diverged=False).feasible
            _steps(ax, evaluation.controllers, rows, what, 1e3)
            ax.set_xscale("log")
            ax.set_xlim(1e-4, 1e4)
            ax.set_xticks([1e-4, 1e-2, 1e0, 1e2, 1e4])
            ax.axvline(10.0, color=style.MUTED, linewidth=0.6, linestyle=(0, (4, 2)))
    for ax, family in zip(axes[0], evaluation.families, strict=True):
        ax.set_title(family)
    axes[0][0].set_ylabel("share of runs below,\nduring the encounter")
    axes[1][0].set_ylabel("share of runs below,\nafter it")
    fig.supxlabel("RMS error of the tip [mm], where an escape exists; dashed: 1 cm", fontsize=8)
    _key(fig, axes[0][0])
    return fig


def _row(evaluation: Table, lines: int = 1) -> tuple[Figure, Any]:
    fig = style.figure(0.8 + 1.5 * lines, style.PAGE)
    axes = fig.subplots(lines, len(evaluation.families), sharex=True, sharey=True, squeeze=False)
    axes[0, 0].set_ylim(0.0, 1.0)
    return fig, axes if lines > 1 else axes[0]


def _steps(ax: Axes, names: Sequence[str], rows: Table, column: str, factor: float) -> None:
    """The empirical distribution of a column for every controller."""
    for name, colour in zip(names, style.joint_colours(len(names)), strict=True):
        values = rows.where(controller=name).columns[column]
        values = np.sort(factor * values[np.isfinite(values)])
        share = np.arange(1, len(values) + 1) / max(len(values), 1)
        ax.step(values, share, where="post", color=colour, label=name, clip_on=True)


def _key(fig: Figure, ax: Axes) -> None:
    handles, labels = ax.get_legend_handles_labels()
    fig.legend(handles, labels, loc="outside upper center", ncols=len(labels))
