"""Where obstacles are, in the plane and in space, and how they are turned there."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull.evaluation.geometry.arm import cos_sin, product, quaternion, rotation

__all__ = ["Array", "Motion", "Turning"]

Array = NDArray[np.float64]


class Motion:
    """Where an obstacle is, in the plane or in space.

    Parameters
    ----------
    obstacle : Mapping
        With its position.
    dimension : {2, 3}, optional
        Of the space.
    """

    def __init__(self, obstacle: Mapping[str, Any], dimension: int = 2) -> None:
        self.position = np.asarray(obstacle.get("position", np.zeros(dimension)), dtype=float)
        self.motion = obstacle.get("motion") or {"kind": "static"}

    def __call__(self, times: Array) -> Array:
        """Positions at instants [s], (k, dimension) [m]."""
        motion = self.motion
        if motion["kind"] == "waypoints":
            points = np.asarray(motion["points"], dtype=float)
            if motion.get("interpolation") == "smooth":
                return _smooth(np.asarray(motion["times"], dtype=float), points, times)
            return np.stack([np.interp(times, motion["times"], column) for column in points.T], axis=1)
        away = np.zeros((len(times), len(self.position)))
        if motion["kind"] == "linear":
            away = times[:, None] * np.asarray(motion["velocity"], dtype=float)
        if motion["kind"] == "sinusoid":
            _, swing = cos_sin(motion["angular_frequency"] * times + motion.get("phase", 0.0))
            away = swing[:, None] * np.asarray(motion["amplitude"], dtype=float)
        positions: Array = self.position + away
        return positions


class Turning:
    """How an obstacle in space is turned: at a constant rate, or from one orientation to the next.

    Parameters
    ----------
    obstacle : Mapping
        With its orientation, its angular velocity along world axes [rad/s], and its motion.
    """

    def __init__(self, obstacle: Mapping[str, Any]) -> None:
        self._start = rotation(obstacle.get("orientation", (1.0, 0.0, 0.0, 0.0)))
        motion = obstacle.get("motion") or {}
        self._orientations = np.array(motion.get("orientations", ()), dtype=float).reshape(-1, 4)
        self._times = np.asarray(motion.get("times", ()), dtype=float)
        self._smooth = motion.get("interpolation") == "smooth"
        self._rate = np.asarray(obstacle.get("angular_velocity", np.zeros(3)), dtype=float)

    def __call__(self, times: Array) -> Array:
        """Rotation matrices at instants [s], (k, 3, 3), or (1, 3, 3) for all if it does not turn."""
        if not len(self._orientations):
            if not self._rate.any():
                return self._start[None]
            return product(_rotations(times[:, None] * self._rate), self._start)
        if self._smooth:
            turned = self._orientations / np.linalg.norm(self._orientations, axis=1, keepdims=True)
            flips = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
            turned[1:] *= np.cumprod(flips)[:, None]
            return np.asarray(rotation(_smooth(self._times, turned, times)))
        turns = rotation(self._orientations)
        if len(turns) == 1:
            return turns
        k = np.clip(np.searchsorted(self._times, times, side="right") - 1, 0, len(turns) - 2)
        share = np.clip((times - self._times[k]) / (self._times[k + 1] - self._times[k]), 0.0, 1.0)
        between = quaternion(product(turns[k + 1], np.swapaxes(turns[k], 1, 2)))  # w ≥ 0: the shorter way
        length = np.linalg.norm(between[:, 1:], axis=1)
        angle = 2.0 * np.arctan2(length, between[:, 0])
        axis = between[:, 1:] / np.where(length > 0.0, length, 1.0)[:, None]
        return product(_rotations((share * angle)[:, None] * axis), turns[k])


def _smooth(knots: Array, points: Array, times: Array) -> Array:
    """Along quintics through points, at rest before and after; at points the derivatives of parabolas."""
    from scipy.interpolate import BPoly

    slopes = np.diff(points, axis=0) / np.diff(knots)[:, None]
    first, second = np.zeros_like(points), np.zeros_like(points)
    if len(knots) > 2:
        first[1:-1] = np.gradient(points, knots, axis=0)[1:-1]
        second[1:-1] = 2.0 * np.diff(slopes, axis=0) / (knots[2:] - knots[:-2])[:, None]
    if len(knots) == 1:
        return np.repeat(points, len(times), axis=0)
    curve = BPoly.from_derivatives(knots, np.stack([points, first, second], axis=1))
    found: Array = curve(np.clip(times, knots[0], knots[-1]))
    return found


def _rotations(vectors: Array) -> Array:
    """The matrices (k, 3, 3) of rotation vectors (k, 3) [rad]."""
    angle = np.linalg.norm(vectors, axis=1, keepdims=True)
    axis = vectors / np.where(angle > 0.0, angle, 1.0)
    c, s = cos_sin(0.5 * angle)
    made: Array = rotation(np.concatenate([c, s * axis], axis=1))
    return made
