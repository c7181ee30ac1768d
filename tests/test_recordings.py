"""Recordings of depth cameras: replayed, refused in words, and compared with the model of the arm."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import textwrap
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from recordings import ARM, MEAN, Recorder, capsules, looking, motion, off, record, take
from vffnull._core import matrices
from vffnull.errors import InputError, InputTypeError
from vffnull.logs import ros2

pytest.importorskip("mcap_ros2")

LEFT = looking([1.2, -0.9, 0.9], [0.25, 0.0, 0.4])
ABOVE = looking([0.9, 0.7, 1.3], [0.3, 0.0, 0.4])
FLOOR = vff.Obstacle.half_space([0.0, 0.0, -0.05], [0.0, 0.0, 1.0])
SETTINGS = {"stride": 1, "room": [[-1.0, -1.2, -0.2], [1.2, 1.2, 1.4]]}


def ball(t: float) -> list[tuple[Any, Any, float]]:
    """Comes from the side with 0.4 m/s."""
    place = np.array([0.75, -0.6 + 0.4 * t, 0.35])
    return [(place, place, 0.06)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.fixture(scope="module")
def watched(folder: Path) -> Path:
    """Two cameras that stand where they say, and a ball."""
    eyes = {"/left/depth": LEFT, "/above/depth": ABOVE}
    return record(folder / "watched.mcap", eyes, eyes, seconds=1.2, things=ball)


def test_what_a_replay_tells(watched: Path) -> None:
    """Pixels of the arm, links, delays; the ball moves as it does; and with nobody there nothing is left."""
    report = vff.perceive(watched, ARM, settings=SETTINGS, known=[FLOOR])
    assert report.states == 120 and report.late_states == 0 and report.refused == 0
    assert [each.topic for each in report.cameras] == ["/above/depth/image", "/left/depth/image"]
    for camera in report.cameras:
        assert camera.pictures == 18 and camera.gaps == 0 and camera.moved == 0.0
        assert 0.03 < camera.own / camera.measured < 0.3 and camera.left_out == 0
        assert camera.delay == pytest.approx((0.03, 0.03), abs=1e-6)
        assert camera.period == pytest.approx(1 / 15, abs=1e-6)
        assert 0.0 < camera.cost[0] <= camera.cost[1]
        assert sum(camera.own_by_link.values()) == pytest.approx(1.0)
        assert len(camera.own_by_link) > 4 and set(camera.own_by_link) <= {"base", *ARM.link_names}
    assert 5 < report.points[0] <= report.points[1]
    longest = max(report.tracks, key=lambda track: track.until - track.since)
    assert longest.until - longest.since > 0.7
    assert np.abs(np.subtract(longest.velocity, [0.0, 0.4, 0.0])).max() < 0.1
    json.dumps(report.to_dict())


def test_clouds_and_missing_velocities(folder: Path) -> None:
    """Clouds in the frame of the camera, and positions alone, say the same of the arm."""
    eyes = {"/left": LEFT}
    seen = []
    for name, how in {"pictures": {}, "clouds": {"clouds": True}, "positions": {"velocities": False}}.items():
        path = record(folder / f"{name}.mcap", eyes, eyes, seconds=0.8, **how)
        report = vff.perceive(path, ARM, settings=SETTINGS, known=[FLOOR])
        assert report.points == (0, 0) and report.cameras[0].pictures == 12
        seen.append(report.cameras[0])
    assert seen[1].own == pytest.approx(seen[0].own, rel=0.02)
    assert seen[2].own == pytest.approx(seen[0].own, rel=0.02)


def test_what_is_written_is_what_is_left(watched: Path, folder: Path) -> None:
    """Clouds with velocities for every picture, which another reader of MCAP finds in the file."""
    out = folder / "seen.mcap"
    report = vff.perceive(watched, ARM, settings=SETTINGS, known=[FLOOR], out=out)
    assert report.files == [str(out)]
    clouds = [m for m in ros2.messages(out) if isinstance(m, ros2.Picture) and m.topic == "/vffnull/points"]
    assert len(clouds) == 36 and clouds[-1].frame == "panda_link0"
    counts = [len(cloud.cloud) for cloud in clouds if cloud.cloud is not None]
    assert (int(np.median(counts)), max(counts)) == report.points
    last = clouds[-1].cloud
    assert last is not None
    away = np.linalg.norm(last - ball(17.5 / 15)[0][0], axis=1) - 0.06
    assert np.median(np.abs(away)) < 0.02
    with pytest.raises(InputError, match=r"points are written as .mcap or .rrd, not .txt"):
        vff.perceive(watched, ARM, out=folder / "seen.txt")


def test_rerun(watched: Path, folder: Path) -> None:
    pytest.importorskip("rerun")
    out = folder / "seen.rrd"
    vff.perceive(watched, ARM, settings=SETTINGS, known=[FLOOR], out=out)
    assert out.stat().st_size > 100_000


def test_pictures_of_every_kind(folder: Path) -> None:
    """Rows with gaps, the other order of bytes, compressed depths of both kinds; no colours."""
    import io

    from PIL import Image

    depth = np.arange(12, dtype=np.uint16).reshape(3, 4) * 300
    header = SimpleNamespace(stamp=SimpleNamespace(sec=1, nanosec=5), frame_id="/eye")

    def read(kind: str, **fields: Any) -> Any:
        found = list(ros2._read(kind, "/t", 7, SimpleNamespace(header=header, **fields)))
        return found[0] if found else None

    padded = np.concatenate(
        [depth.astype(">u2").view(np.uint8).reshape(3, 8), np.full((3, 3), 9, np.uint8)], 1
    )
    raw = {
        "height": 3,
        "width": 4,
        "encoding": "16UC1",
        "is_bigendian": 1,
        "step": 11,
        "data": padded.tobytes(),
    }
    found = read(ros2.IMAGE, **raw)
    assert found.stamp == 1_000_000_005 and found.frame == "eye" and found.depth.dtype == np.uint16
    np.testing.assert_array_equal(found.depth, depth)
    assert read(ros2.IMAGE, **raw | {"encoding": "rgb8"}) is None
    with pytest.raises(InputError, match="do not fit into 33 bytes"):
        read(ros2.IMAGE, **raw | {"height": 4})

    def png(values: np.ndarray) -> bytes:
        file = io.BytesIO()
        Image.fromarray(values).save(file, "PNG")
        return file.getvalue()

    stored = read(ros2.COMPRESSED, format="16UC1; compressedDepth png", data=b"\0" * 12 + png(depth))
    np.testing.assert_array_equal(stored.depth, depth)
    a, b = 100.0, -2.0
    inverse = np.where(depth > 0, np.round(a / np.maximum(depth * 1e-3, 1e-9) + b), 0).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + png(inverse)
    metres = read(ros2.COMPRESSED, format="32FC1; compressedDepth png", data=data).depth
    np.testing.assert_allclose(metres, depth * 1e-3, rtol=0.03)
    assert read(ros2.COMPRESSED, format="rgb8; jpeg compressed bgr8", data=b"") is None
    with pytest.raises(InputError, match="not a PNG"):
        read(ros2.COMPRESSED, format="16UC1; compressedDepth png", data=b"\0" * 40)


# ------------------------------------------------------------------------------------------------ refusals


def written(path: Path, camera: bool = True, joints: Any = None, parent: str = "panda_link0") -> Path:
    q, dq = motion(0.0)
    with Recorder(path) as file:
        if camera:
            file.camera("/eye", LEFT, base=parent)
        for k in range(20):
            file.joints(0.01 * k, joints or ARM.joint_names, q, dq)
        file.picture("/eye", 0.1, take(LEFT, capsules(q)), arrived=0.2)
        file.picture("/eye", 0.1, take(LEFT, capsules(q)), arrived=0.21)
        file.picture("/eye", 0.6, take(LEFT, capsules(q)), arrived=0.7)
    return path


@pytest.mark.parametrize(
    ("how", "sentence"),
    [
        ({"camera": False}, "/eye/image: no camera_info beside it, nor with its frame 'eye_frame'"),
        ({"joints": list("abcdefg")}, "no message tells of the joints panda_joint1, .*; it has a, b, c"),
        ({"parent": "map"}, "no transform leads from 'eye_frame' to the base 'panda_link0'"),
    ],
)
def test_what_a_recording_has_to_say(tmp_path: Path, how: Any, sentence: str) -> None:
    path = written(tmp_path / "r.mcap", **how)
    with pytest.raises(InputError, match=sentence):
        vff.perceive(path, ARM)
    if "joints" in how:
        assert vff.perceive(path, ARM, joints=how["joints"]).states == 20
    elif "parent" in how:
        assert vff.perceive(path, ARM, base="map").cameras[0].pictures == 1
    else:
        assert vff.perceive(path, ARM, cameras={"/eye/image": LEFT}).cameras[0].pictures == 1


def test_late_pictures_are_counted(tmp_path: Path) -> None:
    """One that is there twice, and one when nothing is known of the arm any more."""
    report = vff.perceive(written(tmp_path / "r.mcap"), ARM, settings=SETTINGS, known=[FLOOR])
    assert report.cameras[0].pictures == 1 and report.refused == 2
    assert report.cameras[0].refused == {
        "no later than the one before": 1,
        "no state of the arm near its time": 1,
    }


def test_a_camera_that_moves_is_told(tmp_path: Path) -> None:
    path = tmp_path / "r.mcap"
    q, dq = motion(0.0)
    with Recorder(path) as file:
        file.camera("/eye", LEFT, base="panda_link0")
        for k in range(20):
            file.joints(0.01 * k, ARM.joint_names, q, dq)
        file.picture("/eye", 0.1, take(LEFT, capsules(q)))
        moved = off(LEFT, [0.03, 0.0, 0.04])
        file.frame(0.15, "panda_link0", "eye_frame", moved["position"], moved["orientation"])
        file.picture("/eye", 0.16, take(LEFT, capsules(q)))
    (found,) = vff.perceive(path, ARM, settings=SETTINGS).cameras
    assert found.moved == pytest.approx(0.05) and found.turned == 0.0
    assert "the camera moves" in command(path, "--arm", "panda", code=3, errors=True)


def test_broken_files(watched: Path, tmp_path: Path) -> None:
    whole = watched.read_bytes()
    for name, data in {
        "empty": b"",
        "text": b"hello, world, this is text",
        "cut": whole[: len(whole) // 2],
    }.items():
        path = tmp_path / name
        path.write_bytes(data)
        with pytest.raises(InputError, match="not a sound MCAP recording"):
            vff.perceive(path, ARM, settings=SETTINGS)
    random, small = np.random.default_rng(5), written(tmp_path / "small.mcap").read_bytes()
    wrong = 0
    for _ in range(100):
        spoilt = bytearray(small)
        for place in random.integers(len(small), size=2):
            spoilt[place] ^= int(random.integers(1, 256))
        (tmp_path / "spoilt.mcap").write_bytes(spoilt)
        try:
            vff.perceive(tmp_path / "spoilt.mcap", ARM, settings=SETTINGS)
        except InputError:
            wrong += 1
    assert wrong > 50
    with Recorder(tmp_path / "nothing.mcap") as file:
        file.joints(0.0, ARM.joint_names, MEAN)
    with pytest.raises(
        InputError, match=r"no pictures with depths; it has /joint_states \(sensor_msgs/msg/JointState\)"
    ):
        vff.perceive(tmp_path / "nothing.mcap", ARM)
    with pytest.raises(FileNotFoundError):
        vff.perceive(tmp_path / "not there.mcap", ARM)


def test_a_recording_is_not_written_over(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By whatever path it is named, from Python and from the shell; nor any other file that is read."""
    path = written(tmp_path / "r.mcap")
    before = path.read_bytes()
    (tmp_path / "link.mcap").symlink_to(path)
    (tmp_path / "hard.mcap").hardlink_to(path)
    monkeypatch.chdir(tmp_path)
    for out in ("r.mcap", "link.mcap", "hard.mcap", "../" + tmp_path.name + "/r.mcap", path):
        with pytest.raises(InputError, match="is read, and would be written over; name another file"):
            vff.perceive(path, ARM, out=out)
        assert "would be written over" in command(path, "--arm", "panda", "--out", out, code=2, errors=True)
    assert path.read_bytes() == before
    cameras = tmp_path / "c.toml"
    cameras.write_text(vff._core.format_toml({"/eye/image": LEFT}), encoding="utf-8")
    given = (path, "--arm", "panda", "--calibrate", "--cameras", cameras, "--out", cameras)
    assert "would be written over" in command(*given, code=2, errors=True)


