"""How far avoidance pushes the end effector per step size, and how much null damping a sample rate stands.

docs/theory.md, section 8: the law inside the RK4 stages drifts O(dt⁴), under zero-order hold O(dt), with a
midpoint predictor O(dt²). Sampled null damping is stable iff d·dt < 2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff

STEPS = (1e-3, 2e-3, 4e-3)


def scene(**overrides: Any) -> vff.Scenario:
    """`sweep-through` with the C² field, so that no derivative jumps where a link enters the field."""
    cubic = {"controller.field.kind": "cubic", "controller.field.gain": 0.4}
    return vff.Scenario.load("sweep-through").replace(**cubic, **overrides)


def drift(control: str, dt: float, **overrides: Any) -> float:
    result = vff.simulate(scene(**{"simulation.control": control, "simulation.dt": dt, **overrides}))
    assert result.status == "completed"
    return float(np.linalg.norm(result.x - result.x[0], axis=1).max())


@pytest.mark.parametrize(("control", "order"), [("hold", 1), ("predictor", 2), ("continuous", 4)])
def test_order_of_the_drift(control: str, order: int) -> None:
    """The slope of log drift over log dt from 1 to 2 and from 2 to 4 ms, within a fifth of the order."""
    drifts = [drift(control, dt) for dt in STEPS]
    assert min(drifts) > 1e-13  # an effect, not rounding
    slopes = np.diff(np.log2(drifts))
    np.testing.assert_allclose(slopes, order, atol=0.2 * order)


def test_order_counts_control_periods_not_plant_steps() -> None:
    """Hold: a finer plant under the same control period drifts the same."""
    fine = drift("hold", 1e-3, **{"simulation.control_every": 4})
    coarse = drift("hold", 4e-3)
    assert fine == pytest.approx(coarse, rel=0.02)


def test_sampling_order_of_the_controls() -> None:
    """At one step size: continuous holds the tip best, then the predictor, then plain hold."""
    hold, predictor, continuous = (drift(control, 2e-3) for control in ("hold", "predictor", "continuous"))
    assert continuous < predictor / 100 < hold / 1000


def null_speed(d: float, dt: float, n: int = 5) -> tuple[float, float]:
    """Largest joint speed at the start and at the end of free null-space motion under sampled damping alone.

    The motion is tiny (1e-7 rad/s), so that the arm stays where it is and the loop is linear: ν̇ = −d ν. The
    task is followed with the same period, far inside its own bound.
    """
    arm = vff.Arm.uniform(n)
    q0 = np.array([1.2, -0.9, -0.8, 0.7, 0.5, 0.4][:n])
    N = arm.extended_jacobian(q0, np.zeros(n)).N
    dq0 = 1e-7 * N @ np.linspace(1.0, -1.0, n)
    scenario = vff.Scenario(
        arm=arm,
        q0=q0,
        dq0=dq0,
        duration=200 * dt,
        reference={"kind": "setpoint", "point": arm.forward_kinematics(q0)[-1]},
        controller={"stiffness": 1.0, "damping": 2.0, "null_damping": d},
        simulation={"dt": dt / 4, "control": "hold", "control_every": 4},
    )
    simulation = vff.Simulation(scenario)
    speeds = [float(np.abs(simulation.step().dq).max()) for _ in range(120)]
    return float(np.abs(dq0).max()), speeds[-1]


@pytest.mark.parametrize("dt", [1e-3, 1e-2])
def test_sampled_null_damping_bound(dt: float) -> None:
    """D_q = d·M is stable iff d·dt < 2 in every configuration (README): 0.95× decays, 1.05× grows.

    Per period the null velocity is multiplied by 1 − d·dt: −0.9 at 0.95×, −1.1 at 1.05×.
    """
    start, end = null_speed(0.95 * 2 / dt, dt)
    assert end < start * 0.9**100
    start, end = null_speed(1.05 * 2 / dt, dt)
    assert end > start * 1.1**100


def test_bound_is_announced() -> None:
    """§4: check when the controller is built, and warn with the numbers."""
    overrides = {"controller.null_damping": 2100.0, "duration": 0.01}
    with pytest.warns(vff.errors.ScenarioWarning, match=r"null_damping.*2100.*0\.001.*2000"):
        vff.simulate("sweep-through", overrides)
