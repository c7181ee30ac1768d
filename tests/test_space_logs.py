"""Logs of runs in space: Foxglove and Rerun get every frame, what it carries, and the robot's description.

The files are read back, and the arm is put together from them alone.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull.draw.scene import Scene
from vffnull.evaluation.geometry import arm as _arm
from vffnull.logs import frames

Array = NDArray[np.float64]

HALF = math.sqrt(0.5)
CRATE = {"shape": {"kind": "box", "size": [0.2, 0.3, 0.4]}, "orientation": [HALF, 0.0, 0.0, HALF]}
MOVING = {"kind": "linear", "velocity": [0.0, 0.1, 0.05]}
HULL = [[0.1, 0.0, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.0, 0.0, 0.2], [0.05, 0.05, 0.1]]
THINGS: list[dict[str, Any]] = [
    {"shape": {"kind": "sphere", "radius": 0.05}, "position": [0.1, 1.2, 0.3]},
    CRATE | {"position": [1.2, 0.1, 0.2], "motion": MOVING, "angular_velocity": [0.0, 0.4, 0.3]},
    {
        "shape": {"kind": "capsule", "a": [0, 0, -0.2], "b": [0, 0.1, 0.2], "radius": 0.02},
        "position": [1, 1, 0],
    },
    {"shape": {"kind": "half_space", "normal": [0.0, 0.0, 1.0]}, "position": [0.0, 0.0, -0.9]},
    {
        "shape": {"kind": "convex", "vertices": HULL},
        "position": [-1.0, 1.0, 0.0],
        "orientation": [HALF, HALF, 0, 0],
    },
]


def furnished() -> vff.Scenario:
    """A Panda on a tilted mount that draws a circle with a turning tool, among one obstacle of each kind."""
    arm = vff.Arm.named("panda").to_dict()
    arm["mount"] = {"position": [0.1, -0.2, 0.3], "orientation": [math.cos(0.1), math.sin(0.1), 0.0, 0.0]}
    return vff.Scenario.load("panda-sweep").replace(
        **{"arm": arm, "obstacles": THINGS, "duration": 0.1, "simulation.record_every": 10}
    )


@pytest.fixture(scope="module")
def result() -> vff.Result:
    return vff.simulate(furnished())


def slider() -> vff.Scenario:
    """A joint that slides, links without shapes, and a tip that is the last link."""
    joint: dict[str, Any] = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "mass": 1.0, "com": [0.2, 0.0, 0.0]}
    joint["inertia"] = [0.01, 0.02, 0.02, 0.0, 0.0, 0.0]
    joints = [
        joint | {"kind": "prismatic", "name": "lift", "link": "world"},
        joint | {"name": "shoulder", "link": "target", "position": [0.1, 0.0, 0.0]},
        joint | {"name": "elbow", "link": "obstacle_0", "position": [0.4, 0.0, 0.0]},
        joint | {"name": "wrist", "link": "hand", "position": [0.3, 0.0, 0.0]},
    ]
    arm = {"joints": joints, "tip": "hand", "tool": {"position": [0.2, 0.0, 0.0]}}
    ball = vff.Obstacle.sphere([1.5, 0.0, 0.0], 0.1)
    return vff.Scenario(
        arm=arm, q0=[0.1, 0.3, 0.5, -0.4], duration=0.01, reference={"kind": "setpoint"}, obstacles=[ball]
    )


def messages(path: Path) -> dict[str, list[tuple[Any, Any, Any]]]:
    """Schema, message and its content by topic."""
    from mcap.reader import make_reader

    found: dict[str, list[tuple[Any, Any, Any]]] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            found.setdefault(channel.topic, []).append((schema, message, json.loads(message.data)))
    return found


def matrix(translation: dict[str, float], turn: dict[str, float]) -> Array:
    made = np.eye(4)
    made[:3, :3] = _arm.rotation([turn[name] for name in "wxyz"])
    made[:3, 3] = [translation[name] for name in "xyz"]
    return made


def worlds(message: dict[str, Any]) -> dict[str, Array]:
    """Where every frame of a message is in the world, by walking up to it as a viewer does."""
    parents = {each["child_frame_id"]: each for each in message["transforms"]}
    (root,) = {each["parent_frame_id"] for each in parents.values()} - set(parents)
    assert len(parents) == len(message["transforms"]), "a frame has two places"

    def place(name: str) -> Array:
        if name == root:
            return np.eye(4)
        each = parents[name]
        there: Array = place(each["parent_frame_id"]) @ matrix(each["translation"], each["rotation"])
        return there

    return {name: place(name) for name in parents}


# ------------------------------------------------------------------------------------------------ Foxglove


def test_transforms_are_where_the_arm_is(result: vff.Result, tmp_path: Path) -> None:
    """Links, tip, obstacles and target, from a message on its own, as the core's kinematics have them."""
    found = messages(result.save(tmp_path / "run.mcap"))["/tf"]
    assert len(found) == len(result.t) == 11
    assert found[0][0].name == "foxglove.FrameTransforms"
    arm = result.scenario.arm
    assert result.orientation is not None and result.orientation_ref is not None
    for row, (_, message, content) in enumerate(found):
        assert message.log_time == round(result.t[row] * 1e9)
        assert content["transforms"][0]["timestamp"] == {"sec": 0, "nsec": message.log_time}
        there = worlds(content)
        for name, pose in zip(arm.link_names, arm.link_poses(result.q[row]), strict=True):
            np.testing.assert_allclose(there[name], pose, rtol=0, atol=1e-12)
        tip = there["panda_hand_tcp"]
        np.testing.assert_allclose(tip[:3, 3], result.x[row], rtol=0, atol=1e-12)
        np.testing.assert_allclose(tip[:3, :3], _arm.rotation(result.orientation[row]), rtol=0, atol=1e-12)
        target = there["target"]
        np.testing.assert_allclose(target[:3, 3], result.x_ref[row], rtol=0, atol=1e-12)
        turned = _arm.rotation(result.orientation_ref[row])
        np.testing.assert_allclose(target[:3, :3], turned, rtol=0, atol=1e-12)
        for i in range(5):
            place = there[f"obstacle_{i}"][:3, 3]
            np.testing.assert_allclose(place, result.obstacles[row, i], rtol=0, atol=1e-12)


