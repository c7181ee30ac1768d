"""How an arm looks: the visual geometry of a URDF, which is for drawing alone."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Mapping
from functools import cache
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull.arms import _meshes
from vffnull.arms._read import options, solid_of
from vffnull.arms._urdf import text_of

if TYPE_CHECKING:
    from vffnull.arms._capsules import Solid

__all__ = ["surfaces"]


def surfaces(
    arm: Mapping[str, Any], urdf: str | os.PathLike[str], packages: _meshes.Packages | None = None
) -> dict[str, list[Solid]]:
    """What a URDF draws of an arm: surfaces by the name of their link, in its frame.

    Geometry of links that do not move of their own is that of the link that carries them.

    Parameters
    ----------
    arm : Mapping
        The explicit description of the arm.
    urdf : str or path
        A file, or the text itself, of a robot that has links of these names.
    packages : path, list of paths, or dict, optional
        Folders to search for ``package://``; with a dict the folder of each package by its name.

    Raises
    ------
    vffnull.errors.InputError
        If it is not that robot, draws nothing of it, or if a mesh is missing.
    ImportError
        If there are meshes and trimesh is not installed.
    """
    text, path = text_of("meshes", urdf)
    asked = options(arm["tip"], arm["base"], None, None, None, None, None, True, None)
    _core.read_urdf(text, asked)  # refuses what is no URDF before anybody else reads it
    reading = _core.read_urdf(_drawn(text), asked)
    names = [arm["base"], *(joint["link"] for joint in arm["joints"])]
    there = {joint["link"] for joint in reading["arm"]["joints"]}
    if missing := [name for name in names[1:] if name not in there]:
        raise InputError(
            f"meshes: {path or 'the URDF'} has no link {missing[0]!r} that moves, but the arm has"
        )
    folder = None if path is None else path.resolve().parent

    @cache
    def load(file: str, scale: tuple[float, ...]) -> Solid:
        return _meshes.read(_meshes.find(file, folder, packages), file, scale)

    found: dict[str, list[Solid]] = defaultdict(list)
    for item in reading["geometry"]:
        found[item["on"]].append(solid_of(item, lambda form, _: load(form["file"], tuple(form["scale"]))))
    if not any(name in found for name in names):
        raise InputError(f"meshes: {path or 'the URDF'} has no visual geometry")
    return dict(found)


def _drawn(text: str) -> str:
    """The URDF with its visual geometry in the place of what collides."""
    root = ElementTree.fromstring(text)
    for link in root.iter("link"):
        for each in link.findall("collision"):
            link.remove(each)
        for each in link.findall("visual"):
            each.tag = "collision"
            for material in each.findall("material"):
                each.remove(material)
    return ElementTree.tostring(root, encoding="unicode")
