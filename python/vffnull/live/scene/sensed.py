"""What sensors have measured of the obstacles: all that the controller knows of them."""

from __future__ import annotations

import numpy as np
import viser

from vffnull.live.scene.looks import SENSED, Array

SIZE = 0.014
"""Of a point [reaches]."""
MOVED = 2e-3
"""Points that have moved by less [m] are left where they are."""


class Sensed:
    """Points, as many as there are at the moment.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    reach : float
        Of the arm [m].
    """

    def __init__(self, server: viser.ViserServer, reach: float) -> None:
        self._cloud = server.scene.add_point_cloud(
            "/sensed",
            np.zeros((0, 3), np.float32),
            np.array(SENSED, dtype=np.uint8),
            point_size=SIZE * reach,
            point_shape="circle",
            precision="float32",
        )

    def draw(self, points: Array) -> None:
        """Show these (k, 3) [m] instead of those of before."""
        shown = self._cloud.points
        if points.shape == shown.shape and np.abs(points - shown).max(initial=0.0) < MOVED:
            return
        self._cloud.points = points.astype(np.float32)
