"""The outcomes of controllers on random scenes as rows: rates with their intervals, medians, Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.evaluation.planner import VERDICTS
from vffnull.evaluation.scenes.common import FAMILIES

if TYPE_CHECKING:
    from typing_extensions import Self

__all__ = ["Column", "Rate", "Table", "wilson"]

Column = NDArray[Any]


@dataclass(frozen=True)
class Rate:
    """How often something happened.

    Attributes
    ----------
    count, total : int
        How often, out of how many.
    low, high : float
        95 % confidence interval of the rate, by Wilson's score; NaN if `total` is 0.
    """

    count: int
    total: int
    low: float
    high: float

    @property
    def value(self) -> float:
        """The rate itself; NaN if `total` is 0."""
        return self.count / self.total if self.total else np.nan

    def __str__(self) -> str:
        if not self.total:
            return "–"
        return f"{100 * self.value:.1f} [{100 * self.low:.1f}, {100 * self.high:.1f}]"


def wilson(count: int, total: int) -> Rate:
    """A rate with Wilson's score interval at 95 %.

    Parameters
    ----------
    count, total : int
        How often something happened, out of how many.

    Raises
    ------
    ImportError
        Without the extra ``vffnull[evaluate]``.
    """
    if total == 0:
        return Rate(0, 0, np.nan, np.nan)
    interval = (
        extra("scipy.stats", "evaluate").binomtest(int(count), int(total)).proportion_ci(method="wilson")
    )
    return Rate(int(count), int(total), float(interval.low), float(interval.high))


class Table:
    """Rows of outcomes, one for every scene and controller; `vffnull.Evaluation` says what each column is.

    Parameters
    ----------
    columns : dict of str to ndarray
        The rows, as columns.
    controllers : tuple of str
        Their names, in the order of tables and figures.
    """

    def __init__(self, columns: dict[str, Column], controllers: tuple[str, ...]) -> None:
        self.columns, self.controllers = columns, controllers

    @classmethod
    def of(cls, rows: Sequence[Mapping[str, Any]], controllers: tuple[str, ...]) -> Self:
        """Of rows, each with the same keys."""
        return cls({name: np.array([row[name] for row in rows]) for name in rows[0]}, controllers)

    def __len__(self) -> int:
        return len(self.columns["scene"])

    @property
    def verdicts(self) -> dict[str, str]:
        """Feasibility of every scene, by its name."""
        pairs = zip(self.columns["scene"], self.columns["feasibility"], strict=True)
        return {str(scene): str(verdict) for scene, verdict in pairs}

    def where(self, **wanted: Any) -> Self:
        """The rows in which columns have given values: ``where(controller="cbf", n=[4, 6])``.

        Of controllers, those are left that have rows.
        """
        rows = np.ones(len(self), dtype=bool)
        for name, value in wanted.items():
            if name not in self.columns:
                raise InputError(f"{name}: there is no such column; there are {', '.join(self.columns)}")
            rows &= np.isin(self.columns[name], value)
        left = {name: column[rows] for name, column in self.columns.items()}
        return type(self)(left, tuple(name for name in self.controllers if name in left["controller"]))

    def rate(self, name: str) -> Rate:
        """How often ``"collided"``, ``"diverged"`` or ``"success"`` holds in the rows."""
        return wilson(int(self.columns[name].sum()), len(self))

    def rates(self) -> dict[str, Rate]:
        """The rates that `table` and ``vffnull evaluate --json`` give, by name."""
        return {
            "collisions": self.rate("collided"),
            "collisions_feasible": self.feasible.rate("collided"),
            "success": self.rate("success"),
            "success_feasible_with_tip": self.with_tip.rate("success"),
            "returned_feasible": self.feasible.rate("returned"),
            "diverged": self.rate("diverged"),
        }

    @property
    def feasible(self) -> Self:
        """The rows of scenes in which an escape has been found."""
        return self.where(feasibility=VERDICTS[:2])

    @property
    def with_tip(self) -> Self:
        """The rows of scenes in which an escape has been found that holds the tip."""
        return self.where(feasibility=VERDICTS[0])

    @property
    def families(self) -> list[str]:
        """The families that occur."""
        return [family for family in FAMILIES if family in self.columns["family"]]

    def table(self) -> str:
        """Rates and medians as Markdown, two tables for each family; nothing of no rows.

        Raises
        ------
        ImportError
            Without the extra ``vffnull[evaluate]``.
        """
        return "\n\n".join(self._family_table(family) for family in self.families)

    def _family_table(self, family: str) -> str:
        rows = self.where(family=family)
        found = list(rows.verdicts.values())
        verdicts = ", ".join(f"{found.count(verdict)} {verdict}" for verdict in VERDICTS)
        lines = [
            f"**{family}**: {len(found)} scenes, escape: {verdicts}",
            "",
            "| controller | collisions, all [%] | collisions, feasible [%] | success, all [%] "
            "| success, feasible with tip [%] | returned, feasible [%] | diverged [%] |",
            "|---|--:|--:|--:|--:|--:|--:|",
        ]
        for name in rows.controllers:
            of = rows.where(controller=name)
            lines.append(f"| {name} | {' | '.join(map(str, of.rates().values()))} |")
        lines += [
            "",
            "| controller | clearance: median, 5th percentile [mm] | error during, after [mm] | recovery [s] "
            "| effort [N²·m²·s] | jerk [rad/s³] |",
            "|---|--:|--:|--:|--:|--:|",
        ]
        for name in rows.controllers:
            of = rows.where(controller=name)
            clearance = 1e3 * of.columns["min_clearance"]
            cells = (
                f"{np.median(clearance):.0f}, {np.percentile(clearance, 5):.0f}",
                f"{of._median('rms_error_during', 1e3)}, {of._median('rms_error_after', 1e3)}",
                of._median("recovery_time"),
                of._median("effort"),
                of._median("rms_jerk"),
            )
            lines.append(f"| {name} | {' | '.join(cells)} |")
        return "\n".join(lines)

    def _median(self, name: str, factor: float = 1.0) -> str:
        """The median of the runs that came through; what never happened is left out."""
        values = self.columns[name][~self.columns["diverged"]]
        values = values[np.isfinite(values)]
        return f"{factor * np.median(values):.3g}" if len(values) else "–"
