"""How long a torque may be held: the bounds of docs/theory.md, T31 and T34, met from both sides."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioWarning

ARM = {"lengths": [1.0, 1.0, 1.0], "masses": 1.0}
FIELD = {"kind": "khatib", "gain": 2.0, "influence": 0.25}
REST = [0.5, -0.9, 0.7]


def pincer(damping: float) -> dict[str, Any]:
    """A three-link arm that holds its tip, its second link between two discs: one null direction, stiff."""
    joints = vff.Arm(**ARM).forward_kinematics(REST)
    middle, along = (joints[1] + joints[2]) / 2, joints[2] - joints[1]
    across = np.array([-along[1], along[0]])
    # Just within the influence distance: the field is stiff there and its force next to nothing, so that the
    # curvature of the distance, which the bound leaves out, does not count.
    gap = 0.25 - 1e-3 + 0.1
    discs = [
        {"shape": {"kind": "circle", "radius": 0.1}, "position": middle + side * gap * across}
        for side in (1.0, -1.0)
    ]
    return {
        "duration": 1.0,
        "q0": REST,
        "arm": ARM,
        "controller": {"stiffness": 50.0, "damping": 15.0, "null_damping": damping, "field": FIELD},
        "reference": {"kind": "setpoint", "point": joints[-1]},
        "obstacles": discs,
    }


def growth(scene: dict[str, Any], period: float) -> float:
    """By how much a small null motion grows in 60 periods, with an RK4 plant of ten steps each."""
    arm = vff.Arm(**ARM)
    null = np.linalg.svd(arm.jacobian(REST))[2][-1]
    times = {"dt": period / 10, "control_every": 10, "record_every": 10}
    start = {"dq0": 1e-6 * null, "duration": 60 * period, "simulation": times}
    result = vff.simulate({**scene, **start})
    speed = np.linalg.norm(result.dq, axis=1)
    return float(speed[-10:].max() / speed[:10].max())


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
@pytest.mark.parametrize("damping", [1.0, 4.0, 12.0])
def test_unstable_above_and_stable_below_the_bound(damping: float) -> None:
    scene = pincer(damping)
    controller = vff.Controller(vff.Arm(**ARM), scene["controller"])
    discs = [vff.Obstacle.circle(each["position"], 0.1) for each in scene["obstacles"]]
    period, stiffness, clearance = controller.stable_period(REST, discs)
    assert clearance == pytest.approx(0.25 - 1e-3)
    assert stiffness == pytest.approx(2.0 * (3 / clearance**4 - 2 / (0.25 * clearance**3)))
    assert growth(scene, 0.95 * period) < 1
    assert growth(scene, 1.05 * period) > 1


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
@pytest.mark.parametrize("damping", [20.0, 200.0])
def test_null_damping_alone(damping: float) -> None:
    """d h < 2, in every configuration (T31)."""
    scene = pincer(damping) | {"obstacles": []}
    controller = vff.Controller(vff.Arm(**ARM), scene["controller"])
    period, stiffness, clearance = controller.stable_period(REST)
    assert (period, stiffness, clearance) == (2 / damping, 0, np.inf)
    assert growth(scene, 0.95 * period) < 1
    assert growth(scene, 1.05 * period) > 1


def test_a_joint_limit_is_a_stiffness_too() -> None:
    arm = vff.Arm([1.0] * 4, 1.0, joint_limits=[-1.0, 1.0])
    settings = {"joint_limit_field": {"kind": "khatib", "gain": 0.1, "influence": 0.5}}
    controller = vff.Controller(arm, settings)
    assert controller.stable_period([0.0] * 4)[1] == 0
    period, stiffness, left = controller.stable_period([0.9, 0.0, 0.3, -0.2])
    assert left == pytest.approx(0.1)
    assert stiffness == pytest.approx(0.1 * (3 / 0.1**4 - 2 / (0.5 * 0.1**3)))
    assert period < 0.1


def test_a_scenario_warns_with_period_and_stiffness() -> None:
    """At the start of the pincer, and for a fast obstacle that will come near (T29)."""
    scene = pincer(1.0)
    controller = vff.Controller(vff.Arm(**ARM), scene["controller"])
    discs = [vff.Obstacle.circle(each["position"], 0.1) for each in scene["obstacles"]]
    period, stiffness, _ = controller.stable_period(REST, discs)
    over, under = 1.05 * period, 0.95 * period
    message = rf"controller\.field: .*{stiffness:.3f} N/m.*{period:.6f} s"
    with pytest.warns(ScenarioWarning, match=message):
        vff.simulate(scene, {"simulation.dt": over, "duration": 10 * over})
    assert vff.simulate(scene, {"simulation.dt": under, "duration": 10 * under}).warnings == ()
    fast = {"kind": "linear", "velocity": [0.0, -8.0]}
    with pytest.warns(ScenarioWarning, match="to be expected"):
        vff.simulate("sweep-through", {"obstacles.0.motion": fast, "duration": 0.1})
    assert vff.simulate("sweep-through", {"duration": 0.1}).warnings == ()


def test_a_controller_warns_of_gains_too_high_for_its_period() -> None:
    arm = vff.Arm.uniform(5)
    with pytest.warns(ScenarioWarning, match=r"null_damping: 300 1/s .* below 200 1/s"):
        vff.Controller(arm, {"null_damping": 300.0}, period=0.01)
    with pytest.warns(ScenarioWarning, match=r"damping: 1 1/s is too little .* above 5 1/s"):
        vff.Controller(arm, {"stiffness": 1000.0, "damping": 1.0}, period=0.01)
    vff.Controller(arm, {"null_damping": 199.0}, period=0.01)
    with pytest.raises(InputError, match="period"):
        vff.Controller(arm, {}, period=0.0)


@pytest.mark.parametrize("name", ["ur5e-sweep", "panda-sweep", "sweep-through"])
def test_a_posture_spring_that_a_held_torque_makes_unstable_is_warned_of(name: str) -> None:
    """Below the bound that it names the null space comes to rest after a push, above it does not."""
    scene: dict[str, Any] = {
        "controller.field.gain": 0.0,
        "obstacles": [],
        "controller.null_damping": 4.0,
        "simulation.integrator": "rk4",
        "simulation.record_every": 1,
        "duration": 2.0,
    }
    scenario = vff.Scenario.load(name)
    scene["controller.posture"] = scenario["q0"]
    stiff = [1e6] * len(scenario["q0"])
    with pytest.warns(ScenarioWarning, match=r"^controller\.posture_stiffness: .*swing") as caught:
        vff.simulate(scenario, {**scene, "controller.posture_stiffness": stiff, "duration": 0.01})
    found = re.search(r"stable up to (\S+) s", str(caught[0].message))
    assert found is not None
    bound = float(found[1]) * 1e6 / 1e-3  # N·m/rad, at a period of 1 ms: the bound is as its inverse
    for share, grows in ((0.7, False), (1.5, True)):
        changes = {**scene, "controller.posture_stiffness": share * bound}
        changes["dq0"] = [1e-4 * (-1) ** i for i in range(len(stiff))]
        with warnings.catch_warnings(record=True) as odd:
            warnings.simplefilter("always", ScenarioWarning)
            result = vff.simulate(scenario, changes)
        speed = np.linalg.norm(result.dq, axis=1)
        first, last = speed[500:700].max(), speed[-200:].max()  # the task has come to rest by then
        assert (last > first) == grows, (share, first, last)
        assert any("posture_stiffness" in str(each.message) for each in odd) == grows
