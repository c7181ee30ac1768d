"""Kinematics, mass matrix and gravity of the explicit description of a spatial arm, in dense NumPy.

From the Jacobians of the centres of mass; nothing is shared with the readers or the core.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[Any]


def homogeneous(position: Array, rotation: Array) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, position
    return out


def placed(frame: Mapping[str, Any]) -> Array:
    w, x, y, z = frame["orientation"]
    return homogeneous(np.array(frame["position"]), Rotation.from_quat([x, y, z, w]).as_matrix())


def poses(arm: Mapping[str, Any], q: Array) -> list[Array]:
    """Of the base, of every link and of the tip in the world, (4, 4) each."""
    out = [placed(arm["mount"])]
    for joint, value in zip(arm["joints"], q, strict=True):
        axis = np.array(joint["axis"])
        if joint["kind"] == "prismatic":
            motion = homogeneous(axis * value, np.eye(3))
        else:
            motion = homogeneous(np.zeros(3), Rotation.from_rotvec(axis * value).as_matrix())
        out.append(out[-1] @ placed(joint) @ motion)
    return [*out, out[-1] @ placed(arm["tool"])]


def mass_and_gravity(arm: Mapping[str, Any], q: Array) -> tuple[Array, Array]:
    """M(q) with the armature and g(q)."""
    n = len(q)
    links = poses(arm, q)[1:-1]
    axes = [pose[:3, :3] @ joint["axis"] for pose, joint in zip(links, arm["joints"], strict=True)]
    M, g = np.diag([joint["armature"] for joint in arm["joints"]]), np.zeros(n)
    for i, (pose, joint) in enumerate(zip(links, arm["joints"], strict=True)):
        com = pose[:3, 3] + pose[:3, :3] @ joint["com"]
        linear, angular = np.zeros((3, n)), np.zeros((3, n))
        for k in range(i + 1):
            if arm["joints"][k]["kind"] == "prismatic":
                linear[:, k] = axes[k]
            else:
                linear[:, k] = np.cross(axes[k], com - links[k][:3, 3])
                angular[:, k] = axes[k]
        xx, yy, zz, xy, xz, yz = joint["inertia"]
        tensor = pose[:3, :3] @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ pose[:3, :3].T
        M = M + joint["mass"] * linear.T @ linear + angular.T @ tensor @ angular
        g = g - joint["mass"] * linear.T @ np.array(arm["gravity"])
    return M, g
