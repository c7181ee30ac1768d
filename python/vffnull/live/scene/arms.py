"""The arms that are drawn: the one itself, the one without projection, and the one of the plan."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import viser

from vffnull.live.scene.looks import HIT, NEAR, SHADES, Array, Which

Parts = list[list[viser.MeshHandle]]
"""The bodies of each link."""


class Arms:
    """Bodies of up to three arms.

    Parameters
    ----------
    add : Callable
        Makes the bodies of one of them.
    place : Callable
        Puts one of them where it is at joint positions (n,).
    free : (3,) ndarray
        The colour of a link that is out of influence.
    follows : bool
        Whether there is a plan.
    """

    def __init__(
        self, add: Callable[[Which], Parts], place: Callable[[Array, Which], None], free: Array, follows: bool
    ) -> None:
        self._place, self._free = place, free
        self.links = add("arm")
        """Bodies of each link of the arm itself."""
        self.ghost = [part for link in add("ghost") for part in link]
        self.plan = [part for link in add("plan") for part in link] if follows else []
        self._with_plan = True
        self._planned: Array | None = None
        self._shades = [-1] * len(self.links)
        self.show_ghost(False)

    def show_ghost(self, visible: bool) -> None:
        """Whether the arm without projection is drawn."""
        for handle in self.ghost:
            handle.visible = visible

    def show_plan(self, visible: bool) -> None:
        """Whether the arm of the plan is drawn, where there is one."""
        self._with_plan = visible
        self.draw_plan(self._planned)

    def draw_plan(self, q: Array | None) -> None:
        """The plan's arm at joint positions (n,), if the arm still follows one."""
        self._planned = q
        visible = self._with_plan and q is not None
        for handle in self.plan:
            if handle.visible != visible:
                handle.visible = visible
        if self.plan and visible and q is not None:
            self._place(q, "plan")

    def shade(self, clearance: Array, width: float) -> None:
        """Colour the links of the arm by their clearance (n,), in shares of a `width` [m]."""
        for i, parts in enumerate(self.links):
            share = float(np.clip(clearance[i] / width, 0.0, 1.0))
            shade = round(share * SHADES)
            if shade != self._shades[i]:
                self._shades[i] = shade
                share = shade / SHADES
                low, high, part = (HIT, NEAR, 2 * share) if share < 0.5 else (NEAR, self._free, 2 * share - 1)
                red, green, blue = (low + (high - low) * part).astype(int)
                for handle in parts:
                    handle.color = (int(red), int(green), int(blue))
