"""The live page: the robot's own meshes, the seconds before a pause, and a cup that goes round a shelf."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from browsing import WEBGL, chromium, visit
from vffnull.errors import InputError
from vffnull.evaluation.geometry.arm import rotation
from vffnull.live.memory import KEPT, Memory
from vffnull.live.pictures import side_by_side
from vffnull.live.self_motion import CLEAR, CONTACT, MARGIN, NOTHING, PATH, picture
from vffnull.live.stories import STORIES
from waiting import frames, obey, wait_for

# ----------------------------------------------------------------------------------------- the seconds before


def remembered(end: float, step: float = 0.1) -> Memory:
    memory = Memory()
    for t in np.arange(0.0, end, step):
        memory.add({"t": float(t), "x": np.array([t, 0.0, 0.0])}, None)
    return memory


def test_a_memory_shows_what_was_and_goes_on_from_there() -> None:
    memory = remembered(10.05)
    assert memory.seen() is None and memory.span == pytest.approx(10.0)
    memory.look(4.0)
    found = memory.seen()
    assert found is not None and found[0]["t"] == pytest.approx(6.0)
    assert [tip[0] for tip in memory.tips(3, 3)] == pytest.approx([5.7, 5.8, 5.9])
    memory.go_on(1.0)  # stays there
    assert memory.back == 4.0
    memory.play()
    memory.go_on(1.0)
    found = memory.seen()
    assert found is not None and found[0]["t"] == pytest.approx(7.0)
    memory.go_on(5.0)
    assert memory.seen() is None and not memory.plays
    memory.play()  # from the begin
    assert memory.back == pytest.approx(10.0)
    memory.leave()
    assert memory.seen() is None
    memory.look(99.0)
    found = memory.seen()
    assert found is not None and found[0]["t"] == 0.0
    memory.clear()
    memory.play()
    assert memory.seen() is None and memory.span == 0.0 and memory.tips(3, 3) == []


def test_a_memory_has_an_end() -> None:
    memory = remembered(3.0 * KEPT, 0.5)
    assert memory.span == pytest.approx(KEPT)
    memory.add({"t": 1.0}, None)  # what is not later is no news
    assert memory.span == pytest.approx(KEPT)


# ------------------------------------------------------------------------------------------------ on the page


def press(callbacks: Any, value: Any = None) -> None:
    """What a visitor does with a control."""
    for callback in callbacks:
        obey(callback(SimpleNamespace(client=object(), target=SimpleNamespace(value=value))))


def test_a_pause_lets_one_look_back(page: Any) -> None:
    """By slider and by replay: arm and trail are where they were; a drag or going on ends it."""
    wait_for(lambda: page.snapshot()["t"] > 3.0)
    panel, scene = page._panel, page._scene
    assert not panel._back.visible and not panel._replay.visible
    page.pause(True)
    panel._show_paused(True)
    wait_for(lambda: page.snapshot()["status"] == "paused")
    assert panel._back.visible and panel._replay.visible
    frames(page)
    ball = np.array(scene._obstacles[0].position)
    kept = [state["t"] for state, _ in page._memory._states]
    end = page.snapshot()["t"]
    panel._back.value = -1.5
    press(panel._back._impl.update_cb)
    then = max(t for t in kept if t <= kept[-1] - 1.5)
    wait_for(lambda: page.shown["t"] == then)
    frames(page)
    moved = ball - np.array(scene._obstacles[0].position)
    np.testing.assert_allclose(moved, [0.0, 0.2 * (end - page.shown["t"]), 0.0], atol=5e-3)
    np.testing.assert_allclose(scene._tip.position, page.shown["x"][:3], atol=1e-3)
    assert page.snapshot()["t"] == end
    press(panel._replay._impl.update_cb)
    wait_for(lambda: page.shown["t"] == end)
    wait_for(lambda: panel._back.value == 0.0)
    page.look_back(1.0)
    frames(page)
    assert page.shown["t"] == max(t for t in kept if t <= kept[-1] - 1.0)
    page._carry(0, np.array([0.0, -0.6, 0.6]))
    wait_for(lambda: page.shown["t"] >= end)
    page.look_back(1.0)
    page.pause(False)
    wait_for(lambda: page.shown["t"] > end)


def test_the_slider_comes_to_the_present(page: Any) -> None:
    """Also from less than half a step before it."""
    page.pause(True)
    panel = page._panel
    panel._show_paused(True)
    slider = panel._back
    slider.value = -0.4 * slider.step
    panel.show_memory(3.0, 0.0)
    assert slider.value == 0.0


def test_another_scene_forgets(page: Any) -> None:
    wait_for(lambda: page._memory.span > 0.1)
    page.pause(True)
    page.add_obstacle()
    assert page._memory.span == 0.0
    page.look_back(5.0)
    page.replay()
    frames(page)


def test_the_cup_goes_round_the_board_of_a_shelf() -> None:
    """Without giving way the hand runs into the board; with barriers it keeps 2 cm and spills nothing."""
    pytest.importorskip("viser")
    story = STORIES["Shelf"].open().replace(**{"duration": 11.0, "simulation.record_every": 20})
    result = vff.simulate(story)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        straight = vff.simulate(story.replace(**{"controller.avoidance": "null_space"}))
    assert straight.metrics.min_clearance < -0.03
    assert result.metrics.min_clearance > 0.018
    axis = rotation(result.orientation)[:, :, 2]
    assert np.degrees(np.arccos(np.clip(-axis[:, 2], -1.0, 1.0))).max() < 8.0
    assert np.linalg.norm(result.error[-1, :3]) < 1e-3


# ----------------------------------------------------------------------------------------------------- meshes


URDF = """<robot name="two">
  <link name="base"><visual><geometry><box size="0.2 0.2 0.1"/></geometry></visual></link>
  <link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><origin xyz="0 0 0.2" rpy="0 1.5708 0"/>
      <geometry><mesh filename="package://two/bar.stl" scale="1 2 1"/></geometry>
      <material name="red"><color rgba="1 0 0 1"/></material></visual>
    <collision><geometry><sphere radius="0.3"/></geometry></collision></link>
  <link name="hand"><inertial><mass value="0.5"/>
      <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual><geometry><sphere radius="0.05"/></geometry></visual></link>
  <link name="finger"><visual><origin xyz="0 0 0.1"/>
    <geometry><box size="0.02 0.02 0.1"/></geometry></visual></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.1"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
  <joint name="elbow" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0.3 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/></joint>
  <joint name="grip" type="fixed"><parent link="hand"/><child link="finger"/><origin xyz="0 0 0.2"/></joint>
