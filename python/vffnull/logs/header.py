"""What belongs to a result beside its arrays, as one JSON text that every kind of file carries."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull._record import QUANTITIES, recorded
from vffnull.errors import InputError

if TYPE_CHECKING:
    from vffnull.result import Result

Header = dict[str, Any]
Arrays = dict[str, NDArray[Any]]

_FORMAT = 2


def pack(result: Result) -> str:
    """The header of a result, with the type and the shape at one instant of every array."""
    values = {name: getattr(result, name) for name in _beside(type(result))}
    values |= {"scenario": result.scenario.to_dict(), "metrics": dict(result.metrics)}
    arrays = {name: [array.dtype.str, array.shape[1:]] for name, array in recorded(result).items()}
    return json.dumps(
        {"format": _FORMAT, **values, "instants": len(result.t), "arrays": arrays}, ensure_ascii=False
    )


def unpack(text: str | bytes, source: Path) -> Header:
    """Read a header.

    Raises
    ------
    vffnull.errors.InputError
        If it is none, or of a format that this version does not read.
    """
    try:
        header = json.loads(text)
        written, by = int(header["format"]), str(header["version"])
    except (KeyError, ValueError, TypeError, RecursionError):
        raise foreign(source) from None
    if written != _FORMAT:
        raise InputError(
            f"{source}: written by vffnull {by} in format {written}; this version reads format {_FORMAT}"
        )
    assert isinstance(header, dict)
    return header


def restore(kind: type[Result], header: Header, arrays: Arrays, source: Path) -> Result:
    """Put a result together again; what a file does not have is left at its default."""
    from vffnull.result import Metrics, Status
    from vffnull.scenario import Scenario

    made: dict[str, Callable[[Any], Any]] = {
        "scenario": Scenario._of,
        "status": Status,
        "metrics": Metrics,
        "warnings": tuple,
    }
    try:
        values = {
            name: made[name](header[name]) if name in made else header[name]
            for name in _beside(kind)
            if name in header
        }
        absent = dict.fromkeys(_optional(kind) - set(arrays))
        return kind(**values, **arrays, **absent)  # type: ignore[arg-type]
    except (KeyError, ValueError, TypeError):
        by = header.get("version")
        raise InputError(f"{source}: its header is not the one that vffnull {by} writes") from None


def split(header: Header, columns: Mapping[str, NDArray[Any]], source: Path) -> Arrays:
    """The arrays of a result out of the columns of its table."""
    from vffnull import _record

    try:
        arrays = {"t": np.ascontiguousarray(columns["t"])}
        for name, (dtype, shape) in header["arrays"].items():
            labels = [column.name for column in _record.columns(name, tuple(shape))]
            values = np.empty((len(arrays["t"]), len(labels)), dtype=dtype)
            for i, column in enumerate(labels):
                values[:, i] = columns[column]
            arrays[name] = values.reshape(len(values), *shape)
    except (KeyError, ValueError, TypeError):
        raise foreign(source) from None
    return arrays


def foreign(source: Path) -> InputError:
    """The error for a file that is something else."""
    return InputError(f"{source}: not a result that vffnull has saved")


def _beside(kind: type[Result]) -> list[str]:
    """Names of everything in a result that is not an array."""
    names = [field.name for field in dataclasses.fields(kind)]
    return [name for name in names if name != "t" and name not in QUANTITIES]


def _optional(kind: type[Result]) -> set[str]:
    """Names of the quantities that may be None."""
    typed = {field.name: str(field.type) for field in dataclasses.fields(kind)}
    return {name for name in QUANTITIES if "None" in typed.get(name, "")}
