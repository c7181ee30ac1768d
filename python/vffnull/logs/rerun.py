"""Rerun: every quantity as a plot over time, and the arm among its obstacles.

Its two-dimensional view has y pointing down, so a scene of the plane is laid into the plane z = 0 of a
three-dimensional one with y up, where coordinates stay true. In space z is up: solids are logged once, and
then a transform into the world for each frame, in Rerun's single precision.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull._core import quaternions
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.logs import header
from vffnull.model import record as _record

if TYPE_CHECKING:
    from vffnull.draw.primitives import Role
    from vffnull.logs.frames import Frame
    from vffnull.model.outcome import Outcome

GROUPS: dict[Role, str] = {"base": "arm", "link": "arm", "tool": "arm", "obstacle": "obstacles"}
"""Where the frames of a role are below ``scene``; others are there themselves."""


def write(result: Outcome, path: Path) -> None:
    """Write a result."""
    rr = extra("rerun", "rerun")
    with rr.RecordingStream("vffnull") as log:
        log.save(str(path))
        log.send_recording_name(result.scenario.name or "run")
        log.log("scenario", rr.TextDocument(str(result.scenario)), static=True)
        log.log("header", rr.TextDocument(header.pack(result)), static=True)
        _plots(rr, log, result)
        (_space if result.layout.dimension == 3 else _plane)(rr, log, result)
        log.flush()


def _plots(rr: Any, log: Any, result: Outcome) -> None:
    """Every recorded number over time, named with its unit."""
    layout = result.layout
    time = [rr.TimeColumn("t", duration=result.t)]
    for name, values in _record.recorded(result).items():
        rows = _record.flat(values)
        if rows.shape[1]:
            labels = [f"{each.name} [{each.unit}]" for each in layout.columns(name, values.shape[1:])]
            log.log(f"record/{name}", rr.SeriesLines(names=labels), static=True)
            log.send_columns(f"record/{name}", time, rr.Scalars.columns(scalars=rows.astype(float)))


def _plane(rr: Any, log: Any, result: Outcome) -> None:
    from vffnull.draw import geometry
    from vffnull.draw.scene import Scene

    log.log("scene", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
    time = [rr.TimeColumn("t", duration=result.t)]
    scene = Scene.of_result(result)
    arm = geometry.in_space(scene.joints)
    log.send_columns("scene/arm", time, rr.LineStrips3D.columns(strips=list(arm)))
    for i, (corners, radius) in enumerate(scene.cores):
        outline = geometry.outline(corners, radius)
        log.log(
            f"scene/obstacle_{i}",
            rr.LineStrips3D([geometry.in_space(np.vstack([outline, outline[:1]]))]),
            static=True,
        )
        places, rotation = geometry.in_space(scene.obstacles[:, i]), scene.rotations[i]
        turned = np.tile(np.eye(3), (len(places), 1, 1))
        if rotation is not None:
            turned[:, :2, :2] = rotation
        log.send_columns(f"scene/obstacle_{i}", time, _columns(rr, places, turned))


def _space(rr: Any, log: Any, result: Outcome) -> None:
    from vffnull.logs.frames import description, tree_of

    log.log("scene", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    log.log("robot_description", rr.TextDocument(description(result)), static=True)
    try:
        tree = tree_of(result)
    except InputError:  # a run without a sound instant has nothing to draw
        return
    time = [rr.TimeColumn("t", duration=tree.t)]
    for frame in tree.frames:
        parts = ["scene", *filter(None, [GROUPS.get(frame.role)]), frame.name]
        log.send_columns(
            rr.new_entity_path(parts), time, _columns(rr, frame.places[:, :3, 3], frame.places[:, :3, :3])
        )
        for name, what in _solids(rr, frame, tree.reach):
            log.log([*parts, name], what, static=True)


def _columns(rr: Any, places: NDArray[Any], turned: NDArray[Any]) -> Any:
    """Positions (T, 3) and rotations (T, 3, 3) as transforms."""
    return rr.Transform3D.columns(translation=places, quaternion=_xyzw(turned))


def _xyzw(turned: NDArray[Any]) -> NDArray[Any]:
    return np.roll(quaternions(turned), -1, axis=-1)


def _solids(rr: Any, frame: Frame, reach: float) -> list[tuple[str, Any]]:
    """What a frame carries, with names."""
    from vffnull.logs.frames import Box, Capsule, Mesh, axes_of, opacity, rgb

    found: list[tuple[str, Any]] = []
    solid = rr.components.FillMode.Solid
    if rods := [each for each in frame.solids if isinstance(each, Capsule)]:
        what = rr.Capsules3D(
            lengths=[each.length for each in rods],
            radii=[each.radius for each in rods],
            translations=[each.a for each in rods],
            quaternions=_xyzw(np.stack([each.axes for each in rods])),
            colors=[rgb(frame.role)] * len(rods),
            fill_mode=solid,
        )
        found.append(("capsules", what))
    if boxes := [each for each in frame.solids if isinstance(each, Box)]:
        what = rr.Boxes3D(
            centers=[each.center for each in boxes],
            sizes=[each.size for each in boxes],
            quaternions=_xyzw(np.stack([each.axes for each in boxes])),
            colors=[rgb(frame.role)] * len(boxes),
            fill_mode=solid,
        )
        found.append(("boxes", what))
    for i, each in enumerate(each for each in frame.solids if isinstance(each, Mesh)):
        corners = each.vertices[each.triangles]
        out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        what = rr.Mesh3D(
            vertex_positions=corners.reshape(-1, 3),
            vertex_normals=np.repeat(out / np.linalg.norm(out, axis=1, keepdims=True), 3, axis=0),
            albedo_factor=(*rgb(frame.role), opacity(each)),
        )
        found.append((f"mesh_{i}", what))
    if axes := axes_of(frame, reach):
        ends, shades = zip(*axes, strict=True)
        what = rr.Arrows3D(vectors=ends, colors=shades, radii=0.0075 * reach)
        found.append(("axes", what))
    return found
