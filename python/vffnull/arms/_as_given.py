"""The shapes of a model as they are in its file, or as little larger as a shape can be that is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import vffnull._core as _core
from vffnull._support.errors import InputError
from vffnull._support.extras import extra
from vffnull.arms._capsules import Fit, Solid, volume
from vffnull.arms._frames import matrix
from vffnull.arms._hulls import Hull
from vffnull.arms._kept import keep, kept, key_of
from vffnull.arms._pieces import WAY, enclosing, outside

__all__ = ["as_given", "joined", "name_of"]

Array = NDArray[np.float64]
Item = Mapping[str, Any]

SIDES = 16
"""Of the prism around a cylinder."""
APART = 1e-4
"""How far a ball may be from the end of a cylinder that it makes a capsule with, as a share of the radius."""
ROUNDING = 1e-9
"""What is nearer than that share of the radius is there."""


def name_of(item: Item) -> str:
    """What a form of a file is called in messages."""
    form = item["form"]
    return f"{item['link']}: {form.get('file', form['kind'])}"


def as_given(item: Item, solid: Solid, pieces: int = 1) -> list[Fit]:
    """The least of the shapes that can be measured around one form of a file.

    Boxes, balls and capsules are what they are. A cylinder becomes the prism of 16 sides around it, which has
    1.3 % more volume and reaches 2 % of the radius beyond it, or a capsule if it is so long that this has
    less volume. Of a mesh it is the convex hull, or those of its pieces; one of more than 64 corners is
    replaced by a larger one of at most 64.

    Parameters
    ----------
    item : Mapping
        The form, and its frame in that of the link that carries it.
    solid : Solid
        What it is made of, in the frame of that link.
    pieces : int
        The most hulls that a mesh may become.

    Raises
    ------
    ImportError
        Without SciPy, for a mesh without trimesh, or for pieces without CoACD.
    vffnull.errors.InputError
        If a mesh is flat, or CoACD cannot cut it.
    """
    form, place = item["form"], item["frame"]
    own = taken = solid.hull or 0.0
    shape: dict[str, Any]
    match form["kind"]:
        case "mesh":
            return _hulls_of(item, solid, pieces)
        case "cylinder":
            shape, taken = _around_cylinder(form, place)
        case "box":
            shape = {"kind": "box", "center": place["position"], "size": form["size"]}
            shape["orientation"] = place["orientation"]
        case "sphere":
            shape = {"kind": "sphere", "center": place["position"], "radius": form["radius"]}
        case _:
            a, b = solid.points.tolist()
            shape = {"kind": "capsule", "a": a, "b": b, "radius": form["radius"]}
    parts = tuple(item.get("parts", [solid.name]))
    return [Fit(item["on"], parts, shape, taken, own, 0.0, len(solid.points), own)]


def _hulls_of(item: Item, solid: Solid, pieces: int) -> list[Fit]:
    """The hulls of a mesh; those of several pieces are kept, as to cut takes long."""
    key = key_of(f"{item['on']} in {pieces} pieces, {WAY}", [solid]) if pieces > 1 else None
    if key is not None and (found := kept(key)) is not None:
        return found
    surface = extra("trimesh", "meshes").Trimesh(solid.points, solid.triangles, process=True)
    try:
        hulls = enclosing(surface, pieces)
        for hull in hulls:
            _core.hull(hull.corners)  # what is thinner than it takes
    except (extra("scipy.spatial", "meshes").QhullError, ValueError) as error:
        if isinstance(error, InputError):
            raise InputError(f"{name_of(item)}: {error}") from error
        raise InputError(f"{name_of(item)} is flat: it has no hull; use collision='fit'") from error
    own = (abs(float(surface.volume)) or None) if surface.is_watertight else None
    one, total = Hull(solid.points).volume, sum(hull.volume for hull in hulls)
    out, count = outside(hulls, surface), len(solid.points)
    fits = []
    for hull in hulls:
        shape = {"kind": "convex", "vertices": hull.corners.tolist()}
        share = hull.volume / total
        of_file = None if own is None else share * own
        fits.append(Fit(item["on"], (solid.name,), shape, hull.volume, share * one, out, count, of_file))
    if key is not None:
        keep(key, fits)
    return fits


def _around_cylinder(form: Mapping[str, Any], place: Mapping[str, Any]) -> tuple[dict[str, Any], float]:
    """The prism around a cylinder, or of a very long one the capsule, and its volume [m³]."""
    radius, length = form["radius"], form["length"]
    turn, middle = matrix(place["orientation"]), np.array(place["position"])
    prism, rod = (
        solid.moved(turn, middle)
        for solid in (Solid.cylinder("", radius, length, SIDES), Solid.capsule("", radius, length))
    )
    around, (a, b) = Hull(prism.points).volume, rod.points
    if volume(a, b, radius) < around:
        shape = {"kind": "capsule", "a": a.tolist(), "b": b.tolist(), "radius": radius}
        return shape, volume(a, b, radius)
    return {"kind": "convex", "vertices": prism.points.tolist()}, around


def joined(geometry: Sequence[Item]) -> list[Item]:
    """The forms of a file, where a cylinder with a ball of its radius at both ends is one capsule.

    URDF has no capsules, and many files write them so.
    """
    balls = [item for item in geometry if item["form"]["kind"] == "sphere"]
    found: list[Item] = []
    used: list[Item] = []
    for item in geometry:
        ends = _balls_at_the_ends(item, balls) if item["form"]["kind"] == "cylinder" else None
        if ends is None:
            found.append(item)
            continue
        capsule, of = ends
        found.append(capsule)
        used += of
        balls = [each for each in balls if not any(each is other for other in of)]
    return [item for item in found if not any(item is each for each in used)]


def _balls_at_the_ends(item: Item, balls: Sequence[Item]) -> tuple[Item, list[Item]] | None:
    """The capsule of a cylinder and two balls, and these."""
    form, place = item["form"], item["frame"]
    radius, half = form["radius"], form["length"] / 2 * matrix(place["orientation"])[:, 2]
    thickest, of = radius, []
    for end in (np.array(place["position"]) - half, np.array(place["position"]) + half):
        for ball in balls:
            away = float(np.linalg.norm(end - ball["frame"]["position"]))
            off = max(away, abs(ball["form"]["radius"] - radius))
            if ball["on"] == item["on"] and off < APART * radius and ball not in of:
                break
        else:
            return None
        of.append(ball)
        if off > ROUNDING * radius:
            thickest = max(thickest, ball["form"]["radius"] + away)
    capsule = {"kind": "capsule", "radius": thickest, "length": form["length"]}
    return {**item, "form": capsule, "parts": [name_of(each) for each in (item, *of)]}, of
