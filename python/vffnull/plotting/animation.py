"""The arm in motion, as an animated GIF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from numpy.typing import NDArray
from PIL import Image

from vffnull.errors import InputError
from vffnull.plotting import geometry, strobe, style

if TYPE_CHECKING:
    from vffnull.result import Result

_DPI = 120
_ARM = "#0072B2"
_OBSTACLE = "#D55E00"


def animate(result: Result, path: Path, *, fps: float, speed: float) -> Path:
    """Write a film of a run; see `vffnull.Result.animate`.

    What stands still is drawn once; each frame restores it and draws the few things that move.
    """
    if path.suffix != ".gif":
        film = path.suffix in {".mp4", ".webm", ".mov", ".mkv", ".avi"}
        hint = "; films are for the extra vffnull[video], which is not there yet" if film else ""
        given = path.suffix or "without an ending"
        raise InputError(f"{path}: an animation is written as .gif, not {given}{hint}")
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name}: must be positive and finite, got {value}")

    result = geometry.drawable(result)
    begin, end = float(result.t[0]), float(result.t[-1])
    times = np.append(np.arange(begin, end, speed / fps), end)
    rows = np.minimum(np.searchsorted(result.t, times), len(result.t) - 1)
    with style.look():
        frames = _frames(result, rows)
    palette = frames[len(frames) // 2].quantize(colors=64, method=Image.Quantize.MAXCOVERAGE)
    indexed = [each.quantize(palette=palette, dither=Image.Dither.NONE) for each in frames]
    path.parent.mkdir(parents=True, exist_ok=True)
    pauses = [round(1000 / fps)] * (len(indexed) - 1) + [1000]
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=pauses, loop=0)
    return path


def _frames(result: Result, rows: NDArray[np.intp]) -> list[Image.Image]:
    """One picture for each recorded instant in `rows`."""
    height = strobe.natural_height(result, style.COLUMN)
    fig = style.figure(height)
    fig.set_dpi(_DPI)
    canvas: Any = fig.canvas  # Agg's blitting has no types
    ax = fig.subplots()
    strobe.stage(ax, result, height)
    follow = result.x_ref[:, :2]
    if np.ptp(follow, axis=0).max() > 0.0:
        ax.plot(*follow.T, color=style.MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)

    joints, radii = geometry.joints(result), geometry.link_radii(result)
    outlines = geometry.obstacle_outlines(result)
    solids = [strobe.solid(ax, points, _OBSTACLE, zorder=2) for points in outlines]
    bodies = [strobe.solid(ax, np.zeros((3, 2)), _ARM, zorder=3) for _ in radii[radii > 0.0]]
    (links,) = ax.plot(
        [],
        [],
        color=_ARM,
        linewidth=2.2 if not bodies else 1.0,
        marker="o",
        markersize=4,
        markerfacecolor="white",
        zorder=4,
    )
    (trail,) = ax.plot([], [], color=style.ALARM, linewidth=0.9, zorder=5)
    (target,) = ax.plot([], [], color=style.INK, marker="x", linestyle="none", markersize=5, zorder=6)
    clock = ax.text(1.0, 1.02, "", transform=ax.transAxes, ha="right", va="bottom")
    moving: list[Artist] = [*solids, *bodies, trail, links, target, clock]
    for artist in moving:
        artist.set_animated(True)

    canvas.draw()
    background = canvas.copy_from_bbox(fig.bbox)
    frames = []
    for row in rows:
        canvas.restore_region(background)
        for solid, points, place in zip(solids, outlines, result.obstacles[row], strict=True):
            solid.set_xy(points + place)
        place = joints[row]
        for body, i in zip(bodies, np.flatnonzero(radii > 0.0), strict=True):
            body.set_xy(geometry.capsule(place[i], place[i + 1], radii[i]))
        links.set_data(*place.T)
        trail.set_data(*result.x[: row + 1, :2].T)
        target.set_data(*follow[row : row + 1].T)
        clock.set_text(f"t = {result.t[row]:.1f} s")
        for artist in moving:
            ax.draw_artist(artist)
        frames.append(Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB"))
    return frames
