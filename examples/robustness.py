"""
A wrong model and late sensors
==============================

What they cost in tracking and clearance on one scenario at 1 kHz: its links weigh up to 30 % more or less
than the controller believes, and its readings are up to 10 ms old. `python robustness.py FILE.png` says
where to draw it.
"""

from __future__ import annotations

import sys
from pathlib import Path

import matplotlib
import numpy as np

import vffnull as vff
from vffnull.draw import style

SCENARIO = "sweep-through"
MASS = 30 * np.sinh(np.linspace(-4, 4, 41)) / np.sinh(4)  # %, more than the model; dense round 0
DELAY = [0, 2, 4, 6, 8, 10]  # ms


def measured(result: vff.Result) -> tuple[float, float]:
    """Largest distance of the tip from its reference [mm] and smallest clearance [mm] of a run."""
    if result.status == "diverged":
        return np.nan, np.nan
    metrics = result.metrics
    return 1e3 * max(metrics.max_error_transient, metrics.max_error_tail), 1e3 * metrics.min_clearance


def main(target: Path) -> None:
    """Run the study and draw it."""
    masses = vff.Scenario.load(SCENARIO).arm.masses
    cases = ((1 + mass / 100, delay / 1000) for delay in DELAY for mass in MASS)
    changes = [{"plant.masses": share * masses, "measurement.delay": late} for share, late in cases]
    results = vff.simulate_many(SCENARIO, changes, record=False)  # on all cores, metrics alone
    table = np.array([measured(result) for result in results]).reshape(len(DELAY), len(MASS), 2)
    with style.look():
        fig = style.figure(2.6, style.PAGE)
        axes = fig.subplots(1, 2)
        colours = np.linspace(0.85, 0.0, len(DELAY))
        labels = "largest tracking error [mm]", "smallest clearance [mm]"
        for ax, values, label in zip(axes, np.moveaxis(table, -1, 0), labels, strict=True):
            for line, delay, shade in zip(values, DELAY, colours, strict=True):
                ax.plot(MASS, line, color=matplotlib.colormaps["viridis"](shade), label=f"{delay} ms")
            ax.set_xlabel("mass of the links, relative to the model [%]")
            ax.set_ylabel(label)
            ax.xaxis.set_major_formatter(lambda x, _: f"{x:+.0f}" if x else "0")
        axes[0].set_yscale("log")
        axes[0].yaxis.set_major_formatter("{x:g}")
        axes[1].yaxis.get_major_locator().set_params(integer=True)
        fig.legend(*axes[0].get_legend_handles_labels(), title="delay", loc="outside right center")
        fig.savefig(target)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "robustness.png"))
