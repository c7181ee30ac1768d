"""
Plan a motion, follow it, and react
===================================

From the compartment of a shelf that holds the hand of a Panda to the next one, the way first leads away from
the goal. `plan` finds it from the places of the obstacles at the start; the law follows the plan and gives
way to a ball that comes along meanwhile.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

scenario = vff.Scenario.load("panda-shelf")
plan = vff.plan(scenario, horizon=0, margin=0.03)  # takes the ball that comes along for standing still
print(f"{plan.status}: a motion of {plan.reference['times'][-1]:.1f} s")

result = vff.simulate(scenario.replace(reference=plan.reference))
print(result.message)
print(f"smallest clearance {1e3 * result.metrics.min_clearance:.0f} mm")

with style.look():
    fig, (upper, lower) = style.panels(2, 3.2, 5.0)
    upper.plot(result.t, np.linalg.norm(result.error[:, :3], axis=1), color="#0072B2")
    upper.set_ylabel("hand off\nthe plan [m]")
    lower.plot(result.t, result.clearance.min(axis=1), color="#009E73")
    lower.axhline(0.0, color=style.INK, linewidth=0.6)
    lower.set_ylabel("clearance [m]")
    fig.align_ylabels()
    fig.savefig("plan_and_react.png")
