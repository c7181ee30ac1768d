"""The drawing: arm, obstacles, target, forces and trail in the plane, seen from above."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import viser
from numpy.typing import NDArray

from vffnull.plotting import geometry
from vffnull.scenario import Scenario

Array = NDArray[np.float64]
Drop = Callable[[Array], None]

FREE, NEAR, HIT = np.array([86, 110, 140]), np.array([230, 130, 30]), np.array([200, 20, 40])
"""Colours of a link that is out of influence, half way in, and in contact."""
OBSTACLE, HALO, TARGET, TIP, FORCE = (60, 64, 72), (213, 94, 0), (0, 158, 115), (20, 20, 24), (178, 24, 43)
LAYERS = {
    name: 0.004 * k for k, name in enumerate(("halo", "obstacle", "link", "target", "trail", "force", "tip"))
}
"""Heights [reaches], so that nothing is hidden by what it lies on."""
SHADES = 24
"""Colours of links are rounded to so many, so that they need not be sent in every frame."""
TRAIL = 150
"""Points of the tip's trail."""
FIELD_OF_VIEW = 0.25
"""So narrow that lines look parallel [rad]."""


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
    """

    def __init__(
        self,
        server: viser.ViserServer,
        scenario: Scenario,
        on_carry: Callable[[int, Array], None],
        on_aim: Drop,
    ) -> None:
        self._server, self._on_carry = server, on_carry
        self._lengths = np.asarray(scenario.arm.lengths)
        self.reach = float(self._lengths.sum())
        n = len(self._lengths)
        # A link of radius zero is drawn as a line that one can see.
        radii = np.maximum(scenario.arm.radius, 0.004 * self.reach)
        scene = server.scene
        scene.reset()
        scene.set_up_direction("+y")
        scene.configure_default_lights(False)
        scene.add_light_ambient("/light", intensity=2.6)
        scene.add_light_directional("/sun", intensity=0.8, position=(-4.0, 6.0, 12.0), cast_shadow=False)
        self._add_floor()
        self._joints, self._links = self._add_arm(radii)
        self._target = self._add_target(on_aim)
        self._tip = self._disc("/tip", 0.011 * self.reach, TIP, self._at("tip"))
        self._trail = scene.add_line_segments(
            "/trail", np.zeros((TRAIL - 1, 2, 3)), np.zeros((TRAIL - 1, 2, 3)), thickness=0.006 * self.reach
        )
        fading = np.linspace(1.0, 0.0, TRAIL - 1)[:, None]
        colours = (255 * fading + (1 - fading) * np.array(HALO)).astype(np.uint8)
        self._trail.colors = np.repeat(colours[:, None], 2, axis=1)
        self._places: deque[Array] = deque(maxlen=TRAIL)
        self._forces: list[viser.MeshHandle] = [self._add_arrow(i) for i in range(n)]
        self._shades = [-1] * n
        self._obstacles: list[viser.MeshHandle] = []
        self._halos: list[viser.MeshHandle] = []
        self._shapes: list[tuple[Array, float]] = []
        self._made = 0
        self.influence = 0.0
        for obstacle in scenario.to_dict().get("obstacles", []):
            self.add(obstacle)

    # ------------------------------------------------------------------------------------------- obstacles

    def add(self, obstacle: Mapping[str, Any]) -> None:
        """Draw one more obstacle."""
        self._made += 1
        shape = geometry.core(obstacle["shape"], obstacle.get("angle", 0.0))
        name = f"/obstacle-{self._made}"
        handle = self._plate(name, geometry.rounded(*shape), OBSTACLE, self._at("obstacle"))
        self._shapes.append(shape)
        self._obstacles.append(handle)
        self._halos.append(self._add_halo(f"{name}-halo", shape))
        grabbed = np.zeros(2)

        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            nonlocal grabbed
            place = on_floor(event)
            if event.phase == "start":
                grabbed = np.asarray(handle.position[:2]) - on_floor(event, start=True)
            if handle in self._obstacles:
                self._on_carry(self._obstacles.index(handle), place + grabbed)

    def remove(self, index: int) -> None:
        """Take an obstacle out of the drawing."""
        for handles in (self._obstacles, self._halos):
            handles.pop(index).remove()
        self._shapes.pop(index)

    def show_influence(self, influence: float) -> None:
        """Draw the halos as wide as the field reaches [m]; none at 0."""
        self.influence = influence
        for index, (handle, shape) in enumerate(zip(self._halos, self._shapes, strict=True)):
            name = handle.name
            handle.remove()
            self._halos[index] = self._add_halo(name, shape)

    # ---------------------------------------------------------------------------------------------- frames

    def draw(self, state: Mapping[str, Any]) -> None:
        """Move everything to where it is in a state of the core."""
        for frame, angle in zip(self._joints, state["q"], strict=True):
            frame.wxyz = turn(angle)
        self._paint(state["clearance"])
        for handle, halo, place in zip(self._obstacles, self._halos, state["obstacles"], strict=False):
            handle.position = (*place, self._at("obstacle"))
            halo.position = (*place, self._at("halo"))
        self._target.position = (*state["x_ref"][:2], self._at("target"))
        self._tip.position = (*state["x"][:2], self._at("tip"))
        self._draw_trail(state["x"][:2])
        self._draw_forces(state["points"], state["forces"])

    def forget_trail(self) -> None:
        """Begin a new trail."""
        self._places.clear()

    def _paint(self, clearance: Array) -> None:
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

    def _draw_forces(self, points: Array, forces: Array) -> None:
        """One arrow per link, its length the logarithm of the force, so that weak ones are seen."""
        for handle, point, force in zip(self._forces, points, forces, strict=True):
            size = float(np.hypot(*force))
            visible = size > 0.02
            if handle.visible != visible:
                handle.visible = visible
            if visible:
                length = 0.07 * self.reach * np.log1p(size)
                handle.scale = (length, min(0.045 * self.reach, 0.6 * length), 1.0)
                handle.wxyz = turn(float(np.arctan2(force[1], force[0])))
                handle.position = (*point, self._at("force"))

    # ----------------------------------------------------------------------------------------------- parts

    def _at(self, layer: str) -> float:
        return LAYERS[layer] * self.reach

    def _add_floor(self) -> None:
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

    def _add_arm(self, radii: Array) -> tuple[list[viser.FrameHandle], list[viser.MeshHandle]]:
        """Frames inside each other, so that a frame of the film is one angle per joint."""
        joints, links = [], []
        path, offset = "/arm", 0.0
        scene = self._server.scene
        scene.add_frame("/arm", show_axes=False, position=(0.0, 0.0, self._at("link")))
        base = geometry.rounded(
            np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * radii[0], radii[0]
        )
        self._plate("/base", base, OBSTACLE, self._at("link") - 0.001 * self.reach)
        for i, (length, radius) in enumerate(zip(self._lengths, radii, strict=True)):
            path = f"{path}/{i + 1}"
            joints.append(scene.add_frame(path, show_axes=False, position=(offset, 0.0, 0.0)))
            outline = geometry.capsule([0.0, 0.0], [length, 0.0], radius)
            height = 2e-4 * self.reach * (i % 2)
            links.append(self._plate(f"{path}/link", outline, (86, 110, 140), height))
            self._disc(f"{path}/pin", 0.45 * radius, (250, 250, 250), 1e-3 * self.reach)
            offset = length
        return joints, links

    def _add_target(self, on_aim: Drop) -> viser.MeshHandle:
        radius = 0.028 * self.reach
        handle = self._disc("/target", radius, TARGET, self._at("target"), opacity=0.35)
        ring = geometry.rounded(np.zeros((1, 2)), radius)
        ends = np.stack([ring, np.roll(ring, -1, axis=0)], axis=1)
        cross = radius * np.array(
            [[[-1.5, 0], [-0.6, 0]], [[0.6, 0], [1.5, 0]], [[0, -1.5], [0, -0.6]], [[0, 0.6], [0, 1.5]]]
        )
        lines = np.vstack([ends, cross])
        lines = np.concatenate([lines, np.zeros((*lines.shape[:2], 1))], axis=2)
        self._server.scene.add_line_segments(
            "/target/ring", lines, np.array(TARGET), thickness=0.005 * self.reach
        )

        @handle.on_drag
        async def _(event: viser.SceneNodeDragEvent[Any]) -> None:
            on_aim(on_floor(event))

        return handle

    def _add_halo(self, name: str, shape: tuple[Array, float]) -> viser.MeshHandle:
        corners, radius = shape
        outline = geometry.rounded(corners, radius + max(self.influence, 1e-6))
        return self._plate(name, outline, HALO, self._at("halo"), opacity=0.12, visible=self.influence > 0.0)

    def _add_arrow(self, index: int) -> viser.MeshHandle:
        """An arrow of unit length along x, to be stretched and turned."""
        outline = np.array(
            [[0, -0.14], [0.72, -0.14], [0.72, -0.5], [1, 0], [0.72, 0.5], [0.72, 0.14], [0, 0.14]]
        )
        faces = np.array([[0, 1, 5], [0, 5, 6], [2, 3, 4]])
        return self._mesh(f"/force-{index}", outline, faces, FORCE, 0.0, None, False)

    def _disc(
        self,
        name: str,
        radius: float,
        colour: tuple[int, int, int],
        height: float,
        opacity: float | None = None,
    ) -> viser.MeshHandle:
        return self._plate(name, geometry.rounded(np.zeros((1, 2)), radius), colour, height, opacity)

    def _plate(
        self,
        name: str,
        outline: Array,
        colour: tuple[int, int, int],
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
        colour: tuple[int, int, int],
        height: float,
        opacity: float | None,
        visible: bool,
    ) -> viser.MeshHandle:
        vertices = np.column_stack([outline, np.zeros(len(outline))])
        return self._server.scene.add_mesh_simple(
            name,
            vertices,
            faces,
            color=colour,
            opacity=opacity,
            side="double",
            flat_shading=True,
            cast_shadow=False,
            receive_shadow=False,
            position=(0.0, 0.0, height),
            visible=visible,
        )


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
