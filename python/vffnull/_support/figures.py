"""The kinds of file that figures are written as."""

from __future__ import annotations

import os
from pathlib import Path

from vffnull._support.errors import InputError

__all__ = ["FIGURE_ENDINGS", "FIGURE_FORMATS", "checked_file", "ending", "is_file"]

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


def checked_file(path: str | os.PathLike[str]) -> Path:
    """A path that is to be one figure.

    Raises
    ------
    vffnull.errors.InputError
        If figures are not written so.
    """
    file = Path(path)
    if file.suffix.lower() not in FIGURE_ENDINGS:
        raise _unwritable(path, file.suffix)
    return file


def is_file(path: str | os.PathLike[str]) -> bool:
    """Whether a path is to be one figure, and not a folder for several.

    Raises
    ------
    vffnull.errors.InputError
        If it is nothing, or has the ending of another kind of file: the folder of that name would not be what
        was meant.
    """
    text, file = os.fspath(path), Path(path)
    if not text:
        raise InputError("figures need a folder or a file to be written to, not an empty name")
    if text.endswith(os.sep) or file.is_dir():
        return False
    if file.suffix.lower() in FIGURE_ENDINGS:
        return True
    if file.suffix[1:].isalpha():  # figures-0.5 is a folder
        raise _unwritable(path, file.suffix)
    return False


def _unwritable(path: str | os.PathLike[str], given: str) -> InputError:
    known = f"{', '.join(FIGURE_ENDINGS[:-1])} or {FIGURE_ENDINGS[-1]}"
    return InputError(
        f"{os.fspath(path)}: a figure is written as {known}, not {given or 'without an ending'}"
    )
