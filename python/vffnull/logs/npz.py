"""NumPy's own archive: needs nothing but NumPy, and keeps every bit."""

from __future__ import annotations

import math
import zipfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull.logs import header
from vffnull.model.record import recorded

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome


def write(result: Outcome, path: Path) -> None:
    """Write a result; its header is the text under the name ``vffnull``."""
    with path.open("wb") as file:
        arrays: dict[str, Any] = recorded(result)
        np.savez(file, vffnull=np.array(header.pack(result, signed=True)), t=result.t, **arrays)


def read(path: Path) -> tuple[header.Header, header.Arrays]:
    """The header and the arrays of a file.

    Sizes are compared with what is really there before anything is allocated: a few bytes can claim to be an
    array of any size, or unpack to one.
    """
    with zipfile.ZipFile(path) as file:
        members = {info.filename.removesuffix(".npy"): info for info in file.infolist()}
        found = header.unpack(str(_array(file, members["vffnull"], path)), path)
        return found, {name: _array(file, members[name], path) for name in members if name != "vffnull"}


def _array(file: zipfile.ZipFile, info: zipfile.ZipInfo, path: Path) -> NDArray[Any]:
    """An array of the archive, which `numpy.savez` does not compress."""
    if info.compress_type != zipfile.ZIP_STORED or info.file_size > path.stat().st_size:
        raise header.foreign(path)
    with file.open(info) as member:
        if np.lib.format.read_magic(member) != (1, 0):
            raise header.foreign(path)
        shape, by_column, dtype = np.lib.format.read_array_header_1_0(member)
        size = info.file_size - member.tell()
        if dtype.kind not in "fU" or math.prod(shape) * dtype.itemsize != size:
            raise header.foreign(path)
        return np.frombuffer(bytearray(member.read(size)), dtype).reshape(
            shape, order="F" if by_column else "C"
        )
