"""Recording while it happens: a file that is worth something at every moment, whatever ends the process."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull import _core, _record
from vffnull._extras import extra
from vffnull.errors import InputError
from vffnull.logs import arrow

if TYPE_CHECKING:
    import pyarrow

    from vffnull.scenario import Scenario

__all__ = ["StreamRecorder"]


class StreamRecorder:
    """Record a long or a live run into an Arrow IPC stream.

    What was written half a second ago is with the operating system: a process that is killed loses no more
    than that, and the file can be read while it grows. (A power failure may take what the system has not yet
    put on the disk.)

    Parameters
    ----------
    path : str or path
        A path that ends in ``.arrows``; a file that is there is replaced.
    scenario : Scenario, optional
        Goes into the file, if given.
    interval : float, optional
        Longest time [s] that a row waits in memory.

    Raises
    ------
    vffnull.errors.InputError
        If the path ends otherwise, or if the interval is not positive.
    ImportError
        Without the extra ``vffnull[io]``.

    See Also
    --------
    vffnull.Result.save : for a run that is over.

    Examples
    --------
    >>> simulation = Simulation(scenario)  # doctest: +SKIP
    >>> with StreamRecorder("run.arrows", scenario) as recorder:  # doctest: +SKIP
    ...     while not simulation.done:
    ...         recorder.write(simulation.step(my_controller(simulation.state)))
    >>> table = StreamRecorder.read("run.arrows")  # doctest: +SKIP
    """

    def __init__(
        self, path: str | os.PathLike[str], scenario: Scenario | None = None, interval: float = 0.5
    ) -> None:
        self.path = Path(path)
        if self.path.suffix != ".arrows":
            given = self.path.suffix or "without an ending"
            raise InputError(f"{self.path}: a stream is recorded as .arrows, not {given}")
        if not interval > 0.0:
            raise InputError(f"interval: must be positive, got {interval}")
        self._arrow, self._ipc = extra("pyarrow", "io"), extra("pyarrow.ipc", "io")
        about = {
            "version": _core.__version__,
            "scenario": scenario.to_dict() if scenario is not None else None,
        }
        self._arrow.array(
            np.zeros(1)
        )  # the first one makes Arrow import more, for half a second: now, not later
        self._metadata = {"vffnull": json.dumps(about)}
        self._file = self.path.open("wb", buffering=0)
        self._stream: Any = None
        self._names: list[str] = []
        self._rows: list[list[Any]] = []
        self._failure: BaseException | None = None
        self._lock = threading.Lock()  # around the rows
        self._over = threading.Event()
        self._clerk = threading.Thread(target=self._keep_flushing, args=(interval,), daemon=True)
        self._clerk.start()

    def write(self, state: object) -> None:
        """Record an instant.

        Parameters
        ----------
        state : State or any object
            Has the time as attribute ``t`` [s], and quantities under the names and with the units that
            `vffnull.Result` uses; the same ones at every instant. Other attributes are ignored.

        Raises
        ------
        OSError
            If the file could not be written since the last call: a full disk, for instance.
        vffnull.errors.InputError
            If the recorder has been closed.
        """
        if self._failure is not None:
            raise self._failure
        if self._over.is_set():
            raise InputError(f"{self.path}: the recorder has been closed")
        if not self._names:
            self._names = list(_record.recorded(state))
            self._row(state)
            self._flush()  # the file is readable from the first instant on
            return
        self._row(state)

    def _row(self, state: Any) -> None:
        row = [state.t, *(getattr(state, name) for name in self._names)]
        with self._lock:
            self._rows.append(row)

    def close(self) -> None:
        """Write what is left and end the stream."""
        if self._over.is_set():
            return
        self._over.set()
        self._clerk.join()
        try:
            self._flush()
            if self._stream is not None:
                self._stream.close()
        finally:
            self._file.close()
        if self._failure is not None:
            raise self._failure

    def __enter__(self) -> StreamRecorder:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @staticmethod
    def read(path: str | os.PathLike[str]) -> pyarrow.Table:
        """Everything that a stream holds, also of one that was cut off or that is still being written.

        Parameters
        ----------
        path : str or path
            What a recorder has written.

        Returns
        -------
        pyarrow.Table
            Columns as in `vffnull.Result.to_arrow`; the version and the scenario stand in the schema's
            metadata under ``vffnull``, as JSON.

        Raises
        ------
        vffnull.errors.InputError
            If the file is something else, or was cut off before its first row.
        FileNotFoundError
            If there is no such file.
        """
        library, ipc = extra("pyarrow", "io"), extra("pyarrow.ipc", "io")
        with Path(path).open("rb") as file:
            try:
                stream = ipc.open_stream(file)
            except (library.ArrowInvalid, OSError):
                raise InputError(
                    f"{path}: not a stream that vffnull has recorded, or one without a row"
                ) from None
            batches = []
            try:
                for batch in stream:
                    batches.append(batch)
            except (library.ArrowInvalid, OSError):
                pass  # the last batch was being written when the process ended
        return library.Table.from_batches(batches, schema=stream.schema)

    def _keep_flushing(self, interval: float) -> None:
        while not self._over.wait(interval):
            try:
                self._flush()
            except BaseException as error:
                self._failure = error
                return

    def _flush(self) -> None:
        with self._lock:
            rows, self._rows = self._rows, []
        if not rows:
            return
        names = ["t", *self._names]
        arrays = {
            name: np.asarray(values) for name, values in zip(names, zip(*rows, strict=True), strict=True)
        }
        if self._stream is None:
            self._stream = self._ipc.new_stream(self._file, self._schema(arrays))
        lines = [line for values in arrays.values() for line in _record.flat(values).T]
        columns = [self._arrow.array(np.ascontiguousarray(line)) for line in lines]
        self._stream.write_batch(self._arrow.record_batch(columns, schema=self._stream_schema))

    def _schema(self, arrays: dict[str, Any]) -> Any:
        kind = self._arrow.from_numpy_dtype
        fields = [self._arrow.field("t", kind(arrays["t"].dtype), metadata=arrow.TIME)]
        for name in self._names:
            values = arrays[name]
            fields.extend(
                self._arrow.field(column.name, kind(values.dtype), metadata=arrow.about(column))
                for column in _record.columns(name, values.shape[1:])
            )
        self._stream_schema = self._arrow.schema(fields, metadata=self._metadata)
        return self._stream_schema
