"""Recording while it happens: a file that is worth something at every moment, whatever ends the process."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

import vffnull._core as _core
from vffnull._support.arguments import number, whole
from vffnull._support.errors import InputError, InputTypeError
from vffnull._support.extras import extra
from vffnull.logs import arrow
from vffnull.model import record as _record
from vffnull.model.record import Layout
from vffnull.model.scenario import ScenarioLike, prepare

if TYPE_CHECKING:
    import pyarrow
    from numpy.typing import NDArray

__all__ = ["StreamRecorder"]

_DAY = 86_400.0  # s


class StreamRecorder:
    """Record a long or a live run into an Arrow IPC stream.

    What was written half a second ago is with the operating system: a process that is killed loses no more
    than that, and the file can be read while it grows. (A power failure may take what the system has not yet
    put on the disk.) Several threads may write to one recorder; its rows are in the order of their calls.

    Parameters
    ----------
    path : str or path
        A path that ends in ``.arrows``; a file that is there is replaced.
    scenario : str, path, Mapping or Scenario, optional
        Goes into the file, if given; what `vffnull.simulate` accepts.
    interval : float, optional
        Longest time [s] that a row waits in memory, up to a day.
    dimension : {2, 3}, optional
        Of the space that the arm moves in, where no scenario says so; else the first row tells.

    Raises
    ------
    vffnull.errors.InputError
        If the path ends otherwise, or if the interval is not positive or too long.
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
        self,
        path: str | os.PathLike[str],
        scenario: ScenarioLike | None = None,
        interval: float = 0.5,
        dimension: Literal[2, 3] | None = None,
    ) -> None:
        self.path = Path(path)
        if self.path.suffix != ".arrows":
            given = self.path.suffix or "without an ending"
            raise InputError(f"{self.path}: a stream is recorded as .arrows, not {given}")
        interval = number("interval", interval)
        if not 0.0 < interval <= _DAY:
            raise InputError(f"interval: must be positive and at most {_DAY:g} s, got {interval}")
        self._arrow, self._ipc = extra("pyarrow", "io"), extra("pyarrow.ipc", "io")
        document = prepare(scenario).to_dict() if scenario is not None else None
        about = {"version": _core.__version__, "scenario": document}
        self._layout = None if document is None else Layout.of(document)
        if document is None and dimension is not None:
            self._layout = Layout(3 if whole("dimension", dimension, 2, 3) == 3 else 2)
        # The first array makes Arrow import more, for half a second: now, not later.
        self._arrow.array(np.zeros(1))
        self._metadata = {"vffnull": json.dumps(about)}
        self._file = self.path.open("wb", buffering=0)
        self._stream: Any = None
        self._shapes: dict[str, tuple[int, ...]] = {}
        self._rows: list[list[NDArray[np.float64]]] = []
        self._failure: BaseException | None = None
        self._lock = threading.RLock()  # around the rows
        self._stream_lock = threading.Lock()  # around the file; taken before the other
        self._over = threading.Event()
        self._flusher = threading.Thread(target=self._keep_flushing, args=(interval,), daemon=True)
        self._flusher.start()

    def write(self, state: object) -> None:
        """Record an instant; the values are copied.

        Parameters
        ----------
        state : State or any object
            Has the time as attribute ``t`` [s], and quantities under the names and with the units that
            `vffnull.Result` uses; the same ones, of the same shapes, at every instant. Other attributes are
            ignored.

        Raises
        ------
        OSError
            If the file could not be written since the last call: a full disk, for instance.
        vffnull.errors.InputError
            If the recorder has been closed, or if the row is not of the first one's kind; such a row is left
            out, and recording can go on.
        vffnull.errors.InputTypeError
            If a quantity is not made of numbers.
        """
        if self._failure is not None:
            raise self._failure
        with self._lock:
            if self._over.is_set():
                raise InputError(f"{self.path}: the recorder has been closed")
            first = not self._shapes
            if self._layout is None:
                self._layout = _layout(state)
            if self._layout.dimension == 3:
                state = _Parted(state)
            shapes = self._shapes or _shapes(state, self._layout)
            self._rows.append([_values(state, name, shape) for name, shape in shapes.items()])
            self._shapes = shapes
        if first:
            self._flush()  # the file is readable from the first instant on

    def close(self) -> None:
        """Write what is left and end the stream."""
        with self._lock:
            if self._over.is_set():
                return
            self._over.set()
        self._flusher.join()
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
            try:  # Arrow has errors of every kind for bytes that are no stream
                stream = ipc.open_stream(file)
            except Exception:
                raise InputError(
                    f"{path}: not a stream that vffnull has recorded, or one without a row"
                ) from None
            batches = []
            try:
                for batch in stream:
                    batch.validate(full=True)
                    batches.append(batch)
            except Exception:
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
        with self._stream_lock:
            with self._lock:
                rows, self._rows = self._rows, []
            if not rows:
                return
            columns = zip(*rows, strict=True)
            arrays = {name: np.stack(values) for name, values in zip(self._shapes, columns, strict=True)}
            if self._stream is None:
                self._stream = self._ipc.new_stream(self._file, self._schema())
            lines = [line for values in arrays.values() for line in _record.flat(values).T]
            batch = [self._arrow.array(np.ascontiguousarray(line)) for line in lines]
            self._stream.write_batch(self._arrow.record_batch(batch, schema=self._stream_schema))

    def _schema(self) -> Any:
        number, layout = self._arrow.float64(), self._layout or Layout()
        fields = [self._arrow.field("t", number, metadata=arrow.TIME)]
        for name, shape in self._shapes.items():
            if name != "t":
                fields.extend(
                    self._arrow.field(column.name, number, metadata=arrow.about(column))
                    for column in layout.columns(name, shape)
                )
        self._stream_schema = self._arrow.schema(fields, metadata=self._metadata)
        return self._stream_schema


