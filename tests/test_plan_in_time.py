"""Plans that let pass what moves (T206), judged in closed form at every instant."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError

LINKS, RADIUS = 4, 0.05
MARGIN = 0.02


def flies(start: Any, velocity: Any, radius: float) -> dict[str, Any]:
    shape = {"kind": "circle" if len(start) == 2 else "sphere", "radius": radius}
    return {
        "shape": shape,
        "position": list(start),
        "motion": {"kind": "linear", "velocity": list(velocity)},
    }


def scene(obstacles: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "duration": 5.0,
        "q0": [0.2, 0.3, 0.3, 0.3],
        "arm": {"lengths": [1.0] * LINKS, "masses": 1.0, "radius": RADIUS},
        "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 10.0},
        "reference": {"kind": "setpoint", "point": [3.0, 1.0]},
        "obstacles": obstacles,
    }


def distance(q: np.ndarray, obstacle: dict[str, Any], t: float) -> float:
    """Of the planar arm's axes from a disc, by projection onto each."""
    center = np.array(obstacle["position"]) + t * np.array(obstacle["motion"]["velocity"])
    angles = np.cumsum(q)
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    joints = np.vstack([np.zeros(2), np.cumsum(ways, axis=0)[:-1]])
    along = np.clip(((center - joints) * ways).sum(axis=1), 0.0, 1.0)
    away = np.linalg.norm(center - joints - along[:, None] * ways, axis=1).min()
    return float(away) - RADIUS - float(obstacle["shape"]["radius"])


def least(plan: vff.Plan, obstacles: list[dict[str, Any]], horizon: float, until: float) -> float:
    """The smallest distance along a plan; what moves stays where it is at the end of the horizon."""
    times = np.arange(0.0, until, 2e-3)
    configurations = plan.at(times)[0]
    return min(
        distance(q, obstacle, min(t, horizon))
        for t, q in zip(times, configurations, strict=True)
        for obstacle in obstacles
    )


GOAL = [1.8, 0.3, 0.3, 0.3]


def test_a_disc_that_comes_by_is_let_pass() -> None:
    """It falls past the goal, and the arm comes there after it; where it stays, nothing helps."""
    passes = [flies([-2.0, 4.5], [0.0, -2.0], 0.5)]
    plan = vff.plan(scene(passes), GOAL, horizon=3.0, margin=MARGIN)
    assert plan.status == "found" and plan.begins == 0.0
    kept = least(plan, passes, 3.0, max(3.0, plan.duration))
    assert kept > 0.5 * MARGIN and kept > plan.clearance - 1e-6
    np.testing.assert_array_equal(plan.q[[0, -1]], [scene([])["q0"], GOAL])
    later = [flies([-2.0, 4.5], [0.0, -1.2], 0.5)]
    plan = vff.plan(scene(later), GOAL, horizon=4.0, margin=MARGIN)
    assert "so that what moves passes" in plan.message
    assert least(plan, later, 4.0, max(4.0, plan.duration)) > 0.5 * MARGIN
    stays = [flies([-2.0, 4.5], [0.0, -0.5], 0.5)]  # on the goal when the horizon ends
    lost = vff.plan(scene(stays), GOAL, horizon=2.5, margin=MARGIN)
    assert lost.status != "found" and lost.begins is None
    same = vff.plan(scene(passes), GOAL, horizon=None, margin=MARGIN)
    assert same.status == "found" and same.begins is None


def test_random_discs() -> None:
    """Whatever is found keeps half of the margin at every instant, with what flies by where it is by then."""
    found = 0
    for seed in range(90):
        random = np.random.default_rng(seed)
        horizon = random.uniform(1.0, 4.0)
        obstacles = []
        for _ in range(random.integers(1, 4)):
            speed = random.normal(size=2)
            speed *= random.uniform(0.3, 3.0) / np.linalg.norm(speed)
            there = random.uniform(-3.0, 3.0, size=2)
            start = there - random.uniform(0.2, horizon) * speed
            obstacles.append(flies(start, speed, random.uniform(0.1, 0.5)))
        goal = random.uniform(-1.5, 1.5, size=LINKS)
        plan = vff.plan(scene(obstacles), list(goal), horizon=horizon, margin=MARGIN, samples=2000, seed=seed)
        if plan.status != "found":
            continue
        found += plan.begins is not None
        until = plan.duration if plan.begins is None else max(plan.duration, horizon)
        kept = least(plan, obstacles, horizon, until)
        assert kept > 0.5 * min(plan.margin, MARGIN), (seed, kept, plan)
    assert found >= 10


