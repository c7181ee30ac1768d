"""What was read of a model, in words and as data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from vffnull.model.arm import arm_of, listed

if TYPE_CHECKING:
    from vffnull.arms._capsules import Fit

__all__ = ["Report", "describe"]

_UNITS = {"prismatic": ("m", "m/s", "N")}
_TURNING = ("rad", "rad/s", "N·m")


@dataclass(frozen=True)
class Report:
    """What was read, what is odd about it, and how tight the shapes of its links are.

    Attributes
    ----------
    source : str
        What was read.
    document : dict
        The explicit description of the arm.
    warnings : tuple of str
        What is odd but allowed.
    locked : dict
        Joints that do not move, and where they stand [rad or m].
    merged : dict
        For each link of the arm the links of the file that became part of it.
    collision : {"fit", "file", "none"}
        Where the shapes of the links come from.
    fits : tuple of Fit
        The fitted capsules, or the shapes as in the file.
    touching : tuple of (str, str)
        Pairs of links whose shapes overlap nearly always and are therefore not measured, where no SRDF says
        which are.
    """

    source: str
    document: dict[str, Any]
    warnings: tuple[str, ...]
    locked: Mapping[str, float]
    merged: Mapping[str, Sequence[str]]
    collision: str
    fits: tuple[Fit, ...]
    touching: tuple[tuple[str, str], ...]

    def to_dict(self) -> dict[str, Any]:
        """Everything as plain data."""
        return {
            "source": self.source,
            "document": self.document,
            "warnings": list(self.warnings),
            "locked": dict(self.locked),
            "merged": {link: list(parts) for link, parts in self.merged.items()},
            "collision": self.collision,
            "fits": [
                {
                    "link": fit.link,
                    "parts": list(fit.parts),
                    "shape": fit.shape,
                    "volume": fit.volume,
                    "hull_volume": fit.hull_volume,
                    "tightness": fit.tightness,
                    "protrusion": fit.protrusion,
                    "vertices": fit.vertices,
                    "own_volume": fit.own_volume,
                }
                for fit in self.fits
            ],
            "touching": [list(pair) for pair in self.touching],
        }

    def __str__(self) -> str:
        """The report as text."""
        lines = [self.source, "", describe(self.document), *_heavy(self.document)]
        if self.fits:
            lines += ["", *(_as_in_file(self.fits) if self.collision == "file" else _fits(self.fits))]
        for link, parts in self.merged.items():
            if len(parts) > 1:
                rest = ", ".join(part for part in parts if part != link)
                lines.append(f"part of {link}: {rest}")
        pairs = self.document.get("ignore", [])
        if pairs:
            lines.append("not measured against each other: " + _pairs(pairs))
        if self.touching:
            lines.append("of these, because their shapes overlap nearly always: " + _pairs(self.touching))
        lines += ["", *(f"odd: {message}" for message in self.warnings)] if self.warnings else []
        return "\n".join(lines)


def _pairs(pairs: Sequence[Sequence[str]]) -> str:
    return ", ".join(f"{first}–{second}" for first, second in pairs)


def _fits(fits: Sequence[Fit]) -> list[str]:
    rows = [("capsule on", "contains", "radius [mm]", "length [mm]", "volume/hull", "outside [mm]")]
    for fit in fits:
        if fit.shape["kind"] == "convex":
            rows.append(
                (fit.link, _contained(fit), _form(fit.shape), "–", f"{fit.tightness:.2f}", _outside(fit))
            )
            continue
        a, b = fit.shape.get("a", (0, 0, 0)), fit.shape.get("b", (0, 0, 0))
        sizes = (f"{fit.shape['radius'] * 1e3:.1f}", f"{math.dist(a, b) * 1e3:.1f}")
        rows.append((fit.link, _contained(fit), *sizes, f"{fit.tightness:.2f}", _outside(fit)))
    return [*_table(rows), *_together("capsules", fits)]


def _as_in_file(fits: Sequence[Fit]) -> list[str]:
    rows = [("shape on", "contains", "is", "volume/hull", "volume/file", "outside [mm]")]
    for fit in fits:
        of_file = "–" if fit.own_volume is None else f"{fit.volume / fit.own_volume:.2f}"
        rows.append(
            (fit.link, _contained(fit), _form(fit.shape), f"{fit.tightness:.2f}", of_file, _outside(fit))
        )
    return [*_table(rows), *_together("shapes", fits)]


def _contained(fit: Fit) -> str:
    parts = [part.rsplit("/", 1)[-1] for part in fit.parts[:2]]
    if len(fit.parts) > 2:
        parts.append(f"{len(fit.parts) - 2} more")
    return ", ".join(parts)


def _outside(fit: Fit) -> str:
    return f"{max(fit.protrusion, 0.0) * 1e3:.3g}"


def _form(shape: Mapping[str, Any]) -> str:
    match shape["kind"]:
        case "convex":
            return f"hull of {len(shape['vertices'])} corners"
        case kind:
            return str(kind)


def _together(what: str, fits: Sequence[Fit]) -> list[str]:
    total, hull = sum(fit.volume for fit in fits), sum(fit.hull_volume for fit in fits)
    return [f"all {what} together: {total / hull:.2f} times the hulls"] if hull > 0 else []


def _table(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    return [
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows
    ]


def describe(arm: Mapping[str, Any]) -> str:
    """An arm's joints, masses and limits as a table, with its rotors and friction where it has any."""
    joints = arm["joints"]
    n = len(joints)
    limits = arm.get("joint_limits") or [[-math.inf, math.inf]] * n
    velocity = arm.get("velocity_limits") or [math.inf] * n
    torque = arm.get("torque_limits") or [math.inf] * n
    extras = ("armature", "damping", "friction")
    rubs = tuple(key for key in extras if any(joint.get(key) for joint in joints))
    rows = [("joint", "kind", "lower", "upper", "speed", "torque", *rubs, "link", "mass [kg]")]
    for i, joint in enumerate(joints):
        units = _UNITS.get(joint["kind"], _TURNING)
        cells = (limits[i][0], limits[i][1], velocity[i], torque[i])
        shown = (_quantity(value, unit) for value, unit in zip(cells, (units[0], *units), strict=True))
        resists = (f"{joint.get(key, 0.0):.4g} {unit}" for key, unit in _resistance(joint, rubs))
        rows.append((joint["name"], joint["kind"], *shown, *resists, joint["link"], f"{joint['mass']:.4g}"))
    total = sum(joint["mass"] for joint in joints)
    head = f"{n} joints from {arm['base']} to {arm['tip']}, {total:.4g} kg move"
    known = [(arm.get("reach"), "reach {:.4g} m"), (arm.get("payload"), "payload {:.4g} kg")]
    head += "".join(f", {form.format(value)}" for value, form in known if value is not None)
    return "\n".join([head, *_table(rows)])


