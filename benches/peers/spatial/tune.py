"""Settings of every way that has some, found on training scenes: the same scenes and as many trials for each.

Optuna's TPE minimises `loss`, which counts what the tables count. Its first trial is what the way has by
default. What is found stands in ``tuned.toml``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import vffnull as vff
from peers.spatial.drive import drive, free
from peers.spatial.way import Settings, Way
from vffnull import _core, evaluation, scenes

FOUND = Path(__file__).with_name("tuned.toml")
TASKS = ("position", "pose")
SEED = 1


def drawn(arm: str, seeds: Iterable[int]) -> list[vff.Scenario]:
    """A scene of every family and task for each seed."""
    return [
        scenes.in_space(family, arm, task, seed)
        for seed in seeds
        for family in scenes.FAMILIES
        for task in TASKS
    ]


def loss(row: Mapping[str, Any]) -> float:
    """What a run costs: 1 for a collision, ½ if the hand does not come back, ½ if it is lost where it could
    be held, and up to 0.2 for the depth of the contact and the largest error, so that there is a slope.
    """
    counted = float(row["collided"] or row["diverged"]) + 0.5 * (not row["returned"])
    if row["feasibility"] == "with tip":
        counted += 0.5 * (not row["success"])
    depth = min(max(0.02 - row["min_clearance"], 0.0) / 0.2, 1.0)
    return counted + 0.1 * depth + 0.1 * min(row["max_error"] / 0.5, 1.0)


def tune(way: Way, chosen: list[vff.Scenario], trials: int) -> dict[str, Any]:
    """The best settings of a way, with the losses of its own and of the best."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    known = [(scene, evaluation.encounter(free(scene)), vff.feasibility(scene)) for scene in chosen]

    def suggested(trial: optuna.Trial) -> Settings:
        ranges = way.space.items()
        found = {key: trial.suggest_float(key, each.low, each.high, log=each.log) for key, each in ranges}
        return {**way.settings, **found}

    def objective(trial: optuna.Trial) -> float:
        settings = suggested(trial)
        total = sum(loss(drive(way, settings, *each).row) for each in known) / len(known)
        print(f"{way.name}, {trial.number + 1} of {trials}: {total:.3f}", file=sys.stderr, flush=True)
        return total

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=SEED, multivariate=True))
    study.enqueue_trial({key: clipped(way.settings[key], each) for key, each in way.space.items()})
    begin = perf_counter()
    study.optimize(objective, n_trials=trials)
    best = {key: float(f"{value:.3g}") for key, value in study.best_params.items()}
    return {
        "trials": trials,
        "scenes": len(chosen),
        "minutes": round((perf_counter() - begin) / 60.0, 1),
        "loss_at_first": round(study.trials[0].value, 3),
        "loss": round(study.best_value, 3),
        "settings": {**way.settings, **best},
    }


def clipped(value: float, within: Any) -> float:
    """A default that lies outside of what is searched, at its edge."""
    return min(max(value, within.low), within.high)


def found() -> dict[str, dict[str, Any]]:
    """What is known, by the names of the ways."""
    return _core.parse_toml(FOUND.read_text(encoding="utf-8"), FOUND.name) if FOUND.exists() else {}


def keep(name: str, outcome: Mapping[str, Any]) -> None:
    """Write what was found for a way beside what is known of the others."""
    FOUND.write_text(_core.format_toml({**found(), name: dict(outcome)}), encoding="utf-8")


def settings_of(way: Way) -> Settings:
    """The settings that a way is judged with."""
    name = way.name if way.space else way.like
    if not name:
        return way.settings
    known = found()
    if name not in known:
        raise SystemExit(f"{name}: no settings in {FOUND.name}; run with --tune first")
    return {**known[name]["settings"], **({} if way.space else way.settings)}
