"""CSV for spreadsheets and eyes. Numbers have as many digits as they need, so that none is rounded.

Two lines that start with # come first: the header, and the units of the columns.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vffnull._support.errors import InputError
from vffnull.logs import header

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

_MARK = "# vffnull "


def write(result: Outcome, path: Path) -> None:
    """Write a result as text."""
    found = list(result.layout.lines(result))
    rows = np.column_stack([result.t, *(line for _, line in found)])
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{_MARK}{header.pack(result, signed=True)}\n")
        file.write(",".join(["# unit: s", *(column.unit for column, _ in found)]) + "\n")
        file.write(",".join(["t", *(column.name for column, _ in found)]) + "\n")
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows.tolist())


def read(path: Path) -> tuple[header.Header, header.Arrays]:
    """The header and the arrays of a file."""
    with path.open(encoding="utf-8", newline="\n") as file:
        if file.read(len(_MARK)) != _MARK:  # before a line is read, which may have no end in a foreign file
            raise header.foreign(path)
        found = header.unpack(file.readline(), path)
        file.readline()
        names = file.readline().rstrip("\n").split(",")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # NumPy's, of a file without rows
            rows = np.loadtxt(file, delimiter=",", comments=None, ndmin=2)
    if len(rows) != found.instants:
        raise InputError(f"{path}: cut off after {len(rows)} of {found.instants} rows")
    if len(names) != rows.shape[1] and len(rows):
        raise InputError(f"{path}: {len(names)} names over {rows.shape[1]} columns")
    columns = dict(zip(names, rows.T if len(rows) else np.empty((len(names), 0)), strict=True))
    return found, header.split(found, columns, path)
