"""The closed loop against the wall clock: what rate this machine can hold."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vffnull import _core
from vffnull._simulate import check_progress, prepare
from vffnull.errors import InputError, InputTypeError, ScenarioWarning
from vffnull.result import Status
from vffnull.scenario import Scenario, ScenarioLike

if TYPE_CHECKING:
    import os

    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

__all__ = ["Histogram", "RealTimeReport", "realtime"]

Progress = Callable[[int, int], None]

FIGURE_ENDINGS = (".png", ".pdf", ".svg")


def realtime(
    scenario: ScenarioLike,
    rate: float = 1000.0,
    seconds: float = 60.0,
    *,
    overrides: Mapping[str, Any] | None = None,
    priority: int | None = None,
    core: int | None = None,
    progress: bool | Progress | None = None,
) -> RealTimeReport:
    """Run the closed loop against the wall clock and measure how well the clock is kept.

    Plant and controller run together on a thread of the core, once per control period, at absolute
    deadlines; a scenario that is over begins again. A period that begins late is not left out: it is computed
    at once, until the clock is caught up with.

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
        Run under SCHED_FIFO with this priority, 1 to 99, which systems grant to few. Above that of other
        threads, a loop that takes all its time starves them.
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
    check_progress(progress)
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
    progress: bool | Progress | None = None,
) -> RealTimeReport:
    """Measure without a word; the notes are in the report."""
    rate, seconds = _number("rate", rate), _number("seconds", seconds)
    priority, core = _whole("priority", priority, 1, 99), _whole("core", core, 0, 1 << 20)
    with _report(progress, seconds) as report:
        found = _core.real_time(scenario.to_dict(), rate, seconds, priority, core, report)
    for name in ("latency", "step", "response", "jitter"):
        found[name] = Histogram(*found[name])
    found |= {"status": Status(found["status"]), "notes": tuple(found["notes"])}
    return RealTimeReport(scenario=scenario, **found)


@dataclass(frozen=True, eq=False)
class Histogram:
    """Durations and how often each occurred, to three digits.

    Attributes
    ----------
    values : (B,) ndarray
        Durations [s], ascending.
    counts : (B,) ndarray
        How often each occurred.
    """

    values: NDArray[np.float64]
    counts: NDArray[np.uint64]

    def __len__(self) -> int:
        return int(self.counts.sum())

    def __repr__(self) -> str:
        if not len(self):
            return "<Histogram: empty>"
        median, most, worst = (_readable(self.quantile(p)) for p in (0.5, 0.999, 1.0))
        return f"<Histogram of {len(self)}: median {median}, 99.9 % {most}, worst {worst}>"

    def quantile(self, p: float) -> float:
        """The duration [s] that a share `p` of all, 0 to 1, does not exceed; NaN if there is none."""
        import numpy as np

        if not 0.0 <= p <= 1.0:
            raise InputError(f"p: must be from 0 to 1, got {p}")
        if not len(self):
            return float("nan")
        reached = np.searchsorted(np.cumsum(self.counts), max(p * len(self), 1.0) * (1 - 1e-12))
        return float(self.values[reached])

    @property
    def max(self) -> float:
        """The longest [s]; NaN if there is none."""
        return self.quantile(1.0)


