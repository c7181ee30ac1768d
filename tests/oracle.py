"""An independent prototype of the whole loop, in dense NumPy, to judge the compiled core by.

Nothing here is shared with the core and nothing is fast. Every matrix is written down: M and C from the
Jacobians of the centres of mass, the null-space basis Z from an SVD, the torque from the extended Jacobian
``J_e = [J; N_M]``. The core works on O(n) recursions without a basis, so an agreement of the two means
something. Discs only; plant by RK4.

Run as a script, it prints the numbers that the project quotes for its scene ``sweep-through``.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]


def perp(v: Array) -> Array:
    """The vectors ``v`` (..., 2) turned by +90°: the velocity of a point at ``v`` under unit spin."""
    return np.stack([-v[..., 1], v[..., 0]], axis=-1)


# ------------------------------------------------------------------------------------------------- the arm


@dataclass(frozen=True)
class Arm:
    """A planar chain of n revolute links; parameters as in `vffnull.Arm`."""

    lengths: Array
    masses: Array
    com: Array  # (n, 2), in the link's frame
    inertias: Array  # about the centre of mass
    radius: Array
    gravity: Array  # (2,), the acceleration of free fall

    @classmethod
    def from_dict(cls, document: Mapping[str, Any]) -> Arm:
        lengths = np.asarray(document["lengths"], dtype=float)
        n = lengths.size

        def per_link(value: Any) -> Array:
            return np.broadcast_to(np.asarray(value, dtype=float), (n,))

        masses = per_link(document["masses"])
        com = document.get("com")
        offset = np.stack([lengths / 2, np.zeros(n)], axis=1) if com is None else np.asarray(com, dtype=float)
        if offset.ndim < 2:  # distances along the link's axis
            offset = np.stack([per_link(offset), np.zeros(n)], axis=1)
        inertias = document.get("inertias")
        gravity = np.asarray(document.get("gravity", 0.0), dtype=float)
        return cls(
            lengths=lengths,
            masses=masses,
            com=offset,
            inertias=masses * lengths**2 / 12 if inertias is None else per_link(inertias),
            radius=per_link(document.get("radius", 0.0)),
            gravity=gravity if gravity.ndim else np.array([0.0, -float(gravity)]),
        )

    @classmethod
    def uniform(cls, n: int, **others: Any) -> Arm:
        return cls.from_dict({"lengths": [1.0] * n, "masses": 1.0, **others})

    @property
    def n(self) -> int:
        return self.lengths.size


@dataclass(frozen=True)
class Posture:
    """Everything that depends on (q, q̇), as explicit matrices."""

    p: Array  # (n+1, 2) joints, the last row is the tip
    v: Array  # (n+1, 2) their velocities
    axis: Array  # (n, 2) unit vectors along the links
    M: Array
    C: Array
    g: Array
    J: Array
    J_dot: Array
    kinetic: float
    potential: float


def posture(arm: Arm, q: Array, dq: Array) -> Posture:
    n = arm.n
    theta, omega = np.cumsum(q), np.cumsum(dq)
    axis = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    side = perp(axis)
    p = np.vstack([np.zeros(2), np.cumsum(arm.lengths[:, None] * axis, axis=0)])
    v = np.vstack([np.zeros(2), np.cumsum((arm.lengths * omega)[:, None] * side, axis=0)])
    c = p[:-1] + arm.com[:, :1] * axis + arm.com[:, 1:] * side
    v_c = v[:-1] + omega[:, None] * perp(c - p[:-1])

    # J_c[k, j] = ∂c_k/∂q_j = perp(c_k − p_j) for j ≤ k. Because ∂J_j/∂q_k is symmetric in j and k,
    # Σ m JᵀJ̇ is the Christoffel choice of C.
    below = np.tri(n)[:, :, None]
    J_c = below * perp(c[:, None] - p[None, :-1])
    J_c_dot = below * perp(v_c[:, None] - v[None, :-1])
    M = np.einsum("k,kid,kjd->ij", arm.masses, J_c, J_c)
    M += np.flip(np.cumsum(np.flip(arm.inertias)))[np.maximum.outer(np.arange(n), np.arange(n))]
    C = np.einsum("k,kid,kjd->ij", arm.masses, J_c, J_c_dot)
    g = -np.einsum("k,kjd,d->j", arm.masses, J_c, arm.gravity)
    return Posture(
        p=p,
        v=v,
        axis=axis,
        M=M,
        C=C,
        g=g,
        J=perp(p[-1] - p[:-1]).T,
        J_dot=perp(v[-1] - v[:-1]).T,
        kinetic=float(dq @ M @ dq / 2),
        potential=-float(arm.masses @ c @ arm.gravity),
    )


@dataclass(frozen=True)
class Extended:
    """The extended Jacobian's view of a posture; J_e⁻¹ = [J#, Z]."""

    Z: Array
    N_M: Array
    J_e: Array
    J_e_inv: Array
    E_e: Array
    mu: Array
    Lambda_x: Array
    Lambda_n: Array
    N: Array


