"""Random scenes with a goal that a straight way does not lead to, in the plane and for a Panda."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from vffnull._support.arguments import whole
from vffnull._support.errors import InputError
from vffnull.evaluation.geometry.arm import cos_sin
from vffnull.evaluation.scenes.common import EVALUATION, Array, Document, Draw, rounded
from vffnull.evaluation.scenes.plane import random
from vffnull.evaluation.scenes.space import in_space
from vffnull.model.scenario import Scenario
from vffnull.planning import plan

__all__ = ["GOAL_ARMS", "GOAL_FAMILIES", "to_a_goal"]

GOAL_FAMILIES = ("pocket", "shelf", "gap", "post", "crowd", "door")
"""Families of scenes with a goal; the number of a family's stream is its place here."""

GOAL_ARMS = ("plane", "panda")
"""Six links in the plane, and a Panda; the number of an arm's stream is its place here."""

_JOINTS = 6  # of the arm in the plane
_DURATION = {"plane": 12.0, "panda": 10.0}  # s
_LINE = {"plane": 6.0, "panda": 4.0}  # s, from the start to the goal on a straight line
_ROOM = {"plane": 0.08, "panda": 0.03}  # m, at the start
_PATH = {"plane": 0.02, "panda": 0.01}  # m, kept by the motion that shows that there is one


def to_a_goal(family: str, arm: str, seed: int) -> Scenario:
    """Make a random scene whose reference is a straight line to a goal that another way leads to.

    Parameters
    ----------
    family : str
        One of `GOAL_FAMILIES`. In all but the crowd, whose bodies move, a planner has found a motion to the
        goal; in that of the door one past the door where it comes to rest.
    arm : {"plane", "panda"}
        Which arm; its task is a position.
    seed : int
        Which scene; 0 to 999 999 for tuning, 1 000 000 to 1 999 999 for evaluation.

    Returns
    -------
    Scenario
        12 s in the plane and 10 s in space, at 1 kHz.

    Raises
    ------
    vffnull.errors.InputError
        If there is no such family, arm or seed.
    vffnull.errors.InputTypeError
        If the seed is no whole number.
    """
    for name, value, known in (("family", family, GOAL_FAMILIES), ("arm", arm, GOAL_ARMS)):
        if value not in known:
            raise InputError(f"{name}: expected one of {', '.join(known)}, not {value!r}")
    seed = whole("seed", seed, 0, EVALUATION.stop - 1)
    # The first number keeps these streams apart from those of other scenes.
    draw = Draw((4, GOAL_FAMILIES.index(family), GOAL_ARMS.index(arm), seed))
    if family == "crowd":
        return _crowd(arm, draw, seed)
    while True:
        made = _MAKE[arm][family](draw)
        if made is None:
            continue
        q0, goal, obstacles = made
        settled = _scene(arm, family, seed, q0, goal, [_settled(each) for each in obstacles])
        if plan(settled, margin=_PATH[arm], seed=1, samples=2000).status == "found":
            return _scene(arm, family, seed, q0, goal, obstacles)


def _settled(obstacle: Document) -> Document:
    """An obstacle where it is in the end."""
    if "motion" not in obstacle:
        return obstacle
    rest = {key: value for key, value in obstacle.items() if key != "motion"}
    return rest | {"position": obstacle["motion"]["points"][-1]}


def _scene(arm: str, family: str, seed: int, q0: Array, goal: Array, obstacles: list[Document]) -> Scenario:
    plane = arm == "plane"
    return Scenario.from_dict(
        {
            "name": f"{family}-{arm}-{seed}",
            "description": f"Random scene with a goal, of the family {family}",
            "duration": _DURATION[arm],
            "q0": rounded(q0),
            "arm": {"lengths": [1.0] * _JOINTS, "masses": 1.0, "radius": 0.03}
            if plane
            else {"model": "panda"},
            "controller": _CONTROLLER[arm],
            "reference": {"kind": "line", "end": rounded(goal), "duration": _LINE[arm]},
            "obstacles": obstacles,
            "simulation": {"dt": 1e-3, "integrator": "semi_implicit_euler", "control": "hold"},
        }
    )


_CONTROLLER: dict[str, Document] = {
    "plane": {
        "stiffness": 100.0,
        "damping": 20.0,
        "null_damping": 6.0,
        "field": {"kind": "khatib", "gain": 0.3, "influence": 0.6, "floor": 0.05},
    },
    "panda": {
        "stiffness": 900.0,
        "damping": 60.0,
        "null_damping": 6.0,
        "field": {"kind": "bounded", "gain": 100.0, "influence": 0.3},
        "joint_limit_field": {"kind": "bounded", "gain": 10.0, "influence": 0.3},
    },
}

