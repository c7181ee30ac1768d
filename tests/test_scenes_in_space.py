"""Random scenes in space: the same for ever, valid, what their family says, judged without any controller."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vffnull as vff
from vffnull.errors import InputError, InputTypeError
from vffnull.evaluation import planner, scenes
from vffnull.evaluation.geometry import space

INSTANTS = np.arange(0.0, 4.0, 0.02)
some_scene = st.tuples(
    st.sampled_from(scenes.FAMILIES),
    st.sampled_from(scenes.ARMS),
    st.sampled_from(scenes.TASKS),
    st.integers(0, 1_999_999),
)
every_kind = pytest.mark.parametrize(
    ("arm", "task"), [(arm, task) for arm in scenes.ARMS for task in ("position", "pose")]
)


def fingerprint(family: str, arms: tuple[str, ...] = scenes.EVALUATED) -> str:
    made = [
        scenes.in_space(family, arm, task, seed)
        for arm in arms
        for task in scenes.TASKS
        for seed in (0, 1_000_000)
    ]
    documents = [[scene[key] for key in ("q0", "controller", "reference", "obstacles")] for scene in made]
    return hashlib.sha256(json.dumps(documents, sort_keys=True).encode()).hexdigest()[:16]


def following(scene: vff.Scenario, task: str) -> np.ndarray:
    """Joint angles at `INSTANTS`, as a run follows the reference where nothing is in the way."""
    free = vff.simulate(scene, {"obstacles": [], "controller.field.gain": 0.0, "simulation.record_every": 20})
    assert np.linalg.norm(free.error, axis=1).max() < 0.01
    return free.q[: len(INSTANTS)]


def room(scene: vff.Scenario, q: np.ndarray, links: slice) -> np.ndarray:
    """Distances of some links from every obstacle by the core [m], (times, pairs)."""
    found = vff.distances(scene.arm, q, np.zeros_like(q), scene["obstacles"], INSTANTS)
    wanted = np.isin(found.link, np.arange(scene.arm.n)[links])
    return found.distance[:, wanted]


@settings(max_examples=25, deadline=None)
@given(some_scene)
def test_a_seed_is_a_scene_and_every_scene_can_be_run(key: tuple[str, str, str, int]) -> None:
    """Twice the same document; no warning; nothing near the arm at the start; limits of the maker on."""
    scene = scenes.in_space(*key)
    assert scene == scenes.in_space(*key)
    assert scene.name == "-".join(map(str, key))
    result = vff.simulate(scene, {"duration": 0.01})
    assert result.status == "completed"
    assert result.warnings == () or key[1:3] == ("ur5e", "pose"), result.warnings  # no freedom is left
    assert result.clearance[0].min() >= 0.08 - 1e-9
    for name in ("joint_limits", "velocity_limits", "torque_limits"):
        np.testing.assert_array_equal(getattr(scene.arm, name), getattr(vff.Arm.named(key[1]), name))


def test_scenes_are_the_same_for_ever() -> None:
    """Rates in the documents are of these scenes: whoever changes them has to run the evaluation again."""
    assert {family: fingerprint(family) for family in scenes.FAMILIES} == FINGERPRINTS
    assert {family: fingerprint(family, scenes.ARMS[3:]) for family in scenes.FAMILIES} == OF_OTHER_ARMS


FINGERPRINTS = {
    "links-swept": "b28bab6f4d2e4171",
    "path-crossed": "c43a714eadc67244",
    "clutter": "097840a0da5df3dd",
    "crowd": "02b69b85ed92f97d",
}
OF_OTHER_ARMS = {
    "links-swept": "f7ab2048b17534b2",
    "path-crossed": "dc0fdeb3b40fc558",
    "clutter": "e50905d7595218bf",
    "crowd": "f8c55244be456356",
}


@every_kind
def test_families_are_what_they_say(arm: str, task: str) -> None:
    """Each family's promise, by the core's distances, which the generator has no part of."""
    made = {family: scenes.in_space(family, arm, task, 0) for family in scenes.FAMILIES}
    q = {family: following(scene, task) for family, scene in made.items()}
    hand, first, all_links = slice(-2, None), slice(0, 1), slice(None)
    # A position leaves the law another way to turn the hand than the generator's.
    slack = 0.005 if task == "pose" else 0.04
    for family, scene in made.items():
        assert room(scene, q[family], first).min() > 0.08 - slack, family
        if family != "path-crossed":
            assert room(scene, q[family], hand).min() > 0.06 - slack, family
        if family in ("links-swept", "path-crossed"):
            assert room(scene, q[family], all_links).min() < 0.0, family
    assert 1 <= len(made["links-swept"]["obstacles"]) <= 2
    assert room(made["path-crossed"], q["path-crossed"], hand).min() < 0.0
    end = INSTANTS >= made["path-crossed"]["reference.duration"]
    assert room(made["path-crossed"], q["path-crossed"], hand)[end].min() > 0.1 - 1.5 * slack
    assert all("motion" not in each for each in made["clutter"]["obstacles"])
    crowd = made["crowd"]["obstacles"]
    assert 3 <= len(crowd) <= 6
    assert all(each["shape"]["kind"] == "sphere" and "motion" in each for each in crowd)


def test_sizes_speeds_and_shelves() -> None:
    """Bodies of 4 to 12 cm at 0.2 to 0.6 m/s; about half of the clutter has boards."""
    shelves = 0
    for seed in range(12):
        for family in scenes.FAMILIES:
            scene = scenes.in_space(family, "panda", "pose", seed)
            boards = 0
            for each in scene["obstacles"]:
                shape, motion = each["shape"], each.get("motion", {"kind": "static"})
                if shape["kind"] == "box":
                    half = 0.5 * np.linalg.norm(shape["size"])
                    boards += half > 0.13
                else:
                    half = shape["radius"] + np.linalg.norm(shape.get("b", 0.0))
                assert 0.04 - 1e-3 <= half <= 0.12 + 1e-3 or (family == "clutter" and half > 0.13)
                if motion["kind"] == "linear":
                    assert 0.199 < np.linalg.norm(motion["velocity"]) < 0.601
            shelves += boards >= 2
            assert family == "clutter" or boards == 0
    assert 2 <= shelves <= 10


@every_kind
@pytest.mark.parametrize("family", scenes.FAMILIES)
def test_an_escape_is_one(family: str, arm: str, task: str) -> None:
    """What the core's planner has found is checked by the other implementation of the geometry."""
    scene = scenes.in_space(family, arm, task, 3)
    verdict, motion = planner.escape(scene)
    if family == "clutter":  # the same search once more
        assert vff.feasibility(scene) == verdict
    assert (motion is None) == (verdict == "none found")
    if motion is not None:
        assert planner.is_clear(scene.to_dict(), motion, verdict == "with tip")
        model = scene.arm
        lower, upper = model.joint_limits.T
        assert (lower <= motion).all() and (motion <= upper).all()
        speed = np.diff(motion, axis=0) / planner.STEP
        assert (np.abs(speed) <= model.velocity_limits + 1e-9).all()
        most = planner.MAX_ACCELERATION[3] * planner.STEP
        assert np.abs(np.diff(speed, axis=0)).max() <= most + 1e-9
        np.testing.assert_allclose(motion[0], scene["q0"])


