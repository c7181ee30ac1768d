"""A stand-in of ur_rtde: the methods that our adapter uses for each of its commands, before a simulated arm.

It tells nothing of how a robot behaves, which `vffnull.robots.emulated` does for torques. `test_robots.py`
compares its signatures with those of the wheel, where that is installed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

import vffnull as vff
from vffnull.robots.simulated import SimulatedRobot


class Plant:
    """An arm that carries its own weight, as these robots do, at rest at first."""

    def __init__(self, scenario: vff.Scenario, rate: float) -> None:
        self.robot = SimulatedRobot(scenario, rate, scenario.arm)
        self.period = 1.0 / rate

    def step(self, torque: list[float]) -> None:
        self.robot.write(torque)

    @property
    def state(self) -> tuple[float, Any, Any]:
        return self.robot.read()


class UR:
    """A stand-in of ``RTDEControlInterface`` and ``RTDEReceiveInterface`` at once."""

    def __init__(self, scenario: vff.Scenario, arm: vff.Arm) -> None:
        self.arm = arm
        self.plant = Plant(scenario, 500.0)
        self.servo: tuple[np.ndarray, np.ndarray] | None = None
        self.calls: list[str] = []
        self.connected, self.stopped, self.runs = True, False, True
        self._t = 0.0

    # Control

    def directTorque(
        self,
        torque: list[float],
        viscous_scale: list[float] | None = None,
        coulomb_scale: list[float] | None = None,
    ) -> bool:
        self.calls.append("directTorque")
        self.plant.step(torque)
        return self.runs

    def servoJ(
        self, arg0: list[float], arg1: float, arg2: float, arg3: float, arg4: float, arg5: float
    ) -> bool:
        assert arg3 == 0.002 and 0.03 <= arg4 <= 0.2 and 100.0 <= arg5 <= 2000.0
        self.calls.append("servoJ")
        before, _ = self._servo()
        self._go(np.array(arg0), (np.array(arg0) - before) / self.plant.period)
        return self.runs

    def speedJ(self, qd: list[float], acceleration: float = 0.5, time: float = 0.0) -> bool:
        assert acceleration > 0.0 and time == 0.002
        self.calls.append("speedJ")
        before, _ = self._servo()
        self._go(before + self.plant.period * np.array(qd), np.array(qd))
        return self.runs

    def servoStop(self, a: float = 10.0) -> bool:
        self.calls.append("servoStop")
        return True

    def speedStop(self, a: float = 10.0) -> bool:
        self.calls.append("speedStop")
        return True

    def stopScript(self) -> None:
        self.calls.append("stopScript")

    def setWatchdog(self, min_frequency: float = 10.0) -> bool:
        self.calls.append("setWatchdog")
        return True

    def setPayload(self, arg0: float, arg1: list[float]) -> bool:
        self.calls.append("setPayload")
        return self.runs

    def isProgramRunning(self) -> bool:
        return self.runs

    def reuploadScript(self) -> bool:
        self.runs = not self.stopped
        return self.runs

    def reconnect(self) -> bool:
        return self.connected

    def getMassMatrix(
        self, q: list[float] | None = None, include_rotors_inertia: bool = False
    ) -> list[float]:
        return self.arm.mass_matrix(q or self.getActualQ()).ravel().tolist()

    # Receive

    def isConnected(self) -> bool:
        return self.connected

    def getSafetyStatusBits(self) -> int:
        return 1 << 2 if self.stopped else 1

    def getTimestamp(self) -> float:
        return 1000.0 + (self._t if self.servo else self.plant.state[0])

    def getActualQ(self) -> list[float]:
        return (self.servo[0] if self.servo else self.plant.state[1]).tolist()

    def getActualQd(self) -> list[float]:
        return (self.servo[1] if self.servo else self.plant.state[2]).tolist()

    def _servo(self) -> tuple[np.ndarray, np.ndarray]:
        return self.servo or (self.plant.state[1], self.plant.state[2])

    def _go(self, q: np.ndarray, dq: np.ndarray) -> None:
        self.servo, self._t = (q, dq), self._t + self.plant.period
