"""The commands and programs of two tutorials, as a reader types them; the live page is tested elsewhere."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from waiting import HANG

TUTORIALS = Path(__file__).resolve().parents[1] / "docs" / "tutorials"


def blocks(page: str, language: str) -> list[str]:
    """The fenced blocks of a page in a language."""
    text = (TUTORIALS / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{re.escape(language)}\n(.*?)^```$", text, re.M | re.S)


def run(command: list[str] | str, folder: Path, path: str) -> str:
    """What a command prints; it has to end well."""
    variables = os.environ | {"MPLBACKEND": "Agg", "PATH": f"{path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(
        command,
        shell=isinstance(command, str),
        cwd=folder,
        env=variables,
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
    return done.stdout


@pytest.fixture
def path(tmp_path: Path) -> str:
    """A folder with the command, wherever the package comes from."""
    found = tmp_path / "bin"
    found.mkdir()
    for name, what in (("vffnull", "-m vffnull"), ("python", "")):
        script = found / name
        script.write_text(f'#!/bin/sh\nexec "{sys.executable}" {what} "$@"\n', encoding="utf-8")
        script.chmod(0o755)
    return str(found)


@pytest.fixture
def clone(tmp_path: Path) -> Path:
    """A folder like a clone, as far as the tutorials name its files."""
    folder = tmp_path / "clone"
    (folder / "docs" / "tutorials").mkdir(parents=True)
    shutil.copy(TUTORIALS / "robot.toml", folder / "docs" / "tutorials")
    return folder


def test_ten_minutes(clone: Path, path: str) -> None:
    """From the URDF to figures; the run is the one of which the page tells."""
    lines = [line for block in blocks("ten-minutes.md", "sh") for line in block.splitlines()]
    said = {line: run(line, clone, path) for line in lines if not line.startswith(("pip ", "vffnull live"))}
    assert len(said) == 5 and "vffnull live mine.toml" in lines
    assert "7 joints from base_link" in said["vffnull arms check robot.urdf"]
    assert "without contact" in said["vffnull run mine.toml --plot figures"]
    assert {"strobe.png", "limits.png", "null_space.png"} <= {
        each.name for each in (clone / "figures").iterdir()
    }


@pytest.mark.parametrize("page", ["ten-minutes.md", "from-osc.md", "studies.md"])
def test_cells(page: str, tmp_path: Path, path: str) -> None:
    """All cells as one program, in a folder that has what is beside the page, warnings as errors."""
    shutil.copy(TUTORIALS / "robot.toml", tmp_path)
    cells = blocks(page, "{code-cell} ipython3")
    program = tmp_path / "program.py"
    program.write_text(re.sub(r"^:tags:.*$", "", "\n".join(cells), flags=re.M), encoding="utf-8")
    said = run([sys.executable, "-W", "error", str(program)], tmp_path, path)
    if page == "from-osc.md":
        numbers = [float(each) for each in re.findall(r"(\d[\d.e+-]*) (?:N·m|m/s²|rad/s²)", said)]
        standing, moving, hand, joints, still = numbers
        assert max(standing, hand, still) < 1e-9 < 0.1 < min(moving, joints)
    elif page == "studies.md":
        assert "160 runs" in said and "\nTrue\n" in said
        assert "Sobol indices" in said and "N·m: {'gain'" in said
    else:
        assert "without contact" in said and "completed" in said


def test_beside_mink(tmp_path: Path, path: str) -> None:
    """Where mink is installed: what the page says that the program prints."""
    pytest.importorskip("mink")
    (program,) = blocks("from-osc.md", "python")
    (printed,) = blocks("from-osc.md", "text")
    (tmp_path / "program.py").write_text(program, encoding="utf-8")
    assert run([sys.executable, str(tmp_path / "program.py")], tmp_path, path) == printed
