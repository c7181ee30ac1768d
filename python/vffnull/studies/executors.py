"""Where blocks are computed: in threads of this process, or by the workers of Dask.

Whoever computes a block writes it, too, if the store is within reach; else its parts come back.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Protocol

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.studies.blocks import Stopped, compute
from vffnull.studies.manifest import versions
from vffnull.studies.parts import Part
from vffnull.studies.plan import Block, Plan
from vffnull.studies.store import Store, opened

__all__ = ["ClusterExecutor", "Done", "LocalExecutor", "Executor"]

_TOGETHER = 2  # blocks in this process: one is prepared and written while the cores compute the other
_EVERY = 0.1  # s between looks at signals
_AHEAD = 2  # blocks for every thread of a cluster, so that none waits for the next
_LOOK = 5.0  # s between looks at how many workers there are


@dataclass(frozen=True)
class Done:
    """A block that is over.

    Attributes
    ----------
    block : int
        Which one.
    runs : int
        How many runs it has.
    parts : tuple of Part
        Its parts; those with their bytes have yet to be written.
    """

    block: int
    runs: int
    parts: tuple[Part, ...]


class Executor(Protocol):
    """Where blocks are computed."""

    def each(
        self, plan: Plan, blocks: Iterator[Block], store: Store, token: str, told: Callable[[int], None]
    ) -> Iterator[Done]:
        """Compute blocks, in whatever order they come.

        Parameters
        ----------
        plan : Plan
            The study.
        blocks : iterator of Block
            What is to be done, taken as there is room for it.
        store : Store
            Where the parts go.
        token : str
            What the store has been locked with.
        told : callable
            Gets the number of runs that are over but not yet given back.
        """
        ...


class LocalExecutor:
    """Threads of this process.

    Parameters
    ----------
    threads : int, optional
        How many compute; as many as there are cores by default.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = threads

    def each(
        self, plan: Plan, blocks: Iterator[Block], store: Store, token: str, told: Callable[[int], None]
    ) -> Iterator[Done]:
        """Compute blocks, two at a time; see `Executor.each`."""
        stop = threading.Event()
        under_way: dict[int, int] = {}

        def one(block: Block) -> Done:
            def report(done: int) -> None:
                if stop.is_set():
                    raise Stopped
                under_way[block.number] = done

            parts = compute(plan, block, self._threads, report)
            if stop.is_set():
                raise Stopped
            for part in parts[::-1]:  # the runs last: they are what tells that the block is there
                store.write(part.path, part.data or b"")
            return Done(block.number, len(block), tuple(replace(part, data=None) for part in parts))

        pool = ThreadPoolExecutor(_TOGETHER, thread_name_prefix="study")
        pending: set[Future[Done]] = set()
        try:
            while True:
                while len(pending) < _TOGETHER and (block := next(blocks, None)) is not None:
                    pending.add(pool.submit(one, block))
                if not pending:
                    return
                over, pending = wait(pending, _EVERY, FIRST_COMPLETED)
                for each in over:
                    done = each.result()
                    under_way.pop(done.block, None)
                    yield done
                told(sum(under_way.copy().values()))
        finally:
            stop.set()
            pool.shutdown(wait=True, cancel_futures=True)


class ClusterExecutor:
    """The workers of a Dask cluster, each task one block on one thread.

    Parameters
    ----------
    client : distributed.Client
        The connection to the scheduler.
    """

    def __init__(self, client: Any) -> None:
        self._client = client

    def check(self) -> None:
        """Refuse workers that would compute something else.

        Raises
        ------
        vffnull.errors.InputError
            If a worker lacks a package or has another version of it; the message names the worker.
        """
        wanted = versions()
        found = self._client.run(_probe(), list(wanted), on_error="return")
        for worker, there in found.items():
            if isinstance(there, BaseException):
                raise InputError(f"worker {worker}: cannot be asked for its packages: {there}")
            fault = _fault(there, wanted)
            if fault:
                raise InputError(f"worker {worker}: {fault}")

    def each(
        self, plan: Plan, blocks: Iterator[Block], store: Store, token: str, told: Callable[[int], None]
    ) -> Iterator[Done]:
        """Compute blocks, some more at a time than the workers have threads; see `Executor.each`."""
        distributed = extra("distributed", "study")
        client, packed, wanted = self._client, plan.packed(), versions()
        completed = distributed.as_completed()
        pending: dict[Any, Block] = {}
        room, looked = 0, -_LOOK
        try:
            while True:
                if time.monotonic() - looked >= _LOOK:
                    room, looked = max(_AHEAD * sum(client.nthreads().values()), _AHEAD), time.monotonic()
                while len(pending) < room and (block := next(blocks, None)) is not None:
                    key = f"vffnull-{token}-{block.number}"
                    future = client.submit(
                        remote, packed, block, store.place, token, wanted, key=key, pure=False
                    )
                    pending[future] = block
                    completed.add(future)
                if not pending:
                    return
                future = next(completed)
                yield self._result(future, pending.pop(future))
                told(0)
        except (OSError, TimeoutError) as error:
            if not isinstance(error, ConnectionError | TimeoutError) and client.status == "running":
                raise  # of the task: a full disk, for instance
            address = getattr(client.scheduler, "address", "")
            raise ConnectionError(f"the scheduler {address} is gone: {error}") from error
        finally:
            with suppress(Exception):  # the scheduler may be gone
                client.cancel(list(pending), force=True)

    def _result(self, future: Any, block: Block) -> Done:
        distributed = extra("distributed", "study")
        try:
            found: Done = future.result()
        except distributed.KilledWorker as error:
            raise ChildProcessError(
                f"block {block.number} (runs {block.first} to {block.last - 1}) has ended several workers: "
                f"{error}"
            ) from None
        except ModuleNotFoundError as error:
            raise InputError(f"a worker lacks a package: {error}") from None
        except (distributed.CancelledError, distributed.client.FutureCancelledError) as error:
            raise ConnectionError(f"{error}") from None
        return found


def _probe() -> Callable[[list[str]], dict[str, str | None]]:
    """A function that says which versions a worker has.

    It is made here so that it travels as code: the worker may not have this package.
    """

    def found(names: list[str]) -> dict[str, str | None]:
        from importlib import import_module

        there: dict[str, str | None] = {}
        for name in names:
            try:
                there[name] = str(import_module(name).__version__)
            except ImportError:
                there[name] = None
        return there

    return found


def _fault(there: dict[str, str | None], wanted: dict[str, str]) -> str:
    """What is wrong with the packages of a worker; empty if nothing is."""
    for name, version in wanted.items():
        if there.get(name) is None:
            return f"lacks {name}; install vffnull[study] there, version {wanted['vffnull']}"
        if name in ("vffnull", "pyarrow") and there[name] != version:
            return f"has {name} {there[name]}, and this is {version}: the same bits are not certain"
    return ""


@lru_cache(4)
def _unpacked(packed: bytes) -> Plan:
    import pickle

    plan: Plan = pickle.loads(packed)
    return plan


def remote(packed: bytes, block: Block, place: str, token: str, wanted: dict[str, str]) -> Done:
    """What a worker does: compute a block, and write it if the store is within its reach."""
    fault = _fault(dict(versions()), wanted)  # one that came later
    if fault:
        raise InputError(f"a worker {fault}")
    parts = tuple(compute(_unpacked(packed), block, 1))
    store = opened(place)
    if store.holds(token):
        for part in parts[::-1]:
            store.write(part.path, part.data or b"")
        parts = tuple(replace(part, data=None) for part in parts)
    return Done(block.number, len(block), parts)
