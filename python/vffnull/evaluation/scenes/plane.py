"""Random scenes in the plane."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from vffnull._support.arguments import whole
from vffnull._support.errors import InputError, InputTypeError
from vffnull.evaluation.geometry.plane import Kinematics, World
from vffnull.evaluation.planner import reference_points
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

__all__ = ["CATEGORIES", "DURATION", "random"]

CATEGORIES: dict[int, tuple[str, ...]] = {1: FAMILIES[:1], 2: FAMILIES[1:]}
"""Families of each category."""

DURATION = 8.0  # s
RADIUS = 0.03  # m, half the thickness of the links
TRAVEL = Travel(DURATION, swing=(0.5, 1.2), away=(0.8, 1.8), wait=1.5, begin=1.0)

# Free space at the start and throughout [m]: without it, no motion could avoid contact.
_START = 0.25  # from every link to every obstacle at t = 0
_BASE = 0.4  # from the base to every obstacle at all times
_TIP = 0.35  # links-swept: from the tip's reference to every obstacle at all times
_BETWEEN = 0.15  # clutter: the same, between bodies at rest
_END = 0.25  # path-crossed: from the end of the line to every obstacle, once the tip is due there


def random(category: int | str, n: int, seed: int) -> Scenario:
    """Make a random scene.

    Parameters
    ----------
    category : {1, 2} or str
        A category, whose families take turns by the seed, or one of `FAMILIES`.
    n : int
        Number of joints, 3 to 12. Every link is a uniform rod of 1 m and 1 kg.
    seed : int
        Which scene; 0 to 999 999 for tuning, 1 000 000 to 1 999 999 for evaluation.

    Returns
    -------
    Scenario
        8 s at 1 kHz with the null-space field; `evaluate` puts other controllers in.

    Raises
    ------
    vffnull.errors.InputError
        If there is no such category or seed, or if `n` is out of range.
    vffnull.errors.InputTypeError
        If an argument is of a type that cannot be used.

    Examples
    --------
    >>> random("crowd", 6, 0).name
    'crowd-6-0'
    """
    n, seed = whole("n", n, 3, 12), whole("seed", seed, 0, EVALUATION.stop - 1)
    family = _family(category, seed)
    draw = Draw((FAMILIES.index(family), n, seed))
    while True:
        scene = _Scene(draw, n, family)
        if _MAKE[family](scene, draw):
            return scene.scenario(seed)


def _family(category: int | str, seed: int) -> str:
    if isinstance(category, str):
        if category not in FAMILIES:
            raise InputError(f"category: expected 1, 2 or one of {', '.join(FAMILIES)}, not {category!r}")
        return category
    if isinstance(category, bool) or not isinstance(category, int | np.integer):
        raise InputTypeError(f"category: expected 1, 2 or a family, not a {type(category).__name__}")
    if category not in CATEGORIES:
        raise InputError(f"category: expected 1, 2 or one of {', '.join(FAMILIES)}, not {category}")
    families = CATEGORIES[int(category)]
    return families[seed % len(families)]


class _Scene:
    """An arm in a random posture with a task, and the obstacles so far."""

    def __init__(self, draw: Draw, n: int, family: str) -> None:
        self.n, self.family = n, family
        self.arm = Kinematics(np.ones(n), RADIUS)
        self.q0, self.joints = _posture(draw, self.arm)
        tip = self.joints[-1]
        self.reference: Document = {"kind": "setpoint", "point": rounded(tip, 17)}
        if family in ("path-crossed", "clutter") or draw.whole(0, 1):
            shortest, longest = (0.05, 0.2) if family in ("links-swept", "crowd") else (0.25, 0.45)
            end = _line(draw, n, tip, shortest * n, longest * n)
            time = draw.uniform(4.0, 6.0)
            self.reference = {"kind": "line", "end": rounded(end), "duration": time}
        self.times = np.arange(0.0, DURATION + 0.025, 0.05)
        self.path = reference_points(self.reference, tip, self.times)
        self.obstacles: list[Document] = []

    def place(self, obstacle: Document, *, tip: float = -math.inf, end: float = -math.inf) -> bool:
        """Put an obstacle in if it leaves the start, the base and, by `tip` and `end` [m], the task free."""
        world = World([obstacle])
        centre, reach = world.positions(self.times)[:, 0] + world.middle[0], world.reach[0]
        if np.linalg.norm(centre, axis=1).min() - reach < _BASE:
            return False
        if world.clearance(self.joints[None], RADIUS, 0.0).min() < _START:
            return False
        free = np.linalg.norm(centre - self.path, axis=1) - reach
        due = self.times >= self.reference.get("duration", 0.0)
        if free.min() < tip or free[due].min() < end:
            return False
        self.obstacles.append(obstacle)
        return True

    def scenario(self, seed: int) -> Scenario:
        document = {
            "name": f"{self.family}-{self.n}-{seed}",
            "description": f"Random scene of the family {self.family}",
            "duration": DURATION,
            "q0": [float(q) for q in self.q0],
            "arm": {"lengths": [1.0] * self.n, "masses": 1.0, "radius": RADIUS},
            "controller": {
                "stiffness": 100.0,
                "damping": 20.0,
                "null_damping": 6.0,
                "field": {"kind": "khatib", "gain": 0.3, "influence": 0.6, "floor": 0.05},
            },
            "reference": self.reference,
            "obstacles": self.obstacles,
            "simulation": {"dt": 1e-3, "integrator": "rk4", "control": "hold"},
        }
        return Scenario.from_dict(document)


def _posture(draw: Draw, arm: Kinematics) -> tuple[Array, Array]:
    """A posture away from singularities whose links keep clear of each other."""
    while True:
        q = np.array([draw.uniform(-math.pi, math.pi)] + [draw.uniform(-1.2, 1.2) for _ in range(arm.n - 1)])
        joints = arm.joints(q)
        reach = float(np.linalg.norm(joints[-1], axis=-1)) / arm.n
        apart = np.linalg.norm(joints[:, None] - joints[None], axis=2)
        far = np.abs(np.subtract.outer(np.arange(arm.n + 1), np.arange(arm.n + 1))) >= 2
        if 0.4 <= reach <= 0.8 and apart[far].min() >= 0.8:
            return q, joints


def _line(draw: Draw, n: int, tip: Array, shortest: float, longest: float) -> Array:
    """The end of a straight path of the tip that stays between 0.3 and 0.85 of the reach."""
    while True:
        end = tip + draw.uniform(shortest, longest) * draw.direction()
        along = tip + np.linspace(0.0, 1.0, 21)[:, None] * (end - tip)
        distance = np.linalg.norm(along, axis=1)
        if distance.min() >= 0.3 * n and distance.max() <= 0.85 * n:
            return end


def _links_swept(scene: _Scene, draw: Draw) -> bool:
    """Bodies that come from 0.8 m and more away and push 0 to 0.5 m past a point of the arm."""
    wanted = draw.whole(1, 2)
    for _ in range(200):
        target = _on_arm(scene, draw, 1.0, 0.75 * scene.n)
        motion = push(draw, TRAVEL, target, draw.direction(), draw.uniform(0.0, 0.5))
        scene.place(_body(draw, draw.uniform(0.1, 0.25), *motion), tip=_TIP)
        if len(scene.obstacles) == wanted:
            return True
    return False


def _path_crossed(scene: _Scene, draw: Draw) -> bool:
    """One body on the tip's line, at rest or crossing it when the tip is there; half the time one beside."""
    duration = scene.reference["duration"]
    for _ in range(50):
        size = draw.uniform(0.15, 0.3)
        when = draw.uniform(0.35, 0.65) * duration
        on = reference_points(scene.reference, scene.joints[-1], np.array([when]))[0]
        on = on + draw.uniform(0.0, 0.6) * size * draw.direction()
        speed = draw.uniform(0.1, 0.5) * draw.whole(0, 1)
        velocity = speed * draw.direction()
        motion = {"kind": "linear", "velocity": rounded(velocity)} if speed else None
        if scene.place(_body(draw, size, on - when * velocity, motion), end=_END):
            break
    else:
        return False
    if draw.whole(0, 1):
        for _ in range(50):
            beside = _on_arm(scene, draw, 1.0, scene.n) + draw.uniform(0.5, 1.0) * draw.direction()
            if scene.place(_body(draw, draw.uniform(0.1, 0.25), beside, None), tip=_TIP):
                break
    return True


