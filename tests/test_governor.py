"""The reference governor: the reference waits for an end effector that had to give way."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

import vffnull as vff

LAWS = ("relaxed", "priority", "cbf")
GOVERNED = {"controller.governor": {}}


@cache
def run(name: str, avoidance: str, governed: bool, control: str = "hold") -> vff.Result:
    """14 s, so that a reference that waits still comes to its end."""
    changes = {"controller.avoidance": avoidance, "simulation.control": control, "duration": 14.0}
    return vff.simulate(name, changes | (GOVERNED if governed else {}))


def stretch(result: vff.Result) -> float:
    """The length of path [m] that the tip did not follow: from where it left the line by more than 1 cm to
    where it came back for good."""
    off = np.flatnonzero(np.abs(result.x[:, 0] - result.x_ref[-1, 0]) > 0.01)
    return float(result.x[off[-1], 1] - result.x[off[0], 1])


def test_the_path_is_resumed_where_it_was_left() -> None:
    """The disc of `on-path` and its margin cover 0.54 m of the path. With the governor the tip is back within
    0.2 m behind them; without, it jumps ahead by another half metre, to where the reference is by then."""
    with_, without = run("on-path", "cbf", True), run("on-path", "cbf", False)
    blocked = 2.0 * (0.25 + 0.02)
    assert blocked < stretch(with_) < blocked + 0.2
    assert stretch(without) > blocked + 0.6
    assert np.linalg.norm(with_.error[-1]) < 1e-9
    assert with_.metrics.min_clearance > 0.019  # type: ignore[operator]


@pytest.mark.parametrize("avoidance", LAWS)
def test_a_disc_that_passes_costs_less_of_the_path(avoidance: str) -> None:
    """Whatever way the end effector gives way by: less than half of the stretch, and it arrives."""
    with_, without = run("on-path-moving", avoidance, True), run("on-path-moving", avoidance, False)
    assert stretch(with_) < 0.5 * stretch(without)
    assert with_.status == "completed"
    assert np.linalg.norm(with_.error[-1]) < 1e-9


def test_what_is_left_of_a_reference_is_measured() -> None:
    """A line of 5 s in a run of 5 s: late by what it has waited for, and not at its end."""
    for governed in (False, True):
        changes: dict[str, Any] = {
            "controller.avoidance": "cbf",
            "simulation.control": "hold",
            "duration": 5.0,
        }
        result = vff.simulate("on-path", changes | (GOVERNED if governed else {}))
        left = 0.0 if result.path_time is None else 5.0 - result.path_time[-1]
        assert result.metrics["end_time_left"] == pytest.approx(left, abs=1e-9)
        assert result.metrics["end_delay"] == (pytest.approx(left, abs=1e-9) if governed else None)
        assert ("to go" in str(result.headline)) == governed
    assert left > 1.0 and result.headline.severity != "good"
    assert run("on-path", "cbf", True).metrics["end_time_left"] == 0.0
    assert vff.simulate("swing", {"duration": 0.1}).metrics["end_time_left"] == 0.0


@pytest.mark.parametrize("avoidance", LAWS)
@pytest.mark.parametrize("control", ["hold", "predictor"])
def test_the_clock_never_runs_backwards_nor_ahead(avoidance: str, control: str) -> None:
    """Between `floor` = 0.2 and 1 second per second, late in the end, and x_ref is the path at that time:
    y(s) = y₀ + (y₁ − y₀)(10s³ − 15s⁴ + 6s⁵)."""
    result = run("on-path", avoidance, True, control)
    assert result.path_time is not None
    rate = np.diff(result.path_time) / 1e-3
    assert rate.min() > 0.2 - 1e-9 and rate.max() < 1.0 + 1e-9
    assert rate.min() < 0.25
    assert result.path_time[0] == 0.0 and result.path_time[-1] < result.t[-1] - 1.0
    s = np.minimum(result.path_time / 5.0, 1.0)
    start, end = result.x_ref[0, 1], 1.8
    path = start + (end - start) * (10 * s**3 - 15 * s**4 + 6 * s**5)
    np.testing.assert_allclose(result.x_ref[:, 1], path, atol=1e-12)


@pytest.mark.parametrize("control", ["hold", "predictor"])
def test_while_the_error_is_small_nothing_changes(control: str) -> None:
    """The null space suffices in `sweep-through`: the same bits as without a governor, and σ(t) = t."""
    changes = {"simulation.control": control}
    plain = vff.simulate("sweep-through", changes)
    governed = vff.simulate("sweep-through", changes | GOVERNED)
    assert plain.path_time is None
    assert np.array_equal(governed.path_time, governed.t)  # type: ignore[arg-type]
    for name, values in plain.recorded().items():
        assert np.array_equal(values, governed.recorded()[name]), name


@pytest.mark.parametrize("avoidance", LAWS)
def test_the_torque_stays_continuous_and_peaks_less(avoidance: str) -> None:
    """Half the change from step to step at half the step. An arm that need not catch up pushes less: with
    `priority` and `cbf`, which stay near the disc, less than a quarter as hard."""
    changes = {"controller.avoidance": avoidance, "simulation.control": "hold"} | GOVERNED
    coarse, fine = (
        np.abs(np.diff(vff.simulate("on-path", changes | {"simulation.dt": dt}).tau, axis=0)).max()
        for dt in (5e-4, 2.5e-4)
    )
    assert fine < (1.0 if avoidance == "cbf" else 0.3)
    assert fine == pytest.approx(coarse / 2, rel=0.05)
    with_, without = (np.abs(run("on-path", avoidance, governed).tau).max() for governed in (True, False))
    assert with_ < (1.0 if avoidance == "relaxed" else 0.25) * without


def test_a_controller_leaves_its_reference_as_it_is() -> None:
    arm, q, dq = vff.Arm.uniform(6), [1.2, -0.6, -0.6, -0.5, 0.3, 0.4], [0.0] * 6
    plain, governed = (vff.Controller(arm, settings) for settings in ({}, {"governor": {}}))
    for _ in range(3):
        assert np.array_equal(plain.torque(q, dq, [3.0, 1.0]), governed.torque(q, dq, [3.0, 1.0]))


def test_the_path_time_is_saved(tmp_path: Any) -> None:
    result = run("on-path", "cbf", True)
    for ending in ("npz", "csv"):
        loaded = vff.Result.load(result.save(tmp_path / f"run.{ending}"))
        assert np.array_equal(loaded.path_time, result.path_time)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("inner", -0.1, "0 or more"),
        ("outer", 0.02, "greater than inner = 0.02"),
        ("rate", 0.0, "greater than 0"),
        ("floor", 1.0, r"in \[0, 1\)"),
        ("floor", -0.1, r"in \[0, 1\)"),
        ("flor", 0.1, "floor"),
    ],
)
def test_wrong_settings_are_named(key: str, value: float, words: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=words) as caught:
        vff.ControlSettings(governor={key: value})
    assert "governor" in str(caught.value)


def test_it_needs_control_periods() -> None:
    with pytest.raises(vff.errors.ScenarioError, match=r"controller\.governor.*hold"):
        vff.simulate("on-path", GOVERNED)
