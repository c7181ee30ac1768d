"""Whether a scene can be survived at all: a planner that knows the future and no controller.

The rule, fixed before any controller was run on these scenes:

A **motion** is a sequence of joint angles from the scene's start, 50 ms apart, straight in between, with joint
speeds up to 3 rad/s and accelerations up to 30 rad/s² (change of speed from one piece to the next over 50 ms).
It is **clear** if every link keeps 1 mm or more from every obstacle at all instants 5 ms apart. A scene is

- ``"with tip"`` if a clear motion is found whose tip is never more than 1 cm from its reference,
- ``"without tip"`` if only a clear motion is found that lets go of the reference,
- ``"none found"`` if neither is found within the budget.

The search follows 64 motions at once. Each is continued in 4 random ways per piece: the motion that the task
asks for, a push away from where the obstacles are now or will be within 0.8 s, and noise, in random shares; with
the tip held, every continuation is put back onto the reference by Newton's method. Continuations that come within
1 cm of an obstacle or break a bound are dropped; of the rest the 64 best are followed, half of them by how much
room they have now and 0.4 s and 0.8 s ahead, half at random. A search that dies out is repeated with 256 motions.
Random numbers come from the scene's own numbers, so the answer is always the same.

"None found" is no proof: the search can miss a motion. What it finds is one: it is checked after the search.
Links may cross each other, as they may in the plant.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vffnull.errors import InputError, InputTypeError
from vffnull.scenario import Scenario

__all__ = ["VERDICTS", "Kinematics", "World", "feasibility", "reference_points"]

Array = NDArray[np.float64]

VERDICTS = ("with tip", "without tip", "none found")

STEP = 0.05  # s, one piece of a motion
MAX_SPEED = 3.0  # rad/s
MAX_ACCELERATION = 30.0  # rad/s²
CLEARANCE = 1e-3  # m, what a motion has to keep
MARGIN = 1e-2  # m, what the search keeps at the ends and middles of its pieces
TIP = 1e-2  # m, how far the tip may be from its reference
BUDGET = (64, 256)  # motions followed, first and second try
BRANCHES = 4
AHEAD = (0.0, 0.4, 0.8)  # s


def feasibility(scenario: Scenario) -> str:
    """Judge a scene by the rule of this module.

    Parameters
    ----------
    scenario : Scenario
        A scene whose reference is a set point or a line, for a position.

    Returns
    -------
    {"with tip", "without tip", "none found"}
        What the planner has found.

    Raises
    ------
    vffnull.errors.InputError
        If the reference is of another kind.
    vffnull.errors.InputTypeError
        If it is no scenario.
    """
    if not isinstance(scenario, Scenario):
        raise InputTypeError(f"scenario: expected a Scenario, not a {type(scenario).__name__}")
    scene = scenario.to_dict()
    for hold, verdict in ((True, VERDICTS[0]), (False, VERDICTS[1])):
        for attempt, width in enumerate(BUDGET):
            if search(scene, hold, width, attempt) is not None:
                return verdict
    return VERDICTS[2]


def search(scene: Mapping[str, Any], hold: bool, width: int, attempt: int = 0) -> Array | None:
    """Look for a clear motion.

    Parameters
    ----------
    scene : Mapping
        The scene's document.
    hold : bool
        Whether the tip has to stay within 1 cm of its reference.
    width : int
        How many motions are followed at once.
    attempt : int, optional
        Other random numbers for another attempt.

    Returns
    -------
    (k, n) ndarray or None
        Joint angles every 50 ms [rad], or None if all motions died out.
    """
    arm = Kinematics.of(scene["arm"])
    world = World(scene.get("obstacles", ()))
    rng = np.random.Generator(np.random.PCG64(_seed(scene, hold, attempt)))
    start = np.array(scene["q0"], dtype=float)
    times = STEP * np.arange(int(np.ceil(scene["duration"] / STEP - 1e-9)) + 1)
    path = reference_points(scene["reference"], arm.joints(start)[-1], times)

    q, dq = start[None], np.zeros((1, arm.n))
    room = np.zeros(1)
    history, parents = [q], []
    for k, t in enumerate(times[:-1]):
        parent = np.repeat(np.arange(len(q)), BRANCHES * (width // len(q) if len(q) < width else 1))
        before = q[parent]
        wanted = _continuations(arm, world, rng, before, dq[parent], t, (path[k], path[k + 1]), hold)
        bound = MAX_ACCELERATION * STEP
        speed = np.clip(wanted, dq[parent] - bound, dq[parent] + bound).clip(-MAX_SPEED, MAX_SPEED)
        after = before + STEP * speed
        fine = np.ones(len(after), dtype=bool)
        if hold:
            after, error = arm.put_back(after, path[k + 1])
            speed = (after - before) / STEP
            fine &= error <= 0.1 * TIP
            fine &= np.abs(speed).max(axis=1) <= MAX_SPEED
            fine &= np.abs(speed - dq[parent]).max(axis=1) <= bound
        after, speed, parent, before = after[fine], speed[fine], parent[fine], before[fine]
        joints = arm.joints(after)
        clear = world.clearance(joints, arm.radius, t + STEP).min(axis=1)
        half = world.clearance(arm.joints(0.5 * (before + after)), arm.radius, t + STEP / 2).min(axis=1)
        fine = (clear >= MARGIN) & (half >= MARGIN)
        if not fine.any():
            return None
        after, speed, parent, joints = after[fine], speed[fine], parent[fine], joints[fine]
        score = 0.9 * room[parent] + _room(world, arm, joints, t + STEP) - 0.02 * (speed**2).sum(axis=1)
        if not hold:
            score -= 0.2 * np.linalg.norm(joints[:, -1] - path[k + 1], axis=1)
        kept = _selection(rng, score, width)
        q, dq, room = after[kept], speed[kept], score[kept]
        history.append(q)
        parents.append(parent[kept])
    for last in np.argsort(-room)[:8]:
        motion = _trace(history, parents, int(last))
        if is_clear(scene, motion, hold):
            return motion
    return None


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


def _seed(scene: Mapping[str, Any], hold: bool, attempt: int) -> np.random.SeedSequence:
    """From what the scene is, not from what it is called or how it is controlled."""
    parts = [scene[key] for key in ("arm", "q0", "reference")] + [scene.get("obstacles", []), hold, attempt]
    digest = hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).digest()
    return np.random.SeedSequence(int.from_bytes(digest[:16], "little"))


def _continuations(
    arm: Kinematics,
    world: World,
    rng: np.random.Generator,
    q: Array,
    dq: Array,
    t: float,
    path: tuple[Array, Array],
    hold: bool,
) -> Array:
    """Joint speeds to try next, (k, n) [rad/s]."""
    count = len(q)
    joints = arm.joints(q)
    ahead = np.asarray(AHEAD)[rng.integers(len(AHEAD), size=count)]
    push = world.push(joints, t + ahead)
    push /= np.maximum(1.0, np.abs(push).max(axis=1, keepdims=True))
    noise = rng.normal(size=(count, arm.n)) * rng.choice([0.0, 0.2, 1.0], size=(count, 1))
    keep = rng.choice([0.0, 0.7, 1.0], size=(count, 1))
    free = keep * dq + rng.choice([0.0, 0.5, 2.0], size=(count, 1)) * push + noise
    task = arm.pull(joints, (path[1] - joints[:, -1]) / STEP)
    if hold:
        return task + arm.without_tip(joints, free)
    follow = rng.choice([0.0, 0.0, 0.1, 1.0], size=(count, 1))
    return free + follow * np.clip(task, -1.0, 1.0)


def _room(world: World, arm: Kinematics, joints: Array, t: float) -> Array:
    """How much room the arm has now and will have where it stands; 0 is plenty."""
    cost = np.zeros(len(joints))
    for ahead, weight in zip(AHEAD, (1.0, 0.7, 0.4), strict=True):
        clear = world.clearance(joints, arm.radius, t + ahead).clip(0.0, 0.5)
        cost += weight * (1.0 / (clear + 0.05) - 1.0 / 0.55).sum(axis=1)
    return -0.1 * cost


def _selection(rng: np.random.Generator, score: Array, width: int) -> NDArray[np.intp]:
    """Indices of those that are followed: half the best, half any."""
    order = np.argsort(-score, kind="stable")
    if len(order) <= width:
        return order
    best, rest = order[: width // 2], order[width // 2 :]
    return np.concatenate([best, rng.permutation(rest)[: width - len(best)]])


def _trace(history: Sequence[Array], parents: Sequence[NDArray[np.intp]], last: int) -> Array:
    """The motion that ends at index `last`, from its end back to the start."""
    found = [history[-1][last]]
    for places, parent in zip(history[-2::-1], parents[::-1], strict=True):
        last = int(parent[last])
        found.append(places[last])
    return np.stack(found[::-1])


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
    s = np.clip(times / reference["duration"], 0.0, 1.0)
    share = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    return start + share[:, None] * (np.asarray(reference["end"], dtype=float) - start)


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

    @staticmethod
    def jacobian(joints: Array) -> Array:
        """Of the tip, (k, 2, n) [m]."""
        arm = joints[:, -1:] - joints[:, :-1]
        return np.stack([-arm[..., 1], arm[..., 0]], axis=1)

    def pull(self, joints: Array, velocity: Array) -> Array:
        """The smallest joint speeds that give the tip a velocity, (k, n) [rad/s], damped near singularities."""
        jacobian = self.jacobian(joints)
        inertia = jacobian @ jacobian.transpose(0, 2, 1) + 1e-9 * np.eye(2)
        force = np.linalg.solve(inertia, velocity[..., None])
        speeds: Array = (jacobian.transpose(0, 2, 1) @ force)[..., 0]
        return speeds

    def without_tip(self, joints: Array, dq: Array) -> Array:
        """What of joint speeds the tip does not see."""
        seen = (self.jacobian(joints) @ dq[..., None])[..., 0]
        return dq - self.pull(joints, seen)

    def put_back(self, q: Array, point: Array) -> tuple[Array, Array]:
        """The nearest postures whose tip is at a point, by three steps of Newton's method, and what is left [m]."""
        for _ in range(3):
            joints = self.joints(q)
            q = q + self.pull(joints, point - joints[:, -1])
        return q, np.linalg.norm(self.joints(q)[:, -1] - point, axis=1)


