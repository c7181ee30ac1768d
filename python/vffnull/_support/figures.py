"""The kinds of file that figures are written as."""

from __future__ import annotations

from vffnull._support.errors import InputError

__all__ = ["FIGURE_ENDINGS", "FIGURE_FORMATS", "ending"]

FIGURE_FORMATS = ("png", "pdf", "svg")
FIGURE_ENDINGS = tuple(f".{each}" for each in FIGURE_FORMATS)


def ending(format: str) -> str:
    """The ending of a file of this format.

    Raises
    ------
    vffnull.errors.InputError
        If figures are not written so.
    """
    if format not in FIGURE_FORMATS:
        raise InputError(f"format: expected one of {', '.join(FIGURE_FORMATS)}, not {format!r}")
    return f".{format}"
