"""Waiting for states: no test may depend on how busy the machine is, so `HANG` is the only deadline."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

HANG = 900.0  # s: what has not happened by then never will


def wait_for(condition: Callable[[], object], what: str = "it") -> None:
    """Wait until something has happened."""
    end = time.monotonic() + HANG
    while not condition():
        assert time.monotonic() < end, f"{what} did not happen"
        time.sleep(0.02)


def frames(page: Any, count: int = 3) -> None:
    """Wait until some more pictures of a live page have been drawn."""
    seen = page.drawn
    wait_for(lambda: page.drawn >= seen + count)


def obey(callback: Any) -> None:
    """Let a coroutine run that waits for nothing."""
    try:
        callback.send(None)
    except StopIteration:
        return
    raise AssertionError("it waits for something")


def processor_time(pid: int) -> float:
    """Seconds that a process has computed so far: a measure of its work, whatever else the machine does."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
