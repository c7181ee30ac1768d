"""Designs that are given as a table: rows in the document, or a file of CSV or Parquet beside it."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.studies._keyed import Keyed, kind
from vffnull.studies.designs import TableOf
from vffnull.studies.factors import Factor

__all__ = ["columns_of", "read_table", "with_spread"]

Columns = dict[str, list[Any]]

_SPREADS = ("range", "values", "choices")


def columns_of(table: Keyed, names: Sequence[str], folder: Path) -> Columns | None:
    """The columns of a table, by the names of the factors; None if the document has coordinates."""
    where = table.one_of("rows", "file", "coordinates")
    if where == "coordinates":
        return None
    if where == "file":
        return _of_file(table, names, folder / table.text("file"))
    columns: Columns = {name: [] for name in names}
    for i, row in enumerate(table.rows("rows")):
        place = f"{table.at('rows')}[{i}]"
        if isinstance(row, Mapping):
            if set(row) != set(names):
                raise InputError(f"{place}: expected the columns {', '.join(names)}, got {', '.join(row)}")
            row = [row[name] for name in names]
        if not isinstance(row, list | tuple) or len(row) != len(names):
            raise InputError(f"{place}: expected a list of {len(names)} values, for {', '.join(names)}")
        for name, value in zip(names, row, strict=True):
            columns[name].append(value)
    return columns


def with_spread(content: Any, column: Sequence[Any]) -> Any:
    """A factor's table in which its column says how far it spreads, unless it says so itself."""
    if not isinstance(content, Mapping) or any(key in content for key in _SPREADS) or not len(column):
        return content
    numbers = all(isinstance(each, int | float) and not isinstance(each, bool) for each in column)
    if numbers and all(map(math.isfinite, column)) and min(column) < max(column):
        whole = all(isinstance(each, int) for each in column)
        return {**content, "range": [min(column), max(column)], "whole": whole}
    distinct: list[Any] = []
    for each in column:
        if each not in distinct:
            distinct.append(each)
    return {**content, "values": distinct}


def read_table(table: Keyed, factors: Sequence[Factor], columns: Columns | None) -> TableOf:
    """The design that a table is; every value must be one that its factor has."""
    if columns is None:
        given = table.rows("coordinates")
        try:
            rows = np.array(given, dtype=float).reshape(len(given), len(factors))
        except (TypeError, ValueError):
            raise InputError(f"{table.at('coordinates')}: expected rows of {len(factors)} numbers") from None
        for i, factor in enumerate(factors):
            if not np.all((rows[:, i] >= factor.low) & (rows[:, i] <= factor.high)):
                raise InputError(f"{table.at('coordinates')}: {factor.name} is out of its bounds")
        return TableOf(rows)
    lists = [_coordinates(table, factor, columns[factor.name]) for factor in factors]
    if not lists or not lists[0]:
        raise InputError(f"{table.path}: the table has no rows")
    return TableOf(np.array(lists, dtype=float).T.copy())


def _coordinates(table: Keyed, factor: Factor, column: Sequence[Any]) -> list[float]:
    found = []
    for i, value in enumerate(column):
        if factor.values is not None:
            if value not in factor.values:
                raise InputError(f"{table.path}: row {i}: {factor.name} has no value {value!r}")
            found.append(float(factor.values.index(value)))
            continue
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise InputError(f"{table.path}: row {i}: {factor.name}: expected a number, got {kind(value)}")
        if not factor.low <= value <= factor.high or (factor.whole and value % 1):
            sort = "a whole number" if factor.whole else "a number"
            raise InputError(
                f"{table.path}: row {i}: {factor.name}: expected {sort} from {factor.low:g} to "
                f"{factor.high:g}, "
                f"got {value!r}"
            )
        found.append(float(value))
    return found


def _of_file(table: Keyed, names: Sequence[str], path: Path) -> Columns:
    """The columns of a file; what else it has is left alone."""
    place = table.at("file")
    if path.suffix == ".parquet":
        read = extra("pyarrow.parquet", "study").read_table(str(path)).to_pydict()
    elif path.suffix == ".csv":
        with path.open(newline="", encoding="utf-8") as file:
            lines = list(csv.DictReader(file))
        read = {name: [_value(line[name]) for line in lines] for name in (lines[0] if lines else ())}
    else:
        raise InputError(f"{place}: expected a file that ends in .csv or .parquet, got {path.name!r}")
    for name in names:
        if name not in read:
            raise InputError(
                f"{place}: {path.name} has no column {name!r}; there are {', '.join(map(str, read))}"
            )
    return {name: list(read[name]) for name in names}


def _value(text: str | None) -> Any:
    """A cell of CSV: a number, true or false, or text."""
    cell = (text or "").strip()
    if cell.lower() in ("true", "false"):
        return cell.lower() == "true"
    for number in (int, float):
        try:
            return number(cell)
        except ValueError:
            continue
    return cell
