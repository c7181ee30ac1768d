"""People as obstacles: capsules between joints that move smoothly (T177, T178)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import BPoly
from scipy.spatial.transform import Rotation

import vffnull as vff
from vffnull.errors import InputError, ScenarioWarning

ARM = vff.Arm.named("panda")


BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 1.0 2.0 3.0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT RightArm
  {
    OFFSET -18.0 45.0 1.5
    CHANNELS 3 Zrotation Yrotation Xrotation
    JOINT RightForeArm
    {
      OFFSET -29.0 0.5 0.0
      CHANNELS 3 Xrotation Yrotation Zrotation
      End Site
      {
        OFFSET -25.0 0.0 2.0
      }
    }
  }
  JOINT RightUpLeg
  {
    OFFSET -9.5 -4.0 0.0
    CHANNELS 3 Yrotation Zrotation Xrotation
    End Site
    {
      OFFSET 0.0 -42.0 3.0
    }
  }
}
MOTION
Frames: 4
Frame Time: 0.5
0.0 90.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0
1.0 91.0 2.0 10.0 5.0 -20.0 30.0 -15.0 40.0 20.0 60.0 -10.0 12.0 -35.0 7.0
2.5 90.5 4.0 -15.0 25.0 80.0 -70.0 45.0 5.0 -30.0 95.0 20.0 -50.0 15.0 33.0
4.0 89.0 6.5 170.0 -60.0 130.0 120.0 -80.0 -45.0 10.0 -140.0 75.0 88.0 -12.0 -66.0
"""
PLACES = [
    [
        [0.0, 90.0, 0.0], [-18.0, 135.0, 1.5], [-47.0, 135.5, 1.5], [-72.0, 135.5, 3.5], [-9.5, 86.0, 0.0],
        [-9.5, 44.0, 3.0],
    ],
    [
        [1.0, 91.0, 2.0], [-24.01901, 132.52889, 1.19325], [-42.14561, 116.79893, -15.09309],
        [-45.48513, 93.1942, -7.30438], [-7.14868, 85.80447, -1.58545], [-24.50191, 48.38361, -10.04384],
    ],
    [
        [2.5, 90.5, 4.0], [9.4959, 122.97821, 39.31959], [31.39473, 130.94714, 56.58769],
        [43.13062, 113.28966, 43.19058], [-1.05506, 83.60611, 10.78865], [-8.80854, 62.07993, -24.55973],
    ],
    [
        [4.0, 89.0, 6.5], [-14.36171, 58.11279, -26.05883], [6.35581, 41.80508, -13.97193],
        [20.64027, 56.3581, -28.57207], [-2.76082, 85.82331, 13.60281], [25.11389, 117.0792, 9.23593],
    ],
]  # fmt: skip
"""What pybvh 0.9 makes of that file, and bvhio 1.5.4 to 10⁻⁵."""


def clearance(obstacles: list[vff.Obstacle], t: float) -> Any:
    """How far every link of the arm is from every obstacle at a time."""
    q = [0.0, -0.8, 0.0, -2.4, 0.0, 1.6, 0.8]
    return vff.distances(ARM, [q], [[0.0] * 7], obstacles, [t])


def spline(knots: np.ndarray, points: np.ndarray) -> BPoly:
    """The C² path of quintics (T177) by SciPy, whose Bernstein polynomials share nothing with the core's."""
    first, second = np.zeros_like(points), np.zeros_like(points)
    first[1:-1] = np.gradient(points, knots, axis=0)[1:-1]
    slopes = np.diff(points, axis=0) / np.diff(knots)[:, None]
    second[1:-1] = 2.0 * np.diff(slopes, axis=0) / (knots[2:] - knots[:-2])[:, None]
    return BPoly.from_derivatives(knots, np.stack([points, first, second], axis=1))


def test_a_smooth_obstacle_follows_scipy() -> None:
    """Where it is, how it is turned, and how fast the distance to it changes."""
    random = np.random.default_rng(3)
    knots = np.array([0.0, 0.4, 0.7, 1.5, 2.0])
    points = random.uniform(0.3, 1.0, (5, 3))
    turns = Rotation.from_rotvec(np.cumsum(random.uniform(-0.4, 0.4, (5, 3)), axis=0))
    quaternions = turns.as_quat(canonical=True, scalar_first=True)
    motion = vff.Motion.waypoints(knots, points, interpolation="smooth", orientations=quaternions)
    shape = {"kind": "capsule", "a": [0.0, -0.1, 0.0], "b": [0.1, 0.2, 0.0], "radius": 0.03}
    moving = {
        "shape": shape,
        "position": points[0],
        "orientation": quaternions[0],
        "motion": motion.to_dict(),
    }
    place, turn = spline(knots, points), spline(knots, quaternions)
    dense = np.linspace(0.0, 2.0, 2001)
    speeds, accelerations = (np.linalg.norm(place(dense, order), axis=1).max() for order in (1, 2))
    assert speeds <= motion.top_speed < 1.05 * speeds
    assert accelerations <= motion.top_acceleration < 1.1 * accelerations
    for t in random.uniform(0.0, 2.0, 20):
        q = turn(t) / np.linalg.norm(turn(t))
        still = {"shape": shape, "position": place(t).tolist(), "orientation": q.tolist()}
        found, expected = clearance([moving], t), clearance([still], 0.0)
        np.testing.assert_allclose(found.distance, expected.distance, atol=1e-12)
        before, after = (clearance([moving], t + step).distance for step in (-1e-6, 1e-6))
        np.testing.assert_allclose(found.rate, (after - before) / 2e-6, atol=1e-5)


