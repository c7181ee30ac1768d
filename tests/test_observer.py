"""Torques that the model does not know are estimated, and rejected where asked (T141, T142)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff

REJECT = {"task": "reject", "null_space": "reject"}
OBSERVED = {"controller.observer": {}, "simulation.control": "hold"}
REJECTED = OBSERVED | {"controller.touch": REJECT}
KILOGRAM = {"plant.payload": {"mass": 1.0}}
GRAVITY = 9.81
Q0 = np.array([0.3, 0.9, -0.6])
LENGTHS = np.array([1.0, 0.8, 0.6])
START = [float(LENGTHS @ turn(np.cumsum(Q0))) for turn in (np.cos, np.sin)]


def held(**more: Any) -> vff.Scenario:
    """A planar arm that holds its tip still under gravity, with 0.4 kg in its hand."""
    return vff.Scenario.from_dict(
        {
            "duration": 3.0,
            "q0": list(Q0),
            "arm": {"lengths": list(LENGTHS), "masses": [2.0, 1.5, 1.0], "gravity": [0.0, -GRAVITY]},
            "reference": {"kind": "setpoint", "point": START},
            "controller": {
                "stiffness": 100.0,
                "damping": 20.0,
                "null_damping": 4.0,
                "observer": {"bandwidth": 100.0},
            },
            "simulation": {"control": "hold"},
            "plant": {"payload": 0.4},
            **more,
        }
    )


def weight_at_tip(q: np.ndarray, mass: float) -> np.ndarray:
    """Torques of a weight at the tip: −m g times how far the tip is to the right of each joint."""
    ends = np.cumsum(LENGTHS * np.cos(np.cumsum(q)))
    return -mass * GRAVITY * (ends[-1] - np.array([0.0, ends[0], ends[1]]))


def test_at_rest_the_estimate_is_the_weight() -> None:
    """Complying, the arm sags by the weight over its stiffness; rejecting, it does not."""
    complying = vff.simulate(held())
    assert complying.tau_ext_estimate is not None
    assert np.abs(complying.dq[-1]).max() < 1e-3
    np.testing.assert_allclose(complying.tau_ext_estimate[-1], weight_at_tip(complying.q[-1], 0.4), atol=0.01)
    control = held().to_dict()["controller"]
    rejecting = vff.simulate(held(controller=control | {"touch": REJECT}))
    assert complying.metrics["end_error"] > 5e-3
    assert rejecting.metrics["end_error"] < 1e-5


def test_the_hand_and_the_null_space_are_asked_apart() -> None:
    """With the task alone the hand stays; the links below it yield as without an observer's answer."""
    control = held().to_dict()["controller"]
    heavier = {"masses": [2.0, 2.5, 1.0]}  # a weight at the tip alone would not pull at the null space
    runs = {
        (task, null): vff.simulate(
            held(controller=control | {"touch": {"task": task, "null_space": null}}, plant=heavier)
        )
        for task in ("comply", "reject")
        for null in ("comply", "reject")
    }
    error = {key: run.metrics["end_error"] for key, run in runs.items()}
    assert max(error["reject", null] for null in ("comply", "reject")) < 0.02 * error["comply", "comply"]
    assert error["comply", "reject"] > 5e-3
    # Damping alone holds the null space: it drifts under the weight, unless that is rejected.
    drift = {key: np.abs(run.q[-1] - run.q[0]).max() for key, run in runs.items()}
    assert drift["reject", "comply"] > 10 * drift["reject", "reject"]


def test_without_a_disturbance_there_is_no_estimate() -> None:
    """An exact model, integrated exactly: what is left is the error of a sampled observer."""
    keys = {"simulation.control": "hold", "simulation.integrator": "rk4"}
    result = vff.simulate("gen3-circle", OBSERVED | keys)
    assert result.tau_ext_estimate is not None
    assert np.abs(result.tau_ext_estimate).max() < 1e-4
    without = vff.simulate("gen3-circle", keys)
    assert without.tau_ext_estimate is None
    assert np.abs(result.q - without.q).max() < 1e-12  # complying in the null-space law changes nothing


