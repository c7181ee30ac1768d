"""Energy: every port is accounted for, and a tank bounds what avoidance injects (docs/theory.md, T39)."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

import vffnull as vff

CUBIC = {"kind": "cubic", "gain": 0.5, "influence": 0.8}
SCENES: dict[str, dict[str, Any]] = {
    "field": {"controller.field": CUBIC},
    "gravity": {"controller.field": CUBIC, "arm.gravity": 9.81},
    "posture": {
        "controller.field.gain": 0.0,
        "controller.posture": [0.5] * 6,
        "controller.posture_stiffness": 3.0,
    },
    "joint limits": {
        "controller.field.gain": 0.0,
        "arm.joint_limits": [-1.9, 1.9],
        "controller.joint_limit_field": {"kind": "cubic", "gain": 0.02, "influence": 0.9},
    },
    "links": {"controller.field": CUBIC | {"influence": 1.1}, "controller.self_collision": "avoid"},
    "per joint damping": {"controller.field": CUBIC, "controller.null_damping": [1, 2, 3, 4, 5, 6]},
}


def defects(result: vff.Result) -> tuple[float, float]:
    """Largest gaps [J] of the balances of the arm and of its null space, integrated by Simpson's rule."""
    work = cumulative_simpson(result.power, x=result.t, axis=0, initial=0)
    motors, ports = work[:, 0], work[:, 1:].sum(axis=1)
    mechanical = result.energy[:, 0] + result.energy[:, 1]
    stored = result.energy[:, 2]
    return (
        float(np.abs(mechanical - mechanical[0] - motors).max()),
        float(np.abs(stored - stored[0] - ports).max()),
    )


@pytest.mark.parametrize("scene", SCENES)
def test_the_balances_close_to_integrator_order(scene: str) -> None:
    """Of a moving task among moving obstacles, with RK4: 16 times less for half the step, to rounding."""
    line = {"kind": "line", "end": [4.4, 1.5], "duration": 3.0}
    keys = {"reference": line, "simulation.control": "continuous", "duration": 3.0, **SCENES[scene]}
    gaps = np.array(
        [defects(vff.simulate("sweep-through", {**keys, "simulation.dt": dt})) for dt in (2e-2, 1e-2, 5e-3)]
    )
    for before, after in itertools.pairwise(gaps):
        for ratio, gap in zip(before / after, after, strict=True):
            assert ratio > 10 or gap < 1e-9
    assert gaps[-1].max() < 1e-5


def test_balances_with_approach_damping() -> None:
    """max(0, −ḋ) has a kink, so its order is lower; it takes energy out and never puts any in."""
    field = CUBIC | {"approach_damping": 0.7}
    keys = {"controller.field": field, "simulation.control": "continuous"}
    coarse, fine = (vff.simulate("sweep-through", {**keys, "simulation.dt": dt}) for dt in (4e-3, 1e-3))
    assert fine.power[:, 4].max() <= 0 and fine.power[:, 4].min() < -1e-3
    assert max(defects(fine)) < max(defects(coarse)) / 4 < 1e-5


def test_sliding_exchanges_energy_with_the_obstacle_alone() -> None:
    """(T82) stands on the velocity, so the ports there are account for all of it."""
    free, slid = (
        vff.simulate(
            "head-on", {"controller.field": CUBIC | {"sliding": s}, "simulation.control": "continuous"}
        )
        for s in (0.0, 80.0)
    )
    assert np.abs(free.q - slid.q).max() > 0.1
    assert max(defects(slid)) < 1e-6


def test_signs_of_the_ports() -> None:
    """Damping takes; an obstacle that closes in gives; the kinetic energy is that of the matrices."""
    result = vff.simulate("sweep-through")
    names = dict(zip(vff.PORTS, result.power.T, strict=True))
    assert names["damping"].max() <= 0 and names["obstacles"].max() > 0.01
    assert (names["scaling"] == 0).all() and (names["approach"] == 0).all()
    for i in range(0, len(result.t), 400):
        q, dq = result.q[i], result.dq[i]
        mass = result.scenario.arm.mass_matrix(q)
        assert result.energy[i, 0] == pytest.approx(dq @ mass @ dq / 2, rel=1e-9, abs=1e-15)
        assert names["actuators"][i] == pytest.approx(dq @ result.tau[i], abs=1e-12)


def test_what_torque_limits_take_is_accounted_for() -> None:
    """Their port closes the balance of a run in which they act."""
    keys = {"arm.torque_limits": 3.0, "simulation.control": "continuous", "simulation.dt": 5e-4}
    result = vff.simulate("sweep-through", {**keys, "controller.field.gain": 2.0})
    assert result.metrics.limited_steps > 50
    assert np.abs(result.power[:, 5]).max() > 1e-4
    assert max(defects(result)) < 1e-4


