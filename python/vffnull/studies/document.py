"""The document of a study, read and found fit to run: what varies, over which scenarios, and what is kept.

Everything that a run computes follows from the document and the number of the run, on whatever machine and in
whatever order: values of the factors, scene, seed, and which block a run belongs to.
"""

from __future__ import annotations

import hashlib
import json
import pickle
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._support.errors import InputError, InputTypeError, ScenarioError
from vffnull.model.document import Document, plain
from vffnull.model.keys import nearest
from vffnull.model.record import QUANTITIES, Layout
from vffnull.model.scenario import check_overrides, with_hint
from vffnull.model.settings import setting
from vffnull.studies._keyed import Keyed, finite
from vffnull.studies.designs import DESIGNS, MOST, Counted, Design, read_design
from vffnull.studies.factors import Factor, read_factor
from vffnull.studies.scenes import Base, read_base
from vffnull.studies.tabulated import columns_of, read_table, with_spread

__all__ = ["FIXED", "Block", "Goal", "Plan", "Records", "Tuning", "read_plan"]

Array = NDArray[np.float64]

_KEYS = (
    "name",
    "description",
    "scenario",
    "scenes",
    "overrides",
    "factors",
    "design",
    "repetitions",
    "seed",
    "seeds",
    "metrics",
    "records",
    "block",
    "tune",
)

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
_MOST_SEED = 2**63 - 1
_NOMINAL = 3e-7  # s for a step and a joint; decides how many runs a block has, so it never changes
_BLOCK_TIME = 2.0  # s of such work in a block
_MOST_IN_BLOCK = 4096
_MOST_BLOCKS = 200_000  # beyond, they grow: a scheduler has to look after each
_FEWEST_BLOCKS = 32  # so that a short study keeps a few workers busy, too
_BLOCK_BYTES = 64e6  # of records in a block
_SPREAD = 16  # points that are tried before the first run

AGGREGATES = ("mean", "median", "min", "max", "q05", "q95")


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
        A metric, or ``collided``, ``diverged`` or ``completed``, which are 1 for such a run and 0 otherwise.
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
        most = max(_BLOCK_TIME / (steps * joints * _NOMINAL), together / _MOST_BLOCKS)
        most = min(most, _MOST_IN_BLOCK)
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

    def all_blocks(self) -> Iterator[int]:
        """The numbers of all blocks, in order."""
        return iter(range(self.blocks))

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

    def to_json(self) -> str:
        """The document as text that is the same for the same study."""
        return json.dumps(self.to_dict(), sort_keys=True, ensure_ascii=False, separators=(",", ":"))

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


def read_plan(content: object, folder: Path = Path(), check: bool = True) -> Plan:
    """Read a study's document, and find out whether its scenarios can be run.

    Parameters
    ----------
    content : Mapping
        The document; see `vffnull.Study`.
    folder : Path
        Where files are that it names.
    check : bool
        Whether to try some scenarios; a document that has been read before needs it no more.

    Raises
    ------
    vffnull.errors.InputError, vffnull.errors.InputTypeError
        If something is wrong; the message begins with the key.
    vffnull.errors.ScenarioError
        If the base scenario, or all points that were tried, cannot be run.
    """
    if not isinstance(content, Mapping):
        raise InputTypeError(f"study: expected a table, got a {type(content).__name__}")
    table = Keyed(content, "", _KEYS)
    seed = table.whole("seed", 0, 0, _MOST_SEED)
    base = read_base(table, folder)
    overrides = _overrides(table)
    factors, design = _factors_and_design(table, seed, folder)
    tuning = _tuning(table, factors)
    blocks = Keyed(table.get("block", {}), "block", ("runs",))
    metrics = _metrics(table)
    judged = [goal.metric for goal in tuning.goals if goal.metric in _core.METRICS] if tuning else []
    plan = Plan(
        name=table.text("name"),
        description=table.text("description"),
        base=base,
        overrides=overrides,
        factors=factors,
        design=design,
        repetitions=table.whole("repetitions", 1, 1, MOST),
        seed=seed,
        common_seeds=table.choice("seeds", ("run", "repetition"), "run") == "repetition",
        metrics=tuple(dict.fromkeys([*metrics, *judged])),
        records=_records(table),
        block_runs=blocks.whole("runs", None, 1, 1_000_000) if "runs" in blocks else None,
        tuning=tuning,
    )
    if plan.runs > MOST:
        raise InputError(f"study: {plan.runs:.3g} runs are more than the {MOST} that can be counted")
    _check_names(plan)
    if check:
        _check_points(plan)
    return plan


