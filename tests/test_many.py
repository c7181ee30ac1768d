"""`simulate_many`: the results of `simulate`, in order, whatever happens to one of them."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, InputTypeError, ScenarioError, ScenarioWarning
from waiting import HANG

SHORT = {"duration": 0.2}
GAINS = [{"controller.field.gain": gain, **SHORT} for gain in (0.0, 0.2, 0.4, 0.6, 0.8)]


def assert_same(one: vff.Result, other: vff.Result) -> None:
    """Every bit, but for the time that it took."""
    assert (one.status, one.message, one.end_time) == (other.status, other.message, other.end_time)
    assert one.scenario == other.scenario and dict(one.metrics) == dict(other.metrics)
    mine, others = {"t": one.t, **one.recorded()}, {"t": other.t, **other.recorded()}
    assert list(mine) == list(others)
    for name, a in mine.items():
        assert a.shape == others[name].shape and a.tobytes() == others[name].tobytes(), name


def test_the_same_as_one_by_one() -> None:
    """Order and bits, for everything that `simulate` takes, of one task dimension or the other."""
    pose = vff.Scenario.load("sweep-through").replace(
        **{"controller.task": "pose", "reference": {"kind": "setpoint", "point": [4.9, 1.0, -0.8]}}
    )
    mixed = ["paper-1", vff.Scenario.load("crowd"), vff.Scenario.load("on-path").to_dict(), pose]
    many = vff.simulate_many(iter(mixed), SHORT)
    assert len(many) == len(mixed) and many[3].x.shape[1] == 3
    for scenario, result in zip(mixed, many, strict=True):
        assert_same(result, vff.simulate(scenario, SHORT))


def test_one_scenario_and_a_list_of_overrides() -> None:
    """A sweep: one run for each dictionary."""
    many = vff.simulate_many("sweep-through", GAINS, threads=2)
    for changes, result in zip(GAINS, many, strict=True):
        assert result.scenario["controller.field.gain"] == changes["controller.field.gain"]
        assert_same(result, vff.simulate("sweep-through", changes))


def test_nothing_to_do() -> None:
    assert vff.simulate_many([]) == [] == vff.simulate_many("paper-1", [])


def test_without_a_record() -> None:
    """Status and metrics are the same, the arrays have no rows but their columns."""
    full = vff.simulate_many("sweep-through", GAINS)
    bare = vff.simulate_many("sweep-through", GAINS, record=False)
    for with_rows, without in zip(full, bare, strict=True):
        assert dict(with_rows.metrics) == dict(without.metrics) and with_rows.status == without.status
        assert without.t.shape == (0,) and without.q.shape == (0, 6) and without.obstacles.shape == (0, 1, 2)


def test_a_result_without_a_record_can_be_kept(tmp_path: Path) -> None:
    """Saved, loaded, and as tables, with every column and no row."""
    (full,) = vff.simulate_many(["sweep-through"], SHORT)
    (bare,) = vff.simulate_many(["sweep-through"], SHORT, record=False)
    assert_same(vff.Result.load(bare.save(tmp_path / "bare.npz")), bare)
    assert list(bare.to_pandas().columns) == list(full.to_pandas().columns) and not len(bare.to_pandas())
    assert bare.to_xarray().sizes["t"] == 0 and "0 instants" in repr(bare)


def test_a_result_without_a_record_says_so_when_drawn() -> None:
    """Not an error from the depths of a figure."""
    (bare,) = vff.simulate_many(["sweep-through"], SHORT, record=False)
    with pytest.raises(InputError, match="no recorded instant to draw"):
        bare.plot()


def test_one_that_diverges_leaves_the_others_alone() -> None:
    """A gain far too stiff for the step, between two that are fine."""
    stiff = {"controller.stiffness": 1e9, "controller.damping": 1e6, "reference.point": [4.5, 1.2], **SHORT}
    with pytest.warns(ScenarioWarning, match=r"overrides\[1\]: controller.damping"):
        results = vff.simulate_many("sweep-through", [SHORT, stiff, SHORT])
    assert [str(result.status) for result in results] == ["completed", "diverged", "completed"]
    assert_same(results[0], results[2])


@pytest.mark.parametrize(
    ("scenarios", "overrides", "message"),
    [
        (
            ["paper-1", "papr-1"],
            None,
            r"^scenarios\[1\]: no scenario called 'papr-1' \(did you mean 'paper-1'",
        ),
        (["paper-1", {"duration": 1}], None, r"^scenarios\[1\]: missing key"),
        (
            "paper-1",
            [{}, {}, {"controller.field.gain": -1}],
            r"^overrides\[2\]\.controller\.field\.gain: must be",
        ),
        ("paper-1", [{"duration.x": 1}], r"^overrides\[0\]: duration\.x: duration is a plain value"),
        (["paper-1", "paper-2"], {"q0": [0.0]}, r"^scenarios\[0\]\.q0: expected 6 values, got 1"),
    ],
)
def test_a_wrong_scenario_is_named(scenarios: Any, overrides: Any, message: str) -> None:
    """By its index, and before anything has run: the first is an hour long."""
    with pytest.raises(ScenarioError, match=message) as raised:
        vff.simulate_many(scenarios, overrides)
    assert raised.value.path.startswith(message[1:10])


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"scenarios": 3}, InputTypeError, "scenarios: expected a list of scenarios, not a int"),
        ({"scenarios": ["paper-1", 3]}, InputTypeError, r"scenarios\[1\]: scenario: expected a name"),
        ({"scenarios": "paper-1"}, InputTypeError, "overrides: one scenario needs a list"),
        ({"scenarios": "paper-1", "overrides": {}}, InputTypeError, "overrides: one scenario needs a list"),
        (
            {"scenarios": "paper-1", "overrides": [3]},
            InputTypeError,
            r"overrides\[0\]: overrides: expected a dict",
        ),
        ({"overrides": [{}, {}]}, InputTypeError, "overrides: a list of dicts needs one scenario"),
        ({"threads": 0}, InputError, "threads: must be from 1"),
        ({"threads": -1}, InputError, "threads: must be from 1"),
        ({"threads": 10**30}, InputError, "threads: must be from 1"),
        ({"threads": 1.5}, InputTypeError, "threads: expected a whole number, not a float"),
        ({"threads": True}, InputTypeError, "threads: expected a whole number, not a bool"),
        ({"record": "all"}, InputTypeError, "record: expected True or False, not a str"),
        ({"progress": 3}, InputTypeError, "progress: expected True or a callable"),
    ],
)
def test_wrong_arguments(arguments: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        vff.simulate_many(**{"scenarios": ["paper-1"], **arguments})


def test_all_records_together_have_to_fit() -> None:
    """Three records of 4 GB each, which alone would be allowed, are refused before anything is computed."""
    large = {"simulation.dt": 1e-5, "duration": 80.0}
    with pytest.raises(InputError, match=r"3 records take up to .* GB together, more than the 8 GB allowed"):
        vff.simulate_many(["sweep-through"] * 3, large)
    tiny = {"simulation.record_every": 1000, "duration": 0.2, "simulation.dt": 1e-5}
    assert len(vff.simulate_many(["sweep-through"] * 3, tiny)) == 3


def test_warnings_come_once() -> None:
    """However many scenarios they concern, with the first of them."""
    odd = {"duration": 0.1005}
    with pytest.warns(ScenarioWarning) as caught:
        results = vff.simulate_many(["paper-1", "sweep-through", "sweep-through"], odd)
    assert [str(warning.message)[:25] for warning in caught] == ["scenarios[0] (and 2 more)"]
    assert all(len(result.warnings) == 1 for result in results)


def test_progress() -> None:
    """Numbers that only grow, the last of them the total; True shows a bar on stderr."""
    seen: list[tuple[int, int]] = []
    vff.simulate_many(["paper-1"] * 4, progress=lambda done, total: seen.append((done, total)))
    assert seen == sorted(seen) and seen[-1] == (4, 4) and {total for _, total in seen} == {4}


def test_a_bar_is_shown(capsys: pytest.CaptureFixture[str]) -> None:
    vff.simulate_many(["paper-1"] * 2, progress=True)
    assert "0/2" in capsys.readouterr().err  # how often it is redrawn depends on the clock


def test_a_fault_in_progress_ends_it() -> None:
    """The callback's own exception comes out, and soon: the runs would compute for minutes."""

    def fail(_done: int, _total: int) -> None:
        raise RuntimeError("mine")

    start = time.process_time()
    with pytest.raises(RuntimeError, match="mine"):
        vff.simulate_many(["paper-1"] * 2, {"duration": 1e5, "simulation.record_every": 1000}, progress=fail)
    assert time.process_time() - start < 20.0


