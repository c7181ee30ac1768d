"""Figures of a run, fit to be printed. `vffnull.Result.plot` is the way in.

Matplotlib is loaded when something is drawn with it: `primitives` and `geometry` do without.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from vffnull.model.outcome import Outcome

__all__ = ["draw", "save"]


def draw(result: Outcome) -> dict[str, Figure]:
    """Draw every figure that says something about a run, by name."""
    from vffnull.draw.figures import figures

    return figures.draw(result)


def save(result: Outcome, directory: Path, ending: str = ".png") -> list[Path]:
    """Draw every figure and write each to a file of its name; returns the files.

    Parameters
    ----------
    result : Result
        What to draw.
    directory : Path
        Where to; made if it does not exist.
    ending : {".png", ".pdf", ".svg"}
        The kind of file.

    Raises
    ------
    vffnull.errors.InputError
        For another ending.
    """
    from vffnull.draw.figures import figures

    return figures.save(result, directory, ending)
