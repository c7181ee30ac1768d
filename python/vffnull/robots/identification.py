"""What a recorded motion tells of a load at the tip and of the friction in the joints.

The torque of an arm is linear in both: with `Arm.inverse_dynamics` of the model, the regressor of a load
(Atkeson, An, Hollerbach 1986: Estimation of inertial parameters of manipulator loads and links), and
viscous and dry friction of every joint

    τ = ID(q, q̇, q̈) + Y(q, q̇, q̈) (m, m c) + B q̇ + F sgn q̇

What is not linear, the inertia of a point mass, m (c²1 − c cᵀ) about the tip, is that of the estimate
before; it is small. Both sides are averaged over windows first, alike, which keeps them equal and takes the
noise out. A load has more inertia than a point, and a measured torque may be off by a constant: where these
explain what is left better than noise does, what they would change is part of the errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from vffnull._support.arguments import array, positive
from vffnull._support.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from vffnull._core import Arm

    Array = NDArray[np.float64]

__all__ = ["Identified", "identify"]

_SLOW = 0.02  # rad/s; below, dry friction may be anything up to itself
_CONDITION = 100.0  # of the scaled regressor; beyond, a motion does not excite (Gautier, Khalil 1992)
_FAR = 1.0  # m; no load is farther from the tip
_ROUNDS = 4  # of least squares: with the spread of each joint, and the inertia of the point
_BEYOND = 0.5  # rad or m; no joint is so far beyond its stops
_STILL = 1e-3  # rad or m; a shorter way may be noise
_RATIO = 1.5  # of what positions and velocities say of the same way
_SIGNIFICANT = 4.0  # of the F statistic of inertia and offsets, which is 1 for noise
_EXCITED = 0.02  # of the largest singular value of the scaled regressor; what is excited less stays 0


@dataclass(frozen=True, eq=False)
class Identified:
    """What was found, each with its standard error.

    Attributes
    ----------
    mass, mass_error : float
        Of the load [kg].
    com, com_error : (3,) ndarray
        Its centre of mass in the frame of the tip [m].
    viscous, viscous_error : (n,) ndarray
        Viscous friction of the joints [N·m·s/rad]; zeros where friction was not asked for.
    coulomb, coulomb_error : (n,) ndarray
        Dry friction of the joints [N·m].
    residual : (n,) ndarray
        Root mean square of what is left of each joint's torque [N·m].
    condition : float
        Condition number of the regressor with columns of one length: 1 is best, more than 100 is refused.
    joints : tuple of str
        Names of the joints.
    doubts : tuple of str
        What cannot be: less than nothing of a mass or of friction, beyond three errors.
    """

    mass: float
    mass_error: float
    com: Array
    com_error: Array
    viscous: Array
    viscous_error: Array
    coulomb: Array
    coulomb_error: Array
    residual: Array
    condition: float
    joints: tuple[str, ...]
    doubts: tuple[str, ...] = ()

    def __str__(self) -> str:
        place = ", ".join(f"{c:.4f} ± {e:.4f}" for c, e in zip(self.com, self.com_error, strict=True))
        wide = max(len("joint"), *map(len, self.joints))
        head = f"{'joint':{wide}}  {'viscous [N·m·s/rad]':>21}  {'dry [N·m]':>17}  {'left [N·m]':>10}"
        lines = [
            f"{name:{wide}}  {self.viscous[i]:10.3f} ± {self.viscous_error[i]:8.3f}  "
            f"{self.coulomb[i]:7.3f} ± {self.coulomb_error[i]:7.3f}  {self.residual[i]:10.3f}"
            for i, name in enumerate(self.joints)
        ]
        load = f"load {self.mass:.3f} ± {self.mass_error:.3f} kg at ({place}) m"
        return "\n".join([load, head, *lines, *self.doubts])


def identify(
    arm: Arm,
    t: ArrayLike,
    q: ArrayLike,
    dq: ArrayLike,
    torque: ArrayLike,
    *,
    friction: bool = True,
    window: float = 0.05,
) -> Identified:
    """Estimate a load at the tip and the friction of the joints from a recorded motion.

    The motion has to turn the hand in several directions, and with `friction` every joint both ways. What it
    cannot tell is refused, not guessed. Nothing else may touch the arm meanwhile: that would be a load, too,
    and shows in what is left.

    Parameters
    ----------
    arm : Arm
        The model, in space, without the load.
    t : (T,) array_like
        Times [s], evenly spaced.
    q, dq : (T, n) array_like
        Joint positions [rad, m] and velocities, as they were measured.
    torque : (T, n) array_like
        What the drives exerted from each instant to the next [N·m, N], gravity included.
    friction : bool, optional
        Whether the joints have friction that nobody knows. If not, what there is is taken for the load's.
    window : float, optional
        Over which both sides are averaged [s].

    Returns
    -------
    Identified
        Load, friction, and their standard errors, which count the inertia that a load has beyond that of a
        point, constant errors of the torque, and noise: another error of the model that changes with the
        motion is not in them.

    Raises
    ------
    vffnull.errors.InputError
        If the motion does not excite what is asked for, with the parameters that it leaves open; if
        positions, velocities and times do not belong together; if an array has the wrong shape or is not
        finite, or the arm is one in the plane.

    Examples
    --------
    >>> import vffnull as vff
    >>> run = vff.simulate(
    ...     "iiwa-crowd", {"plant.payload": {"mass": 1.0}, "simulation.record_every": 1}
    ... )
    >>> found = identify(run.scenario.arm, run.t, run.q, run.dq, run.tau, friction=False)
    >>> round(found.mass, 2)
    1.0
    """
    if arm.dimension != 3:
        raise InputError("arm: expected one in space, whose load has a centre of mass")
    times = array("t", t, (None,))
    states, speeds, torques = (
        array(name, given, (len(times), arm.n)) for name, given in (("q", q), ("dq", dq), ("torque", torque))
    )
    period = (times[-1] - times[0]) / max(1, len(times) - 1)
    if len(times) < 3 or np.abs(np.diff(times) - period).max() > 1e-6 * max(period, 1e-9) + 1e-9:
        raise InputError("t: expected three evenly spaced times or more")
    size = max(2, round(positive("window", window) / period))
    count = (len(times) - 1) // size
    if count < 2:
        raise InputError(f"t: expected two windows of {window:g} s or more, got {times[-1] - times[0]:g} s")
    _belong_together(arm, period, states, speeds, size)
    parts = [_averaged(arm, period, states, speeds, torques, k * size, size, friction) for k in range(count)]
    regressor, known, turning, certain = (np.array(each) for each in zip(*parts, strict=True))
    names = _parameters(arm, friction)
    if friction:
        idle = [name for i, name in enumerate(arm.joint_names) if certain[:, i].sum() < 2]
        if idle:
            raise InputError(f"dq: the motion does not excite the friction of {', '.join(idle)}")
    parameters, covariance, left, condition = _solve(regressor, known, turning, certain, names)
    return _found(arm, parameters, covariance, left, condition, friction)


def keep_within_stops(argument: str, arm: Arm, q: Array, reserve: float = 0.0) -> None:
    """Refuses positions (k, n) that are more than a reserve [rad or m] beyond the stop of a joint."""
    limits = arm.joint_limits
    low, high = (-np.inf, np.inf) if limits is None or not len(limits) else np.asarray(limits).T
    beyond = np.maximum(low - q, q - high).max(axis=0)
    if (worst := beyond.max()) > reserve:
        name = arm.joint_names[int(beyond.argmax())]
        raise InputError(f"{argument}: {name} is {worst:.3g} rad or m beyond its stop; expected rad and m")


def _belong_together(arm: Arm, period: float, q: Array, dq: Array, size: int) -> None:
    """Refuses positions and velocities in other units than those of the arm and of the times."""
    keep_within_stops("q", arm, q, _BEYOND)
    ways = q[size::size] - q[:-size:size][: len(q[size::size])]
    told = np.array([period * (0.5 * (dq[k] + dq[k + size]) + dq[k + 1 : k + size].sum(axis=0))
                     for k in range(0, size * len(ways), size)])  # fmt: skip
    ways[np.abs(ways) > np.pi] = 0.0  # a joint that turns without an end has begun anew
    large = np.abs(ways) > max(0.3 * np.abs(ways).max(), _STILL)
    if not large.any():
        return
    with np.errstate(divide="ignore"):
        ratio = float(np.median(ways[large] / told[large]))
    if not 1.0 / _RATIO < ratio < _RATIO:
        raise InputError(
            f"dq: q changes {ratio:.3g} times as fast as it says; expected rad and rad/s, and t in s"
        )


def _averaged(
    arm: Arm, period: float, q: Array, dq: Array, torque: Array, first: int, size: int, friction: bool
) -> tuple[Array, Array, Array, Array]:
    """Of a window: the regressor (n, p), the torque that it is to explain (n,), what a moment of inertia
    of the load adds to that, by its six numbers (n, 6), and where the sign of friction is known (n,).
    """
    n, gravity = arm.n, np.asarray(arm.gravity)
    load, known, turning = np.zeros((n, 4)), np.zeros(n), np.zeros((n, 6))
    middle = 0.5 * (dq[first : first + size] + dq[first + 1 : first + size + 1])
    for k in range(first, first + size):
        # From one instant to the next the torque is constant: the state is that in between.
        at, v, a = 0.5 * (q[k] + q[k + 1]), middle[k - first], (dq[k + 1] - dq[k]) / period
        J, dJ, R = arm.jacobian(at), arm.jacobian_dot(at, v), arm.tip_poses(at[None])[0][:3, :3]
        (vx, wx), w = np.split(J @ a + dJ @ v, 2), (J @ v)[3:]
        felt, turned = vx - gravity, _cross(wx) + _cross(w) @ _cross(w)
        load[:, 0] += J[:3].T @ felt
        load[:, 1:] += J[:3].T @ (turned @ R) - J[3:].T @ (_cross(felt) @ R)
        if k == first + size // 2:  # what is small does not change much
            for column, unit in enumerate(_INERTIAS):
                inertia = R @ unit @ R.T
                turning[:, column] = J[3:].T @ (inertia @ wx + _cross(w) @ (inertia @ w))
        known += torque[k] - arm.inverse_dynamics(at, v, a)
    parts = [load / size]
    certain = np.ones(n, dtype=bool)
    if friction:
        certain = (middle.min(axis=0) > _SLOW) | (middle.max(axis=0) < -_SLOW)
        parts += [np.diag(middle.mean(axis=0)), np.diag(np.sign(middle.mean(axis=0)))]
    return np.hstack(parts), known / size, turning, certain


def _cross(v: Array) -> Array:
    """The matrix of v ×."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