def test_states_that_say_nothing_are_left_out(tmp_path: Path) -> None:
    """One without numbers, and one from the far future; velocities that are no numbers count as missing."""
    path = tmp_path / "r.mcap"
    with Recorder(path) as file:
        file.camera("/eye", LEFT, base="panda_link0")
        for k in range(100):
            t, (q, _) = 0.01 * k, motion(0.01 * k)
            stamp = 1e6 if k == 70 else t
            file.joints(stamp, ARM.joint_names, np.nan * q if k == 30 else q, np.nan * q, arrived=t)
            if k % 10 == 5:
                file.picture("/eye", t, take(LEFT, capsules(q)), arrived=t + 0.001)
    report = vff.perceive(path, ARM, settings=SETTINGS, known=[FLOOR])
    assert report.unusable_states == {
        "/joint_states: not finite, the first after 0.300 s": 1,
        "/joint_states: with a time from the future, the first after 0.700 s": 1,
    }
    assert report.states == 100 and report.late_states == 0 and report.duration == pytest.approx(0.99)
    assert report.cameras[0].pictures == 10 and report.refused == 0
    assert report.points == (0, 0)  # with velocities that come of positions all of it is the arm
    told = command(path, "--arm", "panda")
    assert "left out: 1 of /joint_states: not finite, the first after 0.300 s" in told
    assert vff.calibrate(path, ARM)[0].pictures > 3


