"""Pinocchio's dynamics, the dense law in NumPy, the plant by Pinocchio's articulated-body algorithm."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

import vffnull as vff
from peers.law import Task
from peers.peer import Loop, Peer

AXES = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class Pinocchio(Loop):
    def __init__(self, task: Task) -> None:
        self.task = task
        # With limits, never reached, a joint has its angle as coordinate, else its cosine and sine.
        limited = vff.Arm(**task.document["arm"] | {"joint_limits": [-1e3, 1e3]})
        self.model = pin.buildModelFromXML(limited.to_urdf())
        self.model.gravity.setZero()
        self.data = self.model.createData()
        self.tip = self.model.getFrameId("tip", pin.FrameType.BODY)
        self.q, self.dq, self.k = task.q0, task.dq0, 0

    def step(self) -> None:
        model, data, q, dq = self.model, self.data, self.q, self.dq
        pin.computeJointJacobiansTimeVariation(model, data, q, dq)
        pin.updateFramePlacement(model, data, self.tip)
        J = pin.getFrameJacobian(model, data, self.tip, AXES)[:2].copy()
        J_dot = pin.getFrameJacobianTimeVariation(model, data, self.tip, AXES)[:2].copy()
        C = pin.computeCoriolisMatrix(model, data, q, dq)
        upper = np.triu(pin.crba(model, data, q))
        M = upper + np.triu(upper, 1).T
        places = [data.oMi[i].translation for i in range(1, model.njoints)]
        p = np.array([*places, data.oMf[self.tip].translation])[:, :2]
        tau = self.task.torque(self.k * self.task.dt, dq, p, J, J_dot, M, C @ dq, lambda u: C.T @ u)
        self.dq = dq + self.task.dt * pin.aba(model, data, q, dq, tau)
        self.q = q + self.task.dt * self.dq
        self.k += 1


PEERS = (
    Peer(
        "Pinocchio + NumPy",
        "`crba`, `computeCoriolisMatrix` and the dense law; plant by `aba`",
        ("pin", "numpy"),
        Pinocchio,
        largest=200,  # for 500 joints its data take 8 GB
    ),
)
