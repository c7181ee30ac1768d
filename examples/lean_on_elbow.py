"""
Somebody leans on the elbow
===========================

A Panda holds the pose of its hand, and somebody leans on its elbow, from the right with 20 N and then from
the left with 30 N. The elbow gives in, as the impedance of the null space has it. What is let through to the
hand is estimated from the momentum of the arm, and rejected.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style
from vffnull.draw.primitives import COLOURS

ANSWERS = {"comply": style.ALARM, "reject": "#0072B2"}

with style.look():
    fig = style.figure(2.4, style.PAGE)
    left, middle, right = fig.subplots(1, 3)
    for answer, colour in ANSWERS.items():
        result = vff.simulate("panda-lean", {"controller.touch.task": answer})
        elbow = result.scenario.arm.link_poses(result.q)[:, 3, 1, 3]
        hand = 1e6 * np.linalg.norm(result.error[:, :3], axis=1)  # µm
        middle.plot(result.t, 1e2 * (elbow - elbow[0]), color=colour)
        right.plot(result.t, np.maximum(hand, 1e-2), color=colour, label=f"the hand is to {answer}")
        print(f"{answer}: elbow {1e2 * np.abs(elbow - elbow[0]).max():.0f} cm, hand {hand.max():.0f} µm")
    joint = 0  # which the push turns most
    left.plot(result.t, result.tau_ext[:, joint], color=COLOURS["wrench"], linewidth=3, label="pushed")
    left.plot(result.t, result.tau_ext_estimate[:, joint], color=style.INK, linewidth=0.8, label="estimated")
    left.set_ylabel("torque from outside, joint 0 [N·m]")
    middle.set_ylabel("elbow to the left [cm]")
    right.set_ylabel("hand from its place [µm]")
    right.set_yscale("log")
    for ax in (left, middle, right):
        ax.set_xlabel("time [s]")
    fig.legend(loc="outside upper center", ncols=4)
    fig.savefig("lean_on_elbow.png")
