"""Settings of every way that has some, found on training scenes: the same scenes and as many trials for each.

Optuna's TPE minimises `loss`, which counts what the tables count. Its first trial is what the way has by
default, or what an earlier search has found, which is continued. A run ends when it collides, and a trial
when it can no longer become the best. What is found stands in ``tuned.toml``, or in the file of a group
of arms.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

import vffnull as vff
from peers.spatial.drive import drive, free
from peers.spatial.way import Settings, Way
from vffnull import _core
from vffnull.evaluation import scenes
from vffnull.evaluation.scenes.space import DURATION
from vffnull.run import evaluate as evaluating

FOUND = Path(__file__).with_name("tuned.toml")
TASKS = ("position", "pose")
FAMILIES = ("crowd", "links-swept", "path-crossed")  # in clutter hardly anybody fails
SEED = 1


def drawn(
    arms: Iterable[str], seeds: Iterable[int], families: Iterable[str] = scenes.FAMILIES
) -> list[vff.Scenario]:
    """A scene of every arm, family and task for each seed."""
    return [
        scenes.in_space(family, arm, task, seed)
        for arm in arms
        for seed in seeds
        for family in families
        for task in TASKS
    ]


def loss(row: Mapping[str, Any]) -> float:
    """What a run costs: 1 for a collision, ½ if the hand does not come back, ½ if it is lost where it could
    be held, and up to 0.1 for how early it collides or how far the hand was away, so that there is a slope.
    """
    failed = row["collided"] or row["diverged"]
    counted = float(failed) + 0.5 * (not row["returned"])
    if row["feasibility"] == "with tip":
        counted += 0.5 * (not row["success"])
    slope = 1.0 - row["end_time"] / DURATION if failed else row["max_error"] / 0.5
    return counted + 0.1 * min(slope, 1.0)


def tune(way: Way, chosen: list[vff.Scenario], trials: int, file: Path | None = None) -> dict[str, Any]:
    """The best settings of a way, with their loss, and what it took to find them."""
    import optuna

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    known = [(scene, evaluating.encounter(free(scene)), vff.feasibility(scene)) for scene in chosen]

    def suggested(trial: optuna.Trial) -> Settings:
        ranges = way.space.items()
        found = {key: trial.suggest_float(key, each.low, each.high, log=each.log) for key, each in ranges}
        return {**way.settings, **found, **way.hasty}

    def objective(trial: optuna.Trial) -> float:
        settings = suggested(trial)
        total, best = 0.0, min((each.value for each in study.trials[:-1]), default=np.inf)
        done = 0
        for each in known:
            done += 1
            total += loss(drive(way, settings, *each, until_contact=True).row) / len(known)
            if total > best:
                break
        said = f"{total:.3f} after {done} scenes"
        print(f"{way.name}, {trial.number + 1} of {trials}: {said}", file=sys.stderr, flush=True)
        return total

    earlier = found(file).get(way.name, {"trials": 0, "minutes": 0.0, "settings": way.settings})
    sampler = optuna.samplers.TPESampler(seed=SEED + earlier["trials"], multivariate=True)
    study = optuna.create_study(sampler=sampler)
    study.enqueue_trial({key: clipped(earlier["settings"][key], each) for key, each in way.space.items()})
    begin = perf_counter()
    study.optimize(objective, n_trials=trials)
    best = {key: float(f"{value:.3g}") for key, value in study.best_params.items()}
    return {
        "trials": earlier["trials"] + trials,
        "scenes": len(chosen),
        "minutes": round(earlier["minutes"] + (perf_counter() - begin) / 60.0, 1),
        "loss": round(study.best_value, 3),
        "settings": {**way.settings, **best},
    }


def clipped(value: float, within: Any) -> float:
    """A default that lies outside of what is searched, at its edge."""
    return min(max(value, within.low), within.high)


def found(file: Path | None = None) -> dict[str, dict[str, Any]]:
    """What is known, by the names of the ways; in ``tuned.toml`` unless another file is named."""
    file = file or FOUND
    return _core.parse_toml(file.read_text(encoding="utf-8"), file.name) if file.exists() else {}


def keep(name: str, outcome: Mapping[str, Any], file: Path | None = None) -> None:
    """Write what was found for a way beside what is known of the others."""
    file = file or FOUND
    file.write_text(_core.format_toml({**found(file), name: dict(outcome)}), encoding="utf-8")


def settings_of(way: Way, file: Path | None = None) -> Settings:
    """The settings that a way is judged with."""
    name = way.name if way.space else way.like
    if not name:
        return way.settings
    file = file or FOUND
    known = found(file)
    if name not in known:
        raise SystemExit(f"{name}: no settings in {file.name}; run with --tune first")
    return {**known[name]["settings"], **({} if way.space else way.settings)}
