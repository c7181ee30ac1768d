"""The continuous law is what a solver of another kind makes of the dense formulas.

SciPy's DOP853 with adaptive steps and a tight tolerance integrates the closed loop of tests/oracle.py: M, C
and J from sums over the centres of mass, the torque from the extended Jacobian, accelerations by a linear
solve.
The core integrates its own recursions by RK4 in fixed steps. They share neither formulas nor integrator.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import oracle
import vffnull as vff

Array = NDArray[np.float64]
TOLERANCE = 1e-7  # rad and rad/s, over the whole run
DURATION = 5.0  # s
ROWS = 0.05  # s between two instants that are compared

# Bundled scenes with what is changed in them. The last is the heavy one: unequal links, centres of mass off
# the axes, gravity, a softer field.
SCENES: dict[str, tuple[str, dict[str, Any]]] = {
    "paper-1": ("paper-1", {}),
    "paper-2": ("paper-2", {}),
    "sweep-through": ("sweep-through", {}),
    "crowd": ("crowd", {}),
    "narrow-gap": ("narrow-gap", {}),
    "heavy": (
        "sweep-through",
        {
            "arm.lengths": [1.1, 0.9, 1.0, 1.2, 0.8, 1.0],
            "arm.masses": [3.0, 2.0, 1.5, 1.0, 0.7, 0.5],
            "arm.com": [[0.5, 0.05], [0.4, 0.0], [0.5, -0.03], [0.6, 0.02], [0.3, 0.0], [0.4, 0.01]],
            "arm.inertias": [0.3, 0.2, 0.1, 0.15, 0.05, 0.04],
            "arm.radius": 0.02,
            "arm.gravity": [1.0, -9.81],
            "controller.field": {"kind": "cubic", "gain": 1.0, "influence": 0.8},
        },
    ),
}


def run(scene: str, control: str, dt: float) -> vff.Result:
    name, changes = SCENES[scene]
    options = {
        "duration": DURATION,
        "simulation.control": control,
        "simulation.dt": dt,
        "simulation.record_every": round(ROWS / dt),
    }
    return vff.simulate(name, options | changes)


def integrate(scenario: vff.Scenario, times: Array) -> tuple[Array, Array]:
    """q and q̇ at some instants, by SciPy."""
    document = scenario.to_dict()
    arm = oracle.Arm.from_dict(document["arm"])
    n, control = arm.n, document["controller"]
    settings = oracle.Settings(**control | {"field": oracle.Field(**control["field"])})
    solids = document["obstacles"]
    radii = np.array([solid["shape"]["radius"] for solid in solids])
    q0 = np.array(document["q0"], dtype=float)
    reference = oracle.reference(document["reference"], oracle.posture(arm, q0, np.zeros(n)).p[-1])

    def slope(t: float, state: Array) -> Array:
        q, dq = state[:n], state[n:]
        centers = oracle.obstacle_centers(solids, t)
        tau = oracle.law(arm, settings, q, dq, reference(t), centers, radii).tau
        s = oracle.posture(arm, q, dq)
        return np.concatenate([dq, np.linalg.solve(s.M, tau - s.C @ dq - s.g)])

    start = np.concatenate([q0, np.zeros(n)])
    solution = solve_ivp(slope, (0.0, DURATION), start, method="DOP853", t_eval=times, rtol=1e-11, atol=1e-12)
    assert solution.success, solution.message
    return solution.y[:n].T, solution.y[n:].T


@functools.cache
def both(scene: str) -> tuple[vff.Result, Array, Array]:
    """A scene by the core at the scenario's own step, and q and q̇ at the same instants by SciPy."""
    result = run(scene, "continuous", 1e-3)
    return result, *integrate(result.scenario, result.t)


def deviation(result: vff.Result, q: Array, dq: Array) -> tuple[float, float]:
    return float(np.abs(result.q - q).max()), float(np.abs(result.dq - dq).max())


@pytest.mark.parametrize("scene", SCENES)
def test_agreement(scene: str) -> None:
    """In q at the scenario's own step, in q̇ at half of it: in narrow-gap 53 N set in within centimetres."""
    (coarse, q, dq), fine = both(scene), run(scene, "continuous", 5e-4)
    np.testing.assert_allclose(fine.t, coarse.t, rtol=0, atol=1e-12)
    assert coarse.end_time == DURATION
    assert coarse.metrics.max_repulsion > 0.5
    assert np.ptp(coarse.q, axis=0).max() > 0.1
    assert deviation(coarse, q, dq)[0] < TOLERANCE
    assert max(deviation(fine, q, dq)) < TOLERANCE


def test_a_held_torque_is_another_thing() -> None:
    """The comparison sees the sampling of one millisecond."""
    held = run("sweep-through", "hold", 1e-3)
    _, q, dq = both("sweep-through")
    assert deviation(held, q, dq)[0] > 100 * TOLERANCE


def table() -> str:
    """The largest deviations, as Markdown."""
    lines = ["| scene | step [ms] | q [rad] | q̇ [rad/s] |", "|---|---:|---:|---:|"]
    for scene in SCENES:
        for dt in (1e-3, 5e-4):
            result = run(scene, "continuous", dt)
            found = deviation(result, *integrate(result.scenario, result.t))
            lines.append(f"| {scene} | {1e3 * dt:g} | {found[0]:.1e} | {found[1]:.1e} |")
    return "\n".join(lines)


if __name__ == "__main__":
    print(table())
