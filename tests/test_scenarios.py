"""The bundled scenarios keep what is promised about them (README, and docs/theory.md, sections 8 and 10)."""

from __future__ import annotations

import functools
import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import oracle
import vffnull as vff
from vffnull.errors import InputError, ScenarioError

EXPECTED = {name: "completed" for name in vff.scenarios()} | {
    "on-path": "collided",
    "on-path-moving": "collided",
    "panda-bump": "collided",  # with what it does not see
    "planner-bench-circle-5": "collided",
    "planner-bench-moving-5": "collided",
}
PAPER = ["paper-1", "paper-1-ramp", "paper-2", "paper-2-moving", "paper-2-printed"]


@functools.cache
def run(name: str) -> vff.Result:
    return vff.simulate(name)


def sweep(**overrides: Any) -> vff.Result:
    return vff.simulate("sweep-through", overrides=overrides)


def tip_motion(result: vff.Result) -> float:
    return oracle.tip_motion({"x": result.x})


def test_contract_names_are_bundled() -> None:
    """The public interface."""
    contract = {*PAPER, "sweep-through", "on-path", "crowd", "narrow-gap"}
    contract |= {"on-path-moving", "pincer", "chase"}
    assert contract <= set(vff.scenarios())


@pytest.mark.parametrize("name", vff.scenarios())
def test_every_scenario_ends_as_expected(name: str) -> None:
    """The null space suffices everywhere but for a disc on the tip's own path (§4)."""
    result = run(name)
    assert result.status == EXPECTED[name], result.message
    assert result.end_time == pytest.approx(result.scenario.duration)
    assert result.warnings == ()
    assert result.scenario.name == name and result.scenario.description
    for array in (result.q, result.tau, result.x, result.clearance):
        assert np.all(np.isfinite(array))


@pytest.mark.parametrize("name", vff.scenarios())
def test_null_space_torque_never_moves_the_tip(name: str) -> None:
    """The metric of the central invariant, in m/s²: rounding, at every step of every scenario.

    The wrist of an arm in space has moments of inertia of 1e-3 kg·m² and less: what a torque is rounded by
    makes it accelerate a hundred times as much as a link of a planar arm.
    """
    result = run(name)
    bound = 1e-11 if result.scenario.arm.dimension == 2 else 1e-9
    assert result.metrics["max_null_acceleration"] < bound


@pytest.mark.parametrize("name", PAPER)
def test_paper_scenarios(name: str) -> None:
    """Tail tracking error below 1e-5 m and a positive minimum clearance."""
    result = run(name)
    assert result.metrics["max_error_tail"] < 1e-5
    assert result.metrics["min_clearance"] > 0
    tail = result.t >= 0.8 * result.scenario.duration
    assert np.linalg.norm(result.error[tail], axis=1).max() < 1e-5
    assert result.clearance.min() == pytest.approx(result.metrics["min_clearance"], abs=1e-12)


