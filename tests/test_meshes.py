"""Meshes as obstacles: hulls that enclose them, how much larger they are, and what cannot be one."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import threading
import time
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import vffnull as vff
from vffnull.arms import _meshes, read_urdf
from vffnull.arms._capsules import Solid, fit_solids
from vffnull.arms._hulls import CORNERS
from vffnull.arms.meshes import Enclosure, enclose
from vffnull.errors import InputError
from vffnull.model.shape import core_in_space
from waiting import HANG

PANDA = vff.Arm.named("panda")
Q = np.array([0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854])


def saved(mesh: trimesh.Trimesh, folder: Path, name: str = "mesh.stl") -> Path:
    path = folder / name
    mesh.export(path)
    return path


def bracket() -> trimesh.Trimesh:
    """Two boards at a right angle, 6 litres in all; their hull has 13.5."""
    corners = [[0, 0], [0.3, 0], [0.3, 0.05], [0.05, 0.05], [0.05, 0.3], [0, 0.3]]
    floor = [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]
    vertices = np.array([[x, y, z] for z in (0.0, 0.2) for x, y in corners])
    sides = [[i, (i + 1) % 6, (i + 1) % 6 + 6, i + 6] for i in range(6)]
    faces = [triangle[::-1] for triangle in floor] + [[i + 6 for i in triangle] for triangle in floor]
    faces += [each for a, b, c, d in sides for each in ([a, b, c], [a, c, d])]
    return trimesh.Trimesh(vertices, faces)


def beyond_each(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """How far each of some points is outside of a hull, by SciPy's planes."""
    from scipy.spatial import ConvexHull

    planes = ConvexHull(corners).equations
    found: np.ndarray = (points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return found


def beyond(corners: np.ndarray, points: np.ndarray) -> float:
    """How far the one is that is farthest outside."""
    return float(beyond_each(corners, points).max())


LINK = """<link name="l{i}">
<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="mesh.stl"{scale}/></geometry></collision></link>
<joint name="j{i}" type="revolute"><parent link="l{before}"/><child link="l{i}"/><axis xyz="{axis}"/>
<origin xyz="0 0 {far}"/><limit lower="-2" upper="2" velocity="2" effort="50"/></joint>
"""


def chain_of(scale: str, folder: Path) -> Path:
    """An arm whose four links are all one mesh, made in millimetres."""
    saved(trimesh.creation.cylinder(40.0, 200.0).apply_translation([0.0, 0.0, 100.0]), folder)
    axes = ["0 0 1", "0 1 0"] * 2
    links = [
        LINK.format(i=i + 1, before=i, axis=axis, far=0.3 if i else 0.0, scale=scale)
        for i, axis in enumerate(axes)
    ]
    path = folder / "chain.urdf"
    path.write_text("".join(['<robot name="chain"><link name="l0"/>', *links, "</robot>"]), encoding="utf-8")
    return path


@pytest.mark.parametrize("collision", ["fit", "file"])
def test_meshes_in_millimetres_are_told_of(collision: Any, tmp_path: Path) -> None:
    """And no pair is ignored because its shapes are a thousand times as large."""
    report = read_urdf(chain_of("", tmp_path), collision=collision)
    (told,) = [each for each in report.warnings if "millimetres" in each]
    assert "`l1`, `l2`, `l3` and `l4`" in told and 'scale="0.001 0.001 0.001"' in told
    assert not report.touching
    report = read_urdf(chain_of(' scale="0.001 0.001 0.001"', tmp_path), collision=collision)
    assert not report.touching and not any("millimetres" in each for each in report.warnings)


@pytest.mark.parametrize("collision", ["fit", "file"])
def test_what_has_no_scale_is_not_told_to_have_another(collision: Any, tmp_path: Path) -> None:
    """A cylinder in millimetres says so of itself: only meshes have a scale."""
    path = chain_of("", tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('<mesh filename="mesh.stl"/>', '<cylinder radius="40" length="200"/>'))
    report = read_urdf(path, collision=collision)
    (told,) = [each for each in report.warnings if "millimetres" in each]
    assert told.endswith("m long: lengths are read as metres; are theirs millimetres?")
    with pytest.raises(InputError, match=r"pieces: no mesh on a link 'zz'; no link has a mesh$"):
        read_urdf(path, collision="file", pieces={"zz": 2})


@pytest.mark.parametrize("seed", [480, 874, 1042])
def test_a_hull_that_the_core_cannot_tell_the_corners_of_is_a_capsule(seed: int) -> None:
    """A box and a drum in one mesh: the hull with fewer corners has some that all but lie between others."""
    rng = np.random.default_rng(seed)
    turned = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    box = Solid.box("box", (0.08, 0.05, 0.2)).moved(turned, np.zeros(3))
    turned = trimesh.transformations.random_rotation_matrix(rng.random(3))[:3, :3]
    drum = Solid.cylinder("drum", 0.05, 0.2).moved(turned, 0.1 * rng.normal(size=3))
    points = np.vstack([box.points, drum.points])
    for fit in fit_solids("link", [Solid.mesh("both", points, np.zeros((0, 3), np.int64))]):
        corners, radius = core_in_space(fit.shape)
        assert fit.shape["kind"] in ("capsule", "convex") and len(corners) and radius >= 0.0
        assert fit.protrusion < 1e-6


def test_a_convex_mesh_is_its_own_hull(tmp_path: Path) -> None:
    """A box of 8 corners loses nothing, whatever the unit of the file; the distance is the box's own."""
    size = np.array([0.1, 0.2, 0.3])
    found = enclose(saved(trimesh.creation.box(1e3 * size), tmp_path), scale=1e-3)
    assert len(found.hulls) == 1
    assert found.volume == pytest.approx(0.006, rel=1e-6)  # STL holds floats of 32 bits
    assert found.mesh_volume == pytest.approx(found.volume, rel=1e-12)
    assert found.protrusion < 1e-12
    place = [0.5, 0.1, 0.4]
    one = vff.distances(PANDA, Q, Q, found.obstacles(place)).distance
    box = vff.distances(PANDA, Q, Q, [vff.Obstacle.box(place, size)]).distance
    np.testing.assert_allclose(one, box, atol=1e-7)


@pytest.mark.parametrize(("name", "length"), [("millimeter", 0.001), ("inch", 0.0254), ("cubit", 0.4572)])
def test_a_dae_file_says_its_unit(name: str, length: float, tmp_path: Path) -> None:
    """6 cm in millimetres were 60 m."""
    mesh = trimesh.creation.box(extents=[2.0, 2.0, 6.0])
    text = trimesh.exchange.dae.export_collada(mesh).decode()
    unit = f'<unit name="{name}" meter="{length}"/><up_axis>'
    path = tmp_path / "box.dae"
    path.write_text(re.sub(r"<unit[^>]*/>", "", text).replace("<up_axis>", unit, 1))
    extent = np.ptp(np.vstack(enclose(path).hulls), axis=0)
    np.testing.assert_allclose(extent, length * mesh.extents, rtol=1e-6)


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "3mf", "glb", "dae"])
def test_files_of_all_formats_hold_the_same_box(ending: str, tmp_path: Path) -> None:
    """What reads them comes with `.[meshes]`."""
    (corners,) = enclose(saved(trimesh.creation.box([0.1, 0.2, 0.3]), tmp_path, f"box.{ending}")).hulls
    expected = [[x, y, z] for x in (-0.05, 0.05) for y in (-0.1, 0.1) for z in (-0.15, 0.15)]
    np.testing.assert_allclose(sorted(np.round(corners, 6).tolist()), expected, atol=1e-6)


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.icosphere(subdivisions=3, radius=0.1),
        trimesh.creation.torus(0.2, 0.05),
        trimesh.creation.capsule(0.4, 0.05),
    ],
    ids=["ball", "torus", "capsule"],
)
def test_nothing_sticks_out_of_a_hull_with_fewer_corners(mesh: trimesh.Trimesh, tmp_path: Path) -> None:
    """Hundreds of vertices become at most 64 corners around all of them, for an eighth of the volume."""
    found = enclose(saved(mesh, tmp_path, "mesh.ply"))
    (corners,) = found.hulls
    assert len(mesh.convex_hull.vertices) > CORNERS >= len(corners)
    assert beyond(corners, mesh.vertices) <= 0.0
    assert found.volume < 1.125 * mesh.convex_hull.volume
    (obstacle,) = found.obstacles()
    assert obstacle.kind == "convex"


