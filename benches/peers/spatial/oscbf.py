"""An operational-space filter as Morton and Pavone describe it (arXiv 2503.06736), on their cbfpy.

The nominal torque is our operational-space law without a field, with a posture as secondary task. cbfpy
changes it as little as possible, weighed by the acceleration of the hand and by that of the null space, so
that spheres on the links keep their distance (barriers of relative degree two), joints their ranges and
their speeds, and torques their limits; slack has a price. Distances are signed and exact for spheres,
capsules and boxes, the obstacles move with their velocities during a derivative, and the arm's matrices come
from the compiled model, so that what is timed is cbfpy's part: derivatives by JAX and the QP.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache, partial

os.environ.setdefault("JAX_PLATFORMS", "cpu")  # what cbfpy recommends for one core
os.environ.setdefault("JAX_ENABLE_X64", "1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax
import jax.numpy as jnp
import numpy as np
from cbfpy import CBF, CBFConfig

import vffnull as vff
from peers.spatial import panda_spheres
from peers.spatial.spheres import Spheres, along_capsules, as_placed
from peers.spatial.task import Array, Task, orientations
from peers.spatial.way import Controller, Range, Settings, Way
from vffnull.evaluation import scenes
from vffnull.evaluation.geometry.arm import frame
from vffnull.evaluation.geometry.space import Obstacles

jax.config.update("jax_enable_x64", True)  # too late for the variable where qpsolvers has imported JAX

SLOTS = (2, 6, 10)  # obstacles that a compiled filter has room for
FAR = 100.0  # m, where an empty slot is
ALLOWED = 1e-7  # m: the other implementation halves intervals
OTHERS = tuple(arm for arm in scenes.EVALUATED if arm not in panda_spheres.ARMS)
BACKEND, TOLERANCE = "elastiqp", 1e-5  # the faster of cbfpy's two solvers, as exact as it recommends


class Filter(CBFConfig):
    """State: angles, velocities, time since now; control: torque. `empty` has the arguments in order."""

    def __init__(self, arm: vff.Arm, spheres: Spheres, rows: int, slots: int) -> None:
        document, n = arm.to_dict(), arm.n
        self.joints = n
        self.fixed = np.stack([frame(joint) for joint in document["joints"]])
        self.axes = np.array([joint["axis"] for joint in document["joints"]], dtype=float)
        if any(joint["kind"] == "prismatic" for joint in document["joints"]):
            raise ValueError("written for joints that turn")
        self.mount = frame(document["mount"])
        self.spheres, self.speeds = spheres, arm.velocity_limits
        self.low, self.high = arm.joint_limits.T
        super().__init__(
            n=2 * n + 1,
            m=n,
            u_min=-arm.torque_limits,
            u_max=arm.torque_limits,
            backend=BACKEND,
            solver_tol=TOLERANCE,
            init_args=empty(n, rows, slots),
        )

    def f(self, z, inverse, bias, *_):
        n = self.joints
        return jnp.concatenate([z[n : 2 * n], -inverse @ bias, jnp.ones(1)])

    def g(self, z, inverse, *_):
        n = self.joints
        return jnp.concatenate([jnp.zeros((n, n)), inverse, jnp.zeros((1, n))])

    def h_1(self, z, *_):
        speed = z[self.joints : 2 * self.joints]
        return jnp.concatenate([self.speeds - speed, self.speeds + speed])

    def h_2(self, z, inverse, bias, jacobian, place, turn, half, radius, velocity, gains, *_):
        q = z[: self.joints]
        moved = place + velocity * z[-1]
        apart = distances(self.centers(q), moved, turn, half, radius)
        apart = apart - self.spheres.radius[:, None] - gains[2]
        return jnp.concatenate([apart.ravel(), q - self.low, self.high - q])

    def centers(self, q):
        """Centres of the spheres in the world."""
        rotation, origin = self.mount[:3, :3], self.mount[:3, 3]
        found = []
        for i in range(self.joints):
            origin = origin + rotation @ self.fixed[i, :3, 3]
            rotation = rotation @ self.fixed[i, :3, :3] @ turning(self.axes[i], q[i])
            found.append(origin + self.spheres.center[self.spheres.link == i] @ rotation.T)
        return jnp.concatenate(found)

    def alpha(self, h, *args):
        return args[8][0] * h

    def alpha_2(self, h_2, *args):
        return args[8][1] * h_2

    def P(self, z, u, inverse, bias, jacobian, place, turn, half, radius, velocity, gains, weights):
        response = jacobian @ inverse  # of the hand's acceleration to torque
        inertia = jnp.linalg.inv(response @ jacobian.T)
        null = inverse @ (jnp.eye(self.joints) - jacobian.T @ inertia @ response)
        weighed = weights[:, None] * response
        objective = gains[3] * (weighed.T @ weighed + null.T @ null)
        return 0.5 * (objective + objective.T)

    def q(self, z, u, *args):
        return -self.P(z, u, *args) @ u


def turning(axis, angle):
    """A rotation about a fixed axis."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + jnp.sin(angle) * cross + (1.0 - jnp.cos(angle)) * (cross @ cross)


