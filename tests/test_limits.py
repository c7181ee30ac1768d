"""Limits: what is given up, in which order, and what holds on (docs/theory.md, T35 to T38)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import ScenarioError

PAPER = ["paper-1", "paper-1-ramp", "paper-2", "paper-2-moving", "paper-2-printed"]
POSTURE = {"controller.posture": [0.0] * 6, "controller.posture_stiffness": 20.0}


def run(name: str, **keys: Any) -> vff.Result:
    return vff.simulate(name, {key.replace("__", "."): value for key, value in keys.items()})


@pytest.mark.parametrize("limit", [2.0, 20.0, 100.0])
@pytest.mark.parametrize("control", ["hold", "continuous", "predictor"])
def test_torque_stays_within_its_limits(limit: float, control: str) -> None:
    keys = {"arm.torque_limits": limit, "simulation.control": control, "duration": 8.0}
    result = vff.simulate("paper-1", keys)
    assert np.abs(result.tau).max() <= limit * (1 + 1e-12)
    assert np.abs(result.tau).max() == pytest.approx(limit)
    assert result.metrics.torque_limit_ratio <= 1 + 1e-12
    assert result.metrics.limited_steps == np.count_nonzero((result.objective_scale < 1).any(axis=1))
    assert result.metrics.limited_steps > 0
    np.testing.assert_allclose(result.tau_task + result.tau_null, result.tau, atol=1e-12 * limit)


def test_objectives_are_given_up_as_far_as_that_helps() -> None:
    """Two after the other, and none that pushes no joint beyond its limit."""
    keys = {"arm.torque_limits": 6.0, "arm.gravity": 0.0, "duration": 8.0, **POSTURE}
    result = vff.simulate("paper-1", keys)
    shares = result.objective_scale[:, :5]
    task = shares[:, 1] < shares[:, 4]
    assert (shares[:, 0] == 0).any() and (task & (shares[:, 0] == 0)).sum() > 100
    # what is held back as a whole, too
    assert (shares.max(axis=1) == shares[:, 4]).all()


@pytest.mark.parametrize("share", [0.5, 0.7, 0.9])
@pytest.mark.parametrize("name", ["sweep-through", "narrow-gap", "head-on"])
def test_torque_changes_by_less_in_shorter_periods(name: str, share: float) -> None:
    """It does not jump where a limit is reached, or where an objective turns round that is being given up."""
    scenario = vff.Scenario.load(name)
    free = vff.simulate(scenario, {"controller.enforce_limits": False})
    limits = share * np.abs(free.tau).max(axis=0)
    changes = []
    for dt in (1e-3, 2.5e-4, 6.25e-5):
        keys = {"arm.torque_limits": limits.tolist(), "simulation.dt": dt, "simulation.record_every": 1}
        result = vff.simulate(scenario, keys)
        assert result.metrics.limited_steps * dt > 0.1
        changes.append((np.abs(np.diff(result.tau[1:], axis=0)) / limits).max())
    assert changes[-1] < 0.2 and changes[-1] < 0.5 * changes[0], changes


def test_the_task_keeps_its_direction() -> None:
    """With the share s of the task, the end effector accelerates by s ẍ_c: slower, not elsewhere (T35)."""
    result = run("paper-1", arm__torque_limits=20.0)
    arm = result.scenario.arm
    shares = result.objective_scale
    partly = np.flatnonzero((shares[:, 1] < 0.999) & (shares[:, [0, 2, 3, 4]] == 1).all(axis=1))
    assert len(partly) > 100
    for i in partly[::20]:
        q, dq = result.q[i], result.dq[i]
        ddq = arm.forward_dynamics(q, dq, result.tau[i])
        ddx = arm.jacobian(q) @ ddq + arm.jacobian_dot(q, dq) @ dq
        wanted = -8.0 * result.dx[i] - 16.0 * result.error[i]
        np.testing.assert_allclose(ddx, shares[i, 1] * wanted, atol=1e-8)


def test_limits_that_are_not_reached_change_nothing() -> None:
    free = run("sweep-through")
    held = run("sweep-through", arm__torque_limits=1e6, arm__velocity_limits=1e6)
    assert (held.objective_scale == 1).all() and held.metrics.limited_steps == 0
    assert free.objective_scale is None and free.metrics.limited_steps is None
    np.testing.assert_array_equal(held.q, free.q)


def test_limits_can_be_ignored() -> None:
    free = run("paper-1", duration=2.0)
    keys = {"arm__torque_limits": 20.0, "arm__velocity_limits": 0.5, "controller__enforce_limits": False}
    ignored = run("paper-1", duration=2.0, **keys)
    np.testing.assert_array_equal(ignored.tau, free.tau)
    assert ignored.objective_scale is None
    assert ignored.metrics.torque_limit_ratio == pytest.approx(free.metrics.peak_torque / 20.0)
    assert ignored.metrics.velocity_limit_ratio == pytest.approx(free.metrics.peak_speed / 0.5)


@pytest.mark.parametrize("limit", [0.2, 0.5, 1.0, 2.0])
def test_joint_speeds_stay_within_their_limits(limit: float) -> None:
    """A step of 2.4 m: the reference is slowed down, then reached (T36, T37, T153)."""
    free = run("paper-1")
    result = run("paper-1", arm__velocity_limits=limit)
    assert free.metrics.peak_speed > 6
    assert result.metrics.velocity_limit_ratio < 1.001
    assert result.objective_scale[:, 5].min() < 0.5
    assert result.metrics.max_null_acceleration < 1e-10
    if limit >= 0.5:
        assert result.metrics.max_error_tail < 1e-9


@pytest.mark.filterwarnings("ignore:the torque chatters")
@pytest.mark.parametrize(
    ("name", "changes"),
    [
        (
            "panda-cup",
            {"controller.self_collision": "avoid"},
        ),  # 2.7 times the limit of its wrist
        ("ur5e-sweep", {"controller.self_collision": "avoid"}),  # 6.0
        ("ur5e-crossed", {}),  # 4.6 with `priority`, 2.5 with `relaxed`
        ("panda-shelf", {}),  # 1.7 with `relaxed`
    ],
)
@pytest.mark.parametrize("way", ["null_space", "relaxed", "priority"])
def test_no_push_is_too_hard_for_a_light_wrist(way: str, name: str, changes: dict[str, Any]) -> None:
    """The hand is disturbed last: by no more than 0.1 mm where nothing else moves it (T153)."""
    result = vff.simulate(name, changes | {"controller.avoidance": way})
    assert result.metrics.velocity_limit_ratio < 1.001
    assert result.metrics.torque_limit_ratio <= 1 + 1e-12
    if way == "null_space":
        assert result.metrics.max_error_transient < 2e-4


def test_both_limits_at_once() -> None:
    result = run("paper-1", arm__velocity_limits=1.0, arm__torque_limits=10.0)
    assert result.status == "completed"
    assert np.abs(result.tau).max() <= 10 * (1 + 1e-12)
    assert result.metrics.max_error_tail < 1e-6


LIMIT_FIELD = {"kind": "khatib", "gain": 0.02, "influence": 0.3}


def test_joint_limits_repel_in_the_null_space() -> None:
    """Null motion that would pass a limit stops before it, and the end effector feels nothing (T38)."""
    ranges = [[-3.2, 3.2]] * 2 + [[-1.0, 3.2]] + [[-3.2, 3.2]] * 3
    keys = {"arm.joint_limits": ranges, "plant.joint_stops": False, "controller.enforce_limits": False}
    free = vff.simulate("paper-2", keys)
    held = vff.simulate("paper-2", {**keys, "controller.joint_limit_field": LIMIT_FIELD})
    assert free.metrics.joint_limit_violation > 0.05
    assert held.metrics.joint_limit_violation == 0
    assert held.metrics.max_error_tail == pytest.approx(free.metrics.max_error_tail, abs=1e-9)
    assert held.metrics.max_null_acceleration < 1e-10


def gradient(controller: vff.Controller, q: np.ndarray, h: float = 1e-6) -> np.ndarray:
    """∂U/∂q of everything that is stored in the null space at rest, by central differences."""

    def stored(at: np.ndarray) -> float:
        return float(controller.terms(at, np.zeros_like(at), [1.0, 1.0]).energy[2])

    return np.array([(stored(q + step) - stored(q - step)) / (2 * h) for step in h * np.eye(len(q))])


def test_joint_limit_torque_is_the_slope_of_its_potential() -> None:
    arm = vff.Arm([1.0] * 4, 1.0, joint_limits=[-1.5, 1.5])
    controller = vff.Controller(arm, {"joint_limit_field": LIMIT_FIELD | {"influence": 0.6}})
    q = np.array([1.2, -1.3, 0.5, 1.45])
    terms = controller.terms(q, np.zeros(4), [1.0, 1.0])
    expected = -terms.N.T @ gradient(controller, q)
    assert np.abs(expected).max() > 0.1
    np.testing.assert_allclose(terms.tau_null, expected, rtol=1e-5, atol=1e-6)


def test_self_repulsion_is_the_slope_of_its_potential() -> None:
    """Folded arms, links near each other and links that cross; neighbours do not count."""
    field = {"kind": "khatib", "gain": 0.05, "influence": 0.7}
    arm = vff.Arm([1.0, 0.8, 0.9, 0.7], 1.0, radius=0.03)
    controller = vff.Controller(arm, {"field": field, "self_collision": "avoid"})
    for q in ([0.1, 1.9, 1.5, 0.4], [0.0, 2.2, 2.0, 0.9], [0.3, -2.3, -2.3, -1.0]):
        angles = np.array(q)
        terms = controller.terms(angles, np.zeros(4), [1.0, 1.0])
        assert np.abs(terms.tau_vff).max() > 1e-3
        np.testing.assert_allclose(terms.tau_vff, -gradient(controller, angles), rtol=1e-4, atol=1e-5)
    assert controller.terms([0.0, 2.2, 2.2, 2.0], np.zeros(4), [1.0, 1.0]).self_clearance < 0


@pytest.mark.parametrize("name", PAPER)
def test_the_paper_s_scenarios_with_self_collision(name: str) -> None:
    """In its second scenario links cross; where they repel each other they do not."""
    reported = run(name, controller__self_collision="report")
    avoided = run(name, controller__self_collision="avoid")
    plain = run(name)
    np.testing.assert_array_equal(reported.q, plain.q)
    assert plain.self_clearance is None and plain.metrics.min_self_clearance is None
    crossed = reported.metrics.self_collision_time is not None
    assert crossed == (reported.metrics.min_self_clearance <= 0) == name.startswith("paper-2")
    assert reported.metrics.min_self_clearance == reported.self_clearance.min()
    assert avoided.metrics.min_self_clearance > 0.3
    assert avoided.metrics.max_null_acceleration < 1e-10


@pytest.mark.parametrize(
    ("keys", "path", "words"),
    [
        ({"controller.joint_limit_field": LIMIT_FIELD}, "controller.joint_limit_field", "arm.joint_limits"),
        ({"arm.velocity_limits": 1.0, "controller.damping": 0.0}, "controller.damping", "velocity_limits"),
        ({"arm.velocity_limits": [1.0] * 5}, "arm.velocity_limits", "6"),
        ({"arm.velocity_limits": -1.0}, "arm.velocity_limits", "greater than 0"),
        ({"controller.self_collision": "yes"}, "controller.self_collision", "avoid"),
        ({"controller.tank": {"capacity": 0.0}}, "controller.tank.capacity", "greater than 0"),
        ({"controller.tank": {"capacity": 1.0, "floor": 0.0}}, "controller.tank.floor", "at most 1"),
        ({"controller.tank": {"capacity": 1.0, "initial": 2.0}}, "controller.tank.initial", "capacity 1"),
        (
            {"controller.tank": {"capacity": 1.0}, "simulation.control": "continuous"},
            "controller.tank",
            "hold",
        ),
    ],
)
def test_bad_limits(keys: dict[str, Any], path: str, words: str) -> None:
    with pytest.raises(ScenarioError, match=words) as caught:
        vff.simulate("paper-1", keys)
    assert caught.value.path == path
