"""The pictures of depth cameras, side by side."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import viser
from numpy.typing import NDArray

SHADES = ((13, 8, 135), (126, 3, 168), (204, 71, 120), (248, 149, 64), (240, 249, 33))
"""From far to near, bright where something is near: "plasma" of S. van der Walt and N. Smith."""
NOTHING = (24, 26, 32)
"""Where nothing was measured."""
WIDTH = 640
"""How wide the picture is drawn at least [pixels]: a browser would blur a few of them."""


class Picture:
    """An image in the present container of the page, which is there while there is something to be seen."""

    def __init__(self, server: viser.ViserServer, label: str) -> None:
        nothing = np.zeros((1, 1, 3), np.uint8)
        self._image = server.gui.add_image(nothing, label=label, format="png", visible=False)

    def clear(self) -> None:
        """Begin anew."""
        self._image.visible = False

    def draw(self, drawn: NDArray[np.uint8]) -> None:
        """Show this from now on."""
        if not np.array_equal(drawn, self._image.image):  # a browser rests while nothing moves
            self._image.image = drawn
        self._image.visible = True


class Pictures(Picture):
    """Those of the depth cameras."""

    def __init__(self, server: viser.ViserServer) -> None:
        super().__init__(server, "Depth cameras")
        self._far = 0.0

    def clear(self) -> None:
        """Begin anew."""
        super().clear()
        self._far = 0.0

    def show(self, pictures: Sequence[NDArray[np.float32]]) -> None:
        """Show pictures (rows, columns) [m], 0 where nothing was measured, up to the farthest so far."""
        if pictures:
            self._far = max(self._far, *(float(each.max()) for each in pictures))
            self.draw(side_by_side(pictures, self._far))


def side_by_side(pictures: Sequence[NDArray[np.float32]], far: float) -> NDArray[np.uint8]:
    """One picture (H, W, 3) of all, with a gap between them: bright is near, the darkest at `far` [m]."""
    height, gap = max(len(each) for each in pictures), 2
    width = sum(each.shape[1] + gap for each in pictures) - gap
    drawn = np.full((height, width, 3), NOTHING, dtype=np.uint8)
    left = 0
    for depths in pictures:
        rows, columns = depths.shape
        share = 1.0 - depths / max(far, 1e-9)
        steps = np.linspace(0.0, 1.0, len(SHADES))
        channels = [np.interp(share, steps, [shade[k] for shade in SHADES]) for k in range(3)]
        part = drawn[:rows, left : left + columns]
        part[:] = np.where((depths > 0.0)[..., None], np.stack(channels, axis=-1), part)
        left += columns + gap
    larger = -(-WIDTH // width)
    return drawn.repeat(larger, axis=0).repeat(larger, axis=1)
