"""The live page in space: what is drawn and dragged, the cup, the tasks, and a visitor with a mouse."""

from __future__ import annotations

import time
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import vffnull as vff
from browsing import WEBGL, chromium, visit
from vffnull.errors import InputError, ScenarioError
from vffnull.evaluation.geometry.arm import rotation
from vffnull.live.plots import turned_off
from vffnull.live.scene import meshes
from vffnull.live.scene.cup import SPILLS, Liquid
from vffnull.live.scene.space import VIEWS, carries, stays_level
from vffnull.live.tasks import TASKS, with_task
from vffnull.model.shape import core_in_space
from waiting import HANG, frames, obey, wait_for


def at(*place: float) -> Any:
    """A place, or a way [m]."""
    return np.array(place)


PLACE = at(-0.05, -0.5, 0.62)
EYE = at(9.0, 0.0, 0.6)  # seen from the front
STILL = {"obstacles.0.motion": None, "obstacles.0.position": PLACE.tolist()}
"""A Panda with a ball that waits beside its elbow, 0.32 m away."""
NEAR = 0.2  # m: well within the field of a ball that is to push, which begins at 0.25
SPATIAL = [name for name in vff.scenarios() if vff.Scenario.load(name).arm.dimension == 3]


def scene() -> vff.Scenario:
    return vff.Scenario.load("panda-sweep").replace(**STILL)


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Any]:
    page = vff.live(scene(), open_browser=False, block=False, record_to=tmp_path)
    yield page
    page.stop()


def error(page: Any) -> float:
    return float(np.linalg.norm(page.snapshot()["error"][:3]))


# ------------------------------------------------------------------------------------------------ the drawing


