"""The torque along smooth motions in space (docs/theory.md, *Continuity*): near contact, in singularities."""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from test_hulls_on_links import mixed
from vffnull.model.arm import arm_of

LAWS = ("null_space", "relaxed", "priority", "cbf")
FIELD = vff.Field.bounded(40, 0.25)
NEAREST = 0.002
"""How near the ball comes [m]."""
PANDA, UR5E = vff.Arm.named("panda"), vff.Arm.named("ur5e")
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
STRETCHED_WRIST = np.array([0.0, -1.2, 1.6, -0.6, 0.0, 0.3])  # joint 4 at 0: two axes in one line

Array = Any


def beside_the_elbow(s: float) -> Array:
    return READY + 0.25 * np.sin(2 * np.pi * s) * np.array([1.0, 0.3, 0.5, 0.2, 0.4, 0.3, 0.2])


def through_a_singularity(s: float) -> Array:
    return STRETCHED_WRIST + np.array([0.2, 0.1, 0.1, 0.2, 0.4, 0.3]) * np.sin(2 * np.pi * s + 0.1)


def largest_step(
    arm: Any, motion: Callable[[float], Array], law: str, ball: vff.Obstacle, steps: int
) -> tuple[float, float]:
    """The largest change of a torque from one instant to the next [N·m], and the least clearance [m]."""
    settings = vff.ControlSettings(
        task="pose", stiffness=100, damping=20, null_damping=8, field=FIELD, avoidance=law
    )
    controller, h = vff.Controller(arm, settings), 1e-6
    wanted = np.concatenate(arm.pose(motion(0.2)))
    torques, clearances = [], []
    for s in np.linspace(0.0, 1.0, steps + 1):
        rate = (motion(s + h) - motion(s - h)) / (2 * h)
        terms = controller.terms(motion(s), rate, wanted, obstacles=[ball])
        torques.append(terms.tau)
        clearances.append(terms.clearance.min())
    return float(np.abs(np.diff(torques, axis=0)).max()), float(min(clearances))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("arm", "motion", "place", "singular"),
    [
        (PANDA, beside_the_elbow, [0.3, 0.28, 0.7], False),
        (UR5E, through_a_singularity, [0.4, 0.0, 0.75], True),
    ],
    ids=["2 mm", "singularity"],
)
def test_a_torque_in_half_the_step_changes_half_as_much(
    arm: Any, motion: Callable[[float], Array], place: list[float], singular: bool, law: str
) -> None:
    """A jump would be as large in any step. The ball comes as near as 2 mm, and pushes."""
    volume = [
        np.linalg.det(J @ J.T) for J in (np.array(arm.jacobian(motion(s))) for s in np.linspace(0, 1, 501))
    ]
    assert (np.sqrt(max(min(volume), 0.0)) < 1e-3) == singular
    _, far = largest_step(arm, motion, "null_space", vff.Obstacle.sphere(place, 0.01), 500)
    ball = vff.Obstacle.sphere(place, 0.01 + far - NEAREST)
    coarse, fine = (largest_step(arm, motion, law, ball, steps) for steps in (1000, 2000))
    assert fine[1] == pytest.approx(NEAREST, abs=2e-4)
    assert fine[0] == pytest.approx(coarse[0] / 2, rel=0.05)


def fast_among_balls(law: str, seed: int) -> Callable[[float], Array]:
    """The torque along a random swing of a Panda, fast, between balls that move."""
    draw = np.random.default_rng(seed)
    middle, wide = READY + draw.normal(0.0, 0.2, 7), draw.normal(0.0, 0.2, 7)
    fast = draw.uniform(-1.1, 1.1, 7) * np.array(PANDA.velocity_limits)
    links, target = np.array(PANDA.forward_kinematics(middle)), np.array(PANDA.pose(middle)[0])
    target += draw.normal(0.0, 0.05, 3)
    places = links[draw.integers(3, 7, 3)] + draw.normal(0.0, 0.12, (3, 3))
    ways = draw.normal(0.0, 0.6, (3, 3))
    balls = [
        vff.Obstacle.sphere(place, 0.03, motion=vff.Motion.linear(way))
        for place, way in zip(places, ways, strict=True)
    ]
    settings = vff.ControlSettings(stiffness=400.0, damping=40.0, null_damping=8.0, avoidance=law)
    controller = vff.Controller(PANDA, settings)

    def torque(s: float) -> Array:
        q, dq = middle + wide * np.sin(2 * np.pi * s), fast * np.cos(2 * np.pi * s)
        return np.array(controller.torque(q, dq, target, obstacles=balls, t=0.0))

    return torque


