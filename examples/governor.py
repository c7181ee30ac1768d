"""
Resume a path where it was left
===============================

A disc lies on the tip's own path, and the tip has to go around it. Without a governor the reference runs on
meanwhile, and the tip jumps ahead to where it is by then. With one the reference waits, and the tip takes up
its path soon behind the disc.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

PATH = 3.2  # m, the tip's path runs straight up at this x
NEAR = 0.01  # m, within which the tip is on its path
RUNS = {"without a governor": {}, "with a governor": {"controller.governor": {}}}

with style.look():
    fig = style.figure(3.6, style.PAGE)
    panels = fig.subplots(2, 1, sharex=True, sharey=True)
    for ax, (label, changes) in zip(panels, RUNS.items(), strict=True):
        settings = {"controller.avoidance": "cbf", "simulation.control": "hold"}
        result = vff.simulate("on-path", settings | changes)
        x, y = result.x.T
        off = np.flatnonzero(np.abs(x - PATH) > NEAR)
        left, back = y[off[0]], y[off[-1]]
        print(f"{label:20} off its path from y = {left:.2f} m to {back:.2f} m")

        (disc,) = result.obstacles[0]
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        ax.fill(disc[1] + 0.25 * np.cos(angle), disc[0] + 0.25 * np.sin(angle), color="#cccccc")
        ax.axvspan(left, back, color=style.ALARM, alpha=0.12, linewidth=0.0, label="not followed")
        ax.axhline(PATH, color=style.INK, linewidth=0.6, label="path")
        ax.plot(y, x, color="#0072B2", label="tip")
        ax.plot(y[::100], x[::100], ".", color="#0072B2", markersize=5, label="tip, every 0.1 s")
        ax.set_title(f"{label}: {back - left:.2f} m of the path are not followed")
        ax.set_aspect("equal")
        ax.set_xlim(-0.6, 1.8)
        ax.set_ylabel("x [m]")
    panels[1].set_xlabel("y [m], along the path")
    fig.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=4)
    fig.savefig("governor.png")
