"""Tuning: Optuna proposes points, and their runs are blocks like those of any study.

What is proposed follows from the document and the trials before: the sampler of each trial has a seed of its
own, and the trials of a batch are proposed before one of them is told. So a tuning that was killed goes on to
the same end as one that was not.
"""

from __future__ import annotations

import io
import os
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.progress import Counter
from vffnull.studies.executors import Executor
from vffnull.studies.factors import Factor
from vffnull.studies.parts import Part, named
from vffnull.studies.plan import Goal, Plan
from vffnull.studies.reading import Runs
from vffnull.studies.running import Begun, carry_out
from vffnull.studies.store import Store

__all__ = ["JOURNAL", "Trial", "Tuned", "outcome_of", "trials_of", "tune"]

JOURNAL = "tuning.log"
_PROPOSALS = 2  # of the seeds that belong to proposals
_POINT = "point"

_MAKE_ONE: dict[str, Any] = {
    "mean": np.mean,
    "median": np.median,
    "min": np.min,
    "max": np.max,
    "q05": lambda values: np.quantile(values, 0.05),
    "q95": lambda values: np.quantile(values, 0.95),
}
_OF_STATUS = {
    "collided": ("collided",),
    "diverged": ("diverged", "failed", "refused"),
    "completed": ("completed",),
}


@dataclass(frozen=True)
class Trial:
    """A candidate that was tried.

    Attributes
    ----------
    number : int
        The column ``point`` of its runs.
    values : tuple of float, or None
        The objectives, in the order of the document; None if one did not apply to all of its runs.
    factors : dict
        The values of the factors by their names.
    """

    number: int
    values: tuple[float, ...] | None
    factors: dict[str, Any]


@dataclass(frozen=True)
class Tuned:
    """What a tuning has found.

    Attributes
    ----------
    dataset : Runs
        All runs of all trials.
    trials : list of Trial
        In the order in which they were proposed.
    best : list of Trial
        The best one; with several objectives all that no other one beats in each of them.
    """

    dataset: Runs
    trials: list[Trial]
    best: list[Trial]


def tune(
    plan: Plan,
    store: Store,
    token: str,
    executor: Executor,
    begun: Begun,
    trials: int,
    report: Counter | None,
) -> Iterator[int]:
    """Try candidates until there are so many; yields the number of those that are over.

    Parameters
    ----------
    plan : Plan
        The study, as a tuning.
    store, token, executor, begun, report
        As for `carry_out`.
    trials : int
        How many there are to be in all.
    """
    optuna = extra("optuna", "study")
    tuning = plan._tuned
    space = {factor.name: _distribution(optuna, factor) for factor in plan.factors}
    parts = {part.block: part for name in store.names("runs") if (part := named("runs", name))}
    parts = {number: part for number, part in parts.items() if number in begun.blocks}
    there = len(begun.blocks) * plan.per_point // max(len(plan.trial_blocks(0, _no_row(plan))), 1)
    total = max(trials * plan.per_point - there, 0)
    with _quiet(optuna):
        study = optuna.create_study(
            storage=_journal(optuna, store),
            study_name=plan.digest,
            directions=["maximize" if goal.maximize else "minimize" for goal in tuning.goals],
            load_if_exists=True,
        )
        asked = _asked(optuna, study)
        over = 0
        for first in range(0, trials, tuning.batch):
            batch = range(first, min(first + tuning.batch, trials))
            for number in batch:
                if number not in asked:
                    asked[number] = _propose(optuna, study, plan, space, number)
            running = {n: asked[n] for n in batch if asked[n].state == optuna.trial.TrialState.RUNNING}
            blocks = [
                block
                for number, trial in running.items()
                for block in plan.trial_blocks(number, _row(plan, trial.params))
                if block.number not in parts
            ]
            base = over

            def told(done: int, _total: int, base: int = base) -> None:
                if report is not None:
                    report(base + done, total)

            for done in carry_out(plan, store, token, executor, blocks, told, total):
                parts |= {part.block: part for part in done.parts if part.kind == "runs"}
                over += done.runs
            for number, trial in running.items():
                values = outcome_of(plan, _columns(plan, store, parts, number, trial.params))
                if values is None:
                    study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
                else:
                    study.tell(trial.number, list(values))
            yield batch.stop


def _propose(optuna: Any, study: Any, plan: Plan, space: Mapping[str, Any], number: int) -> Any:
    """Ask for a candidate. Only with its number is it one of ours."""
    seed = np.random.SeedSequence(plan.seed, spawn_key=(_PROPOSALS, number)).generate_state(1)
    samplers, kind = optuna.samplers, plan._tuned.sampler
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what Optuna calls experimental
        study.sampler = (
            samplers.TPESampler(seed=int(seed[0]), constant_liar=True)
            if kind == "tpe"
            else samplers.RandomSampler(seed=int(seed[0]))
            if kind == "random"
            else samplers.NSGAIISampler(seed=int(seed[0]))
        )
    trial = study.ask(dict(space))
    trial.set_user_attr(_POINT, number)
    return study.trials[trial.number]


def _asked(optuna: Any, study: Any) -> dict[int, Any]:
    """The trials that were proposed to the end, by their numbers; half a proposal is given up."""
    found = {}
    for trial in study.trials:
        if _POINT in trial.user_attrs:
            found[int(trial.user_attrs[_POINT])] = trial
        elif not trial.state.is_finished():
            study.tell(trial.number, state=optuna.trial.TrialState.FAIL)
    return found


