"""Progress of long calls: a bar on stderr, or a function of the caller's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from vffnull._support.errors import InputTypeError

__all__ = ["Counter", "Progress", "bar", "check", "counted"]

Progress = Callable[[float, float], None]
"""Gets what is done and the total, in the same unit."""

Counter = Callable[[int, int], None]
"""Gets the number of items done and of all."""


def check(progress: object) -> None:
    """Refuse what is neither a switch nor a callable."""
    if not (progress is None or isinstance(progress, bool) or callable(progress)):
        raise InputTypeError(f"progress: expected True or a callable, not a {type(progress).__name__}")


@contextmanager
def bar(total: float, delay: float = 0.0, counts: str = ".1f s simulated") -> Iterator[Progress]:
    """A bar on stderr that appears after `delay` [s]; `counts` gives format and name of the numbers."""
    from tqdm import tqdm

    digits, _, what = counts.partition(" ")
    numbers = f"{{n:{digits}}}/{{total:{digits}}} {what}"
    form = f"{{percentage:3.0f}}%|{{bar}}| {numbers} [{{elapsed}}<{{remaining}}]"
    with tqdm(total=total, delay=delay, bar_format=form, leave=False) as shown:

        def report(done: float, of: float) -> None:
            shown.update(total * done / of - shown.n)

        yield report


@contextmanager
def counted(progress: bool | Counter | None, total: int, unit: str = " runs") -> Iterator[Counter | None]:
    """What a call that counts items reports to: a bar of its own, the caller's function, or nothing."""
    if progress is not True:
        yield progress or None
        return
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, leave=False) as shown:
        yield lambda done, _total: shown.update(done - shown.n)
