"""
Where the energy goes
=====================

Energy enters the null space only through the motion of the obstacles and of the task, and leaves it through
the null damping (T17). Every run records these powers, here those of an iiwa. Integrated, they account for
what the null space stores.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

EXACT = {"simulation.control": "continuous", "simulation.integrator": "rk4", "simulation.record_every": 1}
result = vff.simulate("iiwa-line", EXACT)
step = np.diff(result.t)[:, None]
work = np.vstack([0 * result.power[:1], np.cumsum(step * (result.power[1:] + result.power[:-1]) / 2, axis=0)])
stored = result.energy[:, vff.ENERGIES.index("null_storage")]
balance = stored[0] + work[:, 1:].sum(axis=1)  # all ports but the motors'
print(f"largest gap of the balance {np.abs(balance - stored).max():.1e} J")

with style.look():
    fig = style.figure(2.8, 5.0)
    ax = fig.subplots()
    for name, colour in (("obstacles", "#D55E00"), ("damping", "#009E73")):
        ax.plot(result.t, work[:, vff.PORTS.index(name)], color=colour, label=f"work of the {name}")
    ax.plot(result.t, stored, color="#0072B2", linewidth=2.4, label="stored in the null space")
    ax.plot(result.t, balance, color=style.INK, linestyle=(0, (4, 2)), label="initial + all works")
    ax.axhline(0.0, color=style.INK, linewidth=0.6)
    ax.set_xlabel("time [s]")
    ax.set_ylabel("energy [J]")
    ax.legend(loc="upper left")
    fig.savefig("energy.png")
