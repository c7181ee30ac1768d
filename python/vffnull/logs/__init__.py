"""Results in files and in other people's tables. `vffnull.Result.save` and `load` are the way in.

One module for each kind of file; each has ``write(result, path)``, and ``read(path)`` where nothing is lost.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.files import replacing

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

    Kind = TypeVar("Kind", bound=Outcome)

__all__ = ["READABLE", "check_path", "extra", "load", "save"]

_WRITERS = {
    ".npz": "npz",
    ".parquet": "parquet",
    ".arrow": "arrow",
    ".csv": "csv",
    ".mcap": "mcap",
    ".rrd": "rerun",
}
READABLE = {".npz": "npz", ".parquet": "parquet", ".arrow": "arrow", ".csv": "csv"}


def save(result: Outcome, path: str | os.PathLike[str]) -> Path:
    """Write a result to a file of the kind that the path's ending names."""
    target = check_path(path)
    writer = _module(_WRITERS[target.suffix])
    with replacing(target) as draft:
        writer.write(result, draft)
    return target


def load(path: str | os.PathLike[str], kind: type[Kind]) -> Kind:
    """Read a result from a file that `save` has written."""
    from vffnull.logs.header import foreign, restore

    source = Path(path)
    if source.suffix not in READABLE:
        raise InputError(f"{source}: a result is read from {_listed(READABLE)}, not {_ending(source)}")
    reader = _module(READABLE[source.suffix])
    try:
        source.open("rb").close()  # what the operating system says of the path is passed on
    except ValueError:  # a null character
        raise InputError(f"{str(source)!r}: not the path of a file") from None
    try:
        header, arrays = reader.read(source)
    except (InputError, ImportError):
        raise
    except Exception:  # the readers of other libraries have errors of every kind for files that are broken
        raise foreign(source) from None
    return restore(kind, header, arrays, source)


def check_path(path: str | os.PathLike[str]) -> Path:
    """The path, if a result can be written under such a name."""
    target = Path(path)
    if target.suffix not in _WRITERS:
        raise InputError(f"{target}: a result is saved as {_listed(_WRITERS)}, not {_ending(target)}")
    return target


def _module(name: str) -> Any:
    return importlib.import_module(f"vffnull.logs.{name}")


def _listed(endings: dict[str, str]) -> str:
    *rest, last = endings
    return f"{', '.join(rest)} or {last}"


def _ending(path: Path) -> str:
    return path.suffix or "without an ending"
