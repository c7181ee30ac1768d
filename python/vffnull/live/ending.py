"""The end of a scene that is merely watched."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from vffnull.model.scenario import Scenario


class Ending:
    """Where a run pauses that nobody has meddled with: at the end of its scenario, once.

    Only where something goes away for ever, of which the scenario says nothing beyond its end. What rests or
    repeats itself goes on, and so does what somebody drags.
    """

    def __init__(self) -> None:
        self._due = math.inf
        self.at: float | None = None
        """When the run has reached its end [s]; None unless it waits there."""

    def begin(self, scenario: Scenario) -> None:
        """A run of this scenario begins."""
        self._due = scenario.duration if has_end(scenario.to_dict()) else math.inf
        self.at = None

    def comes(self, t: float) -> bool:
        """Whether the run has just reached its end at this time [s]."""
        if t < self._due:
            return False
        self.at, self._due = self._due, math.inf
        return True

    def go_on(self) -> None:
        """The run goes on beyond its end."""
        self.at = None

    def drop(self) -> bool:
        """Somebody plays with the run: it has no end any longer. Whether it waited there."""
        waited, self.at, self._due = self.at is not None, None, math.inf
        return waited


def has_end(document: Mapping[str, Any]) -> bool:
    """Whether the reference or an obstacle of a scenario goes away for ever."""
    reference = document["reference"]
    if reference["kind"] == "polynomial" and any(np.any(axis[1:]) for axis in reference["coefficients"]):
        return True
    motions = [each.get("motion") or {} for each in document.get("obstacles", ())]
    return any(each.get("kind") == "linear" and np.any(each["velocity"]) for each in motions)
