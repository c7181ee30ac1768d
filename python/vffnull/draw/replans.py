"""Searches for a plan: marks over time, and words for them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from vffnull.draw.primitives import COLOURS
from vffnull.model.outcome import Replan

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

_WIDTH, _SHARE = 0.9, 0.12  # of the line [points], and of the colour between its search and it
_ONLY_ASKED = (0, (1, 1.5))
TOLD = 1.0
"""How long a film says that a plan was taken over [s of the film]."""
_MOST = 5  # that are told one by one

_WHY = {
    "blocked": "something was in its way",
    "strayed": "the arm was off it for too long",
    "stuck": "the arm came no nearer to its end",
}


def mark(axes: Iterable[Axes], result: Outcome) -> list[Line2D]:
    """Mark in panels over time where a plan was taken over, and shade the time of its search.

    A search that led to nothing is a dotted line where it began. Returns what belongs into a legend.
    """
    colour = COLOURS["plan"]
    for ax in axes:
        for search in result.replans:
            if search.taken is None:
                ax.axvline(search.asked, color=colour, linewidth=_WIDTH, linestyle=_ONLY_ASKED, zorder=1.6)
                continue
            ax.axvspan(search.asked, search.taken, color=colour, alpha=_SHARE, linewidth=0.0, zorder=1.4)
            ax.axvline(search.taken, color=colour, linewidth=_WIDTH, zorder=1.6)
    if not result.replans:
        return []
    if any(search.taken is not None for search in result.replans):
        return [Line2D([], [], color=colour, linewidth=_WIDTH, label="new plan")]
    dots = Line2D([], [], color=colour, linewidth=_WIDTH, linestyle=_ONLY_ASKED, label="search for a plan")
    return [dots]


def beside(t: float, replans: Sequence[Replan], seconds: float) -> str:
    """What to say at an instant about the plan that was taken over in the last few seconds; often nothing."""
    reasons = [each.reason for each in replans if each.taken is not None and 0.0 <= t - each.taken < seconds]
    return f"new plan: {reasons[-1]}" if reasons else ""


def summary(result: Outcome) -> list[str]:
    """How many new plans there were, when and why, in sentences; none if the run follows no plan."""
    if result.q_plan is None:
        return []
    is_plan = not np.isnan(result.q_plan[:1]).any()
    if not result.replans:
        told = "follows its plan; no other" if is_plan else "follows its reference; no plan"
        return [f"The arm {told} was asked for."]
    taken = sum(each.taken is not None for each in result.replans)
    count = f"{taken or 'No'} {'new ' if is_plan else ''}plan{'' if taken == 1 else 's'}"
    rest = len(result.replans) - _MOST
    lines = [_told(each) for each in result.replans[:_MOST]]
    return [f"{count}: {'; '.join(lines)}{f'; and {rest} more' if rest > 0 else ''}."]


def _told(search: Replan) -> str:
    asked = f"asked for at {search.asked:.2f} s, as {_WHY.get(search.reason, search.reason)}"
    if search.taken is not None:
        return f"{asked}, taken over at {search.taken:.2f} s"
    return f"{asked}, but {'not in time' if search.status is None else search.status}"
