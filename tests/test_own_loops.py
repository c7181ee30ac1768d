"""The law in a loop of one's own: questions change nothing, and what is around is what is given."""

from __future__ import annotations

import signal
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


def folded() -> tuple[Any, Any, Any]:
    """A state of six links, and where their tip is."""
    q = np.array([1.2, -0.6, -0.6, -0.5, 0.3, 0.4])
    return q, np.zeros(6), vff.Arm.uniform(6).forward_kinematics(q)[-1]


AT_ONCE: dict[str, Any] = {
    "null_damping": 6.0,
    "field": {"kind": "bounded", "gain": 200.0, "influence": 1.0},
    "command": {"blend_time": 0.0},
}


@pytest.mark.parametrize("before", ["another loop", "a clock that was set", "reset"])
def test_what_is_given_moves_by_the_clock_of_whoever_gives_it(before: str) -> None:
    """A disc that comes near in 8 s, and was 8 s away before the clock went back."""
    disc = vff.Obstacle.circle([1.6, 2.9], radius=0.15, motion=vff.Motion.linear([0.0, -0.08]))
    q, dq, x = folded()

    def loop(controller: vff.Controller, t: float, count: int = 40) -> None:
        for k in range(count):
            controller.cycle(t + 1e-3 * k, q, dq, x)

    controller, fresh = (vff.Controller(vff.Arm.uniform(6), AT_ONCE) for _ in range(2))
    controller.begin(0.001)
    loop(controller, 10.0)
    if before != "a clock that was set":
        controller.stop()
        loop(controller, 10.05, 240)
        assert controller.phase == "finished"
        if before == "reset":
            controller.reset()
        controller.begin(0.001)
    loop(controller, 0.0)
    fresh.begin(0.001)
    loop(fresh, 0.0)
    asked = [each.torque(q, dq, x, obstacles=[disc], t=0.05) for each in (controller, fresh)]
    np.testing.assert_array_equal(*asked)
    near = fresh.torque(q, dq, x, obstacles=[disc], t=8.05)
    for k in range(2000):
        sent = [each.cycle(0.05 + 4e-3 * k, q, dq, x, obstacles=[disc])[0] for each in (controller, fresh)]
        np.testing.assert_allclose(*sent, atol=1e-6)
    np.testing.assert_allclose(sent[0], near, atol=1.0)
    assert np.abs(near).max() > 10.0  # it comes near


def test_what_comes_with_a_clock_that_was_set_has_that_clock() -> None:
    disc = vff.Obstacle.circle([1.6, 2.9], radius=0.15, motion=vff.Motion.linear([0.0, -0.08]))
    (q, dq, x), sent = folded(), []
    for leap in (0.0, 10.0):
        controller = vff.Controller(vff.Arm.uniform(6), AT_ONCE)
        controller.begin(0.001)
        for k in range(40):
            controller.cycle(leap + 1e-3 * k, q, dq, x)
        for k in range(40, 80):
            sent.append(controller.cycle(1e-3 * k, q, dq, x, obstacles=[disc])[0])
    np.testing.assert_allclose(sent[:40], sent[40:], atol=1e-9)


@pytest.mark.parametrize("law", [{}, {"observer": {}, "avoidance": "cbf"}, {"tank": {"capacity": 1.0}}])
def test_a_question_changes_no_set_point(law: dict[str, Any]) -> None:
    settings = {"stiffness": 100.0, "damping": 20.0, "null_damping": 8.0, **law}
    arm, cloud = vff.Arm.named("panda"), vff.Obstacle.points([[0.4, 0.9, 0.3]], 0.02)
    there, ball = np.array(arm.pose(READY)[0]), vff.Obstacle.sphere([0.3, 0.0, 0.6], 0.2)
    points = []
    for asks in (False, True):
        controller = vff.Controller(arm, settings)
        virtual = vff.VirtualArm(controller, READY, 0.001, 7.5, 3750.0)
        q, dq, course = np.array(READY), np.array(STILL), []
        for k in range(600):
            if asks and k % 40 == 0:
                controller.terms(q + 0.3, dq + 0.5, there, obstacles=[ball], t=1e-3 * k + 7.0)
                controller.torque(q - 0.3, dq, there, obstacles=[cloud], t=1e-3 * k)
            x = there + 0.05 * np.sin(3e-3 * k) * np.array([0.0, 1.0, 0.0])
            q, dq, *_ = virtual.step(1e-3 * k, x, obstacles=[cloud])
            if k == 100:
                controller.update_points([[0.45, 0.05, 0.6]])
            course.append(q)
        points.append(course)
    np.testing.assert_array_equal(*points)


