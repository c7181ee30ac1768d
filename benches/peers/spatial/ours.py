"""Ours, run by the core with their defaults: field, cbf, cbf with look-ahead; and Khatib's field of 1986."""

from __future__ import annotations

from peers.spatial.way import Range, Settings, Way
from vffnull.evaluation import CONTROLLERS


def khatib(settings: Settings) -> dict[str, object]:
    """The field on every link without a projection: what it pushes, the hand gives way to."""
    return CONTROLLERS["unprojected field"] | {
        "controller.field.gain": settings["gain"],
        "controller.field.influence": settings["influence"],
        "controller.field.kind": "bounded",
        "controller.null_damping": settings["null_damping"],
        "controller.joint_limit_field.gain": settings["limit_gain"],
    }


WAYS = (
    Way("null-space field", "ours with its defaults", changes=lambda _: CONTROLLERS["null-space field"]),
    Way("cbf", "ours with its defaults", changes=lambda _: CONTROLLERS["cbf"]),
    Way("cbf + preview", "ours with its defaults", changes=lambda _: CONTROLLERS["cbf + preview"]),
    Way(
        "Khatib, unprojected",
        "the field on all links added to the torque of the task without a projection, in the core",
        {"gain": 100.0, "influence": 0.3, "null_damping": 6.0, "limit_gain": 10.0},
        {
            "gain": Range(10.0, 1000.0, log=True),
            "influence": Range(0.05, 0.4),
            "null_damping": Range(1.0, 50.0, log=True),
            "limit_gain": Range(1.0, 50.0, log=True),
        },
        changes=khatib,
    ),
)