def extended(s: Posture, basis: Array | None = None) -> Extended:
    """The decomposition at a posture; `basis` (n, r) replaces the SVD's Z by any other basis of ker J."""
    m, n = s.J.shape
    Z = np.linalg.svd(s.J)[2][m:].T if basis is None else basis
    Z_dot = -np.linalg.pinv(s.J) @ s.J_dot @ Z
    M_dot = s.C + s.C.T
    Lambda_n = Z.T @ s.M @ Z
    N_M = np.linalg.solve(Lambda_n, Z.T @ s.M)
    cross = Z_dot.T @ s.M @ Z
    N_M_dot = np.linalg.solve(
        Lambda_n, Z_dot.T @ s.M + Z.T @ M_dot - (cross + cross.T + Z.T @ M_dot @ Z) @ N_M
    )
    J_e = np.vstack([s.J, N_M])
    J_e_inv = np.linalg.inv(J_e)
    J_e_dot = np.vstack([s.J_dot, N_M_dot])
    E_e = J_e_inv.T @ s.M @ J_e_inv
    return Extended(
        Z=Z,
        N_M=N_M,
        J_e=J_e,
        J_e_inv=J_e_inv,
        E_e=E_e,
        mu=J_e_inv.T @ (s.C - s.M @ J_e_inv @ J_e_dot) @ J_e_inv,
        Lambda_x=E_e[:m, :m],
        Lambda_n=Lambda_n,
        N=np.eye(n) - J_e_inv[:, :m] @ s.J,
    )


# ----------------------------------------------------------------------------------------------- the field


@dataclass(frozen=True)
class Field:
    """Repulsion as a function of the surface distance d.

    Nearer than `floor` [m], a tenth of the influence distance if None, a straight line takes over.
    """

    kind: str = "khatib"
    gain: float = 0.0
    influence: float = 1.0
    floor: float | None = None

    def _bare(self, d: Array) -> tuple[Array, Array]:
        """Force and its negative slope, without the floor."""
        gap = 1 / d - 1 / self.influence
        if self.kind == "khatib":
            return self.gain * gap / d**2, self.gain * (3 / d**4 - 2 / (self.influence * d**3))
        if self.kind == "cubic":
            return self.gain * gap**2 / d**2, self.gain * (2 * gap / d**4 + 2 * gap**2 / d**3)
        raise ValueError(f"no field called {self.kind!r}")

    def force(self, d: Array) -> Array:
        """Magnitude of the repulsion [N] at the distances `d` [m]."""
        if self.gain == 0:
            return np.zeros_like(d)
        if self.kind == "bounded":
            # Bounded by the gain in contact too: the formula alone would grow without limit for d < 0.
            bounded: Array = self.gain * (1 - np.clip(d, 0.0, self.influence) / self.influence) ** 2
            return bounded
        floor = self.influence / 10 if self.floor is None else self.floor
        force, slope = self._bare(np.clip(d, floor, self.influence))
        extended: Array = force + slope * np.maximum(0.0, floor - d)
        return extended