@pytest.mark.parametrize(
    ("stamp", "late", "expected"),
    [
        (lambda t: t, 1.7e9, 10),  # simulated time from zero on, recorded by the clock of the wall
        (lambda t: t, 0.0, 10),
        (lambda t: 0.0, 1.7e9, 10),  # none: as they came
        (lambda t: t + 1.7e9 if t > 0.2 else 0.0, 1.7e9, 10),  # none at first
        (lambda t: t + 500.0 if t > 0.2 else 0.0, 1.7e9, 8),  # before nodes know the simulated time
    ],
)
def test_stamps_of_zero(tmp_path: Path, stamp: Any, late: float, expected: int) -> None:
    """They are times where the others show that time begins there, and missing where they do not."""
    path = tmp_path / "r.mcap"
    q, _ = motion(0.0)
    seen = take(LEFT, capsules(q))
    with Recorder(path) as file:
        file.camera("/eye", LEFT, late, base="panda_link0")
        for k in range(50):
            t = 0.01 * k
            file.joints(stamp(t), ARM.joint_names, q, 0.0 * q, arrived=late + t)
            if k % 5 == 0:
                file.picture("/eye", stamp(t), seen, arrived=late + t)
    (found,) = vff.perceive(path, ARM, settings=SETTINGS, known=[FLOOR]).cameras
    assert found.pictures >= expected - 2 and found.pictures <= expected
    if expected == 10:
        assert found.pictures == 10 and not found.refused


