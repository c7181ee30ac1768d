"""The plant is not the model: friction, payload, stops, sensors and drives, against what is known of them."""

from __future__ import annotations

import itertools
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from vffnull.draw.figures import null_space

Array = NDArray[np.float64]
DT = 1e-3
INERTIA = 1 / 3  # kg·m², of a rod of 1 m and 1 kg about its end
TABLES: dict[str, dict[str, Any]] = {
    "plant": {"payload": 0, "viscous_friction": 0, "coulomb_friction": [0.0] * 6, "joint_stops": False},
    "measurement": {
        "position_noise": 0,
        "velocity_noise": 0,
        "position_resolution": 0,
        "velocity_resolution": 0,
        "delay": 0,
    },
    "actuator": {"time_constant": 0},
}


def rod(
    q0: float = 0.0, dq0: float = 0.0, arm: dict[str, Any] | None = None, **tables: Any
) -> vff.Simulation:
    """One link of 1 m and 1 kg, to be moved by hand."""
    return vff.Simulation(
        {
            "duration": 10.0,
            "q0": [q0],
            "dq0": [dq0],
            "arm": {"lengths": [1.0], "masses": 1.0} | (arm or {}),
            "reference": {"kind": "setpoint", "point": [np.cos(q0), np.sin(q0)]},
            **tables,
        }
    )


def chain(n: int = 3, **tables: Any) -> dict[str, Any]:
    """Some links under gravity that start in motion."""
    return {
        "duration": 2.0,
        "q0": list(np.linspace(0.4, -0.5, n)),
        "dq0": list(np.linspace(1.0, -2.0, n)),
        "arm": {"lengths": [0.5] * n, "masses": list(np.linspace(2.0, 0.5, n)), "gravity": 9.81},
        "reference": {"kind": "setpoint", "point": [0.4 * n, 0.1]},
        **tables,
    }


def drive(simulation: vff.Simulation, steps: int, tau: Any) -> tuple[Array, Array]:
    """Joint angles and velocities at every step under a constant torque, the start first."""
    states = [simulation.state, *(simulation.step(tau) for _ in range(steps))]
    assert simulation.status != "diverged"
    return np.array([s.q for s in states]), np.array([s.dq for s in states])


def same_bits(a: vff.Result, b: vff.Result) -> None:
    for name, values in a.recorded().items():
        if name not in ("q_measured", "dq_measured", "tau_applied"):
            np.testing.assert_array_equal(values, getattr(b, name), err_msg=name)
    assert dict(a.metrics) == dict(b.metrics)


@pytest.mark.parametrize("control", ["hold", "predictor"])
@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_tables_of_zeros_change_no_bit(control: str, integrator: str) -> None:
    overrides = {"simulation.control": control, "simulation.integrator": integrator}
    plain = vff.simulate("sweep-through", overrides)
    assert plain.q_measured is None and plain.dq_measured is None and plain.tau_applied is None
    real = vff.simulate("sweep-through", overrides | TABLES | {"seed": 7})
    same_bits(plain, real)
    np.testing.assert_array_equal(real.q_measured, plain.q)
    np.testing.assert_array_equal(real.dq_measured, plain.dq)
    np.testing.assert_array_equal(real.tau_applied, plain.tau)


def test_stops_that_are_not_reached_change_no_bit() -> None:
    plain, stopped = (
        vff.simulate("sweep-through", changes) for changes in ({}, {"arm.joint_limits": [-3, 3]})
    )
    for name, values in plain.recorded().items():
        np.testing.assert_array_equal(values, getattr(stopped, name), err_msg=name)
    assert stopped.metrics.joint_limit_violation == 0.0


def test_viscous_friction_slows_a_rod_down_exponentially() -> None:
    _, dq = drive(rod(dq0=2.0, plant={"viscous_friction": 0.5}), 2000, [0.0])
    t = DT * np.arange(2001)
    np.testing.assert_allclose(dq[:, 0], 2.0 * np.exp(-0.5 / INERTIA * t), rtol=1e-10)


