"""What the command does for whoever types it: suggestions, completion, next steps, and poor shells."""

from __future__ import annotations

import importlib
import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

import vffnull as vff
from vffnull.evaluation import CONTROLLERS
from vffnull.model import keys as _keys
from vffnull.model.validation import faults

SHORT = ("--set", "duration=0.05")


def vffnull(
    *arguments: object, code: int = 0, cwd: Path | None = None, **environment: str
) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vffnull", *map(str, arguments)]
    encoding = environment.get("PYTHONIOENCODING", "ascii").replace("ascii", "utf-8")  # as click does
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=cwd, env=os.environ | environment, encoding=encoding
    )
    assert done.returncode == code, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    return done


def shell(command: str, cwd: Path | None = None, **environment: str) -> tuple[int, str, str]:
    """By way of a shell, for what only a shell can do with the streams of a command."""
    script = command.replace("vffnull ", f"'{sys.executable}' -m vffnull ", 1)
    done = subprocess.run(["sh", "-c", script], capture_output=True, cwd=cwd, env=os.environ | environment)
    return done.returncode, done.stdout.decode("utf-8", "replace"), done.stderr.decode("utf-8", "replace")


def offered(words: str) -> list[str]:
    """What the shell offers for the last word."""
    asked = {"_VFFNULL_COMPLETE": "bash_complete", "COMP_WORDS": f"vffnull {words}"}
    done = vffnull(**asked, COMP_CWORD=str(len(words.split())))
    return [line.split(",", 1)[1] for line in done.stdout.splitlines() if line]


# --------------------------------------------------------------------------------------------------- keys


def test_the_schema_gives_every_key() -> None:
    """Every key of the bundled scenarios is known by its dotted name, but for those of what has kinds."""
    for name in vff.scenarios():
        document = vff.Scenario.load(name).to_dict()
        for key in _keys.written(document):
            parts = ["0" if part.isdecimal() else part for part in key.split(".")]
            table = any(each.startswith(".".join([*parts, ""])) for each in _keys.known())
            inside = parts[0] in ("arm", "obstacles", "wrenches") and {"shape", "motion", "profile"} & set(
                parts
            )
            assert ".".join(parts) in _keys.known() or table or inside, key
    for key in ("controller.joint_limit_field.gain", "controller.yielding.rate", "actuator.time_constant"):
        assert key in _keys.known()


@pytest.mark.parametrize(
    ("wrong", "meant"),
    [
        ("gain=1", "did you mean controller.field.gain"),
        ("controller.gain=1", "did you mean controller.field.gain"),
        ("stifness=3", "did you mean controller.stiffness or obstacles.0.contact.stiffness?"),
        ("dt=1e-3", "did you mean simulation.dt?"),
        ("obstacles.0.radius=2", "obstacles.0.shape.radius"),
        ("obstacle.0.angle=2", "there is no list obstacle"),
        ("obstacles.5.angle=1", "obstacles.5.angle: no list element '5'; there is one, number 0"),
        ("obstacles[3].angle=1", "obstacles[3].angle: no list element '3'; there is one, number 0"),
        ("obstacles.x.angle=1", "no list element 'x'"),
    ],
)
def test_a_key_that_does_not_exist_names_what_does(wrong: str, meant: str) -> None:
    assert meant in vffnull("run", "sweep-through", "--set", wrong, code=2).stderr


def test_overrides_in_python_get_the_same_hints() -> None:
    for call in (
        lambda: vff.simulate("sweep-through", {"gain": 1.0}),
        lambda: vff.Scenario.load("sweep-through").replace(gain=1.0),
        lambda: vff.realtime("sweep-through", overrides={"gain": 1.0}),
    ):
        with pytest.raises(vff.errors.ScenarioError, match=r"did you mean controller\.field\.gain"):
            call()
    with pytest.raises(vff.errors.ScenarioError, match=r"there is no list obstacles"):
        vff.simulate("sweep-through", {"obstacles": None, "obstacles.0.angle": 1.0})
    scenario = vff.Scenario.load("sweep-through")
    assert scenario["obstacles[0].position"] == scenario["obstacles.0.position"]
    moved = scenario.replace(**{"obstacles[0].angle": 0.5})
    assert moved["obstacles.0.angle"] == 0.5


