"""The controller of `examples/ros2_control`, compiled against stand-ins of ROS's headers and called as ROS
would.

It has never been built in ROS.
"""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import yaml

import vffnull as vff
from test_c_interface import ROOT, STRICT, built, prefix, run  # noqa: F401
from vffnull._core import parse_toml
from waiting import HANG

EXAMPLE = ROOT / "examples" / "ros2_control"
C = ROOT / "tests" / "c"


def parameters() -> dict[str, object]:
    config = yaml.safe_load((EXAMPLE / "config" / "panda.yaml").read_text(encoding="utf-8"))
    return config["vffnull_controller"]["ros__parameters"]  # type: ignore[no-any-return]


def test_it_compiles_and_does_as_python_does(prefix: Path, tmp_path: Path) -> None:  # noqa: F811
    """With its own parameters: torques as from Python, a watchdog where no state comes."""
    given = parameters()
    assert given["joints"] == [f"panda_joint{i}" for i in range(1, 8)]
    settings, obstacle = str(given["settings"]), str(given["obstacles"][0])  # type: ignore[index]
    defines = [f"-D{name}={quoted(text)}" for name, text in (("SETTINGS", settings), ("OBSTACLE", obstacle))]
    program = tmp_path / "controller"
    includes = [f"-I{EXAMPLE / 'include'}", f"-I{prefix / 'include'}", "-isystem", str(C / "ros_stand_ins")]
    sources = [C / "ros2_control.cpp", EXAMPLE / "src" / "vffnull_controller.cpp"]
    library = [str(prefix / "lib" / "libvffnull.a"), "-lpthread", "-ldl", "-lm"]
    run(["c++", "-std=c++17", *STRICT, *defines, *includes, *sources, "-o", program, *library])
    done = subprocess.run([program], capture_output=True, text=True, timeout=HANG, env=os.environ)
    assert done.returncode == 0, done.stderr
    told = [float(line) for line in done.stdout.split()]

    panda = vff.Arm.named("panda")
    ready = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
    law = vff.Controller(panda, parse_toml(settings, "settings"))
    law.begin(1e-3)
    away = parse_toml(obstacle, "obstacle")
    expected = []
    for k in range(600):
        tau, _ = law.cycle(1e-3 * k, ready, [0.0] * 7, panda.pose(ready), obstacles=[away])
    expected.append(tau[1])
    t = 0.6
    here = vff.Obstacle.sphere([-0.05, -0.15 - 0.2 * t, 0.62], 0.08, vff.Motion.linear([0.0, 0.2, 0.0]))
    target = [0.3, 0.05, 0.55, 0.0, 1.0, 0.0, 0.0]
    tau, phase = law.cycle(t, ready, [0.0] * 7, target, obstacles=[here])
    expected.append(tau[1])
    assert phase == "running" and abs(expected[1] - expected[0]) > 0.1
    for _ in range(100):
        tau, phase = law.cycle()
    expected.append(tau[1])
    assert phase == "damping"
    np.testing.assert_allclose(told[:3], expected, rtol=0, atol=1e-6)
    assert len(told) == 4 and abs(told[3]) < 1e-9  # nothing but gravity, which is the robot's
    assert "joints: the robot has" not in done.stderr and "another length" in done.stderr


def quoted(text: str) -> str:
    return '"' + text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n") + '"'


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
    assert set(re.search(r"set\(packages (.*?)\)", cmake)[1].split()) == wanted  # type: ignore[index]
    config = yaml.safe_load((EXAMPLE / "config" / "panda.yaml").read_text(encoding="utf-8"))
    manager = config["controller_manager"]["ros__parameters"]
    assert manager["vffnull_controller"]["type"] == described.get("name") and manager["update_rate"] == 1000
