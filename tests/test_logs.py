"""Results in files and tables: nothing is lost on the way, and other people's tools find names and units."""

from __future__ import annotations

import dataclasses
import inspect
import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull.errors import InputError, InputTypeError
from vffnull.model.record import QUANTITIES, Quantity, recorded
from vffnull.run.result import Metrics
from waiting import HANG, wait_for

LOSSLESS = (".npz", ".parquet", ".arrow", ".csv")


def awkward() -> vff.Result:
    """A result with everything that careless formats lose.

    Infinities, NaN, −0, a subnormal number, the last bit, an array without columns, a metric that is None,
    and a text with a comma, quotes and a line break.
    """
    result = vff.simulate("paper-1", {"obstacles": None, "duration": 0.02, "description": 'a, "b"\nµ'})
    result.q[0] = [-0.0, 5e-324, 1 / 3, np.nextafter(1.0, 2.0), 1e308, -np.inf]
    result.q[1, 0] = np.nan
    assert np.isinf(result.clearance).all() and result.metrics["min_clearance"] is None
    return result


def assert_same(again: vff.Result, result: vff.Result) -> None:
    assert set(recorded(again)) == set(recorded(result))
    for name, values in {"t": result.t, **recorded(result)}.items():
        there = getattr(again, name)
        assert (there.dtype, there.shape) == (values.dtype, values.shape), name
        assert there.tobytes() == values.tobytes(), name
    for field in dataclasses.fields(result):
        if field.name not in ("t", *QUANTITIES, "metrics"):
            assert getattr(again, field.name) == getattr(result, field.name), field.name
    assert dict(again.metrics) == dict(result.metrics)


# ---------------------------------------------------------------------------------------------- round trips


@pytest.mark.parametrize("ending", LOSSLESS)
@pytest.mark.parametrize("make", [awkward, lambda: vff.simulate("crowd", {"duration": 0.05})])
def test_files_keep_every_bit(make: Any, ending: str, tmp_path: Path) -> None:
    result = dataclasses.replace(make(), plant="mujoco")
    path = result.save(tmp_path / f"run{ending}")
    assert [each.name for each in tmp_path.iterdir()] == [f"run{ending}"]  # no draft is left behind
    again = vff.Result.load(path)
    assert_same(again, result)
    assert again.version == vff.__version__ and isinstance(again.warnings, tuple)
    rerun = vff.simulate(again.scenario)  # the file is enough to repeat the run
    assert rerun.tau.tobytes() == vff.simulate(result.scenario).tau.tobytes()


def test_arrow_tables_keep_every_bit() -> None:
    result = awkward()
    assert_same(vff.Result.from_arrow(result.to_arrow()), result)


def test_a_result_is_a_table_to_libraries_that_speak_arrow(short: vff.Result) -> None:
    import pyarrow

    assert pyarrow.table(short).equals(short.to_arrow())


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Longer(vff.Result):
    """A result with quantities that do not always apply, over a dimension of their own."""

    blame: NDArray[np.float64] | None = None
    height: NDArray[np.float64] | None = None


