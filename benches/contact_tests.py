"""When a contact is felt: the largest joint of (T166), and the sum of squares over joints beside it.

    python benches/contact_tests.py

Scenes, arms and noise are those of `false_alarms.py`. The test of (T166) is evaluated from records of runs
with nothing in the way, and the sum gets the bound that leaves it as far from the largest value there. Then
somebody pushes. At several bandwidths of the observer.
"""

from __future__ import annotations

import argparse
import warnings
from typing import Any

import numpy as np

import vffnull as vff
from false_alarms import runs

PERIOD = 1e-3  # s, of all scenes
LEAST, MODEL_ERROR, NOISE, MEMORY = 0.2, 0.1, 7.0, 1.0  # the defaults of [controller.observer.detection]

Array = np.ndarray[Any, np.dtype[np.float64]]


def shares(result: vff.Result, bandwidth: float) -> Array:
    """|δ| / h of every joint at every instant (T, n), as `control/detection.rs` has them."""
    assert result.tau_ext_estimate is not None
    estimate, acted = result.tau_ext_estimate, np.vstack([result.tau[:1], result.tau[:-1]])
    lag, smoothing = (1.0 - np.exp(-rate * PERIOD) for rate in (bandwidth, 0.5 * bandwidth))
    mean, smooth, model = estimate[0].copy(), estimate[0].copy(), acted[0].copy()
    mean_model, variance = model.copy(), np.zeros_like(mean)
    found = np.zeros_like(estimate)
    for k, r in enumerate(estimate):
        begun = PERIOD * (k + 1) - 5.0 / bandwidth
        memory, scatter = (
            min(PERIOD / min(begun, time), 1.0) if begun > PERIOD else 1.0 for time in (MEMORY, 5.0)
        )
        model = model + lag * (acted[k] - model)
        threshold = LEAST + MODEL_ERROR * np.abs(model - mean_model) + NOISE * np.sqrt(variance)
        off = np.abs(r - mean) / threshold
        if begun >= 10.0 / bandwidth:
            found[k] = off
        if not (found[k] > 1.0).any():
            mean = mean + memory * (r - mean)
            mean_model = mean_model + memory * (model - mean_model)
            smooth = smooth + smoothing * (r - smooth)
            variance = variance + scatter * ((r - smooth) ** 2 - variance)
    return found


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
        observer = {"bandwidth": bandwidth}
        most, cycles = np.zeros(2), 0
        for result, _ in runs(np.random.default_rng(1), 0.05, 0.0, observer):
            most = np.maximum(most, both(shares(result, bandwidth)).max(axis=0))
            cycles += len(result.t)
            if cycles >= given.cycles // 2:
                break
        bounds, waits, cycles = np.array([1.0, most[1] / most[0]]), [], 0
        for result, start in runs(np.random.default_rng(2), 0.05, given.push, observer):
            begins = int(np.searchsorted(result.t, start)) + 1
            felt = both(shares(result, bandwidth))[begins:] > bounds
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
