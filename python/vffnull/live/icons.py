"""The icons of buttons."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

from viser import _icons


@contextmanager
def archive_open() -> Iterator[None]:
    """Let viser find all icons in its archive of thousands while that is open once, rather than open it for
    each.
    """
    reader: Any = _icons
    plain = reader.zipfile
    with zipfile.ZipFile(_icons.ICONS_DIR / "tabler-icons.zip") as archive:
        reader.zipfile = SimpleNamespace(ZipFile=lambda _: _Kept(archive))
        try:
            yield
        finally:
            reader.zipfile = plain


class _Kept:
    """An open archive that whoever asks for it does not close."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        self._archive = archive

    def __enter__(self) -> zipfile.ZipFile:
        return self._archive

    def __exit__(self, *_: object) -> None:
        """It is still needed."""
