"""MuJoCo as the plant: our controller, their physics, contacts included.

The law, the distances and the field are the core's, asked through `vffnull.Controller`; the arm moves by
MuJoCo's dynamics and integrator, and an obstacle that reaches a link pushes it. The arm is the one of the
table ``[plant]``, friction and joint stops included; sensors and drives are ideal.
"""

from __future__ import annotations

from vffnull.engines.mujoco_plant import MuJoCoPlant, run

__all__ = ["MuJoCoPlant", "run"]
