"""Reading what a study leaves, also while it grows: its parts as one table."""

from __future__ import annotations

import os
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.model.document import Document
from vffnull.studies.document import read_plan
from vffnull.studies.manifest import MANIFEST, read_manifest
from vffnull.studies.parts import READERS, Kind, named
from vffnull.studies.plan import Plan
from vffnull.studies.store import Store, opened

if TYPE_CHECKING:
    import pandas
    import pyarrow
    from typing_extensions import Self

__all__ = ["Runs"]


class Runs:
    """The runs of a study in a directory or a store.

    Parts that are added later are seen by the next call.

    Attributes
    ----------
    place : str
        Where it is.
    manifest : dict
        The study's document with versions, seeds, and the unit and meaning of every column.
    """

    def __init__(self, store: Store, manifest: Document) -> None:
        self._store, self.manifest = store, manifest
        self.place = store.place
        self._plan: Plan | None = None
        self._sound: set[str] = set()

    @classmethod
    def open(cls, place: str | os.PathLike[str]) -> Self:
        """Open a dataset.

        Parameters
        ----------
        place : str or path
            A directory, or an address that fsspec knows, such as ``s3://bucket/study``.

        Raises
        ------
        vffnull.errors.InputError
            If there is no dataset of a study, or if its manifest is damaged.
        ImportError
            Without the extra ``vffnull[study]``.
        """
        store = opened(place)
        manifest = read_manifest(store)
        if manifest is None:
            raise InputError(f"{os.fspath(place)}: no dataset of a study; it has no {MANIFEST}")
        return cls(store, manifest)

    @property
    def plan(self) -> Plan:
        """The study that was run."""
        if self._plan is None:
            plan = read_plan(self.manifest["study"], Path(), check=False)
            self._plan = plan.as_tuning() if self.manifest["tuned"] else plan
        return self._plan

    @property
    def runs(self) -> int:
        """How many runs there will be; of a tuning, how many its document allows."""
        return self.plan.runs

    @property
    def files(self) -> list[str]:
        """The parts with the runs, by their paths within the dataset."""
        return self._files("runs")

    def __len__(self) -> int:
        """How many runs are there."""
        return int(self._dataset("runs").count_rows())

    @property
    def factors(self) -> list[str]:
        """The columns of the factors."""
        return [factor.name for factor in self.plan.factors]

    @property
    def metrics(self) -> list[str]:
        """The columns of the metrics."""
        return list(self.plan.metrics)

    @property
    def goals(self) -> list[str]:
        """The objectives of its tuning, as ``min of min_clearance``."""
        tuning = self.plan.tuning
        return [f"{goal.over} of {goal.metric}" for goal in tuning.goals] if tuning else []

    def unit(self, column: str) -> str:
        """The unit of a column; empty if it has none."""
        return str(self.manifest["columns"].get(column, {}).get("unit", ""))

    def meaning(self, column: str) -> str:
        """What a column means."""
        return str(self.manifest["columns"].get(column, {}).get("meaning", ""))

    def table(self, columns: Iterable[str] | None = None, records: bool = False) -> pyarrow.Table:
        """The runs as one table of Arrow, in the order of their numbers.

        Parameters
        ----------
        columns : iterable of str, optional
            Which columns; all by default.
        records : bool, optional
            Whether the rows are those of the records instead: one for each kept instant of each run.

        Raises
        ------
        vffnull.errors.InputError
            If there is no such column, if the study keeps no records, or if a part is damaged.
        """
        kind: Kind = "records" if records else "runs"
        if records and self.plan.records is None:
            raise InputError("records: this study keeps none; its document has no table [records]")
        data = self._dataset(kind)
        names = list(data.schema.names) if columns is None else list(columns)
        for name in names:
            if name not in data.schema.names:
                listed = ", ".join(data.schema.names)
                raise InputError(f"{name}: there is no such column; there are {listed}")
        order = ["run", "t"] if records else ["run"]
        try:
            table = data.to_table(list(dict.fromkeys([*names, *order])))
        except (extra("pyarrow", "study").ArrowInvalid, OSError) as error:
            raise InputError(f"{self.place}: its parts cannot be read: {error}") from None
        return table.sort_by([(each, "ascending") for each in order]).select(names)

    def column(self, name: str) -> NDArray[Any]:
        """The values of a column (runs,), NaN where a metric does not apply."""
        return self.columns([name])[name]

    def columns(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """Several columns, read together."""
        table = self.table(names)
        found: dict[str, NDArray[Any]] = {}
        for name in table.column_names:
            values = table.column(name)
            if extra("pyarrow", "study").types.is_floating(values.type):
                found[name] = values.to_numpy().astype(float)
            else:
                found[name] = np.array(values.to_pylist())
        return found

    def to_pandas(self, records: bool = False) -> pandas.DataFrame:
        """The runs, or the records, as a table of pandas.

        Raises
        ------
        ImportError
            Without pandas.
        """
        extra("pandas", "study")
        return self.table(records=records).to_pandas()

    def counts(self) -> dict[str, int]:
        """How many runs ended how."""
        values = self.table(["status"]).column("status").value_counts().to_pylist()
        return dict(sorted((str(each["values"]), int(each["counts"])) for each in values))

    def _files(self, kind: Kind) -> list[str]:
        """The sound parts of a kind; one for each block, also while a damaged one is replaced."""
        parts = [part for name in self._store.names(kind) if (part := named(kind, name))]
        new = [part for part in parts if part.path not in self._sound]
        with ThreadPoolExecutor(READERS) as pool:
            sound = pool.map(lambda part: part.fits(self._store.read(part.path)), new)
            self._sound.update(part.path for part, fine in zip(new, sound, strict=True) if fine)
        found = {part.block: part for part in parts if part.path in self._sound}
        for part in parts:
            if part.block not in found:
                raise InputError(
                    f"{self.place}: {part.path} is damaged; `vffnull study run` with --resume computes its "
                    "runs again"
                )
        return [found[number].path for number in sorted(found)]

    def _dataset(self, kind: Kind) -> Any:
        systems, datasets = extra("pyarrow.fs", "study"), extra("pyarrow.dataset", "study")
        files = self._files(kind)
        if not files:
            raise InputError(f"{self.place}: no run is there yet")
        root, system = self._store.arrow("")
        if system is not None:
            system = systems.PyFileSystem(systems.FSSpecHandler(system))
        else:
            system = systems.LocalFileSystem()
        return datasets.dataset(
            [f"{root.rstrip('/')}/{each}" for each in files], filesystem=system, format="parquet"
        )

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of study {self.plan.name or 'without a name'}: {self.place}>"
