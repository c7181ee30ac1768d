"""Whether the arm in pictures lies where the model says, and how cameras and clocks are off (T185)."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._core import Arm, Perceiver, matrices, quaternions, surface_distances
from vffnull._support.arguments import positive
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.run.perceive import in_world
from vffnull.run.recording import Cell, State

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["CameraCalibration", "calibrate"]

PICTURES = 80  # of a camera, evenly over the recording
POINTS = 250  # of a picture, near the arm
PIXELS = 20_000  # of a picture, evenly
STATES = 20_000
CLOCK = 0.2  # s: so near to the beginning and the end no picture is used, as its clock may be off
GAP = 0.1  # s: nor where no state is known for longer
GATES = (0.12, 0.06, 0.03)  # m: what is farther from the model is not the arm
TIGHT = 0.006  # m: nearer than this no point is left out
STEP = 1e-5  # m, rad, s: of differences
LOSS = 0.004  # m: residuals beyond are weighed less
LEAST = 200  # points without which nothing is said
LEAP = 1.0  # s: a state that is later by more than this has leapt, as a perceiver takes it
MOTION = 0.05  # rad/s: an arm that is slower throughout does not tell the time


@dataclass(frozen=True)
class CameraCalibration:
    """How a camera is off. Standard deviations are those of the scatter between pictures."""

    topic: str
    pictures: int
    points: int
    """Of the arm, that the correction is from."""
    translation: list[float]
    """From where it is said to stand to where it stands, in the world [m]."""
    rotation: list[float]
    """Likewise, a rotation vector in the axes of the world [rad]."""
    time_offset: float | None
    """What has to be added to the times of its pictures [s]; None where the arm hardly moves."""
    translation_deviation: float
    """Of the translation [m], as its length."""
    rotation_deviation: float
    """Of the rotation [rad]."""
    time_deviation: float | None
    before: float
    """Median distance of the arm's points from the surface of the model, without the correction [m]."""
    after: float
    """With it."""
    bias: float
    """Mean distance with it [m]; negative where the shapes are larger than the arm."""
    camera: dict[str, Any]
    """The camera with the correction, as `vffnull.Perceiver` wants it."""

    def to_dict(self) -> dict[str, Any]:
        """Names and numbers, as for JSON."""
        return asdict(self)


def calibrate(
    recording: str | os.PathLike[str],
    arm: Arm,
    *,
    cameras: Mapping[str, Mapping[str, Any]] | None = None,
    topics: Sequence[str] = (),
    base: str | None = None,
    joints: Sequence[str] = (),
    max_depth: float = 3.0,
) -> list[CameraCalibration]:
    """Compare the arm in the pictures of a recording with its model: how each camera, and its clock, is off.

    The arm has to move, and nobody should be near it. Its points are laid on the surface of the model by a
    rigid correction of the camera and a shift of its clock. What is estimated is as good as the shapes of
    the model: where capsules are wider than the arm, a correction along the view takes a part of that, and
    ``bias`` the rest.

    Parameters
    ----------
    recording, arm, cameras, topics, base, joints
        As of `vffnull.perceive`.
    max_depth : float, optional
        What is deeper in the picture is left out [m].

    Returns
    -------
    list of CameraCalibration
        One for each camera.

    Raises
    ------
    vffnull.errors.InputError
        As of `vffnull.perceive`; or if too little of the arm is seen within 12 cm of its model.
    ImportError
        Without the extras ``vffnull[mcap]`` and ``vffnull[evaluate]``.

    Examples
    --------
    >>> for found in calibrate("cell.mcap", Arm.named("panda")):  # doctest: +SKIP
    ...     print(found.topic, found.translation, found.time_offset)
    """
    extra("scipy.optimize", "evaluate")
    cell = Cell(Path(recording), arm, cameras=cameras, topics=topics, base=base, joints=joints)
    course, shots = _gathered(cell, positive("max_depth", max_depth))
    return [_fit(cell, number, course, shots[number]) for number in range(len(cell.sources))]


