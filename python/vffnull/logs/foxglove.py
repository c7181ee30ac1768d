"""Foxglove's own messages as JSON: transforms between frames, and solids that move with a frame.

Names and meaning are those of https://docs.foxglove.dev/docs/sdk/schemas. Solids are sent once, at the first
instant, and never expire: a viewer moves them with their frames. Foxglove makes its own types of the schemas,
so they list every field; of primitives that are never sent only the name.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from vffnull._core import quaternions
from vffnull.logs.frames import Box, Capsule, Frame, Mesh, Tree, axes_of, opacity, rgb

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vffnull.logs.frames import Array

Message = dict[str, Any]


def nanoseconds(t: Array) -> NDArray[np.int64]:
    """Times [ns] of times [s]."""
    return np.rint(t * 1e9).astype(np.int64)


def transforms(tree: Tree) -> Iterator[tuple[int, Message]]:
    """The frames of every instant, with its time [ns]; all of them, so that any one message is enough."""
    columns = [
        (each.parent, each.name, each.poses[:, :3, 3].tolist(), quaternions(each.poses[:, :3, :3]).tolist())
        for each in tree.frames
    ]
    for row, time in enumerate(nanoseconds(tree.t).tolist()):
        stamp = _stamp(time)
        yield (
            time,
            {
                "transforms": [
                    {
                        "timestamp": stamp,
                        "parent_frame_id": parent,
                        "child_frame_id": child,
                        "translation": _vector(places[row]),
                        "rotation": _turn(turns[row]),
                    }
                    for parent, child, places, turns in columns
                ]
            },
        )


def scene_update(tree: Tree, frames: Iterable[Frame]) -> tuple[int, Message]:
    """What some frames carry, with the time [ns] from which on it is there."""
    time = int(nanoseconds(tree.t[:1])[0])
    entities = [_entity(each, _stamp(time), tree.reach) for each in frames]
    return time, {"deletions": [], "entities": entities}


def _entity(frame: Frame, stamp: Message, reach: float) -> Message:
    primitives: dict[str, list[Message]] = {name: [] for name in (*_PRIMITIVES, *_UNUSED)}
    for solid in frame.solids:
        colour = _colour(rgb(frame.role), opacity(solid))
        match solid:
            case Capsule(a=a, b=b, radius=radius):
                for end in (a, b) if solid.length else (a,):
                    ball = {"pose": _pose(end), "size": _vector([2 * radius] * 3), "color": colour}
                    primitives["spheres"].append(ball)
                if solid.length:
                    rod = {
                        "pose": _pose((a + b) / 2, solid.axes),
                        "size": _vector([2 * radius, 2 * radius, solid.length]),
                        "bottom_scale": 1.0,
                        "top_scale": 1.0,
                        "color": colour,
                    }
                    primitives["cylinders"].append(rod)
            case Box(center=center, axes=axes, size=size):
                cube = {"pose": _pose(center, axes), "size": _vector(size), "color": colour}
                primitives["cubes"].append(cube)
            case Mesh(vertices=vertices, triangles=triangles):
                surface = {
                    "pose": _pose(np.zeros(3)),
                    "points": [_vector(each) for each in vertices],
                    "color": colour,
                    "colors": [],
                    "indices": triangles.ravel().tolist(),
                }
                primitives["triangles"].append(surface)
    for end, shade in axes_of(frame, reach):
        line = {
            "type": 0,
            "pose": _pose(np.zeros(3)),
            "thickness": 0.015 * reach,
            "scale_invariant": False,
            "points": [_vector(np.zeros(3)), _vector(end)],
            "color": _colour(shade),
            "colors": [],
            "indices": [],
        }
        primitives["lines"].append(line)
    return {
        "timestamp": stamp,
        "frame_id": frame.name,
        "id": frame.name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
        "metadata": [],
        **primitives,
    }


def _stamp(time: int) -> Message:
    return {"sec": time // 1_000_000_000, "nsec": time % 1_000_000_000}


def _vector(values: Any) -> Message:
    x, y, z = (float(each) for each in values)
    return {"x": x, "y": y, "z": z}


def _turn(orientation: Iterable[float]) -> Message:
    w, x, y, z = (float(each) for each in orientation)
    return {"x": x, "y": y, "z": z, "w": w}


def _pose(position: Array, axes: Array | None = None) -> Message:
    return {
        "position": _vector(position),
        "orientation": _turn(quaternions(np.eye(3) if axes is None else axes)),
    }


def _colour(shade: tuple[float, float, float], a: float = 1.0) -> Message:
    r, g, b = shade
    return {"r": r, "g": g, "b": b, "a": a}


# ------------------------------------------------------------------------------------------------- schemas


def _object(**properties: Message) -> Message:
    return {"type": "object", "properties": properties}


def _list(items: Message) -> Message:
    return {"type": "array", "items": items}


_NUMBER, _TEXT, _FLAG, _COUNT = ({"type": kind} for kind in ("number", "string", "boolean", "integer"))
_TIME = _object(sec=_COUNT, nsec=_COUNT)
_VECTOR = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object(position=_VECTOR, orientation=_QUATERNION)
_COLOUR = _object(r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_POINTS = {"points": _list(_VECTOR), "color": _COLOUR, "colors": _list(_COLOUR), "indices": _list(_COUNT)}
_PRIMITIVES = {
    "cubes": _object(pose=_POSE, size=_VECTOR, color=_COLOUR),
    "spheres": _object(pose=_POSE, size=_VECTOR, color=_COLOUR),
    "cylinders": _object(pose=_POSE, size=_VECTOR, bottom_scale=_NUMBER, top_scale=_NUMBER, color=_COLOUR),
    "lines": _object(type=_COUNT, pose=_POSE, thickness=_NUMBER, scale_invariant=_FLAG, **_POINTS),
    "triangles": _object(pose=_POSE, **_POINTS),
}
_UNUSED = ("arrows", "texts", "models")

FRAME_TRANSFORMS = _object(
    transforms=_list(
        _object(
            timestamp=_TIME,
            parent_frame_id=_TEXT,
            child_frame_id=_TEXT,
            translation=_VECTOR,
            rotation=_QUATERNION,
        )
    )
)
"""The JSON Schema of ``foxglove.FrameTransforms``."""

SCENE_UPDATE = _object(
    deletions=_list(_object(timestamp=_TIME, type=_COUNT, id=_TEXT)),
    entities=_list(
        _object(
            timestamp=_TIME,
            frame_id=_TEXT,
            id=_TEXT,
            lifetime=_TIME,
            frame_locked=_FLAG,
            metadata=_list(_object(key=_TEXT, value=_TEXT)),
            **{name: _list(each) for name, each in _PRIMITIVES.items()},
            **{name: _list(_object()) for name in _UNUSED},
        )
    ),
)
"""The JSON Schema of ``foxglove.SceneUpdate``."""
