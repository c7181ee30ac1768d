"""mink: joint velocities by its QP with its limits, every millisecond, and a servo that follows them.

As in mink's own examples its configuration is integrated by itself; a computed torque tracks it. The limits
are those of collision avoidance, of configuration and of velocity. mink asks where obstacles are and not how
fast they move: `MovingLimit` adds what the obstacle moves along the normal within a step to the bound of each
pair, so that it knows what everybody knows. The QP's variable is a displacement while the bound of
`CollisionAvoidanceLimit` is written as a speed (mink 1.3.0): a rate of approach of k per second takes a gain
of k dt², and its default 0.85 is no restriction at 1 kHz until the limit is reached.
"""

from __future__ import annotations

import os
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mink
import mujoco
import numpy as np

from peers.spatial.task import Array, Task
from peers.spatial.way import Controller, Range, Settings, Way
from vffnull.engines.export import to_mjcf


class MovingLimit(mink.CollisionAvoidanceLimit):
    """mink's limit with the obstacles' velocities in its bounds."""

    speeds: Array  # (k, 3) of the obstacles, by their bodies after the first of them
    first: int

    def compute_qp_inequalities(self, configuration: mink.Configuration, dt: float) -> mink.Constraint:
        found = super().compute_qp_inequalities(configuration, dt)
        reach, fromto = self.collision_detection_distance, np.empty(6)
        for row in np.flatnonzero(np.isfinite(found.h)):
            pair = self.geom_id_pairs[row]  # the link's geom comes first
            apart = mujoco.mj_geomDistance(self.model, configuration.data, *pair, reach, fromto)
            towards = fromto[3:] - fromto[:3]
            length = np.linalg.norm(towards)
            if length > 0.0:
                speed = self.speeds[self.model.geom_bodyid[pair[1]] - self.first]
                found.h[row] += dt * np.copysign(1.0, apart) * (towards @ speed) / length
        return found


class Mink(Controller):
    def __init__(self, task: Task, settings: Settings, moving: bool) -> None:
        super().__init__(task)
        arm, self.settings = task.arm, settings
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(arm, obstacles=task.solids))
        self.configuration = mink.Configuration(self.model)
        self.first = self.model.body("obstacle_1").id
        bodies = self.model.geom_bodyid
        links = [
            g for g in range(self.model.ngeom) if self.model.body_weldid[bodies[g]] and bodies[g] < self.first
        ]
        obstacles = [g for g in range(self.model.ngeom) if bodies[g] >= self.first]
        kind = MovingLimit if moving else mink.CollisionAvoidanceLimit
        self.collision = kind(
            self.model,
            [(links, obstacles)],
            gain=settings["gain"],
            minimum_distance_from_collisions=settings["minimum_distance"],
            collision_detection_distance=settings["detection_distance"],
            bound_relaxation=settings["relaxation"],
        )
        if len(self.collision.geom_id_pairs) != len(links) * len(obstacles):
            raise RuntimeError("mink leaves pairs of a link and an obstacle out")
        if moving:
            self.collision.first = self.first
        speeds = dict(zip(arm.joint_names, arm.velocity_limits, strict=True))
        self.limits = [
            mink.ConfigurationLimit(self.model),
            mink.VelocityLimit(self.model, speeds),
            self.collision,
        ]
        self.tip = mink.FrameTask(
            arm.to_dict()["tip"],
            "site",
            position_cost=1.0,
            orientation_cost=settings["orientation_cost"] if task.rows == 6 else 0.0,
            gain=settings["task_gain"],
        )
        self.posture = mink.PostureTask(self.model, cost=settings["posture_cost"])
        self.reset()
        self.posture.set_target(task.q0)

    def reset(self) -> None:
        self.configuration.update(self.task.q0.copy())
        self.velocity = np.zeros(self.task.arm.n)

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        task, configuration, dt = self.task, self.configuration, self.task.dt
        configuration.data.mocap_pos[:] = task.obstacles[k]
        configuration.update()
        if isinstance(self.collision, MovingLimit):
            self.collision.speeds = task.speeds[k]
        x, y, z, *turn = task.place[min(k + 1, task.steps)]
        self.tip.set_target(mink.SE3(np.array([*turn, x, y, z])))
        before = configuration.q.copy()
        self.velocity = self.settings["persistence"] * self.velocity  # unless a solution is found
        try:
            self.velocity = mink.solve_ik(
                configuration,
                [self.tip, self.posture],
                dt,
                solver="daqp",
                damping=self.settings["damping"],
                limits=self.limits,
            )
        except mink.NoSolutionFound:
            self.unsolved += 1
        configuration.integrate_inplace(self.velocity, dt)
        servo = self.settings["servo"]
        wanted = servo**2 * (before - q) + 2.0 * servo * (self.velocity - dq)
        return task.arm.inverse_dynamics(q, dq, wanted)


DEFAULTS = {  # mink's own, those of its examples where it has none
    "gain": 0.85,
    "minimum_distance": 0.005,
    "detection_distance": 0.01,
    "relaxation": 0.0,
    "orientation_cost": 1.0,
    "task_gain": 1.0,
    "posture_cost": 1e-2,
    "damping": 1e-12,
    "servo": 50.0,
    "persistence": 0.0,  # where the QP has no solution, it stands
}
SPACE = {
    "gain": Range(1e-6, 0.85, log=True),
    "minimum_distance": Range(0.005, 0.08),
    "detection_distance": Range(0.1, 0.4),
    "relaxation": Range(-1e-3, 0.0),
    "orientation_cost": Range(0.1, 3.0, log=True),
    "task_gain": Range(3e-3, 1.0, log=True),
    "posture_cost": Range(1e-4, 1e-1, log=True),
    "damping": Range(1e-8, 1e-2, log=True),
    "servo": Range(20.0, 200.0, log=True),
    "persistence": Range(0.0, 0.999),
}
WAYS = (
    Way(
        "mink, defaults",
        "its limits with their defaults, where obstacles are and not how fast; a servo of 50 rad/s",
        DEFAULTS,
        prepare=partial(Mink, moving=False),
    ),
    Way(
        "mink, tuned",
        "the same with the obstacles' velocities in the bounds and the settings found on training scenes",
        DEFAULTS,
        SPACE,
        prepare=partial(Mink, moving=True),
    ),
)
