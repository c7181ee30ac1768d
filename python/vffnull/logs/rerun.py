"""Rerun: every quantity as a plot over time, and the arm among its obstacles.

Its two-dimensional view has y pointing down, so the scene is laid into the plane z = 0 of a three-dimensional
one with y up, where coordinates stay true.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vffnull import _record
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
        log.log("scene", rr.ViewCoordinates.RIGHT_HAND_Y_UP, static=True)
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
        for i, core in enumerate(scene.cores):
            outline = geometry.outline(*core)
            closed = in_space(np.vstack([outline, outline[:1]]))
            log.log(f"scene/obstacle_{i}", rr.LineStrips3D([closed]), static=True)
            place = rr.Transform3D.columns(translation=in_space(scene.obstacles[:, i]))
            log.send_columns(f"scene/obstacle_{i}", time, place)
        log.flush()
