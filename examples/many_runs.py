"""
Many runs at once
=================

256 runs of a Panda on all cores: clearance against the gain and the influence distance of the field. Every
run has the same bits as if it had been made alone.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

gains = np.linspace(0.0, 150.0, 16)  # N
influences = np.linspace(0.05, 0.35, 16)  # m
changes = [
    {"controller.field": {"kind": "bounded", "gain": gain, "influence": influence}}
    for influence in influences
    for gain in gains
]
results = vff.simulate_many("panda-sweep", changes, record=False)
table = vff.metrics_table(results)
clearance = np.reshape(table["min_clearance"], (len(influences), len(gains)))
print(f"{len(results)} runs, {np.sum(clearance < 0)} with a collision")

with style.look():
    fig = style.figure(2.8, 4.6)
    ax = fig.subplots()
    picture = ax.pcolormesh(gains, influences, clearance, cmap="viridis", shading="gouraud", rasterized=True)
    lines = ax.contour(
        gains, influences, clearance, levels=[-0.05, 0.0, 0.05, 0.1], colors="white", linewidths=0.7
    )
    ax.clabel(lines, fmt="%g m", fontsize=6.5)
    ax.set_xlabel("gain [N]")
    ax.set_ylabel("influence distance [m]")
    ax.grid(False)
    fig.colorbar(picture, label="smallest clearance [m]")
    fig.savefig("many_runs.png")
