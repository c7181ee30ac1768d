"""Reports of runs in space: what is packed is where bodies are; the scene moves, turns, and looks right."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import vffnull as vff
from browsing import WEBGL, chromium
from vffnull.draw.scene import Scene
from vffnull.draw.shapes import Part
from vffnull.evaluation.geometry.arm import rotation
from waiting import HANG

HALF = float(np.sqrt(0.5))
OBSTACLES = [
    vff.Obstacle.box(
        [0.6, 0.3, 0.6], [0.2, 0.3, 0.1], orientation=[HALF, 0, 0, HALF], angular_velocity=[0.5, 1.0, 0.0]
    ),
    vff.Obstacle.capsule([0.0, -0.8, 0.2], [0.0, -0.8, 0.9], 0.05, motion=vff.Motion.linear([0.2, 0.0, 0.0])),
    vff.Obstacle.convex([[0.9, 0, 0], [1.1, 0, 0], [1.0, 0.2, 0], [1.0, 0.1, 0.3]]),
    vff.Obstacle.points([[-0.5, 0.1 * k, 0.4] for k in range(9)], 0.02),
    vff.Obstacle.half_space([0.0, 0.0, -0.1], [0.0, 0.0, 1.0]),
]  # fmt: skip


def runs_of(path: Path) -> list[dict[str, Any]]:
    """What the page's script gets."""
    found = re.search(r'id="motion"[^>]*>(.*?)</script>', path.read_text(encoding="utf-8"), re.DOTALL)
    assert found is not None
    runs: list[dict[str, Any]] = json.loads(found[1])
    return runs


def unpack(text: str, *shape: int) -> Any:
    return np.frombuffer(base64.b64decode(text), "<f4").reshape(-1, *shape).astype(float)


def corners_of(space: dict[str, Any], body: dict[str, Any], rows: int) -> Any:
    """Corners of a body in the world (T, ·, 3), from those in its frame and the frame's places and turns."""
    own = unpack(body["points"], 3)[None] if "points" in body else unpack(body["corners"], body["count"], 3)
    own = np.broadcast_to(own, (rows, *own.shape[1:]))
    if body["frame"] is None:
        return own
    frame = space["frames"][body["frame"]]
    place = np.broadcast_to(unpack(frame["place"], 3), (rows, 3))
    turn = np.broadcast_to(rotation(unpack(frame["turn"], 4)), (rows, 3, 3))
    return np.einsum("tij,tkj->tki", turn, own) + place[:, None]


def same_corners(found: Any, wanted: Any) -> None:
    np.testing.assert_allclose(found, np.broadcast_to(wanted, found.shape), rtol=0, atol=3e-7)


# ------------------------------------------------------------------------------------------ what is packed


def packed(result: vff.Result, tmp_path: Path) -> tuple[dict[str, Any], Scene, int]:
    """The packed scene, the same as primitives, and the number of instants."""
    (run,) = runs_of(result.report(tmp_path / "run.html"))
    t = unpack(run["t"])
    scene = Scene.of_result(result).pick(np.searchsorted(result.t, t - 1e-5))
    return run["space"], scene, len(t)


def links_are_where_they_are(space: dict[str, Any], scene: Scene, rows: int) -> None:
    links = [body for body in space["bodies"] if body["role"] in ("link", "base")]
    assert len(links) == len(scene.parts)
    for body, part in zip(links, scene.parts, strict=True):
        assert isinstance(part, Part)
        same_corners(corners_of(space, body, rows), part.corners)
        assert (body["index"], body["radius"]) == (part.index, part.radius)
        assert (part.corners.shape[1] > 2) == bool(body["faces"])


def test_everything_is_packed_where_it_is(tmp_path: Path) -> None:
    """Links, and obstacles of every kind, turning and moving ones among them; and no more than is needed."""
    scenario = vff.Scenario.load("panda-sweep").replace(
        **{"obstacles": OBSTACLES, "duration": 0.3, "simulation.record_every": 20}
    )
    result = vff.simulate(scenario)
    space, scene, rows = packed(result, tmp_path)
    links_are_where_they_are(space, scene, rows)
    found = {(body["role"], body["index"]): body for body in space["bodies"] if body["role"] != "link"}
    for index, role in enumerate(["obstacle", "obstacle", "obstacle", "obstacle", "surface"]):
        body = found[role, index]
        if index == 3:
            wanted = np.stack([scene.cloud(index, row) for row in range(rows)])  # type: ignore[misc]
        else:
            wanted = scene.solid(index)
        same_corners(corners_of(space, body, rows), wanted)
        assert (("halo", index) in found) == (index < 3)
    assert len(unpack(space["frames"][7]["turn"], 4)) == rows  # the box turns
    assert len(unpack(space["frames"][9]["turn"], 4)) == len(unpack(space["frames"][9]["place"], 3)) == 1
    assert all(
        len(unpack(body["corners"], body["count"], 3)) == 1 for body in space["bodies"] if "count" in body
    )
    box = found["obstacle", 0]
    corners, middle = corners_of(space, box, rows)[-1], corners_of(space, box, rows)[-1].mean(axis=0)
    for a, b, c in box["faces"]:  # anticlockwise from outside
        assert np.cross(corners[b] - corners[a], corners[c] - corners[a]) @ (corners[a] - middle) > 0.0
    assert len(box["faces"]) == 12
    np.testing.assert_allclose(rotation(unpack(space["tool"], 4)), scene.turns, atol=1e-6)


