"""Depth pictures of a RealSense, by `pyrealsense2`, as a `vffnull.Perceiver` wants them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._support.errors import InputError
from vffnull._support.extras import extra

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["RealSense"]

TIMEOUT = 1000  # ms
MILLIMETRE = 1e-9  # m: a unit of depths that is so near to a millimetre is one


class RealSense:
    """The depth stream of a camera: its lens, and its pictures with the times when they were taken.

    Parameters
    ----------
    serial : str, optional
        Which camera; the first that is found by default.
    size : tuple of int, optional
        Columns and rows.
    rate : int, optional
        Pictures in a second.
    clock : callable, optional
        The clock of the states of the arm [s].
    recording : str, optional
        A file of `rs.recorder`, ``.db3`` or ``.bag``, which is played as if it happened now.
    source : object, optional
        Something with ``wait_for_frame``, as `rs.frame_queue`, instead of a camera.

    Raises
    ------
    ImportError
        Without the extra ``vffnull[realsense]``.
    vffnull.errors.InputError
        If there is no such camera, or if no picture comes within a second.

    Examples
    --------
    >>> with RealSense(size=(640, 480)) as eye:  # doctest: +SKIP
    ...     perceiver = Perceiver(arm, [eye.camera(position=[0.4, 0.0, 1.6], orientation=[0, 1, 0, 0])])
    ...     for t, depth in eye:
    ...         perceiver.see(depth, t)
    """

    def __init__(
        self,
        serial: str | None = None,
        *,
        size: tuple[int, int] = (640, 480),
        rate: int = 30,
        clock: Callable[[], float] = time.monotonic,
        recording: str | None = None,
        source: Any = None,
    ) -> None:
        self._rs = rs = extra("pyrealsense2", "realsense")
        self._clock, self._offset = clock, np.inf
        self._pipeline = None
        self._source = source
        if source is None:
            config = rs.config()
            if recording is not None:
                config.enable_device_from_file(recording, repeat_playback=False)
            else:
                there = [each.get_info(rs.camera_info.serial_number) for each in rs.context().query_devices()]
                if not there or serial not in (None, *there):
                    raise InputError(f"no RealSense {serial or ''}: there are {', '.join(there) or 'none'}")
                config.enable_device(serial or there[0])
                config.enable_stream(rs.stream.depth, *size, rs.format.z16, rate)
            self._pipeline = rs.pipeline()
            try:
                self._pipeline.start(config)
            except RuntimeError as error:
                self._pipeline = None
                raise InputError(f"no RealSense: {error}") from None
        try:
            self._first = self._next()
        except BaseException:
            self.close()
            raise
        self._is_new = True

    def __enter__(self) -> RealSense:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Stop the camera."""
        if self._pipeline is not None:
            self._pipeline.stop()
            self._pipeline = None

    def camera(self, position: Sequence[float], orientation: Sequence[float]) -> dict[str, Any]:
        """What a `vffnull.Perceiver` is told of it, at a position [m] with a quaternion [w, x, y, z].

        Raises
        ------
        vffnull.errors.InputError
            If its lens bends in another way than Brown's, which no depth stream known to us does.
        """
        lens = self._first.profile.as_video_stream_profile().get_intrinsics()
        bent = any(lens.coeffs)
        if bent and lens.model != self._rs.distortion.brown_conrady:
            raise InputError(f"the lens is {lens.model}, expected brown_conrady or none")
        return {
            "columns": lens.width,
            "rows": lens.height,
            "focal": [lens.fx, lens.fy],
            "centre": [lens.ppx, lens.ppy],
            "distortion": list(lens.coeffs) if bent else [0.0] * 5,
            "position": list(position),
            "orientation": list(orientation),
        }

    def __iter__(self) -> Iterator[tuple[float, NDArray[Any]]]:
        """Pictures with the time on `clock` [s] when each was taken, until none comes for a second."""
        while True:
            try:
                yield self.read()
            except InputError:
                return

    def read(self) -> tuple[float, NDArray[Any]]:
        """The next picture: when it was taken [s], and depths (rows, columns), uint16 [mm] or float32 [m].

        Raises
        ------
        vffnull.errors.InputError
            If none comes for a second.
        """
        frame = self._first if self._is_new else self._next()
        self._is_new = False
        depth, unit = np.array(frame.get_data()), frame.get_units()
        if abs(unit - 1e-3) > MILLIMETRE:
            depth = (depth * np.float32(unit)).astype(np.float32)
        return self._time(frame), depth

    def _next(self) -> Any:
        try:
            if self._pipeline is not None:
                return self._pipeline.wait_for_frames(TIMEOUT).get_depth_frame()
            return self._source.wait_for_frame(TIMEOUT).as_depth_frame()
        except RuntimeError as error:
            raise InputError(f"no picture came for {1e-3 * TIMEOUT:g} s: {error}") from None

    def _time(self, frame: Any) -> float:
        """When it was taken, on our clock.

        Stamps of the host's clock are moved by what the clocks differ; those of the camera's own as if the
        picture that came quickest had come at once.
        """
        stamp, now = 1e-3 * frame.get_timestamp(), self._clock()
        if frame.frame_timestamp_domain == self._rs.timestamp_domain.hardware_clock:
            self._offset = min(self._offset, now - stamp)
        else:
            self._offset = now - time.time()
        return float(stamp + self._offset)
