"""Running many scenarios on all cores."""

from __future__ import annotations

import copy
import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.arguments import MAX_THREADS, whole
from vffnull._support.errors import InputError, InputTypeError, ScenarioError, ScenarioWarning
from vffnull._support.progress import Counter, counted
from vffnull.model.arm_files import explicit
from vffnull.model.document import Document, plain
from vffnull.model.scenario import Scenario, ScenarioLike, changed, check_overrides, source_of
from vffnull.run.result import Result

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["metrics_table", "simulate_many"]

_Overrides = Mapping[str, Any]


def simulate_many(
    scenarios: ScenarioLike | Iterable[ScenarioLike],
    overrides: _Overrides | Iterable[_Overrides] | None = None,
    threads: int | None = None,
    record: bool = True,
    progress: bool | Counter | None = None,
) -> list[Result]:
    """Run many scenarios on all cores.

    Parameters
    ----------
    scenarios : iterable of what `simulate` accepts, or one of them
        The scenarios. One scenario alone needs a list of `overrides`.
    overrides : Mapping, or iterable of Mapping, optional
        Other values for some keys, by dotted name. A dictionary applies to every scenario; a list of them
        makes one run each of a single scenario.
    threads : int, optional
        How many threads compute; as many as there are cores by default.
    record : bool, optional
        False keeps status and metrics only; the arrays of the results have no rows then. Records are held in
        memory until the end, and all of them together may take 8 GB.
    progress : bool or callable, optional
        True shows a progress bar; a callable gets the number of finished scenarios and the number of all
        every 100 ms or so.

    Returns
    -------
    list of Result
        In the order of the scenarios, equal to those of `simulate` to the last bit, whatever the number of
        threads. After Ctrl-C, what was not finished is ``"interrupted"``. A run that a fault of vffnull
        itself has ended is ``"failed"``, its message says why, and it leaves the others alone.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a scenario cannot be run; the message names its index, and nothing has been computed.
    vffnull.errors.InputError
        If `threads` is less than 1, if all records together are too large, or if a list of overrides meets
        more than one scenario.
    vffnull.errors.InputTypeError
        If an argument, or a value inside, is of a type that cannot be used.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        Once for each warning, with the number of scenarios that it concerns.

    See Also
    --------
    metrics_table : the metrics of all results as columns.

    Examples
    --------
    >>> gains = [{"controller.field.gain": gain} for gain in (0.0, 0.5, 1.0)]
    >>> results = simulate_many("sweep-through", gains, record=False)
    >>> [str(result.status) for result in results]
    ['collided', 'completed', 'completed']
    """
    _progress.check(progress)
    if not isinstance(record, bool):
        raise InputTypeError(f"record: expected True or False, not a {type(record).__name__}")
    if threads is not None:
        threads = whole("threads", threads, 1, MAX_THREADS)
    name, documents = _documents(scenarios, overrides)
    with counted(progress, len(documents)) as report:
        outcomes = _core.run_many(documents, name, threads, record, report)
    pairs = zip(documents, outcomes, strict=True)
    results = [Result.of(Scenario._of(document), outcome) for document, outcome in pairs]
    for message in _warnings_of(name, results):
        warnings.warn(message, ScenarioWarning, stacklevel=2)
    return results


