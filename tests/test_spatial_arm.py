"""`vffnull.Arm` in space: every operator against other engines, the plane as a part of space, bad input.

Pinocchio's model is built number by number from the description, or read by Pinocchio itself from a published
URDF. MuJoCo reads what `Arm.to_mjcf` writes.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

import vffnull as vff
from mujoco_forces import forces
from published import MODELS, chains, coordinates, pin, reduced_to
from strategies import random_arm, written_in_space
from vffnull import arms
from vffnull.errors import InputError, InputTypeError, ScenarioWarning

Array = NDArray[np.float64]
TOLERANCE = 1e-11  # relative, in the maximum norm
NAMES = arms.names()
Engine = Callable[[Array, Array, Array, Array], dict[str, Array]]

# --------------------------------------------------------------------------- against Pinocchio and MuJoCo


def rotation(quaternion: Array) -> Array:
    w, x, y, z = quaternion
    return np.asarray(pin.Quaternion(w, x, y, z).toRotationMatrix())


def placement(frame: Mapping[str, Any]) -> Any:
    return pin.SE3(rotation(frame["orientation"]), np.array(frame["position"]))


def pinocchio_model(arm: Mapping[str, Any]) -> Any:
    """The arm joint by joint, its tip a frame."""
    model = pin.Model()
    model.gravity.linear = np.array(arm["gravity"])
    before, parent = placement(arm["mount"]), 0
    for i, joint in enumerate(arm["joints"]):
        make = (
            pin.JointModelPrismaticUnaligned
            if joint["kind"] == "prismatic"
            else pin.JointModelRevoluteUnaligned
        )
        parent = model.addJoint(
            parent, make(np.array(joint["axis"])), before * placement(joint), joint["name"]
        )
        xx, yy, zz, xy, xz, yz = joint["inertia"]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = pin.Inertia(joint["mass"], np.array(joint["com"]), tensor)
        model.appendBodyToJoint(parent, inertia, pin.SE3.Identity())
        before = pin.SE3.Identity()
        model.armature[i] = joint["armature"]
    model.addFrame(pin.Frame("the tip", parent, placement(arm["tool"]), pin.FrameType.OP_FRAME))
    return model


def ours(arm: vff.Arm, q: Array, dq: Array, ddq: Array, tau: Array) -> dict[str, Array]:
    position, orientation = arm.pose(q)
    C = arm.coriolis_matrix(q, dq)
    return {
        "joint origins": arm.forward_kinematics(q)[:-1],
        "tip": position,
        "axes of the tip": rotation(orientation),
        "frames of the links": arm.link_poses(q),
        "J": arm.jacobian(q),
        "J̇": arm.jacobian_dot(q, dq),
        "M": arm.mass_matrix(q),
        "C": C,
        "C q̇": C @ dq,
        "g": arm.gravity_torque(q),
        "inverse dynamics": arm.inverse_dynamics(q, dq, ddq),
        "forward dynamics": arm.forward_dynamics(q, dq, tau),
        "kinetic energy": np.array(arm.kinetic_energy(q, dq)),
        "potential energy": np.array(arm.potential_energy(q)),
    }


def by_pinocchio(model: Any, tip: int, q: Array, dq: Array, ddq: Array, tau: Array) -> dict[str, Array]:
    """All quantities from a model and the number of its frame at the tip."""
    data, n = model.createData(), model.nv
    x = coordinates(model, q)
    aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
    mass = np.array(pin.crba(model, data, x))
    out = {
        "M": np.triu(mass) + np.triu(mass, 1).T,
        "C": np.array(pin.computeCoriolisMatrix(model, data, x, dq)),
        "g": np.array(pin.computeGeneralizedGravity(model, data, x)),
        "inverse dynamics": np.array(pin.rnea(model, data, x, dq, ddq)),
        "forward dynamics": np.array(pin.aba(model, data, x, dq, tau)),
        "potential energy": np.array(pin.computePotentialEnergy(model, data, x)),
    }
    out["C q̇"] = out["C"] @ dq
    out["kinetic energy"] = np.array(0.5 * dq @ out["M"] @ dq)
    pin.computeJointJacobiansTimeVariation(model, data, x, dq)
    pin.updateFramePlacements(model, data)
    pose = data.oMf[tip]
    out["J"] = np.array(pin.getFrameJacobian(model, data, tip, aligned)).reshape(6, n)
    out["J̇"] = np.array(pin.getFrameJacobianTimeVariation(model, data, tip, aligned)).reshape(6, n)
    out["tip"], out["axes of the tip"] = np.array(pose.translation), np.array(pose.rotation)
    out["frames of the links"] = np.array([data.oMi[i + 1].homogeneous for i in range(n)])
    out["joint origins"] = out["frames of the links"][:, :3, 3]
    return out


def pinocchio_of(arm: vff.Arm) -> Engine:
    model = pinocchio_model(arm.to_dict())
    return partial(by_pinocchio, model, model.getFrameId("the tip"))


def mujoco_of(arm: vff.Arm) -> Engine:
    """What `Arm.to_mjcf` says of the arm, without limits and contacts."""
    model = mujoco.MjModel.from_xml_string(arm.to_mjcf())
    disabled, enabled = mujoco.mjtDisableBit, mujoco.mjtEnableBit
    model.opt.disableflags |= disabled.mjDSBL_CONTACT | disabled.mjDSBL_LIMIT | disabled.mjDSBL_FRICTIONLOSS
    model.opt.enableflags |= enabled.mjENBL_ENERGY
    return partial(by_mujoco, model, arm)


def by_mujoco(model: Any, arm: vff.Arm, q: Array, dq: Array, ddq: Array, tau: Array) -> dict[str, Array]:
    """All but C as a matrix, which MuJoCo does not form."""
    data, n = mujoco.MjData(model), arm.n
    data.qpos[:], data.qvel[:], data.qfrc_applied[:] = q, dq, tau
    mujoco.mj_forward(model, data)
    mujoco.mj_energyVel(model, data)
    out = {"kinetic energy": np.array(data.energy[1]), "potential energy": np.array(data.energy[0])}
    bodies = [model.body(name).id for name in arm.link_names]
    out["frames of the links"] = np.tile(np.eye(4), (n, 1, 1))
    out["frames of the links"][:, :3, :3] = data.xmat[bodies].reshape(n, 3, 3)
    out["frames of the links"][:, :3, 3] = data.xpos[bodies]
    joints = [model.joint(name).id for name in arm.joint_names]
    out["joint origins"] = data.xpos[model.jnt_bodyid[joints]].copy()
    # Where the tool is on its link: the document says it, and MuJoCo carries it along.
    tool, last = arm.to_dict()["tool"], bodies[-1]
    turn = data.xmat[last].reshape(3, 3)
    out["tip"] = data.xpos[last] + turn @ np.array(tool["position"])
    out["axes of the tip"] = turn @ rotation(tool["orientation"])
    linear, angular = np.zeros((2, 3, n))
    mujoco.mj_jac(model, data, linear, angular, out["tip"], last)
    out["J"] = np.vstack([linear, angular])
    mujoco.mj_jacDot(model, data, linear, angular, out["tip"], last)
    out["J̇"] = np.vstack([linear, angular])
    return out | forces(model, data, ddq)


def deviations(
    arm: vff.Arm, engine: Engine, rng: np.random.Generator, states: int
) -> Iterator[tuple[str, float]]:
    """Of every quantity at random states, relative to its largest entry, or to what it is a difference of."""
    weight = float(np.sum(arm.masses) * np.linalg.norm(arm.gravity))
    for _ in range(states):
        q, dq, ddq, tau = rng.uniform(-2.0, 2.0, (4, arm.n))
        own, theirs = ours(arm, q, dq, ddq, tau), engine(q, dq, ddq, tau)
        assert own.keys() - theirs.keys() <= {"C"}
        # Heights and levers may cancel out, weights do not; accelerations are what M⁻¹ makes of torques.
        easy = np.linalg.norm(np.linalg.inv(theirs["M"]), 2)
        torques = max(float(np.abs(own["inverse dynamics"]).max()), weight, 1.0)
        least = {
            "g": weight,
            "inverse dynamics": weight,
            "potential energy": weight,
            "forward dynamics": easy * torques,
            "C": float(np.abs(theirs["M"]).max()),
            "C q̇": float(np.abs(theirs["M"]).max()),
        }
        for name, other in theirs.items():
            assert own[name].shape == other.shape, name
            scale = max(float(np.abs(other).max()), least.get(name, 1.0))
            yield name, float(np.abs(own[name] - other).max() / scale)


def assert_agreement(arm: vff.Arm, engine: Engine, seed: int = 1, states: int = 5) -> None:
    for name, deviation in deviations(arm, engine, np.random.default_rng(seed), states):
        assert deviation <= TOLERANCE, f"{name}: {deviation:.2e}"


@pytest.mark.parametrize("name", NAMES)
def test_bundled_arms_are_those_of_pinocchio(name: str) -> None:
    arm = vff.Arm.named(name)
    assert_agreement(arm, pinocchio_of(arm))


@pytest.mark.parametrize("name", NAMES)
def test_bundled_arms_are_those_of_mujoco(name: str) -> None:
    arm = vff.Arm.named(name)
    assert_agreement(arm, mujoco_of(arm))


def any_arm(seed: int) -> dict[str, Any]:
    """A chain of 1 to 20 joints."""
    rng = np.random.default_rng(seed)
    return random_arm(rng, seed + 1 if seed < 20 else int(rng.integers(1, 21)))


def test_random_chains_are_those_of_pinocchio() -> None:
    for seed in range(200):
        arm = vff.Arm._from_dict(any_arm(seed))
        assert_agreement(arm, pinocchio_of(arm), seed, states=1)


def test_random_chains_are_those_of_mujoco() -> None:
    for seed in range(200):
        arm = vff.Arm._from_dict(any_arm(seed))
        assert_agreement(arm, mujoco_of(arm), seed, states=1)


@pytest.mark.skipif(not MODELS, reason="pip install example-robot-data")
@pytest.mark.parametrize("path", MODELS, ids=lambda path: f"{path.parents[1].name}-{path.stem}")
@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")
def test_published_arms_are_those_of_pinocchio(path: Path) -> None:
    """The first three chains that are arms of a published model, read by Pinocchio from the same file."""
    try:
        model = pin.buildModelFromUrdf(str(path))
    except Exception as fault:
        pytest.skip(f"Pinocchio refuses it: {fault}")
    compared = 0
    for tip in chains(model):
        try:
            report = arms.read_urdf(path, tip=tip, collision="none")
        except InputError:
            continue  # tests/test_urdf.py looks at what is said
        arm = vff.Arm.from_urdf(path, tip=tip, collision="none")
        reduced = reduced_to(model, arm.to_dict(), dict(report.locked))
        reduced.armature[:] = 0.0  # as in the text
        engine = partial(by_pinocchio, reduced, reduced.getFrameId(tip, pin.FrameType.BODY))
        assert_agreement(arm, engine, states=2)
        compared += 1
        if compared == 3:
            break
    if not compared:
        pytest.skip("no chain of it is an arm")


# --------------------------------------------------------------------------- the plane, a part of space


def test_a_planar_arm_in_space_is_the_planar_arm() -> None:
    rng = np.random.default_rng(5)
    for n in (1, 2, 3, 6, 11):
        lengths = rng.uniform(0.2, 1.5, n)
        flat = vff.Arm(
            lengths,
            rng.uniform(0.1, 5.0, n),
            com=np.stack([0.4 * lengths, rng.uniform(-0.2, 0.2, n)], axis=1),
            inertias=rng.uniform(0.01, 0.5, n),
            gravity=rng.uniform(-10, 10, 2),
        )
        raised = vff.Arm._from_dict(written_in_space(flat))
        q, dq, ddq, tau = rng.uniform(-3, 3, (4, n))

        def close(a: Array, b: Array) -> None:
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * max(1.0, float(np.abs(b).max())))

        close(raised.forward_kinematics(q)[:, :2], flat.forward_kinematics(q))
        close(raised.jacobian(q)[:2], flat.jacobian(q))
        close(raised.jacobian(q)[5], np.ones(n))
        close(raised.jacobian_dot(q, dq)[:2], flat.jacobian_dot(q, dq))
        for name, arguments in (
            ("mass_matrix", (q,)),
            ("coriolis_matrix", (q, dq)),
            ("gravity_torque", (q,)),
            ("inverse_dynamics", (q, dq, ddq)),
            ("forward_dynamics", (q, dq, tau)),
            ("kinetic_energy", (q, dq)),
        ):
            close(np.asarray(getattr(raised, name)(*arguments)), np.asarray(getattr(flat, name)(*arguments)))
        position, angle = flat.pose(q)
        close(raised.pose(q)[0][:2], position)
        half = 0.5 * float(angle)
        sign = 1.0 if np.cos(half) >= 0 else -1.0
        close(raised.pose(q)[1], sign * np.array([np.cos(half), 0.0, 0.0, np.sin(half)]))
        close(raised.link_poses(q)[:, :2, :2], flat.link_poses(q)[:, :2, :2])
        close(raised.link_poses(q)[:, :2, 3], flat.link_poses(q)[:, :2, 2])


def test_a_planar_arm_answers_the_same_questions() -> None:
    arm = vff.Arm([1.0, 0.5], 1.0, radius=[0.1, 0.05], joint_limits=[-2.0, 1.0], velocity_limits=2.0)
    assert (arm.dimension, arm.joint_names, arm.link_names) == (
        2,
        ["joint_1", "joint_2"],
        ["link_1", "link_2"],
    )
    position, angle = arm.pose([0.3, 0.4])
    np.testing.assert_allclose(position, arm.forward_kinematics([0.3, 0.4])[-1])
    assert (angle.shape, float(angle)) == ((), pytest.approx(0.7))
    link, shape = arm.collision[1]
    assert (link, shape) == ("link_2", {"kind": "capsule", "a": [0.0, 0.0], "b": [0.5, 0.0], "radius": 0.05})
    np.testing.assert_array_equal(arm.joint_limits, [[-2.0, 1.0]] * 2)
    np.testing.assert_array_equal(arm.velocity_limits, [2.0, 2.0])
    assert arm.torque_limits is None


# ----------------------------------------------------------------------------------------- the contract


def test_shapes_names_and_limits() -> None:
    arm = vff.Arm.named("panda")
    assert isinstance(arm, vff.Arm)
    assert (arm.n, arm.dimension) == (7, 3)
    document = arms.named("panda")
    assert arm.joint_names == [joint["name"] for joint in document["joints"]]
    assert arm.link_names == [joint["link"] for joint in document["joints"]]
    q = np.linspace(-1, 1, 7)
    position, quaternion = arm.pose(q)
    assert (position.shape, quaternion.shape) == ((3,), (4,))
    assert quaternion[0] >= 0
    assert np.linalg.norm(quaternion) == pytest.approx(1.0, abs=1e-15)
    assert arm.forward_kinematics(q).shape == (8, 3)
    assert arm.forward_kinematics(np.stack([q, q])).shape == (2, 8, 3)
    assert arm.link_poses(q).shape == (7, 4, 4)
    assert arm.jacobian(q).shape == arm.jacobian_dot(q, q).shape == (6, 7)
    assert (arm.masses.shape, arm.com.shape, arm.inertias.shape) == ((7,), (7, 3), (7, 3, 3))
    np.testing.assert_array_equal(arm.gravity, [0.0, 0.0, -9.81])
    assert arm.collision == [(item["link"], item["shape"]) for item in document["collision"]]
    assert arm.joint_limits is not None
    np.testing.assert_array_equal(arm.joint_limits, document["joint_limits"])
    assert arm.velocity_limits is not None
    np.testing.assert_array_equal(arm.velocity_limits, document["velocity_limits"])
    assert arm.torque_limits is not None
    np.testing.assert_array_equal(arm.torque_limits, document["torque_limits"])
    assert "panda" in repr(arm)
    assert "panda_hand_tcp" in arm._repr_html_()
    split = arm.extended_jacobian(q, q)
    assert split.Z.shape == (7, 1)
    np.testing.assert_allclose(arm.jacobian(q) @ split.Z, 0.0, atol=1e-12)


@pytest.mark.parametrize("name", NAMES)
def test_the_document_is_complete(name: str) -> None:
    """Nothing but the dict makes the same arm again, and so do pickle and copy."""
    arm = vff.Arm.named(name)
    document = arm.to_dict()
    assert document == arms.named(name)
    for again in (vff.Arm._from_dict(document), pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm)):
        assert again == arm
        assert hash(again) == hash(arm)
        assert again.to_dict() == document


def test_every_default_is_in_the_document() -> None:
    rod = {"name": "hinge", "kind": "revolute", "mass": 1.0, "com": [0.0, 0.0, 0.5], "axis": [0.0, 1.0, 0.0]}
    arm = vff.Arm._from_dict({"joints": [rod | {"inertia": [0.08, 0.08, 0.001, 0.0, 0.0, 0.0]}]})
    document = arm.to_dict()
    assert document["joints"][0]["link"] == "hinge"
    assert document["mount"] == {"position": [0.0, 0.0, 0.0], "orientation": [1.0, 0.0, 0.0, 0.0]}
    assert (document["base"], document["tip"], document["gravity"]) == ("base", "tip", [0.0, 0.0, -9.81])
    assert arm.joint_limits is None


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.filterwarnings("ignore::vffnull.errors.ScenarioWarning")  # MJCF has no limits of speed
def test_written_and_read_again(name: str) -> None:
    arm = vff.Arm.named(name)
    base, tip = arm.to_dict()["base"], arm.to_dict()["tip"]
    texts = {"urdf": arm.to_urdf(), "mjcf": arm.to_mjcf(name="another")}
    assert f'name="{name}"' in texts["urdf"]
    assert 'model="another"' in texts["mjcf"]
    q, dq, ddq = np.random.default_rng(3).uniform(-1, 1, (3, arm.n))
    for again in (
        vff.Arm.from_urdf(texts["urdf"], tip, base, collision="none"),
        vff.Arm.from_mjcf(texts["mjcf"], tip=tip, base=base),
    ):
        assert again.joint_names == arm.joint_names
        expected = arm.inverse_dynamics(q, dq, ddq)
        atol = 1e-11 * float(np.abs(expected).max())
        np.testing.assert_allclose(again.inverse_dynamics(q, dq, ddq), expected, rtol=0, atol=atol)
        np.testing.assert_allclose(again.jacobian(q), arm.jacobian(q), atol=1e-11)


# ---------------------------------------------------------------------------------------------- bad input


def test_vectors_of_another_length_or_not_finite() -> None:
    arm = vff.Arm.named("ur5e")
    six = [0.1] * 6
    for method, arguments in (
        (arm.pose, ()),
        (arm.link_poses, ()),
        (arm.forward_kinematics, ()),
        (arm.jacobian, ()),
        (arm.mass_matrix, ()),
        (arm.gravity_torque, ()),
        (arm.potential_energy, ()),
        (arm.jacobian_dot, (six,)),
        (arm.coriolis_matrix, (six,)),
        (arm.kinetic_energy, (six,)),
        (arm.inverse_dynamics, (six, six)),
        (arm.forward_dynamics, (six, six)),
        (arm.extended_jacobian, (six,)),
    ):
        with pytest.raises(InputError, match=r"^q: expected"):
            method([0.1] * 7, *arguments)
        with pytest.raises(InputError, match=r"^q(\[\d\])?.*finite"):
            method([0.1] * 5 + [np.nan], *arguments)
        with pytest.raises(InputTypeError, match=r"^q: expected"):
            method("six", *arguments)
        for k in range(len(arguments)):
            worse = [*arguments]
            worse[k] = [np.inf] * 6
            with pytest.raises(InputError, match="finite"):
                method(six, *worse)
            worse[k] = [0.0] * 2
            with pytest.raises(InputError, match="expected"):
                method(six, *worse)


def test_names_that_do_not_exist() -> None:
    with pytest.raises(InputError, match="did you mean `iiwa14`"):
        vff.Arm.named("iiwa")
    with pytest.raises(TypeError):
        vff.Arm.named(7)  # type: ignore[arg-type]
    panda = vff.Arm.named("panda")
    with pytest.raises(InputError, match="did you mean `panda_hand_tcp`"):
        vff.Arm.from_urdf(panda.to_urdf(), tip="panda_hand_tpc")
    with pytest.raises(TypeError, match="tipp"):
        vff.Arm.from_urdf(panda.to_urdf(), tipp="panda_hand_tcp")  # type: ignore[call-arg]


def changed(change: Any) -> dict[str, Any]:
    document = vff.Arm.named("ur5e").to_dict()
    change(document)
    return document


def test_descriptions_that_are_no_arm() -> None:
    for words, change in (
        (r"joints\[2\].mass: must be finite and > 0", lambda d: d["joints"][2].update(mass=-1.0)),
        (r"joints\[1\].axis: must have length 1", lambda d: d["joints"][1].update(axis=[1.0, 1.0, 0.0])),
        (r"unknown key `masss`.*did you mean `mass`", lambda d: d["joints"][0].update(masss=1.0)),
        (r"joints\[3\].*missing key `inertia`", lambda d: d["joints"][3].pop("inertia")),
        (r"joints\[0\].kind.*`floating`", lambda d: d["joints"][0].update(kind="floating")),
        (r"torque_limits: expected 6 values", lambda d: d.update(torque_limits=[1.0])),
        (r"collision\[0\].link: there is no link", lambda d: d["collision"][0].update(link="forearm")),
        (r"joints: must be at least one joint", lambda d: d.update(joints=[])),
        (r"joints: expected a list", lambda d: d.update(joints=3)),
    ):
        with pytest.raises(InputError, match=words):
            vff.Arm._from_dict(changed(change))


def test_links_carry_boxes_and_hulls() -> None:
    """So does the base; what has no inside is refused in a sentence that says what is wanted."""
    box = {"kind": "box", "center": [0.0] * 3, "size": [0.1] * 3, "orientation": [1.0, 0.0, 0.0, 0.0]}
    hull = {"kind": "convex", "vertices": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]}
    arm = vff.Arm.named("ur5e")
    for link in (arm.link_names[1], arm.to_dict()["base"]):
        given = [{"link": link, "shape": box}, {"link": link, "shape": hull}]
        assert vff.Arm._from_dict(arm.to_dict() | {"collision": given}).collision == [
            (link, box),
            (link, hull),
        ]
    flat = {"kind": "convex", "vertices": [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]]}
    with pytest.raises(
        InputError, match=r"collision\[0\].shape.vertices: must be points that do not lie in one plane"
    ):
        vff.Arm._from_dict(arm.to_dict() | {"collision": [{"link": arm.link_names[1], "shape": flat}]})


def test_what_only_planar_arms_have() -> None:
    arm = vff.Arm.named("ur5e")
    for name in ("lengths", "radius"):
        assert not hasattr(arm, name)
        with pytest.raises(AttributeError, match="an arm in space has no"):
            getattr(arm, name)


def test_what_readers_warn_of_reaches_the_caller() -> None:
    text = (
        vff.Arm.named("panda")
        .to_urdf()
        .replace(
            "</robot>",
            """
        <link name="side"><inertial><mass value="0.1"/>
        <inertia ixx="1e-3" iyy="1e-3" izz="1e-3"/></inertial></link>
        <joint name="aside" type="revolute"><parent link="panda_link3"/><child link="side"/>
        <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""",
        )
    )
    with pytest.warns(ScenarioWarning, match="aside") as caught:
        arm = vff.Arm.from_urdf(text, tip="panda_hand_tcp", collision="none")
    assert caught[0].filename == __file__
    assert arm.masses.sum() == pytest.approx(vff.Arm.named("panda").masses.sum() + 0.1)


# ------------------------------------------------------------------------------------------------ the page


def test_a_pose_to_reach_is_a_pair_or_seven_numbers() -> None:
    arm = vff.Arm.named("panda")
    q = np.array([0.1, -0.5, 0.2, -2.0, 0.3, 1.8, 0.4])
    position, quaternion = arm.pose(q + 0.05)
    for task in ("pose", "pointing"):
        controller = vff.Controller(arm, {"task": task})
        as_one = controller.torque(q, np.zeros(7), np.concatenate([position, quaternion]))
        for pair in ((position, quaternion), [list(position), list(quaternion)]):
            np.testing.assert_array_equal(controller.torque(q, np.zeros(7), pair), as_one)
        with pytest.raises(InputError, match=r"x_ref\[1\].*\(4,\)"):
            controller.torque(q, np.zeros(7), (position, [1.0, 0.0, 0.0]))
        with pytest.raises(InputError, match=r"x_ref.*\(7,\)"):
            controller.torque(q, np.zeros(7), position)


def table(engine_of: Callable[[vff.Arm], Engine]) -> str:
    """The largest deviation from an engine per bundled arm and quantity, as Markdown."""
    names = [*NAMES, "random"]
    rows: dict[str, dict[str, float]] = {}
    for name in names:
        documents = [arms.named(name)] if name in NAMES else [any_arm(seed) for seed in range(200)]
        for k, document in enumerate(documents):
            arm = vff.Arm._from_dict(document)
            states = 50 if len(documents) == 1 else 1
            rng = np.random.default_rng(k)
            for quantity, deviation in deviations(arm, engine_of(arm), rng, states):
                row = rows.setdefault(quantity, {})
                row[name] = max(deviation, row.get(name, 0.0))
    lines = [f"| quantity | {' | '.join(names)} |", "|---" * (len(names) + 1) + "|"]
    for quantity, row in rows.items():
        lines.append(f"| {quantity} | {' | '.join(f'{row[name]:.1e}' for name in names)} |")
    return "\n".join(lines)


def test_rotors_of_a_bundled_arm() -> None:
    """They are felt by their own joint, one number for all or one each."""
    scene = vff.Scenario.load("ur5e-sweep")
    plain = scene.arm.mass_matrix(scene["q0"])
    for given in (0.1, [0.1, 0.2, 0.3, 0.0, 0.05, 0.06]):
        heavy = scene.replace(arm={"model": "ur5e", "armature": given}).arm.mass_matrix(scene["q0"])
        np.testing.assert_allclose(heavy - plain, np.eye(6) * np.asarray(given), atol=1e-12)
    for wrong, said in ((-0.1, r"arm\.armature: must be 0 or more"), ([0.1], r"arm\.armature: expected 6")):
        with pytest.raises(vff.errors.ScenarioError, match=said):
            scene.replace(arm={"model": "ur5e", "armature": wrong})
