"""The last seconds of what was drawn, to be looked at again."""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from vffnull._core import LiveState

KEPT = 30.0
"""How far back one can look [s]."""


class Memory:
    """States of the loop and of the ghost beside it, and whether one of them is looked at now."""

    def __init__(self) -> None:
        self._states: deque[tuple[LiveState, LiveState | None]] = deque()
        self.back: float | None = None
        """How far back is looked at [s]; None while the present is."""
        self.plays = False
        """Whether time goes on from there."""

    @property
    def span(self) -> float:
        """How far back there is something [s]."""
        return float(self._states[-1][0]["t"] - self._states[0][0]["t"]) if self._states else 0.0

    def clear(self) -> None:
        """Forget everything."""
        self._states.clear()
        self.leave()

    def leave(self) -> None:
        """Look at the present."""
        self.back, self.plays = None, False

    def add(self, state: LiveState, ghost: LiveState | None) -> None:
        """Take in what is drawn, if it is later than the last."""
        if self._states and state["t"] <= self._states[-1][0]["t"]:
            return
        self._states.append((state, ghost))
        while state["t"] - self._states[0][0]["t"] > KEPT:
            self._states.popleft()

    def look(self, back: float) -> None:
        """Look so many seconds back and stay there; 0 is the present."""
        self.back, self.plays = (min(back, self.span) if back > 0.0 else None), False

    def play(self) -> None:
        """Go on from where one looks, from the begin of what is kept if that is the present."""
        if self._states:
            self.back, self.plays = self.back or self.span, True

    def go_on(self, passed: float) -> None:
        """Let time pass [s] where it does."""
        if self.plays and self.back is not None:
            self.look(self.back - passed)
            self.plays = self.back is not None

    def seen(self) -> tuple[LiveState, LiveState | None] | None:
        """What is looked at; None if that is the present."""
        if self.back is None or not self._states:
            return None
        return self._states[self._row()]

    def tips(self, count: int, size: int) -> list[NDArray[np.float64]]:
        """Where the tip was until then, `size` coordinates each, the last ones."""
        row = self._row() if self._states else 0
        return [self._states[i][0]["x"][:size] for i in range(max(0, row - count), row)]

    def _row(self) -> int:
        """Of the last state that is not later than what is looked at."""
        then = self._states[-1][0]["t"] - (self.back or 0.0)
        return max(0, bisect_right(self._states, then, key=lambda each: each[0]["t"]) - 1)
