"""What is written is there whole or not at all, and what is read is held against what a result is."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull._support.files import read_text, replacing
from vffnull.errors import InputError
from vffnull.logs import header
from vffnull.model import record as _record
from vffnull.model.record import recorded
from vffnull.run.evaluate import identity, scores
from waiting import HANG, processor_time

LOSSLESS = (".npz", ".csv", ".arrow", ".parquet")


# ------------------------------------------------------------------------------------------------- writing


def evaluation() -> vff.Evaluation:
    """One row, without running anything."""
    scene = vff.scenes.random("crowd", 4, 0)
    row = scores(
        status="completed", t=np.zeros(1), error=np.zeros(1), span=None, min_clearance=1.0, max_error=0.0,
        effort=1.0, rms_jerk=1.0, end_time=8.0,
    )  # fmt: skip
    return vff.Evaluation.of([{**identity(scene, "with tip", "cbf"), **row}], ("cbf",))


WRITERS: dict[str, Callable[[vff.Result, Path], object]] = {
    "scenario.toml": lambda result, path: result.scenario.save(path),
    "run.npz": lambda result, path: result.save(path),
    "run.csv": lambda result, path: result.save(path),
    "run.arrow": lambda result, path: result.save(path),
    "run.parquet": lambda result, path: result.save(path),
    "run.mcap": lambda result, path: result.save(path),
    "rows.csv": lambda result, path: evaluation().save(path),
    "rows.parquet": lambda result, path: evaluation().save(path),
}


@pytest.fixture(params=WRITERS)
def writer(request: pytest.FixtureRequest, short: vff.Result) -> tuple[str, Callable[[Path], object]]:
    return request.param, lambda path: WRITERS[request.param](short, path)


def test_a_full_disk_keeps_the_old_file(
    writer: tuple[str, Callable[[Path], object]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The draft is written, and the disk is full before it is complete: the old file stays, and no draft."""
    name, write = writer
    target = tmp_path / name
    target.write_bytes(b"the old file")

    def full(draft: Path, _target: object) -> Path:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(draft))

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OSError, match=name) as caught:
        write(target)
    assert caught.value.errno == errno.ENOSPC and caught.value.filename == str(target)
    assert target.read_bytes() == b"the old file"
    assert [each.name for each in tmp_path.iterdir()] == [name]


def test_a_link_stays_a_link_and_permissions_stay(
    writer: tuple[str, Callable[[Path], object]], tmp_path: Path
) -> None:
    name, write = writer
    behind = tmp_path / "elsewhere" / f"real-{name}"
    behind.parent.mkdir()
    behind.write_bytes(b"old")
    behind.chmod(0o640)
    (tmp_path / name).symlink_to(behind)
    write(tmp_path / name)
    assert (tmp_path / name).is_symlink() and behind.stat().st_size > 20
    assert behind.stat().st_mode & 0o777 == 0o640
    assert [each.name for each in behind.parent.iterdir()] == [behind.name]


def test_names_of_any_length(writer: tuple[str, Callable[[Path], object]], tmp_path: Path) -> None:
    """Up to the file system's limit, and beyond it an error that names the path."""
    ending = Path(writer[0]).suffix
    longest = os.pathconf(tmp_path, "PC_NAME_MAX")
    path = tmp_path / f"{'x' * (longest - len(ending))}{ending}"
    writer[1](path)
    assert path.stat().st_size > 20
    with pytest.raises(OSError, match="xxx") as caught:
        writer[1](tmp_path / f"y{path.name}")
    assert caught.value.errno == errno.ENAMETOOLONG
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