def test_a_motion_that_is_none_is_refused() -> None:
    """The check can fail: it sees a body in the way, a tip that left, and a hand that turned."""
    scene = scenes.in_space("links-swept", "panda", "pose", 0).to_dict()
    still = np.tile(scene["q0"], (81, 1))
    assert not planner.is_clear(scene, still, False)
    free = scene | {"obstacles": [], "reference": {"kind": "setpoint"}}
    assert planner.is_clear(free, still, True)
    turned = still.copy()
    turned[:, 6] += np.linspace(0.0, 0.1, 81)  # about the tool's axis
    assert not planner.is_clear(free, turned, True)
    assert planner.is_clear(free | {"controller": {"task": "pointing"}}, turned, True)
    away = still.copy()
    away[:, 0] += np.linspace(0.0, 0.1, 81)
    assert not planner.is_clear(free | {"controller": {"task": "position"}}, away, True)
    assert planner.is_clear(free, away, False)


@pytest.mark.parametrize("seed", range(2))
def test_an_escape_stays_one_when_an_obstacle_is_taken_away(seed: int) -> None:
    scene = scenes.in_space("crowd", "iiwa14", "position", seed).to_dict()
    verdict, motion = planner.escape(vff.Scenario.from_dict(scene))
    assert motion is not None
    for k in range(len(scene["obstacles"])):
        fewer = scene | {"obstacles": scene["obstacles"][:k] + scene["obstacles"][k + 1 :]}
        assert planner.is_clear(fewer, motion, verdict == "with tip")
    assert vff.feasibility(vff.Scenario.from_dict(scene | {"obstacles": []})) == "with tip"


