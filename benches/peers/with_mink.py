"""mink: differential inverse kinematics with its collision-avoidance limit. Other work than ours.

One quadratic program (QP) a step finds joint velocities, which are integrated; there are no torques, no
inertia and no plant. The tip follows the same circle and the arm keeps away from the same disc.
"""

from __future__ import annotations

import mink
import mujoco
import numpy as np

from peers.law import Task
from peers.peer import Loop, Peer
from vffnull.engines.export import to_mjcf


class Mink(Loop):
    def __init__(self, task: Task) -> None:
        self.task, n = task, task.n
        self.model = mujoco.MjModel.from_xml_string(
            to_mjcf(self.task.arm, obstacles=self.task.document["obstacles"])
        )
        self.configuration = mink.Configuration(self.model)
        self.configuration.update(self.task.q0)
        self.tip = mink.FrameTask("tip", "site", position_cost=[1.0, 1.0, 0.0], orientation_cost=0.0)
        reach = self.task.field.influence
        self.limit = mink.CollisionAvoidanceLimit(
            self.model,
            geom_pairs=[([f"link_{i + 1}" for i in range(n)], ["obstacle_1"])],
            minimum_distance_from_collisions=reach / 2,
            collision_detection_distance=reach,
        )
        self.target = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self.q, self.k = self.configuration.q, 0

    def step(self) -> None:
        t = self.k * self.task.dt
        self.configuration.data.mocap_pos[0, :2] = self.task.discs(t)[0]
        self.configuration.update()
        self.target[4:6] = self.task.reference(t + self.task.dt)[0]
        self.tip.set_target(mink.SE3(self.target.copy()))
        velocity = mink.solve_ik(
            self.configuration, [self.tip], self.task.dt, solver="daqp", damping=1e-6, limits=[self.limit]
        )
        self.configuration.integrate_inplace(velocity, self.task.dt)
        self.q = self.configuration.q
        self.k += 1


PEERS = (
    Peer(
        "mink",
        "other work: joint velocities by a QP with collision limits, no torques, no plant",
        ("mink", "daqp", "mujoco"),
        Mink,
        same=False,
        largest=200,
    ),
)
