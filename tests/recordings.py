"""Recordings of an arm before depth cameras, with errors that are known, by rays of NumPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import vffnull as vff
from vffnull._core import matrices, quaternions
from vffnull.logs.ros2 import Recorder

ARM = vff.Arm.named("panda")
MEAN = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.6, 0.8])
SWING = np.array([0.6, 0.25, 0.3, 0.3, 0.5, 0.4, 0.5])
RATES = np.array([1.1, 1.7, 2.1, 1.4, 1.9, 2.3, 1.6])
STATES = 100.0


def motion(t: float) -> tuple[np.ndarray, np.ndarray]:
    """The arm as it swings."""
    return MEAN + SWING * np.sin(RATES * t), SWING * RATES * np.cos(RATES * t)


def looking(position: list[float], at: list[float], size: tuple[int, int] = (96, 72)) -> dict[str, Any]:
    """A camera that looks at a place, upright."""
    columns, rows = size
    forward = np.subtract(at, position) / np.linalg.norm(np.subtract(at, position))
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward], axis=-1)
    focal = 0.8 * columns
    return {
        "columns": columns,
        "rows": rows,
        "focal": [focal, focal],
        "centre": [0.5 * (columns - 1), 0.5 * (rows - 1)],
        "position": list(position),
        "orientation": quaternions(axes).tolist(),
    }


def off(camera: dict[str, Any], moved: Any = (0, 0, 0), turned: Any = (0, 0, 0)) -> dict[str, Any]:
    """The camera as it really stands: moved [m], turned by a rotation vector in the world's axes [rad]."""
    angle = float(np.linalg.norm(turned))
    half = np.array([np.cos(0.5 * angle), *(np.sin(0.5 * angle) * np.array(turned) / (angle or 1.0))])
    axes = matrices(half) @ matrices(np.array(camera["orientation"]))
    place = np.add(camera["position"], moved).tolist()
    return camera | {"position": place, "orientation": quaternions(axes).tolist()}


def rays(camera: dict[str, Any]) -> np.ndarray:
    """Directions with depth 1, (rows, columns, 3)."""
    columns, rows = np.meshgrid(np.arange(camera["columns"]), np.arange(camera["rows"]))
    x, y = ((at - c) / f for at, c, f in zip((columns, rows), camera["centre"], camera["focal"], strict=True))
    return np.stack([x, y, np.ones_like(x)], axis=-1) @ matrices(np.array(camera["orientation"])).T


def capsules(q: np.ndarray) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """The arm: ends and radius of each capsule."""
    poses = dict(zip(ARM.link_names, ARM.link_poses(q), strict=True))
    found = []
    for link, shape in ARM.collision:
        pose = poses.get(link, np.eye(4))
        ends = [pose[:3, :3] @ shape.get(end, shape.get("center")) + pose[:3, 3] for end in "ab"]
        found.append((*ends, shape["radius"]))
    return found


def take(camera: dict[str, Any], things: list[tuple[Any, Any, float]], floor: float = -0.05) -> np.ndarray:
    """Depths [mm] of capsules above a floor, by rays against cylinders and balls; 0 beyond 3 m."""
    along, origin = rays(camera), np.array(camera["position"])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(along[..., 2] < 0.0, (floor - origin[2]) / along[..., 2], np.inf)
        for a, b, radius in things:
            way = np.subtract(b, a)
            length = np.linalg.norm(way)
            for end in (a, b):
                depth = np.minimum(depth, _quadratic(along, origin - end, radius))
            if length > 1e-9:
                axis = way / length
                across = along - (along @ axis)[..., None] * axis
                start = origin - np.asarray(a)
                hit = _quadratic(across, start - axis * (start @ axis), radius)
                share = start @ axis + np.where(np.isfinite(hit), hit, 0.0) * (along @ axis)
                depth = np.where((share >= 0.0) & (share <= length), np.minimum(depth, hit), depth)
    return np.where((depth > 0.0) & (depth < 3.0), np.round(1000.0 * depth), 0.0).astype(np.uint16)


def _quadratic(along: np.ndarray, start: np.ndarray, radius: float) -> np.ndarray:
    a, b, c = (along * along).sum(-1), along @ start, start @ start - radius * radius
    root = b * b - a * c
    hit = (-b - np.sqrt(np.maximum(root, 0.0))) / a
    return np.where((root > 0.0) & (hit > 0.0), hit, np.inf)


def record(
    path: Path,
    cameras: dict[str, dict[str, Any]],
    truth: dict[str, dict[str, Any]],
    *,
    seconds: float = 3.0,
    rate: float = 15.0,
    clock: float = 0.0,
    latency: float = 0.03,
    things: Any = lambda t: [],
    shows: Any = None,
    velocities: bool = True,
    noise: float = 0.0,
    clouds: bool = False,
) -> Path:
    """A recording in which cameras say that they stand at one place, and see from another.

    The time of a picture is `clock` seconds later than when it was taken.
    """
    shows = shows or (lambda camera, q, t: take(camera, [*capsules(q), *things(t)]))
    random = np.random.default_rng(3)
    events: list[tuple[float, int, Any]] = []
    with Recorder(path) as file:
        for topic, camera in cameras.items():
            file.camera(topic, camera, base="panda_link0")
        for k in range(round(seconds * STATES)):
            events.append((k / STATES, 0, None))
        for k in range(round(seconds * rate)):
            events += [((k + 0.5) / rate + latency, 1, topic) for topic in cameras]
        for arrived, kind, topic in sorted(events, key=lambda each: each[:2]):
            if kind == 0:
                q, dq = motion(arrived)
                names = ["finger", *reversed(ARM.joint_names)]  # in an order of its own, and with others
                file.joints(arrived, names, [0.04, *q[::-1]], [0.0, *dq[::-1]] if velocities else None)
                continue
            taken = arrived - latency
            depth = shows(truth[topic], motion(taken)[0], taken)
            if noise:
                metres = 1e-3 * depth
                wrong = noise * metres**2 * random.standard_normal(depth.shape)
                depth = np.where(depth > 0, np.round(1000.0 * (metres + wrong)), 0).astype(np.uint16)
            if clouds:
                flat = cameras[topic] | {"orientation": [1.0, 0.0, 0.0, 0.0]}
                points = (rays(flat) * (1e-3 * depth)[..., None])[depth > 0]
                file.points(f"{topic}/points", taken + clock, points, arrived=arrived)
            else:
                file.picture(topic, taken + clock, depth, arrived=arrived)
    return path
