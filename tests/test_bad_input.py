"""Bad input gets one clear error that names the field, before anything runs; bad runs get a status.

ARCHITECTURE.md: errors are for bad input, outcomes are values, and no panic reaches Python.
"""

from __future__ import annotations

import copy
import json
import math
import re
import warnings
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vffnull as vff
from vffnull.errors import InputError, InputTypeError, ScenarioError, ScenarioWarning, VffNullError
from waiting import HANG

NAN, INF = math.nan, math.inf


def valid() -> dict[str, Any]:
    """A small scenario with everything in it, to be broken."""
    return {
        "name": "small",
        "duration": 0.05,
        "q0": [0.3, 0.6, -0.9],
        "dq0": [0.0, 0.1, 0.0],
        "arm": {
            "lengths": [1.0, 0.8, 0.6],
            "masses": [1.0, 0.7, 0.5],
            "radius": 0.02,
            "gravity": 9.81,
            "com": [[0.5, 0.0], [0.4, 0.01], [0.3, 0.0]],
            "inertias": 0.1,
            "joint_limits": [-3.0, 3.0],
            "torque_limits": 200.0,
        },
        "controller": {
            "stiffness": [100.0, 100.0],
            "damping": 20.0,
            "null_damping": 2.0,
            "posture": [0.0, 0.5, -0.5],
            "posture_stiffness": 0.2,
            "field": {"kind": "khatib", "gain": 0.1, "influence": 0.4, "floor": 0.05},
        },
        "reference": {"kind": "line", "end": [1.5, 0.8], "duration": 1.0},
        "obstacles": [
            {
                "shape": {"kind": "circle", "radius": 0.1},
                "position": [1.5, 1.5],
                "motion": {"kind": "linear", "velocity": [-0.1, 0.0]},
            },
            {
                "shape": {"kind": "polygon", "vertices": [[-0.1, -0.1], [0.1, -0.1], [0.0, 0.1]]},
                "position": [-1.0, 0.5],
                "motion": {"kind": "waypoints", "times": [0.0, 1.0], "points": [[-1.0, 0.5], [-1.0, 1.0]]},
            },
            {"shape": {"kind": "box", "size": [0.2, 0.1]}, "position": [0.5, -1.0], "angle": 0.3},
            {
                "shape": {"kind": "capsule", "a": [-0.1, 0.0], "b": [0.1, 0.0], "radius": 0.05},
                "position": [1.0, -1.0],
                "motion": {"kind": "sinusoid", "amplitude": [0.1, 0.0], "angular_frequency": 1.0},
            },
        ],
        "simulation": {
            "dt": 1e-3,
            "integrator": "rk4",
            "control": "hold",
            "control_every": 1,
            "record_every": 5,
        },
    }


def broken(name: str, value: Any) -> dict[str, Any]:
    document = valid()
    place: Any = document
    *parents, last = name.split(".")
    for key in parents:
        place = place[int(key) if isinstance(place, list) else key]
    place[int(last) if isinstance(place, list) else last] = value
    return document


def test_numbers_beyond_all_reason_are_no_traceback() -> None:
    """What is odd about them cannot be told; how the run ends can."""
    scenario = broken("controller.null_damping", 1e-320)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ScenarioWarning)
        assert vff.simulate(scenario).status in list(vff.Status)


def test_the_valid_one_is_valid() -> None:
    result = vff.simulate(valid())
    assert result.status == "completed", result.message


def only_one_of_ours(call: Callable[[], object]) -> VffNullError:
    """The error that a call raises, which has to be exactly one of the package's leaf classes."""
    with pytest.raises(VffNullError) as caught:
        call()
    assert type(caught.value) in (ScenarioError, InputError, InputTypeError)
    assert isinstance(caught.value, ValueError) != isinstance(caught.value, TypeError)
    assert str(caught.value).strip(), "an error without a message"
    return caught.value


