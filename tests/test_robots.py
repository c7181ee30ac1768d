"""The adapters beside `vffnull.drive`: MuJoCo's with MuJoCo, Universal Robots' with a stand-in for each of
its commands, and the makers' interfaces; and the checks. Torques run in `test_emulated.py`.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import stand_ins
import vffnull as vff
from vffnull import arms
from vffnull.errors import InputError
from vffnull.robots import Robot, checks, emulated
from vffnull.robots.franka import FrankaRobot
from vffnull.robots.mujoco import MuJoCoRobot
from vffnull.robots.ur import URRobot
from waiting import HANG

TESTS = Path(__file__).parent
SCENE = vff.Scenario.load("panda-sweep")
PANDA = SCENE.arm
UR_SCENE = vff.Scenario.load("ur5e-crossed")
LIMITS = {"acceleration": 5.0, "jerk": 200.0, "speed": 1.0}


def drive(robot: Any, arm: vff.Arm, settings: Any, **more: Any) -> vff.DriveReport:
    with vff.drive(robot, vff.Controller(arm, settings), **more) as driven:
        assert driven.wait(HANG)
    return driven.report


# MuJoCo


def test_mujoco_is_driven() -> None:
    """A ball is carried through the elbow by hand: nothing is touched, the hand stays; without the field it
    is hit.
    """
    start, tip_name = PANDA.pose(SCENE["q0"])[0], "panda_hand_tcp"
    for field, hit in ((80.0, False), (0.0, True)):
        ball = vff.Obstacle.sphere([-0.05, -0.4, 0.62], 0.08)
        robot = MuJoCoRobot.from_arm(PANDA, SCENE["q0"], obstacles=[ball])
        contacts: list[int] = []
        off: list[float] = []

        def carry(robot: MuJoCoRobot, contacts: list[int] = contacts, off: list[float] = off) -> None:
            robot.data.mocap_pos[0, 1] = -0.4 + 0.25 * robot.data.time
            contacts.append(robot.data.ncon)
            if robot.data.time > 0.01:
                off.append(np.linalg.norm(robot.data.site(tip_name).xpos - start))

        robot.before_step = carry
        moving = vff.Obstacle.sphere([-0.05, -0.4, 0.62], 0.08, vff.Motion.linear([0.0, 0.25, 0.0]))
        settings = SCENE["controller"] | {"field": vff.Field.bounded(field, 0.25)}
        report = drive(robot, PANDA, settings, obstacles=[moving], seconds=2.5)
        assert report.status == "completed" and isinstance(robot, Robot)
        assert (max(contacts) > 0) == hit
        assert hit or max(off) < 2e-3


@pytest.mark.parametrize("name", arms.names())
def test_nothing_of_an_arm_is_touched_where_it_stands(name: str) -> None:
    """Its base and its first link overlap by design, and MuJoCo lets that pair be only if it is told to."""
    arm = vff.Arm.named(name)
    q = np.full(arm.n, 0.3) if name not in ("panda", "fr3") else np.array(SCENE["q0"])
    robot = MuJoCoRobot.from_arm(arm, q)
    mujoco.mj_forward(robot.model, robot.data)
    assert robot.data.ncon == 0


def test_a_folded_arm_touches_itself() -> None:
    """Other links are felt by the base as before."""
    robot = MuJoCoRobot.from_arm(PANDA, [0.0, 1.7, 0.0, -3.0, 0.0, 1.5, 0.0])
    mujoco.mj_forward(robot.model, robot.data)
    bodies = robot.model.geom_bodyid[robot.data.contact.geom]
    assert (bodies == robot.model.body("panda_link0").id).any()


def test_a_pair_is_left_out_once_and_where_it_can_touch() -> None:
    """Base and first link: not where `ignore` has them, links touch obstacles alone, or one has no shape."""
    arm = arms.named("panda")
    base, first = arm["base"], arm["joints"][0]["link"]
    bare = [item for item in arm["collision"] if item["link"] != base]

    def left_out(arm: dict[str, Any], **more: Any) -> list[set[str]]:
        root = ElementTree.fromstring(arms.to_mjcf(arm, **more))
        return [set(each.attrib.values()) for each in root.iter("exclude")]

    ignored = [set(pair) for pair in arm.get("ignore", [])]
    assert left_out(arm) == [*ignored, {base, first}]
    assert left_out(arm, obstacles=[]) == ignored
    assert left_out(arm | {"collision": bare}) == ignored
    for pair in ([base, first], [first, base]):
        assert left_out(arm | {"ignore": [pair]}) == [{base, first}]


def test_mujoco_takes_what_its_actuators_take() -> None:
    """Positions and velocities go to servos, some joints of many are driven, a period is several steps."""
    text = """
    <mujoco><option timestep="0.0005" gravity="0 0 0"/><worldbody>
      <body><joint name="a" type="hinge" axis="0 0 1"/><geom size="0.1" pos="1 0 0" mass="1"/>
        <body pos="1 0 0"><joint name="b" type="hinge" axis="0 0 1"/><geom size="0.1" pos="1 0 0"
        mass="1"/></body></body>
      <body pos="0 0 1"><joint name="c" type="slide"/><geom size="0.1" mass="1"/></body>
    </worldbody><actuator>
      <position name="pb" joint="b" kp="900" kv="60"/><position name="pa" joint="a" kp="900" kv="60"/>
      <velocity name="va" joint="a" kv="50"/>
    </actuator></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    arm = vff.Arm.uniform(2, length=1.0, mass=1.0)
    robot = MuJoCoRobot(model, joints=["a", "b"], actuators=["pa", "pb"], command="position", period=0.002)
    data = robot.data
    robot.write(np.array([0.1, 0.2]))
    np.testing.assert_array_equal(data.ctrl, [0.2, 0.1, 0.0])
    assert data.time == pytest.approx(0.002) and len(robot.read()[1]) == 2
    goal = arm.forward_kinematics([0.3, 0.8])[-1]
    settings = {"stiffness": 25.0, "damping": 10.0, "null_damping": 4.0}
    robot = MuJoCoRobot(model, joints=["a", "b"], actuators=["pa", "pb"], command="position", period=0.002)
    robot.data.qpos[:2] = 0.2, 0.7
    report = drive(robot, arm, settings, rate=500.0, x_ref=goal, seconds=4.0, limits=LIMITS)
    assert report.status == "completed"
    assert np.linalg.norm(arm.forward_kinematics(robot.data.qpos[:2])[-1] - goal) < 5e-3

    for what, wrong in {
        "multiple of the model's step": lambda: MuJoCoRobot(model, joints=["a"], period=0.0007),
        "period": lambda: MuJoCoRobot(model, joints=["a"], period=np.nan),
        "no joint 'z'": lambda: MuJoCoRobot(model, joints=["z"]),
        "no actuator 'z'": lambda: MuJoCoRobot(model, joints=["a"], actuators=["z"]),
        "joint 'a' has 2": lambda: MuJoCoRobot(model, joints=["a"]),
        "joint 'c' has 0": lambda: MuJoCoRobot(model, joints=["c"]),
        "actuators: expected 2": lambda: MuJoCoRobot(model, joints=["a", "b"], actuators=["pa"]),
        "at least one": lambda: MuJoCoRobot(model, joints=[]),
        "q: expected shape": lambda: MuJoCoRobot.from_arm(PANDA, [0.0]),
    }.items():
        with pytest.raises(InputError, match=what):
            wrong()
    free = mujoco.MjModel.from_xml_string(
        "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(InputError, match="hinges and slides"):
        MuJoCoRobot(free)


# Franka and Universal Robots: against emulators, tests/test_emulated.py


def test_franka_is_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    with pytest.raises(ImportError, match=r'pip install "vffnull\[franka\]"'):
        FrankaRobot("172.16.0.2")
    monkeypatch.setitem(sys.modules, "rtde_control", None)
    with pytest.raises(ImportError, match=r'pip install "vffnull\[ur\]"'):
        URRobot("192.168.1.2")


# Universal Robots

UR = {"task": "position", "stiffness": 100.0, "damping": 20.0, "null_damping": 8.0}


@pytest.mark.parametrize("command", ["torque", "position", "velocity"])
def test_ur_is_driven(command: Any) -> None:
    """By each of its three ways, to a place some centimetres away; then its mode is left."""
    there = stand_ins.UR(UR_SCENE, UR_SCENE.arm)
    robot = URRobot((there, there), command=command)  # type: ignore[arg-type]
    arm, start = UR_SCENE.arm, robot.positions()
    goal = arm.pose(start)[0] + [0.0, 0.03, 0.02]
    assert checks.mass_matrix(arm, [start], [robot.mass_matrix()]).worst < 1e-12
    settings = UR | ({"command": {"gravity": "robot"}} if command == "torque" else {})
    report = drive(robot, arm, settings, rate=500.0, x_ref=goal, seconds=3.0, limits=LIMITS)
    assert (report.status, report.reason) == ("completed", "")
    assert np.linalg.norm(arm.pose(robot.positions())[0] - goal) < 2e-3
    way = {"torque": "directTorque", "position": "servoJ", "velocity": "speedJ"}[command]
    stops = {"torque": [], "position": ["servoStop"], "velocity": ["speedStop"]}[command]
    assert set(there.calls) == {way, *stops, "stopScript"} and there.calls[-1] == "stopScript"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"stopped": True}, "the robot has a protective stop"),
        ({"connected": False}, "the connection is lost"),
        ({"runs": False}, "the robot did not take a torque; is its program running?"),
    ],
)
def test_ur_stops_by_itself(change: dict[str, bool], reason: str) -> None:
    """A protective stop, a lost connection, a program that does not run: each is the reason of the end."""
    there = stand_ins.UR(UR_SCENE, UR_SCENE.arm)
    robot = URRobot((there, there))  # type: ignore[arg-type]
    law = vff.Controller(UR_SCENE.arm, UR | {"command": {"gravity": "robot"}})
    with (
        pytest.warns(RuntimeWarning, match=re.escape(reason)),
        vff.drive(robot, law, rate=500.0) as driven,
    ):
        while driven.state.phase != "running":
            driven.wait(0.01)
        vars(there).update(change)
        assert driven.wait(HANG)
    assert reason in driven.report.reason and there.calls[-1] == "stopScript"


