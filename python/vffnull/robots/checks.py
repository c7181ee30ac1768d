"""The model of an arm against the robot: to be looked at before the first motion.

A controller with a wrong model holds nothing still and pushes where it should not. What a robot can be asked
for, or measures, is compared with what the model says: the torque against gravity at some postures, and the
mass matrix; from a recorded motion, what a load and the friction of the joints are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vffnull._support.arguments import array, positive, whole
from vffnull.robots.identification import Identified, identify, keep_within_stops

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from vffnull._core import Arm

    Array = NDArray[np.float64]

__all__ = ["Comparison", "Identified", "gravity", "identify", "mass_matrix", "postures"]


@dataclass(frozen=True, eq=False)
class Comparison:
    """What the model says, and what the robot says.

    Attributes
    ----------
    unit : str
        Of both.
    model, robot : (k, …) ndarray
        A row per posture.
    joints : tuple of str
        Names of the joints.
    """

    unit: str
    model: Array
    robot: Array
    joints: tuple[str, ...]

    @property
    def difference(self) -> Array:
        """Robot minus model (k, …)."""
        return self.robot - self.model

    @property
    def worst(self) -> float:
        """The largest difference, whatever its sign."""
        return float(np.abs(self.difference).max())

    @property
    def relative(self) -> float:
        """The largest difference as a share of the largest value of the model."""
        most = float(np.abs(self.model).max())
        return self.worst / most if most > 0.0 else (0.0 if self.worst == 0.0 else np.inf)

    def __str__(self) -> str:
        def rows(values: Array) -> list[float]:  # of every joint, over whatever else there is
            most = np.abs(values).reshape(len(values), len(self.joints), -1).max(axis=(0, 2))
            return [float(each) for each in most]

        wide = max(len("joint"), *map(len, self.joints))
        head = f"{'joint':{wide}}  {'model, most':>12}  {'difference':>12}   [{self.unit}]"
        pairs = zip(self.joints, rows(self.model), rows(self.difference), strict=True)
        lines = [f"{name:{wide}}  {most:12.3f}  {off:12.3f}" for name, most, off in pairs]
        return "\n".join(
            [head, *lines, f"largest difference: {self.worst:.3g} {self.unit} ({self.relative:.1%})"]
        )


def postures(arm: Arm, around: ArrayLike, count: int = 10, spread: float = 0.3, seed: int = 0) -> Array:
    """Some postures in which a model can be told from another, near one that is known to be safe.

    They are drawn at random within `spread` of it, and within nine tenths of the joints' ranges; a joint
    that is nearer to a stop there stays at most as near. Nothing is known of what stands around the robot:
    look at each before you go there, slowly.

    Parameters
    ----------
    arm : Arm
        The model.
    around : (n,) array_like
        The posture in the middle, between the joint stops [rad, m].
    count : int, optional
        How many.
    spread : float, optional
        How far a joint goes from there at most [rad, m].
    seed : int, optional
        Of the random numbers.

    Returns
    -------
    (count, n) ndarray
        A posture per row; the first is `around`.

    Raises
    ------
    vffnull.errors.InputError
        If a value makes no sense, or a joint of `around` is beyond its stop.
    """
    middle = array("around", around, (arm.n,))
    count, spread = whole("count", count, 1, 10_000), positive("spread", spread)
    keep_within_stops("around", arm, middle[None])
    low, high = middle - spread, middle + spread
    if arm.joint_limits is not None:
        ends = np.asarray(arm.joint_limits)
        rim = np.where(np.isfinite(ends[:, 1] - ends[:, 0]), 0.05 * (ends[:, 1] - ends[:, 0]), 0.0)
        low, high = np.maximum(low, ends[:, 0] + rim), np.minimum(high, ends[:, 1] - rim)
        low, high = np.minimum(low, middle), np.maximum(high, middle)
    found = np.random.default_rng(whole("seed", seed, 0, 2**63)).uniform(low, high, (count, arm.n))
    found[0] = middle
    return found


def gravity(arm: Arm, q: ArrayLike, torque: ArrayLike) -> Comparison:
    """Compare the torque against gravity.

    Parameters
    ----------
    arm : Arm
        The model.
    q : (k, n) array_like
        Postures [rad] in which the arm was at rest: those that were measured, not those that were asked for.
    torque : (k, n) array_like
        The joint torques there [N·m]: what the robot measures, or what its maker's model says. A measured
        one has dry friction in it, of a sign that depends on how the posture was reached: go to each from
        two sides, and take the mean.

    Raises
    ------
    vffnull.errors.InputError
        If an array has the wrong shape or is not finite.
    """
    states = array("q", q, (None, arm.n))
    found = array("torque", torque, states.shape)
    return Comparison("N·m", np.array([arm.gravity_torque(each) for each in states]), found, _names(arm))


def mass_matrix(arm: Arm, q: ArrayLike, matrix: ArrayLike) -> Comparison:
    """Compare the mass matrix with that of the maker's model.

    Parameters
    ----------
    arm : Arm
        The model.
    q : (k, n) array_like
        Postures [rad].
    matrix : (k, n, n) array_like
        The mass matrix there [kg·m²]. Some makers leave out the inertia of the motors' rotors, some do not:
        the difference is then a constant diagonal, which is `armature` of an arm.

    Raises
    ------
    vffnull.errors.InputError
        If an array has the wrong shape or is not finite.
    """
    states = array("q", q, (None, arm.n))
    found = array("matrix", matrix, (len(states), arm.n, arm.n))
    return Comparison("kg·m²", np.array([arm.mass_matrix(each) for each in states]), found, _names(arm))


def _names(arm: Arm) -> tuple[str, ...]:
    return tuple(arm.joint_names)
