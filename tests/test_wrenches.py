"""Forces from outside push every plant alike, are felt and measured (docs/theory.md, T143 to T145)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull.robots.emulated.body import Body, Disturbances
from vffnull.robots.simulated import SimulatedRobot

Array = np.ndarray[Any, np.dtype[np.float64]]

PANDA = vff.Scenario.load("panda-sweep").replace(obstacles=None)
FORCE = np.array([5.0, 10.0, -8.0])
TIP = vff.Wrench("tip", force=FORCE, start=0.5)
PLANE: dict[str, Any] = {
    "duration": 1.0,
    "q0": [0.3, 0.9, -0.6],
    "arm": {"lengths": [1.0, 0.8, 0.6], "masses": [2.0, 1.5, 1.0], "gravity": 9.81},
    "controller": {"stiffness": 100.0, "damping": 20.0, "null_damping": 4.0},
    "reference": {"kind": "setpoint", "point": [1.5, 1.7]},
}
LEANING = [
    vff.Wrench(
        "panda_link4",
        force=[0.0, 20.0, 5.0],
        point=[0.01, 0.02, 0.03],
        torque=[1.0, 2.0, 3.0],
        frame="link",
        start=0.2,
        duration=0.6,
        profile={"kind": "ramp", "rise": 0.1, "fall": 0.2},
    ),
    vff.Wrench("tip", force=[3.0, 0.0, 2.0], torque=[0.0, 1.0, 0.0], point=[0.0, 0.0, 0.1],
               profile={"kind": "sinusoid", "angular_frequency": 5.0}),
]  # fmt: skip


def mobility(arm: vff.Arm, q: Array, rows: int) -> Array:
    """Λ⁻¹ of the first rows of the task."""
    J = arm.jacobian(q)[:rows]
    return np.asarray(J @ np.linalg.solve(arm.mass_matrix(q), J.T))


@pytest.mark.parametrize(("task", "rows"), [("position", 3), ("pose", 6)])
def test_at_rest_it_stands_off_by_the_mobility_over_the_stiffness(task: str, rows: int) -> None:
    """T144: e = K⁻¹ Λ⁻¹ f."""
    result = vff.simulate(PANDA, {"controller.task": task, "wrenches": [TIP]})
    assert np.abs(result.dq[-1]).max() < 1e-3
    inverse = mobility(PANDA.arm, result.q[-1], rows)
    expected = inverse[:, :3] @ FORCE / 900.0
    assert np.linalg.norm(expected[:3]) > 0.01
    np.testing.assert_allclose(result.error[-1], expected, atol=2e-6)


def test_of_a_force_on_the_elbow_the_hand_feels_what_is_let_through() -> None:
    push = vff.Wrench("panda_link4", force=[0.0, 15.0, 0.0])
    result = vff.simulate(PANDA, {"wrenches": [push]})
    q, arm = result.q[-1], PANDA.arm
    assert result.tau_ext is not None
    felt = arm.jacobian(q) @ np.linalg.solve(arm.mass_matrix(q), result.tau_ext[-1])
    np.testing.assert_allclose(result.error[-1], felt / 900.0, atol=1e-6)
    assert np.abs(q - result.q[0]).max() > 0.05  # the elbow gives way


def work_and_energy(scenario: Any, force: Array, plane: bool) -> tuple[float, float]:
    """Work of motors and of a constant force on the tip [J], and the energy gained [J]; a row per step."""
    result = vff.simulate(scenario)
    motors = float((result.tau[:-1] * np.diff(result.q, axis=0)).sum())
    size = 2 if plane else 3
    outside = float(force @ (result.x[-1] - result.x[0])[:size])
    energy = result.energy[:, 0] + result.energy[:, 1]
    return motors + outside, float(energy[-1] - energy[0])


@pytest.mark.parametrize("plane", [True, False])
def test_energy_is_what_was_worked(plane: bool) -> None:
    """Motors hold their torque over a step, and a constant force works along the way of its point."""
    changes = {"integrator": "rk4", "control": "hold", "record_every": 1, "dt": 1e-3}
    if plane:
        force = np.array([4.0, -3.0])
        scenario = PLANE | {"simulation": changes, "wrenches": [{"link": "tip", "force": list(force)}]}
    else:
        force = FORCE
        document = PANDA.to_dict()
        push = {"link": "tip", "force": list(force)}
        scenario = document | {"simulation": changes, "duration": 1.0, "wrenches": [push]}
    worked, gained = work_and_energy(scenario, force, plane)
    assert abs(worked) > 0.05
    assert worked == pytest.approx(gained, rel=1e-6)


def share(profile: dict[str, Any], t: Array) -> Array:
    """What acts of a profile t seconds after its start, over two seconds."""
    match profile["kind"]:
        case "ramp":
            return np.clip(np.minimum(t / profile["rise"], (2.0 - t) / profile["fall"]), 0.0, 1.0)
        case "sinusoid":
            return np.sin(profile["angular_frequency"] * t + profile["phase"])
        case "table":
            return np.interp(t, profile["times"], profile["factors"])
        case _:
            return np.ones_like(t)


@pytest.mark.parametrize(
    "profile",
    [
        {"kind": "constant"},
        {"kind": "ramp", "rise": 0.4, "fall": 0.8},
        {"kind": "sinusoid", "angular_frequency": 7.0, "phase": 0.3},
        {"kind": "table", "times": [0.1, 0.5, 1.5], "factors": [0.2, -1.0, 0.5]},
    ],
    ids=lambda profile: profile["kind"],
)
def test_profiles(profile: dict[str, Any]) -> None:
    """Over each step of the plant acts what holds in its middle, and nothing before and after."""
    push = vff.Wrench("tip", force=[0.0, 6.0, 0.0], start=0.3, duration=2.0, profile=profile)
    result = vff.simulate(PANDA, {"wrenches": [push], "duration": 2.6})
    assert result.tau_ext is not None
    J = PANDA.arm.jacobian(result.q[-1])  # the last one is enough to know how large it is
    assert np.abs(J[1]).max() > 0.3
    since = result.t + 0.0005 - 0.3
    acts = (since > 0.0) & (since < 2.0)
    factor = np.where(acts, share(profile, since), 0.0)
    full = np.array([6.0 * PANDA.arm.jacobian(q)[1] for q in result.q])
    np.testing.assert_allclose(result.tau_ext, factor[:, None] * full, atol=1e-12)


def test_torques_are_those_of_virtual_work() -> None:
    """In link and world axes, with a point and a torque: τ·δq is the work along δq, found by differences."""
    arm, rng = PANDA.arm, np.random.default_rng(5)
    q, h = np.asarray(PANDA["q0"]) + 0.2 * rng.standard_normal(7), 1e-6
    point, force, torque = rng.standard_normal((3, 3))
    for link, frame in [("panda_link5", "link"), ("panda_link5", "world"), ("tip", "link"), ("tip", "world")]:

        def pose(q: Array, link: str = link) -> Array:
            if link == "tip":
                return np.asarray(arm.tip_poses(q[None])[0])
            return np.asarray(arm.link_poses(q[None])[0, arm.link_names.index(link)])

        R, p = pose(q)[:3, :3], pose(q) @ np.r_[point, 1.0]
        f, m = (R @ force, R @ torque) if frame == "link" else (force, torque)
        expected = np.zeros(7)
        for i in range(7):
            more, less = pose(q + h * np.eye(7)[i]), pose(q - h * np.eye(7)[i])
            dp = (more - less) @ np.r_[point, 1.0] / (2 * h)
            dR = (more - less)[:3, :3] @ R.T / (2 * h)
            omega = np.array([dR[2, 1], dR[0, 2], dR[1, 0]])
            expected[i] = f @ dp[:3] + m @ omega
        assert np.linalg.norm(p) > 0.1
        simulation = vff.Simulation(PANDA.replace(q0=q))
        pushed = simulation.push(vff.Wrench(link, force=force, torque=torque, point=point, frame=frame))
        np.testing.assert_allclose(pushed.tau_ext, expected, atol=1e-8)


def test_in_the_plane_too() -> None:
    """A force at a point of a link, in its axes, and a torque: by hand."""
    simulation = vff.Simulation(vff.Scenario.from_dict(PLANE))
    push = {"link": "link_2", "point": [0.3, 0.1], "force": [2.0, 5.0], "torque": 0.7, "frame": "link"}
    state = simulation.push(push)
    angle = 0.3 + 0.9
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    joints = np.array([[0.0, 0.0], [np.cos(0.3), np.sin(0.3)]])
    place, force = joints[1] + R @ [0.3, 0.1], R @ [2.0, 5.0]
    arms = place - joints
    moments = arms[:, 0] * force[1] - arms[:, 1] * force[0] + 0.7
    np.testing.assert_allclose(state.tau_ext, [*moments, 0.0], atol=1e-12)


def test_as_pinocchio_has_it() -> None:
    """Acceleration under a torque and two wrenches, against articulated bodies with external forces."""
    pinocchio = pytest.importorskip("pinocchio")
    arm = PANDA.arm
    model = pinocchio.buildModelFromXML(arm.to_urdf())
    data = model.createData()
    rng = np.random.default_rng(2)
    q, dq = np.asarray(PANDA["q0"]) + 0.1 * rng.standard_normal(7), rng.standard_normal(7)
    tau, h = 10.0 * rng.standard_normal(7), 1e-3
    numbers = rng.standard_normal((2, 3, 3))
    links = ["panda_link3", "panda_link6"]
    outside = [pinocchio.Force.Zero() for _ in range(model.njoints)]
    for link, (point, force, torque) in zip(links, numbers, strict=True):
        placement = pinocchio.SE3(np.eye(3), point)
        outside[1 + arm.link_names.index(link)] = placement.act(pinocchio.Force(force, torque))
    expected = pinocchio.aba(model, data, q, dq, tau, outside)
    simulation = vff.Simulation(PANDA.replace(q0=q, dq0=dq))
    for link, (point, force, torque) in zip(links, numbers, strict=True):
        simulation.push(vff.Wrench(link, force=force, torque=torque, point=point, frame="link"))
    state = simulation.step(tau)
    np.testing.assert_allclose((state.dq - dq) / h, expected, rtol=1e-7, atol=1e-7)


def test_mujoco_is_pushed_alike() -> None:
    """Its `xfrc_applied`, which it holds over a step, as our plant's semi-implicit Euler does."""
    pytest.importorskip("mujoco")
    changes = {"wrenches": LEANING, "duration": 1.0}
    ours, theirs = (vff.simulate(PANDA, changes, plant=plant) for plant in ("core", "mujoco"))
    assert np.abs(ours.q - ours.q[0]).max() > 0.02
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-9)
    flat = PLANE | {
        "simulation": {"integrator": "semi_implicit_euler", "control": "hold"},
        "wrenches": [
            {"link": "link_2", "point": [0.3, 0.1], "force": [9.0, 6.0], "torque": 1.0, "frame": "link"},
            {"link": "tip", "force": [1.0, -4.0], "profile": {"kind": "ramp", "rise": 0.5}},
        ],
    }
    ours, theirs = (vff.simulate(flat, plant=plant) for plant in ("core", "mujoco"))
    np.testing.assert_allclose(theirs.q, ours.q, atol=1e-9)


