"""The live page and what browsers tell of their visitors: what they look at, and pictures that are none."""

from __future__ import annotations

import base64
import socket
import time
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
    with connected(page, **said) as (_, client):
        yield client


@contextmanager
def connected(page: Any, **said: Any) -> Iterator[Any]:
    """The same, with the connection."""
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
        yield connection, page._server.get_clients()[new]


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


def test_what_a_browser_chooses_has_to_be_there(page: Any, tmp_path: Path) -> None:
    """A visitor could open any scenario of the machine that runs the page, and leave it without a view."""
    import msgspec

    hidden = (
        vff.Scenario.load("sweep-through").replace(name="nobody's business").save(tmp_path / "hidden.toml")
    )
    panel = page._panel
    with connected(page) as (connection, client):
        told: list[str] = []
        client.add_notification = lambda title, text, **how: told.append(text)
        for control, value in (
            (panel._preset, str(hidden)),
            (panel._views, "nowhere"),
            (panel._view, "nowhere"),
        ):
            if control is panel._preset:
                update = {"type": "GuiUpdateMessage", "uuid": control._impl.uuid, "updates": {"value": value}}
                connection.send(msgspec.msgpack.encode(update))
            else:
                panel._told(client, panel._look_at, value)
            wait_for(lambda: told)
            assert "is none of" in told.pop()
        assert page.scenario.name == "gen3-circle" and page.view in page.views


def test_the_end_waits_for_nobody_who_does_not_read(page: Any) -> None:
    """A tab that hangs: the end of the page took six seconds."""
    with silent(page):
        begun = time.monotonic()
        page.stop()
        assert time.monotonic() - begun < 2.0


@contextmanager
def silent(page: Any) -> Iterator[None]:
    """Somebody who asks for the page and never reads what comes, until no more of it can be sent."""
    import viser

    port = int(page.url.rsplit(":", 1)[1].rstrip("/"))
    before = len(page._server.get_clients())
    with socket.socket() as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        connection.connect(("127.0.0.1", port))
        key = base64.b64encode(b"x" * 16).decode()
        asked = [
            "GET / HTTP/1.1",
            f"Host: 127.0.0.1:{port}",
            "Upgrade: websocket",
            "Connection: Upgrade",
            f"Sec-WebSocket-Key: {key}",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
        ]
        connection.sendall("\r\n".join([*asked, "", ""]).encode())
        wait_for(lambda: page._server._websock_server._client_state_from_id or before < 0)
        time.sleep(1.0)
        yield
