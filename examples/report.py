"""
A report to send
================

One HTML file that needs no network: the arm in motion with a slider that is linked to the plots, metrics,
scenario, assumptions. `compare` puts several runs side by side. Needs ``pip install ".[report]"``.
"""

from __future__ import annotations

import vffnull as vff
from vffnull.plotting import strobe, style

gains = (0.1, 2.0)
results = {f"gain {gain:g}": vff.simulate("narrow-gap", {"controller.field.gain": gain}) for gain in gains}
for path in (results["gain 2"].report("report.html"), vff.compare(results, "report-compare.html")):
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")

with style.look():
    fig = style.figure(2.9, style.PAGE)
    for ax, (label, result) in zip(fig.subplots(1, len(results)), results.items(), strict=True):
        strobe.passing(ax, result, height=2.9, width=style.PAGE / 2)
        ax.get_legend().remove()
        ax.text(0.03, 0.97, label, transform=ax.transAxes, va="top", fontweight="bold")
    fig.savefig("report.png")
