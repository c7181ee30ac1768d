"""Joints that slide without end switches: what an arm does has nothing to do with how far they go."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff

ENDS = (5.0, 1e9, np.inf)
Q0 = [0.0, 0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


def on_a_cart(end: float) -> dict[str, Any]:
    """The bundled Panda on a cart that goes so far to either side."""
    document = vff.Arm.named("panda").to_dict()
    cart = {
        "name": "x",
        "link": "cart",
        "kind": "prismatic",
        "axis": [1.0, 0.0, 0.0],
        "mass": 60.0,
        "com": [0.0, 0.0, 0.0],
        "inertia": [2.0, 2.0, 2.0, 0.0, 0.0, 0.0],
    }
    document["joints"] = [cart, *document["joints"]]
    for key, first in (("joint_limits", [-end, end]), ("velocity_limits", 1.5), ("torque_limits", 1500.0)):
        document[key] = [first, *document[key]]
    return document


def scenario(end: float, **changes: Any) -> dict[str, Any]:
    controller = {"task": "pose", "stiffness": 225.0, "damping": 30.0, "null_damping": 6.0}
    return {
        "arm": on_a_cart(end),
        "q0": Q0,
        "duration": 3.0,
        "reference": {"kind": "setpoint"},
        "controller": controller,
        "simulation": {"control": "hold", "integrator": "semi_implicit_euler"},
    } | changes


@pytest.mark.parametrize("end", ENDS)
def test_barriers_keep_a_pose_away(end: float) -> None:
    """A ball comes through the hand, which gives way as it does where the cart has ends."""
    x = vff.Arm.named("panda").pose(Q0[1:])[0]
    ball = {
        "shape": {"kind": "sphere", "radius": 0.3},
        "position": [x[0], x[1] + 0.9, x[2]],
        "motion": {"kind": "linear", "velocity": [0.0, -0.3, 0.0]},
    }
    document = scenario(end, obstacles=[ball])
    document["controller"] |= {
        "avoidance": "cbf",
        "field": {"kind": "bounded", "gain": 80.0, "influence": 0.25},
    }
    result = vff.simulate(document)
    assert result.status == "completed" and result.metrics.min_clearance > 0.015
    document["arm"] = on_a_cart(ENDS[0])
    np.testing.assert_allclose(result.x, vff.simulate(document).x, atol=1e-9)


@pytest.mark.parametrize("end", ENDS)
def test_a_cart_goes_a_metre(end: float) -> None:
    line = {"kind": "line", "end": [1.0, 0.0, 0.0], "duration": 3.0, "relative": True}
    assert vff.simulate(scenario(end, reference=line)).status == "completed"


def test_the_length_that_was_set_is_searched_with() -> None:
    """Where angles count for all, positions are not found any more: it is the setting that is looked at."""
    reference = {"kind": "line", "end": [0.3, 0.0, 0.0], "duration": 3.0, "relative": True}
    assert vff.simulate(scenario(5.0, reference=reference)).status == "completed"
    document = scenario(5.0, reference=reference)
    document["controller"]["characteristic_length"] = 1e12
    with pytest.raises(vff.errors.ScenarioError, match="cannot be reached"):
        vff.simulate(document)


@pytest.mark.parametrize("end", ENDS)
def test_an_agent_sees_numbers(end: float) -> None:
    """Bounds say how far the cart comes in the scenario, and the error is a number, too."""
    gym = pytest.importorskip("vffnull.engines.gym")
    ball = {"shape": {"kind": "sphere", "radius": 0.1}, "position": [3.0, 3.0, 3.0]}
    env = gym.ReachEnv(scenario(end, obstacles=[ball]))
    assert np.all(env.observation_space.high <= 200.0)
    assert env.observation_space.high[env.layout["slide"]][0] >= 2.0 * min(end, 4.5)
    observation, info = env.reset(seed=1)
    _, reward, *_ = env.step(np.zeros(8))
    assert env.observation_space.contains(observation)
    assert np.isfinite(info["tracking_error"]) and np.isfinite(reward)
