"""Write docs/evaluation.md and its figures: `python docs/evaluate.py`, with vffnull[evaluate] installed.

`python docs/evaluate.py 34` takes 34 instead of 334 scenes for each category and number of joints.
"""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path

import numpy as np

import vffnull as vff
from vffnull import evaluation, scenes

DOCS = Path(__file__).resolve().parent
COUNT = 334
SIZES = (4, 6, 9)

# Scenes with an escape, from a study of its own 1200 scenes: collisions and, in brackets, success [%].
ELSEWHERE = {"links-swept": "0 (98)", "path-crossed": "1 to 3", "clutter": "0 (89)", "crowd": "22 to 25"}

HEAD = """# Controllers against each other

{total} random scenes under {controllers} controllers, made by `python docs/evaluate.py{count}`, vffnull
{version}. `vffnull.scenes` makes the scenes from a seed; those from 1 000 000 on serve here, and nothing has
been tuned to them.

**Escape.** A planner that knows the future and no controller looks for a motion of the arm that keeps 1 mm or
more from everything, at joint speeds up to 3 rad/s and accelerations up to 30 rad/s²: first with the tip
within 1 cm of its reference ("with tip"), then without that ("without tip"). The rule was fixed before any
controller was run; the module `scenario/feasibility.rs` states it in full. "None found" is no proof that
there is none.

**Collision**: an overlap of more than 1 mm. **Success**: no collision, and the tip within 1 cm of its
reference at all times. Rates are in per cent, with 95 % intervals by Wilson's score. "Feasible" scenes are
those with an escape; success is given for those whose escape holds the tip, too. The encounter lasts as long
as the arm without avoidance has an obstacle within 0.1 m. Numbers that are not rates are medians of the runs
that came through. Every controller has the settings of the scene (K = 100/s², D = 20/s, null damping 6/s,
Khatib's field with 0.3 N·m³ from 0.6 m on) and otherwise the defaults; the unprojected field is that of
Khatib (1986).

![Collision and success rates of all controllers in the four families.](figures/evaluation/rates.png)
"""

TAIL = """
![Distributions of the smallest clearance.](figures/evaluation/clearance.png)

![Distributions of the tip's error during the encounter and after it.](figures/evaluation/error.png)
"""


def main(count: int) -> None:
    """Run everything and write the document."""
    outcome = evaluation.evaluate(n=SIZES, count=count, progress=sys.stderr.isatty())
    outcome.plot(DOCS / "figures" / "evaluation")
    given = "" if count == COUNT else f" {count}"
    total = len(outcome) // len(outcome.controllers)
    parts = [
        HEAD.format(total=total, controllers=len(outcome.controllers), count=given, version=vff.__version__),
        outcome.table(),
        TAIL,
        sizes(outcome),
        elsewhere(outcome),
        causes(outcome),
        "## Time of a step\n\nIn crowds, law and plant, called from Python on one thread.\n",
        evaluation.loop_times(n=SIZES),
    ]
    (DOCS / "evaluation.md").write_text("\n".join(parts) + "\n", encoding="utf-8")


def sizes(outcome: vff.Evaluation) -> str:
    """Collisions of cbf by the number of joints."""
    lines = [
        "## cbf by the number of joints\n\nCollisions where an escape exists [%].\n",
        "| family | " + " | ".join(f"n = {n}" for n in SIZES) + " |",
        "|---" + "|--:" * len(SIZES) + "|",
    ]
    for family in outcome.families:
        rows = outcome.where(family=family, controller="cbf").feasible
        rates = (str(rows.where(n=n).rate("collided")) for n in SIZES)
        lines.append(f"| {family} | {' | '.join(rates)} |")
    return "\n".join(lines) + "\n"


def elsewhere(outcome: vff.Evaluation) -> str:
    """Beside the reference points."""
    lines = [
        "## Beside another study\n\nA study of 1200 scenes of its own, with another implementation of a cbf "
        "law; its scenes are not these.\n",
        "| family | collisions here, feasible [%] | success, feasible [%] "
        "| there: collisions (success) [%] |",
        "|---|--:|--:|--:|",
    ]
    for family in outcome.families:
        rows = outcome.where(family=family, controller="cbf").feasible
        lines.append(f"| {family} | {rows.rate('collided')} | {rows.rate('success')} | {ELSEWHERE[family]} |")
    return "\n".join(lines) + "\n"


def causes(outcome: vff.Evaluation) -> str:
    """Why cbf collides where an escape exists, run by run."""
    rows = outcome.where(controller="cbf", collided=True).feasible.columns
    found = {family: Counter[str]() for family in outcome.families}
    for family, n, seed in zip(rows["family"], rows["n"], rows["seed"], strict=True):
        scene = scenes.random(str(family), int(n), int(seed))
        found[str(family)][cause(vff.simulate(scene, evaluation.CONTROLLERS["cbf"]))] += 1
    kinds = sorted(set().union(*found.values()))
    lines = [
        "## Where cbf collides although an escape exists\n",
        "Every such run, by what the record says of the 0.2 s before the first contact: whether the "
        "programme contradicted itself (slack), how many obstacles were within 0.1 m of the arm, and "
        "whether a joint was at its speed limit (6 rad/s by default).\n",
        "| family | runs | " + " | ".join(kinds) + " |",
        "|---|--:" + "|--:" * len(kinds) + "|",
    ]
    for family, counts in found.items():
        lines.append(f"| {family} | {counts.total()} | " + " | ".join(str(counts[k]) for k in kinds) + " |")
    return "\n".join(lines) + "\n"


def cause(result: vff.Result) -> str:
    """What held the arm when it was first touched."""
    hit = int(np.argmax(result.clearance.min(axis=1) < 0.0))
    before = slice(max(hit - 200, 0), hit + 1)
    if not np.any(result.slack[before] > 1e-6):
        return "no slack"
    near = obstacles_near(result, hit)
    how = "pinched by two or more" if near > 1 else "pushed by one"
    return how + (", at the speed limit" if np.abs(result.dq[before]).max() > 5.7 else "")


def obstacles_near(result: vff.Result, row: int) -> int:
    """How many obstacles are within 0.1 m of a link at a recorded instant."""
    scenario = result.scenario
    each = []
    for obstacle in scenario["obstacles"]:
        alone = vff.Controller(scenario.arm, {}).terms(
            result.q[row], result.dq[row], result.x_ref[row], obstacles=[obstacle], t=float(result.t[row])
        )
        each.append(alone.clearance.min())
    return int(np.sum(np.array(each) < 0.1))


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else COUNT)
