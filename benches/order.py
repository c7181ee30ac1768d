"""What an order of letting go keeps: crowds in space before arms that hold a pose, with look-ahead.

    python benches/order.py [COUNT] [--training]

So many scenes for each arm, 60 by default, of evaluation seeds or of others for tuning. Per cent of all
scenes: collisions (an overlap of more than 1 mm), and, without one, the tip within 1 cm of its reference
throughout, the tool's axis within 0.05 rad of it, and the whole pose; at last the share of time in which the
look-ahead lets something go.
"""

from __future__ import annotations

import warnings

import numpy as np

import vffnull as vff
from seeds import asked
from vffnull._core import matrices
from vffnull.evaluation import CONTROLLERS, scenes

ARMS = ("panda", "iiwa14", "ur5e")
ORDERS = ([], ["turn"], ["turn", "orientation"], ["turn", "orientation", "approach", "position"])
LAW = CONTROLLERS["cbf + preview"] | {"simulation.record_every": 10}


def scores(result: vff.Result) -> list[float]:
    """Whether one run collided; whether it kept position, tool axis and pose; how long it let go of some."""
    assert result.orientation is not None
    position, turn = np.split(result.error, 2, axis=1)
    axis = matrices(result.orientation)[:, :, 2]
    tilt = turn - axis * np.sum(turn * axis, axis=1, keepdims=True)
    free = result.status == "completed" and result.metrics.min_clearance > -1e-3
    off, tilted, turned = (np.linalg.norm(e, axis=1).max() for e in (position, tilt, turn))
    released = 0.0 if result.released is None else float(np.mean(result.released > 0.0))
    kept = [off < 0.01, tilted < 0.05, off < 0.01 and turned < 0.05]
    return [not free, *(free and each for each in kept), released]


def main() -> None:
    """Run all, and print the table."""
    seeds = asked(__doc__)
    print("| arm | order | collisions | position | axis | pose | lets go |\n|---|---|--:|--:|--:|--:|--:|")
    for arm in ARMS:
        drawn = [scenes.in_space("crowd", arm, "pose", seed) for seed in seeds]
        for order in ORDERS:
            law = LAW | ({"controller.yielding.order": order} if order else {})
            rows = [scores(result) for result in vff.simulate_many(drawn, law)]
            shares = " | ".join(f"{share:.1f}" for share in 100 * np.mean(rows, axis=0))
            print(f"| {arm} | {', '.join(order) or '–'} | {shares} |", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    main()
