"""What the core hands back of a run, as a result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vffnull import _core
from vffnull._record import Layout
from vffnull.result import Metrics, Replan, Result, Status
from vffnull.scenario import Scenario

__all__ = ["result_of"]


def result_of(scenario: Scenario, outcome: Mapping[str, Any], plant: str = "core") -> Result:
    """What the core hands back, as a result."""
    from vffnull._oddities import oddities

    return Result(
        scenario=scenario,
        status=Status(outcome["status"]),
        message=outcome["message"],
        end_time=outcome["end_time"],
        wall_time=outcome["wall_time"],
        warnings=(*outcome["warnings"], *oddities(scenario._document)),
        metrics=Metrics(outcome["metrics"], Layout.of(scenario._document)),
        version=_core.__version__,
        replans=tuple(Replan(**search) for search in outcome["replans"]),
        plant=plant,
        **outcome["record"],
    )
