"""All faults of a scenario document, where the core stops at the first."""

from __future__ import annotations

import copy
import re
from typing import Any, Literal

import vffnull._core as _core
from vffnull._support.errors import ScenarioError
from vffnull.model.arm import arm_of, dimension_of, is_spatial
from vffnull.model.document import Document, dotted

__all__ = ["faults"]

_Part = Literal["scenario", "arm", "controller", "obstacle"]

_NEEDED = ("duration", "q0", "arm", "reference")
_MOST = 50


def faults(document: Document) -> list[str]:
    """Every fault that can be found without taking the consequence of one for another.

    Every key is looked at by itself, in a scenario that is sound but for it; then the whole, for what does
    not go together, with something sound in the place of what is wrong.

    Parameters
    ----------
    document : dict
        The scenario.

    Returns
    -------
    list of str
        A sentence each, with the dotted path of the key in front; empty if the scenario can be run.
    """
    try:
        _core.check("scenario", document)
        return []
    except ScenarioError as error:
        first = str(error)
    found: list[str] = []
    given = copy.deepcopy(document)
    arm = given.get("arm")
    dimension = None  # each part says for itself, as far as it can
    if isinstance(arm, dict) and (is_spatial(arm) or "lengths" in arm):
        dimension = dimension_of(arm)
    obstacles = given.get("obstacles")
    if isinstance(obstacles, list) and all(isinstance(each, dict) for each in obstacles):
        judged = [
            _check("obstacle", each, f"obstacles[{i}]", dimension)[0] for i, each in enumerate(obstacles)
        ]
        found += [fault for part in judged for fault in part]
        given["obstacles"] = [each for each, bad in zip(obstacles, judged, strict=True) if not bad]
    sound = False
    if isinstance(arm, dict):
        wrong, sound = _check("arm", arm, "arm", dimension)
        found += wrong
    base = _sound(arm if sound and isinstance(arm, dict) else None, given, dimension)
    if base is None:
        return [*found, first] if not found else found
    if isinstance(controller := given.get("controller"), dict):
        wrong_law, law = _check("controller", controller, "controller", dimension)
        found += wrong_law
        if not law:
            given["controller"] = {key: controller[key] for key in ("task",) if key in controller}
    for key in [*given, *(key for key in _NEEDED if key not in given)]:
        meant = any(f"did you mean `{key}`" in fault for fault in found)
        if (key == "arm" and isinstance(arm, dict)) or (key not in given and meant):
            continue
        beside = base
        if key == "reference":
            beside = {**base, "controller": _task(given)}
        elif key == "replan":
            plan = {"kind": "plan", "times": [0.0, 1.0], "points": [base["q0"], base["q0"]]}
            beside = {**base, "reference": plan}
        trial = {name: value for name, value in beside.items() if name != key}
        if key in given:
            trial[key] = given[key]
        wrong, mended = _check("scenario", trial, "", None, key)
        found += wrong
        if mended:
            given = {name: value for name, value in given.items() if name != key or key in trial}
            given |= {key: trial[key]} if key in trial else {}
        else:
            given = {name: value for name, value in given.items() if name != key}
    if not sound:
        given["arm"] = base["arm"]
    found += _together({**base, **given}, base)
    return list(dict.fromkeys(found)) or [first]


def _task(document: Document) -> dict[str, Any]:
    """The controller's task, which decides what a reference has to say."""
    controller = document.get("controller")
    return {"task": controller["task"]} if isinstance(controller, dict) and "task" in controller else {}


