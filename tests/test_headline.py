"""What a run is said to be, in the terminal, the report, a comparison, a notebook and the live page."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.draw.report.assumptions import assumptions
from vffnull.live.readouts import numbers
from vffnull.model.headline import findings, headline
from vffnull.model.outcome import seconds
from waiting import HANG, frames, wait_for

# A UR5e draws its hand to its shoulder: 6 cm into itself.
FOLDING: dict[str, Any] = {
    "duration": 2.5,
    "q0": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
    "arm": {"model": "ur5e"},
    "controller": {"stiffness": 400.0, "damping": 40.0, "null_damping": 6.0, "self_collision": "report"},
    "reference": {"kind": "line", "end": [0.1, -0.13, 0.6], "duration": 2.0},
    "simulation": {"integrator": "semi_implicit_euler"},
}


# The hand is at its place from the start, and still turns when the run ends.
TURNED: dict[str, Any] = {
    "duration": 0.02,
    "obstacles": [],
    "reference": {
        "kind": "setpoint",
        "relative": True,
        "orientation": [float(np.cos(0.2)), 0.0, 0.0, float(np.sin(0.2))],
    },
}


@pytest.fixture(scope="module")
def folded() -> vff.Result:
    return vff.simulate(FOLDING)


def test_links_inside_each_other_come_first(folded: vff.Result) -> None:
    """Named, with how deep, since when and for how long: as the record has it."""
    told = folded.headline
    assert (told.verdict, told.severity, folded.status) == ("hit itself", "bad", "completed")
    inside = folded.self_clearance < 0.0
    since, depth = folded.t[inside.argmax()], -1e3 * folded.self_clearance.min()
    assert f"were up to {depth:.3g} mm inside each other, first at t = {since:.4g} s" in told.lines[0]
    assert told.lines[0].endswith(f"for {1e-3 * inside.sum():.3g} s in all")
    pair = told.lines[0].split(" were ")[0].split(" and ")
    names = folded.scenario.arm.link_names
    assert pair[0] == names[folded.metrics.min_self_clearance_link]
    assert set(pair) <= {*names, "the base"} and len(set(pair)) == 2
    row = int(folded.self_clearance.argmin())
    assert folded.metrics.min_self_clearance_time == folded.t[row]


def test_contact_with_an_obstacle_is_told() -> None:
    """With the link, how deep, since when and for how long: as the record has it."""
    result = vff.simulate("sweep-through", {"controller.field.gain": 0.0, "simulation.record_every": 1})
    assert (result.headline.verdict, result.headline.severity) == ("collided", "bad")
    inside = result.clearance.min(axis=1) < 0.0
    link, depth = result.clearance.min(axis=0).argmin(), -1e3 * result.clearance.min()
    said = re.fullmatch(
        r"link_(\d+) was up to (\S+) mm inside an obstacle, first at t = (\S+) s, for (\S+) s in all",
        result.headline.lines[0],
    )
    assert said is not None, result.headline.lines
    assert int(said[1]) == link + 1
    told, step = [float(each) for each in said.groups()[1:]], result.scenario["simulation.dt"]
    assert told[0] == pytest.approx(depth, rel=5e-3)
    assert told[1] == pytest.approx(result.t[inside.argmax()], abs=2 * step)
    assert told[2] == pytest.approx(step * inside.sum(), abs=5e-3)


def test_what_is_not_measured_is_not_claimed() -> None:
    """Without obstacles, without a look at own links, and with both."""
    short: dict[str, Any] = {"duration": 0.1, "obstacles": []}
    alone = vff.simulate("panda-sweep", short)
    assert alone.headline.lines == ("reached its end at t = 0.1 s",)
    looked = vff.simulate("panda-sweep", {**short, "controller.self_collision": "report"})
    assert looked.headline.lines == ("reached its end at t = 0.1 s without contact of its own links",)
    among = vff.simulate("panda-sweep", {"duration": 0.1})
    assert among.headline.lines == ("reached its end at t = 0.1 s without contact with an obstacle",)
    both = vff.simulate("panda-sweep", {"duration": 0.1, "controller.self_collision": "report"})
    assert both.headline.lines == ("reached its end at t = 0.1 s without contact",)
    assert {run.headline.severity for run in (alone, looked, among, both)} == {"good"}


def test_limits_and_stops_are_told() -> None:
    """Torque, speed and stops by joint, and no word of what held."""
    ignored = {"controller.enforce_limits": False}
    stopped = vff.simulate("planner-bench-reach-3", ignored)
    assert stopped.headline.verdict == "at a stop" and stopped.headline.severity == "odd"
    limits = stopped.scenario.arm.joint_limits
    reached = (stopped.q <= limits[:, 0]) | (stopped.q >= limits[:, 1])
    assert f"joint {reached.any(axis=0).argmax()} came to its stop" in stopped.headline.lines[0]
    assert stopped.metrics.joint_limit_time == pytest.approx(
        stopped.t[reached.any(axis=1).argmax()], abs=0.01
    )

    passed = vff.simulate("planner-bench-reach-3", ignored | {"plant.joint_stops": False})
    assert "beyond its limits" in passed.headline.lines[0]

    weak = {"arm.torque_limits": 5.0, "arm.velocity_limits": 0.3, "controller.enforce_limits": False}
    result = vff.simulate("paper-1", weak)
    strongest, fastest = abs(result.tau).max(axis=0).argmax(), abs(result.dq).max(axis=0).argmax()
    assert result.headline.verdict == "over limits"
    assert f"the law asked joint {strongest} for " in result.headline.lines[0]
    assert f"the speed of joint {fastest} came to " in result.headline.lines[1]
    assert result.metrics.torque_limit_ratio == pytest.approx(abs(result.tau).max() / 5.0, rel=1e-3)


def test_a_reference_that_is_lost_is_told() -> None:
    far = {"kind": "setpoint", "point": [1.4, 0.0, 0.4], "unreachable": "warn"}
    with pytest.warns(vff.errors.ScenarioWarning, match="cannot be reached"):
        result = vff.simulate("panda-sweep", {"reference": far})
    missed = 1e3 * float((result.error[-1, :3] ** 2).sum() ** 0.5)
    assert result.metrics.end_error == pytest.approx(1e-3 * missed)
    assert any(line.startswith(f"the end effector is {missed:.3g} mm off") for line in result.headline.lines)


def test_an_orientation_that_is_lost_is_told() -> None:
    """Where the hand is at its place, and turned."""
    result = vff.simulate("panda-sweep", TURNED)
    turned = float(np.linalg.norm(result.error[-1, 3:]))
    assert np.linalg.norm(result.error[-1, :3]) < 5e-3
    assert (result.headline.verdict, result.headline.severity) == ("off reference", "odd")
    said = re.fullmatch(
        r"the end effector is turned (\S+)° from its reference at the end", result.headline.lines[0]
    )
    assert said is not None and float(said[1]) == pytest.approx(np.degrees(turned), abs=0.2)


def test_barriers_that_broke_are_told() -> None:
    result = vff.simulate("ur5e-crossed", {"simulation.record_every": 1})
    broken = f"barriers were broken in {result.metrics.slack_steps} of {result.metrics.steps} steps"
    assert result.headline.lines[0].startswith(broken) and result.headline.severity == "odd"
    assert result.metrics.steps == len(result.t)


def test_a_run_that_stops_early_says_why_first() -> None:
    stiff = {"simulation.control": "hold", "controller.stiffness": 1e7, "simulation.dt": 0.02}
    with pytest.warns(vff.errors.ScenarioWarning):
        result = vff.simulate("sweep-through", stiff)
    assert (result.headline.verdict, result.headline.severity) == ("diverged", "bad")
    assert result.headline.lines[0] == result.message


def command(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "vffnull", *map(str, arguments)]
    return subprocess.run(line, capture_output=True, text=True, timeout=HANG, cwd=cwd)


def test_all_say_the_same(folded: vff.Result, tmp_path: Path) -> None:
    """Terminal, JSON, report, comparison and notebook; ``--strict`` ends with 3."""
    folded.scenario.save(tmp_path / "folding.toml")
    printed = command("run", "folding.toml", "--strict", cwd=tmp_path)
    assert printed.returncode == 3 and f"hit itself: {folded.headline.lines[0]}" in printed.stdout
    as_json = command("run", "folding.toml", "--json", cwd=tmp_path)
    assert as_json.returncode == 0
    assert json.loads(as_json.stdout)["verdict"] == "hit itself"
    assert folded.headline.lines[0] in json.loads(as_json.stdout)["message"]
    for page in (folded.report(tmp_path / "a.html"), vff.compare([folded, folded], tmp_path / "b.html")):
        text = page.read_text(encoding="utf-8")
        assert '<span class="badge bad">hit itself</span>' in text and folded.headline.lines[0] in text
    assert folded.headline.lines[0] in folded._repr_html_()


ODD: dict[str, tuple[str, dict[str, Any]]] = {
    "at a stop": ("planner-bench-reach-3", {"controller.enforce_limits": False}),
    "over limits": (
        "paper-1",
        {
            "duration": 0.2,
            "arm.torque_limits": 5.0,
            "controller.enforce_limits": False,
            "reference.unreachable": "warn",
        },
    ),
    "barrier broken": ("ur5e-crossed", {}),
    "off reference": ("panda-sweep", TURNED),
}


@pytest.mark.parametrize("verdict", ODD)
def test_strict_covers_what_is_odd(verdict: str, tmp_path: Path) -> None:
    """Exit code 3 under ``--strict`` and 0 without; the badge is neither green nor red."""
    name, changes = ODD[verdict]
    scenario = vff.Scenario.load(name).replace(**changes)
    scenario.save(tmp_path / "odd.toml")
    codes = [
        command("run", "odd.toml", *strict, "--save", "run.npz", cwd=tmp_path).returncode
        for strict in ([], ["--strict"])
    ]
    assert codes == [0, 3]
    result = vff.Result.load(tmp_path / "run.npz")
    assert (result.headline.verdict, result.headline.severity) == (verdict, "odd")
    pages = result.report(tmp_path / "a.html"), vff.compare([result, result], tmp_path / "b.html")
    for page in pages:
        assert f'<span class="badge odd">{verdict}</span>' in page.read_text(encoding="utf-8")


def test_a_run_in_which_all_is_well(short: vff.Result, tmp_path: Path) -> None:
    done = command("run", "sweep-through", "--set", "duration=0.5", "--strict", cwd=tmp_path)
    assert done.returncode == 0 and "completed: reached its end" in done.stdout
    for page in (short.report(tmp_path / "a.html"), vff.compare([short, short], tmp_path / "b.html")):
        assert '<span class="badge good">completed</span>' in page.read_text(encoding="utf-8")


def test_files_of_a_run_say_the_same(folded: vff.Result, tmp_path: Path) -> None:
    assert vff.Result.load(folded.save(tmp_path / "run.npz")).headline == folded.headline


def test_the_page_says_it_too() -> None:
    """The core measures it in a loop that goes on, and the read-out tells it."""
    live = vff._core.Live(FOLDING)
    assert live.snapshot()["metrics"]["self_collision_time"] is None
    facts = {**live.snapshot()["metrics"], "self_collision_time": 1.0, "min_self_clearance": -0.02}
    found = list(findings(facts, vff.simulate(FOLDING | {"duration": 0.01}).scenario.arm))
    text = numbers({**live.snapshot(), "found": found})
    assert "<b>hit itself</b>" in text and "20 mm inside each other" in text


def test_the_page_tells_of_its_own_loop(tmp_path: Path) -> None:
    """The arm is folded into itself by the loop of the page, and the read-out names the pair."""
    pytest.importorskip("viser")
    page = vff.live(vff.Scenario.from_dict(FOLDING), open_browser=False, block=False, record_to=tmp_path)
    try:
        assert "hit itself" not in page._panel._numbers.content
        wait_for(lambda: page.snapshot()["metrics"]["self_collision_time"] is not None, "contact")
        frames(page)
        wait_for(lambda: "<b>hit itself</b>" in page._panel._numbers.content, "the sentence")
        names = (*page.scenario.arm.link_names, "the base")
        said = re.search(r"hit itself</b>: (\S+) and (.+?) were up to", page._panel._numbers.content)
        assert said is not None and {said[1], said[2]} <= set(names)
    finally:
        page.stop()


def test_what_may_pass_through_an_obstacle_is_not_said_to_be_clear(tmp_path: Path) -> None:
    """A link that ignores an obstacle goes through it unmeasured; headline and report say so, by its name."""
    changes = {"controller.field.gain": 0.0, "obstacles.0.ignore": ["link_3"]}
    result = vff.simulate("sweep-through", changes)
    assert result.headline.verdict == "completed"
    end = "without contact with an obstacle, but for what link_3 may touch"
    assert result.headline.lines[0].endswith(end)
    text = result.report(tmp_path / "a.html").read_text(encoding="utf-8")
    assert "link_3 may pass through obstacle 1: neither avoided nor measured." in text
    hit = vff.simulate("sweep-through", {"controller.field.gain": 0.0})
    name = hit.headline.lines[0].split(" was up to ")[0]
    assert name in hit.scenario.arm.link_names
    free = vff.simulate("sweep-through", {"controller.field.gain": 0.0, "obstacles.0.ignore": [name]})
    assert name in free.headline.lines[0] and free.metrics.min_clearance > hit.metrics.min_clearance


def test_metrics_call_links_as_a_scenario_does() -> None:
    """In the plane, of a bundled arm, and of an arm of one's own; also where a result is loaded."""
    for name in ("sweep-through", "panda-sweep", "lift-cage"):
        result = vff.simulate(name, {"duration": 0.02})
        links = result.scenario.arm.link_names
        assert result.layout.links == tuple(links)
        link = links[result.metrics.min_clearance_link]
        assert f"counted from 0 at the base: {link}\n" in str(result.metrics)


