"""Boxes and convex hulls on the links of an arm: distances, the law, files of models, and pictures."""
# ruff: noqa: E501 — a model as models are written

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import matrix
import vffnull as vff
from differences import smooth_pairs
from spatial_oracle import placed, poses
from vffnull import _core, arms
from vffnull.draw.geometry import triangles
from vffnull.model.arm import arm_of

Array = NDArray[np.float64]
Document = dict[str, Any]

ACROSS = [0.5, -0.5, 0.5, 0.5]


def points(seed: int, count: int, size: float, middle: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    """Random ones, so that their hull has corners at all distances."""
    return np.array(middle) + size * np.random.default_rng(seed).normal(size=(count, 3))


def mixed() -> Document:
    """A Panda with a box, a hull or a capsule on every link, and a hull as its base."""
    arm = arms.named("panda")
    capsules = {each["link"]: each["shape"] for each in arm["collision"]}
    shapes: Document = {
        "panda_link0": {"kind": "convex", "vertices": points(0, 30, 0.05).tolist()},
        "panda_link1": boxed(capsules["panda_link1"]),
        "panda_link2": {"kind": "convex", "vertices": points(2, 12, 0.05).tolist()},
        "panda_link3": {
            "kind": "box",
            "center": [0.03, 0.0, -0.05],
            "size": [0.1, 0.12, 0.3],
            "orientation": ACROSS,
        },
        "panda_link4": capsules["panda_link4"],
        "panda_link5": {"kind": "convex", "vertices": points(5, 60, 0.06).tolist()},
        "panda_link6": {"kind": "sphere", "center": [0.05, 0.0, 0.0], "radius": 0.06},
        "panda_link7": boxed(capsules["panda_link7"]),
    }
    arm["collision"] = [{"link": link, "shape": shape} for link, shape in shapes.items()]
    arm["ignore"] = []
    return _core.check_arm(arm)


def boxed(shape: Mapping[str, Any]) -> Document:
    """The box around a capsule or a sphere, along its axis."""
    a, b = (np.array(shape.get(end, shape.get("center"))) for end in "ab")
    length = float(np.linalg.norm(b - a))
    return {
        "kind": "box",
        "center": ((a + b) / 2).tolist(),
        "size": [2 * shape["radius"], 2 * shape["radius"], length + 2 * shape["radius"]],
        "orientation": upwards(b - a),
    }


def upwards(vector: Array) -> list[float]:
    """A quaternion that takes the z axis to a direction."""
    length = float(np.linalg.norm(vector))
    x, y, z = vector / length if length else (0.0, 0.0, 1.0)
    turn = np.array([1.0 + z, -y, x, 0.0]) if z > -0.9 else np.array([x, 0.0, 1.0 - z, y])
    return [float(each) for each in turn / np.linalg.norm(turn)]


def in_boxes(share: float = 1.0) -> Document:
    """A Panda whose capsules are replaced by the boxes around them, or by some with a share of their size."""
    arm = arms.named("panda")
    for each in arm["collision"]:
        each["shape"] = boxed(each["shape"])
        each["shape"]["size"] = [share * side for side in each["shape"]["size"]]
    return arm


MIXED = mixed()
OBSTACLES = [
    vff.Obstacle.sphere([0.5, 0.3, 0.5], 0.1, vff.Motion.sinusoid([0.1, 0.0, 0.1], 2.0)),
    vff.Obstacle.capsule([-0.5, 0.4, 0.2], [-0.3, 0.6, 0.9], 0.07, vff.Motion.linear([0.1, -0.1, 0.0])),
    vff.Obstacle.box(
        [0.6, -0.6, 0.6], [0.3, 0.2, 0.4], orientation=ACROSS, angular_velocity=[0.3, 0.2, -0.5]
    ),
    vff.Obstacle.convex(points(9, 40, 0.1, [-0.5, -0.5, 0.8]), angular_velocity=[0.0, 1.0, 0.0]),
    vff.Obstacle.half_space([0.0, 0.0, -0.4], [0.28, 0.0, 0.96]),
    vff.Obstacle.points(points(8, 30, 0.2, [0.2, 0.9, 0.9]), 0.02),
]


# ---------------------------------------------------------------------------------------------- distances


class Coal:
    """Distances by Coal (github.com/coal-library/coal), whose shapes and search share nothing with ours."""

    def __init__(self) -> None:
        self.library: Any = pytest.importorskip("coal")
        self.asked = self.library.DistanceRequest()
        self.asked.gjk_tolerance = 1e-14
        self.asked.gjk_max_iterations = 2000

    def hull(self, points: Array) -> Any:
        from scipy.spatial import ConvexHull

        corners = points[ConvexHull(points).vertices]
        given = self.library.StdVec_Vec3s()
        for corner in corners:
            given.append(corner)
        faces = self.library.StdVec_Triangle()
        for face in triangles(corners):
            faces.append(self.library.Triangle(*map(int, face)))
        return self.library.Convex(given, faces)

    def body(self, shape: Document, frame: Array) -> list[tuple[Any, Any]]:
        """What a shape consists of, each with its pose; `frame` (4, 4) is where its numbers are from."""
        inner = np.eye(4)
        match shape["kind"]:
            case "sphere":
                inner[:3, 3] = shape.get("center", (0.0, 0.0, 0.0))
                made = self.library.Sphere(shape["radius"])
            case "capsule":
                a, b = np.array(shape["a"]), np.array(shape["b"])
                made = self.library.Capsule(shape["radius"], np.linalg.norm(b - a))
                inner = placed({"position": (a + b) / 2, "orientation": upwards(b - a)})
            case "box":
                inner = placed({"position": [0.0] * 3, "orientation": [1.0, 0.0, 0.0, 0.0]} | shape)
                inner[:3, 3] = shape.get("center", (0.0, 0.0, 0.0))
                made = self.library.Box(*shape["size"])
            case "convex":
                made = self.hull(np.array(shape["vertices"]))
            case "half_space":
                made = self.library.Halfspace(np.array(shape["normal"]), 0.0)
            case _:
                balls = ({"kind": "sphere", "center": p, "radius": shape["radius"]} for p in shape["points"])
                return [part for ball in balls for part in self.body(ball, frame)]
        pose = frame @ inner
        return [(made, self.library.Transform3s(pose[:3, :3], pose[:3, 3]))]

    def distance(self, one: Sequence[tuple[Any, Any]], other: Sequence[tuple[Any, Any]]) -> float:
        """The least between two bodies [m]."""
        return min(
            self.library.distance(*first, *second, self.asked, self.library.DistanceResult())
            for first in one
            for second in other
        )


def frame_of(obstacle: Document) -> Array:
    """Where an obstacle is at rest."""
    return placed({"orientation": [1.0, 0.0, 0.0, 0.0]} | obstacle)


def test_distances_from_obstacles_are_those_of_coal() -> None:
    """Every shape on a link from every shape of an obstacle, where they are apart."""
    coal = Coal()
    arm = arm_of(MIXED)
    given = [each.to_dict() for each in OBSTACLES]
    around = [coal.body(each["shape"], frame_of(each)) for each in given]
    rng = np.random.default_rng(1)
    apart = np.zeros(len(given), dtype=int)
    for _ in range(40):
        q = rng.uniform(-2.5, 2.5, arm.n)
        found = vff.distances(arm, q, 0 * q, OBSTACLES)
        shapes = zip(MIXED["collision"], poses(MIXED, q)[:-1], strict=True)
        links = [coal.body(each["shape"], frame) for each, frame in shapes]
        for link, obstacle, ours in zip(found.link, found.obstacle, found.distance, strict=True):
            if ours > 1e-3:
                theirs = coal.distance(links[link + 1], around[obstacle])
                assert abs(ours - theirs) < 1e-9, (link, given[obstacle]["shape"]["kind"], ours - theirs)
                apart[obstacle] += 1
    assert apart.min() > 200


def test_links_and_base_keep_the_distances_of_coal_from_each_other() -> None:
    """The nearest two that share no joint, and which overlap: hulls, boxes and what is round, and the base."""
    coal = Coal()
    arm = arm_of(MIXED)
    controller = vff.Controller(arm, vff.ControlSettings(stiffness=100.0, self_collision="report"))
    names = [MIXED["base"], *arm.link_names]
    rng = np.random.default_rng(2)
    met = 0
    for _ in range(40):
        q = rng.uniform(-2.5, 2.5, arm.n)
        at = dict(zip(names, poses(MIXED, q), strict=False))
        bodies = [coal.body(each["shape"], at[each["link"]]) for each in MIXED["collision"]]
        apart = {
            (names[i], names[j]): coal.distance(bodies[i], bodies[j])
            for i in range(len(bodies))
            for j in range(i + 2, len(bodies))
        }
        found = controller.terms(q, 0 * q, arm.pose(q)[0]).self_clearance
        assert abs(found - min(apart.values())) < 1e-9
        overlaps = {pair for pair, distance in apart.items() if distance < 0.0}
        assert set(_core.overlapping_links(MIXED, [q.tolist()])[0]) == overlaps
        met += bool(overlaps)
    assert 5 < met < 35


def test_derivatives_along_random_motions() -> None:
    """Rate, gradient and bias are derivatives of the distance wherever that is smooth, beside every shape."""
    arm = arm_of(MIXED)
    rng = np.random.default_rng(3)
    states, smooth = 60, np.zeros(len(OBSTACLES), dtype=int)
    for _ in range(states):
        q, dq, ddq = (rng.uniform(-2, 2, arm.n) for _ in range(3))
        smooth += smooth_pairs(arm, OBSTACLES, q, dq, ddq, float(rng.uniform(0.1, 1.9)))
    assert np.all(smooth > 0.95 * states * arm.n)


def test_points_lie_on_the_surfaces() -> None:
    """Of a box or a hull the nearest point lies on its surface, of what is round on its axis."""
    arm = arm_of(MIXED)
    q = np.array([0.3, -0.7, 0.2, -2.0, 0.1, 1.5, 0.8])
    found = vff.distances(arm, q, 0 * q, OBSTACLES)
    radius = np.array([shape.get("radius", 0.0) for _, shape in arm.collision])[found.link + 1]
    assert found.distance.min() > 0.0 and set(radius[found.link == 3]) != {0.0}
    surface = found.witness + found.distance[:, None] * found.normal
    np.testing.assert_allclose(found.point, surface + radius[:, None] * found.normal, rtol=0, atol=1e-12)


# ------------------------------------------------------------------------------------------------ the law


def test_a_panda_in_boxes_holds_its_hand_still() -> None:
    """The ball pushes boxes aside and the hand is as still as with capsules; without the field they are hit."""
    scenario = vff.Scenario.load("panda-sweep")
    boxes = {**scenario.to_dict(), "arm": in_boxes()}
    usual, found = vff.simulate(scenario), vff.simulate(boxes)
    still = np.abs(usual.error).max()
    assert still < 1e-5 and np.abs(found.error).max() < still
    assert found.metrics.min_clearance > 0.1
    assert vff.simulate(boxes, {"controller.field.gain": 0.0}).metrics.min_clearance < -0.05


def test_boxes_keep_their_margin() -> None:
    """With barriers links in boxes stay 5 mm from each other, and 2 cm from a ball that comes at the hand."""
    document = {**vff.Scenario.load("panda-sweep").to_dict(), "arm": in_boxes(0.7)}
    folds: Document = {
        "controller.avoidance": "cbf",
        "controller.task": "position",
        "controller.stiffness": 400.0,
        "controller.damping": 40.0,
        "reference": {"kind": "line", "end": [-0.1, 0.0, 0.35], "duration": 2.0},
        "duration": 2.2,
        "obstacles": [],
    }
    into = vff.simulate(document, {**folds, "controller.self_collision": "report"})
    assert into.metrics.min_self_clearance < -0.04
    apart = vff.simulate(document, {**folds, "controller.self_collision": "avoid"})
    assert apart.metrics.min_self_clearance > 0.0049 and np.abs(apart.error).max() < 0.05
    comes: Document = {
        "controller.avoidance": "cbf",
        "controller.self_collision": "avoid",
        "obstacles.0.position": [0.307, -0.5, 0.537],
        "obstacles.0.motion": {"kind": "linear", "velocity": [0.0, 0.25, 0.0]},
        "duration": 2.0,
    }
    kept = vff.simulate(document, comes)
    assert kept.metrics.min_clearance > 0.0195 and kept.metrics.min_self_clearance > 0.0049
    assert np.abs(kept.error).max() > 0.1, "the hand gives way"


def test_look_ahead_gets_out_with_boxes_as_with_capsules() -> None:
    """What is drawn decides: with either, about one draw of five misses the way out of this trap.

    The program alone is hit with both, and a wider choice of candidates or a look farther ahead finds no more.
    """
    trap = matrix.base("iiwa-crowd").replace(**matrix.WAYS["look-ahead"])
    boxes = matrix.OPTIONS["boxes on links"].changes(trap)
    for changes in ({}, boxes):
        draws = [trap.replace(**changes, seed=seed) for seed in range(16)]
        nearest = [each.metrics["min_clearance"] for each in vff.simulate_many(draws, record=False)]
        assert sum(each > 0.0 for each in nearest) > 9, nearest
        assert max(nearest) > 0.019, nearest


# ---------------------------------------------------------------------------------------- files of models


URDF = """<robot name="two"><link name="base"><collision><origin xyz="0 0 0.05" rpy="0 0 0.3"/><geometry>
  <box size="0.2 0.3 0.1"/></geometry></collision></link>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01"/></inertial>
    <collision><origin xyz="0 0 0.2" rpy="0.2 0 0"/><geometry><cylinder radius="0.05" length="0.3"/></geometry>
    </collision></link>
  <link name="lower"><inertial><origin xyz="0 0 0.2"/><mass value="1"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01"/></inertial>
    <collision><origin xyz="0.1 0 0.2"/><geometry><mesh filename="lower.ply" scale="1 1 2"/></geometry></collision>
  </link>
  <link name="hand"><inertial><origin xyz="0 0 0.02"/><mass value="1"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01"/></inertial>
    <collision><origin xyz="0 0 0.1" rpy="0 1.5708 0"/><geometry><cylinder radius="0.03" length="0.2"/></geometry>
    </collision>
    <collision><origin xyz="0.1 0 0.1"/><geometry><sphere radius="0.03"/></geometry></collision>
    <collision><origin xyz="-0.1 0 0.1"/><geometry><sphere radius="0.03"/></geometry></collision>
    <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.002" length="0.3"/></geometry></collision>
  </link>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.05"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="50" velocity="3"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="50" velocity="3"/></joint>
  <joint name="c" type="revolute"><parent link="lower"/><child link="hand"/><origin xyz="0 0 0.5"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="50" velocity="3"/></joint></robot>"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """A URDF with a box, cylinders, a capsule of three parts, and a mesh of 642 vertices with a flat side."""
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.08)
    mesh.vertices[:, 0] = np.maximum(mesh.vertices[:, 0], -0.03)
    mesh.export(tmp_path / "lower.ply")
    (tmp_path / "two.urdf").write_text(URDF)
    return tmp_path / "two.urdf"


def outside(shape: Document, places: Array) -> float:
    """How far the farthest of some places is outside of a shape [m]."""
    match shape["kind"]:
        case "capsule":
            a, b = np.array(shape["a"]), np.array(shape["b"])
            share = np.clip((places - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
            away = np.linalg.norm(places - a - share[:, None] * (b - a), axis=1) - shape["radius"]
        case "box":
            frame = placed({"position": shape["center"], "orientation": shape["orientation"]})
            inner = (places - frame[:3, 3]) @ frame[:3, :3]
            away = (np.abs(inner) - np.array(shape["size"]) / 2).max(axis=1)
        case _:
            from scipy.spatial import ConvexHull

            planes = ConvexHull(np.array(shape["vertices"])).equations
            away = (places @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return float(away.max())


def cylinder(radius: float, length: float, position: Sequence[float], rpy: Sequence[float]) -> Array:
    """Places on the rims of a cylinder."""
    from scipy.spatial.transform import Rotation

    angles = np.linspace(0.0, 2 * np.pi, 400)
    rim = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), 0 * angles])
    half = np.array([0.0, 0.0, length / 2])
    ends = np.vstack([rim - half, rim + half])
    return np.asarray(ends @ Rotation.from_euler("xyz", rpy).as_matrix().T + position)


def test_shapes_of_a_file_contain_what_is_in_it(file: Path) -> None:
    """Boxes are boxes, a cylinder is the prism around it, with balls at its ends a capsule, a mesh its hull."""
    import trimesh

    report = arms.read_urdf(file, collision="file")
    shapes = [(each["link"], each["shape"]) for each in report.document["collision"]]
    assert [link for link, _ in shapes] == ["base", "upper", "lower", "hand", "hand"]
    assert [shape["kind"] for _, shape in shapes] == ["box", "convex", "convex", "capsule", "capsule"]
    box, prism, mesh, capsule, needle = (shape for _, shape in shapes)
    np.testing.assert_array_equal(box["size"], [0.2, 0.3, 0.1])
    assert len(prism["vertices"]) == 32 and len(mesh["vertices"]) <= 64
    vertices = np.asarray(trimesh.load(file.parent / "lower.ply").vertices) * [1, 1, 2] + [0.1, 0.0, 0.2]
    assert len(vertices) > 600 and outside(mesh, vertices) <= 0.0
    assert outside(prism, cylinder(0.05, 0.3, [0, 0, 0.2], [0.2, 0, 0])) < 1e-12
    assert outside(capsule, cylinder(0.03, 0.2, [0, 0, 0.1], [0, 1.5708, 0])) < 1e-12
    assert capsule["radius"] == pytest.approx(0.03, rel=1e-4)
    assert outside(needle, cylinder(0.002, 0.3, [0, 0, 0.2], [0, 0, 0])) < 1e-12


def test_a_report_tells_how_much_larger_the_shapes_are(file: Path) -> None:
    """Beside the hulls of the file's geometry, and beside that itself with its hollows."""
    report = arms.read_urdf(file, collision="file")
    assert [len(fit.parts) for fit in report.fits] == [1, 1, 1, 3, 1]
    tightness = [fit.tightness for fit in report.fits]
    assert tightness[0] == 1.0 and tightness[1] == pytest.approx(16 / np.pi * np.tan(np.pi / 16))
    assert 1.0 < tightness[2] < 1.15 and tightness[3] == pytest.approx(1.0, abs=1e-3)
    assert 1.0 < tightness[4] < tightness[1]
    assert all(fit.own_volume and fit.own_volume <= fit.volume for fit in report.fits)
    lines = str(report).splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("shape on"))
    assert lines[head].split()[-4:] == ["volume/hull", "volume/file", "outside", "[mm]"]
    assert "hull of 32 corners" in lines[head + 2] and "lower.ply" in lines[head + 3]
    assert lines[head + 6].startswith("all shapes together: 1.0")
    assert json.loads(json.dumps(report.to_dict()))["collision"] == "file"
    fitted = arms.read_urdf(file)
    together = [sum(fit.volume for fit in each.fits) for each in (fitted, report)]
    assert together[0] > 1.1 * together[1]


