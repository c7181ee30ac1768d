"""Links of the live page are dragged: a spring pulls at them, drawn with its force (docs/theory.md, T146)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from browsing import WEBGL, chromium, visit
from vffnull.evaluation.geometry.arm import rotation
from vffnull.live.scene.hands import Grip
from vffnull.live.stories import STORIES
from waiting import frames, wait_for

EYE = np.array([9.0, 0.0, 0.6])  # seen from the front
ELBOW = 3  # panda_link4
ASIDE, UP = np.array([0.0, 0.1, 0.0]), np.array([0.0, 0.5])


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Any]:
    page = vff.live(STORIES["Touch"].open(), open_browser=False, block=False, record_to=tmp_path)
    yield page
    page.stop()


def drag(page: Any, link: int | None, phase: str, start: Any, end: Any, client_id: int = 7) -> None:
    """What the browser tells of a drag, seen from the front."""
    client = SimpleNamespace(camera=SimpleNamespace(position=EYE))
    event = SimpleNamespace(
        phase=phase, client_id=client_id, client=client, start_position=tuple(start), end_position=tuple(end)
    )
    page._scene._drag(event, None, link)


def elbow(page: Any, q: Any = None) -> Any:
    arm = page.scenario.arm
    return arm.link_poses(page.snapshot()["q"] if q is None else q)[ELBOW, :3, 3]


def newtons(page: Any) -> float:
    return float(np.linalg.norm(page.snapshot()["pull_force"]))


def error(page: Any) -> float:
    return float(np.linalg.norm(page.snapshot()["error"][:3]))


def at_rest(page: Any) -> bool:
    return bool(np.abs(page.snapshot()["dq"]).max() < 2e-3)


def test_the_elbow_is_pulled_and_the_hand_stays(page: Any, tmp_path: Path) -> None:
    """Both arms by the same way; a line goes from the link to where it is pulled; let go, it comes back."""
    frames(page)
    page.start_recording()
    drawing, before = page._scene, elbow(page)
    assert page.snapshot()["pull_point"].shape == (0, 3) and not drawing._spring._line.visible
    way = np.array([0.0, 0.15, 0.0])
    drag(page, ELBOW, "start", before, before)
    drag(page, ELBOW, "update", before, before + way)
    wait_for(lambda: newtons(page) > 5.0)
    wait_for(lambda: at_rest(page) and elbow(page)[1] - before[1] > 0.03)
    frames(page)
    state = page.snapshot()
    assert error(page) < 1e-4, "the hand does not stay"
    np.testing.assert_allclose(state["pull_anchor"][0][1:], (before + way)[1:], atol=1e-3)
    np.testing.assert_allclose(state["pull_point"][0], elbow(page), atol=2e-3)
    line = drawing._spring._line
    assert line.visible and drawing._spring.arrow.visible
    np.testing.assert_allclose(line.points[0], [state["pull_point"][0], state["pull_anchor"][0]], atol=2e-3)
    shown = float(drawing._spring._label.text.removesuffix(" N"))
    assert shown == pytest.approx(newtons(page), abs=0.6) and shown > 5.0
    assert drawing._spring.arrow.scale[0] == pytest.approx(drawing._legend.length(shown), rel=0.1)
    assert page._ghost is not None
    np.testing.assert_allclose(page._ghost.snapshot()["pull_anchor"], state["pull_anchor"], atol=0.02)
    drag(page, ELBOW, "end", before, before + way)
    wait_for(lambda: np.linalg.norm(elbow(page) - before) < 5e-3)
    frames(page)
    assert newtons(page) == 0.0 and not line.visible and not drawing._spring.arrow.visible
    path, _ = page.stop_recording()
    told = vff.StreamRecorder.read(path).to_pandas().filter(regex=r"^tau_ext_\d")
    assert told.shape[1] == 7 and np.abs(told.to_numpy()).max() > 1.0 and np.all(told.iloc[-1] == 0.0)


def test_whoever_leaves_lets_go(page: Any) -> None:
    """A tab that is closed in the middle of a drag, another drag, another scene."""
    frames(page)
    place = elbow(page)
    drag(page, ELBOW, "start", place, place)
    drag(page, ELBOW, "update", place, place + ASIDE)
    wait_for(lambda: newtons(page) > 1.0)
    page._scene.leave(8)  # somebody else
    assert newtons(page) > 0.0
    page._scene.leave(7)
    assert newtons(page) == 0.0
    drag(page, ELBOW, "start", place, place)
    drag(page, ELBOW, "update", place, place + ASIDE)
    page.reset()
    assert newtons(page) == 0.0
    drag(page, ELBOW, "update", place, place + ASIDE)  # of the scene of before
    drag(page, ELBOW, "end", place, place + ASIDE)
    page.open(vff.Scenario.load("panda-sweep"))
    assert newtons(page) == 0.0 and page.snapshot()["status"] == "running"


def test_links_in_the_plane_are_held_where_nothing_else_is(tmp_path: Path) -> None:
    """The disc and the target come first; a link is held on itself, and its impedance is felt at the tip."""
    page = vff.live("swing", open_browser=False, block=False, record_to=tmp_path)
    try:
        frames(page)
        drawing = page._scene
        page.pause(True)
        frames(page)
        state = page.snapshot()
        joints = page.scenario.arm.forward_kinematics(state["q"])
        middle = 0.5 * (joints[2] + joints[3])
        held = drawing.grab(middle)
        assert isinstance(held, Grip) and held.link == 2
        assert drawing.grab(state["x_ref"][:2]).obstacle is None
        assert drawing.grab(state["obstacles"][0]).obstacle == 0
        origin, axes = drawing._frame(2)
        np.testing.assert_allclose(
            axes.T @ (middle - origin), [0.5 * page.scenario.arm.lengths[2], 0.0], atol=1e-9
        )
        page.pause(False)
        high = (*middle, 40.0)
        client = SimpleNamespace(camera=SimpleNamespace(position=np.array(high)))

        def tell(phase: str, end: Any) -> None:
            event = SimpleNamespace(
                phase=phase,
                client_id=7,
                client=client,
                start_position=(*middle, 0.0),
                end_position=(*end, 0.0),
            )
            drawing._drag(event, None)

        tell("start", middle)
        tell("update", middle + UP)
        wait_for(lambda: newtons(page) > 1.0)
        wait_for(lambda: drawing._spring._line.visible)
        tell("end", middle + UP)
        assert newtons(page) == 0.0
    finally:
        page.stop()


def test_wrenches_of_the_scenario_are_drawn(tmp_path: Path) -> None:
    """Their arrows end at the surface of the link that they push, as long as the legend says."""
    push = [{"link": "panda_link4", "force": [0.0, 20.0, 0.0]}, {"link": "tip", "force": [0.0, 0.0, -10.0]}]
    scenario = vff.Scenario.load("panda-lean").replace(wrenches=push)
    page = vff.live(scenario, open_browser=False, block=False, record_to=tmp_path)
    try:
        wait_for(lambda: at_rest(page) and page.snapshot()["t"] > 1.0)
        page.pause(True)
        frames(page, 5)
        drawing, state = page._scene, page.snapshot()
        assert len(drawing._wrenches) == 2
        for arrow, point, force in zip(
            drawing._wrenches, state["wrench_points"], state["wrench_forces"], strict=True
        ):
            size = float(np.linalg.norm(force))
            assert arrow.visible and arrow.scale[0] == pytest.approx(drawing._legend.length(size))
            along = rotation(np.asarray(arrow.wxyz)) @ [1.0, 0.0, 0.0]
            np.testing.assert_allclose(along, force / size, atol=1e-6)
            tip = np.asarray(arrow.position) + arrow.scale[0] * along
            np.testing.assert_allclose(np.cross(tip - point, along), 0.0, atol=1e-6)
            assert -0.2 < (tip - point) @ along <= 1e-9
    finally:
        page.stop()


def test_a_visitor_pulls_the_elbow(page: Any, tmp_path: Path) -> None:
    """By mouse in Chromium: the elbow is moved aside, the view stays, line and newtons are shown."""

    def settled(tab: Any) -> bool:
        clients = list(page._server.get_clients().values())
        box = tab.locator("canvas").first.bounding_box()
        if len(clients) != 1 or box is None or clients[0].camera.update_timestamp == 0.0:
            return False
        camera = clients[0].camera
        wanted = page._scene.camera(page._box(), camera.aspect)
        fits = abs(camera.aspect * box["height"] / box["width"] - 1) < 0.02
        return bool(fits and np.allclose(camera.position, wanted.position, rtol=0.01))

    with chromium(*WEBGL) as browser:
        seen = visit(browser, page.url, settled, (1200, 600))
        tab = seen.tab
        (client,) = page._server.get_clients().values()

        def pixel(place: Any) -> tuple[float, float]:
            camera, box = client.camera, tab.locator("canvas").first.bounding_box()
            ray = rotation(camera.wxyz).T @ (np.asarray(place) - camera.position)
            scale = box["height"] / 2 / np.tan(camera.fov / 2)
            return (
                box["x"] + box["width"] / 2 + scale * ray[0] / ray[2],
                box["y"] + box["height"] / 2 + scale * ray[1] / ray[2],
            )

        wait_for(lambda: page.snapshot()["t"] > 0.2)
        frames(page)
        before, camera = elbow(page), client.camera.position.copy()
        tab.mouse.move(*pixel(before))
        tab.mouse.down()
        for share in np.linspace(0.0, 1.0, 6)[1:]:
            tab.mouse.move(*pixel(before + share * np.array([-0.22, -0.2, 0.0])))  # along the picture
            tab.wait_for_timeout(60)
        wait_for(lambda: newtons(page) > 5.0)
        wait_for(lambda: at_rest(page) and elbow(page)[1] < before[1] - 0.02)
        assert error(page) < 1e-3
        np.testing.assert_allclose(client.camera.position, camera, atol=1e-6)
        wait_for(lambda: page._scene._spring._label.text.endswith(" N"))
        tab.wait_for_timeout(500)
        tab.screenshot(path=str(tmp_path / "pulled.png"))
        tab.mouse.up()
        wait_for(lambda: newtons(page) == 0.0)
        wait_for(lambda: np.linalg.norm(elbow(page) - before) < 0.01)
        assert seen.errors == []
