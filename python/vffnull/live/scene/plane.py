"""The drawing in the plane: flat plates in layers, seen from above, and a floor that catches drags."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
import viser

from vffnull.draw import geometry
from vffnull.live.scene.camera import MARGIN, Camera, seen_above
from vffnull.live.scene.hands import Grip, Held
from vffnull.live.scene.looks import (
    FORCE,
    OBSTACLE,
    PALE,
    TARGET,
    TIP,
    Array,
    Core,
    Quaternion,
    Which,
)
from vffnull.live.scene.meshes import Mesh, plate
from vffnull.live.scene.sensed import Sensed
from vffnull.live.scene.shared import Scene
from vffnull.model.scenario import Scenario

LAYERS = {
    name: 0.004 * k
    for k, name in enumerate(
        ("halo", "ghost", "wanted", "obstacle", "link", "target", "trail", "force", "tip", "hint")
    )
}
LAYERS["plan"] = LAYERS["ghost"] + 0.002
"""Heights [reaches], so that nothing is hidden by what it lies on."""
FIELD_OF_VIEW = 0.25
"""So narrow that lines look parallel [rad]."""
GRAB = 0.05
"""How far from its surface something may be grabbed [reaches]."""
BESIDE = 0.01
"""How far from its surface a link may be taken hold of [reaches]."""
MEMORY = 30
"""Frames: where something was so lately is where it may still be seen, and grabbed."""
FLAT = "2-D view"
TILTED = "Tilt the view"


class PlaneScene(Scene):
    """A scenario in the plane; see `Scene`."""

    views: ClassVar[Mapping[str, str]] = {
        FLAT: "Drag the dark obstacles and the green target; dragging a link pulls at it with a spring. The "
        "wheel zooms, the right button moves the view.",
        TILTED: "Drag the dark obstacles and the green target; dragging a link pulls at it, dragging the "
        "floor tilts the view.",
    }
    up = "+y"
    FREE = np.array([86, 110, 140])
    HALO_OPACITY = 0.12
    TRAIL_STEP = 0.0

    def __init__(self, *arguments: Any, **options: Any) -> None:
        self._floor: viser.MeshHandle | None = None
        self._memory: deque[tuple[Array, Array]] = deque(maxlen=MEMORY)
        self._joints: Array = np.zeros((0, 2))
        super().__init__(*arguments, **options)
        self._sensed = Sensed(self._server, self.reach)

    def camera(self, box: tuple[float, ...], aspect: float) -> Camera:
        """From above."""
        position, look_at = view(box, aspect)
        return Camera(position, look_at, (0.0, 1.0, 0.0), FIELD_OF_VIEW, 20 * position[2])

    def spare(self, count: int) -> dict[str, Any]:
        """A disc above the arm."""
        reach = self.reach
        place = [reach * (0.15 + 0.14 * (count % 6)), reach * (0.62 - 0.07 * (count // 6 % 4))]
        return {"shape": {"kind": "circle", "radius": 0.03 * reach}, "position": place}

    # ------------------------------------------------------------------------------------------------ drag

    def look(self, view: str) -> None:
        """Let the floor catch every drag, so that what is missed by a little is grabbed all the same and the
        view stays as it is; or let go of it, so that dragging the floor tilts the view.
        """
        if self._floor is not None:
            self._floor.remove()
            self._floor = None
        if view != FLAT:
            return
        size = 6.0 * self.reach
        corners = np.array([[-size, -size], [size, -size], [size, size], [-size, size]])
        below = (0.0, 0.0, -0.006 * self.reach)
        floor = self._floor = self._mesh("/catch", plate(corners), (255, 255, 255), below, opacity=0.0)
        floor.on_drag(self._dragged_target)

    def _grasp(
        self, event: viser.SceneNodeDragEvent[Any], hit: int | None, link: int | None
    ) -> Held | Grip | None:
        return self.grab(on_floor(event, start=True), hit)

    def _pulled_to(self, event: viser.SceneNodeDragEvent[Any], start: Array) -> Array:
        return on_floor(event)

    def _frame(self, link: int) -> tuple[Array, Array]:
        first, last = self._joints[link : link + 2]
        x, y = (last - first) / np.linalg.norm(last - first)
        return first, np.array([[x, -y], [y, x]])

    def _pointed(self, event: viser.SceneNodeDragEvent[Any]) -> Array:
        return on_floor(event)

    def _changed(self) -> None:
        self._memory.clear()

    def grab(self, place: Array, hit: int | None = None) -> Held | Grip | None:
        """What is taken hold of at a place (2,) [m]: what was hit, or the nearest that is or lately was no
        farther than a little beside it. A link is held where nothing else is under the pointer.
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
        if hit is None and away > 0.0:
            ends = np.stack([self._joints[:-1], self._joints[1:]], axis=1)
            beside = [geometry.distance(place, each, self._thickness(i)) for i, each in enumerate(ends)]
            link = int(np.argmin(beside))
            if beside[link] < min(away, BESIDE * self.reach):
                return Grip(link, place)
        if hit is None and away > GRAB * self.reach:
            return None
        return Held(obstacle, there - place)

    # ---------------------------------------------------------------------------------------------- frames

    def draw(self, state: Mapping[str, Any], ghost: Mapping[str, Any] | None = None) -> None:
        """See `Scene.draw`."""
        super().draw(state, ghost)
        self._memory.append((state["x_ref"][:2], state["obstacles"]))

    def _place_arm(self, q: Array, which: Which) -> None:
        joints = self._arm.forward_kinematics(q)
        if which == "arm":
            self._joints = joints
        arms = {
            "arm": [link for (link,) in self._arms.links],
            "ghost": self._arms.ghost,
            "plan": self._arms.plan,
        }
        for i, link in enumerate(arms[which]):
            lay(link, joints[i], joints[i + 1], self._height(i, which))

    def _toward(self, vector: Array) -> Quaternion:
        return turn(heading(vector))

    # ----------------------------------------------------------------------------------------------- parts

    def _reach_of(self, scenario: Scenario) -> float:
        return float(np.sum(scenario.arm.lengths))

    def _at(self, layer: str) -> float:
        return LAYERS[layer] * self.reach

    def _height(self, link: int, which: Which) -> float:
        return self._at("link") + 2e-4 * self.reach * (link % 2) if which == "arm" else self._at(which)

    def _place_of_legend(self) -> tuple[Array, Array]:
        base, reach = self._still.joints[0, 0], self.reach
        return (
            self._spot(base + np.array([0.06, -0.1]) * reach, "force"),
            self._spot(base + np.array([0.18, -0.15]) * reach, "hint"),
        )

    def _spot(self, place: Array, layer: str) -> Array:
        return np.array([*place, self._at(layer)])

    def _draw_more(self, state: Mapping[str, Any]) -> None:
        places = [self._spot(place, "obstacle") for place in state["sensed"]]
        self._sensed.draw(np.array(places).reshape(-1, 3))

    def _core_of(self, obstacle: Mapping[str, Any]) -> Core:
        return geometry.core(obstacle["shape"], obstacle.get("angle", 0.0))

    def _mesh_of(self, core: Core) -> Mesh:
        return plate(geometry.outline(*core))

    def _halo_core(self, index: int) -> Core:
        corners, radius = self._shapes[index]
        return corners, radius + max(self.influence, 1e-6)

    def _add_surroundings(self, scenario: Scenario) -> None:
        scene, reach = self._server.scene, self.reach
        scene.add_light_ambient("/light", intensity=2.6)
        scene.add_light_directional("/sun", intensity=0.8, position=(-4.0, 6.0, 12.0), cast_shadow=False)
        cell = 10.0 ** np.floor(np.log10(reach / 4))
        scene.add_grid(
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
        radius = self._thickness(0)
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * radius
        height = self._at("link") - 0.001 * reach
        base = (*self._still.joints[0, 0], height)
        self._mesh("/base", plate(geometry.rounded(square, radius)), OBSTACLE, base)

    def _thickness(self, link: int) -> float:
        """A link of radius zero is drawn as a line that one can see."""
        return max(float(self._still.radii[link]), 0.004 * self.reach)

    def _add_arm(self, which: Which) -> list[list[viser.MeshHandle]]:
        """A plate for each link, with its joint on it."""
        links: list[list[viser.MeshHandle]] = []
        joints = self._still.joints[0]
        for i, length in enumerate(np.linalg.norm(np.diff(joints, axis=0), axis=1)):
            name, radius = f"/{which}/{i}", self._thickness(i)
            ends = np.array([[0.0, 0.0], [length, 0.0]])
            mesh = plate(geometry.outline(ends, radius))
            place = (0.0, 0.0, self._at("link" if which == "arm" else which))
            opacity = None if which == "arm" else 0.25
            links.append([self._mesh(name, mesh, PALE.get(which, self.FREE), place, opacity=opacity)])
            if which == "arm":
                self._disc(f"{name}/pin", 0.45 * radius, (250, 250, 250), 1e-3 * self.reach)
        return links

    def _add_tip(self) -> viser.MeshHandle:
        return self._disc("/tip", 0.011 * self.reach, TIP, self._at("tip"))

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
        return handle

    def _add_arrow(self, name: str, colour: Any = FORCE) -> viser.MeshHandle:
        outline = np.array(
            [[0, -0.14], [0.72, -0.14], [0.72, -0.5], [1, 0], [0.72, 0.5], [0.72, 0.14], [0, 0.14]]
        )
        faces = np.array([[0, 1, 5], [0, 5, 6], [2, 3, 4]])
        mesh = Mesh(geometry.in_space(outline), faces, flat=True, side="double")
        return self._mesh(name, mesh, colour, visible=False)

    def _disc(
        self, name: str, radius: float, colour: Any, height: float, opacity: float | None = None
    ) -> viser.MeshHandle:
        mesh = plate(geometry.rounded(np.zeros((1, 2)), radius))
        return self._mesh(name, mesh, colour, (0.0, 0.0, height), opacity=opacity)


def heading(vector: Array) -> float:
    """The direction of a vector of the plane [rad]."""
    return float(np.arctan2(vector[1], vector[0]))


def lay(handle: viser.MeshHandle, first: Array, last: Array, height: float) -> None:
    """Put a plate that lies along x where a body with these two ends is."""
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
    box: tuple[float, ...], aspect: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Where a camera stands, and what it looks at, that sees a box (left, right, bottom, top) [m] from
    above in what is free of a picture of this width over height.
    """
    left, right, bottom, top = box
    x, y = (left + right) / 2, (bottom + top) / 2
    slope, free = MARGIN * np.tan(FIELD_OF_VIEW / 2), (1.0 + seen_above(aspect)) / 2
    height = float(max((top - bottom) / 2 / free, (right - left) / 2 / aspect) / slope)
    y -= (1.0 - free) * slope * height
    return (x, y, height), (x, y, 0.0)
