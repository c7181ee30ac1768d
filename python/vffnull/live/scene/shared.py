"""What drawings in the plane and in space share: which parts there are, where they go, what is dragged."""

from __future__ import annotations

import copy
import dataclasses
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
import viser

from vffnull._core import quaternions
from vffnull.draw import scene as pictures
from vffnull.draw.geometry import points_in_space
from vffnull.draw.shapes import is_seen
from vffnull.live.scene.arms import Arms
from vffnull.live.scene.camera import WITHIN, Camera
from vffnull.live.scene.hands import Grip, Hand, Held
from vffnull.live.scene.legend import Legend, strongest
from vffnull.live.scene.looks import (
    ARRIVED,
    FAINT,
    FORCE,
    HALO,
    OBSTACLE,
    SPECK,
    STEP,
    TABLE,
    TARGET,
    UNSEEN,
    WRENCH,
    Array,
    Core,
    Dress,
    Quaternion,
    Which,
)
from vffnull.live.scene.meshes import Mesh
from vffnull.live.scene.spring import Spring
from vffnull.live.scene.trail import Trail
from vffnull.model.scenario import Scenario


class Scene(ABC):
    """What is drawn of one scenario.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    scenario : Scenario
        What runs.
    on_carry : Callable
        Called with the index of an obstacle and the place (D,) [m] where it is dragged to.
    on_aim : Callable
        Called with the place where the target is dragged to.
    on_turn : Callable
        Called with the index of an obstacle in space, or None for the target, and the orientation (4,) to
        which it is turned.
    hand : Hand
        Gets hold of the links that are dragged.
    view : str, optional
        One of `views`; the first by default.
    hint : bool
        Whether to say that something can be dragged.
    shadows : bool
        Whether bodies in space cast shadows, which a computer without a graphics card has trouble with.
    dress : Mapping, optional
        How the links look, where that is not the bodies that are measured.
    """

    views: ClassVar[Mapping[str, str]]
    """How one may look at it, each with a sentence on how things are dragged then."""
    up: ClassVar[str]
    """The axis that points upwards on the screen at first."""
    FREE: ClassVar[Array]
    """The colour of a link that is out of influence."""
    HALO_OPACITY: ClassVar[float]
    TRAIL_STEP: ClassVar[float]
    """How far the tip goes [reaches] before its trail has another point."""

    def __init__(
        self,
        server: viser.ViserServer,
        scenario: Scenario,
        on_carry: Callable[[int, Array], None],
        on_aim: Callable[[Array], None],
        on_turn: Callable[[int | None, Array], None],
        hand: Hand,
        view: str | None = None,
        hint: bool = True,
        shadows: bool = True,
        dress: Dress | None = None,
    ) -> None:
        self._shadowed, self._dress = shadows, dress
        self._server = server
        self._on_carry, self._on_aim, self._on_turn = on_carry, on_aim, on_turn
        self._puller = hand
        self._arm = scenario.arm
        self.reach = self._reach_of(scenario)
        still = pictures.Scene.of_scenario(scenario)
        self._still = dataclasses.replace(still, cores=(), influence=0.0)
        server.scene.reset()
        server.scene.set_up_direction(self.up)  # type: ignore[arg-type]
        server.scene.configure_default_lights(False)
        server.scene.configure_environment_map(None)  # without a graphics card it takes seconds
        self._wanted: dict[int | None, Array] = {}
        self._shadows: dict[int | None, viser.MeshHandle] = {}
        self._held: dict[int, Held | Grip] = {}
        self._obstacles: list[viser.MeshHandle | viser.PointCloudHandle] = []
        self._halos: list[viser.MeshHandle] = []
        self._documents: list[Mapping[str, Any]] = []
        self._shapes: list[Core] = []
        self._made = 0
        self.influence = 0.0
        self._add_surroundings(scenario)
        document = scenario.to_dict()
        follows = document["reference"]["kind"] == "plan" or document.get("replan") is not None
        self._arms = Arms(self._add_arm, self._place_arm, self.FREE, follows)
        for i, parts in enumerate(self._arms.links):
            for part in parts:
                self._make_grippable(part, i)
        self._target = self._add_target()
        self._target.on_drag(self._dragged_target)
        self._tip = self._add_tip()
        self._trail = Trail(server, self.reach, self.TRAIL_STEP)
        self._forces = [self._add_arrow(f"/force-{i}") for i in range(self._arm.n)]
        pushed = len(scenario.to_dict().get("wrenches", ()))
        self._wrenches = [self._add_arrow(f"/wrench-{i}", WRENCH) for i in range(pushed)]
        self._spring = Spring(server, self._add_arrow("/pull", WRENCH), WRENCH, self.reach)
        self._legend = Legend(server, self.reach, strongest(scenario))
        self._legend.stand(self._add_arrow("/legend"), *self._place_of_legend())
        for arrow in [
            *self._forces,
            *self._wrenches,
            self._spring.arrow,
        ]:  # browsers show one before they stretch it for the first time
            arrow.scale = (1e-3, 1e-3, 1e-3)
        for obstacle in scenario.to_dict().get("obstacles", []):
            self.add(obstacle)
        self._hint = self._add_hint() if hint else None
        self.look(view or next(iter(self.views)))

    # ------------------------------------------------------------------------------- what plane and space say

    @abstractmethod
    def _reach_of(self, scenario: Scenario) -> float:
        """About how far the arm reaches [m]: the measure of everything that is drawn."""

    @abstractmethod
    def _place_of_legend(self) -> tuple[Array, Array]:
        """Where the arrow of the legend begins, and where what it says stands (3,) [m]."""

    @abstractmethod
    def _spot(self, place: Array, layer: str) -> Array:
        """Where a place (D,) [m] is on the page (3,)."""

    @abstractmethod
    def _core_of(self, obstacle: Mapping[str, Any]) -> Core:
        """What an obstacle looks like."""

    @abstractmethod
    def _mesh_of(self, core: Core) -> Mesh:
        """A body as triangles."""

    @abstractmethod
    def _halo_core(self, index: int) -> Core:
        """What is within the influence distance of an obstacle."""

    @abstractmethod
    def _add_surroundings(self, scenario: Scenario) -> None:
        """Lights, the floor, and what else does not move."""

    @abstractmethod
    def _add_arm(self, which: Which) -> list[list[viser.MeshHandle]]:
        """The bodies of each link."""

    @abstractmethod
    def _add_target(self) -> viser.MeshHandle:
        """What is dragged of the target."""

    @abstractmethod
    def _add_tip(self) -> viser.SceneNodeHandle:
        """What is at the tip of the arm."""

    @abstractmethod
    def _add_arrow(self, name: str, colour: Any = FORCE) -> viser.MeshHandle:
        """An arrow of unit length along x, to be stretched and turned."""

    @abstractmethod
    def _place_arm(self, q: Array, which: Which) -> None:
        """Put one of the arms where it is at joint positions (n,)."""

    @abstractmethod
    def _toward(self, vector: Array) -> Quaternion:
        """The turn that takes the x axis to a vector (D,)."""

    @abstractmethod
    def _grasp(
        self, event: viser.SceneNodeDragEvent[Any], hit: int | None, link: int | None
    ) -> Held | Grip | None:
        """What a drag that begins takes hold of, on an obstacle, a link or neither."""

    @abstractmethod
    def _frame(self, link: int) -> tuple[Array, Array]:
        """Where the frame of a link is in the picture: its origin (D,) [m] and its axes (D, D)."""

    @abstractmethod
    def _pulled_to(self, event: viser.SceneNodeDragEvent[Any], start: Array) -> Array:
        """Where a drag points to (D,) [m] that has taken hold of a link at a place."""

    @abstractmethod
    def _pointed(self, event: viser.SceneNodeDragEvent[Any]) -> Array:
        """Where a drag points to (D,) [m]."""

    @abstractmethod
    def camera(self, box: tuple[float, ...], aspect: float) -> Camera:
        """A camera that sees a box, given by the ends [m] of each of its sides, in a picture of this width
        over height.
        """

    @abstractmethod
    def spare(self, count: int) -> dict[str, Any]:
        """The document of one more obstacle than `count`, where there is room."""

    @abstractmethod
    def look(self, view: str) -> None:
        """Look at it in another way; the cameras are moved by others."""

    def strays(self, state: Mapping[str, Any]) -> Iterable[tuple[int, Array]]:
        """Obstacles that have gone out of sight by themselves, and places (D,) [m] within it."""
        return ()

    def follow(self, clients: Iterable[viser.ClientHandle]) -> None:  # noqa: B027 - not all do
        """Move the cameras of those who follow something."""

    def readings(self) -> Mapping[str, float]:
        """What is measured in the drawing alone: the force [N] of the legend's arrow, and what else there
        is.
        """
        return {"newtons": self._legend.newtons} if self.influence > 0.0 else {}

    # ------------------------------------------------------------------------------------------- obstacles

    def add(self, obstacle: Mapping[str, Any]) -> None:
        """Draw one more obstacle."""
        self._made += 1
        core = self._core_of(obstacle)
        name = f"/obstacle-{self._made}"
        self._documents.append(copy.deepcopy(dict(obstacle)))
        self._shapes.append(core)
        index = len(self._shapes) - 1
        if self._is_cloud(index):
            self._obstacles.append(self._add_cloud(name, obstacle, core[1]))
            self._halos.append(self._add_halo(f"{name}-halo", index))
            self._changed()
            return
        colour = TABLE if self._endless(index) else OBSTACLE if is_seen(obstacle) else UNSEEN
        handle = self._solid(name, core, colour, "obstacle", 0.3 if "likelihood" in obstacle else None)
        self._obstacles.append(handle)
        self._halos.append(self._add_halo(f"{name}-halo", index))
        self._changed()
        if not self._endless(index):
            self._make_draggable(handle)

        @handle.on_click
        async def _(event: viser.SceneNodePointerEvent[Any]) -> None:
            obstacle = self._index_of(handle)
            if obstacle is not None:
                self._clicked(obstacle, event)

    @property
    def documents(self) -> Sequence[Mapping[str, Any]]:
        """The obstacles as they are described."""
        return self._documents

    def standing(self, index: int, place: Array, turn: Array) -> dict[str, Any]:
        """An obstacle that rests at a place (D,) [m], turned by a rotation (D, D) since the start."""
        document = {**self._documents[index], "position": place.tolist(), "motion": {"kind": "static"}}
        document.pop("angular_velocity", None)
        return document

    def remove(self, index: int) -> None:
        """Take an obstacle out of the drawing."""
        for handles in (self._obstacles, self._halos):
            handles.pop(index).remove()
        self._shapes.pop(index)
        self._documents.pop(index)
        self._held.clear()
        self._forget(index)
        self._changed()

    def show_influence(self, influence: float) -> None:
        """Draw the halos as wide as the field reaches [m]; none at 0."""
        self.influence = influence
        self._legend.show(influence > 0.0)
        for index, handle in enumerate(self._halos):
            name = handle.name
            handle.remove()
            self._halos[index] = self._add_halo(name, index)

    def _endless(self, obstacle: int) -> bool:
        """Whether it has no end, as a table, which must not catch every drag."""
        return bool(self._documents[obstacle]["shape"]["kind"] == "half_space")

    def _is_cloud(self, obstacle: int) -> bool:
        """Whether it is a cloud of points, which nobody can take hold of."""
        return bool(self._documents[obstacle]["shape"]["kind"] == "points")

    def _add_cloud(self, name: str, obstacle: Mapping[str, Any], radius: float) -> viser.PointCloudHandle:
        points = points_in_space(obstacle["shape"], obstacle.get("orientation"))
        return self._server.scene.add_point_cloud(
            name,
            np.zeros((0, 3), np.float32) if points is None else points.astype(np.float32),
            np.array(OBSTACLE, dtype=np.uint8),
            point_size=2.0 * max(radius, SPECK * self.reach),
            point_shape="circle",
            precision="float32",
        )

    def show_points(self, points: Array, obstacle: int) -> None:
        """Draw other points of a cloud, (k, 3) [m] as they are in its own frame."""
        document = self._documents[obstacle]
        document = {**document, "shape": {**document["shape"], "points": points.reshape(-1, 3)}}
        seen = points_in_space(document["shape"], document.get("orientation"))
        cloud = self._obstacles[obstacle]
        assert isinstance(cloud, viser.PointCloudHandle) and seen is not None
        cloud.points = seen.astype(np.float32)
        self._documents[obstacle] = document

    def _make_draggable(self, handle: viser.MeshHandle) -> None:
        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            obstacle = self._index_of(handle)
            if obstacle is not None:
                self._drag(event, obstacle)

    def _make_grippable(self, handle: viser.MeshHandle, link: int) -> None:
        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            self._drag(event, None, link)

    def _index_of(self, handle: viser.MeshHandle) -> int | None:
        """Which obstacle it is, if it still is one; viser compares handles by their arrays, which fails."""
        return next((i for i, each in enumerate(self._obstacles) if each is handle), None)

    def _changed(self) -> None:  # noqa: B027
        """Obstacles have come or gone."""

    # ------------------------------------------------------------------------------------------------ drag

    async def _dragged_target(self, event: viser.SceneNodeDragEvent[Any]) -> None:
        self._drag(event, None)

    def _clicked(self, obstacle: int, event: viser.SceneNodePointerEvent[Any]) -> None:
        """It waits where it is seen."""
        size = self._still.dimension
        self._carry(obstacle, np.asarray(self._obstacles[obstacle].position[:size]))

    def _drag(self, event: viser.SceneNodeDragEvent[Any], hit: int | None, link: int | None = None) -> None:
        """Move, or pull at, what somebody has taken hold of."""
        if event.phase == "start":
            self.leave(event.client_id)
            held = self._grasp(event, hit, link)
            if held is None:
                return
            self._held[event.client_id] = held
            if isinstance(held, Grip):
                origin, axes = self._frame(held.link)
                self._puller.grab(held.link, (held.start - origin) @ axes)
        held = self._held.get(event.client_id)
        if held is None:
            return
        if isinstance(held, Grip):
            self._puller.pull_by(self._pulled_to(event, held.start) - held.start)
        else:
            self._move(held.obstacle, self._pointed(event) + held.offset)
        if event.phase == "end":
            self.leave(event.client_id)

    def leave(self, client_id: int) -> None:
        """Whoever this is holds nothing any more."""
        if isinstance(self._held.pop(client_id, None), Grip):
            self._puller.let_go()

    def _move(self, obstacle: int | None, place: Array) -> None:
        """Want an obstacle, or the target, to be somewhere else."""
        if obstacle is None:
            self._wanted[None] = place
            self._on_aim(place)
        elif obstacle < len(self._obstacles):
            self._carry(obstacle, place)
        if self._hint is not None:
            self._hint.remove()
            self._hint = None

    def _carry(self, obstacle: int, place: Array) -> None:
        self._wanted[obstacle] = place
        self._on_carry(obstacle, place)

    # ---------------------------------------------------------------------------------------------- frames

    def draw(self, state: Mapping[str, Any], ghost: Mapping[str, Any] | None = None) -> None:
        """Move everything to where it is in a state of the core; `ghost` is that of another arm."""
        size = self._still.dimension
        tip, reference = state["x"][:size], state["x_ref"][:size]
        places = state["obstacles"]
        self._place_arm(state["q"], "arm")
        self._arms.draw_plan(state["q_plan"])
        for forces in (state["forces"], state["wrench_forces"], state["pull_force"]):
            self._legend.cover(float(np.linalg.norm(forces, axis=1).max(initial=0.0)))
        for handle, tail, vector in zip(self._forces, self._tails(state), state["forces"], strict=True):
            self._stretch(handle, tail, vector)
        pushed = zip(self._wrenches, self._pushed_places(state), state["wrench_forces"], strict=True)
        for handle, place, vector in pushed:
            newtons = float(np.linalg.norm(vector))
            along = vector / newtons if newtons > FAINT else vector
            self._stretch(handle, place - self._legend.length(newtons) * along, vector)
        self._draw_pull(state)
        self._arms.shade(state["clearance"], self.influence or 0.1 * self.reach)
        turns = np.tile(np.eye(3), (len(places), 1, 1))
        turns[:, :size, :size] = state["turns"]
        each = zip(self._obstacles, self._halos, places, quaternions(turns), strict=False)
        for drawn, halo, place, wxyz in each:
            drawn.position = self._spot(place, "obstacle")
            halo.position = self._spot(place, "halo")
            if np.abs(drawn.wxyz - wxyz).max() > STEP:
                drawn.wxyz = halo.wxyz = wxyz
        self._target.position = self._spot(reference, "target")
        self._tip.position = self._spot(tip, "tip")
        self._trail.go_to(self._spot(tip, "trail"))
        self._draw_wanted(reference, places, state["status"] == "running")
        self._draw_hint(places)
        self._draw_more(state)
        if ghost is not None:
            self._place_arm(ghost["q"], "ghost")

    def _draw_pull(self, state: Mapping[str, Any]) -> None:
        """The spring by which somebody pulls, and its force."""
        self._spring.show(len(state["pull_point"]) > 0)
        for point, vector, anchor in zip(
            state["pull_point"], state["pull_force"], state["pull_anchor"], strict=True
        ):
            self._stretch(self._spring.arrow, point, vector)
            ends = [self._spot(place, "force") for place in (point, anchor)]
            self._spring.draw(np.array(ends), float(np.linalg.norm(vector)))

    def _tails(self, state: Mapping[str, Any]) -> Array:
        """Where the arrows of the forces begin (n, D) [m]."""
        tails: Array = state["points"]
        return tails

    def _pushed_places(self, state: Mapping[str, Any]) -> Array:
        """Where the arrows of what pushes from outside end (k, D) [m]."""
        places: Array = state["wrench_points"]
        return places

    def _draw_more(self, state: Mapping[str, Any]) -> None:  # noqa: B027
        """What else there is."""

    @property
    def size(self) -> int:
        """Coordinates of a place."""
        return self._still.dimension

    def retrace(self, tips: Iterable[Array]) -> None:
        """Let the trail be the one that these places of the tip (D,) [m] have left."""
        self._trail.retrace(self._spot(tip, "trail") for tip in tips)

    @property
    def waits(self) -> bool:
        """Whether something is not yet where it is wanted."""
        return bool(self._wanted)

    def show_ghost(self, visible: bool) -> None:
        """Whether the other arm is drawn."""
        self._arms.show_ghost(visible)

    def show_plan(self, visible: bool) -> None:
        """Whether the arm of the plan is drawn, where there is one."""
        self._arms.show_plan(visible)

    def _draw_hint(self, places: Array) -> None:
        """Over the first obstacle that can be dragged and is in the picture; nowhere, if there is none."""
        if self._hint is None:
            return
        away = np.linalg.norm(places - self._still.joints[0, 0], axis=1)
        held = (
            i
            for i in range(min(len(self._shapes), len(places)))
            if not self._endless(i) and not self._is_cloud(i) and away[i] < WITHIN * self.reach
        )
        first = next(held, None)
        if self._hint.visible != (first is not None):
            self._hint.visible = first is not None
        if first is not None:
            corners, radius = self._shapes[first]
            above = places[first].copy()
            above[-1] += radius + float(corners[:, -1].max()) + 0.01 * self.reach
            self._hint.position = self._spot(above, "hint")

    def _draw_wanted(self, reference: Array, places: Array, running: bool) -> None:
        """A shadow where something is wanted and not yet, so that dragging shows at once, also in a pause."""
        for key, place in list(self._wanted.items()):
            there = reference if key is None else places[key]
            if np.linalg.norm(place - there) < ARRIVED * self.reach:
                self._forget(key)
            elif key in self._shadows:
                self._shadows[key].position = self._spot(place, "wanted")
                if key is not None:
                    self._shadows[key].wxyz = self._obstacles[key].wxyz
            else:
                core = (np.zeros((1, len(place))), self._target_radius) if key is None else self._shapes[key]
                name = "target" if key is None else str(key)
                colour = TARGET if key is None else OBSTACLE
                shadow = self._solid(f"/wanted-{name}", core, colour, "wanted", opacity=0.3)
                shadow.position = self._spot(place, "wanted")
                self._shadows[key] = shadow
        if running and not self._held:  # a target beyond the reach stays where it can be
            self._forget(None)

    def _forget(self, key: int | None) -> None:
        self._wanted.pop(key, None)
        shadow = self._shadows.pop(key, None)
        if shadow is not None:
            shadow.remove()

    def _stretch(self, handle: viser.MeshHandle, tail: Array, vector: Array) -> None:
        """As long as the force is in the scale of the legend."""
        size = float(np.linalg.norm(vector))
        visible = size > FAINT
        if handle.visible != visible:
            handle.visible = visible
        if visible:
            length = self._legend.length(size)
            width = min(0.045 * self.reach, 0.6 * length)
            handle.scale = (length, width, width)
            handle.wxyz = self._toward(vector)
            handle.position = self._spot(tail, "force")

    # ----------------------------------------------------------------------------------------------- parts

    @property
    def _target_radius(self) -> float:
        return 0.028 * self.reach

    def _add_hint(self) -> viser.LabelHandle:
        place = self._spot(self._still.tip[0], "hint")
        return self._server.scene.add_label(
            "/hint", "drag me", position=place, anchor="bottom-center", font_screen_scale=1.15
        )

    def _add_halo(self, name: str, index: int) -> viser.MeshHandle:
        core = self._halo_core(index)
        visible = self.influence > 0.0 and not self._is_cloud(index) and is_seen(self._documents[index])
        return self._solid(name, core, HALO, "halo", opacity=self.HALO_OPACITY, visible=visible)

    def _solid(
        self,
        name: str,
        core: Core,
        colour: Any,
        layer: str,
        opacity: float | None = None,
        visible: bool = True,
    ) -> viser.MeshHandle:
        """A body at the origin."""
        nowhere = np.zeros(self._still.dimension)
        return self._mesh(
            name, self._mesh_of(core), colour, self._spot(nowhere, layer), opacity=opacity, visible=visible
        )

    def _mesh(
        self,
        name: str,
        mesh: Mesh,
        colour: Any,
        position: Any = (0.0, 0.0, 0.0),
        *,
        opacity: float | None = None,
        visible: bool = True,
        casts: bool = False,
    ) -> viser.MeshHandle:
        drawn = mesh.smooth
        return self._server.scene.add_mesh_simple(
            name,
            drawn.vertices,
            drawn.faces,
            color=np.asarray(colour, dtype=np.uint8),
            opacity=opacity,
            cast_shadow=casts,
            receive_shadow=False,
            position=position,
            visible=visible,
        )
