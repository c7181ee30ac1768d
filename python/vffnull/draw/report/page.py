"""The page as text: facts in tables, figures, and the script that moves them."""

from __future__ import annotations

import json
import platform
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.embed import components

from vffnull.draw import replans, style
from vffnull.draw.primitives import COLOURS
from vffnull.draw.report import figures, motion, space
from vffnull.draw.report.assumptions import assumptions
from vffnull.draw.report.figures import Run
from vffnull.draw.report.frame import fill
from vffnull.draw.scene import drawable
from vffnull.draw.style import prefixed
from vffnull.model.outcome import readable, seconds

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome
    from vffnull.model.scenario import Scenario

_HERE = Path(__file__).parent

_MAIN = ("min_clearance", "max_error_transient", "max_error_tail", "max_repulsion", "peak_torque")
"""Metrics that stand in large letters at the top, where they apply."""


def render(results: list[Outcome], names: list[str]) -> str:
    """The whole page."""
    runs = [Run.of(drawable(result)) for result in results]
    colours = figures.run_colours(len(runs))
    flat = {i: figures.arm(run, i, len(runs)) for i, run in enumerate(runs) if run.scene.dimension == 2}
    key = figures.link_key(runs[0])
    links = (
        [[colour for _, colour in key]]
        if len(runs) == 1
        else [[colour] * len(run.scene.radii) for run, colour in zip(runs, colours, strict=True)]
    )
    plots = figures.plots(runs, names)
    script, slots = components([*flat.values(), *plots])
    drawn = dict(zip(flat, slots, strict=False))
    alone = results[0] if len(results) == 1 else None
    scripts = ("page.js",) if len(flat) == len(runs) else ("webgl.js", "flat.js", "space.js", "page.js")
    return fill(
        _HERE / "page.html",
        title=_title(results, names),
        alone=alone,
        runs=list(zip(results, names, colours, strict=True)),
        description=results[0].scenario.description if alone or _same_scenario(results) else "",
        arms=list(zip(map(drawn.get, range(len(runs))), names, colours, strict=True)),
        space=len(flat) < len(runs),
        near=_near(runs),
        shades=[f"rgb{shade}" for shade in (style.CONTACT, style.NEAR, style.FREE)],
        plots=slots[len(flat) :],
        links=key if alone else [],
        plan=COLOURS["plan"] if any(run.scene.plan for run in runs) else "",
        planned=[
            (name, line) for run, name in zip(results, names, strict=True) for line in replans.summary(run)
        ],
        replanned=any(run.replans for run in results),
        cards=list(_cards(alone)) if alone else [],
        metrics=list(_metrics(results)),
        missing=dict(_missing(results)),
        differences=list(_differences(results)),
        scenarios=[
            (name, _glance(run.scenario), str(run.scenario)) for run, name in zip(results, names, strict=True)
        ],
        assumptions=_assumed(results, names),
        warnings=[message for run in results for message in run.warnings],
        version=results[0].version,
        versions=sorted({run.version for run in results}),
        python=platform.python_version(),
        numpy=np.__version__,
        wall=[seconds(run.wall_time) for run in results],
        instants=dict.fromkeys(f"{len(run.rows)} of {len(run.result.t)}" for run in runs),
        script=script,
        code=[(_HERE / name).read_text(encoding="utf-8") for name in scripts],
        data=_for_script([motion.pack(run, shades) for run, shades in zip(runs, links, strict=True)]),
    )


def _assumed(results: list[Outcome], names: list[str]) -> list[str]:
    """What the runs take for granted: first what all do, then what some do, with their names."""
    found: dict[str, list[str]] = {}
    for run, name in zip(results, names, strict=True):
        for line in dict.fromkeys(assumptions(run)):
            found.setdefault(line, []).append(name)
    common = [line for line, who in found.items() if len(who) == len(names)]
    return [*common, *(f"{', '.join(who)}: {line}" for line, who in found.items() if len(who) < len(names))]


def _near(runs: list[Run]) -> str:
    """The clearance from which on links in space have the colour of those that nothing is near."""
    found = {f"{space.near(run.scene):.3g} m" for run in runs if run.scene.dimension == 3}
    return found.pop() if len(found) == 1 else "far"


def _glance(scenario: Scenario) -> str:
    """What a scenario is about, where its text is folded."""
    joints, obstacles = scenario.arm.n, len(scenario.to_dict().get("obstacles", []))
    return (
        f"{joints} {'joint' if joints == 1 else 'joints'}, "
        f"{obstacles or 'no'} {'obstacle' if obstacles == 1 else 'obstacles'}, {scenario.duration:g} s"
    )


def _for_script(value: object) -> str:
    """JSON that cannot end the script element it stands in."""
    return json.dumps(value, allow_nan=False).replace("<", "\\u003c")


def _title(results: list[Outcome], names: list[str]) -> str:
    if len(results) == 1:
        return results[0].scenario.name or "A run"
    return (
        f"{len(names)} runs of {results[0].scenario.name or 'a scenario'}"
        if _same_scenario(results)
        else " · ".join(names)
    )


def _same_scenario(results: list[Outcome]) -> bool:
    return len({result.scenario.name for result in results}) == 1


def _cards(result: Outcome) -> Iterator[tuple[str, str, str]]:
    """The main metrics with a prefixed unit: value, unit, meaning."""
    for name in _MAIN:
        value = result.metrics.get(name)
        if value is not None and np.isfinite(value):
            unit, meaning = result.layout.metric(name)
            if 0.0 < abs(float(value)) < 1e-12:
                yield "< 1", f"p{unit}", meaning
                continue
            factor, prefixed_unit = prefixed(abs(float(value)), unit)
            yield f"{float(value) * factor:.3g}".replace("-", "−"), prefixed_unit, meaning


def _metrics(results: list[Outcome]) -> Iterator[tuple[str, list[str], str, str]]:
    """Rows of the table: name, the value in every run, unit, meaning; of what has a value in one."""
    for name in results[0].metrics:
        if _is_missing(name, results):
            continue
        unit, meaning = results[0].layout.metric(name)
        if len(results) == 1:
            meaning = results[0].layout.told(name, results[0].metrics[name])
        yield name, [readable(run.metrics.get(name)) for run in results], unit, meaning


def _missing(results: list[Outcome]) -> Iterator[tuple[str, str]]:
    """Name and meaning of what has no value in any run."""
    for name in results[0].metrics:
        if _is_missing(name, results):
            yield name, results[0].layout.metric(name)[1]


def _is_missing(name: str, results: list[Outcome]) -> bool:
    """Whether no run has a value of a metric."""
    return all(run.metrics.get(name) is None for run in results)


def _differences(results: list[Outcome]) -> Iterator[tuple[str, list[str]]]:
    """The scenario keys that are not the same in all runs, with the value in each."""
    flat = [dict(_flat(result.scenario.to_dict())) for result in results]
    for name in dict.fromkeys(key for each in flat for key in each):
        values = [each.get(name) for each in flat]
        if any(value != values[0] for value in values):
            yield name, ["–" if value is None else json.dumps(value) for value in values]


def _flat(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _flat(inner, f"{path}.{key}" if path else key)
    elif isinstance(value, list) and any(isinstance(inner, dict) for inner in value):
        for i, inner in enumerate(value):
            yield from _flat(inner, f"{path}.{i}")
    else:
        yield path, value
