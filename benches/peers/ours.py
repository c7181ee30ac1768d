"""vffnull: the run as `simulate` makes it, and its law called from a loop in Python."""

from __future__ import annotations

import numpy as np

import vffnull as vff
from peers.law import STEPS, Task
from peers.peer import Loop, Peer
from scene import DT
from vffnull import _core


class Compiled(Loop):
    """A run in the core, record and metrics included."""

    def __init__(self, n: int) -> None:
        self.document = Task(n).document
        self.simulation = vff.Simulation(self.document)
        self.q = self.simulation.state.q

    def step(self) -> None:
        """One step by hand, to see the trajectory."""
        self.q = self.simulation.step().q

    def run(self, steps: int) -> float:
        """The core's own time for the steps of a run from t = 0."""
        seconds = 0.0
        while steps > 0:
            now = min(steps, STEPS)
            result = _core.run(self.document | {"duration": now * DT}, None)
            if result["status"] != "completed":
                raise SystemExit(result["message"])
            seconds += result["wall_time"]
            steps -= now
        return seconds


class Called(Loop):
    """The law by `Controller.torque`, the plant by `Arm.forward_dynamics`."""

    def __init__(self, n: int) -> None:
        task = Task(n)
        control = task.document["controller"]
        settings = vff.ControlSettings(
            stiffness=task.stiffness,
            damping=task.damping,
            null_damping=task.null_damping,
            field=vff.Field.khatib(control["field"]["gain"], control["field"]["influence"]),
        )
        (disc,) = task.document["obstacles"]
        motion = vff.Motion.sinusoid(disc["motion"]["amplitude"], disc["motion"]["angular_frequency"])
        self.obstacles = [vff.Obstacle.circle(disc["position"], disc["shape"]["radius"], motion)]
        self.arm, self.reference = task.arm, task.reference
        self.controller = vff.Controller(task.arm, settings)
        self.q, self.dq, self.k = task.q0, np.zeros(n), 0

    def step(self) -> None:
        t = self.k * DT
        tau = self.controller.torque(self.q, self.dq, *self.reference(t), obstacles=self.obstacles, t=t)
        self.dq = self.dq + DT * self.arm.forward_dynamics(self.q, self.dq, tau)
        self.q = self.q + DT * self.dq
        self.k += 1


PEERS = (
    Peer("vffnull", "the whole run in the core, with record and 25 metrics", ("vffnull",), Compiled),
    Peer(
        "vffnull, called from Python",
        "`Controller.torque`; plant by `Arm.forward_dynamics`",
        ("vffnull", "numpy"),
        Called,
    ),
)
