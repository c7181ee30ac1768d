"""Random scenes in space: published arms among bodies of 4 to 12 cm."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache

import numpy as np

import vffnull._core as _core
from vffnull._support.arguments import whole
from vffnull._support.errors import InputError
from vffnull.evaluation.geometry.arm import product, rotation
from vffnull.evaluation.geometry.space import Bodies, Obstacles
from vffnull.evaluation.planner import travelled
from vffnull.evaluation.scenes.common import (
    EVALUATION,
    FAMILIES,
    Array,
    Document,
    Draw,
    Travel,
    push,
    rounded,
)
from vffnull.model.scenario import Scenario

__all__ = ["ARMS", "EVALUATED", "TASKS", "in_space"]

ARMS = ("panda", "iiwa14", "ur5e", "xarm7", "gen3")
"""Bundled arms that scenes are made for; the number of an arm's stream is its place here."""

EVALUATED = ARMS[:3]
"""Those of docs/evaluation-spatial.md, which are taken where none is named."""

TASKS = ("position", "pointing", "pose")
"""Tasks that scenes are made for; the number of a task's stream is its place here."""

DURATION = 4.0  # s
TRAVEL = Travel(DURATION, swing=(0.25, 0.5), away=(0.3, 0.7), wait=0.8, begin=0.4)
SIZE = (0.04, 0.12)  # m, the radius that holds a body

# Free space [m], to surfaces: without it, no motion could avoid contact.
_START = 0.08  # from every link to every obstacle at t = 0
_ITSELF = 0.05  # between links with two or more between them, all along the reference
_BASE = 0.08  # from the base and the first link, which cannot get out of the way, at all times
_SHOULDER = 0.22  # from the second joint, at all times: the second link turns about it
_HAND = 0.06  # from the last two links, which a held tip leaves little freedom; not on a blocked path
_END = 0.1  # path-crossed: from the last two links, once the tip is due at the end of the line
_FLOOR = 0.02  # from the plane that the base stands on to every link but the base

_LIMIT = 0.2  # rad, from joint limits, all along the reference
# Smallest eigenvalue of the inverse task inertia times the mass of the arm: 3 times the threshold of the law.
_DAMPED = 0.1
_SPEED = 0.6  # of the joints' speed limits, along the reference


# A usual posture, and how far starts are from it at most [rad].
_POSTURES = {
    "panda": ((0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854), (2.0, 0.7, 0.6, 0.5, 0.8, 0.6, 0.9)),
    "iiwa14": ((0.0, 0.6, 0.0, -1.6, 0.0, 0.9, 0.0), (2.0, 0.5, 0.6, 0.4, 0.8, 0.5, 0.9)),
    "xarm7": ((0.0, 0.3, 0.0, 1.6, 0.0, 1.2, 0.0), (2.0, 0.6, 0.6, 0.5, 0.8, 0.5, 0.9)),
    "gen3": ((0.0, 0.5, 0.0, 1.8, 0.0, 1.2, 0.0), (2.0, 0.6, 0.6, 0.4, 0.8, 0.4, 0.9)),
    "ur5e": ((0.0, -1.57, 1.57, -1.57, -1.57, 0.0), (2.0, 0.6, 0.6, 0.6, 0.7, 1.0)),
}


def in_space(family: str, arm: str, task: str, seed: int) -> Scenario:
    """Make a random scene in space.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    arm : str
        One of `ARMS`: a bundled arm, with its limits of joint angles, speeds and torques.
    task : {"position", "pointing", "pose"}
        What the arm has to do; a pose leaves a UR5e no freedom, the other arms one degree of it.
    seed : int
        Which scene; 0 to 999 999 for tuning, 1 000 000 to 1 999 999 for evaluation.

    Returns
    -------
    Scenario
        4 s at 1 kHz with the null-space field; `evaluate` puts other controllers in.

    Raises
    ------
    vffnull.errors.InputError
        If there is no such family, arm, task or seed.
    vffnull.errors.InputTypeError
        If the seed is no whole number.

    Examples
    --------
    >>> in_space("crowd", "panda", "pose", 0).name
    'crowd-panda-pose-0'
    """
    for name, value, known in (("family", family, FAMILIES), ("arm", arm, ARMS), ("task", task, TASKS)):
        if value not in known:
            raise InputError(f"{name}: expected one of {', '.join(known)}, not {value!r}")
    seed = whole("seed", seed, 0, EVALUATION.stop - 1)
    # The first number keeps these streams apart from those of the plane.
    draw = Draw((3, FAMILIES.index(family), ARMS.index(arm), TASKS.index(task), seed))
    while True:
        scene = _Scene.drawn(draw, arm, task, family)
        if scene is not None and _MAKE[family](scene, draw):
            return scene.scenario(seed)


