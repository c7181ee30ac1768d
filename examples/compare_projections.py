"""
Which projection keeps the tip still
====================================

The same push of the field through three projections. Only the dynamically consistent one, weighted by the
inertia, keeps all of it away from the tip (T4). The Moore-Penrose inverse does so for velocities, not for
torques: here the tip moves more than without any projection.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.plotting import style

COLOURS = {"dynamic": "#0072B2", "kinematic": "#E69F00", "none": "#B2182B"}

with style.look():
    fig, (upper, lower) = style.panels(2, 3.4, 5.0)
    for projection, colour in COLOURS.items():
        changes = {"controller.projection": projection, "simulation.control": "continuous"}
        result = vff.simulate("sweep-through", changes)
        arm = result.scenario.arm
        leak = [
            np.linalg.norm(arm.jacobian(q) @ np.linalg.solve(arm.mass_matrix(q), tau))
            for q, tau in zip(result.q[::20], result.tau_null[::20], strict=True)
        ]
        moved = np.linalg.norm(result.error, axis=1)
        upper.semilogy(result.t[::20], np.maximum(leak, 1e-16), color=colour, label=projection)
        lower.semilogy(result.t, np.maximum(moved, 1e-16), color=colour)
        print(f"{projection:10} tip moves by {moved.max():.1e} m")
    upper.set_ylabel("acceleration of the tip\nby the null part [m/s²]")
    lower.set_ylabel("distance of the tip\nfrom its place [m]")
    fig.legend(loc="outside upper center", ncols=3)
    fig.savefig("compare_projections.png")
