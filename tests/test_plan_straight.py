"""Straight ways to a goal and from a start, on which the end effector does not turn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from test_cli import vffnull
from test_plan import GAP
from test_plan_goals import rests
from vffnull.errors import InputError, InputTypeError, ScenarioError
from vffnull.evaluation.geometry.arm import rotation

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
DOWN = [0.0, 1.0, 0.0, 0.0]  # the tool's z points down
ARMS: dict[str, dict[str, Any]] = {
    "panda": {"arm": {"model": "panda"}, "q0": READY},
    "ur5e": {"arm": {"model": "ur5e"}, "q0": [0.0, -1.2, 1.8, -2.2, -1.57, 0.0]},
    "iiwa14": {"arm": {"model": "iiwa14"}, "q0": [0.0, 0.6, 0.0, -1.6, 0.0, 0.9, 0.0]},
}


def at_rest(name: str, **more: Any) -> dict[str, Any]:
    return {"duration": 1.0, "reference": {"kind": "setpoint"}, **ARMS[name], **more}


Stands = list[tuple[NDArray[Any], NDArray[Any]]]


def on_the_way(arm: vff.Arm, plan: vff.Plan, first: float, last: float) -> Stands:
    """Where the end effector is, and its axes, between two instants."""
    quaternions = [arm.pose(plan.at(t)[0]) for t in np.linspace(first, last, 300)]
    return [(np.array(place), axes(turned)) for place, turned in quaternions]


def axes(turned: Any) -> NDArray[Any]:
    if np.ndim(turned) == 0:
        c, s = np.cos(turned), np.sin(turned)
        return np.array([[c, -s], [s, c]])
    return rotation(turned)


def check_line(ways: Stands, along: NDArray[Any]) -> None:
    """It goes along this vector, within a tenth of a millimetre, and turns by no more than a milliradian."""
    (start, turned), length = ways[0], np.linalg.norm(along)
    np.testing.assert_allclose(ways[-1][0] - start, along, atol=1e-5)
    for place, now in ways:
        off = place - start
        assert np.linalg.norm(off - along * (off @ along) / length**2) < 1e-4
        assert -5e-5 < off @ along / length < length + 5e-5
        np.testing.assert_allclose(now, turned, atol=1e-3)


@pytest.mark.parametrize("name", ARMS)
def test_it_comes_and_goes_along_its_own_axis(name: str) -> None:
    scene = vff.Scenario.from_dict(at_rest(name))
    place, turned = scene.arm.pose(scene["q0"])
    goal = {"position": np.add(place, [-0.05, 0.2, -0.1]), "orientation": turned}
    plan = vff.plan(scene, goal, approach=0.1, retreat=0.06)
    assert plan.status == "found", plan.message
    (out, _), (_, into) = rests(plan)
    leaving, coming = (on_the_way(scene.arm, plan, *span) for span in ((0.0, out), (into, plan.duration)))
    check_line(leaving, -0.06 * leaving[0][1][:, 2])
    check_line(coming, 0.1 * coming[0][1][:, 2])
    np.testing.assert_allclose(scene.arm.pose(plan.q[-1])[0], goal["position"], atol=1e-6)
    np.testing.assert_allclose(coming[-1][1], axes(turned), atol=1e-5)
    for part in ("; straight from the start but for", "; straight to the goal but for"):
        assert plan.message.count(part) == 1
    limits = 0.5 * np.array(scene.arm.velocity_limits)
    times = np.linspace(0.0, plan.duration, 4000)
    _, dq, ddq = plan.at(times)
    assert (np.abs(dq) <= limits * (1 + 1e-9)).all() and np.abs(ddq).max() <= 5.0 * (1 + 1e-9)


@pytest.mark.parametrize("seed", range(12))
def test_it_comes_along_any_vector(seed: int) -> None:
    noise = np.random.default_rng(seed)
    scene = vff.Scenario.from_dict(at_rest("panda"))
    goal = np.array(READY) + noise.uniform(-0.4, 0.4, 7)
    along = noise.standard_normal(3)
    along *= noise.uniform(0.01, 0.12) / np.linalg.norm(along)
    plan = vff.plan(scene, goal, approach=along)
    assert plan.status == "found", plan.message
    ((_, into),) = rests(plan)
    check_line(on_the_way(scene.arm, plan, into, plan.duration), along)
    np.testing.assert_allclose(plan.q[-1], goal, atol=1e-12)


def test_in_the_plane_it_comes_along_the_last_link() -> None:
    arm = vff.Scenario.from_dict(GAP).arm
    plan = vff.plan(GAP, approach=0.15, retreat=[0.0, 0.05])
    (out, _), (_, into) = rests(plan)
    coming = on_the_way(arm, plan, into, plan.duration)
    check_line(coming, 0.15 * coming[0][1][:, 0])
    check_line(on_the_way(arm, plan, 0.0, out), np.array([0.0, 0.05]))


def test_a_lift_takes_part_in_it() -> None:
    scene = vff.Scenario.load("lift-cage").replace(obstacles=[])
    goal = np.array(scene["q0"])
    goal[0] += 0.1
    plan = vff.plan(scene, goal, approach=[0.0, 0.0, 0.05], horizon=0)
    assert plan.status == "found", plan.message
    ((_, into),) = rests(plan)
    check_line(on_the_way(scene.arm, plan, into, plan.duration), np.array([0.0, 0.0, 0.05]))


def gantry(wrist: float) -> dict[str, Any]:
    """Three joints that slide, and a wrist of this length [m]."""
    upright = [1.0, 0.0, 0.0, 0.0]
    body = {"mass": 1.0, "com": [0.0] * 3, "inertia": [0.1, 0.1, 0.1, 0.0, 0.0, 0.0], "orientation": upright}
    joints: list[dict[str, Any]] = []
    for kind, far in (("prismatic", 0.0), ("revolute", wrist / 3.0)):
        for axis in np.eye(3).tolist():
            joints.append(body | {"kind": kind, "position": [0.0, 0.0, far], "axis": axis})
            joints[-1] |= {"name": f"j{len(joints)}", "link": f"l{len(joints)}"}
    return {
        "joints": joints,
        "base": "base",
        "mount": {"position": [0.0] * 3, "orientation": upright},
        "tool": {"position": [0.0, 0.0, wrist / 3.0], "orientation": upright},
        "gravity": [0.0] * 3,
        "joint_limits": [[-50.0, 50.0]] * 3 + [[-2.0, 2.0]] * 3,
        "velocity_limits": [2.0] * 6,
    }


@pytest.mark.parametrize(("wrist", "way"), [(1.0, 2.0), (0.05, 2.0), (0.003, 80.0)])
def test_how_fast_it_comes_is_a_matter_of_the_joints_that_move(wrist: float, way: float) -> None:
    """Two metres took 36 s with a wrist of 5 cm, and 80 m with one of 3 mm took gigabytes."""
    scene = {"duration": 1.0, "q0": [39.0 - way, 0.0, 0.0, 0.1, 0.2, 0.3], "reference": {"kind": "setpoint"}}
    goal = [40.0, 0.0, 0.0, 0.1, 0.2, 0.3]
    plan = vff.plan(scene | {"arm": gantry(wrist)}, goal, approach=[way, 0.0, 0.0], speed=1.0)
    assert plan.status == "found", plan.message
    ((_, into),) = rests(plan)
    assert plan.duration - into < way / 1.4 + 1.0
    assert np.abs(plan.dq).max() <= 2.0 + 1e-12


def test_every_goal_of_several_is_come_to_and_left_so() -> None:
    scene = vff.Scenario.from_dict(at_rest("panda"))
    place = np.array(scene.arm.pose(READY)[0])
    goals = [{"position": place + by, "orientation": DOWN} for by in ([0.0, 0.2, -0.2], [0.05, -0.2, -0.2])]
    plan = vff.plan(scene, goals, approach=[0.0, 0.0, -0.08], retreat=[0.0, 0.0, 0.08], pause=0.4)
    assert plan.status == "found", plan.message
    stops = rests(plan)
    assert [round(end - start, 6) for start, end in stops] == [0.04, 0.04, 0.4, 0.04, 0.04]
    edges = [0.0, *(each for stop in stops for each in stop), plan.duration]
    spans = list(zip(edges[::2], edges[1::2], strict=True))
    for number, along in ((0, 0.08), (2, -0.08), (3, 0.08), (5, -0.08)):
        check_line(on_the_way(scene.arm, plan, *spans[number]), np.array([0.0, 0.0, along]))


def test_what_stands_in_its_way_is_named() -> None:
    """A shelf over the goal: the arm reaches in from the side, and not from above."""
    place = np.add(vff.Arm.named("panda").pose(READY)[0], [0.05, 0.4, -0.3])
    board = vff.Obstacle.box(np.add(place, [0.0, 0.0, 0.3]), size=[0.3, 0.3, 0.02]).to_dict()
    scene, goal = at_rest("panda", obstacles=[board]), {"position": place}
    free = vff.plan(scene, goal)
    assert free.status == "found"
    blocked = vff.plan(scene, free.q[-1], approach=[0.0, 0.0, -0.3])
    assert blocked.status == "goal blocked"
    assert "on the straight way to the goal" in blocked.message and "another direction" in blocked.message
    assert blocked.clearance < 0.02
    left = vff.plan(scene | {"q0": free.q[-1].tolist()}, READY, retreat=[0.0, 0.0, 0.3])
    assert left.status == "start blocked" and "on the straight way from the start" in left.message


def test_a_way_that_is_too_long_says_how_long_it_may_be() -> None:
    scene = at_rest("ur5e")
    plan = vff.plan(scene, scene["q0"], approach=[-2.0, 0.0, 0.0])
    assert plan.status == "goal out of reach" and 0.5 < plan.gap < 2.0
    assert f"can go {2.0 - plan.gap:.3f} m of 2.000 m" in plan.message
    plan = vff.plan(scene, scene["q0"], retreat=[2.0, 0.0, 0.0])
    assert plan.status == "start blocked" and "of 2.000 m" in plan.message


def test_none_is_needed_where_there_is_none_to_go() -> None:
    scene = at_rest("panda")
    assert vff.plan(scene, READY, approach=0.0, retreat=0.0).q.shape[1] == 7
    plans = [vff.plan(GAP, **more) for more in ({}, {"approach": 0.0, "retreat": [0.0, 0.0]})]
    np.testing.assert_array_equal(plans[0].q, plans[1].q)


@pytest.mark.parametrize(
    "given, error, part",
    [
        (-0.1, ScenarioError, "approach"),
        (np.inf, InputError, "approach"),
        (1e9, ScenarioError, "approach"),
        ([0.1], InputError, "expected 3 numbers"),
        ([0.1, 0.0], InputError, "expected 3 numbers"),
        ([[0.1, 0.0, 0.0]], InputError, "one row"),
        ("up", InputTypeError, "approach"),
    ],
)
def test_ways_of_no_use_are_named(given: Any, error: type[Exception], part: str) -> None:
    with pytest.raises(error, match=part):
        vff.plan(at_rest("panda"), READY, approach=given)


def test_the_command_line(tmp_path: Path) -> None:
    out = tmp_path / "plan.npz"
    done = vffnull("plan", "narrow-gap", "--approach", "0.1", "--retreat", "0,0.05", "--out", out)
    assert done.returncode == 0 and "straight to the goal but for" in done.stdout
    assert len(rests(vff.Plan.load(out))) == 2


def test_what_follows_such_a_plan_keeps_to_the_line() -> None:
    """By a law that only reacts, with barriers, among obstacles."""
    plan = vff.plan(GAP, approach=0.15)
    scene = {**GAP, "reference": plan.reference, "duration": np.ceil(plan.duration) + 1.0}
    scene["controller"] = {**GAP.get("controller", {}), "posture_stiffness": 200.0, "avoidance": "cbf"}
    result = vff.simulate(scene)
    ((_, into),) = rests(plan)
    assert result.status == "completed"
    assert np.abs(result.error[result.t >= into]).max() < 2e-3
