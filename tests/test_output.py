"""What stands between the law and a robot (docs/theory.md, T113 to T115), simulated and in a loop."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull.errors import InputError, ScenarioError

Array = NDArray[np.float64]
READY = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
PERIOD = 1e-3


def with_command(command: dict[str, Any], **changes: Any) -> vff.Scenario:
    """A Panda whose hand goes 0.2 m to the side within 0.6 s."""
    document: dict[str, Any] = {
        "duration": 1.0,
        "q0": READY,
        "arm": {"model": "panda"},
        "controller": {"task": "position", "stiffness": 400.0, "damping": 40.0, "null_damping": 10.0},
        "reference": {"kind": "line", "end": [0.5, 0.2, 0.4], "duration": 0.6},
        "simulation": {"integrator": "semi_implicit_euler"},
    }
    document["controller"]["command"] = command
    return vff.Scenario.from_dict(document | changes)


def planar(command: dict[str, Any], **changes: Any) -> vff.Scenario:
    """The same in the plane."""
    document: dict[str, Any] = {
        "duration": 1.0,
        "q0": [0.6, -0.9, 0.7],
        "arm": {"lengths": [0.5, 0.4, 0.4], "masses": [3, 2, 1.5], "gravity": 9.81},
        "controller": {"stiffness": 400.0, "damping": 40.0, "null_damping": 10.0, "command": command},
        "reference": {"kind": "line", "end": [0.6, 0.7], "duration": 0.6},
    }
    return vff.Scenario.from_dict(document | changes)


EITHER = pytest.mark.parametrize("scenario", [with_command, planar])


def steps(result: vff.Result) -> Array:
    """How fast the torque at the joints changes [N·m/s]."""
    assert result.tau_applied is not None
    return np.abs(np.diff(result.tau_applied, axis=0)) / np.diff(result.t)[:, None]


@EITHER
def test_nothing_asked_for_is_nothing_changed(scenario: Any) -> None:
    """What is for a loop of one's own, and the defaults, leave a simulation as it is, to the last bit."""
    plain = vff.simulate(scenario({}))
    for_loops = {"obstacle_speed": 1.0, "blend_time": 1.0, "missed_cycles": 2, "stop_damping": 3.0}
    same = vff.simulate(scenario({"gravity": "controller", **for_loops}))
    assert plain.tau_applied is None and same.tau_applied is None
    assert np.array_equal(plain.q, same.q) and np.array_equal(plain.tau, same.tau)


@EITHER
@pytest.mark.parametrize("control", ["hold", "predictor", "continuous"])
@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_gravity_of_the_robot(scenario: Any, control: str, integrator: str) -> None:
    """As under our gravity torque, but for its change within a period; a payload does not make it sag."""
    apart = []
    for dt in (1e-3, 2.5e-4):
        simulation = {"control": control, "integrator": integrator, "dt": dt}
        ours, its = (
            vff.simulate(scenario({"gravity": who}, simulation=simulation)) for who in ("controller", "robot")
        )
        assert its.tau_applied is not None
        assert np.abs(ours.q[-1] - ours.q[0]).max() > 0.1
        apart.append(np.abs(ours.q - its.q).max())
    assert apart[0] < 2e-3 and apart[1] < max(0.3 * apart[0], 1e-9), apart
    # At the beginning of a step the torque of the law acts, and in its middle where that is predicted.
    assert np.abs(its.tau_applied - its.tau).max() < (1e-9 if control != "predictor" else 0.1)
    payload = {"payload": 0.5} if scenario is planar else {"payload": {"mass": 0.5}}
    heavy, held = (
        vff.simulate(scenario({"gravity": who}, simulation=simulation, plant=payload))
        for who in ("controller", "robot")
    )
    assert np.abs(heavy.error[-1]).max() > 10 * np.abs(held.error[-1]).max()