@cache
def _bodies(arm: str) -> tuple[_core.Arm, Bodies]:
    made = _core.Arm.named(arm)
    return made, Bodies(made.to_dict())


class _Scene:
    """An arm in a random posture with a task, and the obstacles so far."""

    def __init__(self, family: str, name: str, task: str, reference: Document, motion: Array) -> None:
        self.family, self.name, self.task, self.reference = family, name, task, reference
        self.arm, self.bodies = _bodies(name)
        self.times = _instants()
        self.motion = motion  # joint angles that follow the reference, as long as nothing is in the way
        self.ends = self.bodies.ends(motion)
        last = self.arm.n - 1
        self._fixed = self.bodies.link <= 0
        self._hand = self.bodies.link >= last - 1
        self.swept = np.flatnonzero((self.bodies.link >= 1) & (self.bodies.link < last - 1))
        self.shoulder = self.bodies.arm.forward_kinematics(motion[0])[1]
        self.obstacles: list[Document] = []

    @classmethod
    def drawn(cls, draw: Draw, name: str, task: str, family: str) -> _Scene | None:
        """An arm that can follow a random reference; none if this one cannot."""
        arm, bodies = _bodies(name)
        q = np.array([usual + draw.uniform(-far, far) for usual, far in zip(*_POSTURES[name], strict=True)])
        q = np.round(q, 4)
        along: Array | None = None
        turn = np.zeros(3)
        time = 0.0
        if family in ("path-crossed", "clutter") or draw.whole(0, 1):
            shortest, longest = (0.05, 0.15) if family in ("links-swept", "crowd") else (0.2, 0.4)
            along = draw.uniform(shortest, longest) * draw.direction_in_space()
            turn = draw.uniform(0.0, 0.5) * draw.whole(0, 1) * draw.direction_in_space()
            time = draw.uniform(2.0, 3.0)
        motion = _following(arm, bodies, task, q, along, turn, time)
        if motion is None:
            return None
        reference: Document = {"kind": "setpoint"}
        if along is not None:
            reference = {"kind": "line", "end": rounded(along), "duration": time, "relative": True}
            if task != "position" and turn.any():
                reference["orientation"] = rounded(_turned(turn), 17)
        return cls(family, name, task, reference, motion)

    def place(self, obstacle: Document, *, hand: float, end: float = -math.inf, hits: bool = False) -> bool:
        """Put an obstacle in if it leaves the start, the base, the shoulder and the hand free.

        The hand by `hand` [m] at all times and by `end` [m] after the end of the reference; with `hits` only
        if it gets into a link that follows the reference as if nothing were there.
        """
        obstacles = Obstacles([obstacle])
        if obstacles.distances(self.ends[:1], self.bodies.radius, self.times[:1]).min() < _START:
            return False
        shoulder = np.broadcast_to(self.shoulder, (len(self.times), 1, 2, 3))
        if obstacles.distances(shoulder, np.zeros(1), self.times).min() < _SHOULDER:
            return False
        free = obstacles.distances(self.ends, self.bodies.radius, self.times)[..., 0]
        due = self.times >= self.reference.get("duration", 0.0)
        if free[:, self._fixed].min() < _BASE or free[:, self._hand].min() < hand:
            return False
        if free[due][:, self._hand].min() < end or (hits and free.min() > -0.01):
            return False
        self.obstacles.append(obstacle)
        return True

    def on_links(self, draw: Draw) -> Array:
        """A point on the axis of a link between shoulder and wrist, at the start or later."""
        body = self.swept[draw.whole(0, len(self.swept) - 1)]
        a, b = self.ends[draw.whole(0, len(self.times) - 1), body]
        point: Array = a + draw.uniform(0.0, 1.0) * (b - a)
        return point

    def on_path(self, time: float) -> Array:
        """Where the tip has to be."""
        q = self.motion[np.searchsorted(self.times, time)]
        point: Array = self.bodies.arm.forward_kinematics(q)[-1]
        return point

    def scenario(self, seed: int) -> Scenario:
        document = {
            "name": f"{self.family}-{self.name}-{self.task}-{seed}",
            "description": f"Random scene of the family {self.family}",
            "duration": DURATION,
            "q0": [float(q) for q in self.motion[0]],
            "arm": {"model": self.name},
            "controller": {
                "task": self.task,
                "stiffness": 900.0,
                "damping": 60.0,
                "null_damping": 6.0,
                "field": {"kind": "bounded", "gain": 100.0, "influence": 0.3},
                "joint_limit_field": {"kind": "bounded", "gain": 10.0, "influence": 0.3},
            },
            "reference": self.reference,
            "obstacles": self.obstacles,
            "simulation": {"dt": 1e-3, "integrator": "semi_implicit_euler", "control": "hold"},
        }
        return Scenario.from_dict(document)


