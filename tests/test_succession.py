"""Other laws in a loop that runs: gains, postures, loads and tools change without a step of the torque."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.errors import InputError, InputTypeError
from vffnull.robots.simulated import SimulatedRobot
from waiting import HANG, wait_for

READY = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]
PANDA = vff.Arm.named("panda")
SETTINGS: dict[str, Any] = {"task": "pose", "stiffness": 400.0, "damping": 40.0, "null_damping": 10.0}
SCENE: dict[str, Any] = {
    "duration": 10.0,
    "q0": READY,
    "arm": {"model": "panda"},
    "controller": SETTINGS,
    "reference": {"kind": "setpoint"},
    "simulation": {"dt": 1e-3, "control": "hold", "integrator": "semi_implicit_euler"},
}
TOLD = 2.0  # s


def changed(
    scene: Any,
    path: Path,
    *changes: tuple[float, vff.Controller],
    seconds: float = 4.0,
    arm: vff.Arm = PANDA,
    misses: int = 0,
) -> Any:
    """The rows of a drive, one a period, in which other controllers take over at these times.

    So many states are missing from there on: the one before comes again.
    """
    drive: list[vff.Drive] = []

    class Told:
        """The simulated robot, which tells when it is time."""

        def __init__(self) -> None:
            self.robot = SimulatedRobot(scene)
            self.left = list(changes)
            self.missing = 0
            self.before: Any = None

        def read(self) -> Any:
            state = self.robot.read()
            while self.left and drive and state[0] >= self.left[0][0]:
                drive[0].set_controller(self.left.pop(0)[1])
                self.missing = misses
            if self.missing:
                self.missing -= 1
                return self.before
            self.before = state
            return state

        def write(self, command: Any, /) -> None:
            self.robot.write(command)

    law = vff.Controller(arm, scene["controller"])
    around = scene.to_dict().get("obstacles", [])
    with vff.drive(Told(), law, obstacles=around, seconds=seconds, record_to=path, record_every=1) as driven:
        drive.append(driven)
        assert driven.wait(HANG)
    assert driven.report.status == "completed", driven.report.reason
    return vff.StreamRecorder.read(path).to_pandas()


def of(rows: Any, name: str) -> Any:
    return rows.filter(regex=f"^{name}_([0-9]|[xyz]$)").to_numpy()


def steps(rows: Any) -> Any:
    """How much the torque of some joint changes from period to period."""
    return np.abs(np.diff(of(rows, "tau_applied"), axis=0)).max(axis=1)


@pytest.mark.parametrize(
    "other",
    [
        vff.Controller(PANDA, SETTINGS | {"stiffness": 900.0, "damping": 60.0, "null_damping": 30.0}),
        vff.Controller(PANDA, SETTINGS | {"posture": [0.3, *READY[1:]], "posture_stiffness": 30.0}),
        vff.Controller(PANDA, SETTINGS | {"avoidance": "cbf", "yielding": {"preview": {}}}),
        vff.Controller(PANDA.with_load(2.0, com=[0.0, 0.0, 0.05]), SETTINGS),
        vff.Controller(PANDA.with_tool([0.0, 0.0, 0.3]), SETTINGS),
    ],
    ids=["gains", "posture", "avoidance", "load", "tool"],
)
def test_the_torque_makes_no_step(tmp_path: Path, other: vff.Controller) -> None:
    """With a ball that pushes the elbow, so that every term is there; the law after it is the other one."""
    ball = vff.Obstacle.sphere([-0.05, -0.3, 0.62], 0.08, vff.Motion.linear([0.0, 0.05, 0.0]))
    field = {"field": {"kind": "bounded", "gain": 20.0, "influence": 0.3}}
    scene = vff.Scenario.from_dict(SCENE | {"controller": SETTINGS | field}).replace(obstacles=[ball])
    rows = changed(scene, tmp_path / "run.arrows", (TOLD, other))
    k = int(np.searchsorted(rows["t"], TOLD))
    made = steps(rows)
    assert made[k - 2 : k + 4].max() < 0.1, "in the first cycles"
    assert made[k : k + 600].max() < 1.0
    late = rows[rows["t"] > TOLD + 1.0].iloc[100]
    q, dq = (np.array([late[f"{name}_{i}"] for i in range(7)]) for name in ("q", "dq"))
    pose = np.array([late[f"x_ref_{axis}"] for axis in "xyz"])
    turn = np.array([late[f"orientation_ref_{axis}"] for axis in "wxyz"])
    expected = other.terms(q, dq, (pose, turn), obstacles=[ball], t=late["t"])
    if expected.slack is None:  # a program with a memory of its own is not asked twice
        np.testing.assert_allclose([late[f"tau_{i}"] for i in range(7)], expected.tau, atol=1e-6)


@pytest.mark.parametrize(("told", "misses"), [(0.1, 0), (0.3, 0), (0.48, 0), (0.3, 2)])
def test_a_law_that_is_told_in_the_safe_start_waits_for_its_end(
    tmp_path: Path, told: float, misses: int
) -> None:
    """Its barriers, with a ball within their margin, act in full on what is blended in."""
    ball = vff.Obstacle.sphere([-0.02, -0.22, 0.63], 0.05)
    field = {"field": {"kind": "bounded", "gain": 0.0, "influence": 0.1}}
    scene = vff.Scenario.from_dict(SCENE | {"controller": SETTINGS | field}).replace(obstacles=[ball])
    keeps = vff.Controller(PANDA, SETTINGS | {"avoidance": "cbf", "yielding": {"margin": 0.12}})
    made = steps(changed(scene, tmp_path / "run.arrows", (told, keeps), seconds=1.6, misses=misses))
    begin = int(1e3 * told)
    assert made[begin - 2 : begin + 600].max() < 0.1 and made.max() > 1e-3


@pytest.mark.parametrize("told", [0.99, 1.02])
def test_a_load_that_is_told_about_a_stop_makes_no_step(tmp_path: Path, told: float) -> None:
    scene = vff.Scenario.from_dict(SCENE)
    loaded = vff.Controller(PANDA.with_load(3.0), SETTINGS)
    rows = changed(scene, tmp_path / "run.arrows", (told, loaded), seconds=1.0)
    assert rows["t"].iloc[-1] > 1.1 and steps(rows)[900:].max() < 0.2


def limited(**limits: Any) -> vff.Arm:
    """A Panda with other limits of its joints."""
    return vff.Scenario.from_dict(SCENE | {"arm": PANDA.to_dict() | limits}).arm


def test_a_joint_is_too_fast_for_the_arm_of_the_law_in_use(tmp_path: Path) -> None:
    """One that was slow before is not braked when it is faster than twice its speed then."""
    scene = vff.Scenario.from_dict(SCENE)
    aside = SETTINGS | {"posture": [0.8, *READY[1:]], "posture_stiffness": 60.0}
    change = (0.8, vff.Controller(PANDA, aside))
    slow = limited(velocity_limits=[0.05] * 7)
    rows = changed(scene, tmp_path / "run.arrows", change, seconds=3.0, arm=slow)
    assert np.abs(of(rows, "dq")).max() > 0.2


class Servo:
    """A robot that is where it is told to be."""

    command = "position"

    def __init__(self) -> None:
        self.t, self.q = 0.0, np.array(READY)

    def read(self) -> Any:
        return self.t, self.q, np.zeros(7)

    def write(self, command: Any, /) -> None:
        self.t, self.q = self.t + 1e-3, command.copy()


@pytest.mark.parametrize(
    "limits",
    [{"velocity_limits": [0.5] * 7}, {"joint_limits": [[q - 0.5, q + 0.5] for q in READY]}],
    ids=["speeds", "ranges"],
)
def test_set_points_keep_the_limits_of_their_arm(limits: dict[str, Any]) -> None:
    """A successor whose joints have others is refused, and one that carries something is not."""
    controller, moves = vff.Controller(PANDA, SETTINGS), {"acceleration": 8.0, "jerk": 400.0}
    with vff.drive(Servo(), controller, seconds=0.3, limits=moves) as drive:
        with pytest.raises(InputError, match="set points keep those of the arm that they began with"):
            drive.set_controller(vff.Controller(limited(**limits), SETTINGS))
        drive.set_controller(vff.Controller(PANDA.with_load(0.5), SETTINGS))
        assert drive.wait(HANG)
    assert drive.report.status == "completed", drive.report.reason


def test_a_load_is_taken_up_and_put_down(tmp_path: Path) -> None:
    """Two kilograms at the tip from 2 s to 4 s, as the force that they are: the hand stays where the law is
    told, and sinks where it is not.
    """
    weight = {"link": "tip", "force": [0.0, 0.0, -2.0 * 9.81], "start": TOLD, "duration": 2.0}
    scene = vff.Scenario.from_dict(SCENE | {"wrenches": [weight]})
    empty, loaded = (vff.Controller(arm, SETTINGS) for arm in (PANDA, PANDA.with_load(2.0)))
    told = changed(scene, tmp_path / "told.arrows", (TOLD, loaded), (TOLD + 2.0, empty), seconds=6.0)
    alone = changed(scene, tmp_path / "alone.arrows", seconds=6.0)

    def sunk(rows: Any, begin: float, end: float) -> float:
        part = rows[(rows["t"] > begin) & (rows["t"] < end)]
        return float(abs(part["x_z"] - rows["x_z"].iloc[1900]).max())

    assert sunk(alone, TOLD + 1.5, TOLD + 2.0) > 5e-3
    assert sunk(told, TOLD + 1.5, TOLD + 2.0) < 2e-4, "it is held"
    assert sunk(told, TOLD + 3.5, TOLD + 4.0) < 2e-4, "and let go"
    assert steps(told)[600:5900].max() < 1.0


def test_one_after_the_other() -> None:
    """What comes while a law is being left waits for it; the last one is that which drives."""
    scene = vff.Scenario.from_dict(SCENE)
    off = SimulatedRobot(scene.replace(q0=[0.0, -0.8, *READY[2:]]))
    with vff.drive(off, scene) as driven:
        wait_for(lambda: driven.state.phase == "running")
        for stiffness in (100.0, 200.0, 900.0):
            driven.set_controller(vff.Controller(PANDA, SETTINGS | {"stiffness": stiffness}), blend=0.2)
        begun = driven.state.t
        wait_for(lambda: driven.state.t > begun + 1.0)
        state = driven.state
    last = vff.Controller(PANDA, SETTINGS | {"stiffness": 900.0})
    expected = last.torque(state.q, state.dq, state.x_ref)
    np.testing.assert_allclose(state.tau, expected, atol=1e-9)
    assert driven.report.status == "stopped"


def test_what_does_not_suit_the_loop_is_refused() -> None:
    scene = vff.Scenario.from_dict(SCENE)
    with vff.drive(SimulatedRobot(scene), scene) as driven:
        for other, says in (
            (vff.Controller(vff.Arm.named("ur5e"), SETTINGS), "keeps its joints"),
            (vff.Controller(PANDA, {"task": "position"}), "its task"),
            (vff.Controller(PANDA, SETTINGS | {"command": {"blend_time": 0.2}}), "command"),
        ):
            with pytest.raises(InputError, match=says):
                driven.set_controller(other)
        with pytest.raises(InputTypeError, match="expected a Controller"):
            driven.set_controller(SETTINGS)  # type: ignore[arg-type]
        with pytest.raises(InputError, match="blend"):
            driven.set_controller(vff.Controller(PANDA, SETTINGS), blend=-1.0)
    assert driven.report.status == "stopped"


def test_arms_with_loads_and_tools() -> None:
    """A load is a body of the last link: weight and inertia are those of the plant that carries it."""
    com, inertia = [0.02, -0.01, 0.05], [2e-3, 3e-3, 2.5e-3, 1e-4, 0.0, 2e-4]
    loaded = PANDA.with_load(1.5, com=com, inertia=inertia)
    payload = {"mass": 1.5, "com": com, "inertia": inertia}
    plant = vff.Scenario.from_dict(SCENE | {"plant": {"payload": payload}}).plant
    np.testing.assert_array_equal(loaded.mass_matrix(READY), plant.mass_matrix(READY))
    np.testing.assert_array_equal(loaded.gravity_torque(READY), plant.gravity_torque(READY))
    assert vff.Arm.named("panda").masses[-1] == PANDA.masses[-1]
    place, turn = PANDA.with_tool([0.0, 0.0, 0.0]).pose(READY)
    longer = PANDA.with_tool([0.0, 0.0, 0.2], [1.0, 0.0, 0.0, 0.0]).pose(READY)
    assert np.linalg.norm(longer[0] - place) == pytest.approx(0.2)
    np.testing.assert_allclose(longer[1], turn, atol=1e-12)
    rod = vff.Arm.uniform(3, gravity=9.81)
    assert rod.with_load(2.0).gravity_torque([0.0] * 3)[0] == pytest.approx(
        rod.gravity_torque([0.0] * 3)[0] + 2.0 * 9.81 * 3.0
    )
    for wrong, says in (
        (lambda: PANDA.with_load(-1.0), "mass"),
        (lambda: PANDA.with_load(1.0, inertia=[1.0, 0.1, 0.1, 0.0, 0.0, 0.0]), "inertia"),
        (lambda: PANDA.with_tool([0.0] * 3, [2.0, 0.0, 0.0, 0.0]), "tool"),
        (lambda: rod.with_tool([0.1, 0.0, 0.0]), "plane"),
        (lambda: rod.with_load(1.0, com=[0.1, 0.0, 0.0]), "plane"),
    ):
        with pytest.raises(InputError, match=says):
            wrong()


def test_another_robot_is_refused() -> None:
    """One with as many joints: its weights and limits are others."""
    with vff.drive(SimulatedRobot(SCENE), vff.Controller(PANDA, SETTINGS), seconds=0.2) as drive:
        with pytest.raises(InputError, match="keeps its joints, by number and name"):
            drive.set_controller(vff.Controller(vff.Arm.named("iiwa14"), SETTINGS))
        drive.set_controller(vff.Controller(vff.Arm.named("panda"), SETTINGS))
        assert drive.wait(HANG)
    assert drive.report.status == "completed"
