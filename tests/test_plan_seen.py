"""What is seen of a plan: its arm beside the one that follows it, and when another plan took its place."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

import vffnull as vff
from test_replan import BLOCKED, STRAIGHT
from test_report_in_space import corners_of, runs_of, same_corners, unpack
from vffnull.draw import replans, style
from vffnull.draw.figures.animation import frames_of
from vffnull.draw.figures.space import SLIM
from vffnull.draw.primitives import COLOURS, Body
from vffnull.draw.scene import Scene
from waiting import frames, wait_for

GREEN = np.array(to_rgb(COLOURS["plan"]))


def blocked() -> vff.Scenario:
    """Four links whose plan goes through a disc, so that another is made on the way."""
    return vff.Scenario.from_dict(BLOCKED).replace(replan={}, **{"simulation.record_every": 10})


@pytest.fixture(scope="module")
def run() -> vff.Result:
    found = vff.simulate(blocked())
    assert found.replans and found.replans[0].taken is not None
    return found


@pytest.fixture(scope="module")
def shelf() -> vff.Result:
    return vff.simulate("panda-shelf", {"duration": 3.0, "simulation.record_every": 50})


@pytest.fixture(scope="module")
def without() -> vff.Result:
    return vff.simulate("sweep-through", {"duration": 0.3})


# ------------------------------------------------------------------------------------------ figures and films


def test_a_scene_has_the_links_where_the_plan_has_the_joints(
    run: vff.Result, shelf: vff.Result, without: vff.Result
) -> None:
    for result in (run, shelf):
        assert result.q_plan is not None
        wanted = Scene.of_postures(result.scenario.arm, result.q_plan)
        row = len(result.t) // 2
        scene = Scene.of_result(result)
        for found in (scene.at(row, ["plan"]), scene.pick(np.array([row])).at(0, ["plan"])):
            links = wanted.at(row, ["link"])
            assert len(found) == len(links)
            for one, other in zip(found, links, strict=True):
                assert isinstance(one, Body) and isinstance(other, Body)
                assert one.index == other.index and one.radius == other.radius
                np.testing.assert_array_equal(one.corners, other.corners)
    assert Scene.of_result(without).at(0, ["plan"]) == []


def test_a_picture_shows_the_arm_where_it_is_farthest_from_its_plan(shelf: vff.Result) -> None:
    scene = Scene.of_result(shelf)
    assert scene.plan_deviation.max() > 0.05
    for count in (3, 5, 7):
        chosen = scene.instants(count)
        assert {0, int(scene.plan_deviation.argmax()), len(scene.t) - 1} <= set(chosen)


def legend_of(figure: Figure) -> list[str]:
    legends = [*figure.legends, *(ax.get_legend() for ax in figure.axes)]
    return [text.get_text() for each in legends if each is not None for text in each.get_texts()]


def test_figures_show_the_plan_and_when_another_took_its_place(run: vff.Result, without: vff.Result) -> None:
    figures = run.plot()
    assert isinstance(figures, dict)
    for name in ("tracking", "tracking_error", "joint_angles", "joint_torques", "clearance", "overview"):
        figure = figures[name]
        figure = figure.subfigs[-1] if figure.subfigs else figure
        assert legend_of(figure).count("new plan") == 1, name
        for ax in figure.axes:
            marks = [line for line in ax.get_lines() if line.get_color() == COLOURS["plan"]
                     and len(set(line.get_xdata())) == 1]  # fmt: skip
            assert [line.get_xdata()[0] for line in marks] == [run.replans[0].taken], name
    assert legend_of(figures["strobe"]).count("plan") == 1
    lines = figures["joint_angles"].axes[0].get_lines()
    assert run.q_plan is not None
    for joint in range(4):
        assert any(np.array_equal(line.get_ydata(), run.q_plan[:, joint]) for line in lines)
    plain = without.plot()
    assert isinstance(plain, dict)
    assert all("plan" not in text for figure in plain.values() for text in legend_of(figure))


def test_a_search_without_a_plan_is_marked_where_it_began(run: vff.Result) -> None:
    asked = dataclasses.replace(run, replans=(vff.Replan(0.5, "stuck", "not found", None),))
    ax = style.figure(2.0).subplots()
    replans.mark([ax], asked)
    (line,) = ax.get_lines()
    assert line.get_xdata()[0] == 0.5 and line.get_linestyle() != "-" and not ax.patches


def test_a_film_says_for_a_second_why_there_is_a_new_plan(run: vff.Result) -> None:
    searches = (vff.Replan(0.1, "blocked", "found", 0.4), vff.Replan(2.0, "stuck", "not found", None))
    said = [replans.beside(t, searches, replans.TOLD) for t in (0.39, 0.41, 1.39, 1.41, 2.5)]
    assert said == ["", "new plan: blocked", "new plan: blocked", "", ""]
    taken = run.replans[0].taken
    assert taken is not None
    rows = np.searchsorted(run.t, [taken + 0.5, taken + 1.5])
    with style.look():
        film = frames_of(run, rows, 1.0)
        heads = [film.at(frame)[:40] for frame in (0, 1)]
    green = [(np.abs(head - 255 * GREEN).sum(axis=-1) < 60).sum() for head in heads]
    assert green[0] > 50 and green[1] == 0


@pytest.mark.parametrize("space", [False, True])
def test_films_show_the_ghost_of_the_plan(space: bool, shelf: vff.Result, run: vff.Result) -> None:
    """The same run with a plan that is far away has green where that plan is."""
    result = shelf if space else run
    assert result.q_plan is not None
    away = dataclasses.replace(result, q_plan=result.q_plan + 0.5, replans=())
    bare = dataclasses.replace(result, q_plan=None, replans=())
    counts = []
    for each in (away, bare):
        with style.look():
            dots = frames_of(each, np.array([len(result.t) // 2]), 1.0).at(0).astype(int)
        counts.append(int((dots[..., 1] > np.maximum(dots[..., 0], dots[..., 2]) + 6).sum()))
    assert counts[0] > counts[1] + 300


@pytest.fixture(scope="module")
def late() -> vff.Result:
    """A hand that follows a line until it asks for a plan."""
    return vff.simulate(STRAIGHT, {"duration": 4.0, "simulation.record_every": 20})


def test_as_long_as_there_is_no_plan_its_arm_is_within_the_other(late: vff.Result, tmp_path: Path) -> None:
    (search,) = late.replans
    assert search.taken is not None and late.q_plan is not None
    row = int(np.searchsorted(late.t, search.taken)) - 1
    scene = Scene.of_result(late)
    np.testing.assert_array_equal(scene.plan_deviation[: row + 1], 0.0)
    assert scene.plan_deviation[row + 5 :].max() > 0.01
    assert 0 < row < scene.instants(5)[-1]
    figures = late.plot()
    assert isinstance(figures, dict)
    assert legend_of(figures["joint_angles"]).count("plan") == 1
    (told,) = replans.summary(late)
    assert told.startswith("1 plan: asked for at ") and "came no nearer to its end" in told
    assert "nan" not in late.report(tmp_path / "late.html").read_text().lower().split("<script")[0]

    never = dataclasses.replace(late, q_plan=np.full_like(late.q_plan, np.nan), replans=())
    assert Scene.of_result(never).plan == ()
    figures = never.plot()
    assert isinstance(figures, dict)
    assert all("plan" not in text for figure in figures.values() for text in legend_of(figure))
    assert replans.summary(never) == ["The arm follows its reference; no plan was asked for."]


# --------------------------------------------------------------------------------------------------- reports


def test_a_report_holds_the_plan_and_tells_of_new_ones(
    run: vff.Result, shelf: vff.Result, without: vff.Result, tmp_path: Path
) -> None:
    path = run.report(tmp_path / "plane.html")
    (data,) = runs_of(path)
    scene = Scene.of_result(run)
    rows = np.searchsorted(run.t, unpack(data["t"]) - 1e-6)
    ends = unpack(data["plan"], 4, 2, 2)
    for i, part in enumerate(scene.plan):
        np.testing.assert_allclose(ends[:, i], part.corners[rows], atol=1e-5)
    search = run.replans[0]
    assert data["taken"] == [each.taken for each in run.replans if each.taken is not None]
    text = path.read_text(encoding="utf-8")
    assert f"asked for at {search.asked:.2f} s, as something was in its way, taken over at" in text
    assert 'id="marks"' in text and '"plan-0"' in text

    path = shelf.report(tmp_path / "space.html")
    (data,) = runs_of(path)
    scene, rows = Scene.of_result(shelf), np.arange(len(shelf.t))
    ghosts = [body for body in data["space"]["bodies"] if body["role"] == "plan"]
    assert len(ghosts) == len(scene.plan)
    for body, part in zip(ghosts, scene.plan, strict=True):
        same_corners(corners_of(data["space"], body, len(rows)), part.corners)
        assert body["radius"] == pytest.approx(SLIM * part.radius)
    text = path.read_text(encoding="utf-8")
    assert "The arm follows its plan; no other was asked for." in text and 'id="marks"' not in text

    path = without.report(tmp_path / "none.html")
    (data,) = runs_of(path)
    text = path.read_text(encoding="utf-8")
    assert "plan" not in data and data["taken"] == [] and '"plan-0"' not in text
    assert 'class="planned"' not in text and 'id="marks"' not in text


def test_reasons_from_a_file_are_text(run: vff.Result, tmp_path: Path) -> None:
    """They are told as they are, neither as markup nor as a formula."""
    hostile = "<img src=x onerror=harm()>$\\frac$"
    taken = vff.Replan(0.1, hostile, "found", 0.2)
    strange = dataclasses.replace(run, replans=(taken, vff.Replan(0.5, "stuck", hostile, None)))
    text = strange.report(tmp_path / "run.html").read_text(encoding="utf-8")
    assert "<img src=x" not in text and "&lt;img src=x" in text
    with style.look():
        frames_of(strange, np.searchsorted(run.t, [0.25]), 1.0).at(0)


def test_many_searches_are_told_in_short(run: vff.Result) -> None:
    searches = tuple(vff.Replan(float(i), "stuck", None if i == 3 else "found", i + 0.5) for i in range(9))
    (line,) = replans.summary(dataclasses.replace(run, replans=searches))
    assert line.startswith("9 new plans: ") and line.endswith("and 4 more.")
    (line,) = replans.summary(dataclasses.replace(run, replans=(vff.Replan(1.0, "strayed", None, None),)))
    assert line.startswith("No new plans: ") and line.endswith("but not in time.")


# ------------------------------------------------------------------------------------------------- live page


@pytest.fixture(params=["plane", "space"])
def page(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Any]:
    pytest.importorskip("viser")
    scenario = blocked() if request.param == "plane" else "panda-shelf"
    page = vff.live(scenario, open_browser=False, block=False, record_to=tmp_path)
    yield page
    page.stop()


def test_a_live_page_shows_the_plan(page: Any) -> None:
    wait_for(lambda: page.snapshot()["t"] > 0.3)
    page.pause(True)
    frames(page)
    q, plan = page.snapshot()["q_plan"], page._scene._arms.plan
    assert plan and all(handle.visible for handle in plan)
    arm = page.scenario.arm
    if arm.dimension == 2:
        places = np.array([handle.position[:2] for handle in plan])
        np.testing.assert_allclose(places, arm.forward_kinematics(q)[:-1], atol=1e-6)
    else:
        places = np.array([node.position for node in page._scene._nodes["plan"]])
        np.testing.assert_allclose(places, page._scene._geometry.link_poses(q)[:, :3, 3], atol=2e-4)
    assert page._panel._plan.visible
    wait_for(lambda: "vff-replans" in page._panel._details.content)

    page.show_plan(False)  # at once, also in a pause
    assert not any(handle.visible for handle in plan)
    page.reset()
    frames(page)
    assert not any(handle.visible for handle in page._scene._arms.plan)
    page.show_plan(True)
    assert all(handle.visible for handle in page._scene._arms.plan)

    page.open(vff.Scenario.load("sweep-through"))
    frames(page)
    assert page._scene._arms.plan == [] and not page._panel._plan.visible
    wait_for(lambda: "vff-replans" not in page._panel._details.content)


def _turning(places: np.ndarray, stride: float = 0.05) -> float:
    """By how much a path turns, seen at places that are at least a stride [m] apart [rad]."""
    kept = [places[0]]
    for place in places:
        if np.linalg.norm(place - kept[-1]) >= stride:
            kept.append(place)
    ways = np.diff(kept, axis=0)
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return float(np.arccos(np.clip((ways[1:] * ways[:-1]).sum(axis=1), -1.0, 1.0)).sum())


def test_the_showcase_is_what_an_engineer_would_show() -> None:
    """No joint near its limit of speed, and a tip that takes no loop: out, up and in are half a turn
    and bends, and giving way to the ball is there and back.
    """
    run = vff.simulate("panda-shelf")
    assert run.headline.severity == "good"
    assert np.abs(run.dq / np.asarray(run.scenario.arm.velocity_limits)).max() < 0.85
    way, wanted = run.x[:, :3], run.x_ref[:, :3]
    length, planned = (float(np.linalg.norm(np.diff(each, axis=0), axis=1).sum()) for each in (way, wanted))
    assert planned < 1.4 and length < 1.1 * planned
    assert _turning(wanted) < np.radians(270.0) and _turning(way) < np.radians(450.0)
