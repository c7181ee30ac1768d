"""The package as it is installed: names, types, stubs, and how little an import loads."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import importlib.util
import inspect
import json
import math
import pickle
import re
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import yaml

import vffnull as vff
from vffnull.model.keys import known
from waiting import HANG

CONTRACT = {
    vff: (
        "simulate",
        "simulate_many",
        "metrics_table",
        "realtime",
        "scenarios",
        "compare",
        "StreamRecorder",
        "Arm",
        "Obstacle",
        "Motion",
        "Field",
        "ControlSettings",
        "Controller",
        "Distances",
        "distances",
        "Simulation",
        "Result",
        "Scenario",
        "Status",
        "VffNullError",
        "__version__",
    ),
    vff.Arm: (
        "uniform",
        "n",
        "forward_kinematics",
        "jacobian",
        "jacobian_dot",
        "mass_matrix",
        "coriolis_matrix",
        "gravity_torque",
        "inverse_dynamics",
        "forward_dynamics",
        "extended_jacobian",
    ),
    vff.ExtendedJacobian: ("Z", "N_M", "J_e", "J_e_inv", "E_e", "mu", "Lambda_x", "Lambda_n"),
    vff.Obstacle: ("circle", "capsule", "box", "polygon"),
    vff.Motion: ("linear", "sinusoid", "waypoints"),
    vff.Body: ("from_bvh", "reaching", "swinging", "walking", "placed", "obstacles"),
    vff.Field: ("khatib", "cubic", "bounded"),
    vff.Controller: ("torque", "terms"),
    vff.Terms: ("tau", "tau_task", "tau_null", "tau_vff", "force", "clearance", "N"),
    vff.Simulation: ("step", "state", "reset"),
    vff.Scenario: ("load", "from_dict", "to_dict", "save", "replace"),
    vff.RealTimeReport: ("verdict", "held", "plot", "to_dict"),
    vff.Result: ("plot", "animate", "report", "save", "load", "to_pandas", "to_xarray", "to_arrow"),
}


@pytest.mark.parametrize("owner", CONTRACT, ids=lambda owner: getattr(owner, "__name__", "?"))
def test_names_of_the_contract(owner: object) -> None:
    """The public interface: names that other people's scripts call."""
    assert [name for name in CONTRACT[owner] if not hasattr(owner, name)] == []  # type: ignore[index]


def test_the_contracts_own_calls() -> None:
    """The calls that the README and the stubs show, in one go."""
    arm = vff.Arm.uniform(6, length=1.0, mass=1.0)
    lengths, masses = [1.0] * 6, [1.0] * 6
    assert (
        vff.Arm(
            lengths,
            masses,
            com=None,
            inertias=None,
            radius=0.0,
            gravity=0.0,
            joint_limits=None,
            torque_limits=None,
        ).n
        == arm.n
        == 6
    )
    settings = vff.ControlSettings(
        stiffness=16.0,
        damping=8.0,
        null_damping=2.0,
        field=vff.Field.khatib(5.0, 1.2),
        formulation="recursive",
        projection="dynamic",
        avoidance="null_space",
    )
    controller = vff.Controller(arm, settings)
    q, dq = [0.0, 0.25, 0.12, 0.30, 0.20, 0.15], [0.0] * 6
    assert controller.torque(q, dq, [2.8, 1.6], dx_ref=None, ddx_ref=None, obstacles=(), t=0.0).shape == (6,)
    assert controller.terms(q, dq, [2.8, 1.6]).N.shape == (6, 6)
    assert arm.forward_kinematics(q).shape == (7, 2) and arm.jacobian(q).shape == arm.jacobian_dot(
        q, dq
    ).shape == (2, 6)
    assert arm.forward_kinematics([q, q, q]).shape == (3, 7, 2)


def test_every_public_name_is_documented() -> None:
    """Every name in `__all__` exists and has a docstring, and so have its public methods."""
    for name in vff.__all__:
        thing = getattr(vff, name)
        if name == "__version__":
            continue
        assert thing.__doc__, name
    for method in ("save", "load", "plot", "animate", "to_pandas", "to_xarray"):
        assert getattr(vff.Result, method).__doc__


def test_dir_shows_the_public_names_and_nothing_else() -> None:
    assert dir(vff) == sorted(vff.__all__)
    assert all(hasattr(vff, name) for name in dir(vff))
    assert "realtime" in dir(vff) and "real_time" not in dir(vff)
    with pytest.raises(AttributeError, match="nothing"):
        vff.nothing  # noqa: B018


