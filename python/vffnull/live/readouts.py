"""The numbers above the controls and below them, as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

import numpy as np

from vffnull.live.plots import measures
from vffnull.live.scene.cup import SPILLS
from vffnull.model.headline import LOST, Finding, findings
from vffnull.model.record import THE_REST, Layout
from vffnull.model.scenario import Scenario

RATE = 1000.0
"""Periods per second of a loop that keeps up with the clock [Hz]."""
ALARM, WARN, CALM, PLAIN = "#c81428", "#8a5a00", "#0a7d55", "inherit"
STOPPED = ("diverged", "failed")
"""How a loop has ended that has stopped by itself."""


def numbers(state: Mapping[str, Any]) -> str:
    """The read-out as HTML."""
    clearance, error, _, angle = measures(state)
    least, is_over = state["min_clearance"], state["status"] in STOPPED
    presses = state.get("target_force") is not None  # into what it is to press on, as far as that gives
    rows = [
        (
            "Tip off its target",
            "tip",
            f"{error:.3f} mm" if error < 1 else f"{error:.1f} mm",
            error < 1 or (presses and error < 1e3 * LOST),
        )
    ]
    if np.isfinite(angle):
        value = f"{angle:.3f}°" if angle < 1 else f"{angle:.1f}°"
        rows.append(("Turned off by", "angle", value, angle < 0.5))
    if "tilt" in state:
        tilt, spilt, limit = np.degrees(state["tilt"]), state["spilt"], np.degrees(SPILLS)
        level = f"tilted {tilt:.1f}°" + (f", {100 * spilt:.0f} % spilt" if spilt > 0 else "")
        rows.append((f"Cup (spills at {limit:.0f}°)", "cup", level, spilt <= 0))
    if (parts := state["released"]) is not None:
        named = ", ".join(part or THE_REST for part in parts)
        rows.append(("Lets go", "let-go", named or "nothing", not parts))
    if np.isfinite(clearance):  # the last obstacle may have been taken away
        rows.append(("Clearance now", "clearance", _millimetres(clearance), clearance > 0))
    if np.isfinite(least):
        rows.append(("Smallest so far", "least", _millimetres(least), least > 0))
    shown = [(label, name, value, CALM if fine else ALARM) for label, name, value, fine in rows]
    if (wanted := state.get("target_force")) is not None and state["pressed"] is not None:
        value = f"{state['pressed']:.1f} N of {wanted:g} N"
        shown.append(("Presses with", "pressed", value, PLAIN))
    most = state["metrics"].get("max_error_lost") or 0.0
    if most > LOST:
        shown.insert(1, ("Farthest off so far", "farthest", _millimetres(most), PLAIN))
    pace = f"{state['rate'] / RATE:.2f} × real time" if state["status"] == "running" else state["status"]
    if back := state.get("back"):
        pace = f"{back:.1f} s ago"
    shown.append(("Simulated time", "time", f"{state['t']:.1f} s · {pace}", ALARM if is_over else PLAIN))
    if "newtons" in state:  # a scale is neither good nor bad
        shown.append(("Arrow at the base", "newtons", f"{state['newtons']:g} N of repulsion", PLAIN))
    cells = "".join(
        f'<tr><td>{label}</td><td id="vff-{name}" style="text-align:right;font-weight:600;'
        f'font-size:{"1.4em" if name == "tip" else "1em"};color:{colour}">{value}</td></tr>'
        for label, name, value, colour in shown
    )
    trouble = ""
    if is_over:
        trouble = (
            f'<div style="color:white;background:{ALARM};padding:6px 8px;border-radius:4px;margin:4px 0">'
            "The loop has stopped. <b>Reset</b> brings back the scenario and its own settings.</div>"
        )
    elif state.get("ended") is not None:
        trouble = (
            f'<div id="vff-end" style="margin:4px 0">The scene has reached its end at '
            f"t = {state['ended']:g} s. <b>Go on</b>, or a drag, leads beyond it.</div>"
        )
    lines = "".join(
        f'<div style="margin-top:4px;color:{ALARM if each.severity == "bad" else WARN}">'
        f"<b>{escape(each.verdict)}</b>: {escape(each.text)}</div>"
        for each in state.get("found", ())
    )
    return (
        f'<div style="padding:0 0.75em;font-size:0.85em;font-variant-numeric:tabular-nums">{trouble}'
        f'<table style="width:100%;border-collapse:collapse">{cells}</table>'
        f'<div id="vff-found">{lines}</div></div>'
    )


def _millimetres(metres: float) -> str:
    """In whole ones, but where only parts of one say on which side of 0 it is."""
    return f"{1e3 * metres:.1f} mm" if abs(metres) < 1e-3 else f"{1e3 * metres:.0f} mm"


def told_of(state: Mapping[str, Any], present: Mapping[str, Any], scenario: Scenario) -> dict[str, Any]:
    """What is to be read of a state, maybe one of the past; how the loop is, is said of the present."""
    loop = {name: present[name] for name in ("status", "message", "rate", "periods", "missed", "worst")}
    force = scenario.to_dict().get("controller", {}).get("touch", {}).get("force")
    target = None if force is None else float(force["target"])
    return {**state, **loop, "found": found(state, scenario), "target_force": target}


def found(state: Mapping[str, Any], scenario: Scenario) -> list[Finding]:
    """What has happened since the start or the last reset, the worst first; where the tip is now is shown
    beside it.
    """
    facts = {name: value for name, value in state["metrics"].items() if not name.startswith("end_")}
    happened = list(findings(facts, scenario.arm, Layout.of(scenario.to_dict()).slides))
    if state["status"] in STOPPED:
        happened.insert(0, Finding(state["status"], "bad", state["message"]))
    return happened


def details(state: Mapping[str, Any], notes: Iterable[str] = ()) -> str:
    """How the loop is, as HTML."""
    loop = (
        f'<span id="vff-status">{state["status"]}</span> · t = {state["t"]:.1f} s<br>'
        f'loop <span id="vff-rate">{state["rate"]:.1f}</span> Hz · '
        f"longest step {1e6 * state['worst']:.0f} µs<br>"
        f"{state['missed']} of {state['periods']} deadlines missed"
    )
    if state["q_plan"] is not None or state["times_stuck"]:
        loop += (
            f'<br>new plans: <span id="vff-replans">{state["replans"]}</span> · '
            f'stuck: <span id="vff-stuck">{state["times_stuck"]}</span>'
        )
    return (
        '<div style="padding:0 0.75em;font-size:0.8em;color:#555;font-variant-numeric:tabular-nums">'
        f"{loop}{''.join(f'<br>{escape(note)}' for note in notes)}</div>"
    )
