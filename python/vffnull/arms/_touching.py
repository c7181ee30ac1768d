"""Which links of an arm touch each other whatever it does."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull.arms._frames import matrix

__all__ = ["link_poses", "reference_posture", "segment_distance", "touching"]

Array = NDArray[np.float64]

POSTURES = 32
"""In how many postures links are looked at."""


def reference_posture(arm: Mapping[str, Any]) -> Array:
    """The middle of every joint's range, 0 where it has none, (n,) [rad or m]."""
    n = len(arm["joints"])
    limits = arm.get("joint_limits") or [[-math.inf, math.inf]] * n
    middles = [(low + high) / 2 if math.isfinite(low + high) and low < high else 0.0 for low, high in limits]
    return np.array([0.0 if math.isnan(middle) else middle for middle in middles])


def link_poses(arm: Mapping[str, Any], q: Array) -> list[tuple[Array, Array]]:
    """Rotation and position of the base and of every link in the frame of the base."""
    rotation, position = np.eye(3), np.zeros(3)
    poses = [(rotation, position)]
    for joint, value in zip(arm["joints"], q, strict=True):
        position = position + rotation @ np.asarray(joint.get("position", (0, 0, 0)), float)
        rotation = rotation @ matrix(joint.get("orientation", (1, 0, 0, 0)))
        axis = np.asarray(joint.get("axis", (0, 0, 1)), float)
        if joint["kind"] == "prismatic":
            position = position + rotation @ axis * value
        else:
            rotation = rotation @ matrix([math.cos(value / 2), *(math.sin(value / 2) * axis)])
        poses.append((rotation, position))
    return poses


def segment_distance(p: Array, q: Array, r: Array, s: Array) -> float:
    """Distance between the segments p–q and r–s [m]."""
    d1, d2, w = q - p, s - r, p - r
    a, e, b = d1 @ d1, d2 @ d2, d1 @ d2
    c, f = d1 @ w, d2 @ w
    candidates: list[tuple[float, float]] = []
    # The least of the ends against the other segment, and of the interior where lines cross.
    for end in (0.0, 1.0):
        candidates.append((end, float(np.clip((b * end + f) / e, 0, 1)) if e > 0 else 0.0))
        candidates.append((float(np.clip((b * end - c) / a, 0, 1)) if a > 0 else 0.0, end))
    determinant = a * e - b * b
    if determinant > 1e-14 * a * e:
        t, u = float((b * f - c * e) / determinant), float((a * f - b * c) / determinant)
        if 0 <= t <= 1 and 0 <= u <= 1:
            candidates.append((t, u))
    return float(min(np.linalg.norm(w + t * d1 - u * d2) for t, u in candidates))


def _segment(shape: Mapping[str, Any]) -> tuple[Array, Array]:
    if shape["kind"] == "sphere":
        return np.array(shape["center"]), np.array(shape["center"])
    return np.array(shape["a"]), np.array(shape["b"])


def touching(arm: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Pairs of links, not neighbours, whose capsules overlap in the reference posture, or nearly always.

    Capsules are a little larger than what they contain: such a pair would be in collision all the time.
    "Nearly always" is in 95 % of `POSTURES` postures spread evenly over the ranges of the joints. Pairs that
    the document ignores already are not told again.
    """
    links = [arm["base"], *(joint["link"] for joint in arm["joints"])]
    known = {frozenset(pair) for pair in arm.get("ignore", [])}
    pairs = [
        (i, j)
        for i, j in itertools.combinations(range(len(links)), 2)
        if j > i + 1 and frozenset((links[i], links[j])) not in known
    ]
    at_rest = _overlapping(arm, reference_posture(arm), pairs)
    often = dict.fromkeys(pairs, 0)
    for q in _postures(arm):
        for pair in _overlapping(arm, q, pairs):
            often[pair] += 1
    found = [pair for pair in pairs if pair in at_rest or often[pair] >= 0.95 * POSTURES]
    return [(links[i], links[j]) for i, j in found]


def _postures(arm: Mapping[str, Any]) -> Array:
    """Evenly spread over the ranges of the joints, a whole turn where there is none, (POSTURES, n)."""
    middle = reference_posture(arm)
    ranges = np.array(arm.get("joint_limits") or [[-math.inf, math.inf]] * len(middle))
    bounded = np.isfinite(ranges).all(axis=1)
    half = np.where(bounded, np.ptp(np.where(bounded[:, None], ranges, 0.0), axis=1) / 2, math.pi)
    # Additive recurrence with the generalised golden ratio (Roberts): no random numbers.
    ratio = 1.0
    for _ in range(40):
        ratio = (1.0 + ratio) ** (1.0 / (len(middle) + 1))
    steps = np.arange(1, POSTURES + 1)[:, None] * ratio ** -np.arange(1.0, len(middle) + 1)
    postures: Array = middle + half * (2.0 * (steps % 1.0) - 1.0)
    return postures


def _overlapping(arm: Mapping[str, Any], q: Array, pairs: Sequence[tuple[int, int]]) -> set[tuple[int, int]]:
    """Those of the pairs of links, counted from the base, whose capsules overlap at `q`."""
    links = [arm["base"], *(joint["link"] for joint in arm["joints"])]
    poses = link_poses(arm, q)
    placed: list[list[tuple[Array, Array, float]]] = [[] for _ in links]
    for item in arm["collision"]:
        i = links.index(item["link"])
        rotation, position = poses[i]
        a, b = (rotation @ end + position for end in _segment(item["shape"]))
        placed[i].append((a, b, item["shape"]["radius"]))
    return {
        (i, j) for i, j in pairs if any(_overlap(*both) for both in itertools.product(placed[i], placed[j]))
    }


def _overlap(first: tuple[Array, Array, float], second: tuple[Array, Array, float]) -> bool:
    (a, b, r), (c, d, s) = first, second
    half = (math.dist(a, b) + math.dist(c, d)) / 2
    if math.dist((a + b) / 2, (c + d) / 2) > half + r + s:  # most are far apart
        return False
    return segment_distance(a, b, c, d) < r + s
