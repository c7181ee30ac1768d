"""How well the loop of a page keeps the clock, and how fast it is drawn."""

from __future__ import annotations

import vffnull._core as _core


class Counts:
    """Periods and missed deadlines while the loop runs: a loop that stands still misses none."""

    def __init__(self) -> None:
        self._last: tuple[int, int] | None = None
        self._sum = (0, 0)

    def told(self, state: _core.LiveState) -> _core.LiveState:
        """A state with the counts since the first one, pauses left out."""
        now = (state["periods"], state["missed"])
        if self._last is not None and state["status"] == "running":
            self._sum = (self._sum[0] + now[0] - self._last[0], self._sum[1] + now[1] - self._last[1])
        self._last = now
        return {**state, "periods": self._sum[0], "missed": self._sum[1]}


class Rate:
    """Pictures per second, counted over a second.

    Parameters
    ----------
    now : float
        When counting begins [s].
    """

    def __init__(self, now: float) -> None:
        self._since, self._pictures, self._rate = now, 0, 0.0

    def count(self, now: float) -> float:
        """Count one more; the rate [Hz] as last measured, 0 until then."""
        self._pictures += 1
        if now - self._since > 1.0:
            self._rate = self._pictures / (now - self._since)
            self._since, self._pictures = now, 0
        return self._rate