def test_the_observer_finds_what_pushes() -> None:
    """Within 5 % of a step in 5 ms, in the end exactly; at the tip as the wrench itself."""
    changes = {"wrenches": [TIP], "controller.observer": {"bandwidth": 600.0}, "simulation.record_every": 1}
    result = vff.simulate(PANDA, changes | {"duration": 3.0})
    assert result.tau_ext is not None and result.tau_ext_estimate is not None
    assert result.wrench_estimate is not None
    row = int(np.searchsorted(result.t, 0.5 + 0.0055))
    off = np.linalg.norm(result.wrench_estimate[row, :3] - FORCE)
    assert off < 0.05 * np.linalg.norm(FORCE)
    np.testing.assert_allclose(result.tau_ext_estimate[-1], result.tau_ext[-1], atol=2e-3)
    np.testing.assert_allclose(result.wrench_estimate[-1], [*FORCE, 0.0, 0.0, 0.0], atol=5e-3)
    assert result.layout.unit("wrench_estimate", "x") == "N"
    assert result.layout.unit("wrench_estimate", "rx") == "N·m"


REAL: dict[str, Any] = {
    "plant.viscous_friction": 0.3,
    "plant.coulomb_friction": 0.1,
    "measurement": {"position_noise": 1e-5, "velocity_noise": 1e-3},
    "controller.command": {"coulomb_friction": 0.08, "viscous_friction": 0.3},
}
"""Friction that is compensated but for a fifth, and noise of encoders."""


