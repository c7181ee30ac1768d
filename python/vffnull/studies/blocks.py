"""A block of runs in the core, from its numbers to its parts: a function of the study and the block alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import vffnull._core as _core
from vffnull._support.errors import ScenarioError
from vffnull.model.document import Document
from vffnull.studies.downsampled import records_part
from vffnull.studies.parts import Part, runs_part
from vffnull.studies.plan import Block, Plan

__all__ = ["REFUSED", "Report", "Stopped", "compute"]

Report = Callable[[int], None]
"""Gets the number of runs of a block that are over, about every 100 ms; what it raises stops the block."""

REFUSED = "refused"
"""Status of a run whose scenario cannot be run; its message says why."""


class Stopped(Exception):  # noqa: N818
    """The block is not wanted any more."""


def compute(plan: Plan, block: Block, threads: int | None = None, report: Report | None = None) -> list[Part]:
    """Run a block and make its parts.

    Parameters
    ----------
    plan : Plan
        The study.
    block : Block
        Which runs.
    threads : int, optional
        How many threads compute; as many as there are cores by default. The parts do not depend on it.
    report : callable, optional
        See `Report`.

    Raises
    ------
    Stopped
        After Ctrl-C, or whatever `report` raises. Half of a block is nothing.
    """
    outcomes: list[Mapping[str, Any]] = [{}] * len(block)
    documents: dict[int, Document] = {}
    for i, run in enumerate(range(block.first, block.last)):
        try:
            documents[i] = plan.document(run, block.rows[i])
        except ScenarioError as error:
            outcomes[i] = _refusal(error)
    recorded = plan.records is not None
    for i, outcome in _outcomes(documents, recorded, threads, report).items():
        outcomes[i] = outcome
    parts = [runs_part(plan, block, outcomes)]
    return [*parts, records_part(plan, block, outcomes)] if recorded else parts


def _outcomes(
    documents: dict[int, Document], recorded: bool, threads: int | None, report: Report | None
) -> dict[int, Mapping[str, Any]]:
    """How every run ended; a scenario that cannot be run leaves the others alone."""
    watched = None if report is None else lambda done, _total: report(done)
    refused: dict[int, Mapping[str, Any]] = {}
    try:
        done = _core.run_many(list(documents.values()), "runs", threads, recorded, watched)
    except ScenarioError:  # the first one that is wrong: look at each
        refused = {i: fault for i, each in documents.items() if (fault := _fault(each, recorded)) is not None}
        if not refused:
            raise
        documents = {i: each for i, each in documents.items() if i not in refused}
        done = _core.run_many(list(documents.values()), "runs", threads, recorded, watched)
    found: dict[int, Mapping[str, Any]] = {}
    for (i, document), outcome in zip(documents.items(), done, strict=True):
        status = outcome["status"]
        if status == "interrupted":
            raise Stopped
        message = outcome["message"] if status == "failed" else None
        found[i] = {**outcome, "message": message, "scenario": document}
    return found | refused


def _fault(document: Document, recorded: bool) -> Mapping[str, Any] | None:
    """The outcome of a run that cannot be started; None for one that can."""
    try:
        _core.check("scenario", document, recorded=recorded)
    except ScenarioError as error:
        return _refusal(error)
    return None


def _refusal(error: ScenarioError) -> Mapping[str, Any]:
    return {"status": REFUSED, "message": str(error), "end_time": 0.0, "metrics": {}}
