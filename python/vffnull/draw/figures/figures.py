"""Every figure of a run by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from matplotlib.figure import Figure

from vffnull._support.errors import InputError
from vffnull._support.figures import FIGURE_ENDINGS, is_file
from vffnull._support.files import replacing
from vffnull.draw import style
from vffnull.draw.figures import joints, limits, links, null_space, overview, sensed, strobe, touch, tracking
from vffnull.draw.scene import drawable

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

FIGURES: dict[str, Callable[[Outcome], Figure]] = {
    "overview": overview.overview,
    "strobe": strobe.strobe,
    "tracking": tracking.tracking,
    "tracking_error": tracking.tracking_error,
    "joint_angles": joints.joint_angles,
    "joint_torques": joints.joint_torques,
    "limits": limits.limits,
    "null_space": null_space.null_space,
    "repulsive_torques": joints.repulsive_torques,
    "forces": links.forces,
    "clearance": links.clearance,
    "sensed": sensed.sensed,
    "touch": touch.touch,
}
"""In the order in which they are drawn."""

_ABOUT_OBSTACLES = {"repulsive_torques", "forces", "clearance"}


def draw(result: Outcome) -> dict[str, Figure]:
    """Draw every figure that says something about a run, by name."""
    return dict(_figures(result))


def save(result: Outcome, directory: Path, ending: str = ".png") -> list[Path]:
    """Draw every figure and write each to a file of its name, or the overview to one; returns the files."""
    if ending not in FIGURE_ENDINGS:
        raise InputError(f"figures are written as {', '.join(FIGURE_ENDINGS)}, not {ending}")
    if is_file(directory):
        directory.parent.mkdir(parents=True, exist_ok=True)
        with style.look(), replacing(directory) as draft:
            overview.overview(drawable(result)).savefig(draft)
        return [directory]
    directory.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, figure in _figures(result):
        path = directory / f"{name}{ending}"
        with style.look(), replacing(path) as draft:
            figure.savefig(draft)
        paths.append(path)
    return paths


def _figures(result: Outcome) -> Iterator[tuple[str, Figure]]:
    result = drawable(result)
    for name, make in FIGURES.items():
        if name in _ABOUT_OBSTACLES and not result.obstacles.shape[1]:
            continue
        if name == "sensed" and result.sensed is None:
            continue
        if name == "touch" and result.tau_ext_estimate is None:
            continue
        if name == "limits" and not limits.uses(result):
            continue
        if name == "null_space" and result.error.shape[1] >= result.q.shape[1]:
            continue
        with style.look():
            figure = make(result)
        yield name, figure
