"""The README's examples run, in order, in one namespace; and what CI runs of README and docs is right."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from vffnull import _core
from waiting import HANG

README = Path(__file__).parents[1] / "README.md"


def blocks(language: str) -> list[tuple[int, str]]:
    """(line number, code) of every fenced block of a language."""
    text = README.read_text(encoding="utf-8")
    found = re.finditer(
        rf"^(?P<fence>```+){language}\b[^\n]*\n(?P<code>.*?)^(?P=fence)\s*$", text, re.M | re.S
    )
    return [(text.count("\n", 0, match.start("code")) + 1, match["code"]) for match in found]


def test_every_python_block_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As one script, in a process of its own, warnings as errors; a traceback names the README's line."""
    python = blocks("python")
    assert python, "the README has no ```python block"
    script, line = "", 1
    for start, code in python:
        script += "\n" * (start - line) + code  # keep the README's line numbers
        line = start + code.count("\n")
    path = tmp_path / "README.py"
    path.write_text(script, encoding="utf-8")
    environment = os.environ | {"MPLBACKEND": "Agg"}
    command = [sys.executable, "-W", "error", str(path)]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=HANG
    )
    assert done.returncode == 0, done.stderr[-3000:]


def test_links_into_the_repository_exist() -> None:
    """Relative links and pictures point at files that are there."""
    text = re.sub(r"^```.*?^```", "", README.read_text(encoding="utf-8"), flags=re.M | re.S)
    targets = re.findall(r"\]\(([^)\s]+)\)", text) + re.findall(r'(?:src|href)="([^"]+)"', text)
    local = [
        target.split("#")[0]
        for target in targets
        if "://" not in target and not target.startswith(("#", "mailto:"))
    ]
    assert [target for target in local if not (README.parent / target).exists()] == []


@pytest.fixture(scope="module")
def documented() -> ModuleType:
    """The script that runs every command of README and docs."""
    spec = importlib.util.spec_from_file_location("documented", README.parent / ".ci" / "documented.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclass looks itself up
    spec.loader.exec_module(module)
    return module


def test_the_first_commands() -> None:
    """First a run in which avoidance decides, two in space, the paper's, then what to do with them."""
    shell = "".join(code for _, code in blocks("sh"))
    lines = [" ".join(line.split("#")[0].split()) for line in shell.splitlines()]
    assert lines[:7] == [
        "pip install . && vffnull run sweep-through --plot figures",
        "vffnull run panda-sweep --plot figures",
        "vffnull plan panda-shelf --horizon 0 --margin 0.03",
        "vffnull run panda-shelf --plot figures",
        "vffnull run paper-1 --plot figures",
        'pip install ".[viewer]" && vffnull live',
        'pip install ".[report]" && vffnull report sweep-through run.html',
    ]
    assert 'pip install ".[test]" && .ci/check' in shell.splitlines()


def test_everything_at_once_is_advised_with_its_cost() -> None:
    """Before the first further command: what it saves, how many packages and how much disk it takes."""
    start = README.read_text(encoding="utf-8").partition("## Set up")[2].partition("## Play with it")[0]
    advice = re.search(
        r"without compiling a second time, write `\"\.\[all\]\"`.*?about\s+(\d+) packages and (\d+) GB",
        start,
        re.S,
    )
    assert advice is not None and start.index(advice[0]) < start.index("What next?")
    metadata = _core.parse_toml((README.parent / "pyproject.toml").read_text(encoding="utf-8"), "it")[
        "project"
    ]
    extras = metadata["optional-dependencies"]
    named = set(re.findall(r"\w+", re.search(r"\[(.*)\]", " ".join(extras["all"]))[1]))  # type: ignore[index]
    assert {"io", "report", "viewer", "video", "study", "meshes"} <= named <= set(extras)


PAGE = """# Page

`vffnull list` needs nothing. With `pip install ".[gym]"`, `python benches/gym.py` runs.

```sh
pip install ".[io,report]" && vffnull report sweep-through run.html  # a page
vffnull run paper-1
```

```toml
key = 1
```

## Next

Install Pinocchio, `pip install pin`:

```python
import pinocchio
```
"""


def test_what_a_page_installs(
    documented: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every command with what the page says before it, and nothing else."""
    monkeypatch.setattr(documented, "ROOT", tmp_path)
    page = tmp_path / "README.md"
    page.write_text(PAGE, encoding="utf-8")
    found = [(task.place, task.code.strip(), set(task.needs)) for task in documented.tasks(page)]
    assert found == [
        ("README.md:6", "vffnull report sweep-through run.html", {".[io]", ".[report]"}),
        ("README.md:7", "vffnull run paper-1", {".[gym]", ".[io]", ".[report]"}),
        ("README.md:19", "import pinocchio", {"pin"}),
        ("README.md:3", "vffnull list", {".[gym]"}),
        ("README.md:3", "python benches/gym.py", {".[gym]"}),
    ]
    page.write_text("# Page\n\n```bash\nvffnull list\n```\n", encoding="utf-8")
    with pytest.raises(SystemExit, match=r"README\.md:4: what is a block of `bash`\?"):
        list(documented.tasks(page))


def test_what_runs_on_its_own_is_ended(documented: ModuleType, tmp_path: Path) -> None:
    """A failure is told with its output; a page that never answers is one, too."""
    variables = dict(os.environ)
    assert (
        documented.run(documented.Task("here", "echo fine", True, frozenset()), variables, tmp_path) is None
    )
    told = documented.run(documented.Task("here", "echo oh; exit 3", True, frozenset()), variables, tmp_path)
    assert "exit code 3" in told and "oh" in told
    told = documented.run(
        documented.Task("here", "raise SystemExit(4)", False, frozenset()), variables, tmp_path
    )
    assert "exit code 4" in told
    documented.UNTIL_STOPPED["echo gone"] = r"is running at (?P<url>http://\S+);"
    try:
        gone = documented.Task("here", "echo gone", True, frozenset())
        assert "ended before it was ready" in documented.run(gone, variables, tmp_path)
    finally:
        del documented.UNTIL_STOPPED["echo gone"]


def test_every_exception_of_the_script_is_on_a_page(documented: ModuleType) -> None:
    """Commands that are shortened or left out exist to the letter."""
    root = README.parent
    pages = [README, *(root / "docs").glob("*.md"), *(root / "docs").glob("tutorials/*.md")]
    said = {task.code for page in pages for task in documented.tasks(page)}
    assert {*documented.SHORTER, *documented.LEFT_OUT, *documented.UNTIL_STOPPED} - said == set()
