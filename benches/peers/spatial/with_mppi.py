"""Model predictive path integral control (Williams et al. 2017), as a sampling MPC for arms does it.

As in STORM (Bhardwaj et al. 2021), but on one core with NumPy and Numba instead of on a GPU: plans are
accelerations along a horizon, rolled out kinematically; several hundred are drawn around the last plan,
moved on by the time that has passed; their noise is smooth (a cubic spline through a few knots); the next
plan is their mean, weighed by exp(-cost / λ). A plan is made 50 times a second, and between plans a computed
torque follows it every millisecond. λ is counted in the distance of the best tenth from the best, so that it
needs no unit. Noise has many sizes: that of a plan is drawn between a share of the largest and the largest.

Two kinds of plans. `InJoints`: accelerations of the joints, as usual. `AroundHand`: a law holds the hand by
the Jacobian, in the rollouts as in the loop, and what is drawn is by how much the hand deviates from it and
how the arm moves in the null space: half of the plans do not touch the hand.

The arm's model is exact. Its shape are the spheres along the capsules by which collisions are judged; the
distances from spheres, capsules and boxes are exact and signed. Obstacles are extrapolated with their
velocities, and the reference of the hand is known ahead, as the controller's own.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

import vffnull as vff
from peers.spatial.spheres import Spheres, along_capsules
from peers.spatial.task import Task, orientations
from peers.spatial.way import Controller, Range, Settings, Way
from vffnull.evaluation import scenes
from vffnull.evaluation.geometry.arm import frame
from vffnull.evaluation.geometry.space import Obstacles

SERVO = 50.0  # rad/s, of the computed torque
HELD, TURNED = 0.01, 0.05  # m and rad: units of the hand's error in the cost, by which it counts as held
FULL = 0.95  # of a range or a speed: beyond it costs
DAMPED = 1e-4  # m²: of the Jacobian's inverse
ALLOWED = 1e-5  # m, of a model in single precision
Single = np.float32
Array = NDArray[Any]


class Body:
    """Where an arm's frames and spheres are, over many postures (n, …) at once, in single precision."""

    def __init__(self, arm: vff.Arm, spheres: Spheres) -> None:
        document = arm.to_dict()
        if any(joint["kind"] == "prismatic" for joint in document["joints"]):
            raise ValueError("written for joints that turn")
        found = []
        for joint in document["joints"]:
            fixed, (x, y, z) = frame(joint), joint["axis"]
            cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
            parts = np.zeros((3, 3, 4))  # F (1 + sin θ C + (1 - cos θ) C²), and the offset that stays
            parts[0] = fixed[:3]
            parts[0, :, :3] += fixed[:3, :3] @ cross @ cross
            parts[1, :, :3] = fixed[:3, :3] @ cross
            parts[2, :, :3] = fixed[:3, :3] @ cross @ cross
            found.append(parts.astype(Single))
        self.parts = np.stack(found)
        self.axes = np.array([joint["axis"] for joint in document["joints"]], dtype=Single)
        self.mount, self.tool = (frame(document[key])[:3].astype(Single) for key in ("mount", "tool"))
        self.spheres = spheres.link, spheres.center.astype(Single), spheres.radius.astype(Single)

    def links(self, q: Array) -> Array:
        """Rotation and origin of every link (n, 3, 4, m), and last those of the hand."""
        found = np.empty((len(q) + 1, 3, 4, q.shape[1]), dtype=Single)
        place_links(self.parts, self.mount, self.tool, np.sin(q), np.cos(q), found)
        return found

    def jacobian(self, links: Array) -> Array:
        """That of the hand (6, n, m), linear, then angular, in world axes."""
        along = np.einsum("nijm,nj->inm", links[:-1, :, :3], self.axes)
        away = links[-1, :, 3] - links[:-1, :, 3]
        return np.concatenate([crossed(along, np.moveaxis(away, 0, 1)), along])

    def nearest(self, links: Array, around: Around, places: Array) -> Array:
        """Distances (m,) to the nearest of obstacles at (k, 3)."""
        found = np.full(links.shape[-1], np.inf, dtype=Single)
        at = (places + around.middles).astype(Single)
        lower(links, *self.spheres, around.turns, around.halves, around.rounded, at, found)
        return found


