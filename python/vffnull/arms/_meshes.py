"""Meshes of a model: where they are, and what is in them."""

from __future__ import annotations

import math
import os
import re
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError, InputTypeError
from vffnull.arms._capsules import Solid

__all__ = ["MissingMeshError", "Packages", "check_packages", "find", "read"]

Array = NDArray[Any]

Packages = str | os.PathLike[str] | Sequence[str | os.PathLike[str]] | Mapping[str, str | os.PathLike[str]]

MAX_BYTES = 128 << 20
"""Of a file of a mesh, unpacked: what trimesh makes of it takes twenty times as much."""

MAX_TRIANGLES = 1_000_000
"""Of a mesh: its hulls take kilobytes for each."""

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle in a binary STL."""
_PACKED = (".gz", ".bz2", ".xz", ".tar", ".tgz")
_METRES = {"meters": 1.0, "meter": 1.0, "millimeters": 1e-3, "centimeters": 1e-2, "inches": 0.0254}
_TIMES_METRES = re.compile(r"(\S+) \* meters")


class MissingMeshError(InputError):
    """A mesh that is not where the model says; a model can be read without."""


def check_packages(packages: object) -> None:
    """Refuse what names no folders, before a mesh is searched in them.

    Raises
    ------
    vffnull.errors.InputTypeError
        If it is neither a path, nor several.
    """
    named: Iterable[tuple[str, object]]
    if packages is None or isinstance(packages, (str, os.PathLike)):
        return
    if isinstance(packages, Mapping):
        named = ((f"packages[{name!r}]", each) for name, each in packages.items())
    elif isinstance(packages, Sequence):
        named = ((f"packages[{k}]", each) for k, each in enumerate(packages))
    else:
        raise InputTypeError(
            f"packages: expected a path, a list of paths, or a dict, got {type(packages).__name__}"
        )
    for place, each in named:
        if not isinstance(each, (str, os.PathLike)):
            raise InputTypeError(f"{place}: expected a path, got {type(each).__name__}")


def find(file: str, folder: Path | None, packages: Packages | None) -> Path:
    """The file of a mesh.

    Parameters
    ----------
    file : str
        As the model names it: ``package://name/rest``, ``model://name/rest``, ``file://``, absolute, or
        relative.
    folder : Path, optional
        Of the model.
    packages : path, list of paths, or dict, optional
        Folders to search; with a dict the folder of each package by its name.

    Raises
    ------
    MissingMeshError
        With the list of places where it was looked for.
    """
    tried: list[Path] = []
    for place in _places(file, folder, packages):
        if place in tried:
            continue
        tried.append(place)
        if place.is_dir():
            raise MissingMeshError(f"mesh {file!r} is a directory: {place}")
        if place.is_file():
            return place
    looked = "".join(f"\n  {place}" for place in tried) or " nowhere: the model is text without a folder"
    raise MissingMeshError(
        f"mesh {file!r} cannot be found; looked in{looked}\n"
        "packages= (in a shell --package) names folders to search"
    )


def _places(file: str, folder: Path | None, packages: Packages | None) -> Iterable[Path]:
    scheme, separator, rest = file.partition("://")
    named: Mapping[str, Any] = packages if isinstance(packages, Mapping) else {}
    roots = _roots(packages)
    if not separator or scheme == "file":
        path = Path(unquote(rest) if separator else file).expanduser()
        if path.is_absolute():
            yield path
            return
        if folder is not None:
            yield folder / path
        yield from (root / path for root in [*roots, *map(Path, named.values())])
        return
    if scheme not in ("package", "model"):
        raise MissingMeshError(
            f"mesh {file!r}: {scheme}:// is not fetched; package://, file:// and paths are"
        )
    package, _, inside = rest.partition("/")
    if package in named:
        yield Path(named[package]) / inside
    for root in roots:
        yield root / package / inside
        if root.name == package:
            yield root / inside
    for above in [folder, *folder.parents] if folder is not None else []:
        if above.name == package:
            yield above / inside
        yield above / package / inside
    for variable, share in (("ROS_PACKAGE_PATH", ""), ("AMENT_PREFIX_PATH", "share")):
        for listed in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            yield Path(listed) / share / package / inside


def _roots(packages: Packages | None) -> list[Path]:
    if packages is None or isinstance(packages, Mapping):
        return []
    if isinstance(packages, (str, os.PathLike)):
        return [Path(packages)]
    return [Path(each) for each in packages]


def read(path: Path, name: str, scale: Sequence[float]) -> Solid:
    """Vertices and triangles of a mesh in metres: STL, OBJ, PLY, DAE and what else trimesh reads.

    Raises
    ------
    ImportError
        If trimesh is not installed, and the file is another than a binary STL.
    vffnull.errors.InputError
        If the file holds no triangles, or too much, or cannot be read.
    """
    _check_size(path)
    points, triangles, unit = _binary_stl(path) or _by_trimesh(path)
    if len(triangles) == 0:
        raise InputError(f"mesh {path} holds no triangles")
    if len(triangles) > MAX_TRIANGLES:
        raise _too_many(path, len(triangles))
    if triangles.min() < 0 or triangles.max() >= len(points):
        wrong = triangles.max() if triangles.min() >= 0 else triangles.min()
        raise InputError(f"mesh {path} has a triangle with vertex {wrong}; there are {len(points)}")
    if not np.all(np.isfinite(points)):
        raise InputError(f"mesh {path} has vertices that are not finite")
    return Solid.mesh(name, points * (unit * np.asarray(scale, float)), triangles)


def _binary_stl(path: Path) -> tuple[Array, Array, float] | None:
    """What is in a binary STL; None of another file. Importing trimesh takes longer than all else."""
    if path.suffix.lower() != ".stl":
        return None
    data = path.read_bytes()
    count = int.from_bytes(data[80:84], "little")
    if len(data) != 84 + 50 * count:
        return None
    points = np.frombuffer(data, _FACET, count, 84)["corners"].astype(float).reshape(-1, 3)
    return points, np.arange(3 * count).reshape(-1, 3), 1.0


def _by_trimesh(path: Path) -> tuple[Array, Array, float]:
    """Vertices, triangles and the unit of length [m] as trimesh reads them."""
    try:
        import trimesh
    except ImportError as error:
        raise ImportError('meshes need trimesh: pip install "vffnull[meshes]"') from error
    try:
        scene = trimesh.load_scene(path, process=False)
        unit = _metres(scene.units or "meters") if path.suffix.lower() == ".dae" else 1.0
        mesh = scene.to_mesh()
        return np.array(mesh.vertices, float), np.array(mesh.faces, np.int64), unit
    except ImportError as error:
        raise ImportError(
            f'{path.suffix} needs another library: pip install "vffnull[meshes]" ({error})'
        ) from error
    except Exception as error:  # whatever a parser says of a broken file
        raise InputError(f"mesh {path} cannot be read: {error or type(error).__name__}") from error


def _metres(unit: str) -> float:
    """What a unit of length of a DAE file is [m]: a name, or as trimesh says it of one that has none."""
    times = _TIMES_METRES.fullmatch(unit)
    try:
        length = float(times[1]) if times else _METRES[unit]
    except (KeyError, ValueError):
        raise InputError(f"its unit of length is {unit[:40]!r}, which is none that is known") from None
    if not 0.0 < length < math.inf:
        raise InputError(f"its unit of length is {length:g} m")
    return length


def _check_size(path: Path) -> None:
    """Refuse what would take all memory, before it does."""
    size = path.stat().st_size
    if zipfile.is_zipfile(path):
        with zipfile.ZipFile(path) as archive:
            size = sum(member.file_size for member in archive.infolist())
    elif any(ending in _PACKED for ending in path.suffixes):
        raise InputError(f"mesh {path} is packed; unpack it first")
    if path.suffix.lower() == ".stl":
        with path.open("rb") as file:
            triangles = int.from_bytes(file.read(84)[80:], "little")
        if size == 84 + 50 * triangles and triangles > MAX_TRIANGLES:
            raise _too_many(path, triangles)
    if size > MAX_BYTES:
        raise InputError(
            f"mesh {path} has {size / 2**20:.0f} MB; at most {MAX_BYTES >> 20} MB are read: "
            "simplify it, in Blender or MeshLab for instance"
        )


def _too_many(path: Path, triangles: int) -> InputError:
    return InputError(
        f"mesh {path} has {triangles} triangles; at most {MAX_TRIANGLES} are read: simplify it, "
        "in Blender or MeshLab for instance"
    )
