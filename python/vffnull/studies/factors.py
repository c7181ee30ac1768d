"""Factors: what a study varies, each a range, a list of values, or named choices of several keys."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError, InputTypeError
from vffnull.model.document import plain
from vffnull.studies._keyed import Keyed, finite, kind

__all__ = ["Factor", "read_factor"]

_KEYS = ("key", "keys", "name", "unit", "range", "scale", "whole", "levels", "values", "choices")
_MAX_LEVELS = 1_000_000

Kind = Literal["float", "int", "bool", "text", "json"]


@dataclass(frozen=True)
class Factor:
    """Something that a study varies.

    A *coordinate* is a number that stands for a value: the value itself on a range, the place in the list
    otherwise. Designs are made of coordinates, so that they are arrays whatever the values are.

    Attributes
    ----------
    name : str
        What its column is called.
    keys : tuple of str
        Dotted keys of the scenario that take its value; none for choices.
    unit : str
        Of its values; empty if none is stated.
    low, high : float
        Ends of a range; places of the first and of the last value of a list.
    log : bool
        Whether a range is sampled evenly in the logarithm.
    whole : bool
        Whether values of a range are whole numbers; both ends occur then.
    levels : int or None
        How many values of a range a grid takes; None for the grid's own number.
    values : tuple or None
        The values of a list, or the names of the choices.
    changes : tuple of dict or None
        What each choice changes: values by dotted keys.
    """

    name: str
    keys: tuple[str, ...]
    unit: str = ""
    low: float = 0.0
    high: float = 0.0
    log: bool = False
    whole: bool = False
    levels: int | None = None
    values: tuple[Any, ...] | None = None
    changes: tuple[dict[str, Any], ...] | None = None

    @property
    def touched(self) -> tuple[str, ...]:
        """Every dotted key that it changes."""
        if self.changes is None:
            return self.keys
        return tuple(dict.fromkeys(key for change in self.changes for key in change))

    @property
    def kind(self) -> Kind:
        """What its column holds."""
        if self.values is None:
            return "int" if self.whole else "float"
        kinds = {type(value) for value in self.values}
        if kinds == {bool}:
            return "bool"
        if kinds == {int}:
            return "int"
        if kinds <= {int, float}:
            return "float"
        return "text" if kinds == {str} else "json"

    def coordinates(self, shares: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates at shares of the factor, from 0 up to but not including 1.

        Parameters
        ----------
        shares : (k,) ndarray
            Evenly distributed numbers.
        """
        if self.values is not None:
            return np.minimum(np.floor(shares * len(self.values)), len(self.values) - 1)
        if self.whole and self.log:
            spread = _geometric(self.low, self.high + 1, shares)
            return np.clip(np.floor(spread), self.low, self.high)
        if self.whole:
            return np.minimum(self.low + np.floor(shares * (self.high - self.low + 1)), self.high)
        if self.log:
            return np.clip(_geometric(self.low, self.high, shares), self.low, self.high)
        return self.low + shares * (self.high - self.low)

    def grid(self, levels: int) -> NDArray[np.float64]:
        """The coordinates of a grid, both ends included: all values of a list, some of a range."""
        if self.values is not None:
            return np.arange(len(self.values), dtype=float)
        count = self.levels or levels
        if self.log and count > 1:
            low, high = math.log10(self.low), math.log10(self.high)
            between = [10.0**each for each in np.linspace(low, high, count)[1:-1].tolist()]
            found = np.array([self.low, *between, self.high])
        else:
            found = np.linspace(self.low, self.high, count)
        return np.unique(np.round(found)) if self.whole else found

    def value(self, coordinate: float) -> Any:
        """The value that a coordinate stands for."""
        if self.values is not None:
            return self.values[int(coordinate)]
        return int(coordinate) if self.whole else float(coordinate)

    def overrides(self, coordinate: float) -> dict[str, Any]:
        """What a coordinate changes of a scenario, by dotted keys."""
        if self.changes is not None:
            return self.changes[int(coordinate)]
        return dict.fromkeys(self.keys, self.value(coordinate))

    def column(self, coordinates: NDArray[np.float64]) -> list[Any]:
        """The values of its column; what no column can hold is written as JSON."""
        found = [self.value(each) for each in coordinates.tolist()]
        return [json.dumps(each) for each in found] if self.kind == "json" else found

    def to_dict(self) -> dict[str, Any]:
        """The factor as it stands in the study's document."""
        found: dict[str, Any] = {"name": self.name}
        if self.unit:
            found["unit"] = self.unit
        if self.changes is not None:
            return found | {"choices": dict(zip(self.values or (), self.changes, strict=True))}
        found["keys"] = list(self.keys)
        if self.values is not None:
            return found | {"values": list(self.values)}
        found |= {
            "range": [self.low, self.high],
            "scale": "log" if self.log else "linear",
            "whole": self.whole,
        }
        return found if self.levels is None else found | {"levels": self.levels}


