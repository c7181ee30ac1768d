"""Draw the README's figures into docs/figures: `python docs/make_figures.py`, with vffnull installed.

`sweep-through.png` compares three settings of one bundled scenario; `example.png` is what the README's
Python example plots, made by running that example.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

import vffnull as vff
from vffnull.plotting import geometry, strobe, style

DOCS = Path(__file__).resolve().parent
FIGURES = DOCS / "figures"

# What the three columns show, and what has to be changed in the scenario for it.
COLUMNS = [
    ("no avoidance", {"controller.field.gain": 0.0}),
    ("field, not projected", {"controller.projection": "none"}),
    ("field in the null space", {}),
]
TIMES = (0.0, 1.5, 3.0, 4.0)
LENS = 0.006  # half the width [m] of what the magnified view of the tip shows


def sweep_through() -> None:
    """The scenario's three outcomes side by side: where the arm goes, and how far its tip moves."""
    results = [vff.simulate("sweep-through", overrides=changes) for _, changes in COLUMNS]
    with style.look():
        fig = style.figure(2.3, style.PAGE)
        axes = fig.subplots(1, len(results), sharey=True)
        for ax, (title, _), result in zip(axes, COLUMNS, results, strict=True):
            passing(ax, result)
            tip(ax, result)
            ax.text(0.5, 1.15, title, transform=ax.transAxes, ha="center", fontsize=9, fontweight="bold")
            ax.text(0.5, 1.04, outcome(result), transform=ax.transAxes, ha="center", fontsize=8)
            ax.set_xlabel("$x$ [m]")
        axes[0].set_ylabel("$y$ [m]")
        fig.savefig(FIGURES / "sweep-through.png")


def passing(ax: Axes, result: vff.Result) -> None:
    """The arm and the disc at a few instants, early light and late dark."""
    colours = strobe.shades(len(TIMES))
    joints, radii = geometry.joints(result), geometry.link_radii(result)
    (outline,) = geometry.obstacle_outlines(result)
    for order, (t, colour) in enumerate(zip(TIMES, colours, strict=True)):
        row = int(np.searchsorted(result.t, t - 1e-9))
        disc = result.obstacles[row, 0]
        strobe.solid(ax, outline + disc, colour, zorder=1.5)
        strobe.draw_arm(ax, joints[row], radii, colour, zorder=3 + order)
        x, y = disc
        ax.annotate(f"{t:g} s", (x + 0.2, y + 0.16), color=colour, fontsize=7, va="center", zorder=9)
    ax.plot(0.0, 0.0, marker="s", markersize=6, color=style.INK, zorder=2.5)
    ax.set_xlim(-0.35, 5.45)
    ax.set_ylim(-0.35, 3.35)
    ax.set_aspect("equal")
    ax.set_xticks(range(6))
    ax.set_yticks(range(4))


def tip(ax: Axes, result: vff.Result) -> None:
    """The path of the tip through a magnifying glass, in millimetres."""
    target = result.x_ref[0]
    ax.add_patch(Circle(target, 0.16, fill=False, edgecolor=style.ALARM, linewidth=0.9, zorder=10))
    glass = ax.inset_axes((3.95, 1.68, 1.35, 1.35), transform=ax.transData, zorder=11)
    glass.plot(*(1e3 * (result.x - target)).T, color=style.ALARM, linewidth=1.3, solid_capstyle="round")
    glass.plot(0.0, 0.0, marker="x", markersize=5, color=style.INK, zorder=1)
    glass.plot(*(1e3 * (result.x[-1:] - target)).T, marker="o", markersize=3, color=style.ALARM)
    glass.set_xlim(-1e3 * LENS, 1e3 * LENS)
    glass.set_ylim(-1e3 * LENS, 1e3 * LENS)
    glass.set_xticks([-5, 0, 5])
    glass.set_yticks([-5, 0, 5])
    glass.tick_params(labelsize=5.5, length=1.5, pad=1.0, colors=style.ALARM)
    glass.tick_params(axis="x", labelbottom=False)
    for spine in glass.spines.values():
        spine.set_visible(True)
        spine.set_color(style.ALARM)
    glass.set_title("tip [mm]", fontsize=6.5, pad=2, color=style.ALARM)
    for side, edge in ((-0.16, 3.95), (0.16, 5.30)):
        ax.plot([target[0] + side, edge], [target[1], 1.68], color=style.ALARM, linewidth=0.5, zorder=2)


def outcome(result: vff.Result) -> str:
    """Clearance and tip motion in words."""
    clearance = result.metrics["min_clearance"]
    moved = float(np.linalg.norm(result.x - result.x[0], axis=1).max())
    factor, unit = style.prefixed(moved, "m")
    near = f"overlap {-clearance:.2f} m" if clearance < 0 else f"clearance {clearance:.2f} m"
    return f"{near}, tip moves {factor * moved:.2g} {unit}"


def example() -> None:
    """Run the README's first Python example and keep its overview."""
    readme = (DOCS.parent / "README.md").read_text(encoding="utf-8")
    code = re.search(r"```python\n(.*?)```", readme, re.DOTALL)
    if code is None:
        raise SystemExit("README.md has no Python example")
    before = Path.cwd()
    with tempfile.TemporaryDirectory() as directory:
        os.chdir(directory)
        try:
            exec(compile(code[1], "README.md", "exec"), {})
            shutil.copy(Path("figures") / "overview.png", FIGURES / "example.png")
        finally:
            os.chdir(before)


if __name__ == "__main__":
    FIGURES.mkdir(exist_ok=True)
    sweep_through()
    example()
