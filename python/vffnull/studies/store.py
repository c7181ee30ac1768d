"""Where a dataset stands: a folder of this machine, or any store that fsspec knows.

A file is there whole or not at all, and one client at a time writes. Datasets come from other people, too:
nothing in a folder may be a link, which would lead out of it.
"""

from __future__ import annotations

import errno
import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.files import replacing

__all__ = ["LOCK", "Store", "opened"]

LOCK = ".lock"
_DRAFTS = ".drafts"
_WHOLE = ("s3", "s3a", "gs", "gcs", "abfs", "abfss", "az", "adl", "oci", "memory")
"""Stores in which nobody sees a file before all of it is there."""


class Store(Protocol):
    """Files by their paths, folders separated by ``/``."""

    place: str
    """What it is called in messages, and what `opened` finds it by."""

    def names(self, folder: str) -> list[str]:
        """The files of a folder; none if there is no such folder."""
        ...

    def read(self, path: str) -> bytes:
        """The bytes of a file.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        """
        ...

    def write(self, path: str, data: bytes) -> None:
        """Put a file in its place, whole.

        Raises
        ------
        OSError
            If it cannot be written; a file that was there is there still.
        """
        ...

    def remove(self, path: str) -> None:
        """Remove a file, if it is there."""
        ...

    def tidy(self) -> None:
        """Remove what a process that was killed has left half written."""
        ...

    def locked(self, token: str) -> Any:
        """A context in which this client alone writes; another one gets an `InputError`."""
        ...

    def holds(self, token: str) -> bool:
        """Whether it is the store that a client with this token has locked."""
        ...

    def arrow(self, folder: str) -> tuple[str, Any]:
        """The path of a folder, and the file system, for Arrow's datasets."""
        ...


def opened(place: str | os.PathLike[str]) -> Store:
    """The store that a path or an address such as ``s3://bucket/study`` means; nothing is written yet.

    Raises
    ------
    ImportError
        Without the package that fsspec needs for such an address.
    """
    text = os.fspath(place)
    if not isinstance(text, str):
        raise InputError("out: expected a path or an address")
    scheme, separator, rest = text.partition("://")
    if not separator:
        return _Folder(Path(text))
    if scheme in ("file", "local"):
        return _Folder(Path(rest))
    fsspec = extra("fsspec", "study")
    try:
        system, path = fsspec.core.url_to_fs(text)
    except ValueError as error:
        raise InputError(f"{text}: {str(error)[:1].lower()}{str(error)[1:]}") from None
    return _Remote(system, path, text, scheme in _WHOLE)


def _who(token: str) -> bytes:
    return json.dumps({"token": token, "process": os.getpid(), "machine": platform.node()}).encode()


def _taken(place: str, holder: bytes, more: str) -> InputError:
    try:
        who = json.loads(holder)
        by = f"process {who['process']} on {who['machine']}"
    except (ValueError, KeyError, TypeError):
        by = "another process"
    return InputError(f"{place}: {by} is writing there; one client at a time{more}")


def _leads_elsewhere(place: str, name: str) -> InputError:
    return InputError(f"{place}: {name} is a link; what a dataset has stands in its own folder")


