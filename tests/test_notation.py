"""What docs/notation.md says of frames, orders and signs in other libraries, on a Panda from the same URDF.

Drake and robotics-toolbox are no dependency of the tests; where they are installed, theirs run, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

import vffnull as vff

Array = NDArray[np.float64]

TIP = "panda_hand_tcp"


@dataclass(frozen=True)
class Case:
    """A Panda in motion, and what this library says of it."""

    arm: vff.Arm
    urdf: str
    q: Array
    dq: Array

    @property
    def jacobian(self) -> Array:
        return np.asarray(self.arm.jacobian(self.q))

    @property
    def turned(self) -> Array:
        """Axes of the tip as columns."""
        return np.asarray(self.arm.link_poses(self.q)[-1][:3, :3] @ _tool(self.arm))

    @property
    def bias_acceleration(self) -> Array:
        return np.asarray(self.arm.jacobian_dot(self.q, self.dq) @ self.dq)


def _tool(arm: vff.Arm) -> Array:
    w, x, y, z = arm.to_dict()["tool"]["orientation"]
    return np.asarray(pinocchio.Quaternion(w, x, y, z).toRotationMatrix())


def near(ours: Any, theirs: Any) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)


@pytest.fixture(scope="module")
def case() -> Case:
    arm = vff.Arm.named("panda")
    q = np.array([-0.6, -0.4, 0.3, -1.5, 0.2, 1.4, 0.7])
    return Case(arm, arm.to_urdf(), q, np.linspace(1.0, -0.8, 7))


def same_orientation(ours: Array, theirs: Array) -> None:
    """A quaternion and its opposite are one orientation; ours has w ≥ 0."""
    assert ours[0] >= 0.0
    near(ours * np.sign(ours @ theirs), theirs)


def test_ours(case: Case) -> None:
    """Linear rows first, world axes, at the tip: the velocity of the tip and how fast it turns."""
    h = 1e-6
    (before, _), (after, _) = case.arm.pose(case.q - h * case.dq), case.arm.pose(case.q + h * case.dq)
    twist = case.jacobian @ case.dq
    np.testing.assert_allclose((after - before) / (2 * h), twist[:3], rtol=0, atol=1e-8)
    turns = [case.arm.link_poses(case.q + s * h * case.dq)[-1][:3, :3] for s in (-1, 1)]
    spin = (turns[1] - turns[0]) / (2 * h) @ case.arm.link_poses(case.q)[-1][:3, :3].T
    np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], twist[3:], rtol=0, atol=1e-8)


def test_pinocchio(case: Case) -> None:
    """Linear first, LOCAL_WORLD_ALIGNED; quaternions end with w; frame accelerations are spatial."""
    model = pinocchio.buildModelFromXML(case.urdf)
    data = model.createData()
    frame = model.getFrameId(TIP, pinocchio.FrameType.BODY)
    q, dq = case.q, case.dq
    pinocchio.forwardKinematics(model, data, q, dq, np.zeros(7))
    pinocchio.computeJointJacobians(model, data, q)
    pinocchio.updateFramePlacements(model, data)
    world = pinocchio.LOCAL_WORLD_ALIGNED
    J = pinocchio.getFrameJacobian(model, data, frame, world)
    near(J, case.jacobian)
    local = pinocchio.getFrameJacobian(model, data, frame, pinocchio.LOCAL)
    R = data.oMf[frame].rotation
    near(R, case.turned)
    near(local, np.vstack([R.T @ J[:3], R.T @ J[3:]]))
    position, orientation = case.arm.pose(q)
    written = pinocchio.SE3ToXYZQUAT(data.oMf[frame])
    near(written[:3], position)
    same_orientation(orientation, np.roll(written[3:], 1))
    near(pinocchio.Quaternion(R).coeffs(), written[3:])
    w, x, y, z = orientation
    near(pinocchio.Quaternion(w, x, y, z).toRotationMatrix(), R)
    velocity = pinocchio.getFrameVelocity(model, data, frame, world)
    near(velocity.vector, J @ dq)
    spatial = pinocchio.getFrameAcceleration(model, data, frame, world)
    classical = pinocchio.getFrameClassicalAcceleration(model, data, frame, world)
    near(classical.vector, case.bias_acceleration)
    ours = np.concatenate([spatial.linear + np.cross(velocity.angular, velocity.linear), spatial.angular])
    near(ours, case.bias_acceleration)
    assert np.abs(spatial.linear - case.bias_acceleration[:3]).max() > 0.1
    pinocchio.computeJointJacobiansTimeVariation(model, data, q, dq)
    rate = pinocchio.getFrameJacobianTimeVariation(model, data, frame, world)
    np.testing.assert_allclose(rate, case.arm.jacobian_dot(q, dq), rtol=0, atol=1e-11)
    gravity = pinocchio.computeGeneralizedGravity(model, data, q)
    np.testing.assert_allclose(gravity, case.arm.gravity_torque(q), rtol=0, atol=1e-11)
    C = pinocchio.computeCoriolisMatrix(model, data, q, dq)
    np.testing.assert_allclose(C, case.arm.coriolis_matrix(q, dq), rtol=0, atol=1e-11)
    both = pinocchio.nonLinearEffects(model, data, q, dq)
    np.testing.assert_allclose(both, C @ dq + gravity, rtol=0, atol=1e-11)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_joints_that_turn_without_end(tmp_path: Path) -> None:
    """Pinocchio has a cosine and a sine for each, so that nq is greater than nv; others have one angle."""
    arm = vff.Arm.named("gen3")
    model = pinocchio.buildModelFromXML(arm.to_urdf())
    assert (model.nq, model.nv) == (11, 7)
    assert mujoco.MjModel.from_xml_string(arm.to_mjcf()).nq == 7
    file = tmp_path / "gen3.urdf"
    file.write_text(arm.to_urdf(), encoding="utf-8")
    try:
        import roboticstoolbox
    except ImportError:
        pass
    else:
        assert roboticstoolbox.Robot.URDF(str(file)).n == 7
    try:
        import pydrake.all as drake
    except ImportError:
        return
    plant = drake.MultibodyPlant(0.0)
    drake.Parser(plant).AddModels(str(file))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(arm.to_dict()["base"]))
    plant.Finalize()
    assert plant.num_positions() == 7


def test_mujoco(case: Case) -> None:
    """Two matrices, linear and angular, in world axes at the site; w first; 6-vectors begin with angles."""
    model = mujoco.MjModel.from_xml_string(case.arm.to_mjcf())
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = case.q, case.dq
    mujoco.mj_forward(model, data)
    linear, angular = np.zeros((3, 7)), np.zeros((3, 7))
    site = model.site(TIP).id
    mujoco.mj_jacSite(model, data, linear, angular, site)
    near(np.vstack([linear, angular]), case.jacobian)
    position, orientation = case.arm.pose(case.q)
    near(data.site_xpos[site], position)
    theirs = np.zeros(4)
    mujoco.mju_mat2Quat(theirs, data.site_xmat[site])
    same_orientation(orientation, theirs)
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 0)
    near(np.roll(velocity, 3), case.jacobian @ case.dq)
    mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, velocity, 1)
    R = case.turned
    near(R @ velocity[:3], case.jacobian[3:] @ case.dq)
    body = int(model.site_bodyid[site])
    rates = np.zeros((3, 7)), np.zeros((3, 7))
    mujoco.mj_jacDot(model, data, *rates, data.site_xpos[site], body)
    near(np.vstack(rates) @ case.dq, case.bias_acceleration)
    bias = case.arm.coriolis_matrix(case.q, case.dq) @ case.dq + case.arm.gravity_torque(case.q)
    np.testing.assert_allclose(data.qfrc_bias, bias, rtol=0, atol=1e-11)


HALF = np.sqrt(0.5)
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter turn about z, which is the quaternion w = z = √½."""