def _geometric(low: float, high: float, shares: NDArray[np.float64]) -> NDArray[np.float64]:
    """What is at shares of a range, evenly in the logarithm.

    By the C library: the last bits of `np.exp` depend on the processor.
    """
    at = math.log(low) + shares * (math.log(high) - math.log(low))
    return np.asarray(np.frompyfunc(math.exp, 1, 1)(at), dtype=float)


def read_factor(content: object, path: str) -> Factor:
    """A factor of a document.

    Raises
    ------
    vffnull.errors.InputError, vffnull.errors.InputTypeError
        If something is wrong; the message begins with the key.
    """
    table = Keyed(content, path, _KEYS)
    spread = table.one_of("range", "values", "choices")
    for key, of in (("scale", "range"), ("whole", "range"), ("levels", "range")):
        if key in table and spread != of:
            raise InputError(f"{table.at(key)}: is of a `range`, not of `{spread}`")
    if spread == "choices":
        return _chosen(table)
    keys = table.words(table.one_of("key", "keys"))
    if not keys or not all(keys):
        raise InputError(f"{table.at('keys')}: expected dotted keys of the scenario")
    name, unit = table.text("name", keys[0]), table.text("unit")
    if spread == "values":
        values = tuple(
            plain(each, f"{table.at('values')}.{i}") for i, each in enumerate(table.rows("values"))
        )
        if not values:
            raise InputError(f"{table.at('values')}: expected at least one value")
        if any(
            each in values[:i] and type(each) is type(values[values.index(each)])
            for i, each in enumerate(values)
        ):
            raise InputError(f"{table.at('values')}: a value is there twice")
        return Factor(name, keys, unit, 0.0, len(values) - 1.0, values=values)
    low, high, log, integral = _range(table)
    levels = table.whole("levels", None, 1, _MAX_LEVELS) if "levels" in table else None
    return Factor(name, keys, unit, low, high, log, integral, levels)


def _chosen(table: Keyed) -> Factor:
    """A factor whose values are names for changes of several keys."""
    for key in ("key", "keys"):
        if key in table:
            raise InputError(f"{table.at(key)}: the `choices` name their keys themselves")
    given = table.get("choices")
    if not isinstance(given, Mapping) or not given:
        raise InputTypeError(f"{table.at('choices')}: expected a table of names, got {kind(given)}")
    changes = []
    named = {str(name): change for name, change in given.items()}
    if len(named) < len(given):
        raise InputError(f"{table.at('choices')}: two names are the same as text")
    for name, change in sorted(named.items()):  # TOML has no order of its own
        if not isinstance(change, Mapping):
            place = f"{table.at('choices')}.{name}"
            raise InputTypeError(f"{place}: expected a table of dotted keys, got {kind(change)}")
        changes.append(plain(change, f"{table.at('choices')}.{name}"))
    if "name" not in table:
        raise InputError(f"{table.at('name')}: missing; choices need a name for their column")
    names = tuple(sorted(named))
    return Factor(table.text("name"), (), "", 0.0, len(names) - 1.0, values=names, changes=tuple(changes))


def _range(table: Keyed) -> tuple[float, float, bool, bool]:
    """The ends of a range, whether it is logarithmic, and whether its values are whole."""
    ends: Sequence[Any] = table.rows("range")
    place = table.at("range")
    if len(ends) != 2:
        raise InputError(f"{place}: expected two numbers, the lower end first, got {len(ends)}")
    low, high = (finite(f"{place}[{i}]", each) for i, each in enumerate(ends))
    if not low < high:
        raise InputError(f"{place}: expected the lower end first, got {low:g} and {high:g}")
    log = table.choice("scale", ("linear", "log"), "linear") == "log"
    if log and low <= 0:
        raise InputError(f"{place}: a scale of logarithms starts above 0, got {low:g}")
    integral = table.flag("whole")
    if integral and (low % 1 or high % 1 or max(abs(low), abs(high)) > 2**52):
        raise InputError(f"{place}: `whole` needs whole numbers below 2⁵², got {low:g} and {high:g}")
    return low, high, log, integral