@pytest.mark.filterwarnings("ignore:the torque chatters")
@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_friction_too_stiff_for_the_step_is_warned_of(integrator: str) -> None:
    """Published files of small arms have it: 2 N·m·s/rad stop a wrist of 1.4e-4 kg·m² at 14 000 1/s.

    The step that the warning names follows it; friction as fast as that step is not warned of.
    """
    scenario: dict[str, Any] = {
        "arm": {"model": "xarm7"},
        "q0": [0.0, -0.5, 0.0, 1.0, 0.0, 1.2, 0.0],
        "duration": 0.2,
        "reference": {"kind": "line", "end": [0.0, 0.02, 0.0], "duration": 0.2, "relative": True},
        "plant": {"viscous_friction": [10.0, 10.0, 5.0, 5.0, 5.0, 2.0, 2.0]},
        "simulation": {"integrator": integrator},
    }
    with pytest.warns(vff.errors.ScenarioWarning, match=r"viscous friction stops `joint7`") as caught:
        odd = vff.simulate(scenario)
    assert odd.status == "diverged" or odd.metrics.peak_speed > 1000  # the stop of the joint catches it
    told = [
        each
        for each in odd.warnings
        if re.match(r"the torque chatters: that of joint \d .* by \S+ N·m", each)
    ]
    assert len(told) == (integrator == "semi_implicit_euler")
    sentences = "\n".join(str(each.message) for each in caught)
    found = re.search(r"simulation\.dt = (\S+) and simulation\.control_every = (\d+)", sentences)
    assert found is not None
    step, every = float(found[1]), int(found[2])
    assert step * every == pytest.approx(1e-3)
    numerics = {"simulation.dt": step, "simulation.control_every": every}
    with warnings.catch_warnings():
        warnings.simplefilter("error", vff.errors.ScenarioWarning)
        result = vff.simulate(scenario, numerics)
        finer = vff.simulate(scenario, {"simulation.dt": step / 4, "simulation.control_every": 4 * every})
        vff.simulate("panda-sweep", {"duration": 0.1, "plant.viscous_friction": 0.1})
    assert result.status == "completed"
    assert np.abs(result.q[-1] - finer.q[-1]).max() < 1e-5
    flat = chain(plant={"viscous_friction": 1.0})
    assert vff.simulate(flat).warnings == ()
    with pytest.warns(vff.errors.ScenarioWarning, match=r"viscous friction stops `joint_3`.*dt = \S+ can"):
        vff.simulate(flat, {"plant.viscous_friction": 500.0, "simulation.control": "continuous"})


def test_friction_too_stiff_where_the_wrist_is_straight_is_warned_of() -> None:
    """A bent wrist carries the links beyond it about the axis that a straight one has along them; a run that
    diverges for that says what it may be.
    """
    arm = vff.Arm.named("panda")
    bent = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    straight = [*bent[:5], 0.0, bent[6]]

    def rate(q: list[float], friction: float) -> float:
        loss = np.diag([0.0] * 6 + [friction])
        return float(np.linalg.eigvals(np.linalg.solve(arm.mass_matrix(q), loss)).real.max())

    assert rate(straight, 1.0) > 1.2 * rate(bent, 1.0)
    friction = 2000.0 / np.sqrt(rate(straight, 1.0) * rate(bent, 1.0))
    plant: dict[str, Any] = {"duration": 0.01, "q0": bent}
    plant["plant.viscous_friction"] = [0.0] * 6 + [friction]
    straightest = r"at a rate of \S+ 1/s where `\S+joint6` is at -?\S+ rad, too fast"
    with pytest.warns(vff.errors.ScenarioWarning, match=straightest):
        vff.simulate("panda-sweep", plant)
    with warnings.catch_warnings():
        warnings.simplefilter("error", vff.errors.ScenarioWarning)
        vff.simulate("panda-sweep", plant | {"simulation.dt": 2.5e-4, "simulation.control_every": 4})
    stiff = {"plant.viscous_friction": 1e7, "plant.joint_stops": False}
    with pytest.warns(vff.errors.ScenarioWarning, match="viscous friction stops"):
        lost = vff.simulate("panda-sweep", stiff)
    assert lost.status == "diverged" and "or viscous friction of the joints, is too stiff" in lost.message


