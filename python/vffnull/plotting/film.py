"""The frames of a film of an arm in space.

Axes and panes are drawn once; every frame puts the bodies over them, traced anew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import to_rgb
from matplotlib.image import AxesImage
from numpy.typing import NDArray

from vffnull.plotting import space, style
from vffnull.plotting.primitives import COLOURS, Arrow, Body, Scene
from vffnull.plotting.render import Canvas, Layer, Solid, arrow

if TYPE_CHECKING:
    from vffnull._outcome import Outcome
    from vffnull.plotting.primitives import Rows

__all__ = ["SpacePicture"]

_WIDTH, _HEIGHT, _DPI = 5.0, 5.0, 110  # [in], [in], dots per inch
_LONGEST = 0.2  # of the arm's reach, the arrow of the greatest force
_LEAST = 0.01  # of the arm's reach, the shortest arrow that is drawn
_SHELL = 0.1  # opacity of how far a field reaches


class SpacePicture:
    """The frames of a film, each an array of dots (height, width, 3)."""

    def __init__(self, result: Outcome, scene: Scene, rows: Rows, speed: float) -> None:
        self._scene, self._rows = scene, rows
        sizes = np.linalg.norm(scene.pushes[1][rows], axis=2).max(axis=1, initial=0.0)
        self.strongest = int(sizes.argmax())
        self._scale = _LONGEST * scene.reach / (float(sizes.max()) or 1.0)  # m/N
        self._speed = "" if speed == 1.0 else f"  ({speed:g}×)"
        figure: Any = style.figure(_HEIGHT, _WIDTH)  # Agg's blitting has no types
        figure.set_layout_engine("none")
        figure.set_dpi(_DPI)
        self._agg = figure.canvas
        self._axes = space.stage(figure, scene, (0.0, 0.0, 1.0, 0.95))
        figure.text(0.03, 0.96, result.scenario.name, ha="left", va="center")
        self._clock = figure.text(0.97, 0.96, "", ha="right", va="center", animated=True)
        self._agg.draw()
        view, scale, origin = space.view_of(self._axes)
        self._canvas = self._framed(view, scale, origin)
        self._image = self._placed(scale, origin)
        self._background = self._agg.copy_from_bbox(figure.bbox)

    def __len__(self) -> int:
        return len(self._rows)

    def at(self, frame: int) -> NDArray[np.uint8]:
        """One frame."""
        row = int(self._rows[frame])
        self._agg.restore_region(self._background)
        self._image.set_data(self._canvas.draw(self.layers(row)))
        self._axes.draw_artist(self._image)
        self._clock.set_text(f"t = {self._scene.t[row]:.2f} s{self._speed}")
        self._clock.draw(self._agg.get_renderer())
        dots: NDArray[np.uint8] = np.asarray(self._agg.buffer_rgba())[..., :3].copy()
        return dots

    def layers(self, row: int) -> list[Layer]:
        """The bodies at an instant, how far the fields of the obstacles reach, the forces, and the paths."""
        scene = self._scene
        thin = 0.006 * scene.reach
        shells, arrows = [], []
        for each in scene.at(row, ["influence", "force"]):
            match each:
                case Body(corners=corners, radius=radius) if len(corners) <= 2:
                    shells.append(Solid(corners, radius, np.array(to_rgb(COLOURS["influence"]))))
                case Arrow(index=index, tail=tail, vector=vector):
                    length = float(np.linalg.norm(vector))
                    if length * self._scale > _LEAST * scene.reach:
                        begin = tail + vector / length * scene.radii[index]  # on the link's surface
                        colour = np.array(to_rgb(COLOURS["force"]))
                        arrows += arrow(begin, vector * self._scale, thin, colour)
        layers = space.layers_at(scene, row)
        found = [*layers, Layer(arrows), *space.path_layers(scene, row, thin)]
        return [*found, Layer(shells, _SHELL)] if shells else found

    def _framed(self, view: NDArray[Any], scale: float, origin: NDArray[Any]) -> Canvas:
        """All of the axes, of which nothing need be cut off."""
        corners = self._axes.transData.inverted().transform(self._axes.bbox.get_points())
        low, high = (corners - origin) / scale
        dot = space.dot_of(self._axes, scale)
        wide, tall = np.ceil((high - low) / dot).astype(int)
        return Canvas(view, low, dot, (int(tall), int(wide)))

    def _placed(self, scale: float, origin: NDArray[Any]) -> AxesImage:
        left, right, bottom, top = self._canvas.extent
        across, up = origin[0] + scale * np.array([left, right]), origin[1] + scale * np.array([bottom, top])
        image = AxesImage(self._axes, extent=(*across, *up), origin="lower", interpolation="antialiased")
        image.set_animated(True)
        image.set_clip_on(False)
        self._axes.add_artist(image)
        return image
