"""What a run takes for granted, read from its scenario, so that nobody has to guess."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

import vffnull._core as _core
from vffnull.draw.shapes import unseen_of
from vffnull.model.arm import listed, unshaped
from vffnull.model.settings import setting

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vffnull.model.outcome import Outcome

    Array = NDArray[np.float64]

__all__ = ["assumptions"]

_LAWS = {
    "continuous": "the law acts at every instant, also inside a step of the integrator: an ideal controller",
    "hold": "the law acts once per control period, and its torque is held until the next",
    "predictor": "the law acts once per control period on the state expected in the middle of it",
}


_FRICTION = {"viscous_friction": "viscous friction", "coulomb_friction": "dry friction"}
_UNITS = {"viscous_friction": ("N·m·s/rad", "N·s/m"), "coulomb_friction": ("N·m", "N")}
"""Of joints that turn, and that slide."""
_MASS = {
    "masses": "other masses of its links",
    "com": "other centres of mass",
    "inertias": "other moments of inertia",
}
_LINKS = {
    "ignore": "Links do not avoid one another, and clearance is between links and obstacles only.",
    "report": "Links do not avoid one another; their clearance is measured.",
    "avoid": "Links that share no joint avoid one another.",
}

_INTEGRATORS = {"rk4": "Runge–Kutta 4", "semi_implicit_euler": "semi-implicit Euler"}


def assumptions(result: Outcome) -> list[str]:
    """What the run takes for granted, in sentences."""
    document = result.scenario.to_dict()
    dt, control = setting(document, "simulation.dt"), setting(document, "simulation.control")
    integrator = _INTEGRATORS[setting(document, "simulation.integrator")]
    law = _LAWS.get(control, control)
    if result.plant == "core":
        plant = f"The plant is integrated by {integrator} with steps of {dt:g} s; {law}."
        contact = "the arm passes through them without a contact force"
    else:
        plant = f"MuJoCo moves the arm with steps of {dt:g} s; {law}."
        contact = "contacts push the arm, by MuJoCo's soft model"
    rubs = list(_rubs(result, document))
    unknown = [*rubs, *_differs(result, document)]
    drives = "torque sources that lag" if _set(document, "actuator") else "ideal torque sources"
    state = _set(document, "measurement")
    space = result.layout.dimension == 3
    joints = "joints that turn or slide" if result.layout.slides else "revolute joints"
    where = "in space" if space else "in the plane"
    bare = unshaped(document["arm"])
    them = "it" if len(bare) == 1 else "them"
    return [
        f"Rigid links {where}, {joints} {'with' if rubs else 'without'} friction, {drives}.",
        plant,
        f"The plant has what the controller's model has not: {listed(unknown)}."
        if unknown
        else "The controller's model of the arm is exact.",
        *_stops(result, document),
        f"The controller reads angles and speeds with {listed(state)}; see [measurement]."
        if state
        else "The controller reads angles and speeds exactly and at once.",
        _known(result, document),
        *_met(document, contact),
        _LINKS[document.get("controller", {}).get("self_collision", "ignore")],
        *(
            [f"{listed(bare)}: no shape, so nothing avoids {them}, and no contact is noticed."]
            if bare
            else []
        ),
        "Clearance is signed: below zero a link is inside an obstacle. Metrics use every step of the plant.",
        *(["Links are drawn as the bodies that are measured against obstacles."] if space else []),
        *_pushed(document),
        "Arrows show the recorded magnitude of the repulsion on a link, at its point nearest to an obstacle.",
    ]


def _known(result: Outcome, document: Mapping[str, Any]) -> str:
    """What the controller is told of the obstacles."""
    given = document.get("obstacles", [])
    unseen = [f"obstacle {k + 1}" for k in sorted(unseen_of(document)) if "likelihood" not in given[k]]
    if unseen and len(unseen) == sum("likelihood" not in each for each in given):
        return f"Nobody has told the controller of {listed(unseen)}: felt alone."
    others = "all other obstacles" if unseen else "the obstacles"
    every = "all other obstacles" if unseen else "every obstacle"
    if result.sensed is not None:
        known = f"of {others} what its range sensors have met, at rest"
    else:
        known = f"position and velocity of {every}"
    told = f"; nobody has told it of {listed(unseen)}: felt alone" if unseen else ""
    return f"The controller knows {known}{told}."


def _met(document: Mapping[str, Any], contact: str) -> Iterator[str]:
    """What becomes of the arm where it meets obstacles; `contact` is what holds for most."""
    obstacles = document.get("obstacles", [])
    felt = [f"obstacle {k}" for k, each in enumerate(obstacles, start=1) if "contact" in each]
    moves = "Obstacles move as the scenario says and do not feel the arm"
    pressed = "felt by links that press into them, with friction"
    if not felt:
        yield f"{moves}; {contact}."
    elif len(felt) == len(obstacles):
        yield f"{moves}; they are {pressed}."
    else:
        which = listed(felt)
        yield f"{moves}; {contact.replace('them', f'all of them but {which}')}."
        yield f"{which[0].upper()}{which[1:]}: {pressed}."
    for k, each in enumerate(obstacles, start=1):
        if links := each.get("ignore"):
            yield f"{listed(links)} may pass through obstacle {k}: neither avoided nor measured."
        if "likelihood" in each:
            yield (
                f"Obstacle {k} is a possible future with a likelihood of {each['likelihood']:.3g}: "
                "seen by look-ahead alone, and not there."
            )
        if kept := _kept(each):
            yield f"From obstacle {k} another margin is kept: {kept}."


def _kept(obstacle: Mapping[str, Any]) -> str:
    """The margins that an obstacle has of its own."""
    of_all = {"every link": obstacle["margin"]} if "margin" in obstacle else {}
    margins = of_all | obstacle.get("margins", {})
    return ", ".join(f"{1e3 * margin:.3g} mm by {link}" for link, margin in margins.items())


def _pushed(document: Mapping[str, Any]) -> Iterator[str]:
    """What pushes the arm from outside."""
    for each in document.get("wrenches", []):
        force, torque = (float(np.linalg.norm(each.get(key, 0.0))) for key in ("force", "torque"))
        sizes = [f"{size:.3g} {unit}" for size, unit in ((force, "N"), (torque, "N·m")) if size]
        begin = each.get("start", 0.0)
        end = f"{begin + each['duration']:.3g} s" if "duration" in each else "the end"
        yield (
            f"From {begin:.3g} s to {end}, {each['link']} is pushed from outside with "
            f"{' and '.join(sizes) or 'nothing'} ({each.get('profile', {}).get('kind', 'constant')})."
        )


def _rubs(result: Outcome, document: Mapping[str, Any]) -> Iterator[str]:
    """Friction of the joints, the largest of each kind, also where it comes from the arm's own file."""
    for key, words in _FRICTION.items():
        given = _friction(document, key)
        if given.any():
            worst = int(given.argmax())
            turning, sliding = _UNITS[key]
            unit = sliding if worst in result.layout.slides else turning
            opposed = np.max(document.get("controller", {}).get("command", {}).get(key, 0.0))
            told = f" (up to {opposed:.3g} compensated)" if opposed else ""
            yield f"{words} of up to {given[worst]:.3g} {unit}{told}"


