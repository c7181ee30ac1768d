"""An arm whose links have other frames is the same arm: joints that turn about any axis of their links."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import vffnull as vff
from matrix import NOT_TOGETHER, OPTIONS, WAYS, combined

pytestmark = pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
IN_SPACE = [name for name in vff.scenarios() if vff.Scenario.load(name).arm.dimension == 3]
UPRIGHT = [1.0, 0.0, 0.0, 0.0]
OF_FRAMES = ("range sensors", "pictures")
"""Rays leave along the axes of links; and whether a pixel is of the arm may be a matter of rounding."""
SYMMETRIC = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]


def quaternion(turn: Rotation) -> list[float]:
    return turn.as_quat(canonical=True, scalar_first=True).tolist()


def of_quaternion(orientation: list[float]) -> Rotation:
    return Rotation.from_quat(orientation, scalar_first=True)


def shape_in(own: Rotation, shape: dict[str, Any]) -> dict[str, Any]:
    """A shape of a link in axes of its own that are turned so."""
    seen = {**shape}
    for key in {"a", "b", "center", "vertices"} & set(shape):
        seen[key] = own.inv().apply(shape[key]).tolist()
    if shape["kind"] == "box":
        seen["orientation"] = quaternion(own.inv() * of_quaternion(shape.get("orientation", UPRIGHT)))
    return seen


def in_other_frames(arm: dict[str, Any], seed: int) -> dict[str, Any]:
    """The same arm, every link of which has a frame that is turned at random."""
    links = [joint["link"] for joint in arm["joints"]]
    turns = dict(zip(links, Rotation.random(len(links), rng=np.random.default_rng(seed)), strict=True))
    turns[arm["base"]] = Rotation.identity()
    joints = []
    for before, joint in zip([arm["base"], *links], arm["joints"], strict=False):
        outer, own = turns[before], turns[joint["link"]]
        tensor = np.zeros((3, 3))
        for (i, k), value in zip(SYMMETRIC, joint["inertia"], strict=True):
            tensor[i, k] = tensor[k, i] = value
        tensor = own.inv().as_matrix() @ tensor @ own.as_matrix()
        joints.append(
            joint
            | {
                "position": outer.inv().apply(joint["position"]).tolist(),
                "orientation": quaternion(outer.inv() * of_quaternion(joint["orientation"]) * own),
                "axis": own.inv().apply(joint["axis"]).tolist(),
                "com": own.inv().apply(joint["com"]).tolist(),
                "inertia": [tensor[i, k] for i, k in SYMMETRIC],
            }
        )
    last = turns[links[-1]]
    tool = {
        "position": last.inv().apply(arm["tool"]["position"]).tolist(),
        "orientation": quaternion(last.inv() * of_quaternion(arm["tool"]["orientation"])),
    }
    collision = [each | {"shape": shape_in(turns[each["link"]], each["shape"])} for each in arm["collision"]]
    return arm | {"joints": joints, "tool": tool, "collision": collision}


def both(scene: vff.Scenario, seed: int) -> list[dict[str, Any]]:
    """A scene with its arm in full, and with the same one in other frames."""
    document = scene.to_dict()
    arm = scene.arm.to_dict()
    others = {**document, "arm": in_other_frames(arm, seed)}
    return [{**document, "arm": arm}, others]


def apart(a: NDArray[Any], b: NDArray[Any]) -> float:
    return float(np.abs(a - b).max())


@pytest.mark.parametrize("name", IN_SPACE)
def test_it_moves_alike(name: str) -> None:
    """By every way of giving way and with every option, but for rounding."""
    ways = list(WAYS)
    cases: list[tuple[str, tuple[str, ...]]] = [(way, ()) for way in ways]
    for k, option in enumerate(OPTIONS):
        if option not in OF_FRAMES:
            cases.append((ways[(k + IN_SPACE.index(name)) % len(ways)], (option,)))
    for way, options in cases:
        scene = combined(name, way, options)
        if (name, way) in NOT_TOGETHER or not isinstance(scene, vff.Scenario):
            continue
        one, other = (vff.simulate(document, {"duration": 0.25}) for document in both(scene, seed=1))
        assert one.status == other.status and one.q.shape == other.q.shape, (way, options)
        assert apart(one.q, other.q) < 1e-9, (way, options)


@pytest.mark.parametrize("name", IN_SPACE)
def test_it_is_planned_for_alike(name: str) -> None:
    """The same draws lead to the same paths: what blocks one arm blocks the other."""
    scene = vff.Scenario.load(name).replace(**{"controller.self_collision": "avoid"})
    limits = np.clip(scene.arm.joint_limits, -3.0, 3.0)
    draw = np.random.default_rng(5)
    for goal in [None, *draw.uniform(*limits.T, (4, len(limits)))]:
        one, other = (
            vff.plan(document, goal, horizon=0.0, paths=1, samples=500) for document in both(scene, seed=2)
        )
        assert (one.status, one.samples, one.nodes) == (other.status, other.samples, other.nodes)
        assert one.q.shape == other.q.shape and apart(one.q, other.q) < 1e-9
        assert one.clearance == pytest.approx(other.clearance, abs=1e-9)