def test_points_of_sensors_are_no_curve_to_choose(tmp_path: Path) -> None:
    """They would be most of a page."""
    watched = vff.simulate("panda-watched", {"duration": 0.1})
    assert watched.sensed is not None
    (run,) = runs_of(watched.report(tmp_path / "watched.html"))
    names = [each["name"] for each in run["quantities"]]
    assert "sensed" not in names and "clearance" in names


def test_a_link_that_slides_is_packed_as_it_is(tmp_path: Path) -> None:
    """Of an arm without shapes, links are thin lines from joint to joint; one that slides becomes longer."""
    body = {"mass": 1.0, "com": [0.0, 0.0, 0.1], "inertia": [0.02, 0.02, 0.02, 0.0, 0.0, 0.0]}
    arm = {
        "joints": [
            {"name": "turn", "kind": "revolute", "position": [0, 0, 0.2], "axis": [0, 0, 1], **body},
            {"name": "tilt", "kind": "revolute", "position": [0, 0, 0.1], "axis": [0, 1, 0], **body},
            {"name": "slide", "kind": "prismatic", "position": [0, 0, 0.4], "axis": [0, 0, 1], **body},
            {"name": "wrist", "kind": "revolute", "position": [0, 0, 0.3], "axis": [0, 1, 0], **body},
        ],
        "tool": {"position": [0, 0, 0.2]},
        "gravity": [0, 0, 0],
    }
    document = {
        "arm": arm,
        "q0": [0.1, 0.8, 0.0, 0.5],
        "duration": 0.5,
        "controller": {"task": "position", "stiffness": 50.0, "damping": 14.0},
        "reference": {"kind": "line", "end": [0.1, 0.0, 0.1], "duration": 0.4, "relative": True},
    }
    result = vff.simulate(document)
    assert np.abs(result.q[-1, 2] - result.q[0, 2]) > 0.01
    space, scene, rows = packed(result, tmp_path)
    links_are_where_they_are(space, scene, rows)
    assert {body["frame"] for body in space["bodies"]} != {None}


# ---------------------------------------------------------------------------------------------- in a browser


