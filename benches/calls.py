"""What a cycle of the controller costs from C, from C++ and from Python. Writes a part of docs/speed.md.

python benches/calls.py [CYCLES]     1 000 000 by default
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

import vffnull as vff
from report import readable, rows, write_section

ROOT = Path(__file__).resolve().parents[1]
PROGRAMS = ROOT / "target" / "cpp"
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
RATES = 0.5 + 0.1 * np.arange(7)


def from_python(cycles: int) -> dict[str, Any]:
    """The same cycles as in examples/cpp/cost.h, with lists, which are the fastest way in."""
    robot = vff.Arm.named("panda")
    settings = {"task": "pose", "stiffness": 900.0, "damping": 60.0, "null_damping": 12.0}
    controller = vff.Controller(robot, settings | {"field": vff.Field.bounded(80.0, 0.25).to_dict()})
    reference = np.concatenate(robot.pose(READY)).tolist()
    motion = vff.Motion.sinusoid([0.0, 0.3, 0.0], 1.0)
    around = [vff.Obstacle.sphere([-0.05, 0.0, 0.62], 0.08, motion=motion)]
    times = np.empty(cycles, dtype=np.int64)
    clock = min(-(time.perf_counter_ns() - time.perf_counter_ns()) for _ in range(1000))
    zero = [0.0] * 6
    for k in range(cycles):
        phase = RATES * (0.001 * k)
        q, dq = (READY + 0.2 * np.sin(phase)).tolist(), (0.2 * RATES * np.cos(phase)).tolist()
        begun = time.perf_counter_ns()
        controller.torque(q, dq, reference, zero, zero, around, 0.001 * k)
        times[k] = time.perf_counter_ns() - begun
    times.sort()
    at = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999, "max": 1.0}
    return {"name": "Python", "clock": clock} | {
        key: int(times[int(share * (cycles - 1))]) for key, share in at.items()
    }


def main() -> None:
    """Measure, and write the table."""
    cycles = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    if not all((PROGRAMS / program).exists() for program in ("cost", "cost_cpp")):
        raise SystemExit("Build the programs in C and C++ first: docs/c.md has the commands.")
    found = []
    for program in ("cost", "cost_cpp"):
        command = [PROGRAMS / program, str(cycles)]
        found.append(json.loads(subprocess.run(command, check=True, capture_output=True).stdout))
    found.append(from_python(cycles))
    columns = ("p50", "p99", "p99.9", "max")
    body = [[each["name"], *(readable(1e-9 * each[column]) for column in columns)] for each in found]
    text = rows(["one cycle, from", *columns], body)
    clock = readable(1e-9 * max(each["clock"] for each in found))
    write_section(
        ROOT / "docs" / "speed.md",
        "calls",
        f"{text}\n{cycles:,} cycles each; reading the clock takes up to {clock}.\n",
    )


if __name__ == "__main__":
    main()
