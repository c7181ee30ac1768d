"""Colours, sizes and thresholds of the drawings in the plane and in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from vffnull.draw import colours

if TYPE_CHECKING:
    from vffnull.arms._capsules import Solid

Array = NDArray[np.float64]
Colour = tuple[int, int, int]
Core = tuple[Array, float]
"""Corners (·, D) [m] of an obstacle's core, relative to its position, and the radius [m] around it."""
Quaternion = tuple[float, float, float, float]
Which = Literal["arm", "ghost", "plan"]
"""Of the arms that are drawn: the one itself, the one without projection, and the one of the plan."""
Dress = Mapping[str, "Sequence[Solid]"]
"""Surfaces by the names of their links, in the frames of these."""
NEAR, HIT = np.array(colours.NEAR), np.array(colours.CONTACT)
"""Colours of a link that is half way into the influence distance, and in contact."""
OBSTACLE, HALO, TARGET, TIP, FORCE, GHOST = (
    (60, 64, 72), (213, 94, 0), (0, 158, 115), (20, 20, 24), (178, 24, 43), (150, 90, 160),
)  # fmt: skip
UNSEEN = (140, 146, 172)
"""The colour of an obstacle that the controller does not know of."""
SENSED = (0, 114, 178)
"""The colour of what sensors have measured."""
WRENCH = (204, 121, 167)
"""The colour of what pushes from outside."""
PALE: Mapping[Which, Colour] = {"ghost": GHOST, "plan": TARGET}
"""Colours of the arms that are seen through; the plan is where the arm ought to be, as the target is."""
TABLE = (222, 214, 202)
"""The colour of an obstacle without an end."""
SHADES = 24
"""Colours of links are rounded to so many, so that they need not be sent in every frame."""
TRAIL = 150
"""Points of the tip's trail."""
SPECK = 0.002
"""Radius of a point that has none [reaches]."""
STEP = 1e-4
"""What moves or turns by less [m, rad] is left where it is."""
FAINT = 0.02
"""The greatest force [N] that is not shown."""
ARRIVED = 0.01
"""How near is there [reaches]."""
