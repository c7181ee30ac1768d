"""What a drive records while it goes on."""

from __future__ import annotations

import threading
import warnings
from types import SimpleNamespace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import vffnull._core as _core
    from vffnull.logs.stream import StreamRecorder

__all__ = ["DriveLog"]

_DRAIN = 0.1  # s between two looks for rows


class DriveLog(threading.Thread):
    """From the rows that the loop of a drive keeps to a file, in a thread of its own.

    Parameters
    ----------
    loop : DriveLoop
        The loop.
    recorder : StreamRecorder
        What writes the file.
    """

    def __init__(self, loop: _core.DriveLoop, recorder: StreamRecorder) -> None:
        super().__init__(name="vffnull-drive-log", daemon=True)
        self._loop, self._recorder = loop, recorder
        self._over = threading.Event()
        self._failure: Exception | None = None
        self.lost = 0
        self.start()

    def run(self) -> None:
        """Write what has come together, again and again."""
        while not self._over.wait(_DRAIN):
            self._drain()

    def _drain(self) -> None:
        rows, lost = self._loop.rows()
        self.lost += lost
        if self._failure is not None:
            return
        columns = {"tau_applied" if name == "command" else name: rows[name] for name in rows}
        try:
            for k in range(len(columns["t"])):
                self._recorder.write(SimpleNamespace(**{name: rows[k] for name, rows in columns.items()}))
        except Exception as error:  # a full disk does not end a drive
            self._failure = error

    def close(self) -> None:
        """Write what is left."""
        if self._over.is_set():
            return
        self._over.set()
        self.join()
        self._drain()
        try:
            self._recorder.close()
        except Exception as error:
            self._failure = self._failure or error
        if self._failure is not None:
            warnings.warn(f"drive: the recording has ended: {self._failure}", RuntimeWarning, stacklevel=4)
