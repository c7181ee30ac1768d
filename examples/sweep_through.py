"""
Hold a point while a disc sweeps through
========================================

A disc falls through the place of the arm. Without a field it overlaps the links. With a field that is not
projected the arm gives way, and the tip with it. In the null space the arm gives way and the tip stays.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

SETTINGS = {
    "no field": ({"controller.field.gain": 0.0}, "#999999", 1.1),
    "field, not projected": ({"controller.projection": "none"}, style.ALARM, 2.6),
    "field in the null space": ({}, "#0072B2", 1.1),
}

with style.look():
    fig = style.figure(2.4, style.PAGE)
    left, right = fig.subplots(1, 2)
    for label, (changes, colour, width) in SETTINGS.items():
        result = vff.simulate("sweep-through", changes)
        moved = np.linalg.norm(result.x - result.x[0], axis=1)
        left.plot(result.t, result.clearance.min(axis=1), color=colour, linewidth=width, label=label)
        right.plot(result.t, np.maximum(1e3 * moved, 1e-5), color=colour, linewidth=width)
        print(f"{label:24} clearance {result.metrics.min_clearance:6.3f} m, tip {1e3 * moved.max():.3g} mm")
    left.axhline(0.0, color=style.INK, linewidth=0.6)
    left.set_ylabel("clearance [m]")
    right.set_ylabel("tip from its place [mm]")
    right.set_yscale("log")
    for ax in (left, right):
        ax.set_xlabel("time [s]")
    fig.legend(loc="outside upper center", ncols=3)
    fig.savefig("sweep_through.png")