@pytest.mark.parametrize(
    "wrong",
    [{"gain": 10.0}, {"lookahead": 1.0}, {"frequency": 1000.0}, {"acceleration": -1.0}, {"command": "force"}],
)
def test_ur_refuses_what_its_robot_would(wrong: dict[str, Any]) -> None:
    with pytest.raises(InputError):
        URRobot((None, None), **wrong)  # type: ignore[arg-type]


# The makers' interfaces


def signatures(text: str, method: str) -> list[str]:
    """The names of the parameters of a method, and whether each has a default, of a docstring by pybind11."""
    found = re.search(rf"{method}\(self: [\w.]+(?:, )?(.*?)\) ->", text, re.DOTALL)
    assert found, method
    parts = re.split(r", (?=\w+:)", found[1]) if found[1] else []
    return [
        re.sub(r":.*?(?= =|$)", "", part).replace(" = ", "=").split("=")[0] + "=" * ("=" in part)
        for part in parts
    ]


@pytest.mark.parametrize("module", ["rtde_control", "rtde_receive"])
def test_stubs_are_those_of_the_wheel(module: str) -> None:
    """Stubs and stand-in have the methods of ur_rtde, with its parameters."""
    real = pytest.importorskip(module)
    tree = ast.parse((TESTS / "stubs" / f"{module}.pyi").read_text(encoding="utf-8"))
    described = next(node for node in tree.body if isinstance(node, ast.ClassDef))
    methods = [node for node in described.body if isinstance(node, ast.FunctionDef)]
    assert len(methods) >= 6
    for method in methods:
        given = method.args.args[1:]
        required = len(given) - len(method.args.defaults)
        wanted = [each.arg + "=" * (i >= required) for i, each in enumerate(given)]
        told = getattr(getattr(real, described.name), method.name).__doc__
        assert signatures(told, method.name) == wanted, method.name
        if method.name != "__init__":
            stand_in = list(inspect.signature(getattr(stand_ins.UR, method.name)).parameters.values())[1:]
            assert [each.name + "=" * (each.default is not each.empty) for each in stand_in] == wanted


