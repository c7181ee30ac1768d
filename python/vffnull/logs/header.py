"""What belongs to a result beside its arrays, as one JSON text that every kind of file carries.

A file is other people's input. `unpack` validates the whole header, the shapes of the arrays included, before
a reader makes anything of the data; `restore` compares the arrays with it, and both with the digest. Files of
older versions have none, and are read without.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError, VffNullError
from vffnull._support.files import digest
from vffnull.model.outcome import Metrics, Outcome, Replan, Status
from vffnull.model.record import QUANTITIES, Layout, recorded
from vffnull.model.scenario import Scenario

__all__ = ["Arrays", "Header", "foreign", "pack", "restore", "split", "unpack"]

Arrays = dict[str, NDArray[Any]]
Shape = tuple[int, ...]
Kind = TypeVar("Kind", bound=Outcome)

_FORMAT = 3
_DTYPE = np.dtype(np.float64)  # of everything that is recorded


@dataclasses.dataclass(frozen=True)
class Header:
    """A valid header."""

    version: str
    """The version that wrote it."""
    values: dict[str, Any]
    """Everything in a result that is not an array, as the result holds it."""
    instants: int
    """The number of recorded instants."""
    shapes: dict[str, Shape]
    """The shape of every array at one instant."""
    text: str = ""
    """All of it as text, without the digest."""
    digest: str | None = None
    """The digest of text and arrays; files of older versions have none."""


def pack(result: Outcome, signed: bool = False) -> str:
    """The header of a result, with the type and the shape at one instant of every array.

    It also has the unit of every column, for kinds of files that have no place of their own for it, and, if
    it is signed, the digest of everything.
    """
    values = {name: getattr(result, name) for name in _beside(type(result))}
    values |= {"scenario": result.scenario.to_dict(), "metrics": dict(result.metrics)}
    values |= {"replans": [dataclasses.asdict(search) for search in result.replans]}
    arrays = {name: [array.dtype.str, array.shape[1:]] for name, array in recorded(result).items()}
    units = {"t": "s"} | {column.name: column.unit for column, _ in result.layout.lines(result)}
    about = {"instants": len(result.t), "arrays": arrays, "units": units}
    found = {"format": _FORMAT, **values, **about}
    if signed:
        there = {"t": result.t, **recorded(result)}
        found["digest"] = digest(_text(found), [there[name] for name in ("t", *arrays)])
    return _text(found)


def unpack(text: str | bytes, source: Path) -> Header:
    """Read and validate a header.

    Raises
    ------
    vffnull.errors.InputError
        If it is none, of a format that this version does not read, or not what `pack` writes.
    """
    try:
        found = json.loads(text)
        written, version = int(found["format"]), str(found["version"])
        signature, text = found.pop("digest", None), _text(found)
    except (KeyError, ValueError, TypeError, RecursionError, OverflowError):
        raise foreign(source) from None
    if written != _FORMAT:
        raise InputError(
            f"{source}: written by vffnull {version[:40]} in format {written}; "
            f"this version reads format {_FORMAT}"
        )
    entries = _Entries(source, found)
    scenario = entries.scenario()
    values: dict[str, Any] = {
        "scenario": scenario,
        "status": entries.status(),
        "message": entries.text("message"),
        "end_time": entries.number("end_time"),
        "wall_time": entries.number("wall_time"),
        "warnings": entries.texts("warnings"),
        "metrics": entries.metrics(Layout.of(scenario._document)),
        "version": version,
    }
    if "plant" in found:
        values["plant"] = entries.text("plant")
    if "replans" in found:
        values["replans"] = entries.replans()
    return Header(version, values, entries.instants(), entries.shapes(scenario), text, signature)


def restore(kind: type[Kind], header: Header, arrays: Arrays, source: Path) -> Kind:
    """Put a result together; what a file does not have is left at its default.

    Raises
    ------
    vffnull.errors.InputError
        If the arrays are not those of the header, or not those of a result.
    """
    fields = {field.name: field for field in dataclasses.fields(kind)}
    known = [name for name in QUANTITIES if name in fields]
    needed = {"t", *(name for name in known if fields[name].default is dataclasses.MISSING)}
    if missing := sorted(needed - set(arrays)):
        raise InputError(f"{source}: not a whole result, {', '.join(missing)} is missing")
    if strange := sorted(set(arrays) - {"t", *known}):
        raise InputError(f"{source}: there is no quantity {strange[0][:40]!r} in a result")
    if set(arrays) != {"t", *header.shapes}:
        raise InputError(f"{source}: its header does not list the arrays that it has")
    for name, array in arrays.items():
        expected = (header.instants, *header.shapes.get(name, ()))
        if array.dtype != _DTYPE or array.shape != expected:
            raise InputError(
                f"{source}: {name}: expected {_DTYPE} of shape {expected}, "
                f"got {array.dtype} of shape {array.shape}"
            )
    if header.digest not in (None, digest(header.text, [arrays[name] for name in ("t", *header.shapes)])):
        raise InputError(f"{source}: damaged: its digest is not that of what it holds")
    t = arrays["t"]
    if not (np.isfinite(t).all() and (np.diff(t) > 0.0).all()):
        raise InputError(f"{source}: t: times must be finite and increase")
    values = {name: value for name, value in header.values.items() if name in fields}
    return kind(**values, **arrays)  # type: ignore[arg-type]


def split(header: Header, columns: Mapping[str, NDArray[Any]], source: Path) -> Arrays:
    """The arrays of a result out of the columns of its table.

    Raises
    ------
    vffnull.errors.InputError
        If there are not the columns, of as many numbers, that the header names.
    """
    wanted = 1 + sum(map(math.prod, header.shapes.values()))
    if wanted != len(columns):
        raise InputError(f"{source}: expected {wanted} columns by its header, got {len(columns)}")
    arrays = {"t": _column("t", columns, header, source)}
    layout = Layout.of(header.values["scenario"].to_dict())
    for name, shape in header.shapes.items():
        labels = [column.name for column in layout.columns(name, shape)]
        values = np.empty((header.instants, len(labels)), dtype=_DTYPE)
        for i, column in enumerate(labels):
            values[:, i] = _column(column, columns, header, source)
        arrays[name] = values.reshape(len(values), *shape)
    return arrays


def foreign(source: Path) -> InputError:
    """The error for a file that is something else."""
    return InputError(f"{source}: not a result that vffnull has saved")


def _column(name: str, columns: Mapping[str, NDArray[Any]], header: Header, source: Path) -> NDArray[Any]:
    if name not in columns:
        raise InputError(f"{source}: its column {name} is missing")
    values = columns[name]
    if values.dtype != _DTYPE or values.shape != (header.instants,):
        raise InputError(
            f"{source}: {name}: expected {header.instants} numbers, "
            f"got {values.dtype} of shape {values.shape}"
        )
    return np.ascontiguousarray(values)


@dataclasses.dataclass(frozen=True)
class _Entries:
    """The entries of a header, each validated when it is read."""

    source: Path
    found: Any

    def text(self, name: str) -> str:
        value = self._get(name)
        return value if isinstance(value, str) else self._fault(name, "expected text")

    def texts(self, name: str) -> tuple[str, ...]:
        values = self._get(name)
        if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
            self._fault(name, "expected a list of texts")
        return tuple(values)

    def number(self, name: str) -> float:
        return self._float(name, self._get(name))

    def status(self) -> Status:
        value = self._get("status")
        try:
            return Status(value)
        except ValueError:
            self._fault("status", f"expected one of {', '.join(Status)}")

    def metrics(self, layout: Layout) -> Metrics:
        values = self._get("metrics")
        if not isinstance(values, dict):
            self._fault("metrics", "expected a table")
        for name, value in values.items():
            if value is not None:
                self._float(f"metrics.{name[:40]}", value)
        return Metrics(values, layout)

    def replans(self) -> tuple[Replan, ...]:
        searches = self._get("replans")
        names = [field.name for field in dataclasses.fields(Replan)]
        if not isinstance(searches, list) or not all(
            isinstance(search, dict) and sorted(search) == sorted(names) for search in searches
        ):
            self._fault("replans", f"expected a list of tables with {', '.join(names)}")
        for i, search in enumerate(searches):
            here = f"replans[{i}]"
            self._float(f"{here}.asked", search["asked"])
            if search["taken"] is not None:
                self._float(f"{here}.taken", search["taken"])
            if not isinstance(search["reason"], str):
                self._fault(f"{here}.reason", "expected text")
            if not isinstance(search["status"], str | None):
                self._fault(f"{here}.status", "expected text")
        return tuple(Replan(**search) for search in searches)

    def scenario(self) -> Scenario:
        document = self._get("scenario")
        if not isinstance(document, dict):
            self._fault("scenario", "expected a table")
        arm = document.get("arm")
        if isinstance(arm, dict) and not arm.keys().isdisjoint(
            ("urdf", "mjcf")
        ):  # no file of somebody else's choice is opened
            self._fault("scenario", "its arm is in another file")
        try:
            return Scenario.from_dict(document)
        except VffNullError as error:
            self._fault("scenario", f"cannot be run by this version: {str(error)[:300]}")

    def instants(self) -> int:
        value = self._get("instants")
        if isinstance(value, bool) or not isinstance(value, int) or not 0 <= value < 2**48:
            self._fault("instants", "expected a whole number")
        return int(value)

    def shapes(self, scenario: Scenario) -> dict[str, Shape]:
        """The shapes that the header claims, once they are those of this scenario's record."""
        listed = self._get("arrays")
        if not isinstance(listed, dict):
            self._fault("arrays", "expected a table")
        document = scenario.to_dict()
        layout = Layout.of(document)
        sizes = layout.sizes(document)
        shapes: dict[str, Shape] = {}
        for name, entry in listed.items():
            if name not in QUANTITIES:
                self._fault("arrays", f"there is no quantity {name[:40]!r}")
            dtype, shape = entry if isinstance(entry, list) and len(entry) == 2 else (None, None)
            if dtype != _DTYPE.str or not isinstance(shape, list):
                self._fault(f"arrays.{name}", f"expected {_DTYPE.str} and a shape")
            over = layout.quantities[name].over
            fits = len(shape) == len(over) and all(
                type(size) is int and 0 <= size < 2**31 and size == sizes.get(dimension, size)
                for size, dimension in zip(shape, over, strict=True)
            )
            if not fits:
                expected = ", ".join(str(sizes.get(dimension, dimension)) for dimension in over)
                self._fault(f"arrays.{name}", f"expected shape ({expected}) at an instant")
            shapes[name] = tuple(shape)
        return shapes

    def _get(self, name: str) -> Any:
        try:
            return self.found[name]
        except (KeyError, TypeError, IndexError):
            self._fault(name, "is missing")

    def _float(self, name: str, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            self._fault(name, "expected a number")
        try:
            return float(value)
        except OverflowError:
            self._fault(name, "expected a number of 64 bits")

    def _fault(self, name: str, what: str) -> NoReturn:
        raise InputError(f"{self.source}: not a header of a result: {name}: {what}") from None


def _text(found: Mapping[str, Any]) -> str:
    return json.dumps(found, ensure_ascii=False)


def _beside(kind: type[Outcome]) -> list[str]:
    """Names of everything in a result that is not an array."""
    names = [field.name for field in dataclasses.fields(kind)]
    return [name for name in names if name != "t" and name not in QUANTITIES]
