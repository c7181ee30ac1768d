"""The controls beside the drawing, and the numbers above them."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from html import escape
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import viser

from vffnull.errors import VffNullError
from vffnull.scenario import Scenario
from vffnull.viewer.plots import measures
from vffnull.viewer.presets import presets
from vffnull.viewer.stories import STORIES

LEAD = """
The field pushes the links away from the obstacle; the null-space projection keeps that push off the tip.
**Switch the projection off and watch the tip.**
"""
WAYS = {
    "the links only": "null_space",
    "relaxed": "relaxed",
    "by priority": "priority",
    "by barriers (QP)": "cbf",
}
"""How the page calls what `controller.avoidance` may be."""
ALARM, CALM = "#c81428", "#0a7d55"
HINT = "Drag the dark obstacles and the green target; the wheel zooms, the right button moves the view."
TILT = "Drag the dark obstacles and the green target; dragging the floor tilts the view."


class Page(Protocol):
    """What the controls may ask of the page."""

    @property
    def flat(self) -> bool:
        """Whether the view stays as it is whatever is dragged."""

    def open(self, scenario: Scenario) -> None:
        """Run another scenario."""

    def configure(self, controller: Mapping[str, Any]) -> None:
        """Take over settings of the controller."""

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""

    def reset(self) -> None:
        """Go back to the start."""

    def show_ghost(self, on: bool) -> None:
        """Run the arm without projection beside."""

    def add_obstacle(self) -> None:
        """Put a disc where there is room."""

    def remove_obstacle(self) -> None:
        """Take away the last obstacle."""

    def start_recording(self) -> Path:
        """Begin to record."""

    def stop_recording(self) -> tuple[Path, int] | None:
        """End a recording; its file and the number of its rows."""

    def flatten(self, flat: bool) -> None:
        """See the plane from above, or let the view be tilted."""


class Panel:
    """Switches, sliders and read-outs.

    Parameters
    ----------
    server : viser.ViserServer
        The page.
    page : Page
        What the controls act on.
    """

    def __init__(self, server: viser.ViserServer, page: Page) -> None:
        self._server, self._page = server, page
        self._settings: dict[str, Any] = {}
        gui = server.gui
        gui.add_markdown(LEAD)
        self._projection = gui.add_button("Null-space projection: on")
        self._projected = True
        self._field = gui.add_checkbox("Repulsive field", True)
        self._ghost = gui.add_checkbox("Pale arm: without projection", True)
        self._numbers = gui.add_html("")
        self._stories = gui.add_button_group("Stories", tuple(STORIES))
        self._look = gui.add_markdown("", visible=False)
        with gui.add_folder("Scene"):
            self._preset = gui.add_dropdown("Preset", presets())
            self._pause = gui.add_button("Pause", icon=viser.Icon.PLAYER_PAUSE, color="gray")
            self._reset = gui.add_button("Reset", icon=viser.Icon.REFRESH, color="gray")
            self._view = gui.add_button("Tilt the view", icon=viser.Icon.CUBE, color="gray")
            self._obstacles = gui.add_button_group("Obstacle", ("add", "remove"))
            self._record = gui.add_button("Record", icon=viser.Icon.PLAYER_RECORD, color="gray")
            self._how = gui.add_markdown(HINT)
        with gui.add_folder("Controller"):
            self._avoidance = gui.add_dropdown(
                "Gives way", tuple(WAYS), hint="What happens when an obstacle wants the tip's own place"
            )
            self._gain = gui.add_slider("Field gain", 0.01, 6.0, 0.01, 1.0)
            self._influence = gui.add_slider("Influence [m]", 0.05, 2.0, 0.01, 0.5)
            self._kind = gui.add_dropdown("Field", ("khatib", "cubic", "bounded"))
            self._stiffness = gui.add_slider("Stiffness [1/s²]", 0.0, 400.0, 1.0, 16.0)
            self._damping = gui.add_slider("Damping [1/s]", 0.0, 60.0, 0.5, 8.0)
            self._null_damping = gui.add_slider("Null damping", 0.0, 30.0, 0.5, 2.0, hint="[1/s]")
        with gui.add_folder("Details", expand_by_default=False):
            self._details = gui.add_html("")
        self._connect()

    def show(self, scenario: Scenario) -> None:
        """Set every control to what a scenario says."""
        settings = copy.deepcopy(scenario.to_dict().get("controller", {}))
        settings.setdefault("field", {"kind": "khatib", "gain": 0.0, "influence": 0.5})
        self._show_settings(settings)
        if scenario.name in self._preset.options:
            put(self._preset, scenario.name)
        self._look.visible = False
        self._show_paused(False)
        self._apply(settings)

    def _show_settings(self, settings: dict[str, Any]) -> None:
        """Set the controls to these settings of the controller."""
        field = settings.setdefault("field", {"kind": "khatib", "gain": 0.0, "influence": 0.5})
        self._show_projection(settings.get("projection", "dynamic") != "none")
        way = settings.get("avoidance", "null_space")
        put(self._avoidance, next(label for label, name in WAYS.items() if name == way))
        put(self._field, field["gain"] > 0.0)
        put(self._kind, field["kind"])
        slide(self._gain, field["gain"] or 1.0)
        slide(self._influence, field["influence"])
        slide(self._stiffness, first(settings.get("stiffness", 16.0)))
        slide(self._damping, first(settings.get("damping", 8.0)))
        slide(self._null_damping, first(settings.get("null_damping", 2.0)))

    def read(self, state: Mapping[str, Any]) -> None:
        """Show the numbers of a state."""
        self._numbers.content = numbers(state)
        self._details.content = details(state)

    def show_recording(self, on: bool) -> None:
        """Let the button say what it does next."""
        self._record.label = "Stop recording" if on else "Record"
        self._record.icon = viser.Icon.PLAYER_STOP if on else viser.Icon.PLAYER_RECORD
        self._record.color = "red" if on else "gray"

    # ---------------------------------------------------------------------------------------------- inside

    def _connect(self) -> None:
        """Callbacks are `async`, because others may overtake each other."""
        page = self._page
        switches = (self._field, self._kind, self._avoidance)
        sliders = (self._gain, self._influence, self._stiffness, self._damping, self._null_damping)

        async def changed(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # somebody has turned it, not `show`
                self._told(event.client, self._changed, event.target)

        for control in (*switches, *sliders):
            control.on_update(changed)

        @self._projection.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            wanted = {**self._settings, "projection": "none" if self._projected else "dynamic"}
            self._told(event.client, self._apply, wanted)
            self._show_projection(self._settings.get("projection", "dynamic") != "none")

        @self._ghost.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, page.show_ghost, self._ghost.value)

        @self._stories.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._told(event.client, self._tell, self._stories.value)

        @self._preset.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # somebody has chosen it
                self._told(event.client, lambda: page.open(Scenario.load(self._preset.value)))

        @self._pause.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            pausing = self._pause.label == "Pause"
            page.pause(pausing)
            self._show_paused(pausing)

        @self._reset.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._show_paused(False)
            self._told(event.client, page.reset)

        @self._view.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            page.flatten(not page.flat)
            self._view.label = "Tilt the view" if page.flat else "2-D view"
            self._view.icon = viser.Icon.CUBE if page.flat else viser.Icon.VIEWPORT_WIDE
            self._how.content = HINT if page.flat else TILT

        @self._obstacles.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            change = page.add_obstacle if self._obstacles.value == "add" else page.remove_obstacle
            self._told(event.client, change)

        @self._record.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._told(event.client, self._toggle_recording, event.client)

    def _changed(self, control: Any) -> None:
        """Write what a control says into the settings, those that others set left as they are.

        What cannot be used leaves no trace: the controls go back to what runs.
        """
        settings = copy.deepcopy(self._settings)
        field = settings["field"]
        if control is self._avoidance:
            settings["avoidance"] = WAYS[control.value]
        elif control is self._kind:
            field["kind"] = control.value
            if control.value == "bounded":
                field.pop("floor", None)
        elif control is self._influence:
            field["influence"] = control.value
            if field.get("floor", 0.0) >= control.value:
                field.pop("floor")
        for slider, key in (
            (self._stiffness, "stiffness"),
            (self._damping, "damping"),
            (self._null_damping, "null_damping"),
        ):
            if control is slider:
                settings[key] = slider.value
        if control in (self._gain, self._field):
            field["gain"] = self._gain.value if self._field.value else 0.0
        try:
            self._apply(settings)
        except VffNullError:
            self._show_settings(self._settings)
            raise

    def _apply(self, settings: dict[str, Any]) -> None:
        self._page.configure(settings)
        self._settings = settings

    def _tell(self, name: str) -> None:
        """Begin a story."""
        story = STORIES[name]
        self._page.open(story.open())
        self._look.content = f"**{name}.** {story.look}"
        self._look.visible = True

    def _toggle_recording(self, client: viser.ClientHandle | None) -> None:
        ended = self._page.stop_recording()
        if ended is None:
            path = self._page.start_recording()
            title, text = "Recording", f"A row every 10 ms goes to {path}"
        else:
            title, text = "Recorded", f"{ended[1]} rows in {ended[0]}; read them with vff.StreamRecorder.read"
        if client is not None:
            client.add_notification(title, text, auto_close_seconds=6.0)

    def _show_projection(self, on: bool) -> None:
        self._projected = on
        self._projection.label = f"Null-space projection: {'on' if on else 'OFF'}"
        self._projection.icon = viser.Icon.TOGGLE_RIGHT if on else viser.Icon.TOGGLE_LEFT
        self._projection.color = "green" if on else "red"

    def _show_paused(self, paused: bool) -> None:
        self._pause.label = "Go on" if paused else "Pause"
        self._pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE

    @staticmethod
    def _told(client: viser.ClientHandle | None, action: Callable[..., None], *arguments: Any) -> None:
        """Do something, and tell whoever asked for it if it cannot be done."""
        try:
            action(*arguments)
        except (VffNullError, ImportError, OSError) as fault:
            if client is None:
                raise
            client.add_notification("This cannot be done", str(fault), color="red", auto_close_seconds=8.0)


def put(control: Any, value: Any) -> None:
    """Set a control; viser's types take its values for read-only."""
    control.value = value


