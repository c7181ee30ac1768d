"""What possible futures are worth: a body rests beside an arm, and then comes, as one of three ways says.

    python benches/futures.py [COUNT] [--training]

So many scenes in which links are swept for each arm, 60 by default, of evaluation seeds or of others for
tuning. Each body rests for a second where it is half a second before it would touch an arm that does its
task, and then comes as it did; two other ways are turned from that by 1 rad, to either side. Told of are its
velocity alone, all three ways, the two that do not come true, or the one that does (`foreseen`). Collisions
(an overlap of more than 1 mm) are of scenes that are feasible, hands held of those in which a motion that
knows the future holds them.
"""

from __future__ import annotations

import copy
import warnings
from typing import Any

import numpy as np

import vffnull as vff
from seeds import asked
from vffnull.evaluation import CONTROLLERS, scenes
from vffnull.run import evaluate as evaluating

ARMS = ("panda", "iiwa14", "gen3")
BEGIN, LEAD, TURN = 1.0, 0.5, 1.0  # s, s, rad
LAW = CONTROLLERS["cbf + preview"] | {"controller.yielding.preview": {"self_motion": {}}}


def decided(scene: vff.Scenario) -> vff.Scenario | None:
    """The scene in which bodies rest first; None where one touches nothing, or rests too near."""
    obstacles = scene.to_dict()["obstacles"]
    for each in obstacles:
        if each.get("motion", {}).get("kind") != "linear":
            return None
        alone = scene.replace(obstacles=[each], **{"controller.field.gain": 0.0})
        found = vff.simulate(alone, {"simulation.record_every": 5})
        touched = np.flatnonzero(found.clearance.min(axis=1) <= 0.0)
        if not len(touched):
            return None
        velocity = np.array(each["motion"]["velocity"])
        begin = np.array(each["position"]) + velocity * (found.t[touched[0]] - LEAD)
        end = begin + velocity * (scene.duration - BEGIN)
        points = [begin.tolist(), begin.tolist(), end.tolist()]
        each["position"] = points[0]
        each["motion"] = {"kind": "waypoints", "times": [0.0, BEGIN, scene.duration], "points": points}
    changed = scene.replace(obstacles=obstacles)
    near = vff.simulate(changed, {"duration": 0.005}).clearance.min() < 0.05
    return None if near else changed


def turned(obstacle: dict[str, Any], angle: float) -> dict[str, Any]:
    """The same body on its way, turned by an angle [rad] about an axis across it."""
    other = copy.deepcopy(obstacle)
    begin, _, end = np.array(other["motion"]["points"])
    way = end - begin
    axis = np.cross(way, [0.3, 0.5, 0.8])
    aside = np.cross(axis / np.linalg.norm(axis), way)
    other["motion"]["points"][2] = (begin + np.cos(angle) * way + np.sin(angle) * aside).tolist()
    return other


def told(scene: vff.Scenario, right: bool) -> vff.Scenario:
    """With the ways that bodies may go, the right one among them or not."""
    obstacles = scene.to_dict()["obstacles"]
    ways: list[dict[str, Any]] = []
    for each in obstacles:
        may = [turned(each, TURN), turned(each, -TURN), *([copy.deepcopy(each)] if right else [])]
        ways += [way | {"likelihood": 1.0 / 3.0} for way in may]
    return scene.replace(obstacles=[*obstacles, *ways])


def foreseen(scene: vff.Scenario) -> vff.Scenario:
    """With the way that they go."""
    obstacles = scene.to_dict()["obstacles"]
    for each in obstacles:
        each["motion"]["foreseen"] = True
    return scene.replace(obstacles=obstacles)


def main() -> None:
    """Run all, and print the table."""
    seeds = asked(__doc__)
    print("| arm | told of | collisions | hands held |\n|---|---|--:|--:|")
    for arm in ARMS:
        drawn = (scenes.in_space("links-swept", arm, "pose", seed) for seed in seeds)
        usable = [scene.replace(**LAW) for scene in map(decided, drawn) if scene is not None]
        verdicts = [vff.feasibility(scene) for scene in usable]
        for name, ways in {
            "its velocity": usable,
            "three ways": [told(scene, right=True) for scene in usable],
            "two wrong ways": [told(scene, right=False) for scene in usable],
            "the right way": [foreseen(scene) for scene in usable],
        }.items():
            results = vff.simulate_many(ways, {"simulation.record_every": evaluating.EVERY})
            rows = [evaluating.scores_of(result, None) for result in results]
            judged = list(zip(verdicts, rows, strict=True))
            hits = [row["collided"] for verdict, row in judged if verdict != "none found"]
            held = [row["success"] for verdict, row in judged if verdict == "with tip"]
            cells = f"{sum(hits)} of {len(hits)} | {sum(held)} of {len(held)}"
            print(f"| {arm} | {name} | {cells} |", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
    main()
