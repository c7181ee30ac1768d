"""What a run leaves behind: arrays as in the contract, files that keep every bit, tables, pictures."""

from __future__ import annotations

import json
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, VffNullError

PER_JOINT = ("q", "dq", "tau", "tau_task", "tau_null", "tau_vff", "force", "clearance")
PER_TASK = ("x", "dx", "x_ref", "error")
EVERYTHING = ("t", *PER_JOINT, *PER_TASK, "obstacles")


def pose_scenario() -> vff.Scenario:
    arm = vff.Arm.uniform(5)
    q0 = [0.4, 0.5, -0.7, 0.6, -0.3]
    return vff.Scenario(
        arm=arm,
        q0=q0,
        duration=0.05,
        controller={"task": "pose"},
        reference={"kind": "setpoint", "point": [*arm.forward_kinematics(q0)[-1], sum(q0)]},
        obstacles=[vff.Obstacle.circle([1.0, 2.0], 0.2), vff.Obstacle.box([-1.0, 0.0], [0.3, 0.2])],
    )


# -------------------------------------------------------------------------------------------------- arrays


@pytest.mark.parametrize("make", [lambda: "crowd", lambda: "sweep-through", pose_scenario])
def test_shapes(make: Any) -> None:
    """The public interface: T, n, m and k along the dimensions that it says."""
    scenario = make()
    result = vff.simulate(scenario, {"duration": 0.05})
    n, k = result.scenario.arm.n, len(result.scenario["obstacles"])
    m = 3 if callable(make) and not isinstance(scenario, str) else 2
    T = 51
    assert result.t.shape == (T,)
    assert {name: getattr(result, name).shape for name in PER_JOINT} == dict.fromkeys(PER_JOINT, (T, n))
    assert {name: getattr(result, name).shape for name in PER_TASK} == dict.fromkeys(PER_TASK, (T, m))
    assert result.obstacles.shape == (T, k, 2)


def test_without_obstacles() -> None:
    result = vff.simulate("paper-1", {"obstacles": None, "duration": 0.05})
    assert result.obstacles.shape == (51, 0, 2)
    assert np.all(np.isinf(result.clearance)) and np.all(result.force == 0)
    assert result.metrics["min_clearance"] is None
    json.dumps(dict(result.metrics))


@pytest.mark.parametrize("name", EVERYTHING)
def test_arrays_are_owned_contiguous_and_double(short: vff.Result, name: str) -> None:
    """Handed over without a copy, and yet nobody else's memory."""
    array = getattr(short, name)
    assert (
        array.dtype == np.float64
        and array.flags.c_contiguous
        and array.flags.writeable
        and array.flags.aligned
    )
    owner = array if array.base is None else array.base
    while isinstance(owner, np.ndarray) and owner.base is not None:
        owner = owner.base
    assert not np.shares_memory(array, getattr(short, "q" if name != "q" else "dq"))


