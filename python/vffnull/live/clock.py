"""How fast a page is drawn."""

from __future__ import annotations


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
