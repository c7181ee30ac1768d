"""Which executor computes: threads here, worker processes of this machine, or somebody's cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from vffnull._support.arguments import MAX_THREADS, whole
from vffnull._support.errors import InputError, InputTypeError
from vffnull._support.extras import extra
from vffnull.studies.executors import ClusterExecutor, Executor, LocalExecutor

__all__ = ["check_executor", "executor"]


def check_executor(threads: int | None, workers: int | None, scheduler: Any) -> None:
    """Refuse what makes no executor.

    Raises
    ------
    vffnull.errors.InputError, vffnull.errors.InputTypeError
        If an argument is wrong, or two of them exclude each other.
    ImportError
        Without what they need.
    """
    if threads is not None:
        whole("threads", threads, 1, MAX_THREADS)
    if workers is not None:
        whole("workers", workers, 1, MAX_THREADS)
    given = [
        name
        for name, value in (("threads", threads), ("workers", workers), ("scheduler", scheduler))
        if value
    ]
    if len(given) > 1:
        raise InputError(
            f"{given[0]}: not together with {given[1]}; one of them says where blocks are computed"
        )
    if workers is not None or scheduler is not None:
        distributed = extra("distributed", "study")
        if scheduler is not None and not isinstance(scheduler, str | distributed.Client):
            raise InputTypeError(
                f"scheduler: expected an address or a distributed.Client, not a {type(scheduler).__name__}"
            )


@contextmanager
def executor(
    threads: int | None, workers: int | None, scheduler: Any, tell: Callable[[str], None] = lambda _: None
) -> Iterator[Executor]:
    """Where blocks are computed, for as long as the context lasts; `tell` gets a link to look at a cluster.

    Raises
    ------
    ConnectionError
        If there is no scheduler at the address.
    vffnull.errors.InputError
        If a worker would compute something else.
    """
    if workers is None and scheduler is None:
        yield LocalExecutor(threads)
        return
    distributed = extra("distributed", "study")
    if workers is not None:
        with (
            distributed.LocalCluster(
                n_workers=workers, threads_per_worker=1, dashboard_address=":0", silence_logs=50
            ) as cluster,
            distributed.Client(cluster) as client,
        ):
            yield _checked(client, tell)
    elif isinstance(scheduler, str):
        try:
            client = distributed.Client(scheduler)
        except ValueError as error:
            raise InputError(
                f"scheduler: {scheduler!r} is no address, as tcp://host:8786 is: {error}"
            ) from None
        except OSError as error:
            raise ConnectionError(f"no scheduler answers at {scheduler}: {error}") from None
        with _silent("distributed"), _silent("distributed.client"), client:
            yield _checked(client, tell)
    else:
        yield _checked(scheduler, tell)


@contextmanager
def _silent(name: str) -> Iterator[None]:
    """Keep one of Dask's logs to itself: what ends a study is said by our errors."""
    log = logging.getLogger(name)
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


def _checked(client: Any, tell: Callable[[str], None]) -> ClusterExecutor:
    found = ClusterExecutor(client)
    found.check()
    if client.dashboard_link:
        tell(f"Dask's dashboard: {client.dashboard_link}")
    return found
