"""Rotations as models write them: quaternions [w, x, y, z], matrices, roll, pitch, yaw."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

__all__ = ["frame", "matrix", "roll_pitch_yaw", "six", "tensor"]

Array = NDArray[np.float64]


def matrix(quaternion: Sequence[float] | Array) -> Array:
    """The rotation matrix of a unit quaternion."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def roll_pitch_yaw(quaternion: Sequence[float] | Array) -> tuple[float, float, float]:
    """Angles about the fixed axes x, y, z, in this order; exact at a pitch of ±90°, too."""
    r = matrix(quaternion)
    pitch = math.atan2(-r[2, 0], math.hypot(r[0, 0], r[1, 0]))
    yaw = math.atan2(r[1, 0], r[0, 0])
    # With the yaw taken off, what rounding made of it comes back in the roll.
    s, c = math.sin(yaw), math.cos(yaw)
    roll = math.atan2(s * r[0, 2] - c * r[1, 2], c * r[1, 1] - s * r[0, 1])
    return roll, pitch, yaw


def tensor(inertia: Sequence[float]) -> Array:
    """The matrix of [xx, yy, zz, xy, xz, yz]."""
    xx, yy, zz, xy, xz, yz = inertia
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six(inertia: Array) -> list[float]:
    """The six numbers of a symmetric matrix."""
    return [float(inertia[i, j]) for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]


def frame(position: Sequence[float] | Array, quaternion: Sequence[float] | Array) -> dict[str, list[float]]:
    """A frame as a part of a document."""
    return {"position": [float(x) for x in position], "orientation": [float(x) for x in quaternion]}
