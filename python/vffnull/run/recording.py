"""A recording of a robot's cell: which cameras looked, where they stood, what they and the joints said."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._core import Arm, matrices, quaternions
from vffnull._support.arguments import number
from vffnull._support.errors import InputError
from vffnull._support.files import read_text
from vffnull.logs import ros2

__all__ = ["Cell", "Shot", "Source", "State", "read_cameras"]

Array = NDArray[np.float64]

_ENOUGH = 3_000_000_000  # ns after which no other camera is waited for, once all that were seen are known
_STILL = (0.002, 0.004)  # m, rad: a camera that is off by more than this has moved
KEYS = ("columns", "rows", "focal", "centre", "distortion", "position", "orientation")


@dataclass
class Source:
    """A camera of a recording: its topic, what a perceiver is told of it, and how its clock is off."""

    topic: str
    camera: dict[str, Any]
    time_offset: float = 0.0
    moved: float = 0.0
    turned: float = 0.0
    """How far it has gone from where it stood at first [m, rad]; 0 where that is no more than rounding."""
    chain: frozenset[str] = frozenset()
    """The frames by which it is known where it stands."""
    frame: str = ""


@dataclass(frozen=True)
class State:
    """Where the arm was at a time [s], when that was said [s], and on which topic."""

    t: float
    q: Array
    dq: Array
    arrived: float
    topic: str

    @property
    def is_finite(self) -> bool:
        """Whether it says where the arm was."""
        return bool(np.isfinite(self.q).all() and np.isfinite(self.dq).all())


@dataclass(frozen=True)
class Shot:
    """A picture (rows, columns) or a cloud (k, 3), when it was taken and when it came [s]."""

    camera: int
    t: float
    arrived: float
    depth: NDArray[Any] | None
    cloud: Array | None


def read_cameras(path: Path) -> dict[str, dict[str, Any]]:
    """What a TOML file says of cameras: a table of each, by its topic, with `KEYS` and ``time_offset``."""
    try:
        text = read_text(path)
    except UnicodeDecodeError:
        raise InputError(f"{path}: is no file of text in UTF-8") from None
    document = _core.parse_toml(text, str(path))
    for topic, given in document.items():
        if not isinstance(given, dict):
            raise InputError(f'{path}: {topic}: expected a table ["TOPIC"], got {given!r}')
        for key in given:
            if key not in (*KEYS, "time_offset"):
                raise InputError(f"{path}: {topic}.{key}: unknown, expected {', '.join(KEYS)}, time_offset")
    return document


@dataclass
class _Known:
    """What the beginning of a recording says."""

    lenses: dict[str, ros2.Lens] = field(default_factory=dict)
    frames: dict[str, ros2.Transform] = field(default_factory=dict)
    pictures: dict[str, ros2.Picture] = field(default_factory=dict)
    names: set[str] = field(default_factory=set)
    first: int | None = None


class Cell:
    """The cameras of a recording around an arm, and what was said in the order of log time.

    Parameters
    ----------
    path : Path
        The recording, an MCAP file with ROS 2 messages.
    arm : Arm
        The arm that is in it.
    cameras : Mapping, optional
        What the recording does not say, or says wrongly: by topic, as of `read_cameras`.
    topics : sequence of str, optional
        The topics of the pictures; all that have depths by default, and of a camera with both no clouds.
    base : str, optional
        The frame at the base of the arm; that of the model by default.
    joints : sequence of str, optional
        What the recording calls the joints, from the base; as the model does by default.
    """

    def __init__(
        self,
        path: Path,
        arm: Arm,
        *,
        cameras: Mapping[str, Mapping[str, Any]] | None = None,
        topics: Sequence[str] = (),
        base: str | None = None,
        joints: Sequence[str] = (),
    ) -> None:
        self.path, self.arm = path, arm
        about = arm.to_dict()
        self._base = base or about.get("base", "base")
        self._mount = _pose(about.get("mount") or {})
        self.joints = list(joints) or list(arm.joint_names)
        if len(self.joints) != arm.n:
            raise InputError(f"joints: expected {arm.n} names, got {len(self.joints)}")
        self._only = tuple(topics) or None
        given = dict(cameras or {})
        known = self._look(given)
        self._frames = known.frames
        self._start = known.first or 0
        self.sources = self._sources(known, given)
        if not set(self.joints) <= known.names:
            missing = [name for name in self.joints if name not in known.names]
            there = f"it has {', '.join(sorted(known.names)[:20])}" if known.names else "it has none"
            raise InputError(f"{path}: no message tells of the joints {', '.join(missing)}; {there}")

    @property
    def cameras(self) -> list[dict[str, Any]]:
        """As `vffnull.Perceiver` wants them."""
        return [each.camera for each in self.sources]

    def _look(self, given: dict[str, Any]) -> _Known:
        """Read until all cameras are known that there seem to be."""
        known = _Known()
        for message in ros2.messages(self.path, self._only):
            match message:
                case ros2.Lens():
                    known.lenses.setdefault(message.topic, message)
                case ros2.Transform():
                    known.frames.setdefault(message.child, message)
                    continue
                case ros2.Picture():
                    known.pictures.setdefault(message.topic, message)
                case ros2.Joints():
                    known.names |= set(message.names)
            if isinstance(message, ros2.Lens):
                continue
            if known.first is None:
                known.first = message.arrived
            is_late = message.arrived > known.first + _ENOUGH
            if is_late and known.pictures and set(self.joints) <= known.names:
                try:
                    self._sources(known, given)
                except InputError:
                    continue  # it may be said later
                break
        return known

    def _sources(self, known: _Known, given: dict[str, Any]) -> list[Source]:
        pictures = dict(known.pictures)
        if not pictures:
            what = f" on {', '.join(self._only)}" if self._only else ""
            kinds, _ = ros2.outline(self.path)
            there = ", ".join(f"{name} ({kind})" for name, kind in sorted(kinds.items()))
            raise InputError(f"{self.path}: no pictures with depths{what}; it has {there or 'nothing'}")
        if unknown := set(given) - set(pictures):
            raise InputError(f"cameras: no pictures on {sorted(unknown)[0]}; there are {', '.join(pictures)}")
        if self._only is None:  # a camera's cloud is made of its pictures
            seen = {self._lens(each, known) for each in pictures.values() if each.depth is not None} - {None}
            pictures = {
                topic: each
                for topic, each in pictures.items()
                if each.depth is not None or self._lens(each, known) not in seen
            }
        return [
            self._source(each, known, dict(given.get(topic, {}))) for topic, each in sorted(pictures.items())
        ]

    @staticmethod
    def _lens(picture: ros2.Picture, known: _Known) -> str | None:
        """Where the camera of a picture tells of itself: beside it, above it, or with its frame."""
        folder = picture.topic
        while folder := folder.rpartition("/")[0]:
            if f"{folder}/camera_info" in known.lenses:
                return f"{folder}/camera_info"
        same = (topic for topic, lens in known.lenses.items() if lens.frame == picture.frame)
        return next(same, None)

    def _source(self, picture: ros2.Picture, known: _Known, given: dict[str, Any]) -> Source:
        topic = picture.topic
        offset = number(f"cameras.{topic}.time_offset", given.pop("time_offset", 0.0))
        if not np.isfinite(offset):
            raise InputError(f"cameras.{topic}.time_offset: must be finite, got {offset}")
        camera: dict[str, Any] = {}
        lens = self._lens(picture, known)
        if lens is not None:
            camera = _intrinsics(known.lenses[lens], topic, picture)
        elif not {"columns", "rows", "focal", "centre"} <= given.keys():
            raise InputError(
                f"{self.path}: {topic}: no camera_info beside it, nor with its frame {picture.frame!r}; "
                "say columns, rows, focal and centre in a file of cameras"
            )
        chain: frozenset[str] = frozenset()
        if not {"position", "orientation"} <= given.keys():
            pose, chain = self._stands(picture.frame, known.frames, topic)
            camera["position"] = pose[:3, 3].tolist()
            camera["orientation"] = quaternions(pose[:3, :3]).tolist()
        return Source(topic, camera | given, offset, chain=chain, frame=picture.frame)

    def _stands(
        self, frame: str, frames: dict[str, ros2.Transform], topic: str
    ) -> tuple[Array, frozenset[str]]:
        """The pose of a frame in the world of the arm, and the frames on the way."""
        (root, pose, above), (other, base, below) = (_to_root(name, frames) for name in (frame, self._base))
        if root != other:
            known = sorted({name for each in frames.values() for name in (each.parent, each.child)})
            why = f"one ends at {root!r}, the other at {other!r}"
            if self._base not in known:
                why = f"no frame is called {self._base!r}, there are {', '.join(known[:20]) or 'none'}"
            raise InputError(
                f"{self.path}: {topic}: no transform leads from {frame!r} to the base {self._base!r}: {why}; "
                "name another base, or say position and orientation in a file of cameras"
            )
        return self._mount @ np.linalg.inv(base) @ pose, above | below

    def events(self) -> Iterator[State | Shot]:
        """What was said, in the order of log time; times count from the beginning of the recording."""
        numbers = {source.topic: k for k, source in enumerate(self.sources)}
        frames, before = dict(self._frames), None
        chains = frozenset[str]().union(*(source.chain for source in self.sources))
        for message in ros2.messages(self.path, list(numbers)):
            match message:
                case ros2.Transform() if message.child in chains and message != frames.get(message.child):
                    frames[message.child] = message
                    self._watch(frames)
                case ros2.Joints() if set(self.joints) <= set(message.names):
                    t = self._seconds(message.stamp)
                    at = [message.names.index(name) for name in self.joints]
                    q = message.q[at]
                    if (
                        message.dq is not None and not np.isnan(message.dq[at]).all()
                    ):  # as drivers without say
                        dq = message.dq[at]
                    elif before is not None and t > before.t:
                        dq = (q - before.q) / (t - before.t)
                    else:
                        dq = np.zeros_like(q)
                    state = State(t, q, dq, self._seconds(message.arrived), message.topic)
                    if state.is_finite:
                        before = state
                    yield state
                case ros2.Picture():
                    number = numbers[message.topic]
                    t = self._seconds(message.stamp) + self.sources[number].time_offset
                    yield Shot(number, t, self._seconds(message.arrived), message.depth, message.cloud)

    def _watch(self, frames: dict[str, ros2.Transform]) -> None:
        """See whether a camera still stands where it stood."""
        for source in self.sources:
            if not source.chain:
                continue
            pose, _ = self._stands(source.frame, frames, source.topic)
            off = float(np.linalg.norm(pose[:3, 3] - source.camera["position"]))
            turned = pose[:3, :3] @ matrices(np.array(source.camera["orientation"])).T
            angle = float(np.arccos(np.clip(0.5 * (np.trace(turned) - 1.0), -1.0, 1.0)))
            if off > _STILL[0]:
                source.moved = max(source.moved, off)
            if angle > _STILL[1]:
                source.turned = max(source.turned, angle)

    def _seconds(self, stamp: int) -> float:
        return (stamp - self._start) * 1e-9


def _intrinsics(lens: ros2.Lens, topic: str, picture: ros2.Picture) -> dict[str, Any]:
    """What a message ``CameraInfo`` says of a camera; of a picture that is rectified without the lens."""
    rows, columns = lens.size
    if picture.depth is not None and picture.depth.shape != (rows, columns):
        raise InputError(
            f"{topic}: pictures are {picture.depth.shape}, and {lens.topic} says ({rows}, {columns})"
        )
    matrix, distortion = lens.K, lens.D
    if picture.cloud is not None or "rect" in topic.rpartition("/")[2]:
        distortion = []
        if lens.P[0] > 0.0:
            matrix = [*lens.P[:3], *lens.P[4:7]]
    bent = any(distortion)
    if bent and (lens.model not in ("plumb_bob", "rational_polynomial") or any(distortion[5:])):
        raise InputError(
            f"{lens.topic}: the lens is {lens.model} with {len(distortion)} numbers; plumb_bob with five is "
            "known. Record the rectified picture instead"
        )
    return {
        "columns": columns,
        "rows": rows,
        "focal": [matrix[0], matrix[4]],
        "centre": [matrix[2], matrix[5]],
        "distortion": [*distortion[:5], *[0.0] * 5][:5],
    }


def _pose(frame: Mapping[str, Any]) -> Array:
    pose = np.eye(4)
    pose[:3, 3] = frame.get("position", [0.0] * 3)
    turn = np.array(frame.get("orientation", [1.0, 0.0, 0.0, 0.0]), float)
    pose[:3, :3] = matrices(turn / np.linalg.norm(turn))
    return pose


def _to_root(name: str, frames: dict[str, ros2.Transform]) -> tuple[str, Array, frozenset[str]]:
    """The root above a frame, its pose there, and the frames on the way."""
    pose, passed = np.eye(4), set[str]()
    while name in frames and name not in passed:
        passed.add(name)
        found = frames[name]
        pose = _pose({"position": found.position, "orientation": found.orientation}) @ pose
        name = found.parent
    return name, pose, frozenset(passed)