@pytest.mark.parametrize("meanwhile", ["terms", "a missed state"])
def test_points_without_a_time_are_of_the_last_state(meanwhile: str) -> None:
    cloud, sent = vff.Obstacle.points([[2.0, 0.0, 0.0]], 0.02), []
    for asks in (False, True):
        controller = vff.Controller(vff.Arm.named("panda"), AT_ONCE | {"avoidance": "cbf"})
        controller.begin(0.001)
        for k in range(20):
            controller.cycle(100.0 + 1e-3 * k, READY, STILL, [0.5, 0.0, 0.5], obstacles=[cloud])
        if asks and meanwhile == "terms":
            controller.terms(READY, STILL, [0.5, 0.0, 0.5], obstacles=[cloud])  # at t = 0
        if meanwhile == "a missed state":
            controller.cycle(obstacles=[cloud])
        controller.update_points([[0.3, 0.0, 0.7]], velocities=[[0.0, 0.2, 0.0]])
        sent.append(controller.cycle(100.022, READY, STILL, [0.5, 0.0, 0.5], obstacles=[cloud])[0])
    np.testing.assert_array_equal(*sent)
    nobody = vff.Controller(vff.Arm.named("panda"), AT_ONCE).torque(READY, STILL, [0.5, 0.0, 0.5])
    assert np.abs(sent[0] - nobody).max() > 0.5


@pytest.mark.parametrize("refused", ["a cycle", "a torque", "a cycle of no loop"])
def test_what_is_refused_leaves_what_is_around(refused: str) -> None:
    """Points that were seen stay, also where the call brought other obstacles."""
    arm, cloud = vff.Arm.named("panda"), vff.Obstacle.points([[2.0, 0.0, 0.0]], 0.02)
    ball, settings = vff.Obstacle.sphere([3.0, 0.0, 0.0], 0.1), AT_ONCE | {"task": "pose"}
    controller = vff.Controller(arm, settings)
    place, quaternion = arm.pose(READY)
    turned = [*place, *quaternion]

    def ask(t: float) -> Any:
        if refused == "a cycle":
            return controller.cycle(t, READY, STILL, turned, obstacles=[cloud])[0]
        return controller.torque(READY, STILL, turned, obstacles=[cloud], t=t)

    if refused == "a cycle":
        controller.begin(0.001)
    ask(0.001)
    controller.update_points([[0.25, 0.0, 0.7]])
    ask(0.002)
    before, fault = ask(0.003), "norm 0" if refused != "a cycle of no loop" else "begin"
    with pytest.raises(InputError, match=fault):
        if refused == "a torque":
            controller.torque(READY, STILL, [*place, 0.0, 0.0, 0.0, 0.0], obstacles=[cloud, ball])
        else:
            x = turned if refused == "a cycle of no loop" else [*place, 0.0, 0.0, 0.0, 0.0]
            controller.cycle(0.004, READY, STILL, x, obstacles=[cloud, ball])
    np.testing.assert_array_equal(ask(0.005), before)
    nobody = vff.Controller(arm, settings).torque(READY, STILL, turned)
    assert np.abs(before - nobody).max() > 0.5


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="signals of POSIX")
@pytest.mark.parametrize("near", [[], [vff.Obstacle.circle([30.0, 20.0], 0.1)]])
def test_a_question_that_is_broken_off_changes_nothing(near: list[vff.Obstacle]) -> None:
    """So many obstacles that a signal comes while the law is asked about them."""
    n, noise = 60, np.random.default_rng(0)
    arm, q, dq = vff.Arm.uniform(n), np.r_[0.3, 0.02 * noise.standard_normal(n - 1)], np.zeros(n)
    x, settings = arm.forward_kinematics(q)[-1], AT_ONCE | {"observer": {}, "deadline": "unlimited"}
    settings["field"] = {"kind": "bounded", "gain": 1e-3, "influence": 60.0}
    places = zip(noise.uniform(0.0, n, 20000), noise.uniform(-30.0, 30.0, 20000), strict=True)
    many = [vff.Obstacle.circle(place, 0.1) for place in places]

    class Last:
        """Read last: the signal comes while the law is asked."""

        def to_dict(self) -> dict[str, Any]:
            signal.setitimer(signal.ITIMER_REAL, delay)
            return vff.Obstacle.circle([500.0, 0.0], 0.1).to_dict()

    class HeardError(Exception):
        pass

    def hear(*_: Any) -> None:
        raise HeardError

    def is_broken_off() -> bool:
        """Whether the signal came before the answer."""
        try:
            controllers[0].torque(q, dq, x, obstacles=[*many, Last()])
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        except HeardError:
            return True
        return False

    controllers = [vff.Controller(arm, settings) for _ in range(2)]
    for each in controllers:
        each.begin(0.001)
    delay = 0.02  # s; as long as the signal comes before the answer
    before = signal.signal(signal.SIGALRM, hear)
    try:
        for k in range(30):
            pushed = dq + np.r_[5e-3 * k, np.zeros(n - 1)]  # which no torque explains
            sent = [each.cycle(1e-3 * k, q, pushed, x, obstacles=near)[0] for each in controllers]
            np.testing.assert_array_equal(*sent)
            if k % 10 == 5:
                while not is_broken_off():
                    delay *= 0.8
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    estimates = [each.tau_ext_estimate for each in controllers]
    assert estimates[0] is not None and np.abs(estimates[0]).max() > 1.0