def test_a_report_is_a_function_like_compare(short: vff.Result, tmp_path: Path) -> None:
    """Also after the package of the same name has been used."""
    assert vff.report(short, tmp_path / "run.html") == tmp_path / "run.html"
    short.report(tmp_path / "again.html")
    assert callable(vff.report) and callable(vff.compare)
    assert (tmp_path / "run.html").stat().st_size > 10_000


FORMS: dict[str, Callable[[Path], vff.scenario.ScenarioLike]] = {
    "name": lambda _: "sweep-through",
    "path": lambda folder: folder / "mine.toml",
    "path as text": lambda folder: str(folder / "mine.toml"),
    "document": lambda folder: vff.Scenario.load("sweep-through").to_dict(),
    "scenario": lambda folder: vff.Scenario.load("sweep-through"),
}


@pytest.mark.parametrize("form", FORMS)
def test_whatever_takes_a_scenario_takes_all_forms(form: str, tmp_path: Path) -> None:
    from vffnull.engines.gym import ReachEnv, ReachVectorEnv

    scenario = vff.Scenario.load("sweep-through")
    scenario.save(tmp_path / "mine.toml")
    given = FORMS[form](tmp_path)
    short = {"duration": 0.01}
    assert vff.simulate(given, short).scenario == scenario.replace(**short)
    assert vff.simulate_many([given], short)[0].scenario == scenario.replace(**short)
    assert vff.realtime(given, seconds=0.01).scenario == scenario
    assert vff.feasibility(given) == "with tip"
    np.testing.assert_array_equal(vff.Simulation(given).state.q, scenario["q0"])
    assert ReachEnv(given).scenario == ReachVectorEnv(1, given).scenario == scenario
    with vff.StreamRecorder(tmp_path / "run.arrows", given) as recorder:
        recorder.write(vff.Simulation(given).state)
    metadata = vff.StreamRecorder.read(recorder.path).schema.metadata
    assert json.loads(metadata[b"vffnull"])["scenario"] == scenario.to_dict()


@pytest.mark.parametrize(
    "thing", [None, 3, b"sweep-through", ["sweep-through"], object(), "nothing", "a.toml"]
)
def test_what_is_no_scenario_is_an_error_of_ours_everywhere(thing: Any, tmp_path: Path) -> None:
    from vffnull.engines.gym import ReachEnv

    calls: list[Callable[[], object]] = [
        lambda: vff.simulate(thing),
        lambda: vff.simulate_many([thing]),
        lambda: vff.realtime(thing, seconds=0.01),
        lambda: vff.feasibility(thing),
        lambda: vff.Simulation(thing),
        lambda: ReachEnv(thing),
    ]
    for call in calls:
        with pytest.raises(vff.VffNullError):
            call()


def test_a_controller_has_default_settings() -> None:
    arm = vff.Arm.uniform(4)
    q, dq, x = [0.1] * 4, [0.2] * 4, [3.0, 1.0]
    np.testing.assert_array_equal(
        vff.Controller(arm).torque(q, dq, x), vff.Controller(arm, vff.ControlSettings()).torque(q, dq, x)
    )


def test_metrics_and_films_show_themselves_in_a_notebook(short: vff.Result) -> None:
    shown = short.metrics._repr_html_()
    assert shown.count("<tr>") == len(short.metrics) - len(short.metrics.missing) and "min_clearance" in shown
    assert "&lt;b&gt;" in vff.Metrics({"<b>": 1.0})._repr_html_()
    film = short.animate(fps=10)
    assert "GIF" in repr(film)


def test_tables_of_metrics_have_no_rows_without_a_value(short: vff.Result) -> None:
    """What does not apply to a run is named below the table, so that nothing is lost."""
    named, missing = str(short.metrics).split("without a value: ")
    assert "–" not in named and "min_clearance " in named
    assert missing.replace("\n", " ").split(", ") == short.metrics.missing
    assert "collision_time" in short.metrics.missing
    assert str(vff.Metrics({"steps": 3})) == "steps  3   steps of the plant, the start among them"
    assert str(vff.Metrics({"replans": None})) == "without a value: replans"
    assert str(vff.Metrics({})) == "(no metrics)"


@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_what_is_not_finite_is_none_in_metrics() -> None:
    values = {"a": math.nan, "b": math.inf, "c": -math.inf, "d": 1.0, "e": 3, "f": None}
    assert dict(vff.Metrics(values)) == {"a": None, "b": None, "c": None, "d": 1.0, "e": 3, "f": None}
    wild = vff.simulate("paper-1", {"controller.null_damping": 1e9, "simulation.control": "hold"})
    assert wild.status == "diverged"
    assert all(value is None or math.isfinite(value) for value in wild.metrics.values())
    json.dumps(dict(wild.metrics), allow_nan=False)