@njit(fastmath=True, cache=True)
def place_links(parts: Array, mount: Array, tool: Array, sine: Array, cosine: Array, found: Array) -> None:
    """Products along the arm, posture by posture."""
    n, m = sine.shape
    for i in range(n + 1):
        for row in range(3):
            for column in range(4):
                for k in range(m):
                    sum_ = Single(0.0)
                    for j in range(3):
                        before = mount[row, j] if i == 0 else found[i - 1, row, j, k]
                        if i == n:
                            own = tool[j, column]
                        else:
                            own = parts[i, 0, j, column] + parts[i, 1, j, column] * sine[i, k]
                            own -= parts[i, 2, j, column] * cosine[i, k]
                        sum_ += before * own
                    if column == 3:
                        sum_ += mount[row, 3] if i == 0 else found[i - 1, row, 3, k]
                    found[i, row, column, k] = sum_


@njit(fastmath=True, cache=True)
def lower(
    links: Array,
    of: Array,
    centers: Array,
    radius: Array,
    turns: Array,
    halves: Array,
    rounded: Array,
    at: Array,
    found: Array,
) -> None:
    """Lower `found` to the signed distances of spheres on links from rounded boxes."""
    m, none = links.shape[3], Single(0.0)
    place = np.empty((3, m), dtype=Single)
    for s in range(len(of)):
        link = links[of[s]]
        for row in range(3):
            for k in range(m):
                place[row, k] = link[row, 3, k] + (
                    link[row, 0, k] * centers[s, 0]
                    + link[row, 1, k] * centers[s, 1]
                    + link[row, 2, k] * centers[s, 2]
                )
        for i in range(len(at)):
            size, turn, half = radius[s] + rounded[i], turns[i], halves[i]
            plain = half[0] == none and half[1] == none and half[2] == none
            for k in range(m):
                x, y, z = place[0, k] - at[i, 0], place[1, k] - at[i, 1], place[2, k] - at[i, 2]
                if plain:
                    apart = np.sqrt(x * x + y * y + z * z)
                else:
                    a = abs(turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z) - half[0]
                    b = abs(turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z) - half[1]
                    c = abs(turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z) - half[2]
                    inside = min(max(a, max(b, c)), none)
                    a, b, c = max(a, none), max(b, none), max(c, none)
                    apart = np.sqrt(a * a + b * b + c * c) + inside
                found[k] = min(found[k], apart - size)


def crossed(a: Array, b: Array) -> Array:
    """Vector products (3, …)."""
    first = a[1] * b[2] - a[2] * b[1]
    found = np.empty((3, *first.shape), dtype=first.dtype)
    found[0] = first
    found[1] = a[2] * b[0] - a[0] * b[2]
    found[2] = a[0] * b[1] - a[1] * b[0]
    return found


def astray(turn: Array, wanted: Array) -> Array:
    """By which vector (3, …) rotations have to be turned to the wanted ones: its length is the sine."""
    return 0.5 * sum(crossed(turn[:, i], wanted[:, i]) for i in range(3))


def solved(matrix: Array, right: Array) -> Array:
    """Solutions (m, …) of symmetric positive systems (m, m, …), right sides (m, …): both are overwritten."""
    if right.ndim == 1:
        return np.linalg.solve(matrix, right)
    m = len(right)
    for j in range(m - 1):
        factor = matrix[j + 1 :, j] / matrix[j, j]
        matrix[j + 1 :, j + 1 :] -= factor[:, None] * matrix[j, j + 1 :]
        right[j + 1 :] -= factor * right[j]
    for j in reversed(range(m)):
        right[j] /= matrix[j, j]
        right[:j] -= matrix[:j, j] * right[j]
    return right