def volume(mesh: meshes.Mesh) -> float:
    """Of a closed surface that is anticlockwise seen from outside."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def closed(mesh: meshes.Mesh) -> bool:
    """Whether every edge has a triangle on either side."""
    merged, index = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    faces = faces[[len(set(face)) == 3 for face in faces.tolist()]]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    there = {tuple(edge) for edge in edges.tolist()}
    return len(merged) > 3 and all((b, a) in there for a, b in there)


def test_bodies_are_closed_surfaces_of_the_right_size() -> None:
    """Balls and capsules up to their facets, boxes and hulls exactly (SciPy), in any posture."""
    hull = pytest.importorskip("scipy.spatial").ConvexHull
    ball = meshes.solid(np.array([[1.0, 2.0, 3.0]]), 0.5)
    assert closed(ball) and volume(ball) == pytest.approx(np.pi / 6, rel=0.02)
    rod = meshes.solid(np.array([[1.0, 0.0, 0.0], [1.0, 2.0, 1.0]]), 0.3)
    exact = np.pi * 0.09 * np.sqrt(5) + 4 / 3 * np.pi * 0.027
    assert closed(rod) and volume(rod) == pytest.approx(exact, rel=0.02)
    away = np.linalg.norm(np.cross(rod.vertices - [1.0, 0.0, 0.0], [0.0, 2.0, 1.0]), axis=1) / np.sqrt(5)
    assert away.max() <= 0.3 + 1e-12
    shape = {"kind": "box", "size": [0.4, 0.6, 0.2]}
    rng = np.random.default_rng(5)
    for turn in (None, [0.5, 0.5, 0.5, 0.5], [0.9, 0.1, -0.3, 0.3]):
        box = meshes.solid(*core_in_space(shape, turn))
        assert closed(box) and volume(box) == pytest.approx(0.048, rel=1e-9)
    for _ in range(10):
        corners = rng.normal(size=(12, 3))
        body = meshes.solid(corners, 0.0)
        assert closed(body) and volume(body) == pytest.approx(hull(corners).volume, rel=0.01)
        rounded = meshes.solid(corners, 0.2)
        directions = rng.normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        wide = (directions @ corners.T).max(axis=1) + 0.2
        np.testing.assert_allclose((directions @ rounded.vertices.T).max(axis=1), wide, atol=2e-3)


@pytest.mark.parametrize("name", SPATIAL)
def test_what_is_drawn_is_where_the_core_has_it(name: str, tmp_path: Path) -> None:
    """Every bundled scenario in space runs on the page; the arm's parts are where forward kinematics says,
    the lines between nearest points are as long as the clearance of their links.
    """
    page = vff.live(name, open_browser=False, block=False, record_to=tmp_path)
    try:
        wait_for(lambda: page.snapshot()["t"] > 0.2)
        page.pause(True)
        wait_for(lambda: page.snapshot()["status"] == "paused")
        frames(page, 5)
        state, drawing = page.snapshot(), page._scene
        poses = page.scenario.arm.link_poses(state["q"])
        for node, pose in zip(drawing._nodes["arm"], poses, strict=True):
            np.testing.assert_allclose(node.position, pose[:3, 3], atol=3e-4)
            np.testing.assert_allclose(rotation(node.wxyz), pose[:3, :3], atol=1e-3)
        tip = page.scenario.arm.forward_kinematics(state["q"])[-1]
        np.testing.assert_allclose(drawing._tip.position, tip, atol=3e-4)
        for handle, place in zip(drawing._obstacles, state["obstacles"], strict=True):
            np.testing.assert_allclose(handle.position, place, atol=3e-4)
        lines = np.linalg.norm(np.diff(drawing._lines.points, axis=1)[:, 0], axis=1)
        presses = "force" in page.scenario.to_dict()["controller"].get("touch", {})
        # What a tip presses on counts as no distance.
        lines, clearance = (each[: len(lines) - presses] for each in (lines, state["clearance"]))
        shown = lines > 0
        assert shown.sum() >= 1
        np.testing.assert_allclose(lines[shown], clearance[shown], atol=1e-3)
        if clearance.min() > 1e-3:  # what touches has no line
            assert lines[shown].min() == pytest.approx(clearance.min(), abs=1e-3)
        assert page.snapshot()["status"] == "paused" and state["rate"] >= 0
    finally:
        page.stop()


def test_an_arm_of_a_urdf_that_hangs_is_shown_above_the_floor(tmp_path: Path) -> None:
    """With shapes that its file says nothing about replaced by lines, and its own base and tip."""
    text = vff.Arm.named("gen3").to_urdf()
    hanging = {"position": [0.3, 0.2, 1.6], "orientation": [0.0, 1.0, 0.0, 0.0]}
    arm = vff.Arm.from_urdf(text, mount=hanging, collision="none")
    ball = {"shape": {"kind": "sphere", "radius": 0.1}, "position": [0.3, -0.5, 1.0]}
    scenario = vff.Scenario(
        arm=arm,
        q0=[0.0, 0.5, 0.0, 1.8, 0.0, 0.8, 0.0],
        duration=1.0,
        reference={"kind": "setpoint"},
        controller={"stiffness": 400.0, "damping": 40.0},
        obstacles=[ball],
    )
    page = vff.live(scenario, open_browser=False, block=False, record_to=tmp_path)
    try:
        frames(page, 5)
        joints = arm.forward_kinematics(page.snapshot()["q"])
        assert (
            joints[:, 2].min() > page._scene._floor and page._scene.camera(page._box(), 1.0).position[2] > 0.5
        )
        np.testing.assert_allclose(page._scene._tip.position, joints[-1], atol=3e-4)
        assert [len(parts) for parts in page._scene._arms.links] == [1] * arm.n
    finally:
        page.stop()


def test_little_is_sent_of_what_rests(page: Any) -> None:
    """Not a message about an arm and a ball that do not move, and no mesh while they do."""
    frames(page, 5)
    assert all(max(arrow.scale) < 0.01 for arrow in page._scene._forces), "an arrow flashes up as it is made"
    sent: list[str] = []
    scene_api, queue = page._server.scene, page._server.scene._queue_scene_message
    scene_api._queue_scene_message = lambda message: (sent.append(type(message).__name__), queue(message))
    frames(page, 10)
    assert sent == []
    page._scene._move(0, np.array([-0.05, -0.25, 0.62]))
    wait_for(lambda: np.abs(page.snapshot()["dq"]).max() > 0.1)
    wait_for(lambda: not page._scene.waits)
    frames(page, 10)
    assert "SetPositionMessage" in sent and "SetOrientationMessage" in sent
    assert sum(name == "MeshMessage" for name in sent) == 1  # the shadow of what was dragged


# ------------------------------------------------------------------------------------------------------ hands


def drag(page: Any, hit: int | None, phase: str, start: Any, end: Any, eye: Any = EYE) -> None:
    """What the browser tells of a drag, by default seen from the front."""
    client = SimpleNamespace(camera=SimpleNamespace(position=np.array(eye)))
    event = SimpleNamespace(
        phase=phase, client_id=7, client=client, start_position=tuple(start), end_position=tuple(end)
    )
    page._scene._drag(event, hit)


@pytest.mark.parametrize("view", VIEWS)
def test_a_ball_goes_to_the_arm_where_it_is_seen_to_do_so(page: Any, view: str) -> None:
    """From wherever one looks: with the pointer over the elbow it is at the elbow, neither before nor behind
    it; far beside the arm it moves along the picture.
    """
    frames(page)
    page.pause(True)
    frames(page)
    page.look(view)
    eye = at(*page._scene.camera(page._box(), 0.84).position)
    elbow = page.scenario.arm.forward_kinematics(page.snapshot()["q"])[3]
    ahead = (PLACE - eye) / np.linalg.norm(PLACE - eye)

    def pointer(place: Any) -> Any:
        """Where the browser has the pointer that is over a place: on the picture through the ball."""
        return eye + (place - eye) * ((PLACE - eye) @ ahead) / ((place - eye) @ ahead)

    assert np.linalg.norm(pointer(elbow) - elbow) > 0.02
    drag(page, 0, "start", PLACE, PLACE, eye)
    drag(page, 0, "update", PLACE, pointer(elbow), eye)
    assert np.linalg.norm(page._scene._wanted[0] - elbow) < 0.1
    across = np.cross(ahead, [0.31, 0.59, 0.74])
    aside = pointer(elbow + 0.9 * across / np.linalg.norm(across))
    drag(page, 0, "end", PLACE, aside, eye)
    np.testing.assert_allclose(page._scene._wanted[0], aside, atol=1e-6)


def test_a_dragged_ball_pushes_the_elbow_aside_and_the_hand_stays(page: Any) -> None:
    """Seen from behind, where the elbow is what the pointer comes over. Taken hold of at its surface the ball
    moves by as much as the pointer, as the picture shows it: how deep into it depends on where the arm is
    just then. The other arm loses its hand.
    """
    frames(page)
    eye = at(-9.0, 0.0, 0.6)
    grip = PLACE + at(0.0, 0.08, 0.0)
    move = -0.7 * at(PLACE[0], PLACE[1], 0.0)  # towards the base's axis
    before = page.snapshot()["q"]
    drag(page, 0, "start", grip, grip, eye)
    drag(page, 0, "update", grip, grip + move, eye)
    wait_for(lambda: 0 in page._scene._shadows or not page._scene.waits)
    drag(page, 0, "end", grip, grip + move, eye)
    sight = (grip + move - eye) / np.linalg.norm(grip + move - eye)

    def beside() -> float:
        return float(np.linalg.norm(np.cross(page.snapshot()["obstacles"][0] - PLACE - move, sight)))

    wait_for(lambda: beside() < 0.02)
    wait_for(lambda: np.abs(page.snapshot()["q"] - before).max() > 0.1)
    wait_for(lambda: np.abs(page.snapshot()["dq"]).max() < 1e-3)
    assert page._scene._hint is None, "it still says that the ball can be dragged"
    assert error(page) < 1e-3 and page.snapshot()["min_clearance"] > 0.0
    assert page._ghost is not None
    wait_for(lambda: np.linalg.norm(page._ghost.snapshot()["error"]) > 0.02)
    wait_for(lambda: not page._scene._shadows)


def test_a_target_is_dragged_with_its_orientation_kept(page: Any) -> None:
    frames(page)
    start = page.snapshot()["x_ref"].copy()
    drag(page, None, "start", start[:3], start[:3])
    drag(page, None, "update", start[:3], start[:3] + at(0.1, 0.1, 0.05))
    drag(page, None, "end", start[:3], start[:3] + at(0.1, 0.1, 0.05))
    wait_for(lambda: np.allclose(page.snapshot()["x"][:3], start[:3] + at(0.1, 0.1, 0.05), atol=1e-3))
    assert np.allclose(np.abs(page.snapshot()["x"][3:] @ start[3:]), 1.0, atol=1e-6)
    far = start[:3] + at(3.0, 0.0, 0.0)  # beyond the reach: as near as it can
    drag(page, None, "start", start[:3], start[:3])
    drag(page, None, "end", start[:3], far)
    wait_for(lambda: page.snapshot()["x"][0] > 0.5)
    assert page.snapshot()["status"] == "running" and np.linalg.norm(page.snapshot()["x"][:3]) < 1.1


def test_a_gizmo_comes_by_a_click_moves_the_ball_and_goes(page: Any) -> None:
    frames(page)
    drawing = page._scene
    assert drawing._gizmo is None
    drawing._clicked(0, None)
    gizmo = drawing._gizmo
    np.testing.assert_allclose(gizmo.position, PLACE, atol=1e-6)
    wanted = PLACE + at(0.0, 0.0, 0.2)
    gizmo.position = wanted  # as viser does when somebody pulls at it
    (told,) = gizmo._impl_aux.update_cb
    obey(told(SimpleNamespace(target=gizmo, phase="update")))
    wait_for(lambda: np.allclose(page.snapshot()["obstacles"][0], wanted, atol=1e-3))
    grip = page.snapshot()["obstacles"][0]
    drag(page, 0, "start", grip, grip)
    drag(page, 0, "end", grip, grip + at(0.0, 0.0, 0.1))
    np.testing.assert_allclose(gizmo.position, wanted + at(0.0, 0.0, 0.1), atol=5e-3)
    drawing._clicked(0, None)
    assert drawing._gizmo is None
    drawing._toggle(None)
    np.testing.assert_allclose(drawing._gizmo.position, page.snapshot()["x_ref"][:3], atol=1e-3)
    page.remove_obstacle()
    assert drawing._gizmo is None


def turned(axis: Any, angle: float, first: Any = (1.0, 0.0, 0.0, 0.0)) -> Any:
    """The orientation (4,) after a turn about an axis in the world."""
    half = Rotation.from_rotvec(angle * np.asarray(axis)) * Rotation.from_quat(first, scalar_first=True)
    return half.as_quat(scalar_first=True)


def apart(one: Any, other: Any) -> float:
    """The angle between two orientations [rad]."""
    return 2.0 * float(np.arccos(min(1.0, abs(np.dot(one, other)))))


def test_a_gizmo_turns_the_hand_and_the_bar(tmp_path: Path) -> None:
    """The hand turns and stays where it is; the bar turns from the orientation of the scenario."""
    start = turned((0.0, 1.0, 0.0), 0.5)
    bar = {
        "shape": {"kind": "box", "size": [0.1, 0.1, 0.4]},
        "position": PLACE.tolist(),
        "orientation": start.tolist(),
    }
    page = vff.live(scene().replace(obstacles=[bar]), open_browser=False, block=False, record_to=tmp_path)
    try:
        frames(page)
        drawing = page._scene
        before = page.snapshot()
        drawing._toggle(None)
        np.testing.assert_allclose(apart(drawing._gizmo.wxyz, before["x_ref"][3:]), 0.0, atol=1e-4)
        wanted = turned((0.0, 0.0, 1.0), 0.4, before["x_ref"][3:])

        def pull(wxyz: Any) -> None:
            drawing._gizmo.wxyz = wxyz  # as viser does when somebody pulls at it
            (told,) = drawing._gizmo._impl_aux.update_cb
            obey(told(SimpleNamespace(target=drawing._gizmo, phase="update")))

        pull(wanted)
        wait_for(lambda: apart(page.snapshot()["x_ref"][3:], wanted) < 1e-5)
        wait_for(lambda: apart(page.snapshot()["x"][3:], wanted) < 1e-3)
        np.testing.assert_allclose(page.snapshot()["x"][:3], before["x"][:3], atol=1e-4)

        drawing._toggle(0)
        assert apart(drawing._gizmo.wxyz, (1.0, 0.0, 0.0, 0.0)) < 1e-6
        turn = turned((1.0, 0.0, 0.0), 1.0)
        pull(turn)
        expected = Rotation.from_quat(turn, scalar_first=True).as_matrix()
        wait_for(lambda: np.allclose(page.snapshot()["turns"][0], expected, atol=1e-9))
        frames(page)
        assert apart(drawing._obstacles[0].wxyz, turn) < 1e-3
        state = page.snapshot()
        standing = bar | {"orientation": turned((1.0, 0.0, 0.0), 1.0, start).tolist()}
        found = vff.distances(page.scenario.arm, state["q"], state["dq"], [standing]).distance.min()
        assert state["clearance"].min() == pytest.approx(found, abs=1e-6)
    finally:
        page.stop()


def test_a_cloud_gets_other_points_while_the_loop_runs(tmp_path: Path) -> None:
    """What the core measures and what is drawn are those points; what is none leaves the ones of before."""
    first = np.random.default_rng(3).uniform(-0.1, 0.1, (500, 3))
    far = vff.Obstacle.points(first, 0.01, position=PLACE + at(0.0, -1.0, 0.0))
    page = vff.live(scene().replace(obstacles=[far]), open_browser=False, block=False, record_to=tmp_path)
    try:
        frames(page)
        near = first[:300] + at(0.0, 0.9, 0.0)
        page.update_points(near)
        frames(page)
        np.testing.assert_allclose(page._scene._obstacles[0].points, near, atol=1e-6)
        state = page.snapshot()
        cloud = vff.Obstacle.points(near, 0.01, position=PLACE + at(0.0, -1.0, 0.0))
        found = vff.distances(page.scenario.arm, state["q"], state["dq"], [cloud]).distance.min()
        assert state["clearance"].min() == pytest.approx(found, abs=1e-9)
        with pytest.raises(InputError, match="finite"):
            page.update_points([[np.nan, 0.0, 0.0]])
        with pytest.raises(InputError, match="there is one, number 0"):
            page.update_points(near, 1)
        assert len(page._scene._obstacles[0].points) == 300
    finally:
        page.stop()


def test_what_cannot_be_turned_says_so() -> None:
    """In the plane, for a task of position, with what is no orientation, and where there is nothing."""
    space, plane = vff._core.Live(scene()), vff._core.Live("swing")
    level = vff._core.Live(scene().replace(**{"controller.task": "position"}))
    quarter = turned((0.0, 0.0, 1.0), np.pi / 2)
    with pytest.raises(ScenarioError, match="there is none, only 1"):
        space.turn(3, quarter)
    with pytest.raises(InputError, match="norm must be 1"):
        space.turn(0, [1.0, 1.0, 0.0, 0.0])
    with pytest.raises(ScenarioError, match="in the plane nobody turns it"):
        plane.turn(0, quarter)
    for live in (plane, level):
        with pytest.raises(ScenarioError, match="the task has no orientation in space"):
            live.turn_target(quarter)


def test_a_table_is_moved_by_a_gizmo_where_it_is_clicked(tmp_path: Path) -> None:
    """It catches no drags, so that the view can be turned; it goes up by as much as the gizmo does."""
    page = vff.live("gen3-circle", open_browser=False, block=False, record_to=tmp_path)
    try:
        frames(page)
        drawing = page._scene
        assert not drawing._obstacles[0]._impl.drag_cb and drawing._obstacles[1]._impl.drag_cb
        ball = page.snapshot()["obstacles"][1]
        assert np.linalg.norm(drawing._hint.position[:2] - ball[:2]) < 0.05, (
            "it does not say what can be dragged"
        )
        assert drawing._floor == -0.05
        down = SimpleNamespace(ray_origin=(0.6, 0.2, 1.0), ray_direction=(0.0, 0.0, -1.0))
        drawing._clicked(0, down)
        np.testing.assert_allclose(drawing._gizmo.position, at(0.6, 0.2, -0.05), atol=1e-6)
        drawing._gizmo.position = at(0.6, 0.2, -0.15)
        (told,) = drawing._gizmo._impl_aux.update_cb
        obey(told(SimpleNamespace(target=drawing._gizmo, phase="update")))
        wait_for(lambda: np.allclose(page.snapshot()["obstacles"][0], at(0.0, 0.0, -0.15), atol=1e-3))
    finally:
        page.stop()


def test_a_ball_that_flies_off_comes_back_within_sight(tmp_path: Path) -> None:
    """Whoever looks up after it has passed can still drag it."""
    quick = {"obstacles.0.motion": {"kind": "linear", "velocity": [0.0, 4.0, 0.0]}}
    page = vff.live(scene().replace(**quick), open_browser=False, block=False, record_to=tmp_path)
    try:
        wait_for(lambda: page.snapshot()["obstacles"][0, 1] > 1.4)
        wait_for(lambda: 0.4 < np.linalg.norm(page.snapshot()["obstacles"][0]) < 1.0)
        assert page._dragged is False
    finally:
        page.stop()


# -------------------------------------------------------------------------------------------- tasks and knobs


def test_another_task_begins_anew_with_the_present_settings(page: Any) -> None:
    """Position, pointing and pose; who asks for what cannot be done is told, and the page stays as it is."""
    panel = page._panel
    panel._sliders["damping"].value = 50.0
    panel._changed(panel._sliders["damping"])
    for task, size, words in (("position", 3, 1), ("pointing", 5, 2), ("pose", 6, 2)):
        panel._ask(task)
        assert (
            page.snapshot()["error"].shape == (size,)
            and page.scenario.to_dict()["controller"]["damping"] == 50
        )
        assert panel._task.value == task and panel._task.visible
        wait_for(lambda size=size: page.shown.get("error", np.zeros(0)).shape == (size,))
        wait_for(
            lambda words=words: sum(w in panel._numbers.content for w in ("vff-tip", "vff-angle")) == words
        )
        assert (page._scene._cup is None) == (task == "position")
    with pytest.raises(ScenarioError, match=r"controller\.task"):
        panel._ask("dance")
    assert panel._task.value == "pose" and page.snapshot()["status"] == "running"
    page.open(vff.Scenario.load("swing"))
    assert not panel._task.visible and panel._view.visible and not panel._views.visible
    page.open(scene())
    assert (
        panel._views.visible and tuple(panel._views.options) == tuple(page.views) and not panel._view.visible
    )


@pytest.mark.parametrize("name", SPATIAL)
@pytest.mark.parametrize("task", TASKS)
def test_every_scenario_can_have_every_task(name: str, task: str) -> None:
    """Gains per axis included; only a position forgets the orientations of its reference."""
    scenario = vff.Scenario.load(name)
    settings = scenario.to_dict()["controller"]
    changed = with_task(scenario, settings | {"stiffness": [900.0, 800.0, 700.0]}, task)
    assert (
        len(changed.to_dict()["controller"]["stiffness"]) == {"position": 3, "pointing": 5, "pose": 6}[task]
    )
    kept = "orientation" in changed.to_dict()["reference"]
    assert kept == ("orientation" in scenario.to_dict()["reference"] and task != "position")
    live = vff._core.Live(changed.to_dict())
    assert live.snapshot()["status"] == "running"


def test_the_look_ahead_is_a_switch_of_the_barriers(page: Any) -> None:
    panel = page._panel
    assert not panel._ahead.visible
    panel._avoidance.value = "by barriers (QP)"
    panel._changed(panel._avoidance)
    assert panel._ahead.visible and not panel._ahead.value
    panel._ahead.value = True
    panel._changed(panel._ahead)
    assert panel._settings["yielding"]["preview"] == {} and page.snapshot()["status"] == "running"
    panel._ahead.value = False
    panel._changed(panel._ahead)
    assert "preview" not in panel._settings["yielding"]
    panel._avoidance.value = "the links only"
    panel._changed(panel._avoidance)
    assert not panel._ahead.visible


def test_obstacles_come_and_go_and_recordings_are_spatial(page: Any) -> None:
    page.add_obstacle()
    page.add_obstacle()
    assert page.snapshot()["obstacles"].shape == (3, 3)
    clearances = page.snapshot()["clearance"]
    assert clearances.min() > 0.0, "what is added is in the arm"
    page.remove_obstacle()
    path = page.start_recording()
    start = page.snapshot()["t"]
    wait_for(lambda: page.snapshot()["t"] > start + 0.3)
    page.stop_recording()
    rows = vff.StreamRecorder.read(path).to_pandas()
    assert len(rows) >= 20 and {"x_z", "obstacles_1_z", "q_6"} <= set(rows.columns)
    assert len(rows.filter(like="orientation").columns) >= 4
    for _ in range(2):
        page.remove_obstacle()
    frames(page)
    assert not page._scene._distance.visible and not np.diff(page._scene._lines.points, axis=1).any()
    page.reset()
    assert page.snapshot()["obstacles"].shape == (1, 3)


def test_the_angle_off_is_that_between_the_orientations() -> None:
    """Of a pose the whole turn, of a pointing task only that of the tool's axis; a position has none."""
    half = 0.15
    turn_x, turn_z = (
        np.array([np.cos(half), np.sin(half), 0, 0]),
        np.array([np.cos(half), 0, 0, np.sin(half)]),
    )
    here, one = np.zeros(3), np.array([1.0, 0, 0, 0])
    for size, turn, angle in (
        (6, turn_x, 0.3),
        (6, -turn_x, 0.3),
        (6, turn_z, 0.3),
        (5, turn_x, 0.3),
        (5, turn_z, 0.0),
    ):
        state = {
            "obstacles": np.zeros((0, 3)),
            "error": np.zeros(size),
            "x": np.r_[here, turn],
            "x_ref": np.r_[here, one],
        }
        assert turned_off(state) == pytest.approx(angle, abs=1e-12)
    state = {"obstacles": np.zeros((0, 3)), "error": np.zeros(3), "x": here, "x_ref": here}
    assert np.isnan(turned_off(state))


