"""The keys of scenarios by their dotted names, for suggestions and completion."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any

import vffnull._core as _core

__all__ = ["known", "nearest", "written"]


@cache
def known(space: bool = True) -> tuple[str, ...]:
    """Every key of the schema, in space too or not; keys in a list as ``obstacles.0.position``."""
    schema = _core.schema()
    if not space:
        schema = schema.partition("\n# Arms in space\n")[0]
    found: dict[str, list[str]] = {"": []}
    table, rows = "", False
    for line in schema.splitlines():
        if heading := re.match(r"##+ (?:\[(\[?)([\w.]+)\]+|(.*))", line):
            if heading[2]:
                table = re.sub(r"^(obstacles|wrenches)(?=\.)", r"\1.0", heading[2])
                table += ".0" if heading[1] else ""
                found.setdefault(table, [])
            elif heading[3].startswith("kind ="):
                found[table].append("kind")
            rows = False
        elif same := re.search(r"Keys as in `\[([\w.]+)\]`", line):
            found[table] += found.get(same[1], []) or [f"@{same[1]}"]
        elif re.match(r"    key +", line):
            rows = True
        elif rows and (row := re.match(r"    (\w+)", line)):
            found[table].append(row[1])
        elif rows and not line.strip():
            rows = False
    names: dict[str, None] = {}
    for table, keys in found.items():
        inside = [name for key in keys for name in (found[key[1:]] if key.startswith("@") else [key])]
        names |= dict.fromkeys(f"{table}.{key}" if table else key for key in inside)
    return tuple(names)


def written(document: Mapping[str, Any], start: str = "") -> Iterator[str]:
    """The dotted names of everything in a document."""
    for key, value in document.items():
        name = f"{start}.{key}" if start else str(key)
        yield name
        if isinstance(value, Mapping):
            yield from written(value, name)
        elif isinstance(value, list) and value and all(isinstance(each, Mapping) for each in value):
            for i, each in enumerate(value):
                yield from written(each, f"{name}.{i}")


def nearest(name: str, document: Mapping[str, Any]) -> list[str]:
    """What a key that does not exist may have meant: keys that end in the same word, or in a similar one.

    Those that the document has come first.
    """
    arm = document.get("arm")
    space = isinstance(arm, Mapping) and not arm.keys().isdisjoint(("model", "urdf", "mjcf", "joints"))
    every = [each for each in dict.fromkeys([*written(document), *known(space)]) if each != name]
    last = name.rpartition(".")[2]
    words = [each.rpartition(".")[2] for each in every]
    if last not in words:
        last = next(iter(difflib.get_close_matches(last, words, n=1, cutoff=0.75)), "")
    return [each for each, word in zip(every, words, strict=True) if word == last][:3]