def _overrides(table: Keyed) -> dict[str, Any]:
    given = table.get("overrides", {})
    check_overrides(given)
    found = plain(given, "overrides")
    for key in found:
        _owned(f"overrides.{key}", key)
    return found  # type: ignore[no-any-return]


def _owned(path: str, key: str) -> None:
    """Refuse keys that the study itself sets."""
    if key == "seed":
        raise InputError(f"{path}: the study gives every run a seed of its own; see `seed` and `repetitions`")


def _factors_and_design(table: Keyed, seed: int, folder: Path) -> tuple[tuple[Factor, ...], Design]:
    contents = table.rows("factors")
    of = Keyed(table.get("design", {}), "design", ("kind", "count", "levels", "rows", "file", "coordinates"))
    columns = None
    given = of.choice("kind", DESIGNS, "grid") == "table"
    if given:
        names = [_column_name(each, f"factors[{i}]") for i, each in enumerate(contents)]
        columns = columns_of(of, names, folder)
        if columns is not None:
            contents = [with_spread(each, columns[name]) for each, name in zip(contents, names, strict=True)]
    else:
        for key in ("rows", "file", "coordinates"):
            if key in of:
                raise InputError(f'{of.at(key)}: is of a table: kind = "table"')
    factors = tuple(read_factor(each, f"factors[{i}]") for i, each in enumerate(contents))
    for i, factor in enumerate(factors):
        for key in factor.touched:
            _owned(f"factors[{i}]", key)
            if key == "simulation.record_every" and "records" in table:
                raise InputError(f"factors[{i}]: simulation.record_every is given by `records.every`")
    if given:
        return factors, read_table(of, factors, columns)
    return factors, read_design(of, factors, seed)


def _column_name(content: object, path: str) -> str:
    """What a factor's column is called, before its values are known."""
    if not isinstance(content, Mapping):
        raise InputTypeError(f"{path}: expected a table, got a {type(content).__name__}")
    name = content.get("name", content.get("key", content.get("keys")))
    return str(name[0] if isinstance(name, list) and name else name)


def _metrics(table: Keyed) -> tuple[str, ...]:
    known = tuple(_core.METRICS)
    if "metrics" not in table:
        return known
    found = table.words("metrics")
    for i, name in enumerate(found):
        _one_of(f"metrics[{i}]", name, known)
    return tuple(dict.fromkeys(found))


def _one_of(path: str, name: str, known: tuple[str, ...]) -> None:
    import difflib

    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f", did you mean {near[0]!r}?" if near else ";"
        raise InputError(f"{path}: no {name!r}{hint} there are {', '.join(known)}")


def _records(table: Keyed) -> Records | None:
    if "records" not in table:
        return None
    records = Keyed(table.get("records"), "records", ("every", "quantities"))
    quantities = records.words("quantities", ("x", "error", "clearance"))
    for i, name in enumerate(quantities):
        _one_of(f"records.quantities[{i}]", name, tuple(QUANTITIES))
    if not quantities:
        raise InputError("records.quantities: expected at least one; without [records] nothing is recorded")
    return Records(records.whole("every", None, 1, 1_000_000_000), tuple(dict.fromkeys(quantities)))


