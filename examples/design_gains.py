"""
Gains for a given approach speed
================================

(T29) of the theory says how near a mass comes that meets the field with a given speed. Turned round, it is
a first choice of the gain. Here the disc comes at several speeds, each time with the gain that (T29) asks
for. The arm is no single mass: it comes nearer than wanted, by about the same share at every speed.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

INFLUENCE, WANTED, MASS = 0.6, 0.15, 1.0  # m, m, kg: one link
speeds = np.linspace(0.2, 3.0, 15)  # m/s
gains = MASS * (speeds / (1 / WANTED - 1 / INFLUENCE)) ** 2  # (T29), solved for η

changes = [
    {
        "controller.field.gain": gain,
        "controller.field.influence": INFLUENCE,
        "obstacles.0.motion.velocity": [0.0, -speed],
        "duration": round(1.4 / speed, 2),  # the same path for all
        "simulation.dt": 2.5e-4,
    }
    for gain, speed in zip(gains, speeds, strict=True)
]
results = vff.simulate_many("sweep-through", changes)
reached = np.array([result.metrics.min_clearance for result in results])

with style.look():
    fig = style.figure(2.4, style.PAGE)
    left, right = fig.subplots(1, 2)
    left.plot(speeds, gains, color="#0072B2", marker="o", markersize=3)
    left.set_ylabel("gain by (T29) [N·m³]")
    right.plot(speeds, reached, color="#009E73", marker="o", markersize=3, label="simulated")
    style.level(right, WANTED, "wanted")
    right.set_ylim(0.0, 0.2)
    right.set_ylabel("smallest clearance [m]")
    for ax in (left, right):
        ax.set_xlabel("speed of the disc [m/s]")
    fig.savefig("design_gains.png")
