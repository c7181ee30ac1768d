"""The spring by which a visitor pulls at a link: a line to the pointer, and how much it pulls."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP = 1e-4
"""What moves by less [m] is left where it is."""


class Spring:
    """A line from where a link is held to where it is pulled, with its force in newtons.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    arrow : viser.MeshHandle
        An arrow of unit length for the force, which the scene stretches.
    colour : tuple of int
        Of the line.
    reach : float
        Of the arm [m].
    """

    def __init__(
        self, server: viser.ViserServer, arrow: viser.MeshHandle, colour: tuple[int, int, int], reach: float
    ) -> None:
        self.arrow = arrow
        self._line = server.scene.add_line_segments(
            "/pull-line", np.zeros((1, 2, 3)), np.array(colour), thickness=0.006 * reach, visible=False
        )
        self._label = server.scene.add_label(
            "/pull-newtons", "", anchor="bottom-center", font_screen_scale=0.9, visible=False
        )

    def show(self, on: bool) -> None:
        """Whether somebody pulls."""
        for handle in (self._line, self._label):
            if handle.visible != on:
                handle.visible = on
        if not on and self.arrow.visible:
            self.arrow.visible = False

    def draw(self, ends: Array, newtons: float) -> None:
        """Put the line between these ends (2, 3) [m], and say how much it pulls."""
        if np.abs(ends - self._line.points[0]).max() > STEP:
            self._line.points = ends[None].astype(np.float32)
            self._label.position = ends[1]
        text = f"{newtons:.0f} N"
        if self._label.text != text:
            self._label.text = text