@dataclass(frozen=True)
class Contacts:
    """Nearest points of every link (rows) to every disc (columns)."""

    point: Array  # (n, k, 2) on the link's axis
    normal: Array  # (n, k, 2) from the disc towards the link
    distance: Array  # (n, k) between the surfaces


def contacts(arm: Arm, s: Posture, centers: Array, radii: Array) -> Contacts:
    start = s.p[:-1, None]
    along = np.einsum("ikd,id->ik", centers[None] - start, s.axis)
    along = np.clip(along, 0.0, arm.lengths[:, None])
    point = start + along[:, :, None] * s.axis[:, None]
    away = point - centers[None]
    rho = np.linalg.norm(away, axis=-1)
    return Contacts(point, away / rho[:, :, None], rho - radii[None] - arm.radius[:, None])


# ------------------------------------------------------------------------------------------------- the law


@dataclass(frozen=True)
class Settings:
    """Gains of the law; K and D act on the end effector, null damping is √d·M·√d."""

    stiffness: ArrayLike = 16.0
    damping: ArrayLike = 8.0
    null_damping: ArrayLike = 2.0
    field: Field = dataclasses.field(default_factory=Field)
    projection: str = "dynamic"  # or "none": the field's torque straight to the motors, as printed


@dataclass(frozen=True)
class Terms:
    tau: Array
    tau_task: Array
    tau_null: Array
    tau_vff: Array
    force: Array  # (n,) magnitude of the repulsion on each link
    clearance: Array  # (n,)
    N: Array


def law(
    arm: Arm,
    settings: Settings,
    q: Array,
    dq: Array,
    reference: tuple[Array, Array, Array],
    centers: Array,
    radii: Array,
    basis: Array | None = None,
) -> Terms:
    """The torque in the extended form.

    J_e⁻ᵀ(τ − g) = [Λẍ_c + μ_xx ẋ + μ_xn ν;  μ_nx ẋ + Zᵀ(τ_vff − D_q Zν)]
    """
    s = posture(arm, q, dq)
    e = extended(s, basis)
    m = s.J.shape[0]
    x, dx, nu = s.p[-1], s.J @ dq, e.N_M @ dq
    x_ref, dx_ref, ddx_ref = reference
    K, D, d = (np.asarray(gain) for gain in (settings.stiffness, settings.damping, settings.null_damping))
    ddx_c = ddx_ref - D * (dx - dx_ref) - K * (x - x_ref)

    touch = contacts(arm, s, centers, radii)
    F = settings.field.force(touch.distance)[:, :, None] * touch.normal
    lever = touch.point[:, :, None] - s.p[None, None, :-1]
    tau_vff = np.einsum("ij,ikjd,ikd->j", np.tri(arm.n), perp(lever), F)

    task = e.Lambda_x @ ddx_c + e.mu[:m, :m] @ dx + e.mu[:m, m:] @ nu
    root = np.broadcast_to(np.sqrt(d), (arm.n,))
    damping = root[:, None] * s.M * root
    inner = tau_vff if settings.projection == "dynamic" else np.zeros(arm.n)
    null = e.mu[m:, :m] @ dx + e.Z.T @ (inner - damping @ e.Z @ nu)
    tau_task = s.J.T @ task
    tau_null = e.N_M.T @ null + (tau_vff - inner)
    return Terms(
        tau=s.g + tau_task + tau_null,
        tau_task=tau_task,
        tau_null=tau_null,
        tau_vff=tau_vff,
        force=np.linalg.norm(F.sum(axis=1), axis=-1),
        clearance=touch.distance.min(axis=1) if centers.size else np.full(arm.n, np.inf),
        N=e.N,
    )


# ------------------------------------------------------------------------------- references and obstacles

Reference = Callable[[float], tuple[Array, Array, Array]]


