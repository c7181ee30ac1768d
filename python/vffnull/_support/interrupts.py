"""Ctrl-C while other libraries work for us: not lost, and nothing half imported left behind."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType

__all__ = ["heard"]


AGAIN = 0.1
"""After so long [s] an interrupt that has not ended the work is raised again."""


@contextmanager
def heard() -> Iterator[None]:
    """Raise KeyboardInterrupt again, and at the end at the latest, if Python has dropped one on the way.

    Python drops what is raised in finalisers and in callbacks of weak references, of which libraries that
    draw have many. And an import that is interrupted leaves modules behind with which the next one fails:
    they are forgotten, so that it begins anew. As a decorator it is one for every call.
    """
    previous = signal.getsignal(signal.SIGINT)
    if not callable(previous) or threading.current_thread() is not threading.main_thread():
        yield
        return
    reminder: threading.Thread | None = None
    ended, reminded = threading.Event(), False

    def remind() -> None:
        nonlocal reminded
        while not ended.wait(AGAIN):
            if not reminded:  # or the last one is on its way still, and two would come as one
                reminded = True
                _thread.interrupt_main()

    def handler(number: int, frame: object) -> None:
        nonlocal reminder, reminded
        if reminded:
            reminded = False
            if ended.is_set() or _in_flight():
                return
            raise KeyboardInterrupt
        try:
            previous(number, frame)  # type: ignore[arg-type]
        except KeyboardInterrupt:
            if reminder is None:
                reminder = threading.Thread(target=remind, daemon=True)
                reminder.start()
            raise

    before = set(sys.modules)
    signal.signal(signal.SIGINT, handler)
    try:
        yield
        if reminder:
            raise KeyboardInterrupt
    except BaseException as error:
        if not reminder:
            raise
        _forget(_importing(error.__traceback__), before)
        if isinstance(error, KeyboardInterrupt):
            raise
        raise KeyboardInterrupt from error  # what an interrupt that was dropped has left undone
    finally:
        ended.set()
        try:
            if reminder:
                reminder.join()  # it may be just about to interrupt
        finally:
            signal.signal(signal.SIGINT, previous)  # what waits to be handled goes to our handler first


def _in_flight() -> bool:
    """Whether an interrupt is on its way out already: what is tidied up meanwhile must not be disturbed."""
    error = sys.exc_info()[1]
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False


def _importing(traceback: TracebackType | None) -> set[str]:
    """The packages of the modules that were being imported where an error came from."""
    found = set()
    while traceback is not None:
        frame = traceback.tb_frame
        if frame.f_code.co_name == "<module>":
            found.add(str(frame.f_globals.get("__name__")).partition(".")[0])
        traceback = traceback.tb_next
    return found


def _forget(packages: set[str], before: set[str]) -> None:
    """Forget the modules of packages that are new since then; compiled ones can be loaded only once."""
    for name in set(sys.modules) - before:
        file = getattr(sys.modules[name], "__file__", None) or ""
        if name.partition(".")[0] in packages and file.endswith(".py"):
            del sys.modules[name]
