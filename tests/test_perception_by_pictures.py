"""Depth cameras with the arm in their pictures: the controller knows what a perceiver makes of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.robots.simulated import SimulatedRobot

SCENE = "panda-watched"
SHORT = {"duration": 2.3}  # until the person has reached in once
EXACT = {
    f"perception.{key}": 0.0
    for key in (
        "latency",
        "noise",
        "resolution",
        "drop_outs",
        "grazing",
        "position_error",
        "orientation_error",
        "clock_error",
    )
} | {"perception.perceiver.time_error": 0.0}


def points(result: vff.Result, row: int = -1) -> np.ndarray:
    """Those that the controller knows at an instant."""
    assert result.sensed is not None
    found = result.sensed[row]
    return found[np.isfinite(found[:, 0])]


@pytest.fixture(scope="module")
def watched() -> vff.Result:
    return vff.simulate(SCENE)


def test_the_arm_of_a_person_is_avoided(watched: vff.Result) -> None:
    """Blind it would be struck; watched it is not, and the hand is back where it was."""
    blind = vff.simulate(SCENE, {"perception.drop_outs": 1.0})
    assert blind.status == "collided"
    assert watched.status == "completed" and (watched.metrics.min_clearance or 0.0) > 0.02
    off = np.linalg.norm(watched.error[:, :3], axis=1)
    assert off[-1] < 0.01 and off.max() < 0.25


def test_points_lie_on_the_person(watched: vff.Result) -> None:
    """The arm is in every picture, and none of it is left; the rest lies on the person."""
    shapes = [each["shape"] for each in watched.scenario.to_dict()["obstacles"][:2]]
    for row in range(0, len(watched.t), 20):
        found = points(watched, row)
        if not len(found):
            continue
        away = np.full(len(found), np.inf)
        for shape, place in zip(shapes, watched.obstacles[row], strict=False):
            a, b = (np.array(shape[end]) + place for end in "ab")
            share = np.clip((found - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            near = np.linalg.norm(found - a - share[:, None] * (b - a), axis=1) - shape["radius"]
            away = np.minimum(away, np.abs(near))
        assert np.median(away) < 0.03, watched.t[row]


def test_without_errors_nothing_of_the_arm_is_left() -> None:
    """With nobody there the cloud is empty throughout, while the arm swings through both pictures."""
    swinging = EXACT | {
        "obstacles": [],
        "duration": 1.5,
        "reference": {"kind": "line", "end": [0.1, 0.35, 0.1], "duration": 0.7, "relative": True},
    }
    run = vff.simulate(SCENE, swinging)
    assert run.sensed is not None and np.isnan(run.sensed).all()
    assert np.abs(run.dq).max() > 0.5


def test_a_run_repeats(watched: vff.Result) -> None:
    """Bit for bit by the same seed, and not by another one."""
    first, again = vff.simulate(SCENE, SHORT), vff.simulate(SCENE, SHORT)
    np.testing.assert_array_equal(first.q, again.q)
    np.testing.assert_array_equal(first.sensed, again.sensed)
    np.testing.assert_array_equal(first.q, watched.q[: len(first.q)])
    other = vff.simulate(SCENE, SHORT | {"seed": 1})
    assert not np.array_equal(first.sensed, other.sensed, equal_nan=True)


def test_velocities_make_up_for_latency() -> None:
    """Pictures that come a tenth of a second late put the fingers where they are, not 6 cm behind."""
    late = vff.simulate(SCENE, EXACT | SHORT | {"perception.latency": 0.1, "perception.clock_error": 0.0})
    row = int(np.searchsorted(late.t, 0.9))  # at full speed
    fingers = late.obstacles[row][0]
    tip = points(late, row)[:, 1].min()
    assert abs(tip - (fingers[1] - 0.045)) < 0.04


def test_a_margin_within_what_is_cut_away_is_told_of() -> None:
    """What is nearer to the arm than that is in no cloud."""
    with pytest.warns(vff.errors.ScenarioWarning, match=r"yielding.margin: 0.02 m is less than .* = 0.03 m"):
        vff.simulate(SCENE, {"duration": 0.01, "controller.yielding.margin": 0.02})
    assert vff.simulate(SCENE, {"duration": 0.01}).warnings == ()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"perception.kind": "camera"}, r'grazing: is for pictures: it needs kind = "depth"'),
        ({"perception.cameras": []}, "cameras: expected at least one"),
        ({"perception.grazing": 1.6}, r"grazing: must be in \[0, π/2\)"),
        ({"perception.orientation_error": -0.1}, r"orientation_error: must be in \[0, π\]"),
        ({"perception.position_error": -0.1}, "position_error: must be 0 or more"),
        ({"perception.clock_error": 0.2}, r"clock_error: must be at most latency \+ perceiver.latest_state"),
        (
            {"perception.perceiver.time_offset": 0.15},
            r"perceiver.time_offset: must be in \[-10, latency \+ perceiver.latest_state − clock_error\]",
        ),
        ({"perception.perceiver.time_offset": -11.0}, "perceiver.time_offset: must be in"),
        (
            {"perception.perceiver.room": [[3.0, -1.0, 0.0], [5.0, 1.0, 1.0]]},
            "perceiver.room: is out of reach of the arm",
        ),
        ({"perception.perceiver.voxel": 0.0}, "perceiver.voxel: must be greater than 0"),
        ({"perception.perceiver.voxel": 1e-4}, "perceiver.room: has .* cells"),
        ({"perception.perceiver.voxels": 1.0}, "voxels"),
        ({"simulation.control": "continuous"}, "needs a sampled controller"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=sentence):
        vff.Scenario.load(SCENE).replace(**changes)


def test_there_are_no_pictures_in_the_plane() -> None:
    camera = {"position": [1.0, 0.0, 1.0], "orientation": [0.0, 1.0, 0.0, 0.0]}
    with pytest.raises(vff.errors.ScenarioError, match="depth cameras belong to arms in space"):
        vff.Scenario.load("sweep-through").replace(
            **{"simulation.control": "hold", "perception": {"kind": "depth", "cameras": [camera]}}
        )


def test_a_drive_says_that_it_looks_through_no_camera() -> None:
    """It is handed the true obstacles of the scene; what a robot sees has to be told."""
    robot = SimulatedRobot(SCENE)
    with (
        pytest.warns(vff.errors.ScenarioWarning, match="perception: is of simulations"),
        vff.drive(robot, vff.Scenario.load(SCENE), seconds=0.02) as drive,
    ):
        drive.wait(10.0)
