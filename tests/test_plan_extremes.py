"""Plans for what is nearly nothing and what is nearly endless: rests, horizons, crowds and ranges."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError

READY = np.array([0.3, -0.785, 0.2, -2.356, 0.1, 1.571, 0.785])
PANDA = {"duration": 1.0, "q0": READY.tolist(), "arm": {"model": "panda"}, "reference": {"kind": "setpoint"}}
THREE: dict[str, Any] = {
    "duration": 1.0,
    "q0": [0.3, 0.4, 0.5],
    "arm": {"lengths": [1.0, 1.0, 1.0], "masses": 1.0, "radius": 0.05},
    "reference": {"kind": "setpoint", "point": [1.0, 1.0]},
}


def disc(place: Any, velocity: Any, radius: float = 0.1) -> dict[str, Any]:
    motion = {"kind": "linear", "velocity": list(velocity)}
    return {"shape": {"kind": "circle", "radius": radius}, "position": list(place), "motion": motion}


@pytest.mark.parametrize("seed", range(4))
def test_the_rest_before_a_straight_way_is_one_to_the_last_bit(seed: int) -> None:
    """Also where a joint is so near to 0 there that a cubic ends elsewhere by rounding."""
    draw = np.random.default_rng(seed)
    goal = READY + draw.uniform(-0.35, 0.35, 7)
    joint = int(draw.choice([0, 2, 4]))
    rests = 0
    for _ in range(8):
        plan = vff.plan(PANDA, goal, approach=[0.0, 0.0, -0.06], paths=1)
        if plan.status != "found":
            break
        steps = np.abs(np.diff(plan.q, axis=0)).max(axis=1)
        (meet,) = np.flatnonzero(steps < 1e-12)
        np.testing.assert_array_equal(plan.q[meet], plan.q[meet + 1])
        _, speeds, _ = plan.at(np.linspace(plan.t[meet], plan.t[meet + 1], 9))
        assert np.abs(speeds).max() < 1e-15
        goal[joint] -= plan.q[meet][joint] - draw.uniform(-1.0, 1.0) * 1e-5
        rests += 1
    assert rests > 0
