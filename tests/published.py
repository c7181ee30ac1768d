"""The URDFs of the wheels that are installed, and how Pinocchio reads them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

pin = pytest.importorskip("pinocchio")

__all__ = ["MODELS", "chains", "coordinates", "pin", "reduced_to"]

Array = NDArray[np.float64]


def _published() -> list[Path]:
    from importlib.metadata import PackageNotFoundError, files

    found = []
    for wheel in ("example-robot-data", "pyroboplan"):
        try:
            found += [Path(str(file.locate())) for file in files(wheel) or () if file.suffix == ".urdf"]
        except PackageNotFoundError:
            pass
    return sorted(found)


MODELS = _published()


def chains(model: Any) -> Iterator[str]:
    """The links at the ends of a model."""
    bodies = [frame for frame in model.frames if frame.type == pin.FrameType.BODY]
    parents = {model.frames[frame.parentFrame].name for frame in model.frames}
    inner = {model.frames[model.frames[frame.parentFrame].parentFrame].name for frame in bodies}
    yield from (frame.name for frame in bodies if frame.name not in parents and frame.name not in inner)


def coordinates(model: Any, q: Array) -> Array:
    """Joint positions as Pinocchio writes them: a continuous joint has (cos, sin)."""
    return np.asarray(pin.integrate(model, pin.neutral(model), np.asarray(q, dtype=float)))


def reduced_to(model: Any, arm: Mapping[str, Any], locked: Mapping[str, float]) -> Any:
    """The model with nothing that moves but the joints of an arm; those that are `locked` stand so."""
    reference = pin.neutral(model)
    for name, value in locked.items():
        joint = model.joints[model.getJointId(name)]
        where = [np.cos(value), np.sin(value)] if joint.nq == 2 else [value]
        reference[joint.idx_q : joint.idx_q + joint.nq] = where
    kept = [joint["name"] for joint in arm["joints"]]
    fixed = [i for i in range(1, model.njoints) if model.names[i] not in kept]
    try:
        reduced = pin.buildReducedModel(model, fixed, reference) if fixed else model
    except ValueError as fault:  # a link named like a joint
        pytest.skip(f"Pinocchio cannot reduce it: {fault}")
    assert list(reduced.names)[1:] == kept
    return reduced
