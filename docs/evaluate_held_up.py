"""Random scenes in clutter with `replan`, where a hand is held up; writes evaluation-held-up.md.

    python docs/evaluate_held_up.py [COUNT]

So many scenes of each arm and task, 60 by default: those of evaluation-spatial.md.
"""

from __future__ import annotations

import sys
import warnings
from collections import Counter
from pathlib import Path

import vffnull as vff
from vffnull import evaluation
from vffnull.evaluation import scenes
from vffnull.run import evaluate as evaluating

DOCS = Path(__file__).resolve().parent
COUNT, ARMS, TASKS, SECONDS = 60, ("panda", "iiwa14", "ur5e"), ("position", "pose"), 8.0
REACT = {**evaluation.CONTROLLERS["cbf + preview"], "duration": SECONDS}
CONTROLLERS = {
    "cbf + preview": REACT,
    "with replan": {**REACT, "replan": {}},
    "with governor and replan": {**REACT, "controller.governor": {}, "replan": {}},
}
LAST = {
    "goal blocked": "the goal is blocked in every configuration that was found",
    "not found": "no motion was found",
    "None": "a search was under way at the end",
}

TEXT = """# A hand that is held up

{scenes} scenes of the family clutter of [evaluation-spatial.md](evaluation-spatial.md): bodies at rest about
the arm and about the line that its hand goes along within 4 s. Here they last 8 s, and a table
[`replan`](plans.md#a-hand-that-only-reacts-and-gets-nowhere) with every default makes a plan where the hand
comes no nearer. Made by `python docs/evaluate_held_up.py{count}`, vffnull {version}.

**Collision**: an overlap of more than 1 mm. **Back**: no collision, and the hand within 1 cm and, of a pose,
0.05 rad of its reference at the end. Both in scenes that are feasible: a motion that knows the future keeps
1 mm from everything. That motion need not end at the goal, where a link may be within an obstacle. Where it
also follows the reference, that is **with tip**. In per cent, with 95 % confidence intervals (Wilson score).

{rows}

Why the hand is not back with `replan`, without governor, in so many scenes:

{causes}
"""
HEAD = "| arm | task | feasible, with tip | controller | collisions | back | back, with tip |"


def last_search(arm: str, task: str, seed: int) -> str:
    """What came of the last search in a scene."""
    scene = scenes.in_space("clutter", arm, task, seed).replace(**CONTROLLERS["with replan"])
    result = vff.simulate(scene)
    if not result.replans:
        return "the hand stands less than `tolerance` off, 2 cm"
    status = str(result.replans[-1].status)
    return "a plan was not over in time" if status == "found" else LAST.get(status, status)


def main(count: int) -> None:
    """Run all, and write the page."""
    rows = [HEAD, "|---|---|--:|---|--:|--:|--:|"]
    causes: Counter[str] = Counter()
    for arm in ARMS:
        for task in TASKS:
            outcome = evaluating.evaluate(
                CONTROLLERS,
                "clutter",
                count=count,
                space=True,
                arm=arm,
                task=task,
                seed=scenes.EVALUATION.start,
            )
            for name in CONTROLLERS:
                of = outcome.where(controller=name)
                feasible, with_tip = of.feasible, of.with_tip
                cells = (
                    f"{feasible.rate('collided')} | {feasible.rate('returned')} | {with_tip.rate('returned')}"
                )
                rows.append(f"| {arm} | {task} | {len(feasible)}, {len(with_tip)} | {name} | {cells} |")
                print(rows[-1], flush=True)
            lost = outcome.where(controller="with replan", returned=False).feasible
            causes.update(last_search(arm, task, int(each)) for each in lost.columns["seed"])
    page = TEXT.format(
        scenes=len(ARMS) * len(TASKS) * count,
        count="" if count == COUNT else f" {count}",
        version=vff.__version__,
        rows="\n".join(rows),
        causes="\n".join(f"- {number}: {cause}" for cause, number in causes.most_common()),
    )
    (DOCS / "evaluation-held-up.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    main(int(sys.argv[1]) if sys.argv[1:] else COUNT)
