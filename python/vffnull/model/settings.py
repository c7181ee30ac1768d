"""What a document says of a setting, or the core's default: no default stands in Python."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import vffnull._core as _core

__all__ = ["default", "setting"]


def setting(document: Mapping[str, Any], path: str) -> Any:
    """What a scenario document says at a key, or else the default of the key.

    Parameters
    ----------
    document : mapping
        A scenario.
    path : str
        The dotted path of a key that has a default.

    Raises
    ------
    KeyError
        If there is no such key, or if it has no default.

    Examples
    --------
    >>> setting({"simulation": {"dt": 0.002}}, "simulation.dt")
    0.002
    >>> setting({}, "simulation.dt")
    0.001
    """
    table, _, key = path.rpartition(".")
    inside: Any = document
    for name in table.split("."):
        inside = inside.get(name, {})
    return inside[key] if key in inside else default(path)


@functools.cache
def default(path: str) -> Any:
    """The core's default of a key, by its dotted path, which leads through lists to the key of each entry.

    Raises
    ------
    KeyError
        If there is no such key, or if it has no default.
    """
    found = _schema()
    for name in path.split("."):
        found = found.get("items", found)["properties"][name]
    return found["default"]


@functools.cache
def _schema() -> dict[str, Any]:
    """The JSON Schema of scenarios in the plane, whose settings are those in space, too."""
    import json  # here, because not every program that imports this asks

    schema: dict[str, Any] = json.loads(_core.schema_json())["else"]
    return schema
