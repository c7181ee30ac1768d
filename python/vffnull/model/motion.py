"""How obstacles move: in the plane points have two coordinates, in space three."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import vffnull._core as _core
from vffnull.model.document import Document, frozen, plain

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

__all__ = ["Motion"]


@dataclass(frozen=True)
class Motion:
    """How an obstacle moves; made by `static`, `linear`, `sinusoid` or `waypoints`.

    Velocities and accelerations follow from the formula, not from differences of positions, so a controller
    knows at every instant how fast an obstacle comes.

    Attributes
    ----------
    kind : str
        ``"static"``, ``"linear"``, ``"sinusoid"`` or ``"waypoints"``.
    parameters : tuple of (str, value)
        The arguments of the constructor, in a form that can be compared and hashed.

    Raises
    ------
    vffnull.errors.ScenarioError
        If a number makes no sense.
    """

    kind: str
    parameters: tuple[tuple[str, Any], ...] = ()

    def __post_init__(self) -> None:
        _core.check("motion", self.to_dict())

    @staticmethod
    def static() -> Motion:
        """Stay where it is."""
        return Motion("static")

    @staticmethod
    def linear(velocity: ArrayLike) -> Motion:
        """Move at a constant velocity.

        Parameters
        ----------
        velocity : (2,) or (3,) array_like
            Velocity [m/s].
        """
        return _motion("linear", velocity=velocity)

    @staticmethod
    def sinusoid(
        amplitude: ArrayLike, angular_frequency: float, phase: float = 0.0, *, foreseen: bool = False
    ) -> Motion:
        """Swing along a line: position + amplitude · sin(angular_frequency · t + phase).

        Parameters
        ----------
        amplitude : (2,) or (3,) array_like
            Largest displacement from the obstacle's position [m].
        angular_frequency : float
            Angular frequency [rad/s].
        phase : float, optional
            Phase at t = 0 [rad].
        foreseen : bool, optional
            Whether look-ahead knows of it, as of a machine that swings; otherwise it predicts that the
            obstacle goes on at the velocity of the moment.
        """
        given = {"foreseen": True} if foreseen else {}
        return _motion(
            "sinusoid", amplitude=amplitude, angular_frequency=angular_frequency, phase=phase, **given
        )

    @staticmethod
    def waypoints(
        times: ArrayLike,
        points: ArrayLike,
        *,
        interpolation: str = "linear",
        angles: ArrayLike | None = None,
        orientations: ArrayLike | None = None,
        foreseen: bool = False,
    ) -> Motion:
        """Go from point to point; wait at the first before, at the last after.

        With rotations it turns meanwhile, in space the shorter way.

        Parameters
        ----------
        times : (k,) array_like
            Increasing instants [s].
        points : (k, 2) or (k, 3) array_like
            Where the obstacle's position is then [m]; the first one must be the obstacle's position.
        interpolation : {"linear", "smooth"}, optional
            Linear: at a constant speed and rate, which jump at the points. Smooth: quintics from rest to
            rest, whose velocities and accelerations do not jump (docs/theory.md, T177); in space the
            quaternions go along such, too (T178).
        angles : (k,) array_like, optional
            Its angle then, in the plane [rad]; the first one must be the obstacle's angle.
        orientations : (k, 4) array_like, optional
            Its orientation then, in space: unit quaternions ``[w, x, y, z]``; the first one must be the
            obstacle's orientation.
        foreseen : bool, optional
            Whether look-ahead knows of it: of another robot whose plan is known, of a door, or by a
            forecast of your own, given anew whenever there is another. Otherwise it predicts that the
            obstacle goes on at the velocity of the moment.

        Examples
        --------
        >>> ramp = Motion.waypoints([0.0, 1.0], [[0, 0, 0], [0.4, 0, 0]], interpolation="smooth")
        >>> print(f"{ramp.top_speed:.2f} m/s, {ramp.top_acceleration:.1f} m/s²")
        0.75 m/s, 2.4 m/s²
        """
        rotations = {"angles": angles, "orientations": orientations}
        given = {name: each for name, each in rotations.items() if each is not None}
        if interpolation != "linear":
            given["interpolation"] = interpolation
        if foreseen:
            given["foreseen"] = True
        return _motion("waypoints", times=times, points=points, **given)

    @property
    def top_speed(self) -> float:
        """A speed that it never exceeds [m/s]."""
        return _core.motion_bounds(self.to_dict())[0]

    @property
    def top_acceleration(self) -> float:
        """An acceleration that it never exceeds [m/s²], jumps at linear way points not counted."""
        return _core.motion_bounds(self.to_dict())[1]

    def to_dict(self) -> Document:
        """The motion as a part of a scenario document."""
        return {"kind": self.kind, **plain(dict(self.parameters))}

    def __repr__(self) -> str:
        inside = ", ".join(f"{name}={value!r}" for name, value in self.parameters)
        return f"Motion.{self.kind}({inside})"


def _motion(kind: str, **parameters: object) -> Motion:
    return Motion(kind, tuple((name, frozen(value)) for name, value in parameters.items()))