def test_ctrl_c_leaves_what_is_finished() -> None:
    """The short ones are done, the endless one stops where it is."""
    endless = {"duration": 1e6, "simulation.record_every": 100_000}
    two = threading.Event()

    def interrupt() -> None:
        two.wait(HANG)
        os.kill(os.getpid(), signal.SIGINT)

    def finished(done: int, _total: int) -> None:
        if done == 2:
            two.set()

    thread = threading.Thread(target=interrupt)
    thread.start()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        results = vff.simulate_many("paper-1", [SHORT, endless, SHORT], threads=2, progress=finished)
    thread.join()
    assert [str(result.status) for result in results] == ["completed", "interrupted", "completed"]
    assert 0.0 < results[1].end_time < 1e6 and len(results[1].t) >= 1


def _in_a_child(connection: Any) -> None:
    connection.send(vff.simulate_many(["paper-1"] * 2, SHORT, threads=2)[1].q[-1])


def test_after_fork() -> None:
    """Threads do not survive a fork: a pool kept from before would wait for them for ever."""
    here = vff.simulate_many(["paper-1"] * 2, SHORT, threads=2)[1].q[-1]
    receiver, sender = multiprocessing.Pipe(duplex=False)
    child = multiprocessing.get_context("fork").Process(target=_in_a_child, args=(sender,))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of any fork beside threads
        child.start()
    assert receiver.poll(HANG), "the forked process hangs"
    assert np.array_equal(receiver.recv(), here)
    child.join(HANG)
    assert child.exitcode == 0


