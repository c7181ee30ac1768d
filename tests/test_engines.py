"""Kinematics and dynamics agree with engines that share nothing with this project: Pinocchio and MuJoCo.

The same arm goes to each through `Arm.to_urdf` and `Arm.to_mjcf`. 200 random arms, n from 1 to 20, unequal
lengths and masses, offset centres of mass, with and without gravity. What was seen is in
docs/ground-truth.md, written by `python tests/test_engines.py`.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from numpy.typing import NDArray

import vffnull as vff
from mujoco_forces import forces

Array = NDArray[np.float64]
CASES = 200
TOLERANCE = 1e-9  # relative, in the maximum norm


@dataclass(frozen=True)
class Case:
    arm: vff.Arm
    q: Array
    dq: Array
    ddq: Array
    tau: Array


def case(seed: int) -> Case:
    """A random arm and state; the first twenty seeds are the arms of 1 to 20 links."""
    rng = np.random.default_rng(seed)
    n = seed + 1 if seed < 20 else int(rng.integers(1, 21))
    lengths = rng.uniform(0.2, 1.5, n)
    arm = vff.Arm(
        lengths,
        rng.uniform(0.1, 5.0, n),
        com=np.stack([lengths * rng.uniform(0.1, 0.9, n), rng.uniform(-0.2, 0.2, n)], axis=1),
        inertias=rng.uniform(0.01, 0.5, n),
        gravity=rng.uniform(-10, 10, 2) if seed % 2 else 0.0,
    )
    q, dq, ddq, tau = rng.uniform(-3, 3, (4, n))
    return Case(arm, q, dq, ddq, tau)


def ours(c: Case) -> dict[str, Array]:
    arm, q, dq = c.arm, c.q, c.dq
    return {
        "tip": arm.forward_kinematics(q)[-1],
        "J": arm.jacobian(q),
        "J̇ q̇": arm.jacobian_dot(q, dq) @ dq,
        "M": arm.mass_matrix(q),
        "C": arm.coriolis_matrix(q, dq),
        "C q̇": arm.coriolis_matrix(q, dq) @ dq,
        "g": arm.gravity_torque(q),
        "inverse dynamics": arm.inverse_dynamics(q, dq, c.ddq),
        "forward dynamics": arm.forward_dynamics(q, dq, c.tau),
    }


def by_pinocchio(c: Case) -> dict[str, Array]:
    """All quantities; its Coriolis matrix is a Christoffel one for revolute joints about one axis."""
    model = pinocchio.buildModelFromXML(c.arm.to_urdf())
    model.gravity.linear = np.array([*c.arm.gravity, 0.0])
    data = model.createData()
    # A continuous joint has (cos, sin) as its coordinates.
    q = pinocchio.integrate(model, pinocchio.neutral(model), c.q)
    tip = model.getFrameId("tip", pinocchio.FrameType.BODY)
    aligned = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
    still = np.zeros_like(c.dq)
    mass = pinocchio.crba(model, data, q)
    mass = np.triu(mass) + np.triu(mass, 1).T
    out = {
        "M": mass,
        "C": pinocchio.computeCoriolisMatrix(model, data, q, c.dq).copy(),
        "g": pinocchio.computeGeneralizedGravity(model, data, q).copy(),
        "inverse dynamics": pinocchio.rnea(model, data, q, c.dq, c.ddq).copy(),
        "forward dynamics": pinocchio.aba(model, data, q, c.dq, c.tau).copy(),
    }
    out["C q̇"] = out["C"] @ c.dq
    pinocchio.forwardKinematics(model, data, q, c.dq, still)
    pinocchio.updateFramePlacements(model, data)
    pinocchio.computeJointJacobians(model, data, q)
    # For one joint the bindings hand out a vector.
    out["J"] = pinocchio.getFrameJacobian(model, data, tip, aligned).reshape(6, -1)[:2].copy()
    out["tip"] = data.oMf[tip].translation[:2].copy()
    out["J̇ q̇"] = pinocchio.getFrameClassicalAcceleration(model, data, tip, aligned).linear[:2].copy()
    return out


def by_mujoco(c: Case) -> dict[str, Array]:
    """All but C as a matrix, which MuJoCo does not form."""
    model = mujoco.MjModel.from_xml_string(c.arm.to_mjcf())
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    data = mujoco.MjData(model)
    n, tip = c.arm.n, model.site("tip").id
    data.qpos[:], data.qvel[:] = c.q, c.dq
    data.ctrl[:] = c.tau
    mujoco.mj_forward(model, data)
    out = {"tip": data.site_xpos[tip][:2].copy()}
    jacobian = np.zeros((3, n))
    mujoco.mj_jacSite(model, data, jacobian, None, tip)
    out["J"] = jacobian[:2].copy()
    jacobian_dot = np.zeros((3, n))
    mujoco.mj_jacDot(model, data, jacobian_dot, None, data.site_xpos[tip], model.site(tip).bodyid[0])
    out["J̇ q̇"] = jacobian_dot[:2] @ c.dq
    return out | forces(model, data, c.ddq)


ENGINES = {"Pinocchio": by_pinocchio, "MuJoCo": by_mujoco}


def deviations(engine: str) -> Iterator[tuple[int, str, float]]:
    """Largest deviation of every quantity of every case, relative to its largest entry."""
    for seed in range(CASES):
        c = case(seed)
        own = ours(c)
        for name, theirs in ENGINES[engine](c).items():
            assert own[name].shape == theirs.shape, (seed, name)
            scale = max(np.abs(theirs).max(), 1.0)
            yield seed, name, float(np.abs(own[name] - theirs).max() / scale)


@pytest.mark.parametrize("engine", ENGINES)
def test_agreement(engine: str) -> None:
    seen = set()
    for seed, name, deviation in deviations(engine):
        assert deviation <= TOLERANCE, f"{name}, case {seed}: {deviation:.2e}"
        seen.add(name)
    assert seen >= set(ours(case(0))) - {"C"}


def test_urdf_with_joint_limits_only() -> None:
    """URDF wants an effort and a velocity beside the limits of a joint, and takes no `inf` for them."""
    arm = vff.Arm([1.0] * 3, 1.0, joint_limits=[-2.0, 1.5])
    pinocchio_model = pinocchio.buildModelFromXML(arm.to_urdf())
    np.testing.assert_array_equal(pinocchio_model.lowerPositionLimit, [-2.0] * 3)
    np.testing.assert_array_equal(pinocchio_model.upperPositionLimit, [1.5] * 3)
    mujoco_model = mujoco.MjModel.from_xml_string(arm.to_urdf())
    np.testing.assert_array_equal(mujoco_model.jnt_range, [[-2.0, 1.5]] * 3)


def table() -> str:
    """The largest deviation per quantity and engine, as Markdown."""
    worst: dict[str, dict[str, float]] = defaultdict(dict)
    for engine in ENGINES:
        for _, name, deviation in deviations(engine):
            worst[name][engine] = max(deviation, worst[name].get(engine, 0.0))
    versions = {"Pinocchio": pinocchio.__version__, "MuJoCo": mujoco.__version__}
    lines = [
        "| quantity | " + " | ".join(f"{engine} {versions[engine]}" for engine in ENGINES) + " |",
        "|---" * (len(ENGINES) + 1) + "|",
    ]
    for name in ours(case(0)):
        cells = [f"{worst[name][engine]:.1e}" if engine in worst[name] else "–" for engine in ENGINES]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    import test_spatial_arm as space

    page = Path(__file__).parents[1] / "docs" / "ground-truth.md"
    plane = table()
    text = (
        "# Agreement with independent engines\n\n"
        "Deviations are relative to the largest entry of the quantity or to 1. Written by\n"
        "`python tests/test_engines.py`.\n\n## In the plane\n\n"
        f"Largest deviation over {CASES} random arms (n = 1 … 20, unequal lengths and masses, offset centres "
        f"of mass, gravity on\nand off) and states. The tests allow {TOLERANCE:.0e}.\n\n{plane}\n\n"
        "## In space\n\n"
        "Of each bundled arm at 50 random states, and of 200 random chains (n = 1 … 20, joints that turn\n"
        "and slide, armature, any mount, tool and gravity): the largest deviation. Torques, potential\n"
        "energy and accelerations are relative to what the weight of the arm makes of them, where they\n"
        f"themselves cancel out. The tests allow {space.TOLERANCE:.0e}.\n\n"
        f"Pinocchio {pinocchio.__version__}, which the tests compare on the published URDFs of\n"
        f"`example-robot-data`, too:\n\n{space.table(space.pinocchio_of)}\n\n"
        f"MuJoCo {mujoco.__version__}, with what `Arm.to_mjcf` writes:\n\n"
        f"{space.table(space.mujoco_of)}\n"
    )
    page.write_text(text, encoding="utf-8")
    print(text)