def entities_of(found: dict[str, list[Any]]) -> list[dict[str, Any]]:
    """Everything that is to be drawn: arm, obstacles, target."""
    topics = ("/scene/arm", "/scene/obstacles", "/scene/target")
    return [each for topic in topics for _, _, update in found[topic] for each in update["entities"]]


def bodies(entity: dict[str, Any]) -> Iterator[tuple[str, Array, Array]]:
    """Kind, pose and size of what a viewer draws of an entity."""
    for kind in ("spheres", "cylinders", "cubes"):
        for each in entity[kind]:
            pose, size = each["pose"], each["size"]
            yield kind, matrix(pose["position"], pose["orientation"]), np.array([size[k] for k in "xyz"])


def test_solids_are_those_that_are_measured(result: vff.Result, tmp_path: Path) -> None:
    """Put where its frame is, every solid of the file is that of the scene at that instant."""
    found = messages(result.save(tmp_path / "run.mcap"))
    scene, row = Scene.of_result(result), 7
    there = worlds(found["/tf"][row][2])
    entities = entities_of(found)
    assert {each["frame_id"] for each in entities} == set(there)
    assert all(each["frame_locked"] and each["lifetime"] == {"sec": 0, "nsec": 0} for each in entities)
    drawn: dict[str, list[Any]] = {"spheres": [], "cylinders": [], "cubes": []}
    for entity in entities:
        for kind, pose, size in bodies(entity):
            drawn[kind].append((there[entity["frame_id"]] @ pose, size))
    cores = [scene.solid(i)[row if len(scene.solid(i)) > 1 else 0] for i in range(5)]
    ends = [(part.corners[row], part.radius) for part in scene.parts] + [(cores[0], 0.05), (cores[2], 0.02)]
    expected = [(corner, radius) for corners, radius in ends for corner in corners]
    for (pose, size), (corner, radius) in zip(drawn["spheres"], expected, strict=True):
        np.testing.assert_allclose(pose[:3, 3], corner, rtol=0, atol=1e-12)
        np.testing.assert_allclose(size, 2 * radius, rtol=1e-15)
    rods = [(*corners, radius) for corners, radius in ends if len(corners) == 2]
    assert len(rods) > 9
    for (pose, size), (a, b, radius) in zip(drawn["cylinders"], rods, strict=True):
        np.testing.assert_allclose(pose[:3, 3], (a + b) / 2, rtol=0, atol=1e-12)
        np.testing.assert_allclose(np.cross(pose[:3, 2], b - a), 0.0, atol=1e-12)
        np.testing.assert_allclose(size, [2 * radius, 2 * radius, np.linalg.norm(b - a)], rtol=1e-12)
    ((pose, size),) = drawn["cubes"]
    signs = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)])
    assert_same_points((signs * size / 2) @ pose[:3, :3].T + pose[:3, 3], cores[1])
    surfaces = {each["frame_id"]: each["triangles"] for each in entities if each["triangles"]}
    assert set(surfaces) == {"obstacle_3", "obstacle_4"}
    for i in (3, 4):
        (mesh,) = surfaces[f"obstacle_{i}"]
        points = np.array([[point[k] for k in "xyz"] for point in mesh["points"]])
        pose = there[f"obstacle_{i}"]
        assert_same_points(points @ pose[:3, :3].T + pose[:3, 3], cores[i])
        assert (mesh["color"]["a"] < 1.0) == (i == 3)


