"""MuJoCo: its step alone, and its step under the dense law in NumPy, fed with MuJoCo's matrices."""

from __future__ import annotations

import mujoco
import numpy as np

from peers.law import Task
from peers.peer import Loop, Peer


class Plant(Loop):
    """The arm without control, without contacts."""

    def __init__(self, task: Task) -> None:
        self.task = task
        # URDF lists its links one after the other; MJCF nests them, which ends at 500.
        self.model = mujoco.MjModel.from_xml_string(task.arm.to_urdf())
        self.model.opt.gravity[:] = 0.0
        self.model.opt.timestep = task.dt
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        self.data = mujoco.MjData(self.model)
        self.data.qpos[:], self.data.qvel[:] = task.q0, task.dq0
        self.q, self.k = self.data.qpos, 0

    def step(self) -> None:
        mujoco.mj_step(self.model, self.data)


class Controlled(Plant):
    """C = Σ m JᵀJ̇ over the centres of mass, as MuJoCo has no Coriolis matrix."""

    def __init__(self, task: Task) -> None:
        super().__init__(task)
        n = task.n
        self.bodies = range(self.model.nbody - n, self.model.nbody)
        self.masses = np.repeat(self.model.body_mass[-n:], 3)
        self.to_tip = np.array([self.task.shape.lengths[-1], 0.0, 0.0])
        self.M = np.zeros((n, n))
        self.J_com, self.dJ_com = np.zeros((n, 3, n)), np.zeros((n, 3, n))
        self.J, self.dJ = np.zeros((3, n)), np.zeros((3, n))

    def step(self) -> None:
        model, data, last = self.model, self.data, self.bodies[-1]
        mujoco.mj_step1(model, data)
        tip = data.xpos[last] + data.xmat[last].reshape(3, 3) @ self.to_tip
        mujoco.mj_jac(model, data, self.J, None, tip, last)
        mujoco.mj_jacDot(model, data, self.dJ, None, tip, last)
        for i, body in enumerate(self.bodies):
            mujoco.mj_jac(model, data, self.J_com[i], None, data.xipos[body], body)
            mujoco.mj_jacDot(model, data, self.dJ_com[i], None, data.xipos[body], body)
        mujoco.mj_fullM(model, data, self.M)
        n = model.nv
        moving, turning = self.J_com.reshape(-1, n), self.dJ_com.reshape(-1, n)
        p = np.vstack([data.xanchor, tip])[:, :2]
        data.qfrc_applied[:] = self.task.torque(
            self.k * self.task.dt,
            data.qvel,
            p,
            self.J[:2],
            self.dJ[:2],
            self.M,
            data.qfrc_bias,
            lambda u: turning.T @ (self.masses * (moving @ u)),
        )
        mujoco.mj_step2(model, data)
        self.k += 1


PEERS = (
    Peer("MuJoCo, `mj_step` alone", "the plant without a controller", ("mujoco",), Plant, same=False),
    Peer(
        "MuJoCo + NumPy",
        "`mj_fullM`, `mj_jac`, `mj_jacDot` and the dense law; plant by `mj_step`",
        ("mujoco", "numpy"),
        Controlled,
    ),
)