@dataclass(frozen=True)
class _Frame:
    """A picture: its time, and points in the frame of its camera."""

    t: float
    points: Array


class _Thinned:
    """A list of bounded length that keeps every so manieth of what comes, evenly from the first on."""

    def __init__(self, most: int) -> None:
        self._most, self._step, self._count = most, 1, 0
        self.kept: list[Any] = []

    def wants(self) -> bool:
        """Whether the next one is to be kept."""
        if len(self.kept) >= 2 * self._most:
            del self.kept[1::2]
            self._step *= 2
        self._count += 1
        return (self._count - 1) % self._step == 0


def _gathered(cell: Cell, max_depth: float) -> tuple[Any, list[list[_Frame]]]:
    """The course of the arm, and pictures of each camera that were taken while it was known."""
    interpolate = extra("scipy.interpolate", "evaluate")
    stride = max(1, int(min(np.sqrt(c["rows"] * c["columns"] / PIXELS) for c in cell.cameras)))
    reader = Perceiver(cell.arm, cell.cameras, {"stride": stride, "range": max_depth, "voxel": 0.2})
    states, frames = _Thinned(STATES), [_Thinned(PICTURES) for _ in cell.sources]
    before = last = -np.inf
    for event in cell.events():
        if isinstance(event, State):
            if not event.is_finite:
                continue
            if before < event.t <= before + LEAP < last:  # the last one was stamped wrongly
                if states.kept and states.kept[-1].t == last:
                    states.kept.pop()
                last = before
            if event.t > last:
                if states.wants():
                    states.kept.append(event)
                before, last = last, event.t
        elif frames[event.camera].wants():
            seen = event.cloud
            if event.depth is not None:
                seen = reader.deproject(event.depth, event.camera)
            points = np.asarray(seen)
            frames[event.camera].kept.append(_Frame(event.t, points[points[:, 2] < max_depth]))
    if len(states.kept) < 2:
        raise InputError(f"{cell.path}: too few states of the joints")
    t, q, dq = (np.array([getattr(each, name) for each in states.kept]) for name in ("t", "q", "dq"))
    between = np.diff(t)
    longest = max(GAP, 3.0 * float(np.median(between)))

    def is_known(frame: _Frame) -> bool:
        after = np.searchsorted(t, frame.t)
        inside = t[0] + CLOCK < frame.t < t[-1] - CLOCK
        return bool(inside and between[after - 1] < longest)

    course = interpolate.CubicHermiteSpline(t, q, dq)
    return course, [[frame for frame in each.kept if is_known(frame)] for each in frames]


def _fit(cell: Cell, number: int, course: Any, frames: list[_Frame]) -> CameraCalibration:
    """Lay the points of a camera on the arm."""
    optimize = extra("scipy.optimize", "evaluate")
    source = cell.sources[number]
    moves = bool(frames) and float(np.abs(course(np.array([f.t for f in frames]), 1)).max()) > MOTION
    model = _Surface(cell.arm, source.camera, course, 7 if moves else 6)
    found, chosen = np.zeros(model.size), frames
    random = np.random.default_rng(0)
    gates, residuals = list(GATES), np.zeros(0)
    while gates:
        gate = gates.pop(0)
        near = (model.near(frame, found, gate, random) for frame in frames)
        chosen = [each for each in near if len(each.points)]
        count = sum(len(each.points) for each in chosen)
        if count < LEAST:
            raise InputError(
                f"{source.topic}: {count} points in {len(frames)} pictures lie within {gate:g} m of the arm "
                "where the model says; too few to say by how much the camera is off"
            )
        done = optimize.least_squares(
            model.residuals,
            found,
            model.jacobian,
            args=(chosen,),
            loss="soft_l1",
            f_scale=LOSS,
            x_scale=model.scale,
        )
        found, residuals = done.x, model.residuals(done.x, chosen)
        if gate == GATES[-1]:  # and once more, by how the points scatter
            gates.append(max(TIGHT, 6.0 * float(np.median(np.abs(residuals)))))
    deviations = _deviations(model, found, chosen)
    axes = _rotation(found[:3]) @ matrices(_unit(source.camera))
    place = np.array(source.camera["position"]) + found[3:6]
    offset = float(found[6]) if moves else None
    corrected = source.camera | {"position": place.tolist(), "orientation": quaternions(axes).tolist()}
    return CameraCalibration(
        topic=source.topic,
        pictures=len(chosen),
        points=len(residuals),
        translation=found[3:6].tolist(),
        rotation=found[:3].tolist(),
        time_offset=None if offset is None else offset + source.time_offset,
        translation_deviation=float(np.linalg.norm(deviations[3:6])),
        rotation_deviation=float(np.linalg.norm(deviations[:3])),
        time_deviation=float(deviations[6]) if moves else None,
        before=float(np.median(np.abs(model.residuals(np.zeros(model.size), chosen)))),
        after=float(np.median(np.abs(residuals))),
        bias=float(np.mean(residuals)),
        camera=corrected,
    )


