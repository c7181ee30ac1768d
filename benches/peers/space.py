"""Other libraries and ours on the same random scenes in space: `python benches/peers/space.py`.

Needs ``pip install ".[peers,tune]"`` and a quarter of an hour; writes docs/peers.md and draws
docs/figures/peers-space.png. ``--arms iiwa14 ur5e`` does that for two other arms, without times and figure,
``--sampling`` for MPPI beside cbf, without a figure; of the extras that needs SciPy and Numba alone.
``--tune`` finds the settings of benches/peers/spatial/tuned*.toml first, on training seeds, which takes
longer. Scenes that are done are kept in target/peers: an interrupted run resumes, and several processes can
share the work with ``--skip``. ``--quick`` drives 0.1 s of one scene and only prints.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from time import perf_counter

for library in ("OPENBLAS", "OMP", "MKL"):  # one thread each, ours included
    os.environ[f"{library}_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

import vffnull as vff  # noqa: E402
from peers import spatial  # noqa: E402
from peers.spatial import tune  # noqa: E402
from peers.spatial.drive import drive, free  # noqa: E402
from peers.spatial.figure import draw  # noqa: E402
from peers.spatial.group import GROUPS, Group  # noqa: E402
from peers.spatial.page import tables  # noqa: E402
from peers.spatial.way import Way  # noqa: E402
from report import write_section  # noqa: E402
from vffnull._support.files import replacing  # noqa: E402
from vffnull.evaluation import scenes  # noqa: E402
from vffnull.run import evaluate as evaluating  # noqa: E402

DOCS = Path(__file__).resolve().parents[2] / "docs"
KEPT = Path(__file__).resolve().parents[2] / "target" / "peers"
TRAINING, TRIALS = 1, 16  # seeds of every family and task; trials of every way
QUICK = 100  # steps
TIMED = ("crowd",)  # families of the training scenes whose steps are timed
Times = dict[str, np.ndarray]


def judge(
    group: Group, everybody: list[Way], scene: vff.Scenario, most: int | None = None
) -> tuple[list[dict[str, object]], Times]:
    """The rows of every way on a scene, one after the other, and what all steps took [ns]."""
    span, verdict = evaluating.encounter(free(scene)), vff.feasibility(scene)
    done = [drive(way, tune.settings_of(way, group.found), scene, span, verdict, most) for way in everybody]
    return [each.row for each in done], {each.row["controller"]: each.taken for each in done}


def kept(group: Group, everybody: list[Way], scene: vff.Scenario) -> list[dict[str, object]]:
    """The rows, run unless there is a file of them; remove the files after changing a way."""
    file = KEPT / group.section.replace(" ", "-") / f"{scene.name}.json"
    if not file.exists():
        begin = perf_counter()
        rows, _ = judge(group, everybody, scene)
        file.parent.mkdir(parents=True, exist_ok=True)
        with replacing(file) as draft:
            draft.write_text(json.dumps(rows, default=lambda value: value.item()), encoding="utf-8")
        print(f"{scene.name}: {perf_counter() - begin:.0f} s", file=sys.stderr, flush=True)
    read: list[dict[str, object]] = json.loads(file.read_text(encoding="utf-8"))
    return read


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    known = dict.fromkeys(" ".join(group.arms) for group in GROUPS)
    parser.add_argument("--arms", nargs="+", default=["panda"], help="; ".join(known))
    parser.add_argument("--sampling", action="store_true", help="MPPI beside cbf, instead of the libraries")
    parser.add_argument("--quick", action="store_true", help="0.1 s of one scene, nothing written")
    parser.add_argument("--tune", action="store_true", help="find the settings first")
    parser.add_argument("--only", help="tune this way alone, and judge nothing")
    parser.add_argument("--trials", type=int, default=TRIALS, help="settings tried for every way")
    parser.add_argument(
        "--training", type=int, default=TRAINING, help="training seeds of every family and task"
    )
    parser.add_argument("--seeds", type=int, help="evaluation seeds of every family and task")
    parser.add_argument(
        "--skip", type=int, default=0, help="seeds to leave to another process; writes no page"
    )
    given = parser.parse_args()
    chosen_arms = [each for each in GROUPS if set(each.arms) == set(given.arms)]
    group = next((each for each in chosen_arms if (each.section == "sampling") == given.sampling), None)
    if group is None:
        parser.error(f"--arms: there are {' and '.join(known)}, the first of them with --sampling too")
    everybody, begin = spatial.load(group), perf_counter()
    if given.tune or given.only:
        seeds = range(scenes.TRAINING.start, scenes.TRAINING.start + given.training)
        for way in everybody:
            if way.space and given.only in (None, way.name):
                chosen = tune.drawn(group.arms, seeds, tune.FAMILIES)
                tune.keep(way.name, tune.tune(way, chosen, given.trials, group.found), group.found)
        if given.only:
            return
    first = scenes.EVALUATION.start + given.skip
    chosen = tune.drawn(group.arms, range(first, first + (given.seeds or group.seeds)))
    if given.quick:
        scored, most = [], QUICK
    else:
        scored, most = [row for scene in chosen for row in kept(group, everybody, scene)], None
        if given.skip:
            return
    timed = tune.drawn(group.arms, scenes.TRAINING[:1], TIMED) if given.quick or group.timed else []
    parts = [judge(group, everybody, scene, most) for scene in (timed[:1] if given.quick else timed)]
    names = tuple(way.name for way in everybody)
    outcome = vff.Evaluation.of(scored or [row for rows, _ in parts for row in rows], names)
    taken = {name: np.concatenate([times[name] for _, times in parts]) for name in names if group.timed}
    text = tables(everybody, outcome, taken, tune.found(group.found), group.packages)
    print(text)
    if not given.quick:
        write_section(DOCS / "peers.md", group.section, text)
        if group.figure:
            draw(outcome, taken, DOCS / "figures" / group.figure)
    print(f"{perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
