"""Designs: which values of the factors a study takes, as rows of coordinates.

Every design gives the rows of any stretch of its points without keeping those before it, so that a study of
any length needs little memory; the Latin hypercube alone needs all of its points at once.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.studies._keyed import Keyed
from vffnull.studies.factors import Factor

__all__ = ["DESIGNS", "MOST", "Counted", "Design", "Saltelli", "TableOf", "read_design"]

Array = NDArray[np.float64]

DESIGNS = ("grid", "latin-hypercube", "sobol", "saltelli", "random", "table")
"""All combinations, space-filling, quasi-random, for Sobol indices, random, and given rows."""

MOST = 2**40
_MAX_AT_ONCE = 20_000_000  # numbers that a Latin hypercube holds in memory
_MAX_SOBOL = 2**30  # points that SciPy's sequence has
_STRETCH = 1024  # points of a random design with one stream of random numbers
_STREAM = 0  # of the seeds that belong to designs; those of runs are elsewhere


class Design(Protocol):
    """The points of a study."""

    count: int
    """How many there are."""

    def rows(self, first: int, last: int) -> Array:
        """The coordinates (last - first, factors) of the points from `first` up to, not including, `last`."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """The design as it stands in the study's document."""
        ...


@dataclass
class Counted:
    """The number of points alone, where the points themselves are not needed."""

    count: int

    def rows(self, first: int, last: int) -> Array:
        """Nothing: they are elsewhere."""
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """Nothing: the document is elsewhere."""
        raise NotImplementedError


class _Grid:
    """All combinations; the last factor changes fastest."""

    def __init__(self, factors: Sequence[Factor], levels: int) -> None:
        self._levels = levels
        self._axes = [factor.grid(levels) for factor in factors]
        self.count = math.prod(len(axis) for axis in self._axes)

    def rows(self, first: int, last: int) -> Array:
        at = np.arange(first, last)
        columns = []
        for axis in reversed(self._axes):
            at, place = np.divmod(at, len(axis))
            columns.append(axis[place])
        return np.stack(columns[::-1], axis=1) if columns else np.empty((last - first, 0))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": "grid", "levels": self._levels}


class _Shares:
    """What designs of points in the unit cube have in common."""

    kind: str

    def __init__(self, factors: Sequence[Factor], count: int, seed: int) -> None:
        self._factors, self.count, self._seed = factors, count, seed

    def rows(self, first: int, last: int) -> Array:
        shares = self._shares(first, last)
        columns = [factor.coordinates(shares[:, i]) for i, factor in enumerate(self._factors)]
        return np.stack(columns, axis=1) if columns else np.empty((last - first, 0))

    def to_dict(self) -> dict[str, Any]:
        return {"kind": self.kind, "count": self.count}

    def _random(self, *stream: int) -> np.random.Generator:
        return np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=(_STREAM, *stream)))

    def _shares(self, first: int, last: int) -> Array:
        raise NotImplementedError


