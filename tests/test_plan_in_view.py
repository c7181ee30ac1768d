"""Plans on which the end effector keeps a point in view."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vffnull as vff
from test_cli import vffnull
from test_plan import GAP
from test_plan_straight import DOWN, at_rest, axes
from vffnull.errors import InputError, InputTypeError, ScenarioError

TABLE = vff.Obstacle.box([0.5, 0.0, 0.05], size=[0.5, 0.9, 0.1]).to_dict()
POST = vff.Obstacle.box([0.5, 0.0, 0.4], size=[0.08, 0.08, 0.6]).to_dict()
POINT = [0.55, 0.0, 0.12]


def sight(arm: vff.Arm, q: Any, point: Any) -> float:
    """How far the point is off the axis of the end effector [rad]."""
    place, turned = arm.pose(q)
    to = np.array(point) - place
    front = axes(turned)[:, 0 if len(place) == 2 else 2]
    return float(np.arccos(np.clip(front @ to / np.linalg.norm(to), -1.0, 1.0)))


def off(arm: vff.Arm, plan: vff.Plan, point: Any) -> float:
    """The same at most along a plan."""
    return max(sight(arm, plan.at(t)[0], point) for t in np.linspace(0.0, plan.duration, 1500))


def looking(place: Any, point: Any) -> dict[str, Any]:
    """The pose at a place from which the tool looks at a point."""
    z = np.array(point) - place
    z /= np.linalg.norm(z)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    turned = Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=1))
    return {"position": list(place), "orientation": np.roll(turned.as_quat(), 1)}


@pytest.mark.parametrize("name", ["panda", "ur5e", "iiwa14"])
def test_what_it_looks_at_stays_in_view(name: str) -> None:
    """Around a post, from one side of a table to the other; otherwise it looks elsewhere on the way."""
    scene = at_rest(name, obstacles=[TABLE])
    arm = vff.Scenario.from_dict(scene).arm
    here, there = (vff.plan(scene, looking([0.5, y, 0.4], POINT)).q[-1] for y in (-0.25, 0.25))
    seen = {}
    for angle in (None, 0.3):
        view: dict[str, Any] = {} if angle is None else {"view": POINT, "view_angle": angle}
        plan = vff.plan({**scene, "obstacles": [TABLE, POST]}, there, start=here, margin=0.01, **view)
        assert plan.status == "found", plan.message
        seen[angle] = off(arm, plan, POINT)
        if angle is not None:
            assert plan.view == pytest.approx(seen[angle], abs=0.005) and plan.view <= angle
            assert (
                f"has the point off its axis by up to {np.degrees(plan.view):.1f}° of 17.2°" in plan.message
            )
    assert seen[0.3] <= 0.3 < seen[None]


def test_it_turns_to_a_point_that_it_does_not_see_yet() -> None:
    """And keeps it in view from there on, along with what it carries upright."""
    scene = at_rest("panda", controller={"task": "position"})
    arm = vff.Scenario.from_dict(scene).arm
    point = [0.2, 0.5, 0.2]
    plan = vff.plan(scene, [0.4, 0.2, 0.5], view=point, view_angle=0.3)
    assert plan.status == "found", plan.message
    sights = [sight(arm, q, point) for q in plan.q]
    assert sights[0] > 0.5 and sights[-1] <= 0.3
    inside = plan.t[np.flatnonzero(np.array(sights) > 0.3)[-1]]
    told = float(plan.message.split("no more than 17.2° from ")[1].split(" s on")[0])
    assert inside <= told <= inside + 0.05
    both = vff.plan(scene, [0.4, 0.2, 0.5], view=[0.45, 0.1, 0.0], view_angle=0.5, tilt=0.3)
    assert both.status == "found", both.message
    assert both.tilt is not None and both.tilt <= 0.3 and off(arm, both, [0.45, 0.1, 0.0]) <= 0.5


def test_in_the_plane_the_last_link_looks() -> None:
    gap = vff.Scenario.load("narrow-gap")
    goal = vff.plan(gap).q[-1]
    place, turned = gap.arm.pose(goal)
    front = np.array([np.cos(turned), np.sin(turned)])
    start = goal - [0.4, 0.0, 0.0, 0.0, 0.0, 0.0][: len(goal)]
    free = gap.replace(obstacles=[])
    point = place + 1.5 * front
    plan = vff.plan(free, goal, start=start, view=point, view_angle=0.25)
    assert plan.status == "found", plan.message
    seen = off(gap.arm, plan, point)
    assert plan.view == pytest.approx(seen, abs=0.005) and sight(gap.arm, plan.q[-1], point) < 1e-6
    blocked = vff.plan(free, goal, start=start, view=place - 1.5 * front)
    assert blocked.status == "goal blocked" and "180.00° off the axis" in blocked.message
    assert "19.05°" in blocked.message and "greater angle of view" in blocked.message


def test_a_straight_way_that_looks_away_is_told() -> None:
    """It does not turn, and what it leaves nearly straight ahead goes out of view."""
    goal = {"position": [0.5, 0.0, 0.3], "orientation": DOWN}
    straight = vff.plan(at_rest("panda"), goal, view=[0.5, 0.0, 0.1], view_angle=0.3, retreat=0.05)
    assert straight.status == "start blocked" and "looks away from its point" in straight.message


def test_several_goals_files_and_the_shell(tmp_path: Path) -> None:
    scene = at_rest("panda", obstacles=[TABLE])
    goals = [{"position": [0.5, y, 0.4], "orientation": DOWN} for y in (0.2, -0.2)]
    tour = vff.plan(scene, goals, view=POINT, view_angle=0.8)
    assert tour.status == "found" and tour.view is not None and tour.view <= 0.8, tour.message
    assert vff.Plan.load(tour.save(tmp_path / "tour.npz")).view == tour.view
    assert tour.then(vff.plan(scene, tour.q[0], start=tour.q[-1])).view is None, "of which nobody knows"
    seen = ["--horizon", "0", "--view", "0,0.9,0.5", "--view-angle", "0.9"]
    assert "off its axis" in vffnull("plan", "panda-shelf", *seen).stdout


@pytest.mark.parametrize("bad", [[0.1], [0.1, 0.2, 0.3], [np.nan, 0.0], "there", [[0.1, 0.2]], [1e9, 0.0]])
def test_points_that_are_none_are_refused(bad: Any) -> None:
    with pytest.raises((InputError, InputTypeError, ScenarioError), match="view"):
        vff.plan(GAP, view=bad)


def test_angles_that_are_none_are_refused() -> None:
    for bad in (0.0, -1.0, np.nan, np.inf, "wide"):
        with pytest.raises((InputError, InputTypeError, ScenarioError), match="view_angle"):
            vff.plan(GAP, view=[1.0, 0.0], view_angle=bad)
    gap = vff.Scenario.load("narrow-gap")
    for key, value in (("view", [1.0]), ("view_angle", 0.0)):
        with pytest.raises(ScenarioError, match=rf"replan\.{key}"):
            gap.replace(reference=vff.plan(gap).reference, replan={"view": [1.0, 0.0], key: value})


def test_another_plan_keeps_it_in_view() -> None:
    """What `[replan]` finds keeps to its own point."""
    scene = vff.Scenario.from_dict(at_rest("panda", obstacles=[TABLE]))
    here, there = (vff.plan(scene, looking([0.5, y, 0.4], POINT)).q[-1] for y in (-0.25, 0.25))
    plan = vff.plan(scene, there, start=here, view=POINT, view_angle=0.3)
    at = scene.arm.forward_kinematics(plan.at(0.5 * plan.duration)[0])[-1].tolist()
    far = [2.0, 2.0, 2.0]
    comes = {"kind": "waypoints", "times": [0.1, 0.2], "points": [far, at]}
    ball = {"shape": {"kind": "sphere", "radius": 0.06}, "position": far, "motion": comes}
    law = {"controller.posture_stiffness": 10.0, "controller.avoidance": "cbf", "duration": 8.0}
    begun = scene.replace(q0=here.tolist(), reference=plan.reference)
    seen = {}
    for angle in (None, 0.3):
        settings: dict[str, Any] = {} if angle is None else {"view": POINT, "view_angle": angle}
        done = vff.simulate(begun.replace(obstacles=[TABLE, ball], replan=settings, **law))
        assert [search.status for search in done.replans][:1] == ["found"]
        seen[angle] = max(sight(scene.arm, q, POINT) for q in done.q_plan)
    assert seen[0.3] <= 0.3 < seen[None]
    behind = {"view": [0.5, 0.0, 3.0]}
    with pytest.raises(ScenarioError, match=r"replan\.view_angle: must be .* has the point out of its axis"):
        begun.replace(replan=behind)