_INERTIAS = [
    np.array(rows, dtype=float)
    for rows in (
        [[1, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 1, 0], [0, 0, 0]],
        [[0, 0, 0], [0, 0, 0], [0, 0, 1]],
        [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
        [[0, 0, 1], [0, 0, 0], [1, 0, 0]],
        [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
    )
]


def _parameters(arm: Arm, friction: bool) -> list[str]:
    load = ["the mass", *(f"the centre of mass along {axis} of the tip" for axis in "xyz")]
    kinds = ("viscous", "dry") if friction else ()
    return load + [f"the {kind} friction of {name}" for kind in kinds for name in arm.joint_names]


def _solve(
    regressor: Array, known: Array, turning: Array, certain: Array, names: list[str]
) -> tuple[Array, Array, Array, float]:
    """Weighted least squares: parameters, covariance, what is left of each joint, condition number."""
    joints = known.shape[1]
    spread, inertia = np.ones(joints), np.zeros(6)
    rows = certain.ravel()
    for _ in range(_ROUNDS):
        weights = np.tile(1.0 / spread, len(known))[rows, None]
        wanted = (known - turning @ inertia).reshape(-1, 1)[rows] * weights
        matrix = regressor.reshape(-1, regressor.shape[-1])[rows] * weights
        length = np.linalg.norm(matrix, axis=0)
        length[length == 0.0] = 1.0
        _, values, directions = np.linalg.svd(matrix / length, full_matrices=False)
        condition = float(values[0] / values[-1]) if values[-1] > 0.0 else np.inf
        if condition > _CONDITION or len(matrix) <= len(names):
            share = np.abs(directions[-1])
            open_ = [names[i] for i in np.argsort(-share) if share[i] > 0.3 * share.max()]
            raise InputError(
                f"q: the motion does not excite {', '.join(open_)} (condition number {condition:.3g})"
            )
        scaled, *_ = np.linalg.lstsq(matrix / length, wanted, rcond=None)
        parameters = scaled[:, 0] / length
        residuals = np.full(known.size, np.nan)
        residuals[rows] = ((wanted - matrix @ parameters[:, None]) / weights)[:, 0]
        left = np.sqrt(np.nanmean(residuals.reshape(known.shape) ** 2, axis=0))
        inverse = directions.T / values**2 @ directions
        variance = float(np.sum((wanted[:, 0] - matrix @ parameters) ** 2)) / (len(matrix) - len(names))
        covariance = variance * inverse / np.outer(length, length)
        spread = np.maximum(left, 1e-9 + 1e-3 * left.max())
        mass, moment = parameters[0], parameters[1:4]
        inertia = np.zeros(6)
        if np.linalg.norm(moment) < mass * _FAR:  # else it is no load, but noise
            c = moment / mass
            about = mass * (c @ c * np.eye(3) - np.outer(c, c))
            inertia = about[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    change = _unmodelled(matrix, wanted[:, 0], turning, weights[:, 0], rows)
    return parameters, covariance + np.outer(change, change), left, condition


def _unmodelled(matrix: Array, wanted: Array, turning: Array, weights: Array, rows: Array) -> Array:
    """What the parameters would change by (p,) if the load had an inertia of its own, and each torque an
    offset: 0 where these explain no more than chance does.
    """
    count, joints = turning.shape[0], turning.shape[1]
    offsets = np.tile(np.eye(joints), (count, 1))
    more = np.hstack([turning.reshape(count * joints, -1), offsets])[rows] * weights[:, None]
    whole = np.hstack([matrix, more])
    length = np.linalg.norm(whole, axis=0)
    length[length == 0.0] = 1.0
    alone, *_ = np.linalg.lstsq(matrix, wanted, rcond=None)
    found, *_ = np.linalg.lstsq(whole / length, wanted, rcond=_EXCITED)
    free = len(wanted) - whole.shape[1]
    before, after = (
        float(np.sum((wanted - a @ x) ** 2)) for a, x in ((matrix, alone), (whole / length, found))
    )
    if free < 1 or (before - after) / more.shape[1] <= _SIGNIFICANT * after / free:
        return np.zeros(matrix.shape[1])
    change: Array = (found / length)[: matrix.shape[1]] - alone
    return change


def _found(
    arm: Arm, parameters: Array, covariance: Array, left: Array, condition: float, friction: bool
) -> Identified:
    n, mass = arm.n, float(parameters[0])
    errors = np.sqrt(np.diag(covariance))
    com, com_error = np.full(3, np.nan), np.full(3, np.inf)
    if mass > 2.0 * errors[0]:  # of what is no load, no centre is known
        com = parameters[1:4] / mass
        for axis in range(3):
            slope = np.array([-com[axis], 1.0]) / mass
            both = covariance[np.ix_([0, 1 + axis], [0, 1 + axis])]
            com_error[axis] = np.sqrt(slope @ both @ slope)
    rest, rest_errors = (each[4:] if friction else np.zeros(2 * n) for each in (parameters, errors))
    doubts = []
    if mass < -3.0 * errors[0]:
        doubts.append(
            "the load has less mass than nothing: expected torques of the drives with gravity in them, "
            "positive where they accelerate a joint, and the arm's own last link"
        )
    less = [name for i, name in enumerate([*arm.joint_names] * 2) if rest[i] < -3.0 * rest_errors[i]]
    if less:
        names = ", ".join(dict.fromkeys(less))
        doubts.append(f"the friction of {names} is less than nothing: no friction drives a joint")
    return Identified(
        mass=mass,
        mass_error=float(errors[0]),
        com=com,
        com_error=com_error,
        viscous=rest[:n],
        viscous_error=rest_errors[:n],
        coulomb=rest[n:],
        coulomb_error=rest_errors[n:],
        residual=left,
        condition=condition,
        joints=tuple(arm.joint_names),
        doubts=tuple(doubts),
    )
