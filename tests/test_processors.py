"""What has a seed is the same on every processor: no last bit of BLAS, LAPACK or NumPy's kernels decides.

OpenBLAS and NumPy choose their kernels by the processor; environment variables let them take those
of another one.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from waiting import HANG

# Digests of scenes of every generator with what could be done in one, of designs of every kind with every
# kind of factor, of resampled effects, and of the candidates that a tuning proposes.
PRINTED = """
import hashlib, json, random, tempfile
import numpy as np
from vffnull.evaluation import planner
from vffnull.evaluation import scenes
from vffnull.evaluation.scenes.goals import to_a_goal
from vffnull.studies import Study
from vffnull.studies.effects import effect, explained, indices

def document(scene):
    return {key: scene[key] for key in ("q0", "arm", "controller", "reference", "obstacles")}

made = {}
for family in scenes.FAMILIES:
    made[family] = [document(scenes.random(family, n, 1_000_000)) for n in (4, 9)]
for family, arm, task in (
    ("links-swept", "iiwa14", "pose"),
    ("path-crossed", "ur5e", "position"),
    ("clutter", "panda", "position"),
    ("clutter", "ur5e", "pose"),
    ("crowd", "panda", "pointing"),
):
    made[family, arm, task] = document(scenes.in_space(family, arm, task, 1_000_001))
for family in ("post", "door"):
    for arm in ("plane", "panda"):
        made[family, arm] = document(to_a_goal(family, arm, 1_000_000))
factors = [
    {"key": "controller.field.gain", "range": [0.01, 3.0], "scale": "log", "levels": 7},
    {"key": "controller.stiffness", "range": [20, 900], "scale": "log", "whole": True, "levels": 7},
    {"key": "controller.damping", "range": [5.0, 60.0], "levels": 3},
]
for kind in ("grid", "latin-hypercube", "sobol", "saltelli", "random"):
    design = {"kind": kind} | ({} if kind == "grid" else {"count": 64})
    plan = Study({"scenario": "sweep-through", "factors": factors, "design": design, "seed": 3})._plan
    made[kind] = plan.design.rows(0, plan.points).tolist()
crossed = scenes.random("crowd", 4, 1_000_000)
left, motion = planner.escape(crossed)
made["judged"] = [planner.feasibility(crossed), left, None if motion is None else motion.tolist()]
draw = random.Random(3)
rows = np.array([[draw.random() for _ in range(5)] for _ in range(257)])
made["indices"] = [[each.first.tolist(), each.total.tolist()] for each in indices(rows)]
over = effect(rows[:, 0], rows[:, 1])
made["effects"] = [over.mean.tolist(), over.low.tolist(), over.high.tolist()]
made["explained"] = explained(rows[:, 0], rows[:, 0] ** 2)
goal = {"metric": "min_clearance", "direction": "maximize", "over": "min"}
tuned = {"trials": 16, "batch": 4, "objectives": [goal]}  # from the eleventh on, the sampler has learnt
short = {"duration": 0.05, "obstacles.0.position": [1.6, 1.9]}
study = Study({"scenario": "sweep-through", "overrides": short, "factors": factors, "tune": tuned, "seed": 3})
with tempfile.TemporaryDirectory() as place:
    made["proposals"] = [trial.factors for trial in study.tune(place + "/results").trials]
print(json.dumps({
    str(key): hashlib.sha256(json.dumps(value).encode()).hexdigest()[:16] for key, value in made.items()
}))
"""


# Of the scenes of which documents tell.
STORED = """
import test_scenes, test_scenes_in_space
for module in (test_scenes, test_scenes_in_space):
    for family, stored in module.FINGERPRINTS.items():
        print(module.__name__, family, module.fingerprint(family), stored)
"""


def printed(program: str = PRINTED, /, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=Path(__file__).parent,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def here() -> str:
    """With the kernels of this processor."""
    return printed(OPENBLAS_NUM_THREADS="1")


FEATURES = " ".join(np.show_config(mode="dicts")["SIMD Extensions"]["found"])


another = pytest.mark.parametrize(
    "environment",
    [
        {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "2"},
        {"OPENBLAS_CORETYPE": "SkylakeX"},
        {"OPENBLAS_CORETYPE": "Prescott", "NPY_DISABLE_CPU_FEATURES": FEATURES},
    ],
    ids=lambda environment: environment["OPENBLAS_CORETYPE"],
)


@another
def test_another_processor(environment: dict[str, str], here: str) -> None:
    assert printed(**environment) == here


@another
def test_stored_fingerprints_on_another_processor(environment: dict[str, str]) -> None:
    lines = printed(STORED, **environment).splitlines()
    assert len(lines) == 8
    for line in lines:
        _, _, found, stored = line.split()
        assert found == stored, line
