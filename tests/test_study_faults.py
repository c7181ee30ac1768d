"""Studies whose processes are killed, whose disk is full: nothing is lost, and nothing there twice."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import vffnull as vff
from vffnull.errors import InputError
from vffnull.studies import Dataset, Study
from vffnull.studies.executors import _fault
from vffnull.studies.running import Begun, begin
from vffnull.studies.store import opened
from waiting import HANG, wait_for

pytest.importorskip("pyarrow")
distributed = pytest.importorskip("distributed")

BLOCKS = 12
DOCUMENT: dict[str, Any] = {
    "name": "killed",
    "scenario": "sweep-through",
    "overrides": {"duration": 1.0},
    "factors": [{"key": "controller.field.gain", "name": "gain", "range": [0.01, 3.0], "scale": "log"}],
    "design": {"kind": "random", "count": 16 * BLOCKS},
    "metrics": ["min_clearance", "effort"],
    "records": {"every": 100},
    "block": {"runs": 16},
}


def parts(place: Path) -> dict[str, bytes]:
    """All files of a dataset but the lock."""
    return {
        str(path.relative_to(place)): path.read_bytes()
        for path in sorted(place.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def done(place: Path) -> int:
    """How many blocks are there."""
    return len(list((place / "runs").glob("part-*.parquet")))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The dataset of a study that nobody has disturbed."""
    place = tmp_path_factory.mktemp("undisturbed") / "results"
    Study(DOCUMENT).run(place)
    found = parts(place)
    assert len(found) == 1 + 2 * BLOCKS
    return found


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the study in a file."""
    (tmp_path / "mine.toml").write_text(vff._core.format_toml(DOCUMENT), encoding="utf-8")
    return tmp_path


def client(folder: Path, *more: str, limit: int | None = None) -> subprocess.Popen[str]:
    """The command in a process of its own, in a group of its own."""

    def limited() -> None:
        if limit is not None:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    command = [
        sys.executable,
        "-m",
        "vffnull",
        "study",
        "run",
        "mine.toml",
        "--out",
        "results",
        "--quiet",
        *more,
    ]
    return subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=limited,
    )


def finished(folder: Path, undisturbed: dict[str, bytes]) -> None:
    """Resumed, the dataset is that of an undisturbed run, and no file is left over."""
    Study(DOCUMENT).run(folder / "results", resume=True)
    assert parts(folder / "results") == undisturbed


def test_a_client_that_is_killed(folder: Path, undisturbed: dict[str, bytes]) -> None:
    """At once, by a signal that nobody can answer: the lock is free, what is there is whole."""
    process = client(folder)
    wait_for(lambda: done(folder / "results") >= 2 or process.poll() is not None)
    process.kill()
    process.communicate(timeout=HANG)
    there = {name: data for name, data in parts(folder / "results").items() if not name.startswith(".drafts")}
    assert 2 <= done(folder / "results") < BLOCKS
    assert there.items() <= undisturbed.items()
    assert 0 < len(Dataset.open(folder / "results")) < 16 * BLOCKS
    finished(folder, undisturbed)


ENDLESS = DOCUMENT | {
    "factors": [{"key": "duration", "values": [0.1, 1e5]}],
    "overrides": {"controller.field.gain": 0.0},
    "records": {"every": 10**9},
    "design": {"kind": "grid"},
    "repetitions": 16,
}
"""A block that is soon over, and one that takes hours."""


@pytest.fixture
def endless(tmp_path: Path) -> Path:
    """A folder with a study that does not end."""
    (tmp_path / "mine.toml").write_text(vff._core.format_toml(ENDLESS), encoding="utf-8")
    return tmp_path


def test_ctrl_c(endless: Path) -> None:
    """Answered although the block would take hours, with a word about how to go on; what is done is there."""
    process = client(endless)
    wait_for(lambda: done(endless / "results") == 1 or process.poll() is not None)
    process.send_signal(signal.SIGINT)
    _, told = process.communicate(timeout=HANG)
    assert process.returncode == 130 and "--resume goes on" in told and "Traceback" not in told, told
    plan, store = Study(ENDLESS)._plan, opened(endless / "results")
    assert begin(plan, store, resume=True) == Begun(frozenset({0}), 0)


def test_a_client_that_is_terminated(endless: Path) -> None:
    """As by Ctrl-C: no draft is left behind, and the exit code says what it was."""
    process = client(endless)
    wait_for(lambda: (endless / "results" / "study.json").exists() or process.poll() is not None)
    process.terminate()
    _, error = process.communicate(timeout=HANG)
    assert process.returncode == 143, error
    assert "--resume" in error and "Traceback" not in error
    assert not list((endless / "results").rglob(".drafts/*"))


def test_a_full_disk(folder: Path, undisturbed: dict[str, bytes]) -> None:
    """The system refuses a part: a sentence, an exit code, and no half of anything."""
    smallest = max(len(data) for name, data in undisturbed.items() if name.startswith("runs/"))
    process = client(folder, limit=smallest - 1)
    _, told = process.communicate(timeout=HANG)
    assert process.returncode == 2 and "Traceback" not in told, told
    assert "File too large" in told and "part-" in told
    there = parts(folder / "results")
    assert there.items() <= undisturbed.items() and done(folder / "results") < BLOCKS
    finished(folder, undisturbed)


def test_a_disk_that_is_full_for_a_while(
    folder: Path, undisturbed: dict[str, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """An error that comes only when the system writes what it has taken: the fifth part is not there."""
    count, sync = 0, os.fsync

    def full(number: int) -> None:
        nonlocal count
        count += 1
        if count == 9:
            raise OSError(28, "No space left on device")
        sync(number)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as raised:
        Study(DOCUMENT).run(folder / "results")
    assert "part-" in str(raised.value.filename)
    assert parts(folder / "results").items() <= undisturbed.items()
    finished(folder, undisturbed)


def test_two_clients_on_one_directory(endless: Path) -> None:
    """The second is refused with the number of the first; killed, the first leaves the directory free."""
    first = client(endless)
    wait_for(lambda: done(endless / "results") == 1 or first.poll() is not None)
    with pytest.raises(InputError, match=f"process {first.pid} on .* is writing there"):
        Study(ENDLESS).run(endless / "results", resume=True)
    first.kill()
    first.communicate(timeout=HANG)
    with opened(endless / "results").locked("mine"):
        assert done(endless / "results") == 1


# ------------------------------------------------------------------------------------------------- clusters


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """Two workers, each a process with a nurse that starts it again."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=60
    ) as found:
        yield found