def _differs(result: Outcome, document: Mapping[str, Any]) -> Iterator[str]:
    """In what else the plant is not the controller's model."""
    given = document.get("plant") or {}
    payload = given.get("payload", 0.0)
    mass = payload.get("mass", 0.0) if isinstance(payload, Mapping) else payload
    if mass:
        yield f"a payload of {mass:.3g} kg"
    yield from (words for key, words in _MASS.items() if given.get(key) is not None)
    if not np.array_equal(result.scenario.arm.gravity, result.scenario.plant.gravity):
        yield "another gravity"


def _stops(result: Outcome, document: Mapping[str, Any]) -> Iterator[str]:
    """What becomes of a joint at the end of its range."""
    if result.scenario.arm.joint_limits is None:
        yield "Joints have no limits."
    elif not (document.get("plant") or {}).get("joint_stops", True):
        yield "Joints pass their limits as if there were no stops."
    elif result.plant == "core":
        yield "Joints stop at their limits, without bouncing."
    else:
        yield "Joints go a little beyond their limits, from where MuJoCo's soft stops push them back."


def _set(document: Mapping[str, Any], table: str) -> list[str]:
    """The keys of a table that are given something other than nothing, as words."""
    given = document.get(table) or {}
    return [name.replace("_", " ") for name, value in given.items() if np.any(np.asarray(value) != 0)]


def _friction(document: Mapping[str, Any], key: str) -> Array:
    """Friction of the plant's joints, (n,), where it is not given that of the arm.

    Parameters
    ----------
    document : Mapping
        The scenario, which has been checked.
    key : str
        ``"viscous_friction"`` [N·m·s/rad or N·s/m] or ``"coulomb_friction"`` [N·m or N].
    """
    given, arm = (document.get("plant") or {}).get(key), document["arm"]
    if given is None:
        given = _own(arm["model"], key) if "model" in arm else _rubbing(arm.get("joints", ()), key)
    return np.broadcast_to(np.asarray(given or 0.0, dtype=float), len(document["q0"]))


_KEYS = {"viscous_friction": "damping", "coulomb_friction": "friction"}
"""What they are called in the description of an arm."""


def _rubbing(joints: Iterable[Mapping[str, Any]], key: str) -> tuple[float, ...]:
    return tuple(joint.get(_KEYS[key], 0.0) for joint in joints)


@cache
def _own(model: str, key: str) -> tuple[float, ...]:
    """That of a bundled arm."""
    return _rubbing(_core.arm_model(model)["joints"], key)
