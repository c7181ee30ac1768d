"""Draw docs/figures/set-points.png, what position servos cost: `python docs/make_set_points.py`.

Needs vffnull[mujoco]. A Panda in MuJoCo draws a circle with its hand while a ball is swept through its elbow:
under the torque of the controller, and under position servos that follow the set points of a `VirtualArm`,
at once, 8 ms late, and as late with a reference and a ball that are as much ahead.
"""

from __future__ import annotations

import re
from collections import deque
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

import vffnull as vff
from vffnull import _core
from vffnull.arms import to_mjcf

FIGURES = Path(__file__).resolve().parent / "figures"
READY = np.array([0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854])
PERIOD = 1e-3
DURATION = 6.0
SETTINGS = vff.ControlSettings(
    task="pose",
    stiffness=900.0,
    damping=60.0,
    null_damping=12.0,
    posture=READY,
    posture_stiffness=3.0,
    field=vff.Field.bounded(80.0, 0.25),
)
# Servos with the gains of MuJoCo Menagerie's Panda, fed with the velocity of the set point too.
KP = [4500.0, 4500.0, 3500.0, 3500.0, 2000.0, 2000.0, 2000.0]
KV = [450.0, 450.0, 350.0, 350.0, 200.0, 200.0, 200.0]
# Franka's limits of the joint position interface.
ACCELERATION = [15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0]
JERK = [7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0]

Array = NDArray[np.float64]


@dataclass
class Outcome:
    """What a robot did: a row per cycle."""

    t: Array
    error: Array  # of the hand [m], (T,)
    clearance: Array  # of the nearest link [m], (T,)
    q: Array  # (T, 7)
    set_points: Array  # q, dq, ddq, (T, 3, 7)
    courses: list[str]


def ball() -> vff.Obstacle:
    """It comes from the right and passes where the elbow is."""
    return vff.Obstacle.sphere([-0.05, -0.6, 0.62], 0.08, motion=vff.Motion.linear([0.0, 0.2, 0.0]))


def servos(arm: str) -> str:
    """A model whose motors are position servos, in a robot that carries itself."""
    names = re.findall(r'<joint name="(\w+)"', arm)
    lines = [
        f'<position joint="{name}" kp="{kp}" /><velocity joint="{name}" kv="{kv}" />'
        for name, kp, kv in zip(names, KP, KV, strict=True)
    ]
    arm = re.sub(r"<actuator>.*</actuator>", f"<actuator>{''.join(lines)}</actuator>", arm, flags=re.DOTALL)
    return arm.replace('<body name="panda_link', '<body gravcomp="1" name="panda_link')


def circle(start: Array, t: float) -> tuple[Array, Array, Array]:
    """The pose of the hand, its velocity and acceleration: smooth from rest on, round after round."""
    radius, turn, soft = 0.1, 2.0, 1.0  # m, rad/s, s
    s = min(t / soft, 1.0)
    angle = turn * (t - soft * (s - s**3 + 0.5 * s**4)) if s < 1 else turn * (t - 0.5 * soft)
    rate = turn * (3 * s**2 - 2 * s**3)
    change = turn * (6 * s - 6 * s**2) / soft if s < 1 else 0.0
    along, out = np.array([0, np.cos(angle), np.sin(angle)]), np.array([0, -np.sin(angle), np.cos(angle)])
    x = start.copy()
    x[:3] += radius * (along - [0, 1, 0])
    dx, ddx = np.zeros(6), np.zeros(6)
    dx[:3] = radius * rate * out
    ddx[:3] = radius * (change * out - rate**2 * along)
    return x, dx, ddx


