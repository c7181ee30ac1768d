"""What a notebook shows of an arm, a scenario and a result: a small picture and a small table.

The pictures are SVG, drawn with nothing but text, so that a cell appears at once; colours are those of the
figures, and all else takes the page's own colour, dark themes included.
"""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vffnull import _core
from vffnull.plotting import geometry

if TYPE_CHECKING:
    from vffnull._core import Arm
    from vffnull.result import Result
    from vffnull.scenario import Scenario

Array = NDArray[np.float64]

_WIDTH, _HIGHEST = 320.0, 300.0  # pixels
_ARM, _OBSTACLE, _INK = "#0072B2", "#D55E00", "currentColor"
_INSTANTS = 5
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


def arm(shown: Arm) -> str:
    """An arm, a little bent so that its joints can be told apart, and its parameters."""
    q = np.full(shown.n, -0.9 / shown.n)
    q[0] = 0.7
    joints = np.asarray(shown.forward_kinematics(q))
    radii = np.asarray(shown.radius)
    low, high = joints.min(axis=0) - radii.max(), joints.max(axis=0) + radii.max()
    rows = [
        ("joints", str(shown.n)),
        ("reach", f"{shown.lengths.sum():.4g} m"),
        ("lengths", f"{_range(shown.lengths)} m"),
        ("masses", f"{_range(shown.masses)} kg"),
        ("radius", f"{_range(shown.radius)} m"),
        ("gravity", f"({shown.gravity[0] + 0.0:.4g}, {shown.gravity[1] + 0.0:.4g}) m/s²"),
    ]
    return _card(_svg(low, high, [_base(), *_arm(joints, radii, _ARM, 1.0)]), "Arm", "", rows)


def scenario(shown: Scenario) -> str:
    """The arm at the start among the obstacles, and what there is to know at a glance."""
    document = shown.to_dict()
    model = shown.arm
    joints = np.asarray(model.forward_kinematics(document["q0"]))
    radii = np.asarray(model.radius)
    shapes, around = [], [joints - radii.max(), joints + radii.max()]
    for each in document.get("obstacles", []):
        outline = geometry.rounded(*geometry.core(each["shape"], each.get("angle", 0.0)))
        outline = outline + np.asarray(each.get("position", (0.0, 0.0)))
        shapes.append(_polygon(outline, _OBSTACLE, 1.0))
        around.append(outline)
    points = np.vstack(around)
    controller = document.get("controller", {})
    field = controller.get("field", {})
    rows = [
        ("duration", f"{shown.duration:g} s"),
        ("joints", str(model.n)),
        ("reference", escape(str(document["reference"]["kind"]))),
        ("obstacles", str(len(shapes)) if shapes else "none"),
        ("field", escape(f"{field['kind']}, gain {field['gain']:g}") if field.get("gain") else "off"),
        ("projection", escape(str(controller.get("projection", "dynamic")))),
    ]
    drawing = _svg(
        points.min(axis=0), points.max(axis=0), [*shapes, _base(), *_arm(joints, radii, _ARM, 1.0)]
    )
    return _card(drawing, shown.name or "Scenario", shown.description, rows)


def result(shown: Result) -> str:
    """The arm passing the obstacles, from early (faint) to late, and the main metrics."""
    sound = geometry.drawable(shown)
    left, right, bottom, top = geometry.frame(sound)
    joints, radii = geometry.joints(sound), geometry.link_radii(sound)
    outlines = geometry.obstacle_outlines(sound)
    rows = geometry.instants(sound, _INSTANTS)
    marks: list[str] = []
    for order, row in enumerate(rows, start=1):
        faint = 0.2 + 0.8 * (order / len(rows)) ** 2
        places = sound.obstacles[row]
        marks += [
            _polygon(points + at, _OBSTACLE, faint) for points, at in zip(outlines, places, strict=True)
        ]
        marks += _arm(joints[row], radii, _ARM, faint)
    metrics = [(name, shown.metrics.get(name)) for name in _MAIN]
    table = [
        (
            f'<span title="{escape(_core.METRICS[name][1])}">{name}</span>',
            f"{value:.4g} {_core.METRICS[name][0]}",
        )
        for name, value in metrics
        if value is not None
    ]
    drawing = _svg(np.array([left, bottom]), np.array([right, top]), [_base(), *marks])
    about = f"{shown.status}: {shown.message}"
    return _card(drawing, shown.scenario.name or "Result", about, table)


def _card(drawing: str, title: str, text: str, rows: Iterable[tuple[str, str]]) -> str:
    cell = "padding:1px 14px 1px 0;text-align:left;border:0;background:none;color:inherit"
    table = "".join(
        f'<tr style="background:none"><td style="{cell};opacity:.7">{name}</td>'
        f'<td style="{cell}">{value}</td></tr>'
        for name, value in rows
    )
    return (
        '<div style="display:flex;gap:24px;align-items:flex-start;flex-wrap:wrap;color:inherit">'
        f'{drawing}<div style="max-width:420px"><b>{escape(title)}</b>'
        f'<div style="opacity:.7;margin-bottom:6px">{escape(text)}</div>'
        f'<table style="border:0;border-collapse:collapse;font-size:90%">{table}</table></div></div>'
    )


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


def _arm(joints: Array, radii: Array, colour: str, opacity: float) -> list[str]:
    """Links as lines, thick ones with their bodies, and joints as dots."""
    marks = [
        _polygon(geometry.capsule(a, b, radius), colour, opacity)
        for a, b, radius in zip(joints[:-1], joints[1:], radii, strict=True)
        if radius > 0.0
    ]
    line = (
        f'<polyline points="{_points(joints)}" fill="none" stroke="{colour}" stroke-width="3" '
        f'opacity="{opacity:.2f}" stroke-linecap="round" stroke-linejoin="round" '
        'vector-effect="non-scaling-stroke"/>'
    )
    dots = [  # a line of no length with a round end is a dot of a size in pixels
        f'<path d="M{x:.5g} {y:.5g}h0" stroke="{shade}" stroke-width="{size}" stroke-linecap="round" '
        f'opacity="{opacity:.2f}" vector-effect="non-scaling-stroke"/>'
        for x, y in joints
        for shade, size in ((colour, 7.5), ("#fff", 4.0))
    ]
    return [*marks, line, *dots]


def _base() -> str:
    return (
        f'<path d="M0 0h0" stroke="{_INK}" stroke-width="14" stroke-linecap="square" '
        'vector-effect="non-scaling-stroke" opacity=".8"/>'
    )


def _polygon(points: Array, colour: str, opacity: float) -> str:
    return (
        f'<polygon points="{_points(points)}" fill="{colour}" fill-opacity=".18" stroke="{colour}" '
        f'stroke-width="1.3" opacity="{opacity:.2f}" vector-effect="non-scaling-stroke"/>'
    )


def _points(points: Array) -> str:
    return " ".join(f"{x:.5g},{y:.5g}" for x, y in points)


def _range(values: Array) -> str:
    low, high = float(np.min(values)), float(np.max(values))
    return f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"


def _round(length: float) -> float:
    """The greatest of 1, 2, 5 · 10ᵏ that is not greater."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(max(step * power for step in (1, 2, 5) if step * power <= length * (1 + 1e-9)))
