"""`Simulation`: somebody else's controller in the loop, and the same run step by step."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest

import vffnull as vff

RECORDED = ("t", "q", "dq", "x", "dx", "x_ref", "clearance", "tau", "obstacles")
BYTES = (
    "t",
    "q",
    "dq",
    "tau",
    "tau_task",
    "tau_null",
    "tau_vff",
    "x",
    "dx",
    "x_ref",
    "error",
    "force",
    "clearance",
    "obstacles",
)


def small(**overrides: Any) -> vff.Scenario:
    return vff.Scenario.load("sweep-through").replace(duration=0.2, **overrides)


def states(simulation: vff.Simulation, tau: Callable[[vff.State], Any] | None = None) -> list[vff.State]:
    found = [simulation.state]
    while not simulation.done:
        found.append(simulation.step(None if tau is None else tau(simulation.state)))
    return found


@pytest.mark.parametrize(
    ("control", "every"), [("hold", 1), ("hold", 4), ("predictor", 1), ("predictor", 4), ("continuous", 1)]
)
@pytest.mark.parametrize("integrator", ["rk4", "semi_implicit_euler"])
def test_steps_are_the_run(control: str, integrator: str, every: int) -> None:
    """Bit for bit, in all modes; one step is one control period."""
    scenario = small(
        **{
            "simulation.control": control,
            "simulation.integrator": integrator,
            "simulation.control_every": every,
        }
    )
    result = vff.simulate(scenario)
    found = states(vff.Simulation(scenario))
    assert len(found) == 200 // every + 1
    for name in RECORDED:
        stepped = np.array([getattr(state, name) for state in found])
        np.testing.assert_array_equal(stepped, getattr(result, name)[::every], err_msg=name)


def test_our_own_controller_does_the_same() -> None:
    """`Controller.torque` in a loop of our own is the scenario's law under zero-order hold, bit for bit."""
    scenario = small()
    controller = vff.Controller(scenario.arm, scenario["controller"])
    around = scenario["obstacles"]
    found = states(
        vff.Simulation(scenario), lambda s: controller.torque(s.q, s.dq, s.x_ref, obstacles=around, t=s.t)
    )
    np.testing.assert_array_equal([s.q for s in found], vff.simulate(scenario).q)


def test_external_torque_is_held_and_used() -> None:
    """Gravity compensation by hand keeps the arm where it is; no torque lets it fall."""
    arm = vff.Arm.uniform(3, gravity=9.81)
    q0 = [0.3, 0.5, -0.4]
    scenario = vff.Scenario(
        arm=arm, q0=q0, duration=0.5, reference={"kind": "setpoint", "point": arm.forward_kinematics(q0)[-1]}
    )
    held = states(vff.Simulation(scenario), lambda s: arm.gravity_torque(s.q))[-1]
    np.testing.assert_allclose(held.q, q0, rtol=0, atol=1e-12)
    fallen = states(vff.Simulation(scenario), lambda s: np.zeros(3))[-1]
    assert fallen.x[1] < held.x[1] - 0.5


def test_external_torque_is_held_over_the_whole_period() -> None:
    scenario = small(**{"simulation.control_every": 5})
    fine = vff.Simulation(small())
    for _ in range(5):
        fine.step([1.0, 0, 0, 0, 0, 0.5])
    coarse = vff.Simulation(scenario).step([1.0, 0, 0, 0, 0, 0.5])
    np.testing.assert_array_equal(coarse.q, fine.state.q)
    assert coarse.t == pytest.approx(0.005)


def test_reset() -> None:
    simulation = vff.Simulation(small())
    first = [state.q.tobytes() for state in states(simulation)]
    assert simulation.done
    assert simulation.reset().t == 0.0
    assert not simulation.done
    np.testing.assert_array_equal(simulation.state.q, small()["q0"])
    assert [state.q.tobytes() for state in states(simulation)] == first


def test_done_and_status() -> None:
    simulation = vff.Simulation(small())
    assert not simulation.done and simulation.status == "completed"
    for k in range(200):
        assert not simulation.done
        assert simulation.step().t == pytest.approx((k + 1) * 1e-3)
    assert simulation.done and simulation.status == "completed"


