"""No setting is said twice: Python's controller settings and the sliders are those of the core."""

from __future__ import annotations

import json
import re
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest

import vffnull as vff
from vffnull import _core
from vffnull.model.control import Document
from vffnull.model.settings import default, setting

SCHEMA = json.loads(_core.schema_json())
CONTROLLER: dict[str, Any] = SCHEMA["else"]["properties"]["controller"]["properties"]
NAMES = {"ArrayLike": Any, "Document": Document}


def choices(hint: Any) -> set[str]:
    """The names that an annotation allows."""
    if get_origin(hint) is Literal:
        return set(get_args(hint))
    return set().union(*map(choices, get_args(hint)))


def test_the_controller_has_the_keys_of_the_core_and_their_choices() -> None:
    hints = get_type_hints(vff.ControlSettings, localns=NAMES)
    assert {f.name for f in fields(vff.ControlSettings)} == set(CONTROLLER)
    compared = 0
    for key, schema in CONTROLLER.items():
        if "enum" in schema:
            assert choices(hints[key]) == set(schema["enum"]), key
            compared += 1
    assert compared >= 4


def test_the_controller_leaves_every_default_to_the_core() -> None:
    assert vff.ControlSettings().to_dict() == {}
    text = vff.ControlSettings.__doc__ or ""
    assert "default:" not in text.lower()


def test_units_are_those_of_the_core() -> None:
    compared = 0
    for key, schema in CONTROLLER.items():
        unit = re.search(r" (\[[^\] ]+\])(; default|$)", schema.get("description", ""))
        if unit is not None and "enum" not in schema:
            assert unit[1] in getattr(vff.ControlSettings, key).__doc__, key
            compared += 1
    assert compared >= 5


def test_a_field_has_the_keys_and_defaults_of_the_core() -> None:
    of_core = CONTROLLER["field"]["properties"]
    assert {f.name for f in fields(vff.Field)} == set(of_core)
    for each in fields(vff.Field):
        if isinstance(each.default, float):
            assert each.default == of_core[each.name]["default"], each.name


def test_what_is_not_said_is_the_default_of_the_core() -> None:
    document = vff.Scenario.load("swing").to_dict()
    document["simulation"] = {"dt": 0.002}
    assert setting(document, "simulation.dt") == 0.002
    assert setting(document, "simulation.integrator") == "rk4"
    assert default("controller.yielding.margin") == 0.02
    assert default("obstacles.contact.friction") == 0.5
    with pytest.raises(KeyError):
        default("controller.stifness")
    # The core runs with what it says: the run with every default written down is the run without.
    short = vff.Scenario.load("swing").replace(duration=0.05)
    controller = short.to_dict()["controller"]
    said = {
        f"controller.{key}": schema["default"]
        for key, schema in CONTROLLER.items()
        if "default" in schema and key not in controller
    }
    assert {"controller.singularity", "controller.projection"} <= set(said)
    assert np.array_equal(vff.simulate(short).tau, vff.simulate(short.replace(**said)).tau)


def test_sliders_have_units_ranges_and_defaults_of_the_core() -> None:
    panel = pytest.importorskip("vffnull.live.panel")
    sliders = pytest.importorskip("vffnull.live.sliders")
    levels = sliders.levels({"field": sliders.NO_FIELD})
    for key, (label, low, high, _, _) in sliders.OF_THE_CONTROLLER.items():
        assert levels[key] == CONTROLLER[key]["default"]
        assert low <= levels[key] <= high
        number = CONTROLLER[key]["anyOf"][0]
        assert low >= number["minimum"]
        unit = label[label.index("[") :]
        assert CONTROLLER[key]["description"].endswith(unit), key
    of_field = CONTROLLER["field"]["properties"]
    for key, (_, low, _, _, _) in sliders.OF_THE_FIELD.items():
        assert low >= of_field[key].get("minimum", of_field[key].get("exclusiveMinimum"))
    assert set(panel.WAYS.values()) == set(CONTROLLER["avoidance"]["enum"])
