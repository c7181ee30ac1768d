"""NumPy's own archive: needs nothing but NumPy, and keeps every bit."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._record import QUANTITIES, recorded
from vffnull.errors import InputError
from vffnull.logs import header

if TYPE_CHECKING:
    from vffnull.result import Result


def write(result: Result, path: Path) -> None:
    """Write a result; its header is the text under the name ``vffnull``."""
    with path.open("wb") as file:
        arrays: dict[str, Any] = recorded(result)
        np.savez(file, vffnull=np.array(header.pack(result)), t=result.t, **arrays)


def read(path: Path) -> tuple[header.Header, header.Arrays]:
    """The header and the arrays of a file."""
    try:
        with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
            found = header.unpack(str(file["vffnull"]), path)
            return found, {name: file[name] for name in ("t", *QUANTITIES) if name in file}
    except InputError:
        raise
    except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile, zlib.error):
        raise header.foreign(path) from None
