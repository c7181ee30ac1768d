"""Runs in space: results with names and units, files and tables that keep every bit, arms from URDF."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import vffnull as vff
from vffnull import _core
from vffnull.errors import InputError, ScenarioError, ScenarioWarning
from vffnull.evaluation.geometry import arm as _arm
from vffnull.model.record import QUANTITIES, Layout, recorded
from vffnull.model.validation import faults

LOSSLESS = (".npz", ".parquet", ".arrow", ".csv")
WIDTHS = {"position": 3, "pointing": 5, "pose": 6}
SHORT = {"duration": 0.2, "simulation.record_every": 10}


def run(task: str = "pose", **overrides: Any) -> vff.Result:
    return vff.simulate("panda-sweep", {**SHORT, "controller.task": task, **overrides})


@pytest.fixture(scope="module")
def pose() -> vff.Result:
    return run()


def slider() -> vff.Scenario:
    """A joint that slides below two that turn, so that units differ from joint to joint."""
    joint: dict[str, Any] = {"kind": "revolute", "axis": [0.0, 0.0, 1.0], "mass": 1.0, "com": [0.2, 0.0, 0.0]}
    joint["inertia"] = [0.01, 0.02, 0.02, 0.0, 0.0, 0.0]
    joints = [
        joint | {"kind": "prismatic", "name": "lift", "link": "carriage"},
        joint | {"name": "shoulder", "link": "upper", "position": [0.1, 0.0, 0.0]},
        joint | {"name": "elbow", "link": "fore", "position": [0.4, 0.0, 0.0]},
        joint | {"name": "wrist", "link": "hand", "position": [0.3, 0.0, 0.0]},
    ]
    arm = {"joints": joints, "tool": {"position": [0.2, 0.0, 0.0]}}
    return vff.Scenario(
        arm=arm, q0=[0.1, 0.3, 0.5, -0.4], duration=0.05, reference={"kind": "setpoint"}, name="slider"
    )


def assert_same(again: vff.Result, result: vff.Result) -> None:
    assert set(recorded(again)) == set(recorded(result))
    for name, values in {"t": result.t, **recorded(result)}.items():
        there = getattr(again, name)
        assert (there.dtype, there.shape) == (values.dtype, values.shape), name
        assert there.tobytes() == values.tobytes(), name
    for field in dataclasses.fields(result):
        if field.name not in ("t", *QUANTITIES, "metrics"):
            assert getattr(again, field.name) == getattr(result, field.name), field.name
    assert dict(again.metrics) == dict(result.metrics)


# -------------------------------------------------------------------------------------------------- arrays


@pytest.mark.parametrize("task", WIDTHS)
def test_shapes(task: str) -> None:
    """The public interface in space: (T, 3), (T, 4), (T, m), (T, k, 3)."""
    result = run(task)
    T, m = len(result.t), WIDTHS[task]
    assert T == 21
    assert result.x.shape == result.x_ref.shape == (T, 3)
    assert result.dx.shape == result.error.shape == (T, m)
    assert result.obstacles.shape == (T, 1, 3)
    turned = (result.orientation, result.orientation_ref)
    if task == "position":
        assert turned == (None, None)
    else:
        for values in turned:
            assert values is not None and values.shape == (T, 4)
            np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1.0, rtol=0, atol=1e-12)
    assert "panda-sweep" in repr(result) and "min_clearance" in str(result.metrics)


def test_in_the_plane_there_is_no_orientation() -> None:
    result = vff.simulate("paper-1", {"duration": 0.01})
    assert result.orientation is None and result.orientation_ref is None
    assert result.layout == Layout()
    assert "orientation" not in recorded(result)


def test_the_record_is_where_the_arm_is(pose: vff.Result) -> None:
    """The geometry that pictures use is the core's: position and orientation of the tip."""
    arm = pose.scenario.arm
    np.testing.assert_allclose(arm.forward_kinematics(pose.q)[:, -1], pose.x, rtol=0, atol=1e-14)
    position, orientation = arm.pose(pose.q[-1])
    np.testing.assert_allclose(position, pose.x[-1], rtol=0, atol=1e-14)
    assert pose.orientation is not None
    sign = np.sign(orientation @ pose.orientation[-1])
    np.testing.assert_allclose(sign * orientation, pose.orientation[-1], rtol=0, atol=1e-12)
    np.testing.assert_allclose(pose.error[:, :3], pose.x - pose.x_ref, rtol=0, atol=1e-14)


