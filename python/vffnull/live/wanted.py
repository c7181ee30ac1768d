"""A plan that somebody wants."""

from __future__ import annotations

from collections.abc import Callable

NO_PLAN = "No way was found to where the target is: {}. Drag the target, or what is in the way."


class WantedPlan:
    """Tells whoever wants a plan if there is none.

    Parameters
    ----------
    notify : Callable
        What tells everybody there: a title, a text, and how long it stays [s].
    """

    def __init__(self, notify: Callable[[str, str, float], None]) -> None:
        self._notify, self._waits = notify, False

    def begin(self) -> None:
        """Somebody wants one now."""
        self._waits = True

    def read(self, search: str | None) -> None:
        """Take in what has come of the last search, as a snapshot of the loop says."""
        if self._waits and search not in (None, "searching"):
            self._waits = False
            if search != "found":
                self._notify("No plan", NO_PLAN.format(search), 8.0)
