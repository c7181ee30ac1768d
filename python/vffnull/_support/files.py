"""Files that are there whole or not at all, as they were written, and no longer than can be read."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from vffnull._support.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["apart", "digest", "read_text", "replacing", "writable"]

MAX_BYTES = 1 << 28
"""Of a text: the largest cloud, of 50 000 points, takes 3 million, and a million discs take 110 million."""
_LONGEST_ENDING = 16


def read_text(path: Path, most: int = MAX_BYTES, encoding: str = "utf-8", errors: str = "strict") -> str:
    """The text of a file that is not too long; of one that is, no more is read than that takes.

    Parameters
    ----------
    path : Path
        The file.
    most : int, optional
        How many bytes it may have, or characters where the system does not tell.
    encoding, errors : str, optional
        As of `open`.

    Raises
    ------
    vffnull.errors.InputError
        If there are more.
    OSError
        If it cannot be read.
    UnicodeDecodeError
        If it is no such text.
    """
    with path.open(encoding=encoding, errors=errors) as file:
        size = os.fstat(file.fileno()).st_size  # 0 of a device or a pipe, which may have no end
        text = file.read(most + 1) if size <= most else ""
    if size > most or len(text) > most:
        raise InputError(f"{path} has {size or 'too many'} bytes; at most {most} are read")
    return text


def apart(target: str | os.PathLike[str], *read: str | os.PathLike[str]) -> None:
    """Refuse to write onto what is read, before anything is read.

    Parameters
    ----------
    target : str or path
        Where is to be written.
    *read : str or path
        What is to be read, by whatever path: through links, or from another folder. What is no file, such as
        a bundled name, is not written onto.

    Raises
    ------
    vffnull.errors.InputError
        If the target is one of these files.
    """
    if any(_is_same(target, each) for each in read):
        raise InputError(f"{os.fspath(target)}: is read, and would be written over; name another file")


def writable(folder: str | os.PathLike[str]) -> None:
    """Find out whether files can be written into a folder; if it has to be made, into the nearest there is.

    Parameters
    ----------
    folder : str or path
        Where is to be written.

    Raises
    ------
    OSError
        If nobody, or not this user, can write there.
    """
    there = next(each for each in (Path(folder), *Path(folder).absolute().parents) if each.exists())
    if not there.is_dir():
        raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), str(there))
    if not os.access(there, os.W_OK | os.X_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(Path(folder).absolute()))


def _is_same(target: str | os.PathLike[str], read: str | os.PathLike[str]) -> bool:
    try:
        return os.path.samefile(target, read)
    except (OSError, ValueError):  # one of them is not there, or is no path
        return False


@contextmanager
def replacing(path: Path, folder: Path | None = None) -> Iterator[Path]:
    """A draft beside the target, renamed over it on success and removed on failure.

    A full disk, an exception or the end of the process leave an old file as it was. The draft has a new name
    that nobody can foresee and is created by this process, so that it never follows a link. If the target
    itself is a link, what it points at is replaced, and the link stays.

    Parameters
    ----------
    path : Path
        The target; its name may be as long as the file system allows.
    folder : Path, optional
        Where the draft stands instead, on the same file system: where nobody looks who reads all files
        beside the target.

    Yields
    ------
    Path
        The draft: an empty file with the target's ending.

    Raises
    ------
    OSError
        If the file cannot be written; `filename` is the target, never the draft.
    """
    target = Path(os.path.realpath(path))
    draft = (folder or target.parent) / f".{os.urandom(8).hex()}{_ending(target)}"
    try:
        permissions = _permissions(target)
        is_ours = True  # before there is a draft: a signal may end this as soon as there is
        try:
            try:
                os.close(os.open(draft, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
            except FileExistsError:
                is_ours = False
                raise
            yield draft
            if permissions is not None:
                draft.chmod(permissions)
            draft.replace(target)
        finally:
            if is_ours:
                with suppress(OSError):
                    draft.unlink(missing_ok=True)
    except OSError as error:
        about_draft = error.filename is None or os.fsdecode(error.filename) in (str(draft), str(target))
        if error.errno is None or not about_draft:
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None


def digest(text: str, arrays: Iterable[NDArray[np.float64]]) -> str:
    """What a file carries of its text and its numbers, so that damage is noticed.

    Parameters
    ----------
    text : str
        All that is not in arrays.
    arrays : iterable of ndarray
        Of any shape.

    Returns
    -------
    str
        16 hexadecimal digits of SHA-256.
    """
    import hashlib

    import numpy as np

    found = hashlib.sha256(text.encode(errors="surrogatepass"))
    for array in arrays:
        found.update(np.where(np.isnan(array), np.nan, array).tobytes())  # text has one NaN alone
    return found.hexdigest()[:16]


def _ending(target: Path) -> str:
    """The ending, by which some libraries choose the format; not one that is most of a long name."""
    return target.suffix if len(target.suffix) <= _LONGEST_ENDING else ""


def _permissions(target: Path) -> int | None:
    """The permissions of the file that is there; None if there is none."""
    try:
        there = target.stat()
    except FileNotFoundError:
        return None
    if stat.S_ISDIR(there.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR), os.fspath(target))
    if not stat.S_ISREG(there.st_mode):
        raise OSError(errno.EINVAL, "not a regular file", os.fspath(target))
    return stat.S_IMODE(there.st_mode)
