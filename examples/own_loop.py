"""
The controller in a loop of your own
====================================

`Controller` is the torque law alone, `Simulation` the plant alone. Here they meet in a loop that anything
may be put into: the target jumps by hand every 1.5 s while a disc passes.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.plotting import style

scenario = vff.Scenario.load("sweep-through").replace(duration=6.0)
disc = scenario["obstacles.0"]
period = scenario["simulation.dt"]
controller = vff.Controller(scenario.arm, scenario["controller"], period=period)
plant = vff.Simulation(scenario)
targets = np.array([[5.0, 1.0], [4.6, 1.6], [4.2, 0.6], [5.0, 1.0]])

rows = []
state = plant.state
while not plant.done:
    target = targets[int(state.t / 1.5) % len(targets)]
    tau = controller.torque(state.q, state.dq, target, obstacles=[disc], t=state.t)
    state = plant.step(tau)
    rows.append((state.t, *state.x, *target, state.clearance.min()))
t, x, y, x_ref, y_ref, clearance = np.array(rows).T
print(f"{plant.status}: {len(rows)} steps, smallest clearance {clearance.min():.3f} m")

with style.look():
    fig, (upper, lower) = style.panels(2, 3.0, 5.0)
    for value, wanted, name, colour in ((x, x_ref, "x", "#0072B2"), (y, y_ref, "y", "#D55E00")):
        upper.plot(t, wanted, color=style.INK, linewidth=0.8, linestyle=(0, (4, 2)))
        upper.plot(t, value, color=colour, label=f"${name}$")
    upper.set_ylabel("tip and target [m]")
    upper.legend(ncols=2, loc="center right")
    lower.plot(t, clearance, color="#009E73")
    lower.set_ylim(0.0, None)
    lower.set_ylabel("clearance [m]")
    fig.savefig("own_loop.png")