# ---------------------------------------------------------------------------------------------------- the cup


def up(tilt: float, heading: float = 0.7) -> Any:
    return np.array([np.sin(tilt) * np.cos(heading), np.sin(tilt) * np.sin(heading), np.cos(tilt)])


def test_the_liquid_is_level_and_runs_over_beyond_the_stated_angle() -> None:
    """Its surface is orthogonal to the vertical, never above the rim, and what is lost stays lost."""
    liquid = Liquid(0.04, 0.1)
    for tilt in np.linspace(0.0, SPILLS - 1e-9, 7):
        slope = liquid.turn(up(float(tilt)))
        for across in ([1.0, 0.0], [0.0, 1.0]):
            assert np.r_[across, slope @ across] @ up(float(tilt)) == pytest.approx(0.0, abs=1e-12)
        assert liquid.tilt == pytest.approx(tilt, abs=1e-12) and liquid.spilt == pytest.approx(0.0, abs=1e-6)
    liquid.turn(up(1.2 * SPILLS))
    lost = liquid.spilt
    assert 0.0 < lost < 0.2
    assert liquid.level + 0.04 * np.tan(1.2 * SPILLS) == pytest.approx(0.1)
    liquid.turn(up(0.0))
    assert liquid.spilt == lost
    liquid.turn(up(1.4))
    assert liquid.spilt == 1.0 and liquid.level == 0.0
    liquid.turn(up(3.0))
    assert liquid.spilt == 1.0


