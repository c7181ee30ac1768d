"""What a notebook shows of an arm, a scenario and a result: a small picture and a small table.

The pictures are SVG, drawn with nothing but text, so that a cell appears at once; colours are those of the
figures, and all else takes the page's own colour, dark themes included.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import singledispatch
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray

import vffnull._core as _core
from vffnull._core import Arm
from vffnull.draw import geometry
from vffnull.draw.primitives import COLOURS, Body, Cloud, Marks, Primitive
from vffnull.draw.scene import Scene, drawable
from vffnull.model.outcome import Outcome
from vffnull.model.record import Layout
from vffnull.model.scenario import Scenario

Array = NDArray[np.float64]

_WIDTH, _HIGHEST = 320.0, 300.0  # pixels
_INK = "currentColor"
_INSTANTS = 5
_SPECKS = 300
"""Points of a cloud that are drawn, at most."""
_FILL = {"clear": ".18", "solid": ".55"}
_MAIN = (
    "min_clearance",
    "collision_time",
    "max_error_transient",
    "max_error_tail",
    "settling_time",
    "max_repulsion",
    "peak_torque",
    "peak_speed",
)


@singledispatch
def card(shown: object) -> str:
    """The HTML of an arm, a scenario or a result."""
    raise NotImplementedError(type(shown))


@card.register
def arm(shown: Arm) -> str:
    """An arm, a little bent so that its joints can be told apart, and its parameters."""
    if shown.dimension == 3:
        return _arm_in_space(shown)
    q = np.full(shown.n, -0.9 / shown.n)
    q[0] = 0.7
    rows = [
        ("joints", str(shown.n)),
        ("reach", f"{np.sum(shown.lengths):.4g} m"),
        ("lengths", f"{_range(shown.lengths)} m"),
        ("masses", f"{_range(shown.masses)} kg"),
        ("radius", f"{_range(shown.radius)} m"),
        ("gravity", f"({', '.join(f'{g + 0.0:.4g}' for g in shown.gravity)}) m/s²"),
    ]
    return _card(_picture(Scene.of_arm(shown, q)), "Arm", "", rows)


def _arm_in_space(shown: Arm) -> str:
    """An arm in the middle of its ranges, those that are there straight a little bent, and its parameters."""
    ends = np.full((shown.n, 2), [-np.pi, np.pi]) if shown.joint_limits is None else shown.joint_limits
    lower, upper = np.clip(ends, -np.pi, np.pi).T
    q = (lower + upper) / 2
    q[np.abs(q) < 0.1] += np.minimum(0.4, (upper - lower) / 8)[np.abs(q) < 0.1]
    document = shown.to_dict()
    rows = [
        ("joints", str(shown.n)),
        ("base, tip", f"{document['base']}, {document['tip']}"),
        ("masses", f"{_range(shown.masses)} kg"),
        ("shapes", str(len(shown.collision))),
        ("gravity", f"({', '.join(f'{g + 0.0:.4g}' for g in shown.gravity)}) m/s²"),
    ]
    name = document.get("name", "Arm")
    return _card(_picture(Scene.of_arm(shown, q)), name, "", rows)


@card.register
def scenario(shown: Scenario) -> str:
    """The arm at the start among the obstacles, and what there is to know at a glance."""
    document = shown.to_dict()
    scene = Scene.of_scenario(shown)
    controller = document.get("controller", {})
    field = controller.get("field", {})
    rows = [
        ("duration", f"{shown.duration:g} s"),
        ("joints", str(shown.arm.n)),
        ("reference", str(document["reference"]["kind"])),
        ("obstacles", str(len(scene.cores)) if scene.cores else "none"),
        ("field", f"{field['kind']}, gain {field['gain']:g}" if field.get("gain") else "off"),
        ("projection", str(controller.get("projection", "dynamic"))),
    ]
    return _card(_picture(scene), shown.name or "Scenario", shown.description, rows)


@card.register
def result(shown: Outcome) -> str:
    """The arm passing the obstacles, from early (faint) to late, and the main metrics."""
    scene = Scene.of_result(drawable(shown))
    drawing = _picture(scene, scene.instants(_INSTANTS), scene.frame())
    about = str(shown.headline)
    main = {name: shown.metrics.get(name) for name in _MAIN}
    return _card(drawing, shown.scenario.name or "Result", about, _measures(main, shown.layout))


def _measures(values: Mapping[str, float | int | None], layout: Layout) -> list[tuple[str, str]]:
    """Names and values with units, of those that apply."""
    units = {name: layout.metric(name)[0] for name in values}
    return [
        (name, f"{value if isinstance(value, int) else format(value, '.4g')} {units[name]}".rstrip())
        for name, value in values.items()
        if value is not None
    ]


def _table(rows: Iterable[tuple[str, str]]) -> str:
    """Rows of plain text; the meaning of a metric appears where the pointer rests on its name."""
    cell = "padding:1px 14px 1px 0;text-align:left;border:0;background:none;color:inherit"
    body = "".join(
        '<tr style="background:none">'
        f'<td style="{cell};opacity:.7" title="{escape(_core.METRICS.get(name, ("", ""))[1])}">'
        f'{escape(name)}</td><td style="{cell}">{escape(value)}</td></tr>'
        for name, value in rows
    )
    return f'<table style="border:0;border-collapse:collapse;font-size:90%">{body}</table>'


def _card(drawing: str, title: str, text: str, rows: Iterable[tuple[str, str]]) -> str:
    return (
        '<div style="display:flex;gap:24px;align-items:flex-start;flex-wrap:wrap;color:inherit">'
        f'{drawing}<div style="max-width:420px"><b>{escape(title)}</b>'
        f'<div style="opacity:.7;margin-bottom:6px">{escape(text)}</div>{_table(rows)}</div></div>'
    )


def _picture(scene: Scene, rows: ArrayLike = (0,), frame: tuple[Array, Array] | None = None) -> str:
    """The scene at some instants, the earlier the fainter."""
    shown = np.asarray(rows, dtype=np.intp)
    strengths = 0.2 + 0.8 * (np.arange(1, len(shown) + 1) / len(shown)) ** 2
    marks = _paint(scene.at(0, ["base"]), 1.0)
    for row, strength in zip(shown, strengths, strict=True):
        if scene.dimension == 3:
            marks += _stacked(scene.at(int(row), ["obstacle", "base", "link"]), float(strength))
        else:
            marks += _paint(scene.at(int(row), ["obstacle", "link", "joint"]), float(strength))
    if frame is None:
        bodies = scene.at(0, ["obstacle", "base", "link"])
        around = np.vstack([each.outline() for each in bodies if isinstance(each, Body)])
        frame = around.min(axis=0), around.max(axis=0)
    return _svg(*frame, marks)


def _stacked(primitives: Iterable[Primitive], opacity: float) -> list[str]:
    """Bodies in space, those in front over those behind."""
    ahead = np.cross(*geometry.view_of(3))
    there = list(primitives)
    bodies = [each for each in there if isinstance(each, Body)]
    bodies.sort(key=lambda each: float(each.corners.mean(axis=0) @ ahead))
    specks = [
        _dot(place, COLOURS[each.role], 2.0, opacity)
        for each in there
        if isinstance(each, Cloud)
        for place in geometry.seen(each.points[:: 1 + len(each.points) // _SPECKS])
    ]
    return specks + [_polygon(each.outline(), each.colour, opacity, "solid") for each in bodies]


def _paint(primitives: Iterable[Primitive], opacity: float) -> list[str]:
    """Primitives as elements of SVG, in metres; widths are in pixels."""
    marks: list[str] = []
    for each in primitives:
        match each:
            case Body(role="link", radius=0.0, corners=corners) if len(corners) <= 2:
                continue  # the line through the joints shows it
            case Body(role=role):
                marks.append(_polygon(each.outline(), COLOURS[role], opacity))
            case Marks(role="base", points=points):
                marks += [_dot(place, _INK, 14.0, 0.8, "square") for place in geometry.seen(points)]
            case Marks(role="joint", points=points):
                places = geometry.seen(points)
                marks.append(_line(places, COLOURS["link"], opacity))
                for place in places:
                    marks += [_dot(place, COLOURS["joint"], 7.5, opacity), _dot(place, "#fff", 4.0, opacity)]
    return marks


def _svg(low: Array, high: Array, marks: list[str]) -> str:
    """A picture of everything between two corners, y up, with a scale of one round length."""
    span = np.maximum(high - low, 1e-9)
    low, high = low - 0.05 * span.max(), high + 0.05 * span.max()
    span = high - low
    scale = min(_WIDTH / span[0], _HIGHEST / span[1])  # pixels per metre
    wide, tall = span * scale
    bar = _round(0.3 * span[0])
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.0f}" height="{tall + 20:.0f}" '
        f'viewBox="0 0 {wide:.1f} {tall + 20:.1f}" role="img" style="max-width:100%">'
        f'<svg width="{wide:.1f}" height="{tall:.1f}" viewBox="0 0 {wide:.1f} {tall:.1f}">'
        f'<g transform="matrix({scale:.5g} 0 0 {-scale:.5g} {-low[0] * scale:.5g} {high[1] * scale:.5g})">'
        f"{''.join(marks)}</g></svg>"
        f'<path d="M1 {tall + 6:.1f}v4h{bar * scale:.1f}v-4" fill="none" stroke="{_INK}" opacity=".6"/>'
        f'<text x="{bar * scale + 7:.1f}" y="{tall + 14:.1f}" font-size="11" fill="{_INK}" opacity=".7" '
        f'font-family="sans-serif">{bar:g} m</text></svg>'
    )


def _line(points: Array, colour: str, opacity: float) -> str:
    return (
        f'<polyline points="{_points(points)}" fill="none" stroke="{colour}" stroke-width="3" '
        f'opacity="{opacity:.2f}" stroke-linecap="round" stroke-linejoin="round" '
        'vector-effect="non-scaling-stroke"/>'
    )


def _dot(place: Array, colour: str, size: float, opacity: float, end: str = "round") -> str:
    """A line of no length with such an end is a dot of a size in pixels."""
    x, y = place
    return (
        f'<path d="M{x:.5g} {y:.5g}h0" stroke="{colour}" stroke-width="{size}" stroke-linecap="{end}" '
        f'opacity="{opacity:.2f}" vector-effect="non-scaling-stroke"/>'
    )


def _polygon(points: Array, colour: str, opacity: float, look: str = "clear") -> str:
    under = f'<polygon points="{_points(points)}" fill="#fff" opacity="{opacity:.2f}"/>'
    return (under if look == "solid" else "") + (
        f'<polygon points="{_points(points)}" fill="{colour}" fill-opacity="{_FILL[look]}" stroke="{colour}" '
        f'stroke-width="1.3" opacity="{opacity:.2f}" vector-effect="non-scaling-stroke"/>'
    )


def _points(points: Array) -> str:
    return " ".join(f"{x:.5g},{y:.5g}" for x, y in points)


def _range(values: ArrayLike) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _round(length: float) -> float:
    """The greatest of 1, 2, 5 · 10ᵏ that is not greater."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)))
