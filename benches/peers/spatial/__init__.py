"""Other libraries' ways to avoid, and ours, on the same random scenes in space.

One file per way, each with a tuple ``WAYS`` of `peers.spatial.way.Way`; ``python benches/peers/space.py``
runs all of them, and with ``--tune`` finds their settings on training seeds first.
"""

from __future__ import annotations

from importlib import import_module

from peers.spatial.way import Way

MODULES = ("ours", "with_mink", "oscbf")


ARM = "panda"  # OSCBF's authors have placed spheres on no other arm


def load() -> list[Way]:
    """Every way, ours first; ends the program where one is not what it should be."""
    try:
        modules = [import_module(f"peers.spatial.{name}") for name in MODULES]
    except ImportError as error:
        raise SystemExit(f"{error}: the peers need `pip install '.[peers]'`") from error
    for module in modules:
        getattr(module, "check", lambda _: None)(ARM)
    return [way for module in modules for way in module.WAYS]
