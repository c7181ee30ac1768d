"""The live page and what browsers tell of their visitors: what they look at, and pictures that are none."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from waiting import frames, wait_for


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Any]:
    pytest.importorskip("viser")
    page = vff.live("gen3-circle", open_browser=False, block=False, record_to=tmp_path)
    yield page
    page.stop()


@contextmanager
def visitor(page: Any, **said: Any) -> Iterator[Any]:
    """Somebody whose browser has said this of its camera; the page's view of them."""
    import msgspec
    import viser
    from websockets.sync.client import connect

    before = set(page._server.get_clients())
    protocol: Any = f"viser-v{viser.__version__}"
    how: Any = {"subprotocols": [protocol], "max_size": None, "close_timeout": 0.1, "ping_interval": None}
    with connect(page.url.replace("http", "ws"), **how) as connection:
        connection.send(msgspec.msgpack.encode(camera(**said)))
        wait_for(lambda: set(page._server.get_clients()) - before)
        (new,) = set(page._server.get_clients()) - before
        yield page._server.get_clients()[new]


def camera(**said: Any) -> dict[str, Any]:
    """What a browser says of its camera."""
    sound = {
        "type": "ViewerCameraMessage",
        "wxyz": [1.0, 0.0, 0.0, 0.0],
        "position": [1.0, 1.0, 1.0],
        "look_at": [0.0, 0.0, 0.0],
        "up_direction": [0.0, 0.0, 1.0],
        "fov": 0.8,
        "near": 0.01,
        "far": 100.0,
        "image_height": 800,
        "image_width": 800,
    }
    return sound | said


BROKEN: dict[str, dict[str, Any]] = {
    "no height": {"image_height": 0},
    "no width": {"image_width": 0},
    "nowhere": {"position": [float("nan")] * 3},
    "in a plane": {"position": [1.0, 1.0], "look_at": [0.0, 0.0]},
    "in four dimensions": {"position": [1.0] * 4, "look_at": [0.0] * 4},
    "looking at itself": {"look_at": [1.0, 1.0, 1.0]},
    "nothing is up": {"up_direction": [0.0, 0.0, 0.0]},
    "up in a plane": {"up_direction": [0.0, 1.0]},
}


def test_the_camera_follows_the_hand(page: Any) -> None:
    """As far as it goes; it compared the hand's place with itself, in viser's own array."""
    with visitor(page) as client:
        page.look("Follow")
        frames(page, 3)
        hand, eye = np.array(page._scene._tip.position), np.array(client.camera.position)

        def moved() -> float:
            return float(np.linalg.norm(page._scene._tip.position - hand))

        wait_for(lambda: moved() > 0.1)
        page.pause(True)
        frames(page, 3)
        followed = np.array(client.camera.position) - eye
        assert np.linalg.norm(followed - (page._scene._tip.position - hand)) < 0.02


@pytest.mark.filterwarnings("ignore:.*does not match annotation")  # viser's
@pytest.mark.parametrize("fault", BROKEN)
def test_one_whose_picture_is_none_is_left_alone(page: Any, fault: str) -> None:
    """Everybody else sees another scene, and goes along with the hand."""
    with visitor(page, **BROKEN[fault]), visitor(page) as other:
        page.open(vff.Scenario.load("panda-cup"))
        page.open(vff.Scenario.load("gen3-circle"))
        wanted = page._scene.camera(page._box(), 1.0)
        wait_for(lambda: np.allclose(other.camera.position, wanted.position, atol=0.1))
        page.look("Follow")
        frames(page, 3)
        eye = np.array(other.camera.position)
        wait_for(lambda: np.linalg.norm(other.camera.position - eye) > 0.02)
        page.look("Corner")
        frames(page, 3)
        assert page._painter.is_alive()