_Made = tuple[Array, Array, list[Document]]


def _posed(
    arm: str, q: Array, place: Array, obstacles: list[Document], room: float, seed: int
) -> Array | None:
    """A configuration with the tip at a place, `room` [m] from everything, found from `q`; none if there is
    none.

    It is where a motion ends that starts at `q`, so that nothing separates the two.
    """
    found = plan(_scene(arm, "", 0, q, place, obstacles), margin=room, seed=seed, samples=3000)
    return found.q[-1] if found.status == "found" and found.margin >= 0.99 * room else None


def _blocked(a: Array, b: Array, walls: list[Document]) -> bool:
    """Whether a straight line goes through one of some boxes."""
    for wall in walls:
        half = 0.5 * np.asarray(wall["shape"]["size"])
        along = a + np.linspace(0.0, 1.0, 101)[:, None] * (b - a) - np.asarray(wall["position"])
        turn = wall.get("angle", 0.0)
        if "orientation" in wall:  # about z
            w, z = wall["orientation"][0], wall["orientation"][3]
            turn = 2.0 * math.atan2(z, w)
        c, s = math.cos(turn), math.sin(turn)
        seen = along.copy()
        seen[:, 0], seen[:, 1] = c * along[:, 0] + s * along[:, 1], c * along[:, 1] - s * along[:, 0]
        if (np.abs(seen) < half).all(axis=1).any():
            return True
    return False


def _folded(draw: Draw) -> Array:
    """A posture of the plane with all links in one half, and the tip not far from the base."""
    side = draw.sign()
    return np.array([draw.uniform(-math.pi, math.pi)] + [side * draw.uniform(0.4, 0.9) for _ in range(5)])


def _tip(q: Array) -> Array:
    return np.array([part.sum() for part in cos_sin(np.cumsum(q))])


def _wall(middle: Array, along: float, length: float, thick: float) -> Document:
    """A box of the plane, `length` [m] in the direction `along` [rad]."""
    return {
        "shape": {"kind": "box", "size": rounded([length, thick])},
        "position": rounded(middle),
        "angle": round(along, 4),
    }


def _unit(angle: float) -> Array:
    return np.array([math.cos(angle), math.sin(angle)])


def _plane_pocket(draw: Draw) -> _Made | None:
    """A pocket of three walls about the goal, open sideways or away; the tip starts behind a wall."""
    q = _folded(draw)
    out = draw.uniform(-math.pi, math.pi)
    goal = draw.uniform(2.5, 4.0) * _unit(out)
    opening = out + draw.sign() * draw.uniform(0.6, 2.2)
    width, depth, thick = draw.uniform(0.7, 1.0), draw.uniform(0.7, 1.1), 0.1
    inside = draw.uniform(0.4, 0.6) * depth
    ahead, aside = _unit(opening), _unit(opening + 0.5 * math.pi)
    back = goal - (depth - inside) * ahead
    walls = [
        _wall(back, opening + 0.5 * math.pi, width + 2 * thick, thick),
        *(
            _wall(back + 0.5 * depth * ahead + side * 0.5 * (width + thick) * aside, opening, depth, thick)
            for side in (-1, 1)
        ),
    ]
    return (q, goal, walls) if _blocked(_tip(q), goal, walls) else None


def _plane_gap(draw: Draw) -> _Made | None:
    """A wall with a gap; the line to the goal behind it does not lead through the gap."""
    q = _folded(draw)
    out = draw.uniform(-math.pi, math.pi)
    ahead, aside = _unit(out), _unit(out + 0.5 * math.pi)
    away, gap, shift = draw.uniform(1.6, 2.2), draw.uniform(0.5, 0.8), draw.uniform(-0.8, 0.8)
    thick, length = draw.uniform(0.1, 0.3), 5.0
    walls = [
        _wall(
            away * ahead + (shift + side * 0.5 * (gap + length)) * aside, out + 0.5 * math.pi, length, thick
        )
        for side in (-1, 1)
    ]
    goal = (away + draw.uniform(0.6, 1.6)) * ahead + (shift + draw.sign() * draw.uniform(0.5, 1.2)) * aside
    before = float((_tip(q) * ahead).sum()) < away - 0.3
    return (q, goal, walls) if before and _blocked(_tip(q), goal, walls) else None


