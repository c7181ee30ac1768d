"""The pictures of a study, drawn by Bokeh. What comes from a document is shown as text, never as a page."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from bokeh.layouts import gridplot
from bokeh.models import ColumnDataSource, FixedTicker, HoverTool
from bokeh.palettes import Viridis256
from bokeh.plotting import figure
from bokeh.transform import linear_cmap
from numpy.typing import NDArray

from vffnull.draw.style import ALARM, INK, MUTED
from vffnull.studies.effects import bins_of, effect, explained, front
from vffnull.studies.factors import Factor
from vffnull.studies.findings import FAILURES, coordinates
from vffnull.studies.reading import Runs

__all__ = ["failure_map", "main_effects", "pairs", "pareto"]

Columns = dict[str, NDArray[Any]]

_MAX_POINTS = 2000
_MAX_PAIRS = 5  # factors
_BLUE = "#0072B2"
_CELLS = 8


def main_effects(dataset: Runs, columns: Columns, metrics: list[str]) -> list[Any]:
    """Every metric over every factor: the mean, and what lies between the 5th and the 95th percentile."""
    axes = coordinates(dataset, columns)
    rows = []
    for name in metrics:
        values, row, first = columns[name], [], None
        if not np.isfinite(values).any():
            continue
        for factor, axis in zip(dataset.plan.factors, axes, strict=True):
            found = effect(axis, values)
            at = np.exp(found.at) if factor.log else found.at
            shared: dict[str, Any] = {} if first is None else {"y_range": first.y_range}
            fig = figure(
                width=230,
                height=180,
                x_axis_type="log" if factor.log else "linear",
                toolbar_location=None,
                tools="",
                **shared,
            )
            source = ColumnDataSource(
                {"x": at, "mean": found.mean, "low": found.low, "high": found.high, "n": found.count}
            )
            fig.varea("x", "low", "high", source=source, fill_color=_BLUE, fill_alpha=0.15)
            fig.line("x", "mean", source=source, color=_BLUE, line_width=2)
            dots = fig.scatter("x", "mean", source=source, color=_BLUE, size=5)
            fig.add_tools(
                HoverTool(renderers=[dots], tooltips=[("at", "@x"), ("mean", "@mean"), ("runs", "@n")])
            )
            _axis(fig.xaxis, factor)
            if first is None:
                first = fig
                fig.yaxis.axis_label = _labelled(name, dataset.unit(name))
            row.append(_dressed(fig))
        rows.append(row)
    return [gridplot(rows, toolbar_location=None)] if rows and rows[0] else []


def pairs(dataset: Runs, columns: Columns, metric: str) -> list[Any]:
    """Every factor against every other, coloured by a metric."""
    factors = dataset.plan.factors[:_MAX_PAIRS]
    if len(factors) < 2:
        return []
    chosen = _some(len(columns["run"]))
    source = _source(dataset, columns, chosen, [metric])
    values = columns[metric][chosen]
    shown = values[np.isfinite(values)]
    if not len(shown):
        return []
    low, high = np.quantile(shown, (0.02, 0.98))
    colour = linear_cmap(metric, Viridis256, float(low), float(high) if high > low else float(low) + 1.0)
    rows = []
    for down in factors[1:]:
        row: list[Any] = []
        for across in factors[:-1]:
            if factors.index(across) >= factors.index(down):
                row.append(None)
                continue
            fig = figure(
                width=230,
                height=210,
                x_axis_type="log" if across.log else "linear",
                y_axis_type="log" if down.log else "linear",
                toolbar_location=None,
                tools="box_select,tap",
            )
            dots = fig.scatter(_place(across), _place(down), source=source, color=colour, size=4, alpha=0.8)
            fig.add_tools(HoverTool(renderers=[dots], tooltips=_tooltips(dataset, [metric])))
            _axis(fig.xaxis, across)
            _axis(fig.yaxis, down)
            row.append(_dressed(fig))
        rows.append(row)
    return [gridplot(rows, toolbar_location=None)]


def pareto(dataset: Runs, columns: Columns) -> list[Any]:
    """Clearance against tracking error, with the runs that no other one beats in both."""
    error = next((name for name in ("max_error_transient", "max_error_tail") if name in columns), None)
    if error is None or "min_clearance" not in columns:
        return []
    best = front(np.stack([columns[error], -columns["min_clearance"]], axis=1))
    if not len(best):
        return []
    positive = np.all(columns[error][np.isfinite(columns[error])] > 0)
    fig = figure(
        sizing_mode="stretch_width",
        height=360,
        x_axis_type="log" if positive else "linear",
        tools="pan,box_zoom,wheel_zoom,reset,save",
    )
    names = [error, "min_clearance"]
    every = _source(dataset, columns, np.union1d(_some(len(columns["run"])), best), names)
    winners = _source(dataset, columns, best, names)
    fig.scatter(error, "min_clearance", source=every, color=MUTED, size=4, alpha=0.5)
    fig.step(error, "min_clearance", source=winners, color=_BLUE, mode="after", line_width=1.5)
    dots = fig.scatter(error, "min_clearance", source=winners, color=_BLUE, size=8)
    fig.add_tools(HoverTool(renderers=[dots], tooltips=_tooltips(dataset, names)))
    fig.xaxis.axis_label = _labelled(error, dataset.unit(error))
    fig.yaxis.axis_label = _labelled("min_clearance", dataset.unit("min_clearance"))
    return [_dressed(fig)]


def failure_map(dataset: Runs, columns: Columns) -> list[Any]:
    """The share of failures over the two factors that decide most about it."""
    failed = np.isin(columns["status"], FAILURES).astype(float)
    axes = coordinates(dataset, columns)
    if len(axes) < 2 or not 0 < failed.sum() < len(failed):
        return []
    shares = np.nan_to_num([explained(axis, failed) for axis in axes])
    one, other = sorted(np.argsort(-shares, kind="stable")[:2].tolist())
    across, down = dataset.plan.factors[one], dataset.plan.factors[other]
    left, right, x_bins = _cells(axes[one], across)
    low, high, y_bins = _cells(axes[other], down)
    count = np.zeros((len(left), len(low)))
    hits = np.zeros_like(count)
    np.add.at(count, (x_bins, y_bins), 1.0)
    np.add.at(hits, (x_bins, y_bins), failed)
    i, j = np.nonzero(count)
    fig = figure(
        sizing_mode="stretch_width",
        height=360,
        x_axis_type="log" if across.log else "linear",
        y_axis_type="log" if down.log else "linear",
        toolbar_location=None,
        tools="",
    )
    source = ColumnDataSource(
        {
            "left": left[i],
            "right": right[i],
            "bottom": low[j],
            "top": high[j],
            "rate": hits[i, j] / count[i, j],
            "n": count[i, j],
        }
    )
    cells = fig.quad(
        "left", "right", "bottom", "top", source=source, color=linear_cmap("rate", _REDS, 0.0, 1.0)
    )
    fig.add_tools(HoverTool(renderers=[cells], tooltips=[("failed", "@rate{0.0 %}"), ("runs", "@n")]))
    fig.add_layout(cells.construct_color_bar(title="share of failures"), "right")
    _axis(fig.xaxis, across)
    _axis(fig.yaxis, down)
    return [_dressed(fig)]


_REDS = [
    "#" + "".join(f"{round(255 + (int(ALARM[k : k + 2], 16) - 255) * share):02x}" for k in (1, 3, 5))
    for share in np.linspace(0.0, 1.0, 64)
]


def _cells(axis: NDArray[np.float64], factor: Factor) -> tuple[Any, Any, Any]:
    """The ends of the bins of a factor, and the bin of every run."""
    at = bins_of(axis, _CELLS)
    at = np.unique(at, return_inverse=True)[1].reshape(-1)
    middles = np.array([axis[at == each].mean() for each in range(at.max() + 1)])
    if len(middles) > 1:
        between = (middles[:-1] + middles[1:]) / 2
        edges = np.concatenate([[2 * middles[0] - between[0]], between, [2 * middles[-1] - between[-1]]])
    else:
        edges = middles[0] + np.array([-0.5, 0.5])
    edges = np.exp(edges) if factor.log else edges
    return edges[:-1], edges[1:], at


def _some(count: int) -> NDArray[np.intp]:
    """Some places out of many, the same ones every time."""
    if count <= _MAX_POINTS:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, _MAX_POINTS, replace=False))


def _source(dataset: Runs, columns: Columns, rows: NDArray[np.intp], metrics: list[str]) -> ColumnDataSource:
    data: dict[str, Any] = {name: columns[name][rows] for name in ("run", "status", *metrics)}
    for factor in dataset.plan.factors:
        data[_place(factor)] = _numbers(factor, columns[factor.name][rows])
        data[factor.name] = columns[factor.name][rows]
    return ColumnDataSource(data)


def _place(factor: Factor) -> str:
    """The column with the places of a factor's values on an axis."""
    return f"{factor.name} on its axis"