def test_pictures_without_a_depth_are_told(tmp_path: Path) -> None:
    """Floats in millimetres are too far away, and a picture may be empty: why that may be is said."""
    for name, wrong in (("unit", 1000.0), ("empty", np.nan)):
        path, (q, dq) = tmp_path / f"{name}.mcap", motion(0.0)
        with Recorder(path) as file:
            file.camera("/eye", LEFT, base="panda_link0")
            file.joints(0.0, ARM.joint_names, q, dq)
            file.picture("/eye", 0.0, np.float32(wrong) * (1e-3 * take(LEFT, capsules(q))))
        told = command(path, "--arm", "panda", errors=True)
        assert "/eye/image: no picture has a depth within the range: floats are metres" in told
        assert "nan" not in command(path, "--arm", "panda")


def test_what_is_unknown_is_named(tmp_path: Path) -> None:
    """A frame that there is not, with those that there are; and a file that ends in its first bytes."""
    path = written(tmp_path / "r.mcap")
    with pytest.raises(InputError, match="no frame is called 'nix', there are eye_frame, panda_link0; name"):
        vff.perceive(path, ARM, base="nix")
    (tmp_path / "short.mcap").write_bytes(path.read_bytes()[:8])
    with pytest.raises(InputError, match=r"short.mcap: not a sound MCAP recording"):
        vff.perceive(tmp_path / "short.mcap", ARM)


