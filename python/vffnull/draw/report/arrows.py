"""All forces that a report draws: the repulsion of the field on every link, and what pushes from outside."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from vffnull.draw.primitives import Role
from vffnull.draw.scene import Scene

Array = NDArray[np.float64]


def all_arrows(scene: Scene, scale: float) -> tuple[Array, Array, list[Role]]:
    """Where they begin and how they go from there (T, k, D) [m], with so many metres for a newton, and what
    each of the k is.
    """
    points, forces = scene.pushes
    shafts = forces * scale
    roles: list[Role] = ["force"] * points.shape[1]
    if scene.wrenches is not None:
        places, pushes = scene.wrenches
        points = np.concatenate([points, places - pushes * scale], axis=1)
        shafts = np.concatenate([shafts, pushes * scale], axis=1)
        roles += ["wrench"] * places.shape[1]
    return points, shafts, roles