def _instants() -> Array:
    return np.arange(0.0, DURATION + 0.025, 0.05)


def _following(
    arm: _core.Arm, bodies: Bodies, task: str, q0: Array, along: Array | None, turn: Array, time: float
) -> Array | None:
    """Joint angles along a reference by Newton's method from `q0`, the shortest step each time.

    None if they get near a joint limit or a singularity, or the links near the floor or each other.
    """
    times = _instants()
    rows = slice(0, 3) if task == "position" else slice(0, 6)
    if not _usable(arm, bodies, rows, q0):
        return None
    if along is None:
        motion = np.tile(q0, (len(times), 1))
        return motion if _apart(bodies, motion[:1]) else None
    start, orientation = arm.pose(q0)
    begin = rotation(orientation)
    q, found, arrived = q0, [q0], False
    for share in travelled(times[1:] / time):
        if share < 1.0 or not arrived:
            for _ in range(2):
                position, orientation = arm.pose(q)
                deviation = np.zeros(6)
                deviation[:3] = start + share * along - position
                now, due = rotation(orientation), product(rotation(_turned(share * turn)), begin)
                deviation[3:] = 0.5 * np.cross(now.T, due.T).sum(axis=0)
                J = arm.jacobian(q)[rows]
                pull = _solved(product(J, J.T), deviation[rows, None])
                if pull is None:
                    return None
                q = q + product(J.T, pull)[:, 0]
            if np.abs(deviation[rows]).max() > 1e-3 or not _usable(arm, bodies, rows, q):
                return None
            arrived = share == 1.0
        found.append(q)
    motion = np.array(found)
    limits = arm.velocity_limits
    if limits is not None and (np.abs(np.diff(motion, axis=0)) > _SPEED * limits * times[1]).any():
        return None
    return motion if _apart(bodies, motion[::4]) else None


def _usable(arm: _core.Arm, bodies: Bodies, rows: slice, q: Array) -> bool:
    """Whether a posture is away from joint limits and singularities."""
    limits = arm.joint_limits
    if limits is not None and ((q < limits[:, 0] + _LIMIT) | (q > limits[:, 1] - _LIMIT)).any():
        return False
    length = np.repeat([1.0, bodies.reach / 6.0], 3)[rows, None]
    J = length * arm.jacobian(q)[rows]
    lift = _solved(arm.mass_matrix(q), J.T)
    if lift is None:
        return False
    least = _DAMPED / arm.masses.sum() * np.eye(len(J))
    return _solved(product(J, lift) - least, J) is not None