@EITHER
def test_energy_of_a_robot_that_carries_itself(scenario: Any) -> None:
    """The drives' power, gravity's included, is what the energy changes by; friction only takes."""
    result = vff.simulate(scenario({"gravity": "robot"}, simulation={"control": "hold", "dt": 5e-4}))
    power = result.power[:, vff.PORTS.index("actuators")]
    energy = result.energy[:, :2].sum(axis=1)
    work = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1]) * np.diff(result.t))])
    assert np.ptp(energy) > 0.1
    assert np.abs(energy - energy[0] - work).max() < 0.01 * np.ptp(energy)
    # Moving under nothing but the robot's own gravity torque, with dry friction: its motion only dies down.
    friction = {"coulomb_friction": 0.05}
    still = scenario({"gravity": "robot"}, plant=friction).to_dict()
    still["dq0"] = [0.3] * len(still["q0"])
    simulation = vff.Simulation(vff.Scenario.from_dict(still))
    arm = vff.Arm.named("panda") if scenario is with_command else vff.Arm(**still["arm"])
    before = np.inf
    while not simulation.done:
        state = simulation.step([0.0] * arm.n)
        kinetic = arm.kinetic_energy(state.q, state.dq)
        assert kinetic <= before * (1 + 1e-6)
        before = kinetic


@EITHER
@pytest.mark.parametrize("more", [{}, {"gravity": "robot"}])
def test_torque_rate(scenario: Any, more: dict[str, Any]) -> None:
    """It changes no faster, and without the limit it would have; one that does not matter changes nothing."""
    first = scenario({}).replace(**{"controller.stiffness": 900.0})
    jump = {
        "reference": {
            "kind": "setpoint",
            "point": [0.5, 0.1, 0.45] if scenario is with_command else [0.8, 0.5],
        }
    }
    document = first.to_dict() | jump
    free = vff.simulate(document)
    assert (np.abs(np.diff(free.tau, axis=0)) / PERIOD).max() < 1e6
    for rate in (300.0, 30.0):
        document["controller"]["command"] = {"torque_rate": rate, **more}
        slow = vff.simulate(document)
        if more:
            continue  # what is sent is not what acts
        assert 0.99 * rate < steps(slow).max() < rate * (1 + 1e-9)
    assert np.abs(slow.q - free.q).max() > 1e-3
    document["controller"]["command"] = {"torque_rate": 1e7, **more}
    same = vff.simulate(document)
    if scenario is planar:
        assert np.abs(same.q - free.q).max() < (1e-3 if more else 1e-12)
    else:  # a Panda has limits of speed, which other joints keep behind a rate (T132)
        assert np.abs(same.error[-1]).max() < 1e-3 and same.metrics["velocity_limit_ratio"] < 1.0
    # Held over more than a step, it may change by the rate times the control period.
    document["simulation"] = {"control_every": 4}
    document["controller"]["command"] = {"torque_rate": 300.0}
    every = vff.simulate(document)
    changes = np.abs(np.diff(every.tau_applied, axis=0)).max(axis=1)
    assert changes[3::4].max() == pytest.approx(4 * PERIOD * 300.0)
    assert not changes[0::4].any() and not changes[1::4].any() and not changes[2::4].any()


@EITHER
def test_friction_is_compensated(scenario: Any) -> None:
    """With the friction of the plant, most of what it costs is gone; the numbers are the plant's here."""
    has = {"viscous_friction": 0.8, "coulomb_friction": 0.6}
    gives = {**has, "friction_speed": 0.01}
    slow = {**scenario({}).to_dict()["reference"], "duration": 3.0}
    errors = []
    for plant, command in ((has, {}), (has, gives), ({}, {})):
        result = vff.simulate(scenario(command, plant=plant, reference=slow, duration=3.0))
        # While it moves: a joint that stands is not compensated, because nobody knows which way it is to go.
        moves = np.abs(result.t - 1.5) < 0.7
        errors.append(np.sqrt(np.mean(result.error[moves] ** 2)))
    assert errors[0] > 8 * errors[1] > 8 * errors[2], errors


FRANKA: dict[str, Any] = {"gravity": "robot", "torque_rate": 1000.0, "tip_angular_speed": 2.5}


@EITHER
def test_tip_speed(scenario: Any) -> None:
    """It is kept, to the order of the period; the tip arrives later, and where it should."""
    free = vff.simulate(scenario({}, duration=3.0))
    dimension = 3 if scenario is with_command else 2
    most = np.linalg.norm(free.dx[:, :dimension], axis=1).max()
    kept = vff.simulate(scenario({"tip_speed": 0.4 * most}, duration=3.0))
    speed = np.linalg.norm(kept.dx[:, :dimension], axis=1).max()
    assert 0.39 * most < speed < 0.404 * most
    assert np.linalg.norm(kept.error[-1]) < 1e-3
    assert kept.metrics["tip_speed_ratio"] == pytest.approx(speed / (0.4 * most), rel=1e-12)
    assert free.metrics["tip_speed_ratio"] is None and kept.metrics["tip_angular_speed_ratio"] is None