class Around:
    """Obstacles as rounded boxes: a sphere has no edges, a box no radius."""

    def __init__(self, task: Task) -> None:
        turns = orientations(task)
        self.halves, self.middles = np.zeros((2, len(turns), 3))
        self.rounded = np.zeros(len(turns), dtype=Single)
        for i, solid in enumerate(task.solids):
            shape, turn = solid["shape"], turns[i].copy()
            self.rounded[i] = shape.get("radius", 0.0)
            if shape["kind"] == "box":
                self.halves[i] = 0.5 * np.array(shape["size"], dtype=float)
            elif shape["kind"] == "capsule":
                a, b = np.array(shape["a"], dtype=float), np.array(shape["b"], dtype=float)
                self.halves[i, 2], self.middles[i] = 0.5 * np.linalg.norm(b - a), turn @ (0.5 * (a + b))
                turns[i] = turn @ np.linalg.qr(np.column_stack([b - a, np.eye(3)]))[0][:, [1, 2, 0]]
            elif shape["kind"] != "sphere":
                raise ValueError(f"written for spheres, capsules and boxes, not {shape['kind']}")
        self.turns, self.halves = turns.astype(Single), self.halves.astype(Single)


class Sampling(Controller):
    """What both kinds of plans have in common: the mean of weighed plans, and a servo that follows it."""

    drawn: int  # numbers that a plan has at every instant of the horizon

    def __init__(self, task: Task, settings: Settings) -> None:
        super().__init__(task)
        arm, self.settings, self.n = task.arm, settings, task.arm.n
        self.body, self.around = Body(arm, along_capsules(arm)), Around(task)
        self.steps, self.samples = int(settings["steps"]), int(settings["samples"])
        self.grid = settings["step"] * np.arange(self.steps)
        self.ahead = np.round(self.grid / task.dt).astype(int)
        knots = np.linspace(0.0, self.grid[-1], int(settings["knots"]))
        self.spline = CubicSpline(knots, np.eye(len(knots)), bc_type="natural")(self.grid).astype(Single)
        low, high = arm.joint_limits.astype(Single).T[..., None, None]
        self.middle, self.half = 0.5 * (high + low), 0.5 * (high - low)
        self.speeds = arm.velocity_limits.astype(Single)[:, None, None]
        self.reset()

    def reset(self) -> None:
        self.rng = np.random.default_rng(0)
        self.plan = np.zeros((self.steps, self.drawn), dtype=Single)
        self.q, self.dq = self.task.q0.copy(), np.zeros(self.n)
        self.begin = 0

    def torque(self, k: int, q: Array, dq: Array) -> Array:
        every = int(self.settings["every"])
        if k % every == 0:
            self.replan(k)
        since, step = (k - self.begin) * self.task.dt, self.settings["step"]
        i = min(int(since / step), self.steps - 2)
        share = since / step - i
        before, ddq = self.q, self.follow(k, (1.0 - share) * self.plan[i] + share * self.plan[i + 1])
        speed = self.dq - ddq * self.task.dt
        wanted = ddq + 2.0 * SERVO * (speed - dq) + SERVO**2 * (before - q)
        return self.task.arm.inverse_dynamics(q, dq, wanted)

    def replan(self, k: int) -> None:
        """Move the plan on to now, draw plans around it and take their weighed mean."""
        moved = self.grid + (k - self.begin) * self.task.dt
        self.plan = np.stack([np.interp(moved, self.grid, each) for each in self.plan.T], axis=1)
        self.plan, self.begin = self.plan.astype(Single), k
        noise = np.einsum("hm,mdj->hdj", self.spline, self.noise(len(self.spline.T)))
        noise[..., 0] = 0.0  # the plan itself
        noise[..., 1] = -self.plan  # and none
        plans = self.plan[..., None] + noise
        cost = self.cost(k, plans)
        cost -= cost.min()
        tenth = max(1, len(cost) // 10)
        scale = max(float(np.partition(cost, tenth)[tenth]), 1e-9)
        weights = np.exp(-cost / (self.settings["temperature"] * scale))
        self.plan += noise @ (weights / weights.sum()).astype(Single)

    def sizes(self) -> Array:
        """A size of the noise for every plan, as a share of the largest."""
        return self.settings["finest"] ** self.rng.random(self.samples, dtype=Single)

    def cost(self, k: int, plans: Array) -> Array:
        """What every plan (steps, drawn, samples) costs (samples,)."""
        settings, task = self.settings, self.task
        q, dq, hand, apart = (np.stack(each, -2) for each in zip(*self.roll(k, plans), strict=True))
        lacking = np.maximum(1.0 - (apart - settings["margin"]) / settings["influence"], 0.0)
        each = settings["distance"] * lacking**2 + settings["collision"] * (apart < settings["margin"])
        now = np.minimum(k + self.ahead + round(settings["step"] / task.dt), task.steps)
        off = hand[:, 3] - task.place[now, :3].T[..., None].astype(Single)
        each += huber((off**2).sum(axis=0) / Single(HELD**2))
        if task.rows == 6:
            wanted = np.moveaxis(task.poses[now, :3, :3], 0, -1)[..., None].astype(Single)
            angle = astray(hand[:, :3], wanted)
            each += settings["rotation"] * huber((angle**2).sum(axis=0) / Single(TURNED**2))
        full = np.abs(q - self.middle) / self.half
        fast = np.abs(dq) / self.speeds
        over = np.maximum(full - FULL, 0.0) ** 2 + np.maximum(fast - FULL, 0.0) ** 2
        each += settings["limits"] * over.sum(axis=0)
        each += settings["speed"] * (fast**2).sum(axis=0)
        away = (q - task.q0.astype(Single)[:, None, None]) / self.half
        each += settings["posture"] * (away**2).sum(axis=0)
        total: Array = each.mean(axis=0) + settings["effort"] * self.effort(plans)
        return total

    @abstractmethod
    def noise(self, knots: int) -> Array:
        """Noise at the knots (knots, drawn, samples)."""

    @abstractmethod
    def effort(self, plans: Array) -> Array:
        """The mean square of plans (samples,), in units of their noise."""

    @abstractmethod
    def roll(self, k: int, plans: Array) -> list[tuple[Array, ...]]:
        """After every step: angles and speeds (n, samples), and what `seen` tells."""

    def seen(self, k: int, h: int, links: Array) -> tuple[Array, ...]:
        """After step `h` the hand (3, 4, samples) and the distance of the nearest obstacle (samples,)."""
        places = self.task.obstacles[k] + (self.grid[h] + self.settings["step"]) * self.task.speeds[k]
        return links[-1], self.body.nearest(links, self.around, places)

    @abstractmethod
    def follow(self, k: int, plan: Array) -> Array:
        """Move `q` and `dq` on by a millisecond; the acceleration of that."""


def huber(square: Array) -> Array:
    """As a square near nothing, as a length beyond."""
    root: Array = np.sqrt(1.0 + square)
    return root - 1.0


class InJoints(Sampling):
    """Plans are accelerations of the joints."""

    def __init__(self, task: Task, settings: Settings) -> None:
        self.drawn = task.arm.n
        super().__init__(task, settings)

    def noise(self, knots: int) -> Array:
        found = self.rng.standard_normal((knots, self.drawn, self.samples), dtype=Single)
        found *= self.settings["noise"] * self.sizes()
        return found

    def effort(self, plans: Array) -> Array:
        return (plans**2).mean(axis=(0, 1)) / self.settings["noise"] ** 2

    def roll(self, k: int, plans: Array) -> list[tuple[Array, ...]]:
        step, found = Single(self.settings["step"]), []
        q, dq = self.q.astype(Single)[:, None], self.dq.astype(Single)[:, None]
        # As it is followed: evenly from one instant to the next.
        for h, plan in enumerate(0.5 * (plans + np.concatenate([plans[1:], plans[-1:]]))):
            q = q + step * dq + (0.5 * step**2) * plan
            dq = dq + step * plan
            found.append((q, dq, *self.seen(k, h, self.body.links(q))))
        return found

    def follow(self, k: int, plan: Array) -> Array:
        dt = self.task.dt
        self.dq = self.dq + dt * plan
        self.q = self.q + dt * self.dq
        return plan


class AroundHand(Sampling):
    """Plans are accelerations of what is added to the hand's velocity, and of velocities in the null space.

    Both fade by themselves, so that a plan of nothing is the hand's law alone.
    """

    def __init__(self, task: Task, settings: Settings) -> None:
        self.rows = task.rows
        self.drawn = task.rows + task.arm.n
        self.units = np.ones(self.drawn, dtype=Single) * settings["noise"]
        self.units[:3] = settings["hand_noise"]
        self.units[3 : self.rows] = 3.0 * settings["hand_noise"]
        super().__init__(task, settings)

    def reset(self) -> None:
        super().reset()
        self.added = np.zeros(self.drawn)

    def noise(self, knots: int) -> Array:
        found = self.rng.standard_normal((knots, self.drawn, self.samples), dtype=Single)
        found *= self.units[:, None] * self.sizes()
        found[:, : self.rows, ::2] = 0.0
        return found

    def effort(self, plans: Array) -> Array:
        return ((plans / self.units[:, None]) ** 2).mean(axis=(0, 1))

    def velocity(self, jacobian: Array, towards: Array, added: Array) -> Array:
        """Of the joints (n, …), within their limits."""
        null = added[self.rows :]
        left = towards + added[: self.rows] - np.einsum("ij...,j...->i...", jacobian, null)
        square = np.einsum("ij...,kj...->ik...", jacobian, jacobian)
        for i in range(self.rows):
            square[i, i] += DAMPED
        found = null + np.einsum("ij...,i...->j...", jacobian, solved(square, left))
        limits = self.speeds[..., 0] if found.ndim == 2 else self.speeds[:, 0, 0]
        return found / np.maximum((np.abs(found) / limits).max(axis=0), 1.0)

    def law(self, k: int, hand: Array) -> Array:
        """The velocity (rows, …) that takes the hand at (3, 4, …) to its reference."""
        task, many, place = self.task, (1,) * (hand.ndim - 2), hand[:, 3]
        wanted, gain = task.poses[min(k, task.steps)], self.settings["gain"]
        off = wanted[:3, 3].reshape(3, *many) - place
        if self.rows == 6:
            turning = astray(hand[:, :3], wanted[:3, :3].reshape(3, 3, *many) * np.ones_like(place[:1]))
            off = np.concatenate([off, turning])
        twist = task.twist[min(k, task.steps), : self.rows].reshape(self.rows, *many)
        return twist + gain * off

    def roll(self, k: int, plans: Array) -> list[tuple[Array, ...]]:
        step, many = self.settings["step"], plans.shape[-1]
        q = np.repeat(self.q.astype(Single)[:, None], many, axis=1)
        added = np.repeat(self.added.astype(Single)[:, None], many, axis=1)
        links, found = self.body.links(q), []
        keep, push = Single(np.exp(-step / self.settings["fade"])), Single(step)
        for h, plan in enumerate(0.5 * (plans + np.concatenate([plans[1:], plans[-1:]]))):
            added = keep * added + push * plan
            towards = self.law(k + self.ahead[h], links[-1]).astype(Single)
            dq = self.velocity(self.body.jacobian(links)[: self.rows], towards, added)
            q = q + push * dq
            links = self.body.links(q)
            found.append((q, dq, *self.seen(k, h, links)))
        return found

    def follow(self, k: int, plan: Array) -> Array:
        arm, dt = self.task.arm, self.task.dt
        self.added = np.exp(-dt / self.settings["fade"]) * self.added + dt * plan
        towards = self.law(k, arm.tip_poses(self.q)[:3])
        dq = self.velocity(arm.jacobian(self.q)[: self.rows], towards, self.added)
        ddq: Array = (dq - self.dq) / dt
        self.dq, self.q = dq, self.q + dt * dq
        return ddq


def check(name: str) -> None:
    """End the program if the hand, its Jacobian or distances are not those of the core and the judge."""
    arm, rng = vff.Arm.named(name), np.random.default_rng(0)
    spheres = along_capsules(arm)
    body, (low, high) = Body(arm, spheres), arm.joint_limits.T
    for seed in range(6):
        task = Task(scenes.in_space("links-swept", name, "pose", scenes.TRAINING.start + seed))
        q = low + (high - low) * rng.random(arm.n)
        links = body.links(q.astype(Single)[:, None])
        poses = arm.link_poses(q)[spheres.link]
        ends = np.einsum("sij,sj->si", poses[:, :3, :3], spheres.center) + poses[:, :3, 3]
        apart = Obstacles(task.solids).distances(
            np.repeat(ends[None, :, None], 2, axis=2), spheres.radius, np.zeros(1)
        )
        found = body.nearest(links, Around(task), task.obstacles[0])
        off = [
            found[0] - apart.min(),
            links[-1][..., 0] - arm.tip_poses(q)[:3],
            body.jacobian(links)[..., 0] - arm.jacobian(q),
        ]
        worst = max(float(np.abs(each).max()) for each in off)
        if not worst <= ALLOWED:
            raise SystemExit(f"{task.scene.name}: the model is off by {worst:.1e} > {ALLOWED:.0e}")


USUAL = {
    "samples": 500,
    "steps": 30,
    "every": 20,  # ms, from plan to plan
    "step": 0.02,  # s
    "knots": 8,
    "temperature": 1.0,
    "noise": 3.0,  # rad/s²
    "finest": 1.0,
    "distance": 10.0,
    "collision": 100.0,
    "margin": 0.01,
    "influence": 0.1,
    "rotation": 1.0,
    "limits": 1000.0,
    "speed": 0.1,
    "posture": 0.01,
    "effort": 0.01,
}
SPACE = {
    "step": Range(0.02, 0.05),
    "temperature": Range(0.1, 3.0, log=True),
    "noise": Range(1.0, 30.0, log=True),
    "finest": Range(0.01, 1.0, log=True),
    "distance": Range(1.0, 100.0, log=True),
    "margin": Range(0.005, 0.05),
    "influence": Range(0.02, 0.2, log=True),
    "rotation": Range(0.3, 3.0, log=True),
    "speed": Range(0.01, 1.0, log=True),
    "effort": Range(0.001, 0.1, log=True),
}
HAND = {"step": 0.03, "noise": 10.0, "finest": 0.1, "hand_noise": 5.0, "gain": 5.0, "fade": 1.0}
HAND_SPACE = {"hand_noise": Range(1.0, 20.0, log=True), "gain": Range(1.0, 10.0, log=True)}
FEWER = {"samples": 150}
WAYS = (
    Way(
        "MPPI, usual settings",
        "accelerations of the joints, 500 plans of 30 steps of 20 ms, 50 times a second; noise of 3 rad/s², "
        "λ as far from the best plan as the best tenth, round weights",
        USUAL,
        prepare=InJoints,
        every=20,
    ),
    Way(
        "MPPI, tuned",
        "the same with the settings found on training scenes, and noise of many sizes",
        USUAL,
        SPACE,
        prepare=InJoints,
        hasty=FEWER,
        every=20,
    ),
    Way(
        "MPPI around the hand's law",
        "500 plans of how the hand deviates from a law that holds it and of how the arm moves in the null "
        "space, with settings of its own found on training scenes",
        USUAL | HAND,
        SPACE | HAND_SPACE,
        prepare=AroundHand,
        hasty=FEWER,
        every=20,
    ),
    Way(
        "MPPI around the hand's law, 6 plans",
        "the same with about as many plans as cbf's time pays for if only plans cost time",
        {"samples": 6},
        prepare=AroundHand,
        like="MPPI around the hand's law",
        every=20,
    ),
)
