"""The same closed loop in other libraries.

One file per library, each with a tuple ``PEERS`` of `peers.peer.Peer`. ``python benches/peers/run.py`` checks
that those that should make our trajectory do, times all of them and writes docs/speed.md and its figure.
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "benches"), str(ROOT / "tests")]  # scene.py and oracle.py

from peers.peer import Peer  # noqa: E402

MODULES = ("ours", "dense_numpy", "with_pinocchio", "with_mujoco", "osc", "with_mink")


def load() -> list[Peer]:
    """Every peer, ours first."""
    try:
        return [peer for name in MODULES for peer in import_module(f"peers.{name}").PEERS]
    except ImportError as error:
        raise SystemExit(f"{error}: the peers need `pip install '.[peers]'`") from error
