"""How `cbf` gives way in space: what it weighs, what it keeps, and the arm's own links."""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull._core import matrices
from vffnull.draw.figures.tracking import tracking_error
from vffnull.errors import ScenarioError
from vffnull.evaluation import CONTROLLERS
from vffnull.evaluation.scenes import in_space
from vffnull.live.readouts import numbers
from waiting import HANG

READY = np.array([0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854])

# A ball through the hand, where no null space helps.
AT_THE_HAND: dict[str, Any] = {
    "obstacles.0.position": [0.26, -0.5, 0.54],
    "obstacles.0.motion.velocity": [0.0, 0.4, 0.0],
    "duration": 4.0,
    "controller.task": "pose",
    "controller.avoidance": "cbf",
}


def test_the_torque_of_the_program_is_the_nearest_one() -> None:
    """One row that acts and nothing else: min ½yᵀHy + ½ρσ² with a·y + σ ≥ b has y = H⁻¹a b/(aᵀH⁻¹a + 1/ρ).

    Here from matrices and `distances`, with the weight 300 kg, angles counted at the characteristic length,
    and ρ = 6e5.
    """
    arm = vff.Arm.named("panda")
    dq = np.array([0.3, 0.2, -0.1, 0.1, 0.2, -0.3, 0.1])
    joints = arm.forward_kinematics(READY)
    ball = vff.Obstacle.sphere(
        joints[-1] + [0.0, 0.2, -0.02], 0.05, motion=vff.Motion.linear([0.0, -1.2, 0.0])
    )
    length = 0.2  # m
    settings = {"task": "pose", "enforce_limits": False, "characteristic_length": length}
    yielding = {"activation": 0.09, "speed": 1e6}
    reference = arm.pose(READY)
    nominal = vff.Controller(arm, settings).torque(READY, dq, reference, obstacles=[ball])
    acting = {**settings, "avoidance": "cbf", "yielding": yielding}
    terms = vff.Controller(arm, acting).terms(READY, dq, reference, obstacles=[ball])

    pairs = vff.distances(arm, READY, dq, [ball])
    near = pairs.distance < yielding["activation"]
    assert near.sum() == 1
    (a,), (d,), (rate,), (bias,) = (
        each[near] for each in (pairs.gradient, pairs.distance, pairs.rate, pairs.bias)
    )
    k, margin = 40.0, 0.02
    ddq = arm.forward_dynamics(READY, dq, nominal)
    b = -(a @ ddq + bias + 2 * k * rate + k * k * (d - margin))
    assert b > 1.0
    M, J = arm.mass_matrix(READY), arm.jacobian(READY)
    response = np.linalg.solve(M, J.T)
    N = np.eye(7) - response @ np.linalg.solve(J @ response, J)
    W = 300.0 * np.diag(np.repeat([1.0, length], 3)) ** 2
    H = J.T @ W @ J + N.T @ M @ N
    solved = np.linalg.solve(H, a)
    y = solved * b / (a @ solved + 1 / 6e5)
    np.testing.assert_allclose(terms.tau, nominal + M @ y, rtol=1e-8, atol=1e-8)


@cache
def yielding(*order: str) -> dict[str, float]:
    """The largest errors beside a ball that goes through the hand [m, rad]: of all parts of the pose."""
    changes = AT_THE_HAND | ({"controller.yielding.order": list(order)} if order else {})
    result = vff.simulate("panda-sweep", changes)
    assert result.status == "completed" and result.metrics.min_clearance > 0.018
    assert np.abs(result.error[-1]).max() < 1e-4
    assert result.orientation is not None
    axis = matrices(result.orientation)[:, :, 2]
    position, turn = np.split(result.error, 2, axis=1)
    along = [np.sum(part * axis, axis=1, keepdims=True) for part in (position, turn)]
    across = [part - axis * size for part, size in zip((position, turn), along, strict=True)]
    largest = [float(np.linalg.norm(e, axis=1).max()) for e in (position, turn, *along, *across)]
    return dict(zip(("position", "orientation", "approach", "turn", "beside", "tilt"), largest, strict=True))


def test_what_gives_way_first_keeps_the_rest() -> None:
    """The last part of the order errs a fifth of what it does otherwise, and less at its expense."""
    alike = yielding()
    assert (
        yielding("position")["orientation"]
        < 0.2 * alike["orientation"]
        < yielding("orientation")["orientation"]
    )
    assert yielding("orientation")["position"] < 0.9 * alike["position"] < yielding("position")["position"]


def test_the_turn_about_the_tool_and_the_approach_are_parts() -> None:
    """Of four parts the first gives way most, and what is named before the rest takes over from that."""
    alike, ordered = yielding(), yielding("turn", "orientation", "approach", "position")
    assert ordered["beside"] < 0.5 * alike["beside"], (alike, ordered)
    assert yielding("approach")["beside"] < alike["beside"]
    assert yielding("turn")["tilt"] < alike["tilt"] or yielding("turn")["turn"] > alike["turn"]