WRONG = [
    # key, value, path in the message, what the message says
    ("controller", [], "controller", "expected a table, got a list"),
    ("controller", ["position"], "controller", "expected a table, got a list"),
    ("controller.field", [], "controller.field", "table"),
    ("plant", [], "plant", "expected a table, got a list"),
    ("simulation", [], "simulation", "expected a table, got a list"),
    ("arm", [], "arm", "table"),
    ("duration", 0.0, "duration", "greater than 0"),
    ("duration", -1.0, "duration", "greater than 0"),
    ("duration", NAN, "duration", "finite"),
    ("duration", INF, "duration", "finite"),
    ("duration", "long", "duration", "number"),
    ("duration", True, "duration", "number"),
    ("duration", [1.0], "duration", "number"),
    ("duration", 1e-4, "duration", "step"),
    ("duration", 1e90, "duration", "steps"),
    ("duration", 1e300, "duration", "at most 1e100"),
    ("q0", [0.1, 0.2], "q0", "expected 3 values, got 2"),
    ("q0", [0.1] * 4, "q0", "expected 3 values, got 4"),
    ("q0", [], "q0", "expected 3 values, got 0"),
    ("q0", 0.3, "q0", "list"),
    ("q0", "straight", "q0", "list"),
    ("q0", [0.1, NAN, 0.2], "q0[1]", "finite"),
    ("q0", [0.1, "x", 0.2], "q0[1]", "number"),
    ("q0", [[0.1, 0.2, 0.3]], "q0[0]", "number"),
    ("dq0", [0.1], "dq0", "expected 3 values, got 1"),
    ("dq0", [0.1, -INF, 0.2], "dq0[1]", "finite"),
    ("arm.lengths", [], "arm.lengths", "at least one"),
    ("arm.lengths", [1.0, 0.0, 0.6], "arm.lengths[1]", "greater than 0"),
    ("arm.lengths", [1.0, -0.8, 0.6], "arm.lengths[1]", "greater than 0"),
    ("arm.lengths", [1.0, NAN, 0.6], "arm.lengths[1]", "finite"),
    ("arm.masses", -1.0, "arm.masses", "greater than 0"),
    ("arm.masses", [1.0, 0.7, -0.5], "arm.masses[2]", "greater than 0"),
    ("arm.masses", [1.0, 0.7], "arm.masses", "expected 3 values, got 2"),
    ("arm.masses", "heavy", "arm.masses", "number"),
    ("arm.inertias", -0.1, "arm.inertias", "0 or more"),
    ("arm.radius", [-0.1, 0.0, 0.0], "arm.radius[0]", "0 or more"),
    ("arm.com", [0.5, 0.4], "arm.com", "expected 3 values, got 2"),
    ("arm.com", [[0.5, 0.0], [0.4, 0.0, 0.0], [0.3, 0.0]], "arm.com[1]", ""),
    ("arm.gravity", [0.0, 0.0, -9.81], "arm.gravity", ""),
    ("arm.gravity", "earth", "arm.gravity", "number"),
    ("arm.joint_limits", [[0.0, 1.0], [1.0, -1.0], [0.0, 1.0]], "arm.joint_limits[1]", "lower < upper"),
    ("arm.torque_limits", 0.0, "arm.torque_limits", "greater than 0"),
    ("arm", 5, "arm", "table"),
    ("controller.stiffness", -1.0, "controller.stiffness", "0 or more"),
    ("controller.stiffness", [1.0, 2.0, 3.0], "controller.stiffness", "expected 2 values, got 3"),
    ("controller.damping", "soft", "controller.damping", "number"),
    ("controller.damping", True, "controller.damping", "number"),
    ("controller.null_damping", [1.0, 2.0], "controller.null_damping", "expected 3 values, got 2"),
    ("controller.posture", [0.0], "controller.posture", "expected 3 values, got 1"),
    ("controller.posture_stiffness", -1.0, "controller.posture_stiffness", "0 or more"),
    ("controller.singularity", 0.0, "controller.singularity", "greater than 0"),
    ("controller.field.gain", -0.1, "controller.field.gain", "0 or more"),
    ("controller.field.gain", None, "controller.field", "gain"),
    ("controller.field.influence", 0.0, "controller.field.influence", "greater than 0"),
    ("controller.field.floor", 0.5, "controller.field.floor", "0.4"),
    ("controller.field.floor", 0.0, "controller.field.floor", "between 0"),
    ("controller.field.approach_damping", -1.0, "controller.field.approach_damping", "0 or more"),
    ("controller.field.sliding", -1.0, "controller.field.sliding", "0 or more"),
    ("obstacles", {"shape": 1}, "obstacles", "list"),
    ("obstacles.0", 3, "obstacles[0]", "table"),
    ("obstacles.0.shape.radius", 0.0, "obstacles[0].shape.radius", "greater than 0"),
    ("obstacles.0.shape.radius", NAN, "obstacles[0].shape.radius", "finite"),
    ("obstacles.0.position", [1.0], "obstacles[0].position", "expected 2 values, got 1"),
    ("obstacles.0.position", [1.0, 2.0, 3.0], "obstacles[0].position", "expected 2 values, got 3"),
    ("obstacles.0.motion.velocity", 1.0, "obstacles[0].motion.velocity", "2"),
    ("obstacles.0.shape", None, "obstacles[0]", "shape"),
    (
        "obstacles.1.shape.vertices",
        [[0, 0], [1, 0], [0.2, 0.2], [0, 1]],
        "obstacles[1].shape.vertices",
        "convex",
    ),
    ("obstacles.1.shape.vertices", [[0, 0], [1, 0]], "obstacles[1].shape.vertices", "convex"),
    ("obstacles.1.shape.vertices", [[0, 0], [1, 1], [2, 2]], "obstacles[1].shape.vertices", "convex"),
    ("obstacles.1.shape.vertices", [], "obstacles[1].shape.vertices", "convex"),
    ("obstacles.1.shape.vertices", [[0, 0, 0]] * 3, "obstacles[1].shape.vertices[0]", "2"),
    ("obstacles.1.motion.times", [1.0, 1.0], "obstacles[1].motion.times[1]", "later than"),
    ("obstacles.1.motion.times", [1.0, 0.5], "obstacles[1].motion.times[1]", "later than"),
    ("obstacles.1.motion.times", [], "obstacles[1].motion.times", "at least one"),
    ("obstacles.1.motion.points", [[-1.0, 0.5]], "obstacles[1].motion.points", "expected 2 values, got 1"),
    ("obstacles.2.shape.size", [0.2, 0.0], "obstacles[2].shape.size[1]", "greater than 0"),
    ("obstacles.2.shape.size", 0.2, "obstacles[2].shape.size", "2"),
    ("obstacles.3.shape.b", [-0.1, 0.0], "obstacles[3].shape.b", "another point"),
    ("obstacles.3.shape.radius", -0.1, "obstacles[3].shape.radius", "0 or more"),
    ("obstacles.3.motion.amplitude", [INF, 0.0], "obstacles[3].motion.amplitude[0]", "finite"),
    ("reference", None, "reference", "missing"),
    ("reference.end", [1.5], "reference.end", "2"),
    ("reference.duration", 0.0, "reference.duration", "positive"),
    ("reference", {"kind": "setpoint", "point": [9.0, 0.0]}, "reference", "2.4000 m"),
    ("reference", {"kind": "table", "times": [0.0], "points": [[1.0, 0.5]]}, "reference.times", "2"),
    (
        "reference",
        {"kind": "table", "times": [0.0, 0.0], "points": [[1.0, 0.5]] * 2},
        "reference.times[1]",
        "increase",
    ),
    (
        "reference",
        {"kind": "waypoints", "times": [0.0, 1.0], "points": [[1.0, 0.5]]},
        "reference.points",
        "2",
    ),
    ("reference", {"kind": "setpoint", "point": [1.0, 0.5, 0.1]}, "reference.point", "2"),
    ("reference", {"kind": "polynomial", "coefficients": [[1.0]]}, "reference.coefficients", "2"),
    ("simulation.dt", 0.0, "simulation.dt", "greater than 0"),
    ("simulation.dt", -1e-3, "simulation.dt", "greater than 0"),
    ("simulation.dt", NAN, "simulation.dt", "finite"),
    ("simulation.record_every", 0, "simulation.record_every", "1 or more"),
    ("simulation.record_every", -2, "simulation.record_every", "whole number"),
    ("simulation.record_every", 1.5, "simulation.record_every", "whole number"),
    ("simulation.record_every", True, "simulation.record_every", "whole number"),
    ("simulation.control_every", 0, "simulation.control_every", "1 or more"),
    ("simulation.record_every", 2**70, "simulation.record_every", "64 bits"),
    ("q0", [2**70, 0, 0], "q0[0]", "64 bits"),
    ("name", 5, "name", ""),
]