@EITHER
@pytest.mark.parametrize("rate", [None, 2000.0])
def test_how_fast_the_tip_turns(scenario: Any, rate: float | None) -> None:
    """It is kept, also behind a limit of the torque rate."""
    settings = {} if rate is None else {"torque_rate": rate}
    free = turns(vff.simulate(scenario(settings, duration=3.0))).max()
    limited = scenario(settings | {"tip_angular_speed": 0.5 * free}, duration=3.0)
    kept = vff.simulate(limited)
    assert 0.4 * free < turns(kept).max() < 0.505 * free
    assert kept.metrics["tip_angular_speed_ratio"] == pytest.approx(
        turns(kept).max() / (0.5 * free), rel=1e-9
    )


@EITHER
def test_a_tip_that_is_too_fast_is_told_of(scenario: Any) -> None:
    """Nothing brakes one that begins beyond its limits; what sensors say of it does not count."""
    document = scenario({"tip_speed": 0.1, "tip_angular_speed": 0.1}).to_dict()
    document["dq0"] = [0.0, 0.5] + [0.0] * (len(document["q0"]) - 2)
    for more in ({}, {"measurement": {"velocity_noise": 0.3}}):
        fast = vff.simulate(document | more)
        moves = np.linalg.norm(fast.dx[:, : 3 if scenario is with_command else 2], axis=1).max() / 0.1
        assert moves > 1.1 and fast.metrics["tip_speed_ratio"] == pytest.approx(moves, rel=1e-9)
        assert fast.metrics["tip_angular_speed_ratio"] >= 5.0 * (1 - 1e-9)
        told = (
            f"the speed of the end effector came to {100 * moves:.4g} % of its limit",
            "the angular speed of the end effector came to ",
        )
        assert fast.headline.severity != "good"
        assert all(any(line.startswith(each) for line in fast.headline.lines) for each in told)


def led(name: str, settings: dict[str, Any], target: Any, **more: Any) -> tuple[Array, Array, Array]:
    """A loop of 1 ms on an exact model (T): how fast its hand moves [m/s] and turns [rad/s], and its torques
    [of their limits] (T, n); `target` is how far the hand is to be from where it begins, at a time.
    """
    arm = vff.Arm.named(name)
    q, dq = np.array(HOMES[name]), np.zeros(arm.n)
    gains = {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0}
    controller = vff.Controller(arm, gains | settings, period=PERIOD)
    controller.begin(PERIOD)
    home, moves, turns, torques = arm.pose(q)[0], [], [], []
    for k in range(1500):
        t = k * PERIOD
        torque, _ = controller.cycle(t, q, dq, x_ref=home + target(t), **more)
        torques.append(torque / arm.torque_limits)
        dq = dq + PERIOD * arm.forward_dynamics(q, dq, torque)
        q = q + PERIOD * dq
        twist = arm.jacobian(q) @ dq
        moves.append(np.linalg.norm(twist[:3]))
        turns.append(np.linalg.norm(twist[3:]))
    return np.array(moves), np.array(turns), np.array(torques)


HOMES = {
    "panda": READY,
    "ur5e": [0.0, -1.2, 1.6, -2.0, -1.57, 0.0],
    "iiwa14": [0.0, 0.6, 0.0, -1.2, 0.0, 1.0, 0.0],
}


def turned_back(torques: Array) -> int:
    """In how many cycles a torque goes back by more than 5 % of its limit, after it came by as much."""
    change = np.diff(torques, axis=0)
    back = (change[1:] * change[:-1] < 0) & (np.minimum(abs(change[1:]), abs(change[:-1])) > 0.05)
    return int(back.any(axis=1).sum())


@pytest.mark.parametrize("name", HOMES)
@pytest.mark.parametrize("way", ["cbf", "priority"])
def test_the_tip_is_no_faster_where_a_distance_asks_for_it(name: str, way: str) -> None:
    """A ball twice as fast as the tip may be comes at the hand: that gives way as fast as it may, by torques
    that turn back in every other cycle (416 to 815 of 2500) before the ball of accelerations of (T114).
    """
    home = vff.Arm.named(name).pose(HOMES[name])[0]
    ball = vff.Obstacle.sphere(home - [0.0, 0.6, 0.0], radius=0.08, motion=vff.Motion.linear([0.0, 0.5, 0.0]))
    field = {"kind": "bounded", "gain": 80.0, "influence": 0.25}
    settings = {"avoidance": way, "field": field, "command": {"tip_speed": 0.25}}
    moves, _, torques = led(name, settings, lambda t: 0.0, obstacles=[ball])
    deep = round(1.05 / PERIOD)  # then its middle is in the hand
    assert 0.22 < moves[:deep].max() < 0.2525
    assert turned_back(torques[:deep]) == 0