@pytest.mark.parametrize(
    ("task", "order", "sentence"),
    [
        ("position", ["orientation"], "needs a task with an orientation"),
        ("pointing", ["turn"], "is free already"),
        ("pose", ["position", "position"], "has a part twice"),
        ("pose", ["yaw"], "turn"),
    ],
)
def test_an_order_is_one_of_what_there_is(task: str, order: list[str], sentence: str) -> None:
    with pytest.raises(ScenarioError, match=rf"yielding\.order.*{sentence}"):
        vff.simulate("panda-sweep", {"controller.task": task, "controller.yielding.order": order})


def test_the_look_ahead_lets_go_in_order() -> None:
    """In a crowd it lets go turn and tilt, says so, and takes them up again; the hand stays."""
    scene, law = in_space("crowd", "panda", "pose", 530), CONTROLLERS["cbf + preview"]
    order = {"controller.yielding.order": ["turn", "orientation", "approach", "position"]}
    alike, result = vff.simulate(scene, law), vff.simulate(scene, law | order)
    away = [float(np.linalg.norm(each.error[:, :3], axis=1).max()) for each in (alike, result)]
    assert away[1] < 2e-3 < 1e-2 < away[0], away
    assert result.status == "completed" and result.metrics.min_clearance > 0.018
    assert result.released is not None and alike.released is None
    assert set(result.released) == {0.0, 2.0} and result.released[-1] == 0.0
    turned = np.linalg.norm(result.error[:, 3:], axis=1)
    assert turned.max() > 0.3 and turned[-1] < 0.02
    # It comes back without a jump, although from 20° off: within 1 ms no torque changes by 3 N·m.
    assert np.abs(np.diff(result.tau, axis=0)).max() < 3.0
    released = result.metrics["released_time"]
    assert released == pytest.approx(1e-3 * np.count_nonzero(result.released), abs=2e-3)
    assert any("let go parts of the task" in line for line in result.headline.lines)
    figure = tracking_error(result)
    assert "lets go turn, orientation" in [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize(
    ("dimension", "task", "order", "parts"),
    [
        (3, "pose", [], [None]),
        (3, "pose", ["turn", "orientation", "approach", "position"], None),
        (3, "pose", ["orientation", "position"], None),
        (3, "pose", ["turn"], ["turn", None]),
        (3, "pointing", ["orientation"], ["orientation", None]),
        (3, "position", ["approach", "position"], ["approach", "position"]),
        (3, "position", ["position"], ["position"]),
        (2, "pose", ["position"], ["position", None]),
    ],
)
def test_what_is_let_go_has_a_name(
    dimension: int, task: str, order: list[str], parts: list[str | None] | None
) -> None:
    """What a task does not have is no part of it that is left over."""
    controller = {"task": task, "yielding": {"order": order}}
    assert vff._core.parts_of_task(controller, dimension) == (order if parts is None else parts)


def test_parts_that_do_not_exist_are_refused() -> None:
    with pytest.raises(ValueError, match="yaw"):
        vff._core.parts_of_task({"task": "pose", "yielding": {"order": ["yaw"]}}, 3)
    with pytest.raises(ValueError, match="grasp"):
        vff._core.parts_of_task({"task": "grasp"}, 3)


def test_the_page_says_what_is_let_go() -> None:
    """The loop of the page names the parts while they are let go, and the read-out shows them."""
    scene, law = in_space("crowd", "panda", "pose", 530), CONTROLLERS["cbf + preview"]
    order = {"controller.yielding.order": ["turn", "orientation", "approach", "position"]}
    live = vff._core.Live(scene.replace(**(law | order)))
    assert live.snapshot()["released"] == [] and "nothing" in numbers(live.snapshot())
    without = vff._core.Live(scene.replace(**law)).snapshot()
    assert without["released"] is None and "Lets go" not in numbers(without)
    live.start()
    try:
        until = time.monotonic() + HANG
        while not (state := live.snapshot())["released"] and time.monotonic() < until:
            time.sleep(0.005)
    finally:
        live.stop()
    assert state["released"] == ["turn", "orientation"]
    assert "turn, orientation" in numbers(state) and "nothing" not in numbers(state)


FOLDING: dict[str, Any] = {
    "duration": 2.5,
    "q0": [0.0, -1.57, 1.57, -1.57, -1.57, 0.0],
    "arm": {"model": "ur5e"},
    "controller": {
        "task": "position",
        "stiffness": 400.0,
        "damping": 40.0,
        "null_damping": 6.0,
        "avoidance": "cbf",
    },
    "reference": {"kind": "line", "end": [0.1, -0.13, 0.6], "duration": 2.0},
    "simulation": {"integrator": "semi_implicit_euler"},
}


def test_cbf_keeps_an_arm_off_itself() -> None:
    """A UR5e draws its hand to its shoulder: 6 cm into itself, or 5 mm off it with the hand on its path."""
    through = vff.simulate(FOLDING, {"controller.self_collision": "report"})
    assert through.metrics.min_self_clearance < -0.05  # type: ignore[operator]
    beside = vff.simulate(FOLDING, {"controller.self_collision": "avoid"})
    assert beside.status == "completed" and beside.metrics.slack_steps == 0
    assert 4.9e-3 < beside.metrics.min_self_clearance < 6e-3  # type: ignore[operator]
    assert np.linalg.norm(beside.error, axis=1).max() < 1e-3


def test_the_base_is_part_of_the_arm() -> None:
    """A link beside the base is measured by `self_collision`, although the base does not move."""
    joint = {"kind": "revolute", "mass": 1.0, "inertia": [0.01, 0.01, 0.01, 0.0, 0.0, 0.0]}
    joints = [
        {"name": "turn", "link": "column", "axis": [0, 0, 1], **joint},
        {"name": "lift", "link": "upper", "position": [0, 0, 0.5], "axis": [0, 1, 0], **joint},
        {"name": "bend", "link": "fore", "position": [0.5, 0, 0], "axis": [0, 1, 0], **joint},
    ]
    ball = {"kind": "sphere", "center": [0.3, 0.0, 0.0], "radius": 0.1}
    rod = {"kind": "capsule", "a": [0.0, 0.0, 0.0], "b": [0.5, 0.0, 0.0], "radius": 0.05}
    document = {
        "duration": 0.01,
        "q0": [0.0, 0.0, 1.2],
        "arm": {
            "joints": joints,
            "tool": {"position": [0.5, 0.0, 0.0]},
            "collision": [{"link": "base", "shape": ball}, {"link": "fore", "shape": rod}],
        },
        "controller": {"task": "position", "self_collision": "report"},
        "reference": {"kind": "setpoint"},
    }
    # The forearm leaves (0.5, 0, 0.5) at 1.2 rad below the horizontal; the base's ball is beside it.
    away = np.array([0.3 - 0.5, 0.0 - 0.5])
    along = np.array([np.cos(1.2), -np.sin(1.2)])
    share = np.clip(away @ along, 0.0, 0.5)
    expected = np.linalg.norm(away - share * along) - 0.1 - 0.05
    result = vff.simulate(document)
    assert result.self_clearance is not None
    assert result.self_clearance[0] == pytest.approx(expected, abs=1e-12)


FIELD = {"controller.avoidance": "null_space", "controller.yielding.preview": None}
CBF = {"controller.avoidance": "cbf", "controller.yielding.preview": None}


def test_one_scene_for_each_way_to_yield() -> None:
    """Where the null space suffices, the field keeps the hand; where not, cbf gives way; where that fails,
    looking ahead finds a way out."""
    clear = {
        (scene, name): vff.simulate(scene, changes).metrics.min_clearance
        for scene in ("panda-sweep", "ur5e-crossed", "iiwa-crowd")
        for name, changes in (("field", FIELD), ("cbf", CBF), ("as it is", {}))
    }
    assert clear["panda-sweep", "as it is"] > 0.1
    assert clear["ur5e-crossed", "field"] < -0.05
    assert clear["ur5e-crossed", "as it is"] > 0.019
    assert clear["iiwa-crowd", "field"] < -0.01 and clear["iiwa-crowd", "cbf"] < -0.01
    assert clear["iiwa-crowd", "as it is"] > 0.019


def test_only_a_search_of_the_self_motion_keeps_the_hand() -> None:
    """Two bodies sweep through the links of a slow arm: it has to set out before they are near. Without that
    the hand is lost, whatever else looks ahead."""
    for changes in (CBF, {"controller.yielding.preview": {}}):
        late = vff.simulate("iiwa-swivel", changes)
        assert np.linalg.norm(late.error[:, :3], axis=1).max() > 0.1
    result = vff.simulate("iiwa-swivel")
    assert result.status == "completed"
    assert np.abs(result.error).max() < 1e-3
    metrics = result.metrics
    assert metrics.min_clearance is not None and metrics.min_clearance > 0.05
    assert metrics.velocity_limit_ratio is not None and metrics.velocity_limit_ratio < 1.0
    assert metrics.torque_limit_ratio is not None and metrics.torque_limit_ratio <= 1.0


@pytest.mark.parametrize("scene", ["ur5e-crossed", "iiwa-crowd"])
def test_the_hand_comes_back(scene: str) -> None:
    """It gives way by more than 10 cm and is where it should be at the end, within the published limits."""
    result = vff.simulate(scene)
    away = np.linalg.norm(result.error[:, :3], axis=1)
    assert result.status == "completed"
    assert away.max() > 0.1 and away[-1] < 1e-5
    metrics = result.metrics
    assert metrics.velocity_limit_ratio is not None and metrics.velocity_limit_ratio < 1.001
    assert metrics.torque_limit_ratio is not None and metrics.torque_limit_ratio <= 1.0
    assert metrics.joint_limit_violation == 0.0
