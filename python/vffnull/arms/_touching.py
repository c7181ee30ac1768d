"""Which links of an arm touch each other whatever it does."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core

__all__ = ["reference_posture", "spread", "touching"]

Array = NDArray[np.float64]

POSTURES = 256
"""In how many postures links are looked at."""

ALWAYS = 0.95
"""In which share of them a pair overlaps that nothing keeps apart."""


def reference_posture(arm: Mapping[str, Any]) -> Array:
    """The middle of every joint's range, 0 where it has none, (n,) [rad or m]."""
    n = len(arm["joints"])
    limits = arm.get("joint_limits") or [[-math.inf, math.inf]] * n
    middles = [(low + high) / 2 if math.isfinite(low + high) and low < high else 0.0 for low, high in limits]
    return np.array([0.0 if math.isnan(middle) else middle for middle in middles])


def touching(arm: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Pairs of links, not neighbours, whose shapes overlap nearly always.

    Shapes are often a little larger than what they contain: such a pair would be in collision all the time.
    "Nearly always" is in `ALWAYS` of `POSTURES` postures spread evenly over the ranges of the joints: a pair
    that overlaps in some postures only is one that can collide. Pairs that the document ignores already are
    not told again.
    """
    overlaps = _core.overlapping_links(arm, [q.tolist() for q in spread(arm, POSTURES)])
    often = Counter(pair for pairs in overlaps for pair in pairs)
    links = [arm["base"], *(joint["link"] for joint in arm["joints"])]
    found = (pair for pair, times in often.items() if times >= ALWAYS * POSTURES)
    return sorted(found, key=lambda pair: [links.index(link) for link in pair])


def spread(arm: Mapping[str, Any], count: int, share: float = 1.0) -> Array:
    """Postures spread evenly over a share of the ranges of the joints, (count, n); of a turn without any."""
    middle = reference_posture(arm)
    ranges = np.array(arm.get("joint_limits") or [[-math.inf, math.inf]] * len(middle))
    bounded = np.isfinite(ranges).all(axis=1)
    half = np.where(bounded, np.ptp(np.where(bounded[:, None], ranges, 0.0), axis=1) / 2, math.pi)
    # Additive recurrence with the generalised golden ratio (Roberts): no random numbers.
    ratio = 1.0
    for _ in range(40):
        ratio = (1.0 + ratio) ** (1.0 / (len(middle) + 1))
    steps = np.arange(1, count + 1)[:, None] * ratio ** -np.arange(1.0, len(middle) + 1)
    postures: Array = middle + share * half * (2.0 * (steps % 1.0) - 1.0)
    return postures