@pytest.mark.parametrize("name", PAPER)
def test_repulsion_rises_on_approach_and_falls_on_leaving(name: str) -> None:
    """Repulsion and distance go opposite ways.

    Over steps of 0.1 s in which a distance changes by more than 1 mm inside the field, the force on each link
    always goes the other way than its own distance, and ‖τ_vff‖ (where levers and other links matter too)
    the other way than the nearest distance in nine of ten steps, with a correlation below −0.8.

    The paper says so of its Figs. 8 and 13.
    """
    result = run(name)
    influence = result.scenario["controller.field.influence"]
    every = round(0.1 / (result.t[1] - result.t[0]))

    def steps(distance: np.ndarray, strength: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        d, s = distance[::every], strength[::every]
        seen = (d[:-1] < influence) & (d[1:] < influence) & (np.abs(np.diff(d, axis=0)) > 1e-3)
        return np.diff(d, axis=0)[seen], np.diff(s, axis=0)[seen]

    change, push = steps(result.clearance, result.force)
    assert np.sum(change < 0) >= 3 and np.sum(change > 0) >= 3, "there has to be an approach and a departure"
    assert np.all(change * push < 0)
    nearest, torque = result.clearance.min(axis=1), np.linalg.norm(result.tau_vff, axis=1)
    change, push = steps(nearest, torque)
    assert np.sum(change < 0) >= 3 and np.sum(change > 0) >= 3
    assert np.mean(change * push < 0) >= 0.9
    inside = nearest < influence
    assert np.corrcoef(nearest[inside], torque[inside])[0, 1] < -0.8
    # And no repulsion from beyond the field's influence.
    assert np.all(result.force[result.clearance >= influence] == 0)
    assert np.all(torque[~inside] == 0)


def test_paper_1_swings_with_the_obstacle(paper_1: vff.Result) -> None:
    """After settling, the repulsive torque is largest when the obstacle is nearest to the arm.

    The clearance cannot exceed 1.30 − r_o then (§6).
    """
    settled = paper_1.t > 10
    assert paper_1.clearance[settled].min() < 1.30 - 0.3 + 1e-6
    strongest = paper_1.t[settled][np.abs(paper_1.tau_vff[settled]).sum(axis=1).argmax()]
    nearest = paper_1.t[settled][paper_1.clearance[settled].min(axis=1).argmin()]
    assert strongest == pytest.approx(nearest, abs=0.5)


@pytest.mark.parametrize(
    ("name", "given"),
    [
        (
            "paper-1",
            {
                "q0": [0.0, 0.25, 0.12, 0.30, 0.20, 0.15],
                "reference.point": [2.8, 1.6],
                "obstacles.0.position": [1.5, 2.0],
                "obstacles.0.motion.amplitude": [0.0, -0.5],
                "obstacles.0.motion.angular_frequency": 0.5,
                "obstacles.0.shape.radius": 0.3,
                "controller.field.influence": 1.2,
                "controller.field.gain": 5.0,
                "controller.stiffness": 16.0,
                "controller.damping": 8.0,
                "controller.null_damping": 2.0,
                "simulation.dt": 1e-3,
                "duration": 20.0,
                "arm.lengths": [1.0] * 6,
            },
        ),
        (
            "paper-2",
            {
                "obstacles.0.position": [1.6, 2.1],
                "duration": 10.0,
                "reference.coefficients": [[2.5], [0.5, 0.0, 0.06, -0.004]],
            },
        ),
        (
            "paper-2-printed",
            {
                "obstacles.0.position": [1.6, 2.1],
                "duration": 5.0,
                "reference.coefficients": [[2.5], [0.5, 0.0, 0.06, -0.04]],
            },
        ),
    ],
)
def test_scenarios_are_the_papers(name: str, given: dict[str, Any]) -> None:
    """What §6 says is given, and what it says we choose."""
    scenario = vff.Scenario.load(name)
    for key, value in given.items():
        assert scenario[key] == value, key


@pytest.mark.parametrize(
    ("name", "away"), [("paper-1", 2.402), ("paper-2", 3.323), ("paper-2-printed", 3.323)]
)
def test_first_error(name: str, away: float) -> None:
    """§6: how far from its reference a scenario starts."""
    assert np.linalg.norm(run(name).error[0]) == pytest.approx(away, abs=5e-4)


def test_paper_1_ramp_has_no_step() -> None:
    """§6: the smooth approach never errs by more than rounding and the integrator's."""
    assert np.linalg.norm(run("paper-1-ramp").error, axis=1).max() < 1e-9


def test_the_printed_reference_leaves_the_reach() -> None:
    """§6: at t = 5.8499 s, and the refusal says so."""
    with pytest.raises(vff.errors.ScenarioError, match=r"^reference: .*5\.8499 s") as caught:
        vff.simulate("paper-2-printed", overrides={"duration": 10.0})
    assert caught.value.path == "reference"
    t = float(
        np.real(next(r for r in np.roots([-0.04, 0.06, 0.0, 0.5 + np.sqrt(36 - 6.25)]) if abs(r.imag) < 1e-9))
    )
    assert t == pytest.approx(5.8499, abs=5e-5)
    vff.Scenario.load("paper-2-printed").replace(duration=5.84)  # still allowed


# ------------------------------------------------------------------------------------------- sweep-through


def test_sweep_through_clears() -> None:
    """More than 0.3 m with the field, −0.1467 m without (prototype: 0.3529 and −0.1467)."""
    assert sweep().metrics["min_clearance"] == pytest.approx(0.3529, abs=1e-4)
    off = sweep(**{"controller.field.gain": 0})
    assert off.status == "collided"
    assert off.metrics["min_clearance"] == pytest.approx(-0.1467, abs=1e-4)
    assert off.metrics["intrusion_depth"] == pytest.approx(0.1467, abs=1e-4)
    assert off.metrics["intrusion_time"] > 0
    first = off.t[np.argmax(off.clearance.min(axis=1) < 0)]
    assert off.metrics["collision_time"] == pytest.approx(first, abs=1e-9)


def test_sweep_through_holds_the_tip() -> None:
    """≤ 1e-5 m under zero-order hold at 1 ms, ≤ 1e-10 m in `continuous`, between them with the predictor."""
    hold, continuous = sweep(), sweep(**{"simulation.control": "continuous"})
    assert hold.scenario["simulation.control"] == "hold" and hold.scenario["simulation.dt"] == 1e-3
    assert 1e-7 < tip_motion(hold) <= 1e-5
    assert tip_motion(continuous) <= 1e-10
    assert (
        tip_motion(continuous) < tip_motion(sweep(**{"simulation.control": "predictor"})) < tip_motion(hold)
    )


def test_sweep_through_without_projection() -> None:
    """Fact 11: the unprojected torque moves the tip by millimetres (prototype: 5.2 mm)."""
    assert 3e-3 < tip_motion(sweep(**{"controller.projection": "none"})) < 8e-3


def test_sweep_through_with_the_kinematic_projection() -> None:
    """Fact 11: W = I keeps static consistency only; in motion the tip leaves its place by millimetres."""
    result = sweep(**{"controller.projection": "kinematic"})
    assert tip_motion(result) > 1e-3
    assert result.metrics["max_null_acceleration"] > 1e-2


@pytest.mark.parametrize("formulation", ["recursive", "extended_jacobian"])
def test_formulations_run_alike(formulation: str) -> None:
    result = sweep(**{"controller.formulation": formulation})
    np.testing.assert_allclose(result.q, run("sweep-through").q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", ["crowd", "narrow-gap"])
def test_avoidance_decides(name: str) -> None:
    """§6: scenes in which links overlap obstacles without the field, and do not with it."""
    assert run(name).metrics["min_clearance"] > 0.05
    assert vff.simulate(name, {"controller.field.gain": 0.0}).status == "collided"


SHAKEN = list(itertools.product((0.05, 0.08, 0.11), (0.35, 0.45), (-0.03, 0.0, 0.03)))
"""x of the disc [m], its speed [m/s], change of every joint [rad]."""


def head_on(sliding: float) -> list[vff.Result]:
    changes = []
    for x, speed, turn in SHAKEN:
        q0 = np.array([1.57, -1.2, -0.6]) + turn
        links = np.cumsum(q0)
        changes.append(
            {
                "q0": q0,
                "reference.point": [np.cos(links).sum(), np.sin(links).sum()],
                "obstacles.0.position": [x, 2.4],
                "obstacles.0.motion.velocity": [0.0, -speed],
                "controller.field.sliding": sliding,
            }
        )
    return vff.simulate_many("head-on", changes)


def test_sliding_frees_an_elbow_that_the_field_holds() -> None:
    """(T82): not one lucky posture, but centimetres, degrees and speeds about it, and for a range of κ₀."""
    held = [result.metrics["min_clearance"] < -0.1 for result in head_on(0.0)]
    assert sum(held) > len(SHAKEN) / 2 and held[SHAKEN.index((0.08, 0.35, 0.0))]
    for sliding in (80.0, 120.0):
        for result in head_on(sliding):
            assert result.metrics["min_clearance"] > 0.1
            assert tip_motion(result) < 1e-4


def test_on_path_cannot_be_avoided_by_the_null_space() -> None:
    """§4's table: −0.230 m with the null-space field only, at no tracking error."""
    result = run("on-path")
    assert result.metrics["min_clearance"] == pytest.approx(-0.230, abs=0.01)
    assert result.metrics["max_error_tail"] < 1e-9


# ---------------------------------------------------------------------------------------- the paper's typos


def test_the_printed_sign_of_the_stiffness_diverges() -> None:
    """§1 (17): ẋ_s = ẋ_r + K_s e with e = x − x_r runs away; with − it settles. By hand on the plant."""

    def run_with(sign: float) -> vff.Simulation:
        scenario = vff.Scenario.load("paper-1").replace(
            **{"duration": 3.0, "obstacles": None, "simulation.control": "hold"}
        )
        simulation = vff.Simulation(scenario)
        arm, K, D = scenario.arm, 16.0, 8.0
        target = np.array(scenario["reference.point"]) - 0.0
        while not simulation.done and np.linalg.norm(simulation.state.x - target) < 20:
            s = simulation.state
            M, J = arm.mass_matrix(s.q), arm.jacobian(s.q)
            e = arm.extended_jacobian(s.q, s.dq)
            ddx = -D * s.dx + sign * K * (s.x - target)
            coriolis = arm.coriolis_matrix(s.q, s.dq) @ s.dq
            force = e.Lambda_x @ (ddx - arm.jacobian_dot(s.q, s.dq) @ s.dq)
            null = e.N.T @ (-2.0 * M @ s.dq)
            simulation.step(coriolis + J.T @ force + null)
        return simulation

    good, bad = run_with(-1.0), run_with(+1.0)
    target = np.array([2.8, 1.6])
    first = 2.402
    assert np.linalg.norm(good.state.x - target) < 1e-2 * first
    # Runs to the rim of its reach, where it cannot go on, or beyond all bounds.
    assert bad.status == "diverged" or np.linalg.norm(bad.state.x - target) > 1.2 * first


def test_the_printed_potential_has_no_square() -> None:
    """§1 (U_i): the force is −d/dd of ½η(1/d − 1/d_s)², not of ½η(1/d − 1/d_s)."""
    field, d = vff.Field.khatib(5.0, 1.2), 0.5
    disc = vff.Obstacle.circle([0.5, 0.3 + d], 0.3)
    found = (
        vff.Controller(vff.Arm.uniform(1), {"field": field})
        .terms([0.0], [0.0], [1.0, 0.0], obstacles=[disc])
        .force[0]
    )
    assert found == pytest.approx(5.0 * (1 / d - 1 / 1.2) / d**2, rel=1e-12)
    assert abs(found - 2.5 / d**2) > 1.0


# --------------------------------------------------------------------------------------------- passivity


@pytest.mark.parametrize("name", ["paper-1-ramp", "paper-2-moving", "crowd"])
def test_energy_balance_of_the_null_space(name: str) -> None:
    """§2: d/dt(V_n + U) is damping, coupling and obstacle power: the residual is quadrature error, and falls
    with its order (trapezoidal rule: four times per halving)."""
    duration = {"duration": 4.0}
    coarse, fine = (
        vff.simulate(name, {**duration, "simulation.dt": dt}).metrics["passivity_residual"]
        for dt in (4e-3, 2e-3)
    )
    assert coarse < 1e-2
    assert 3.0 < coarse / fine < 5.5


def test_a_file_of_another_ending_is_there(tmp_path: Path) -> None:
    """Not "no scenario called": what is wrong is its name."""
    path = tmp_path / "mine.txt"
    path.write_text(str(vff.Scenario.load("paper-1")), encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"mine\.txt: the name of a scenario file ends in \.toml"):
        vff.Scenario.load(path)
    with pytest.raises(InputError, match=r"mine\.txt: the name of a study file ends in \.toml"):
        vff.Study.load(path)
    with pytest.raises(ScenarioError, match="no scenario called 'paper'"):
        vff.Scenario.load("paper")


@pytest.mark.parametrize("name", ["arm.urdf", "plain", "scenario.TOML"])
def test_a_scenario_is_saved_under_a_name_that_is_loaded(name: str, tmp_path: Path) -> None:
    """Nothing is written over the file of an arm, which would be no scenario for its name."""
    path = tmp_path / name
    path.write_text("<robot/>", encoding="utf-8")
    for given in (path, str(path)):
        with pytest.raises(ScenarioError) as caught:
            vff.Scenario.load("paper-1").save(given)
        assert str(caught.value) == f"{path}: the name of a scenario file ends in .toml"
    assert path.read_text(encoding="utf-8") == "<robot/>"


def test_a_single_obstacle_stands_for_a_list() -> None:
    """In the constructor, in `replace` and among overrides."""
    disc = vff.Obstacle.circle([3.0, 3.0], 0.1)
    plain = vff.Scenario.load("paper-1")
    listed = plain.replace(obstacles=[disc])
    assert plain.replace(obstacles=disc) == plain.replace(obstacles=disc.to_dict()) == listed
    one = vff.simulate(plain, {"obstacles": disc, "duration": 0.01})
    np.testing.assert_array_equal(one.q, vff.simulate(listed, {"duration": 0.01}).q)
