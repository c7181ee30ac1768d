"""Our controller as a policy: from observation to joint torque, in the Gymnasium environment.

`python examples/gym_our_controller.py [EPISODES]` needs `pip install "vffnull[gym]"`. The environment hands
out joint torques (`action="torque"`) at 1 kHz; the policy knows nothing but the observation.
"""

from __future__ import annotations

import sys

import gymnasium
import numpy as np
from numpy.typing import NDArray

import vffnull as vff

NAME = "vffnull.gym:vffnull/Reach-v0"


def policy(env: gymnasium.Env, field: bool) -> vff.Controller:
    """The controller of the environment's scenario, with its field or without."""
    settings = dict(env.unwrapped.scenario["controller"])
    if not field:
        del settings["field"]
    return vff.Controller(env.unwrapped.scenario.arm, settings)


def act(controller: vff.Controller, env: gymnasium.Env, seen: NDArray[np.float64]) -> NDArray[np.float64]:
    """The action of the law for what is seen."""
    part = {name: seen[where] for name, where in env.unwrapped.layout.items()}
    q = np.arctan2(part["sin_q"], part["cos_q"])
    shapes = [obstacle["shape"] for obstacle in env.unwrapped.scenario["obstacles"]]
    places, speeds = (part[name].reshape(-1, 2) for name in ("obstacles", "obstacle_velocities"))
    discs = zip(shapes, places, speeds, strict=True)
    obstacles = [vff.Obstacle.circle(p, s["radius"], vff.Motion.linear(v)) for s, p, v in discs]
    tau = controller.torque(q, part["dq"], part["reference"], part["reference_velocity"], obstacles=obstacles)
    return np.clip(tau / env.unwrapped.torque, -1, 1)


def main(episodes: int) -> None:
    """Play with the field and without, and print what came of it."""
    for field in (True, False):
        env = gymnasium.make(NAME, scenario="sweep-through", action="torque", period=1e-3, torque=1000.0)
        controller, clearances = policy(env, field), []
        for seed in range(episodes):
            seen, info = env.reset(seed=seed)
            clearance, over = info["clearance"], False
            while not over:
                seen, _, terminated, truncated, info = env.step(act(controller, env, seen))
                clearance, over = min(clearance, info["clearance"]), terminated or truncated
            clearances.append(clearance)
        hit = np.mean(np.array(clearances) < 0)
        print(f"field {'on' if field else 'off':>3}: hit {hit:4.0%}, clearance {min(clearances):.3f} m")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
