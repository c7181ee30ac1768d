"""Controllers against each other: rates, intervals, rows, tables, files, and the command."""

from __future__ import annotations

import csv
import dataclasses
import json
import math
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

import vffnull as vff
from vffnull import evaluation
from vffnull.errors import InputError, InputTypeError
from vffnull.evaluation import scenes
from vffnull.run import evaluate as run

PAIR = ("no avoidance", "cbf")


@pytest.fixture(scope="module")
def outcome() -> vff.Evaluation:
    return vff.evaluate(category=scenes.FAMILIES, n=4, count=2, seed=0, threads=2)


def test_wilson_interval() -> None:
    """Newcombe, Statistics in Medicine 17 (1998), table I: 81/263, 15/148, 0/20, 1/29 by Wilson's score."""
    for count, total, low, high in [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ]:
        rate = evaluation.wilson(count, total)
        assert rate.value == count / total
        assert (rate.low, rate.high) == pytest.approx((low, high), abs=5e-5)
    assert math.isnan(evaluation.wilson(0, 0).value) and str(evaluation.wilson(0, 0)) == "–"
    assert str(evaluation.wilson(81, 263)) == "30.8 [25.5, 36.6]"


def test_one_row_per_scene_and_controller(outcome: vff.Evaluation) -> None:
    assert tuple(evaluation.CONTROLLERS) == outcome.controllers
    assert len(outcome) == 4 * 2 * len(evaluation.CONTROLLERS)
    pairs = set(zip(outcome.columns["scene"], outcome.columns["controller"], strict=True))
    assert len(pairs) == len(outcome)
    assert outcome.families == list(scenes.FAMILIES)
    assert set(outcome.where(family="links-swept").columns["category"]) == {1}
    assert set(outcome.where(family="crowd").columns["category"]) == {2}


def test_rows_do_not_depend_on_threads(outcome: vff.Evaluation) -> None:
    """Bit for bit, and known verdicts are taken as they are."""
    one = vff.evaluate(category=scenes.FAMILIES, n=4, count=2, seed=0, threads=1, verdicts=outcome.verdicts)
    for name, column in outcome.columns.items():
        np.testing.assert_array_equal(column, one.columns[name])
    told = vff.evaluate("cbf", 1, 4, 1, 0, verdicts={"links-swept-4-0": "none found"})
    assert told.verdicts == {"links-swept-4-0": "none found"}


def test_a_scene_of_two_kinds_is_run_once() -> None:
    """Category 2 draws crowds, too; an interval of scenes that count twice would be too narrow."""
    one = vff.evaluate("cbf", ["crowd", 2, 2], [4, 4], 3, 0)
    assert len(set(one.columns["scene"])) == len(one)
    assert f"**crowd**: {len(one.where(family='crowd'))} scenes" in one.table()


def test_tables_and_figures_of_some_rows(outcome: vff.Evaluation, tmp_path: Path) -> None:
    """Of one controller, of parts with different ones, and of none."""
    some = outcome.where(controller="cbf")
    assert some.controllers == ("cbf",)
    assert "| cbf |" in some.table() and "no avoidance" not in some.table()
    assert len(some.plot(tmp_path)) == 3
    parts = run.join([some.where(family="crowd"), outcome.where(controller="relaxed", family="links-swept")])
    assert parts.controllers == ("cbf", "relaxed") and "2 scenes" in parts.table()
    assert len(parts.plot(tmp_path)) == 3
    nothing = outcome.where(n=5)
    assert nothing.table() == ""
    with pytest.raises(InputError, match="no rows to draw"):
        nothing.plot(tmp_path)
    with pytest.raises(InputError, match="join"):
        run.join([])


def test_a_row_says_what_the_run_was(outcome: vff.Evaluation) -> None:
    """Against the run itself, recorded at every step."""
    for family in scenes.FAMILIES:
        scene = scenes.random(family, 4, 1)
        result = vff.simulate(scene, evaluation.CONTROLLERS["cbf"])
        row = {
            key: column[0]
            for key, column in outcome.where(scene=scene.name, controller="cbf").columns.items()
        }
        error = np.linalg.norm(result.error, axis=1)
        assert row["status"] == result.status and row["feasibility"] == vff.feasibility(scene)
        assert row["min_clearance"] == pytest.approx(result.clearance.min(), abs=1e-12)
        assert row["max_error"] == pytest.approx(error.max(), rel=1e-9)
        assert row["collided"] == (result.clearance.min() < -1e-3)
        assert row["success"] == (not row["collided"] and error.max() <= 1e-2)
        free = vff.simulate(scene, {"controller.field.gain": 0.0})
        near = free.t[free.clearance.min(axis=1) < 0.1]
        if len(near):
            during = error[(result.t >= near[0]) & (result.t <= near[-1])]
            rms = np.sqrt(np.mean(during**2))
            assert row["rms_error_during"] == pytest.approx(rms, rel=0.02, abs=1e-9)


