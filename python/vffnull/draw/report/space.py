"""What the page's script turns and moves of a run in space: bodies in frames, and where these frames are.

A body stands still in its frame, which is a link's, an obstacle's, or the world's. So little has to be in the
page that it holds every instant, whatever a body's shape.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.colors import to_rgb
from numpy.typing import NDArray

from vffnull._core import quaternions
from vffnull.draw import geometry, style
from vffnull.draw.figures.space import SLIM, bounds, floor_of
from vffnull.draw.primitives import COLOURS
from vffnull.draw.report.arrows import all_arrows
from vffnull.draw.report.figures import Run
from vffnull.draw.report.packed import packed
from vffnull.draw.scene import Scene, ghost, travels
from vffnull.draw.shapes import Part

Array = NDArray[Any]

_LONGEST = 0.25
"""Of the arm's reach, the arrow of the greatest force."""
_POINTS = 20_000
"""Of a cloud that are drawn, at most."""
_STIFF = 1e-6
"""What moves by less in the frame of its link [m] stands still in it."""


def pack(run: Run) -> dict[str, Any]:
    """The scene of a run at the chosen instants."""
    result, rows, scene = run.result, run.rows, run.scene.pick(run.rows)
    arm = result.scenario.arm
    poses = arm.link_poses(result.q[rows]) if arm.dimension == 3 else np.eye(4)[None, None]
    reach = scene.reach
    scale = _LONGEST * reach / (float(np.nanmax(scene.strengths, initial=0.0)) or 1.0)
    points, forces, roles = all_arrows(scene, scale)
    low, high = bounds(scene)
    frames = [_frame(poses[:, i, :3, 3], poses[:, i, :3, :3]) for i in range(poses.shape[1])]
    frames += [
        _frame(scene.obstacles[:, i], scene.rotations[i] if scene.rotations else None)
        for i in range(len(scene.cores))
    ]
    links = [_link(part, poses) for part in scene.parts]
    joints = ghost(result)
    if scene.plan and arm.dimension == 3 and joints is not None:
        planned = arm.link_poses(joints[rows])
        links += [_link(part, planned, "plan", len(frames), SLIM) for part in scene.plan]
        frames += [_frame(pose[:, :3, 3], pose[:, :3, :3]) for pose in np.moveaxis(planned, 1, 0)]
    wanted = result.orientation_ref
    return {
        "reach": reach,
        "floor": floor_of(scene),
        "turn": scene.next_corner,
        "box": [low.tolist(), high.tolist()],
        "near": near(scene),
        "shades": [[value / 255 for value in shade] for shade in (style.CONTACT, style.NEAR, style.FREE)],
        "frames": frames,
        "bodies": [*links, *_obstacles(scene, poses.shape[1])],
        "clearance": packed(result.clearance[rows]),
        "tip": packed(scene.tip),
        "target": packed(scene.reference),
        "moves": scene.moves,
        "tool": None if scene.turns is None else packed(quaternions(scene.turns)),
        "wanted": None if wanted is None else packed(wanted[rows]),
        "paths": [packed(places) for places in np.moveaxis(scene.obstacles, 1, 0) if travels(places)],
        "arrows": [to_rgb(COLOURS[role]) for role in roles],
        "points": packed(points),
        "forces": packed(forces),
        "least": 0.02 * reach,
    }


def near(scene: Scene) -> float:
    """The clearance [m] from which on a link has the colour of those that nothing is near."""
    return scene.influence or 0.1 * scene.reach


def _frame(places: Array, turns: Array | None) -> dict[str, str]:
    """Where a frame is, once if it stays there."""
    if not travels(places):
        places = places[:1]
    if turns is None:
        return {"place": packed(places), "turn": packed(np.array([1.0, 0.0, 0.0, 0.0]))}
    return {"place": packed(places), "turn": packed(quaternions(turns))}


def _link(part: Part, poses: Array, role: str = "link", first: int = 0, slim: float = 1.0) -> dict[str, Any]:
    """A part of an arm, in the frame of its link if it stands still in it; these are counted from `first`."""
    frame, corners = None, part.corners
    if part.index >= 0:
        pose = poses[:, part.index]
        own = np.einsum("tji,tkj->tki", pose[:, :3, :3], corners - pose[:, None, :3, 3])
        if np.ptp(own, axis=0).max() < _STIFF:
            frame, corners = first + part.index, own[:1]
    if frame is None and not travels(corners.reshape(len(corners), -1)):
        corners = corners[:1]
    role = "base" if part.index < 0 else role
    made = (corners, part.radius) if slim == 1.0 else geometry.slimmer(corners, part.radius, slim)
    return {"role": role, "index": part.index, "frame": frame, **_shape(*made)}


def _obstacles(scene: Scene, first: int) -> Iterator[dict[str, Any]]:
    """The obstacles, and how far their fields reach, in frames counted from `first`."""
    for index, (corners, radius) in enumerate(scene.cores):
        role = "unseen" if index in scene.unseen else "obstacle"
        found = {"role": role, "index": index, "frame": first + index}
        points = scene.clouds[index]
        if points is not None:
            some = points[:: 1 + max(0, len(points) - 1) // _POINTS]
            yield found | {"points": packed(some), "radius": radius or 0.002 * scene.reach}
            continue
        if geometry.is_surface(corners):
            yield found | {"role": "surface", **_shape(corners[None], 0.0)}
            continue
        yield found | _shape(corners[None], radius)
        if scene.influence > 0.0 and role == "obstacle":
            yield found | {"role": "halo", **_shape(corners[None], radius + scene.influence)}


def _shape(corners: Array, radius: float) -> dict[str, Any]:
    """Corners at every instant at which they are somewhere else, and the triangles of a hull."""
    faces = geometry.triangles(corners[0]).tolist() if corners.shape[1] > 2 else []
    return {"corners": packed(corners), "count": corners.shape[1], "radius": radius, "faces": faces}
