"""What the joints do, and what drives them aside."""

from __future__ import annotations

from typing import TYPE_CHECKING

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vffnull.plotting import style

if TYPE_CHECKING:
    from vffnull.result import Result


def joint_angles(result: Result) -> Figure:
    """Joint angles (Fig. 8)."""
    fig, (ax,) = style.panels(1, 2.5)
    angles(ax, result)
    style.joint_key(fig, [ax], result.q.shape[1], "joint")
    return fig


def angles(ax: Axes, result: Result) -> None:
    """Lines of the joint angles, of joints that slide of their positions."""
    style.joint_lines(ax, result.t, result.q)
    unit = result.layout.units("q", result.q.shape[1:])
    ax.set_ylabel(f"joint {'angle' if unit == 'rad' else 'position'} [{unit}]")


def joint_torques(result: Result) -> Figure:
    """The torque that the controller commands of every joint."""
    fig, (ax,) = style.panels(1, 2.5)
    ax.axhline(0.0, color=style.MUTED, linewidth=0.6)
    style.joint_lines(ax, result.t, result.tau)
    ax.set_ylabel(f"joint torque [{result.layout.units('tau', result.tau.shape[1:])}]")
    style.joint_key(fig, [ax], result.q.shape[1], "joint")
    return fig


def repulsive_torques(result: Result) -> Figure:
    """Repulsion on every joint, before its projection into the null space (Figs. 9, 13)."""
    fig, (ax,) = style.panels(1, 2.5)
    repulsion(ax, result)
    style.joint_key(fig, [ax], result.q.shape[1], "joint")
    return fig


def repulsion(ax: Axes, result: Result) -> None:
    """Lines of the repulsive torque, one for each joint."""
    ax.axhline(0.0, color=style.MUTED, linewidth=0.6)
    style.joint_lines(ax, result.t, result.tau_vff)
    ax.set_ylabel(f"repulsive torque [{result.layout.units('tau_vff', result.tau_vff.shape[1:])}]")