def run(delay: float | None, ahead: float = 0.0, duration: float = DURATION) -> Outcome:
    """The robot under position servos that are so late [s], or, if that is None, under torque.

    The set points are those of a reference and a ball that are `ahead` [s].
    """
    arm, obstacle = vff.Arm.named("panda"), ball()
    xml = to_mjcf(_core.arm_model("panda"))
    model = mujoco.MjModel.from_xml_string(xml if delay is None else servos(xml))
    model.opt.timestep = PERIOD
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.geom_contype[:] = 0  # what would touch is measured, not felt
    data = mujoco.MjData(model)
    data.qpos[:] = READY
    controller, law = vff.Controller(arm, SETTINGS), vff.Controller(arm, SETTINGS)
    virtual = vff.VirtualArm(controller, READY, PERIOD, ACCELERATION, JERK)
    start = np.concatenate(arm.pose(READY))
    steps = round(duration / PERIOD)
    waiting = deque([(READY, np.zeros(7))] * (0 if delay is None else round(delay / PERIOD)))
    outcome = Outcome(
        PERIOD * np.arange(steps),
        *(np.zeros(steps) for _ in range(2)),
        np.zeros((steps, 7)),
        np.zeros((steps, 3, 7)),
        [],
    )
    for k in range(steps):
        t, q, dq = k * PERIOD, data.qpos.copy(), data.qvel.copy()
        reference = circle(start, t)
        terms = law.terms(q, dq, *reference, obstacles=[obstacle], t=t)
        outcome.q[k] = q
        outcome.error[k] = np.linalg.norm(arm.pose(q)[0] - reference[0][:3])
        outcome.clearance[k] = terms.clearance.min()
        if delay is None:
            data.ctrl[:] = terms.tau
        else:
            then = circle(start, t + ahead)
            *point, course = virtual.step(t + ahead, *then, obstacles=[obstacle], q=q, dq=dq)
            outcome.set_points[k] = point
            outcome.courses.append(course)
            waiting.append((point[0], point[1]))
            wanted = waiting.popleft()
            data.ctrl[0::2], data.ctrl[1::2] = wanted
        mujoco.mj_step(model, data)
    return outcome


def main() -> None:
    """What the robots do, and how that differs from what torque does."""
    from vffnull.draw import style

    torque = run(None)
    robots = [
        ("torque", torque, style.INK, "-"),
        ("position servos", run(0.0), "#2166AC", "-"),
        ("8 ms late", run(0.008), style.ALARM, "-"),
        ("8 ms late, reference and ball 8 ms ahead", run(0.008, 0.008), style.ALARM, "--"),
    ]
    with style.look():
        figure = style.figure(4.4, style.PAGE)
        error, clearance, lost = figure.subplots(3, 1, sharex=True)
        clearance.plot(torque.t, 1e3 * torque.clearance, color=style.INK)
        for name, outcome, colour, line in robots:
            least = f"least {1e3 * outcome.clearance.min():.1f} mm"
            most = f"{name}: up to {1e3 * outcome.error.max():.2f} mm"
            kind = {"color": colour, "linewidth": 1.2, "linestyle": line}
            error.plot(outcome.t, 1e3 * outcome.error, label=most, **kind)
            lost.plot(outcome.t, 1e3 * (outcome.clearance - torque.clearance), label=least, **kind)
            apart = np.abs(outcome.q - torque.q).max()
            print(f"{most}, clearance {least}, joints {apart:.4f} rad from those under torque")
        error.set_ylabel("error of\nthe hand [mm]")
        error.set_ylim(0.0, 3.2)
        clearance.set_ylabel("clearance\n[mm]")
        clearance.set_ylim(0.0, None)
        clearance.text(0.99, 0.1, "under torque", transform=clearance.transAxes, ha="right", fontsize=7.5)
        lost.set_ylabel("compared with\ntorque [mm]")
        lost.set_ylim(-3.8, 2.0)
        lost.set_xlabel("$t$ [s]")
        lost.set_xlim(0.0, DURATION)
        for axes, place in ((error, "upper right"), (lost, "lower left")):
            axes.legend(frameon=False, fontsize=7.5, ncols=2, loc=place)
        figure.align_ylabels()
        figure.savefig(FIGURES / "set-points.png")


if __name__ == "__main__":
    main()
