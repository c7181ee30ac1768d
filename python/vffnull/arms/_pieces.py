"""Surfaces in convex pieces: their bodies, which CoACD cuts where they have a hollow, and halves of what is
round. Every triangle is made to lie within one of the hulls.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.arms._hulls import Hull, halves, simplified

__all__ = ["WAY", "check", "enclosing", "outside"]

Array = NDArray[np.float64]

WAY = 2
"""Which way of making pieces this is; another one does not take those of this one for its own."""

_MOST = 64
"""More pieces of one surface take too long to cut, and to measure."""

SMALL = 1e-3
"""A body with less of the largest one's volume is no part of its own, but added to the others."""

HOLLOW = 0.05
"""A body that leaves more of its hull empty is cut."""

SPACING = 1 / 160
"""How long the edges are of triangles that lie across a cut, as a share of the surface's diagonal."""


def check(name: str, count: object) -> None:
    """Refuse what is no number of pieces."""
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MOST:
        raise InputError(f"{name}: expected a whole number from 1 to {_MOST}, got {count!r}")


def enclosing(surface: Any, count: int) -> list[Hull]:
    """The hulls of at most so many pieces of a surface, in which all of it lies.

    A triangle lies within a convex hull if its corners do. One that lies within none is added to the
    one that it sticks out of least, so that nothing is left between two pieces.

    Parameters
    ----------
    surface : trimesh.Trimesh
        Vertices and faces [m].
    count : int
        The most hulls that there may be; one is that of all vertices.

    Raises
    ------
    ImportError
        Without SciPy or, for several pieces, CoACD.
    vffnull.errors.InputError
        If CoACD cannot cut the surface.
    scipy.spatial.QhullError
        If the surface is flat.
    """
    if count == 1:
        return [simplified(Hull(np.asarray(surface.vertices, float)))]
    hulls = _parts(surface, count)
    points, faces, beyond = _across(hulls, surface)
    nearest = np.where(beyond.min(axis=0) > _rounding(surface), beyond.argmin(axis=0), -1)
    added = (np.unique(faces[nearest == k]) for k in range(len(hulls)))
    wide = [Hull(np.vstack([hull.corners, points[each]])) for hull, each in zip(hulls, added, strict=True)]
    return _rounded(wide, count, _spacing(surface))


def _parts(surface: Any, count: int) -> list[Hull]:
    """The hulls of the parts of a surface: its bodies, and what those with a hollow are cut into."""
    bodies = _bodies(surface)
    if not 1 <= len(bodies) <= count:
        return _cut(surface, count)
    parts: list[Hull] = []
    spare = count - len(bodies)
    for hollow, body, hull in sorted(((_hollow(*each), *each) for each in bodies), key=lambda each: -each[0]):
        cut = _cut(body, spare + 1) if spare and hollow > HOLLOW * hull.volume else [hull]
        parts += cut
        spare -= len(cut) - 1
    return parts


def _bodies(surface: Any) -> list[tuple[Any, Hull]]:
    """What of a surface hangs together, and its hull, without what has next to no volume."""
    bodies = []
    for body in surface.split(only_watertight=False):
        with suppress(extra("scipy.spatial", "meshes").QhullError):
            bodies.append((body, Hull(np.asarray(body.vertices, float))))
    least = SMALL * max((hull.volume for _, hull in bodies), default=0.0)
    return [(body, hull) for body, hull in bodies if hull.volume > least]


def _hollow(body: Any, hull: Hull) -> float:
    """How much of its hull a body does not fill [m³]: all of it if the surface is open."""
    return hull.volume - float(body.volume) if body.is_volume else hull.volume


def _rounded(hulls: list[Hull], count: int, overlap: float) -> list[Hull]:
    """Hulls with as few corners as the core measures, at most so many.

    While there may be more, the one that fewer corners make larger by most is cut in halves.
    """
    fewer = [(hull, simplified(hull)) for hull in hulls]
    while len(fewer) < count:
        larger = [less.volume - hull.volume for hull, less in fewer]
        worst = int(np.argmax(larger))
        cut: list[tuple[Hull, Hull]] = []
        # What is too thin to be cut stays as it is.
        with suppress(extra("scipy.spatial", "meshes").QhullError):
            two = halves(fewer[worst][0], overlap) if larger[worst] > 0.0 else None
            cut = [(half, simplified(half)) for half in two or ()]
        if not cut:
            break
        fewer[worst : worst + 1] = cut
    return [less for _, less in fewer]


def outside(hulls: Sequence[Hull], surface: Any) -> float:
    """How far a surface is outside of hulls at most [m], 0 or less where all of it is within one of them.

    Of a triangle that lies within none it is what a corner of it is outside.
    """
    *_, beyond = _across(hulls, surface)
    return float(beyond.min(axis=0).max())


def _across(hulls: Sequence[Hull], surface: Any) -> tuple[Array, NDArray[Any], Array]:
    """Vertices and triangles of a surface, and how far these are outside of each hull; where some lie within
    none of several hulls, those alone, cut into small ones.
    """
    points, faces = np.asarray(surface.vertices, float), np.asarray(surface.faces)
    beyond = _beyond(hulls, points, faces)
    across = beyond.min(axis=0) > _rounding(surface)
    if len(hulls) == 1 or not across.any():
        return points, faces, beyond
    trimesh = extra("trimesh", "meshes")
    points, faces = trimesh.remesh.subdivide_to_size(points, faces[across], _spacing(surface), max_iter=20)
    return points, faces, _beyond(hulls, points, faces)


def _spacing(surface: Any) -> float:
    """How long the edges are of triangles that lie across a cut, and how far halves overlap [m]."""
    return SPACING * float(np.linalg.norm(surface.extents))


def _rounding(surface: Any) -> float:
    """What a corner of a hull may be beyond its planes [m]."""
    return 1e-13 * float(np.linalg.norm(surface.extents))


def _beyond(hulls: Sequence[Hull], points: Array, faces: NDArray[Any]) -> Array:
    """How far triangles are outside of each hull (k, t) [m]: the corner that is so most."""
    return np.array([hull.outside(points)[faces].max(axis=1) for hull in hulls])


CUT = """
import signal, sys
import coacd, numpy as np
signal.signal(signal.SIGINT, signal.SIG_DFL)
coacd.set_log_level("off")
given = np.load(sys.argv[1])
parts = coacd.run_coacd(coacd.Mesh(given["points"], given["faces"]), max_convex_hull=int(sys.argv[3]))
np.savez(sys.argv[2], *(points for points, _ in parts))
"""


def _cut(surface: Any, pieces: int) -> list[Hull]:
    """The hulls of the parts that CoACD makes of a surface, in a process that Ctrl-C ends."""
    extra("coacd", "meshes")
    with tempfile.TemporaryDirectory() as folder:
        given, found, said = (Path(folder) / name for name in ("given.npz", "found.npz", "said.txt"))
        np.savez(given, points=surface.vertices, faces=surface.faces)
        with said.open("wb") as output:
            process = subprocess.Popen(
                [sys.executable, "-c", CUT, given, found, str(pieces)], stdout=output, stderr=output
            )
            try:
                while process.poll() is None:
                    time.sleep(0.02)
            finally:
                process.kill()
                process.wait()
        if process.returncode:
            raise InputError(f"CoACD cannot cut this mesh: {said.read_text(errors='replace')[-300:]}")
        with np.load(found) as parts:
            return [Hull(np.asarray(parts[name], float)) for name in parts]
