"""The laws that let the end effector give way: an obstacle on its own path, limits, continuity, slack."""

from __future__ import annotations

import copy
import pickle
from functools import cache
from typing import Any

import numpy as np
import pytest

import vffnull as vff

LAWS = ("relaxed", "priority", "cbf")


@cache
def run(name: str, avoidance: str, dt: float = 1e-3) -> vff.Result:
    return vff.simulate(name, {"controller.avoidance": avoidance, "simulation.dt": dt})


def errors(result: vff.Result) -> Any:
    return np.linalg.norm(result.error, axis=1)


@pytest.mark.parametrize("avoidance", LAWS)
def test_on_path_is_avoided_and_the_path_taken_up_again(avoidance: str) -> None:
    """The null-space law drives 0.23 m deep into the disc. Each of the three clears it and is back within
    1e-5 m at the end."""
    assert run("on-path", "null_space").metrics.min_clearance < -0.2
    result = run("on-path", avoidance)
    assert result.status == "completed"
    assert errors(result)[-1] < 1e-5
    least = {"relaxed": 0.1, "priority": 0.019, "cbf": 0.019}[avoidance]
    assert result.metrics.min_clearance > least  # type: ignore[operator]


def test_cbf_gives_way_less_than_the_others() -> None:
    """It changes the task only as far as the distance demands."""
    deviation = {law: errors(run("on-path", law)).max() for law in LAWS}
    assert deviation["cbf"] < 0.6 < deviation["priority"] < deviation["relaxed"]


@pytest.mark.parametrize("name", ["sweep-through", "narrow-gap"])
@pytest.mark.parametrize("avoidance", ["priority", "cbf"])
def test_where_the_null_space_suffices_the_tip_does_not_notice(name: str, avoidance: str) -> None:
    """The end effector stays within a millimetre of its reference."""
    assert errors(run(name, avoidance)).max() < 1e-3


@pytest.mark.parametrize(("name", "bound"), [("on-path", 1.0), ("on-path-moving", 3.0)])
@pytest.mark.parametrize("avoidance", LAWS)
def test_the_torque_is_continuous(avoidance: str, name: str, bound: float) -> None:
    """A torque that is continuous in time changes half as much from step to step at half the step; one that
    jumps by J changes by J however short the step. No step of 0.25 ms changes it by more than 1 N·m beside a
    disc at rest, and 3 N·m beside one that moves."""
    coarse, fine = (np.abs(np.diff(run(name, avoidance, dt).tau, axis=0)).max() for dt in (5e-4, 2.5e-4))
    assert fine < bound
    assert fine == pytest.approx(coarse / 2, rel=0.05)


def test_without_anything_near_all_laws_are_one() -> None:
    """Far from obstacles, and with a small error, nothing gives way: the same torque to the last digit."""
    q, dq = [1.2, -0.6, -0.6, -0.5, 0.3, 0.4], [0.1, 0.2, -0.1, 0.0, 0.3, -0.2]
    disc = vff.Obstacle.circle([-4.0, -4.0], 0.3)
    arm = vff.Arm.uniform(6)
    torques = [
        vff.Controller(arm, {"avoidance": law}).torque(q, dq, [5.0, 1.1], obstacles=[disc])
        for law in ("null_space", *LAWS)
    ]
    for torque in torques[1:]:
        assert np.array_equal(torque, torques[0])