@pytest.mark.parametrize("sense", [1, -1])
def test_dry_friction_stops_a_rod_in_finite_time(sense: int) -> None:
    """At |q̇₀| I/τ_c, after q̇₀² I/2τ_c; and from then on nothing moves, to the last bit."""
    friction, speed = 0.7, 1.3
    q, dq = drive(rod(dq0=sense * speed, plant={"coulomb_friction": friction}), 1000, [0.0])
    t = DT * np.arange(1001)
    end = speed * INERTIA / friction
    np.testing.assert_allclose(dq[:, 0], sense * np.maximum(0.0, speed - friction / INERTIA * t), atol=1e-12)
    stopped = t > end + DT
    assert (dq[stopped] == 0.0).all() and np.unique(q[stopped]).size == 1
    assert q[-1, 0] == pytest.approx(
        sense * speed**2 * INERTIA / (2 * friction), abs=friction / INERTIA * DT**2
    )


@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_dry_friction_holds_an_arm_against_gravity(integrator: str) -> None:
    """It needs 24 N·m to be held: with more friction in every joint nothing moves, to the last bit."""
    scenario = chain(plant={"coulomb_friction": 25.0}, simulation={"integrator": integrator}) | {
        "dq0": [0.0] * 3
    }
    assert np.abs(vff.Scenario.from_dict(scenario).arm.gravity_torque(scenario["q0"])).max() < 25.0
    q, dq = drive(vff.Simulation(scenario), 1000, [0.0] * 3)
    assert (dq == 0.0).all() and (q == q[0]).all()


def test_a_torque_above_dry_friction_moves_a_rod_with_the_rest() -> None:
    _, dq = drive(rod(plant={"coulomb_friction": 0.7}), 500, [1.0])
    np.testing.assert_allclose(dq[:, 0], 0.3 / INERTIA * DT * np.arange(501), rtol=1e-9)


def test_dry_friction_converges_with_the_step() -> None:
    """To first order, on coupled joints that stick, slide and turn back."""

    def end(steps: int) -> Array:
        scenario = chain(plant={"coulomb_friction": 1.0}, simulation={"dt": 1.0 / steps})
        q, dq = drive(vff.Simulation(scenario), steps, [0.0] * 3)
        assert (dq[1:] == 0).any() and (np.diff(np.sign(dq), axis=0) != 0).any()
        return q[-1]

    exact = end(32000)
    errors = [np.abs(end(steps) - exact).max() for steps in (500, 1000, 2000, 4000)]
    assert errors[0] < 5e-3
    assert errors[-1] < errors[0] / 4


def test_a_payload_is_a_last_link_that_carries_it() -> None:
    """The composite of a link of 0.5 kg and a point mass of 2 kg at its tip, by Steiner's theorem."""
    scenario = chain(plant={"payload": 2.0})
    mass, com = 2.5, (0.5 * 0.25 + 2.0 * 0.5) / 2.5
    inertia = 0.5 * 0.25 / 12 + 0.5 * (0.25 - com) ** 2 + 2.0 * (0.5 - com) ** 2
    arm = scenario["arm"] | {
        "masses": [*scenario["arm"]["masses"][:2], mass],
        "com": [0.25, 0.25, com],
        "inertias": [2.0 * 0.25 / 12, 1.25 * 0.25 / 12, inertia],
    }
    loaded, heavy = vff.Simulation(scenario), vff.Simulation(chain() | {"arm": arm})
    tau = [3.0, -1.0, 0.5]
    for mine, theirs in zip(drive(loaded, 1000, tau), drive(heavy, 1000, tau), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-10)


def test_the_plant_moves_by_its_own_masses() -> None:
    """Under the same torque as an arm that is the plant in every respect; the controller's has no say."""
    other = {
        "masses": [3.0, 2.0, 1.0],
        "com": [0.1, [0.2, 0.05], 0.3],
        "inertias": 0.1,
        "gravity": [1.0, -3.0],
    }
    wrong = chain(plant=other)
    right = chain() | {"arm": chain()["arm"] | other}
    tau = [3.0, -1.0, 0.5]
    for mine, theirs in zip(
        drive(vff.Simulation(wrong), 1000, tau), drive(vff.Simulation(right), 1000, tau), strict=True
    ):
        np.testing.assert_allclose(mine, theirs, atol=1e-10)
    physical = vff.Scenario.from_dict(wrong).plant
    expected = vff.Scenario.from_dict(right).arm
    q = wrong["q0"]
    np.testing.assert_allclose(physical.mass_matrix(q), expected.mass_matrix(q), rtol=1e-14)
    np.testing.assert_allclose(physical.gravity_torque(q), expected.gravity_torque(q), rtol=1e-14)


