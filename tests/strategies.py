"""Random arms, states, obstacles and fields, placed so that the fields act."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

import oracle
import vffnull as vff

Array = NDArray[np.float64]

TWO_FORMULATIONS = ("recursive", "extended_jacobian")


def between(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


def vectors(n: int, low: float, high: float) -> st.SearchStrategy[Array]:
    return st.lists(between(low, high), min_size=n, max_size=n).map(np.array)


@dataclass(frozen=True)
class Case:
    """An arm in a state; `model` is the same arm for the oracle."""

    document: dict[str, Any]
    arm: vff.Arm
    model: oracle.Arm
    q: Array
    dq: Array

    @property
    def n(self) -> int:
        return self.arm.n

    def jacobian(self, m: int = 2) -> Array:
        """J of the position, or of the pose (the orientation is the sum of the joint angles)."""
        J = self.arm.jacobian(self.q)
        return J if m == 2 else np.vstack([J, np.ones(self.n)])

    def jacobian_dot(self, m: int = 2) -> Array:
        J_dot = self.arm.jacobian_dot(self.q, self.dq)
        return J_dot if m == 2 else np.vstack([J_dot, np.zeros(self.n)])

    def pose(self, m: int = 2) -> Array:
        tip = self.arm.forward_kinematics(self.q)[-1]
        return tip if m == 2 else np.append(tip, self.q.sum())

    def away_from_singularities(self, m: int = 2) -> None:
        """Discard the case if the smallest eigenvalue of J M⁻¹ Jᵀ is below 1/(100 · mass of the arm).

        Below a tenth of that, the law damps the task force on purpose (``controller.singularity``), and the
        error of any Λ grows as its inverse.
        """
        J = self.jacobian(m)
        mobility = np.linalg.eigvalsh(J @ np.linalg.solve(self.arm.mass_matrix(self.q), J.T))
        assume(mobility[0] > 4e-2 / self.arm.masses.sum())


@st.composite
def arms(draw: st.DrawFn, least: int = 3, most: int = 12, gravity: bool = True) -> dict[str, Any]:
    """Documents of arms of unequal links with centres of mass off their axes."""
    n = draw(st.integers(least, most))
    lengths = draw(vectors(n, 0.3, 1.5))
    along, across = draw(vectors(n, 0.1, 0.9)), draw(vectors(n, -0.2, 0.2))
    return {
        "lengths": lengths.tolist(),
        "masses": draw(vectors(n, 0.3, 4.0)).tolist(),
        "com": np.stack([along * lengths, across], axis=1).tolist(),
        "inertias": draw(vectors(n, 0.01, 0.5)).tolist(),
        "radius": draw(vectors(n, 0.0, 0.05)).tolist(),
        "gravity": draw(vectors(2, -10.0, 10.0)).tolist() if gravity else [0.0, 0.0],
    }


@st.composite
def cases(draw: st.DrawFn, least: int = 3, most: int = 12, gravity: bool = True, speed: float = 2.0) -> Case:
    """Arms in motion; every joint is bent, so that most cases are far from a stretched arm."""
    document = draw(arms(least, most, gravity))
    n = len(document["lengths"])
    bends = draw(vectors(n, 0.15, 2.0)) * draw(
        st.lists(st.sampled_from([-1.0, 1.0]), min_size=n, max_size=n).map(np.array)
    )
    bends[0] = draw(between(-3.0, 3.0))
    return Case(
        document, vff.Arm(**document), oracle.Arm.from_dict(document), bends, draw(vectors(n, -speed, speed))
    )


KINDS = ("circle", "capsule", "box", "polygon")


def solid(kind: str, place: Array, size: float, angle: float, motion: vff.Motion | None) -> vff.Obstacle:
    """An obstacle of a kind with its position at `place`, and no point farther than `size` from it."""
    match kind:
        case "circle":
            return vff.Obstacle.circle(place, size, motion)
        case "capsule":
            half = 0.6 * size * np.array([np.cos(angle), np.sin(angle)])
            return vff.Obstacle.capsule(place - half, place + half, 0.4 * size, motion)
        case "box":
            return vff.Obstacle.box(place, [1.4 * size, 0.9 * size], angle, motion)
        case _:
            corners = angle + np.array([0.0, 1.0, 2.3, 3.4, 5.0])
            ring = size * np.stack([np.cos(corners), np.sin(corners)], axis=1)
            return vff.Obstacle.polygon(place + ring - ring.mean(axis=0), motion)


@st.composite
def obstacles(
    draw: st.DrawFn,
    case: Case,
    t: float = 0.0,
    kinds: tuple[str, ...] = KINDS,
    moving: bool = True,
    most: int = 3,
) -> list[vff.Obstacle]:
    """One to three obstacles, each 0.02 to 0.6 m beside some link at time `t`."""
    joints = case.arm.forward_kinematics(case.q)
    found = []
    for _ in range(draw(st.integers(1, most))):
        link = draw(st.integers(0, case.n - 1))
        on_link = joints[link] + draw(between(0.1, 0.9)) * (joints[link + 1] - joints[link])
        along = joints[link + 1] - joints[link]
        side = draw(st.sampled_from([-1.0, 1.0])) * oracle.perp(along / np.linalg.norm(along))
        size = draw(between(0.05, 0.4))
        gap = draw(between(0.02, 0.6))
        place = on_link + (size + gap + case.arm.radius[link]) * side
        kind = draw(st.sampled_from(kinds))
        angle = draw(between(-3.0, 3.0))
        start, motion = _motion(draw, place, t) if moving else (place, None)
        found.append(solid(kind, start, size, angle, motion))
    return found


def _motion(draw: st.DrawFn, place: Array, t: float) -> tuple[Array, vff.Motion | None]:
    """A motion that passes `place` at time `t`, and the position at which it starts."""
    v = draw(vectors(2, -1.0, 1.0))
    match draw(st.sampled_from(["static", "linear", "sinusoid", "waypoints"])):
        case "linear":
            return place - t * v, vff.Motion.linear(v)
        case "sinusoid":
            w, phase = draw(between(0.1, 3.0)), draw(between(-3.0, 3.0))
            return place - v * np.sin(w * t + phase), vff.Motion.sinusoid(v, w, phase)
        case "waypoints":
            # An obstacle's polygon is placed by the mean of its corners, whose last digit may differ from
            # `start`; circles and boxes take it as it is. Static for the others.
            return place, None
        case _:
            return place, None


@st.composite
def fields(draw: st.DrawFn, approach: bool = True) -> vff.Field:
    """All three fields, with and without a floor of their own."""
    influence = draw(between(0.3, 1.5))
    gain = draw(between(0.05, 5.0))
    damping = draw(between(0.0, 1.5)) if approach else 0.0
    kind = draw(st.sampled_from(["khatib", "cubic", "bounded"]))
    if kind == "bounded":
        return vff.Field.bounded(10 * gain, influence, approach_damping=damping)
    floor = draw(st.none() | between(0.05, 0.9).map(lambda part: part * influence))
    return vff.Field(kind, gain, influence, floor, damping)


@dataclass(frozen=True)
class Scene:
    """A case with everything that a controller is asked about."""

    case: Case
    obstacles: list[vff.Obstacle]
    field: vff.Field
    gains: dict[str, Any]
    reference: tuple[Array, Array, Array]
    t: float

    def settings(self, **others: Any) -> dict[str, Any]:
        return {"field": self.field.to_dict(), **self.gains, **others}

    def terms(self, **settings: Any) -> vff.Terms:
        controller = vff.Controller(self.case.arm, self.settings(**settings))
        case, (x, dx, ddx) = self.case, self.reference
        return controller.terms(case.q, case.dq, x, dx, ddx, obstacles=self.obstacles, t=self.t)


@st.composite
def scenes(
    draw: st.DrawFn,
    m: int = 2,
    least: int = 3,
    most: int = 12,
    kinds: tuple[str, ...] = KINDS,
    approach: bool = True,
) -> Scene:
    case = draw(cases(max(least, m), most))
    case.away_from_singularities(m)
    t = draw(between(0.0, 3.0))
    gains = {
        "task": "position" if m == 2 else "pose",
        "stiffness": draw(vectors(m, 0.0, 100.0)).tolist(),
        "damping": draw(vectors(m, 0.0, 20.0)).tolist(),
        "null_damping": draw(vectors(case.n, 0.0, 8.0)).tolist(),
    }
    reference = (
        case.pose(m) + draw(vectors(m, -1.0, 1.0)),
        draw(vectors(m, -1.0, 1.0)),
        draw(vectors(m, -2.0, 2.0)),
    )
    return Scene(case, draw(obstacles(case, t, kinds)), draw(fields(approach)), gains, reference, t)


# ------------------------------------------------------------------------------------------------ in space

WIDTHS = {"position": 3, "pointing": 5, "pose": 6}
BODIES = ("sphere", "capsule", "box", "convex", "half_space")


def random_arm(rng: np.random.Generator, n: int) -> dict[str, Any]:
    """A chain of n joints that turn, with or without end, or slide; any mount, tool and gravity."""

    def frame(size: float) -> dict[str, Any]:
        return {"position": rng.uniform(-size, size, 3).tolist(), "orientation": unit(rng, 4).tolist()}

    joints = []
    for i in range(n):
        root = rng.uniform(0.05, 0.3) * rng.normal(size=(3, 3))
        second = root @ root.T + 1e-3 * np.eye(3)
        tensor = np.trace(second) * np.eye(3) - second
        joints.append(
            {
                "name": f"joint {i}",
                "link": f"link {i}",
                "kind": str(rng.choice(["revolute", "continuous", "prismatic"])),
                **frame(0.5),
                "axis": unit(rng, 3).tolist(),
                "mass": float(rng.uniform(0.3, 5.0)),
                "com": rng.uniform(-0.2, 0.2, 3).tolist(),
                "inertia": [float(tensor[k]) for k in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))],
                "armature": float(rng.choice([0.0, rng.uniform(0.0, 0.5)])),
            }
        )
    return {
        "joints": joints,
        "mount": frame(3.0),
        "tool": frame(0.3),
        "gravity": rng.uniform(-10, 10, 3).tolist(),
    }


def unit(rng: np.random.Generator, width: int) -> Array:
    """A direction, or a quaternion: any is as likely as any other, and none is parallel to another one."""
    values = rng.normal(size=width)
    return values / np.linalg.norm(values)


def turn(quaternion: Array) -> Array:
    """The rotation matrix of a unit quaternion [w, x, y, z]."""
    w, x, y, z = quaternion
    return Rotation.from_quat([x, y, z, w]).as_matrix()


def product(p: ArrayLike, q: ArrayLike) -> Array:
    """The quaternion of one turn after another: q, then p."""
    x, y, z, w = (Rotation.from_quat(np.roll(p, -1)) * Rotation.from_quat(np.roll(q, -1))).as_quat()
    return np.array([w, x, y, z])


def written_in_space(arm: vff.Arm) -> dict[str, Any]:
    """A planar arm with its axes along z; masses may lie anywhere along z."""
    at, joints, collision = 0.0, [], []
    for i in range(arm.n):
        x, y = arm.com[i]
        inertia, length, radius = float(arm.inertias[i]), float(arm.lengths[i]), float(arm.radius[i])
        joints.append(
            {
                "name": f"joint_{i + 1}",
                "link": f"link_{i + 1}",
                "kind": "continuous",
                "position": [at, 0.0, 0.0],
                "mass": float(arm.masses[i]),
                "com": [float(x), float(y), 0.2],
                "inertia": [inertia + 1.0, inertia + 1.0, inertia, 0.0, 0.0, 0.0],
            }
        )
        if radius > 0.0:
            shape = {"kind": "capsule", "a": [0.0] * 3, "b": [length, 0.0, 0.0], "radius": radius}
            collision.append({"link": f"link_{i + 1}", "shape": shape})
        at = length
    return {
        "joints": joints,
        "tool": {"position": [at, 0.0, 0.0]},
        "gravity": [*map(float, arm.gravity), -3.0],
        "collision": collision,
    }


def raised(obstacle: dict[str, Any]) -> dict[str, Any]:
    """A circle, capsule or box as a body of space that the plane z = 0 cuts in just that shape."""
    shape, angle = dict(obstacle["shape"]), obstacle.get("angle", 0.0)
    match shape["kind"]:
        case "circle":
            shape["kind"] = "sphere"
        case "capsule":
            shape |= {end: [*shape[end], 0.0] for end in ("a", "b")}
        case "box":
            shape["size"] = [*shape["size"], 100.0]
    motion = {
        key: [*value, 0.0] if isinstance(value, list) else value
        for key, value in obstacle.get("motion", {"kind": "static"}).items()
    }
    return {
        "shape": shape,
        "position": [*obstacle["position"], 0.0],
        "orientation": [float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))],
        "motion": motion,
    }


@dataclass(frozen=True)
class SpatialCase:
    """An arm in space in a state, with one of the tasks of `WIDTHS`."""

    document: dict[str, Any]
    arm: vff.Arm
    task: str
    q: Array
    dq: Array

    def moved(self, q: Array, dq: Array) -> SpatialCase:
        """The same in another state."""
        return replace(self, q=q, dq=dq)

    @property
    def m(self) -> int:
        return WIDTHS[self.task]

    @property
    def n(self) -> int:
        return self.arm.n

    def jacobian(self) -> Array:
        """J of the task: linear rows, and the angular ones about the world's axes or the tool's x and y."""
        J = self.arm.jacobian(self.q)
        match self.task:
            case "position":
                return J[:3]
            case "pointing":
                return np.vstack([J[:3], self._across() @ J[3:]])
            case _:
                return J

    def bias(self) -> Array:
        """J̇ q̇ of the task; the axes of a tool turn with it."""
        rate = self.arm.jacobian_dot(self.q, self.dq) @ self.dq
        match self.task:
            case "position":
                return rate[:3]
            case "pointing":
                spin = self.arm.jacobian(self.q)[3:] @ self.dq
                across = self._across()
                return np.append(rate[:3], across @ rate[3:] + np.cross(spin, across) @ spin)
            case _:
                return rate

    def _across(self) -> Array:
        """The tool's x and y axes, one below the other."""
        return turn(self.arm.pose(self.q)[1]).T[:2]

    def scale(self, length: float) -> Array:
        """What makes a velocity of the task one of metres alone: an angle is an arc at this radius."""
        return np.array([1.0] * 3 + [length] * (self.m - 3))

    def mobility(self, length: float) -> Array:
        """J M⁻¹ Jᵀ with angles as arcs."""
        J = self.scale(length)[:, None] * self.jacobian()
        return J @ np.linalg.solve(self.arm.mass_matrix(self.q), J.T)

    def away_from_singularities(self, length: float) -> None:
        """As `Case.away_from_singularities`."""
        assume(np.linalg.eigvalsh(self.mobility(length))[0] > 4e-2 / self.arm.masses.sum())

    def bodies(self) -> Iterator[tuple[Array, Array, float]]:
        """Ends and radius of every capsule of the arm, in the world."""
        frames = dict(zip(self.arm.link_names, self.arm.link_poses(self.q), strict=True))
        for link, shape in self.arm.collision:
            a, b = (frames[link][:3, :3] @ shape[end] + frames[link][:3, 3] for end in ("a", "b"))
            yield a, b, shape["radius"]


