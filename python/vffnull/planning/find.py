"""Plans a motion of a scenario's arm to a goal."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from dataclasses import replace
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

import vffnull._core as _core
from vffnull._support.arguments import number, positive, whole
from vffnull._support.errors import InputError, InputTypeError, ScenarioError
from vffnull.model.arm import dimension_of
from vffnull.model.document import Document
from vffnull.model.scenario import ScenarioLike, prepare
from vffnull.planning.motion import Plan, PlanStatus

__all__ = ["Goal", "plan"]

Goal = ArrayLike | Mapping[str, ArrayLike] | tuple[ArrayLike, ArrayLike]
"""A configuration, a position, or a position with an orientation."""

_MAX_SAMPLES = 10_000_000
_MAX_PATHS = 1000
_LATEST = 1e100  # [s]


def plan(
    scenario: ScenarioLike,
    goal: Goal | Sequence[Goal] | None = None,
    *,
    start: ArrayLike | None = None,
    time: float = 0.0,
    pause: float = 0.5,
    margin: float = 0.02,
    horizon: float | None = 1.0,
    tilt: float | None = None,
    view: ArrayLike | None = None,
    view_angle: float = 0.35,
    approach: ArrayLike | None = None,
    retreat: ArrayLike | None = None,
    acceleration: ArrayLike | None = None,
    jerk: ArrayLike | None = None,
    speed: float = 0.5,
    samples: int = 100_000,
    paths: int = 4,
    seed: int = 0,
) -> Plan:
    """Plan a motion of all joints to a goal, around what is in the way.

    Two trees of configurations, one from the start and one from all goals, grow towards each other
    (RRT-Connect); the path is shortened and rounded, and followed as fast as the joints allow. Every
    piece of it is certified to be free, not sampled. The same arguments give the same plan.

    Parameters
    ----------
    scenario : str, path, Mapping or Scenario
        The arm, its obstacles and where it starts; what `vffnull.simulate` accepts.
    goal : (n,) array_like, Mapping or tuple, or list of them, optional
        Where to go: a configuration [rad]; ``{"position": …}`` [m], with ``"orientation"`` a pose (an
        angle [rad] in the plane, a quaternion [w, x, y, z] in space); or (position, orientation). A list of
        goals, or the rows of an array, one after the other. By default where the scenario's reference is at
        the end of its duration, as far as its task cares.
    start : (n,) array_like, optional
        Where the joints are [rad]; ``q0`` by default.
    time : float, optional
        When the motion starts [s]: obstacles are where their motion has them then.
    pause : float, optional
        How long the arm rests at every goal but the last [s], > 0.
    margin : float, optional
        What every link keeps from obstacles [m]; less near a start or goal that has less, and less all
        the way where nothing else is found: the message says so. From an obstacle with a `margin` of its own
        they keep that.
    horizon : float or None, optional
        For how long the places that obstacles will pass are kept free [s], as their motion is known. With
        0 they are taken as they are at `time`, with None those that move then are left out.
    tilt : float, optional
        How far the end effector may lean from how it stands at the start [rad], > 0, whichever way it turns
        about the vertical; in the plane how far it may turn. By default that does not matter. Of several
        goals, from how it stands before the first.
    view : (2,) or (3,) array_like, optional
        A point that the end effector keeps in view all the way [m]: no more than `view_angle` off its axis,
        z in space and the last link in the plane. What stands in between does not matter. Where it looks
        elsewhere at the start, it turns to the point. By default it looks anywhere.
    view_angle : float, optional
        How far off its axis that point may be [rad], > 0.
    approach : float or (2,) or (3,) array_like, optional
        How far the end effector comes straight to the goal, without turning [m], >= 0: along what it has in
        front of it there, z in space and the last link in the plane. Or the vector along which it comes [m].
        The arm rests for a moment where that begins. By default it comes any way. With several goals, to each
        of them.
    retreat : float or (2,) or (3,) array_like, optional
        The same of how it leaves the start: straight back, or along a vector. With several goals, each of
        them on the way to the next, too.
    acceleration : float or (n,) array_like, optional
        The limit of acceleration [rad/s²], > 0, for all joints or one each; 30 rad/s² in the plane and
        10 rad/s² in space by default.
    jerk : float or (n,) array_like, optional
        The limit of jerk [rad/s³], > 0. By default that does not matter; accelerations come and go
        within 60 ms.
    speed : float, optional
        The share of the limits of speed, acceleration and jerk that is used, in (0, 1]. Joints without a
        limit of speed take 3 rad/s for it. Of a torque limit 80 % are used, gravity included.
    samples : int, optional
        How many random configurations are tried before the search gives up.
    paths : int, optional
        How many paths are searched, of which the shortest is taken. One is there in a fraction of the
        time, and is longer as a rule.
    seed : int, optional
        Where the random numbers come from.

    Returns
    -------
    Plan
        The motion. If none was found, its status says why, and it holds how far the search came; of several
        goals, for the first that is not reached.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the scenario cannot be run, or an argument is out of its range: start and goal are within 100
        rad or m of 0. If a limit makes the motion take more than an hour.
    vffnull.errors.InputError, vffnull.errors.InputTypeError
        If an argument has the wrong shape, is not finite, or is of a type that cannot be used.
    KeyboardInterrupt
        After Ctrl-C, within a fraction of a second.

    Examples
    --------
    >>> found = plan("narrow-gap")
    >>> print(found.status)
    found
    >>> there_and_back = plan("narrow-gap", [found.q[-1], found.q[0]])
    >>> bool(there_and_back.duration > 2 * found.duration)
    True

    With what the hand carries no more than 10° from upright:

    >>> level = plan("panda-shelf", horizon=0, tilt=np.radians(10))
    >>> bool(level.tilt <= np.radians(10))
    True

    With a camera in the hand that keeps looking at what is on the table:

    >>> seen = plan("panda-shelf", horizon=0, view=[0.0, 0.9, 0.5], view_angle=0.9)
    >>> bool(seen.view <= 0.9)
    True

    Down onto the goal for the last 8 cm, as a gripper does:

    >>> down = plan("panda-shelf", horizon=0, approach=0.08)
    >>> bool(down.duration > plan("panda-shelf", horizon=0).duration)
    True
    """
    document = prepare(scenario)._document  # it does not change here, and to copy it takes milliseconds
    dimension = dimension_of(document["arm"])
    at = None if start is None else _vector("start", start, len(document["q0"]))
    now = _finite("time", time)
    angle = positive("view_angle", view_angle)
    settings: dict[str, Any] = {
        "margin": _finite("margin", margin),
        "horizon": None if horizon is None else _finite("horizon", horizon),
        "tilt": None if tilt is None else positive("tilt", tilt),
        "upright": None if tilt is None else document["q0"] if at is None else at,
        "view": None if view is None else (_vector("view", view, dimension), angle),
        "approach": _straight("approach", approach, dimension),
        "retreat": _straight("retreat", retreat, dimension),
        "acceleration": _each("acceleration", acceleration, len(document["q0"])),
        "jerk": _each("jerk", jerk, len(document["q0"])),
        "speed": _finite("speed", speed),
        "samples": whole("samples", samples, 0, _MAX_SAMPLES),
        "paths": whole("paths", paths, 1, _MAX_PATHS),
        "seed": whole("seed", seed, 0, 2**64 - 1),
    }
    rest = positive("pause", pause)
    several = _several(goal)
    if several is None:
        return _to_one(dimension, _aimed("goal", document, goal, dimension), at, now, settings)
    if not several:
        raise InputError("goal: expected one or more, got an empty list")
    aims = [_aimed(f"goal[{i}]", document, each, dimension) for i, each in enumerate(several)]
    tour: Plan | None = None
    for i, aim in enumerate(aims):
        leg = _to_one(dimension, aim, at, now, settings)
        if leg.status is not PlanStatus.FOUND:
            return replace(leg, message=f"goal {i + 1} of {len(aims)}: {leg.message}")
        tour = leg if tour is None else tour.then(leg, rest)  # at once: a pause may be too long for it
        # No later than a plan may begin: so long a pause is refused when the next motion follows.
        at, now = leg.q[-1].tolist(), min(now + leg.duration + rest, _LATEST)
    assert tour is not None
    return tour


def _several(goal: Any) -> list[Any] | None:
    """Goals one after the other, if it is not one of them."""
    if isinstance(goal, np.ndarray) and goal.ndim == 2:
        return list(goal)
    if isinstance(goal, list) and not (goal and isinstance(goal[0], Real)):
        return goal
    return None


def _to_one(
    dimension: int,
    aim: _Aim,
    start: list[float] | None,
    time: float,
    settings: Mapping[str, Any],
) -> Plan:
    """A motion from where the arm is then to one goal."""
    begun = clock.perf_counter()
    name, document, configuration = aim
    try:
        found = _core.plan(document, goal=configuration, start=start, time=time, **settings)
    except ScenarioError as error:
        raise error if name is None else _of_goal(name, dimension, error) from None
    wall_time = clock.perf_counter() - begun
    status = PlanStatus(found.pop("status"))
    ignored = tuple((str(a), str(b)) for a, b in _ignored(document["arm"]))
    return Plan(status=status, wall_time=wall_time, ignored=ignored, **found)


def _ignored(arm: Mapping[str, Any]) -> list[Sequence[str]]:
    """The pairs of links that an arm ignores."""
    of_model = _core.arm_model(arm["model"]).get("ignore", []) if "model" in arm else []
    return [*of_model, *arm.get("ignore", [])]


def _of_goal(name: str, dimension: int, error: ScenarioError) -> ScenarioError:
    """What is wrong with the reference that stands for a goal, said of the goal."""
    inside = error.path.removeprefix("reference.")
    if inside == error.path:
        return error
    is_turn = inside in ("orientation", f"point[{dimension}]")
    path = f"{name} {'orientation' if is_turn else inside.replace('point', 'position')}"
    return ScenarioError(str(error).replace(error.path, path, 1), path)


_Aim = tuple[str | None, Document, list[float] | None]
"""What people call a goal whose pose is where the reference ends now, the document, and a configuration."""


def _aimed(name: str, document: Document, goal: Any, dimension: int) -> _Aim:
    """The document whose reference ends at the goal; or the document, and the goal as a configuration."""
    joints = len(document["q0"])
    if goal is None:
        return None, document, None
    position: Any
    orientation: Any = None
    if isinstance(goal, Mapping):
        if "position" not in goal or not set(goal) <= {"position", "orientation"}:
            names = ", ".join(str(key)[:40] for key in goal)
            raise InputError(
                f"{name}: expected position and, if it matters, orientation, got {names or 'neither'}"
            )
        position, orientation = goal["position"], goal.get("orientation")
    elif isinstance(goal, tuple) and len(goal) == 2 and isinstance(goal[0], Sequence | np.ndarray):
        position, orientation = goal
    else:
        numbers = _numbers(name, goal)
        if len(numbers) == joints:
            return None, document, numbers
        if len(numbers) != dimension:
            raise InputError(
                f"{name}: expected a configuration of {joints} numbers, a position of {dimension}, or "
                f"(position, orientation), got {len(numbers)} numbers"
            )
        position = numbers
    point = _vector(f"{name} position", position, dimension)
    reference: Document = {"kind": "setpoint", "point": point}
    if orientation is not None:
        turned = _numbers(f"{name} orientation", orientation)
        if dimension == 2:
            reference["point"] = [*point, *_vector(f"{name} orientation", turned, 1)]
        else:
            reference["orientation"] = _vector(f"{name} orientation", turned, 4)
    controller: Document = {"task": "position" if orientation is None else "pose"}
    # Whatever the law's task is, the plan is for what it keeps apart and sends.
    law = document.get("controller", {})
    controller |= {key: law[key] for key in ("self_collision", "command") if key in law}
    return name, {**document, "reference": reference, "controller": controller}, None


def _numbers(name: str, value: Any) -> list[float]:
    try:
        found = np.atleast_1d(np.asarray(value, dtype=float))
    except (TypeError, ValueError):
        raise InputTypeError(f"{name}: expected numbers, not {str(value)[:40]!r}") from None
    if found.ndim != 1:
        raise InputError(f"{name}: expected one row of numbers, got an array of shape {found.shape}")
    if not np.isfinite(found).all():
        raise InputError(f"{name}: must be finite")
    return [float(each) for each in found]


def _vector(name: str, value: Any, n: int) -> list[float]:
    found = _numbers(name, value)
    if len(found) != n:
        raise InputError(f"{name}: expected {n} numbers, got {len(found)}")
    return found


def _each(name: str, value: Any, n: int) -> list[float] | None:
    """One number for each joint, from one each or one for all."""
    if value is None:
        return None
    return [number(name, value)] * n if np.ndim(value) == 0 else _vector(name, value, n)


def _straight(name: str, value: Any, dimension: int) -> list[float] | None:
    """A length as one number, or a vector."""
    if value is None:
        return None
    return [_finite(name, value)] if np.ndim(value) == 0 else _vector(name, value, dimension)


def _finite(name: str, value: object) -> float:
    found = number(name, value)
    if not np.isfinite(found):
        raise InputError(f"{name}: must be finite")
    return found
