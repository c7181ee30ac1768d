"""Range sensors: the controller knows what they have seen and nothing else; the record is of the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.draw.figures import draw
from vffnull.engines.gym import ReachEnv
from vffnull.model.record import QUANTITIES

SCENE = "sweep-through"
DISC, RADIUS = np.array([1.6, 2.9]), 0.15
REAL = {"noise": 5e-3, "resolution": 1e-3, "rate": 100, "latency": 0.01, "drop_outs": 0.1}


def sensed(**keys: Any) -> dict[str, Any]:
    """Range sensors with these keys."""
    return {"perception": {"kind": "range"} | keys}


def same(one: vff.Result, other: vff.Result) -> bool:
    names = [name for name in QUANTITIES if getattr(one, name) is not None]
    return all(np.array_equal(getattr(one, n), getattr(other, n), equal_nan=True) for n in names)


def points(result: vff.Result) -> np.ndarray:
    assert result.sensed is not None
    return result.sensed


@pytest.fixture(scope="module")
def perfect() -> vff.Result:
    return vff.simulate(SCENE, sensed())


def test_ideal_is_what_there_was() -> None:
    """Not a bit differs from a scenario without the table, whatever else stands in it."""
    plain = vff.simulate(SCENE)
    ideal = vff.simulate(SCENE, {"perception": {"kind": "ideal", "noise": 1.0}})
    assert same(plain, ideal) and ideal.sensed is None


def test_points_lie_on_the_obstacle(perfect: vff.Result) -> None:
    """Without noise and delay every point is on the disc's rim, in front of its ray, within range."""
    found = points(perfect)
    assert found.shape == (4001, 6 * 2 * 4 * 3, 2)
    met = np.isfinite(found[..., 0])
    assert 0.01 < met.mean() < 0.5
    away = np.linalg.norm(found - perfect.obstacles, axis=-1)[met]
    np.testing.assert_allclose(away, RADIUS, atol=1e-9)
    joints = perfect.scenario.arm.forward_kinematics(perfect.q)
    links = np.repeat(np.arange(6), 24)
    share = np.tile(np.repeat((np.arange(4) + 0.5) / 4, 6), 6)[:, None]
    start, end = joints[:, links], joints[:, links + 1]
    reach = np.linalg.norm(found - start - share * (end - start), axis=-1)[met]
    assert reach.max() <= 2.0


def test_the_arm_still_clears(perfect: vff.Result) -> None:
    """With the nearest of the points instead of the nearest point the arm gives way like before."""
    ideal = vff.simulate(SCENE)
    assert perfect.status == "completed"
    assert abs(perfect.metrics.min_clearance - ideal.metrics.min_clearance) < 0.05
    real = vff.simulate(SCENE, sensed(**REAL))
    assert real.status == "completed" and real.metrics.min_clearance > 0.1
    np.testing.assert_allclose(np.linalg.norm(real.error, axis=1).max(), 0.0, atol=1e-4)


def test_record_and_metrics_are_of_the_truth() -> None:
    """The clearance is that of the disc, however little the sensors see; the force is that of the points."""
    result = vff.simulate(SCENE, sensed(**REAL | {"drop_outs": 0.7}))
    controller = vff.Controller(result.scenario.arm, result.scenario["controller"])
    disc = vff.Obstacle.circle(DISC, RADIUS, vff.Motion.linear([0.0, -0.35]))
    for row in range(0, len(result.t), 100):
        state = result.q[row], result.dq[row], result.x_ref[row]
        terms = controller.terms(*state, obstacles=[disc], t=result.t[row])
        np.testing.assert_allclose(result.clearance[row], terms.clearance, atol=1e-12)
    assert result.metrics.min_clearance == result.clearance.min()
    force, far = result.force.max(axis=1), 0.6
    known = points(result)
    joints = result.scenario.arm.forward_kinematics(result.q)
    gaps = np.array([nearest(p, j) for p, j in zip(known[::50], joints[::50], strict=True)])
    np.testing.assert_array_equal(force[::50] > 0, gaps < far)
    assert 0 < (gaps < far).sum() < len(gaps)


def nearest(found: np.ndarray, joints: np.ndarray) -> float:
    """The least distance from any point to any link [m]."""
    met = found[np.isfinite(found[:, 0])]
    if not len(met):
        return np.inf
    a, along = joints[:-1, None], np.diff(joints, axis=0)[:, None]
    share = np.clip(np.sum((met - a) * along, axis=-1) / np.sum(along**2, axis=-1), 0, 1)
    return float(np.linalg.norm(met - a - share[..., None] * along, axis=-1).min())


def test_blind_sensors_are_no_field() -> None:
    """If every reading is lost the arm moves as without a field, to the last bit, and is hit."""
    blind = vff.simulate(SCENE, sensed(drop_outs=1.0))
    none = vff.simulate(SCENE, {"controller.field.gain": 0.0})
    assert np.isnan(points(blind)).all()
    for name in ("q", "dq", "tau", "x", "error"):
        np.testing.assert_array_equal(getattr(blind, name), getattr(none, name))
    assert blind.status == "collided" and not blind.force.any()
    np.testing.assert_allclose(blind.clearance, none.clearance, atol=1e-14)


