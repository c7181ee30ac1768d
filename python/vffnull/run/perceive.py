"""A recording replayed through a perceiver: what is the arm, what is left, what moves, what it costs."""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from vffnull._core import Arm, Perceiver, surface_distances
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.files import apart, replacing
from vffnull._support.progress import Progress
from vffnull.logs import ros2
from vffnull.run.recording import Cell, Shot, State

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vffnull.model.obstacle import Obstacle

    Array = NDArray[np.float64]

__all__ = ["CameraReport", "PerceptionReport", "TrackReport", "perceive"]

_RECENT = 32  # states, which are more than a perceiver drops at once
_LINKS = 10  # of so many pictures one is asked which link its points are on


@dataclass
class CameraReport:
    """What became of the pictures of a camera. Times are in seconds; counts of pixels are of all pictures."""

    topic: str
    pictures: int = 0
    refused: dict[str, int] = field(default_factory=dict)
    """Pictures that could not be taken in, by the reason."""
    measured: int = 0
    own: int = 0
    left_out: int = 0
    own_by_link: dict[str, float] = field(default_factory=dict)
    """Of what was cut away the share of each link, from every tenth picture."""
    period: float = 0.0
    gaps: int = 0
    """Times between two pictures that are longer than one and a half of the usual one; the longest."""
    longest: float = 0.0
    delay: tuple[float, float] = (0.0, 0.0)
    """From when a picture was taken until it was recorded, median and 99th percentile."""
    cost: tuple[float, float] = (0.0, 0.0)
    """Of taking it in, median and 99th percentile."""
    moved: float = 0.0
    turned: float = 0.0
    """How far the recording moves the camera, which has to stand still [m, rad]."""


@dataclass
class TrackReport:
    """A body that moved for certain, as it was seen last."""

    number: int
    camera: str
    since: float
    until: float
    position: list[float]
    velocity: list[float]
    fastest: float


@dataclass
class PerceptionReport:
    """What `perceive` found in a recording."""

    duration: float
    states: int
    late_states: int
    """States that are no later than the one before, which are left out."""
    unusable_states: dict[str, int]
    """States that are left out, by the topic, what is wrong with them, and when the first one was said."""
    points: tuple[int, int]
    """How many there were, median and most."""
    cameras: list[CameraReport]
    tracks: list[TrackReport]
    files: list[str] = field(default_factory=list)

    @property
    def refused(self) -> int:
        """Pictures that could not be taken in."""
        return sum(sum(each.refused.values()) for each in self.cameras)

    def to_dict(self) -> dict[str, Any]:
        """Names and numbers, as for JSON."""
        return asdict(self)


class _Painter(Protocol):
    def __call__(self, shot: Shot, perceiver: Perceiver) -> None: ...


