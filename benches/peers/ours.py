"""vffnull: the run as `simulate` makes it, and its law called from a loop in Python."""

from __future__ import annotations

from typing import Any

import vffnull as vff
from peers.law import Task
from peers.peer import Loop, Peer
from vffnull import _core


class Compiled(Loop):
    """A run in the core, record and metrics included."""

    def __init__(self, task: Task) -> None:
        self.document, self.dt = task.document, task.dt
        self.longest = round(self.document["duration"] / self.dt)
        self.simulation = vff.Simulation(self.document)
        self.q = self.simulation.state.q

    def step(self) -> None:
        """One step by hand, to see the trajectory."""
        self.q = self.simulation.step().q

    def run(self, steps: int) -> float:
        """The core's own time for the steps of runs that begin at t = 0."""
        seconds = 0.0
        while steps > 0:
            now = min(steps, self.longest)
            result = _core.run(self.document | {"duration": now * self.dt}, None)
            if result["status"] != "completed":
                raise RuntimeError(result["message"])
            seconds += result["wall_time"]
            steps -= now
        return seconds


class Called(Loop):
    """The law by `Controller.torque`, the plant by `Arm.forward_dynamics`."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.controller = vff.Controller(task.arm, task.document["controller"])
        self.obstacles = [disc(o) for o in task.document["obstacles"]]
        self.q, self.dq, self.k = task.q0, task.dq0, 0

    def step(self) -> None:
        task, t = self.task, self.k * self.task.dt
        reference = task.reference(t)
        tau = self.controller.torque(self.q, self.dq, *reference, obstacles=self.obstacles, t=t)
        self.dq = self.dq + task.dt * task.arm.forward_dynamics(self.q, self.dq, tau)
        self.q = self.q + task.dt * self.dq
        self.k += 1


def disc(document: dict[str, Any]) -> vff.Obstacle:
    motion = dict(document.get("motion", {"kind": "static"}))
    make = getattr(vff.Motion, motion.pop("kind"))
    return vff.Obstacle.circle(document["position"], document["shape"]["radius"], make(**motion))


PEERS = (
    Peer("vffnull", "the whole run in the core, recorded, with every metric", ("vffnull",), Compiled),
    Peer(
        "vffnull, called from Python",
        "`Controller.torque`; plant by `Arm.forward_dynamics`",
        ("vffnull", "numpy"),
        Called,
    ),
)