def test_other_threads_of_python_go_on() -> None:
    """The GIL is released: a thread that counts gets to its end while runs without end go on."""
    code = (
        "import os, threading, time, vffnull as vff\n"
        "endless = {'duration': 1e6, 'simulation.record_every': 100_000}\n"
        "begun = threading.Event()\n"
        "told = {'progress': lambda done, total: begun.set()}\n"
        "worker = threading.Thread(target=vff.simulate_many, args=(['paper-1'] * 8, endless), kwargs=told)\n"
        "worker.start(); begun.wait()\n"
        "for _ in range(100): time.sleep(0.001)\n"
        "print(worker.is_alive(), flush=True); os._exit(0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert done.stdout.strip() == "True", done.stderr


def test_metrics_table() -> None:
    """One row per run, one column per metric, what was varied in front; NaN where there is none."""
    results = vff.simulate_many("sweep-through", GAINS, record=False)
    table = vff.metrics_table(results, ["controller.field.gain", "q0"])
    assert list(table)[:5] == ["controller.field.gain", "q0", "status", "end_time", "wall_time"]
    assert set(vff._core.METRICS) <= set(table) and {len(column) for column in table.values()} == {5}
    assert table["controller.field.gain"].tolist() == [0.0, 0.2, 0.4, 0.6, 0.8]
    assert table["q0"][2] == results[2].scenario["q0"]
    assert table["min_clearance"].tolist() == [result.metrics.min_clearance for result in results]
    assert np.isnan(table["collision_time"].astype(float)).all()
    import pandas

    assert pandas.DataFrame(table).loc[3, "status"] == "completed"
    with pytest.raises(ScenarioError, match=r"controller\.gain"):
        vff.metrics_table(results, ["controller.gain"])
    with pytest.raises(InputTypeError, match="keys"):
        vff.metrics_table(results, "q0")
    with pytest.raises(InputTypeError, match=r"results\[0\]"):
        vff.metrics_table(["paper-1"])  # type: ignore[list-item]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits the memory of a process")
def test_runs_that_see_are_prepared_when_their_turn_comes() -> None:
    """Twenty runs with readings of a quarter of a gigabyte each, in a process that may take three."""
    code = """
import resource, warnings, vffnull as vff
warnings.simplefilter("ignore")
resource.setrlimit(resource.RLIMIT_AS, (int(3e9), int(3e9)))
slow = {"perception.kind": "range", "perception.rays": 60, "perception.latency": 1.0, "duration": 0.002}
done = vff.simulate_many("panda-sweep", [slow] * 20, record=False, threads=2)
print(len(done), {each.status.value for each in done})
"""
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert said.stdout.startswith("20 {'completed'}"), said.stderr
