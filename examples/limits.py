"""
What torque limits take away
============================

The motors are allowed ever less torque. The controller gives its objectives up one after the other, each
down to nothing before the next is touched: posture, task, damping, avoidance, compensation. The step of
this scenario takes longer then, and the tip still arrives.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

LIMITS = (800.0, 200.0, 100.0, 50.0)  # N·m
SHARES = {"task": 1, "damping": 2}  # places in vff.OBJECTIVES

with style.look():
    fig = style.figure(2.6, style.PAGE)
    left, right = fig.subplots(1, 2)
    for limit, colour in zip(LIMITS, style.joint_colours(len(LIMITS)), strict=True):
        result = vff.simulate("paper-1", {"arm.torque_limits": limit, "duration": 3.0})
        left.plot(result.t, np.linalg.norm(result.error, axis=1), color=colour, label=f"{limit:g} N·m")
        right.plot(result.t, result.objective_scale[:, SHARES["task"]], color=colour)
        least = result.objective_scale.min(axis=0)
        lost = [name for name, share in zip(vff.OBJECTIVES, least, strict=True) if share < 1]
        print(
            f"{limit:5g} N·m: took from {', '.join(lost) or 'nothing'}, {result.metrics.limited_steps} steps"
        )
    left.set_ylabel("tracking error [m]")
    right.set_ylabel("share of the task that was granted")
    for ax in (left, right):
        ax.set_xlabel("time [s]")
    fig.legend(title="torque limit", loc="outside right center")
    fig.savefig("limits.png")