DRY = np.array([0.87] * 4 + [0.12] * 3)  # N·m, a hundredth of the largest torques


@pytest.mark.parametrize(
    ("changes", "newtons", "moment"),
    [
        ({}, 1.0, 0.1),
        # As in docs/emulated.md: four fifths of that friction are compensated, and ten times the noise.
        (
            {
                "plant.viscous_friction": 0.0,
                "plant.coulomb_friction": DRY.tolist(),
                "controller.command": {"coulomb_friction": (0.8 * DRY).tolist()},
                "measurement": {"position_noise": 1e-5, "velocity_noise": 1e-2},
            },
            2.5,
            0.3,
        ),
    ],
    ids=["light", "emulated"],
)
def test_the_floor_of_the_estimate(changes: dict[str, Any], newtons: float, moment: float) -> None:
    """In motion, with friction and noise, while nothing pushes, in the mean: what is left of friction."""
    observed = {"controller.observer": {"bandwidth": 20.0}, "simulation.record_every": 1}
    result = vff.simulate("panda-sweep", REAL | changes | observed)
    assert result.wrench_estimate is not None
    row = result.t > 0.5
    assert np.linalg.norm(result.wrench_estimate[row, :3], axis=1).mean() < newtons
    assert np.linalg.norm(result.wrench_estimate[row, 3:], axis=1).mean() < moment


