"""All faults of a scenario document, where the core stops at the first."""

from __future__ import annotations

import copy
import re
from typing import Any, Literal

from vffnull import _core
from vffnull._arm import is_spatial
from vffnull._document import Document
from vffnull.errors import ScenarioError

__all__ = ["faults"]

_Part = Literal["scenario", "arm", "controller", "simulation", "reference", "obstacle"]

_PARTS: tuple[_Part, ...] = ("arm", "controller", "simulation", "reference")
_NEEDED = ("arm", "reference", "q0", "duration")
_MOST = 50


def faults(document: Document) -> list[str]:
    """Every fault that can be found without taking the consequence of one for another.

    Parts that can be checked on their own are checked first, then the whole without what was wrong in them.
    Where the arm or the reference is wrong, the whole is not checked.

    Parameters
    ----------
    document : dict
        The scenario.

    Returns
    -------
    list of str
        A sentence each, with the dotted path of the key in front; empty if the scenario can be run.
    """
    rest = copy.deepcopy(document)
    found: list[str] = []
    arm = rest.get("arm")
    dimension = None  # each part says for itself, as far as it can
    if isinstance(arm, dict) and (is_spatial(arm) or "lengths" in arm):
        dimension = 3 if is_spatial(arm) else 2
    if isinstance(rest.get("obstacles"), list):
        sound = []
        for i, obstacle in enumerate(rest["obstacles"]):
            place = f"obstacles[{i}]"
            wrong = _check("obstacle", obstacle, place, dimension)[0] if isinstance(obstacle, dict) else []
            found += wrong
            sound += [] if wrong else [obstacle]
        rest["obstacles"] = sound
    whole = True
    for name in _PARTS:
        part = rest.get(name)
        if isinstance(part, dict):
            wrong, mended = _check(name, part, name, dimension)
            found += wrong
            if not mended and name in _NEEDED:
                whole = False
            elif not mended:  # defaults in its place, but for the number of the task's axes
                rest[name] = {key: part[key] for key in ("task",) if key in part}
    if whole:
        found += _check("scenario", rest, "", dimension)[0]
    return list(dict.fromkeys(found))


def _check(kind: _Part, part: dict[str, Any], place: str, dimension: int | None) -> tuple[list[str], bool]:
    """The faults of a part, each taken out of it once it has been found; and whether the rest can be used."""
    found: list[str] = []
    taken: set[str] = set()
    for _ in range(_MOST):
        try:
            _core.check(kind, part, dimension)
            return found, True
        except ScenarioError as error:
            path = _path(error)
            if any(f"`{name.rpartition('.')[2]}`" in str(error) for name in taken) or path in taken:
                break  # a consequence
            found.append(_with_place(place, error))
            if not path or (not place and path.split(".")[0] in _NEEDED) or not _take_out(part, path):
                break
            taken.add(path)
    return found, False


def _path(error: ScenarioError) -> str:
    """The dotted path of the key to blame, an unknown one included."""
    path = re.sub(r"\[(\d+)\]", r".\1", error.path)
    unknown = re.search(r"unknown key `([^`]*)`", str(error))
    if unknown and path.rpartition(".")[2] != unknown[1]:
        path = f"{path}.{unknown[1]}" if path else unknown[1]
    return path


def _with_place(place: str, error: ScenarioError) -> str:
    text = str(error)
    if not place:
        return text
    return f"{place}.{text}" if error.path and text.startswith(error.path) else f"{place}: {text}"


def _take_out(part: dict[str, Any], path: str) -> bool:
    """Remove a key; whether there was one."""
    *parents, last = path.split(".")
    inside: Any = part
    try:
        for key in parents:
            inside = inside[int(key) if isinstance(inside, list) else key]
        del inside[int(last) if isinstance(inside, list) else last]
    except (KeyError, IndexError, ValueError, TypeError):
        return False
    return True
