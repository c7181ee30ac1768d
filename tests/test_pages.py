"""Reports, comparisons and what notebooks show: complete, self-contained, and alive in a browser."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import vffnull as vff
from browsing import chromium
from vffnull.draw import geometry
from vffnull.draw.primitives import ROLES, Arrow, Body
from vffnull.draw.scene import Scene
from vffnull.errors import InputError, InputTypeError
from waiting import HANG


class Page(HTMLParser):
    """What a page loads from elsewhere, its visible text, and its scripts by id."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.text = ""
        self.scripts: dict[str, str] = {}
        self._inside: list[tuple[str, str]] = []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        given = dict(attributes)
        self.loads += [str(given[key]) for key in ("src", "href", "srcset", "data") if given.get(key)]
        if tag in ("script", "style"):
            self._inside.append((tag, given.get("id") or ""))

    def handle_endtag(self, tag: str) -> None:
        if self._inside and self._inside[-1][0] == tag:
            self._inside.pop()

    def handle_data(self, data: str) -> None:
        if not self._inside:
            self.text += data
        elif self._inside[-1][0] == "script":
            self.scripts[self._inside[-1][1]] = data

    @property
    def runs(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = json.loads(self.scripts["motion"])
        return found


def unpack(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), dtype="<f4")


def squeezed(text: str) -> str:
    return re.sub(r"\s+", " ", text)


# -------------------------------------------------------------------------------------------------- reports


def test_a_report_is_complete_and_self_contained(paper_1: vff.Result, tmp_path: Path) -> None:
    """Metrics with units, the scenario word by word, the version; nothing is loaded from elsewhere."""
    path = paper_1.report(tmp_path / "run.html")
    page = Page(path)
    assert [url for url in page.loads if not url.startswith(("data:", "#"))] == []
    for name, (unit, meaning) in vff._core.METRICS.items():
        assert name in page.text
        if name in paper_1.metrics.missing:  # named below the table
            assert name in page.text.partition("Without a value: ")[2]
            continue
        assert unit in page.text and meaning in page.text
    assert f"{paper_1.metrics['max_repulsion']:.4g}" in page.text
    assert str(paper_1.scenario).strip() in page.text
    assert vff.__version__ in page.text and paper_1.message in page.text
    assert f"of {len(paper_1.t)}" in page.text
    assert path.stat().st_size < 4e6


def test_a_report_shows_the_record(paper_1: vff.Result, tmp_path: Path) -> None:
    """Every number that the page moves is the record's at that instant, and no extreme is left out."""
    (run,) = Page(paper_1.report(tmp_path / "run.html")).runs
    t = unpack(run["t"])
    rows = np.searchsorted(paper_1.t, t - 1e-5)
    np.testing.assert_allclose(paper_1.t[rows], t, rtol=1e-6)
    joints = paper_1.scenario.arm.forward_kinematics(paper_1.q[rows])
    np.testing.assert_allclose(unpack(run["joints"]).reshape(joints.shape), joints, atol=1e-6)
    np.testing.assert_allclose(unpack(run["obstacles"]).reshape(-1, 1, 2), paper_1.obstacles[rows], atol=1e-6)
    assert unpack(run["now"]["clearance"]).min() == pytest.approx(paper_1.metrics["min_clearance"])
    assert unpack(run["now"]["repulsion"]).max() == pytest.approx(paper_1.metrics["max_repulsion"])
    assert unpack(run["now"]["torque"]).max() == pytest.approx(paper_1.metrics["peak_torque"])
    assert {each["name"] for each in run["quantities"]} == set(paper_1.recorded())


@pytest.mark.parametrize("name", ["sweep-through", "paper-1", "paper-2-moving"])
def test_arrows_add_up_to_the_repulsive_torque(name: str) -> None:
    """The drawn forces F at the drawn points: Σ JᵀF is the recorded τ_vff (T26), one obstacle: exactly."""
    result = vff.simulate(name, {"simulation.record_every": 50})
    scene = Scene.of_result(result)
    (points, forces), joints = scene.pushes, scene.joints
    torque = np.zeros_like(result.tau_vff)
    for joint in range(result.q.shape[1]):
        lever = points[:, joint:] - joints[:, None, joint]
        force = forces[:, joint:]
        torque[:, joint] = (lever[..., 0] * force[..., 1] - lever[..., 1] * force[..., 0]).sum(axis=1)
    assert np.abs(result.tau_vff).max() > 0.1
    np.testing.assert_allclose(torque, result.tau_vff, rtol=0, atol=1e-12 * np.abs(result.tau_vff).max())


