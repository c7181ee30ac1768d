"""What every controller is told of a scene in space: arm, reference, obstacles and their velocities."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

import vffnull as vff
from vffnull.evaluation.geometry.arm import frame, quaternion, rotation
from vffnull.evaluation.geometry.motion import Motion
from vffnull.evaluation.planner import reference_poses

Array = NDArray[np.float64]
_SHORTLY = 1e-6  # s: motions are smooth after every instant, so that this gives their velocity to 1e-9 m/s


class Task:
    """A scene with all its instants worked out; T steps, k obstacles.

    Attributes
    ----------
    place : (T + 1, 7) ndarray
        Reference of the hand: position [m] and unit quaternion.
    twist, rise : (T + 1, 6) ndarray
        Its velocity and acceleration, linear, then angular, in world axes.
    obstacles, speeds : (T + 1, k, 3) ndarray
        Positions [m] and velocities [m/s].
    """

    def __init__(self, scene: vff.Scenario) -> None:
        self.scene, self.arm, self.kind = scene, scene.arm, scene["controller.task"]
        self.rows = 3 if self.kind == "position" else 6
        self.q0 = np.array(scene["q0"], dtype=float)
        self.dt = scene["simulation.dt"]
        self.steps = round(scene.duration / self.dt)
        self.times = self.dt * np.arange(self.steps + 1)
        self.solids = list(scene["obstacles"])
        motions = [Motion(solid, 3) for solid in self.solids]
        self.obstacles = np.stack([motion(self.times) for motion in motions], axis=1)
        later = np.stack([motion(self.times + _SHORTLY) for motion in motions], axis=1)
        self.speeds = (later - self.obstacles) / _SHORTLY
        self._follow(scene["reference"])

    def _follow(self, reference: dict[str, object]) -> None:
        position, orientation = self.arm.pose(self.q0)
        start = frame({"position": position, "orientation": orientation})
        self.poses = reference_poses(reference, start, self.times)
        turns = quaternion(self.poses[:, :3, :3])
        self.place = np.concatenate([self.poses[:, :3, 3], turns], axis=1)
        self.twist, self.rise = np.zeros((2, len(self.times), 6))
        if reference["kind"] == "setpoint":
            return
        duration = float(reference["duration"])
        begin, end = reference_poses(reference, start, np.array([0.0, duration]))
        w, *axis = quaternion(end[:3, :3] @ begin[:3, :3].T)
        half = np.arctan2(np.linalg.norm(axis), w)
        way = np.concatenate([end[:3, 3] - begin[:3, 3], 2.0 * half * np.array(axis) / (np.sin(half) or 1.0)])
        s = np.clip(self.times / duration, 0.0, 1.0)
        self.twist = (30.0 * s**2 * (1.0 - s) ** 2 / duration)[:, None] * way
        self.rise = (60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration**2)[:, None] * way

    def astray(self, poses: Array) -> tuple[Array, Array | None]:
        """How far the hand at poses (T + 1, 4, 4) is from its reference [m], and how far it is turned [rad].

        The latter is twice the vector part of the quaternion between them, as in a result's error.
        """
        far = np.linalg.norm(poses[:, :3, 3] - self.poses[: len(poses), :3, 3], axis=1)
        if self.kind == "position":
            return far, None
        turned = quaternion(np.einsum("kij,klj->kil", poses[:, :3, :3], self.poses[: len(poses), :3, :3]))
        return far, 2.0 * np.linalg.norm(turned[:, 1:], axis=1)


def orientations(task: Task) -> Array:
    """Rotation matrices of the obstacles (k, 3, 3); none of them turns."""
    identity = (1.0, 0.0, 0.0, 0.0)
    return np.array([rotation(solid.get("orientation", identity)) for solid in task.solids])