def perceive(
    recording: str | os.PathLike[str],
    arm: Arm,
    *,
    settings: Mapping[str, Any] | None = None,
    known: Sequence[Obstacle | Mapping[str, Any]] = (),
    cameras: Mapping[str, Mapping[str, Any]] | None = None,
    topics: Sequence[str] = (),
    base: str | None = None,
    joints: Sequence[str] = (),
    out: str | os.PathLike[str] | None = None,
    progress: Progress | None = None,
) -> PerceptionReport:
    """Replay a recording of depth cameras and joints through a `vffnull.Perceiver`.

    It is read as a stream in the order of log time: a picture is taken in with the states that had come until
    then, as on the robot.

    Parameters
    ----------
    recording : str or path
        An MCAP file with ROS 2 messages: ``sensor_msgs`` ``Image`` (``16UC1`` [mm], ``32FC1`` [m]),
        ``CompressedImage`` (``compressedDepth``) or ``PointCloud2``, ``CameraInfo`` and ``JointState``, and
        ``tf2_msgs`` ``TFMessage``.
    arm : Arm
        The arm that is in the pictures.
    settings : Mapping, optional
        Settings of the perceiver.
    known : sequence of Obstacle or Mapping, optional
        What stands around and is not to be seen again.
    cameras : Mapping, optional
        What the recording does not say of its cameras, or says wrongly: a mapping of each, by topic, with
        keys as of `vffnull.Perceiver`, and ``time_offset`` [s], which is added to the times of its pictures.
    topics : sequence of str, optional
        The topics of the pictures; by default all that have depths.
    base : str, optional
        The frame at the base of the arm; that of the model by default.
    joints : sequence of str, optional
        What the recording calls the joints, from the base; by default as the model does.
    out : str or path, optional
        Where points and tracks go: ``.mcap``, as ``PointCloud2`` on ``/vffnull/points`` and
        ``/vffnull/tracks``, or ``.rrd``.

    progress : callable, optional
        Gets how much of the recording is done, and all of it [s].

    Returns
    -------
    PerceptionReport
        Counts, tracks and costs.

    Raises
    ------
    vffnull.errors.InputError
        If the recording is broken, or does not say what a camera is, where it stands, or where joints are;
        or if `out` is the recording.
    ImportError
        Without the extra ``vffnull[mcap]``, or ``vffnull[rerun]`` for an ``.rrd``.

    Examples
    --------
    >>> report = perceive("cell.mcap", Arm.named("panda"))  # doctest: +SKIP
    >>> report.cameras[0].own / report.cameras[0].measured  # doctest: +SKIP
    0.14
    """
    target = None if out is None else Path(out)
    if target is not None and target.suffix not in (".mcap", ".rrd"):
        raise InputError(
            f"{target}: points are written as .mcap or .rrd, not {target.suffix or 'without an ending'}"
        )
    if target is not None:
        apart(target, recording)
    cell = Cell(Path(recording), arm, cameras=cameras, topics=topics, base=base, joints=joints)
    perceiver = Perceiver(arm, cell.cameras, dict(settings or {}), list(known))
    with ExitStack() as stack:
        paint = stack.enter_context(_painter(target, cell))
        report = _Replay(cell, perceiver, paint).run(progress)
    report.files = [] if target is None else [str(target)]
    return report


