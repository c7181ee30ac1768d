"""Stand-ins of makers' interfaces: the methods that our adapters use, with a simulated arm behind them.

They are not the makers' libraries, and tell nothing of how a robot behaves. `test_robots.py` compares their
signatures with those of the wheels, where these are installed.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
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


class Franka:
    """A stand-in of ``pylibfranka.Robot`` and of the control that it hands out."""

    def __init__(self, scenario: vff.Scenario) -> None:
        self.plant = Plant(scenario, 1000.0)
        self.calls: list[str] = []
        self.torque = np.zeros(7)
        self.fails_at: int | None = None
        self._answered = True
        self._lost = 0

    def start_torque_control(self) -> Franka:
        self.calls.append("start_torque_control")
        return self

    def readOnce(self) -> tuple[Any, Any]:
        """Wait for the next state; 20 in a row without an answer are the end."""
        self._lost = 0 if self._answered else self._lost + 1
        if self._lost > 20:
            raise RuntimeError("communication_constraints_violation")
        if not self._answered:
            self.plant.step(self.torque.tolist())
        self._answered = False
        self.calls.append("readOnce")
        if self.fails_at is not None and self.calls.count("readOnce") >= self.fails_at:
            raise RuntimeError("libfranka: Move command aborted: motion aborted by reflex!")
        t, q, dq = self.plant.state
        state = SimpleNamespace(
            time=SimpleNamespace(to_sec=lambda: t), q=q.tolist(), dq=dq.tolist(), tau_J_d=self.torque.tolist()
        )
        return state, SimpleNamespace(to_sec=lambda: 0.001)

    def writeOnce(self, arg0: Any) -> None:
        """One answer per state, whose torque may change by 1000 N·m/s."""
        assert not self._answered, "two commands for one state"
        torque = np.asarray(arg0.tau_J)
        if arg0.motion_finished:
            self.calls.append("finished")
            return
        if np.abs(torque - self.torque).max() > 1.0 + 1e-9:
            raise RuntimeError("controller_torque_discontinuity")
        self.calls.append("writeOnce")
        self.torque, self._answered = torque, True
        self.plant.step(torque.tolist())

    def stop(self) -> None:
        self.calls.append("stop")

    def read_once(self) -> Any:
        t, q, dq = self.plant.state
        return SimpleNamespace(time=SimpleNamespace(to_sec=lambda: t), q=q.tolist(), dq=dq.tolist())

    def load_model(self) -> Any:
        arm = vff.Arm.named("panda")
        return SimpleNamespace(
            gravity=lambda state: arm.gravity_torque(state.q).tolist(),
            mass=lambda state: arm.mass_matrix(state.q).T.ravel().tolist(),
        )


@dataclass
class FrankaTorques:
    """A stand-in of ``pylibfranka.Torques``."""

    tau_J: list[float]
    motion_finished: bool = False


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

    def getMassMatrix(
        self, q: list[float] | None = None, include_rotors_inertia: bool = False
    ) -> list[float]:
        return self.arm.mass_matrix(q or self.getActualQ()).ravel().tolist()

    # Receive

    def isConnected(self) -> bool:
        return self.connected

    def isEmergencyStopped(self) -> bool:
        return False

    def isProtectiveStopped(self) -> bool:
        return self.stopped

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