@pytest.mark.parametrize(
    ("key", "value", "path", "says"), WRONG, ids=[f"{k}={v!r}"[:60] for k, v, *_ in WRONG]
)
def test_wrong_values(key: str, value: Any, path: str, says: str) -> None:
    """Every wrong value is refused with its dotted path and what is allowed, by every way in."""
    document = broken(key, value)
    error = only_one_of_ours(lambda: vff.simulate(document))
    assert path in str(error) and says in str(error), str(error)
    if isinstance(error, ScenarioError):
        # The attribute says the same; a missing key belongs to the table that misses it.
        assert error.path == path or (value is None and path.startswith(error.path)), error.path
    assert type(only_one_of_ours(lambda: vff.Scenario.from_dict(document))) is type(error)
    assert type(only_one_of_ours(lambda: vff.Simulation(document))) is type(error)


UNKNOWN = [
    ("durration", "`durration`", "duration"),
    ("arm.length", "`length`", "lengths"),
    ("arm.mass", "`mass`", "masses"),
    ("controller.stifness", "`stifness`", "stiffness"),
    ("controller.null_dampling", "`null_dampling`", "null_damping"),
    ("controller.field.gian", "`gian`", "gain"),
    ("obstacles.0.shape.raduis", "`raduis`", "radius"),
    ("obstacles.0.pos", "`pos`", "position"),
    ("obstacles.0.motion.speed", "`speed`", "velocity"),
    ("reference.duratoin", "`duratoin`", "duration"),
    ("simulation.DT", "`DT`", "dt"),
    ("simulation.recordevery", "`recordevery`", "record_every"),
]


@pytest.mark.parametrize(("key", "given_name", "nearest"), UNKNOWN, ids=[key for key, *_ in UNKNOWN])
def test_unknown_keys_get_the_nearest_name(key: str, given_name: str, nearest: str) -> None:
    error = only_one_of_ours(lambda: vff.simulate(broken(key, 1.0)))
    parent = key.rpartition(".")[0].replace("obstacles.0", "obstacles[0]")
    assert isinstance(error, ScenarioError)
    assert str(error).startswith(parent) and given_name in str(error) and f"`{nearest}`" in str(error), str(
        error
    )


CHOICES = [
    ("controller.formulation", "recursiv", "recursive"),
    ("controller.projection", "dynamical", "dynamic"),
    ("controller.avoidance", "nullspace", "null_space"),
    ("controller.task", "positon", "position"),
    ("controller.field.kind", "kahtib", "khatib"),
    ("simulation.integrator", "rk5", "rk4"),
    ("simulation.control", "zoh", "hold"),
    ("obstacles.0.shape.kind", "cirlce", "circle"),
    ("obstacles.0.motion.kind", "linaer", "linear"),
    ("reference.kind", "lien", "line"),
]


@pytest.mark.parametrize(("key", "value", "allowed"), CHOICES, ids=[key for key, *_ in CHOICES])
def test_wrong_choices_list_the_allowed_ones(key: str, value: str, allowed: str) -> None:
    error = only_one_of_ours(lambda: vff.simulate(broken(key, value)))
    path = key.replace("obstacles.0", "obstacles[0]")
    assert str(error).startswith((path, path.rpartition(".")[0])), str(error)
    assert f"`{value}`" in str(error) and f"`{allowed}`" in str(error), str(error)
    for wrong_type in (1, 1.5, True, [value]):
        assert path.rpartition(".")[0] in str(
            only_one_of_ours(lambda v=wrong_type: vff.simulate(broken(key, v)))
        )  # type: ignore[misc]


