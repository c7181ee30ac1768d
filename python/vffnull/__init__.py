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
    Perceiver,
    Simulation,
    State,
    Terms,
    VirtualArm,
    __version__,
    distances,
    surface_distances,
)
from vffnull._support.representation import drawn_by
from vffnull.errors import VffNullError
from vffnull.live import live  # at once: the function takes the place of the package's name
from vffnull.model.control import ControlSettings, Field
from vffnull.model.obstacle import Obstacle
from vffnull.model.scenario import Scenario, scenarios
from vffnull.run.result import Film, Metrics, Replan, Result, Status, report
from vffnull.run.simulate import simulate

if TYPE_CHECKING:
    from vffnull import arms
    from vffnull.arms import meshes as meshes
    from vffnull.draw.report import compare
    from vffnull.engines import export as export
    from vffnull.engines import gym as gym
    from vffnull.engines import mujoco_plant as mujoco_plant
    from vffnull.evaluation import scenes
    from vffnull.evaluation.planner import feasibility
    from vffnull.logs.stream import StreamRecorder
    from vffnull.model.body import Body
    from vffnull.model.motion import Motion
    from vffnull.model.timing import Histogram
    from vffnull.model.wrench import Wrench
    from vffnull.planning import Plan, PlanStatus, plan
    from vffnull.run.calibrate import CameraCalibration, calibrate
    from vffnull.run.drive import Drive, DriveReport, DriveState, drive
    from vffnull.run.evaluate import Evaluation, evaluate
    from vffnull.run.many import metrics_table, simulate_many
    from vffnull.run.perceive import CameraReport, PerceptionReport, TrackReport, perceive
    from vffnull.run.realtime import RealTimeReport, realtime
    from vffnull.studies import Study

__all__ = [
    "ENERGIES",
    "OBJECTIVES",
    "PORTS",
    "Arm",
    "Body",
    "CameraCalibration",
    "CameraReport",
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
    "Perceiver",
    "PerceptionReport",
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
    "TrackReport",
    "VffNullError",
    "VirtualArm",
    "Wrench",
    "__version__",
    "arms",
    "calibrate",
    "compare",
    "distances",
    "drive",
    "errors",
    "evaluate",
    "feasibility",
    "live",
    "metrics_table",
    "perceive",
    "plan",
    "realtime",
    "report",
    "scenarios",
    "scenes",
    "simulate",
    "simulate_many",
    "surface_distances",
]


# What brings NumPy along, or is not needed by most, is loaded when it is asked for.
_LATER = {
    "Body": "vffnull.model.body",
    "CameraCalibration": "vffnull.run.calibrate",
    "CameraReport": "vffnull.run.perceive",
    "Drive": "vffnull.run.drive",
    "DriveReport": "vffnull.run.drive",
    "DriveState": "vffnull.run.drive",
    "Evaluation": "vffnull.run.evaluate",
    "Histogram": "vffnull.model.timing",
    "Motion": "vffnull.model.motion",
    "PerceptionReport": "vffnull.run.perceive",
    "Plan": "vffnull.planning",
    "PlanStatus": "vffnull.planning",
    "RealTimeReport": "vffnull.run.realtime",
    "StreamRecorder": "vffnull.logs.stream",
    "Study": "vffnull.studies",
    "TrackReport": "vffnull.run.perceive",
    "Wrench": "vffnull.model.wrench",
    "calibrate": "vffnull.run.calibrate",
    "compare": "vffnull.draw.report",
    "drive": "vffnull.run.drive",
    "evaluate": "vffnull.run.evaluate",
    "feasibility": "vffnull.evaluation.planner",
    "metrics_table": "vffnull.run.many",
    "perceive": "vffnull.run.perceive",
    "plan": "vffnull.planning",
    "realtime": "vffnull.run.realtime",
    "simulate_many": "vffnull.run.many",
}
_MODULES = {
    "arms": "vffnull.arms",
    "export": "vffnull.engines.export",
    "gym": "vffnull.engines.gym",
    "meshes": "vffnull.arms.meshes",
    "mujoco_plant": "vffnull.engines.mujoco_plant",
    "scenes": "vffnull.evaluation.scenes",
}


@drawn_by
def _card(shown: Any) -> str:
    """What a notebook shows of an arm, a scenario or a result."""
    from vffnull.draw.notebook import card

    return card(shown)


def __getattr__(name: str) -> Any:
    """What is loaded when it is asked for."""
    import importlib

    if name in _MODULES:
        return importlib.import_module(_MODULES[name])
    if name in _LATER:
        return getattr(importlib.import_module(_LATER[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    """The public names, and nothing else."""
    return sorted(__all__)
