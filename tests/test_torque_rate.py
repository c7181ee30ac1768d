"""What is sent changes no faster than drives allow, and other limits hold (T130–T134, T176, T200)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import vffnull as vff
from matrix import kept_apart
from vffnull.evaluation import scenes

pytestmark = pytest.mark.filterwarnings("ignore:the torque chatters")  # some are driven hard here
IN_SPACE = [name for name in vff.scenarios() if "model" in vff.Scenario.load(name)["arm"]]
WAYS = ("null_space", "relaxed", "priority", "cbf")
RATES = (300.0, 400.0, 1000.0)  # N·m/s; the last is a Franka's


def behind_a_rate(scene: str | vff.Scenario, rate: float, changes: dict[str, Any]) -> vff.Result:
    """A run behind a torque rate, every step of it recorded, and that no limit was exceeded on the way."""
    command = {"controller.command.torque_rate": rate, "simulation.record_every": 1}
    result = vff.simulate(scene, command | changes)
    arm = result.scenario.arm
    sent = result.tau_applied
    assert sent is not None and np.isfinite(sent).all()
    if changes.get("controller.command.gravity") == "robot":
        sent = sent - np.array([arm.gravity_torque(q) for q in result.q])
    period = np.diff(result.t).max() * changes.get("simulation.control_every", 1)
    assert np.abs(np.diff(sent, axis=0)).max() <= rate * period * (1 + 1e-9)
    if arm.torque_limits is not None:
        assert (np.abs(sent) <= arm.torque_limits * (1 + 1e-9)).all()
    if arm.velocity_limits is not None:
        assert (np.abs(result.dq) <= (1.01 if rate >= 1000 else 1.02) * arm.velocity_limits).all()
    if arm.joint_limits is not None and result.status == "completed":
        assert result.metrics["joint_limit_time"] is None
    return result


@pytest.mark.parametrize(
    ("arm", "task", "seed"),
    [("ur5e", "position", 524), ("iiwa14", "pose", 558), ("ur5e", "position", 546)],
)
@pytest.mark.parametrize("way", ["priority", "cbf"])
def test_joints_brake_at_the_same_time(arm: str, task: str, seed: int, way: str) -> None:
    """All joints of an arm that is hit come to their largest speeds at once, one to 1.16 without (T176)."""
    scene = scenes.in_space("crowd", arm, task, seed)
    behind_a_rate(scene, 1000.0, {"controller.avoidance": way})


@pytest.mark.parametrize(("n", "seed"), [(6, 1), (10, 2), (10, 4)])
@pytest.mark.parametrize("way", ["null_space", "cbf"])
def test_long_arms_come_to_their_stops_in_time(n: int, seed: int, way: str) -> None:
    """A torque does hundreds of times to one joint what it may where others stay: all hit a stop (T200)."""
    draw = np.random.default_rng(seed)
    lengths, masses, q0 = draw.uniform(0.3, 1, n), draw.uniform(0.3, 2, n), draw.uniform(-0.9, 0.9, n)
    weights = [9.81 * (masses[i:] * np.cumsum(lengths[i:])).sum() for i in range(n)]
    arm = vff.Arm(
        lengths,
        masses,
        gravity=9.81,
        torque_limits=[4 * weight + 2 for weight in weights],
        velocity_limits=[2.0] * n,
        joint_limits=[[q - 0.3, q + 0.3] for q in q0],
    )
    assert arm.torque_limits is not None and arm.joint_limits is not None and arm.velocity_limits is not None
    command = {"torque_rate": list(8 * arm.torque_limits)}
    goal = 0.6 * arm.forward_kinematics(q0)[-1]
    result = vff.simulate(
        vff.Scenario(
            arm=arm,
            q0=list(q0),
            duration=2.0,
            controller=vff.ControlSettings(
                stiffness=100.0, damping=20.0, null_damping=4.0, avoidance=way, command=command
            ),
            reference={"kind": "setpoint", "point": list(goal), "unreachable": "warn"},
            simulation={"dt": 0.001, "control": "hold", "integrator": "semi_implicit_euler"},
        )
    )
    left = np.minimum(result.q - arm.joint_limits[:, 0], arm.joint_limits[:, 1] - result.q)
    assert 0.0059 < left.min() < 0.007  # a hundredth of the range is kept, and no more
    assert (np.abs(result.dq) <= arm.velocity_limits).all()


@pytest.mark.parametrize("name", IN_SPACE)
@pytest.mark.parametrize("way", WAYS)
def test_no_limit_is_exceeded_in_bundled_scenes(name: str, way: str) -> None:
    """Torque, its rate and speed; and nothing is hit that is not hit without a rate, or by `cbf` at all."""
    free = vff.simulate(name, {"controller.avoidance": way})
    for rate in RATES:
        result = behind_a_rate(name, rate, {"controller.avoidance": way})
        if name == "panda-bump":  # what it does not see is hit
            continue
        least = kept_apart(result).min()
        if way == "cbf":
            assert result.status == "completed"
            assert least > 0.008
        elif way != "relaxed" and free.metrics["min_clearance"] > 0.02:
            assert least > 0.0


@pytest.mark.parametrize(
    ("family", "arm", "task", "seed"),
    [
        ("links-swept", "panda", "pose", 515),
        ("links-swept", "iiwa14", "position", 513),
        ("path-crossed", "panda", "position", 502),
        ("path-crossed", "panda", "position", 516),
        ("crowd", "panda", "pose", 511),
        ("crowd", "panda", "pose", 517),
    ],
)
@pytest.mark.parametrize("rate", [None, 1000.0], ids=["", "rate"])
def test_limits_spare_the_distances_of_priority(
    family: str, arm: str, task: str, seed: int, rate: float | None
) -> None:
    """Limits took what they had to from distances: all of these were hits behind the rate, most without."""
    changes = {"controller.avoidance": "priority"}
    scene = scenes.in_space(family, arm, task, scenes.TRAINING.start + seed)
    result = vff.simulate(scene, changes) if rate is None else behind_a_rate(scene, rate, changes)
    assert result.metrics["min_clearance"] > 0.0


@pytest.mark.parametrize(("arm", "seed"), [("iiwa14", 509), ("ur5e", 524)])
def test_the_look_ahead_knows_the_rate(arm: str, seed: int) -> None:
    """It took torque for something that changes at once, and began no search: all of these were hits."""
    scene = scenes.in_space("crowd", arm, "position", scenes.TRAINING.start + seed)
    ahead = {"controller.avoidance": "cbf", "controller.yielding.preview": {}}
    assert behind_a_rate(scene, 1000.0, ahead).metrics["min_clearance"] > 0.0


@pytest.mark.parametrize("seed", [4, 16, 23])
def test_a_task_that_pulls_takes_no_distance(seed: int) -> None:
    """A rate makes what a distance asks for small, not cheap: with torque to spare it is kept (T161)."""
    scene = scenes.in_space("links-swept", "ur5e", "pose", scenes.TRAINING.start + seed)
    result = behind_a_rate(scene, 1000.0, {"controller.avoidance": "cbf"})
    assert result.metrics["min_clearance"] > 0.01


@pytest.mark.parametrize(
    "changes",
    [
        {"measurement.velocity_noise": 0.002, "measurement.position_noise": 1e-5},
        {"measurement.delay": 0.004},
        {"plant.coulomb_friction": 1.0},
        {"simulation.control": "predictor"},
        {"simulation.dt": 0.004},
        {"simulation.dt": 0.0005, "simulation.control_every": 2},
        {"controller.command.gravity": "robot"},
        {"controller.command.tip_speed": 0.3},
        {"controller.command.tip_angular_speed": 0.5},
        {"controller.command.coulomb_friction": 0.8, "plant.coulomb_friction": 1.0},
        {"controller.tank": {"capacity": 2.0}},
        {"controller.observer": {}, "controller.touch": {"task": "reject"}, "plant.payload": {"mass": 0.7}},
        {"wrenches": [{"link": "tip", "force": [5.0, 5.0, -5.0], "start": 0.5}]},
        {
            "controller.observer": {"source": "measured", "bandwidth": 100.0},
            "controller.touch": {"task": "reject"},
            "wrenches": [
                {"link": "tip", "force": [5.0, 5.0, -5.0], "profile": {"kind": "ramp", "rise": 0.5}}
            ],
        },
        {
            "controller.observer": {"threshold": 0.5},
            "controller.touch": {"task": "reject", "null_space": "reject"},
            "plant.coulomb_friction": 0.5,
        },
        {"controller.self_collision": "avoid"},
        {"controller.yielding.preview": {}},
        {"controller.governor": {}},
        {"controller.projection": "none"},
        {"controller.formulation": "extended_jacobian"},
    ],
    ids=lambda changes: "+".join(changes),
)
@pytest.mark.parametrize("name", ["ur5e-crossed", "panda-pointing"])
def test_limits_hold_with_other_options(name: str, changes: dict[str, Any]) -> None:
    result = behind_a_rate(name, 1000.0, {"controller.avoidance": "cbf"} | changes)
    assert result.status == "completed"
    assert result.metrics["min_clearance"] > 0.0


@pytest.mark.parametrize("name", ["on-path", "sweep-through", "crowd"])
@pytest.mark.parametrize("way", WAYS)
def test_limits_hold_in_the_plane(name: str, way: str) -> None:
    changes: dict[str, Any] = {"controller.avoidance": way, "simulation.control": "hold"}
    changes |= {"arm.torque_limits": 60.0, "arm.velocity_limits": 3.0, "duration": 4.0, "simulation.dt": 1e-3}
    behind_a_rate(name, 2000.0, changes)


@pytest.mark.parametrize("way", ["relaxed", "priority"])
def test_ways_that_are_no_program_keep_the_torque_limits(way: str) -> None:
    """What gives way is added after the objectives are scaled: a joint of 150 N·m was sent 1664."""
    for name in IN_SPACE:
        result = vff.simulate(name, {"controller.avoidance": way, "controller.field.gain": 2000.0})
        limits = result.scenario.arm.torque_limits
        if limits is not None:
            assert (np.abs(result.tau) <= limits * (1 + 1e-9)).all()


def test_torque_limits_hold_beside_a_singularity() -> None:
    """The cost of the program is convex there, too: it was not, and 4 times the limit of a joint was sent."""
    scene = scenes.in_space("path-crossed", "ur5e", "pose", 1)
    result = vff.simulate(scene, {"controller.avoidance": "cbf", "simulation.record_every": 1})
    assert result.metrics["min_manipulability"] < 1e-4
    assert (np.abs(result.tau) <= result.scenario.arm.torque_limits * (1 + 1e-9)).all()


def test_a_rate_that_is_never_needed_changes_little() -> None:
    """With room to spare the three poles do what the two do."""
    free = vff.simulate("ur5e-crossed", {"simulation.record_every": 1})
    wide = behind_a_rate("ur5e-crossed", 1e7, {})
    assert wide.metrics["min_clearance"] == pytest.approx(free.metrics["min_clearance"], abs=2e-3)
    assert np.linalg.norm(wide.error[-1, :3]) < 1e-3


@pytest.mark.parametrize("avoidance", ["priority", "cbf"])
@pytest.mark.parametrize("dt", [1e-3, 5e-4])
def test_a_tip_that_is_braked_does_not_make_torques_go_to_and_fro(avoidance: str, dt: float) -> None:
    """A disc asks for more speed than the tip may have, and drives cannot brake it at once: what is across
    its way is bounded, too. With one plane along that, torques turned back 231 times at their full rate.
    """
    arm = {
        "lengths": [0.357, 0.353, 0.315, 0.530],
        "masses": [3.606, 2.124, 1.617, 1.818],
        "radius": 0.03,
        "gravity": [0.0, 0.0],
        "joint_limits": [[-3.5, 3.5], *[[-2.4, 2.4]] * 3],
        "velocity_limits": [3.0] * 4,
        "torque_limits": [223.7, 104.5, 45.6, 15.1],
    }
    result = vff.simulate(
        {
            "duration": 1.5,
            "q0": [-2.92637, -0.18048, -0.80792, 0.22312],
            "arm": arm,
            "reference": {"kind": "line", "end": [-1.1354, 0.3363], "duration": 1.0, "unreachable": "warn"},
            "controller": {
                "task": "position",
                "stiffness": 100.0,
                "damping": 20.0,
                "null_damping": 3.0,
                "avoidance": avoidance,
                "field": {"kind": "bounded", "gain": 40.0, "influence": 0.4},
                "command": {"torque_rate": [4470.0, 2090.0, 912.0, 302.0], "tip_speed": 0.4},
            },
            "obstacles": [
                {
                    "shape": {"kind": "circle", "radius": 0.1},
                    "position": [-1.01524, -0.6],
                    "motion": {"kind": "linear", "velocity": [0.40018, 0.65264]},
                }
            ],
            "simulation": {"dt": dt, "control": "hold", "record_every": 1},
        }
    )
    change = np.diff(result.tau, axis=0) / arm["torque_limits"]
    back = (change[1:] * change[:-1] < 0.0) & (np.minimum(abs(change[1:]), abs(change[:-1])) > 0.01)
    assert np.count_nonzero(back.any(axis=1)) <= 3
    assert result.metrics["tip_speed_ratio"] < 1.01