@pytest.mark.parametrize(
    "key",
    [
        "duration",
        "q0",
        "arm",
        "reference",
        "arm.lengths",
        "arm.masses",
        "reference.kind",
        "controller.field.kind",
        "obstacles.0.shape",
        "obstacles.0.shape.radius",
    ],
)
def test_missing_keys_are_named(key: str) -> None:
    error = only_one_of_ours(lambda: vff.simulate(broken(key, None)))
    assert key.rpartition(".")[2] in str(error), str(error)


def test_unreachable_reference_names_the_time() -> None:
    """It leaves the reach of 2.4 m at t = 0.4 s: x = 2 + t."""
    document = valid() | {
        "duration": 1.0,
        "reference": {"kind": "polynomial", "coefficients": [[2.0, 1.0], [0.0]]},
    }
    error = only_one_of_ours(lambda: vff.simulate(document))
    assert "t = 0.4000 s" in str(error) and str(error).startswith("reference: ")


def test_reference_inside_the_inner_circle_is_unreachable() -> None:
    """An arm of 1 m + 0.2 m cannot reach the point 0.5 m from its base."""
    document = {
        "duration": 0.1,
        "q0": [0.0, 0.3],
        "arm": {"lengths": [1.0, 0.2], "masses": 1.0},
        "reference": {"kind": "setpoint", "point": [0.5, 0.0]},
    }
    assert "0.8000 to 1.2000 m" in str(only_one_of_ours(lambda: vff.simulate(document)))


