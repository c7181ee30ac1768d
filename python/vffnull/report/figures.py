"""The figures of a page, drawn by Bokeh; `page.js` moves what their names say."""

from __future__ import annotations

from typing import Any

import numpy as np
from bokeh.models import (
    BoxAnnotation,
    ColumnDataSource,
    CustomJS,
    CustomJSTickFormatter,
    HoverTool,
    Range1d,
    Span,
    WheelZoomTool,
)
from bokeh.plotting import figure
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from vffnull.plotting import geometry, style
from vffnull.result import Result

Array = NDArray[np.float64]

_INSTANTS = 1500
_OBSTACLE, _FORCE, _TRAIL = "#D55E00", "#B2182B", "#222222"
_LONGEST = 0.12  # of the picture's width, the arrow of the greatest force
_SEEK = "window.vffnullSeek && window.vffnullSeek(cb_obj.x)"


def chosen(result: Result) -> NDArray[np.intp]:
    """The instants that the page holds: evenly many, and those of every extreme that a plot shows."""
    even = np.linspace(0, len(result.t) - 1, min(_INSTANTS, len(result.t))).astype(np.intp)
    shown = np.column_stack([error_magnitude(result), result.clearance, result.force, result.tau])
    return np.unique(np.concatenate([even, shown.argmax(axis=0), shown.argmin(axis=0)]))


def error_magnitude(result: Result) -> Array:
    """The distance between end effector and reference (T,) [m]."""
    return np.asarray(np.linalg.norm(result.error[:, :2], axis=1))


def halos(result: Result) -> list[Array]:
    """How far the fields of the obstacles reach, as outlines; nothing without a field."""
    reach = influence(result)
    return [] if reach is None else geometry.obstacle_outlines(result, margin=reach)


def influence(result: Result) -> float | None:
    """The influence distance [m] of a field that is there and switched on."""
    field = result.scenario.to_dict().get("controller", {}).get("field", {})
    return float(field["influence"]) if field.get("gain") else None


def longest_arrow(result: Result) -> float:
    """Length of the arrow of the greatest force [m]."""
    left, right, *_ = geometry.frame(result)
    return _LONGEST * (right - left)


def run_colours(count: int) -> list[str]:
    """One colour for each run."""
    return [to_hex(colour) for colour in style.joint_colours(count)]


def link_key(result: Result) -> list[tuple[str, str]]:
    """The number and the colour of every link."""
    colours = style.joint_colours(result.tau.shape[1])
    return [(str(i + 1), to_hex(colour)) for i, colour in enumerate(colours)]


def arm(result: Result, index: int, count: int) -> figure:
    """The scene; all that moves has a name that ends in the run's index."""
    left, right, bottom, top = geometry.frame(result)
    width = {1: 560, 2: 560}.get(count, 350)
    height = int(np.clip(width * (top - bottom) / (right - left), 0.55 * width, 0.95 * width))
    scale = max((right - left) / width, (top - bottom) / height)
    x, y = (left + right) / 2, (bottom + top) / 2
    fig = figure(
        frame_width=width,
        frame_height=height,
        x_range=Range1d(x - scale * width / 2, x + scale * width / 2),
        y_range=Range1d(y - scale * height / 2, y + scale * height / 2),
        tools="pan,wheel_zoom,reset,save",
        toolbar_location="above" if count == 1 else None,
        x_axis_label="x [m]",
        y_axis_label="y [m]",
    )
    _dress(fig)
    if fig.toolbar.tools:
        fig.toolbar.active_scroll = fig.select_one(WheelZoomTool)

    def empty(what: str, *columns: str) -> ColumnDataSource:
        return ColumnDataSource({column: [] for column in columns}, name=f"{what}-{index}")

    follow = result.x_ref[chosen(result), :2]
    if np.ptp(follow, axis=0).max() > 0.0:
        fig.line(*follow.T, line_color="#999999", line_dash="4 3", line_width=1)
    fig.patches("xs", "ys", source=empty("halos", "xs", "ys"), fill_color=_OBSTACLE, fill_alpha=0.05,
                line_color=_OBSTACLE, line_alpha=0.45, line_dash="1 4")  # fmt: skip
    fig.patches("xs", "ys", source=empty("solids", "xs", "ys"), fill_color=_OBSTACLE, fill_alpha=0.22,
                line_color=_OBSTACLE, line_width=1.5)  # fmt: skip
    fig.patches("xs", "ys", source=empty("bodies", "xs", "ys", "colour"), fill_color="colour",
                fill_alpha=0.25, line_color="colour", line_width=1.2)  # fmt: skip
    fig.scatter([0.0], [0.0], marker="square", size=13, color=style.INK)
    thick = bool(geometry.link_radii(result).max() > 0.0)
    fig.multi_line("xs", "ys", source=empty("links", "xs", "ys", "colour"), line_color="colour",
                   line_width=1.2 if thick else 4, line_cap="round")  # fmt: skip
    fig.line("x", "y", source=empty("trail", "x", "y"), line_color=_TRAIL, line_width=2)
    fig.scatter("x", "y", source=empty("joints", "x", "y"), size=8, fill_color="white", line_color=style.INK,
                line_width=1.4)  # fmt: skip
    fig.multi_line("xs", "ys", source=empty("arrows", "xs", "ys"), line_color=_FORCE, line_width=2.2,
                   line_cap="round")  # fmt: skip
    fig.patches("xs", "ys", source=empty("heads", "xs", "ys"), fill_color=_FORCE, line_color=_FORCE)
    fig.scatter("x", "y", source=empty("target", "x", "y"), marker="x", size=11, line_color=style.INK,
                line_width=1.8)  # fmt: skip
    return fig


