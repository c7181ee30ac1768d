"""
A report to send
================

One HTML file that needs no network: the arm in motion with a slider that is linked to the plots, metrics,
scenario, assumptions. `compare` puts several runs side by side. Needs ``pip install ".[report]"``.
"""

from __future__ import annotations

import vffnull as vff
from vffnull.draw import style
from vffnull.draw.figures import strobe
from vffnull.draw.scene import Scene

gains = (10, 80)  # N
results = {f"gain {gain} N": vff.simulate("panda-sweep", {"controller.field.gain": gain}) for gain in gains}
for path in (results["gain 80 N"].report("report.html"), vff.compare(results, "report-compare.html")):
    print(f"{path}: {path.stat().st_size / 1e6:.1f} MB")

with style.look():
    fig = style.figure(3.6, style.PAGE)
    for part, (label, result) in zip(fig.subfigures(1, len(results)), results.items(), strict=True):
        strobe.in_depth(part, Scene.of_result(result), (0.0, 0.0, 1.0, 0.93))
        part.text(0.5, 0.97, label, ha="center", va="top", fontweight="bold")
    fig.savefig("report.png")
