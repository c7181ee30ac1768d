"""The physical arm of a scenario, where it differs from what the controller believes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vffnull import _core
from vffnull._arm import arm_of, is_spatial
from vffnull._document import Document

__all__ = ["physical"]


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
