"""What stands in the arm's way: shapes, and where they are.

In the plane points have two coordinates, in space three: the length of a point decides where an obstacle is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull._support.arguments import suggesting
from vffnull._support.errors import InputError, InputTypeError, ScenarioError
from vffnull.model.document import Document, frozen, plain

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from vffnull.model.motion import Motion

__all__ = ["Obstacle"]


@suggesting
@dataclass(frozen=True)
class Obstacle:
    """A solid body.

    Made by `circle` or `polygon` in the plane, `sphere`, `half_space` or `points` in space, and in both by
    `capsule`, `box` or `convex`.

    Attributes
    ----------
    kind : str
        ``"circle"``, ``"polygon"``, ``"sphere"``, ``"half_space"``, ``"points"``, ``"convex"``, ``"capsule"``
        or ``"box"``.
    dimensions : tuple of (str, value)
        The shape in the obstacle's own frame, in a form that can be compared and hashed.
    position : tuple of float
        Origin of the obstacle's frame at rest [m], two coordinates in the plane and three in space.
    angle : float
        Orientation of the obstacle's frame in the plane [rad].
    orientation : tuple of float or None
        Orientation of the obstacle's frame in space, a unit quaternion ``(w, x, y, z)``; None is not turned.
    angular_velocity : float or tuple of float or None
        How fast it turns about its position [rad/s]: in the plane a number, anticlockwise; in space a vector
        along world axes; None does not turn.
    motion : Motion or None
        How the position changes with time; None stays.
    contact : tuple of (str, float) or None
        How it resists links that press into it, as `with_contact` says; None is not felt.
    ignore : tuple of str
        Links that may touch it, as `ignored_by` says.
    margin : float or None
        What every link keeps from it [m], as `with_margin` says; None is the usual margin.
    margins : tuple of (str, float)
        What links keep from it by their names [m], in place of `margin`.
    likelihood : float or None
        How likely it is that something will be there, as `with_likelihood` says; None is there.
    future : str or None
        What that future is called, if it has several parts.

    Raises
    ------
    vffnull.errors.ScenarioError
        If the shape is no shape: a negative radius, a polygon that is not convex, a NaN, …
    """

    kind: str
    dimensions: tuple[tuple[str, Any], ...]
    position: tuple[float, ...]
    angle: float = 0.0
    motion: Motion | None = None
    orientation: tuple[float, float, float, float] | None = None
    angular_velocity: float | tuple[float, float, float] | None = None
    contact: tuple[tuple[str, float], ...] | None = None
    ignore: tuple[str, ...] = ()
    margin: float | None = None
    margins: tuple[tuple[str, float], ...] = ()
    likelihood: float | None = None
    future: str | None = None

    def __post_init__(self) -> None:
        _core.check("obstacle", self.to_dict())

    @staticmethod
    def circle(
        center: ArrayLike,
        radius: float,
        motion: Motion | None = None,
        *,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """A disc.

        Parameters
        ----------
        center : (2,) array_like
            Centre at rest [m].
        radius : float
            Radius [m], positive.
        motion : Motion, optional
            How it moves.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        return _obstacle("circle", center, motion=motion, spin=angular_velocity, radius=radius)

    @staticmethod
    def sphere(
        center: ArrayLike,
        radius: float,
        motion: Motion | None = None,
        *,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """A ball in space.

        Parameters
        ----------
        center : (3,) array_like
            Centre at rest [m].
        radius : float
            Radius [m], positive.
        motion : Motion, optional
            How it moves.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        return _obstacle("sphere", center, motion=motion, spin=angular_velocity, radius=radius)

    @staticmethod
    def half_space(
        point: ArrayLike,
        normal: ArrayLike,
        motion: Motion | None = None,
        *,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """Everything behind a plane: a floor, a wall, a ceiling.

        Parameters
        ----------
        point : (3,) array_like
            A point of the surface at rest [m].
        normal : (3,) array_like
            Unit vector out of the solid.
        motion : Motion, optional
            How it moves.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        return _obstacle("half_space", point, motion=motion, spin=angular_velocity, normal=normal)

    @staticmethod
    def capsule(
        a: ArrayLike,
        b: ArrayLike,
        radius: float,
        motion: Motion | None = None,
        *,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """All points nearer than `radius` to the segment from `a` to `b`; its position is the midpoint.

        Parameters
        ----------
        a, b : (2,) or (3,) array_like
            Ends of the segment at rest [m].
        radius : float
            Radius [m], positive.
        motion : Motion, optional
            How it moves.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        ends = _points([a, b])
        if ends is None:  # the core says what is wrong with them
            return _obstacle(
                "capsule", (0.0, 0.0), motion=motion, spin=angular_velocity, a=a, b=b, radius=radius
            )
        middle = ends.mean(axis=0)
        a, b = ends - middle
        return _obstacle("capsule", middle, motion=motion, spin=angular_velocity, a=a, b=b, radius=radius)

    @staticmethod
    def box(
        center: ArrayLike,
        size: ArrayLike,
        angle: float = 0.0,
        motion: Motion | None = None,
        *,
        orientation: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """A rectangle, in space a cuboid.

        Parameters
        ----------
        center : (2,) or (3,) array_like
            Centre at rest [m].
        size : (2,) or (3,) array_like
            Lengths of the edges [m] in the box's own frame.
        angle : float, optional
            Rotation of the box in the plane [rad].
        motion : Motion, optional
            How it moves.
        orientation : (4,) array_like, optional
            Rotation of the box in space, a unit quaternion ``[w, x, y, z]``.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        return _obstacle(
            "box",
            center,
            angle=angle,
            motion=motion,
            spin=angular_velocity,
            orientation=orientation,
            size=size,
        )

    @staticmethod
    def polygon(
        vertices: ArrayLike,
        motion: Motion | None = None,
        *,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """A convex polygon; its position is the mean of the vertices.

        Parameters
        ----------
        vertices : (k, 2) array_like
            Corners at rest [m], in order.
        motion : Motion, optional
            How it moves.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        corners = _points(vertices)
        if corners is None:  # no mean to take: the core says what is wrong with them
            return _obstacle("polygon", (0.0, 0.0), motion=motion, spin=angular_velocity, vertices=vertices)
        middle = corners.mean(axis=0)
        return _obstacle("polygon", middle, motion=motion, spin=angular_velocity, vertices=corners - middle)

    @staticmethod
    def convex(
        vertices: ArrayLike,
        motion: Motion | None = None,
        *,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """The convex hull of points, in any order; its position is the mean of its corners.

        Points within the hull do not count. In the plane this is a `polygon`. `vffnull.arms.meshes.enclose`
        makes such hulls of the file of a mesh.

        Parameters
        ----------
        vertices : (k, 2) or (k, 3) array_like
            Points at rest [m]: three or more that do not lie on a line, in space four or more that do not lie
            in a plane. There, the hull has at most 64 corners.
        motion : Motion, optional
            How it moves.
        angular_velocity : float or (3,) array_like, optional
            How fast it turns about its position [rad/s]: a number in the plane, a vector in space.
        """
        points = _points(vertices)
        if points is None or not _finite(points):  # the core says what is wrong with them
            return _obstacle(
                "convex", (0.0, 0.0, 0.0), motion=motion, spin=angular_velocity, vertices=vertices
            )
        if points.shape[1] == 2:
            from vffnull.model.hull import hull

            return Obstacle.polygon(hull(points), motion, angular_velocity=angular_velocity)
        try:
            corners = points[sorted({i for face in _core.hull(points) for i in face})]
        except InputError:
            return _obstacle(
                "convex", points.mean(axis=0), motion=motion, spin=angular_velocity, vertices=points
            )
        middle = corners.mean(axis=0)
        return _obstacle("convex", middle, motion=motion, spin=angular_velocity, vertices=corners - middle)

    @staticmethod
    def points(
        cloud: ArrayLike,
        radius: float,
        motion: Motion | None = None,
        *,
        position: ArrayLike = (0.0, 0.0, 0.0),
        orientation: ArrayLike | None = None,
        angular_velocity: ArrayLike | None = None,
    ) -> Obstacle:
        """A cloud of points in space, such as a depth camera sees: a ball around each.

        All that come near a link push it together about as hard as the nearest would alone, however many
        they are (T192). `Controller.update_points`, `Simulation.update_points` and `LivePage.update_points`
        replace the points while a loop runs.

        Parameters
        ----------
        cloud : (k, 3) array_like
            The points [m], relative to `position`: at most 50 000, maybe none.
        radius : float
            Radius of the balls [m], 0 or more.
        motion : Motion, optional
            How it moves.
        position : (3,) array_like, optional
            Where the origin of the points is at rest [m].
        orientation : (4,) array_like, optional
            Rotation of the points about it, a unit quaternion ``[w, x, y, z]``.
        angular_velocity : (3,) array_like, optional
            How fast they turn about it [rad/s].
        """
        return _obstacle(
            "points",
            position,
            motion=motion,
            spin=angular_velocity,
            orientation=orientation,
            points=cloud,
            radius=radius,
        )

    def with_contact(
        self,
        *,
        stiffness: float | None = None,
        damping: float | None = None,
        friction: float | None = None,
        seen: bool | None = None,
    ) -> Obstacle:
        """The same obstacle, felt by an arm that touches it: it can be hit, leant on, slid along.

        Parameters
        ----------
        stiffness : float, optional
            Force per depth [N/m]; 10⁵ by default.
        damping : float, optional
            By which share the force is larger per speed at which a link gets deeper [s/m]; 2 by default.
        friction : float, optional
            Coulomb's coefficient; 0.5 by default.
        seen : bool, optional
            Whether the controller knows of it; it does by default. What it does not know of is felt alone.

        Returns
        -------
        Obstacle
            It with this contact (docs/theory.md, T148).

        Raises
        ------
        vffnull.errors.ScenarioError
            If a number makes no sense.

        Examples
        --------
        >>> table = Obstacle.half_space([0, 0, 0.2], [0, 0, 1]).with_contact(friction=0.3)
        >>> table.to_dict()["contact"]
        {'friction': 0.3}
        """
        given = {"stiffness": stiffness, "damping": damping, "friction": friction, "seen": seen}
        contact = tuple((name, frozen(value)) for name, value in given.items() if value is not None)
        return replace(self, contact=contact)

    def ignored_by(self, *links: str) -> Obstacle:
        """The same obstacle, which these links may touch, as fingers what they grasp.

        Law, look-ahead, plans, clearance and metrics do not measure them against it.

        Parameters
        ----------
        *links : str
            Names of links; ``"load"`` is what the arm carries, which the name of its link does not mean.

        Returns
        -------
        Obstacle
            It, ignored by these links and no other.

        Examples
        --------
        >>> cup = Obstacle.capsule([0.5, 0, 0.05], [0.5, 0, 0.15], 0.03)
        >>> cup.ignored_by("panda_link7").to_dict()["ignore"]
        ['panda_link7']
        """
        return replace(self, ignore=tuple(links))

    def with_margin(self, margin: float | None = None, links: Mapping[str, float] | None = None) -> Obstacle:
        """The same obstacle, from which another distance is kept than from all others.

        It takes the place of ``yielding.margin`` in ``"cbf"``, ``"priority"`` and look-ahead, and of the
        margin of `vffnull.plan`. Fields, and with them ``"null_space"`` and ``"relaxed"``, have no margin:
        they begin at their own distances.

        Parameters
        ----------
        margin : float, optional
            What every link keeps [m], > 0, and what the arm carries; by default the usual margin.
        links : Mapping, optional
            What links keep in place of it [m], > 0, by their names; ``"load"`` is what the arm carries, which
            the name of its link does not mean.

        Returns
        -------
        Obstacle
            It, with these margins and no other.

        Raises
        ------
        vffnull.errors.ScenarioError
            If a margin is not a positive number, or that of a link that may touch the obstacle.

        Examples
        --------
        >>> table = Obstacle.half_space([0, 0, 0.2], [0, 0, 1]).with_margin(0.03, {"panda_link7": 0.005})
        >>> table.to_dict()["margin"], table.to_dict()["margins"]
        (0.03, {'panda_link7': 0.005})
        """
        return replace(self, margin=margin, margins=tuple((links or {}).items()))

    def with_likelihood(self, likelihood: float | None, future: str | None = None) -> Obstacle:
        """A possible future in place of an obstacle: look-ahead alone sees it, where its motion has it then.

        One of several ways in which somebody may go on, each an obstacle whose motion begins where that body
        is now. The body itself is an obstacle without a likelihood, from which the law keeps away as ever.

        Parameters
        ----------
        likelihood : float or None
            How likely it is, in (0, 1]. Futures are left out from the least likely on, as many as come true
            with a probability of ``controller.yielding.preview.chance`` at most. None is there.
        future : str, optional
            What it is called where it has several parts, such as the capsules of a person, which come
            together and count once, as the likeliest of them.

        Returns
        -------
        Obstacle
            It, as a possible future.

        Raises
        ------
        vffnull.errors.ScenarioError
            If the likelihood is not in (0, 1], or there is none of a future with a name.

        Examples
        --------
        >>> from vffnull import Motion
        >>> reaching = Motion.waypoints([0, 1], [[1.2, 0, 0.5], [0.5, 0, 0.5]])
        >>> hand = Obstacle.sphere([1.2, 0, 0.5], 0.1, motion=reaching).with_likelihood(0.3)
        >>> hand.to_dict()["likelihood"]
        0.3
        """
        return replace(self, likelihood=likelihood, future=future)

    @property
    def shape(self) -> Mapping[str, Any]:
        """The shape as a part of a scenario document."""
        return {"kind": self.kind, **plain(dict(self.dimensions))}

    def to_dict(self) -> Document:
        """The obstacle as a part of a scenario document."""
        document: Document = {"shape": self.shape, "position": list(self.position)}
        if self.angle:
            document["angle"] = self.angle
        if self.orientation is not None:
            document["orientation"] = list(self.orientation)
        if self.angular_velocity is not None:
            document["angular_velocity"] = plain(self.angular_velocity)
        if self.motion is not None:
            document["motion"] = plain(self.motion)
        if self.ignore:
            document["ignore"] = list(self.ignore)
        if self.margin is not None:
            document["margin"] = self.margin
        if self.margins:
            document["margins"] = dict(self.margins)
        if self.likelihood is not None:
            document["likelihood"] = self.likelihood
        if self.future is not None:
            document["future"] = self.future
        if self.contact is not None:
            document["contact"] = dict(self.contact)
        return document

    def __repr__(self) -> str:
        parts = [f"{name}={_short(value)}" for name, value in self.dimensions]
        parts.append(f"position={self.position!r}")
        if self.angle:
            parts.append(f"angle={self.angle!r}")
        if self.orientation is not None:
            parts.append(f"orientation={self.orientation!r}")
        if self.angular_velocity is not None:
            parts.append(f"angular_velocity={self.angular_velocity!r}")
        if self.motion is not None:
            parts.append(f"motion={self.motion!r}")
        if self.contact is not None:
            parts.append(f"contact={dict(self.contact)!r}")
        if self.ignore:
            parts.append(f"ignore={self.ignore!r}")
        if self.margin is not None:
            parts.append(f"margin={self.margin!r}")
        if self.margins:
            parts.append(f"margins={dict(self.margins)!r}")
        if self.likelihood is not None:
            parts.append(f"likelihood={self.likelihood!r}")
        if self.future is not None:
            parts.append(f"future={self.future!r}")
        return f"<Obstacle {self.kind}: {', '.join(parts)}>"


def checked(obstacles: object, dimension: int) -> list[Document]:
    """Obstacles of a space of so many dimensions as parts of a scenario document.

    Raises
    ------
    vffnull.errors.ScenarioError
        If one is none; the message has its place in the list.
    vffnull.errors.InputTypeError
        If they are no list of `Obstacle` or dict.
    """
    documents = plain(obstacles, "obstacles")
    if not isinstance(documents, list) or not all(isinstance(each, dict) for each in documents):
        raise InputTypeError("obstacles: expected a list of Obstacle or dict")
    for i, document in enumerate(documents):
        try:
            _core.check("obstacle", document, dimension)
        except ScenarioError as error:
            raise ScenarioError(f"obstacles[{i}].{error}", f"obstacles[{i}].{error.path}") from None
    return documents


def _short(value: object) -> str:
    """How a dimension is written: of many points how many they are."""
    return f"<{len(value)} points>" if isinstance(value, tuple) and len(value) > 64 else repr(value)


def _points(given: object) -> NDArray[np.float64] | None:
    """Points as an array (k, 2) or (k, 3), or None if they are none."""
    import numpy as np

    try:
        points = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        return None
    return points if points.ndim == 2 and points.shape[1] in (2, 3) and len(points) else None


def _finite(points: NDArray[np.float64]) -> bool:
    import numpy as np

    return bool(np.isfinite(points).all())


def _obstacle(
    kind: str,
    position: ArrayLike,
    *,
    angle: float = 0.0,
    motion: Motion | None,
    orientation: ArrayLike | None = None,
    spin: ArrayLike | None = None,
    **dimensions: object,
) -> Obstacle:
    shape = tuple((name, frozen(value)) for name, value in dimensions.items())
    turned, turns = (None if each is None else frozen(each) for each in (orientation, spin))
    return Obstacle(kind, shape, frozen(position), frozen(angle), motion, turned, turns)
