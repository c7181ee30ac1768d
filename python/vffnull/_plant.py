"""The physical arm of a scenario, where it differs from what the controller believes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from vffnull import _core
from vffnull._arm import arm_of, is_spatial
from vffnull._document import Document

__all__ = ["oddities", "physical"]

_FASTEST = 2.0  # Euler's limit for a decay rate times the step; that of Runge and Kutta is 2.8


def physical(document: Document) -> _core.Arm:
    """The arm of a scenario with what its ``[plant]`` changes: masses, gravity, payload, friction.

    Parameters
    ----------
    document : dict
        The scenario, which has been checked.
    """
    if not is_spatial(document["arm"]):
        return _core.plant(document)
    plant = document.get("plant", {})
    arm = arm_of(document["arm"]).to_dict()
    joints = arm["joints"]
    for joint, mass in zip(joints, plant.get("masses", []), strict=False):
        joint["inertia"] = [moment * mass / joint["mass"] for moment in joint["inertia"]]
        joint["mass"] = mass
    for key, given in (("damping", "viscous_friction"), ("friction", "coulomb_friction")):
        if given in plant:
            value = plant[given]
            each = value if isinstance(value, list) else [value] * len(joints)
            for joint, one in zip(joints, each, strict=True):
                joint[key] = one
    arm["gravity"] = plant.get("gravity", arm["gravity"])
    if plant.get("payload", {}).get("mass", 0.0) > 0.0:
        joints[-1] |= _loaded(joints[-1], arm["tool"], plant["payload"])
    loaded: _core.Arm = arm_of(arm)
    return loaded


def _loaded(joint: Mapping[str, Any], tool: Mapping[str, Any], payload: Mapping[str, Any]) -> Document:
    """Mass, centre of mass and inertia of a link with what the tool on it carries, joined by the core."""
    body = {"com": [0.0] * 3, "inertia": [0.0] * 6} | dict(payload)
    own = {key: joint[key] for key in ("mass", "com", "inertia")}
    tree = {
        "name": "",
        "links": [{"name": "base"}, {"name": "link", **own}, {"name": "payload", **body}],
        "joints": [
            {"name": "joint", "kind": "continuous", "parent": "base", "child": "link", "axis": joint["axis"]},
            {"name": "grasp", "kind": "fixed", "parent": "link", "child": "payload", "frame": tool},
        ],
        "warnings": [],
    }
    (joined,) = _core.reduce_tree(tree, {"base": "base", "tip": "payload"})["arm"]["joints"]
    return {key: joined[key] for key in own}


def oddities(document: Document) -> list[str]:
    """What is allowed but probably not meant: viscous friction too stiff for the step of the simulation.

    Friction is integrated explicitly. Files of small arms often have a damping that stops a light wrist
    within microseconds; a step of a millisecond then makes it swing, or diverge.

    Parameters
    ----------
    document : dict
        The scenario, which has been checked.

    Returns
    -------
    list of str
        A sentence, or nothing.
    """
    import numpy as np

    friction = np.broadcast_to(np.asarray(_viscous(document), dtype=float), len(document["q0"]))
    if not friction.any():
        return []
    arm = physical(document)
    # Symmetric, with the eigenvalues of M⁻¹B: how fast friction alone stops the arm.
    root = np.sqrt(friction)
    rates, modes = np.linalg.eigh(root[:, None] * np.linalg.inv(arm.mass_matrix(document["q0"])) * root)
    numerics = document.get("simulation", {})
    step, rate = numerics.get("dt", 1e-3), float(rates[-1])
    if rate * step <= _FASTEST:
        return []
    joint = arm.joint_names[int(np.abs(modes[:, -1]).argmax())]
    finer = math.ceil(rate * step / _FASTEST)
    every = finer * numerics.get("control_every", 1)
    sampled = "" if numerics.get("control") == "continuous" else f" and simulation.control_every = {every}"
    return [
        f"plant: viscous friction stops `{joint}` at a rate of {rate:.3g} 1/s, too fast for a step of "
        f"{step:g} s: it swings or diverges. simulation.dt = {step / finer:.6g}{sampled} can follow it; "
        "plant.viscous_friction = 0 takes it away"
    ]


def _viscous(document: Document) -> Any:
    """Viscous friction of the joints, one number for all or one for each [N·m·s/rad or N·s/m]."""
    given, arm = document.get("plant", {}).get("viscous_friction"), document["arm"]
    if given is not None or not is_spatial(arm):
        return given or 0.0
    joints = arm["joints"] if "joints" in arm else _core.arm_model(arm["model"])["joints"]
    return [joint.get("damping", 0.0) for joint in joints]
