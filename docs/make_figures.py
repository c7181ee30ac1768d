"""Draw the documents' figures into docs/figures: `python docs/make_figures.py`, with vffnull installed.

`sweep-through.png` compares three settings of one bundled scenario, `on-path.png` the four answers to an
obstacle on the tip's own path; `scenes.png` shows bundled scenes and `random-scenes.png` random ones;
`example.png` is what the README's Python example plots, made by running it, `panda-sweep.png` and
`panda-shelf.png` the overviews of these scenarios. `plan-ghost.png` is a plan that is followed and replaced.
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
from vffnull.draw import replans, style
from vffnull.draw.figures import canvas, joints, strobe
from vffnull.draw.scene import Scene

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
    scene = Scene.of_result(result)
    for order, (t, colour) in enumerate(zip(TIMES, colours, strict=True)):
        row = int(np.searchsorted(result.t, t - 1e-9))
        canvas.paint(ax, scene.at(row, ["obstacle"]), colour=colour, zorder=1.5)
        canvas.paint(ax, scene.at(row, ["link", "joint"]), colour=colour, zorder=3 + order)
        x, y = result.obstacles[row, 0]
        ax.annotate(f"{t:g} s", (x + 0.2, y + 0.16), color=colour, fontsize=7, va="center", zorder=9)
    canvas.paint(ax, scene.at(0, ["base"]), zorder=2.5)
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


# The laws of `on-path.png`, their colours, and the instants of its strobe pictures [s].
LAWS = {"null_space": style.MUTED, "relaxed": "#E69F00", "priority": "#0072B2", "cbf": style.ALARM}
INSTANTS = (0.0, 1.5, 2.25, 3.0, 4.0, 5.5)


def on_path() -> None:
    """Four laws meet a disc on the tip's path: where the arm goes, how near it comes, what that costs."""
    results = {law: vff.simulate("on-path", overrides={"controller.avoidance": law}) for law in LAWS}
    with style.look():
        fig = style.figure(4.4, style.PAGE)
        above, below = fig.subfigures(2, 1, height_ratios=(2.3, 2.1))
        axes = above.subplots(1, len(results), sharey=True)
        for ax, (law, result) in zip(axes, results.items(), strict=True):
            around(ax, result, LAWS[law])
            clearance = result.metrics["min_clearance"]
            error = float(np.linalg.norm(result.error, axis=1).max())
            near = f"overlap {-clearance:.2f} m" if clearance < 0 else f"clearance {clearance:.2f} m"
            strays = f"tip strays {error:.2f} m" if error > 0.005 else "tip on its path"
            ax.set_title(f"{near}\n{strays}", fontsize=7.5, pad=4)
            ax.annotate(law, (0.5, 1.0), xycoords="axes fraction", xytext=(0, 28), textcoords="offset points",
                        ha="center", fontsize=9, fontweight="bold", color=LAWS[law])  # fmt: skip
            ax.set_xlabel("$x$ [m]")
        axes[0].set_ylabel("$y$ [m]")
        distance, error = below.subplots(1, 2)
        for law, result in results.items():
            how = {"color": LAWS[law], "linewidth": 1.3}
            distance.plot(result.t, result.clearance.min(axis=1), label=law, **how)
            # Below a nanometre there is nothing to see.
            error.semilogy(result.t, np.maximum(np.linalg.norm(result.error, axis=1), 1e-9), **how)
        distance.axhline(0.0, color=style.INK, linewidth=0.8)
        distance.set_ylim(-0.3, 0.8)
        distance.set_ylabel("smallest clearance [m]")
        error.set_ylim(1e-9, 10)
        error.set_yticks(10.0 ** np.arange(-9, 2, 3))
        error.axhline(1e-5, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
        error.text(0.1, 1.4e-5, "$10^{-5}$ m", fontsize=7, va="bottom")
        error.set_ylabel("tracking error [m]")
        for ax in (distance, error):
            ax.set_xlabel("time [s]")
            ax.axvline(5.0, color=style.MUTED, linewidth=0.6, linestyle=(0, (1, 2)))
        distance.text(5.08, -0.12, "reference at rest", fontsize=7, color=style.MUTED, va="center")
        below.legend(loc="outside upper center", ncols=len(results))
        fig.savefig(FIGURES / "on-path.png")


def around(ax: Axes, result: vff.Result, colour: str) -> None:
    """The arm at a few instants, early light and late dark, the disc, and the path of the tip."""
    scene = Scene.of_result(result)
    canvas.paint(ax, scene.at(0, ["obstacle"]), colour=style.INK, zorder=1.5)
    for order, (t, shade) in enumerate(zip(INSTANTS, strobe.shades(len(INSTANTS)), strict=True)):
        row = int(np.searchsorted(result.t, t - 1e-9))
        canvas.paint(ax, scene.at(row, ["link", "joint"]), colour=shade, zorder=3 + order)
    canvas.paint(ax, scene.at(0, ["reference"]), colour=style.INK, zorder=10)
    ax.plot(*result.x.T, color=colour, linewidth=1.6, zorder=11)
    canvas.paint(ax, scene.at(0, ["base"]), zorder=2.5)
    ax.set_xlim(-0.4, 4.2)
    ax.set_ylim(-1.4, 2.1)
    ax.set_aspect("equal")
    ax.set_xticks(range(5))
    ax.set_yticks(range(-1, 3))


# The scenes of `scenes.png`, and what is changed in them.
GALLERY: dict[str, dict[str, str]] = {
    "on-path": {"controller.avoidance": "cbf"},
    "on-path-moving": {"controller.avoidance": "cbf"},
    "crowd": {},
    "narrow-gap": {},
    "pincer": {},
    "chase": {},
}


def bundled() -> None:
    """Scenes side by side, each at five instants."""
    with style.look():
        fig = style.figure(5.0, style.PAGE)
        for ax, (name, changes) in zip(fig.subplots(2, 3).flat, GALLERY.items(), strict=True):
            result = vff.simulate(name, overrides=changes)
            law = changes.get("controller.avoidance", "null space")
            clearance = result.metrics["min_clearance"]
            instants(ax, result, 5)
            ax.set_title(f"{name}\n{law}, clearance {clearance:.2f} m", fontsize=7.5)
        fig.savefig(FIGURES / "scenes.png")


def random_scenes() -> None:
    """One scene of each family, at its start, and where its obstacles go."""
    with style.look():
        fig = style.figure(2.05, style.PAGE)
        for ax, family in zip(fig.subplots(1, 4), vff.scenes.FAMILIES, strict=True):
            result = vff.simulate(vff.scenes.random(family, 6, 3), {"controller.field.gain": 0.0})
            instants(ax, result, 1)
            ax.set_title(family)
        fig.savefig(FIGURES / "random-scenes.png")


def instants(ax: Axes, result: vff.Result, count: int) -> None:
    """The arm and the obstacles at a few instants, early light and late dark; the paths of all."""
    scene = Scene.of_result(result)
    rows = np.linspace(0, len(result.t) - 1, count).astype(int)
    strobe.draw(ax, scene, list(rows), strobe.shades(count) if count > 1 else [style.INK])
    canvas.paint(ax, scene.at(len(scene.t) - 1, ["reference", "target"]), colour=style.INK, zorder=10)
    ax.plot(*result.x.T, color=style.ALARM, linewidth=1.2, zorder=11)
    canvas.paint(ax, scene.at(0, ["base"]), zorder=2.5)
    low, high = scene.frame()
    half = float((high - low).max()) / 2
    (x, y) = (low + high) / 2
    ax.set_xlim(x - half, x + half)
    ax.set_ylim(y - half, y + half)
    ax.set_aspect("equal")
    ax.tick_params(labelsize=6)


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


def overviews() -> None:
    """The overviews of bundled scenarios."""
    for name in ("panda-sweep", "panda-shelf"):
        with tempfile.TemporaryDirectory() as directory:
            vff.simulate(name).plot(directory)
            shutil.copy(Path(directory) / "overview.png", FIGURES / f"{name}.png")


# Four links go over to the left, and a disc comes down into their way.
REPLANNED = {
    "name": "replanned",
    "duration": 7.0,
    "arm": {"lengths": [1.0] * 4, "masses": [1.0] * 4, "radius": 0.05},
    "q0": [0.2, 0.3, 0.3, 0.3],
    "reference": {
        "kind": "plan",
        "times": [0.0, 3.0, 6.0],
        "points": [[angle, 0.3, 0.3, 0.3] for angle in (0.2, 1.0, 1.8)],
    },
    "obstacles": [
        {
            "shape": {"kind": "circle", "radius": 0.2},
            "position": [0.4, 3.9],
            "motion": {"kind": "linear", "velocity": [0.0, -0.25]},
        }
    ],
    "controller": {
        "stiffness": 100.0,
        "damping": 20.0,
        "null_damping": 10.0,
        "posture_stiffness": 60.0,  # so soft that the arm leaves the plan to keep off the disc
        "avoidance": "cbf",
        "field": {"kind": "khatib", "gain": 1.0, "influence": 0.6},
    },
    "replan": {},
}


def plan_ghost() -> None:
    """The arm beside its plan, and the angles over time with the instant at which another plan came."""
    result = vff.simulate(vff.Scenario.from_dict(REPLANNED))
    with style.look():
        fig = style.figure(3.0, style.PAGE)
        picture, plot = fig.subfigures(1, 2, squeeze=False, wspace=0.03)[0]
        strobe.passing(picture.subplots(), result, height=2.8)
        axes = style.stacked(plot, 1)
        more = [*joints.angles(axes[0], result), *replans.mark(axes, result)]
        style.joint_key(plot, axes, result.q.shape[1], "joint", more)
        fig.savefig(FIGURES / "plan-ghost.png")


if __name__ == "__main__":
    FIGURES.mkdir(exist_ok=True)
    sweep_through()
    on_path()
    bundled()
    random_scenes()
    example()
    overviews()
    plan_ghost()
