"""What a run leaves behind: how it ended, what it measured, and everything recorded on the way."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _core
from vffnull._record import AXES, QUANTITIES, unit
from vffnull.errors import InputError
from vffnull.scenario import Scenario

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

__all__ = ["Metrics", "Result", "Status"]

Array = NDArray[np.float64]

_FORMAT = 2  # of the file that `Result.save` writes


class Status(str, Enum):
    """How a run ended. A status equals its plain string: ``result.status == "completed"``."""

    COMPLETED = "completed"
    """To its end, and no link ever touched an obstacle."""
    COLLIDED = "collided"
    """To its end, but a link touched an obstacle on the way."""
    DIVERGED = "diverged"
    """Stopped early: velocities or angles grew beyond all bounds."""
    INTERRUPTED = "interrupted"
    """Stopped early by Ctrl-C."""

    def __str__(self) -> str:
        return self.value

    def __format__(self, spec: str) -> str:
        return format(self.value, spec)


class Metrics(Mapping[str, float | int | None]):
    """Measures of a run by name, as items or as attributes; printed as a table with units.

    A measure that does not apply to a run is None: the clearance without obstacles, for instance.

    Parameters
    ----------
    values : Mapping
        The measures.
    """

    __slots__ = ("_values",)

    def __init__(self, values: Mapping[str, float | int | None]) -> None:
        self._values = dict(values)

    def __getitem__(self, name: str) -> float | int | None:
        return self._values[name]

    def __getattr__(self, name: str) -> float | int | None:
        if name.startswith("_"):  # not ours; `_values` itself is looked for here while an object is unpickled
            raise AttributeError(name)
        if name not in self._values:
            raise AttributeError(f"no metric called {name!r}; there are {', '.join(self._values)}")
        return self._values[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return f"Metrics({self._values!r})"

    def __str__(self) -> str:
        rows = [(name, _readable(value), *_core.METRICS.get(name, ("", ""))) for name, value in self.items()]
        if not rows:
            return "(no metrics)"
        wide = [max(len(row[column]) for row in rows) for column in range(3)]
        return "\n".join(
            f"{name:<{wide[0]}}  {value:>{wide[1]}} {unit:<{wide[2]}}  {meaning}".rstrip()
            for name, value, unit, meaning in rows
        )


def _readable(value: float | int | None) -> str:
    return "–" if value is None else f"{value:d}" if isinstance(value, int) else f"{value:.4g}"


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The outcome of a run.

    With T recorded instants, n joints, k obstacles, and a task of dimension m (2 for a position, 3 for a
    pose):

    Attributes
    ----------
    scenario : Scenario
        What was run.
    status : Status
        How it ended.
    message : str
        The same in a sentence, with the time if it ended early.
    end_time : float
        Where it ended [s].
    wall_time : float
        How long the computation took [s].
    warnings : tuple of str
        What looked wrong before the start.
    metrics : Metrics
        Measures of the run.
    version : str
        The version of vffnull that computed it.
    t : (T,) ndarray
        Time [s].
    q, dq : (T, n) ndarray
        Joint angles [rad] and velocities [rad/s].
    tau : (T, n) ndarray
        Joint torques [N·m].
    tau_task, tau_null : (T, n) ndarray
        Their parts that serve the task and the null space [N·m].
    tau_vff : (T, n) ndarray
        Repulsion Σ JᵢᵀFᵢ, before its projection into the null space [N·m].
    x, dx, x_ref : (T, m) ndarray
        End effector [m], its velocity [m/s], and its reference [m]; an orientation [rad] comes last.
    error : (T, m) ndarray
        Tracking error, x − x_ref for a position [m].
    force : (T, n) ndarray
        Magnitude of the repulsion on each link [N].
    clearance : (T, n) ndarray
        Signed distance of each link's surface to the nearest obstacle's [m]; negative in contact.
    obstacles : (T, k, 2) ndarray
        Positions of the obstacles [m].
    slack : (T,) ndarray
        By how much the barriers of ``avoidance = "cbf"`` are broken at most [m/s²]; 0 with other laws.

    Examples
    --------
    >>> result = simulate("paper-1")
    >>> print(result.status)
    completed
    >>> paths = result.plot("figures")
    """

    scenario: Scenario
    status: Status
    message: str
    end_time: float
    wall_time: float
    warnings: tuple[str, ...]
    metrics: Metrics
    version: str
    t: Array
    q: Array
    dq: Array
    tau: Array
    tau_task: Array
    tau_null: Array
    tau_vff: Array
    x: Array
    dx: Array
    x_ref: Array
    error: Array
    force: Array
    clearance: Array
    obstacles: Array
    slack: Array

    def __repr__(self) -> str:
        return (
            f"<Result of {self.scenario.name or 'a scenario'}: {self.status} at {self.end_time:g} s, "
            f"{len(self.t)} instants>"
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the result with its scenario and version to one ``.npz`` file; nothing is rounded.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.npz``.

        Returns
        -------
        Path
            Where it was written.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise.
        """
        import json

        target = npz_path(path)
        header = {
            "format": _FORMAT,
            "version": self.version,
            "scenario": self.scenario.to_dict(),
            "status": self.status.value,
            "message": self.message,
            "end_time": self.end_time,
            "wall_time": self.wall_time,
            "warnings": list(self.warnings),
            "metrics": dict(self.metrics),
        }
        arrays = {name: getattr(self, name) for name in ("t", *QUANTITIES)}
        draft = target.with_name(f".{target.name}.part")  # a crash never leaves half a file under the name
        try:
            with draft.open("wb") as file:
                np.savez(file, vffnull=np.array(json.dumps(header)), **arrays)
            draft.replace(target)
        finally:
            draft.unlink(missing_ok=True)
        return target

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Result:
        """Read a result that `save` has written.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.npz``.

        Raises
        ------
        vffnull.errors.InputError
            If the file was not written by `save`, or by a version with another format.
        FileNotFoundError
            If there is no such file.
        """
        import json
        import zipfile
        import zlib

        source = npz_path(path)
        try:
            with source.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
                header = json.loads(str(file["vffnull"]))
                written = int(header["format"])
                by = str(header["version"])
                # Another format has other arrays.
                names = ("t", *QUANTITIES) if written == _FORMAT else ()
                arrays = {name: file[name] for name in names}
        except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
            raise InputError(f"{source}: not a result that vffnull has saved") from None
        if written != _FORMAT:
            raise InputError(
                f"{source}: written by vffnull {by} in format {written}; this version reads format {_FORMAT}"
            )
        try:
            return cls(
                scenario=Scenario._of(header["scenario"]),
                status=Status(header["status"]),
                message=header["message"],
                end_time=header["end_time"],
                wall_time=header["wall_time"],
                warnings=tuple(header["warnings"]),
                metrics=Metrics(header["metrics"]),
                version=by,
                **arrays,
            )
        except (KeyError, ValueError, TypeError):
            raise InputError(f"{source}: its header is not the one that vffnull {by} writes") from None

    def to_pandas(self) -> pandas.DataFrame:
        """The record as a table, one row per instant.

        Columns are called ``q_1`` to ``q_n``, ``x_x``, ``x_y``, ``obstacles_1_x`` and so on; the index is
        time [s]. ``attrs`` holds the unit of every column, the scenario, the status and the version.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[io]``.
        """
        library = _extra("pandas")
        columns: dict[str, Array] = {}
        units: dict[str, str] = {}
        for name, quantity in QUANTITIES.items():
            values: Array = getattr(self, name)
            flat = values.reshape(len(values), -1).T
            for line, index in zip(flat, np.ndindex(values.shape[1:]), strict=True):
                labels = [
                    AXES[i] if over in ("task", "plane") else str(i + 1)
                    for over, i in zip(quantity.over, index, strict=True)
                ]
                column = "_".join([name, *labels])
                columns[column] = line
                units[column] = unit(name, labels[-1] if labels else "")
        table: pandas.DataFrame = library.DataFrame(columns, index=library.Index(self.t, name="t"))
        table.attrs = {"units": {"t": "s", **units}, **self._attributes()}
        return table

    def to_xarray(self) -> xarray.Dataset:
        """The record as a dataset with named dimensions; ``units`` and ``long_name`` label plots of it.

        Joints, links and obstacles count from 1. The attributes hold the scenario as TOML text, the status,
        the version and the metrics.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[io]``.
        """
        library = _extra("xarray")
        n, m, k = self.q.shape[1], self.x.shape[1], self.obstacles.shape[1]
        numbers = {"joint": np.arange(1, n + 1), "link": np.arange(1, n + 1), "obstacle": np.arange(1, k + 1)}
        data = {}
        for name, quantity in QUANTITIES.items():
            pose = "task" in quantity.over and m == 3
            units = f"{quantity.unit}, {unit(name, 'phi')}" if pose else quantity.unit
            labels = {"units": units, "long_name": quantity.meaning}
            data[name] = (("t", *quantity.over), getattr(self, name), labels)
        dataset: xarray.Dataset = library.Dataset(
            data,
            coords={
                "t": ("t", self.t, {"units": "s", "long_name": "time"}),
                "task": list(AXES[:m]),
                "plane": list(AXES[:2]),
                **numbers,
            },
            attrs=self._attributes(),
        )
        return dataset

    def _attributes(self) -> dict[str, Any]:
        measured = {f"metric_{name}": value for name, value in self.metrics.items() if value is not None}
        return {
            "scenario": str(self.scenario),
            "status": self.status.value,
            "message": self.message,
            "vffnull_version": self.version,
            **measured,
        }

    def plot(self, directory: str | os.PathLike[str] | None = None) -> dict[str, Figure] | list[Path]:
        """Draw the run: tracking, joint angles, repulsion, clearance, and the arm passing the obstacle.

        Parameters
        ----------
        directory : str or path, optional
            Where to write the figures as PNG files; made if it does not exist.

        Returns
        -------
        dict of str to matplotlib.figure.Figure, or list of Path
            The figures by name; with a `directory`, the files written.
        """
        from vffnull import plotting

        return plotting.draw(self) if directory is None else plotting.save(self, Path(directory))

    def animate(self, path: str | os.PathLike[str], *, fps: float = 25.0, speed: float = 1.0) -> Path:
        """Show the arm in motion as an animated GIF.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.gif``.
        fps : float, optional
            Frames per second of the film. GIF counts in hundredths of a second: 50, 25, 20, 10 are exact.
        speed : float, optional
            Seconds of the run per second of the film.

        Returns
        -------
        Path
            Where it was written.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise, or if `fps` or `speed` is not positive.
        """
        from vffnull.plotting.animation import animate

        return animate(self, Path(path), fps=fps, speed=speed)


def npz_path(path: str | os.PathLike[str]) -> Path:
    """The path, if it ends in ``.npz``; an InputError that names the alternatives otherwise."""
    target = Path(path)
    if target.suffix != ".npz":
        raise InputError(
            f"{target}: a result is saved as .npz, not {target.suffix or 'without an ending'}; "
            "for tables use result.to_pandas() or result.to_xarray()"
        )
    return target


def _extra(module: str) -> Any:
    """Import a package of the extra ``[io]``."""
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f'{module} is missing: pip install "vffnull[io]"') from error