def test_masses_of_the_plant_bring_the_inertias_of_rods() -> None:
    plant = vff.Scenario.from_dict(chain(plant={"masses": 4.0})).plant
    np.testing.assert_allclose(plant.inertias, 4.0 * 0.25 / 12)
    given = chain(plant={"masses": 4.0})
    given["arm"]["inertias"] = 0.2
    np.testing.assert_allclose(vff.Scenario.from_dict(given).plant.inertias, 0.2)


@pytest.mark.parametrize("control", ["continuous", "hold", "predictor"])
def test_a_heavier_arm_drops_below_its_set_point(control: str) -> None:
    """Gravity that the model lacks: the tip rests where K e balances the acceleration it causes."""
    scenario = vff.Scenario.load("sweep-through").replace(
        **{"arm.gravity": 9.81, "controller.field.gain": 0.0, "duration": 6.0, "simulation.control": control}
    )
    right = vff.simulate(scenario)
    wrong = vff.simulate(scenario.replace(plant={"payload": 0.5}))
    assert np.abs(right.error[-1]).max() < 1e-6
    assert wrong.error[-1, 1] < -0.02
    model, plant = scenario.arm, wrong.scenario.plant
    q = wrong.q[-1]
    missing = plant.gravity_torque(q) - model.gravity_torque(q)
    J, M = model.jacobian(q), model.mass_matrix(q)
    given = J @ np.linalg.solve(M, missing)
    assert np.linalg.norm(-100.0 * wrong.error[-1] - given) < 0.02 * np.linalg.norm(given)


def energy(arm: vff.Arm, q: Array, dq: Array) -> Array:
    return np.array([arm.kinetic_energy(a, b) + arm.potential_energy(a) for a, b in zip(q, dq, strict=True)])


@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_a_rod_that_falls_on_a_stop_stays_there(integrator: str) -> None:
    gravity = {"gravity": 9.81, "joint_limits": [-1.0, 1.0]}
    simulation = rod(arm=gravity, simulation={"integrator": integrator})
    q, dq = drive(simulation, 2000, [0.0])
    arm = vff.Arm([1.0], 1.0, gravity=9.81)
    assert q.min() == -1.0
    landed = int(np.argmax(q[:, 0] == -1.0))
    fall = 1.0 / np.sqrt(1.5 * 9.81)  # a lower bound: cos q ≤ 1
    assert fall < landed * DT < 2 * fall
    assert dq[landed - 1, 0] < -4.0
    assert (q[landed:] == -1.0).all() and (dq[landed:] == 0.0).all()
    assert np.diff(energy(arm, q, dq)).max() < (1e-9 if integrator == "rk4" else 0.03)


@pytest.mark.parametrize(("dt", "drift"), [(1e-3, 1e-7), (2.5e-4, 1e-10)])
def test_stops_take_energy_and_never_give_any(dt: float, drift: float) -> None:
    """Chains that fall from stop to stop and lose joules: in no step does the energy rise.

    Apart from what RK4 itself makes of it, 1e-8 J in the worst step of 1 ms, which falls with Δt⁵.
    """
    rng = np.random.default_rng(3)
    for n in (2, 2, 2, 3, 3, 3, 5, 5, 5):
        limits = np.sort(rng.uniform(-1.5, 1.5, (n, 2)), axis=1) + np.array([-0.1, 0.1])
        scenario = chain(n, simulation={"dt": dt})
        scenario["arm"] |= {"joint_limits": limits.tolist()}
        scenario |= {"q0": limits.mean(axis=1).tolist(), "dq0": rng.uniform(-2, 2, n).tolist()}
        q, dq = drive(vff.Simulation(scenario), round(1.0 / dt), [0.0] * n)
        assert (q >= limits[:, 0]).all() and (q <= limits[:, 1]).all()
        change = np.diff(energy(vff.Scenario.from_dict(scenario).arm, q, dq))
        assert change.sum() < -1.0
        assert change.max() < drift


def test_stops_can_be_taken_away() -> None:
    q, _ = drive(
        rod(arm={"gravity": 9.81, "joint_limits": [-1.0, 1.0]}, plant={"joint_stops": False}), 1000, [0.0]
    )
    assert q.min() < -2.0


def test_a_start_beyond_a_stop_is_warned_of() -> None:
    scenario = chain()
    scenario["arm"] |= {"joint_limits": [-0.45, 1.0]}
    with pytest.warns(
        vff.errors.ScenarioWarning, match=r"q0\[2\]: -0.5 rad is beyond the stops .* -0.45 and 1"
    ):
        vff.simulate(scenario)