def test_a_body_is_where_its_joints_are() -> None:
    """At every instant each capsule reaches from joint to joint; between them neighbours hardly part."""
    body = vff.Body.walking(speed=1.3, duration=3.0, seed=5)
    made = body.obstacles()
    assert len(made) == len(body.bones) == 18
    for (first, second, radius), obstacle in zip(body.bones, made, strict=True):
        a, b = body.joints[:, first], body.joints[:, second]
        motion = dict(obstacle.motion.parameters) if obstacle.motion else {}
        middle = np.array(motion["points"])
        assert dict(obstacle.dimensions)["radius"] == radius
        if obstacle.kind == "sphere":
            np.testing.assert_array_equal(middle, a)
            continue
        turned = Rotation.from_quat(np.array(motion["orientations"]), scalar_first=True)
        for end, joint in (("a", a), ("b", b)):
            reached = middle + turned.apply(dict(obstacle.dimensions)[end])
            np.testing.assert_allclose(reached, joint, atol=1e-9)
        # Between instants, the middle is that of the joints' own path, and the axis all but that.
        dense = np.linspace(0.0, 3.0, 500)
        along = spline(body.times, b)(dense) - spline(body.times, a)(dense)
        axis = spline(body.times, turned.as_quat(scalar_first=True) * signs(turned))(dense)
        found = Rotation.from_quat(axis, scalar_first=True).apply(b[0] - a[0])
        assert np.linalg.norm(found - along, axis=1).max() < 2e-4


