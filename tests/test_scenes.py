"""Random scenes: the same for ever, valid, what their family says, and judged without any controller."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vffnull as vff
from vffnull.errors import InputError, InputTypeError
from vffnull.evaluation import planner, scenes
from vffnull.evaluation.geometry import plane

SIZES = (4, 6, 9)
some_scene = st.tuples(st.sampled_from(scenes.FAMILIES), st.integers(3, 12), st.integers(0, 1_999_999))


def fingerprint(family: str) -> str:
    made = [scenes.random(family, n, seed) for n in SIZES for seed in (0, 1, 1_000_000)]
    documents = [[scene[key] for key in ("q0", "arm", "reference", "obstacles")] for scene in made]
    return hashlib.sha256(json.dumps(documents, sort_keys=True).encode()).hexdigest()[:16]


def path(scene: vff.Scenario, times: np.ndarray) -> np.ndarray:
    tip = scene.arm.forward_kinematics(scene["q0"])[-1]
    return planner.reference_points(scene["reference"], tip, times)


def room_of_the_task(scene: vff.Scenario) -> np.ndarray:
    """Distance of every obstacle's surface from the reference at every instant [m], (times, obstacles)."""
    times = np.arange(0.0, scenes.DURATION, 0.02)
    points = path(scene, times)
    rooms = []
    for each in scene["obstacles"]:
        world = plane.World([each])
        point = np.stack([points, points + np.array([1e-9, 0.0])], axis=1)  # a link of no length
        rooms.append(world.clearance(point, 0.0, times)[:, 0])
    return np.stack(rooms, axis=1)


@settings(max_examples=40, deadline=None)
@given(some_scene)
def test_a_seed_is_a_scene_and_every_scene_can_be_run(key: tuple[str, int, int]) -> None:
    """Twice the same document; no warning; nothing touches the arm at the start."""
    scene = scenes.random(*key)
    assert scene == scenes.random(*key)
    assert scene.name == "-".join(map(str, key))
    result = vff.simulate(scene, {"duration": 0.01})
    assert result.status == "completed" and result.warnings == ()
    assert result.clearance[0].min() >= 0.25 - 1e-9


def test_scenes_are_the_same_for_ever() -> None:
    """Rates in the documents are of these scenes: whoever changes them has to run the evaluation again."""
    assert {family: fingerprint(family) for family in scenes.FAMILIES} == FINGERPRINTS


FINGERPRINTS = {
    "links-swept": "e7bbc48640b90fff",
    "path-crossed": "c6e0cdef2afec9ab",
    "clutter": "7fd4756f05b4cabb",
    "crowd": "d6194747c12119dd",
}


def test_categories_are_made_of_the_families_in_turn() -> None:
    assert scenes.random(1, 6, 5) == scenes.random("links-swept", 6, 5)
    turns = [scenes.random(2, 6, seed).name.rsplit("-", 2)[0] for seed in range(6)]
    assert turns == ["path-crossed", "clutter", "crowd"] * 2
    assert len(scenes.CATEGORIES[1] + scenes.CATEGORIES[2]) == len(scenes.FAMILIES)
    assert not set(scenes.TRAINING) & set(scenes.EVALUATION)


@pytest.mark.parametrize("n", SIZES)
@pytest.mark.parametrize("seed", range(4))
def test_families_are_what_they_say(n: int, seed: int) -> None:
    """Each family's promise, by distances that share no code with the core's."""
    swept, crossed, clutter, crowd = (scenes.random(family, n, seed) for family in scenes.FAMILIES)
    assert 1 <= len(swept["obstacles"]) <= 2 and room_of_the_task(swept).min() > 0.34
    assert room_of_the_task(crossed).min() < 0.03  # nearer than the tip's own radius: it cannot pass
    assert 3 <= len(clutter["obstacles"]) <= 8 and room_of_the_task(clutter).min() > 0.14
    assert all("motion" not in each for each in clutter["obstacles"])
    assert 3 <= len(crowd["obstacles"]) <= 8
    assert all(each["shape"]["kind"] == "circle" and "motion" in each for each in crowd["obstacles"])


