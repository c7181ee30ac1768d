"""How well the end effector follows its reference."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter
from numpy.typing import NDArray

from vffnull._core import matrices, quaternions
from vffnull.draw import released, replans, style

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

_SYMBOLS = {
    "x": "x", "y": "y", "z": "z", "phi": r"\varphi", "rx": r"\theta_x", "ry": r"\theta_y", "rz": r"\theta_z",
}  # fmt: skip
_ACTUAL = "#0072B2"
_AXIS_COLOURS = ("#0072B2", "#D55E00", "#009E73")
_AXIS_DASHES = ("-", "--", "-.")  # two axes often run on top of each other
_TURNED = "#CC79A7"


def tracking(result: Outcome) -> Figure:
    """Every axis of the task: reference and actual (Figs. 5, 6, 10, 11 of the paper).

    In space an orientation stands below: of a pose the rotation since the start, as a vector in world axes,
    of pointing the direction of the tool's axis.
    """
    names = _places(result)
    turns = result.layout.dimension == 3 and bool(_turns(result))
    count = len(names) + turns
    fig, axes = style.panels(count, 1.0 + 1.1 * count)
    for i, (ax, name) in enumerate(zip(axes, names, strict=False)):
        ax.plot(result.t, result.x[:, i], color=_ACTUAL, linewidth=1.6, label="actual")
        ax.plot(
            result.t, result.x_ref[:, i], color=style.INK, linestyle="--", linewidth=0.9, label="reference"
        )
        ax.set_ylabel(f"${_SYMBOLS[name]}$ [{result.layout.unit('x', name)}]")
        ax.margins(y=0.08)
        _open_if_flat(ax, result.x[:, i])
    if turns:
        _orientation(axes[-1], result)
    shown = [*axes[0].get_legend_handles_labels()[0], *replans.mark(axes, result)]
    fig.legend(handles=shown, loc="outside upper center", ncols=len(shown))
    fig.align_ylabels(axes)
    return fig


def _orientation(ax: Axes, result: Outcome) -> None:
    """Orientation and reference, three numbers each."""
    assert result.orientation is not None and result.orientation_ref is not None
    actual, wanted = matrices(result.orientation), matrices(result.orientation_ref)
    if len(_turns(result)) == 2:
        values, references = actual[..., 2], wanted[..., 2]
        symbols, label = ("a_x", "a_y", "a_z"), "tool axis [–]"
    else:
        values, references = (rotation_vectors(each @ wanted[0].T) for each in (actual, wanted))
        symbols, label = (r"\theta_x", r"\theta_y", r"\theta_z"), "rotation [rad]"
    for i, symbol in enumerate(symbols):
        ax.plot(result.t, values[:, i], color=_AXIS_COLOURS[i], linewidth=1.6, label=f"${symbol}$")
        ax.plot(result.t, references[:, i], color=style.INK, linestyle="--", linewidth=0.9)
    ax.set_ylabel(label)
    ax.margins(y=0.08)
    _open_if_flat(ax, values)
    ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)


def rotation_vectors(turns: NDArray[np.float64]) -> NDArray[np.float64]:
    """The vectors (T, 3) [rad] of rotations (T, 3, 3) that follow one another, also beyond a half turn.

    A rotation has one vector of at most a half turn; others differ from it by whole turns about the same
    axis. The one nearest to its predecessor is taken, so that the vector does not jump where the tool does
    not.
    """
    parts = quaternions(turns)
    lengths = np.linalg.norm(parts[:, 1:], axis=1)
    angles = 2.0 * np.arctan2(lengths, parts[:, 0])
    small = lengths < 1e-12  # its axis does not matter, but there has to be one
    axes = np.where(small[:, None], [0.0, 0.0, 1.0], parts[:, 1:] / np.where(small, 1.0, lengths)[:, None])
    found = angles[:, None] * axes
    for i in range(1, len(found)):
        whole = np.rint((found[i - 1] @ axes[i] - angles[i]) / (2.0 * np.pi))
        if whole:
            found[i] += 2.0 * np.pi * whole * axes[i]
    return np.asarray(found)


def tracking_error(result: Outcome) -> Figure:
    """The error by axis, and its magnitude on a logarithmic scale (Figs. 7, 12)."""
    if result.layout.dimension == 3 and _turns(result):
        return _pose_error(result)
    fig, (top, bottom) = style.panels(2, 3.1)
    lengths = _lengths(result)
    factor, units = style.prefixed(float(np.nanmax(np.abs(result.error[:, lengths]))), "m")
    for i, name in enumerate(_axes(result)):
        scale, axis_unit = (factor, units) if i in lengths else (1.0, result.layout.unit("error", name))
        label = f"$e_{_SYMBOLS[name]}$ [{axis_unit}]"
        top.plot(
            result.t,
            scale * result.error[:, i],
            color=_AXIS_COLOURS[i],
            linestyle=_AXIS_DASHES[i],
            label=label,
        )
    top.set_ylabel(f"error [{units}]")
    top.margins(y=0.08)
    error_magnitude(bottom, result)
    shown = [*top.get_legend_handles_labels()[0], *_marks([top, bottom], result)]
    fig.legend(handles=shown, loc="outside upper center", ncols=max(len(shown), 3))
    fig.align_ylabels([top, bottom])
    return fig


def _pose_error(result: Outcome) -> Figure:
    """Position and orientation have a panel each, and lines of their own in that of the magnitudes."""
    fig, (top, middle, bottom) = style.panels(3, 4.3)
    _components(top, result, _lengths(result), "m", "position error")
    _components(middle, result, _turns(result), "rad", "rotation error")
    error_magnitude(bottom, result)
    for ax in (top, middle):
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, borderaxespad=0.1)
    if more := _marks([top, middle, bottom], result):
        fig.legend(handles=more, loc="outside lower center")
    fig.align_ylabels([top, middle, bottom])
    return fig


def _marks(axes: list[Axes], result: Outcome) -> list[Artist]:
    """New plans, and what is let go; returns what belongs into a legend."""
    return [*replans.mark(axes, result), *released.mark(axes, result)]


def _components(ax: Axes, result: Outcome, which: list[int], unit: str, what: str) -> None:
    """The error along some axes, which share a unit."""
    factor, units = style.prefixed(float(np.nanmax(np.abs(result.error[:, which]))), unit)
    names = _axes(result)
    for number, i in enumerate(which):
        ax.plot(
            result.t,
            factor * result.error[:, i],
            color=_AXIS_COLOURS[number],
            linestyle=_AXIS_DASHES[number],
            label=f"$e_{{{_SYMBOLS[names[i]]}}}$",
        )
    ax.set_ylabel(f"{what}\n[{units}]")
    ax.margins(y=0.08)


def error_magnitude(ax: Axes, result: Outcome) -> None:
    """The distance between end effector and reference on a logarithmic scale, in space also the angle."""
    size = distance(result)
    ax.semilogy(result.t, np.maximum(size, style.ROUNDING), color=style.INK, label="position")
    ax.set_ylabel("$|e|$ [m]")
    sizes = [size]
    if result.layout.dimension == 3 and _turns(result):
        turned = angle(result)
        ax.semilogy(
            result.t, np.maximum(turned, style.ROUNDING), color=_TURNED, linestyle="--", label="orientation"
        )
        ax.set_ylabel("$|e|$ [m, rad]")
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2, borderaxespad=0.1)
        sizes.append(turned)
    low, high = decades(np.concatenate(sizes))
    ax.set_ylim(low, high)
    ax.yaxis.set_major_locator(LogLocator(numticks=6))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if low <= style.ROUNDING:
        style.note(ax, "bottom: rounding")


def distance(result: Outcome) -> NDArray[np.float64]:
    """How far the end effector is from its reference (T,) [m], whatever its orientation."""
    return np.asarray(np.linalg.norm(result.error[:, _lengths(result)], axis=1))


def angle(result: Outcome) -> NDArray[np.float64]:
    """By how much the end effector is turned from its reference (T,) [rad], as far as the task cares."""
    return np.asarray(np.linalg.norm(result.error[:, _turns(result)], axis=1))


def _axes(result: Outcome) -> list[str]:
    """Names of the task's axes."""
    return [str(name) for name in result.layout.labels("task", result.error.shape[1])]


