"""
Look ahead, and leave a trap in time
====================================

Three balls close in on an iiwa from three sides. Avoidance that reacts to what is near goes where there is
room now, and is caught there. With ``yielding.preview`` the controller follows its own motion ahead by
moments, and turns to another one before the way out closes.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

RUNS = {
    "reacts": ({"controller.yielding.preview": None}, style.ALARM),
    "looks ahead": ({}, "#0072B2"),
}

with style.look():
    fig, (upper, lower) = style.panels(2, 3.2, 5.0)
    for label, (changes, colour) in RUNS.items():
        result = vff.simulate("iiwa-crowd", changes)
        upper.plot(result.t, result.clearance.min(axis=1), color=colour, label=label)
        lower.plot(result.t, np.linalg.norm(result.error, axis=1), color=colour)
        print(f"{label:12} smallest clearance {1e3 * result.metrics.min_clearance:+.0f} mm")
    upper.axhline(0.0, color=style.INK, linewidth=0.6)
    upper.set_ylim(None, 0.2)
    upper.set_ylabel("clearance [m]")
    lower.set_ylabel("hand from its place [m]")
    fig.legend(loc="outside upper center", ncols=2)
    fig.savefig("look_ahead.png")
