"""What all readers share: options, collision geometry to shapes, the report."""

from __future__ import annotations

import sys
import warnings
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

import vffnull._core as _core
from vffnull._support import progress as _progress
from vffnull._support.arguments import number
from vffnull._support.errors import InputError, InputTypeError, ScenarioWarning
from vffnull.arms._as_given import Item, as_given, joined, name_of
from vffnull.arms._frames import frame, matrix
from vffnull.arms._meshes import MissingMeshError
from vffnull.arms._pieces import check
from vffnull.arms._report import Report
from vffnull.model.arm import listed, unshaped

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from vffnull.arms._capsules import Fit, Solid

__all__ = ["Collision", "MeshReader", "Pieces", "finish", "options", "solid_of", "tell"]

Collision = Literal["fit", "file", "none"]
Pieces = int | Mapping[str, int]
HUGE = 3.0
"""Shapes so many times as large as the arm is long, or as a metre, are taken for those in other units."""
MeshReader = Callable[[Mapping[str, Any], str], "Solid"]
"""From a mesh of the model and a name for messages to its surface."""


def options(
    tip: str | None,
    base: str | None,
    locked: Mapping[str, float] | None,
    tool: object,
    mount: object,
    gravity: ArrayLike | None,
    armature: ArrayLike | Mapping[str, float] | None,
    fix_inertia: bool,
    srdf: str | None,
) -> dict[str, Any]:
    """The options of the core's reader."""
    if not isinstance(fix_inertia, bool | np.bool_):
        raise InputTypeError(f"fix_inertia: expected true or false, got {type(fix_inertia).__name__}")
    for name, link in (("tip", tip), ("base", base)):
        if link is not None and not isinstance(link, str):
            raise InputTypeError(f"{name}: expected the name of a link, got {type(link).__name__}")
    asked: dict[str, Any] = {"tip": tip, "base": base, "fix_inertia": bool(fix_inertia), "srdf": srdf}
    if locked is not None:
        if not isinstance(locked, Mapping):
            raise InputTypeError(
                f"locked: expected a dict from joint to position, got {type(locked).__name__}"
            )
        asked["locked"] = {name: number(f"locked[{name!r}]", value) for name, value in locked.items()}
    for name, value in (("tool", tool), ("mount", mount)):
        if value is not None:
            asked[name] = _placement(name, value)
    if gravity is not None:
        asked["gravity"] = _vector("gravity", gravity, 3)
    if armature is not None:
        asked["armature"] = np.atleast_1d(_floats("armature", armature)).tolist()
    return {key: value for key, value in asked.items() if value is not None}


def _floats(name: str, value: Any) -> Any:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError):
        raise InputTypeError(f"{name}: expected numbers, got {type(value).__name__}") from None


def _vector(name: str, value: Any, n: int) -> list[float]:
    array = _floats(name, value)
    if array.shape != (n,):
        raise InputError(f"{name}: expected {n} numbers, got shape {array.shape}")
    return [float(x) for x in array]


def _placement(name: str, value: Any) -> dict[str, list[float]]:
    """A frame from a position, (position, quaternion), or a dict of both."""
    if isinstance(value, Mapping):
        unknown = set(value) - {"position", "orientation"}
        if unknown:
            raise InputError(f"{name}: unknown key {sorted(unknown)[0]!r}; there are position, orientation")
        position, quaternion = value.get("position", (0, 0, 0)), value.get("orientation", (1, 0, 0, 0))
    elif isinstance(value, str) or not isinstance(value, Collection) or _is_two_numbers(value):
        expected = "a position, (position, quaternion), or a dict of both"
        raise InputTypeError(f"{name}: expected {expected}, got {type(value).__name__}")
    elif len(value) == 2:
        position, quaternion = value
    else:
        position, quaternion = value, (1, 0, 0, 0)
    turned = _vector(f"{name}.orientation", quaternion, 4)
    return frame(_vector(f"{name}.position", position, 3), turned)


def _is_two_numbers(value: Collection[Any]) -> bool:
    return len(value) == 2 and all(isinstance(each, int | float) for each in value)


def finish(
    reading: dict[str, Any], collision: Collision, pieces: Pieces, mesh: MeshReader, source: str, srdf: bool
) -> Report:
    """Shapes from the geometry, and the report; with an SRDF, that alone says which pairs are ignored."""
    if collision not in ("fit", "file", "none"):
        raise InputError(f"collision: expected 'fit', 'file' or 'none', got {collision!r}")
    arm, odd = reading["arm"], list(reading["warnings"])
    fits: list[Fit] = []
    geometry = joined(reading["geometry"]) if collision != "none" else []
    count = _counts(pieces, collision, geometry)
    if collision == "fit":
        fits = _fit(arm, geometry, mesh)
    elif collision == "file":
        fits = _as_in_file(geometry, count, mesh, odd)
    arm["collision"] = [{"link": fit.link, "shape": fit.shape} for fit in fits]
    touching: list[tuple[str, str]] = []
    if fits:
        from vffnull.arms._touching import touching as pairs

        meshes = {item["on"] for item in geometry if item["form"]["kind"] == "mesh"}
        huge = _huge(arm, fits, meshes, odd)
        found = [pair for pair in pairs(arm) if huge.isdisjoint(pair)]
        odd += _always(found, collision, srdf)
        touching = [] if srdf else found
        arm["ignore"] = [list(pair) for pair in arm.get("ignore", [])] + [list(pair) for pair in touching]
    if collision != "none" and not fits:
        odd.append("nothing of it collides: obstacles and self-collision will not be noticed")
    elif fits and (bare := unshaped(arm)):
        odd.append(
            f"no shape on {listed([f'`{link}`' for link in bare])}: nothing avoids "
            f"{'it' if len(bare) == 1 else 'them'}"
        )
    return Report(
        source=source,
        document=_core.check_arm(arm),
        warnings=tuple(odd),
        locked=reading["locked"],
        merged=reading["merged"],
        collision=collision,
        fits=tuple(fits),
        touching=tuple(touching),
    )


