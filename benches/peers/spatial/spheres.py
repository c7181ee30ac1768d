"""The spheres on the links of an arm that stand for its shape where a barrier wants spheres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import vffnull as vff
from peers.spatial.panda_spheres import SPHERES
from peers.spatial.task import Array

SPACING = 0.5  # of a capsule's radius, between the spheres along it


@dataclass(frozen=True)
class Spheres:
    """Link of every sphere, its centre in that link's frame (s, 3) and its radius (s,) [m]."""

    link: Array
    center: Array
    radius: Array


def as_placed(arm: vff.Arm) -> Spheres:
    """Those that the authors of OSCBF placed, by the names of a Panda's links."""
    names = arm.link_names
    if not set(SPHERES) <= set(names):
        raise ValueError("the authors of OSCBF have placed spheres on a Panda alone")
    return _made([(names.index(link), *each) for link, placed in SPHERES.items() for each in placed])


def along_capsules(arm: vff.Arm) -> Spheres:
    """Spheres along the capsules by which collisions are judged, so close that they miss 3 % of a radius."""
    names, placed = arm.link_names, []
    for link, shape in arm.collision:
        if link not in names:
            continue  # the base
        a, b = (np.array(shape.get(end, shape.get("center")), dtype=float) for end in "ab")
        count = 1 + int(np.ceil(np.linalg.norm(b - a) / (SPACING * shape["radius"])))
        for share in np.linspace(0.0, 1.0, count):
            placed.append((names.index(link), a + share * (b - a), shape["radius"]))
    return _made(placed)


def _made(placed: list[tuple[int, object, float]]) -> Spheres:
    link, center, radius = zip(*placed, strict=True)
    return Spheres(np.array(link), np.array(center, dtype=float), np.array(radius, dtype=float))


def uncovered(arm: vff.Arm, spheres: Spheres) -> Array:
    """How far the capsules of every link stick out of its own spheres at most (n,) [m]."""
    rng, found = np.random.default_rng(0), np.zeros(arm.n)
    for link, shape in arm.collision:
        if link not in arm.link_names:
            continue
        i = arm.link_names.index(link)
        a, b = (np.array(shape.get(end, shape.get("center")), dtype=float) for end in "ab")
        outward = rng.standard_normal((4000, 3))
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        share = rng.random(4000)
        # What points beyond an end belongs to the cap there, what points across to the side.
        across = outward @ (b - a)
        share = np.where(across > 0.0, 1.0, np.where(across < 0.0, 0.0, share))
        sideways = outward - np.outer(across / max(float((b - a) @ (b - a)), 1e-12), b - a)
        sideways /= np.linalg.norm(sideways, axis=1, keepdims=True)
        points = np.concatenate(
            [
                a + share[:, None] * (b - a) + shape["radius"] * outward,
                a + rng.random((4000, 1)) * (b - a) + shape["radius"] * sideways,
            ]
        )
        own = spheres.link == i
        apart = np.linalg.norm(points[:, None] - spheres.center[own], axis=2) - spheres.radius[own]
        found[i] = max(found[i], float(apart.min(axis=1).max()))
    return found