def plots(runs: list[Result], names: list[str]) -> list[figure]:
    """The plots over a common time: of one run a line per link or joint, of several a line per run."""
    alone = len(runs) == 1
    end = max(float(run.t[-1]) for run in runs)
    time = Range1d(min(float(run.t[0]) for run in runs), max(end, 1e-9))
    rows = [chosen(run) for run in runs]
    obstacles = any(run.obstacles.shape[1] for run in runs)
    colours = run_colours(len(runs))

    def lines(pick: Any, reduce: Any, noun: str) -> list[tuple[str, str, Array, Array]]:
        """Name, colour, times and values of the lines of a panel."""
        if alone:
            values = pick(runs[0])[rows[0]]
            shades = [colour for _, colour in link_key(runs[0])]
            return [
                (f"{noun} {i + 1}", shades[i], runs[0].t[rows[0]], values[:, i])
                for i in range(values.shape[1])
            ]
        return [
            (name, colour, run.t[row], reduce(pick(run)[row]))
            for name, colour, run, row in zip(names, colours, runs, rows, strict=True)
        ]

    found = [(run.t[row], error_magnitude(run)[row]) for run, row in zip(runs, rows, strict=True)]
    error = _error(found, ["error"] if alone else names, [style.INK] if alone else colours, time)
    made = [error]
    if obstacles:
        made.append(_clearance(lines(lambda run: run.clearance, lambda v: v.min(axis=1), "link"), runs, time))
        label = "repulsion on links [N]" if alone else "largest repulsion [N]"
        force = lines(lambda run: run.force, lambda v: v.max(axis=1), "link")
        made.append(_panel(label, force, time, "N"))
    label = "joint torque [N·m]" if alone else "largest |torque| [N·m]"
    torque = lines(lambda run: run.tau, lambda v: np.abs(v).max(axis=1), "joint")
    made.append(_panel(label, torque, time, "N·m"))
    if alone:
        made.append(_chooser(time, [colour for _, colour in link_key(runs[0])]))
    made[-1].xaxis.axis_label = "time [s]"
    made[-1].height += 22
    return made


def _frame(label: str, time: Range1d, **how: Any) -> figure:
    fig = figure(
        sizing_mode="stretch_width",
        height=168,
        min_width=320,
        x_range=time,
        y_axis_label=label,
        tools="xpan,xwheel_zoom,reset",
        toolbar_location=None,
        min_border_left=74,
        **how,
    )
    _dress(fig)
    fig.toolbar.active_scroll = None
    now = Span(location=0.0, dimension="height", line_color="#111111", line_width=1.2, name="now")
    fig.add_layout(now)
    fig.js_on_event("tap", CustomJS(code=_SEEK))
    return fig