@dataclass(frozen=True, eq=False, repr=False)
class RealTimeReport:
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
        From the instant at which a period was due to begin to when it did.
    step : Histogram
        How long plant, law and obstacles took.
    response : Histogram
        From the instant at which a period was due to begin to the end of its step.
    jitter : Histogram
        How far the time between two beginnings was off the period.
    notes : tuple of str
        What was changed in the scenario, what is odd about it, and what the system refused.
    """

    scenario: Scenario
    status: Status
    rate: float
    dt: float
    periods: int
    missed: int
    restarts: int
    min_clearance: float | None
    latency: Histogram
    step: Histogram
    response: Histogram
    jitter: Histogram
    notes: tuple[str, ...]

    @property
    def held(self) -> bool:
        """Whether every period ended in time."""
        return self.periods > 0 and not self.missed

    @property
    def verdict(self) -> str:
        """What this machine could hold, in a sentence."""
        if not self.periods:
            return f"Nothing was measured at {self.rate:g} Hz."
        worst = f"the slowest ended {_readable(self.response.max)} after it was due to begin"
        if self.held:
            return (
                f"{self.rate:g} Hz was held: all of {self.periods} steps ended in time; {worst}, "
                f"which leaves room up to {_rate(self.response.max)}."
            )
        return (
            f"{self.rate:g} Hz was not held: {self.missed} of {self.periods} steps "
            f"({100.0 * self.missed / self.periods:.2g} %) ended late; {worst}, which only "
            f"{_rate(self.response.max)} or less would have allowed."
        )

    def to_dict(self) -> dict[str, Any]:
        """The report as plain values, for JSON: times in seconds, histograms by their quantiles."""
        return {
            "scenario": self.scenario.name,
            "status": self.status.value,
            "verdict": self.verdict,
            "held": self.held,
            "rate": self.rate,
            "dt": self.dt,
            "periods": self.periods,
            "missed": self.missed,
            "restarts": self.restarts,
            "min_clearance": self.min_clearance,
            "notes": list(self.notes),
            **{name: _summary(histogram) for name, histogram in self._times().items()},
        }

    def _times(self) -> dict[str, Histogram]:
        return {
            "latency": self.latency,
            "step": self.step,
            "response": self.response,
            "jitter": self.jitter,
        }

    def __str__(self) -> str:
        head = ("", *_QUANTILES)
        rows = [
            (_MEANINGS[name], *(_readable(histogram.quantile(p)) for p in _QUANTILES.values()))
            for name, histogram in self._times().items()
        ]
        wide = [max(len(row[column]) for row in (head, *rows)) for column in range(len(head))]
        lines = [
            "  ".join(
                [f"{row[0]:<{wide[0]}}", *(f"{x:>{w}}" for x, w in zip(row[1:], wide[1:], strict=True))]
            )
            for row in (head, *rows)
        ]
        return "\n".join([*(line.rstrip() for line in lines), "", self.verdict])

    def __repr__(self) -> str:
        return f"<RealTimeReport: {self.verdict}>"

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
        from vffnull.plotting import timing

        return timing.draw(self) if path is None else timing.save(self, Path(path))


_QUANTILES = {"median": 0.5, "99 %": 0.99, "99.9 %": 0.999, "worst": 1.0}

_MEANINGS = {
    "latency": "wake-up, late by",
    "step": "step, takes",
    "response": "step, ends after it was due to begin",
    "jitter": "period, off by",
}


def _summary(histogram: Histogram) -> dict[str, float | None]:
    names = {"p50": 0.5, "p99": 0.99, "p999": 0.999, "max": 1.0}
    return {name: histogram.quantile(p) if len(histogram) else None for name, p in names.items()}


def _readable(seconds: float) -> str:
    """A duration in the unit in which it reads well."""
    if seconds != seconds:
        return "–"
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def _rate(response: float) -> str:
    """The rate [Hz] at which every period would be as long as the response, two digits, rounded down."""
    import math

    rate = 1.0 / response
    size = 10.0 ** (math.floor(math.log10(rate)) - 1)
    rate = math.floor(rate / size) * size
    return f"{rate / 1000:g} kHz" if rate >= 1000 else f"{rate:g} Hz"


def _number(name: str, value: object) -> float:
    try:
        if isinstance(value, bool | str):
            raise TypeError
        return float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise InputTypeError(f"{name}: expected a number, not a {type(value).__name__}") from None


def _whole(name: str, value: Any, least: int, most: int) -> int | None:
    if value is None:
        return None
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise InputTypeError(f"{name}: expected a whole number, not a {type(value).__name__}")
    if not least <= value <= most:
        raise InputError(f"{name}: must be from {least} to {most}, got {value}")
    return int(value)


@contextmanager
def _report(progress: bool | Progress | None, seconds: float) -> Iterator[Progress | None]:
    if progress is not True:
        yield progress or None
        return
    from tqdm import tqdm

    form = "{percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}]"
    with tqdm(total=seconds, bar_format=form, leave=False) as bar:
        yield lambda done, total: bar.update(seconds * done / total - bar.n)
