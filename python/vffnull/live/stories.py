"""What the page shows with one click: a scenario, what is changed in it, and what to look at."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from vffnull.model.scenario import Scenario


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


_QUARTER = 1.5707963267948966  # rad
_IN_THE_SHELF = [0.45, 0.2, 0.0, -2.0, 0.0, 2.2, 1.2]
"""A Panda that holds a cup upright between two boards [rad]."""


def _ball(center: list[float], amplitude: list[float], frequency: float, phase: float) -> dict[str, Any]:
    """A ball that swings about a centre [m]."""
    return {
        "shape": {"kind": "sphere", "radius": 0.06},
        "position": center,
        "motion": {
            "kind": "sinusoid",
            "amplitude": amplitude,
            "angular_frequency": frequency,
            "phase": phase,
        },
    }


def _board(center: list[float], size: list[float]) -> dict[str, Any]:
    """A board that stands straight [m]."""
    return {"shape": {"kind": "box", "size": size}, "position": center}


def _to_and_fro(center: list[float], amplitude: list[float], frequency: float) -> dict[str, Any]:
    """A hand that goes to and fro about a centre relative to where it is [m], from rest."""
    return {
        "kind": "lissajous",
        "center": center,
        "amplitude": amplitude,
        "angular_frequency": [0.0, frequency, 0.0],
        "phase": [0.0, _QUARTER, 0.0],
        "relative": True,
    }


IN_THE_PLANE: dict[str, Story] = {
    "Sweep": Story(
        "swing",
        "A disc swings through the arm, whose tip must stay on its target. The links give way. The pale arm "
        "is the same one without the null-space projection.",
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

IN_SPACE: dict[str, Story] = {
    "Elbow": Story(
        "panda-sweep",
        "A ball swings through the elbow of a Panda. The elbow turns aside, the hand stays as it is. Drag "
        "the ball into the elbow yourself; then switch the projection off and watch the cup.",
        {"obstacles": [_ball([-0.05, 0.0, 0.62], [0.0, -0.55, 0.0], 0.6, _QUARTER)]},
    ),
    "Cup": Story(
        "panda-cup",
        "The hand carries a cup to and fro and may only turn about the vertical, while a ball swings through "
        "the elbow. The liquid stays level.",
        {
            "obstacles": [_ball([-0.1, 0.0, 0.7], [0.0, -0.6, 0.0], 0.5, _QUARTER)],
            "reference": _to_and_fro([0.0, -0.15, 0.0], [0.0, 0.15, 0.0], 0.5),
        },
    ),
    "Touch": Story(
        "panda-lean",
        "Drag a link: a spring pulls at it. Pull the elbow, and it gives in while the hand stays where it "
        "is: the force is estimated, and rejected at the hand alone. Pull the hand, and it resists.",
        {"wrenches": None},
    ),
    "Bump": Story(
        "panda-bump",
        "The controller is not told of the pale box. It bumps into the elbow, which yields while the hand "
        "goes on with its circle. Drag the box into the hand: that gives way, stops, and catches up when it "
        "has gone.",
        {
            "obstacles.0.position": [-0.19, 0.34, 0.62],
            "obstacles.0.motion": {
                "kind": "sinusoid",
                "amplitude": [0.0, 0.16, 0.0],
                "angular_frequency": 0.6,
                "phase": _QUARTER,
            },
        },
    ),
    "Pointer": Story(
        "panda-pointing",
        "The tool draws circles and keeps its direction, while a bar swings through the forearm.",
    ),
}

GIVING_WAY: dict[str, Story] = {
    "Around": Story(
        "panda-cup",
        "A ball hangs where the cup has to pass. Barriers let the hand go around it and come back; nothing "
        "is spilt.",
        {
            "obstacles": [{"shape": {"kind": "sphere", "radius": 0.06}, "position": [0.42, -0.25, 0.5]}],
            "reference": _to_and_fro([0.05, -0.25, 0.0], [0.0, 0.25, 0.0], 0.6),
            "controller.avoidance": "cbf",
            "controller.yielding.task_weight": 300.0,
        },
    ),
    "Shelf": Story(
        "panda-cup",
        "The cup goes from one side of a shelf to the other; its path cuts through the board between them. "
        "Barriers lead the hand around the board's edge with 2 cm to spare, and nothing is spilt.",
        {
            "q0": _IN_THE_SHELF,
            "controller.posture": _IN_THE_SHELF,
            "obstacles": [
                _board([0.70, 0.0, 0.13], [0.36, 0.9, 0.03]),
                _board([0.70, 0.0, 0.63], [0.36, 0.9, 0.03]),
                _board([0.70, 0.0, 0.38], [0.36, 0.03, 0.47]),
            ],
            "reference": {
                "kind": "lissajous",
                "center": [-0.04, -0.257, 0.0],
                "amplitude": [0.04, 0.257, 0.0],
                "angular_frequency": [1.2, 0.6, 0.0],
                "phase": [_QUARTER, _QUARTER, 0.0],
                "relative": True,
            },
            "controller.field.gain": 60.0,
            "controller.field.influence": 0.1,
            "controller.avoidance": "cbf",
            "controller.yielding.task_weight": 300.0,
        },
    ),
    "Swivel": Story(
        "panda-sweep",
        "The picture on the left shows where the elbow can swivel, from now to 3 s ahead: red is contact, "
        "the line is the way that is followed. Drag the ball at the elbow, and watch the way change before "
        "the ball is there.",
        {
            "obstacles": [_ball([-0.05, 0.0, 0.62], [0.0, -0.55, 0.0], 0.6, _QUARTER)],
            "controller.avoidance": "cbf",
            "controller.yielding.preview": {"self_motion": {}},
        },
    ),
    "Swarm": Story(
        "panda-cup",
        "Three balls swing through elbow, forearm and hand. Barriers with look-ahead keep 2 cm to each of "
        "them, and the cup where it is as well as can be.",
        {
            "obstacles": [
                _ball([-0.1, 0.0, 0.66], [0.0, -0.6, 0.0], 0.5, _QUARTER),
                _ball([0.15, 0.0, 0.95], [0.0, 0.6, 0.0], 0.4, _QUARTER),
                _ball([0.45, 0.0, 0.75], [0.0, 0.5, 0.05], 0.45, -_QUARTER),
            ],
            "reference": {"kind": "setpoint"},
            "controller.avoidance": "cbf",
            "controller.yielding.task_weight": 300.0,
            "controller.yielding.preview": {},
        },
    ),
}

STORIES = IN_THE_PLANE | IN_SPACE | GIVING_WAY