def test_the_torque_of_the_programme_is_the_nearest_one() -> None:
    """One row that acts and nothing else: min ½yᵀHy + ½ρσ² with a·y + σ ≥ b has
    y = H⁻¹a b/(aᵀH⁻¹a + 1/ρ), here from matrices and `distances`."""
    arm = vff.Arm.uniform(6)
    q, dq = np.array([1.2, -0.6, -0.6, -0.5, 0.3, 0.4]), np.array([0.1, 0.4, -0.2, 0.3, 0.1, -0.4])
    tip = arm.forward_kinematics(q)[-1]
    disc = vff.Obstacle.circle([tip[0] + 0.1, tip[1] + 0.45], 0.3, motion=vff.Motion.linear([0.0, -1.0]))
    settings = {"yielding": {"activation": 0.2, "speed": 1e6}}
    reference = [tip[0], tip[1] + 0.05]
    nominal = vff.Controller(arm, settings).torque(q, dq, reference, obstacles=[disc])
    terms = vff.Controller(arm, {**settings, "avoidance": "cbf"}).terms(q, dq, reference, obstacles=[disc])

    pairs = vff.distances(arm, q, dq, [disc])
    near = pairs.distance < 0.2
    assert near.sum() == 1
    (a,), (d,), (rate,), (bias,) = (
        each[near] for each in (pairs.gradient, pairs.distance, pairs.rate, pairs.bias)
    )
    k, weight, price = 40.0, 20.0, 4e4
    (normal,) = pairs.normal[near]
    axis = np.diff(arm.forward_kinematics(q)[-2:], axis=0)[0]
    assert abs(normal @ axis) > 0.2  # clear of the end of the link, where the sliding term fades
    ddq = arm.forward_dynamics(q, dq, nominal)
    b = -(a @ ddq + bias + 2 * k * rate + k * k * (d - 0.02))
    assert b > 1.0
    M, J = arm.mass_matrix(q), arm.jacobian(q)
    N = arm.extended_jacobian(q, dq).N
    H = weight * J.T @ J + N.T @ M @ N
    solved = np.linalg.solve(H, a)
    y = solved * b / (a @ solved + 1 / price)
    np.testing.assert_allclose(terms.tau, nominal + M @ y, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(terms.tau_task + terms.tau_null, terms.tau, rtol=1e-12)
    assert terms.slack == pytest.approx(b - a @ y, rel=1e-6)


def limited(**limits: Any) -> vff.Result:
    scenario = vff.Scenario.load("on-path").to_dict()
    scenario["arm"].update(limits)
    scenario["controller"]["avoidance"] = "cbf"
    scenario["simulation"]["record_every"] = 10
    return vff.simulate(scenario)


def test_cbf_keeps_the_limits_of_the_joints() -> None:
    """Angles, speeds and torques that the same run exceeds without limits."""
    free = run("on-path", "cbf")
    assert np.abs(free.q[:, 1:]).max() > 2.2
    angles = limited(joint_limits=[[-4.0, 4.0]] + [[-2.2, 2.2]] * 5)
    assert angles.status == "completed"
    assert angles.metrics.joint_limit_violation < 1e-3  # type: ignore[operator]

    assert free.metrics.peak_speed > 3.0  # type: ignore[operator]
    slow = limited(velocity_limits=2.0)
    assert slow.metrics.velocity_limit_ratio < 1.001  # type: ignore[operator]
    assert slow.metrics.min_clearance > 0.019  # type: ignore[operator]

    assert free.metrics.peak_torque > 60.0  # type: ignore[operator]
    weak = limited(torque_limits=60.0)
    assert weak.metrics.torque_limit_ratio < 1.0 + 1e-9  # type: ignore[operator]


def test_what_cannot_be_kept_is_slack_not_an_exception() -> None:
    """A link between two discs that close in on it: the rows contradict each other, and the run goes on."""
    pincer = vff.Scenario(
        arm=vff.Arm.uniform(2),
        q0=[0.0, 0.0],
        duration=1.0,
        controller=vff.ControlSettings(avoidance="cbf"),
        reference={"kind": "setpoint", "point": [2.0, 0.0]},
        obstacles=[
            vff.Obstacle.circle([0.6, y], 0.2, motion=vff.Motion.linear([0.0, -0.3 * np.sign(y)]))
            for y in (0.4, -0.4)
        ],
    )
    result = vff.simulate(pincer)
    assert result.status == "collided" and result.t[-1] == 1.0
    assert result.metrics.max_slack > 10.0  # type: ignore[operator]
    assert result.metrics.slack_steps > 100  # type: ignore[operator]
    assert result.slack.shape == result.t.shape
    assert result.slack.max() == pytest.approx(result.metrics.max_slack)
    assert result.slack[0] == 0.0


def test_metrics_that_do_not_apply_are_none() -> None:
    """Slack belongs to barriers, and is less than 1 % of the k²δ that hold a contact; the energy balance is
    that of the null-space law alone."""
    null_space, relaxed, cbf = (run("on-path", law).metrics for law in ("null_space", "relaxed", "cbf"))
    assert null_space.max_slack is None and null_space.slack_steps is None
    assert relaxed.max_slack is None and relaxed.passivity_residual is None
    assert null_space.passivity_residual is not None
    assert cbf.max_slack < 0.01 * 40.0**2 * 0.02 and cbf.slack_steps == 0  # type: ignore[operator]
    assert run("on-path", "relaxed").slack is None


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("margin", 0.0, "greater than 0"),
        ("outer", 0.05, "greater than inner"),
        ("inner", -0.1, "0 or more"),
        ("slack_weight", -1.0, "greater than 0"),
        ("speeed", 1.0, "speed"),
    ],
)
def test_wrong_settings_are_named(key: str, value: float, words: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=words) as caught:
        vff.ControlSettings(avoidance="cbf", yielding={key: value})
    assert "yielding" in str(caught.value)


def test_a_link_along_a_flat_side_stays_off() -> None:
    """Bodies at rest, an escape is known, and the programme has hardly any slack: no contact is needed.
    With one barrier per pair, on the nearest point, the link was hit, 13 mm deep."""
    result = vff.simulate(vff.scenes.random("clutter", 6, 71), {"controller.avoidance": "cbf"})
    assert result.slack is not None and result.slack.max() < 1.0
    assert result.metrics.min_clearance > -1e-3  # type: ignore[operator]


