"""What the page shows with one click: a scenario, what is changed in it, and what to look at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from vffnull.scenario import Scenario


@dataclass(frozen=True)
class Story:
    """A scenario to begin with."""

    scenario: str
    look: str
    """What to look at, in a sentence or two."""
    changes: Mapping[str, Any] = field(default_factory=dict)
    """Other values for some keys, by dotted name."""

    def open(self) -> Scenario:
        """The scenario with the changes."""
        return Scenario.load(self.scenario).replace(**self.changes)


STORIES: dict[str, Story] = {
    "Sweep": Story(
        "swing",
        "A disc swings through the arm, whose tip must stay on its target. The links give way. The pale arm "
        "is the same one without the null-space projection.",
    ),
    "Elbow": Story(
        "panda-sweep",
        "A ball swings through the elbow of a Panda, which turns aside; its hand stays as it is. Drag the "
        "ball into the elbow yourself, then switch the projection off.",
        {
            "obstacles.0.position": [-0.05, 0.0, 0.62],
            "obstacles.0.motion": {
                "kind": "sinusoid",
                "amplitude": [0.0, -0.55, 0.0],
                "angular_frequency": 0.6,
                "phase": 1.5708,
            },
        },
    ),
    "On path": Story(
        "on-path",
        "A disc lies on the tip's own path, where no null space helps. Barriers let the tip go around it.",
        {"controller.avoidance": "cbf"},
    ),
    "Crowd": Story(
        "crowd",
        "Eight discs drift through the reach of the arm. Barriers with look-ahead leave the path early where "
        "they must.",
        {"controller.avoidance": "cbf", "controller.yielding.preview": {}},
    ),
}