def _tuning(table: Keyed, factors: tuple[Factor, ...]) -> Tuning | None:
    if "tune" not in table:
        return None
    tune = Keyed(table.get("tune"), "tune", ("trials", "objectives", "sampler", "batch"))
    goals = []
    for i, each in enumerate(tune.rows("objectives")):
        path = f"tune.objectives[{i}]"
        goal = Keyed(each, path, ("metric", "direction", "over", "missing"))
        metric = goal.text("metric")
        _one_of(f"{path}.metric", metric, ("collided", "diverged", "completed", *_core.METRICS))
        direction = goal.choice("direction", ("minimize", "maximize"))
        missing = finite(f"{path}.missing", goal.get("missing")) if "missing" in goal else None
        goals.append(Goal(metric, direction == "maximize", goal.choice("over", AGGREGATES, "mean"), missing))
    if not goals:
        raise InputError('tune.objectives: expected at least one, as { metric = "…", direction = "…" }')
    sampler = tune.choice("sampler", ("tpe", "random", "nsga2"), "tpe")
    trials = tune.whole("trials", None, 1, 10_000_000)
    return Tuning(trials, tuple(goals), sampler, tune.whole("batch", 1, 1, 10_000))


def _check_names(plan: Plan) -> None:
    """Columns have names of their own."""
    taken = {*FIXED, *_core.METRICS}
    keys: dict[str, str] = {}
    for i, factor in enumerate(plan.factors):
        if not factor.name or factor.name in taken:
            raise InputError(
                f"factors[{i}].name: {factor.name!r} is the name of another column; give it one of its own"
            )
        taken.add(factor.name)
        for key in factor.touched:
            if key in keys:
                raise InputError(f"factors[{i}]: {key} is changed by {keys[key]}, too")
            keys[key] = factor.name
    if plan.records is not None and plan.has_scenes:
        kinds = plan.base.to_dict()["scenes"]
        if any(len(kinds.get(each, ())) > 1 for each in ("joints", "arms", "tasks")):
            raise InputError(
                "records: need scenes of one arm and one task, for the columns are the same in all"
            )
        if not {"obstacles", "sensed"}.isdisjoint(plan.records.quantities):
            raise InputError("records.quantities: the number of obstacles differs from scene to scene")


def _check_points(plan: Plan) -> None:
    """Some points, spread over the design, must be scenarios; an unknown key is refused wherever it is."""
    if plan.tuning is not None and plan.factors:
        middle = np.array([[factor.low, factor.high] for factor in plan.factors]).T
        rows = list(middle)
    else:
        rows = []
    count = min(plan.points, _SPREAD)
    places = dict.fromkeys(round(i * (plan.points - 1) / max(count - 1, 1)) for i in range(count))
    rows += [plan._designed.rows(point, point + 1)[0] for point in places]
    first: ScenarioError | None = None
    fine = False
    for row in rows:
        try:
            _core.check("scenario", plan.document(0, row))
            fine = True
        except ScenarioError as error:
            error = _placed(plan, error, row)
            if "unknown key" in str(error) or "is a plain value" in str(error) or "no list" in str(error):
                raise error from None
            first = first or error
        if fine and first is None and len(plan.factors) == 0:
            break
    if not fine and first is not None:
        raise first


def _placed(plan: Plan, error: ScenarioError, row: Array) -> ScenarioError:
    """The error with the place in the study that is to blame, and keys that may have been meant."""
    base = plan.base.document(0, {})
    error = with_hint(error, plan.changes(0, row), base)
    text, path = str(error), re.sub(r"\[(\d+)\]", r".\1", error.path)
    unknown = re.search(r"unknown key `([^`]*)`", text)
    keys = [(f"factors[{i}]", key) for i, factor in enumerate(plan.factors) for key in factor.touched]
    for place, key in [*keys, *(("overrides", key) for key in plan.overrides)]:
        strange = unknown is not None and unknown[1] in key.split(".")
        if key == path or text.startswith(f"{key}:") or strange:
            near = nearest(key, base) if strange and "did you mean" not in text else []
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            return ScenarioError(f"{place}: {text}{hint}", error.path)
    return ScenarioError(f"scenario: {text}", error.path)
