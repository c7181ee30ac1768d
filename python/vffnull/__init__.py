"""Obstacle avoidance for redundant robot arms: virtual force fields in a dynamically consistent null space.

>>> import vffnull as vff
>>> result = vff.simulate("paper-1")
>>> print(result.status)
completed

The arm follows its task to rounding while its links give way to moving obstacles. `simulate` runs a whole
scenario; `Controller` is the torque law alone, for somebody else's loop; `Simulation` is the plant, for
somebody else's controller. Units are SI, angles are radians, and arrays run (time, joint).
"""

from __future__ import annotations

from vffnull import errors
from vffnull._core import (
    Arm,
    Controller,
    Distances,
    ExtendedJacobian,
    Simulation,
    State,
    Terms,
    __version__,
    distances,
)
from vffnull._simulate import simulate
from vffnull.control import ControlSettings, Field
from vffnull.errors import VffNullError
from vffnull.result import Metrics, Result, Status
from vffnull.scenario import Scenario, scenarios
from vffnull.world import Motion, Obstacle

__all__ = [
    "Arm",
    "ControlSettings",
    "Controller",
    "Distances",
    "ExtendedJacobian",
    "Field",
    "Metrics",
    "Motion",
    "Obstacle",
    "Result",
    "Scenario",
    "Simulation",
    "State",
    "Status",
    "Terms",
    "VffNullError",
    "__version__",
    "distances",
    "errors",
    "scenarios",
    "simulate",
]
