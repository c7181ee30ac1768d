"""Crowds in space seen by two cameras, with every error alone and with all; writes evaluation-perception.md.

    python docs/evaluate_perception.py [COUNT] [--training]

So many scenes of each arm and task, 20 by default: such as those of evaluation-spatial.md, or with
--training others, of which the table is printed alone.
"""

from __future__ import annotations

import argparse
import math
import warnings
from pathlib import Path
from typing import Any

import vffnull as vff
from vffnull import evaluation
from vffnull.evaluation import scenes
from vffnull.evaluation.table import wilson
from vffnull.run import evaluate as evaluating

DOCS = Path(__file__).resolve().parent
FIRST = scenes.EVALUATION.start + 40
COUNT, ARMS, TASKS = 20, ("panda", "iiwa14"), ("position", "pose")
AT_ONCE = 16  # scenes, so that the points that are recorded fit into memory
LAW = evaluation.CONTROLLERS["cbf + preview"]
# What is cut away as the arm comes no nearer than that in the cloud; what comes late is hardly known.
OF_CLOUDS = {"controller.yielding.margin": 0.03, "controller.yielding.preview.trigger": 1.0}
# As much larger than the reach of the arms as bodies go within the look-ahead.
ROOM = [[-2.0, -2.0, -0.5], [2.0, 2.0, 2.0]]
PLACES: list[dict[str, Any]] = [  # 1.4 m from the middle of the room, one before the arm, one behind it
    {"position": [1.1, 0.9, 1.1], "orientation": [0.2215, -0.3413, -0.7663, 0.4973], "field_of_view": 1.5},
    {"position": [-0.8, -0.9, 1.2], "orientation": [0.4702, -0.7953, 0.3294, -0.1948], "field_of_view": 1.5},
]
PERCEIVER = {"voxel": 0.03, "stride": 1, "least_points": 1, "most_voxels": 3000}
PERCEIVER |= {"track_error": 0.005, "hidden": 0.3, "room": ROOM}
EXACT = OF_CLOUDS | {
    "perception": {
        "kind": "depth",
        "cameras": [place | {"columns": 128, "rows": 96} for place in PLACES],
        "rate": 30.0,
        "range": 9.0,
        "perceiver": PERCEIVER | {"time_error": 0.0},
    }
}
AT_REST = {
    "perception": {
        "kind": "camera",
        "cameras": [place | {"columns": 48, "rows": 36} for place in PLACES],
        "rate": 30.0,
    }
}
ERRORS: dict[str, dict[str, Any]] = {
    "noise": {"noise": 0.002, "resolution": 0.001},
    "drop-outs": {"drop_outs": 0.05, "grazing": 0.15},
    "latency": {"latency": 0.066},
    "calibration": {"position_error": 0.005, "orientation_error": math.radians(0.5)},
    "clocks": {"clock_error": 0.02},
}


def erring(*names: str) -> dict[str, Any]:
    """Pictures with some errors, and with the margins that the perceiver then needs."""
    perception = EXACT["perception"] | {key: value for name in names for key, value in ERRORS[name].items()}
    margin = 0.03 if {"noise", "calibration"} & set(names) else 0.02
    time_error = 0.02 if "clocks" in names else 0.0
    perceiver = perception["perceiver"] | {"margin": margin, "time_error": time_error}
    return EXACT | {"perception": perception | {"perceiver": perceiver}}


WAYS: dict[str, dict[str, Any]] = {
    "everything is known": {},
    "points at rest, of ideal cameras": AT_REST,
    "pictures, no error": erring(),
    **{f"pictures, {name}": erring(name) for name in ERRORS},
    "pictures, all errors": erring(*ERRORS),
}
# Beyond what the arm reaches and the perceiver looks at: without them, nothing would be seen to be free.
WALLS = [
    {"shape": {"kind": "half_space", "normal": normal}, "position": position}
    for normal, position in (
        ([1, 0, 0], [-3, 0, 0]),
        ([-1, 0, 0], [3, 0, 0]),
        ([0, 1, 0], [0, -3, 0]),
        ([0, -1, 0], [0, 3, 0]),
        ([0, 0, 1], [0, 0, -1]),
        ([0, 0, -1], [0, 0, 3]),
    )
]
AIMS = {"collisions": 3.0, "held": 5.0}  # points that all errors may cost