class _Replay:
    """One pass through a recording."""

    def __init__(self, cell: Cell, perceiver: Perceiver, paint: _Painter | None) -> None:
        self._cell, self._perceiver, self._paint = cell, perceiver, paint
        self._cameras = [CameraReport(source.topic) for source in cell.sources]
        count = range(len(self._cameras))
        self._taken: list[list[float]] = [[] for _ in count]
        self._delays: list[list[float]] = [[] for _ in count]
        self._costs: list[list[float]] = [[] for _ in count]
        self._links: list[Counter[str]] = [Counter() for _ in count]
        self._refused: list[Counter[str]] = [Counter() for _ in count]
        self._tracks: dict[tuple[int, int], TrackReport] = {}
        self._points: list[int] = []
        self._unusable: dict[str, list[float]] = {}
        self._recent: deque[State] = deque(maxlen=_RECENT)

    def run(self, progress: Progress | None) -> PerceptionReport:
        states, late, end = 0, 0, 0.0
        _, duration = ros2.outline(self._cell.path)
        for event in self._cell.events():
            if isinstance(event, Shot):
                end = max(end, event.arrived)
                self._see(event)
                if progress is not None and duration > 0.0:
                    progress(min(end, duration), duration)
                continue
            states, end = states + 1, max(end, event.arrived)
            if not event.is_finite:
                self._leave_out(event, "not finite")
                continue
            try:
                self._perceiver.observe(event.t, event.q, event.dq)
            except InputError:  # all else has been looked at before
                late += 1
                continue
            while self._recent and self._recent[-1].t >= event.t:  # the perceiver has dropped it
                self._leave_out(self._recent.pop(), "with a time from the future")
            self._recent.append(event)
        for number, camera in enumerate(self._cameras):
            self._sum_up(number, camera)
        points = (int(np.median(self._points)), max(self._points)) if self._points else (0, 0)
        unusable = {
            f"{what}, the first after {min(times):.3f} s": len(times)
            for what, times in self._unusable.items()
        }
        return PerceptionReport(
            end,
            states,
            late,
            unusable,
            points,
            self._cameras,
            list(self._tracks.values()),
        )

    def _leave_out(self, state: State, why: str) -> None:
        self._unusable.setdefault(f"{state.topic}: {why}", []).append(state.arrived)

    def _see(self, shot: Shot) -> None:
        camera, number = self._cameras[shot.camera], shot.camera
        begun = time.perf_counter()
        try:
            if shot.depth is not None:
                counts = self._perceiver.see(shot.depth, shot.t, number)
            else:
                assert shot.cloud is not None  # it is one or the other
                counts = self._perceiver.see_points(shot.cloud, shot.t, number)
        except InputError as error:
            self._refused[number][_reason(str(error))] += 1
            return
        self._costs[number].append(time.perf_counter() - begun)
        self._taken[number].append(shot.t)
        self._delays[number].append(shot.arrived - shot.t + self._cell.sources[number].time_offset)
        camera.pictures += 1
        for name in ("measured", "own", "left_out"):
            setattr(camera, name, getattr(camera, name) + counts[name])
        points = self._perceiver.points
        self._points.append(len(points))
        if camera.pictures % _LINKS == 1:
            self._ask_links(shot)
        for track in self._perceiver.tracks:
            if track["moves"] and track["camera"] == number and track["t"] == self._perceiver.t:
                self._follow(track)
        if self._paint is not None:
            self._paint(shot, self._perceiver)

    def _ask_links(self, shot: Shot) -> None:
        """Which links the points are on that lie on the arm."""
        arm, camera = self._cell.arm, self._cell.sources[shot.camera].camera
        if not self._recent:
            return
        seen = shot.cloud if shot.depth is None else self._perceiver.deproject(shot.depth, shot.camera)
        distances, links = surface_distances(arm, self._recent[-1].q, in_world(camera, seen))
        own, names = links[distances < _near(self._perceiver)], ["base", *arm.link_names]
        self._links[shot.camera].update({names[k + 1]: int((own == k).sum()) for k in np.unique(own)})

    def _follow(self, track: dict[str, Any]) -> None:
        speed = float(np.linalg.norm(track["velocity"]))
        key = (track["camera"], track["number"])
        found = self._tracks.setdefault(
            key,
            TrackReport(track["number"], self._cameras[track["camera"]].topic, track["t"], 0.0, [], [], 0.0),
        )
        found.until = track["t"]
        found.position, found.velocity = track["position"].tolist(), track["velocity"].tolist()
        found.fastest = max(found.fastest, speed)

    def _sum_up(self, number: int, camera: CameraReport) -> None:
        camera.refused = dict(self._refused[number])
        source = self._cell.sources[number]
        camera.moved, camera.turned = source.moved, source.turned
        total = sum(self._links[number].values())
        camera.own_by_link = {name: count / total for name, count in self._links[number].most_common()}
        between = np.diff(np.sort(self._taken[number]))
        if between.size:
            camera.period, camera.longest = float(np.median(between)), float(between.max())
            camera.gaps = int((between > 1.5 * camera.period).sum())
        if camera.pictures:
            camera.delay = _percentiles(self._delays[number])
            camera.cost = _percentiles(self._costs[number])


def in_world(camera: Mapping[str, Any], points: Any) -> Any:
    """Points in the frame of a camera, in the world."""
    from vffnull._core import matrices

    turn = np.array(camera.get("orientation", [1.0, 0.0, 0.0, 0.0]), float)
    return points @ matrices(turn / np.linalg.norm(turn)).T + np.array(camera.get("position", [0.0] * 3))


def _near(perceiver: Perceiver) -> float:
    return float(2.0 * perceiver.radius)


