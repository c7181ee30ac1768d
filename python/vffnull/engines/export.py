"""The arm for other engines: MJCF for MuJoCo, URDF for Pinocchio and nearly everything else.

An arm in space is written as it is, with its names, shapes, mount and tool; see `vffnull.arms`.

An arm in the plane becomes a chain of revolute joints about z with the links' frames at their joints, x along
the link. Masses, centres of mass and moments of inertia about z are exact; the two other moments of inertia,
which a motion in the plane never feels, are set equal to it, so that the tensor is a possible one.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import Any
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from vffnull import arms
from vffnull._core import Arm
from vffnull.arms._export import contacts_of, text_of
from vffnull.model.obstacle import Obstacle, checked

__all__ = ["to_mjcf", "to_urdf"]

_BOUNDLESS = float(np.finfo(float).max)  # readers of URDF take no infinity
_THIN = 0.01  # m; what a link without thickness looks like
_TOUCH = 1e-6  # m; what a body without thickness has for contacts, since MuJoCo wants some


def to_mjcf(
    arm: Arm, name: str | None = None, obstacles: Iterable[Obstacle | Mapping[str, Any]] | None = None
) -> str:
    """Describe an arm for MuJoCo.

    Parameters
    ----------
    arm : Arm
        The arm.
    name : str, optional
        Name of the model; the arm's own, or ``arm``, by default.
    obstacles : iterable of Obstacle or Mapping, optional
        Obstacles, also as in a scenario document. Each becomes a mocap body ``obstacle_1`` … with a geom of
        that name at its position, to be moved by hand; its motion is not a part of the model. Nothing touches
        a possible future.

    Returns
    -------
    str
        MJCF text. An arm in space keeps its names; see `vffnull.arms.to_mjcf`. One in the plane has
        bodies ``link_1`` … ``link_n``, joints ``joint_1`` … ``joint_n`` with a torque motor each,
        and a site ``tip``. Capsules of the links' radius collide if it is not zero. If obstacles are given,
        be there none, links touch them, without friction, and nothing else; a link of the plane without
        thickness then is a micron thick. Step and integrator are MuJoCo's defaults.

    Raises
    ------
    vffnull.errors.ScenarioError
        If an obstacle is none where the arm is, in the plane or in space.
    vffnull.errors.InputError
        If a name has control characters, which XML has no place for.
    """
    document = arm.to_dict()
    if arm.dimension == 3:
        return arms.to_mjcf(_called(document, name), obstacles)
    solids = None if obstacles is None else checked(obstacles, 2)
    root = Element("mujoco", model=name or "arm")
    SubElement(root, "compiler", angle="radian", autolimits="true")
    SubElement(root, "option", gravity=_numbers(*arm.gravity, 0.0))
    assets = SubElement(root, "asset")
    parent = world = SubElement(root, "worldbody")
    ranges = _joint_limits(document, arm.n)
    offset = 0.0
    for i in range(arm.n):
        body = SubElement(parent, "body", name=f"link_{i + 1}", pos=_numbers(offset, 0.0, 0.0))
        joint = SubElement(body, "joint", name=f"joint_{i + 1}", type="hinge", axis="0 0 1")
        if ranges is not None:
            joint.set("range", _numbers(*ranges[i]))
        inertia = arm.inertias[i]
        SubElement(
            body,
            "inertial",
            pos=_numbers(*arm.com[i], 0.0),
            mass=_numbers(arm.masses[i]),
            diaginertia=_numbers(inertia, inertia, inertia),
        )
        radius = arm.radius[i]
        geom = SubElement(
            body,
            "geom",
            name=f"link_{i + 1}",
            type="capsule",
            fromto=_numbers(0.0, 0.0, 0.0, arm.lengths[i], 0.0, 0.0),
            size=_numbers(radius or (_THIN if solids is None else _TOUCH)),
        )
        if solids is not None:
            geom.attrib |= {"contype": "1", "conaffinity": "0", "condim": "1"}
        elif not radius:
            geom.set("contype", "0")
            geom.set("conaffinity", "0")
        parent, offset = body, arm.lengths[i]
    SubElement(parent, "site", name="tip", pos=_numbers(offset, 0.0, 0.0))
    for k, obstacle in enumerate(solids or (), start=1):
        _add_obstacle(world, assets, f"obstacle_{k}", obstacle, tall=float(arm.lengths.sum()))
    motors = SubElement(root, "actuator")
    limits = _largest(document, "torque_limits", arm.n)
    for i in range(arm.n):
        motor = SubElement(motors, "motor", name=f"joint_{i + 1}", joint=f"joint_{i + 1}")
        if limits is not None:
            motor.set("ctrlrange", _numbers(-limits[i], limits[i]))
    return text_of(root)


def to_urdf(arm: Arm, name: str | None = None) -> str:
    """Describe an arm as URDF.

    URDF knows no gravity: set it where the model is used, e.g. in Pinocchio by
    ``model.gravity.linear[:2] = arm.gravity`` with the third component 0.

    Parameters
    ----------
    arm : Arm
        The arm.
    name : str, optional
        Name of the robot; the arm's own, or ``arm``, by default.

    Returns
    -------
    str
        URDF text. An arm in space keeps its names; see `vffnull.arms.to_urdf`. One in the plane has
        links ``base``, ``link_1`` … ``link_n``, ``tip``; joints ``joint_1`` … ``joint_n``.
    """
    document = arm.to_dict()
    if arm.dimension == 3:
        return arms.to_urdf(_called(document, name))
    ranges = _joint_limits(document, arm.n)
    limits = _largest(document, "torque_limits", arm.n)
    speeds = _largest(document, "velocity_limits", arm.n)
    root = Element("robot", name=name or "arm")
    SubElement(root, "link", name="base")
    for i in range(arm.n):
        link = SubElement(root, "link", name=f"link_{i + 1}")
        inertial = SubElement(link, "inertial")
        SubElement(inertial, "origin", xyz=_numbers(*arm.com[i], 0.0))
        SubElement(inertial, "mass", value=_numbers(arm.masses[i]))
        moment = _numbers(arm.inertias[i])
        SubElement(inertial, "inertia", ixx=moment, iyy=moment, izz=moment, ixy="0", ixz="0", iyz="0")
        for part in ("visual", "collision") if arm.radius[i] else ("visual",):
            shape = SubElement(link, part)
            SubElement(shape, "origin", xyz=_numbers(arm.lengths[i] / 2, 0.0, 0.0), rpy=f"0 {np.pi / 2!r} 0")
            geometry = SubElement(shape, "geometry")
            SubElement(
                geometry,
                "cylinder",
                radius=_numbers(arm.radius[i] or _THIN),
                length=_numbers(arm.lengths[i]),
            )
    SubElement(root, "link", name="tip")
    links = ["base", *(f"link_{i + 1}" for i in range(arm.n)), "tip"]
    offsets = [0.0, *arm.lengths]
    for i, (parent, child) in enumerate(pairwise(links)):
        last = child == "tip"
        kind = "fixed" if last else "continuous" if ranges is None else "revolute"
        joint = SubElement(root, "joint", name="tip" if last else f"joint_{i + 1}", type=kind)
        SubElement(joint, "parent", link=parent)
        SubElement(joint, "child", link=child)
        SubElement(joint, "origin", xyz=_numbers(offsets[i], 0.0, 0.0))
        if last:
            continue
        SubElement(joint, "axis", xyz="0 0 1")
        if ranges is not None or limits is not None or speeds is not None:
            effort = _BOUNDLESS if limits is None else limits[i]
            speed = _BOUNDLESS if speeds is None else speeds[i]
            limit = SubElement(joint, "limit", effort=_numbers(effort), velocity=_numbers(speed))
            if ranges is not None:
                limit.attrib |= {"lower": _numbers(ranges[i][0]), "upper": _numbers(ranges[i][1])}
    return text_of(root)


def _called(document: dict[str, Any], name: str | None) -> dict[str, Any]:
    return document if name is None else document | {"name": name}


def _add_obstacle(
    world: Element, assets: Element, name: str, obstacle: Mapping[str, Any], tall: float
) -> None:
    """Add an obstacle; one with corners reaches `tall` out of the plane, so that contacts push within it."""
    half_angle = obstacle.get("angle", 0.0) / 2
    body = SubElement(
        world,
        "body",
        name=name,
        mocap="true",
        pos=_numbers(*obstacle.get("position", (0.0, 0.0)), 0.0),
        quat=_numbers(np.cos(half_angle), 0.0, 0.0, np.sin(half_angle)),
    )
    geom = SubElement(body, "geom", {"name": name, **contacts_of(obstacle)})
    shape = obstacle["shape"]
    match shape["kind"]:
        case "circle":  # the plane is its equator
            geom.attrib |= {"type": "sphere", "size": _numbers(shape["radius"])}
        case "capsule":
            ends = _numbers(*shape["a"], 0.0, *shape["b"], 0.0)
            radius = max(shape["radius"], _TOUCH)
            geom.attrib |= {"type": "capsule", "fromto": ends, "size": _numbers(radius)}
        case kind:  # a prism; MuJoCo's own box lets the axis of a thin capsule through
            if kind == "box":
                corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2 * shape["size"]
            else:
                corners = np.asarray(shape["vertices"], dtype=float)
            tall = max(tall, float(np.ptp(corners, axis=0).max()))
            prism = [(x, y, z) for z in (-tall, tall) for x, y in corners]
            SubElement(assets, "mesh", name=name, vertex=_numbers(*np.ravel(prism)))
            geom.attrib |= {"type": "mesh", "mesh": name}


def _joint_limits(document: dict[str, object], n: int) -> list[list[float]] | None:
    given = document.get("joint_limits")
    return None if given is None else np.broadcast_to(np.asarray(given, dtype=float), (n, 2)).tolist()


def _largest(document: dict[str, object], limits: str, n: int) -> list[float] | None:
    given = document.get(limits)
    return None if given is None else np.broadcast_to(np.asarray(given, dtype=float), (n,)).tolist()


def _numbers(*values: float) -> str:
    """Numbers with every digit, so that another engine simulates the same arm."""
    return " ".join(repr(float(value)) for value in values)