@pytest.fixture(scope="module")
def several(tmp_path_factory: pytest.TempPathFactory) -> Enclosure:
    """A bracket in pieces; making them takes seconds."""
    return enclose(saved(bracket(), tmp_path_factory.mktemp("bracket")), 3)


def test_pieces_keep_a_hollow(several: Enclosure, tmp_path: Path) -> None:
    """Between the boards of a bracket there is room, which one hull would fill: two or three keep it."""
    path = saved(bracket(), tmp_path)
    one = enclose(path)
    assert one.mesh_volume == pytest.approx(0.2 * (0.3**2 - 0.25**2), rel=1e-6)
    assert one.volume == pytest.approx(0.2 * (0.3**2 - 0.25**2 / 2), rel=1e-6)
    assert 2 <= len(several.hulls) <= 3
    assert several.volume < 1.05 * one.mesh_volume
    assert several.protrusion < 1e-12
    # Nothing of the surface is outside of all of them, wherever it is asked, cuts included.
    points, _ = trimesh.sample.sample_surface(bracket(), 20_000, seed=1)
    apart = [beyond_each(corners, points) for corners in several.hulls]
    assert np.min(apart, axis=0).max() < 1e-9
    hollow = np.array([[0.15, 0.15, 0.1]])
    assert beyond(one.hulls[0], hollow) < 0.0
    assert all(beyond(corners, hollow) > 0.09 for corners in several.hulls)
    again = enclose(path, 3)
    assert all(map(np.array_equal, several.hulls, again.hulls))