# ----------------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("duration = = 5", "duration = = 5"),
        ("name = 'a'\nq0 = [0.0, 1.0", "q0"),
        ("this is no TOML at all", "this is no TOML at all"),
        ("duration = 1\nduration = 2", "duration"),
        ('{"duration": 5}', "{"),
    ],
)
def test_not_toml_shows_the_line(text: str, says: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    error = only_one_of_ours(lambda: vff.simulate(path))
    assert "mine.toml" in str(error) and says in str(error) and "line" in str(error), str(error)


def test_files_that_cannot_be_read(tmp_path: Path) -> None:
    (tmp_path / "latin.toml").write_bytes(b"name = 'caf\xe9'")
    (tmp_path / "folder.toml").mkdir()
    for name in ("missing.toml", "latin.toml", "folder.toml"):
        error = only_one_of_ours(lambda name=name: vff.simulate(tmp_path / name))  # type: ignore[misc]
        assert name in str(error)


def test_dates_are_no_numbers(tmp_path: Path) -> None:
    path = tmp_path / "date.toml"
    path.write_text(
        "duration = 2020-01-01\nq0 = [0.1]\n[arm]\nlengths = [1.0]\nmasses = 1.0\n"
        "[reference]\nkind = 'setpoint'\npoint = [1.0, 0.0]\n"
    )
    assert "duration" in str(only_one_of_ours(lambda: vff.simulate(path)))


@pytest.mark.parametrize(
    ("given_name", "nearest"), [("paper1", "paper-1"), ("sweep-thru", "sweep-through"), ("crowds", "crowd")]
)
def test_unknown_scenarios_get_the_nearest_name(given_name: str, nearest: str) -> None:
    for call in (vff.simulate, vff.Scenario.load):
        assert f"'{nearest}'" in str(only_one_of_ours(lambda call=call: call(given_name)))  # type: ignore[misc]


# ------------------------------------------------------------------------------------------- Python objects


def shown(thing: Any) -> str:
    """A value as the name of a test: the same in every process, so that several can share the tests."""
    return re.sub(r" at 0x\w+", "", repr(thing))[:24]


NONSENSE: list[Any] = [
    None,
    5,
    2.5,
    object(),
    b"paper-1",
    ["paper-1"],
    {1, 2},
    lambda: 0,
    "",
    "a.toml\0",
    range(3),
]


@pytest.mark.parametrize("thing", NONSENSE, ids=shown)
def test_things_that_are_no_scenario(thing: Any) -> None:
    only_one_of_ours(lambda: vff.simulate(thing))
    only_one_of_ours(lambda: vff.Scenario.load(thing))


@pytest.mark.parametrize("thing", NONSENSE, ids=shown)
def test_things_that_are_no_document(thing: Any) -> None:
    only_one_of_ours(lambda: vff.Scenario.from_dict(thing))
    only_one_of_ours(lambda: vff.Simulation(thing))
    if thing is not None:  # the default settings
        only_one_of_ours(lambda: vff.Controller(vff.Arm.uniform(3), thing))


@pytest.mark.parametrize(
    "thing",
    [object(), lambda: 0, 1 + 2j, b"x", "x", {"a": object()}, [object()]],
    ids=shown,
)
def test_things_that_are_no_values(thing: Any) -> None:
    error = only_one_of_ours(lambda: vff.simulate("paper-1", {"controller.damping": thing, "duration": 0.01}))
    assert "controller.damping" in str(error)


def test_endless_documents() -> None:
    """A dictionary inside itself has no end; it is refused and does not take the interpreter down."""
    loop: dict[str, Any] = {}
    loop["arm"] = loop
    endless: list[Any] = []
    endless.append(endless)
    only_one_of_ours(lambda: vff.Scenario.from_dict(loop))
    only_one_of_ours(lambda: vff.simulate("paper-1", {"q0": endless}))


def test_endless_documents_straight_to_the_core() -> None:
    """The same past the Python layer, in a process of its own: a stack overflow would kill it.

    The fault that it found: `to_toml` in crates/vff-python/src/convert.rs recursed without a limit.
    """
    import subprocess
    import sys

    code = """
import vffnull as vff
loop = {}
loop["arm"] = loop
endless = []
endless.append(endless)
for call in (lambda: vff.Simulation(loop), lambda: vff.Controller(vff.Arm.uniform(3), loop),
             lambda: vff.Arm(endless, 1.0), lambda: vff._core.check("arm", loop)):
    try:
        call()
    except vff.VffNullError as error:
        print(type(error).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert done.returncode == 0, f"exit {done.returncode}: {done.stderr[-300:]}"
    assert len(done.stdout.split()) == 4


@pytest.mark.parametrize(
    "overrides", [{1: 2}, {"": 1}, {"q0.7": 1.0}, {"q0.x": 1.0}, {"duration.x": 1.0}, 5, "duration=5"]
)
def test_overrides_that_make_no_sense(overrides: Any) -> None:
    only_one_of_ours(lambda: vff.simulate("paper-1", overrides))
    only_one_of_ours(lambda: vff.simulate(vff.Scenario.load("paper-1"), overrides))


# ------------------------------------------------------------------------------- the arm and the controller

ARM = vff.Arm.uniform(3)
Q = np.array([0.3, 0.6, -0.9])

BAD_ARMS: list[tuple[Callable[[], object], str]] = [
    (lambda: vff.Arm([], 1.0), "lengths"),
    (lambda: vff.Arm([1.0, 0.0], 1.0), "lengths[1]"),
    (lambda: vff.Arm([1.0, NAN], 1.0), "lengths[1]"),
    (lambda: vff.Arm([1.0, 1.0], -1.0), "masses"),
    (lambda: vff.Arm([1.0, 1.0], [1.0, INF]), "masses[1]"),
    (lambda: vff.Arm([1.0, 1.0], [1.0]), "masses"),
    (lambda: vff.Arm([1.0, 1.0], "heavy"), "masses"),
    (lambda: vff.Arm([1.0, 1.0], None), "masses"),  # type: ignore[arg-type]
    (lambda: vff.Arm([1.0, 1.0], True), "masses"),
    (lambda: vff.Arm("long", 1.0), "lengths"),
    (lambda: vff.Arm(object(), 1.0), "lengths"),  # type: ignore[arg-type]
    (lambda: vff.Arm([[1.0, 1.0]], 1.0), "lengths"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, inertias=-1.0), "inertias"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, radius=-1.0), "radius"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, com=[0.5]), "com"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, com=0.0, inertias=0.0), "inertia"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, gravity=[1.0, 2.0, 3.0]), "gravity"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, joint_limits=[[0.0, 1.0]]), "joint_limits"),
    (lambda: vff.Arm([1.0, 1.0], 1.0, torque_limits=[1.0, 0.0]), "torque_limits[1]"),
    (lambda: vff.Arm.uniform(0), "n"),
    (lambda: vff.Arm.uniform(-3), "n"),
    (lambda: vff.Arm.uniform(3, length=0.0), "lengths"),
    (lambda: vff.Arm.uniform(3, mass=NAN), "masses"),
]


@pytest.mark.parametrize(("call", "names"), BAD_ARMS, ids=range(len(BAD_ARMS)))
def test_bad_arms(call: Callable[[], object], names: str) -> None:
    assert names in str(only_one_of_ours(call))


BAD_VECTORS: list[tuple[Any, type[VffNullError]]] = [
    ([0.1, 0.2], InputError),
    ([0.1] * 4, InputError),
    ([], InputError),
    (0.1, InputError),
    ([[[0.1, 0.2, 0.3]]], InputError),
    ([0.1, NAN, 0.2], InputError),
    ([0.1, INF, 0.2], InputError),
    ("abc", InputTypeError),
    (None, VffNullError),
    ([0.1, None, 0.2], VffNullError),
    ([0.1, "x", 0.2], InputTypeError),
    ([0.1, [0.2], 0.3], InputTypeError),
    (object(), InputTypeError),
    ({"q": 1}, InputTypeError),
]

METHODS: dict[str, Callable[[Any], object]] = {
    "forward_kinematics.q": ARM.forward_kinematics,
    "jacobian.q": ARM.jacobian,
    "jacobian_dot.q": lambda v: ARM.jacobian_dot(v, Q),
    "jacobian_dot.dq": lambda v: ARM.jacobian_dot(Q, v),
    "mass_matrix.q": ARM.mass_matrix,
    "coriolis_matrix.dq": lambda v: ARM.coriolis_matrix(Q, v),
    "gravity_torque.q": ARM.gravity_torque,
    "inverse_dynamics.ddq": lambda v: ARM.inverse_dynamics(Q, Q, v),
    "forward_dynamics.tau": lambda v: ARM.forward_dynamics(Q, Q, v),
    "kinetic_energy.dq": lambda v: ARM.kinetic_energy(Q, v),
    "potential_energy.q": ARM.potential_energy,
    "extended_jacobian.dq": lambda v: ARM.extended_jacobian(Q, v),
    "torque.q": lambda v: vff.Controller(ARM, {}).torque(v, Q, [1.0, 1.0]),
    "torque.dq": lambda v: vff.Controller(ARM, {}).torque(Q, v, [1.0, 1.0]),
    "torque.x_ref": lambda v: vff.Controller(ARM, {}).torque(Q, Q, v),
    "torque.dx_ref": lambda v: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], 0.0 if v is None else v),
    "terms.ddx_ref": lambda v: vff.Controller(ARM, {}).terms(Q, Q, [1.0, 1.0], None, 0.0 if v is None else v),
    "step.tau": lambda v: vff.Simulation(valid()).step(0.0 if v is None else v),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("value", "kind"), BAD_VECTORS, ids=[shown(v) for v, _ in BAD_VECTORS])
def test_bad_vectors(method: str, value: Any, kind: type[VffNullError]) -> None:
    """Every array argument of every method: the name, and the shape that is expected."""
    if method.endswith("_ref") and value == [0.1, 0.2]:
        value = [0.1]
    if value is None and method in ("torque.dx_ref", "terms.ddx_ref", "step.tau"):
        kind = InputError  # None means "not given" there: 0.0 stands in, a scalar
    error = only_one_of_ours(lambda: METHODS[method](value))
    assert isinstance(error, kind), error
    assert str(error).startswith(method.partition(".")[2]), str(error)


def test_rows_of_configurations_are_judged_too() -> None:
    """`forward_kinematics` takes (T, n); each row as strictly as one alone (a NaN in one was let through)."""
    assert "q" in str(only_one_of_ours(lambda: ARM.forward_kinematics([[0.1, 0.2]])))
    assert "q" in str(only_one_of_ours(lambda: ARM.forward_kinematics([[0.1, 0.2, 0.3], [0.1, NAN, 0.3]])))


def test_extended_jacobian_at_a_singularity() -> None:
    assert "singular" in str(only_one_of_ours(lambda: ARM.extended_jacobian([0.2, 0.0, 0.0], Q)))
    only_one_of_ours(lambda: vff.Arm.uniform(1).extended_jacobian([0.2], [0.0]))


BAD_CALLS: list[tuple[Callable[[], object], str]] = [
    (lambda: vff.Controller(ARM, {"stifness": 1.0}), "stiffness"),
    (lambda: vff.Controller(ARM, {"posture": [0.0] * 4}), "posture"),
    (lambda: vff.Controller(ARM, vff.ControlSettings(null_damping=[1.0] * 4)), "null_damping"),
    (lambda: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], t=NAN), "t"),
    (
        lambda: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], obstacles=[{"shape": {}}]),
        "obstacles[0].shape",
    ),
    (lambda: vff.simulate("paper-1", {"duration": 0.01}, progress=5), "progress"),  # type: ignore[arg-type]
    (lambda: vff.ControlSettings(stiffness=-1.0), "stiffness"),
    (lambda: vff.ControlSettings(stiffness=object()), "stiffness"),  # type: ignore[arg-type]
    (lambda: vff.ControlSettings(formulation="fast"), "recursive"),  # type: ignore[arg-type]
    (
        lambda: vff.ControlSettings(field={"kind": "khatib", "gain": 1.0, "influence": 1.0, "flor": 0.1}),
        "floor",
    ),
    (lambda: vff.ControlSettings(field={"kind": "khatib", "gain": 1.0}), "influence"),
    (lambda: vff.ControlSettings(field="khatib"), "field"),  # type: ignore[arg-type]
    (lambda: vff.Controller(ARM, {"posture_stiffness": 1.0}), "posture"),
    (lambda: vff.Field.khatib(-1.0, 1.0), "gain"),
    (lambda: vff.Field.khatib(1.0, NAN), "influence"),
    (lambda: vff.Field.khatib("strong", 1.0), "gain"),  # type: ignore[arg-type]
    (lambda: vff.Field.cubic(1.0, 1.0, floor=2.0), "floor"),
    (lambda: vff.Field("khatibb", 1.0, 1.0), "khatib"),  # type: ignore[arg-type]
    (lambda: vff.Field("bounded", 1.0, 1.0, floor=0.1), "floor"),
    (lambda: vff.Motion.linear([1.0]), "velocity"),
    (lambda: vff.Motion.linear("fast"), "velocity"),
    (lambda: vff.Motion.sinusoid([1.0, 0.0], NAN), "angular_frequency"),
    (lambda: vff.Motion.waypoints([0.0, 0.0], [[0, 0], [1, 1]]), "times[1]"),
    (lambda: vff.Motion.waypoints([], []), "times"),
    (lambda: vff.Motion("orbit"), "orbit"),
    (lambda: vff.Obstacle.circle([0.0, 0.0], -1.0), "radius"),
    (lambda: vff.Obstacle.circle([0.0], 1.0), "position"),
    (lambda: vff.Obstacle.circle("here", 1.0), "position"),
    (lambda: vff.Obstacle.circle([0.0, 0.0], 1.0, motion="up"), "motion"),  # type: ignore[arg-type]
    (lambda: vff.Obstacle.capsule([0, 0], [0, 0], 0.1), "shape"),
    (lambda: vff.Obstacle.capsule([0, 0, 0, 0], [1, 1, 1, 1], 0.1), ""),
    (lambda: vff.Obstacle.capsule([0, 0, 0], [1, 1], 0.1), ""),
    (lambda: vff.Obstacle.capsule("a", "b", 0.1), ""),
    (lambda: vff.Obstacle.box([0, 0], [1, -1]), "size[1]"),
    (lambda: vff.Obstacle.box([0, 0], [1, 1], angle=NAN), "angle"),
    (lambda: vff.Obstacle.polygon([[0, 0], [1, 0], [0.2, 0.2], [0, 1]]), "convex"),
    (lambda: vff.Obstacle.polygon([]), "vertices"),
    (lambda: vff.Obstacle.polygon("triangle"), ""),
    (lambda: vff.Obstacle.polygon([[0, 0], [1, 0], [1]]), ""),
    (lambda: vff.Obstacle.polygon([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), ""),
    (
        lambda: vff.Scenario(
            arm=ARM, q0=[0.0], duration=1.0, reference={"kind": "setpoint", "point": [1, 1]}
        ),
        "q0",
    ),
    (lambda: vff.Scenario.load("paper-1")["controller.gain"], "controller.gain"),
    (lambda: vff.Scenario.load("paper-1").replace(**{"controller.field.gian": 1.0}), "gain"),
]


@pytest.mark.parametrize(("call", "says"), BAD_CALLS, ids=range(len(BAD_CALLS)))
def test_bad_calls(call: Callable[[], object], says: str) -> None:
    assert says in str(only_one_of_ours(call))


# Wrong types that meet PyO3's own extraction first, with exceptions outside the package's tree (faults of
# crates/vff-python). The stubs promise InputTypeError.
WRONG_TYPES: list[tuple[Callable[[], object], str]] = [
    (lambda: vff.Arm.uniform(2**70), "n"),
    (lambda: vff.Arm.uniform("six"), "n"),  # type: ignore[arg-type]
    (lambda: vff.Arm.uniform(2.5), "n"),  # type: ignore[arg-type]
    (lambda: vff.Arm.uniform(3, length="long"), "length"),  # type: ignore[arg-type]
    (lambda: vff.Controller("arm", {}), "arm"),  # type: ignore[arg-type]
    (lambda: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], t="now"), "t"),  # type: ignore[arg-type]
    (lambda: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], obstacles=5), "obstacles"),  # type: ignore[arg-type]
    (lambda: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], obstacles=[5]), "obstacles"),  # type: ignore[list-item]
    (
        lambda: vff.Controller(ARM, {}).torque(Q, Q, [1.0, 1.0], obstacles=vff.Obstacle.circle([0, 2], 1)),
        "obstacles",
    ),  # type: ignore[arg-type]
]


@pytest.mark.parametrize(("call", "says"), WRONG_TYPES, ids=range(len(WRONG_TYPES)))
def test_wrong_types_at_the_door(call: Callable[[], object], says: str) -> None:
    assert says in str(only_one_of_ours(call))


# ----------------------------------------------------------------------------------- warnings and outcomes


def test_an_obstacle_on_the_arm_is_a_warning_and_a_collision() -> None:
    document = valid()
    document["obstacles"] = [{"shape": {"kind": "circle", "radius": 0.3}, "position": [0.5, 0.1]}]
    with pytest.warns(ScenarioWarning, match=r"link 0 .*inside an obstacle at t = 0"):
        result = vff.simulate(document)
    assert result.status == "collided"
    assert result.metrics["collision_time"] == 0.0
    assert result.warnings and "link 0" in result.warnings[0]
    assert len(result.t) == 11


def test_a_duration_that_is_no_multiple_of_the_step_is_a_warning() -> None:
    with pytest.warns(ScenarioWarning, match=r"duration: .*simulation\.dt"):
        result = vff.simulate(valid() | {"duration": 0.0503})
    assert result.end_time == pytest.approx(0.05)


@pytest.mark.parametrize(
    "overrides",
    [
        {"controller.stiffness": 1e7, "controller.damping": 1e5, "simulation.dt": 0.02},
        {"controller.null_damping": 400.0, "simulation.dt": 0.02},
        {"controller.field.gain": 1e9, "simulation.dt": 0.05},
    ],
    ids=["task", "null damping", "field"],
)
@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_a_diverging_run_is_an_outcome(overrides: dict[str, Any]) -> None:
    """It ends with the status, the time, and everything recorded until then, all of it finite."""
    result = vff.simulate("sweep-through", {"simulation.control": "hold", **overrides})
    assert result.status == "diverged"
    assert 0 < result.end_time < 4.0
    assert f"{result.end_time:.4g}"[:4] in result.message
    assert 1 <= len(result.t) and result.t[-1] == pytest.approx(result.end_time)
    for name in ("q", "dq", "x", "dx", "error", "tau", "tau_vff", "force", "clearance"):
        assert np.all(np.isfinite(getattr(result, name))), name
    assert "diverged" in repr(result)
    str(result.metrics)


# ------------------------------------------------------------------------------------------------------ fuzz

VALUES: list[Any] = [
    None,
    True,
    False,
    0,
    -1,
    1,
    7,
    2**40,
    2**70,
    -(2**63),
    0.0,
    -0.0,
    1e-300,
    -1.5,
    1e3,
    1e12,
    1e300,
    NAN,
    INF,
    -INF,
    "",
    "hold",
    "khatib",
    "x",
    [],
    [[]],
    [1.0],
    [0.1, 0.2],
    [0.1, 0.2, 0.3],
    [NAN, 0, 0],
    [[0, 1], [1, 0]],
    ["a"],
    {},
    {"kind": "circle"},
    {"kind": "setpoint", "point": [1.0, 0.5]},
    {"kind": "static"},
    np.array([1.0, 2.0, 3.0]),
    np.float32(0.5),
    (1.0, 2.0),
    object(),
]


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of everything inside a document."""
    inside = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [*([path] if path else []), *(p for key, inner in inside for p in places(inner, (*path, key)))]


@settings(max_examples=400)
@given(data=st.data())
@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_broken_documents_end_in_an_error_or_a_result(data: st.DataObject) -> None:
    """One to three values of a valid document replaced, removed or added at random."""
    document = copy.deepcopy(valid())
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(places(document)), label="path")
        place: Any = document
        for key in path[:-1]:
            place = place[key]
        match data.draw(st.sampled_from(["replace", "remove", "rename"]), label="what"):
            case "replace":
                place[path[-1]] = copy.deepcopy(data.draw(st.sampled_from(VALUES), label="value"))
            case "remove":
                del place[path[-1]]
            case _ if isinstance(place, dict):
                place[f"{path[-1]}x"] = place.pop(path[-1])
            case _:
                place.append(place[0])
    # Nothing that is allowed but takes for ever: a second of 1 ms steps is enough to find out.
    duration, simulation = document.get("duration"), document.get("simulation")
    dt = simulation.get("dt") if isinstance(simulation, dict) else None
    if isinstance(duration, int | float) and (dt is None or isinstance(dt, int | float)):
        if duration > 1e4 * (dt or 1e-3) > 0:
            return
    try:
        result = vff.simulate(document)
    except (ScenarioError, InputError, InputTypeError) as error:
        assert str(error)
        return
    assert result.status in ("completed", "collided", "diverged")
    if result.status != "diverged":
        for name in ("q", "dq", "tau", "x", "error"):
            assert np.all(np.isfinite(getattr(result, name))), name


