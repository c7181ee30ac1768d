"""Where the page can be."""

from __future__ import annotations

import os
import socket

from vffnull.errors import InputError

FIRST, LAST = 1024, 65_535
_TRIES = 100


def free(port: int, name: str = "port") -> int:
    """The first port from this one on that nobody has; `name` is what messages call it.

    viser would look on by itself, but past the last port it waits for ever.

    Raises
    ------
    vffnull.errors.InputError
        If the port is out of range, or if it and all that follow are taken.
    """
    if not FIRST <= port <= LAST:
        raise InputError(f"{name}: must be from {FIRST} to {LAST}, got {port}")
    last = min(port + _TRIES, LAST)
    for candidate in range(port, last + 1):
        with socket.socket() as probe:
            if os.name == "posix":  # as the server does: a port that was left a moment ago is free
                probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind(("127.0.0.1", candidate))
            except OSError:
                continue
            return candidate
    taken = f"{port} is taken" if port == last else f"{port} to {last} are taken"
    raise InputError(f"{name}: {taken}; choose another")
