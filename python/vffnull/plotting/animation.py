"""The arm in motion, as an animated GIF or as an MP4 film.

What stands still is drawn once; every frame restores it and draws the few things that move. Frames are made
when the writer asks for them, so that a long film needs no more memory than a short one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from numpy.typing import NDArray
from PIL import Image

from vffnull.errors import InputError
from vffnull.logs import extra
from vffnull.plotting import geometry, strobe, style

if TYPE_CHECKING:
    from vffnull.result import Result

ENDINGS = (".gif", ".mp4")

_WIDTH, _DPI = 5.4, 120  # [in], dots per inch: 648 dots across
_ARM = "#0072B2"
_OBSTACLE = "#D55E00"
_FORCE = "#B2182B"
_LONGEST = 0.11  # of the picture's width, the arrow of the greatest force

Progress = Callable[[float, float], None]
Rows = NDArray[np.intp]


def animate(
    result: Result, path: Path, *, fps: float, speed: float, progress: Progress | None = None
) -> Path:
    """Write a film of a run; see `vffnull.Result.animate`. `progress` gets frames done and frames in all."""
    check(path, fps, speed)
    result = geometry.drawable(result)
    rows = frames(result, fps, speed)
    write = _write_gif if path.suffix == ".gif" else _write_mp4
    encoder = None if path.suffix == ".gif" else extra("imageio_ffmpeg", "video")
    path.parent.mkdir(parents=True, exist_ok=True)
    with style.look():
        write(_Picture(result, rows, speed), path, fps, progress or (lambda _done, _all: None), encoder)
    return path


def check(path: Path, fps: float, speed: float) -> None:
    """Refuse what no film can be made of."""
    if path.suffix not in ENDINGS:
        given = path.suffix or "without an ending"
        raise InputError(f"{path}: an animation is written as {' or '.join(ENDINGS)}, not {given}")
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name}: must be positive and finite, got {value}")


def frames(result: Result, fps: float, speed: float) -> Rows:
    """The recorded instants that a film shows, the last one included."""
    begin, end = float(result.t[0]), float(result.t[-1])
    times = np.append(np.arange(begin, end, speed / fps), end)
    return np.minimum(np.searchsorted(result.t, times), len(result.t) - 1)


def _write_gif(picture: _Picture, path: Path, fps: float, progress: Progress, _encoder: Any) -> None:
    """All frames share one palette, so that the file stays small and colours do not flicker."""
    count = len(picture)
    typical = np.unique([*range(0, count, max(1, count // 6)), picture.strongest])
    mosaic = Image.fromarray(np.vstack([picture.at(i) for i in typical]))
    palette = mosaic.quantize(colors=128, method=Image.Quantize.MAXCOVERAGE)

    def indexed() -> Iterator[Image.Image]:
        for i in range(count):
            yield Image.fromarray(picture.at(i)).quantize(palette=palette, dither=Image.Dither.NONE)
            progress(i + 1, count)

    film = indexed()
    pauses = [round(1000 / fps)] * (count - 1) + [1000]
    next(film).save(path, save_all=True, append_images=film, duration=pauses, loop=0)


def _write_mp4(picture: _Picture, path: Path, fps: float, progress: Progress, encoder: Any) -> None:
    """H.264 in the pixel format that every player knows, which wants even sizes."""
    high, wide = (size // 2 * 2 for size in picture.at(0).shape[:2])
    film = encoder.write_frames(str(path), (wide, high), fps=fps, quality=8, macro_block_size=2)
    film.send(None)
    try:
        for i in range(len(picture)):
            film.send(np.ascontiguousarray(picture.at(i)[:high, :wide]))
            progress(i + 1, len(picture))
    finally:
        film.close()


class _Picture:
    """The frames of a film, each an array of dots (height, width, 3)."""

    def __init__(self, result: Result, rows: Rows, speed: float) -> None:
        self._result, self._rows = result, rows
        self._points, self._forces = geometry.pushes(result, rows)
        sizes = np.linalg.norm(self._forces, axis=2).max(axis=1)
        self.strongest = int(sizes.argmax())
        self._speed = "" if speed == 1.0 else f"  ({speed:g}×)"
        height = strobe.natural_height(result, _WIDTH)
        self._figure = style.figure(height, _WIDTH)
        self._figure.set_dpi(_DPI)
        canvas: Any = self._figure.canvas  # Agg's blitting has no types
        self._canvas = canvas
        ax = self._axes = self._figure.subplots()
        strobe.stage(ax, result, height, _WIDTH)
        left, right = ax.get_xlim()
        self._scale = _LONGEST * (right - left) / (float(sizes.max()) or 1.0)  # m/N
        self._wide = right - left

        self._joints, self._radii = geometry.joints(result), geometry.link_radii(result)
        self._outlines = geometry.obstacle_outlines(result)
        follow = self._follow = result.x_ref[:, :2]
        if np.ptp(follow, axis=0).max() > 0.0:
            ax.plot(*follow.T, color=style.MUTED, linewidth=0.8, linestyle=(0, (4, 2)), zorder=1)
        field = result.scenario.to_dict().get("controller", {}).get("field", {})
        reach = float(field["influence"]) if field.get("gain") else None
        self._reach = [] if reach is None else geometry.obstacle_outlines(result, margin=reach)
        self._halos = PolyCollection(
            [],
            facecolors="none",
            edgecolors=[to_rgba(_OBSTACLE, 0.45)],
            linewidths=0.7,
            linestyles=[(0, (1, 2.5))],
            zorder=1.5,
        )
        self._solids = PolyCollection(
            [], facecolors=[to_rgba(_OBSTACLE, 0.15)], edgecolors=[_OBSTACLE], linewidths=1.0, zorder=2
        )
        self._bodies = PolyCollection(
            [], facecolors=[to_rgba(_ARM, 0.25)], edgecolors=[_ARM], linewidths=0.9, zorder=3
        )
        self._arrows = LineCollection([], colors=[_FORCE], linewidths=1.6, zorder=5, capstyle="round")
        self._heads = PolyCollection([], facecolors=[_FORCE], edgecolors=[_FORCE], linewidths=0.4, zorder=5)
        for collection in (self._halos, self._solids, self._bodies, self._arrows, self._heads):
            ax.add_collection(collection, autolim=False)
        thick = self._radii.max() > 0.0
        (self._links,) = ax.plot(
            [],
            [],
            color=_ARM,
            linewidth=1.0 if thick else 2.6,
            marker="o",
            markersize=4.5,
            markerfacecolor="white",
            zorder=4,
        )
        (self._trail,) = ax.plot([], [], color="#009E73", linewidth=1.4, zorder=4.5)
        (self._target,) = ax.plot(
            [], [], color=style.INK, marker="x", linestyle="none", markersize=6, zorder=6
        )
        self._clock = ax.text(1.0, 1.015, "", transform=ax.transAxes, ha="right", va="bottom")
        ax.text(0.0, 1.015, result.scenario.name, transform=ax.transAxes, ha="left", va="bottom")
        self._moving: list[Artist] = [
            self._halos,
            self._solids,
            self._bodies,
            self._links,
            self._trail,
            self._arrows,
            self._heads,
            self._target,
            self._clock,
        ]
        for artist in self._moving:
            artist.set_animated(True)
        canvas.draw()
        self._background = canvas.copy_from_bbox(self._figure.bbox)

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, frame: int) -> NDArray[np.uint8]:
        """One frame."""
        result, row = self._result, self._rows[frame]
        place = self._joints[row]
        self._canvas.restore_region(self._background)
        places = result.obstacles[row]
        self._halos.set_verts([points + at for points, at in zip(self._reach, places, strict=False)])
        self._solids.set_verts([points + at for points, at in zip(self._outlines, places, strict=True)])
        thick = np.flatnonzero(self._radii > 0.0)
        self._bodies.set_verts([geometry.capsule(place[i], place[i + 1], self._radii[i]) for i in thick])
        self._links.set_data(*place.T)
        self._trail.set_data(*result.x[: row + 1, :2].T)
        self._target.set_data(*self._follow[row : row + 1].T)
        self._draw_forces(frame)
        self._clock.set_text(f"t = {result.t[row]:.2f} s{self._speed}")
        for artist in self._moving:
            self._axes.draw_artist(artist)
        dots: NDArray[np.uint8] = np.asarray(self._canvas.buffer_rgba())[..., :3].copy()
        return dots

    def _draw_forces(self, frame: int) -> None:
        shafts = self._forces[frame] * self._scale
        lengths = np.linalg.norm(shafts, axis=1)
        seen = lengths > 0.004 * self._wide
        tails, shafts, lengths = self._points[frame][seen], shafts[seen], lengths[seen][:, None]
        tips = tails + shafts
        self._arrows.set_segments(list(np.stack([tails, tips], axis=1)))
        along = shafts / lengths * np.minimum(0.5 * lengths, 0.02 * self._wide)
        across = 0.5 * along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        heads = np.stack([tips + 0.4 * along, tips - along + across, tips - along - across], axis=1)
        self._heads.set_verts(list(heads))
