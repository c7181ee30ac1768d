"""A run that may be broken off: what it costs, or what its columns are, without waiting for its end."""

from __future__ import annotations

import time
from typing import Any

import vffnull._core as _core
from vffnull.model.document import Document

__all__ = ["probe"]


class _Enough(KeyboardInterrupt):
    """What the core takes for Ctrl-C: it hands back what there is."""


def probe(document: Document, seconds: float, record: bool) -> dict[str, Any]:
    """A run until so much time has passed, at the latest: its outcome, perhaps ``"interrupted"``."""
    end = time.monotonic() + seconds

    def look(done: int, total: int) -> None:
        if done < total and time.monotonic() >= end:
            raise _Enough

    try:
        return _core.run_many([document], "scenario", 1, record, look)[0]
    except _Enough:  # it was over at that very moment
        return _core.run_many([document], "scenario", 1, record, None)[0]
