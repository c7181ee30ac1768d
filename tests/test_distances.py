"""Distances of all pairs with their derivatives, against the true distance along a motion."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from differences import smooth_pairs

Array = NDArray[np.float64]

ARM = vff.Arm([0.9, 0.7, 0.8, 0.5], 1.0, radius=[0.05, 0.04, 0.03, 0.02])
OBSTACLES = [
    vff.Obstacle.circle([1.2, 1.5], 0.3, motion=vff.Motion.sinusoid([0.4, -0.2], 1.7, phase=0.4)),
    vff.Obstacle.capsule([2.6, 0.2], [3.0, 1.1], 0.15, motion=vff.Motion.linear([-0.5, 0.3])),
    vff.Obstacle.box([0.4, -1.2], [0.8, 0.5], 0.4),
    vff.Obstacle.polygon(
        [[1.5, -1.0], [2.5, -0.75], [2.0, -0.5]],
        motion=vff.Motion.waypoints([0.0, 2.0], [[2.0, -0.75], [2.2, -0.2]]),
    ),
]


def test_derivatives_along_random_motions() -> None:
    """Beside every shape; a kink is rare."""
    rng = np.random.default_rng(5)
    smooth = np.zeros(len(OBSTACLES), dtype=int)
    states = 400
    for _ in range(states):
        q, dq, ddq = (rng.uniform(-2, 2, ARM.n) for _ in range(3))
        smooth += smooth_pairs(ARM, OBSTACLES, q, dq, ddq, float(rng.uniform(0.1, 1.9)))
    assert np.all(smooth > 0.9 * states * ARM.n)


def test_gradient_and_geometry() -> None:
    """The gradient is ∂d/∂q; point, normal and witness lie on one line; as the controller sees it."""
    rng = np.random.default_rng(6)
    h = 1e-6
    for _ in range(50):
        q = rng.uniform(-2, 2, ARM.n)
        now = vff.distances(ARM, q, np.zeros(ARM.n), OBSTACLES)
        for k in range(ARM.n):
            shift = h * np.eye(ARM.n)[k]
            after, before = (vff.distances(ARM, q + s, 0 * q, OBSTACLES).distance for s in (shift, -shift))
            kink = np.abs(after + before - 2 * now.distance) > 1e-3 * h
            slope = (after - before) / (2 * h)
            assert np.all((np.abs(slope - now.gradient[:, k]) < 1e-6) | kink)
        radius = ARM.radius[now.link]
        ends = now.witness + now.normal * (now.distance + radius)[:, None]
        assert np.abs(ends - now.point).max() < 1e-14
        assert np.abs(np.linalg.norm(now.normal, axis=1) - 1).max() < 1e-14
        terms = vff.Controller(ARM, {}).terms(q, 0 * q, [1.0, 1.0], obstacles=OBSTACLES)
        least = now.distance.reshape(ARM.n, len(OBSTACLES)).min(axis=1)
        assert np.array_equal(least, terms.clearance)


def test_batch_is_the_same_as_one_by_one() -> None:
    rng = np.random.default_rng(7)
    q, dq = rng.uniform(-2, 2, (2, 9, ARM.n))
    t = rng.uniform(0, 2, 9)
    many = vff.distances(ARM, q, dq, OBSTACLES, t)
    pairs = ARM.n * len(OBSTACLES)
    assert many.link.shape == many.obstacle.shape == (pairs,)
    assert many.gradient.shape == (9, pairs, ARM.n)
    assert many.normal.shape == many.point.shape == many.witness.shape == (9, pairs, 2)
    for b in range(9):
        one = vff.distances(ARM, q[b], dq[b], OBSTACLES, t[b])
        for name in ("distance", "gradient", "rate", "bias", "normal", "point", "witness"):
            assert np.array_equal(getattr(many, name)[b], getattr(one, name)), name
    still = vff.distances(ARM, q, dq, OBSTACLES, t=0.5)
    assert np.array_equal(still.rate[3], vff.distances(ARM, q[3], dq[3], OBSTACLES, 0.5).rate)


def test_no_obstacles_no_pairs() -> None:
    none = vff.distances(ARM, np.zeros(4), np.zeros(4), [])
    assert none.distance.shape == (0,) and none.gradient.shape == (0, 4)


@pytest.mark.parametrize(
    ("q", "dq", "t", "message"),
    [
        ([0.0] * 3, [0.0] * 3, 0.0, "q: expected shape"),
        ([0.0] * 4, [0.0] * 3, 0.0, "dq: expected shape"),
        ([0.0] * 4, [0.0] * 4, [0.0, 1.0], "t: expected shape"),
        ([0.0, 0.0, float("nan"), 0.0], [0.0] * 4, 0.0, "q.2. must be finite"),
    ],
)
def test_wrong_input_is_named(q: list[float], dq: list[float], t: float, message: str) -> None:
    with pytest.raises(vff.errors.InputError, match=message):
        vff.distances(ARM, q, dq, OBSTACLES, t)
