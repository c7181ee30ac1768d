"""Planning and reacting on random scenes with a goal; writes evaluation-plan.md.

    python docs/evaluate_goals.py [PLANE PANDA]

So many scenes of every family in the plane and in space, 40 and 20 by default. With --train the scenes are
those for tuning, and the tables are printed only.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import vffnull as vff
from vffnull.draw import style
from vffnull.evaluation import scenes
from vffnull.evaluation.scenes.goals import GOAL_ARMS
from vffnull.evaluation.table import wilson
from vffnull.run.goals import Goals, evaluate_goals

DOCS = Path(__file__).resolve().parent
COUNTS = (40, 20)
SEEDS = scenes.EVALUATION.start + 1000  # nobody has looked at these before

TEXT = """# Planning against reacting

{scenes} random scenes with a goal under five controllers, made by
`python docs/evaluate_goals.py` with the arguments {count}, vffnull {version}.
`vffnull.evaluation.scenes.goals.to_a_goal` makes the scenes from a seed; seeds from 1 001 000 on are used
here, once. Families, lengths of runs, stiffness, how often a plan is tried and when another one is searched
were settled on other seeds. Six links of 1 m in the plane, and a Panda with its maker's limits; the task is
a position, and the reference of the controllers that only react is a straight line to it. Scenes last 12 s
in the plane and 10 s in space.

- **pocket**: three walls about the goal, open sideways or away, in space a box on its side; the line
  leads through a wall.
- **shelf**: two cells, open towards the base; from one to the other.
- **gap**: a wall with a gap that is not on the line.
- **post**: one body that links get caught at; in space the arm has to go round it from one side to the
  other.
- **door**: a wall with two gaps, one of which a sliding door shuts 1 to 1.5 s after the start: later than the
  first plan looks ahead.
- **crowd**: moving bodies and a line to follow, [as in the other evaluations](evaluation.md).

In all families but the crowd a planner has found a motion to the goal (past the shut door, too), so every
goal is feasible.
**Reached**: no overlap of more than 1 mm at any time, and the tip within 1 cm of the goal at the end.
**Collision**: an overlap of more than 1 mm. Rates are in per cent with 95 % confidence intervals
(Wilson score); the time is the median until the tip is at its goal for good, of those that got there;
"no plan" counts scenes in which the planner found nothing.

- **cbf**, **cbf + preview** react: the QP with barriers, without and with look-ahead.
- **plan alone** follows a plan that was made once, by the law without any avoidance: a computed torque.
- **plan and react** follows the same plan under cbf with look-ahead and a governor.
- **replan and react** does so with a table `replan` that takes every default: another plan comes 0.3 s after
  the first one is seen to be blocked, or the arm has strayed from it or is stuck.

A plan takes half of the joints' limits of speed and acceleration; one that would outlast the run is made
again for 90 % of them.

![Rates of goals reached, by family, arm and controller.](figures/evaluation-plan.png)

{table}

## How long planning takes

On the machine that made this page (two shared cores): the time of a call of `vff.plan`, scenario in,
motion out.

{latency}
"""


def figure(found: Goals, path: Path) -> None:
    """Rates of goals reached with their intervals."""
    families = list(dict.fromkeys(found.columns["family"]))
    arms = list(dict.fromkeys(found.columns["arm"]))
    ways = list(dict.fromkeys(found.columns["way"]))
    colours = ["#B8BDC6", "#7D8694", "#E0A458", "#6FA8DC", "#174F86"]
    with style.look():
        fig = style.figure(2.5, style.PAGE)
        axes = fig.subplots(1, len(arms), sharey=True, squeeze=False)[0]
        for ax, arm in zip(axes, arms, strict=True):
            for k, (way, colour) in enumerate(zip(ways, colours, strict=True)):
                rates = [
                    wilson(int(rows.columns["reached"].sum()), len(rows))
                    for rows in (found.where(arm=arm, family=family, way=way) for family in families)
                ]
                at = np.arange(len(families)) + 0.16 * (k - 2.0)
                value = np.array([100 * rate.value for rate in rates])
                low = value - [100 * rate.low for rate in rates]
                high = np.array([100 * rate.high for rate in rates]) - value
                ax.bar(at, value, 0.145, color=colour, label=way)
                ax.errorbar(
                    at, value, [low.clip(0), high.clip(0)], fmt="none", ecolor=style.INK, elinewidth=0.8
                )
            ax.set_xticks(range(len(families)), families)
            ax.tick_params(axis="x", length=0)
            ax.set_title({"plane": "six links in the plane", "panda": "Panda"}[str(arm)])
            ax.set_ylim(0, 100)
        axes[0].set_ylabel("goals reached [%]")
        handles = axes[0].get_legend_handles_labels()
        fig.legend(*handles, loc="outside lower center", ncols=len(ways), frameon=False)
        fig.savefig(path)


def main(arguments: list[str]) -> None:
    """Write the page and its figure, or print the tables of training scenes."""
    train = "--train" in arguments
    numbers = [int(each) for each in arguments if each != "--train"]
    counts = numbers if len(numbers) == len(GOAL_ARMS) else COUNTS
    seed = scenes.TRAINING.start if train else SEEDS
    parts = [
        evaluate_goals(arms=[arm], count=count, seed=seed)
        for arm, count in zip(GOAL_ARMS, counts, strict=True)
    ]
    found = Goals.join(parts)
    if train:
        print(found.table(), found.latencies(), sep="\n\n")
        return
    total = len(found.where(way="cbf"))
    text = TEXT.format(
        scenes=total,
        count=" ".join(map(str, counts)),
        version=vff.__version__,
        table=found.table(),
        latency=found.latencies(),
    )
    (DOCS / "evaluation-plan.md").write_text(text, encoding="utf-8")
    figure(found, DOCS / "figures" / "evaluation-plan.png")


if __name__ == "__main__":
    main(sys.argv[1:])