class _Random(_Shares):
    """Independent points."""

    kind = "random"

    def _shares(self, first: int, last: int) -> Array:
        stretches = range(first // _STRETCH, -(-last // _STRETCH))
        width = len(self._factors)
        parts = [self._random(each).random((_STRETCH, width)) for each in stretches]
        begin = first - stretches.start * _STRETCH if parts else 0
        return np.concatenate([*parts, np.empty((0, width))])[begin : begin + last - first]


class _LatinHypercube(_Shares):
    """As many layers along every factor as there are points, with one point in each."""

    kind = "latin-hypercube"
    _all: Array | None = None

    def _shares(self, first: int, last: int) -> Array:
        if self._all is None:
            qmc = extra("scipy.stats", "study").qmc
            cube: Array = qmc.LatinHypercube(len(self._factors), rng=self._random()).random(self.count)
            self._all = cube
        return self._all[first:last]


class _Sequence:
    """A scrambled Sobol sequence, read from any place; the next stretch needs no return to the start."""

    def __init__(self, dimension: int, random: np.random.Generator) -> None:
        self._engine = extra("scipy.stats", "study").qmc.Sobol(dimension, rng=random)
        self._at = 0
        self._latest = np.empty((0, dimension))

    def read(self, first: int, last: int) -> Array:
        """The points from `first` up to but not including `last`; stretches may share a point."""
        if first == self._at - 1 and last > first and len(self._latest):
            return np.concatenate([self._latest, self.read(first + 1, last)])
        if first < self._at:
            self._engine.reset()
            self._at = 0
        if first > self._at:
            self._engine.fast_forward(first - self._at)
        with warnings.catch_warnings():  # the number of points is judged where the document is read
            warnings.simplefilter("ignore", UserWarning)
            found: Array = self._engine.random(last - first) if last > first else self._latest[:0]
        if len(found):
            self._at, self._latest = last, found[-1:]
        return found


class _Sobol(_Shares):
    """A scrambled Sobol sequence."""

    kind = "sobol"
    _sequence: _Sequence | None = None

    def _shares(self, first: int, last: int) -> Array:
        if self._sequence is None:
            self._sequence = _Sequence(len(self._factors), self._random())
        return self._sequence.read(first, last)


class Saltelli(_Shares):
    """Two samples A and B, and A with one column after the other from B, for Sobol indices.

    The points of a base sample stand together: A, then A with column 0, 1, … from B, then B.
    """

    kind = "saltelli"
    _sequence: _Sequence | None = None

    def __init__(self, factors: Sequence[Factor], base: int, seed: int) -> None:
        self.base = base
        super().__init__(factors, base * (len(factors) + 2), seed)

    def to_dict(self) -> dict[str, Any]:
        """The design with the number of its base samples."""
        return {"kind": self.kind, "count": self.base}

    def _shares(self, first: int, last: int) -> Array:
        k = len(self._factors)
        if self._sequence is None:
            self._sequence = _Sequence(2 * k, self._random())
        begin, end = first // (k + 2), -(-last // (k + 2))
        both = self._sequence.read(begin, end) if end > begin else np.empty((0, 2 * k))
        a, b = both[:, :k], both[:, k:]
        points = np.repeat(a[:, None, :], k + 2, axis=1)
        for i in range(k):
            points[:, 1 + i, i] = b[:, i]
        points[:, k + 1] = b
        flat = points.reshape(-1, k)
        return flat[first - begin * (k + 2) :][: last - first]


class TableOf:
    """Rows that are given."""

    def __init__(self, rows: Array) -> None:
        self._rows = rows
        self.count = len(rows)

    def rows(self, first: int, last: int) -> Array:
        """A stretch of the rows."""
        return self._rows[first:last]

    def to_dict(self) -> dict[str, Any]:
        """The design with all of its rows."""
        return {"kind": "table", "coordinates": self._rows.tolist()}


def read_design(table: Keyed, factors: Sequence[Factor], seed: int) -> Design:
    """The design of a document; one of a table is made where its file is read.

    Raises
    ------
    vffnull.errors.InputError, vffnull.errors.InputTypeError
        If something is wrong; the message begins with the key.
    ImportError
        Without the extra, where the design is SciPy's.
    """
    kind = table.choice("kind", DESIGNS, "grid")
    if "levels" in table and kind != "grid":
        raise InputError(f"{table.at('levels')}: is of a grid, not of {kind!r}")
    if "count" in table and kind == "grid":
        raise InputError(
            f"{table.at('count')}: a grid has all combinations; `levels` says how many of a range"
        )
    if kind == "grid":
        return _within(table, _Grid(factors, table.whole("levels", 5, 1, 1_000_000)))
    if not factors:
        raise InputError(f"{table.at('kind')}: {kind!r} needs [[factors]]")
    count = table.whole("count", None, 1, MOST)
    if kind == "random":
        return _Random(factors, count, seed)
    extra("scipy", "study")
    if kind == "latin-hypercube":
        if count * len(factors) > _MAX_AT_ONCE:
            raise InputError(
                f"{table.at('count')}: a Latin hypercube is made at once, of {_MAX_AT_ONCE} numbers, "
                f"here {_MAX_AT_ONCE // len(factors)} points; 'sobol' and 'random' have no such bound"
            )
        return _LatinHypercube(factors, count, seed)
    if count > _MAX_SOBOL:
        raise InputError(
            f"{table.at('count')}: a Sobol sequence has {_MAX_SOBOL} points at most, got {count}"
        )
    return _Sobol(factors, count, seed) if kind == "sobol" else Saltelli(factors, count, seed)


def _within(table: Keyed, grid: _Grid) -> _Grid:
    if grid.count > MOST:
        raise InputError(f"{table.at('levels')}: a grid of {grid.count:.3g} points is too large")
    return grid