def slide(slider: Any, value: float) -> None:
    """Move a slider, and widen it if it has to."""
    if value > slider.max:
        slider.max = 2.0 * value
    put(slider, max(value, slider.min))


def first(value: Any) -> float:
    """A number, or the first of those that a setting gives per axis or joint."""
    return float(np.ravel(value)[0])


def numbers(state: Mapping[str, Any]) -> str:
    """The read-out as HTML."""
    clearance, error, _ = measures(state)
    least = state["min_clearance"]
    rows = [("Tip off its target", "tip", f"{error:.3f} mm" if error < 1 else f"{error:.1f} mm", error < 1)]
    if np.isfinite(least):
        rows.append(("Clearance now", "clearance", f"{1e3 * clearance:.0f} mm", clearance > 0))
        rows.append(("Smallest so far", "least", f"{1e3 * least:.0f} mm", least > 0))
    cells = "".join(
        f'<tr><td>{label}</td><td id="vff-{name}" style="text-align:right;font-weight:600;'
        f'font-size:{"1.4em" if name == "tip" else "1em"};color:{CALM if fine else ALARM}">{value}</td></tr>'
        for label, name, value, fine in rows
    )
    trouble = ""
    if state["status"] in ("diverged", "failed"):
        trouble = (
            f'<div style="color:white;background:{ALARM};padding:6px 8px;border-radius:4px;margin:4px 0">'
            f"The loop has stopped: {escape(state['message'])}. <b>Reset</b> brings back "
            "the scenario and its own settings.</div>"
        )
    return (
        f'<div style="padding:0 0.75em;font-size:0.85em;font-variant-numeric:tabular-nums">{trouble}'
        f'<table style="width:100%;border-collapse:collapse">{cells}</table></div>'
    )


def details(state: Mapping[str, Any]) -> str:
    """How the loop is, as HTML."""
    loop = (
        f'<span id="vff-status">{state["status"]}</span> · t = {state["t"]:.1f} s<br>'
        f'loop <span id="vff-rate">{state["rate"]:.1f}</span> Hz · '
        f"longest step {1e6 * state['worst']:.0f} µs<br>"
        f"{state['missed']} of {state['periods']} deadlines missed"
    )
    return (
        '<div style="padding:0 0.75em;font-size:0.8em;color:#555;font-variant-numeric:tabular-nums">'
        f"{loop}</div>"
    )