def reference(document: Mapping[str, Any], tip: Array) -> Reference:
    """x_r, ẋ_r, ẍ_r as functions of time. `tip` is where a line starts if the document does not say."""
    kind = document["kind"]
    if kind == "setpoint":
        point = np.asarray(document["point"], dtype=float)
        return lambda t: (point, np.zeros(2), np.zeros(2))
    if kind == "polynomial":
        axes = [np.polynomial.Polynomial(c) for c in document["coefficients"]]
        orders = [axes, [a.deriv() for a in axes], [a.deriv(2) for a in axes]]
        return lambda t: tuple(np.array([a(t) for a in order]) for order in orders)  # type: ignore[return-value]
    if kind == "line":
        start = np.asarray(document.get("start", tip), dtype=float)
        span, T = np.asarray(document["end"], dtype=float) - start, float(document["duration"])
        blend = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])

        def line(t: float) -> tuple[Array, Array, Array]:
            u, inside = min(t / T, 1.0), float(t < T)
            speed, bend = inside * blend.deriv()(u) / T, inside * blend.deriv(2)(u) / T**2
            return start + blend(u) * span, speed * span, bend * span

        return line
    if kind == "circle":
        center, R = np.asarray(document["center"], dtype=float), float(document["radius"])
        w, phase = float(document["angular_velocity"]), float(document.get("phase", 0.0))

        def circle(t: float) -> tuple[Array, Array, Array]:
            u = np.array([np.cos(w * t + phase), np.sin(w * t + phase)])
            return center + R * u, R * w * perp(u), -R * w**2 * u

        return circle
    raise ValueError(f"the oracle knows no reference of kind {kind!r}")


def obstacle_centers(documents: Sequence[Mapping[str, Any]], t: float) -> Array:
    centers = []
    for document in documents:
        motion = document.get("motion", {"kind": "static"})
        position = np.asarray(document["position"], dtype=float)
        if motion["kind"] == "linear":
            position = position + t * np.asarray(motion["velocity"], dtype=float)
        elif motion["kind"] == "sinusoid":
            w, phase = float(motion["angular_frequency"]), float(motion.get("phase", 0.0))
            position = position + np.sin(w * t + phase) * np.asarray(motion["amplitude"], dtype=float)
        elif motion["kind"] != "static":
            raise ValueError(f"the oracle knows no motion of kind {motion['kind']!r}")
        centers.append(position)
    return np.array(centers).reshape(-1, 2)


# ------------------------------------------------------------------------------------------ the closed loop


def simulate(document: Mapping[str, Any]) -> dict[str, Array]:
    """Run a scenario document (discs only); returns the record under the names of `vffnull.Result`."""
    arm = Arm.from_dict(document["arm"])
    control = dict(document["controller"])
    if control.pop("task", "position") != "position":
        raise ValueError("the oracle knows the position task only")
    settings = Settings(
        field=Field(**control.pop("field", {})),
        **{gain: control[gain] for gain in SETTINGS if gain in control},
    )
    solids = document.get("obstacles", [])
    radii = np.array([o["shape"]["radius"] for o in solids], dtype=float)
    numerics = document.get("simulation", {})
    dt = float(numerics.get("dt", 1e-3))
    every, period = int(numerics.get("record_every", 1)), int(numerics.get("control_every", 1))
    held = {"continuous": False, "hold": True}[numerics.get("control", "continuous")]

    q = np.asarray(document["q0"], dtype=float)
    dq = np.asarray(document.get("dq0", np.zeros(arm.n)), dtype=float)
    tip = posture(arm, q, dq).p[-1]
    x_r = reference(document["reference"], tip)

    def control_at(t: float, q: Array, dq: Array) -> Terms:
        return law(arm, settings, q, dq, x_r(t), obstacle_centers(solids, t), radii)

    def slope(t: float, q: Array, dq: Array, tau: Array | None) -> tuple[Array, Array]:
        s = posture(arm, q, dq)
        torque = control_at(t, q, dq).tau if tau is None else tau
        ddq: Array = np.linalg.solve(s.M, torque - s.C @ dq - s.g)
        return dq, ddq

    steps = round(float(document["duration"]) / dt)
    rows: dict[str, list[Any]] = {name: [] for name in RECORD}
    terms = control_at(0.0, q, dq)
    for k in range(steps + 1):
        t = k * dt
        if not held or k % period == 0:
            terms = control_at(t, q, dq)
        if k % every == 0:
            s, target = posture(arm, q, dq), x_r(t)[0]
            now = control_at(t, q, dq) if held else terms
            torques = (terms.tau, terms.tau_task, terms.tau_null, terms.tau_vff)
            tip_now = (s.p[-1], s.v[-1], target, s.p[-1] - target)
            values = (t, q, dq, *torques, *tip_now, now.force, now.clearance, obstacle_centers(solids, t))
            for name, value in zip(RECORD, values, strict=True):
                rows[name].append(value)
        tau = terms.tau if held else None
        a1, b1 = slope(t, q, dq, tau)
        a2, b2 = slope(t + dt / 2, q + dt / 2 * a1, dq + dt / 2 * b1, tau)
        a3, b3 = slope(t + dt / 2, q + dt / 2 * a2, dq + dt / 2 * b2, tau)
        a4, b4 = slope(t + dt, q + dt * a3, dq + dt * b3, tau)
        q, dq = q + dt / 6 * (a1 + 2 * a2 + 2 * a3 + a4), dq + dt / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        if not np.all(np.isfinite(q)) or np.abs(dq).max() > 1e4:
            break
    return {name: np.array(values) for name, values in rows.items()}


