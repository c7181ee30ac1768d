"""Plans in the loop of a robot: `vff.drive` with a scenario follows them with tip and posture, waits, and
makes others.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from test_replan import STRAIGHT
from vffnull.errors import InputError, InputTypeError, ScenarioError
from vffnull.robots.emulated import franka
from vffnull.robots.franka import FrankaRobot
from vffnull.robots.simulated import SimulatedRobot
from vffnull.run import emulate as emulation
from waiting import HANG, wait_for

# What it does is not to depend on how busy the machine is.
SHELF = vff.Scenario.load("panda-shelf").replace(**{"controller.deadline": "unlimited"})
GOAL = SHELF["reference"]["points"][-1]
BLOCKED: dict[str, Any] = {
    "duration": 8.0,
    "q0": [0.2, 0.3, 0.3, 0.3],
    "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
    "controller": {
        "stiffness": 100.0,
        "damping": 20.0,
        "null_damping": 10.0,
        "posture_stiffness": 200.0,
        "avoidance": "cbf",
    },
    "reference": {
        "kind": "plan",
        "times": [0.0, 4.0],
        "points": [[0.2, 0.3, 0.3, 0.3], [1.8, 0.3, 0.3, 0.3]],
    },
    "obstacles": [{"shape": {"kind": "circle", "radius": 0.2}, "position": [0.5, 2.9]}],
    "replan": {"latency": 0.25},
}

GOAL_OF_LINE = STRAIGHT["reference"]["end"]


def recorded(scene: vff.Scenario, path: Path, seconds: float) -> Any:
    with vff.drive(SimulatedRobot(scene), scene, seconds=seconds, record_to=path, record_every=1) as driven:
        assert driven.wait(HANG)
    assert driven.report.status == "completed", driven.report.reason
    return vff.StreamRecorder.read(path).to_pandas()


def test_an_emulated_franka_gets_out_of_the_shelf() -> None:
    """From one compartment to the next, past the ball, without a reflex: the plan waits, the arm arrives."""
    there = franka.Robot(SHELF)
    least = [there.body.clearance]
    there.before_state = lambda _: least.append(there.body.clearance)
    with vff.drive(FrankaRobot(there), SHELF, seconds=SHELF.duration + 0.5) as driven:
        assert driven.wait(HANG)
        state = driven.state
    assert driven.report.status == "completed" and there.reflex is None
    assert state.path_time is not None and state.q_plan is not None
    assert SHELF["reference"]["times"][-1] < state.path_time < state.t - 0.53, "the ball is waited for"
    np.testing.assert_allclose(state.q_plan, GOAL, atol=1e-9)
    assert np.linalg.norm(state.x[:3] - SHELF.arm.pose(GOAL)[0]) < 2e-3
    assert abs(state.q - GOAL).max() < 0.05
    assert min(least) > 0.0


LIFTED, PUT_DOWN = 1.5, 4.0  # s
REJECT: dict[str, Any] = {
    "controller.observer": {},
    "controller.touch": {"task": "reject", "null_space": "reject"},
}


def carried(way: str, path: Path) -> float:
    """By how much the hand is lower than it is to be with a kilogram, as the force that it is, in the mean
    [m]; it trips nothing, nothing is touched, and the plan is followed to its end.
    """
    weight = {"link": "tip", "force": [0.0, 0.0, -9.81], "start": LIFTED, "duration": PUT_DOWN - LIFTED}
    there = franka.Robot(SHELF.replace(wrenches=[] if way == "nothing" else [weight]))
    scene = SHELF.replace(**REJECT) if way == "observed" else SHELF
    least: list[float] = []
    there.before_state = lambda robot: least.append(robot.body.clearance)
    seconds = SHELF.duration + 0.5
    with vff.drive(FrankaRobot(there), scene, seconds=seconds, record_to=path, record_every=1) as driven:
        assert driven.wait(HANG)
        state = driven.state
    assert driven.report.status == "completed", driven.report.reason
    assert there.reflex is None and min(least) > 0.0
    assert state.path_time is not None and state.path_time > SHELF["reference"]["times"][-1]
    assert np.linalg.norm(state.x[:3] - SHELF.arm.pose(GOAL)[0]) < 2e-3
    rows = vff.StreamRecorder.read(path).to_pandas()
    part = rows[(rows["t"] > LIFTED + 0.5) & (rows["t"] < PUT_DOWN)]
    return float((part["x_ref_z"] - part["x_z"]).mean())


def test_a_load_is_taken_up_and_put_down_on_the_way_out(tmp_path: Path) -> None:
    """Where it is observed the hand is as high as without. A Franka is told of no load while it moves."""
    ways = ("nothing", "nobody knows", "observed")
    sunk = {way: carried(way, tmp_path / f"{way}.arrows") for way in ways}
    assert sunk["nobody knows"] - sunk["nothing"] > 5e-3
    assert abs(sunk["observed"] - sunk["nothing"]) < 1e-3


def test_it_goes_where_the_simulation_goes(tmp_path: Path) -> None:
    """Without the ball: the same motion, half a second later, with the posture of the plan."""
    scene = SHELF.replace(obstacles=SHELF["obstacles"][:4])
    rows = recorded(scene, tmp_path / "drive.arrows", 4.5)
    seen = vff.simulate(scene.replace(duration=4.0, **{"simulation.record_every": 1}))
    assert seen.path_time is not None and seen.q_plan is not None
    joints, planned = (rows.filter(regex=f"^{name}_[0-9]").to_numpy() for name in ("q", "q_plan"))
    path_time = rows["path_time"].to_numpy()
    assert path_time[400] == 0.0 and (np.diff(path_time[:4500]) >= 0.0).all()
    begins = int(np.searchsorted(path_time, 1e-9)) - 1
    assert rows["t"][begins] == pytest.approx(0.5, abs=3e-3)
    length = 3900
    np.testing.assert_allclose(planned[begins : begins + length], seen.q_plan[:length], atol=5e-3)
    assert abs(joints[begins : begins + length] - seen.q[:length]).max() < 0.02
    off = (
        rows[[f"x_{axis}" for axis in "xyz"]].to_numpy()
        - rows[[f"x_ref_{axis}" for axis in "xyz"]].to_numpy()
    )
    assert np.linalg.norm(off[begins : begins + length], axis=1).max() < 0.02


def test_a_robot_elsewhere_is_not_driven_there() -> None:
    """It would be pulled through whatever is in between."""
    elsewhere = SHELF.replace(q0=[*SHELF["q0"][:3], SHELF["q0"][3] + 0.2, *SHELF["q0"][4:]])
    robot = SimulatedRobot(elsewhere)
    with pytest.warns(RuntimeWarning, match="the plan begins elsewhere"), vff.drive(robot, SHELF) as driven:
        assert driven.wait(HANG)
    assert driven.report.status == "fault" and driven.report.periods == 0
    assert "joint 3 is at -2.401, the plan has it at -2.601" in driven.report.reason
    assert robot.read()[0] == 0.0


def test_another_plan_is_made() -> None:
    """A disc is in the way: the search has a thread of its own, and the tip arrives."""
    goal = vff.Scenario.from_dict(BLOCKED).arm.forward_kinematics(BLOCKED["reference"]["points"][-1])[-1]
    with vff.drive(SimulatedRobot(BLOCKED), BLOCKED) as driven:
        wait_for(lambda: np.linalg.norm(driven.state.x - goal) < 1e-3 or not driven.running)
    taken = [each for each in driven.report.replans if each.taken is not None]
    assert driven.report.status == "stopped" and taken
    assert (taken[0].reason, taken[0].status) == ("blocked", "found")
    assert driven.report.to_dict()["replans"][0]["asked"] == driven.report.replans[0].asked
    with vff.drive(SimulatedRobot(BLOCKED), vff.Scenario.from_dict(BLOCKED).replace(replan=None)) as alone:
        wait_for(lambda: (alone.state.path_time or 0.0) > 4.5)
    assert alone.report.replans == () and np.linalg.norm(alone.state.x - goal) > 0.05


class Servo:
    """A robot that is wherever it is told to be."""

    command = "position"

    def __init__(self, q: Any) -> None:
        self.t, self.q, self.dq = 5.0, np.array(q), np.zeros(len(q))

    def read(self) -> Any:
        return self.t, self.q, self.dq

    def write(self, command: Any, /) -> None:
        self.q, self.dq = command.copy(), (command - self.q) / 1e-3
        self.t += 1e-3


def columns(log: Any, name: str) -> Any:
    return log[[f"{name}_{i}" for i in range(7) if f"{name}_{i}" in log]].to_numpy()


def test_set_points_refuse_a_plan_that_they_cannot_follow(tmp_path: Path) -> None:
    """One that is within their limits is followed, and keeps from what it was planned around."""
    goal = SHELF["reference"]["points"][-1]
    slow = {"acceleration": 2.0, "jerk": 100.0}

    def limited(plan: vff.Plan, **limits: float) -> tuple[Servo, vff.Drive]:
        scene, robot = SHELF.replace(reference=plan.reference, replan=None), Servo(SHELF["q0"])
        seconds, most = plan.duration + 2.0, slow | limits
        return robot, vff.drive(robot, scene, seconds=seconds, limits=most, record_to=tmp_path / "log.arrows")

    quick = vff.plan(SHELF, goal, horizon=0)
    for says, limits in {
        "speed: the plan of the reference needs up to": {"acceleration": 50.0, "jerk": 5000.0, "speed": 0.1},
        "acceleration: the plan .* of joint": {"jerk": 5000.0},
        "jerk: the plan .* and 5 is allowed": {"acceleration": 50.0, "jerk": 5.0},
    }.items():
        with pytest.raises(InputError, match=f"limits: {says}"):
            limited(quick, **limits)
    plan = vff.plan(SHELF, goal, horizon=0, **slow)
    robot, driven = limited(plan)
    with driven:
        assert driven.wait(HANG)
    assert driven.report.status == "completed", driven.report.reason
    np.testing.assert_allclose(robot.q, goal, atol=0.02)
    log = vff.StreamRecorder.read(tmp_path / "log.arrows").to_pandas()
    assert np.nanmin(columns(log, "clearance")) > 0.5 * plan.clearance


def test_set_points_are_planned_for_within_their_limits(tmp_path: Path) -> None:
    """A disc is in the way: another plan is found beside the loop, and asks for no more than there is."""
    slow = {"speed": 0.8, "acceleration": 1.0, "jerk": 20.0}
    quiet = vff.plan(
        vff.Scenario.from_dict(BLOCKED).replace(obstacles=[], replan=None),
        BLOCKED["reference"]["points"][-1],
        speed=0.13,
        acceleration=4.0,
        jerk=40.0,
    )
    scene = vff.Scenario.from_dict(BLOCKED).replace(reference=quiet.reference)
    robot = Servo(BLOCKED["q0"])
    with vff.drive(
        robot, scene, seconds=30.0, limits=slow, record_to=tmp_path / "log.arrows", record_every=1
    ) as driven:
        assert driven.wait(HANG)
    assert driven.report.status == "completed", driven.report.reason
    taken = [each.taken for each in driven.report.replans if each.taken is not None]
    assert taken
    log = vff.StreamRecorder.read(tmp_path / "log.arrows").to_pandas()
    plan, q = columns(log, "q_plan"), columns(log, "q")
    pulls = abs(np.diff(plan, 2, axis=0)).max() / 1e-6
    assert 0.3 < pulls <= 1.0 + 1e-3 and np.nanmax(abs(q - plan)) < 2e-3
    assert np.nanmin(columns(log, "clearance")) > 0.0
    np.testing.assert_allclose(q[-1], plan[-1], atol=1e-3)


def test_a_target_takes_the_place_of_the_plan() -> None:
    """Given in the middle of the motion: the arm stops there, and holds no posture that moves on."""
    scene = vff.Scenario.from_dict(BLOCKED).replace(obstacles=[], replan=None)
    with vff.drive(SimulatedRobot(scene), scene) as driven:
        wait_for(lambda: (driven.state.path_time or 0.0) > 2.0)
        target = driven.state.x
        driven.set_target(target)
        begun = driven.state.t
        wait_for(lambda: driven.state.t > begun + 4.0)
        state = driven.state
    assert driven.report.status == "stopped"
    np.testing.assert_allclose(state.x, target, atol=1e-4)
    np.testing.assert_array_equal(state.x_ref, target)
    assert abs(state.dq).max() < 1e-3 and abs(state.tau_null).max() < 1e-2


def test_a_state_has_what_an_observer_estimates() -> None:
    scene = vff.Scenario.load("panda-sweep").replace(**{"controller.observer": {}})
    with vff.drive(SimulatedRobot(scene), scene, seconds=0.1) as driven:
        assert driven.wait(HANG)
        state = driven.state
    assert state.tau_ext_estimate is not None and state.tau_ext_estimate.shape == (7,)
    assert state.path_time == 0.0 and state.q_plan is None


def test_scenarios_are_taken_as_everywhere() -> None:
    """By name, as a document, with what the robot takes; what is none is refused before anything moves."""
    with vff.drive(SimulatedRobot("panda-sweep"), "panda-sweep", seconds=0.05) as driven:
        assert driven.wait(HANG) and driven.report.status == "completed"
        assert np.isfinite(driven.state.clearance).any(), "its obstacles are there"
    with vff.drive(SimulatedRobot("panda-sweep"), "panda-sweep", seconds=0.05, obstacles=[]) as driven:
        assert driven.wait(HANG) and np.isinf(driven.state.clearance).all()
    robot = SimulatedRobot(SHELF)
    for wrong in (3, {"stiffness": 1.0}, None):
        with pytest.raises(InputTypeError, match="expected a Controller or a scenario"):
            vff.drive(robot, wrong)  # type: ignore[arg-type]
    with pytest.raises(ScenarioError, match="duration"):
        vff.drive(robot, SHELF.to_dict() | {"duration": -1.0})


def test_emulations_follow_the_plan_with_its_posture() -> None:
    outcome = emulation.emulate("panda-shelf", seconds=1.5)
    assert outcome.fine and outcome.clearance is not None and outcome.clearance > 0.0


def test_a_line_that_leads_nowhere_is_left_for_a_plan() -> None:
    """A wall is in the way of the hand: a plan comes from the thread beside, and the tip arrives."""
    with vff.drive(SimulatedRobot(STRAIGHT), STRAIGHT) as driven:
        wait_for(lambda: driven.state.path_time is not None or driven.state.periods > 0)
        assert driven.state.q_plan is None
        wait_for(lambda: np.linalg.norm(driven.state.x - GOAL_OF_LINE) < 1e-3 or not driven.running)
        assert driven.state.q_plan is not None
    first = driven.report.replans[0]
    assert driven.report.status == "stopped" and (first.reason, first.status) == ("stuck", "found")
