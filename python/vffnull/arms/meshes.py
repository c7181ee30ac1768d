"""Meshes as obstacles: convex hulls that enclose them, and how much larger these are."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.arms._pieces import check, enclosing, outside
from vffnull.model.document import frozen
from vffnull.model.obstacle import Obstacle

if TYPE_CHECKING:
    from vffnull.model.motion import Motion

__all__ = ["Enclosure", "enclose"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Enclosure:
    """Convex hulls that enclose a mesh together.

    Attributes
    ----------
    hulls : tuple of (k, 3) array
        Corners of each [m], at most 64, in the frame of the mesh.
    volume : float
        Of the hulls [m³]; where they overlap it counts for each.
    mesh_volume : float or None
        Of the mesh [m³]; None if its surface is open, so that it has none.
    protrusion : float
        How far the surface sticks out of the hulls at most [m]: by rounding, if at all, as every triangle
        lies within one of them.
    """

    hulls: tuple[Array, ...]
    volume: float
    mesh_volume: float | None
    protrusion: float

    def obstacles(
        self,
        position: ArrayLike = (0.0, 0.0, 0.0),
        motion: Motion | None = None,
        *,
        orientation: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None,
    ) -> list[Obstacle]:
        """One obstacle per hull; they move as one body.

        Parameters
        ----------
        position : (3,) array_like
            Where the origin of the mesh is at rest [m].
        motion : Motion, optional
            How it moves.
        orientation : (4,) array_like, optional
            Of the mesh, a unit quaternion ``[w, x, y, z]``.
        angular_velocity : (3,) array_like, optional
            How fast it turns about its origin [rad/s].
        """
        turned, turns = (None if each is None else frozen(each) for each in (orientation, angular_velocity))
        return [
            Obstacle(
                "convex",
                (("vertices", frozen(corners)),),
                frozen(position),
                motion=motion,
                orientation=turned,
                angular_velocity=turns,
            )
            for corners in self.hulls
        ]


def enclose(
    file: str | os.PathLike[str], pieces: int = 1, *, scale: float | Sequence[float] = 1.0
) -> Enclosure:
    """Enclose a mesh in convex hulls.

    One hull fills every hollow of the mesh. With more pieces, CoACD (Wei et al., "Approximate convex
    decomposition for 3D meshes with collision-aware concavity and tree search", ACM Transactions on Graphics
    41(4), 2022) cuts it where this keeps the hollows best, which takes seconds to minutes. A
    hull of more than 64 corners is replaced by a larger one of at most 64. Nothing of the mesh sticks out;
    `Enclosure` says how much larger the hulls are.

    Parameters
    ----------
    file : path
        STL, OBJ, PLY, DAE or what else trimesh reads; in metres, unless a DAE file says otherwise.
    pieces : int, optional
        The most hulls that there may be.
    scale : float or (3,) sequence of float, optional
        By which the mesh is multiplied: 0.001 for millimetres.

    Raises
    ------
    ImportError
        Without trimesh, SciPy or, for several pieces, CoACD: ``pip install "vffnull[meshes]"``.
    vffnull.errors.InputError
        If the file cannot be read, holds nothing that encloses a volume, or CoACD cannot cut it.
    """
    check("pieces", pieces)
    factors = np.asarray(scale, float)
    if factors.shape not in ((), (3,)) or not np.all(np.isfinite(factors)) or np.any(factors <= 0.0):
        raise InputError(f"scale: expected one or three positive numbers, got {scale!r}")
    path = Path(file).expanduser()
    if not path.is_file():
        raise InputError(f"mesh {str(path)!r} cannot be found")
    from vffnull.arms._meshes import read

    solid = read(path, path.stem, np.broadcast_to(factors, 3).tolist())
    surface = extra("trimesh", "meshes").Trimesh(solid.points, solid.triangles, process=True)
    try:
        hulls = enclosing(surface, pieces)
    except extra("scipy.spatial", "meshes").QhullError as error:
        raise InputError(f"mesh {str(path)!r} is flat: it encloses no volume") from error
    return Enclosure(
        hulls=tuple(hull.corners for hull in hulls),
        volume=sum(hull.volume for hull in hulls),
        mesh_volume=abs(float(surface.volume)) if surface.is_watertight else None,
        protrusion=max(0.0, outside(hulls, surface)),
    )
