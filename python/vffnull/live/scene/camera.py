"""From where a scene is seen, and how much of the picture is free."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import viser

UPRIGHT, COVERED = 0.6, 0.4
"""A picture with less width over height stands upright; the share of it above the controls of a phone."""
MARGIN = 0.96
"""The share of the picture, or of what is free of it, that is made use of."""


@dataclass(frozen=True)
class Camera:
    """Where a camera stands and what it looks at [m], with its vertical field of view [rad]."""

    position: tuple[float, float, float]
    look_at: tuple[float, float, float]
    up: tuple[float, float, float]
    fov: float
    far: float

    def move(self, client: viser.ClientHandle) -> None:
        """Take the camera of somebody there."""
        with client.atomic():
            client.camera.up_direction = self.up
            client.camera.fov = self.fov
            client.camera.position = self.position
            client.camera.look_at = self.look_at

    def begin_with(self, server: viser.ViserServer) -> None:
        """Let those who come later begin a little behind it, so that they are moved when they are there,
        and their answer tells that they have a picture.
        """
        camera = server.initial_camera
        camera.fov, camera.far = self.fov, self.far
        at = np.array(self.look_at)
        camera.up, camera.position, camera.look_at = self.up, at + 1.05 * (self.position - at), at


def seen_above(aspect: float) -> float:
    """How far down what is to be seen may go, as a share of half the picture's height.

    In a picture that stands upright, as on a phone, the controls cover the lower part.
    """
    return 1.0 if aspect >= UPRIGHT else 2 * COVERED - 1
