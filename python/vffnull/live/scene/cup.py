"""A cup in the hand, whose liquid shows at a glance whether the orientation is kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull._core import quaternions
from vffnull.live.scene.meshes import turned

Array = NDArray[np.float64]

SPILLS = np.radians(15.0)
"""The tilt at which a full cup runs over [rad]."""
_GLASS, _LIQUID = (150, 190, 215), (0, 114, 178)
_ABOVE = 0.2
"""Share of the cup that is above where the hand holds it."""
_STEP = 1e-4
"""A surface that moves by less [m] is left as it is."""
LEVEL = 1e-2
"""Angle between a tool's axis and the vertical [rad] up to which a cup in it may turn with the tool."""


class Liquid:
    """What is in an upright cylinder of a radius and a height [m]; its surface is always horizontal.

    What runs over the rim is lost. As long as the bottom is covered, the surface turns about its middle, so
    that its level there says how much there is; a cup whose bottom shows is taken for empty.
    """

    def __init__(self, radius: float, height: float) -> None:
        self.radius, self.height = radius, height
        self.full = height - radius * float(np.tan(SPILLS))
        self.level = self.full
        self.tilt = 0.0
        """Angle between the cup's axis and the vertical [rad]."""

    def turn(self, up: Array) -> Array:
        """The slope (2,) of the surface in a cup that sees the vertical along a unit vector (3,): by how much
        it rises per metre along the cup's x and y.
        """
        across, along = float(np.hypot(up[0], up[1])), float(up[2])
        self.tilt = float(np.arctan2(across, along))
        if along <= 0.0:
            self.level = 0.0
            return np.zeros(2)
        rise = self.radius * across / along
        self.level = min(self.level, self.height - rise)
        if self.level < rise:
            self.level = 0.0
        return -np.asarray(up[:2]) / along

    @property
    def spilt(self) -> float:
        """The share that has run over."""
        return 1.0 - self.level / self.full


class Cup:
    """The cup in the drawing.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    name : str
        A node that moves with the hand.
    turn : (3, 3) ndarray
        The axes of the cup in the hand's frame, as columns.
    scale : float
        How large it is: 1 is a cup 0.11 m high.
    """

    def __init__(self, server: viser.ViserServer, name: str, turn: Array, scale: float) -> None:
        radius, height, wall = 0.048 * scale, 0.11 * scale, 0.004 * scale
        self.liquid = Liquid(radius - wall, height - wall)
        self._turn = turn
        scene = server.scene
        below = (0.0, 0.0, -(1.0 - _ABOVE) * height)
        self._frame = scene.add_frame(name, show_axes=False, wxyz=quaternions(turn))
        scene.add_frame(f"{name}/in", show_axes=False, position=below)
        wall_profile = np.array([[0.0, 0.0], [radius, 0.0], [radius, height]])
        side = replace(turned(wall_profile), side="double").smooth
        glass: dict[str, Any] = {"color": _GLASS, "receive_shadow": False}
        scene.add_mesh_simple(
            f"{name}/in/glass", side.vertices, side.faces, opacity=0.35, cast_shadow=False, **glass
        )
        ring = np.linspace(0.0, 2 * np.pi, 9)
        lip = turned(np.stack([radius + wall * np.cos(ring), height + wall * np.sin(ring)], axis=1))
        scene.add_mesh_simple(f"{name}/in/lip", lip.vertices, lip.faces, cast_shadow=False, **glass)
        self._below = scene.add_mesh_simple(
            f"{name}/in/below", *_cylinder(), color=_LIQUID, cast_shadow=False, receive_shadow=False
        )
        self._above = scene.add_mesh_simple(
            f"{name}/in/above", *_wedge(), color=_LIQUID, cast_shadow=False, receive_shadow=False
        )
        self._bottom = wall
        self.follow(turn.T)

    def follow(self, hand: Array) -> None:
        """Let the liquid find its level in a hand whose axes (3, 3) are columns.

        Up to the lowest point of its surface it is a cylinder, and above that a wedge, which is one and the
        same for every slope but for its height: all that is sent is where and how large they are.
        """
        slope = self.liquid.turn((hand @ self._turn)[2])
        radius, level = self.liquid.radius, self.liquid.level
        rise = max(radius * float(np.hypot(*slope)), _STEP)
        heading = float(np.arctan2(slope[1], slope[0]))
        low = max(level - rise, _STEP)
        visible = level > 0.0
        for part in (self._below, self._above):
            if part.visible != visible:
                part.visible = visible
        if visible:
            _put(self._below, self._bottom, (radius, radius, low))
            _put(self._above, self._bottom + low, (radius, radius, rise))
            turn = (np.cos(heading / 2), 0.0, 0.0, np.sin(heading / 2))
            if rise > 2 * _STEP:  # a level surface looks the same from everywhere
                self._above.wxyz = turn


def _put(part: viser.MeshHandle, height: float, scale: tuple[float, float, float]) -> None:
    """Move and stretch a part of the liquid, if that is seen."""
    if abs(part.position[2] - height) > _STEP:
        part.position = (0.0, 0.0, height)
    if np.abs(np.subtract(part.scale, scale)).max() > _STEP:
        part.scale = scale


def _cylinder() -> tuple[Array, Any]:
    """Of radius and height 1, without a top."""
    made = turned(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]]))
    return made.vertices, made.faces


def _wedge() -> tuple[Array, Any]:
    """What is below the plane z = 1 + x in a cylinder of radius 1 that stands on z = 0, without a bottom."""
    made = turned(np.array([[1.0, 0.0], [1.0, 1.0], [1.0, 1.0], [0.0, 1.0]]))
    vertices = made.vertices.copy()
    vertices[:, 2] *= 1.0 + vertices[:, 0]
    return vertices, made.faces


def upright_in(hand: Array) -> Array:
    """Axes (3, 3) as columns, in the frame of a hand with these axes, of what stands upright in the world."""
    return np.asarray(hand.T)


def carries(upright: Array) -> bool:
    """Whether a tool that is free to turn about its axis z keeps upright what stands so in its frame."""
    return bool(abs(upright[2, 2]) > np.cos(LEVEL))


def stays_level(reference: Mapping[str, Any]) -> bool:
    """Whether a reference keeps the orientation that the tool has at the start."""
    own = {"orientation", "orientations", "start_orientation"}
    return not own & reference.keys() and not reference.get("turning", False)