def _layout(state: object) -> Layout:
    """Where a row without a scenario is from: only in space there are orientations, or places with a z."""
    obstacles = getattr(state, "obstacles", None)
    deep = obstacles is not None and np.ndim(obstacles) == 2 and np.shape(obstacles)[1] == 3
    return Layout(3 if deep or getattr(state, "orientation", None) is not None else 2)


class _Parted:
    """A row from space; poses of 7 numbers, as a `State` has them, become positions and orientations."""

    _WHOLE: ClassVar = {"x": "x", "orientation": "x", "x_ref": "x_ref", "orientation_ref": "x_ref"}

    def __init__(self, row: object) -> None:
        self._row = row

    def __getattr__(self, name: str) -> Any:
        whole = self._WHOLE.get(name)
        pose = None if whole is None else getattr(self._row, whole, None)
        if pose is None or np.shape(pose) != (7,):
            return getattr(self._row, name)
        return pose[:3] if name == whole else pose[3:]


def _shapes(state: object, layout: Layout) -> dict[str, tuple[int, ...]]:
    """The shape of time and of every quantity in a first row."""
    try:
        found = _record.recorded(state)
    except ValueError:  # lists of different lengths
        raise InputTypeError("the row has a quantity that is no array of numbers") from None
    for name, values in found.items():
        over = layout.quantities[name].over
        names = [layout.names(each) for each in over]
        named = [None if each is None else len(each) for each in names]
        fits = values.ndim == len(over) and all(
            most is None or size <= most for size, most in zip(values.shape, named, strict=True)
        )
        if not fits:
            raise InputError(
                f"{name}: expected one axis each for {over or 'nothing'}, got shape {values.shape}"
            )
    return {"t": (), **{name: values.shape for name, values in found.items()}}


def _values(state: object, name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """A quantity of a row, as a copy of its own."""
    try:
        given = getattr(state, name)
        values = np.array(np.nan if given is None else given, dtype=np.float64)
    except AttributeError:
        raise InputError(f"{name}: the row does not have it") from None
    except (TypeError, ValueError):
        raise InputTypeError(f"{name}: expected numbers, not a {type(given).__name__}") from None
    if given is None or values.shape != shape:
        found = "None" if given is None else f"shape {values.shape}"
        raise InputError(f"{name}: expected shape {shape} as in the first row, got {found}")
    if name == "t" and not np.isfinite(values):
        raise InputError(f"t: must be finite, got {values}")
    return values
