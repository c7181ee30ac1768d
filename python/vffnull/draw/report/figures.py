"""The figures of a page, drawn by Bokeh; `page.js` moves what their names say.

What comes from a document or a file is never part of a template: names of runs are names of glyphs, which
Bokeh shows as text.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from bokeh.models import (
    BoxAnnotation,
    ColumnDataSource,
    CustomJS,
    CustomJSTickFormatter,
    FixedTicker,
    HoverTool,
    Label,
    Range1d,
    Span,
    WheelZoomTool,
)
from bokeh.plotting import figure
from matplotlib.colors import to_hex
from numpy.typing import NDArray

from vffnull.draw import style
from vffnull.draw.figures import tracking
from vffnull.draw.primitives import COLOURS, Curve
from vffnull.draw.scene import Scene

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

Array = NDArray[np.float64]

SHORTEST = 1e-3
"""An axis of time is no shorter than that [s]."""

_INSTANTS = 1500
_LONGEST = 0.12  # of the picture's width, the arrow of the greatest force
_SEEK = "window.vffnullSeek && window.vffnullSeek(cb_obj.x)"
_FIT = """
const wide = fig.inner_width, high = fig.inner_height
if (!(wide > 0 && high > 0)) return
const scale = Math.max(spans[0] / wide, spans[1] / high) / 2
fig.x_range.setv({start: middle[0] - scale * wide, end: middle[0] + scale * wide})
fig.y_range.setv({start: middle[1] - scale * high, end: middle[1] + scale * high})
"""
"""One metre is as long upwards as across, however large the picture is."""


@dataclass(frozen=True, eq=False)
class Run:
    """A run as a page shows it."""

    result: Outcome
    scene: Scene
    """At all recorded instants."""
    rows: NDArray[np.intp]
    """Those that the page holds."""

    @classmethod
    def of(cls, result: Outcome) -> Run:
        """The instants are evenly many, and those of every extreme that a plot shows."""
        even = np.linspace(0, len(result.t) - 1, min(_INSTANTS, len(result.t))).astype(np.intp)
        error = tracking.distance(result)
        shown = np.column_stack([error, result.clearance, result.force, result.tau])
        rows = np.unique(np.concatenate([even, shown.argmax(axis=0), shown.argmin(axis=0)]))
        return cls(result, Scene.of_result(result), rows)

    @property
    def t(self) -> Array:
        """The times of the instants [s]."""
        return self.result.t[self.rows]

    @property
    def error(self) -> Array:
        """How far the end effector is from its reference then [m]."""
        return tracking.distance(self.result)[self.rows]

    @property
    def longest_arrow(self) -> float:
        """Length of the arrow of the greatest force [m]."""
        low, high = self.scene.frame(field=True)
        return _LONGEST * float(high[0] - low[0])


def run_colours(count: int) -> list[str]:
    """One colour for each run."""
    return [to_hex(colour) for colour in style.joint_colours(count)]


def link_key(run: Run) -> list[tuple[str, str]]:
    """The number, from 0 at the base, and the colour of every link."""
    colours = style.joint_colours(run.result.tau.shape[1])
    return [(str(i), to_hex(colour)) for i, colour in enumerate(colours)]


def arm(run: Run, index: int, count: int) -> figure:
    """A scene of the plane; all that moves has a name that ends in the run's index."""
    low, high = run.scene.frame(field=True)
    spans = high - low
    fig = figure(
        sizing_mode="scale_width",
        aspect_ratio=float(np.clip(spans[0] / spans[1], 1.1, 1.8)),
        min_width=200,
        x_range=Range1d(float(low[0]), float(high[0])),
        y_range=Range1d(float(low[1]), float(high[1])),
        tools="pan,wheel_zoom,reset,save",
        toolbar_location="above" if count == 1 else None,
    )
    fig.xaxis.axis_label, fig.yaxis.axis_label = "x [m]", "y [m]"
    _dress(fig)
    middle = ((low + high) / 2).tolist()
    fit = CustomJS(args={"fig": fig, "spans": spans.tolist(), "middle": middle}, code=_FIT)
    fig.js_on_change("inner_width", fit)
    fig.js_on_change("inner_height", fit)
    if fig.toolbar.tools:
        fig.toolbar.active_scroll = fig.select_one(WheelZoomTool)

    def empty(what: str, *columns: str) -> ColumnDataSource:
        return ColumnDataSource({column: [] for column in columns}, name=f"{what}-{index}")

    for each in run.scene.pick(run.rows).at(0, ["reference"]):
        if isinstance(each, Curve):
            fig.line(*each.points.T, line_color="#999999", line_dash="4 3", line_width=1)
    solid = COLOURS["obstacle"]
    fig.patches("xs", "ys", source=empty("halos", "xs", "ys"), fill_color=solid, fill_alpha=0.05,
                line_color=solid, line_alpha=0.45, line_dash="1 4")  # fmt: skip
    fig.patches("xs", "ys", source=empty("solids", "xs", "ys"), fill_color=solid, fill_alpha=0.22,
                line_color=solid, line_width=1.5)  # fmt: skip
    thick = bool(run.scene.radii.max() > 0.0)
    if run.scene.plan:
        dashed: dict[str, Any] = {"line_color": COLOURS["plan"], "line_dash": "5 3", "line_width": 1.2}
        if thick:
            dashed |= {"fill_color": COLOURS["plan"], "fill_alpha": 0.1}
        glyphs = fig.patches if thick else fig.multi_line  # dashes there and back would fill the gaps
        glyphs("xs", "ys", source=empty("plan", "xs", "ys"), **dashed)
    fig.patches("xs", "ys", source=empty("bodies", "xs", "ys", "colour"), fill_color="colour",
                fill_alpha=0.25, line_color="colour", line_width=1.2)  # fmt: skip
    fig.scatter(*run.scene.joints[0, :1].T, marker="square", size=13, color=COLOURS["base"])
    fig.multi_line("xs", "ys", source=empty("links", "xs", "ys", "colour"), line_color="colour",
                   line_width=1.2 if thick else 4, line_cap="round")  # fmt: skip
    fig.line("x", "y", source=empty("trail", "x", "y"), line_color=style.INK, line_width=2)
    fig.scatter("x", "y", source=empty("joints", "x", "y"), size=8, fill_color="white", line_color=style.INK,
                line_width=1.4)  # fmt: skip
    fig.multi_line("xs", "ys", source=empty("arrows", "xs", "ys", "colour"), line_color="colour",
                   line_width=2.2, line_cap="round")  # fmt: skip
    fig.patches("xs", "ys", source=empty("heads", "xs", "ys", "colour"), fill_color="colour",
                line_color="colour")  # fmt: skip
    fig.scatter("x", "y", source=empty("target", "x", "y"), marker="x", size=11,
                line_color=COLOURS["target"], line_width=1.8)  # fmt: skip
    return fig


