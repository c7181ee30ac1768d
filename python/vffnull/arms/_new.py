"""A scenario to start from, for an arm of one's own."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull.arms._touching import spread
from vffnull.model.arm import arm_of
from vffnull.model.motion import Motion
from vffnull.model.obstacle import Obstacle
from vffnull.model.settings import setting

if TYPE_CHECKING:
    from vffnull.arms._report import Report

__all__ = ["scenario_text"]

Array = NDArray[np.float64]

TRIED = 256
"""Postures of which the best is where the arm starts."""
INNER = (0.5, 0.75, 0.95)
"""Shares of the ranges of the joints in which they are: a wider one where links touch in all of the first."""
HELD = 0.5
"""Share of the torque limits that may be needed to stand there."""
COMPENSATED = 0.9
"""Share of the friction in the joints that the controller is to make up for: all of it would drive them."""
STEP, EXPLICIT = 1e-3, 2.0
"""Control period [s], and how far friction may decay in a step of the simulation, which swings beyond."""
ROUNDING = 1e-12
"""Share of the most that the tip yields in some direction, below which it yields by rounding alone."""
NUDGE, LEVER = 1e-4, 1e-3
"""How far each joint goes to find out what it moves [rad or m], and how far a radian moves that [m]."""
STANDS = 0.15
"""A link of which the joints that turn move the far end by less, a radian, in parts of the reach, stands."""
PUSH = 4.5
"""Force of the field at contact for each kilogram that moves [N/kg]: a gentle push."""


def scenario_text(report: Report, table: Mapping[str, Any]) -> str:
    """A scenario as TOML with comments: an arm that was read holds its tip while a ball passes its elbow.

    Parameters
    ----------
    report : Report
        What was read of the arm.
    table : Mapping
        The ``[arm]`` that reads it again.

    Raises
    ------
    vffnull.errors.InputError
        If no posture is found in which the arm is bent, touches nothing and can hold itself.
    """
    arm = arm_of(report.document)
    q0 = _bent(report.document, arm)
    reach = _reach(arm)
    radius, influence, speed = 0.09 * reach, 0.3 * reach, 0.25 * reach
    start, across = _passing(arm, np.asarray(q0), radius, speed)
    mass = sum(joint["mass"] for joint in report.document["joints"])
    pull = 9.0 * np.diag(arm.mass_matrix(q0))  # as a spring of 3 rad/s at each joint by itself
    task = "pose" if arm.n >= 7 else "position"
    name = report.document.get("name") or report.document["tip"]
    yields = _yielding(arm, q0, task, reach)
    rubs = {key: np.array([joint.get(key, 0.0) for joint in report.document["joints"]]) for key in _FRICTION}
    finer = _finer(arm.mass_matrix(q0), rubs["damping"])
    lines = [
        "# A ball passes the elbow of an arm that holds its tip. `vffnull schema` explains every key.",
        "# The file of the arm is named as seen from this one. Then: vffnull run mine.toml --plot figures",
        "",
        f"name = {json.dumps(name)}",
        f"description = {json.dumps(f'a ball passes the elbow of {name} while it holds its tip')}",
        "duration = 6.0                            # s",
        f"q0 = {_row(q0)} # rad (m where a joint slides); bent, within the limits, touching nothing",
        "",
        "[arm]",
        *(f"{key} = {_value(value)}" for key, value in table.items()),
        "",
        "[controller]",
        f"task = {json.dumps(task):34} # leaves {arm.n - len(yields)} of {arm.n} joints free",
        *_gains(bool(rubs["friction"].any())),
        "null_damping = 8.0                        # 1/s",
        f"posture = {_row(q0)} # rad; back to q0 when nothing is near",
        f"posture_stiffness = {_row(pull)} # N·m/rad; 9/s² times the inertia that each joint feels at q0",
        f'field = {{ kind = "bounded", gain = {PUSH * mass:.3g}, influence = {influence:.3g} }} '
        f"# N at contact: {PUSH} N/kg; m: 0.3 of the reach",
        'avoidance = "cbf"                         # the tip gives way where the elbow alone cannot',
        *_compensation(rubs),
        *_singularity(yields, mass),
        "",
        "[reference]",
        'kind = "setpoint"                         # where the tip is at q0',
        "",
        "[[obstacles]]                             # beside the elbow, and past it after 3 s",
        f'shape = {{ kind = "sphere", radius = {radius:.3g} }} # m',
        f"position = {_row(start)} # m",
        f'motion = {{ kind = "linear", velocity = {_row(speed * across)} }} # m/s',
        "",
        "[simulation]",
        *_steps(finer),
        'integrator = "semi_implicit_euler"',
        f"record_every = {10 * finer}",
    ]
    return "\n".join(lines)


_FRICTION = {"damping": "viscous_friction", "friction": "coulomb_friction"}
"""Of a joint in the document of an arm, and what makes up for it."""


_DIVISORS = (1, 2, 4, 5, 8, 10, 16, 20, 25, 40, 50, 80, 100)
"""Into how many steps a control period is divided: without a remainder in decimals."""


def _gains(dry: bool) -> list[str]:
    """Gains of the task; higher ones against dry friction, of which what is not compensated holds the tip."""
    if dry:
        return [
            "stiffness = 1600.0                        # 1/s²; critically damped, 0.025 s, for dry friction",
            "damping = 80.0                            # 1/s",
        ]
    return [
        "stiffness = 400.0                         # 1/s²; critically damped, 0.05 s",
        "damping = 40.0                            # 1/s",
    ]


def _compensation(rubs: Mapping[str, Array]) -> list[str]:
    """What makes up for most of the friction in the joints, which else keeps the tip from its reference."""
    given = [f"{_FRICTION[key]} = {_row(COMPENSATED * each)}" for key, each in rubs.items() if each.any()]
    if not given:
        return []
    units = " and ".join(
        unit for key, unit in (("damping", "N·m·s/rad"), ("friction", "N·m")) if rubs[key].any()
    )
    what = f"# {units}; {COMPENSATED} of the friction in the joints"
    return [f"command = {{ {', '.join(given)} }} {what}"]


def _yielding(arm: Any, q0: Sequence[float], task: str, reach: float) -> Array:
    """How much the tip yields in the directions of the task that joints move, ascending [1/kg].

    Those in which no joint moves it, as out of the plane of a planar chain, are none that the task can have.
    """
    jacobian = np.array(arm.jacobian(q0))[: 6 if task == "pose" else 3]
    jacobian[3:] *= reach / 6.0
    found = np.linalg.eigvalsh(jacobian @ np.linalg.solve(arm.mass_matrix(q0), jacobian.T))
    return np.asarray(found[found > ROUNDING * max(found[-1], 0.0)])


def _singularity(yields: Array, mass: float) -> list[str]:
    """From where on a task is damped, for an arm whose rotors are so heavy that it always would be."""
    least = float(yields[0]) if len(yields) else 0.0
    share = 0.25 * least * mass
    if share <= 0.0 or 2.0 * setting({}, "controller.singularity") < 4.0 * share:
        return []
    return [f"singularity = {f'{share:.2g}':27} # a quarter of the least of the task at q0: heavy rotors"]


def _finer(mass: Array, damping: Array) -> int:
    """How many steps of the simulation a control period needs, so that it can follow the friction."""
    root = np.linalg.inv(np.linalg.cholesky(mass))
    fastest = float(np.linalg.eigvalsh(root * damping @ root.T)[-1])
    least = fastest * STEP / EXPLICIT
    return next((each for each in _DIVISORS if each >= least), _DIVISORS[-1])


def _steps(finer: int) -> list[str]:
    """Step and control period of the simulation."""
    if finer == 1:
        return [
            f"dt = {STEP}                                # s",
            'control = "hold"                          # 1 kHz',
        ]
    return [
        f"dt = {f'{STEP / finer:g}':36} # s; as fine as the friction in the joints needs it",
        f"control_every = {finer:<25} # 1 kHz",
        'control = "hold"',
    ]


def _bent(document: Mapping[str, Any], arm: Any) -> list[float]:
    """The posture in which the tip moves best in all directions, of those in which the arm can stand."""
    for share in INNER:
        found = _best(arm, document, spread(document, TRIED, share))
        if found is not None:
            return found
    raise InputError(
        f"none of {len(INNER) * TRIED} postures within the limits is free of links that touch, and held with "
        "half of the torque limits; `vffnull arms check` says what touches"
    )


def _best(arm: Any, document: Mapping[str, Any], postures: Array) -> list[float] | None:
    """The same of some postures; None if the arm can stand in none of them."""
    touching = _core.overlapping_links(document, [q.tolist() for q in postures])
    # The base stands on something: links are above it, where there are such postures.
    floor = document.get("mount", {}).get("position", (0.0, 0.0, 0.0))[2]
    low = np.asarray(arm.forward_kinematics(postures))[..., 2].min(axis=1) < floor - 1e-9
    held = np.ones(len(postures), bool)
    if arm.torque_limits is not None:
        most = HELD * np.asarray(arm.torque_limits)
        held = np.array([(np.abs(arm.gravity_torque(q)) <= most).all() for q in postures])
    free = held & np.array([not pairs for pairs in touching])
    for fits in (free & ~low, free):
        if fits.any():
            moves = [_mobility(arm, q) if fit else -1.0 for q, fit in zip(postures, fits, strict=True)]
            return [round(float(q), 4) for q in postures[int(np.argmax(moves))]]
    return None


def _mobility(arm: Any, q: Array) -> float:
    J = np.asarray(arm.jacobian(q))[:3]
    return float(np.prod(np.linalg.svd(J, compute_uv=False)[: min(3, arm.n)]))


def _reach(arm: Any) -> float:
    """How far the chain can be stretched at most [m]."""
    origins = np.asarray(arm.forward_kinematics(np.zeros(arm.n)))
    return float(np.linalg.norm(np.diff(origins, axis=0), axis=1).sum())


def _passing(arm: Any, q0: Array, radius: float, speed: float) -> tuple[Array, Array]:
    """Where a ball begins that comes by at an elbow, and the unit vector along which it goes.

    The first way that is clear of what stands, which would be hit whatever the law does.
    """
    origins = np.asarray(arm.forward_kinematics(q0))
    moved = np.asarray(arm.forward_kinematics(q0 + NUDGE * np.eye(arm.n)))
    levers = np.linalg.norm(moved - origins, axis=2) / NUDGE
    gives_way = levers.max(axis=0) > LEVER
    turns = np.array([joint.get("kind") != "prismatic" for joint in arm.to_dict()["joints"]])
    stands = levers[turns, 1:].max(axis=0, initial=0.0) < STANDS * _reach(arm)  # links, by their far ends
    base, tip = origins[0], origins[-1]
    along = tip - base
    along /= max(float(np.linalg.norm(along)), 1e-12)
    off = origins - base - ((origins - base) @ along)[:, None] * along
    best, found = -np.inf, None
    farthest = np.argsort(-np.where(gives_way, np.linalg.norm(off, axis=1), -1.0), kind="stable")
    for far in map(int, farthest[: max(1, int(gives_way.sum()))]):
        away = float(np.linalg.norm(off[far]))
        outward = off[far] / away if away > 1e-6 else np.array([0.0, 0.0, 1.0])
        across = np.cross(along, outward)
        size = float(np.linalg.norm(across))
        across = across / size if size > 1e-6 else np.array([0.0, 1.0, 0.0])
        for way in (across, -across):
            start = origins[far] + radius * outward - 3.0 * speed * way
            ball = Obstacle.sphere(start, radius, Motion.linear(speed * way)).to_dict()
            least = np.inf
            for t in np.linspace(0.0, 6.0, 61):
                pairs = _core.distances(arm, q0, np.zeros(arm.n), [ball], t)
                least = min(least, float(pairs.distance[stands[pairs.link]].min(initial=np.inf)))
            if least > 0.5 * radius:
                return start, way
            if least > best:
                best, found = least, (start, way)
    assert found is not None  # there is a joint
    return found


def _row(numbers: Sequence[float] | Array) -> str:
    return "[" + ", ".join(f"{float(each):.4f}" for each in numbers) + "]"


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {each!r}" for key, each in value.items()) + " }"
    return json.dumps(value, ensure_ascii=False)