def test_a_worker_that_is_killed(cluster: Any, folder: Path, undisturbed: dict[str, bytes]) -> None:
    """In the middle of a block: another one computes it, and the dataset is that of threads, bit by bit."""
    killed: list[int] = []
    with distributed.Client(cluster) as connected:
        pids = connected.run(os.getpid)

        def kill(finished: int, _total: int) -> None:
            if killed or not finished:
                return
            busy = [worker for worker, keys in connected.processing().items() if keys]
            if busy:
                os.kill(pids[busy[0]], signal.SIGKILL)
                killed.append(pids[busy[0]])

        Study(DOCUMENT).run(folder / "results", scheduler=connected, progress=kill)
        assert killed and parts(folder / "results") == undisturbed
        assert connected.status == "running"


def test_a_block_that_ends_its_workers(cluster: Any, folder: Path, undisturbed: dict[str, bytes]) -> None:
    """Dask gives a block up that has ended too many workers; that is told, and the rest is there."""
    killed: list[int] = []
    with distributed.Client(cluster) as connected:
        pids = connected.run(os.getpid)

        def kill(finished: int, _total: int) -> None:
            busy = [worker for worker, keys in connected.processing().items() if keys and worker in pids]
            if finished and busy and not killed:
                os.kill(pids[busy[0]], signal.SIGKILL)
                killed.append(pids[busy[0]])

        allowed, cluster.scheduler.allowed_failures = cluster.scheduler.allowed_failures, 0
        try:
            with pytest.raises(ChildProcessError, match=r"block \d+ \(runs \d+ to \d+\) has ended"):
                Study(DOCUMENT).run(folder / "results", scheduler=connected, progress=kill)
        finally:
            cluster.scheduler.allowed_failures = allowed
    assert 1 <= done(folder / "results") < BLOCKS
    finished(folder, undisturbed)


