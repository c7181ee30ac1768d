"""A study as one page that needs no network: effects, pairs, the Pareto front, failures, indices."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.embed import components

from vffnull.draw.report.frame import fill
from vffnull.draw.style import prefixed
from vffnull.studies import pictures
from vffnull.studies.findings import Findings, chosen, findings, whole_runs
from vffnull.studies.reading import Runs
from vffnull.studies.tuning import trials_of

__all__ = ["render"]

_HERE = Path(__file__).parent
_MAX_METRICS = 6


def render(dataset: Runs, metrics: Iterable[str] | None) -> str:
    """The whole page."""
    found = findings(dataset, metrics)
    shown = chosen(dataset, metrics, _MAX_METRICS)
    names = list(
        dict.fromkeys(
            [*shown, *(n for n in ("min_clearance", "max_error_transient") if n in dataset.metrics)]
        )
    )
    columns = whole_runs(dataset.columns(["run", "status", *dataset.factors, *names]), names)
    drawn = [
        ("Main effects", "The mean over every factor; 5 to 95 % of the runs lie in the band.",
         pictures.main_effects(dataset, columns, shown)),
        ("Clearance against tracking", "Blue: runs that no other one beats in both.",
         pictures.pareto(dataset, columns)),
        ("Where runs fail", "Collided, diverged, failed or refused, over the two factors that decide most.",
         pictures.failure_map(dataset, columns)),
        (f"Pairs, coloured by {shown[0]}" if shown else "", "Yellow is more. A run tells its number.",
         pictures.pairs(dataset, columns, shown[0]) if shown else []),
    ]  # fmt: skip
    drawn = [each for each in drawn if each[2]]
    plots = [plot for _, _, several in drawn for plot in several]
    script, slots = components(plots) if plots else ("", ())
    places = iter(slots)
    tuned = trials_of(dataset) if dataset.manifest["tuned"] else None
    return fill(
        _HERE / "page.html",
        title=dataset.plan.name or "A study",
        description=dataset.plan.description,
        cards=_cards(dataset, found),
        figures=[(heading, hint, [next(places) for _ in several]) for heading, hint, several in drawn],
        factors=dataset.factors,
        shares=_shares(found),
        shares_hint="Sobol indices in per cent, with 95 % intervals: alone / together with others."
        if found.indices
        else "Share of the variance that each factor explains alone, in per cent.",
        goals=dataset.goals if tuned else [],
        trials=[
            [trial.number, *map(_number, trial.values or ()), *map(_number, trial.factors.values())]
            for trial in (tuned.best if tuned else ())
        ],
        metrics=[
            (
                name,
                [_number(found.metrics[name][i]) for i in (1, 2, 3)],
                found.units[name],
                dataset.meaning(name),
            )
            for name in found.metrics
        ],
        document=json.dumps(dataset.manifest["study"], indent=1, ensure_ascii=False),
        version=dataset.manifest["versions"]["vffnull"],
        place=dataset.place,
        script=script,
    )


def _cards(dataset: Runs, found: Findings) -> list[tuple[str, str, str]]:
    """What stands in large letters: how far it is, how much failed, and the medians of the main metrics."""
    rate = found.failures
    cards = [
        (f"{found.runs:,}", f"of {found.of:,}" if found.runs != found.of else "", "runs"),
        (
            f"{100 * rate.value:.1f}",
            "%",
            f"failed; 95 % interval {100 * rate.low:.1f} to {100 * rate.high:.1f}",
        ),
    ]
    for name in list(found.metrics)[:4]:
        middle = float(found.metrics[name][2])
        if np.isfinite(middle):
            factor, unit = prefixed(abs(middle), found.units[name]) if middle else (1.0, found.units[name])
            cards.append(
                (f"{middle * factor:.3g}".replace("-", "−"), unit, f"median: {dataset.meaning(name)}")
            )
    return cards


def _shares(found: Findings) -> list[tuple[str, list[str]]]:
    if found.indices:
        return [
            (name, [f"{_interval(each.first)} / {_interval(each.total)}" for each in several])
            for name, several in found.indices.items()
        ]
    return [(name, [_percent(each) for each in shares]) for name, shares in found.explained.items()]


def _interval(values: Any) -> str:
    if not np.isfinite(values[0]):
        return "–"
    return f"{100 * values[0]:.0f} [{100 * values[1]:.0f}, {100 * values[2]:.0f}]".replace("-", "−")


def _percent(share: float) -> str:
    return f"{100 * share:.0f}" if np.isfinite(share) else "–"


def _number(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if np.isfinite(value) else "–"
    return str(value)