@pytest.mark.parametrize("tilt", [0.0, 0.4, 0.99])
def test_the_drawn_surface_is_plane_and_horizontal(page: Any, tilt: float) -> None:
    """The rim of the wedge is where a horizontal plane meets the wall of the tilted cup, on a cylinder."""
    page.pause(True)
    frames(page)
    cup = page._scene._cup
    full = cup.liquid.level
    c, s = np.cos(tilt * SPILLS), np.sin(tilt * SPILLS)
    hand = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ cup._turn.T
    cup.follow(hand)

    def places(part: Any) -> Any:
        """Its vertices in the cup's frame."""
        return part.vertices * part.scale @ rotation(part.wxyz).T + part.position

    wedge = cup._above.vertices
    surface = places(cup._above)[np.isclose(wedge[:, 2], 1.0 + wedge[:, 0], atol=1e-6) & (wedge[:, 2] > 0.0)]
    heights = (surface @ (hand @ cup._turn).T)[:, 2]
    assert len(surface) > 30 and np.ptp(heights) < 1e-3
    assert np.hypot(surface[:, 0], surface[:, 1]).max() == pytest.approx(cup.liquid.radius, abs=1e-6)
    assert surface[:, 2].max() <= cup.liquid.height + cup._bottom + 3e-4
    assert surface[:, 2].mean() == pytest.approx(full + cup._bottom, abs=1e-3), "something is lost"
    assert places(cup._below)[:, 2].max() == pytest.approx(places(cup._above)[:, 2].min(), abs=3e-4)
    assert places(cup._below)[:, 2].min() == pytest.approx(cup._bottom, abs=1e-6)


