"""Steps per second of the vector environment against a Python loop over single ones.

`python benches/gym.py [NUM_ENVS] [STEPS]`; both take the same actions, and their rewards are compared.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from gymnasium.vector import SyncVectorEnv

from vffnull.gym import ReachEnv, ReachVectorEnv


def rate(envs: Any, actions: np.ndarray) -> tuple[float, float]:
    """Steps per second and the sum of all rewards."""
    envs.reset(seed=0)
    total, start = 0.0, time.perf_counter()
    for action in actions:
        total += envs.step(action)[1].sum()
    return actions.shape[0] * actions.shape[1] / (time.perf_counter() - start), total


def loop(envs: list[ReachEnv], actions: np.ndarray) -> tuple[float, float]:
    """The same for single environments, one after the other, reset where they end."""
    for seed, env in enumerate(envs):
        env.reset(seed=seed)
    total, start = 0.0, time.perf_counter()
    over = [False] * len(envs)
    for action in actions:
        for i, env in enumerate(envs):
            if over[i]:
                env.reset()
                over[i] = False
                continue
            _, reward, terminated, truncated, _ = env.step(action[i])
            total += reward
            over[i] = terminated or truncated
    return actions.shape[0] * actions.shape[1] / (time.perf_counter() - start), total


def main(count: int, steps: int) -> None:
    """Measure each in turns, best of three."""
    print(f"{count} environments, {steps} steps each, sweep-through, best of three")
    for period in (1e-3, 1e-2):
        actions = np.random.default_rng(0).uniform(-0.1, 0.1, (steps, count, 6))
        ways = {
            "loop over ReachEnv": lambda actions, p=period: loop(
                [ReachEnv(period=p) for _ in range(count)], actions
            ),
            "SyncVectorEnv": lambda actions, p=period: rate(
                SyncVectorEnv([lambda: ReachEnv(period=p)] * count), actions
            ),
            "ReachVectorEnv, 1 thread": lambda actions, p=period: rate(
                ReachVectorEnv(count, period=p, threads=1), actions
            ),
            "ReachVectorEnv": lambda actions, p=period: rate(ReachVectorEnv(count, period=p), actions),
        }
        best: dict[str, float] = {}
        sums = set()
        for _ in range(3):
            for name, way in ways.items():
                speed, total = way(actions)
                best[name] = max(best.get(name, 0.0), speed)
                sums.add(round(total, 6))
        assert len(sums) == 1, sums
        print(f"period {1e3 * period:g} ms")
        for name, speed in best.items():
            print(f"  {name:<26}{speed:>12,.0f} steps/s  {speed / best['loop over ReachEnv']:5.1f}×")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:] or ("256", "200")))
