"""How near the obstacles come to the links, and how hard they push."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vffnull.draw import replans, style
from vffnull.draw.shapes import influence_of

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome


def forces(result: Outcome) -> Figure:
    """Magnitude of the repulsion on every link."""
    fig, (ax,) = style.panels(1, 2.5)
    style.joint_lines(ax, result.t, result.force)
    ax.set_ylabel("repulsive force [N]")
    ax.set_ylim(bottom=0.0)
    style.joint_key(fig, [ax], result.force.shape[1], "link", replans.mark([ax], result))
    return fig


def clearance(result: Outcome) -> Figure:
    """Distance of every link to the nearest obstacle."""
    fig, (ax,) = style.panels(1, 2.5)
    distances(ax, result)
    style.joint_key(fig, [ax], result.clearance.shape[1], "link", replans.mark([ax], result))
    return fig


def distances(ax: Axes, result: Outcome) -> None:
    """Lines of the clearance, one for each link, with the levels that matter."""
    style.joint_lines(ax, result.t, result.clearance)
    low = min(0.0, float(np.nanmin(result.clearance)))
    high = float(np.nanmax(result.clearance))
    reach = influence_of(result.scenario.to_dict())
    if reach:
        high = min(high, 3.0 * reach)
        style.level(ax, reach, "$d_s$")
    style.level(ax, 0.0, "contact", colour=style.ALARM)
    span = high - low
    ax.set_ylim(low - 0.06 * span, high + 0.06 * span)
    if low < 0.0:
        ax.axhspan(low - 0.06 * span, 0.0, color=style.ALARM, alpha=0.08, linewidth=0)
    ax.set_ylabel("clearance [m]")
