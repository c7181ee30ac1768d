"""What visitors have in their hands: obstacles, the target, links."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Held:
    """What somebody has in the hand: an obstacle, or the target, and where it was taken hold of."""

    obstacle: int | None
    offset: Array


@dataclass(frozen=True)
class Grip:
    """A link that somebody holds, and where it was taken hold of (D,) [m]."""

    link: int
    start: Array


class Hand(Protocol):
    """What pulls at links."""

    def grab(self, link: int, point: Array) -> None:
        """Take hold of a link at a point (D,) of its frame [m]."""

    def pull_by(self, offset: Array) -> None:
        """Pull it towards the place that is so far (D,) [m] from where it was then."""

    def let_go(self) -> None:
        """Hold it no longer."""
