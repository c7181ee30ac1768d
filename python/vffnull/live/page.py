"""The page: one scenario at a time, its drawing, its controls, and the thread that keeps them up to date."""

from __future__ import annotations

import copy
import threading
import time
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import viser
from numpy.typing import ArrayLike, NDArray

import vffnull._core as _core
from vffnull._support.errors import InputError, VffNullError
from vffnull.live.clock import Rate
from vffnull.live.ending import Ending
from vffnull.live.fitting import Fitting
from vffnull.live.guard import guarding
from vffnull.live.icons import archive_open
from vffnull.live.layout import docked
from vffnull.live.memory import Memory
from vffnull.live.panel import Panel
from vffnull.live.quiet import quiet
from vffnull.live.readouts import STOPPED, told_of
from vffnull.live.recording import Recorder
from vffnull.live.scene import TRAIL, Dress, Scene, around, kind_of
from vffnull.live.scene.camera import Camera, aspect_of
from vffnull.live.sliders import said, unprojected
from vffnull.live.wanted import WantedPlan
from vffnull.model.scenario import Scenario
from vffnull.model.settings import setting

FRAME = 1 / 60
"""Between two pictures [s]."""
ASPECT = 0.92
"""Width over height of the picture, until the browser says what it is."""
READ = 0.15
"""Between two updates of the numbers [s]."""
FIRST = 10.0
"""Time waits no longer than this for the first picture [s]: a browser may never say that it has drawn."""