def test_stops_end_what_a_controller_wants() -> None:
    """The tip cannot come where a stop forbids it, and the metric says that no limit is exceeded."""
    scenario = vff.Scenario.load("sweep-through").replace(
        **{
            "arm.joint_limits": [[1.1, 1.3], *[[-1.0, 1.0]] * 5],
            "reference.point": [1.0, 3.0],
            "controller.enforce_limits": False,
        }
    )
    result = vff.simulate(scenario)
    assert result.metrics.joint_limit_violation == 0.0
    assert result.q[:, 0].max() == 1.3 or result.q[:, 0].min() == 1.1


def test_a_drive_follows_with_its_time_constant() -> None:
    """τ = τ_c (1 − e^(−t/T)) from rest, seen in the velocity of a rod: its integral over I, exactly."""
    lag = 0.02
    simulation = rod(actuator={"time_constant": lag})
    _, dq = drive(simulation, 200, [1.0])
    t = DT * np.arange(201)
    np.testing.assert_allclose(simulation.state.tau_applied, 1 - np.exp(-t[-1:] / lag), rtol=1e-12)
    np.testing.assert_allclose(dq[:, 0], (t + lag * np.expm1(-t / lag)) / INERTIA, atol=1e-13)


def test_the_record_of_a_drive() -> None:
    """One step later, e^(−Δt/T) of the difference to the command is left, joint by joint."""
    lag = np.array([0.0, 1e-3, 2e-3, 5e-3, 1e-2, 2e-2])
    result = vff.simulate("sweep-through", {"actuator.time_constant": lag})
    assert result.tau_applied is not None
    assert (result.tau_applied[0, 1:] == 0.0).all()
    with np.errstate(divide="ignore"):
        left = np.exp(-DT / lag)
    expected = result.tau[:-1] + left * (result.tau_applied[:-1] - result.tau[:-1])
    np.testing.assert_allclose(result.tau_applied[1:, 1:], expected[:, 1:], atol=1e-12)
    np.testing.assert_array_equal(result.tau_applied[:, 0], result.tau[:, 0])


NOISE = {"position_noise": [1e-4, 2e-4, 3e-4, 4e-4, 5e-4, 0.0], "velocity_noise": 1e-3}


def errors(**overrides: Any) -> tuple[Array, Array]:
    """What the sensors add to q and q̇."""
    result = vff.simulate("sweep-through", overrides)
    assert result.q_measured is not None and result.dq_measured is not None
    return result.q_measured - result.q, result.dq_measured - result.dq


def test_noise_has_the_deviation_that_was_asked_for() -> None:
    """4001 numbers a joint: mean and deviation within 4 standard errors, and no correlation."""
    for noise, deviation in zip(
        errors(measurement=NOISE), (NOISE["position_noise"], [1e-3] * 6), strict=True
    ):
        count = len(noise)
        some = np.array(deviation) > 0
        standard = noise[:, some] / np.array(deviation)[some]
        assert (noise[:, ~some] == 0).all()
        assert (np.abs(standard.mean(axis=0)) < 4 / np.sqrt(count)).all()
        assert (np.abs(standard.std(axis=0) - 1) < 4 / np.sqrt(2 * count)).all()
        assert (np.abs(np.mean(standard[1:] * standard[:-1], axis=0)) < 4 / np.sqrt(count)).all()
        assert np.abs(np.corrcoef(standard.T) - np.eye(some.sum())).max() < 5 / np.sqrt(count)


def test_noise_is_that_of_its_seed() -> None:
    runs = [vff.simulate("sweep-through", {"measurement": NOISE, "seed": seed}) for seed in (1, 1, 2)]
    same_bits(runs[0], runs[1])
    np.testing.assert_array_equal(runs[0].q_measured, runs[1].q_measured)
    assert not np.array_equal(runs[0].q, runs[2].q)
    default = vff.simulate("sweep-through", {"measurement": NOISE})
    same_bits(default, vff.simulate("sweep-through", {"measurement": NOISE, "seed": 0}))


def test_every_noise_has_a_stream_of_its_own() -> None:
    """That of the velocities does not depend on there being one of the positions."""
    _, alone = errors(measurement={"velocity_noise": 1e-3})
    _, together = errors(measurement=NOISE)
    np.testing.assert_allclose(alone, together, atol=1e-12)


