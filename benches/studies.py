"""Measures studies: their rate beside `simulate_many`, what a block costs, and whether memory stays flat.

    python benches/studies.py                    rates, cost of a block, workers; some minutes
    python benches/studies.py --long 1000000     so many short runs, with the memory at every tenth of them

Processor time says more than the clock on a machine that does other things, too; both are printed.
"""

from __future__ import annotations

import argparse
import os
import resource
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import vffnull as vff
from vffnull.studies import Study

SPREAD = {"key": "controller.field.gain", "name": "gain", "range": [0.05, 2.0], "scale": "log"}


def document(runs: int, duration: float, block: int | None = None) -> dict[str, Any]:
    """A study of so many runs of a simulated time [s]."""
    found: dict[str, Any] = {
        "scenario": "sweep-through",
        "overrides": {"duration": duration},
        "factors": [SPREAD],
        "design": {"kind": "random", "count": runs},
    }
    return found if block is None else found | {"block": {"runs": block}}


def spent() -> float:
    """Processor time of this process and of those that it has waited for [s]."""
    own, others = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return own.ru_utime + own.ru_stime + others.ru_utime + others.ru_stime


def timed(what: Callable[[], object]) -> tuple[float, float]:
    """Clock and processor time of a call [s]."""
    clock, cpu = time.perf_counter(), spent()
    what()
    return time.perf_counter() - clock, spent() - cpu


def resident() -> float:
    """Memory of this process now [MB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def rates(runs: int, duration: float, threads: int) -> None:
    """The same runs by `simulate_many`, by a study on threads, and by workers."""
    study = Study(document(runs, duration))
    plan = study._plan
    changes = [plan.changes(run, plan.row(run)) for run in range(runs)]
    ways: dict[str, Callable[[Path], object]] = {
        "simulate_many": lambda _: vff.simulate_many("sweep-through", changes, threads=threads, record=False),
        f"study, {threads} threads": lambda place: study.run(place, threads=threads),
    }
    print(f"\n{runs} runs of {duration:g} s in {study.blocks} blocks of {plan.size}")
    print("| way | runs/s | runs per s of a processor | efficiency |\n|---|--:|--:|--:|")
    first = None
    for name, way in ways.items():
        best = None
        for _ in range(3):
            with tempfile.TemporaryDirectory() as folder:
                found = timed(lambda way=way, folder=folder: way(Path(folder) / "results"))  # type: ignore[misc]
            best = found if best is None else (min(best[0], found[0]), min(best[1], found[1]))
        assert best is not None
        first = first or best
        print(f"| {name} | {runs / best[0]:.0f} | {runs / best[1]:.0f} | {first[1] / best[1]:.3f} |")


def workers(runs: int, duration: float, counts: tuple[int, ...]) -> None:
    """Blocks on worker processes that are there already, with the memory of each."""
    import distributed

    study = Study(document(runs, duration))
    print(f"\n{runs} runs of {duration:g} s in {study.blocks} blocks, worker processes of one thread")
    print("| workers | runs/s | runs per s of a processor | memory of a worker [MB] |\n|--:|--:|--:|--:|")
    for count in counts:
        with (
            distributed.LocalCluster(
                n_workers=count, threads_per_worker=1, dashboard_address=None
            ) as cluster,
            distributed.Client(cluster) as client,
            tempfile.TemporaryDirectory() as folder,
        ):
            # Imports, and the first look at everything.
            Study(document(32, 0.01, 1)).run(Path(folder) / "first", scheduler=client)
            before = sum(client.run(time.process_time).values())
            clock, cpu = timed(lambda c=client, f=folder: study.run(Path(f) / "results", scheduler=c))  # type: ignore[misc]
            cpu += sum(client.run(time.process_time).values()) - before
            memory = client.run(resident)
        used = ", ".join(f"{each:.0f}" for each in memory.values())
        print(f"| {count} | {runs / clock:.0f} | {runs / cpu:.0f} | {used} |", flush=True)


def blocks(count: int) -> None:
    """What a block costs, whatever is in it: one run of ten steps each."""
    import distributed

    study = Study(document(count, 0.01, 1))
    plan = study._plan
    changes = [plan.changes(run, plan.row(run)) for run in range(count)]
    run, _ = timed(lambda: vff.simulate_many("sweep-through", changes, threads=1, record=False))
    with tempfile.TemporaryDirectory() as folder:
        clock, cpu = timed(lambda: study.run(Path(folder) / "results", threads=1))
        size = sum(path.stat().st_size for path in Path(folder).glob("results/runs/*")) / count
    print(
        f"\na block on threads: {1e3 * (clock - run) / count:.1f} ms, {1e3 * cpu / count:.1f} ms of "
        "a processor,"
        f" a part of one run {size / 1e3:.1f} kB"
    )
    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
        tempfile.TemporaryDirectory() as folder,
    ):
        Study(document(32, 0.01, 1)).run(Path(folder) / "first", scheduler=client)
        clock, cpu = timed(lambda: study.run(Path(folder) / "results", scheduler=client))
    print(
        f"a block by way of Dask: {1e3 * clock / count:.1f} ms, {1e3 * cpu / count:.1f} ms of them of the "
        "client"
        " and the scheduler, which share this process"
    )


def long(runs: int, duration: float) -> None:
    """Very many short runs; the memory must not grow with their number."""
    study = Study(document(runs, duration))
    told: list[tuple[int, float]] = []

    def look(done: int, total: int) -> None:
        if done >= total * (len(told) + 1) / 10:
            told.append((done, resident()))
            print(f"{done:>9} runs  {resident():6.0f} MB", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        clock, cpu = timed(lambda: study.run(Path(folder) / "results", progress=look))
        files = list(Path(folder).glob("results/runs/*"))
        size = sum(path.stat().st_size for path in files)
        again, _ = timed(lambda: study.run(Path(folder) / "results", resume=True))
    print(
        f"{runs} runs of {duration:g} s: {clock:.0f} s, {cpu:.0f} s of a processor, {len(files)} parts of"
        f" {size / len(files) / 1e6:.2f} MB, {size / runs:.0f} bytes a run; "
        f"verified in {again:.1f} s"
    )


def main() -> None:
    """What the command line asks for."""
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--long", type=int, default=0, metavar="RUNS", help="nothing but so many short runs")
    options.add_argument("--workers", action="store_true", help="nothing but worker processes")
    options.add_argument("--quick", action="store_true", help="a tenth of everything")
    given = options.parse_args()
    if given.long:
        long(given.long, 0.002)
        return
    scale = 10 if given.quick else 1
    if given.workers:
        workers(1000 // scale, 4.0, (1, 2))
        return
    rates(1000 // scale, 4.0, os.cpu_count() or 1)
    rates(10_000 // scale, 0.05, os.cpu_count() or 1)
    blocks(300 // scale)
    workers(1000 // scale, 4.0, (1, 2))


if __name__ == "__main__":
    main()