def test_a_draft_follows_no_link(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Even if somebody could foresee its name."""
    victim = tmp_path / "victim"
    victim.write_text("precious")
    monkeypatch.setattr(os, "urandom", lambda size: bytes(size))
    (tmp_path / f".{'00' * 8}.txt").symlink_to(victim)
    with pytest.raises(FileExistsError), replacing(tmp_path / "mine.txt") as draft:
        draft.write_text("overwritten")
    assert victim.read_text() == "precious" and not (tmp_path / "mine.txt").exists()
    assert (tmp_path / f".{'00' * 8}.txt").is_symlink()


def test_exceptions_and_interrupts_leave_nothing_behind(tmp_path: Path) -> None:
    for fault in (ValueError, KeyboardInterrupt):
        with pytest.raises(fault), replacing(tmp_path / "mine.txt") as draft:
            draft.write_text("half")
            raise fault
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_file_is_not_replaced(tmp_path: Path, short: vff.Result) -> None:
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(OSError, match="folder"):
        short.save(tmp_path / "folder.npz")
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(OSError, match="not a regular file"):
        short.scenario.save(tmp_path / "pipe.toml")
    with pytest.raises(FileNotFoundError, match="missing"):
        short.save(tmp_path / "missing" / "run.npz")


# ------------------------------------------------------------------------------------------------- reading


@pytest.fixture(scope="module")
def tiny() -> vff.Result:
    """Few rows, but of every kind of quantity: sensors, drives, limits, a tank, barriers and a governor."""
    changes = {
        "duration": 0.02,
        "arm.torque_limits": 50.0,
        "controller.self_collision": "report",
        "controller.tank": {"capacity": 1.0},
        "controller.governor": {},
        "measurement.delay": 0.002,
        "actuator.time_constant": 0.01,
        "perception": {"kind": "range", "sensors": 1, "rays": 3, "range": 2.0},
        "obstacles.0.contact": {},
    }
    return vff.simulate("sweep-through", changes)


def write(result: vff.Result, path: Path, text: str | None = None, **arrays: Any) -> Path:
    """A file as `Result.save` writes it, with another header, or with other arrays in a .npz."""
    import pyarrow
    from pyarrow import ipc, parquet

    text = header.pack(result) if text is None else text
    if path.suffix == ".npz":
        content: dict[str, Any] = {"vffnull": np.array(text), "t": result.t, **recorded(result)} | arrays
        np.savez(path, **{name: values for name, values in content.items() if values is not None})
    elif path.suffix == ".csv":
        result.save(path)
        rest = path.read_text(encoding="utf-8").partition("\n")[2]
        path.write_text(f"# vffnull {text}\n{rest}", encoding="utf-8", errors="surrogatepass")
    else:
        table = result.to_arrow().replace_schema_metadata({"vffnull": text.encode("utf-8", "surrogatepass")})
        if path.suffix == ".parquet":
            parquet.write_table(table, str(path))
        else:
            with ipc.new_file(str(path), table.schema) as file:
                file.write_table(table)
    assert pyarrow
    return path


def is_a_result(result: vff.Result) -> bool:
    """Whether everything that is made of results can rely on it."""
    n, k = len(result.scenario["q0"]), len(result.scenario.to_dict().get("obstacles", ()))
    rows = len(result.t)
    assert result.q.shape == result.tau.shape == result.force.shape == (rows, n)
    assert result.obstacles.shape == (rows, k, 2) and result.energy.shape == (rows, 3)
    assert all(array.dtype == float and len(array) == rows for array in recorded(result).values())
    assert isinstance(result.status, vff.Status) and str(result.metrics) and str(result.scenario)
    assert len(result.to_pandas()) == rows and repr(result)
    return True


def loads(path: Path) -> bool:
    """Whether a file is read; if not, our error has to name it, whatever is wrong."""
    try:
        return is_a_result(vff.Result.load(path))
    except InputError as error:
        assert path.name in str(error) and len(str(error)) < 1000
        return False


@pytest.mark.parametrize("ending", LOSSLESS)
def test_a_sound_file_is_read(ending: str, tiny: vff.Result, tmp_path: Path) -> None:
    assert len(recorded(tiny)) > 20
    assert loads(tiny.save(tmp_path / f"run{ending}")) and loads(write(tiny, tmp_path / f"again{ending}"))


def mutants(content: bytes, count: int, seed: int) -> Iterator[bytes]:
    """Truncated, overwritten, shortened, lengthened and shuffled copies."""
    draw = random.Random(seed)
    for _ in range(count):
        data = bytearray(content)
        for _ in range(draw.choice((1, 1, 1, 2, 8))):
            at = draw.randrange(len(data))
            match draw.randrange(7):
                case 0:
                    del data[max(at, 1) :]
                case 1:
                    data[at] ^= 1 << draw.randrange(8)
                case 2:
                    data[at : at + 8] = draw.randbytes(8)
                case 3:
                    data[at : at + 4] = draw.choice((b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\xff\xff\xff\xff"))
                case 4:
                    del data[at : at + draw.randrange(1, 200)]
                case 5:
                    data[at:at] = data[at : at + draw.randrange(1, 200)]
                case 6:
                    data[at:at] = draw.choice((b"\n", b",", b"nan", b"-", b'"', b"1e999", b"\xff", b"{"))
        yield bytes(data)


@pytest.mark.parametrize("ending", LOSSLESS)
@pytest.mark.parametrize("seed", range(3))
def test_mutated_files(ending: str, seed: int, tiny: vff.Result, tmp_path: Path) -> None:
    """Every mutant is either refused by an error of ours that names it, or a result in itself."""
    content = tiny.save(tmp_path / f"run{ending}").read_bytes()
    path = tmp_path / f"mutant{ending}"
    refused = 0
    for mutant in mutants(content, 60, seed):
        path.write_bytes(mutant)
        refused += not loads(path)
    assert refused > 10


STRANGE: tuple[Any, ...] = (
    None, True, -1, 0, 3, 10**8, 2**70, 10**400, 1e308, "", "x", "\ud800", [], [1], {}, {"q0": 1}, [[]],
    [{}], {"x": [1, 2]},
)  # fmt: skip


def places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The path of every entry of a JSON document."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, inner in pairs:
        yield (*path, key)
        yield from places(inner, (*path, key))


def changed(document: Any, path: tuple[Any, ...], value: Any, delete: bool = False) -> Any:
    copied = json.loads(json.dumps(document))
    inside = copied
    for key in path[:-1]:
        inside = inside[key]
    if delete:
        del inside[path[-1]]
    else:
        inside[path[-1]] = value
    return copied


def test_hostile_headers(tiny: vff.Result) -> None:
    """Every entry missing, or of another type, size or kind; a sample with a fixed seed."""
    original = json.loads(header.pack(tiny))
    source = Path("run.npz")

    def refused(document: Any) -> bool:
        try:
            found = header.unpack(json.dumps(document), source)
            arrays = {"t": tiny.t, **recorded(tiny)}
            return not is_a_result(header.restore(vff.Result, found, arrays, source))
        except InputError as error:
            assert str(error).startswith("run.npz: ") and len(str(error)) < 1000
            return True

    assert not refused(original)
    outer = [place for place in places(original) if place[0] != "scenario" or len(place) < 3]
    outer = [place for place in outer if place[0] != "units"]  # for others: ours knows them
    cases = [(place, value) for place in outer for value in STRANGE]
    sample = random.Random(7).sample(cases, 400)
    assert sum(refused(changed(original, place, value)) for place, value in sample) > 300
    for place in outer:
        refused(changed(original, place, None, delete=True))


@pytest.mark.parametrize("ending", LOSSLESS)
@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", '"x"', "[" * 100_000, '{"format": 2}', "\ud800", "1"]
)
def test_headers_that_are_none(ending: str, text: str, tiny: vff.Result, tmp_path: Path) -> None:
    assert not loads(write(tiny, tmp_path / f"run{ending}", text))


@pytest.mark.parametrize("ending", LOSSLESS)
@pytest.mark.parametrize("shape", [[10**8], [2**40], [6, 10**8], [0], [-6], [5], [6, 1], []])
def test_a_header_that_claims_other_shapes_costs_nothing(
    ending: str, shape: list[int], tiny: vff.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is refused before a column is named or a number allocated."""
    original = json.loads(header.pack(tiny))
    path = write(tiny, tmp_path / f"run{ending}", json.dumps(changed(original, ("arrays", "q", 1), shape)))
    monkeypatch.setattr(_record.Layout, "columns", lambda _, name, shape: pytest.fail(f"{name} {shape}"))
    with pytest.raises(InputError, match=r"arrays\.q"):
        vff.Result.load(path)


def test_arrays_that_are_not_those_of_a_result(tiny: vff.Result, tmp_path: Path) -> None:
    """Shorter than the time, text, another type, missing, unknown, unordered: refused when it is read."""
    for arrays, why in [
        ({"q": tiny.q[:-1]}, "q: expected"),
        ({"q": np.full(tiny.q.shape, "x")}, "q: expected"),
        ({"q": tiny.q.astype(np.float32)}, "q: expected"),
        ({"q": None}, "q is missing"),
        ({"t": tiny.t[::-1].copy()}, "t: times"),
        ({"t": np.full_like(tiny.t, np.nan)}, "t: times"),
        ({"t": tiny.t[:, None]}, "t: expected"),
        ({"other": tiny.t}, "no quantity 'other'"),
        ({"tank": None}, "its header does not list"),
    ]:
        path = write(tiny, tmp_path / "run.npz", **arrays)
        with pytest.raises(InputError, match=f"run.npz: .*{why}"):
            vff.Result.load(path)


def test_archives_that_unpack_to_more_than_they_are(tiny: vff.Result, tmp_path: Path) -> None:
    """Neither a compressed archive nor an array that claims to be larger than the file is unpacked."""
    import io
    import zipfile

    path = tmp_path / "run.npz"
    np.savez_compressed(path, vffnull=np.array(header.pack(tiny)), t=tiny.t, q=np.zeros((10**6, 6)))
    with pytest.raises(InputError, match=r"run\.npz"):
        vff.Result.load(path)
    write(tiny, path)
    claim = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        claim, {"descr": "<f8", "fortran_order": False, "shape": (10**9, 10**3)}
    )
    with zipfile.ZipFile(path) as old:
        members = {each.filename: old.read(each) for each in old.infolist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, content in (members | {"q.npy": claim.getvalue()}).items():
            new.writestr(name, content)
    with pytest.raises(InputError, match=r"run\.npz"):
        vff.Result.load(path)


def test_nothing_is_unpickled(tiny: vff.Result, tmp_path: Path) -> None:
    class Bomb:
        def __reduce__(self) -> tuple[Any, ...]:
            return pytest.fail, ("unpickled",)

    path = write(tiny, tmp_path / "run.npz", q=np.array([Bomb()] * len(tiny.t), dtype=object))
    assert not loads(path)


ENDLESS = """
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))  # rather than the memory of the machine
import vffnull as vff
from vffnull.run.recording import read_cameras
from vffnull.cli import main
texts = (vff.Scenario.load, vff.Study.load, read_cameras, vff.arms.read_urdf, vff.Body.from_bvh)
for read, path in (*((each, "endless.toml") for each in texts), (vff.Result.load, "endless.csv")):
    try:
        read(Path(path))
    except (vff.errors.InputError, vff.errors.ScenarioError) as error:
        print(error)
sys.argv = ["vffnull", "validate", "endless.toml"]
main()
"""


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no /dev/zero")
def test_a_text_without_end_is_refused(tmp_path: Path) -> None:
    """Whatever reads it, and though the system says that it has no length; a command ends with code 2."""
    for ending in ("toml", "csv"):
        (tmp_path / f"endless.{ending}").symlink_to("/dev/zero")
    command = [sys.executable, "-c", ENDLESS]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=HANG, check=False)
    told = "endless.toml has too many bytes; at most {} are read".format
    assert done.stdout.splitlines() == [
        *[told(1 << 28)] * 3, told(16 << 20), told(200_000_000),
        "endless.csv: not a result that vffnull has saved",
    ]  # fmt: skip
    assert (done.returncode, done.stderr) == (2, f"{told(1 << 28)}\n")
    (tmp_path / "short.txt").write_bytes("ä\r\nö".encode())
    assert read_text(tmp_path / "short.txt", 6) == "ä\nö"
    with pytest.raises(InputError, match="has 6 bytes; at most 5 are read"):
        read_text(tmp_path / "short.txt", 5)


