"""The dataset of a study, with everything that is made of it."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.interrupts import heard
from vffnull.draw.report import check_path, save
from vffnull.studies.findings import Findings, findings
from vffnull.studies.reading import Runs
from vffnull.studies.tuning import Tuned, trials_of

__all__ = ["Dataset"]


class Dataset(Runs):
    """What a study has left in a directory or a store; made by `Study.run` and `Dataset.open`.

    Parts that are added later are seen by the next call. Whatever reads Parquet reads ``runs/*.parquet``.

    Attributes
    ----------
    place : str
        Where it is.
    manifest : dict
        The study's document with versions, seeds, and the unit and meaning of every column.

    Examples
    --------
    >>> dataset = Dataset.open("results")  # doctest: +SKIP
    >>> print(dataset.findings())  # doctest: +SKIP
    >>> dataset.report("results.html")  # doctest: +SKIP
    """

    def findings(self, metrics: Iterable[str] | None = None) -> Findings:
        """How the runs ended, and which factor decides about which metric.

        Parameters
        ----------
        metrics : iterable of str, optional
            Which metrics; those that vary by default.

        Raises
        ------
        vffnull.errors.InputError
            If no run is there yet, or if there is no such metric.
        """
        return findings(self, metrics)

    def tuned(self) -> Tuned:
        """The trials of a tuning, and the best of them.

        Raises
        ------
        vffnull.errors.InputError
            If the dataset is not that of a tuning, or if no run is there yet.
        """
        if not self.manifest["tuned"]:
            raise InputError(f"{self.place}: the runs of a design, not of a tuning")
        return trials_of(self)

    @heard()
    def report(self, path: str | os.PathLike[str], metrics: Iterable[str] | None = None) -> Path:
        """Write everything as one HTML page that needs no network: pictures, indices, tables, the document.

        Parameters
        ----------
        path : str or path
            Where to write it; ends in ``.html``.
        metrics : iterable of str, optional
            Which metrics; by default those that vary, and pictures of the first six of them.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise, or as `findings`.
        ImportError
            Without the extra ``vffnull[study]``.
        """
        target = check_path(path)
        extra("bokeh", "study")
        from vffnull.studies.page import render

        return save(render(self, None if metrics is None else list(metrics)), target)
