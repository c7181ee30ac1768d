"""Obstacle avoidance for redundant robot arms: virtual force fields in a dynamically consistent null space.

>>> import vffnull as vff
>>> result = vff.simulate("paper-1")
>>> print(result.status)
completed

The arm follows its task to rounding while its links give way to moving obstacles. `simulate` runs a whole
scenario, `simulate_many` a list of them on all cores, `realtime` one against the clock, `live` one on a page
to play with; `drive` drives a robot; `Controller` is the torque law alone, for somebody else's loop;
`Simulation` is the plant, for somebody else's controller. Units are SI, angles are radians, and arrays run
(time, joint).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vffnull import errors
from vffnull._core import (
    ENERGIES,
    OBJECTIVES,
    PORTS,
    Arm,
    Controller,
    Distances,
    ExtendedJacobian,
    Simulation,
    State,
    Terms,
    VirtualArm,
    __version__,
    distances,
)
from vffnull._many import metrics_table, simulate_many
from vffnull._simulate import simulate
from vffnull.control import ControlSettings, Field
from vffnull.errors import VffNullError
from vffnull.report import compare  # before `report` below, which takes the place of the package's name
from vffnull.result import Film, Metrics, Replan, Result, Status, report
from vffnull.scenario import Scenario, scenarios
from vffnull.world import Motion, Obstacle

if TYPE_CHECKING:
    from vffnull import arms, scenes
    from vffnull._drive import Drive, DriveReport, DriveState, drive
    from vffnull._realtime import RealTimeReport, realtime
    from vffnull._timing import Histogram
    from vffnull.evaluation import Evaluation, evaluate
    from vffnull.evaluation.planner import feasibility
    from vffnull.logs.stream import StreamRecorder
    from vffnull.planning import Plan, PlanStatus, plan
    from vffnull.studies import Study
    from vffnull.viewer import live

__all__ = [
    "ENERGIES",
    "OBJECTIVES",
    "PORTS",
    "Arm",
    "ControlSettings",
    "Controller",
    "Distances",
    "Drive",
    "DriveReport",
    "DriveState",
    "Evaluation",
    "ExtendedJacobian",
    "Field",
    "Film",
    "Histogram",
    "Metrics",
    "Motion",
    "Obstacle",
    "Plan",
    "PlanStatus",
    "RealTimeReport",
    "Replan",
    "Result",
    "Scenario",
    "Simulation",
    "State",
    "Status",
    "StreamRecorder",
    "Study",
    "Terms",
    "VffNullError",
    "VirtualArm",
    "__version__",
    "arms",
    "compare",
    "distances",
    "drive",
    "errors",
    "evaluate",
    "feasibility",
    "live",
    "metrics_table",
    "plan",
    "realtime",
    "report",
    "scenarios",
    "scenes",
    "simulate",
    "simulate_many",
]


# What brings NumPy along, or is not needed by most, is loaded when it is asked for.
_LATER = {
    "Drive": "vffnull._drive",
    "DriveReport": "vffnull._drive",
    "DriveState": "vffnull._drive",
    "Evaluation": "vffnull.evaluation",
    "Histogram": "vffnull._timing",
    "Plan": "vffnull.planning",
    "PlanStatus": "vffnull.planning",
    "RealTimeReport": "vffnull._realtime",
    "StreamRecorder": "vffnull.logs.stream",
    "Study": "vffnull.studies",
    "drive": "vffnull._drive",
    "evaluate": "vffnull.evaluation",
    "feasibility": "vffnull.evaluation.planner",
    "live": "vffnull.viewer",
    "plan": "vffnull.planning",
    "realtime": "vffnull._realtime",
}


def __getattr__(name: str) -> Any:
    """What is loaded when it is asked for."""
    import importlib

    if name in ("arms", "scenes"):
        return importlib.import_module(f"vffnull.{name}")
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, and nothing else."""
    return sorted(__all__)