@pytest.mark.parametrize("name", HOMES)
def test_a_hand_out_of_reach_turns_no_faster(name: str) -> None:
    """It turned at 0.86 to 1.14 rad/s of 0.5, and torques turned back in 128 to 162 cycles."""
    command = {"gravity": "controller", "tip_angular_speed": 0.5}
    settings = {"stiffness": 50.0, "damping": 14.0, "command": command}
    _, turns, torques = led(name, settings, lambda t: np.array([0.8 * t, 0.0, 0.0]))
    assert turns.max() < 0.505
    assert turned_back(torques) == 0


@pytest.mark.parametrize("limit", ["tip_speed", "tip_angular_speed"])
def test_a_target_that_jumps_passes_no_limit_from_rest(limit: str) -> None:
    """At rest there is no way of the tip along which to brake: half of a metre per second in one cycle."""

    def jump(t: float) -> Array:
        return np.array([0.3, 0.4, 0.2]) * (t > 0.1)

    settings = {"stiffness": 2000.0, "damping": 90.0, "command": {limit: 0.1}}
    moves, turns, torques = led("panda", settings, jump)
    assert (moves if limit == "tip_speed" else turns).max() < 0.101
    assert turned_back(torques) <= 2  # where it is asked to jump


@pytest.mark.parametrize("beside", [[0.0, 0.05, 0.0], [-0.05, 0.0, 0.0]])
def test_a_weight_that_nobody_knows_of_turns_the_hand_no_faster_than_its_robot_allows(
    beside: list[float],
) -> None:
    """10 N, 5 cm beside the axis of the wrist, whose orientation is given up. The observer of a command "of
    the robot" lets the limits count with them; without it the hand is too fast by what they accelerate it,
    over the pole of the barrier.
    """
    scene = vff.Scenario.load("panda-shelf")
    scene = scene.replace(
        duration=1.0,
        wrenches=[{"link": scene.arm.link_names[-1], "point": beside, "force": [0.0, 0.0, -9.81]}],
        **{"controller.avoidance": "relaxed", "controller.yielding": None, "controller.governor": None},
        **{"simulation.record_every": 1},
    )
    command: Any = FRANKA | {"tip_speed": 1.7}
    blind, known = (
        turns(vff.simulate(scene.replace(**{"controller.command": each}))).max()
        for each in (command, "of the robot")
    )
    assert blind > 2.5 and known < 0.9 * 2.5


