"""The ways along the self-motion, now and later, and the one that is followed."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull.live.pictures import WIDTH, Picture

if TYPE_CHECKING:
    from vffnull._core import SelfMotionMap

LABEL = "Self-motion: now at the left, later to the right. Red: contact; line: the path that is followed"
CONTACT, MARGIN, CLEAR = (213, 94, 0), (240, 228, 66), (0, 70, 110)
"""At a distance of 0, at the margin, and from where on more is no better."""
NOTHING = (120, 124, 130)
"""Where there is no posture, or nobody can be that early."""
PATH, AROUND = (255, 255, 255), (0, 0, 0)
HEIGHT = 160
"""How high the picture is drawn at least [pixels]."""


class SelfMotionPicture(Picture):
    """What the search has found last, while something comes near."""

    def __init__(self, server: viser.ViserServer) -> None:
        super().__init__(server, LABEL)

    def show(self, found: SelfMotionMap | None) -> None:
        """Show what was found last; while nothing comes near there is nothing to be seen."""
        if found is None:
            self.clear()
        else:
            self.draw(picture(found))


def picture(found: SelfMotionMap) -> NDArray[np.uint8]:
    """Instants from left to right, places upwards, (H, W, 3)."""
    distances = found["distances"]
    ends = (0.0, found["margin"], found["clearance"])
    finite = np.minimum(np.nan_to_num(distances, nan=0.0, posinf=ends[2]), ends[2])
    colours = np.array([CONTACT, MARGIN, CLEAR])
    shades = np.stack([np.interp(finite, ends, colours[:, k]) for k in range(3)], axis=-1)
    shades = np.where(np.isnan(distances)[..., None], NOTHING, shades).astype(np.uint8)
    places, instants = distances.shape
    wide, high = -(-WIDTH // instants), -(-HEIGHT // places)
    drawn = shades[::-1].repeat(high, axis=0).repeat(wide, axis=1)
    path = found["path"]
    if len(path):
        columns = np.arange(drawn.shape[1])
        # From the middle of a place to that of the next, as the arm goes on between two instants.
        along = np.interp((columns + 0.5) / wide - 0.5, np.arange(instants), path)
        rows = (high * (places - 0.5 - along)).astype(int)
        for half, colour in ((3, AROUND), (1, PATH)):
            for beside in range(-half, half + 1):
                drawn[np.clip(rows + beside, 0, len(drawn) - 1), columns] = colour
    return drawn
