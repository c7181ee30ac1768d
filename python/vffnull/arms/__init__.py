"""Where spatial arms come from: bundled ones, URDF, MJCF, and back.

Everything ends in the same explicit description, the ``[arm]`` table of a scenario that needs no other
file: joints with their links' masses and inertias, limits, and the shapes that are measured against
obstacles. `read_urdf` and `read_mjcf` tell, beside the description, what is odd and how tight the shapes of
the links are.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import vffnull._core as _core

if TYPE_CHECKING:
    from vffnull.arms._capsules import Fit
    from vffnull.arms._export import to_mjcf, to_urdf
    from vffnull.arms._mjcf import from_mjcf, read_mjcf
    from vffnull.arms._report import Report, describe
    from vffnull.arms._urdf import from_urdf, read_urdf

__all__ = [
    "Fit",
    "Report",
    "describe",
    "from_mjcf",
    "from_urdf",
    "named",
    "names",
    "read_mjcf",
    "read_urdf",
    "to_mjcf",
    "to_urdf",
]

# What brings NumPy along is loaded when it is asked for.
_LATER = {
    "Fit": "_capsules",
    "Report": "_report",
    "describe": "_report",
    "from_mjcf": "_mjcf",
    "from_urdf": "_urdf",
    "read_mjcf": "_mjcf",
    "read_urdf": "_urdf",
    "to_mjcf": "_export",
    "to_urdf": "_export",
}


def __getattr__(name: str) -> Any:
    """What is loaded when it is asked for."""
    import importlib

    if name in _LATER:
        return getattr(importlib.import_module(f"vffnull.arms.{_LATER[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def names() -> tuple[str, ...]:
    """The names of the bundled arms."""
    return _core.ARMS


def named(name: str) -> dict[str, Any]:
    """The explicit description of a bundled arm.

    Parameters
    ----------
    name : str
        One of `names`.

    Returns
    -------
    dict
        The ``[arm]`` of a scenario.

    Raises
    ------
    vffnull.errors.InputError
        If there is no such arm; the message lists those that exist.

    Examples
    --------
    >>> arm = named("panda")
    >>> len(arm["joints"]), arm["tip"]
    (7, 'panda_hand_tcp')
    """
    return _core.arm_model(name)