def test_joint_limits_decide() -> None:
    """A sweep that the elbow of a Panda swings away from cannot be survived with joints that hardly move."""
    assert vff.feasibility("panda-sweep") == "with tip"
    q0 = np.array(vff.Scenario.load("panda-sweep")["q0"])
    tight = np.stack([q0 - 0.02, q0 + 0.02], axis=1).tolist()
    assert (
        vff.feasibility(vff.Scenario.load("panda-sweep").replace(**{"arm.joint_limits": tight}))
        == "none found"
    )


@pytest.mark.parametrize("arm", scenes.ARMS)
def test_distances_of_the_two_implementations_agree(arm: str) -> None:
    """Spheres, capsules and boxes, at rest and turning, about random postures: NumPy against the core."""
    random = np.random.default_rng(7)
    model = vff.Arm.named(arm)
    bodies = space.Bodies(model.to_dict())
    moving = bodies.link >= 0

    def turn() -> list[float]:
        q = random.normal(size=4)
        return (q / np.linalg.norm(q)).tolist()

    shapes: list[dict[str, Any]] = [
        {"kind": "sphere", "radius": 0.1},
        {"kind": "capsule", "a": [0.0, 0.0, -0.1], "b": [0.1, 0.0, 0.1], "radius": 0.05},
        {"kind": "box", "size": [0.1, 0.2, 0.3]},
    ]
    obstacles = [
        {
            "shape": shape,
            "position": random.uniform(-0.8, 0.8, 3).tolist(),
            "orientation": turn(),
            "motion": {"kind": "linear", "velocity": random.uniform(-0.3, 0.3, 3).tolist()},
        }
        for shape in shapes * 4
    ]
    for still in obstacles[:3]:
        obstacles.append(still | {"angular_velocity": random.uniform(-3.0, 3.0, 3).tolist()})
        poses = [still["orientation"], *(turn() for _ in range(3))]
        points = [still["position"], *random.uniform(-0.8, 0.8, (3, 3)).tolist()]
        motion = {"kind": "waypoints", "times": [0.2, 0.7, 1.1, 1.6], "points": points, "orientations": poses}
        obstacles.append(still | {"motion": motion})
        near = np.array(poses[0]) + np.vstack([np.zeros(4), random.uniform(-0.3, 0.3, (3, 4))])
        near /= np.linalg.norm(near, axis=1, keepdims=True)
        smooth = motion | {"interpolation": "smooth", "orientations": [poses[0], *near[1:].tolist()]}
        obstacles.append(still | {"motion": smooth})
    q = random.uniform(-1.5, 1.5, (50, model.n))
    times = random.uniform(0.0, 2.0, 50)
    found = space.Obstacles(obstacles).distances(bodies.ends(q)[:, moving], bodies.radius[moving], times)
    core = vff.distances(model, q, np.zeros_like(q), obstacles, times)
    expected = core.distance.reshape(50, moving.sum(), len(obstacles))
    apart = expected > 1e-3  # what overlaps is measured differently, and never asked for
    assert apart.mean() > 0.8
    np.testing.assert_allclose(found[apart], expected[apart], atol=1e-7)
    assert (found[expected < -1e-3] < 1e-6).all()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (("crowds", "panda", "pose", 0), InputError, "family: expected one of links-swept"),
        (
            ("crowd", "puma", "pose", 0),
            InputError,
            "arm: expected one of panda, iiwa14, ur5e, xarm7, gen3, not 'puma'",
        ),
        (("crowd", "panda", "poses", 0), InputError, "task: expected one of position, pointing, pose"),
        (("crowd", ["panda"], "pose", 0), InputError, "arm: expected one of"),
        (("crowd", "panda", "pose", -1), InputError, "seed: must be from 0 to 1999999, got -1"),
        (("crowd", "panda", "pose", 1.0), InputTypeError, "seed: expected a whole number, not a float"),
    ],
)
def test_wrong_arguments_are_named(arguments: tuple, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        scenes.in_space(*arguments)