def test_a_scene_is_one_list_of_primitives() -> None:
    """All roles in the order of painting, numbered from 0 as the arrays are; only what was asked for."""
    result = vff.simulate("crowd", {"duration": 0.2, "arm.radius": 0.05})
    scene = Scene.of_result(result)
    row = len(result.t) - 1
    found = scene.at(row)
    assert [ROLES.index(each.role) for each in found] == sorted(ROLES.index(each.role) for each in found)
    links = [each for each in found if isinstance(each, Body) and each.role == "link"]
    assert [each.index for each in links] == list(range(6))
    joints = result.scenario.arm.forward_kinematics(result.q[row])
    np.testing.assert_allclose([each.corners for each in links], np.stack([joints[:-1], joints[1:]], axis=1))
    arrows = [each for each in found if isinstance(each, Arrow)]
    np.testing.assert_allclose([np.linalg.norm(each.vector) for each in arrows], result.force[row])
    discs = scene.at(row, ["obstacle"])
    np.testing.assert_allclose([each.corners[0] for each in discs], result.obstacles[row])  # type: ignore[union-attr]
    assert {each.role for each in scene.at(0, ["base", "target"])} == {"base", "target"}
    picked = scene.pick(np.array([row])).at(0)  # at rest: no path of the reference
    assert [each.role for each in picked] == [each.role for each in found if each.role != "reference"]


def test_the_frame_holds_the_arm_and_the_ring_of_the_field_at_the_start() -> None:
    scene = Scene.of_result(vff.simulate("sweep-through"))
    low, high = scene.frame(field=True)
    assert np.all(scene.joints > low) and np.all(scene.joints < high)
    ring = scene.obstacles[0, 0] + geometry.outline(scene.cores[0][0], scene.cores[0][1] + scene.influence)
    assert np.all(ring > low) and np.all(ring < high)


def test_bodies_in_space_are_seen_where_they_are() -> None:
    """A picture's outline of a capsule and of a box in space is the hull of their points, seen from there."""
    random = np.random.default_rng(5)
    view = geometry.view_of(3)
    np.testing.assert_allclose(view @ view.T, np.eye(2), atol=1e-15)
    box = np.array(np.meshgrid([-1, 1], [-2, 2], [-0.5, 0.5])).reshape(3, -1).T
    for corners, radius in ((random.normal(size=(2, 3)), 0.3), (box, 0.2), (box[:1], 0.7)):
        outline = geometry.outline(corners, radius)
        directions = random.normal(size=(300, 2))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        support = (geometry.seen(corners) @ directions.T).max(axis=0) + radius
        reached = (outline @ directions.T).max(axis=0)
        np.testing.assert_allclose(reached, support, atol=radius * geometry.STEP**2 / 8 + 1e-12)
        assert np.all(reached <= support + 1e-12)


