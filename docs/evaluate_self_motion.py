"""Random scenes in space with the search of the self-motion; writes evaluation-self-motion.md.

    python docs/evaluate_self_motion.py [COUNT]

So many scenes of each family and arm, 60 by default: those of evaluation-spatial.md.
"""

from __future__ import annotations

import sys
import warnings
from pathlib import Path
from typing import Any

import vffnull as vff
from vffnull import evaluation
from vffnull.evaluation import scenes
from vffnull.run import evaluate as evaluating

DOCS = Path(__file__).resolve().parent
COUNT, FAMILIES = 60, ("links-swept", "crowd")
ARMS = ("panda", "iiwa14", "xarm7", "gen3")
LOOKS = evaluation.CONTROLLERS["cbf + preview"]
SEARCHES = LOOKS | {"controller.yielding.preview": {"self_motion": {}}}
# What of the scene is changed, and whether the motions of its obstacles are foreseen.
WAYS: dict[str, tuple[dict[str, Any], bool]] = {
    "cbf + preview": (LOOKS, False),
    "cbf + preview, foreseen": (LOOKS, True),
    "with self-motion": (SEARCHES, False),
    "with self-motion, foreseen": (SEARCHES, True),
}

TEXT = """# With the search of the self-motion

{scenes} scenes as those of [evaluation-spatial.md](evaluation-spatial.md) in which an arm of seven joints
holds a pose or moves it along a line, with look-ahead and with the search of the self-motion on top of it
(`yielding.preview.self_motion`, [theory.md](theory.md), T172 to T175), made by
`python docs/evaluate_self_motion.py{count}`, vffnull {version}. The search's numbers were settled on other
seeds.

**Collision**: an overlap of more than 1 mm, in scenes that are feasible. **Held**: no collision, and the hand
within 1 cm and 0.05 rad of its reference throughout, in scenes in which a motion that knows the future does
so. **Back**: no collision, and the hand there at the end, in scenes that are feasible. In per cent, with
95 % confidence intervals (Wilson score).

{rows}

The look-ahead predicts obstacles from their present velocities. Some bodies of these scenes turn back, stop
or swing, which the planner that judges them knows in advance. **Foreseen**: so does the look-ahead, told by
`foreseen = true` of every motion, as a forecast or another robot's plan would tell it
([theory.md](theory.md), T196). What is lost without that and held with it is lost to the prediction, not to
the search.
"""
HEAD = "| family | arm | feasible, with tip | controller | collisions | held | back |"


def told(scene: vff.Scenario) -> vff.Scenario:
    """The scene, with the motions foreseen that are not steady anyway."""
    obstacles = scene.to_dict()["obstacles"]
    for each in obstacles:
        if each.get("motion", {}).get("kind") in ("sinusoid", "waypoints"):
            each["motion"]["foreseen"] = True
    return scene.replace(obstacles=obstacles)


def outcome_of(family: str, arm: str, count: int) -> evaluating.Evaluation:
    """How so many scenes go, in all ways."""
    drawn = [scenes.in_space(family, arm, "pose", seed) for seed in scenes.EVALUATION[:count]]
    verdicts = [vff.feasibility(scene) for scene in drawn]
    rows = []
    for name, (changes, foreseen) in WAYS.items():
        given = [told(scene) for scene in drawn] if foreseen else drawn
        results = vff.simulate_many(given, changes | {"simulation.record_every": evaluating.EVERY})
        for scene, verdict, result in zip(drawn, verdicts, results, strict=True):
            rows.append(evaluating.identity(scene, verdict, name) | evaluating.scores_of(result, None))
    return evaluating.Evaluation.of(rows, tuple(WAYS))


def main(count: int) -> None:
    """Run all, and write the page."""
    rows = [HEAD, "|---|---|--:|---|--:|--:|--:|"]
    for family in FAMILIES:
        for arm in ARMS:
            outcome = outcome_of(family, arm, count)
            for name in WAYS:
                of = outcome.where(controller=name)
                feasible, with_tip = of.feasible, of.with_tip
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