def test_speed_limits_do_not_hold_up_an_arm_that_gives_way() -> None:
    """An arm with slow joints follows a line past bodies that move.

    While the reference was slowed down beside the QP, whose rows keep the speeds, the arm fell behind, was
    hit and turned at 2.4 times its limit.
    """
    result = vff.simulate(
        {
            "duration": 2.0,
            "q0": [1.3, -0.5, -0.5, -0.4, -0.1, 0.1, 0.3],
            "arm": {
                "lengths": [0.8] * 7,
                "masses": [0.6, 0.5, 0.7, 0.6, 0.5, 0.4, 0.3],
                "radius": 0.03,
                "gravity": 9.81,
                "joint_limits": [-2.0, 2.0],
                "velocity_limits": 1.5,
                "torque_limits": 60.0,
            },
            "controller": {
                "task": "pose",
                "stiffness": 100,
                "damping": 20,
                "null_damping": 6,
                "avoidance": "cbf",
                "field": {"kind": "cubic", "gain": 0.3, "influence": 0.6},
            },
            "reference": {"kind": "line", "end": [4.0, 2.2, 0.2], "duration": 2.0},
            "obstacles": [
                {
                    "shape": {"kind": "capsule", "a": [-0.2, 0.0], "b": [0.2, 0.1], "radius": 0.1},
                    "position": [1.9, 3.0],
                    "motion": {"kind": "linear", "velocity": [0.0, -0.45]},
                },
                {"shape": {"kind": "box", "size": [0.7, 0.5]}, "position": [3.4, 0.1], "angle": 0.3},
            ],
        }
    )
    assert result.status == "completed"
    assert result.metrics.velocity_limit_ratio < 1.01  # type: ignore[operator]
    assert result.metrics.min_clearance > 0.019  # type: ignore[operator]


@pytest.mark.parametrize(
    "tables",
    [
        {"avoidance": "cbf", "yielding": {"margin": 0.03, "preview": {"horizon": 1.4}}},
        {"governor": {}},
        {"tank": {"capacity": 1.0}, "field": vff.Field.khatib(0.5, 0.6)},
    ],
    ids=["yielding", "governor", "tank"],
)
def test_settings_with_tables_can_be_used(tables: dict[str, Any]) -> None:
    """They stay what was given, in documents, controllers and scenarios, and nobody can change them."""
    settings = vff.ControlSettings(stiffness=100, damping=20, null_damping=6, **tables)
    same = vff.ControlSettings(stiffness=100, damping=20, null_damping=6, **tables)
    assert settings == same and hash(settings) == hash(same) and copy.deepcopy(settings) == settings
    assert pickle.loads(pickle.dumps(settings)) == settings
    for name, value in tables.items():
        if isinstance(value, dict):
            assert settings.to_dict()[name] == value == getattr(settings, name)
            assert f"{name}={value!r}" in repr(settings)
            with pytest.raises(TypeError):
                getattr(settings, name)["margin"] = 1.0
    vff.Controller(vff.Arm.uniform(6), settings)
    scenario = vff.Scenario.load("sweep-through").replace(duration=0.01, controller=settings)
    assert scenario["controller"] == settings.to_dict()
    assert vff.simulate(scenario).status == "completed"


def test_slack_is_that_of_the_torque_that_is_sent() -> None:
    """In predictor mode that of the law in the middle of the period, as one that is asked there says."""
    arm = vff.Arm.uniform(3)
    start = [0.5, 0.6, 0.7]
    scenario = vff.Scenario.from_dict(
        {
            "duration": 3.0,
            "q0": start,
            "arm": arm.to_dict(),
            "reference": {"kind": "setpoint", "point": arm.forward_kinematics(start)[-1].tolist()},
            "controller": {
                "stiffness": 100.0,
                "damping": 20.0,
                "null_damping": 6.0,
                "avoidance": "cbf",
                "yielding": {"margin": 0.1, "rate": 5.0, "slack_weight": 50.0},
                "deadline": "unlimited",
            },
            "simulation": {"control": "predictor", "control_every": 30, "record_every": 1},
            "obstacles": [
                {
                    "shape": {"kind": "circle", "radius": 0.2},
                    "position": [2.6, 1.0],
                    "motion": {"kind": "linear", "velocity": [-0.6, 0.4]},
                }
            ],
        }
    )
    run, law = vff.simulate(scenario), vff.Controller(scenario.arm, scenario["controller"])

    def asked(i: int) -> float:
        state = run.q[i], run.dq[i], run.x_ref[i]
        slack = law.terms(*state, obstacles=scenario["obstacles"], t=run.t[i]).slack
        assert slack is not None
        return slack

    begins = range(0, len(run.t) - 30, 30)
    recorded, begin, middle = (
        np.array([of(i) for i in begins]) for of in (lambda i: run.slack[i], asked, lambda i: asked(i + 15))
    )
    changes = np.abs(middle - begin) > 0.01
    assert changes.sum() > 20
    off = np.abs(recorded - middle)[changes] / np.abs(middle - begin)[changes]
    assert np.median(off) < 0.1
