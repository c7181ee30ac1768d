"""What people get wrong: degrees, millimetres, quaternions, a reference out of reach."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError, ScenarioWarning

DEGREES = [0.0, -45.0, 0.0, -135.0, 0.0, 90.0, 45.0]
STILL: dict[str, Any] = {"duration": 0.01, "reference": {"kind": "setpoint"}}


def test_degrees_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match=r"q0\[1\]: -45 rad .*are these degrees\? In radians it is -0.7854"
    ):
        vff.simulate("panda-sweep", {**STILL, "q0": DEGREES})
    vff.simulate("panda-sweep", {**STILL, "q0": np.radians(DEGREES).tolist()})


def test_a_joint_without_limits_may_have_turned_often() -> None:
    vff.simulate(
        "paper-1", {"q0": [1.2 + 20 * np.pi, *vff.Scenario.load("paper-1")["q0"][1:]], "duration": 0.01}
    )


def test_millimetres_are_suspected() -> None:
    box: dict[str, Any] = {"shape": {"kind": "sphere", "radius": 0.05}, "position": [400.0, 0.0, 300.0]}
    with pytest.warns(ScenarioWarning, match=r"obstacles\[0\].position: 500.0000 m away.*millimetres\?"):
        vff.simulate("panda-sweep", {**STILL, "obstacles": [box]})
    with pytest.warns(ScenarioWarning, match="millimetres"):
        vff.simulate("paper-1", {"duration": 0.01, "obstacles.0.position": [1500.0, 1800.0]})


def turned(quaternion: list[float]) -> vff.Result:
    box = {"shape": {"kind": "box", "size": [0.3, 0.1, 0.2]}, "position": [0.6, 0.3, 0.4]}
    return vff.simulate("panda-sweep", {**STILL, "obstacles": [{**box, "orientation": quaternion}]})


def test_rounded_quaternions_are_normalised() -> None:
    """Two digits are enough; what is off by more than 1 % is refused."""
    half = 0.5**0.5
    exact, rounded = turned([half, 0.0, 0.0, half]), turned([0.71, 0.0, 0.0, 0.71])
    np.testing.assert_allclose(rounded.clearance, exact.clearance, rtol=0, atol=1e-15)
    with pytest.raises(ScenarioError, match=r"orientation: .* of norm 1\.03.*within 0\.01"):
        turned([0.73, 0.0, 0.0, 0.73])


@pytest.mark.parametrize(
    ("changes", "path"),
    [
        ({"reference": {"kind": "setpoint", "relative": True, "orientation": [0, 0, 0, 1]}}, "reference"),
        ({"arm": {"model": "panda", "mount": {"orientation": [0, 0, 0, 1]}}}, r"arm\.mount"),
        (
            {
                "obstacles": [
                    {
                        "shape": {"kind": "box", "size": [1, 1, 1]},
                        "position": [9, 0, 0],
                        "orientation": [0, 0, 0, 1],
                    }
                ]
            },
            r"obstacles\[0\]",
        ),
    ],
)
def test_w_in_the_last_place_is_suspected(changes: dict[str, Any], path: str) -> None:
    told = rf"{path}\.orientation: \[0, 0, 0, 1\] is half a turn about z; quaternions are \[w, x, y, z\]"
    with pytest.warns(ScenarioWarning, match=told):
        vff.simulate("panda-sweep", {**STILL, "controller.task": "pose", **changes})


LINE = {"kind": "line", "end": [2.0, 0.0, 0.5], "duration": 1.0}


@pytest.mark.parametrize("name", ["panda-sweep", "paper-1"])
def test_a_reference_out_of_reach_runs_with_a_warning_if_wished(name: str) -> None:
    """Refused by default and by name; with a warning it is the same reference."""
    line = LINE if name == "panda-sweep" else {"kind": "line", "end": [7.0, 0.0], "duration": 1.0}
    for refused in (line, {**line, "unreachable": "refuse"}):
        with pytest.raises(ScenarioError, match='`unreachable`: "refuse" or "warn"'):
            vff.simulate(name, {"reference": refused, "duration": 0.5})
    with pytest.warns(ScenarioWarning, match="^reference: "):
        result = vff.simulate(name, {"reference": {**line, "unreachable": "warn"}, "duration": 0.5})
    np.testing.assert_allclose(
        result.x_ref[-1, 0], result.x_ref[0, 0] + 0.5 * (line["end"][0] - result.x_ref[0, 0]), rtol=1e-12
    )


def test_a_reference_within_reach_is_the_same_with_and_without_the_word() -> None:
    plain = vff.simulate("panda-sweep", {"duration": 0.1})
    worded = vff.simulate("panda-sweep", {"duration": 0.1, "reference.unreachable": "warn"})
    np.testing.assert_array_equal(plain.q, worded.q)
    assert worded.warnings == plain.warnings == ()
    with pytest.raises(
        ScenarioError, match=r"reference.unreachable: unknown value `no`; allowed: `refuse`, `warn`"
    ):
        vff.simulate("panda-sweep", {"reference.unreachable": "no"})
