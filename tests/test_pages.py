"""Reports, comparisons and what notebooks show: complete, self-contained, and alive in a browser."""

from __future__ import annotations

import base64
import dataclasses
import json
import re
import shutil
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, InputTypeError
from vffnull.plotting import geometry


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
        assert name in page.text and unit in page.text and meaning in page.text
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
    points, forces = geometry.pushes(result, np.arange(len(result.t)))
    joints = geometry.joints(result)
    torque = np.zeros_like(result.tau_vff)
    for joint in range(result.q.shape[1]):
        lever = points[:, joint:] - joints[:, None, joint]
        force = forces[:, joint:]
        torque[:, joint] = (lever[..., 0] * force[..., 1] - lever[..., 1] * force[..., 0]).sum(axis=1)
    assert np.abs(result.tau_vff).max() > 0.1
    np.testing.assert_allclose(torque, result.tau_vff, rtol=0, atol=1e-12 * np.abs(result.tau_vff).max())


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


def test_report_of_a_diverged_run(tmp_path: Path) -> None:
    overrides = {"simulation.control": "hold", "controller.stiffness": 1e7, "simulation.dt": 0.02}
    with pytest.warns(vff.errors.ScenarioWarning):
        result = vff.simulate("sweep-through", overrides)
    page = Page(result.report(tmp_path / "run.html"))
    assert "diverged" in page.text and squeezed(result.warnings[0]) in squeezed(page.text)
    json.dumps(page.runs, allow_nan=False)


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


def test_a_report_lives_in_a_browser_without_a_network(tmp_path: Path) -> None:
    """No request but for the page itself, no error; slider, keys and play move arm, marks and numbers."""
    playwright = pytest.importorskip("playwright.sync_api")
    executable = shutil.which("chromium")
    if executable is None:
        pytest.skip("there is no chromium")
    result = vff.simulate("sweep-through")
    path = result.report(tmp_path / "run.html")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        page = browser.new_page()
        requests: list[str] = []
        errors: list[str] = []
        page.on("request", lambda request: requests.append(request.url))
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(path.as_uri())
        page.wait_for_selector("html[data-ready=yes]")

        def tip() -> list[float]:
            code = "Bokeh.documents[0].get_model_by_name('joints-0').data"
            joints = page.evaluate(f"(() => {{ const d = {code}; return [...d.x, ...d.y] }})()")
            return [float(value) for value in joints]

        def arm_at(row: int) -> Any:
            return pytest.approx(result.scenario.arm.forward_kinematics(result.q[row]).T.ravel(), abs=1e-4)

        assert tip() == arm_at(0)
        page.evaluate("const s = document.getElementById('slider'); s.value = s.max; s.oninput;"
                      "s.dispatchEvent(new Event('input'))")  # fmt: skip
        page.wait_for_function("document.getElementById('clock').value.startsWith('4.00')")
        assert tip() == arm_at(-1)
        mark = (
            "[...Bokeh.documents[0]._all_models.values()].filter(m => m.name === 'now').map(m => m.location)"
        )
        assert set(page.evaluate(mark)) == {4}
        assert page.text_content("#now-clearance") == f"{1e3 * result.clearance[-1].min():.3g} mm"
        page.keyboard.press("Space")  # plays from the start
        page.wait_for_function("t => Number(document.getElementById('slider').value) > t", arg=0.2)
        page.keyboard.press("Space")
        page.select_option("#choice", label="tau_null: null-space part of the joint torque [N·m]")
        label = "Bokeh.documents[0].get_model_by_name('chosen-figure').left[0].axis_label"
        assert page.evaluate(label) == "null-space part of the joint torque [N·m]"
        browser.close()
    assert errors == [] and [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []


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
    figure = short.plot()["overview"]
    picture, about = figure._repr_png_()
    assert picture.startswith(b"\x89PNG")
    assert 300 < about["width"] < 1000