def _documents(
    scenarios: ScenarioLike | Iterable[ScenarioLike],
    overrides: _Overrides | Iterable[_Overrides] | None,
) -> tuple[str, list[Document]]:
    """What error messages call the list, and the documents in it."""
    if isinstance(scenarios, str | os.PathLike | Mapping | Scenario):
        if overrides is None or isinstance(overrides, Mapping) or not isinstance(overrides, Iterable):
            raise InputTypeError("overrides: one scenario needs a list of dicts, one for each run")
        one = source_of(scenarios)
        read = cache(lambda: explicit(copy.deepcopy(one)))  # not once for every run

        def of(each: _Overrides) -> Document:
            if any(str(name).partition(".")[0] == "arm" for name in each or ()):
                return explicit(changed(copy.deepcopy(one), each))
            return changed(copy.deepcopy(read()), each)

        return "overrides", [_placed("overrides", i, each, of) for i, each in enumerate(overrides)]
    if not isinstance(scenarios, Iterable):
        raise InputTypeError(f"scenarios: expected a list of scenarios, not a {type(scenarios).__name__}")
    if not (overrides is None or isinstance(overrides, Mapping)):
        raise InputTypeError("overrides: a list of dicts needs one scenario, a list of scenarios one dict")
    return "scenarios", [
        _placed("scenarios", i, each, lambda each: explicit(changed(source_of(each), overrides)))
        for i, each in enumerate(scenarios)
    ]


def _placed(name: str, i: int, given: Any, make: Callable[[Any], Document]) -> Document:
    """Make a document; a fault says which one it is."""
    try:
        if name == "overrides":
            check_overrides(given)
        return make(given)
    except ScenarioError as error:
        path = f"{name}[{i}].{error.path}" if error.path else f"{name}[{i}]"
        raise ScenarioError(f"{name}[{i}]: {error}", path) from None
    except (InputError, InputTypeError) as error:
        raise type(error)(f"{name}[{i}]: {error}") from None


def _warnings_of(name: str, results: Iterable[Result]) -> Iterator[str]:
    """Every warning once, with the first scenario that it concerns."""
    places: dict[str, list[int]] = {}
    for i, result in enumerate(results):
        for message in result.warnings:
            places.setdefault(message, []).append(i)
    for message, (first, *others) in places.items():
        more = f" (and {len(others)} more)" if others else ""
        yield f"{name}[{first}]{more}: {message}"


def metrics_table(results: Iterable[Result], keys: Sequence[str] = ()) -> dict[str, NDArray[np.generic]]:
    """The outcomes of many runs as columns, one entry per run.

    Parameters
    ----------
    results : iterable of Result
        The runs.
    keys : sequence of str, optional
        Keys of the scenarios, by dotted name, to be columns too: what was varied, for instance.

    Returns
    -------
    dict of str to ndarray
        The keys, then ``status``, ``end_time`` [s], ``wall_time`` [s], and every metric; NaN where a metric
        does not apply. ``pandas.DataFrame`` takes it as it is.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a scenario does not have a key.

    Examples
    --------
    >>> gains = [{"controller.field.gain": gain} for gain in (0.0, 0.5)]
    >>> results = simulate_many("sweep-through", gains, record=False)
    >>> table = metrics_table(results, ["controller.field.gain"])
    >>> table["intrusion_depth"] > 0
    array([ True, False])
    """
    import numpy as np

    if isinstance(keys, str):
        raise InputTypeError("keys: expected a list of dotted names, not a str")
    rows = list(results)
    for i, row in enumerate(rows):
        if not isinstance(row, Result):
            raise InputTypeError(f"results[{i}]: expected a Result, not a {type(row).__name__}")
    table: dict[str, NDArray[np.generic]] = {}
    for key in keys:
        table[key] = _column([row.scenario[key] for row in rows])
    table["status"] = np.array([str(row.status) for row in rows], dtype=np.str_)
    table["end_time"] = np.array([row.end_time for row in rows], dtype=float)
    table["wall_time"] = np.array([row.wall_time for row in rows], dtype=float)
    for name in _core.METRICS:
        table[name] = np.array([row.metrics.get(name) for row in rows], dtype=float)
    return table


def _column(values: list[Any]) -> NDArray[np.generic]:
    """Numbers or strings as they are; lists and tables as objects."""
    import numpy as np

    if all(isinstance(value, bool | int | float | str) for value in values):
        return np.array(values)
    column = np.empty(len(values), dtype=object)
    column[:] = [plain(value) for value in values]
    return column