SETTINGS = ("stiffness", "damping", "null_damping", "projection")
RECORD = (
    "t", "q", "dq", "tau", "tau_task", "tau_null", "tau_vff",
    "x", "dx", "x_ref", "error", "force", "clearance", "obstacles",
)  # fmt: skip


def sweep_through(**overrides: Any) -> dict[str, Any]:
    """The scene on which avoidance decides: the tip stays, a disc falls through the arm's place."""
    q0 = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4]
    arm = {"lengths": [1.0] * 6, "masses": 1.0}
    tip = posture(Arm.from_dict(arm), np.array(q0), np.zeros(6)).p[-1]
    document: dict[str, Any] = {
        "name": "sweep-through",
        "duration": 4.0,
        "q0": q0,
        "arm": arm,
        "controller": {
            "stiffness": 100.0,
            "damping": 20.0,
            "null_damping": 6.0,
            "field": {"kind": "khatib", "gain": 0.5, "influence": 0.6},
        },
        "reference": {"kind": "setpoint", "point": tip.tolist()},
        "obstacles": [
            {
                "shape": {"kind": "circle", "radius": 0.15},
                "position": [1.6, 2.9],
                "motion": {"kind": "linear", "velocity": [0.0, -0.35]},
            }
        ],
        "simulation": {"dt": 1e-3, "control": "hold"},
    }
    for dotted, value in overrides.items():
        *parents, last = dotted.split(".")
        place = document
        for parent in parents:
            place = place[parent]
        place[last] = value
    return document


def tip_motion(record: Mapping[str, ArrayLike]) -> float:
    """How far the end effector strays from where it started [m]."""
    x = np.asarray(record["x"])
    return float(np.linalg.norm(x - x[0], axis=1).max())


def main() -> None:
    cases: list[tuple[str, dict[str, Any]]] = [
        ("hold, 1 ms", {}),
        ("continuous, 1 ms", {"simulation.control": "continuous"}),
        ("continuous, 2 ms", {"simulation.control": "continuous", "simulation.dt": 2e-3}),
        ("continuous, 4 ms", {"simulation.control": "continuous", "simulation.dt": 4e-3}),
        ("field off", {"controller.field.gain": 0.0}),
        ("unprojected", {"controller.projection": "none"}),
    ]
    print(f"{'sweep-through':<20}{'min clearance [m]':>20}{'tip motion [m]':>18}")
    for label, overrides in cases:
        record = simulate(sweep_through(**overrides))
        print(f"{label:<20}{record['clearance'].min():>20.4f}{tip_motion(record):>18.2e}")


if __name__ == "__main__":
    main()
