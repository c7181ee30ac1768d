"""The trail of the tip."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np
import viser

from vffnull.live.scene.looks import HALO, TRAIL, Array


class Trail:
    """A line that fades where it is old.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    reach : float
        Of the arm [m].
    step : float
        How far the tip goes [reaches] before there is another point, so that one that rests sends nothing;
        0 for a point per picture.
    """

    def __init__(self, server: viser.ViserServer, reach: float, step: float) -> None:
        self._step = step * reach
        self._places: deque[Array] = deque(maxlen=TRAIL)
        nothing = np.zeros((TRAIL - 1, 2, 3))
        self._line = server.scene.add_line_segments("/trail", nothing, nothing, thickness=0.006 * reach)
        fading = np.linspace(1.0, 0.0, TRAIL - 1)[:, None]
        colours = (255 * fading + (1 - fading) * np.array(HALO)).astype(np.uint8)
        self._line.colors = np.repeat(colours[:, None], 2, axis=1)

    def go_to(self, place: Array) -> None:
        """The tip is at a place (3,) of the page."""
        if self._places and self._step and np.linalg.norm(place - self._places[-1]) <= self._step:
            return
        self._places.append(place)
        places = np.array([self._places[0]] * (TRAIL - len(self._places)) + list(self._places))
        self._line.points = np.stack([places[:-1], places[1:]], axis=1).astype(np.float32)

    def retrace(self, places: Iterable[Array]) -> None:
        """Let it be the one that these places have left."""
        self._places.clear()
        self._places.extend(places)
