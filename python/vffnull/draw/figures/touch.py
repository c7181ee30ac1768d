"""What touches the arm, as the controller estimates it, and what gives way."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vffnull.draw import style
from vffnull.draw.primitives import COLOURS

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome


def touch(result: Outcome) -> Figure:
    """The estimated torque from outside of every joint, the force of what is touched, and what gives way.

    While a contact is felt the background is shaded.
    """
    estimate, felt = result.tau_ext_estimate, result.touched_link
    force, yielded = result.contact_force, result.yielded
    assert estimate is not None
    fig, axes = style.panels(1 + (force is not None) + (yielded is not None), 3.2)
    rest = iter(axes[1:])
    style.joint_lines(axes[0], result.t, estimate)
    axes[0].set_ylabel("estimate [N·m]")
    if force is not None:
        ax = next(rest)
        ax.plot(result.t, np.linalg.norm(force, axis=2).sum(axis=1), color=COLOURS["wrench"])
        ax.set_ylabel("contact [N]")
        ax.set_ylim(bottom=0.0)
    if yielded is not None:
        ax = next(rest)
        ax.plot(result.t, 1e3 * yielded, color=style.INK)
        ax.set_ylabel("gives way [mm]")
        ax.set_ylim(bottom=0.0)
    if felt is not None:
        for ax in axes:
            _shade(ax, result, np.isfinite(felt))
    style.joint_key(fig, axes[:1], result.q.shape[1], "joint")
    fig.align_ylabels(axes)
    return fig


def _shade(ax: Axes, result: Outcome, felt: np.ndarray[tuple[int], np.dtype[np.bool_]]) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], felt, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2):
        ax.axvspan(result.t[begin], result.t[end - 1], color=COLOURS["wrench"], alpha=0.15, linewidth=0)