def test_quaternions_of_rotations() -> None:
    """Both ways, half turns included; w is never negative."""
    draw = np.random.default_rng(5).normal(size=(200, 4))
    draw[:3] = np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [1e-9, 0.0, 0.0, 1.0]])
    draw /= np.linalg.norm(draw, axis=1, keepdims=True)
    matrices = _arm.rotation(draw)
    np.testing.assert_allclose(
        matrices @ np.swapaxes(matrices, 1, 2), np.tile(np.eye(3), (200, 1, 1)), atol=1e-14
    )
    again = _arm.quaternion(matrices)
    assert np.all(again[:, 0] >= 0.0)
    np.testing.assert_allclose(np.abs((again * draw).sum(axis=1)), 1.0, rtol=0, atol=1e-14)
    longer = (3.0 * draw).reshape(2, 100, 4)
    np.testing.assert_allclose(_core.matrices(longer).reshape(200, 3, 3), matrices, rtol=0, atol=1e-14)
    same = _core.quaternions(matrices.reshape(2, 100, 3, 3)).reshape(200, 4)
    np.testing.assert_allclose(np.abs((same * draw).sum(axis=1)), 1.0, rtol=0, atol=1e-14)
    assert np.all(same[:, 0] >= 0.0) and np.isnan(_core.matrices([np.nan] * 4)).all()
    assert np.isnan(_core.quaternions(np.full((3, 3), np.nan))).all()
    assert _core.matrices(np.zeros((0, 4))).shape == (0, 3, 3)
    for call, shape in ((_core.matrices, (3,)), (_core.quaternions, (4, 3))):
        with pytest.raises(vff.errors.InputError, match=r"expected shape \(…, "):
            call(np.zeros(shape))