def test_keys_controllers_and_categories_complete() -> None:
    found = offered("run sweep-through --set controller.fi")
    assert {"controller.field.gain=", "controller.field.floor="} <= set(found)
    assert all(each.startswith("controller.fi") for each in found)
    assert "obstacles.0.shape.radius=" in offered("run sweep-through --set obstacles.0.sh")
    assert "simulation.dt=" in offered("live --set sim") and offered("run paper-1 --set duration=") == []
    assert offered("evaluate --controller c") == [name for name in CONTROLLERS if name.startswith("c")]
    assert offered("evaluate --category c") == ["clutter", "crowd"]


# ----------------------------------------------------------------------------------------------- validate


def test_every_fault_of_a_file_is_listed(tmp_path: Path) -> None:
    """Unknown keys, wrong values and wrong types in different tables, each once and with its path."""
    document = vff.Scenario.load("on-path").to_dict()
    document["controller"] |= {"stifness": 3, "damping": -1.0}
    document["controller"]["field"]["gain"] = -2.0
    document["obstacles"].append({"shape": {"kind": "circle", "radius": -1.0}})
    document["obstacles"].append({"shape": {"kind": "circl", "radius": 1.0}})
    document["simulation"]["dt"] = "x"
    document["plant"] = {"mas": 1.0}
    document["seeds"] = 3
    wrong = [
        "obstacles[1].shape.radius: must be greater than 0",
        "obstacles[2].shape.kind: unknown value `circl`",
        "controller: unknown key `stifness`",
        "controller.damping: must be 0 or more",
        "controller.field.gain: must be 0 or more",
        "simulation.dt: expected a number",
        "plant: unknown key `mas`",
        "unknown key `seeds`",
    ]
    found = faults(document)
    assert len(found) == len(wrong) and all(map(str.startswith, found, wrong)), found
    path = tmp_path / "mine.toml"
    path.write_text(vff._core.format_toml(document), encoding="utf-8")
    judged = json.loads(vffnull("validate", path, "--json", code=2).stdout)[0]
    # In the order of the file, where what is no table comes first.
    assert sorted(judged["errors"]) == sorted(f"{path}: {each}" for each in found)
    assert judged["error"] == judged["errors"][0] and judged["warnings"] == []
    printed = vffnull("validate", path, code=2)
    assert printed.stderr.splitlines() == judged["errors"] and printed.stdout == ""


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"q0": [1.0]}, ["q0: expected 6 values"]),
        ({"plant": {"mas": 1}, "q0": [1.0]}, ["plant: unknown key `mas`", "q0: expected 6 values"]),
        ({"controller": {"task": "pos"}}, ["controller.task: unknown value `pos`"]),
        ({"arm": {"masses": 1.0}}, ["arm: missing key `lengths`"]),
        ({"controller": {"posture_stiffness": -1.0}}, ["controller.posture_stiffness: "]),
        ({"duration": -1.0, "seed": -1}, ["duration: must", "seed: "]),
        ({"obstacles": 3}, ["obstacles: expected"]),
        ({"reference": None}, ["missing key `reference`"]),
    ],
)
def test_no_consequence_is_taken_for_a_fault(changes: dict[str, object], expected: list[str]) -> None:
    document = vff.Scenario.load("on-path").to_dict() | changes
    found = faults({key: value for key, value in document.items() if value is not None})
    assert all(any(each.startswith(start) for each in found) for start in expected), found
    assert all(any(each.startswith(start) for start in expected) for each in found), found