def test_the_hand_holds_with_friction_noise_and_errors() -> None:
    """Within a millimetre under 20 N at the elbow, with links that are up to 5 % off."""
    random = np.random.default_rng(1)
    push = vff.Wrench("panda_link4", force=[0.0, 20.0, 0.0], start=0.5, profile={"kind": "ramp", "rise": 0.5})
    masses = PANDA.arm.masses * (1.0 + 0.05 * random.uniform(-1.0, 1.0, 7))
    touch = {"task": "reject", "null_space": "comply"}
    changes = REAL | {"plant.masses": masses.tolist(), "wrenches": [push], "controller.touch": touch}
    result = vff.simulate(PANDA, changes | {"controller.observer": {"bandwidth": 80.0}})
    off = np.linalg.norm(result.error[:, :3], axis=1)
    assert off[result.t > 0.5].max() < 1e-3


@pytest.mark.parametrize("source", ["momentum", "measured"])
def test_the_hand_holds_against_a_push(source: str) -> None:
    """Rejected, somebody who leans on the elbow with 20 N moves the hand by 4 µm and the elbow by 17 cm."""
    push = vff.Wrench("panda_link4", force=[0.0, 20.0, 0.0], start=0.5, profile={"kind": "ramp", "rise": 0.5})
    observed = {"controller.observer": {"source": source, "bandwidth": 300.0}, "wrenches": [push]}
    complying = vff.simulate(PANDA, observed)
    holding = vff.simulate(PANDA, observed | {"controller.touch": {"task": "reject"}})
    off = [np.linalg.norm(result.error[:, :3], axis=1).max() for result in (complying, holding)]
    assert off[0] > 2e-4
    assert off[1] < 1e-5
    elbow = PANDA.arm.link_poses(holding.q[[0, -1]])[:, 3, :3, 3]
    assert np.linalg.norm(elbow[1] - elbow[0]) > 0.15