def distances(points, place, turn, half, radius):
    """Signed distances (s, k) of points from rounded boxes: a sphere has no edges, a box no radius."""
    local = jnp.einsum("ksi,kij->ksj", points - place[:, None], turn)
    beyond = jnp.abs(local) - half[:, None]
    out = jnp.sum(jnp.maximum(beyond, 0.0) ** 2, axis=-1)
    outside = out > 0.0
    length = jnp.where(outside, jnp.sqrt(jnp.where(outside, out, 1.0)), 0.0)
    return (length + jnp.minimum(jnp.max(beyond, axis=-1), 0.0) - radius[:, None]).T


def empty(n: int, rows: int, slots: int) -> tuple[Array, ...]:
    """Arguments of the filter with nothing around: M⁻¹, bias, Jacobian, obstacles, gains, weights."""
    turn = np.tile(np.eye(3), (slots, 1, 1))
    place = np.full((slots, 3), FAR)
    around = place, turn, np.zeros((slots, 3)), np.zeros(slots), np.zeros((slots, 3))
    return np.eye(n), np.zeros(n), np.eye(rows, n), *around, np.array([1.0, 1.0, 0.0, 1.0]), np.ones(rows)


def rounded_boxes(task: Task, slots: int) -> tuple[Array, Array, Array]:
    """Orientations, half edges and radii of the obstacles."""
    _, _, _, _, turn, half, radius, *_ = empty(task.arm.n, task.rows, slots)
    middle = np.zeros((slots, 3))
    for i, (solid, rotation) in enumerate(zip(task.solids, orientations(task), strict=True)):
        shape, turn[i] = solid["shape"], rotation
        if shape["kind"] == "box":
            half[i] = 0.5 * np.array(shape["size"])
            continue
        radius[i] = shape["radius"]
        if shape["kind"] == "capsule":
            a, b = np.array(shape["a"], dtype=float), np.array(shape["b"], dtype=float)
            along = b - a
            half[i, 2] = 0.5 * np.linalg.norm(along)
            axes = np.linalg.qr(np.column_stack([along, np.eye(3)]))[0][:, [1, 2, 0]]
            turn[i], middle[i] = rotation @ axes, rotation @ (0.5 * (a + b))
        elif shape["kind"] != "sphere":
            raise ValueError(f"written for spheres, capsules and boxes, not {shape['kind']}")
    return turn, half, radius, middle


@cache
def compiled(arm: str, placed: Callable[[vff.Arm], Spheres], rows: int, slots: int) -> CBF:
    """Traced once for each number of slots and each task."""
    named = vff.Arm.named(arm)
    return CBF.from_config(Filter(named, placed(named), rows, slots))


class OperationalSpace(Controller):
    def __init__(self, task: Task, settings: Settings, spheres: Callable[[vff.Arm], Spheres]) -> None:
        super().__init__(task)
        self.spheres = spheres(task.arm)
        control = task.scene["controller"]
        self.nominal = vff.Controller(
            task.arm,
            {
                **{key: control[key] for key in ("task", "stiffness", "damping")},
                "null_damping": settings["null_damping"],
                "posture": [float(q) for q in task.q0],
                "posture_stiffness": settings["posture_stiffness"],
                "enforce_limits": False,  # the filter's part
            },
        )
        slots = next(size for size in SLOTS if size >= len(task.solids))
        self.cbf = compiled(task.scene["arm"]["model"], spheres, task.rows, slots)
        self.used = slice(0, len(task.solids))
        self.turn, self.half, self.radius, self.middle = rounded_boxes(task, slots)
        self.place, self.speed = np.full((slots, 3), FAR), np.zeros((slots, 3))
        self.gains = np.array([settings[key] for key in ("alpha", "alpha_2", "margin", "scale")])
        self.weights = np.repeat([settings["position_weight"], settings["rotation_weight"]], 3)[: task.rows]

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        task, arm = self.task, self.task.arm
        wanted = 7 if task.rows == 6 else 3
        tau = self.nominal.torque(
            q, dq, task.place[k, :wanted], task.twist[k, : task.rows], task.rise[k, : task.rows]
        )
        self.place[self.used] = task.obstacles[k]
        self.speed[self.used] = task.speeds[k]
        bias = arm.inverse_dynamics(q, dq, np.zeros(arm.n))
        safe = self.cbf.safety_filter(
            np.concatenate([q, dq, [0.0]]),
            tau,
            np.linalg.inv(arm.mass_matrix(q)),
            bias,
            arm.jacobian(q)[: task.rows],
            self.place + self.middle,
            self.turn,
            self.half,
            self.radius,
            self.speed,
            self.gains,
            self.weights,
        )
        return np.asarray(safe)


