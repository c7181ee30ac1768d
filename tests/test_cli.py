"""The command ``vffnull``: what it prints, and with which code it ends (README)."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import vffnull as vff
from vffnull.errors import InputError, ScenarioError
from waiting import HANG, processor_time, wait_for


def vffnull(*arguments: object, cwd: Path | None = None, code: int = 0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "vffnull", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG, cwd=cwd)
    assert done.returncode == code, (done.returncode, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr and "panicked" not in done.stderr
    return done


def test_the_console_script_is_installed() -> None:
    script = Path(sys.executable).with_name("vffnull")
    done = subprocess.run([script, "--version"], capture_output=True, text=True, timeout=HANG)
    assert done.returncode == 0 and vff.__version__ in done.stdout


def test_list() -> None:
    printed = vffnull("list").stdout
    assert [line.split()[0] for line in printed.splitlines()] == vff.scenarios()
    for name in vff.scenarios():
        assert vff.Scenario.load(name).description in printed


def test_show_prints_a_scenario_with_its_comments(tmp_path: Path) -> None:
    printed = vffnull("show", "paper-1").stdout
    assert "# rad; paper" in printed
    (tmp_path / "mine.toml").write_text(printed, encoding="utf-8")
    assert vff.Scenario.load(tmp_path / "mine.toml") == vff.Scenario.load("paper-1")


def test_mujoco_moves_the_arm() -> None:
    """In the plane and in space, and `core` is the default."""
    for name in ("sweep-through", "panda-sweep"):
        short = ("run", name, "--set", "duration=0.05")
        assert "in MuJoCo: " in vffnull(*short, "--plant", "mujoco").stdout
        for plant in ((), ("--plant", "core")):
            assert "MuJoCo" not in vffnull(*short, *plant).stdout
    assert "'core', 'mujoco'" in vffnull("run", "paper-1", "--plant", "pinocchio", code=2).stderr


def test_schema_names_every_key() -> None:
    """Each key that a bundled scenario uses, and those that scripts override by name (README)."""
    printed = vffnull("schema").stdout

    def keys(value: object) -> set[str]:
        if isinstance(value, dict):
            return set(value).union(*(keys(inner) for inner in value.values()))
        if isinstance(value, list):
            return set().union(*(keys(inner) for inner in value))
        return set()

    used = set().union(*(keys(vff.Scenario.load(name).to_dict()) for name in vff.scenarios()))
    used |= {
        "dt",
        "integrator",
        "control",
        "record_every",
        "control_every",
        "formulation",
        "projection",
        "avoidance",
        "yielding",
        "margin",
        "rate",
        "inner",
        "outer",
        "saturation",
        "activation",
        "task_weight",
        "slack_weight",
        "preview",
        "horizon",
        "trigger",
        "characteristic_length",
        "candidates",
        "speed",
        "posture",
        "posture_stiffness",
        "singularity",
        "approach_damping",
        "floor",
        "joint_limits",
        "torque_limits",
        "com",
        "inertias",
        "dq0",
        "seed",
        "payload",
        "viscous_friction",
        "coulomb_friction",
        "joint_stops",
        "position_noise",
        "velocity_noise",
        "position_resolution",
        "velocity_resolution",
        "delay",
        "time_constant",
    }
    assert {key for key in used if key not in printed} == set()


def test_validate(tmp_path: Path) -> None:
    good, bad, odd = tmp_path / "good.toml", tmp_path / "bad.toml", tmp_path / "odd.toml"
    vff.Scenario.load("paper-2").save(good)
    bad.write_text(good.read_text().replace("stiffness", "stifness", 1))
    odd.write_text(good.read_text().replace("duration = 10.0", "duration = 9.9995", 1))
    assert "valid" in vffnull("validate", good).stdout
    done = vffnull("validate", good, bad, code=2)
    assert "good.toml: valid" in done.stdout
    assert "bad.toml" in done.stderr and "controller" in done.stderr and "`stiffness`" in done.stderr
    assert "warning" in vffnull("validate", odd).stderr


def test_run_prints_a_table() -> None:
    done = vffnull("run", "paper-1")
    for text in ("paper-1", "completed", "min_clearance", "max_error_tail", "N·m"):
        assert text in done.stdout
    assert vffnull("run", "paper-1", "--set", "duration=0.5", "--quiet").stdout == ""


def test_run_json() -> None:
    """`vffnull run paper-1 --json` prints the status, a tail error below 1e-5 m, a positive clearance."""
    done = vffnull("run", "paper-1", "--json")
    report = json.loads(done.stdout)  # one valid object and nothing else
    assert (
        report["status"] == "completed"
        and report["scenario"] == "paper-1"
        and report["version"] == vff.__version__
    )
    assert report["metrics"]["max_error_tail"] < 1e-5 and report["metrics"]["min_clearance"] > 0
    assert report["end_time"] == 20.0
    assert dict(vff.simulate("paper-1").metrics) == report["metrics"]


def test_json_is_strict_json_without_obstacles(tmp_path: Path) -> None:
    """No NaN and no Infinity, which JSON does not know."""
    vff.Scenario.load("paper-1").replace(obstacles=None, duration=0.1).save(tmp_path / "free.toml")

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    report = json.loads(vffnull("run", tmp_path / "free.toml", "--json").stdout, parse_constant=refuse)
    assert report["metrics"]["min_clearance"] is None


def test_set(tmp_path: Path) -> None:
    """Numbers, lists, words, texts, list elements; several at once; the result carries them."""
    file = tmp_path / "run.npz"
    vffnull(
        "run",
        "sweep-through",
        "--set",
        "duration=0.1",
        "--set",
        "controller.field.gain=2.0",
        "--set",
        "controller.projection=none",
        "--set",
        'simulation.control="predictor"',
        "--set",
        "obstacles.0.position=[1.5, 2.5]",
        "--set",
        "controller.stiffness = [90, 110]",
        "--set",
        "name='mine'",
        "--save",
        file,
        "--quiet",
    )
    scenario = vff.Result.load(file).scenario
    given = {
        "duration": 0.1,
        "controller.field.gain": 2.0,
        "controller.projection": "none",
        "simulation.control": "predictor",
        "obstacles.0.position": [1.5, 2.5],
        "controller.stiffness": [90, 110],
        "name": "mine",
    }
    assert {key: scenario[key] for key in given} == given


@pytest.mark.parametrize(
    ("assignment", "says"),
    [
        ("duration", "KEY=VALUE"),
        ("=5", "KEY=VALUE"),
        ("duration=", "KEY=VALUE"),
        ("duration=[1", "TOML"),
        ("duration=1\nname='x'", ""),
        ("durration=5", "duration"),
        ("controller.field.gian=5", "gain"),
        ("duration=-1", "greater than 0"),
        ("obstacles.3.position=[1,2]", "obstacles.3.position"),
    ],
)
def test_set_refuses(assignment: str, says: str) -> None:
    done = vffnull("run", "paper-1", "--set", assignment, code=2)
    assert says in done.stderr and done.stdout == ""


def test_plot_and_save(tmp_path: Path) -> None:
    done = vffnull(
        "run",
        "sweep-through",
        "--set",
        "duration=0.2",
        "--plot",
        tmp_path / "figures",
        "--save",
        tmp_path / "run.npz",
        "--json",
    )
    files = [Path(name) for name in json.loads(done.stdout)["files"]]
    assert tmp_path / "run.npz" in files and tmp_path / "figures" / "strobe.png" in files
    assert all(file.is_file() for file in files)


def test_wrong_output_is_found_before_the_run(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    vffnull("run", "paper-1", "--save", tmp_path / "run.xlsx", code=2)
    vffnull("run", "paper-1", "--plot", tmp_path / "file", code=2)
    vffnull("run", "paper-1", "--set", "duration=0.1", "--save", tmp_path / "missing" / "run.npz", code=2)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        (["--plot", "x.jpg"], "x.jpg: a figure is written as .png, .pdf or .svg, not .jpg"),
        (["--plot", "x.gif"], "a figure is written as"),
        (["--plot", ""], "not an empty name"),
        (["--plot", "x.svg", "--format", "pdf"], "--format pdf: x.svg is written as its ending says"),
    ],
)
def test_figures_of_no_kind_are_refused_before_the_run(given: list[str], says: str, tmp_path: Path) -> None:
    """No folder is made of a file's name, and nothing is written where nothing was named."""
    command = [sys.executable, "-m", "vffnull", "run", "paper-1", "--quiet", *given]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=HANG, check=False)
    assert done.returncode == 2 and says in done.stderr
    assert not list(tmp_path.iterdir())


