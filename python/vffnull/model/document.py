"""Scenario documents: nested dictionaries, lists, strings, booleans and numbers, as TOML knows them.

This module moves values in and out of such documents. The core validates the values.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Protocol, runtime_checkable

from vffnull._support.errors import InputError, InputTypeError, ScenarioError

Document = dict[str, Any]


@runtime_checkable
class HasDocument(Protocol):
    """Anything that can be written into a scenario document."""

    def to_dict(self) -> Document:
        """The object as a part of a scenario document."""
        ...


@runtime_checkable
class _FromNumPy(Protocol):
    """Arrays and scalars of NumPy, which need not be imported to know them."""

    def tolist(self) -> object: ...


def plain(value: object, path: str = "") -> Any:
    """Turn a value into a part of a document, as a deep copy; None among a dictionary's values is left out.

    Parameters
    ----------
    value : object
        Mappings, sequences, NumPy arrays and scalars, and objects with a ``to_dict`` method, in any nesting.
    path : str
        Dotted path of the value, for the error message.

    Raises
    ------
    InputTypeError
        If something inside has no counterpart in a document, or if the nesting has no end.
    """
    try:
        return _plain(value, path)
    except RecursionError:
        where = f"{path}: " if path else ""
        raise InputTypeError(f"{where}nested too deeply for a scenario, or inside itself") from None


def _plain(value: object, path: str) -> Any:
    # Most of a large document is numbers, dictionaries and lists; to ask for a protocol takes long.
    kind = type(value)
    if kind is float or kind is int or kind is bool:
        return value
    if kind is dict:
        return _mapping(value, path)  # type: ignore[arg-type]
    if kind is list or kind is tuple:
        return _sequence(value, path)  # type: ignore[arg-type]
    if isinstance(value, str):
        return _text(value, path)
    if isinstance(value, bool | int | float):
        return value
    if isinstance(value, _FromNumPy):
        return _plain(value.tolist(), path)
    if isinstance(value, HasDocument):
        return _plain(value.to_dict(), path)
    if isinstance(value, Mapping):
        return _mapping(value, path)
    are_numbers = not isinstance(value, bytes | bytearray)  # though one by one they are
    if isinstance(value, Iterable) and are_numbers:
        return _sequence(value, path)
    where = f"{path}: " if path else ""
    raise InputTypeError(f"{where}a {type(value).__name__} cannot be written into a scenario")


def _mapping(value: Mapping[Any, object], path: str) -> Document:
    begin = f"{path}." if path else ""
    return {
        _text(str(key), path): _plain(inner, f"{begin}{key}")
        for key, inner in value.items()
        if inner is not None
    }


def _sequence(value: Iterable[object], path: str) -> list[Any]:
    begin = f"{path}." if path else ""
    return [inner if type(inner) is float else _plain(inner, f"{begin}{i}") for i, inner in enumerate(value)]


def _text(value: str, path: str) -> str:
    """Text as a plain string; half of a surrogate pair stands for no character and cannot be written."""
    text = str(value)
    if not text.isascii():
        try:
            text.encode("utf-8")
        except UnicodeEncodeError:
            raise InputError(f"{path}: {_short(text)} is not text: it has a lone surrogate") from None
    return text


def _short(text: str) -> str:
    return ascii(text if len(text) <= 60 else f"{text[:60]}…")


class Table(Mapping[str, Any]):
    """A dictionary that nobody can change, so that it can be hashed; it looks like the original."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Any]) -> None:
        self._items = {key: frozen(value) for key, value in items.items()}

    def __getitem__(self, key: str) -> Any:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __hash__(self) -> int:
        return hash(frozenset(self._items.items()))

    def __repr__(self) -> str:
        return repr(self._items)


def frozen(value: object) -> Any:
    """Arrays and lists as nested tuples, dictionaries as tables: comparable, hashable, readable."""
    if type(value) in (float, int, str, bool):  # most are, and to ask for methods takes its time
        return value
    if not isinstance(value, list | tuple) and isinstance(value, _FromNumPy):
        return frozen(value.tolist())
    if isinstance(value, list | tuple):
        return tuple(frozen(inner) for inner in value)
    if isinstance(value, dict):
        return Table(value)
    return value


def get(document: Document, name: str) -> Any:
    """The value under a dotted name; numbers count list elements, as in ``obstacles.0.position``."""
    if not isinstance(name, str):
        raise InputTypeError(f"{name!r}: a key is a dotted name, not a {type(name).__name__}")
    place: Any = document
    for key in _parts(_text(name, "key")):
        try:
            place = place[int(key) if isinstance(place, list) else key]
        except (KeyError, IndexError, ValueError, TypeError):
            raise ScenarioError(f"{name}: not set in this scenario", name) from None
    return place


def put(document: Document, name: str, value: object) -> None:
    """Set the value under a dotted name in place, creating missing tables; None removes the key.

    Raises
    ------
    ScenarioError
        If the name leads through a number or a string, or names an element that a list does not have.
    """
    if not isinstance(name, str):
        raise InputTypeError(f"{name!r}: a key is a dotted name, not a {type(name).__name__}")
    *parents, last = _parts(_text(name, "key"))
    place: Any = document
    for depth, key in enumerate(parents, start=1):
        following = [*parents, last][depth]
        if isinstance(place, list):
            place = place[_index(place, key, name)]
        elif key not in place and following.isdecimal():
            raise ScenarioError(
                f"{name}: there is no list {'.'.join(parents[:depth])} in this scenario", name
            )
        else:
            place = place.setdefault(key, {})
        if not isinstance(place, dict | list):
            raise ScenarioError(f"{name}: {'.'.join(parents[:depth])} is a plain value, not a table", name)
    if isinstance(place, list):
        at = _index(place, last, name)
        if value is None:
            del place[at]
        else:
            place[at] = plain(value, name)
    elif value is None:
        place.pop(last, None)
    else:
        place[last] = plain(value, name)


def dotted(name: str) -> str:
    """The name with dots alone; an index may also stand in brackets, as in ``obstacles[0].position``."""
    return re.sub(r"\[(\d+)\]", r".\1", name)


def _parts(name: str) -> list[str]:
    """The keys of a dotted name."""
    return dotted(name).split(".")


def _index(place: list[Any], key: str, name: str) -> int:
    if key.isdecimal() and int(key) < len(place):
        return int(key)
    there = {0: "the list is empty", 1: "there is one, number 0"}
    count = there.get(len(place), f"there are {len(place)}, 0 to {len(place) - 1}")
    raise ScenarioError(f"{name}: no list element {_short(key)}; {count}", name)
