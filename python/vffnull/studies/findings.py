"""A dataset in numbers: how its runs ended, and which factor decides about which metric."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull.evaluation.table import Rate, wilson
from vffnull.studies.designs import Saltelli
from vffnull.studies.effects import Indices, explained, indices
from vffnull.studies.reading import Runs

__all__ = ["EARLY", "FAILURES", "Findings", "chosen", "coordinates", "findings", "whole_runs"]

EARLY = ("diverged", "failed", "refused")
"""How runs end that did not reach their end."""

FAILURES = ("collided", *EARLY)
"""How runs end that did not do what they should."""

MAIN = ("min_clearance", "max_error_transient", "max_error_tail", "peak_torque", "effort", "rms_jerk")
"""Metrics that come first where there is no room for all."""


@dataclass(frozen=True)
class Findings:
    """What a dataset says, in numbers.

    Attributes
    ----------
    runs, of : int
        How many runs are there, and how many there will be.
    counts : dict of str to int
        How many of them ended how.
    failures : Rate
        The share that collided, diverged, failed or was refused, with its 95 % interval.
    metrics : dict of str to (5,) ndarray
        Of each metric, over the runs that reached their end, its minimum, 5th percentile, median, 95th
        percentile and maximum.
    units : dict of str to str
        The units of the metrics.
    factors : list of str
        What varies.
    explained : dict of str to (factors,) ndarray
        Of each metric, which share of its variance each factor explains alone, from the runs as they are;
        also of ``"failure"``.
    indices : dict of str to list of Indices
        Sobol indices of each metric, where the design is one of Saltelli's; empty otherwise.
    """

    runs: int
    of: int
    counts: dict[str, int]
    failures: Rate
    metrics: dict[str, NDArray[np.float64]]
    units: dict[str, str]
    factors: list[str]
    explained: dict[str, NDArray[np.float64]]
    indices: dict[str, list[Indices]]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain numbers, None where there is none."""

        def told(found: Indices) -> dict[str, Any]:
            return {"first": _plain(found.first), "total": _plain(found.total)}

        rate = self.failures
        return {
            "runs": self.runs,
            "of": self.of,
            "counts": self.counts,
            "failures": {
                "count": rate.count,
                "total": rate.total,
                "interval": _plain(np.array([rate.low, rate.high])),
            },
            "factors": self.factors,
            "metrics": {
                name: {
                    "unit": self.units[name],
                    **dict(zip(("min", "q05", "median", "q95", "max"), _plain(values), strict=True)),
                }
                for name, values in self.metrics.items()
            },
            "explained": {
                name: dict(zip(self.factors, _plain(values), strict=True))
                for name, values in self.explained.items()
            },
            "indices": {
                name: dict(zip(self.factors, map(told, found), strict=True))
                for name, found in self.indices.items()
            },
        }

    def __str__(self) -> str:
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        lines = [f"{self.runs:,} of {self.of:,} runs: {counts}; {self.failures} % failed", ""]
        heads = ["metric", "unit", "5 %", "median", "95 %"]
        rows = [
            [name, self.units[name], *(f"{values[i]:.4g}" for i in (1, 2, 3))]
            for name, values in self.metrics.items()
        ]
        lines += _lines(heads, rows, text=2)
        if self.factors and self.explained:
            lines += ["", "share of the variance that each factor explains alone [%]"]
            lines += _lines(
                ["", *self.factors],
                [[name, *(_percent(each) for each in values)] for name, values in self.explained.items()],
                text=1,
            )
        if self.indices:
            lines += ["", "Sobol indices, alone / in all [%]"]
            lines += _lines(
                ["", *self.factors],
                [
                    [name, *(f"{estimate(each.first)} / {estimate(each.total)}" for each in found)]
                    for name, found in self.indices.items()
                ],
                text=1,
            )
        return "\n".join(lines)


