"""A step of a Panda that holds its hand's pose, beside other libraries: `python benches/peers/panda.py`.

Needs ``pip install ".[peers]"`` and half a minute; writes docs/speed.md, or with ``--quick`` only prints.
Whoever computes the law has to make our trajectory first.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from statistics import median

import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1]))
sys.path.append(str(Path(__file__).resolve().parents[2] / "tests"))

import mujoco
import pinocchio as pin

import oracle
import vffnull as vff
from peers.law import cholesky
from peers.ours import Compiled
from peers.peer import Array, Loop
from peers.run import REPETITIONS, deviation, fitting, with_noise
from report import rows, write_section
from scene import DT, panda, scene

ROOT = Path(__file__).resolve().parents[2]
STEPS = 2000
ALLOWED = 1e-8  # rad, of every joint over all steps


class Task:
    """What every loop is made from."""

    def __init__(self, document: dict[str, object]) -> None:
        self.document, self.dt = document, DT


class Plant(Loop):
    """MuJoCo's step alone: gravity, no control, no contacts. Begins anew before the fall gets too fast."""

    def __init__(self, document: dict[str, object]) -> None:
        self.model = mujoco.MjModel.from_xml_string(vff.Arm.named("panda").to_mjcf())
        disabled = mujoco.mjtDisableBit
        self.model.opt.timestep = DT
        self.model.opt.disableflags |= disabled.mjDSBL_CONTACT | disabled.mjDSBL_LIMIT
        self.data = mujoco.MjData(self.model)
        self.q0 = self.q = document["q0"]

    def step(self) -> None:
        if self.data.time > 0.5 or not self.data.time:
            mujoco.mj_resetData(self.model, self.data)
            self.data.qpos[:] = self.q0
        mujoco.mj_step(self.model, self.data)


class Dense(Loop):
    """Pinocchio's matrices, (T12) of docs/theory.md with them in NumPy, the plant by Pinocchio's `aba`."""

    def __init__(self, document: dict[str, object]) -> None:
        arm = vff.Arm.named("panda")
        self.model = pin.buildModelFromXML(arm.to_urdf())
        tool, control = arm.to_dict()["tool"], document["controller"]
        w, x, y, z = tool["orientation"]
        place = pin.SE3(pin.Quaternion(w, x, y, z).toRotationMatrix(), np.array(tool["position"]))
        frame = pin.Frame("hand", self.model.njoints - 1, place, pin.FrameType.OP_FRAME)
        self.hand = self.model.addFrame(frame)
        self.data = self.model.createData()
        self.stiffness, self.damping = control["stiffness"], control["damping"]
        self.null_damping, self.field = control["null_damping"], oracle.Field(**control["field"])
        (self.ball,) = document["obstacles"]
        joints = {name: k + 1 for k, name in enumerate(arm.link_names)}
        shapes = [(joints[link], shape) for link, shape in arm.collision if link in joints]
        ends = [[shape.get(key, shape.get("center")) for key in "ab"] for _, shape in shapes]
        self.joint = [joint for joint, _ in shapes]
        self.start, self.end = np.array(ends).swapaxes(0, 1)
        self.radius = np.array([shape["radius"] for _, shape in shapes]) + self.ball["shape"]["radius"]
        self.q, self.dq, self.k = np.array(document["q0"]), np.zeros(arm.n), 0
        pin.framesForwardKinematics(self.model, self.data, self.q)
        self.goal = self.data.oMf[self.hand].copy()

    def repulsion(self, t: float) -> Array:
        """τ_vff (n,) of all capsules against the ball."""
        frames = [self.data.oMi[joint] for joint in self.joint]
        turns = np.array([frame.rotation for frame in frames])
        places = np.array([frame.translation for frame in frames])
        a = np.einsum("kij,kj->ki", turns, self.start) + places
        along = np.einsum("kij,kj->ki", turns, self.end - self.start)
        swing = self.ball["motion"]
        swung = np.multiply(swing["amplitude"], np.sin(swing["angular_frequency"] * t))
        offset = self.ball["position"] + swung - a
        length = np.maximum(np.sum(along**2, axis=1), 1e-300)
        share = np.clip(np.sum(offset * along, axis=1) / length, 0.0, 1.0)
        apart = share[:, None] * along - offset
        distance = np.linalg.norm(apart, axis=1)
        force = self.field.force(distance - self.radius)[:, None] * apart / distance[:, None]
        tau = np.zeros(self.model.nv)
        for k in np.flatnonzero(force.any(axis=1)):
            point, n = a[k] + share[k] * along[k], self.joint[k]
            axes = self.data.J[:, :n]  # about the origin, linear rows first
            tau[:n] += force[k] @ axes[:3] + np.cross(point, force[k]) @ axes[3:]
        return tau

    def step(self) -> None:
        model, data, q, dq, hand = self.model, self.data, self.q, self.dq, self.hand
        pin.computeJointJacobiansTimeVariation(model, data, q, dq)
        pin.updateFramePlacement(model, data, hand)
        aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        J = pin.getFrameJacobian(model, data, hand, aligned).copy()
        J_dot = pin.getFrameJacobianTimeVariation(model, data, hand, aligned).copy()
        tau_vff = self.repulsion(self.k * DT)
        C = pin.computeCoriolisMatrix(model, data, q, dq)
        gravity = pin.computeGeneralizedGravity(model, data, q)
        upper = np.triu(pin.crba(model, data, q))
        M = upper + np.triu(upper, 1).T
        pose, dx = data.oMf[hand], J @ dq
        turned = pin.Quaternion(pose.rotation @ self.goal.rotation.T).coeffs()  # x, y, z, w
        error = np.concatenate(
            [pose.translation - self.goal.translation, 2 * np.copysign(turned[:3], turned[:3] * turned[3])]
        )
        Y = cholesky(M)(J.T)
        Lambda = np.linalg.inv(J @ Y)
        f = Lambda @ (Y.T @ (C @ dq) - self.damping * dx - self.stiffness * error - J_dot @ dq)
        momentum = Lambda @ dx
        task_motion = Y @ momentum
        y = J_dot.T @ momentum - C.T @ task_motion + tau_vff - self.null_damping * (M @ (dq - task_motion))
        tau = gravity + y + J.T @ (f - Lambda @ (Y.T @ y))
        self.dq = dq + DT * pin.aba(model, data, q, dq, tau)
        self.q = q + DT * self.dq
        self.k += 1


