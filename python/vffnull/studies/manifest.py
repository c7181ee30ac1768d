"""The manifest of a dataset: the study's document, versions, seeds, and what the columns mean."""

from __future__ import annotations

import hashlib
import json
from typing import Any

import numpy as np

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull._support.files import digest
from vffnull.model.document import Document
from vffnull.studies.downsampled import record_schema_of
from vffnull.studies.parts import schema_of
from vffnull.studies.plan import Plan
from vffnull.studies.store import Store

__all__ = ["MANIFEST", "begun", "manifest_of", "read_manifest", "versions"]

MANIFEST = "study.json"
_FORMAT = 1
_SIGNATURE = "signature"  # the digest of all the rest
_LOOKED_AT = 1024  # points, to tell whether a design is the same
_BITS = ("vffnull", "pyarrow")
"""Packages whose versions decide on the bits of parts."""


def versions() -> dict[str, str]:
    """Versions of everything that has a say in a dataset."""
    found = {"vffnull": _core.__version__, "numpy": np.__version__}
    return found | {name: str(extra(name, "study").__version__) for name in ("pyarrow", "scipy")}


def manifest_of(plan: Plan) -> Document:
    """What the manifest says; the same for the same study, whenever and wherever it is run."""

    def described(schema: Any) -> Document:
        return {
            each.name: {name.decode(): text.decode() for name, text in (each.metadata or {}).items()}
            for each in schema
        }

    document: Document = {
        "format": _FORMAT,
        "digest": plan.digest,
        "versions": versions(),
        "tuned": plan.design is None,
        "study": plan.to_dict(),
        "seeds": "numpy.random.SeedSequence(seed, spawn_key=(1, run)).generate_state(1, uint64) >> 1; "
        'the repetition in the place of the run with seeds = "repetition"',
        "columns": described(schema_of(plan)),
    }
    if plan.records is not None:
        document["records"] = described(record_schema_of(plan))
    if plan.design is not None:
        document |= {"runs": plan.runs, "blocks": plan.blocks, "design": _design_digest(plan)}
    return document


def _design_digest(plan: Plan) -> str:
    """What tells a design from one of another version of SciPy."""
    assert plan.design is not None
    rows = plan.design.rows(0, min(plan.points, _LOOKED_AT))
    return hashlib.sha256(np.ascontiguousarray(rows).tobytes()).hexdigest()[:16]


def read_manifest(store: Store) -> Document | None:
    """The manifest of a dataset; None if there is none.

    Raises
    ------
    vffnull.errors.InputError
        If it cannot be read.
    """
    try:
        text = store.read(MANIFEST)
    except FileNotFoundError:
        return None
    try:
        found: Any = json.loads(text)
        known = found["format"] == _FORMAT
        signature = found.pop(_SIGNATURE, None)  # datasets of older versions have none
        if signature not in (None, digest(json.dumps(found), ())):
            raise ValueError
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError):
        raise InputError(f"{store.place}: {MANIFEST} is damaged, or no manifest of a study") from None
    if not known:
        raise InputError(
            f"{store.place}: a dataset of format {found['format']}, which this version does not know"
        )
    return found  # type: ignore[no-any-return]


def begun(plan: Plan, store: Store) -> bool:
    """Whether the dataset of this study has been begun there; otherwise its manifest is written.

    Raises
    ------
    vffnull.errors.InputError
        If it is the dataset of another study, or of other versions.
    """
    mine, there = manifest_of(plan), read_manifest(store)
    if there is None:
        signed = mine | {_SIGNATURE: digest(json.dumps(mine), ())}
        text = json.dumps(signed, indent=1, ensure_ascii=False)
        store.write(MANIFEST, text.encode())
        return False
    if there["digest"] != mine["digest"]:
        differing = [
            key
            for key in dict.fromkeys([*mine["study"], *there["study"]])
            if key not in ("name", "description") and mine["study"].get(key) != there["study"].get(key)
        ]
        if mine["tuned"] != there["tuned"]:
            kind = "tuning" if there["tuned"] else "design"
            raise InputError(
                f"{store.place}: holds the runs of a {kind} of a study; choose another directory"
            )
        what = f"in {', '.join(f'`{key}`' for key in differing)}" if differing else "in details"
        raise InputError(
            f"{store.place}: holds another study, which differs {what}; choose another directory"
        )
    for name in _BITS:
        if there["versions"].get(name) != mine["versions"][name]:
            raise InputError(
                f"{store.place}: was begun with {name} {there['versions'].get(name)}, and this is "
                f"{mine['versions'][name]}: the bits might differ; finish it with the former, or begin anew"
            )
    if there.get("design") != mine.get("design"):
        raise InputError(
            f"{store.place}: SciPy {mine['versions']['scipy']} makes another design than "
            f"{there['versions'].get('scipy')}, with which it was begun"
        )
    return True