class Tab:
    """A report in a browser; it waits as long as it takes."""

    def __init__(self, browser: Any, path: Path, width: int = 900, script: str = "", **how: Any) -> None:
        self.context = browser.new_context(viewport={"width": width, "height": 900}, **how)
        self.context.add_init_script(script)
        self.page = self.context.new_page()
        self.page.set_default_timeout(1000 * HANG)
        self.errors: list[str] = []
        self.requests: list[str] = []
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda told: told.type == "error" and self.errors.append(told.text))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready=yes]")
        self.page.locator("canvas.space").first.scroll_into_view_if_needed()

    def close(self) -> None:
        assert self.errors == []
        assert [url for url in self.requests if not url.startswith(("file:", "data:", "blob:"))] == []
        self.context.close()

    def seek(self, share: float) -> None:
        """Move the slider."""
        self.page.evaluate(
            "share => { const s = document.getElementById('slider');"
            "s.value = Number(s.min) + share * (s.max - s.min); s.dispatchEvent(new Event('input')) }",
            share,
        )
        self.rest()

    def rest(self) -> None:
        """Until everything asked for so far is drawn."""
        self.page.evaluate(
            "() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def look(self) -> dict[str, Any]:
        found: dict[str, Any] = self.page.evaluate("vffnullSpace.look")
        return found

    def picture(self) -> Any:
        """The canvas on white, in dots of the page, (h, w, 3)."""
        data = self.page.evaluate("document.querySelector('canvas.space').toDataURL().split(',')[1]")
        with Image.open(BytesIO(base64.b64decode(data))) as image:
            white = Image.new("RGBA", image.size, "white")
            return np.asarray(Image.alpha_composite(white, image.convert("RGBA")).convert("RGB"), dtype=int)

    def colours(self, *places: Any) -> Any:
        """Red, green, blue around where places [m] are seen."""
        picture = self.picture()
        seen = self.page.evaluate(
            "all => all.map(p => vffnullSpace.where(0, p))", [p.tolist() for p in places]
        )
        corners = [(round(y) - 2, round(x) - 2) for x, y in seen]
        return [picture[y : y + 5, x : x + 5].mean(axis=(0, 1)) for y, x in corners]


@pytest.fixture(scope="module")
def result() -> vff.Result:
    return vff.simulate("panda-sweep", {"simulation.record_every": 50})


@pytest.fixture(scope="module")
def path(result: vff.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return result.report(tmp_path_factory.mktemp("space") / "run.html")


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium(*WEBGL) as browser:
        yield browser


@contextmanager
def opened(browser: Any, path: Path, *given: Any, **how: Any) -> Iterator[Tab]:
    tab = Tab(browser, path, *given, **how)
    yield tab
    tab.close()


NO_WEBGL = """
    const given = HTMLCanvasElement.prototype.getContext
    HTMLCanvasElement.prototype.getContext = function (kind, ...how) {
        return kind.startsWith('webgl') ? null : given.call(this, kind, ...how)
    }"""


def is_dark(colour: Any) -> bool:
    return bool(np.max(colour) < 110)


def ball_is_drawn(tab: Tab, result: vff.Result, row: int) -> None:
    """Dark where the ball is seen, and not beside it: the picture is that of the instant and the camera."""
    azimuth = tab.look()["azimuth"]
    beside = 0.12 * np.array([np.sin(azimuth), -np.cos(azimuth), 0.0])
    here, there = tab.colours(result.obstacles[row, 0], result.obstacles[row, 0] + beside)
    assert is_dark(here) and not is_dark(there), (row, tab.look(), here, there)


def acts_like_a_scene(tab: Tab, result: vff.Result, kind: str) -> None:
    """It is in step with the slider, is turned by dragging, zoomed by the wheel, and goes to named views."""
    page = tab.page
    assert page.evaluate("vffnullSpace.kinds()") == [kind]
    assert tab.picture().std() > 5.0
    ball_is_drawn(tab, result, 0)
    tab.seek(1.0)
    assert page.evaluate("document.getElementById('clock').value").startswith("6.00")
    ball_is_drawn(tab, result, -1)
    begin, box = tab.look(), page.locator("canvas.space").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 60, y + 20, steps=3)
    page.mouse.up()
    tab.rest()
    assert (
        tab.look()["azimuth"] > begin["azimuth"] + 0.3 and tab.look()["elevation"] > begin["elevation"] + 0.1
    )
    ball_is_drawn(tab, result, -1)
    page.mouse.wheel(0, -200)
    page.wait_for_function("vffnullSpace.look.zoom > 1.2")
    tab.rest()
    ball_is_drawn(tab, result, -1)
    page.keyboard.down("Shift")
    page.mouse.down()
    page.mouse.move(x - 90, y + 20)
    page.mouse.up()
    page.keyboard.up("Shift")
    tab.rest()
    assert np.linalg.norm(tab.look()["pan"]) > 0.02
    ball_is_drawn(tab, result, -1)
    page.get_by_role("button", name="Top").click()
    page.wait_for_function("vffnullSpace.look.elevation > 1.5 && vffnullSpace.look.zoom === 1")
    tab.rest()
    ball_is_drawn(tab, result, -1)
    before = tab.picture()
    page.select_option("#colours", "link")
    tab.rest()
    assert np.abs(before - tab.picture()).sum(axis=2).max() > 100
    assert page.locator("#scale").is_hidden()


def test_a_scene_in_space_is_turned_and_moved(browser: Any, result: vff.Result, path: Path) -> None:
    with opened(browser, path) as tab:
        acts_like_a_scene(tab, result, "webgl")


def test_an_arm_that_comes_towards_the_corner_is_seen_from_the_next(browser: Any, tmp_path: Path) -> None:
    """The usual corner is 48° to the right of where arms reach; this one reaches to just there."""
    q0 = [-0.83, *vff.Scenario.load("panda-sweep")["q0"][1:]]
    short = {"q0": q0, "duration": 0.02, "obstacles": []}
    path = vff.simulate("panda-sweep", short).report(tmp_path / "turned.html")
    with opened(browser, path) as tab:
        assert np.degrees(tab.look()["azimuth"]) == pytest.approx(90.0 - 47.6, abs=0.5)
        tab.page.get_by_role("button", name="Side").click()
        tab.page.get_by_role("button", name="Corner").click()
        tab.page.wait_for_function("Math.abs(vffnullSpace.look.azimuth - 0.74) < 0.01", timeout=1000 * HANG)


def test_without_webgl_it_is_drawn_flat(browser: Any, result: vff.Result, path: Path) -> None:
    with opened(browser, path, script=NO_WEBGL) as tab:
        acts_like_a_scene(tab, result, "flat")


def test_links_are_coloured_by_their_clearance(browser: Any, result: vff.Result, path: Path) -> None:
    """Grey while the ball is far away, orange when it is near, in all views."""
    nearest = float(result.t[int(result.clearance.min(axis=1).argmin())] / result.t[-1])
    with opened(browser, path) as tab:

        def warm(share: float) -> float:
            tab.seek(share)
            red, green, blue = np.moveaxis(tab.picture(), 2, 0)
            return float(((red > green + 60) & (green > blue + 25)).mean())

        assert warm(0.0) < 2e-3 < 2e-2 < warm(nearest)


def test_a_finger_turns_two_zoom_and_the_page_still_scrolls(browser: Any, path: Path) -> None:
    """At 420 px, by touch; nothing sticks out at the side."""
    with opened(browser, path, 420, has_touch=True, is_mobile=True) as tab:
        page, session = tab.page, tab.context.new_cdp_session(tab.page)
        assert page.evaluate("document.documentElement.scrollWidth") <= 420
        box = page.locator("canvas.space").bounding_box()
        assert box["width"] > 340
        middle = (box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)

        def touch(kind: str, *places: tuple[float, float]) -> None:
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        def swipe(way: Callable[[float], tuple[tuple[float, float], ...]]) -> None:
            touch("touchStart", *way(0.0))
            for share in np.linspace(0.0, 1.0, 9)[1:]:
                touch("touchMove", *way(float(share)))
            touch("touchEnd")
            tab.rest()

        begin, height = tab.look(), page.evaluate("scrollY")
        swipe(lambda share: ((middle[0] + 80 * share, middle[1]),))
        turned = tab.look()
        assert turned["azimuth"] < begin["azimuth"] - 0.3 and page.evaluate("scrollY") == height
        swipe(
            lambda share: ((middle[0] - 30 - 40 * share, middle[1]), (middle[0] + 30 + 40 * share, middle[1]))
        )
        zoomed = tab.look()
        assert zoomed["zoom"] > 1.5
        swipe(lambda share: ((middle[0], middle[1] - 100 * share),))
        page.wait_for_function("before => scrollY > before + 30", arg=height)
        assert tab.look()["zoom"] == zoomed["zoom"]


def test_runs_in_the_plane_and_in_space_side_by_side(
    browser: Any, result: vff.Result, tmp_path: Path
) -> None:
    """Every run in its own picture; those in space are turned together."""
    runs = {
        "one": result,
        "flat": vff.simulate("sweep-through", {"duration": 0.2}),
        "two": vff.simulate("panda-sweep", {"controller.field.gain": 20.0, "simulation.record_every": 200}),
    }
    with opened(browser, vff.compare(runs, tmp_path / "all.html")) as tab:
        assert tab.page.evaluate("vffnullSpace.kinds()") == ["webgl", "webgl"]
        shown = "i => document.querySelectorAll('canvas.space')[i].toDataURL()"
        before = [tab.page.evaluate(shown, i) for i in range(2)]
        tab.page.get_by_role("button", name="Side").click()
        tab.page.wait_for_function("Math.abs(vffnullSpace.look.azimuth + Math.PI / 2) < 1e-6")
        tab.rest()
        assert all(tab.page.evaluate(shown, i) != picture for i, picture in enumerate(before))


def test_a_lost_context_comes_back(browser: Any, result: vff.Result, path: Path) -> None:
    """As after a computer has slept: everything is built anew."""
    with opened(browser, path) as tab:
        tab.page.evaluate(
            """() => new Promise(done => {
                const canvas = document.querySelector('canvas.space')
                const lose = canvas.getContext('webgl2').getExtension('WEBGL_lose_context')
                canvas.addEventListener('webglcontextlost', () => setTimeout(() => lose.restoreContext(), 50))
                canvas.addEventListener('webglcontextrestored', () => done())
                lose.loseContext()
            })"""
        )
        tab.rest()
        ball_is_drawn(tab, result, 0)
