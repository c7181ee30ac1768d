"""Print what `cargo bench` has measured as Markdown tables: `python benches/table.py [target/criterion]`."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

STEP = "closed_loop"
SECTIONS = {
    "operators": ("operator", "operators of the arm"),
    "law": ("law", "the law alone"),
    "proximity": ("shape", "one link, one obstacle"),
    "quadratic_program": ("rows", "the QP of cbf, 6 unknowns, by the number of rows"),
}


def measured(root: Path) -> dict[str, float]:
    """Median time [s] of every benchmark, by its full name."""
    times = {}
    for file in sorted(root.glob("**/new/benchmark.json")):
        name = json.loads(file.read_text())["full_id"]
        estimates = json.loads(file.with_name("estimates.json").read_text())
        times[name] = estimates["median"]["point_estimate"] * 1e-9
    return times


def readable(seconds: float) -> str:
    for unit, size in (("ms", 1e-3), ("µs", 1e-6)):
        if seconds >= size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 1e-9:.3g} ns"


def rows(head: tuple[str, ...], body: list[tuple[str, ...]]) -> None:
    for row in (head, ("---",) + ("---:",) * (len(head) - 1), *body):
        print("| " + " | ".join(row) + " |")
    print()


def closed_loop(times: dict[str, float]) -> None:
    """The step at every size, with what it grows by."""
    joints = by_number(times, f"{STEP}/euler-hold/joints/")
    obstacles = by_number(times, f"{STEP}/euler-hold/obstacles/")
    one = {name: by_number(times, f"{STEP}/{name}/joints/") for name in ("rk4-hold", "rk4-continuous")}
    body = [(f"{n} joints, 1 disc", readable(t)) for n, t in joints.items()]
    body += [(f"6 joints, {k} discs", readable(t)) for k, t in obstacles.items() if k > 1]
    barriers = by_number(times, f"{STEP}/euler-hold-cbf/discs/")
    body += [(f"6 joints, {k} disc{'s' * (k > 1)}, cbf", readable(t)) for k, t in barriers.items()]
    body += [(f"{n} joints, 1 disc, {name}", readable(t)) for name, by in one.items() for n, t in by.items()]
    rows(("one step of the closed loop", "time"), body)
    crowds = [by_number(times, f"{STEP}/euler-hold/{kind}/") for kind in ("static", "moving")]
    if all(crowds):
        body = [(str(k), *(readable(crowd[k]) for crowd in crowds)) for k in crowds[0] if k in crowds[1]]
        rows(("6 joints, discs (5 of them near)", "static", "moving"), body)
    if 10 in joints and 100 in joints:
        print(f"From 10 to 100 joints the step takes {joints[100] / joints[10]:.1f} times as long.\n")


def single_steps(file: Path) -> None:
    """How long single steps take that look at their slowest."""
    if not file.exists():
        return
    body = [(name, *(f"{t:.2f}" for t in times)) for name, times in json.loads(file.read_text()).items()]
    rows(("single steps [µs]", "mean", "p50", "p99", "p99.9", "max", "p99.9*", "max*"), body)
    print("\\* of every step the least time in equal runs\n")


def by_number(times: dict[str, float], prefix: str) -> dict[int, float]:
    found = {int(name.removeprefix(prefix)): t for name, t in times.items() if name.startswith(prefix)}
    return dict(sorted(found.items()))


def section(times: dict[str, float], group: str) -> None:
    """A group with one row per benchmark and one column per number of joints."""
    what, title = SECTIONS[group]
    cells: dict[str, dict[str, str]] = {}
    for name, t in times.items():
        if name.startswith(f"{group}/"):
            _, row, *column = name.split("/")
            cells.setdefault(row, {})[column[0] if column else ""] = readable(t)
    if not cells:
        return
    columns = sorted({c for row in cells.values() for c in row}, key=lambda c: int(c or 0))
    head = tuple(f"n = {c}" if c else "time" for c in columns)
    print(f"**{title}**\n")
    rows((what, *head), [(f"`{row}`", *(by.get(c, "–") for c in columns)) for row, by in cells.items()])


def main() -> None:
    target = Path(os.environ.get("CARGO_TARGET_DIR", "target"))
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else target / "criterion"
    times = measured(root)
    if not times:
        sys.exit(f"nothing measured in {root}: run `cargo bench` first")
    closed_loop(times)
    single_steps(root.parent / "tmp" / "single_steps.json")
    for group in SECTIONS:
        section(times, group)


if __name__ == "__main__":
    main()
