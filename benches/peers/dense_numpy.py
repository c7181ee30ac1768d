"""NumPy alone: M and C from the Jacobians of the centres of mass, one factorisation for law and plant."""

from __future__ import annotations

import numpy as np

from peers.law import Task, cholesky
from peers.peer import Loop, Peer


class Dense(Loop):
    def __init__(self, task: Task) -> None:
        self.task, n = task, task.n
        arm = self.task.shape
        self.below = np.tri(n)
        self.masses, self.lengths, self.com = arm.masses[:, None], arm.lengths, arm.com[:, 0]
        carried = np.cumsum(arm.inertias[::-1])[::-1]
        self.spin = carried[np.maximum.outer(np.arange(n), np.arange(n))]
        self.q, self.dq, self.k = task.q0, task.dq0, 0

    def step(self) -> None:
        q, dq, below = self.q, self.dq, self.below
        theta, w = np.cumsum(q), np.cumsum(dq)
        ux, uy = np.cos(theta), np.sin(theta)
        px, py = below @ (self.lengths * ux), below @ (self.lengths * uy)  # ends of the links
        vx, vy = -(below @ (self.lengths * uy * w)), below @ (self.lengths * ux * w)
        x0, y0, vx0, vy0 = (np.concatenate([[0.0], a[:-1]]) for a in (px, py, vx, vy))
        cx, cy = x0 + self.com * ux, y0 + self.com * uy
        ax, ay = vx0 - self.com * uy * w, vy0 + self.com * ux * w
        # Rows: centres of mass; columns: joints. C = Σ m JᵀJ̇ is the Christoffel choice in the plane.
        Jx, Jy = below * np.subtract.outer(-cy, -y0), below * np.subtract.outer(cx, x0)
        dJx, dJy = below * np.subtract.outer(-ay, -vy0), below * np.subtract.outer(ax, vx0)
        mJx, mJy = self.masses * Jx, self.masses * Jy
        M = Jx.T @ mJx + Jy.T @ mJy + self.spin
        C = mJx.T @ dJx + mJy.T @ dJy
        J = np.stack([y0 - py[-1], px[-1] - x0])
        J_dot = np.stack([vy0 - vy[-1], vx[-1] - vx0])
        p = np.stack([np.concatenate([[0.0], px]), np.concatenate([[0.0], py])], axis=1)
        C_dq, solve = C @ dq, cholesky(M)
        tau = self.task.torque(self.k * self.task.dt, dq, p, J, J_dot, M, C_dq, lambda u: C.T @ u, solve)
        self.dq = dq + self.task.dt * solve(tau - C_dq)
        self.q = q + self.task.dt * self.dq
        self.k += 1


PEERS = (Peer("NumPy", "dense law and plant, Cholesky by SciPy", ("numpy", "scipy"), Dense),)