def test_what_is_measured_is_followed() -> None:
    """ṙ = K (τ − r), and at once from the first measurement."""
    changes = {"controller.observer": {"source": "measured", "bandwidth": 50.0}, "simulation.record_every": 1}
    result = vff.simulate(PANDA, changes | {"wrenches": [TIP], "duration": 1.0})
    assert result.tau_ext is not None and result.tau_ext_estimate is not None
    r = np.zeros(7)
    gain = 1.0 - np.exp(-50.0 * 1e-3)
    for k in range(1, len(result.t)):
        r += gain * (result.tau_ext[k - 1] - r)
        np.testing.assert_allclose(result.tau_ext_estimate[k], r, atol=1e-12)
    controller = vff.Controller(PANDA.arm, {"observer": {"source": "measured"}})
    q, pose = PANDA["q0"], PANDA.arm.pose(PANDA["q0"])
    told = np.arange(7.0)
    controller.sense(told)
    controller.torque(q, np.zeros(7), pose[0])
    np.testing.assert_array_equal(controller.tau_ext_estimate, told)
    controller.sense(np.full(7, np.nan))  # changes nothing
    controller.torque(q, np.zeros(7), pose[0], t=1.0)
    np.testing.assert_array_equal(controller.tau_ext_estimate, told)
    with pytest.raises(vff.errors.InputError, match="tau_ext"):
        controller.sense([1.0])


def test_a_watched_loop_counts_with_it() -> None:
    """`cycle` sends the opposite of what is rejected."""
    settings = {"observer": {"source": "measured", "bandwidth": 1e3}, "command": {"blend_time": 0.0}}
    q, told = PANDA["q0"], np.array([0.0, 3.0, 0.0, -2.0, 0.0, 0.0, 0.0])
    sent = []
    for touch in ({}, {"task": "reject", "null_space": "reject"}):
        controller = vff.Controller(PANDA.arm, settings | {"touch": touch})
        controller.begin(0.001)
        for k in range(20):
            controller.sense(told)
            tau, _ = controller.cycle(0.001 * k, q, np.zeros(7), PANDA.arm.pose(q)[0])
        sent.append(tau)
    np.testing.assert_allclose(sent[1] - sent[0], -told, atol=1e-6)


class Deaf:
    """A robot that measures nothing from outside."""

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot

    def read(self) -> Any:
        return self._robot.read()

    def write(self, command: Array) -> None:
        self._robot.write(command)


class Measuring(Deaf):
    """One that does."""

    def external_torque(self) -> Array:
        return self._robot.external_torque()


class Broken(Measuring):
    """One that begins to measure what is no number."""

    asked = 0

    def external_torque(self) -> Array:
        self.asked += 1
        return super().external_torque() * (np.nan if self.asked > 100 else 1.0)


def driven(robot: Any, tmp_path: Path) -> Any:
    document = {**PANDA["controller"], "observer": {"source": "measured", "bandwidth": 200.0}}
    controller = vff.Controller(PANDA.arm, document | {"touch": {"task": "reject"}})
    with vff.drive(robot, controller, seconds=0.4) as drive:
        drive.wait()
    return drive


def test_a_drive_asks_its_robot(tmp_path: Path) -> None:
    scenario = PANDA.replace(wrenches=[vff.Wrench("tip", force=FORCE)])
    for wrapped in (lambda robot: robot, Measuring):
        drive = driven(wrapped(SimulatedRobot(scenario)), tmp_path)
        assert drive.report.status == "completed", drive.report
    with pytest.warns(RuntimeWarning, match="measures no torque from outside"):
        assert driven(Deaf(SimulatedRobot(scenario)), tmp_path).report.status == "fault"
    with pytest.warns(RuntimeWarning, match="external_torque is not finite"):
        assert driven(Broken(SimulatedRobot(scenario)), tmp_path).report.status == "fault"


