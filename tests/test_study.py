"""Studies: what a document means, that every run is that of `simulate`, and what is left to be read."""

from __future__ import annotations

import copy
import json
import os
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.cli import main
from vffnull.errors import InputError, InputTypeError, ScenarioError, VffNullError
from vffnull.studies import Dataset, Study, studies
from vffnull.studies.designs import DESIGNS
from vffnull.studies.effects import bins_of, effect, explained, front, indices

pytest.importorskip("pyarrow")
import pyarrow.dataset
import pyarrow.parquet

GAIN = {"key": "controller.field.gain", "name": "gain", "unit": "N·m³", "range": [0.01, 3.0], "scale": "log"}
SPEED = {"key": "obstacles.0.motion.velocity", "name": "speed", "values": [[0.0, -0.5], [0.0, -0.3]]}
LAW = {
    "name": "law",
    "choices": {
        "field": {"controller.avoidance": "null_space"},
        "cbf": {"controller.avoidance": "cbf", "controller.yielding.rate": 30.0},
    },
}
DOCUMENT: dict[str, Any] = {
    "name": "short",
    "scenario": "sweep-through",
    "seed": 7,
    "overrides": {"duration": 0.05, "obstacles.0.position": [1.6, 1.9]},
    "factors": [GAIN, SPEED, LAW],
    "design": {"kind": "sobol", "count": 16},
    "block": {"runs": 3},
}


def changed(**changes: Any) -> dict[str, Any]:
    """The document with other keys; None removes one."""
    document = copy.deepcopy(DOCUMENT) | changes
    return {key: value for key, value in document.items() if value is not None}


