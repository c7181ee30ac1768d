"""Runs as one HTML page: the arm in motion, linked plots, metrics, scenario, assumptions.

The page holds everything it needs, the drawing library included, and asks no network for anything.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from vffnull._support.errors import InputError, InputTypeError
from vffnull._support.extras import extra
from vffnull._support.files import replacing
from vffnull._support.interrupts import heard

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

__all__ = ["check_path", "compare", "save", "write"]

_MOST = 8  # runs on one page; more colours cannot be told apart


def compare(results: Mapping[str, Outcome] | Iterable[Outcome], path: str | os.PathLike[str]) -> Path:
    """Put several runs side by side on one HTML page that needs nothing else, not even a network.

    The arms move together under one time slider, the plots show one line for each run, and tables show the
    metrics of all runs and the scenario keys in which they differ.

    Parameters
    ----------
    results : mapping of str to Result, or iterable of Result
        One to eight runs; a mapping gives them names, by default they are called after their scenarios.
    path : str or path
        A path that ends in ``.html``.

    Returns
    -------
    Path
        Where it was written.

    Raises
    ------
    vffnull.errors.InputError
        If the path ends otherwise, or if there are no runs or too many.
    vffnull.errors.InputTypeError
        If something is not a result.
    OSError
        If it cannot be written; a page that was there is left as it was.
    ImportError
        Without the extra ``vffnull[report]``.

    Examples
    --------
    >>> gains = {f"gain {gain}": simulate("paper-1", {"controller.field.gain": gain}) for gain in (0.0, 5.0)}
    >>> compare(gains, "compare.html")  # doctest: +SKIP
    """
    if isinstance(results, Mapping):
        names, runs = [str(name) for name in results], list(results.values())
    else:
        runs = list(results)
        names = _names(runs)
    return write(runs, path, names)


@heard()
def write(runs: list[Outcome], path: str | os.PathLike[str], names: list[str] | None = None) -> Path:
    """Write the page of one or several runs."""
    target = check_path(path)
    for run in runs:
        if not _is_run(run):
            raise InputTypeError(f"results: expected results, not a {type(run).__name__}")
    if not 1 <= len(runs) <= _MOST:
        raise InputError(f"results: expected 1 to {_MOST} runs, got {len(runs)}")
    extra("bokeh", "report")
    from vffnull.draw.report.page import render

    return save(render(runs, names or _names(runs)), target)


def save(text: str, target: Path) -> Path:
    """Write a page whole, or leave what was there; surrogates of hostile names become question marks."""
    with replacing(target) as draft:
        draft.write_bytes(text.encode("utf-8", "replace"))
    return target


def _is_run(value: object) -> bool:
    """Whether something has what a page is made of."""
    return all(hasattr(value, name) for name in ("scenario", "status", "metrics", "t", "q", "clearance"))


def check_path(path: str | os.PathLike[str]) -> Path:
    """The path, if a page can be written under such a name."""
    target = Path(path)
    if target.suffix != ".html":
        raise InputError(
            f"{target}: a report is written as .html, not {target.suffix or 'without an ending'}"
        )
    return target


def _names(runs: list[Outcome]) -> list[str]:
    """The scenarios' names, numbered where several runs share one."""
    plain = [run.scenario.name or "run" if _is_run(run) else "" for run in runs]
    return [
        f"{name} ({plain[: i + 1].count(name)})" if plain.count(name) > 1 else name
        for i, name in enumerate(plain)
    ]
