"""Running a scenario from start to end."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from vffnull import _core
from vffnull._document import Document, plain, put
from vffnull.errors import InputError, InputTypeError, ScenarioWarning
from vffnull.result import Metrics, Result, Status
from vffnull.scenario import Scenario, ScenarioLike, read

__all__ = ["simulate"]

Progress = Callable[[float, float], None]

_PLANTS = ("core", "mujoco")


def simulate(
    scenario: ScenarioLike,
    overrides: Mapping[str, Any] | None = None,
    progress: bool | Progress | None = None,
    plant: str = "core",
) -> Result:
    """Run a scenario.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        A bundled name (see `scenarios`), a path that ends in ``.toml``, a document, or a scenario.
    overrides : Mapping, optional
        Other values for some keys, by dotted name, as in `Scenario.replace`.
    progress : bool or callable, optional
        True shows a progress bar; a callable gets the simulated time and the duration [s] every 100 ms or so.
    plant : {"core", "mujoco"}, optional
        What moves the arm under the controller's torque: the core, where links pass through obstacles, or
        MuJoCo, where they touch; see `vffnull.mujoco_plant.run` for what it can and what it leaves out.

    Returns
    -------
    Result
        How the run ended, what it measured, and what was recorded. A run that diverges or collides is a
        result with that status, not an exception; after Ctrl-C it holds what was computed until then.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run; nothing has been computed then.
    vffnull.errors.InputError
        If there is no such plant.
    vffnull.errors.InputTypeError
        If an argument, or a value inside, is of a type that cannot be used.
    ImportError
        If the plant is MuJoCo, without the extra ``vffnull[mujoco]``.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        If the scenario can be run but is probably not what was meant.

    Examples
    --------
    >>> result = simulate("paper-1", overrides={"controller.field.gain": 2.0, "duration": 5.0})
    >>> print(result.metrics)  # doctest: +SKIP
    """
    check_progress(progress)
    if plant not in _PLANTS:
        raise InputError(f"plant: expected one of {', '.join(_PLANTS)}, not {plant!r}")
    ready = prepare(scenario, overrides)
    if progress is True:
        with progress_bar(ready.duration) as report:
            result = run(ready, report, plant)
    else:
        result = run(ready, progress or None, plant)
    for message in result.warnings:
        warnings.warn(message, ScenarioWarning, stacklevel=2)
    return result


def check_progress(progress: object) -> None:
    """Refuse what is neither a switch nor a callable."""
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise InputTypeError(f"progress: expected True or a callable, not a {type(progress).__name__}")


def prepare(scenario: ScenarioLike, overrides: Mapping[str, Any] | None = None) -> Scenario:
    """The scenario that is meant, with the overrides applied before anything is checked."""
    check_overrides(overrides)
    if isinstance(scenario, Scenario) and not overrides:
        return scenario
    return Scenario.from_dict(changed(document_of(scenario), overrides))


def check_overrides(overrides: object) -> None:
    """Refuse what is not a dictionary."""
    if overrides is not None and not isinstance(overrides, Mapping):
        raise InputTypeError(f"overrides: expected a dict of dotted names, not a {type(overrides).__name__}")


def document_of(scenario: ScenarioLike) -> Document:
    """The document of what is meant, unchecked, as a copy of its own."""
    if isinstance(scenario, Scenario):
        return scenario.to_dict()
    if isinstance(scenario, Mapping):
        document: Document = plain(scenario)
        return document
    return _core.parse_toml(read(scenario), str(scenario))


def changed(document: Document, overrides: Mapping[str, Any] | None) -> Document:
    """The document itself, with other values for some keys."""
    for name, value in (overrides or {}).items():
        put(document, name, value)
    return document


def run(scenario: Scenario, progress: Progress | None = None, plant: str = "core") -> Result:
    """Run a scenario without a word; the warnings are in the result."""
    if plant == "mujoco":
        from vffnull import mujoco_plant

        return mujoco_plant.run(scenario, progress)
    return result_of(scenario, _core.run(scenario.to_dict(), progress))


def result_of(scenario: Scenario, outcome: Mapping[str, Any]) -> Result:
    """What the core hands back, as a result."""
    return Result(
        scenario=scenario,
        status=Status(outcome["status"]),
        message=outcome["message"],
        end_time=outcome["end_time"],
        wall_time=outcome["wall_time"],
        warnings=tuple(outcome["warnings"]),
        metrics=Metrics(outcome["metrics"]),
        version=_core.__version__,
        **outcome["record"],
    )


@contextmanager
def progress_bar(total: float, delay: float = 0.0, counts: str = ".1f s simulated") -> Iterator[Progress]:
    """A bar on stderr that appears after `delay` [s]; `counts` gives format and name of the numbers."""
    from tqdm import tqdm

    digits, _, what = counts.partition(" ")
    numbers = f"{{n:{digits}}}/{{total:{digits}}} {what}"
    form = f"{{percentage:3.0f}}%|{{bar}}| {numbers} [{{elapsed}}<{{remaining}}]"
    with tqdm(total=total, delay=delay, bar_format=form, leave=False) as bar:

        def report(done: float, _total: float) -> None:
            bar.update(done - bar.n)

        yield report