def test_what_belongs_together(short: vff.Result) -> None:
    """error = x − x_ref, τ = τ_task + τ_null, t in equal steps."""
    np.testing.assert_array_equal(short.error, short.x - short.x_ref)
    np.testing.assert_array_equal(short.tau, short.tau_task + short.tau_null)
    np.testing.assert_allclose(np.diff(short.t), 0.01, rtol=0, atol=1e-15)
    arm = short.scenario.arm
    np.testing.assert_allclose(short.x, arm.forward_kinematics(short.q)[:, -1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        short.dx, [arm.jacobian(q) @ dq for q, dq in zip(short.q, short.dq, strict=True)], rtol=0, atol=1e-14
    )


@pytest.mark.parametrize("every", [1, 7, 100, 1000])
def test_record_every(every: int) -> None:
    """Every k-th step of the same run, the first one included; metrics do not depend on it."""
    whole = vff.simulate("sweep-through", {"duration": 0.5})
    some = vff.simulate("sweep-through", {"duration": 0.5, "simulation.record_every": every})
    for name in EVERYTHING:
        np.testing.assert_array_equal(getattr(some, name), getattr(whole, name)[::every], err_msg=name)
    assert dict(some.metrics) == dict(whole.metrics)
    assert some.end_time == whole.end_time == 0.5


# ------------------------------------------------------------------------------------------- status, metrics


def test_status_is_its_string(short: vff.Result) -> None:
    assert short.status == "completed" and short.status is vff.Status.COMPLETED
    assert f"{short.status}" == str(short.status) == "completed"
    assert {s.value for s in vff.Status} >= {"completed", "collided", "diverged", "interrupted"}


def test_metrics(paper_1: vff.Result) -> None:
    """Items and attributes are the same; the table shows units; every promised measure is there."""
    metrics = paper_1.metrics
    assert metrics.min_clearance == metrics["min_clearance"]
    table, _, missing = str(metrics).partition("without a value: ")
    for name, (unit, meaning) in vff._core.METRICS.items():
        if metrics[name] is None:
            assert name in missing.replace("\n", " ").split(", ")
            continue
        line = next(line for line in table.splitlines() if line.startswith(f"{name} "))
        assert unit in line and meaning in line
    assert set(vff._core.METRICS) == set(metrics)
    with pytest.raises(AttributeError, match="min_clearance"):
        _ = metrics.smallest_clearance
    with pytest.raises(KeyError):
        _ = metrics["smallest_clearance"]
    required = {
        "min_clearance",
        "intrusion_time",
        "intrusion_depth",
        "rms_error_transient",
        "max_error_transient",
        "rms_error_tail",
        "max_error_tail",
        "settling_time",
        "effort",
        "energy",
        "rms_jerk",
        "passivity_residual",
        "max_null_acceleration",
    }
    assert required <= set(metrics)


def test_metrics_against_the_record(paper_1: vff.Result) -> None:
    """Recomputed from the arrays, each by its own definition."""
    m, r, dt = paper_1.metrics, paper_1, 1e-3
    error = np.linalg.norm(r.error, axis=1)
    tail = r.t >= m["tail_start"]
    assert m["tail_start"] == pytest.approx(0.8 * 20.0)
    recomputed = {
        "min_clearance": r.clearance.min(),
        "min_clearance_time": r.t[r.clearance.min(axis=1).argmin()],
        "min_clearance_link": r.clearance.min(axis=0).argmin(),
        "rms_error_transient": np.sqrt(np.mean(error[~tail] ** 2)),
        "max_error_transient": error[~tail].max(),
        "rms_error_tail": np.sqrt(np.mean(error[tail] ** 2)),
        "max_error_tail": error[tail].max(),
        "settling_time": r.t[np.nonzero(error > 0.02 * error[0])[0][-1] + 1],
        "max_repulsion": r.force.max(),
        "max_repulsion_time": r.t[r.force.max(axis=1).argmax()],
        "peak_torque": np.abs(r.tau).max(),
        "peak_speed": np.abs(r.dq).max(),
        "effort": np.sum(r.tau**2) * dt,
        "energy": np.sum(np.abs(r.tau * r.dq)) * dt,
        "rms_jerk": np.sqrt(np.mean((np.diff(r.dq, n=2, axis=0) / dt**2) ** 2)),
        "intrusion_time": 0.0,
        "intrusion_depth": 0.0,
    }
    for name, value in recomputed.items():
        assert m[name] == pytest.approx(value, rel=1e-6, abs=1e-15), name
    assert m["collision_time"] is None


# --------------------------------------------------------------------------------------------- save and load


@pytest.mark.parametrize("make", [lambda: "crowd", pose_scenario], ids=["position", "pose"])
def test_save_and_load_keep_every_bit(make: Any, tmp_path: Path) -> None:
    result = vff.simulate(make(), {"duration": 0.1})
    path = result.save(tmp_path / "run.npz")
    assert path == tmp_path / "run.npz" and [p.name for p in tmp_path.iterdir()] == ["run.npz"]
    again = vff.Result.load(str(path))
    for name in EVERYTHING:
        a, b = getattr(result, name), getattr(again, name)
        assert a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes(), name
    for name in ("status", "message", "end_time", "wall_time", "warnings", "version", "scenario"):
        assert getattr(again, name) == getattr(result, name), name
    assert dict(again.metrics) == dict(result.metrics)
    assert again.scenario.to_dict() == result.scenario.to_dict()
    assert again.version == vff.__version__
    rerun = vff.simulate(again.scenario)  # the file is enough to repeat the run
    assert rerun.q.tobytes() == result.q.tobytes()


@pytest.mark.parametrize("name", ["run.npy", "run", "run.npz.gz", "run.xlsx"])
def test_wrong_endings(short: vff.Result, name: str, tmp_path: Path) -> None:
    for call in (short.save, vff.Result.load):
        with pytest.raises(InputError, match=r"\.npz"):
            call(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_saving_into_nowhere(short: vff.Result, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="missing"):
        short.save(tmp_path / "missing" / "run.npz")
    with pytest.raises(FileNotFoundError):
        vff.Result.load(tmp_path / "missing.npz")


def _junk(path: Path) -> None:
    path.write_bytes(b"not a zip file")


def _empty(path: Path) -> None:
    path.write_bytes(b"")


def _npy(path: Path) -> None:
    with path.open("wb") as file:
        np.save(file, np.zeros(3))


def _foreign(path: Path) -> None:
    np.savez(path, a=np.zeros(3))


def _headers(header: Any) -> Any:
    def write(path: Path) -> None:
        np.savez(path, vffnull=np.array(json.dumps(header)), **dict.fromkeys(EVERYTHING, np.zeros(3)))

    return write


def _cut(path: Path) -> None:
    vff.simulate("sweep-through", {"duration": 0.01}).save(path)
    path.write_bytes(path.read_bytes()[:-200])


@pytest.mark.parametrize(
    "write",
    [
        _junk,
        _empty,
        _npy,
        _foreign,
        _cut,
        _headers({}),
        _headers([1]),
        _headers({"format": 1}),
        _headers({"format": 99}),
        _headers({"format": 99, "version": "9.9"}),
    ],
    ids=[
        "junk",
        "empty",
        "npy",
        "foreign",
        "cut",
        "no header",
        "list header",
        "thin header",
        "thin future",
        "future",
    ],
)
def test_files_that_are_no_results(write: Any, tmp_path: Path) -> None:
    path = tmp_path / "bad.npz"
    write(path)
    with pytest.raises(InputError, match=r"bad\.npz"):
        vff.Result.load(path)


def test_a_file_of_another_version_says_so(tmp_path: Path) -> None:
    path = tmp_path / "future.npz"
    _headers({"format": 99, "version": "9.9"})(path)
    with pytest.raises(InputError, match=r"9\.9.*99"):
        vff.Result.load(path)


# ---------------------------------------------------------------------------------------------------- tables


def test_to_pandas(short: vff.Result) -> None:
    pandas = pytest.importorskip("pandas")
    table = short.to_pandas()
    assert isinstance(table, pandas.DataFrame)
    np.testing.assert_array_equal(table.index, short.t)
    np.testing.assert_array_equal(table["q_0"], short.q[:, 0])
    np.testing.assert_array_equal(table["tau_vff_5"], short.tau_vff[:, 5])
    np.testing.assert_array_equal(table["x_y"], short.x[:, 1])
    np.testing.assert_array_equal(table["obstacles_0_y"], short.obstacles[:, 0, 1])
    units = table.attrs["units"]
    assert set(units) == {"t", *table.columns}
    assert {
        units[c]
        for c in ("t", "q_0", "dq_2", "tau_3", "x_x", "dx_y", "force_1", "clearance_5", "obstacles_0_x")
    } == {"s", "rad", "rad/s", "N·m", "m", "m/s", "N"}
    assert units["dq_2"] == "rad/s" and units["dx_y"] == "m/s" and units["tau_vff_1"] == "N·m"
    assert table.attrs["status"] == "completed" and table.attrs["vffnull_version"] == vff.__version__
    assert vff.Scenario.from_dict(vff._core.parse_toml(table.attrs["scenario"], "")) == short.scenario


def test_to_xarray(short: vff.Result) -> None:
    xarray = pytest.importorskip("xarray")
    data = short.to_xarray()
    assert isinstance(data, xarray.Dataset)
    along = {"t": 51, "joint": 6, "link": 6, "task": 2, "plane": 2, "obstacle": 1}
    assert dict(data.sizes) == along | {"store": 3, "port": 6}
    assert data["power"].sel(port="damping").values[5] == short.power[5, 1]
    assert data["q"].dims == ("t", "joint") and data["x"].dims == ("t", "task")
    assert data["obstacles"].dims == ("t", "obstacle", "plane") and data["clearance"].dims == ("t", "link")
    units = {name: data[name].attrs["units"] for name in data.data_vars}
    assert units["q"] == "rad" and units["tau"] == "N·m" and units["dx"] == "m/s" and units["force"] == "N"
    assert data["t"].attrs["units"] == "s"
    assert all(data[name].attrs["long_name"] for name in data.data_vars)
    np.testing.assert_array_equal(data["x"].sel(task="y"), short.x[:, 1])
    np.testing.assert_array_equal(data["q"].sel(joint=5), short.q[:, 5])
    assert data.attrs["status"] == "completed"


def test_tables_of_a_pose() -> None:
    pytest.importorskip("pandas")
    result = vff.simulate(pose_scenario())
    table = result.to_pandas()
    np.testing.assert_array_equal(table["x_phi"], result.x[:, 2])
    assert table.attrs["units"]["x_phi"] == "rad" and table.attrs["units"]["dx_phi"] == "rad/s"
    assert "rad" in result.to_xarray()["x"].attrs["units"]


# ---------------------------------------------------------------------------------------------------- figures

FIGURES = {"tracking", "tracking_error", "joint_angles", "repulsive_torques", "clearance", "strobe"}


def test_plot_returns_figures(short: vff.Result) -> None:
    """Tracking, error, angles, repulsive torques, clearance and the strobe picture; axes with units."""
    from matplotlib.figure import Figure

    figures = short.plot()
    assert isinstance(figures, dict) and set(figures) >= FIGURES
    for name, figure in figures.items():
        assert isinstance(figure, Figure)
        assert figure.axes, name
        labels = [axis.get_xlabel() + axis.get_ylabel() for axis in figure.axes]
        assert any(label for label in labels), name
    for name, unit in [
        ("joint_angles", "rad"),
        ("repulsive_torques", "N"),
        ("clearance", "m"),
        ("tracking", "m"),
    ]:
        assert any(unit in axis.get_ylabel() for axis in figures[name].axes), name
    # The curves are the record's.
    lines = [line for axis in figures["joint_angles"].axes for line in axis.get_lines()]
    drawn = [np.asarray(line.get_ydata()) for line in lines]
    for joint in range(6):
        assert any(len(y) == len(short.t) and np.allclose(y, short.q[:, joint]) for y in drawn), joint


def test_a_joint_has_one_colour_everywhere(paper_1: vff.Result) -> None:
    from matplotlib.colors import to_hex

    figures = paper_1.plot()
    assert isinstance(figures, dict)

    def colours(figure: str, values: np.ndarray) -> list[set[str]]:
        """The colours of the lines that show each column (two links may be equally far from an obstacle)."""
        lines = [line for axis in figures[figure].axes for line in axis.get_lines()]
        return [
            {
                to_hex(line.get_color())
                for line in lines
                if len(line.get_ydata()) == len(column)
                and np.allclose(line.get_ydata(), column, rtol=0, atol=1e-12)
            }
            for column in values.T
        ]

    angles = colours("joint_angles", paper_1.q)
    assert all(len(found) == 1 for found in angles) and len(set.union(*angles)) == 6
    for figure, values in [("clearance", paper_1.clearance), ("repulsive_torques", paper_1.tau_vff)]:
        for joint, found in enumerate(colours(figure, values)):
            assert angles[joint] <= found, (figure, joint)


def test_plot_writes_files(short: vff.Result, tmp_path: Path) -> None:
    paths = short.plot(tmp_path / "new" / "figures")
    assert isinstance(paths, list) and {path.stem for path in paths} >= FIGURES
    for path in paths:
        assert path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 5000


@pytest.mark.parametrize(
    "overrides",
    [
        {"obstacles": None},
        {"duration": 0.001},
        {"simulation.record_every": 10_000},
        {"controller.field": None},
    ],
    ids=["no obstacles", "two instants", "one instant", "no field"],
)
def test_plot_of_odd_results(overrides: dict[str, Any]) -> None:
    result = vff.simulate("sweep-through", {"duration": 0.1, **overrides})
    figures = result.plot()
    assert isinstance(figures, dict) and "joint_angles" in figures


def test_plot_of_a_diverged_run(tmp_path: Path) -> None:
    overrides = {"simulation.control": "hold", "controller.stiffness": 1e7, "simulation.dt": 0.02}
    with pytest.warns(vff.errors.ScenarioWarning, match="too little for a stiffness"):
        result = vff.simulate("sweep-through", overrides)
    assert result.status == "diverged"
    assert result.plot(tmp_path)


def test_plot_leaves_pyplot_alone(short: vff.Result) -> None:
    """No global figures pile up and no global style changes."""
    import matplotlib
    from matplotlib import pyplot

    before = dict(matplotlib.rcParams)
    short.plot()
    assert pyplot.get_fignums() == []
    assert dict(matplotlib.rcParams) == before


def test_animate(short: vff.Result, tmp_path: Path) -> None:
    from PIL import Image

    path = short.animate(tmp_path / "arm.gif", fps=10)
    with Image.open(path) as film:
        assert film.format == "GIF"
        assert getattr(film, "n_frames", 1) == 6  # 0.5 s at 10 frames per second, first and last included
        duration = 0
        for frame in range(6):
            film.seek(frame)
            duration += film.info["duration"]
        assert duration == 5 * 100 + 1000  # ms; the last picture stays for a second


@pytest.mark.parametrize("fps", [12.0, 30.0, 50.0])
def test_a_film_lasts_as_long_as_its_run(short: vff.Result, fps: float, tmp_path: Path) -> None:
    """Although frames of a GIF last whole hundredths of a second."""
    from PIL import Image, ImageSequence

    with Image.open(short.animate(tmp_path / "arm.gif", fps=fps)) as film:
        lasts = sum(frame.info["duration"] for frame in ImageSequence.Iterator(film)) - 1000
        count = getattr(film, "n_frames", 1)
    assert lasts == pytest.approx(1000.0 * (count - 1) / fps, abs=6.0)


@pytest.mark.parametrize("scenario", ["sweep-through", "panda-sweep"])
def test_names_fit_into_films(scenario: str, tmp_path: Path) -> None:
    """However long, and whatever is in them: the picture is the same, time and clearance can be read."""
    from PIL import Image

    pictures = []
    for name in ("a", "pays $5, not $6, at " + "x" * 200, "$x^$"):
        result = vff.simulate(vff.Scenario.load(scenario).replace(name=name, duration=0.1))
        with Image.open(result.animate(tmp_path / "film.gif", fps=10)) as film:
            pictures.append(np.asarray(film.convert("L")).astype(int))
    head = pictures[0].shape[0] // 12
    right = int(0.75 * pictures[0].shape[1])
    for other in pictures[1:]:
        assert np.abs(other[head:] - pictures[0][head:]).mean() < 1.0
        assert np.abs(other[:head, right:] - pictures[0][:head, right:]).mean() < 1.0


def test_animate_shows_what_moves(tmp_path: Path) -> None:
    """Arm and disc in every frame, arrows once the disc is near: their colours are there, or are not."""
    from PIL import Image

    result = vff.simulate("sweep-through")
    done: list[tuple[float, float]] = []
    path = result.animate(tmp_path / "arm.gif", fps=5, progress=lambda *given: done.append(given))
    assert done == [(i + 1, 21) for i in range(21)]

    def share(film: Image.Image, frame: int, colour: tuple[int, int, int]) -> float:
        film.seek(frame)
        dots = np.asarray(film.convert("RGB")).astype(int)
        return float((np.abs(dots - colour).max(axis=2) < 40).mean())

    arm, disc, force = (0x00, 0x72, 0xB2), (0xD5, 0x5E, 0x00), (0xB2, 0x18, 0x2B)
    with Image.open(path) as film:
        for frame in (0, 10, 20):
            assert share(film, frame, arm) > 0.002 and share(film, frame, disc) > 0.0001
        strongest = round(result.metrics["max_repulsion_time"] * 5)
        assert share(film, strongest, force) > 0.0005
        assert share(film, 0, force) == 0.0 == result.force[0].max()


def test_animate_writes_mp4(short: vff.Result, tmp_path: Path) -> None:
    """H.264 of the run's length."""
    import imageio_ffmpeg

    path = short.animate(tmp_path / "arm.mp4", fps=10, speed=0.5)
    count, seconds = imageio_ffmpeg.count_frames_and_secs(str(path))
    assert count == 11 and seconds == pytest.approx(1.1)  # 0.5 s at half speed, the last one included
    content = path.read_bytes()
    assert b"avc1" in content and b"ftypisom" in content[:16]


def test_a_film_that_is_broken_off_says_nothing(
    short: vff.Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C before its first picture ends the encoder, which told of a film without pictures."""
    from vffnull.draw.figures.animation import _Picture

    def breaks_off(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(_Picture, "each", breaks_off)
    with pytest.raises(KeyboardInterrupt):
        short.animate(tmp_path / "arm.mp4", fps=10)
    assert not list(tmp_path.iterdir())
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("arm.avi", {}),
        ("arm", {}),
        ("arm.gif", {"fps": 0}),
        ("arm.gif", {"speed": -1.0}),
        ("arm.gif", {"fps": float("nan")}),
        ("arm.gif", {"fps": 60}),
        ("arm.gif", {"fps": 1e-3}),
        ("arm.mp4", {"fps": 1e308}),
        ("arm.gif", {"speed": 1e-9}),
    ],
)
def test_animate_refuses(short: vff.Result, name: str, options: dict[str, float], tmp_path: Path) -> None:
    with pytest.raises(VffNullError):
        short.animate(tmp_path / name, **options)
    assert not list(tmp_path.iterdir())


# ---------------------------------------------------------------------------------------------------- objects


def test_results_and_their_parts_can_be_pickled(short: vff.Result) -> None:
    again = pickle.loads(pickle.dumps(short))
    np.testing.assert_array_equal(again.q, short.q)
    assert again.scenario == short.scenario and dict(again.metrics) == dict(short.metrics)
    assert again.status is short.status


def test_repr_tells_the_outcome(short: vff.Result) -> None:
    assert "sweep-through" in repr(short) and "completed" in repr(short) and "51" in repr(short)