def signs(turned: Rotation) -> np.ndarray:
    """That which make quaternions neighbours of each other."""
    q = turned.as_quat(scalar_first=True)
    return np.cumprod(np.concatenate([[1.0], np.where((q[1:] * q[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)]))[
        :, None
    ]


@pytest.mark.parametrize("seed", range(4))
def test_people_move_as_people_do(seed: int) -> None:
    """Bones keep their lengths, hands and feet their speeds, and nothing needs what limbs do not have."""
    shoulder, target = np.array([0.2, -0.1, 1.0]), np.array([0.6, 0.1, 0.8])
    bodies = [
        vff.Body.reaching(shoulder, target, speed=1.5, begin=0.3, seed=seed),
        vff.Body.swinging(shoulder, direction=1.0, seed=seed),
        vff.Body.walking(direction=0.5, speed=1.6, seed=seed),
    ]
    for body in bodies:  # without a warning, so below 50 m/s²
        for first, second, _ in body.bones:
            length = np.linalg.norm(body.joints[:, second] - body.joints[:, first], axis=1)
            np.testing.assert_allclose(length, length[0], rtol=1e-9, atol=1e-12)
    hand = spline(bodies[0].times, bodies[0].joints[:, 3])
    dense = np.linspace(0.0, bodies[0].times[-1], 3000)
    assert np.linalg.norm(hand(dense) - target, axis=1).min() < 1e-9
    assert 1.2 < np.linalg.norm(hand(dense, 1), axis=1).max() < 1.55
    walker = bodies[2]
    assert (
        5.5 < np.linalg.norm(walker.joints[-1, 0] - walker.joints[0, 0]) < 7.0
    )  # 5 s at 1.6 m/s but for the ends
    feet = walker.joints[:, [walker.names.index(f"{side} toes") for side in ("left", "right")], 2]
    assert feet.min() > -0.1
    assert repr(vff.Body.walking(seed=seed)) == repr(vff.Body.walking(seed=seed))
    assert not np.array_equal(vff.Body.walking(seed=seed).joints, vff.Body.walking(seed=seed + 9).joints)


def test_bvh_files_become_bodies(tmp_path: Path) -> None:
    path = tmp_path / "arm.bvh"
    path.write_text(BVH)
    body = vff.Body.from_bvh(path, ease=0.0)
    np.testing.assert_allclose(body.joints, 0.01 * np.array(PLACES)[..., [2, 0, 1]], atol=1e-7)
    assert body.names == (
        "Hips",
        "RightArm",
        "RightForeArm",
        "RightForeArm end",
        "RightUpLeg",
        "RightUpLeg end",
    )
    assert [bone[:2] for bone in body.bones] == [(0, 1), (1, 2), (2, 3), (0, 4), (4, 5)]
    part = vff.Body.from_bvh(
        path, {"RightArm": 0.05, "RightForeArm": 0.04}, rate=1.0, up="z", span=(0.0, 1.0)
    )
    assert [bone for bone in part.bones] == [(1, 2, 0.05), (2, 3, 0.04)]
    assert len(part.times) == 2
    assert part.placed([0.0, 0.0, 1.0], turn=np.pi).joints[0, 0] == pytest.approx([0.0, -0.9, 1.0])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("HIERARCHY", "MESH", "line 1: expected HIERARCHY"),
        ("Zrotation Xrotation Yrotation", "Zrotation Xrotation Wrotation", "line 5: unknown or repeated"),
        ("CHANNELS 6", "CHANNELS 5", "line 5: 'CHANNELS 5 Xposition"),
        ("OFFSET 1.0 2.0 3.0", "OFFSET 1.0 nan 3.0", "line 4: expected finite numbers"),
        ("Frames: 4", "Frames: 5", "5 frames are promised, 4 are there"),
        ("Frame Time: 0.5", "Frame Time: 0", "line 32: frames must be apart"),
        ("88.0 -12.0 -66.0", "88.0 -12.0", "line 36: expected 15 numbers, one per channel, got 14"),
        ("MOTION\n", "}\nMOTION\n", "line 30: '}' was not expected"),
    ],
)  # fmt: skip
def test_bad_bvh_files_are_told(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "bad.bvh"
    path.write_text(BVH.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        vff.Body.from_bvh(path)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: vff.Body([0.0, 1.0], np.zeros((3, 2, 3)), [(0, 1)], 0.1), "joints"),
        (lambda: vff.Body([0.0, 1.0], np.zeros((2, 2, 3)), [(0, 2)], 0.1), r"bones\[0\]: \(0, 2\)"),
        (lambda: vff.Body([0.0, 1.0], np.zeros((2, 2, 3)), [(0, 0)], 0.0), r"radii\[0\]"),
        (lambda: vff.Body([0.0, 1.0], np.zeros((2, 2, 3)), [0.5], 0.1), "bones: expected pairs"),
        (lambda: vff.Body(np.arange(60e3), np.zeros((60000, 1, 3)), [(0, 0)], 0.1), "50000 way points"),
        (lambda: vff.Body.reaching([0, 0, 0], [2, 0, 0]), "target: 2 m from the shoulder"),
        (lambda: vff.Body.walking(duration=1e9), "duration"),
        (lambda: vff.Body.walking(seed=-1), "seed"),
    ],
)  # fmt: skip
def test_bad_bodies_are_told(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_what_bones_cannot_do_is_told() -> None:
    """Half a turn at once, times that are no seconds, and bones that stretch."""
    joints = np.zeros((2, 2, 3))
    joints[:, 1, 0] = [0.3, -0.3]
    with pytest.raises(InputError, match=r"from joints\[0\] to joints\[1\] turns by 180° from times\[0\]"):
        vff.Body([0.0, 1.0], joints, [(0, 1)], 0.05).obstacles()
    joints[1, 1] = [0.0, 0.3, 0.0]
    with pytest.warns(ScenarioWarning, match=r"joints\[1\] needs up to 2\.5\de\+04 m/s², more than 50"):
        vff.Body([0.0, 0.01], joints, [(0, 1)], 0.05)
    joints[1, 1] = [0.2, 0.0, 0.0]
    with pytest.warns(ScenarioWarning, match=r"from joints\[0\] to joints\[1\] is from 0.2 to 0.3 m long"):
        vff.Body([0.0, 1.0], joints, [(0, 1)], 0.05)


def test_ease_begins_and_ends_gently() -> None:
    """What moves at its first instant is at the same places, later, and needs far less acceleration."""
    times = np.linspace(0.0, 2.0, 61)
    joints = np.stack([np.stack([1.3 * times, 0.0 * times, 0.0 * times], axis=1)] * 1, axis=1)
    with pytest.warns(ScenarioWarning, match="wants `ease`"):
        vff.Body(times, joints, [(0, 0)], 0.1)
    body = vff.Body(times, joints, [(0, 0)], 0.1, ease=0.5)
    assert body.times[-1] == pytest.approx(2.5)
    assert np.ptp(body.times[20:40] - times[20:40]) < 1e-12
    (ball,) = body.obstacles()
    assert ball.motion is not None
    assert ball.motion.top_speed < 1.45
    assert ball.motion.top_acceleration < 8.0


def test_a_person_is_avoided_and_written_down(tmp_path: Path) -> None:
    """A hand comes to where the arm holds a thing: without avoidance they collide. TOML holds the person."""
    person = vff.Body.reaching([0.75, 0.45, 0.8], [0.33, 0.05, 0.62], speed=0.8, seed=1)
    scene = vff.Scenario.load("panda-sweep").replace(duration=2.2, obstacles=person.obstacles())
    scene.save(tmp_path / "person.toml")
    again = vff.Scenario.load(tmp_path / "person.toml")
    assert again["obstacles"][0]["motion"]["interpolation"] == "smooth"
    assert vff.simulate(again, {"controller.field.gain": 0.0}).status.value == "collided"
    result = vff.simulate(again, {"controller.avoidance": "cbf"})
    assert result.status.value == "completed"
    assert result.metrics.min_clearance > 0.018
