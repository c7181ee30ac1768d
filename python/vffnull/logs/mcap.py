"""MCAP: one JSON message per instant, for Foxglove, PlotJuggler and the ROS tools.

A run in space has what Foxglove's 3-D panel draws besides: transforms of all frames, the solids that they
carry, and the arm as URDF under ``/robot_description``. JSON knows neither infinity nor NaN; such numbers are
written as null, so that a result is not read back from this kind of file.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.logs import foxglove, header
from vffnull.logs.frames import description, tree_of
from vffnull.model.record import Layout, recorded

if TYPE_CHECKING:
    from vffnull.model.outcome import Outcome

TOPIC = "/vffnull"
DESCRIPTION = "/robot_description"
"""Where Foxglove looks for a robot."""


def write(result: Outcome, path: Path) -> None:
    """Write a result; simulated time counts from 0 as the log's time."""
    library = extra("mcap.writer", "mcap")
    with path.open("wb") as stream:
        file = library.Writer(stream, compression=library.CompressionType.ZSTD)
        file.start(profile="", library=f"vffnull {result.version}")
        robot = description(result) if result.layout.dimension == 3 else None
        for topic, name, schema, messages in _channels(result, robot):
            known = file.register_schema(name=name, encoding="jsonschema", data=json.dumps(schema).encode())
            channel = file.register_channel(topic=topic, message_encoding="json", schema_id=known)
            for time, message in messages:
                file.add_message(
                    channel_id=channel, log_time=time, publish_time=time, data=json.dumps(message).encode()
                )
        file.add_metadata("vffnull", {"header": header.pack(result)})
        attached = [("scenario.toml", "application/toml", str(result.scenario))]
        if robot is not None:
            attached.append(("robot.urdf", "application/xml", robot))
        for name, kind, text in attached:
            file.add_attachment(create_time=0, log_time=0, name=name, media_type=kind, data=text.encode())
        file.finish()


_Channel = tuple[str, str, dict[str, Any], Iterable[tuple[int, dict[str, Any]]]]


def _channels(result: Outcome, robot: str | None) -> Iterator[_Channel]:
    """Topic, name of the schema, schema, and messages with their times [ns]."""
    arrays = {"t": result.t, **recorded(result)}
    layout = result.layout
    yield TOPIC, "vffnull.Instant", _schema(arrays, layout), _instants(arrays, layout)
    if robot is None:
        return
    text = {"type": "object", "properties": {"data": {"type": "string"}}}
    start = foxglove.nanoseconds(result.t[:1]).tolist()
    yield DESCRIPTION, "std_msgs/String", text, [(time, {"data": robot}) for time in start]
    try:
        tree = tree_of(result)
    except InputError:  # a run without a sound instant has nothing to draw
        return
    yield "/tf", "foxglove.FrameTransforms", foxglove.FRAME_TRANSFORMS, foxglove.transforms(tree)
    for topic, roles in (
        ("/scene/arm", ("base", "link", "tool")),
        ("/scene/obstacles", ("obstacle",)),
        ("/scene/target", ("target",)),
    ):
        carriers = [frame for frame in tree.frames if frame.role in roles]
        if carriers:
            update = [foxglove.scene_update(tree, carriers)]
            yield topic, "foxglove.SceneUpdate", foxglove.SCENE_UPDATE, update


def _instants(arrays: dict[str, NDArray[Any]], layout: Layout) -> Iterator[tuple[int, dict[str, Any]]]:
    times = foxglove.nanoseconds(arrays["t"]).tolist()
    columns = [_rows(name, values, layout) for name, values in arrays.items()]
    for time, *row in zip(times, *columns, strict=True):
        yield time, dict(zip(arrays, row, strict=True))


def _schema(arrays: dict[str, NDArray[Any]], layout: Layout) -> dict[str, Any]:
    """What a message holds, as JSON Schema; descriptions carry units.

    Foxglove reads no array of arrays: points are objects, with a number for each axis.
    """
    properties: dict[str, Any] = {}
    for name, values in arrays.items():
        kind: dict[str, Any] = {"type": "number"}
        if values.ndim == 3:
            kind = {"type": "object", "properties": {axis: kind for axis in _axes(name, values, layout)}}
        if values.ndim > 1:
            kind = {"type": "array", "items": kind}
        properties[name] = {**kind, "description": _about(name, values.shape[1:], layout)}
    return {"type": "object", "properties": properties}


def _about(name: str, shape: tuple[int, ...], layout: Layout) -> str:
    """What a quantity is, with its units."""
    if name not in layout.quantities:
        return "time [s]"
    meaning, units = layout.quantities[name].meaning, layout.units(name, shape)
    return f"{meaning} [{units}]" if units else meaning


def _axes(name: str, values: NDArray[Any], layout: Layout) -> list[str]:
    """Names of the axes of points."""
    return [str(each) for each in layout.labels(layout.quantities[name].over[-1], values.shape[-1])]


def _rows(name: str, values: NDArray[Any], layout: Layout) -> list[Any]:
    """The values of a quantity as they stand in the messages."""
    sound = np.isfinite(values)
    if not sound.all():
        values = values.astype(object)
        values[~sound] = None
    rows: list[Any] = values.tolist()
    if values.ndim < 3:
        return rows
    axes = _axes(name, values, layout)
    return [[dict(zip(axes, point, strict=True)) for point in row] for row in rows]