@pytest.mark.parametrize(
    "shape",
    [
        {"kind": "circle", "radius": 0.2},
        {"kind": "capsule", "a": [-0.3, 0.1], "b": [0.2, 0.0], "radius": 0.1},
        {"kind": "box", "size": [0.4, 0.2]},
        {"kind": "polygon", "vertices": [[0.0, 0.3], [0.3, -0.1], [-0.2, -0.2]]},
    ],
    ids=lambda shape: shape["kind"],
)
def test_outlines_are_where_the_core_measures_the_surface(shape: dict[str, Any]) -> None:
    """The core's own distance from every point of a grown outline to the obstacle is the margin."""
    margin = 0.15
    corners, radius = geometry.core(shape, angle=0.4)
    outline = geometry.rounded(corners, radius + margin)
    arm = vff.Arm([1e-6], [1.0])  # a point
    controller = vff.Controller(arm, vff.ControlSettings(stiffness=1.0, damping=1.0))
    for point in outline[:: max(1, len(outline) // 25)]:
        obstacle = {"shape": shape, "angle": 0.4, "position": (-point).tolist()}
        terms = controller.terms([0.0], [0.0], [0.0, 0.0], obstacles=[obstacle])
        assert terms.clearance[0] == pytest.approx(margin, abs=3e-6)


@pytest.mark.parametrize(
    "overrides",
    [
        {"obstacles": None},
        {"controller.field": None},
        {"duration": 0.001},
        {"simulation.record_every": 10_000},
        {"arm.radius": 0.03},
        {"name": None, "description": "</script><b>&amp;"},
    ],
    ids=["no obstacles", "no field", "two instants", "one instant", "thick", "markup"],
)
def test_reports_of_odd_results(overrides: dict[str, Any], tmp_path: Path) -> None:
    result = vff.simulate("sweep-through", {"duration": 0.1, **overrides})
    page = Page(result.report(tmp_path / "run.html"))
    assert len(page.runs) == 1 and result.message in page.text
    if "description" in overrides:
        assert overrides["description"] in page.text
    assert "<svg" in result._repr_html_() and "<b>&amp;" not in result._repr_html_()
    result.animate(tmp_path / "run.gif", fps=10)


def test_assumptions_are_those_of_the_run(short: vff.Result, tmp_path: Path) -> None:
    """The bundled scenario is held at 1 kHz and integrated by RK4; under MuJoCo neither integrator nor
    passing through obstacles is true."""
    text = squeezed(Page(short.report(tmp_path / "core.html")).text)
    assert "Runge–Kutta 4 with steps of 0.001 s; the law acts once per control period" in text
    assert "passes through them" in text and "MuJoCo" not in text
    other = dataclasses.replace(short, plant="mujoco")
    text = squeezed(Page(other.report(tmp_path / "mujoco.html")).text)
    assert "MuJoCo moves the arm with steps of 0.001 s" in text
    assert "Runge–Kutta" not in text and "passes through" not in text
    assert "model of the arm is exact" in text and "without friction, ideal torque sources" in text
    real = {
        "plant.masses": 1.3,
        "plant.coulomb_friction": 0.1,
        "measurement.delay": 0.002,
        "actuator.time_constant": 0.001,
        "controller.self_collision": "avoid",
    }
    result = vff.simulate("sweep-through", {"duration": 0.1, **real})
    text = squeezed(Page(result.report(tmp_path / "real.html")).text)
    assert "with friction, torque sources that lag" in text
    assert "model has not: dry friction of up to 0.1 N·m and other masses of its links." in text
    assert "reads angles and speeds with delay" in text and "share no joint avoid one another" in text


RUBBING = """<robot name="rubs"><link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.01"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><sphere radius="0.05"/></geometry></collision></link>
  <link name="lower"><inertial><origin xyz="0 0 0.1"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.01"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/><dynamics damping="0.5" friction="0.1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 0.4"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="50" velocity="3"/>
    <dynamics damping="0.2"/></joint></robot>"""


def test_assumptions_know_what_an_arm_brings_along(tmp_path: Path) -> None:
    """Friction of the file, a payload, a link that nothing avoids, and stops that were taken away."""
    with pytest.warns(vff.errors.ScenarioWarning, match="no shape on `lower`: nothing avoids it"):
        arm = vff.Arm.from_urdf(RUBBING).to_dict()
    document: dict[str, Any] = {
        "duration": 0.01,
        "q0": [0.3, 0.8],
        "arm": arm,
        "reference": {"kind": "setpoint"},
        "plant": {"payload": {"mass": 0.7}},
        "controller": {"command": {"viscous_friction": 0.15}},
    }
    text = squeezed(Page(vff.simulate(document).report(tmp_path / "rubs.html")).text)
    assert "revolute joints with friction" in text and "model of the arm is exact" not in text
    assert (
        "model has not: viscous friction of up to 0.5 N·m·s/rad (up to 0.15 compensated), "
        "dry friction of up to 0.1 N·m and a payload of 0.7 kg." in text
    )
    assert "Joints stop at their limits" in text
    assert "lower: no shape, so nothing avoids it, and no contact is noticed." in text
    free = {"plant": {"joint_stops": False, "viscous_friction": 0.0, "coulomb_friction": 0.0}}
    text = squeezed(Page(vff.simulate({**document, **free}).report(tmp_path / "free.html")).text)
    assert "without friction" in text and "model of the arm is exact" in text
    assert "Joints pass their limits as if there were no stops." in text


def test_report_of_a_diverged_run(tmp_path: Path) -> None:
    overrides = {"simulation.control": "hold", "controller.stiffness": 1e7, "simulation.dt": 0.02}
    with pytest.warns(vff.errors.ScenarioWarning):
        result = vff.simulate("sweep-through", overrides)
    page = Page(result.report(tmp_path / "run.html"))
    assert "diverged" in page.text and squeezed(result.warnings[0]) in squeezed(page.text)
    json.dumps(page.runs, allow_nan=False)


def test_the_scenario_is_folded(short: vff.Result, tmp_path: Path) -> None:
    """One line says what it is about; a click shows the rest, all of which is in the page."""
    text = short.report(tmp_path / "run.html").read_text(encoding="utf-8")
    (fold,) = re.findall(
        r"<details([^>]*)><summary>Scenario<span>(.*?)</span></summary>(.*?)</details>", text, re.S
    )
    assert fold[0] == ""  # not open
    assert fold[1] == f"6 joints, 1 obstacle, {short.scenario.duration:g} s"
    assert "[controller]" in fold[2]


def test_compare(tmp_path: Path) -> None:
    """One column for each run, and the keys in which they differ, no others."""
    gains = {f"gain {g}": vff.simulate("sweep-through", {"controller.field.gain": g}) for g in (0.0, 0.5)}
    page = Page(vff.compare(gains, tmp_path / "compare.html"))
    assert len(page.runs) == 2
    differs = page.text.split("What differs")[1].split("Metrics")[0]
    assert squeezed(differs).replace(" ", "") == "keygain0.0gain0.5controller.field.gain0.00.5"
    for result in gains.values():
        assert f"{result.metrics['min_clearance']:.4g}" in page.text
    assert [url for url in page.loads if not url.startswith(("data:", "#"))] == []


def test_compare_calls_runs_after_their_scenarios(short: vff.Result, tmp_path: Path) -> None:
    page = Page(vff.compare([short, short, vff.simulate("crowd", {"duration": 0.1})], tmp_path / "a.html"))
    for name in ("sweep-through (1)", "sweep-through (2)", "crowd"):
        assert name in page.text


def test_pages_refuse(short: vff.Result, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"\.html"):
        short.report(tmp_path / "run.pdf")
    with pytest.raises(InputError, match="1 to 8 runs, got 0"):
        vff.compare([], tmp_path / "a.html")
    with pytest.raises(InputError, match="got 9"):
        vff.compare([short] * 9, tmp_path / "a.html")
    with pytest.raises(InputTypeError, match="not a str"):
        vff.compare(["run.npz"], tmp_path / "a.html")  # type: ignore[list-item]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["run.html", "run.gif"])
def test_what_cannot_be_written_leaves_the_old_file(name: str, short: vff.Result, tmp_path: Path) -> None:
    """The system refuses to write more than 10 kB, as a full disk does."""
    import resource

    path = tmp_path / name
    path.write_text("what was there")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, before[1]))
    try:
        with pytest.raises(OSError) as caught:
            short.report(path) if name.endswith("html") else short.animate(path, fps=20.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_text() == "what was there" and list(tmp_path.iterdir()) == [path]
    assert not isinstance(caught.value, FileNotFoundError)


def test_figures_can_be_vectors(short: vff.Result, tmp_path: Path) -> None:
    from vffnull.draw import figures as plotting

    for ending, head in ((".pdf", b"%PDF"), (".svg", b"<?xml")):
        for path in plotting.save(short, tmp_path, ending):
            assert path.suffix == ending and path.read_bytes().startswith(head)
    with pytest.raises(InputError, match=r"\.png, \.pdf, \.svg, not \.jpg"):
        plotting.save(short, tmp_path, ".jpg")


def test_legends_name_what_is_visible_and_count_from_0(paper_1: vff.Result) -> None:
    """A link that is farther away than the panel shows is not in its legend."""
    figure = paper_1.plot()["clearance"]  # type: ignore[call-overload]
    low, high = figure.axes[0].get_ylim()
    seen = [i for i in range(6) if np.any((paper_1.clearance[:, i] > low) & (paper_1.clearance[:, i] < high))]
    (legend,) = figure.legends
    named = [text.get_text().removeprefix("link ") for text in legend.get_texts()]
    assert named == [str(i) for i in seen]
    angles = paper_1.plot()["joint_angles"].legends[0]  # type: ignore[call-overload]
    assert [text.get_text() for text in angles.get_texts()] == ["joint 0", "1", "2", "3", "4", "5"]


def test_error_axes_end_where_rounding_begins() -> None:
    """A tip that nothing moves has errors of 1e-16 m, which are no news; the axis says so."""
    result = vff.simulate("sweep-through", {"duration": 0.5, "simulation.record_every": 10})
    assert np.linalg.norm(result.error, axis=1).max() < 1e-12
    axes = result.plot()["tracking_error"].axes[-1]  # type: ignore[call-overload]
    assert axes.get_ylim()[0] == pytest.approx(1e-12)
    assert "rounding" in " ".join(text.get_text() for text in axes.texts)
    assert axes.get_lines()[0].get_color() == "#222222"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as browser:
        yield browser


class Tab:
    """A page in a browser, what it has asked for and what went wrong; it waits as long as it takes."""

    def __init__(self, browser: Any, path: Path, width: int = 1280) -> None:
        self.page = browser.new_page(viewport={"width": width, "height": 900})
        self.page.set_default_timeout(1000 * HANG)
        self.requests: list[str] = []
        self.errors: list[str] = []
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.goto(path.as_uri())
        self.page.wait_for_selector("html[data-ready=yes]")

    def close(self) -> None:
        assert self.errors == []
        assert [url for url in self.requests if not url.startswith(("file:", "data:", "blob:"))] == []
        self.page.close()


def test_names_are_text_in_every_page(browser: Any, tmp_path: Path) -> None:
    """Hostile names of runs, scenarios and descriptions, in headings, tables, keys and hover labels: a label
    says the name as it is, and nothing in it is carried out.
    """
    expect = pytest.importorskip("playwright.sync_api").expect
    expect.set_options(timeout=1000 * HANG)
    script = "<img src=x onerror=window.harmed=1>"
    hostile = [
        f"@t{{safe}}{script}",
        f"$name{{safe}} @{{value}}{{safe}}{script}",
        f"</script><script>window.harmed=1</script>{script}&amp;{{{{7*7}}}}",
    ]
    runs = {
        name: vff.simulate("sweep-through", {"duration": 3.0, "name": name, "description": name})
        for name in hostile
    }
    pages = [vff.compare(runs, tmp_path / "compare.html"), runs[hostile[1]].report(tmp_path / "run.html")]
    labels = """() => [...Bokeh.documents[0]._all_models.values()].filter(m => m.type === 'Figure')
        .flatMap(m => m.renderers.filter(r => r.name && r.data_source.data.t).map(r => [r.name, m.id]))"""
    for path in pages:
        tab = Tab(browser, path)
        page = tab.page
        seen = set()
        for name, figure in page.evaluate(labels):
            point = f"""() => {{
                const all = [...Bokeh.documents[0]._all_models.values()]
                const view = Bokeh.index.find_one(all.find(m => m.id === '{figure}'))
                view.canvas_view.el.scrollIntoView({{block: 'center'}})
                const glyph = view.model.renderers.find(r => r.name === {json.dumps(name)})
                const {{t, value}} = glyph.data_source.data, {{bbox, x_scale, y_scale}} = view.frame
                const far = i => Math.hypot(x_scale.compute(t[i]) - bbox.hcenter,
                                            y_scale.compute(value[i]) - bbox.vcenter)
                const best = [...t.keys()].reduce((a, b) => far(b) < far(a) ? b : a)  // well inside
                const box = view.canvas_view.el.getBoundingClientRect()
                const [x, y] = [x_scale.compute(t[best]), y_scale.compute(value[best])]
                return bbox.contains(x, y) ? [box.left + x, box.top + y] : null
            }}"""
            where = page.evaluate(point)
            if where is None:  # a curve that is cut off
                continue
            x, y = where
            page.mouse.move(x - 3, y)
            page.mouse.move(x, y)
            label = page.locator(".bk-tooltip-content", has_text=" at ").locator("visible=true")
            expect(label).not_to_have_count(0)
            seen |= {each for each in runs for text in label.all_inner_texts() if each in text}
            page.mouse.move(1, 1)
            expect(label).to_have_count(0)
        if path.stem == "compare":
            assert seen == set(runs)
        assert page.evaluate("window.harmed") is None
        assert page.locator("img[src=x]").count() == 0
        text = page.text_content("main")
        assert all(name in text for name in (runs if path.stem == "compare" else hostile[1:2]))
        tab.close()
    assert script not in runs[hostile[0]]._repr_html_()


@pytest.mark.parametrize("width", [420, 1400])
def test_pages_fit_the_screen(browser: Any, width: int, tmp_path: Path) -> None:
    """Nothing sticks out at the side, every run's values are within sight, a metre is a metre both ways."""
    runs = {"null space, with a long name": "crowd", "barriers, look-ahead and as long a name": "on-path"}
    results = {name: vff.simulate(scenario, {"duration": 0.2}) for name, scenario in runs.items()}
    first = next(iter(results.values()))
    for path in (vff.compare(results, tmp_path / "compare.html"), first.report(tmp_path / "run.html")):
        tab = Tab(browser, path, width)
        assert tab.page.evaluate("document.documentElement.scrollWidth") <= width
        right = tab.page.evaluate(
            "Math.max(...[...document.querySelectorAll('.metrics td.value')]"
            ".map(cell => cell.getBoundingClientRect().right))"
        )
        assert right <= width
        metre = """() => [...Bokeh.documents[0]._all_models.values()].filter(m => m.type === 'Figure' &&
            m.renderers.some(r => (r.data_source.name || '').startsWith('joints-')))
            .map(m => [m.inner_width / (m.x_range.end - m.x_range.start),
                       m.inner_height / (m.y_range.end - m.y_range.start)])"""
        tab.page.wait_for_function(f"({metre})().every(([x, y]) => x > 10 && Math.abs(x / y - 1) < 0.02)")
        tab.close()


def test_a_report_lives_in_a_browser_without_a_network(browser: Any, tmp_path: Path) -> None:
    """No request but for the page itself, no error; slider, keys and play move arm, marks and numbers."""
    result = vff.simulate("sweep-through")
    tab = Tab(browser, result.report(tmp_path / "run.html"))
    page = tab.page

    def tip() -> list[float]:
        code = "Bokeh.documents[0].get_model_by_name('joints-0').data"
        joints = page.evaluate(f"(() => {{ const d = {code}; return [...d.x, ...d.y] }})()")
        return [float(value) for value in joints]

    def arm_at(row: int) -> Any:
        return pytest.approx(result.scenario.arm.forward_kinematics(result.q[row]).T.ravel(), abs=1e-4)

    assert tip() == arm_at(0)
    assert np.linalg.norm(result.error[0]) < 1e-12 and page.text_content("#now-error") == "0 m"
    page.evaluate("const s = document.getElementById('slider'); s.value = s.max; s.oninput;"
                  "s.dispatchEvent(new Event('input'))")  # fmt: skip
    page.wait_for_function("document.getElementById('clock').value.startsWith('4.00')")
    assert tip() == arm_at(-1)
    mark = "[...Bokeh.documents[0]._all_models.values()].filter(m => m.name === 'now').map(m => m.location)"
    assert set(page.evaluate(mark)) == {4}
    assert page.text_content("#now-clearance") == f"{1e3 * result.clearance[-1].min():.3g} mm"
    page.keyboard.press("Space")  # plays from the start
    page.wait_for_function("t => Number(document.getElementById('slider').value) > t", arg=0.2)
    page.keyboard.press("Space")
    page.select_option("#choice", label="tau_null: null-space part of the joint torque [N·m]")
    label = "Bokeh.documents[0].get_model_by_name('chosen-figure').left[0].axis_label"
    assert page.evaluate(label) == "null-space part of the joint torque [N·m]"
    tab.close()


# ------------------------------------------------------------------------------------------------ notebooks


@pytest.mark.parametrize(
    "make",
    [
        lambda: vff.Arm.uniform(1),
        lambda: vff.Arm.uniform(6, radius=0.05, gravity=9.81),
        lambda: vff.Scenario.load("crowd"),
        lambda: vff.Scenario.load("paper-1").replace(obstacles=None, name="a < b & c"),
        lambda: vff.simulate("sweep-through", {"duration": 0.5}),
    ],
    ids=["one link", "thick arm", "scenario", "free scenario", "result"],
)
def test_notebooks_show_a_picture_and_a_table(make: Any) -> None:
    """Well-formed HTML with an SVG and a table, small enough for a notebook with hundreds of cells."""
    shown = make()._repr_html_()
    root = ElementTree.fromstring(shown)
    assert root.find(".//table") is not None and len(shown) < 60_000
    assert "{http://www.w3.org/2000/svg}polyline" in {each.tag for each in root.iter()}
    assert "nan" not in shown and "inf" not in shown


def test_what_notebooks_say(short: vff.Result) -> None:
    assert "9.81" in vff.Arm.uniform(2, gravity=9.81)._repr_html_()
    assert (
        "completed" in short._repr_html_()
        and f"{short.metrics['peak_torque']:.4g} N·m" in short._repr_html_()
    )
    assert "eight discs" in vff.Scenario.load("crowd")._repr_html_()


def test_notebooks_show_figures(short: vff.Result) -> None:
    """IPython asks an object for its picture; without pyplot nobody else makes one of a Matplotlib figure."""
    figures = short.plot()
    assert isinstance(figures, dict)
    figure: Any = figures["overview"]
    picture, about = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert 300 < about["width"] < 1000