def test_one_figure_and_folders_with_dots(tmp_path: Path, short: vff.Result) -> None:
    """An ending counts in capitals, too; what is no ending belongs to the name of a folder."""
    short_run = ("run", "sweep-through", "--quiet", "--set", "duration=0.1", "--plot")
    vffnull(*short_run, tmp_path / "one.PNG")
    assert (tmp_path / "one.PNG").read_bytes().startswith(b"\x89PNG")
    vffnull(*short_run, tmp_path / "one.svg", "--format", "svg")
    assert b"<svg" in (tmp_path / "one.svg").read_bytes()
    vffnull(*short_run, tmp_path / "gain-0.5", "--format", "svg")
    assert (tmp_path / "gain-0.5" / "overview.svg").is_file()
    with pytest.raises(InputError, match="figure is written as"):
        short.plot(tmp_path / "x.jpg")
    with pytest.raises(InputError, match="empty name"):
        short.plot("")


def test_what_is_wrong_with_a_file_names_it(tmp_path: Path) -> None:
    """Also what is found only when all of it is known."""
    text = str(vff.Scenario.load("sweep-through"))
    (tmp_path / "key.toml").write_text(text.replace("stiffness =", "stifness =", 1), encoding="utf-8")
    done = vffnull("run", "key.toml", cwd=tmp_path, code=2)
    assert done.stderr.startswith("error: key.toml: controller: unknown key `stifness`")
    done = vffnull("validate", "key.toml", cwd=tmp_path, code=2)
    assert done.stderr.count("key.toml") == 1
    with pytest.raises(ScenarioError, match=r"key\.toml: controller: unknown key") as told:
        vff.Scenario.load(tmp_path / "key.toml")
    assert told.value.path == "controller"