def test_readings_are_multiples_of_the_resolution() -> None:
    step, speed = 2 * np.pi / 4096, 0.01
    result = vff.simulate(
        "sweep-through", {"measurement": {"position_resolution": step, "velocity_resolution": speed}}
    )
    for measured, true, grid in (
        (result.q_measured, result.q, step),
        (result.dq_measured, result.dq, speed),
    ):
        assert measured is not None
        np.testing.assert_allclose(measured / grid, np.round(measured / grid), atol=1e-9)
        assert np.abs(measured - true).max() <= grid / 2 * (1 + 1e-9)
    assert np.abs(result.q_measured - result.q).max() > 0.4 * step


def test_delay_shifts_the_readings() -> None:
    """By whole steps, rounded up, joint by joint, to the last bit; before t = 0 it is the start."""
    delay = [0.0, 1e-3, 2e-3, 0.0025, 7e-3, 3e-3]
    with pytest.warns(vff.errors.ScenarioWarning, match=r"measurement.delay: 0.0025 s .* 0.003 s old"):
        result = vff.simulate("sweep-through", {"measurement": {"delay": delay}})
    for measured, true in ((result.q_measured, result.q), (result.dq_measured, result.dq)):
        assert measured is not None
        for joint, late in enumerate([0, 1, 2, 3, 7, 3]):
            expected = np.concatenate([np.repeat(true[:1, joint], late), true[: len(true) - late, joint]])
            np.testing.assert_array_equal(measured[:, joint], expected)


def test_a_controller_of_one_s_own_sees_the_sensors() -> None:
    """Two steps late; the state itself is the true one. Without sensors there is nothing to see."""
    simulation = rod(dq0=1.0, measurement={"delay": 2e-3})
    q, _ = drive(simulation, 10, [0.5])
    np.testing.assert_array_equal(simulation.state.q_measured, q[-3])
    np.testing.assert_array_equal(simulation.state.q, q[-1])
    plain = rod().state
    assert plain.q_measured is None and plain.dq_measured is None and plain.tau_applied is None


def test_the_record_is_of_the_true_state() -> None:
    """Tip, error and clearance belong to the recorded angles, and not to those that the controller sees."""
    tables = {"measurement": {"position_noise": 0.01, "delay": 5e-3}, "plant": {"masses": 1.2}}
    result = vff.simulate("sweep-through", tables)
    arm = result.scenario.arm
    tips = arm.forward_kinematics(result.q)[:, -1]
    np.testing.assert_allclose(result.x, tips, atol=1e-12)
    np.testing.assert_allclose(result.error, tips - result.x_ref, atol=1e-12)
    rates = np.einsum("tij,tj->ti", np.array([arm.jacobian(q) for q in result.q]), result.dq)
    np.testing.assert_allclose(result.dx, rates, atol=1e-11)
    obstacle = vff.Obstacle.circle([1.6, 2.9], 0.15, vff.Motion.linear([0.0, -0.35]))
    controller = vff.Controller(arm, vff.ControlSettings())
    for row in range(0, len(result.t), 100):
        terms = controller.terms(
            result.q[row], result.dq[row], result.x_ref[row], obstacles=[obstacle], t=result.t[row]
        )
        np.testing.assert_allclose(result.clearance[row], terms.clearance, atol=1e-12)
    assert result.metrics.min_clearance == result.clearance.min()
    np.testing.assert_allclose(
        result.metrics.max_error_tail, np.linalg.norm(result.error[result.t >= 3.2], axis=1).max()
    )


def test_the_law_sees_the_measured_state() -> None:
    """The torque of a record is the law's at the recorded measurement."""
    result = vff.simulate("sweep-through", {"measurement": {"position_noise": 0.01, "delay": 5e-3}})
    controller = vff.Controller(result.scenario.arm, result.scenario["controller"])
    obstacle = vff.Obstacle.circle([1.6, 2.9], 0.15, vff.Motion.linear([0.0, -0.35]))
    assert result.q_measured is not None and result.dq_measured is not None
    for row in range(0, len(result.t), 100):
        state = result.q_measured[row], result.dq_measured[row]
        terms = controller.terms(*state, result.x_ref[row], obstacles=[obstacle], t=result.t[row])
        np.testing.assert_allclose(result.tau[row], terms.tau, atol=1e-9)
        np.testing.assert_allclose(result.force[row], terms.force, atol=1e-9)


