"""
Give way with the hand where nothing else is left
=================================================

A pose takes all six joints of a UR5e: there is no null space, and a ball that crosses the way of its hand
goes through it. With barriers (``avoidance = "cbf"``) the task yields by as much as the ball needs, and the
hand is back on its line afterwards.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

RUNS = {"null_space": style.ALARM, "cbf": "#0072B2"}

with style.look():
    fig, (upper, lower) = style.panels(2, 3.2, 5.0)
    for avoidance, colour in RUNS.items():
        result = vff.simulate("ur5e-crossed", {"controller.avoidance": avoidance})
        off = np.linalg.norm(result.error[:, :3], axis=1)
        upper.plot(result.t, result.clearance.min(axis=1), color=colour, label=avoidance)
        lower.plot(result.t, off, color=colour)
        print(
            f"{avoidance:10} clearance {1e3 * result.metrics.min_clearance:+.0f} mm, "
            f"hand off by up to {1e3 * off.max():.3g} mm, at the end by {1e3 * off[-1]:.3g} mm"
        )
    upper.axhline(0.0, color=style.INK, linewidth=0.6)
    upper.set_ylim(None, 0.3)
    upper.set_ylabel("clearance [m]")
    lower.set_ylabel("hand off its line [m]")
    fig.legend(loc="outside upper center", ncols=2)
    fig.savefig("give_way.png")
