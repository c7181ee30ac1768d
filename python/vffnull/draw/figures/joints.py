"""What the joints do, and what drives them aside."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vffnull.draw import replans, style
from vffnull.draw.scene import ghost

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome


def joint_angles(result: Outcome) -> Figure:
    """Joint angles (Fig. 8)."""
    fig, (ax,) = style.panels(1, 2.5)
    more = [*angles(ax, result), *replans.mark([ax], result)]
    style.joint_key(fig, [ax], result.q.shape[1], "joint", more)
    return fig


def angles(ax: Axes, result: Outcome) -> list[Line2D]:
    """Lines of the joint angles, of joints that slide of their positions, and thin ones of a plan's.

    Returns what belongs into a legend beside the joints.
    """
    style.joint_lines(ax, result.t, result.q)
    plan: dict[str, Any] = {"linewidth": 0.8, "linestyle": (0, (4, 2))}
    planned = None if ghost(result) is None else result.q_plan
    if planned is not None:
        style.joint_lines(ax, result.t, planned, **plan)
    unit = result.layout.units("q", result.q.shape[1:])
    ax.set_ylabel(f"joint {'angle' if unit == 'rad' else 'position'} [{unit}]")
    return [] if planned is None else [Line2D([], [], color=style.INK, label="plan", **plan)]


def joint_torques(result: Outcome) -> Figure:
    """The torque that the controller commands of every joint."""
    fig, (ax,) = style.panels(1, 2.5)
    ax.axhline(0.0, color=style.MUTED, linewidth=0.6)
    style.joint_lines(ax, result.t, result.tau)
    ax.set_ylabel(f"joint torque [{result.layout.units('tau', result.tau.shape[1:])}]")
    style.joint_key(fig, [ax], result.q.shape[1], "joint", replans.mark([ax], result))
    return fig


def repulsive_torques(result: Outcome) -> Figure:
    """Repulsion on every joint, before its projection into the null space (Figs. 9, 13)."""
    fig, (ax,) = style.panels(1, 2.5)
    repulsion(ax, result)
    style.joint_key(fig, [ax], result.q.shape[1], "joint", replans.mark([ax], result))
    return fig


def repulsion(ax: Axes, result: Outcome) -> None:
    """Lines of the repulsive torque, one for each joint."""
    ax.axhline(0.0, color=style.MUTED, linewidth=0.6)
    style.joint_lines(ax, result.t, result.tau_vff)
    ax.set_ylabel(f"repulsive torque [{result.layout.units('tau_vff', result.tau_vff.shape[1:])}]")
