"""Arms of scenarios that stand in other files: ``[arm] urdf = "robot.urdf"``, ``mjcf = "robot.xml"``.

They are read once, before the core sees the scenario. It holds the explicit description that comes out, so
that it can be saved, sent and run again without the file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import vffnull._core as _core
from vffnull._support.errors import InputError, InputTypeError, ScenarioError
from vffnull.model.document import Document

__all__ = ["anchored", "explicit"]

_READ = (
    *("tip", "base", "locked", "tool", "mount", "gravity"),
    *("srdf", "packages", "armature", "fix_inertia", "pieces"),
)
"""What the reader of a URDF is told, and that of an MJCF, which names its meshes itself."""

_FILES = ("urdf", "mjcf")

_CHANGED = (
    *("name", "payload", "reach", "load"),
    *("joint_limits", "velocity_limits", "torque_limits", "ignore"),
)
"""What replaces what was read, or is added to it: the core checks it."""


def anchored(document: Document, folder: Path) -> Document:
    """The document itself, the files that its arm names relative to a folder named from there."""
    arm = document.get("arm")
    if not isinstance(arm, dict) or arm.keys().isdisjoint(_FILES):
        return document
    for key in (*_FILES, "srdf"):
        if isinstance(arm.get(key), str) and not _is_text(arm[key]):
            arm[key] = _from(folder, arm[key])
    match arm.get("packages"):
        case str(one):
            arm["packages"] = _from(folder, one)
        case list(several):
            arm["packages"] = [_from(folder, each) for each in several]
        case dict(named):
            arm["packages"] = {name: _from(folder, each) for name, each in named.items()}
    return document


def explicit(document: Document) -> Document:
    """The document itself, its arm as the explicit description where it is in another file.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the file cannot be read, or is not what it should be.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        Of what is odd in the file but allowed.
    """
    arm = document.get("arm") if isinstance(document, dict) else None
    if isinstance(arm, dict):
        if not arm.keys().isdisjoint(_FILES):
            document["arm"] = _read(arm)
        elif ("model" in arm or "joints" in arm) and isinstance(arm.get("collision"), str):
            document["arm"] = _without_word(arm)
    return document


def _without_word(arm: Mapping[str, Any]) -> Document:
    """An arm whose shapes are known, with what a word says of them."""
    word = arm["collision"]
    rest = {key: value for key, value in arm.items() if key != "collision"}
    if word == "none":
        return rest | {"collision": []}
    if word == "fit" and "model" in arm:  # they are fitted
        return rest
    allowed = "'fit', 'none' or a list of shapes" if "model" in arm else "'none' or a list of shapes"
    raise ScenarioError(f"arm.collision: without a URDF expected {allowed}, got {word!r}", "arm.collision")


def _read(arm: Mapping[str, Any]) -> Document:
    """The explicit description of an arm in a URDF or an MJCF."""
    kind = "urdf" if "urdf" in arm else "mjcf"
    for key in ("model", "joints", "mjcf"):
        if key in arm and key != kind:
            raise ScenarioError(
                f"arm.{key}: the {kind.upper()} says which arm it is: give `{kind}` or `{key}`", f"arm.{key}"
            )
    reads = tuple(key for key in _READ if kind == "urdf" or key != "packages")
    known = (kind, "collision", *reads, *_CHANGED)
    if strange := sorted(set(arm) - set(known)):
        allowed = ", ".join(f"`{key}`" for key in known)
        raise ScenarioError(f"arm: unknown key `{strange[0]}` beside `{kind}`; allowed: {allowed}", "arm")
    shapes = arm.get("collision", "fit")
    asked = {key: arm[key] for key in reads if key in arm}
    how: Any = shapes if isinstance(shapes, str) else "none"
    try:
        read = _core.Arm.from_urdf if kind == "urdf" else _core.Arm.from_mjcf
        found = read(arm[kind], collision=how, **asked).to_dict()
        changes = {key: arm[key] for key in _CHANGED if key in arm}
        if not isinstance(shapes, str):
            changes["collision"] = shapes
        if isinstance(more := changes.get("ignore"), list | tuple):
            changes["ignore"] = [*found.get("ignore", []), *more]
        return found | changes
    except (InputError, InputTypeError) as error:
        text = str(error).removeprefix(f"{kind}: ").replace("use from_mjcf", "`[arm] mjcf = …` reads it")
        raise ScenarioError(f"arm.{kind}: {text}", f"arm.{kind}") from None


def _from(folder: Path, path: Any) -> Any:
    """A path as seen from here; what is none is for the reader to refuse."""
    return os.path.join(folder, path) if isinstance(path, str) else path


def _is_text(given: str) -> bool:
    """Whether it is a URDF itself, and no name of one."""
    return given.lstrip("\ufeff \t\r\n").startswith("<")
