"""Fits that were made before, kept by the content of what was fitted, beside the user's other caches."""

from __future__ import annotations

import hashlib
import json
import os
import sys
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from vffnull._support.files import replacing
from vffnull.arms._capsules import WAY, Fit

if TYPE_CHECKING:
    from vffnull.arms._capsules import Solid

__all__ = ["folder", "key_of", "keep", "kept"]

MOST = 16 << 20
"""How large all of them may be together [bytes]; the oldest go first."""


def folder() -> Path:
    """Where they are: what the system has for such files."""
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given) / "vffnull" / "fits"
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "vffnull" / "fits"
    if sys.platform == "win32" and (given := os.environ.get("LOCALAPPDATA")):
        return Path(given) / "vffnull" / "Cache" / "fits"
    return Path.home() / ".cache" / "vffnull" / "fits"


def key_of(link: str, solids: Iterable[Solid]) -> str:
    """What a fit depends on, and nothing else."""
    found = hashlib.sha256(f"{WAY} {link}".encode())
    for solid in solids:
        found.update(json.dumps([solid.name, solid.hull]).encode())
        for each in (solid.points, solid.radii, solid.triangles):
            found.update(f"{each.dtype} {each.shape}".encode())
            found.update(each.tobytes())
    return found.hexdigest()


def kept(key: str) -> list[Fit] | None:
    """The fits of a link; None if there are none, or what is there is damaged."""
    with suppress(OSError, ValueError, TypeError, KeyError, RuntimeError):
        document = json.loads((folder() / f"{key}.json").read_text(encoding="utf-8"))
        text = json.dumps(document["fits"])
        if document["digest"] == _digest(key, text):
            return [Fit(**{**each, "parts": tuple(each["parts"])}) for each in document["fits"]]
    return None


def keep(key: str, fits: Iterable[Fit]) -> None:
    """Keep the fits of a link, if there is a place for them; the oldest make room."""
    text = json.dumps([asdict(fit) for fit in fits])
    with suppress(OSError, RuntimeError):
        place = folder()
        place.mkdir(parents=True, exist_ok=True)
        with replacing(place / f"{key}.json") as draft:
            draft.write_text(f'{{"digest": "{_digest(key, text)}", "fits": {text}}}', encoding="utf-8")
        there = sorted(((each.stat(), each) for each in place.glob("*.json")), key=lambda of: of[0].st_mtime)
        total = sum(about.st_size for about, _ in there)
        for about, each in there[:-1]:
            if total <= MOST:
                break
            each.unlink(missing_ok=True)
            total -= about.st_size


def _digest(key: str, text: str) -> str:
    return hashlib.sha256(f"{key} {text}".encode()).hexdigest()
