"""Whether a collision-free motion exists in a scene: found by a planner that knows
all motions of the obstacles in advance, and no controller.

The rule, fixed before any controller was run on random scenes:

A **motion** is a sequence of joint angles from the scene's start, 50 ms apart, straight in between, within
the arm's joint limits, with joint speeds up to its limits, 3 rad/s where it has none, and accelerations up
to 30 rad/s² in the plane and 10 rad/s² in space (change of speed from one piece to the next over 50 ms). It
is **clear** if every link keeps 1 mm or more from every obstacle at all instants 5 ms apart. A scene is

- ``"with tip"`` if a clear motion is found whose tip is never more than 1 cm from its reference and, for
  tasks with an orientation, never turned from it by more than 0.05 rad,
- ``"without tip"`` if only a clear motion is found that leaves the reference,
- ``"none found"`` if neither is found within the budget.

The search is in the core (``planning/feasibility`` says how it works and what its budget is). "None found"
is no proof: the search can miss a motion. What it finds is one. Links may cross each other, as they may in
the plant; torques are not looked at.

`is_clear` checks a motion by the second implementation of the geometry (`vffnull.evaluation.geometry`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull.evaluation.geometry.arm import cos_sin, product, quaternion, rotation
from vffnull.evaluation.geometry.motion import Array
from vffnull.evaluation.geometry.plane import Kinematics, World
from vffnull.evaluation.geometry.space import Bodies, Obstacles
from vffnull.model.arm import arm_of, is_spatial
from vffnull.model.scenario import ScenarioLike, prepare
from vffnull.model.settings import setting

__all__ = [
    "ANGLE",
    "TIP",
    "VERDICTS",
    "escape",
    "feasibility",
    "is_clear",
    "reference_points",
    "reference_poses",
    "travelled",
]

VERDICTS = ("with tip", "without tip", "none found")

STEP = 0.05  # s, one piece of a motion
MAX_SPEED = 3.0  # rad/s, of joints without a limit
MAX_ACCELERATION = {2: 30.0, 3: 10.0}  # rad/s², by the dimension of the space
CLEARANCE = 1e-3  # m, what a motion has to keep
TIP = 1e-2  # m, how far the tip may be from its reference
ANGLE = 5e-2  # rad, how far it may be turned from it, for tasks with an orientation


def feasibility(scenario: ScenarioLike) -> str:
    """Whether a collision-free motion exists in a scene, by the rule of this module.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        A scene, in the plane or in space; what `vffnull.simulate` accepts.

    Returns
    -------
    {"with tip", "without tip", "none found"}
        What the planner has found; always the same for a scene.

    Raises
    ------
    vffnull.errors.ScenarioError
        If it cannot be run.
    vffnull.errors.InputTypeError
        If it is no scenario.
    """
    return escape(scenario)[0]


def escape(scenario: ScenarioLike) -> tuple[str, Array | None]:
    """The same, with the motion that was found.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        A scene, in the plane or in space; what `vffnull.simulate` accepts.

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
        Whether the tip has to be held.
    """
    if is_spatial(scene["arm"]):
        return _is_clear_in_space(scene, motion, hold)
    arm = Kinematics.of(scene["arm"])
    world = World(scene.get("obstacles", ()))
    times, q = _between(motion)
    joints = arm.joints(q)
    if hold:
        path = reference_points(scene["reference"], joints[0, -1], times)
        if np.linalg.norm(joints[:, -1] - path, axis=1).max() > TIP:
            return False
    return bool(world.clearance(joints, arm.radius, times).min() >= CLEARANCE)


def _is_clear_in_space(scene: Mapping[str, Any], motion: Array, hold: bool) -> bool:
    arm = arm_of(scene["arm"]).to_dict()
    bodies, obstacles = Bodies(arm), Obstacles(scene.get("obstacles", ()))
    times, q = _between(motion)
    moving = bodies.link >= 0  # the base is not measured in the plant either
    apart = obstacles.distances(bodies.ends(q)[:, moving], bodies.radius[moving], times)
    if apart.min(initial=np.inf) < CLEARANCE:
        return False
    tip = bodies.arm.tool_poses(q)
    due = reference_poses(scene["reference"], tip[0], times)
    far = np.linalg.norm(tip[:, :3, 3] - due[:, :3, 3], axis=1).max()
    task = setting(scene, "controller.task")
    if task == "pointing":
        cosine = (tip[:, :3, 2] * due[:, :3, 2]).sum(axis=1)
    else:
        cosine = 0.5 * ((tip[:, :3, :3] * due[:, :3, :3]).sum(axis=(1, 2)) - 1.0)
    turned = 0.0 if task == "position" else np.arccos(np.clip(cosine, -1.0, 1.0)).max()
    return not hold or bool(far <= TIP and turned <= ANGLE)


def _between(motion: Array) -> tuple[Array, Array]:
    """Instants 5 ms apart [s] and the joint angles then."""
    knots = STEP * np.arange(len(motion))
    times = np.linspace(0.0, knots[-1], 10 * (len(motion) - 1) + 1)
    q = np.stack([np.interp(times, knots, column) for column in np.asarray(motion, dtype=float).T], axis=1)
    return times, q


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


def reference_poses(reference: Mapping[str, Any], start: Array, times: Array) -> Array:
    """Where the tip has to be in space.

    Parameters
    ----------
    reference : Mapping
        A set point, or a line.
    start : (4, 4) ndarray
        Where the tip is at t = 0.
    times : (k,) ndarray
        Instants [s].

    Returns
    -------
    (k, 4, 4) ndarray
        Poses.

    Raises
    ------
    vffnull.errors.InputError
        If the reference is of another kind.
    """
    relative = bool(reference.get("relative", False))

    def given(point: str, orientation: str, default: Array) -> Array:
        pose = default.copy()
        if point in reference:
            at = np.asarray(reference[point], dtype=float)
            pose[:3, 3] = start[:3, 3] + at if relative else at
        if orientation in reference:
            turn = rotation(reference[orientation])
            pose[:3, :3] = product(turn, start[:3, :3]) if relative else turn
        return pose

    if reference["kind"] == "setpoint":
        return np.tile(given("point", "orientation", start), (len(times), 1, 1))
    if reference["kind"] != "line":
        raise InputError(f"reference.kind: expected setpoint or line, not {reference['kind']}")
    begin = given("start", "start_orientation", start)
    end = given("end", "orientation", begin)
    share = travelled(times / reference["duration"])
    poses = np.tile(begin, (len(times), 1, 1))
    poses[:, :3, 3] += share[:, None] * (end[:3, 3] - begin[:3, 3])
    between = quaternion(product(end[:3, :3], begin[:3, :3].T))
    half = math.atan2(np.linalg.norm(between[1:], axis=-1), between[0])
    axis = between[1:] / math.sin(half) if half > 0.0 else between[1:]
    c, s = (each[:, None] for each in cos_sin(share * half))
    poses[:, :3, :3] = product(rotation(np.concatenate([c, s * axis], axis=1)), begin[:3, :3])
    return poses


def travelled(share: Array) -> Array:
    """The travelled fraction of a line from rest to rest, over the fraction of its time."""
    s = np.clip(share, 0.0, 1.0)
    fraction: Array = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
    return fraction
