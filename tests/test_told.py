"""Every example that help texts, comments of scenarios and messages tell is a command that works."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import vffnull as vff
from vffnull.cli import _commands, common
from vffnull.model.scenario import ScenarioLike, prepare
from vffnull.studies import studies

PACKAGE = Path(vff.__file__).parent
CRATES = Path(__file__).parents[1] / "crates"
MENTION = re.compile(r"`(vffnull [^`]+)`")
COMMENT = re.compile(r"#.*?(vffnull (?:arms|live|plan|run|report|study) [^`;]+)")
CONTINUED = re.compile(r"\\\n\s*|^\s*//.*$", re.M)
"""Of Rust: where a string goes on in the next line, and comments."""

ROBOT = """<robot name="lever"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
<inertia ixx="0.03" iyy="0.03" izz="0.004"/></inertial>
<collision><origin xyz="0 0 0.2"/>
<geometry><cylinder radius="0.05" length="0.4"/></geometry></collision></link>
<link name="tool0"/><link name="tip"><inertial><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
<joint name="flange" type="fixed"><parent link="arm"/><child link="tool0"/><origin xyz="0 0 0.4"/></joint>
<joint name="finger" type="prismatic"><parent link="tool0"/><child link="tip"/><axis xyz="0 1 0"/>
<limit lower="0" upper="0.04" effort="5" velocity="1"/></joint></robot>"""

# What runs until somebody ends it, takes a cluster, or takes long: read, and not carried out.
READ_ONLY = {"live", "realtime", "evaluate", "perceive", "study run", "study tune", "study show"}
# What runs is cut short by these.
SHORT = {"duration": 0.02}


def _helped(command: click.Command, name: str) -> Iterator[tuple[str, str]]:
    """The examples of a command and of those inside it, each by itself."""
    for line in (command.help or "").splitlines():
        if line.strip().startswith("vffnull "):
            example = re.split(r"\s{2,}|(?<=npz) (?=plan )|(?<=gif) (?=film)", line.strip())[0]
            yield name, example
    for inner in getattr(command, "commands", {}).values():
        yield from _helped(inner, f"{name} {inner.name}")


def _told() -> list[tuple[str, bool]]:
    """Each with whether it is whole, and not the mention of a command in a sentence."""
    found = [(example, True) for _, example in _helped(_commands, "vffnull")]
    for path in sorted(PACKAGE.rglob("*.toml")):
        for line in path.read_text(encoding="utf-8").splitlines():
            found += [(each.strip(), True) for each in COMMENT.findall(line)]
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found += [(each, False) for each in MENTION.findall(node.value)]
    for path in sorted(CRATES.glob("*/src/**/*.rs")):
        text = CONTINUED.sub("", path.read_text(encoding="utf-8"))
        found += [(each, False) for each in MENTION.findall(text)]
    return list(dict.fromkeys(found))


def _resolved(words: list[str]) -> tuple[click.Command, list[str], list[str]]:
    """The command that is meant, its name, and its arguments."""
    command: click.Command = _commands
    name: list[str] = []
    while words and isinstance(command, click.Group) and words[0] in command.commands:
        command = command.commands[words[0]]
        name.append(words.pop(0))
    return command, name, words


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the examples take for granted: somebody's files."""
    here = tmp_path_factory.mktemp("told")
    text = (PACKAGE / "scenarios" / "paper-1.toml").read_text(encoding="utf-8")
    (here / "scenes").mkdir()
    for name in ("mine.toml", "scenes/a.toml"):
        (here / name).write_text(text, encoding="utf-8")
    result = vff.simulate("paper-1", {"duration": 0.02})
    for name in ("run", "weak", "strong"):
        result.save(here / f"{name}.npz")
    (here / "cell.mcap").touch()  # tests/test_recordings.py reads real ones
    (here / "robot.urdf").write_text(ROBOT, encoding="utf-8")
    (here / "robot.xml").write_text(vff.Arm.named("panda").to_mjcf(), encoding="utf-8")
    return here


@pytest.mark.parametrize(("example", "whole"), _told())
def test_what_is_told_works(example: str, whole: bool, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    command = example.split(" > ")[0]
    words = [
        name
        for word in shlex.split(command)[1:]
        for name in (sorted(str(each) for each in Path().glob(word)) if "*" in word else [word])
    ]
    found, name, arguments = _resolved(list(words))
    assert name, f"there is no command {example!r}"
    if not whole:  # in a sentence: its options and the number of its arguments are right, or it has none
        if arguments and not all(word.startswith("-") for word in arguments):
            found.make_context(" ".join(name), [*arguments], resilient_parsing=False).close()
        elif arguments:
            known = {option for each in found.params for option in each.opts}
            assert set(arguments) <= known
        return
    if any(word.isupper() for word in arguments):  # a form, not an example
        return
    if " ".join(name) in READ_ONLY:
        found.make_context(" ".join(name), list(arguments)).close()
        named = [*vff.scenarios(), *studies(), "results"]
        assert (
            not arguments
            or arguments[0].startswith("-")
            or arguments[0] in named
            or Path(arguments[0]).exists()
        )
        return
    if name != ["plan"]:
        monkeypatch.setattr(common, "prepare", _shortened)
    done = CliRunner().invoke(_commands, words, standalone_mode=False)
    assert done.exception is None and done.return_value in (None, 0), (example, done.output, done.exception)


def _shortened(source: ScenarioLike, overrides: dict[str, object] | None = None) -> vff.Scenario:
    return prepare(source, {**(overrides or {}), **SHORT})


def test_messages_of_the_crates_are_among_them() -> None:
    if not CRATES.is_dir():
        pytest.skip("no source tree")
    told = {example for example, _ in _told()}
    assert "vffnull arms check robot.xml --toml" in told
    assert "vffnull arms check ROBOT.urdf --toml > robot.toml" in told


def test_an_option_that_does_not_exist_is_noticed(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for wrong in ("vffnull arms check robot.urdf --tmol", "vffnull evaluate --jsn"):
        with pytest.raises((click.UsageError, AssertionError)):
            test_what_is_told_works(wrong, False, folder, monkeypatch)


def test_every_status_of_a_plan_is_documented() -> None:
    """docs/plans.md has a row for each."""
    page = Path(__file__).parents[1] / "docs" / "plans.md"
    if not page.is_file():
        pytest.skip("no source tree")
    rows = re.findall(r"^\| `([^`]+)` \|", page.read_text(encoding="utf-8"), re.M)
    assert {str(status) for status in vff.PlanStatus} <= set(rows)