def test_frames_of_many_postures_are_those_of_the_second_geometry() -> None:
    arm, flat = vff.Arm.named("ur5e"), vff.Arm.uniform(3)
    q = np.random.default_rng(6).uniform(-3.0, 3.0, (4, 6))
    judge = _arm.SpatialArm(arm.to_dict())
    np.testing.assert_allclose(arm.link_poses(q), judge.link_poses(q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(arm.tip_poses(q), judge.tool_poses(q), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(arm.tip_poses(q[1]), arm.tip_poses(q)[1])
    (x, y), angle = flat.pose(q[0, :3])
    c, s = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(flat.tip_poses(q[:1, :3])[0], [[c, -s, x], [s, c, y], [0, 0, 1]], atol=1e-14)
    for call in (arm.link_poses, arm.tip_poses):
        with pytest.raises(vff.errors.InputError, match=r"q\[2\]"):
            call(np.where(np.arange(4)[:, None] == 2, np.nan, q))


# --------------------------------------------------------------------------------------------- names, units


def test_columns(pose: vff.Result) -> None:
    table = pose.to_pandas()
    units = table.attrs["units"]
    names = table.columns.tolist()
    assert len(set(names)) == len(names) == sum(values[0].size for values in recorded(pose).values())
    expected = {
        "x_z": "m", "x_ref_y": "m", "orientation_w": "", "orientation_ref_z": "", "dx_z": "m/s",
        "dx_rx": "rad/s", "error_z": "m", "error_rz": "rad", "obstacles_0_z": "m", "q_6": "rad",
        "manipulability": "m³",
    }  # fmt: skip
    assert {name: units[name] for name in expected} == expected
    np.testing.assert_array_equal(table["error_rx"], pose.error[:, 3])


def test_units_of_metrics(pose: vff.Result, tmp_path: Path) -> None:
    """Three rows of J are lengths, and those of angles have no unit: m³ for every task."""
    flat = vff.simulate("paper-1", {"duration": 0.01})
    for result, unit in ((pose, "m³"), (flat, "m²")):
        for shown in (result, vff.Result.load(result.save(tmp_path / f"{unit}.npz"))):
            assert result.to_pandas().attrs["units"]["manipulability"] == unit
            (line,) = (line for line in str(shown.metrics).splitlines() if "min_manipulability" in line)
            assert f" {unit} " in line
            assert re.search(rf"min_manipulability.*?{unit}", shown.metrics._repr_html_())


def test_the_physical_arm() -> None:
    """A payload adds what its weight and its inertia at the tool ask for; friction is the plant's."""
    inertia = np.diag([1e-3, 2e-3, 2.5e-3])
    load = {"mass": 1.5, "com": [0.02, 0.0, 0.05], "inertia": [1e-3, 2e-3, 2.5e-3, 0.0, 0.0, 0.0]}
    scenario = vff.Scenario.load("panda-sweep").replace(
        **{"plant.payload": load, "plant.viscous_friction": 0.3, "plant.gravity": [0.0, 1.0, -9.0]}
    )
    believed, plant, q = scenario.arm, scenario.plant, np.linspace(-1.0, 1.0, 7)
    R = _arm.rotation(believed.pose(q)[1])
    J = believed.jacobian(q)
    at = J[:3] + np.cross(J[3:], R @ load["com"], axisa=0, axisc=0)
    added = load["mass"] * at.T @ at + J[3:].T @ R @ inertia @ R.T @ J[3:]
    np.testing.assert_allclose(plant.mass_matrix(q) - believed.mass_matrix(q), added, rtol=0, atol=1e-13)
    weighed = believed.to_dict() | {"gravity": [0.0, 1.0, -9.0]}
    extra = plant.gravity_torque(q) - vff.Arm._from_dict(weighed).gravity_torque(q)
    np.testing.assert_allclose(extra, -load["mass"] * at.T @ plant.gravity, rtol=0, atol=1e-12)
    assert {joint["damping"] for joint in plant.to_dict()["joints"]} == {0.3}
    heavier = scenario.replace(
        **{"plant.masses": (2 * believed.masses).tolist(), "plant.payload": None}
    ).plant
    np.testing.assert_allclose(heavier.mass_matrix(q), 2 * believed.mass_matrix(q), rtol=1e-13, atol=1e-13)


def test_columns_of_joints_that_slide() -> None:
    result = vff.simulate(slider())
    units = result.to_pandas().attrs["units"]
    assert [units[f"q_{i}"] for i in range(4)] == ["m", "rad", "rad", "rad"]
    assert (units["dq_0"], units["tau_0"], units["tau_vff_0"]) == ("m/s", "N", "N")
    assert (units["dq_1"], units["tau_1"], units["force_0"]) == ("rad/s", "N·m", "N")
    np.testing.assert_allclose(
        result.scenario.arm.forward_kinematics(result.q)[:, -1], result.x, rtol=0, atol=1e-14
    )


def test_dataset(pose: vff.Result) -> None:
    data = pose.to_xarray()
    assert data["x"].dims == ("t", "space") and data["error"].dims == data["dx"].dims == ("t", "task")
    assert data["obstacles"].dims == ("t", "obstacle", "space")
    assert data["orientation"].dims == ("t", "quaternion")
    assert data["quaternion"].values.tolist() == ["w", "x", "y", "z"]
    assert data["task"].values.tolist() == ["x", "y", "z", "rx", "ry", "rz"]
    assert data["error"].attrs["units"] == "m, rad" and data["x"].attrs["units"] == "m"


# ---------------------------------------------------------------------------------------------------- files


@pytest.mark.parametrize("ending", LOSSLESS)
@pytest.mark.parametrize("task", WIDTHS)
def test_files_keep_every_bit(task: str, ending: str, tmp_path: Path) -> None:
    result = run(task)
    again = vff.Result.load(result.save(tmp_path / f"run{ending}"))
    assert_same(again, result)
    assert vff.simulate(again.scenario).tau.tobytes() == result.tau.tobytes()


@pytest.mark.parametrize("ending", LOSSLESS)
def test_files_of_joints_that_slide(ending: str, tmp_path: Path) -> None:
    result = vff.simulate(slider())
    assert_same(vff.Result.load(result.save(tmp_path / f"run{ending}")), result)


def test_arrow_tables_keep_every_bit(pose: vff.Result) -> None:
    assert_same(vff.Result.from_arrow(pose.to_arrow()), pose)


def test_a_header_of_another_width_is_refused(pose: vff.Result, tmp_path: Path) -> None:
    path = pose.save(tmp_path / "run.csv")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"task": "pose"', '"task": "pointing"', 1), encoding="utf-8")
    with pytest.raises(InputError, match=r"arrays\.dx: expected shape \(5\)"):
        vff.Result.load(path)


def test_a_result_opens_no_other_file(pose: vff.Result, tmp_path: Path) -> None:
    """A saved result is other people's input; it may not name a file of this machine."""
    path = pose.save(tmp_path / "run.csv")
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"model": "panda"', '"urdf": "/etc/hostname"', 1), encoding="utf-8")
    with pytest.raises(InputError, match="in another file"):
        vff.Result.load(path)


def test_mcap(pose: vff.Result, tmp_path: Path) -> None:
    from mcap.reader import make_reader

    with pose.save(tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file)
        found = list(reader.iter_messages(topics="/vffnull"))
    assert found[0][0] is not None
    schema = json.loads(found[0][0].data)
    assert schema["properties"]["error"]["description"] == "tracking error [m, rad]"
    assert schema["properties"]["orientation"]["description"] == "orientation of the end effector"
    messages = [json.loads(message.data) for *_, message in found]
    np.testing.assert_array_equal([each["orientation"] for each in messages], pose.orientation)
    points = [[[ball[axis] for axis in "xyz"] for ball in each["obstacles"]] for each in messages]
    np.testing.assert_array_equal(points, pose.obstacles)


def test_stream(pose: vff.Result, tmp_path: Path) -> None:
    """With the scenario the widths are known; without it a row itself says that it is from space."""
    for scenario in (pose.scenario, None):
        simulation = vff.Simulation(pose.scenario.to_dict())
        with vff.StreamRecorder(tmp_path / "run.arrows", scenario) as recorder:
            recorder.write(simulation.state)
        table = vff.StreamRecorder.read(recorder.path)
        assert {"x_z", "obstacles_0_z", "orientation_w", "orientation_ref_w"} <= set(table.column_names)
        assert table.num_rows == 1
        assert table["x_z"][0].as_py() == pytest.approx(pose.x[0, 2], abs=1e-12)


# ------------------------------------------------------------------------------------------------- the shell


def test_the_shell_runs_and_saves(tmp_path: Path) -> None:
    target = tmp_path / "run.npz"
    command = [sys.executable, "-m", "vffnull.cli", "run", "panda-sweep", "--set", "duration=0.1"]
    if not (Path(vff.__file__).parent / "cli" / "__main__.py").is_file():
        command[1:3] = ["-c", "from vffnull.cli import main; main()"]
    done = subprocess.run([*command, "--save", str(target)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "min_clearance" in done.stdout
    assert "next: vffnull live panda-sweep" in done.stdout
    assert_dimension(vff.Result.load(target))


def assert_dimension(result: vff.Result) -> None:
    assert result.layout.dimension == 3 and result.x.shape[1] == 3


# ---------------------------------------------------------------------------------------------- obstacles


def test_obstacles_in_space() -> None:
    """The length of a point decides where an obstacle is; documents are what the schema says."""
    ball = vff.Obstacle.sphere([0.1, 1.2, 0.3], 0.05, vff.Motion.linear([0.0, 0.1, 0.0]))
    assert ball.to_dict() == {
        "shape": {"kind": "sphere", "radius": 0.05},
        "position": [0.1, 1.2, 0.3],
        "motion": {"kind": "linear", "velocity": [0.0, 0.1, 0.0]},
    }
    floor = vff.Obstacle.half_space([0.0, 0.0, -0.9], [0.0, 0.0, 1.0])
    assert floor.shape == {"kind": "half_space", "normal": [0.0, 0.0, 1.0]}
    rod = vff.Obstacle.capsule([1.0, 0.0, 0.0], [1.0, 0.0, 0.4], 0.02)
    assert rod.position == (1.0, 0.0, 0.2) and rod.shape["a"] == [0.0, 0.0, -0.2]
    half = np.sqrt(0.5)
    crate = vff.Obstacle.box([1.5, 0.0, 0.1], [0.2, 0.3, 0.4], orientation=[half, 0.0, 0.0, half])
    assert crate.to_dict()["orientation"] == [half, 0.0, 0.0, half]
    things = [ball, floor, rod, crate]
    scenario = vff.Scenario.load("panda-sweep").replace(duration=0.02, obstacles=things)
    assert vff.simulate(scenario).obstacles.shape[1:] == (4, 3)
    assert len({hash(each) for each in things}) == 4 and "half_space" in repr(floor)


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (lambda: vff.Obstacle.sphere([0.0, 0.0, 0.0], -1.0), "radius"),
        (lambda: vff.Obstacle.sphere([0.0, 0.0, np.nan], 1.0), "position"),
        (lambda: vff.Obstacle.half_space([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]), "normal"),
        (lambda: vff.Obstacle.box([0.0, 0.0, 0.0], [1.0, 1.0]), "size"),
        (lambda: vff.Obstacle.box([0, 0, 0], [1, 1, 1], orientation=[1.0, 1.0, 0.0, 0.0]), "orientation"),
        (lambda: vff.Obstacle.circle([0.0, 0.0, 0.0], 1.0), "circle"),
        (lambda: vff.Obstacle.sphere([0.0, 0.0], 1.0), "sphere"),
    ],
)
def test_obstacles_that_are_none(make: Any, fault: str) -> None:
    with pytest.raises(ScenarioError, match=fault):
        make()


def test_obstacles_of_the_wrong_dimension() -> None:
    disc = vff.Obstacle.circle([1.0, 1.0], 0.2)
    with pytest.raises(ScenarioError, match="obstacles"):
        vff.Scenario.load("panda-sweep").replace(obstacles=[disc])
    with pytest.raises(ScenarioError, match="obstacles"):
        vff.Scenario.load("paper-1").replace(obstacles=[vff.Obstacle.sphere([1.0, 1.0, 1.0], 0.2)])


def test_pointing_is_a_task_of_space() -> None:
    assert vff.ControlSettings(task="pointing").to_dict() == {"task": "pointing"}
    with pytest.raises(ScenarioError, match="task"):
        vff.simulate("paper-1", {"controller.task": "pointing"})


# -------------------------------------------------------------------------------------------- arms in files

URDF = """<robot name="lever">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 0.2"/><mass value="2"/>
    <inertia ixx="0.03" iyy="0.03" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.4"/></geometry>
    </collision></link>
  <link name="fore"><inertial><origin xyz="0 0 0.15"/><mass value="1"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 0.15"/><geometry><cylinder radius="0.04" length="0.3"/></geometry>
    </collision></link>
  <link name="hand"><inertial><origin xyz="0 0 0.05"/><mass value="0.5"/>
    <inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool"/>
  <joint name="a" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="90" velocity="2"/></joint>
  <joint name="b" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0 0 0.4"/>
    <axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
  <joint name="c" type="revolute"><parent link="fore"/><child link="hand"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="20" velocity="3"/></joint>
  <joint name="d" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0 0 0.1"/></joint>
</robot>"""

SCENARIO = """duration = 0.05
q0 = [0.3, 0.4, 0.5]
[arm]
urdf = "models/lever.urdf"
tip = "tool"
[reference]
kind = "setpoint"
[[obstacles]]
shape = { kind = "sphere", radius = 0.05 }
position = [0.5, 0.3, 0.4]
"""


@pytest.fixture
def written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A scenario beside the folder of its arm, and another folder to be in."""
    (tmp_path / "models").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "models" / "lever.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "lever.toml").write_text(SCENARIO, encoding="utf-8")
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "lever.toml"


@pytest.mark.filterwarnings("ignore:no shape on `hand`")
def test_an_arm_in_a_urdf_beside_the_scenario(written: Path) -> None:
    """What is loaded is explicit: the file may vanish, and everything can still be saved, sent and run."""
    scenario = vff.Scenario.load(written)
    assert "urdf" not in scenario["arm"] and [each["name"] for each in scenario["arm.joints"]] == [
        "a",
        "b",
        "c",
    ]
    assert [link for link, _ in scenario.arm.collision] == ["upper", "fore"]
    direct = vff.simulate(written)
    longer = vff.simulate(written, {"duration": 0.1})  # overrides come before the file is read
    many = vff.simulate_many(written, [{"duration": 0.05}, {"arm.collision": "none"}])
    (written.parent / "models" / "lever.urdf").unlink()
    assert longer.end_time == 0.1
    assert many[0].tau.tobytes() == direct.tau.tobytes()
    assert many[1].scenario.arm.collision == [] and np.isinf(many[1].clearance).all()
    saved = written.parent / "explicit.toml"
    scenario.save(saved)
    again = vff.Scenario.load(saved)
    assert again == scenario and vff.simulate(again).tau.tobytes() == direct.tau.tobytes()
    result = vff.Result.load(direct.save(written.parent / "run.npz"))
    assert_same(result, direct)


@pytest.mark.filterwarnings("ignore:no shape on `hand`")
def test_keys_beside_the_urdf(written: Path) -> None:
    ball = {"kind": "sphere", "center": [0, 0, 0.1], "radius": 0.1}
    changes = {
        "arm.gravity": [0.0, 0.0, 0.0],
        "arm.tool": [0.0, 0.0, 0.2],
        "arm.mount": {"position": [1.0, 0.0, 0.0]},
        "arm.torque_limits": [5.0, 5.0, 5.0],
        "arm.collision": [{"link": "fore", "shape": ball}],
        "arm.ignore": [["upper", "hand"]],
    }
    scenario = vff.simulate(written, changes).scenario
    assert scenario["arm.gravity"] == [0.0, 0.0, 0.0] and scenario["arm.torque_limits"] == [5.0, 5.0, 5.0]
    plain = vff.Scenario.load(written).arm.forward_kinematics([0.0, 0.0, 0.0])[-1]
    there = scenario.arm.forward_kinematics([0.0, 0.0, 0.0])[-1]
    np.testing.assert_allclose(there - plain, [1.0, 0.0, 0.2], rtol=0, atol=1e-12)
    assert len(scenario["arm.collision"]) == 1 and ["upper", "hand"] in scenario["arm.ignore"]


def test_locked_joints_are_stated(written: Path) -> None:
    locked = {"q0": [0.3, 0.4], "arm.locked": {"c": 0.2}}
    with warnings.catch_warnings(record=True) as odd:
        warnings.simplefilter("always", ScenarioWarning)
        scenario = vff.simulate(written, locked).scenario
    assert [each["name"] for each in scenario["arm.joints"]] == ["a", "b"]
    assert all(issubclass(each.category, ScenarioWarning) for each in odd)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        ({"arm.urdf": "missing.urdf"}, "missing.urdf"),
        ({"arm.urdf": "models"}, "models"),
        ({"arm.urdf": "lever.toml"}, "arm.urdf: "),
        ({"arm.urdf": 3}, "expected a path or text"),
        ({"arm.tip": "tol"}, "tool"),
        ({"arm.joints": []}, "give `urdf` or `joints`"),
        ({"arm.model": "panda"}, "give `urdf` or `model`"),
        ({"arm.lengths": [1.0]}, "unknown key `lengths`"),
        ({"arm.collision": "tight"}, "collision"),
        ({"arm.locked": 3}, "locked"),
    ],
)
def test_urdf_faults(
    written: Path, changes: dict[str, Any], fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(written.parent)
    with pytest.raises(ScenarioError, match=fault) as caught:
        vff.simulate(written, changes)
    assert caught.value.path.startswith("arm")


def test_validate_reads_the_urdf(written: Path) -> None:
    command = [sys.executable, "-c", "from vffnull.cli import main; main()", "validate"]
    fine = subprocess.run([*command, str(written)], capture_output=True, text=True, check=False)
    assert fine.returncode == 0 and "valid" in fine.stdout, fine.stderr
    (written.parent / "models" / "lever.urdf").unlink()
    gone = subprocess.run([*command, str(written)], capture_output=True, text=True, check=False)
    assert gone.returncode == 2 and "lever.urdf" in gone.stderr


def test_every_fault_of_a_scenario_in_space_is_found() -> None:
    """Each part is judged as one of space, and none as one of the plane."""
    document = vff.Scenario.load("panda-sweep").to_dict()
    assert faults(document) == []
    document["reference"] = {"kind": "line", "end": [0.0, 0.1], "duration": 1.0, "relative": True}
    document["obstacles"] += [
        {"shape": {"kind": "circle", "radius": 0.1}, "position": [0.0, 0.0, 0.0]},
        {"shape": {"kind": "sphere", "radius": -0.1}},
    ]
    document["controller"]["stiffness"] = -1.0
    found = faults(document)
    expected = (
        "obstacles[1].shape.kind: unknown value `circle`; allowed: `sphere`",
        "obstacles[2].shape.radius: must be greater than 0",
        "controller.stiffness: must be 0 or more",
        "reference.end: expected 3 values, got 2",
    )
    assert len(found) == len(expected)
    for fault, start in zip(found, expected, strict=True):
        assert fault.startswith(start)
    flat = vff.Scenario.load("sweep-through").to_dict() | {"reference": {"kind": "line", "relative": True}}
    assert any("unknown key `relative`" in fault for fault in faults(flat))


@pytest.mark.parametrize("word", ["none", "fit"])
def test_a_word_for_the_shapes_of_a_bundled_arm(word: str) -> None:
    result = run(**{"arm.collision": word})
    assert len(result.scenario.arm.collision) == (0 if word == "none" else 10)
    assert np.isinf(result.clearance).all() == (word == "none")


def test_a_word_that_makes_no_sense() -> None:
    with pytest.raises(ScenarioError, match=r"arm\.collision: .*'file'"):
        run(**{"arm.collision": "file"})


def test_what_is_changed_of_a_bundled_arm() -> None:
    """The geometry follows mount, tool and added pairs, as the core does."""
    changes: dict[str, Any] = {"arm.mount.position": [0.0, 0.0, 0.5], "arm.tool.position": [0.0, 0.0, 0.1]}
    result = run(**changes)
    arm = result.scenario.arm
    np.testing.assert_allclose(arm.forward_kinematics(result.q)[:, -1], result.x, rtol=0, atol=1e-14)
    assert arm.n == 7 and arm.dimension == 3 and arm.joint_names[0] == "panda_joint1"
    assert arm.link_names == [joint["link"] for joint in _core.arm_model("panda")["joints"]]
    assert arm.link_poses(result.q[0]).shape == (7, 4, 4)
