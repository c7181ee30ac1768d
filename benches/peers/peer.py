"""What every peer offers: a closed loop that can be stepped."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

if TYPE_CHECKING:
    from peers.law import Task

Array = NDArray[Any]


class Loop(ABC):
    """Plant and controller, at t = 0 when made."""

    q: Array  # (n,), the present configuration [rad]

    @abstractmethod
    def step(self) -> None:
        """Advance by one period of control."""

    def run(self, steps: int) -> float:
        """Take so many steps; the time they took [s]."""
        step = self.step
        start = perf_counter()
        for _ in range(steps):
            step()
        return perf_counter() - start


@dataclass(frozen=True)
class Peer:
    """A library, or two, at work on the scene."""

    name: str
    work: str  # what one step consists of
    packages: tuple[str, ...]  # distributions whose versions matter
    prepare: Callable[[Task], Loop]
    same: bool = True  # whether it has to make our trajectory
    largest: int = 1000  # number of links beyond which it is not tried