def _numbers(factor: Factor, values: NDArray[Any]) -> NDArray[np.float64]:
    if factor.values is None:
        return values.astype(float)
    places = {value: float(i) for i, value in enumerate(factor.column(np.arange(float(len(factor.values)))))}
    return np.array([places[each] for each in values.tolist()])


def _tooltips(dataset: Runs, metrics: list[str]) -> list[tuple[str, str]]:
    """What is said of a run; the names are escaped by Bokeh, which shows them as text."""
    names = ["run", "status", *metrics, *dataset.factors]
    return [(name, "@{" + name.replace("}", "") + "}") for name in names]


def _axis(axis: Any, factor: Factor) -> None:
    if factor.log:
        axis.ticker = FixedTicker(ticks=_round_numbers(factor.low, factor.high))
    else:
        axis.ticker.desired_num_ticks = 3  # small figures: labels must not meet
        axis.ticker.num_minor_ticks = 0
    axis.axis_label = _labelled(factor.name, factor.unit)
    if factor.values is not None:
        places = list(range(len(factor.values)))
        axis.ticker = FixedTicker(ticks=places[:20])
        axis.major_label_overrides = {i: str(factor.values[i]) for i in places[:20]}


def _round_numbers(low: float, high: float) -> list[float]:
    """Three or four of the numbers 1, 2, 5, 10, … between two positive ones, evenly thinned out."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    within = [m * 10.0**k for k in decades for m in (1, 2, 5) if low <= m * 10.0**k <= high]
    return within[:: max(1, math.ceil(len(within) / 4))] or [low, high]


def _labelled(name: str, unit: str) -> str:
    return f"{name} [{unit}]" if unit else name


def _dressed(fig: Any) -> Any:
    fig.outline_line_color = None
    fig.grid.grid_line_color = "#E4E4E4"
    fig.axis.axis_label_text_font_style = "normal"
    fig.axis.axis_label_text_font_size = "12px"
    fig.axis.axis_label_text_color = INK
    return fig
