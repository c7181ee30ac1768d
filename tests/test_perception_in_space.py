"""Range sensors and depth cameras in space: the controller knows what they have seen and nothing else."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.evaluation.geometry.arm import rotation

SCENE = "panda-sweep"
SAMPLED = {
    "simulation.control": "hold",
    "simulation.integrator": "semi_implicit_euler",
    "simulation.dt": 1e-3,
}
# z looks forward, x to the right of the picture, y down it: along -x from before the arm, down from above it.
IN_FRONT = {"position": [2.0, 0.0, 0.6], "orientation": [0.5, -0.5, -0.5, 0.5]}
ABOVE = {"position": [0.0, 0.0, 2.2], "orientation": [0.0, 1.0, 0.0, 0.0]}
REAL = {"noise": 3e-3, "resolution": 1e-3, "rate": 30, "latency": 0.02, "drop_outs": 0.1}


def sensed(kind: str = "range", **keys: Any) -> dict[str, Any]:
    """Changes that give the scene sensors."""
    if kind == "camera":
        keys = {"cameras": [ABOVE], "range": 3.0} | keys
    return SAMPLED | {"perception": {"kind": kind} | keys}


def points(result: vff.Result) -> np.ndarray:
    assert result.sensed is not None
    return result.sensed


@pytest.fixture(scope="module")
def known() -> vff.Result:
    return vff.simulate(SCENE, SAMPLED)


@pytest.fixture(scope="module", params=["range", "camera"])
def perfect(request: pytest.FixtureRequest) -> vff.Result:
    return vff.simulate(SCENE, sensed(request.param))


def test_points_lie_on_the_obstacle(perfect: vff.Result) -> None:
    """Without noise and delay every point is on the ball, on the side that looks at who sees it."""
    found = points(perfect)
    ball = perfect.scenario["obstacles"][0]
    radius = ball["shape"]["radius"]
    met = np.isfinite(found[..., 0])
    assert met.any(axis=1).mean() > 0.5
    away = np.linalg.norm(found - perfect.obstacles, axis=-1)[met]
    np.testing.assert_allclose(away, radius, atol=1e-9)
    if perfect.scenario["perception.kind"] == "camera":
        assert found.shape[1] == 64 * 48
        eye = np.array(ABOVE["position"])
        towards = np.einsum("...i,...i", eye - found, found - perfect.obstacles)[met]
        assert (towards > -1e-9).all()


def test_the_arm_still_clears(perfect: vff.Result, known: vff.Result) -> None:
    """With the points instead of the ball the elbow gives way, and the hand stays."""
    nothing = vff.simulate(SCENE, SAMPLED | {"controller.field.gain": 0.0})
    assert nothing.metrics.min_clearance < -0.05
    assert perfect.status == "completed"
    assert 0.04 < perfect.metrics.min_clearance < known.metrics.min_clearance + 0.02
    assert np.linalg.norm(perfect.error[:, :3], axis=1).max() < 1e-4


def test_with_real_sensors_it_clears() -> None:
    """Noise of 3 mm, 30 scans a second, 20 ms late, a tenth lost; the same seed gives the same run."""
    real = vff.simulate(SCENE, sensed(**REAL))
    assert real.status == "completed" and real.metrics.min_clearance > 0.03
    same = vff.simulate(SCENE, sensed(**REAL))
    np.testing.assert_array_equal(points(real), points(same))
    other = vff.simulate(SCENE, sensed(**REAL) | {"seed": 1})
    assert not np.array_equal(points(real), points(other), equal_nan=True)


def test_blind_is_like_no_field() -> None:
    blind = vff.simulate(SCENE, sensed(drop_outs=1.0))
    none = vff.simulate(SCENE, SAMPLED | {"controller.field.gain": 0.0})
    assert np.isnan(points(blind)).all()
    np.testing.assert_allclose(blind.q, none.q, atol=1e-15)
    np.testing.assert_allclose(blind.clearance, none.clearance, atol=1e-14)


def test_the_arm_hides_what_is_behind_it() -> None:
    """Of two balls as large, the camera sees less of the one behind the arm, and nothing of the arm."""

    def seen(place: list[float]) -> np.ndarray:
        ball = {"shape": {"kind": "sphere", "radius": 0.15}, "position": place}
        changes = sensed("camera", cameras=[IN_FRONT]) | {"obstacles": [ball], "duration": 0.01}
        found = points(vff.simulate(SCENE, changes))[0]
        found = found[np.isfinite(found[:, 0])]
        np.testing.assert_allclose(np.linalg.norm(found - place, axis=1), 0.15, atol=1e-9)
        return found

    hidden, free = seen([-0.5, 0.0, 0.6]), seen([-0.5, 0.8, 0.6])
    assert 0 < len(hidden) < 0.8 * len(free)


def test_the_picture_of_a_wall() -> None:
    """In closed form, pixel by pixel, from a pose that the arm is not in."""
    wall = {"shape": {"kind": "half_space", "normal": [0.0, 0.0, 1.0]}, "position": [0.0, 0.0, -0.4]}
    turn = np.array([0.2, 0.9, -0.3, 0.1])
    turn /= np.linalg.norm(turn)
    camera = {
        "position": [3.0, 3.0, 1.0],
        "orientation": turn.tolist(),
        "columns": 6,
        "rows": 4,
        "field_of_view": 0.7,
    }
    run = vff.simulate(
        SCENE, sensed("camera", cameras=[camera], range=9.0) | {"obstacles": [wall], "duration": 0.01}
    )
    focal = 3.0 / np.tan(0.35)
    row, column = np.divmod(np.arange(24), 6)
    rays = np.stack([column + 0.5 - 3.0, row + 0.5 - 2.0, np.full(24, focal)], axis=1) @ rotation(turn).T
    expected = np.array(camera["position"]) + rays * (-1.4 / rays[:, 2])[:, None]
    down = rays[:, 2] < 0.0
    assert down.any()
    expected[~down | (np.linalg.norm(expected - camera["position"], axis=1) > 9.0)] = np.nan
    np.testing.assert_allclose(points(run)[0], expected, atol=1e-12)


def test_files_and_steps(tmp_path: Path) -> None:
    """Points go through files, and a simulation stepped by hand has them."""
    short = vff.simulate(SCENE, sensed(sensors=1, rays=1) | {"duration": 0.02})
    for ending in (".npz", ".csv", ".parquet"):
        path = short.save(tmp_path / f"run{ending}")
        np.testing.assert_array_equal(points(vff.Result.load(path)), points(short))
    simulation = vff.Simulation(short.scenario)
    np.testing.assert_array_equal(simulation.state.sensed, points(short)[0])


@pytest.mark.parametrize("avoidance", ["priority", "cbf"])
def test_every_law_takes_points(avoidance: str) -> None:
    run = vff.simulate(SCENE, sensed() | {"controller.avoidance": avoidance, "duration": 1.5})
    assert run.status == "completed" and run.metrics.min_clearance > 0.0


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"kind": "sonar"}, "perception.kind: .*ideal.*range.*camera"),
        ({"around": 0}, "perception.around: must be 1 or more"),
        ({"sensors": 10**7}, "perception.sensors: must be so few"),
        ({"kind": "camera"}, "perception.cameras: expected at least one"),
        (
            {"kind": "camera", "cameras": [IN_FRONT | {"columns": 0}]},
            r"perception.cameras\[0\].columns: must be 1",
        ),
        (
            {"kind": "camera", "cameras": [IN_FRONT, IN_FRONT | {"orientation": [1.0, 1.0, 0.0, 0.0]}]},
            r"perception.cameras\[1\].orientation: .*norm 1",
        ),
        (
            {"cameras": [IN_FRONT | {"field_of_view": 3.2}]},
            r"perception.cameras\[0\].field_of_view: must be in \(0, π\)",
        ),
        ({"cameras": [{"position": [0, 0, 1]}]}, r"perception.cameras\[0\].*orientation"),
        (
            {"kind": "camera", "cameras": [IN_FRONT | {"columns": 10**5, "rows": 10**5}]},
            "perception.cameras: must be so few",
        ),
    ],
)
def test_bad_input_is_named(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message):
        vff.Scenario.load(SCENE).replace(**SAMPLED | {"perception": {"kind": "range"} | keys})


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"kind": "camera", "cameras": [IN_FRONT]}, "perception.kind: depth cameras belong to arms in space"),
        ({"kind": "range", "around": 3}, "perception.around: belongs to arms in space"),
        (
            {"kind": "range", "cameras": [IN_FRONT]},
            "perception.cameras: depth cameras belong to arms in space",
        ),
    ],
)
def test_the_plane_has_none_of_it(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message):
        vff.Scenario.load("sweep-through").replace(perception=keys)
