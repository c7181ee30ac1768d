"""A study: many runs as one document, carried out anywhere, interrupted and resumed at will."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.arguments import whole
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.progress import Counter, counted
from vffnull.model.document import Document
from vffnull.model.scenario import Scenario, read, shown
from vffnull.studies.dataset import Dataset
from vffnull.studies.document import read_plan
from vffnull.studies.estimate import Estimate, estimated
from vffnull.studies.executor import check_executor, executor
from vffnull.studies.plan import Plan
from vffnull.studies.running import Begun, Tell, begin, carry_out, missing, new_token, runs_of
from vffnull.studies.store import Store, opened
from vffnull.studies.tuning import Tuned, tune

if TYPE_CHECKING:
    from distributed import Client

__all__ = ["Study", "studies"]

_BUNDLED = Path(__file__).parent


class Study:
    """Many runs as one document: what varies, over which scenarios, and what is kept of each run.

    Parameters
    ----------
    document : Mapping
        The study, the same as a TOML file holds; see below.
    folder : str or path, optional
        Where files are that the document names; the present directory by default.

    Raises
    ------
    vffnull.errors.InputError, vffnull.errors.InputTypeError
        If a key is wrong; the message begins with it.
    vffnull.errors.ScenarioError
        If none of the scenarios that were tried can be run, or if a factor's key does not exist.
    ImportError
        Without the extra ``vffnull[study]``, where it is needed.

    See Also
    --------
    Study.load : the bundled studies and TOML files.
    simulate_many : runs of one machine, with their records in memory.

    Notes
    -----
    ================  ==================================================================================
    key               meaning
    ================  ==================================================================================
    ``scenario``      base scenario: a bundled name, the path of a TOML file, or a table
    ``[scenes]``      random scenes instead: ``families``, ``joints`` or ``arms`` and ``tasks``,
                      ``count`` of each kind, ``first_seed``
    ``[overrides]``   values for all runs, by dotted keys in quotes
    ``[[factors]]``   what varies: ``key`` or ``keys``, and ``range = [low, high]`` with
                      ``scale = "log"``, ``whole``, ``levels``; or ``values = [...]``; or ``choices``, a
                      table of names that change several keys each. ``name`` and ``unit`` of the column
    ``[design]``      ``kind``: ``grid`` (``levels``), ``latin-hypercube``, ``sobol``, ``random`` (``count``),
                      ``saltelli`` (``count`` samples, each of factors + 2 points), ``table`` (``rows``
                      or ``file``)
    ``repetitions``   runs of each point and scene; 1 by default
    ``seed``          of the design and of all runs; 0 by default
    ``seeds``         ``"run"``, every run has its own, or ``"repetition"``, the same for all points
    ``metrics``       which to keep; all by default
    ``[records]``     downsampled records: ``every`` so many steps, ``quantities``
    ``[block]``       ``runs`` of a block; by default some seconds of work
    ``[tune]``        ``trials``, ``objectives = [{ metric, direction, over, missing }]``, ``sampler``
                      (``tpe``, ``random``, ``nsga2``), ``batch``
    ================  ==================================================================================

    Every point of the design meets every scene, and that as often as there are repetitions. What a run
    computes follows from the document and its number alone, so a study leaves the same bits wherever and in
    whatever order its runs are computed.

    Examples
    --------
    >>> study = Study({"scenario": "sweep-through", "factors": [{"key": "controller.field.gain",
    ...     "range": [0.03, 3.0], "scale": "log"}], "design": {"kind": "grid", "levels": 9}})
    >>> study.runs
    9
    >>> dataset = study.run("results")  # doctest: +SKIP
    >>> dataset.to_pandas()  # doctest: +SKIP
    """

    def __init__(self, document: Mapping[str, Any], folder: str | os.PathLike[str] = ".") -> None:
        self._plan = read_plan(document, Path(folder))

    @classmethod
    def load(cls, source: str | os.PathLike[str], runs: int | None = None) -> Study:
        """Load a bundled study by its name, or a TOML file by its path.

        Parameters
        ----------
        source : str or path
            One of `vffnull.studies.studies()`, or a path that ends in ``.toml``.
        runs : int, optional
            How many runs it may have at most: another ``count`` of its design, or of its scenes where it has
            none.

        Raises
        ------
        vffnull.errors.InputError
            If there is no such study, if something is wrong with it, or if it has no ``count``, as a grid.
        """
        document, folder = _core.parse_toml(text_of(source), shown(source)), Path(os.fspath(source)).parent
        folder = folder if Path(os.fspath(source)).suffix == ".toml" else _BUNDLED
        found = cls(document, folder)
        return found if runs is None else cls(_of_runs(document, found.runs, runs), folder)

    @property
    def name(self) -> str:
        """The study's name, or an empty string."""
        return self._plan.name

    @property
    def description(self) -> str:
        """What it is for, or an empty string."""
        return self._plan.description

    @property
    def runs(self) -> int:
        """How many runs it has."""
        return self._plan.runs

    @property
    def points(self) -> int:
        """How many points its design has."""
        return self._plan.points

    @property
    def blocks(self) -> int:
        """How many blocks of runs are computed and written together."""
        return self._plan.blocks

    @property
    def factors(self) -> list[str]:
        """What varies, by the names of the columns."""
        return [factor.name for factor in self._plan.factors]

    def to_dict(self) -> Document:
        """The document, complete: nothing that it names is elsewhere, and every default is stated."""
        return self._plan.to_dict()

    def scenario(self, run: int) -> Scenario:
        """The scenario of a run, to look at it or to run it alone.

        Parameters
        ----------
        run : int
            The number of the run, as in the column ``run``.

        Raises
        ------
        vffnull.errors.InputError
            If there is no such run.
        vffnull.errors.ScenarioError
            If it cannot be run; a study calls it ``refused``.
        """
        run = whole("run", run, 0, self.runs - 1)
        return Scenario.from_dict(self._plan.document(run, self._plan.row(run)))

    def estimate(self) -> Estimate:
        """What it takes: time and size, from a few runs that are made for it in about two seconds."""
        return estimated(self._plan)

    def run(
        self,
        out: str | os.PathLike[str],
        *,
        resume: bool = False,
        threads: int | None = None,
        workers: int | None = None,
        scheduler: str | Client | None = None,
        progress: bool | Counter | None = None,
    ) -> Dataset:
        """Carry the study out, and write a dataset that can be read while it grows.

        Parameters
        ----------
        out : str or path
            A directory, or an address that fsspec knows, such as ``s3://bucket/study``.
        resume : bool, optional
            Whether to go on with what is there: blocks that are whole are left, damaged parts are made again.
        threads : int, optional
            How many threads of this process compute; as many as there are cores by default.
        workers : int, optional
            Start so many worker processes on this machine instead.
        scheduler : str or distributed.Client, optional
            Let a Dask cluster compute instead: the address of its scheduler, as ``"tcp://host:8786"``, or a
            client that is connected to it. Each thread of a worker computes a block at a time.
        progress : bool or callable, optional
            True shows a progress bar; a callable gets the number of runs that are over and of all that were
            left to do.

        Returns
        -------
        Dataset
            ``runs/*.parquet``, one part for each block, and ``study.json``, the document with versions,
            seeds, and units; with ``[records]`` also ``records/*.parquet``.

        Raises
        ------
        vffnull.errors.InputError
            If the directory holds another study, or this one without `resume`, or links; if another client
            is writing there; if a worker has other versions.
        OSError
            If a part cannot be written: a full disk, for instance. What is there stays, and can be resumed.
        ConnectionError
            If the scheduler is gone.
        KeyboardInterrupt
            After Ctrl-C; at once, and what is there can be resumed.
        """
        dataset, _ = self._carried_out(out, resume, threads, workers, scheduler, progress)
        return dataset

    def tune(
        self,
        out: str | os.PathLike[str],
        *,
        trials: int | None = None,
        resume: bool = False,
        threads: int | None = None,
        workers: int | None = None,
        scheduler: str | Client | None = None,
        progress: bool | Counter | None = None,
    ) -> Tuned:
        """Look for good values of the factors: Optuna proposes them, in the place of the design.

        Parameters
        ----------
        out : str or path
            A directory of its own; Optuna's journal stands there, too.
        trials : int, optional
            How many candidates in all, those that are there included; as the document says by default.
        resume, threads, workers, scheduler, progress
            As for `run`.

        Returns
        -------
        Tuned
            All trials and the best of them.

        Raises
        ------
        vffnull.errors.InputError
            As `run`; and if the document has no table ``[tune]``.
        ImportError
            Without the extra ``vffnull[study]``.
        """
        for module in ("optuna", "pyarrow", "scipy"):
            extra(module, "study")
        plan = self._plan.as_tuning()
        count = plan.points if trials is None else whole("trials", trials, 1, 10_000_000)
        if "://" in os.fspath(out) and not os.fspath(out).startswith("file://"):
            raise InputError(
                f"{os.fspath(out)}: a tuning needs a directory of this machine, for Optuna's journal"
            )
        with _open(plan, out, resume, threads, workers, scheduler, progress) as (store, token, where, begun):
            with counted(progress, count * plan.per_point) as report:
                for _ in tune(plan, store, token, where, begun, count, report):
                    pass
            store.tidy()
        return Dataset.open(out).tuned()

    def _carried_out(
        self,
        out: str | os.PathLike[str],
        resume: bool,
        threads: int | None,
        workers: int | None,
        scheduler: str | Client | None,
        progress: bool | Counter | None,
        tell: Tell = lambda _: None,
    ) -> tuple[Dataset, Begun]:
        """`run`, with a word about what was there."""
        plan = self._plan
        with _open(plan, out, resume, threads, workers, scheduler, progress, tell) as (
            store,
            token,
            where,
            begun,
        ):
            total = plan.runs - runs_of(plan, begun.blocks)
            with counted(progress, total) as report:
                for _ in carry_out(plan, store, token, where, missing(plan, begun), report, total):
                    pass
            store.tidy()
        return Dataset.open(out), begun

    def __repr__(self) -> str:
        varied = ", ".join(self.factors) or "nothing"
        return f"<Study {self.name or 'without a name'}: {self.runs} runs over {varied}>"


