"""cbfpy on random scenes: a barrier filter in operational space, as Morton and Pavone use it for arms.

The nominal motion is our law without a field; cbfpy changes its joint acceleration as little as possible,
weighed in task and null space, with the distances of the twelve nearest pairs as barriers of relative degree
two. Between solutions, every 4 ms, the acceleration is held; torque by the exact model. The nearest points
are fixed in the link and in the obstacle while cbfpy differentiates, for it wants smooth barriers and knows
no shapes.
"""

from __future__ import annotations

import os
from functools import cache, partial

os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

import vffnull as vff
from peers.avoidance import Array, Filter, Reference, Way

jax.config.update("jax_enable_x64", True)

EVERY = 4  # steps of 1 ms between QPs
PAIRS = 12
MARGIN = 0.03  # m


class Arm(CBFConfig):
    """State: angles, velocities, time since the distances were measured; control: joint accelerations."""

    def __init__(self, n: int, rate: float | None) -> None:
        self.joints, self.rate = n, rate
        zeros = np.zeros((PAIRS, n)), np.zeros((PAIRS, 2)), np.ones(PAIRS), np.zeros(PAIRS), np.eye(n)
        super().__init__(n=2 * n + 1, m=n, init_args=zeros)

    def f(self, z, *_):
        n = self.joints
        return jnp.concatenate([z[n : 2 * n], jnp.zeros(n), jnp.ones(1)])

    def g(self, z, *_):
        n = self.joints
        return jnp.concatenate([jnp.zeros((n, n)), jnp.eye(n), jnp.zeros((1, n))])

    def h_2(self, z, along, normal, offset, speed, _):
        angle = jnp.cumsum(z[: self.joints])
        points = jnp.stack([along @ jnp.cos(angle), along @ jnp.sin(angle)], axis=1)
        return jnp.sum(normal * points, axis=1) + offset - speed * z[-1]

    def alpha(self, h, *_):
        return h if self.rate is None else self.rate * h

    def alpha_2(self, h_2, *_):
        return h_2 if self.rate is None else self.rate * h_2

    def P(self, z, u, *args):
        return 2.0 * args[4]

    def q(self, z, u, *args):
        return -2.0 * args[4] @ u


@cache
def barrier(n: int, rate: float | None) -> CBF:
    """Compiled once for each number of joints."""
    return CBF.from_config(Arm(n, rate))


class Cbfpy(Filter):
    def __init__(
        self, scene: vff.Scenario, reference: Reference, rate: float | None, weight: float, motion: bool
    ) -> None:
        super().__init__(scene, reference)
        settings = {key: scene["controller"][key] for key in ("stiffness", "damping", "null_damping")}
        self.nominal = vff.Controller(self.arm, settings)
        self.cbf, self.weight, self.motion = barrier(self.arm.n, rate), weight, motion
        self.obstacles = scene["obstacles"]
        self.radius = float(np.max(scene["arm"]["radius"]))
        self.ddq = np.zeros(self.arm.n)

    def torque(self, k: int, state: object) -> Array:
        q, dq, ref = state.q, state.dq, self.reference
        if k % EVERY == 0:
            tau = self.nominal.torque(q, dq, ref.x[k], ref.dx[k], ref.ddx[k])
            wanted = self.arm.forward_dynamics(q, dq, tau)
            z = np.concatenate([q, dq, [0.0]])
            self.ddq = np.asarray(self.cbf.safety_filter(z, wanted, *self.barriers(q, dq, state.t)))
        return self.arm.inverse_dynamics(q, dq, self.ddq)

    def barriers(self, q: Array, dq: Array, t: float) -> tuple[Array, ...]:
        """Arguments of the barriers of the nearest pairs; those that are missing are far away."""
        n, lengths = self.arm.n, self.arm.lengths
        pairs = vff.distances(self.arm, q, dq, self.obstacles, t)
        chosen = np.argsort(pairs.distance)[:PAIRS]
        joints = self.arm.forward_kinematics(q)[-n - 1 :]
        along, normal = np.zeros((PAIRS, n)), np.zeros((PAIRS, 2))
        offset, speed = np.ones(PAIRS), np.zeros(PAIRS)
        for row, pair in enumerate(chosen):
            i = int(pairs.link[pair])
            along[row, :i] = lengths[:i]
            along[row, i] = np.linalg.norm(pairs.point[pair] - joints[i])
            normal[row] = pairs.normal[pair]
            offset[row] = pairs.distance[pair] - MARGIN - normal[row] @ pairs.point[pair]
            if self.motion:  # what the rate has beyond the joints' part
                speed[row] = pairs.gradient[pair] @ dq - pairs.rate[pair]
        J, M = self.arm.jacobian(q), self.arm.mass_matrix(q)
        Y = np.linalg.solve(M, J.T)
        N = np.eye(n) - Y @ np.linalg.solve(J @ Y, J)
        return along, normal, offset, speed, self.weight * J.T @ J + N.T @ N


WAYS = (
    Way(
        "cbfpy",
        "cbfpy's own α(h) = h and penalties, weight 1 on the task and on the null space, obstacles at rest",
        partial(Cbfpy, rate=None, weight=1.0, motion=False),
    ),
    Way(
        "cbfpy, tuned",
        "α(h) = 20 h, weight 5 on the task, and the obstacles' velocities in the barriers",
        partial(Cbfpy, rate=20.0, weight=5.0, motion=True),
    ),
)
