"""
Hold a pose while a ball sweeps through the elbow
=================================================

A Panda holds position and orientation of its hand, and a ball comes along where its elbow is. Without a field
the ball goes through the links. With a field that is not projected they give way, and the hand with them. In
the null space, of one dimension here, the elbow gives way and the hand stays.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

SETTINGS = {
    "no field": ({"controller.field.gain": 0.0}, "#999999"),
    "field, not projected": ({"controller.projection": "none"}, style.ALARM),
    "field in the null space": ({}, "#0072B2"),
}

with style.look():
    fig = style.figure(2.4, style.PAGE)
    left, right = fig.subplots(1, 2)
    for label, (changes, colour) in SETTINGS.items():
        result = vff.simulate("panda-sweep", changes)
        moved = 1e3 * np.linalg.norm(result.x - result.x[0], axis=1)  # mm
        left.plot(result.t, result.clearance.min(axis=1), color=colour, label=label)
        right.plot(result.t, np.maximum(moved, 1e-5), color=colour)
        print(f"{label:24} clearance {result.metrics.min_clearance:6.3f} m, hand {moved.max():.3g} mm")
    left.axhline(0.0, color=style.INK, linewidth=0.6)
    left.set_ylabel("clearance [m]")
    right.set_ylabel("hand from its place [mm]")
    right.set_yscale("log")
    for ax in (left, right):
        ax.set_xlabel("time [s]")
    fig.legend(loc="outside upper center", ncols=3)
    fig.savefig("hold_pose.png")
