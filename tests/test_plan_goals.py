"""Plans to several goals, one after the other: at rest at each of them."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from test_cli import vffnull
from test_plan import GAP, following
from vffnull.errors import InputError, ScenarioError

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]


@pytest.fixture(scope="module")
def there() -> vff.Plan:
    """To one goal alone, a configuration."""
    return vff.plan(GAP, vff.plan(GAP).q[-1])


@pytest.fixture(scope="module")
def tour(there: vff.Plan) -> vff.Plan:
    return vff.plan(GAP, [there.q[-1], {"position": [1.2, 0.5]}, GAP["q0"]], pause=0.3)


def rests(plan: vff.Plan) -> list[tuple[float, float]]:
    still = np.flatnonzero((np.diff(plan.q, axis=0) == 0.0).all(axis=1))
    return [(float(plan.t[i]), float(plan.t[i + 1])) for i in still]


def test_it_stops_at_every_goal(tour: vff.Plan, there: vff.Plan) -> None:
    assert tour.status == "found" and tour.message.count("then") == 2
    stops = rests(tour)
    assert [round(end - start, 9) for start, end in stops] == [0.3, 0.3]
    assert stops[0][0] == there.duration
    for start, end in stops:
        q, dq, ddq = tour.at(np.linspace(start, end, 7)[1:-1])
        assert np.ptp(q, axis=0).max() == 0.0 and np.abs(dq).max() == np.abs(ddq).max() == 0.0
    arm = vff.Scenario.from_dict(GAP).arm
    np.testing.assert_allclose(arm.pose(tour.at(stops[1][0])[0])[0], [1.2, 0.5], atol=1e-6)
    np.testing.assert_allclose(tour.q[-1], GAP["q0"], atol=1e-12)
    early = np.linspace(0.0, there.duration, 50)[:-1]
    for one, other in zip(tour.at(early), there.at(early), strict=True):
        np.testing.assert_array_equal(one, other)


def test_it_is_certain_all_the_way(tour: vff.Plan) -> None:
    """Measured between the instants, it keeps what its margins say."""
    scene = vff.Scenario.from_dict(GAP)
    times = np.linspace(0.0, tour.duration, 2000)
    q = tour.at(times)[0]
    apart = vff.distances(scene.arm, q, np.zeros_like(q), scene["obstacles"]).distance
    nearest = apart.reshape(len(times), scene.arm.n, -1).min(axis=2)
    i = np.clip(np.searchsorted(tour.t, times, side="right") - 1, 0, len(tour.t) - 2)
    kept = np.minimum(tour.margins[i], tour.margins[i + 1])
    assert (nearest > kept - 1e-9).all() and abs(tour.clearance - nearest.min()) < 1e-4


def test_the_law_follows_it_and_waits(tour: vff.Plan, tmp_path: Path) -> None:
    again = vff.Plan.load(tour.save(tmp_path / "tour.npz"))
    np.testing.assert_array_equal(again.q, tour.q)
    scene = following(again, duration=round(tour.duration + 1.0, 3))
    result = vff.simulate(scene, {"controller.avoidance": "cbf"})
    assert result.status == "completed" and result.metrics["end_error"] < 1e-3
    speed = np.linalg.norm(result.dx, axis=1)
    for start, end in rests(tour):
        late = (result.t > start + 0.1) & (result.t < end)
        assert late.any() and speed[late].max() < 0.01 * speed.max()
        assert np.linalg.norm(result.x[late] - result.x_ref[late], axis=1).max() < 1e-3


def test_what_stands_still_and_what_moves_are_seen_at_their_time() -> None:
    """A disc crosses the way while the arm rests: the leg after it meets it where it is then."""
    free = {**GAP, "obstacles": [], "q0": [0.6, 0.3, 0.3, 0.3]}
    goals: list[Any] = [[1.2, 0.3, 0.3, 0.3], [0.6, 0.3, 0.3, 0.3]]
    alone = vff.plan(free, goals, pause=1.0)
    arm = vff.Scenario.from_dict(free).arm
    middle = arm.pose([0.9, 0.3, 0.3, 0.3])[0].tolist()
    disc = {
        "shape": {"kind": "circle", "radius": 0.3},
        "position": [9.0, 9.0],
        "motion": {
            "kind": "waypoints",
            "times": [rests(alone)[0][1] - 0.01, rests(alone)[0][1]],
            "points": [[9.0, 9.0], middle],
        },
    }
    crossed = vff.plan({**free, "obstacles": [disc]}, goals, pause=1.0, horizon=0.0)
    assert crossed.status == "found"
    first = alone.t <= rests(alone)[0][1]
    np.testing.assert_array_equal(crossed.q[: first.sum()], alone.q[first])
    later = crossed.at(np.linspace(rests(crossed)[0][1], crossed.duration, 300))[0]
    there = [{"shape": disc["shape"], "position": middle}]
    assert vff.distances(arm, later, np.zeros_like(later), there).distance.min() > 0.0


def test_a_goal_that_is_not_reached_is_named(there: vff.Plan) -> None:
    lost = vff.plan(GAP, [there.q[-1], [9.0, 9.0], GAP["q0"]])
    assert lost.status == "goal out of reach" and lost.message.startswith("goal 2 of 3: ")
    with pytest.raises(InputError, match="no motion to follow"):
        there.then(lost)
    with pytest.raises(InputError, match=r"goal\[1\]: expected a configuration of 4 numbers"):
        vff.plan(GAP, [there.q[-1], [1.0, 2.0, 3.0]])
    with pytest.raises(InputError, match="goal: expected one or more"):
        vff.plan(GAP, [])
    with pytest.raises(InputError, match="pause"):
        vff.plan(GAP, [there.q[-1], GAP["q0"]], pause=0.0)
    turned = {"position": [0.3, 0.0, 0.5], "orientation": [0.0, 0.0, 0.0, 0.0]}
    with pytest.raises(ScenarioError, match=r"^goal orientation: expected a unit quaternion"):
        vff.plan("panda-shelf", turned)
    with pytest.raises(ScenarioError, match=r"^goal\[1\] position\[0\]: must be at most 1e100") as caught:
        vff.plan(GAP, [there.q[-1], {"position": [1e200, 0.0], "orientation": 0.0}])
    assert caught.value.path == "goal[1] position[0]"
    with pytest.raises(ScenarioError, match=r"^goal orientation: must be at most 1e100"):
        vff.plan(GAP, {"position": [1.0, 0.0], "orientation": 1e200})


def test_plans_are_joined_where_they_meet(there: vff.Plan) -> None:
    back = vff.plan(GAP, GAP["q0"], start=there.q[-1])
    whole = there.then(back, pause=0.25)
    assert whole.duration == pytest.approx(there.duration + 0.25 + back.duration)
    assert whole.samples == there.samples + back.samples
    old = replace(back, margins=np.empty((0, 0)))  # of a file without
    assert there.then(old).margins.size == 0
    with pytest.raises(InputError, match="begin where this plan ends"):
        there.then(there)


def test_a_pause_that_rounding_loses_is_refused(there: vff.Plan, tmp_path: Path) -> None:
    """Instants would coincide, and nothing would take the plan; those that are named do not."""
    back = vff.plan(GAP, GAP["q0"], start=there.q[-1])
    for pause in (1e-17, 1e17, 1e300, 1e308):
        with pytest.raises(InputError, match=r"^pause: expected .* s between these plans") as refused:
            there.then(back, pause)
    for named in str(refused.value).split()[2:5:2]:
        whole = there.then(back, float(named))
        whole.save(tmp_path / "plan.npz")
        np.testing.assert_array_equal(vff.Plan.load(tmp_path / "plan.npz").t, whole.t)
        np.testing.assert_array_equal(whole.at(whole.duration)[0], back.q[-1])
    for pause in (1e-17, 1e308):
        with pytest.raises(InputError, match=r"^pause: expected"):
            vff.plan(GAP, [there.q[-1], GAP["q0"], there.q[-1]], pause=pause)


def test_replanning_would_leave_goals_out(tour: vff.Plan) -> None:
    with pytest.raises(ScenarioError, match="replan: needs a plan without rests on the way"):
        vff.simulate(following(tour), {"replan": {}})


def test_arms_in_space_and_rows_of_an_array() -> None:
    scene = vff.Scenario.from_dict(
        {"duration": 1.0, "q0": READY, "arm": {"model": "panda"}, "reference": {"kind": "setpoint"}}
    )
    goals = np.array([[0.4, *READY[1:]], [0.8, *READY[1:]]])
    both = vff.plan(scene, goals)
    place, turn = scene.arm.pose(goals[0])
    posed = vff.plan(scene, [(place, turn), {"position": place}])
    assert (both.status, posed.status) == ("found", "found")
    np.testing.assert_allclose(scene.arm.pose(posed.q[-1])[0], place, atol=1e-6)
    assert len(rests(both)) == 1


def test_the_command_line_takes_several(tmp_path: Path) -> None:
    vff.Scenario.from_dict(GAP).save(tmp_path / "gap.toml")
    asked: list[object] = ["plan", tmp_path / "gap.toml"]
    for goal in ([1.6, 0.6, 0.9, 1.0], GAP["q0"]):
        asked += ["--goal", ",".join(map(str, goal))]
    vffnull(*asked, "--pause", 0.4, "--out", tmp_path / "plan.npz")
    ((start, end),) = rests(vff.Plan.load(tmp_path / "plan.npz"))
    assert end - start == pytest.approx(0.4)
    assert "as many as there are" in vffnull(*asked, "--orientation", 0.5, code=2).stderr


@pytest.mark.parametrize(
    ("free", "away", "disc"),
    [
        ([1.45, -2.303, -1.217], [0.5, -0.05, -0.05], [0.278489, 0.421431]),
        ([0.872, -1.442, -2.248], [-0.5, 0.05, 0.05], [0.551923, 0.371906]),
    ],
)
def test_a_configuration_that_folds_into_the_arm_hides_no_other(
    free: list[float], away: list[float], disc: list[float]
) -> None:
    """The other one has more room from the disc, and touches the arm itself."""
    lengths, obstacle = [0.5, 0.4, 0.45], {"shape": {"kind": "circle", "radius": 0.05}, "position": disc}
    arm = vff.Arm(lengths, 1.0, radius=0.06)
    start = np.add(free, away)
    scene = {
        "duration": 1.0,
        "q0": start.tolist(),
        "arm": {"lengths": lengths, "masses": 1.0, "radius": 0.06},
        "obstacles": [obstacle],
        "reference": {"kind": "setpoint", "point": arm.forward_kinematics(start)[-1].tolist()},
        "controller": {"self_collision": "avoid"},
    }
    assert vff.plan(scene, free).status == "found"
    tip, orientation = arm.forward_kinematics(free)[-1], float(np.sum(free))
    plan = vff.plan(scene, {"position": tip.tolist(), "orientation": orientation})
    assert plan.status == "found", plan.message
    np.testing.assert_allclose(arm.forward_kinematics(plan.q[-1])[-1], tip, atol=1e-6)


def test_poses_at_the_very_end_of_the_reach() -> None:
    """With the elbow stretched out they are reached in one place of a bent valley alone."""
    arm, noise = vff.Arm.named("gen3"), np.random.default_rng(4)
    for _ in range(40):
        q = np.round(noise.uniform(-2, 2, 7), 2)
        q[[2, 3, 4]] = 0.0
        position, orientation = arm.pose(q)
        scene = {
            "duration": 1.0,
            "q0": noise.uniform(-2, 2, 7).tolist(),
            "arm": {"model": "gen3"},
            "reference": {"kind": "setpoint"},
        }
        plan = vff.plan(scene, {"position": position, "orientation": orientation}, paths=1)
        assert plan.status == "found", (q, plan.message)
        np.testing.assert_allclose(arm.pose(plan.q[-1])[0], position, atol=1.1e-6)


def test_a_gap_of_micrometres_is_told_as_such() -> None:
    away = vff.plan({**GAP, "obstacles": []}, [4.00002, 0.0])
    assert away.status == "goal out of reach" and away.gap == pytest.approx(2e-5, rel=1e-2)
    assert re.search(r"nearer to the goal than (19|20)\.\d\d µm;", away.message)


def test_a_tiny_arm_is_looked_at_as_finely() -> None:
    """A millimetre of arm, and a margin of 0: a fixed 0.02 mm would be a hundredth of it."""
    scene = {
        "duration": 1.0,
        "q0": [-1.9093514696461846, -1.5209266491425049, 0.8773904956763121],
        "arm": {
            "lengths": [0.0007973052610087365, 0.00042534053770988786, 0.0005560077747788284],
            "masses": 1.0,
        },
        "reference": {"kind": "setpoint", "point": [-0.0011349538636502353, -0.0009396979611911932]},
        "obstacles": [
            {
                "position": [0.0008414400081111825, -0.0015566189737099567],
                "angle": 2.872409583478703,
                "shape": {"kind": "box", "size": [0.0002699315448274132, 0.0003158550546884557]},
            }
        ],
    }
    goal = [-0.6043417041966244, 1.8623584867745593, 0.17092866378516636]
    plan = vff.plan(scene, goal, samples=3000, paths=1, margin=0.0)
    q = plan.at(np.linspace(0.0, plan.duration, 4000))[0]
    apart = vff.distances(vff.Scenario.from_dict(scene).arm, q, np.zeros_like(q), scene["obstacles"])
    assert plan.status == "found" and min(plan.clearance, apart.distance.min()) > 0.0