def test_faults_hide_no_others(tmp_path: Path) -> None:
    """A wrong arm, a wrong number of joints and a mistyped key leave the rest to be looked at."""
    text = """
    duraton = 3.0
    q0 = [0.1, 0.2]
    arm = { lengths = [1, 1, -1], masses = [1, 1, 1], gravty = 3 }
    controller = { stifness = -3, posture = [1] }
    reference = { kind = "line", ende = [1, 2], duration = -1 }
    plant = { masses = [1], bar = 2 }
    measurement = { position_noise = -2 }
    replan = { latency = -1 }
    """
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    found = [each.removeprefix(f"{path}: ") for each in vffnull("validate", path, code=2).stderr.splitlines()]
    expected = (
        "arm: unknown key `gravty`",
        "arm.lengths[2]: ",
        "controller: unknown key `stifness`",
        "controller.stiffness: ",
        "controller.posture: ",
        "unknown key `duraton`",
        "q0: expected 3",
        "reference: unknown key `ende`",
        "reference.duration: ",
        "plant: unknown key `bar`",
        "plant.masses: ",
        "measurement.position_noise: ",
        "replan.latency: ",
    )
    assert all(any(each.startswith(start) for each in found) for start in expected), found
    assert all(any(each.startswith(start) for start in expected) for each in found), found


def test_validate_prints_no_warning_of_pythons(tmp_path: Path) -> None:
    """What is odd in the file of an arm is one of the warnings; if it cannot be read, the rest is judged."""
    (tmp_path / "robot.urdf").write_text(vff.Arm.named("panda").to_urdf(), encoding="utf-8")
    path = tmp_path / "mine.toml"
    text = 'duration = 1\nq0 = [0, -0.8, 0, -2.4, 0, 1.6, 0.8]\nreference.kind = "setpoint"\n[arm]\n'
    path.write_text(f'{text}urdf = "robot.urdf"\ntip = "panda_link7"\n', encoding="utf-8")
    said = vffnull("validate", path).stderr
    assert "ScenarioWarning" not in said and all(f"{path}: warning: " in line for line in said.splitlines())
    path.write_text(f'seed = -1\n{text}urdf = "missing.urdf"\n', encoding="utf-8")
    said = vffnull("validate", path, code=2).stderr
    assert "missing.urdf" in said and "seed: " in said and len(said.splitlines()) == 2, said


def test_what_a_study_is_and_fewer_runs_of_it() -> None:
    assert vffnull("study", "show", "disturbances").stdout.startswith("# How well the null space hides")
    said = vffnull("study", "run", "disturbances", "--runs", "200", "--dry-run").stdout
    assert "112 runs" in said  # 16 points of 7 runs: a power of two
    assert "takes 7" in vffnull("study", "run", "disturbances", "--runs", "3", "--dry-run", code=2).stderr


def test_one_picture(tmp_path: Path) -> None:
    vffnull("run", "paper-1", *SHORT, "--plot", tmp_path / "run.png")
    assert [each.name for each in tmp_path.iterdir()] == ["run.png"]
    assert vff.simulate("paper-1", {"duration": 0.1}).plot(tmp_path / "x.svg") == [tmp_path / "x.svg"]


def test_films_of_a_size_and_from_a_side(tmp_path: Path) -> None:
    from PIL import Image

    short = ("--set", "duration=0.2", "--fps", "5")
    for view in ("left", "30,60"):
        vffnull("animate", "panda-sweep", tmp_path / "a.gif", "--size", "200", "--view", view, *short)
        with Image.open(tmp_path / "a.gif") as film:
            assert film.width == 200 and getattr(film, "n_frames", 0) == 2
    said = vffnull("animate", "panda-sweep", tmp_path / "a.gif", "--view", "above", code=2).stderr
    assert "front, left, back, right, top" in said
    assert "size" in vffnull("animate", "panda-sweep", tmp_path / "a.gif", "--size", "9", code=2).stderr


