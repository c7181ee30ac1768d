"""The scale of the arrows: one of a known force beside the base, with its newtons."""

from __future__ import annotations

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull.live.plots import rounded_up
from vffnull.model.scenario import Scenario

Array = NDArray[np.float64]

LENGTH = 0.25
"""Of the legend's arrow [reaches]."""
AT_FIRST = 20.0
"""Its force where the field does not say how much it pushes at most [N]."""


class Legend:
    """An arrow as long as a force of round newtons, which grow with the greatest force that is drawn.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    reach : float
        Of the arm [m].
    newtons : float
        What the arrow stands for at first [N].
    """

    def __init__(self, server: viser.ViserServer, reach: float, newtons: float) -> None:
        self._server = server
        self._size = LENGTH * reach
        self.newtons = rounded_up(newtons)
        self._handles: list[viser.MeshHandle | viser.LabelHandle] = []
        self._label: viser.LabelHandle | None = None

    def stand(self, arrow: viser.MeshHandle, tail: Array, label: Array) -> None:
        """Show an arrow that lies along x and is of length 1."""
        width = min(0.18 * self._size, 0.6 * self._size)
        arrow.scale, arrow.position = (self._size, width, width), tail
        self._label = self._server.scene.add_label(
            "/legend-newtons", self._text, position=label, anchor="center-center", font_screen_scale=0.8
        )
        self._handles = [arrow, self._label]
        self.show(False)

    def show(self, on: bool) -> None:
        """Whether there are forces."""
        for handle in self._handles:
            handle.visible = on

    def length(self, force: float) -> float:
        """Of the arrow of a force [m]."""
        return force / self.newtons * self._size

    def cover(self, force: float) -> None:
        """Let the scale be such that no arrow is longer than the legend's."""
        if force > self.newtons and self._label is not None:
            self.newtons = rounded_up(force)
            self._label.text = self._text

    @property
    def _text(self) -> str:
        return f"{self.newtons:g} N"


def strongest(scenario: Scenario) -> float:
    """What a bounded field pushes with at most [N]; of other fields something to begin with."""
    field = scenario.to_dict().get("controller", {}).get("field", {})
    return float(field["gain"]) if field.get("kind") == "bounded" and field["gain"] > 0.0 else AT_FIRST