def _plane_shelf(draw: Draw) -> _Made | None:
    """Two cells side by side, open towards the base: the tip starts in one, and has to go to the other."""
    out = draw.uniform(-math.pi, math.pi)
    ahead, aside = _unit(out), _unit(out + 0.5 * math.pi)
    near, depth, thick = draw.uniform(2.4, 3.2), draw.uniform(0.8, 1.2), 0.1
    heights = [draw.uniform(0.8, 1.1) for _ in range(2)]
    boards = [-heights[0], 0.0, heights[1]]
    walls = [_wall((near + 0.5 * depth) * ahead + at * aside, out, depth, thick) for at in boards]
    middle, whole_ = 0.5 * (heights[1] - heights[0]), sum(heights) + thick
    walls.append(_wall((near + depth) * ahead + middle * aside, out + 0.5 * math.pi, whole_, thick))
    inside = [near + draw.uniform(0.4, 0.7) * depth for _ in range(2)]
    first = draw.sign()
    places = [
        inside[k] * ahead + side * 0.5 * heights[0 if side < 0 else 1] * aside
        for k, side in enumerate((first, -first))
    ]
    folded = np.array([out + 1.2, *([-0.9] * 5)]) if draw.whole(0, 1) else np.array([out - 1.2, *([0.9] * 5)])
    q = _posed("plane", folded, places[0], walls, _ROOM["plane"], draw.whole(0, 999))
    return None if q is None else (q, places[1], walls)


def _plane_post(draw: Draw) -> _Made | None:
    """A post that links would hit half of the way, on a goal that the tip could reach by a straight line."""
    q = _folded(draw)
    end = _folded(draw)
    end[0] = q[0] + draw.sign() * draw.uniform(1.6, 2.8)
    half = np.cumsum(0.5 * (q + end))
    joints = np.cumsum(np.stack(cos_sin(half), axis=1), axis=0)
    post: Document = {
        "shape": {"kind": "circle", "radius": draw.uniform(0.2, 0.4)},
        "position": rounded(joints[draw.whole(1, 2)]),
    }
    goal = _tip(end)
    if math.dist(goal, post["position"]) < 0.8 or math.hypot(*post["position"]) < 0.8:
        return None
    if math.dist(goal, _tip(q)) < 2.0:
        return None
    return (q, goal, [post]) if _is_clear("plane", q, goal, [post]) else None


def _closing(draw: Draw, door: Document, hidden: Array) -> Document:
    """A door that slides to where it is given from where it is hidden, later than a planner looks ahead."""
    begin = draw.uniform(1.0, 1.5)
    times = rounded([begin, begin + draw.uniform(0.8, 1.2)])
    points = [rounded(hidden), door["position"]]
    return door | {"position": points[0], "motion": {"kind": "waypoints", "times": times, "points": points}}


def _two_gaps(
    draw: Draw, piece: Callable[[float, float], Document], aside: Array, post: float, gaps: list[float],
    length: float,
) -> tuple[list[Document], int]:  # fmt: skip
    """A wall with a gap on either side of a post, of pieces at places along it, so and so wide; and which of
    the gaps a door shuts.
    """
    walls = [piece(0.0, post)]
    walls += [
        piece(side * (0.5 * (post + length) + gap), length) for side, gap in zip((-1, 1), gaps, strict=True)
    ]
    shut = draw.whole(0, 1)
    side, gap = (-1, 1)[shut], gaps[shut]
    door = piece(side * 0.5 * (post + gap), gap)
    walls.append(_closing(draw, door, np.asarray(door["position"]) + side * gap * aside))
    return walls, shut


def _plane_door(draw: Draw) -> _Made | None:
    """A wall with two gaps, of which one is shut while the arm is on its way."""
    q = _folded(draw)
    out = draw.uniform(-math.pi, math.pi)
    ahead, aside = _unit(out), _unit(out + 0.5 * math.pi)
    away, thick, length = draw.uniform(1.6, 2.2), draw.uniform(0.1, 0.2), 5.0
    gaps = [draw.uniform(0.6, 0.9) for _ in range(2)]
    post, shift = draw.uniform(0.9, 1.4), draw.uniform(-0.5, 0.5)

    def piece(at: float, wide: float) -> Document:
        return _wall(away * ahead + (shift + at) * aside, out + 0.5 * math.pi, wide, thick)

    walls, _ = _two_gaps(draw, piece, aside, post, gaps, length)
    goal = (away + draw.uniform(0.6, 1.4)) * ahead + (shift + 0.4 * draw.uniform(-1.0, 1.0) * post) * aside
    before = float((_tip(q) * ahead).sum()) < away - 0.3
    return (q, goal, walls) if before and _blocked(_tip(q), goal, walls[:3]) else None