def test_an_interrupted_run_that_collided_has_collided() -> None:
    """The word is said once, and contact comes before it."""
    result = vff.simulate("sweep-through", {"controller.field.gain": 0.0})
    message = "interrupted at t = 2.288 s"
    told = headline("interrupted", message, result.metrics, result.scenario.arm)
    assert (told.verdict, told.severity, told.lines[-1]) == ("collided", "bad", message)
    calm = headline("interrupted", message, {}, result.scenario.arm)
    assert str(calm) == "interrupted: stopped at t = 2.288 s"


def test_a_contact_that_is_felt_may_be_beyond_the_link() -> None:
    """As the metric is defined."""
    facts = {"touched_time": 1.0, "touched_link": 0}
    (found,) = findings(facts, vff.Scenario.load("panda-bump").arm)
    assert found.text == "a contact was felt on panda_link1 or beyond it, first at t = 1 s"


def test_general_assumptions_leave_out_what_is_particular(tmp_path: Path) -> None:
    """And in a comparison, what does not hold for all runs names those for which it does."""
    short = {"duration": 0.05}
    wiped, swept = vff.simulate("panda-wipe", short), vff.simulate("panda-sweep", short)
    told = assumptions(wiped)
    assert any("passes through all of them but obstacle 1 without a contact force" in line for line in told)
    assert "Obstacle 1: felt by links that press into them, with friction." in told
    bumped = assumptions(vff.simulate("panda-bump", short))
    assert any("velocity of all other obstacles; nobody has told it of obstacle 1" in each for each in bumped)
    text = vff.compare({"wipe": wiped, "sweep": swept}, tmp_path / "b.html").read_text(encoding="utf-8")
    assert "<li>wipe: Obstacle 1: felt by links" in text
    assert "<li>sweep: Obstacles move as the scenario says and do not feel the arm;" in text
    assert "<li>Rigid links in space" in text


