"""Results in files and in other people's tables. `vffnull.Result.save` and `load` are the way in.

One module for each kind of file; each has ``write(result, path)``, and ``read(path)`` where nothing is lost.
"""

from __future__ import annotations

import importlib
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vffnull.errors import InputError

if TYPE_CHECKING:
    from vffnull.result import Result

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


def save(result: Result, path: str | os.PathLike[str]) -> Path:
    """Write a result to a file of the kind that the path's ending names."""
    target = check_path(path)
    writer = _module(_WRITERS[target.suffix])
    draft = target.with_name(f".{target.stem}.part{target.suffix}")
    try:  # a crash never leaves half a file under the name
        writer.write(result, draft)
        draft.replace(target)
    finally:
        draft.unlink(missing_ok=True)
    return target


def load(path: str | os.PathLike[str], kind: type[Result]) -> Result:
    """Read a result from a file that `save` has written."""
    from vffnull.logs.header import restore

    source = Path(path)
    if source.suffix not in READABLE:
        raise InputError(f"{source}: a result is read from {_listed(READABLE)}, not {_ending(source)}")
    header, arrays = _module(READABLE[source.suffix]).read(source)
    return restore(kind, header, arrays, source)


def check_path(path: str | os.PathLike[str]) -> Path:
    """The path, if a result can be written under such a name."""
    target = Path(path)
    if target.suffix not in _WRITERS:
        raise InputError(f"{target}: a result is saved as {_listed(_WRITERS)}, not {_ending(target)}")
    return target


def extra(module: str, name: str) -> Any:
    """Import a package of one of the extras; without it, an ImportError that names the extra."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise ImportError(f'{package} is missing: pip install "vffnull[{name}]"') from error


def _module(name: str) -> Any:
    return importlib.import_module(f"vffnull.logs.{name}")


def _listed(endings: dict[str, str]) -> str:
    *rest, last = endings
    return f"{', '.join(rest)} or {last}"


def _ending(path: Path) -> str:
    return path.suffix or "without an ending"
