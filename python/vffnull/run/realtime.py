"""The closed loop against the wall clock: what rate this machine can hold."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.arguments import number, whole
from vffnull._support.errors import ScenarioWarning
from vffnull._support.progress import Counter
from vffnull.model.outcome import Status
from vffnull.model.scenario import Scenario, ScenarioLike, prepare
from vffnull.model.timing import Histogram, Timing

if TYPE_CHECKING:
    import os

    from matplotlib.figure import Figure

__all__ = ["Histogram", "RealTimeReport", "measure", "realtime"]


@dataclass(frozen=True, eq=False, repr=False)
class RealTimeReport(Timing):
    """How well the clock was kept.

    Attributes
    ----------
    scenario : Scenario
        What was run.
    status : Status
        How it ended; ``"collided"`` if a link touched an obstacle.
    rate : float
        Control periods per second [Hz].
    dt : float
        The plant's step [s].
    periods : int
        Control periods done.
    missed : int
        Periods whose work did not end before the next should begin.
    restarts : int
        How often the scenario began again.
    min_clearance : float or None
        Smallest distance between a link and an obstacle [m]; None without obstacles.
    latency : Histogram
        From the instant at which a period was due to start to its start.
    step : Histogram
        How long plant, law and obstacles took.
    response : Histogram
        From the instant at which a period was due to start to the end of its step.
    jitter : Histogram
        Deviation of the interval between two starts from the period.
    notes : tuple of str
        What was changed in the scenario, what is odd about it, and what the system refused.
    """

    scenario: Scenario

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure | Path:
        """Draw the histograms over logarithmic axes.

        Parameters
        ----------
        path : str or path, optional
            Where to write the figure, by its ending: ``.png``, ``.pdf``, ``.svg``.

        Returns
        -------
        matplotlib.figure.Figure or Path
            The figure; with a `path`, the file written.
        """
        from vffnull.draw.figures import timing

        return timing.draw(self) if path is None else timing.save(self, Path(path))


def realtime(
    scenario: ScenarioLike,
    rate: float = 1000.0,
    seconds: float = 60.0,
    *,
    overrides: Mapping[str, Any] | None = None,
    priority: int | None = None,
    core: int | None = None,
    progress: bool | Counter | None = None,
) -> RealTimeReport:
    """Run the closed loop against the wall clock and measure how well the clock is kept.

    Plant and controller run together on a thread of the core, once per control period, at absolute
    deadlines; a scenario that is over starts again. A period that starts late is not skipped: periods are
    computed without waiting until the loop is on time again.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        As in `simulate`. Where its step does not divide the period, a smaller one is used, and a continuous
        law is held over the period; the report's `notes` say so.
    rate : float, optional
        Control periods per second [Hz].
    seconds : float, optional
        How long [s].
    overrides : Mapping, optional
        Other values for some keys, by dotted name.
    priority : int, optional
        Run under SCHED_FIFO with this priority, 1 to 99, which few users are allowed. A loop that uses all of
        its time starves threads of lower priority.
    core : int, optional
        Stay on this core.
    progress : bool or callable, optional
        True shows a progress bar; a callable gets the number of periods done and the number of all.

    Returns
    -------
    RealTimeReport
        Histograms of wake-up, step and jitter, missed deadlines, and a sentence about them. Ctrl-C ends the
        measurement with what there is.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run at this rate.
    vffnull.errors.InputError
        If rate, seconds, priority or core make no sense here.
    vffnull.errors.InputTypeError
        If an argument is of a type that cannot be used.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        For each of the report's `notes`: what was changed, and what the system refused.

    Examples
    --------
    >>> report = realtime("sweep-through", rate=500.0, seconds=0.1)
    >>> report.periods
    50
    """
    _progress.check(progress)
    report = measure(prepare(scenario, overrides), rate, seconds, priority, core, progress)
    for note in report.notes:
        warnings.warn(note, ScenarioWarning, stacklevel=2)
    return report


def measure(
    scenario: Scenario,
    rate: float,
    seconds: float,
    priority: int | None = None,
    core: int | None = None,
    progress: bool | Counter | None = None,
) -> RealTimeReport:
    """Measure; the notes are in the report, and no warning is raised."""
    rate, seconds = number("rate", rate), number("seconds", seconds)
    priority = None if priority is None else whole("priority", priority, 1, 99)
    core = None if core is None else whole("core", core, 0, 1 << 20)
    with _report(progress, seconds) as report:
        found = _core.real_time(scenario.to_dict(), rate, seconds, priority, core, report)
    for name in ("latency", "step", "response", "jitter"):
        found[name] = Histogram(*found[name])
    found |= {"status": Status(found["status"]), "notes": tuple(found["notes"])}
    return RealTimeReport(scenario=scenario, **found)


@contextmanager
def _report(progress: bool | Counter | None, seconds: float) -> Iterator[Counter | None]:
    if progress is not True:
        yield progress or None
        return
    with _progress.bar(seconds, counts=".1f s") as report:
        yield report