def parts(place: Path) -> dict[str, bytes]:
    """All parts of a dataset, and its manifest; nothing else may be there."""
    found = {
        str(path.relative_to(place)): path.read_bytes()
        for path in sorted(place.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }
    assert all(name == "study.json" or name.startswith(("runs/part-", "records/part-")) for name in found), (
        found
    )
    return found


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The dataset of the short study, run once from beginning to end."""
    place = tmp_path_factory.mktemp("undisturbed") / "results"
    Study(DOCUMENT).run(place, threads=1)
    return place


# -------------------------------------------------------------------------------------------------- designs


@pytest.mark.parametrize("kind", DESIGNS)
def test_a_stretch_of_a_design_is_a_part_of_all_of_it(kind: str) -> None:
    """Whatever stretch is asked for, in whatever order: the points are those of the whole design."""
    of: dict[str, Any] = {"count": 2100} if kind not in ("grid", "table") else {}
    if kind == "table":
        of = {"rows": [[0.01 * (1 + i), [0.0, -0.3], "cbf"] for i in range(250)]}
    if kind == "saltelli":
        of = {"count": 128}
    document = changed(design={"kind": kind, **of})
    design = Study(document)._plan.design
    assert design is not None
    every = design.rows(0, design.count)
    assert every.shape == (design.count, 3) and np.all(np.isfinite(every))
    for first, last in (
        (0, 0),
        (3, 10),
        (9, 30),
        (0, 7),
        (design.count - 5, design.count),
        (1, design.count),
    ):
        last = min(last, design.count)
        np.testing.assert_array_equal(design.rows(min(first, last), last), every[min(first, last) : last])
    again = Study(document)._plan.design
    assert again is not None
    np.testing.assert_array_equal(again.rows(0, design.count), every)


def test_a_grid_has_all_combinations() -> None:
    design = Study(changed(design={"kind": "grid", "levels": 4}))._plan.design
    assert design is not None and design.count == 4 * 2 * 2
    rows = design.rows(0, 16)
    assert len({tuple(row) for row in rows}) == 16
    np.testing.assert_allclose(np.unique(rows[:, 0]), np.geomspace(0.01, 3.0, 4))


def test_designs_are_spread_as_they_should_be() -> None:
    """A point in every layer of a Latin hypercube; Sobol's sequence is SciPy's; a range of whole numbers."""
    from scipy.stats import qmc

    plan = Study(changed(design={"kind": "latin-hypercube", "count": 50}))._plan
    assert plan.design is not None
    shares = np.log(plan.design.rows(0, 50)[:, 0] / 0.01) / np.log(300)
    assert sorted(np.floor(shares * 50)) == list(range(50))
    plan = Study(DOCUMENT)._plan
    assert plan.design is not None
    shares = np.log(plan.design.rows(0, 16)[:, 0] / 0.01) / np.log(300)
    random = np.random.default_rng(np.random.SeedSequence(7, spawn_key=(0,)))
    np.testing.assert_allclose(shares, qmc.Sobol(3, rng=random).random(16)[:, 0], atol=1e-12)
    whole = {"key": "simulation.control_every", "range": [1, 4], "whole": True}
    plan = Study(changed(factors=[whole], design={"kind": "random", "count": 400}))._plan
    assert plan.design is not None
    values, counts = np.unique(plan.design.rows(0, 400), return_counts=True)
    assert values.tolist() == [1, 2, 3, 4] and counts.min() > 60


def test_saltelli_changes_one_column_at_a_time() -> None:
    design = Study(changed(design={"kind": "saltelli", "count": 8}))._plan.design
    assert design is not None and design.count == 8 * 5
    for base in design.rows(0, 40).reshape(8, 5, 3):
        a, *mixed, b = base
        for i, row in enumerate(mixed):
            expected = a.copy()
            expected[i] = b[i]
            np.testing.assert_array_equal(row, expected)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_table_in_a_file(ending: str, tmp_path: Path) -> None:
    """Columns by their names; a factor without bounds takes those of its column."""
    columns = {"law": ["cbf", "field"], "gain": [0.5, 2.5], "left": [1, 2]}
    if ending == "csv":
        lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
        (tmp_path / "points.csv").write_text("\n".join(lines), encoding="utf-8")
    else:
        pyarrow.parquet.write_table(pyarrow.table(columns), tmp_path / "points.parquet")
    free = {"key": "controller.field.gain", "name": "gain"}
    document = changed(factors=[free, LAW], design={"kind": "table", "file": f"points.{ending}"})
    study = Study(document, tmp_path)
    assert study.points == 2
    assert study.scenario(0)["controller.field.gain"] == 0.5
    assert study.scenario(0)["controller.avoidance"] == "cbf"
    assert study.scenario(1)["controller.field.gain"] == 2.5
    assert Study(study.to_dict())._plan.digest == study._plan.digest


# ------------------------------------------------------------------------------------------------ documents


def test_the_document_is_complete(tmp_path: Path) -> None:
    """Read again, from anywhere, it is the same study; what has no say in the runs has none in its digest."""
    vff.Scenario.load("sweep-through").save(tmp_path / "mine.toml")
    beside = Study(changed(scenario="mine.toml"), tmp_path)
    for study in (Study(DOCUMENT), beside, Study(changed(tune=TUNE))):
        again = Study(json.loads(json.dumps(study.to_dict())))
        assert again.to_dict() == study.to_dict() and again._plan.digest == study._plan.digest
    assert Study(changed(name="other"))._plan.digest == Study(DOCUMENT)._plan.digest
    digests = {
        Study(changed(**each))._plan.digest
        for each in ({}, {"seed": 8}, {"repetitions": 2}, {"block": {"runs": 4}}, {"metrics": ["effort"]})
    }
    assert len(digests) == 5


TUNE = {
    "trials": 5,
    "batch": 2,
    "objectives": [{"metric": "min_clearance", "direction": "maximize", "over": "min"}],
}

WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "unknown": ({"factor": []}, "study: unknown key `factor`, did you mean `factors`?"),
    "no base": ({"scenario": None}, "study: expected one of `scenario`, `scenes`, got none"),
    "both": ({"scenes": {"count": 1}}, "study: expected one of `scenario`, `scenes`, got `scenario` and"),
    "name": ({"scenario": "sweep-trough"}, "did you mean 'sweep-through'"),
    "key": (
        {"factors": [{"key": "controller.field.gian", "range": [1, 2]}]},
        "factors[0]: controller.field: unknown key `gian`",
    ),
    "hint": ({"factors": [{"key": "field.gain", "range": [1, 2]}]}, "did you mean controller.field.gain"),
    "list": (
        {"factors": [{"key": "obstacles.4.radius", "range": [1, 2]}]},
        "factors[0]: obstacles.4.radius: no list",
    ),
    "range": ({"factors": [{**GAIN, "range": [3, 1]}]}, "factors[0].range: expected the lower end first"),
    "ends": ({"factors": [{**GAIN, "range": [3]}]}, "factors[0].range: expected two numbers"),
    "log": (
        {"factors": [{**GAIN, "range": [0, 1]}]},
        "factors[0].range: a scale of logarithms starts above 0",
    ),
    "scale": ({"factors": [{**GAIN, "scale": "lag"}]}, "factors[0].scale: no 'lag', did you mean 'log'?"),
    "spread": (
        {"factors": [{"key": "duration"}]},
        "factors[0]: expected one of `range`, `values`, `choices`",
    ),
    "twice": (
        {"factors": [GAIN, {**GAIN, "name": "b"}]},
        "factors[1]: controller.field.gain is changed by gain, too",
    ),
    "whole": (
        {"factors": [GAIN, {"key": "controller.field", "values": [{"gain": 1.0}, {"gain": 2.0}]}]},
        "factors[1]: controller.field takes the place of controller.field.gain, which gain changes before",
    ),
    "brackets": (
        {
            "factors": [
                {"key": "obstacles[0].position[0]", "values": [1.0, 2.0]},
                {"key": "obstacles.0.position", "values": [[1.0, 2.0], [2.0, 1.0]]},
            ]
        },
        "factors[1]: obstacles.0.position takes the place of obstacles.0.position.0",
    ),
    "text": (
        {"factors": [{"name": "a", "choices": {1: {"duration": 1.0}, "1": {"duration": 2.0}}}]},
        "factors[0].choices: two names are the same as text",
    ),
    "column": (
        {"factors": [{**GAIN, "name": "effort"}]},
        "factors[0].name: 'effort' is the name of another column",
    ),
    "seed": ({"overrides": {"seed": 3}}, "overrides.seed: the study gives every run a seed of its own"),
    "kind": ({"design": {"kind": "sobel"}}, "design.kind: no 'sobel', did you mean 'sobol'?"),
    "count": ({"design": {"kind": "random"}}, "design.count: missing"),
    "none": ({"design": {"kind": "random", "count": 0}}, "design.count: must be from 1"),
    "metric": (
        {"metrics": ["min_clearence"]},
        "metrics[0]: no 'min_clearence', did you mean 'min_clearance'?",
    ),
    "records": ({"records": {"quantities": ["x"]}}, "records.every: missing"),
    "quantity": ({"records": {"every": 5, "quantities": ["y"]}}, "records.quantities[0]: no 'y'"),
    "repetitions": ({"repetitions": 0}, "repetitions: must be from 1"),
    "type": ({"repetitions": "two"}, "repetitions: expected a whole number, not a str"),
    "impossible": ({"overrides": {"duration": -1.0}}, "overrides: duration"),
    "goal": (
        {"tune": {**TUNE, "objectives": [{"metric": "effort"}]}},
        "tune.objectives[0].direction: missing",
    ),
    "scenes": (
        {"scenario": None, "scenes": {"families": ["crowds"], "count": 1}},
        "scenes.families[0]: no 'crowds'",
    ),
    "row": (
        {"design": {"kind": "table", "rows": [[9.0, [0.0, -0.3], "cbf"]]}},
        "design: row 0: gain: expected a",
    ),
}


@pytest.mark.parametrize("name", WRONG)
def test_a_wrong_document_is_told_by_its_key(name: str) -> None:
    changes, message = WRONG[name]
    with pytest.raises(VffNullError) as raised:
        Study(changed(**changes))
    assert message in str(raised.value), str(raised.value)


def test_names_that_are_numbers_go_with_their_changes(tmp_path: Path) -> None:
    """In the order of their text, as 10 before 2."""
    gains = {gain: {"controller.field.gain": float(gain)} for gain in (1, 2, 10)}
    study = vff.Study(changed(factors=[{"name": "gain", "choices": gains}], design=None))
    rows = study.run(tmp_path / "out", threads=1).table(["run", "gain"]).to_pydict()
    ran = [study.scenario(run)["controller.field.gain"] for run in rows["run"]]
    assert list(map(float, rows["gain"])) == ran and sorted(ran) == [1.0, 2.0, 10.0]


def test_what_is_no_document() -> None:
    with pytest.raises(InputTypeError, match="study: expected a table"):
        Study([])  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"no study called 'disturbence'.*did you mean 'disturbances'"):
        Study.load("disturbence")
    with pytest.raises(ScenarioError, match="cannot be read"):
        Study.load("nowhere.toml")


@pytest.mark.parametrize("name", studies())
def test_bundled_studies(name: str) -> None:
    study = Study.load(name)
    assert study.name == name and study.description.endswith((".", "?")) and study.runs > 100
    assert vff.Study is Study


# --------------------------------------------------------------------------------------------------- runs


def test_every_run_is_the_one_that_simulate_makes(undisturbed: Path) -> None:
    """Metrics bit by bit, status, seed, values of the factors."""
    study, table = Study(DOCUMENT), Dataset.open(undisturbed).table()
    assert table.column("run").to_pylist() == list(range(16)) and study.blocks == 6
    for row in table.to_pylist():
        scenario = study.scenario(row["run"])
        result = vff.simulate(scenario)
        state = np.random.SeedSequence(7, spawn_key=(1, row["run"])).generate_state(1, np.uint64)
        assert scenario["seed"] == row["seed"] == int(state[0]) >> 1
        assert scenario["controller.field.gain"] == row["gain"]
        assert json.loads(row["speed"]) == scenario["obstacles.0.motion.velocity"]
        assert scenario["controller.avoidance"] == {"field": "null_space", "cbf": "cbf"}[row["law"]]
        assert row["status"] == str(result.status) and row["end_time"] == result.end_time
        assert {name: row[name] for name in result.metrics} == {
            name: None if value is None else float(value) for name, value in result.metrics.items()
        }


def test_columns_say_what_they_are(undisturbed: Path) -> None:
    """Units and meanings, in every part and in the manifest."""
    (first, *_) = sorted((undisturbed / "runs").iterdir())
    schema = pyarrow.parquet.read_schema(first)
    assert schema.field("gain").metadata[b"unit"] == "N·m³".encode()
    assert schema.field("min_clearance").metadata[b"unit"] == b"m"
    about = json.loads(schema.metadata[b"vffnull"])
    manifest = json.loads((undisturbed / "study.json").read_text(encoding="utf-8"))
    assert about == {"version": vff.__version__, "study": manifest["digest"], "name": "short"}
    assert manifest["runs"] == 16 and manifest["versions"]["pyarrow"] == pyarrow.__version__
    assert Study(manifest["study"])._plan.digest == manifest["digest"]
    dataset = Dataset.open(undisturbed)
    assert dataset.unit("gain") == "N·m³" and "link" in dataset.meaning("min_clearance")
    with pytest.raises(InputError, match="clearence: there is no such column"):
        dataset.column("clearence")


def test_scenes_points_and_repetitions(tmp_path: Path) -> None:
    """Every scene meets every point so often; `seeds` of repetitions are the same for all points."""
    document = {
        "scenes": {"families": ["clutter", "crowd"], "joints": [4], "count": 2, "first_seed": 5},
        "factors": [LAW],
        "overrides": {"duration": 0.02, "reference.duration": 0.02},
        "repetitions": 3,
        "seeds": "repetition",
        "block": {"runs": 5},
        "metrics": ["min_clearance"],
    }
    study = Study(document)
    assert (study.runs, study.points, study.blocks) == (4 * 2 * 3, 2, 5)
    rows = study.run(tmp_path / "results").table().to_pylist()
    seen = {(row["scene"], row["law"], row["repetition"]) for row in rows}
    assert len(seen) == len(rows) == 24
    assert {row["scene"] for row in rows} == {
        f"{family}-4-{i}" for family in ("clutter", "crowd") for i in (5, 6)
    }
    assert len({row["seed"] for row in rows}) == 3
    for row in rows:
        made = vff.scenes.random(row["scene"].rsplit("-", 2)[0], 4, int(row["scene"].rsplit("-", 1)[1]))
        scenario = study.scenario(row["run"])
        assert scenario.name == row["scene"] == made.name and scenario["obstacles"] == made["obstacles"]
        assert vff.simulate(scenario).metrics["min_clearance"] == row["min_clearance"]


def test_records_are_thinned(tmp_path: Path) -> None:
    """A row for every kept instant of every run, equal to the record of `simulate`."""
    study = Study(changed(records={"every": 10, "quantities": ["x", "error", "clearance"]}))
    dataset = study.run(tmp_path / "results")
    table = dataset.table(records=True)
    assert table.column_names[:6] == ["run", "t", "x_x", "x_y", "error_x", "error_y"]
    run = table.filter(pyarrow.compute.equal(table.column("run"), 11))
    result = vff.simulate(study.scenario(11))
    np.testing.assert_array_equal(run.column("t"), result.t)
    np.testing.assert_array_equal(run.column("clearance_5"), result.clearance[:, 5])
    np.testing.assert_array_equal(run.column("x_y"), result.x[:, 1])
    assert table.num_rows == 16 * 6
    with pytest.raises(InputError, match="this study keeps none"):
        Study(DOCUMENT).run(tmp_path / "none").table(records=True)


def test_in_space(tmp_path: Path) -> None:
    """An arm in space, its joints seven, with keys of the arm as a factor."""
    document = {
        "scenario": "panda-sweep",
        "overrides": {"duration": 0.02},
        "factors": [{"key": "arm.gravity", "name": "g", "values": [[0.0, 0.0, -9.81], [0.0, 0.0, -1.62]]}],
        "records": {"every": 10, "quantities": ["q", "x"]},
    }
    dataset = Study(document).run(tmp_path / "results")
    assert len(dataset) == 2 and dataset.unit("min_manipulability") == "m³"
    assert {"q_6", "x_z"} <= set(dataset.table(records=True).column_names)
    torque = dataset.column("peak_torque")
    assert torque[0] != torque[1]


def test_runs_that_go_wrong_leave_the_others_alone(tmp_path: Path) -> None:
    """Refused where there is no scenario, diverged where it is too stiff; each with its status, and why."""
    document = {
        "scenario": "sweep-through",
        "overrides": {"duration": 0.5},
        "factors": [
            {"key": "controller.null_damping", "name": "d", "values": [6.0, 5000.0, -1.0]},
            {"key": "q0.2", "name": "q", "values": [-0.6, -0.5]},
        ],
        "block": {"runs": 6},
    }
    rows = Study(document).run(tmp_path / "results").table().to_pylist()
    by = {(row["d"], row["q"]): row for row in rows}
    assert by[6.0, -0.6]["status"] == "completed" and by[6.0, -0.6]["message"] is None
    assert by[-1.0, -0.6]["status"] == "refused" and "null_damping" in by[-1.0, -0.6]["message"]
    assert by[5000.0, -0.5]["status"] == "diverged" and by[5000.0, -0.5]["end_time"] < 0.5
    assert by[6.0, -0.6]["min_clearance"] is not None and by[-1.0, -0.6]["min_clearance"] is None
    found = Dataset.open(tmp_path / "results").findings(["min_clearance"])
    assert (found.failures.count, found.failures.total) == (3, 6) and "50.0" in str(found)


def test_a_run_that_a_fault_of_ours_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the core says of a panic is kept as its message; the other runs of the block count."""
    real = vff._core.run_many

    def panics(documents: list[Any], *rest: Any) -> list[dict[str, Any]]:
        found = real(documents, *rest)
        found[-1:] = [found[-1] | {"status": "failed", "message": "a fault of vffnull itself", "metrics": {}}]
        return found

    monkeypatch.setattr(vff._core, "run_many", panics)
    rows = Study(changed(metrics=["effort"])).run(tmp_path / "results").table().to_pylist()
    assert [row["status"] for row in rows[:3]] == ["completed", "completed", "failed"]
    assert rows[2]["message"] == "a fault of vffnull itself" and rows[2]["effort"] is None
    assert rows[0]["message"] is None and rows[0]["effort"] is not None


# ------------------------------------------------------------------------------------------------- datasets


def damaged(place: Path) -> int:
    """Damage a dataset in every way that is not a matter of processes; how many parts are wrong."""
    names = sorted((place / "runs").iterdir())
    data = bytearray(names[0].read_bytes())
    data[len(data) // 2] ^= 1  # one bit
    names[0].write_bytes(data)
    names[1].write_bytes(names[1].read_bytes()[:-1])
    names[2].write_bytes(b"")
    names[3].unlink()
    (place / ".drafts").mkdir()
    (place / ".drafts" / ".0123.parquet").write_bytes(b"half a part")
    return 3


def test_what_is_damaged_is_made_again(undisturbed: Path, tmp_path: Path) -> None:
    """By the same bytes; what is whole is not touched."""
    place = tmp_path / "results"
    study = Study(DOCUMENT)
    study.run(place)
    assert parts(place) == parts(undisturbed)
    wrong = damaged(place)
    whole = {path: path.stat().st_mtime_ns for path in sorted((place / "runs").iterdir())[3:]}
    told: list[str] = []
    seen: list[tuple[int, int]] = []
    dataset, begun = study._carried_out(
        place, True, 1, None, None, lambda done, total: seen.append((done, total)), told.append
    )
    assert (
        len(begun.blocks) == 2
        and begun.damaged == wrong
        and told == ["2 of 6 blocks are there and whole, and 3 damaged parts are made again"]
    )
    assert parts(place) == parts(undisturbed) and len(dataset) == 16
    assert {path: path.stat().st_mtime_ns for path in whole} == whole
    assert seen[-1] == (12, 12)


def test_a_part_of_another_study_is_not_taken_for_one_of_this(undisturbed: Path, tmp_path: Path) -> None:
    place, other = tmp_path / "results", tmp_path / "other"
    Study(DOCUMENT).run(place)
    Study(changed(seed=8)).run(other)
    foreign = sorted((other / "runs").iterdir())[0]
    sorted((place / "runs").iterdir())[0].unlink()
    (place / "runs" / foreign.name).write_bytes(foreign.read_bytes())
    Study(DOCUMENT).run(place, resume=True)
    assert parts(place) == parts(undisturbed)


def test_half_a_block_is_none(tmp_path: Path) -> None:
    """With records a block has two parts, and one of them alone is not taken for the block."""
    study = Study(changed(records={"every": 10}))
    study.run(tmp_path / "whole")
    study.run(tmp_path / "half")
    sorted((tmp_path / "half" / "records").iterdir())[1].unlink()
    sorted((tmp_path / "half" / "runs").iterdir())[3].unlink()
    study.run(tmp_path / "half", resume=True)
    assert parts(tmp_path / "half") == parts(tmp_path / "whole")


def test_a_directory_that_is_taken(undisturbed: Path, tmp_path: Path) -> None:
    """Nothing is computed over what is there without being told so, and never over another study."""
    with pytest.raises(InputError, match="holds 6 of 6 blocks of this study; resume it"):
        Study(DOCUMENT).run(undisturbed)
    with pytest.raises(InputError, match="holds another study, which differs in `seed`"):
        Study(changed(seed=8)).run(undisturbed, resume=True)
    with pytest.raises(InputError, match="holds the runs of a design"):
        Study(changed(tune=TUNE)).tune(undisturbed, resume=True)
    place = tmp_path / "older"
    Study(DOCUMENT).run(place)
    text = (place / "study.json").read_text(encoding="utf-8")
    text = re.sub(r',\s*"signature": "\w+"', "", text)
    (place / "study.json").write_text(text.replace(f'"vffnull": "{vff.__version__}"', '"vffnull": "0.0.1"'))
    with pytest.raises(InputError, match=r"was begun with vffnull 0\.0\.1, and this is"):
        Study(DOCUMENT).run(place, resume=True)
    (place / "study.json").write_text("{", encoding="utf-8")
    with pytest.raises(InputError, match=r"study\.json is damaged"):
        Dataset.open(place)
    with pytest.raises(InputError, match="no dataset of a study"):
        Dataset.open(tmp_path)


def test_one_client_at_a_time(undisturbed: Path, tmp_path: Path) -> None:
    """The second is refused by name, and nothing of the first is touched."""
    study, place = Study(DOCUMENT), tmp_path / "results"
    refused: list[str] = []

    def meanwhile(_done: int, _total: int) -> None:
        if not refused:
            with pytest.raises(InputError, match=f"process {os.getpid()} on .* is writing there") as raised:
                study.run(place, resume=True)
            refused.append(str(raised.value))

    study.run(place, progress=meanwhile)
    assert refused and parts(place) == parts(undisturbed)


def test_whatever_reads_parquet_reads_it_while_it_grows(undisturbed: Path, tmp_path: Path) -> None:
    """DuckDB, pandas, polars and Arrow, by a pattern or the folder, with a draft beside."""
    duckdb, polars, pandas = (pytest.importorskip(name) for name in ("duckdb", "polars", "pandas"))
    study, place, seen = Study(DOCUMENT), tmp_path / "results", []

    def look(done: int, _total: int) -> None:
        if done != 6 or seen:
            return
        (place / ".drafts").mkdir(exist_ok=True)
        (place / ".drafts" / ".half.parquet").write_bytes(b"half a part")
        seen.append(
            {
                "duckdb": duckdb.sql(f"select count(*) from '{place}/runs/*.parquet'").fetchall()[0][0],
                "pandas": len(pandas.read_parquet(place / "runs")),
                "polars": polars.scan_parquet(f"{place}/runs/*.parquet")
                .select(polars.len())
                .collect()
                .item(),
                "arrow": pyarrow.dataset.dataset(place / "runs").count_rows(),
                "ours": len(Dataset.open(place)),
            }
        )

    study.run(place, threads=1, progress=look)
    assert seen and all(6 <= count <= 12 and count % 3 == 0 for count in seen[0].values()), seen
    assert parts(place) == parts(undisturbed)
    rows = duckdb.sql(f"select law, avg(min_clearance) from '{place}/runs/*.parquet' group by law").fetchall()
    frame = Dataset.open(place).to_pandas()
    for law, mean in rows:
        assert mean == pytest.approx(frame[frame["law"] == law]["min_clearance"].mean())


@pytest.mark.parametrize("address", ["memory://study-test/results", "file://{}/results"])
def test_object_stores(address: str, undisturbed: Path, tmp_path: Path) -> None:
    """The same bytes by way of fsspec, resumed and locked as well."""
    fsspec = pytest.importorskip("fsspec")
    place = address.format(tmp_path)
    study = Study(DOCUMENT)
    dataset = study.run(place)
    expected = parts(undisturbed)
    system, root = fsspec.core.url_to_fs(place)
    for name, data in expected.items():
        assert system.cat_file(f"{root}/{name}") == data
    system.pipe_file(f"{root}/{dataset.files[2]}", b"damaged")
    with pytest.raises(InputError, match="resume it"):
        study.run(place)
    study.run(place, resume=True)
    assert system.cat_file(f"{root}/{dataset.files[2]}") == expected[dataset.files[2]]
    if address.startswith("memory"):
        system.pipe_file(f"{root}/.lock", b'{"token": "x", "process": 12, "machine": "there"}')
        with pytest.raises(InputError, match=r"process 12 on there is writing there.*remove memory://"):
            study.run(place, resume=True)
        system.rm(root, recursive=True)


@pytest.mark.parametrize("name", [".lock", ".drafts", "runs", "study.json"])
@pytest.mark.parametrize("hard", [False, True])
def test_links_in_a_folder_are_not_followed(name: str, hard: bool, undisturbed: Path, tmp_path: Path) -> None:
    """A dataset of other people cannot have a file of ours written or removed."""
    if hard and name != ".lock":
        pytest.skip("a folder cannot be a hard link, and a file that is one is replaced")
    place, ours = tmp_path / "results", tmp_path / "ours"
    shutil.copytree(undisturbed, place)
    if (place / name).is_dir():
        shutil.move(place / name, ours)
    elif name == ".drafts":
        ours.mkdir()
        (ours / "precious").write_text("kept")
    else:
        (place / name).unlink(missing_ok=True)
        ours.write_text("kept")
    os.link(ours, place / name) if hard else (place / name).symlink_to(ours)
    before = {path: path.read_bytes() for path in [ours, *ours.rglob("*")] if path.is_file()}
    with pytest.raises(InputError, match=f"results: {name} is a link"):
        Study(DOCUMENT).run(place, resume=True)
    assert {path: path.read_bytes() for path in [ours, *ours.rglob("*")] if path.is_file()} == before


def test_damage_is_named_when_a_dataset_is_read(undisturbed: Path, tmp_path: Path) -> None:
    """One wrong bit, anywhere, gives no other number."""
    place = tmp_path / "results"
    shutil.copytree(undisturbed, place)
    part = sorted((place / "runs").iterdir())[1]
    whole, random = part.read_bytes(), np.random.default_rng(5)
    for at in random.integers(len(whole), size=20):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << random.integers(8)
        part.write_bytes(damaged)
        for look in (len, Dataset.counts, Dataset.table):
            with pytest.raises(InputError, match=f"{part.name} is damaged; .* --resume"):
                look(Dataset.open(place))
    manifest = (place / "study.json").read_text(encoding="utf-8")
    (place / "study.json").write_text(manifest.replace('"runs": 16', '"runs": 17'), encoding="utf-8")
    with pytest.raises(InputError, match=r"study\.json is damaged"):
        Dataset.open(place)
    older = json.loads(manifest)
    del older["signature"]  # of an older version
    (place / "study.json").write_text(json.dumps(older), encoding="utf-8")
    Study(DOCUMENT).run(place, resume=True)
    assert part.read_bytes() == whole
    assert Dataset.open(place).table().equals(Dataset.open(undisturbed).table())


def test_a_store_that_shows_half_files_gets_them_renamed(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A store of which nothing is known: a draft first, which a failure removes."""
    import fsspec

    from vffnull.studies import store

    system = fsspec.filesystem("memory")
    remote = store._Remote(system, "/half/results", "memory://half/results", whole=False)
    remote.write("runs/a", b"one")
    monkeypatch.setattr(type(system), "mv", lambda *_: (_ for _ in ()).throw(OSError(28, "no space left")))
    with pytest.raises(OSError, match="no space"):
        remote.write("runs/a", b"two")
    assert remote.read("runs/a") == b"one" and remote.names("runs") == ["a"] and remote.names(".drafts") == []
    remote.tidy()


def test_what_cannot_compute_is_refused(tmp_path: Path) -> None:
    study = Study(DOCUMENT)
    for given, message in (
        ({"threads": 0}, "threads: must be from 1"),
        ({"workers": 0}, "workers: must be from 1"),
        ({"threads": 2, "workers": 2}, "threads: not together with workers"),
        ({"scheduler": 3}, "scheduler: expected an address"),
        ({"scheduler": "nonsense://x"}, "scheduler: 'nonsense://x' is no address"),
        ({"progress": 3}, "progress: expected True or a callable"),
    ):
        with pytest.raises(VffNullError, match=message):
            study.run(tmp_path / "results", **given)
    with pytest.raises(InputError, match="nonsense"):
        study.run("nonsense://bucket/x")


# ------------------------------------------------------------------------------------------------ estimates


def test_the_estimate(tmp_path: Path) -> None:
    """Runs and blocks exactly; the time and the size as far as one can tell: the right order."""
    study = Study(DOCUMENT)
    estimate = study.estimate()
    assert (estimate.runs, estimate.blocks) == (16, 6) and estimate.seconds > 0
    assert str(estimate).startswith("16 runs in 6 blocks: about ")
    size = sum(len(data) for name, data in parts(study.run(tmp_path / "a").plan and tmp_path / "a").items()
               if name != "study.json")  # fmt: skip
    assert size / 3 < estimate.bytes < 3 * size
    large = Study(changed(design={"kind": "random", "count": 10**9}, block=None)).estimate()
    assert large.seconds > 1e4 and "1,000,000,000 runs" in str(large)


def test_blocks_follow_from_the_document_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their size has nothing to do with the machine; a study of few runs has enough for some workers."""
    document = changed(design={"kind": "random", "count": 10**6}, block=None)
    size = Study(document)._plan.size
    monkeypatch.setattr(os, "cpu_count", lambda: 512)
    assert Study(document)._plan.size == size > 1000
    assert Study(changed(block=None)).blocks == 16
    long = {"overrides": {"duration": 4.0}, "block": None}
    many, most = (Study(changed(design={"kind": "random", "count": 10**n}, **long)) for n in (5, 9))
    assert many.blocks == 362 and most._plan.size == 4096


# -------------------------------------------------------------------------------------------------- effects


def test_indices_of_a_function_that_is_known() -> None:
    """Ishigami's: in closed form, and as SciPy's estimator finds them in the same samples."""
    from scipy import stats

    random = np.random.default_rng(1)
    n, a, b = 8192, 7.0, 0.1
    both = -np.pi + 2 * np.pi * stats.qmc.Sobol(6, rng=random).random(n)

    def f(x: np.ndarray) -> np.ndarray:
        return np.sin(x[..., 0]) + a * np.sin(x[..., 1]) ** 2 + b * x[..., 2] ** 4 * np.sin(x[..., 0])

    first, second = both[:, :3], both[:, 3:]
    points = np.repeat(first[:, None], 5, axis=1)
    for i in range(3):
        points[:, 1 + i, i] = second[:, i]
    points[:, 4] = second
    samples = f(points)
    found = indices(samples)
    variance = a**2 / 8 + b * np.pi**4 / 5 + b**2 * np.pi**8 / 18 + 0.5
    one = 0.5 * (1 + b * np.pi**4 / 5) ** 2 / variance
    expected = (
        np.array([one, a**2 / 8 / variance, 0.0]),
        np.array(
            [
                one + 8 * b**2 * np.pi**8 / 225 / variance,
                a**2 / 8 / variance,
                8 * b**2 * np.pi**8 / 225 / variance,
            ]
        ),
    )
    for j in range(3):
        assert found[j].first[0] == pytest.approx(expected[0][j], abs=0.02)
        assert found[j].total[0] == pytest.approx(expected[1][j], abs=0.02)
        assert found[j].first[1] - 0.01 <= expected[0][j] <= found[j].first[2] + 0.01
        assert explained(first[:, j], samples[:, 0]) == pytest.approx(expected[0][j], abs=0.04)
    theirs = stats.sobol_indices(
        func={"f_A": samples[:, 0][None], "f_B": samples[:, -1][None], "f_AB": samples[:, 1:-1].T[:, None]},
        n=n,
    )
    np.testing.assert_allclose([each.first[0] for each in found], theirs.first_order, atol=1e-9)
    np.testing.assert_allclose([each.total[0] for each in found], theirs.total_order, atol=1e-9)


def test_indices_of_nothing() -> None:
    assert np.isnan(indices(np.zeros((8, 4)))[0].first).all()
    assert np.isnan(indices(np.empty((0, 4)))[1].total).all()
    assert np.isnan(explained(np.arange(5.0), np.ones(5)))
    assert explained(np.arange(400.0) % 7, np.random.default_rng(0).random(400)) < 0.05
    assert explained(np.arange(400.0), np.arange(400.0)) > 0.95


def test_effects_and_the_front() -> None:
    random = np.random.default_rng(3)
    factor, metric = random.random(500), random.random(500)
    metric[:7] = np.nan
    found = effect(factor, metric)
    at = bins_of(factor[7:])
    assert found.count.sum() == 493 and found.count.min() > 30
    np.testing.assert_allclose(found.mean[2], metric[7:][at == 2].mean())
    np.testing.assert_allclose(effect(factor > 0.5, metric).mean[1], np.nanmean(metric[factor > 0.5]))
    costs = np.round(random.random((300, 2)), 2)
    costs[5] = np.nan
    best = front(costs)
    for i, row in enumerate(costs):
        beaten = np.any(np.all(costs <= row, axis=1) & np.any(costs < row, axis=1))
        if np.isfinite(row).all() and not beaten:
            assert any(np.array_equal(row, costs[j]) for j in best), i
    for j in best:
        assert not np.any(np.all(costs <= costs[j], axis=1) & np.any(costs < costs[j], axis=1))


# ---------------------------------------------------------------------------------------------------- pages


def test_findings_and_the_page(tmp_path: Path) -> None:
    """Pictures of everything, no network, and what a document says is shown as text whatever it says."""
    hostile = "</script><script>alert(1)</script>{{ 7*7 }}"
    document = changed(
        name=hostile,
        description=hostile,
        overrides={},
        factors=[
            {**GAIN, "range": [1e-5, 3.0], "name": hostile, "unit": "<b>"},
            {"key": "obstacles.0.motion.velocity.1", "name": "speed", "range": [-0.7, -0.3]},
            {"name": "<i>gains</i>", "choices": {"soft": {"controller.damping": 10.0}, "hard": {}}},
        ],
        design={"kind": "saltelli", "count": 8},
        block=None,
        metrics=["min_clearance", "max_error_transient", "effort"],
    )
    dataset = Study(document).run(tmp_path / "results")
    found = dataset.findings()
    assert found.runs == found.of == 40 and 0 < found.failures.count < 40
    assert set(found.indices) == {"failure", *found.metrics} and found.factors[1] == "speed"
    assert "Sobol indices" in str(found) and json.dumps(found.to_dict())
    text = dataset.report(tmp_path / "page.html").read_text(encoding="utf-8")
    for heading in ("Main effects", "Clearance against tracking", "Where runs fail", "Pairs", "What decides"):
        assert f"<h2>{heading}" in text, heading
    markup = re.sub(r"<(script|style)\b.*?</\1>", "", text, flags=re.S)
    assert "alert(1)" in markup and "<script" not in markup and "<i>" not in markup and "<b>]" not in markup
    assert not re.search(r"(?:src|href)=.(?!data:)", markup)
    data = re.findall(r"<script\b[^>]*>(.*?)</script>", text, flags=re.S)
    assert not any("<script>alert(1)" in each for each in data)
    with pytest.raises(InputError, match=r"written as \.html"):
        dataset.report(tmp_path / "page.txt")
    with pytest.raises(InputError, match="has no 'effor'"):
        dataset.findings(["effor"])


# --------------------------------------------------------------------------------------------------- tuning


@pytest.mark.parametrize("sampler", ["tpe", "random", "nsga2"])
def test_tuning_goes_on_where_it_was(sampler: str, tmp_path: Path) -> None:
    """Stopped after some trials, with a line of the journal half written, it comes to the same end."""
    pytest.importorskip("optuna")
    document = changed(
        scenario=None,
        scenes={"families": ["clutter"], "joints": [4], "count": 2},
        overrides={"duration": 0.05, "reference.duration": 0.05},
        factors=[GAIN, LAW],
        tune={
            "trials": 12,
            "batch": 4,
            "sampler": sampler,
            "objectives": [
                {"metric": "min_clearance", "direction": "maximize", "over": "min"},
                {"metric": "peak_torque", "direction": "minimize"},
            ],
        },
        design=None,
        block={"runs": 1},
        metrics=["effort"],
    )
    study = Study(document)
    whole = study.tune(tmp_path / "whole")
    assert [trial.number for trial in whole.trials] == list(range(12)) and len(whole.dataset) == 24
    halt = 7

    def stop(done: int, _total: int) -> None:
        if done >= halt:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        study.tune(tmp_path / "resumed", progress=stop, threads=1)
    with (tmp_path / "resumed" / "tuning.log").open("ab") as journal:
        journal.write(b'{"op_code": 5, "half')
    resumed = study.tune(tmp_path / "resumed", resume=True)
    for name in ("whole", "resumed"):
        (tmp_path / name / "tuning.log").unlink()
    assert parts(tmp_path / "resumed") == parts(tmp_path / "whole")
    assert resumed.trials == whole.trials and resumed.best == whole.best
    for trial in whole.trials:
        assert trial.values is not None
        assert any(
            np.all(np.array(each.values) * [-1, 1] <= np.array(trial.values) * [-1, 1]) for each in whole.best
        )


def test_tuning_finds_what_is_better(tmp_path: Path) -> None:
    """One objective whose best is known: the largest gain keeps the largest clearance. More trials go on."""
    pytest.importorskip("optuna")
    document = changed(
        overrides={"duration": 0.6, "obstacles.0.position": [1.6, 1.9]},
        factors=[GAIN],
        tune=TUNE,
        design=None,
    )
    study = Study(document)
    few = study.tune(tmp_path / "results", trials=3)
    many = study.tune(tmp_path / "results", trials=16, resume=True)
    assert many.trials[:3] == few.trials and len(many.trials) == 16 and len(many.best) == 1
    values = [trial.values[0] for trial in many.trials if trial.values]
    assert many.best[0].values == (max(values),)
    later = np.mean([trial.factors["gain"] for trial in many.trials[12:]])
    assert later > np.mean([trial.factors["gain"] for trial in many.trials[:8]])
    with pytest.raises(InputError, match="tune: missing"):
        Study(DOCUMENT).tune(tmp_path / "none")
    with pytest.raises(InputError, match="needs a directory"):
        study.tune("memory://tuned")


def test_a_trial_without_a_value_fails_and_the_others_go_on(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    factors = [{"key": "controller.null_damping", "name": "d", "values": [6.0, -1.0]}]
    document = changed(factors=factors, tune={**TUNE, "sampler": "random", "trials": 6}, design=None)
    tuned = Study(document).tune(tmp_path / "results")
    assert {trial.factors["d"] for trial in tuned.trials} == {6.0, -1.0}
    assert all((trial.values is None) == (trial.factors["d"] < 0) for trial in tuned.trials)
    missing = {**TUNE["objectives"][0], "missing": -1.0}  # type: ignore[index]
    document["tune"] = {**document["tune"], "objectives": [missing]}
    tuned = Study(document).tune(tmp_path / "missing")
    assert all(trial.values == (-1.0,) for trial in tuned.trials if trial.factors["d"] < 0)


# ----------------------------------------------------------------------------------------------- the command


def test_the_command(
    undisturbed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Dry run, run, refusal, resume, show: what is said, and the exit codes."""

    def vffnull(*words: object, code: int = 0) -> str:
        monkeypatch.setattr(sys, "argv", ["vffnull", "study", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        told = capsys.readouterr()
        assert ended.value.code == code, told.err
        return told.out if code == 0 else told.err

    monkeypatch.chdir(tmp_path)
    document = tmp_path / "mine.toml"
    document.write_text(vff._core.format_toml(DOCUMENT), encoding="utf-8")
    assert (
        "16 runs in 6 blocks" in vffnull("run", "mine.toml", "--dry-run")
        and not (tmp_path / "results").exists()
    )
    told = vffnull("run", "mine.toml", "--out", "results", "--threads", 1)
    assert "16 runs: 16 completed" in told and "next: vffnull study show results" in told
    assert parts(tmp_path / "results") == parts(undisturbed)
    assert "resume it (--resume)" in vffnull("run", "mine.toml", "--out", "results", code=2)
    shown = json.loads(vffnull("show", "results", "--json", "--metric", "min_clearance"))
    assert shown["runs"] == 16 and list(shown["metrics"]) == ["min_clearance"]
    document.write_text(document.read_text(encoding="utf-8").replace("sobol", "sobel"), encoding="utf-8")
    assert "design.kind: no 'sobel'" in vffnull("run", "mine.toml", "--out", "results", code=2)