def _sound(arm: Document | None, document: Document, dimension: int | None) -> Document | None:
    """The least that can be run: with this arm, or one of as many joints as seem to be meant."""
    table = document.get("arm")
    counted = [table.get(key) for key in ("lengths", "masses", "joints")] if isinstance(table, dict) else []
    lists = [each for each in (*counted, document.get("q0")) if isinstance(each, list) and each]
    count = len(lists[0]) if lists else 3
    if arm is None and dimension == 3:
        link = {"kind": "revolute", "mass": 1.0, "inertia": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0]}
        axes = ([0.0, 0.0, 1.0], [0.0, 1.0, 0.0])
        arm = {
            "joints": [
                {
                    "name": f"joint{i}",
                    "link": f"link{i}",
                    "axis": axes[i % 2],
                    "position": [0.0, 0.0, 0.3],
                    **link,
                }
                for i in range(count)
            ]
        }
    elif arm is None:
        arm = {"lengths": [1.0] * count, "masses": [1.0] * count}
    try:
        made = arm_of(arm)
        q0 = [0.3] * made.n
        if made.joint_limits is not None:
            q0 = [min(max(q, low), high) for q, (low, high) in zip(q0, made.joint_limits, strict=True)]
        base: Document = {"duration": 1.0, "q0": q0, "arm": arm, "reference": {"kind": "setpoint"}}
        if dimension != 3:
            base["reference"]["point"] = made.forward_kinematics(q0)[-1].tolist()
        _core.check("scenario", base)
    except (ScenarioError, ValueError):
        return None
    return base


def _check(
    kind: _Part, part: dict[str, Any], place: str, dimension: int | None, only: str | None = None
) -> tuple[list[str], bool]:
    """The faults of a part, each mended in it once it has been found; and whether the rest can be used.

    With `only`, what is said of other keys is a consequence, but for one that is unknown or missing.
    """
    found: list[str] = []
    taken: set[str] = set()
    for _ in range(_MOST):
        try:
            _core.check(kind, part, dimension)
            return found, True
        except ScenarioError as error:
            path, text = _path(error), str(error)
            if any(f"`{name.rpartition('.')[2]}`" in text for name in taken):
                break  # a consequence
            if only is not None and path.split(".")[0] != only and f"`{only}`" not in text:
                break
            if path not in taken:
                found.append(_with_place(place, error))
            if not path or "missing key" in text:
                break
            # Where all elements of a list are wrong, the list goes.
            path = path.rpartition(".")[0] if path in taken and path.rpartition(".")[2].isdecimal() else path
            if path in taken or not _mend(part, path, text):
                break
            taken.add(path)
    return found, False


def _together(whole: Document, base: Document) -> list[str]:
    """What does not go together in a document whose keys are sound by themselves."""
    found: list[str] = []
    for _ in range(_MOST):
        try:
            _core.check("scenario", whole)
            break
        except ScenarioError as error:
            key = _path(error).split(".")[0]
            found.append(str(error))
            if key not in whole or whole[key] == base.get(key):
                break
            whole = {name: value for name, value in whole.items() if name != key}
            whole |= {key: base[key]} if key in base else {}
    return found


def _path(error: ScenarioError) -> str:
    """The dotted path of the key to blame, an unknown one included."""
    path = dotted(error.path)
    unknown = re.search(r"unknown key `([^`]*)`", str(error))
    if unknown and path.rpartition(".")[2] != unknown[1]:
        path = f"{path}.{unknown[1]}" if path else unknown[1]
    return path


def _with_place(place: str, error: ScenarioError) -> str:
    text = str(error)
    if not place:
        return text
    return f"{place}.{text}" if error.path and text.startswith(error.path) else f"{place}: {text}"


def _mend(part: dict[str, Any], path: str, text: str) -> bool:
    """Call a key as was meant, give an element of a list the value of another, remove anything else.

    Returns whether there was something to mend.
    """
    *parents, last = path.split(".")
    meant = re.search(r"did you mean `([^`]*)`", text)
    inside: Any = part
    try:
        for key in parents:
            inside = inside[int(key) if isinstance(inside, list) else key]
        if isinstance(inside, list):
            at = int(last)
            if len(inside) > 1:
                inside[at] = copy.deepcopy(inside[at - 1])
            else:
                del inside[at]
        elif meant and meant[1] not in inside:
            inside[meant[1]] = inside.pop(last)
        else:
            del inside[last]
    except (KeyError, IndexError, ValueError, TypeError):
        return False
    return True