def test_the_emulated_franka_has_its_methods() -> None:
    """Methods, parameters and what a state has are those of pylibfranka."""
    real = pytest.importorskip("pylibfranka")
    for owner, there, methods in (
        (
            real.Robot,
            emulated.franka.Robot,
            (
                *("start_torque_control", "read_once", "load_model", "stop", "automatic_error_recovery"),
                *("set_collision_behavior", "set_load"),
            ),
        ),
        (real.ActiveControlBase, emulated.franka.Robot, ("readOnce", "writeOnce")),
        (real.Model, emulated.franka.Model, ("gravity", "mass", "coriolis")),
    ):
        for method in methods:
            told = getattr(owner, method).__doc__
            wanted = re.findall(r"(\w+): ", re.search(rf"{method}\(self: [\w.]+(.*?)\) ->", told)[1])
            if owner is not real.Model:
                given = list(inspect.signature(getattr(there, method)).parameters)[1:]
                assert given == wanted[: len(given)] and bool(given) == bool(wanted), method
    state = emulated.franka.Robot(SCENE).read_once()
    ours = {name for name in dir(state) if not name.startswith("_")}
    assert ours <= {name for name in dir(real.RobotState) if not name.startswith("_")}
    errors = {name for name in dir(real.Errors) if not name.startswith("_")}
    rules = {margin.rule.name for margin in emulated.franka.Robot(SCENE).margins()}
    assert rules - errors == {"cartesian_velocity_violation"} - errors
    assert [mode.name for mode in emulated.franka.RobotMode] == list(real.RobotMode.__members__)
    torques = real.Torques([1.0] * 7)
    torques.motion_finished = True
    assert torques.tau_J == emulated.franka.Torques([1.0] * 7).tau_J and torques.motion_finished


