"""The spheres that the authors of OSCBF put on a Panda: centres in the links' frames and radii [m].

Numbers of ``oscbf/core/franka_collision_model.py`` in github.com/StanfordASL/oscbf (6082329, MIT), which they
chose by hand. The base has none.
"""

from __future__ import annotations

ARMS = ("panda",)  # they have placed spheres on no other
SPHERES = {
    "panda_link1": [((0.0, 0.0, -0.15), 0.06), ((0.0, -0.065, 0.0), 0.06)],
    "panda_link2": [((0.0, 0.0, 0.065), 0.06), ((0.0, -0.14, 0.0), 0.06)],
    "panda_link3": [((0.0, 0.0, -0.065), 0.06), ((0.08, 0.065, 0.0), 0.055)],
    "panda_link4": [((0.0, 0.0, 0.065), 0.055), ((-0.08, 0.08, 0.0), 0.055)],
    "panda_link5": [
        ((0.0, 0.0, -0.23), 0.06),
        ((0.0, 0.06, -0.18), 0.04),
        ((0.0, 0.08, -0.125), 0.025),
        ((0.0, 0.09, -0.075), 0.025),
        ((0.0, 0.08, 0.0), 0.055),
    ],
    "panda_link6": [((0.0, 0.0, 0.01), 0.05), ((0.08, 0.035, 0.0), 0.05)],
    "panda_link7": [
        ((0.0, 0.0, 0.08), 0.05),
        ((0.04, 0.04, 0.09), 0.04),
        ((0.055, 0.055, 0.15), 0.03),
        ((-0.055, -0.055, 0.15), 0.03),
        ((-0.055, -0.055, 0.11), 0.03),
        ((0.0, 0.0, 0.20), 0.02),
    ],
}
