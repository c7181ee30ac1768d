"""Other libraries and ours on the same random scenes in space: `python benches/peers/space.py`.

Needs ``pip install ".[peers,tune]"`` and a quarter of an hour; writes docs/peers.md and draws
docs/figures/peers-space.png. ``--tune`` finds the settings of benches/peers/spatial/tuned.toml first, on
training seeds, which takes longer. ``--quick`` drives 0.1 s of two scenes and only prints.
"""

from __future__ import annotations

import argparse
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
from peers.spatial.page import tables  # noqa: E402
from peers.spatial.way import Way  # noqa: E402
from report import write_section  # noqa: E402
from vffnull import evaluation, scenes  # noqa: E402

DOCS = Path(__file__).resolve().parents[2] / "docs"
JUDGED, TRAINING, TRIALS = 6, 1, 24  # seeds of every family and task; trials of every way
QUICK = 100  # steps


def judge(
    everybody: list[Way], chosen: list[vff.Scenario], most: int | None = None
) -> tuple[vff.Evaluation, dict[str, np.ndarray]]:
    """Every way on every scene, one after the other on each, and the times of all steps [ns]."""
    rows, taken = [], {way.name: [] for way in everybody}
    for i, scene in enumerate(chosen):
        begin = perf_counter()
        span, verdict = evaluation.encounter(free(scene)), vff.feasibility(scene)
        for way in everybody:
            done = drive(way, tune.settings_of(way), scene, span, verdict, most)
            rows.append(done.row)
            taken[way.name].append(done.taken)
        seconds = perf_counter() - begin
        print(f"{i + 1} of {len(chosen)}: {scene.name}, {seconds:.0f} s", file=sys.stderr, flush=True)
    names = tuple(way.name for way in everybody)
    return vff.Evaluation.of(rows, names), {name: np.concatenate(each) for name, each in taken.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="0.1 s of two scenes, nothing written")
    parser.add_argument("--tune", action="store_true", help="find the settings first")
    parser.add_argument("--only", help="tune this way alone, and judge nothing")
    parser.add_argument("--trials", type=int, default=TRIALS, help="settings tried for every way")
    parser.add_argument(
        "--training", type=int, default=TRAINING, help="training seeds of every family and task"
    )
    parser.add_argument("--seeds", type=int, default=JUDGED, help="evaluation seeds of every family and task")
    given = parser.parse_args()
    everybody, begin = spatial.load(), perf_counter()
    if given.tune or given.only:
        seeds = range(scenes.TRAINING.start, scenes.TRAINING.start + given.training)
        for way in everybody:
            if way.space and given.only in (None, way.name):
                tune.keep(way.name, tune.tune(way, tune.drawn(spatial.ARM, seeds), given.trials))
        if given.only:
            return
    first = scenes.EVALUATION.start
    chosen = tune.drawn(spatial.ARM, range(first, first + (1 if given.quick else given.seeds)))
    outcome, taken = judge(everybody, chosen[:2] if given.quick else chosen, QUICK if given.quick else None)
    text = tables(everybody, outcome, taken, tune.found())
    print(text)
    if not given.quick:
        write_section(DOCS / "peers.md", "space", text)
        draw(outcome, taken, DOCS / "figures" / "peers-space.png")
    print(f"{perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