# ------------------------------------------------------------------------------------------------ calibration


def errors(found: vff.CameraCalibration, said: dict[str, Any], truth: dict[str, Any]) -> tuple[float, float]:
    """How far the corrected camera is from the true one [m, rad]."""
    turned = matrices(np.array(found.camera["orientation"])).T @ matrices(np.array(truth["orientation"]))
    angle = float(np.arccos(np.clip(0.5 * (np.trace(turned) - 1.0), -1.0, 1.0)))
    return float(np.linalg.norm(np.subtract(found.camera["position"], truth["position"]))), angle


@pytest.mark.parametrize(
    ("moved", "turned", "clock", "noise"),
    [
        ([0.0] * 3, [0.0] * 3, 0.0, 0.0),
        ([-0.02, 0.015, 0.01], [0.02, -0.01, 0.015], 0.035, 0.002),
    ],
)
def test_errors_are_found(tmp_path: Path, moved: Any, turned: Any, clock: float, noise: float) -> None:
    """Of place, orientation and clock, to a millimetre or two, and within what is said of their scatter."""
    truth = {"/left": off(LEFT, moved, turned)}
    path = record(
        tmp_path / "r.mcap", {"/left": LEFT}, truth, seconds=3.0, rate=8.0, clock=clock, noise=noise
    )
    (found,) = vff.calibrate(path, ARM)
    away, angle = errors(found, LEFT, truth["/left"])
    assert found.time_offset is not None and found.time_deviation is not None
    late = abs(found.time_offset + clock)
    assert away < 0.002 and angle < 0.0015 and late < 0.001, (away, angle, late, found)
    assert found.translation_deviation < 0.001 and found.time_deviation < 0.001
    assert away < 4.0 * found.translation_deviation + 1e-4
    assert angle < 4.0 * found.rotation_deviation + 1e-4
    assert late < 4.0 * found.time_deviation + 1e-4
    assert found.after <= found.before and found.after < 0.002 and abs(found.bias) < 2e-4


def test_what_is_found_mends_the_replay(tmp_path: Path) -> None:
    """With margins too small for the errors points of the arm are left, and none with the correction."""
    truth = {"/left": off(LEFT, [0.02, 0.0, 0.0], [0.0, 0.02, 0.0])}
    path = record(tmp_path / "r.mcap", {"/left": LEFT}, truth, seconds=2.0, rate=8.0, clock=-0.03)
    settings = SETTINGS | {"margin": 0.008, "time_error": 0.0, "least_points": 1}
    blind = vff.perceive(path, ARM, settings=settings, known=[FLOOR])
    assert blind.points[0] > 5
    printed = command(path, "--arm", "panda", "--calibrate", "--out", tmp_path / "c.toml")
    assert "translation" in printed and "to be added to the times" in printed
    told = json.loads(
        command(
            path, "--arm", "panda", "--cameras", tmp_path / "c.toml",
            "--json", "--known", tmp_path / "table.toml",
            *(f"--set={key}={json.dumps(value)}" for key, value in settings.items()),
            scene=tmp_path / "table.toml",
        )
    )  # fmt: skip
    assert told["points"][1] <= 2 and told["cameras"][0]["pictures"] == blind.cameras[0].pictures