def _is_clear(arm: str, q: Array, goal: Array, obstacles: list[Document]) -> bool:
    """Whether a start has room."""
    start = plan(_scene(arm, "", 0, q, goal, obstacles), q, margin=_ROOM[arm], samples=0)
    return start.status == "found" and start.margin >= 0.99 * _ROOM[arm]


_READY = np.array([0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854])


def _board(middle: Array, turn: float, size: list[float]) -> Document:
    """A box in space, turned about z [rad]."""
    return {
        "shape": {"kind": "box", "size": rounded(size)},
        "position": rounded(middle),
        "orientation": rounded([math.cos(0.5 * turn), 0.0, 0.0, math.sin(0.5 * turn)], 17),
    }


def _panda_start(draw: Draw) -> Array:
    q: Array = _READY + [draw.uniform(-far, far) for far in (0.6, 0.3, 0.3, 0.3, 0.3, 0.3, 0.5)]
    return q


def _panda_tip(q: Array) -> Array:
    import vffnull._core as _core

    return np.asarray(_core.Arm.named("panda").forward_kinematics(q)[-1])


def _panda_pocket(draw: Draw) -> _Made | None:
    """A box on its side about the goal, open sideways."""
    q = _panda_start(draw)
    out = draw.uniform(-0.9, 0.9)
    goal = np.append(draw.uniform(0.45, 0.6) * _unit(out), draw.uniform(0.12, 0.25))
    opening = out + draw.sign() * draw.uniform(0.8, 1.8)
    width, depth, thick = draw.uniform(0.36, 0.46), draw.uniform(0.2, 0.28), 0.02
    tall = draw.uniform(0.5, 0.6)
    ahead, aside = np.append(_unit(opening), 0.0), np.append(_unit(opening + 0.5 * math.pi), 0.0)
    foot = np.array([goal[0], goal[1], 0.5 * tall])
    walls = [_board(foot - 0.5 * depth * ahead, opening, [thick, width, tall])]
    walls += [_board(foot + side * 0.5 * width * aside, opening, [depth, thick, tall]) for side in (-1, 1)]
    walls.append(_board(foot + 0.5 * tall * np.eye(3)[2], opening, [depth, width, thick]))
    clear = _blocked(_panda_tip(q), goal, walls) and _is_clear("panda", q, goal, walls)
    return (q, goal, walls) if clear else None


def _panda_shelf(draw: Draw) -> _Made | None:
    """Two cells one above the other, open towards the base: from one to the other."""
    out = draw.uniform(-0.7, 0.7)
    ahead, aside, up = np.append(_unit(out), 0.0), np.append(_unit(out + 0.5 * math.pi), 0.0), np.eye(3)[2]
    near, depth, width, thick = (
        draw.uniform(0.42, 0.5),
        draw.uniform(0.25, 0.32),
        draw.uniform(0.5, 0.7),
        0.02,
    )
    low = draw.uniform(0.05, 0.15)
    heights = [draw.uniform(0.3, 0.38) for _ in range(2)]
    levels = [low, low + heights[0], low + sum(heights)]
    middle = (near + 0.5 * depth) * ahead
    boards = [_board(middle + level * up, out, [depth, width, thick]) for level in levels]
    tall, centre = levels[2] - levels[0], 0.5 * (levels[0] + levels[2])
    boards.append(_board((near + depth) * ahead + centre * up, out, [thick, width, tall]))
    boards += [
        _board(middle + side * 0.5 * width * aside + centre * up, out, [depth, thick, tall])
        for side in (-1, 1)
    ]
    inside = [near + draw.uniform(0.3, 0.5) * depth for _ in range(2)]
    sides = [draw.uniform(-0.2, 0.2) * width for _ in range(2)]
    places = [
        inside[k] * ahead + sides[k] * aside + (levels[k] + draw.uniform(0.45, 0.55) * heights[k]) * up
        for k in range(2)
    ]
    first = draw.whole(0, 1)
    q = _posed("panda", _READY, places[first], boards, _ROOM["panda"], draw.whole(0, 999))
    return None if q is None else (q, places[1 - first], boards)