def test_the_emulated_ur_has_its_methods() -> None:
    """Methods and parameters are those of ur_rtde."""
    real = [pytest.importorskip(name) for name in ("rtde_control", "rtde_receive")]
    owners = real[0].RTDEControlInterface, real[1].RTDEReceiveInterface
    names = [name for name in vars(emulated.ur.Robot) if not name.startswith("_") and name != "margins"]
    assert len(names) > 10
    for name in names:
        told = next(getattr(owner, name).__doc__ for owner in owners if hasattr(owner, name))
        given = list(inspect.signature(getattr(emulated.ur.Robot, name)).parameters.values())[1:]
        assert [each.name + "=" * (each.default is not each.empty) for each in given] == signatures(
            told, name
        )


def test_adapters_fit_the_stubs(tmp_path: Path) -> None:
    """mypy, with pylibfranka's own stubs and those of ur_rtde, finds a method that is none and a call that
    lacks something, and nothing else.
    """
    pytest.importorskip("mypy")
    pytest.importorskip("pylibfranka")
    robots = Path(vff.__file__).parent / "robots"
    wrong = (
        ("franka", "start_torque_control()", "start_torques()"),
        ("ur", "directTorque(command, self._viscous, self._coulomb)", "directTorque()"),
    )
    files = []
    for module, right, odd in wrong:
        text = (robots / f"{module}.py").read_text(encoding="utf-8")
        assert right in text
        files.append(tmp_path / f"wrong_{module}.py")
        files[-1].write_text(text.replace(right, odd), encoding="utf-8")
    options = ["--strict", "--follow-imports=silent", "--ignore-missing-imports"]
    command = [sys.executable, "-m", "mypy", *options]
    source = robots.parents[1]  # what is installed, mypy finds by itself
    paths = [str(TESTS / "stubs"), *([] if source.name == "site-packages" else [str(source)])]
    done = subprocess.run(
        [*command, "--cache-dir", str(tmp_path / "cache"), *map(str, files)],
        capture_output=True,
        text=True,
        env={"MYPYPATH": os.pathsep.join(paths), "PATH": ""},
        timeout=HANG,
    )
    errors = sorted(line for line in done.stdout.splitlines() if ": error: " in line)
    assert len(errors) == 2, done.stdout + done.stderr
    assert "start_torques" in errors[0] and "directTorque" in errors[1]


