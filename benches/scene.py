"""The scenes in which the step is counted and timed: a planar arm of any number of links, and a Panda.

`scene`: 6 m and 6 kg of uniform arm, bent along an arc, whatever the number of its links. Its tip draws a
circle, and one disc swings beside its middle, within the field's reach. The law is held at 1 kHz, the plant
is semi-implicit Euler. `panda`: seven joints under gravity hold the pose of their hand while a ball swings
beside the elbow, whose capsules the field reaches; held and integrated likewise.
"""

from __future__ import annotations

from typing import Any

import numpy as np

DT = 1e-3  # s, the control period and the step of the plant
LENGTH = 6.0  # m, the whole arm
BESIDE = 0.45  # m, from the middle of the arm to the centre of the disc
GAIN = 1.2  # N·m³, of all links together: every link in reach is pushed, and many short ones are
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])


def scene(n: int, duration: float) -> dict[str, Any]:
    """The document of a scenario over `duration` [s]."""
    link = LENGTH / n
    q0 = np.full(n, -2.0 / (n - 1))
    q0[0] = 1.2
    theta = np.cumsum(q0)
    steps = link * np.stack([np.cos(theta), np.sin(theta)], axis=1)
    joints = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    along = joints[n // 2 + 1] - joints[n // 2 - 1]
    disc = joints[n // 2] + BESIDE * TURN @ along / np.linalg.norm(along)
    return {
        "name": f"{n} links",
        "duration": duration,
        "q0": q0.tolist(),
        "arm": {"lengths": [link] * n, "masses": link},
        "reference": {
            "kind": "circle",
            "center": (joints[n] - [0.2, 0.0]).tolist(),
            "radius": 0.2,
            "angular_velocity": 1.0,
        },
        "controller": {
            "stiffness": 100.0,
            "damping": 20.0,
            "null_damping": 6.0,
            "field": {"kind": "khatib", "gain": GAIN / n, "influence": 0.6},
        },
        "obstacles": [
            {
                "shape": {"kind": "circle", "radius": 0.1},
                "position": disc.tolist(),
                "motion": {"kind": "sinusoid", "amplitude": [0.03, 0.05], "angular_frequency": 2.0},
            }
        ],
        "simulation": {"dt": DT, "integrator": "semi_implicit_euler", "control": "hold"},
    }


READY = [0.0, -0.7854, 0.0, -2.3562, 0.0, 1.5708, 0.7854]  # rad, the maker's posture


def panda(duration: float, task: str = "pose") -> dict[str, Any]:
    """The document of a scenario over `duration` [s]."""
    return {
        "name": f"panda, {task}",
        "duration": duration,
        "q0": READY,
        "arm": {"model": "panda"},
        "reference": {"kind": "setpoint"},
        "controller": {
            "task": task,
            "stiffness": 900.0,
            "damping": 60.0,
            "null_damping": 6.0,
            "field": {"kind": "bounded", "gain": 20.0, "influence": 0.3},
        },
        "obstacles": [
            {
                "shape": {"kind": "sphere", "radius": 0.08},
                "position": [-0.05, -0.25, 0.62],
                "motion": {"kind": "sinusoid", "amplitude": [0.03, 0.05, 0.0], "angular_frequency": 2.0},
            }
        ],
        "simulation": {
            "dt": DT,
            "integrator": "semi_implicit_euler",
            "control": "hold",
            "record_every": 30,
        },
    }