@pytest.mark.parametrize("rate", [None, 1000.0])
@pytest.mark.parametrize(("deceleration", "offset"), [(4.0, 0.0), (2.0, 0.3)])
def test_joints_come_slowly_to_their_stops(rate: float | None, deceleration: float, offset: float) -> None:
    """As a root of what is left of the way (T152), where they came as fast as the spring took them there."""
    goal = [2.8, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
    settings: dict[str, Any] = {} if rate is None else {"torque_rate": rate}
    stops = {"stop_deceleration": deceleration, "stop_offset": offset}

    def beyond(command: dict[str, Any]) -> float:
        scene = vff.Scenario.load("panda-sweep").replace(
            duration=3.0,
            obstacles=[],
            q0=[0.5, *goal[1:]],
            reference=reference_at(goal),
            **{"controller.posture": goal, "controller.posture_stiffness": 80.0},
            **{"controller.command": command, "simulation.control": "hold", "simulation.record_every": 1},
        )
        result = vff.simulate(scene)
        way = 2.8973 - result.q[:, 0]
        assert way[-1] < 0.11, "it does not arrive"
        most = np.sqrt(offset**2 + 2.0 * deceleration * np.maximum(way, 0.0)) - offset
        return float((result.dq[:, 0] - most).max())

    assert beyond(settings) > 0.5
    assert beyond(settings | stops) < 0.01


def reference_at(q: list[float]) -> dict[str, Any]:
    """The pose of a Panda's hand there."""
    point, orientation = vff.Scenario.load("panda-sweep").arm.pose(q)
    return {"kind": "setpoint", "point": point.tolist(), "orientation": orientation.tolist()}


def turns(result: vff.Result) -> Array:
    """How fast the tip turns (T,) [rad/s]."""
    arm = result.scenario.arm
    if arm.dimension == 2:
        return np.abs(result.dq.sum(axis=1))
    jacobians = [arm.jacobian(q)[3:] for q in result.q]
    return np.array([np.linalg.norm(j @ dq) for j, dq in zip(jacobians, result.dq, strict=True)])


@pytest.mark.parametrize(
    ("arm", "command"),
    [
        ("panda", FRANKA | {"tip_speed": 1.7}),
        ("fr3", FRANKA | {"tip_speed": 3.0}),
        ("ur5e", {"gravity": "robot", "tip_speed": 1.5}),
        ("iiwa14", {"gravity": "robot"}),
        ("gen3", {"gravity": "controller"}),
    ],
)
def test_of_the_robot(arm: str, command: dict[str, Any]) -> None:
    """What the interface of a bundled arm takes, in a loop and in a simulation, from a file too; with an
    observer where it limits the rate.
    """
    observer: Any = {} if "torque_rate" in command else None
    settings = vff.ControlSettings(stiffness=100.0, damping=20.0, command="of the robot")
    given = vff.ControlSettings(stiffness=100.0, damping=20.0, command=command, observer=observer)
    assert settings.to_dict()["command"] == "of the robot"
    model = vff.Arm.named(arm)
    q = np.clip(0.4, *model.joint_limits.T) if model.joint_limits is not None else np.full(model.n, 0.4)
    first, second = (vff.Controller(model, each) for each in (settings, given))
    for controller in (first, second):
        controller.begin(PERIOD)
    for k in range(5):
        x = [0.3, 0.1 * k, 0.4]
        (a, _), (b, _) = (each.cycle(k * PERIOD, q, np.zeros(model.n), x) for each in (first, second))
        assert np.array_equal(a, b)
    if arm == "panda":
        document = with_command({}).to_dict()
        results = []
        for each in (settings, given):
            written = each.to_dict()
            own = {key: written[key] for key in ("command", "observer") if key in written}
            document["controller"] = document["controller"] | own
            results.append(vff.simulate(vff.Scenario.from_dict(document)))
        assert results[0].tau_applied is not None and np.array_equal(results[0].q, results[1].q)


@pytest.mark.parametrize("arm", ["xarm7", None])
def test_of_a_robot_that_is_not_known(arm: str | None) -> None:
    model = vff.Arm.uniform(3) if arm is None else vff.Arm.named(arm)
    with pytest.raises(ScenarioError, match="`gravity` and `torque_rate` as the robot's manual says"):
        vff.Controller(model, {"command": "of the robot"})
    with pytest.raises(ScenarioError, match="of the robot"):
        vff.ControlSettings(command="of my robot")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("command", "says"),
    [
        ({"gravity": "both"}, "controller.command.gravity"),
        ({"torque_rate": 0.0}, "controller.command.torque_rate: must be greater than 0"),
        ({"torque_rate": [1.0, 2.0]}, "controller.command.torque_rate: expected 7 numbers, got 2"),
        ({"coulomb_friction": -1.0}, "controller.command.coulomb_friction"),
        ({"friction_speed": 0.0}, "controller.command.friction_speed"),
        ({"tip_speed": -0.1}, "controller.command.tip_speed"),
        ({"obstacle_speed": 0.0}, "controller.command.obstacle_speed"),
        ({"blend_time": -1.0}, "controller.command.blend_time"),
        ({"missed_cycles": 0}, "controller.command.missed_cycles"),
        ({"stop_damping": 0.0}, "controller.command.stop_damping"),
        ({"torque_rates": 1.0}, "torque_rate"),
    ],
)
def test_bad_settings(command: dict[str, Any], says: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        with_command(command)
    assert says.split(":")[0] in str(caught.value)


def test_a_rate_needs_samples() -> None:
    with pytest.raises(ScenarioError, match=r"controller\.command\.torque_rate"):
        with_command({"torque_rate": 1.0}, simulation={"control": "continuous"})
    vff.simulate(with_command({"tip_speed": 0.1, "gravity": "robot"}, simulation={"control": "continuous"}))


class Loop:
    """A Panda of ours that takes torques and carries itself."""

    def __init__(self, **command: Any) -> None:
        self.arm = vff.Arm.named("panda")
        settings = vff.ControlSettings(
            task="position",
            stiffness=100.0,
            damping=20.0,
            null_damping=8.0,
            command={"gravity": "robot", **command},
        )
        self.controller = vff.Controller(self.arm, settings)
        self.q, self.dq, self.t = np.array(READY), np.zeros(7), 0.0
        self.x = self.arm.forward_kinematics(self.q)[-1] + [0.0, 0.1, 0.05]

    def cycle(self, heard: bool = True) -> str:
        """The phase of one cycle."""
        tau, phase = (
            self.controller.cycle(self.t, self.q, self.dq, self.x) if heard else self.controller.cycle()
        )
        tau = tau + self.arm.gravity_torque(self.q)
        self.dq = self.dq + PERIOD * self.arm.forward_dynamics(self.q, self.dq, tau)
        self.q, self.t = self.q + PERIOD * self.dq, self.t + PERIOD
        return phase


def test_a_loop_from_python() -> None:
    """From a safe start to a safe end, with a pause."""
    loop = Loop(torque_rate=1000.0)
    assert loop.controller.phase is None
    with pytest.raises(InputError, match="begin"):
        loop.controller.cycle(0.0, loop.q, loop.dq, loop.x)
    loop.controller.begin(PERIOD, tau=[0.1] * 7)
    phases = [loop.cycle(heard=not 700 <= k < 720) for k in range(2000)]
    changes = [phases[0], *(b for a, b in pairwise(phases) if a != b)]
    assert changes == ["starting", "running", "holding", "damping", "starting", "running"]
    assert np.linalg.norm(loop.arm.forward_kinematics(loop.q)[-1] - loop.x) < 2e-3
    loop.x = loop.x + np.array([0.1, 0.0, 0.0])
    for _ in range(100):
        loop.cycle()
    assert np.abs(loop.dq).max() > 0.1
    loop.controller.stop()
    while loop.cycle() != "finished":
        assert loop.controller.phase == "stopping"
    assert np.abs(loop.dq).max() < 0.03
    for _ in range(2000):
        loop.cycle(heard=False)
    assert loop.controller.phase == "finished"


def test_a_robot_that_falls_silent() -> None:
    """It is brought to rest unheard, and the loop is lost."""
    loop = Loop()
    loop.controller.begin(PERIOD)
    for _ in range(700):
        loop.cycle()
    speed = np.abs(loop.dq).max()
    assert speed > 0.02
    phases = [loop.cycle(heard=False) for _ in range(1100)]
    assert list(dict.fromkeys(phases)) == ["holding", "damping", "released", "lost"]
    assert np.abs(loop.dq).max() < 0.1 * speed
    assert loop.cycle() == "lost"


def test_what_held_an_arm_goes_when_it_is_not_heard_of_any_more() -> None:
    """It was pushed while it was held: a spring and what is against its motion are not sent blindly, and
    nothing but what carries its weight once it is released.
    """
    arm, q0 = vff.Arm.named("panda"), np.array([0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8])
    settings = {"stiffness": 100.0, "damping": 20.0, "command": {"gravity": "robot"}}
    loop = vff.Controller(arm, settings)
    loop.begin(1e-3)
    for k in range(700):
        loop.cycle(1e-3 * k, q0, np.zeros(7))
    loop.stop()
    push = 0.15 / 0.4 * np.eye(7)[0]
    for k in range(400):
        pushed, phase = loop.cycle(0.7 + 1e-3 * k, q0 + 1e-3 * k * push, push)
    assert phase == "stopping" and np.abs(pushed).max() > 10.0
    sent: dict[str, list[Any]] = {}
    for _ in range(1500):
        tau, phase = loop.cycle(None, None, None)
        sent.setdefault(phase, []).append(tau)
    assert list(sent) == ["holding", "damping", "released", "lost"]
    damped = np.abs(np.array(sent["damping"]))
    assert damped[0].max() < 0.8 * np.abs(pushed).max() and damped[-1].max() < 0.1
    assert not np.any(sent["released"]) and not np.any(sent["lost"])


@pytest.mark.parametrize("rate", [None, 1e4])
def test_no_joint_is_thrown_beyond_its_speed_by_a_stop(rate: float | None) -> None:
    """Damping takes energy out of all joints together; what it takes from one may be thrown into another."""
    arm = vff.Arm.named("ur5e")
    speeds = np.array(arm.velocity_limits)
    command = {"gravity": "controller", "blend_time": 0.01} | ({} if rate is None else {"torque_rate": rate})
    law = {"stiffness": 100.0, "damping": 20.0, "null_damping": 8.0, "avoidance": "cbf", "command": command}
    random, period = np.random.default_rng(5), 1e-3
    for _ in range(20):
        q = random.uniform(-2.0, 2.0, 6)
        dq = speeds * random.uniform(0.7, 0.9, 6) * random.choice([-1, 1], 6)
        controller = vff.Controller(arm, law, period)
        controller.begin(period)
        controller.cycle(0.0, q, dq)
        controller.stop()
        for k in range(1, 200):
            tau, _ = controller.cycle(period * k, q, dq)
            for _ in range(4):
                dq = dq + 0.25 * period * np.array(arm.forward_dynamics(q, dq, tau))
                q = q + 0.25 * period * dq
            assert (np.abs(dq) <= speeds).all(), (k, np.abs(dq) / speeds)


def begun(arm: vff.Arm, law: dict[str, Any], period: float) -> vff.Controller:
    """A controller in a loop."""
    controller = vff.Controller(arm, law, period)
    controller.begin(period)
    return controller


def moved(arm: vff.Arm, period: float, q: Any, dq: Any, tau: Any) -> Any:
    """Where a torque has an arm after a period, and how fast."""
    dq = dq + period * np.array(arm.forward_dynamics(q, dq, tau))
    return q + period * dq, dq


@pytest.mark.parametrize("missed", [0, 6])
def test_what_has_braked_an_arm_does_not_throw_it_back(missed: int) -> None:
    """A joint comes to rest that was braked since it was too fast, or no states came: not behind that."""
    arm, period = vff.Arm.named("panda"), 1e-3
    law = {"task": "position", "stiffness": 100.0, "damping": 20.0, "null_damping": 8.0}
    controller = begun(arm, law, period)
    q, dq = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]), np.zeros(7)
    dq[0] = 1.0 if missed else 2.2 * arm.velocity_limits[0]
    phases, speeds = [], []
    for k in range(1200):
        state = (None, None, None) if 0 < k <= missed else (period * k, q, dq)
        tau, phase = controller.cycle(*state)
        phases.append(phase)
        q, dq = moved(arm, period, q, dq, tau)
        speeds.append(dq[0])
    assert "damping" in phases and phases[-1] == "running"
    assert min(speeds) > -0.02 and speeds[-1] < 0.1