def test_poses_as_one_vector() -> None:
    """Position first in MuJoCo and Pinocchio, each with its own order of w."""
    text = """<mujoco><worldbody><body><freejoint/><geom size="1" mass="1"/></body></worldbody></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos[:] = 1.0, 2.0, 3.0, HALF, 0.0, 0.0, HALF
    mujoco.mj_forward(model, data)
    near(data.xpos[1], [1.0, 2.0, 3.0])
    near(data.xmat[1].reshape(3, 3), QUARTER)
    place = pinocchio.XYZQUATToSE3(np.array([1.0, 2.0, 3.0, 0.0, 0.0, HALF, HALF]))
    near(place.rotation, QUARTER)
    near(place.translation, [1.0, 2.0, 3.0])


def test_poses_of_drake_as_one_vector() -> None:
    """The quaternion first."""
    drake: Any = pytest.importorskip("pydrake.all")
    plant = drake.MultibodyPlant(0.0)
    body = plant.AddRigidBody("ball", drake.SpatialInertia.SolidSphereWithMass(1.0, 1.0))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, [HALF, 0.0, 0.0, HALF, 1.0, 2.0, 3.0])
    pose = plant.EvalBodyPoseInWorld(context, body)
    near(pose.rotation().matrix(), QUARTER)
    near(pose.translation(), [1.0, 2.0, 3.0])


def test_drake(case: Case, tmp_path: Path) -> None:
    """Angular rows first; w first; gravity on the right side, and the bias term without it."""
    drake: Any = pytest.importorskip("pydrake.all")
    file = tmp_path / "panda.urdf"
    file.write_text(case.urdf, encoding="utf-8")
    plant = drake.MultibodyPlant(0.0)
    drake.Parser(plant).AddModels(str(file))
    world, tip = plant.world_frame(), plant.GetFrameByName(TIP)
    plant.WeldFrames(world, plant.GetFrameByName("panda_link0"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, case.q)
    plant.SetVelocities(context, case.dq)
    pose = tip.CalcPoseInWorld(context)
    position, orientation = case.arm.pose(case.q)
    near(pose.translation(), position)
    same_orientation(orientation, pose.rotation().ToQuaternion().wxyz())
    kind = drake.JacobianWrtVariable.kV
    J = plant.CalcJacobianSpatialVelocity(context, kind, tip, [0, 0, 0], world, world)
    near(np.roll(J, 3, axis=0), case.jacobian)
    there = plant.CalcJacobianSpatialVelocity(context, kind, tip, [0, 0, 0], world, tip)
    R = pose.rotation().matrix()
    near(np.vstack([R @ there[3:], R @ there[:3]]), case.jacobian)
    rest = plant.CalcBiasSpatialAcceleration(context, kind, tip, [0, 0, 0], world, world)
    ours = np.concatenate([rest.translational(), rest.rotational()])
    near(ours, case.bias_acceleration)
    near(plant.CalcMassMatrix(context), case.arm.mass_matrix(case.q))
    gravity = plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(-gravity, case.arm.gravity_torque(case.q), rtol=0, atol=1e-11)
    bias = case.arm.coriolis_matrix(case.q, case.dq) @ case.dq
    np.testing.assert_allclose(plant.CalcBiasTerm(context), bias, rtol=0, atol=1e-11)


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of its reader of files
def test_robotics_toolbox(case: Case, tmp_path: Path) -> None:
    """Linear rows first; `jacob0` in world axes at the tip, `jacobe` in its own; w first, either sign."""
    toolbox: Any = pytest.importorskip("roboticstoolbox")
    turned: Any = pytest.importorskip("spatialmath").UnitQuaternion
    file = tmp_path / "panda.urdf"
    file.write_text(case.urdf, encoding="utf-8")
    robot = toolbox.Robot.URDF(str(file))
    place = robot.fkine(case.q, end=TIP)
    position, orientation = case.arm.pose(case.q)
    near(place.t, position)
    same_orientation(orientation, turned(place).A)
    J, R = robot.jacob0(case.q, end=TIP), place.R
    near(J, case.jacobian)
    there = np.vstack([R.T @ J[:3], R.T @ J[3:]])
    near(robot.jacobe(case.q, end=TIP), there)
    near(robot.jacob0_dot(case.q, case.dq) @ case.dq, case.bias_acceleration)
    near(robot.inertia(case.q), case.arm.mass_matrix(case.q))
    np.testing.assert_allclose(robot.gravload(case.q), case.arm.gravity_torque(case.q), rtol=0, atol=1e-11)
