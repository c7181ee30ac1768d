"""Where obstacles are, in the plane and in space."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Motion"]

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
            return np.stack([np.interp(times, motion["times"], column) for column in points.T], axis=1)
        away = np.zeros((len(times), len(self.position)))
        if motion["kind"] == "linear":
            away = times[:, None] * np.asarray(motion["velocity"], dtype=float)
        if motion["kind"] == "sinusoid":
            swing = np.sin(motion["angular_frequency"] * times + motion.get("phase", 0.0))
            away = swing[:, None] * np.asarray(motion["amplitude"], dtype=float)
        positions: Array = self.position + away
        return positions