def test_the_installed_package_is_tested() -> None:
    """Not the source tree: what a user gets."""
    assert "site-packages" in vff.__file__
    installed = Path(vff.__file__).parent
    assert (installed / "py.typed").is_file() and (installed / "_core.pyi").is_file()
    assert {path.stem for path in (installed / "scenarios").glob("*.toml")} == set(vff.scenarios())


def test_mistyped_parameters_are_told_what_was_meant() -> None:
    with pytest.raises(vff.errors.InputTypeError, match="'stifness'; did you mean 'stiffness'"):
        vff.ControlSettings(stifness=3.0)  # type: ignore[call-arg]
    with pytest.raises(vff.errors.InputTypeError, match="did you mean 'obstacles'"):
        vff.Scenario(obstacle=[])  # type: ignore[call-arg]


def test_a_scenario_takes_every_table_and_one_obstacle() -> None:
    tables = {name.partition(".")[0] for name in known()}
    assert tables == set(inspect.signature(vff.Scenario).parameters)
    arm = vff.Arm.uniform(3)
    reference = {"kind": "plan", "times": [0.0, 1.0], "points": [[0.5] * 3, [0.6] * 3]}
    ball = vff.Obstacle.circle([5, 5], 0.1)
    law = {"posture_stiffness": 20.0}
    made = vff.Scenario(
        arm=arm, q0=[0.5] * 3, duration=1.0, reference=reference, obstacles=ball, replan={}, controller=law
    )
    assert made["replan"] == {} and len(made["obstacles"]) == 1


@pytest.mark.parametrize(("name", "first"), [("from_urdf", "path_or_text"), ("from_mjcf", "path_or_model")])
def test_reading_an_arm_explains_its_parameters(name: str, first: str) -> None:
    """By help() itself: every one of the signature, each with a sentence, and none that is not there."""
    method = getattr(vff.Arm, name)
    text = inspect.getdoc(method) or ""
    section = text.partition("Parameters\n")[2].partition("\nRaises\n")[0]
    told = re.findall(r"^(\w+) : .+\n    \S", section, re.M)
    signature = [each for each in inspect.signature(method).parameters if each not in ("self", "cls")]
    assert told == signature and told[0] == first and len(told) > 8


def test_every_field_of_the_settings_answers_help() -> None:
    for owner in (vff.ControlSettings, vff.Field):
        for each in dataclasses.fields(owner):
            assert len(inspect.getdoc(getattr(owner, each.name)) or "") > 20
    settings = vff.ControlSettings(stiffness=3.0, field=vff.Field.khatib(1.0, 2.0))
    assert pickle.loads(pickle.dumps(settings)) == settings == dataclasses.replace(settings)
    with pytest.raises(dataclasses.FrozenInstanceError):
        settings.stiffness = 2.0  # type: ignore[misc]
    assert vff.arms.names() and "packages" in (vff.Arm.from_urdf.__doc__ or "")


def test_version() -> None:
    assert importlib.metadata.version("vffnull") == vff.__version__ == vff._core.__version__


def test_stubs_match_the_compiled_module(tmp_path: Path) -> None:
    """mypy's stubtest: every name, signature and property of `_core.pyi` exists as written.

    The rest of the package, and all that it imports, is `mypy --strict`'s to read.
    """
    alone = tmp_path / "mypy.ini"
    alone.write_text("[mypy]\n[mypy-vffnull.*]\nfollow_imports = skip\n")
    command = [sys.executable, "-m", "mypy.stubtest", "vffnull._core", "--mypy-config-file", str(alone)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=HANG)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-1000:]


HEAVY = ("numpy", "bokeh", "matplotlib", "pandas", "xarray", "tqdm", "PIL", "scipy", "mujoco", "pyarrow")


