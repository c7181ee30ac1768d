"""The loop against the clock: what it counts, what it says, and how it ends. Not how fast this machine is."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, InputTypeError, ScenarioError, ScenarioWarning
from vffnull.model.timing import _rate, _readable
from vffnull.run.realtime import measure
from waiting import HANG


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vffnull", "realtime", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=HANG)


def report(**changes: Any) -> vff.RealTimeReport:
    """A report with made-up times."""
    histogram = vff.Histogram(np.array([1e-6, 2e-6, 1e-3]), np.array([90, 9, 1], dtype=np.uint64))
    values: dict[str, Any] = {
        "scenario": vff.Scenario.load("paper-1"),
        "status": vff.Status.COMPLETED,
        "rate": 500.0,
        "dt": 1e-3,
        "periods": 100,
        "missed": 0,
        "restarts": 0,
        "min_clearance": None,
        "notes": (),
        **dict.fromkeys(("latency", "step", "response", "jitter"), histogram),
    }
    return vff.RealTimeReport(**values | changes)


def test_the_clock_is_kept() -> None:
    """200 periods of 5 ms take a second, never less, and every one is in every histogram."""
    start = time.perf_counter()
    seen = vff.realtime("sweep-through", rate=200.0, seconds=1.0)
    assert time.perf_counter() - start >= 1.0
    assert (seen.periods, len(seen.step), len(seen.response), len(seen.jitter)) == (200, 200, 200, 199)
    assert seen.status == "completed" and seen.notes == () and seen.restarts == 0
    assert 0.0 < seen.step.quantile(0.5) <= seen.response.quantile(0.5)
    assert seen.missed == int(seen.response.counts[seen.response.values > 1.001 / 200.0].sum())


def test_the_loop_is_the_simulation() -> None:
    """The whole of `sweep-through` against the clock: its smallest clearance is that of `simulate`."""
    fast = {"duration": 1.0}
    seen = vff.realtime("sweep-through", rate=1000.0, seconds=1.0, overrides=fast)
    assert seen.min_clearance == vff.simulate("sweep-through", fast).metrics.min_clearance


def test_a_short_scenario_starts_over() -> None:
    seen = vff.realtime("sweep-through", rate=1000.0, seconds=0.35, overrides={"duration": 0.1})
    assert (seen.periods, seen.restarts, seen.status) == (350, 3, "completed")


def test_a_collision_is_told() -> None:
    """With the field off the disc goes through the arm; half of that way is enough."""
    away = {"controller.field.gain": 0.0, "obstacles.0.position": [1.6, 1.6]}
    with pytest.warns(ScenarioWarning, match="inside an obstacle"):
        seen = vff.realtime("sweep-through", seconds=0.1, overrides=away)
    assert seen.status == "collided" and seen.min_clearance is not None and seen.min_clearance < 0


def test_a_surface_that_is_pressed_on_is_no_collision() -> None:
    """The tip comes down on the table and leans on it; that is in the obstacle, as contact is."""
    near = {"obstacles.0.position": [0.42, 0.0, 0.45], "duration": 0.5}
    seen = vff.realtime("panda-wipe", seconds=0.4, overrides=near)
    assert seen.min_clearance is not None and seen.min_clearance < 0
    assert seen.status == "completed"


def test_what_is_changed_is_said() -> None:
    """A step that does not fit, a law that cannot be continuous on a clock."""
    with pytest.warns(ScenarioWarning) as caught:
        seen = vff.realtime("paper-1", rate=300.0, seconds=0.1)
    assert [str(warning.message).split(":")[0] for warning in caught] == [
        "simulation.dt",
        "simulation.control",
    ]
    assert seen.dt == pytest.approx(1 / 1200, rel=1e-12) and len(seen.notes) == 2


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"rate": 0}, InputError, "rate: must be from 0.1 to 1e6 Hz, got 0"),
        ({"rate": float("nan")}, InputError, "rate: must be"),
        ({"rate": "fast"}, InputTypeError, "rate: expected a number, not a str"),
        ({"seconds": 0}, InputError, "seconds: must be from one period of 0.001 s"),
        ({"seconds": float("inf")}, InputError, "seconds: must be"),
        ({"priority": 0}, InputError, "priority: must be from 1 to 99, got 0"),
        ({"priority": 100}, InputError, "priority: must be from 1 to 99"),
        ({"priority": 1.5}, InputTypeError, "priority: expected a whole number"),
        ({"core": -1}, InputError, "core: must be from 0"),
        ({"core": 9999}, InputError, "core: 9999 is not one of this machine's, "),
        ({"rate": 0.1}, ScenarioError, "duration: must be at least one control period of 10 s"),
        ({"progress": 3}, InputTypeError, "progress"),
        ({"overrides": {"duration": -1}}, ScenarioError, "duration: must be greater than 0"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        vff.realtime("sweep-through", **{"seconds": 0.01, **arguments})


@pytest.mark.skipif(sys.platform != "linux", reason="other systems pin and rank differently")
def test_priority_and_core() -> None:
    """Granted or refused, the loop runs; a refusal is said. Pinning is granted to everybody on Linux."""
    core = min(os.sched_getaffinity(0))
    found = measure(vff.Scenario.load("sweep-through"), 1000.0, 0.05, priority=10, core=core)
    assert found.periods == 50
    assert not found.notes or found.notes[0].startswith("priority: the system refused 10 (")
    assert len(os.sched_getaffinity(0)) >= 1 and os.sched_getscheduler(0) == os.SCHED_OTHER


def test_ctrl_c_ends_it_with_what_there_is() -> None:
    """Interrupted when it has reported progress three times."""
    told: list[tuple[int, int]] = []
    running = threading.Event()

    def interrupt() -> None:
        running.wait(HANG)
        os.kill(os.getpid(), signal.SIGINT)

    def progress(*counts: int) -> None:
        told.append(counts)  # type: ignore[arg-type]
        if len(told) == 3:
            running.set()

    thread = threading.Thread(target=interrupt)
    thread.start()
    seen = vff.realtime("sweep-through", seconds=6000.0, progress=progress)
    thread.join()
    assert seen.status == "interrupted" and 0 < seen.periods == len(seen.step) < 6_000_000
    assert told == sorted(told) and len(told) >= 3 and {total for _, total in told} == {6_000_000}


def test_progress() -> None:
    """Numbers that only grow, the last of them the total."""
    seen: list[tuple[int, int]] = []
    vff.realtime("sweep-through", seconds=0.5, progress=lambda *counts: seen.append(counts))
    assert seen == sorted(seen) and seen[-1] == (500, 500)


def test_quantiles() -> None:
    """90 of 1 µs, 9 of 2 µs, one of 1 ms, by hand."""
    histogram = report().step
    assert [histogram.quantile(p) for p in (0.0, 0.9, 0.91, 0.99, 0.991, 1.0)] == [
        1e-6,
        1e-6,
        2e-6,
        2e-6,
        1e-3,
        1e-3,
    ]
    assert histogram.max == 1e-3 and len(histogram) == 100
    with pytest.raises(InputError):
        histogram.quantile(1.1)
    empty = vff.Histogram(np.array([]), np.array([], dtype=np.uint64))
    assert np.isnan(empty.max) and repr(empty) == "<Histogram: empty>"


def test_the_verdict() -> None:
    """A slowest response of 1 ms leaves room up to 1 kHz; at 2 kHz it came too late."""
    assert report().verdict == (
        "500 Hz was held: all of 100 steps ended in time; the slowest ended 1 ms after it was due to begin, "
        "which leaves room up to 1 kHz."
    )
    assert report(rate=2000.0, missed=1).verdict == (
        "2000 Hz was not held: 1 of 100 steps (1 %) ended late; the slowest ended 1 ms after it was due to "
        "begin, which only 1 kHz or less would have allowed."
    )
    assert report(periods=0).verdict == "Nothing was measured at 500 Hz." and not report(periods=0).held
    assert [_rate(t) for t in (1.0, 1.01e-3, 2.1e-4, 3e-6)] == ["1 Hz", "990 Hz", "4.7 kHz", "330 kHz"]
    assert [_readable(t) for t in (1.5, 2e-3, 3.21e-6, 4e-9)] == ["1.5 s", "2 ms", "3.21 µs", "4 ns"]


def test_figure(tmp_path: Path) -> None:
    """Drawn with times of zero, too; a wrong ending is refused by name."""
    zero = vff.Histogram(np.array([0.0, 1e-3]), np.array([3, 1], dtype=np.uint64))
    path = report(latency=zero).plot(tmp_path / "timing.png")
    assert isinstance(path, Path) and path.stat().st_size > 10_000
    assert len(report().plot().axes) == 3  # type: ignore[union-attr]
    with pytest.raises(InputError, match=r"a figure is written as \.png"):
        report().plot(tmp_path / "timing.txt")


def test_command(tmp_path: Path) -> None:
    """Table and sentence, figure, JSON, exit codes."""
    done = run("sweep-through", "--rate", "500", "--seconds", "0.2", "--plot", str(tmp_path / "a" / "t.png"))
    assert done.returncode == 0, done.stderr
    assert "100 periods at 500 Hz, completed" in done.stdout and " Hz was " in done.stdout
    assert (tmp_path / "a" / "t.png").is_file()
    done = run("sweep-through", "--seconds", "0.1", "--json", "--set", "duration=0.05")
    found = json.loads(done.stdout)
    assert (found["periods"], found["restarts"], found["status"]) == (100, 1, "completed")
    assert set(found["step"]) == {"p50", "p99", "p999", "max"} and " Hz was " in found["verdict"]
    assert run("sweep-through", "--rate", "-1").returncode == 2
    assert "a figure is written as" in run("sweep-through", "--plot", "x.txt").stderr
    # A million periods a second cannot be held by steps that take longer than that.
    assert run("sweep-through", "--rate", "1e6", "--seconds", "0.01", "--strict").returncode == 3