def plots(runs: list[Run], names: list[str]) -> list[figure]:
    """The plots over a common time: of one run a line per link or joint, of several a line per run."""
    alone = len(runs) == 1
    end = max(float(run.t[-1]) for run in runs)
    time = Range1d(min(float(run.t[0]) for run in runs), max(end, SHORTEST))
    obstacles = any(run.scene.cores for run in runs)
    colours = run_colours(len(runs))

    def lines(pick: Any, reduce: Any, noun: str) -> list[tuple[str, str, Array, Array]]:
        """Name, colour, times and values of the lines of a panel."""
        if alone:
            (run,) = runs
            values = pick(run.result)[run.rows]
            return [
                (f"{noun} {number}", shade, run.t, values[:, int(number)]) for number, shade in link_key(run)
            ]
        return [
            (name, colour, run.t, reduce(pick(run.result)[run.rows]))
            for name, colour, run in zip(names, colours, runs, strict=True)
        ]

    made = [_error(runs, ["error"] if alone else names, [style.INK] if alone else colours, time)]
    if obstacles:
        made.append(_clearance(lines(lambda run: run.clearance, lambda v: v.min(axis=1), "link"), runs, time))
        label = "repulsion on links [N]" if alone else "largest repulsion [N]"
        force = lines(lambda run: run.force, lambda v: v.max(axis=1), "link")
        made.append(_panel(label, force, time, "N"))
    label = "joint torque [N·m]" if alone else "largest |torque| [N·m]"
    torque = lines(lambda run: run.tau, lambda v: np.abs(v).max(axis=1), "joint")
    made.append(_panel(label, torque, time, "N·m"))
    made[-1].xaxis.axis_label = "time [s]"
    made[-1].height += 22
    if alone:
        made.append(_chooser(time, [colour for _, colour in link_key(runs[0])]))
        made[-1].xaxis.axis_label = "time [s]"
        made[-1].height += 22
    for run, colour in zip(runs, [COLOURS["plan"]] if alone else colours, strict=True):
        for fig in made:
            _mark_replans(fig, run, colour)
    return made