</robot>"""


@pytest.fixture
def robot(tmp_path: Path) -> tuple[Path, dict[str, Any], Any]:
    """A URDF in a package, its arm, and the mesh of its first link."""
    trimesh = pytest.importorskip("trimesh")
    folder = tmp_path / "two"
    folder.mkdir()
    bar = trimesh.creation.box((0.4, 0.05, 0.1))
    bar.export(folder / "bar.stl")
    path = folder / "robot.urdf"
    path.write_text(URDF, encoding="utf-8")
    with pytest.warns(vff.errors.ScenarioWarning, match="no shape on `hand`: nothing avoids it"):
        arm = vff.Arm.from_urdf(path, tip="finger").to_dict()
    return path, arm, bar


def test_surfaces_are_those_that_are_to_be_seen(robot: Any, tmp_path: Path) -> None:
    """Visual geometry in the frames of its links, scaled and turned; of a fixed link in its carrier's."""
    from vffnull.arms._visual import surfaces

    path, arm, bar = robot
    found = surfaces(arm, path, tmp_path)
    assert {name: len(parts) for name, parts in found.items()} == {"base": 1, "arm": 1, "hand": 2}
    vertices = np.asarray(bar.vertices) * [1.0, 2.0, 1.0]
    turned = vertices[:, [2, 1, 0]] * [1.0, 1.0, -1.0] + np.array([0.0, 0.0, 0.2])
    (drawn,) = found["arm"]
    for axis in range(3):
        assert np.ptp(drawn.points[:, axis]) == pytest.approx(np.ptp(turned[:, axis]), abs=1e-4)
    np.testing.assert_allclose(drawn.points.mean(axis=0), [0.0, 0.0, 0.2], atol=1e-4)
    assert len(drawn.triangles) == 12
    ball, finger = found["hand"]
    assert ball.radii.max() == 0.05 and not len(ball.triangles)
    np.testing.assert_allclose(finger.points.mean(axis=0), [0.0, 0.0, 0.3], atol=1e-12)