def test_what_is_not_there_stays_so(tmp_path: Path) -> None:
    """None goes through a file, and into no table; what is there goes along with everything else."""
    short = {"duration": 0.05}
    plain = vff.simulate("sweep-through", short)
    full = vff.simulate("sweep-through", short | TABLES)
    for result, there in ((plain, False), (full, True)):
        loaded = vff.Result.load(result.save(tmp_path / "run.npz"))
        for name in ("q_measured", "dq_measured", "tau_applied"):
            assert (getattr(loaded, name) is not None) == there
            assert (f"{name}_1" in result.to_pandas()) == there
            assert (name in result.to_xarray()) == there
            if there:
                np.testing.assert_array_equal(getattr(loaded, name), getattr(result, name))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("seed", -1, "seed: .*whole number, 0 or more.*-1"),
        ("seed", 0.5, "seed: .*whole number, 0 or more.*0.5"),
        ("plant.mass", 1.0, "plant: unknown key `mass`, did you mean `masses`"),
        ("plant.masses", [1.0, 1.0], "plant.masses: expected 6 values, got 2"),
        ("plant.masses", 0.0, "plant.masses: must be greater than 0, got 0.0"),
        ("plant.inertias", -1.0, "plant.inertias: must be 0 or more, got -1.0"),
        ("plant.com", [1.0], "plant.com: expected 6 values, got 1"),
        ("plant.gravity", [0.0, 1.0, 2.0], "plant.gravity: .*list of 2 numbers"),
        ("plant.payload", -0.1, "plant.payload: must be 0 or more, got -0.1"),
        ("plant.viscous_friction", [1, 1, 1, 1, 1, -1], r"plant.viscous_friction\[5\]: must be 0 or more"),
        ("plant.coulomb_friction", [1.0], "plant.coulomb_friction: expected 6 values, got 1"),
        ("plant.joint_stops", 1, "plant.joint_stops: .*boolean"),
        ("plant.lengths", 1.0, "plant: unknown key `lengths`"),
        ("measurement.noise", 1.0, "measurement: unknown key `noise`.*position_noise"),
        ("measurement.position_noise", -1.0, "measurement.position_noise: must be 0 or more"),
        ("measurement.velocity_noise", [0.0], "measurement.velocity_noise: expected 6 values, got 1"),
        ("measurement.position_resolution", -1.0, "measurement.position_resolution: must be 0 or more"),
        ("measurement.velocity_resolution", float("nan"), "measurement.velocity_resolution: .*finite"),
        ("measurement.delay", -1e-3, "measurement.delay: must be 0 or more"),
        ("measurement.delay", 11.0, "measurement.delay: must be at most 1e4 steps of 0.001 s, got 11.0"),
        ("actuator.time_constant", -1.0, "actuator.time_constant: must be 0 or more, got -1.0"),
        ("actuator.lag", 1.0, "actuator: unknown key `lag`"),
    ],
)
def test_bad_input_is_named(key: str, value: Any, message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message):
        vff.Scenario.load("sweep-through").replace(**{key: value})


@pytest.mark.parametrize("table", ["measurement", "actuator"])
def test_sensors_and_drives_need_a_sampled_controller(table: str) -> None:
    with pytest.raises(
        vff.errors.ScenarioError, match=f"{table}: needs a sampled controller.*hold.*predictor"
    ):
        vff.simulate("sweep-through", {"simulation.control": "continuous", table: {}})


def test_keyword_arguments_of_a_scenario() -> None:
    loaded = vff.Scenario.load("sweep-through")
    document = loaded.to_dict() | TABLES | {"seed": 3}
    assert vff.Scenario(**document) == vff.Scenario.from_dict(document)


def test_mujoco_moves_the_same_plant() -> None:
    """Other masses, a payload and viscous friction, to rounding."""
    plant = {
        "masses": [1.2, 0.8, 1.1, 0.9, 1.0, 1.3],
        "payload": 0.3,
        "viscous_friction": [0.1, 0.2, 0, 0, 0.3, 0],
    }
    ours, theirs = (
        vff.simulate("sweep-through", {"plant": plant}, plant=name) for name in ("core", "mujoco")
    )
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-9)
    assert np.abs(ours.q - vff.simulate("sweep-through").q).max() > 1e-3