def _clutter(scene: _Scene, draw: Draw) -> bool:
    """Bodies at rest about the arm and its path, 0.15 m or more from the path."""
    wanted = draw.whole(3, 8)
    for _ in range(300):
        about = _on_arm(scene, draw, 0.5, scene.n) if draw.whole(0, 1) else _on_path(scene, draw)
        place = about + draw.uniform(0.3, 1.0) * draw.direction()
        scene.place(_body(draw, draw.uniform(0.1, 0.3), place, None), tip=_BETWEEN)
        if len(scene.obstacles) == wanted:
            return True
    return False


def _crowd(scene: _Scene, draw: Draw) -> bool:
    """Discs that go straight, swing or come and go, each to within 1.2 m of the arm or its path, and on."""
    wanted = draw.whole(3, 8)
    for _ in range(300):
        about = _on_arm(scene, draw, 1.0, scene.n) if draw.whole(0, 2) else _on_path(scene, draw)
        target = about + draw.uniform(0.0, 1.2) * draw.direction()
        position, motion = push(draw, TRAVEL, target, draw.direction(), draw.uniform(0.0, 0.8))
        disc = {"kind": "circle", "radius": draw.uniform(0.1, 0.25)}
        scene.place({"shape": disc, "position": rounded(position), "motion": motion})
        if len(scene.obstacles) == wanted:
            return True
    return False


