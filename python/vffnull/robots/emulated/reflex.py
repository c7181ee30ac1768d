"""What a robot stops for: its rules, how near they came, and the one that was broken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["Margin", "Monitor", "Reflex", "Rule"]


@dataclass(frozen=True)
class Rule:
    """A rule of a maker's interface.

    Attributes
    ----------
    name : str
        What the maker's library calls the error, or ours where it has no name.
    what : str
        What is limited, in words.
    unit : str
        Of value and limit.
    places : tuple of str
        What it is checked for, one by one: joints, or axes.
    source : str
        Where the maker says so.
    """

    name: str
    what: str
    unit: str
    places: tuple[str, ...]
    source: str


@dataclass(frozen=True)
class Reflex:
    """A rule that was broken: the robot ends the motion and brakes.

    Attributes
    ----------
    rule : Rule
        Which.
    place : str
        The joint or the axis.
    value, limit : float
        What was seen, and what is allowed [the rule's unit].
    cycle : int
        In which cycle of the robot, counted from 0.
    t : float
        At which time of the robot [s].
    """

    rule: Rule
    place: str
    value: float
    limit: float
    cycle: int
    t: float

    def __str__(self) -> str:
        at = f" of {self.place}" if self.place else ""
        allowed = f"{self.limit:.5g} {self.rule.unit}".rstrip()
        return (
            f"{self.rule.name}: {self.rule.what}{at} was {self.value:.5g}, allowed are {allowed} "
            f"(t = {self.t:.3f} s, cycle {self.cycle})"
        )


@dataclass(frozen=True)
class Margin:
    """The nearest that a limit came.

    Attributes
    ----------
    rule : Rule
        Which.
    place : str
        The joint or the axis that came nearest.
    share : float
        The value there as a share of its limit; above 1 it is broken.
    value, limit : float
        Both [the rule's unit].
    cycle : int
        When.
    """

    rule: Rule
    place: str
    share: float
    value: float
    limit: float
    cycle: int


class Monitor:
    """Compares what a robot does with its rules, cycle by cycle.

    Parameters
    ----------
    rules : sequence of Rule
        What is checked, in the order in which values come.
    """

    def __init__(self, rules: Sequence[Rule]) -> None:
        self.rules = tuple(rules)
        self._starts = np.cumsum([0, *(len(rule.places) for rule in self.rules)])
        count = int(self._starts[-1])
        self._share = np.zeros(count)
        self._value, self._limit = np.zeros(count), np.ones(count)
        self._cycle = np.zeros(count, dtype=np.int64)

    def check(self, values: Array, limits: Array, cycle: int, t: float) -> Reflex | None:
        """Look at one cycle.

        Parameters
        ----------
        values, limits : (k,) ndarray
            Signed values and the limits of their size, rule after rule.
        cycle : int
            Which cycle it is.
        t : float
            The robot's time [s].

        Returns
        -------
        Reflex or None
            The rule that is broken most, if one is.
        """
        share = np.abs(values) / np.maximum(limits, 1e-12)
        nearer = share > self._share
        if nearer.any():
            for kept, now in ((self._share, share), (self._value, values), (self._limit, limits)):
                np.copyto(kept, now, where=nearer)
            self._cycle[nearer] = cycle
        most = int(share.argmax())
        if share[most] <= 1.0:
            return None
        rule, place = self._at(most)
        return Reflex(rule, place, float(values[most]), float(limits[most]), cycle, t)

    def margins(self) -> tuple[Margin, ...]:
        """The nearest that every rule came, in their order."""
        found = []
        for rule, start in zip(self.rules, self._starts, strict=False):
            i = int(start) + int(self._share[start : start + len(rule.places)].argmax())
            place = rule.places[i - int(start)]
            value, limit = float(self._value[i]), float(self._limit[i])
            found.append(Margin(rule, place, float(self._share[i]), value, limit, int(self._cycle[i])))
        return tuple(found)

    def _at(self, index: int) -> tuple[Rule, str]:
        which = int(np.searchsorted(self._starts, index, side="right")) - 1
        rule = self.rules[which]
        return rule, rule.places[index - int(self._starts[which])]