def test_ctrl_c_lets_go_of_a_cluster(cluster: Any, folder: Path, undisturbed: dict[str, bytes]) -> None:
    """A client of somebody else's stays as it was, without our tasks; resumed there, it is the same again."""
    with distributed.Client(cluster) as connected:

        def stop(finished: int, _total: int) -> None:
            if finished >= 32:
                raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            Study(DOCUMENT).run(folder / "results", scheduler=connected, progress=stop)
        wait_for(lambda: not any(connected.processing().values()), "the end of our tasks")
        assert connected.submit(sum, [1, 2]).result() == 3
        assert 2 <= done(folder / "results") < BLOCKS
        Study(DOCUMENT).run(folder / "results", scheduler=connected, resume=True)
    assert parts(folder / "results") == undisturbed


def test_a_worker_that_does_not_see_the_store(cluster: Any, undisturbed: dict[str, bytes]) -> None:
    """The memory of this process: the parts come back, and are the same."""
    import fsspec

    system = fsspec.filesystem("memory")
    with distributed.Client(cluster) as connected:
        Study(DOCUMENT).run("memory://faults", scheduler=connected)
    for name, data in undisturbed.items():
        assert system.cat_file(f"/faults/{name}") == data, name
    system.rm("/faults", recursive=True)


HIDDEN = """
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == "vffnull":
            raise ModuleNotFoundError("No module named 'vffnull'", name="vffnull")
sys.meta_path.insert(0, Hidden())
"""


def test_a_cluster_that_falls_apart(
    folder: Path, undisturbed: dict[str, bytes], capfd: pytest.CaptureFixture[str]
) -> None:
    """A worker without the package is refused by name; a killed scheduler is told; no part is lost."""
    (folder / "hidden.py").write_text(HIDDEN, encoding="utf-8")
    told = folder / "scheduler.json"
    processes: list[subprocess.Popen[bytes]] = []

    def start(*words: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", "dask", *words, "--no-dashboard"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": folder}
        process = subprocess.Popen(command, **quiet)  # type: ignore[call-overload]
        processes.append(process)
        return process  # type: ignore[no-any-return]

    try:
        scheduler = start("scheduler", "--scheduler-file", str(told), "--port", "0", "--host", "127.0.0.1")
        lacking = start(
            "worker",
            "--scheduler-file",
            str(told),
            "--nthreads",
            "1",
            "--no-nanny",
            "--preload",
            str(folder / "hidden.py"),
        )
        start("worker", "--scheduler-file", str(told), "--nthreads", "1", "--no-nanny")
        with distributed.Client(scheduler_file=str(told)) as connected:
            connected.wait_for_workers(2)
            with pytest.raises(InputError, match=r"worker tcp://.*: lacks vffnull; install vffnull\[study\]"):
                Study(DOCUMENT).run(folder / "results", scheduler=connected)
            lacking.kill()
            wait_for(lambda: len(connected.nthreads()) == 1, "the end of a worker")
            address = connected.scheduler.address

        def kill(finished: int, _total: int) -> None:
            if finished:
                scheduler.kill()

        with pytest.raises(ConnectionError, match=f"the scheduler {address} is gone"):
            Study(DOCUMENT).run(folder / "results", scheduler=address, progress=kill)
        assert "Traceback" not in capfd.readouterr().err  # the error says it
    finally:
        for process in processes:
            process.kill()
            process.wait()
    assert 1 <= done(folder / "results") < BLOCKS
    finished(folder, undisturbed)


def test_workers_of_another_version() -> None:
    """What could change a bit is refused; what cannot is not."""
    mine = {"vffnull": "1.0", "numpy": "2.0", "pyarrow": "20.0", "scipy": "1.15"}
    assert _fault(mine, mine) == "" == _fault({**mine, "scipy": "1.16"}, mine)
    assert "has vffnull 0.9, and this is 1.0" in _fault({**mine, "vffnull": "0.9"}, mine)
    assert "has pyarrow 19.0" in _fault({**mine, "pyarrow": "19.0"}, mine)
    assert "lacks pyarrow" in _fault({**mine, "pyarrow": None}, mine)