def _huge(arm: Mapping[str, Any], fits: Sequence[Fit], meshes: set[str], odd: list[str]) -> set[str]:
    """Links whose shapes are far larger than the arm, which is told: for that alone their pairs overlap."""
    from vffnull.model.shape import core_in_space

    places = [each["position"] for each in (*arm["joints"], arm["tool"])]
    reach = float(np.linalg.norm(places, axis=1).sum())
    sizes: dict[str, float] = defaultdict(float)
    for fit in fits:
        corners, radius = core_in_space(fit.shape)
        sizes[fit.link] = max(sizes[fit.link], float(np.ptp(corners, axis=0).max()) + 2.0 * radius)
    huge = {link for link, size in sizes.items() if size > HUGE * max(reach, 1.0)}
    if huge:
        named = listed([f"`{link}`" for link in sizes if link in huge])
        largest = max(sizes.values())
        asked = (
            'are their meshes in millimetres? `scale="0.001 0.001 0.001"` says so'
            if huge & meshes
            else "lengths are read as metres; are theirs millimetres?"  # only meshes have a scale
        )
        odd.append(
            f"shapes of {named} are up to {largest:.3g} m large, and the arm is {reach:.3g} m long: {asked}"
        )
    return huge


def _always(pairs: Sequence[tuple[str, str]], collision: Collision, srdf: bool) -> list[str]:
    """What is told of pairs whose shapes overlap nearly always: one sentence for all of them."""
    if not pairs:
        return []
    named = ", of ".join(f"`{first}` and `{second}`" for first, second in pairs)
    told = f"the shapes of {named} overlap in nearly every posture"
    tighter = ', or collision = "file"' if collision == "fit" else ""
    one = len(pairs) == 1
    if srdf:
        kept = "the pair: it counts as a collision" if one else "these pairs: they count as collisions"
        return [f"{told}, and the SRDF keeps {kept}; `ignore` {'it' if one else 'them'}{tighter}"]
    ignored = "the pair is ignored" if one else "these pairs are ignored"
    return [f"{told}: {ignored}, and nothing keeps them apart; an `srdf`{tighter} says otherwise"]


def tell(report: Report) -> dict[str, Any]:
    """Warn of what is odd, and hand out the document."""
    for message in report.warnings:
        warnings.warn(message, ScenarioWarning, stacklevel=3)
    return report.document


def solid_of(item: Mapping[str, Any], mesh: MeshReader) -> Solid:
    """What a piece of geometry is made of, in the frame of its link."""
    from vffnull.arms._capsules import Solid

    form, name = item["form"], name_of(item)
    kind = form["kind"]
    if kind == "mesh":
        solid = mesh(form, name)
    elif kind == "box":
        solid = Solid.box(name, form["size"])
    elif kind == "cylinder":
        solid = Solid.cylinder(name, form["radius"], form["length"])
    else:
        solid = Solid.capsule(name, form["radius"], form.get("length", 0.0))
    return solid.moved(matrix(item["frame"]["orientation"]), np.array(item["frame"]["position"]))


def _fit(arm: Mapping[str, Any], geometry: Sequence[Mapping[str, Any]], mesh: MeshReader) -> list[Fit]:
    try:
        from vffnull.arms._capsules import fit_solids
    except ImportError as error:
        raise ImportError('fitting capsules needs SciPy: pip install "vffnull[meshes]"') from error
    solids: dict[str, list[Solid]] = defaultdict(list)
    for item in geometry:
        solids[item["on"]].append(solid_of(item, mesh))
    from vffnull.arms._kept import keep, kept, key_of

    order = [arm["base"], *(joint["link"] for joint in arm["joints"])]
    seen = sys.stderr is not None and sys.stderr.isatty()
    fits: list[Fit] = []
    with _progress.bar(len(order), 1.0, ".0f links fitted") if seen else nullcontext() as told:
        for done, link in enumerate(order, start=1):
            key = key_of(link, solids[link])
            found = kept(key)
            if found is None:
                found = fit_solids(link, solids[link])
                keep(key, found)
            fits += found
            if told is not None:
                told(done, len(order))
    return fits


def _as_in_file(
    geometry: Sequence[Item], count: Callable[[str], int], mesh: MeshReader, odd: list[str]
) -> list[Fit]:
    fits = []
    for item in geometry:
        try:
            fits += as_given(item, solid_of(item, mesh), count(item["link"]))
        except MissingMeshError as error:
            odd.append(f"{error}; it is left out")
    return fits


def _counts(pieces: Any, collision: Collision, geometry: Sequence[Item]) -> Callable[[str], int]:
    """From a link to the most hulls that each of its meshes may become."""
    each = {"": pieces} if not isinstance(pieces, Mapping) else pieces
    for link, count in each.items():
        check(f"pieces[{link!r}]" if link else "pieces", count)
    if collision != "file" and any(count > 1 for count in each.values()):
        raise InputError("pieces: only the meshes of collision='file' are cut")
    if not isinstance(pieces, Mapping):
        return lambda _: pieces
    known = {item["link"] for item in geometry if item["form"]["kind"] == "mesh"}
    if collision == "file" and (strange := sorted(set(pieces) - known)):
        there = f"there are {', '.join(sorted(known))}" if known else "no link has a mesh"
        raise InputError(f"pieces: no mesh on a link {strange[0]!r}; {there}")
    return lambda link: pieces.get(link, 1)