def test_a_cup_is_given_to_hands_that_are_to_keep_it_level() -> None:
    assert stays_level({"kind": "setpoint"}) and stays_level({"kind": "line", "end": [0, 0, 0]})
    assert not stays_level({"kind": "line", "orientation": [1, 0, 0, 0]})
    assert not stays_level({"kind": "circle", "turning": True})
    assert carries(np.diag([1.0, -1.0, -1.0])) and not carries(rotation([0.9, 0.3, 0.1, 0.3]))


def test_the_cup_is_spilt_without_the_projection_and_full_after_a_reset(page: Any) -> None:
    """The read-out says so; with the projection nothing was spilt (see the drag above)."""
    page.show_ghost(False)
    page.configure(page.scenario.to_dict()["controller"] | {"projection": "none"})
    beside = at(-0.05, 0.6, 0.62)
    page._carry(0, beside)

    def spilt() -> bool:
        """Through the elbow, to and fro: one tilt may be over between two pictures."""
        ball = page.snapshot()["obstacles"][0]
        for here, there in ((beside, PLACE), (PLACE, beside)):
            if np.linalg.norm(ball - here) < 0.02:
                page._carry(0, there)
        return bool(page._scene.readings()["spilt"] > 0.02)

    wait_for(spilt)
    wait_for(lambda: "spilt" in page._panel._numbers.content)
    page.reset()
    assert page._scene.readings()["spilt"] == 0.0