@contextmanager
def _open(
    plan: Plan,
    out: str | os.PathLike[str],
    resume: bool,
    threads: int | None,
    workers: int | None,
    scheduler: Any,
    progress: Any,
    tell: Tell = lambda _: None,
) -> Iterator[tuple[Store, str, Any, Begun]]:
    """Lock the directory, verify what is there, and connect to who computes."""
    _progress.check(progress)
    check_executor(threads, workers, scheduler)
    for module in ("pyarrow", "scipy"):
        extra(module, "study")
    store, token = opened(out), new_token()
    with store.locked(token):
        begun = begin(plan, store, resume)
        if begun.blocks or begun.damaged:
            of = f" of {plan.blocks}" if plan.design is not None else ""
            damaged = f", and {begun.damaged} damaged parts are made again" if begun.damaged else ""
            tell(f"{len(begun.blocks)}{of} blocks are there and whole{damaged}")
        with executor(threads, workers, scheduler, tell) as where:
            yield store, token, where, begun


def studies() -> list[str]:
    """Names of the bundled studies."""
    return sorted(path.stem for path in _BUNDLED.glob("*.toml"))


def text_of(source: str | os.PathLike[str]) -> str:
    """The text of a bundled study or of a TOML file, comments included."""
    if Path(os.fspath(source)).suffix == ".toml":
        return read(source)
    names = studies()
    if os.fspath(source) not in names:
        if os.path.isfile(source):
            raise InputError(f"{shown(source)}: the name of a study file ends in .toml")
        import difflib

        near = difflib.get_close_matches(os.fspath(source), names, n=1)
        hint = f" (did you mean {near[0]!r}?)" if near else ""
        raise InputError(
            f"no study called {shown(source)!r}{hint}; bundled are {', '.join(names)}; "
            "the path of a file ends in .toml"
        )
    return (_BUNDLED / f"{os.fspath(source)}.toml").read_text(encoding="utf-8")


def _of_runs(document: Document, runs: int, most: int) -> Document:
    """The document with as many points, or scenes, as make at most so many runs."""
    most = whole("runs", most, 1, 10**9)
    name = next((name for name in ("design", "scenes") if "count" in document.get(name, {})), None)
    if name is None:
        raise InputError("runs: this study has no `count`; its levels, values or rows say how many there are")
    table = document[name]
    count = most * int(table["count"]) // runs
    if table.get("kind") in ("sobol", "saltelli"):  # even for powers of two only
        count = 1 << (count.bit_length() - 1) if count else 0
    if count < 1:
        raise InputError(f"runs: {most} are too few, one of its points takes {runs // int(table['count'])}")
    return {**document, name: {**table, "count": count}}
