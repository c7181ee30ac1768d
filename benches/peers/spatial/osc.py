"""An operational-space controller as abr_control has it: another law, written here from its formulas.

As in its ``OSC`` with ``Damping``, ``RestingConfig`` and ``AvoidObstacles``: M is inverted, the inertia of
the hand by ``pinv`` where it is singular, gravity is made up for and Coriolis terms are not; every link near
an obstacle is pushed at its nearest point; a filter keeps pushes, damping and rest out of the task. MuJoCo
supplies matrices and distances. Gains, posture and the field are the scene's: in newtons, where abr_control
scales its push with the inertia that is felt there, which makes these arms chatter.
"""

from __future__ import annotations

import mujoco
import numpy as np

from peers.spatial.task import Array, Task
from peers.spatial.way import Controller
from vffnull.engines.export import to_mjcf

SINGULAR = 1e-3
"""Below this determinant the inertia of the hand is singular, as abr_control has it."""


class OperationalSpace(Controller):
    def __init__(self, task: Task) -> None:
        super().__init__(task)
        arm, n = task.arm, task.arm.n
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(arm, obstacles=task.solids))
        self.data = mujoco.MjData(self.model)
        self.tip = self.model.site(arm.to_dict()["tip"]).id
        self.first = self.model.body("obstacle_1").id
        bodies = self.model.geom_bodyid
        moving = [g for g in range(self.model.ngeom) if self.model.body_weldid[bodies[g]]]
        self.links = [g for g in moving if bodies[g] < self.first]
        self.obstacles = [g for g in range(self.model.ngeom) if bodies[g] >= self.first]
        self.control = task.scene.to_dict()["controller"]
        self.field = self.control["field"]
        if self.field["kind"] != "bounded":
            raise ValueError("only a bounded field is written here")
        self.M, self.gravity = np.zeros((n, n)), np.zeros(n)
        self.J, self.J_c = np.zeros((6, n)), np.zeros((3, n))

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        model, data, task, control = self.model, self.data, self.task, self.control
        data.mocap_pos[:] = task.obstacles[k]
        data.qpos[:], data.qvel[:] = q, 0.0
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, self.M)
        mujoco.mj_rne(model, data, 0, self.gravity)
        mujoco.mj_jacSite(model, data, self.J[:3], self.J[3:], self.tip)
        J = self.J[: task.rows]
        M_inv = np.linalg.inv(self.M)
        Mx_inv = J @ M_inv @ J.T
        singular = abs(np.linalg.det(Mx_inv)) < SINGULAR
        Mx = np.linalg.pinv(Mx_inv, rcond=0.1 * SINGULAR) if singular else np.linalg.inv(Mx_inv)
        error = self.error(k)[: task.rows]
        u_task = -control["stiffness"] * error - control["damping"] * (J @ dq - task.twist[k, : task.rows])
        u_null = self.avoid() - control["null_damping"] * (self.M @ dq)
        u_null -= np.asarray(control["posture_stiffness"]) * (q - np.asarray(control["posture"]))
        held: Array = J.T @ (Mx @ (u_task - J @ (M_inv @ u_null))) + u_null + self.gravity
        return held

    def error(self, k: int) -> Array:
        """How far the hand is from its reference (6,), linear [m], then angular [rad], in world axes."""
        place, turned, relative = self.task.place[k], np.zeros(4), np.zeros(4)
        mujoco.mju_mat2Quat(turned, self.data.site_xmat[self.tip])
        away = place[3:] * (1.0, -1.0, -1.0, -1.0)
        mujoco.mju_mulQuat(relative, turned, away)
        angle = np.zeros(3)
        mujoco.mju_quat2Vel(angle, relative, 1.0)
        return np.concatenate([self.data.site_xpos[self.tip] - place[:3], angle])

    def avoid(self) -> Array:
        """The push of all obstacles on all links, link by link."""
        push, fromto, reach = np.zeros(self.task.arm.n), np.empty(6), self.field["influence"]
        for obstacle in self.obstacles:
            for link in self.links:
                d = mujoco.mj_geomDistance(self.model, self.data, link, obstacle, reach, fromto)
                if d >= reach:
                    continue
                away = np.copysign(1.0, d) * (fromto[:3] - fromto[3:])
                length = float(np.linalg.norm(away))
                if length == 0.0:
                    continue
                mujoco.mj_jac(self.model, self.data, self.J_c, None, fromto[:3], self.model.geom_bodyid[link])
                force = self.field["gain"] * (1.0 - d / reach) ** 2
                push += self.J_c.T @ (force / length * away)
        return push
