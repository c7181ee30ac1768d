"""MuJoCo as the plant: our controller, their physics, contacts included.

Everything but the plant is the core's: reference, governor, law, sensors, drives, record and metrics. The
arm moves by MuJoCo's dynamics and integrator, and an obstacle that reaches a link pushes it. The arm is the
one of the table ``[plant]``, friction and joint stops included.
"""

from __future__ import annotations

from vffnull.engines.mujoco_plant import MuJoCoPlant, run

__all__ = ["MuJoCoPlant", "run"]