@pytest.mark.parametrize("text", ["x" * 500_000, f"q0 = [{'0.1, ' * 100_000}oh]", f"a = {'[' * 100_000}"])
def test_a_long_line_is_not_told_in_full(text: str, tmp_path: Path) -> None:
    """But what stands around the fault, and the mark below it."""
    (tmp_path / "long.toml").write_text(text, encoding="utf-8")
    done = vffnull("run", "long.toml", cwd=tmp_path, code=2)
    assert len(done.stderr) < 400 and "long.toml: not valid TOML" in done.stderr
    line, mark = done.stderr.splitlines()[3:5]
    assert line.startswith("1 | …") and mark.rstrip().endswith("^")
    if text.endswith("oh]"):
        assert line[mark.index("^")] == "o"


ERRORS = [
    (["run", "paper1"], "'paper-1'"),
    (["show", "crowds"], "'crowd'"),
    (["rnu", "paper-1"], "'run'"),
    (["paper-1"], "run paper-1"),
    (["run"], "SCENARIO"),
    (["run", "paper-1", "--plott", "x"], "--plot"),
    (["run", "missing.toml"], "missing.toml"),
    (["animate", "paper1", "a.gif"], "'paper-1'"),
    (["animate", "paper-1", "a.avi"], ".mp4"),
    (["animate", "missing.npz", "a.gif"], "missing.npz: No such file"),
    (["animate", "run.npz", "a.gif", "--set", "duration=1"], "--set"),
    (["report", "crowds", "a.html"], "'crowd'"),
    (["report", "crowd", "a.pdf"], ".html"),
    (["compare", "crowd", "a.txt"], ".html"),
    (["repotr", "crowd", "a.html"], "'report'"),
    (["validate", "missing.toml"], "missing.toml"),
    (["validate"], "FILE"),
]


@pytest.mark.parametrize(("arguments", "says"), ERRORS, ids=[" ".join(a) for a, _ in ERRORS])
def test_errors(arguments: list[str], says: str) -> None:
    """Code 2, one sentence that suggests the nearest name, no traceback."""
    done = vffnull(*arguments, code=2)
    assert says in done.stderr and done.stdout == ""
    sentences = [
        line for line in done.stderr.splitlines() if not line.startswith(("Usage:", "Try ")) and line.strip()
    ]
    assert len(sentences) == 1, done.stderr


