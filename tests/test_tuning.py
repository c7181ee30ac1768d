"""Candidates that cannot be run, or end early, are no finds of a tuning, whatever it is after."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import vffnull as vff

pytest.importorskip("optuna")

CASES: dict[str, dict[str, Any]] = {
    "refused": {"key": "controller.null_damping", "name": "f", "range": [-5, 10]},
    "diverged": {"key": "controller.stiffness", "name": "f", "range": [100.0, 1e8], "scale": "log"},
}


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
@pytest.mark.parametrize(("metric", "direction"), [("collided", "minimize"), ("completed", "maximize")])
@pytest.mark.parametrize("case", CASES)
def test_what_ends_early_is_the_worst(case: str, metric: str, direction: str, tmp_path: Path) -> None:
    study = vff.Study(
        {
            "name": "x",
            "scenario": "on-path" if case == "diverged" else "sweep-through",
            "overrides": {"duration": 3.0},
            "factors": [CASES[case]],
            "tune": {"trials": 8, "objectives": [{"metric": metric, "direction": direction}]},
        }
    )
    found = study.tune(tmp_path / "found")
    table = found.dataset.to_pandas().set_index("point")
    early = table.status.isin(["refused", "diverged", "failed"])
    assert early.any() and not early.all()
    assert not early[found.best[0].number]
    worst = 1.0 if direction == "minimize" else 0.0
    assert all(trial.values == (worst,) for trial in found.trials if early[trial.number])


def test_a_study_that_records_nothing_may_be_long() -> None:
    """Its runs keep metrics alone; with records it is refused."""
    long = {"duration": 4000.0, "simulation.dt": 5e-5, "obstacles": [], "simulation.record_every": 1}
    document = {
        "name": "x",
        "scenario": "sweep-through",
        "overrides": long,
        "factors": [{"key": "controller.null_damping", "name": "d", "range": [1, 8]}],
        "design": {"kind": "random", "count": 2},
    }
    assert vff.Study(document).runs == 2
    with pytest.raises(vff.errors.ScenarioError, match="GB"):
        vff.Study(document | {"records": {"every": 1, "quantities": ["x"]}})
