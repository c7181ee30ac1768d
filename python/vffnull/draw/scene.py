"""A scene at its instants, and what is drawn of it at one of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

import vffnull._core as _core
from vffnull._core import matrices, quaternions
from vffnull._support.errors import InputError
from vffnull.draw import geometry
from vffnull.draw.primitives import (
    ROLES,
    Array,
    Arrow,
    Axes,
    Body,
    Cloud,
    Curve,
    Marks,
    Primitive,
    Role,
    Rows,
)
from vffnull.draw.shapes import (
    Part,
    clouds_of,
    cores_of,
    influence_of,
    is_seen,
    mount_of,
    solids_of,
    thickest,
    unseen_of,
    wrenches_of,
)
from vffnull.model.record import recorded

if TYPE_CHECKING:
    from vffnull._core import Arm, Distances
    from vffnull.model.outcome import Outcome
    from vffnull.model.scenario import Scenario


AROUND = 0.35
"""How far from the arm a picture in one plane goes for what comes near it [sizes of the arm]."""
_PAIRS = 200_000
"""Of links and obstacles that are measured at a time."""
_CORNER = -50.0, 20.0
"""Azimuth and elevation [°] of the corner from which a scene in space is seen by default."""
_END_ON = 0.6
"""How wide an arm at least is in a picture, compared with one from the next corner."""


@dataclass(frozen=True, eq=False)
class Measured:
    """An arm in space among obstacles, for the core to measure how near they are.

    Attributes
    ----------
    arm : Arm
        As the core has it.
    q : (T, n) ndarray
        Joint positions [rad or m].
    obstacles : tuple of dict
        Of the scenario.
    """

    arm: Any
    q: Array
    obstacles: tuple[Mapping[str, Any], ...]

    def pick(self, rows: Rows) -> Measured:
        """The same at some of its instants."""
        return Measured(self.arm, self.q[rows], self.obstacles)

    def at(self, rows: Rows, scene: Scene) -> Distances:
        """Every body and seen obstacle at some instants of a scene, with the obstacles where they were."""
        seen = [i for i, each in enumerate(self.obstacles) if is_seen(each)]
        obstacles = [self._moved(i, rows, scene) for i in seen]
        q = self.q[rows]
        return _core.distances(self.arm, q, np.zeros_like(q), obstacles, scene.t[rows])

    def _moved(self, index: int, rows: Rows, scene: Scene) -> dict[str, Any]:
        """An obstacle that moves by the places and orientations that it had."""
        made = dict(self.obstacles[index])
        made.pop("angular_velocity", None)
        places, turns = scene.obstacles[rows, index], scene.rotations[index]
        made["position"], first = places[0].tolist(), made.get("orientation", (1.0, 0.0, 0.0, 0.0))
        made["motion"] = {"kind": "waypoints", "times": scene.t[rows].tolist(), "points": places.tolist()}
        if turns is not None:
            orientations = quaternions(turns[rows] @ matrices(first))
            made["orientation"] = orientations[0].tolist()
            made["motion"]["orientations"] = orientations.tolist()
        if len(rows) == 1:
            made["motion"] = {"kind": "static"}
        return made


@dataclass(frozen=True, eq=False)
class Scene:
    """A scene of D dimensions at T instants: an arm with n links among k obstacles.

    Attributes
    ----------
    t : (T,) ndarray
        Time [s].
    joints : (T, n+1, D) ndarray
        The base, the joints, and the tip as the last [m].
    radii : (n,) ndarray
        Of the links [m]; in space of the thickest part of each that has one.
    cores : tuple
        Every obstacle as the corners (·, D) [m] of its core, relative to its position, and the radius [m]
        around the core; of a half-space a piece of its surface, of a cloud the block around its points.
    clouds : tuple of (k, 3) ndarray or None
        The points of the obstacles that are clouds, relative to their positions [m]; None of others.
    obstacles : (T, k, D) ndarray
        Their positions [m].
    influence : float
        How far their fields reach [m]; 0 without a field.
    tip, reference : (T, D) ndarray
        The end effector and where it shall be [m].
    strength : (T, n) ndarray
        Magnitude of the repulsion on each link [N].
    given : tuple of (T, n, D) ndarray, optional
        Points [m] and forces [N], where they are known and need not be made of `strength`.
    wrenches : tuple of (T, k, D) ndarray, optional
        Points [m] and forces [N] of what pushes the arm from outside.
    sensed : (T, rays, D) ndarray, optional
        Points that the controller knows of the obstacles [m].
    solids : tuple of Part, optional
        What the links are made of, where it is not the segments between the joints: the shapes of an arm in
        space that are measured against obstacles.
    turns : (T, 3, 3) ndarray, optional
        Axes of the end effector's frame as columns, in space.
    base : (3,) ndarray, optional
        Where an arm in space stands [m], which need not be the origin of its first joint.
    rotations : tuple of (T, D, D) ndarray or None, optional
        How every obstacle is turned, compared with its core; None of one that does not turn.
    plan : tuple of Part, optional
        What the links would be made of where a plan has the joints; empty without a plan.
    measured : Measured, optional
        What tells in space where the repulsion acts; without it there is none.
    unseen : frozenset of int, optional
        Obstacles that the controller does not know of.
    """

    t: Array
    joints: Array
    radii: Array
    cores: tuple[tuple[Array, float], ...]
    clouds: tuple[Array | None, ...]
    obstacles: Array
    influence: float
    tip: Array
    reference: Array
    strength: Array
    given: tuple[Array, Array] | None = None
    wrenches: tuple[Array, Array] | None = None
    sensed: Array | None = None
    solids: tuple[Part, ...] | None = None
    turns: Array | None = None
    base: Array | None = None
    rotations: tuple[Array | None, ...] = ()
    plan: tuple[Part, ...] = ()
    measured: Measured | None = None
    unseen: frozenset[int] = frozenset()

    @classmethod
    def of_result(cls, result: Outcome) -> Scene:
        """The scene of a run at its recorded instants."""
        document = result.scenario.to_dict()
        made_of = result.scenario.arm
        made = cls.of_postures(made_of, result.q)
        size = made.dimension
        return dataclasses.replace(
            made,
            t=result.t,
            cores=cores_of(document, made.stand, made.reach),
            clouds=clouds_of(document),
            unseen=unseen_of(document),
            obstacles=result.obstacles,
            influence=influence_of(document),
            tip=result.x[:, :size],
            reference=result.x_ref[:, :size],
            strength=result.force,
            wrenches=wrenches_of(result, made.parts, size),
            sensed=result.sensed,
            rotations=tuple(_core.rotations(each, size, result.t) for each in document.get("obstacles", [])),
            plan=()
            if (planned := ghost(result)) is None
            else tuple(part for part in cls.of_postures(made_of, planned).parts if part.index >= 0),
            measured=Measured(made_of, result.q, tuple(document.get("obstacles", []))) if size == 3 else None,
        )

    @classmethod
    def of_scenario(cls, scenario: Scenario) -> Scene:
        """The scene at the start of a scenario, without forces."""
        document = scenario.to_dict()
        made = cls.of_arm(scenario.arm, document["q0"])
        origin = np.zeros(made.dimension)
        places = [each.get("position", origin) for each in document.get("obstacles", [])]
        obstacles = np.asarray(places, dtype=float).reshape(1, len(places), made.dimension)
        return dataclasses.replace(
            made,
            cores=cores_of(document, made.stand, made.reach),
            clouds=clouds_of(document),
            unseen=unseen_of(document),
            obstacles=obstacles,
            influence=influence_of(document),
        )

    @classmethod
    def of_arm(cls, arm: Arm, q: ArrayLike) -> Scene:
        """An arm alone at joint angles (n,) [rad]."""
        return cls.of_postures(arm, np.asarray(q, dtype=float)[None])

    @classmethod
    def of_postures(cls, arm: Arm, q: Array) -> Scene:
        """An arm alone at joint angles (T, n) [rad], a second after the other."""
        space = arm.dimension == 3
        joints = np.asarray(arm.forward_kinematics(q))
        count, n, size = joints.shape[0], joints.shape[1] - 1, joints.shape[2]
        solids = solids_of(arm, q, joints) if space else None
        return cls(
            t=np.arange(count, dtype=float),
            joints=joints,
            radii=thickest(solids, n) if solids is not None else np.asarray(arm.radius),
            cores=(),
            clouds=(),
            obstacles=np.zeros((count, 0, size)),
            influence=0.0,
            tip=joints[:, -1],
            reference=joints[:, -1],
            strength=np.zeros((count, n)),
            solids=solids,
            turns=arm.tip_poses(q)[:, :3, :3] if space else None,
            base=mount_of(arm)[:3, 3] if space else None,
        )

    @property
    def dimension(self) -> int:
        """Of the space that the scene is in."""
        return int(self.joints.shape[-1])

    @property
    def links(self) -> Array:
        """Ends of the links (T, n, 2, D) [m]."""
        return np.stack([self.joints[:, :-1], self.joints[:, 1:]], axis=2)

    @property
    def parts(self) -> tuple[Part, ...]:
        """What the arm is made of."""
        if self.solids is not None:
            return self.solids
        ends = self.links
        return tuple(Part(i, ends[:, i], float(radius)) for i, radius in enumerate(self.radii))

    @property
    def stand(self) -> Array:
        """Where the arm stands at the start (D,) [m]."""
        found: Array = self.joints[0, 0] if self.base is None else self.base
        return found

    @cached_property
    def reach(self) -> float:
        """From the base to the farthest point of the joints [m]."""
        return float(np.linalg.norm(self.joints - self.joints[:, :1], axis=-1).max(initial=1e-9))

    @cached_property
    def foot(self) -> float:
        """The height [m] of what the arm stands on: that of its base, or where a pedestal below it ends."""
        base = float(self.joints[0, 0, -1] if self.base is None else self.base[-1])
        own = [float(part.corners[..., -1].min()) - part.radius for part in self.parts if part.index < 0]
        lowest = min(own, default=base)
        return lowest if lowest < base - 0.25 * self.reach else base

    @property
    def next_corner(self) -> float:
        """By how much [°] the usual view from a corner is turned, to see the arm neither end-on nor behind
        what it stands on: 0 or 90.
        """
        if self.dimension == 2:
            return 0.0
        return 90.0 if self._width_seen(0.0) < _END_ON * self._width_seen(90.0) else 0.0

    def _width_seen(self, turn: float) -> float:
        """How wide the arm is at the start [m], seen from the corner or one beside it, where its base hides
        nothing; that is measured by rectangles.
        """
        view = geometry.looking(_CORNER[0] + turn, _CORNER[1])
        nearer = np.cross(*view)
        begins, ends = self.joints[0, :-1], self.joints[0, 1:]
        places = np.concatenate([begins + share * (ends - begins) for share in np.linspace(0.0, 1.0, 6)])
        flat, hidden = places @ view.T, np.zeros(len(places), dtype=bool)
        for part in self.parts:
            if part.index < 0:
                corners = part.corners[0] @ view.T
                low, high = corners.min(axis=0) - part.radius, corners.max(axis=0) + part.radius
                behind = places @ nearer < float((part.corners[0] @ nearer).mean())
                hidden |= behind & np.all((low < flat) & (flat < high), axis=1)
        return float(np.ptp(flat[~hidden, 0])) if not hidden.all() else 0.0

    @property
    def moves(self) -> bool:
        """Whether the reference goes anywhere."""
        return travels(self.reference)

    def corners(self, index: int) -> Array:
        """Corners of an obstacle's core, relative to its position (T, ·, D) [m].

        Once only, (1, ·, D), of one that does not turn.
        """
        corners, _ = self.cores[index]
        rotation = self.rotations[index] if self.rotations else None
        return corners[None] if rotation is None else np.einsum("tij,kj->tki", rotation, corners)

    def solid(self, index: int) -> Array:
        """Corners of an obstacle's core (T, ·, D) [m]."""
        return self.corners(index) + self.obstacles[:, index, None]

    def cloud(self, index: int, row: int) -> Array | None:
        """The points of a cloud at an instant (k, 3) [m]; None of another obstacle."""
        points = self.clouds[index]
        if points is None:
            return None
        rotation = self.rotations[index] if self.rotations else None
        return np.asarray(
            (points if rotation is None else points @ rotation[row].T) + self.obstacles[row, index]
        )

    def is_moving(self, index: int) -> bool:
        """Whether an obstacle moves or turns."""
        return travels(self.obstacles[:, index]) or len(self.corners(index)) > 1

    def pick(self, rows: Rows) -> Scene:
        """The scene at some of its instants."""
        return dataclasses.replace(
            self,
            t=self.t[rows],
            joints=self.joints[rows],
            obstacles=self.obstacles[rows],
            tip=self.tip[rows],
            reference=self.reference[rows],
            strength=self.strength[rows],
            given=None if self.given is None else (self.given[0][rows], self.given[1][rows]),
            wrenches=None if self.wrenches is None else (self.wrenches[0][rows], self.wrenches[1][rows]),
            sensed=None if self.sensed is None else self.sensed[rows],
            solids=None if self.solids is None else tuple(each.pick(rows) for each in self.solids),
            plan=tuple(each.pick(rows) for each in self.plan),
            measured=None if self.measured is None else self.measured.pick(rows),
            turns=None if self.turns is None else self.turns[rows],
            rotations=tuple(None if each is None else each[rows] for each in self.rotations),
        )

    @property
    def strengths(self) -> Array:
        """The greatest force that is drawn at each instant (T,) [N]."""
        found = self.strength.max(axis=1, initial=0.0)
        if self.wrenches is not None:
            forces = np.linalg.norm(self.wrenches[1], axis=-1)
            found = np.maximum(found, forces.max(axis=1, initial=0.0))
        return np.asarray(found)

    @cached_property
    def pushes(self) -> tuple[Array, Array]:
        """Where the repulsion acts on every link (T, n, D) [m], and the forces (T, n, D) [N].

        A record holds the force's magnitude; it is drawn at the point of the link's axis nearest to an
        obstacle, away from that obstacle; in space, where that would be hidden in the link, beyond it. With
        several obstacles near one link this is the direction away from the nearest.
        """
        if self.given is not None:
            return self.given
        if self.dimension == 3:
            return self._pushes_in_space()
        a, b = self.joints[:, :-1], self.joints[:, 1:]
        points, directions = a.copy(), np.zeros_like(a)
        least = np.full(a.shape[:2], np.inf)
        for index, (_, radius) in enumerate(self.cores):
            if index in self.unseen:
                continue
            for c, d in geometry.edges_of(self.solid(index)):
                on_link, on_obstacle = geometry.nearest(a, b, c[:, None], d[:, None])
                away = on_link - on_obstacle
                distance = np.linalg.norm(away, axis=-1)
                closer = distance - radius < least
                least = np.where(closer, distance - radius, least)
                points = np.where(closer[..., None], on_link, points)
                unit = away / np.maximum(distance, 1e-300)[..., None]
                directions = np.where(closer[..., None], unit, directions)
        return points, directions * self.strength[..., None]

    def _pushes_in_space(self) -> tuple[Array, Array]:
        """The same as the core measures it, at the places where the lines of the forces leave the links."""
        points, forces = self.joints[:, :-1].copy(), np.zeros_like(self.joints[:, :-1])
        pushed = np.flatnonzero((self.strength > 0.0).any(axis=1))
        if self.measured is None or not len(pushed):
            return points, forces
        pairs = max(1, len(self.parts) * len(self.cores))
        for rows in np.array_split(pushed, 1 + pairs * len(pushed) // _PAIRS):
            found = self.measured.at(rows, self)
            for i in np.unique(found.link):
                own = np.flatnonzero(found.link == i)
                best = own[found.distance[:, own].argmin(axis=1)]
                start, away = (each[np.arange(len(rows)), best] for each in (found.point, found.normal))
                ways = [
                    geometry.way_out(part.corners[rows], part.radius, start, away)
                    for part in self.parts
                    if part.index == i
                ]
                points[rows, i] = start + np.maximum(np.max(ways, axis=0), 0.0)[:, None] * away
                forces[rows, i] = self.strength[rows, i, None] * away
        return points, forces

    def at(self, row: int, only: Collection[Role] | None = None) -> list[Primitive]:
        """Everything that there is at one instant, or what has one of some roles, in the order of `ROLES`."""
        return [each for role in ROLES if only is None or role in only for each in self._parts(role, row)]

    def _solid_at(self, index: int, row: int) -> Array:
        corners = self.corners(index)
        return np.asarray(corners[row if len(corners) > 1 else 0] + self.obstacles[row, index])

    def _parts(self, role: Role, row: int) -> Iterator[Primitive]:
        match role:
            case "influence" if self.influence > 0.0:
                for index, (_, radius) in enumerate(self.cores):
                    if self.clouds[index] is None and index not in self.unseen:
                        yield Body(role, index, self._solid_at(index, row), radius + self.influence)
            case "obstacle":
                for index, (_, radius) in enumerate(self.cores):
                    points = self.cloud(index, row)
                    if points is None:
                        seen = index not in self.unseen
                        yield Body(role, index, self._solid_at(index, row), radius, seen)
                    else:
                        yield Cloud(role, index, points, radius)
            case "base" if self.dimension == 3:
                for part in self.parts:
                    if part.index < 0:
                        yield Body(role, part.index, part.corners[row], part.radius)
            case "base":
                yield Marks(role, self.joints[row, :1])
            case "reference" if self.moves:
                yield Curve(role, self.reference)
            case "plan":
                for part in self.plan:
                    yield Body(role, part.index, part.corners[row], part.radius)
            case "link":
                for part in self.parts:
                    if part.index >= 0:
                        yield Body(role, part.index, part.corners[row], part.radius)
            case "joint":
                yield Marks(role, self.joints[row])
            case "trail":
                yield Curve(role, self.tip[: row + 1])
            case "tool" if self.turns is not None:
                yield Axes(role, self.tip[row], self.turns[row], 0.12 * self.reach)
            case "force":
                points, forces = self.pushes
                for index, (place, vector) in enumerate(zip(points[row], forces[row], strict=True)):
                    yield Arrow(role, index, place, vector)
            case "wrench" if self.wrenches is not None:
                points, forces = self.wrenches
                for index, (place, vector) in enumerate(zip(points[row], forces[row], strict=True)):
                    yield Arrow(role, index, place, vector)
            case "sensed" if self.sensed is not None:
                met = self.sensed[row]
                yield Marks(role, met[np.isfinite(met).all(axis=-1)])
            case "target":
                yield Marks(role, self.reference[row : row + 1])

    def instants(self, count: int) -> Rows:
        """Indices of instants that show the scene best: as much motion between one and the next everywhere.

        Half of the measure is time, so that a long rest is not skipped altogether. Of an arm that follows a
        plan the instant at which it is farthest from it takes the place of the nearest one of these.
        """
        places = np.concatenate([self.joints, self.obstacles], axis=1)
        path = np.linalg.norm(np.diff(places, axis=0), axis=2).sum(axis=1)
        measure = np.concatenate([[0.0], np.cumsum(path)])
        measure /= measure[-1] or 1.0
        measure += (self.t - self.t[0]) / ((self.t[-1] - self.t[0]) or 1.0)
        chosen = np.searchsorted(measure, np.linspace(0.0, measure[-1], count))
        if self.plan and count > 2:
            farthest = int(self.plan_deviation.argmax())
            inner = chosen[1:-1]  # begin and end are always shown
            inner[np.abs(measure[inner] - measure[farthest]).argmin()] = farthest
        return np.unique(np.minimum(chosen, len(self.t) - 1))

    @property
    def plan_deviation(self) -> Array:
        """How far a point of the arm is from where the plan has it (T,) [m]; 0 without a plan."""
        links = (part for part in self.parts if part.index >= 0)
        away = [
            np.linalg.norm(part.corners - wanted.corners, axis=-1).max(axis=1)
            for part, wanted in zip(links, self.plan, strict=False)
        ]
        return np.asarray(np.max([np.zeros(len(self.t)), *away], axis=0))

    def frame(
        self, margin: float = 0.12, view: Array | None = None, *, field: bool = False, around: float = AROUND
    ) -> tuple[Array, Array]:
        """The corners (2,) and (2,) [m] of a picture of the arm at all times and of what it meets.

        Obstacles count where they come near the arm, with a `field` also the ring around them at the start;
        one that passes far away, or is large, does not shrink the picture by more than `around` allows.
        """
        places = [self.joints.reshape(-1, self.dimension)]
        places += [each.corners.reshape(-1, self.dimension) for each in (*(self.solids or ()), *self.plan)]
        arm = geometry.seen(np.vstack(places), view)
        every = np.vstack([arm, geometry.seen(self.reference, view)])
        low, high = every.min(axis=0), every.max(axis=0)
        reach = around * float((high - low).max())
        inner = low, high
        for index, (corners, radius) in enumerate(self.cores):
            if self.dimension == 3 and geometry.is_surface(corners):
                continue  # a surface has no end
            if len(self.corners(index)) > 1:  # as far as it reaches on its way round
                reaches = float(np.linalg.norm(corners, axis=1).max())
                corners, radius = np.zeros((1, self.dimension)), radius + reaches
            points = geometry.outline(corners, radius, view)
            ring = geometry.outline(corners, radius + self.influence, view)
            place = geometry.seen(self.obstacles[:, index], view)
            near = np.all((place > inner[0] - reach) & (place < inner[1] + reach), axis=1)
            if near.any():
                low = np.minimum(
                    low, np.maximum((place[near] + points.min(axis=0)).min(axis=0), inner[0] - reach)
                )
                high = np.maximum(
                    high, np.minimum((place[near] + points.max(axis=0)).max(axis=0), inner[1] + reach)
                )
            if field and near[:1].any():
                low = np.minimum(low, np.maximum(place[0] + ring.min(axis=0), inner[0] - 1.6 * reach))
                high = np.maximum(high, np.minimum(place[0] + ring.max(axis=0), inner[1] + 1.6 * reach))
        pad = margin * float((high - low).max()) / 2 + float(self.radii.max())
        return low - pad, high + pad


def ghost(result: Outcome) -> Array | None:
    """Where the joints of the plan are drawn, (T, n): within the arm as long as there is none."""
    if result.q_plan is None or np.isnan(result.q_plan).all():
        return None
    return np.where(np.isnan(result.q_plan), result.q, result.q_plan)


def drawable(result: Outcome) -> Outcome:
    """The result up to where its numbers end: a diverged run may leave NaN in its last rows.

    Raises
    ------
    vffnull.errors.InputError
        If nothing is left to draw.
    """
    sound = np.all(np.isfinite(result.q) & np.isfinite(result.dq), axis=1)
    if sound.size and sound.all():
        return result
    rows = int(np.argmin(sound)) if sound.size else 0
    if not rows:
        raise InputError("result: there is no recorded instant to draw")
    cut = {name: values[:rows] for name, values in recorded(result).items()}
    return dataclasses.replace(result, t=result.t[:rows], **cut)  # type: ignore[arg-type]


def travels(places: Array) -> bool:
    """Whether places (T, D) are not all the same."""
    return bool(np.ptp(places, axis=0).max(initial=0.0) > 0.0)
