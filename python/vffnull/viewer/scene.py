"""The drawing: the primitives of a scene as flat plates in the plane, and what is dragged of it."""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull import _core
from vffnull.plotting import geometry, primitives
from vffnull.plotting.primitives import Arrow, Body
from vffnull.scenario import Scenario

Array = NDArray[np.float64]
Colour = tuple[int, int, int]

FREE, NEAR, HIT = np.array([86, 110, 140]), np.array([230, 130, 30]), np.array([200, 20, 40])
"""Colours of a link that is out of influence, half way in, and in contact."""
OBSTACLE, HALO, TARGET, TIP, FORCE, GHOST = (
    (60, 64, 72), (213, 94, 0), (0, 158, 115), (20, 20, 24), (178, 24, 43), (150, 90, 160),
)  # fmt: skip
LAYERS = {
    name: 0.004 * k
    for k, name in enumerate(
        ("halo", "ghost", "wanted", "obstacle", "link", "target", "trail", "force", "tip", "hint")
    )
}
"""Heights [reaches], so that nothing is hidden by what it lies on."""
SHADES = 24
"""Colours of links are rounded to so many, so that they need not be sent in every frame."""
TRAIL = 150
"""Points of the tip's trail."""
FIELD_OF_VIEW = 0.25
"""So narrow that lines look parallel [rad]."""
GRAB = 0.05
"""How far from its surface something may be grabbed [reaches]."""
MEMORY = 30
"""Frames: where something was so lately is where it may still be seen, and grabbed."""
ARRIVED = 0.01
"""How near is there [reaches]."""


@dataclass(frozen=True)
class Held:
    """What somebody has in the hand: an obstacle, or the target, and where it was taken hold of."""

    obstacle: int | None
    offset: Array


