"""Parts: the Parquet files of a study, one of runs and, on request, one of records for every block.

A part's name ends in the digest of its bytes. So a damaged part is known by reading it, no list of parts is
needed beside them, and a part that two workers have computed is written twice under the same name.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import vffnull._core as _core
from vffnull._support.extras import extra
from vffnull.studies.plan import FIXED, Block, Plan

if TYPE_CHECKING:
    import pyarrow

__all__ = [
    "KINDS",
    "READERS",
    "Kind",
    "Part",
    "about",
    "encoded",
    "named",
    "runs_part",
    "schema_of",
    "wanted",
]

Kind = Literal["runs", "records"]
KINDS: tuple[Kind, ...] = ("runs", "records")

READERS = 8
"""Files that are verified at a time."""

_NAME = re.compile(r"part-(\d{7,})-([0-9a-f]{16})\.parquet")


@dataclass(frozen=True)
class Part:
    """A file of a block.

    Attributes
    ----------
    kind : {"runs", "records"}
        The folder in which it stands.
    block : int
        Of which block.
    digest : str
        Of its bytes: 16 hexadecimal digits of SHA-256.
    data : bytes or None
        Its bytes, where they are at hand.
    """

    kind: Kind
    block: int
    digest: str
    data: bytes | None = field(default=None, repr=False)

    @property
    def name(self) -> str:
        """The name of the file."""
        return f"part-{self.block:07d}-{self.digest}.parquet"

    @property
    def path(self) -> str:
        """The name with its folder."""
        return f"{self.kind}/{self.name}"

    def fits(self, data: bytes) -> bool:
        """Whether these are its bytes."""
        return digest_of(data) == self.digest


def digest_of(data: bytes) -> str:
    """The digest of a part."""
    return hashlib.sha256(data).hexdigest()[:16]


def named(kind: Kind, name: str) -> Part | None:
    """The part that a file is by its name; None for other files."""
    found = _NAME.fullmatch(name)
    return Part(kind, int(found[1]), found[2]) if found else None


def wanted(plan: Plan) -> tuple[Kind, ...]:
    """Which parts every block has."""
    return KINDS if plan.records is not None else KINDS[:1]


@lru_cache(8)
def schema_of(plan: Plan) -> pyarrow.Schema:
    """The columns of runs, with their units, and what the study is."""
    arrow = extra("pyarrow", "study")
    layout = plan.layout
    kinds = {"float": arrow.float64(), "int": arrow.int64(), "bool": arrow.bool_()}
    own = {
        "run": arrow.int64(),
        "point": arrow.int64(),
        "repetition": arrow.int32(),
        "seed": arrow.int64(),
        "scene": arrow.string(),
        "status": arrow.string(),
        "message": arrow.string(),
        "end_time": arrow.float64(),
    }

    def described(name: str, kind: Any, unit: str, meaning: str) -> Any:
        return arrow.field(name, kind, metadata={"unit": unit, "meaning": meaning})

    fields = []
    for name, (unit, meaning) in FIXED.items():
        if name == "status":
            fields += [
                described(
                    factor.name,
                    kinds.get(factor.kind, arrow.string()),
                    factor.unit,
                    ", ".join(factor.touched),
                )
                for factor in plan.factors
            ]
        if name != "scene" or plan.has_scenes:
            fields.append(described(name, own[name], unit, meaning))
    fields += [described(name, arrow.float64(), *layout.metric(name)) for name in plan.metrics]
    return arrow.schema(fields, metadata=about(plan))


def about(plan: Plan) -> dict[str, str]:
    """What every part says of where it comes from."""
    return {"vffnull": json.dumps({"version": _core.__version__, "study": plan.digest, "name": plan.name})}


def runs_part(plan: Plan, block: Block, outcomes: Sequence[Mapping[str, Any]]) -> Part:
    """The runs of a block.

    Parameters
    ----------
    plan : Plan
        The study.
    block : Block
        The block.
    outcomes : sequence of dict
        How every run ended: status, message, end_time and metrics.
    """
    arrow = extra("pyarrow", "study")
    schema = schema_of(plan)
    runs = range(block.first, block.last)
    places = [plan.place(run) for run in runs]
    columns: dict[str, Any] = {
        "run": runs,
        "point": [place.point for place in places],
        "repetition": [place.repetition for place in places],
        "seed": [plan.seed_of(run) for run in runs],
        "status": [outcome["status"] for outcome in outcomes],
        "message": [outcome["message"] for outcome in outcomes],
        "end_time": [outcome["end_time"] for outcome in outcomes],
    }
    if plan.has_scenes:
        columns["scene"] = [plan.base.name(place.scene) for place in places]
    for i, factor in enumerate(plan.factors):
        columns[factor.name] = factor.column(block.rows[:, i])
    for name in plan.metrics:
        columns[name] = [_finite(outcome["metrics"].get(name)) for outcome in outcomes]
    arrays = [arrow.array(columns[each.name], type=each.type) for each in schema]
    return encoded("runs", block.number, arrow.Table.from_arrays(arrays, schema=schema))


def _finite(value: float | None) -> float | None:
    """A metric, or None where it does not apply, as in a run that diverged."""
    return None if value is None or not np.isfinite(value) else float(value)


def encoded(kind: Kind, block: int, table: pyarrow.Table) -> Part:
    """A table as a part: the bytes of doubles are split before compression, text and counters are listed."""
    arrow, parquet = extra("pyarrow", "study"), extra("pyarrow.parquet", "study")
    doubles = [each.name for each in table.schema if each.type == arrow.float64()]
    others = [each.name for each in table.schema if each.type != arrow.float64()]
    sink = arrow.BufferOutputStream()
    parquet.write_table(
        table, sink, compression="zstd", use_dictionary=others, use_byte_stream_split=doubles or False
    )
    data = sink.getvalue().to_pybytes()
    return Part(kind, block, digest_of(data), data)
