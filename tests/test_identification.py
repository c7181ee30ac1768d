"""Loads and friction from recorded motions: what went in comes out, what they cannot tell is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError
from vffnull.robots import checks

COM = [0.02, -0.01, 0.06]
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
PANDA = vff.Arm.named("panda")
POSTURES = checks.postures(PANDA, READY, count=6, spread=0.6, seed=3).tolist()
MOTION = vff.Scenario.from_dict(
    {
        "duration": 8.0,
        "q0": READY,
        "arm": {"model": "panda"},
        "controller": {
            "task": "pose",
            "stiffness": 400.0,
            "damping": 40.0,
            "null_damping": 10.0,
            "posture_stiffness": 20.0,
        },
        "reference": {
            "kind": "plan",
            "times": [0.0, 1.5, 3.0, 4.5, 6.0, 7.0, 8.0],
            "points": [*POSTURES, READY],
        },
        "simulation": {"dt": 1e-3, "control": "hold", "record_every": 1},
    }
)
LOADED: dict[str, Any] = {"plant.payload": {"mass": 1.2, "com": COM}}
ROUGH = {"plant.coulomb_friction": [0.2, 0.3, 0.4, 0.5, 0.3, 0.2, 0.1], "plant.viscous_friction": 0.5}
NOISE = {"measurement": {"position_noise": 1e-5, "velocity_noise": 1e-3}}


def found(result: vff.Result, **given: Any) -> checks.Identified:
    q, dq = result.q_measured, result.dq_measured
    if q is None or dq is None or not q.size:
        q, dq = result.q, result.dq
    return checks.identify(result.scenario.arm, result.t, q, dq, result.tau, **given)


def test_a_load_is_found() -> None:
    """Of an exact measurement: to a gram and half a millimetre."""
    load = found(vff.simulate(MOTION, LOADED), friction=False)
    assert load.mass == pytest.approx(1.2, abs=1e-3)
    np.testing.assert_allclose(load.com, COM, atol=6e-4)
    assert load.viscous.shape == (7,) and not load.coulomb.any() and load.residual.max() < 0.02
    assert "load 1.200" in str(load) and "panda_joint7" in str(load)
    none = found(vff.simulate(MOTION), friction=False)
    assert abs(none.mass) < 1e-3


def test_load_and_friction_are_told_apart_through_noise() -> None:
    """Every number within four of its standard errors, and a little that is not noise."""
    load = found(vff.simulate(MOTION, LOADED | ROUGH | NOISE))
    assert abs(load.mass - 1.2) < 4.0 * load.mass_error + 2e-3 < 0.02
    assert (np.abs(load.com - COM) < 4.0 * load.com_error + 1e-3).all() and load.com_error.max() < 0.02
    dry = np.array(ROUGH["plant.coulomb_friction"])
    assert (np.abs(load.coulomb - dry) < 4.0 * load.coulomb_error + 5e-3).all()
    assert (np.abs(load.viscous - 0.5) < 4.0 * load.viscous_error + 0.05).all()
    assert load.coulomb_error.max() < 0.05 and load.condition < 20.0


def test_errors_are_those_that_noise_makes() -> None:
    """Over other random numbers the estimate is spread by no more than its standard error: noise of
    velocities goes into two windows with opposite signs, so that it counts for less than it seems to.
    """
    runs = [vff.simulate(MOTION, LOADED | NOISE | {"duration": 4.0, "seed": seed}) for seed in range(12)]
    loads = [found(run, friction=False) for run in runs]
    spread = np.std([load.mass for load in loads], ddof=1)
    told = np.mean([load.mass_error for load in loads])
    assert 0.15 < spread / told < 1.5


def recorded(load: vff.Arm, offset: float = 0.0) -> tuple[Any, ...]:
    """Times, positions, velocities and torques of `PANDA` with `load` on an exact motion of all joints."""
    rng, t = np.random.default_rng(5), np.arange(0.0, 6.0, 1e-3)
    rate, phase = rng.uniform(1.0, 5.0, (2, 7)), rng.uniform(0.0, 6.0, (2, 7))
    inner = rate[:, None] * t[:, None] + phase[:, None]
    q = READY + 0.2 * np.sin(inner).sum(axis=0)
    dq = (0.2 * rate[:, None] * np.cos(inner)).sum(axis=0)
    ddq = -(0.2 * rate[:, None] ** 2 * np.sin(inner)).sum(axis=0)
    tau = np.array([load.inverse_dynamics(*state) for state in zip(q, dq, ddq, strict=True)])
    held = np.vstack([0.5 * (tau[:-1] + tau[1:]), tau[-1:]])  # from one instant to the next
    held[:, 1] += offset
    return t, q, dq, held + rng.normal(0.0, 0.05, held.shape)


@pytest.mark.parametrize(("inertia", "offset"), [([0.0083, 0.0167, 0.0217, 0.0, 0.0, 0.0], 0.0), (None, 1.0)])
def test_errors_count_what_a_point_has_not(inertia: list[float] | None, offset: float) -> None:
    """A box of 2 kg, 30 × 20 × 10 cm, and a torque that is measured 1 N·m off: within three of the errors."""
    load = checks.identify(PANDA, *recorded(PANDA.with_load(2.0, COM, inertia), offset), friction=False)
    assert abs(load.mass - 2.0) < 3.0 * load.mass_error < 0.6, load
    assert (np.abs(load.com - COM) < 3.0 * load.com_error + 5e-4).all() and load.com_error.max() < 0.03


def test_other_units_are_refused_and_what_cannot_be_is_told() -> None:
    t, q, dq, tau = recorded(PANDA.with_load(1.2, COM))
    assert not checks.identify(PANDA, t, q, dq, tau).doubts
    with pytest.raises(InputError, match="beyond its stop; expected rad"):
        checks.identify(PANDA, t, np.degrees(q), np.degrees(dq), tau)
    with pytest.raises(InputError, match=r"q changes 0\.001 times as fast"):
        checks.identify(PANDA, 1e3 * t, q, dq, tau)
    gravity = np.array([PANDA.gravity_torque(each) for each in q])
    for wrong in (tau - gravity, -tau):
        load = checks.identify(PANDA, t, q, dq, wrong)
        assert any("less mass than nothing" in doubt for doubt in load.doubts)
        assert load.doubts[0] in str(load)


def test_what_a_motion_does_not_tell_is_refused() -> None:
    """An arm at rest leaves open where along the vertical its load is, and its friction."""
    result = vff.simulate("panda-sweep", LOADED | {"obstacles": [], "duration": 1.0})
    q, dq = np.tile(result.q[-1], (500, 1)), np.zeros((500, 7))
    tau, t = np.tile(result.tau[-1], (500, 1)), 1e-3 * np.arange(500)
    with pytest.raises(InputError, match="does not excite the centre of mass along z of the tip"):
        checks.identify(result.scenario.arm, t, q, dq, tau, friction=False)
    with pytest.raises(InputError, match="does not excite the friction of panda_joint1, panda_joint2"):
        checks.identify(result.scenario.arm, t, q, dq, tau)


def test_bad_input_is_refused() -> None:
    arm = vff.Arm.named("panda")
    t, rows = 1e-3 * np.arange(200), np.zeros((200, 7))
    for given, message in (
        ((vff.Arm.uniform(3), t, rows, rows, rows), "in space"),
        ((arm, t**2, rows, rows, rows), "evenly spaced"),
        ((arm, t[:20], rows[:20], rows[:20], rows[:20]), "two windows"),
        ((arm, t, rows[:, :6], rows, rows), "q"),
        ((arm, t, rows, rows, rows * np.nan), "torque"),
    ):
        with pytest.raises(InputError, match=message):
            checks.identify(*given)