class Held:
    """A robot that stands where it was told to, paces the loop, and measures a push."""

    paces, gravity = True, "robot"

    def __init__(self, command: str) -> None:
        self.command, self.push = command, 5.0
        self.t, self.q = 0.0, np.array(PANDA["q0"], dtype=float)
        self.told: list[Array] = []
        self.drive: vff.Drive | None = None
        self.known, self.act = 0, lambda k, drive: None

    def read(self) -> Any:
        if self.drive is not None:
            self.known += 1
            self.act(self.known, self.drive)
        return self.t, self.q, np.zeros(7)

    def external_torque(self) -> Array:
        return np.array([0.0, -self.push, 0.0, 0.0, 0.0, 0.0, 0.0])

    def write(self, command: Array) -> None:
        self.told.append(command.copy())
        self.t += 2e-3
        if self.command == "position":
            self.q = command.copy()


def test_a_robot_of_set_points_gives_way_to_what_it_measures() -> None:
    """Nobody took in what it had been asked for."""
    settings = {"stiffness": 100.0, "damping": 20.0, "touch": {"task": "comply"}}
    law = vff.Controller(PANDA.arm, settings | {"observer": {"source": "measured", "bandwidth": 20.0}})
    robot = Held("position")
    with vff.drive(robot, law, 500.0, seconds=0.5, limits={"acceleration": 5.0, "jerk": 500.0}) as drive:
        drive.wait()
    assert drive.report.status == "completed", drive.report
    assert drive.state.tau_ext_estimate[1] == pytest.approx(-5.0, abs=0.1)
    assert np.abs(robot.q - PANDA["q0"]).max() > 0.1
    assert (np.array(robot.told[-1]) == robot.q).all()


def test_a_law_that_is_being_left_hears_of_the_end_of_a_push() -> None:
    """The robot is asked as long as it has a share, though the next law does not listen."""
    settings = {"stiffness": 100.0, "damping": 20.0, "command": {"gravity": "robot", "blend_time": 0.1}}
    listens = {"observer": {"source": "measured", "bandwidth": 50.0}}
    rejects = {"touch": {"task": "reject", "null_space": "reject"}}
    robot = Held("torque")
    law = vff.Controller(PANDA.arm, settings | listens | rejects)
    next_law = vff.Controller(PANDA.arm, settings)

    def act(k: int, drive: vff.Drive) -> None:
        if k == 300:
            drive.set_controller(next_law, blend=2.0)
        if k == 350:
            robot.push = 0.0
        if k == 500:
            drive.stop()

    robot.act = act
    with vff.drive(robot, law, 500.0) as drive:
        robot.drive = drive
        drive.wait()
    assert drive.report.status == "stopped"
    begun = len(robot.told) - robot.known
    assert np.abs(robot.told[begun + 340]).max() > 3.0  # most of it is still of the law that rejects the push
    assert np.abs(robot.told[begun + 490]).max() < 0.1


@pytest.mark.parametrize("physics", ["own", "mujoco"])
def test_an_emulated_robot_is_pushed(physics: Any) -> None:
    """A free arm in the emulator's body comes where the same arm in a simulation comes."""
    if physics == "mujoco":
        pytest.importorskip("mujoco")
    scenario = PANDA.replace(wrenches=LEANING, duration=1.0)
    body = Body(scenario, 1000.0, Disturbances(), physics)
    simulation = vff.Simulation(scenario.replace(**{"plant.joint_stops": False}))
    hold = scenario.arm.gravity_torque(scenario["q0"])
    for _ in range(400):
        body.move(hold)
        state = simulation.step(hold)
    assert np.abs(body.q - scenario["q0"]).max() > 0.02
    np.testing.assert_allclose(body.q, state.q, atol=1e-9)


