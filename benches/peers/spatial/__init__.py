"""Other libraries' ways to avoid, and ours, on the same random scenes in space.

One file per way, each with a tuple ``WAYS`` of `peers.spatial.way.Way`; ``python benches/peers/space.py``
runs those that can drive the arms of a group (`peers.spatial.group`), and with ``--tune`` finds their
settings on training seeds first.
"""

from __future__ import annotations

from importlib import import_module

from peers.spatial.group import Group
from peers.spatial.way import Way


def load(group: Group) -> list[Way]:
    """Every way that drives a group's arms, ours first; ends the program if one is not what it must be."""
    try:
        modules = [import_module(f"peers.spatial.{name}") for name in group.modules]
    except ImportError as error:
        raise SystemExit(f"{error}: the peers need `pip install '.[peers]'`") from error
    for module in modules:
        for arm in group.arms:
            getattr(module, "check", lambda _: None)(arm)
    everybody = [way for module in modules for way in module.WAYS if set(group.arms) <= set(way.arms)]
    return [way for way in everybody if not group.ways or way.name in group.ways]
