"""The explicit description of an arm to URDF and MJCF."""

from __future__ import annotations

import math
import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

import vffnull._core as _core
from vffnull._support.errors import InputError, ScenarioError, ScenarioWarning
from vffnull.arms._frames import roll_pitch_yaw
from vffnull.model.obstacle import Obstacle, checked
from vffnull.model.shape import core_in_space

__all__ = ["text_of", "to_mjcf", "to_urdf"]

_IDENTITY = {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
_NO_TEXT = re.compile("[^\t\n\r -\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_FAR = 1e9  # rad or m; where a joint ends that has an end on its other side alone
_MAX_POINTS = 1000
_TOUCH = 1e-6  # m; what a body without thickness has for contacts, since MuJoCo wants some

# Links touch obstacles, without friction, and nothing else.
_TOUCHING = {"contype": "1", "conaffinity": "0", "condim": "1"}
_TOUCHED = {"contype": "0", "conaffinity": "1", "condim": "1"}
_UNTOUCHED = {"contype": "0", "conaffinity": "0"}


def to_urdf(arm: Mapping[str, Any]) -> str:
    """The arm as URDF.

    Read back from its base to its tip it is the same arm, to rounding. URDF has no place for gravity and
    armature; a mount becomes a fixed joint below a link ``world``, and capsules cylinders with balls
    at their ends.

    Parameters
    ----------
    arm : dict
        The explicit description.

    Returns
    -------
    str
        XML.

    Warns
    -----
    vffnull.errors.ScenarioWarning
        If something is lost: armature, hulls.
    """
    arm = _core.check_arm(arm)
    robot = ET.Element("robot", name=arm.get("name", "arm"))
    base, joints = arm["base"], arm["joints"]
    if arm["mount"] != _IDENTITY:
        ET.SubElement(robot, "link", name=_free("world", arm))
    lost = []
    if any(joint["armature"] for joint in joints):
        lost.append("armature")
    if any(item["shape"]["kind"] == "convex" for item in arm.get("collision", [])):
        lost.append("convex hulls")
    if lost:
        warnings.warn(f"URDF cannot hold {' and '.join(lost)}: left out", ScenarioWarning, stacklevel=2)
    _urdf_link(robot, base, None, arm)
    for joint in joints:
        _urdf_link(robot, joint["link"], joint, arm)
    if arm["tip"] != joints[-1]["link"]:
        ET.SubElement(robot, "link", name=arm["tip"])
        _urdf_fixed(robot, f"{arm['tip']}_fixed", joints[-1]["link"], arm["tip"], arm["tool"])
    if arm["mount"] != _IDENTITY:
        _urdf_fixed(robot, "mount", _free("world", arm), base, arm["mount"])
    n = len(joints)
    limits = arm.get("joint_limits") or [[-math.inf, math.inf]] * n
    velocity, torque = (
        arm.get("velocity_limits") or [math.inf] * n,
        arm.get("torque_limits") or [math.inf] * n,
    )
    parent = base
    for i, joint in enumerate(joints):
        lower, upper = limits[i]
        bounded = math.isfinite(lower) or math.isfinite(upper)
        # A limited joint without end exists in the document only.
        kind = joint["kind"] if joint["kind"] == "prismatic" else ("revolute" if bounded else "continuous")
        element = ET.SubElement(robot, "joint", name=joint["name"], type=kind)
        ET.SubElement(element, "parent", link=parent)
        ET.SubElement(element, "child", link=joint["link"])
        _origin(element, joint["position"], joint["orientation"])
        ET.SubElement(element, "axis", xyz=_text(joint["axis"]))
        limit = {key: _text([value]) for key, value in (("velocity", velocity[i]), ("effort", torque[i]))}
        limit = {key: "0" if text == "inf" else text for key, text in limit.items()}
        if kind != "continuous":
            limit |= {"lower": _text([max(lower, -_FAR)]), "upper": _text([min(upper, _FAR)])}
        ET.SubElement(element, "limit", limit)
        ET.SubElement(
            element, "dynamics", damping=_text([joint["damping"]]), friction=_text([joint["friction"]])
        )
        parent = joint["link"]
    return text_of(robot)


def _urdf_link(robot: ET.Element, name: str, joint: Mapping[str, Any] | None, arm: Mapping[str, Any]) -> None:
    link = ET.SubElement(robot, "link", name=name)
    if joint is not None:
        inertial = ET.SubElement(link, "inertial")
        ET.SubElement(inertial, "origin", xyz=_text(joint["com"]))
        ET.SubElement(inertial, "mass", value=_text([joint["mass"]]))
        keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
        tensor = {key: _text([value]) for key, value in zip(keys, joint["inertia"], strict=True)}
        ET.SubElement(inertial, "inertia", tensor)
    for shape in _shapes(arm, name):
        for position, orientation, tag, attributes in _urdf_forms(shape):
            collision = ET.SubElement(link, "collision")
            _origin(collision, position, orientation)
            ET.SubElement(ET.SubElement(collision, "geometry"), tag, attributes)


_Form = tuple[Sequence[float], Sequence[float], str, dict[str, str]]


def _urdf_forms(shape: Mapping[str, Any]) -> Iterable[_Form]:
    upright = (1.0, 0.0, 0.0, 0.0)
    kind = shape["kind"]
    if kind == "box":
        yield shape["center"], shape["orientation"], "box", {"size": _text(shape["size"])}
    elif kind == "sphere":
        yield shape["center"], upright, "sphere", {"radius": _text([shape["radius"]])}
    elif kind == "capsule":
        a, b, radius = np.array(shape["a"]), np.array(shape["b"]), _text([shape["radius"]])
        length = float(np.linalg.norm(b - a))
        for end in (a, b):
            yield end.tolist(), upright, "sphere", {"radius": radius}
        if length > 0:
            place = ((a + b) / 2).tolist()
            yield place, _from_z((b - a) / length), "cylinder", {"radius": radius, "length": _text([length])}


def _from_z(direction: Any) -> list[float]:
    """The quaternion of the shortest turn that takes z to a direction."""
    x, y, z = (float(each) for each in direction)
    if z < -1 + 1e-12:
        return [0.0, 1.0, 0.0, 0.0]
    w = math.sqrt((1 + z) / 2)
    return [w, -y / (2 * w), x / (2 * w), 0.0]


def _urdf_fixed(robot: ET.Element, name: str, parent: str, child: str, place: Mapping[str, Any]) -> None:
    joint = ET.SubElement(robot, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    _origin(joint, place["position"], place["orientation"])


def _origin(parent: ET.Element, position: Sequence[float], orientation: Sequence[float]) -> None:
    ET.SubElement(parent, "origin", xyz=_text(position), rpy=_text(roll_pitch_yaw(orientation)))


def to_mjcf(arm: Mapping[str, Any], obstacles: Iterable[Obstacle | Mapping[str, Any]] | None = None) -> str:
    """The arm as MJCF, with a motor for each joint.

    Read back from its base to its tip it is the same arm, to rounding; MJCF has no place for limits of
    speed.

    Parameters
    ----------
    arm : dict
        The explicit description.
    obstacles : iterable of Obstacle or Mapping, optional
        Each becomes a mocap body ``obstacle_1`` … with a geom of that name at its position, to be moved by
        hand; its motion is not a part of the model. A cloud of points has a geom for each of them, ``_2`` …
        after the first. If they are given, be there none, the links touch
        obstacles, without friction, and nothing else. Otherwise links touch one another as well. Nothing
        touches a possible future.

    Returns
    -------
    str
        XML that MuJoCo compiles; the tip is a site.

    Raises
    ------
    vffnull.errors.InputError
        If the description is of no arm.
    vffnull.errors.ScenarioError
        If an obstacle is not one of space, or a cloud of more than 1000 points, which MuJoCo is too slow for.
    """
    arm = _core.check_arm(arm)
    solids = None if obstacles is None else checked(obstacles, 3)
    _check_clouds(solids or ())
    touch = None if solids is None else _TOUCHING
    root = ET.Element("mujoco", model=arm.get("name", "arm"))
    # Inertias and places are as they stand here: nothing is to be inferred from geoms.
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", inertiafromgeom="false")
    ET.SubElement(root, "option", gravity=_text(arm["gravity"]))
    asset = ET.SubElement(root, "asset")
    world = ET.SubElement(root, "worldbody")
    # What stands still may be called as MuJoCo's world is, of which there is one.
    base = arm["base"] if arm["base"] != "world" else _free("base", arm)
    body = ET.SubElement(world, "body", name=base)
    body.attrib.update(_place(arm["mount"]))
    _mjcf_geoms(body, asset, arm, arm["base"], None if solids is None else _UNTOUCHED)
    n = len(arm["joints"])
    limits = arm.get("joint_limits") or [[-math.inf, math.inf]] * n
    for joint, (lower, upper) in zip(arm["joints"], limits, strict=True):
        place = {"position": joint["position"], "orientation": joint["orientation"]}
        body = ET.SubElement(body, "body", {"name": joint["link"], **_place(place)})
        inertial = {"pos": _text(joint["com"]), "mass": _text([joint["mass"]])}
        ET.SubElement(body, "inertial", inertial, fullinertia=_text(joint["inertia"]))
        kind = "slide" if joint["kind"] == "prismatic" else "hinge"
        element = ET.SubElement(body, "joint", name=joint["name"], type=kind, axis=_text(joint["axis"]))
        for key, value in (("armature", "armature"), ("damping", "damping"), ("frictionloss", "friction")):
            element.set(key, _text([joint[value]]))
        if math.isfinite(lower) or math.isfinite(upper):
            element.set("range", _text([max(lower, -_FAR), min(upper, _FAR)]))
        _mjcf_geoms(body, asset, arm, joint["link"], touch)
    ET.SubElement(body, "site", {"name": arm["tip"], **_place(arm["tool"])})
    pairs = list(arm.get("ignore", []))
    # MuJoCo lets neighbours be, but not the first link and a base that stands: that is a part of the world.
    first = [arm["base"], arm["joints"][0]["link"]]
    if solids is None and all(_shapes(arm, link) for link in first) and set(first) not in map(set, pairs):
        pairs.append(first)
    if pairs:
        contact = ET.SubElement(root, "contact")
        for pair in pairs:
            one, other = (base if link == arm["base"] else link for link in pair)
            ET.SubElement(contact, "exclude", body1=one, body2=other)
    actuator = ET.SubElement(root, "actuator")
    torque = arm.get("torque_limits") or [math.inf] * n
    for joint, limit in zip(arm["joints"], torque, strict=True):
        motor = ET.SubElement(actuator, "motor", name=f"{joint['name']}_motor", joint=joint["name"])
        if math.isfinite(limit):
            motor.set("forcerange", _text([-limit, limit]))
    for k, solid in enumerate(solids or (), start=1):
        _mjcf_obstacle(world, asset, f"obstacle_{k}", solid)
    return text_of(root)


def _mjcf_geoms(
    body: ET.Element,
    asset: ET.Element,
    arm: Mapping[str, Any],
    link: str,
    touch: Mapping[str, str] | None,
) -> None:
    for shape in _shapes(arm, link):
        if shape["kind"] == "convex":
            name = f"hull_{len(asset)}"
            ET.SubElement(asset, "mesh", name=name, vertex=_text(np.ravel(shape["vertices"])))
            form = {"type": "mesh", "mesh": name}
        else:
            form = _mjcf_form(shape)
        ET.SubElement(body, "geom", form | dict(touch or {}))


def _mjcf_form(shape: Mapping[str, Any]) -> dict[str, str]:
    """The attributes of a geom; the shape of an obstacle has no place of its own."""
    kind = shape["kind"]
    radius = max(shape.get("radius", 0.0), _TOUCH)
    if kind == "capsule" and shape["a"] != shape["b"]:
        return {"type": "capsule", "fromto": _text([*shape["a"], *shape["b"]]), "size": _text([radius])}
    if kind in ("sphere", "capsule"):
        center = shape.get("center", shape.get("a", _IDENTITY["position"]))
        return {"type": "sphere", "pos": _text(center), "size": _text([radius])}
    if kind == "half_space":  # 0 is without an end; the third is the distance of lines that are drawn
        return {"type": "plane", "size": "0 0 1", "quat": _text(_from_z(shape["normal"]))}
    place = _place({"position": shape["center"], "orientation": shape["orientation"]})
    return {"type": "box", "size": _text([x / 2 for x in shape["size"]]), **place}


def _mjcf_obstacle(world: ET.Element, asset: ET.Element, name: str, obstacle: Mapping[str, Any]) -> None:
    place = {key: obstacle.get(key, _IDENTITY[key]) for key in _IDENTITY}
    body = ET.SubElement(world, "body", {"name": name, "mocap": "true", **_place(place)})
    shape = obstacle["shape"]
    touch = contacts_of(obstacle)
    if shape["kind"] == "points":
        for i, point in enumerate(shape["points"], start=1):
            ball = _mjcf_form({"kind": "sphere", "center": point, "radius": shape["radius"]})
            ET.SubElement(body, "geom", {"name": name if i == 1 else f"{name}_{i}", **ball, **touch})
        return
    if shape["kind"] in ("sphere", "capsule", "half_space"):
        form = _mjcf_form(shape)
    else:  # boxes, too: MuJoCo's own lets the axis of a thin capsule through
        corners, _ = core_in_space(shape)
        ET.SubElement(asset, "mesh", name=name, vertex=_text(corners.ravel()))
        form = {"type": "mesh", "mesh": name}
    ET.SubElement(body, "geom", {"name": name, **form, **touch})


def contacts_of(obstacle: Mapping[str, Any]) -> dict[str, str]:
    """What of MuJoCo touches an obstacle: links, without friction; of what may only come true nothing, and it
    is paler.
    """
    return _UNTOUCHED | {"rgba": "0.5 0.5 0.5 0.3"} if "likelihood" in obstacle else _TOUCHED


def _check_clouds(obstacles: Iterable[Mapping[str, Any]]) -> None:
    for i, obstacle in enumerate(obstacles):
        count = len(obstacle["shape"].get("points", ()))
        if count > _MAX_POINTS:
            path = f"obstacles[{i}].shape.points"
            raise ScenarioError(
                f"{path}: {count} points are too many for MuJoCo, which takes each for a geom; leave all but"
                f" {_MAX_POINTS} out",
                path,
            )


def _place(frame: Mapping[str, Any]) -> dict[str, str]:
    return {"pos": _text(frame["position"]), "quat": _text(frame["orientation"])}


def _shapes(arm: Mapping[str, Any], link: str) -> list[Mapping[str, Any]]:
    return [item["shape"] for item in arm.get("collision", []) if item["link"] == link]


def _free(name: str, arm: Mapping[str, Any]) -> str:
    """A name that no link has."""
    taken = {arm["base"], arm["tip"], *(joint["link"] for joint in arm["joints"])}
    while name in taken:
        name += "_"
    return name


def _text(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


def text_of(root: ET.Element) -> str:
    """A document as text.

    Raises
    ------
    vffnull.errors.InputError
        If a name has characters that XML has no place for.
    """
    for element in root.iter():
        for key, value in element.items():
            if _NO_TEXT.search(value):
                raise InputError(f"{element.tag} {key} {value!r}: XML has no place for control characters")
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"