def test_status_of_a_collision() -> None:
    """The status follows the run: collided from the first contact on, until the reset."""
    scenario = vff.Scenario.load("sweep-through").replace(
        **{"controller.field.gain": 0.0, "simulation.dt": 4e-3}
    )
    simulation = vff.Simulation(scenario)
    seen = []
    while not simulation.done:
        simulation.step()
        seen.append((simulation.status, bool(simulation.state.clearance.min() < 0)))
    first = next(k for k, (_, touching) in enumerate(seen) if touching)
    assert first > 10
    assert {status for status, _ in seen[:first]} == {"completed"}
    assert {status for status, _ in seen[first:]} == {"collided"}
    simulation.reset()
    assert simulation.status == "completed"


def test_status_of_a_divergence() -> None:
    simulation = vff.Simulation(small())
    while not simulation.done:
        simulation.step([1e7, 0.0, 0.0, 0.0, 0.0, -1e7])
    assert simulation.status == "diverged"
    last = simulation.state
    assert last.t < 0.2 and np.all(np.isfinite(last.q)) and np.all(np.isfinite(last.dq))
    assert simulation.step([0.0] * 6).t == last.t  # it stays there
    assert simulation.reset().t == 0.0 and simulation.status == "completed"


def test_states_are_snapshots() -> None:
    """A state does not change when the simulation goes on, nor when its arrays are written to."""
    simulation = vff.Simulation(small())
    before = simulation.state
    q = before.q.copy()
    before.q[:] = 7.0
    simulation.step()
    np.testing.assert_array_equal(before.q, q)
    assert simulation.state.t > before.t == 0.0


@pytest.mark.parametrize("name", ["sweep-through", "crowd", "paper-2-moving"])
def test_same_scenario_same_bits(name: str) -> None:
    """ARCHITECTURE.md: bit-identical on a machine."""
    a, b = (vff.simulate(name, {"duration": 1.0}) for _ in range(2))
    for array in BYTES:
        assert getattr(a, array).tobytes() == getattr(b, array).tobytes(), array
    assert dict(a.metrics) == dict(b.metrics)


def test_threads_do_not_disturb_each_other() -> None:
    """Two runs at once in two threads, several times, give what they give alone."""
    names = ["crowd", "sweep-through"]
    alone = [vff.simulate(name, {"duration": 2.0}).q.tobytes() for name in names]
    with ThreadPoolExecutor(2) as pool:
        for _ in range(5):
            together = list(pool.map(lambda name: vff.simulate(name, {"duration": 2.0}).q.tobytes(), names))
            assert together == alone


def test_control_every() -> None:
    """The torque changes once per control period only; the plant moves in between."""
    overrides = {"duration": 0.2, "simulation.control": "hold", "simulation.control_every": 5}
    result = vff.simulate("paper-1", overrides)
    changes = np.any(np.diff(result.tau, axis=0) != 0, axis=1)
    assert set(np.nonzero(changes)[0] % 5) == {4}
    assert np.all(np.any(np.diff(result.q, axis=0) != 0, axis=1))


@pytest.mark.parametrize("kind", ["dict", "file", "name", "scenario", "object"])
def test_every_way_in_is_the_same_run(kind: str, tmp_path: Any) -> None:
    """A bundled name, a path, a dict and a Scenario."""
    scenario = vff.Scenario.load("sweep-through")
    scenario.save(tmp_path / "mine.toml")
    sources: dict[str, Any] = {
        "name": "sweep-through",
        "file": str(tmp_path / "mine.toml"),
        "object": tmp_path / "mine.toml",
        "dict": scenario.to_dict(),
        "scenario": scenario,
    }
    expected = vff.simulate("sweep-through", overrides={"duration": 0.1})
    found = vff.simulate(sources[kind], overrides={"duration": 0.1})
    assert found.q.tobytes() == expected.q.tobytes()
    assert found.scenario == expected.scenario


