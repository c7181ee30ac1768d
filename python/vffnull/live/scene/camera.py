"""From where a scene is seen, and how much of the picture is free."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import viser
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull.model.scenario import Scenario
from vffnull.model.shape import core_in_space

Array = NDArray[np.float64]

UPRIGHT, COVERED = 0.6, 0.4
"""A picture with less width over height stands upright; the share of it above the controls of a phone."""
MARGIN = 0.96
"""The share of the picture, or of what is free of it, that is made use of."""

FIELD_OF_VIEW = 0.6
"""Vertical, in space [rad]."""
WITHIN = 1.6
"""How far from the base an obstacle is that the first picture shows [reaches]."""


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

        def take(camera: viser.CameraHandle) -> None:
            camera.up_direction = self.up
            camera.fov = self.fov
            camera.position = self.position
            camera.look_at = self.look_at

        steer(client, take)

    def begin_with(self, server: viser.ViserServer) -> None:
        """Let those who come later begin a little behind it, so that they are moved when they are there,
        and their answer tells that they have a picture.
        """
        camera = server.initial_camera
        camera.fov, camera.far = self.fov, self.far
        at = np.array(self.look_at)
        camera.up, camera.position, camera.look_at = self.up, at + 1.05 * (self.position - at), at


def aspect_of(camera: viser.CameraHandle) -> float | None:
    """Width over height of somebody's picture; None if it has no size, as in a window that is hidden, or if
    the camera is somewhere else than in space, as a broken browser tells of it.
    """
    try:
        aspect = float(camera.aspect)  # viser divides
        places = np.array([camera.position, camera.look_at, camera.up_direction], dtype=float)
    except (ArithmeticError, ValueError):
        return None
    is_there = places.shape == (3, 3) and bool(np.isfinite(places).all())
    return aspect if is_there and 0.0 < aspect < np.inf else None


def steer(client: viser.ClientHandle, change: Callable[[viser.CameraHandle], None]) -> None:
    """Change the camera of somebody there, but for one that cannot be: nobody else has a share in that."""
    if aspect_of(client.camera) is None:
        return
    try:
        with client.atomic():
            change(client.camera)
    except ValueError:  # of directions that are none
        return


def seen_above(aspect: float) -> float:
    """How far down what is to be seen may go, as a share of half the picture's height.

    In a picture that stands upright, as on a phone, the controls cover the lower part.
    """
    return 1.0 if aspect >= UPRIGHT else 2 * COVERED - 1


def around(scenario: Scenario, reach: float) -> tuple[float, ...]:
    """Limits [m] around an arm of this reach [m] and what is near it at the start.

    The lower and the upper one along each axis.
    """
    state = _core.Simulation(scenario.to_dict()).state
    joints, near = scenario.arm.forward_kinematics(state.q), state.obstacles
    every = np.vstack([joints, near[np.linalg.norm(near - joints[0], axis=1) < WITHIN * reach]])
    low, high = every.min(axis=0) - 0.12 * reach, every.max(axis=0) + 0.12 * reach
    missing = max(0.0, 0.75 * reach - (high[-1] - low[-1])) / 2
    low[-1], high[-1] = low[-1] - missing, high[-1] + missing
    return tuple(np.stack([low, high], axis=1).ravel().tolist())


def framing(low: Array, high: Array, towards: Sequence[float], aspect: float) -> Camera:
    """A camera in this direction that sees the box from `low` to `high` (3,) [m].

    It is just so far away that the box is seen in what is free of the picture, as much of it on the left as
    on the right, and above as below. A point p is above the lower edge if −u·p + s d·p ≤ s c_d − c_u for the
    camera at c, with u upwards, d towards the camera, and s the slope of that edge; so with the other three.
    What the points need of each pair of edges adds up to the distance that the wider pair decides.
    """
    middle = (low + high) / 2
    direction = np.array(towards)
    direction /= np.linalg.norm(direction)
    right = np.cross([0.0, 0.0, 1.0], direction)
    right /= np.linalg.norm(right)
    above = np.cross(direction, right)
    corners, _ = core_in_space({"kind": "box", "size": high - low})
    tall = MARGIN * float(np.tan(FIELD_OF_VIEW / 2))
    wide, lower = max(aspect, 0.1) * tall, tall * seen_above(aspect)
    u, r, d = corners @ above, corners @ right, corners @ direction
    edges = (r + wide * d).max(), (wide * d - r).max(), (u + tall * d).max(), (lower * d - u).max()
    away = max((edges[0] + edges[1]) / (2 * wide), (edges[2] + edges[3]) / (tall + lower))
    aside = (edges[0] - edges[1]) / 2
    up = (edges[2] - edges[3] + (lower - tall) * away) / 2
    center = middle + aside * right + up * above
    x, y, z = (float(each) for each in center + away * direction)
    return Camera((x, y, z), (*center.tolist(),), (0.0, 0.0, 1.0), FIELD_OF_VIEW, 100.0)
