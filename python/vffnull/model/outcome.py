"""The data of a run: how it ended, what it measured, and everything recorded on the way.

Plots, pages and files are made of an `Outcome` and know nothing else of ours; `vffnull.Result` is an outcome
with the methods that make them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull.model.record import Layout, recorded

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from typing_extensions import Self

    from vffnull.model.headline import Headline
    from vffnull.model.scenario import Scenario

    Array = NDArray[np.float64]

__all__ = ["Metrics", "Outcome", "Replan", "Status", "aligned", "readable", "seconds"]


class Status(str, Enum):
    """How a run ended. A status equals its plain string: ``result.status == "completed"``."""

    COMPLETED = "completed"
    """To its end, and no link ever touched an obstacle; `Outcome.headline` says what else happened."""
    COLLIDED = "collided"
    """To its end, but a link touched an obstacle on the way."""
    DIVERGED = "diverged"
    """Stopped early: velocities or angles grew beyond all bounds."""
    INTERRUPTED = "interrupted"
    """Stopped early by Ctrl-C."""
    FAILED = "failed"
    """One of many, ended by a fault of vffnull itself; the others are not affected."""

    def __str__(self) -> str:
        return self.value

    def __format__(self, spec: str) -> str:
        return format(self.value, spec)


@dataclass(frozen=True)
class Replan:
    """A search for a plan while a run followed a reference.

    Attributes
    ----------
    asked : float
        When it began [s].
    reason : {"blocked", "strayed", "stuck"}
        Why: something was in the way of the plan; the arm was off it for too long; it came no nearer to the
        end of its reference.
    status : str or None
        What came of it, as in `PlanStatus`; ``"given up"`` where the end effector was led elsewhere
        meanwhile; None if the run ended before.
    taken : float or None
        When the new plan was taken over [s]; None if there was none.
    """

    asked: float
    reason: str
    status: str | None
    taken: float | None


class Metrics(Mapping[str, float | int | None]):
    """Measures of a run by name, as items or as attributes; printed as a table with units.

    A measure that does not apply to a run is None: the clearance without obstacles, for instance. So is one
    that is not finite, as in a run that diverged.

    Parameters
    ----------
    values : Mapping
        The measures.
    layout : Layout, optional
        Where the run took place, which some units depend on; in the plane by default.
    """

    __slots__ = ("_layout", "_values")

    def __init__(self, values: Mapping[str, float | int | None], layout: Layout | None = None) -> None:
        self._layout = layout or Layout()
        self._values = {name: _finite(value) for name, value in values.items()}

    def __getitem__(self, name: str) -> float | int | None:
        return self._values[name]

    def __getattr__(self, name: str) -> float | int | None:
        if name.startswith("_"):  # not ours; `_values` itself is looked for here while an object is unpickled
            raise AttributeError(name)
        if name not in self._values:
            raise AttributeError(f"no metric called {name!r}; there are {', '.join(self._values)}")
        return self._values[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._values]

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __repr__(self) -> str:
        return f"Metrics({self._values!r})"

    def __str__(self) -> str:
        lines = aligned(self._rows())
        if self.missing:
            from textwrap import wrap

            lines += wrap(f"without a value: {', '.join(self.missing)}", 100)
        return "\n".join(lines) or "(no metrics)"

    def _repr_html_(self) -> str:
        from html import escape

        lines = (
            f"<tr><td>{escape(name)}</td><td style='text-align:right'>{value}</td>"
            f"<td style='text-align:left'>{escape(unit)}</td>"
            f"<td style='text-align:left'>{escape(meaning)}</td></tr>"
            for name, value, unit, meaning in self._rows()
        )
        return f"<table>{''.join(lines)}</table>"

    @property
    def missing(self) -> list[str]:
        """Names of the measures that do not apply to the run."""
        return [name for name, value in self.items() if value is None]

    def _rows(self) -> list[tuple[str, str, str, str]]:
        """Name, value, unit and meaning of what has a value."""
        return [
            (name, readable(value), self._layout.metric(name)[0], self._layout.told(name, value))
            for name, value in self.items()
            if value is not None
        ]


def readable(value: float | int | None) -> str:
    """A metric with as many digits as one reads; a dash if it does not apply."""
    return "–" if value is None else f"{value:d}" if isinstance(value, int) else f"{value:.4g}"


def aligned(rows: Sequence[tuple[str, str, str, str]]) -> list[str]:
    """Lines with a name, a value, its unit and its meaning, each below the other."""
    wide = [max((len(row[column]) for row in rows), default=0) for column in range(3)]
    return [
        f"{name:<{wide[0]}}  {value:>{wide[1]}} {unit:<{wide[2]}}  {meaning}".rstrip()
        for name, value, unit, meaning in rows
    ]


def seconds(time: float) -> str:
    """A time [s] that something took, in milliseconds where it is less than one second."""
    if time < 0.9995:
        return f"{1e3 * time:.3g} ms"
    return f"{time:.3g} s" if time < 999.5 else f"{time:.0f} s"


def _finite(value: float | int | None) -> float | int | None:
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """The data of a run; `vffnull.Result` says what each attribute is, with shapes and units."""

    scenario: Scenario
    status: Status
    message: str
    end_time: float
    wall_time: float
    warnings: tuple[str, ...]
    metrics: Metrics
    version: str
    t: Array
    q: Array
    dq: Array
    tau: Array
    tau_task: Array
    tau_null: Array
    tau_vff: Array
    x: Array
    dx: Array
    x_ref: Array
    error: Array
    force: Array
    clearance: Array
    obstacles: Array
    energy: Array
    power: Array
    manipulability: Array
    objective_scale: Array | None = None
    self_clearance: Array | None = None
    tank: Array | None = None
    tau_ext: Array | None = None
    contact_force: Array | None = None
    tau_ext_estimate: Array | None = None
    wrench_estimate: Array | None = None
    touched_link: Array | None = None
    contact_deviation: Array | None = None
    contact_threshold: Array | None = None
    yielded: Array | None = None
    released: Array | None = None
    slack: Array | None = None
    path_time: Array | None = None
    q_plan: Array | None = None
    q_measured: Array | None = None
    dq_measured: Array | None = None
    tau_applied: Array | None = None
    sensed: Array | None = None
    orientation: Array | None = None
    orientation_ref: Array | None = None
    plant: str = "core"
    replans: tuple[Replan, ...] = ()

    @classmethod
    def of(cls, scenario: Scenario, told: Mapping[str, Any], plant: str = "core") -> Self:
        """What the core tells of a run of a scenario."""
        return cls(
            scenario=scenario,
            status=Status(told["status"]),
            message=told["message"],
            end_time=told["end_time"],
            wall_time=told["wall_time"],
            warnings=tuple(told["warnings"]),
            metrics=Metrics(told["metrics"], Layout.of(scenario._document)),
            version=_core.__version__,
            replans=tuple(Replan(**search) for search in told["replans"]),
            plant=plant,
            **told["record"],
        )

    def __repr__(self) -> str:
        return (
            f"<Result of {self.scenario.name or 'a scenario'}: {self.status} at {self.end_time:g} s, "
            f"{len(self.t)} instants>"
        )

    @property
    def headline(self) -> Headline:
        """What is to be known first: contact, limits, a lost reference; the worst comes first."""
        from vffnull.model.headline import headline, passing

        ignoring = passing(self.scenario.to_dict())
        arm, slides = self.scenario.arm, self.layout.slides
        return headline(self.status, self.message, self.metrics, arm, slides, ignoring)

    @property
    def layout(self) -> Layout:
        """Where the run took place: what its columns are called and which units they have."""
        return Layout.of(self.scenario.to_dict())

    def recorded(self) -> dict[str, Array]:
        """Every recorded quantity that this run has, by name; time is not among them."""
        return recorded(self)
