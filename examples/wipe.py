"""
Wipe a table
============

A Panda presses on a table with 10 N and goes round on it in circles, while a ball comes at its elbow. Nobody
has measured the table: the hand comes down at 2 cm/s until something resists, and holds the force from then
on. The elbow makes way for the ball in the null space, and neither the force nor the circle knows of it.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style
from vffnull.draw.primitives import COLOURS

result = vff.simulate("panda-wipe")
force = result.contact_force[:, 0, 2]  # N, of the table on the hand
estimate = result.wrench_estimate[:, 2]
sideways = 1e3 * np.linalg.norm(result.error[:, :2], axis=1)  # mm
late = result.t > result.t[np.argmax(force > 0.0)] + 0.5
off = np.abs(force - 10.0)[late].max()
print(f"within {off:.2f} N, and {sideways[late].max():.2f} mm of the circle")

with style.look():
    fig = style.figure(2.4, style.PAGE)
    left, middle, right = fig.subplots(1, 3)
    left.plot(result.t, force, color=COLOURS["wrench"], linewidth=3, label="table")
    left.plot(result.t, estimate, color=style.INK, linewidth=0.8, label="estimated")
    left.set_ylabel("force [N]")
    left.legend(loc="lower right")
    middle.plot(result.t, sideways, color="#0072B2")
    middle.set_ylabel("hand off the circle [mm]")
    right.plot(result.t, result.clearance[:, :-1].min(axis=1), color="#0072B2")
    right.axhline(0.0, color=style.INK, linewidth=0.6)
    right.set_ylabel("clearance of the other links [m]")
    for ax in (left, middle, right):
        ax.set_xlabel("time [s]")
    fig.savefig("wipe.png")
