"""The motion that the task leaves free: what the joints do in the null space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vffnull.draw import style
from vffnull.model.settings import setting

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

Array = NDArray[np.float64]


def null_space(result: Outcome) -> Figure:
    """Joint speeds in the null space, what they add up to, and how much of the kinetic energy that is."""
    speeds, energies = motion(result)
    steps = np.diff(result.t)[:, None] * (speeds[1:] + speeds[:-1]) / 2.0
    travelled = np.vstack([np.zeros(speeds.shape[1]), np.cumsum(steps, axis=0)])
    fig, axes = style.panels(3, 4.3)
    shape = speeds.shape[1:]
    for ax, values, what, name in (
        (axes[0], travelled, "null motion", "q"),
        (axes[1], speeds, "null speed", "dq"),
    ):
        ax.axhline(0.0, color=style.MUTED, linewidth=0.6)
        style.joint_lines(ax, result.t, values)
        ax.set_ylabel(f"{what}\n[{result.layout.units(name, shape)}]")
        ax.margins(y=0.08)
    total = result.energy[:, 0]
    factor, unit = style.prefixed(float(np.nanmax(np.concatenate([total, energies]), initial=0.0)), "J")
    axes[2].fill_between(
        result.t, 0.0, factor * total, color=style.MUTED, alpha=0.25, linewidth=0, label="whole arm"
    )
    axes[2].plot(result.t, factor * energies, color=style.INK, label="null space")
    axes[2].set_ylabel(f"kinetic energy\n[{unit}]")
    axes[2].set_ylim(bottom=0.0)
    axes[2].legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
    style.joint_key(fig, axes[:2], result.q.shape[1], "joint")
    fig.align_ylabels(axes)
    return fig


def motion(result: Outcome) -> tuple[Array, Array]:
    """The part N q̇ of the joint velocities (T, n) that leaves the task alone, and its energy (T,) [J].

    N = 1 − M⁻¹Jᵀ Λ J is the projector of the law, (T3); in a singularity of the task, where Λ has no value,
    what J moves is taken out as far as it can be told.
    """
    arm, task = result.scenario.arm, setting(result.scenario.to_dict(), "controller.task")
    speeds = np.empty_like(result.dq)
    energies = np.empty(len(result.t))
    for row, (q, dq) in enumerate(zip(result.q, result.dq, strict=True)):
        rows = _rows(arm.jacobian(q), task, arm.pose(q)[1] if task == "pointing" else None)
        mass = arm.mass_matrix(q)
        lift = np.linalg.solve(mass, rows.T)
        speeds[row] = dq - lift @ np.linalg.lstsq(rows @ lift, rows @ dq, rcond=1e-12)[0]
        energies[row] = speeds[row] @ mass @ speeds[row] / 2.0
    return speeds, energies


def _rows(jacobian: Array, task: str, orientation: Array | None) -> Array:
    """The rows of J (m, n) that a task asks for: in the plane its pose also turns with every joint."""
    if len(jacobian) == 2:
        return jacobian if task == "position" else np.vstack([jacobian, np.ones(jacobian.shape[1])])
    if task == "position":
        return jacobian[:3]
    if task == "pose":
        return jacobian
    assert orientation is not None
    from vffnull._core import matrices

    return np.vstack([jacobian[:3], matrices(orientation)[:, :2].T @ jacobian[3:]])
