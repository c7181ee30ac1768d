"""Plans: found around obstacles, followed by the law, kept in files."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, InputTypeError, ScenarioError

GAP: dict[str, Any] = {
    "name": "gap",
    "duration": 6.0,
    "q0": [1.5, 0.6, 0.9, 1.0],
    "arm": {"lengths": [1.0] * 4, "masses": 1.0, "radius": 0.05},
    "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 6.0},
    "reference": {"kind": "setpoint", "point": [2.9, 0.5]},
    "obstacles": [
        {"shape": {"kind": "box", "size": [0.3, 3.0]}, "position": [1.9, 2.1]},
        {"shape": {"kind": "box", "size": [0.3, 3.0]}, "position": [1.9, -1.6]},
    ],
    "simulation": {"dt": 1e-3, "integrator": "semi_implicit_euler", "control": "hold"},
}


@pytest.fixture(scope="module")
def found() -> vff.Plan:
    return vff.plan(GAP)


def following(plan: vff.Plan, **more: Any) -> vff.Scenario:
    changes = {"reference": plan.reference, "controller.posture_stiffness": 200.0, **more}
    return vff.Scenario.from_dict(GAP).replace(**changes)


def test_a_plan_reaches_its_goal_and_repeats(found: vff.Plan) -> None:
    again = vff.plan(GAP)
    assert found.status == "found" and found.status is vff.PlanStatus.FOUND
    for name in ("t", "q", "dq", "ddq", "tip"):
        np.testing.assert_array_equal(getattr(found, name), getattr(again, name))
    assert found.tip[-1] == pytest.approx([2.9, 0.5], abs=1e-6)
    assert found.q[0].tolist() == GAP["q0"]
    assert not np.array_equal(vff.plan(GAP, seed=1).q, found.q)
    assert "found: 4 joints" in repr(found)
    times = np.arange(0.0, found.duration, 1e-3)
    q, dq, _ = found.at(times)
    arm = vff.Scenario.from_dict(GAP).arm
    apart = vff.distances(arm, q, dq, GAP["obstacles"], times).distance.min()
    assert apart == pytest.approx(found.clearance, abs=2e-3)
    assert apart >= 0.4 * found.margin
    assert np.abs(dq).max() <= 1.5 * 1.001  # half of 3 rad/s


def test_between_its_instants_it_is_what_the_reference_is(found: vff.Plan) -> None:
    """What the simulation records of the reference is the tip of the plan, at any time."""
    result = vff.simulate(following(found))
    q, dq, _ = found.at(result.t)
    arm = result.scenario.arm
    np.testing.assert_allclose(arm.forward_kinematics(q)[:, -1], result.x_ref, atol=1e-12)
    moved = np.gradient(q, result.t, axis=0)
    assert np.abs(moved - dq).max() < 5e-3
    assert np.array_equal(found.at(0.0)[0], found.q[0])
    assert np.array_equal(found.at([-1.0, 99.0])[0], found.q[[0, -1]])


EXACT = {"simulation.control": "continuous", "simulation.integrator": "rk4"}


def test_the_law_follows_it_with_tip_and_posture(found: vff.Plan) -> None:
    """The tip exactly; the joints, whose null space has two dimensions, beside the plan's, the nearer the
    stiffer the spring; without one, they are anywhere.
    """
    soft, stiff, free = (
        vff.simulate(following(found, **EXACT, **{"controller.posture_stiffness": k}))
        for k in (20.0, 200.0, 0.0)
    )
    for result in (soft, stiff, free):
        # The end of the plan, where the acceleration jumps by less than 2 m/s², is within a step of 1 ms.
        assert np.abs(result.error).max() < 2e-6
    assert stiff.status == "completed"
    q = found.at(soft.t)[0]
    astray = [np.abs(result.q - q).max() for result in (soft, stiff, free)]
    # What pulls at the spring are Coriolis forces: ten times the stiffness, a tenth of the way.
    assert astray[1] < 0.05 and astray[1] < 0.2 * astray[0] and astray[0] < 0.2 * astray[2], astray


def test_it_gives_way_to_the_field(found: vff.Plan) -> None:
    """A disc that comes where the plan has a link pushes that aside, and the tip stays on its way; afterwards
    the posture is that of the plan again.
    """
    joints = vff.Scenario.from_dict(GAP).arm.forward_kinematics(found.q[-1])
    end = float(np.ceil(found.duration))
    outward = joints[2] - 0.5 * (joints[0] + joints[-1])
    outward /= np.linalg.norm(outward)
    far, near = [(joints[2] + away * outward).tolist() for away in (1.5, 0.15)]
    disc = {
        "shape": {"kind": "circle", "radius": 0.15},
        "position": far,
        "motion": {
            "kind": "waypoints",
            "times": [end, end + 3.0, end + 6.0],
            "points": [far, near, far],
        },
    }
    soft = {"controller.posture_stiffness": 20.0}
    wait = {"duration": np.ceil(found.duration) + 12.0, "obstacles": [disc], **soft}
    field = {"kind": "bounded", "gain": 300.0, "influence": 0.4}
    pushed = vff.simulate(following(found, **wait, **{"controller.field": field}))
    unpushed = vff.simulate(following(found, **wait))
    assert unpushed.status == "collided" and pushed.status == "completed"
    assert np.abs(pushed.error).max() < 0.01
    assert np.abs(pushed.q[-1] - found.q[-1]).max() < 0.05


@pytest.mark.parametrize("control", ["hold", "predictor", "continuous"])
@pytest.mark.parametrize("avoidance", ["null_space", "cbf"])
def test_every_kind_of_control_follows(found: vff.Plan, control: str, avoidance: str) -> None:
    result = vff.simulate(
        following(found, **{"simulation.control": control, "controller.avoidance": avoidance})
    )
    assert result.status == "completed" and np.linalg.norm(result.error[-1]) < 1e-3


def test_a_governor_lets_tip_and_posture_wait_together(found: vff.Plan) -> None:
    """A disc in the gap holds the arm up until it goes; where the tip waits, the posture does, too."""
    late = float(found.t[np.argmax(found.tip[:, 0] > 1.2)])
    disc = {
        "shape": {"kind": "circle", "radius": 0.2},
        "position": [1.9, 0.25],
        "motion": {
            "kind": "waypoints",
            "times": [late + 4.0, late + 6.0],
            "points": [[1.9, 0.25], [9.0, 0.25]],
        },
    }
    changes = {
        "duration": np.ceil(found.duration) + 10.0,
        "obstacles": [*GAP["obstacles"], disc],
        "controller.avoidance": "cbf",
        "controller.governor": {},
    }
    result = vff.simulate(following(found, **changes))
    assert result.status == "completed"
    assert result.path_time is not None and result.path_time[-1] < result.t[-1] - 0.5
    assert np.linalg.norm(result.x[-1] - [2.9, 0.5]) < 0.01
    assert np.abs(result.q[-1] - found.q[-1]).max() < 0.05


def test_goals_of_every_kind() -> None:
    arm = vff.Scenario.from_dict(GAP).arm
    goal = [0.3, -0.2, -0.1, 0.3]
    tip, angle = arm.pose(goal)
    assert vff.plan(GAP, goal).q[-1].tolist() == goal
    assert vff.plan(GAP, [2.9, 0.5]).tip[-1] == pytest.approx([2.9, 0.5], abs=1e-6)
    for pose in ({"position": tip, "orientation": angle}, (tip, angle)):
        reached = arm.pose(vff.plan(GAP, pose).q[-1])
        assert reached[0] == pytest.approx(tip, abs=1e-6)
        assert np.exp(1j * reached[1]) == pytest.approx(np.exp(1j * angle), abs=1e-5)
    panda = vff.Scenario.load("panda-sweep")
    position = [0.45, 0.2, 0.35]
    turned = [0.0, 1.0, 0.0, 0.0]
    there = vff.plan(panda, {"position": position, "orientation": turned}, horizon=None)
    reached = panda.arm.pose(there.q[-1])
    assert reached[0] == pytest.approx(position, abs=1e-6)
    assert abs(reached[1] @ np.array(turned)) == pytest.approx(1.0, abs=1e-9)
    begun = vff.plan(GAP, goal, start=[1.4, 0.5, 0.8, 0.9])
    assert begun.q[0].tolist() == [1.4, 0.5, 0.8, 0.9]
    followed = vff.plan(following(vff.plan(GAP)))  # the end of a plan is a goal, too
    assert followed.tip[-1] == pytest.approx([2.9, 0.5], abs=1e-6)


def test_nothing_found_says_why_and_how_far() -> None:
    wall = {"shape": {"kind": "box", "size": [0.3, 20.0]}, "position": [1.9, 0.0]}
    blocked = vff.plan({**GAP, "obstacles": [wall]})
    assert blocked.status == "goal blocked" and len(blocked.t) == 0
    with pytest.raises(InputError, match="goal blocked"):
        _ = blocked.reference
    with pytest.raises(InputError, match="goal blocked"):
        blocked.at(0.0)
    away = vff.plan(GAP, [3.9, 3.0])
    assert away.status == "goal out of reach" and away.gap == pytest.approx(
        np.hypot(3.9, 3.0) - 4.0, abs=1e-3
    )
    assert "m away" in repr(away)
    post = {"shape": {"kind": "box", "size": [0.5, 0.5]}, "position": [1.2, 1.7]}
    short = vff.plan({**GAP, "obstacles": [post]}, [0.3, 0.0, 0.0, 0.0], samples=0)
    assert short.status == "not found" and short.gap > 0.5 and len(short.q) == len(short.tip) >= 1
    assert "rad left after 0 samples" in repr(short)


@pytest.mark.parametrize(
    ("arguments", "error", "part"),
    [
        ({"goal": [1.0, 2.0, 3.0]}, InputError, "3 numbers"),
        ({"goal": "there"}, InputTypeError, "numbers"),
        ({"goal": {"place": [1, 2]}}, InputError, "place"),
        ({"goal": [np.nan] * 4}, InputError, "finite"),
        ({"goal": ([1.0, 2.0], [1.0, 0.0])}, InputError, "orientation"),
        ({"start": [0.0]}, InputError, "start"),
        ({"goal": [0.0, 1e6, 0.0, 0.0]}, ScenarioError, r"goal\[1\]: must be within 100 rad or m of 0"),
        ({"goal": [0.0, 0.0, 0.0, 1e308]}, ScenarioError, r"goal\[3\]"),
        ({"start": [1e9, 0.0, 0.0, 0.0]}, ScenarioError, r"start\[0\]"),
        ({"speed": 1e-9}, ScenarioError, "speed: joint . has .* up to 3600 s"),
        ({"margin": -0.1}, ScenarioError, "margin"),
        ({"margin": np.nan}, InputError, "margin"),
        ({"speed": 0.0}, ScenarioError, "speed"),
        ({"speed": 2.0}, ScenarioError, "speed"),
        ({"horizon": -1.0}, ScenarioError, "horizon"),
        ({"samples": -1}, InputError, "samples"),
        ({"paths": 0}, InputError, "paths"),
        ({"seed": 0.5}, InputTypeError, "seed"),
    ],
)
def test_arguments_of_no_use_are_named(arguments: dict[str, Any], error: type[Exception], part: str) -> None:
    with pytest.raises(error, match=part):
        vff.plan(GAP, **arguments)


def test_what_is_in_the_way_is_named() -> None:
    """Two links of the arm, an obstacle that passes, and a message that a file keeps."""
    folded = [0.0, 1.2, 0.0, -3.0, 0.0, -0.01, 0.0]
    hand = {**vff.Scenario.load("panda-sweep").to_dict(), "obstacles": []}
    hand["controller"]["self_collision"] = "avoid"
    own = vff.plan(hand, folded)
    assert own.status == "goal blocked" and "`panda_" in own.message and " mm inside `" in own.message
    passed = vff.plan("panda-shelf")
    assert "obstacle 4 passes within the horizon of 1 s" in passed.message
    assert "horizon" in passed.message and vff.plan("panda-shelf", horizon=0.0).message.startswith(
        "a motion of"
    )


def test_files_keep_every_bit(found: vff.Plan, tmp_path: Path) -> None:
    path = found.save(tmp_path / "plan.npz")
    back = vff.Plan.load(path)
    for name in ("t", "q", "dq", "ddq", "tip", "margins"):
        np.testing.assert_array_equal(getattr(back, name), getattr(found, name))
    assert (back.status, back.clearance, back.samples) == (found.status, found.clearance, found.samples)
    assert repr(back) == repr(found)
    nothing = vff.plan(GAP, [3.9, 3.0])
    assert repr(vff.Plan.load(nothing.save(tmp_path / "none.npz"))) == repr(nothing)
    with pytest.raises(InputError, match=r"\.npz"):
        found.save(tmp_path / "plan.csv")


def test_files_of_others_are_refused(found: vff.Plan, tmp_path: Path) -> None:
    path = found.save(tmp_path / "plan.npz")
    (tmp_path / "cut.npz").write_bytes(path.read_bytes()[:1000])
    (tmp_path / "text.npz").write_text("no archive")
    with np.load(path) as file:
        inside = dict(file)
    changes: dict[str, dict[str, Any]] = {
        "short": {"q": inside["q"][1:]},
        "nan": {"q": inside["q"] * np.nan},
        "turned": {"t": inside["t"][::-1]},
        "other": {"vffnull_plan": np.array(json.dumps({"format": 99, "status": "found"}))},
    }
    for name, change in changes.items():
        np.savez(tmp_path / f"{name}.npz", **{**inside, **change})
    np.savez(tmp_path / "nudged.npz", **{**inside, "q": inside["q"] + 1e-9})
    with pytest.raises(InputError, match=r"nudged\.npz: damaged: its digest"):
        vff.Plan.load(tmp_path / "nudged.npz")
    header = {key: value for key, value in json.loads(str(inside["vffnull_plan"])).items() if key != "digest"}
    np.savez(tmp_path / "older.npz", **{**inside, "vffnull_plan": np.array(json.dumps(header))})
    assert repr(vff.Plan.load(tmp_path / "older.npz")) == repr(found)
    for name in ("cut", "text", *changes):
        with pytest.raises(InputError):
            vff.Plan.load(tmp_path / f"{name}.npz")
    with pytest.raises(FileNotFoundError):
        vff.Plan.load(tmp_path / "missing.npz")


def test_damaged_files(found: vff.Plan, tmp_path: Path) -> None:
    """One wrong bit, anywhere, gives no other plan and no other error: in all of the headers, here and there
    in the rest.
    """
    path, random = found.save(tmp_path / "plan.npz"), np.random.default_rng(4)
    whole = path.read_bytes()
    heads = [at.start() + i for at in re.finditer(b"PK|NUMPY", whole) for i in range(0, 80, 3)]
    for at in [*heads, *random.integers(len(whole), size=200)]:
        damaged = bytearray(whole)
        damaged[min(at, len(whole) - 1)] ^= 1 << random.integers(8)
        path.write_bytes(damaged)
        try:
            again = vff.Plan.load(path)
        except InputError as error:
            assert str(path) in str(error)
            continue
        assert repr(again) == repr(found)
        for name in ("t", "q", "dq", "ddq", "tip", "margins"):
            np.testing.assert_array_equal(getattr(again, name), getattr(found, name))


@pytest.mark.parametrize(
    ("change", "path"),
    [
        ({"times": [0.0, 0.0], "points": [[0.0] * 4] * 2}, "reference.times"),
        ({"times": [0.0], "points": [[0.0] * 4]}, "reference.times"),
        ({"times": [0.0, 1.0], "points": [[0.0] * 4]}, "reference.points"),
        ({"times": [0.0, 1.0], "points": [[0.0] * 4, [0.0] * 3]}, "reference.points"),
        ({"times": [0.0, 1.0]}, "reference"),
        ({"times": [0.0, 1.0], "points": [[0.0] * 4] * 2, "margins": [[0.0] * 4]}, "reference.margins"),
        ({"times": [0.0, 1.0], "points": [[0.0] * 4] * 2, "margins": [[0.0] * 3] * 2}, "reference.margins"),
        (
            {"times": [0.0, 1.0], "points": [[0.0] * 4] * 2, "margins": [[0.0] * 4, [0.0, 0.0, -1.0, 0.0]]},
            "reference.margins[1][2]",
        ),
    ],
)
def test_references_of_no_use_are_named(change: dict[str, Any], path: str) -> None:
    with pytest.raises(ScenarioError, match=re.escape(path)):
        vff.simulate({**GAP, "reference": {"kind": "plan", **change}})


@pytest.mark.parametrize(
    ("limit", "part"),
    [
        ({"velocity_limits": 1e-6}, r"arm\.velocity_limits\[.\]: joint . has .* up to 3600 s"),
        ({"torque_limits": 1e-7}, r"arm\.torque_limits: too little to get anywhere"),
        ({"torque_limits": 1e-300}, r"arm\.torque_limits: too little to get anywhere"),
    ],
)
def test_limits_that_make_it_endless_are_named(limit: dict[str, float], part: str) -> None:
    with pytest.raises(ScenarioError, match=part):
        vff.plan({**GAP, "arm": {**GAP["arm"], **limit}})


def test_a_plan_stays_within_the_joint_limits() -> None:
    points = [[-2.0, 0.0, 0.0, 0.0], [2.5, 0.0, 0.0, 0.0]]
    limits = {**GAP["arm"], "joint_limits": [[-2.0, 2.0]] * 4}
    reference = {"kind": "plan", "times": [0.0, 1.0], "points": points}
    with pytest.raises(ScenarioError, match=r"reference\.points\[1\]\[0\]: must be within the limits"):
        vff.simulate({**GAP, "arm": limits, "reference": reference})


@pytest.mark.parametrize("seed", range(6))
def test_a_plan_between_joint_limits_is_a_reference(seed: int) -> None:
    """From one end of joints to the other, and one stays at its end: no rounding leads beyond."""
    ends = np.random.default_rng(seed).uniform(0.1, 0.9, (2, 4))
    ends[1, 1] = ends[0, 1]
    lower, upper = np.sort(ends, axis=0)
    upper[1] += 0.3
    limited = {**GAP["arm"], "joint_limits": np.stack([lower, upper], axis=1).tolist()}
    scene = {**GAP, "q0": ends[0].tolist(), "obstacles": [], "arm": limited}
    made = vff.plan(scene, ends[1])
    assert made.status == "found"
    assert (made.q >= lower).all() and (made.q <= upper).all()
    vff.Scenario.from_dict({**scene, "reference": made.reference})


NEAR: dict[str, Any] = {
    **GAP,
    "q0": [1.5, -0.3, -0.3, -0.3],
    "obstacles": [],
}


def near(q: list[float], gap: float) -> dict[str, Any]:
    """A scene with a disc beside the tip of the arm at `q`, that far from it."""
    ends = vff.Scenario.from_dict(NEAR).arm.forward_kinematics(q)
    along = ends[-1] - ends[-2]
    across = np.array([along[1], -along[0]])
    disc = {
        "shape": {"kind": "circle", "radius": 0.2},
        "position": (ends[-1] + across * (0.25 + gap)).tolist(),
    }
    return {**NEAR, "obstacles": [disc]}


AWAY = [2.6, 0.2, 0.2, 0.2]


def distances(plan: vff.Plan, scene: dict[str, Any], times: Any) -> Any:
    q, dq, _ = plan.at(times)
    return vff.distances(vff.Scenario.from_dict(scene).arm, q, dq, scene["obstacles"], times).distance


def test_a_margin_is_lowered_near_the_end_that_needs_it() -> None:
    scene = near(NEAR["q0"], 0.005)
    made = vff.plan(scene, AWAY)
    assert made.status == "found" and made.margin == pytest.approx(0.0045, abs=1e-9)
    assert made.message.endswith("less than the margin of 20.0 mm is kept: 4.5 mm at the start")
    assert 0.0 < made.margins[0, 3] < 0.005 and made.margins[-1, 3] > 0.006
    # Where the arm is a third of the way away, all of it is kept again.
    assert (made.margins[len(made.t) // 3 :] > 0.006).all()
    back = vff.plan({**scene, "q0": AWAY}, NEAR["q0"])
    assert back.margin == pytest.approx(0.0045, abs=1e-9) and "4.5 mm at the goal" in back.message
    assert "less than" not in vff.plan(NEAR, AWAY).message


def test_what_a_plan_keeps_is_kept(found: vff.Plan) -> None:
    scene = near(NEAR["q0"], 0.002)
    for plan, document in ((found, GAP), (vff.plan(scene, AWAY), scene)):
        times = np.arange(0.0, plan.duration, 5e-4)
        piece = np.searchsorted(plan.t, times, side="right") - 1
        kept = np.minimum(plan.margins[piece], plan.margins[piece + 1])
        apart = distances(plan, document, times).reshape(len(times), 4, -1).min(axis=2)
        assert (apart >= kept).all()
        assert kept.min() > 0.0 and kept.max() > 0.006


@pytest.mark.parametrize("avoidance", ["cbf", "priority"])
def test_barriers_keep_what_the_plan_keeps(avoidance: str) -> None:
    """A goal 3 mm from a disc: with the margin of 20 mm of the barrier the arm stands off."""
    scene = {**near(AWAY, 0.003), "q0": NEAR["q0"]}
    plan = vff.plan(scene, AWAY)
    changes: dict[str, Any] = {"controller.avoidance": avoidance, "controller.posture_stiffness": 200.0}
    changes |= {"reference": plan.reference, "duration": round(plan.duration + 3.0, 3)}
    follower = vff.Scenario.from_dict(scene).replace(**changes)
    arrived = vff.simulate(follower)
    assert abs(arrived.error[-1]).max() < 1e-3 and arrived.metrics.min_clearance > 0.0
    reference = {key: value for key, value in plan.reference.items() if key != "margins"}
    assert abs(vff.simulate(follower.replace(reference=reference)).error[-1]).max() > 5e-3


@pytest.mark.parametrize("seed", range(4))
def test_limits_hold_between_the_instants(seed: int) -> None:
    """Speeds and joint limits at every instant, from one end of joints to the other."""
    ends = np.random.default_rng(seed).uniform(-1.5, 1.5, (2, 4))
    lower, upper = np.sort(ends, axis=0)
    limits = np.stack([lower, upper], axis=1).tolist()
    limited = {**GAP["arm"], "joint_limits": limits, "velocity_limits": [0.5, 1.0, 1.5, 2.0]}
    scene = {**GAP, "q0": ends[0].tolist(), "obstacles": [], "arm": limited}
    made = vff.plan(scene, ends[1], speed=0.9)
    assert made.status == "found"
    q, dq, ddq = made.at(np.arange(0.0, made.duration, 1e-4))
    assert (q >= lower).all() and (q <= upper).all()
    assert (abs(dq) <= 0.9 * np.array([0.5, 1.0, 1.5, 2.0])).all()
    assert (abs(ddq) <= 0.9 * 30.0).all()
    assert made.q[0].tolist() == ends[0].tolist() and made.q[-1].tolist() == ends[1].tolist()


def test_the_clearance_is_that_of_what_is_blocked() -> None:
    scene = near(AWAY, -0.01)
    blocked = vff.plan({**scene, "q0": NEAR["q0"]}, AWAY)
    assert blocked.status == "goal blocked" and blocked.clearance == pytest.approx(-0.01, abs=1e-9)
    assert "10.00 mm inside obstacle 0" in blocked.message
    blocked = vff.plan({**scene, "q0": AWAY}, NEAR["q0"])
    assert blocked.status == "start blocked" and blocked.clearance == pytest.approx(-0.01, abs=1e-9)
    folded = {**vff.Scenario.load("panda-sweep").to_dict(), "obstacles": []}
    folded["controller"]["self_collision"] = "avoid"
    own = vff.plan(folded, [0.0, 1.2, 0.0, -3.0, 0.0, -0.01, 0.0])
    assert f"{-1e3 * own.clearance:.2f} mm inside" in own.message
    assert ("panda_link0", "panda_link2") in own.ignored


def test_a_posture_needs_something_to_pull_to() -> None:
    stiff = {**GAP["controller"], "posture_stiffness": 5.0}
    with pytest.raises(ScenarioError, match="posture"):
        vff.simulate({**GAP, "controller": stiff})


def test_who_is_where_they_should_be_has_nothing_to_go(found: vff.Plan) -> None:
    """A plan without a way is one to follow, and to watch over."""
    nowhere = vff.plan(GAP, GAP["q0"])
    assert nowhere.status == "found" and np.ptp(nowhere.q, axis=0).max() == 0.0
    done = vff.simulate(following(nowhere, replan={}, duration=0.3))
    assert done.status == "completed" and done.replans == ()
    tour = vff.plan(GAP, [found.q[-1], GAP["q0"]])
    with pytest.raises(ScenarioError, match="without rests on the way"):
        following(tour, replan={})


def test_what_is_still_within_the_horizon_stands_still(found: vff.Plan) -> None:
    """What flies off later, and what is fast elsewhere, block no more than they meet."""
    rests = {"shape": {"kind": "circle", "radius": 0.1}, "position": [0.6, -0.7]}
    later = {"kind": "waypoints", "times": [100.0, 100.1], "points": [rests["position"], [-9.5, -9.5]]}
    scene = vff.Scenario.from_dict(GAP)
    walls = scene["obstacles"]
    still, waits = (
        vff.plan(scene.replace(obstacles=[*walls, each])) for each in (rests, rests | {"motion": later})
    )
    np.testing.assert_array_equal(still.q, waits.q)
    smooth = later | {"interpolation": "smooth"}
    assert vff.plan(scene.replace(obstacles=[*walls, rests | {"motion": smooth}])).status == "found"
    bar = {"shape": {"kind": "box", "size": [2.0, 0.05]}, "position": [0.6, -1.2]}
    spins = later | {"points": [bar["position"]] * 2, "angles": [0.0, 3.0]}
    assert vff.plan(scene.replace(obstacles=[*walls, bar | {"motion": spins}])).status == "found"
    leaves = rests | {"motion": later | {"times": [0.5, 0.6]}}
    passed = vff.plan(scene.replace(obstacles=[*walls, leaves]))
    assert passed.status == "found" and passed.begins == 0.0
    way = later | {"times": [0.5, 0.6], "points": [[-9.5, -9.5], [0.0, 0.0]]}
    comes = rests | {"position": way["points"][0], "motion": way}
    blocked = vff.plan(scene.replace(obstacles=[*walls, comes]))
    assert blocked.status == "start blocked" and "obstacle 2 passes within the horizon" in blocked.message
    slow = rests | {"motion": {"kind": "linear", "velocity": [0.0, -0.02]}}
    fast = {"shape": {"kind": "circle", "radius": 0.1}, "position": [-50.0, 5.0]}
    fast |= {"motion": {"kind": "linear", "velocity": [-100.0, 0.0]}}
    both = vff.plan(scene.replace(obstacles=[*walls, slow, fast]))
    assert both.status == "found", both.message


def test_a_plan_is_one_that_the_law_can_follow() -> None:
    """It goes no faster than the tip may, and needs no torque sooner than the robot has it; to any goal."""
    scene = vff.Scenario.from_dict(GAP).replace(**{"controller.avoidance": "cbf"})
    quick = vff.plan(scene, speed=0.9)
    slow = {"torque_rate": 800.0, "tip_speed": 1.0, "tip_angular_speed": 2.0}

    def most(plan: vff.Plan, n: int = 4000) -> list[float]:
        times = np.linspace(0.0, plan.duration, n)
        q, dq, ddq = plan.at(times)
        torque = np.array([scene.arm.inverse_dynamics(*each) for each in zip(q, dq, ddq, strict=True)])
        tip = scene.arm.forward_kinematics(q)[:, -1]
        apart = times[1]
        goes = np.linalg.norm(np.diff(tip, axis=0), axis=1) / apart
        return [
            float(np.abs(np.diff(torque, axis=0)).max() / apart),
            float(goes.max()),
            float(np.abs(dq.sum(axis=1)).max()),
        ]

    assert most(quick)[0] > 800.0 and most(quick)[1] > 1.0 and most(quick)[2] > 2.0
    limited = scene.replace(**{f"controller.command.{key}": limit for key, limit in slow.items()})
    for goal in (None, [2.9, 0.5], {"position": [2.9, 0.5], "orientation": 0.0}, quick.q[-1]):
        plan = vff.plan(limited, goal, speed=0.9)
        assert plan.status == "found", plan.message
        for value, limit in zip(most(plan), slow.values(), strict=True):
            assert value <= 0.905 * limit
    for key in slow:
        with pytest.raises(ScenarioError, match=rf"controller\.command\.{key}: too little to get anywhere"):
            vff.plan(scene.replace(**{f"controller.command.{key}": 1e-6}))
    changes: dict[str, Any] = {"reference": plan.reference, "duration": round(plan.duration + 1.0, 3)}
    done = vff.simulate(limited.replace(**changes, **{"controller.posture_stiffness": 200.0}))
    assert abs(done.error).max() < 0.05 and done.metrics.min_clearance > 0.01


@pytest.mark.parametrize("who", ["controller", "robot"])
def test_a_torque_that_holds_the_arm_changes_no_faster_than_it_may(who: str) -> None:
    """What is sent, with gravity or without."""
    scene = vff.Scenario.load("panda-shelf")
    limited = scene.replace(**{"controller.command": {"gravity": who, "torque_rate": 60.0}})
    plan = vff.plan(limited, horizon=0.0)
    assert plan.status == "found", plan.message
    times = np.linspace(0.0, plan.duration, 3000)
    sent = np.array(
        [
            scene.arm.inverse_dynamics(q, dq, ddq) - (scene.arm.gravity_torque(q) if who == "robot" else 0.0)
            for q, dq, ddq in zip(*plan.at(times), strict=True)
        ]
    )
    fastest = float(np.abs(np.diff(sent, axis=0)).max() / times[1])
    assert 0.8 * 30.0 < fastest <= 1.01 * 30.0


@pytest.mark.parametrize("name", ["panda-shelf", "narrow-gap"])
@pytest.mark.parametrize(
    ("limits", "speed"),
    [
        ({"acceleration": 2.0}, 0.5),
        ({"jerk": 60.0}, 1.0),
        ({"acceleration": 1.0, "jerk": 5.0}, 0.5),
        ({"acceleration": 6.0, "jerk": 2000.0}, 1.0),
    ],
)
def test_limits_of_acceleration_and_jerk_are_kept(name: str, limits: dict[str, float], speed: float) -> None:
    """By differences of what the follower gets, one of them nearly used."""
    plan = vff.plan(name, horizon=0, speed=speed, **limits)
    assert plan.status == "found" and plan.clearance > 0.0, plan.message
    times = np.linspace(0.0, plan.duration, 4001)
    ddq = np.gradient(plan.at(times)[1], times, axis=0)
    jerk = np.diff(np.vstack([0.0 * plan.ddq[:1], plan.ddq, 0.0 * plan.ddq[:1]]), axis=0) / np.diff(plan.t)[0]
    used = {"acceleration": abs(ddq).max(), "jerk": abs(jerk).max()}
    shares = {key: used[key] / (speed * most) for key, most in limits.items()}
    assert max(shares.values()) <= 1.001, shares
    fastest = abs(plan.at(times)[1]).max() / (3.0 * speed)
    assert max(*shares.values(), fastest) > 0.6, shares
    each = {key: [value] * plan.q.shape[1] for key, value in limits.items()}
    np.testing.assert_array_equal(vff.plan(name, horizon=0, speed=speed, **each).q, plan.q)


def test_limits_that_are_none_are_refused() -> None:
    for key in ("acceleration", "jerk"):
        for bad in (0.0, -1.0, np.nan, np.inf, [1.0, 2.0], "fast", [[1.0]], 1e-12):
            with pytest.raises((InputError, InputTypeError, ScenarioError), match=key):
                vff.plan(GAP, **{key: bad})
        with pytest.raises(ScenarioError, match=f"replan.{key}"):
            vff.simulate(vff.Scenario.load("narrow-gap").replace(replan={key: [1.0]}))


def test_what_is_carried_leans_no_more_than_it_may() -> None:
    """In space and in the plane; on every leg of a tour from how it stood first."""
    cup = vff.Scenario.load("panda-shelf").replace(**{"controller.task": "position"})
    home, most = cup["q0"], np.radians(10.0)

    def leans(plan: vff.Plan) -> float:
        q, _, _ = plan.at(np.linspace(0.0, plan.duration, 2000))
        turned = np.array([cup.arm.pose(each)[1] for each in [np.array(home), *q]])
        # The third row of a rotation: where the vertical is in the frame of the hand.
        w, x, y, z = turned.T
        row = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=1)
        return float(np.arccos(np.clip(row[1:] @ row[0], -1.0, 1.0)).max())

    tour = vff.plan(cup, [[0.35, -0.35, 0.5], [0.4, 0.3, 0.4], home], tilt=most)
    assert tour.status == "found", tour.message
    assert tour.tilt is not None and tour.tilt <= most and leans(tour) <= most
    assert leans(vff.plan(cup, [0.35, -0.35, 0.5])) > most, "which it would do otherwise"
    flat = vff.plan("narrow-gap", tilt=0.3)
    turns = flat.q.sum(axis=1)
    assert flat.tilt is not None and np.ptp(turns) > 0.1 and abs(turns - turns[0]).max() <= 0.3
    for bad in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises((InputError, ScenarioError), match="tilt"):
            vff.plan(GAP, tilt=bad)


def test_a_leaning_plan_is_kept_in_files(tmp_path: Path) -> None:
    for tilt in (None, 0.3):
        plan = vff.plan("narrow-gap", tilt=tilt)
        assert vff.Plan.load(plan.save(tmp_path / "plan.npz")).tilt == plan.tilt
        assert (plan.tilt is None) == (tilt is None)


def test_another_plan_leans_no_more() -> None:
    """What `[replan]` finds keeps to its own tilt, from how the hand stood at `q0`."""
    gap = vff.Scenario.load("narrow-gap")
    plan = vff.plan(gap, tilt=0.3)
    there = gap.arm.forward_kinematics(plan.at(0.6 * plan.duration)[0])[-1].tolist()
    comes = {"kind": "waypoints", "times": [0.1, 0.2], "points": [[9.0, 9.0], there]}
    disc = {"shape": {"kind": "circle", "radius": 0.05}, "position": [9.0, 9.0], "motion": comes}
    law = {"controller.posture_stiffness": 200.0, "controller.avoidance": "cbf", "duration": 6.0}
    most = {}
    for tilt in (None, 0.3):
        settings = {} if tilt is None else {"tilt": tilt}
        obstacles = [*gap["obstacles"], disc]
        done = vff.simulate(
            gap.replace(obstacles=obstacles, reference=plan.reference, replan=settings, **law)
        )
        assert [search.status for search in done.replans][:1] == ["found"]
        most[tilt] = abs(done.q_plan.sum(axis=1) - sum(gap["q0"])).max()
    assert most[0.3] <= 0.3 and most[None] > 0.5
    with pytest.raises(ScenarioError, match=r"replan\.tilt: must be .* at least, as the end effector leans"):
        gap.replace(reference=vff.plan(gap).reference, replan={"tilt": 0.01})


def test_the_command_line(tmp_path: Path) -> None:
    scenario = tmp_path / "gap.toml"
    vff.Scenario.from_dict(GAP).save(scenario)

    def run(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "vffnull", "plan", str(scenario), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    done = run("--out", str(tmp_path / "plan.npz"), "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["status"] == "found"
    assert vff.Plan.load(tmp_path / "plan.npz").status == "found"
    away = run("--goal", "3.9,3.0")
    assert away.returncode == 3 and "goal out of reach" in away.stdout
    assert re.search(r"^gap +[\d.]+ m  +what was left to the goal$", away.stdout, re.MULTILINE)
    for wrong in (["--goal", "a,b"], ["--goal", "1,2,3"], ["--orientation", "1"], ["--out", "x.txt"]):
        assert run(*wrong).returncode == 2
    posed = run("--goal", "2.5,0.4", "--orientation", "0.3")
    assert posed.returncode == 0, posed.stdout + posed.stderr
    assert re.search(r"^clearance +[\d.]+ m  +smallest distance from obstacles$", posed.stdout, re.MULTILINE)
    assert re.search(r"^duration +[\d.]+ s ", posed.stdout, re.MULTILINE)


def test_ctrl_c_ends_a_search() -> None:
    """A search that would take minutes ends soon after the signal."""
    post = {"shape": {"kind": "box", "size": [0.3, 20.0]}, "position": [1.9, 0.0]}
    # From one side of a wall to the other: never found.
    stuck = {**GAP, "obstacles": [post], "q0": [2.0, 0.1, 0.1, 0.1]}
    goal = [-1.7, 0.1, 0.1, 0.1]
    bars = [
        {"shape": {"kind": "box", "size": [6.0, 0.1]}, "position": [-3.6, 0.0]},
        {"shape": {"kind": "box", "size": [6.0, 0.1]}, "position": [3.6, 0.0]},
    ]
    stuck["obstacles"] = bars
    sent: list[float] = []

    def interrupt() -> None:
        time.sleep(0.5)
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    assert vff.plan(stuck, goal, samples=200).status == "not found"
    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        vff.plan(stuck, goal, samples=10_000_000)
    assert sent, "it was not the signal that ended it"
    thread.join()


def test_where_there_is_room_a_plan_says_so() -> None:
    """What barriers keep along a plan is what is measured there, not what was asked for: where the way is
    free, all that `yielding.margin` says.
    """
    free = vff.plan({**GAP, "obstacles": []})
    assert free.margins.min() > 0.02 and free.margins[-1].min() > 0.25
    disc = {
        "shape": {"kind": "circle", "radius": 0.2},
        "position": [9.0, 9.0],
        "motion": {"kind": "waypoints", "times": [0.0, 8.0], "points": [[9.0, 9.0], free.tip[-1].tolist()]},
    }
    scene = following(free, obstacles=[disc], duration=9.0, **{"controller.yielding.margin": 0.1})
    result = vff.simulate(scene, {"controller.avoidance": "cbf"})
    assert result.metrics["min_clearance"] > 0.095, "somebody comes who asked for 10 cm"
    narrow = vff.plan(GAP)
    wide = np.minimum(narrow.margins, 0.02).mean()
    assert wide > 0.012, "in the gap no more than is there, elsewhere all of it"


def test_a_wall_that_tilts_blocks_what_it_sweeps() -> None:
    """Its surface has no end: what of it comes to the arm counts."""
    a, b = [0.0, 0.6, 0.0, -1.2, 0.0, 0.6, 0.0], [0.8, 0.6, 0.0, -1.2, 0.0, 0.6, 0.0]
    wall = vff.Obstacle.half_space([0.0, 0.0, -0.3], [0.0, 0.0, 1.0], angular_velocity=[1.2, 0.0, 0.0])
    slow = vff.Obstacle.half_space([0.0, 0.0, -0.3], [0.0, 0.0, 1.0], angular_velocity=[0.1, 0.0, 0.0])
    scene = {"duration": 1.0, "q0": a, "arm": {"model": "iiwa14"}, "reference": {"kind": "setpoint"}}
    arm, times = vff.Arm.named("iiwa14"), np.linspace(0.0, 1.0, 51)
    for obstacle, status in ((wall, "blocked"), (slow, "found")):
        plan = vff.plan(scene | {"obstacles": [obstacle.to_dict()]}, b, horizon=1.0)
        assert status in plan.status, plan.message
        for q in plan.q if status == "found" else ():
            room = vff.distances(arm, np.tile(q, (51, 1)), np.zeros((51, 7)), [obstacle], t=times).distance
            assert room.min() > 0.0


@pytest.mark.parametrize("seed", range(24))
def test_what_has_turned_is_what_stands_so(seed: int) -> None:
    """A thin post that rests after a quarter of a turn is planned around as one that always stood so: what is
    certified along a plane between both is so whichever way the obstacle has turned.
    """
    draw = np.random.default_rng(seed)
    q0, goal = (draw.uniform(-1.5, 1.5, 3).tolist() for _ in range(2))
    place, angle = draw.uniform(-1.0, 2.5, 2).tolist(), float(draw.uniform(-1.0, 1.0))
    post = {"shape": {"kind": "box", "size": [0.002, 0.002]}, "position": place}
    turned = angle + np.pi / 2
    motion = {"kind": "waypoints", "times": [0.0, 1.0], "points": [place] * 2, "angles": [angle, turned]}
    plans = []
    for each in ({**post, "angle": angle, "motion": motion}, {**post, "angle": turned}):
        scene = vff.Scenario(
            duration=5.0,
            q0=q0,
            arm={"lengths": [1.0] * 3, "masses": 1.0, "radius": 0.004},
            controller={"self_collision": "ignore"},
            reference={"kind": "setpoint", "point": [1.0, 1.0]},
            obstacles=[each],
        )
        asked = {"time": 2.0, "horizon": 1.0, "samples": 2000, "paths": 1, "margin": 0.004, "speed": 1.0}
        plans.append(vff.plan(scene, goal, **asked))
    assert plans[0].status == plans[1].status
    if plans[0].status == "found":
        t = np.linspace(0.0, plans[0].duration, 2000)
        q, dq, _ = plans[0].at(t)
        apart = vff.distances(scene.arm, q, dq, [{**post, "angle": turned}], t=2.0).distance.min()
        assert apart > 0.0 and plans[0].clearance == pytest.approx(plans[1].clearance, abs=1e-6)