def _resistance(joint: Mapping[str, Any], keys: Sequence[str]) -> list[tuple[str, str]]:
    """What resists the motion of a joint, with its units."""
    _, speed, force = _UNITS.get(joint["kind"], _TURNING)
    length = speed.partition("/")[0]
    inertia = "kg" if joint["kind"] == "prismatic" else "kg·m²"
    units = {"armature": inertia, "damping": f"{force}·s/{length}", "friction": force}
    return [(key, units[key]) for key in keys]


_SHARE = 0.5
"""From which share on rotors are most of the inertia at a joint."""


def _heavy(arm: Mapping[str, Any]) -> list[str]:
    """Joints whose links hardly yield to a push, because their rotors are heavier than they are."""
    import numpy as np

    rotors = np.array([joint.get("armature", 0.0) for joint in arm["joints"]])
    if not rotors.any():
        return []
    ends = np.array(arm.get("joint_limits") or np.zeros((len(rotors), 2)), dtype=float)
    middle = np.where(np.isfinite(ends).all(axis=1, keepdims=True), ends, 0.0).mean(axis=1)
    shares = rotors / np.diag(arm_of(arm).mass_matrix(middle))
    heavy = [
        f"{joint['name']} {100 * share:.0f} %"
        for joint, share in zip(arm["joints"], shares, strict=True)
        if share > _SHARE
    ]
    return (
        [f"armature is most of the inertia at {listed(heavy)}: a push hardly moves these links"]
        if heavy
        else []
    )


def _quantity(value: float, unit: str) -> str:
    return f"{value:.4g} {unit}" if math.isfinite(value) else "–"
