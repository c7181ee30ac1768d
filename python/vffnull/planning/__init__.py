"""Motions planned before anything moves: `find` finds them, `motion` is what was found."""

from __future__ import annotations

from vffnull.planning.find import plan
from vffnull.planning.motion import Plan, PlanStatus

__all__ = ["Plan", "PlanStatus", "plan"]
