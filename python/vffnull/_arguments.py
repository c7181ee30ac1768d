"""Numbers that callers give, checked once for every function."""

from __future__ import annotations

import operator

from vffnull.errors import InputError, InputTypeError

__all__ = ["MOST_THREADS", "number", "whole"]

MOST_THREADS = 1024


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
