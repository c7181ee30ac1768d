"""
Something that nobody has seen
==============================

A Panda goes round in circles with its hand. A box that its controller does not know of comes at the elbow,
and later at the hand. Both are felt within two milliseconds. The elbow yields in the null space while the
hand goes on; the hand gives way along the push, stops, and comes back. Without the reaction the springs of
posture and task hold against the box.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style
from vffnull.draw.primitives import COLOURS

WAYS = {
    "springs hold": ({"controller.touch.reaction": None}, style.ALARM),
    "yields in order": ({}, "#0072B2"),
}

with style.look():
    fig = style.figure(2.4, style.PAGE)
    left, middle, right = fig.subplots(1, 3)
    for label, (changes, colour) in WAYS.items():
        result = vff.simulate("panda-bump", changes)
        force = np.linalg.norm(result.contact_force[:, 0], axis=1)  # N
        elbow = result.scenario.arm.link_poses(result.q)[:, 3, 1, 3]  # m
        hand = 1e3 * np.linalg.norm(result.error[:, :3], axis=1)  # mm
        left.plot(result.t, force, color=colour, label=label)
        middle.plot(result.t, 1e2 * (elbow - elbow[0]), color=colour)
        right.plot(result.t, hand, color=colour)
        most = force[result.t > 5.4].max()
        print(f"{label}: {most:.0f} N on the hand, {hand.max():.0f} mm off, {hand[-1]:.1f} mm at the end")
    felt = np.isfinite(result.touched_link)
    for ax in (left, middle, right):
        ax.fill_between(result.t, 0, 1, where=felt, transform=ax.get_xaxis_transform(),
                        color=COLOURS["wrench"], alpha=0.15, linewidth=0)  # fmt: skip
        ax.set_xlabel("time [s]")
    left.set_ylabel("force of the box [N]")
    middle.set_ylabel("elbow to the left [cm]")
    right.set_ylabel("hand off its reference [mm]")
    fig.legend(loc="outside upper center", ncols=2)
    fig.savefig("bump.png")
