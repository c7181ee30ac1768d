"""The arm for other engines: MJCF for MuJoCo, URDF for Pinocchio and nearly everything else.

An arm in space is written as it is, with its names, shapes, mount and tool; see `vffnull.arms`.

An arm in the plane becomes a chain of revolute joints about z with the links' frames at their joints, x along
the link. Masses, centres of mass and moments of inertia about z are exact; the two other moments of inertia,
which a motion in the plane never feels, are set equal to it, so that the tensor is a possible one.
"""

from __future__ import annotations

from vffnull.engines.export import to_mjcf, to_urdf

__all__ = ["to_mjcf", "to_urdf"]
