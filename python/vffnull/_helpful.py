"""Classes that help whoever mistypes a parameter, or asks `help` about a field."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import re
from typing import Any, TypeVar

from vffnull.errors import InputTypeError

__all__ = ["documented", "suggesting"]

_Class = TypeVar("_Class", bound=type)


def suggesting(cls: _Class) -> _Class:
    """Let a constructor say which parameter was meant by one that it does not have."""
    made: Any = cls
    init = made.__init__
    known = tuple(inspect.signature(init).parameters)[1:]

    @functools.wraps(init)
    def made_of(self: object, *given: Any, **named: Any) -> None:
        for name in named:
            if name not in known:
                raise InputTypeError(_unknown(cls.__name__, name, known))
        init(self, *given, **named)

    made.__init__ = made_of
    return cls


def _unknown(owner: str, name: str, known: tuple[str, ...]) -> str:
    import difflib

    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]!r}? There are" if near else "there are"
    return f"{owner}: unknown parameter {name!r}; {hint} {', '.join(known)}"


def documented(cls: _Class) -> _Class:
    """Let every field of a dataclass answer `help` with what the docstring of the class says of it."""
    texts = dict(re.findall(r"^    (\w+) : (.+(?:\n        .+)+)", cls.__doc__ or "", re.M))
    for each in dataclasses.fields(cls):
        setattr(cls, each.name, _field(each.name, inspect.cleandoc(f"    {texts[each.name]}")))
    return cls


def _field(name: str, text: str) -> property:
    """What stores a value where a class without it does; a frozen class lets its constructor alone set it."""

    def get(self: Any) -> Any:
        return self.__dict__[name]

    def put(self: Any, value: Any) -> None:
        self.__dict__[name] = value

    first, _, rest = text.partition("\n")
    return property(get, put, doc=f"{first}\n\n{inspect.cleandoc(rest)}")