def report(times: dict[str, list[float]], apart: float) -> str:
    ours = median(times["vffnull, pose"])
    body = [[name, with_noise(seconds), f"{median(seconds) / ours:.3g}"] for name, seconds in times.items()]
    return f"""\
Medians of {REPETITIONS} interleaved repetitions, ± half of the distance from the least to the most. One
thread each.

{rows(["one step", "time", "multiple of ours"], body)}
- **Pinocchio + NumPy**: `crba`, `computeCoriolisMatrix` and the dense law; plant by `aba`. It makes our
  trajectory to {apart:.0e} rad over {STEPS} steps.
- **MuJoCo, `mj_step` alone**: the plant without a controller.
- **the plane, six links**: the scene of the first part, recorded as often.
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="nothing written")
    quick = parser.parse_args().quick
    document = panda(STEPS * DT)
    ours = vff.simulate(document, {"simulation.record_every": 1})
    apart = deviation(Dense(document), ours.q, STEPS)
    if not apart <= ALLOWED:
        raise SystemExit(f"Pinocchio + NumPy does not make our trajectory: {apart:.1e} > {ALLOWED:.0e} rad")
    flat = scene(6, STEPS * DT)
    flat["simulation"]["record_every"] = document["simulation"]["record_every"]
    loops: dict[str, Loop] = {
        "vffnull, pose": Compiled(Task(document)),
        "vffnull, position": Compiled(Task(panda(STEPS * DT, "position"))),
        "vffnull, pointing": Compiled(Task(panda(STEPS * DT, "pointing"))),
        "the plane, six links": Compiled(Task(flat)),
        "MuJoCo, `mj_step` alone": Plant(document),
        "Pinocchio + NumPy": Dense(document),
    }
    counts = {name: fitting(loop) for name, loop in loops.items()}
    times: dict[str, list[float]] = {name: [] for name in loops}
    for _ in range(REPETITIONS):
        for name, loop in loops.items():
            times[name].append(loop.run(counts[name]) / counts[name])
    text = report(times, apart)
    print(text)
    if not quick:
        write_section(ROOT / "docs" / "speed.md", "panda", text)


if __name__ == "__main__":
    main()
