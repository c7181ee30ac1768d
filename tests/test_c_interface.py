"""The C and C++ interface: installed by the documented command, and driven by MuJoCo as Python drives it."""

from __future__ import annotations

import ctypes
import fcntl
import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

import vffnull as vff
from vffnull import _core
from vffnull.arms import to_mjcf
from vffnull.robots.emulated import franka
from vffnull.robots.franka import FrankaRobot
from waiting import HANG

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples" / "cpp"
MODEL = EXAMPLES / "panda.xml"
READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
STRICT = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]

for tool in ("cmake", "cc", "c++"):
    if shutil.which(tool) is None and not os.environ.get("CI"):
        pytest.skip(f"{tool} is missing", allow_module_level=True)


def run(command: Sequence[str | Path], **more: str) -> str:
    """What a command prints."""
    done = subprocess.run(
        [*map(str, command)],
        cwd=ROOT,
        env=os.environ | more,
        capture_output=True,
        text=True,
        timeout=HANG,
    )
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    return done.stdout


def documented(page: str) -> list[str]:
    """The lines of the first shell command of the page, and of the second."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)[:2]


@pytest.fixture(scope="module")
def built() -> Path:
    """Where the programs are, after both documented commands. Workers of pytest take turns."""
    folder = ROOT / "target"
    folder.mkdir(exist_ok=True)
    with (folder / "c.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        install, build = documented("c.md")
        run(["sh", "-ec", install])
        run(["sh", "-ec", build.partition(" && target/cpp/sweep")[0]])
    return folder / "cpp"


@pytest.fixture(scope="module")
def prefix(built: Path) -> Path:
    """Where the library is installed."""
    return built.parent / "c" / "install"


def compiled(prefix: Path, source: Path, to: Path, *more: str) -> Path:
    """A program made with the flags of the installed pkg-config file."""
    found = prefix / "lib" / "pkgconfig" / "vffnull.pc"
    text = found.read_text(encoding="utf-8")
    variables = dict(re.findall(r"^(\w+)=(.*)$", text, re.MULTILINE))
    fields = dict(re.findall(r"^([\w.]+): (.*)$", text, re.MULTILINE))
    flags = [re.sub(r"\$\{(\w+)\}", lambda m: variables[m[1]], fields[name]) for name in ("Cflags", "Libs")]
    language = ["c++", "-std=c++17"] if source.suffix == ".cpp" else ["cc", "-std=c11"]
    rpath = f"-Wl,-rpath,{variables['libdir']}"
    run([*language, *STRICT, *more, source, *flags[0].split(), "-o", to, *flags[1].split(), rpath, "-lm"])
    return to


def test_what_is_installed(prefix: Path) -> None:
    """Headers, libraries, what CMake and pkg-config want; the library exports what the header names."""
    files = {str(path.relative_to(prefix)) for path in prefix.rglob("*") if not path.is_dir()}
    version = re.search(r"#define VFF_ABI_VERSION (\d+)", (prefix / "include/vffnull.h").read_text())
    assert version
    shared = f"lib/libvffnull.so.{version[1]}"
    assert files == {
        "include/vffnull.h",
        "include/vffnull.hpp",
        "lib/libvffnull.a",
        "lib/libvffnull.so",
        shared,
        "lib/cmake/vffnull/vffnullConfig.cmake",
        "lib/cmake/vffnull/vffnullConfigVersion.cmake",
        "lib/pkgconfig/vffnull.pc",
    }
    assert os.readlink(prefix / "lib/libvffnull.so") == Path(shared).name
    header = (prefix / "include/vffnull.h").read_text(encoding="utf-8")
    told = set(re.findall(r"\b(vff_\w+)\(", header))
    symbols = run(["nm", "-D", "--defined-only", prefix / shared])
    assert {line.split()[-1] for line in symbols.splitlines()} == told
    assert len(told) > 25


def test_shortest_loops(built: Path) -> None:
    """In C and, with the static library, in C++: both say what Python says."""
    robot = vff.Arm.named("panda")
    settings = {
        "task": "pose",
        "stiffness": 900.0,
        "damping": 60.0,
        "null_damping": 12.0,
        "field": {"kind": "bounded", "gain": 80.0, "influence": 0.25},
    }
    t = 0.999
    place, velocity = np.array([-0.05, -0.4 + 0.2 * t, 0.62]), np.array([0.0, 0.2, 0.0])
    ball = vff.Obstacle.sphere(place - velocity * t, 0.08, motion=vff.Motion.linear(velocity))
    terms = vff.Controller(robot, settings).terms(READY, [0.0] * 7, robot.pose(READY), obstacles=[ball], t=t)
    assert max(terms.force) > 1.0
    expected = f"torque of joint 2: {terms.tau[1]:.3f} N·m, clearance: {min(terms.clearance):.4f} m\n"
    assert run([built / "hold"]) == run([built / "hold_cpp"]) == expected


def test_what_a_camera_sees(built: Path) -> None:
    """The perceiver in C, and what the law makes of its points, are those of Python."""
    camera = {
        "columns": 80,
        "rows": 60,
        "focal": [75.0, 75.0],
        "centre": [39.5, 29.5],
        "position": [0.6, 0.0, 1.5],
        "orientation": [0.0, 1.0, 0.0, 0.0],
    }
    robot, rest = vff.Arm.named("panda"), [0.0] * 7
    table = vff.Obstacle.half_space([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    perceiver = vff.Perceiver(robot, [camera], {"stride": 1}, known=[table])
    columns, rows = np.meshgrid(np.arange(80), np.arange(60))
    for step in range(8):
        t = step / 30.0
        perceiver.observe(t, READY, rest)
        ball = (columns - 15 - step) ** 2 + (rows - 30) ** 2 < 30
        perceiver.see(np.where(ball, 900, 1500).astype(np.uint16), t)
    law = vff.Controller(robot, {"field": {"kind": "bounded", "gain": 40.0, "influence": 0.4}})
    cloud = [vff.Obstacle.points(np.empty((0, 3)), 0.018)]
    law.terms(READY, rest, [0.3, 0.0, 0.6], obstacles=cloud, t=t)
    law.update_points(perceiver.points, velocities=perceiver.velocities, t=perceiver.t)
    terms = law.terms(READY, rest, [0.3, 0.0, 0.6], obstacles=cloud, t=t)
    count, fastest = len(perceiver.points), perceiver.velocities[:, 0].max()
    assert count > 20 and fastest > 0.1 and 0.0 < min(terms.clearance) < 0.4
    expected = f"{count} points, up to {fastest:.2f} m/s, {min(terms.clearance):.3f} m from the arm\n"
    assert run([built / "camera"]) == expected


def test_types_of_the_header(prefix: Path, tmp_path: Path) -> None:
    """Through pkg-config, with every warning an error."""
    run([compiled(prefix, ROOT / "tests" / "c" / "header.cpp", tmp_path / "header")])


def test_the_loop_of_libfranka(prefix: Path, tmp_path: Path) -> None:
    """As the page has it, against stand-ins of libfranka's names; it never met libfranka."""
    page = (ROOT / "docs" / "c.md").read_text(encoding="utf-8")
    examples = re.findall(r"^```cpp\n(.*?)^```", page, re.MULTILINE | re.DOTALL)
    loop, touch = (example for example in examples if "franka::" in example)
    (tmp_path / "page.inc").write_text(loop, encoding="utf-8")
    (tmp_path / "touch.inc").write_text(touch, encoding="utf-8")
    run([compiled(prefix, ROOT / "tests" / "c" / "libfranka_loop.cpp", tmp_path / "loop", f"-I{tmp_path}")])