def _panel(
    label: str, lines: list[tuple[str, str, Array, Array]], time: Range1d, unit: str, **how: Any
) -> figure:
    fig = _frame(label, time, **how)
    for name, colour, t, values in lines:
        drawable = np.where(np.isfinite(values), values, np.nan).astype(np.float32)
        source = ColumnDataSource({"t": t.astype(np.float32), "value": drawable})
        line = fig.line("t", "value", source=source, line_color=colour, line_width=1.7)
        tip = [("", f"{name}: @value{{0.0000}} {unit} at @t{{0.00}} s")]
        fig.add_tools(HoverTool(renderers=[line], tooltips=tip, mode="mouse", visible=False))
    return fig


def _error(found: list[tuple[Array, Array]], names: list[str], colours: list[str], time: Range1d) -> figure:
    """The error's magnitude on a logarithmic scale; a zero has no place there and leaves a gap."""
    lines, positive = [], [values[values > 0] for _, values in found]
    for name, colour, (t, values) in zip(names, colours, found, strict=True):
        lines.append((name, colour, t, np.where(values > 0, values, np.nan)))
    every = np.concatenate(positive)
    low = 10.0 ** np.floor(np.log10(max(np.percentile(every, 1), 1e-16))) if every.size else 1e-16
    high = 10.0 ** np.ceil(np.log10(every.max()) + 0.05) if every.size else 1e-12
    fig = _panel("tracking error [m]", lines, time, "m", y_axis_type="log", y_range=Range1d(low, high))
    for hover in fig.select(HoverTool):
        hover.tooltips = [("", "@value{0.00e+0} m at @t{0.00} s")]
    fig.yaxis.formatter = CustomJSTickFormatter(
        code="""
        const power = Math.round(Math.log10(tick))
        if (Math.abs(Math.log10(tick) - power) > 1e-6) return ''
        return '10' + [...String(power)].map(c => c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[c]).join('')
        """
    )
    return fig


def _clearance(lines: list[tuple[str, str, Array, Array]], runs: list[Result], time: Range1d) -> figure:
    """Distances, with contact and the reach of the field; what is far beyond that is cut off."""
    values = np.concatenate([values for *_, values in lines])
    values = values[np.isfinite(values)]
    reaches = [reach for run in runs if (reach := influence(run)) is not None]
    low = min(0.0, float(values.min(initial=0.0)))
    high = float(values.max(initial=0.1))
    if reaches:
        high = min(high, 3.0 * max(reaches))
    pad = 0.06 * (high - low)
    fig = _panel("clearance [m]", lines, time, "m", y_range=Range1d(low - pad, high + pad))
    fig.add_layout(BoxAnnotation(top=0.0, fill_color=_FORCE, fill_alpha=0.09, line_color=None))
    fig.add_layout(Span(location=0.0, dimension="width", line_color=_FORCE, line_width=1))
    for reach in sorted(set(reaches)):
        fig.add_layout(Span(location=reach, dimension="width", line_color="#888888", line_dash="5 4"))
    return fig


def _chooser(time: Range1d, colours: list[str]) -> figure:
    """The panel of the quantity that the reader chooses; the script fills it."""
    fig = _frame(" ", time)
    fig.name = "chosen-figure"
    source = ColumnDataSource({"xs": [], "ys": [], "colour": [], "name": []}, name="chosen")
    lines = fig.multi_line("xs", "ys", source=source, line_color="colour", line_width=1.7)
    fig.add_tools(HoverTool(renderers=[lines], tooltips=[("", "@name")], visible=False))
    fig.tags = colours
    return fig


def _dress(fig: figure) -> None:
    """The look that all figures share."""
    font = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif"
    fig.background_fill_color = fig.border_fill_color = "#ffffff"
    fig.outline_line_color = None
    fig.grid.grid_line_color = "#ececec"
    fig.toolbar.logo = None
    for axis in fig.axis:
        axis.axis_label_text_font = axis.major_label_text_font = font
        axis.axis_label_text_font_style = "normal"
        axis.axis_label_text_font_size, axis.major_label_text_font_size = "12px", "11px"
        axis.axis_label_text_color = axis.major_label_text_color = "#444444"
        axis.axis_line_color = axis.major_tick_line_color = "#999999"
        axis.minor_tick_line_color = None
    fig.yaxis.ticker.desired_num_ticks = 5
