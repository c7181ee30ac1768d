"""The document of a study, read and found fit to run: what varies, over which scenarios, and what is kept."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import vffnull._core as _core
from vffnull._support.errors import InputError, InputTypeError, ScenarioError
from vffnull.model.document import dotted, plain
from vffnull.model.keys import nearest
from vffnull.model.record import QUANTITIES
from vffnull.model.scenario import check_overrides, with_hint
from vffnull.studies._keyed import Keyed, finite
from vffnull.studies.designs import DESIGNS, MOST, Design, read_design
from vffnull.studies.factors import Factor, read_factor
from vffnull.studies.plan import FIXED, Array, Goal, Plan, Records, Tuning
from vffnull.studies.scenes import read_base
from vffnull.studies.tabulated import columns_of, read_table, with_spread

__all__ = ["AGGREGATES", "read_plan"]


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


_MAX_SEED = 2**63 - 1
_SPREAD = 16  # points that are tried before the first run

AGGREGATES = ("mean", "median", "min", "max", "q05", "q95")


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
    seed = table.whole("seed", 0, 0, _MAX_SEED)
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
        touched = [dotted(key) for key in factor.touched]
        for key in touched:
            if key in keys:
                raise InputError(f"factors[{i}]: {key} is changed by {keys[key]}, too")
            if part := next((each for each in keys if each.startswith(f"{key}.")), None):
                raise InputError(
                    f"factors[{i}]: {key} takes the place of {part}, which {keys[part]} changes before; "
                    "put this factor first"
                )
        keys |= dict.fromkeys(touched, factor.name)
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
            _core.check("scenario", plan.document(0, row), recorded=plan.records is not None)
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
    text, path = str(error), dotted(error.path)
    unknown = re.search(r"unknown key `([^`]*)`", text)
    keys = [(f"factors[{i}]", key) for i, factor in enumerate(plan.factors) for key in factor.touched]
    for place, key in [*keys, *(("overrides", key) for key in plan.overrides)]:
        strange = unknown is not None and unknown[1] in key.split(".")
        if key == path or text.startswith(f"{key}:") or strange:
            near = nearest(key, base) if strange and "did you mean" not in text else []
            hint = f"; did you mean {' or '.join(near)}?" if near else ""
            return ScenarioError(f"{place}: {text}{hint}", error.path)
    return ScenarioError(f"scenario: {text}", error.path)
