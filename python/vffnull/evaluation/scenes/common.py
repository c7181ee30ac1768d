"""What random scenes in the plane and in space have in common: families, seeds, numbers, motions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "EVALUATION",
    "FAMILIES",
    "TRAINING",
    "Array",
    "Document",
    "Draw",
    "Travel",
    "push",
    "rounded",
]

Array = NDArray[np.float64]
Document = dict[str, Any]

FAMILIES = ("links-swept", "path-crossed", "clutter", "crowd")
"""Families of random scenes; the number of a family's stream is its place here."""

TRAINING = range(0, 1_000_000)
"""Seeds for tuning."""

EVALUATION = range(1_000_000, 2_000_000)
"""Seeds for evaluation; nothing may be tuned to them."""


class Draw:
    """Random numbers from the raw stream of PCG64, which NumPy promises never to change."""

    def __init__(self, key: tuple[int, ...]) -> None:
        self._bits = np.random.PCG64(np.random.SeedSequence(key))

    def uniform(self, low: float, high: float) -> float:
        """From `low` to `high`, four digits."""
        share = (int(self._bits.random_raw()) >> 11) * 2.0**-53
        return round(low + (high - low) * share, 4)

    def whole(self, low: int, high: int) -> int:
        """From `low` to `high`, both included."""
        return low + (int(self._bits.random_raw()) >> 11) % (high - low + 1)

    def direction(self) -> Array:
        """A unit vector in the plane."""
        angle = self.uniform(-math.pi, math.pi)
        return np.array([math.cos(angle), math.sin(angle)])

    def direction_in_space(self) -> Array:
        """A unit vector in space: all are equally likely."""
        height = self.uniform(-1.0, 1.0)
        return np.append(math.sqrt(1.0 - height * height) * self.direction(), height)

    def sign(self) -> int:
        """-1 or 1."""
        return 2 * self.whole(0, 1) - 1


@dataclass(frozen=True)
class Travel:
    """How far and how long bodies travel.

    Attributes
    ----------
    duration : float
        Of the run [s].
    swing, away : (float, float)
        From and to: half the stroke of one that swings; how far away one starts that comes and goes [m].
    wait, begin : float
        At most: how long one that comes stays, and when it sets out [s].
    """

    duration: float
    swing: tuple[float, float]
    away: tuple[float, float]
    wait: float
    begin: float


def push(draw: Draw, travel: Travel, target: Array, along: Array, depth: float) -> tuple[Array, Document]:
    """Where a body starts and how it moves `depth` [m] past a target, at 0.2 to 0.6 m/s."""
    speed = draw.uniform(0.2, 0.6)
    kind = draw.whole(0, 2)
    if kind == 0:  # straight, farthest at the end of the run
        start = target - along * (speed * travel.duration - depth)
        return start, {"kind": "linear", "velocity": rounded(speed * along)}
    if kind == 1:  # swings, from the far end
        swing = draw.uniform(*travel.swing)
        middle = target - along * (swing - depth)
        return middle, {
            "kind": "sinusoid",
            "amplitude": rounded(swing * along),
            "angular_frequency": round(speed / swing, 4),
            "phase": -1.5708,
        }
    # comes, stays, goes
    away, wait = draw.uniform(*travel.away), draw.uniform(0.0, travel.wait)
    begin, trip = draw.uniform(0.0, travel.begin), (away + depth) / speed
    times = np.cumsum([begin, trip, max(wait, 0.1), trip])
    near, far = rounded(target + depth * along), rounded(target - away * along)
    return target - away * along, {
        "kind": "waypoints",
        "times": rounded(times),
        "points": [far, near, near, far],
    }


def rounded(values: Array | list[float], digits: int = 4) -> list[float]:
    """Plain numbers of few digits, so that a scene is the same on every machine."""
    return [round(float(value), digits) for value in values]
