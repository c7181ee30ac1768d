"""The frames of a run in space, and the solids that each of them carries: what viewers of logs draw.

A viewer gets every solid once, in the frame that it moves with, and then where the frames are at every
instant.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._core import matrices
from vffnull._support.errors import ScenarioWarning
from vffnull.draw import geometry
from vffnull.draw.primitives import COLOURS, Role
from vffnull.draw.scene import drawable
from vffnull.draw.shapes import corners_of, mount_of
from vffnull.model.arm import frame
from vffnull.model.shape import core_in_space

if TYPE_CHECKING:
    from vffnull._core import Arm
    from vffnull.model.outcome import Outcome

Array = NDArray[np.float64]

_BASE = "#8C8F94"
_AXES = ((0.84, 0.15, 0.16), (0.17, 0.63, 0.17), (0.12, 0.47, 0.71))
_DOT = 0.002  # of the arm's reach, the least radius of a point that is drawn
_THIN = 0.015  # of the arm's length, the radius of a link that has no shape of its own


@dataclass(frozen=True, eq=False)
class Capsule:
    """All points within `radius` [m] of the segment from `a` to `b` (3,) [m]; a ball if these are one."""

    a: Array
    b: Array
    radius: float

    @property
    def length(self) -> float:
        """Of the segment [m]."""
        return float(np.linalg.norm(self.b - self.a))

    @property
    def axes(self) -> Array:
        """A rotation (3, 3) that takes z to the direction from `a` to `b`."""
        if self.length == 0.0:
            return np.eye(3)
        along = (self.b - self.a) / self.length
        across = np.linalg.svd(along[None])[2][1]
        return np.column_stack([across, np.cross(along, across), along])


@dataclass(frozen=True, eq=False)
class Box:
    """A box around `center` (3,) [m] whose edges lie along the columns of `axes` (3, 3), of a `size` [m]."""

    center: Array
    axes: Array
    size: Array


@dataclass(frozen=True, eq=False)
class Mesh:
    """A surface of `triangles` (·, 3), which name `vertices` (·, 3) [m]."""

    vertices: Array
    triangles: NDArray[np.int64]


Solid = Capsule | Box | Mesh


@dataclass(frozen=True, eq=False)
class Frame:
    """A frame of reference that moves.

    Attributes
    ----------
    name, parent : str
        What it is called and what it is placed in: frames make a tree, its root is called ``world``.
    role : Role
        What it is part of.
    poses : (T, 4, 4) ndarray
        Where it is in its parent, homogeneous.
    places : (T, 4, 4) ndarray
        Where it is in the world.
    solids : tuple of Solid
        What moves with it.
    """

    name: str
    parent: str
    role: Role
    poses: Array
    places: Array
    solids: tuple[Solid, ...] = ()


@dataclass(frozen=True, eq=False)
class Tree:
    """All frames of a run at the instants at which there are numbers to draw.

    Attributes
    ----------
    root : str
        What the world is called.
    t : (T,) ndarray
        Time [s].
    frames : tuple of Frame
        Every one after its parent: base, links, tip, obstacles, target.
    """

    root: str
    t: Array
    frames: tuple[Frame, ...]

    @property
    def reach(self) -> float:
        """From the first joint to the farthest other one or the tip [m]."""
        arm = [each.places[:, :3, 3] for each in self.frames if each.role in ("link", "tool")]
        return max(float(np.linalg.norm(each - arm[0], axis=-1).max()) for each in arm)


def description(result: Outcome) -> str:
    """The arm as URDF; its links have the shapes that are measured against obstacles."""
    with warnings.catch_warnings():
        # The solids, and the scenario that is in every log, have what URDF cannot say.
        warnings.simplefilter("ignore", ScenarioWarning)
        return str(result.scenario.arm.to_urdf())


def rgb(role: Role) -> tuple[float, float, float]:
    """Red, green and blue from 0 to 1 of what has a role."""
    text = _BASE if role == "base" else COLOURS[role]
    r, g, b = (int(text[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return r, g, b


def opacity(solid: Solid) -> float:
    """How much a solid hides of what is behind it: a surface that goes on and on not everything."""
    return 0.35 if isinstance(solid, Mesh) and len(solid.vertices) == 4 and len(solid.triangles) == 2 else 1.0


def axes_of(frame: Frame, reach: float) -> list[tuple[Array, tuple[float, float, float]]]:
    """Ends (3,) of the axes that are drawn of a frame, with their colours: of tip and target."""
    if frame.role not in ("tool", "target"):
        return []
    return [(0.12 * reach * end, shade) for end, shade in zip(np.eye(3), _AXES, strict=True)]


def tree_of(result: Outcome) -> Tree:
    """The frames of a run in space.

    Links and tip are called as in the arm's description and hang in a chain, as in its URDF; obstacles are
    ``obstacle_0`` … and the reference is ``target``.

    Raises
    ------
    vffnull.errors.InputError
        If there is no recorded instant to draw.
    """
    result = drawable(result)
    arm, mount = result.scenario.arm, mount_of(result.scenario.arm)
    taken = {arm.to_dict()["base"], *arm.link_names}
    root = _free("world", taken)
    found = list(_of_arm(arm, result.q, root, taken))
    reach = 1.25 * Tree(root, result.t, tuple(found)).reach
    for i, obstacle in enumerate(result.scenario.to_dict().get("obstacles", [])):
        places = _moving(obstacle, result.obstacles[:, i], result.t)
        solids = _of_obstacle(obstacle, mount[:3, 3] - places[0, :3, 3], reach)
        found.append(Frame(_free(f"obstacle_{i}", taken), root, "obstacle", places, places, solids))
    target = np.tile(np.eye(4), (len(result.t), 1, 1))
    target[:, :3, 3] = result.x_ref
    if result.orientation_ref is not None:
        target[:, :3, :3] = matrices(result.orientation_ref)
    found.append(Frame(_free("target", taken), root, "target", target, target))
    return Tree(root, result.t, tuple(found))


def _of_arm(arm: Arm, q: Array, root: str, taken: set[str]) -> Iterator[Frame]:
    """Base, links and tip in a chain."""
    document = arm.to_dict()
    name_of_base, tool = document["base"], frame(document.get("tool", {}))
    solids: dict[str, list[Solid]] = {name: [] for name in (name_of_base, *arm.link_names)}
    for link, shape in arm.collision:
        solids[link].append(solid(corners_of(shape), float(shape.get("radius", 0.0))))
    steps = [frame(joint)[:3, 3] for joint in document["joints"][1:]] + [tool[:3, 3]]
    thin = _THIN * sum(float(np.linalg.norm(step)) for step in steps)
    base = np.broadcast_to(mount_of(arm), (len(q), 4, 4))
    yield Frame(name_of_base, root, "base", base, base, tuple(solids[name_of_base]))
    poses, before, parent = arm.link_poses(q), base, name_of_base
    for i, (name, step) in enumerate(zip(arm.link_names, steps, strict=True)):
        there = poses[:, i]
        bare = Capsule(np.zeros(3), step, thin)
        yield Frame(name, parent, "link", _within(before, there), there, tuple(solids[name] or [bare]))
        before, parent = there, name
    tip = _free(document["tip"], taken)
    yield Frame(tip, parent, "tool", np.broadcast_to(tool, base.shape), arm.tip_poses(q))


def _within(parent: Array, child: Array) -> Array:
    """Poses (T, 4, 4) of a frame in its parent, from where both are in the world."""
    turned = np.swapaxes(parent[:, :3, :3], 1, 2)
    found = np.tile(np.eye(4), (len(child), 1, 1))
    found[:, :3, :3] = turned @ child[:, :3, :3]
    found[:, :3, 3] = np.einsum("tij,tj->ti", turned, child[:, :3, 3] - parent[:, :3, 3])
    return found


def _moving(obstacle: Mapping[str, Any], positions: Array, t: Array) -> Array:
    """Where an obstacle's own frame is (T, 4, 4)."""
    found = np.tile(np.eye(4), (len(t), 1, 1))
    turned = _core.rotations(obstacle, 3, t)  # compared with its orientation at the start
    first = matrices(obstacle.get("orientation", (1.0, 0.0, 0.0, 0.0)))
    found[:, :3, :3] = first if turned is None else turned @ first
    found[:, :3, 3] = positions
    return found


