"""From the rows that the core keeps for a moment to a file."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import chain, count
from pathlib import Path
from types import SimpleNamespace

import vffnull._core as _core
from vffnull.live.files import file_name
from vffnull.logs.stream import StreamRecorder
from vffnull.model.scenario import Scenario


class Recording:
    """A recording under way: a row every hundredth of a second.

    Parameters
    ----------
    live : vffnull._core.Live
        What is recorded.
    scenario : Scenario
        Goes into the file.
    folder : Path
        Where the file goes, called after the scenario and the time.
    """

    def __init__(self, live: _core.Live, scenario: Scenario, folder: Path) -> None:
        self._live = live
        self.path = _unused(folder / file_name(scenario.name, f"-{time.strftime('%Y%m%d-%H%M%S')}.arrows"))
        self._recorder = StreamRecorder(self.path, scenario)
        self.rows = 0
        live.record(True)

    def drain(self) -> None:
        """Write the rows that have come together; the core has room for those of ten seconds."""
        record, _ = self._live.take()
        if record is None:
            return
        given = {name: values for name, values in record.items() if values is not None}
        for k in range(len(given["t"])):
            self._recorder.write(SimpleNamespace(**{name: values[k] for name, values in given.items()}))
        self.rows += len(given["t"])

    def drop(self) -> None:
        """End it where nothing can be written any longer."""
        self._live.record(False)

    def close(self) -> None:
        """Write what is left and end the file; it is recorded until that is there."""
        try:
            self.drain()
        finally:
            try:
                self._recorder.close()
            finally:
                self._live.record(False)


def _unused(path: Path) -> Path:
    """A path at which there is no file: that of one of the same second gets a number."""
    others = (path.with_stem(f"{path.stem}-{k}") for k in count(2))
    return next(each for each in chain([path], others) if not each.exists())


class Recorder:
    """Begins and ends the recordings of a page.

    Parameters
    ----------
    folder : Path
        Where the files go.
    show : callable
        Told whether something is recorded.
    tell : callable
        Told, with a title and a text, of what nobody has asked for.
    """

    def __init__(self, folder: Path, show: Callable[[bool], None], tell: Callable[[str, str], None]) -> None:
        self._folder, self._show, self._tell = folder, show, tell
        self._recording: Recording | None = None

    @property
    def is_on(self) -> bool:
        """Whether something is recorded."""
        return self._recording is not None

    def begin(self, live: _core.Live, scenario: Scenario) -> Path:
        """Begin to record, unless that is done already; the file."""
        if self._recording is None:
            self._recording = Recording(live, scenario, self._folder)
            self._show(True)
        return self._recording.path

    def end(self) -> tuple[Path, int] | None:
        """End a recording; its file and the number of its rows."""
        recording = self._recording
        if recording is None:
            return None
        try:
            recording.close()
        finally:
            self._recording = None
            self._show(False)
        return recording.path, recording.rows

    def drain(self) -> None:
        """Write what has been recorded; a disk that is full ends the recording, not the page."""
        if self._recording is None:
            return
        try:
            self._recording.drain()
        except OSError as fault:
            self._recording.drop()
            self._recording = None
            self._show(False)
            self._tell("The recording has ended", str(fault))