def test_paths_that_are_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="path"):
        vff.Result.load("a\0b.npz")
    with pytest.raises(FileNotFoundError):
        vff.Result.load(tmp_path / "missing.npz")
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(IsADirectoryError):
        vff.Result.load(tmp_path / "folder.csv")


LONG = ["--set", "simulation.record_every=1000", "--set", "duration=100000"]


def terminated(
    folder: Path, *words: str, when: Callable[[int], bool], by: int = signal.SIGTERM
) -> tuple[int, str]:
    """Exit code and stderr of a command that is ended by a signal as soon as something is so."""
    process = subprocess.Popen(
        [sys.executable, "-m", "vffnull", *words],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    end = time.monotonic() + HANG
    while not when(process.pid):
        assert process.poll() is None and time.monotonic() < end, "it was over before"
        time.sleep(0.0005)
    process.send_signal(by)
    _, told = process.communicate(timeout=HANG)
    return process.returncode, told


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
@pytest.mark.parametrize(
    "words", [["run", "paper-1", "--save", "run.npz"], ["report", "paper-1", "run.html"]]
)
def test_a_run_that_is_terminated(words: list[str], tmp_path: Path) -> None:
    """In the midst of the simulation: 143, no traceback, no draft; `run` keeps what there is."""
    code, told = terminated(tmp_path, *words, *LONG, when=lambda pid: processor_time(pid) > 2.0)
    assert code == 143 and "Traceback" not in told, told
    left = {each.name for each in tmp_path.iterdir()}
    assert left <= {words[-1]}, left
    if left and words[0] == "run":
        assert vff.Result.load(tmp_path / "run.npz").status == "interrupted"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
def test_a_terminal_that_is_closed_loses_nothing(tmp_path: Path) -> None:
    """The run ends as by Ctrl-C, and what there is of it is kept."""
    words = ["run", "paper-1", "--save", "run.npz", *LONG]
    code, told = terminated(tmp_path, *words, when=lambda pid: processor_time(pid) > 2.0, by=signal.SIGHUP)
    assert code == 129 and "Traceback" not in told, told
    assert vff.Result.load(tmp_path / "run.npz").status == "interrupted"


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
@pytest.mark.parametrize(("by", "expected"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
@pytest.mark.parametrize(
    "words",
    [["report", "long.toml", "old.html"], ["animate", "long.toml", "old.gif"],
     ["compare", "long.toml", "paper-1", "old.html"]],
    ids=lambda words: words[0],
)  # fmt: skip
def test_nothing_is_made_of_half_a_run(words: list[str], by: int, expected: int, tmp_path: Path) -> None:
    """Ended in the midst of its simulation, a page or a film is not made, and an earlier one stays."""
    long = vff.Scenario.load("paper-1").replace(duration=1e6, **{"simulation.record_every": 1000})
    long.save(tmp_path / "long.toml")
    (tmp_path / words[-1]).write_text("what was there")
    code, told = terminated(tmp_path, *words, when=lambda pid: processor_time(pid) > 2.0, by=by)
    assert (code, told.strip()) == (expected, "")
    assert {each.name for each in tmp_path.iterdir()} == {"long.toml", words[-1]}
    assert (tmp_path / words[-1]).read_text() == "what was there"


def test_a_signal_that_comes_with_the_draft_leaves_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the moment in which it is made, before anybody knows that it is."""
    create = os.open

    def interrupted(*arguments: Any) -> int:
        os.close(create(*arguments))
        raise SystemExit(143)

    monkeypatch.setattr(os, "open", interrupted)
    with pytest.raises(SystemExit), replacing(tmp_path / "run.csv"):
        pass
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["run", "report", "animate"])
def test_a_command_that_is_terminated_while_it_writes(kind: str, tmp_path: Path) -> None:
    """As soon as a draft is there: it goes, what stood under the name stays, and the code is 143."""
    often = ["--set", "simulation.record_every=1"]
    words, name = {
        "run": (["run", "paper-1", "--save", "run.csv", *often], "run.csv"),
        "report": (["report", "paper-1", "run.html", *often], "run.html"),
        "animate": (["animate", "paper-1", "run.gif"], "run.gif"),
    }[kind]
    if kind == "report":
        pytest.importorskip("bokeh")
    (tmp_path / name).write_text("what was there")
    code, told = terminated(tmp_path, *words, when=lambda _: any(tmp_path.glob(".*")))
    assert "Traceback" not in told, told
    assert [each.name for each in tmp_path.iterdir()] == [name]
    if kind == "report" and "</html>" in (tmp_path / name).read_text():
        assert code in (0, 143)  # its draft is put in place at once: the signal came after
    else:
        assert code == 143, told
        assert (tmp_path / name).read_text() == "what was there"
