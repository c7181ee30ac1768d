"""The live page: its controls, what the first visitor sees, and scenes that come and go as files."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError
from vffnull.live.files import scenario_of
from vffnull.live.joints import PATIENCE
from vffnull.live.ports import free
from vffnull.live.scene import view
from vffnull.live.scene.legend import LENGTH
from waiting import frames, obey, wait_for

SOMEBODY: Any = SimpleNamespace(client_id=7)


def test_the_page_begins_without_a_library_that_draws() -> None:
    """matplotlib would take a third of the time until it answers."""
    script = "import sys, vffnull.live.page; print('matplotlib' in sys.modules, 'pyarrow' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]


def test_a_port_that_is_asked_for_and_taken_is_an_error() -> None:
    """With one that is free; without a wish the page looks on by itself."""
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        taken = other.getsockname()[1]
        with pytest.raises(InputError, match=rf"--port: {taken} is taken.*\d+ is free|choose another"):
            free(taken, "--port")
        with pytest.raises(InputError, match=f"port: {taken} is taken"):
            vff.live("swing", port=taken, open_browser=False, block=False)
    assert free(None) >= 8080


class Client:
    """A browser as the page knows it: it takes a camera when it has drawn."""

    def __init__(self, aspect: float) -> None:
        self.client_id, self.sent = 1, []
        places = {name: np.zeros(3) for name in ("position", "look_at", "up_direction")}
        self.camera = SimpleNamespace(aspect=aspect, **places)
        self.camera.on_update = self._listen
        self._websock_connection = SimpleNamespace(queue_message=self.sent.append)

    def _listen(self, told: Any) -> Any:
        self._told = told
        return told

    def atomic(self) -> Any:
        from contextlib import nullcontext

        return nullcontext()

    def answers(self) -> None:
        obey(self._told(self.camera))


def test_time_begins_when_the_first_visitor_has_the_picture(page: Any) -> None:
    """Not when a browser connects, nor while it has another camera than the page gave it; a second visitor
    changes nothing.
    """
    wait_for(lambda: page.snapshot()["t"] > 1.0)
    first = Client(0.84)
    obey(page._welcome(first))
    wait_for(lambda: page.snapshot()["status"] == "paused")
    assert page.snapshot()["t"] < 0.9
    first.answers()
    wanted = first.camera.position
    first.camera.position = np.array(page._server.initial_camera.position)  # viser's own comes late
    first.answers()
    np.testing.assert_allclose(first.camera.position, wanted)
    assert page.snapshot()["status"] == "paused" and not first.sent
    first.answers()
    wait_for(lambda: page.snapshot()["t"] > 0.1)
    first.camera.position = np.array([3.0, 0.0, 1.0])  # by hand
    first.answers()
    assert first.camera.position[0] == 3.0
    t = page.snapshot()["t"]
    second = Client(0.84)
    obey(page._welcome(second))
    assert page.snapshot()["status"] == "running" and page.snapshot()["t"] >= t
    assert len(first.sent) == 1, "the notice on software rendering is in the way"


def test_a_visitor_who_leaves_lets_time_begin(page: Any) -> None:
    obey(page._welcome(Client(0.84)))
    wait_for(lambda: page.snapshot()["status"] == "paused")
    obey(page._miss(SOMEBODY))
    wait_for(lambda: page.snapshot()["t"] > 0.05)


def test_a_browser_that_never_says_what_it_has_drawn_lets_time_begin(
    page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is asked to take the camera, and does not answer."""
    monkeypatch.setattr(sys.modules["vffnull.live.page"], "FIRST", 0.5)
    obey(page._welcome(Client(0.84)))
    wait_for(lambda: page.snapshot()["status"] == "paused")
    wait_for(lambda: page.snapshot()["t"] > 0.05)


def test_a_phone_shows_the_plane_above_its_controls() -> None:
    """They cover the lower three fifths of a picture that stands upright."""
    box = (-1.0, 3.0, -0.5, 1.5)
    for aspect, lowest in ((390 / 844, 0.2), (602 / 720, -1.0)):
        (x, y, height), _ = view(box, aspect)
        half = height * np.tan(0.125)
        assert max(box[1] - x, x - box[0]) <= aspect * half
        assert (box[3] - y) / half <= 1.0 and (box[2] - y) / half >= lowest


