"""Check, time and draw our closed loop beside that of other libraries: `python benches/peers/run.py`.

Needs ``pip install ".[peers]"`` and a few minutes; writes docs/speed.md and draws docs/figures/peers.png.
``--quick`` takes three sizes and only prints.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from importlib.metadata import version
from pathlib import Path
from statistics import median
from time import perf_counter

for library in ("OPENBLAS", "OMP", "MKL"):  # one thread each, ours included
    os.environ[f"{library}_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np  # noqa: E402

import peers  # noqa: E402
import vffnull as vff  # noqa: E402
from peers.figure import draw  # noqa: E402
from peers.law import Task  # noqa: E402
from peers.peer import Loop, Peer  # noqa: E402
from report import readable, rows, write_section  # noqa: E402
from scene import DT, scene  # noqa: E402

SIZES = (6, 12, 24, 50, 100, 200, 500, 1000)
QUICK = (6, 24, 100)
TABLE = (6, 24, 100, 1000)  # numbers of links that get a column
STEPS = 2000  # of the scene
REPETITIONS = 9
BURST = 0.1  # s, what one measurement should take

# Rounding alone drives two right solutions apart where M is ill-conditioned: its condition number is 3e8 for
# 100 links and 3e12 for 1000. (steps, largest |q − q_ours| [rad]) up to 100 links and beyond.
FEW, MANY = (STEPS, 1e-8), (10, 1e-5)

Times = dict[str, dict[int, list[float]]]


def task(n: int) -> Task:
    return Task(scene(n, STEPS * DT))


def bound(n: int) -> tuple[int, float]:
    return FEW if n <= 100 else MANY


def deviation(loop: Loop, ours: np.ndarray, steps: int) -> float:
    """max |q − q_ours| [rad] over the first steps."""
    worst = 0.0
    for k in range(steps):
        loop.step()
        worst = max(worst, float(np.abs(loop.q - ours[k + 1]).max()))
    return worst


def check(peer: Peer, n: int) -> float:
    """The peer's deviation from our trajectory; ends the program if it is another trajectory."""
    loop = peer.prepare(task(n))
    steps, allowed = bound(n)
    found = deviation(loop, trajectory(n), steps)
    print(f"  {peer.name}: n = {n}, {steps} steps, max |q - q_ours| = {found:.1e} rad", flush=True)
    if not found <= allowed:
        raise SystemExit(
            f"{peer.name} does not make our trajectory at n = {n}: {found:.1e} > {allowed:.0e} rad"
        )
    return found


def trajectory(n: int) -> np.ndarray:
    """q (steps + 1, n) of our run."""
    steps, _ = bound(n)
    result = vff.simulate(scene(n, steps * DT))
    if result.status != "completed":
        raise SystemExit(result.message)
    return result.q


def measure(everybody: list[Peer], sizes: tuple[int, ...]) -> Times:
    """Seconds per step of every peer and size, the repetitions interleaved."""
    loops = {(p.name, n): p.prepare(task(n)) for n in sizes for p in everybody if n <= p.largest}
    counts = {key: fitting(loop) for key, loop in loops.items()}
    times: Times = {peer.name: {} for peer in everybody}
    for repetition in range(REPETITIONS):
        print(f"  repetition {repetition + 1} of {REPETITIONS}", flush=True)
        for (name, n), loop in loops.items():
            steps = counts[name, n]
            times[name].setdefault(n, []).append(loop.run(steps) / steps)
    return times


def fitting(loop: Loop) -> int:
    """How many steps fit into one measurement, at least one; the loop is warm afterwards."""
    steps, start = 1, perf_counter()
    while True:
        seconds = loop.run(steps)
        if perf_counter() - start > BURST / 2 or steps >= STEPS:
            return max(1, round(BURST * steps / seconds))
        steps *= 2


def report(everybody: list[Peer], times: Times, deviations: dict[str, dict[int, float]]) -> str:
    """The tables, and what one needs to assess them."""
    ours = times[everybody[0].name]
    sizes = [n for n in TABLE if n in ours]
    head = [f"n = {n}" for n in sizes]
    seconds, ratios, apart = [], [], []
    for peer in everybody:
        by_size = {n: times[peer.name].get(n) for n in sizes}
        seconds.append([peer.name, *(with_noise(t) if t else "–" for t in by_size.values())])
        factors = (f"{median(t) / median(ours[n]):.0f}" if t else "–" for n, t in by_size.items())
        ratios.append([peer.name, *factors])
        if peer.same:
            found = deviations[peer.name]
            apart.append([peer.name, *(f"{found[n]:.0e}" if n in found else "–" for n in sizes)])
    packages = sorted({package for peer in everybody for package in peer.packages})
    versions = ", ".join(f"{package} {version(package)}" for package in packages)
    works = "".join(f"- **{peer.name}**: {peer.work}.\n" for peer in everybody)
    deviation = rows(["largest deviation [rad]", *head], apart[1:])
    return f"""\
Medians of {REPETITIONS} interleaved repetitions, ± half of the distance from the least to the most. One
thread each; {os.cpu_count()} cores, {platform.machine()}.

{rows(["one step of the closed loop", *head], seconds)}
{rows(["multiple of ours", *head], ratios[1:])}
{works}
Whoever does our work has to make our trajectory before it is timed: every joint within
{FEW[1]:.0e} rad over {FEW[0]} steps up to 100 links, within {MANY[1]:.0e} rad over {MANY[0]} steps beyond,
where the inertia matrix is so ill-conditioned that rounding alone drives two solutions apart.

{deviation}
{versions}; Python {platform.python_version()}.
"""


def with_noise(seconds: list[float]) -> str:
    """A median with half the range around it, in per cent."""
    middle = median(seconds)
    return f"{readable(middle)} ± {50 * (max(seconds) - min(seconds)) / middle:.0f} %"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="three sizes, nothing written")
    quick = parser.parse_args().quick
    everybody = peers.load()
    sizes = QUICK if quick else SIZES
    start = perf_counter()
    print("the same trajectory?")
    deviations = {p.name: {n: check(p, n) for n in sizes if n <= p.largest} for p in everybody if p.same}
    print("how fast?")
    times = measure(everybody, sizes)
    text = report(everybody, times, deviations)
    print(text)
    if not quick:
        write_section(peers.ROOT / "docs" / "speed.md", "peers", text)
        draw(everybody, times, peers.ROOT / "docs" / "figures" / "peers.png")
    print(f"{perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