@pytest.mark.parametrize("blend", [0.5, 2.0])
def test_a_chain_does_not_fall_while_its_law_is_blended_in(blend: float) -> None:
    """Twelve links that stand upright: the torque that held them where they were lets them fall."""
    arm, period = vff.Arm.uniform(12, length=0.12, mass=0.5, gravity=9.81), 1e-3
    law = {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0, "command": {"blend_time": blend}}
    controller = begun(arm, law, period)
    begin = np.array([np.pi / 2] + [0.0] * 11)
    q, dq, random = begin, np.zeros(12), np.random.default_rng(1)
    for k in range(int((blend + 0.2) / period)):
        noise = 1e-5 * random.standard_normal(12)
        q, dq = moved(arm, period, q, dq, controller.cycle(period * k, q + noise, dq)[0])
        assert np.abs(q - begin).max() < 3e-3, k


@pytest.mark.parametrize("period", [2e-3, 5e-4, 1e-4])
def test_an_arm_stands_for_a_while_until_it_has_stopped(period: float) -> None:
    """However short a period is: a weight that nobody knows of is held by then."""
    arm = vff.Arm.uniform(3, gravity=9.81)
    heavier = vff.Arm.uniform(3, gravity=9.81, mass=1.05)
    controller = begun(arm, {"command": {"blend_time": 0.0}}, period)
    q, dq = np.array([0.4, 0.5, 0.6]), np.zeros(3)
    controller.stop()
    k, phase = 0, ""
    while phase != "finished":
        tau, phase = controller.cycle(period * k, q, dq)
        (q, dq), k = moved(heavier, period, q, dq, tau), k + 1
        assert period * k < 4.0
    assert period * k > 0.2
    for _ in range(int(0.3 / period)):  # a robot goes on with what it was sent last
        q, dq = moved(heavier, period, q, dq, tau)
    assert np.abs(dq).max() < 0.1