def assert_same_points(ours: Array, theirs: Array) -> None:
    away = np.linalg.norm(ours[:, None] - theirs[None], axis=-1)
    assert len(ours) == len(theirs) and away.min(axis=0).max() < 1e-12 and away.min(axis=1).max() < 1e-12


def test_hulls_are_closed() -> None:
    """Their triangles enclose the hull's volume, seen from outside."""
    corners = np.array(HULL)
    mesh = frames.solid(corners, 0.0)
    assert isinstance(mesh, frames.Mesh)
    a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
    volume = (a * np.cross(b, c)).sum() / 6
    from scipy.spatial import ConvexHull

    assert volume == pytest.approx(ConvexHull(corners).volume, rel=1e-12)


def test_the_robot_s_description(result: vff.Result, tmp_path: Path) -> None:
    """Under the topic where Foxglove looks for it, and as an attachment: URDF of this very arm."""
    from mcap.reader import make_reader

    path = result.save(tmp_path / "run.mcap")
    found = messages(path)
    ((schema, message, content),) = found["/robot_description"]
    assert schema.name == "std_msgs/String" and message.log_time == 0
    again = vff.Arm.from_urdf(content["data"], tip="panda_hand_tcp", collision="none")
    q = result.q[-1]
    np.testing.assert_allclose(again.pose(q)[0], result.x[-1], rtol=0, atol=1e-12)
    with path.open("rb") as file:
        attached = {each.name: each.data.decode() for each in make_reader(file).iter_attachments()}
    assert attached["robot.urdf"] == content["data"] and set(attached) == {"robot.urdf", "scenario.toml"}
    # Frames of the description and of the transforms are the same, with the same parents.
    import xml.etree.ElementTree as ET

    joints = ET.fromstring(content["data"]).iter("joint")
    pairs = {(j.find("parent").get("link"), j.find("child").get("link")) for j in joints}  # type: ignore[union-attr]
    sent = {(each["parent_frame_id"], each["child_frame_id"]) for each in found["/tf"][0][2]["transforms"]}
    assert pairs <= sent


def test_foxglove_reads_every_schema(result: vff.Result, tmp_path: Path) -> None:
    """It knows objects, numbers, texts, flags, and arrays of these; and what is sent is what was said."""
    for found in (
        messages(result.save(tmp_path / "space.mcap")),
        messages(vff.simulate("paper-1", {"duration": 0.01}).save(tmp_path / "plane.mcap")),
    ):
        for sent in found.values():
            schema = json.loads(sent[0][0].data)
            for _, _, content in sent:
                assert_readable(schema, content, sent[0][0].name)


