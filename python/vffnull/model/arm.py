"""Arms as documents describe them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import vffnull._core as _core

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

__all__ = ["arm_of", "is_spatial", "listed", "unshaped"]

_KEYS = ("model", "urdf", "mjcf", "joints")


def is_spatial(arm: Mapping[str, Any]) -> bool:
    """Whether an ``[arm]`` table is of an arm in space."""
    return any(key in arm for key in _KEYS)


def dimension_of(arm: Mapping[str, Any]) -> int:
    """How many dimensions the space of an ``[arm]`` table has."""
    return 3 if is_spatial(arm) else 2


def arm_of(arm: Mapping[str, Any]) -> Any:
    """The arm of an ``[arm]`` table, of a document that has been checked."""
    if not is_spatial(arm):
        return _core.Arm(**arm)
    made: Any = _core.Arm  # what pickles are made of has no place in the stub
    return made._from_dict(arm)


def unshaped(arm: Mapping[str, Any]) -> list[str]:
    """The links that joints move and nothing avoids, for they have no shape, of an arm in space."""
    if not is_spatial(arm):
        return []
    if "joints" not in arm:
        arm = _core.arm_model(arm["model"]) | dict(arm)
    there = {body["link"] for body in arm.get("collision", ())}
    links = [joint.get("link") or joint["name"] for joint in arm["joints"]]
    return [link for link in links if link not in there]


def listed(words: Sequence[str]) -> str:
    """Words as text: a, b and c."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def frame(placed: Mapping[str, Any]) -> NDArray[np.float64]:
    """A homogeneous matrix (4, 4) of a ``position`` [m] and an ``orientation`` [w, x, y, z]."""
    import numpy as np

    made = np.eye(4)
    made[:3, :3] = _core.matrices(placed.get("orientation", (1.0, 0.0, 0.0, 0.0)))
    made[:3, 3] = placed.get("position", (0.0, 0.0, 0.0))
    return made
