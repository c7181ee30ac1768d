"""What a plan may use of torques, and what it says where that is too little."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError

SHARE = 0.8  # of the limits, for what is planned


def swing(start: float, limit: float) -> dict[str, Any]:
    """One heavy link under gravity, with a light one."""
    return {
        "duration": 1.0,
        "q0": [start, 0.0],
        "arm": {"lengths": [1.0, 0.2], "masses": 1.0, "gravity": 9.81, "torque_limits": [limit, 50.0]},
        "reference": {"kind": "setpoint", "point": [1.0, 0.0]},
    }


@pytest.mark.parametrize("seed", range(60))
def test_what_can_be_held_is_found_and_what_cannot_is_too_heavy(seed: int) -> None:
    """Around 80 % of the limit, where nothing stands in the way; and what is found keeps it."""
    draw = np.random.default_rng(seed).uniform
    start, goal = draw(-3.0, 3.0, 2)
    arm = vff.Scenario.from_dict(swing(start, 1.0)).arm
    held = max(abs(arm.gravity_torque([q, 0.0])[0]) for q in np.linspace(start, goal, 500))
    share = draw(0.85, 1.15)
    limit = held / (SHARE * share)
    plan = vff.plan(swing(start, limit), [goal, 0.0])
    if share > 1.0:
        assert plan.status == "too heavy"
        return
    assert plan.status == "found", plan.message
    arm = vff.Scenario.from_dict(swing(start, limit)).arm
    times = np.linspace(0.0, plan.duration, 1000)
    torques = [arm.inverse_dynamics(*(each[0] for each in plan.at([t]))) for t in times]
    assert np.abs(torques)[:, 0].max() < 1.003 * SHARE * limit


def test_a_load_that_is_just_too_heavy_is_said_to_be() -> None:
    start, goal = [0.0, -0.9, 0.6, -1.2, -1.57, 0.0], [1.2, 0.3, -0.2, -1.2, -1.57, 0.0]
    for mass, status in ((6.9, "found"), (7.0, "too heavy"), (7.2, "too heavy")):
        arm = {"model": "ur5e", "load": {"mass": mass, "com": [0.0, 0.0, 0.05]}}
        scene = {"duration": 1.0, "q0": start, "arm": arm, "reference": {"kind": "setpoint"}}
        plan = vff.plan(scene, goal)
        assert plan.status == status, plan.message
        assert (status == "found") or "`shoulder_lift_joint` would have to hold 120" in plan.message


def test_the_limit_that_makes_it_longer_than_an_hour_is_named() -> None:
    scene = {
        "duration": 1.0,
        "q0": [0.0, 0.0, 0.0],
        "arm": {"lengths": [0.5] * 3, "masses": 1.0},
        "reference": {"kind": "setpoint", "point": [1.0, 0.5]},
    }
    named = set()
    for acceleration in np.geomspace(1.85e-7, 2.0e-7, 40):
        try:
            vff.plan(scene, [0.3, 0.2, -0.1], acceleration=acceleration)
        except ScenarioError as error:
            named.add(str(error).split(":")[0])
            assert "4e3" not in str(error)
    assert named == {"acceleration"}


def test_samples_are_those_that_were_drawn() -> None:
    """Where trials with other margins have failed as well."""
    walls = [([0.02, 3.0], [-0.06, 0.0]), ([3.0, 0.02], [0.0, -0.1])]
    scene = {
        "duration": 1.0,
        "q0": [0.3, 0.2, 0.1],
        "arm": {"lengths": [0.5] * 3, "masses": 1.0, "radius": 0.02},
        "reference": {"kind": "setpoint", "point": [1.0, 0.0]},
        "obstacles": [
            {"shape": {"kind": "circle", "radius": 0.1}, "position": [0.6, 0.42]},
            *({"shape": {"kind": "box", "size": size}, "position": place} for size, place in walls),
        ],
    }
    plan = vff.plan(scene, [1.4, 0.2, 0.1], samples=2000, margin=0.1)
    assert plan.status == "not found"
    assert f"after {plan.samples} samples" in plan.message
    assert plan.samples == 2000