def test_it_keeps_the_limits_of_what_it_is_made_from() -> None:
    """A Panda that waits, and goes more slowly: speeds, accelerations and torques as ever."""
    arm = vff.Arm.named("panda")
    q0 = [0.0, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8]
    goal = [1.4, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8]
    slow = 0
    for seed in range(8):
        random = np.random.default_rng(seed)
        balls = [
            flies([0.35 - v * at, 0.35 + random.uniform(-0.1, 0.1), 0.6], [v, 0.0, 0.0], 0.15)
            for v, at in zip(random.uniform(0.3, 1.5, size=3), random.uniform(0.5, 3.0, size=3), strict=True)
        ]
        made = {
            "duration": 5.0,
            "q0": q0,
            "arm": {"model": "panda"},
            "reference": {"kind": "setpoint"},
            "obstacles": balls,
        }
        plan = vff.plan(made, goal, horizon=4.0, speed=0.9, seed=seed)
        if plan.begins is None:
            continue
        slow += 1
        q, dq, ddq = plan.at(np.linspace(0.0, plan.duration, 500))
        assert (abs(dq) <= 0.9 * np.array(arm.velocity_limits) + 1e-9).all()
        assert (abs(ddq) <= 0.9 * 10.0 + 1e-6).all()
        torque = np.array([arm.inverse_dynamics(*each) for each in zip(q, dq, ddq, strict=True)])
        assert (abs(torque) <= 0.8 * np.array(arm.torque_limits) + 1e-6).all()
        assert vff.distances(arm, plan.q[-1], np.zeros(7), []).distance.size == 0
    assert slow >= 3


def test_a_tour_knows_when_its_parts_begin(tmp_path: Path) -> None:
    """What comes after another motion has to begin when that and the pause are over."""
    passes = [flies([-2.0, 4.5], [0.0, -1.0], 0.5)]
    tour = vff.plan(scene(passes), [[0.4, 0.3, 0.3, 0.3], GOAL], horizon=4.0)
    assert tour.status == "found" and tour.begins == pytest.approx(0.0, abs=1e-9)
    assert least(tour, passes, 20.0, tour.duration) > 0.5 * MARGIN
    assert vff.Plan.load(tour.save(tmp_path / "tour.npz")).begins == tour.begins
    first = vff.plan(scene([]), [0.4, 0.3, 0.3, 0.3])
    then = vff.plan(scene(passes), GOAL, start=first.q[-1], horizon=4.0)
    assert then.begins == 0.0
    with pytest.raises(InputError, match="has to begin at 0 s"):
        first.then(then)


def test_what_is_found_by_places_is_as_ever() -> None:
    """A disc beside the way costs no waiting."""
    beside = [flies([-2.5, -3.0], [1.0, 0.0], 0.3)]
    plan = vff.plan(scene(beside), GOAL, horizon=2.0)
    assert plan.status == "found" and plan.begins is None and plan.dq.any(axis=1)[1]


def test_an_arm_that_follows_touches_nothing() -> None:
    """Followed from its beginning, also by a law that does not react."""
    passes = [flies([-2.0, 4.5], [0.0, -2.0], 0.5)]
    plan = vff.plan(scene(passes), GOAL, horizon=3.0, margin=0.05)
    followed = {**scene(passes), "duration": round(plan.duration + 0.5, 2), "reference": plan.reference}
    followed["controller"] = {**followed["controller"], "posture_stiffness": 200.0}
    run = vff.simulate(followed)
    assert run.metrics.min_clearance > 0.02 and run.metrics.end_error < 0.01


def rests(times: list[float], points: list[list[float]], radius: float) -> dict[str, Any]:
    motion = {"kind": "waypoints", "times": times, "points": points}
    return {"shape": {"kind": "circle", "radius": radius}, "position": points[0], "motion": motion}