class Scene:
    """What is drawn of one scenario.

    Parameters
    ----------
    server : viser.ViserServer
        Where to draw.
    scenario : Scenario
        What runs.
    on_carry : Callable
        Called with the index of an obstacle and the place (2,) [m] where it is dragged to.
    on_aim : Callable
        Called with the place where the target is dragged to.
    flat : bool
        Whether dragging moves things only, and never the camera.
    hint : bool
        Whether to say that something can be dragged.
    """

    def __init__(
        self,
        server: viser.ViserServer,
        scenario: Scenario,
        on_carry: Callable[[int, Array], None],
        on_aim: Callable[[Array], None],
        flat: bool = True,
        hint: bool = True,
    ) -> None:
        self._server, self._on_carry, self._on_aim = server, on_carry, on_aim
        self._arm = scenario.arm
        still = primitives.Scene.of_scenario(scenario)
        self.reach = float(np.sum(self._arm.lengths))
        # A link of radius zero is drawn as a line that one can see.
        self._still = dataclasses.replace(
            still, radii=np.maximum(still.radii, 0.004 * self.reach), cores=(), influence=0.0
        )
        scene = server.scene
        scene.reset()
        scene.set_up_direction("+y")
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light", intensity=2.6)
        scene.add_light_directional("/sun", intensity=0.8, position=(-4.0, 6.0, 12.0), cast_shadow=False)
        self._add_grid()
        self._floor: viser.MeshHandle | None = None
        self._links = self._add_links("/arm", tuple(FREE), "link")
        self._ghost = self._add_links("/ghost", GHOST, "ghost", opacity=0.25)
        self.show_ghost(False)
        self._add_base()
        self._target = self._add_target()
        self._wanted: dict[int | None, Array] = {}
        self._shadows: dict[int | None, viser.MeshHandle] = {}
        self._tip = self._disc("/tip", 0.011 * self.reach, TIP, self._at("tip"))
        self._trail = self._add_trail()
        self._places: deque[Array] = deque(maxlen=TRAIL)
        self._forces = [self._add_arrow(i) for i in range(len(self._links))]
        self._shades = [-1] * len(self._links)
        self._obstacles: list[viser.MeshHandle] = []
        self._halos: list[viser.MeshHandle] = []
        self._shapes: list[tuple[Array, float]] = []
        self._given: list[Mapping[str, Any]] = []
        self._memory: deque[tuple[Array, Array]] = deque(maxlen=MEMORY)
        self._held: dict[int, Held] = {}
        self._made = 0
        self.influence = 0.0
        for obstacle in scenario.to_dict().get("obstacles", []):
            self.add(obstacle)
        self._hint = self._add_hint() if hint else None
        self.flatten(flat)

    # ------------------------------------------------------------------------------------------- obstacles

    def add(self, obstacle: Mapping[str, Any]) -> None:
        """Draw one more obstacle."""
        self._made += 1
        shape = geometry.core(obstacle["shape"], obstacle.get("angle", 0.0))
        name = f"/obstacle-{self._made}"
        handle = self._plate(name, geometry.outline(*shape), OBSTACLE, self._at("obstacle"))
        self._shapes.append(shape)
        self._given.append(obstacle)
        self._obstacles.append(handle)
        self._halos.append(self._add_halo(f"{name}-halo", shape))
        self._memory.clear()

        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            if handle in self._obstacles:
                self._drag(event, self._obstacles.index(handle))

        @handle.on_click
        async def _(event: viser.SceneNodePointerEvent[Any]) -> None:
            if handle in self._obstacles:  # it waits where it is
                self._carry(self._obstacles.index(handle), np.asarray(handle.position[:2]))

    def remove(self, index: int) -> None:
        """Take an obstacle out of the drawing."""
        for handles in (self._obstacles, self._halos):
            handles.pop(index).remove()
        self._shapes.pop(index)
        self._given.pop(index)
        self._memory.clear()
        self._held.clear()
        self._forget(index)

    def show_influence(self, influence: float) -> None:
        """Draw the halos as wide as the field reaches [m]; none at 0."""
        self.influence = influence
        for index, (handle, shape) in enumerate(zip(self._halos, self._shapes, strict=True)):
            name = handle.name
            handle.remove()
            self._halos[index] = self._add_halo(name, shape)

    # ------------------------------------------------------------------------------------------------ drag

    @property
    def flat(self) -> bool:
        """Whether dragging moves things only, and never the camera."""
        return self._floor is not None

    def flatten(self, flat: bool) -> None:
        """Let the floor catch every drag, so that what is missed by a little is grabbed all the same and the
        view stays as it is; or let go of it, so that dragging the floor tilts the view.
        """
        if self._floor is not None:
            self._floor.remove()
            self._floor = None
        if not flat:
            return
        size = 6.0 * self.reach
        corners = np.array([[-size, -size], [size, -size], [size, size], [-size, size]])
        floor = self._floor = self._plate(
            "/catch", corners, (255, 255, 255), -0.006 * self.reach, opacity=0.0
        )

        @floor.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            self._drag(event, None)

    def _drag(self, event: viser.SceneNodeDragEvent[Any], hit: int | None) -> None:
        """Move what somebody has taken hold of."""
        if event.phase == "start":
            held = self.grab(on_floor(event, start=True), hit)
            if held is None:
                self._held.pop(event.client_id, None)
                return
            self._held[event.client_id] = held
        held = self._held.get(event.client_id)
        if held is None:
            return
        place = on_floor(event) + held.offset
        if held.obstacle is None:
            self._wanted[None] = place
            self._on_aim(place)
        elif held.obstacle < len(self._obstacles):
            self._carry(held.obstacle, place)
        if self._hint is not None:
            self._hint.remove()
            self._hint = None
        if event.phase == "end":
            self._held.pop(event.client_id, None)

    def _carry(self, obstacle: int, place: Array) -> None:
        self._wanted[obstacle] = place
        self._on_carry(obstacle, place)

    def grab(self, place: Array, hit: int | None = None) -> Held | None:
        """What is taken hold of at a place (2,) [m]: what was hit, or the nearest that is or lately was no
        farther than a little beside it.
        """
        if not self._memory:
            return None
        targets, obstacles = (np.array(each) for each in zip(*self._memory, strict=True))
        found: list[tuple[float, int | None, Array]] = []
        for index, (corners, radius) in enumerate(self._shapes):
            if hit is None or hit == index:
                away = min(geometry.distance(place, corners + each, radius) for each in obstacles[:, index])
                found.append((away, index, obstacles[-1, index]))
        if hit is None:
            away = float(np.linalg.norm(targets - place, axis=1).min()) - self._target_radius
            found.append((away, None, targets[-1]))
        away, obstacle, there = min(found, key=lambda each: each[0])
        if hit is None and away > GRAB * self.reach:
            return None
        return Held(obstacle, there - place)

    # ---------------------------------------------------------------------------------------------- frames

    def draw(self, state: Mapping[str, Any], ghost: Mapping[str, Any] | None = None) -> None:
        """Move everything to where it is in a state of the core; `ghost` is that of another arm."""
        scene = self._now(state)
        for each in scene.at(0, ["link", "force"]):
            match each:
                case Body(role="link", index=index):
                    lay(self._links[index], each, self._at("link") + 2e-4 * self.reach * (index % 2))
                case Arrow(index=index):
                    self._stretch(self._forces[index], each)
        self._shade(state["clearance"])
        for handle, halo, place in zip(self._obstacles, self._halos, scene.obstacles[0], strict=False):
            handle.position = (*place, self._at("obstacle"))
            halo.position = (*place, self._at("halo"))
        for handle, halo, given in zip(self._obstacles, self._halos, self._given, strict=True):
            rotation = _core.rotations(given, 2, [state["t"]])
            if rotation is not None:
                half = 0.5 * float(np.arctan2(rotation[0, 1, 0], rotation[0, 0, 0]))
                handle.wxyz = halo.wxyz = np.array([np.cos(half), 0.0, 0.0, np.sin(half)])
        self._target.position = (*scene.reference[0], self._at("target"))
        self._tip.position = (*scene.tip[0], self._at("tip"))
        self._memory.append((scene.reference[0], scene.obstacles[0]))
        self._draw_trail(scene.tip[0])
        self._draw_wanted(scene, state["status"] == "running")
        if self._hint is not None and len(scene.obstacles[0]):
            corners, radius = self._shapes[0]
            top = radius + float(corners[:, 1].max())
            x, y = scene.obstacles[0, 0]
            self._hint.position = (x, y + top + 0.01 * self.reach, self._at("hint"))
        if ghost is not None:
            for each in self._now(ghost).at(0, ["link"]):
                if isinstance(each, Body):
                    lay(self._ghost[each.index], each, self._at("ghost"))

    @property
    def waits(self) -> bool:
        """Whether something is not yet where it is wanted."""
        return bool(self._wanted)

    def show_ghost(self, visible: bool) -> None:
        """Whether the other arm is drawn."""
        for handle in self._ghost:
            handle.visible = visible

    def _now(self, state: Mapping[str, Any]) -> primitives.Scene:
        joints = np.asarray(self._arm.forward_kinematics(state["q"]))[None]
        size = joints.shape[-1]
        return dataclasses.replace(
            self._still,
            joints=joints,
            obstacles=state["obstacles"][None],
            tip=state["x"][None, :size],
            reference=state["x_ref"][None, :size],
            given=(state["points"][None], state["forces"][None]),
        )

    def _shade(self, clearance: Array) -> None:
        """Colour the links by their clearance, in shares of the influence distance."""
        width = self.influence or 0.1 * self.reach
        for i, handle in enumerate(self._links):
            share = float(np.clip(clearance[i] / width, 0.0, 1.0))
            shade = round(share * SHADES)
            if shade != self._shades[i]:
                self._shades[i] = shade
                share = shade / SHADES
                low, high, part = (HIT, NEAR, 2 * share) if share < 0.5 else (NEAR, FREE, 2 * share - 1)
                red, green, blue = (low + (high - low) * part).astype(int)
                handle.color = (int(red), int(green), int(blue))

    def _draw_trail(self, tip: Array) -> None:
        self._places.append(np.array([*tip, self._at("trail")]))
        places = np.array([self._places[0]] * (TRAIL - len(self._places)) + list(self._places))
        self._trail.points = np.stack([places[:-1], places[1:]], axis=1).astype(np.float32)

    def _draw_wanted(self, scene: primitives.Scene, running: bool) -> None:
        """A shadow where something is wanted and not yet, so that dragging shows at once, also in a pause."""
        for key, place in list(self._wanted.items()):
            there = scene.reference[0] if key is None else scene.obstacles[0, key]
            if np.linalg.norm(place - there) < ARRIVED * self.reach:
                self._forget(key)
            elif key in self._shadows:
                self._shadows[key].position = (*place, self._at("wanted"))
            else:
                core = (np.zeros((1, 2)), self._target_radius) if key is None else self._shapes[key]
                name = "target" if key is None else str(key)
                colour = TARGET if key is None else OBSTACLE
                shadow = self._plate(
                    f"/wanted-{name}", geometry.outline(*core), colour, self._at("wanted"), opacity=0.3
                )
                shadow.position = (*place, self._at("wanted"))
                self._shadows[key] = shadow
        if running and not self._held:  # a target beyond the reach stays where it can be
            self._forget(None)

    def _forget(self, key: int | None) -> None:
        self._wanted.pop(key, None)
        shadow = self._shadows.pop(key, None)
        if shadow is not None:
            shadow.remove()

    def _stretch(self, handle: viser.MeshHandle, arrow: Arrow) -> None:
        """Its length is the logarithm of the force, so that weak ones are seen."""
        size = float(np.linalg.norm(arrow.vector))
        visible = size > 0.02
        if handle.visible != visible:
            handle.visible = visible
        if visible:
            length = 0.07 * self.reach * np.log1p(size)
            handle.scale = (length, min(0.045 * self.reach, 0.6 * length), 1.0)
            handle.wxyz = turn(heading(arrow.vector))
            handle.position = (*arrow.tail, self._at("force"))

    # ----------------------------------------------------------------------------------------------- parts

    def _at(self, layer: str) -> float:
        return LAYERS[layer] * self.reach

    @property
    def _target_radius(self) -> float:
        return 0.028 * self.reach

    def _add_grid(self) -> None:
        reach = self.reach
        cell = 10.0 ** np.floor(np.log10(reach / 4))
        self._server.scene.add_grid(
            "/floor",
            width=8 * reach,
            height=8 * reach,
            plane="xy",
            cell_size=cell,
            section_size=5 * cell,
            cell_color=(236, 236, 238),
            section_color=(218, 218, 222),
            shadow_opacity=0.0,
            position=(0.0, 0.0, -0.004 * reach),
        )

    def _add_links(
        self, path: str, colour: Any, layer: str, opacity: float | None = None
    ) -> list[viser.MeshHandle]:
        """A plate for each link, with its joint on it."""
        links = []
        for each in self._still.at(0, ["link"]):
            if isinstance(each, Body):
                name = f"{path}/{each.index}"
                outline = geometry.outline(aligned(each.corners), each.radius)
                links.append(self._plate(name, outline, colour, self._at(layer), opacity))
                if opacity is None:
                    self._disc(f"{name}/pin", 0.45 * each.radius, (250, 250, 250), 1e-3 * self.reach)
        return links

    def _add_base(self) -> None:
        radius = float(self._still.radii[0])
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * radius
        height = self._at("link") - 0.001 * self.reach
        base = self._plate("/base", geometry.rounded(square, radius), OBSTACLE, height)
        base.position = (*self._still.joints[0, 0], height)

    def _add_target(self) -> viser.MeshHandle:
        radius = self._target_radius
        handle = self._disc("/target", radius, TARGET, self._at("target"), opacity=0.35)
        ring = geometry.rounded(np.zeros((1, 2)), radius)
        ends = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        cross = radius * np.array(
            [[[-1.5, 0], [-0.6, 0]], [[0.6, 0], [1.5, 0]], [[0, -1.5], [0, -0.6]], [[0, 0.6], [0, 1.5]]]
        )
        lines = geometry.in_space(np.vstack([ends, cross]))
        self._server.scene.add_line_segments(
            "/target/ring", lines, np.array(TARGET), thickness=0.005 * self.reach
        )

        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            self._drag(event, None)

        return handle

    def _add_trail(self) -> viser.LineSegmentsHandle:
        nothing = np.zeros((TRAIL - 1, 2, 3))
        trail = self._server.scene.add_line_segments("/trail", nothing, nothing, thickness=0.006 * self.reach)
        fading = np.linspace(1.0, 0.0, TRAIL - 1)[:, None]
        colours = (255 * fading + (1 - fading) * np.array(HALO)).astype(np.uint8)
        trail.colors = np.repeat(colours[:, None], 2, axis=1)
        return trail

    def _add_hint(self) -> viser.LabelHandle:
        name, place = ("/hint", (*self._still.tip[0], self._at("hint")))
        return self._server.scene.add_label(
            name, "drag me", position=place, anchor="bottom-center", font_screen_scale=1.15
        )

    def _add_halo(self, name: str, shape: tuple[Array, float]) -> viser.MeshHandle:
        corners, radius = shape
        outline = geometry.outline(corners, radius + max(self.influence, 1e-6))
        return self._plate(name, outline, HALO, self._at("halo"), opacity=0.12, visible=self.influence > 0.0)

    def _add_arrow(self, index: int) -> viser.MeshHandle:
        """An arrow of unit length along x, to be stretched and turned."""
        outline = np.array(
            [[0, -0.14], [0.72, -0.14], [0.72, -0.5], [1, 0], [0.72, 0.5], [0.72, 0.14], [0, 0.14]]
        )
        faces = np.array([[0, 1, 5], [0, 5, 6], [2, 3, 4]])
        return self._mesh(f"/force-{index}", outline, faces, FORCE, 0.0, None, False)

    def _disc(
        self, name: str, radius: float, colour: Colour, height: float, opacity: float | None = None
    ) -> viser.MeshHandle:
        return self._plate(name, geometry.rounded(np.zeros((1, 2)), radius), colour, height, opacity)

    def _plate(
        self,
        name: str,
        outline: Array,
        colour: Any,
        height: float,
        opacity: float | None = None,
        visible: bool = True,
    ) -> viser.MeshHandle:
        """A convex outline, filled."""
        around = np.arange(1, len(outline) - 1)
        faces = np.stack([np.zeros_like(around), around, around + 1], axis=1)
        return self._mesh(name, outline, faces, colour, height, opacity, visible)

    def _mesh(
        self,
        name: str,
        outline: Array,
        faces: NDArray[np.intp],
        colour: Any,
        height: float,
        opacity: float | None,
        visible: bool,
    ) -> viser.MeshHandle:
        return self._server.scene.add_mesh_simple(
            name,
            geometry.in_space(outline),
            faces,
            color=np.asarray(colour, dtype=np.uint8),
            opacity=opacity,
            side="double",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            position=(0.0, 0.0, height),
            visible=visible,
        )


