"""Random arms, states, obstacles and fields, placed so that the fields act."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st
from numpy.typing import NDArray

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
