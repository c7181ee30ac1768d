"""A random policy beside no policy at all in the Gymnasium environment, many episodes at a time.

`python examples/gym_random_policy.py [EPISODES]` needs `pip install "vffnull[gym]"`. The action is a torque
in the null space of the task: whatever it is, the tip stays on its reference, and the law's own field still
pushes the links away from the obstacle.
"""

from __future__ import annotations

import sys
import time

import numpy as np
from gymnasium.vector import AutoresetMode

from vffnull.gym import ReachVectorEnv


def play(envs: ReachVectorEnv, random: bool) -> tuple[float, float, float, int]:
    """One episode in each: mean return, share of collisions, largest tracking error [m], steps."""
    count = envs.num_envs
    envs.reset(seed=0)
    envs.action_space.seed(0)
    returns, collided = np.zeros(count), np.zeros(count, dtype=bool)
    going, worst, steps = np.ones(count, dtype=bool), 0.0, 0
    while going.any():
        action = envs.action_space.sample() if random else np.zeros(envs.action_space.shape)
        _, reward, terminated, truncated, info = envs.step(action)
        returns += np.where(going, reward, 0.0)
        collided |= going & terminated
        worst = max(worst, info["tracking_error"][going].max())
        steps += count
        going &= ~(terminated | truncated)
    return returns.mean(), collided.mean(), worst, steps


def main(episodes: int) -> None:
    """Play both and print what came of it."""
    # With NEXT_STEP, those that are over begin again and do not disturb the others.
    envs = ReachVectorEnv(
        episodes, "sweep-through", start_noise=0.0, torque=2.0, autoreset_mode=AutoresetMode.NEXT_STEP
    )
    for name, random in (("no action", False), ("random", True)):
        start = time.perf_counter()
        value, collisions, worst, steps = play(envs, random)
        rate = steps / (time.perf_counter() - start)
        print(f"{name:>9}: return {value:7.1f}, collisions {collisions:4.0%}, ", end="")
        print(f"tracking error up to {1e3 * worst:.2f} mm, {rate:,.0f} steps/s")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 64)
