"""When a contact is felt: the largest joint of (T166), and the sum of squares over joints beside it.

    python benches/contact_tests.py

Scenes, arms and noise are those of `false_alarms.py`. Both tests are evaluated from what the detection has
recorded. In runs with nothing in the way the sum gets the bound that leaves it as far from the largest value
there. Then somebody pushes. At several bandwidths of the observer.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np

import vffnull as vff
from false_alarms import runs

Array = np.ndarray[Any, np.dtype[np.float64]]


def shares(result: vff.Result) -> Array:
    """|δ| / h of every joint at every instant (T, n)."""
    assert result.contact_deviation is not None
    assert result.contact_threshold is not None
    return np.abs(result.contact_deviation) / result.contact_threshold


def both(found: Array) -> Array:
    """The largest joint, and the root of the sum of squares (T, 2)."""
    return np.column_stack([found.max(axis=1), np.sqrt((found**2).sum(axis=1))])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cycles", type=int, default=500_000)
    parser.add_argument("--push", type=float, default=5.0, help="with how many newtons somebody pushes")
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    for bandwidth in (80.0, 150.0, 300.0):
        observer = {"bandwidth": bandwidth, "detection": {}}
        most, cycles = np.zeros(2), 0
        for result, _ in runs(np.random.default_rng(1), 0.05, 0.0, observer):
            most = np.maximum(most, both(shares(result)).max(axis=0))
            cycles += len(result.t)
            if cycles >= given.cycles // 2:
                break
        bounds, waits, cycles = np.array([1.0, most[1] / most[0]]), [], 0
        for result, start in runs(np.random.default_rng(2), 0.05, given.push, observer):
            begins = int(np.searchsorted(result.t, start)) + 1
            felt = both(shares(result))[begins:] > bounds
            waits.append([1.0 + np.argmax(each) if each.any() else np.inf for each in felt.T])
            cycles += len(result.t)
            if cycles >= given.cycles:
                break
        print(f"{bandwidth:g} 1/s: largest values without a push {most[0]:.2f}, {most[1]:.2f}")
        for name, each in zip(("largest joint", "sum of squares"), np.array(waits).T, strict=True):
            half, most_of = (np.quantile(each, q, method="higher") for q in (0.5, 0.9))
            soon = float((each <= 5.0).mean())
            waited = f"{half:.0f} ms (50%), {most_of:.0f} ms (90%), {soon:.0%} within 5 ms"
            print(f"  {name}: {waited}, of {len(each)}")


if __name__ == "__main__":
    main()
