"""The plant of a scenario as a robot.

`SimulatedRobot` is compiled: `vffnull.drive` drives it without Python in the loop.
"""

from __future__ import annotations

from vffnull._core import SimulatedRobot

__all__ = ["SimulatedRobot"]
