"""No joint meets its stop or is too fast, whatever way gives way (docs/theory.md, T162 to T164)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff

pytestmark = pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")  # all are driven hard here
ARMS = ("panda", "iiwa14", "ur5e", "gen3", "xarm7")
WAYS = ("null_space", "relaxed", "priority", "cbf")
DRIVES = ("posture", "task", "ball")
SEEDS = range(8)


def angles(draw: np.random.Generator, arm: vff.Arm) -> NDArray[np.float64]:
    """Joint angles away from their stops and from singularities of the position (n)."""
    low, high = np.clip(np.array(arm.joint_limits), -3.0, 3.0).T
    while True:
        q = draw.uniform(low + 0.2 * (high - low), high - 0.2 * (high - low)).round(4)
        if np.linalg.svd(arm.jacobian(q)[:3], compute_uv=False)[-1] > 0.1:
            return q


def near_stops(name: str, drive: str, seed: int) -> dict[str, Any]:
    """A scene in which up to three joints have a stop near, and `drive` takes them beyond it.

    A posture drives through the null space, a task through the end effector, a ball pushes links aside.
    """
    draw = np.random.default_rng([seed, ARMS.index(name), DRIVES.index(drive)])
    arm = vff.Arm.named(name)
    q = angles(draw, arm)
    stops, beyond = np.array(arm.joint_limits), q.copy()
    for joint in draw.permutation(np.flatnonzero(np.isfinite(stops[:, 0])))[: draw.integers(1, 4)]:
        side = draw.integers(2)
        stop = (q[joint] + (2 * side - 1) * draw.uniform(0.05, 0.8)).round(4)
        stops[joint, side] = np.clip(stop, *np.array(arm.joint_limits)[joint])
        beyond[joint] = stops[joint, side] + (2 * side - 1) * draw.uniform(0.1, 0.6)
    task = "pose" if arm.n > 6 and draw.random() < 0.5 else "position"
    stiffness = float(draw.choice([100.0, 400.0, 900.0]))
    controller: dict[str, Any] = {"task": task, "stiffness": stiffness, "damping": 2 * stiffness**0.5}
    controller |= {"null_damping": 6.0, "field": {"kind": "bounded", "gain": 100.0, "influence": 0.25}}
    reference: dict[str, Any] = {"kind": "setpoint"}
    obstacles = []
    if drive == "posture":
        controller |= {"posture": beyond.tolist(), "posture_stiffness": float(draw.uniform(20, 200))}
    if drive == "task":
        end = arm.pose(beyond)[0].tolist()
        reference = {"kind": "line", "end": end, "duration": float(draw.uniform(0.3, 1.5))}
        reference["unreachable"] = "warn"
    if drive == "ball":
        way, speed = draw.normal(size=3), draw.uniform(0.3, 1.2)
        velocity = speed * way / np.linalg.norm(way)
        place = draw.uniform(0.5, 1.0) * arm.pose(q)[0] - 0.7 * velocity
        motion = vff.Motion.linear(velocity.tolist())
        obstacles = [vff.Obstacle.sphere(place.tolist(), radius=0.06, motion=motion).to_dict()]
    return {
        "arm": arm.to_dict() | {"joint_limits": stops.tolist()},
        "q0": q.tolist(),
        "duration": 2.0,
        "controller": controller,
        "reference": reference,
        "obstacles": obstacles,
        "simulation": {"dt": 1e-3, "control": "hold", "record_every": 1},
    }


def room(result: vff.Result) -> float:
    """How near a joint comes to a stop [rad]."""
    low, high = np.array(result.scenario.arm.joint_limits).T
    return float(min((result.q - low).min(), (high - result.q).min()))


@pytest.mark.parametrize("drive", DRIVES)
@pytest.mark.parametrize("name", ARMS)
def test_no_joint_meets_its_stop(name: str, drive: str) -> None:
    came_near = dict.fromkeys(WAYS, 0)
    for seed in SEEDS:
        scene = vff.Scenario.from_dict(near_stops(name, drive, seed))
        for way in WAYS:
            result = vff.simulate(scene, {"controller.avoidance": way})
            told = f"{name}, {drive}, {way}, seed {seed}"
            assert result.status in ("completed", "collided"), told
            assert result.metrics["joint_limit_time"] is None, told
            assert room(result) > 0.0, told
            assert result.metrics["velocity_limit_ratio"] < 1.01, told
            assert result.metrics["torque_limit_ratio"] <= 1 + 1e-9, told
            came_near[way] += room(result) < 5e-3
    assert all(came_near.values()), came_near


@pytest.mark.parametrize("way", ["null_space", "relaxed", "priority"])
def test_no_stop_throws_other_joints(way: str) -> None:
    """Joints of an iiwa came to their stops, and threw others beyond their speeds."""
    result = vff.simulate("iiwa-crowd", {"controller.avoidance": way, "simulation.record_every": 1})
    assert result.metrics["joint_limit_time"] is None
    assert 0.0 < room(result) < 5e-3
    assert result.metrics["velocity_limit_ratio"] < 1.001


def test_a_joint_that_begins_at_its_stop_leaves_it_gently() -> None:
    """It comes to where it is kept, and nothing else moves much."""
    scene = vff.Scenario.load("panda-sweep").replace(obstacles=[], duration=1.0)
    q = np.array(scene["q0"])
    stops = np.array(scene.arm.joint_limits)
    stops[3, 1] = q[3]
    result = vff.simulate(scene.replace(**{"arm.joint_limits": stops.tolist()}))
    assert stops[3, 1] - result.q[-1, 3] > 1e-3
    assert result.metrics["velocity_limit_ratio"] < 0.2
    assert np.abs(result.error).max() < 0.02


def test_far_from_stops_every_law_is_what_it_is() -> None:
    """Stops that no joint comes near change no bit."""
    scene = vff.Scenario.load("panda-sweep")
    stops = np.array(scene.arm.joint_limits)
    for way in WAYS:
        near = vff.simulate(scene, {"controller.avoidance": way})
        far = vff.simulate(
            scene, {"controller.avoidance": way, "arm.joint_limits": (stops + np.array([-1.0, 1.0])).tolist()}
        )
        np.testing.assert_array_equal(near.tau, far.tau)


@pytest.mark.parametrize(
    ("name", "q", "push"),
    [
        ("iiwa14", (0.24, 0.91, -0.45, -1.58, 0.01, 1.5, 0.68), (36.9, 40.8, -24.1)),
        ("ur5e", (0.0, -1.4, 1.8, -1.9, -1.57, 0.0), (-20.0, 45.0, 30.0)),
    ],
)
def test_an_arm_that_is_held_and_pushed_comes_to_rest(
    name: str, q: tuple[float, ...], push: tuple[float, ...]
) -> None:
    """Stopped, pushed at the hand for a second and let go: what holds it puts no energy in."""
    pin = pytest.importorskip("pinocchio")
    arm = vff.Arm.named(name)
    model = pin.buildModelFromXML(arm.to_urdf())
    data = model.createData()
    controller = vff.Controller(arm, {"task": "position", "stiffness": 100.0, "damping": 20.0})
    controller.begin(1e-3)
    place, dq, let_go = np.array(q), np.zeros(arm.n), None
    target = arm.pose(place)[0]
    for k in range(4000):
        if k == 100:
            controller.stop()
        torque, phase = controller.cycle(1e-3 * k, place, dq, target)
        outside = np.zeros(arm.n)
        if 500 <= k < 1500:
            pin.computeJointJacobians(model, data, place)
            frame = pin.LOCAL_WORLD_ALIGNED
            outside = pin.getJointJacobian(model, data, arm.n, frame)[:3].T @ np.array(push)
        for _ in range(2):
            dq = dq + 5e-4 * pin.aba(model, data, place, dq, torque + outside)
            place = place + 5e-4 * dq
        share = (np.abs(dq) / arm.velocity_limits).max()
        if k == 1500:
            let_go = place.copy()
        if k > 3000:
            assert phase == "finished" and share < 0.01, (k, share)
    assert let_go is not None and np.abs(place - let_go).max() < 0.5