class _Folder:
    """A folder of this machine, or of a file system that machines share."""

    def __init__(self, root: Path) -> None:
        self._root = Path(os.path.abspath(root))
        self.place = str(self._root)
        self._shown = str(root)

    def _at(self, path: str) -> Path:
        """A place in the folder."""
        found = self._root
        for part in path.split("/"):
            found /= part
            if found.is_symlink():
                raise _leads_elsewhere(self._shown, found.relative_to(self._root).as_posix())
        return found

    def names(self, folder: str) -> list[str]:
        try:
            with os.scandir(self._at(folder)) as found:
                return sorted(each.name for each in found if not each.name.startswith("."))
        except FileNotFoundError:
            return []

    def read(self, path: str) -> bytes:
        return self._at(path).read_bytes()

    def write(self, path: str, data: bytes) -> None:
        target, drafts = self._at(path), self._at(_DRAFTS)
        target.parent.mkdir(parents=True, exist_ok=True)
        drafts.mkdir(exist_ok=True)
        with replacing(target, drafts) as draft, draft.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())  # a full disk may say so only now

    def remove(self, path: str) -> None:
        self._at(path).unlink(missing_ok=True)

    def tidy(self) -> None:
        drafts = self._at(_DRAFTS)
        with suppress(OSError):
            for each in drafts.iterdir():
                each.unlink(missing_ok=True)
            drafts.rmdir()

    @contextmanager
    def locked(self, token: str) -> Iterator[None]:
        """The lock is the system's and ends with the process, however that ends."""
        self._root.mkdir(parents=True, exist_ok=True)
        number = os.open(self._at(LOCK), os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o666)
        try:
            if os.fstat(number).st_nlink > 1:
                raise _leads_elsewhere(self._shown, LOCK)
            try:
                _lock(number)
            except OSError as error:
                if error.errno not in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
                    raise
                raise _taken(self._shown, self.read(LOCK), "") from None
            os.ftruncate(number, 0)
            os.pwrite(number, _who(token), 0) if hasattr(os, "pwrite") else os.write(number, _who(token))
            yield
        finally:
            os.close(number)

    def holds(self, token: str) -> bool:
        try:
            return f'"{token}"'.encode() in self.read(LOCK)
        except OSError:
            return False

    def arrow(self, folder: str) -> tuple[str, Any]:
        return str(self._at(folder)), None


def _lock(number: int) -> None:
    """Take the lock of an open file, or raise an `OSError` at once."""
    try:
        import fcntl
    except ImportError:  # Windows: a byte far behind the text, which others may read
        import msvcrt

        os.lseek(number, 1 << 20, os.SEEK_SET)
        msvcrt.locking(number, msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined, unused-ignore]
        os.lseek(number, 0, os.SEEK_SET)
    else:
        fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)


class _Remote:
    """A store of fsspec."""

    def __init__(self, system: Any, root: str, place: str, whole: bool) -> None:
        self._system, self._root, self.place, self._whole = system, root.rstrip("/"), place, whole

    def _at(self, path: str) -> str:
        return f"{self._root}/{path}"

    def names(self, folder: str) -> list[str]:
        self._system.invalidate_cache()
        try:
            found = self._system.ls(self._at(folder), detail=False)
        except FileNotFoundError:
            return []
        names = (str(each).rstrip("/").rpartition("/")[2] for each in found)
        return sorted(name for name in names if not name.startswith("."))

    def read(self, path: str) -> bytes:
        return bytes(self._system.cat_file(self._at(path)))

    def write(self, path: str, data: bytes) -> None:
        target = self._at(path)
        if self._whole:
            self._system.pipe_file(target, data)
            return
        draft = self._at(f"{_DRAFTS}/{os.urandom(8).hex()}")
        for each in (target, draft):
            self._system.makedirs(each.rpartition("/")[0], exist_ok=True)
        try:
            self._system.pipe_file(draft, data)
            self._system.mv(draft, target)
        except BaseException:
            with suppress(OSError):
                self._system.rm_file(draft)
            raise

    def remove(self, path: str) -> None:
        with suppress(FileNotFoundError):
            self._system.rm_file(self._at(path))

    def tidy(self) -> None:
        with suppress(OSError):
            self._system.rm(self._at(_DRAFTS), recursive=True)

    @contextmanager
    def locked(self, token: str) -> Iterator[None]:
        """The lock is a file, which outlives a client that is killed."""
        try:
            held = self.read(LOCK)
        except FileNotFoundError:
            self._system.pipe_file(self._at(LOCK), _who(token))
            held = self.read(LOCK)
        if not self._is(held, token):
            more = f"; if it has been killed, remove {self.place.rstrip('/')}/{LOCK}"
            raise _taken(self.place, held, more)
        try:
            yield
        finally:
            self.remove(LOCK)

    def holds(self, token: str) -> bool:
        try:
            return self._is(self.read(LOCK), token)
        except OSError:
            return False

    @staticmethod
    def _is(held: bytes, token: str) -> bool:
        return f'"{token}"'.encode() in held

    def arrow(self, folder: str) -> tuple[str, Any]:
        return self._at(folder), self._system
