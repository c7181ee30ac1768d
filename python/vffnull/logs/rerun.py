"""Rerun: every quantity as a plot over time, and the arm among its obstacles.

Its two-dimensional view has y pointing down, so a scene of the plane is laid into the plane z = 0 of a
three-dimensional one with y up, where coordinates stay true. In space z is up.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull import _core, _record
from vffnull._arm import quaternion
from vffnull._extras import extra
from vffnull.logs import header

if TYPE_CHECKING:
    from vffnull.result import Result


def write(result: Result, path: Path) -> None:
    """Write a result."""
    rr = extra("rerun", "rerun")
    from vffnull.plotting import geometry
    from vffnull.plotting.geometry import in_space
    from vffnull.plotting.primitives import Scene

    with rr.RecordingStream("vffnull") as log:
        log.save(str(path))
        log.send_recording_name(result.scenario.name or "run")
        log.log("scenario", rr.TextDocument(str(result.scenario)), static=True)
        log.log("header", rr.TextDocument(header.pack(result)), static=True)
        plane = result.layout.dimension == 2
        up = rr.ViewCoordinates.RIGHT_HAND_Y_UP if plane else rr.ViewCoordinates.RIGHT_HAND_Z_UP
        log.log("scene", up, static=True)
        layout = result.layout
        time = [rr.TimeColumn("t", duration=result.t)]
        for name, values in _record.recorded(result).items():
            rows = _record.flat(values)
            if rows.shape[1]:
                labels = [f"{each.name} [{each.unit}]" for each in layout.columns(name, values.shape[1:])]
                log.log(f"record/{name}", rr.SeriesLines(names=labels), static=True)
                log.send_columns(f"record/{name}", time, rr.Scalars.columns(scalars=rows.astype(float)))
        scene = Scene.of_result(result)
        arm = in_space(scene.joints)
        log.send_columns("scene/arm", time, rr.LineStrips3D.columns(strips=list(arm)))
        for i, part in enumerate(scene.solids or ()):
            rods = list(part.corners[:, [0, -1]])
            columns = rr.LineStrips3D.columns(strips=rods, radii=np.full(len(rods), part.radius))
            log.send_columns(f"scene/links/{i}", time, columns)
        for i, (corners, radius) in enumerate(scene.cores):
            if plane:
                outline = geometry.outline(corners, radius)
                strips, thick = [in_space(np.vstack([outline, outline[:1]]))], None
            else:
                strips, thick = _strips(corners), radius or None
            points = scene.clouds[i]
            drawn = (
                rr.LineStrips3D(strips, radii=thick) if points is None else rr.Points3D(points, radii=thick)
            )
            log.log(f"scene/obstacle_{i}", drawn, static=True)
            places, rotation = in_space(scene.obstacles[:, i]), scene.rotations[i]
            if rotation is None:
                columns = rr.Transform3D.columns(translation=places)
            else:
                turned = np.tile(np.eye(3), (len(places), 1, 1))
                turned[:, : rotation.shape[1], : rotation.shape[1]] = rotation
                columns = rr.Transform3D.columns(
                    translation=places, quaternion=np.roll(quaternion(turned), -1, axis=1)
                )
            log.send_columns(f"scene/obstacle_{i}", time, columns)
        log.flush()


def _strips(corners: NDArray[Any]) -> list[NDArray[Any]]:
    """The edges of a core in space, of a hull its faces, or the point twice that it is.

    These are lines whose radius is drawn.
    """
    from vffnull.plotting import geometry

    count = len(corners)
    if count == 1:
        return [corners[[0, 0]]]
    if not geometry.is_block(corners):
        return [corners[[*ring, ring[0]]] for ring in _core.hull(corners)]
    pairs = [(i, i | bit) for bit in (1, 2, 4) if bit < count for i in range(count) if not i & bit]
    return [corners[list(pair)] for pair in pairs]