TEXT = """# What seeing costs

{scenes} crowds as those of [evaluation-spatial.md](evaluation-spatial.md), three to six spheres that move
through the place of a Panda or an iiwa 14, made by `python docs/evaluate_perception.py{count}`,
vffnull {version}. Two cameras 1.4 m away take 30 pictures a second, and nothing but the arm and where they
are said to stand is known, but in the first row. The law is `cbf` with look-ahead throughout.

**Points at rest**: `kind = "camera"`, 48 × 36 exact points of each camera without the arm, which all rest.
**Pictures**: `kind = "depth"`, 128 × 96 pixels with the arm in them, of which `vffnull.Perceiver` makes
points that move, in cells of 3 cm ([theory-spatial.md](theory-spatial.md), T181 to T184, T188 to T191,
T205).
Walls 3 m away and a floor 1 m below, outside of the room that the perceiver looks at, are what pixels see
where nothing else is.

| error | how much |
|---|---|
| noise | a standard deviation of 2 mm at 1 m and steps of 1 mm there, both with the square of the depth |
| drop-outs | 5 % of the pixels, surfaces flatter than 0.15 rad, edges |
| latency | 66 ms |
| calibration | 5 mm and 0.5°, each camera in a direction of its own |
| clocks | 20 ms, each camera ahead or behind |

The perceiver cuts away 2 cm around the arm, 3 cm with noise or a wrong calibration, and around moving
links as far as they go in 20 ms with wrong clocks; bodies up to 30 cm wide are taken for as deep as they
are wide (T191), and round ones for the balls that they are (T205). What is cut away as the arm comes no
nearer than that in the cloud, so that the law keeps 3 cm instead of 2: with 1 cm it takes what comes
slowly for far enough away, until that touches. The room is one of 4 × 4 × 2.5 m: what comes into it is
news, and the arms reach 0.9 m. These numbers were settled on training seeds; the table is of twenty
other seeds. It was made anew where faults were mended, and nothing was chosen by it.
The look-ahead searches where a contact is less than 1.0 s ahead
instead of 1.2 s (`preview.trigger`): the velocities of what cameras see are less certain than those of
what is known.

**Collision**: an overlap of more than 1 mm, in all scenes. **Held**: no collision, and the tip within 1 cm
of its reference and turned from it by 0.05 rad at most throughout, in scenes in which a motion that knows
the future does so. **Back**: no collision, and the tip there at the end, in scenes that are feasible. In
per cent, with 95 % confidence intervals (Wilson score).

{rows}

Aims, set before anything was measured: with all errors at most 3 points more collisions than where
everything is known, which are {collisions:+.1f}, and at most 5 points fewer hands held, which are
{held:+.1f}.
{verdict}

What is lost is the hand, less often than before bodies that are round were followed by their middles
(T205): with all errors 57 % were held, and 10 % collided. In 168 scenes of training seeds, 124 of them
with the tip:

| the law knows | held | collisions |
|---|--:|--:|
| pictures without errors, by means and sides | 88 of 124 | 4 of 168 |
| the same, by middles | 102 | 4 |
| pictures with all errors, by means and sides | 77 | 5 |
| the same, by middles | 97 | 5 |

What stands for a ball is then off its middle by 0.5 mm without errors and by 10 mm with all of them
(medians; 3 and 16 mm in nine of ten), which is what the cameras stand and look aside. Everything in these
crowds is round. Of boxes, short capsules and spheres that come to links (216 random scenes of links swept,
195 with the tip) with all errors 154 instead of 153 are held and one instead of none collides: what is not
round is left as it is seen. Balls that were taken for such with 2.5 times the tolerance collided in five of
these.

What was tried before, by means and sides, says what else counts. Of 56 scenes of training seeds 42 are
feasible with the tip, and it is held in 39 of these where everything is known.

| the law knows | held | collisions |
|---|--:|--:|
| every ball | 39 of 42 | 1 of 56 |
| every ball as a cloud of exact points, which push together (T192) | 39, the same ones | 2 |
| such clouds 2.6 cm larger, as balls of half the diagonal of a cell make them | 35 | 3 |
| pictures without errors in the room above | 29 | 0 |
| pictures in the default room of 2 × 2 × 1.6 m | 25 | 1 |
| every ball, with a field of 5 N instead of 100 | 29 | 3 |

The last row is why points push together: as each pushed by itself, the field had to be weakened to 5 N,
which alone costs ten hands. On twice as many scenes, 84 with the tip of 112, where 76 are held and 2 collide
where everything is known, it helps to let the hand go later:

| `preview.trigger` | no error: held | collisions | all errors: held | collisions |
|---|--:|--:|--:|--:|
| 1.2 s, the default | 55 of 84 | 1 of 112 | 52 | 5 |
| 1.0 s | 63 | 3 | 53 | 5 |
| 0.8 s | 64 | 6 | 57 | 8 |

True velocities at the points of pictures hold 65 instead of 63 with 1.0 s, points all over the true
surfaces 66, with balls of 1 instead of 2.6 cm 68: the size of a cloud and the side that is missing in it
lose hands. Smaller balls at the points alone hold 67, but 9 collide: the surface that comes nearest to the
arm is not in pictures, because it is cut away as the arm or turned away from the cameras.

## The arm in its own pictures

What the perceiver cuts away has to be all of the arm, or the law runs from itself. Counted is what is
left of seven bundled arms, and of two whose capsules are hulls with 24 and 40 corners, in pictures of
64 × 48 pixels by a ray caster that shares no code with the core. The arms swing about random postures
at 10 to 100 % of their speed limits, up to 4.7 m/s, and random cameras look at them from up to 1.8 m
that stand 5 mm beside where they are said to stand and whose clocks are 20 ms ahead or behind; half of
the pictures are taken in before the states that follow are known. Every point is looked at (`stride` 1,
`least_points` 1); a clock error of 20 ms and a margin of 2 cm are the defaults.

| `cargo bench --bench self_filter --` | margin | points of the arm | left |
|---|--:|--:|--:|
| `100000`: 5 mm and 20 ms | 2 cm | 24 245 698 | 0 |
| `100000 1 0.5`: turned by half a degree as well | 3 cm | 24 240 769 | 0 |
| `100000 1 0.5 2`: and with noise of 2 mm at 1 m | 3 cm | 24 240 760 | 38 |
| `10000 1 0 0 2`: 10 mm and 40 ms, of which it is not told | 2 cm | 2 417 359 | 31 406 |

The first row is what is promised. In the third an outlier of the noise, whose standard deviation is 6
mm at 1.8 m, is left in 8 of 4000 recordings. The last row shows that the count can see a fault.
"""
HEAD = "| the law knows | collisions | held | back |\n|---|--:|--:|--:|"


