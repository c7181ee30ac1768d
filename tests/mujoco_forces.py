"""What MuJoCo makes of a state: inertia and joint forces."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def forces(model: Any, data: Any, ddq: Array) -> dict[str, Array]:
    """M, C q̇, g, and both ways of the dynamics for the state and the torques in `data`.

    To be asked last: `data` is at rest afterwards. MuJoCo does not form C as a matrix.
    """
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    out = {"M": mass, "forward dynamics": data.qacc.copy()}
    bias = data.qfrc_bias.copy()
    data.qacc[:] = ddq
    mujoco.mj_inverse(model, data)
    out["inverse dynamics"] = data.qfrc_inverse.copy()
    data.qvel[:] = 0.0
    mujoco.mj_forward(model, data)
    out["g"] = data.qfrc_bias.copy()
    out["C q̇"] = bias - out["g"]
    return out