def test_a_reference_that_has_not_come_to_its_end_is_told() -> None:
    """By another plan or by a governor that made it wait it is odd; one that is as long from the start is as
    somebody wants it. A run that was stopped has come to no end at all.
    """
    arm = vff.Scenario.load("sweep-through").arm

    def told(status: str = "completed", **facts: Any) -> tuple[str, str, str]:
        found = headline(status, "reached its end at t = 3 s", facts, arm)
        return found.verdict, found.severity, "; ".join(found.lines)

    end = "reached its end at t = 3 s"
    for over in ({}, {"end_time_left": None}, {"end_time_left": 0.0, "end_delay": 1.0, "replans": 2}):
        assert told(**over) == ("completed", "good", end)
    assert told(end_time_left=2.5) == ("completed", "good", f"{end}; the reference had 2.5 s to go")
    assert told(end_time_left=2.5, end_delay=1.0)[1] == "good"
    late = f"the reference, which waited for 2.6 s, had 2.5 s to go at the end; {end}"
    assert told(end_time_left=2.5, end_delay=2.6) == ("not at its end", "odd", late)
    new = f"the new plan had 2.5 s to go at the end; {end}"
    assert told(end_time_left=2.5, replans=1) == ("not at its end", "odd", new)
    assert "to go" not in told("interrupted", end_time_left=2.5, replans=1)[2]


def test_times_of_computing_are_read_easily() -> None:
    assert [seconds(each) for each in (1.29, 0.9999, 0.0123, 1234.0)] == [
        "1.29 s",
        "1 s",
        "12.3 ms",
        "1234 s",
    ]


def test_a_task_that_was_given_up_on_the_way_is_told_of() -> None:
    """A hand that has let go of a reference that it had reached; one that begins elsewhere has not."""
    gave_way = vff.simulate("on-path", {"controller.avoidance": "relaxed"})
    error = np.linalg.norm(gave_way.error[:, :2], axis=1)
    lost = error[np.argmax(error <= 0.01) :].max()
    assert gave_way.metrics["max_error_lost"] == pytest.approx(lost, rel=1e-2) and lost > 1.0
    assert f"was up to {lost:.2f} m off its reference" in str(gave_way.headline)
    begins = vff.simulate(
        "on-path", {"obstacles": [], "reference": {"kind": "setpoint", "point": [4.0, 2.0]}}
    )
    assert begins.metrics["max_error_transient"] > 0.1 and "off its reference" not in str(begins.headline)
