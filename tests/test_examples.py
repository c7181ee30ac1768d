"""The examples run from start to end and leave what they promise."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_robustness(tmp_path: Path) -> None:
    target = tmp_path / "robustness.png"
    subprocess.run([sys.executable, EXAMPLES / "robustness.py", target], check=True, cwd=tmp_path)
    assert target.read_bytes().startswith(b"\x89PNG")
