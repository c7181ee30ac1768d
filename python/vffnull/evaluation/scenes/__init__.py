"""The generators of random scenes, in the plane and in space; `vffnull.scenes` is where users find them."""

from __future__ import annotations

from vffnull.evaluation.scenes.common import EVALUATION, FAMILIES, TRAINING
from vffnull.evaluation.scenes.plane import CATEGORIES, DURATION, random
from vffnull.evaluation.scenes.space import ARMS, TASKS, in_space

__all__ = [
    "ARMS",
    "CATEGORIES",
    "DURATION",
    "EVALUATION",
    "FAMILIES",
    "TASKS",
    "TRAINING",
    "in_space",
    "random",
]