class TestTank:
    """A disc sweeps through; the tank is small."""

    @staticmethod
    def run(**tank: float) -> vff.Result:
        keys: dict[str, Any] = {"controller.null_damping": 0.5, "controller.field.gain": 1.0}
        return vff.simulate("sweep-through", keys | ({"controller.tank": tank} if tank else {}))

    def test_a_large_tank_changes_nothing(self) -> None:
        free, large = self.run(), self.run(capacity=1e6)
        assert np.abs(large.q - free.q).max() < 1e-9
        assert free.tank is None

    def test_level_follows_the_balance(self) -> None:
        """Its level falls by what repulsion injects and rises by what damping takes, between 0 and full."""
        result = self.run(capacity=2.0, initial=1.0)
        assert 0 <= result.tank.min() and result.tank.max() <= 2.0
        assert result.tank[0] == 1.0
        assert np.ptp(result.tank) > 1e-3

    def test_an_empty_tank_weakens_but_never_stops_avoidance(self) -> None:
        free, empty = self.run(), self.run(capacity=0.5, initial=0.0, floor=0.3)
        assert empty.power[:, 5].min() < -1e-3
        assert empty.power[:, 5].max() <= 0
        assert (
            empty.energy[:, 0].max() < 0.9 * free.energy[:, 0].max()
        )  # the tip is held: all of it null motion
        assert empty.status == "completed" and empty.metrics.min_clearance > 0.1
        assert empty.metrics.max_null_acceleration < 1e-10

    def test_repulsion_is_whole_while_it_slows_an_approach(self) -> None:
        """With an empty tank: all of it against a link that comes nearer, the floor on the way out."""
        arm = vff.Arm.uniform(4)
        q = np.array([0.4, -0.7, 0.9, -0.5])
        disc = vff.Obstacle.circle(arm.forward_kinematics(q)[2] + [0.0, 0.5], 0.2)
        settings = {"field": {"kind": "khatib", "gain": 1.0, "influence": 1.0}}
        tank = {"tank": {"capacity": 0.1, "initial": 0.0, "floor": 0.25}}
        free, empty = vff.Controller(arm, settings), vff.Controller(arm, settings | tank)

        def avoidance(controller: vff.Controller, dq: np.ndarray) -> np.ndarray:
            with_disc = controller.terms(q, dq, [2.0, 1.0], obstacles=[disc])
            return with_disc.tau_null - controller.terms(q, dq, [2.0, 1.0]).tau_null

        push = free.terms(q, np.zeros(4), [2.0, 1.0], obstacles=[disc])
        away = push.N @ np.linalg.solve(arm.mass_matrix(q), push.tau_vff)
        away /= np.linalg.norm(away)
        np.testing.assert_allclose(avoidance(empty, -away), avoidance(free, -away), atol=1e-10)
        np.testing.assert_allclose(avoidance(empty, away), 0.25 * avoidance(free, away), atol=1e-10)


@pytest.mark.parametrize("limit", ["joint_limits", "velocity_limits"])
def test_what_the_program_of_limits_changes_is_accounted_for(limit: str) -> None:
    """Where joints come to their stops, or to half of the speeds that they would have."""
    scene = vff.Scenario.load("sweep-through").replace(**{"simulation.control": "continuous"})
    free = vff.simulate(scene)
    low = np.minimum(free.q.min(axis=0) + 0.1, free.q[0] - 0.03)
    given = {
        "joint_limits": np.stack([low, free.q.max(axis=0) + 0.5], axis=1).tolist(),
        "velocity_limits": (0.5 * np.abs(free.dq).max(axis=0)).tolist(),
    }
    result = vff.simulate(scene, {f"arm.{limit}": given[limit]})
    assert np.abs(result.power[:, 5]).max() > 1.0  # W: it does something
    assert result.metrics.passivity_residual < 1e-4 * result.energy[:, 2].max()


def test_a_tank_fills_with_what_damping_takes_out_alone() -> None:
    """Where torque limits leave little of it, as well as where they leave it all."""
    q0 = [0.5, 0.6, -0.4, -0.8]
    scene = {
        "duration": 2.0,
        "q0": q0,
        "arm": {"lengths": [0.5] * 4, "masses": 3.0},
        "reference": {"kind": "setpoint", "point": [1.0, 1.0]},
        "controller": {
            "null_damping": 8.0,
            "stiffness": 1e-3,
            "damping": 0.2,
            "tank": {"capacity": 100.0, "initial": 0.0},
        },
    }
    arm = vff.Scenario.from_dict(scene).arm
    still = np.linalg.svd(np.array(arm.jacobian(q0)))[2][-1]  # moves the links and not the tip
    scene |= {"dq0": (1.5 * still).tolist()}
    scene["reference"] = {"kind": "setpoint", "point": [float(x) for x in arm.pose(q0)[0]]}
    for torque in (0.3, 1e4):
        result = vff.simulate(scene, {"arm.torque_limits": torque})
        taken = -np.trapezoid((result.tau * result.dq).sum(axis=1), result.t)
        assert taken > 0.1
        np.testing.assert_allclose(result.tank[-1], taken, rtol=0.02)
