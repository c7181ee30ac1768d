"""The law with dense matrices, (T12) of docs/theory.md, for every peer that computes torques.

Whoever calls it brings joint positions, Jacobian and dynamics from a library; the contacts, the field and
the reference come from the tests' NumPy prototype.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpotrf, dpotrs

import oracle
import vffnull as vff

Array = NDArray[Any]


class Task:
    """What a scenario document asks for, with the law that does it.

    Discs only, no gravity, centres of mass on the links' axes, the law held over every step.
    """

    def __init__(self, document: Mapping[str, Any]) -> None:
        control = document["controller"]
        self.document = dict(document)
        self.arm = vff.Arm(**document["arm"])
        self.shape = oracle.Arm.from_dict(document["arm"])
        self.n, self.dt = self.arm.n, document["simulation"]["dt"]
        self.q0 = np.array(document["q0"], dtype=float)
        self.dq0 = np.array(document.get("dq0", np.zeros(self.n)), dtype=float)
        tip = self.arm.forward_kinematics(self.q0)[-1]
        self.reference = oracle.reference(document["reference"], tip)
        self.radii = np.array([o["shape"]["radius"] for o in document["obstacles"]])
        self.stiffness, self.damping = control["stiffness"], control["damping"]
        self.null_damping = control["null_damping"]
        self.field = oracle.Field(**control["field"])
        if self.shape.gravity.any() or self.shape.com[:, 1].any():
            raise ValueError("the peers know neither gravity nor centres of mass beside the link's axis")

    def discs(self, t: float) -> Array:
        """Centres (k, 2) of the obstacles [m]."""
        return oracle.obstacle_centers(self.document["obstacles"], t)

    def desired(self, t: float, x: Array, dx: Array) -> Array:
        """ẍ_c, what the end effector should do."""
        x_r, dx_r, ddx_r = self.reference(t)
        desired: Array = ddx_r - self.damping * (dx - dx_r) - self.stiffness * (x - x_r)
        return desired

    def repulsion(self, t: float, p: Array) -> Array:
        """τ_vff (n,) of all pairs, for joints at `p` (n+1, 2), the tip last."""
        axis = np.diff(p, axis=0) / self.shape.lengths[:, None]
        links = SimpleNamespace(p=p, axis=axis)  # all of a posture that matters here
        near = oracle.contacts(self.shape, links, self.discs(t), self.radii)  # type: ignore[arg-type]
        force = self.field.force(near.distance)[:, :, None] * near.normal
        moment = cross(near.point, force).sum(axis=1)
        # Joint j feels what acts on its own link and on all further out.
        force_beyond = np.cumsum(force.sum(axis=1)[::-1], axis=0)[::-1]
        moment_beyond = np.cumsum(moment[::-1])[::-1]
        torque: Array = moment_beyond - cross(p[:-1], force_beyond)
        return torque

    def torque(
        self,
        t: float,
        dq: Array,
        p: Array,
        J: Array,
        J_dot: Array,
        M: Array,
        C_dq: Array,
        C_tr: Callable[[Array], Array],
        solve: Callable[[Array], Array] | None = None,
    ) -> Array:
        """(T12) without gravity: `C_dq` = C q̇, ``C_tr(u)`` = Cᵀu, ``solve(b)`` = M⁻¹b."""
        dx = J @ dq
        Y = (solve or cholesky(M))(J.T)
        Lambda = np.linalg.inv(J @ Y)
        f = Lambda @ (self.desired(t, p[-1], dx) + Y.T @ C_dq - J_dot @ dq)
        momentum = Lambda @ dx
        task_motion = Y @ momentum
        y = J_dot.T @ momentum - C_tr(task_motion) + self.repulsion(t, p)
        y -= self.null_damping * (M @ (dq - task_motion))
        tau: Array = y + J.T @ (f - Lambda @ (Y.T @ y))
        return tau


def cross(a: Array, b: Array) -> Array:
    """The cross products of planar vectors."""
    product: Array = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def cholesky(M: Array) -> Callable[[Array], Array]:
    """b ↦ M⁻¹b by one factorisation in LAPACK."""
    factor = dpotrf(M.T, lower=1)[0]
    return lambda b: dpotrs(factor, b, lower=1)[0]