def test_sound_scenarios_have_no_faults() -> None:
    for name in vff.scenarios():
        document = vff.Scenario.load(name).to_dict()
        assert faults(document) == [] and document == vff.Scenario.load(name).to_dict()


# --------------------------------------------------------------------------------------------- next steps


def test_a_run_ends_with_what_to_do_next(tmp_path: Path) -> None:
    """As commands that can be copied: with the same changes, and from the file if one was written."""
    printed = vffnull("run", "sweep-through", *SHORT).stdout.splitlines()
    assert printed[-2:] == [
        "next: vffnull live sweep-through --set duration=0.05",
        "      vffnull report sweep-through sweep-through.html --set duration=0.05",
    ]
    file = tmp_path / "my run.npz"
    last = vffnull("run", "sweep-through", *SHORT, "--save", file).stdout.splitlines()[-1]
    assert last == f"      vffnull report '{file}' sweep-through.html"
    assert shell(last.strip(), cwd=tmp_path)[0] == 0 and (tmp_path / "sweep-through.html").is_file()
    assert vffnull("run", "sweep-through", *SHORT, "-q").stdout == ""


@pytest.mark.parametrize(("kind", "magic"), [("pdf", b"%PDF"), ("svg", b"<?xml"), ("png", b"\x89PNG")])
def test_figures_of_other_kinds(kind: str, magic: bytes, tmp_path: Path) -> None:
    vffnull("run", "sweep-through", *SHORT, "-q", "--plot", tmp_path, "--format", kind)
    files = list(tmp_path.iterdir())
    assert len(files) > 4
    assert all(each.suffix == f".{kind}" and each.read_bytes().startswith(magic) for each in files)


def test_formats_that_there_are_not(short: vff.Result, tmp_path: Path) -> None:
    with pytest.raises(vff.errors.InputError, match="format: expected one of png, pdf, svg, not 'bmp'"):
        short.plot(tmp_path, format="bmp")
    assert "bmp" in vffnull("run", "paper-1", "--plot", tmp_path, "--format", "bmp", code=2).stderr


# ---------------------------------------------------------------------------------------------- poor shells


def test_closed_streams(tmp_path: Path) -> None:
    """With stderr or stdout closed, a run is the same, and wrong input still has its exit code."""
    run = "vffnull run sweep-through --set duration=0.05"
    open_code, expected, _ = shell(run)
    code, out, _ = shell(f"{run} 2>&-")
    assert open_code == code == 0
    assert [line for line in out.splitlines() if "computed" not in line] == [
        line for line in expected.splitlines() if "computed" not in line
    ]
    assert shell(f"{run} >&-")[0] == 0 and shell(f"{run} >&- 2>&- <&-")[0] == 0
    assert shell("vffnull run nothing 2>&-")[0] == 2 and shell("vffnull run --nothing 2>&-")[0] == 2
    assert shell("vffnull evaluate --category x 2>&-")[0] == 2
    assert shell("vffnull list | true") == (0, "", "")