class LivePage:
    """A page on 127.0.0.1 with a scenario that runs in real time; made by `vffnull.live`.

    Parameters
    ----------
    scenario : Scenario
        What to start with.
    port : int
        The port.
    folder : Path
        Where recordings go.
    allowed : collection of str, optional
        Origins other than the page's own that may use it.
    dress : Mapping, optional
        Surfaces of the first scenario's arm by the names of its links.

    Attributes
    ----------
    url : str
        Where the page is.
    """

    def __init__(
        self,
        scenario: Scenario,
        port: int,
        folder: Path,
        allowed: Collection[str] = frozenset(),
        dress: Dress | None = None,
    ) -> None:
        self._live = _core.Live(scenario.to_dict())  # first: nothing is left behind if it fails
        self._ghost: _core.Live | None = None
        self._with_ghost = self._with_plan = True
        self._dress, self._dressed = dress, scenario.to_dict()["arm"]
        self._bare = False
        self._view = next(iter(kind_of(scenario).views))
        self._dragged = False
        self._put: set[int] = set()  # obstacles that somebody has moved
        self._shadows = False
        self._seen = False
        self._held_until: float | None = None
        self._memory = Memory()
        self._end = Ending()
        self._wanted = WantedPlan(self._notify)
        self._lock = threading.RLock()  # around everything that belongs to one scenario
        self._over = threading.Event()
        self._rate = Rate(time.monotonic())
        self.drawn = 0
        """Pictures so far."""
        self.shown: Mapping[str, Any] = {}
        """The state in the last of them."""
        self.frame_rate = 0.0
        """Pictures sent per second [Hz]."""
        with quiet(), guarding(allowed):
            self._server = viser.ViserServer(host="127.0.0.1", port=port, label="vffnull", verbose=False)
        self.url = f"http://127.0.0.1:{self._server.get_port()}"
        self._plots, self._side = docked(self._server)
        with archive_open():
            self._panel = Panel(self._server, self)
            self._recorder = Recorder(folder, self._panel.show_recording, self._notify)
            self._server.on_client_connect(self._welcome)
            self._server.on_client_disconnect(self._miss)
            self._open(scenario)
        self._painter = threading.Thread(target=self._paint, name="vffnull-painter", daemon=True)
        self._painter.start()

    # ------------------------------------------------------------------------------------- for the panel

    @property
    def scenario(self) -> Scenario:
        """What runs."""
        return self._scenario

    def open(self, scenario: Scenario) -> None:
        """Run another scenario."""
        live = _core.Live(scenario.to_dict())
        with self._lock:
            if self._over.is_set():
                return
            self.stop_recording()
            old, self._live = self._live, live
            old.stop()
            self._open(scenario)
            self._move_cameras()

    def _open(self, scenario: Scenario) -> None:
        self._scenario = scenario
        if self._view not in kind_of(scenario).views:
            self._view = next(iter(kind_of(scenario).views))
        self._draw_scene()
        self._settings = copy.deepcopy(scenario.to_dict().get("controller", {}))
        self._put.clear()
        self._haunt()
        self._panel.show(scenario)
        self._bounds: tuple[float, ...] | None = None
        self._scene.camera(self._box(), ASPECT).begin_with(self._server)
        self._end.begin(scenario)
        self._run(True)

    def _draw_scene(self) -> None:
        """Draw the scenario from its start."""
        self._memory.clear()
        self._scene: Scene = kind_of(self._scenario)(
            self._server,
            self._scenario,
            self._carry,
            self._aim,
            self._turn,
            self,
            self._view,
            not self._dragged,
            self._shadows,
            self._dress if self.has_meshes and not self._bare else None,
        )
        self._scene.show_plan(self._with_plan)
        self._clear_plots()

    def _clear_plots(self) -> None:
        task = setting(self._scenario.to_dict(), "controller.task")
        self._plots.clear(task != "position")

    def _run(self, on: bool) -> None:
        self._held_until = None
        if on:
            self._end.go_on()
        for live in self._loops():
            live.start() if on else live.pause()

    def _loops(self) -> list[_core.Live]:
        """The loop, and that of the ghost."""
        return [self._live] if self._ghost is None else [self._live, self._ghost]

    def _haunt(self) -> None:
        """Let the arm without projection run beside, where it is wanted and is another one."""
        if self._ghost is not None:
            self._ghost.stop()
            self._ghost = None
        if self._with_ghost and said(self._settings, "projection") != "none":
            document = self._scenario.to_dict()
            document["controller"] = unprojected(self._settings)
            try:
                self._ghost = _core.Live(document)
            except VffNullError:  # what it would be compared with cannot be run
                self._ghost = None
        self._scene.show_ghost(self._ghost is not None)

    def show_ghost(self, on: bool) -> None:
        """Run the arm without projection beside; both begin anew, so that they meet the same."""
        with self._lock:
            if on != self._with_ghost and not self._over.is_set():
                self._with_ghost = on
                self._haunt()
                self._renew()

    def show_plan(self, on: bool) -> None:
        """Draw the arm where the plan has it."""
        with self._lock:
            self._with_plan = on
            self._scene.show_plan(on)

    def configure(self, controller: Mapping[str, Any]) -> None:
        """Take over settings of the controller, and draw the halos as wide as its field reaches.

        Raises
        ------
        vffnull.errors.ScenarioError
            If they cannot be used; those of before stay.
        """
        with self._lock:
            self._live.configure(dict(controller))
            self._settings = copy.deepcopy(dict(controller))
            if self._ghost is not None:
                try:
                    self._ghost.configure(unprojected(self._settings))
                except VffNullError:
                    self._ghost.stop()
                    self._ghost = None
            projected = said(self._settings, "projection") != "none"
            self._scene.show_ghost(self._ghost is not None and projected)
            field = controller.get("field", {})
            influence = float(field.get("influence", 0.0)) if field.get("gain", 0.0) > 0.0 else 0.0
            if influence != self._scene.influence:
                self._scene.show_influence(influence)

    def pause(self, paused: bool) -> None:
        """Stand still, or go on."""
        with self._lock:
            if not self._over.is_set():
                self._memory.leave()
                self._run(not paused)

    def look_back(self, seconds: float) -> None:
        """Show what was drawn so many seconds ago; 0 is the present."""
        with self._lock:
            self._memory.look(seconds)

    def replay(self) -> None:
        """Show again what was drawn, from where one looks or from as far back as possible."""
        with self._lock:
            self._memory.play()

    def reset(self, as_filed: bool = False, run: bool = True) -> None:
        """Go back to the start with the present settings, or with those of the scenario; so in any case after
        a loop that has stopped by itself, which they did not make stop; time stands still if not `run`.
        """
        with self._lock:
            if self._over.is_set():
                return
            self.stop_recording()
            if as_filed or self._live.snapshot()["status"] in STOPPED:
                self.open(self._scenario)
                return
            self._live.pause()  # until all is drawn: both arms begin together
            self._live.reset()
            self._put.clear()
            influence = self._scene.influence
            self._draw_scene()
            self._haunt()
            self._scene.show_influence(influence)
            self._end.begin(self._scenario)
            self._run(run)

    def _renew(self) -> None:
        """Begin anew, in a pause if there is one."""
        held = self._held_until
        self.reset(run=self._live.snapshot()["status"] != "paused")
        self._held_until = held

    def begin_at(self, q: list[float]) -> None:
        """Begin anew from other joint positions (n,) with the present settings, if that can be done."""
        try:
            self.open(self.present().replace(q0=q))
        except VffNullError as fault:
            self._notify("This cannot be done", str(fault), 8)

    def present(self) -> Scenario:
        """What runs, as a scenario: the present settings, and the obstacles that have been put somewhere at
        rest there.
        """
        with self._lock:
            state = self._live.snapshot()
            obstacles = [
                self._scene.standing(i, state["obstacles"][i], state["turns"][i]) if i in self._put else each
                for i, each in enumerate(self._scene.documents)
            ]
            return self._scenario.replace(controller=self._settings, obstacles=obstacles)

    def plan(self) -> None:
        """Plan a motion to where the target is, and follow it when it is found."""
        with self._lock:
            self._meddle()
            if not self._live.snapshot()["has_plans"]:
                self.stop_recording()
            for live in self._loops():
                live.plan()
            self._wanted.begin()

    def add_obstacle(self) -> None:
        """Put a disc, or a ball, where there is room."""
        with self._lock:
            self._is_open()
            self.stop_recording()
            self._memory.clear()
            more = self._scene.spare(len(self._live.snapshot()["obstacles"]))
            for live in self._loops():
                live.add(more)
            self._scene.add(more)
            self._scene.show_influence(self._scene.influence)

    def remove_obstacle(self) -> None:
        """Take away the last obstacle."""
        with self._lock:
            count = len(self._live.snapshot()["obstacles"])
            if count:
                self.stop_recording()
                self._memory.clear()
                for live in self._loops():
                    live.remove(count - 1)
                self._put.discard(count - 1)
                self._scene.remove(count - 1)

    def grab(self, link: int, point: ArrayLike) -> None:
        """Take hold of a link at a point of its frame.

        The other arm is held at its own point: it is pulled as far, wherever it is.

        Parameters
        ----------
        link : int
            Its index.
        point : (D,) array_like
            The point in the frame of the link [m].
        """
        with self._lock:
            self._meddle()
            for live in self._loops():
                live.grab(self._scenario.arm.link_names[link], point)

    def pull_by(self, offset: ArrayLike) -> None:
        """Pull the link that is held towards the place that is so far (D,) [m] from where it was then."""
        for live in self._loops():
            live.pull_by(offset)

    def let_go(self) -> None:
        """Hold no link any longer."""
        for live in self._loops():
            live.let_go()

    def update_points(
        self, cloud: ArrayLike, obstacle: int = 0, velocities: ArrayLike | None = None, t: float | None = None
    ) -> None:
        """Replace the points of a cloud while the loop runs, as often as a camera sees new ones.

        Parameters
        ----------
        cloud : (k, 3) array_like
            The points [m], relative to the cloud's position, in its frame.
        obstacle : int, optional
            Which obstacle the cloud is.
        velocities : (k, 3) array_like, optional
            At which velocities the points go on by themselves [m/s], for the law; they are shown where they
            were given.
        t : float, optional
            When they were there [s], by the loop's time; without, now.

        Raises
        ------
        vffnull.errors.InputError
            If they are not points in space, not finite or too many, if there is not one velocity to each, or
            if the obstacle is no cloud. The points are those of before then.
        """
        with self._lock:
            for live in self._loops():
                live.update_points(cloud, obstacle, velocities, t)
            self._scene.show_points(np.asarray(cloud, dtype=float), obstacle)

    def start_recording(self) -> Path:
        """Begin to record; the file."""
        with self._lock:
            self._is_open()
            return self._recorder.begin(self._live, self._scenario)

    def stop_recording(self) -> tuple[Path, int] | None:
        """End a recording; its file and the number of its rows."""
        with self._lock:
            return self._recorder.end()

    @property
    def views(self) -> Mapping[str, str]:
        """How one may look at the scene, each with a sentence on how things are dragged then."""
        return self._scene.views

    @property
    def view(self) -> str:
        """How one does."""
        return self._view

    def look(self, view: str) -> None:
        """Look at the scene in another way."""
        with self._lock:
            self._view = view
            self._scene.look(view)
            self._move_cameras()

    def cast_shadows(self, on: bool) -> None:
        """Whether bodies in space cast shadows; the scene begins anew."""
        with self._lock:
            if on != self._shadows and not self._over.is_set():
                self._shadows = on
                self._renew()

    @property
    def has_meshes(self) -> bool:
        """Whether it is known how the arm looks."""
        return self._dress is not None and self._scenario.to_dict()["arm"] == self._dressed

    def show_meshes(self, on: bool) -> None:
        """Draw the arm as it looks, or as the bodies that are measured; the scene begins anew."""
        with self._lock:
            if on == self._bare and not self._over.is_set():
                self._bare = not on
                self._renew()

    @property
    def notes(self) -> list[str]:
        """What is odd about what runs, in sentences."""
        return self._live.notes

    # -------------------------------------------------------------------------------------- for the owner

    def snapshot(self) -> _core.LiveState:
        """The present state of the loop."""
        return self._live.snapshot()

    def wait(self) -> None:
        """Stay until Ctrl-C or `stop`."""
        while not self._over.wait(0.2):
            pass

    def stop(self) -> None:
        """End loop, recording and page; nothing starts it again."""
        with self._lock:  # nobody is in the middle of a start
            if self._over.is_set():
                return
            self._over.set()
        self._painter.join()
        with self._lock:
            self.stop_recording()
            for live in self._loops():
                live.stop()
        with quiet():
            self._server.stop()

    # --------------------------------------------------------------------------------------------- inside

    def _is_open(self) -> None:
        if self._over.is_set():
            raise InputError("the page has been stopped")

    def _meddle(self) -> None:
        """Somebody takes hold of something: they see the present, beyond the end of a scene, too."""
        with self._lock:
            self._dragged = True
            self._memory.leave()
            if self._end.drop():
                self._run(True)

    def _carry(self, obstacle: int, place: NDArray[np.float64]) -> None:
        self._meddle()
        self._put.add(obstacle)
        self._bring(obstacle, place)

    def _bring(self, obstacle: int, place: NDArray[np.float64]) -> None:
        for live in self._loops():
            live.carry(obstacle, place)

    def _aim(self, place: NDArray[np.float64]) -> None:
        self._meddle()
        for live in self._loops():
            live.aim(place)

    def _turn(self, obstacle: int | None, orientation: NDArray[np.float64]) -> None:
        self._meddle()
        for live in self._loops():
            if obstacle is None:
                live.turn_target(orientation)
            else:
                self._put.add(obstacle)
                live.turn(obstacle, orientation)

    def _move_cameras(self) -> None:
        """Show everybody the whole picture."""
        for client in self._server.get_clients().values():
            self._move_camera(client)

    def _move_camera(self, client: viser.ClientHandle) -> None:
        if (aspect := aspect_of(client.camera)) is not None:
            self._scene.camera(self._box(), aspect).move(client)

    async def _welcome(self, client: viser.ClientHandle) -> None:
        """Show the whole picture, now and whenever the room for it changes. Whoever comes first sees the
        scene from its beginning: time waits for their first picture.
        """
        with self._lock:
            seen, self._seen = self._seen, True
            untouched = not self._dragged and not self._recorder.is_on and not self._over.is_set()
            is_watched = self._live.snapshot()["status"] == "running" or self._end.at is not None
            if not seen and untouched and is_watched:
                self._run(False)
                for live in self._loops():
                    live.reset()
                self._end.begin(self._scenario)
                self._held_until = time.monotonic() + FIRST
                self._memory.clear()
                self._clear_plots()

        def wanted(aspect: float) -> tuple[Camera, float]:
            return self._scene.camera(self._box(), aspect), 0.01 * self._scene.reach

        fitting = Fitting(client, self._side, self._server.initial_camera, wanted, self._begin)

        @client.camera.on_update
        async def _(camera: viser.CameraHandle) -> None:
            fitting.update(camera)

    async def _miss(self, client: viser.ClientHandle) -> None:
        """Whoever has left waits for no picture, and holds nothing."""
        self._begin()
        with self._lock:
            self._scene.leave(client.client_id)

    def _begin(self) -> None:
        """Let time begin, if it has waited for the first picture."""
        with self._lock:
            if self._held_until is not None and not self._over.is_set():
                self._run(True)

    def _box(self) -> tuple[float, ...]:
        """Limits [m] around the arm and what is near it at the start."""
        if self._bounds is None:
            self._bounds = around(self._scenario, self._scene.reach)
        return self._bounds

    def _paint(self) -> None:
        """Draw until the page is stopped."""
        read_at = 0.0
        due = time.monotonic()
        drawn: tuple[int, float, bool] | None = None
        while not self._over.is_set():
            due = max(due + FRAME, time.monotonic() - FRAME)
            with self._lock:
                if self._held_until is not None and due > self._held_until:
                    self._begin()
                present = state = self._live.snapshot()
                other = self._ghost.snapshot() if self._ghost is not None else None
                if state["status"] == "running":
                    self._memory.add(state, other)
                    if self._end.comes(state["t"]):
                        self._run(False)
                self._memory.go_on(FRAME)
                past = self._memory.seen()
                if past is not None:
                    state, other = past
                    if drawn is None or state["t"] != drawn[1]:
                        self._scene.retrace(self._memory.tips(TRAIL, self._scene.size))
                moment = (id(self._scene), state["t"], past is None)
                if moment != drawn or self._scene.waits:  # a browser rests while nothing moves
                    with self._server.atomic():
                        self._scene.draw(state, other)
                    self._scene.follow(self._server.get_clients().values())
                    if past is None:
                        for obstacle, place in self._scene.strays(state):
                            self._bring(obstacle, place)
                    drawn = moment
                self._plots.add(present)
                self.shown = state
                now = time.monotonic()
                if now - read_at > READ:
                    read_at = now
                    told = {"ended": self._end.at, "back": self._memory.back, **self._scene.readings()}
                    self._panel.read({**told_of(state, present, self._scenario), **told})
                    self._panel.show_run("running" if self._held_until else present["status"])
                    self._panel.show_memory(self._memory.span, self._memory.back or 0.0)
                    self._plots.pictures.show(self._live.pictures())
                    self._plots.self_motion.show(self._live.self_motion_map())
                    self._wanted.read(present["search"])
                    self._recorder.drain()
            self.drawn += 1
            self.frame_rate = self._rate.count(now)
            self._over.wait(max(0.0, due - time.monotonic()))

    def _notify(self, title: str, text: str, seconds: float | None = None) -> None:
        """Tell everybody there of what could not be done."""
        for client in self._server.get_clients().values():
            client.add_notification(title, text, color="red", auto_close_seconds=seconds)