def test_a_disc_that_comes_to_rest_late_is_no_panic() -> None:
    """What blocked a motion at its end was remembered by a number that another world did not have."""
    times = [0.639, 1.326, 2.272, 2.353]
    places = [[2.116, 3.118], [2.982, 2.714], [2.701, 3.333], [2.681, 1.68]]
    made = scene([rests(times, places, 0.608)])
    made["q0"] = [-0.945, 0.966, -0.632, -0.118]
    made["arm"] = {"lengths": [0.911, 0.952, 0.769, 0.907], "masses": 1.0}
    made["reference"] = {"kind": "setpoint", "point": [1.769, 1.061]}
    plan = vff.plan(made, [-0.784, 1.216, 0.857, -0.365], horizon=2.427)
    assert plan.status in ("goal blocked", "not found")


def test_a_long_wait_beside_a_post_is_a_rest() -> None:
    """It bulges nowhere: a disc that stays for 8 s in the way is waited for 3 cm beside a post."""
    made = scene([])
    at = distance(np.array(made["q0"]), flies([2.0, 0.2], [0.0, 0.0], 0.2), 0.0)
    post = {"shape": {"kind": "circle", "radius": 0.2}, "position": [2.0, 0.2 - (0.03 - at)]}
    stays = rests([0.0, 8.0, 8.5], [[-1.0, 2.9], [-1.0, 2.9], [-9.0, 9.0]], 0.3)
    here = vff.distances(vff.Scenario.from_dict(made).arm, made["q0"], np.zeros(LINKS), [post]).distance.min()
    post["position"][1] -= 0.03 - here
    plan = vff.plan({**made, "obstacles": [post, stays]}, GOAL, horizon=12.0)
    assert plan.status == "found" and plan.begins == 0.0
    assert plan.t[1] > 4.0 and abs(plan.dq[:2]).max() < 1e-12  # it waits
    assert plan.margins[0].max() > 0.25


def test_what_is_kept_at_the_goal_is_said() -> None:
    """Something comes beside it later, within the horizon: clearance and margins know, in a pause, too."""
    made = scene([])
    made["arm"] = {"lengths": [1.0] * 3, "masses": 1.0, "radius": RADIUS}
    made["q0"], goal = [-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]
    made["reference"] = {"kind": "setpoint", "point": [1.0, 1.0]}
    tip = 3.0 * np.array([np.cos(0.5), np.sin(0.5)])
    sweeps = rests([0.0, 2.0, 4.0], [[6.0, -1.3], [6.0, -1.3], [2.0, -1.0]], 0.2)

    def late(t: float) -> dict[str, Any]:
        return rests(
            [0.0, t - 0.5, t, t + 0.5], [[6.0, 3.0], [6.0, 3.0], [tip[0] + 0.29, tip[1]], [6.0, 3.0]], 0.2
        )

    plan = vff.plan({**made, "obstacles": [sweeps, late(4.0)]}, goal, horizon=6.0)
    assert plan.begins == 0.0 and plan.duration < 2.0
    assert 0.02 < plan.clearance <= 0.0401 and plan.margins[-1].min() <= 0.0401
    around = [sweeps, late(plan.duration + 0.25)]
    tour = vff.plan({**made, "obstacles": around}, [goal, [0.8, 0.2, 0.2]], horizon=6.0, pause=0.5)
    assert tour.clearance <= 0.0401
    pause = int(np.searchsorted(tour.t, plan.duration + 0.25)) - 1
    assert tour.margins[pause : pause + 2].min(axis=1).max() <= 0.0401
    # By the clock of a computer, which has steps of 0.2 µs.
    now = 1.7647e9
    first = replace(plan, begins=now)
    assert first.then(replace(plan, q=plan.q[::-1], begins=now + plan.duration + 0.5)).begins == now


def test_many_things_that_move_cost_no_more_memory_than_their_places() -> None:
    """A flying cloud of 50 000 points was copied 12 800 times."""
    resource = pytest.importorskip("resource")
    points = np.random.default_rng(1).uniform(-0.1, 0.1, size=(50_000, 3)) + np.array([3.0, 0.0, 0.5])
    cloud = vff.Obstacle.points(points, 0.01, motion=vff.Motion.linear([-30.0, 0.0, 0.0]))
    made = {
        "duration": 1.0,
        "q0": [0.0, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8],
        "arm": {"model": "panda"},
        "reference": {"kind": "setpoint"},
        "obstacles": [cloud.to_dict()],
    }
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    plan = vff.plan(made, [1.0, -0.4, 0.0, -2.0, 0.0, 1.6, 0.8], horizon=10.0, samples=200)
    assert plan.status == "start blocked"
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1_000_000  # kB
