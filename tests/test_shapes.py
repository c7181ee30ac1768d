"""Convex hulls and obstacles that turn: what they are, how far, how they are drawn and exported."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from itertools import product
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from differences import smooth_pairs
from vffnull import _core
from vffnull.draw import geometry
from vffnull.draw.figures.rays import Solid
from vffnull.draw.figures.render import trace
from vffnull.draw.primitives import Body
from vffnull.draw.report import motion as page
from vffnull.draw.scene import Scene
from vffnull.engines.export import to_mjcf
from vffnull.errors import InputError, ScenarioError
from vffnull.evaluation.geometry.arm import rotation
from vffnull.model.shape import core_in_space

Array = NDArray[np.float64]

PANDA = vff.Arm.named("panda")
READY = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
CUBE = np.array(list(product((-0.5, 0.5), repeat=3)))
TETRAHEDRON = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.5]])
HALF = np.sqrt(0.5)


def test_a_box_is_the_convex_hull_of_its_corners() -> None:
    """The order of the points, and those that lie within, do not matter."""
    rng = np.random.default_rng(1)
    center, size = np.array([0.5, 0.2, 0.4]), np.array([0.3, 0.2, 0.5])
    within = rng.uniform(-0.5, 0.5, (20, 3))
    points = center + rng.permutation(np.vstack([CUBE, within])) * size
    hull, box = vff.Obstacle.convex(points), vff.Obstacle.box(center, size)
    assert hull.kind == "convex" and len(hull.shape["vertices"]) == 8
    np.testing.assert_allclose(hull.position, center, atol=1e-15)
    q = READY + rng.uniform(-1.0, 1.0, (50, 7))
    dq = rng.uniform(-1.0, 1.0, (50, 7))
    ours, theirs = (vff.distances(PANDA, q, dq, [each]) for each in (hull, box))
    np.testing.assert_allclose(ours.distance, theirs.distance, atol=1e-12)
    np.testing.assert_allclose(ours.rate, theirs.rate, atol=1e-9)


def test_in_the_plane_a_convex_hull_is_a_polygon() -> None:
    points = [[2.0, 1.0], [1.0, 1.0], [1.5, 1.2], [2.0, 2.0], [1.0, 2.0], [1.5, 1.0]]
    hull = vff.Obstacle.convex(points, vff.Motion.linear([0.1, 0.0]), angular_velocity=0.5)
    assert hull.kind == "polygon" and hull.position == (1.5, 1.5) and len(hull.shape["vertices"]) == 4
    assert hull.angular_velocity == 0.5 and hull.motion == vff.Motion.linear([0.1, 0.0])


@pytest.mark.parametrize(
    ("vertices", "fault"),
    [
        (TETRAHEDRON[:3], "4 or more different points, not 3"),
        (CUBE * [1.0, 1.0, 0.0], "do not lie in one plane"),
        (CUBE[:1].repeat(9, axis=0), "not 1"),
        (np.random.default_rng(2).normal(size=(500, 3)) * 0 + 1, "not 1"),
        ([[0.0, 0.0, np.nan]] * 5, "vertices"),
        ([[0.0, 0.0, 0.0, 0.0]] * 5, "vertices"),
        ("points", "vertices"),
    ],
)
def test_points_without_a_hull(vertices: Any, fault: str) -> None:
    with pytest.raises(ScenarioError, match=fault):
        vff.Obstacle.convex(vertices)


def test_a_hull_with_many_corners_is_refused() -> None:
    ball = np.random.default_rng(3).normal(size=(100, 3))
    with pytest.raises(ScenarioError, match="at most 64 corners, not 100"):
        vff.Obstacle.convex(ball / np.linalg.norm(ball, axis=1, keepdims=True))


def test_faces_of_a_hull() -> None:
    faces = _core.hull(CUBE)
    assert sorted(len(ring) for ring in faces) == [4] * 6
    for ring in faces:
        a, b, c = CUBE[ring[:3]]
        normal = np.cross(b - a, c - b)
        assert ((CUBE - a) @ normal <= 1e-12).all()
    with pytest.raises(InputError, match="one plane"):
        _core.hull(CUBE * [1.0, 1.0, 0.0])
    with pytest.raises(InputError, match=r"\(k, 3\)"):
        _core.hull([[1.0, 2.0]])


# --------------------------------------------------------------------------------------------------- turning

PLANAR = vff.Arm([0.9, 0.7, 0.8], 1.0, radius=0.03)
TURNING = {
    2: [
        vff.Obstacle.box([1.0, 1.2], [0.9, 0.2], 0.4, angular_velocity=1.3),
        vff.Obstacle.capsule(
            [2.6, 0.2], [3.0, 1.1], 0.15, vff.Motion.linear([-0.5, 0.3]), angular_velocity=-2.0
        ),
        vff.Obstacle.polygon(
            [[1.5, -1.0], [2.5, -0.75], [2.0, -0.5]],
            vff.Motion.waypoints([0.0, 2.0], [[2.0, -0.75], [2.2, -0.2]], angles=[0.0, 3.0]),
        ),
        vff.Obstacle.circle([0.0, 2.0], 0.3, angular_velocity=4.0),
    ],
    3: [
        vff.Obstacle.box([0.6, 0.3, 0.4], [0.1, 0.3, 0.5], angular_velocity=[0.5, -1.0, 2.0]),
        vff.Obstacle.convex(
            np.add(TETRAHEDRON, [0.4, -0.6, 0.2]),
            vff.Motion.sinusoid([0.0, 0.2, 0.1], 1.4),
            angular_velocity=[1.0, 1.0, 0.0],
        ),
        vff.Obstacle.capsule(
            [0.2, 0.5, 0.9], [0.2, 0.75, 0.9], 0.05,
            vff.Motion.waypoints(
                [0.0, 2.0],
                [[0.2, 0.625, 0.9], [0.2, 0.5, 1.0]],
                orientations=[[1.0, 0.0, 0.0, 0.0], [HALF, 0.0, 0.0, HALF]],
            ),
        ),
        vff.Obstacle.half_space([0.0, 0.0, -0.5], [0.0, 0.0, 1.0], angular_velocity=[0.2, 0.1, 0.0]),
    ],
}  # fmt: skip


@pytest.mark.parametrize("dimension", [2, 3])
def test_derivatives_beside_what_turns(dimension: int) -> None:
    arm, obstacles = (PLANAR if dimension == 2 else PANDA), TURNING[dimension]
    rng = np.random.default_rng(5)
    smooth = np.zeros(len(obstacles), dtype=int)
    for _ in range(200):
        q, dq, ddq = (rng.uniform(-2.0, 2.0, arm.n) for _ in range(3))
        smooth += smooth_pairs(arm, obstacles, q, dq, ddq, float(rng.uniform(0.1, 1.9)))
    assert np.all(smooth > 300)


def test_a_plate_that_turns_comes_near() -> None:
    """In closed form: a thin plate turns towards a single link."""
    arm = vff.Arm([1.0], 1.0, radius=0.0)
    plate = vff.Obstacle.box([0.0, -1.0], [2.0, 1e-3], angular_velocity=1.0)
    for t in (0.0, 0.3, 1.0):
        found = vff.distances(arm, [0.0], [0.0], [plate], t)
        # Its upper right corner comes nearest to the link, which lies along the x axis.
        far = 1.0 - np.sin(t) - 5e-4 * np.cos(t)
        assert abs(found.distance[0] - far) < 1e-12, t


def test_rotations_over_time() -> None:
    times = np.array([-1.0, 0.0, 0.5, 2.0])
    turned = _core.rotations(TURNING[2][0].to_dict(), 2, times)
    assert turned is not None
    c, s = np.cos(1.3 * times), np.sin(1.3 * times)
    np.testing.assert_allclose(
        turned, np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], -2), atol=1e-14
    )
    turned = _core.rotations(TURNING[3][2].to_dict(), 3, times)
    assert turned is not None
    angle = np.array([0.0, 0.0, np.pi / 8, np.pi / 2])  # waits before and after
    z = np.zeros(4)
    np.testing.assert_allclose(
        turned, rotation(np.stack([np.cos(angle / 2), z, z, np.sin(angle / 2)], -1)), atol=1e-14
    )
    assert _core.rotations(vff.Obstacle.circle([1.0, 1.0], 0.1).to_dict(), 2, times) is None


def waypoints(**more: Any) -> vff.Motion:
    size = 3 if "orientations" in more else 2
    return vff.Motion.waypoints([0.0, 1.0], [[1.0] * size, [2.0] * size], **more)


QUATERNIONS = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: vff.Obstacle.box([1, 1], [1, 1], angular_velocity=[0.0, 0.0, 1.0]), "angular_velocity"),
        (lambda: vff.Obstacle.box([1, 1, 1], [1, 1, 1], angular_velocity=1.0), "angular_velocity"),
        (lambda: vff.Obstacle.box([1, 1, 1], [1, 1, 1], angular_velocity=[0, 0, np.inf]), "angular_velocity"),
        (lambda: waypoints(angles=[0.0]), "angles"),
        (lambda: waypoints(orientations=QUATERNIONS[:1]), "orientations"),
        (lambda: waypoints(orientations=[[1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0]]), r"orientations\[1\]"),
        (lambda: vff.Motion.waypoints([0, 1], [[1, 1], [2, 2]], orientations=QUATERNIONS), "angles"),
        (lambda: vff.Motion.waypoints([0, 1], [[1, 1, 1], [2, 2, 2]], angles=[0.0, 1.0]), "orientations"),
        (lambda: vff.Obstacle.box([1, 1], [1, 1], 0.5, waypoints(angles=[0.0, 1.0])), r"angles\[0\]"),
        (
            lambda: vff.Obstacle.box(
                [1, 1, 1], [1, 1, 1], orientation=QUATERNIONS[1], motion=waypoints(orientations=QUATERNIONS)
            ),
            r"orientations\[0\]",
        ),
        (
            lambda: vff.Obstacle.box([1, 1], [1, 1], 0.0, waypoints(angles=[0.0, 1.0]), angular_velocity=1.0),
            "absent",
        ),
    ],
)
def test_turning_that_makes_no_sense(make: Any, fault: str) -> None:
    with pytest.raises(ScenarioError, match=fault):
        make()


# ------------------------------------------------------------------------------------------ runs and pictures


@pytest.fixture(scope="module")
def result() -> vff.Result:
    """A Panda among a hull and a plate that turn; `cbf` keeps its distance from both."""
    hull = vff.Obstacle.convex(
        np.add(TETRAHEDRON, [0.5, -0.5, 0.3]),
        vff.Motion.linear([0.0, 0.1, 0.0]),
        angular_velocity=[0.0, 0.0, 1.0],
    )
    plate = vff.Obstacle.box([0.3, 0.55, 0.5], [0.5, 0.05, 0.4], angular_velocity=[0.0, 0.0, -0.5])
    scenario = vff.Scenario.load("panda-sweep").replace(
        obstacles=[hull, plate, vff.Obstacle.convex(0.2 * CUBE + [0.0, -0.8, 0.2])], duration=0.6
    )
    return vff.simulate(scenario, {"controller.avoidance": "cbf", "simulation.record_every": 20})


def test_a_run_among_what_turns(result: vff.Result) -> None:
    assert result.status == "completed" and result.metrics.min_clearance > 0.0
    assert result.obstacles.shape == (len(result.t), 3, 3)
    np.testing.assert_allclose(result.obstacles[:, 1], [[0.3, 0.55, 0.5]] * len(result.t), atol=1e-15)
    # The record of the clearance is that of the distances.
    document = result.scenario.to_dict()
    for row in (0, len(result.t) - 1):
        found = vff.distances(
            PANDA, result.q[row], result.dq[row], document["obstacles"], float(result.t[row])
        )
        assert abs(found.distance.min() - result.clearance[row].min()) < 1e-12


def test_documents_hold_everything(result: vff.Result, tmp_path: Any) -> None:
    result.scenario.save(tmp_path / "turning.toml")
    again = vff.Scenario.load(tmp_path / "turning.toml")
    assert again.to_dict()["obstacles"] == result.scenario.to_dict()["obstacles"]
    assert hash(TURNING[3][0]) != hash(TURNING[3][1]) and "angular_velocity" in repr(TURNING[3][0])


def test_bodies_are_drawn_as_they_are_turned(result: vff.Result) -> None:
    """The nearest point of the arm to a drawn body is as far as the record says; others stay as they are."""
    scene = Scene.of_result(result)
    obstacles = result.scenario.to_dict()["obstacles"]
    for row in (0, len(result.t) // 2, len(result.t) - 1):
        bodies = [each for each in scene.at(row, ["obstacle"]) if isinstance(each, Body)]
        turned = _core.rotations(obstacles[1], 3, [result.t[row]])
        assert turned is not None
        size = np.array([0.5, 0.05, 0.4])
        expected = (CUBE * size) @ turned[0].T + result.obstacles[row, 1]
        found = bodies[1].corners
        assert np.abs(found[:, None] - expected[None]).sum(-1).min(axis=1).max() < 1e-12
        distances = vff.distances(PANDA, result.q[row], result.dq[row], obstacles, float(result.t[row]))
        for index, body in enumerate(bodies):  # as if it rested where it is drawn
            drawn = {"kind": "convex", "vertices": body.corners.tolist()}
            if len(body.corners) <= 2:
                a, b = body.corners[0].tolist(), body.corners[-1].tolist()
                drawn = {"kind": "capsule", "a": a, "b": b, "radius": body.radius}
            still = vff.distances(PANDA, result.q[row], result.dq[row], [{"shape": drawn}]).distance
            assert np.abs(still - distances.distance[distances.obstacle == index]).max() < 1e-9
    assert scene.is_moving(0) and scene.is_moving(1) and not scene.is_moving(2)
    some = scene.pick(np.array([1, 3]))
    np.testing.assert_array_equal(some.solid(1), scene.solid(1)[[1, 3]])


def test_a_hull_looks_like_its_box() -> None:
    """Ray by ray, from the side on which the picture is taken."""
    grey = np.full(3, 0.5)
    axes = rotation([0.8, 0.36, 0.48, 0.0])
    corners = CUBE * [1.0, 2.0, 0.5]
    odd = np.vstack([corners[::-1], np.zeros((1, 3))])  # no block, but the same hull
    xs, ys = np.linspace(-2.0, 2.0, 90), np.linspace(-2.0, 2.0, 80)
    drawn = [trace([Solid(each, 0.0, grey)], axes, xs, ys) for each in (corners, odd)]
    assert np.isfinite(drawn[0][1]).sum() > 500
    apart = np.isfinite(drawn[0][1]) != np.isfinite(drawn[1][1])
    assert apart.sum() <= 2  # on an edge
    both = np.isfinite(drawn[0][1]) & ~apart
    np.testing.assert_allclose(drawn[0][1][both], drawn[1][1][both], atol=1e-12)
    np.testing.assert_allclose(drawn[0][0][both], drawn[1][0][both], atol=1e-6)


def test_a_tetrahedron_is_no_surface() -> None:
    corners, radius = core_in_space({"kind": "convex", "vertices": TETRAHEDRON})
    assert len(corners) == 4 and radius == 0.0
    assert not geometry.is_surface(corners) and not geometry.is_block(corners)
    floor, _ = core_in_space({"kind": "half_space", "normal": [0.0, 0.0, 1.0]})
    assert geometry.is_surface(floor)


def test_pictures_and_pages(result: vff.Result, tmp_path: Any) -> None:
    assert result.plot(tmp_path)
    result.animate(tmp_path / "run.gif")
    assert (tmp_path / "run.gif").stat().st_size > 1000


def test_a_page_moves_outlines_that_turn() -> None:
    """Of an obstacle that turns, an outline at every instant; of others one."""
    pytest.importorskip("bokeh")
    from vffnull.draw.report.figures import Run

    scenario = vff.Scenario.load("sweep-through").replace(
        obstacles=[
            vff.Obstacle.box([5.0, -3.0], [0.9, 0.2], angular_velocity=1.3),
            vff.Obstacle.circle([5.0, 5.0], 0.2),
        ],
        duration=0.2,
    )
    run = Run.of(vff.simulate(scenario))
    packed = page.pack(run, ["#000000"] * 6)
    turning, still = packed["outlines"]
    assert len(turning) == len(packed["halos"][0]) == len(run.rows) and isinstance(still, str)
    assert len(set(turning)) == len(turning)


def test_hulls_and_turning_obstacles_in_mujoco() -> None:
    """A hull is a mesh of its corners; what turns is turned at every step."""
    mujoco = pytest.importorskip("mujoco")
    hull, plate = TURNING[3][1], TURNING[3][0]
    root = ET.fromstring(to_mjcf(PANDA, obstacles=[hull, plate]))
    mesh = root.find("asset/mesh[@name='obstacle_1']")
    assert mesh is not None
    np.testing.assert_allclose(
        np.fromstring(mesh.attrib["vertex"], sep=" ").reshape(-1, 3), hull.shape["vertices"], atol=1e-15
    )
    model = mujoco.MjModel.from_xml_string(to_mjcf(PANDA, obstacles=[hull, plate]))
    data = mujoco.MjData(model)
    data.qpos[:] = READY
    mujoco.mj_forward(model, data)
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, "obstacle_1")
    ends = np.zeros(6)
    bodies = model.geom_bodyid
    links = [k for k in range(model.ngeom) if bodies[k] > 1 and model.body_mocapid[bodies[k]] < 0]
    found = min(mujoco.mj_geomDistance(model, data, link, geom, 5.0, ends) for link in links)
    ours = vff.distances(PANDA, READY, np.zeros(7), [hull]).distance.min()
    assert abs(found - ours) < 1e-6

    from vffnull.engines.mujoco_plant import MuJoCoPlant

    scenario = vff.Scenario.load("panda-sweep").replace(obstacles=[hull, plate], duration=0.1)
    plant = MuJoCoPlant(scenario)
    plant.step(0.05, np.zeros(7))
    for k, obstacle in enumerate((hull, plate)):
        turned = _core.rotations(obstacle.to_dict(), 3, [0.05])
        assert turned is not None
        np.testing.assert_allclose(rotation(plant.data.mocap_quat[k]), turned[0], atol=1e-14)
