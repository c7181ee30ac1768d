"""A cup in the hand, whose liquid shows at a glance whether the orientation is kept."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull._arm import quaternion
from vffnull.viewer.scene.meshes import AROUND, turned

Array = NDArray[np.float64]

SPILLS = np.radians(15.0)
"""The tilt at which a full cup runs over [rad]."""
_GLASS, _LIQUID = (150, 190, 215), (0, 114, 178)
_ABOVE = 0.2
"""Share of the cup that is above where the hand holds it."""
_STEP = 1e-4
"""A surface that moves by less [m] is left as it is."""


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
        self._frame = scene.add_frame(name, show_axes=False, wxyz=quaternion(turn))
        scene.add_frame(f"{name}/in", show_axes=False, position=below)
        side = turned(np.array([[0.0, 0.0], [radius, 0.0], [radius, height]]), flat=False)
        glass: dict[str, Any] = {"color": _GLASS, "side": "double", "receive_shadow": False}
        scene.add_mesh_simple(
            f"{name}/in/glass", side.vertices, side.faces, opacity=0.35, cast_shadow=False, **glass
        )
        ring = np.linspace(0.0, 2 * np.pi, 9)
        lip = turned(np.stack([radius + wall * np.cos(ring), height + wall * np.sin(ring)], axis=1))
        scene.add_mesh_simple(f"{name}/in/lip", lip.vertices, lip.faces, cast_shadow=False, **glass)
        self._body = self._pour(scene, f"{name}/in/liquid", (0.0, 0.0, wall))

    def _pour(self, scene: viser.SceneApi, name: str, place: Any) -> viser.MeshSkinnedHandle:
        """The liquid: its surface hangs on three bones around it that go up and down, and is always plane.

        The circle of the surface is the one inside of the bones' triangle; the weights of a point are its
        barycentric coordinates.
        """
        radius, level = self.liquid.radius, self.liquid.level
        angles = np.linspace(0.0, 2 * np.pi, AROUND, endpoint=False)
        ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        corners = np.arange(3) * 2 * np.pi / 3
        self._bones = 2.0 * radius * np.stack([np.cos(corners), np.sin(corners)], axis=1)
        high = np.vstack([ring, ring, [[0.0, 0.0]]])
        weights = (1.0 + 2.0 * high @ self._bones.T / (2.0 * radius) ** 2) / 3.0
        vertices = np.vstack(
            [np.column_stack([high, np.full(len(high), level)]), np.column_stack([ring, np.zeros(AROUND)])]
        )
        still = np.vstack([np.zeros((len(high), 1)), np.ones((AROUND, 1))])
        skin = np.hstack([np.vstack([weights, np.zeros((AROUND, 3))]), still])
        i = np.arange(AROUND)
        j, bottom, middle = (i + 1) % AROUND, len(high) + i, len(high) - 1
        surface = np.stack([i, j, np.full(AROUND, middle)], axis=1)
        outer, after = AROUND + i, AROUND + j
        side = [np.stack([bottom, len(high) + j, after], axis=1), np.stack([bottom, after, outer], axis=1)]
        places = np.vstack([np.column_stack([self._bones, np.full(3, level)]), np.zeros((1, 3))])
        return scene.add_mesh_skinned(
            name,
            vertices,
            np.vstack([surface, *side]),
            bone_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)),
            bone_positions=places,
            skin_weights=skin,
            color=_LIQUID,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            position=place,
        )

    def follow(self, hand: Array) -> None:
        """Let the liquid find its level in a hand whose axes (3, 3) are columns."""
        slope = self.liquid.turn((hand @ self._turn)[2])
        heights = self.liquid.level + self._bones @ slope
        for bone, place, height in zip(self._body.bones[:3], self._bones, heights, strict=True):
            if abs(bone.position[2] - height) > _STEP:
                bone.position = (*place, float(height))
        if self._body.visible != (self.liquid.level > 0.0):
            self._body.visible = self.liquid.level > 0.0
