"""A study that has been read: which runs there are, and what each of them changes.

Everything that a run computes follows from the document and the number of the run, on whatever machine and in
whatever order: values of the factors, scene, seed, and which block a run belongs to.
"""

from __future__ import annotations

import hashlib
import json
import pickle
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull.model.document import Document, plain
from vffnull.model.record import Layout
from vffnull.model.settings import setting
from vffnull.studies.designs import Counted, Design
from vffnull.studies.factors import Factor
from vffnull.studies.scenes import Base

__all__ = ["FIXED", "Block", "Goal", "Place", "Plan", "Records", "Tuning"]
Array = NDArray[np.float64]
FIXED = {
    "run": ("", "number of the run in the study"),
    "point": ("", "number of the point in the design, or of the trial"),
    "repetition": ("", "number of the repetition at this point"),
    "seed": ("", "seed of the scenario's random numbers"),
    "scene": ("", "name of the random scene"),
    "status": ("", "how the run ended; refused: the scenario cannot be run"),
    "message": ("", "why a run failed or was refused"),
    "end_time": ("s", "where the run ended"),
}
"""Unit and meaning of the columns that every study has."""
_RUNS = 1  # of the seeds that belong to runs; the streams of designs are elsewhere
_NOMINAL = 3e-7  # s for a step and a joint; decides how many runs a block has, so it never changes
_BLOCK_TIME = 2.0  # s of such work in a block
_MAX_IN_BLOCK = 4096
_MAX_BLOCKS = 200_000  # beyond, they grow: a scheduler has to look after each
_FEWEST_BLOCKS = 32  # so that a short study keeps a few workers busy, too
_BLOCK_BYTES = 64e6  # of records in a block


@dataclass(frozen=True)
class Records:
    """Which part of the records is kept.

    Attributes
    ----------
    every : int
        Steps of the simulation for one row.
    quantities : tuple of str
        Names of recorded quantities.
    """

    every: int
    quantities: tuple[str, ...]


@dataclass(frozen=True)
class Goal:
    """What a tuning is after.

    Attributes
    ----------
    metric : str
        A metric, or ``collided``, ``diverged`` or ``completed``, which are 1 for such a run and 0 otherwise;
        a run that diverges, fails or is refused counts as ``diverged`` and, in the others, as the worse.
    maximize : bool
        Whether more of it is better.
    over : str
        How the runs of a trial make one number: one of `AGGREGATES`.
    missing : float or None
        What stands for a run in which the metric does not apply; without it such a trial fails.
    """

    metric: str
    maximize: bool
    over: str
    missing: float | None


@dataclass(frozen=True)
class Tuning:
    """How a tuning goes about it.

    Attributes
    ----------
    trials : int
        How many candidates are tried.
    goals : tuple of Goal
        One, or several for a Pareto front.
    sampler : {"tpe", "random", "nsga2"}
        Who proposes candidates.
    batch : int
        How many are proposed at once and run together.
    """

    trials: int
    goals: tuple[Goal, ...]
    sampler: str
    batch: int


class Place(NamedTuple):
    """Where a run stands: its point, scene and repetition."""

    point: int
    scene: int
    repetition: int


@dataclass(frozen=True)
class Block:
    """A stretch of runs that are computed and written together.

    Attributes
    ----------
    number : int
        Its number.
    first, last : int
        Its runs, from `first` up to but not including `last`.
    rows : (k, factors) ndarray
        Coordinates of the factors in each run.
    """

    number: int
    first: int
    last: int
    rows: Array = field(repr=False)

    def __len__(self) -> int:
        return self.last - self.first


