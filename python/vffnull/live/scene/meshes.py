"""Bodies as triangles, made once: what moves afterwards is where they are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vffnull.draw import geometry

Array = NDArray[np.float64]
Faces = NDArray[np.intp]

AROUND = 32
"""Sides of what is round."""
_FINE = 72
"""The same for directions, of which a body's corners are the farthest points."""


_MOST = 64
"""Corners of hulls that are measured."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """Vertices (·, 3) [m] and triangles (·, 3), anticlockwise seen from outside."""

    vertices: Array
    faces: Faces
    flat: bool = False
    """Whether its edges are seen."""
    side: Literal["front", "double"] = "front"

    @property
    def smooth(self) -> Mesh:
        """The same drawn by the shaders of round bodies: flat faces have vertices of their own, and what is
        seen from behind has faces of its own, which come first.

        Without a graphics card, every further kind of shader delays the first picture.
        """
        vertices, faces = self.vertices, self.faces
        if self.flat:
            vertices, faces = vertices[faces].reshape(-1, 3), np.arange(faces.size).reshape(-1, 3)
        if self.side == "double":
            faces = np.vstack([faces[:, ::-1] + len(vertices), faces])
            vertices = np.vstack([vertices, vertices])
        return Mesh(vertices, faces)


def plate(outline: Array) -> Mesh:
    """A convex outline (·, 2) of the plane, filled."""
    around = np.arange(1, len(outline) - 1)
    faces = np.stack([np.zeros_like(around), around, around + 1], axis=1)
    return Mesh(geometry.in_space(outline), faces, flat=True, side="double")


def turned(profile: Array, around: int = AROUND, *, flat: bool = False) -> Mesh:
    """What a profile (·, 2) of distances from the z axis and heights [m], from below, makes by a turn."""
    angles = np.linspace(0.0, 2 * np.pi, around, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    radii, heights = profile.T
    vertices = np.concatenate(
        [radii[:, None, None] * ring, np.broadcast_to(heights[:, None, None], (len(profile), around, 1))],
        axis=2,
    )
    return Mesh(vertices.reshape(-1, 3), _rings(len(profile), around), flat)


def solid(corners: Array, radius: float) -> Mesh:
    """All points within a radius [m] of the convex hull of corners (·, 3) [m]."""
    if len(corners) > 2:
        return _hull(corners, radius)
    along = corners[-1] - corners[0]
    length = float(np.linalg.norm(along))
    quarter = np.linspace(0.0, np.pi / 2, AROUND // 4 + 1)
    below = np.stack([np.sin(quarter), -np.cos(quarter)], axis=1) * radius
    above = np.stack([np.cos(quarter), np.sin(quarter)], axis=1) * radius + [0.0, length]
    made = turned(np.vstack([below, above]))
    return Mesh(made.vertices @ _upright(along).T + corners[0], made.faces)


def _hull(corners: Array, radius: float) -> Mesh:
    """The same of a hull; with a radius by directions: the farthest corner along each, and so much further.

    Directions are joined to triangles as they lie on a sphere, so that the surface is closed; of those that
    meet in a corner, what is left without a radius is nothing. So are hulls of very many corners made, and
    pieces of planes, which are seen from both sides.
    """
    if radius == 0.0 and len(corners) <= _MOST and not geometry.is_surface(corners):
        return Mesh(corners, geometry.triangles(corners), flat=True)
    heights = np.linspace(-np.pi / 2, np.pi / 2, _FINE // 2 + 1)
    ball = turned(np.stack([np.cos(heights), np.sin(heights)], axis=1), _FINE)
    tilted = _upright(np.array([0.48, 0.29, 0.83]))  # so that no direction is that of a face
    directions = ball.vertices @ tilted.T
    farthest = np.argmax(directions @ corners.T, axis=1)
    if radius > 0.0:
        return Mesh(corners[farthest] + radius * directions, ball.faces)
    faces = farthest[ball.faces]
    a, b, c = faces.T
    return Mesh(corners, faces[(a != b) & (b != c) & (c != a)], flat=True)


def _rings(rings: int, around: int) -> Faces:
    """Triangles between rings of as many vertices each."""
    row, column = np.meshgrid(np.arange(rings - 1), np.arange(around), indexing="ij")
    first, second = row * around + column, row * around + (column + 1) % around
    lower = np.stack([first, second, second + around], axis=-1)
    upper = np.stack([first, second + around, first + around], axis=-1)
    return np.concatenate([lower, upper], axis=-1).reshape(-1, 3)


def _upright(vector: Array) -> Array:
    """A rotation (3, 3) that takes the z axis to a vector."""
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        return np.eye(3)
    z = vector / length
    x = np.cross(np.eye(3)[np.argmin(np.abs(z))], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z], axis=1)