class World:
    """Obstacles as rounded edges: a disc is a point with a radius, a box four segments without.

    What lies inside a box or a polygon has a positive distance here; a link gets there over an edge only.

    Parameters
    ----------
    obstacles : sequence of Mapping
        The scene's obstacles.
    """

    def __init__(self, obstacles: Sequence[Mapping[str, Any]]) -> None:
        self._motions = [_Motion(each) for each in obstacles]
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

    def push(self, joints: Array, t: Array) -> Array:
        """Joint torques of a unit repulsion from the obstacles' middles, one instant for each row, (k, n)."""
        middle = self.positions(t)[:, None] + self.middle
        a, b = joints[:, :-1, None], joints[:, 1:, None]
        nearest = a + _share(middle, a, b)[..., None] * (b - a)
        away = nearest - middle
        distance = np.linalg.norm(away, axis=-1)
        free = np.clip(distance - self.reach, 0.05, 0.6)
        force = ((1.0 / free - 1.0 / 0.6) / np.maximum(distance, 1e-6))[..., None] * away
        moment = (nearest[..., 0] * force[..., 1] - nearest[..., 1] * force[..., 0]).sum(axis=2)
        moment, total = (np.cumsum(x[:, ::-1], axis=1)[:, ::-1] for x in (moment, force.sum(axis=2)))
        base = joints[:, :-1]
        torque: Array = moment - (base[..., 0] * total[..., 1] - base[..., 1] * total[..., 0])
        return torque


