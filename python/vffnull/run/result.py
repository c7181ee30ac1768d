"""What a run leaves behind, with everything that can be made of it: figures, pages, files and tables."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

from vffnull._support import progress as _progress
from vffnull._support.extras import extra
from vffnull._support.interrupts import heard
from vffnull.model import record as _record
from vffnull.model.outcome import Metrics, Outcome, Replan, Status, readable
from vffnull.model.record import recorded
from vffnull.model.scenario import Scenario

if TYPE_CHECKING:
    import numpy as np
    import pandas
    import pyarrow
    import xarray
    from matplotlib.figure import Figure
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["Film", "Metrics", "Replan", "Result", "Status", "readable", "report"]


@dataclass(frozen=True, eq=False, repr=False)
class Result(Outcome):
    """The outcome of a run.

    With T recorded instants, n joints, k obstacles, and a task of dimension m: in the plane (D = 2) 2 for a
    position and 3 for a pose, in space (D = 3) 3 for a position, 5 for pointing and 6 for a pose:

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
        Joint angles [rad] and velocities [rad/s]; of joints that slide [m] and [m/s].
    tau : (T, n) ndarray
        Joint torques [N·m]; of joints that slide forces [N].
    tau_task, tau_null : (T, n) ndarray
        Their parts that serve the task and the null space [N·m].
    tau_vff : (T, n) ndarray
        Repulsion Σ JᵢᵀFᵢ, before its projection into the null space [N·m].
    x, x_ref : (T, m) ndarray, in space (T, 3)
        End effector and its reference [m]; in the plane an orientation [rad] comes last.
    dx : (T, m) ndarray
        The end effector's velocity [m/s]; rates of an orientation [rad/s] come last.
    error : (T, m) ndarray
        Tracking error, x − x_ref for a position [m]. In space the rotation from the reference [rad] comes
        last: of a pose about the world's axes, of pointing about the tool's own x and y.
    orientation, orientation_ref : (T, 4) ndarray or None
        Orientations of end effector and reference in space, unit quaternions [w, x, y, z]; None for a
        position and in the plane.
    force : (T, n) ndarray
        Magnitude of the repulsion on each link [N].
    clearance : (T, n) ndarray
        Signed distance of each link's surface to the nearest obstacle's [m]; negative in contact.
    obstacles : (T, k, D) ndarray
        Positions of the obstacles [m].
    energy : (T, 3) ndarray
        Energies [J] as named in `vffnull.ENERGIES`: kinetic, of gravity, and the storage of the null space.
    power : (T, 6) ndarray
        Powers [W] as named in `vffnull.PORTS`: of the motors, and into the storage of the null space.
    manipulability : (T,) ndarray
        √det(J Jᵀ) [m²], in space [m³]; 0 in a singularity.
    objective_scale : (T, 6) ndarray or None
        What the limits let through of each of `vffnull.OBJECTIVES`, from 0 to 1; None without limits.
    self_clearance : (T,) ndarray or None
        Signed distance [m] of the nearest two links that share no joint; None where it is not measured.
    tank : (T,) ndarray or None
        Energy in the tank [J]; None without one.
    tau_ext : (T, n) ndarray or None
        Torque of the wrenches and contacts that push the arm from then on [N·m]; None where nothing can.
    contact_force : (T, k, D) ndarray or None
        Force of each obstacle on the arm [N]; None where none has a ``contact``.
    tau_ext_estimate : (T, n) ndarray or None
        Torque that the model does not know, as the observer estimates it [N·m]; None without one.
    wrench_estimate : (T, m) ndarray or None
        The same as force [N] and torque [N·m] at the end effector, in the axes of `error`: what of it moves
        the end effector. None without an observer.
    touched_link : (T,) ndarray or None
        Link on which a contact is felt, counted from 0, or one beyond it; NaN while none is. None without a
        table ``[controller.observer.detection]``.
    contact_deviation : (T, n) ndarray or None
        What the estimate is beyond what it has been of late [N·m] (T166). None likewise.
    contact_threshold : (T, n) ndarray or None
        What that has to be for a contact to be felt [N·m]; infinite in the first moments. None likewise.
    yielded : (T,) ndarray or None
        How far the end effector gives way to a push [m]. None without a table
        ``[controller.touch.reaction]``.
    released : (T,) ndarray or None
        How many parts of its task the look-ahead lets go, in the order of ``controller.yielding.order``: 0
        while it holds all of it. None without that, or without look-ahead.
    slack : (T,) ndarray or None
        By how much the barriers of ``avoidance = "cbf"`` are broken at most [m/s²]; None with other laws.
    path_time : (T,) ndarray or None
        Time [s] of the reference, which a governor slows down; `x_ref` and `error` are those of the reference
        that waits. None without a table ``[controller.governor]``.
    q_plan : (T, n) ndarray or None
        Joint angles of the plan [rad], and of every plan that took its place, NaN as long as there is none;
        None unless the reference is one or the scenario has a table ``[replan]``.
    q_measured, dq_measured : (T, n) ndarray or None
        What the controller took the joint angles [rad] and velocities [rad/s] for; None unless the scenario
        has sensors, a table ``[measurement]``. Everything else is of the true state.
    tau_applied : (T, n) ndarray or None
        Torque at the joints [N·m], where `tau` is that of the law: of the drives, and what a robot adds
        against gravity. None unless the scenario has drives, a table ``[actuator]``, or asks for something
        else to be sent, in ``[controller.command]``.
    sensed : (T, rays, D) ndarray or None
        Points [m] that the controller knew of the obstacles, NaN for a ray that met nothing; None unless the
        scenario has range sensors, a table ``[perception]``. `clearance` and `obstacles` are true.
    plant : {"core", "mujoco"}
        What moved the arm.
    replans : tuple of Replan
        Searches for a plan, one after the other; empty without a table ``[replan]``.

    Examples
    --------
    >>> result = simulate("paper-1")
    >>> print(result.status)
    completed
    >>> paths = result.plot("figures")
    """

    scenario: Scenario

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the result with its scenario and version to one file; the ending says which kind.

        ========== ===================================================== ==========
        ending     kind                                                  needs
        ========== ===================================================== ==========
        .npz       NumPy's archive; `load` reads it                      –
        .csv       text, one row per instant; `load` reads it            –
        .parquet   small, for data tools; `load` reads it                ``[io]``
        .arrow     Arrow IPC (Feather), mapped quickly; `load` reads it  ``[io]``
        .mcap      for Foxglove and PlotJuggler                          ``[mcap]``
        .rrd       for the Rerun viewer                                  ``[rerun]``
        ========== ===================================================== ==========

        Nothing is rounded in the kinds that `load` reads: the arrays come back bit by bit. Every kind has the
        unit of every column. Of a run in space, Foxglove and Rerun draw the arm among its obstacles: the
        files have the transforms of all links, of the tip, the obstacles and the target, with their solids,
        and the arm as URDF.

        Parameters
        ----------
        path : str or path
            A path with one of these endings.

        Returns
        -------
        Path
            Where it was written.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise.
        ImportError
            Without the extra that this kind of file needs.
        """
        from vffnull import logs

        return logs.save(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Result:
        """Read a result that `save` has written.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.npz``, ``.parquet``, ``.arrow`` or ``.csv``.

        Raises
        ------
        vffnull.errors.InputError
            If the file was not written by `save`, or by a version with another format, or is damaged.
        FileNotFoundError
            If there is no such file.
        ImportError
            Without the extra that this kind of file needs.
        """
        from vffnull import logs

        return logs.load(path, cls)

    def to_arrow(self) -> pyarrow.Table:
        """The record as an Arrow table, one row per instant, without a copy of what is contiguous.

        Columns are called as in `to_pandas`, time is ``t``. Every field's metadata holds ``unit`` and
        ``long_name``; the schema's holds scenario, metrics and version as JSON under ``vffnull``.
        Libraries that speak Arrow's C interface (Polars, DuckDB, …) take the result itself for a table.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[io]``.
        """
        from vffnull.logs import arrow

        return arrow.table(self)

    @classmethod
    def from_arrow(cls, table: pyarrow.Table) -> Result:
        """The result that `to_arrow` has made a table of, bit by bit.

        Parameters
        ----------
        table : pyarrow.Table
            With the metadata that `to_arrow` gave it.

        Raises
        ------
        vffnull.errors.InputError
            If the table is another one.
        """
        from vffnull.logs import arrow
        from vffnull.logs.header import restore

        source = Path("table")
        return restore(cls, *arrow.parts(table, source), source)

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> pandas.DataFrame:
        """The record as a table, one row per instant.

        Columns are called ``q_0``, ``q_1``, …, ``x_x``, ``x_y``, ``obstacles_0_x`` and so on; the index is
        time [s]. ``attrs`` holds the unit of every column, the scenario, the status and the version.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[io]``.
        """
        library = extra("pandas", "io")
        columns: dict[str, Array] = {}
        units: dict[str, str] = {}
        for column, line in self.layout.lines(self):
            columns[column.name] = line
            units[column.name] = column.unit
        table: pandas.DataFrame = library.DataFrame(columns, index=library.Index(self.t, name="t"))
        table.attrs = {"units": {"t": "s", **units}, **self._attributes()}
        return table

    def to_xarray(self) -> xarray.Dataset:
        """The record as a dataset with named dimensions; ``units`` and ``long_name`` label plots of it.

        Joints, links and obstacles count from 0, as the arrays do. The attributes hold the scenario as TOML
        text, the status, the version and the metrics.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[io]``.
        """
        library = extra("xarray", "io")
        layout = self.layout
        sizes: dict[_record.Dimension, int] = {}
        data = {}
        for name, values in recorded(self).items():
            quantity = layout.quantities[name]
            labels = {"units": layout.units(name, values.shape[1:]), "long_name": quantity.meaning}
            data[name] = (("t", *quantity.over), values.copy(), labels)
            for over, size in zip(quantity.over, values.shape[1:], strict=True):
                sizes[over] = size
        dataset: xarray.Dataset = library.Dataset(
            data,
            coords={
                "t": ("t", self.t, {"units": "s", "long_name": "time"}),
                **{str(over): layout.labels(over, size) for over, size in sizes.items()},
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

    @heard()
    def plot(
        self, directory: str | os.PathLike[str] | None = None, format: str = "png"
    ) -> dict[str, Figure] | list[Path]:
        """Draw the run as figures for print: the arm among the obstacles, and what it does over time.

        ``overview``, ``strobe`` (in space a view in three dimensions and three projections, to one scale),
        ``tracking``, ``tracking_error``, ``joint_angles`` and ``joint_torques`` always; ``limits``, how much
        of the limits of angle, speed and torque is used, if the arm has any; ``null_space``, the motion that
        the task leaves free, if there is one; ``repulsive_torques``, ``forces`` and ``clearance`` with
        obstacles; ``sensed`` with range sensors. The plan, if there is one, is a dashed arm in the plane, a
        pale one in space, and dashed joint angles; where another took its place there is a mark.

        Parameters
        ----------
        directory : str or path, optional
            Where to write the figures; made if it does not exist. With the ending of a picture, ``run.png``,
            ``.pdf`` or ``.svg``, the file that ``overview`` alone is written to.
        format : {"png", "pdf", "svg"}, optional
            What kind of files to write.

        Returns
        -------
        dict of str to matplotlib.figure.Figure, or list of Path
            The figures by name; with a `directory`, the files written.

        Raises
        ------
        vffnull.errors.InputError
            If figures are not written in this format, or in a file with another ending.
        """
        from vffnull._support.figures import ending, is_file
        from vffnull.draw import figures as plotting

        if directory is None:
            return plotting.draw(self)
        is_file(directory)  # or a folder; what is neither is refused
        return plotting.save(self, Path(directory), ending(format))

    @overload
    def animate(
        self,
        path: None = None,
        *,
        fps: float = 25.0,
        speed: float = 1.0,
        size: int | None = None,
        view: str | tuple[float, float] | None = None,
        progress: bool | _progress.Progress | None = None,
    ) -> Film: ...

    @overload
    def animate(
        self,
        path: str | os.PathLike[str],
        *,
        fps: float = 25.0,
        speed: float = 1.0,
        size: int | None = None,
        view: str | tuple[float, float] | None = None,
        progress: bool | _progress.Progress | None = None,
    ) -> Path: ...

    @heard()
    def animate(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        fps: float = 25.0,
        speed: float = 1.0,
        size: int | None = None,
        view: str | tuple[float, float] | None = None,
        progress: bool | _progress.Progress | None = None,
    ) -> Path | Film:
        """Show the arm in motion: obstacles and how far their fields reach, forces, the tip's trail, time.

        In space, links have the colour of their clearance, and a strip shows the course of the smallest one.

        An arrow shows the repulsion on a link, at its point nearest to an obstacle and away from that. Where
        a plan has the joints there is another arm, dashed or pale; a new plan is named for a second.

        Parameters
        ----------
        path : str or path, optional
            A path that ends in ``.gif`` or, with the extra ``vffnull[video]``, in ``.mp4``. Without it, the
            film is returned, and a notebook shows it.
        fps : float, optional
            Frames per second of the film, at most 50 in a GIF, which counts in hundredths of a second: at 30
            some of its frames last 0.03 s, others 0.04.
        speed : float, optional
            Seconds of the run per second of the film.
        size : int, optional
            How wide it is [dots], from 160 to 3840; 648 in the plane and 600 in space by default.
        view : str or (float, float), optional
            From where a scene in space is seen: ``"front"``, ``"back"``, ``"left"``, ``"right"``, ``"top"``,
            or azimuth and elevation [degrees].
        progress : bool or callable, optional
            True shows a progress bar; a callable gets the number of frames done and of all.

        Returns
        -------
        Path or Film
            Where it was written; without a `path`, the film itself.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise, or if `fps`, `speed`, `size` or `view` is out of range.
        ImportError
            If a film needs the extra ``vffnull[video]`` and it is missing.
        """
        if path is None:
            from tempfile import TemporaryDirectory

            with TemporaryDirectory() as folder:
                written = self._film(Path(folder) / "run.gif", fps, speed, size, view, progress)
                return Film(written.read_bytes())
        return self._film(Path(path), fps, speed, size, view, progress)

    def _film(
        self,
        path: Path,
        fps: float,
        speed: float,
        size: int | None,
        view: str | tuple[float, float] | None,
        progress: bool | _progress.Progress | None,
    ) -> Path:
        from vffnull.draw.figures.animation import animate, check, frames

        _progress.check(progress)
        check(path, fps, speed, size, view)
        how: Any = {"fps": fps, "speed": speed, "size": size, "view": view}
        if progress is not True:
            return animate(self, path, **how, progress=progress or None)
        with _progress.bar(len(frames(self, fps, speed)), delay=1.0, counts=".0f frames") as report:
            return animate(self, path, **how, progress=report)

    def report(self, path: str | os.PathLike[str]) -> Path:
        """Write everything about the run into one HTML file that needs nothing else, not even a network.

        The arm in motion with a time slider that is linked to the plots, the metrics, the scenario, the
        assumptions and the version; the arm where a plan has it, and when others took its place. A scene in
        space is turned by dragging, and its links have the colour of their clearance; a browser without WebGL
        shows it in a simpler way.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.html``.

        Returns
        -------
        Path
            Where it was written.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise.
        ImportError
            Without the extra ``vffnull[report]``.

        See Also
        --------
        vffnull.compare : several runs side by side.
        """
        from vffnull.draw.report import write

        return write([self], path)

    def _repr_html_(self) -> str | None:
        from vffnull._support import representation

        return representation.html(self)


@dataclass(frozen=True, repr=False)
class Film:
    """A run in motion as an animated GIF, which a notebook shows; made by `Result.animate` without a path.

    Attributes
    ----------
    data : bytes
        The file's content.
    """

    data: bytes

    def __repr__(self) -> str:
        return f"<Film: GIF of {len(self.data) / 1e3:.0f} kB; a notebook shows it>"

    def _repr_html_(self) -> str:
        from base64 import b64encode

        return f'<img src="data:image/gif;base64,{b64encode(self.data).decode()}" alt="the arm in motion">'


def report(result: Result, path: str | os.PathLike[str]) -> Path:
    """Write everything about a run into one HTML file: the same as `Result.report`.

    Parameters
    ----------
    result : Result
        The run.
    path : str or path
        A path that ends in ``.html``.

    Returns
    -------
    Path
        Where it was written.

    Raises
    ------
    vffnull.errors.InputError
        If the path ends otherwise.
    vffnull.errors.InputTypeError
        If it is no result.
    ImportError
        Without the extra ``vffnull[report]``.

    See Also
    --------
    vffnull.compare : several runs side by side.
    """
    from vffnull.draw.report import write

    return write([result], path)
