"""What a study will take, before it starts: a few of its runs are made, and their time and size scaled up."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

import vffnull._core as _core
from vffnull._support.errors import ScenarioError
from vffnull.studies.blocks import compute
from vffnull.studies.plan import Block, Plan
from vffnull.studies.probe import probe

__all__ = ["Estimate", "estimated"]

_SAMPLE = 8  # runs
_ENOUGH = 2.0  # s
_FOOTER = 400.0  # bytes that a part has for every column, whatever its length


@dataclass(frozen=True)
class Estimate:
    """What a study takes.

    Attributes
    ----------
    runs, blocks : int
        How many.
    seconds : float
        Of computing on one core [s], from a few runs on this machine.
    bytes : float
        Of the dataset, roughly.
    """

    runs: int
    blocks: int
    seconds: float
    bytes: float

    def on(self, cores: int) -> float:
        """Seconds on so many cores [s], each block on one of them."""
        return self.seconds / max(min(cores, self.runs), 1)

    def __str__(self) -> str:
        cores = os.cpu_count() or 1
        here = f"{_span(self.on(cores))} on this machine's {cores} cores" if cores > 1 else "on this machine"
        return (
            f"{self.runs:,} runs in {self.blocks:,} blocks: about {_span(self.seconds)} of one core, {here}; "
            f"about {_amount(self.bytes)}"
        )


def estimated(plan: Plan) -> Estimate:
    """Estimate what a study takes from a few of its runs, spread over it; that takes two seconds or so.

    A run that takes longer is broken off, and the rest of it counts as what was simulated.
    """
    count = min(plan.runs, _SAMPLE)
    numbers = dict.fromkeys(round(i * (plan.runs - 1) / max(count - 1, 1)) for i in range(count))
    spent = simulated = total = 0.0
    begin = time.monotonic()
    whole: list[Block] = []
    for number in numbers:
        row = plan.row(number) if plan.design is not None else np.array([each.high for each in plan.factors])
        try:
            document = plan.document(number, row)
            _core.check("scenario", document, recorded=plan.records is not None)
        except ScenarioError:  # a run that will be refused
            continue
        total += float(document["duration"])
        if time.monotonic() - begin < _ENOUGH:
            outcome = probe(document, begin + _ENOUGH - time.monotonic(), False)
            spent, simulated = spent + outcome["wall_time"], simulated + outcome["end_time"]
            if outcome["status"] != "interrupted":
                whole.append(Block(len(whole), number, number + 1, row[None]))
    mean = total / len(numbers)
    seconds = plan.runs * mean * spent / simulated if simulated else 0.0
    return Estimate(plan.runs, plan.blocks, seconds, _bytes(plan, whole[:2]))


def _bytes(plan: Plan, samples: Sequence[Block]) -> float:
    """The size of the dataset: what a block has at least, and a bit for each number of each run.

    Doubles of runs hardly shrink; those of records by as much as in a sample.
    """
    fixed = _FOOTER * (len(plan.metrics) + len(plan.factors) + 8)
    found = plan.blocks * fixed + 8.0 * plan.runs * (len(plan.metrics) + len(plan.factors) + 2)
    if plan.records is None or not samples:
        return found
    sizes = [len(compute(plan, each, 1)[1].data or b"") for each in samples]
    return found + plan.runs * sum(sizes) / len(sizes)


def _span(seconds: float) -> str:
    """A time as one says it."""
    for name, length in (("years", 31_557_600.0), ("days", 86_400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {name}"
    return f"{seconds:.2g} s"


def _amount(size: float) -> str:
    """A size as one says it."""
    for name, length in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if size >= length:
            return f"{size / length:.3g} {name}"
    return f"{max(size / 1e3, 1):.0f} kB"