def heading(vector: Array) -> float:
    """The direction of a vector of the plane [rad]."""
    return float(np.arctan2(vector[1], vector[0]))


def aligned(corners: Array) -> Array:
    """Corners as seen from the first, the second along x: what `lay` moves to its place."""
    seen = corners - corners[0]
    c, s = np.cos(-heading(seen[-1])), np.sin(-heading(seen[-1]))
    return np.asarray(seen @ np.array([[c, s], [-s, c]])) if len(corners) == 2 else seen


def lay(handle: viser.MeshHandle, body: Body, height: float) -> None:
    """Put a plate where a body with two corners is."""
    first, last = body.corners[0], body.corners[-1]
    handle.wxyz = turn(heading(last - first))
    handle.position = (*first, height)


def turn(angle: float) -> tuple[float, float, float, float]:
    """The quaternion of a turn in the plane [rad]."""
    return (float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2)))


def on_floor(event: viser.SceneNodeDragEvent[Any], start: bool = False) -> Array:
    """Where the ray through the pointer meets the plane z = 0, (2,) [m]."""
    camera = np.asarray(event.client.camera.position)
    through = np.asarray(event.start_position if start else event.end_position)
    along = through - camera
    share = -camera[2] / along[2] if along[2] else 1.0
    place: Array = (camera + share * along)[:2]
    return place


def view(
    box: tuple[float, float, float, float], aspect: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Where a camera stands, and what it looks at, that sees a box (left, right, bottom, top) [m] from
    above in a picture of this width over height.
    """
    left, right, bottom, top = box
    x, y = (left + right) / 2, (bottom + top) / 2
    height = max((top - bottom) / 2, (right - left) / 2 / aspect) / np.tan(FIELD_OF_VIEW / 2)
    return (x, y, float(height)), (x, y, 0.0)
