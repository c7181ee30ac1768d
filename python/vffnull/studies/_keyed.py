"""Tables of a study's document, read key by key: every fault names its key and what is allowed."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable, Mapping
from typing import Any

from vffnull._support.arguments import number, whole
from vffnull._support.errors import InputError, InputTypeError

__all__ = ["Keyed"]

_KINDS = {
    bool: "true or false",
    str: "text",
    list: "a list",
    dict: "a table",
    int: "a number",
    float: "a number",
}


class Keyed:
    """A table of a document.

    Parameters
    ----------
    content : object
        What stands in the document.
    path : str
        Where, by its dotted name; empty for the document itself.
    allowed : iterable of str
        The keys that it may have.

    Raises
    ------
    vffnull.errors.InputTypeError
        If it is no table.
    vffnull.errors.InputError
        If it has a key that is not allowed; the message names the nearest one.
    """

    def __init__(self, content: object, path: str, allowed: Iterable[str]) -> None:
        names = tuple(allowed)
        self.path = path
        if not isinstance(content, Mapping):
            raise InputTypeError(f"{path or 'study'}: expected a table, got {kind(content)}")
        self._content = content
        for key in content:
            if key not in names:
                near = difflib.get_close_matches(str(key), names, n=1)
                hint = f", did you mean `{near[0]}`?" if near else ""
                listed = ", ".join(f"`{name}`" for name in names)
                raise InputError(f"{path or 'study'}: unknown key `{key}`{hint} Allowed: {listed}")

    def __contains__(self, key: str) -> bool:
        return key in self._content

    def at(self, key: str) -> str:
        """The dotted name of a key."""
        return f"{self.path}.{key}" if self.path else key

    def get(self, key: str, default: Any = None) -> Any:
        """Whatever stands there."""
        return self._content.get(key, default)

    def one_of(self, *keys: str) -> str:
        """The one key out of several that is there."""
        there = [key for key in keys if key in self]
        if len(there) != 1:
            listed = ", ".join(f"`{key}`" for key in keys)
            given = " and ".join(f"`{key}`" for key in there) or "none"
            raise InputError(f"{self.path or 'study'}: expected one of {listed}, got {given}")
        return there[0]

    def text(self, key: str, default: str = "") -> str:
        """Text."""
        value = self.get(key, default)
        if not isinstance(value, str):
            raise InputTypeError(f"{self.at(key)}: expected text, got {kind(value)}")
        return value

    def choice(self, key: str, allowed: Iterable[str], default: str | None = None) -> str:
        """One of some words."""
        names = tuple(allowed)
        if key not in self and default is None:
            raise InputError(f"{self.at(key)}: missing; expected one of {', '.join(names)}")
        value = self.text(key, default or "")
        if value not in names:
            near = difflib.get_close_matches(value, names, n=1)
            hint = f", did you mean {near[0]!r}?" if near else ";"
            raise InputError(f"{self.at(key)}: no {value!r}{hint} expected one of {', '.join(names)}")
        return value

    def flag(self, key: str, default: bool = False) -> bool:
        """True or false."""
        value = self.get(key, default)
        if not isinstance(value, bool):
            raise InputTypeError(f"{self.at(key)}: expected true or false, got {kind(value)}")
        return value

    def whole(self, key: str, default: int | None, least: int, most: int) -> int:
        """A whole number within bounds; without a default it must be there."""
        if key not in self and default is None:
            raise InputError(f"{self.at(key)}: missing; expected a whole number from {least} to {most}")
        return whole(self.at(key), self.get(key, default), least, most)

    def number(self, key: str, default: float) -> float:
        """A finite number."""
        return finite(self.at(key), self.get(key, default))

    def rows(self, key: str, default: Any = ()) -> list[Any]:
        """A list."""
        value = self.get(key, default)
        if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
            raise InputTypeError(f"{self.at(key)}: expected a list, got {kind(value)}")
        return list(value)

    def words(self, key: str, default: Iterable[str] = ()) -> tuple[str, ...]:
        """A list of texts, or one text."""
        value = self.get(key, default)
        found = [value] if isinstance(value, str) else self.rows(key, default)
        for i, each in enumerate(found):
            if not isinstance(each, str):
                raise InputTypeError(f"{self.at(key)}[{i}]: expected text, got {kind(each)}")
        return tuple(found)


def finite(path: str, value: object) -> float:
    """A finite number."""
    found = number(path, value)
    if not math.isfinite(found):
        raise InputError(f"{path}: expected a finite number, got {found}")
    return found


def kind(value: object) -> str:
    """What a value of a document is, in words."""
    return _KINDS.get(type(value), f"a {type(value).__name__}")