def _solved(matrix: Array, right: Array) -> Array | None:
    """The solution of a symmetric system by elimination; none if the matrix is not positive definite.

    Written out, as LAPACK's last bits depend on the processor.
    """
    n = len(matrix)
    rows = np.hstack([matrix, right])
    for k in range(n):
        if not rows[k, k] > 0.0:
            return None
        rows[k] /= rows[k, k]
        rows[k + 1 :] -= rows[k + 1 :, k, None] * rows[k]
    for k in reversed(range(n)):
        rows[:k] -= rows[:k, k, None] * rows[k]
    return rows[:, n:]


def _apart(bodies: Bodies, motion: Array) -> bool:
    """Whether the links keep off the floor and each other."""
    low = (bodies.ends(motion)[..., 2] - bodies.radius[:, None])[:, bodies.link >= 0].min()
    return bool(low >= _FLOOR and bodies.clearance_of_itself(motion).min() >= _ITSELF)


def _turned(turn: Array) -> Array:
    """The quaternion of a rotation vector."""
    angle = float(np.linalg.norm(turn, axis=-1))  # not over all axes, which BLAS does
    axis = turn / angle if angle else turn
    return np.append(math.cos(0.5 * angle), math.sin(0.5 * angle) * axis)


def _links_swept(scene: _Scene, draw: Draw) -> bool:
    """Bodies that push against a link or go through its place; the hand is free."""
    wanted = draw.whole(1, 2)
    for _ in range(100):
        target = scene.on_links(draw) + draw.uniform(0.0, 0.1) * draw.direction_in_space()
        along = draw.direction_in_space()
        depth = draw.uniform(-0.05, 0.05)
        motion = (
            _through(draw, target, along) if draw.whole(0, 1) else push(draw, TRAVEL, target, along, depth)
        )
        scene.place(_body(draw, draw.uniform(*SIZE), *motion), hand=_HAND, hits=True)
        if len(scene.obstacles) == wanted:
            return True
    return False


def _path_crossed(scene: _Scene, draw: Draw) -> bool:
    """One body on the hand's line, at rest or crossing it at its time; half the time one beside."""
    duration = scene.reference["duration"]
    for _ in range(50):
        size = draw.uniform(*SIZE)
        when = draw.uniform(0.35, 0.65) * duration
        on = scene.on_path(when) + draw.uniform(0.0, 0.5) * size * draw.direction_in_space()
        speed = draw.uniform(0.2, 0.6) * draw.whole(0, 1)
        velocity = speed * draw.direction_in_space()
        motion = {"kind": "linear", "velocity": rounded(velocity)} if speed else None
        if scene.place(_body(draw, size, on - when * velocity, motion), hand=-math.inf, end=_END, hits=True):
            break
    else:
        return False
    if draw.whole(0, 1):
        for _ in range(50):
            beside = scene.on_links(draw) + draw.uniform(0.15, 0.35) * draw.direction_in_space()
            if scene.place(_body(draw, draw.uniform(*SIZE), beside, None), hand=_HAND):
                break
    return True


def _clutter(scene: _Scene, draw: Draw) -> bool:
    """Bodies at rest about the links and the path; half with a shelf, two of three in the way of a link."""
    if draw.whole(0, 1):
        for board in _shelf(scene, draw):
            scene.place(board, hand=_HAND)
        if len(scene.obstacles) < 2:
            return False
    wanted = len(scene.obstacles) + draw.whole(2, 5)
    if draw.whole(0, 2):
        for _ in range(50):
            place = scene.on_links(draw) + draw.uniform(0.0, 0.1) * draw.direction_in_space()
            if scene.place(_body(draw, draw.uniform(*SIZE), place, None), hand=_HAND, hits=True):
                break
        else:
            return False
    for _ in range(200):
        about = scene.on_links(draw)
        if draw.whole(0, 1):
            about = scene.on_path(scene.times[draw.whole(0, len(scene.times) - 1)])
        place = about + draw.uniform(0.1, 0.35) * draw.direction_in_space()
        scene.place(_body(draw, draw.uniform(*SIZE), place, None), hand=_HAND)
        if len(scene.obstacles) == wanted:
            return True
    return False