@pytest.mark.skipif(sys.platform != "linux", reason="seccomp is Linux's")
def test_a_cycle_makes_no_system_call(prefix: Path, tmp_path: Path) -> None:
    """The kernel kills the loop where it does; where memory is asked for in it, it is killed."""
    program = compiled(prefix, ROOT / "tests" / "c" / "no_system_call.c", tmp_path / "quiet")
    done = subprocess.run([program], capture_output=True, text=True, timeout=HANG)
    if done.returncode == 77:
        pytest.skip("the kernel does not offer seccomp")
    assert done.returncode == 0, done.stderr
    noisy = subprocess.run([program, "more"], capture_output=True, text=True, timeout=HANG)
    assert noisy.returncode == -signal.SIGKILL


def test_the_model_is_that_of_the_arm() -> None:
    ball = vff.Obstacle.sphere([-0.05, -0.6, 0.62], 0.08)
    assert MODEL.read_text(encoding="utf-8") == to_mjcf(_core.arm_model("panda"), [ball])


def test_lockstep(built: Path, tmp_path: Path) -> None:
    """C++ and Python drive MuJoCo along the same motion, while the ball approaches the elbow."""
    cycles = 3000
    run([built / "sweep", "--lockstep", tmp_path / "q.txt", "--cycles", str(cycles)])
    found = np.loadtxt(tmp_path / "q.txt")
    assert found.shape == (cycles, 8)

    settings = vff.Scenario.load("panda-sweep").to_dict()["controller"]  # as the example reads them
    model = mujoco.MjModel.from_xml_path(str(MODEL))
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    start = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]
    data.qpos[:] = start
    robot = vff.Arm.named("panda")
    controller = vff.Controller(robot, settings)
    reference = robot.pose(start)
    expected = np.empty((cycles, 7))
    nearest = np.inf
    for k in range(cycles):
        t = 0.001 * k
        rate = 2.0 * np.pi / 10.0
        place = np.array([-0.05, -0.6 * np.cos(rate * t), 0.62])
        velocity = np.array([0.0, 0.6 * rate * np.sin(rate * t), 0.0])
        ball = vff.Obstacle.sphere(place - velocity * t, 0.08, motion=vff.Motion.linear(velocity))
        expected[k] = data.qpos
        terms = controller.terms(data.qpos, data.qvel, reference, obstacles=[ball], t=t)
        nearest = min(nearest, min(terms.clearance))
        data.ctrl[:] = terms.tau
        data.mocap_pos[0] = place
        mujoco.mj_step(model, data)
    assert 0.0 < nearest < 0.2
    assert abs(expected - expected[0]).max() > 0.05, "nothing had to give way"
    assert abs(found[:, 0] - 0.001 * np.arange(cycles)).max() < 1e-12
    assert abs(found[:, 1:] - expected).max() < 1e-9