def findings(dataset: Runs, metrics: Iterable[str] | None = None) -> Findings:
    """What a dataset says.

    Parameters
    ----------
    dataset : Runs
        The runs, perhaps not all of them yet.
    metrics : iterable of str, optional
        Which metrics; those that vary by default, the main ones first.

    Raises
    ------
    vffnull.errors.InputError
        If there is no run yet, or no such metric.
    """
    names = chosen(dataset, metrics)
    columns = whole_runs(dataset.columns(["run", "status", *dataset.factors, *names]), names)
    failed = np.isin(columns["status"], FAILURES)
    factors = coordinates(dataset, columns)
    metrics_of: dict[str, Any] = {"failure": failed.astype(float)} if 0 < failed.sum() < len(failed) else {}
    metrics_of |= {name: columns[name] for name in names}
    design = dataset.plan.design
    return Findings(
        runs=len(failed),
        of=dataset.runs if not dataset.manifest["tuned"] else max(dataset.runs, len(failed)),
        counts=dataset.counts(),
        failures=wilson(int(failed.sum()), len(failed)),
        metrics={name: _spread(columns[name]) for name in names},
        units={name: dataset.unit(name) for name in names},
        factors=dataset.factors,
        explained={
            name: np.array([explained(factor, values) for factor in factors])
            for name, values in metrics_of.items()
        },
        indices={
            name: indices(_samples(dataset, columns["run"], values), dataset.plan.seed)
            for name, values in metrics_of.items()
        }
        if isinstance(design, Saltelli)
        else {},
    )


def whole_runs(columns: dict[str, NDArray[Any]], metrics: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Columns without the metrics of runs that ended early: half a run says nothing about them."""
    early = np.isin(columns["status"], EARLY)
    return columns | {name: np.where(early, np.nan, columns[name]) for name in metrics}


def chosen(dataset: Runs, metrics: Iterable[str] | None, most: int | None = None) -> list[str]:
    """The metrics that are meant: those that vary by default, the main ones first."""
    known = dataset.metrics
    if metrics is not None:
        wanted = list(dict.fromkeys(metrics))
        for name in wanted:
            if name not in known:
                raise InputError(f"metric: this study has no {name!r}; it has {', '.join(known)}")
        return wanted
    columns = whole_runs(dataset.columns(["status", *known]), known)
    varying = [name for name in known if np.ptp(_finite(columns[name])) > 0]
    return sorted(varying, key=lambda name: MAIN.index(name) if name in MAIN else len(MAIN))[:most]


def coordinates(dataset: Runs, columns: dict[str, NDArray[Any]]) -> list[NDArray[np.float64]]:
    """The columns of the factors as numbers, logarithms where that is how they were spread."""
    found = []
    for factor in dataset.plan.factors:
        values = columns[factor.name]
        if factor.values is not None:
            places = {
                value: float(i) for i, value in enumerate(factor.column(np.arange(float(len(factor.values)))))
            }
            found.append(np.array([places[each] for each in values.tolist()]))
        else:
            found.append(np.log(values.astype(float)) if factor.log else values.astype(float))
    return found


def _finite(values: NDArray[Any]) -> NDArray[np.float64]:
    there: NDArray[np.float64] = values[np.isfinite(values)]
    return there if len(there) else np.zeros(1)


def _spread(values: NDArray[np.float64]) -> NDArray[np.float64]:
    there = values[np.isfinite(values)]
    return np.quantile(there, (0, 0.05, 0.5, 0.95, 1)) if len(there) else np.full(5, np.nan)


def _samples(dataset: Runs, runs: NDArray[Any], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """A metric (base samples, factors + 2), only samples of which all runs are there and have it."""
    plan = dataset.plan
    width = len(plan.factors) + 2
    group, repetition = np.divmod(runs, plan.repetitions)
    scene, point = np.divmod(group, plan.points)
    base, place = np.divmod(point, width)
    row = (scene * plan.repetitions + repetition) * (plan.points // width) + base
    rows, at = np.unique(row, return_inverse=True)
    found = np.full((len(rows), width), np.nan)
    found[at.reshape(-1), place] = values
    whole: NDArray[np.float64] = found[np.all(np.isfinite(found), axis=1)]
    return whole


def _plain(values: NDArray[np.float64]) -> list[float | None]:
    return [float(each) if np.isfinite(each) else None for each in values]


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if np.isfinite(share) else "–"


def estimate(index: NDArray[np.float64]) -> str:
    """An index in per cent; a question mark if its 95 % interval spans everything, from too few samples."""
    return "?" if index[2] - index[1] > 1.0 else _percent(index[0])


def _lines(heads: list[str], rows: list[list[str]], text: int) -> list[str]:
    """A table in columns, the first `text` of them of words."""
    widths = [max(len(row[i]) for row in [heads, *rows]) for i in range(len(heads))]
    return [
        "  ".join(
            f"{cell:<{width}}" if i < text else f"{cell:>{width}}"
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in [heads, *rows]
    ]