def test_a_reset_keeps_the_settings_or_brings_back_the_file_s(page: Any) -> None:
    panel = page._panel
    panel._sliders["stiffness"].value = 400.0
    panel._changed(panel._sliders["stiffness"])
    page.reset()
    assert panel._settings["stiffness"] == page._settings["stiffness"] == 400.0
    for callback in panel._reset_all._impl.update_cb:
        obey(callback(SimpleNamespace(client=None, target=None)))
    shown = panel._sliders["stiffness"].value
    assert panel._settings["stiffness"] == page._settings["stiffness"] == shown == 900.0


def test_sliders_reach_beyond_the_file_s_values(page: Any) -> None:
    """And come back to their usual range with the next scene; a small value is shown as it is."""
    panel = page._panel
    assert panel._sliders["gain"].value == 80.0 and panel._sliders["gain"].max >= 160.0
    assert panel._sliders["stiffness"].max >= 1800.0 and panel._sliders["damping"].max >= 120.0
    page.open(vff.Scenario.load("swing").replace(**{"controller.field.influence": 0.004}))
    assert panel._sliders["gain"].max == 6.0 and panel._sliders["stiffness"].max == 400.0
    assert panel._sliders["influence"].value == 0.004 >= panel._sliders["influence"].min


@pytest.mark.parametrize("scene", ["swing", "crowd"])  # without a floor of the field, and with one
def test_a_number_that_is_typed_is_taken_when_it_is_one(page: Any, scene: str) -> None:
    """Of 0.5 the 0 comes first, which no field has: it changes nothing, and what stays so is put back."""
    page.open(vff.Scenario.load(scene))
    panel = page._panel
    slider, before = panel._sliders["influence"], page._settings["field"]["influence"]
    for typed, wanted in ((0.0, before), (-5.0, before), (0.5, 0.5)):
        slider.value = typed
        panel._changed(slider)
        assert slider.value == typed
        assert page._settings["field"]["influence"] == wanted
    slider.value = 0.0
    panel._changed(slider)
    panel._unfinished = slider, 0.0
    wait_for(lambda: slider.value == 0.5)
    with pytest.raises(InputError, match="is none of"):
        panel._tell("bogus")


def test_every_control_says_what_it_is_for(page: Any) -> None:
    handles = [each for each in page._server.gui._gui_input_handle_from_uuid.values() if each.label]
    assert len(handles) > 30
    assert [each.label for each in handles if not each.hint] == []


def test_time_pace_and_scale_are_in_sight(page: Any) -> None:
    wait_for(lambda: "× real time" in page._panel._numbers.content)
    assert 'id="vff-time"' in page._panel._numbers.content
    assert "80 N of repulsion" in page._panel._numbers.content


@pytest.mark.parametrize("name", ["swing", "panda-sweep"])
def test_arrows_are_as_long_as_their_forces(name: str, tmp_path: Path) -> None:
    """In the scale of the one beside the base, which gets coarser before an arrow is longer than it."""
    page = vff.live(name, open_browser=False, block=False, record_to=tmp_path)
    try:
        drawing = page._scene
        legend = drawing._legend
        full = LENGTH * drawing.reach
        assert legend._handles[0].visible and legend._handles[1].text == f"{legend.newtons:g} N"
        assert legend.length(legend.newtons) == pytest.approx(full)
        page.pause(True)
        frames(page)
        before, strongest = legend.newtons, 3.3 * legend.newtons
        size = drawing.size
        forces = np.zeros((page.scenario.arm.n, size))
        forces[0, 0], forces[1, 0] = strongest, strongest / 2
        with page._lock:
            drawing.draw({**page.snapshot(), "forces": forces})
            lengths = [arrow.scale[0] for arrow in drawing._forces[:2]]
        assert legend.newtons >= strongest > before
        assert lengths[0] == pytest.approx(2 * lengths[1]) and lengths[0] <= full
        assert lengths[0] / full == pytest.approx(strongest / legend.newtons)
    finally:
        page.stop()


def test_a_cup_is_only_where_the_scene_has_one(page: Any) -> None:
    assert page._scene._cup is not None
    page.open(page.scenario.replace(description="a ball sweeps through the elbow"))
    assert page._scene._cup is None
    page.open(vff.Scenario.load("iiwa-line"))
    assert page._scene._cup is None


def test_drag_me_is_said_of_something_that_is_seen(page: Any) -> None:
    """Of the first ball that is near; of none that is not."""
    ball = page.scenario.to_dict()["obstacles"][0] | {"motion": {"kind": "static"}}
    far, near = ball | {"position": [0.0, 9.0, 0.5]}, ball | {"position": [0.0, -0.7, 0.5]}
    page.open(page.scenario.replace(obstacles=[far, near]))
    drawing = page._scene
    with page._lock:
        places = np.array([far["position"], near["position"]])
        drawing._draw_hint(places)
        assert drawing._hint.visible
        np.testing.assert_allclose(drawing._hint.position[:2], near["position"][:2])
        drawing._draw_hint(np.array([far["position"], far["position"]]))
        assert not drawing._hint.visible