def test_a_push_is_over_when_it_is_over() -> None:
    simulation = vff.Simulation(PANDA)
    assert simulation.state.tau_ext is None
    for _ in range(10):
        simulation.step()
    state = simulation.push(vff.Wrench("tip", force=FORCE, start=0.01, duration=0.02))
    acted = []
    for _ in range(40):
        acted.append(bool(np.abs(state.tau_ext).max() > 0.0))
        state = simulation.step()
    assert acted == [10 <= k < 30 for k in range(40)]
    for _ in range(3000):  # those that are over are forgotten
        simulation.push({"link": "tip", "force": [0.0, 0.0, 1.0], "duration": 1e-4})
        state = simulation.step()
    assert simulation.reset().tau_ext is None
    with pytest.raises(vff.errors.ScenarioError, match=r"1000 of them push already"):
        for _ in range(1001):
            simulation.push({"link": "tip"})
    simulation.reset()
    with pytest.raises(vff.errors.ScenarioError, match=r"wrench\.link: unknown value `hand`.*`panda_link1`"):
        simulation.push({"link": "hand"})


@pytest.mark.parametrize(
    ("wrench", "message"),
    [
        ({"link": "lin_2"}, r"wrenches\[0\]\.link.*did you mean `link_2`\? Allowed: `link_1`.*`tip`"),
        ({"force": [1.0, 0.0]}, r"wrenches\[0\]: missing key `link`"),
        ({"link": "tip", "force": [1.0]}, r"wrenches\[0\]\.force: expected 2 values"),
        (
            {"link": "tip", "force": [1.0, float("nan")]},
            r"wrenches\[0\]\.force\[1\]: must be a finite number",
        ),
        ({"link": "tip", "torque": [1.0, 0.0, 0.0]}, r"wrenches\[0\]\.torque"),
        ({"link": "tip", "start": -1.0}, r"wrenches\[0\]\.start: must be 0 or more"),
        ({"link": "tip", "duration": 0.0}, r"wrenches\[0\]\.duration: must be greater than 0"),
        ({"link": "tip", "frame": "tool"}, r"wrenches\[0\]\.frame: unknown value `tool`"),
        ({"link": "tip", "profile": {"kind": "ramp", "rise": 1.0, "fall": 1.0}}, r"fall: needs `duration`"),
        (
            {"link": "tip", "duration": 1.0, "profile": {"kind": "ramp", "rise": 0.7, "fall": 0.7}},
            r"wrenches\[0\]\.duration: must be at least as long",
        ),
        ({"link": "tip", "profile": {"kind": "table", "times": [], "factors": []}}, "at least one time"),
        (
            {"link": "tip", "profile": {"kind": "table", "times": [0.0, 0.0], "factors": [1.0, 1.0]}},
            r"profile\.times\[1\]: must be after the one before",
        ),
        (
            {"link": "tip", "profile": {"kind": "table", "times": [0.0, 1.0], "factors": [1.0]}},
            r"profile\.factors: expected 2 values",
        ),
    ],
)
def test_what_is_no_wrench(wrench: dict[str, Any], message: str) -> None:
    with pytest.raises(vff.errors.ScenarioError, match=message):
        vff.Scenario.from_dict(PLANE | {"wrenches": [wrench]})


def test_what_is_odd_is_told() -> None:
    with pytest.raises(vff.errors.ScenarioError, match="at most 1000"):
        vff.Scenario.from_dict(PLANE | {"wrenches": [{"link": "tip"}] * 1001})
    with pytest.warns(vff.errors.ScenarioWarning, match=r"wrenches\[0\]\.start: 2 s, when the run is over"):
        vff.simulate(PLANE | {"wrenches": [{"link": "tip", "start": 2.0, "force": [1.0, 0.0]}]})
    with pytest.raises(vff.errors.ScenarioError, match="duration"):
        vff.Wrench("tip", force=[1.0, 0.0], duration=-1.0)


def test_it_is_recorded_where_there_is_any(tmp_path: Path) -> None:
    without = vff.simulate(PANDA, {"duration": 0.2})
    assert without.tau_ext is None and without.wrench_estimate is None
    observed = {"duration": 0.7, "wrenches": [TIP], "controller.observer": {}}
    result = vff.simulate(PANDA, observed)
    for ending in ("npz", "csv"):
        back = vff.Result.load(result.save(tmp_path / f"run.{ending}"))
        for name in ("tau_ext", "tau_ext_estimate", "wrench_estimate"):
            np.testing.assert_array_equal(getattr(back, name), getattr(result, name))
    assert vff.Scenario.from_dict(result.scenario.to_dict()) == result.scenario


