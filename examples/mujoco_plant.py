"""
MuJoCo as the plant
===================

The controller is the same, but MuJoCo moves the arm. With its integrator set as ours the two agree; they
are told apart by what happens in a contact: without a field the ball pushes the UR5e in MuJoCo, and
passes through it here. Needs ``pip install ".[mujoco]"``.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

CASES = {"with the field": {}, "without a field": {"controller.field.gain": 0.0}}

with style.look():
    fig = style.figure(2.5, style.PAGE)
    for ax, (title, changes) in zip(fig.subplots(1, 2, sharey=True), CASES.items(), strict=True):
        ours = vff.simulate("ur5e-sweep", changes)
        theirs = vff.simulate("ur5e-sweep", changes, plant="mujoco")
        apart = np.abs(ours.q - theirs.q).max()
        print(f"{title}: joint angles differ by at most {apart:.1e} rad")
        ax.plot(ours.t, ours.clearance.min(axis=1), color="#0072B2", linewidth=2.4, label="vffnull")
        ax.plot(
            theirs.t,
            theirs.clearance.min(axis=1),
            color="#E69F00",
            linestyle=(0, (4, 2)),
            label="MuJoCo",
        )
        ax.axhline(0.0, color=style.INK, linewidth=0.6)
        ax.text(0.5, 1.03, title, transform=ax.transAxes, ha="center", fontweight="bold")
        ax.set_xlabel("time [s]")
    fig.axes[0].set_ylabel("smallest clearance [m]")
    fig.axes[0].legend(loc="upper right")
    fig.savefig("mujoco_plant.png")
