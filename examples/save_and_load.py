"""
Save a run and load it again
============================

The ending says which kind of file. All of these come back bit by bit, with the scenario and the version
inside. Needs ``pip install ".[io]"`` for Parquet and Arrow.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import vffnull as vff
from vffnull.draw import style

result = vff.simulate("panda-cup")
sizes = {}
with TemporaryDirectory() as directory:
    for ending in ("csv", "npz", "arrow", "parquet"):
        path = result.save(Path(directory) / f"run.{ending}")
        again = vff.Result.load(path)
        assert all(np.array_equal(again.recorded()[key], value) for key, value in result.recorded().items())
        assert again.scenario == result.scenario
        sizes[ending] = path.stat().st_size / 1e6
        print(f".{ending:8} {sizes[ending]:5.2f} MB")

with style.look():
    fig = style.figure(1.7, 4.6)
    ax = fig.subplots()
    bars = ax.barh([f".{ending}" for ending in sizes], list(sizes.values()), color="#0072B2", height=0.6)
    ax.bar_label(bars, fmt="%.1f MB", padding=3, fontsize=7.5)
    ax.set_xlim(0.0, 1.15 * max(sizes.values()))
    ax.set_xlabel(f"size of {len(result.t)} instants [MB]")
    ax.grid(False)
    fig.savefig("save_and_load.png")