# Checks


def test_checks_find_a_load() -> None:
    """A load of 0.7 kg that the model does not know is found in both, and a right model is right."""
    robot = SCENE.replace(**{"plant.payload": {"mass": 0.7, "com": [0.0, 0.0, 0.05]}}).plant
    q = checks.postures(PANDA, SCENE["q0"], count=10)
    assert q.shape == (10, 7)
    np.testing.assert_array_equal(q[0], SCENE["q0"])
    low, high = np.asarray(PANDA.joint_limits).T
    assert (q > low).all() and (q < high).all() and abs(q - SCENE["q0"]).max() <= 0.3
    assert (np.diff(q, axis=0) != 0.0).all()
    found = checks.gravity(PANDA, q, [robot.gravity_torque(each) for each in q])
    assert found.worst > 2.0 and found.unit == "N·m" and found.difference.shape == (10, 7)
    assert (
        str(found).count("\n") == 8 and "panda_joint2" in str(found) and f"{found.relative:.1%}" in str(found)
    )
    mass = checks.mass_matrix(PANDA, q, [robot.mass_matrix(each) for each in q])
    assert mass.worst > 0.1 and mass.difference.shape == (10, 7, 7) and "kg·m²" in str(mass)
    right = checks.gravity(PANDA, q, [PANDA.gravity_torque(each) for each in q])
    assert right.worst == right.relative == 0.0
    flat = vff.Arm.uniform(3)
    assert checks.gravity(flat, [[0.1, 0.2, 0.3]], [[0.0, 0.0, 0.0]]).relative == 0.0
    assert checks.gravity(flat, [[0.1, 0.2, 0.3]], [[0.0, 1.0, 0.0]]).relative == np.inf


def test_checks_keep_within_the_joints() -> None:
    """Near an end of its range a joint is not asked to go beyond, and never away from where it is."""
    low, high = np.asarray(PANDA.joint_limits).T
    q = checks.postures(PANDA, high - 0.01, count=50, spread=2.0, seed=3)
    assert (q <= high).all() and (q >= low).all()
    edge = np.where(np.arange(7) == 6, high - 0.01, SCENE["q0"])
    q = checks.postures(PANDA, edge, count=50, spread=0.6)[:, 6]
    assert q.max() <= edge[6] and q.min() < high[6] - 0.4


def test_checks_begin_within_the_joint_stops() -> None:
    """A posture in degrees is told of by the joint that is farthest beyond its stop; at a stop is within."""
    with pytest.raises(InputError, match=r"around: panda_joint4 is 132 rad or m beyond its stop; expected"):
        checks.postures(PANDA, [0, -45, 0, -135, 0, 90, 45])
    high = np.asarray(PANDA.joint_limits)[:, 1]
    with pytest.raises(InputError, match=r"around: panda_joint1 is 0\.001 rad or m beyond"):
        checks.postures(PANDA, high + 0.001 * np.eye(7)[0])
    assert checks.postures(PANDA, high, count=3).shape == (3, 7)


@pytest.mark.parametrize(
    "wrong",
    [
        lambda: checks.postures(PANDA, [0.0] * 6),
        lambda: checks.postures(PANDA, SCENE["q0"], spread=0.0),
        lambda: checks.postures(PANDA, SCENE["q0"], count=0),
        lambda: checks.gravity(PANDA, SCENE["q0"], [0.0] * 7),
        lambda: checks.gravity(PANDA, [SCENE["q0"]], [[np.nan] * 7]),
        lambda: checks.gravity(PANDA, [], []),
        lambda: checks.gravity(PANDA, "here", [[0.0] * 7]),
        lambda: checks.mass_matrix(PANDA, [SCENE["q0"]], np.zeros((1, 7, 6))),
    ],
)
def test_checks_refuse_what_is_none(wrong: Any) -> None:
    with pytest.raises(InputError):
        wrong()
