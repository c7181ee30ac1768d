"""Margins of pairs: what is kept from an obstacle, and by a link, that has one of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull.errors import ScenarioError
from vffnull.robots.simulated import SimulatedRobot
from waiting import HANG

SWEEP = vff.Scenario.load("panda-sweep").replace(duration=4.0)
ON_PATH = vff.Scenario.load("on-path")
HAND = "panda_link7"
WAYS: dict[str, dict[str, Any]] = {
    "cbf": {"avoidance": "cbf"},
    "priority": {"avoidance": "priority"},
    "preview": {"avoidance": "cbf", "yielding": {"preview": {}}, "deadline": "unlimited"},
}
SELF_MOTION = {
    "avoidance": "cbf",
    "yielding": {"preview": {"self_motion": {"clearance": 0.03}}},
    "deadline": "unlimited",
}


def run(scene: vff.Scenario, way: str, **margins: Any) -> vff.Result:
    """With these margins of all obstacles."""
    law = {f"controller.{key}": value for key, value in (WAYS | {"self-motion": SELF_MOTION})[way].items()}
    # A field pushes farther away than margins are.
    quiet = {"controller.field.gain": 0.0}
    obstacles = [each | margins for each in scene.to_dict()["obstacles"]]
    return vff.simulate(scene.replace(obstacles=obstacles, **law, **quiet))


def by_link(scene: vff.Scenario, q: NDArray[Any], obstacle: Any) -> dict[str, float]:
    """How near links are at `q`, measured by another way than that of law and planner."""
    found = vff.distances(scene.arm, q, np.zeros_like(q), [obstacle])
    arm = scene.arm.to_dict()
    links = {joint["link"] for joint in arm["joints"]}
    moving = [each["link"] for each in arm["collision"] if each["link"] in links]
    least: dict[str, float] = {}
    for link, distance in zip(moving, np.ravel(found.distance), strict=True):
        least[link] = min(least.get(link, np.inf), float(distance))
    return least


def nearest(result: vff.Result) -> float:
    return float(result.clearance.min())


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("scene", [ON_PATH, SWEEP], ids=["plane", "space"])
def test_an_obstacle_has_its_own(scene: vff.Scenario, way: str) -> None:
    """More than usual and less, whichever is asked for."""
    usual = nearest(run(scene, way))
    assert usual < 0.05
    assert nearest(run(scene, way, margin=0.09)) > 0.088
    near = nearest(run(scene, way, margin=0.005))
    assert 0.004 < near < usual - 0.01


def test_a_self_motion_has_it() -> None:
    """The path that is searched keeps what is to be kept, beside which the elbow gives way no more."""
    margins = (0.005, 0.02, 0.09)
    found = [run(SWEEP, "self-motion", margin=margin) for margin in margins]
    assert nearest(found[0]) < nearest(found[1]) < nearest(found[2]) and nearest(found[2]) >= 0.09


@pytest.mark.parametrize("way", WAYS)
def test_links_have_their_own_in_the_plane(way: str) -> None:
    """The last one comes near, and the others keep what is asked of all."""
    found = run(ON_PATH, way, margin=0.09, margins={"link_6": 0.005})
    assert 0.004 < found.clearance[:, 5].min() < 0.07
    assert found.clearance[:, :5].min() > 0.088


@pytest.mark.parametrize("way", WAYS)
def test_links_have_their_own_in_space(way: str) -> None:
    """The ball sweeps through the elbow, which keeps little, and past others."""
    elbow = {link: 0.005 for link in ("panda_link3", "panda_link4")}
    found = run(SWEEP, way, margin=0.09, margins=elbow)
    least = found.clearance.min(axis=0)
    assert 0.004 < least[2:4].min() < 0.06
    assert np.delete(least, [2, 3]).min() > 0.088


def table_under_the_hand(gap: float) -> vff.Obstacle:
    """As far below the hand of `SWEEP` at its start."""
    q = np.array(SWEEP["q0"])
    ground = vff.Obstacle.half_space([0.0, 0.0, -1.0], [0.0, 0.0, 1.0])
    height = by_link(SWEEP, q, ground)[HAND] - 1.0
    return vff.Obstacle.half_space([0.0, 0.0, height - gap], [0.0, 0.0, 1.0])


def held(table: vff.Obstacle, way: str) -> float:
    """How far off the hand is at last that is to stay where it is above a table [m]."""
    low = [f"panda_link{i}" for i in range(1, 7)]  # the base stands in it
    scene = SWEEP.replace(obstacles=[table.ignored_by(*low)], duration=1.5)
    law = {f"controller.{key}": value for key, value in WAYS[way].items()}
    done = vff.simulate(scene.replace(**law, **{"controller.field.gain": 0.0}))
    assert done.status == "completed"
    return float(np.linalg.norm(done.error[-1][:3]))


@pytest.mark.parametrize("way", WAYS)
def test_look_ahead_leaves_a_hand_where_it_may_be(way: str) -> None:
    """8 mm above a table: less than the half of the usual margin, which is a contact to come otherwise."""
    table = table_under_the_hand(0.008)
    assert held(table, way) > 0.005
    assert held(table.with_margin(0.05, {HAND: 0.005}), way) < 1e-3


NEAR: dict[str, Any] = {
    "name": "near",
    "duration": 6.0,
    "q0": [0.3, 0.9, 0.7, -0.4],
    "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
    "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 6.0},
    "reference": {"kind": "setpoint", "point": [1.0, 1.0]},
    "simulation": {"dt": 1e-3, "integrator": "semi_implicit_euler", "control": "hold"},
    "obstacles": [],
}
AWAY = [2.6, 0.2, 0.2, 0.2]
POST = vff.Obstacle.circle([-0.4, 3.0], 0.2)


def beside(q: list[float], gap: float) -> vff.Obstacle:
    """A disc beside the tip of the arm at `q`, that far from it."""
    ends = vff.Scenario.from_dict(NEAR).arm.forward_kinematics(q)
    along = ends[-1] - ends[-2]
    return vff.Obstacle.circle(ends[-1] + np.array([along[1], -along[0]]) * (0.25 + gap), 0.2)


def among(*obstacles: vff.Obstacle) -> vff.Scenario:
    return vff.Scenario.from_dict({**NEAR, "obstacles": [each.to_dict() for each in obstacles]})


def apart(plan: vff.Plan, scene: vff.Scenario) -> NDArray[Any]:
    """The distances of links and obstacles every half of a millisecond."""
    times = np.arange(0.0, plan.duration, 5e-4)
    q, dq, _ = plan.at(times)
    shapes = [{key: each[key] for key in ("shape", "position")} for each in scene["obstacles"]]
    found = vff.distances(scene.arm, q, dq, shapes).distance
    return np.asarray(found).reshape(len(times), scene.arm.n, -1)


def test_a_plan_keeps_it() -> None:
    """All of the margin on straight parts, half of it where corners are rounded, as of any."""
    least = {}
    for margin in (None, 0.2):
        scene = among(POST.with_margin(margin))
        plan = vff.plan(scene, AWAY)
        assert plan.status == "found" and "less than" not in plan.message
        least[margin] = apart(plan, scene).min()
    assert 0.1 <= least[0.2] and least[None] < 0.1


def test_a_plan_keeps_it_by_link() -> None:
    scene = among(POST.with_margin(0.2, {"link_4": 0.005}))
    plan = vff.plan(scene, AWAY)
    assert plan.status == "found"
    found = apart(plan, scene)[..., 0].min(axis=0)
    assert found[:3].min() >= 0.1 and 0.0025 <= found[3] < 0.1


def test_a_goal_that_has_it_is_no_exception() -> None:
    """8 mm beside a disc that the last link may come near to by 5 mm; without leave, all keep less there."""
    disc = beside(AWAY, 0.008)
    assert (
        "less than the margin of 20.0 mm is kept: 7.2 mm at the goal" in vff.plan(among(disc), AWAY).message
    )
    assert "less than" not in vff.plan(among(disc.with_margin(links={"link_4": 0.005})), AWAY).message
    lowered = vff.plan(among(disc.with_margin(0.1)), AWAY)
    assert lowered.status == "found"
    assert "less than the margins is kept: 7 % at the goal" in lowered.message


@pytest.mark.parametrize("margin", [0.0, 0.005, 0.04])
def test_what_a_plan_says_is_kept(margin: float) -> None:
    """Whatever was asked of the planner: metres, and of a margin of its own a share."""
    obstacles = [beside(AWAY, 0.004).with_margin(0.1, {"link_4": 0.005}), POST.with_margin(0.15)]
    scene = among(*obstacles)
    plan = vff.plan(scene, AWAY, margin=margin, speed=0.25)  # slow: what a piece passes is off what it keeps
    assert plan.status == "found", plan.message
    times = np.arange(0.0, plan.duration, 5e-4)
    piece = np.searchsorted(plan.t, times, side="right") - 1
    said = np.minimum(plan.shares[piece], plan.shares[piece + 1])
    own = np.array([[0.1, 0.15]] * 3 + [[0.005, 0.15]])
    kept = said[..., None] * own
    found = apart(plan, scene)
    assert (found >= kept).all() and said.max() <= 1.0
    assert plan.margins.min() > 0.15, "from what has none of its own, and is nowhere"
    assert kept[-1, 3, 0] > 0.0 and kept[..., 1].max() > 0.07, "and it says something"


@pytest.mark.parametrize("avoidance", ["cbf", "priority"])
@pytest.mark.parametrize("gap", [0.008, 0.003])
def test_a_plan_is_followed_to_where_it_leads(avoidance: str, gap: float) -> None:
    """Also where the goal has less, and nothing is thought to be in the way."""
    scene = among(beside(AWAY, gap).with_margin(0.1, {"link_4": 0.005}), POST.with_margin(0.1))
    plan = vff.plan(scene, AWAY)
    changes: dict[str, Any] = {"controller.avoidance": avoidance, "controller.posture_stiffness": 200.0}
    changes |= {"reference": plan.reference, "duration": round(plan.duration + 3.0, 3), "replan": {}}
    followed = vff.simulate(scene.replace(**changes))
    assert abs(followed.error[-1]).max() < 1e-3 and followed.metrics.min_clearance > 0.5 * gap
    assert followed.replans == ()


@pytest.mark.parametrize("planned", [0.005, 0.02, 0.1])
@pytest.mark.parametrize("kept", [0.005, 0.1])
@pytest.mark.parametrize("pose", [False, True], ids=["configuration", "position"])
def test_a_plan_is_followed_by_whatever_law(planned: float, kept: float, pose: bool) -> None:
    """What comes is kept off by all of its margin, whatever the usual one was when the plan was made, and
    whatever the goal was given as."""
    scene = among(POST.with_margin(0.1)).replace(**{"controller.yielding.margin": planned})
    to = scene.arm.forward_kinematics(AWAY)[-1] if pose else AWAY
    plan = vff.plan(scene, to)
    # Along the last link from its side, to where it would be 3 cm from it.
    ends = scene.arm.forward_kinematics(plan.q[-1])
    along = (ends[-1] - ends[-2]) / np.linalg.norm(ends[-1] - ends[-2])
    middle, aside = 0.5 * (ends[-1] + ends[-2]), np.array([along[1], -along[0]])
    times = [plan.duration, plan.duration + 2.0]
    way = [(middle + aside * far).tolist() for far in (1.2, 0.28)]
    moving = {"kind": "waypoints", "times": times, "points": way, "interpolation": "smooth"}
    comes = vff.Obstacle.circle(way[0], 0.2).with_margin(0.1).to_dict() | {"motion": moving}
    changes: dict[str, Any] = {"reference": plan.reference, "duration": round(plan.duration + 3.0, 3)}
    changes |= {"controller.avoidance": "cbf", "controller.posture_stiffness": 200.0}
    changes |= {"controller.yielding.margin": kept}
    done = vff.simulate(scene.replace(obstacles=[*scene["obstacles"], comes], **changes))
    assert 0.098 < done.metrics.min_clearance < 0.102


@pytest.mark.parametrize("kept", [0.005, 0.02, 0.05])
@pytest.mark.parametrize(("gap", "is_blocked"), [(0.03, True), (0.06, False)])
def test_a_plan_is_blocked_by_less_than_half_of_it(kept: float, gap: float, is_blocked: bool) -> None:
    """45 % of its own margin of 10 cm, whatever the law keeps from others."""
    plan = vff.plan(among(), AWAY)
    near, far = gap, 1.0
    for _ in range(20):  # from all of the plan, which comes nearer on its way
        middle = 0.5 * (near + far)
        is_near = apart(plan, among(beside(AWAY, middle))).min() < gap
        near, far = (middle, far) if is_near else (near, middle)
    beside_goal = beside(AWAY, far).to_dict()
    appears = beside_goal | {
        "margin": 0.1,
        "position": [9.0, 9.0],
        "motion": {"kind": "waypoints", "times": [0.1, 0.2], "points": [[9.0, 9.0], beside_goal["position"]]},
    }
    changes: dict[str, Any] = {"reference": plan.reference, "replan": {}, "obstacles": [appears]}
    changes |= {"controller.yielding.margin": kept, "controller.posture_stiffness": 200.0}
    changes |= {"duration": 0.6}
    done = vff.simulate(among().replace(**changes))
    assert bool(done.replans) == is_blocked, done.replans


def test_what_comes_is_kept_away() -> None:
    """A plan that leads past something to be kept away from is left, and others to be let near are not."""
    scene = among(beside(AWAY, 0.008))
    plan = vff.plan(scene, AWAY)
    comes = POST.with_margin(0.3).to_dict()
    changes = {"reference": plan.reference, "controller.avoidance": "cbf", "replan": {}, "duration": 8.0}
    changes |= {"controller.posture_stiffness": 200.0}
    left = vff.simulate(scene.replace(obstacles=[*scene["obstacles"], comes], **changes))
    assert left.replans and left.replans[0].reason == "blocked"


def test_who_is_meant() -> None:
    """A margin is a positive number, of a link that there is and that keeps something; points have none."""
    ball = SWEEP["obstacles"][0]
    wrong: list[tuple[Mapping[str, Any], str]] = [
        ({"margin": -0.1}, r"obstacles\[0\]\.margin: must be greater than 0, got -0.1"),
        ({"margin": 0.0}, r"obstacles\[0\]\.margin: "),
        ({"margin": float("nan")}, r"obstacles\[0\]\.margin: "),
        ({"margin": float("inf")}, r"obstacles\[0\]\.margin: "),
        ({"margin": "near"}, r"obstacles\[0\]\.margin: "),
        ({"margins": {HAND: -1.0}}, rf"obstacles\[0\]\.margins\.{HAND}: must be greater than 0"),
        ({"margins": {HAND: float("nan")}}, rf"obstacles\[0\]\.margins\.{HAND}: "),
        ({"margins": {HAND: "near"}}, rf"obstacles\[0\]\.margins\.{HAND}: .*number"),
        ({"margins": [0.1]}, r"obstacles\[0\]\.margins: "),
        ({"margins": {"panda_hand": 0.1}}, r"obstacles\[0\]\.margins\.panda_hand: .*panda_link7"),
        ({"margins": {HAND: 0.1}, "ignore": [HAND]}, rf"obstacles\[0\]\.margins\.{HAND}: .*`ignore`"),
    ]
    for said, expected in wrong:
        with pytest.raises(ScenarioError, match=expected):
            SWEEP.replace(obstacles=[ball | said])
    for said, key in (({"margin": 0.1}, "margin"), ({"margins": {HAND: 0.1}}, "margins")):
        with pytest.raises(ScenarioError, match=f"{key}: needs obstacles that are known"):
            SWEEP.replace(obstacles=[ball | said], perception={"kind": "range", "range": 1.0})
    with pytest.raises(ScenarioError, match=r"margins\.a: "):
        vff.Obstacle.sphere([0, 0, 0], 0.1).with_margin(links={"a": 0.0})


def test_it_is_written_and_read() -> None:
    ball = vff.Obstacle.sphere([0.0, 2.0, 2.0], 0.05).with_margin(0.1, {HAND: 0.005, "load": 0.02})
    scene = SWEEP.replace(obstacles=[ball])
    assert scene["obstacles"][0]["margin"] == 0.1
    assert scene["obstacles"][0]["margins"] == {HAND: 0.005, "load": 0.02}
    assert vff.Scenario.from_dict(scene.to_dict()) == scene
    assert (
        "margin=0.1" in repr(ball) and HAND in repr(ball) and hash(ball) == hash(ball.with_margin(*_of(ball)))
    )


def _of(ball: vff.Obstacle) -> tuple[float | None, dict[str, float]]:
    return ball.margin, dict(ball.margins)


def test_while_it_runs() -> None:
    """What is added later has margins, too, and a name that no link has is told."""
    scene = SWEEP.replace(obstacles=[], duration=0.3, **{"controller.avoidance": "cbf"})
    near = table_under_the_hand(0.015).ignored_by(*(f"panda_link{i}" for i in range(1, 7)))
    moved = {}
    for margin in (0.005, 0.03):
        with vff.drive(SimulatedRobot(scene), scene, seconds=0.3) as drive:
            with pytest.raises(ScenarioError, match=r"margins\.hand"):
                drive.set_obstacles([near.with_margin(links={"hand": 0.1})])
            drive.set_obstacles([near.with_margin(links={HAND: margin})])
            assert drive.wait(HANG)
        moved[margin] = float(np.abs(np.subtract(drive.state.q, SWEEP["q0"])).max())
    assert moved[0.005] < 1e-4 < 1e-3 < moved[0.03]
