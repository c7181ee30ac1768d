"""Random scenes in space with the search of the self-motion; writes evaluation-self-motion.md.

    python docs/evaluate_self_motion.py [COUNT]

So many scenes of each family and arm, 60 by default: those of evaluation-spatial.md.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path

import vffnull as vff
from vffnull import evaluation
from vffnull.evaluation import scenes
from vffnull.run import evaluate as evaluating

DOCS = Path(__file__).resolve().parent
COUNT, ARMS, FAMILIES = 60, ("panda", "iiwa14"), ("links-swept", "crowd")
CONTROLLERS = {
    "cbf + preview": evaluation.CONTROLLERS["cbf + preview"],
    "with self-motion": {"controller.avoidance": "cbf", "controller.yielding.preview": {"self_motion": {}}},
}

TEXT = """# With the search of the self-motion

{scenes} scenes of [evaluation-spatial.md](evaluation-spatial.md) in which an arm of seven joints holds a pose
or moves it along a line, with look-ahead and with the search of the self-motion on top of it
(`yielding.preview.self_motion`, [theory.md](theory.md), T172 to T175), made by
`python docs/evaluate_self_motion.py{count}`, vffnull {version}. The search's numbers were settled on other
seeds.

**Collision**: an overlap of more than 1 mm, in scenes that are feasible. **Held**: no collision, and the hand
within 1 cm and 0.05 rad of its reference throughout, in scenes in which a motion that knows the future does
so. **Back**: no collision, and the hand there at the end, in scenes that are feasible. In per cent, with
95 % confidence intervals (Wilson score).

{rows}

The search knows of the obstacles what the controller knows, their present velocities. Some bodies of these
scenes turn back, stop or swing, which the planner that judges them knows in advance.
"""
HEAD = "| family | arm | feasible, with tip | controller | collisions | held | back |"


def main(count: int) -> None:
    """Run all, and write the page."""
    rows = [HEAD, "|---|---|--:|---|--:|--:|--:|"]
    for family in FAMILIES:
        for arm in ARMS:
            outcome = evaluating.evaluate(
                CONTROLLERS,
                family,
                count=count,
                space=True,
                arm=arm,
                task="pose",
                seed=scenes.EVALUATION.start,
            )
            for name in CONTROLLERS:
                feasible = outcome.where(controller=name).feasible
                with_tip = feasible.where(feasibility="with tip")
                cells = (
                    f"{feasible.rate('collided')} | {with_tip.rate('success')} | {feasible.rate('returned')}"
                )
                rows.append(f"| {family} | {arm} | {len(feasible)}, {len(with_tip)} | {name} | {cells} |")
                print(rows[-1], flush=True)
    page = TEXT.format(
        scenes=len(FAMILIES) * len(ARMS) * count,
        count="" if count == COUNT else f" {count}",
        version=vff.__version__,
        rows="\n".join(rows),
    )
    (DOCS / "evaluation-self-motion.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    main(int(sys.argv[1]) if sys.argv[1:] else COUNT)