def test_broken_files(tmp_path: Path) -> None:
    file = tmp_path / "broken.toml"
    file.write_text("duration = = 5")
    done = vffnull("run", file, code=2)
    assert "broken.toml" in done.stderr and "duration = = 5" in done.stderr


def test_strict_and_exit_codes(tmp_path: Path) -> None:
    """0 success, also after a collision; 3 under --strict, and after a divergence."""
    collide = ["run", "sweep-through", "--set", "controller.field.gain=0", "--json"]
    assert json.loads(vffnull(*collide).stdout)["status"] == "collided"
    vffnull(*collide, "--strict", code=3)
    vffnull("run", "sweep-through", "--set", "duration=0.1", "--strict")
    done = vffnull(
        "run",
        "sweep-through",
        "--set",
        "controller.stiffness=1e7",
        "--set",
        "simulation.dt=0.02",
        "--json",
        "--save",
        tmp_path / "run.npz",
        code=3,
    )
    assert json.loads(done.stdout)["status"] == "diverged"
    assert vff.Result.load(tmp_path / "run.npz").status == "diverged"


def test_warnings_go_to_stderr() -> None:
    done = vffnull("run", "paper-1", "--set", "duration=0.1003", "--json")
    assert "warning" in done.stderr
    json.loads(done.stdout)


def test_help() -> None:
    """Every command shows how it is used."""
    assert "Usage" in vffnull("-h").stdout and "_VFFNULL_COMPLETE=bash_source" in vffnull("--help").stdout
    for command in ("run", "list", "show", "validate", "animate", "report", "compare"):
        printed = vffnull(command, "--help").stdout
        assert "Usage" in printed and f"  vffnull {command}" in printed
    assert "130" in vffnull("run", "--help").stdout


def test_completion() -> None:
    """click's protocol, as the line in the help sets it up: commands, options, names of scenarios."""

    def offered(words: str) -> set[str]:
        asked = {"_VFFNULL_COMPLETE": "bash_complete", "COMP_WORDS": f"vffnull {words}"}
        asked["COMP_CWORD"] = str(len(words.split()))
        command = [sys.executable, "-m", "vffnull"]
        done = subprocess.run(command, env=os.environ | asked, capture_output=True, text=True, timeout=HANG)
        return {line.split(",", 1)[1] for line in done.stdout.splitlines() if line.startswith("plain")}

    assert offered("re") == {"realtime", "report"}
    assert offered("run --pl") == {"--plant", "--plot"}
    names = {"paper-2", "paper-2-moving", "paper-2-printed"}
    assert offered("run paper-2") == offered("animate paper-2") == names


