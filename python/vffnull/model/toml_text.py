"""TOML from people: what is wrong with it is said briefly, and with the name of the file."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import vffnull._core as _core
from vffnull._support.errors import ScenarioError

__all__ = ["naming", "parsed"]

_SHOWN = 80
"""How many characters of a line that cannot be read are shown."""
_LONGEST = 1000
"""The same of any other line of a message."""


def parsed(text: str, name: str) -> dict[str, Any]:
    """The document of a text.

    Parameters
    ----------
    text : str
        TOML.
    name : str
        What it is called in messages.

    Raises
    ------
    vffnull.errors.ScenarioError
        If it is no TOML, with what stands around the fault.
    """
    try:
        return _core.parse_toml(text, name)
    except ScenarioError as fault:
        raise ScenarioError(_brief(str(fault)), fault.path) from None


@contextmanager
def naming(file: str) -> Iterator[None]:
    """Let what is wrong with the scenario in a file begin with the name of the file."""
    try:
        yield
    except ScenarioError as fault:
        if file in str(fault):
            raise
        raise ScenarioError(f"{file}: {fault}", fault.path) from None


def _brief(message: str) -> str:
    """The message, with no more of a long line than what is marked below it by ``^``."""
    lines = message.split("\n")
    for k, (line, below) in enumerate(zip(lines, [*lines[1:], ""], strict=True)):
        head = re.match(r"\d+ \| ", line)
        if head is None or "^" not in below or len(line) <= head.end() + _SHOWN:
            continue
        start = head.end()
        begin = max(start, below.index("^") - _SHOWN // 2)
        end = min(begin + _SHOWN, len(line))
        left, right = "…" if begin > start else "", "…" if end < len(line) else ""
        lines[k] = line[:start] + left + line[begin:end] + right
        lines[k + 1] = below[:start] + " " * len(left) + below[begin : end + 1].rstrip()
    return "\n".join(each if len(each) <= _LONGEST else f"{each[:_LONGEST]}…" for each in lines)
