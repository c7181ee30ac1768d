"""An operational-space controller as abr_control has it, in space: another law, written here from its formulas.

As in ``benches/peers/osc.py``: M is inverted, the inertia of the end effector by ``pinv``, no Coriolis terms;
every link near an obstacle is pushed by a force that is scaled with the inertia felt at its nearest point; a
filter keeps push, posture and damping out of the task. It has neither an observer nor limits.
"""

from __future__ import annotations

import numpy as np

import vffnull as vff
from peers.spatial.task import Array, Task
from peers.spatial.way import Controller


class OperationalSpaceControl(Controller):
    def __init__(self, task: Task) -> None:
        super().__init__(task)
        control = task.scene["controller"]
        self.stiffness, self.damping = control["stiffness"], control["damping"]
        self.null_damping, self.field = control["null_damping"], control["field"]
        self.posture = np.array(control["posture"])
        self.posture_stiffness = np.array(control["posture_stiffness"])

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        task, arm = self.task, self.task.arm
        M = arm.mass_matrix(q)
        M_inv = np.linalg.inv(M)
        J = arm.jacobian(q)[: task.rows]
        Mx = np.linalg.pinv(J @ M_inv @ J.T, rcond=1e-4)
        wanted = self.damping * (task.twist[k, : task.rows] - J @ dq)
        wanted += self.stiffness * deviation(arm.pose(q), task.place[k])[: task.rows]
        u_null = self.avoid(task.times[k], q, dq, M_inv) + self.posture_stiffness * (self.posture - q)
        u_null -= self.null_damping * (M @ dq)
        return J.T @ (Mx @ wanted) + u_null - J.T @ (Mx @ (J @ (M_inv @ u_null))) + arm.gravity_torque(q)

    def avoid(self, t: float, q: Array, dq: Array, M_inv: Array) -> Array:
        """The push of all obstacles on all links, by the same field as ours, whose force is an acceleration here."""
        push = np.zeros(len(q))
        reach = self.field["influence"]
        found = vff.distances(self.task.arm, q, dq, self.task.solids, t)
        for distance, along in zip(found.distance, found.gradient, strict=True):
            felt = along @ M_inv @ along
            if distance < reach and felt > 1e-9:
                push += along * (self.field["gain"] * (1.0 - distance / reach) ** 2 / felt)
        return push


def deviation(pose: tuple[Array, Array], place: Array) -> Array:
    """From a pose to a place (7,): position [m], and twice the vector part of the rotation between them."""
    (position, (w, *v)), (w_r, *v_r) = pose, place[3:]
    turned = w * np.array(v_r) - w_r * np.array(v) - np.cross(v_r, v)
    sign = np.sign(w * w_r + np.dot(v, v_r)) or 1.0
    return np.concatenate([place[:3] - position, 2.0 * sign * turned])
