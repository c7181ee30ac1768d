"""Running a scenario from start to end."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.errors import InputError, ScenarioWarning
from vffnull._support.progress import Progress
from vffnull.model.scenario import Scenario, ScenarioLike, prepare
from vffnull.run.result import Result

__all__ = ["PLANTS", "prepare", "run", "simulate"]

PLANTS = ("core", "mujoco")


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
        What moves the arm under the controller's torque: the core, where links pass through obstacles without
        a ``contact``, or MuJoCo, where they touch; see `vffnull.engines.mujoco_plant.MuJoCoPlant` for what it
        can and what it leaves out.

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
    _progress.check(progress)
    if plant not in PLANTS:
        raise InputError(f"plant: expected one of {', '.join(PLANTS)}, not {plant!r}")
    ready = prepare(scenario, overrides)
    if progress is True:
        with _progress.bar(ready.duration) as report:
            result = run(ready, report, plant)
    else:
        result = run(ready, progress or None, plant)
    for message in result.warnings:
        warnings.warn(message, ScenarioWarning, stacklevel=2)
    return result


def run(scenario: Scenario, progress: Progress | None = None, plant: str = "core") -> Result:
    """Run a scenario; the warnings are in the result, and none is raised."""
    if plant == "mujoco":
        from vffnull.engines import mujoco_plant

        return Result.of(scenario, mujoco_plant.run(scenario, progress), plant)
    return Result.of(scenario, _core.run(scenario.to_dict(), progress))
