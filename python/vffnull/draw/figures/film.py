"""The frames of a film of an arm in space.

The ground and the course of the clearance are drawn once; every frame puts the bodies over the ground, traced
anew, the links in the colours of their clearance, and says in figures how the run is.
"""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.collections import LineCollection
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.text import Text
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from vffnull.draw import geometry, replans, style
from vffnull.draw.figures import space, tracking
from vffnull.draw.figures.rays import Solid
from vffnull.draw.figures.render import Canvas, Layer, arrow
from vffnull.draw.primitives import COLOURS, Arrow, Body
from vffnull.draw.scene import Scene

if TYPE_CHECKING:
    from vffnull.draw.primitives import Rows
    from vffnull.model.outcome import Outcome

__all__ = ["SpacePicture"]

Array = NDArray[np.float64]

_WIDTH, _DPI = 5.0, 120  # [in], dots per inch
_PICTURE, _HEAD, _STRIP = 4.0, 0.42, 0.78  # heights [in]
_LONGEST = 0.25  # of the arm's reach, the arrow of the greatest force
_LEAST = 0.01  # of the arm's reach, the shortest arrow that is drawn
_SHELL = 0.1  # opacity of how far a field reaches
_GROUND = 2.4  # of the arm's reach, how far the ground is seen


class SpacePicture:
    """The frames of a film, each an array of dots (height, width, 3)."""

    shaded = True

    def __init__(
        self,
        result: Outcome,
        scene: Scene,
        rows: Rows,
        speed: float,
        size: int | None = None,
        view: tuple[float, float] | None = None,
    ) -> None:
        self._scene, self._rows = scene, rows
        self._clearance, self._error = result.clearance, tracking.distance(result)
        sizes = scene.strengths[rows]
        self.strongest = int(sizes.argmax())
        self._scale = _LONGEST * scene.reach / (float(sizes.max()) or 1.0)  # m/N
        self._near = scene.influence or 0.1 * scene.reach
        self._speed = "" if speed == 1.0 else f"  ({speed:g}×)"
        self._least = result.clearance.min(axis=1)
        strip = _STRIP if np.isfinite(self._least).any() else 0.0
        height = _PICTURE + _HEAD + strip
        figure: Any = style.figure(height, _WIDTH)  # Agg's blitting has no types
        figure.set_layout_engine("none")
        dpi = _DPI if size is None else size / _WIDTH
        figure.set_dpi(dpi)
        self._figure, self._agg = figure, figure.canvas
        self._axes = figure.add_axes((0.0, strip / height, 1.0, _PICTURE / height))
        self._corner = 0.0, float(round(strip * dpi))  # of the bodies' picture in the figure [dots]
        self._canvas = self._stage(dpi, view or (space.AZIMUTH + scene.next_corner, space.ELEVATION))
        top = 1.0 - 0.15 / height
        name = figure.text(0.03, top, result.scenario.name, ha="left", va="center", weight="bold", fontsize=9,
                           parse_math=False)  # fmt: skip
        style.fit(name, 0.62 * figure.bbox.width)
        self._clock = self._say(0.03, top - 0.17 / height, ha="left", color=style.MUTED)
        self._nearest = self._say(0.97, top, ha="right", weight="bold", fontsize=9)
        self._off = self._say(0.97, top - 0.17 / height, ha="right", color=style.MUTED)
        self._replans, self._shown_for = result.replans, replans.TOLD * speed
        self._news = self._say(0.03, top - 0.34 / height, ha="left", color=COLOURS["plan"], parse_math=False)
        self._texts = [self._clock, self._nearest, self._off, self._news]
        self._course = self._follow((0.13, 0.3 / height, 0.84, (strip - 0.42) / height)) if strip else []
        self._agg.draw()
        self._background = self._agg.copy_from_bbox(figure.bbox)

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, frame: int) -> NDArray[np.uint8]:
        """One frame."""
        return self._finished(frame, self._bodies(frame))

    def each(self, frames: Iterable[int]) -> Iterator[NDArray[np.uint8]]:
        """Frames one after the other, whose bodies are traced ahead on all cores."""
        cores = os.cpu_count() or 1
        ahead: deque[tuple[int, Future[NDArray[np.uint8]]]] = deque()
        pool = ThreadPoolExecutor(cores)
        try:
            for frame in frames:
                ahead.append((frame, pool.submit(self._bodies, frame)))
                if len(ahead) > 2 * cores:
                    first, bodies = ahead.popleft()
                    yield self._finished(first, bodies.result())
            for frame, bodies in ahead:
                yield self._finished(frame, bodies.result())
        finally:
            pool.shutdown(cancel_futures=True)

    def _bodies(self, frame: int) -> NDArray[np.uint8]:
        return self._canvas.draw(self.layers(int(self._rows[frame])))

    def _finished(self, frame: int, bodies: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """What is drawn over the bodies, and what stands still behind them."""
        row = int(self._rows[frame])
        self._agg.restore_region(self._background)
        renderer = self._agg.get_renderer()
        renderer.draw_image(renderer.new_gc(), *self._corner, bodies)
        self._tell(row)
        for text in self._texts:
            text.draw(renderer)
        for artist in self._course:
            assert artist.axes is not None
            artist.axes.draw_artist(artist)
        dots: NDArray[np.uint8] = np.asarray(self._agg.buffer_rgba())[..., :3].copy()
        return dots

    def layers(self, row: int) -> list[Layer]:
        """The bodies at an instant, how far the fields of the obstacles reach, the forces, and the paths."""
        scene = self._scene
        thin = 0.006 * scene.reach
        shells, arrows = [], []
        for each in scene.at(row, ["influence", "force", "wrench"]):
            match each:
                case Body(corners=corners, radius=radius) if len(corners) <= 2:
                    shells.append(Solid(corners, radius, np.array(to_rgb(COLOURS["influence"]))))
                case Arrow():
                    tail, shaft = each.drawn(self._scale)
                    if float(np.linalg.norm(shaft)) > _LEAST * scene.reach:
                        thick = 1.8 * thin if each.role == "wrench" else thin  # from outside, there are few
                        arrows += arrow(tail, shaft, thick, np.array(to_rgb(COLOURS[each.role])))
        shades = [style.by_clearance(away / self._near) for away in self._clearance[row]]
        layers = [*space.layers_at(scene, row, shades=shades), *space.plan_layer(scene, row)]
        found = [*layers, Layer(arrows), *space.path_layers(scene, row, thin)]
        return [*found, Layer(shells, _SHELL)] if shells else found

    # ------------------------------------------------------------------------------------------------ inside

    def _stage(self, dpi: float, angles: tuple[float, float]) -> Canvas:
        """The ground, and where the bodies are drawn: all of the axes, with the scene in the middle."""
        ax, scene = self._axes, self._scene
        view = geometry.looking(*angles)
        box = np.array(np.meshgrid(*zip(*space.padded(scene), strict=True))).reshape(3, -1).T @ view.T
        low, high = box.min(axis=0), box.max(axis=0)
        wide, tall = round(_WIDTH * dpi), round(_PICTURE * dpi)
        dot = float(((high - low) / [wide, tall]).max())
        low = (low + high - dot * np.array([wide, tall])) / 2.0
        ax.set(xlim=(low[0], low[0] + wide * dot), ylim=(low[1], low[1] + tall * dot))
        ax.set_axis_off()
        floor = space.floor_of(scene)
        if floor is not None:
            ax.add_collection(_ground(scene, floor, view), autolim=False)
        return Canvas(view, low, dot, (tall, wide))

    def _say(self, x: float, y: float, **how: Any) -> Text:
        """A place for words that change."""
        return self._figure.text(x, y, "", va="center", animated=True, **how)  # type: ignore[no-any-return]

    def _tell(self, row: int) -> None:
        """Time, smallest clearance and tracking error of an instant."""
        least = float(self._least[row])
        self._news.set_text(replans.beside(float(self._scene.t[row]), self._replans, self._shown_for))
        self._clock.set_text(f"t = {self._scene.t[row]:.2f} s{self._speed}")
        if np.isfinite(least):
            digits = 1 if abs(least) < 1e-3 else 0  # which side of contact it is on
            self._nearest.set_text(f"clearance {1e3 * least:.{digits}f} mm".replace("-", "−"))
            self._nearest.set_color(style.ALARM if least <= 0.0 else style.INK)
        error = float(self._error[row])
        factor, unit = style.prefixed(error, "m")
        self._off.set_text(f"tip off by {factor * error:.3g} {unit}" if error > 1e-9 else "tip off by < 1 nm")
        for artist in self._course:
            now = slice(row + 1) if artist.get_label() == "until now" else slice(row, row + 1)
            artist.set_data(self._scene.t[now], self._least[now])  # type: ignore[attr-defined]

    def _follow(self, rect: tuple[float, float, float, float]) -> list[Artist]:
        """The course of the smallest clearance, on which the film goes along."""
        ax = self._figure.add_axes(rect)
        t, least = self._scene.t, np.where(np.isfinite(self._least), self._least, np.nan)
        ax.plot(t, least, color="#C9CDD3", linewidth=1.2)
        low, high = min(0.0, float(np.nanmin(least))), float(np.nanmax(least))
        ax.set(xlim=(t[0], max(t[-1], t[0] + 1e-9)), ylim=(low - 0.04 * (high - low), max(high, low + 1e-3)))
        ax.yaxis.set_major_locator(MaxNLocator(nbins=2, steps=[1, 2, 5, 10]))
        ax.set_ylabel("clearance\n[m]", fontsize=6.5)
        ax.tick_params(labelsize=6.5)
        ax.annotate("t [s]", (0.0, 0.0), xycoords="axes fraction", xytext=(-8, -8.5), fontsize=6.5,
                    textcoords="offset points", ha="right", va="center")  # fmt: skip
        if low < 0.0:
            ax.axhspan(low - 1.0, 0.0, color=style.ALARM, alpha=0.1, linewidth=0.0)
        ax.axhline(0.0, color=style.ALARM, linewidth=0.8)
        how: dict[str, Any] = {"color": COLOURS["link"], "animated": True, "clip_on": False}
        (course,) = ax.plot([], [], linewidth=1.6, label="until now", **how)
        (now,) = ax.plot([], [], "o", markersize=4.5, label="now", **how)
        return [course, now]


def _ground(scene: Scene, floor: float, view: Array) -> LineCollection:
    """Squares of a round size around the base, which fade away."""
    base = scene.joints[0, 0] if scene.base is None else scene.base
    cell, far = float(10.0 ** np.floor(np.log10(scene.reach))), _GROUND * scene.reach
    many = int(np.ceil(far / cell))
    at, along = cell * np.arange(-many, many + 1), np.linspace(-far, far, 61)
    lines = np.stack(np.broadcast_arrays(at[:, None], along[None, :], 0.0), axis=-1)
    lines = np.concatenate([lines, lines[..., [1, 0, 2]]])
    pieces = np.stack([lines[:, :-1], lines[:, 1:]], axis=2).reshape(-1, 2, 3)
    away = np.linalg.norm(pieces.mean(axis=1), axis=1) / far
    shown = pieces[away < 1.0] + np.array([base[0], base[1], floor])
    colours = [to_rgba("#7A8596", 0.6 * (1.0 - share) ** 1.5) for share in away[away < 1.0]]
    return LineCollection(list(shown @ view.T), colors=colours, linewidths=0.7, zorder=0)
