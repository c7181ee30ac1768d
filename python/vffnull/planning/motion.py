"""A planned motion: configurations over time, from rest to rest."""

from __future__ import annotations

import json
import math
import os
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

import vffnull._core as _core
from vffnull._support.arguments import positive
from vffnull._support.errors import InputError
from vffnull._support.files import digest, replacing

__all__ = ["Plan", "PlanStatus"]

Array = NDArray[np.float64]

_FORMAT = 1
_ARRAYS = ("t", "q", "dq", "ddq", "tip", "margins", "shares")
_KEPT = ("margins", "shares")  # of each link, where it is known
_PERHAPS = ("tilt", "view", "begins")  # None where that is not known, or does not matter
_SAME = 1e-9  # rad, m or s
_NUMBERS = ("clearance", "margin", "gap", "samples", "nodes", "wall_time")


class PlanStatus(str, Enum):
    """What planning has come to. A status equals its plain string: ``plan.status == "found"``."""

    FOUND = "found"
    """A motion to the goal."""
    START_BLOCKED = "start blocked"
    """The start touches something, is beyond a joint limit, or will be passed by something within the
    horizon."""
    GOAL_OUT_OF_REACH = "goal out of reach"
    """No configuration within the joint limits puts the end effector there."""
    GOAL_BLOCKED = "goal blocked"
    """Every configuration that was found for the goal touches something."""
    NOT_FOUND = "not found"
    """No path with so many samples. It is no proof that there is none."""
    TOO_HEAVY = "too heavy"
    """There is a path, but the joints cannot hold the arm somewhere on it."""

    def __str__(self) -> str:
        return self.value

    def __format__(self, spec: str) -> str:
        return format(self.value, spec)