def test_mujoco_s_stops_and_dry_friction_are_softer() -> None:
    """The same limits and the same friction, within what a soft constraint allows."""
    changes = {
        "arm.joint_limits": [[1.1, 1.3], *[[-1.0, 1.0]] * 5],
        "reference.point": [2.0, 3.0],
        "plant.coulomb_friction": 0.2,
        "controller.field.gain": 0.0,
        "controller.enforce_limits": False,
    }
    ours, theirs = (vff.simulate("sweep-through", changes, plant=name) for name in ("core", "mujoco"))
    assert ours.metrics.joint_limit_violation == 0.0
    assert 0.0 < theirs.metrics.joint_limit_violation < 0.02
    np.testing.assert_allclose(theirs.q, ours.q, atol=0.05)


@pytest.mark.parametrize("where", ["plant", "controller.command"])
@pytest.mark.parametrize("name", ["sweep-through", "panda-sweep"])
def test_absurd_friction_is_told_of_like_any_other(name: str, where: str, tmp_path: Path) -> None:
    """Whatever becomes of the run: metrics, headline, figure and report are made of it; or it is refused."""
    n = vff.Scenario.load(name).arm.n
    moving = {"dq0": [0.3] * n, "duration": 0.2, "simulation": {"record_every": 20, "integrator": "rk4"}}
    for size in (1e6, 1e30, 1e100):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", vff.errors.ScenarioWarning)
            result = vff.simulate(name, moving | {f"{where}.viscous_friction": size})
        assert result.headline.lines and np.isfinite(result.metrics.min_clearance)
        assert null_space.null_space(result).axes
    assert result.report(tmp_path / "run.html").exists()
    with pytest.raises(vff.VffNullError, match=rf"{where}\.viscous_friction: must be at most 1e100"):
        vff.simulate(name, {f"{where}.viscous_friction": 1e300})


def own_distance(q: np.ndarray, length: float = 0.5, radius: float = 0.04) -> float:
    """The least distance of links that share no joint, 200 points of each, of an arm of equal links."""
    turn = np.cumsum(q)
    ends = np.vstack([[0.0, 0.0], np.cumsum(length * np.stack([np.cos(turn), np.sin(turn)], 1), 0)])
    share = np.linspace(0.0, 1.0, 200)[:, None]
    links = [a + share * (b - a) for a, b in itertools.pairwise(ends)]
    pairs = [(i, j) for i in range(len(links)) for j in range(i + 2, len(links))]
    apart = [np.linalg.norm(links[i][:, None] - links[j][None], axis=2).min() for i, j in pairs]
    return float(min(apart)) - 2.0 * radius


FOLDING: dict[str, Any] = {
    "duration": 0.62,
    "q0": [0.0, 1.2, 1.2, 1.2],
    "arm": {"lengths": [0.5] * 4, "masses": 1.0, "radius": 0.04, "gravity": 9.81},
    "reference": {"kind": "line", "end": [0.25, 0.02], "duration": 0.9, "unreachable": "warn"},
    "controller": {"stiffness": 9.0, "damping": 6.0, "null_damping": 4.0, "self_collision": "report"},
}


def test_the_record_is_of_the_true_arm_whatever_is_measured() -> None:
    """Contact with itself, energies, power of the motors and manipulability, behind a delay and noise."""
    measured = {"delay": 0.06, "position_noise": 2e-3, "velocity_noise": 0.05}
    result = vff.simulate({**FOLDING, "measurement": measured})
    truth = np.array([own_distance(q) for q in result.q])
    assert truth.min() < -0.01
    np.testing.assert_allclose(result.self_clearance, truth, atol=1e-3)
    assert result.metrics.min_self_clearance == pytest.approx(truth.min(), abs=1e-3)
    assert "hit itself" in str(result.headline)
    arm = result.scenario.arm
    for i in range(0, len(result.t), 60):
        q, dq = result.q[i], result.dq[i]
        j = arm.jacobian(q)[:2]
        expected = [arm.kinetic_energy(q, dq), arm.potential_energy(q), dq @ result.tau[i]]
        expected.append(np.sqrt(np.linalg.det(j @ j.T)))
        recorded = [*result.energy[i, :2], result.power[i, 0], result.manipulability[i]]
        np.testing.assert_allclose(recorded, expected, rtol=1e-9, atol=1e-9)