def _of_obstacle(obstacle: Mapping[str, Any], base: Array, reach: float) -> tuple[Solid, ...]:
    """An obstacle's shape in its own frame; of a half-space what lies near the base of the arm, (3,) [m]."""
    shape = obstacle["shape"]
    points = geometry.points_in_space(shape)
    if points is not None:
        radius = max(shape["radius"], _DOT * reach)
        return tuple(Capsule(point, point, radius) for point in points)
    first = matrices(obstacle.get("orientation", (1.0, 0.0, 0.0, 0.0)))
    return (solid(*core_in_space(shape, None, first.T @ base, reach)),)


def solid(corners: Array, radius: float) -> Solid:
    """All points within a radius of the hull of corners (·, 3); only one or two of them have a radius."""
    if len(corners) <= 2:
        return Capsule(corners[0], corners[-1], radius)
    if len(corners) == 8 and geometry.is_block(corners):
        start, edges = geometry.edges_in_space(corners)
        size = np.linalg.norm(edges, axis=1)
        axes = (edges / size[:, None]).T
        axes[:, 2] *= np.sign(np.linalg.det(axes))  # of two opposite axes either will do
        return Box(start + edges.sum(axis=0) / 2, axes, size)
    return Mesh(corners, geometry.triangles(corners))


def _free(name: str, taken: set[str]) -> str:
    """A name that no frame has yet, which is taken now."""
    while name in taken:
        name += "_"
    taken.add(name)
    return name