def _panda_gap(draw: Draw) -> _Made | None:
    """A wall of two upright boards with a gap; the goal is behind one of them."""
    q = _panda_start(draw)
    out = draw.uniform(-0.6, 0.6)
    ahead, aside, up = np.append(_unit(out), 0.0), np.append(_unit(out + 0.5 * math.pi), 0.0), np.eye(3)[2]
    away, gap, thick = draw.uniform(0.48, 0.55), draw.uniform(0.28, 0.36), 0.02
    length, tall = 0.6, 1.2
    shift = draw.uniform(-0.15, 0.15)
    walls = [
        _board(
            away * ahead + (shift + side * 0.5 * (gap + length)) * aside + 0.5 * tall * up,
            out,
            [thick, length, tall],
        )
        for side in (-1, 1)
    ]
    goal = (
        (away + draw.uniform(0.08, 0.15)) * ahead
        + (shift + draw.sign() * draw.uniform(0.5, 0.75) * gap) * aside
        + draw.uniform(0.3, 0.5) * up
    )
    q[3] = -2.7 + draw.uniform(-0.1, 0.1)  # the hand before the wall
    clear = _blocked(_panda_tip(q), goal, walls) and _is_clear("panda", q, goal, walls)
    return (q, goal, walls) if clear else None


def _panda_door(draw: Draw) -> _Made | None:
    """An upright wall with two gaps, of which one is shut while the arm is on its way."""
    q = _panda_start(draw)
    out = draw.uniform(-0.3, 0.3)
    ahead, aside, up = np.append(_unit(out), 0.0), np.append(_unit(out + 0.5 * math.pi), 0.0), np.eye(3)[2]
    away, thick, length, tall = draw.uniform(0.45, 0.5), 0.02, 0.6, 1.2
    gaps = [draw.uniform(0.3, 0.38) for _ in range(2)]
    post, shift = draw.uniform(0.12, 0.2), draw.uniform(-0.05, 0.05)

    def piece(at: float, wide: float) -> Document:
        return _board(away * ahead + (shift + at) * aside + 0.5 * tall * up, out, [thick, wide, tall])

    walls, shut = _two_gaps(draw, piece, aside, post, gaps, length)
    # Behind the gap that is shut: the shorter way leads through it.
    goal = (
        (away + draw.uniform(0.06, 0.12)) * ahead
        + (shift + (-1, 1)[shut] * draw.uniform(0.1, 0.6) * (0.5 * post + gaps[shut])) * aside
        + draw.uniform(0.3, 0.5) * up
    )
    q[3] = -2.7 + draw.uniform(-0.1, 0.1)  # the hand before the wall
    return (q, goal, walls) if _is_clear("panda", q, goal, walls) else None


def _panda_post(draw: Draw) -> _Made | None:
    """A post from the floor to above the arm, which that has to go round from one side to the other."""
    side = draw.sign()
    q = _panda_start(draw)
    q[0] = side * draw.uniform(0.5, 0.9)
    start = _panda_tip(q)
    turn = -side * draw.uniform(0.5, 0.9)
    goal = np.append(draw.uniform(0.45, 0.6) * _unit(turn), draw.uniform(0.25, 0.5))
    at = draw.uniform(0.3, 0.4) * _unit(
        0.5 * (math.atan2(start[1], start[0]) + turn) + draw.uniform(-0.2, 0.2)
    )
    post: Document = {
        "shape": {
            "kind": "capsule",
            "a": [0.0, 0.0, 0.0],
            "b": [0.0, 0.0, draw.uniform(0.55, 0.75)],
            "radius": draw.uniform(0.03, 0.05),
        },
        "position": [*rounded(at), 0.0],
    }
    return (q, goal, [post]) if _is_clear("panda", q, goal, [post]) else None


_MAKE: dict[str, dict[str, Callable[[Draw], _Made | None]]] = {
    "plane": {
        "pocket": _plane_pocket,
        "shelf": _plane_shelf,
        "gap": _plane_gap,
        "post": _plane_post,
        "door": _plane_door,
    },
    "panda": {
        "pocket": _panda_pocket,
        "shelf": _panda_shelf,
        "gap": _panda_gap,
        "post": _panda_post,
        "door": _panda_door,
    },
}


def _crowd(arm: str, draw: Draw, seed: int) -> Scenario:
    """A crowd among which the tip follows a line."""
    first = 0 if seed < EVALUATION.start else EVALUATION.start
    while True:
        other = first + draw.whole(0, 999_999)
        scene = (
            random("crowd", _JOINTS, other)
            if arm == "plane"
            else in_space("crowd", "panda", "position", other)
        )
        if scene["reference.kind"] == "line":
            return scene.replace(name=f"crowd-{arm}-{seed}")
