"""The data of a measurement against the wall clock: histograms of times, and what follows from them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vffnull._support.errors import InputError
from vffnull.model.outcome import Status

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from vffnull.model.scenario import Scenario

__all__ = ["Clock", "Histogram", "Timing"]


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
class Clock:
    """How well a clock was kept: histograms of times, and what follows from them."""

    rate: float
    periods: int
    missed: int
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

    def _times(self) -> dict[str, Histogram]:
        return {
            "latency": self.latency,
            "step": self.step,
            "response": self.response,
            "jitter": self.jitter,
        }

    def _summaries(self) -> dict[str, dict[str, float | None]]:
        return {name: _summary(histogram) for name, histogram in self._times().items()}

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


@dataclass(frozen=True, eq=False, repr=False)
class Timing(Clock):
    """The data of a measurement; `vffnull.RealTimeReport` says what each attribute is, with units."""

    scenario: Scenario
    status: Status
    dt: float
    restarts: int
    min_clearance: float | None

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
            **self._summaries(),
        }

    def __repr__(self) -> str:
        return f"<RealTimeReport: {self.verdict}>"


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
