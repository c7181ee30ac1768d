"""The examples run from start to end and leave what they promise."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_robustness(tmp_path: Path) -> None:
    target = tmp_path / "robustness.png"
    subprocess.run([sys.executable, EXAMPLES / "robustness.py", target], check=True, cwd=tmp_path)
    assert target.read_bytes().startswith(b"\x89PNG")


def printed(name: str, *arguments: str) -> str:
    command = [sys.executable, EXAMPLES / name, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def test_gym_random_policy() -> None:
    """With and without a random null-space torque: a line each, and the tip within a millimetre."""
    lines = printed("gym_random_policy.py", "8").splitlines()
    found = [
        re.fullmatch(r".*: return .*%, tracking error up to ([\d.]+) mm, .* steps/s", line) for line in lines
    ]
    assert [float(match[1]) < 1.0 for match in found if match] == [True, True]


def test_gym_our_controller() -> None:
    """The law makes every episode that the arm without its field does not."""
    found = re.findall(r"field +(on|off): hit +(\d+)%", printed("gym_our_controller.py", "2"))
    assert found == [("on", "0"), ("off", "100")]