def _places(result: Outcome) -> list[str]:
    """Names of the axes along which `Result.x` is recorded."""
    over = result.layout.quantities["x"].over[0]
    return [str(name) for name in result.layout.labels(over, result.x.shape[1])]


def _lengths(result: Outcome) -> list[int]:
    """Which axes of the task are lengths."""
    return [i for i, name in enumerate(_axes(result)) if result.layout.unit("error", name) == "m"]


def _turns(result: Outcome) -> list[int]:
    """Which axes of the task are angles."""
    return [i for i, name in enumerate(_axes(result)) if result.layout.unit("error", name) == "rad"]


def decades(sizes: NDArray[np.float64]) -> tuple[float, float]:
    """The limits of a logarithmic axis for distances [m]: whole decades, none below that of rounding."""
    known = sizes[np.isfinite(sizes)]
    low = max(float(np.percentile(known, 1)), style.ROUNDING) if known.size else style.ROUNDING
    high = max(float(known.max(initial=0.0)), 10.0 * low)
    return float(10.0 ** np.floor(np.log10(low) + 1e-9)), float(10.0 ** np.ceil(np.log10(high) + 0.05))


def _open_if_flat(ax: Axes, values: NDArray[np.float64]) -> None:
    """Keep a panel from blowing up rounding errors to its full height."""
    middle, least = float(np.mean(values)), 0.05
    if float(np.ptp(values)) < least:
        ax.set_ylim(middle - least, middle + least)
        ax.ticklabel_format(axis="y", useOffset=False)