@dataclass(frozen=True, eq=False, repr=False)
class Plan:
    """A planned motion, or how far the search for one came; made by `vffnull.plan`.

    Between the instants the joints follow the cubic spline through `q` that is at rest at both ends, and
    wherever two configurations in a row are the same: `at`.

    Parameters
    ----------
    status : PlanStatus
        Whether it leads to the goal, and if not, why.
    t : (k,) ndarray
        Instants [s] from 0 on; empty if nothing was found.
    q : (k, n) ndarray
        The configuration at each instant [rad or m]. If nothing was found: the corners of the path to where
        the goal was nearest, from the start.
    dq, ddq : (k, n) ndarray
        Velocities [rad/s] and accelerations [rad/s²]; empty if nothing was found.
    tip : (k, 2) or (k, 3) ndarray
        Positions of the tip at `q` [m].
    clearance : float
        The smallest distance from obstacles, at the instants and seven times in between [m]. Infinite if
        there is nothing. Where start or goal are blocked, the distance of what blocks them; at the start if
        nothing was found otherwise.
    margin : float
        The distance that the path keeps where it keeps least [m], half of it where corners were rounded: that
        which was asked for, or 90 % of what a start or goal has near that, and all the way where nothing else
        was found. Of the margins that obstacles have of their own it keeps the same share.
    gap : float
        What was left to a goal: joint angles, taken together as a vector [rad], if no path was found; a
        distance [m], if the goal is out of reach; infinite if start or goal are blocked; 0 if a path was
        found.
    samples, nodes : int
        How many random configurations were tried, and how many the search kept.
    wall_time : float
        How long planning took [s].
    message : str
        The status in a sentence: what is in the way of which link, or which joint, by how much, and what
        would help. Of a motion, where it keeps less than the margin.
    margins : (k, n) ndarray
        What each link is certain to keep from obstacles between each instant and the next, the smaller of
        both [m]: barriers that follow the plan keep no more. Empty if nothing was found, and in older files.
    shares : (k, n) ndarray
        The same of the margins that obstacles have of their own, in parts of each, 1 at most. Empty if none
        has one.
    tilt : float or None
        How far the end effector leans at most, at the instants and seven times in between [rad]. None if that
        was not asked for, or nothing was found.
    view : float or None
        The same of how far off the axis of the end effector it has the point that it keeps in view.
    begins : float or None
        When it has to begin, by the time of its scenario [s], if it keeps from what moves only when that
        passes; None if it keeps from all places that are passed within the horizon. In a drive the reference
        begins ``command.blend_time`` after the obstacles: plan it with that ``time``, 0.5 by default.
    ignored : tuple of (str, str)
        Pairs of links that were not measured against each other: the ``ignore`` of the arm.
    """

    status: PlanStatus
    t: Array
    q: Array
    dq: Array
    ddq: Array
    tip: Array
    clearance: float
    margin: float
    gap: float
    samples: int
    nodes: int
    wall_time: float
    message: str = ""
    margins: Array = field(default_factory=lambda: np.empty((0, 0)))
    shares: Array = field(default_factory=lambda: np.empty((0, 0)))
    ignored: tuple[tuple[str, str], ...] = ()
    tilt: float | None = None
    view: float | None = None
    begins: float | None = None

    @property
    def duration(self) -> float:
        """How long the motion takes [s]; 0 if nothing was found."""
        return float(self.t[-1]) if len(self.t) else 0.0

    @property
    def reference(self) -> dict[str, Any]:
        """The ``[reference]`` of a scenario that follows the plan:
        ``scenario.replace(reference=plan.reference)``.

        Raises
        ------
        vffnull.errors.InputError
            If nothing was found.
        """
        self._needed()
        made = {"kind": "plan", "times": self.t.tolist(), "points": self.q.tolist()}
        return made | {name: getattr(self, name).tolist() for name in _KEPT if len(getattr(self, name))}

    def at(self, t: ArrayLike) -> tuple[Array, Array, Array]:
        """Positions, velocities and accelerations of the joints at any instants.

        Parameters
        ----------
        t : float or (m,) array_like
            Instants [s]; the first or last configuration is held before and after.

        Returns
        -------
        tuple of (n,) or (m, n) ndarray
            q [rad], dq [rad/s] and ddq [rad/s²], as the reference of a scenario has them.

        Raises
        ------
        vffnull.errors.InputError
            If nothing was found, or an instant is not finite.
        """
        self._needed()
        times = np.asarray(t, dtype=float)
        found = _core.joints_at(self.t, self.q, times.reshape(-1))
        q, dq, ddq = (each.reshape(*times.shape, self.q.shape[1]) for each in found)
        return q, dq, ddq

    def then(self, following: Plan, pause: float = 0.5) -> Plan:
        """Add another motion after a rest.

        Parameters
        ----------
        following : Plan
            A motion that begins where this one ends.
        pause : float, optional
            How long the arm rests in between [s], > 0, and so that rounding keeps all instants apart.

        Returns
        -------
        Plan
            Both as one.

        Raises
        ------
        vffnull.errors.InputError
            If one of them holds no motion, the other one begins elsewhere or has to begin at another time, or
            the pause is none, or so short or long that instants would coincide.
        """
        self._needed()
        following._needed()
        rest = positive("pause", pause)
        if following.q.shape[1] != self.q.shape[1]:
            raise InputError(
                f"following: expected a plan of {self.q.shape[1]} joints, got one of {following.q.shape[1]}"
            )
        apart = float(np.abs(following.q[0] - self.q[-1]).max())
        if apart > _SAME:
            raise InputError(f"following: must begin where this plan ends, not {apart:.2g} rad or m away")
        begins = self.begins
        if following.begins is not None:
            begins = following.begins - self.duration - rest
            same = _SAME + 8.0 * float(np.spacing(following.begins))
            if begins < -same or (self.begins is not None and abs(begins - self.begins) > same):
                raise InputError(
                    f"following: goes past what moves and has to begin at {following.begins:.6g} s, which "
                    f"is not {rest:.6g} s after this plan ends; plan it for another `time`"
                )
            begins = self.begins if self.begins is not None else max(begins, 0.0)
        joined = {
            name: np.concatenate([getattr(self, name), getattr(following, name)])
            for name in _ARRAYS
            if name not in _KEPT
        }
        if len(self.margins) and len(following.margins):
            joined["margins"] = np.concatenate([self.margins, following.margins])
            if len(self.shares) or len(following.shares):
                shares = [p.shares if len(p.shares) else np.ones_like(p.q) for p in (self, following)]
                joined["shares"] = np.concatenate(shares)
        at = slice(len(self.t) - 1, len(self.t) + 1)
        for name in _KEPT:  # while it rests, no more than before and after
            if name in joined:
                joined[name][at] = joined[name][at].min(axis=0)
        joined["t"][len(self.t) :] += self.t[-1] + rest
        if not (np.diff(joined["t"]) > 0.0).all():  # rounding has lost the rest, or the motion after it
            least = 2.0 * np.spacing(self.t[-1])
            most = 0.5 * np.diff(following.t).min() / np.finfo(float).eps
            raise InputError(f"pause: expected {least:.1g} to {most:.1g} s between these plans, got {rest} s")
        joined["q"][len(self.t)] = self.q[-1]  # exactly: that makes it a rest
        return Plan(
            status=self.status,
            clearance=min(self.clearance, following.clearance),
            margin=min(self.margin, following.margin),
            gap=0.0,
            samples=self.samples + following.samples,
            nodes=self.nodes + following.nodes,
            wall_time=self.wall_time + following.wall_time,
            message=f"{self.message}; then {following.message}",
            ignored=tuple(dict.fromkeys(self.ignored + following.ignored)),
            tilt=_most(self.tilt, following.tilt),
            view=_most(self.view, following.view),
            begins=begins,
            **joined,
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the plan to a file.

        Parameters
        ----------
        path : str or path
            A path that ends in ``.npz``.

        Returns
        -------
        Path
            The file.

        Raises
        ------
        vffnull.errors.InputError
            If the path ends otherwise.
        """
        path = checked_path(path)
        header = {"format": _FORMAT, "version": _core.__version__, "status": str(self.status)}
        header["message"] = self.message
        header["ignored"] = self.ignored
        header |= {name: getattr(self, name) for name in _PERHAPS}
        header |= {name: getattr(self, name) for name in _NUMBERS}
        arrays: dict[str, Any] = {name: getattr(self, name) for name in _ARRAYS}
        header["digest"] = digest(json.dumps(header), arrays.values())
        with replacing(path) as draft, draft.open("wb") as file:
            np.savez(file, vffnull_plan=np.array(json.dumps(header)), **arrays)
        return path

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Plan:
        """Read a plan that `save` has written, every bit as it was.

        Raises
        ------
        vffnull.errors.InputError
            If the file holds no plan, or is damaged.
        OSError
            If it cannot be read.
        """
        path = Path(path)
        path.open("rb").close()  # what the operating system says of the path is passed on
        try:
            with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
                header = json.loads(str(file["vffnull_plan"]))
                # Files of older versions say nothing of these.
                names = [name for name in _ARRAYS if name not in _KEPT or name in file]
                arrays: dict[str, Any] = {name: np.asarray(file[name]) for name in names}
            if header["format"] != _FORMAT:
                raise InputError(
                    f"{path}: a plan in format {str(header['format'])[:20]}; "
                    f"this version reads format {_FORMAT}"
                )
            signature = header.pop("digest", None)  # files of older versions have none
            if signature not in (None, digest(json.dumps(header), arrays.values())):
                raise InputError(f"{path}: damaged: its digest is not that of what it holds")
            values: dict[str, Any] = {name: type_(header[name]) for name, type_ in _types().items()}
            message = str(header.get("message", ""))  # older files have none
            ignored = tuple((str(a), str(b)) for a, b in header.get("ignored", ()))
            status = PlanStatus(header["status"])
            for name in _PERHAPS:
                values[name] = None if header.get(name) is None else float(header[name])
            plan = cls(status=status, message=message, ignored=ignored, **values, **arrays)
        except InputError:
            raise
        except Exception:  # NumPy and zipfile have errors of every kind for files that are broken
            raise InputError(f"{path}: holds no plan that vffnull has written") from None
        plan._check(path)
        return plan

    def _check(self, path: Path) -> None:
        """Refuse arrays that do not belong together."""
        times, points = len(self.t), self.q.shape
        found = self.status is PlanStatus.FOUND
        whole = (
            all(getattr(self, name).dtype == np.float64 for name in _ARRAYS)
            and self.t.ndim == 1
            and self.q.ndim == self.tip.ndim == 2
            and self.tip.shape[0] == points[0]
            and self.tip.shape[1] in (2, 3)
            and self.dq.shape == self.ddq.shape == ((times, points[1]) if found else (0, points[1]))
            and times == (points[0] if found else 0)
            and all(not kept.size or (found and kept.shape == points) for kept in (self.margins, self.shares))
            and all(np.isfinite(getattr(self, name)).all() for name in _ARRAYS)
            and not any(math.isnan(getattr(self, name)) for name in _NUMBERS)
        )
        if not whole or (found and (times < 2 or (np.diff(self.t) <= 0).any())):
            raise InputError(f"{path}: holds no plan that vffnull has written")

    def _needed(self) -> None:
        if self.status is not PlanStatus.FOUND:
            raise InputError(f"plan: there is no motion to follow, its status is {str(self.status)!r}")

    def __repr__(self) -> str:
        head = f"<Plan {self.status}: {self.q.shape[1]} joints"
        if self.status is PlanStatus.FOUND:
            room = f", {1e3 * self.clearance:.0f} mm clear" if math.isfinite(self.clearance) else ""
            return f"{head}, {self.duration:.2f} s{room}, {self.samples} samples>"
        if self.status is PlanStatus.NOT_FOUND:
            return f"{head}, {self.gap:.2f} rad left after {self.samples} samples>"
        if self.status is PlanStatus.GOAL_OUT_OF_REACH and math.isfinite(self.gap):
            return f"{head}, {self.gap:.3f} m away>"
        return f"{head}>"


def _most(first: float | None, second: float | None) -> float | None:
    """What two plans are off at most, if both tell."""
    return None if first is None or second is None else max(first, second)


def _types() -> dict[str, type]:
    """What each number of a header is."""
    return {name: int if name in ("samples", "nodes") else float for name in _NUMBERS}


def checked_path(path: str | os.PathLike[str]) -> Path:
    """Refuse a path that a plan cannot be written to."""
    path = Path(path)
    if path.suffix != ".npz":
        raise InputError(f"{path}: a plan is written as .npz")
    return path
