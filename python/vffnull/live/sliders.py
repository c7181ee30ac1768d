"""The sliders of the controller's settings: which there are, and what they show."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np

from vffnull.model.settings import setting

OF_THE_FIELD = {
    "gain": ("Field gain", 0.0, 6.0, 0.01, "How hard obstacles push; newtons at most if bounded"),
    "influence": ("Influence [m]", 0.01, 2.0, 0.01, "From how far away they push: the pale halos"),
}
"""Sliders of `controller.field`: label, ends, step and hint."""
OF_THE_CONTROLLER = {
    "stiffness": ("Stiffness [1/s²]", 0.0, 400.0, 1.0, "How fast the tip comes back to its target"),
    "damping": ("Damping [1/s]", 0.0, 60.0, 0.5, "How fast the tip's speed dies out"),
    "null_damping": ("Null damping [1/s]", 0.0, 30.0, 0.5, "How fast the links' own motion dies out"),
}
"""Those of `controller` itself."""
NO_FIELD = {"kind": "khatib", "gain": 0.0, "influence": 0.5}
"""What the controls show of a controller without a field."""


def put(control: Any, value: Any) -> None:
    """Set a control; viser's types take its values for read-only."""
    control.value = value


def slide(slider: Any, value: float) -> None:
    """Move a slider, and widen it if it has to."""
    if value > slider.max:
        slider.max = 2.0 * value
    if value < slider.min:
        slider.min = value
    put(slider, value)


def levels(settings: Mapping[str, Any]) -> dict[str, float]:
    """What the sliders show of settings of the controller."""
    field = settings["field"]
    return {
        "gain": field["gain"] or 1.0,
        "influence": field["influence"],
        **{key: first(said(settings, key)) for key in OF_THE_CONTROLLER},
    }


def said(controller: Mapping[str, Any], key: str) -> Any:
    """What settings of the controller say at a key, or the default of the key."""
    return setting({"controller": controller}, f"controller.{key}")


def unprojected(controller: Mapping[str, Any]) -> dict[str, Any]:
    """Settings of a controller whose field pushes the tip, too."""
    return {**copy.deepcopy(dict(controller)), "projection": "none"}


def first(value: Any) -> float:
    """A number, or the first of those that a setting gives per axis or joint."""
    return float(np.ravel(value)[0])