def test_questions_do_not_move_an_arm() -> None:
    """What is asked of a controller with other states leaves the arm that its loop damps where it is."""
    loop = Loop()
    loop.x = loop.arm.forward_kinematics(loop.q)[-1]
    loop.controller.begin(PERIOD)
    for _ in range(600):
        loop.cycle()
    for k in range(300):
        loop.controller.terms(loop.q, np.full(7, 3.0), loop.x, t=loop.t)
        loop.controller.torque(loop.q + 0.5, np.full(7, -3.0), loop.x, t=k)
        tau, phase = loop.controller.cycle()
        assert phase == ("holding" if k < 4 else "damping") and np.abs(tau).max() < 1e-3


def test_limits_bind_what_is_sent() -> None:
    """With gravity added by the robot: what is sent, and what the drives have to do with it."""
    most = np.array([87.0] * 4 + [12.0] * 3)
    for avoidance in ("null_space", "relaxed", "priority", "cbf"):
        settings = {"avoidance": avoidance, "command": {"gravity": "robot"}}
        arm = vff.Arm.named("panda")
        controller = vff.Controller(arm, settings)
        x, g = arm.forward_kinematics(READY)[-1], arm.gravity_torque(READY)
        for push in (-1e4, 1e4):
            tau = controller.torque(READY, np.full(7, 0.1), x, [0.0] * 3, [0.0, 0.0, push])
            assert (np.abs(tau) <= most + 1e-9).all()
            assert (np.abs(tau + g) <= most + 1e-9).all()