def test_it_is_drawn(tmp_path: Path) -> None:
    """In films, reports and pictures as an arrow from its point along the force."""
    from vffnull.draw.primitives import Arrow
    from vffnull.draw.scene import Scene

    result = vff.simulate(PANDA, {"duration": 0.7, "wrenches": [TIP]})
    scene = Scene.of_result(result)
    assert scene.strengths.max() == pytest.approx(np.linalg.norm(FORCE))
    (drawn,) = scene.pick(np.array([0, len(result.t) - 1])).at(1, ["wrench"])
    assert isinstance(drawn, Arrow)
    inside = result.x[-1] - drawn.place  # it ends where the line of the force enters the hand
    assert 0.0 < np.linalg.norm(inside) < 0.1
    assert inside @ FORCE == pytest.approx(np.linalg.norm(inside) * np.linalg.norm(FORCE))
    np.testing.assert_allclose(drawn.drawn(0.01)[0], drawn.place - 0.01 * FORCE, atol=1e-12)
    np.testing.assert_allclose(drawn.vector, FORCE, atol=1e-12)
    page = result.report(tmp_path / "run.html").read_text(encoding="utf-8")
    assert "From 0.5 s to the end, tip is pushed from outside with 13.7 N" in page


def null_speed(arm: vff.Arm, q: Array, dq: Array) -> float:
    """‖N q̇‖."""
    J, M = arm.jacobian(q)[:2], arm.mass_matrix(q)
    Y = np.linalg.solve(M, J.T)
    return float(np.linalg.norm(dq - Y @ np.linalg.solve(J @ Y, J @ dq)))


def test_push_through_is_decoupled() -> None:
    """What the paper's (13) to (15) say of f(t) and of a torque on the arm (T14, T15).

    A force on the end effector moves it by ë + D ė + K e = Λ⁻¹ f, and drives no null motion; a push on a link
    drives that.
    """
    result = vff.simulate("push-through")
    arm = result.scenario.arm
    assert result.wrench_estimate is not None and result.tau_ext is not None
    speeds = np.array([null_speed(arm, q, dq) for q, dq in zip(result.q[::50], result.dq[::50], strict=True)])
    pushed = result.t[::50] < 5.9
    assert np.abs(result.dq[result.t < 5.9]).max() > 0.5
    assert speeds[pushed].max() < 1e-4
    assert speeds[~pushed].max() > 1.0
    ddx = np.gradient(result.dx, result.t, axis=0)
    for k in (1200, 2000, 3100, 6500, 7500):
        assert result.force[k].max() == 0.0 or k > 6000
        J = arm.jacobian(result.q[k])[:2]
        driven = J @ np.linalg.solve(arm.mass_matrix(result.q[k]), result.tau_ext[k])
        assert np.linalg.norm(driven) > 0.05
        impedance = ddx[k] + 8.0 * result.dx[k] + 16.0 * result.error[k]
        np.testing.assert_allclose(impedance, driven, rtol=2e-3, atol=2e-3)
    assert result.metrics["min_clearance"] > 0.5  # the law avoids meanwhile


def test_panda_lean() -> None:
    """The elbow sways, the hand that holds a cup stays, and the post is avoided meanwhile."""
    result = vff.simulate("panda-lean")
    elbow = result.scenario.arm.link_poses(result.q)[:, 3, 1, 3]
    assert np.ptp(elbow) > 0.3
    assert np.linalg.norm(result.error[:, :3], axis=1).max() < 25e-6
    assert result.force.max() > 1.0
    blind = vff.simulate("panda-lean", {"controller.field.gain": 0.0})
    assert blind.metrics["min_clearance"] < result.metrics["min_clearance"] - 0.01
    complying = vff.simulate("panda-lean", {"controller.touch.task": "comply"})
    assert np.linalg.norm(complying.error[:, :3], axis=1).max() > 2e-4