def _mark_replans(fig: figure, run: Run, colour: str) -> None:
    """Where a plan was taken over, and the time of its search; a search without a plan is dotted."""
    for search in run.result.replans:
        taken = search.taken
        if taken is not None:
            fig.add_layout(BoxAnnotation(left=search.asked, right=taken, fill_color=colour, fill_alpha=0.12,
                                         line_color=None, level="underlay"))  # fmt: skip
        fig.add_layout(Span(location=search.asked if taken is None else taken, dimension="height",
                            line_color=colour, line_dash="2 3" if taken is None else "solid",
                            line_width=1.5, level="underlay"))  # fmt: skip


def _frame(label: str, time: Range1d, **how: Any) -> figure:
    fig = figure(
        sizing_mode="stretch_width",
        height=188,
        min_width=200,
        x_range=time,
        y_axis_label=label,
        tools="xpan,xwheel_zoom,reset",
        toolbar_location=None,
        min_border_left=70,
        **how,
    )
    _dress(fig)
    fig.toolbar.active_scroll = None
    now = Span(location=0.0, dimension="height", line_color="#111111", line_width=1.2, name="now")
    fig.add_layout(now)
    fig.js_on_event("tap", CustomJS(code=_SEEK))
    return fig


def _panel(
    label: str,
    lines: list[tuple[str, str, Array, Array]],
    time: Range1d,
    unit: str,
    form: str = "%.4f",
    **how: Any,
) -> figure:
    fig = _frame(label, time, **how)
    for name, colour, t, values in lines:
        drawable = np.where(np.isfinite(values), values, np.nan).astype(np.float32)
        source = ColumnDataSource({"t": t.astype(np.float32), "value": drawable})
        line = fig.line("t", "value", source=source, line_color=colour, line_width=1.7, name=name)
        if len(t) < 3:  # no curve
            fig.scatter("t", "value", source=source, color=colour, size=7)
        tip = [("", f"$name: @value{{{form}}} {unit} at @t{{0.00}} s")]
        how_shown = {"@value": "printf"}
        fig.add_tools(
            HoverTool(renderers=[line], tooltips=tip, formatters=how_shown, mode="mouse", visible=False)
        )
    return fig


def _error(runs: list[Run], names: list[str], colours: list[str], time: Range1d) -> figure:
    """The error's magnitude on a logarithmic scale, which ends where rounding begins."""
    low, high = tracking.decades(np.concatenate([run.error for run in runs]))
    lines = [
        (name, colour, run.t, np.maximum(run.error, style.ROUNDING))
        for name, colour, run in zip(names, colours, runs, strict=True)
    ]
    fig = _panel(
        "tracking error [m]", lines, time, "m", "%.2e", y_axis_type="log", y_range=Range1d(low, high)
    )
    if low <= style.ROUNDING:
        fig.add_layout(
            Label(
                x=6,
                y=2,
                x_units="screen",
                y_units="screen",
                text="below: rounding",
                text_font_size="11px",
                text_color="#777777",
            )
        )
    powers = np.arange(round(np.log10(low)), round(np.log10(high)) + 1)
    fig.yaxis.ticker = FixedTicker(ticks=(10.0 ** powers[:: 1 + len(powers) // 8]).tolist())
    fig.yaxis.formatter = CustomJSTickFormatter(
        code="""
        const power = Math.round(Math.log10(tick))
        if (Math.abs(Math.log10(tick) - power) > 1e-6) return ''
        return '10' + [...String(power)].map(c => c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[c]).join('')
        """
    )
    return fig


def _clearance(lines: list[tuple[str, str, Array, Array]], runs: list[Run], time: Range1d) -> figure:
    """Distances, with contact and the reach of the field; what is far beyond that is cut off."""
    values = np.concatenate([values for *_, values in lines])
    values = values[np.isfinite(values)]
    reaches = {run.scene.influence for run in runs if run.scene.influence > 0.0}
    low = min(0.0, float(values.min(initial=0.0)))
    high = float(values.max(initial=0.1))
    if reaches:
        high = min(high, 3.0 * max(reaches))
    pad = 0.06 * (high - low)
    fig = _panel("clearance [m]", lines, time, "m", y_range=Range1d(low - pad, high + pad))
    fig.add_layout(BoxAnnotation(top=0.0, fill_color=style.ALARM, fill_alpha=0.09, line_color=None))
    fig.add_layout(Span(location=0.0, dimension="width", line_color=style.ALARM, line_width=1))
    for reach in sorted(reaches):
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
