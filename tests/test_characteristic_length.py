"""`controller.characteristic_length`: an angle counts as its arc where metres and radians meet."""

from __future__ import annotations

import numpy as np
import pytest

import vffnull as vff

ARM = vff.Arm.uniform(4)
Q, DQ = [0.4, 0.5, -0.6, 0.3], [0.0] * 4


def pulled(angle: float, length: float, avoidance: str) -> np.ndarray:
    """The torque at an error of `angle` [rad], the position being that of the reference."""
    tip = ARM.forward_kinematics(Q)[-1]
    settings = vff.ControlSettings(task="pose", avoidance=avoidance, characteristic_length=length)  # type: ignore[arg-type]
    controller = vff.Controller(ARM, settings)
    tau: np.ndarray = controller.torque(Q, DQ, x_ref=[*tip, sum(Q) - angle])
    return tau


def test_a_saturated_error_is_an_arc() -> None:
    """`relaxed` pulls no harder than by 0.5 m: with 2 m that is 0.25 rad, with 0.1 m 1 rad is within."""
    assert pulled(1.0, 2.0, "relaxed") == pytest.approx(pulled(0.25, 2.0, "null_space"), rel=1e-9)
    assert pulled(1.0, 0.1, "relaxed") == pytest.approx(pulled(1.0, 0.1, "null_space"), rel=1e-9)
    assert pulled(1.0, 1.0, "relaxed") == pytest.approx(pulled(0.5, 1.0, "null_space"), rel=1e-9)


@pytest.mark.parametrize("avoidance", ["cbf", "relaxed"])
def test_a_position_has_no_angle(avoidance: str) -> None:
    """Not a bit depends on it."""
    changes = {"controller.avoidance": avoidance, "duration": 1.0}
    near, far = (
        vff.simulate("on-path", changes | {"controller.characteristic_length": length})
        for length in (0.3, 2.0)
    )
    assert np.array_equal(near.tau, far.tau)


def test_it_is_a_length() -> None:
    with pytest.raises(vff.errors.ScenarioError, match="characteristic_length"):
        vff.ControlSettings(characteristic_length=0.0)