@pytest.mark.parametrize("family", scenes.FAMILIES)
@pytest.mark.parametrize("seed", range(3))
def test_an_escape_is_one(family: str, seed: int) -> None:
    """What the core's planner has found is checked by the other implementation of the geometry."""
    scene = scenes.random(family, 6, seed)
    verdict, motion = planner.escape(scene)
    assert (motion is None) == (verdict == "none found")
    if motion is not None:
        assert planner.is_clear(scene.to_dict(), motion, verdict == "with tip")
        speed = np.diff(motion, axis=0) / planner.STEP
        assert np.abs(speed).max() <= planner.MAX_SPEED + 1e-9
        assert np.abs(np.diff(speed, axis=0)).max() <= planner.MAX_ACCELERATION[2] * planner.STEP + 1e-9
        np.testing.assert_allclose(motion[0], scene["q0"])


def test_no_controller_has_a_say_in_feasibility() -> None:
    """The verdict and the motion are those of the same scene under any other controller and time step."""
    scene = scenes.random("crowd", 4, 3)
    other = scene.replace(
        **{"controller.avoidance": "cbf", "controller.field.gain": 0.0, "controller.stiffness": 1.0},
        **{"simulation.dt": 2e-3, "simulation.integrator": "semi_implicit_euler"},
    )
    verdict, motion = planner.escape(scene)
    again, same = planner.escape(other)
    assert verdict == again
    np.testing.assert_array_equal(motion, same)


@pytest.mark.parametrize("seed", range(4))
def test_an_escape_stays_one_when_an_obstacle_is_taken_away(seed: int) -> None:
    """What "clear" means is monotone in the obstacles, and without any the tip can be held."""
    scene = scenes.random("crowd", 6, seed).to_dict()
    verdict, motion = planner.escape(vff.Scenario.from_dict(scene))
    for k in range(len(scene["obstacles"])):
        fewer = scene | {"obstacles": scene["obstacles"][:k] + scene["obstacles"][k + 1 :]}
        if motion is not None:
            assert planner.is_clear(fewer, motion, verdict == "with tip")
    assert vff.feasibility(vff.Scenario.from_dict(scene | {"obstacles": []})) == "with tip"


def test_feasibility_refuses_what_it_cannot_judge() -> None:
    with pytest.raises(InputTypeError, match="expected a name, a path, a dict or a Scenario, not a int"):
        vff.feasibility(3)  # type: ignore[arg-type]
    short = {"reference.point": [2.8, 1.6, 0.0]}
    with pytest.raises(vff.errors.ScenarioError, match=r"reference\.point"):
        vff.feasibility(vff.Scenario.load("paper-1").replace(**short))


def test_a_planar_pose_is_held_with_its_angle() -> None:
    """Six links hold a pose at which a disc passes their middle; three links have no freedom for it."""
    q0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]
    scene = {
        "duration": 4.0,
        "q0": q0,
        "arm": {"lengths": [1.0] * 6, "masses": 1.0},
        "controller": {"task": "pose"},
        "obstacles": [
            {
                "shape": {"kind": "circle", "radius": 0.15},
                "position": [1.6, 2.9],
                "motion": {"kind": "linear", "velocity": [0.0, -0.35]},
            }
        ],
    }
    links = np.cumsum(q0)
    pose = [float(np.cos(links).sum()), float(np.sin(links).sum()), float(links[-1])]
    scene["reference"] = {"kind": "setpoint", "point": pose}
    verdict, motion = planner.escape(scene)
    assert verdict == "with tip" and motion is not None
    angle = motion.sum(axis=1)
    assert np.abs(angle - pose[2]).max() <= planner.ANGLE
    tip = plane.Kinematics(np.ones(6), 0.0).joints(motion)[:, -1]
    assert np.linalg.norm(tip - pose[:2], axis=1).max() <= planner.TIP
    few = {"q0": q0[:3], "arm": {"lengths": [2.0, 2.0, 2.0], "masses": 1.0}}
    links = np.cumsum(q0[:3])
    pose = [float(2 * np.cos(links).sum()), float(2 * np.sin(links).sum()), float(links[-1])]
    few["reference"] = {"kind": "setpoint", "point": pose}
    assert vff.feasibility(scene | few) == "without tip"


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((3, 6, 0), InputError, "category: expected 1, 2 or one of links-swept"),
        (("crowds", 6, 0), InputError, "not 'crowds'"),
        ((1.0, 6, 0), InputTypeError, "category: expected 1, 2 or a family, not a float"),
        ((1, 2, 0), InputError, "n: must be from 3 to 12, got 2"),
        ((1, 6.0, 0), InputTypeError, "n: expected a whole number, not a float"),
        ((1, 6, -1), InputError, "seed: must be from 0 to 1999999, got -1"),
    ],
)
def test_wrong_arguments_are_named(arguments: tuple, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        scenes.random(*arguments)
