"""
A random policy that cannot do harm at the tip
==============================================

64 episodes at a time, stepped in the core. The action is a torque in the null space of the task: however
wild it is, the tip stays on its reference, and the field still pushes the links away from the disc.
"""

from __future__ import annotations

import time

import numpy as np
from gymnasium.vector import AutoresetMode

from vffnull.draw import style
from vffnull.engines.gym import ReachVectorEnv

# With NEXT_STEP, those that are over begin again and do not disturb the others.
envs = ReachVectorEnv(
    64, "sweep-through", start_noise=0.0, torque=2.0, autoreset_mode=AutoresetMode.NEXT_STEP
)
envs.reset(seed=0)
envs.action_space.seed(0)
going, steps, start = np.ones(envs.num_envs, dtype=bool), 0, time.perf_counter()
errors, clearances = [], []
while going.any():
    _, _, terminated, truncated, info = envs.step(envs.action_space.sample())
    errors.append(np.where(going, info["tracking_error"], np.nan))
    clearances.append(np.where(going, info["clearance"], np.nan))
    going &= ~(terminated | truncated)
    steps += envs.num_envs
print(f"{steps / (time.perf_counter() - start):,.0f} steps of the environment per second")
print(f"tip off its reference by at most {1e3 * np.nanmax(errors):.3f} mm")

with style.look():
    fig, (upper, lower) = style.panels(2, 3.2, 5.0)
    t = envs.period * np.arange(1, len(errors) + 1)
    upper.plot(t, clearances, color="#0072B2", linewidth=0.5, alpha=0.5)
    upper.axhline(0.0, color=style.INK, linewidth=0.8)
    upper.set_ylabel("clearance [m]")
    lower.plot(t, 1e3 * np.array(errors), color="#D55E00", linewidth=0.5, alpha=0.5)
    lower.set_ylabel("tracking error [mm]")
    fig.savefig("gym_random_policy.png")
