"""The controllers that are compared, each as what it changes of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from vffnull._support.errors import InputError, InputTypeError

__all__ = ["CONTROLLERS", "chosen"]

CONTROLLERS: dict[str, dict[str, Any]] = {
    "no avoidance": {"controller.field.gain": 0.0},
    "unprojected field": {"controller.projection": "none"},  # Khatib 1986
    "null-space field": {},
    "relaxed": {"controller.avoidance": "relaxed"},
    "priority": {"controller.avoidance": "priority"},
    "cbf": {"controller.avoidance": "cbf"},
    "cbf + preview": {"controller.avoidance": "cbf", "controller.yielding.preview": {}},
}
"""What each controller changes of a scene."""


def chosen(given: Iterable[str] | Mapping[str, Mapping[str, Any]] | None) -> dict[str, dict[str, Any]]:
    """Controllers out of `CONTROLLERS` by name, all of them for None, or the caller's own."""
    if given is None:
        return dict(CONTROLLERS)
    if isinstance(given, Mapping):
        return {str(name): dict(changes) for name, changes in given.items()}
    if isinstance(given, str):
        given = [given]
    if not isinstance(given, Iterable):
        raise InputTypeError(f"controllers: expected names or a dict, not a {type(given).__name__}")
    found = {}
    for name in given:
        if name not in CONTROLLERS:
            raise InputError(f"controllers: expected some of {', '.join(CONTROLLERS)}, not {name!r}")
        found[name] = CONTROLLERS[name]
    if not found:
        raise InputError("controllers: at least one is needed")
    return found