def _crowd(scene: _Scene, draw: Draw) -> bool:
    """Spheres that go straight, swing or come and go, to within 0.3 m of a link; the hand is free."""
    wanted = draw.whole(3, 6)
    for _ in range(300):
        target = scene.on_links(draw) + draw.uniform(0.0, 0.3) * draw.direction_in_space()
        along, depth = draw.direction_in_space(), draw.uniform(0.0, 0.2)
        position, motion = (
            _through(draw, target, along) if draw.whole(0, 1) else push(draw, TRAVEL, target, along, depth)
        )
        ball = {"kind": "sphere", "radius": draw.uniform(*SIZE)}
        scene.place({"shape": ball, "position": rounded(position), "motion": motion}, hand=_HAND)
        if len(scene.obstacles) == wanted:
            return True
    return False


_MAKE: dict[str, Callable[[_Scene, Draw], bool]] = {
    "links-swept": _links_swept,
    "path-crossed": _path_crossed,
    "clutter": _clutter,
    "crowd": _crowd,
}


def _through(draw: Draw, target: Array, along: Array) -> tuple[Array, Document]:
    """Where a body starts that goes straight through a point, and its motion."""
    speed, when = draw.uniform(0.2, 0.6), draw.uniform(0.4, 0.8) * DURATION
    return target - speed * when * along, {"kind": "linear", "velocity": rounded(speed * along)}


def _shelf(scene: _Scene, draw: Draw) -> list[Document]:
    """Boards about the end of the hand's path, open towards the base."""
    end = scene.on_path(DURATION)
    away = round(math.atan2(end[1], end[0]) + draw.uniform(-0.4, 0.4), 12)
    orientation = rounded(_turned(np.array([0.0, 0.0, away])), 17)
    outward, aside = (
        np.array([math.cos(away), math.sin(away), 0.0]),
        np.array([-math.sin(away), math.cos(away), 0.0]),
    )
    depth, width, thick = draw.uniform(0.2, 0.35), draw.uniform(0.4, 0.7), draw.uniform(0.02, 0.04)
    below, above = draw.uniform(0.12, 0.25), draw.uniform(0.2, 0.4)
    middle = end + draw.uniform(0.0, 0.5) * depth * outward + draw.uniform(-0.2, 0.2) * width * aside
    height = below + above
    up = np.array([0.0, 0.0, 1.0])
    boards = [
        (middle - below * up, [depth, width, thick]),
        (middle + above * up, [depth, width, thick]),
        (middle + 0.5 * depth * outward + 0.5 * (above - below) * up, [thick, width, height]),
        (middle + 0.5 * width * aside + 0.5 * (above - below) * up, [depth, thick, height]),
        (middle - 0.5 * width * aside + 0.5 * (above - below) * up, [depth, thick, height]),
    ]
    return [
        {
            "shape": {"kind": "box", "size": rounded(size)},
            "position": rounded(place),
            "orientation": orientation,
        }
        for place, size in boards
    ]


def _body(draw: Draw, size: float, position: Array, motion: Document | None) -> Document:
    """A sphere half the time, else a capsule or a box, of which nothing is beyond `size`."""
    kind = draw.whole(0, 3)
    shape: Document = {"kind": "sphere", "radius": size}
    obstacle: Document = {"shape": shape, "position": rounded(position)}
    if kind == 2:
        end = rounded(0.5 * size * draw.direction_in_space())
        obstacle["shape"] = {
            "kind": "capsule",
            "a": [-x for x in end],
            "b": end,
            "radius": round(0.5 * size, 4),
        }
    elif kind == 3:
        sides = np.abs(draw.direction_in_space()) + 0.3
        obstacle["shape"] = {
            "kind": "box",
            "size": rounded(2.0 * size * sides / np.linalg.norm(sides, axis=-1)),
        }
        turn = draw.uniform(0.0, math.pi) * draw.direction_in_space()
        obstacle["orientation"] = rounded(_turned(turn), 17)
    if motion is not None:
        obstacle["motion"] = motion
    return obstacle