def test_overrides_and_replace_leave_the_original_alone() -> None:
    scenario = vff.Scenario.load("paper-1")
    before = scenario.to_dict()
    assert (
        scenario.replace(**{"controller.field.gain": 2.0, "obstacles.0.position": [1, 2]})[
            "controller.field.gain"
        ]
        == 2.0
    )
    vff.simulate(scenario, {"duration": 0.01})
    scenario.to_dict()["duration"] = 99.0
    scenario["obstacles"].clear()
    assert scenario.to_dict() == before and scenario == vff.Scenario.load("paper-1")


@pytest.mark.parametrize("name", vff.scenarios())
def test_scenarios_survive_toml(name: str, tmp_path: Any) -> None:
    scenario = vff.Scenario.load(name)
    scenario.save(tmp_path / "copy.toml")
    copy = vff.Scenario.load(tmp_path / "copy.toml")
    assert copy == scenario and hash(copy) == hash(scenario) and copy.to_dict() == scenario.to_dict()


def test_objects_can_be_pickled() -> None:
    """Arms travel to worker processes as what they are; so do the small descriptions."""
    arm = vff.Arm(
        [1.0, 0.7], [1.0, 2.0], com=[[0.5, 0.1], [0.3, 0.0]], inertias=[0.1, 0.2], gravity=9.81, radius=0.05
    )
    things = [
        arm,
        vff.Field.khatib(1.0, 0.5, floor=0.1),
        vff.Motion.waypoints([0.0, 1.0], [[0, 0], [1, 1]]),
        vff.Obstacle.capsule([0, 0], [1, 0], 0.2, vff.Motion.linear([1, 0])),
        vff.ControlSettings(stiffness=[1.0, 2.0], field=vff.Field.bounded(1.0, 0.5)),
        vff.Scenario.load("crowd"),
    ]
    for thing in things:
        again = pickle.loads(pickle.dumps(thing))
        assert again == thing and hash(again) == hash(thing), thing
    np.testing.assert_array_equal(
        pickle.loads(pickle.dumps(arm)).mass_matrix([0.1, 0.2]), arm.mass_matrix([0.1, 0.2])
    )


def test_a_controller_forgets_the_previous_call() -> None:
    """The torque depends on the arguments only, not on what was asked before: obstacles, time, state."""
    arm = vff.Arm.uniform(4)
    near, far = (
        vff.Obstacle.circle([1.5, 0.6], 0.2),
        vff.Obstacle.circle([9.0, 9.0], 0.2, vff.Motion.linear([-1, -1])),
    )
    q, dq, x = [0.3, 0.4, -0.5, 0.2], [0.1, -0.2, 0.3, 0.1], [2.0, 1.0]
    settings = {"field": vff.Field.khatib(1.0, 1.0)}
    controller = vff.Controller(arm, settings)
    calls: list[dict[str, Any]] = [
        {"obstacles": [near]},
        {"obstacles": [far], "t": 0.0},
        {"obstacles": [far], "t": 7.5},
        {"obstacles": []},
        {},
        {"obstacles": [near, far], "t": 7.5},
        {"obstacles": [near.to_dict()]},
        {"obstacles": (near,)},
    ]
    fresh = [vff.Controller(arm, settings).torque(q, dq, x, **call) for call in calls]
    for order in (range(8), reversed(range(8)), [0, 0, 3, 0, 5, 1, 2, 1]):
        for k in order:
            np.testing.assert_array_equal(controller.torque(q, dq, x, **calls[k]), fresh[k])
    document = near.to_dict()
    controller.torque(q, dq, x, obstacles=[document])
    document["position"] = [9.0, 9.0]  # a dict may change between calls
    np.testing.assert_array_equal(controller.torque(q, dq, x, obstacles=[document]), fresh[3])


def test_progress_is_told() -> None:
    told: list[tuple[float, float]] = []
    result = vff.simulate("paper-1", progress=lambda t, duration: told.append((t, duration)))
    assert result.status == "completed"
    assert told and told[-1] == (20.0, 20.0) and sorted(told) == told


def test_an_exception_in_the_progress_callback_comes_through() -> None:
    def broken(t: float, duration: float) -> None:
        raise RuntimeError("from the callback")

    with pytest.raises(RuntimeError, match="from the callback"):
        vff.simulate("paper-1", progress=broken)
