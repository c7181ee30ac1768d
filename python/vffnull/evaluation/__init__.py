"""Random scenes, what could have been done in them, and the tables of what controllers did.

`scenes` makes the scenes, `planner` says in which of them a collision-free motion exists, `controllers` names
what is compared, and `table` counts; `vffnull.run.evaluate` runs it.
"""

from __future__ import annotations

from vffnull.evaluation.controllers import CONTROLLERS
from vffnull.evaluation.table import Rate, wilson

__all__ = ["CONTROLLERS", "Rate", "wilson"]
