"""What callers give: numbers, checked once for every function, and parameters, by their names."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import operator
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeVar

from vffnull._support.errors import InputError, InputTypeError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

__all__ = ["MAX_THREADS", "array", "documented", "number", "positive", "suggesting", "whole", "within"]

MAX_THREADS = 1024

_Class = TypeVar("_Class", bound=type)


def number(name: str, value: object) -> float:
    """A number of any type that Python or NumPy has.

    Raises
    ------
    vffnull.errors.InputTypeError
        If it is none.
    vffnull.errors.InputError
        If it does not fit into 64 bits.
    """
    try:
        if isinstance(value, bool | str | bytes):
            raise TypeError
        return float(value)  # type: ignore[arg-type]
    except OverflowError:
        raise InputError(f"{name}: does not fit into 64 bits") from None
    except (TypeError, ValueError):
        raise InputTypeError(f"{name}: expected a number, not a {type(value).__name__}") from None


def positive(name: str, value: object) -> float:
    """A `number` that is finite and greater than 0."""
    found = number(name, value)
    if not 0.0 < found < float("inf"):
        raise InputError(f"{name}: must be finite and greater than 0, got {found}")
    return found


def within(name: str, value: object, least: float, most: float) -> float:
    """A `number` within bounds."""
    found = number(name, value)
    if not least <= found <= most:
        raise InputError(f"{name}: must be from {least:g} to {most:g}, got {found}")
    return found


def whole(name: str, value: object, least: int, most: int) -> int:
    """A whole number within bounds.

    Raises
    ------
    vffnull.errors.InputTypeError
        If it is none.
    vffnull.errors.InputError
        If it is out of bounds.
    """
    try:
        if isinstance(value, bool):
            raise TypeError
        found = operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        raise InputTypeError(f"{name}: expected a whole number, not a {type(value).__name__}") from None
    if not least <= found <= most:
        given = found if abs(found) < 10**30 else "a number of more than 30 digits"
        raise InputError(f"{name}: must be from {least} to {most}, got {given}")
    return found


def array(name: str, given: ArrayLike, shape: Sequence[int | None]) -> NDArray[np.float64]:
    """Finite numbers of a shape, of which None is any size but 0.

    Raises
    ------
    vffnull.errors.InputError
        If they are none.
    """
    import numpy as np  # here, so that those who count need not wait for it

    try:
        values = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: expected an array of numbers") from None
    fits = values.ndim == len(shape) and all(
        size == wanted if wanted is not None else size > 0
        for size, wanted in zip(values.shape, shape, strict=True)
    )
    if not fits:
        sizes = ["any" if size is None else str(size) for size in shape]
        wanted = f"{sizes[0]}," if len(sizes) == 1 else ", ".join(sizes)
        raise InputError(f"{name}: expected shape ({wanted}), got {values.shape}")
    if not np.isfinite(values).all():
        raise InputError(f"{name}: must be finite")
    return values


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
