"""Singular configurations: finite torque, an exact projector, and a way back (docs/theory.md, T25)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vffnull as vff

FIELD = vff.Field.khatib(1.0, 1.0)


def stretch(reach: float, pace: float, control: str, gravity: float) -> dict[str, Any]:
    """A tip that swings along a ray between `reach` − 2 and `reach` [m], for two swings at `pace` [rad/s]."""
    ray = np.array([np.cos(0.3), np.sin(0.3)])
    return {
        "duration": round(4 * np.pi / pace, 3),
        "q0": [1.2, -0.9, -0.6, -0.3],
        "arm": {"lengths": [1.0] * 4, "masses": 1.0, "gravity": gravity},
        "controller": {"stiffness": 25.0, "damping": 10.0},
        "reference": {
            "kind": "lissajous",
            "center": (reach - 1) * ray,
            "amplitude": ray * (1 - 1e-12),
            "angular_frequency": [pace, pace],
            "phase": [-np.pi / 2] * 2,
        },
        "simulation": {"control": control},
    }


@pytest.mark.parametrize("gravity", [0.0, 9.81])
@pytest.mark.parametrize("control", ["hold", "predictor", "continuous"])
@pytest.mark.parametrize("pace", [0.5, 2.0])
def test_through_a_full_stretch_and_back(control: str, pace: float, gravity: float) -> None:
    """The four-metre arm goes out to four metres, twice, and is back on its reference afterwards.

    With the coupling of task and null space undamped, it ran away in the middle. It needs no more than three
    times the torque of the same swing 5 cm short of the singularity.
    """
    regular = vff.simulate(stretch(3.95, pace, control, gravity))
    result = vff.simulate(stretch(4.0, pace, control, gravity))
    assert regular.metrics.singular_steps == 0
    assert result.status == "completed"
    assert result.metrics.singular_steps > 20
    assert result.metrics.min_manipulability < 0.01 * result.manipulability[0]
    assert result.metrics.min_manipulability == result.manipulability.min()
    assert result.metrics.peak_torque < 3 * regular.metrics.peak_torque
    assert result.metrics.peak_speed < 2 * regular.metrics.peak_speed
    assert np.abs(result.error[-1]).max() < 1e-3
    assert result.metrics.max_null_acceleration < 1e-10


@given(
    folds=st.lists(st.sampled_from([0.0, np.pi, -np.pi]), min_size=2, max_size=7),
    nudge=st.sampled_from([0.0, 1e-12, 1e-8, 1e-5, 1e-3]),
    turn=st.floats(-3.0, 3.0),
    rates=st.lists(st.floats(-2.0, 2.0), min_size=8, max_size=8),
    target=st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)),
)
@settings(max_examples=300)
def test_finite_torque_on_a_line(
    folds: list[float], nudge: float, turn: float, rates: list[float], target: tuple[float, float]
) -> None:
    """All links on one line, stretched or folded, exactly or nearly; the target may be out of reach."""
    q = np.array([turn, *folds]) + nudge * np.arange(len(folds) + 1)
    dq = np.array(rates[: len(q)])
    controller = vff.Controller(vff.Arm.uniform(len(q)), {"field": FIELD})
    disc = vff.Obstacle.circle([0.6, 0.9], 0.2)
    terms = controller.terms(q, dq, target, obstacles=[disc])
    assert np.isfinite(terms.tau).all() and np.isfinite(terms.N).all()
    assert terms.singular or nudge > 1e-4
    # A pull of K e + D ẋ ≤ 16·30 + 8·16 m/s² on 8 kg, damped: far below this.
    assert np.abs(terms.tau).max() < 1e6


@given(q=st.lists(st.floats(-2.5, 2.5), min_size=4, max_size=7), gain=st.floats(0.5, 20.0))
@settings(max_examples=100)
def test_no_leak_where_the_arm_is_regular(q: list[float], gain: float) -> None:
    """J M⁻¹ τ_null = 0 however strong the field, with the default threshold of the damping (T4)."""
    arm = vff.Arm.uniform(len(q))
    controller = vff.Controller(arm, {"field": {"kind": "khatib", "gain": gain, "influence": 2.0}})
    near = arm.forward_kinematics(q)[2] + [0.3, 0.4]
    terms = controller.terms(q, np.zeros(len(q)), [1.0, 1.0], obstacles=[vff.Obstacle.circle(near, 0.2)])
    if terms.singular:
        return
    ddq = np.linalg.solve(arm.mass_matrix(q), terms.tau_null)
    leak = arm.jacobian(q) @ ddq
    assert np.abs(leak).max() < 1e-8 * (1 + np.abs(ddq).max())
    assert terms.null_acceleration == pytest.approx(np.linalg.norm(leak), abs=1e-8 * (1 + np.abs(ddq).max()))


def test_the_projector_stays_exact_next_to_a_singularity() -> None:
    """Where the task force is damped already, the field still does not move the tip."""
    arm = vff.Arm.uniform(5)
    q = np.array([0.2, 0.02, -0.01, 0.02, -0.02])
    disc = vff.Obstacle.circle(arm.forward_kinematics(q)[2] + [0.0, 0.4], 0.2)
    terms = vff.Controller(arm, {"field": FIELD}).terms(q, np.zeros(5), [4.9, 1.0], obstacles=[disc])
    assert terms.singular and np.abs(terms.tau_null).max() > 0.1
    leak = arm.jacobian(q) @ np.linalg.solve(arm.mass_matrix(q), terms.tau_null)
    assert np.abs(leak).max() < 1e-10


def test_manipulability_is_yoshikawa_s() -> None:
    """√det(J Jᵀ), for a position and, as √(σ₁σ₂σ₃)² of the pose Jacobian, for a pose."""
    arm = vff.Arm.uniform(5)
    q = [0.3, -0.7, 0.9, 0.4, -1.1]
    rest = np.zeros(5)
    jacobian = arm.jacobian(q)
    for task, target, rows in [
        ("position", [1.0, 1.0], jacobian),
        ("pose", [1.0, 1.0, 0.0], np.vstack([jacobian, np.ones(5)])),
    ]:
        found = vff.Controller(arm, {"task": task}).terms(q, rest, target).manipulability
        assert found == pytest.approx(np.prod(np.linalg.svd(rows, compute_uv=False)), rel=1e-12)