def _percentiles(values: list[float]) -> tuple[float, float]:
    middle, high = np.percentile(values, [50, 99])
    return float(middle), float(high)


def _reason(sentence: str) -> str:
    if "no state of the arm" in sentence:
        return "no state of the arm near its time"
    if "after the last one" in sentence:
        return "no later than the one before"
    return sentence


@contextmanager
def _painter(target: Path | None, cell: Cell) -> Iterator[_Painter | None]:
    """Where points and tracks go."""
    if target is None:
        yield None
        return
    with replacing(target) as draft:
        if target.suffix == ".mcap":
            with ros2.Recorder(draft) as file:
                yield _ros2_painter(file, cell)
        else:
            rr = extra("rerun", "rerun")
            with rr.RecordingStream("vffnull") as log:
                log.save(str(draft))
                yield _rerun_painter(rr, log, cell)
                log.flush()


def _moving(perceiver: Perceiver) -> list[dict[str, Any]]:
    return [track for track in perceiver.tracks if track["moves"]]


def _ros2_painter(file: ros2.Recorder, cell: Cell) -> _Painter:
    base = cell.arm.to_dict().get("base", "base")

    def paint(shot: Shot, perceiver: Perceiver) -> None:
        velocities = dict(zip(("vx", "vy", "vz"), perceiver.velocities.T, strict=True))
        file.points("/vffnull/points", shot.t, perceiver.points, velocities, frame=base, arrived=shot.arrived)
        tracks = _moving(perceiver)
        places = np.array([track["position"] for track in tracks]).reshape(-1, 3)
        rates = np.array([track["velocity"] for track in tracks]).reshape(-1, 3)
        more = dict(zip(("vx", "vy", "vz"), rates.T, strict=True))
        more["number"] = np.array([track["number"] for track in tracks], float)
        file.points("/vffnull/tracks", shot.t, places, more, frame=base, arrived=shot.arrived)

    return paint


def _rerun_painter(rr: Any, log: Any, cell: Cell) -> _Painter:
    log.log("cell", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    names = [source.topic.strip("/").replace("/", "_") for source in cell.sources]
    for name, source in zip(names, cell.sources, strict=True):
        camera = source.camera
        w, x, y, z = camera["orientation"]
        where = rr.Transform3D(translation=camera["position"], quaternion=[x, y, z, w])
        lens = rr.Pinhole(
            focal_length=camera["focal"],
            principal_point=camera["centre"],
            resolution=[camera["columns"], camera["rows"]],
            image_plane_distance=0.2,
        )
        log.log(f"cell/{name}", where, static=True)
        log.log(f"cell/{name}/picture", lens, static=True)

    def paint(shot: Shot, perceiver: Perceiver) -> None:
        log.set_time("t", duration=shot.t)
        name, camera = names[shot.camera], cell.sources[shot.camera].camera
        seen = shot.cloud
        if shot.depth is not None:
            meter = 1000.0 if shot.depth.dtype == np.uint16 else 1.0
            log.log(f"cell/{name}/picture", rr.DepthImage(shot.depth, meter=meter))
            seen = perceiver.deproject(shot.depth, shot.camera)
        log.log(f"cell/seen/{name}", rr.Points3D(in_world(camera, seen), radii=0.003, colors=(150, 150, 150)))
        speeds = np.linalg.norm(perceiver.velocities, axis=1)
        colours = np.where(speeds[:, None] > 0.0, (220, 60, 30), (40, 110, 200)).astype(np.uint8)
        log.log("cell/left", rr.Points3D(perceiver.points, radii=perceiver.radius, colors=colours))
        tracks = _moving(perceiver)
        arrows = rr.Arrows3D(
            origins=[track["position"] for track in tracks],
            vectors=[track["velocity"] for track in tracks],
            labels=[str(track["number"]) for track in tracks],
        )
        log.log("cell/tracks", arrows)

    return paint
