"""An operational-space controller as abr_control has it: another law, written here from its formulas.

abr_control is not on PyPI. As in its ``OSC`` with ``Damping`` and ``AvoidObstacles``: M is inverted, the
inertia of the end effector by ``pinv``, no Coriolis terms; every link near an obstacle is pushed by a force
that is scaled with the inertia felt at its nearest point; a filter keeps push and damping out of the task.
MuJoCo supplies matrices and plant. The trajectory is not ours.
"""

from __future__ import annotations

import mujoco
import numpy as np

from peers.law import Task
from peers.peer import Array, Peer
from peers.with_mujoco import Plant


class OperationalSpace(Plant):
    def __init__(self, task: Task) -> None:
        super().__init__(task)
        n = task.n
        self.first = self.model.nbody - n
        self.to_tip = np.array([self.task.shape.lengths[-1], 0.0, 0.0])
        self.M, self.identity = np.zeros((n, n)), np.eye(n)
        self.J, self.J_c = np.zeros((3, n)), np.zeros((3, n))

    def step(self) -> None:
        model, data, task = self.model, self.data, self.task
        mujoco.mj_step1(model, data)
        last = model.nbody - 1
        tip = data.xpos[last] + data.xmat[last].reshape(3, 3) @ self.to_tip
        mujoco.mj_jac(model, data, self.J, None, tip, last)
        mujoco.mj_fullM(model, data, self.M)
        J, dq = self.J[:2], data.qvel
        M_inv = np.linalg.inv(self.M)
        Mx = np.linalg.pinv(J @ M_inv @ J.T, rcond=0.04)
        t = self.k * self.task.dt
        x_r, dx_r, _ = task.reference(t)
        u_task = -task.stiffness * (tip[:2] - x_r) - task.damping * (J @ dq - dx_r)
        null_filter = self.identity - J.T @ (Mx @ J @ M_inv)
        u_null = self.avoid(t, np.vstack([data.xanchor, tip])[:, :2], M_inv)
        u_null -= task.null_damping * (self.M @ dq)
        data.qfrc_applied[:] = J.T @ (Mx @ u_task) + null_filter @ u_null
        mujoco.mj_step2(model, data)
        self.k += 1

    def avoid(self, t: float, p: Array, M_inv: Array) -> Array:
        """The push of all discs on all links, link by link."""
        push = np.zeros(self.model.nv)
        reach, point = self.task.field.influence, np.zeros(3)
        for center, radius in zip(self.task.discs(t), self.task.radii, strict=True):
            for i in range(len(p) - 1):
                along = p[i + 1] - p[i]
                s = (center - p[i]) @ along / (along @ along)
                point[:2] = p[i] + min(max(s, 0.0), 1.0) * along
                away = point[:2] - center
                d = np.sqrt(away @ away)
                if d - radius < reach:
                    mujoco.mj_jac(self.model, self.data, self.J_c, None, point, self.first + i)
                    J_c = self.J_c[:2]
                    inertia = np.linalg.pinv(J_c @ M_inv @ J_c.T, rcond=0.01)
                    push += J_c.T @ (inertia @ (self.task.field.force(d - radius) / d * away))
        return push


PEERS = (
    Peer(
        "abr_control-style OSC",
        "another law: no Coriolis terms, Khatib's push per link; plant by `mj_step`",
        ("mujoco", "numpy"),
        OperationalSpace,
        same=False,
    ),
)
