"""
Follow a line between obstacles
===============================

The tip runs along a line from rest to rest. A disc falls from above and a crate stands at the end. The
links bend away from both, and the tip keeps to its line within micrometres.
"""

from __future__ import annotations

import vffnull as vff
from vffnull.draw import style
from vffnull.draw.figures import overview

scenario = vff.Scenario(
    arm=vff.Arm.uniform(7, length=0.8, mass=0.6, radius=0.03),
    q0=[1.3, -0.5, -0.5, -0.4, -0.1, 0.1, 0.3],
    duration=5.0,
    reference={"kind": "line", "end": [4.0, 2.2], "duration": 4.0},
    controller=vff.ControlSettings(
        stiffness=100, damping=20, null_damping=6, field=vff.Field.khatib(0.3, 0.6)
    ),
    obstacles=[
        vff.Obstacle.circle([1.9, 3.0], radius=0.2, motion=vff.Motion.linear([0.0, -0.45])),
        vff.Obstacle.box([3.4, 0.1], size=[0.7, 0.5], angle=0.3),
    ],
)
result = vff.simulate(scenario)
print(result.message)
print(f"largest tracking error {1e6 * result.metrics.max_error_transient:.1f} µm")
print(f"smallest clearance {result.metrics.min_clearance:.3f} m")
with style.look():
    overview.overview(result).savefig("follow_line.png")
