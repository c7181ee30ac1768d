"""URDF to the explicit description of an arm."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull._support import files
from vffnull._support.errors import InputError, InputTypeError
from vffnull.arms import _meshes
from vffnull.arms._read import Collision, Pieces, finish, options, tell
from vffnull.arms._report import Report

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vffnull.arms._capsules import Solid

__all__ = ["from_urdf", "read_urdf"]

MAX_BYTES = 16 << 20
"""Of a model's text; the core has the same limit, but a file need not be loaded to be refused."""


def from_urdf(
    urdf: str | os.PathLike[str],
    tip: str | None = None,
    base: str | None = None,
    locked: Mapping[str, float] | None = None,
    tool: object = None,
    mount: object = None,
    gravity: ArrayLike | None = (0.0, 0.0, -9.81),
    collision: Collision = "fit",
    srdf: str | os.PathLike[str] | None = None,
    packages: _meshes.Packages | None = None,
    armature: ArrayLike | None = None,
    fix_inertia: bool = False,
    pieces: Pieces = 1,
) -> dict[str, Any]:
    """The explicit description of a serial arm in a URDF.

    Parameters
    ----------
    urdf : str or path
        A file, or the text itself.
    tip : str, optional
        The link where the chain ends; the only link without children by default.
    base : str, optional
        The link where it begins; the root by default.
    locked : dict, optional
        Joints that do not move and where they stand [rad or m]. Joints off the chain are locked anyway,
        at 0 unless they are named here, and their bodies become part of the link that carries them.
    tool : (3,) array_like, (position, quaternion), or dict, optional
        A frame in that of the link `tip`, where the end effector is [m]; quaternions are [w, x, y, z].
    mount : the same, optional
        Where the base stands in the world.
    gravity : (3,) array_like, optional
        In the world [m/s²].
    collision : {"fit", "file", "none"}, optional
        Capsules of least volume around every collision geometry: few shapes, which are measured fastest. Or
        the geometry as it is in the file, for flat or boxy parts and grippers: boxes, balls, a cylinder with
        a ball at both ends as one capsule; another cylinder as the prism of 16 sides around it, which has
        1.3 % more volume, or as a capsule if that has less; meshes as their convex hulls, those of more than
        64 corners as larger ones of at most 64, a few percent in volume. `read_urdf` tells how much larger
        each is. Or nothing.
    srdf : str or path, optional
        A file, or the text: pairs of links that it switches off are not measured against each other, and no
        others. Without it, those whose shapes overlap nearly always are not, with a warning.
    packages : path, list of paths, or dict, optional
        Folders in which meshes are searched, or the folder of each package by its name.
    armature : float or (n,) array_like, optional
        Inertia of the rotors as seen by the joints [kg·m²]; URDF has none.
    fix_inertia : bool, optional
        Whether inertia tensors that no distribution of mass has are replaced by the nearest possible
        ones, with a warning, instead of refused.
    pieces : int or dict, optional
        With ``collision="file"``: the most convex hulls that each mesh may become, or those of the links that
        are named, such as ``{"forearm_link": 4}``. One hull fills every hollow of a mesh, and one with 64
        corners is millimetres larger than what is round. Bodies become pieces; CoACD cuts those that have a
        hollow, which takes seconds to minutes and is kept for the next time; round ones are halved while
        there may be more. Nothing of a mesh sticks out of its hulls.

    Returns
    -------
    dict
        The ``[arm]`` of a scenario, complete: no other file is needed.

    Raises
    ------
    vffnull.errors.InputError
        If the text is no URDF, or what is asked for is no arm; the message says which link or joint.
    ImportError
        If meshes have to be read and the extra ``meshes`` is not installed.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        Of what is odd but allowed: locked joints, missing limits.

    Examples
    --------
    >>> from vffnull import arms
    >>> text = '''<robot name="rod"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 0.5"/>
    ...   <mass value="1"/><inertia ixx="0.08" iyy="0.08" izz="0.001"/></inertial></link>
    ...   <joint name="hinge" type="continuous"><parent link="base"/><child link="rod"/>
    ...   <axis xyz="0 1 0"/><limit effort="5" velocity="2"/></joint></robot>'''
    >>> arm = arms.from_urdf(text, collision="none")
    >>> arm["joints"][0]["name"], arm["torque_limits"]
    ('hinge', [5.0])
    """
    where = (tip, base, locked, tool, mount, gravity)
    return tell(read_urdf(urdf, *where, collision, srdf, packages, armature, fix_inertia, pieces))


def read_urdf(
    urdf: str | os.PathLike[str],
    tip: str | None = None,
    base: str | None = None,
    locked: Mapping[str, float] | None = None,
    tool: object = None,
    mount: object = None,
    gravity: ArrayLike | None = (0.0, 0.0, -9.81),
    collision: Collision = "fit",
    srdf: str | os.PathLike[str] | None = None,
    packages: _meshes.Packages | None = None,
    armature: ArrayLike | None = None,
    fix_inertia: bool = False,
    pieces: Pieces = 1,
) -> Report:
    """The same as `from_urdf`, with everything that there is to say about it, and no warnings.

    Parameters
    ----------
    urdf, tip, base, locked, tool, mount, gravity, collision, srdf, packages, armature, fix_inertia, pieces
        As in `from_urdf`.

    Returns
    -------
    Report
        The document, what is odd, and how tight the shapes of the links are.
    """
    text, path = text_of("urdf", urdf)
    _meshes.check_packages(packages)
    pairs = None if srdf is None else text_of("srdf", srdf)[0]
    asked = options(tip, base, locked, tool, mount, gravity, armature, fix_inertia, pairs)
    reading = _core.read_urdf(text, asked)
    folder = None if path is None else path.resolve().parent

    @cache
    def load(file: str, scale: tuple[float, ...]) -> Solid:
        return _meshes.read(_meshes.find(file, folder, packages), file, scale)

    def mesh(form: Mapping[str, Any], name: str) -> Solid:
        try:
            return load(form["file"], tuple(form["scale"]))
        except _meshes.MissingMeshError as error:
            raise _meshes.MissingMeshError(f"{name.partition(':')[0]}: {error}") from None

    return finish(reading, collision, pieces, mesh, str(path or "URDF"), srdf is not None)


def text_of(name: str, given: str | os.PathLike[str]) -> tuple[str, Path | None]:
    """The text, and the file that it comes from."""
    if isinstance(given, str) and given.lstrip("\ufeff \t\r\n").startswith("<"):
        return given, None
    if not isinstance(given, (str, os.PathLike)):
        raise InputTypeError(f"{name}: expected a path or text, got {type(given).__name__}")
    if isinstance(given, str) and not given.strip():
        raise InputError(f"{name}: is empty")
    path = Path(given)
    try:
        return files.read_text(path, MAX_BYTES, "utf-8-sig"), path
    except OSError as error:
        raise InputError(f"{name}: {path}: {error.strerror or error}") from None
    except (UnicodeDecodeError, ValueError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{name}: {str(path)[:200]} is no file of text in UTF-8") from None
