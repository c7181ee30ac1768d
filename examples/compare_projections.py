"""
Which projection keeps the hand still
=====================================

The same push of the field on a Panda through three projections. Only the dynamically consistent one, weighted
by the inertia, keeps all of it away from the hand (T4). The Moore-Penrose inverse does so for velocities, not
for torques: some of the push reaches the hand.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

EXACT = {"simulation.control": "continuous", "simulation.integrator": "rk4"}
COLOURS = {"dynamic": "#0072B2", "kinematic": "#E69F00", "none": "#B2182B"}

with style.look():
    fig, (upper, lower) = style.panels(2, 3.4, 5.0)
    for projection, colour in COLOURS.items():
        result = vff.simulate("panda-sweep", {"controller.projection": projection} | EXACT)
        arm = result.scenario.arm
        leak = [
            np.linalg.norm((arm.jacobian(q) @ np.linalg.solve(arm.mass_matrix(q), tau))[:3])
            for q, tau in zip(result.q, result.tau_null, strict=True)
        ]
        moved = np.linalg.norm(result.x - result.x[0], axis=1)
        upper.semilogy(result.t, np.maximum(leak, 1e-16), color=colour, label=projection)
        lower.semilogy(result.t, np.maximum(moved, 1e-16), color=colour)
        print(f"{projection:10} hand moves by {moved.max():.1e} m")
    upper.set_ylabel("acceleration of the hand\nby the null part [m/s²]")
    lower.set_ylabel("distance of the hand\nfrom its place [m]")
    fig.legend(loc="outside upper center", ncols=3)
    fig.savefig("compare_projections.png")
