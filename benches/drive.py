"""How well `vffnull.drive` keeps its clock, with drivers in Rust and in Python. Writes a part of
docs/on-your-robot.md.

python benches/drive.py [--seconds 60] [--rate 1000] [--priority N] [--core K] [--quick]

The robot is the simulated Panda of `panda-sweep`. "In Rust" the loop does not touch Python. "In Python" the
same robot is called by methods of a Python class; then another thread of Python computes all the time, with
the switch interval that Python has and with a shorter one. The load of the machine is measured before and
after, and written beside the table.
"""

from __future__ import annotations

import argparse
import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import vffnull as vff
from report import readable, rows, write_section
from vffnull.robots.simulated import SimulatedRobot

ROOT = Path(__file__).resolve().parents[1]
SWITCH = 1e-4  # s


class InPython:
    """The same robot behind methods of a Python class."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot

    def read(self) -> Any:
        return self._robot.read()

    def write(self, command: Any, /) -> None:
        self._robot.write(command)


@contextmanager
def computing(interval: float) -> Iterator[None]:
    """Another thread that computes in Python."""
    before, over = sys.getswitchinterval(), threading.Event()

    def compute() -> None:
        while not over.is_set():
            sum(range(1000))

    sys.setswitchinterval(interval)
    thread = threading.Thread(target=compute)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()
        sys.setswitchinterval(before)


def measured(python: bool, options: argparse.Namespace) -> vff.DriveReport:
    """A drive of some seconds, a ball being swept through the elbow again and again."""
    scenario = vff.Scenario.load("panda-sweep")
    robot = SimulatedRobot(scenario, options.rate)
    controller = vff.Controller(scenario.arm, scenario["controller"])
    ball = vff.Obstacle.sphere([-0.05, 0.0, 0.62], 0.08, vff.Motion.sinusoid([0.0, 0.6, 0.0], 0.6))
    with vff.drive(
        InPython(robot) if python else robot,
        controller,
        options.rate,
        obstacles=[ball],
        seconds=options.seconds,
        priority=options.priority,
        core=options.core,
    ) as drive:
        drive.wait()
    if drive.report.status != "completed":
        raise SystemExit(f"{drive.report!r}")
    return drive.report


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--priority", type=int)
    parser.add_argument("--core", type=int)
    parser.add_argument("--quick", action="store_true", help="a second each, and the page stays as it is")
    options = parser.parse_args()
    if options.quick:
        options.seconds = 1.0
    default = sys.getswitchinterval()
    load = os.getloadavg()[0]
    found = {"in Rust": measured(False, options), "in Python": measured(True, options)}
    for interval in (default, SWITCH):
        with computing(interval):
            name = f"in Python, while another thread computes, switch interval {1e3 * interval:g} ms"
            found[name] = measured(True, options)

    def row(name: str, report: vff.DriveReport) -> list[str]:
        late = [readable(report.latency.quantile(p)) for p in (0.5, 0.999, 1.0)]
        took = [readable(report.step.quantile(p)) for p in (0.5, 0.999, 1.0)]
        skipped = report.skipped / (report.periods + report.skipped)
        return [name, *late, *took, f"{report.missed / report.periods:.2%}", f"{skipped:.2%}"]

    head = ["driver", "late, p50", "p99.9", "max", "takes, p50", "p99.9", "max", "ends late", "left out"]
    table = rows(head, [row(name, report) for name, report in found.items()])
    way = "" if options.priority is None else f", SCHED_FIFO {options.priority}"
    text = (
        f"{table}\n{options.seconds:g} s each at {options.rate:g} Hz{way}; {os.cpu_count()} cores. Before, "
        f"{load:.1f} programs wanted one on average: the longest times are theirs, too.\n"
    )
    print(text)
    if not options.quick:
        write_section(ROOT / "docs" / "on-your-robot.md", "drive", text)


if __name__ == "__main__":
    main()
