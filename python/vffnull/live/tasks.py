"""What the end effector of an arm in space may have to keep, and a scenario with another one of them."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

from vffnull.model.scenario import Scenario

TASKS = ("position", "pointing", "pose")
_SIZES = {"position": 3, "pointing": 5, "pose": 6}
_ORIENTATIONS = ("orientation", "orientations", "start_orientation", "turning")


def with_task(scenario: Scenario, settings: Mapping[str, Any], task: str) -> Scenario:
    """The scenario with other settings of the controller and another task.

    A reference without orientations keeps the one of the tool at the start. Gains that are given per axis of
    the task are cut to their number or repeat the last one. Where the task leaves more or less than one
    degree of freedom, the look-ahead does without the search of the self-motion.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the task cannot be done.
    """
    document = scenario.to_dict()
    controller = copy.deepcopy(dict(settings)) | {"task": task}
    for key in ("stiffness", "damping"):
        given = controller.get(key)
        if isinstance(given, list):
            controller[key] = (given + given[-1:] * _SIZES[task])[: _SIZES[task]]
    preview = controller.get("yielding", {}).get("preview")
    if preview and len(document["q0"]) - _SIZES[task] != 1:
        preview.pop("self_motion", None)
    reference = dict(document["reference"])
    if task == "position":
        for key in _ORIENTATIONS:
            reference.pop(key, None)
    return scenario.replace(controller=controller, reference=reference)
