"""
Our controller as a policy
==========================

The Gymnasium environment hands out joint torques at 1 kHz; the policy is the law, which knows nothing but
the observation. With its field it makes every episode that it loses without.
"""

from __future__ import annotations

import gymnasium
import numpy as np
from numpy.typing import NDArray

import vffnull as vff
from vffnull.draw import style

SETTINGS = {"scenario": "sweep-through", "action": "torque", "period": 1e-3, "torque": 1000.0}
env = gymnasium.make("vffnull.engines.gym:vffnull/Reach-v0", **SETTINGS)
scenario, layout, scale = env.unwrapped.scenario, env.unwrapped.layout, env.unwrapped.torque
radii = [obstacle["shape"]["radius"] for obstacle in scenario["obstacles"]]


def act(controller: vff.Controller, seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """The action of the law for what is seen."""
    part = {name: seen[where] for name, where in layout.items()}
    q = np.arctan2(part["sin_q"], part["cos_q"])
    places, speeds = (part[name].reshape(-1, 2) for name in ("obstacles", "obstacle_velocities"))
    discs = [
        vff.Obstacle.circle(place, radius, vff.Motion.linear(speed))
        for place, radius, speed in zip(places, radii, speeds, strict=True)
    ]
    tau = controller.torque(q, part["dq"], part["reference"], part["reference_velocity"], obstacles=discs)
    return np.clip(tau / scale, -1, 1)


with style.look():
    fig = style.figure(2.6, 5.0)
    ax = fig.subplots()
    for field, colour in ((True, "#0072B2"), (False, "#D55E00")):
        kept = {name: value for name, value in scenario["controller"].items() if field or name != "field"}
        controller = vff.Controller(scenario.arm, kept)
        for seed in range(3):
            seen, info = env.reset(seed=seed)
            clearances, over = [info["clearance"]], False
            while not over:
                seen, _, terminated, truncated, info = env.step(act(controller, seen))
                clearances.append(info["clearance"])
                over = terminated or truncated
            label = f"field {'on' if field else 'off'}" if seed == 0 else None
            ax.plot(1e-3 * np.arange(len(clearances)), clearances, color=colour, label=label)
            print(f"field {'on ' if field else 'off'}, episode {seed}: clearance {min(clearances):+.3f} m")
    ax.axhline(0.0, color=style.INK, linewidth=0.8)
    ax.set_xlabel("time [s]")
    ax.set_ylabel("clearance [m]")
    ax.legend()
    fig.savefig("gym_our_controller.png")
