"""A RealSense, which is the software device of its maker's library, with pictures that it is given."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError
from vffnull.robots.realsense import RealSense

rs = pytest.importorskip("pyrealsense2")

READY = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]


class Device:
    """A camera of 80 × 60 pixels, whose pictures are put into a queue."""

    def __init__(
        self,
        unit: float = 1e-3,
        coefficients: Any = (0.0,) * 5,
        model: Any = None,
        file: Path | None = None,
    ) -> None:
        self.unit, self.count = unit, 0
        self._device = rs.software_device()
        self._sensor = self._device.add_sensor("Stereo")
        lens = rs.intrinsics()
        lens.width, lens.height, lens.fx, lens.fy, lens.ppx, lens.ppy = 80, 60, 75.0, 74.0, 39.5, 29.0
        lens.model, lens.coeffs = model or rs.distortion.brown_conrady, list(coefficients)
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.intrinsics = rs.stream.depth, rs.format.z16, lens
        stream.index, stream.uid, stream.width, stream.height, stream.fps, stream.bpp = 0, 0, 80, 60, 30, 2
        self._profile = self._sensor.add_video_stream(stream)
        self._sensor.add_read_only_option(rs.option.depth_units, unit)
        self.queue = rs.frame_queue(10)
        self._recorder = None if file is None else rs.recorder(str(file), self._device)
        self._shown = self._sensor if self._recorder is None else self._recorder.query_sensors()[0]
        self._shown.open(self._shown.get_stream_profiles()[0])
        self._shown.start(self.queue)

    def close(self) -> None:
        self._shown.stop()
        self._shown.close()
        self._recorder = self._shown = None

    def show(self, depth: np.ndarray, stamp: float, domain: Any) -> None:
        frame = rs.software_video_frame()
        frame.stride, frame.bpp, frame.timestamp, frame.domain = 160, 2, 1e3 * stamp, domain
        self.count += 1
        frame.frame_number, frame.profile = self.count, self._profile.as_video_stream_profile()
        frame.depth_units, frame.pixels = self.unit, depth
        self._sensor.on_video_frame(frame)


HOST, OWN = rs.timestamp_domain.system_time, rs.timestamp_domain.hardware_clock


def test_pictures_go_to_a_perceiver() -> None:
    """A board is where it is, with the arm cut out, and the stamp on the states' clock."""
    device = Device()
    board = np.full((60, 80), 1000, np.uint16)
    board[0, 0] = 0
    shift = 1000.0
    device.show(board, time.time(), HOST)
    arm = vff.Arm.named("panda")
    with RealSense(source=device.queue, clock=lambda: time.time() - shift) as eye:
        camera = eye.camera([0.6, 0.0, 1.5], [0.0, 1.0, 0.0, 0.0])
        assert (
            camera["columns"] == 80 and camera["focal"] == [75.0, 74.0] and camera["centre"] == [39.5, 29.0]
        )
        perceiver = vff.Perceiver(arm, [camera], {"stride": 1})
        t, depth = eye.read()
        assert depth.dtype == np.uint16 and abs(t - (time.time() - shift)) < 1.0
        perceiver.observe(t, READY, [0.0] * 7)
        counts = perceiver.see(depth, t)
        assert counts["measured"] == 4799 and counts["own"] > 100
        np.testing.assert_allclose(perceiver.points[:, 2], 0.5, atol=1e-6)


def test_units_and_times() -> None:
    """Other units become metres; the camera's own clock counts from the picture that came quickest."""
    device = Device(unit=5e-4)
    now = [7.0]
    device.show(np.full((60, 80), 3000, np.uint16), 100.0, OWN)
    eye = RealSense(source=device.queue, clock=lambda: now[0])
    t, depth = eye.read()
    assert depth.dtype == np.float32 and t == pytest.approx(7.0)
    np.testing.assert_allclose(depth, 1.5, rtol=1e-6)
    now[0] = 7.05  # the second one has taken 20 ms longer, the third one 10 ms less than the first
    device.show(np.zeros((60, 80), np.uint16), 100.03, OWN)
    assert eye.read()[0] == pytest.approx(7.03)
    now[0] = 7.05
    device.show(np.zeros((60, 80), np.uint16), 100.06, OWN)
    assert eye.read()[0] == pytest.approx(7.05)


def test_a_recording_is_played(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As if it happened now: a slow reader misses some, and those that come have lens, depths and stamps."""
    monkeypatch.setattr("vffnull.robots.realsense.TIMEOUT", 500)
    device = Device(file=tmp_path / "r.db3")
    for k in range(10):
        device.show(np.full((60, 80), 1000 + k, np.uint16), 10.0 + 0.03 * k, OWN)
        assert device.queue.wait_for_frame(1000)
    device.close()
    with RealSense(recording=str(tmp_path / "r.db3"), clock=lambda: 4.0) as eye:
        assert eye.camera([0.0] * 3, [1.0, 0.0, 0.0, 0.0])["rows"] == 60
        found = [int(depth[0, 0]) for _, depth in eye]
    assert found and found == sorted(set(found)) and set(found) <= set(range(1000, 1010))
    with pytest.raises(InputError, match="no RealSense"):
        RealSense(recording=str(tmp_path / "none.db3"))


def test_lenses() -> None:
    """Brown's is told, another one that bends is refused, and one that does not bend is none."""
    bent = [-0.05, 0.06, 1e-3, -1e-3, 0.0]
    picture = np.zeros((60, 80), np.uint16)
    for model, coefficients, expected in (
        (rs.distortion.brown_conrady, bent, bent),
        (rs.distortion.inverse_brown_conrady, [0.0] * 5, [0.0] * 5),
        (rs.distortion.inverse_brown_conrady, bent, None),
    ):
        device = Device(coefficients=coefficients, model=model)
        device.show(picture, 1.0, OWN)
        eye = RealSense(source=device.queue)
        if expected is None:
            with pytest.raises(InputError, match=r"the lens is .*inverse_brown_conrady"):
                eye.camera([0.0] * 3, [1.0, 0.0, 0.0, 0.0])
        else:
            found = eye.camera([0.0] * 3, [1.0, 0.0, 0.0, 0.0])
            np.testing.assert_allclose(found["distortion"], expected, rtol=1e-6)
            vff.Perceiver(vff.Arm.named("panda"), [found])


def test_no_camera_and_no_picture(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vffnull.robots.realsense.TIMEOUT", 20)
    with pytest.raises(InputError, match="no picture came for"):
        RealSense(source=Device().queue)
    with pytest.raises(InputError, match="no RealSense 000000000000: there are none"):
        RealSense(serial="000000000000")
    device = Device()
    device.show(np.zeros((60, 80), np.uint16), 1.0, OWN)
    assert len(list(RealSense(source=device.queue))) == 1
