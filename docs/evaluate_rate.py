"""Random scenes in space behind a torque rate, and without one; writes evaluation-rate.md.

    python docs/evaluate_rate.py [COUNT]

So many scenes of every family, arm and task, 60 by default: those of evaluation-spatial.md.
"""

from __future__ import annotations

import sys
import warnings
from collections import defaultdict
from pathlib import Path

import vffnull as vff
from vffnull import evaluation
from vffnull.evaluation import scenes
from vffnull.evaluation.table import wilson

DOCS = Path(__file__).resolve().parent
COUNT, TASKS = 60, ("position", "pose")
RATE = 1000.0  # N·m/s, a Franka's
CONTROLLERS = ("null-space field", "relaxed", "priority", "cbf", "cbf + preview")

TEXT = """# Behind a torque rate

{scenes} scenes of [evaluation-spatial.md](evaluation-spatial.md), without a limit of the torque rate
and with one of {rate:g} N·m/s for every joint, made by `python docs/evaluate_rate.py{count}`, vffnull
{version}. That is a Franka's limit; makers of the other two arms publish none. What changes behind it is in
[theory.md](theory.md), T130 to T134, T161, T171 and T176; its numbers were settled on other seeds.

**Collision**: an overlap of more than 1 mm, in all scenes, feasible or not, in per cent with 95 % confidence
intervals (Wilson score). **Back**: no collision, and the tip within 1 cm of its reference at the end. Speed
and torque are the largest of any joint in any of the scenes, in parts of the makers' limits.

{rows}

Every controller keeps the speeds of joints, which weigh more than distances: without a rate only where one
would be too fast (T153) or come to its stop (T162), behind a rate always, 0.98 of them. What is above 1 are
joints at their torque limits. Behind the rate joints are braked as fast as all of them can be at the same
time (T176).

`priority` hands its distances to the program where limits act, behind a rate at all times: it collides no
more often there than without. Hands are back later behind the rate: they give way as far as without, and
come back as slowly as drives can be asked to (T133).
"""
HEAD = (
    "| family | controller | collisions | behind the rate | back | behind the rate | speed | behind the rate "
    "| torque | behind the rate |"
)


def main(count: int) -> None:
    """Run all, and write the page."""
    found: dict[tuple[str, str, bool], list[vff.Result]] = defaultdict(list)
    for family in scenes.FAMILIES:
        seeds = range(scenes.EVALUATION.start, scenes.EVALUATION.start + count)
        drawn = [
            scenes.in_space(family, arm, task, seed)
            for arm in scenes.EVALUATED
            for task in TASKS
            for seed in seeds
        ]
        for name in CONTROLLERS:
            for limited in (False, True):
                rate = {"controller.command.torque_rate": RATE} if limited else {}
                changes = evaluation.CONTROLLERS[name] | rate
                found[family, name, limited] = vff.simulate_many(drawn, changes, record=False)
                print(family, name, limited, flush=True)
    rows = [HEAD, "|---|---|" + 8 * "--:|"]
    for family in scenes.FAMILIES:
        for name in CONTROLLERS:
            both = [found[family, name, which] for which in (False, True)]
            cells = [str(wilson(sum(map(hits, runs)), len(runs))) for runs in both]
            cells += [str(wilson(sum(map(is_back, runs)), len(runs))) for runs in both]
            for metric in ("velocity_limit_ratio", "torque_limit_ratio"):
                cells += [f"{max(run.metrics[metric] or 0.0 for run in runs):.3f}" for runs in both]
            rows.append(f"| {family} | {name} | {' | '.join(cells)} |")
    total = len(scenes.FAMILIES) * len(scenes.EVALUATED) * len(TASKS) * count
    page = TEXT.format(
        scenes=total,
        rate=RATE,
        count="" if count == COUNT else f" {count}",
        version=vff.__version__,
        rows="\n".join(rows),
    )
    (DOCS / "evaluation-rate.md").write_text(page, encoding="utf-8")


def hits(run: vff.Result) -> bool:
    """Whether a run is a collision; one that came to no end is."""
    return run.status not in ("completed", "collided") or (run.metrics["min_clearance"] or 0.0) < -1e-3


def is_back(run: vff.Result) -> bool:
    """Whether it is at its reference in the end."""
    return not hits(run) and (run.metrics["end_error"] or 0.0) <= 0.01


if __name__ == "__main__":
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    main(int(sys.argv[1]) if sys.argv[1:] else COUNT)