def check(name: str) -> None:
    """End the program if spheres or distances are not where the arm and the scenes have them."""
    arm, rng = vff.Arm.named(name), np.random.default_rng(0)
    spheres = as_placed(arm) if name in panda_spheres.ARMS else along_capsules(arm)
    filtering = Filter(arm, spheres, 6, SLOTS[-1])
    low, high = arm.joint_limits.T
    for seed in range(3):
        task = Task(scenes.in_space("clutter", name, "pose", scenes.TRAINING.start + seed))
        q = low + (high - low) * rng.random(arm.n)
        poses = arm.link_poses(q)[spheres.link]
        centers = np.einsum("sij,sj->si", poses[:, :3, :3], spheres.center) + poses[:, :3, 3]
        turn, half, radius, middle = rounded_boxes(task, SLOTS[-1])
        place = np.full((SLOTS[-1], 3), FAR)
        place[: len(task.solids)] = task.obstacles[0]
        found = distances(filtering.centers(q), place + middle, turn, half, radius)
        points = np.repeat(centers[None, :, None], 2, axis=2)
        apart = Obstacles(task.solids).distances(points, np.zeros(len(centers)), np.zeros(1))[0]
        off = np.abs(np.asarray(found)[:, : len(task.solids)] - apart).max()
        if not off <= ALLOWED:
            raise SystemExit(f"{task.scene.name}: distances in JAX are off by {off:.1e} > {ALLOWED:.0e} m")


AUTHORS = {  # of their examples
    "alpha": 10.0,
    "alpha_2": 10.0,
    "margin": 0.0,
    "scale": 1.0,
    "position_weight": 1.0,
    "rotation_weight": 1.0,
    "null_damping": 5.0,
    "posture_stiffness": 10.0,
}
SPACE = {
    "alpha": Range(3.0, 100.0, log=True),
    "alpha_2": Range(3.0, 100.0, log=True),
    "margin": Range(0.0, 0.08),
    "scale": Range(1e-4, 10.0, log=True),
    "position_weight": Range(1.0, 100.0, log=True),
    "rotation_weight": Range(0.3, 30.0, log=True),
    "null_damping": Range(1.0, 30.0, log=True),
    "posture_stiffness": Range(0.1, 30.0, log=True),
}

WAYS = (
    Way(
        "OSCBF, authors' settings",
        "cbfpy's filter with the authors' spheres, α = α₂ = 10/s, weights 1, no margin, as in their examples",
        AUTHORS,
        prepare=partial(OperationalSpace, spheres=as_placed),
        arms=panda_spheres.ARMS,
    ),
    Way(
        "OSCBF, tuned",
        "the same with the settings found on training scenes",
        AUTHORS,
        SPACE,
        prepare=partial(OperationalSpace, spheres=as_placed),
        arms=panda_spheres.ARMS,
    ),
    Way(
        "OSCBF, on capsules",
        "as tuned, but with 47 spheres along the capsules by which collisions are judged, and 2 cm of margin",
        {"margin": 0.02},
        prepare=partial(OperationalSpace, spheres=along_capsules),
        like="OSCBF, tuned",
        arms=panda_spheres.ARMS,
    ),
    Way(
        "OSCBF, on capsules",
        "cbfpy's filter with spheres along the capsules by which collisions are judged, 31 on the iiwa14 and "
        "32 on the ur5e, and the settings found on training scenes",
        AUTHORS | {"margin": 0.02},
        SPACE,
        prepare=partial(OperationalSpace, spheres=along_capsules),
        arms=OTHERS,
    ),
)