@settings(max_examples=200)
@given(text=st.text(max_size=200))
def test_any_text_is_toml_or_an_error(text: str) -> None:
    try:
        document = vff._core.parse_toml(text, "fuzz")
    except ScenarioError as error:
        assert "fuzz" in str(error)
    else:
        assert isinstance(document, dict)


HALF = "a\ud800"  # half of a surrogate pair: Python has it in text, no encoding has


@pytest.mark.parametrize(
    "call",
    [
        lambda: vff.simulate("paper-1", {"name": HALF}),
        lambda: vff.simulate("paper-1", {HALF: 1}),
        lambda: vff.simulate("paper-1", {f"controller.{HALF}": 1}),
        lambda: vff.simulate("paper-1", {"controller": {HALF: 1}}),
        lambda: vff.simulate("paper-1", {"reference": {"kind": HALF}}),
        lambda: vff.simulate(HALF),
        lambda: vff.simulate(f"{HALF}.toml"),
        lambda: vff.Scenario.load(Path(f"{HALF}.toml")),
        lambda: vff.Scenario.load("paper-1").replace(description=HALF),
        lambda: vff.Scenario.load("paper-1")[HALF],
        lambda: vff.simulate_many(["paper-1"], {"name": HALF}),
        lambda: vff.ControlSettings(projection=HALF),  # type: ignore[arg-type]
        lambda: vff.ControlSettings(tank={HALF: 1.0}),
        lambda: vff.Simulation(HALF),
        lambda: vff.Obstacle("circle", (("radius", 1.0), (HALF, 1.0)), (0.0, 0.0)),
    ],
)
def test_text_that_no_encoding_has(call: Callable[[], object]) -> None:
    """One of our errors, with a message that can be printed."""
    assert str(only_one_of_ours(call)).encode("utf-8")


