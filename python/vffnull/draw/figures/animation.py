"""The arm in motion, as an animated GIF or as an MP4 film.

What stands still is drawn once; every frame restores it and draws the few things that move. Frames are made
when the writer asks for them, so that a long film needs no more memory than a short one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, Protocol

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from numpy.typing import NDArray
from PIL import Image

from vffnull._support.arguments import array, whole, within
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.files import replacing
from vffnull.draw import geometry, replans, style
from vffnull.draw.figures import canvas, strobe
from vffnull.draw.primitives import COLOURS, Arrow, Body, Curve, Marks, Role
from vffnull.draw.scene import Scene, drawable

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

ENDINGS = (".gif", ".mp4")
SIZES = (160, 3840)
"""The narrowest and the widest film [dots]."""
VIEWS = {
    "front": (0.0, 0.0),
    "left": (90.0, 0.0),
    "back": (180.0, 0.0),
    "right": (-90.0, 0.0),
    "top": (-90.0, 90.0),
}
"""By name: azimuth and elevation of who looks [degrees], the arm reaching towards the front."""
View = str | tuple[float, float]

_WIDTH, _DPI = 5.4, 120  # [in], dots per inch: 648 dots across
_LONGEST = 0.11  # of the picture's width, the arrow of the greatest force
_BAYER = np.rint(
    6.0 * (np.array([[0, 8, 2, 10], [12, 4, 14, 6], [3, 11, 1, 9], [15, 7, 13, 5]]) / 16.0 - 15.0 / 32.0)
).astype(np.int16)  # in shades of 256
_LEAST = 0.004  # of the picture's width, the shortest arrow that is drawn

_GIF_RATES, _RATES = (0.01, 50), (0.01, 1000)
"""Frames a second: one of a GIF lasts whole hundredths of a second, two of them at least."""
_MOST = 100_000

Progress = Callable[[float, float], None]
Rows = NDArray[np.intp]


def animate(
    result: Outcome,
    path: Path,
    *,
    fps: float,
    speed: float,
    size: int | None = None,
    view: View | None = None,
    progress: Progress | None = None,
) -> Path:
    """Write a film of a run; see `vffnull.Result.animate`. `progress` gets frames done and frames in all."""
    check(path, fps, speed, size, view)
    result = drawable(result)
    rows = frames(result, fps, speed)
    report = progress or (lambda _done, _all: None)
    encoder = None if path.suffix == ".gif" else extra("imageio_ffmpeg", "video")
    path.parent.mkdir(parents=True, exist_ok=True)
    with style.look(), replacing(path) as draft:
        picture = frames_of(result, rows, speed, size, view)
        if encoder is None:
            with draft.open("wb") as file:
                _write_gif(picture, file, fps, report)
        else:
            _write_mp4(picture, draft, fps, report, encoder)
    return path


def check(path: Path, fps: float, speed: float, size: int | None = None, view: View | None = None) -> None:
    """Refuse what no film can be made of."""
    if path.suffix not in ENDINGS:
        given = path.suffix or "without an ending"
        raise InputError(f"{path}: an animation is written as {' or '.join(ENDINGS)}, not {given}")
    for name, value in (("fps", fps), ("speed", speed)):
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name}: must be positive and finite, got {value}")
    least, most = _GIF_RATES if path.suffix == ".gif" else _RATES
    if not least <= fps <= most:
        raise InputError(f"fps: a {path.suffix} has {least} to {most} frames a second, got {fps:g}")
    if size is not None:
        whole("size", size, *SIZES)
    if view is not None:
        angles(view)


def angles(view: View) -> tuple[float, float]:
    """From where a film looks at a scene in space: azimuth and elevation [degrees]."""
    if isinstance(view, str):
        if view not in VIEWS:
            raise InputError(f"view: expected {', '.join(VIEWS)} or (azimuth, elevation), got {view!r}")
        return VIEWS[view]
    found = [float(each) for each in array("view", view, (2,))]
    return found[0], within("view elevation", found[1], -90.0, 90.0)


def frames(result: Outcome, fps: float, speed: float) -> Rows:
    """The recorded instants that a film shows, the last one included."""
    begin, end = float(result.t[0]), float(result.t[-1])
    if (end - begin) * fps > _MOST * speed:
        raise InputError(
            f"fps, speed: {(end - begin) / speed * fps:.3g} frames, and at most {_MOST} make a film"
        )
    times = np.append(np.arange(begin, end, speed / fps), end)
    return np.minimum(np.searchsorted(result.t, times), len(result.t) - 1)


def frames_of(
    result: Outcome, rows: Rows, speed: float, size: int | None = None, view: View | None = None
) -> Picture:
    """The frames of a film in the plane or in space."""
    scene = Scene.of_result(result)
    if scene.dimension == 3:
        from vffnull.draw.figures.film import SpacePicture

        return SpacePicture(result, scene, rows, speed, size, None if view is None else angles(view))
    if view is not None:
        raise InputError("view: a scene in the plane has but one")
    return _Picture(result, rows, speed, size)


class Picture(Protocol):
    """The frames of a film, each an array of dots (height, width, 3)."""

    strongest: int
    """The frame with the greatest force."""
    shaded: bool
    """Whether there is light and shadow, which takes more colours than a drawing has."""

    def __len__(self) -> int: ...

    def at(self, frame: int) -> NDArray[np.uint8]:
        """One frame."""
        ...

    def each(self, frames: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """Frames one after the other, on as many cores as help."""
        ...


def _write_gif(picture: Picture, file: IO[bytes], fps: float, progress: Progress) -> None:
    """All frames share one palette, so that the file stays small and colours do not flicker."""
    count = len(picture)
    typical = np.unique([*range(0, count, max(1, count // 6)), picture.strongest])
    drawn = dict(zip(map(int, typical), picture.each(map(int, typical)), strict=True))
    mosaic = np.vstack(list(drawn.values()))
    if picture.shaded:
        palette = _even_palette(mosaic)
    else:
        palette = Image.fromarray(mosaic).quantize(colors=128, method=Image.Quantize.MAXCOVERAGE)

    def indexed() -> Iterator[Image.Image]:
        rest = picture.each(i for i in range(count) if i not in drawn)
        for i in range(count):
            dots = drawn[i] if i in drawn else next(rest)
            dots = _dithered(dots) if picture.shaded else dots
            yield Image.fromarray(dots).quantize(palette=palette, dither=Image.Dither.NONE)
            progress(i + 1, count)

    images = indexed()
    # Whole hundredths of a second, so that all frames together last as long as they should.
    ends = np.rint(100.0 / fps * np.arange(count)).astype(int)
    pauses = [*map(int, 10 * np.diff(ends)), 1000]
    next(images).save(file, format="GIF", save_all=True, append_images=images, duration=pauses, loop=0)


def _even_palette(dots: NDArray[np.uint8]) -> Image.Image:
    """255 colours and white for shaded dots (h, w, 3): a shade that covers much gets more of them, but not by
    as much as it covers.
    """
    red, green, blue = np.moveaxis(dots >> 3, -1, 0).astype(np.int32)
    many = np.bincount((red << 10 | green << 5 | blue).ravel(), minlength=1 << 15)
    (used,) = np.nonzero(many)
    cells, counts = np.stack([used >> 10, used >> 5 & 31, used & 31], axis=1), many[used]
    cells, counts = cells[cells.min(axis=1) < 31], counts[cells.min(axis=1) < 31]  # white has its own
    weights = np.clip(np.ceil(np.sqrt(counts) / 4.0).astype(int), 1, 40)
    drawn = np.repeat(cells << 3 | 4, weights, axis=0).astype(np.uint8)
    found = Image.fromarray(drawn[None]).quantize(255, method=Image.Quantize.MEDIANCUT, kmeans=3)
    colours = (found.getpalette() or [])[: 3 * 255]
    palette = Image.new("P", (1, 1))
    palette.putpalette([*colours, *[255] * (768 - len(colours))])
    return palette


def _dithered(dots: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Shades that a palette will cut into steps, with a pattern (Bayer's) that blurs these; it stands still,
    so that nothing flickers. White stays white.
    """
    high, wide, _ = dots.shape
    pattern = np.tile(_BAYER, (high // 4 + 1, wide // 4 + 1))[:high, :wide, None]
    found: NDArray[np.uint8] = np.clip(dots + pattern, 0, 254).astype(np.uint8)
    found[dots == 255] = 255
    return found


def _write_mp4(picture: Picture, path: Path, fps: float, progress: Progress, encoder: Any) -> None:
    """H.264 in the pixel format that every player knows, which wants even sizes."""
    frames = iter(picture.each(range(len(picture))))
    first = next(frames)  # before there is an encoder, which tells of films that end without one
    high, wide = (size // 2 * 2 for size in first.shape[:2])
    stream = encoder.write_frames(str(path), (wide, high), fps=fps, quality=8, macro_block_size=2)
    stream.send(None)
    try:
        for i, dots in enumerate(chain([first], frames)):
            stream.send(np.ascontiguousarray(dots[:high, :wide]))
            progress(i + 1, len(picture))
    finally:
        stream.close()


class _Picture:
    """The frames of a film, each an array of dots (height, width, 3)."""

    shaded = False
    _POLYGONS: tuple[Role, ...] = ("influence", "obstacle", "plan", "link")

    def __init__(self, result: Outcome, rows: Rows, speed: float, size: int | None = None) -> None:
        self._whole = Scene.of_result(result)
        self._rows, self._scene = rows, self._whole.pick(rows)
        sizes = self._scene.strengths
        self.strongest = int(sizes.argmax())
        self._speed = "" if speed == 1.0 else f"  ({speed:g}×)"
        height = strobe.natural_height(self._whole, _WIDTH, field=True)
        self._figure = style.figure(height, _WIDTH)
        self._figure.set_dpi(_DPI if size is None else size / _WIDTH)
        agg: Any = self._figure.canvas  # Agg's blitting has no types
        self._agg = agg
        ax = self._axes = self._figure.subplots()
        strobe.stage(ax, self._whole, height, _WIDTH, field=True)
        canvas.paint(ax, self._whole.at(0, ["reference"]), zorder=1)
        left, right = ax.get_xlim()
        self._wide = right - left
        self._scale = _LONGEST * self._wide / (float(sizes.max()) or 1.0)  # m/N
        self._polygons = {
            "influence": self._patches("influence", to_rgba(COLOURS["influence"], 0.45), 0.0, 1.5),
            "obstacle": self._patches("obstacle", COLOURS["obstacle"], 0.15, 2.0),
            "plan": self._patches("plan", COLOURS["plan"], 0.1, 2.9),
            "link": self._patches("link", COLOURS["link"], 0.25, 3.0),
        }
        thin = bool((self._whole.radii == 0.0).any())
        self._arrows = LineCollection([], linewidths=1.6, zorder=5, capstyle="round")
        self._heads = PolyCollection([], linewidths=0.4, zorder=5)
        for collection in (*self._polygons.values(), self._arrows, self._heads):
            ax.add_collection(collection, autolim=False)
        self._lines = {
            "plan": self._line(2.9, "plan", linewidth=1.2, linestyle=canvas.LOOKS["plan"].dash),
            "joint": self._line(4.0, "link", linewidth=2.6 if thin else 1.0, marker="o", markersize=4.5,
                                markerfacecolor="white"),
            "trail": self._line(4.5, "trail", linewidth=1.4),
            "sensed": self._line(5.5, "sensed", linestyle="none", marker=".", markersize=3),
            "target": self._line(6.0, "target", linestyle="none", marker="x", markersize=6),
        }  # fmt: skip
        self._clock = ax.text(1.0, 1.015, "", transform=ax.transAxes, ha="right", va="bottom")
        name = ax.text(0.0, 1.015, result.scenario.name, transform=ax.transAxes, ha="left", va="bottom",
                       parse_math=False, in_layout=False)  # fmt: skip
        self._replans, self._shown_for = result.replans, replans.TOLD * speed
        self._news = ax.text(0.5, 1.015, "", transform=ax.transAxes, ha="center", va="bottom",
                             color=COLOURS["plan"], parse_math=False)  # fmt: skip
        self._moving: list[Artist] = [
            *self._polygons.values(),
            *self._lines.values(),
            self._arrows,
            self._heads,
            self._clock,
            self._news,
        ]
        for artist in self._moving:
            artist.set_animated(True)
        self._figure.draw_without_rendering()
        style.fit(name, (0.3 if len(result.replans) else 0.6) * ax.bbox.width)
        agg.draw()
        self._background = agg.copy_from_bbox(self._figure.bbox)

    def __len__(self) -> int:
        return len(self._rows)

    def each(self, frames: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """Frames one after the other."""
        return map(self.at, frames)

    def at(self, frame: int) -> NDArray[np.uint8]:
        """One frame."""
        self._agg.restore_region(self._background)
        bodies: dict[Role, list[Any]] = {role: [] for role in self._POLYGONS}
        arrows: list[Arrow] = []
        plan: list[Any] = []
        for each in self._scene.at(frame, [*self._POLYGONS, "joint", "force", "wrench", "sensed", "target"]):
            match each:
                case Body(role=role, radius=radius, corners=corners) if radius > 0.0 or len(corners) > 2:
                    bodies[role].append(each.outline())
                case Body(role="plan", corners=corners):  # without a body it is a line
                    plan += [geometry.seen(corners)]
                case Marks(role=role, points=points):
                    self._lines[role].set_data(*geometry.seen(points).T)
                case Arrow():
                    arrows.append(each)
        for role, outlines in bodies.items():
            self._polygons[role].set_verts(outlines)
        if plan:
            self._lines["plan"].set_data(*np.vstack(plan).T)
        (trail,) = self._whole.at(int(self._rows[frame]), ["trail"])
        assert isinstance(trail, Curve)
        self._lines["trail"].set_data(*geometry.seen(trail.points).T)
        self._draw(arrows)
        self._news.set_text(replans.beside(float(self._scene.t[frame]), self._replans, self._shown_for))
        self._clock.set_text(f"t = {self._scene.t[frame]:.2f} s{self._speed}")
        for artist in self._moving:
            self._axes.draw_artist(artist)
        dots: NDArray[np.uint8] = np.asarray(self._agg.buffer_rgba())[..., :3].copy()
        return dots

    def _draw(self, arrows: list[Arrow]) -> None:
        tails, shafts = (
            geometry.seen(np.array(each))
            for each in zip(*(arrow.drawn(self._scale) for arrow in arrows), strict=True)
        )
        lengths = np.linalg.norm(shafts, axis=1)
        visible = lengths > _LEAST * self._wide
        tails, shafts, lengths = tails[visible], shafts[visible], lengths[visible][:, None]
        tips = tails + shafts
        self._arrows.set_segments(list(np.stack([tails, tips], axis=1)))
        along = shafts / lengths * np.minimum(0.5 * lengths, 0.02 * self._wide)
        across = 0.5 * along @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        heads = np.stack([tips + 0.4 * along, tips - along + across, tips - along - across], axis=1)
        self._heads.set_verts(list(heads))
        colours = [COLOURS[each.role] for each, seen in zip(arrows, visible, strict=True) if seen]
        self._arrows.set_colors(colours)
        self._heads.set_color(colours)

    @staticmethod
    def _patches(role: Role, edge: Any, fill: float, order: float) -> PolyCollection:
        return PolyCollection(
            [],
            facecolors=[to_rgba(COLOURS[role], fill)] if fill else "none",
            edgecolors=[edge],
            linewidths=canvas.LOOKS[role].width if role != "link" else 0.9,
            linestyles=[canvas.LOOKS[role].dash],
            zorder=order,
        )

    def _line(self, order: float, role: Role, **how: Any) -> Line2D:
        (line,) = self._axes.plot([], [], color=COLOURS[role], zorder=order, **how)
        return line
