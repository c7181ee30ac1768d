"""The controls beside the drawing, and the numbers above them."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import viser

from vffnull._support.errors import InputError, VffNullError
from vffnull.live.actions import Page
from vffnull.live.files import file_name, scenario_of
from vffnull.live.joints import Joints
from vffnull.live.memory import KEPT
from vffnull.live.plots import rounded_up
from vffnull.live.readouts import STOPPED, details, numbers
from vffnull.live.sliders import NO_FIELD, OF_THE_CONTROLLER, OF_THE_FIELD, levels, put, said, slide
from vffnull.live.stories import GIVING_WAY, IN_SPACE, IN_THE_PLANE, STORIES
from vffnull.live.tasks import TASKS, with_task
from vffnull.model.arm import listed
from vffnull.model.scenario import Scenario, scenarios

OWN = "your own"  # a scenario that is not bundled
LEAD = """
The field pushes the links away from the obstacle; the null-space projection keeps that push off the tip.
**Switch the projection off and watch the tip.**
"""
NO_PUSH = "Nothing pushes the arm away from the obstacle. **Switch the repulsive field on.**"
KEPT_AWAY = {
    "priority": "Links and tip give way where an obstacle comes near. **Drag the obstacle into the arm.**",
    "cbf": "Barriers keep obstacles away from links and tip, which give way where they have to. "
    "**Drag the obstacle into the arm.**",
}
"""What stands above a law whose field is off, by what `controller.avoidance` is."""
WAYS = {
    "the links only": "null_space",
    "relaxed": "relaxed",
    "by priority": "priority",
    "by barriers (QP)": "cbf",
}
"""How the page calls what `controller.avoidance` may be."""
GO_ON = "Go on"
TYPING = 3.0
"""How long a number that a slider does not have may stand in its box [s]."""
BEYOND = 2.5
"""How far a slider goes, in values of the scenario."""
T = TypeVar("T")


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
        self._unfinished: tuple[Any, float] | None = None
        gui = server.gui
        self._sliders: dict[str, Any] = {}
        usual = levels({"field": NO_FIELD})

        def add(name: str, label: str, low: float, high: float, step: float, hint: str) -> None:
            self._sliders[name] = gui.add_slider(label, low, high, step, usual[name], hint=hint)

        self._lead = gui.add_markdown(LEAD)
        self._projection = gui.add_button(
            "Null-space projection: on", hint="Whether the push of the field is kept off the tip"
        )
        self._projected = True
        self._field = gui.add_checkbox("Repulsive field", True, hint="Whether obstacles push the links away")
        self._ghost = gui.add_checkbox(
            "Pale arm: without projection", True, hint="The same arm in the same scene, but not projected"
        )
        self._plan = gui.add_checkbox(
            "Pale green arm: the plan", True, visible=False, hint="Where the plan has the arm by now"
        )
        self._numbers = gui.add_html("")
        self._stories = [
            gui.add_button_group(label, tuple(stories), hint="A scene, and a sentence on what to look at")
            for label, stories in (
                ("Stories", IN_THE_PLANE),
                ("In space", IN_SPACE),
                ("Giving way", GIVING_WAY),
            )
        ]
        self._look = gui.add_markdown("", visible=False)
        with gui.add_folder("Scene"):
            self._preset = gui.add_dropdown(
                "Preset", (*scenarios(), OWN), hint="Opens one of the bundled scenarios"
            )
            self._pause = gui.add_button(
                "Pause", icon=viser.Icon.PLAYER_PAUSE, color="gray", hint="In a pause one can look back"
            )
            self._back = gui.add_slider(
                "Look back [s]", -KEPT, 0.0, 0.05, 0.0, visible=False, hint="What was drawn before the pause"
            )
            self._replay = gui.add_button(
                "Replay",
                icon=viser.Icon.PLAYER_TRACK_NEXT,
                color="gray",
                visible=False,
                hint="Shows it again from there",
            )
            self._reset = gui.add_button(
                "Reset",
                icon=viser.Icon.REFRESH,
                color="gray",
                hint="Back to the start, with the settings that the controls show",
            )
            self._reset_all = gui.add_button(
                "Reset with the file's settings",
                icon=viser.Icon.RESTORE,
                color="gray",
                hint="Back to the start, with obstacles and settings as the scenario has them",
            )
            self._go = gui.add_button(
                "Plan to the target",
                icon=viser.Icon.ROUTE,
                color="gray",
                hint="Finds a way around what stands there, for the hand that gets no farther by itself",
            )
            self._view = gui.add_button(
                "Tilt the view",
                icon=viser.Icon.CUBE,
                color="gray",
                hint="Seen from above, dragging never turns the view",
            )
            self._views = gui.add_button_group(
                "View", ("Corner",), visible=False, hint="From where the arm is seen"
            )
            self._task = gui.add_dropdown("Task", TASKS, visible=False, hint="Changing it begins anew")
            self._obstacles = gui.add_button_group(
                "Obstacle", ("add", "remove"), hint="One more, or the last one less"
            )
            self._record = gui.add_button(
                "Record",
                icon=viser.Icon.PLAYER_RECORD,
                color="gray",
                hint="Writes what happens to a file on the machine that runs the page",
            )
            self._open = gui.add_upload_button(
                "Open a TOML file",
                icon=viser.Icon.FOLDER_OPEN,
                color="gray",
                mime_type=".toml",
                hint="A scenario that names no other files",
            )
            self._save = gui.add_button(
                "Save as TOML",
                icon=viser.Icon.DOWNLOAD,
                color="gray",
                hint="This scene with the present settings, obstacles where they have been put",
            )
            self._how = gui.add_markdown("")
        with gui.add_folder("Controller"):
            self._avoidance = gui.add_dropdown(
                "Gives way", tuple(WAYS), hint="What happens when an obstacle wants the tip's own place"
            )
            self._ahead = gui.add_checkbox(
                "Look ahead", False, visible=False, hint="Leave early where a collision is ahead"
            )
            for name, slider in OF_THE_FIELD.items():
                add(name, *slider)
            self._kind = gui.add_dropdown(
                "Field", ("khatib", "cubic", "bounded"), hint="How the push grows as a link comes near"
            )
            for name, slider in OF_THE_CONTROLLER.items():
                add(name, *slider)
        self._usual = {name: slider.max for name, slider in self._sliders.items()}
        with gui.add_folder("Joints", expand_by_default=False):
            self._joints = Joints(gui, page.begin_at)
        with gui.add_folder("Details", expand_by_default=False):
            self._details = gui.add_html("")
            self._shadows = gui.add_checkbox("Shadows", False, hint="Without a graphics card they are slow")
            self._meshes = gui.add_checkbox(
                "The robot's own meshes", True, visible=False, hint="Otherwise the bodies that are measured"
            )
        self._connect()

    def show(self, scenario: Scenario) -> None:
        """Set every control to what a scenario says."""
        settings = copy.deepcopy(scenario.to_dict().get("controller", {}))
        settings.setdefault("field", dict(NO_FIELD))
        for name, value in levels(settings).items():
            self._sliders[name].max = max(self._usual[name], rounded_up(BEYOND * value))
        self._show_settings(settings)
        put(self._preset, scenario.name if scenario.name in self._preset.options else OWN)
        self._plan.visible = scenario.to_dict()["reference"]["kind"] == "plan"
        self._look.visible = False
        self._show_paused(False)
        self._show_views()
        put(self._task, said(settings, "task"))
        self._meshes.visible = self._page.has_meshes
        self._joints.show(scenario)
        self._task.visible = self._shadows.visible = scenario.arm.dimension == 3
        self._apply(settings)

    def _show_settings(self, settings: dict[str, Any]) -> None:
        """Set the controls to these settings of the controller."""
        field = settings.setdefault("field", dict(NO_FIELD))
        self._show_projection(said(settings, "projection") != "none")
        way = said(settings, "avoidance")
        put(self._avoidance, next(label for label, name in WAYS.items() if name == way))
        self._ahead.visible = way == "cbf"
        put(self._ahead, "preview" in settings.get("yielding", {}))
        put(self._field, field["gain"] > 0.0)
        put(self._kind, field["kind"])
        for name, value in levels(settings).items():
            slide(self._sliders[name], value)

    def read(self, state: Mapping[str, Any]) -> None:
        """Show the numbers of a state."""
        self._numbers.content = numbers(state)
        self._plan.visible = self._plan.visible or state["q_plan"] is not None
        self._details.content = details(state, self._page.notes)
        self._joints.read(state["q"])
        if self._unfinished is not None and time.monotonic() - self._unfinished[1] > TYPING:
            self._unfinished = None
            self._show_settings(self._settings)

    def show_run(self, status: str) -> None:
        """Let the buttons fit a loop that runs, pauses, or has stopped by itself and cannot go on."""
        self._pause.visible = status not in STOPPED
        paused = status != "running"
        if paused != (self._pause.label == GO_ON):
            self._show_paused(paused)

    def show_memory(self, span: float, back: float) -> None:
        """How far back one can look [s], and does."""
        if not self._back.visible:
            return
        begin = -max(round(span, 2), 0.05)
        if self._back.min != begin:
            self._back.min = begin
        place = max(begin, -back)
        is_over = place == 0.0 != self._back.value  # less than half a step from the present is not there
        if is_over or abs(self._back.value - place) > 0.5 * self._back.step:
            put(self._back, place)

    def show_recording(self, on: bool) -> None:
        """Let the button say what it does next."""
        self._record.label = "Stop recording" if on else "Record"
        self._record.icon = viser.Icon.PLAYER_STOP if on else viser.Icon.PLAYER_RECORD
        self._record.color = "red" if on else "gray"

    # ---------------------------------------------------------------------------------------------- inside

    def _connect(self) -> None:
        """Callbacks are `async`, because others may overtake each other."""
        page = self._page
        switches = (self._field, self._kind, self._avoidance, self._ahead)

        async def changed(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:  # somebody has turned it, not `show`
                self._told(event.client, self._changed, event.target)

        for control in (*switches, *self._sliders.values()):
            control.on_update(changed)

        @self._projection.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            wanted = {**self._settings, "projection": "none" if self._projected else "dynamic"}
            self._told(event.client, self._apply, wanted)
            self._show_projection(said(self._settings, "projection") != "none")

        @self._ghost.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, page.show_ghost, self._ghost.value)

        @self._plan.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, page.show_plan, self._plan.value)

        async def tell(event: viser.GuiEvent[Any]) -> None:
            self._told(event.client, self._tell, event.target.value)

        for group in self._stories:
            group.on_click(tell)

        @self._preset.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None and self._preset.value != OWN:  # somebody has chosen it
                self._told(event.client, self._open_preset)

        @self._pause.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            pausing = self._pause.label == "Pause"
            page.pause(pausing)
            self._show_paused(pausing)

        @self._back.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                page.look_back(-self._back.value)

        @self._replay.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            page.replay()

        @self._reset.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._show_paused(False)
            self._told(event.client, page.reset)

        @self._reset_all.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._show_paused(False)
            self._told(event.client, page.reset, True)

        @self._open.on_upload
        async def _(event: viser.GuiEvent[Any]) -> None:
            file = self._open.value
            self._told(event.client, lambda: page.open(scenario_of(file.name, file.content)))

        @self._save.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, self._send, event.client)

        @self._shadows.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, page.cast_shadows, self._shadows.value)

        @self._meshes.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, page.show_meshes, self._meshes.value)

        @self._go.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._told(event.client, page.plan)

        @self._view.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._told(event.client, self._look_at, self._view.label)

        @self._views.on_click
        async def _(event: viser.GuiEvent[Any]) -> None:
            self._told(event.client, self._look_at, self._views.value)

        @self._task.on_update
        async def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is not None:
                self._told(event.client, self._ask, self._task.value)

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
        if control in self._sliders.values() and not control.min <= control.value <= control.max:
            self._unfinished = control, time.monotonic()  # somebody types: of 0.6 the 0 comes first
            return
        if self._unfinished is not None and (control is self._unfinished[0] or control is self._field):
            self._unfinished = None
        try:
            self._apply(self._asked(control))
        except VffNullError:
            self._show_settings(self._settings)
            raise

    def _asked(self, control: Any) -> dict[str, Any]:
        """The settings that a control asks for."""
        settings = copy.deepcopy(self._settings)
        field = settings["field"]
        if control is self._avoidance:
            settings["avoidance"] = _known(WAYS, control.value)
        elif control is self._ahead:
            settings.setdefault("yielding", {}).pop("preview", None)
            if control.value:
                settings["yielding"]["preview"] = {}
        elif control is self._kind:
            field["kind"] = control.value
            if control.value == "bounded":
                field.pop("floor", None)
        elif control is self._sliders["influence"]:
            field["influence"] = control.value
            if field.get("floor", 0.0) >= control.value:
                field.pop("floor", None)
        for key in OF_THE_CONTROLLER:
            if control is self._sliders[key]:
                settings[key] = control.value
        if control in (self._sliders["gain"], self._field):
            field["gain"] = self._sliders["gain"].value if self._field.value else 0.0
        return settings

    def _ask(self, task: str) -> None:
        """Begin the scenario anew with another task and the present settings."""
        try:
            self._page.open(with_task(self._page.scenario, self._settings, task))
        except VffNullError:
            put(self._task, said(self._settings, "task"))
            raise

    def _open_preset(self) -> None:
        # A visitor must not choose files of the machine that runs the page.
        self._page.open(Scenario.load(_known({name: name for name in scenarios()}, self._preset.value)))

    def _look_at(self, view: str) -> None:
        _known(self._page.views, view)
        self._page.look(view)
        self._show_views()

    def _show_views(self) -> None:
        """Two ways to look are a button that goes to the other one, more are a group."""
        views, view = self._page.views, self._page.view
        names = tuple(views)
        self._view.visible, self._views.visible = len(names) == 2, len(names) > 2
        if len(names) == 2:
            other = names[1 - names.index(view)]
            self._view.label = other
            self._view.icon = viser.Icon.CUBE if view == names[0] else viser.Icon.VIEWPORT_WIDE
        else:
            self._views.options = names
        self._how.content = views[view]

    def _apply(self, settings: dict[str, Any]) -> None:
        self._page.configure(settings)
        self._settings = settings
        pushes = settings["field"]["gain"] > 0.0
        self._lead.content = LEAD if pushes else KEPT_AWAY.get(said(settings, "avoidance"), NO_PUSH)
        self._ahead.visible = settings.get("avoidance") == "cbf"

    def _tell(self, name: str) -> None:
        """Begin a story."""
        story = _known(STORIES, name)
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

    def _send(self, client: viser.ClientHandle) -> None:
        """Let somebody save what runs."""
        scenario = self._page.present()
        client.send_file_download(
            file_name(scenario.name, ".toml"), str(scenario).encode(), save_immediately=True
        )

    def _show_projection(self, on: bool) -> None:
        self._projected = on
        self._projection.label = f"Null-space projection: {'on' if on else 'OFF'}"
        self._projection.icon = viser.Icon.TOGGLE_RIGHT if on else viser.Icon.TOGGLE_LEFT
        self._projection.color = "green" if on else "red"

    def _show_paused(self, paused: bool) -> None:
        self._pause.label = GO_ON if paused else "Pause"
        self._pause.icon = viser.Icon.PLAYER_PLAY if paused else viser.Icon.PLAYER_PAUSE
        self._back.visible = self._replay.visible = paused
        put(self._back, 0.0)

    @staticmethod
    def _told(client: viser.ClientHandle | None, action: Callable[..., None], *arguments: Any) -> None:
        """Do something, and tell whoever asked for it if it cannot be done."""
        try:
            action(*arguments)
        except (VffNullError, ImportError, OSError) as fault:
            if client is None:
                raise
            client.add_notification("This cannot be done", str(fault), color="red", auto_close_seconds=8.0)


def _known(among: Mapping[str, T], name: str) -> T:
    """What a name stands for, which a browser has sent."""
    if not isinstance(name, str) or name not in among:
        raise InputError(f"{name!r:.60} is none of {listed(list(among))}")
    return among[name]