def test_recovery_is_when_the_tip_is_back_for_good() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    assert run._recovery(t, np.array([0.1, 0.0, 0.1, 0.005, 0.0])) == 3.0
    assert run._recovery(t, np.zeros(5)) == 0.0
    assert math.isnan(run._recovery(t, np.full(5, 0.02)))


def test_avoidance_decides(outcome: vff.Evaluation) -> None:
    """On these scenes the arm is hit without avoidance, and less with cbf where there is an escape."""
    free, cbf = (outcome.where(controller=name).feasible for name in PAIR)
    assert free.rate("collided").count > cbf.rate("collided").count
    crossed = outcome.where(family="path-crossed")
    assert crossed.where(controller="null-space field").rate("collided").value == 1.0
    assert crossed.rate("success").count == 0  # the path itself is blocked


def test_table_names_every_controller_with_its_interval(outcome: vff.Evaluation) -> None:
    table = outcome.table()
    assert table.count("| cbf |") == 2 * len(scenes.FAMILIES)  # rates, and medians
    assert "**crowd**: 2 scenes, escape:" in table
    rate = outcome.where(family="crowd", controller="relaxed").rate("collided")
    assert f"| relaxed | {rate} |" in table


def test_files_and_figures(outcome: vff.Evaluation, tmp_path: Path) -> None:
    with outcome.save(tmp_path / "rows.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(outcome) and rows[0]["controller"] == "no avoidance"
    assert float(rows[-1]["min_clearance"]) == outcome.columns["min_clearance"][-1]
    import pandas as pd

    frame = pd.read_parquet(outcome.save(tmp_path / "rows.parquet"))
    assert list(frame.columns) == list(outcome.columns) and len(frame) == len(outcome)
    for picture in outcome.plot(tmp_path):
        assert picture.read_bytes().startswith(b"\x89PNG")
    with pytest.raises(InputError, match=r"rows are written as \.csv or \.parquet"):
        outcome.save(tmp_path / "rows.txt")


def test_joined_rows_are_all_rows(outcome: vff.Evaluation) -> None:
    parts = [outcome.where(controller=name) for name in reversed(outcome.controllers)]
    both = run.join(parts)
    assert len(both) == len(outcome) and both.controllers == outcome.controllers[::-1]


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"controllers": ["cbff"]}, InputError, "controllers: expected some of no avoidance"),
        ({"controllers": []}, InputError, "controllers: at least one is needed"),
        ({"count": 0}, InputError, "count: must be from 1 to 1000000, got 0"),
        ({"count": 2**80}, InputError, "count: must be from 1"),
        ({"seed": -1}, InputError, "seed: must be from 0"),
        ({"threads": 0}, InputError, "threads: must be from 1 to 1024, got 0"),
        ({"threads": 1.5}, InputTypeError, "threads: expected a whole number"),
        ({"controllers": 3}, InputTypeError, "controllers: expected names"),
        ({"count": 1.5}, InputTypeError, "count: expected a whole number, not a float"),
        ({"n": []}, InputError, "no category or no number of joints"),
        ({"category": "x"}, InputError, "category: expected 1, 2 or one of"),
        (
            {"controllers": {"mine": {"controller.x": 1}}, "count": 1},
            vff.errors.ScenarioError,
            "unknown key `x`",
        ),
    ],
)
def test_wrong_arguments_are_named(arguments: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        vff.evaluate(**({"category": 1, "n": 4, "count": 1, "seed": 0} | arguments))


def test_other_controllers_may_be_given() -> None:
    mine = {"mine": {"controller.avoidance": "cbf", "controller.yielding.margin": 0.1}}
    found = vff.evaluate(mine, category="path-crossed", n=4, count=1, seed=0)
    assert found.controllers == ("mine",) and list(found.columns["controller"]) == ["mine"]


def test_command(tmp_path: Path) -> None:
    """`vffnull evaluate` prints the table and writes rows and figures."""
    arguments = ["evaluate", "--category", "clutter", "-n", "4", "--count", "1", "--seed", "0"]
    arguments += ["--controller", "cbf", "--save", str(tmp_path / "rows.csv"), "--plot", str(tmp_path)]
    done = subprocess.run([sys.executable, "-m", "vffnull", *arguments], capture_output=True, text=True)
    assert done.returncode == 0 and "| cbf |" in done.stdout, done.stderr
    assert {file.name for file in tmp_path.iterdir()} == {
        "rows.csv",
        "rates.png",
        "clearance.png",
        "error.png",
    }


def test_command_as_json() -> None:
    """The counts of `vff.evaluate`, with its intervals."""
    arguments = ["evaluate", "--category", "clutter", "-n", "4", "--count", "3", "--seed", "0", "--json"]
    arguments += ["--controller", "no avoidance"]
    done = subprocess.run([sys.executable, "-m", "vffnull", *arguments], capture_output=True, text=True)
    told = json.loads(done.stdout)["clutter"]["no avoidance"]
    outcome = vff.evaluate("no avoidance", "clutter", 4, 3, 0)
    rate = outcome.rate("collided")
    assert told["collisions"] == {"count": rate.count, "total": 3, "interval": [rate.low, rate.high]}
    assert told["success_feasible_with_tip"]["total"] == len(outcome.where(feasibility="with tip"))


# -------------------------------------------------------------------------------------------------- in space


@pytest.fixture(scope="module")
def in_space() -> vff.Evaluation:
    return vff.evaluate(
        ("no avoidance", "null-space field", "cbf"), count=1, seed=1, threads=2, space=True, arm="panda"
    )


def test_scenes_in_space_have_arm_and_task(in_space: vff.Evaluation) -> None:
    """One row per scene and controller; what a row says is what the run was."""
    assert len(in_space) == 4 * 2 * 3 and "n" not in in_space.columns
    assert set(in_space.columns["arm"]) == {"panda"}
    assert set(in_space.columns["task"]) == {"position", "pose"}
    assert in_space.families == list(scenes.FAMILIES)
    for family in scenes.FAMILIES:
        scene = scenes.in_space(family, "panda", "pose", 1)
        result = vff.simulate(scene, evaluation.CONTROLLERS["cbf"])
        rows = in_space.where(scene=scene.name, controller="cbf").columns
        row = {key: column[0] for key, column in rows.items()}
        error, angle = (np.linalg.norm(part, axis=1) for part in np.split(result.error, 2, axis=1))
        assert row["seed"] == 1 and row["feasibility"] == vff.feasibility(scene)
        assert row["min_clearance"] == pytest.approx(result.clearance.min(), abs=1e-12)
        assert row["max_error"] == pytest.approx(error.max(), rel=1e-9)
        assert row["max_angle"] == pytest.approx(angle.max(), rel=0.01, abs=1e-6)
        clear = result.clearance.min() >= -1e-3
        assert row["success"] == (clear and error.max() <= 1e-2 and angle.max() <= 5e-2)
        assert row["returned"] == (clear and error[-1] <= 1e-2 and angle[-1] <= 5e-2)
    position = in_space.where(task="position").columns
    assert np.isnan(position["max_angle"].astype(float)).all()


def test_avoidance_decides_in_space(in_space: vff.Evaluation) -> None:
    hits = [in_space.where(controller=name).rate("collided").count for name in in_space.controllers]
    assert hits[0] > hits[1] >= hits[2]


def test_an_angle_beyond_its_bound_is_no_success() -> None:
    """Against a position alone: what counts is the worse of the two, and the end of the run."""
    t = np.linspace(0.0, 1.0, 5)
    given = {
        "status": "completed",
        "t": t,
        "error": np.zeros(5),
        "span": (0.0, 0.3),
        "min_clearance": 0.1,
        "max_error": 0.0,
        "effort": 1.0,
        "rms_jerk": 1.0,
        "end_time": 1.0,
    }
    straight = run.scores(**given)
    assert straight["success"] and straight["returned"] and np.isnan(straight["max_angle"])
    turned = run.scores(**given, angle=np.array([0.0, 0.06, 0.06, 0.02, 0.0]))
    assert not turned["success"] and turned["returned"]
    assert turned["max_angle"] == 0.06 and turned["recovery_time"] == pytest.approx(0.45)
    gone = run.scores(**given, angle=np.full(5, 0.06))
    assert not gone["returned"] and math.isnan(gone["recovery_time"])
    hit = run.scores(**(given | {"min_clearance": -0.01}))
    assert not hit["success"] and not hit["returned"]


def test_tables_and_figures_of_space(in_space: vff.Evaluation, tmp_path: Path) -> None:
    assert "**crowd**: 2 scenes, escape:" in in_space.table()
    for picture in in_space.plot(tmp_path, "svg"):
        assert picture.stat().st_size > 10_000
    with in_space.save(tmp_path / "rows.csv").open(encoding="utf-8", newline="") as file:
        assert next(csv.DictReader(file))["arm"] == "panda"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"arm": "puma"}, "arm: expected one of panda, iiwa14, ur5e, xarm7, gen3, not 'puma'"),
        ({"arm": ()}, "no family, no arm or no task"),
        ({"task": "poses"}, "task: expected one of position, pointing, pose"),
        ({"category": "swept"}, "family: expected one of links-swept"),
        ({"category": 3}, "family: expected one of links-swept"),
    ],
)
def test_wrong_arguments_in_space_are_named(arguments: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        vff.evaluate(**({"count": 1, "seed": 0, "space": True} | arguments))


def test_command_in_space(tmp_path: Path) -> None:
    arguments = ["--space", "--arm", "ur5e", "--task", "position", "--category", "crowd", "--count", "1"]
    arguments += ["--seed", "0", "--controller", "cbf", "--json"]
    command = [sys.executable, "-m", "vffnull", "evaluate"]
    done = subprocess.run([*command, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)["crowd"]["cbf"]
    outcome = vff.evaluate("cbf", "crowd", count=1, seed=0, space=True, arm="ur5e", task="position")
    assert told["returned_feasible"]["count"] == outcome.feasible.rate("returned").count
    for wrong in (["--arm", "panda"], ["--space", "-n", "4"]):
        done = subprocess.run([*command, *wrong], capture_output=True, text=True)
        assert done.returncode == 2 and "--space" in done.stderr


# --------------------------------------------------------------------------------------------------- Ctrl-C


def test_an_interrupted_run_makes_the_evaluation_interrupted(monkeypatch: pytest.MonkeyPatch) -> None:
    """The core ends its runs with what there is; that must not be counted as what a controller did."""

    def cut(*arguments: object) -> list[vff.Result]:
        first, *others = vff.simulate_many(*arguments)  # type: ignore[arg-type]
        return [dataclasses.replace(first, status=vff.Status.INTERRUPTED), *others]

    monkeypatch.setattr(run, "simulate_many", cut)
    with pytest.raises(KeyboardInterrupt):
        vff.evaluate("cbf", "crowd", 4, 2, 0, verdicts={f"crowd-4-{i}": "with tip" for i in range(2)})


INTERRUPTED = """
import os, signal, sys, threading
from vffnull.cli import main
from vffnull.run import evaluate as run

def interrupting(work):
    def begun(*arguments):
        threading.Thread(target=os.kill, args=(os.getpid(), signal.SIGINT)).start()
        return work(*arguments)
    return begun

name = sys.argv.pop(1)
setattr(run, name, interrupting(getattr(run, name)))
main()
"""


@pytest.mark.parametrize("where", ["feasibility", "simulate_many"])
def test_ctrl_c_ends_the_command(where: str, tmp_path: Path) -> None:
    """While scenes are judged, and while they run: exit code 130, no table, no file, no traceback."""
    count = {"feasibility": 48, "simulate_many": 2}[where]  # scenes that are judged before the runs begin
    arguments = ["evaluate", "--category", "crowd", "-n", "4", "--count", str(count), "--seed", "0"]
    arguments += ["--save", str(tmp_path / "rows.csv"), "--threads", "1"]
    command = [sys.executable, "-c", INTERRUPTED, where, *arguments]
    done = subprocess.run(command, capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, ""), done.stderr
    assert "Traceback" not in done.stderr and list(tmp_path.iterdir()) == []


def test_ctrl_c_does_not_begin_another_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """What was not begun is not judged any more; the searches that run end by themselves."""
    begun: list[str] = []

    def judge(scene: vff.Scenario) -> str:
        begun.append(scene.name)
        if len(begun) == 1:
            signal.raise_signal(signal.SIGINT)
        release.wait()
        return "with tip"

    release = threading.Event()
    monkeypatch.setattr(run, "feasibility", judge)
    with pytest.raises(KeyboardInterrupt):
        vff.evaluate("cbf", "crowd", 4, 20, 0, threads=2)
    assert len(begun) <= 2
    release.set()
