"""The downsampled records of a study: a row for every kept instant of every run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._support.errors import InputError, ScenarioError
from vffnull._support.extras import extra
from vffnull.model.record import Layout, recorded
from vffnull.studies.parts import Part, about, encoded
from vffnull.studies.plan import FIXED, Block, Plan
from vffnull.studies.probe import probe

if TYPE_CHECKING:
    import pyarrow

__all__ = ["record_schema_of", "records_part"]


def records_part(plan: Plan, block: Block, outcomes: Sequence[Mapping[str, Any]]) -> Part:
    """The downsampled records of a block: a row for every kept instant of every run."""
    arrow = extra("pyarrow", "study")
    schema, columns = _record_columns(plan)
    pieces: dict[str, list[Any]] = {name: [] for name in schema.names}
    for run, outcome in zip(range(block.first, block.last), outcomes, strict=True):
        record = outcome.get("record")
        if record is None or not len(record["t"]):
            continue
        pieces["run"].append(np.full(len(record["t"]), run))
        pieces["t"].append(record["t"])
        layout = Layout.of(outcome["scenario"])
        lines = {column.name: values for column, values in layout.lines(SimpleNamespace(**record))}
        for name in columns:
            if name not in lines:
                raise InputError(
                    f"records: run {run} has no column {name}: its arm or its task is another one"
                )
            pieces[name].append(lines[name])
    arrays = [
        arrow.array(np.concatenate(pieces[each.name]) if pieces[each.name] else [], type=each.type)
        for each in schema
    ]
    return encoded("records", block.number, arrow.Table.from_arrays(arrays, schema=schema))


@lru_cache(8)
def _record_columns(plan: Plan) -> tuple[pyarrow.Schema, list[str]]:
    """The columns of records, those of the first scenario, with units; and the names of quantities."""
    arrow = extra("pyarrow", "study")
    assert plan.records is not None
    start = _begun(plan)
    fields = [
        arrow.field("run", arrow.int64(), metadata={"unit": "", "meaning": FIXED["run"][1]}),
        arrow.field("t", arrow.float64(), metadata={"unit": "s", "meaning": "time"}),
    ]
    names = []
    for name in plan.records.quantities:
        if name not in start:
            raise InputError(f"records.quantities: the scenario has no {name}")
        for column in plan.layout.columns(name, start[name].shape[1:]):
            names.append(column.name)
            with_unit = {"unit": column.unit, "meaning": column.meaning}
            fields.append(arrow.field(column.name, arrow.float64(), metadata=with_unit))
    return arrow.schema(fields, metadata=about(plan)), names


def record_schema_of(plan: Plan) -> pyarrow.Schema:
    """The columns of records, with their units."""
    return _record_columns(plan)[0]


def _begun(plan: Plan) -> Mapping[str, Any]:
    """The record of the beginning of the first scenario, which tells the columns of all."""
    document = plan.base.document(0, {**plan.overrides, "simulation.record_every": 1_000_000_000})
    try:
        outcome = probe(document, 0.0, record=True)
    except ScenarioError as error:
        raise InputError(f"records: need a base scenario that can be run: {error}") from None
    return recorded(SimpleNamespace(**outcome["record"]))
