"""Arrow: the record as a table with a unit and a meaning for every column, in memory or in a file."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from vffnull._support.extras import extra
from vffnull.logs import header
from vffnull.model import record as _record

if TYPE_CHECKING:
    import pyarrow

    from vffnull.model.outcome import Outcome


def write(result: Outcome, path: Path) -> None:
    """Write a result as an Arrow IPC file (Feather V2), to be mapped into memory."""
    ipc = extra("pyarrow.ipc", "io")
    content = table(result, signed=True)
    with ipc.new_file(str(path), content.schema) as file:
        file.write_table(content)


def read(path: Path) -> tuple[header.Header, header.Arrays]:
    """The header and the arrays of a file."""
    ipc = extra("pyarrow.ipc", "io")
    with path.open("rb") as opened:
        content = ipc.open_file(opened).read_all()
    return parts(content, path)


def table(result: Outcome, signed: bool = False) -> pyarrow.Table:
    """The record as a table; the schema's metadata carries the header, maybe signed, under ``vffnull``."""
    arrow = extra("pyarrow", "io")
    fields, values = [arrow.field("t", arrow.from_numpy_dtype(result.t.dtype), metadata=TIME)], [result.t]
    for column, line in result.layout.lines(result):
        fields.append(arrow.field(column.name, arrow.from_numpy_dtype(line.dtype), metadata=about(column)))
        values.append(line)
    schema = arrow.schema(fields, metadata={"vffnull": header.pack(result, signed)})
    return arrow.table([arrow.array(line) for line in values], schema=schema)


def parts(content: pyarrow.Table, source: Path) -> tuple[header.Header, header.Arrays]:
    """The header and the arrays out of a table."""
    found = header.unpack((content.schema.metadata or {}).get(b"vffnull", b""), source)
    if len(set(content.column_names)) < content.num_columns:
        raise header.foreign(source)
    columns = {name: content[name].to_numpy() for name in content.column_names}
    return found, header.split(found, columns, source)


def about(column: _record.Column) -> dict[str, str]:
    """The metadata of a column."""
    return {"unit": column.unit, "long_name": column.meaning}


TIME = {"unit": "s", "long_name": "time"}
