"""Hold what scenarios compute to what another commit computes, bit for bit.

    python tools/freeze.py REVISION              builds both, runs every bundled scenario in both, compares
    python tools/freeze.py REVISION --short      a few scenarios, one change at a time: what CI does

Both are built on the same machine, because the last bits of a sine depend on the processor. Compared is every
array of the record, every metric and the status, of every bundled scenario under every `avoidance`,
`formulation`, `control` and integrator. Exits with 1 if anything differs.
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 1.5  # simulated, of each case
VARIANTS = {
    "controller.avoidance": ("null_space", "relaxed", "priority", "cbf", "preview"),
    "controller.formulation": ("recursive", "extended_jacobian"),
    "simulation.control": ("continuous", "hold", "predictor"),
    "simulation.integrator": ("rk4", "semi_implicit_euler"),
}
SHORT = ("sweep-through", "crowd", "panda-sweep", "ur5e-crossed", "iiwa-crowd")
# What no bundled scenario has: a pose, every shape, every motion, limits, sensors, another plant.
EXTRA: dict[str, dict[str, Any]] = {
    "pose": {
        "duration": 2.0,
        "q0": [1.3, -0.5, -0.5, -0.4, -0.1, 0.1, 0.3],
        "arm": {
            "lengths": [0.8] * 7,
            "masses": [0.6, 0.5, 0.7, 0.6, 0.5, 0.4, 0.3],
            "radius": 0.03,
            "gravity": 9.81,
            "joint_limits": [-2.0, 2.0],
            "velocity_limits": 1.5,
            "torque_limits": 60.0,
        },
        "controller": {
            "task": "pose",
            "stiffness": 100,
            "damping": 20,
            "null_damping": 6,
            "self_collision": "avoid",
            "joint_limit_field": {"kind": "khatib", "gain": 0.01, "influence": 0.4},
            "tank": {"initial": 1.0, "capacity": 2.0},
            "field": {"kind": "cubic", "gain": 0.3, "influence": 0.6, "sliding": 20.0},
        },
        "reference": {"kind": "line", "end": [4.0, 2.2, 0.2], "duration": 2.0},
        "obstacles": [
            {"shape": {"kind": "capsule", "a": [-0.2, 0.0], "b": [0.2, 0.1], "radius": 0.1},
             "position": [1.9, 3.0], "motion": {"kind": "linear", "velocity": [0.0, -0.45]}},
            {"shape": {"kind": "box", "size": [0.7, 0.5]}, "position": [3.4, 0.1], "angle": 0.3},
            {"shape": {"kind": "polygon", "vertices": [[0, 0], [0.4, 0], [0.2, 0.3]]}, "position": [1.0, 3.0],
             "motion": {"kind": "waypoints", "times": [0.2, 1.0], "points": [[1.0, 3.0], [1.4, 2.4]]}},
        ],
    },
    "sensed": {
        "duration": 2.0,
        "seed": 3,
        "q0": [1.2, -0.6, -0.6, -0.5, 0.3, 0.4],
        "arm": {"lengths": [1.0] * 6, "masses": 1.0},
        "controller": {
            "stiffness": 100, "damping": 20, "null_damping": 6,
            "field": {"kind": "bounded", "gain": 5.0, "influence": 0.6, "approach_damping": 0.7},
        },
        "reference": {"kind": "setpoint", "point": [5.025, 1.017]},
        "plant": {"masses": 1.2, "payload": 0.3, "viscous_friction": 0.1, "coulomb_friction": 0.05},
        "measurement": {"position_noise": 1e-4, "velocity_noise": 1e-3, "delay": 2e-3},
        "perception": {"kind": "range"},
        "actuator": {"time_constant": 5e-3},
        "obstacles": [
            {"shape": {"kind": "circle", "radius": 0.15}, "position": [1.6, 2.6],
             "motion": {"kind": "sinusoid", "amplitude": [0.0, 0.5], "angular_frequency": 2.0}},
        ],
    },
}  # fmt: skip
RENAMED = {"granted": "objective_scale"}  # what other commits call what is recorded


def choices(short: bool) -> list[tuple[str, ...]]:
    """Every combination of the settings; or the first of each, and one other at a time."""
    if not short:
        return list(itertools.product(*VARIANTS.values()))
    first = tuple(values[0] for values in VARIANTS.values())
    others = [
        (*first[:i], value, *first[i + 1 :])
        for i, values in enumerate(VARIANTS.values())
        for value in values[1:]
    ]
    return [first, *others]


def build(tree: Path) -> None:
    """Put the compiled module beside the Python package of this tree."""
    subprocess.run(["cargo", "build", "--release", "--locked", "-p", "vff-python"], cwd=tree, check=True)
    target = Path(os.environ.get("CARGO_TARGET_DIR", tree / "target"))
    shutil.copy(target / "release" / "lib_core.so", tree / "python" / "vffnull" / "_core.abi3.so")


def digests(short: bool) -> dict[str, dict[str, str]]:
    """Hashes of all that the package on the path computes, by case."""
    import numpy as np

    import vffnull as vff

    found = {}
    names = SHORT if short else vff.scenarios()
    scenes = {name: vff.Scenario.load(name).to_dict() for name in names}
    for name, base in (scenes | EXTRA).items():
        shorter = {"duration": min(base["duration"], SECONDS)}
        for choice in choices(short):
            overrides: dict[str, Any] = dict(zip(VARIANTS, choice, strict=True)) | shorter
            if choice[0] == "preview":
                overrides |= {"controller.avoidance": "cbf", "controller.yielding.preview": {}}
            case = " ".join((name, *choice))
            try:
                result = vff.simulate(base, overrides, progress=False)
            except vff.errors.VffNullError as error:
                found[case] = {"refused": type(error).__name__}
                continue
            metrics = {f"metric {key}": value for key, value in result.metrics.items()}
            values: dict[str, Any] = {"status": result.status, **metrics}
            arrays = {key: value for key, value in vars(result).items() if isinstance(value, np.ndarray)}
            found[case] = {RENAMED.get(key, key): repr(value) for key, value in values.items()} | {
                RENAMED.get(key, key): hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()
                for key, value in arrays.items()
            }
    return found


def run(tree: Path, short: bool) -> dict[str, dict[str, str]]:
    """The digests of the package in this tree."""
    environment = os.environ | {"PYTHONPATH": str(tree / "python")}
    command = [sys.executable, str(Path(__file__).resolve()), "--digests", *["--short"] * short]
    done = subprocess.run(command, env=environment, cwd=tree, check=True, stdout=subprocess.PIPE)
    return json.loads(done.stdout)


def differences(before: dict[str, dict[str, str]], after: dict[str, dict[str, str]]) -> list[str]:
    """A line for every case that is not what it was; cases of new scenarios do not count."""
    lines = []
    for case, values in before.items():
        other = after.get(case, {})
        wrong = sorted(key for key, value in values.items() if other.get(key) != value)
        if wrong:
            lines.append(f"{case}: {', '.join(wrong)}")
    return lines


def main() -> None:
    """Read the command line, and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("revision", nargs="?", help="the commit to be compared with")
    parser.add_argument("--short", action="store_true", help="a few scenarios, one change at a time")
    parser.add_argument("--digests", action="store_true", help="print what the package on the path computes")
    parser.add_argument("--before", type=Path, help="a tree that is built already, instead of a revision")
    arguments = parser.parse_args()
    if arguments.digests:
        json.dump(digests(arguments.short), sys.stdout)
        return
    build(ROOT)
    if arguments.before:
        before = run(arguments.before.resolve(), arguments.short)
    else:
        if not arguments.revision:
            parser.error("name the revision to be compared with")
        with tempfile.TemporaryDirectory() as directory:
            tree = Path(directory) / "before"
            subprocess.run(["git", "worktree", "add", "-q", tree, arguments.revision], cwd=ROOT, check=True)
            try:
                build(tree)
                before = run(tree, arguments.short)
            finally:
                subprocess.run(["git", "worktree", "remove", "--force", tree], cwd=ROOT, check=True)
    lines = differences(before, run(ROOT, arguments.short))
    print("\n".join(lines))
    print(
        f"{len(before)} cases of {len({case.split()[0] for case in before})} scenarios, {len(lines)} differ"
    )
    sys.exit(bool(lines))


if __name__ == "__main__":
    main()
