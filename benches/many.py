"""How much faster `simulate_many` is on several threads than on one: `python benches/many.py`.

The two are timed in turns, so that whatever else the machine does meets both. Beside the wall-clock times
stand the processor seconds: where they grow with the threads, the cores share caches or a clock; where wall
times scatter and processor seconds do not, other programs were running.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import time

import vffnull as vff


def measured(scenarios: list[vff.Scenario], threads: int, record: bool) -> tuple[float, float]:
    """Wall-clock and processor seconds of one batch."""
    wall, used = time.perf_counter(), processor()
    results = vff.simulate_many(scenarios, threads=threads, record=record)
    times = time.perf_counter() - wall, processor() - used
    assert all(result.status in ("completed", "collided") for result in results)
    return times


def processor() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--threads", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--scenarios", type=int, default=64)
    parser.add_argument("--duration", type=float, default=8.0, help="of each scenario [s]")
    parser.add_argument("--repeat", type=int, default=9)
    parser.add_argument("--record", action="store_true", help="with records instead of metrics alone")
    given = parser.parse_args()
    base = vff.Scenario.load("sweep-through").replace(duration=given.duration)
    scenarios = [
        base.replace(**{"controller.field.gain": 0.2 + 0.6 * i / given.scenarios})
        for i in range(given.scenarios)
    ]
    one, many = [], []
    for _ in range(given.repeat):
        one.append(measured(scenarios, 1, given.record))
        many.append(measured(scenarios, given.threads, given.record))
    print(f"{given.scenarios} scenarios of {given.duration:g} s, {given.repeat} times in turns")
    for name, times in (("1 thread", one), (f"{given.threads} threads", many)):
        wall, used = zip(*times, strict=True)
        print(
            f"{name:>10}: {statistics.median(wall):.3f} s ({min(wall):.3f} to {max(wall):.3f}), "
            f"processor {statistics.median(used):.3f} s"
        )
    ratios = sorted(a[0] / b[0] for a, b in zip(one, many, strict=True))
    best = min(wall for wall, _ in one) / min(wall for wall, _ in many)
    print(
        f"faster by {statistics.median(ratios):.2f} (median of pairs, {ratios[0]:.2f} to {ratios[-1]:.2f}), "
        f"{best:.2f} (best of each)"
    )


if __name__ == "__main__":
    main()
