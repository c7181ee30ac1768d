"""The live page: driven in a real browser by the mouse, and its loop from Python."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull import _core
from vffnull.errors import InputError, InputTypeError, ScenarioError

STILL = {"obstacles.0.motion": None, "obstacles.0.position": [3.0, 2.9]}
"""The scene of the page with its disc at rest above the arm."""
WEBGL = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def scene() -> vff.Scenario:
    return vff.Scenario.load("swing").replace(**STILL)


def wait_for(condition: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen in time"
        time.sleep(0.02)


# ------------------------------------------------------------------------------------------------- the loop


@pytest.fixture
def loop() -> Iterator[_core.Live]:
    live = _core.Live(scene())
    live.start()
    yield live
    live.stop()


def test_the_loop_keeps_the_clock_and_obeys(loop: _core.Live) -> None:
    """About as many periods as milliseconds, whatever Python does; pause, reset, settings, obstacles."""
    start, before = time.monotonic(), loop.snapshot()["periods"]
    while time.monotonic() < start + 1.0:
        sum(range(1000))  # holds the GIL
    passed = time.monotonic() - start
    assert loop.snapshot()["periods"] - before == pytest.approx(1000 * passed, rel=0.2)
    loop.pause()
    t = loop.snapshot()["t"]
    time.sleep(0.05)
    assert loop.snapshot()["t"] == t and loop.snapshot()["status"] == "paused"
    loop.start()
    wait_for(lambda: loop.snapshot()["t"] > t)
    loop.add(vff.Obstacle.circle([0.0, 4.0], radius=0.1))
    loop.carry(1, [1.0, 4.0])
    wait_for(lambda: np.allclose(loop.snapshot()["obstacles"][1], [1.0, 4.0], atol=1e-6))
    loop.remove(1)
    assert loop.snapshot()["obstacles"].shape == (1, 2)
    loop.aim([4.0, 2.0])
    wait_for(lambda: np.allclose(loop.snapshot()["x"], [4.0, 2.0], atol=1e-4))
    loop.reset()
    assert loop.snapshot()["t"] < t + 0.5


def test_the_shown_forces_are_the_forces_of_the_field(loop: _core.Live) -> None:
    """F at the shown points makes the torque of the field, Σ JᵀF = τ_vff (T26), with one obstacle exactly."""
    loop.carry(0, [3.0, 1.2])
    wait_for(lambda: np.abs(loop.snapshot()["tau_vff"]).max() > 1.0)
    state = loop.snapshot()
    joints = scene().arm.forward_kinematics(state["q"])
    lever = state["points"][None] - joints[:-1, None]
    moments = lever[..., 0] * state["forces"][:, 1] - lever[..., 1] * state["forces"][:, 0]
    torque = np.triu(moments).sum(axis=1)  # a joint feels the links behind it
    np.testing.assert_allclose(torque, state["tau_vff"], atol=1e-12 * np.abs(state["tau_vff"]).max())


def test_the_loop_refuses(loop: _core.Live) -> None:
    with pytest.raises(ScenarioError, match=r"obstacles\[7\]: there is none"):
        loop.carry(7, [0, 0])
    with pytest.raises(ScenarioError, match=r"controller\.stiffness"):
        loop.configure({"stiffness": -1.0})
    with pytest.raises(ScenarioError, match=r"controller\.task"):
        loop.configure({"task": "pose"})
    with pytest.raises(ScenarioError, match=r"obstacle\.shape"):
        loop.add({"shape": {"kind": "circle", "radius": -1.0}})
    with pytest.raises(InputError, match="place"):
        loop.aim([np.nan, 0.0])
    assert loop.snapshot()["status"] == "running"


def test_a_loop_that_diverges_says_so_and_can_be_reset(loop: _core.Live) -> None:
    settings = scene().to_dict()["controller"]
    loop.configure(settings | {"stiffness": 1e9, "damping": 1e5})
    loop.aim([4.0, 2.0])
    wait_for(lambda: loop.snapshot()["status"] == "diverged")
    assert loop.snapshot()["message"] and np.all(np.isfinite(loop.snapshot()["q"]))
    loop.configure(settings)
    loop.reset()
    wait_for(lambda: loop.snapshot()["t"] > 0.1)
    assert loop.snapshot()["status"] == "running"


def test_live_refuses(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="port: must be from 1024"):
        vff.live(port=80)
    with pytest.raises(InputTypeError, match="port"):
        vff.live(port="8080")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="there is no folder"):
        vff.live(record_to=tmp_path / "nowhere")
    with pytest.raises(ScenarioError):
        vff.live("swimg")


# ------------------------------------------------------------------------------------------------- the page


def test_a_page_changes_its_scene(tmp_path: Path) -> None:
    """Other scenarios, more and fewer obstacles, other settings: the loop runs what the page shows."""
    page = vff.live(scene(), open_browser=False, block=False, record_to=tmp_path)
    try:
        for name in ("crowd", "paper-2", "on-path"):
            page.open(vff.Scenario.load(name))
            count = len(page.snapshot()["obstacles"])
            for _ in range(3):
                page.add_obstacle()
            assert page.snapshot()["obstacles"].shape == (count + 3, 2)
            page.remove_obstacle()
            assert len(page.snapshot()["obstacles"]) == count + 2
            page.configure(page.scenario.to_dict()["controller"] | {"stiffness": 50.0})
            path = page.start_recording()
            wait_for(lambda: page.snapshot()["t"] > 0.3)
            page.reset()  # ends the recording
            assert len(page.snapshot()["obstacles"]) == count
            assert len(vff.StreamRecorder.read(path)) > 0
        for _ in range(count + 1):
            page.remove_obstacle()
        assert (
            page.snapshot()["min_clearance"] < np.inf and not np.isfinite(page.snapshot()["clearance"]).any()
        )
        frames = page.frame_rate
        wait_for(lambda: page.frame_rate != frames)  # it still draws
    finally:
        page.stop()


@pytest.fixture
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api")
    executable = shutil.which("chromium")
    if executable is None:
        if os.environ.get("CI"):
            pytest.fail("there is no chromium; install Debian's package of that name")
        pytest.skip("there is no chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=WEBGL)
        yield browser
        browser.close()


class Visitor:
    """Somebody in front of the page, with a mouse."""

    def __init__(self, browser: Any, page: Any) -> None:
        self.page = page
        self.tab = browser.new_page(viewport={"width": 1200, "height": 600}, device_scale_factor=0.5)
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.tab.on("request", lambda request: self.requests.append(request.url))
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.goto(page.url)
        self.tab.wait_for_selector("#vff-tip")
        self.tab.wait_for_timeout(1500)  # the panels take their places

    def pixel(self, place: tuple[float, float]) -> tuple[float, float]:
        """Where a point of the plane is on the screen, seen from above."""
        (client,) = self.page._server.get_clients().values()
        box = self.tab.locator("canvas").first.bounding_box()
        x, y, height = client.camera.position
        scale = box["height"] / 2 / (height * np.tan(client.camera.fov / 2))
        across = box["x"] + box["width"] / 2 + scale * (place[0] - x)
        return across, box["y"] + box["height"] / 2 - scale * (place[1] - y)

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        mouse = self.tab.mouse
        mouse.move(*self.pixel(start))
        mouse.down()
        for share in np.linspace(0.0, 1.0, 9)[1:]:
            x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
            mouse.move(*self.pixel((x, y)))
            self.tab.wait_for_timeout(60)
        mouse.up()

    def press(self, name: str) -> None:
        self.tab.get_by_role("button", name=name).first.click()


def test_a_visitor_drags_the_obstacle_into_the_arm(browser: Any, tmp_path: Path) -> None:
    """The links give way and the tip stays put; without projection it does not: all by mouse, in Chromium.

    The bounds: no contact, and less than a millimetre, ten times of what a torque held for a millisecond
    makes of it at the speed of a hand. Without projection the tip is pushed off by centimetres.
    """
    page = vff.live(scene(), open_browser=False, block=False, record_to=tmp_path)
    try:
        visitor = Visitor(browser, page)
        page.start_recording()  # pressing the button would bring up a message in the way of the mouse
        visitor.drag((3.0, 2.9), (3.0, 1.3))
        wait_for(lambda: abs(page.snapshot()["obstacles"][0, 1] - 1.3) < 0.1)
        wait_for(lambda: float(visitor.tab.text_content("#vff-clearance").split()[0]) < 1000)
        visitor.press("Stop recording")
        wait_for(lambda: not page.snapshot()["recording"])
        (file,) = tmp_path.glob("*.arrows")
        rows = vff.StreamRecorder.read(file).to_pandas()
        assert rows["obstacles_1_y"].iloc[0] == pytest.approx(2.9) and len(rows) > 100
        assert np.hypot(rows["error_x"], rows["error_y"]).max() < 1e-3
        assert rows.filter(like="clearance").min().min() > 0 and page.snapshot()["min_clearance"] > 0
        assert rows.filter(regex=r"^q_\d").apply(np.ptp).max() > 0.2, "the links did not give way"

        visitor.press("Null-space projection")
        wait_for(lambda: float(np.linalg.norm(page.snapshot()["error"])) > 0.02)
        wait_for(lambda: float(visitor.tab.text_content("#vff-tip").split()[0]) > 20)
        visitor.press("Null-space projection")
        wait_for(lambda: float(np.linalg.norm(page.snapshot()["error"])) < 1e-3)

        target = page.snapshot()["x_ref"]
        visitor.drag(tuple(target), (target[0] - 0.8, target[1] + 0.6))
        wait_for(lambda: float(np.linalg.norm(page.snapshot()["x"] - target)) > 0.8)
        visitor.press("Pause")
        wait_for(lambda: page.snapshot()["status"] == "paused")
        visitor.press("Reset")
        wait_for(lambda: page.snapshot()["status"] == "running")
        assert np.allclose(page.snapshot()["x_ref"], target)
        assert visitor.errors == []
        assert {url.split("/")[2] for url in visitor.requests if url.startswith("http")} == {
            page.url.split("/")[2]
        }
    finally:
        page.stop()