def test_the_pieces_move_as_one(several: Enclosure) -> None:
    """They turn about the origin of the mesh: after a quarter they are where the mesh would be."""
    motion = vff.Motion.linear([0.1, 0.0, 0.0])
    turning = several.obstacles([0.4, 0.0, 0.3], motion, angular_velocity=[0.0, 0.0, np.pi / 2])
    half = np.sqrt(0.5)
    turned = several.obstacles([0.5, 0.0, 0.3], orientation=[half, 0.0, 0.0, half])
    later = vff.distances(PANDA, Q, Q, turning, t=1.0).distance
    there = vff.distances(PANDA, Q, Q, turned).distance
    np.testing.assert_allclose(later, there, atol=1e-9)
    scenario = vff.Scenario.load("panda-sweep").replace(obstacles=turning, duration=0.01)
    assert vff.simulate(scenario).status == "completed"


def test_bodies_are_pieces_and_round_ones_are_halved(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two balls in one file and a speck beside: nothing to cut, and more pieces come nearer to them."""
    monkeypatch.setattr("vffnull.arms._pieces._cut", lambda *_: pytest.fail("there is no hollow"))
    balls = [trimesh.creation.icosphere(subdivisions=4, radius=r) for r in (0.06, 0.03)]
    balls[1].apply_translation([0.2, 0.0, 0.0])
    speck = trimesh.creation.box([2e-3, 2e-3, 2e-3])
    speck.apply_translation([0.0, 0.0, 0.061])
    mesh = trimesh.util.concatenate([*balls, speck])
    path = saved(mesh, tmp_path)
    one, two, six, many = (enclose(path, count) for count in (1, 2, 6, 20))
    assert [len(each.hulls) for each in (one, two, six, many)] == [1, 2, 6, 20]
    assert one.volume > 1.5 * two.volume > 1.5 * six.volume
    excess = []
    points, _ = trimesh.sample.sample_surface(mesh, 20_000, seed=1)
    for found in (two, six, many):
        assert found.protrusion < 1e-12
        assert np.min([beyond_each(corners, points) for corners in found.hulls], axis=0).max() < 1e-9
        corners = np.vstack(found.hulls)
        large, small = (np.linalg.norm(corners - [x, 0.0, 0.0], axis=1) for x in (0.0, 0.2))
        excess.append(float(np.minimum(large - 0.06, small - 0.03).max()))
    # Corners stand out of a ball: those of halves less, but for the speck, which is 2 mm high.
    assert excess[0] > 4e-3 > excess[2]


ARM = """<robot name="hook"><link name="base"/>
<link name="hook"><inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02"/></inertial>
<collision><origin xyz="0.1 0 0"/><geometry><mesh filename="mesh.stl"/></geometry></collision></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="hook"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="5" velocity="2"/></joint></robot>"""


def test_a_link_in_pieces_lets_something_into_its_hollow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What one hull fills is free between several; they are cut once, and kept by how many there may be."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    saved(bracket(), tmp_path)
    robot = tmp_path / "hook.urdf"
    robot.write_text(ARM, encoding="utf-8")
    ball = [vff.Obstacle.sphere([0.25, 0.15, 0.1], 0.05)]

    def distance(arm: vff.Arm) -> float:
        return float(vff.distances(arm, [0.0], [0.0], ball).distance.min())

    whole = vff.Arm.from_urdf(robot, collision="file")
    assert len(whole.collision) == 1 and distance(whole) < -0.03
    cut = vff.Arm.from_urdf(robot, collision="file", pieces=3)
    assert 2 <= len(cut.collision) <= 3
    assert distance(cut) == pytest.approx(0.05, abs=2e-3)  # 0.1 m to either board, less its radius
    told = read_urdf(robot, collision="file", pieces={"hook": 3})
    assert all(fit.protrusion < 1e-12 for fit in told.fits)
    litres = 1e3 * sum(fit.own_volume or 0.0 for fit in told.fits)
    assert litres == pytest.approx(200.0 * (0.3**2 - 0.25**2), rel=1e-6)
    monkeypatch.setattr("vffnull.arms._pieces._cut", lambda *_: pytest.fail("it is kept"))
    again = vff.Arm.from_urdf(robot, collision="file", pieces={"hook": 3})
    assert again.to_dict() == cut.to_dict()
    scene = {"arm": {"urdf": str(robot), "collision": "file", "pieces": {"hook": 3}}}
    document = {**scene, "q0": [0.0], "duration": 0.01, "reference": {"kind": "setpoint"}}
    assert vff.Scenario.from_dict(document).arm.collision == cut.collision


@pytest.mark.parametrize(
    ("pieces", "collision", "sentence"),
    [
        (0, "file", "pieces: expected a whole number from 1 to 64, got 0"),
        (65, "file", "pieces: expected a whole number from 1 to 64, got 65"),
        (True, "file", "pieces: expected a whole number from 1 to 64, got True"),
        ({"hook": 2.5}, "file", r"pieces\['hook'\]: expected a whole number from 1 to 64, got 2\.5"),
        ({"hock": 2}, "file", "pieces: no mesh on a link 'hock'; there are hook"),
        (2, "fit", "pieces: only the meshes of collision='file' are cut"),
        ({"hook": 2}, "none", "pieces: only the meshes of collision='file' are cut"),
    ],
)
def test_what_are_no_pieces(tmp_path: Path, pieces: Any, collision: Any, sentence: str) -> None:
    saved(bracket(), tmp_path)
    robot = tmp_path / "hook.urdf"
    robot.write_text(ARM, encoding="utf-8")
    with pytest.raises(InputError, match=sentence):
        vff.Arm.from_urdf(robot, collision=collision, pieces=pieces)


def test_what_is_no_mesh(tmp_path: Path) -> None:
    """Everything that cannot be enclosed says what is wrong with it."""
    path = saved(bracket(), tmp_path)
    with pytest.raises(InputError, match=r"mesh '.*none\.stl' cannot be found"):
        enclose(tmp_path / "none.stl")
    with pytest.raises(InputError, match="pieces: expected a whole number from 1 to 64, got 0"):
        enclose(path, 0)
    with pytest.raises(InputError, match="scale: expected one or three positive numbers, got -1"):
        enclose(path, scale=-1)
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [1, 3, 2]])
    with pytest.raises(InputError, match=r"is flat: it encloses no volume"):
        enclose(saved(flat, tmp_path, "flat.ply"))
    broken = tmp_path / "broken.stl"
    broken.write_text("solid nothing")
    with pytest.raises(InputError, match=r"broken\.stl"):
        enclose(broken)


def test_more_than_fits_into_memory_is_refused_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the size of the file, by what an STL says that it has, and by what an archive unpacks to."""
    large = tmp_path / "large.stl"
    with large.open("wb") as file:
        file.write(bytes(80) + (10_000_000).to_bytes(4, "little"))
        file.truncate(84 + 50 * 10_000_000)  # without a byte on the disk
    with pytest.raises(
        InputError, match=r"large\.stl has 10000000 triangles; at most 1000000 are read: simplify"
    ):
        enclose(large)
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("part.stl", bytes(3 << 20))
    monkeypatch.setattr(_meshes, "MAX_BYTES", 2 << 20)
    with pytest.raises(InputError, match=r"bomb\.zip has 3 MB; at most 2 MB are read"):
        enclose(tmp_path / "bomb.zip")
    (tmp_path / "part.obj.gz").write_bytes(b"")
    with pytest.raises(InputError, match=r"part\.obj\.gz is packed; unpack it first"):
        enclose(tmp_path / "part.obj.gz")


def test_a_triangle_of_no_vertex(tmp_path: Path) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    (tmp_path / "wrong.ply").write_text(f"{head}{faces}0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    with pytest.raises(InputError, match=r"wrong\.ply has a triangle with vertex 7; there are 3"):
        enclose(tmp_path / "wrong.ply")


def test_cutting_ends_at_ctrl_c(tmp_path: Path) -> None:
    """A cut that takes long ends with KeyboardInterrupt, and its process with it."""
    path = saved(trimesh.creation.torus(0.2, 0.05), tmp_path)
    began = threading.Event()

    def interrupt() -> None:
        began.wait()
        time.sleep(0.3)  # into the cut; whenever it comes, it must be answered
        signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        began.set()
        enclose(path, 50)
        pytest.fail("the cut had ended before")
    thread.join()


def test_a_binary_stl_is_read_without_the_library_as_with_it(tmp_path: Path) -> None:
    """To the last bit, in a process that never imports it; an STL in text is the library's."""
    path, text = saved(bracket(), tmp_path), tmp_path / "text.stl"
    found, wanted = _meshes._binary_stl(path), _meshes._by_trimesh(path)
    assert found is not None
    for ours, theirs in zip(found, wanted, strict=True):
        np.testing.assert_array_equal(ours, theirs)
        assert np.asarray(ours).dtype == np.asarray(theirs).dtype
    text.write_text(trimesh.exchange.stl.export_stl_ascii(bracket()))
    assert _meshes._binary_stl(text) is None
    np.testing.assert_allclose(
        np.sort(_meshes.read(text, "text", (1, 1, 1)).points, axis=0),
        np.sort(_meshes.read(path, "binary", (1, 1, 1)).points, axis=0),
        atol=1e-6,
    )
    script = (
        "import sys; from pathlib import Path; from vffnull.arms import _meshes\n"
        f"_meshes.read(Path({str(path)!r}), 'mesh', (1, 1, 1)); print('trimesh' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=HANG)
    assert done.stdout.strip() == "False", done.stderr
