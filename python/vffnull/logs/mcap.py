"""MCAP: one JSON message per instant, for Foxglove, PlotJuggler and the ROS tools.

JSON knows neither infinity nor NaN; such numbers are written as null, so that a result is not read back from
this kind of file.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from vffnull._extras import extra
from vffnull._record import Layout, recorded
from vffnull.logs import header

if TYPE_CHECKING:
    from vffnull._outcome import Outcome

TOPIC = "/vffnull"


def write(result: Outcome, path: Path) -> None:
    """Write a result; simulated time counts from 0 as the log's time."""
    library = extra("mcap.writer", "mcap")
    arrays = {"t": result.t, **recorded(result)}
    with path.open("wb") as stream:
        file = library.Writer(stream, compression=library.CompressionType.ZSTD)
        file.start(profile="", library=f"vffnull {result.version}")
        schema = file.register_schema(
            name="vffnull.Instant",
            encoding="jsonschema",
            data=json.dumps(_schema(arrays, result.layout)).encode(),
        )
        channel = file.register_channel(topic=TOPIC, message_encoding="json", schema_id=schema)
        times = np.rint(result.t * 1e9).astype(np.int64).tolist()
        columns = [_plain(values) for values in arrays.values()]
        for time, *row in zip(times, *columns, strict=True):
            message = json.dumps(dict(zip(arrays, row, strict=True))).encode()
            file.add_message(channel_id=channel, log_time=time, publish_time=time, data=message)
        file.add_metadata("vffnull", {"header": header.pack(result)})
        file.add_attachment(
            create_time=0,
            log_time=0,
            name="scenario.toml",
            media_type="application/toml",
            data=str(result.scenario).encode(),
        )
        file.finish()


def _schema(arrays: dict[str, NDArray[Any]], layout: Layout) -> dict[str, Any]:
    """What a message holds, as JSON Schema; descriptions carry units."""
    properties: dict[str, Any] = {}
    for name, values in arrays.items():
        kind: dict[str, Any] = {"type": "number"}
        for _ in values.shape[1:]:
            kind = {"type": "array", "items": kind}
        properties[name] = {**kind, "description": _about(name, values.shape[1:], layout)}
    return {"type": "object", "properties": properties}


def _about(name: str, shape: tuple[int, ...], layout: Layout) -> str:
    """What a quantity is, with its units."""
    if name not in layout.quantities:
        return "time [s]"
    meaning, units = layout.quantities[name].meaning, layout.units(name, shape)
    return f"{meaning} [{units}]" if units else meaning


def _plain(values: NDArray[Any]) -> list[Any]:
    sound = np.isfinite(values)
    if not sound.all():
        values = values.astype(object)
        values[~sound] = None
    rows: list[Any] = values.tolist()
    return rows
