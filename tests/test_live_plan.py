"""A plan on the live page: somebody wants a way to where the hand does not come by itself."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from test_replan import STRAIGHT
from waiting import wait_for

pytest.importorskip("viser")

BEYOND = [2.2, -0.4]  # beyond the wall [m]


def scene(replan: dict[str, Any] | None = None, reference: dict[str, Any] | None = None) -> vff.Scenario:
    """Four links before a wall of two discs, whose hand rests where it is."""
    rests = {"kind": "setpoint", "point": [0.06, 3.6]}
    return vff.Scenario.from_dict({**STRAIGHT, "reference": reference or rests, "replan": replan})


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Opens pages, and stops them."""
    pages = []

    def open_(scenario: vff.Scenario) -> Any:
        pages.append(vff.live(scenario, open_browser=False, block=False, record_to=tmp_path))
        return pages[-1]

    yield open_
    for page in pages:
        page.stop()


def off(page: Any, place: list[float]) -> float:
    """How far the tip is from a place [m]."""
    return float(np.linalg.norm(page.snapshot()["x"][: len(place)] - np.array(place)))


def test_the_hand_goes_around_the_wall(opened: Callable[..., Any]) -> None:
    """It rests before the wall until somebody wants a plan; the pale green arm then goes ahead of it."""
    page = opened(scene())
    page._aim(np.array(BEYOND))
    wait_for(lambda: np.allclose(page.snapshot()["x_ref"], BEYOND, atol=1e-3))
    time.sleep(2.0)
    assert off(page, BEYOND) > 0.3 and page.snapshot()["search"] is None
    assert not page._panel._plan.visible
    page.plan()
    wait_for(lambda: page.snapshot()["search"] == "found")
    wait_for(lambda: page._panel._plan.visible and page._scene._arms._planned is not None)
    wait_for(lambda: off(page, BEYOND) < 0.01)
    assert page.snapshot()["min_clearance"] > 0.0 and page.snapshot()["replans"] >= 1


def test_it_goes_on_from_a_plan_to_the_next(opened: Callable[..., Any]) -> None:
    """The target may be dragged again, and another plan leads there; with and without `[replan]`."""
    page = opened(scene(replan={"patience": 30.0}))
    for place in (BEYOND, [0.06, 3.6]):
        page._aim(np.array(place))
        wait_for(lambda place=place: np.allclose(page.snapshot()["x_ref"], place, atol=1e-3))
        page.plan()
        wait_for(lambda place=place: off(page, place) < 0.01)
    assert page.snapshot()["replans"] >= 2


def test_somebody_is_told_where_there_is_none(
    opened: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where an obstacle is where the hand is to go; and of a reference that never rests at once."""
    page = opened(scene())
    told: list[str] = []
    monkeypatch.setattr(page._wanted, "_notify", lambda title, text, seconds: told.append(text))
    page._carry(0, np.array(BEYOND))
    page._aim(np.array(BEYOND))
    wait_for(lambda: np.allclose(page.snapshot()["x_ref"], BEYOND, atol=1e-3))
    wait_for(lambda: np.allclose(page.snapshot()["obstacles"][0], BEYOND, atol=1e-3))
    page.plan()
    wait_for(lambda: told)
    assert told[0].startswith("No way was found to where the target is: goal ")
    time.sleep(0.5)
    assert len(told) == 1

    round_ = {"kind": "circle", "center": [1.5, 2.0], "radius": 0.1, "angular_velocity": 2.0}
    page.open(scene(reference=round_))
    with pytest.raises(vff.errors.ScenarioError, match="never comes to rest"):
        page.plan()


def test_a_recording_without_plans_ends(opened: Callable[..., Any]) -> None:
    """The next one has them, in a file of its own in the same second, and goes on when another is wanted."""
    page = opened(scene())
    first = page.start_recording()
    wait_for(lambda: page._recorder._recording.rows > 0)
    page.plan()
    assert page.stop_recording() is None and first.is_file()
    second = page.start_recording()
    page.plan()
    wait_for(lambda: page._recorder._recording.rows > 0)
    ended = page.stop_recording()
    assert ended is not None and ended[0] == second
    with_plans = [
        any(name.startswith("q_plan") for name in vff.StreamRecorder.read(path).column_names)
        for path in (first, second)
    ]
    assert with_plans == [False, True]
