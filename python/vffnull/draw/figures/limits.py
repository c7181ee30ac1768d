"""How much of what the joints can do is used: angles, speeds and torques as shares of their limits."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vffnull.draw import style
from vffnull.model.headline import OVER

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

Array = NDArray[np.float64]

_ROUNDING = 1e-9  # the share of its range by which a joint at its stop may be off
_ROOM = 1.12  # up to which share a panel goes; farther where a limit is broken


@dataclass(frozen=True, eq=False)
class Use:
    """A quantity of the joints with its limits."""

    what: str
    name: str
    """That of the quantity in a result."""
    values: Array
    """Over time (T, n)."""
    bounds: Array
    """Lower and upper (n, 2); infinite where there is none."""

    @property
    def joints(self) -> list[int]:
        """Which ones are limited on both sides; an angle with one limit has no share."""
        return [int(i) for i in np.flatnonzero(np.isfinite(self.bounds).all(axis=1))]

    def shares(self, joint: int) -> Array:
        """From −1 at the lower limit to 1 at the upper one (T,)."""
        low, high = self.bounds[joint]
        found: Array = (2.0 * self.values[:, joint] - low - high) / (high - low)
        return found

    def nearest(self) -> tuple[int, float]:
        """The joint that comes nearest to one of its limits, as a share of them, and what is left there."""
        joint = max(self.joints, key=lambda i: float(np.nanmax(np.abs(self.shares(i)))))
        low, high = self.bounds[joint]
        left = np.minimum(self.values[:, joint] - low, high - self.values[:, joint])
        return joint, float(np.nanmin(left))


def uses(result: Outcome) -> list[Use]:
    """Everything of a run that has limits: angles, speeds, torques, as far as the arm has them."""
    arm = result.scenario.arm
    found = []
    if arm.joint_limits is not None:
        what = "position" if result.layout.slides else "angle"
        found.append(Use(what, "q", result.q, np.asarray(arm.joint_limits, dtype=float)))
    for what, name, values, most in (
        ("speed", "dq", result.dq, arm.velocity_limits),
        ("torque", "tau", result.tau, arm.torque_limits),
    ):
        if most is not None:
            bound = np.asarray(most, dtype=float)
            found.append(Use(what, name, values, np.column_stack([-bound, bound])))
    return [each for each in found if each.joints]


def limits(result: Outcome) -> Figure:
    """Every joint's angle, speed and torque between its limits, and where it comes nearest to one."""
    found = uses(result)
    fig, axes = style.panels(len(found), 0.75 + 1.25 * len(found))
    for ax, use in zip(axes, found, strict=True):
        _panel(ax, use, result)
    style.joint_key(fig, axes, result.q.shape[1], "joint")
    fig.align_ylabels(axes)
    return fig


def _panel(ax: Axes, use: Use, result: Outcome) -> None:
    colours = style.joint_colours(use.values.shape[1])
    most = 1.0
    for joint in use.joints:
        shares = use.shares(joint)
        most = max(most, float(np.nanmax(np.abs(shares))))
        ax.plot(result.t, shares, color=colours[joint], label=f"_{joint}")
    for side in (-1.0, 1.0):
        ax.axhline(side, color=style.ALARM, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1.5)
    ax.set_ylim(-_ROOM * most, _ROOM * most)
    sides = ["lower", "middle", "upper"] if use.name == "q" else ["−limit", "0", "limit"]
    ax.set_yticks([-1.0, 0.0, 1.0], sides)
    ax.set_ylabel(f"joint {use.what}")
    style.note(ax, _left(use, result))


def _left(use: Use, result: Outcome) -> str:
    """How near the nearest joint comes to its limit; held limits are exceeded by parts in ten thousand."""
    joint, left = use.nearest()
    low, high = use.bounds[joint]
    if abs(left) <= (OVER if use.name != "q" else _ROUNDING) * (high - low) / 2:
        return f"joint {joint}: at its limit"
    factor, unit = style.prefixed(abs(left), result.layout.unit(use.name, str(joint)))
    size = f"{factor * abs(left):.3g}" if abs(left) < 1e3 else f"{abs(left):.0f}"
    return f"joint {joint}: {size} {unit} {'left' if left >= 0.0 else 'beyond'}"