# ---------------------------------------------------------------------------------------------------- cameras


@pytest.mark.parametrize("aspect", [390 / 844, 602 / 720, 1.6])
@pytest.mark.parametrize("view", VIEWS)
def test_every_view_sees_the_arm_and_its_obstacles(page: Any, view: str, aspect: float) -> None:
    """Within the picture, and above the controls of a phone; the camera is above the floor."""
    page.look(view)
    camera = page._scene.camera(page._box(), aspect)
    ahead = np.array(camera.look_at) - camera.position
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, camera.up)
    right /= np.linalg.norm(right)
    above = np.cross(right, ahead)
    joints = page.scenario.arm.forward_kinematics(page.snapshot()["q"])
    for place in [*joints, *page.snapshot()["obstacles"]]:
        seen = place - np.array(camera.position)
        depth = seen @ ahead
        slope = np.tan(camera.fov / 2)
        assert depth > 0 and abs(seen @ above) < slope * depth and abs(seen @ right) < slope * aspect * depth
        assert seen @ above > (0.2 if aspect < 0.6 else -1.0) * slope * depth, "a phone's controls cover it"
    assert camera.position[2] > 0.3


# -------------------------------------------------------------------------------------------------- a visitor


def test_a_visitor_drags_the_ball_into_the_elbow(tmp_path: Path) -> None:
    """By mouse in Chromium: something is drawn, the elbow gives way, the hand stays; and another scene."""
    from PIL import Image

    page = vff.live(scene(), open_browser=False, block=False, record_to=tmp_path)
    try:
        with chromium(*WEBGL) as browser:
            page.look("Front")  # dragging along this picture goes along y and z
            page.cast_shadows(False)  # half a minute of a software renderer

            def settled(tab: Any) -> bool:
                """Whether the picture has its size and the camera is where it belongs to it."""
                clients = list(page._server.get_clients().values())
                box = tab.locator("canvas").first.bounding_box()
                if len(clients) != 1 or box is None or clients[0].camera.update_timestamp == 0.0:
                    return False
                camera = clients[0].camera
                wanted = page._scene.camera(page._box(), camera.aspect)
                fits = abs(camera.aspect * box["height"] / box["width"] - 1) < 0.02
                return fits and np.allclose(camera.position, wanted.position, rtol=0.01)

            seen = visit(browser, page.url, settled, (1000, 450))
            tab = seen.tab
            canvas = tab.locator("canvas").first

            def pixel(place: Any) -> tuple[float, float]:
                """Where a place [m] is on the screen."""
                (client,) = page._server.get_clients().values()
                camera, box = client.camera, canvas.bounding_box()
                seen = rotation(camera.wxyz).T @ (np.asarray(place) - camera.position)
                scale = box["height"] / 2 / np.tan(camera.fov / 2)
                return (
                    box["x"] + box["width"] / 2 + scale * seen[0] / seen[2],
                    box["y"] + box["height"] / 2 + scale * seen[1] / seen[2],
                )

            def darkness(place: Any) -> float:
                """How dark the picture is there, from 0 to 1."""
                box, (x, y) = canvas.bounding_box(), pixel(place)
                shown = tab.screenshot(clip={"x": x - 4, "y": y - 4, "width": 8, "height": 8})
                assert box["x"] < x < box["x"] + box["width"]
                return 1.0 - float(np.asarray(Image.open(BytesIO(shown)).convert("L")).mean()) / 255

            def uncover() -> None:
                """Close what is said about software renderers: it hides the ball."""
                # in one go: a note that goes away by itself between finding and closing it is waited for
                notes = "document.querySelectorAll('.mantine-Notification-closeButton')"
                tab.evaluate(f"{notes}.forEach(close => close.click())")

            wait_for(lambda: (uncover(), darkness(PLACE) > 0.5)[1])  # the ball
            assert darkness(at(0.0, 0.0, 0.05)) > 0.2  # the base
            assert darkness(PLACE + at(0.0, 0.0, -0.35)) < 0.15  # nothing
            before, end = page.snapshot()["q"], PLACE * at(0.3, 0.3, 1.0)
            tab.mouse.move(*pixel(PLACE))
            tab.mouse.down()
            for share in np.linspace(0.0, 1.0, 5)[1:]:
                tab.mouse.move(*pixel(PLACE + share * (end - PLACE)))
            wait_for(lambda: page._scene._held or page._scene._wanted or page._dragged)
            tab.mouse.up()
            # along the picture: its depth is the arm's
            wait_for(lambda: np.linalg.norm((page.snapshot()["obstacles"][0] - end)[1:]) < 0.1)
            wait_for(lambda: np.abs(page.snapshot()["q"] - before).max() > 0.1)
            assert error(page) < 1e-3 and page.snapshot()["min_clearance"] > 0.0
            wait_for(lambda: float(tab.text_content("#vff-clearance").split()[0]) < 250)
            for view in page.views:
                page.reset()
                page.look(view)
                wait_for(lambda: (tab.wait_for_timeout(100), settled(tab))[1])
                frames(page)
                end_of_time, tries = time.monotonic() + HANG, 0
                nearest = np.inf  # m, so far: the elbow gives way, how far depends on where the ball is
                while nearest >= NEAR:
                    assert time.monotonic() < end_of_time, f"the ball does not come to the elbow, {view}"
                    uncover()  # the note may come again, and lie on the ball
                    tries += 1
                    if tries % 5 == 0:  # the ball may lie behind a link, or the tab stand still
                        page.reset()
                        tab.set_viewport_size({"width": 1000, "height": 450 - tries // 5 % 2})
                        tab.wait_for_timeout(1000)
                    # On a busy machine the picture may lag behind the camera: a visitor tries again.
                    ball = page._scene._obstacles[0].position
                    elbow = page.scenario.arm.forward_kinematics(page.snapshot()["q"])[3]
                    x, y = pixel(elbow)
                    tab.mouse.move(*pixel(ball))
                    tab.mouse.down()
                    for aside in (60.0, 30.0, 0.0):
                        tab.mouse.move(x, y - aside)
                        tab.wait_for_timeout(100)
                    tab.mouse.up()
                    patience = time.monotonic() + 3.0
                    while nearest >= NEAR and time.monotonic() < patience:
                        nearest = min(nearest, page.snapshot()["clearance"].min())
                        tab.wait_for_timeout(20)
                wait_for(lambda: not page._scene._wanted)
            page.open(vff.Scenario.load("ur5e-sweep"))  # without a cup
            wait_for(lambda: seen.errors or tab.locator("#vff-angle").count() == 0)
            assert seen.errors == [] and tab.locator("#vff-tip").count() == 1
            assert seen.hosts() == {page.url.split("/")[2]}
    finally:
        page.stop()


SIZES = {"1280 × 720": (1280, 720), "narrow": (800, 600), "phone": (390, 844)}


@pytest.mark.parametrize("size", SIZES.values(), ids=SIZES)
def test_ball_and_hand_are_seen_between_the_panels(size: tuple[int, int], tmp_path: Path) -> None:
    """In the first picture, with nothing of the page on them; in a narrow window the plots make room."""
    page = vff.live(scene(), open_browser=False, block=False, record_to=tmp_path)
    try:
        with chromium(*WEBGL) as browser:
            page.cast_shadows(False)

            def settled(tab: Any) -> bool:
                clients = list(page._server.get_clients().values())
                if len(clients) != 1 or clients[0].camera.update_timestamp == 0.0:
                    return False
                box = tab.locator("canvas").first.bounding_box()
                if box["width"] <= 0.45 * size[0]:
                    return False  # the plots have not made room yet
                camera = clients[0].camera
                if not np.isclose(camera.aspect, box["width"] / box["height"], rtol=0.02):
                    return False  # of the picture before
                wanted = page._scene.camera(page._box(), camera.aspect)
                return bool(np.allclose(camera.position, wanted.position, rtol=0.01))

            tab = visit(browser, page.url, settled, size).tab
            notes = "document.querySelectorAll('.mantine-Notification-closeButton')"
            tab.evaluate(f"{notes}.forEach(close => close.click())")
            tab.wait_for_timeout(500)
            (client,) = page._server.get_clients().values()
            camera, box = client.camera, tab.locator("canvas").first.bounding_box()
            assert box["width"] > 0.45 * size[0]
            hand = page.scenario.arm.forward_kinematics(page.snapshot()["q"])[-1]
            for place in (PLACE, hand):
                seen = rotation(camera.wxyz).T @ (np.asarray(place) - camera.position)
                scale = box["height"] / 2 / np.tan(camera.fov / 2)
                x = box["x"] + box["width"] / 2 + scale * seen[0] / seen[2]
                y = box["y"] + box["height"] / 2 + scale * seen[1] / seen[2]
                over = tab.evaluate("([x, y]) => document.elementFromPoint(x, y)?.tagName", [x, y])
                assert over == "CANVAS", (place, x, y, over)
                assert 0 < x < size[0] and 0 < y < size[1]
    finally:
        page.stop()


def test_the_plots_say_what_their_axes_are(page: Any) -> None:
    """Quantity and unit of what goes up above each, and what goes to the right below it."""
    for handle in page._plots._handles:
        assert handle.title.endswith("]") and " [" in handle.title
        assert handle.axes[0]["label"] == "simulated time [s]" and handle.axes[0]["size"] > 20
        assert handle.axes[1]["size"] >= 60  # "100,000" is not cut off