def test_out_of_the_shelf_before_an_emulated_franka(prefix: Path) -> None:
    """The plan of `panda-shelf` with its posture and governor: past the ball to its goal, without a reflex,
    with a stiffer law on the way, and a kilogram that is taken up and put down, and observed.
    """
    library = ctypes.CDLL(str(next((prefix / "lib").glob("libvffnull.so"))))
    number, pointer = ctypes.c_double, ctypes.c_void_p
    library.vff_controller_begin.argtypes = [pointer, number, pointer, ctypes.c_size_t]
    library.vff_controller_planned.argtypes = [pointer, pointer, ctypes.c_size_t, pointer]
    library.vff_controller_succeed.argtypes = [pointer, pointer, number]
    library.vff_controller_cycle.argtypes = [
        pointer, number, pointer, pointer, pointer, ctypes.c_size_t, pointer,
    ]  # fmt: skip
    library.vff_controller_external_torque.argtypes = [pointer, pointer, ctypes.c_size_t]
    library.vff_last_message.restype = ctypes.c_char_p

    def call(name: str, *given: object) -> None:
        assert getattr(library, name)(*given) == 0, library.vff_last_message()

    changes = {
        "controller.command": "of the robot",
        "controller.deadline": "unlimited",
        "controller.observer": {},
        "controller.touch": {"task": "reject", "null_space": "reject"},
    }
    weight = {"link": "tip", "force": [0.0, 0.0, -9.81], "start": 1.5, "duration": 2.5}
    shelf = vff.Scenario.load("panda-shelf").replace(**changes)
    controller, robot, stiffer = pointer(), pointer(), pointer()
    call("vff_controller_from_scenario", str(shelf).encode(), ctypes.byref(controller))
    call("vff_robot_named", b"panda", ctypes.byref(robot))
    settings = shelf.to_dict()["controller"] | {"stiffness": 400.0, "damping": 40.0, "posture": READY}
    text = _core.format_toml(settings).encode()
    call("vff_controller_successor", controller, robot, text, ctypes.byref(stiffer))
    there = franka.Robot(shelf.replace(wrenches=[weight]))
    driver = FrankaRobot(there)
    driver.begin()
    tau, planned, carried, phase, path_time = *np.zeros((3, 7)), ctypes.c_int(), number()
    least = np.inf
    call("vff_controller_begin", controller, 1e-3, None, 0)
    while phase.value != 7:  # VFF_PHASE_FINISHED
        t, *state = driver.read()
        q, dq = (np.ascontiguousarray(each) for each in state)
        call(
            "vff_controller_cycle", controller, t, q.ctypes.data, dq.ctypes.data, tau.ctypes.data, 7,
            ctypes.byref(phase),
        )  # fmt: skip
        driver.write(tau)
        least = min(least, there.body.clearance)
        if there.body.cycle == 3000:
            call("vff_controller_external_torque", controller, carried.ctypes.data, 7)
            held = shelf.arm.jacobian(there.body.q)[:3].T @ weight["force"]
            np.testing.assert_allclose(carried, held, atol=0.2)
        if there.body.cycle == 2000:
            call("vff_controller_succeed", controller, stiffer, 0.5)
        if there.body.cycle == round(1000 * (shelf.duration + 0.5)):
            call("vff_controller_planned", controller, planned.ctypes.data, 7, ctypes.byref(path_time))
            call("vff_controller_stop", controller)
            arrived = q
    driver.end()
    assert there.reflex is None and least > 0.0
    goal = shelf["reference"]["points"][-1]
    np.testing.assert_allclose(planned, goal, atol=1e-9)
    assert path_time.value < shelf.duration - 0.02, "the ball was waited for"
    assert abs(arrived - goal).max() < 0.05
    for free, each in (("controller", controller), ("controller", stiffer), ("robot", robot)):
        getattr(library, f"vff_{free}_free")(each)


@pytest.mark.parametrize(
    "options", [("--seconds", "10"), ("--seconds", "2", "--points")], ids=["ball", "points"]
)
def test_against_the_clock(built: Path, options: Sequence[str]) -> None:
    """It runs at 1 kHz, reports, and nothing touches the ball: where torques come late, its robot waits."""
    told = run([built / "sweep", *options])
    for line in ("jitter, robot wakes late by", "latency, state to torque", "compute, observe + torque"):
        assert re.search(rf"^{re.escape(line)} +p50 +[\d.]+ µs .* max +[\d.]+ µs$", told, re.MULTILINE), told
    clearance = re.search(r"^least clearance +([\d.]+) m", told, re.MULTILINE)
    assert clearance and float(clearance[1]) > 0.0, told
    cycles = re.match(r"(\d+) cycles of 0.001 s", told)
    assert cycles and int(cycles[1]) == 1000 * int(options[1])


@pytest.mark.parametrize("program", ["cost", "cost_cpp"])
def test_cost_is_told(built: Path, program: str) -> None:
    told = run([built / program, "2000"])
    assert re.search(r'"cycles": 2000, .*"p50": \d+, .*"max": \d+', told), told
