"""The live page: where a scene that is watched ends, what it tells first, and pauses that stay pauses."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.live.ending import has_end
from vffnull.live.panel import GO_ON
from vffnull.live.readouts import ALARM, CALM, found, numbers
from vffnull.live.stories import STORIES
from waiting import frames, obey, wait_for

END = 0.4


@pytest.fixture
def short(tmp_path: Path) -> Iterator[Any]:
    """A disc that goes on for ever, in a scene that soon ends."""
    pytest.importorskip("viser")
    scenario = vff.Scenario.load("sweep-through").replace(duration=END)
    page = vff.live(scenario, open_browser=False, block=False, record_to=tmp_path)
    yield page
    page.stop()


def waits(page: Any) -> None:
    wait_for(lambda: page.snapshot()["status"] == "paused", "the end")


def test_a_scene_that_is_watched_pauses_at_its_end(short: Any) -> None:
    """Once; the panel says so, and how to go on. After a reset it does again."""
    panel = short._panel
    for _ in range(2):
        waits(short)
        assert END <= short.snapshot()["t"]
        wait_for(lambda: "has reached its end at t = 0.4 s" in panel._numbers.content)
        wait_for(lambda: panel._pause.label == GO_ON and panel._back.visible)
        short.pause(False)
        beyond = short.snapshot()["t"] + 2 * END
        wait_for(lambda beyond=beyond: short.snapshot()["t"] > beyond)
        assert short.snapshot()["status"] == "running"
        wait_for(lambda: panel._pause.label == "Pause" and "reached its end" not in panel._numbers.content)
        short.reset()


def test_whoever_comes_first_and_late_sees_the_beginning(short: Any) -> None:
    """Also where the scene has come to its end before there was a browser."""
    waits(short)
    client: Any = SimpleNamespace(client_id=1, camera=SimpleNamespace(on_update=lambda told: told))
    obey(short._welcome(client))
    assert short.snapshot()["t"] < END / 2 and short._end.at is None
    obey(short._miss(client))  # who waits for no picture
    waits(short)


def test_whoever_drags_has_no_end(short: Any) -> None:
    """Neither before it nor at it: what is taken hold of moves."""
    waits(short)
    short._carry(0, np.array([3.0, 2.5]))
    wait_for(lambda: short.snapshot()["t"] > 2 * END)
    short.reset()
    waits(short)
    short.reset()
    short._aim(short.snapshot()["x"][:2])
    wait_for(lambda: short.snapshot()["t"] > 2 * END)


def test_scenes_that_rest_or_repeat_themselves_have_no_end() -> None:
    ends = {name for name in vff.scenarios() if has_end(vff.Scenario.load(name).to_dict())}
    assert {"sweep-through", "panda-sweep", "paper-2-printed"} <= ends
    assert not ends & {"swing", "paper-1", "crowd", "panda-lean", "push-through", "narrow-gap"}
    assert not [name for name, story in STORIES.items() if has_end(story.open().to_dict())]


def test_what_stopped_the_loop_comes_first_and_is_red(short: Any) -> None:
    """And nothing offers to go on; the seconds before can be looked at."""
    panel = short._panel
    short._end.drop()
    short.configure(short.scenario.to_dict()["controller"] | {"stiffness": 1e9, "damping": 1e5})
    short._aim(np.array([4.0, 2.0]))
    wait_for(lambda: short.snapshot()["status"] == "diverged")
    state = short.snapshot()
    first = found(state, short.scenario)[0]
    assert (first.verdict, first.severity, first.text) == ("diverged", "bad", state["message"])
    wait_for(lambda: "<b>diverged</b>" in panel._numbers.content)
    wait_for(lambda: not panel._pause.visible)
    wait_for(lambda: panel._replay.visible and panel._back.visible)
    content = panel._numbers.content
    assert color(content, "time") == ALARM and CALM not in (color(content, "newtons"), color(content, "time"))
    short.reset()
    wait_for(lambda: panel._pause.visible and panel._pause.label == "Pause")
    wait_for(lambda: color(panel._numbers.content, "time") not in (ALARM, CALM))


def color(content: str, name: str) -> str:
    """Of a number in the read-out."""
    return content.partition(f'id="vff-{name}"')[2].partition(";color:")[2].partition('"')[0]


@pytest.mark.parametrize("change", ["show_ghost", "cast_shadows", "show_meshes"])
def test_what_begins_anew_in_a_pause_stays_paused(page: Any, change: str) -> None:
    """Panel and loop agree."""
    wait_for(lambda: page.snapshot()["t"] > 0.2)
    page.pause(True)
    before = {"show_ghost": False, "cast_shadows": True, "show_meshes": False}[change]
    getattr(page, change)(before)
    frames(page, 12)
    assert page.snapshot()["status"] == "paused" and page.snapshot()["t"] == 0.0
    wait_for(lambda: page._panel._pause.label == GO_ON)
    if page._ghost is not None:
        assert page._ghost.snapshot()["t"] == 0.0
    getattr(page, change)(not before)
    page.pause(False)
    wait_for(lambda: page.snapshot()["t"] > 0.2)
    wait_for(lambda: page._panel._pause.label == "Pause")


def test_a_clearance_of_nothing_is_not_shown(page: Any) -> None:
    wait_for(lambda: "Clearance now" in page._panel._numbers.content)
    page.remove_obstacle()
    wait_for(lambda: "Clearance now" not in page._panel._numbers.content)
    assert "nan" not in page._panel._numbers.content and "Smallest so far" in page._panel._numbers.content
    assert "nan" not in numbers(page.snapshot())


def test_a_camera_that_is_nowhere_is_left_alone(page: Any) -> None:
    """As a broken browser tells of it."""
    nowhere = np.full(3, np.nan)
    client: Any = SimpleNamespace(client_id=1)
    client.camera = SimpleNamespace(aspect=1.0, position=nowhere, look_at=nowhere, up_direction=nowhere)
    client.camera.on_update = lambda told: setattr(client, "told", told)
    obey(page._welcome(client))
    obey(client.told(client.camera))
    page._move_camera(client)
    assert client.camera.position is nowhere


def test_what_cannot_be_read_is_no_news_for_the_terminal(
    page: Any, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    """A message that is none ends its connection, and nothing else."""
    viser = sys.modules["viser"]
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.client import connect

    protocol: Any = f"viser-v{viser.__version__}"
    with connect(page.url.replace("http", "ws"), subprotocols=[protocol], max_size=None) as connection:
        connection.send(b"\xff\x00nothing")
        with pytest.raises(ConnectionClosed):
            while True:
                connection.recv()
    frames(page)
    said = capfd.readouterr()
    assert "Traceback" not in said.err + said.out and not caplog.records
