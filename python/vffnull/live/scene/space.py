"""The drawing in space: bodies with light and shadow, and what is dragged along the picture or by a gizmo."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import viser

from vffnull._core import distances, matrices, quaternions
from vffnull.draw import colours, geometry
from vffnull.draw.shapes import pushed_links
from vffnull.live.scene.camera import Camera, framing, steer
from vffnull.live.scene.cup import LEVEL, Cup, carries, stays_level, upright_in
from vffnull.live.scene.hands import Grip, Held
from vffnull.live.scene.looks import (
    FAINT,
    FORCE,
    PALE,
    STEP,
    TARGET,
    TIP,
    Array,
    Core,
    Quaternion,
    Which,
)
from vffnull.live.scene.meshes import Mesh, solid, turned
from vffnull.live.scene.sensed import Sensed
from vffnull.live.scene.shared import Scene
from vffnull.model.arm import frame
from vffnull.model.scenario import Scenario
from vffnull.model.settings import setting
from vffnull.model.shape import core_in_space

VIEWS = {
    "Corner": (0.62, -0.68, 0.38),
    "Front": (1.0, 0.0, 0.16),
    "Side": (0.0, -1.0, 0.16),
    "Top": (0.0, -0.02, 1.0),
}
"""Where from the arm is seen."""
FOLLOW = "Follow"
HINT = (
    "Drag the dark obstacles and the green ring of the target; a click shows arrows that move them along "
    "one axis, and arcs that turn them. Dragging a link pulls at it with a spring. Dragging elsewhere turns "
    "the view, the right button moves it, the wheel zooms."
)
ROOM = 0.35
"""How far around the base there is room in the picture, so that the arm may give way [reaches]."""
LATE = 1.6
"""From where on an obstacle is out of sight [reaches]; it is brought back to where it is within it."""
BESIDE = 0.35
"""How far beside the arm the pointer has no business with it [reaches]."""


class SpaceScene(Scene):
    """A scenario in space; see `Scene`."""

    views: ClassVar[Mapping[str, str]] = dict.fromkeys((*VIEWS, FOLLOW), HINT)
    up = "+z"
    FREE = np.array(colours.FREE)
    HALO_OPACITY = 0.06
    TRAIL_STEP = 4e-3

    def __init__(
        self, server: viser.ViserServer, scenario: Scenario, *arguments: Any, **options: Any
    ) -> None:
        self._geometry = scenario.arm
        document = scenario.to_dict()
        self._start = np.asarray(document["q0"], dtype=float)
        self._pushed = pushed_links(document, self._geometry)
        self._task = setting(document, "controller.task")
        self._view = ""
        self._gizmo: viser.TransformControlsHandle | None = None
        self._nodes: dict[Which, list[viser.FrameHandle]] = {}
        self._hits: dict[int, int | None] = {}
        self._q = self._start
        self._gripped: int | None = None
        self._offset = np.zeros(3)
        self._cup: Cup | None = None
        self._followed: Array | None = None
        super().__init__(server, scenario, *arguments, **options)
        self._add_frames(document)
        self._lines = server.scene.add_line_segments(
            "/distances",
            np.zeros((self._arm.n, 2, 3)),
            np.array((120, 120, 126)),
            thickness=0.003 * self.reach,
        )
        self._distance = server.scene.add_label(
            "/distance", "", anchor="bottom-center", font_screen_scale=0.9, visible=False
        )
        self._told = np.inf
        self._sensed = Sensed(server, self.reach)

    # --------------------------------------------------------------------------------------------- cameras

    def camera(self, box: tuple[float, ...], aspect: float) -> Camera:
        """From where the view says; there is room around the base, so that the arm may give way."""
        low, high = np.array(box[::2]), np.array(box[1::2])
        base, room = self._still.joints[0, 0, :2], ROOM * self.reach
        low[:2], high[:2] = np.minimum(low[:2], base - room), np.maximum(high[:2], base + room)
        low[2] = max(low[2], self._floor)
        view = self._view if self._view in VIEWS else "Corner"
        x, y, z = VIEWS[view]
        turned = view == "Corner" and self._still.next_corner
        return framing(low, high, (-y, x, z) if turned else (x, y, z), aspect)

    def look(self, view: str) -> None:
        """See `Scene.look`."""
        self._view, self._followed = view, None

    def follow(self, clients: Iterable[viser.ClientHandle]) -> None:
        """Move the cameras as the hand moves."""
        if self._view != FOLLOW:
            return
        tip = np.array(self._tip.position)  # viser writes into its own
        if self._followed is None:
            self._followed = tip
        moved = tip - self._followed

        def go_along(camera: viser.CameraHandle) -> None:
            camera.position = camera.position + moved

        if np.linalg.norm(moved) > 2e-3 * self.reach:
            self._followed = tip
            for client in clients:
                steer(client, go_along)

    # ------------------------------------------------------------------------------------------------ drag

    def _grasp(
        self, event: viser.SceneNodeDragEvent[Any], hit: int | None, link: int | None
    ) -> Held | Grip | None:
        if link is not None:
            return Grip(link, np.asarray(event.start_position, dtype=float))
        self._hits[event.client_id] = hit
        return Held(hit, self._place_of(hit) - np.asarray(event.start_position))

    def _pointed(self, event: viser.SceneNodeDragEvent[Any]) -> Array:
        """Along the picture; an obstacle comes to the depth of the arm where the pointer is over it, so that
        it meets the arm where it is seen to do so, from wherever one looks.
        """
        eye, end = np.asarray(event.client.camera.position), np.asarray(event.end_position)
        if self._hits.get(event.client_id) is None:
            return end
        joints = self._arm.forward_kinematics(self._q)
        share = np.linspace(0.0, 1.0, 9)[:, None, None]
        places = ((1.0 - share) * joints[:-1] + share * joints[1:]).reshape(-1, 3)
        ray = end - eye
        depths = (places - eye) @ ray / (ray @ ray)
        beside = np.linalg.norm(places - eye - depths[:, None] * ray, axis=1)
        nearest = int(np.argmin(beside))
        over = max(0.0, 1.0 - float(beside[nearest]) / (BESIDE * self.reach))
        depth = 1.0 + over * over * (3.0 - 2.0 * over) * (float(depths[nearest]) - 1.0)
        return np.asarray(eye + depth * ray)

    def _pulled_to(self, event: viser.SceneNodeDragEvent[Any], start: Array) -> Array:
        """Across the line of sight, as deep in the picture as the link was."""
        eye = np.asarray(event.client.camera.position)
        sight, ray = start - eye, np.asarray(event.end_position) - eye
        return np.asarray(eye + ray * (sight @ sight) / (ray @ sight))

    def _frame(self, link: int) -> tuple[Array, Array]:
        pose = self._arm.link_poses(self._q)[link]
        return pose[:3, 3], pose[:3, :3]

    def _place_of(self, obstacle: int | None) -> Array:
        """Where an obstacle, or the target, is seen."""
        handle = self._target if obstacle is None else self._obstacles[obstacle]
        return np.asarray(handle.position)

    def _clicked(self, obstacle: int, event: viser.SceneNodePointerEvent[Any]) -> None:
        """It waits where it is seen, and gets a gizmo; another click takes the gizmo away."""
        super()._clicked(obstacle, event)
        self._toggle(obstacle, self._hit(obstacle, event) if self._endless(obstacle) else None)

    def _hit(self, obstacle: int, event: viser.SceneNodePointerEvent[Any]) -> Array:
        """Where the surface of a half-space was clicked, relative to its position."""
        start, along = np.asarray(event.ray_origin), np.asarray(event.ray_direction)
        place, normal = self._place_of(obstacle), self._normal(obstacle)
        down = float(along @ normal)
        away = float((place - start) @ normal) / down if down else 0.0
        return np.asarray(start + away * along - place)

    def _toggle(self, obstacle: int | None, offset: Array | None = None) -> None:
        """Give an obstacle, or the target, the gizmo, or take it away from there."""
        if self._gizmo is not None and self._gripped == obstacle:
            self.let_go()
        else:
            self.grip(obstacle, np.zeros(3) if offset is None else offset)

    def let_go(self) -> None:
        """Show no gizmo."""
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None

    def grip(self, obstacle: int | None, offset: Array) -> None:
        """Show a gizmo at an obstacle, or at the target, so far from its position (3,) [m]."""
        self.let_go()
        self._gripped, self._offset = obstacle, offset
        gizmo = self._gizmo = self._server.scene.add_transform_controls(
            "/gizmo",
            scale=0.3 * self.reach,
            line_width=3.5,
            disable_rotations=not self._turnable(obstacle),
            depth_test=False,
            opacity=0.85,
            position=self._place_of(obstacle) + offset,
            wxyz=self._turned(obstacle),
        )
        place, turn = np.array(gizmo.position), np.array(gizmo.wxyz)  # viser writes into its own

        @gizmo.on_update
        async def _(event: viser.TransformControlsEvent) -> None:
            nonlocal place, turn
            if self._gizmo is not gizmo:
                return
            before, place = place, np.array(gizmo.position)
            if np.abs(place - before).max() > STEP:
                self._move(self._gripped, place - self._offset)
            before, turn = turn, np.array(gizmo.wxyz)
            if np.abs(turn - before).max() > STEP:
                self._on_turn(self._gripped, self._orientation(self._gripped, turn))

    def _turnable(self, obstacle: int | None) -> bool:
        """Whether it makes a difference how it is turned."""
        if obstacle is None:
            return bool(self._task != "position")
        return not self._endless(obstacle) and self._documents[obstacle]["shape"]["kind"] != "sphere"

    def _turned(self, obstacle: int | None) -> Array:
        """How an obstacle, or the target, is turned in the picture (4,)."""
        handle = self._wanted_frame if obstacle is None else self._obstacles[obstacle]
        return np.asarray(handle.wxyz)

    def _orientation(self, obstacle: int | None, turn: Array) -> Array:
        """The orientation (4,) of what is turned so in the picture, where obstacles begin as described."""
        if obstacle is None:
            return turn
        given = self._documents[obstacle].get("orientation", (1.0, 0.0, 0.0, 0.0))
        return np.asarray(quaternions(matrices(turn) @ matrices(given)))

    def _move(self, obstacle: int | None, place: Array) -> None:
        super()._move(obstacle, place)
        if self._gizmo is not None and self._gripped == obstacle:
            self._gizmo.position = place + self._offset

    def _changed(self) -> None:
        self.let_go()

    def strays(self, state: Mapping[str, Any]) -> Iterable[tuple[int, Array]]:
        """See `Scene.strays`."""
        base = self._still.joints[0, 0]
        for index, place in enumerate(state["obstacles"]):
            away = float(np.linalg.norm(place - base))
            if self._endless(index) or self._is_cloud(index):
                continue
            if away > LATE * self.reach and index not in self._wanted:
                yield index, base + 0.8 * self.reach / away * (place - base)

    def spare(self, count: int) -> dict[str, Any]:
        """A ball beside the arm."""
        reach = self.reach
        side = -1.0 if count % 2 else 1.0
        base = self._still.joints[0, 0]
        place = base + reach * np.array(
            [0.1 + 0.2 * (count // 2 % 4), 0.65 * side, 0.45 + 0.2 * (count // 8 % 3)]
        )
        return {"shape": {"kind": "sphere", "radius": 0.09 * reach}, "position": place.tolist()}

    # ---------------------------------------------------------------------------------------------- frames

    def _place_arm(self, q: Array, which: Which) -> None:
        if which == "arm":
            self._q = q
        poses = self._arm.link_poses(q)
        turns = quaternions(poses[:, :3, :3])
        for node, pose, wxyz in zip(self._nodes[which], poses, turns, strict=True):
            put(node, pose[:3, 3], wxyz)

    def _tails(self, state: Mapping[str, Any]) -> Array:
        """Beyond the links, where the lines of the forces leave them."""
        return self._outside(state["points"], state["forces"], range(self._arm.n), state["q"])

    def _pushed_places(self, state: Mapping[str, Any]) -> Array:
        return self._outside(state["wrench_points"], -state["wrench_forces"], self._pushed, state["q"])

    def _outside(self, points: Array, forces: Array, links: Sequence[int], q: Array) -> Array:
        tails, poses = np.array(points), self._arm.link_poses(q)
        for k, (force, i) in enumerate(zip(forces, links, strict=True)):
            size, pose = float(np.linalg.norm(force)), poses[i]
            if size > FAINT:
                start, along = (tails[k] - pose[:3, 3]) @ pose[:3, :3], force / size @ pose[:3, :3]
                ways = [
                    geometry.way_out(corners[None], radius, start[None], along[None])[0]
                    for corners, radius in self._own[i]
                ]
                tails[k] += max(0.0, *ways) * force / size
        return tails

    def _draw_more(self, state: Mapping[str, Any]) -> None:
        hand = self._geometry.tip_poses(state["q"])
        wxyz = quaternions(hand[:3, :3])
        put(self._hand, hand[:3, 3], wxyz)
        if len(state["x_ref"]) > 3:
            put(self._wanted_frame, state["x_ref"][:3], state["x_ref"][3:])
        if self._cup is not None:
            self._cup.follow(hand[:3, :3])
        self._draw_distances(state)
        self._sensed.draw(state["sensed"])

    def _draw_distances(self, state: Mapping[str, Any]) -> None:
        """A line from the nearest point of each link that is within influence, and of the nearest of all.

        Not to clouds of points, which are too many to be measured for every picture.
        """
        places = [
            self.standing(index, place, state["turns"][index])
            for index, place in enumerate(state["obstacles"][: len(self._documents)])
            if not self._is_cloud(index)
        ]
        ends = np.zeros((self._arm.n, 2, 3))
        nearest = np.inf
        found = distances(self._arm, state["q"], state["dq"], places)
        if len(found.distance):
            least = int(np.argmin(found.distance))
            nearest = float(found.distance[least])
            for link in range(self._arm.n):
                own = np.flatnonzero(found.link == link)
                if not len(own):
                    continue
                row = int(own[np.argmin(found.distance[own])])
                away = float(found.distance[row])
                if 0.0 < away and (away < self.influence or row == least):
                    witness = found.witness[row]
                    ends[link] = witness, witness + away * found.normal[row]
            self._tell(nearest, ends[int(found.link[least])].mean(axis=0))
        elif self._distance.visible:
            self._distance.visible = False
        if np.abs(ends - self._lines.points).max() > STEP:
            self._lines.points = ends.astype(np.float32)

    def standing(self, index: int, place: Array, turn: Array) -> dict[str, Any]:
        """See `Scene.standing`."""
        document = super().standing(index, place, turn)
        at_rest = matrices(document.get("orientation", (1.0, 0.0, 0.0, 0.0)))
        document["orientation"] = quaternions(turn @ at_rest).tolist()
        return document

    def _tell(self, nearest: float, place: Array) -> None:
        """The distance as a number."""
        shown = 0.0 < nearest < max(1.5 * self.influence, 0.3 * self.reach)
        if self._distance.visible != shown:
            self._distance.visible = shown
        if shown:
            put(self._distance, place)
            if abs(nearest - self._told) > 5e-4:
                self._told = nearest
                self._distance.text = f"{1e3 * nearest:.0f} mm"

    def readings(self) -> Mapping[str, float]:
        """See `Scene.readings`; the tilt of the cup [rad] and the share that it has lost, if there is one."""
        if self._cup is None:
            return super().readings()
        return {**super().readings(), "tilt": self._cup.liquid.tilt, "spilt": self._cup.liquid.spilt}

    # ----------------------------------------------------------------------------------------------- parts

    def _reach_of(self, scenario: Scenario) -> float:
        """As its maker says, else as far as the joints are apart, which is a little more than it reaches."""
        given = scenario.arm.to_dict().get("reach")
        joints = scenario.arm.forward_kinematics(scenario.to_dict()["q0"])
        return float(given or 0.7 * np.linalg.norm(np.diff(joints, axis=0), axis=1).sum())

    def _place_of_legend(self) -> tuple[Array, Array]:
        base, reach = self._still.joints[0, 0], self.reach
        x, y, z = base[0] + 0.1 * reach, base[1] - 0.32 * reach, self._floor + 0.02 * reach
        return np.array([x, y, z]), np.array([x + 0.12 * reach, y - 0.08 * reach, z])

    def _spot(self, place: Array, layer: str) -> Array:
        return np.asarray(place, dtype=float)

    def _core_of(self, obstacle: Mapping[str, Any]) -> Core:
        middle = self._still.joints[0, 0] - np.asarray(obstacle.get("position", np.zeros(3)), dtype=float)
        return core_in_space(obstacle["shape"], obstacle.get("orientation"), middle, 1.6 * self.reach)

    def _mesh_of(self, core: Core) -> Mesh:
        return solid(*core)

    def _halo_core(self, index: int) -> Core:
        corners, radius = self._shapes[index]
        if self._is_cloud(index):  # has none: a ball that is not shown stands for it
            return np.zeros((1, 3)), 1e-6
        if self._endless(index):
            return corners + self.influence * self._normal(index), radius
        return corners, radius + max(self.influence, 1e-6)

    def _normal(self, obstacle: int) -> Array:
        """The direction out of a half-space."""
        document = self._documents[obstacle]
        turn = matrices(document.get("orientation", (1.0, 0.0, 0.0, 0.0)))
        return np.asarray(turn @ np.asarray(document["shape"]["normal"], dtype=float))

    def _add_surroundings(self, scenario: Scenario) -> None:
        scene, reach = self._server.scene, self.reach
        scene.add_light_ambient("/light", intensity=2.2)
        scene.add_light_directional(
            "/sun", intensity=1.9, position=(1.2, -1.6, 3.0), cast_shadow=self._shadowed
        )
        scene.add_light_directional("/sky", intensity=0.5, position=(-2.0, 2.0, 1.0), cast_shadow=False)
        self._floor = self._floor_of(scenario)
        cell = 10.0 ** np.floor(np.log10(reach))
        scene.add_grid(
            "/floor",
            width=6 * reach,
            height=6 * reach,
            plane="xy",
            cell_size=cell,
            section_size=5 * cell,
            cell_color=(226, 228, 232),
            section_color=(204, 208, 214),
            shadow_opacity=0.2,
            position=(0.0, 0.0, self._floor + 0.002 * reach),
        )
        base = [solid(part.corners[0], part.radius) for part in self._still.parts if part.index < 0]
        if self._dress is not None:
            mount = frame(scenario.to_dict()["arm"].get("mount", {}))
            looks = self._looks(self._geometry.to_dict()["base"])
            base = [replace(each, vertices=each.vertices @ mount[:3, :3].T + mount[:3, 3]) for each in looks]
        for i, mesh in enumerate(base):
            self._mesh(f"/base/{i}", mesh, (120, 124, 132), casts=True)

    def _floor_of(self, scenario: Scenario) -> float:
        """The height of what the arm stands on [m]: of a table, else of its base; a little below an arm that
        hangs.
        """
        document = scenario.to_dict()
        tables = [
            float(each.get("position", (0.0, 0.0, 0.0))[2])
            for each in document.get("obstacles", [])
            if each["shape"]["kind"] == "half_space" and each["shape"]["normal"][2] > 1.0 - LEVEL
        ]
        base = float(frame(document["arm"].get("mount", {}))[2, 3])
        if self._still.foot < base:
            return max(tables, default=self._still.foot)
        lowest = float(self._still.joints[0, :, 2].min())
        return max(tables, default=base if lowest > base - 0.1 * self.reach else lowest - 0.3 * self.reach)

    def _add_arm(self, which: Which) -> list[list[viser.MeshHandle]]:
        """The parts of each link in a frame of its own: what is sent of an arm is where these frames are.

        Other arms are a little thinner, so that they are not seen where they are the same.
        """
        thin = 0.8 if self._dress is None else 0.45  # a robot is thinner than what is measured of it
        pale = which != "arm"
        collision = self._geometry.to_dict().get("collision", ())
        nodes, links = [], []
        for i in range(len(self._own)):
            name = f"/{which}/{i}"
            nodes.append(self._server.scene.add_frame(name, show_axes=False))
            bodies = [
                solid(*geometry.slimmer(corners, radius, thin if pale else 1.0))
                for corners, radius in self._own[i]
            ]
            if self._dress is not None and not pale:
                link = self._geometry.link_names[i]
                there = [each for each in collision if each["link"] == link]
                carried = [
                    body for body, each in zip(bodies, there, strict=True) if each.get("carried", False)
                ]
                bodies = [*self._looks(link), *carried]
            links.append(
                [
                    self._mesh(
                        f"{name}/{k}",
                        mesh,
                        PALE.get(which, self.FREE),
                        opacity=0.28 if pale else None,
                        casts=not pale,
                    )
                    for k, mesh in enumerate(bodies)
                ]
            )
        self._nodes[which] = nodes
        return links

    @cached_property
    def _own(self) -> list[list[Core]]:
        """What is measured of every link, in its frame."""
        poses = self._geometry.link_poses(self._start)
        return [
            [
                ((part.corners[0] - pose[:3, 3]) @ pose[:3, :3], part.radius)
                for part in self._still.parts
                if part.index == i
            ]
            for i, pose in enumerate(poses)
        ]

    def _looks(self, link: str) -> list[Mesh]:
        """The surfaces of a link; of what has no triangles the hull."""
        return [
            Mesh(each.points, each.triangles)
            if len(each.triangles)
            else solid(each.points, float(each.radii.max()))
            for each in (self._dress or {}).get(link, ())
        ]

    def _add_tip(self) -> viser.MeshHandle:
        return self._mesh("/tip", solid(np.zeros((1, 3)), 0.008 * self.reach), TIP)

    def _add_target(self) -> viser.MeshHandle:
        """A ring around the hand, in a ball that is not seen and can be taken hold of anywhere."""
        radius = 3.2 * self._target_radius
        handle = self._mesh("/target", solid(np.zeros((1, 3)), radius), TARGET, opacity=0.0)
        angles = np.linspace(0.0, 2 * np.pi, 13)
        tube = np.stack([1.0 + 0.08 * np.cos(angles), 0.08 * np.sin(angles)], axis=1)
        self._mesh("/target/ring", turned(radius * tube, 48), TARGET)

        @handle.on_click
        async def _(event: viser.SceneNodePointerEvent[Any]) -> None:
            self._toggle(None)

        return handle

    def _add_arrow(self, name: str, colour: Any = FORCE) -> viser.MeshHandle:
        shaft, head = 0.1, 0.36
        profile = np.array([[0.0, 0.0], [shaft, 0.0], [shaft, 0.6], [head, 0.6], [0.0, 1.0]])
        made = turned(profile, 16, flat=True)
        along = made.vertices[:, [2, 0, 1]]  # a cyclic exchange: what was up is along x
        return self._mesh(name, Mesh(along, made.faces, flat=True), colour, visible=False)

    def _add_frames(self, document: Mapping[str, Any]) -> None:
        """The hand's frame, the reference's thinner and longer one, and the cup."""
        scene, size = self._server.scene, 0.12 * self.reach
        turns = self._task != "position"
        self._hand = scene.add_frame(
            "/hand", show_axes=turns, axes_length=size, axes_radius=0.035 * size, origin_radius=0.05 * size
        )
        self._wanted_frame = scene.add_frame(
            "/reference",
            show_axes=turns,
            axes_length=1.5 * size,
            axes_radius=0.014 * size,
            origin_radius=0.02 * size,
        )
        upright = upright_in(self._geometry.tip_poses(self._start)[:3, :3])
        level = stays_level(document["reference"]) and (self._task == "pose" or carries(upright))
        if turns and level and "cup" in document.get("description", "").split():
            self._cup = Cup(self._server, "/hand/cup", upright, self.reach / 0.855)

    def _toward(self, vector: Array) -> Quaternion:
        x = vector / np.linalg.norm(vector)
        w = float(np.sqrt(max(0.0, (1.0 + x[0]) / 2)))
        if w < 1e-6:
            return (0.0, 0.0, 0.0, 1.0)
        return (w, 0.0, float(-x[2] / (2 * w)), float(x[1] / (2 * w)))


def put(handle: viser.SceneNodeHandle, place: Array, wxyz: Array | None = None) -> None:
    """Move something, if it is not there already: what stays is not sent."""
    if np.abs(handle.position - place).max() > STEP:
        handle.position = place
    if wxyz is not None and np.abs(handle.wxyz - wxyz).max() > STEP:
        handle.wxyz = wxyz
