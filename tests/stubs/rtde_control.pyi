"""The part of rtde_control that we use, as pybind11-stubgen writes it for ur_rtde 1.6.5; `test_robots.py`
compares it with the wheel.
"""

class RTDEControlInterface:
    def __init__(
        self,
        hostname: str,
        frequency: float = -1.0,
        flags: int = ...,
        ur_cap_port: int = 50002,
        rt_priority: int = 0,
    ) -> None: ...
    def directTorque(
        self,
        torque: list[float],
        viscous_scale: list[float] = [0.9, 0.9, 0.8, 0.9, 0.9, 0.9],
        coulomb_scale: list[float] = [0.8, 0.8, 0.7, 0.8, 0.8, 0.8],
    ) -> bool: ...
    def getMassMatrix(self, q: list[float] = [], include_rotors_inertia: bool = False) -> list[float]: ...
    def servoJ(
        self, arg0: list[float], arg1: float, arg2: float, arg3: float, arg4: float, arg5: float
    ) -> bool: ...
    def servoStop(self, a: float = 10.0) -> bool: ...
    def speedJ(self, qd: list[float], acceleration: float = 0.5, time: float = 0.0) -> bool: ...
    def speedStop(self, a: float = 10.0) -> bool: ...
    def stopScript(self) -> None: ...
