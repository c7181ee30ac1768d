"""The closed loop that all ways drive: `vffnull.Simulation`, a timed torque every millisecond.

Times are those of the processor, all threads together, which other programs on the machine disturb least.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import process_time_ns
from typing import Any

import numpy as np

import vffnull as vff
from peers.spatial.task import Array, Task
from peers.spatial.way import Controller, Settings, Way
from vffnull import evaluation
from vffnull.evaluation.geometry.arm import SpatialArm
from vffnull.evaluation.geometry.space import Obstacles
from vffnull.run import evaluate as evaluating
from vffnull.run.evaluate import TOUCH

EVERY = 10  # steps between the instants at which errors are taken, as in `vffnull.evaluate`


@dataclass(frozen=True)
class Outcome:
    """What became of a run: its row, and the time of the processor for every step of control [ns]."""

    row: dict[str, Any]
    taken: Array


def free(scene: vff.Scenario) -> vff.Result:
    """The run without avoidance, which says when the encounter is."""
    return vff.simulate(
        scene, {**evaluation.CONTROLLERS["no avoidance"], "simulation.record_every": EVERY}, progress=False
    )


def drive(
    way: Way,
    settings: Settings,
    scene: vff.Scenario,
    span: tuple[float, float] | None,
    verdict: str,
    most: int | None = None,
    until_contact: bool = False,
) -> Outcome:
    """Run a scene under a way; `most` limits the steps, and with `until_contact` a collision ends the run.

    The plant takes any torque: that of a library is cut off at the arm's limits here. What the core runs
    itself keeps them by its own law, and its times contain the plant.
    """
    changes = way.changes(settings) if way.changes else {}
    scene = scene.replace(**changes)
    task = Task(scene)
    controller = way.prepare(task, settings) if way.prepare else None
    simulation, limits = vff.Simulation(scene), task.arm.torque_limits
    state, steps = simulation.state, min(task.steps, most or task.steps)
    q, dq, tau = np.empty((steps + 1, task.arm.n)), np.empty((steps + 1, task.arm.n)), None
    torques, taken = np.zeros((steps + 1, task.arm.n)), np.zeros(steps, dtype=np.int64)
    q[0], dq[0] = state.q, state.dq
    torques[0] = state.tau
    clearance = [float(state.clearance.min())]
    k = cut = 0
    if controller is not None:  # compiles what is compiled
        controller.torque(0, q[0], dq[0])
        controller.reset()
    while k < steps and not simulation.done:
        begin = process_time_ns()
        if controller is None:
            state = simulation.step()
            taken[k] = process_time_ns() - begin
        else:
            tau = controller.torque(k, q[k], dq[k])
            taken[k] = process_time_ns() - begin
            if not np.all(np.isfinite(tau)):
                break
            held = tau if limits is None else np.clip(tau, -limits, limits)
            cut += bool((held != tau).any())
            state = simulation.step(held)
            torques[k] = held
        if simulation.status == "diverged":
            break
        k += 1
        q[k], dq[k] = state.q, state.dq
        if controller is None:
            torques[k] = state.tau
        clearance.append(float(state.clearance.min()))
        if until_contact and clearance[-1] < -TOUCH:
            steps = k
    if controller is not None:
        torques[k] = torques[k - 1] if k else 0.0
    return Outcome(
        evaluating.identity(scene, verdict, way.name)
        | _scores(task, span, q[: k + 1], dq[: k + 1], torques[: k + 1], clearance, k == steps)
        | {
            "cut_off": cut / max(k, 1),
            "unsolved": controller.unsolved / max(k, 1) if controller else 0.0,
            "model_clearance": _by_spheres(controller, task, q[: k + 1]),
        },
        taken[:k],
    )


def _by_spheres(controller: Controller | None, task: Task, q: Array) -> float:
    """The smallest distance of the spheres that a controller takes for the arm [m]; NaN if it takes none."""
    if controller is None or controller.spheres is None:
        return np.nan
    spheres, seen = controller.spheres, slice(None, None, EVERY)
    poses = SpatialArm(task.arm.to_dict()).link_poses(q[seen])[:, spheres.link]
    centers = np.einsum("ksij,sj->ksi", poses[..., :3, :3], spheres.center) + poses[..., :3, 3]
    ends = np.repeat(centers[:, :, None], 2, axis=2)
    return float(Obstacles(task.solids).distances(ends, spheres.radius, task.times[: len(q)][seen]).min())


def _scores(
    task: Task,
    span: tuple[float, float] | None,
    q: Array,
    dq: Array,
    torques: Array,
    clearance: list[float],
    through: bool,
) -> dict[str, Any]:
    """The columns of `vffnull.evaluate`, and how far joints went beyond their limits."""
    arm, dt, k = task.arm, task.dt, len(q) - 1
    poses = SpatialArm(arm.to_dict()).tool_poses(q)
    far, angle = task.astray(poses)
    seen = np.unique(np.append(np.arange(0, k + 1, EVERY), k))
    jerk = np.diff(dq, 2, axis=0) / dt**2
    row = evaluating.scores(
        status="completed" if through else "diverged",
        t=task.times[seen],
        error=far[seen],
        angle=None if angle is None else angle[seen],
        span=span,
        min_clearance=min(clearance),
        max_error=float(far.max()),
        effort=float((torques**2).sum() * dt),
        rms_jerk=float(np.sqrt((jerk**2).mean())) if len(jerk) else np.nan,
        end_time=float(task.times[k]),
    )
    beyond = fast = 0.0
    if arm.joint_limits is not None:
        low, high = arm.joint_limits.T
        beyond = max(0.0, float((low - q).max()), float((q - high).max()))
    if arm.velocity_limits is not None:
        fast = float((np.abs(dq) / arm.velocity_limits).max())
    return row | {"beyond_joint_limit": beyond, "speed_ratio": fast}