@pytest.mark.parametrize("rate", [None, 1000.0])
@pytest.mark.parametrize("name", ["panda-sweep", "panda-shelf", "ur5e-crossed"])
def test_a_kilogram_that_nobody_knows(name: str, rate: float | None) -> None:
    """The hand comes to where it comes without that load, and neither a speed nor a distance suffers."""
    behind: dict[str, Any] = {"controller.command.torque_rate": rate} if rate else {}
    keys = {"controller.avoidance": "cbf", "simulation.control": "hold"} | behind
    ideal = vff.simulate(name, keys).metrics
    loaded = vff.simulate(name, keys | KILOGRAM).metrics
    rejected = vff.simulate(name, keys | KILOGRAM | REJECTED).metrics
    assert loaded["end_error"] > 3e-3
    assert rejected["end_error"] < 1e-4
    assert rejected["min_clearance"] > ideal["min_clearance"] - 1e-3
    assert rejected["velocity_limit_ratio"] < 1.0


def test_speeds_are_kept_with_a_load_behind_a_rate() -> None:
    """An arm that swings between its speed limits in a crowd: 1.5 times a limit without the observer."""
    keys = {"controller.avoidance": "cbf", "controller.command.torque_rate": 1000.0} | KILOGRAM
    loaded = vff.simulate("iiwa-crowd", keys | {"simulation.control": "hold"})
    rejected = vff.simulate("iiwa-crowd", keys | REJECTED | {"controller.observer.bandwidth": 150.0})
    assert loaded.metrics["velocity_limit_ratio"] > 1.3
    assert rejected.metrics["velocity_limit_ratio"] < 1.02
    assert rejected.metrics["collision_time"] is None


@pytest.mark.parametrize(
    "more",
    [
        {"simulation.control": "predictor"},
        {"simulation.control_every": 4},
        {"measurement.velocity_noise": 0.002, "measurement.position_noise": 1e-5},
        {"measurement.delay": 0.002},
        {"plant.coulomb_friction": 0.5, "plant.viscous_friction": 0.5},
        {"controller.command.gravity": "robot"},
        {"controller.command.coulomb_friction": 0.4, "plant.coulomb_friction": 0.5},
        {"actuator.time_constant": 0.002},
        {"controller.formulation": "extended_jacobian"},
        {"wrenches": [{"link": "panda_link4", "force": [0.0, 10.0, 0.0]}]},
        {"wrenches": [{"link": "tip", "force": [3.0, 0.0, 4.0], "torque": [0.3, 0.0, 0.0]}]},
    ],
    ids=lambda more: ",".join(more),
)
def test_together_with_others(more: dict[str, Any]) -> None:
    """Sensors, drives, friction, periods of several steps: the hand ends within a millimetre."""
    result = vff.simulate("panda-sweep", REJECTED | KILOGRAM | more)
    assert result.status == "completed"
    assert result.metrics["end_error"] < 1e-3
    assert result.metrics["velocity_limit_ratio"] < 0.5


def test_a_loop_of_ones_own() -> None:
    """The torque of the last call is taken for what has acted since."""
    scenario = held(controller={**held().to_dict()["controller"], "touch": REJECT})
    controller = vff.Controller(scenario.arm, scenario["controller"])
    simulation = vff.Simulation(scenario)
    for _ in range(2000):
        state = simulation.state
        simulation.step(controller.torque(state.q, state.dq, START, t=state.t))
    assert np.linalg.norm(simulation.state.x - START) < 1e-4


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"controller.observer": {}, "simulation.control": "continuous"}, "controller.observer"),
        ({"controller.touch": REJECT}, "controller.touch: needs"),
        ({"controller.observer": {"bandwidth": 0.0}}, "controller.observer.bandwidth: must be"),
        ({"controller.observer": {"bandwith": 50.0}}, "bandwith"),
        ({"controller.observer": {}, "controller.touch": {"task": "yield"}}, "controller.touch.task"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message.replace(".", r"\.")):
        vff.simulate("panda-sweep", changes)
