"""BVH motion-capture files: a skeleton and its angles become places of joints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from vffnull._support.errors import InputError
from vffnull._support.files import read_text

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["read"]

MAX_BYTES = 200_000_000
MAX_JOINTS = 1000
_CHANNELS = {f"{axis}{kind}" for axis in "XYZ" for kind in ("position", "rotation")}


@dataclass
class _Joint:
    name: str
    parent: int
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)
    channels: list[str] = field(default_factory=list)


def read(path: Path) -> tuple[list[str], list[int], Array, Array]:
    """Names and parents of the joints (−1: none), instants (T,) [s], places (T, J, 3) in the file's units.

    The ends of limbs are joints, too, called after the one that they belong to. Rotations act in the order
    of their channels, the first outermost; where a joint has channels for its position, these take the place
    of its offset.

    Raises
    ------
    vffnull.errors.InputError
        If it is no such file; the message names the line.
    """
    import numpy as np

    lines = enumerate(read_text(path, MAX_BYTES, errors="replace").splitlines(), start=1)
    words = ((k, line.split()) for k, line in lines if line.strip())
    joints = _hierarchy(path.name, words)
    k, given = next(words, (0, []))
    if given[:1] != ["Frames:"] or len(given) != 2 or not given[1].isdigit():
        raise InputError(f"{path.name}, line {k}: expected 'Frames:' and their number")
    frames = int(given[1])
    k, given = next(words, (k, []))
    if given[:2] != ["Frame", "Time:"] or len(given) != 3:
        raise InputError(f"{path.name}, line {k}: expected 'Frame Time:' and seconds")
    (period,) = _numbers(path.name, k, given[2:])
    if not period > 0.0:
        raise InputError(f"{path.name}, line {k}: frames must be apart, got {period} s")
    count = sum(len(joint.channels) for joint in joints)
    rows = []
    for k, row in words:
        if len(row) != count:
            raise InputError(
                f"{path.name}, line {k}: expected {count} numbers, one per channel, got {len(row)}"
            )
        rows.append(_numbers(path.name, k, row))
    if len(rows) != frames or not rows:
        raise InputError(f"{path.name}: {frames} frames are promised, {len(rows)} are there")
    places = _places(joints, np.array(rows))
    names = [joint.name for joint in joints]
    times: Array = period * np.arange(frames, dtype=float)
    return names, [joint.parent for joint in joints], times, places


def _hierarchy(name: str, words: Iterator[tuple[int, list[str]]]) -> list[_Joint]:
    """The joints, each after its parent, up to the line ``MOTION``."""
    joints: list[_Joint] = []
    open_joints: list[int] = []
    k, given = next(words, (0, []))
    if given != ["HIERARCHY"]:
        raise InputError(f"{name}, line {k}: expected HIERARCHY: is this a BVH file?")
    pending = False
    for k, line in words:
        match line:
            case ["ROOT" | "JOINT", called] | ["End", "Site" as called] if not pending:
                if len(joints) == MAX_JOINTS:
                    raise InputError(f"{name}, line {k}: more than {MAX_JOINTS} joints")
                if (line[0] == "ROOT") == bool(open_joints):
                    raise InputError(f"{name}, line {k}: {line[0]} {called} is in no place for it")
                parent = open_joints[-1] if open_joints else -1
                joints.append(_Joint(f"{joints[parent].name} end" if line[0] == "End" else called, parent))
                pending = True
            case ["{"] if pending:
                open_joints.append(len(joints) - 1)
                pending = False
            case ["OFFSET", *offset] if open_joints and len(offset) == 3 and not pending:
                joints[open_joints[-1]].offset = tuple(_numbers(name, k, offset))
            case ["CHANNELS", count, *channels] if (
                open_joints and count == str(len(channels)) and not pending
            ):
                if not set(channels) <= _CHANNELS or len(set(channels)) != len(channels):
                    raise InputError(f"{name}, line {k}: unknown or repeated channels")
                joints[open_joints[-1]].channels = channels
            case ["}"] if open_joints and not pending:
                open_joints.pop()
            case ["MOTION"] if joints and not open_joints and not pending:
                return joints
            case _:
                raise InputError(f"{name}, line {k}: {' '.join(line)[:60]!r} was not expected")
    raise InputError(f"{name}: ends before MOTION")


def _numbers(name: str, k: int, words: list[str]) -> list[float]:
    import math

    try:
        found = [float(word) for word in words]
    except ValueError:
        found = [math.nan]
    if not all(map(math.isfinite, found)):
        raise InputError(f"{name}, line {k}: expected finite numbers")
    return found


def _places(joints: list[_Joint], rows: Array) -> Array:
    """Where the joints are (T, J, 3), by the chain of their rotations."""
    import numpy as np

    places = np.zeros((len(rows), len(joints), 3))
    turns = np.zeros((len(joints), len(rows), 3, 3))
    column = 0
    for j, joint in enumerate(joints):
        local = np.tile(np.array(joint.offset), (len(rows), 1))
        turn = np.tile(np.eye(3), (len(rows), 1, 1))
        for channel in joint.channels:
            axis = "XYZ".index(channel[0])
            if channel.endswith("position"):
                local[:, axis] = rows[:, column]
            else:
                turn = turn @ _about(axis, np.radians(rows[:, column]))
            column += 1
        if joint.parent < 0:
            places[:, j], turns[j] = local, turn
        else:
            before = turns[joint.parent]
            places[:, j] = places[:, joint.parent] + np.einsum("tij,tj->ti", before, local)
            turns[j] = before @ turn
    return places


def _about(axis: int, angle: Array) -> Array:
    """Rotation matrices (T, 3, 3) about a coordinate axis."""
    import numpy as np

    made = np.zeros((len(angle), 3, 3))
    made[:, axis, axis] = 1.0
    i, j = (axis + 1) % 3, (axis + 2) % 3
    made[:, i, i] = made[:, j, j] = np.cos(angle)
    made[:, j, i] = np.sin(angle)
    made[:, i, j] = -np.sin(angle)
    return made