@pytest.mark.parametrize("ending", LOSSLESS)
def test_quantities_that_do_not_apply(ending: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is recorded is read from one table; None stays None, also in tables and on pages."""
    monkeypatch.setitem(QUANTITIES, "blame", Quantity("N", "blame", ("kind",)))  # type: ignore[arg-type]
    monkeypatch.setitem(QUANTITIES, "height", Quantity("m", "height", ()))
    plain = vff.simulate("sweep-through", {"duration": 0.05})
    own = {field.name: getattr(plain, field.name) for field in dataclasses.fields(vff.Result)}
    for blame, height in [(None, None), (np.random.default_rng(1).normal(size=(51, 5)), plain.t**2)]:
        result = Longer(**own, blame=blame, height=height)
        again = Longer.load(result.save(tmp_path / f"run{ending}"))
        assert_same(again, result)
        assert (again.blame is None) == (blame is None)
        assert ("blame_4" in result.to_pandas()) == (blame is not None)
        assert ("height" in result.to_pandas()) == (height is not None)
        assert ("blame" in result.to_xarray()) == (blame is not None)
        result.save(tmp_path / "run.mcap")
        result.animate(tmp_path / "run.gif", fps=10)
        result.report(tmp_path / "run.html")
        assert ("blame_4" in (tmp_path / "run.html").read_text()) == (blame is not None)


@pytest.mark.parametrize("ending", LOSSLESS)
@pytest.mark.parametrize("content", [b"", b"something else\n1,2,3\n", b"# vffnull {}\n", b"PAR1", b"ARROW1"])
def test_other_peoples_files(ending: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"bad{ending}"
    path.write_bytes(content)
    with pytest.raises(InputError, match="bad"):
        vff.Result.load(path)


@pytest.mark.parametrize("ending", LOSSLESS)
def test_cut_files(ending: str, short: vff.Result, tmp_path: Path) -> None:
    path = short.save(tmp_path / f"run{ending}")
    path.write_bytes(path.read_bytes()[:-1000])
    if ending == ".csv":  # the worst place: exactly between two lines
        path.write_bytes(path.read_bytes().rpartition(b"\n")[0] + b"\n")
    with pytest.raises(InputError, match="run"):
        vff.Result.load(path)


@pytest.mark.parametrize("ending", LOSSLESS)
def test_damaged_files(ending: str, short: vff.Result, tmp_path: Path) -> None:
    """One wrong bit, anywhere, gives no other result."""
    path, random = short.save(tmp_path / f"run{ending}"), np.random.default_rng(3)
    whole = path.read_bytes()
    for at in random.integers(len(whole), size=60):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        try:
            again = vff.Result.load(path)
        except InputError as error:
            assert str(path) in str(error)
        else:
            assert_same(again, short)


def test_files_of_older_versions_have_no_digest(short: vff.Result, tmp_path: Path) -> None:
    path = short.save(tmp_path / "run.csv")
    text = path.read_text(encoding="utf-8")
    older = re.sub(r', "digest": "\w{16}"', "", text, count=1)
    assert older != text
    path.write_text(older, encoding="utf-8")
    assert_same(vff.Result.load(path), short)
    path.write_text(text.replace('"wall_time": ', '"wall_time": 1'), encoding="utf-8")
    with pytest.raises(InputError, match=r"run\.csv: damaged: its digest is not that of what it holds"):
        vff.Result.load(path)


def test_tables_without_our_header() -> None:
    import pyarrow

    with pytest.raises(InputError, match="not a result"):
        vff.Result.from_arrow(pyarrow.table({"t": [0.0]}))


# ------------------------------------------------------------------------------------------------- contents


def test_parquet_is_for_other_peoples_tools(paper_1: vff.Result, tmp_path: Path) -> None:
    """Names, units and meanings per column; zstd over split bytes, half of the raw size or nearly so."""
    from pyarrow import parquet

    path = paper_1.save(tmp_path / "run.parquet")
    schema = parquet.read_schema(path)
    assert schema.names == ["t", *paper_1.to_pandas().columns]
    assert schema.field("tau_3").metadata == {b"unit": b"N\xc2\xb7m", b"long_name": b"joint torque 3"}
    header = json.loads(schema.metadata[b"vffnull"])
    assert header["version"] == vff.__version__ and header["status"] == "completed"
    assert vff.Scenario.from_dict(header["scenario"]) == paper_1.scenario
    column = parquet.ParquetFile(path).metadata.row_group(0).column(1)
    assert column.compression == "ZSTD" and "BYTE_STREAM_SPLIT" in column.encodings
    assert path.stat().st_size < 0.6 * paper_1.save(tmp_path / "run.npz").stat().st_size


def test_csv_is_for_eyes_and_spreadsheets(short: vff.Result, tmp_path: Path) -> None:
    import pandas

    path = short.save(tmp_path / "run.csv")
    lines = path.read_text(encoding="utf-8").splitlines()
    assert lines[1].split(",")[1] == "rad" and len(lines) == 3 + len(short.t)
    table = pandas.read_csv(path, comment="#", index_col="t")
    pandas.testing.assert_frame_equal(table, short.to_pandas(), rtol=1e-14, atol=1e-300)


def test_mcap_holds_one_message_per_instant(tmp_path: Path) -> None:
    """JSON with a schema, simulated time in nanoseconds, the scenario as an attachment."""
    from mcap.reader import make_reader

    result = awkward()
    with result.save(tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        messages = list(reader.iter_messages())
        assert len(messages) == len(result.t)
        schema, channel, message = messages[7]
        assert schema is not None and (channel.topic, schema.encoding) == ("/vffnull", "jsonschema")
        properties = json.loads(schema.data)["properties"]
        assert set(properties) == {"t", *recorded(result)} and "N·m" in properties["tau"]["description"]
        assert message.log_time == 7_000_000
        content = json.loads(message.data)
        assert content["tau"] == result.tau[7].tolist() and content["clearance"] == [None] * 6
        assert [list(each.values()) for each in content["obstacles"]] == result.obstacles[7].tolist()
        attached = next(iter(reader.iter_attachments()))
        assert attached.name == "scenario.toml"
        assert vff.Scenario.from_dict(vff._core.parse_toml(attached.data.decode(), "")) == result.scenario


def test_rerun_recording(short: vff.Result, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    assert short.save(tmp_path / "run.rrd").read_bytes()[:4] in (b"RRF2", b"RRIO", b"RRF3")


def test_missing_extras_are_named() -> None:
    code = (
        "import sys\n"
        "for name in ('pyarrow', 'mcap', 'rerun', 'bokeh', 'imageio_ffmpeg'): sys.modules[name] = None\n"
        "import vffnull as vff\n"
        "run = vff.simulate('paper-1', {'duration': 0.1})\n"
        "calls = [lambda e=e: run.save('run' + e) for e in ('.parquet', '.mcap', '.rrd')]\n"
        "calls += [lambda: run.report('a.html'), lambda: run.animate('a.mp4'), run.to_arrow]\n"
        "calls += [lambda: vff.StreamRecorder('a.arrows')]\n"
        "for call in calls:\n"
        "    try: call()\n"
        "    except ImportError as error: print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    named = [line.split("vffnull[")[1].split("]")[0] for line in done.stdout.splitlines()]
    assert named == ["io", "mcap", "rerun", "report", "video", "io", "io"], done.stderr


# ------------------------------------------------------------------------------------------ while it happens


def test_stream_recorder(tmp_path: Path) -> None:
    """Every instant with its units, the same numbers as in a run from start to end."""
    scenario = vff.Scenario.load("sweep-through").replace(duration=0.2)
    simulation = vff.Simulation(scenario)
    with vff.StreamRecorder(tmp_path / "run.arrows", scenario) as recorder:
        recorder.write(simulation.state)
        while not simulation.done:
            recorder.write(simulation.step())
    table = vff.StreamRecorder.read(tmp_path / "run.arrows")
    result = vff.simulate(scenario)
    whole = result.to_arrow()
    assert {"t", "q_0", "tau_5", "x_y", "clearance_5", "obstacles_0_x"} <= set(table.column_names)
    np.testing.assert_array_equal(table["t"].to_numpy(), result.t)
    np.testing.assert_array_equal(table["q_5"].to_numpy(), result.q[:, 5])
    for name in table.column_names:
        assert table.schema.field(name).metadata == whole.schema.field(name).metadata, name
    about = json.loads(table.schema.metadata[b"vffnull"])
    assert about["version"] == vff.__version__
    assert vff.Scenario.from_dict(about["scenario"]) == scenario


def test_a_killed_recording_loses_less_than_a_second(tmp_path: Path) -> None:
    """SIGKILL gives the process no chance to write anything; yet what it recorded before is there.

    Rows reach the file on their own, every `interval`: the process writes 2000 and then does nothing. When
    they are there, it goes on writing and is killed.
    """
    assert inspect.signature(vff.StreamRecorder).parameters["interval"].default < 1.0
    code = """
import sys
import vffnull as vff
scenario = vff.Scenario.load("sweep-through")
simulation = vff.Simulation(scenario)
recorder = vff.StreamRecorder(sys.argv[1], scenario)
for _ in range(2000):
    state = simulation.step()
    recorder.write(state)
print(repr(state.t), flush=True)
sys.stdin.readline()
while True:
    recorder.write(simulation.step() if not simulation.done else simulation.state)
"""
    path = tmp_path / "run.arrows"
    command = [sys.executable, "-c", code, str(path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        assert process.stdin is not None and process.stdout is not None
        reached = float(process.stdout.readline())
        wait_for(lambda: len(vff.StreamRecorder.read(path)) >= 2000, "the writing of the rows")
        process.stdin.write("\n")
        process.stdin.flush()
        os.kill(process.pid, signal.SIGKILL)
    assert process.returncode == -signal.SIGKILL
    table = vff.StreamRecorder.read(path)
    times = table["t"].to_numpy()
    assert times[1999] == reached and len(times) >= 2000
    whole = vff.simulate("sweep-through", {"duration": 2.0})
    np.testing.assert_array_equal(table["q_0"].to_numpy()[:2000], whole.q[1:, 0])


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9, 0.999])
def test_a_cut_stream_is_read_up_to_the_cut(share: float, tmp_path: Path) -> None:
    """Whatever the place of the cut: whole batches before it are there, and nothing invented."""
    import time

    path = tmp_path / "run.arrows"
    simulation = vff.Simulation(vff.Scenario.load("sweep-through"))
    states = []
    with vff.StreamRecorder(path, interval=0.01) as recorder:
        for _ in range(300):
            states.append(simulation.step().t)
            recorder.write(simulation.state)
            time.sleep(0.0005)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    times = vff.StreamRecorder.read(path)["t"].to_numpy()
    assert 0 < len(times) < 300 and times.tolist() == states[: len(times)]


def test_stream_recorder_refuses(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.arrows"):
        vff.StreamRecorder(tmp_path / "run.npz")
    with pytest.raises(InputError, match="interval"):
        vff.StreamRecorder(tmp_path / "run.arrows", interval=0.0)
    recorder = vff.StreamRecorder(tmp_path / "run.arrows")
    recorder.close()
    recorder.close()  # as files do
    with pytest.raises(InputError, match="closed"):
        recorder.write(vff.Simulation(vff.Scenario.load("paper-1")).state)
    with pytest.raises(InputError, match="run"):
        vff.StreamRecorder.read(tmp_path / "run.arrows")  # not a row, not even a schema
    with pytest.raises(FileNotFoundError):
        vff.StreamRecorder.read(tmp_path / "missing.arrows")


def test_stream_recorder_copies(tmp_path: Path) -> None:
    """A caller may use the same array again for the next row."""
    row = SimpleNamespace(t=0.0, q=np.zeros(2))
    with vff.StreamRecorder(tmp_path / "run.arrows", interval=60.0) as recorder:
        for i in range(100):
            row.t = 0.1 * i
            row.q[:] = i
            recorder.write(row)
        row.q[:] = -1.0
    table = vff.StreamRecorder.read(recorder.path)
    np.testing.assert_array_equal(table["q_0"].to_numpy(), np.arange(100.0))


def test_stream_recorder_of_many_threads(tmp_path: Path) -> None:
    """Every row of every thread is there whole, and in the order of its thread."""

    def work(number: int) -> None:
        for i in range(500):
            recorder.write(SimpleNamespace(t=float(i), q=np.array([number, i, number + i])))

    with vff.StreamRecorder(tmp_path / "run.arrows", interval=1e-4) as recorder:
        threads = [threading.Thread(target=work, args=(number,)) for number in range(6)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    table = vff.StreamRecorder.read(recorder.path)
    number, i, both = (table[f"q_{k}"].to_numpy() for k in range(3))
    assert len(i) == 3000 and (number + i == both).all() and (table["t"].to_numpy() == i).all()
    for each in range(6):
        assert i[number == each].tolist() == list(range(500))


@pytest.mark.parametrize(
    ("odd", "error", "message"),
    [
        ({"q": np.zeros(3)}, InputError, "q: expected shape .2,. as in the first row, got shape .3,."),
        ({"q": None}, InputError, "q: .* got None"),
        ({"q": ["a", "b"]}, InputTypeError, "q: expected numbers"),
        ({"q": [[1.0], [2.0, 3.0]]}, InputTypeError, "q: expected numbers"),
        ({"t": np.nan}, InputError, "t: must be finite"),
        ({"t": None}, InputError, "t: "),
    ],
)
def test_stream_recorder_refuses_an_odd_row_alone(
    odd: dict[str, Any], error: type[Exception], message: str, tmp_path: Path
) -> None:
    """Neither the rows before it nor those after it are lost."""
    with vff.StreamRecorder(tmp_path / "run.arrows", interval=60.0) as recorder:
        for i in range(10):
            recorder.write(SimpleNamespace(t=float(i), q=[1.0, 2.0]))
            with pytest.raises(error, match=message):
                recorder.write(SimpleNamespace(**({"t": i + 0.5, "q": [1.0, 2.0]} | odd)))
    table = vff.StreamRecorder.read(recorder.path)
    assert table["t"].to_numpy().tolist() == list(range(10))


def test_stream_recorder_refuses_an_odd_first_row(tmp_path: Path) -> None:
    """Which it would take for the measure of all others."""
    with vff.StreamRecorder(tmp_path / "run.arrows") as recorder:
        for q in (1.0, np.zeros((2, 2)), [[1.0], [2.0, 3.0]], ["a"]):
            with pytest.raises((InputError, InputTypeError), match=r"q|row"):
                recorder.write(SimpleNamespace(t=0.0, q=q))
        with pytest.raises(InputError, match="x: expected"):
            recorder.write(SimpleNamespace(t=0.0, x=np.zeros(4)))
        recorder.write(SimpleNamespace(t=0.0, q=np.zeros(2)))
    assert vff.StreamRecorder.read(recorder.path).num_rows == 1


@pytest.mark.parametrize("interval", [np.inf, np.nan, 1e300, -1.0, "1", None])
def test_stream_recorder_refuses_an_interval(interval: Any, tmp_path: Path) -> None:
    with pytest.raises((InputError, InputTypeError), match="interval"):
        vff.StreamRecorder(tmp_path / "run.arrows", interval=interval)
    assert not (tmp_path / "run.arrows").exists()


def test_columns_are_named_once() -> None:
    """A table has one column for every number that is recorded at an instant."""
    result = vff.simulate("crowd", {"duration": 0.01})
    names = [
        column.name
        for name, values in recorded(result).items()
        for column in result.layout.columns(name, values.shape[1:])
    ]
    assert len(names) == len(set(names)) == sum(values[0].size for values in recorded(result).values())
    assert result.to_pandas().columns.tolist() == names
    assert isinstance(result.metrics, Metrics)
