"""`.ci/check` without the tools that root installs: the rest is checked, and CI still fails."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[1] / ".ci"


@pytest.fixture
def run(tmp_path: Path):  # type: ignore[no-untyped-def]
    """Runs the script where every tool does nothing, and those that root installs are not there."""
    if not FOLDER.is_dir() or shutil.which("bash") is None:
        pytest.skip("no source tree, or no bash")
    (tmp_path / "bin").mkdir()
    (tmp_path / ".ci").mkdir()
    for script in ("check", "cargo-lints"):
        shutil.copy(FOLDER / script, tmp_path / ".ci" / script)
    for tool in ("ruff", "mypy", "cargo", "python", "pytest", "sphinx-build"):
        written = tmp_path / "bin" / tool
        written.write_text(f'#!/bin/sh\necho "{tool} $* [$VFFNULL_LEFT_OUT]" >> "{tmp_path}/did"\n')
        written.chmod(0o755)
    for tool in ("bash", "dirname", "env", "sleep", "cat", "mktemp", "rm"):
        (tmp_path / "bin" / tool).symlink_to(str(shutil.which(tool)))

    def go(ci: bool) -> tuple[int, str, str]:
        environment = {"PATH": str(tmp_path / "bin"), "HOME": str(tmp_path)} | ({"CI": "true"} if ci else {})
        done = subprocess.run(
            ["bash", str(tmp_path / ".ci" / "check")],
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        did = tmp_path / "did"
        return done.returncode, done.stdout + done.stderr, did.read_text() if did.exists() else ""

    return go


def test_without_tools_the_rest_is_checked_and_that_is_said(run) -> None:  # type: ignore[no-untyped-def]
    code, said, did = run(ci=False)
    assert code == 0, said
    assert "Left out without valgrind" in said and "Left out without chromium" in said
    assert said.rstrip().endswith("Everything else holds.")
    assert "benches/instructions.py" not in did
    of_cargo = [f"cargo {command}" for command in ("clippy", "doc", "test", "bench")]
    for command in (*of_cargo, "ruff check", "mypy", "pytest -n auto", "sphinx-build"):
        assert command in did, did
    assert "[valgrind chromium]" in did


def test_in_ci_they_have_to_be_there(run) -> None:  # type: ignore[no-untyped-def]
    code, said, did = run(ci=True)
    assert code == 1 and "FAILED: valgrind is missing" in said and did == ""


def test_with_all_tools_nothing_is_left_out(run, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    for tool in ("valgrind", "chromium"):
        (tmp_path / "bin" / tool).write_text("#!/bin/sh\n")
        (tmp_path / "bin" / tool).chmod(0o755)
    code, said, did = run(ci=True)
    assert code == 0 and said.rstrip().endswith("Everything holds."), said
    assert "Left out" not in said and "benches/instructions.py" in did and "[]" in did
