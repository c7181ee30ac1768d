"""mink on random scenes: joint velocities by its QP with its collision-avoidance limit, every 5 ms.

As in mink's own examples, its configuration is integrated by itself, and a servo follows: joint torque by the
exact model, M(q) (Kp (q_mink - q) + Kd (dq_mink - dq)) + C dq, at 1 kHz, critically damped at 50 rad/s. Where
the QP has no solution, the configuration stands still for a period. mink is told where obstacles are,
not how fast they move: it has no place for that. By default its limit only forbids to approach, so that an
obstacle that comes is waited for; a negative `bound_relaxation` makes links retreat at that speed.
"""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import mink
import mujoco
import numpy as np

from peers.avoidance import Array, Filter, Reference, Way
from vffnull import Scenario
from vffnull.engines.export import to_mjcf

EVERY = 5  # steps of 1 ms between QPs
SERVO = 50.0  # rad/s


class Mink(Filter):
    def __init__(self, scene: Scenario, reference: Reference, limit: dict[str, float], speed: float | None):
        super().__init__(scene, reference)
        n, obstacles = self.arm.n, scene["obstacles"]
        self.model = mujoco.MjModel.from_xml_string(to_mjcf(self.arm, obstacles=obstacles))
        self.configuration = mink.Configuration(self.model)
        self.configuration.update(np.asarray(scene["q0"], dtype=float))
        self.tip = mink.FrameTask("tip", "site", position_cost=[1.0, 1.0, 0.0], orientation_cost=0.0)
        links, joints = ([f"{kind}_{i + 1}" for i in range(n)] for kind in ("link", "joint"))
        bodies = [f"obstacle_{k + 1}" for k in range(len(obstacles))]
        pairs = [(links, bodies)]
        bounds = [] if speed is None else [mink.VelocityLimit(self.model, dict.fromkeys(joints, speed))]
        self.limits = [mink.CollisionAvoidanceLimit(self.model, pairs, **limit), *bounds]
        self.target = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self.velocity = np.zeros(n)
        self.base = self.configuration.q.copy()

    def torque(self, k: int, state: object) -> Array:
        dt = self.reference.dt
        if k % EVERY == 0:
            self.plan(k, EVERY * dt, state.obstacles)
        q, dq = state.q, state.dq
        wanted = self.base + self.velocity * (k % EVERY) * dt
        ddq = SERVO**2 * (wanted - q) + 2.0 * SERVO * (self.velocity - dq)
        return self.arm.inverse_dynamics(q, dq, ddq)

    def plan(self, k: int, period: float, obstacles: Array) -> None:
        self.configuration.integrate_inplace(self.velocity, period if k else 0.0)
        self.configuration.data.mocap_pos[:, :2] = obstacles
        self.configuration.update()
        self.base = self.configuration.q.copy()
        self.target[4:6] = self.reference.x[min(k + EVERY, len(self.reference.x) - 1)]
        self.tip.set_target(mink.SE3(self.target.copy()))
        self.velocity = np.zeros(self.arm.n)
        with suppress(mink.NoSolutionFound):
            self.velocity = mink.solve_ik(
                self.configuration, [self.tip], period, solver="daqp", damping=1e-6, limits=self.limits
            )


TUNED = {
    "gain": 0.05,
    "minimum_distance_from_collisions": 0.03,  # m
    "collision_detection_distance": 0.3,  # m
    "bound_relaxation": -0.6,  # m, in each step
}
WAYS = (
    Way("mink", "`CollisionAvoidanceLimit` with its defaults", partial(Mink, limit={}, speed=None)),
    Way(
        "mink, tuned",
        "the same with gain 0.05, a minimum distance of 0.03 m, detection from 0.3 m, a bound relaxation of "
        "-0.6 (without it, it never retreats) and a `VelocityLimit` of 6 rad/s: the best of a dozen on "
        "training seeds. mink takes gain and relaxation per step, not per second, so that these leave little "
        "of the limit; searched in that unit (docs/peers.md) it does better",
        partial(Mink, limit=TUNED, speed=6.0),
    ),
)
