"""Where the page can be."""

from __future__ import annotations

import os
import socket

from vffnull._support.errors import InputError

USUAL = 8080
FIRST, LAST = 1024, 65_535
_TRIES = 100


def free(port: int | None, name: str = "port") -> int:
    """The port that is asked for, or the first free one from 8080 on; `name` is what messages call it.

    viser would look on by itself, so that a page is not where its maker has put it; and past the last port it
    waits for ever.

    Raises
    ------
    vffnull.errors.InputError
        If the port is out of range or taken, or if none is free.
    """
    if port is not None and not FIRST <= port <= LAST:
        raise InputError(f"{name}: must be from {FIRST} to {LAST}, got {port}")
    candidates = range(USUAL, USUAL + _TRIES) if port is None else (port,)
    found = next((each for each in candidates if is_free(each)), None)
    if found is not None:
        return found
    if port is None:
        raise InputError(f"{name}: {USUAL} to {candidates[-1]} are taken; choose another")
    other = next((each for each in range(port + 1, min(port + _TRIES, LAST + 1)) if is_free(each)), None)
    hint = "choose another" if other is None else f"{other} is free"
    raise InputError(f"{name}: {port} is taken, maybe by a page that still runs; {hint}")


def is_free(port: int) -> bool:
    """Whether nobody listens there on this machine."""
    with socket.socket() as probe:
        if os.name == "posix":  # as the server does: a port that was left a moment ago is free
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
        return True
