"""What arms and obstacles look like by their descriptions: corners and radii."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

import vffnull._core as _core
from vffnull.draw import geometry
from vffnull.draw.primitives import Array, Rows
from vffnull.model.arm import frame
from vffnull.model.shape import core_in_space

if TYPE_CHECKING:
    from vffnull._core import Arm
    from vffnull.model.outcome import Outcome


@dataclass(frozen=True, eq=False)
class Part:
    """What a link is made of: all points within `radius` [m] of the hull of `corners` (T, ·, D) [m].

    The index is the link's, −1 for the base.
    """

    index: int
    corners: Array
    radius: float

    def pick(self, rows: Rows) -> Part:
        """The part at some of its instants."""
        return Part(self.index, self.corners[rows], self.radius)


def cores_of(document: Mapping[str, Any], base: Array, reach: float) -> tuple[tuple[Array, float], ...]:
    """The obstacles of a scenario's document as corners of their cores and radii.

    Of what has no end in space, what is near an arm of this reach [m] that stands at `base` (D,) [m].
    """
    obstacles = document.get("obstacles", [])
    if len(base) == 2:
        return tuple(geometry.core(each["shape"], each.get("angle", 0.0)) for each in obstacles)
    return tuple(
        core_in_space(
            each["shape"],
            each.get("orientation"),
            base - np.asarray(each.get("position", base)),
            1.25 * reach,
        )
        for each in obstacles
    )


def is_seen(obstacle: Mapping[str, Any]) -> bool:
    """Whether an obstacle of a scenario's document is there and the controller knows of it."""
    return "likelihood" not in obstacle and bool(obstacle.get("contact", {}).get("seen", True))


def unseen_of(document: Mapping[str, Any]) -> frozenset[int]:
    """Obstacles of a document that the controller does not know of, or that are possible futures."""
    return frozenset(i for i, each in enumerate(document.get("obstacles", [])) if not is_seen(each))


def clouds_of(document: Mapping[str, Any]) -> tuple[Array | None, ...]:
    """The points of the obstacles of a scenario's document that are clouds; None of others."""
    return tuple(
        geometry.points_in_space(each["shape"], each.get("orientation"))
        for each in document.get("obstacles", [])
    )


def wrenches_of(result: Outcome, parts: Sequence[Part], size: int) -> tuple[Array, Array] | None:
    """Where wrenches push an arm of these parts in a run (T, k, D) [m], and their forces [N].

    In space where the line of the force enters the link, if the point is hidden in that. None of a scenario
    without any, or with torques alone.
    """
    document, t, q = result.scenario.to_dict(), result.t, result.q
    given = document.get("wrenches", [])
    pushing = [i for i, each in enumerate(given) if np.any(each.get("force", 0.0))]
    if not pushing:
        return None
    found = _core.wrenches(document, t.tolist(), q.tolist())
    points, forces = (each[:, pushing, :size] for each in found)
    if size == 3:
        links = pushed_links(document, result.scenario.arm)
        sizes = np.linalg.norm(forces, axis=-1, keepdims=True)
        along = np.divide(forces, sizes, out=np.zeros_like(forces), where=sizes > 0.0)
        for k, i in enumerate(pushing):
            ways = [
                geometry.way_out(part.corners, part.radius, points[:, k], -along[:, k])
                for part in parts
                if part.index == links[i]
            ]
            points[:, k] -= np.max([np.zeros(len(t)), *ways], axis=0)[:, None] * along[:, k]
    return points, forces


def pushed_links(document: Mapping[str, Any], arm: Arm) -> list[int]:
    """Which link of an arm in space every wrench of a scenario pushes."""
    names = arm.link_names
    given = (each["link"] for each in document.get("wrenches", []))
    return [len(names) - 1 if name == "tip" else names.index(name) for name in given]


def mount_of(arm: Arm) -> Array:
    """Where the base of an arm in space stands, homogeneous (4, 4)."""
    return frame(arm.to_dict().get("mount", {}))


def solids_of(arm: Arm, q: Array, joints: Array) -> tuple[Part, ...]:
    """The shapes of an arm in space at joint positions (T, n); a link without any is a thin line."""
    poses = arm.link_poses(q)
    found = []
    for link, shape in arm.collision:
        index = arm.link_names.index(link) if link in arm.link_names else -1
        place = poses[:, index] if index >= 0 else np.broadcast_to(mount_of(arm), (len(q), 4, 4))
        corners = corners_of(shape)
        there = np.einsum("tij,kj->tki", place[:, :3, :3], corners) + place[:, None, :3, 3]
        found.append(Part(index, there, float(shape.get("radius", 0.0))))
    dressed = {part.index for part in found}
    thin = 0.015 * float(np.linalg.norm(np.diff(joints[0], axis=0), axis=-1).sum())
    for i in range(joints.shape[1] - 1):
        if i not in dressed:
            found.append(Part(i, joints[:, i : i + 2], thin))
    return tuple(found)


def corners_of(shape: Mapping[str, Any]) -> Array:
    """Corners (·, 3) of the core of a link's shape, in the link's frame."""
    corners, _ = core_in_space(shape, shape.get("orientation"))
    return np.asarray(corners + np.asarray(shape.get("center", (0.0, 0.0, 0.0)), dtype=float))


def thickest(solids: tuple[Part, ...], n: int) -> Array:
    """The largest radius of each of n links' parts."""
    return np.array([max((p.radius for p in solids if p.index == i), default=0.0) for i in range(n)])


def influence_of(document: Mapping[str, Any]) -> float:
    """The influence distance [m] of a field that is there and switched on; 0 otherwise."""
    field = document.get("controller", {}).get("field", {})
    return float(field["influence"]) if field.get("gain") else 0.0
