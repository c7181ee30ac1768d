"""
The controller in a loop of your own
====================================

`Controller` is the torque law alone, `Simulation` the plant alone. Here they meet in a loop that anything
may be put into: the target of a Panda's hand jumps every 1.5 s while a ball passes its elbow.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

scenario = vff.Scenario.load("panda-sweep").replace(**{"controller.task": "position"})
ball = scenario["obstacles.0"]
controller = vff.Controller(scenario.arm, scenario["controller"], period=scenario["simulation.dt"])
plant = vff.Simulation(scenario)
home = plant.state.x
jumps = np.array([[0.0, 0.0, 0.0], [0.0, 0.1, 0.05], [0.05, -0.1, 0.0], [0.0, 0.0, 0.0]])  # m

rows = []
state = plant.state
while not plant.done:
    target = home + jumps[int(state.t / 1.5) % len(jumps)]
    tau = controller.torque(state.q, state.dq, target, obstacles=[ball], t=state.t)
    state = plant.step(tau)
    rows.append((state.t, *state.x, *target, state.clearance.min()))
t, clearance = np.array(rows)[:, 0], np.array(rows)[:, -1]
hand, wanted = np.array(rows)[:, 1:4].T, np.array(rows)[:, 4:7].T
print(f"{plant.status}: {len(rows)} steps, smallest clearance {clearance.min():.3f} m")

with style.look():
    fig, (upper, lower) = style.panels(2, 3.0, 5.0)
    for value, goal, name, colour in zip(hand, wanted, "xyz", style.joint_colours(3), strict=True):
        upper.plot(t, goal, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
        upper.plot(t, value, color=colour, label=f"${name}$")
    upper.set_ylabel("hand and target [m]")
    upper.legend(ncols=3, loc="center right")
    lower.plot(t, clearance, color="#009E73")
    lower.set_ylim(0.0, None)
    lower.set_ylabel("clearance [m]")
    fig.savefig("own_loop.png")
