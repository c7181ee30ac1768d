"""What is odd about a scenario and takes the arm's matrices to find: what is too stiff for a step."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any

from vffnull import _core
from vffnull._arm import arm_of
from vffnull._document import Document

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

__all__ = ["friction", "oddities"]

_FASTEST = 2.0  # Euler's limit for a decay rate times the step; that of Runge and Kutta is 2.8

_latest: tuple[Document, Any] | None = None


def oddities(document: Document) -> list[str]:
    """What is allowed but probably not meant, in sentences; the core finds the rest.

    Parameters
    ----------
    document : dict
        The scenario, which has been checked.
    """
    import numpy as np

    found = []
    for look in (_stiff_friction, _stiff_posture):
        with suppress(np.linalg.LinAlgError), np.errstate(all="ignore"):  # numbers beyond all reason
            found += look(document)
    return found


def _stiff_friction(document: Document) -> list[str]:
    """Viscous friction too fast for the step of the simulation, which integrates it explicitly.

    Files of small arms often have a damping that stops a light wrist within microseconds; a step of a
    millisecond then makes it swing, or diverge.
    """
    import numpy as np

    viscous = friction(document, "viscous_friction")
    if not viscous.any():
        return []
    arm = _core.plant(document)
    # Symmetric, with the eigenvalues of M⁻¹B: how fast friction alone stops the arm.
    root = np.sqrt(viscous)
    rates, modes = np.linalg.eigh(root[:, None] * np.linalg.inv(arm.mass_matrix(document["q0"])) * root)
    numerics = document.get("simulation", {})
    step, rate = numerics.get("dt", 1e-3), float(rates[-1])
    if rate * step <= _FASTEST:
        return []
    joint = arm.joint_names[int(np.abs(modes[:, -1]).argmax())]
    finer = math.ceil(rate * step / _FASTEST)
    every = finer * numerics.get("control_every", 1)
    sampled = "" if numerics.get("control") == "continuous" else f" and simulation.control_every = {every}"
    return [
        f"plant: viscous friction stops `{joint}` at a rate of {rate:.3g} 1/s, too fast for a step of "
        f"{step:g} s: it swings or diverges. simulation.dt = {step / finer:.6g}{sampled} can follow it; "
        "plant.viscous_friction = 0 takes it away"
    ]


def friction(document: Mapping[str, Any], key: str) -> Array:
    """Friction of the plant's joints, (n,), where it is not given that of the arm.

    Parameters
    ----------
    document : Mapping
        The scenario, which has been checked.
    key : str
        ``"viscous_friction"`` [N·m·s/rad or N·s/m] or ``"coulomb_friction"`` [N·m or N].
    """
    import numpy as np

    given, arm = (document.get("plant") or {}).get(key), document["arm"]
    if given is None:
        given = _own(arm["model"], key) if "model" in arm else _rubbing(arm.get("joints", ()), key)
    return np.broadcast_to(np.asarray(given or 0.0, dtype=float), len(document["q0"]))


_KEYS = {"viscous_friction": "damping", "coulomb_friction": "friction"}
"""What they are called in the description of an arm."""


def _rubbing(joints: Iterable[Mapping[str, Any]], key: str) -> tuple[float, ...]:
    return tuple(joint.get(_KEYS[key], 0.0) for joint in joints)


@cache
def _own(model: str, key: str) -> tuple[float, ...]:
    """That of a bundled arm."""
    return _rubbing(_core.arm_model(model)["joints"], key)


def _stiff_posture(document: Document) -> list[str]:
    """A posture spring that a held torque makes unstable: (T34) with K_n that of the spring, at q0."""
    import numpy as np

    controller, numerics = document.get("controller", {}), document.get("simulation", {})
    spring = np.asarray(controller.get("posture_stiffness", 0.0), dtype=float)
    if numerics.get("control") == "continuous" or not spring.any():
        return []
    arm, q0 = _arm(document["arm"]), document["q0"]
    Z = _null_space(arm, q0, controller.get("task", "position"))
    root = np.sqrt(np.broadcast_to(np.asarray(controller.get("null_damping", 2.0), dtype=float), arm.n))
    D = Z.T @ (root[:, None] * arm.mass_matrix(q0) * root) @ Z
    K = Z.T @ (np.broadcast_to(spring, arm.n)[:, None] * Z)
    if not Z.size or np.linalg.cond(D) > 1e12:  # undamped on purpose: no period is short enough
        return []
    rates, modes = np.linalg.eig(np.linalg.solve(D, K))
    worst = int(rates.real.argmax())
    longest = 2.0 / float(rates.real[worst])
    period = numerics.get("dt", 1e-3) * numerics.get("control_every", 1)
    if period < longest:
        return []
    joint = arm.joint_names[int(np.abs(Z @ modes[:, worst]).argmax())]
    return [
        f"controller.posture_stiffness: held over a control period of {period:g} s it lets `{joint}` swing "
        f"more and more; at q0 the null space is stable up to {longest:.2g} s. Less of it at light joints, "
        "more null_damping or a shorter period helps"
    ]


def _arm(document: Document) -> Any:
    """The arm of an ``[arm]`` table; many runs have the same, and are asked one after another."""
    global _latest
    latest = _latest  # threads may take turns
    if latest is None or latest[0] != document:
        _latest = latest = (document, arm_of(document))
    return latest[1]


def _null_space(arm: Any, q: Any, task: str) -> Array:
    """An orthonormal basis of the joint velocities that the task does not see, (n, n − m)."""
    import numpy as np

    J = arm.jacobian(q)
    if arm.dimension == 2:
        J = J if task == "position" else np.vstack([J, np.ones(arm.n)])
    elif task == "position":
        J = J[:3]
    elif task == "pointing":
        w, x, y, z = arm.pose(q)[1]
        axis = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        J = np.vstack([J[:3], np.cross(axis, J[3:], axisb=0, axisc=0)])
    _, sizes, rows = np.linalg.svd(J)
    basis: Array = rows[int((sizes > 1e-9 * sizes[0]).sum()) :].T
    return basis