def test_joints_are_shown_within_their_limits_and_set(page: Any) -> None:
    """A slider that has been moved and rests begins the scene anew from there, settings kept."""
    joints = page._panel._joints
    limits = page.scenario.arm.joint_limits
    assert [(each.min, each.max) for each in joints._sliders] == [tuple(row) for row in np.asarray(limits)]
    q0 = page.scenario.to_dict()["q0"]
    wait_for(lambda: np.allclose([each.value for each in joints._sliders], q0, atol=0.3))
    panel = page._panel
    panel._sliders["damping"].value = 50.0
    panel._changed(panel._sliders["damping"])
    joints._sliders[0].value = 0.4
    (told,) = joints._sliders[0]._impl.update_cb
    obey(told(SimpleNamespace(client=SOMEBODY)))
    assert PATIENCE < 1.0
    wait_for(lambda: page.scenario.to_dict()["q0"][0] == 0.4)
    assert page._settings["damping"] == 50.0
    page.open(vff.Scenario.load("swing"))
    assert len(joints._sliders) == 6 and joints._sliders[0].min == pytest.approx(-np.pi)
    # Another arm whose joints are called alike has its own limits, and who moves one joint moves no other.
    links = [[-0.5, 0.6], *[[-9.0, 9.0]] * 5]
    arm = {"lengths": [1.0] * 6, "masses": 1.0, "joint_limits": links}
    page.open(vff.Scenario.load("swing").replace(arm=arm, q0=[0.1, 7.0, 0.2, 0.3, 0.1, 0.2]))
    assert (joints._sliders[0].min, joints._sliders[0].max) == (-0.5, 0.6)
    wait_for(lambda: abs(joints._sliders[1].value - 7.0) < 1.0)
    q = np.array([0.1, 30.0, 0.2, 0.3, 0.1, 0.2])  # beyond what a slider shows
    joints._moved, begun = None, []
    joints._begin_at, told = begun.append, joints._sliders[5]._impl.update_cb[0]
    joints._sliders[5].value = 0.5
    obey(told(SimpleNamespace(client=SOMEBODY)))
    joints._moved -= 2.0 * PATIENCE
    joints.read(q)
    assert begun == [[*q[:5], 0.5]]


@pytest.mark.parametrize("name", ["swing", "panda-sweep"])
def test_a_scene_is_saved_with_what_has_been_changed_and_opened_again(name: str, tmp_path: Path) -> None:
    page = vff.live(name, open_browser=False, block=False, record_to=tmp_path)
    try:
        panel = page._panel
        panel._sliders["damping"].value = 17.0
        panel._changed(panel._sliders["damping"])
        page.add_obstacle()
        place = page.snapshot()["obstacles"][0] + 0.1
        page._carry(0, place)
        wait_for(lambda: np.allclose(page.snapshot()["obstacles"][0], place, atol=1e-6))
        sent: list[tuple[str, bytes]] = []

        def take(file: str, content: bytes, save_immediately: bool) -> None:
            sent.append((file, content))

        panel._send(SimpleNamespace(send_file_download=take))
        ((file, content),) = sent
        assert file == f"{name}.toml"
        page.open(scenario_of(file, content))
        document = page.scenario.to_dict()
        assert document["controller"]["damping"] == 17.0 and len(document["obstacles"]) == 2
        np.testing.assert_allclose(document["obstacles"][0]["position"], place, atol=1e-3)
        assert page.snapshot()["obstacles"].shape[0] == 2
    finally:
        page.stop()


def test_files_that_cannot_be_opened_are_refused() -> None:
    text = str(vff.Scenario.load("panda-sweep"))
    assert scenario_of("mine.toml", text.encode()).name == "panda-sweep"
    with pytest.raises(InputError, match=r"arm\.urdf names files that do not come along"):
        scenario_of("mine.toml", text.replace('model = "panda"', 'urdf = "/etc/passwd"').encode())
    with pytest.raises(InputError, match="no text in UTF-8"):
        scenario_of("mine.toml", b"\xff\xfe")
    with pytest.raises(ScenarioError, match=r"^mine\.toml: missing key"):
        scenario_of("mine.toml", b"duration = 1.0")
