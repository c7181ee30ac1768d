"""Derivatives of distances against differences of the distances themselves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import vffnull as vff

Array = NDArray[np.float64]

STEP = 4e-4  # s


def smooth_pairs(
    arm: vff.Arm, obstacles: list[vff.Obstacle], q: Array, dq: Array, ddq: Array, t: float
) -> NDArray[np.intp]:
    """How many pairs of each obstacle were checked at this state.

    Rate and acceleration are the first and second derivative of the distance along q + q̇ h + ½ q̈ h², wherever
    no other feature becomes nearest meanwhile (there the differences of two step lengths disagree).
    """
    steps = STEP * np.arange(-2, 3)
    h = steps[:, None]
    d = vff.distances(arm, q + h * dq + h**2 / 2 * ddq, dq + h * ddq, obstacles, t + steps).distance
    fine = (d[3] - 2 * d[2] + d[1]) / STEP**2
    coarse = (d[4] - 2 * d[2] + d[0]) / (4 * STEP**2)
    first = (8 * (d[3] - d[1]) - (d[4] - d[0])) / (12 * STEP)
    second = (4 * fine - coarse) / 3
    now = vff.distances(arm, q, dq, obstacles, t)
    scale = 1 + np.abs(second)
    smooth = np.abs(fine - coarse) < 1e-4 * scale
    found = now.gradient @ ddq + now.bias
    assert np.all(np.abs(now.rate - first)[smooth] < 1e-6 * (1 + np.abs(first[smooth])))
    assert np.all(np.abs(found - second)[smooth] < 2e-4 * scale[smooth])
    return np.bincount(now.obstacle[smooth], minlength=len(obstacles))
