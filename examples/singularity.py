"""
Through a singularity and back
==============================

The tip is sent out to the full stretch of a four-link arm, where it can move along the arm no more. The
task force is damped there (T25): torque and speed stay finite, the tip lags a little, and it is back on its
path afterwards.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from vffnull.draw import style

ray = np.array([np.cos(0.3), np.sin(0.3)])
result = vff.simulate(
    {
        "duration": 12.0,
        "q0": [1.2, -0.9, -0.6, -0.3],
        "arm": {"lengths": [1.0] * 4, "masses": 1.0},
        "controller": {"stiffness": 25.0, "damping": 10.0},
        "reference": {
            "kind": "lissajous",
            "center": 3.0 * ray,
            "amplitude": (1 - 1e-9) * ray,
            "angular_frequency": [1.0, 1.0],
            "phase": [-np.pi / 2, -np.pi / 2],
        },
    }
)
print(f"{result.metrics.singular_steps} damped steps, peak torque {result.metrics.peak_torque:.0f} N·m")

with style.look():
    fig, (reach, near, torque) = style.panels(3, 4.0, 5.0)
    reach.plot(result.t, np.linalg.norm(result.x_ref, axis=1), color=style.INK, linestyle=(0, (4, 2)))
    reach.plot(result.t, np.linalg.norm(result.x, axis=1), color="#0072B2")
    style.level(reach, 4.0, "full\nstretch")
    reach.set_ylabel("distance of the\ntip [m]")
    near.plot(result.t, result.manipulability, color="#009E73")
    near.set_ylabel("manipulability\n[m²]")
    style.joint_lines(torque, result.t, result.tau)
    torque.set_ylabel("joint torque\n[N·m]")
    fig.align_ylabels()
    fig.savefig("singularity.png")