def assert_readable(schema: dict[str, Any], value: Any, where: str) -> None:
    match schema["type"]:
        case "object":
            assert set(value) == set(schema["properties"]) or not schema["properties"], where
            for name, part in schema["properties"].items():
                assert_readable(part, value[name], f"{where}.{name}")
        case "array":
            assert schema["items"]["type"] != "array", f"{where}: an array of arrays"
            for each in value:
                assert_readable(schema["items"], each, f"{where}[]")
        case "number":
            assert value is None or isinstance(value, float | int), where
        case kind:
            assert isinstance(value, {"string": str, "boolean": bool, "integer": int}[kind]), where


def test_names_are_told_apart(tmp_path: Path) -> None:
    """Links may be called as a frame of ours is; a bare link is drawn up to the next joint."""
    result = vff.simulate(slider())
    found = messages(result.save(tmp_path / "run.mcap"))
    there = worlds(found["/tf"][-1][2])
    arm = result.scenario.arm
    for name, pose in zip(arm.link_names, arm.link_poses(result.q[-1]), strict=True):
        np.testing.assert_allclose(there[name], pose, rtol=0, atol=1e-12)
    np.testing.assert_allclose(there["hand_"][:3, 3], result.x[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(there["obstacle_0_"][:3, 3], [1.5, 0.0, 0.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(there["target_"][:3, 3], result.x_ref[-1], rtol=0, atol=1e-12)
    (update,) = [content for _, _, content in found["/scene/arm"]]
    drawn = {each["id"]: len(each["cylinders"]) for each in update["entities"]}
    assert drawn == {"base": 0, "world": 1, "target": 1, "obstacle_0": 1, "hand": 1, "hand_": 0}


def test_a_run_in_the_plane_has_none(tmp_path: Path) -> None:
    found = messages(vff.simulate("paper-1", {"duration": 0.01}).save(tmp_path / "run.mcap"))
    assert set(found) == {"/vffnull"}


# --------------------------------------------------------------------------------------------------- Rerun


def chunks(path: Path) -> dict[str, Any]:
    """What is logged under each path, as Arrow tables."""
    import rerun.chunk

    found: dict[str, list[Any]] = {}
    for chunk in rerun.chunk.RrdReader(str(path)).stream().to_chunks():
        found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return found


def test_rerun_has_the_same_frames(result: vff.Result, tmp_path: Path) -> None:
    """To single precision, which Rerun's transforms have, and with everything they carry."""
    pytest.importorskip("rerun")
    found = chunks(result.save(tmp_path / "run.rrd"))
    tree = frames.tree_of(result)
    group = {"base": "/arm", "link": "/arm", "tool": "/arm", "obstacle": "/obstacles", "target": ""}
    for frame in tree.frames:
        path = f"/scene{group[frame.role]}/{frame.name}"
        (table,) = found[path]
        places = np.array([each[0] for each in table["Transform3D:translation"].to_pylist()])
        turns = np.array([each[0] for each in table["Transform3D:quaternion"].to_pylist()])
        np.testing.assert_array_equal(places, frame.places[:, :3, 3].astype(np.float32))
        np.testing.assert_allclose(
            _arm.rotation(np.roll(turns, 1, axis=1)), frame.places[:, :3, :3], rtol=0, atol=1e-6
        )
        np.testing.assert_array_equal(
            np.array(table["t"].to_pylist(), dtype="timedelta64[ns]").astype(np.int64),
            np.rint(1e9 * result.t),
        )
        for solid in frame.solids:
            kind = {frames.Capsule: "capsules", frames.Box: "boxes", frames.Mesh: "mesh_0"}[type(solid)]
            assert f"{path}/{kind}" in found
    (table,) = found["/scene/arm/panda_link2/capsules"]
    rods = [
        each
        for each in next(f for f in tree.frames if f.name == "panda_link2").solids
        if isinstance(each, frames.Capsule)
    ]
    starts, lengths = table["Capsules3D:translations"][0].as_py(), table["Capsules3D:lengths"][0].as_py()
    turned = _arm.rotation(np.roll(table["Capsules3D:quaternions"][0].as_py(), 1, axis=1))
    for rod, start, length, turn in zip(rods, starts, lengths, turned, strict=True):
        np.testing.assert_allclose(start, rod.a, atol=1e-7)
        np.testing.assert_allclose(start + length * turn[:, 2], rod.b, atol=1e-6)
    (table,) = found["/robot_description"]
    assert table["TextDocument:text"][0].as_py()[0] == frames.description(result)
    assert "/scene/target/axes" in found and "/scene/obstacles/obstacle_1/boxes" in found


def test_a_run_that_diverged_is_logged_up_to_there(result: vff.Result, tmp_path: Path) -> None:
    """What is no number has no place; a run without any has no scene, but its plots."""
    import dataclasses

    for sound in (4, 0):
        q = result.q.copy()
        q[sound:] = np.nan
        broken = dataclasses.replace(result, q=q)
        found = messages(broken.save(tmp_path / "run.mcap"))
        assert len(found.get("/tf", [])) == sound and len(found["/vffnull"]) == 11
        assert ("/scene/arm" in found) == bool(sound)
        if pytest.importorskip("rerun"):
            logged = chunks(broken.save(tmp_path / "run.rrd"))
            assert ("/scene/arm/panda_link1" in logged) == bool(sound) and "/record/tau" in logged


# --------------------------------------------------------------------------------------------------- units


def test_every_kind_of_file_has_units(result: vff.Result, tmp_path: Path) -> None:
    expected = result.to_pandas().attrs["units"]
    assert expected["t"] == "s" and expected["error_rx"] == "rad" and expected["obstacles_4_z"] == "m"
    with np.load(result.save(tmp_path / "run.npz")) as file:
        assert json.loads(str(file["vffnull"]))["units"] == expected
    lines = result.save(tmp_path / "run.csv").read_text(encoding="utf-8").splitlines()
    assert (
        dict(zip(lines[2].split(","), lines[1].removeprefix("# unit: ").split(","), strict=True)) == expected
    )
    import pyarrow.feather
    import pyarrow.parquet

    for schema in (
        pyarrow.parquet.read_schema(result.save(tmp_path / "run.parquet")),
        pyarrow.feather.read_table(result.save(tmp_path / "run.arrow")).schema,
    ):
        assert {field.name: field.metadata[b"unit"].decode() for field in schema} == expected
    table = messages(result.save(tmp_path / "run.mcap"))["/vffnull"]
    about = {name: each["description"] for name, each in json.loads(table[0][0].data)["properties"].items()}
    assert about["dx"].endswith("[m/s, rad/s]") and about["obstacles"].endswith("[m]")


def test_a_cloud_is_a_ball_around_every_point() -> None:
    """Where the points are in the cloud's own frame; points without a radius can be seen, too."""
    points = np.random.default_rng(0).uniform(-0.1, 0.1, (50, 3))
    clouds = [
        vff.Obstacle.points(points + np.array([0.5, 0.4, z]), radius)
        for z, radius in ((0.5, 0.01), (0.9, 0.0))
    ]
    changes = {"obstacles": [each.to_dict() for each in clouds], "duration": 0.02}
    tree = frames.tree_of(vff.simulate("panda-sweep", changes))
    drawn = [each for each in tree.frames if each.role == "obstacle"]
    for frame, cloud in zip(drawn, clouds, strict=True):
        balls = [each for each in frame.solids if isinstance(each, frames.Capsule)]
        np.testing.assert_array_equal([each.a for each in balls], cloud.shape["points"])
        assert all(each.length == 0.0 for each in balls)
    assert drawn[0].solids[0].radius == 0.01 and 0.0 < drawn[1].solids[0].radius < 0.01  # type: ignore[union-attr]
