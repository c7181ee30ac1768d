"""The controller of `examples/ros2_control`, compiled against stand-ins of ROS's headers and called as ROS
would.

It has never been built in ROS.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

import vffnull as vff
from test_c_interface import ROOT, STRICT, built, prefix, run  # noqa: F401
from vffnull._core import parse_toml
from waiting import HANG

EXAMPLE = ROOT / "examples" / "ros2_control"
C = ROOT / "tests" / "c"


def parameters() -> dict[str, Any]:
    config = yaml.safe_load((EXAMPLE / "config" / "panda.yaml").read_text(encoding="utf-8"))
    return config["vffnull_controller"]["ros__parameters"]  # type: ignore[no-any-return]


def test_it_compiles_and_does_as_python_does(prefix: Path, tmp_path: Path) -> None:  # noqa: F811
    """With its own parameters: torques as from Python, a watchdog where no state comes."""
    given = parameters()
    assert given["joints"] == [f"panda_joint{i}" for i in range(1, 8)]
    settings, obstacle = given["settings"], given["obstacle"]["ball"]["toml"]
    defines = [f"-D{name}={quoted(text)}" for name, text in (("SETTINGS", settings), ("OBSTACLE", obstacle))]
    program = tmp_path / "controller"
    includes = [f"-I{EXAMPLE / 'include'}", f"-I{prefix / 'include'}", "-isystem", str(C / "ros_stand_ins")]
    sources = [C / "ros2_control.cpp", EXAMPLE / "src" / "vffnull_controller.cpp"]
    library = [str(prefix / "lib" / "libvffnull.a"), "-lpthread", "-ldl", "-lm"]
    run(["c++", "-std=c++17", *STRICT, *defines, *includes, *sources, "-o", program, *library])
    done = subprocess.run([program], capture_output=True, text=True, timeout=HANG, env=os.environ)
    assert done.returncode == 0, done.stderr
    held, unchanged, aimed, later, stays, led, damped, lost, gravity = map(float, done.stdout.split())

    panda = vff.Arm.named("panda")
    ready = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    law = vff.Controller(panda, parse_toml(settings, "settings"))
    law.begin(1e-3)
    away = [parse_toml(obstacle, "obstacle"), vff.Obstacle.points(np.empty((0, 3)), 0.02)]
    h, reference, count = 1e-3, panda.pose(ready), 0

    def cycles(times: int, reference: Any, obstacles: Any, rate: Any = None) -> float:
        nonlocal count
        for _ in range(times):
            count += 1
            tau, phase = law.cycle(h * count, ready, [0.0] * 7, reference, rate, obstacles=obstacles)
            assert phase in ("starting", "running")
        return float(tau[1])

    expected = [cycles(600, reference, away), cycles(1, reference, away)]
    t = 0.602  # of the cycle in which the ball is heard of, 20 ms after it was seen
    motion = vff.Motion.linear([0.0, 0.2, 0.0])
    here = vff.Obstacle.sphere([-0.05, -0.154 - 0.2 * (t - 0.02), 0.62], 0.08, motion)
    points = np.array([[0.25, -0.25, 0.6]], dtype=np.float32)  # the others are none, or left out
    seen = [here, vff.Obstacle.points(points.astype(float), 0.02)]
    target = [0.3, 0.05, 0.55, 0.0, 1.0, 0.0, 0.0]
    expected += [cycles(1, target, seen), cycles(1, target, seen), cycles(1, target, seen)]
    expected += [cycles(1, [0.31, *target[1:]], seen, [0.1, 0.0, 0.0, 0.0, 0.0, 0.0])]
    assert abs(expected[2] - expected[1]) > 0.1 and abs(expected[5] - expected[4]) > 1e-3
    np.testing.assert_allclose([held, unchanged, aimed, later, stays, led], expected, rtol=0, atol=1e-6)
    for _ in range(100):
        tau, phase = law.cycle()
    assert phase == "damping"
    np.testing.assert_allclose(damped, tau[1], rtol=0, atol=1e-6)
    assert abs(lost) < 1e-9  # nothing but gravity, which is the robot's
    np.testing.assert_allclose(gravity, panda.gravity_torque(ready)[1], rtol=0, atol=1e-6)
    for told in (
        "joints: it is empty",
        "target: a message is left out: it is in the frame 'world', not in 'panda_link0'",
        "target: a message is left out: the position is not finite",
        "target: a message is left out: the orientation is no unit quaternion",
        "obstacles: a message is left out: there is no obstacle 'bell'",
        "points: a message is left out: it has no field x of 32-bit numbers",
        "points: a message is left out: it has fewer bytes than points",
    ):
        assert told in done.stderr


def quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


def test_an_obstacle_is_turned_back(prefix: Path, tmp_path: Path) -> None:  # noqa: F811
    """One that is seen without a turn, after it was turned or described so, has none."""
    program = tmp_path / "law"
    includes = [f"-I{EXAMPLE / 'include'}", f"-I{prefix / 'include'}"]
    library = [str(prefix / "lib" / "libvffnull.a"), "-lpthread", "-ldl", "-lm"]
    run(["c++", "-std=c++17", *STRICT, *includes, C / "law.cpp", "-o", program, *library])
    done = subprocess.run([program], capture_output=True, text=True, timeout=HANG, env=os.environ)
    assert done.returncode == 0, done.stderr
    level, turned, back, described = map(float, done.stdout.split())
    assert abs(turned - level) > 10.0
    np.testing.assert_allclose([back, described], level, rtol=0, atol=0.05)


def test_the_package_names_itself() -> None:
    """What ROS reads agrees: the names of package, library, class and plugin, and what it depends on."""
    package = ElementTree.parse(EXAMPLE / "package.xml").getroot()
    plugin = ElementTree.parse(EXAMPLE / "vffnull_controller.xml").getroot()
    cmake = (EXAMPLE / "CMakeLists.txt").read_text(encoding="utf-8")
    source = (EXAMPLE / "src" / "vffnull_controller.cpp").read_text(encoding="utf-8")
    name = package.findtext("name")
    assert re.search(r"project\((\w+)", cmake)[1] == name == plugin.get("path")  # type: ignore[index]
    described = plugin[0]
    assert f"PLUGINLIB_EXPORT_CLASS({described.get('type')}, {described.get('base_class_type')})" in source
    wanted = {each.text for each in package.findall("depend")}
    assert set(re.search(r"set\(packages(.*?)\)", cmake, re.S)[1].split()) == wanted  # type: ignore[index]
    config = yaml.safe_load((EXAMPLE / "config" / "panda.yaml").read_text(encoding="utf-8"))
    manager = config["controller_manager"]["ros__parameters"]
    assert manager["vffnull_controller"]["type"] == described.get("name") and manager["update_rate"] == 1000


def test_parameters_are_those_that_are_declared() -> None:
    """What the example sets, and what the stand-in of the generated header reads, is declared."""
    text = (EXAMPLE / "src" / "vffnull_controller_parameters.yaml").read_text(encoding="utf-8")
    declared = set(leaves(yaml.safe_load(text)["vffnull_controller"], "type"))
    header = C / "ros_stand_ins" / "vffnull_controller" / "vffnull_controller_parameters.hpp"
    read = re.findall(r'read\("([^,]*)", params', header.read_text(encoding="utf-8"))
    assert {name.replace('" + name + "', "__map_obstacles") for name in read} == declared
    given = parameters()
    assert sorted(given["obstacle"]) == sorted(given["obstacles"])
    given["obstacle"] = {"__map_obstacles": given["obstacle"]["ball"]}
    assert set(leaves(given, "")) == declared


def leaves(tree: dict[str, Any], mark: str, before: str = "") -> Iterator[str]:
    """Dotted names of what is no table, or of the tables that have a key `mark`."""
    for key, value in tree.items():
        if isinstance(value, dict) and mark not in value:
            yield from leaves(value, mark, f"{before}{key}.")
        else:
            yield before + key