def _distribution(optuna: Any, factor: Factor) -> Any:
    of = optuna.distributions
    if factor.values is not None:
        return of.CategoricalDistribution(tuple(range(len(factor.values))))
    if factor.whole:
        return of.IntDistribution(int(factor.low), int(factor.high), log=factor.log)
    return of.FloatDistribution(factor.low, factor.high, log=factor.log)


def _row(plan: Plan, params: Mapping[str, Any]) -> NDArray[np.float64]:
    return np.array([float(params[factor.name]) for factor in plan.factors])


def _no_row(plan: Plan) -> NDArray[np.float64]:
    return np.array([factor.low for factor in plan.factors])


def _columns(
    plan: Plan, store: Store, parts: Mapping[int, Part], number: int, params: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """The columns of a trial's runs that its objectives need."""
    parquet = extra("pyarrow.parquet", "study")
    names = list(dict.fromkeys(["status", *_needed(plan)]))
    found: dict[str, list[Any]] = {name: [] for name in names}
    for block in plan.trial_blocks(number, _row(plan, params)):
        table = parquet.read_table(io.BytesIO(store.read(parts[block.number].path)), columns=names)
        for name in names:
            found[name] += table.column(name).to_pylist()
    return {
        name: np.array(values) if name == "status" else np.array(values, dtype=float)
        for name, values in found.items()
    }


def _needed(plan: Plan) -> list[str]:
    return [goal.metric for goal in plan._tuned.goals if goal.metric not in _OF_STATUS]


def outcome_of(plan: Plan, columns: Mapping[str, NDArray[Any]]) -> tuple[float, ...] | None:
    """The objectives of a trial; None if one does not apply to all of its runs."""
    found = []
    for goal in plan._tuned.goals:
        values = _values(goal, columns)
        if not np.all(np.isfinite(values)):
            return None
        found.append(float(_MAKE_ONE[goal.over](values)))
    return tuple(found)


def _values(goal: Goal, columns: Mapping[str, NDArray[Any]]) -> NDArray[np.float64]:
    ended = np.isin(columns["status"], _OF_STATUS["diverged"])  # half a run has no metric that counts
    if goal.metric in _OF_STATUS:
        is_so = np.isin(columns["status"], _OF_STATUS[goal.metric])
        if goal.metric != "diverged":  # nor has it kept clear: it is the worst that can be
            is_so = np.where(ended, not goal.maximize, is_so)
        return is_so.astype(float)
    values = columns[goal.metric].astype(float)
    missing = np.nan if goal.missing is None else goal.missing
    return np.where(np.isfinite(values) & ~ended, values, missing)


def trials_of(dataset: Runs) -> Tuned:
    """The trials of a dataset of a tuning, from its runs."""
    plan = dataset.plan
    names = list(dict.fromkeys(["point", "status", *dataset.factors, *_needed(plan)]))
    columns = dataset.columns(names)
    trials = []
    for number in np.unique(columns["point"]):
        at = columns["point"] == number
        if at.sum() < plan.per_point:
            continue  # under way
        own = {name: values[at] for name, values in columns.items()}
        factors = {name: own[name][0].item() for name in dataset.factors}
        trials.append(Trial(int(number), outcome_of(plan, own), factors))
    signs = [-1.0 if goal.maximize else 1.0 for goal in plan._tuned.goals]
    return Tuned(dataset, trials, _front(trials, np.array(signs)))


def _front(trials: list[Trial], signs: NDArray[np.float64]) -> list[Trial]:
    """The trials that no other one beats, the best in the first objective first."""
    done = [trial for trial in trials if trial.values is not None]
    costs = np.array([signs * np.array(trial.values) for trial in done]).reshape(len(done), len(signs))
    best = [
        trial
        for trial, cost in zip(done, costs, strict=True)
        if not np.any(np.all(costs <= cost, axis=1) & np.any(costs < cost, axis=1))
    ]
    best.sort(key=lambda trial: (signs[0] * (trial.values or (0.0,))[0], trial.number))
    return best[:1] if len(signs) == 1 else best


def _journal(optuna: Any, store: Store) -> Any:
    """Optuna's journal in the dataset's directory, mended if a line was broken off by the end of a process.

    Whoever comes here has locked the directory: a lock of the journal's own would outlive a killed client.
    """
    if "://" in store.place:
        raise InputError(f"{store.place}: Optuna's journal needs a directory of this machine")
    path = Path(store.place) / JOURNAL
    if path.exists():
        whole = path.read_bytes().rpartition(b"\n")
        if whole[2]:
            os.truncate(path, len(whole[0]) + len(whole[1]))
    journal = extra("optuna.storages.journal", "study")
    backend = journal.JournalFileBackend(str(path), lock_obj=_Unlocked())
    return optuna.storages.JournalStorage(backend)


class _Unlocked:
    """A lock that locks nothing."""

    def acquire(self) -> bool:
        return True

    def release(self) -> None:
        pass


@contextmanager
def _quiet(optuna: Any) -> Iterator[None]:
    """Optuna says nothing of every trial; its level is put back."""
    before = optuna.logging.get_verbosity()
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    try:
        yield
    finally:
        optuna.logging.set_verbosity(before)
