"""Random scenes by the number: the same family, joints and seed give the same scene for ever.

Four families in two categories. In category 1 the null space may suffice; in category 2 the end effector's
own path is blocked, or the arm stands between many obstacles.

=================  ========  ==================================================================
family             category  what happens
=================  ========  ==================================================================
``links-swept``    1         1 or 2 bodies push into the links; the tip's path is free
``path-crossed``   2         a body lies on the tip's line, or crosses it when the tip is there
``clutter``        2         3 to 8 bodies at rest, the tip's path between them
``crowd``          2         3 to 8 discs move through the arm's place
=================  ========  ==================================================================

`random` makes them in the plane, of arms with links of 1 m. `in_space` makes them around published arms
(`ARMS`), of bodies of 4 to 12 cm, 4 s long; there links are swept and crowds pass with the hand's place free,
and half of the clutter has a shelf.

No controller takes part in making a scene. Every number is drawn from NumPy's PCG64 and rounded to 0.1 mm or
0.1 mrad; neither its stream nor the rounding depends on versions or machines.
"""

from __future__ import annotations

from vffnull.evaluation.scenes.common import EVALUATION, FAMILIES, TRAINING
from vffnull.evaluation.scenes.plane import CATEGORIES, DURATION, random
from vffnull.evaluation.scenes.space import ARMS, EVALUATED, TASKS, in_space

__all__ = [
    "ARMS",
    "CATEGORIES",
    "DURATION",
    "EVALUATED",
    "EVALUATION",
    "FAMILIES",
    "TASKS",
    "TRAINING",
    "in_space",
    "random",
]