def outcomes(first: int, count: int) -> dict[str, list[dict[str, Any]]]:
    """How every scene from a seed on went, in all ways."""
    drawn = [
        scenes.in_space("crowd", arm, task, seed)
        for seed in range(first, first + count)
        for arm in ARMS
        for task in TASKS
    ]
    verdicts = [vff.feasibility(scene) for scene in drawn]
    rooms = [scene.replace(obstacles=[*scene.to_dict()["obstacles"], *WALLS]) for scene in drawn]
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in WAYS}
    for name, way in WAYS.items():
        for begin in range(0, len(rooms), AT_ONCE):
            block = rooms[begin : begin + AT_ONCE]
            results = vff.simulate_many(block, LAW | way | {"simulation.record_every": evaluating.EVERY})
            for verdict, result in zip(verdicts[begin:], results, strict=False):
                found[name].append({"feasibility": verdict, **evaluating.scores_of(result, None)})
        print(f"| {name} | {' | '.join(map(str, rates(found[name])))} |", flush=True)
    return found


def rates(rows: list[dict[str, Any]]) -> list[Any]:
    """Collisions, hands held and hands back of one way."""
    with_tip = [row for row in rows if row["feasibility"] == "with tip"]
    feasible = [row for row in rows if row["feasibility"] != "none found"]
    hits = sum(row["collided"] or row["diverged"] for row in rows)
    return [
        wilson(hits, len(rows)),
        wilson(sum(row["success"] for row in with_tip), len(with_tip)),
        wilson(sum(row["returned"] for row in feasible), len(feasible)),
    ]


def main() -> None:
    """Run all, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=COUNT)
    parser.add_argument("--training", action="store_true")
    given = parser.parse_args()
    found = outcomes(500 if given.training else FIRST, given.count)
    of = {name: rates(rows) for name, rows in found.items()}
    if given.training:
        return
    table = [f"| {name} | {' | '.join(map(str, each))} |" for name, each in of.items()]
    known, last = of["everything is known"], of["pictures, all errors"]
    collisions, held = (100 * (last[k].value - known[k].value) for k in (0, 1))
    met = [collisions <= AIMS["collisions"], held >= -AIMS["held"]]
    verdict = {2: "Both are met.", 1: "One of the two is met.", 0: "Neither is met."}[sum(met)]
    page = TEXT.format(
        scenes=given.count * len(ARMS) * len(TASKS),
        count="" if given.count == COUNT else f" {given.count}",
        version=vff.__version__,
        rows="\n".join([HEAD, *table]),
        collisions=collisions,
        held=held,
        verdict=verdict,
    )
    (DOCS / "evaluation-perception.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    main()