def test_same_seed_same_bits() -> None:
    """Also the other sensors' noise does not depend on these."""
    both = sensed(**REAL) | {"measurement": {"position_noise": 1e-4}, "duration": 0.5}
    one, two = vff.simulate(SCENE, both), vff.simulate(SCENE, both)
    assert same(one, two)
    other = vff.simulate(SCENE, both | {"seed": 1})
    assert not np.array_equal(points(one), points(other), equal_nan=True)
    alone = {key: value for key, value in both.items() if key != "perception"} | {
        "controller.field.gain": 0.0
    }
    without = vff.simulate(SCENE, alone)
    assert one.q_measured is not None and without.q_measured is not None
    np.testing.assert_array_equal(one.q_measured[0], without.q_measured[0])


def test_scans_hold_and_come_late() -> None:
    """100 Hz at 1 kHz, 10 ms late: the points change every 10 steps, and lie where the disc was then."""
    result = vff.simulate(SCENE, sensed(rate=100, latency=0.01))
    found = points(result)
    fresh = [k for k in range(1, 4001) if not np.array_equal(found[k], found[k - 1], equal_nan=True)]
    assert len(fresh) > 300 and {k % 10 for k in fresh} == {0}
    for k in fresh:
        met = np.isfinite(found[k, :, 0])
        away = np.linalg.norm(found[k, met] - result.obstacles[k - 10, 0], axis=1)
        np.testing.assert_allclose(away, RADIUS, atol=1e-9)


def test_files_tables_and_figures(tmp_path: Path, perfect: vff.Result) -> None:
    """None goes through a file, and so do points, NaN included; there is a figure of them."""
    short = vff.simulate(SCENE, sensed(sensors=1, rays=1) | {"duration": 0.05})
    for ending in (".npz", ".csv", ".parquet", ".arrow", ".mcap"):
        path = short.save(tmp_path / f"run{ending}")
        if ending != ".mcap":
            np.testing.assert_array_equal(points(vff.Result.load(path)), points(short))
    assert "sensed_0_x" in short.to_pandas() and short.to_xarray()["sensed"].dims == ("t", "ray", "plane")
    assert "sensed" in draw(perfect) and "sensed" not in draw(vff.simulate(SCENE, {"duration": 0.05}))
    simulation = vff.Simulation(short.scenario)
    np.testing.assert_array_equal(simulation.state.sensed, points(short)[0])
    assert vff.Simulation(vff.Scenario.load(SCENE)).state.sensed is None
    page = short.report(tmp_path / "run.html").read_text(encoding="utf-8")
    assert "what its range sensors have met" in page


def test_an_agent_sees_no_more_than_the_controller() -> None:
    """The observation has the clearance from the points, and no obstacles."""
    env = ReachEnv(SCENE, sensed(drop_outs=1.0), start_noise=0.0, obstacle_noise=0.0)
    observation, info = env.reset(seed=0)
    assert "obstacles" not in env.layout and "nearest" not in env.layout
    assert env.observation_space.contains(observation)
    assert (observation[env.layout["clearance"]] == 12.0).all() and info["clearance"] < 2.0


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"kind": "sonar"}, "perception.kind: .*ideal.*range"),
        ({"sensor": 1}, "perception: unknown key `sensor`.*`sensors`"),
        ({"sensors": 0}, "perception.sensors: must be 1 or more, got 0"),
        ({"rays": 0}, "perception.rays: must be 1 or more"),
        ({"rays": 10**9}, "perception.sensors: must be so few"),
        ({"field_of_view": 3.2}, r"perception.field_of_view: must be in \[0, π\), got 3.2"),
        ({"range": 0.0}, "perception.range: must be greater than 0"),
        ({"rate": 0.0}, "perception.rate: must be greater than 0"),
        ({"rate": 1e-3}, "perception.rate: must be at least one scan in 1e4 steps"),
        ({"noise": -1.0}, "perception.noise: must be 0 or more"),
        ({"resolution": -1.0}, "perception.resolution: must be 0 or more"),
        ({"latency": -1.0}, "perception.latency: must be 0 or more"),
        ({"latency": 11.0}, "perception.latency: must be at most 1e4 steps"),
        ({"drop_outs": 1.1}, r"perception.drop_outs: must be in \[0, 1\], got 1.1"),
    ],
)
def test_bad_input_is_named(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message):
        vff.Scenario.load(SCENE).replace(**sensed(**keys))


def test_where_it_does_not_fit() -> None:
    with pytest.raises(vff.errors.ScenarioError, match=r"perception: needs a sampled controller.*hold"):
        vff.simulate(SCENE, sensed() | {"simulation.control": "continuous"})
    short = {"duration": 0.02, "perception.kind": "ideal"}
    assert vff.simulate(SCENE, short, plant="mujoco").status == "completed"
