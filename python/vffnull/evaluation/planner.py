"""Whether a collision-free motion exists in a scene: found by a planner that knows
all motions of the obstacles in advance, and no controller.

The rule, fixed before any controller was run on random scenes:

A **motion** is a sequence of joint angles from the scene's start, 50 ms apart, straight in between, with
joint speeds up to 3 rad/s and accelerations up to 30 rad/s² (change of speed from one piece to the next over
50 ms). It is **clear** if every link keeps 1 mm or more from every obstacle at all instants 5 ms apart. A
scene is

- ``"with tip"`` if a clear motion is found whose tip is never more than 1 cm from its reference,
- ``"without tip"`` if only a clear motion is found that leaves the reference,
- ``"none found"`` if neither is found within the budget.

The search is in the core (``planning/feasibility.rs`` says how it works and what its budget is). "None found"
is no proof: the search can miss a motion. What it finds is one. Links may cross each other, as they may in
the plant.

`is_clear` and `World` are a second implementation of the geometry, which shares nothing with the core's: the
generator of scenes uses it, and a test checks with it what the core has found.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _core
from vffnull.errors import InputError
from vffnull.scenario import ScenarioLike, prepare

__all__ = [
    "VERDICTS",
    "Kinematics",
    "Motion",
    "World",
    "escape",
    "feasibility",
    "is_clear",
    "reference_points",
    "travelled",
]

Array = NDArray[np.float64]

VERDICTS = ("with tip", "without tip", "none found")

STEP = 0.05  # s, one piece of a motion
MAX_SPEED = 3.0  # rad/s
MAX_ACCELERATION = 30.0  # rad/s²
CLEARANCE = 1e-3  # m, what a motion has to keep
TIP = 1e-2  # m, how far the tip may be from its reference


def feasibility(scenario: ScenarioLike) -> str:
    """Whether a collision-free motion exists in a scene, by the rule of this module.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        A scene whose task is a position; what `vffnull.simulate` accepts.

    Returns
    -------
    {"with tip", "without tip", "none found"}
        What the planner has found; always the same for a scene.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the task is a pose.
    vffnull.errors.InputTypeError
        If it is no scenario.
    """
    return escape(scenario)[0]


def escape(scenario: ScenarioLike) -> tuple[str, Array | None]:
    """The same, with the motion that was found.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        A scene whose task is a position; what `vffnull.simulate` accepts.

    Returns
    -------
    str
        The verdict.
    (k, n) ndarray or None
        Joint angles every 50 ms [rad].
    """
    return _core.feasibility(prepare(scenario).to_dict())


def is_clear(scene: Mapping[str, Any], motion: Array, hold: bool) -> bool:
    """Whether a motion is clear, and keeps the tip if it has to, at all instants 5 ms apart.

    Parameters
    ----------
    scene : Mapping
        The scene's document.
    motion : (k, n) array_like
        Joint angles every 50 ms from the start [rad].
    hold : bool
        Whether the tip has to stay within 1 cm of its reference.
    """
    arm = Kinematics.of(scene["arm"])
    world = World(scene.get("obstacles", ()))
    knots = STEP * np.arange(len(motion))
    times = np.linspace(0.0, knots[-1], 10 * (len(motion) - 1) + 1)
    q = np.stack([np.interp(times, knots, column) for column in np.asarray(motion, dtype=float).T], axis=1)
    joints = arm.joints(q)
    if hold:
        path = reference_points(scene["reference"], joints[0, -1], times)
        if np.linalg.norm(joints[:, -1] - path, axis=1).max() > TIP:
            return False
    return bool(world.clearance(joints, arm.radius, times).min() >= CLEARANCE)


def reference_points(reference: Mapping[str, Any], tip: Array, times: Array) -> Array:
    """Where the tip has to be.

    Parameters
    ----------
    reference : Mapping
        A set point, or a line.
    tip : (2,) ndarray
        Where a line without a start of its own starts [m].
    times : (k,) ndarray
        Instants [s].

    Returns
    -------
    (k, 2) ndarray
        Points [m].

    Raises
    ------
    vffnull.errors.InputError
        If the reference is of another kind.
    """
    if reference["kind"] == "setpoint":
        return np.tile(np.asarray(reference["point"], dtype=float)[:2], (len(times), 1))
    if reference["kind"] != "line":
        raise InputError(f"reference.kind: expected setpoint or line, not {reference['kind']}")
    start = np.asarray(reference.get("start", tip), dtype=float)
    share = travelled(times / reference["duration"])
    points: Array = start + share[:, None] * (np.asarray(reference["end"], dtype=float) - start)
    return points


def travelled(share: Array) -> Array:
    """The travelled fraction of a line from rest to rest, over the fraction of its time."""
    s = np.clip(share, 0.0, 1.0)
    fraction: Array = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return fraction


class Kinematics:
    """A planar arm as far as a planner sees it.

    Parameters
    ----------
    lengths : (n,) ndarray
        Lengths of the links [m].
    radius : float
        Half the thickness of the thickest link [m].
    """

    def __init__(self, lengths: Array, radius: float) -> None:
        self.lengths, self.radius, self.n = lengths, radius, len(lengths)

    @classmethod
    def of(cls, arm: Mapping[str, Any]) -> Kinematics:
        """Of the arm's table in a scenario."""
        return cls(np.asarray(arm["lengths"], dtype=float), float(np.max(arm.get("radius", 0.0))))

    def joints(self, q: Array) -> Array:
        """Positions of all joints and the tip, (…, n + 1, 2) [m]."""
        angle = np.cumsum(q, axis=-1)
        links = self.lengths[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        start = np.zeros((*q.shape[:-1], 1, 2))
        return np.concatenate([start, np.cumsum(links, axis=-2)], axis=-2)


class World:
    """Obstacles as rounded edges: a disc is a point with a radius, a box four segments without.

    What lies inside a box or a polygon has a positive distance here; a link gets there over an edge only.

    Parameters
    ----------
    obstacles : sequence of Mapping
        The scene's obstacles.
    """

    def __init__(self, obstacles: Sequence[Mapping[str, Any]]) -> None:
        self._motions = [Motion(each) for each in obstacles]
        self.middle = np.zeros((len(obstacles), 2))
        """Middle of every obstacle, from its position [m]."""
        self.reach = np.zeros(len(obstacles))
        """Radius about it that holds the whole obstacle [m]."""
        edges: list[tuple[Array, Array, float, int]] = []
        for i, each in enumerate(obstacles):
            corners, radius = _corners(each)
            self.middle[i] = corners.mean(axis=0)
            self.reach[i] = radius + np.linalg.norm(corners - self.middle[i], axis=1).max()
            ends = zip(corners, np.roll(corners, -1, axis=0), strict=True)
            edges += [(a, b, radius, i) for a, b in list(ends)[: 1 if len(corners) == 2 else None]]
        discs = [edge for edge in edges if np.array_equal(edge[0], edge[1])]
        sides = [edge for edge in edges if not np.array_equal(edge[0], edge[1])]
        self._discs, self._sides = _Edges(discs), _Edges(sides)

    def positions(self, times: Array) -> Array:
        """Of all obstacles, (k, obstacles, 2) [m]."""
        if not self._motions:
            return np.zeros((len(times), 0, 2))
        return np.stack([motion(times) for motion in self._motions], axis=1)

    def clearance(self, joints: Array, radius: float, t: float | Array) -> Array:
        """Smallest distance of every link to any obstacle.

        Parameters
        ----------
        joints : (k, n + 1, 2) ndarray
            Positions of the joints [m].
        radius : float
            Half the thickness of the links [m].
        t : float or (k,) ndarray
            When [s].

        Returns
        -------
        (k, n) ndarray
            Distances [m]; not positive in contact, infinite without obstacles.
        """
        at = self.positions(np.atleast_1d(np.asarray(t, dtype=float)))
        a, b = joints[:, :-1, None], joints[:, 1:, None]
        nearest = np.full((len(joints), joints.shape[1] - 1), np.inf)
        for edges, both in ((self._discs, False), (self._sides, True)):
            if len(edges.radius) == 0:
                continue
            c, d = (at[:, edges.of] + end for end in (edges.a, edges.b))
            c, d = c[:, None], d[:, None]
            distance = _to_segment(c, a, b)
            if both:
                for point, e, f in ((d, a, b), (a, c, d), (b, c, d)):
                    np.minimum(distance, _to_segment(point, e, f), out=distance)
                distance[_cross(a, b, c, d)] = 0.0
            np.minimum(nearest, (distance - edges.radius).min(axis=2), out=nearest)
        return nearest - radius


class _Edges:
    def __init__(self, edges: Sequence[tuple[Array, Array, float, int]]) -> None:
        self.a = np.array([edge[0] for edge in edges]).reshape(-1, 2)
        self.b = np.array([edge[1] for edge in edges]).reshape(-1, 2)
        self.radius = np.array([edge[2] for edge in edges])
        self.of = np.array([edge[3] for edge in edges], dtype=int)


class Motion:
    """Where an obstacle is, in the plane or in space.

    Parameters
    ----------
    obstacle : Mapping
        With its position.
    dimension : {2, 3}, optional
        Of the space.
    """

    def __init__(self, obstacle: Mapping[str, Any], dimension: int = 2) -> None:
        self.position = np.asarray(obstacle.get("position", np.zeros(dimension)), dtype=float)
        self.motion = obstacle.get("motion") or {"kind": "static"}

    def __call__(self, times: Array) -> Array:
        """Positions at instants [s], (k, dimension) [m]."""
        motion = self.motion
        if motion["kind"] == "waypoints":
            points = np.asarray(motion["points"], dtype=float)
            return np.stack([np.interp(times, motion["times"], column) for column in points.T], axis=1)
        away = np.zeros((len(times), len(self.position)))
        if motion["kind"] == "linear":
            away = times[:, None] * np.asarray(motion["velocity"], dtype=float)
        if motion["kind"] == "sinusoid":
            swing = np.sin(motion["angular_frequency"] * times + motion.get("phase", 0.0))
            away = swing[:, None] * np.asarray(motion["amplitude"], dtype=float)
        positions: Array = self.position + away
        return positions


def _corners(obstacle: Mapping[str, Any]) -> tuple[Array, float]:
    """Corners about the obstacle's position, and the radius round them."""
    shape, angle = obstacle["shape"], obstacle.get("angle", 0.0)
    if shape["kind"] == "circle":
        corners = [[0.0, 0.0]]
    elif shape["kind"] == "capsule":
        corners = [shape["a"], shape["b"]]
    elif shape["kind"] == "box":
        x, y = 0.5 * np.asarray(shape["size"], dtype=float)
        corners = [[-x, -y], [x, -y], [x, y], [-x, y]]
    else:
        corners = shape["vertices"]
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return np.asarray(corners, dtype=float) @ turn.T, float(shape.get("radius", 0.0))


def _share(point: Array, a: Array, b: Array) -> Array:
    """Where on the segment from a to b the nearest point is, from 0 to 1."""
    along = b - a
    length = (along * along).sum(axis=-1)
    share: Array = np.clip(((point - a) * along).sum(axis=-1) / length, 0.0, 1.0)
    return share


def _to_segment(point: Array, a: Array, b: Array) -> Array:
    away = point - a - _share(point, a, b)[..., None] * (b - a)
    distance: Array = np.sqrt((away * away).sum(axis=-1))
    return distance


def _cross(a: Array, b: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    """Whether the segments ab and cd cross."""

    def side(p: Array, q: Array, r: Array) -> Array:
        turn: Array = (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
        return turn - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    crossing: NDArray[np.bool_] = (side(a, b, c) * side(a, b, d) < 0.0) & (
        side(c, d, a) * side(c, d, b) < 0.0
    )
    return crossing