def test_results_from_a_file_or_from_a_scenario(tmp_path: Path) -> None:
    """`animate`, `report` and `compare` take both; `run --save` writes what they read."""
    file = tmp_path / "run.parquet"
    vffnull("run", "sweep-through", "--set", "duration=0.1", "--save", file, "-q")
    printed = vffnull("report", file, tmp_path / "run.html", "--json").stdout
    assert json.loads(printed) == {
        "runs": [{"scenario": "sweep-through", "status": "completed", "verdict": "completed"}],
        "files": [str(tmp_path / "run.html")],
    }
    assert "run.gif" in vffnull("animate", file, tmp_path / "run.gif", "--fps", "10").stdout
    assert vffnull("animate", "crowd", tmp_path / "c.gif", "--set", "duration=0.2", "-q").stdout == ""
    vffnull("compare", file, "sweep-through", tmp_path / "both.html")
    for name in ("run.html", "run.gif", "c.gif", "both.html"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_json_of_the_other_commands(tmp_path: Path) -> None:
    listed = json.loads(vffnull("list", "--json").stdout)
    assert [each["name"] for each in listed] == vff.scenarios()
    assert all(each["description"] for each in listed)
    shown = json.loads(vffnull("show", "paper-1", "--json").stdout)
    assert vff.Scenario.from_dict(shown) == vff.Scenario.load("paper-1")
    good = tmp_path / "good.toml"
    vff.Scenario.load("paper-1").save(good)
    judged = json.loads(vffnull("validate", good, "missing.toml", "--json", code=2).stdout)
    assert judged[0] == {"file": str(good), "error": None, "errors": [], "warnings": []}
    assert "missing.toml" in judged[1]["error"]


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_ctrl_c_keeps_what_there_is(tmp_path: Path) -> None:
    """SIGINT ends a run of hours at once, with code 130, a report, and the partial result saved.

    At once: after less than a second of computing, however long the machine takes for that. The run has begun
    when it has computed for longer than starting and reading take.
    """
    file = tmp_path / "partial.npz"
    command = [
        sys.executable,
        "-m",
        "vffnull",
        "run",
        "paper-1",
        "--set",
        "duration=1e6",
        "--set",
        "simulation.record_every=1000",
        "--json",
        "--save",
        str(file),
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    wait_for(lambda: process.poll() is not None or processor_time(process.pid) > 1.5, "the run")
    assert process.poll() is None, process.communicate()
    sent = processor_time(process.pid)
    os.kill(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=HANG)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    assert spent - sent < 1.0
    assert process.returncode == 130 and "Traceback" not in err
    report = json.loads(out)
    assert report["status"] == "interrupted" and 0 < report["end_time"] < 1e6
    partial = vff.Result.load(file)
    assert partial.status == "interrupted"
    assert (
        partial.t[-1] == pytest.approx(report["end_time"], abs=1.0) and len(partial.t) == len(partial.q) > 1
    )


@pytest.mark.parametrize("formulation", ["recursive", "extended_jacobian"])
def test_ctrl_c_in_python_is_a_result(formulation: str) -> None:
    """`simulate` returns the partial result instead of raising; also for 40 links in the dense form.

    The signal comes when the run reports progress for the first time, from another thread.
    """
    code = f"""
import os, signal, threading, time
import vffnull as vff
arm = vff.Arm.uniform(40)
q0 = [0.05] * 40
scenario = vff.Scenario(arm=arm, q0=q0, duration=1e4, reference={{"kind": "setpoint",
    "point": arm.forward_kinematics(q0)[-1]}}, controller={{"formulation": "{formulation}"}},
    simulation={{"record_every": 100000}})
sent, running = [], threading.Event()
def interrupt():
    running.wait()
    sent.append(time.process_time())
    os.kill(os.getpid(), signal.SIGINT)
threading.Thread(target=interrupt).start()
result = vff.simulate(scenario, progress=lambda t, duration: running.set())
print(result.status, time.process_time() - sent[0])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert done.returncode == 0, done.stderr
    status, late = done.stdout.split()
    assert status == "interrupted" and float(late) < 1.0


def test_what_is_read_is_not_written_over(tmp_path: Path, short: vff.Result) -> None:
    """Where the ending of a file does not keep it from being the one that is read, as of a link."""
    saved, scene = short.save(tmp_path / "run.npz"), tmp_path / "scene.toml"
    short.scenario.save(scene)
    before = saved.read_bytes(), scene.read_bytes()
    for name, target in (("run.html", saved), ("run.gif", saved), ("scene.npz", scene), ("scene.png", scene)):
        (tmp_path / name).symlink_to(target)
    for arguments in (
        ("report", "run.npz", "run.html"),
        ("compare", "run.npz", "run.html"),
        ("animate", "run.npz", "run.gif"),
        ("run", "scene.toml", "--save", "scene.npz"),
        ("run", "scene.toml", "--plot", "scene.png"),
        ("plan", "scene.toml", "--out", "scene.npz"),
        ("realtime", "scene.toml", "--plot", "scene.png"),
    ):
        told = vffnull(*arguments, cwd=tmp_path, code=2).stderr
        assert "is read, and would be written over; name another file" in told
    assert (saved.read_bytes(), scene.read_bytes()) == before


def test_figures_that_cannot_be_written_cost_no_runs(tmp_path: Path) -> None:
    """A file where a folder is meant, and a folder where a file is: refused before anything is computed."""
    (tmp_path / "taken").touch()
    (tmp_path / "folder.npz").mkdir()
    for words in (
        ["evaluate", "--plot", tmp_path / "taken"],
        ["run", "paper-1", "--save", tmp_path / "folder.npz"],
    ):
        done = vffnull(*words, code=2)
        assert not done.stdout and "directory" in done.stderr, done
