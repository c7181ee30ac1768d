"""What the runs of a study say: effects of factors, indices of sensitivity, the Pareto front.

Functions of arrays alone, so that they can be checked against what is known in closed form.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Effect", "Indices", "bins_of", "effect", "explained", "front", "indices"]

Array = NDArray[np.float64]
Whole = NDArray[np.intp]

_RESAMPLED = 200
_MAX_LEVELS = 12  # of a factor that are shown one by one; more are put into bins


@dataclass(frozen=True)
class Effect:
    """A metric over the levels, or bins, of a factor.

    Attributes
    ----------
    at : (k,) ndarray
        The mean of the factor in each bin; the place of the value in its list for text.
    mean, low, high : (k,) ndarray
        The mean of the metric in each bin, and its 5th and 95th percentile.
    count : (k,) ndarray
        Runs in each bin.
    """

    at: Array
    mean: Array
    low: Array
    high: Array
    count: Whole


@dataclass(frozen=True)
class Indices:
    """Sobol indices of a factor, each with its 95 % interval from resampling.

    Attributes
    ----------
    first : (3,) ndarray
        Share of the variance that the factor explains alone: estimate, low, high.
    total : (3,) ndarray
        Share in which the factor takes part at all.
    """

    first: Array
    total: Array


def bins_of(values: Array, most: int = _MAX_LEVELS) -> Whole:
    """The bin of every value (n,), from 0: one for each level, or equally full ones if there are many."""
    levels, at = np.unique(values, return_inverse=True)
    if len(levels) <= most:
        return at.reshape(-1)
    edges = np.quantile(values, np.linspace(0, 1, most + 1)[1:-1])
    return np.searchsorted(np.unique(edges), values, side="right")


def effect(factor: Array, metric: Array) -> Effect:
    """A metric over the bins of a factor, runs without the metric left out."""
    there = np.isfinite(metric)
    factor, metric = factor[there], metric[there]
    at = bins_of(factor)
    groups = [at == each for each in np.unique(at)]
    low, high = (np.array([np.quantile(metric[each], q) for each in groups]) for q in (0.05, 0.95))
    return Effect(
        at=np.array([factor[each].mean() for each in groups]),
        mean=np.array([metric[each].mean() for each in groups]),
        low=low,
        high=high,
        count=np.array([each.sum() for each in groups], dtype=np.intp),
    )


def explained(factor: Array, metric: Array) -> float:
    """The share of a metric's variance that a factor explains alone, from any design; NaN if nothing varies.

    Of the variance between bins, what chance alone would put there is taken away (the estimator called ε²);
    below 0 it is rounded up.
    """
    there = np.isfinite(metric)
    factor, metric = factor[there], metric[there]
    n = len(metric)
    at = bins_of(factor, most=int(np.clip(n**0.5 / 2, 4, 32)))
    count = np.bincount(at)
    k = int((count > 0).sum())
    total = float(((metric - metric.mean()) ** 2).sum()) if n else 0.0
    if n - k < 1 or total <= 0 or k < 2:
        return float("nan") if total <= 0 or n - k < 1 else 0.0
    sums = np.bincount(at, metric)
    between = float((count[count > 0] * (sums[count > 0] / count[count > 0] - metric.mean()) ** 2).sum())
    within = (total - between) / (n - k)
    return max((between - (k - 1) * within) / total, 0.0)


def indices(samples: Array, seed: int = 0) -> list[Indices]:
    """Sobol indices from a design of Saltelli's.

    First indices by Saltelli et al. (2010), total ones by Jansen (1999), with intervals from 200 resamplings
    of the base samples.

    Parameters
    ----------
    samples : (n, factors + 2) ndarray
        A metric at the points of every base sample: A, A with each column from B, B.

    Returns
    -------
    list of Indices
        One for each factor; NaN if the metric does not vary.
    """
    n, width = samples.shape
    random = np.random.default_rng(seed)
    draws = [np.arange(n), *random.integers(n, size=(_RESAMPLED, n))] if n else []
    found = np.full((len(draws), 2, width - 2), np.nan)
    for i, rows in enumerate(draws):
        a, mixed, b = samples[rows, 0], samples[rows, 1:-1], samples[rows, -1]
        both = np.concatenate([a, b])
        variance = both.var()
        if variance <= 0:
            continue
        middle = both.mean()
        found[i, 0] = ((b - middle)[:, None] * (mixed - a[:, None])).mean(axis=0) / variance
        found[i, 1] = ((mixed - a[:, None]) ** 2).mean(axis=0) / 2 / variance
    result = []
    for j in range(width - 2):
        pair = [_interval(found[:, kind, j]) for kind in range(2)] if n else [np.full(3, np.nan)] * 2
        result.append(Indices(*pair))
    return result


def _interval(draws: Array) -> Array:
    """The estimate, which comes first, with the 95 % interval of the resampled ones."""
    others = draws[1:][np.isfinite(draws[1:])]
    ends = np.quantile(others, (0.025, 0.975)) if len(others) else (np.nan, np.nan)
    return np.array([draws[0], *ends])


def front(costs: Array) -> Whole:
    """The rows of costs (n, 2), both to be small, that no other row beats in one without losing in the other.

    Returns
    -------
    (k,) ndarray of int
        Their places, by the first cost.
    """
    finite = np.flatnonzero(np.all(np.isfinite(costs), axis=1))
    order = finite[np.lexsort((costs[finite, 1], costs[finite, 0]))]
    if not len(order):
        return order
    second = costs[order, 1]
    before = np.concatenate([[np.inf], np.minimum.accumulate(second)[:-1]])
    best: Whole = order[second < before]
    return best
