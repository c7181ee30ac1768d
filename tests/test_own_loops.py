"""The law in a loop of one's own: questions change nothing, and what is around is what is given."""

from __future__ import annotations

from collections import UserDict
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError

READY = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
STILL = [0.0] * 7


@pytest.mark.parametrize("kind", [dict, UserDict, MappingProxyType])
def test_an_obstacle_that_may_change_is_read_every_time(kind: Any) -> None:
    settings = vff.ControlSettings(field=vff.Field.khatib(0.5, 0.6))
    arm, q = vff.Arm.uniform(6), [0.1] * 6
    document = vff.Obstacle.circle([3.0, 1.2], 0.15).to_dict()
    obstacle = document if kind is dict else kind(document)
    controller = vff.Controller(arm, settings)
    near = controller.torque(q, q, [5.0, 1.0], obstacles=[obstacle])
    document["position"] = [16.0, 23.0]
    if kind is UserDict:
        obstacle["position"] = [16.0, 23.0]
    far = controller.torque(q, q, [5.0, 1.0], obstacles=[obstacle])
    alone = vff.Controller(arm, settings).torque(q, q, [5.0, 1.0], obstacles=[obstacle])
    assert np.abs(near - far).max() > 1.0
    np.testing.assert_array_equal(far, alone)


def test_points_of_a_mapping_are_read_every_time() -> None:
    cloud = MappingProxyType(vff.Obstacle.points([[0.4, 0.0, 0.3]], 0.02).to_dict())
    controller = vff.Controller(vff.Arm.named("panda"))
    controller.torque(READY, STILL, [0.5, 0.0, 0.5], obstacles=[cloud])
    with pytest.raises(InputError, match="every call reads anew"):
        controller.update_points([[0.45, 0.0, 0.45]])


def test_how_long_a_torque_may_be_held_empties_no_tank() -> None:
    """Asked in every cycle, the law is that of the simulation to the last bits."""
    change = {"controller.tank": {"capacity": 0.1, "initial": 0.01}, "duration": 4.0}
    scenario = vff.Scenario.load("sweep-through").replace(**change)
    controller, simulation = vff.Controller(scenario.arm, scenario["controller"]), vff.Simulation(scenario)
    around, state, worst = scenario["obstacles"], simulation.state, 0.0
    while not simulation.done:
        controller.stable_period(state.q, obstacles=around, t=state.t)
        tau = controller.torque(state.q, state.dq, state.x_ref, obstacles=around, t=state.t)
        following = simulation.step()
        worst = max(worst, float(np.abs(tau - state.tau).max()))
        state = following
    assert worst < 1e-9


@pytest.mark.parametrize("question", ["terms", "stable_period", "torque"])
def test_points_that_were_seen_outlast_a_question(question: str) -> None:
    """In a loop that is watched over, what is asked about other obstacles leaves its own as they are."""
    settings = {"field": {"kind": "bounded", "gain": 80.0, "influence": 0.25}}
    x, cloud = [0.5, 0.0, 0.5], vff.Obstacle.points([[0.4, 0.9, 0.3]], 0.02)
    sent = []
    for asks in (False, True):
        controller = vff.Controller(vff.Arm.named("panda"), settings)
        controller.begin(0.001)
        controller.cycle(0.0, READY, STILL, x, obstacles=[cloud])
        controller.update_points([[0.3, 0.15, 0.5], [0.3, 0.15, 0.55]])
        torques = []
        for k in range(1, 900):
            if asks and k % 50 == 0:
                asked = {"terms": (READY, STILL, x), "stable_period": (READY,), "torque": (READY, STILL, x)}
                getattr(controller, question)(*asked[question], t=1e-3 * k)
            torques.append(controller.cycle(1e-3 * k, READY, STILL, x, obstacles=[cloud])[0])
        sent.append(torques)
    np.testing.assert_array_equal(*sent)
    nobody = vff.Controller(vff.Arm.named("panda"), settings).torque(READY, STILL, x)
    assert np.abs(sent[0][-1] - nobody).max() > 0.5


@pytest.mark.parametrize(
    "command",
    [{"gravity": "robot"}, {"viscous_friction": 0.5, "coulomb_friction": 0.3}],
)
def test_an_observer_hears_what_was_sent(command: dict[str, Any]) -> None:
    """The estimate of a loop of `torque` is that of a simulation, whatever lies between law and robot."""
    scenario = vff.Scenario.load("panda-lean").replace(
        **{"controller.command": command, "duration": 1.0, "simulation.record_every": 1}
    )
    assert "observer" in scenario["controller"]
    controller, simulation = vff.Controller(scenario.arm, scenario["controller"]), vff.Simulation(scenario)
    state, worst = simulation.state, 0.0
    while not simulation.done:
        controller.torque(state.q, state.dq, state.x_ref, obstacles=scenario["obstacles"], t=state.t)
        assert controller.tau_ext_estimate is not None and state.tau_ext_estimate is not None
        worst = max(worst, float(np.abs(controller.tau_ext_estimate - state.tau_ext_estimate).max()))
        state = simulation.step()
    assert worst < 1e-9


def test_a_second_run_is_as_the_first_after_a_reset() -> None:
    settings = {
        "tank": {"capacity": 0.1, "initial": 0.02},
        "field": {"kind": "bounded", "gain": 80.0, "influence": 0.5},
    }
    controller, near = vff.Controller(vff.Arm.uniform(6), settings), [vff.Obstacle.circle([2.0, 1.0], 0.3)]
    q, dq = np.array([0.4, 0.2, -0.3, 0.1, 0.2, 0.1]), np.array([0.5, -0.4, 0.3, -0.6, 0.2, 0.4])

    def run() -> list[Any]:
        return [
            controller.torque(q + t * dq, dq, x_ref=[4.0, 2.0], obstacles=near, t=t)
            for t in np.arange(0.0, 1.0, 0.02)
        ]

    first, second = run(), run()
    assert not np.array_equal(first, second)  # the tank has been emptied
    controller.reset()
    np.testing.assert_array_equal(first, run())