def test_an_open_surface_has_a_hull_and_no_volume(file: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.load(file.parent / "lower.ply")
    mesh.update_faces(np.arange(len(mesh.faces)) > 5)
    mesh.export(file.parent / "lower.ply")
    fit = arms.read_urdf(file, collision="file").fits[2]
    assert fit.own_volume is None and fit.shape["kind"] == "convex"


def test_pairs_that_always_touch_are_ignored(file: Path) -> None:
    """The hand's ball reaches into the upper arm in all postures: no controller could do anything about it."""
    assert arms.read_urdf(file, collision="file").touching == ()
    text = file.read_text().replace('<origin xyz="0 0 0.5"/>', '<origin xyz="0 0 -0.1"/>')
    file.write_text(text.replace('<sphere radius="0.03"/>', '<sphere radius="0.3"/>'))
    report = arms.read_urdf(file, collision="file")
    assert report.touching == (("upper", "hand"),)
    assert report.document["ignore"] == [["upper", "hand"]]
    middle = [[0.5, 0.5, 0.5]]
    [measured], [all_pairs] = (
        _core.overlapping_links(arm, middle) for arm in (report.document, {**report.document, "ignore": []})
    )
    assert set(all_pairs) - set(measured) == {("upper", "hand")}


def test_what_is_flat_is_refused_by_name(file: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    sheet.export(file.parent / "lower.ply")
    with pytest.raises(vff.errors.InputError, match=r"lower: lower\.ply is flat: it has no hull; use coll"):
        arms.read_urdf(file, collision="file")
    flat = {"kind": "convex", "vertices": sheet.vertices.tolist()}
    document = {"arm": {"model": "panda", "collision": [{"link": "panda_link3", "shape": flat}]}}
    scenario = vff.Scenario.load("panda-sweep").to_dict() | document
    with pytest.raises(vff.errors.ScenarioError, match=r"arm\.collision\[0\]\.shape\.vertices"):
        vff.simulate(scenario)


def test_hulls_come_back_from_mujoco() -> None:
    """Written as MJCF and read as in the file the arm keeps its distances; URDF says what it cannot hold."""
    pytest.importorskip("mujoco")
    with pytest.warns(vff.errors.ScenarioWarning, match="convex hulls"):
        arms.to_urdf(MIXED)
    again = arms.read_mjcf(arms.to_mjcf(MIXED), base=MIXED["base"], tip=MIXED["tip"], collision="file")
    q = np.full(7, 0.4)
    ours, theirs = (
        vff.distances(arm_of(each), q, 0 * q, OBSTACLES).distance for each in (MIXED, again.document)
    )
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-7)


def test_capsules_of_a_urdf_come_back() -> None:
    """Written as cylinders with balls at their ends, and one capsule each again."""
    arm = arms.named("panda")
    again = arms.read_urdf(arms.to_urdf(arm), tip=arm["tip"], collision="file").document["collision"]
    assert len(again) == len(arm["collision"])
    for given, found in zip(arm["collision"], again, strict=True):
        assert (given["link"], found["shape"]["kind"]) == (found["link"], "capsule")
        ends = {tuple(np.round(each["shape"][end], 9)) for each in (given, found) for end in "ab"}
        assert len(ends) == 2 and found["shape"]["radius"] == pytest.approx(
            given["shape"]["radius"], rel=1e-9
        )


# ------------------------------------------------------------------------------------------------ pictures


def test_arrows_begin_where_the_force_leaves_the_link() -> None:
    """On the surface of one of its shapes, with nothing of that shape before them."""
    from vffnull.draw.scene import Scene

    document = vff.Scenario.load("panda-sweep").to_dict() | {"arm": MIXED}
    result = vff.simulate(document, {"duration": 3.5, "simulation.record_every": 50})
    scene = Scene.of_result(result)
    points, forces = scene.pushes
    np.testing.assert_allclose(np.linalg.norm(forces, axis=2), scene.strength, rtol=1e-12, atol=1e-12)
    arm, seen = arm_of(MIXED), set()
    for row, link in np.argwhere(scene.strength > 0.1):
        shape, frame = MIXED["collision"][link + 1]["shape"], poses(MIXED, result.q[row])[link + 1]
        on, away = ((each[row, link]) @ frame[:3, :3] for each in (points - frame[:3, 3], forces))
        if shape["kind"] == "sphere":
            shape = {**shape, "kind": "capsule", "a": shape["center"], "b": np.add(shape["center"], 1e-9)}
        assert abs(outside(shape, on[None])) < 1e-6
        assert outside(shape, (on + 1e-3 * away / np.linalg.norm(away))[None]) > 0.0
        seen.add(shape["kind"])
    assert seen == {"box", "convex", "capsule"} and arm.n == 7


def test_notebooks_draw_what_has_corners() -> None:
    """As many polygons as of an arm of balls."""
    ball = {"kind": "sphere", "center": [0.0, 0.0, 0.0], "radius": 0.05}
    balls = [{"link": each["link"], "shape": ball} for each in MIXED["collision"]]
    drawn, usual = (arm_of(each)._repr_html_() for each in (MIXED, {**MIXED, "collision": balls}))
    assert drawn.count("<polygon") == usual.count("<polygon") > len(balls)