@st.composite
def spatial_cases(draw: st.DrawFn, task: str, spare: int = 1, most: int = 12) -> SpatialCase:
    """Arms in motion with at least `spare` joints more than their task needs."""
    n = draw(st.integers(WIDTHS[task] + spare, most))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    document = random_arm(rng, n)
    ends = [joint["position"] for joint in document["joints"][1:]] + [document["tool"]["position"]]
    document["collision"] = [
        {
            "link": joint["link"],
            "shape": {"kind": "capsule", "a": [0.0] * 3, "b": end, "radius": float(rng.uniform(0.02, 0.06))},
        }
        for joint, end in zip(document["joints"], ends, strict=True)
    ]
    q, dq = rng.uniform(-2.0, 2.0, n), draw(vectors(n, -2.0, 2.0))
    return SpatialCase(document, vff.Arm._from_dict(document), task, q, dq)


@st.composite
def bodies(draw: st.DrawFn, case: SpatialCase, t: float) -> list[vff.Obstacle]:
    """One to three obstacles, each 0.02 to 0.6 m beside the arm at time `t`."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rods = list(case.bodies())
    found = []
    for _ in range(draw(st.integers(1, 3))):
        kind, gap, size = draw(st.sampled_from(BODIES)), draw(between(0.02, 0.6)), draw(between(0.05, 0.4))
        out = unit(rng, 3)
        a, b, radius = rods[draw(st.integers(0, len(rods) - 1))]
        if kind == "half_space":  # beside all of the arm
            place = (max(max(out @ a, out @ b) + radius for a, b, radius in rods) + gap) * out
        else:
            out -= (out @ (b - a)) * (b - a) / ((b - a) @ (b - a))
            out /= np.linalg.norm(out)
            place = a + rng.uniform(0.1, 0.9) * (b - a) + (radius + gap + size) * out
        v = draw(vectors(3, -1.0, 1.0))
        start, motion = draw(
            st.sampled_from(
                [
                    (place, None),
                    (place - t * v, vff.Motion.linear(v)),
                    (place - v * np.sin(2.0 * t), vff.Motion.sinusoid(v, 2.0)),
                ]
            )
        )
        found.append(body(kind, start, size, -out, unit(rng, 4), motion))
    return found


def body(
    kind: str, place: Array, size: float, normal: Array, orientation: Array, motion: vff.Motion | None
) -> vff.Obstacle:
    """An obstacle of a kind with its position at `place`, and no point of it farther than `size` from it."""
    match kind:
        case "sphere":
            return vff.Obstacle.sphere(place, size, motion)
        case "capsule":
            half = 0.6 * size * turn(orientation)[:, 0]
            return vff.Obstacle.capsule(place - half, place + half, 0.4 * size, motion)
        case "box":
            edges = size * np.array([1.2, 0.9, 0.6])
            spin = 3.0 * orientation[1:]
            return vff.Obstacle.box(
                place, edges, motion=motion, orientation=orientation, angular_velocity=spin
            )
        case "convex":
            corners = (
                0.9 * size * np.array([[1.0, 0.0, 0.0], [-0.6, 0.7, 0.0], [-0.6, -0.7, 0.2], [0.2, 0.0, 0.9]])
            )
            vertices = place + (corners - corners.mean(axis=0)) @ turn(orientation).T
            return vff.Obstacle.convex(vertices, motion, angular_velocity=-orientation[1:])
        case _:
            return vff.Obstacle.half_space(place, normal, motion)


@dataclass(frozen=True)
class SpatialScene:
    """A case with everything that a controller is asked about; angles count as arcs at `length`."""

    case: SpatialCase
    obstacles: list[vff.Obstacle]
    field: vff.Field
    gains: dict[str, Any]
    position: Array
    orientation: Array
    dx: Array
    ddx: Array
    length: float
    t: float

    def turned(self, rotation: Array, shift: Array) -> SpatialScene:
        """The same elsewhere: robot, gravity, obstacles and reference turned about the origin and moved."""
        case, R = self.case, turn(rotation)

        def frame(place: Mapping[str, Any]) -> dict[str, Any]:
            return {
                "position": (R @ place["position"] + shift).tolist(),
                "orientation": product(rotation, place.get("orientation", [1.0, 0.0, 0.0, 0.0])).tolist(),
            }

        document = case.document | {
            "mount": frame(case.document["mount"]),
            "gravity": (R @ case.document["gravity"]).tolist(),
        }
        moved: list[Any] = []
        for solid in (each.to_dict() for each in self.obstacles):
            motion = {
                key: (R @ value).tolist() if key in ("velocity", "amplitude") else value
                for key, value in solid.get("motion", {"kind": "static"}).items()
            }
            spin = R @ solid.get("angular_velocity", np.zeros(3))
            moved.append(solid | frame(solid) | {"motion": motion, "angular_velocity": spin.tolist()})
        both_rows = np.kron(np.eye(2), R)
        return replace(
            self,
            case=replace(case, document=document, arm=vff.Arm._from_dict(document)),
            obstacles=moved,
            position=R @ self.position + shift,
            orientation=product(rotation, self.orientation),
            dx=both_rows @ self.dx,
            ddx=both_rows @ self.ddx,
        )

    def terms(self, **settings: Any) -> vff.Terms:
        """What the controller of the case makes of it."""
        case, task = self.case, {"task": self.case.task, "characteristic_length": self.length}
        document = {"field": self.field.to_dict(), **task, **self.gains, **settings}
        controller = vff.Controller(case.arm, document)
        width = 3 if case.task == "position" else 6
        x_ref = self.position if width == 3 else np.append(self.position, self.orientation)
        motion = (self.dx[:width], self.ddx[:width])
        return controller.terms(case.q, case.dq, x_ref, *motion, obstacles=self.obstacles, t=self.t)

    def commanded(self) -> Array:
        """ẍ_r − D ė − K e in the rows of J: (T9), with (T91), (T104) and (T105) for what turns."""
        case, m = self.case, self.case.m
        velocity = case.arm.jacobian(case.q) @ case.dq
        here, orientation = case.arm.pose(case.q)
        e, de, ddx = here - self.position, velocity[:3] - self.dx[:3], self.ddx[:3]
        R, R_r = turn(orientation), turn(self.orientation)
        omega, omega_r, alpha_r = velocity[3:], self.dx[3:], self.ddx[3:]
        if case.task == "pose":
            phi = Rotation.from_matrix(R @ R_r.T).as_rotvec()
            angle = np.linalg.norm(phi)
            e = np.append(e, 2 * np.sin(angle / 2) * phi / angle)
            de = np.append(de, omega - omega_r)
            ddx = np.append(ddx, alpha_r + np.cross(omega_r, omega))
        elif case.task == "pointing":
            z, u = np.array([0.0, 0.0, 1.0]), R.T @ R_r[:, 2]
            axis = R_r[:, 2]
            rho = R.T @ (omega_r - (omega_r @ axis) * axis)
            turned = alpha_r - (alpha_r @ axis) * axis + (omega_r @ axis) * np.cross(axis, omega_r)
            w = R.T @ omega
            n = np.cross(u, z)
            angle = np.arctan2(np.linalg.norm(n), u[2])
            rate = R.T @ turned + (2 * rho[2] - w[2]) * np.cross(z, w) - rho[2] * np.cross(z, rho)
            e = np.append(e, (2 * np.sin(angle / 2) * n / np.linalg.norm(n))[:2])
            de = np.append(de, (w - rho)[:2])
            ddx = np.append(ddx, rate[:2])
        gains = (np.broadcast_to(self.gains[name], m) for name in ("damping", "stiffness"))
        D, K = gains
        return ddx - D * de - K * e


@st.composite
def spatial_scenes(
    draw: st.DrawFn, task: str, spare: int = 1, most: int = 12, uniform: bool = False, approach: bool = True
) -> SpatialScene:
    """A case with obstacles, a field, a reference nearby, and gains per axis, or `uniform` ones."""
    case = draw(spatial_cases(task, spare, most))
    length, t = draw(between(0.1, 0.6)), draw(between(0.0, 3.0))
    case.away_from_singularities(length)
    m = 1 if uniform else case.m
    gains = {
        "stiffness": draw(vectors(m, 0.0, 100.0)),
        "damping": draw(vectors(m, 0.0, 20.0)),
        "null_damping": draw(vectors(case.n, 0.0, 8.0)),
    }
    gains = {name: float(value[0]) if len(value) == 1 else value.tolist() for name, value in gains.items()}
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    position, orientation = case.arm.pose(case.q)
    tilt = np.append(1.0, draw(between(0.01, 2.0)) * unit(rng, 3))
    return SpatialScene(
        case,
        draw(bodies(case, t)),
        draw(fields(approach)),
        gains,
        position + draw(vectors(3, -1.0, 1.0)),
        product(tilt / np.linalg.norm(tilt), orientation),
        draw(vectors(6, -1.0, 1.0)),
        draw(vectors(6, -2.0, 2.0)),
        length,
        t,
    )


def assert_passive(
    scene: Scene | SpatialScene, tau_ext: Array, jacobian: Callable[[Array, Array], Array]
) -> None:
    """The null space stores energy at the rate νᵀZᵀ(τ_ext + τ_vff) − νᵀD_nν; `jacobian` is J of (q, q̇).

    V_n = ½q̇ᵀMq̇ − ½ẋᵀΛẋ needs no basis; Zν = N q̇ and D_q = √d M √d.
    """
    case, terms = scene.case, scene.terms()
    ddq = case.arm.forward_dynamics(case.q, case.dq, terms.tau + tau_ext)

    def stored(h: float) -> float:
        q, dq = case.q + h * case.dq + h * h / 2 * ddq, case.dq + h * ddq
        M, J = case.arm.mass_matrix(q), jacobian(q, dq)
        dx = J @ dq
        return float(dq @ M @ dq - dx @ np.linalg.solve(J @ np.linalg.solve(M, J.T), dx)) / 2

    # A step that changes the state by 1e-4 at most, whatever the accelerations.
    h = 1e-4 / (1 + np.abs(case.dq).max() + np.abs(ddq).max())
    rate = (8 * (stored(h) - stored(-h)) - (stored(2 * h) - stored(-2 * h))) / (12 * h)
    inner = terms.N @ case.dq
    damped = np.sqrt(np.array(scene.gains["null_damping"])) * inner
    lost = damped @ case.arm.mass_matrix(case.q) @ damped
    fed = inner @ (tau_ext + terms.tau_vff)
    scale = abs(lost) + abs(fed) + np.linalg.norm(inner) * np.linalg.norm(terms.tau) + stored(0.0) / h * 1e-12
    assert rate == pytest.approx(fed - lost, abs=1e-6 * (scale + 1))