_MAKE: dict[str, Callable[[_Scene, Draw], bool]] = {
    "links-swept": _links_swept,
    "path-crossed": _path_crossed,
    "clutter": _clutter,
    "crowd": _crowd,
}


def _on_arm(scene: _Scene, draw: Draw, low: float, high: float) -> Array:
    """A point of the arm at the start, by its distance from the base along the links [m]."""
    along = min(draw.uniform(low, high), scene.n - 1e-9)
    link = int(along)
    a, b = scene.joints[link : link + 2]
    point: Array = a + (along - link) * (b - a)
    return point


def _on_path(scene: _Scene, draw: Draw) -> Array:
    point: Array = scene.path[draw.whole(0, len(scene.path) - 1)]
    return point


def _body(draw: Draw, size: float, position: Array, motion: Document | None) -> Document:
    """A disc half the time, else a capsule, a box or a polygon, of which nothing is beyond `size`."""
    kind = draw.whole(0, 5)
    angle = 0.0
    shape: Document = {"kind": "circle", "radius": size}
    if kind == 3:
        end = rounded(0.5 * size * draw.direction())
        shape = {"kind": "capsule", "a": [-x for x in end], "b": end, "radius": round(0.5 * size, 4)}
    elif kind == 4:
        tilt = draw.uniform(0.4, 1.1)
        sides = [2.0 * size * math.cos(tilt), 2.0 * size * math.sin(tilt)]
        angle = draw.uniform(0.0, math.pi)
        shape = {"kind": "box", "size": rounded(sides)}
    elif kind == 5:
        corners = draw.whole(3, 6)
        turns = (
            (np.arange(corners) + [draw.uniform(-0.3, 0.3) for _ in range(corners)]) * 2 * math.pi / corners
        )
        shape = {"kind": "polygon", "vertices": [rounded(size * _unit(turn)) for turn in turns]}
    obstacle: Document = {"shape": shape, "position": rounded(position)}
    if angle:
        obstacle["angle"] = angle
    if motion is not None:
        obstacle["motion"] = motion
    return obstacle


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])
