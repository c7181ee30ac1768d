"""Contacts that are allowed: links are not measured against what they `ignore`, and all others are."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError
from vffnull.robots.simulated import SimulatedRobot
from waiting import HANG

LINKS = [f"panda_link{i}" for i in range(1, 8)]
SWEEP = vff.Scenario.load("panda-sweep").replace(duration=2.0)
BALL = SWEEP["obstacles"][0] | {"position": [-0.05, -0.35, 0.62]}
WAYS: dict[str, dict[str, Any]] = {
    "null_space": {},
    "cbf": {"avoidance": "cbf"},
    "priority": {"avoidance": "priority"},
    "relaxed": {"avoidance": "relaxed"},
    "preview": {"avoidance": "cbf", "yielding": {"preview": {}}, "deadline": "unlimited"},
    "self-motion": {
        "avoidance": "cbf",
        "yielding": {"preview": {"self_motion": {}}},
        "deadline": "unlimited",
    },
}


def swept(way: str, *balls: dict[str, Any]) -> vff.Result:
    law = {f"controller.{key}": value for key, value in WAYS[way].items()}
    return vff.simulate(SWEEP.replace(obstacles=list(balls), **law))


@pytest.mark.parametrize("way", WAYS)
def test_what_all_links_ignore_is_not_there(way: str) -> None:
    """And what others ignore is: the torque is the same to the last digits, whatever gives way."""
    far = {"shape": {"kind": "sphere", "radius": 0.05}, "position": [0.0, 2.0, 2.0]}
    without, ignored = swept(way, far), swept(way, BALL | {"ignore": LINKS}, far)
    np.testing.assert_allclose(ignored.tau, without.tau, atol=1e-9)
    np.testing.assert_array_equal(ignored.clearance, without.clearance)
    met = swept(way, BALL, far)
    assert np.abs(met.tau - without.tau).max() > 1.0, "the ball is in the way"
    np.testing.assert_array_equal(swept(way, BALL | {"ignore": ["load"]}, far).tau, met.tau)


@pytest.mark.parametrize("hulls", [False, True])
def test_a_cup_is_grasped(hulls: bool) -> None:
    """The hand goes over it, with capsules or hulls, and keeps away from its table; other links from both."""
    shapes = [dict(each) for each in SWEEP.arm.to_dict()["collision"]]
    for each in shapes if hulls else ():
        axis = np.array([each["shape"]["a"], each["shape"]["b"]])
        corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3.0)
        around = (axis[:, None] + each["shape"]["radius"] * corners).reshape(-1, 3)
        each["shape"] = {"kind": "convex", "vertices": around.tolist()}
    table = vff.Obstacle.box([0.55, 0.0, 0.1], [0.4, 1.0, 0.2])
    cup = vff.Obstacle.capsule([0.55, 0.15, 0.24], [0.55, 0.15, 0.32], 0.03)
    scene = vff.Scenario.load("panda-shelf").replace(
        obstacles=[table, cup],
        **{"arm.collision": shapes, "controller.avoidance": "cbf"},
    )
    over = {"position": [0.55, 0.15, 0.30], "orientation": [0.0, 1.0, 0.0, 0.0]}
    blocked = vff.plan(scene, over)
    assert blocked.status == "goal blocked" and "`ignore` of the obstacle" in blocked.message
    grasped = scene.replace(obstacles=[table, cup.ignored_by("panda_link7")])
    plan = vff.plan(grasped, over)
    assert plan.status == "found", plan.message
    moving = [each["link"] for each in shapes if each["link"] in LINKS]
    hand = np.array([link == LINKS[6] for link in moving])
    for q in plan.q:
        of_table, of_cup = (
            vff.distances(scene.arm, q, np.zeros(7), [each]).distance for each in (table, cup)
        )
        assert of_table.min() > 0.0 and of_cup[~hand].min() > 0.0
    assert of_cup[hand].min() < 0.0, "the hand is around the cup"
    seconds = float(np.ceil(plan.duration)) + 1.0
    done = vff.simulate(grasped.replace(reference=plan.reference, duration=seconds))
    assert done.status == "completed" and done.metrics.intrusion_time == 0.0
    assert done.metrics.end_error < 2e-3
    assert (
        not vff.simulate(scene.replace(reference=plan.reference, duration=seconds)).metrics.end_error < 1e-2
    )


def test_a_load_stands_on_its_table() -> None:
    """What is carried may touch it, and the hand that carries it may not."""
    scene = vff.Scenario.load("panda-shelf").replace(obstacles=[], duration=0.2)
    tray = {"kind": "box", "size": [0.3, 0.3, 0.02], "center": [0.0, 0.0, 0.05]}
    loaded = scene.replace(**{"arm.load": {"mass": 0.5, "shapes": [tray]}})
    place, turn = loaded.arm.pose(loaded["q0"])
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, turn)
    under = place + turned.reshape(3, 3) @ [0.0, 0.0, 0.065]  # half a centimetre inside the tray
    table = vff.Obstacle.box(under, [0.3, 0.3, 0.02], orientation=turn)
    goal = np.add(loaded["q0"], [0.6, 0, 0, 0, 0, 0, 0])
    for obstacle, status in (
        (table, "start blocked"),
        (table.ignored_by("panda_link7"), "start blocked"),
        (table.ignored_by("load"), "found"),
    ):
        assert vff.plan(loaded.replace(obstacles=[obstacle]), goal).status == status
    through = vff.Obstacle.box(
        place - turned.reshape(3, 3) @ [0.0, 0.0, 0.02], [0.3, 0.3, 0.02], orientation=turn
    )
    blocked = vff.plan(loaded.replace(obstacles=[through.ignored_by("load")]), goal)
    assert blocked.status == "start blocked" and "panda_link7" in blocked.message


def test_who_is_meant() -> None:
    """A name that no link has is told, wherever an obstacle comes from, and so is a law that sees points."""
    wrong, said = BALL | {"ignore": ["panda_hand"]}, r"obstacles\[0\].ignore\[0\].*panda_hand.*panda_link7"
    with pytest.raises(ScenarioError, match=said):
        SWEEP.replace(obstacles=[wrong])
    with pytest.raises(ScenarioError, match=r"ignore\[0\].*panda_hand"):
        law = vff.Controller(SWEEP.arm, {})
        law.torque(SWEEP["q0"], [0.0] * 7, [0.4, 0.0, 0.5], obstacles=[wrong])
    with pytest.raises(ScenarioError, match=r"ignore\[0\].*link_4"):
        vff.Scenario.load("narrow-gap").replace(
            obstacles=[
                {"shape": {"kind": "circle", "radius": 0.1}, "position": [3, 3], "ignore": ["link_4x"]}
            ]
        )
    with pytest.raises(ScenarioError, match=r"ignore: needs obstacles that are known"):
        SWEEP.replace(obstacles=[BALL | {"ignore": LINKS}], perception={"kind": "range", "range": 1.0})
    with pytest.raises(ScenarioError, match=r"expected a list"):
        SWEEP.replace(obstacles=[BALL | {"ignore": "panda_link7"}])


def test_while_it_runs() -> None:
    """What is grasped is told anew."""
    near = vff.Obstacle.sphere(SWEEP.arm.pose(SWEEP["q0"])[0], 0.05)
    scene = SWEEP.replace(obstacles=[])
    with vff.drive(SimulatedRobot(scene), scene, seconds=0.3) as drive:
        with pytest.raises(ScenarioError, match=r"ignore\[0\]"):
            drive.set_obstacles([near.ignored_by("hand")])
        drive.set_obstacles([near.ignored_by("panda_link6", "panda_link7")])
        assert drive.wait(HANG)
    assert drive.state.clearance[5:].min() == np.inf and np.isfinite(drive.state.clearance[4])


def test_what_resists_is_felt_all_the_same() -> None:
    """A contact that is allowed is one."""
    scene = vff.Scenario.load("panda-bump")
    felt = [each for each in scene["obstacles"] if "contact" in each]
    ignored = [each | {"ignore": LINKS} for each in felt]
    pressed = vff.simulate(scene.replace(obstacles=ignored))
    assert np.abs(pressed.contact_force).max() > 1.0 and pressed.metrics.intrusion_time == 0.0


def test_in_the_plane() -> None:
    """Links have numbers there."""
    scene = vff.Scenario.load("on-path")
    n = len(scene["q0"])
    without = vff.simulate(scene.replace(obstacles=[]))
    all_links = [f"link_{i + 1}" for i in range(n)]
    ignored = vff.simulate(scene.replace(obstacles=[e | {"ignore": all_links} for e in scene["obstacles"]]))
    np.testing.assert_allclose(ignored.q, without.q, atol=1e-9)
    assert np.isinf(ignored.clearance).all()
    assert np.abs(vff.simulate(scene).q - without.q).max() > 1e-3
