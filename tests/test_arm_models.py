"""The bundled spatial arms: complete, plausible, and those that the makers publish."""

from __future__ import annotations

import math
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spatial_oracle import mass_and_gravity, poses
from vffnull import _core, arms
from vffnull.arms._touching import reference_posture, touching
from vffnull.errors import InputError

NAMES = ("panda", "fr3", "ur5e", "ur10e", "iiwa14", "gen3", "xarm7")
JOINTS = {"ur5e": 6, "ur10e": 6}


def wheel(name: str, ending: str) -> Path:
    """A file of a wheel, or a reason to skip."""
    try:
        for file in files(name) or ():
            if str(file).endswith(ending):
                return Path(str(file.locate())).resolve()
    except PackageNotFoundError:
        pass
    pytest.skip(f"pip install {name}")


def test_the_names() -> None:
    assert arms.names() == NAMES
    with pytest.raises(InputError, match="did you mean `iiwa14`"):
        arms.named("iiwa")


@pytest.mark.parametrize("name", NAMES)
def test_complete(name: str) -> None:
    arm = arms.named(name)
    n = JOINTS.get(name, 7)
    assert len(arm["joints"]) == len(arm["joint_limits"]) == len(arm["velocity_limits"]) == n
    assert len(arm["torque_limits"]) == n
    assert np.all(np.isfinite(arm["torque_limits"]))
    assert np.all(np.isfinite(arm["velocity_limits"]))
    assert {item["link"] for item in arm["collision"]} >= {joint["link"] for joint in arm["joints"][:-1]}
    assert _core.check_arm(arm) == arm


@pytest.mark.parametrize("name", NAMES)
def test_plausible(name: str) -> None:
    arm = arms.named(name)
    rng = np.random.default_rng(0)
    limits = np.clip(arm["joint_limits"], -np.pi, np.pi)
    reached = 0.0
    for _ in range(300):
        q = rng.uniform(limits[:, 0], limits[:, 1])
        places = poses(arm, q)
        reached = max(reached, float(np.linalg.norm(places[-1][:3, 3] - places[2][:3, 3])))
        M, g = mass_and_gravity(arm, q)
        assert np.linalg.eigvalsh(M).min() > 1e-5
        # The arm holds itself, with a little to spare.
        assert np.all(np.abs(g) <= np.array(arm["torque_limits"]))
    # The makers measure from the shoulder to the wrist or the flange.
    assert 0.75 * arm["reach"] < reached < 1.45 * arm["reach"]


@pytest.mark.parametrize("name", NAMES)
def test_nothing_touches_in_the_middle_of_the_ranges(name: str) -> None:
    arm = arms.named(name)
    assert touching(arm) == []
    assert np.all(np.isfinite(reference_posture(arm)))


@pytest.mark.parametrize("name", NAMES)
def test_sources_are_stated(name: str) -> None:
    head = [line for line in _core.arm_text(name).splitlines() if line.startswith("#")]
    text = " ".join(head)
    assert "Apache-2.0" in text or "BSD-3-Clause" in text
    assert "Payload" in text
    assert "reach" in text.lower()
    assert "Capsules: fitted" in text


def same(arm: dict[str, Any], theirs: dict[str, Any], tolerance: float = 1e-12) -> None:
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = rng.uniform(-2, 2, len(arm["joints"]))
        for ours, other in zip(mass_and_gravity(arm, q), mass_and_gravity(theirs, q), strict=True):
            np.testing.assert_allclose(ours, other, rtol=0, atol=tolerance * np.abs(other).max())
        np.testing.assert_allclose(poses(arm, q)[-1], poses(theirs, q)[-1], atol=tolerance)


@pytest.mark.parametrize(
    ("name", "ending"),
    [("panda", "panda_description/urdf/panda.urdf"), ("xarm7", "xarm_description/urdf/xarm7.urdf")],
)
def test_the_published_urdf_has_the_same_numbers(name: str, ending: str) -> None:
    path = wheel("example-robot-data", ending)
    arm = arms.named(name)
    report = arms.read_urdf(path, base=arm["base"], tip=arm["tip"], packages=path.parents[4])
    same(arm, report.document)
    for key in ("joint_limits", "velocity_limits", "torque_limits"):
        assert arm[key] == report.document[key]
    contained(arm, report)


def contained(arm: dict[str, Any], report: arms.Report) -> None:
    """The bundled capsules contain those that are fitted anew: ends within what they are larger. Where a hull
    is taken today in the place of a loose capsule, there is none to compare.
    """
    compared = 0
    for item, fit in zip(arm["collision"], report.fits, strict=True):
        assert item["link"] == fit.link
        ours, theirs = item["shape"], fit.shape
        if theirs["kind"] == "convex":
            continue
        compared += 1
        keys = ("a", "b") if ours["kind"] == "capsule" else ("center", "center")
        orders = (keys, keys[::-1])  # which end is which depends on rounding
        away = min(
            max(math.dist(ours[key], theirs[other]) for key, other in zip(keys, order, strict=True))
            for order in orders
        )
        assert away <= ours["radius"] - theirs["radius"] + 1e-9
        assert ours["radius"] - theirs["radius"] <= 3e-4
    assert compared >= len(report.fits) - 2


@pytest.mark.parametrize(
    ("name", "folder", "tip"),
    [("panda", "panda", "right_hand"), ("ur5e", "ur5e", "right_hand"),
     ("gen3", "kinova3", "right_hand"), ("xarm7", "xarm7", "right_hand")],
)  # fmt: skip
def test_the_joint_axes_are_those_of_another_publication(name: str, folder: str, tip: str) -> None:
    """robosuite's models are other people's: frames differ, the lines of the joints in space do
    not. Its iiwa is the smaller one, whose upper arm is 20 mm shorter."""
    pytest.importorskip("mujoco")
    path = wheel("robosuite", f"assets/robots/{folder}/robot.xml")
    arm = arms.named(name)
    report = arms.read_mjcf(path, tip=tip, collision="none")
    theirs = report.document
    assert len(theirs["joints"]) == len(arm["joints"])
    rng = np.random.default_rng(4)
    for _ in range(4):
        q = rng.uniform(-1, 1, len(arm["joints"]))
        assert invariants(arm, q) == pytest.approx(invariants(theirs, q), abs=2e-3)


def invariants(arm: dict[str, Any], q: Any) -> list[float]:
    """Distances and angles between the axes of all joints, whatever frames they are written in."""
    links = poses(arm, q)[1:-1]
    lines = [
        (pose[:3, 3], pose[:3, :3] @ joint["axis"]) for pose, joint in zip(links, arm["joints"], strict=True)
    ]
    out = []
    for i, (p, u) in enumerate(lines):
        for r, v in lines[i + 1 :]:
            across = np.cross(u, v)
            size = np.linalg.norm(across)
            apart = r - p
            out.append(abs(u @ v))
            out.append(abs(apart @ across) / size if size > 0.05 else np.linalg.norm(np.cross(u, apart)))
    return [float(x) for x in out]
