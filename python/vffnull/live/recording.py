"""From the rows that the core keeps for a moment to a file."""

from __future__ import annotations

import time
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
        self.path = folder / file_name(scenario.name, f"-{time.strftime('%Y%m%d-%H%M%S')}.arrows")
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

    def close(self) -> None:
        """Write what is left and end the file."""
        try:
            self.drain()
        finally:
            self._live.record(False)
            self._recorder.close()
