"""`vffnull schema --json`: valid scenarios fit it, broken ones do not, and the core agrees about both."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from typing import Any

import jsonschema
import pytest

import vffnull as vff
from vffnull import _core
from waiting import HANG

SCHEMA = json.loads(_core.schema_json())
VALIDATOR = jsonschema.Draft7Validator(SCHEMA)

DISC = {"shape": {"kind": "circle", "radius": 0.2}, "position": [1.0, 1.0]}
LOOKING = {"avoidance": "cbf", "yielding": {"preview": {"trigger": 1.0, "candidates": 8}}}

# What no bundled scenario uses.
MORE: list[dict[str, Any]] = [
    {"arm.gravity": [0.0, -9.81], "arm.com": [0.5, [0.4, 0.1], 0.5], "arm.joint_limits": [-3.0, 3.0]},
    {"arm.joint_limits": [[-3, 3], [-2, 2], [-1, 1]], "plant.payload": 1, "plant.masses": [1, 2, 3]},
    {"controller": {"field": {"kind": "bounded", "gain": 3, "influence": 0.5, "sliding": 1.0}}},
    {"controller": {"avoidance": "cbf", "yielding": {"preview": {}}}},
    {"controller": LOOKING},
    {"controller": {"tank": {"capacity": 2.0}, "governor": {"inner": 0.01}, "characteristic_length": 0.5}},
    {"measurement": {"delay": 0.002, "position_noise": [0.1, 0.0, 0.0]}, "actuator": {"time_constant": 0.01}},
    {"perception": {"kind": "range", "sensors": 2, "rate": 100.0}, "simulation": {"control": "predictor"}},
    {"reference": {"kind": "circle", "center": [1, 1], "radius": 0.2, "angular_velocity": -1.0}},
    {"obstacles": [{**DISC, "motion": {"kind": "static"}}]},
    {"obstacles": [{**DISC, "contact": {}}, {**DISC, "contact": {"stiffness": 1e4, "friction": 0}}]},
    {"obstacles": [{**DISC, "motion": {"kind": "sinusoid", "amplitude": [0, 1], "angular_frequency": 2}}]},
]

BROKEN: list[tuple[str, dict[str, Any]]] = [
    ("controller.stifness", {"controller.stifness": 16.0}),
    ("duration", {"duration": "long"}),
    ("duration", {"duration": -1.0}),
    ("seed", {"seed": -1}),
    ("seed", {"seed": 0.5}),
    ("controller.avoidance", {"controller.avoidance": "cfb"}),
    ("controller.stiffness", {"controller.stiffness": [[16.0]]}),
    ("controller.stiffness", {"controller.stiffness": -1.0}),
    ("controller.stiffness", {"controller.stiffness": [16.0, -1.0]}),
    ("controller.yielding.margin", {"controller.yielding": {"margin": 0.0}}),
    ("controller.yielding.preview.alarm", {"controller.yielding": {"preview": {"alarm": 1.0}}}),
    ("controller.field", {"controller.field": {"kind": "khatib", "gain": 1.0}}),
    ("controller.tank", {"controller.tank": {}}),
    ("obstacles[0].shape", {"obstacles": [{"position": [0.0, 0.0]}]}),
    ("obstacles[0].shape", {"obstacles": [{"shape": {"kind": "ball", "radius": 1.0}}]}),
    ("obstacles[0].shape", {"obstacles": [{"shape": {"kind": "circle"}}]}),
    ("obstacles[0].contact.stiffness", {"obstacles": [{**DISC, "contact": {"stiffness": 0.0}}]}),
    ("obstacles[0].contact.softness", {"obstacles": [{**DISC, "contact": {"softness": 1.0}}]}),
    ("obstacles[0].position", {"obstacles": [{**DISC, "position": [0.0, 0.0, 0.0]}]}),
    ("reference", {"reference": {"kind": "line", "duration": 1.0}}),
    ("reference", {"reference": {"kind": "setpoint", "point": [1.0, 1.0], "speed": 1.0}}),
    ("simulation.control_every", {"simulation": {"control_every": 0}}),
    ("q0", {"q0": 1.0}),
]


def simple(changes: dict[str, Any]) -> dict[str, Any]:
    """A short scenario of three joints with these changes, by dotted key."""
    document: dict[str, Any] = {
        "duration": 0.1,
        "q0": [0.4, 0.5, -0.6],
        "arm": {"lengths": [1.0, 1.0, 1.0], "masses": 1.0},
        "reference": {"kind": "setpoint", "point": [1.5, 1.0]},
        "simulation": {"control": "hold"},
    }
    for path, value in copy.deepcopy(changes).items():
        *tables, key = path.split(".")
        inner = document
        for name in tables:
            inner = inner.setdefault(name, {})
        inner[key] = value
    return document


def test_it_is_a_schema() -> None:
    jsonschema.Draft7Validator.check_schema(SCHEMA)


def test_the_command_prints_it() -> None:
    command = [sys.executable, "-m", "vffnull", "schema", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, check=True)
    assert json.loads(done.stdout) == SCHEMA


@pytest.mark.parametrize("name", vff.scenarios())
def test_bundled_scenarios_fit(name: str) -> None:
    VALIDATOR.validate(vff.Scenario.load(name).to_dict())


@pytest.mark.parametrize("changes", MORE, ids=str)
def test_valid_documents_fit(changes: dict[str, Any]) -> None:
    document = simple(changes)
    _core.check("scenario", document)
    VALIDATOR.validate(document)


def test_cameras_fit_in_space_alone() -> None:
    camera = {"position": [0.0, 0.0, 2.0], "orientation": [0.0, 1.0, 0.0, 0.0], "rows": 6}
    looking = {"perception": {"kind": "camera", "cameras": [camera], "around": 3}}
    VALIDATOR.validate(
        vff.Scenario.load("panda-sweep").replace(**looking | {"simulation.control": "hold"}).to_dict()
    )
    assert not VALIDATOR.is_valid(simple(looking))
    del camera["orientation"]
    assert not VALIDATOR.is_valid(vff.Scenario.load("panda-sweep").to_dict() | looking)


@pytest.mark.parametrize(("path", "changes"), BROKEN, ids=str)
def test_broken_documents_do_not_fit(path: str, changes: dict[str, Any]) -> None:
    """Neither in the eyes of the core, which names the key."""
    document = simple(changes)
    assert not VALIDATOR.is_valid(document)
    with pytest.raises(vff.errors.ScenarioError) as caught:
        _core.check("scenario", document)
    assert path.rsplit(".", 1)[-1].split("[")[0] in str(caught.value)


@pytest.mark.parametrize("key", ["duration", "q0", "arm", "reference"])
def test_required_keys(key: str) -> None:
    document = simple({})
    del document[key]
    assert not VALIDATOR.is_valid(document)


def keys(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Every property in the schema that is not a table."""
    found = []
    for name, value in schema.get("properties", {}).items():
        found += keys(value)
        if name != "kind" and value.get("type") != "object" and "properties" not in value.get("items", {}):
            found.append({"name": name, **value})
    for inner in [
        *schema.get("oneOf", []),
        *schema.get("anyOf", []),
        *(schema[key] for key in ("then", "else") if key in schema),
        *([schema["items"]] if "items" in schema else []),
    ]:
        found += keys(inner)
    return found


def test_every_value_is_described() -> None:
    found = keys(SCHEMA)
    assert len(found) > 100
    silent = [value["name"] for value in found if not value.get("description")]
    assert silent == []
