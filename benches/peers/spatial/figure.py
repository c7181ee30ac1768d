"""Rates with their intervals and the cost of a step, way by way."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import vffnull as vff
from peers.spatial.task import Array
from vffnull.draw import style

MARKS = ("o", "s", "^", "D")


def draw(outcome: vff.Evaluation, taken: dict[str, Array], path: Path) -> None:
    """Collisions by family; the hand back, and held throughout; what a step takes."""
    names = outcome.controllers
    colours = style.joint_colours(len(outcome.families))
    places = np.arange(len(names), dtype=float)
    with style.look():
        fig = style.figure(0.9 + 0.34 * len(names), style.PAGE)
        hit, held, cost = fig.subplots(1, 3, sharey=True, width_ratios=(1.2, 1.0, 0.9))
        for i, (family, colour) in enumerate(zip(outcome.families, colours, strict=True)):
            shift = 0.18 * (i - 0.5 * (len(outcome.families) - 1))
            for place, name in zip(places, names, strict=True):
                rows = outcome.where(family=family, controller=name).feasible
                interval(hit, rows.rate("collided"), place + shift, colour, MARKS[i], family)
        kinds = (
            ("returned", lambda rows: rows.feasible),
            ("success", lambda rows: rows.with_tip),
        )
        for i, (what, chosen) in enumerate(kinds):
            for place, name in zip(places, names, strict=True):
                rate = chosen(outcome.where(controller=name)).rate(what)
                label = ("back at the end", "held all along, where it can be")[i]
                interval(held, rate, place + 0.24 * (i - 0.5), (style.INK, style.MUTED)[i], MARKS[i], label)
        for place, name in zip(places, names, strict=True):
            low, high = 1e-3 * np.percentile(taken[name], (50.0, 99.9))
            cost.plot([low, high], [place, place], color=style.INK, linewidth=1.2)
            cost.plot(low, place, "o", color=style.INK, markersize=3.5)
        hit.set_yticks(places, names)
        hit.set_ylim(len(names) - 0.5, -0.5)
        for ax in (hit, held):
            ax.set_xlim(-3, 103)
        cost.set_xscale("log")
        ends = [np.percentile(each, (50.0, 99.9)) for each in taken.values()]
        cost.set_xlim(0.6e-3 * np.min(ends), 1.6e-3 * np.max(ends))
        hit.set_xlabel("collisions where an escape exists [%]")
        held.set_xlabel("hand [%]")
        cost.set_xlabel("step of control [µs],\nmedian to 99.9 %")
        for ax in (hit, held, cost):
            ax.grid(axis="y", visible=False)
            ax.tick_params(axis="y", length=0)
        for ax, columns in ((hit, 2), (held, 1)):
            handles, labels = ax.get_legend_handles_labels()
            first = dict(zip(labels[::-1], handles[::-1], strict=True))
            order = list(dict.fromkeys(labels))
            ax.legend(
                [first[each] for each in order],
                order,
                loc="lower center",
                bbox_to_anchor=(0.5, 1.0),
                ncols=columns,
            )
        fig.savefig(path)
    print(path.name)


def interval(ax: object, rate: object, place: float, colour: str, mark: str, label: str) -> None:
    """A rate as a mark on its interval."""
    if rate.total:
        ax.plot([100 * rate.low, 100 * rate.high], [place, place], color=colour, linewidth=1.2)
        ax.plot(
            100 * rate.value,
            place,
            mark,
            color=colour,
            markersize=3.0,
            clip_on=False,
            label=label,
            linestyle="none",
        )