def jump(torque: Callable[[float], Array], a: float, b: float) -> float:
    """What is left of a change of torque [N·m] in an interval that is halved where it changes most."""
    before, after = torque(a), torque(b)
    for _ in range(40):
        between = torque(0.5 * (a + b))
        if np.abs(between - before).max() < np.abs(between - after).max():
            a, before = 0.5 * (a + b), between
        else:
            b, after = 0.5 * (a + b), between
    return float(np.abs(after - before).max())


@pytest.mark.parametrize("law", ["null_space", "priority"])
def test_no_torque_jumps_where_limits_set_in(law: str) -> None:
    """Where a torque comes to its limit, or a joint to its largest speed."""
    grid = np.linspace(0.0, 0.5, 41)
    swings = [fast_among_balls(law, seed) for seed in range(40)]
    limits = np.array(PANDA.torque_limits)
    assert sum(np.any(np.abs(swing(0.25)) > 0.999 * limits) for swing in swings) > 3
    worst = max(jump(swing, a, b) for swing in swings for a, b in itertools.pairwise(grid))
    assert worst < 1e-3


def folding(s: float) -> Array:
    """The hand to the upper arm and back: with hulls, to 3 cm of it."""
    away = np.array([0.3, 0.3, 0.2, -0.62, 0.3, 1.5, 0.4])
    return READY + 0.5 * (1 - np.cos(2 * np.pi * s)) * away


@pytest.mark.parametrize("law", ["null_space", "cbf"])
def test_hulls_that_keep_their_own_pairs_do_not_chatter(law: str) -> None:
    """Other pairs, faces and edges become the nearest ones on the way: in half the step the torque changes
    half as much, and not by jumps of 11 N·m.
    """
    arm = arm_of(mixed())
    settings = vff.ControlSettings(
        task="pose",
        stiffness=100,
        damping=20,
        null_damping=8,
        field=vff.Field.bounded(40, 0.15),
        avoidance=law,
        self_collision="avoid",
    )
    controller, h, wanted = vff.Controller(arm, settings), 1e-6, np.concatenate(arm.pose(folding(0.2)))
    steps = []
    for count in (1000, 2000):
        torques, clearances, active = [], [], []
        for s in np.linspace(0.0, 1.0, count + 1):
            rate = (folding(s + h) - folding(s - h)) / (2 * h)
            terms = controller.terms(folding(s), rate, wanted)
            torques.append(terms.tau)
            clearances.append(terms.self_clearance)
            active.append(np.abs(terms.tau_vff).max())
        assert min(clearances) < 0.05 and max(active) > 1.0
        steps.append(np.abs(np.diff(torques, axis=0)).max())
    assert steps[1] == pytest.approx(steps[0] / 2, rel=0.05)


def test_hulls_of_a_file_do_not_chatter_in_a_run(tmp_path: Path) -> None:
    """`collision = "file"`, barriers and own pairs: torques change by half as much in half the step."""
    pytest.importorskip("mujoco")
    path = tmp_path / "robot.xml"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
        path.write_text(arm_of(mixed()).to_mjcf(), encoding="utf-8")
        arm = vff.Arm.from_mjcf(path, tip="panda_hand_tcp", collision="file")
        assert any(each["shape"]["kind"] == "convex" for each in arm.to_dict()["collision"])
        changes = {
            "arm": arm.to_dict(),
            "controller.avoidance": "cbf",
            "controller.self_collision": "avoid",
            "simulation.record_every": 1,
            "duration": 3.0,
        }
        runs = [vff.simulate("panda-sweep", {**changes, "simulation.dt": dt}) for dt in (1e-3, 5e-4)]
    assert all(np.abs(run.tau_vff).max() > 1.0 for run in runs)
    coarse, fine = (float(np.abs(np.diff(run.tau[1:], axis=0)).max()) for run in runs)
    assert coarse < 1.0 and fine < 0.65 * coarse