class _Surface:
    """Distances of points from the arm, by a rotation vector, a translation and a shift in time."""

    def __init__(self, arm: Arm, camera: dict[str, Any], course: Any, size: int) -> None:
        self._arm, self._course, self.size = arm, course, size
        self._camera, self._origin = camera, np.array(camera["position"])
        self.scale = np.full(size, 0.01)

    def _distances(self, x: Array, frame: _Frame) -> tuple[Array, NDArray[np.int64]]:
        turned = (in_world(self._camera, frame.points) - self._origin) @ _rotation(x[:3]).T
        t = frame.t + (x[6] if self.size > 6 else 0.0)
        q = self._course(np.clip(t, self._course.x[0], self._course.x[-1]))
        distances, links = surface_distances(self._arm, q, turned + self._origin + x[3:6])
        return distances, links

    def residuals(self, x: Array, frames: list[_Frame]) -> Array:
        return np.concatenate([self._distances(x, frame)[0] for frame in frames])

    def jacobian(self, x: Array, frames: list[_Frame]) -> Array:
        steps = STEP * np.eye(self.size)
        columns = [
            (self.residuals(x + e, frames) - self.residuals(x - e, frames)) / (2.0 * STEP) for e in steps
        ]
        return np.stack(columns, axis=-1)

    def near(self, frame: _Frame, x: Array, gate: float, random: np.random.Generator) -> _Frame:
        """What of a picture may be a link that moves: on the base stands what it is mounted on."""
        distances, links = self._distances(x, frame)
        own = np.flatnonzero((np.abs(distances) < gate) & (links >= 0))
        if len(own) > POINTS:
            own = random.choice(own, POINTS, replace=False)
        return _Frame(frame.t, frame.points[own])


def _deviations(model: _Surface, x: Array, frames: list[_Frame]) -> Array:
    """Standard deviations from the scatter between pictures: points of one are not independent."""
    normal, scatter = np.zeros((model.size, model.size)), np.zeros((model.size, model.size))
    for frame in frames:
        residual, J = model.residuals(x, [frame]), model.jacobian(x, [frame])
        weight = 1.0 / np.sqrt(1.0 + (residual / LOSS) ** 2)  # of the loss soft_l1
        normal += J.T @ (weight[:, None] * J)
        pull = J.T @ (weight * residual)
        scatter += np.outer(pull, pull)
    inverse = np.linalg.pinv(normal)
    count = len(frames)
    deviations: Array = np.sqrt(np.diag(inverse @ scatter @ inverse) * count / max(count - 1, 1))
    return deviations


def _rotation(vector: Array) -> Array:
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0.0 else vector
    found: Array = matrices(np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * axis)]))
    return found


def _unit(camera: Mapping[str, Any]) -> Array:
    turn = np.array(camera["orientation"], float)
    unit: Array = turn / np.linalg.norm(turn)
    return unit