@pytest.mark.parametrize("words", ["list", "schema", "validate paper-1"])
def test_a_reader_that_has_gone(words: str) -> None:
    """As of a pipe into `head`: that is no failure."""
    read, write = os.pipe()
    os.close(read)
    try:
        done = subprocess.run(
            [sys.executable, "-m", "vffnull", *words.split()], stdout=write, stderr=subprocess.PIPE
        )
    finally:
        os.close(write)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize(
    "words",
    ["run sweep-through --save a.npz", "run sweep-through --plot a.png", "report sweep-through a.html",
     "realtime sweep-through --seconds 1 --plot a.png", "animate sweep-through a.gif", "live sweep-through"],
)  # fmt: skip
def test_a_folder_of_somebody_else(words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where nothing can be written is told before anything is computed."""
    from click.testing import CliRunner

    from vffnull.cli import _commands

    def never(*_given: object, **_more: object) -> None:
        raise AssertionError("computed")

    monkeypatch.chdir(tmp_path)
    theirs = tmp_path.resolve()
    monkeypatch.setattr(os, "access", lambda place, how: not how & os.W_OK or Path(place).resolve() != theirs)
    for module, name in (("cli.common", "run_scenario"), ("cli.realtime", "measure"), ("live", "extra")):
        monkeypatch.setattr(importlib.import_module(f"vffnull.{module}"), name, never)
    done = CliRunner().invoke(_commands, words.split())
    assert isinstance(done.exception, PermissionError), done.exception


def test_a_full_disk_takes_no_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was computed is printed although it cannot be saved."""
    from click.testing import CliRunner

    from vffnull.cli import _commands

    def full(*_given: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(vff.Result, "save", full)
    words = ["run", "sweep-through", "--json", "--save", str(tmp_path / "a.npz"), *SHORT]
    done = CliRunner().invoke(_commands, words)
    assert isinstance(done.exception, OSError)
    assert json.loads(done.stdout)["scenario"] == "sweep-through"


@pytest.mark.parametrize("encoding", ["cp1252", "ascii", "latin-1"])
def test_narrow_terminals(encoding: str, tmp_path: Path) -> None:
    """What the terminal cannot show is escaped, and JSON stays JSON."""
    name = tmp_path / "λ.toml"
    text = str(vff.Scenario.load("sweep-through").replace(name="λ→µ", description="≤ 2π", duration=0.05))
    name.write_text(text, encoding="utf-8")
    for arguments in (["run", name], ["show", name], ["schema"], ["validate", name], ["--help"], ["list"]):
        vffnull(*arguments, PYTHONIOENCODING=encoding)
    done = vffnull("run", name, "--json", PYTHONIOENCODING=encoding)
    assert json.loads(done.stdout)["scenario"] == "λ→µ"
    assert json.loads(vffnull("show", name, "--json", PYTHONIOENCODING=encoding).stdout)["name"] == "λ→µ"
    assert "no scenario" in vffnull("run", "λ", code=2, PYTHONIOENCODING=encoding).stderr


def test_bytes_that_are_no_text() -> None:
    """A terminal in another encoding sends such: a sentence, in `--set` as in names and paths."""
    for arguments in (
        "run paper-1 --set name=\udcff",
        "run \udcff",
        "run \udcff.toml",
        "validate \udcff.toml",
        "arms show \udcff",
        "study tune gains --out \udcff",
    ):
        done = subprocess.run(
            [sys.executable, "-m", "vffnull", *arguments.split()], capture_output=True, text=True
        )
        assert done.returncode == 2 and "Traceback" not in done.stderr and r"\udcff" in done.stderr


def test_a_backend_that_does_not_exist(tmp_path: Path) -> None:
    """Figures go into files: no backend for windows is asked for."""
    vffnull("run", "sweep-through", *SHORT, "-q", "--plot", tmp_path, MPLBACKEND="nothing")
    vffnull("animate", "sweep-through", tmp_path / "a.gif", *SHORT, "-q", MPLBACKEND="nothing")
    assert (tmp_path / "overview.png").is_file() and (tmp_path / "a.gif").is_file()


def test_the_last_port_is_taken() -> None:
    with socket.socket() as other:
        try:
            other.bind(("127.0.0.1", 65_535))
        except OSError:
            pass  # somebody else has it: just as well
        else:
            other.listen()
        printed = vffnull("live", "--port", 65_535, "--no-browser", code=2).stderr
    assert "--port: 65535 is taken" in printed
    assert "from 1024 to 65535" in vffnull("live", "--port", 70_000, code=2).stderr


def test_an_empty_file_is_told_of(tmp_path: Path) -> None:
    """As `vffnull arms new robot.urdf > mine.toml` leaves one where it refuses the robot."""
    (tmp_path / "mine.toml").write_text("\n")
    with pytest.raises(vff.errors.ScenarioError, match=r"mine.toml: the file is empty"):
        vff.Scenario.load(tmp_path / "mine.toml")
