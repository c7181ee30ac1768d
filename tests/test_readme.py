"""The README's examples run, in order, in one namespace and an empty directory."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

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
    done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
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