@pytest.mark.parametrize(
    ("call", "name"),
    [
        (lambda: vff.simulate_many(["paper-1"], threads=0), "threads"),
        (lambda: vff.simulate_many(["paper-1"], threads=-(2**70)), "threads"),
        (lambda: vff.simulate_many(["paper-1"], threads=2**70), "threads"),
        (lambda: vff.simulate_many(["paper-1"], threads=1.0), "threads"),  # type: ignore[arg-type]
        (lambda: vff.scenes.random("crowd", 4, -1), "seed"),
        (lambda: vff.scenes.random("crowd", 4, 2**70), "seed"),
        (lambda: vff.scenes.random("crowd", 2**70, 1), "n"),
        (lambda: vff.simulate("paper-1", {"seed": -1}), "seed"),
        (lambda: vff.simulate("paper-1", {"seed": 2**70}), "seed"),
        (lambda: vff.realtime("paper-1", rate=10**400), "rate"),
        (lambda: vff.realtime("paper-1", seconds=10**400), "seconds"),
        (lambda: vff.realtime("paper-1", priority=2**70), "priority"),
        (lambda: vff.realtime("paper-1", core=-1), "core"),
    ],
)
def test_whole_numbers_out_of_range(call: Callable[[], object], name: str) -> None:
    assert str(only_one_of_ours(call)).startswith(name)


def test_xml_has_no_place_for_control_characters() -> None:
    """What is written can be read."""
    panda = vff.Arm.named("panda").to_dict()
    link = panda["joints"][2]["link"]
    named = json.loads(json.dumps(panda).replace(f'"{link}"', '"a\\u0001b"'))
    arm = vff.Scenario.from_dict({**vff.Scenario.load("panda-sweep").to_dict(), "arm": named}).arm
    for write in (arm.to_urdf, arm.to_mjcf, partial(vff.Arm.uniform(2).to_urdf, "a\x01b")):
        with pytest.raises(InputError, match=r"name 'a\\x01b': XML has no place for control characters"):
            write()


@pytest.mark.parametrize("given", [b"abc", bytearray(b"abc")])
def test_bytes_are_no_numbers(given: bytes) -> None:
    """Links of 97 to 99 m, they were taken for."""
    with pytest.raises(InputTypeError, match=r"arm\.lengths: a byte\w+ cannot be written into a scenario"):
        vff.Scenario.from_dict(valid()).replace(**{"arm.lengths": given})
