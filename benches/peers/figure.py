"""Cost of a step against the number of links, all peers on one log–log plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from peers.peer import Array, Peer
from vffnull.draw import style

GAP = 0.055  # least distance between two names, as a share of the height
OURS, *OTHERS = style.joint_colours(8)
DASHED = (0, (4, 2))


def draw(everybody: list[Peer], times: dict[str, dict[int, list[float]]], path: Path) -> None:
    """Ours in blue, others by name where their line ends, dashed where they do other work."""
    ours = everybody[0].name
    colours = dict(zip((peer.name for peer in everybody), [OURS, OURS, *OTHERS], strict=False))
    with style.look():
        fig = style.figure(3.7, 0.85 * style.PAGE)
        ax = fig.subplots()
        ax.set(
            xscale="log", yscale="log", xlabel="number of links", ylabel="one step of the closed loop [µs]"
        )
        ends = []
        for peer in everybody:
            n = np.array(list(times[peer.name]))
            runs = 1e6 * np.array([times[peer.name][k] for k in n])
            middle, colour = np.median(runs, axis=1), colours[peer.name]
            ax.fill_between(n, runs.min(axis=1), runs.max(axis=1), color=colour, alpha=0.2, linewidth=0)
            ax.plot(
                n,
                middle,
                color=colour,
                linestyle="-" if peer.same else DASHED,
                linewidth=2.2 if peer.name == ours else 1.1,
                marker="o",
                markersize=2.5,
            )
            ends.append((int(n[-1]), float(middle[-1]), peer.name.replace("`", ""), colour))
        sizes = np.array(list(times[ours]))
        ax.set_xticks(sizes, [str(n) for n in sizes])
        ax.minorticks_off()
        ax.set_xlim(sizes[0] * 0.93, sizes[-1] * 1.04)
        complete = [y for n, y, _, colour in ends if n == sizes[-1] and colour != OURS]
        guide(ax, sizes, ends[0][1], 1, "∝ $n$")
        if complete:
            guide(ax, sizes, min(complete), 3, "∝ $n^3$")
        note = "dashed: other work than ours\nband: from least to most"
        ax.text(0.02, 0.98, note, transform=ax.transAxes, va="top", color=style.MUTED, fontsize=7)
        names(ax, ends)
        fig.savefig(path)
    print(path.name)


def guide(ax: Axes, sizes: Array, end: float, power: int, text: str) -> None:
    """A dotted line of that growth, a little below a curve that ends there."""
    n = sizes[-3:]
    y = 0.4 * end * (n / n[-1]) ** float(power)
    ax.plot(n, y, color=style.MUTED, linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
    ax.annotate(
        text,
        (n[0], y[0]),
        xytext=(-4, 0),
        textcoords="offset points",
        ha="right",
        va="center",
        color=style.MUTED,
        fontsize=7.5,
    )


def names(ax: Axes, ends: list[tuple[int, float, str, str]]) -> None:
    """Names in the right margin, moved apart, each joined to the end of its line."""
    bottom, top = (np.log10(y) for y in ax.get_ylim())
    ax.set_ylim(ax.get_ylim())
    ends = sorted(ends, key=lambda end: end[1])
    wanted = np.array([(np.log10(y) - bottom) / (top - bottom) for _, y, _, _ in ends])
    heights = wanted.copy()
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + GAP)
    heights -= max(0.0, heights[-1] - 1.0)
    leader = {"arrowstyle": "-", "linewidth": 0.5, "linestyle": ":", "shrinkA": 1, "shrinkB": 2}
    for (n, y, name, colour), height in zip(ends, heights, strict=True):
        ax.annotate(
            name,
            (n, y),
            xytext=(1.03, height),
            textcoords="axes fraction",
            va="center",
            color=colour,
            fontsize=7,
            arrowprops=leader | {"color": colour},
            annotation_clip=False,
        )
