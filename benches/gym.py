"""Steps per second of the vector environment against a Python loop over single ones.

`python benches/gym.py [NUM_ENVS] [STEPS] [SCENARIO]`; both take the same actions, and their rewards are
compared. For an arm in space MuJoCo's `mj_step` stands beside them, if it is installed: the same arm among
the same obstacles, which stand still, stepped as often, without controller, observation and reward.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import numpy as np
from gymnasium.vector import SyncVectorEnv

import vffnull as vff
from vffnull import arms
from vffnull.engines.gym import ReachEnv, ReachVectorEnv


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


def physics(scenario: vff.Scenario, steps: int, period: float) -> float | None:
    """Steps per second of MuJoCo alone, on one thread; None without it or in the plane."""
    arm, step = scenario.arm, 1e-3
    try:
        import mujoco
    except ImportError:
        return None
    if arm.dimension == 2:
        return None
    text = arms.to_mjcf(arm.to_dict(), scenario.to_dict().get("obstacles", []))
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = step
    data = mujoco.MjData(model)
    data.qpos[:] = scenario["q0"]
    start = time.perf_counter()
    for _ in range(steps):
        mujoco.mj_step(model, data, round(period / step))
    return steps / (time.perf_counter() - start)


def main(count: int, steps: int, name: str = "sweep-through") -> None:
    """Measure each in turns, best of three."""
    print(f"{count} environments, {steps} steps each, {name}, best of three")
    scenario = vff.Scenario.load(name)
    for period in (1e-3, 1e-2):
        actions = np.random.default_rng(0).uniform(-0.1, 0.1, (steps, count, scenario.arm.n))
        ways = {
            "loop over ReachEnv": lambda actions, p=period: loop(
                [ReachEnv(scenario, period=p) for _ in range(count)], actions
            ),
            "SyncVectorEnv": lambda actions, p=period: rate(
                SyncVectorEnv([lambda: ReachEnv(scenario, period=p)] * count), actions
            ),
            "ReachVectorEnv, 1 thread": lambda actions, p=period: rate(
                ReachVectorEnv(count, scenario, period=p, threads=1), actions
            ),
            "ReachVectorEnv": lambda actions, p=period: rate(
                ReachVectorEnv(count, scenario, period=p), actions
            ),
        }
        best: dict[str, float] = {}
        sums = set()
        for _ in range(3):
            for label, way in ways.items():
                speed, total = way(actions)
                best[label] = max(best.get(label, 0.0), speed)
                sums.add(round(total, 6))
        assert len(sums) == 1, sums
        print(f"period {1e3 * period:g} ms")
        if theirs := max((physics(scenario, count * steps, period) or 0.0 for _ in range(3)), default=0.0):
            best["mj_step alone, 1 thread"] = theirs
        for label, speed in best.items():
            print(f"  {label:<26}{speed:>12,.0f} steps/s  {speed / best['loop over ReachEnv']:5.1f}×")


if __name__ == "__main__":
    counts = [int(argument) for argument in sys.argv[1:3] or ("256", "200")]
    main(*counts, *sys.argv[3:4])