def command(*arguments: object, code: int = 0, scene: Path | None = None, errors: bool = False) -> str:
    if scene is not None:
        vff.Scenario.load("panda-sweep").replace(obstacles=[FLOOR.to_dict()]).save(scene)
    done = subprocess.run(
        [sys.executable, "-m", "vffnull", "perceive", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code, done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    return done.stderr if errors else done.stdout


def test_errors_of_our_own_simulation_are_found(tmp_path: Path) -> None:
    """A scene whose cameras are off by 5 mm and half a degree in directions that it does not tell."""
    scene = vff.Scenario.load("panda-watched")
    reference = {"kind": "line", "end": [0.1, 0.35, 0.1], "duration": 1.8, "relative": True}
    changed = {
        "duration": 2.4,
        "obstacles": [],
        "reference": reference,
        "perception.latency": 0.0,
        "perception.rate": 10.0,
    }
    simulation, path = vff.Simulation(scene.replace(**changed)), tmp_path / "r.mcap"
    eyes = []
    for each in scene["perception"]["cameras"]:
        columns, rows = each["columns"], each["rows"]
        focal = 0.5 * columns / np.tan(0.5 * each.get("field_of_view", 1.2))
        centre = [0.5 * columns - 0.5, 0.5 * rows - 0.5]
        place = {key: each[key] for key in ("columns", "rows", "position", "orientation")}
        eyes.append(place | {"focal": [focal, focal], "centre": centre})
    with Recorder(path) as file:
        for k, eye in enumerate(eyes):
            file.camera(f"/eye{k}", eye, base="panda_link0")
        for step in range(1, 2401):
            state = simulation.step()
            if step % 10 == 0:
                file.joints(state.t, ARM.joint_names, state.q, state.dq)
            if step % 100 == 0:
                for k, depth in enumerate(simulation.pictures):
                    file.picture(f"/eye{k}", state.t, depth)
    for found in vff.calibrate(path, ARM):
        turned, moved = np.degrees(np.linalg.norm(found.rotation)), np.linalg.norm(found.translation)
        assert moved == pytest.approx(0.005, abs=0.0015) and turned == pytest.approx(0.5, abs=0.08), found
        assert found.time_offset is not None and abs(found.time_offset) < 0.05


def test_pictures_in_gaps_are_left_out(tmp_path: Path) -> None:
    """For half a second nobody tells where the arm is: what lies between two states then is no course."""
    path = tmp_path / "r.mcap"
    with Recorder(path) as file:
        file.camera("/eye", LEFT, base="panda_link0")
        for k in range(250):
            t = 0.01 * k
            if not 1.0 < t < 1.5:
                file.joints(t, ARM.joint_names, *motion(t))
            if k % 10 == 5:
                file.picture("/eye", t, take(LEFT, capsules(motion(t)[0])))
    (found,) = vff.calibrate(path, ARM)
    assert found.pictures == 16 and found.after < 0.001
    assert np.linalg.norm(found.translation) < 0.001 and abs(found.time_offset or 0.0) < 0.001


def test_an_arm_at_rest_and_one_that_is_elsewhere(tmp_path: Path) -> None:
    """Where nothing moves the clock is not told; where no arm is to be seen, nothing."""
    q, dq = motion(0.4)
    path = tmp_path / "r.mcap"
    with Recorder(path) as file:
        file.camera("/eye", LEFT, base="panda_link0")
        for k in range(200):
            file.joints(0.01 * k, ARM.joint_names, q, 0.0 * dq)
            if k % 20 == 0:
                file.picture("/eye", 0.01 * k, take(LEFT, capsules(q)))
    (found,) = vff.calibrate(path, ARM)
    assert found.time_offset is None and found.time_deviation is None and found.points > 500
    with pytest.raises(InputError, match=r"points in .* pictures lie within 0.12 m"):
        vff.calibrate(path, ARM, cameras={"/eye/image": off(LEFT, [0.0, 3.0, 0.0])})


JUDGED = """
    import sys
    import mujoco
    import numpy as np
    from pathlib import Path
    from recordings import ARM, looking, off, record
    from vffnull._core import matrices
    from vffnull.engines.export import to_mjcf
    from test_recordings import errors
    import vffnull as vff

    said = looking([1.2, -0.9, 0.9], [0.25, 0.0, 0.4], (160, 120))
    truth = off(said, [0.008, -0.006, 0.004], [0.004, -0.006, 0.005])
    axes = matrices(np.array(truth["orientation"])) * [1.0, -1.0, -1.0]  # MuJoCo's cameras look along -z
    fovy = np.degrees(2.0 * np.arctan(60.0 / truth["focal"][1]))
    place, x, y = (" ".join(map(str, each)) for each in (truth["position"], axes[:, 0], axes[:, 1]))
    eye = f'<camera name="eye" pos="{place}" xyaxes="{x} {y}" fovy="{fovy}"/>'
    floor = '<geom type="plane" size="5 5 0.1" pos="0 0 -0.05"/>'
    text = to_mjcf(ARM).replace("<worldbody>", "<worldbody>" + eye + floor, 1)
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    renderer = mujoco.Renderer(model, 120, 160)
    renderer.enable_depth_rendering()

    def shows(camera, q, t):
        data.qpos[:7] = q
        mujoco.mj_forward(model, data)
        renderer.update_scene(data, "eye")
        return np.round(1000.0 * np.minimum(renderer.render(), 60.0)).astype(np.uint16)

    path = Path(sys.argv[1])
    record(path, {"/eye": said}, {"/eye": truth}, seconds=3.0, rate=8.0, clock=0.02, shows=shows)
    (found,) = vff.calibrate(path, ARM)
    away, angle = errors(found, said, truth)
    print(found, away, angle)
    assert away < 0.002 and angle < 0.001 and abs(found.time_offset + 0.02) < 0.001
    floor = vff.Obstacle.half_space([0.0, 0.0, -0.05], [0.0, 0.0, 1.0])
    report = vff.perceive(path, ARM, settings={"stride": 1}, known=[floor])
    assert report.points == (0, 0) and report.cameras[0].own > 10_000, report
"""


def test_what_a_renderer_of_others_records(tmp_path: Path) -> None:
    """MuJoCo draws the arm for a camera that is off by 1 cm and 0.5°, with a clock that is off by 20 ms."""
    pytest.importorskip("mujoco")
    code = "import os\nos.environ.setdefault('MUJOCO_GL', 'egl')\n" + textwrap.dedent(JUDGED)
    done = subprocess.run(
        [sys.executable, "-c", code, tmp_path / "r.mcap"],
        capture_output=True,
        text=True,
        check=False,
        cwd=Path(__file__).parent,
    )
    if done.returncode and "mujoco.Renderer" in done.stderr:
        pytest.skip("nothing renders here")
    assert done.returncode == 0, done.stderr


def test_bad_options(watched: Path, tmp_path: Path) -> None:
    """Each with a sentence, and 2."""
    cameras = tmp_path / "c.toml"
    cameras.write_text('["/left/depth/image"]\nlens = 3\n', encoding="utf-8")
    assert "did you mean 'panda'?" in command(watched, "--arm", "pandda", code=2, errors=True)
    elsewhere = "room=[[-0.1, -0.1, 1.2], [0.1, 0.1, 1.3]]"
    empty = command(watched, "--arm", "panda", "--set", elsewhere, errors=True)
    assert "pixels are not the arm's, and no point is left of them" in empty
    assert "lens: unknown, expected columns" in command(
        watched, "--arm", "panda", "--cameras", cameras, code=2, errors=True
    )
    for wrong, sentence in (({"time_offset": "late"}, "time_offset"), ({"position": "x"}, "position")):
        with pytest.raises((InputError, InputTypeError), match=sentence):
            vff.perceive(watched, ARM, cameras={"/left/depth/image": wrong})
    with pytest.raises(InputError, match="max_depth"):
        vff.calibrate(watched, ARM, max_depth=-1.0)
    command(watched, "--arm", "panda", "--set", "voxels=1", code=2)
    command(watched, "--arm", "panda", "--topic", "/nobody", code=2)
    command(watched, "--arm", "panda", "--calibrate", "--out", tmp_path / "x.mcap", code=2)