@dataclass(frozen=True, eq=False)
class Plan:
    """A study that has been read; `vffnull.Study` says what the keys of its document mean."""

    name: str
    description: str
    base: Base
    overrides: dict[str, Any]
    factors: tuple[Factor, ...]
    design: Design | None
    repetitions: int
    seed: int
    common_seeds: bool
    metrics: tuple[str, ...]
    records: Records | None
    block_runs: int | None
    tuning: Tuning | None

    # ------------------------------------------------------------------ how many

    @cached_property
    def points(self) -> int:
        """Points of the design, or trials of a tuning."""
        return self.design.count if self.design is not None else self._tuned.trials

    @property
    def per_point(self) -> int:
        """Runs of a point: all scenes, each with all repetitions."""
        return self.base.count * self.repetitions

    @property
    def runs(self) -> int:
        """All runs."""
        return self.points * self.per_point

    @cached_property
    def size(self) -> int:
        """Runs of a block; the last one may have fewer."""
        if self.block_runs is not None:
            return self.block_runs
        together = self.per_point if self.design is None else self.runs
        base = self.base.document(0, self.overrides)
        steps = float(base["duration"]) / float(setting(base, "simulation.dt"))
        joints = len(base["q0"])
        most = max(_BLOCK_TIME / (steps * joints * _NOMINAL), together / _MAX_BLOCKS)
        most = min(most, _MAX_IN_BLOCK)
        if self.records is not None:
            width = 8 * (4 + joints) * len(self.records.quantities)
            most = min(most, _BLOCK_BYTES / (width * (1 + steps / self.records.every)))
        return max(1, min(int(most), -(-together // _FEWEST_BLOCKS)))

    @property
    def blocks(self) -> int:
        """How many blocks there are."""
        return self.blocks_of(self.points)

    def blocks_of(self, points: int) -> int:
        """How many blocks so many points have."""
        if self.design is None:
            return points * -(-self.per_point // self.size)
        return -(-points * self.per_point // self.size)

    # ------------------------------------------------------------------ a run

    def place(self, run: int) -> Place:
        """Where a run stands. All runs of a trial follow one another; else all runs of a scene do."""
        rest, repetition = divmod(run, self.repetitions)
        if self.design is None:
            point, scene = divmod(rest, self.base.count)
        else:
            scene, point = divmod(rest, self.points)
        return Place(point, scene, repetition)

    def seed_of(self, run: int) -> int:
        """The seed of a run, or of its repetition where all points have the same."""
        key = self.place(run).repetition if self.common_seeds else run
        state = np.random.SeedSequence(self.seed, spawn_key=(_RUNS, key)).generate_state(1, np.uint64)
        return int(state[0]) >> 1

    def changes(self, run: int, row: Array) -> dict[str, Any]:
        """What a run changes of its scene, by dotted keys."""
        found = dict(self.overrides)
        for factor, coordinate in zip(self.factors, row.tolist(), strict=True):
            found |= factor.overrides(coordinate)
        if self.records is not None:
            found["simulation.record_every"] = self.records.every
        return found | {"seed": self.seed_of(run)}

    def document(self, run: int, row: Array) -> Document:
        """The scenario of a run, ready for the core.

        Raises
        ------
        vffnull.errors.ScenarioError
            If a value cannot be put where its key says.
        """
        return self.base.document(self.place(run).scene, self.changes(run, row))

    def row(self, run: int) -> Array:
        """The coordinates of a run's factors."""
        point = self.place(run).point
        found: Array = self._designed.rows(point, point + 1)[0]
        return found

    # ------------------------------------------------------------------ blocks

    def block(self, number: int) -> Block:
        """A block of a design."""
        size = self.size
        first, last = number * size, min((number + 1) * size, self.runs)
        return Block(number, first, last, self._rows(first, last))

    def _rows(self, first: int, last: int) -> Array:
        """Coordinates of the runs from `first` up to but not including `last`."""
        design, points = self._designed, self.points
        begin, end = first // self.repetitions, -(-last // self.repetitions)
        parts = []
        while begin < end:
            point = begin % points
            stop = min(point + end - begin, points)
            parts.append(design.rows(point, stop))
            begin += stop - point
        rows = np.repeat(np.concatenate(parts), self.repetitions, axis=0)
        at = first % self.repetitions
        found: Array = rows[at : at + last - first]
        return found

    def trial_blocks(self, trial: int, row: Array) -> list[Block]:
        """The blocks of a trial."""
        size, each = self.size, self.per_point
        count = -(-each // size)
        found = []
        for i in range(count):
            first, last = i * size, min((i + 1) * size, each)
            rows = np.repeat(row[None], last - first, axis=0)
            found.append(Block(trial * count + i, trial * each + first, trial * each + last, rows))
        return found

    @property
    def _designed(self) -> Design:
        assert self.design is not None, "a tuning has no design"
        return self.design

    @property
    def _tuned(self) -> Tuning:
        assert self.tuning is not None, "a study has a design"
        return self.tuning

    def packed(self) -> bytes:
        """The plan as workers need it: without the points of the design, which come with every block."""
        plan = replace(self, block_runs=self.size)
        if self.design is not None:
            plan = replace(plan, design=Counted(self.points))
        plan.__dict__["digest"] = self.digest
        return pickle.dumps(plan)

    def as_tuning(self) -> Plan:
        """The plan whose points are proposed one after the other."""
        if self.tuning is None:
            raise InputError("tune: missing; a study is tuned by a table [tune] with its `objectives`")
        if not self.factors:
            raise InputError("factors: a study that is tuned needs [[factors]]")
        return replace(self, design=None)

    # ------------------------------------------------------------------ columns

    @cached_property
    def layout(self) -> Layout:
        """Where the first scenario takes place: units of metrics and recorded quantities."""
        return Layout.of(self.base.document(0, self.overrides))

    @cached_property
    def has_scenes(self) -> bool:
        """Whether there are random scenes."""
        return "scenes" in self.base.to_dict()

    # ------------------------------------------------------------------ identity

    def to_dict(self) -> Document:
        """The document, complete: nothing that it names is elsewhere."""
        found: Document = {"name": self.name, "description": self.description, **self.base.to_dict()}
        found |= {"overrides": self.overrides, "factors": [factor.to_dict() for factor in self.factors]}
        if self.design is not None:
            found["design"] = self.design.to_dict()
        found |= {"repetitions": self.repetitions, "seed": self.seed, "metrics": list(self.metrics)}
        found["seeds"] = "repetition" if self.common_seeds else "run"
        if self.records is not None:
            found["records"] = {"every": self.records.every, "quantities": list(self.records.quantities)}
        found["block"] = {"runs": self.size}
        if self.tuning is not None:
            goals = [
                {
                    "metric": goal.metric,
                    "direction": "maximize" if goal.maximize else "minimize",
                    "over": goal.over,
                }
                | ({} if goal.missing is None else {"missing": goal.missing})
                for goal in self.tuning.goals
            ]
            tuning = self.tuning
            found["tune"] = {
                "trials": tuning.trials,
                "objectives": goals,
                "sampler": tuning.sampler,
                "batch": tuning.batch,
            }
        return plain(found)  # type: ignore[no-any-return]

    @cached_property
    def digest(self) -> str:
        """What tells this study from every other: 16 hexadecimal digits. Name and description have no say."""
        document = self.to_dict()
        for key in ("name", "description"):
            document.pop(key)
        if self.design is None:
            document["tune"].pop("trials")  # there may be more later
        else:
            document.pop("tune", None)
        text = json.dumps(document, sort_keys=True, ensure_ascii=False)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