class _Edges:
    def __init__(self, edges: Sequence[tuple[Array, Array, float, int]]) -> None:
        self.a = np.array([edge[0] for edge in edges]).reshape(-1, 2)
        self.b = np.array([edge[1] for edge in edges]).reshape(-1, 2)
        self.radius = np.array([edge[2] for edge in edges])
        self.of = np.array([edge[3] for edge in edges], dtype=int)


class _Motion:
    """Where an obstacle is."""

    def __init__(self, obstacle: Mapping[str, Any]) -> None:
        self.position = np.asarray(obstacle.get("position", (0.0, 0.0)), dtype=float)
        self.motion = obstacle.get("motion") or {"kind": "static"}

    def __call__(self, times: Array) -> Array:
        motion = self.motion
        if motion["kind"] == "waypoints":
            points = np.asarray(motion["points"], dtype=float)
            return np.stack([np.interp(times, motion["times"], column) for column in points.T], axis=1)
        if motion["kind"] == "linear":
            return self.position + times[:, None] * np.asarray(motion["velocity"], dtype=float)
        if motion["kind"] == "sinusoid":
            swing = np.sin(motion["angular_frequency"] * times + motion.get("phase", 0.0))
            return self.position + swing[:, None] * np.asarray(motion["amplitude"], dtype=float)
        return np.tile(self.position, (len(times), 1))


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
    return np.sqrt((away * away).sum(axis=-1))


def _cross(a: Array, b: Array, c: Array, d: Array) -> NDArray[np.bool_]:
    """Whether the segments ab and cd cross."""

    def side(p: Array, q: Array, r: Array) -> Array:
        turn: Array = (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1])
        return turn - (q[..., 1] - p[..., 1]) * (r[..., 0] - p[..., 0])

    crossing: NDArray[np.bool_] = (side(a, b, c) * side(a, b, d) < 0.0) & (side(c, d, a) * side(c, d, b) < 0.0)
    return crossing
