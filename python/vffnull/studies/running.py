"""Running a study: what is there is verified and left, the rest is computed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from typing import Any

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.progress import Counter
from vffnull.studies.executors import Done, Executor
from vffnull.studies.manifest import begun
from vffnull.studies.parts import KINDS, READERS, Part, named, wanted
from vffnull.studies.plan import Block, Plan
from vffnull.studies.store import Store

__all__ = ["Begun", "begin", "carry_out", "verified"]

_CHUNK = 1024

Tell = Callable[[str], None]


@dataclass(frozen=True)
class Begun:
    """What was there before a run.

    Attributes
    ----------
    blocks : frozenset of int
        The blocks of which all parts are there and whole.
    damaged : int
        Parts that were not, and have been removed.
    """

    blocks: frozenset[int]
    damaged: int


def begin(plan: Plan, store: Store, resume: bool) -> Begun:
    """Open a dataset that has been locked: write its manifest, or verify what is there.

    Raises
    ------
    vffnull.errors.InputError
        If something is there and is not to be resumed, or belongs to another study.
    """
    there = begun(plan, store)
    if not resume and there and any(named("runs", name) for name in store.names("runs")):
        count = len({part.block for name in store.names("runs") if (part := named("runs", name))})
        of = f" of {plan.blocks}" if plan.design is not None else ""
        raise InputError(
            f"{store.place}: holds {count}{of} blocks of this study; resume it (--resume), "
            "or choose another directory"
        )
    store.tidy()
    return verified(plan, store) if there else Begun(frozenset(), 0)


def verified(plan: Plan, store: Store) -> Begun:
    """Find the blocks of which all parts are there; what is damaged, or there twice, is removed."""
    whole: dict[str, dict[int, Part]] = {kind: {} for kind in KINDS}
    damaged = 0
    with ThreadPoolExecutor(READERS) as pool:
        try:
            for kind in wanted(plan):
                listed = [part for name in store.names(kind) if (part := named(kind, name))]
                for start in range(0, len(listed), _CHUNK):
                    stretch = listed[start : start + _CHUNK]
                    sound = pool.map(lambda part: _is_sound(plan, store, part), stretch)
                    for part, fine in zip(stretch, sound, strict=True):
                        if fine and part.block not in whole[kind]:
                            whole[kind][part.block] = part
                        else:
                            damaged += not fine
                            store.remove(part.path)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    blocks = frozenset.intersection(*(frozenset(whole[kind]) for kind in wanted(plan)))
    for kind in wanted(plan):
        for number, part in whole[kind].items():
            if number not in blocks:  # half a block: the client was stopped between its two parts
                store.remove(part.path)
    return Begun(blocks, damaged)


def _is_sound(plan: Plan, store: Store, part: Part) -> bool:
    """Whether a part is whole, and of this study."""
    arrow, parquet = extra("pyarrow", "study"), extra("pyarrow.parquet", "study")
    data = store.read(part.path)
    if not part.fits(data):
        return False
    try:
        metadata = parquet.read_schema(arrow.BufferReader(data)).metadata or {}
    except arrow.ArrowInvalid:
        return False
    return f'"study": "{plan.digest}"'.encode() in metadata.get(b"vffnull", b"")


def carry_out(
    plan: Plan,
    store: Store,
    token: str,
    executor: Executor,
    blocks: Iterable[Block],
    report: Counter | None,
    total: int,
) -> Iterator[Done]:
    """Compute blocks and write their parts.

    Parameters
    ----------
    plan, store, token, executor
        What is computed, where it is written, under which lock, and who computes.
    blocks : iterable of Block
        What is to be done.
    report : callable or None
        Gets the number of runs that are over and of all of these blocks.
    total : int
        Runs of these blocks.
    """
    over = 0

    def told(under_way: int) -> None:
        if report is not None:
            report(over + under_way, total)

    with closing(executor.each(plan, iter(blocks), store, token, told)) as found:  # type: ignore[type-var]
        for done in found:
            for part in done.parts[::-1]:
                if part.data is not None:
                    store.write(part.path, part.data)
            over += done.runs
            told(0)
            yield done


def new_token() -> str:
    """What a client locks a dataset with: nobody else has the same."""
    return os.urandom(8).hex()


def missing(plan: Plan, begun: Begun) -> Iterator[Block]:
    """The blocks of a design that are not there, in order; made as they are asked for."""
    return (plan.block(number) for number in range(plan.blocks) if number not in begun.blocks)


def runs_of(plan: Plan, numbers: Any) -> int:
    """How many runs so many blocks of a design have."""
    last = plan.blocks - 1
    short = plan.runs - last * plan.size
    return len(numbers) * plan.size - (plan.size - short if last in numbers else 0)