@pytest.mark.parametrize("command", ["of the robot", {"gravity": "robot"}])
@pytest.mark.parametrize("avoidance", ["null_space", "cbf"])
def test_torque_limits_beside_gravity_of_the_robot_cost_no_speed(command: Any, avoidance: str) -> None:
    """Where the robot adds gravity, less of a torque limit is left on one side. A UR5e whose shoulder has no
    more to give brakes its wrist with what there is: to cut one joint alone would bend all.
    """
    arm = vff.Arm.named("ur5e")
    given: Any = {
        "arm": {"model": "ur5e"},
        "q0": [-1.223632, 2.604275, -0.001712, -2.305708, -1.358001, 0.205243],
        "dq0": [0.176219, 0.039666, -1.634423, 2.989387, -1.058839, -0.086774],
        "duration": 0.5,
        "reference": {"kind": "setpoint", "point": [-0.328048, -0.177853, -0.51418]},
        "controller": {
            "task": "position",
            "stiffness": 900.0,
            "damping": 20.0,
            "null_damping": 12.0,
            "avoidance": avoidance,
            "command": command,
        },
        "simulation": {"dt": 0.002, "control": "hold", "record_every": 1},
    }
    result = vff.simulate(vff.Scenario.from_dict(given))
    assert result.tau_applied is not None and arm.velocity_limits is not None
    speeds = np.abs(result.dq) / arm.velocity_limits
    assert speeds.max() < 1.01, speeds.max(axis=0)
    np.testing.assert_allclose(result.tau_applied, result.tau, atol=1e-6)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e3])
def test_states_that_cannot_be(wrong: float) -> None:
    """They are values, not exceptions; arrays of a wrong shape are mistakes of the program."""
    loop = Loop()
    loop.controller.begin(PERIOD)
    loop.cycle()
    q = loop.q.copy()
    q[3] = wrong
    tau, phase = loop.controller.cycle(loop.t, q, loop.dq, loop.x)
    assert phase == "holding" and np.isfinite(tau).all()
    with pytest.raises(InputError):
        loop.controller.cycle(loop.t, q[:6], loop.dq, loop.x)
    with pytest.raises(InputError, match="x_ref"):
        loop.controller.cycle(loop.t, loop.q, loop.dq, [np.nan] * 3)
    assert loop.cycle() == "starting"


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, 0.2])
def test_periods_that_cannot_be(period: float) -> None:
    """The last one is too long for a damping of 10 1/s."""
    controller = Loop().controller
    with pytest.raises(InputError, match="period"):
        controller.begin(period)
    assert controller.phase is None


def test_torque_is_what_is_sent() -> None:
    """But for its rate; the terms are those of the law."""
    loop = Loop()
    tau = loop.controller.torque(loop.q, loop.dq, loop.x)
    terms = loop.controller.terms(loop.q, loop.dq, loop.x)
    assert np.allclose(tau, terms.tau - loop.arm.gravity_torque(loop.q), rtol=0, atol=1e-12)
    assert np.allclose(terms.tau, terms.tau_task + terms.tau_null, rtol=0, atol=1e-12)