def test_what_cannot_be_drawn_is_said(robot: Any, tmp_path: Path) -> None:
    from vffnull.arms._visual import surfaces

    path, arm, _ = robot
    (path.parent / "bar.stl").unlink()
    with pytest.raises(InputError, match=r"bar\.stl"):
        surfaces(arm, path, tmp_path)
    bare = URDF.replace("<visual>", "<!--").replace("</visual>", "-->")
    with pytest.raises(InputError, match="no visual geometry"):
        surfaces(arm, bare)
    other = vff.Arm.named("panda").to_dict()
    with pytest.raises(InputError):
        surfaces(other, path, tmp_path)
    pytest.importorskip("viser")
    with pytest.raises(InputError, match="in the plane"):
        vff.live("swing", meshes=path, open_browser=False, block=False)


def test_a_live_page_draws_the_robot_s_own_meshes(robot: Any, tmp_path: Path) -> None:
    """At the poses of the links; without them the bodies that are measured; another arm is not dressed so."""
    pytest.importorskip("viser")
    path, arm, _ = robot
    scenario = {
        "arm": arm | {"load": {"shapes": [{"kind": "box", "size": [0.1, 0.1, 0.1]}]}},  # which no file draws
        "q0": [0.3, 0.5],
        "duration": 1.0,
        "controller": {"task": "position", "stiffness": 20.0, "damping": 9.0},
        "reference": {"kind": "setpoint"},
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        page = vff.live(
            scenario, meshes=path, packages=tmp_path, open_browser=False, block=False, record_to=tmp_path
        )
    try:
        frames(page)
        (link, hand) = page._scene._arms.links
        assert len(link) == 1 and len(hand) == 3 and len(link[0].faces) == 12
        assert page._panel._meshes.visible
        page.show_meshes(False)
        assert len(page._scene._arms.links[0][0].faces) > 100  # the ball that collides
        page.show_meshes(True)
        assert len(page._scene._arms.links[0][0].faces) == 12
        page.open(vff.Scenario.load("panda-sweep"))
        assert not page._panel._meshes.visible and len(page._scene._arms.links) == 7
    finally:
        page.stop()


def test_the_command_line_takes_meshes(robot: Any) -> None:
    """They reach the page, which says what it cannot do with them."""
    pytest.importorskip("viser")
    from click.testing import CliRunner

    from vffnull.cli.live import live

    path, _, _ = robot
    result = CliRunner().invoke(
        live, ["swing", "--no-browser", "--meshes", str(path), "--package", str(path.parents[1])]
    )
    assert isinstance(result.exception, InputError) and "in the plane" in str(result.exception)


COUNTING = """
window.kinds = new Set(); const sources = new Map();
const of = WebGL2RenderingContext.prototype, source = of.shaderSource, attach = of.attachShader;
of.shaderSource = function(shader, text) {
    sources.set(shader, text);
    return source.call(this, shader, text);
};
of.attachShader = function(program, shader) {
    const text = sources.get(shader) || "";
    if (text.includes("#define STANDARD") && text.includes("gl_FragColor")) window.kinds.add(text);
    return attach.call(this, program, shader);
};"""


@pytest.mark.parametrize("name", ["panda-cup", "sweep-through"])
def test_few_kinds_of_shaders_delay_the_first_picture(name: str) -> None:
    """Whatever its faces are like: one for bodies, one for those that are seen through."""
    page = vff.live(name, open_browser=False, block=False)
    try:
        with chromium(*WEBGL) as browser:

            def counting(**options: Any) -> Any:
                tab = browser.new_page(**options)
                tab.add_init_script(COUNTING)
                return tab

            def settled(_: Any) -> bool:
                return page.snapshot()["t"] > 0.3  # its run may have ended before a slow picture comes

            seen = visit(SimpleNamespace(new_page=counting), page.url, settled, (900, 700))
            kinds = seen.tab.evaluate("() => window.kinds.size")
    finally:
        page.stop()
    assert 1 <= kinds <= 2


# ------------------------------------------------------------------------------------- what cameras have seen


def test_pictures_of_cameras_stand_above_the_plots(page: Any) -> None:
    """Of the same depths as the law's, the arm in them; the points that are made of them lie beside it. They
    are gone with the scene.
    """
    pictures = page._plots.pictures
    page.open(vff.Scenario.load("panda-watched"))
    wait_for(lambda: pictures._image.visible and page.snapshot()["t"] > 1.0)
    depths = page._live.pictures()
    assert [each.shape for each in depths] == [(72, 96)] * 2
    assert all(np.ptp(each[each > 0.0]) > 0.5 for each in depths)
    rows, columns, colours = pictures._image.image.shape
    assert columns >= 640 and rows < columns and colours == 3
    state = page.snapshot()
    assert state["sensed"].shape[1] == 3 and np.all(np.isfinite(state["sensed"]))
    wait_for(lambda: len(page._scene._sensed._cloud.points) > 10)
    page.open(vff.Scenario.load("panda-sweep"))
    assert not pictures._image.visible and page._live.pictures() == []
    assert page.snapshot()["sensed"].shape == (0, 3)


def test_the_ways_along_the_self_motion_stand_above_the_plots(page: Any) -> None:
    """While something comes near; they are gone with the scene."""
    ways = page._plots.self_motion
    page.open(STORIES["Swivel"].open())
    wait_for(lambda: ways._image.visible and page._live.self_motion_map() is not None)
    rows, columns, colours = ways._image.image.shape
    assert columns >= 640 and 100 < rows < columns and colours == 3
    page.open(vff.Scenario.load("panda-sweep"))
    assert not ways._image.visible and page._live.self_motion_map() is None


def test_contact_is_red_and_the_path_white() -> None:
    distances = np.array([[np.nan, -0.1], [0.3, np.inf], [np.nan, 0.02]])
    found: Any = {"distances": distances, "path": np.array([1, 1]), "margin": 0.02, "clearance": 0.1}
    drawn = picture(found).astype(int)
    high, wide = drawn.shape[0] // 3, drawn.shape[1] // 2
    of = drawn[high // 4 :: high, wide // 2 :: wide]
    assert of.shape == (3, 2, 3)
    np.testing.assert_array_equal(of[2, 1], CONTACT)  # the first place is the lowest
    np.testing.assert_array_equal(of[0, 1], MARGIN)
    np.testing.assert_array_equal(of[1], [CLEAR] * 2)
    np.testing.assert_array_equal(of[[0, 2], 0], [NOTHING] * 2)
    assert (drawn[high + high // 2, ::50] == PATH).all()


def test_near_is_bright_and_what_is_not_measured_is_dark() -> None:
    depths = np.array([[0.5, 2.0], [0.0, 1.0]], np.float32)
    drawn = side_by_side([depths, depths[:1]], 2.0)
    scale = drawn.shape[1] // 6
    of = drawn[scale // 2 :: scale, scale // 2 :: scale].astype(int)
    assert of.shape == (2, 6, 3)
    brightness = of.sum(axis=2)
    assert brightness[0, 0] > brightness[1, 1] > brightness[0, 1] > brightness[1, 0]
    assert np.array_equal(of[:1, 4:], of[:1, :2]) and np.array_equal(of[1, 4], of[1, 0])
    assert np.array_equal(of[0, 2], of[1, 0])  # the gap
