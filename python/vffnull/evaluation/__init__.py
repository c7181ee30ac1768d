"""Controllers against each other on random scenes.

`scenes` makes the scenes, `planner` says in which of them a collision-free motion exists, `controllers` names
what is compared, `run` runs it, and `table` counts.
"""

from __future__ import annotations

from vffnull.evaluation.controllers import CONTROLLERS
from vffnull.evaluation.run import (
    Evaluation,
    check_path,
    encounter,
    evaluate,
    identity,
    join,
    loop_times,
    scores,
)
from vffnull.evaluation.table import Rate, wilson

__all__ = [
    "CONTROLLERS",
    "Evaluation",
    "Rate",
    "check_path",
    "encounter",
    "evaluate",
    "identity",
    "join",
    "loop_times",
    "scores",
    "wilson",
]