@pytest.mark.parametrize(
    ("code", "heavy", "most"),
    [
        ("import vffnull", (*HEAVY, "click"), 50),
        ("import vffnull.cli; vffnull.cli._commands(['--help'], standalone_mode=False)", HEAVY, 112),
    ],
    ids=["import vffnull", "vffnull --help"],
)
def test_start_is_light(code: str, heavy: tuple[str, ...], most: int) -> None:
    """NumPy, matplotlib and the like are loaded when used, and few modules beside (ARCHITECTURE.md).

    Counted, because times differ between machines. 44 and 111 modules are what it takes; they cost 20 and
    40 ms more than Python alone, where NumPy would cost another 110 ms.
    """
    script = (
        "import sys; before = set(sys.modules)\n"
        f"{code}\n"
        "new = set(sys.modules) - before\n"
        f"print([name for name in {heavy} if name in new], len(new), file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=HANG)
    found, count = done.stderr.strip().rsplit(maxsplit=1)
    assert found == "[]" and int(count) <= most, done.stderr


def test_a_run_is_light_too() -> None:
    """A simulation without plots needs NumPy alone."""
    code = (
        "import sys, vffnull; vffnull.simulate('paper-1', {'duration': 0.1}); "
        "print([m for m in ('matplotlib', 'pandas', 'tqdm') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert done.stdout.strip() == "[]", done.stdout + done.stderr


def test_missing_extra_is_named() -> None:
    """Without pandas the error says which extra brings it."""
    code = (
        "import sys; sys.modules['pandas'] = None; import vffnull\n"
        "try: vffnull.simulate('paper-1', {'duration': 0.1}).to_pandas()\n"
        "except ImportError as error: print(error)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=HANG)
    assert "vffnull[io]" in done.stdout, done.stdout + done.stderr


def test_errors_form_one_tree() -> None:
    from vffnull._support import errors

    leaves = (errors.ScenarioError, errors.InputError, errors.InputTypeError)
    assert all(issubclass(leaf, vff.VffNullError) for leaf in leaves)
    assert issubclass(errors.ScenarioError, ValueError) and issubclass(errors.InputError, ValueError)
    assert issubclass(errors.InputTypeError, TypeError) and issubclass(errors.ScenarioWarning, UserWarning)


ROOT = Path(__file__).resolve().parents[1]


def script(name: str) -> ModuleType:
    """A script of `.ci`."""
    spec = importlib.util.spec_from_file_location(name, ROOT / ".ci" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_metadata() -> None:
    """Who, how far, where: what a package index shows. The citation names the same people and version."""
    about = importlib.metadata.metadata("vffnull")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert (
        about["Author"] == citation["authors"][0]["name"]
        and about["License-Expression"] == citation["license"]
    )
    assert citation["version"] == vff.__version__
    kinds = [each.split(" :: ")[0] for each in about.get_all("Classifier") or ()]
    assert kinds.count("Operating System") == 3 and "Development Status" in kinds


@pytest.mark.skipif(sys.platform != "linux", reason="reads an ELF file")
def test_the_library_is_stripped() -> None:
    """No symbols, no line tables: they were six parts of seven. With plans, drives, contacts, the search of
    the self-motion, cameras, planes between hulls, parts of a task, plans that keep upright, stops
    of set points, possible futures and what they cost, successors that make no step, and boxes
    around several hulls, 10.27 MB are left.
    """
    library = Path(vff._core.__file__).read_bytes()
    size = len(library)
    assert size < 10_300_000
    if library.startswith(b"\x7fELF\x02"):
        # The names of the sections: the text of the code may contain the same words.
        (table,) = struct.unpack_from("<Q", library, 0x28)
        entry, _, index = struct.unpack_from("<HHH", library, 0x3A)
        start, length = struct.unpack_from("<QQ", library, table + index * entry + 0x18)
        names = library[start : start + length].split(b"\0")
        assert b".text" in names
        assert not [name for name in names if name.startswith(b".debug") or name == b".symtab"]


def test_extras_contain_what_the_documentation_executes() -> None:
    """Tutorials and examples are executed when the documentation is built: their modules come with `docs`."""
    pyproject = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    listed = re.search(r"^docs = \[(.*?)^\]", pyproject, re.M | re.S)
    assert listed is not None
    extras = re.search(r"vffnull\[([\w,]+)\]", listed[1])
    assert extras is not None and {"evaluate", "gym", "io", "mujoco", "report", "tune"} <= set(
        extras[1].split(",")
    )


def test_the_published_readme_needs_no_repository() -> None:
    """Links and pictures become absolute, code stays, and the addresses are in the metadata."""
    publishable = script("publishable")
    at = "https://example.org/vffnull"
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    published = publishable.absolute(readme, at, "v1.0.0")
    prose = re.sub(r"^```.*?^```", "", published, flags=re.M | re.S)
    targets = re.findall(r"\]\(([^)\s]+)\)", prose)
    assert len(targets) > 10 and all(target.startswith("https://") for target in targets)
    assert f"({at}/raw/v1.0.0/docs/figures/sweep-through.png)" in published
    assert f"({at}/blob/v1.0.0/CHANGELOG.md)" in published
    fenced = re.compile(r"^```.*?^```", re.M | re.S)
    assert fenced.findall(published) == fenced.findall(readme)
    pyproject = publishable.addressed((ROOT / "pyproject.toml").read_text(encoding="utf-8"), at, "v1.0.0")
    assert f'[project.urls]\nSource = "{at}"\n' in pyproject


def test_licences_are_judged() -> None:
    """SPDX expressions, by hand; and every rule of deny.toml can be broken."""
    dependencies = script("dependencies")
    allowed = {"MIT", "Zlib", "Apache-2.0 WITH LLVM-exception"}
    for expression, fine in {
        "MIT": True,
        "GPL-3.0-only": False,
        "GPL-3.0-only OR MIT": True,
        "MIT AND GPL-3.0-only": False,
        "GPL-3.0-only/MIT": True,
        "(Zlib OR GPL-2.0) AND MIT": True,
        "Zlib OR GPL-2.0 AND GPL-3.0-only": True,
        "(Zlib OR MIT) AND GPL-3.0-only": False,
        "Apache-2.0 WITH LLVM-exception": True,
        "Apache-2.0": False,
    }.items():
        assert dependencies.permitted(expression, allowed) is fine, expression
    exceptions = [{"crate": name, "allow": ["MPL-2.0"]} for name in ("except", "a", "gone")]
    rules = {
        "licenses": {"allow": ["MIT"], "exceptions": exceptions},
        "bans": {"skip": [{"crate": "once"}]},
    }
    crate = {"name": "a", "version": "1.0.0", "license": "MIT", "source": dependencies.REGISTRY}
    found = dependencies.faults(
        [
            crate,
            crate | {"version": "2.0.0"},
            crate | {"name": "b", "license": "GPL-3.0-only"},
            crate | {"name": "c", "license": None},
            crate | {"name": "d", "source": "git+https://example.org/d"},
            crate | {"name": "once"},
            crate | {"name": "except", "license": "MPL-2.0"},
        ],
        rules,
    )
    assert found == [
        "deny.toml makes an exception for a, which needs none",
        "deny.toml makes an exception for a, which needs none",
        "b 1.0.0 is under GPL-3.0-only, which deny.toml does not allow",
        "c 1.0.0 names no licence",
        "d 1.0.0 comes from git+https://example.org/d",
        "deny.toml makes an exception for gone, which is not there",
        "a is there 2 times: 1.0.0, 2.0.0",
        "deny.toml skips once, which is there once at most",
    ]


def test_the_workflows_are_about_this_repository() -> None:
    """It parses, and the files and the extremes of Python that it names exist."""
    check, release = (
        (ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8")
        for name in ("check", "release")
    )
    assert list(yaml.safe_load(check)["jobs"]) == ["check", "frozen"]
    jobs = yaml.safe_load(release)["jobs"]
    named = re.findall(r"(?<![\w/.])((?:tests|\.ci)/[\w.]+)", check + release)
    assert named and [name for name in named if not (ROOT / name).exists()] == []
    wheels = {each["target"] for each in jobs["wheels"]["strategy"]["matrix"]["include"]}
    assert {target.split("-", 1)[0] for target in wheels} == {"x86_64", "aarch64", "universal2"}
    assert importlib.metadata.metadata("vffnull")["Requires-Python"] == ">=3.10"
    checked = jobs["wheels-checked"]["strategy"]["matrix"]
    assert checked["python"][0] == "3.10"
    assert {each["name"] for each in checked["include"]} == set(checked["name"])
    assert {
        need for job in jobs.values() for need in job.get("needs", ()) if isinstance(job["needs"], list)
    } <= set(jobs)


def test_every_public_name_is_in_the_api_index() -> None:
    """With a line on the index, and described on a page; constants are with the quantities."""
    elsewhere = {"ENERGIES", "OBJECTIVES", "PORTS", "__version__", "VffNullError"}  # the last in `errors`
    pages = {page.stem: page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.rst")}
    index = pages.pop("index").split()
    assert [name for name in vff.__all__ if name not in elsewhere and name not in index] == []
    modules = {"arms", "errors", "scenes"}  # documented whole
    described = set(re.findall(r"auto(?:class|function):: (\w+)", "\n".join(pages.values())))
    assert set(vff.__all__) - elsewhere - modules - described == set()
